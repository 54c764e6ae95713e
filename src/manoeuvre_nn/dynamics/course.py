"""Recorded runs in dimensionless time: tables to look up at any time, and their steps of constant length in L/U."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Float, Int
from scipy.interpolate import CubicSpline
from torch import Tensor

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.dynamics.recorded_inputs import air_velocity, held_columns, sided

FROM_REST = 0.05
"""Speed over the ship's own below which a run starts from rest."""
SAMPLES_PER_STEP = 4
"""Samples of a table in the shortest step, so that lines between them are the curve."""


@dataclass(frozen=True)
class TimeTable:
    """Quantities of several runs at even dimensionless times from 0 on, linear in between and held beyond the end.

    Attributes:
        values: Samples.
        interval: Time between them, of each row.
    """

    values: Float[Tensor, "rows samples columns"]
    interval: Float[Tensor, " rows"]

    @cached_property
    def _with_slopes(self) -> Float[Tensor, "cells twice"]:
        """Each sample beside its difference to the next: one look-up for both."""
        after = torch.cat([self.values[:, 1:], self.values[:, -1:]], dim=1)
        return torch.cat([self.values, after - self.values], dim=-1).flatten(0, 1)

    def rows(self, which: Int[Tensor, " some"]) -> "Lookup":
        """Some of the runs, each as often as it is named."""
        count = self.values.shape[1]
        return Lookup(self._with_slopes, which * count, self.interval[which].reciprocal(), count - 1)


@dataclass(frozen=True)
class Lookup:
    """Rows of a table.

    Attributes:
        cells: Samples and differences of all runs, one after the other.
        first: Where each row begins.
        per_time: Samples in a unit of time, of each row.
        last: Number of the last sample.
    """

    cells: Float[Tensor, "cells twice"]
    first: Int[Tensor, " rows"]
    per_time: Float[Tensor, " rows"]
    last: int

    def at(self, time: Float[Tensor, "rows *times"]) -> Float[Tensor, "rows *times columns"]:
        """Values at times of each row; gradients pass to the times."""
        more = (slice(None), *[None] * (time.ndim - 1))
        place = (time * self.per_time[more]).clamp(0, self.last)
        low = place.detach().long()
        found = self.cells[self.first[more] + low]
        value, slope = found.chunk(2, dim=-1)
        return torch.addcmul(value, slope, (place - low)[..., None])


@dataclass(frozen=True)
class Course:
    """What drove recorded runs and how they went, non-dimensional by L and each run's approach speed.

    Attributes:
        controls: Rudder angles of starboard and port [rad], shaft speeds n L/U0 likewise, then, where it is asked for,
            the velocity of the air over ground, north and east.
        motion: Velocities of the network, its angles (phi, psi), x, y.
        speed: Approach speeds U0 [m/s].
        length: L [m].
        duration: Length of each run in L/U0.
    """

    controls: TimeTable
    motion: TimeTable
    speed: Float[Tensor, " rows"]
    length: float
    duration: Float[Tensor, " rows"]

    def to(self, like: Tensor) -> "Course":
        """The same in another floating type or on another device."""
        controls, motion = (TimeTable(t.values.to(like), t.interval.to(like)) for t in (self.controls, self.motion))
        return Course(controls, motion, self.speed.to(like), self.length, self.duration.to(like))

    def count(self, step: float) -> int:
        """Number of steps in which the longest run is over."""
        return self.steps(step).shape[1]

    def steps(self, step: float) -> Float[Tensor, "rows steps"]:
        """Times of the steps, ``t + step / U(t)`` with the recorded speed, until every run is over.

        Args:
            step: Length of a step in L/U.

        Returns:
            Times in L/U0, from 0.

        Source:
            Hess & Faller 2000, eq 2.
        """
        look, time = self.motion.rows(torch.arange(len(self.speed), device=self.speed.device)), [self.duration * 0]
        while bool((time[-1] < self.duration).any()):
            speed = torch.linalg.vector_norm(look.at(time[-1])[:, :2], dim=-1)
            time.append(time[-1] + step / speed.clamp(min=step))
        return torch.stack(time[:-1] if len(time) > 1 else time, dim=1)


