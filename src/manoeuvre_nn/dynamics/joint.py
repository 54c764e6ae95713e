"""States and coefficients together: the motion and the model that most likely gave a set of recordings.

Fits to accelerations differentiate what was measured, and noise ruins them first. Simulations from a first state carry
every error to the end, and a ship that is unstable on a straight course makes them useless. In between lies multiple
shooting, taken here to its end: the states at *all* samples are unknowns, tied from sample to sample by the equations
of motion and a small coloured acceleration that the model may lack, and to the recordings by each channel's noise.
States, coefficients and sensors' errors are then one nonlinear least-squares problem. Gauss-Newton solves it; the
states are a chain, so that a step costs one banded factor a run (:mod:`.banded`) however many samples there are, the
coefficients keep their exact Laplace covariance, and noise levels follow by expectation and maximisation. Without
coefficients the same lines are a smoother for all channels at once.

No library does this: smoothers (filterpy, pykalman) know no coefficients, and optimizers (casadi, gekko) no structure
of a chain and no covariance.

All is in units of L and the speed of the run's approach.

Source:
    Bock 1981 (multiple shooting); Bell 1994 (SIAM J. Optim. 4:626) for the smoother as Gauss-Newton; Tremolet 2006
    (Q. J. R. Meteorol. Soc. 132:2483), "weak constraint"; Dempster, Laird & Rubin 1977 for the noise; Lange, Little &
    Taylor 1989 for the weights of outliers.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float
from scipy.signal import savgol_filter

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.dynamics.joint_agreement import agreed_floor
from manoeuvre_nn.dynamics.joint_problem import CHANNELS, FREEDOM, MOTION, Estimate, Problem, Track
from manoeuvre_nn.dynamics.joint_run import Line

SETTLE, SUNK = 3, 0.05
"""Steps between two looks at the floor of the noise, and change of it over itself that is none."""


RIGHT = (1e-3, 1.5e-3, 3e-3)
"""Size of the coloured accelerations up to which a model may be right: larger ones take up what stretches disagree on,
and agreement says nothing."""
SMALL = 3e-3
"""Size of the coloured accelerations below which its changes are measured by this, not by itself."""
LEAST, LEAP = 1e-4, 3.0
"""Least size of the coloured accelerations, which moves no ship; the factor that it changes by at most in a pass."""


def first(problem: Problem, noise: float = 0.01, force: Sequence[float] = (3e-4, 5e-4, 1e-3)) -> Estimate:
    """Where the iteration starts: every channel smoothed for itself, coefficients as before any run was seen.

    Args:
        problem: The problem.
        noise: First standard deviation of all channels.
        force: Standard deviation of the coloured accelerations.

    Returns:
        The start.
    """
    mean, spread = problem.prior
    size = MOTION + problem.colour.size
    return Estimate(
        tuple(_smoothed(t, size) for t in problem.tracks), mean.copy(), np.full(6, noise), np.array(force, dtype=float),
        tuple(t.present for t in problem.tracks), tuple(np.ones((len(t) - 1, 3)) for t in problem.tracks),
        np.diag(spread**2), np.array(problem.floor, dtype=float),
    )  # fmt: skip


def _smoothed(track: Track, size: int) -> Float[np.ndarray, "n s"]:
    """Gaps filled by lines, then local cubics over half a length."""
    states = np.zeros((len(track), size))
    values = track.measured if track.guess is None else np.where(track.present > 0, track.measured, track.guess)
    step = float(np.median(np.diff(track.time)))
    window = min(max(2 * round(0.25 / step) + 1, 5), (len(track) - 1) // 2 * 2 + 1)
    for k, name in enumerate(CHANNELS):
        there = np.isfinite(values[:, k])
        if there.sum() < 2:
            raise InputError(f"recording {track.name}: channel {name} holds fewer than 2 samples; give one that has it")
        filled = np.interp(track.time, track.time[there], values[there, k])
        states[:, k] = savgol_filter(filled, window, min(3, window - 1))
    return states


def improve(problem: Problem, now: Estimate) -> Estimate:
    """One Gauss-Newton step of everything, then noise levels and weights from what is left.

    Args:
        problem: The problem.
        now: Where it stands.

    Returns:
        A better estimate.
    """
    mean, spread = problem.prior
    lines = [Line(problem, now, k) for k in range(len(problem.tracks))]
    normal, gradient = np.diag(1 / spread**2), (now.values - mean) / spread**2
    for line in lines:
        normal[np.ix_(line.places, line.places)] += line.normal
        gradient[line.places] += line.gradient
    covariance = _inverse(normal, spread)
    step = -covariance @ gradient
    cost = 0.5 * float((((now.values - mean) / spread) ** 2).sum()) + sum(line.cost for line in lines)
    evidence = -cost + sum(line.log_norm for line in lines)
    evidence += 0.5 * float(np.linalg.slogdet(covariance)[1]) - float(np.log(spread).sum())
    states = tuple(line.moved(step[line.places]) for line in lines)
    spreads = tuple(line.state_covariance(covariance) for line in lines)
    new = replace(
        now, states=states, values=now.values + step, covariance=covariance, state_covariance=spreads, cost=cost,
        evidence=evidence, moved=float(np.abs(step / spread).max(initial=0.0)), passes=now.passes + 1,
    )  # fmt: skip
    new = _with_noise(problem, new, lines)
    return replace(new, floor=agreed_floor(problem, new)) if _due(problem, new) else new


def _due(problem: Problem, now: Estimate) -> bool:
    """Whether the floor is to be looked at: not before everything else has followed the last change."""
    return _sinks(problem, now) and now.passes % SETTLE == 0


def _sinks(problem: Problem, now: Estimate) -> bool:
    """Whether the floor may sink: not under a model that lacks accelerations."""
    return problem.learn_floor and bool((now.force <= RIGHT).all())


def at_rest(problem: Problem, before: Estimate, now: Estimate, enough: float = 1e-3) -> bool:
    """Whether parameters, noise and floor rest.

    Args:
        problem: The problem.
        before: The estimate before the last step.
        now: That after it.
        enough: Largest step of a parameter over its prior standard deviation, and largest change of a noise level or a
            size over itself times ten.

    Returns:
        True if another step would change little.
    """
    sizes = (now.force - before.force) / np.maximum(before.force, SMALL)
    levels = np.concatenate([now.noise / before.noise - 1, sizes])
    looked = not _sinks(problem, now) or (_due(problem, now) and np.abs(now.floor / before.floor - 1).max() < SUNK)
    return bool(looked and now.moved < enough and np.abs(levels).max() < 10 * enough)


def solve(problem: Problem, start: Estimate | None = None, *, passes: int = 15, enough: float = 1e-3) -> Estimate:
    """Improve until parameters and noise rest.

    Args:
        problem: The problem.
        start: Where to start; by default :func:`first`.
        passes: Steps at most.
        enough: See :func:`at_rest`.

    Returns:
        The estimate.
    """
    now = start or first(problem)
    for _ in range(passes):
        before, now = now, improve(problem, now)
        if at_rest(problem, before, now, enough):
            break
    return now


def _inverse(normal: Float[np.ndarray, "q q"], spread: Float[np.ndarray, " q"]) -> Float[np.ndarray, "q q"]:
    """Inverse of the parameters' normal equations, scaled by the prior: what rounding took below the prior is it."""
    if not len(spread):
        return np.zeros((0, 0))
    if not np.isfinite(normal).all():
        raise np.linalg.LinAlgError("the columns of the coefficients are not finite")
    scaled = normal * spread[:, None] * spread
    values, vectors = np.linalg.eigh(0.5 * (scaled + scaled.T))
    inverse = (vectors / np.maximum(values, 1.0)) @ vectors.T
    return inverse * spread[:, None] * spread


