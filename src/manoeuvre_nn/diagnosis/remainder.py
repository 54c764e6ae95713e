"""A force without a name, learned: for what no effect of the shelf explains, or what a named one leaves."""

import numpy as np

from manoeuvre_nn.diagnosis.bench import quiet
from manoeuvre_nn.diagnosis.court import Court
from manoeuvre_nn.diagnosis.hypothesis import Hypothesis, Judged
from manoeuvre_nn.diagnosis.search import Progress
from manoeuvre_nn.effect.remainder import Remainder

FLOOR = 0.01
"""Coloured force, over the resistance and 20 deg of rudder, that a good model may leave."""
ROUNDS = 12
"""Gauss-Newton steps."""


def is_left(court: Court, judged: Judged) -> bool:
    """Whether physics alone does not reach the noise floor.

    Args:
        court: Where it was judged.
        judged: What was found.

    Returns:
        Whether the runs still ask for a coloured force of more than ``FLOOR``.
    """
    return bool(court.bench.levels[judged.best[0]].max() > FLOOR)


def with_remainder(court: Court, judged: Judged, progress: Progress = lambda _: None) -> Judged:
    """Train a network on what a hypothesis leaves of all runs together.

    Its weights are fitted as the parameters of any effect are, by Gauss-Newton steps on the likelihood of the raw
    recordings with initial states, noise, coefficients and a coloured force integrated out: what a step of the weights
    does is rolled out through the whole run. Pointwise targets would carry the noise of differenced channels.

    Args:
        court: The runs.
        judged: What was found so far; calm water if nothing was.
        progress: Is told that it runs.

    Returns:
        The hypothesis with the network on top.
    """
    progress("remainder")
    effect = Remainder(court.bench.dynamics.hull)
    start = effect.values.numpy()
    mine = Hypothesis((effect,), (np.tile(start, (len(court.bench.places), 1)),))
    both = judged.hypothesis.joined(mine) if judged.names else mine
    # At the levels that the rest needed coloured force and coefficients would explain what the network is to learn.
    low = quiet(judged.best[0])
    trained, _ = court.improve(both, low, min(judged.best[1], 1), rounds=ROUNDS)
    return court.judge(trained, around=low)
