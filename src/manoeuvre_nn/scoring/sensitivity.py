"""How much each input of a model counts: by the error without it, and by its share of the output's variance."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf, nan
from typing import Any, Literal

import numpy as np
from jaxtyping import Float
from scipy import stats

from manoeuvre_nn.core.errors import InputError, check_choice

Function = Callable[[Float[np.ndarray, "n k"]], Float[np.ndarray, " n"]]
"""A model: a table of inputs, a row a point, to its output at each."""
Neutral = Literal["mean", "permuted"]
TRIALS = 64
"""Points at which it is seen whether a model varies at all."""
SOBOL_POINTS = 4096
"""Points from which Sobol indices are estimated, times the number of inputs and 2; a power of 2."""


@dataclass(frozen=True)
class InputSensitivity:
    """How much an input counts.

    Attributes:
        name: The input.
        error_ratio: Error of the model without the input over that with it: RMS, the input replaced by its mean over
            the records [-]. 1 where the input does nothing.
        permuted_ratio: Likewise, its values exchanged between the records.
        first: First Sobol index: share of the output's variance over the box of ranges that the input makes alone [-].
        total: Total Sobol index: likewise, together with what it does with other inputs.
    """

    name: str
    error_ratio: float = nan
    permuted_ratio: float = nan
    first: float = nan
    total: float = nan

    def row(self) -> dict[str, Any]:
        """A row of a table."""
        return {
            "input": self.name,
            "error ratio, mean": self.error_ratio,
            "error ratio, permuted": self.permuted_ratio,
            "Sobol first": self.first,
            "Sobol total": self.total,
        }


def error_ratios(
    model: Function,
    inputs: Float[np.ndarray, "n k"],
    targets: Float[np.ndarray, " n"],
    neutral: Neutral = "mean",
    *,
    repeats: int = 10,
    seed: int = 0,
) -> Float[np.ndarray, " k"]:
    """``RMS(model without input i) / RMS(model)`` over records.

    Args:
        model: The model.
        inputs: Records, a column an input.
        targets: What the model should say.
        neutral: What takes the place of an input: ``mean``, its mean over the records, as STATISTICA does; or
            ``permuted``, its own values in another order, so that no value occurs that the records do not have.
        repeats: Orders that are tried, over which the mean square error is taken.
        seed: Seed of the orders.

    Returns:
        Ratio of each input [-]; infinite where the model has no error with it and some without it.

    Raises:
        InputError: If there is no record.

    Source:
        StatSoft, STATISTICA Neural Networks; Hunter et al. 2000. Permutation: Breiman 2001, section 10.
    """
    check_choice("neutral", neutral, ["mean", "permuted"])
    if not len(targets):
        raise InputError("an error ratio needs records: there are none")
    draw = np.random.default_rng(seed)
    whole = _mean_square(model, inputs, targets)
    ratios = []
    for k in range(inputs.shape[1]):
        errors = []
        for _ in range(repeats if neutral == "permuted" else 1):
            without = inputs.copy()
            without[:, k] = draw.permutation(inputs[:, k]) if neutral == "permuted" else inputs[:, k].mean()
            errors.append(_mean_square(model, without, targets))
        ratios.append(_ratio(float(np.mean(errors)), whole))
    return np.array(ratios)


def _mean_square(model: Function, inputs: Float[np.ndarray, "n k"], targets: Float[np.ndarray, " n"]) -> float:
    return float(np.square(model(inputs) - targets).mean())


def _ratio(error: float, whole: float) -> float:
    """Ratio of root mean squares; a model without error that stays so has 1."""
    if whole > 0:
        return float(np.sqrt(error / whole))
    return inf if error > 0 else 1.0


def sobol_indices(
    model: Function, ranges: Float[np.ndarray, "k 2"], count: int = SOBOL_POINTS, seed: int = 0
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """First and total Sobol indices over a box, inputs independent and uniform.

    ``S_i = V[E(y|x_i)] / V[y]``, ``ST_i = 1 - V[E(y|all but x_i)] / V[y]``, estimated by ``scipy.stats.sobol_indices``.

    Args:
        model: The model.
        ranges: Ends of each input's range; an input whose ends are the same has indices of 0.
        count: Points, a power of 2.
        seed: Seed of their scrambling.

    Returns:
        S and ST [-]; 0 for a model that is constant over the box. Those of small inputs may be a little below 0.

    Raises:
        InputError: If a range is empty, or the number of points no power of 2.

    Source:
        Sobol 1993; Saltelli et al. 2010.
    """
    low, high = ranges.T
    if not (np.isfinite(ranges).all() and (low <= high).all()):
        raise InputError(f"ranges {ranges.tolist()}: expected finite ends, the lower one first")
    if count < 2 or count & (count - 1):
        raise InputError(f"{count} points of Sobol indices: expected a power of 2, such as {SOBOL_POINTS}")
    free = np.flatnonzero(low < high)
    first, total = np.zeros(len(low)), np.zeros(len(low))
    middle = float(model(ranges.mean(axis=1)[None])[0])

    def from_middle(x: Float[np.ndarray, "free n"]) -> Float[np.ndarray, "1 n"]:
        points = np.tile(low, (x.shape[1], 1))
        points[:, free] = x.T
        return model(points)[None] - middle

    tried = np.random.default_rng(seed).uniform(low[free], high[free], (TRIALS, len(free)))
    if len(free) and from_middle(tried.T).any():
        distributions = [stats.uniform(low[k], high[k] - low[k]) for k in free]
        found = stats.sobol_indices(func=from_middle, n=count, dists=distributions, rng=seed)
        first[free], total[free] = found.first_order.ravel(), found.total_order.ravel()
    return first, total


def sensitivities(
    model: Function,
    names: Sequence[str],
    inputs: Float[np.ndarray, "n k"],
    targets: Float[np.ndarray, " n"],
    ranges: Float[np.ndarray, "k 2"] | None = None,
    *,
    seed: int = 0,
) -> list[InputSensitivity]:
    """All measures of every input, the one with the largest error ratio first.

    Args:
        model: The model.
        names: Names of the inputs.
        inputs: Records, a column an input.
        targets: What the model should say.
        ranges: Box of the Sobol indices; None takes the ends of the records.
        seed: Seed of permutations and points.

    Returns:
        One an input.
    """
    box = np.stack([inputs.min(axis=0), inputs.max(axis=0)], axis=1) if ranges is None else ranges
    means, permuted = (error_ratios(model, inputs, targets, neutral, seed=seed) for neutral in ("mean", "permuted"))
    columns = zip(names, means, permuted, *sobol_indices(model, box, seed=seed), strict=True)
    found = [InputSensitivity(name, *(float(value) for value in values)) for name, *values in columns]
    return sorted(found, key=lambda one: one.error_ratio, reverse=True)
