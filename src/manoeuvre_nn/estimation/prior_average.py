"""Priors of the errors of coefficients that are tried: how these go together, and how large missing terms may be."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float
from scipy.special import logsumexp

from manoeuvre_nn.estimation.changed_coefficients import changed_base
from manoeuvre_nn.estimation.corrections import CoefficientPrior, Corrections
from manoeuvre_nn.estimation.data_set import COEFFICIENT_SD_LEVELS, WhitenedDataSet
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis
from manoeuvre_nn.estimation.hypothesis_columns import hypothesis_columns
from manoeuvre_nn.estimation.linear_run import joined, summed
from manoeuvre_nn.estimation.marginal_likelihood import PROCESS_PRIOR, log_prior_levels
from manoeuvre_nn.estimation.posterior import posterior
from manoeuvre_nn.estimation.prepared_run import LATENCY_SD, PreparedRun, base_columns

COEFFICIENT_PRIORS = tuple(
    CoefficientPrior(coupling, missing) for coupling in (0.0, 0.3, 0.6, 0.9) for missing in (0.3, 1.0, 3.0)
)
"""Priors that are tried: forces at any arm to forces at a known arm, missing terms small or large. Where few
are missing, terms as uncertain as those printed make the scatter of these look smaller than it is."""


def with_likely_coefficient_prior(data_set: WhitenedDataSet, fitted: FittedHypothesis) -> WhitenedDataSet:
    """The same runs with the prior of coefficients that a fitted hypothesis makes most likely.

    Args:
        data_set: The runs.
        fitted: At its values and noise levels; latencies and its own numbers are free.

    Returns:
        The runs with one of :data:`COEFFICIENT_PRIORS`.
    """
    evidence, whole = _by_coefficient_prior(data_set, fitted, fitted.best[:1])
    return WhitenedDataSet(data_set.dynamics, whole, max(COEFFICIENT_PRIORS, key=evidence))


def gain_by_coefficient_priors(data_set: WhitenedDataSet, fitted: FittedHypothesis) -> float:
    """What a fitted hypothesis gains where any prior of coefficients is as likely as the one that the runs have.

    ``log mean_p exp(E_p - E)``, E_p its log evidence with each of :data:`COEFFICIENT_PRIORS`, E with that of the runs:
    chosen for one hypothesis, as for calm water, a prior is in its favour.

    Args:
        data_set: The runs.
        fitted: At its values and noise levels; latencies and its own numbers are free.

    Returns:
        The gain in log evidence, at least ``-log(12)`` where the runs have one of them; process noise is summed out
        next to its best level.
    """
    evidence, _ = _by_coefficient_prior(data_set, fitted, data_set.levels.beside(fitted.best[0]))
    each = [evidence(kind) for kind in COEFFICIENT_PRIORS]
    return float(logsumexp(each) - np.log(len(each)) - evidence(data_set.coefficient_prior))


def _by_coefficient_prior(
    data_set: WhitenedDataSet, fitted: FittedHypothesis, levels: Sequence[int]
) -> tuple[Callable[[CoefficientPrior], float], list[PreparedRun]]:
    """Log evidence of a fitted hypothesis by the prior of coefficients, but for a constant, and the runs with all."""
    names = Corrections(data_set.dynamics).names
    lin = hypothesis_columns(data_set, fitted.hypothesis)
    whole = [replace(p, base=base_columns(data_set.dynamics, p.linearised)) for p in data_set.runs]
    k, count = len(names), len(whole)
    size = 1 + k + count
    both = [joined([p.base, c]) for p, c in zip(whole, lin.columns, strict=True)]
    index = [np.r_[: 1 + k, 1 + k + run, size + at] for run, at in enumerate(lin.index)]
    lin = replace(lin, turned=changed_base(data_set, fitted.hypothesis, combined=False))

    def gram_at(level: int) -> Float[np.ndarray, "p p"]:
        embedded = [white.embed(c) for white, c in zip(data_set.at(level).white, both, strict=True)]
        return summed([lin.turn(run, e.dot(e), gram=True) for run, e in enumerate(embedded)], index, size + lin.count)

    of_levels = log_prior_levels(data_set, PROCESS_PRIOR)
    at = [(gram_at(level), data_set.at(level).norm, of_levels[level]) for level in levels]
    # The data less what the hypothesis adds at its values; unknowns: coefficients, latencies, the hypothesis' own.
    data, keep = np.eye(size + lin.count)[0] - np.eye(size + lin.count)[size], [0, size, *range(1, size)]
    keep += range(size + 1, size + lin.count)
    prior = np.r_[np.ones(k), np.full(count, LATENCY_SD), fitted.hypothesis.prior_sds()]

    def evidence(kind: CoefficientPrior) -> float:
        change = np.eye(size + lin.count)
        change[1 : 1 + k, 1 : 1 + k] = kind.root(names)
        turned = [((change.T @ gram @ change)[np.ix_(keep, keep)], norm) for gram, norm, _ in at]
        found = [posterior(*one, prior, data[keep], COEFFICIENT_SD_LEVELS, k).evidence for one in turned]
        return float(logsumexp([there + of_level for there, (_, _, of_level) in zip(found, at, strict=True)]))

    return evidence, whole
