"""Stepwise least squares with the statistics by which a term is kept or dropped."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Float, Int
from statsmodels.regression.linear_model import OLS, RegressionResultsWrapper

from manoeuvre_nn.core.errors import InputError, check_choice

Method = Literal["backward", "stepwise", "all"]
Samples = Float[np.ndarray, " n"]
Columns = Mapping[str, Samples]
"""Name of a term -> its value in every sample."""

DEPENDENT = 1e-7
"""A column of which no larger part than this is new beside the columns before it is left out [-]."""


@dataclass(frozen=True)
class Rules:
    """How terms are chosen.

    Attributes:
        method: ``backward`` drops the least significant of all terms until every one is significant; ``stepwise`` adds
            the most significant one and then drops what has ceased to be; ``all`` keeps all.
        level: Largest p value of a term that is kept [-].
        unusual: Standardised residual beyond which a sample is taken out and everything done again [-]; None keeps all.
        share: Largest share of the samples that is taken out [-]. Smooth residuals have no outliers: what is taken out
            then leaves others beyond the limit, without end.
        resolution: Standard deviation of the residuals over the target's root mean square below which they are
            rounding [-]. Residuals of exact data would make every term significant or none, as rounding falls.
    """

    method: Method = "backward"
    level: float = 0.05
    unusual: float | None = None
    share: float = 0.1
    resolution: float = 1e-9

    def __post_init__(self) -> None:
        """Refuse rules that make no sense.

        Raises:
            InputError: If a setting is out of range.
        """
        check_choice("regression.method", self.method, ["backward", "stepwise", "all"])
        if not 0 < self.level < 1:
            raise InputError(f"regression.level={self.level}: expected a p value between 0 and 1, for instance 0.05")
        if self.unusual is not None and not self.unusual > 1:
            raise InputError(f"regression.unusual={self.unusual}: expected more than 1, for instance 3, or null")


@dataclass(frozen=True)
class TermEstimate:
    """One coefficient.

    Attributes:
        value: Its estimate.
        error: Standard error.
        low: Lower end of the 95 % interval.
        high: Upper end.
        p: Chance of an estimate this far from 0 were the coefficient 0 [-].
        inflation: How much larger its variance is than with columns at right angles (variance inflation factor) [-].
    """

    value: float
    error: float
    low: float
    high: float
    p: float
    inflation: float = 1.0


@dataclass(frozen=True)
class Equation:
    """A regression with the terms that were kept.

    Attributes:
        estimates: Term -> coefficient, in the order of the columns.
        r_squared: Share of the target's variation that is explained; about its mean if a constant was kept [-].
        condition: Condition number of the standardised columns [-].
        deviation: Standard deviation of the residuals, in units of the target; not below the resolution.
        freedom: Samples minus terms.
        unusual: Samples that were taken out.
        dependent: Terms left out since they are combinations of the terms before them.
        influence: What every sample adds to every estimate: ``values = influence @ target``; 0 where taken out.
        residuals: Target minus what the terms give; 0 where taken out.
    """

    estimates: Mapping[str, TermEstimate]
    r_squared: float
    condition: float
    deviation: float
    freedom: int
    unusual: Int[np.ndarray, " m"]
    dependent: tuple[str, ...]
    influence: Float[np.ndarray, "k n"]
    residuals: Samples

    @property
    def values(self) -> dict[str, float]:
        """Term -> value."""
        return {term: e.value for term, e in self.estimates.items()}


def regress(columns: Columns, target: Samples, rules: Rules | None = None) -> Equation:
    """Regress a target on those of the columns that matter.

    Columns that are combinations of earlier ones are left out first, so list what is to be kept first. Standard errors
    take the residuals as independent from sample to sample; where they follow one another smoothly, as those of a
    network do, intervals are too narrow.

    Args:
        columns: All terms; give the constant a column of ones.
        target: What is to be explained.
        rules: How terms are chosen; by default backward elimination at p < .05.

    Returns:
        The regression.

    Raises:
        InputError: If there are not more samples than terms, or a value is no number.
    """
    rules = rules or Rules()
    names, design = list(columns), np.stack(list(columns.values()), axis=1)
    if len(target) <= len(names):
        raise InputError(f"{len(target)} samples for {len(names)} terms: expected more samples than terms")
    _check_numbers(names, design, target)
    scale = np.sqrt(np.square(design).mean(axis=0))
    free = _independent(design)
    used = np.arange(len(target))
    fewest = max(len(free) + 1, (1 - rules.share) * len(target))
    while True:
        kept = _chosen(design[used] / np.where(scale > 0, scale, 1.0), target[used], free, rules)
        found = _equation(names, design / np.where(scale > 0, scale, 1.0), scale, target, kept, used, rules)
        strange = _strange(found, design, kept, used, rules)
        if not strange.any() or len(used) - strange.sum() < fewest:
            return replace(found, dependent=tuple(n for k, n in enumerate(names) if k not in free))
        used = used[~strange]


def _variance_inflation(columns: Float[np.ndarray, "n k"], constant: int | None) -> Float[np.ndarray, " k"]:
    """Variance inflation factors, of columns about their means if there is a constant."""
    factors = len(columns) * np.diag(np.linalg.inv(columns.T @ columns)) * np.square(columns).mean(axis=0)
    if constant is None:
        return factors
    spread = columns.var(axis=0) / np.square(columns).mean(axis=0)
    spread[constant] = 1.0
    return factors * spread


def _check_numbers(names: Sequence[str], design: np.ndarray, target: np.ndarray) -> None:
    if not (np.isfinite(design).all() and np.isfinite(target).all()):
        bad = [n for n, column in zip(names, design.T, strict=True) if not np.isfinite(column).all()] or ["the target"]
        raise InputError(f"regression: {', '.join(bad)} holds values that are no numbers: take these samples out")


def _independent(design: np.ndarray) -> list[int]:
    """Columns with something new beside the ones before them."""
    basis = np.zeros((len(design), 0))
    kept: list[int] = []
    for k, column in enumerate(design.T):
        rest = column - basis @ (basis.T @ column)
        rest -= basis @ (basis.T @ rest)  # again: once is not exact enough beside nearly parallel columns
        size = np.linalg.norm(rest)
        if size > DEPENDENT * np.linalg.norm(column):
            basis, kept = np.column_stack([basis, rest / size]), [*kept, k]
    return kept


def _fit(design: np.ndarray, target: np.ndarray, rules: Rules) -> RegressionResultsWrapper:
    """Ordinary least squares whose residual variance is at least that of rounding."""
    model = OLS(target, design)
    result = model.fit(method="qr")
    floor = _rounding(target, rules) ** 2
    if result.scale >= floor:
        return result
    return model.fit(method="qr", cov_type="fixed scale", cov_kwds={"scale": floor}, use_t=True)


def _rounding(target: np.ndarray, rules: Rules) -> float:
    """Standard deviation that residuals have at least."""
    return rules.resolution * float(np.sqrt(np.square(target).mean()))


def _chosen(design: np.ndarray, target: np.ndarray, free: Sequence[int], rules: Rules) -> list[int]:
    if rules.method == "all" or not target.any():
        return list(free) if target.any() else []
    if rules.method == "backward":
        return _eliminated(design, target, list(free), rules)
    kept: list[int] = []
    seen: set[frozenset[int]] = set()
    while frozenset(kept) not in seen:  # a set that comes again would come for ever
        seen.add(frozenset(kept))
        p = {k: _fit(design[:, [*kept, k]], target, rules).pvalues[-1] for k in free if k not in kept}
        best = min(p, key=p.__getitem__, default=None)
        if best is not None and p[best] < rules.level:
            kept = _eliminated(design, target, [*kept, best], rules)
    return sorted(kept)


def _eliminated(design: np.ndarray, target: np.ndarray, kept: list[int], rules: Rules) -> list[int]:
    """Drop the least significant term as long as one is not significant."""
    while kept:
        p = _fit(design[:, kept], target, rules).pvalues
        worst = int(np.argmax(p))
        if p[worst] < rules.level:
            break
        kept = kept[:worst] + kept[worst + 1 :]
    return kept


def _equation(
    names: Sequence[str],
    design: np.ndarray,
    scale: np.ndarray,
    target: np.ndarray,
    kept: Sequence[int],
    used: np.ndarray,
    rules: Rules,
) -> Equation:
    """What is reported of the terms that were kept."""
    out = np.setdiff1d(np.arange(len(target)), used)
    influence, residuals = np.zeros((len(kept), len(target))), np.zeros_like(target)
    if not kept:
        residuals[used] = target[used]
        size = float(np.sqrt(np.square(target[used]).mean()))
        return Equation({}, 0.0, 1.0, size, len(used), out, (), influence, residuals)
    part, size = design[np.ix_(used, np.array(kept))], scale[np.array(kept)]
    result = _fit(part, target[used], rules)
    spread = np.ptp(part, axis=0)
    constant = int(np.argmin(spread)) if spread.min() < 1e-12 else None
    factors, interval = _variance_inflation(part, constant), result.conf_int(0.05)
    scaled = np.column_stack([result.params, result.bse, interval]) / size[:, None]
    estimates = {
        names[k]: TermEstimate(*map(float, scaled[i]), p=float(result.pvalues[i]), inflation=float(factors[i]))  # type: ignore[misc]
        for i, k in enumerate(kept)
    }
    influence[:, used], residuals[used] = np.linalg.pinv(part) / size[:, None], result.resid
    return Equation(
        estimates,
        float(result.rsquared),
        _condition(part, constant),
        max(float(np.sqrt(result.scale)), _rounding(target[used], rules)),
        len(used) - len(kept),
        out,
        (),
        influence,
        residuals,
    )


def _condition(part: np.ndarray, constant: int | None) -> float:
    """Condition number of the columns over their size, about their means if there is a constant."""
    if constant is not None:
        part = np.delete(part - part.mean(axis=0), constant, axis=1)
    return float(np.linalg.cond(part / np.linalg.norm(part, axis=0))) if part.shape[1] else 1.0


def _strange(found: Equation, design: np.ndarray, kept: Sequence[int], used: np.ndarray, rules: Rules) -> np.ndarray:
    """Which of the samples in use have a standardised residual beyond the limit."""
    if rules.unusual is None:
        return np.zeros(len(used), dtype=bool)
    leverage = np.einsum("nk,kn->n", design[np.ix_(used, np.array(kept, dtype=int))], found.influence[:, used])
    size = found.deviation * np.sqrt(np.maximum(1 - leverage, 1e-12))
    return np.abs(found.residuals[used]) > rules.unusual * size
