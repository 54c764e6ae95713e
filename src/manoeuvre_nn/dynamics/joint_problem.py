"""What is to be explained by states and coefficients together (:mod:`.joint`), and how far it is."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int

from manoeuvre_nn.dynamics.joint_colour import Colour

CHANNELS = ("u", "v", "r", "x", "y", "psi")
"""Measured channels and first states; the others are the coloured accelerations of surge, sway and yaw."""
MOTION = len(CHANNELS)
FREEDOM = 4.0
"""Degrees of freedom of Student's t, the distribution of noise with outliers."""
GAUSSIAN = 1.203
"""Standard deviation of Gaussian noise over the scale of the Student's t that fits it best."""
STILL = 0.1
"""Square of the speed over that of the approach below which what a model lacks hardly gets less."""
DELAY, OFFSET = "delay", "offset"
"""What a sensor may get wrong: it writes down too late, or too much."""
LATEST, SHIFTED = 0.1, {"u": 0.02, "v": 0.02, "r": 0.02, "x": 0.1, "y": 0.1, "psi": 0.02}
"""Standard deviation of what sensors may be late by, in L/U0, and off by, before any run is seen."""


@runtime_checkable
class Force(Protocol):
    """Accelerations that are linear in coefficients."""

    count: int

    def columns(
        self, state: Float[np.ndarray, "n 6"], inputs: Mapping[str, Float[np.ndarray, " n"]]
    ) -> Float[np.ndarray, "n 3 p"]:
        """What the coefficients are multiplied by.

        Args:
            state: u, v, r, x, y, psi.
            inputs: Rudder angle, shaft speed and what else is known over time.

        Returns:
            Columns: accelerations of surge, sway and yaw for a coefficient of 1.
        """


class NoForce:
    """Nothing is known of the ship: all acceleration is the coloured one, and the problem is a smoother."""

    count = 0

    def columns(
        self, state: Float[np.ndarray, "n 6"], inputs: Mapping[str, Float[np.ndarray, " n"]]
    ) -> Float[np.ndarray, "n 3 0"]:
        """No column.

        Args:
            state: u, v, r, x, y, psi.
            inputs: Anything.

        Returns:
            An empty array.
        """
        del inputs
        return np.zeros((len(state), 3, 0))


@dataclass(frozen=True)
class Track:
    """A run in units of L and its approach speed.

    Attributes:
        name: The recording's name.
        time: Sample times, even or not.
        measured: u, v, r, x, y, psi; NaN where nothing was measured.
        inputs: What acts on the ship, by name (``delta``, ``n``, ``wind_north``, ``wind_east``).
        guess: Where to start with channels that were not measured; None if all were.
    """

    name: str
    time: Float[np.ndarray, " n"]
    measured: Float[np.ndarray, "n 6"]
    inputs: Mapping[str, Float[np.ndarray, " n"]] = field(default_factory=dict)
    guess: Float[np.ndarray, "n 6"] | None = None

    def __len__(self) -> int:
        """Number of samples."""
        return len(self.time)

    @cached_property
    def pressure(self) -> Float[np.ndarray, " m"]:
        """Dynamic pressure at each step over that at the approach speed, and never nothing: waves and wind remain."""
        u = self.measured[:, 0] if self.guess is None else self.guess[:, 0]
        square = np.nan_to_num(u).clip(min=0) ** 2 + STILL
        return 0.5 * (square[1:] + square[:-1]) / (1 + STILL)

    @property
    def wind_is_known(self) -> bool:
        """Whether the wind was recorded."""
        return any(np.any(self.inputs[k]) for k in ("wind_north", "wind_east") if k in self.inputs)

    @cached_property
    def present(self) -> Float[np.ndarray, "n 6"]:
        """One where a channel was measured, else 0."""
        return np.isfinite(self.measured).astype(float)


@dataclass(frozen=True)
class Fault:
    """An error of a sensor that is estimated with the rest, run by run.

    Attributes:
        channel: The channel.
        kind: ``delay`` in units of time, or ``offset`` in the channel's.
        spread: Prior standard deviation about 0.
    """

    channel: str
    kind: str
    spread: float


def sensor_faults(delays: Sequence[str], offsets: Sequence[str]) -> list[Fault]:
    """Sensors' errors with their usual spread.

    Args:
        delays: Channels whose sensor may be late.
        offsets: Channels whose sensor may be off.

    Returns:
        Delays, then offsets.
    """
    late = [Fault(c, DELAY, LATEST) for c in delays]
    return late + [Fault(c, OFFSET, SHIFTED[c]) for c in offsets]


