"""A run made ready: averaged, smoothed, linearised about its track, with what hypotheses about it have in common."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import torch
from jaxtyping import Float
from scipy.interpolate import make_interp_spline

from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.dynamics.base import Model, calm_accelerations, is_fitted
from manoeuvre_nn.effect.common import typical
from manoeuvre_nn.estimation.corrections import Calibrated
from manoeuvre_nn.estimation.effect_columns import coefficient_columns, latency_column, with_feedback
from manoeuvre_nn.estimation.linear_run import Columns, joined
from manoeuvre_nn.estimation.linearised_run import LinearisedRun, Rate, linearise, shown
from manoeuvre_nn.estimation.measurement_noise import OUTLIER_SDS
from manoeuvre_nn.estimation.run_states import RunStates
from manoeuvre_nn.estimation.smoothed_run import rounding_step, smooth
from manoeuvre_nn.recording.outliers import far_off
from manoeuvre_nn.recording.preparation import measured
from manoeuvre_nn.recording.thinning import averaged

FIRST_NOISE = RunStates().first_noise
"""First idea of the noise of the channels ``MEASURED``."""
SMOOTHER_PROCESS_SD = np.array([0.05, 0.1, 0.1])
"""Prior standard deviation of the process noise of the smoother, in U0^2/L (yaw: U0^2/L^2)."""
SMOOTHER_ROLL = 0.2
"""That in roll, over the roll acceleration of 20 deg of rudder."""
LATENCY, LATENCY_SD = 0.25, 0.25
"""Delay of the satellite receiver [s]: mean and s.d. before the recording is seen."""
MAX_STATE_STEP, MAX_STATE_STEP_S = 0.1, 2.0
"""Longest time between the states of a run, over L/U0 and for a full-scale ship [s]: in it forces change evenly, those
of a rudder that is laid within 10 s too."""


@dataclass(frozen=True)
class PreparedRun:
    """A run with what hypotheses about it have in common.

    Attributes:
        linearised: Its equations about its track.
        noise: S.d. of its channels, their correlation in time taken in.
        inflation: What that correlation multiplied their variances by.
        base: Data, coefficients and latency as columns.
        process: Process noise that the states need [m/s^2, m/s^2, rad/s^2, rad/s^2].
        sample_noise: S.d. of what was recorded, of which the run has averages.
    """

    linearised: LinearisedRun
    noise: Float[np.ndarray, " c"]
    inflation: Float[np.ndarray, " c"]
    base: Columns
    process: Float[np.ndarray, "n p"]
    sample_noise: Float[np.ndarray, " c"]

    @property
    def data(self) -> Columns:
        """The recording as a column: what the track and the model with published coefficients leave unexplained."""
        return joined([self.base[:1], self.base[-1:]]).combined(np.array([1.0, LATENCY]))


def prepared_run(dynamics: Model, run: Recording, count: int = 1) -> PreparedRun:
    """One run made ready.

    Args:
        dynamics: Calm-water model.
        run: The run.
        count: Samples that are averaged for one state.

    Returns:
        The run about its smoothed states.
    """
    rate, p = Rate(dynamics), dynamics.particulars
    unit = p.speed**2 / p.length * np.array([1.0, 1.0, 1.0 / p.length])
    wide = np.append(SMOOTHER_PROCESS_SD * unit, SMOOTHER_ROLL * typical_rates(dynamics)[3:])
    first, few = rate.states.first_noise, averaged(run, count)
    count = 1 if few is run else count  # a run of few samples is left as it is
    least = 0.2 * first
    if is_fitted(dynamics):  # recordings are trusted as they were when the model was fitted
        u, v, r, x, y, psi = dynamics.noise.tolist()
        least[:6] = np.array([x, y, u, v, psi, r]) / np.sqrt(count)
    # Averages of rounded values are as wrong as these are: what was rounded stays so for many samples.
    least = np.maximum(least, rounding_step(measured(run, rate.states.channels)) / np.sqrt(12.0))  # even over a step
    few = replace(few, meta={**run.meta, "rudder_noise": run.meta["rudder_noise"] / np.sqrt(count)})
    linearised, noise, inflation, process = smooth(few, rate, first, least, wide, p)
    slow = np.where((noise > least) | (not is_fitted(dynamics)), inflation, 1.0)
    base = base_columns(dynamics, linearised)
    single = noise if count == 1 else _noise_of_samples(run, linearised, noise, count)
    return PreparedRun(linearised, noise * np.sqrt(slow), slow, base, process, single)


def samples_a_state(dynamics: Model, interval: float, apart: int = 1) -> int:
    """How many times, an interval [s] apart, share one state of a run.

    Args:
        dynamics: Calm-water model.
        interval: Between the times of the run.
        apart: After how many of them there is a sample: as many times or a multiple or a part of it share a state, so
            that each sample keeps its time.

    Returns:
        One for a ship that rolls, whose own motion is faster.
    """
    ship = dynamics.particulars
    longest = min(MAX_STATE_STEP * ship.time_unit, float(ship.sized([MAX_STATE_STEP_S], [0.5])[0]))
    most = 1 if dynamics.own_names else max(1, int(longest / interval + 0.05))
    return max(n for n in range(1, most + 1) if n % apart == 0 or apart % n == 0)


def _noise_of_samples(
    run: Recording, linearised: LinearisedRun, noise: Float[np.ndarray, " c"], count: int
) -> Float[np.ndarray, " c"]:
    """Standard deviation of samples: that of their averages, and of what they lie off these beside the motion."""
    few = linearised.run
    motion = make_interp_spline(few.time, shown(linearised.track), k=3)
    rest = measured(run, linearised.states.channels) - motion(run.time)
    rest = rest[: len(few) * count].reshape(len(few), count, -1)
    there = np.isfinite(rest)
    middle = np.where(there, rest, 0.0).sum(axis=1) / np.maximum(there.sum(axis=1), 1)
    squares = []
    for off, good in zip((rest - middle[:, None]).T, there.T, strict=True):
        own = off[good]
        kept = ~far_off(own, OUTLIER_SDS, 1e-12)[0] if len(own) else good[good]
        squares.append(np.mean(own[kept] ** 2) if kept.any() else 0.0)
    return np.sqrt(noise**2 + np.array(squares))


def about_states(
    dynamics: Model,
    prepared: PreparedRun,
    track: Float[np.ndarray, "n k"],
    corrections: Float[np.ndarray, " k"] | None = None,
    indicated: Float[np.ndarray, " n"] | None = None,
    receiver: Float[np.ndarray, "#n 4"] | None = None,
    acting: tuple[Sequence[Effect], Sequence[Float[np.ndarray, " p"]]] = ((), ()),
) -> PreparedRun:
    """The same run about another track.

    Args:
        dynamics: Calm-water model.
        prepared: The run.
        track: u, v, r, x, y, psi, own states.
        corrections: Sizes of :class:`.Corrections` that the equations are linearised about too, so that effects act on
            the corrected ship: a rudder offset on the rudder as strong as it is; None are none.
        indicated: What the rudder indicator showed, where corrections of rudder forces act [rad]; None is the record.
        receiver: What errors of sensors add to what the satellite receiver shows; None is nothing.
        acting: Effects whose forces go with the states, and their values.

    Returns:
        The run about it.
    """
    about = dynamics if corrections is None else Calibrated(dynamics, dynamics.hull.inertia.new_tensor(corrections))
    linearised = linearise(prepared.linearised.run, Rate(about), track, indicated)
    linearised = linearised if receiver is None else replace(linearised, receiver=receiver)
    linearised = with_feedback(linearised, *acting)
    return replace(prepared, linearised=linearised, base=base_columns(dynamics, linearised))


def base_columns(dynamics: Model, linearised: LinearisedRun) -> Columns:
    """Data, coefficients (each on its own) and latency of a run as columns."""
    latency, coefficients = latency_column(linearised), coefficient_columns(dynamics, linearised)
    about = linearised.rate.dynamics
    taken_out = about.shares.numpy() if isinstance(about, Calibrated) else np.zeros(coefficients.count)
    # The unknowns are the latency's deviation from its prior mean, and whole corrections, also those taken out already.
    shares = np.r_[1.0, -LATENCY, taken_out]
    return joined([joined([linearised.data, latency, coefficients]).combined(shares), coefficients, latency])


def typical_rates(dynamics: Model) -> Float[np.ndarray, " k"]:
    """Accelerations that are large in a manoeuvre: by the resistance in surge, by 20 deg of rudder otherwise.

    Returns:
        [m/s^2, m/s^2, rad/s^2], and of a ship that rolls that of roll [rad/s^2].
    """
    found = typical(dynamics.hull, partial(calm_accelerations, dynamics)).numpy()
    own = len(dynamics.own_names)
    if not own:
        return found
    ahead = torch.tensor([dynamics.particulars.speed, *[0.0] * (2 + own)], dtype=torch.float64)
    with torch.no_grad():
        with_it, without = (
            Rate(dynamics)(ahead, d, torch.ones_like(d)) for d in (0 * ahead[0] + 20 * DEGREE, ahead[1])
        )
    return np.append(found, float((with_it - without)[-1].abs()))


def process_time(dynamics: Model) -> float:
    """Correlation time of what no hypothesis explains: the time in which the ship sails its length.

    Returns:
        Time [s].
    """
    return dynamics.particulars.time_unit


def start_spread(dynamics: Model) -> Float[np.ndarray, " k"]:
    """Prior standard deviation of a first state about the track.

    Returns:
        u, v [m/s], r [rad/s], x, y [m], psi [rad], own states.
    """
    ship = dynamics.particulars
    east, own = float(ship.sized([50.0], [1.0])[0]), RunStates(dynamics.own_names).own_start_sd(ship)
    return np.array([0.3 * ship.speed, 0.3 * ship.speed, 0.3 * ship.speed / ship.length, east, east, 0.3, *own])
