"""Every effect, and the best one with every other, fitted by least squares and compared by an information criterion."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares

from manoeuvre_nn.core.effect import Effect
from studies.concealed_trial.rivals.events import TIMES, placed, timed
from studies.concealed_trial.rivals.package import Hypothesis
from studies.concealed_trial.rivals.whitened import WhitenedRuns

PROMISING = 2
"""Starts of an effect that are fitted to the end."""
SHORT, LONG, FINAL = (1, 3), (2, 8), 4
"""Turns of weighting the rows anew and evaluations in each, at first and at the end; how many fits get to the end."""
PAIR = 6.0
"""What a second effect costs beside its parameters: there are many, and few cases have two."""
SHARES, GUST_TIME = (0.06, 0.1, 0.15, 0.22, 0.33), 30.0
"""Standard deviations of gusts over the mean wind that are tried, and their usual correlation time [s]."""
EDGE = 1e-6
"""Distance from a bound at which a fit starts, over the range."""


@dataclass(frozen=True)
class LeastSquaresFit:
    """A hypothesis at its best values.

    Attributes:
        hypothesis: It.
        left: What it leaves as the fit compares it.
        criterion: Bayesian information criterion (Schwarz 1978), smaller is better.
        spread: Covariance of the free numbers.
    """

    hypothesis: Hypothesis
    left: Float[np.ndarray, "n rows"] = field(repr=False)
    criterion: float
    spread: Float[np.ndarray, "q q"] = field(repr=False)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects."""
        return self.hypothesis.names

    @property
    def misfit(self) -> float:
        """Deviance a sample: 0.69 a row where noise is as usual."""
        return deviance(self.left) / len(self.left)


def deviance(left: Float[np.ndarray, "n rows"]) -> float:
    """Minus twice the log likelihood where the variance of each row is uncertain.

    An inverse gamma prior about the usual variance that weighs as much as the data themselves, integrated out.

    Args:
        left: White samples of each row.

    Returns:
        The deviance.
    """
    return float(len(left) * np.log1p((left**2).mean(axis=0)).sum())


def search(data: WhitenedRuns, effects: Sequence[Effect]) -> tuple[LeastSquaresFit, list[LeastSquaresFit]]:
    """Fit calm water, every effect, and the best one with every other of another family.

    Args:
        data: The runs.
        effects: Prototypes of the candidates.

    Returns:
        Calm water, and everything else, best first; gusts are left to :func:`gusts`.
    """
    none = none_of(data)
    plain = [e for e in effects if not e.random]
    fits = settled(data, [added(data, none, e) for e in plain])
    if fits[0].criterion < none.criterion:
        fits = sorted([*fits, *_pairs(data, plain, fits)], key=lambda f: f.criterion)
    return none, fits


def _pairs(data: WhitenedRuns, effects: Sequence[Effect], fits: Sequence[LeastSquaresFit]) -> list[LeastSquaresFit]:
    """The best effect with every other of another family; with the best of these, others of the first one's family."""
    (one,) = fits[0].hypothesis.effects
    pairs = settled(data, [added(data, fits[0], e) for e in effects if e.family != one.family])
    second = next(f for f in fits if f.names == pairs[0].names[1:])
    others = [e for e in effects if e.family == one.family and e.name != one.name]
    pairs += settled(data, [added(data, second, e) for e in others])
    return [replace(f, criterion=f.criterion + PAIR) for f in pairs]


def none_of(data: WhitenedRuns) -> LeastSquaresFit:
    """Calm water.

    Args:
        data: The runs.

    Returns:
        Its fit.
    """
    return fitted(data, Hypothesis((), (), TIMES))


def settled(data: WhitenedRuns, fits: Sequence[LeastSquaresFit]) -> list[LeastSquaresFit]:
    """All fits, the best few of them brought to their end, best first.

    Args:
        data: The runs.
        fits: Fits in any order.

    Returns:
        As many.
    """
    ranked = sorted(fits, key=lambda f: f.criterion)
    ends = [min(f, fitted(data, f.hypothesis, *LONG), key=lambda g: g.criterion) for f in ranked[:FINAL]]
    return sorted([*ends, *ranked[FINAL:]], key=lambda f: f.criterion)


def added(data: WhitenedRuns, base: LeastSquaresFit, effect: Effect) -> LeastSquaresFit:
    """The best fit with one more effect.

    Args:
        data: The runs.
        base: What else acts.
        effect: Prototype of the effect.

    Returns:
        The fit.
    """
    h, runs, starts = base.hypothesis, len(data.tracks), starts_of(effect)
    if timed(effect):
        found = [placed(data, h, effect, row) for row in starts]
        best = max(found, key=lambda item: item[1])[0]
        first = fitted(data, h.joined(Hypothesis((effect,), (best,))))
        values = first.hypothesis.values[-1]
        rest = replace(first.hypothesis, effects=h.effects, values=first.hypothesis.values[:-1])
        times, _ = placed(data, rest, effect, values[0], scaled=False)
        return min(first, fitted(data, rest.joined(Hypothesis((effect,), (times,)))), key=lambda f: f.criterion)
    tables = [np.repeat(v[:, None], len(starts), axis=1) for v in h.values]
    view = data.seen(data.tried((*h.effects, effect), [*tables, np.repeat(starts[None], runs, axis=0)]))
    order = np.argsort([deviance(view[..., k]) for k in range(len(starts))])[:PROMISING]
    fits = [fitted(data, h.joined(Hypothesis((effect,), (np.repeat(starts[[k]], runs, axis=0),)))) for k in order]
    return min(fits, key=lambda f: f.criterion)


