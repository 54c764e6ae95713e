"""What recordings say of the inputs beside the rudder: shaft speed, wind and the speed of the approach."""

from collections.abc import Mapping, Sequence

import numpy as np
import torch
from jaxtyping import Float
from scipy.ndimage import uniform_filter1d
from torch import Tensor

from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.core.network import Network
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.dynamics.base import Model

OF_SIDES = {"shaft": "n", "delta_split": "delta_starboard", "shaft_split": "n_starboard"}
"""Inputs of a ship with two rudders and two screws -> channel without which they are not known."""
WIND_WINDOW = 0.5
"""Window over L/U0 that the wind is averaged over."""


def inputs_at(
    columns: Mapping[str, Float[Tensor, "rows times"]], time: float, *, interval: float, start: float
) -> Inputs:
    """Recorded inputs of a batch at a time: linear between samples, held before the first and beyond the last.

    Args:
        columns: Name of an input of :class:`.Inputs` -> its samples, a row each.
        time: When [s].
        interval: Time between samples [s].
        start: Time of the first since the start of the recordings [s].

    Returns:
        The inputs, time among them.
    """
    delta = columns["delta"]
    last = delta.shape[1] - 1
    place = min(max((time - start) / interval, 0.0), last)
    k = max(min(int(place), last - 1), 0)
    after = min(k + 1, last)
    now = {name: c[:, k] + (place - k) * (c[:, after] - c[:, k]) for name, c in columns.items()}
    return Inputs(**now, time=torch.full_like(delta[:, 0], time))


def held_columns(columns: Mapping[str, Sequence[Float[np.ndarray, " _"]]]) -> dict[str, Float[Tensor, "rows times"]]:
    """Columns whose rows may be of different lengths as tensors in double precision: a short row holds its last value.

    Args:
        columns: Name -> samples, a row each.

    Returns:
        The same names.
    """
    longest = max((len(row) for rows in columns.values() for row in rows), default=0)
    made = {}
    for name, rows in columns.items():
        padded = [np.concatenate([row, np.full(longest - len(row), row[-1])]) for row in rows]
        made[name] = torch.tensor(np.stack(padded), dtype=torch.float64)
    return made


def recorded_inputs(
    model: Model, recordings: Sequence[Recording], times: Sequence[Float[np.ndarray, " _"]]
) -> dict[str, list[Float[np.ndarray, " _"]]]:
    """Inputs beside the rudder that a network of the model takes, or a ship of two rudders and screws, from recordings.

    Where the shaft speed was not recorded, it is taken to be that of the approach; where the sides were not recorded
    apart, they are taken to be alike.

    Args:
        model: The model.
        recordings: One for each row of a batch.
        times: Sample times of each row.

    Returns:
        Name of an input -> its samples, a row each; empty for a model that has learnt of the rudder alone.
    """
    taken = {name for part in model.modules() if isinstance(part, Network) for name in part.takes}
    if model.hull.sides == 2:
        taken |= {name for name, told in OF_SIDES.items() if any(told in r.channels for r in recordings)}
    made: dict[str, list] = {name: [] for name in sorted(taken)}
    for recording, at in zip(recordings, times, strict=True):
        ship = model.particulars
        approach = np.full(len(recording), approach_speed(recording, ship) / ship.speed)
        known = "n" in recording.channels
        shaft = recording["n"] * 60 / model.hull.shaft_rpm if known else approach
        north, east = air_velocity(recording, ship)
        values = {"shaft": shaft, "approach": approach, "wind_north": north, "wind_east": east}
        (rudder, other), (n, opposite) = (sided(recording, k, np.zeros(len(recording))) for k in ("delta", "n"))
        values["delta_split"] = 0.5 * (rudder - other)
        values["shaft_split"] = 0.5 * (n - opposite) * 60 / model.hull.shaft_rpm
        for name, rows in made.items():
            rows.append(np.interp(at, recording.time, values[name]))
    return made


def sided(recording: Recording, quantity: str, alike: np.ndarray | None = None) -> list[np.ndarray]:
    """A channel of starboard and port; the mean of both where no more was recorded, ``alike`` without that."""
    mean = recording[quantity] if quantity in recording.channels or alike is None else alike
    names = [f"{quantity}_{side}" for side in ("starboard", "port")]
    return [recording[name] if name in recording.channels else mean for name in names]


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
    count = max(1, round(WIND_WINDOW * ship.time_unit / float(np.median(np.diff(recording.time)))))
    north, east = (uniform_filter1d(-speed * f(origin), count, mode="nearest") for f in (np.cos, np.sin))
    return north, east
