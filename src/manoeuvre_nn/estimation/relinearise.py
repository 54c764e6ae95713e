"""Linearising again: about the states that a fitted hypothesis itself makes most likely."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float
from scipy.special import logsumexp

from manoeuvre_nn.dynamics.base import is_fitted
from manoeuvre_nn.estimation.changed_coefficients import changed_base
from manoeuvre_nn.estimation.corrections import CoefficientPrior, Corrections
from manoeuvre_nn.estimation.data_set import COEFFICIENT_SD_LEVELS, WhitenedDataSet
from manoeuvre_nn.estimation.effect_columns import behind_record
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis, Hypothesis
from manoeuvre_nn.estimation.hypothesis_columns import hypothesis_columns
from manoeuvre_nn.estimation.linear_run import joined, summed
from manoeuvre_nn.estimation.linearised_run import LinearisedRun
from manoeuvre_nn.estimation.marginal_likelihood import PROCESS_PRIOR, MarginalLikelihood, log_prior_levels
from manoeuvre_nn.estimation.posterior import posterior
from manoeuvre_nn.estimation.prepared_run import LATENCY_SD, PreparedRun, about_states, base_columns
from manoeuvre_nn.estimation.smoothed_run import step_share
from manoeuvre_nn.numerics.finite_algebra import lstsq

MAX_PASSES = 3
"""Linearisations of one hypothesis at most."""
STATES_AT_REST = 0.2
"""Root mean square change of a state over its standard error, from which linearising again would change little."""
MAX_CORRECTION = 10 * COEFFICIENT_SD_LEVELS[-1]
"""Size of a correction from which the equations are those of no ship: ten standard deviations at the widest prior."""
COEFFICIENT_PRIORS = tuple(
    CoefficientPrior(coupling, missing) for coupling in (0.0, 0.3, 0.6, 0.9) for missing in (0.3, 1.0, 3.0)
)
"""Priors that are tried: forces at any arm to forces at a known arm, missing terms small or large. Where few
are missing, terms as uncertain as those printed make the scatter of these look smaller than it is."""


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
        if not _sails(moved.linearised, data_set.dynamics.particulars.speed):
            moved = replace(prepared, base=base_columns(data_set.dynamics, prepared.linearised))
        runs.append(moved)
    return WhitenedDataSet(data_set.dynamics, runs, data_set.coefficient_prior)


def _sails(linearised: LinearisedRun, speed: float) -> bool:
    """Whether steps of the model are finite, and a radian of rudder changes no velocity by the ship's speed in one."""
    whole = np.isfinite(linearised.transition).all() and np.isfinite(linearised.rudder_push).all()
    return bool(whole and np.abs(linearised.rudder_push[:, :2]).max(initial=0.0) < speed)


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
