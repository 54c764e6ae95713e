"""Measured files in, recordings out: SI, radians, midship, rudder positive to starboard."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from scipy.integrate import cumulative_trapezoid
from scipy.ndimage import find_objects, label

from manoeuvre_nn.core.channels import PERIODIC
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.frames import body_to_earth, earth_to_body
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.plain_text import listed
from manoeuvre_nn.core.recording import Recording, followed
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.recording.drift import drift_by_arcs, known_drift, without_drift
from manoeuvre_nn.recording.kind import guess_kind
from manoeuvre_nn.recording.local_cubics import WINDOW, smoothed
from manoeuvre_nn.recording.outliers import spikes
from manoeuvre_nn.recording.read.containers import BAG_FOLDER, READERS, is_bag_folder
from manoeuvre_nn.recording.read.mapping import REQUIRED, SIDES, Mapping, with_means
from manoeuvre_nn.recording.read.mapping_file import mapping_of
from manoeuvre_nn.recording.read.mending import line_across, without_delays
from manoeuvre_nn.recording.read.position import local_metres, misplaced
from manoeuvre_nn.recording.read.quantity import COUNT, PAIRS, beyond_all
from manoeuvre_nn.recording.read.table import TEXT, Table, read_table

SAMPLE = "sample"
"""Stands for a folder: the recordings that come with the package, made by ``scripts/sample_recordings.py``."""
MIN_SAMPLES = 20
"""Fewest samples of a recording."""
MIN_LENGTH = 2.0
"""Shortest recording over L/U0."""
MAX_FILLED_CELLS = 3
"""Most samples in a row that ``fill_gaps: true`` fills."""
MAX_OUTLIERS = 0.1
"""Largest share of samples that may be outliers; more are noise."""

Series = Float[np.ndarray, " n"]


def read_recordings(
    where: str | Path | Sequence[str | Path], mapping: Mapping | None, ship: Particulars
) -> list[Recording]:
    """Read several files of one kind, as :func:`read_recording` reads each.

    Args:
        where: A folder (all its files that can be read), a file, a pattern such as ``runs/zz*.csv``, a list of files,
            or ``sample``.
        mapping: Columns, units, signs; None for files that this package wrote.
        ship: The ship.

    Returns:
        Recordings in the order of their names.

    Raises:
        InputError: If no file is found, or one cannot be read.
    """
    if not isinstance(where, (str, Path)):
        return [read_recording(path, mapping, ship) for path in where]
    place = place_of(where)
    if place.is_dir() and not is_bag_folder(place):
        paths = recordings_in(place)
    elif place.exists():
        paths = [place]
    else:
        # A folder's own name may hold brackets or stars: only the last part is taken as a pattern.
        paths = sorted(place.parent.glob(place.name))
    if not paths:
        kinds = " or ".join(suffix.removeprefix(".") for suffix in (".csv", *READERS) if suffix != BAG_FOLDER)
        raise InputError(f"{where}: no {kinds} file there; write a file, a folder or a pattern such as runs/zz*.csv")
    return [read_recording(path, mapping, ship) for path in paths]


def place_of(where: str | Path) -> Path:
    """Where recordings are: the path that is given, or those that come with the package.

    Args:
        where: A path, or ``sample``; something of one's own that is called ``sample`` comes first.

    Returns:
        A path.
    """
    place = Path(where)
    return Path(__file__).parents[1] / SAMPLE if str(where) == SAMPLE and not place.exists() else place


def recordings_in(folder: Path) -> list[Path]:
    """Files of a folder that recordings are read from; ``.txt`` and ``.dat``, which may be notes, in need only."""
    there = sorted(
        p for p in folder.iterdir() if is_bag_folder(p) or (p.is_file() and p.suffix.lower() in (*TEXT, *READERS))
    )
    return [p for p in there if p.suffix.lower() in (".csv", *READERS) or is_bag_folder(p)] or there


def read_recording(path: str | Path, mapping: Mapping | None, ship: Particulars) -> Recording:
    """Read one file.

    Times count from the first sample. u, v, x, y are carried to midship: ``v_mid = v - x_p r``. What a file lacks is
    derived where that can be done: r from psi, u and v from sog, cog and psi, or from x, y and psi by the smoother of
    :mod:`~manoeuvre_nn.estimation.accelerations`; x and y from lat and lon, or by integrating u and v along psi.

    Args:
        path: The file.
        mapping: Columns, units, signs, and what is mended: outliers, gaps, delays; None for a file that this package
            wrote.
        ship: The ship; its L/U0 is what "short" is measured by, and its rudder follows a rudder order.

    Returns:
        The recording; ``meta`` holds ``source``, ``ship``, ``kind``, ``time_unit`` (L/U0 [s]), ``started`` (time of the
        first sample in the file [s]), ``derived`` (channels that the file lacks), ``outliers`` and ``gaps`` (channel ->
        samples that were filled), ``drift`` (a velocity that was taken away) and, with lat and lon, ``origin`` (the
        first fix [deg]). A file that cannot be read raises an :class:`~manoeuvre_nn.core.errors.InputError` that names
        file, line and column.
    """
    mapping = mapping or mapping_of(Path(path))
    run = read_measured(path, mapping, ship)
    if mapping.is_record:
        return run
    kind = run.meta["kind"] or guess_kind(run["delta"])
    return _complete(replace(run, meta={**run.meta, "kind": kind}), WINDOW * ship.time_unit)


def read_measured(path: str | Path, mapping: Mapping, ship: Particulars, leave_gaps: bool = False) -> Recording:
    """Read what a file holds and nothing else: channels that were not recorded are not there.

    Args:
        path: The file.
        mapping: Columns, units, signs, and what is mended.
        ship: The ship, see :func:`read_recording`.
        leave_gaps: Whether holes in time are let pass, and empty cells stay as NaN where the mapping does not say that
            gaps are filled.

    Returns:
        The recording at midship; velocities as u, v or, where the file has them over ground, as vn, ve.
    """
    path = Path(path)
    table = read_table(path, **mapping.table)
    time, rows = _time(table, mapping, ship, leave_gaps)
    names = _recorded_channels(table, mapping, rows)
    made = {name: _channel(table, name, mapping, time, rows, leave_gaps) for name in names}
    channels = {name: values for name, (values, _, _) in made.items()}
    delays = {name: mapping.channels[name].delay for name in names if mapping.channels[name].delay}
    if delays:
        time, channels = without_delays(time, channels, delays)
        _check_length(path, time, mapping, ship)
    meta: dict[str, Any] = {
        "source": str(path),
        "ship": ship.name,
        "kind": mapping.kind,
        "time_unit": ship.time_unit,
        "started": float(time[0]),
        "derived": (),
        "outliers": {name: count for name, (_, count, _) in made.items() if count},
        "gaps": {name: count for name, (_, _, count) in made.items() if count},
    }
    if mapping.is_record:
        return Recording(path.stem, time - time[0], channels, meta=meta)
    channels |= {
        mean: 0.5 * (channels[one] + channels[other])
        for mean, (one, other) in SIDES.items()
        if mean not in channels and one in channels and other in channels
    }
    if mapping.rudder == "order":
        channels["delta_order"] = channels["delta"]
        channels["delta"] = followed(time, channels["delta_order"], ship.rudder_rate)
    if "lat" in channels:
        first = int(np.argmax(np.isfinite(channels["lat"] + channels["lon"])))
        meta["origin"] = tuple(float(channels[k][first]) / DEGREE for k in ("lat", "lon"))
        channels["x"], channels["y"] = local_metres(channels.pop("lat"), channels.pop("lon"))
    if "sog" in channels:
        speed, course = channels.pop("sog"), channels.pop("cog")
        channels["vn"], channels["ve"] = speed * np.cos(course), speed * np.sin(course)
        channels = {name: values for name, values in channels.items() if name not in {"u", "v"}}
    elif mapping.frame == "earth" and "u" in channels:
        channels["vn"], channels["ve"] = channels.pop("u"), channels.pop("v")
    run = Recording(path.stem, time - time[0], channels, meta=meta)
    return _without_drift(_at_midship(run, mapping, WINDOW * ship.time_unit), mapping)


def _recorded_channels(table: Table, mapping: Mapping, rows: slice) -> list[str]:
    """Channels of the mapping that the file holds, pairs complete."""
    if not mapping.optional:
        return list(mapping.channels)
    file, headings = table.path.name, list(table.cells.columns)
    column = {name: c.column for name, c in mapping.channels.items()}
    there = [name for name in column if column[name] in headings]
    full = {name for name in there if np.isfinite(table.numbers(column[name])[rows]).sum() >= MIN_SAMPLES}
    for name in REQUIRED:
        if name not in with_means(full):
            said = column.get(name, name)
            raise InputError(f"{file}: column {said!r} holds no numbers; a manoeuvre needs heading and rudder")
    halves = {a: b for pair in PAIRS for a, b in (pair, pair[::-1]) if a in column and b in column}
    for name, partner in halves.items():
        if name in full and partner not in there:
            hint = f"; if it is the log's speed {column.get('u_log', 'u_log')}, rename it" if name == "u" else ""
            if name not in {"x", "y"}:
                raise InputError(f"{file}: column {column[name]!r} stands without {column[partner]!r}{hint}")
    kept = [name for name in there if name in full and halves.get(name, name) in full]
    if not any(a in kept for a, _ in PAIRS):
        pairs = " or ".join(f"{column[a]}, {column[dict(PAIRS)[a]]}" for a in column if a in dict(PAIRS))
        raise InputError(f"{file}: neither position nor velocity: it needs {pairs}; it has: {listed(headings)}")
    return kept


def _time(table: Table, mapping: Mapping, ship: Particulars, leave_gaps: bool) -> tuple[Series, slice]:
    """Sample times [s] and rows of the window asked for, refused unless times increase steadily for long enough."""
    column = mapping.time.column
    time = table.times(column, mapping.time.unit, mapping.time_zone)
    table.check_rises(column, time)
    time = time * mapping.factor("time")
    since = time - time[0] if len(time) else time
    first = int(np.searchsorted(since, (mapping.start or 0.0) - 1e-9))
    last = len(time) if mapping.end is None else int(np.searchsorted(since, mapping.end + 1e-9))
    rows = slice(first, last)
    _check_length(table.path, time[rows], mapping, ship)
    steps = np.diff(time[rows])
    if leave_gaps:
        table.check_holes(column, time[rows], first)
    if not leave_gaps and steps.max() > max(ship.time_unit, 5 * np.median(steps)):
        row = first + int(np.argmax(steps)) + 1
        raise table.error(
            column, row, f"jumps by {steps.max():.4g} s; cut the file in two at this hole, or write start: or end: "
            f"(this is {since[row]:.6g} s after the first sample)"
        )  # fmt: skip
    return time[rows], rows


def _check_length(path: Path, time: Series, mapping: Mapping, ship: Particulars) -> None:
    """Refuse what is too short for the ship's motion to be seen."""
    length = time[-1] - time[0] if len(time) else 0.0
    shortest = 0.0 if mapping.is_record else MIN_LENGTH * ship.time_unit
    if len(time) >= MIN_SAMPLES and length >= shortest:
        return
    window = "" if mapping.start is None and mapping.end is None else " between start and end"
    raise InputError(
        f"{path.name}: too short a record: {len(time)} samples over {length:.4g} s{window}; the {ship.name} needs at "
        f"least {MIN_SAMPLES} samples and {shortest:.4g} s ({MIN_LENGTH:g} L/U0): give a longer one, or "
        f"mind the unit of time (now {mapping.time.unit})"
    )


