"""What several effects share: kinds of parameters, gates in time, thrust and the part of the rudder."""

from collections.abc import Callable
from math import pi

import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.effect import Parameter, Situation
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.core.units import DEGREE

TIGHT_TURN = {"u": 0.3, "v": 0.25, "r": 0.7, "d": 0.35}
"""What (u - U0)/U0, v/U0, r L/U0 and the rudder angle [rad] are in a tight turn."""
PRIME_ACCELERATION_OF_20_DEG = (0.06, 0.5)
"""20 deg of rudder in sway and yaw in prime accelerations: about those of the Mariner."""
RISE = 2.0
"""Time in which an event would be complete at its steepest rate [s]; it makes the time of the event differentiable."""


def direction(name: str) -> Parameter:
    """A compass direction, tried from every 45 degrees; its name says whether it is meant from or toward."""
    starts = tuple(float(a) for a in range(0, 360, 45))
    return Parameter(name, "deg", 0.0, 360.0, None, 360.0, starts, period=360.0)


def factor(name: str, spread: float, low: float = 0.0, high: float = 3.0) -> Parameter:
    """A factor on a published curve, 1 as published.

    Args:
        name: Its name.
        spread: How far the curve is off, usually.
        low: Smallest value.
        high: Largest.

    Returns:
        The form parameter.
    """
    return Parameter(name, "-", low, high, 1.0, spread, (1.0,), form=True)


def instant(name: str, *starts: float) -> Parameter:
    """A time in a recording, and values from which a fit is tried [s]."""
    return Parameter(name, "s", 0.0, 7200.0, None, 600.0, starts, per_run=True)


def columns(*parts: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
    """Components, broadcast against each other, as the last dimension of one tensor."""
    return torch.stack(torch.broadcast_tensors(*parts), dim=-1)


def typical(ship: Ship, rate: Callable[[Tensor, Tensor], Tensor] | None = None) -> Float[Tensor, " 3"]:
    """Accelerations that are large in a manoeuvre: by the resistance in surge, by 20 deg of rudder in sway and yaw.

    Args:
        ship: The ship.
        rate: Accelerations at velocities and a rudder angle; None takes the ship's own.

    Returns:
        [m/s^2, m/s^2, rad/s^2]; where the rudder does nothing, as in a ship of which only the inertia is known,
        ``PRIME_ACCELERATION_OF_20_DEG`` shares of U0^2/L and U0^2/L^2.
    """
    p, rate = ship.particulars, rate or ship.acceleration
    ahead = ship.inertia.new_tensor([p.speed, 0.0, 0.0])
    over = 20 * DEGREE * torch.ones_like(ahead[0])
    with torch.no_grad():
        turned = (rate(ahead, over) - rate(ahead, 0 * over)).abs()
        held_back = ship.acceleration_from_si(ahead.new_tensor([p.calm_resistance, 0.0, 0.0]))
    sway, yaw = PRIME_ACCELERATION_OF_20_DEG
    usual = p.speed**2 / p.length * turned.new_tensor([0.0, sway, yaw / p.length])
    return torch.cat([held_back[:1].abs(), torch.where(turned > 0, turned, usual)[1:]])


def in_tight_turns(ship: Ship, s: Situation) -> dict[str, Tensor]:
    """u, v, r, d -> speeds, yaw rate and rudder angle in units of what they are in a tight turn."""
    p = ship.particulars
    z = {"u": s.u / p.speed - 1, "v": s.v / p.speed, "r": s.r * p.length / p.speed, "d": s.delta}
    return {letter: value / TIGHT_TURN[letter] for letter, value in z.items()}


def onset(time: Float[Tensor, "..."], start: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
    """A smooth step from 0 to 1 within about ``RISE``, half way at ``start`` [s]."""
    return torch.sigmoid(4.0 * (time - start) / RISE)


def during(time: Float[Tensor, "..."], start: Float[Tensor, "..."], end: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
    """A smooth gate, 1 between two times [s] and 0 outside."""
    return onset(time, start) * onset(-time, -end)


def compass(degrees: Float[Tensor, "..."]) -> tuple[Float[Tensor, "..."], Float[Tensor, "..."]]:
    """North and east components of a unit vector in a direction [deg]."""
    angle = degrees * (pi / 180.0)
    return torch.cos(angle), torch.sin(angle)


def rudder_part(ship: Ship, s: Situation) -> Float[Tensor, "*batch 3"]:
    """What the rudder contributes to the accelerations: those with it less those with it amidships."""
    middle = torch.zeros_like(s.delta)
    force = ship.force(s.nu, s.delta) - ship.force(s.nu, middle)
    force = force + ship.shaft_force(s.nu, s.delta, s.shaft) - ship.shaft_force(s.nu, middle, s.shaft)
    return ship.acceleration_from_force(force)
