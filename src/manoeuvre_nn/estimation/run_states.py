"""The states of a linearised run and their usual sizes: motion, own states such as heel, process noise."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.channels import MEASURED
from manoeuvre_nn.core.particulars import Particulars

MOTION = ("u", "v", "r", "x", "y", "psi")


@dataclass(frozen=True)
class _Sizes:
    """Sizes of a state [its unit].

    Attributes:
        unit: Usual size, for the condition of the factor.
        step_sd: Standard deviation of what a step of one second may miss the equations by beside the process noise.
        difference: Step of the difference quotients of rates by it; 0 of position and heading, which change none.
        start_sd: Prior standard deviation of the first value of an own state about the track.
        power: Exponent of length with which it goes by Froude's law.
    """

    unit: float
    step_sd: float
    difference: float
    start_sd: float = 0.0
    power: float = 0.0


SIZES = {
    "u": _Sizes(0.05, 1e-4, 0.02),
    "v": _Sizes(0.05, 1e-4, 0.02),
    "r": _Sizes(5e-4, 1e-6, 2e-4),
    "x": _Sizes(1.0, 2e-3, 0.0),
    "y": _Sizes(1.0, 2e-3, 0.0),
    "psi": _Sizes(2e-3, 2e-6, 0.0),
    "phi": _Sizes(5e-3, 5e-6, 1e-3, 0.1),
    "p": _Sizes(1e-3, 5e-6, 2e-4, 0.02, -0.5),
}
"""State -> its sizes [m/s, rad/s, m, rad]."""
DRIVEN = ("u", "v", "r", "p")
"""Velocities that have process noise."""
FIRST_NOISE = {
    "x": 0.7, "y": 0.7, "vn": 0.04, "ve": 0.04, "psi": 1.75e-3, "r": 3.5e-4, "u_log": 0.05, "shaft_recorded": 0.005,
    "phi": 1.75e-3, "p": 1e-3,
}  # fmt: skip
"""Channel -> first idea of its noise [m, m/s, rad, rad/s, -]."""


@dataclass(frozen=True)
class RunStates:
    """States of a run, in this order: u, v, r, x, y, psi; own states; process noise of u, v, r and of p if it is one.

    Attributes:
        own: Names of the model's own states.
    """

    own: tuple[str, ...] = ()

    @cached_property
    def moving(self) -> tuple[str, ...]:
        """States that equations of motion move."""
        return (*MOTION, *self.own)

    @cached_property
    def channels(self) -> tuple[str, ...]:
        """Channels that are compared with the model: ``MEASURED``, and the own states where they were recorded."""
        return (*MEASURED, *self.own)

    @property
    def count(self) -> int:
        """Number of :attr:`moving`."""
        return len(self.moving)

    @cached_property
    def driven(self) -> tuple[str, ...]:
        """Velocities that have process noise."""
        return tuple(name for name in self.moving if name in DRIVEN)

    @property
    def size(self) -> int:
        """Number of all states."""
        return self.count + len(self.driven)

    @property
    def forces(self) -> slice:
        """Where the process noise of surge, sway and yaw stands."""
        return slice(self.count, self.count + 3)

    @cached_property
    def unit(self) -> Float[np.ndarray, " k"]:
        """Usual size of the moving states."""
        return np.array([SIZES[name].unit for name in self.moving])

    @cached_property
    def step_sd(self) -> Float[np.ndarray, " k"]:
        """What a step of one second may miss the equations by."""
        return np.array([SIZES[name].step_sd for name in self.moving])

    @cached_property
    def difference(self) -> Float[np.ndarray, " k"]:
        """Steps of the difference quotients of rates by the moving states."""
        return np.array([SIZES[name].difference for name in self.moving])

    @cached_property
    def first_noise(self) -> Float[np.ndarray, " c"]:
        """First idea of the channels' noise."""
        return np.array([FIRST_NOISE[name] for name in self.channels])

    def own_start_sd(self, ship: Particulars) -> Float[np.ndarray, " k"]:
        """Prior standard deviation of the first own states."""
        sizes = [SIZES[name] for name in self.own]
        return ship.sized([s.start_sd for s in sizes], [s.power for s in sizes])