@dataclass(frozen=True)
class Problem:
    """What is to be explained, and by what.

    Attributes:
        tracks: The runs.
        force: Columns of the coefficients.
        mean: What the coefficients are before any run is seen.
        spread: Standard deviation of that.
        force_time: Correlation time of the coloured accelerations.
        floor: Noise of u, v, r, x, y, psi is never taken to be smaller: no model is better than that.
        learn_floor: Whether the floor sinks as far as stretches of the runs still agree (:func:`.agreed_floor`).
        faults: Sensors' errors that are estimated in each run.
        learn_force: Whether the size of the coloured accelerations is estimated too.
        most: What their standard deviation may be at most; None is no bound.
        with_speed: Whether those of sway and yaw go with the speed, their variance with the dynamic pressure, in runs
            whose wind is known: one that is not pushes at any speed.
        smooth: Whether the coloured accelerations are smooth: a whole ship's are, those that a model lacks are not.
    """

    tracks: Sequence[Track]
    force: Force
    mean: Float[np.ndarray, " p"]
    spread: Float[np.ndarray, " p"]
    force_time: float = 1.0
    floor: Float[np.ndarray, " 6"] = field(default_factory=lambda: np.full(6, 1e-6))
    faults: Sequence[Fault] = ()
    learn_force: bool = False
    smooth: bool = False
    learn_floor: bool = False
    most: Float[np.ndarray, " 3"] | None = None
    with_speed: bool = False

    @property
    def colour(self) -> Colour:
        """How the coloured accelerations go on from sample to sample."""
        return Colour(self.force_time, self.smooth)

    def swell(self, run: int) -> Float[np.ndarray, "m 3"]:
        """Variance of the coloured accelerations at each step of a run over that at the approach speed.

        Args:
            run: Its number.

        Returns:
            Of surge (one, always: ships gather way with most of it), sway and yaw.
        """
        track = self.tracks[run]
        factor = np.ones((len(track) - 1, 3))
        if self.with_speed and track.wind_is_known:
            factor[:, 1:] = track.pressure[:, None]
        return factor

    @property
    def shared(self) -> int:
        """Number of coefficients, which all runs share."""
        return len(self.mean)

    def own(self, run: int) -> Int[np.ndarray, " f"]:
        """Places of a run's sensor errors among all parameters.

        Args:
            run: Its number.

        Returns:
            Indices.
        """
        return self.shared + run * len(self.faults) + np.arange(len(self.faults))

    @property
    def prior(self) -> tuple[Float[np.ndarray, " q"], Float[np.ndarray, " q"]]:
        """Mean and standard deviation of all parameters: coefficients, then the runs' sensor errors."""
        spreads = [f.spread for f in self.faults] * len(self.tracks)
        return np.concatenate([self.mean, np.zeros(len(spreads))]), np.concatenate([self.spread, spreads])


@dataclass(frozen=True)
class Estimate:
    """How far the solution has come.

    Attributes:
        states: u, v, r, x, y, psi and three coloured accelerations at every sample of each run, and the rates of these
            where they are smooth.
        values: All parameters, see :attr:`Problem.prior`.
        noise: Scale of each channel's noise, Student's t; Gaussian noise has :data:`GAUSSIAN` times it.
        force: Standard deviation of the coloured accelerations.
        weights: Weight of every sample; outliers have little.
        calm: Weight of what is new in the coloured accelerations at every step; gusts have little.
        covariance: Of the parameters, states and everything else unknown included.
        floor: What the noise is at least.
        passes: Steps that were made.
        state_covariance: Of every sample's state; filled by :func:`improve`.
        cost: Half the sum of squares at which the step started.
        evidence: Log marginal likelihood by Laplace's method, up to a constant of the data.
        moved: Largest step of a parameter over its prior standard deviation.
    """

    states: tuple[Float[np.ndarray, "_ s"], ...]
    values: Float[np.ndarray, " q"]
    noise: Float[np.ndarray, " 6"]
    force: Float[np.ndarray, " 3"]
    weights: tuple[Float[np.ndarray, "_ 6"], ...]
    calm: tuple[Float[np.ndarray, "_ 3"], ...]
    covariance: Float[np.ndarray, "q q"]
    floor: Float[np.ndarray, " 6"]
    passes: int = 0
    state_covariance: tuple[Float[np.ndarray, "_ s s"], ...] = ()
    cost: float = np.inf
    evidence: float = -np.inf
    moved: float = np.inf
