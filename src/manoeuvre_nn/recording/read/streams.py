"""Sensors that were written down at times of their own, put on one axis of time."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import pandas as pd
from jaxtyping import Float

MAX_STEPS = 3.5
"""Samples of a sensor that lie further apart, over its usual step, have a hole between them."""
MIN_SHARE = 0.8
"""Sensors that were on for a smaller share of the record neither lead nor bound it."""
MIN_LEADING = 20
"""Samples of a sensor that may lead."""

Series = Float[np.ndarray, " n"]


@dataclass(frozen=True)
class Stream:
    """Columns that one sensor wrote down together.

    Attributes:
        time: Times of its samples [s], in the order of the file; NaN where there is none.
        columns: Column -> samples; NaN where there is none.
        leads: Whether the sensor measures the motion or the rudder: of such the slowest gives the axis.
        circles: Column of an angle -> full circle in its unit.
    """

    time: Series
    columns: Mapping[str, Series]
    leads: bool = True
    circles: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class _Samples:
    """One column: its samples in the order of time, angles continuous."""

    time: Series
    values: Series
    leads: bool

    @property
    def step(self) -> float:
        """Usual time between samples [s]."""
        return float(np.median(np.diff(self.time))) if len(self.time) > 1 else np.inf

    @property
    def span(self) -> float:
        """Time from the first sample to the last [s]."""
        return float(self.time[-1] - self.time[0])


def on_one_axis(streams: Sequence[Stream], wanted: Sequence[str] | None, dated: bool) -> pd.DataFrame:
    """Put sensors on one axis of time.

    The axis are the samples of the slowest sensor of motion or rudder that is wanted: it keeps its samples as they are.
    Where all columns are asked for, used or not, it is the one of median step. Every other is read off at these times
    by a line between its own two neighbours, an angle the short way round. Where these lie further apart than 3.5 of
    its usual steps, a cell is empty.

    Args:
        streams: The sensors.
        wanted: Columns that the axis is made for; None is all.
        dated: Whether times count from 1970; else they are seconds.

    Returns:
        The column ``time`` (dates) or ``time [s]``, and all columns; no row if no sensor has samples.
    """
    sensors = {name: _sensor(stream, name) for stream in streams for name in stream.columns}
    there = {name: one for name, one in sensors.items() if len(one.time)}
    asked = {name: one for name, one in there.items() if wanted is None or name in wanted} or there
    name = "time" if dated else "time [s]"
    if not asked:
        return pd.DataFrame(columns=[name, *sensors])
    longest = max(one.span for one in asked.values())
    lasting = [one for one in asked.values() if one.span >= MIN_SHARE * longest]
    leading = [one for one in lasting if one.leads and len(one.time) >= MIN_LEADING] or lasting
    by_step = sorted(leading, key=lambda one: one.step)
    leader = by_step[len(by_step) // 2 if wanted is None else -1]
    first, last = max(one.time[0] for one in lasting), min(one.time[-1] for one in lasting)
    axis = leader.time[(leader.time >= first) & (leader.time <= last)]
    columns = {k: _at(axis, there[k]) if k in there else np.full(len(axis), np.nan) for k in sensors}
    times = pd.Series(np.round(axis * 1e6).astype("datetime64[us]")) if dated else pd.Series(axis)
    return pd.DataFrame({name: times, **columns})


def _sensor(stream: Stream, name: str) -> _Samples:
    """Samples of a column in the order of time; of several at one time the first."""
    values = stream.columns[name]
    there = np.isfinite(values) & np.isfinite(stream.time)
    time, first = np.unique(stream.time[there], return_index=True)
    values = values[there][first]
    if name in stream.circles:
        values = np.unwrap(values, period=stream.circles[name])
    return _Samples(time, values, stream.leads)


def _at(axis: Series, sensor: _Samples) -> Series:
    """A sensor at some times; NaN in its holes, and before and after its samples."""
    read = np.interp(axis, sensor.time, sensor.values, left=np.nan, right=np.nan)
    after = np.clip(np.searchsorted(sensor.time, axis), 0, len(sensor.time) - 1)
    apart = sensor.time[after] - sensor.time[np.maximum(after - 1, 0)]
    return np.where((apart > MAX_STEPS * sensor.step) & (sensor.time[after] != axis), np.nan, read)
