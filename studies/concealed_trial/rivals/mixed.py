"""Effects of many cases in one batch: every block of rows has an effect of its own, and a ship with errors of its own.

One rollout then serves all cases of a ship: what a batch costs beside its arithmetic is paid once.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from typing import ClassVar

import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.effect import Effect, Parameter, PerRow, Situation
from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.core.ship import Ship
from studies.concealed_trial.rivals.package import Corrections, Model

Block = tuple[slice, Effect]
"""Rows, and the effect that acts on them, its values one row each."""


class MixedEffect(Effect):
    """A different effect in every block of rows.

    Attributes:
        blocks: Rows and effects; no row stands in two of them.
    """

    name = "mixed"
    site = "hull"
    family = "mixed"
    label = "one of many effects"
    equations: ClassVar[tuple[str, ...]] = ()
    fingerprint = "None: it is for making data."
    source = "None"
    declared: ClassVar[tuple[Parameter, ...]] = ()

    def __init__(self, ship: Ship, blocks: Sequence[Block]) -> None:
        """Take the blocks.

        Args:
            ship: The ship.
            blocks: Rows and effects.
        """
        super().__init__(ship)
        self.blocks = list(blocks)
        self.memory = max((e.memory for _, e in self.blocks), default=0)  # type: ignore[misc]

    def stream(self, s: Situation) -> Float[Tensor, "*batch 2"]:
        """That of each row's effect."""
        return self._filled(torch.zeros_like(s.nu[..., :2]), "stream", lambda rows, e: e.stream(_of(s, rows)))

    def acceleration(self, s: Situation, memory: Float[Tensor, "*batch m"]) -> Float[Tensor, "*batch 3"]:
        """That of each row's effect."""

        def one(rows: slice, e: Effect) -> Tensor:
            return e.acceleration(_of(s, rows), memory[rows][..., : e.memory])

        out = self._filled(torch.zeros_like(s.nu), "acceleration", one)
        for rows, e in self.blocks:
            if e.overrides("force") and not e.overrides("acceleration"):
                out[rows] = one(rows, e)
        return out

    def memory_at_start(self, s: Situation) -> Float[Tensor, "*batch m"]:
        """Those of each row's effect, and zeros."""
        return self._own(s, lambda rows, e: e.memory_at_start(_of(s, rows)))

    def memory_rate(self, s: Situation, memory: Float[Tensor, "*batch m"]) -> Float[Tensor, "*batch m"]:
        """Those of each row's effect, and zeros."""
        return self._own(s, lambda rows, e: e.memory_rate(_of(s, rows), memory[rows][..., : e.memory]))

    def shaft(self, s: Situation, memory: Float[Tensor, "*batch m"]) -> Float[Tensor, "*batch"]:
        """That of each row's effect."""
        one = lambda rows, e: e.shaft(_of(s, rows), memory[rows][..., : e.memory])  # noqa: E731
        return self._filled(torch.ones_like(s.delta), "shaft", one)

    def blade(self, before: PerRow, order: PerRow, shown: PerRow, elapsed: PerRow) -> PerRow:
        """That of each row's effect."""
        seen = [x.expand(shown.shape) for x in (before, order, shown, elapsed)]
        return self._filled(shown.clone(), "blade", lambda rows, e: e.blade(*(x[rows] for x in seen)))

    def record(self, channels: Mapping[str, Tensor], s: Situation) -> dict[str, Tensor]:
        """What each row's recorder writes."""
        out = {name: values.clone() for name, values in channels.items()}
        for rows, e in self.blocks:
            if e.overrides("record"):
                for name, values in e.record({k: c[rows] for k, c in channels.items()}, _of(s, rows)).items():
                    out[name][rows] = values
        return out

    def _filled(self, out: Tensor, what: str, one: Callable[[slice, Effect], Tensor]) -> Tensor:
        """A tensor with the rows of those effects replaced that have something to say."""
        for rows, e in self.blocks:
            if getattr(type(e), what) is not getattr(Effect, what):
                out[rows] = one(rows, e)
        return out

    def _own(self, s: Situation, one: Callable[[slice, Effect], Tensor]) -> Tensor:
        """Own states or their rates."""
        out = s.nu.new_zeros(*s.nu.shape[:-1], self.memory)
        for rows, e in self.blocks:
            if e.memory:
                out[rows, ..., : e.memory] = one(rows, e)
        return out


def _of(s: Situation, rows: slice) -> Situation:
    """What some of the rows see."""
    parts = {f.name: getattr(s, f.name) for f in fields(s)}
    return replace(s, **{name: x[rows] for name, x in parts.items() if x is not None})


class ScatteredShip(Model):
    """A calm-water model whose coefficients are off in every row, with a coloured force.

    Attributes:
        calm: The model.
        shares: Relative error of every correction in every row.
        rough: Accelerations once a second [m/s^2, m/s^2, rad/s^2].
    """

    shares: Tensor
    rough: Tensor

    def __init__(self, calm: Model, shares: Float[Tensor, "rows k"], rough: Float[Tensor, "rows seconds 3"]) -> None:
        """Store the errors."""
        super().__init__()
        self.calm, self._corrections = calm, Corrections(calm)
        self.register_buffer("shares", shares)
        self.register_buffer("rough", rough)

    @property
    def hull(self) -> Ship:
        """That of the model."""
        return self.calm.hull

    def forward(self, state: Float[Tensor, "rows n"], inputs: Inputs) -> Float[Tensor, "rows n"]:
        """Rate of the state with the errors."""
        assert inputs.time is not None
        off = self._corrections(state[..., :3], inputs.delta, inputs.shaft)
        second = inputs.time.long().clamp(max=self.rough.shape[1] - 1)
        off = torch.einsum("rk,rkm->rm", self.shares, off) + self.rough[torch.arange(len(second)), second]
        return self.calm(state, inputs) + torch.nn.functional.pad(off, (0, state.shape[-1] - 3))

    def on_approach(self, speed: float) -> "ScatteredShip":
        """The same errors at another approach speed."""
        return ScatteredShip(self.calm.on_approach(speed), self.shares, self.rough)
