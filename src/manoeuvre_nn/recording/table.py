"""A text file of columns, read so that every complaint names file, line and column."""

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import Float

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.recording.mapping import Mapping

EMPTY = frozenset({"", "nan", "na", "n/a", "null", "none", "-"})
"""Cells that hold no number, in small letters."""


@dataclass(frozen=True)
class Table:
    """Cells as text.

    Attributes:
        path: The file.
        cells: One column a heading; the index is the line in the file, counted from 1.
    """

    path: Path
    cells: pd.DataFrame

    def numbers(self, column: str) -> Float[np.ndarray, " n"]:
        """A column as numbers, NaN where a cell is empty.

        Args:
            column: Its heading.

        Returns:
            Numbers in the file's unit. Anything else than a finite number raises :meth:`error`.
        """
        text = self.cells[column].str.strip()
        values = pd.to_numeric(text, errors="coerce").to_numpy(dtype=float, copy=True)
        odd = ~np.isfinite(values) & ~text.str.lower().isin(EMPTY).to_numpy()
        if odd.any():
            row = int(np.argmax(odd))
            raise self.error(column, row, f"is {text.iloc[row]!r}; expected a number such as 0.25, with a point")
        return values

    def error(self, column: str, row: int, what: str) -> InputError:
        """A complaint about one cell.

        Args:
            column: Its heading.
            row: Its row, counted from 0.
            what: What is wrong and what to do.

        Returns:
            The error to raise.
        """
        return InputError(f"{self.path.name}, line {self.cells.index[row]}: column {column!r} {what}")


def read_table(path: Path, mapping: Mapping) -> Table:
    """Read a file's columns as text.

    Args:
        path: The file.
        mapping: Headings, delimiter, lines to skip.

    Returns:
        The columns that the mapping names.

    Raises:
        InputError: If the file is missing, empty, no text, cut off, or lacks a column.
    """
    lines = _text(path).splitlines()
    numbered = [(k, line) for k, line in enumerate(lines, start=1) if k > mapping.skip_rows and line.strip(" \t,;")]
    if not numbered:
        raise InputError(f"{path.name}: empty file; expected columns of numbers")
    if mapping.delimiter == "whitespace":
        split = [(k, line.split()) for k, line in numbered]
    else:
        split = [(k, next(csv.reader([line], delimiter=mapping.delimiter))) for k, line in numbered]
    if mapping.header:
        headings = [cell.strip() for cell in split.pop(0)[1]]
    else:
        headings = [str(k) for k in range(1, len(split[0][1]) + 1)]
    _check_headings(path, headings, mapping)
    for k, cells in split:
        if len(cells) != len(headings):
            cut = " (cut off?)" if k == len(lines) and len(cells) < len(headings) else ""
            raise InputError(
                f"{path.name}, line {k}: {len(cells)} cells, expected {len(headings)}{cut}: delete or mend this line"
            )
    if not split:
        raise InputError(f"{path.name}: no line of numbers below the headings")
    index = [k for k, _ in split]
    return Table(path, pd.DataFrame([cells for _, cells in split], columns=headings, index=index, dtype=str))


def _text(path: Path) -> str:
    """What the file says, if it says something."""
    if path.is_dir():
        raise InputError(f"{path}: is a folder; write a file")
    if not path.exists():
        raise InputError(f"{path}: no such file")
    raw = path.read_bytes()
    if not raw.strip():
        raise InputError(f"{path.name}: empty file; expected columns of numbers")
    if b"\0" in raw:
        raise InputError(f"{path.name}: not a text file; export it as CSV (text, one line a sample)")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        return raw.decode("latin-1")  # headings such as psi [degree sign] from older programs


def _check_headings(path: Path, headings: list[str], mapping: Mapping) -> None:
    """Refuse headings that are missing or stand twice."""
    there = ", ".join(headings[:30])
    for column in mapping.columns:
        if column not in headings:
            hint = "" if len(headings) > 1 else f"; is the delimiter {mapping.delimiter!r}?"
            raise InputError(f"{path.name}: no column {column!r}; it has: {there}{hint}")
        if headings.count(column) > 1:
            raise InputError(f"{path.name}: column {column!r} stands {headings.count(column)} times; rename one")
