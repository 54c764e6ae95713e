"""Wang 1996, chapter 7: the simplest, the linear and the nonlinear system of sway and yaw in random waves."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import pi

import numpy as np
import torch
from jaxtyping import Float

from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.seakeeping.froude_krylov import encounter_frequency, sway_and_yaw
from manoeuvre_nn.seakeeping.hull import Immersed, immerse
from manoeuvre_nn.seakeeping.spectra import Waves, WaveSpectrum, compose
from manoeuvre_nn.ship.taylor import TaylorShip
from studies.wang1996.offsets import wang_hull

HEIGHT, PERIOD = 5.0, 10.0
"""Significant height [m] and mean period [s]: Wang 1996, section 7.1.1."""
SEA = WaveSpectrum.ittc(HEIGHT, PERIOD)
"""Wang 1996, section 7.1.1."""
BAND = (0.3, 1.25)
"""Lowest and highest wave frequency [rad/s]: Wang 1996, section 7.1.1."""
COMPONENTS = 20
START = np.array([1.0, -0.02])
"""v0 [m/s] and r0 [rad/s]: Wang 1996, section 7.2.1."""
STEP = 0.25
"""Time step [s]; a tenth of the shortest period of encounter."""
ANGLES_DEG = (45.0, 90.0, 135.0)
DURATION, LONG = 100.0, 300.0
"""Observation times T* [s]; the thesis does not state its own."""


def sea(seeds: int, first: int = 0, components: int = COMPONENTS) -> Waves:
    """Realisations of the chapter's sea.

    Args:
        seeds: How many.
        first: Seed of the first.
        components: Regular waves in each.

    Returns:
        The waves.
    """
    return compose(SEA, *BAND, components, range(first, first + seeds))


def hull(ship: TaylorShip) -> Immersed:
    """The hull of the table of offsets at the ship's draught.

    Args:
        ship: The Mariner.

    Returns:
        The boxes under water.
    """
    return immerse(wang_hull(ship.particulars.length), ship.particulars.draught)


def to_heading(angle_deg: float) -> float:
    """Direction that the waves run to, from the chapter's angle.

    By eqs 7.10 and 7.14 waves at 0 deg come from ahead, although the angle is said to be the one between the heading
    and the direction of propagation.

    Args:
        angle_deg: delta of the chapter [deg].

    Returns:
        Heading of :func:`sway_and_yaw` [rad].
    """
    return pi - angle_deg * DEGREE


def wave_force(
    ship: TaylorShip, waves: Waves, angle_deg: float, time: Float[np.ndarray, " times"]
) -> Float[np.ndarray, "times seas 2"]:
    """Sway force and yaw moment on the ship at its approach speed.

    Args:
        ship: The Mariner.
        waves: The sea.
        angle_deg: delta of the chapter [deg].
        time: Times [s].

    Returns:
        Y and N over the units of the ship's prime system.
    """
    heading, p = to_heading(angle_deg), ship.particulars
    transfer = sway_and_yaw(hull(ship), waves.frequency, heading, p.rho)
    encounter = encounter_frequency(waves.frequency, heading, p.speed)
    records = [waves.record(time, h, encounter).T for h in transfer]
    return np.stack([records[0] / ship.prime.force, records[1] / ship.prime.moment], axis=-1)


Rate = Callable[[Float[np.ndarray, "*batch 2"]], Float[np.ndarray, "*batch 2"]]


@dataclass(frozen=True)
class System:
    """Equations of sway and yaw, ``(vdot, rdot) = free(v, r) + share (Y_f, N_f)``.

    Attributes:
        name: What the chapter calls it.
        free: Accelerations without waves [m/s^2, rad/s^2] from v [m/s] and r [rad/s].
        share: Accelerations by a wave force and moment of one prime unit.
        matrix: A of ``free = A (v, r)``; None for the nonlinear system.
    """

    name: str
    free: Rate
    share: Float[np.ndarray, "2 2"]
    matrix: Float[np.ndarray, "2 2"] | None = None

    def sail(self, force: Float[np.ndarray, "halves seas 2"], step: float = STEP) -> Float[np.ndarray, "seas times 2"]:
        """Motion from the chapter's start, by Runge and Kutta's fourth-order rule.

        Args:
            force: Wave force and moment in prime units at every half step.
            step: Time step [s].

        Returns:
            v [m/s] and r [rad/s] at every step.
        """
        push = force @ self.share.T
        states = [np.broadcast_to(START, push.shape[1:]).copy()]
        for i in range(0, len(push) - 2, 2):
            x = states[-1]
            k1 = self.free(x) + push[i]
            k2 = self.free(x + step / 2 * k1) + push[i + 1]
            k3 = self.free(x + step / 2 * k2) + push[i + 1]
            k4 = self.free(x + step * k3) + push[i + 2]
            states.append(x + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4))
        return np.stack(states, axis=1)


def linear_coefficients(ship: TaylorShip) -> Float[np.ndarray, "2 2"]:
    """Yv, Yr - m and Nv, Nr.

    Args:
        ship: The Mariner.

    Returns:
        Rows Y and N, columns v and r, in prime units.
    """
    rows = [ship.terms.index("v"), ship.terms.index("r")]
    return ship.table[rows, 1:].numpy().T.copy()


def _system(
    name: str, ship: TaylorShip, inertia: Float[np.ndarray, "2 2"], coefficients: Float[np.ndarray, "2 2"]
) -> System:
    unit, acceleration = np.array(ship.prime.velocity_units[1:]), np.array(ship.prime.acceleration_units[1:])
    share = acceleration[:, None] * np.linalg.inv(inertia)
    matrix = share @ coefficients / unit
    return System(name, lambda x: x @ matrix.T, share, matrix)


def simplest(ship: TaylorShip) -> System:
    """Uncoupled equations, Wang 1996, eqs 7.21 and 7.22.

    Args:
        ship: The Mariner.

    Returns:
        The system.
    """
    inertia = ship.inertia[1:, 1:].numpy()
    return _system("simplest", ship, np.diag(np.diag(inertia)), np.diag(np.diag(linear_coefficients(ship))))


def linear(ship: TaylorShip, *, bare: bool = False) -> System:
    """Coupled linear equations, Wang 1996, eqs 7.33-7.36 with ``Yr - m u0`` for the printed ``Yr``.

    Args:
        ship: The Mariner.
        bare: Whether to take ``Yr`` as printed, without the centrifugal force.

    Returns:
        The system.
    """
    coefficients, p = linear_coefficients(ship), ship.particulars
    if bare:
        coefficients[0, 1] += 2 * p.block * p.beam / p.length  # m' in the (rho, L, T) system
    return _system("linear", ship, ship.inertia[1:, 1:].numpy(), coefficients)


def nonlinear(ship: TaylorShip) -> System:
    """The full series of the thesis' eqs 3.7 and 3.8 at constant forward speed, Wang 1996, eqs 7.47 and 7.48.

    No term of Y or N depends on u, so that only the frequency of encounter would change with a loss of speed.

    Args:
        ship: The Mariner.

    Returns:
        The system.
    """
    base = linear(ship)
    speed = torch.tensor(ship.particulars.speed, dtype=torch.float64)

    def free(x: Float[np.ndarray, "*batch 2"]) -> Float[np.ndarray, "*batch 2"]:
        across = torch.from_numpy(x)
        nu = torch.cat([speed.expand(across[..., :1].shape), across], dim=-1)
        return ship.force(nu, torch.zeros_like(nu[..., 0]))[..., 1:].numpy() @ base.share.T

    return System("nonlinear", free, base.share)


@dataclass(frozen=True)
class Voyages:
    """Motions of a system from the chapter's start.

    Attributes:
        time: Times [s].
        free: v [m/s] and r [rad/s] without waves.
        waves: Angle [deg] -> the same in waves, a row for each realisation of the sea.
    """

    time: Float[np.ndarray, " times"]
    free: Float[np.ndarray, "times 2"]
    waves: Mapping[float, Float[np.ndarray, "seas times 2"]]

    def until(self, duration: float) -> int:
        """Number of samples.

        Args:
            duration: Time [s].

        Returns:
            Samples up to it.
        """
        return int(round(duration / STEP)) + 1


def sail(ship: TaylorShip, systems: Sequence[System], seeds: int, first: int) -> dict[str, Voyages]:
    """Let every system run in every sea at once.

    Args:
        ship: The Mariner.
        systems: The equations.
        seeds: Realisations of the sea.
        first: Seed of the first.

    Returns:
        Name of the system -> its motions over the longer observation time.
    """
    halves = np.linspace(0, LONG, 2 * int(LONG / STEP) + 1)
    waves = sea(seeds, first)
    forces = [wave_force(ship, waves, angle, halves) for angle in ANGLES_DEG]
    every = np.concatenate([np.zeros((len(halves), 1, 2)), *forces], axis=1)
    result = {}
    for system in systems:
        motion = system.sail(every)
        parts = np.split(motion[1:], len(ANGLES_DEG))
        result[system.name] = Voyages(halves[::2], motion[0], dict(zip(ANGLES_DEG, parts, strict=True)))
    return result
