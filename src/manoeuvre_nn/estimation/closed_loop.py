"""States and coefficients together: the motion and the model that most likely gave a set of recordings.

Fits to accelerations differentiate what was measured, and noise ruins them first. Simulations from a first state carry
every error to the end, and a ship that is unstable on a straight course makes them useless. In between lies multiple
shooting, taken here to its end: the states at *all* samples are unknowns, tied from sample to sample by the equations
of motion and process noise, and to the recordings by each channel's noise. States, coefficients and sensors' errors are
then one nonlinear least-squares problem. Gauss-Newton solves it: each pass linearises every run, integrates its states
out (:mod:`.linear_run`), and takes the posterior of the unknowns (:mod:`.posterior`). Noise levels follow by
expectation and maximisation (:mod:`.measurement_noise`). Without coefficients the same lines are a smoother for all
channels at once.

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
from manoeuvre_nn.core.memory import check_memory
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.estimation.agreement import agreed_floor
from manoeuvre_nn.estimation.collocation import CollocatedRun
from manoeuvre_nn.estimation.linear_run import summed
from manoeuvre_nn.estimation.measurement_noise import measured_noise, student_weight
from manoeuvre_nn.estimation.posterior import posterior
from manoeuvre_nn.estimation.problem import CHANNELS, MOTION, Estimate, EstimationProblem

PASSES_BETWEEN_FLOORS, FLOOR_AT_REST = 3, 0.05
"""Passes between two looks at the floor of the noise, and change of it over itself that is none."""
MAX_PROCESS_OF_RIGHT_MODEL = (1e-3, 1.5e-3, 3e-3)
"""Size of the process noise up to which a model may be right: larger ones take up what stretches disagree on, and
agreement says nothing."""
PROCESS_SD_RESOLUTION = 3e-3
"""Size of the process noise below which its changes are measured by this, not by itself."""
MIN_PROCESS_SD, MAX_PROCESS_FACTOR = 1e-4, 3.0
"""Least size of the process noise, which moves no ship; the factor that it changes by at most in a pass."""

COPIES = 12.0
"""Tables of samples times states times unknowns that a pass holds at once, as measured."""
FEWER = "write fewer files into data.files=, a shorter data.length=, or start: and end: into the mapping"
"""What to do with recordings that are too long together."""


def first(
    problem: EstimationProblem, noise: float = 0.01, process_sd: Sequence[float] = (3e-4, 5e-4, 1e-3)
) -> Estimate:
    """Where the iteration starts: every channel smoothed for itself, coefficients as before any run was seen.

    Args:
        problem: The problem.
        noise: First standard deviation of all channels.
        process_sd: Standard deviation of the process noise.

    Returns:
        The start.
    """
    mean, spread = problem.prior
    size = MOTION + problem.process.size
    samples = sum(map(len, problem.recordings))
    check_memory(f"{samples} samples to be fitted", COPIES * 8 * samples * size * (1 + len(mean)), FEWER)
    states = (_smoothed(r, m, size) for r, m in zip(problem.recordings, problem.measured, strict=True))
    return Estimate(
        tuple(states), mean.copy(), np.full(6, noise), np.array(process_sd, dtype=float), problem.present,
        tuple(np.ones((len(r) - 1, 3)) for r in problem.recordings), np.diag(spread**2),
        np.array(problem.floor, dtype=float),
    )  # fmt: skip


def _smoothed(recording: Recording, measured: Float[np.ndarray, "n 6"], size: int) -> Float[np.ndarray, "n s"]:
    """Gaps filled by lines, then local cubics over half a length."""
    states = np.zeros((len(recording), size))
    derived = recording.derived
    step = float(np.median(np.diff(recording.time)))
    window = min(max(2 * round(0.25 / step) + 1, 5), (len(recording) - 1) // 2 * 2 + 1)
    for k, name in enumerate(CHANNELS):
        values = recording[name] if name in derived else measured[:, k]
        there = np.isfinite(values)
        if there.sum() < 2:
            raise InputError(
                f"recording {recording.name}: channel {name} holds fewer than 2 samples; give one that has it"
            )
        filled = np.interp(recording.time, recording.time[there], values[there])
        states[:, k] = savgol_filter(filled, window, min(3, window - 1))
    return states


def improve(problem: EstimationProblem, now: Estimate) -> Estimate:
    """One Gauss-Newton step of everything, then noise levels and weights from what is left."""
    mean, spread = problem.prior
    runs = [CollocatedRun(problem, now, k) for k in range(len(problem.recordings))]
    gram = summed([r.gram for r in runs], [np.append(0, 1 + r.places) for r in runs], 1 + len(mean))
    # Unknowns are deviations from the prior means; the data's column stands at the present values.
    data = np.append(1.0, now.values - mean)
    found = posterior(gram, sum(r.solved.log_norm for r in runs), spread, data)
    covariance = found.covariance()
    step = mean + found.mean() - now.values
    cost = 0.5 * float((((now.values - mean) / spread) ** 2).sum()) + sum(r.cost for r in runs)
    new = replace(
        now, states=tuple(r.moved(step[r.places]) for r in runs), values=now.values + step,
        covariance=covariance, state_covariance=tuple(r.state_covariance(covariance) for r in runs),
        cost=cost, evidence=float(found.evidence[0]), moved=float(np.abs(step / spread).max(initial=0.0)),
        passes=now.passes + 1,
    )  # fmt: skip
    new = _with_noise(problem, new, runs)
    return replace(new, floor=agreed_floor(problem, new)) if _due(problem, new) else new


def _due(problem: EstimationProblem, now: Estimate) -> bool:
    """Whether the floor is to be looked at: not before everything else has followed the last change."""
    return _sinks(problem, now) and now.passes % PASSES_BETWEEN_FLOORS == 0


def _sinks(problem: EstimationProblem, now: Estimate) -> bool:
    """Whether the floor may sink: not under a model that needs process noise."""
    return problem.learn_floor and bool((now.process_sd <= MAX_PROCESS_OF_RIGHT_MODEL).all())


def at_rest(problem: EstimationProblem, before: Estimate, now: Estimate, enough: float = 1e-3) -> bool:
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
    sizes = (now.process_sd - before.process_sd) / np.maximum(before.process_sd, PROCESS_SD_RESOLUTION)
    levels = np.concatenate([now.noise / before.noise - 1, sizes])
    looked = not _sinks(problem, now) or (
        _due(problem, now) and np.abs(now.floor / before.floor - 1).max() < FLOOR_AT_REST
    )
    return bool(looked and now.moved < enough and np.abs(levels).max() < 10 * enough)


def solve(
    problem: EstimationProblem, start: Estimate | None = None, *, passes: int = 15, enough: float = 1e-3
) -> Estimate:
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


def _with_noise(problem: EstimationProblem, new: Estimate, runs: Sequence[CollocatedRun]) -> Estimate:
    """Noise levels that explain what is left of the channels; weights by Student's t."""
    square = []
    for k, run in enumerate(runs):
        shown = new.states[k][:, :MOTION] + run.marks @ new.values[problem.own(k)]
        variance = new.state_covariance[k][:, range(MOTION), range(MOTION)]
        square.append((shown - problem.measured[k]) ** 2 + variance)
    noise, weights = measured_noise(
        np.concatenate(square), np.concatenate(problem.present), new.noise, new.floor, "student"
    )
    by_run = np.split(weights, np.cumsum([len(s) for s in square])[:-1])
    new = replace(new, noise=noise, sample_weights=tuple(by_run))
    return _with_process(problem, new, runs) if problem.learn_process else new


