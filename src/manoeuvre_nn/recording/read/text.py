"""Texts as lines and cells: the first lines alone, or columns read block by block, without an object for each line."""

import codecs
import csv
import io
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from jaxtyping import Bool, UInt8

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.recording.read.containers import check_there

EMPTY = frozenset({"", "nan", "na", "n/a", "null", "none", "-"})
"""Cells that hold no number, in small letters."""
UTF16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
"""How a text begins that a spreadsheet saved as "Unicode"."""
WHITESPACE = "whitespace"
"""Delimiter that stands for any number of blanks and tabs."""
BLOCK = 1 << 23
"""Bytes that are cut into cells at once."""
SPELT = [form for word in EMPTY for form in dict.fromkeys((word, word.upper(), word.title()))] + ["NaN"]
"""Empty cells as they are usually written."""
INEXACT = tuple(map(int, pd.__version__.split(".")[:2])) < (3, 1)
"""Whether this pandas, unless told otherwise, may read a neighbour of the double that is nearest to the digits."""


def _among(letters: bytes) -> Bool[np.ndarray, " 256"]:
    """Which bytes are letters of a set."""
    return np.isin(np.arange(256), np.frombuffer(letters, dtype=np.uint8))


END = ord("\n")
SAYS_NOTHING = _among(b" \t,;\n")
"""Bytes of lines that are blank."""
PARTS_WORDS = _among(b" \t\n")
FOREIGN = _among(b"\x0b\x0c\x1c\x1d\x1e\x1f" + bytes(range(128, 256)))
"""Bytes that Python may take for blanks, and a block reader does not."""


def is_blank(line: str) -> bool:
    """Whether a line holds no cell with anything in it."""
    return not line.strip(" \t,;")


def cells_of(line: str, delimiter: str) -> list[str]:
    """A line of a text cut into cells by one character or ``whitespace``; the line itself where it cannot be cut."""
    if delimiter == WHITESPACE:
        return line.split()
    try:
        return next(csv.reader([line], delimiter=delimiter), [])
    except csv.Error:  # such as a cell of a million letters
        return [line]


def lines_of(path: Path, most: int | None = None) -> list[str]:
    """Lines of a text file.

    Args:
        path: The file.
        most: Lines that are enough; None reads the whole file.

    Returns:
        At least so many lines, if there are as many.

    Raises:
        InputError: If it is no text, or says nothing.
    """
    check_there(path)
    with path.open("rb") as file:
        raw = b"".join(islice(file, most))
        if raw.startswith(UTF16) or not raw.strip():  # ends of lines are two bytes then; or nothing is said as yet
            raw += file.read()
    if not raw.strip():
        raise InputError(f"{path.name}: empty file; expected columns of numbers")
    if b"\0" in raw and not raw.startswith(UTF16):
        raise InputError(f"{path.name}: not a text file; export it as CSV (text, one line a sample)")
    try:
        text = raw.decode("utf-16" if raw.startswith(UTF16) else "utf-8-sig")
    except UnicodeDecodeError:
        text = raw.decode("latin-1")  # headings such as psi [degree sign] from older programs
    # Lines end where an editor ends them: a heading may hold other characters that splitlines takes for ends of lines.
    return text.replace("\r\n", "\n").replace("\r", "\n").removesuffix("\n").split("\n")


def even_frame(
    path: Path,
    first: int,
    headings: Sequence[str],
    delimiter: str,
    decimal: str,
    texts: frozenset[str] = frozenset(),
) -> pd.DataFrame | None:
    """Cells below some lines, read block by block.

    Args:
        path: The file.
        first: Lines above the cells.
        headings: What the columns are called.
        delimiter: One character, or ``whitespace``.
        decimal: ``point`` or ``comma``.
        texts: Columns that are texts, whatever stands in them.

    Returns:
        A row a line; None if lines differ in length, are quoted or blank, which needs a closer look.
    """
    if len(set(headings)) < len(headings) or not (delimiter == WHITESPACE or delimiter.isascii()):
        return None
    columns: dict[str, list[pd.Series]] = {name: [] for name in headings}
    for block in _blocks(path, first):
        if block is None or not _is_even(block, len(headings), delimiter):
            return None
        frame = _cut(block, headings, delimiter, decimal, texts)
        if frame is None:
            return None
        for name, parts in columns.items():
            parts.append(frame[name].copy())  # else all columns of the block are kept as long as one of them is
    if not columns[headings[0]]:
        return None
    mixed = frozenset(name for name, parts in columns.items() if _is_mixed(parts))
    if mixed:
        return even_frame(path, first, headings, delimiter, decimal, mixed | texts)
    return pd.DataFrame({name: pd.concat(columns.pop(name), ignore_index=True) for name in headings}, copy=False)


