"""A ship that is steered and recorded: model, steering gear and sensors, and what effects do to each of them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import torch
from jaxtyping import Float
from torch import Tensor, nn

from manoeuvre_nn.core.effect import Effect, Situation
from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.dynamics.base import Model, ModelAround

AT_REST_S = 1e6
"""Time after which every rudder has come to rest [s]; finite, since a rate of 0 times infinity is no number."""


class _Affected(ModelAround):
    """A calm-water model and effects on top, itself a model.

    The state is u, v, r *through the water*, x, y, psi over ground, the model's own states, then those of the
    effects. A uniform current therefore changes the track and nothing else (Fossen 2012; Hegrenaes & Hallingstad 2011).
    Several effects add their accelerations, which are those of the ship as effects on her inertia have changed her, her
    coefficients corrected where the model corrects them. Own states are driven by the accelerations of the model and of
    the effects without own states: a wind, too, heels a ship that it pushes sideways.

    Attributes:
        calm: The calm-water model: a reference ship or an identified one.
        effects: What acts on it.
    """

    def __init__(self, calm: Model, effects: Sequence[Effect]) -> None:
        """Join model and effects."""
        super().__init__(calm)
        self.effects = nn.ModuleList(e.aboard(calm.corrected(e.ship)) for e in effects)

    def forward(self, state: Float[Tensor, "*batch n"], inputs: Inputs) -> Float[Tensor, "*batch n"]:
        """Rate of the state: in calm water, and what every effect adds."""
        s, motion, rolling = self._seen(state, inputs)
        added, heeling, own, driven = None, torch.zeros_like(s.u), [], None
        # What an effect does not do is left out: where few rows are sailed, the number of operations takes the time.
        for effect, memory in sorted(self._memories(state), key=lambda one: bool(one[0].memory)):
            if effect.memory and driven is None:
                driven = s if added is None else s.with_(nudot=s.nudot + added)
            here = s if driven is None else driven
            if effect.overrides("force", "acceleration"):
                caused = effect.acceleration(here, memory)
                for hull in () if effect in self._hulls else self._hulls:
                    caused = hull.with_changed_inertia(s, caused)
                added = caused if added is None else added + caused
            if effect.overrides("stream"):
                motion = motion + nn.functional.pad(effect.stream(s), (0, 1))
            if effect.memory:
                own.append(effect.memory_rate(here, memory))
            if self.own_names:
                heeling = heeling + effect.heeling(s)
        if added is None:
            return torch.cat([s.nudot, motion, rolling, *own], dim=-1)
        added, roll = self.hull.added(added, heeling)
        return torch.cat([s.nudot + added, motion, rolling + roll, *own], dim=-1)

    def start(self, state: Float[Tensor, "*batch 6"], inputs: Inputs) -> Float[Tensor, "*batch n"]:
        """A state with the effects' own states as on a steady approach."""
        s = _situation(state, torch.zeros_like(state[..., :3]), Inputs(inputs.delta))
        return torch.cat([self.calm.start(state, inputs), *(e.memory_at_start(s) for e in self._effects)], dim=-1)

    def situation(self, state: Float[Tensor, "*batch n"], inputs: Inputs) -> Situation:
        """What effects without own states see, accelerations being those of calm water."""
        return self._seen(state, inputs)[0]

    def on_approach(self, speed: float) -> "_Affected":
        """The same ship and effects at another approach speed; what effects do follows the ship."""
        calm = self.calm.on_approach(speed)
        return _Affected(calm, [e.aboard(calm.hull) for e in self._effects])

    @cached_property
    def _effects(self) -> list[Effect]:
        """The effects as such, for the type checker."""
        return list(self.effects)  # type: ignore[arg-type]

    @cached_property
    def _hulls(self) -> list[Effect]:
        """Those that change the ship's inertia."""
        return [e for e in self._effects if e.overrides("with_changed_inertia")]

    def _memories(self, state: Tensor) -> list[tuple[Effect, Tensor]]:
        """Every effect with its part of the state."""
        own, sizes = state[..., self._calm_size :], [e.memory for e in self._effects]
        parts = own.split(sizes, dim=-1) if any(sizes) else [own] * len(sizes)
        return list(zip(self._effects, parts, strict=True))

    @property
    def _calm_size(self) -> int:
        """Number of states of the calm-water model."""
        return 6 + len(self.own_names)

    def _seen(self, state: Tensor, inputs: Inputs) -> tuple[Situation, Tensor, Tensor]:
        """What the effects see, the motion over ground in still water, and the rates of the model's own states."""
        shaft = inputs.shaft
        if shaft is None:  # what was recorded holds, whatever an engine would make of the shaft
            shaft = self._shaft(state, inputs)
            inputs = inputs if shaft is None else replace(inputs, shaft=shaft)
        rate = self.calm(state[..., : self._calm_size], inputs)
        return _situation(state, rate[..., :3], inputs), rate[..., 3:6], rate[..., 6:]

    def _shaft(self, state: Tensor, inputs: Inputs) -> Tensor | None:
        """Shaft speed that the engines among the effects make, over the nominal one; None if there is no engine."""
        if not any(e.overrides("shaft") for e in self._effects):
            return None
        shaft = torch.ones_like(inputs.delta)
        s = _situation(state, torch.zeros_like(state[..., :3]), inputs)
        for effect, own in self._memories(state):
            if effect.overrides("shaft"):
                shaft = shaft * effect.shaft(s, own)
        return shaft


