"""Formats that are no texts: a function each, found by suffix; nothing in a file is ever executed or unpickled."""

import os
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.io import loadmat
from scipy.io.matlab import mat_struct

from manoeuvre_nn.core.errors import InputError

HDF5 = b"\x89HDF\r\n\x1a\n"
"""How a MAT file of version 7.3 may begin, too: it is an HDF5 file."""
MOST_COLUMNS = 100
"""Matrices with more are no tables of channels."""
DEEPEST = 4
"""How deep structures are looked into."""
Reader = Callable[[Path, Sequence[str] | None], pd.DataFrame]
"""Gives the columns of a file: numbers, texts or times, a row a sample; of those wanted at least, where None is all. It
raises InputError for a file that it cannot read."""
READERS: dict[str, Reader] = {}
"""Suffix in small letters -> its reader."""


def reads(suffix: str) -> Callable[[Reader], Reader]:
    """Register a reader, in this package or in a module of one's own: ``@reads(".mat")`` before the function."""

    def register(reader: Reader) -> Reader:
        READERS[suffix.lower()] = reader
        return reader

    return register


def has_reader(path: Path) -> bool:
    """Whether a file is no text."""
    return path.suffix.lower() in READERS


def check_there(path: Path) -> None:
    """Refuse a file that is missing, a folder, or empty."""
    if path.is_dir():
        raise InputError(f"{path}: is a folder; write a file")
    if not path.exists():
        raise InputError(f"{path}: no such file")
    if not path.is_file():
        raise InputError(f"{path}: is no file but a device or a pipe; write a file")
    if not os.access(path, os.R_OK):
        raise InputError(f"{path}: may not be read; ask its owner, or copy it")
    if not path.stat().st_size:
        raise InputError(f"{path.name}: empty file; expected columns of numbers")


def columns_in(path: Path, wanted: Sequence[str] | None = None) -> pd.DataFrame:
    """Columns of a file that has a reader; the index counts rows from 1."""
    check_there(path)
    frame = READERS[path.suffix.lower()](path, wanted)
    return frame.set_axis(pd.RangeIndex(1, len(frame) + 1))


@reads(".mat")
def mat_frame(path: Path, columns: Sequence[str] | None = None) -> pd.DataFrame:
    """Vectors of a MAT file of version 4 to 7.2, by their names.

    ``a.b`` is field b of structure a, ``a.2`` the second column of matrix a.

    Args:
        path: The file.
        columns: Names that are wanted; None gives all vectors of the commonest length.

    Returns:
        One column a vector.

    Raises:
        InputError: If it is no such file, is cut off, or the vectors wanted differ in length.
    """
    with path.open("rb") as file:
        begin = file.read(128)
    if begin.startswith(HDF5) or b"MATLAB 7.3" in begin:
        raise InputError(f'{path.name}: a MAT file of version 7.3; save it again as save(file, "-v7") or as CSV')
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of objects that it cannot make, which are left out
            content = loadmat(path, squeeze_me=True, struct_as_record=False, chars_as_strings=True)
    except MemoryError as error:
        raise InputError(f"{path.name}: not a MAT file that fits into memory; is it cut off?") from error
    except Exception as error:  # its reader raises many kinds on foreign, hostile and cut-off files
        said = " ".join(str(error).split())[:80] or type(error).__name__
        raise InputError(f"{path.name}: not a MAT file, or cut off ({said}); export it again, or as CSV") from None
    vectors = {k: v for name in content if not name.startswith("__") for k, v in _vectors(name, content[name], 0)}
    return _framed(path, vectors, columns)


def _vectors(name: str, value: Any, depth: int) -> Iterator[tuple[str, np.ndarray]]:
    """Vectors in a value and in what it holds."""
    if isinstance(value, mat_struct) and depth < DEEPEST:
        for field in value._fieldnames:
            yield from _vectors(f"{name}.{field}", getattr(value, field), depth + 1)
    elif isinstance(value, np.ndarray) and value.dtype.kind in "fiuU" and value.size > 1:
        if value.ndim == 1:
            yield name, value
        elif value.ndim == 2 and value.dtype.kind != "U" and value.shape[1] <= MOST_COLUMNS:
            yield from ((f"{name}.{k}", value[:, k - 1]) for k in range(1, value.shape[1] + 1))


def _framed(path: Path, vectors: dict[str, np.ndarray], columns: Sequence[str] | None) -> pd.DataFrame:
    """Vectors of one length side by side."""
    named = {k: len(v) for k, v in vectors.items() if columns is None or k in columns}
    if not vectors:
        raise InputError(f"{path.name}: holds no vector of numbers; expected one vector a channel")
    lengths = list(named.values()) or [len(v) for v in vectors.values()]
    usual = max(set(lengths), key=lengths.count)
    for name, length in named.items():
        if columns is not None and length != usual:
            raise InputError(
                f"{path.name}: column {name!r} has {length} samples, the others {usual}; all need the same number"
            )
    same = {k: v for k, v in vectors.items() if len(v) == usual}
    return pd.DataFrame({k: v.astype(v.dtype.newbyteorder("=")) for k, v in same.items()})


@reads(".parquet")
def parquet_frame(path: Path, columns: Sequence[str] | None = None) -> pd.DataFrame:
    """Columns of a parquet file, those that are wanted; refused if pyarrow is not installed, or it is none."""
    try:
        from pyarrow import ArrowException
        from pyarrow.parquet import ParquetFile
    except ImportError as error:
        raise InputError(
            f"{path.name}: parquet files need pyarrow: pip install 'manoeuvre-nn[parquet]', or export it as CSV"
        ) from error
    try:
        with ParquetFile(path) as file:
            there = list(file.schema_arrow.names)
            wanted = [c for c in there if columns is None or c in columns]
            # Without pandas' own notes in the file: they could name an index or types of their own.
            table = file.read(columns=wanted).replace_schema_metadata(None) if wanted else None
    except (ArrowException, OSError, ValueError, MemoryError) as error:
        said = " ".join(str(error).split())[:80]
        raise InputError(f"{path.name}: not a parquet file, or cut off ({said}); export it again, or as CSV") from None
    if table is None:
        return pd.DataFrame(columns=there)
    if not table.num_rows:
        raise InputError(f"{path.name}: empty file; expected columns of numbers")
    return table.to_pandas(ignore_metadata=True)
