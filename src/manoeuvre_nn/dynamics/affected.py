"""A ship with effects: what a calm-water model leaves out, put back."""

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor, nn

from manoeuvre_nn.core.effect import Effect, Situation
from manoeuvre_nn.core.frames import kinematics
from manoeuvre_nn.core.ship import Particulars, Ship
from manoeuvre_nn.dynamics.base import Dynamics

LONG = 1e6
"""Time after which every rudder has come to rest [s]; finite, since a rate of 0 times infinity is no number."""


class Affected(Dynamics):
    """Calm-water dynamics and effects on top, itself a dynamics.

    The state is u, v, r *through the water*, x, y, psi over ground, then the effects' own states. A uniform current
    therefore changes the track and nothing else (Fossen 2012; Hegrenaes & Hallingstad 2011). Several hull and force
    effects add their accelerations.

    Attributes:
        calm: The calm-water model: a reference ship or an identified one.
        effects: What acts on it.
    """

    def __init__(self, calm: Dynamics, effects: Sequence[Effect]) -> None:
        """Join model and effects.

        Args:
            calm: The calm-water model.
            effects: What acts on it.
        """
        super().__init__()
        self.calm, self.effects = calm, nn.ModuleList(effects)

    @property
    def particulars(self) -> Particulars:
        """Those of the calm-water model."""
        return self.calm.particulars

    @property
    def hull(self) -> Ship:
        """That of the calm-water model."""
        return self.calm.hull

    @property
    def memory(self) -> int:
        """Number of states beyond the six of the ship."""
        return sum(e.memory for e in self._effects())

    def _effects(self) -> list[Effect]:
        return list(self.effects)  # type: ignore[arg-type]

    def acceleration(self, nu: Float[Tensor, "*batch 3"], delta: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch 3"]:
        """Accelerations in calm water; with effects they depend on the whole state: see :meth:`forward`.

        Args:
            nu: u, v [m/s], r [rad/s].
            delta: Rudder angle [rad], positive turns to starboard.

        Returns:
            udot, vdot [m/s^2], rdot [rad/s^2].
        """
        return self.calm.acceleration(nu, delta)

    def situation(
        self, state: Float[Tensor, "*batch n"], delta: Float[Tensor, "*batch"], time: Float[Tensor, "*batch"]
    ) -> Situation:
        """What the effects see, accelerations being those of calm water.

        Args:
            state: u, v, r, x, y, psi and the effects' own states.
            delta: Angle of the rudder blade [rad].
            time: Time since the start of the recording [s].

        Returns:
            The situation.
        """
        nu = state[..., :3]
        x, y, psi = state[..., 3:6].unbind(-1)
        turns = self.calm.turns(time)
        if turns is not None:  # what was recorded holds, whatever an effect would make of the shaft
            return Situation(nu, self.calm.at_shaft(nu, delta, turns), x, y, psi, delta, turns, time)
        still = torch.ones_like(delta)
        s = Situation(nu, self.calm.acceleration(nu, delta), x, y, psi, delta, still, time)
        shaft = still
        for effect, own in self._memories(state):
            if type(effect).shaft is not Effect.shaft:  # what another shaft speed does costs as much as all forces
                shaft = shaft * effect.shaft(s, own)
        if shaft is still:
            return s
        extra = self.hull.acceleration_from_force(nu, self.hull.shaft_force(nu, delta, shaft))
        return s.with_(shaft=shaft, nudot=s.nudot + extra)

    def _memories(self, state: Tensor) -> list[tuple[Effect, Tensor]]:
        """Every effect with its part of the state."""
        parts = state[..., 6:].split([e.memory for e in self._effects()], dim=-1)
        return list(zip(self._effects(), parts, strict=True))

    def forward(
        self,
        state: Float[Tensor, "*batch n"],
        delta: Float[Tensor, "*batch"],
        time: Float[Tensor, "*batch"] | None = None,
    ) -> Float[Tensor, "*batch n"]:
        """Rate of the state.

        Args:
            state: u, v, r, x, y, psi and the effects' own states.
            delta: Angle of the rudder blade [rad].
            time: Time since the start of the recording [s]; None is 0.

        Returns:
            Its time derivative.
        """
        s = self.situation(state, delta, torch.zeros_like(delta) if time is None else time)
        acceleration, motion = s.nudot, kinematics(state[..., :6])
        own = []
        for effect, memory in self._memories(state):
            acceleration = acceleration + effect.acceleration(s, memory)
            motion = motion + nn.functional.pad(effect.stream(s), (0, 1))
            own.append(effect.memory_rate(s, memory))
        return torch.cat([acceleration, motion, *own], dim=-1)

    def start(self, state: Float[Tensor, "*batch 6"], delta: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch n"]:
        """A state with the effects' own states as on a steady approach.

        Args:
            state: u, v, r, x, y, psi.
            delta: Rudder angle [rad].

        Returns:
            The whole state.
        """
        nu, still = state[..., :3], torch.ones_like(delta)
        x, y, psi = state[..., 3:6].unbind(-1)
        s = Situation(nu, torch.zeros_like(nu), x, y, psi, delta, still, torch.zeros_like(delta))
        return torch.cat([state, *(e.memory_at_start(s) for e in self._effects())], dim=-1)

    def blade(
        self,
        before: Float[Tensor, "*batch k"],
        order: Float[Tensor, "*batch"],
        shown: Float[Tensor, "*batch"],
        elapsed: Float[Tensor, "*batch"],
    ) -> Float[Tensor, "*batch k"]:
        """Rudder angles behind every effect in turn; the last is that of the blade.

        Args:
            before: The angles at the start of the time, one column an effect [rad].
            order: Helm order during it [rad].
            shown: Indicated angle at its end [rad].
            elapsed: The time [s].

        Returns:
            The angles at its end [rad].
        """
        angles = []
        for k, effect in enumerate(self._effects()):
            shown = effect.blade(before[..., k], order, shown, elapsed)
            angles.append(shown)
        return torch.stack(angles or [shown], dim=-1)

    def blade_at_rest(self, delta: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch k"]:
        """What :meth:`blade` tends to when the helm has stood still for long.

        Args:
            delta: Order and indicated angle [rad].

        Returns:
            The angles behind the indicator, one column an effect [rad].
        """
        before = torch.stack([delta] * max(len(self.effects), 1), dim=-1)
        return self.blade(before, delta, delta, torch.full_like(delta, LONG))

    def indicated(self, recorded: Float[Tensor, "*batch n"], time: Float[Tensor, " n"]) -> Float[Tensor, "*batch n"]:
        """What the rudder indicator showed: every effect's record undone, the last one's first.

        Args:
            recorded: Recorded rudder angle [rad].
            time: Sample times since the start of the recording [s].

        Returns:
            Indicated angle at these times [rad].
        """
        for effect in reversed(self._effects()):
            recorded = effect.indicated(recorded, time)
        return recorded

    def recorded(
        self,
        states: Float[Tensor, "*batch n"],
        shown: Float[Tensor, "*batch"],
        blade: Float[Tensor, "*batch"],
        time: Float[Tensor, "*batch"],
    ) -> dict[str, Tensor]:
        """What perfect sensors would write, changed by every effect in turn; u and v are no sensor's.

        Args:
            states: Whole states, time in the last batch dimension.
            shown: Indicated rudder angle [rad].
            blade: Angle of the rudder blade [rad].
            time: Time since the start of the recording [s].

        Returns:
            x, y [m], vn, ve (over ground) [m/s], psi [rad], r [rad/s], u_log [m/s], delta [rad] and shaft [-]; nothing
            without effects.
        """
        if not len(self.effects):
            return {}
        s = self.situation(states, blade, time)
        north, east = self(states, blade, time)[..., 3:5].unbind(-1)
        channels = {"x": s.x, "y": s.y, "vn": north, "ve": east, "psi": s.psi, "r": s.r, "u_log": s.u}
        channels |= {"delta": shown, "n": s.shaft}
        for effect in self._effects():
            channels = effect.record(channels, s)
        return {"shaft" if name == "n" else name: values for name, values in channels.items()}

    def on_approach(self, speed: float) -> "Affected":
        """The same ship and effects at another approach speed; what effects do follows the ship.

        Args:
            speed: Approach speed [m/s].

        Returns:
            New dynamics.
        """
        calm = self.calm.on_approach(speed)
        return Affected(calm, [_aboard(e, calm.hull) for e in self._effects()])


def _aboard(effect: Effect, ship: Ship) -> Effect:
    """The same effect with the same values and choices on another ship."""
    moved = effect.at(effect.values)
    moved._ship = [ship]
    return moved


def in_words(effects: Sequence[Effect]) -> str:
    """What acts on a ship, with its values.

    Args:
        effects: What acts, at least one.

    Returns:
        ``a steady wind (speed=12 m/s, from_deg=90) and ...``; parameters of the formula where they are not the usual.
    """
    said = []
    for effect in effects:
        pairs = zip(effect.declared, effect.values.tolist(), strict=True)
        given = [
            f"{p.name}={value:g}" + ("" if p.name.endswith(f"_{p.unit}") or p.unit == "-" else f" {p.unit}")
            for p, value in pairs
            if not (p.form and value == p.null)
        ]
        said.append(f"{effect.label} ({', '.join(given)})")
    return " and ".join([", ".join(said[:-1]), said[-1]] if said[1:] else said)
