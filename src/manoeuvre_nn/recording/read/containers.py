"""Formats that are no texts of columns: a function each, found by suffix or by how a file begins.

Nothing in a file is ever executed or unpickled.
"""

import os
from collections.abc import Callable, Sequence
from pathlib import Path

import pandas as pd

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.memory import within_free_memory

BEGIN = 1 << 14
"""Bytes that tell what a file is whose suffix does not."""
BAG_FOLDER, METADATA = "rosbag2", "metadata.yaml"
"""What stands for a suffix of a folder that is one recording, and the file by which it is known."""
NOTES, QUESTIONS = "notes", "questions"
"""Keys of a frame's ``attrs``: sentences about how it was read; column -> what it was assumed to be."""
ROWS = "rows"
"""Key of a frame's ``attrs``: rows of the file that its samples stand in; 1, 2, 3 and so on without it."""
Reader = Callable[[Path, Sequence[str] | None], pd.DataFrame]
"""Gives the columns of a file: numbers, texts or times, a row a sample; of those wanted at least, where None is all. It
raises InputError for a file that it cannot read."""
READERS: dict[str, Reader] = {}
"""Suffix in small letters -> its reader."""
KNOWN_BY: list[tuple[Callable[[bytes], bool], Reader]] = []
"""Whether a file of any other suffix begins as a format does, and its reader."""


def reads(*suffixes: str, known_by: Callable[[bytes], bool] | None = None) -> Callable[[Reader], Reader]:
    """Register a reader, in this package or in a module of one's own: ``@reads(".mat")`` before the function.

    Args:
        *suffixes: Suffixes of its files.
        known_by: Whether bytes are the begin of such a file, which then may have any suffix.

    Returns:
        The decorator.
    """

    def register(reader: Reader) -> Reader:
        READERS.update(dict.fromkeys((suffix.lower() for suffix in suffixes), reader))
        if known_by is not None:
            KNOWN_BY.append((known_by, reader))
        return reader

    return register


def is_bag_folder(path: Path) -> bool:
    """Whether a folder is one recording: a bag of ROS 2, as its metadata say."""
    note = path / METADATA
    if not note.is_file() or not os.access(note, os.R_OK):
        return False
    with note.open("rb") as file:
        return b"rosbag2_bagfile_information" in file.read(BEGIN)


def reader_of(path: Path) -> Reader | None:
    """The reader of a file; None for a text of columns, and for what is not there."""
    kind = BAG_FOLDER if is_bag_folder(path) else path.suffix.lower()
    if kind in READERS or not path.is_file() or not os.access(path, os.R_OK):
        return READERS.get(kind)
    with path.open("rb") as file:
        begin = file.read(BEGIN)
    return next((reader for is_such, reader in KNOWN_BY if is_such(begin)), None)


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
    """Columns of a file that has a reader; the index counts rows from 1, as the file has them."""
    if not is_bag_folder(path):
        check_there(path)
    reader = reader_of(path)
    assert reader is not None
    try:
        with within_free_memory():
            frame = reader(path, wanted)
    except MemoryError as error:
        raise InputError(f"{path.name}: what it holds takes more memory than is free: cut it into parts") from error
    numbered = frame.set_axis(pd.Index(frame.attrs.get(ROWS, range(1, len(frame) + 1))))
    numbered.attrs = frame.attrs
    return numbered


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
