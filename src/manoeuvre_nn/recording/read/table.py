"""Columns of a measured file, read so that every complaint names file, line and column."""

import codecs
import csv
import io
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import Float

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.recording.read.containers import columns_in, has_reader
from manoeuvre_nn.recording.read.mapping import Mapping

TEXT = (".csv", ".txt", ".dat")
"""Suffixes of texts; a file of any other suffix that has no reader is taken for one, too."""
EMPTY = frozenset({"", "nan", "na", "n/a", "null", "none", "-"})
"""Cells that hold no number, in small letters."""
ZONED = r"T?\d\d:\d\d.*(?:Z|[+-]\d\d:?\d\d)$"
"""A time stamp that says its zone."""
UTF16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
"""How a text begins that a spreadsheet saved as "Unicode"."""
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

    def text(self, column: str) -> "pd.Series[str]":
        """A column as text without blanks around it; empty where a cell is."""
        given = self.cells[column]
        return given.astype(object).where(given.notna(), "").astype(str).str.strip()

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
        text = self.text(column)
        values = numbers_in(text, self.decimal)
        odd = ~np.isfinite(values) & ~text.str.lower().isin(EMPTY).to_numpy()
        if odd.any():
            row = int(np.argmax(odd))
            such = "0,25, with a comma" if self.decimal == "comma" else "0.25, with a point"
            other = "point" if self.decimal == "comma" else "comma"
            switched = np.isfinite(numbers_in(text.iloc[row : row + 1], other)).all()
            hint = f"; or write decimal: {other} into the mapping" if switched and self.row == "line" else ""
            raise self.error(column, row, f"is {text.iloc[row][:40]!r}; expected a number such as {such}{hint}")
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
            text = self.text(column)
            day = pd.to_timedelta(text, errors="coerce").dt.total_seconds().to_numpy(dtype=float, copy=True)
            self._check_stamps(column, day, text, "13:04:24.5")
            return day + 86400.0 * np.cumsum(np.diff(day, prepend=day[:1]) < -MIDNIGHT)
        given = self.cells[column]
        if pd.api.types.is_datetime64_any_dtype(given):
            times, text = given, given.astype(str)
        else:
            text = self.text(column)
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

    def check_rises(self, column: str, time: Float[np.ndarray, " n"]) -> None:
        """Refuse sample times that lack one or do not increase."""
        if np.isnan(time).any():
            row = int(np.argmax(np.isnan(time)))
            raise self.error(column, row, "is empty; a sample without a time cannot be used")
        if (np.diff(time) <= 0).any():
            row = int(np.argmax(np.diff(time) <= 0)) + 1
            raise self.error(column, row, f"goes from {time[row - 1]:.12g} to {time[row]:.12g}; times must increase")

    def _check_stamps(self, column: str, values: Float[np.ndarray, " n"], text: "pd.Series[str]", such: str) -> None:
        """Refuse what is no time."""
        odd = np.isnan(values) & ~text.str.lower().isin([*EMPTY, "nat"]).to_numpy()
        if odd.any():
            row = int(np.argmax(odd))
            raise self.error(column, row, f"is {text.iloc[row][:40]!r}; expected a time such as {such}")


def read_table(path: Path, mapping: Mapping) -> Table:
    """Read a file's columns; its suffix says what it is.

    Args:
        path: The file: a text, or one that has a reader.
        mapping: Headings, delimiter, lines to skip.

    Returns:
        The columns that the mapping names, and maybe others.

    Raises:
        InputError: If the file is missing, empty, foreign, cut off, or lacks a column.
    """
    check_there(path)
    if has_reader(path):
        frame = columns_in(path, mapping.columns)
        _check_headings(path, list(frame.columns), mapping)
        return Table(path, frame, "row", mapping.decimal)
    text = text_of(path)
    first, line = _first_line(path, text, mapping.skip_rows)
    headings = [cell.strip() for cell in cells_of(line, mapping.delimiter)]
    if not mapping.header:
        first, headings = first - 1, [str(k) for k in range(1, len(headings) + 1)]
    _check_headings(path, headings, mapping)
    even = _even_frame(text, first, headings, mapping)
    frame = _ragged_frame(path, text, first, headings, mapping.delimiter) if even is None else even
    if not len(frame):
        raise InputError(f"{path.name}: no line of numbers below the headings")
    return Table(path, frame, decimal=mapping.decimal)


def headings_of(path: Path) -> list[str]:
    """Headings of a csv with commas, as this package writes it.

    Args:
        path: The file.

    Returns:
        The headings; none where it is no such text.
    """
    check_there(path)
    if path.suffix.lower() not in TEXT:
        return []
    return [cell.strip() for cell in cells_of(_first_line(path, text_of(path), 0)[1], ",")]


