"""Linearising again: about the states that a fitted hypothesis itself makes most likely."""

import numpy as np

from manoeuvre_nn.estimation.data_set import WhitenedDataSet, about_states
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis
from manoeuvre_nn.estimation.linear_run import joined
from manoeuvre_nn.estimation.marginal_likelihood import hypothesis_columns

MAX_PASSES = 3
"""Linearisations of one hypothesis at most."""
STATES_AT_REST = 0.2
"""Root mean square change of a state over its standard error, from which linearising again would change little."""


def refined(data_set: WhitenedDataSet, fitted: FittedHypothesis) -> WhitenedDataSet:
    """The runs about the states of a fitted hypothesis.

    The first states were found with any force, stream and sensor error allowed; what these mistook for one another is
    only corrected to first order there.

    Args:
        data_set: The runs about other states.
        fitted: What was found.

    Returns:
        The runs about the new states.
    """
    lin = hypothesis_columns(data_set, fitted.hypothesis)
    level = data_set.at(fitted.best[0])
    runs = []
    for run, prepared in enumerate(data_set.runs):
        # Data less coefficients, latency and the hypothesis at their values.
        nuisance = fitted.nuisance[data_set.base_index(run)[1:] - 1]
        whole = np.append(1.0, np.zeros(lin.columns[run].count - 1))
        left = joined([prepared.base, lin.columns[run]]).combined(np.concatenate([[1.0], -nuisance, -whole]))
        white = level.white[run]
        states = prepared.linearised.track + white.states(white.embed(left))[:, : prepared.linearised.states.count, 0]
        runs.append(about_states(data_set.dynamics, prepared, states))
    return WhitenedDataSet(data_set.dynamics, runs)


def change_of_states(before: WhitenedDataSet, after: WhitenedDataSet, level: int) -> float:
    """How far the states that runs are linearised about have moved.

    Args:
        before: The runs.
        after: The same runs.
        level: Level of the process noise.

    Returns:
        Root mean square change over the standard error, of the state that moved most.
    """
    changes = []
    for run, (old, new) in enumerate(zip(before.runs, after.runs, strict=True)):
        variance = before.at(level).white[run].covariances[0]
        variance = np.diagonal(variance, axis1=1, axis2=2)[:, : old.linearised.states.count]
        moved = (new.linearised.track - old.linearised.track) ** 2 / variance
        changes.append(np.sqrt(moved.mean(0)).max())
    return float(max(changes))