def _channel(
    table: Table, name: str, mapping: Mapping, time: Series, rows: slice, leave_gaps: bool
) -> tuple[Series, int, int]:
    """A column in SI, directions made continuous; how many outliers and how many empty cells were filled."""
    where = mapping.channels[name]
    column = where.column
    values = (table.numbers(column)[rows] - where.offset) * mapping.factor(name)
    lost = np.isnan(values)
    if lost.all():
        raise InputError(f"{table.path.name}: column {column!r} is empty; leave {name} out of the mapping")
    far = beyond_all(name, values) & (where.unit != COUNT)
    if far.any() and mapping.outliers == "keep":
        row = rows.start + int(np.argmax(far))
        raise table.error(
            column, row, f"is {table.numbers(column)[row]:.6g} {where.unit}, which no ship and no instrument can mean: "
            "empty the cell, mind the unit, or write outliers: fill"
        )  # fmt: skip
    values[far] = np.nan  # filled with the other outliers
    given = values.copy()
    if name in PERIODIC and where.unit != COUNT:
        there = ~(lost | far)
        values[there] = np.unwrap(values[there])
    odd = far | spikes(values) if mapping.outliers == "fill" else far
    if odd.mean() > MAX_OUTLIERS:
        raise InputError(
            f"{table.path.name}: {odd.mean():.0%} of column {column!r} lie far off their neighbours: that is noise, "
            "not outliers; write outliers: keep"
        )
    nowhere, why = misplaced(name, np.where(odd, np.nan, given))
    if nowhere.any() and where.unit != COUNT:
        row = rows.start + int(np.argmax(nowhere))
        raise table.error(column, row, f"is {table.numbers(column)[row]:.6g} {where.unit}, {why}")
    values = np.where(lost, np.nan, line_across(time, values, odd | lost))
    if not lost.any() or (leave_gaps and mapping.fill_gaps is False):
        return values, int(odd.sum()), 0
    if not mapping.fill_gaps:
        raise table.error(
            column, rows.start + int(np.argmax(lost)), f"is the first of {lost.sum()} empty cells; write fill_gaps: "
            "true, or cut them out"
        )  # fmt: skip
    _check_gaps(table, column, mapping.fill_gaps, time, lost, rows.start)
    return line_across(time, values, lost), int(odd.sum()), int(lost.sum())


