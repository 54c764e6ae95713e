"""Ships that roll: surge, sway, roll and yaw, with one or two propellers and a rudder behind each."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import pi, sqrt

import torch
from jaxtyping import Float
from scipy.optimize import brentq
from torch import Tensor, nn

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.core.network import filled, products_of
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.core.units import RPM

VARIABLES = ("u", "v", "r", "p", "phi", "|u|", "|v|", "|r|", "|p|")
"""What the terms of a hull's series are products of."""
EQUATIONS = ("X", "Y", "N", "K")
MIN_SHARE_OF_SPEED = 1e-3
"""Speed over U0 below which the instantaneous speed does not make anything non-dimensional [-]."""
MAX_SHAFT_HZ = 50.0
"""Shaft speed above which none is looked for that keeps up the approach speed [1/s]."""


@dataclass(frozen=True)
class HullSeries:
    """Forces on the hull as products of velocities and heel, ``F = sum c_k prod_k``, mass terms included.

    Attributes:
        terms: Equation (X, Y, N, K) -> product (``v v r``, ``|u| v``, ``phi``) -> coefficient: in SI or, with
            ``prime``, over ``.5 rho L^2 U^2`` and ``.5 rho L^3 U^2`` by the instantaneous speed U.
        prime: Whether velocities and forces are made non-dimensional by the instantaneous speed.
        restoring: Moment that rights the ship over the heel [N m/rad], ``rho g V GM``; whatever the speed.
        axis: Height above the water of the axis that K is about [m].
    """

    terms: Mapping[str, Mapping[str, float]]
    prime: bool
    restoring: float
    axis: float = 0.0


@dataclass(frozen=True)
class Drive:
    """A propeller and the rudder behind it; prime values are over the ship's length and the instantaneous speed.

    Attributes:
        diameter: D [m].
        thrust: c1, c2 of ``K_T = c1 + c2 J`` [-].
        wake: Wake fraction w on a straight course [-].
        wake_drift: tau of ``u_P = u [1 - w + tau (v' + x_P' r')^2]`` [-].
        x_p: Propeller forward of midship over L [-].
        deduction: Thrust deduction t [-].
        area: A_R of the rudder [m^2].
        slope: Slope of the rudder's normal force f_a [1/rad].
        epsilon: Wake at the rudder over that at the propeller [-].
        race: k of ``u_R = u_P eps sqrt(1 + 8 k K_T / (pi J^2))`` [-], ahead.
        inflow: gamma, c_r, c_rrr, c_rrv of ``v_R' = gamma v' + c_r r' + c_rrr r'^3 + c_rrv r'^2 v'`` [-].
        x_r: Rudder forward of midship over L [-].
        z_r: Centre of the rudder below the reference point over L [-].
        hull_force: a_H [-].
        hull_x: x_H over L [-].
        rudder_drag: c_RX of ``X_R = c_RX F_N sin delta`` [-].
        y: Distance from the centre plane to starboard [m].
    """

    diameter: float
    thrust: tuple[float, float]
    wake: float
    wake_drift: float
    x_p: float
    deduction: float
    area: float
    slope: float
    epsilon: float
    race: float
    inflow: tuple[float, float, float, float]
    x_r: float
    z_r: float
    hull_force: float
    hull_x: float
    rudder_drag: float
    y: float = 0.0


def twin(drive: Drive, offset: float) -> list[Drive]:
    """Two drives of the disc area, advance ratio and rudder area of one, starboard first.

    Each has the diameter over ``sqrt 2`` and half of the rudder's area at the same aspect ratio: on a straight course
    thrust and rudder force are those of the one, at ``sqrt 2`` times its shaft speed.

    Args:
        drive: The single one.
        offset: Distance of either from the centre plane [m].

    Returns:
        Both.
    """
    half = replace(drive, diameter=drive.diameter / sqrt(2.0), area=0.5 * drive.area)
    return [replace(half, y=offset), replace(half, y=-offset)]


