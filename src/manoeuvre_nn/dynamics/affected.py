"""A ship with effects: what a calm-water model leaves out, put back."""

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor, nn

from manoeuvre_nn.core.effect import Effect, Situation
from manoeuvre_nn.core.frames import kinematics
from manoeuvre_nn.core.ship import Particulars, Ship
from manoeuvre_nn.dynamics.model import Dynamics


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
        still = torch.ones_like(delta)
        x, y, psi = state[..., 3:6].unbind(-1)
        s = Situation(nu, self.calm.acceleration(nu, delta), x, y, psi, delta, still, time)
        shaft = still
        for effect, own in self._memories(state):
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
        return torch.stack(angles, dim=-1)

    def on_approach(self, speed: float) -> "Affected":
        """The same ship and effects at another approach speed.

        Args:
            speed: Approach speed [m/s].

        Returns:
            New dynamics.
        """
        return Affected(self.calm.on_approach(speed), self._effects())