def _check_gaps(
    table: Table, column: str, fill_gaps: bool | float, time: Series, lost: Bool[np.ndarray, " n"], first: int
) -> None:
    """Refuse gaps that are too long to be bridged, and those at the ends."""
    for (gap,) in find_objects(label(lost)[0]):
        count, at_end = gap.stop - gap.start, gap.start == 0 or gap.stop == len(lost)
        if fill_gaps is True:
            allowed, too_long = str(MAX_FILLED_CELLS), count > MAX_FILLED_CELLS
        else:
            allowed = f"{fill_gaps:g} s"
            too_long = not at_end and time[gap.stop] - time[gap.start - 1] > fill_gaps + 1e-9
        if at_end or too_long:
            raise table.error(
                column, first + gap.start, f"begins a gap of {count} cells; only gaps of up to {allowed} between "
                "samples are filled: cut the file there, or write start: and end:",
            )  # fmt: skip


def _at_midship(run: Recording, mapping: Mapping, window: float) -> Recording:
    """Velocities and positions of midship where the file has those of another point of the ship."""
    forward, of_fix = mapping.reference_point, mapping.position_point
    c = dict(run.channels)
    if forward and ("v" in c or "vn" in c):
        rate = c["r"] if "r" in c else smoothed(run.time, run.filled("psi"), window)[1]
        sideways = forward * rate
        if "v" in c:
            c["v"] = c["v"] - sideways
        if "vn" in c:
            c["vn"], c["ve"] = c["vn"] + sideways * np.sin(c["psi"]), c["ve"] - sideways * np.cos(c["psi"])
    of_position = forward if of_fix is None else of_fix
    if of_position and "x" in c:
        c["x"], c["y"] = c["x"] - of_position * np.cos(c["psi"]), c["y"] - of_position * np.sin(c["psi"])
    return replace(run, channels=c)


