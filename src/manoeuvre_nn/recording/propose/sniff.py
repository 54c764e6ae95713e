"""What a file's columns look like before anybody has said so: delimiter, headings, time, numbers."""

import re
from collections import Counter
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from jaxtyping import Float

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.plain_text import listed
from manoeuvre_nn.recording.propose.headings import Heading, take_apart
from manoeuvre_nn.recording.read.containers import reader_of
from manoeuvre_nn.recording.read.dates import DATED
from manoeuvre_nn.recording.read.mapping import Mapping
from manoeuvre_nn.recording.read.table import Table, numbers_in, read_table
from manoeuvre_nn.recording.read.text import EMPTY, cells_of, is_blank, lines_of

DELIMITERS = (",", ";", "\t", "|", "whitespace")
LOOKED_AT = 400
"""Lines that the layout is guessed from."""
NUMBER = {
    "point": re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eEdD][+-]?\d+)?"),
    "comma": re.compile(r"[+-]?(\d+(,\d*)?|,\d+)([eEdD][+-]?\d+)?"),
}
STAMP = re.compile(r"\d{4}-\d\d-\d\d([T ]\d\d:\d\d.*)?|\d{1,2}:\d\d:\d\d([.,]\d+)?(Z|[+-]\d\d:?\d\d)?|" + DATED)
MOSTLY = 0.8
"""Share of numbers that makes a column one of numbers."""


@dataclass(frozen=True)
class Sniffed:
    """A file's columns.

    Attributes:
        path: The file.
        layout: Settings of a mapping that say how a text is cut into columns; empty otherwise.
        headings: Headings of the columns of numbers, and of time stamps (unit ``iso`` or ``clock``); ``column`` is what
            a mapping calls them.
        numbers: Column of numbers -> samples; NaN where empty.
        table: The cells.
        spoken: Column that a mapping has to name by its number -> its heading.
        twice: Headings of several columns, which are left out: whose column it is cannot be said.
    """

    path: Path
    layout: dict[str, Any]
    headings: tuple[Heading, ...]
    numbers: dict[str, Float[np.ndarray, " n"]]
    table: Table
    spoken: dict[str, str] = field(default_factory=dict)
    twice: tuple[str, ...] = ()

    def called(self, column: str) -> str:
        """What a column is called in the file, also where a mapping has to name it by its number."""
        return self.spoken.get(column, column)

    @property
    def words(self) -> dict[str, str]:
        """Columns that hold no numbers, but for those whose headings stand twice -> the first cell that says something.

        Returns:
            What they are called in the file, and that cell.
        """
        known = {h.column for h in self.headings} | set(self.twice)
        cells = {c: self.table.text(c) for c in self.table.cells.columns if c not in known}
        said = {c: next((cell for cell in text if cell.lower() not in EMPTY), "") for c, text in cells.items()}
        return {self.called(c): cell for c, cell in said.items() if cell}

    def overview(self) -> str:
        """What its first columns are called."""
        return listed([self.called(h.column) for h in self.headings])


def sniff(path: Path) -> Sniffed:
    """Look at a file; refused if it holds no columns of numbers."""
    layout, spoken, below = _layout(path) if reader_of(path) is None else ({}, {}, {})
    table = read_table(path, **layout)
    numbers, stamps = _columns(table)
    if not numbers:
        raise InputError(f"{path.name}: no columns of numbers; expected one line a sample")
    headings = []
    for column in (*numbers, *stamps):
        parted = take_apart(spoken.get(column, column), below.get(column, ""))
        headings.append(replace(parted, column=column, unit=stamps.get(column, parted.unit)))
    changed = {k: v for k, v in layout.items() if v != getattr(Mapping, k, None)}
    twice = table.cells.columns[table.cells.columns.duplicated()]
    return Sniffed(path, changed, tuple(headings), numbers, table, spoken, tuple(dict.fromkeys(twice)))


