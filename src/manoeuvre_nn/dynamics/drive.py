"""What drives a ship beside its rudder, as recordings have it: shaft speed and wind."""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from scipy.ndimage import uniform_filter1d
from torch import Tensor

from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.ship import Particulars

GUST = 0.5
"""Window over L/U0 that the wind is averaged over."""


@dataclass(frozen=True)
class Drive:
    """What recordings say of shaft speed and wind.

    Attributes:
        table: n over the nominal shaft speed (approach speed over U0 for a series that does not know n) and the air's
            velocity north and east [m/s], row by row at even times; or whatever columns a model makes use of.
        interval: Time between them [s].
        start: Time of the first since the start of the recording [s].
    """

    table: Float[Tensor, "rows times k"]
    interval: float
    start: float

    def at(self, time: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch k"]:
        """Linear between samples.

        Args:
            time: Time since the start of the recording [s], one for each row; any number where there is but one row.

        Returns:
            The columns of the table: n, north, east.
        """
        last = self.table.shape[1] - 1
        place = ((time - self.start) / self.interval).clamp(0, last)
        k = place.long().clamp(max=last - 1)
        row = torch.arange(len(self.table), device=k.device) if len(self.table) > 1 else torch.zeros_like(k)
        before, after = self.table[row, k], self.table[row, k + 1]
        return before + (place - k)[..., None] * (after - before)

    def row(self, number: int) -> "Drive":
        """One row alone.

        Args:
            number: Its number.

        Returns:
            A drive of one row.
        """
        return Drive(self.table[number : number + 1], self.interval, self.start)


def approach_speed(recording: Recording, ship: Particulars) -> float:
    """Speed at which a run begins.

    Args:
        recording: The run.
        ship: The ship.

    Returns:
        Median of u in the first half ship length [m/s]; U0 where that is within 3 % of it or the ship starts from rest.
    """
    first = recording.time <= recording.time[0] + 0.5 * ship.time_unit
    speed = float(np.median(recording["u"][first]))
    return ship.speed if speed < 0.3 * ship.speed or abs(speed / ship.speed - 1) < 0.03 else speed


def air_velocity(recording: Recording, ship: Particulars) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Velocity of the air over ground from the recorded true wind, averaged over half a ship length's time.

    Gusts that are shorter act on a part of the ship, and an anemometer's errors are in them. On the Esso Osaka model
    the evidence for the runs is highest with about this window.

    Args:
        recording: With ``wind_speed`` [m/s] and ``wind_from`` [rad], or without.
        ship: The ship; its L/U0 sets the window.

    Returns:
        North and east [m/s]; zeros where no wind was recorded.
    """
    if "wind_speed" not in recording.channels:
        return np.zeros(len(recording)), np.zeros(len(recording))
    speed, origin = recording["wind_speed"], recording["wind_from"]
    count = max(1, round(GUST * ship.time_unit / float(np.median(np.diff(recording.time)))))
    north, east = (uniform_filter1d(-speed * f(origin), count, mode="nearest") for f in (np.cos, np.sin))
    return north, east