def start_speed(recording: Recording, ship: Ship) -> float:
    """Speed at which a run begins, by which it is made dimensionless.

    Args:
        recording: The run.
        ship: The ship.

    Returns:
        Speed at the first sample [m/s]; the ship's own for a run that starts from rest, slower than .05 of it.
    """
    own, speed = ship.particulars.speed, float(np.hypot(recording["u"][0], recording["v"][0]))
    return speed if speed > FROM_REST * own else own


def course_of(
    recordings: Sequence[Recording], ship: Ship, velocities: Sequence[str], *, step: float, wind: bool = False
) -> Course:
    """Recordings in dimensionless time.

    Args:
        recordings: What was recorded; smooth channels, since they are interpolated by splines.
        ship: The ship, for L, and for the shaft speed where none was recorded.
        velocities: Those of the network.
        step: Length of a step in L/U.
        wind: Whether the wind is among the controls.

    Returns:
        The course, in double precision. A recording that lacks a channel is refused.
    """
    length = ship.particulars.length
    speeds = [start_speed(r, ship) for r in recordings]
    controls, motions, intervals = [], [], []
    for recording, speed in zip(recordings, speeds, strict=True):
        unit = length / speed
        time = (recording.time - recording.time[0]) / unit
        fastest = float(np.hypot(recording["u"], recording["v"]).max()) / speed
        grid = np.arange(0.0, time[-1] + 1e-9, step / max(fastest, 0.1) / SAMPLES_PER_STEP)
        intervals.append(grid[1])
        motion = CubicSpline(time, _motion(recording, velocities, length, speed), axis=0)(grid)
        motions.append(motion)
        driving = np.stack(_controls(recording, ship, speed, wind), axis=-1)
        controls.append(np.stack([np.interp(grid, time, column) for column in driving.T], axis=-1))
    interval = torch.tensor(intervals, dtype=torch.float64)
    ends = torch.tensor([len(m) - 1 for m in motions], dtype=torch.float64) * interval
    tables = [TimeTable(_held(parts), interval) for parts in (controls, motions)]
    return Course(tables[0], tables[1], torch.tensor(speeds, dtype=torch.float64), length, ends)


def _held(parts: Sequence[np.ndarray]) -> Float[Tensor, "rows samples columns"]:
    """Tables of different lengths as one tensor: a short one holds its last sample."""
    columns = held_columns({str(k): [part[:, k] for part in parts] for k in range(parts[0].shape[1])})
    return torch.stack(list(columns.values()), dim=-1)


def _motion(recording: Recording, velocities: Sequence[str], length: float, speed: float) -> np.ndarray:
    """Velocities, angles, x and y over L, from the position of the start."""
    missing = [name for name in velocities if name not in recording.channels]
    if missing:
        raise InputError(
            f"recording {recording.name} has no channel {missing[0]}, which the network predicts: write "
            "network.freedom=3 for one of u, v and r"
        )
    rate = length / speed
    columns = [recording[name] * (rate if name in "pqr" else 1 / speed) for name in velocities]
    for angle, of in (("phi", "p"), ("theta", "q"), ("psi", "r")):
        if of in velocities:
            columns.append(recording[angle])
    return np.stack([*columns, *((recording[k] - recording[k][0]) / length for k in ("x", "y"))], axis=-1)


def _controls(recording: Recording, ship: Ship, speed: float, wind: bool) -> list[np.ndarray]:
    """Rudder angles and shaft speeds of both sides, and the air's velocity."""
    # Without a record the shaft turns as on an approach at this speed.
    approach = ship.shaft_rpm / 60 * speed / ship.particulars.speed
    shafts = sided(recording, "n", np.full(len(recording), approach))
    made = [*sided(recording, "delta"), *(n * ship.particulars.length / speed for n in shafts)]
    return [*made, *(air / speed for air in air_velocity(recording, ship.particulars))] if wind else made