def _situation(state: Tensor, nudot: Tensor, inputs: Inputs) -> Situation:
    """What effects see at a state, its calm-water accelerations and inputs; the shaft is nominal if none is given."""
    x, y, psi = state[..., 3:6].unbind(-1)
    time = torch.zeros_like(inputs.delta) if inputs.time is None else inputs.time
    shaft = torch.ones_like(inputs.delta) if inputs.shaft is None else inputs.shaft
    heel = None
    if inputs.phi is not None and inputs.p is not None and inputs.pdot is not None:
        heel = torch.stack([inputs.phi, inputs.p, inputs.pdot], dim=-1)
    return Situation(state[..., :3], nudot, x, y, psi, inputs.delta, shaft, time, heel)


@dataclass(frozen=True)
class RudderGear:
    """From the helm's order and the angle that the rudder indicator shows to the rudder blade.

    In a sound gear the blade is where the indicator shows it.

    Attributes:
        effects: What acts on a ship; what does not touch its rudder is passed over.
    """

    effects: Sequence[Effect] = ()

    @cached_property
    def _faults(self) -> list[Effect]:
        """What lies between the rudder indicator and the blade, in the order in which it acts."""
        return [e for e in self.effects if e.overrides("blade")]

    def after(
        self,
        before: Float[Tensor, "*#batch k"],
        order: Float[Tensor, "*#batch"],
        shown: Float[Tensor, "*#batch"],
        elapsed: Float[Tensor, "*#batch"],
    ) -> Float[Tensor, "*#batch k"]:
        """Rudder angles behind every fault in turn after a time in which the indicator moved evenly.

        Args:
            before: The angles at the start of the time, one column a fault [rad].
            order: Helm order during it [rad].
            shown: Indicated angle at its end [rad].
            elapsed: The time [s].

        Returns:
            The angles at its end [rad]; the last column is that of the blade.
        """
        angles = []
        for k, fault in enumerate(self._faults):
            shown = fault.blade(before[..., k], order, shown, elapsed)
            angles.append(shown)
        return torch.stack(angles or [shown], dim=-1)

    def at_rest(self, delta: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch k"]:
        """What :meth:`after` tends to when the helm has stood still for long."""
        before = torch.stack([delta] * max(len(self._faults), 1), dim=-1)
        return self.after(before, delta, delta, torch.full_like(delta, AT_REST_S))

    def indicated(
        self, recorded: Float[Tensor, "*batch n"], ordered: Float[Tensor, " n"] | None, time: Float[Tensor, " n"]
    ) -> Float[Tensor, "*batch n"]:
        """What the rudder indicator showed [rad]: every effect's record undone, the last one's first."""
        for effect in reversed(self.effects):
            recorded = effect.indicated(recorded, ordered, time)
        return recorded


@dataclass(frozen=True)
class Recorder:
    """What is written down of a moving ship; u and v are no sensor's.

    Attributes:
        effects: What acts on a ship; what is no sensor's error is passed over.
    """

    effects: Sequence[Effect] = ()

    def record(
        self, s: Situation, rates: Float[Tensor, "*batch n"], shown: Float[Tensor, "*batch"]
    ) -> dict[str, Tensor]:
        """What perfect sensors would write, changed by every effect in turn.

        Args:
            s: What the effects see, time in the last batch dimension.
            rates: Rates of the state.
            shown: Indicated rudder angle [rad].

        Returns:
            x, y [m], vn, ve (over ground) [m/s], psi [rad], r [rad/s], u_log [m/s], delta [rad] and shaft [-].
        """
        north, east = rates[..., 3:5].unbind(-1)
        channels = {"x": s.x, "y": s.y, "vn": north, "ve": east, "psi": s.psi, "r": s.r, "u_log": s.u}
        channels |= {"delta": shown, "shaft_recorded": s.shaft}
        for effect in self.effects:
            channels = effect.record(channels, s)
        return {"shaft" if name == "shaft_recorded" else name: values for name, values in channels.items()}


@dataclass(frozen=True)
class Vessel:
    """What solvers take: a model, its steering gear and its sensors.

    Attributes:
        calm: The calm-water model: a reference ship or an identified one.
        effects: What acts on it, on its steering gear and on its sensors.
    """

    calm: Model
    effects: Sequence[Effect] = ()

    @cached_property
    def model(self) -> Model:
        """The equations of motion, with the effects where there are some."""
        return _Affected(self.calm, self.effects) if self.effects else self.calm

    @cached_property
    def gear(self) -> RudderGear:
        """From orders to the rudder blade."""
        return RudderGear(self.effects)

    @cached_property
    def sensors(self) -> Recorder:
        """What is written down."""
        return Recorder(self.effects)

    def situation(self, states: Float[Tensor, "*batch n"], inputs: Inputs) -> Situation:
        """What the effects see, accelerations being those of calm water."""
        return _Affected(self.calm, self.effects).situation(states, inputs)

    def on_approach(self, speed: float) -> "Vessel":
        """The same vessel coming in at another speed [m/s]; what effects do follows the ship."""
        calm = self.calm.on_approach(speed)
        return Vessel(calm, [e.aboard(calm.hull) for e in self.effects])


def as_vessel(ship: Model | Vessel) -> Vessel:
    """A vessel as it is; a model with a sound steering gear and nothing recorded beside its state."""
    return ship if isinstance(ship, Vessel) else Vessel(ship)


def in_words(effects: Sequence[Effect]) -> str:
    """``a steady wind (speed=12 m/s, from_deg=90) and ...``; parameters of a formula where they are not the usual."""
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
