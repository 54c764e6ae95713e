"""What acts on a ship beside her state: rudder, shaft and wind, at one time or recorded over time."""

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor


@dataclass(frozen=True)
class Inputs:
    """Inputs of the equations of motion; tensors that broadcast against each other over the batch.

    Attributes:
        delta: Angle of the rudder blade [rad], positive turns to starboard.
        shaft: Recorded shaft speed over the nominal one [-]; None if none was: it is nominal, or what an effect makes.
        wind_north: Velocity of the air over ground, north [m/s]; None is calm.
        wind_east: East [m/s].
        approach: Speed at which the run began, over U0 [-]; None is U0.
        time: Time since the start of the recording [s]; None is 0.
    """

    delta: Float[Tensor, "..."]
    shaft: Float[Tensor, "..."] | None = None
    wind_north: Float[Tensor, "..."] | None = None
    wind_east: Float[Tensor, "..."] | None = None
    approach: Float[Tensor, "..."] | None = None
    time: Float[Tensor, "..."] | None = None

    @property
    def given(self) -> dict[str, Tensor]:
        """The inputs that are not None, by their names."""
        return {name: value for name, value in vars(self).items() if value is not None}


@dataclass(frozen=True)
class InputTable:
    """Recorded inputs of the rows of a batch at even times.

    Attributes:
        columns: Name of an input of :class:`Inputs` -> its samples, a row each.
        interval: Time between samples [s].
        start: Time of the first sample since the start of the recordings [s].
    """

    columns: Mapping[str, Float[Tensor, "rows times"]]
    interval: float
    start: float = 0.0

    def at(self, time: float) -> Inputs:
        """Inputs of all rows at a time [s]: linear between samples, held before the first and beyond the last."""
        delta = self.columns["delta"]
        last = delta.shape[1] - 1
        place = min(max((time - self.start) / self.interval, 0.0), last)
        k = max(min(int(place), last - 1), 0)
        after = min(k + 1, last)
        now = {name: c[:, k] + (place - k) * (c[:, after] - c[:, k]) for name, c in self.columns.items()}
        return Inputs(**now, time=torch.full_like(delta[:, 0], time))
