"""What is to be explained by states and coefficients together (:mod:`.closed_loop`), and how far it is.

All is in units of L and the speed of the run's approach.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from manoeuvre_nn.core.channels import CHANNELS as DECLARED
from manoeuvre_nn.core.channels import MOTION as MOTION_CHANNELS
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.estimation.coefficient_forces import CoefficientForces
from manoeuvre_nn.estimation.process_noise import ProcessNoise

CHANNELS = MOTION_CHANNELS[:6]
"""Measured channels and first states; the others are the process noise of surge, sway and yaw."""
MOTION = len(CHANNELS)
PRESSURE_AT_REST = 0.1
"""Square of the speed over that of the approach below which what a model lacks hardly gets less."""
DELAY, OFFSET = "delay", "offset"
"""What a sensor may get wrong: it writes down too late, or too much."""
DELAY_SD = 0.1
"""Prior standard deviation of what sensors are late by, in L/U0."""


def measured_motion(recording: Recording) -> Float[np.ndarray, "n 6"]:
    """What sensors recorded of the motion; NaN in gaps and in channels of ``meta["derived"]``.

    Of a track or heading that was derived from its rates the first sample counts: it says where the run begins.

    Args:
        recording: u, v, r, x, y, psi.

    Returns:
        One column a channel.
    """
    values = recording.stacked(*CHANNELS)
    for name in recording.derived:
        values[1 if name in ("x", "y", "psi") else 0 :, CHANNELS.index(name)] = np.nan
    return values


@dataclass(frozen=True)
class SensorFault:
    """An error of a sensor that is estimated with the rest, run by run.

    Attributes:
        channel: The channel.
        kind: ``delay`` in units of time, or ``offset`` in the channel's.
        spread: Prior standard deviation about 0.
    """

    channel: str
    kind: str
    spread: float


def sensor_faults(delays: Sequence[str], offsets: Sequence[str]) -> list[SensorFault]:
    """Sensors' errors with their usual spread.

    Args:
        delays: Channels whose sensor may be late.
        offsets: Channels whose sensor may be off.

    Returns:
        Delays, then offsets.
    """
    late = [SensorFault(c, DELAY, DELAY_SD) for c in delays]
    return late + [SensorFault(c, OFFSET, DECLARED[c].offset or 0.0) for c in offsets]


@dataclass(frozen=True)
class EstimationProblem:
    """What is to be explained, and by what.

    Attributes:
        recordings: u, v, r, x, y, psi and what acts on the ship (``delta``, ``n``, ``wind_north``, ``wind_east``); even
            or uneven times. Gaps are NaN, channels of ``meta["derived"]`` only say where to start.
        forces: Columns of the coefficients. None: nothing is known of the ship, all acceleration is process noise, and
            the problem is a smoother.
        mean: Prior mean of the coefficients.
        spread: Prior standard deviation.
        process_time: Correlation time of the process noise.
        floor: Measurement noise of u, v, r, x, y, psi is never taken to be smaller: no model is better than that.
        learn_floor: Whether the floor sinks as far as stretches of the runs still agree (:func:`.agreed_floor`).
        faults: Sensors' errors that are estimated in each run.
        learn_process: Whether the size of the process noise is estimated too.
        max_process_sd: What its standard deviation may be at most; None is no bound.
        with_speed: Whether that of sway and yaw goes with the speed, its variance with the dynamic pressure, in runs
            whose wind is known: one that is not pushes at any speed.
        smooth: Whether the process noise is smooth: a whole ship's acceleration is, what a model lacks is not.
    """

    recordings: Sequence[Recording]
    forces: CoefficientForces | None
    mean: Float[np.ndarray, " p"]
    spread: Float[np.ndarray, " p"]
    process_time: float = 1.0
    floor: Float[np.ndarray, " 6"] = field(default_factory=lambda: np.full(6, 1e-6))
    faults: Sequence[SensorFault] = ()
    learn_process: bool = False
    smooth: bool = False
    learn_floor: bool = False
    max_process_sd: Float[np.ndarray, " 3"] | None = None
    with_speed: bool = False

    def force_columns(self, run: int, state: Float[np.ndarray, "n 6"]) -> Float[np.ndarray, "n 3 p"]:
        """Accelerations in a run for coefficients of 1.

        Args:
            run: Its number.
            state: u, v, r, x, y, psi.

        Returns:
            One column a coefficient.
        """
        if self.forces is None:
            return np.zeros((len(state), 3, 0))
        return self.forces.columns(state, self.recordings[run].channels)

    @property
    def process(self) -> ProcessNoise:
        """How the process noise goes on from sample to sample."""
        return ProcessNoise(self.process_time, self.smooth)

    @cached_property
    def measured(self) -> tuple[Float[np.ndarray, "_ 6"], ...]:
        """Measured motion of each run, see :func:`measured_motion`."""
        return tuple(measured_motion(r) for r in self.recordings)

    @cached_property
    def present(self) -> tuple[Float[np.ndarray, "_ 6"], ...]:
        """One where a channel was measured, else 0."""
        return tuple(np.isfinite(m).astype(float) for m in self.measured)

    def process_variance(self, run: int) -> Float[np.ndarray, "m 3"]:
        """Variance of the process noise at each step of a run over that at the approach speed.

        Returns:
            Of surge (one, always: ships gather way with most of it), sway and yaw.
        """
        recording = self.recordings[run]
        factor = np.ones((len(recording) - 1, 3))
        if self.with_speed and any(np.any(recording.channels.get(k, 0.0)) for k in ("wind_north", "wind_east")):
            # Dynamic pressure over that of the approach, and never nothing: waves and wind remain.
            square = np.nan_to_num(recording["u"]).clip(min=0) ** 2 + PRESSURE_AT_REST
            factor[:, 1:] = (0.5 * (square[1:] + square[:-1]) / (1 + PRESSURE_AT_REST))[:, None]
        return factor

    @property
    def shared(self) -> int:
        """Number of coefficients, which all runs share."""
        return len(self.mean)

    def own(self, run: int) -> Int[np.ndarray, " f"]:
        """Places of a run's sensor errors among all unknowns."""
        return self.shared + run * len(self.faults) + np.arange(len(self.faults))

    @property
    def prior(self) -> tuple[Float[np.ndarray, " q"], Float[np.ndarray, " q"]]:
        """Mean and standard deviation of all unknowns: coefficients, then the runs' sensor errors."""
        spreads = [f.spread for f in self.faults] * len(self.recordings)
        return np.concatenate([self.mean, np.zeros(len(spreads))]), np.concatenate([self.spread, spreads])


