"""Columns of a measured file, read so that every complaint names file, line and column."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import Float

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.recording.containers import MAT, PARQUET, mat_frame, parquet_frame
from manoeuvre_nn.recording.mapping import Mapping

TEXT = (".csv", ".txt", ".dat")
"""Suffixes of texts."""
READABLE = (*TEXT, MAT, PARQUET)
"""Suffixes of files that can be read; anything else is taken for a text."""
EMPTY = frozenset({"", "nan", "na", "n/a", "null", "none", "-"})
"""Cells that hold no number, in small letters."""
ZONED = r"T?\d\d:\d\d.*(?:Z|[+-]\d\d:?\d\d)$"
"""A time stamp that says its zone."""
MIDNIGHT = 43200.0
"""A time of day that goes back by more than this [s] has passed midnight."""


@dataclass(frozen=True)
class Table:
    """Cells as text or numbers.

    Attributes:
        path: The file.
        cells: One column a heading; the index is the line or row in the file, counted from 1.
        row: What a row of the file is called.
        decimal: ``point`` or ``comma``.
    """

    path: Path
    cells: pd.DataFrame
    row: str = "line"
    decimal: str = "point"

    def numbers(self, column: str) -> Float[np.ndarray, " n"]:
        """A column as numbers, NaN where a cell is empty.

        Args:
            column: Its heading.

        Returns:
            Numbers in the file's unit. Anything else than a finite number raises :meth:`error`.
        """
        given = self.cells[column]
        if pd.api.types.is_numeric_dtype(given) and not pd.api.types.is_bool_dtype(given):
            values = given.to_numpy(dtype=float, na_value=np.nan, copy=True)
            if np.isinf(values).any():
                row = int(np.argmax(np.isinf(values)))
                raise self.error(column, row, f"is {values[row]}; expected a finite number")
            return values
        text = self._text(column)
        written = text.str.replace(",", ".") if self.decimal == "comma" else text
        values = pd.to_numeric(written, errors="coerce").to_numpy(dtype=float, copy=True)
        odd = ~np.isfinite(values) & ~text.str.lower().isin(EMPTY).to_numpy()
        if odd.any():
            row = int(np.argmax(odd))
            raise self.error(column, row, f"is {text.iloc[row]!r}; expected a number such as 0.25, with a point")
        return values

    def stamps(self, column: str, unit: str, zone: str | None) -> Float[np.ndarray, " n"]:
        """A column of time stamps as seconds.

        Args:
            column: Its heading.
            unit: ``iso`` for date and time, ``clock`` for the time of day, which may pass midnight.
            zone: Where the clock stood, for stamps that do not say it; None is UTC.

        Returns:
            Seconds since 1970 (UTC), or since midnight before the first sample; NaN where a cell is empty. What is no
            time raises :meth:`error`.
        """
        if unit == "clock":
            text = self._text(column)
            day = pd.to_timedelta(text, errors="coerce").dt.total_seconds().to_numpy(dtype=float, copy=True)
            self._check_stamps(column, day, text, "13:04:24.5")
            return day + 86400.0 * np.cumsum(np.diff(day, prepend=day[:1]) < -MIDNIGHT)
        given = self.cells[column]
        if pd.api.types.is_datetime64_any_dtype(given):
            times, text = given, given.astype(str)
        else:
            text = self._text(column)
            zoned = bool(text.str.contains(ZONED).any())
            times = pd.to_datetime(text, errors="coerce", format="ISO8601", utc=zoned)
        if times.dt.tz is None:
            times = times.dt.tz_localize(zone or "UTC", ambiguous="NaT", nonexistent="NaT")
        seconds = (times.dt.tz_convert("UTC") - pd.Timestamp(0, tz="UTC")).dt.total_seconds()
        self._check_stamps(column, seconds.to_numpy(dtype=float), text, "2020-07-31T13:04:24.5")
        return seconds.to_numpy(dtype=float, copy=True)

    def error(self, column: str, row: int, what: str) -> InputError:
        """A complaint about one cell.

        Args:
            column: Its heading.
            row: Its row, counted from 0.
            what: What is wrong and what to do.

        Returns:
            The error to raise.
        """
        return InputError(f"{self.path.name}, {self.row} {self.cells.index[row]}: column {column!r} {what}")

    def _text(self, column: str) -> "pd.Series[str]":
        """A column as text without blanks around it."""
        given = self.cells[column]
        return given.astype(object).where(given.notna(), "").astype(str).str.strip()

    def _check_stamps(self, column: str, values: Float[np.ndarray, " n"], text: "pd.Series[str]", such: str) -> None:
        """Refuse what is no time."""
        odd = np.isnan(values) & ~text.str.lower().isin([*EMPTY, "nat"]).to_numpy()
        if odd.any():
            row = int(np.argmax(odd))
            raise self.error(column, row, f"is {text.iloc[row][:40]!r}; expected a time such as {such}")


def read_table(path: Path, mapping: Mapping) -> Table:
    """Read a file's columns; its suffix says what it is.

    Args:
        path: The file: a text, ``.mat`` or ``.parquet``.
        mapping: Headings, delimiter, lines to skip.

    Returns:
        The columns that the mapping names, and maybe others.

    Raises:
        InputError: If the file is missing, empty, foreign, cut off, or lacks a column.
    """
    check_there(path)
    if path.suffix.lower() in {MAT, PARQUET}:
        frame = (mat_frame if path.suffix.lower() == MAT else parquet_frame)(path, mapping.columns)
        _check_headings(path, list(frame.columns), mapping)
        return Table(path, frame, "row", mapping.decimal)
    lines = text_of(path).splitlines()
    numbered = [(k, line) for k, line in enumerate(lines, start=1) if k > mapping.skip_rows and line.strip(" \t,;")]
    if not numbered:
        raise InputError(f"{path.name}: empty file; expected columns of numbers")
    split = [(k, cells_of(line, mapping.delimiter)) for k, line in numbered]
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
    frame = pd.DataFrame([cells for _, cells in split], columns=headings, index=index, dtype=str)
    return Table(path, frame, decimal=mapping.decimal)


def cells_of(line: str, delimiter: str) -> list[str]:
    """A line of a text cut into cells.

    Args:
        line: The line.
        delimiter: One character, or ``whitespace``.

    Returns:
        The cells.
    """
    return line.split() if delimiter == "whitespace" else next(csv.reader([line], delimiter=delimiter), [])


def check_there(path: Path) -> None:
    """Refuse what is no file, or an empty one.

    Args:
        path: The file.

    Raises:
        InputError: If it is missing, a folder, or empty.
    """
    if path.is_dir():
        raise InputError(f"{path}: is a folder; write a file")
    if not path.exists():
        raise InputError(f"{path}: no such file")
    if not path.stat().st_size:
        raise InputError(f"{path.name}: empty file; expected columns of numbers")


def text_of(path: Path) -> str:
    """What a text file says, if it says something.

    Args:
        path: The file.

    Returns:
        The text.

    Raises:
        InputError: If it is no text, or empty.
    """
    raw = path.read_bytes()
    if not raw.strip():
        raise InputError(f"{path.name}: empty file; expected columns of numbers")
    if b"\0" in raw:
        raise InputError(f"{path.name}: not a text file; export it as CSV (text, one line a sample)")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        return raw.decode("latin-1")  # headings such as psi [degree sign] from older programs


def _check_headings(path: Path, headings: Sequence[str], mapping: Mapping) -> None:
    """Refuse headings that are missing or stand twice."""
    there = ", ".join(headings[:30])
    for column in mapping.columns:
        if column not in headings:
            text = path.suffix.lower() not in {MAT, PARQUET}
            hint = f"; is the delimiter {mapping.delimiter!r}?" if text and len(headings) == 1 else ""
            raise InputError(f"{path.name}: no column {column!r}; it has: {there or 'none'}{hint}")
        if headings.count(column) > 1:
            raise InputError(f"{path.name}: column {column!r} stands {headings.count(column)} times; rename one")
