"""What a file that was written on purpose means, found out without the package: units, texts and tables of its own."""

import csv
import io
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from math import inf, isfinite, pi
from pathlib import Path
from typing import Any, Literal

import numpy as np

import manoeuvre_nn as mnn

SHIPS = ("mariner", "esso_190k", "container", "great_lakes_bulker")
TRIALS = ("zz20", "tc25", "zz10", "random")
ANGLES, RATES, SPEEDS = {"rad": 1.0, "deg": pi / 180}, {"rad/s": 1.0, "deg/s": pi / 180, "deg/min": pi / 10800}, {
    "m/s": 1.0, "kn": 1852 / 3600, "km/h": 1 / 3.6
}  # fmt: skip
LENGTHS, SHAFTS = {"m": 1.0, "ft": 0.3048, "km": 1000.0}, {"1/s": 1.0, "rpm": 1 / 60}
UNITS: dict[str, dict[str, float]] = {
    "u": SPEEDS, "v": SPEEDS, "r": RATES, "x": LENGTHS, "y": LENGTHS, "psi": ANGLES, "delta": ANGLES, "n": SHAFTS,
    "sog": SPEEDS, "cog": ANGLES, "time": {"s": 1.0, "ms": 0.001, "min": 60.0, "h": 3600.0, "d": 86400.0},
}  # fmt: skip
"""Channel -> unit -> its value in SI. Written down again: the package's own table is what is tried."""
PERIODIC = ("psi", "cog")
NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")
EMPTY = ("", "nan", "na", "n/a", "null", "none", "-")
IMPOSSIBLE = 1e8
"""No channel reaches this in SI; the package may refuse less."""
TURN = 2 * pi

Said = dict[str, Any]
"""A mapping as its yaml says it."""


@dataclass(frozen=True)
class Tried:
    """One attack, made ready.

    Attributes:
        what: What was done.
        work: Reads what was written, in a process of its own, and says what is wrong with the answer; nothing if it is
            right. It may end with an error as a command does.
        must: What has to come of it: ``read``, ``refuse``, or ``either`` a refusal or the right answer.
        names: Words of which a refusal names at least one: the file or the setting.
    """

    what: str
    work: Callable[[], str]
    must: Literal["read", "refuse", "either"] = "either"
    names: tuple[str, ...] = ()


@cache
def sailed(ship: str) -> Any:
    """Runs of a ship, without noise."""
    return mnn.simulate(ship, [*TRIALS[:3], {"random": {"duration": 300}}])


def meaning(table: dict[str, list[Any]] | str, said: Said, ship: Any) -> dict[str, np.ndarray] | str:
    """What channels a table holds by its mapping, in SI; or why it has to be refused.

    Args:
        table: Heading -> cells, texts or numbers; or what is wrong with it already.
        said: The mapping: columns, units, signs, offsets, scales and the rudder's side alone.
        ship: The ship, for the shortest record.

    Returns:
        Channels with ``time``, or the reason.
    """
    if isinstance(table, str):
        return table
    found: dict[str, np.ndarray] = {}
    entries = {"time": said["time"], **said["channels"]}
    for name, entry in entries.items():
        if entry["column"] not in table:
            return f"there is no column {entry['column']}"
        cells = [_number(cell, said.get("decimal", "point")) for cell in table[entry["column"]]]
        if None in cells:
            return f"{entry['column']} is no number"
        values = np.array(cells, dtype=float)
        side = -1 if name == "delta" and said.get("rudder_positive_to") == "port" else 1
        factor = entry.get("sign", 1) * side * entry.get("scale", 1.0) * UNITS[name][entry["unit"]]
        values = (values - entry.get("offset", 0.0)) * factor
        if np.isnan(values).any():
            return f"{name} has an empty cell"
        if np.isinf(values).any() or np.abs(values - (np.median(values) if name in "xy" else 0)).max() > IMPOSSIBLE:
            return f"{name} is endless"
        found[name] = np.unwrap(values) if name in PERIODIC else values
    return _why_no_time(found["time"], ship) or _in_time(found, {k: e.get("delay", 0) for k, e in entries.items()})


def _in_time(found: dict[str, np.ndarray], late: dict[str, float]) -> dict[str, np.ndarray]:
    """Channels that were written down too late, put where they belong; the ends, where one has no sample, are cut."""
    time = found["time"]
    if not any(late.values()):
        return found
    kept = time[(time + min(0, *late.values()) >= time[0] - 1e-9) & (time + max(0, *late.values()) <= time[-1] + 1e-9)]
    return {k: kept if k == "time" else np.interp(kept + late[k], time, v) for k, v in found.items()}


