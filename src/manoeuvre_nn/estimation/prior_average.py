"""Priors of the errors of coefficients that are tried: how these go together, and how large missing terms may be."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float
from scipy.special import logsumexp, softmax

from manoeuvre_nn.estimation.changed_coefficients import changed_base
from manoeuvre_nn.estimation.corrections import CoefficientPrior, Corrections
from manoeuvre_nn.estimation.data_set import COEFFICIENT_SD_LEVELS, WhitenedDataSet
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis, Hypothesis
from manoeuvre_nn.estimation.hypothesis_columns import hypothesis_columns
from manoeuvre_nn.estimation.linear_run import summed
from manoeuvre_nn.estimation.marginal_likelihood import PROCESS_PRIOR, log_prior_levels, to_prior_means, weighty
from manoeuvre_nn.estimation.posterior import Posterior, mixture, reduced
from manoeuvre_nn.estimation.prepared_run import LATENCY_SD

COEFFICIENT_PRIORS = tuple(
    CoefficientPrior(coupling, missing) for coupling in (0.0, 0.3, 0.6, 0.9) for missing in (0.1, 0.3, 1.0, 3.0)
)
"""Priors that are tried: forces at any arm to forces at a known arm, missing terms small or large. Where few
are missing, terms as uncertain as those printed make the scatter of these look smaller than it is."""
NEGLIGIBLE = 20.0
"""Log weight by which a part of the mean over priors and levels may lie behind the likeliest to count in it: all that
do not weigh less than a millionth."""


def with_likely_coefficient_prior(data_set: WhitenedDataSet, fitted: FittedHypothesis) -> WhitenedDataSet:
    """The same runs with the prior of coefficients that a fitted hypothesis makes most likely.

    Args:
        data_set: The runs.
        fitted: At its values and noise levels; latencies and its own numbers are free.

    Returns:
        The runs with one of :data:`COEFFICIENT_PRIORS`, process noise next to its own best level summed out.
    """
    around = fitted.best[0]
    while True:
        levels = data_set.levels.beside(around)
        found = _ByPrior(data_set, fitted.hypothesis, levels)
        each = {kind: found.by_level(kind) for kind in COEFFICIENT_PRIORS}
        # Where terms may be missing that the noise stood for, less noise is likelier, and with that other priors: to
        # the likeliest level of any prior, which rises with every step.
        before, around = around, levels[int(np.max([e.max(axis=1) for e in each.values()], axis=0).argmax())]
        if around == before:
            likeliest = max(each, key=lambda kind: float(logsumexp(each[kind])))
            prior = likeliest._replace(usual=data_set.coefficient_prior.usual)
            return WhitenedDataSet(data_set.dynamics, data_set.whole, prior)


def gain_by_coefficient_priors(
    data_set: WhitenedDataSet,
    fitted: FittedHypothesis,
    levels: Sequence[int] = (),
    process_prior: float | None = PROCESS_PRIOR,
) -> float:
    """What a fitted hypothesis gains where any prior of coefficients is as likely as the one that the runs have.

    ``log mean_p exp(E_p - E)``, E_p its log evidence with each of :data:`COEFFICIENT_PRIORS`, E with that of the runs:
    chosen for one hypothesis, as for calm water, a prior is in its favour.

    Args:
        data_set: The runs.
        fitted: At its values and noise levels; latencies and its own numbers are free.
        levels: Of the process noise, which is summed out over them; without any those next to its best one.
        process_prior: Of the noise; None: every level is as likely (:func:`.log_prior_levels`).

    Returns:
        The gain in log evidence, at least minus the logarithm of their number where the runs have one of them.
    """
    near = levels or data_set.levels.beside(fitted.best[0])
    found = _ByPrior(data_set, fitted.hypothesis, near, process_prior)
    each = [found.evidence(kind) for kind in COEFFICIENT_PRIORS]
    return float(logsumexp(each) - np.log(len(each)) - found.evidence(data_set.coefficient_prior))


def over_coefficient_priors(data_set: WhitenedDataSet, fitted: FittedHypothesis, about: Hypothesis) -> FittedHypothesis:
    """A fitted hypothesis with values and covariance averaged over priors of coefficients.

    Whether forces act at their published arms is hardly seen in few runs, but decides how well a force that
    coefficients may imitate is known.

    Args:
        data_set: The runs.
        fitted: What was found there with the prior that they have.
        about: The hypothesis at the values that it was fitted from.

    Returns:
        Another log evidence, that with any prior; other values, covariance, corrections and latencies.
    """
    usual = weighty(fitted.by_level + log_prior_levels(data_set, PROCESS_PRIOR))
    by_prior = _ByPrior(data_set, about, sorted({level for level, _ in usual}))
    each = [(by_prior.root(kind), found) for kind in COEFFICIENT_PRIORS for found in by_prior.posteriors(kind)]
    of_levels = np.tile(by_prior.of_levels, (len(COEFFICIENT_PRIORS), 1))
    weights = np.array([found.evidence for _, found in each]) + of_levels
    at = np.nonzero(weights > weights.max() - NEGLIGIBLE)
    parts = [(*each[k], s) for k, s in zip(*at, strict=True)]
    means = np.array([root @ found.mean(s) for root, found, s in parts])
    covariances = [root @ found.covariance(s) @ root.T for root, found, s in parts]
    mean, covariance = mixture(softmax(weights[at]), means, covariances)
    k, last = len(by_prior.names), len(by_prior.names) + len(data_set.runs)
    change = mean[last:] + to_prior_means(about)
    return replace(
        fitted,
        hypothesis=about.within_bounds(about.vector() + change) if len(change) else about,
        evidence=float(logsumexp(weights) - np.log(len(COEFFICIENT_PRIORS))),
        covariance=covariance[last:, last:],
        corrections=mean[:k],
        latencies=mean[k:last],
    )


class _ByPrior:
    """What runs say of every coefficient, latencies and a hypothesis' numbers by the prior of the coefficients.

    Attributes:
        names: Of the corrections of coefficients.
        of_levels: Log prior of the coefficients' standard deviation at every level of the process noise asked for.
    """

    def __init__(
        self,
        data_set: WhitenedDataSet,
        hypothesis: Hypothesis,
        levels: Sequence[int],
        process_prior: float | None = PROCESS_PRIOR,
    ) -> None:
        """Take the runs, a hypothesis at its values, and levels of the process noise."""
        self.names = Corrections(data_set.dynamics).names
        lin = hypothesis_columns(data_set, hypothesis)
        k, count = len(self.names), len(data_set.runs)
        size = 1 + k + count
        index = [np.r_[: 1 + k, 1 + k + run, size + at] for run, at in enumerate(lin.index)]
        lin = replace(lin, turned=changed_base(data_set, hypothesis, combined=False))

        def gram_at(level: int) -> Float[np.ndarray, "p p"]:
            made = []
            for run, more in enumerate(data_set.embedded(level, lin.columns)):
                base, own = data_set.whole_at(level)[run]
                cross = base.dot(more)
                products = np.block([[own, cross], [cross.T, more.dot(more)]])
                made.append(lin.turn(run, products, gram=True))
            return summed(made, index, size + lin.count)

        # The data less what the hypothesis adds at its values; unknowns: coefficients, latencies, the hypothesis' own,
        # as deviations from their prior means.
        keep = [0, size, *range(1, size), *range(size + 1, size + lin.count)]
        durations = [float(np.ptp(p.linearised.run.time)) for p in data_set.runs]
        data = np.r_[1.0, -1.0, np.zeros(size - 1), -to_prior_means(hypothesis)]
        self._prior = np.r_[np.ones(k), np.full(count, LATENCY_SD), hypothesis.prior_sds(durations)]
        self._at = [
            reduced(gram_at(level)[np.ix_(keep, keep)], data_set.at(level).norm, self._prior, data, k)
            for level in levels
        ]
        self.of_levels = log_prior_levels(data_set, process_prior)[list(levels)]

    def root(self, kind: CoefficientPrior) -> Float[np.ndarray, "m m"]:
        """All unknowns from what is independent before the runs are seen."""
        root, k = np.eye(len(self._prior)), len(self.names)
        root[:k, :k] = kind.root(self.names)
        return root

    def posteriors(self, kind: CoefficientPrior) -> list[Posterior]:
        """With one prior, at every level; of deviations that are independent before the runs are seen."""
        root = kind.root(self.names)
        return [one.by(root).posterior(COEFFICIENT_SD_LEVELS) for one in self._at]

    def evidence(self, kind: CoefficientPrior) -> float:
        """Log evidence but for a constant, process noise and the coefficients' standard deviation summed out."""
        return float(logsumexp(self.by_level(kind)))

    def by_level(self, kind: CoefficientPrior) -> Float[np.ndarray, "g s"]:
        """Log evidence, but for the same constant, at every level of both."""
        return np.array([found.evidence for found in self.posteriors(kind)]) + self.of_levels
