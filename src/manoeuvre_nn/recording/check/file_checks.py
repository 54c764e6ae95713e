"""What a file lacks, cell by cell: empty cells, holes in time, with the setting of the mapping that mends each."""

from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.recording.check.finding import LEAVE_OUT, Change, Finding
from manoeuvre_nn.recording.check.samples import MAX_BRIDGED_GAP, REPLACEMENTS, piece
from manoeuvre_nn.recording.read.mapping import Mapping
from manoeuvre_nn.recording.read.reader import MAX_FILLED_CELLS, MIN_LENGTH
from manoeuvre_nn.recording.read.table import read_table

MOSTLY = 0.3
"""Share of empty cells from which on a column is of no use."""

Series = Float[np.ndarray, " n"]
Lost = dict[str, Bool[np.ndarray, " n"]]


def file_findings(path: Path, mapping: Mapping, ship: Particulars) -> list[Finding]:
    """Empty cells, holes, and what its reader left out, before a file is read; none where a complaint says more."""
    try:
        table = read_table(path, **mapping.table)
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
    notes = [Finding("reading", "note", note.rstrip(".")) for note in table.notes]
    return [*notes, *_empty(time, cells, mapping, ship), *_holes(time, ship)]


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
    found_empty = partial(
        Finding, "empty cells", "refuse", text, tuple(rest), measured=float(longest), unit="s", expected="none",
        spans=tuple((float(a), float(b)) for a, b, _ in runs),
    )  # fmt: skip
    if ends or longest > MAX_BRIDGED_GAP * ship.time_unit:
        remedy, changes = _longest_piece(time, np.any(list(rest.values()), axis=0), ship)
        return [*found, found_empty(remedy=remedy, changes=changes)]
    short = max(count for *_, count in runs) <= MAX_FILLED_CELLS
    if short if mapping.fill_gaps is True else mapping.fill_gaps >= longest:
        return found
    value = True if short else float(np.ceil(10 * longest) / 10)
    remedy = "fill them by straight lines"
    return [*found, found_empty(remedy=remedy, changes=(Change("fill_gaps", value=value),))]


def _holes(time: Series, ship: Particulars) -> list[Finding]:
    """Holes in time that the reader refuses."""
    steps = np.diff(time)
    wide = np.flatnonzero(steps > max(ship.time_unit, 5 * float(np.median(steps))))
    if not len(wide):
        return []
    text = f"{len(wide)} hole{'s' if len(wide) > 1 else ''} in time, the longest of {steps.max():.4g} s"
    remedy, changes = _window(np.split(np.arange(len(time)), wide + 1), time, ship)[:2]
    return [
        Finding(
            "gaps", "refuse", text, measured=float(steps.max()), unit="s", remedy=remedy, changes=changes,
            expected=f"below {MAX_BRIDGED_GAP * ship.time_unit:.3g} s",
            spans=tuple((float(time[k]), float(time[k + 1])) for k in wide),
        )
    ]  # fmt: skip


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


def _longest_piece(time: Series, lost: Bool[np.ndarray, " n"], ship: Particulars) -> tuple[str, tuple[Change, ...]]:
    """The longest piece without long gaps; short ones in it are filled."""
    rows = np.flatnonzero(~lost)
    breaks = np.flatnonzero(np.diff(time[rows]) > MAX_BRIDGED_GAP * ship.time_unit)
    remedy, changes, best = _window(np.split(rows, breaks + 1), time, ship)
    if lost[best[0] : best[-1]].any():
        value = float(np.ceil(10 * np.diff(time[best]).max()) / 10)
        return f"{remedy}, and fill the short gaps in it", (*changes, Change("fill_gaps", value=value))
    return remedy, changes


def _window(
    pieces: list[np.ndarray], time: Series, ship: Particulars
) -> tuple[str, tuple[Change, ...], Int[np.ndarray, " k"]]:
    """Keep the longest of several pieces, if it is long enough: remedy, changes, and its rows."""
    best = max(pieces, key=lambda rows: time[rows[-1]] - time[rows[0]])
    begin, end = float(time[best[0]]), float(time[best[-1]])
    if end - begin < MIN_LENGTH * ship.time_unit:
        return f"no piece is as long as {MIN_LENGTH:g} L/U0: give another record", (), best
    return *piece(begin, end, begin > time[0], end < time[-1]), best
