"""Workbooks of Excel: the one sheet with columns of numbers, its headings in one line or in several."""

import datetime
import warnings
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.memory import check_memory
from manoeuvre_nn.core.plain_text import listed
from manoeuvre_nn.recording.read.containers import ROWS, reads

NUMBERS = 0.6
"""Share of a row's cells that are numbers or times in rows of a table."""
MIN_ROWS = 3
"""Such rows of a sheet that is one of recordings."""
MEMORY = 12.0
"""Bytes of memory that a byte of a sheet takes."""
HEADING_ROWS = 3
"""Rows above the numbers that may be headings."""
Cell = Any
"""A number, a text, a date, a time of day, or None."""


@reads(".xlsx", ".xlsm")
def excel_frame(path: Path, columns: Sequence[str] | None = None) -> pd.DataFrame:
    """Columns of the one visible sheet of a workbook that holds rows of numbers; formulas by the values saved in it.

    Headings are joined over up to three rows right above the numbers: ``Rudder`` over ``Port`` over ``[deg]`` is
    ``Rudder Port [deg]``. A column without a heading is left out.

    Args:
        path: The file.
        columns: Columns that are wanted: here all are given.

    Returns:
        A row a sample; dates as dates, times of day as texts, durations in seconds.

    Raises:
        InputError: If it is no workbook, or not one sheet has rows of numbers.
        MemoryError: If its cells take more memory than is free.
    """
    del columns
    try:
        from openpyxl import load_workbook
    except ImportError as error:
        raise InputError(
            f"{path.name}: Excel files need openpyxl: pip install 'manoeuvre-nn[excel]', or save it as CSV"
        ) from error
    try:
        with zipfile.ZipFile(path) as packed:
            size = sum(part.file_size for part in packed.infolist())
        check_memory(f"{path.name}: {size / 1e9:.2g} GB of cells", MEMORY * size, "save the sheet as CSV")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of styles, and of each cell that is marked as a date and is none
            book = load_workbook(path, read_only=True, data_only=True, keep_links=False)
            sheets = {s.title: _rows(s) for s in book.worksheets if s.sheet_state == "visible"}
            book.close()
    except (InputError, MemoryError):
        raise
    except Exception as error:  # its reader raises many kinds on foreign, hostile and damaged files
        said = " ".join(str(error).split())[:80] or type(error).__name__
        raise InputError(f"{path.name}: not an Excel workbook, or cut off ({said}); save it again, or as CSV") from None
    tables = {title: table for title, rows in sheets.items() if (table := _table(rows)) is not None}
    if len(tables) > 1:
        raise InputError(
            f"{path.name}: {len(tables)} sheets hold rows of numbers ({listed(list(tables))}); hide all but one in "
            "Excel, or save the one as a file of its own"
        )
    if not tables:
        raise InputError(f"{path.name}: no sheet with rows of numbers below headings; it has: {listed(list(sheets))}")
    return next(iter(tables.values()))


def _rows(worksheet: Any) -> list[tuple[Cell, ...]]:
    """Rows of a sheet."""
    worksheet.reset_dimensions()  # what is written there of the sheet's size may be wrong
    return [tuple(row) for row in worksheet.iter_rows(values_only=True)]


def _is_value(cell: Cell) -> bool:
    """Whether a cell is a number or a time."""
    if isinstance(cell, str):
        return False
    return isinstance(cell, int | float | datetime.date | datetime.time | datetime.timedelta)


def _table(rows: list[tuple[Cell, ...]]) -> pd.DataFrame | None:
    """Headings and columns of a sheet; None if it holds no rows of numbers."""
    full = [[k for k, cell in enumerate(row) if cell is not None and cell != ""] for row in rows]
    good = [
        len(there) > 1 and sum(_is_value(row[k]) for k in there) > NUMBERS * len(there)
        for row, there in zip(rows, full, strict=True)
    ]
    if sum(good) < MIN_ROWS:
        return None
    first, width = good.index(True), max(map(len, rows))
    names = _headings(rows[:first], width)
    places = [k for k in range(first, len(rows)) if full[k]]
    below = [rows[k] + (None,) * (width - len(rows[k])) for k in places]
    kept = [k for k in range(width) if names[k]]
    if len(kept) < 2:
        return None
    frame = pd.DataFrame({k: _column([row[k] for row in below]) for k in kept})
    frame = frame.set_axis([names[k] for k in kept], axis=1)
    frame.attrs[ROWS] = [k + 1 for k in places]
    return frame


def _headings(above: list[tuple[Cell, ...]], width: int) -> list[str]:
    """What columns are called, of the rows right above the numbers; a title of one cell is none of them."""
    used: list[list[str]] = []
    for row in reversed(above[-HEADING_ROWS:]):
        words = [" ".join(str(cell).split()) if cell is not None else "" for cell in row] + [""] * (width - len(row))
        if sum(map(bool, words)) < 2:
            break
        used.insert(0, words)
    for k, words in enumerate(used[:-1]):
        if sum(map(bool, words)) < sum(map(bool, used[-1])):  # headings over several columns stand in the first
            used[k] = _carried(words)
    return [" ".join(dict.fromkeys(w for w in words if w)) for words in zip(*used, strict=True)] or [""] * width


def _carried(words: list[str]) -> list[str]:
    """Headings of merged cells, carried to the right."""
    return [next((w for w in reversed(words[: k + 1]) if w), "") for k in range(len(words))]


def _column(cells: list[Cell]) -> pd.Series:
    """Cells of a column as numbers, dates, or texts."""
    some = [cell for cell in cells if cell is not None]
    if some and all(isinstance(c, datetime.datetime | datetime.date) for c in some):
        return pd.Series(pd.to_datetime(pd.Series(cells, dtype=object), errors="coerce"))
    if some and all(isinstance(c, datetime.timedelta) for c in some):
        return pd.Series([np.nan if c is None else c.total_seconds() for c in cells])
    if all(isinstance(c, int | float) and not isinstance(c, bool) for c in some):
        return pd.Series([np.nan if c is None else float(c) for c in cells])
    return pd.Series(["" if c is None else str(c) for c in cells], dtype=object)
