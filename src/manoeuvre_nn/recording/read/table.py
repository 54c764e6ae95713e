"""Columns of a measured file, read so that every complaint names file, line and column."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import Float

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.memory import check_memory
from manoeuvre_nn.core.plain_text import listed
from manoeuvre_nn.recording.read import bags, excel, matlab, nmea  # noqa: F401  each registers what it reads
from manoeuvre_nn.recording.read.containers import NOTES, QUESTIONS, check_there, columns_in, reader_of
from manoeuvre_nn.recording.read.dates import stamps_of, unlike
from manoeuvre_nn.recording.read.logger_stamps import without_midnights
from manoeuvre_nn.recording.read.quantity import STAMPS
from manoeuvre_nn.recording.read.text import EMPTY, INEXACT, cells_of, even_frame, is_blank, lines_of

TEXT = (".csv", ".txt", ".dat")
"""Suffixes of texts; a file of any other suffix that has no reader is taken for one, too."""
ZONED = r"T?\d\d:\d\d.*(?:Z|[+-]\d\d:?\d\d)$"
"""A time stamp that says its zone."""
MAX_EVEN = 1e7
"""Most samples of a record that is written at even times, unless a tenth of them are there: holes take memory, too."""
TOP = 400
"""Lines, after those to be skipped, among which headings are looked for first."""
MEMORY_IN_BLOCKS, MEMORY_BY_LINE = 3.0, 20.0
"""Bytes of memory that a byte of a text takes, read in blocks or line by line."""
THINNER = "keep fewer samples (a ship's motion needs no more than 400 in the time L/U0), or cut the file into parts"
"""What to do with a text that is too large."""


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

    @property
    def notes(self) -> tuple[str, ...]:
        """What its reader has to say of how it was read."""
        return tuple(self.cells.attrs.get(NOTES, ()))

    @property
    def questions(self) -> dict[str, str]:
        """Column -> what its reader assumed, and a person must know."""
        return dict(self.cells.attrs.get(QUESTIONS, {}))

    def text(self, column: str) -> "pd.Series[str]":
        """A column as text without blanks around it; empty where a cell is."""
        given = self.cells[column]
        return given.astype(object).where(given.notna(), "").astype(str).str.strip()

    def numbers(self, column: str) -> Float[np.ndarray, " n"]:
        """A column as numbers in the file's unit, NaN where a cell is empty; anything else is refused."""
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

    def times(self, column: str, unit: str, zone: str | None = None) -> Float[np.ndarray, " n"]:
        """A column as times, NaN where a cell is empty; what is no time is refused.

        Args:
            column: Its heading.
            unit: ``iso`` for date and time, see :func:`stamps_of`; ``clock`` for the time of day, which may pass
                midnight; any other for numbers.
            zone: Where the clock stood, for stamps that do not say it; None is UTC.

        Returns:
            Seconds since 1970 (UTC) for ``iso``, since midnight before the first sample for ``clock``; else numbers in
            the file's unit.
        """
        if unit not in STAMPS:
            return self.numbers(column)
        if unit == "clock":
            text = self.text(column)
            day = pd.to_timedelta(text, errors="coerce").dt.total_seconds().to_numpy(dtype=float, copy=True)
            self._check_stamps(column, day, text, "13:04:24.5")
            return without_midnights(day)
        given = self.cells[column]
        if pd.api.types.is_datetime64_any_dtype(given):
            text, (times, *others) = given.astype(str), [given]
        else:
            text = self.text(column)
            zoned = bool(text.str.contains(ZONED).any())
            times, *others = (
                pd.to_datetime(stamps, errors="coerce", format="ISO8601", utc=zoned) for stamps in stamps_of(text)
            )
        row = next((row for other in others if (row := unlike(times, other)) is not None), None)
        if row is not None:
            raise self.error(
                column,
                row,
                f"is {text.iloc[row][:40]!r}, where day and month can be exchanged; write it 2020-07-31T13:04:24.5",
            )
        if times.dt.tz is None:
            times = times.dt.tz_localize(zone or "UTC", ambiguous="NaT", nonexistent="NaT")
        seconds = (times.dt.tz_convert("UTC") - pd.Timestamp(0, tz="UTC")).dt.total_seconds()
        self._check_stamps(column, seconds.to_numpy(dtype=float), text, "2020-07-31T13:04:24.5")
        return seconds.to_numpy(dtype=float, copy=True)

    def error(self, column: str, row: int, what: str) -> InputError:
        """A complaint about the cell of a row, counted from 0: what is wrong and what to do."""
        return InputError(f"{self.path.name}, {self.row} {self.cells.index[row]}: column {column!r} {what}")

    def check_rises(self, column: str, time: Float[np.ndarray, " n"]) -> None:
        """Refuse sample times that lack one or do not increase."""
        if np.isnan(time).any():
            row = int(np.argmax(np.isnan(time)))
            cell = self.text(column).iloc[row]
            if cell.lower() not in EMPTY:
                raise self.error(column, row, f"is {cell[:40]!r}, no number; mend this cell, or delete the {self.row}")
            raise self.error(column, row, "is empty; a sample without a time cannot be used")
        if (np.diff(time) <= 0).any():
            row = int(np.argmax(np.diff(time) <= 0)) + 1
            raise self.error(column, row, f"goes from {time[row - 1]:.12g} to {time[row]:.12g}; times must increase")

    def check_holes(self, column: str, time: Float[np.ndarray, " n"], first: int = 0) -> None:
        """Refuse a hole for which a record at even times would take far more samples than there are: a wrong time.

        Args:
            column: Its heading.
            time: Sample times that increase.
            first: Row of the first of them, counted from 0.
        """
        steps = np.diff(time)
        usual, row = float(np.median(steps)), int(np.argmax(steps)) + 1
        if float(time[-1] - time[0]) > max(MAX_EVEN, 10.0 * len(time)) * usual:
            raise self.error(
                column, first + row, f"jumps from {time[row - 1]:.12g} to {time[row]:.12g}, where steps of "
                f"{usual:.4g} are usual: mend this time, or cut the file in two at this hole"
            )  # fmt: skip

    def _check_stamps(self, column: str, values: Float[np.ndarray, " n"], text: "pd.Series[str]", such: str) -> None:
        """Refuse what is no time."""
        odd = np.isnan(values) & ~text.str.lower().isin([*EMPTY, "nat"]).to_numpy()
        if odd.any():
            row = int(np.argmax(odd))
            raise self.error(column, row, f"is {text.iloc[row][:40]!r}; expected a time such as {such}")