def _with_process(problem: EstimationProblem, new: Estimate, runs: Sequence[CollocatedRun]) -> Estimate:
    """Size of the process noise and weights of its gusts.

    The size is where expectation and maximisation rest, ``n size^2 = sum (mean^2 + variance)``, but solved for what the
    means say, ``(n - sum variance / size^2) size^2 = sum mean^2`` (MacKay 1992): where recordings say little of it the
    other creeps for hundreds of passes.

    Args:
        problem: The problem.
        new: Where it stands.
        runs: The runs' equations about the last states.

    Returns:
        The estimate with both.
    """
    mean, known, weights = np.zeros(3), np.full(3, 1e-9), []
    order = problem.process.order
    for k, (run, state) in enumerate(zip(runs, new.states, strict=True)):
        usual = problem.process_variance(k)
        square, variance = (
            part.reshape(len(part), -1, 3).sum(1) / usual
            for part in (run.innovations(state) ** 2, run.innovation_variance(new.covariance))
        )
        weights.append(student_weight(square + variance, new.process_sd, order))
        mean += (weights[-1] * square).sum(0)
        known += np.maximum(order - weights[-1] * variance / new.process_sd**2, 0.0).sum(0)
    factor = np.clip(np.sqrt(mean / known) / new.process_sd, 1 / MAX_PROCESS_FACTOR, MAX_PROCESS_FACTOR)
    largest = np.inf if problem.max_process_sd is None else problem.max_process_sd
    return replace(
        new, process_sd=np.clip(new.process_sd * factor, MIN_PROCESS_SD, largest), step_weights=tuple(weights)
    )