def _layout(path: Path) -> tuple[dict[str, Any], dict[str, str], dict[str, str]]:
    """How a text is cut: settings of a mapping, column -> its heading, column -> its unit below the heading."""
    lines = lines_of(path, LOOKED_AT)[:LOOKED_AT]
    options = [(d, m) for d in DELIMITERS for m in ("point", "comma") if (d, m) != (",", "comma")]
    rated = [(*_numeric_block(lines, d, m), d, m) for d, m in options]
    _, first, width, delimiter, decimal = max(rated, key=lambda r: (r[0], r[2]))
    if width < 2:
        raise InputError(f"{path.name}: no columns of numbers; expected a text with one line a sample")
    layout = {"delimiter": delimiter, "decimal": decimal, "header": True, "skip_rows": 0}
    above = [k for k in range(first) if not is_blank(lines[k])]
    names = _words(lines[above[-1]], delimiter, width) if above else None
    units = None
    if names and len(above) > 1 and all(not n or take_apart("x", n).unit or n in "-()[]" for n in names):
        # The last line above the numbers holds units alone: what the columns are called stands above it.
        units, names = names, _words(lines[above[-2]], delimiter, width)
    numbered = [str(k) for k in range(1, width + 1)]
    if names is None or units is not None or len(cells_of(lines[above[-1]], delimiter)) != width:
        layout |= {"header": False, "skip_rows": first}
        spoken = dict(zip(numbered, names or numbered, strict=True))
        return layout, spoken, dict(zip(numbered, units or [""] * width, strict=True))
    headings = [cell.strip() for cell in cells_of(lines[above[-1]], delimiter)]
    return layout | {"skip_rows": above[-1]}, {h: h for h in headings}, {}


def _words(line: str, delimiter: str, width: int) -> list[str] | None:
    """Headings out of a line, if there are as many as columns; a sign of comment before them is no heading."""
    cells = [c.strip() for c in cells_of(line.strip(), delimiter)]
    if cells and cells[0] in {"#", "%", "//", "!"}:
        cells = cells[1:]
    if len(cells) == width + 1 and not cells[-1]:
        cells = cells[:-1]
    return [c.lstrip("#%! ") for c in cells] if len(cells) == width and any(cells) else None


def _numeric_block(lines: list[str], delimiter: str, decimal: str) -> tuple[int, int, int]:
    """Numbers in lines of them, the first such line (from 0) and its columns, for one way to cut lines."""
    widths, numbers = [], 0
    for k, line in enumerate(lines):
        cells = [c.strip() for c in cells_of(line, delimiter)]
        full = [c for c in cells if c.lower() not in EMPTY]
        good = sum(bool(NUMBER[decimal].fullmatch(c) or STAMP.fullmatch(c)) for c in full)
        if len(full) > 1 and good > 0.6 * len(full):
            widths.append((k, len(cells)))
            numbers += good
    if not widths:
        return 0, 0, 0
    width = Counter(w for _, w in widths).most_common(1)[0][0]
    return numbers, next(k for k, w in widths if w == width), width


def _columns(table: Table) -> tuple[dict[str, Float[np.ndarray, " n"]], dict[str, str]]:
    """Columns of numbers, and those of time stamps with their unit; of columns with one heading none is taken."""
    numbers: dict[str, Float[np.ndarray, " n"]] = {}
    stamps: dict[str, str] = {}
    names = table.cells.columns
    for name in names[~names.duplicated(keep=False)]:
        given = table.cells[name]
        if pd.api.types.is_datetime64_any_dtype(given):
            stamps[name] = "iso"
        elif pd.api.types.is_bool_dtype(given):
            continue
        elif pd.api.types.is_numeric_dtype(given):
            numbers[name] = given.to_numpy(dtype=float, na_value=np.nan, copy=True)
        else:
            text = table.text(name)
            values = numbers_in(text, table.decimal)
            some = [cell for cell in text.iloc[:50] if cell.lower() not in EMPTY]
            if some and all(STAMP.fullmatch(cell) for cell in some):
                stamps[name] = "clock" if ":" in some[0][:3] else "iso"
            elif np.isfinite(values).sum() >= MOSTLY * max((~text.str.lower().isin(EMPTY)).sum(), 1):
                numbers[name] = values
    good = {k: np.where(np.isfinite(v), v, np.nan) for k, v in numbers.items()}
    return {k: v for k, v in good.items() if np.isfinite(v).sum() > 1}, stamps