class FourDegreeShip(Ship):
    """Surge, sway, yaw and roll: ``M (udot, vdot, rdot, pdot) = F(u, v, r, p, phi, delta, n)``.

    Velocities are in horizontal body axes (x forward, y horizontal to starboard), in which the equations of Son &
    Nomoto are written: heel does not enter the kinematics. Own states: phi [rad] and p = dphi/dt [rad/s]. A drive at y
    to starboard gives::

        u_P = (u - y r) (1 - w + tau (v' + x_P' r')^2)      J = u_P / (n D)
        T = rho n |n| D^4 (c1 + c2 J)                       u_R |u_R| = eps^2 (u_P |u_P| + 8 k T / (pi rho D^2))
        F_N = -.5 rho A_R f_a (u_R^2 + v_R^2) sin(delta + atan(v_R / u_R))
        X = (1 - t) T + c_RX F_N sin delta                  Y = (1 + a_H) F_N cos delta
        N = (x_R + a_H x_H) F_N cos delta - y X             K = -z_R (1 + a_H) F_N cos delta

    Held upright, phi = p = 0 and the inertia is that of surge, sway and yaw; free to roll, :attr:`inertia` is that
    which external forces without a moment about x meet, ``M_3 - M_3p M_p3 / M_pp``.

    Source:
        Son & Nomoto 1981/1982, eqs of motion; the offset y is ours: local speed of a propeller beside the centre plane.
    """

    mass_matrix: Tensor
    inverse: Tensor
    coefficients: Tensor
    places: Tensor

    def __init__(
        self,
        particulars: Particulars,
        mass_matrix: Float[Tensor, "4 4"],
        hull: HullSeries,
        drives: Sequence[Drive],
        rolls: bool = True,
    ) -> None:
        """Build the ship, with the shaft speed that keeps up the approach speed.

        Args:
            particulars: Main dimensions and steering gear.
            mass_matrix: Inertia with added masses for u, v, r, p [kg, kg m, kg m^2].
            hull: Forces on the hull.
            drives: One, or two of which the first is the starboard one.
            rolls: Whether the ship is free to roll; else it is held upright.
        """
        p, prime = particulars, particulars.prime
        free = mass_matrix[:3, :3]
        if rolls:
            free = free - mass_matrix[:3, 3:] @ mass_matrix[3:, :3] / mass_matrix[3, 3]
        units = mass_matrix.new_tensor([1.0, 1.0, p.length])
        super().__init__(p, prime, free / (prime.mass * units * units[:, None]))
        self.hull, self.drives, self.rolls = hull, tuple(drives), rolls
        self.own_names, self.roll_axis = ("phi", "p") if rolls else (), hull.axis
        self.sides = len(self.drives)
        self.register_buffer("mass_matrix", mass_matrix)
        self.register_buffer("inverse", torch.linalg.inv(mass_matrix))
        names = sorted({term for terms in hull.terms.values() for term in terms})
        columns = [[hull.terms.get(e, {}).get(name, 0.0) for e in EQUATIONS] for name in names]
        self.register_buffer("coefficients", mass_matrix.new_tensor(columns))
        self.register_buffer("places", filled([[1 + VARIABLES.index(f) for f in name.split()] for name in names]))
        ahead = mass_matrix.new_tensor([p.speed, 0.0, 0.0])
        resistance = -float(self._hull_forces(ahead, torch.zeros_like(ahead[:2]))[0])
        self.shaft = self._self_propulsion(resistance)
        # Recorded shaft speeds are over this one everywhere, and shares of the resistance are of this model's.
        self.particulars = replace(p, rpm=self.shaft / RPM, resistance=resistance)

    @property
    def shaft_rpm(self) -> float:
        """Shaft speed that keeps up the approach speed [rpm]."""
        return self.shaft / RPM

    def rates(
        self, nu: Float[Tensor, "*batch 3"], own: Float[Tensor, "*batch k"], inputs: Inputs
    ) -> tuple[Float[Tensor, "*batch 3"], Float[Tensor, "*batch k"]]:
        """Accelerations, and the rates of heel and roll rate."""
        if not self.rolls:
            return self.acceleration_from_force(self._upright(nu, inputs)), own
        force = self.forces(nu, own, inputs)
        rates = force @ self.inverse.T
        return rates[..., :3], torch.stack([own[..., 1], rates[..., 3]], dim=-1)

    def added(
        self, nudot: Float[Tensor, "*batch 3"], heeling: Float[Tensor, "*batch"]
    ) -> tuple[Float[Tensor, "*batch 3"], Float[Tensor, "*batch k"]]:
        """What external forces add: ``pdot = -M_p3 nudot / M_pp``, and the column of the inverse by the moment."""
        if not self.rolls:
            return nudot, nudot[..., :0]
        column = heeling[..., None] * self.inverse[:, 3]
        roll = column[..., 3] - nudot @ self.mass_matrix[3, :3] / self.mass_matrix[3, 3]
        return nudot + column[..., :3], torch.stack([torch.zeros_like(roll), roll], dim=-1)

    def by_rudder(
        self,
        nu: Float[Tensor, "*batch 3"],
        delta: Float[Tensor, "*batch"],
        other: Float[Tensor, "*batch"],
        shaft: Float[Tensor, "*batch"] | None = None,
    ) -> tuple[Float[Tensor, "*batch 3"], Float[Tensor, "*batch"]]:
        """What the rudders do at one angle and not at another; heel and roll rate do not enter."""
        own = torch.zeros_like(nu[..., :2])
        one, another = (self.forces(nu, own, Inputs(angle, shaft)) for angle in (delta, other))
        return self.acceleration_from_si((one - another)[..., :3]), (one - another)[..., 3]

    def force(self, nu: Float[Tensor, "*batch 3"], delta: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch 3"]:
        """Right-hand sides of the upright ship at the shaft speed of the approach."""
        return self._upright(nu, Inputs(delta))

    def shaft_force(
        self, nu: Float[Tensor, "*batch 3"], delta: Float[Tensor, "*batch"], shaft: Float[Tensor, "*batch"]
    ) -> Float[Tensor, "*batch 3"]:
        """What another shaft speed changes: thrust, and the race over the rudders."""
        return self._upright(nu, Inputs(delta, shaft)) - self._upright(nu, Inputs(delta))

    def _upright(self, nu: Tensor, inputs: Inputs) -> Float[Tensor, "*batch 3"]:
        """F' with heel and roll rate 0; the roll moment acts through the coupling of the inertia."""
        force = self.forces(nu, torch.zeros_like(nu[..., :2]), inputs)
        push = force[..., :3]
        if self.rolls:
            push = push - force[..., 3:] * self.mass_matrix[:3, 3] / self.mass_matrix[3, 3]
        return push / push.new_tensor([self.prime.force, self.prime.force, self.prime.moment])

    def forces(
        self, nu: Float[Tensor, "*batch 3"], own: Float[Tensor, "*batch 2"], inputs: Inputs
    ) -> Float[Tensor, "*batch 4"]:
        """Right-hand sides X, Y [N], N, K [N m].

        Args:
            nu: u, v [m/s], r [rad/s].
            own: phi [rad], p [rad/s].
            inputs: Rudder and shaft, and how the sides differ.

        Returns:
            Forces and moments, the products of velocities that go with the masses included.
        """
        total = self._hull_forces(nu, own)
        one = torch.ones_like(nu[..., 0])
        shaft = one if inputs.shaft is None else inputs.shaft * one
        for k, drive in enumerate(self.drives):
            sign = 1.0 - 2.0 * k
            delta = inputs.delta if inputs.delta_split is None else inputs.delta + sign * inputs.delta_split
            turns = shaft if inputs.shaft_split is None else shaft + sign * inputs.shaft_split
            total = total + self.drive_forces(drive, nu, delta * one, turns * self.shaft)
        return total

    def _speed(self, nu: Tensor) -> Float[Tensor, "*batch"]:
        """Instantaneous speed through the water, never quite 0 [m/s]."""
        return nu[..., :2].square().sum(-1).sqrt().clamp(min=MIN_SHARE_OF_SPEED * self.particulars.speed)

    def _hull_forces(self, nu: Tensor, own: Tensor) -> Float[Tensor, "*batch 4"]:
        """X, Y, N, K of the hull: ``products @ coefficients``."""
        p, length = self.particulars, self.particulars.length
        values = torch.cat([nu, own[..., 1:], own[..., :1]], dim=-1)
        units = values.new_tensor([1.0, 1.0, 1.0, 1.0])
        if self.hull.prime:
            speed = self._speed(nu)[..., None]
            values = values * torch.cat([1 / speed, 1 / speed, length / speed, length / speed, 1 + 0 * speed], dim=-1)
            units = 0.5 * p.rho * length**2 * speed.square() * values.new_tensor([1.0, 1.0, length, length])
        rows = torch.cat([torch.ones_like(values[..., :1]), values, values[..., :4].abs()], dim=-1).movedim(-1, 0)
        force = products_of(rows, self.places) @ self.coefficients * units
        return force - nn.functional.pad(self.hull.restoring * own[..., :1], (3, 0))

    def drive_forces(
        self, drive: Drive, nu: Float[Tensor, "*batch 3"], delta: Float[Tensor, "*batch"], n: Float[Tensor, "*batch"]
    ) -> Float[Tensor, "*batch 4"]:
        """X, Y [N], N, K [N m] of a propeller and the rudder behind it.

        Args:
            drive: The propeller and its rudder.
            nu: u, v [m/s], r [rad/s].
            delta: Angle of this rudder [rad].
            n: Speed of this shaft [1/s].

        Returns:
            What they add to the right-hand sides.
        """
        p, d, length = self.particulars, drive, self.particulars.length
        u, v, r = nu.unbind(-1)
        speed = self._speed(nu)
        sway, turn = v / speed, r * length / speed
        advance = (u - d.y * r) * (1 - d.wake + d.wake_drift * (sway + d.x_p * turn).square())
        tip = n * d.diameter
        # K_T n^2 D^2 and the race are written without J, so that a shaft at rest needs no division.
        c1, c2 = d.thrust
        push = tip.abs() * (c1 * tip + c2 * advance)
        thrust = p.rho * d.diameter**2 * push
        race = advance * advance.abs() + 8 * d.race / pi * push
        along = d.epsilon * torch.sign(race) * race.abs().clamp(min=1e-12).sqrt()
        gamma, c_r, c_rrr, c_rrv = d.inflow
        across = speed * (gamma * sway + turn * (c_r + c_rrr * turn.square() + c_rrv * turn * sway))
        angle = delta + torch.atan2(across, along)
        normal = -0.5 * p.rho * d.area * d.slope * (along.square() + across.square()) * angle.sin()
        lift = normal * delta.cos()
        surge = (1 - d.deduction) * thrust + d.rudder_drag * normal * delta.sin()
        yaw = (d.x_r + d.hull_force * d.hull_x) * length * lift - d.y * surge
        heel = -(1 + d.hull_force) * d.z_r * length * lift
        return torch.stack([surge, (1 + d.hull_force) * lift, yaw, heel], dim=-1)

    def _self_propulsion(self, resistance: float) -> float:
        """Shaft speed at which thrust balances the resistance [N] on a straight course [1/s]."""
        nu = self.mass_matrix.new_tensor([self.particulars.speed, 0.0, 0.0])

        def surge(n: float) -> float:
            drives = (self.drive_forces(d, nu, nu[1], nu.new_tensor(n))[0] for d in self.drives)
            return float(sum(drives)) - resistance

        if surge(0.0) >= 0 or surge(MAX_SHAFT_HZ) <= 0:
            p = self.particulars
            raise InputError(f"ship {p.name}: no shaft speed keeps up {p.speed:g} m/s; mind the thrust coefficients")
        return float(brentq(surge, 0.0, MAX_SHAFT_HZ, xtol=1e-13))

    def on_approach(self, speed: float) -> "FourDegreeShip":
        """The ship at another approach speed; the shaft speed that keeps it up follows."""
        p = self.particulars.at_speed(speed)
        return FourDegreeShip(p, self.mass_matrix, self.hull, self.drives, self.rolls)
