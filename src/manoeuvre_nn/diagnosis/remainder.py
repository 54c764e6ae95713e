"""A force without a name, learned: for what no effect of the shelf explains, or what a named one leaves."""

import numpy as np

from manoeuvre_nn.diagnosis.search import Progress
from manoeuvre_nn.effect.remainder import Remainder
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis, Hypothesis
from manoeuvre_nn.estimation.marginal_likelihood import MarginalLikelihood

FLOOR = 0.01
"""Coloured force, over the resistance and 20 deg of rudder, that a good model may leave."""
ROUNDS = 12
"""Gauss-Newton steps."""


def is_left(likelihood: MarginalLikelihood, fitted: FittedHypothesis) -> bool:
    """Whether physics alone does not reach the noise floor: runs still ask for process noise above ``FLOOR``."""
    return bool(likelihood.data_set.levels[fitted.best[0]].max() > FLOOR)


def with_remainder(
    likelihood: MarginalLikelihood, fitted: FittedHypothesis, progress: Progress = lambda _: None
) -> FittedHypothesis:
    """Train a network on what a hypothesis leaves of all runs together.

    Its weights are fitted as the parameters of any effect are, by Gauss-Newton steps on the likelihood of the raw
    recordings with initial states, noise of the channels, coefficients and process noise integrated out: what a step of
    the weights does is rolled out through the whole run. Pointwise targets would have the noise of differences.

    Returns:
        The hypothesis with the network on top.
    """
    progress("remainder")
    effect = Remainder(likelihood.data_set.dynamics.hull)
    start = effect.values.numpy()
    mine = Hypothesis((effect,), (np.tile(start, (len(likelihood.data_set.runs), 1)),))
    both = fitted.hypothesis.joined(mine) if fitted.names else mine
    # At the levels that the rest needed process noise and coefficients would explain what the network is to learn.
    low = likelihood.data_set.levels.quiet(fitted.best[0])
    trained, _ = likelihood.improve(both, low, min(fitted.best[1], 1), rounds=ROUNDS)
    return likelihood.evaluate(trained, around=low)
