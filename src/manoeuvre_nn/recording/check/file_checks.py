"""What a file lacks, cell by cell: empty cells, holes in time, with the setting of the mapping that mends each."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.ship import Particulars
from manoeuvre_nn.recording.check.finding import LEAVE_OUT, Change, Finding
from manoeuvre_nn.recording.check.samples import MAX_BRIDGED_GAP, REPLACEMENTS
from manoeuvre_nn.recording.read.mapping import Mapping
from manoeuvre_nn.recording.read.reader import MAX_FILLED_CELLS, MIN_LENGTH
from manoeuvre_nn.recording.read.table import read_table

MOSTLY = 0.3
"""Share of empty cells from which on a column is of no use."""

Series = Float[np.ndarray, " n"]
Lost = dict[str, Bool[np.ndarray, " n"]]


def file_findings(path: Path, mapping: Mapping, ship: Particulars) -> list[Finding]:
    """Empty cells and holes of a file, before it is read.

    Args:
        path: The file.
        mapping: Columns and units.
        ship: The ship; its L/U0 is what gaps are measured by.

    Returns:
        Findings; none where all is there, or where the reader's own complaint says more.
    """
    try:
        table = read_table(path, mapping)
        time = table.times(mapping.time.column, mapping.time.unit, mapping.time_zone)
        there = {k: c.column for k, c in mapping.channels.items() if c.column in table.cells.columns}
        cells = {k: np.isnan(table.numbers(column)) for k, column in there.items()}
    except InputError:
        return []
    time = (time - time[0]) * mapping.factor("time") if len(time) else time
    if len(time) < 2 or np.isnan(time).any() or (np.diff(time) <= 0).any():
        return []
    inside = (time >= (mapping.start or 0.0) - 1e-9) & (time <= (mapping.end or np.inf) + 1e-9)
    time, cells = time[inside], {k: lost[inside] for k, lost in cells.items()}
    if len(time) < 2:
        return []
    return [*_empty(time, cells, mapping, ship), *_holes(time, mapping, ship)]


def _empty(time: Series, cells: Lost, mapping: Mapping, ship: Particulars) -> list[Finding]:
    """Empty cells: filled where the gap is short, else the column or the piece is left out."""
    useless = [k for k, lost in cells.items() if lost.mean() > MOSTLY and k in {*REPLACEMENTS, "n", "delta_order"}]
    found = [_useless(k, float(cells[k].mean())) for k in useless]
    rest = {k: lost for k, lost in cells.items() if k not in useless and lost.any()}
    if not rest:
        return found
    runs = [(time[max(a - 1, 0)], time[min(b + 1, len(time) - 1)], b - a + 1) for a, b in _spans_of(rest)]
    ends = any(lost[0] or lost[-1] for lost in rest.values())
    longest = max(end - begin for begin, end, _ in runs)
    text = "empty cells: " + ", ".join(f"{int(lost.sum())} of {k}" for k, lost in rest.items())
    text += f"; the longest gap lasts {longest:.3g} s"
    spans = tuple((float(a), float(b)) for a, b, _ in runs)
    said: dict[str, Any] = {"measured": float(longest), "unit": "s", "expected": "none", "spans": spans}
    if not ends and longest <= MAX_BRIDGED_GAP * ship.time_unit:
        short = max(count for *_, count in runs) <= MAX_FILLED_CELLS
        value = True if short else float(np.ceil(10 * longest) / 10)
        if mapping.fill_gaps is True and short or (mapping.fill_gaps is not True and mapping.fill_gaps >= longest):
            return found
        filled = (Change("fill_gaps", value=value),)
        remedy = "fill them by straight lines"
        return [*found, Finding("empty cells", "refuse", text, tuple(rest), remedy=remedy, changes=filled, **said)]
    remedy, changes = _longest_piece(time, np.any(list(rest.values()), axis=0), mapping, ship)
    return [*found, Finding("empty cells", "refuse", text, tuple(rest), remedy=remedy, changes=changes, **said)]


def _holes(time: Series, mapping: Mapping, ship: Particulars) -> list[Finding]:
    """Holes in time that the reader refuses."""
    steps = np.diff(time)
    wide = steps > max(ship.time_unit, 5 * float(np.median(steps)))
    if not wide.any():
        return []
    spans = tuple((float(time[k]), float(time[k + 1])) for k in np.flatnonzero(wide))
    text = f"{int(wide.sum())} hole{'s' if wide.sum() > 1 else ''} in time, the longest of {steps.max():.4g} s"
    pieces = np.split(np.arange(len(time)), np.flatnonzero(wide) + 1)
    best = max(pieces, key=lambda p: time[p[-1]] - time[p[0]])
    remedy, changes = _window(time[best[0]], time[best[-1]], time, ship)
    said: dict[str, Any] = {
        "measured": float(steps.max()),
        "unit": "s",
        "expected": f"below {MAX_BRIDGED_GAP * ship.time_unit:.3g} s",
    }
    return [Finding("gaps", "refuse", text, remedy=remedy, changes=changes, spans=spans, **said)]


def _useless(name: str, share: float) -> Finding:
    """A column that is mostly empty and that something replaces."""
    group, instead = REPLACEMENTS.get(name, ((name,), "nothing needs it"))
    changes = tuple(Change(f"channels.{k}", value=LEAVE_OUT) for k in group)
    text = f"{share:.0%} of the cells of {name} are empty"
    remedy = f"leave {name} out of the mapping; {instead}"
    return Finding("empty cells", "refuse", text, (name,), 100 * share, unit="%", remedy=remedy, changes=changes)


def _spans_of(cells: Lost) -> list[tuple[int, int]]:
    """First and last rows of all runs of empty cells."""
    spans = []
    for lost in cells.values():
        rows = np.flatnonzero(lost)
        spans += [(int(r[0]), int(r[-1])) for r in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)]
    return spans


def _longest_piece(
    time: Series, lost: Bool[np.ndarray, " n"], mapping: Mapping, ship: Particulars
) -> tuple[str, tuple[Change, ...]]:
    """The longest piece without long gaps; short ones in it are filled."""
    rows = np.flatnonzero(~lost)
    breaks = np.flatnonzero(np.diff(time[rows]) > MAX_BRIDGED_GAP * ship.time_unit)
    pieces = np.split(rows, breaks + 1)
    best = max(pieces, key=lambda p: time[p[-1]] - time[p[0]])
    remedy, changes = _window(time[best[0]], time[best[-1]], time, ship)
    inner = np.diff(time[best])
    if lost[best[0] : best[-1]].any():
        value = float(np.ceil(10 * inner.max()) / 10)
        return f"{remedy}, and fill the short gaps in it", (*changes, Change("fill_gaps", value=value))
    return remedy, changes


def _window(
    begin: float, end: float, time: Sequence[float] | Series, ship: Particulars
) -> tuple[str, tuple[Change, ...]]:
    """Keep a piece of the record."""
    if end - begin < MIN_LENGTH * ship.time_unit:
        return f"no piece is as long as {MIN_LENGTH:g} L/U0: give another record", ()
    changes = []
    if begin > time[0]:
        changes.append(Change("start", value=float(np.ceil(begin * 1e3 - 1e-6) / 1e3)))
    if end < time[-1]:
        changes.append(Change("end", value=float(np.floor(end * 1e3 + 1e-6) / 1e3)))
    return f"keep the piece from {begin:.6g} to {end:.6g} s", tuple(changes)