def _with_noise(problem: Problem, new: Estimate, lines: Sequence[Line]) -> Estimate:
    """Noise levels that explain what is left of the channels; weights by Student's t."""
    total, count, weights = np.zeros(6), np.zeros(6), []
    for k, line in enumerate(lines):
        track, state = problem.tracks[k], new.states[k]
        shown = state[:, :MOTION] + line.marks @ new.values[problem.own(k)]
        variance = new.state_covariance[k][:, range(MOTION), range(MOTION)]
        square = np.where(track.present > 0, (shown - np.nan_to_num(track.measured)) ** 2 + variance, 0.0)
        weights.append(track.present * _weight(square, new.noise))
        total += (weights[-1] * square).sum(0)
        count += track.present.sum(0)
    noise = np.maximum(np.sqrt(total / np.maximum(count, 1.0)), new.floor)
    new = replace(new, noise=noise, weights=tuple(weights))
    return _with_force(problem, new, lines) if problem.learn_force else new


def _with_force(problem: Problem, new: Estimate, lines: Sequence[Line]) -> Estimate:
    """Size of the coloured accelerations and weights of its gusts.

    The size is where expectation and maximisation rest, ``n size^2 = sum (mean^2 + variance)``, but solved for what the
    means say, ``(n - sum variance / size^2) size^2 = sum mean^2`` (MacKay 1992): where recordings say little of it the
    other creeps for hundreds of passes.

    Args:
        problem: The problem.
        new: Where it stands.
        lines: The runs' equations about the last states.

    Returns:
        The estimate with both.
    """
    mean, known, calm = np.zeros(3), np.full(3, 1e-9), []
    for k, (line, state) in enumerate(zip(lines, new.states, strict=True)):
        swell = problem.swell(k)
        square, variance = (
            part.reshape(len(part), -1, 3).sum(1) / swell
            for part in (line.fresh(state) ** 2, line.innovation_variance(new.covariance))
        )
        order = problem.colour.order
        calm.append(_weight(square + variance, new.force, order))
        mean += (calm[-1] * square).sum(0)
        known += np.maximum(order - calm[-1] * variance / new.force**2, 0.0).sum(0)
    force = new.force * np.clip(np.sqrt(mean / known) / new.force, 1 / LEAP, LEAP)
    most = np.inf if problem.most is None else problem.most
    return replace(new, force=np.clip(force, LEAST, most), calm=tuple(calm))


def _weight(
    square: Float[np.ndarray, "n k"], scale: Float[np.ndarray, " k"], size: int = 1
) -> Float[np.ndarray, "n k"]:
    """Weight of samples whose expected square is given, under Student's t of a scale in so many dimensions."""
    return (FREEDOM + size) / (FREEDOM + square / scale**2)