def read_table(
    path: Path,
    columns: Sequence[str] = (),
    optional: Sequence[str] = (),
    *,
    delimiter: str = ",",
    decimal: str = "point",
    header: bool = True,
    skip_rows: int = 0,
) -> Table:
    """Read a file's columns; its suffix says what it is, the settings of a mapping how a text is cut.

    Args:
        path: The file: a text, or one that has a reader.
        columns: Columns that are wanted.
        optional: Those among them that the file may lack.
        delimiter: One character, or ``whitespace``.
        decimal: ``point`` or ``comma``.
        header: Whether the first line names the columns.
        skip_rows: Lines before it.

    Returns:
        The columns that are wanted, and maybe others.

    Raises:
        InputError: If the file is missing, empty, foreign, cut off, or lacks a column.
    """
    if reader_of(path) is not None:
        frame = columns_in(path, columns or None)
        _check_headings(path, list(frame.columns), columns, optional)
        return Table(path, frame, "row", decimal)
    first, line = _first_line(path, skip_rows)
    headings = [cell.strip() for cell in cells_of(line, delimiter)]
    if header:
        first += 1
    else:
        headings = [str(k) for k in range(1, len(headings) + 1)]
    hint = f"; is the delimiter {delimiter!r}?" if len(headings) == 1 else ""
    _check_headings(path, headings, columns, optional, hint)
    _check_fits(path, MEMORY_IN_BLOCKS, THINNER)
    even = even_frame(path, first, headings, delimiter, decimal)
    frame = _ragged_frame(path, first, headings, delimiter) if even is None else even
    if not len(frame):
        raise InputError(f"{path.name}: no line of numbers below the headings")
    return Table(path, frame.set_axis(frame.index + first + 1), decimal=decimal)


def headings_of(path: Path) -> list[str]:
    """Headings of a csv with commas, as this package writes it; none where it is no such text."""
    if path.suffix.lower() not in TEXT:
        check_there(path)
        return []
    return [cell.strip() for cell in cells_of(_first_line(path, 0)[1], ",")]


def numbers_in(text: "pd.Series[str]", decimal: str) -> Float[np.ndarray, " n"]:
    """Cells as numbers, NaN where one is none, as where the other decimal sign parts thousands."""
    if decimal == "comma":
        text = text.str.replace(".", "?", regex=False).str.replace(",", ".", regex=False)
    numbers = pd.to_numeric(text, errors="coerce").to_numpy(dtype=float, copy=True)
    if INEXACT:
        there = np.isfinite(numbers)
        numbers[there] = [float(cell) for cell in text[there]]
    return numbers


def _first_line(path: Path, skip: int) -> tuple[int, str]:
    """The first line after those to be skipped that says something: its number, counted from 0, and what it says."""
    for most in (skip + TOP, None):
        lines = lines_of(path, most)
        first = next((k for k in range(skip, len(lines)) if not is_blank(lines[k])), None)
        if first is not None:
            return first, lines[first]
    raise InputError(f"{path.name}: no line after the first {skip}; expected columns of numbers: mind skip_rows")


def _check_fits(path: Path, factor: float, remedy: str) -> None:
    """Refuse a text whose cells would not fit into memory, at so many bytes of it for each of the text."""
    size = path.stat().st_size
    check_memory(f"{path.name}: {size / 1e9:.2g} GB of text", factor * size, remedy)


def _ragged_frame(path: Path, first: int, headings: Sequence[str], delimiter: str) -> pd.DataFrame:
    """Cells below a line, read line by line, blank lines passed over."""
    _check_fits(path, MEMORY_BY_LINE, f"write it without quotes and blank lines, or {THINNER}")
    lines = lines_of(path)
    rows = {k: cells_of(line, delimiter) for k, line in enumerate(lines[first:]) if not is_blank(line)}
    for k, cells in rows.items():
        if len(cells) != len(headings):
            cut = " (cut off?)" if first + k == len(lines) - 1 and len(cells) < len(headings) else ""
            raise InputError(
                f"{path.name}, line {first + k + 1}: {len(cells)} cells, expected {len(headings)}{cut}: delete or mend "
                "this line"
            )
    return pd.DataFrame(list(rows.values()), columns=list(headings), index=list(rows), dtype=str)


def _check_headings(
    path: Path, headings: Sequence[str], columns: Sequence[str], optional: Sequence[str], hint: str = ""
) -> None:
    """Refuse headings that are missing or stand twice."""
    for column in columns:
        if column not in headings and column not in optional:
            raise InputError(f"{path.name}: no column {column!r}; it has: {listed(headings)}{hint}")
        if headings.count(column) > 1:
            raise InputError(f"{path.name}: column {column!r} stands {headings.count(column)} times; rename one")
