"""A turn predicted from the yaw equation alone: sway follows from the yaw rate by a curve v(r)."""

from collections.abc import Sequence
from dataclasses import replace
from math import inf

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.core.manoeuvre import Manoeuvre
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.dynamics.base import Model, rate_of_state
from manoeuvre_nn.dynamics.limits import left_range
from manoeuvre_nn.dynamics.rollout import rollout
from manoeuvre_nn.dynamics.simulate import sample_times, to_recordings

SINGULAR = 0.02
"""Share of ``Iz - Nrdot`` that the left-hand side of the yaw equation must keep; below it nothing can be predicted."""


class TurningModel(Model):
    """A ship whose sway velocity is a function of its yaw rate: no sway equation is solved.

    ``v = v(r, t)``, ``vdot = dv/dr rdot + dv/dt`` and

        rdot = (N(u, v, r, delta) + Nvdot dv/dt) / (Iz - Nrdot - Nvdot dv/dr)

    with surge by the ship's own equation. ``dv/dt`` is zero but where a curve changes from one branch to the other.
    Where the denominator loses its sign the rates are no numbers, and a run ends there: see :func:`predict`.

    Attributes:
        ship: The ship whose surge and yaw equations hold; its sway equation is not used.
        curve: (r', t') -> v', dv'/dr', dv'/dt' in U0, U0/L and L/U0.
        constant_speed: Whether u stays what it is on the approach.
        separation: Time after which r and v stay what they are [s].

    Source:
        Wang 1996, eqs 6.2 and 6.3 and section 6.3.
    """

    def __init__(self, ship: Ship, curve: nn.Module, *, constant_speed: bool = False, separation: float = inf) -> None:
        """Join ship and curve.

        Args:
            ship: The ship.
            curve: (r', t') -> v', dv'/dr', dv'/dt'.
            constant_speed: Whether to leave out the surge equation ("if the loss of speed is insignificant").
            separation: Time after which r and v are held [s].

        Raises:
            InputError: If the time is not positive, or surge is coupled with sway and yaw by the ship's inertia.
        """
        super().__init__()
        if not separation > 0:
            raise InputError(f"separation={separation}: expected a time in seconds, more than 0")
        if bool(ship.inertia[0, 1:].any() or ship.inertia[2, 0]):
            raise InputError(f"ship {ship.particulars.name}: surge inertia must stand alone to predict from yaw alone")
        self.ship, self.curve = ship, curve
        self.constant_speed, self.separation = constant_speed, separation

    @property
    def hull(self) -> Ship:
        """The ship itself."""
        return self.ship

    def sway(
        self, r: Float[Tensor, "*batch"], time: Float[Tensor, "*batch"] | None = None
    ) -> tuple[Float[Tensor, "*batch"], Float[Tensor, "*batch"], Float[Tensor, "*batch"]]:
        """Sway velocity by the curve.

        Args:
            r: Yaw rate [rad/s].
            time: Time since the start [s]; None is long after it.

        Returns:
            v [m/s], dv/dr [m], dv/dt [m/s^2].
        """
        ship = self.particulars
        clock = torch.full_like(r, inf) if time is None else time.expand_as(r)
        clock = clock.clamp(max=self.separation) / ship.time_unit
        v, by_r, by_t = self.curve(r * ship.time_unit, clock)
        return v * ship.speed, by_r * ship.length, by_t * ship.speed / ship.time_unit

    def left_side(
        self, r: Float[Tensor, "*batch"], time: Float[Tensor, "*batch"] | None = None
    ) -> Float[Tensor, "*batch"]:
        """The factor of rdot in the yaw equation over ``Iz - Nrdot``.

        Args:
            r: Yaw rate [rad/s].
            time: Time since the start [s]; None is long after it.

        Returns:
            ``1 - Nvdot dv/dr / (Iz - Nrdot)`` [-].
        """
        return 1 + self._coupling * self.sway(r, time)[1]

    @property
    def _coupling(self) -> Tensor:
        """``-Nvdot / (Iz - Nrdot)`` [1/m]."""
        units = self.ship.acceleration_units
        return self.ship.inertia[2, 1] / self.ship.inertia[2, 2] * units[2] / units[1]

    def _rates(self, nu: Tensor, delta: Tensor, time: Tensor | None) -> tuple[Tensor, Tensor]:
        """u, v, r with v by the curve, and their rates."""
        r = nu[..., 2]
        v, by_r, by_t = self.sway(r, time)
        nu = torch.stack([nu[..., 0], v, r], dim=-1)
        force, inertia, units = self.ship.force(nu, delta), self.ship.inertia, self.ship.acceleration_units
        left = 1 + self._coupling * by_r
        rdot = (force[..., 2] / inertia[2, 2] * units[2] - self._coupling * by_t) / left
        rdot = rdot.masked_fill(left <= SINGULAR, torch.nan)
        udot = force[..., 0] / inertia[0, 0] * units[0]
        held = torch.zeros_like(r) if time is None else (time >= self.separation).to(r)
        udot = torch.zeros_like(udot) if self.constant_speed else udot
        turning = torch.stack([by_r * rdot + by_t, rdot], dim=-1).masked_fill(held[..., None] > 0, 0.0)
        return nu, torch.cat([udot[..., None], turning], dim=-1)

    def forward(self, state: Float[Tensor, "*batch 6"], inputs: Inputs) -> Float[Tensor, "*batch 6"]:
        """Rate of the state.

        Args:
            state: u, v, r, x, y, psi; v is taken from the curve.
            inputs: Rudder angle and time; without a time it is long after the start, on the last branch.

        Returns:
            Its time derivative.
        """
        nu, rates = self._rates(state[..., :3], inputs.delta, inputs.time)
        return rate_of_state(torch.cat([nu, state[..., 3:]], dim=-1), rates)

    def start(self, state: Float[Tensor, "*batch 6"], inputs: Inputs) -> Float[Tensor, "*batch 6"]:
        """The state at the start with the sway velocity that the curve has there.

        Args:
            state: u, v, r, x, y, psi.
            inputs: Not used.

        Returns:
            The same with another v.
        """
        del inputs
        v = self.sway(state[..., 2], torch.zeros_like(state[..., 2]))[0]
        return torch.cat([state[..., :1], v[..., None], state[..., 2:]], dim=-1)

    def on_approach(self, speed: float) -> "TurningModel":
        """The ship takes on the speed; the curve holds in U0, U0/L and L/U0 and goes with it.

        Args:
            speed: Approach speed [m/s].

        Returns:
            New dynamics that share the curve.
        """
        ship = self.ship.on_approach(speed)
        return TurningModel(ship, self.curve, constant_speed=self.constant_speed, separation=self.separation)

    def row(self, index: int) -> "TurningModel":
        """One of several curves.

        Args:
            index: Which.

        Returns:
            A model with that curve alone.
        """
        curve = self.curve.row(index)  # type: ignore[operator]
        return TurningModel(self.ship, curve, constant_speed=self.constant_speed, separation=self.separation)