def _without_drift(run: Recording, mapping: Mapping) -> Recording:
    """The recording without a drift over ground, where the mapping asks for that."""
    if not isinstance(mapping.drift, str):
        return without_drift(run, known_drift(**mapping.drift))
    if mapping.drift == "keep" or (mapping.kind or guess_kind(run.filled("delta"))) != "turning_circle":
        return run
    return without_drift(run, drift_by_arcs(run))


def _complete(run: Recording, window: float) -> Recording:
    """Velocities in body axes, and what the file lacks derived."""
    c, time = dict(run.channels), run.time
    if "vn" in c and "u" not in c:
        c["u"], c["v"] = earth_to_body(c.pop("vn"), c.pop("ve"), c["psi"])
    derived = tuple(name for name in ("u", "v", "r", "x", "y") if name not in c)
    if "r" not in c:
        c["r"] = smoothed(time, c["psi"], window)[1]
    if "u" not in c:
        north, east = smoothed(time, c["x"], window)[1], smoothed(time, c["y"], window)[1]
        c["u"], c["v"] = earth_to_body(north, east, c["psi"])
    if "x" not in c:
        north, east = body_to_earth(c["u"], c["v"], c["psi"])
        c["x"], c["y"] = (cumulative_trapezoid(rate, time, initial=0.0) for rate in (north, east))
    return replace(run, channels=c, meta={**run.meta, "derived": derived})
