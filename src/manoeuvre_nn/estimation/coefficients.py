"""Coefficients that were fitted to recordings: symbols, intervals, and how much the recordings say about each."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import factorial, prod
from typing import Any

import numpy as np
import pandas as pd
from jaxtyping import Float

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.estimation.derivatives import coefficient_name

EQUATIONS = "XYN"
TAYLOR, PLAIN, OWN = "taylor", "plain", "own"
"""What coefficients are: derivatives about the approach, factors of products, or those of a ship's own source."""
MEASURED, TOGETHER, PARTLY, PRIOR = "measured", "together", "partly", "prior"
MEASURED_SHARE, PARTLY_SHARE = 0.75, 0.1
"""Share by which the recordings narrow a coefficient for it to be called measured, and partly measured."""
MAX_CORRELATION = 0.99
"""Correlation of its error with that of another beyond which a coefficient is not measured by itself: given the other,
its standard error would be a seventh."""
REACH = 1.96
"""Half of a 95 % interval over the standard error."""
ARRAYS = ("values", "covariance", "mean", "spread", "inertia")
"""What is stored of fitted coefficients beside their names and form."""
ABOUT_APPROACH = {"1", "a", "v", "r", "d"}
"""Variables of a Taylor series about the approach."""


@dataclass(frozen=True)
class Fitted:
    """Coefficients of products with their uncertainty, in the (rho, L, T, U0) system unless they are a ship's own.

    Only ratios of forces to inertia show in free motion: the coefficients belong to :attr:`inertia`.

    Attributes:
        names: Output (0 X, 1 Y, 2 N) and product of each.
        values: Factors of the products.
        covariance: Of them.
        mean: What they were before any run was seen.
        spread: Standard deviation of that.
        inertia: M' in the (rho, L, T, U0) system that forces were divided by.
        form: :data:`TAYLOR`, :data:`PLAIN` or :data:`OWN`.
    """

    names: tuple[tuple[int, str], ...]
    values: Float[np.ndarray, " p"]
    covariance: Float[np.ndarray, "p p"]
    mean: Float[np.ndarray, " p"]
    spread: Float[np.ndarray, " p"]
    inertia: Float[np.ndarray, "3 3"]
    form: str = PLAIN

    @property
    def errors(self) -> Float[np.ndarray, " p"]:
        """Standard errors."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    @property
    def correlation(self) -> Float[np.ndarray, "p p"]:
        """Of their errors; of one without any error 0."""
        sizes = np.maximum(self.errors, 1e-300)
        return self.covariance / sizes[:, None] / sizes

    @property
    def in_prior_units(self) -> Float[np.ndarray, "p p"]:
        """Covariance over that of before: 1 is nothing learnt, whatever the scales."""
        return self.covariance / self.spread[:, None] / self.spread

    @property
    def determined(self) -> float:
        """How many combinations of coefficients the recordings fix: ``sum(1 - eigenvalue)``."""
        return float(len(self.values) - np.trace(self.in_prior_units))

    @property
    def symbols(self) -> tuple[str, ...]:
        """Symbol of each."""
        return tuple(symbol(o, t, self.form) for o, t in self.names)

    def with_inertia(self, inertia: Float[np.ndarray, "3 3"]) -> "Fitted":
        """What the same motion says if the ship's inertia is another: ``f = M M_fit^-1 f_fit``.

        Y and N are mixed where both have the product; the part for which the other lacks it has no name and is left
        out.

        Args:
            inertia: M' in the (rho, L, T, U0) system.

        Returns:
            Coefficients, and their prior, for that inertia.

        Raises:
            InputError: If the coefficients are in a system of the ship's own.
        """
        if self.form == OWN:
            raise InputError("inertia=: coefficients of a ship's own source belong to its own inertia; leave it out")
        mixing = inertia @ np.linalg.inv(self.inertia)
        alike = np.array([[a[1] == b[1] for b in self.names] for a in self.names])
        outputs = np.array([o for o, _ in self.names])
        change = np.where(alike, mixing[outputs[:, None], outputs], 0.0)
        spread = np.sqrt(np.square(change) @ np.square(self.spread))
        values, covariance = change @ self.values, change @ self.covariance @ change.T
        return replace(
            self, values=values, covariance=covariance, mean=change @ self.mean, spread=spread, inertia=inertia
        )

    def as_dict(self) -> dict[str, Any]:
        """What ``coefficients.json`` keeps for others to go on with: plain numbers and strings."""
        arrays = {k: getattr(self, k).tolist() for k in ARRAYS}
        return {"names": [list(n) for n in self.names], "form": self.form} | arrays


def approach_inertia(ship: Ship) -> Float[np.ndarray, "3 3"]:
    """A ship's inertia in the (rho, L, T, U0) system."""
    p = ship.particulars
    ratio = ship.prime.mass / (0.5 * p.rho * p.length**2 * p.draught)
    return ship.inertia.detach().double().numpy() * ratio