def predict(model: TurningModel, manoeuvres: Sequence[Manoeuvre], *, step: float | None = None) -> list[Recording]:
    """Predict turns, one with each row of the curve.

    Args:
        model: A model with as many rows as there are manoeuvres.
        manoeuvres: What is ordered; of one length and approach speed.
        step: Largest step [s]; by default 1/20 of L/U0.

    Returns:
        One recording a row. Where the left-hand side of the yaw equation vanished it ends there, and its status says
        when, at which yaw rate and why.

    Raises:
        InputError: If the manoeuvres differ in length or approach speed.
    """
    if len({(m.speed, m.duration_for(model.particulars)) for m in manoeuvres}) != 1:
        raise InputError(
            "turns predicted together differ in length or approach speed: predict them one after the other"
        )
    moving = model if manoeuvres[0].speed is None else model.on_approach(manoeuvres[0].speed)
    times = sample_times(moving.particulars, manoeuvres[0])
    for manoeuvre in manoeuvres:
        manoeuvre.check(moving.particulars)
    start = torch.zeros(len(manoeuvres), 6, dtype=moving.ship.inertia.dtype)
    start[:, 0] = moving.particulars.speed
    with torch.inference_mode():
        start = moving.start(start, Inputs(start[:, 5]))
        runs = rollout(moving, manoeuvres, start, start.new_tensor(times), step=step)
    made = []
    for k, (manoeuvre, end) in enumerate(zip(manoeuvres, runs.ended.tolist(), strict=True)):
        (recording,) = to_recordings(moving.row(k), [manoeuvre], runs.row(k))
        made.append(recording if end == inf else replace(recording, status=_why_ended(moving.row(k), recording, end)))
    return made


def _why_ended(model: TurningModel, recording: Recording, end: float) -> str:
    """Whether the yaw equation broke down, or the ship went where no ship goes."""
    at, rate = float(recording["r"][-1]), float(recording["rdot"][-1])
    ahead = np.linspace(0.0, 2.0, 101) * (end - recording.time[-1])
    r, clock = (model.ship.inertia.new_tensor(x) for x in (at + rate * ahead, recording.time[-1] + ahead))
    if float(model.left_side(r, clock).min()) > 2 * SINGULAR:
        return left_range(end)
    prime = at * model.particulars.time_unit
    return f"yaw equation singular at {end:.4g} s: at r' = {prime:.3g} dv/dr reaches (Iz - Nrdot) / Nvdot"
