"""The modular (MMG) model of a ship with one propeller and one rudder, at low speeds and in four quadrants."""

from dataclasses import dataclass, replace
from math import pi, sqrt

import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.core.units import RPM

MIN_SPEED_M_S = 1e-5
"""Speed below which no drift angle is formed [m/s]."""
MIDDLE, WEAK = -0.35, -0.06
"""Advance ratios between which the side force of a propeller turning astern has another law [-]."""


@dataclass(frozen=True)
class MMGCoefficients:
    """Hull, propeller and rudder.

    Inertia and hull are over ``.5 rho L^2 T`` (masses), ``.5 rho L^4 T`` (moments) and ``.5 rho L T`` (derivatives).

    Attributes:
        mass: m' [-].
        added_x: m_x' [-].
        added_y: m_y' [-].
        inertia: Moment of inertia about the centre of gravity and added moment, I_zz' + J_zz' [-].
        x_g: Centre of gravity forward of midship over L [-].
        x_ahead: X_0F', resistance ahead [-].
        x_astern: X_0A', resistance astern [-].
        x_vr: X_vr', beyond the added mass [-].
        y_v: Y_v' [-].
        y_r: Y_r', beyond the added mass [-].
        n_v: N_v' [-].
        n_r: N_r' [-].
        cross_drag: Cross-flow drag C_D [-].
        cross_y: C_rY, share of the yaw rate in the cross flow of Y [-].
        cross_n: C_rN, likewise in N [-].
        diameter: D of the propeller [m].
        pitch_ratio: Pitch over D [-].
        deduction: Thrust deduction t [-].
        wake: Wake fraction on a straight course w_P0 [-].
        wake_drift: tau and C_P, by which drift lowers the wake [-].
        x_p: x_P' over L [-].
        thrust: k_0, k_1, k_2 of K_T [-].
        thrust_astern: C_3, C_6, C_7, C_10 of the thrust astern [-].
        side: A_1 .. A_8 of the propeller's side force [-].
        turn: B_1 .. B_8 of the propeller's yaw moment [-].
        area: A_R of the rudder [m^2].
        aspect: Aspect ratio of the rudder [-].
        x_r: x_R over L [-].
        rudder_deduction: t_R [-].
        hull_force: a_H [-].
        hull_x: x_H over L [-].
        epsilon: Wake at the rudder over that at the propeller [-].
        k_x: Race, ahead [-].
        k_x_astern: Race, astern [-].
        inflow_astern: c_pr, added inflow to the rudder when the propeller gives no thrust ahead [-].
        l_r: l_R over L, flow straightening of the yaw rate [-].
        gamma_port: Flow straightening where ``v + x_R r`` is negative [-].
        gamma_starboard: Where it is not [-].
    """

    mass: float
    added_x: float
    added_y: float
    inertia: float
    x_g: float
    x_ahead: float
    x_astern: float
    x_vr: float
    y_v: float
    y_r: float
    n_v: float
    n_r: float
    cross_drag: float
    cross_y: float
    cross_n: float
    diameter: float
    pitch_ratio: float
    deduction: float
    wake: float
    wake_drift: tuple[float, float]
    x_p: float
    thrust: tuple[float, float, float]
    thrust_astern: tuple[float, float, float, float]
    side: tuple[float, ...]
    turn: tuple[float, ...]
    area: float
    aspect: float
    x_r: float
    rudder_deduction: float
    hull_force: float
    hull_x: float
    epsilon: float
    k_x: float
    k_x_astern: float
    inflow_astern: float
    l_r: float
    gamma_port: float
    gamma_starboard: float