def fitted_from(stored: Mapping[str, Any]) -> Fitted:
    """Take up what :meth:`Fitted.as_dict` wrote.

    Returns:
        The coefficients.

    Raises:
        InputError: If something is missing, of the wrong size, not finite, or an inertia or variance that cannot be.
    """
    try:
        names = tuple((int(o), str(t)) for o, t in stored["names"])
        arrays = {k: np.array(stored[k], dtype=float) for k in ARRAYS}
        form = str(stored["form"])
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"coefficients: {error} is missing or no list of numbers; fit again") from error
    p = len(names)
    for key, shape in zip(ARRAYS, ((p,), (p, p), (p,), (p,), (3, 3)), strict=True):
        if arrays[key].shape != shape:
            raise InputError(f"coefficients: {key} has shape {arrays[key].shape}, expected {shape}; fit again")
        if not np.isfinite(arrays[key]).all():
            raise InputError(f"coefficients: {key} holds what is no finite number; fit again")
    if any(output not in range(len(EQUATIONS)) for output, _ in names):
        raise InputError(f"coefficients: names has equations beside 0 to {len(EQUATIONS) - 1}; fit again")
    m = arrays["inertia"]
    if not (m[0, 0] > 0 and m[1, 1] > 0 and np.linalg.det(m[1:, 1:]) > 0):  # kinetic energy of any motion
        raise InputError(f"coefficients: inertia {m.tolist()} is no ship's; fit again")
    if (arrays["covariance"].diagonal() < 0).any() or (arrays["spread"] <= 0).any():
        raise InputError("coefficients: covariance or spread holds no squares of errors; fit again")
    return Fitted(names, form=form, **arrays)


def coefficient_table(fitted: Fitted) -> pd.DataFrame:
    """All coefficients, in the order of the names.

    Returns:
        symbol: such as ``Y_v|v|`` or ``N_dnn``; value: factor of the product, for a Taylor series the derivative,
        ``Y_vvv`` of ``Y_vvv v^3 / 6``; error: its standard error; prior, prior_error: what it was before any run was
        seen; factor: of the bare product; low, high: ends of the 95 % interval; learnt: how much the recordings
        narrowed it, 0 not at all, 1 wholly; with: symbols of those that it is correlated with beyond
        :data:`MAX_CORRELATION`; word: ``measured``, ``together`` if only together with these, ``partly`` or ``prior``.
    """
    times = np.array([_factorials(term) if fitted.form == TAYLOR else 1.0 for _, term in fitted.names])
    value, error, prior, prior_error = (times * x for x in (fitted.values, fitted.errors, fitted.mean, fitted.spread))
    learnt = np.maximum(0.0, 1 - error / prior_error)
    partners = [
        tuple(other for k, other in enumerate(fitted.symbols) if k != own and abs(row[k]) > MAX_CORRELATION)
        for own, row in enumerate(fitted.correlation)
    ]
    tied = np.array([bool(others) for others in partners])
    return pd.DataFrame({
        "symbol": fitted.symbols,
        "value": value,
        "error": error,
        "prior": prior,
        "prior_error": prior_error,
        "factor": fitted.values,
        "low": value - REACH * error,
        "high": value + REACH * error,
        "learnt": learnt,
        "with": partners,
        "word": np.select(
            [(learnt >= PARTLY_SHARE) & tied, learnt >= MEASURED_SHARE, learnt >= PARTLY_SHARE],
            [TOGETHER, MEASURED, PARTLY],
            PRIOR,
        ),
    })


def form_of(terms: Sequence[str]) -> str:
    """What the coefficients of a series are.

    Returns:
        :data:`TAYLOR` if they are those of a Taylor series about the approach, else :data:`PLAIN`.
    """
    calm = [t.split() for t in terms if "w" not in t]
    return TAYLOR if all(set(t) <= ABOUT_APPROACH for t in calm) else PLAIN


def symbol(output: int, term: str, form: str = PLAIN) -> str:
    """A coefficient's symbol, d for the rudder angle.

    Args:
        output: 0 X, 1 Y, 2 N.
        term: Variables parted by blanks.
        form: What it is; derivatives have ITTC's symbols, with u for the deviation from the approach.

    Returns:
        ``Y_vvd``, ``Y_v|v|``, ``N_dnn``.
    """
    tokens = term.split()
    if form == TAYLOR and set(tokens) <= ABOUT_APPROACH:
        return coefficient_name(EQUATIONS[output], "".join(tokens).replace("1", "0").replace("a", "u"))
    return f"{EQUATIONS[output]}_{''.join(tokens).replace('1', '0')}"


def _factorials(term: str) -> float:
    """Derivative over the factor of its product: 6 for ``v v v``."""
    counts = Counter(t for t in term.split() if t != "1")
    return float(prod(factorial(n) for n in counts.values()))
