"""What recordings say of the inputs beside the rudder: shaft speed, wind and the speed of the approach."""

from collections.abc import Iterator, Mapping, Sequence
from functools import cache

import numpy as np
import torch
from jaxtyping import Float
from numpy.polynomial import legendre
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


def step_inputs(
    columns: Mapping[str, Float[Tensor, "rows times"]],
    ends: Float[np.ndarray, " k"],
    *,
    interval: float,
    start: float,
) -> Iterator[tuple[Inputs, Inputs, Inputs]]:
    """Recorded inputs of a batch at the start, in the middle and at the end of every Runge-Kutta step.

    They are linear between samples. Over a step of several samples they are the parabola with the same mean and the
    same first and second moments: the part that is left out moves the ship by a fourth power of the step.
    ``q = sum_l (2 l + 1)/2 P_l(x) int_-1^1 P_l(y) c(y) dy``, ``P_l`` the Legendre polynomials up to the second.

    Args:
        columns: Name of an input of :class:`.Inputs` -> its samples, a row each.
        ends: Where the first step begins and every step ends, in samples: parts of one, or whole numbers.
        interval: Time between samples [s].
        start: Time of the first since the start of the recordings [s].

    Yields:
        The inputs, time among them.
    """
    delta = columns["delta"]
    for begin, end in zip(ends[:-1], ends[1:], strict=True):
        points, weights = _moments(max(1, round(end - begin)))
        at = 0.5 * (begin + end) + 0.5 * (end - begin) * points
        before = at.astype(int)
        share, weighing = delta.new_tensor(at - before), delta.new_tensor(weights)
        parabolas = {name: torch.lerp(c[:, before], c[:, before + 1], share) @ weighing for name, c in columns.items()}
        times = (start + interval * (begin + share * (end - begin)) for share in (0.0, 0.5, 1.0))
        now, midway, then = (
            Inputs(**{name: c[:, k] for name, c in parabolas.items()}, time=torch.full_like(delta[:, 0], time))
            for k, time in enumerate(times)
        )
        yield now, midway, then


@cache
def _moments(samples: int) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
    """Places in [-1, 1] at which a line broken at samples is taken, and the weights by which these give its parabola.

    Returns:
        Places; weights of the parabola's values at -1, 0 and 1.
    """
    gauss, share = legendre.leggauss(2)  # exact for a line times a parabola, from sample to sample
    points = ((2 * np.arange(samples)[:, None] + 1 + gauss) / samples - 1).ravel()
    projected = legendre.legvander(points, 2) * np.tile(share, samples)[:, None] / samples * (np.arange(3) + 0.5)
    return points, projected @ legendre.legvander(np.array([-1.0, 0.0, 1.0]), 2).T


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