class MMGShip(Ship):
    """Low-speed MMG model: hull, propeller and rudder apart, the cross flow integrated along the hull.

    About midship, with the hull's linear part after Yoshimura, cross flow of C_D along x in -L/2 .. L/2,
    ``w = w_P0 - tau |b| - C_P b^2``, ``b = (v + x_P r)/U``, race ``u_R`` and rudder force F_N::

        (m + m_x) udot - (m + m_y) v r - x_G m r^2 = X_H + X_P - (1 - t_R) F_N sin d
        (m + m_y) vdot + x_G m rdot + (m + m_x) u r = Y_H + Y_P - (1 + a_H) F_N cos d
        (I + J + x_G^2 m) rdot + x_G m (vdot + u r) = N_H + N_P - (x_R + a_H x_H) F_N cos d
        F_N = .5 rho A_R 6.13 a/(a + 2.25) (u_R^2 + v_R^2) sin(d - atan2(v_R, u_R))

    Thrust is written so that it stays finite where n passes through zero: a propeller that stands still is dragged
    (by 2 % of the resistance); the source has no force there. ``Ship.force`` is for the shaft speed that keeps up the
    approach speed; :meth:`shaft_force` adds what another one changes, also one astern.

    Source:
        Yasukawa & Yoshimura 2015 (doi 10.1007/s00773-014-0293-y) for the parts; Yoshimura, Nakao & Ishibashi 2009 for
        low speed, Kitagawa et al. 2015 for the rudder behind a propeller astern, Hachii 2004 for its side force, as
        put together by Miyauchi et al. 2022 (doi 10.1007/s00773-022-00889-3).
    """

    def __init__(self, particulars: Particulars, coefficients: MMGCoefficients) -> None:
        """Build the ship, with the shaft speed that keeps up the approach speed."""
        p, k = particulars, coefficients
        off = k.mass * k.x_g
        inertia = [[k.mass + k.added_x, 0.0, 0.0], [0.0, k.mass + k.added_y, off], [0.0, off, k.inertia + k.x_g * off]]
        super().__init__(p, p.prime, torch.tensor(inertia, dtype=torch.float64))
        self.coefficients = k
        resistance = -0.5 * p.rho * p.length * p.draught * k.x_ahead * p.speed**2
        self.shaft = self._self_propulsion(p.speed, resistance)
        # Recorded shaft speeds are over this one everywhere, and shares of the resistance are of this model's.
        self.particulars = replace(p, rpm=self.shaft / RPM, resistance=resistance)

    def _self_propulsion(self, speed: float, resistance: float) -> float:
        """Shaft speed at which thrust balances the resistance [N] on a straight course [1/s]."""
        p, k = self.particulars, self.coefficients
        inflow = speed * (1 - k.wake) / k.diameter
        wanted = resistance / (p.rho * k.diameter**4 * (1 - k.deduction))
        k0, k1, k2 = k.thrust
        root = (k1 * inflow) ** 2 - 4 * k0 * (k2 * inflow**2 - wanted)
        if root < 0 or k0 <= 0:
            raise InputError(f"ship {p.name}: no shaft speed keeps up {speed:g} m/s; mind the thrust coefficients")
        return (-k1 * inflow + sqrt(root)) / (2 * k0)

    @property
    def shaft_rpm(self) -> float:
        """Shaft speed that keeps up the approach speed [rpm]."""
        return self.shaft / RPM

    def force(self, nu: Float[Tensor, "*batch 3"], delta: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch 3"]:
        """Right-hand sides at the shaft speed of the approach."""
        return self.force_at(nu, delta, torch.full_like(delta, self.shaft))

    def shaft_force(
        self, nu: Float[Tensor, "*batch 3"], delta: Float[Tensor, "*batch"], shaft: Float[Tensor, "*batch"]
    ) -> Float[Tensor, "*batch 3"]:
        """What another shaft speed changes: thrust, the propeller's side force, and the race over the rudder."""
        return self.force_at(nu, delta, shaft * self.shaft) - self.force(nu, delta)

    def force_at(
        self, nu: Float[Tensor, "*batch 3"], delta: Float[Tensor, "*batch"], n: Float[Tensor, "*batch"]
    ) -> Float[Tensor, "*batch 3"]:
        """Right-hand sides at any shaft speed.

        Args:
            nu: u, v [m/s], r [rad/s] through the water.
            delta: Rudder angle [rad], positive turns to starboard.
            n: Shaft speed [1/s]; negative turns astern.

        Returns:
            f' [-].
        """
        u, v, r = nu.unbind(-1)
        turn = r * self.particulars.length
        speed = torch.clamp((u.square() + v.square()).sqrt(), min=MIN_SPEED_M_S)
        inflow = self._inflow(u, v, turn, speed)
        thrust, sides = self._propeller(u, n, inflow)
        rudder = self._rudder(u, v, turn, delta, n, inflow, thrust)
        return self._hull(u, v, turn, speed) + sides + rudder

    def _hull(self, u: Tensor, v: Tensor, turn: Tensor, speed: Tensor) -> Float[Tensor, "*batch 3"]:
        """Hull and the inertia's products of velocities, over the prime force; ``turn`` is r L."""
        h = self.coefficients
        drag = h.x_ahead + (h.x_astern - h.x_ahead) * torch.atan2(v, u).abs() / pi
        side, _ = cross_flow(v, h.cross_y * turn)
        _, moment = cross_flow(v, h.cross_n * turn)
        surge = drag * u * speed + (h.x_vr + h.mass + h.added_y) * v * turn + h.mass * h.x_g * turn.square()
        sway = h.y_v * v * u.abs() + (h.y_r - h.mass - h.added_x) * u * turn - h.cross_drag * side
        yaw = h.n_v * v * u + h.n_r * turn * u.abs() - h.mass * h.x_g * u * turn - h.cross_drag * moment
        return torch.stack([surge, sway, yaw], dim=-1) / self.prime.speed**2

    def _inflow(self, u: Tensor, v: Tensor, turn: Tensor, speed: Tensor) -> Tensor:
        """Inflow to the propeller over u, 1 - w; 1 astern."""
        k = self.coefficients
        drift = (v + k.x_p * turn) / speed
        tau, square = k.wake_drift
        wake = k.wake - tau * drift.abs() - square * drift.square()
        return torch.where(u > 0, (1 - wake).clamp(min=1e-9, max=1.0), 1.0)

    def _propeller(self, u: Tensor, n: Tensor, inflow: Tensor) -> tuple[Tensor, Float[Tensor, "*batch 3"]]:
        """``K_T n^2 D^2`` as the rudder feels it [m^2/s^2], and the propeller's forces over the prime force."""
        k, p = self.coefficients, self.particulars
        k0, k1, k2 = k.thrust
        c3, c6, c7, c10 = k.thrust_astern
        tip, advance = n * k.diameter, u * inflow
        ahead = k0 * tip.square() + k1 * tip * advance + k2 * advance.square()
        backward = torch.where(u >= c10 * tip, c3 * tip.square(), c6 * tip.square() + c7 * tip * u)
        thrust = torch.where(n >= 0, ahead, backward)
        along = torch.where(n >= 0, (1 - k.deduction) * ahead, backward)
        scale = 2 * k.diameter**2 / (p.length * p.draught)
        laws = [self._side(u, tip, n, law) for law in (k.side, k.turn)]
        return thrust, torch.stack([scale * along, *laws], dim=-1) / self.prime.speed**2

    def _side(self, u: Tensor, tip: Tensor, n: Tensor, k: tuple[float, ...]) -> Tensor:
        """Side force or moment of the propeller over .5 rho L T [m^2/s^2]; none with ship and propeller ahead."""
        pitch = self.coefficients.pitch_ratio
        stop = pitch**2 * (k[5] * u.square() + k[6] * u * tip + k[7] * tip.square())
        j = u / torch.where(n < 0, tip, -1.0)
        middle, strong = k[0] + k[1] * j, k[2] + k[3] * j
        weak = torch.full_like(j, k[4])
        astern = tip.square() * torch.where(j < MIDDLE, strong, torch.where(j <= WEAK, middle, weak))
        return torch.where(n < 0, astern, torch.where(u < 0, stop, 0.0))

    def _rudder(
        self, u: Tensor, v: Tensor, turn: Tensor, delta: Tensor, n: Tensor, inflow: Tensor, thrust: Tensor
    ) -> Float[Tensor, "*batch 3"]:
        """Rudder forces over the prime force."""
        k, p = self.coefficients, self.particulars
        along = self._race(u, n, inflow, thrust)
        gamma = torch.where(v + k.x_r * turn >= 0, k.gamma_starboard, k.gamma_port)
        across = -gamma * (v + k.l_r * turn)
        slope = 6.13 * k.aspect / (2.25 + k.aspect)
        angle = delta - torch.atan2(across, along)
        normal = k.area * slope * (along.square() + across.square()) * angle.sin() / (p.length * p.draught)
        lift = normal * delta.cos()
        parts = [-(1 - k.rudder_deduction) * normal * delta.sin(), -(1 + k.hull_force) * lift]
        parts.append(-(k.x_r + k.hull_force * k.hull_x) * lift)
        return torch.stack(parts, dim=-1) / self.prime.speed**2

    def _race(self, u: Tensor, n: Tensor, inflow: Tensor, thrust: Tensor) -> Tensor:
        """Longitudinal inflow to the rudder u_R [m/s]."""
        k, advance = self.coefficients, u * inflow
        covered = k.diameter / sqrt(k.area * k.aspect)
        push = 8 / pi * thrust.abs() + 1e-12
        faster = advance + k.k_x / k.epsilon * ((advance.square() + push).sqrt() - advance)
        ahead = k.epsilon * (covered * faster.square() + (1 - covered) * advance.square() + 1e-12).sqrt()
        behind = k.epsilon * advance
        washed = behind + k.k_x_astern * torch.sign(n) * push.sqrt()
        square = covered * washed * washed.abs() + (1 - covered) * behind.square() + k.inflow_astern * u.square()
        other = torch.where(u < 0, u, torch.sign(square) * (square.abs() + 1e-12).sqrt())
        return torch.where((n >= 0) & (thrust > 0), ahead, other)

    def on_approach(self, speed: float) -> "MMGShip":
        """The ship at another approach speed; the shaft speed that keeps it up follows."""
        return MMGShip(self.particulars.at_speed(speed), self.coefficients).to(self.inertia)


def cross_flow(v: Float[Tensor, "*batch"], turn: Float[Tensor, "*batch"]) -> tuple[Tensor, Tensor]:
    """Cross flow along the hull in closed form: ``int |w| w dx``, ``int |w| w x dx``, w = v + turn x, -.5 < x < .5.

    Args:
        v: Sway velocity [m/s].
        turn: Yaw rate times length [m/s].

    Returns:
        Both integrals [m^2/s^2].
    """
    one_sided = 2 * v.abs() >= turn.abs()
    # Where the flow is from one side all along, the other branch is not taken; its divisor must not vanish there.
    a = torch.where(one_sided, 1.0, turn)
    bow, stern = v + 0.5 * a, v - 0.5 * a
    cubes = (bow.abs() ** 3 - stern.abs() ** 3) / 3
    fourths = (bow.abs() ** 3 * bow - stern.abs() ** 3 * stern) / 4
    side = torch.where(one_sided, torch.sign(v) * (v.square() + turn.square() / 12), cubes / a)
    return side, torch.where(one_sided, v.abs() * turn / 6, (fourths - v * cubes) / a.square())
