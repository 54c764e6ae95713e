"""Coefficients from captive tests, beside those from free runs: which can be compared, and whether they agree."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
import torch
from jaxtyping import Float

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.estimation.coefficients import EQUATIONS, OWN, Fitted
from manoeuvre_nn.network.series import Series, SeriesSettings
from manoeuvre_nn.recording.read.captive import CaptiveTests

MISSING_VARIABLES = {"r", "|r|", "wx", "wy", "|w|"}
"""Variables that static tests do not have."""
SLOPES = {"v": "drift", "d": "rudder"}
"""Variables by which the forces on the approach are differentiated."""
DIFFERENCE_STEP = 1e-4
MAX_PASSES = 20
MAX_Z_AGREE, MIN_Z_DIFFER = 2.0, 3.0
"""Difference over its standard error up to which two values agree, and from which on they differ."""


@dataclass(frozen=True)
class Towed:
    """Captive tests in the units of a fit: velocities over U0, forces over ``0.5 rho L T U0^2``.

    Attributes:
        motion: u, v, r, rudder angle [rad], n over the nominal one, and no wind.
        force: X', Y', N'.
        note: What was taken as U0 and as the nominal shaft speed.
    """

    motion: Float[np.ndarray, "n 7"]
    force: Float[np.ndarray, "n 3"]
    note: str


def towed(
    tests: CaptiveTests,
    length_over_draught: float,
    speed: float | None = None,
    shaft: float | None = None,
    largest_drift: float = 90 * DEGREE,
) -> Towed:
    """Bring captive tests into the units of a fit.

    Args:
        tests: The tests.
        length_over_draught: L/T of the model, for forces over L^2.
        speed: U0 at this model's scale [m/s]; by default the speed of most tests.
        shaft: Nominal shaft speed at this scale [1/s]; by default that of most tests.
        largest_drift: Tests with more drift are left out [rad].

    Returns:
        The tests.

    Raises:
        InputError: If no test is left, or the table does not say the speed.
    """
    kept = (np.abs(tests.beta) <= largest_drift + 1e-9) & (tests.r == 0)
    if kept.sum() < 3:
        raise InputError(f"captive.largest_drift={largest_drift / DEGREE:g} deg leaves {kept.sum()} tests: write more")
    if np.isnan(tests.speed).any():
        raise InputError("captive.file: the table has no speed: add speed to the columns of its mapping")
    u0 = _most(tests.speed) if speed is None else speed
    n0 = _most(tests.n) if shaft is None else shaft
    ratio, n = tests.speed / u0, np.where(np.isnan(tests.n), 1.0, tests.n / (n0 if n0 > 0 else 1.0))
    still = np.zeros(len(tests))
    motion = np.stack([ratio * tests.u, ratio * tests.v, still, tests.delta, n, still, still], axis=1)
    unit = ratio**2 * (length_over_draught if tests.area == "LL" else 1.0)
    force = np.stack([tests.X, tests.Y, tests.N], axis=1) * unit[:, None]
    note = f"{kept.sum()} tests, U0 = {u0:.4g} m/s, n0 = {n0:.4g} 1/s, L/T = {length_over_draught:.4g}"
    return Towed(motion[kept], force[kept], note)


def _most(values: Float[np.ndarray, " n"]) -> float:
    """The value that occurs most."""
    if np.isnan(values).all():
        return float("nan")
    found, counts = np.unique(values[~np.isnan(values)], return_counts=True)
    return float(found[np.argmax(counts)])


def products_of(names: Sequence[tuple[int, str]], motion: Float[np.ndarray, "n 7"]) -> Float[np.ndarray, "n p"]:
    """The product of every coefficient.

    Args:
        names: Output and product of each.
        motion: u, v, r, rudder angle, n, relative wind.

    Returns:
        One column a coefficient.
    """
    terms = list(dict.fromkeys(t for _, t in names))
    series = Series(SeriesSettings([], terms))
    with torch.no_grad():
        table = series.products(torch.as_tensor(motion)).numpy()
    return table[:, [terms.index(t) for _, t in names]]


def forces(fitted: Fitted, motion: Float[np.ndarray, "n 7"]) -> tuple[np.ndarray, np.ndarray]:
    """Forces by coefficients, with their standard errors.

    Args:
        fitted: The coefficients.
        motion: See :class:`Towed`.

    Returns:
        X', Y', N' and standard errors, shape (n, 3) each.
    """
    rows = _rows(fitted, motion)
    variance = np.einsum("nop,pq,noq->no", rows, fitted.covariance, rows)
    return rows @ fitted.values, np.sqrt(np.maximum(variance, 0.0))


def _rows(fitted: Fitted, motion: Float[np.ndarray, "n 7"]) -> Float[np.ndarray, "n 3 p"]:
    """What coefficients are multiplied by to give the three forces."""
    products, outputs = products_of(fitted.names, motion), np.array([o for o, _ in fitted.names])
    return products[:, None, :] * (outputs == np.arange(3)[:, None])


def fit_captive(tests: Towed, like: Fitted) -> Fitted:
    """The same products from captive tests, those with yaw rate or wind left out.

    Each force by least squares with the prior of the fit to recordings; errors of the tests are one size in newtons,
    found from what the products leave, lack of fit among it.

    Args:
        tests: The tests.
        like: The coefficients from recordings, for products and prior.

    Returns:
        Coefficients of products that static tests have; forces, so that no inertia comes in.

    Raises:
        InputError: If the coefficients are those of a ship's own source.
    """
    if like.form == OWN:
        raise InputError("captive.file: compares coefficients of series; choose terms=network")
    places = np.array([k for k, (_, t) in enumerate(like.names) if not MISSING_VARIABLES & set(t.split())])
    names = tuple(like.names[k] for k in places)
    mean, spread = like.mean[places], like.spread[places]
    values, covariance = mean.copy(), np.diag(spread**2)
    products = products_of(names, tests.motion)
    for output in range(3):
        of = np.array([k for k, (o, _) in enumerate(names) if o == output], dtype=int)
        if not len(of):
            continue
        found = _regressed(products[:, of], tests.force[:, output], mean[of], spread[of])
        values[of], covariance[np.ix_(of, of)] = found
    return replace(like, names=names, values=values, covariance=covariance, mean=mean, spread=spread)


def _regressed(
    columns: Float[np.ndarray, "n p"], target: Float[np.ndarray, " n"], mean: np.ndarray, spread: np.ndarray
) -> tuple[Float[np.ndarray, " p"], Float[np.ndarray, "p p"]]:
    """Least squares with a prior; the size of the errors from what is left."""
    scaled, rest = columns * spread, target - columns @ mean
    gram, side = scaled.T @ scaled, scaled.T @ rest
    size = float(np.mean(rest**2)) + 1e-30
    for _ in range(MAX_PASSES):
        inverse = np.linalg.inv(gram / size + np.eye(len(mean)))
        step = inverse @ side / size
        freedom = len(target) - float(np.trace(inverse @ gram)) / size
        size = float(np.square(rest - scaled @ step).sum()) / max(freedom, 1.0) + 1e-30
    return mean + spread * step, inverse * spread[:, None] * spread


def compare(free: Fitted, captive: Fitted) -> pd.DataFrame:
    """Forces on the approach and their slopes, then coefficient by coefficient.

    A coefficient is comparable if both narrowed it by half; slopes by drift and rudder are sums of coefficients and
    often known where these are not.

    Returns:
        name; free, free_error: from recordings; towed, towed_error: from captive tests; known: whether comparable;
        apart: difference over its standard error, else NaN; word: ``agree``, ``doubtful``, ``differ`` or ``open``.
    """
    slopes = [
        (f"{EQUATIONS[o]}' by {SLOPES[v]}", *_slope(free, o, v), *_slope(captive, o, v), True)
        for v in SLOPES
        for o in (1, 2)
    ]
    places = [free.names.index(name) for name in captive.names]
    pairs = free.values[places], free.errors[places], captive.values, captive.errors
    known = (free.errors < 0.5 * free.spread)[places] & (captive.errors < 0.5 * captive.spread)
    made = [*slopes, *zip(captive.symbols, *pairs, known, strict=True)]
    rows = pd.DataFrame(made, columns=["name", "free", "free_error", "towed", "towed_error", "known"])
    distance: pd.Series = (rows["free"] - rows["towed"]) / np.hypot(rows["free_error"], rows["towed_error"])
    apart = distance.where(rows["known"])
    size = apart.abs()
    words = np.select([size.isna(), size < MAX_Z_AGREE, size < MIN_Z_DIFFER], ["open", "agree", "doubtful"], "differ")
    return rows.assign(apart=apart, word=words)


def agreeing_inertia(free: Fitted, captive: Fitted) -> Float[np.ndarray, "2 2"]:
    """Inertia of sway and yaw with which the slopes of both would be the same.

    Free runs give accelerations, captive tests forces; by drift and by rudder that is two vectors each, and the matrix
    that turns ones into the others is the inertia. Far from any estimate of it, something else differs.

    Returns:
        Rows Y' and N', columns vdot' and rdot'; in the (rho, L, T, U0) system.
    """
    by_motion, by_force = (
        np.array([[_slope(one, output, variable)[0] for variable in SLOPES] for output in (1, 2)])
        for one in (free, captive)
    )
    return by_force @ np.linalg.inv(by_motion) @ free.inertia[1:, 1:]


def _slope(fitted: Fitted, output: int, variable: str) -> tuple[float, float]:
    """Derivative of a force by drift or rudder on the approach, and its standard error."""
    motion = np.zeros((2, 7))
    motion[:, [0, 4]] = 1.0
    motion[:, {"v": 1, "d": 3}[variable]] = DIFFERENCE_STEP, -DIFFERENCE_STEP
    rows = _rows(fitted, motion)[:, output]
    weights = (rows[0] - rows[1]) / (2 * DIFFERENCE_STEP)
    return float(weights @ fitted.values), float(np.sqrt(weights @ fitted.covariance @ weights))
