"""Measured files in, recordings out: SI, radians, midship, rudder positive to starboard."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.integrate import cumulative_trapezoid

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.frames import body_to_earth, earth_to_body
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.ship import Particulars
from manoeuvre_nn.recording.accelerations import WINDOW, smoothed
from manoeuvre_nn.recording.kind import guess_kind
from manoeuvre_nn.recording.mapping import Mapping
from manoeuvre_nn.recording.table import Table, read_table

FEWEST = 20
"""Fewest samples of a recording."""
SHORTEST = 2.0
"""Shortest recording over L/U0."""
LONGEST_GAP = 3
"""Most samples in a row that ``fill_gaps`` fills."""

Channels = dict[str, Float[np.ndarray, " n"]]


def read_recordings(where: str | Path | Sequence[str | Path], mapping: Mapping, ship: Particulars) -> list[Recording]:
    """Read several files of one kind.

    Args:
        where: A folder (all its csv files), a file, a pattern such as ``runs/zz*.csv``, or a list of files.
        mapping: Columns, units, signs.
        ship: The ship.

    Returns:
        Recordings in the order of their names.

    Raises:
        InputError: If no file is found, or one cannot be read.
    """
    if not isinstance(where, (str, Path)):
        return [read_recording(path, mapping, ship) for path in where]
    place = Path(where)
    if place.is_dir():
        paths = sorted(place.glob("*.csv"))
    elif place.exists():
        paths = [place]
    else:
        # A folder's own name may hold brackets or stars: only the last part is taken as a pattern.
        paths = sorted(place.parent.glob(place.name))
    if not paths:
        raise InputError(f"{where}: no csv file there; write a file, a folder or a pattern such as runs/zz*.csv")
    return [read_recording(path, mapping, ship) for path in paths]


def read_recording(path: str | Path, mapping: Mapping, ship: Particulars) -> Recording:
    """Read one file.

    Times count from the first sample. u, v, x, y are carried to midship: ``v_mid = v - x_p r``. What a file lacks is
    derived where that can be done: r from psi, u and v from x, y and psi by the smoother of
    :mod:`~manoeuvre_nn.recording.accelerations`; x and y by integrating u and v along psi. A file that cannot be read
    raises an :class:`~manoeuvre_nn.core.errors.InputError` that names file and line.

    Args:
        path: The file.
        mapping: Columns, units, signs.
        ship: The ship; its L/U0 is what "short" is measured by.

    Returns:
        The recording; ``meta`` holds ``source``, ``ship``, ``kind``, ``time_unit`` (L/U0 [s]), ``started`` (time of the
        first sample in the file [s]) and ``derived`` (channels that the file lacks).
    """
    path = Path(path)
    table = read_table(path, mapping)
    time = _time(table, mapping, ship)
    channels = {name: _channel(table, name, mapping, time) for name in mapping.channels}
    derived = tuple(k for k in ("u", "v", "r", "x", "y") if k not in channels)
    channels = _at_midship(_complete(time, channels, mapping, WINDOW * ship.time_unit), mapping.reference_point)
    meta = {
        "source": str(path),
        "ship": ship.name,
        "kind": mapping.kind or guess_kind(channels["delta"]),
        "time_unit": ship.time_unit,
        "started": float(time[0]),
        "derived": derived,
    }
    return Recording(path.stem, time - time[0], channels, meta=meta)


def _time(table: Table, mapping: Mapping, ship: Particulars) -> Float[np.ndarray, " n"]:
    """Sample times [s], refused unless they increase steadily for long enough."""
    column = mapping.time.column
    time = table.numbers(column)
    if np.isnan(time).any():
        raise table.error(column, int(np.argmax(np.isnan(time))), "is empty; a sample without a time cannot be used")
    steps = np.diff(time)
    if (steps <= 0).any():
        row = int(np.argmax(steps <= 0)) + 1
        raise table.error(column, row, f"goes from {time[row - 1]:g} to {time[row]:g}; times must increase")
    time = time * mapping.factor("time")
    length = time[-1] - time[0] if len(time) else 0.0
    if len(time) < FEWEST or length < SHORTEST * ship.time_unit:
        raise InputError(
            f"{table.path.name}: too short a record: {len(time)} samples over {length:.4g} s; the {ship.name} needs at "
            f"least {FEWEST} samples and {SHORTEST * ship.time_unit:.4g} s ({SHORTEST:g} L/U0): give a longer one, or "
            f"mind the unit of time (now {mapping.time.unit})"
        )
    steps = np.diff(time)
    if steps.max() > max(ship.time_unit, 5 * np.median(steps)):
        row = int(np.argmax(steps)) + 1
        raise table.error(column, row, f"jumps by {steps.max():.4g} s; cut the file in two at this hole")
    return time


def _channel(table: Table, name: str, mapping: Mapping, time: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """A column in SI with its gaps filled; headings made continuous."""
    column = mapping.channels[name].column
    values = table.numbers(column) * mapping.factor(name)
    lost = np.isnan(values)
    if lost.all():
        raise InputError(f"{table.path.name}: column {column!r} is empty; leave {name} out of the mapping")
    if name == "psi":
        values[~lost] = np.unwrap(values[~lost])
    if not lost.any():
        return values
    first = int(np.argmax(lost))
    if not mapping.fill_gaps:
        raise table.error(
            column, first, f"is the first of {lost.sum()} empty cells; write fill_gaps: true, or cut them out"
        )
    runs = np.split(np.flatnonzero(lost), np.flatnonzero(np.diff(np.flatnonzero(lost)) > 1) + 1)
    for run in runs:
        if len(run) > LONGEST_GAP or run[0] == 0 or run[-1] == len(values) - 1:
            raise table.error(
                column, int(run[0]), f"begins a gap of {len(run)} cells; only gaps of up to {LONGEST_GAP} between "
                "samples are filled: cut the file there",
            )  # fmt: skip
    return np.where(lost, np.interp(time, time[~lost], values[~lost]), values)


def _complete(time: Float[np.ndarray, " n"], given: Channels, mapping: Mapping, window: float) -> Channels:
    """Derive what the file lacks; velocities come out in body axes."""
    c = dict(given)
    if "r" not in c:
        c["r"] = smoothed(time, c["psi"], window)[1]
    if not {"u", "v"} <= set(c):
        north, east = smoothed(time, c["x"], window)[1], smoothed(time, c["y"], window)[1]
        c["u"], c["v"] = earth_to_body(north, east, c["psi"])
    elif mapping.frame == "earth":
        c["u"], c["v"] = earth_to_body(c["u"], c["v"], c["psi"])
    if not {"x", "y"} <= set(c):
        north, east = body_to_earth(c["u"], c["v"], c["psi"])
        c["x"], c["y"] = (cumulative_trapezoid(rate, time, initial=0.0) for rate in (north, east))
    return c


def _at_midship(c: Channels, forward: float) -> Channels:
    """Carry u, v, x, y from a point forward of midship to midship."""
    north, east = body_to_earth(np.full_like(c["psi"], forward), np.zeros_like(c["psi"]), c["psi"])
    return {**c, "v": c["v"] - forward * c["r"], "x": c["x"] - north, "y": c["y"] - east}
