"""Linearising again: about the states that a fitted hypothesis itself makes most likely."""

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.dynamics.base import is_fitted
from manoeuvre_nn.estimation.data_set import COEFFICIENT_SD_LEVELS, WhitenedDataSet
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis, Hypothesis
from manoeuvre_nn.estimation.hypothesis_columns import hypothesis_columns
from manoeuvre_nn.estimation.linear_run import joined
from manoeuvre_nn.estimation.marginal_likelihood import MarginalLikelihood
from manoeuvre_nn.estimation.prepared_run import about_states
from manoeuvre_nn.estimation.rudder_blades import behind_record
from manoeuvre_nn.estimation.smoothed_run import step_share
from manoeuvre_nn.numerics.finite_algebra import lstsq

MAX_PASSES, MAX_FAR_PASSES = 3, 8
"""Linearisations of one hypothesis at most: as a rule, and as long as states are far from rest."""
FAR_FROM_REST = 3.0
"""Change of a state over its standard error from which linear equations about it say little of the next one."""
STATES_AT_REST = 0.2
"""Root mean square change of a state over its standard error, from which linearising again would change little."""
MAX_CORRECTION = 10 * COEFFICIENT_SD_LEVELS[-1]
"""Size of a correction from which the equations are those of no ship: ten standard deviations at the widest prior."""


def refined(data_set: WhitenedDataSet, fitted: FittedHypothesis, corrected: bool = True) -> WhitenedDataSet:
    """The runs about the states and the corrected coefficients of a fitted hypothesis.

    The first states were found with any force, stream and sensor error allowed; what these mistook for one another is
    only corrected to first order there. The transitions are those of the ship with the hypothesis' effects aboard
    (:func:`.with_feedback`).

    Args:
        data_set: The runs about other states.
        fitted: What was found.
        corrected: Whether about its corrected coefficients, too.

    Returns:
        The runs about the new states; as they are where the coefficients would be those of another ship, or the states
        those of a ship that lies still, by which a hypothesis that is far off tries to explain what it cannot.
    """
    lin = hypothesis_columns(data_set, fitted.hypothesis)
    level = data_set.at(fitted.best[0])
    # A fitted model's corrections within its errors take up gusts: it stays as it is.
    trained = is_fitted(data_set.dynamics)
    # In the combinations that these runs show: the hypothesis may have been fitted by others.
    combined = lstsq(data_set.rotation, fitted.corrections)
    shares = data_set.rotation @ combined if corrected and not trained else None
    if shares is not None and np.abs(shares).max(initial=0.0) > MAX_CORRECTION:
        shares = None
    runs, rudders = [], _rudders(data_set, fitted.hypothesis)
    for run, prepared in enumerate(data_set.runs):
        # Data less coefficients, latency and the hypothesis at their values.
        base = lin.of_base(run, np.r_[1.0, -combined, -fitted.latencies[run]])
        whole = np.append(1.0, np.zeros(lin.columns[run].count - 1))
        left = joined([prepared.base, lin.columns[run]]).combined(np.r_[base, -whole])
        white = level.white[run]
        step, track = white.states(white.embed(left))[..., 0], prepared.linearised.track
        states = track + step_share(track, step) * step[:, : track.shape[1]]
        receiver = lin.columns[run].measured[:, :4, 0]
        acting = fitted.hypothesis.effects, [v[run] for v in fitted.hypothesis.values]
        moved = about_states(data_set.dynamics, prepared, states, shares, rudders[run], receiver, acting)
        if not moved.linearised.sails:
            moved = data_set.whole[run]
        runs.append(moved)
    return WhitenedDataSet(data_set.dynamics, runs, data_set.coefficient_prior)


def beside(likelihood: MarginalLikelihood, hypothesis: Hypothesis) -> MarginalLikelihood:
    """Where a hypothesis is fitted: corrections of rudder forces act when it has the rudder there.

    Args:
        likelihood: The runs, corrections acting at some rudder angles.
        hypothesis: With or without a late record of the rudder, at its values.

    Returns:
        The same runs, corrections acting at the rudder angles of the hypothesis.
    """
    data_set = likelihood.data_set
    there = data_set.with_rudders(_rudders(data_set, hypothesis))
    return likelihood if there is data_set else MarginalLikelihood(there)


def _rudders(data_set: WhitenedDataSet, hypothesis: Hypothesis) -> list[Float[np.ndarray, " n"]]:
    """What the rudder indicator showed in every run by a hypothesis [rad]."""
    return [
        behind_record(p.linearised, hypothesis.effects, [v[run] for v in hypothesis.values]).indicated
        for run, p in enumerate(data_set.runs)
    ]


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
