"""What several effects share: kinds of parameters, gates in time, thrust and the part of the rudder."""

from collections.abc import Callable
from math import inf, pi

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import softplus

from manoeuvre_nn.core.effect import Effect, Parameter, Situation
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.core.units import DEGREE

TIGHT_TURN = {"u": 0.3, "v": 0.25, "r": 0.7, "d": 0.35}
"""What (u - U0)/U0, v/U0, r L/U0 and the rudder angle [rad] are in a tight turn."""
PRIME_ACCELERATION_OF_20_DEG = (0.06, 0.5)
"""20 deg of rudder in sway and yaw in prime accelerations: about those of the Mariner."""
ROUND = 2.0
"""Time over which the corners of an event's course are rounded [s]; it makes its times differentiable."""
ACROSS = ("to starboard", "to port")
"""What the sign of a lateral force or distance means."""
LENGTHWISE = ("forward", "aft")
"""The same along the ship."""
LATE = ("late", "early")
"""The same of a delay."""
RAMP = Parameter("ramp_s", "s", 1.0, 1800.0, 1.0, 60.0, (15.0,))
"""Time in which an event builds up about each start, and dies away about each end; the least is a step."""


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
    """A time in a recording, and values from which a fit is tried [s]; inf is never."""
    return Parameter(name, "s", 0.0, 7200.0, None, 600.0, starts, per_run=True)


def several(number: int) -> tuple[Parameter, ...]:
    """Start and end of each time that an event happens in a run; all but the first need not be."""
    later = (instant(f"{what}_{k}_s", inf) for k in range(2, number + 1) for what in ("start", "end"))
    return (instant("start_s", 100.0, 200.0), instant("end_s", 300.0, 400.0), *later)


def from_some_time() -> tuple[Parameter, ...]:
    """Start and end of what begins once in a run and may last, and its ramp."""
    return (instant("start_s", 200.0, 400.0), instant("end_s", inf), RAMP)


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


def during(effect: Effect, time: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
    """Share of an event that acts: half of it at each start and at each end, with a ramp about these.

    It is the mean, over the time of the ramp, of a gate that is 1 between start and end.

    Args:
        effect: The event; its times are declared in pairs, a start and an end, and ``RAMP`` among its parameters.
        time: Since the start of the recording [s].

    Returns:
        Between 0 and 1.
    """
    times, ramp = [p.name for p in effect.declared if p.is_time], effect.value(RAMP.name)
    share = torch.zeros_like(time + ramp)
    for first, last in zip(times[::2], times[1::2], strict=True):
        start = effect.value(first)
        if bool(torch.isfinite(start).any()):
            share = share + _risen(time, start, ramp) - _risen(time, torch.maximum(start, effect.value(last)), ramp)
    return share


def _risen(time: Float[Tensor, "..."], start: Float[Tensor, "..."], ramp: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
    """A straight rise from 0 to 1 about a time, its corners rounded; 0 where the time is inf."""
    # About its middle: a fit whose ramp rests on its bound leaves the time alone.
    steep = 4.0 / ROUND
    rise = softplus(steep * (time - start + 0.5 * ramp)) - softplus(steep * (time - start - 0.5 * ramp))
    return rise / (steep * ramp)


def compass(degrees: Float[Tensor, "..."]) -> tuple[Float[Tensor, "..."], Float[Tensor, "..."]]:
    """North and east components of a unit vector in a direction [deg]."""
    angle = degrees * (pi / 180.0)
    return torch.cos(angle), torch.sin(angle)


def rudder_part(ship: Ship, s: Situation) -> tuple[Float[Tensor, "*batch 3"], Float[Tensor, "*batch"]]:
    """What the rudder does that it would not do amidships: accelerations and heeling moment [N m]."""
    return ship.by_rudder(s.nu, s.delta, torch.zeros_like(s.delta), s.shaft)
