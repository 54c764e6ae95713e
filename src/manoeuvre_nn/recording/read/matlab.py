"""MAT files of all versions: vectors by their names, out of structures and matrices too."""

import subprocess
import sys
import warnings
from collections.abc import Iterator, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.io import loadmat
from scipy.io.matlab import mat_struct, matfile_version

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.memory import check_memory
from manoeuvre_nn.recording.read.containers import NOTES, reads
from manoeuvre_nn.recording.read.streams import Stream, on_one_axis

TRY = "import sys; from scipy.io import loadmat; loadmat(sys.argv[1])"
"""Program that reads a MAT file and does nothing with it."""
HDF5 = b"\x89HDF\r\n\x1a\n"
"""How a MAT file of version 7.3 may begin, too: it is an HDF5 file."""
MAX_COLUMNS = 100
"""Matrices with more are no tables of channels."""
MAX_DEPTH = 4
"""How deep structures are looked into."""
TIMED = ("time", "data")
"""Fields, in small letters, of a signal with times of its own, as of a timeseries that was made a structure."""
Vectors = dict[str, np.ndarray]


@reads(".mat")
def mat_frame(path: Path, columns: Sequence[str] | None = None) -> pd.DataFrame:
    """Vectors of a MAT file, by their names.

    ``a.b`` is field b of structure a, ``a.2`` the second column of matrix a. Where structures hold ``Time`` and
    ``Data``, each of them is a signal called as the structure, put on one axis of time.

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
    newer = begin.startswith(HDF5) or b"MATLAB 7.3" in begin
    vectors, notes = _newer(path) if newer else (_older(path), [])
    if not vectors:
        said = f": {notes[0]}" if notes else ""
        raise InputError(f"{path.name}: holds no vector of numbers; expected one vector a channel{said}")
    signals = [name.rpartition(".")[0] for name in vectors if name.lower().endswith(f".{TIMED[1]}")]
    timed = _signals(vectors, signals)
    if timed and len(vectors) > 2 * len(timed):
        notes = [*notes, "Left out is what is no structure of Time and Data, for others are: give it such a one."]
    frame = on_one_axis(timed, columns, dated=False) if timed else _framed(path, vectors, columns)
    frame.attrs[NOTES] = notes
    return frame


def _older(path: Path) -> Vectors:
    """Vectors of a file of version 4 to 7.2."""
    now = path.stat()
    if _breaks_down(str(path), now.st_mtime_ns, now.st_size):
        raise InputError(f"{path.name}: not a MAT file, or damaged: its reader breaks down; export it again, or as CSV")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of objects that it cannot make, which are left out
            content = loadmat(path, squeeze_me=True, struct_as_record=False, chars_as_strings=True)
    except MemoryError as error:
        raise InputError(f"{path.name}: not a MAT file that fits into memory; is it cut off?") from error
    except Exception as error:  # its reader raises many kinds on foreign, hostile and cut-off files
        said = " ".join(str(error).split())[:80] or type(error).__name__
        raise InputError(f"{path.name}: not a MAT file, or cut off ({said}); export it again, or as CSV") from None
    named = (pair for name in content if not name.startswith("__") for pair in _fields(name, content[name], 0))
    return dict(vector for name, value in named for vector in _columns(name, value))


@lru_cache(maxsize=64)
def _breaks_down(file: str, changed: int, size: int) -> bool:
    """Whether scipy's reader ends its process, as on some damaged files (1.17: a number of no known type).

    Another process tries first: once for a file as it was when it was ``changed`` and of this ``size``.

    Returns:
        Whether it does; not where the file has no head of a MAT file, which the reader refuses as it should.
    """
    try:
        matfile_version(file)
    except Exception:  # of many kinds; the reader meets it again, and says why
        return False
    return subprocess.run([sys.executable, "-c", TRY, file], capture_output=True, check=False).returncode not in {0, 1}


def _fields(name: str, value: Any, depth: int) -> Iterator[tuple[str, np.ndarray]]:
    """Arrays in a value of an older file and in what it holds."""
    if isinstance(value, mat_struct) and depth < MAX_DEPTH:
        for field in value._fieldnames:
            yield from _fields(f"{name}.{field}", getattr(value, field), depth + 1)
    elif isinstance(value, np.ndarray):
        yield name, value


def _newer(path: Path) -> tuple[Vectors, list[str]]:
    """Vectors of a file of version 7.3, and what is left out; links to other files are not followed."""
    try:
        import h5py
    except ImportError as error:
        raise InputError(
            f"{path.name}: a MAT file of version 7.3 needs h5py: pip install 'manoeuvre-nn[mat]', or save it again as "
            'save(file, "-v7")'
        ) from error
    try:
        with h5py.File(path, "r") as file:
            found = list(_datasets(file, h5py, 0))
            size = sum(one.nbytes for _, one in found)
            check_memory(f"{path.name}: {size / 1e9:.2g} GB of numbers", 2.0 * size, "save the channels alone")
            objects = any("MATLAB_object_decode" in file[name].attrs for name in file if _is_own(file, name, h5py))
            vectors = dict(v for name, one in found for v in _columns(name, _array(one)))
    except InputError:
        raise
    except (OSError, RuntimeError, ValueError, KeyError, TypeError, MemoryError) as error:
        said = " ".join(str(error).split())[:80]
        raise InputError(
            f"{path.name}: not a MAT file of version 7.3, or cut off ({said}); save it again as "
            'save(file, "-v7") or as CSV'
        ) from None
    note = "Objects such as timeseries are left out, only MATLAB opens them: save their Time and Data in a structure."
    return vectors, [note] if objects else []


def _is_own(group: Any, name: str, h5py: Any) -> bool:
    """Whether a name in a group stands for what the file itself holds."""
    return not name.startswith("#") and isinstance(group.get(name, getlink=True), h5py.HardLink)


def _datasets(group: Any, h5py: Any, depth: int, name: str = "") -> Iterator[tuple[str, Any]]:
    """Arrays of a group and of the groups in it, one structure deep and more."""
    for key in group:
        if not _is_own(group, key, h5py):
            continue
        one, called = group[key], f"{name}.{key}" if name else key
        if isinstance(one, h5py.Group) and depth < MAX_DEPTH:
            yield from _datasets(one, h5py, depth + 1, called)
        elif isinstance(one, h5py.Dataset) and not one.is_virtual and not one.external:
            if one.ndim in {1, 2} and one.dtype.kind in "fiu" and "MATLAB_empty" not in one.attrs:
                yield called, one


def _array(dataset: Any) -> np.ndarray:
    """A matrix as MATLAB shows it, a text as texts: MATLAB writes columns first."""
    values = np.asarray(dataset[()]).T
    if dataset.attrs.get("MATLAB_class") == b"char":
        return np.array(["".join(map(chr, row)).strip() for row in np.atleast_2d(values)])
    return values


def _columns(name: str, value: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """Vectors of an array: itself, or the columns of a matrix."""
    if value.dtype.kind not in "fiuU" or value.size < 2:
        return
    flat: np.ndarray = value.ravel() if 1 in value.shape else value
    if flat.ndim == 1:
        yield name, flat
    elif flat.ndim == 2 and value.dtype.kind != "U" and flat.shape[1] <= MAX_COLUMNS:
        yield from ((f"{name}.{k}", flat[:, k - 1]) for k in range(1, flat.shape[1] + 1))


def _signals(vectors: Vectors, names: Sequence[str]) -> list[Stream]:
    """Signals with times of their own, of structures that have as many times as data."""
    found = {}
    for name in names:
        time, data = (next((v for k, v in vectors.items() if k.lower() == f"{name}.{f}".lower()), None) for f in TIMED)
        if time is not None and data is not None and len(time) == len(data) and time.dtype.kind != "U":
            found[name] = time, data
    return [Stream(np.asarray(t, dtype=float), {n: np.asarray(d, dtype=float)}) for n, (t, d) in found.items()]


def _framed(path: Path, vectors: Vectors, columns: Sequence[str] | None) -> pd.DataFrame:
    """Vectors of one length side by side."""
    named = {k: len(v) for k, v in vectors.items() if columns is None or k in columns}
    lengths = list(named.values()) or [len(v) for v in vectors.values()]
    usual = max(set(lengths), key=lengths.count)
    for name, length in named.items():
        if columns is not None and length != usual:
            raise InputError(
                f"{path.name}: column {name!r} has {length} samples, the others {usual}; all need the same number"
            )
    same = {k: v for k, v in vectors.items() if len(v) == usual}
    return pd.DataFrame({k: v.astype(v.dtype.newbyteorder("=")) for k, v in same.items()})