def _blocks(path: Path, first: int) -> Iterator[bytes | None]:
    """Whole lines of a file below the first ones, each with its end; None where lines do not end as usual."""
    with _opened(path) as file:
        above = b"".join(islice(file, first)).replace(b"\r\n", b"\n")
        if b"\r" in above:
            yield None
        left = b""
        while read := file.read(BLOCK):
            whole, end, left = (left + read).rpartition(b"\n")
            if end:
                yield _with_usual_ends(whole + end)
        if left:
            yield _with_usual_ends(left + b"\n")


def _opened(path: Path) -> io.BufferedIOBase:
    """A text as bytes of UTF-8."""
    file = path.open("rb")
    if file.read(2) in UTF16:
        file.close()
        return io.BytesIO("\n".join(lines_of(path)).encode())
    file.seek(0)
    return file


def _with_usual_ends(block: bytes) -> bytes | None:
    """Lines that end as on Linux; None for ends of other kinds, and for what is no text."""
    block = block.replace(b"\r\n", b"\n")
    return None if b"\r" in block or b"\0" in block else block


def _is_even(block: bytes, columns: int, delimiter: str) -> bool:
    """Whether every line has so many cells, none is quoted and none is blank."""
    letters = np.frombuffer(block, dtype=np.uint8)
    ends = np.flatnonzero(letters == END)
    begins = np.append(0, ends[:-1] + 1)
    if b'"' in block or not np.logical_or.reduceat(~SAYS_NOTHING[letters], begins).all():
        return False
    if delimiter == WHITESPACE:
        return not FOREIGN[letters].any() and bool((_words(letters, begins) == columns).all())
    parting = np.flatnonzero(letters == ord(delimiter))
    if len(parting) != (columns - 1) * len(ends):
        return False
    of_lines = parting.reshape(len(ends), columns - 1)
    return bool((of_lines > begins[:, None] - 1).all() and (of_lines < ends[:, None]).all())


def _words(letters: UInt8[np.ndarray, " n"], begins: np.ndarray) -> np.ndarray:
    """Words of each line."""
    inside = ~PARTS_WORDS[letters]
    inside[1:] &= PARTS_WORDS[letters[:-1]]
    return np.add.reduceat(inside, begins, dtype=np.int64)


def _cut(
    block: bytes, headings: Sequence[str], delimiter: str, decimal: str, texts: frozenset[str]
) -> pd.DataFrame | None:
    """Cells of even lines; None for what is no UTF-8."""
    exactly: dict[str, Any] = {"float_precision": "round_trip"} if INEXACT else {}
    try:
        return pd.read_csv(
            io.BytesIO(block), sep=r"\s+" if delimiter == WHITESPACE else delimiter, header=None, names=list(headings),
            na_values=SPELT, keep_default_na=False, decimal="," if decimal == "comma" else ".",
            quoting=csv.QUOTE_NONE, skip_blank_lines=False, low_memory=False, index_col=False,
            dtype=dict.fromkeys(texts, str), **exactly,
        )  # fmt: skip
    except ValueError:
        return None


def _is_mixed(parts: Sequence[pd.Series]) -> bool:
    """Whether a column holds numbers in one block and texts in another."""
    kinds = {part.dtype for part in parts if not part.isna().all()}
    numbers = [k for k in kinds if pd.api.types.is_numeric_dtype(k) and not pd.api.types.is_bool_dtype(k)]
    return len(kinds) > 1 and len(numbers) < len(kinds)
