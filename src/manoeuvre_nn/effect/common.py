"""What several effects share: kinds of parameters, gates in time, thrust and the part of the rudder."""

from collections.abc import Mapping
from math import pi
from typing import Protocol, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.effect import Parameter, Situation
from manoeuvre_nn.core.ship import Ship

RISE = 2.0
"""Time in which an event would be complete at its steepest rate [s]; it makes the time of the event differentiable."""


def direction(name: str) -> Parameter:
    """A compass direction, tried from every 45 degrees.

    Args:
        name: Its name, which says whether it is meant from or toward.

    Returns:
        The parameter.
    """
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
    """A time in a recording.

    Args:
        name: Its name.
        starts: Values from which a fit is tried [s].

    Returns:
        The parameter.
    """
    return Parameter(name, "s", 0.0, 7200.0, None, 600.0, starts, per_run=True)


def columns(*parts: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
    """Components as the last dimension of one tensor.

    Args:
        parts: Tensors that broadcast against each other.

    Returns:
        Their broadcast values, one column each.
    """
    return torch.stack(torch.broadcast_tensors(*parts), dim=-1)


def onset(time: Float[Tensor, "..."], start: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
    """A smooth step from 0 to 1 within about ``RISE``.

    Args:
        time: Times [s].
        start: When the step is half way [s].

    Returns:
        Share of the event [-].
    """
    return torch.sigmoid(4.0 * (time - start) / RISE)


def during(time: Float[Tensor, "..."], start: Float[Tensor, "..."], end: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
    """A smooth gate that is open in an interval.

    Args:
        time: Times [s].
        start: When it opens [s].
        end: When it closes [s].

    Returns:
        Opening from 0 to 1 [-].
    """
    return onset(time, start) * onset(-time, -end)


def compass(degrees: Float[Tensor, "..."]) -> tuple[Float[Tensor, "..."], Float[Tensor, "..."]]:
    """North and east components of a unit vector.

    Args:
        degrees: Direction [deg].

    Returns:
        Cosine and sine.
    """
    angle = degrees * (pi / 180.0)
    return torch.cos(angle), torch.sin(angle)


@runtime_checkable
class PropellerShip(Protocol):
    """A ship whose coefficient set contains its propeller (the BIS tanker)."""

    coefficients: Mapping[str, float]

    def thrust(self, u: Tensor, shaft: Tensor | float = 1.0) -> Tensor:
        """Thrust over mass.

        Args:
            u: Forward speed [m/s].
            shaft: Shaft speed over nominal [-].
        """


def thrust_of(ship: Ship, u: Float[Tensor, "*batch"], shaft: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch"]:
    """Propulsive force behind the hull: thrust less thrust deduction.

    ``R0 [(1 + s) n^2 - s n u/U0]``, the resistance at approach speed and nominal shaft speed; the ship's own thrust
    where it has one.

    Args:
        ship: The ship.
        u: Forward speed through the water [m/s].
        shaft: Shaft speed over the nominal one, n [-].

    Returns:
        Force [N].
    """
    if isinstance(ship, PropellerShip):
        return ship.prime.mass * (1 - ship.coefficients["t"]) * ship.thrust(u, shaft)
    p = ship.particulars
    return p.calm_resistance * shaft * ((1 + p.thrust_slope) * shaft - p.thrust_slope * u / p.speed)


def rudder_part(ship: Ship, s: Situation) -> Float[Tensor, "*batch 3"]:
    """What the rudder contributes to the accelerations: those with it less those with it amidships.

    Args:
        ship: The ship.
        s: The situation.

    Returns:
        udot, vdot [m/s^2], rdot [rad/s^2].
    """
    middle = torch.zeros_like(s.delta)
    force = ship.force(s.nu, s.delta) - ship.force(s.nu, middle)
    force = force + ship.shaft_force(s.nu, s.delta, s.shaft) - ship.shaft_force(s.nu, middle, s.shaft)
    return ship.acceleration_from_force(s.nu, force)