def numbers_in(text: "pd.Series[str]", decimal: str) -> Float[np.ndarray, " n"]:
    """Cells as numbers.

    Args:
        text: The cells.
        decimal: ``point`` or ``comma``; the other sign would part thousands, and is no number.

    Returns:
        Numbers; NaN where a cell is none.
    """
    if decimal == "comma":
        text = text.str.replace(".", "?", regex=False).str.replace(",", ".", regex=False)
    return pd.to_numeric(text, errors="coerce").to_numpy(dtype=float, copy=True)


def _first_line(path: Path, text: str, skip: int) -> tuple[int, str]:
    """The first line after those to be skipped that says something, and its number."""
    lines = io.StringIO(text)
    for k, line in enumerate(lines, start=1):
        if k > skip and not _is_blank(line):
            return k, line.removesuffix("\n")
    raise InputError(f"{path.name}: no line after the first {skip}; expected columns of numbers: mind skip_rows")


def _is_blank(line: str) -> bool:
    """Whether a line holds no cell with anything in it."""
    return not line.strip(" \t\n,;")


def _even_frame(text: str, first: int, headings: Sequence[str], mapping: Mapping) -> pd.DataFrame | None:
    """Cells below a line, read at once; None if lines differ in length or are quoted, which needs a closer look."""
    if mapping.delimiter == "whitespace" or '"' in text or len(set(headings)) < len(headings):
        return None
    parts = len(headings) - 1
    for k, line in enumerate(io.StringIO(text), start=1):
        if k > first and (line.count(mapping.delimiter) != parts or _is_blank(line)):
            return None
    spelt = [form for word in EMPTY for form in dict.fromkeys((word, word.upper(), word.title()))]
    try:
        frame = pd.read_csv(
            io.BytesIO(text.encode()), sep=mapping.delimiter, skiprows=first, header=None, names=list(headings),
            na_values=[*spelt, "NaN"], keep_default_na=False, decimal="," if mapping.decimal == "comma" else ".",
            quoting=csv.QUOTE_NONE, skip_blank_lines=False, low_memory=False,
            index_col=False,
        )  # fmt: skip
    except ValueError:
        return None
    return frame.set_axis(pd.RangeIndex(first + 1, first + 1 + len(frame)))


def _ragged_frame(path: Path, text: str, first: int, headings: Sequence[str], delimiter: str) -> pd.DataFrame:
    """Cells below a line, read line by line, blank lines passed over."""
    index, rows, last = [], [], text.count("\n") + 1
    for k, line in enumerate(io.StringIO(text), start=1):
        if k <= first or _is_blank(line):
            continue
        cells = cells_of(line.removesuffix("\n"), delimiter)
        if len(cells) != len(headings):
            cut = " (cut off?)" if k == last and len(cells) < len(headings) else ""
            raise InputError(
                f"{path.name}, line {k}: {len(cells)} cells, expected {len(headings)}{cut}: delete or mend this line"
            )
        index.append(k)
        rows.append(cells)
    return pd.DataFrame(rows, columns=list(headings), index=index, dtype=str)


def cells_of(line: str, delimiter: str) -> list[str]:
    """A line of a text cut into cells.

    Args:
        line: The line.
        delimiter: One character, or ``whitespace``.

    Returns:
        The cells; the line as it is where it cannot be cut.
    """
    if delimiter == "whitespace":
        return line.split()
    try:
        return next(csv.reader([line], delimiter=delimiter), [])
    except csv.Error:  # such as a cell of a million letters
        return [line]


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
    if not os.access(path, os.R_OK):
        raise InputError(f"{path}: may not be read; ask its owner, or copy it")
    if not path.stat().st_size:
        raise InputError(f"{path.name}: empty file; expected columns of numbers")


def text_of(path: Path) -> str:
    """A text file, if it says something.

    Args:
        path: The file.

    Returns:
        The text. Lines end with a line feed, where an editor ends them: a heading may hold other characters that count
        as ends of lines.

    Raises:
        InputError: If it is no text, or empty.
    """
    raw = path.read_bytes()
    if not raw.strip():
        raise InputError(f"{path.name}: empty file; expected columns of numbers")
    if b"\0" in raw and not raw.startswith(UTF16):
        raise InputError(f"{path.name}: not a text file; export it as CSV (text, one line a sample)")
    try:
        text = raw.decode("utf-16" if raw.startswith(UTF16) else "utf-8-sig")
    except UnicodeDecodeError:
        text = raw.decode("latin-1")  # headings such as psi [degree sign] from older programs
    return text.replace("\r\n", "\n").replace("\r", "\n").removesuffix("\n")


def _check_headings(path: Path, headings: Sequence[str], mapping: Mapping) -> None:
    """Refuse headings that are missing or stand twice."""
    there = ", ".join(headings[:30])
    for column in mapping.columns:
        if column not in headings and column in mapping.needed:
            one = len(headings) == 1 and not has_reader(path)
            hint = f"; is the delimiter {mapping.delimiter!r}?" if one else ""
            raise InputError(f"{path.name}: no column {column!r}; it has: {there or 'none'}{hint}")
        if headings.count(column) > 1:
            raise InputError(f"{path.name}: column {column!r} stands {headings.count(column)} times; rename one")