def _why_no_time(time: np.ndarray, ship: Any) -> str:
    """Why times cannot be used; nothing if they can."""
    if len(time) < 20 or time[-1] - time[0] < 2 * ship.time_unit:
        return "it is too short"
    steps = np.diff(time)
    if not (steps > 0).all():
        return "times do not increase"
    if steps.max() > max(ship.time_unit, 5 * np.median(steps)) * 1.000001:
        return "there is a hole in time"
    return ""


def _number(cell: Any, decimal: str) -> float | None:
    """A cell as a number, NaN for an empty one, None for what is none."""
    if not isinstance(cell, str):
        return float(cell)
    text = cell.strip()
    if text.lower() in EMPTY:
        return np.nan
    if decimal == "comma":
        text = text.replace(".", "?").replace(",", ".")
    return float(text) if NUMBER.fullmatch(text) else inf if text.lower().strip("+-") in {"inf", "infinity"} else None


def cells_of(raw: bytes, said: Said) -> dict[str, list[str]] | str:
    """The cells of a text by their headings, as anybody would read them; or why nobody can."""
    wide = raw.startswith((b"\xff\xfe", b"\xfe\xff"))
    if not raw.strip():
        return "it is empty"
    if b"\0" in raw and not wide:
        return "it is no text"
    try:
        text = raw.decode("utf-16" if wide else "utf-8-sig")
    except UnicodeDecodeError:
        text = raw.decode("latin-1")
    lines = re.split("\r\n|\n|\r", text)[said.get("skip_rows", 0) :]
    rows = [_cut(line, said.get("delimiter", ",")) for line in lines if line.strip(" \t,;")]
    if len(rows) < 2:
        return "it has no line of numbers"
    wanted = {entry["column"] for entry in (said["time"], *said["channels"].values())}
    if said.get("header", True):
        headings, rows = [cell.strip() for cell in rows[0]], rows[1:]
    else:
        headings = [str(k + 1) for k in range(len(rows[0]))]
    if any(headings.count(column) != 1 for column in wanted):
        return "a column is missing or stands twice"
    if any(len(row) != len(headings) for row in rows):
        return "a line is cut or too long"
    return {heading: [row[k] for row in rows] for k, heading in enumerate(headings)}


def _cut(line: str, delimiter: str) -> list[str]:
    """A line's cells."""
    if delimiter == "whitespace":
        return line.split()
    csv.field_size_limit(10**9)
    return next(csv.reader(io.StringIO(line, newline=""), delimiter=delimiter), [])


def table_of(path: Path) -> dict[str, list[Any]] | str:
    """The columns of a MAT or parquet file, by their own libraries; or that they cannot be read."""
    from pyarrow import parquet
    from scipy.io import loadmat

    try:
        if path.suffix == ".mat":
            given = {k: np.ravel(v) for k, v in loadmat(path).items() if not k.startswith("__")}
        else:
            table = parquet.read_table(path).replace_schema_metadata(None)  # pandas' notes are not asked
            given = {k: v.to_numpy() for k, v in table.to_pandas(ignore_metadata=True).items()}
    except Exception as error:  # noqa: BLE001 - whatever they raise, the file cannot be read
        return f"{type(error).__name__} by its own library"
    return {k: list(v) for k, v in given.items()}


def difference(run: Any, expected: dict[str, np.ndarray], tolerance: float = 1e-6) -> str:
    """What of a recording is not what it should be; nothing if it is.

    Args:
        run: As read.
        expected: ``time`` and channels in SI; times count from the first, angles are alike that differ by whole turns.
        tolerance: Largest difference over the channel's spread and size.

    Returns:
        The channel and how far it is off.
    """
    since = expected["time"] - expected["time"][0]
    if len(run) != len(since):
        return f"{len(run)} samples instead of {len(since)}"
    for name, values in {**expected, "time": since}.items():
        got = run.time if name == "time" else run[name]
        if name in PERIODIC:
            values = values + TURN * np.round((got[0] - values[0]) / TURN)
        off = float(np.abs(got - values).max())
        if not off <= tolerance * (1e-3 + float(np.abs(values).max())):
            return f"{name} is off by {off:.3g}"
    return ""


def is_number(value: Any) -> bool:
    """Whether yaml or JSON made a finite number of it."""
    return isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)