def starts_of(effect: Effect) -> Float[np.ndarray, "k p"]:
    """Values from which a fit is tried: all starts, formulas as published.

    Args:
        effect: The effect.

    Returns:
        One set a row; of times only the first.
    """
    grids = [(p.null,) if p.form and p.null is not None else p.starts for p in effect.declared]
    return np.array(list(product(*(g[:1] if p.per_run else g for p, g in zip(effect.declared, grids, strict=True)))))


def fitted(data: WhitenedRuns, h: Hypothesis, sweeps: int = SHORT[0], steps: int = SHORT[1]) -> LeastSquaresFit:
    """Least squares from where a hypothesis is; rows that fit badly count less in the next turn.

    Args:
        data: The runs.
        h: The hypothesis.
        sweeps: Turns of weighting the rows anew.
        steps: Evaluations in each.

    Returns:
        The fit.
    """
    free = h.unknowns()
    if not free:
        left = data.evaluate(h)[0]
        return LeastSquaresFit(h, left, deviance(left), np.zeros((0, 0)))
    known: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}
    held = np.array([1 / f.spread if f.parameter.form else 0.0 for f in free])
    centre = np.array([f.mean(0.0) for f in free])
    low, high = np.array([(-np.inf, np.inf) if p.period else (p.low, p.high) for p in (f.parameter for f in free)]).T
    margin = np.array([0.0 if f.parameter.period else EDGE * (f.parameter.high - f.parameter.low) for f in free])

    def look(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if x.tobytes() not in known:
            known[x.tobytes()] = data.evaluate(h.with_vector(x))
        return known[x.tobytes()]

    def errors(x: np.ndarray, weight: np.ndarray) -> np.ndarray:
        return np.concatenate([(look(x)[0] * weight).ravel(), held * (x - centre)])

    def slopes(x: np.ndarray, weight: np.ndarray) -> np.ndarray:
        return np.concatenate([(look(x)[1] * weight[:, None]).reshape(-1, len(x)), np.diag(held)])

    x = np.clip(h.vector(), low + margin, high - margin)
    scale = [45.0 if f.parameter.period else f.spread for f in free]
    for _ in range(sweeps):
        weight = 1 / np.sqrt(1 + (look(x)[0] ** 2).mean(axis=0))
        x = least_squares(errors, x, slopes, (low, high), x_scale=scale, max_nfev=steps, args=(weight,)).x
    left, slope = look(x)[0], slopes(x, weight)
    spread = np.linalg.pinv(slope.T @ slope, hermitian=True)
    x = np.array([v % f.parameter.period if f.parameter.period else v for v, f in zip(x, free, strict=True)])
    penalty = float(((held * (x - centre)) ** 2).sum())
    return LeastSquaresFit(h.with_vector(x), left, deviance(left) + penalty + _size(h) * np.log(len(left)), spread)


def _size(h: Hypothesis) -> int:
    """Numbers that are paid for: those that no formula holds, and times."""
    times = sum(v.shape[0] * len(timed(e)) for e, v in zip(h.effects, h.values, strict=True))
    return times + sum(not f.parameter.form for f in h.unknowns())


def gusts(data: WhitenedRuns, found: LeastSquaresFit, gusty: Effect) -> LeastSquaresFit:
    """A fit with a steady wind, its wind made gusty: a random wind speed in every average.

    Args:
        data: The runs.
        found: With ``wind_steady`` among its effects.
        gusty: Prototype of the gusty wind.

    Returns:
        The fit with the most likely size of gusts.
    """
    h = found.hypothesis
    which = h.names.index("wind_steady")
    speed = next(k for k, f in enumerate(h.unknowns()) if f.effect == which and f.parameter.name == "speed")
    slope, left = data.evaluate(h)[1][:, :3, speed], found.left[:, :3]
    power, along = (slope**2).sum(axis=1), (slope * left).sum(axis=1)
    # What is across the direction of a gust tells how large everything else is.
    noise = max(float((((left**2).sum(axis=1) - along**2 / power) / 2).mean()), 1.0)
    power, along = power / noise, along / noise
    first = data.tracks[0]
    gap = first.run.step * np.subtract.outer(np.arange(len(first.weight)), np.arange(len(first.weight)))
    kept = float(first.weight @ np.exp(-np.abs(gap) / GUST_TIME) @ first.weight)
    sizes = max(float(h.values[which][0, 0]), 1.0) * np.array(SHARES)
    # One random factor on a known direction: its likelihood ratio against none in closed form.
    gains = [float((along**2 / (1 / (kept * s**2) + power) - np.log1p(kept * s**2 * power)).sum()) for s in sizes]
    values = {p.name: h.values[which][:, k] for k, p in enumerate(h.effects[which].declared)}
    values["gust_sd"] = np.full(len(data.tracks), sizes[np.argmax(gains)])
    values |= {"gust_time_s": np.array(GUST_TIME), "gust_across": np.array(0.0)}
    table = np.stack([np.broadcast_to(values[p.name], len(data.tracks)) for p in gusty.declared], axis=-1)
    effects, tables = list(h.effects), list(h.values)
    effects[which], tables[which] = gusty, table
    criterion = found.criterion - max(gains) + np.log(len(found.left))
    return replace(found, hypothesis=replace(h, effects=tuple(effects), values=tuple(tables)), criterion=criterion)
