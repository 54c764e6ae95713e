"""A calm-water model bound to the shaft speeds that runs recorded."""

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.ship import Particulars, Ship
from manoeuvre_nn.dynamics.base import Dynamics
from manoeuvre_nn.dynamics.drive import Drive


def with_recorded_shaft(
    calm: Dynamics, shafts: Sequence[Float[np.ndarray, " _"]], start: float, step: float
) -> Dynamics:
    """A model whose rows are bound to recorded shaft speeds.

    Args:
        calm: Calm-water model.
        shafts: Shaft speed over the nominal one at even times, a row each; the last value of a short one stands [-].
        start: Time of the first value [s].
        step: Time between values [s].

    Returns:
        The model itself where every shaft speed is nominal all the time.
    """
    if all((s == 1).all() for s in shafts):
        return calm
    longest = max(map(len, shafts))
    table = np.stack([np.concatenate([s, np.full(longest - len(s), s[-1])]) for s in shafts])
    return _Turning(calm, Drive(torch.tensor(table)[..., None], step, start))


class _Turning(Dynamics):
    """A calm-water model and the shaft speeds of its rows."""

    def __init__(self, calm: Dynamics, drive: Drive) -> None:
        super().__init__()
        self.calm, self.drive = calm, drive

    @property
    def particulars(self) -> Particulars:
        """Those of the model."""
        return self.calm.particulars

    @property
    def hull(self) -> Ship:
        """That of the model."""
        return self.calm.hull

    def acceleration(self, nu: Float[Tensor, "*batch 3"], delta: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch 3"]:
        """Accelerations at the nominal shaft speed."""
        return self.calm.acceleration(nu, delta)

    def at_shaft(
        self, nu: Float[Tensor, "*batch 3"], delta: Float[Tensor, "*batch"], shaft: Float[Tensor, "*batch"]
    ) -> Float[Tensor, "*batch 3"]:
        """Accelerations at a shaft speed."""
        return self.calm.at_shaft(nu, delta, shaft)

    def turns(self, time: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch"]:
        """Recorded shaft speed over the nominal one."""
        return self.drive.at(time)[..., 0]

    def on_approach(self, speed: float) -> "_Turning":
        """The same at another approach speed."""
        return _Turning(self.calm.on_approach(speed), self.drive)
