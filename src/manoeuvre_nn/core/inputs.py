"""What acts on a ship beside her state: rudder, shaft and wind."""

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor


@dataclass(frozen=True)
class Inputs:
    """Inputs of the equations of motion; tensors that broadcast against each other over the batch.

    Attributes:
        delta: Angle of the rudder blade, of two rudders their mean [rad], positive turns to starboard.
        shaft: Recorded shaft speed, of two shafts their mean, over the nominal one [-]; None if none was: it is
            nominal, or what an effect makes.
        wind_north: Velocity of the air over ground, north [m/s]; None is calm.
        wind_east: East [m/s].
        approach: Speed at which the run began, over U0 [-]; None is U0.
        time: Time since the start of the recording [s]; None is 0.
        delta_split: Half of what the starboard rudder has more than the port one [rad]; None is 0.
        shaft_split: Likewise of the shafts, over the nominal shaft speed [-]; None is 0.
        phi: Recorded heel [rad], for effects of heel on a ship that is held upright; None lets them find their own.
        p: Its rate [rad/s].
        pdot: Its acceleration [rad/s^2].
    """

    delta: Float[Tensor, "..."]
    shaft: Float[Tensor, "..."] | None = None
    wind_north: Float[Tensor, "..."] | None = None
    wind_east: Float[Tensor, "..."] | None = None
    approach: Float[Tensor, "..."] | None = None
    time: Float[Tensor, "..."] | None = None
    delta_split: Float[Tensor, "..."] | None = None
    shaft_split: Float[Tensor, "..."] | None = None
    phi: Float[Tensor, "..."] | None = None
    p: Float[Tensor, "..."] | None = None
    pdot: Float[Tensor, "..."] | None = None

    @property
    def given(self) -> dict[str, Tensor]:
        """The inputs that are not None, by their names."""
        return {name: value for name, value in vars(self).items() if value is not None}