@dataclass(frozen=True)
class Estimate:
    """How far the solution has come.

    Attributes:
        states: u, v, r, x, y, psi and the process noise of three accelerations at every sample of each run, and its
            rates where it is smooth.
        values: All unknowns, see :attr:`EstimationProblem.prior`.
        noise: Scale of each channel's noise, Student's t; Gaussian noise has :data:`GAUSSIAN` times it.
        process_sd: Standard deviation of the process noise.
        sample_weights: Weight of every sample; outliers have little.
        step_weights: Weight of every innovation of the process noise; gusts have little.
        covariance: Of the unknowns, states and everything else unknown included.
        floor: What the noise is at least.
        passes: Steps that were made.
        state_covariance: Of every sample's state; filled by :func:`.improve`.
        cost: Half the sum of squares at which the step started.
        evidence: Log marginal likelihood by Laplace's method, up to a constant of the data.
        moved: Largest step of an unknown over its prior standard deviation.
    """

    states: tuple[Float[np.ndarray, "_ s"], ...]
    values: Float[np.ndarray, " q"]
    noise: Float[np.ndarray, " 6"]
    process_sd: Float[np.ndarray, " 3"]
    sample_weights: tuple[Float[np.ndarray, "_ 6"], ...]
    step_weights: tuple[Float[np.ndarray, "_ 3"], ...]
    covariance: Float[np.ndarray, "q q"]
    floor: Float[np.ndarray, " 6"]
    passes: int = 0
    state_covariance: tuple[Float[np.ndarray, "_ s s"], ...] = ()
    cost: float = np.inf
    evidence: float = -np.inf
    moved: float = np.inf
