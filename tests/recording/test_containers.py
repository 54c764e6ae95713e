"""MAT and parquet files are read as texts are, and foreign, hostile or broken ones are refused in one line."""

import mmap
import pickle
import struct
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from logs import placed, write_mat73
from scipy.io import savemat
from tiers import only

from manoeuvre_nn.core import memory
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.recording.propose.proposal import propose
from manoeuvre_nn.recording.read import containers
from manoeuvre_nn.recording.read.containers import columns_in
from manoeuvre_nn.recording.read.reader import read_recording, read_recordings


def refused(path, read, ship, message):
    with pytest.raises(InputError, match=message) as error:
        read_recording(path, read, ship)
    assert "\n" not in str(error.value) and len(str(error.value)) < 400


def vectors(frame):
    return {name: frame[name].to_numpy() for name in frame}


@pytest.mark.parametrize("shape", ["rows", "columns"])
def test_a_mat_file_of_vectors_is_read(zz20, frame, tmp_path, columns, ship, shape):
    savemat(tmp_path / "run.mat", vectors(frame), oned_as="row" if shape == "rows" else "column")
    record = read_recording(tmp_path / "run.mat", columns(), ship)
    np.testing.assert_array_equal(record["u"], zz20["u"])
    assert record.name == "run" and len(record) == len(zz20)


def test_fields_of_structures_and_columns_of_matrices_are_read_by_their_names(zz20, frame, tmp_path, columns, ship):
    content = {"log": {"nav": {"t": frame["t"], "uv": frame[["u", "v"]].to_numpy()}, **vectors(frame)}, "note": "calm"}
    savemat(tmp_path / "run.mat", content, do_compression=True)
    named = {k: {"column": f"log.{k}", "unit": unit} for k, unit in
             {"r": "rad/s", "x": "m", "y": "m", "psi": "rad", "delta": "rad"}.items()}  # fmt: skip
    named |= {"u": {"column": "log.nav.uv.1", "unit": "m/s"}, "v": {"column": "log.nav.uv.2", "unit": "m/s"}}
    read = columns(named, time={"column": "log.nav.t", "unit": "s"})
    record = read_recording(tmp_path / "run.mat", read, ship)
    np.testing.assert_array_equal(record["v"], zz20["v"])


def test_a_gap_in_a_mat_file_is_named_by_its_row(frame, tmp_path, columns, ship):
    frame.loc[30, "v"] = np.nan
    savemat(tmp_path / "run.mat", vectors(frame))
    refused(tmp_path / "run.mat", columns(), ship, "run.mat, row 31: column 'v' is the first of 1 empty cells")
    frame.loc[30, "v"] = np.inf
    savemat(tmp_path / "run.mat", vectors(frame))
    refused(tmp_path / "run.mat", columns(), ship, "row 31: column 'v' is inf; expected a finite number")


def test_a_mat_file_without_a_column_is_refused_with_what_it_has(frame, tmp_path, columns, ship):
    savemat(tmp_path / "run.mat", vectors(frame.drop(columns="psi")))
    refused(tmp_path / "run.mat", columns(), ship, "no column 'psi'; it has: t, u, v, r, x, y, delta")


def test_vectors_of_different_lengths_are_refused(frame, tmp_path, columns, ship):
    savemat(tmp_path / "run.mat", vectors(frame) | {"psi": frame["psi"].to_numpy()[:100]})
    refused(tmp_path / "run.mat", columns(), ship, "column 'psi' has 100 samples, the others 361")


def test_cells_and_objects_in_a_mat_file_are_never_opened(frame, tmp_path, columns, ship):
    pickled = np.frombuffer(pickle.dumps(print), dtype=np.uint8)
    cell = np.array([pickled, "os.system", 3.0], dtype=object)
    savemat(tmp_path / "run.mat", vectors(frame) | {"psi": cell, "bytes": pickled})
    refused(tmp_path / "run.mat", columns(), ship, "no column 'psi'")


class Touch:
    """Leaves a file behind if somebody unpickles it."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return open, (str(self.path), "w")


def whole_file(frame, tmp_path):
    savemat(tmp_path / "whole.mat", vectors(frame), do_compression=True)
    return (tmp_path / "whole.mat").read_bytes()


BROKEN = {
    "empty": (lambda whole, trap: b"", "empty file"),
    "a text": (lambda whole, trap: b"t,u,v\n1,2,3\n", "not a MAT file, or cut off"),
    "pickled": (lambda whole, trap: pickle.dumps(Touch(trap)), "not a MAT file, or cut off"),
    "pickled numpy": (lambda whole, trap: b"\x93NUMPY" + pickle.dumps(Touch(trap)), "not a MAT file, or cut off"),
    "cut off": (lambda whole, trap: whole[: len(whole) // 2], "not a MAT file, or cut off|no column"),
    "cut off in the head": (lambda whole, trap: whole[:60], "not a MAT file, or cut off"),
    "garbled": (lambda whole, trap: whole[:140] + bytes(range(256)) * 8, "not a MAT file, or cut off"),
    "zeros": (lambda whole, trap: bytes(4096), "MAT file|no vector|no column"),
    "endless": (
        lambda whole, trap: struct.pack("<5i", 0, 2**30, 2**30, 0, 2) + b"u\0", "not a MAT file|no vector|no column",
    ),
    "HDF5": (lambda whole, trap: b"\x89HDF\r\n\x1a\n" + bytes(200), "not a MAT file of version 7.3, or cut off"),
    "7.3": (lambda whole, trap: b"MATLAB 7.3 MAT-file, Platform".ljust(600), "not a MAT file of version 7.3, or cut"),
}  # fmt: skip
LIKE_OTHERS = {"a text", "pickled numpy", "cut off in the head", "garbled"}
"""Refused where others are, too."""


@pytest.mark.parametrize("how", only(set(BROKEN) - LIKE_OTHERS, BROKEN))
def test_a_broken_mat_file_is_refused(frame, tmp_path, columns, ship, how):
    make, message = BROKEN[how]
    trap = tmp_path / "trap"
    (tmp_path / "run.mat").write_bytes(make(whole_file(frame, tmp_path), trap))
    refused(tmp_path / "run.mat", columns(), ship, message)
    assert not trap.exists()


def test_a_mat_file_that_breaks_its_reader_down_is_refused(frame, tmp_path, columns, ship):
    """A vector that is said to be complex, and is not: scipy 1.17 ends the process."""
    savemat(tmp_path / "run.mat", vectors(frame))
    whole = (tmp_path / "run.mat").read_bytes()
    flags = struct.pack("<3i", 6, 8, 6)  # flags of an array, of eight bytes, doubles
    (tmp_path / "run.mat").write_bytes(whole.replace(flags, flags[:9] + b"\x08" + flags[10:]))
    refused(tmp_path / "run.mat", columns(), ship, "not a MAT file, or")


@pytest.fixture
def newer(tmp_path):
    """Writes a MAT file of version 7.3."""
    pytest.importorskip("h5py", reason='MAT files of version 7.3 need the extra: pip install -e ".[mat]"')
    return lambda columns, structure="": write_mat73(tmp_path / "run.mat", columns, structure)


@pytest.mark.parametrize("turned", [False, True])
def test_a_mat_file_of_version_7_3_is_read_as_an_older_one_is(zz20, frame, newer, columns, ship, turned):
    record = read_recording(newer({k: v[:, None] if turned else v for k, v in vectors(frame).items()}), columns(), ship)
    np.testing.assert_array_equal(record["u"], zz20["u"])


def test_structures_and_matrices_of_version_7_3_have_the_names_that_older_ones_have(zz20, frame, newer, ship):
    content = {**vectors(frame.drop(columns=["u", "v"])), "uv": frame[["u", "v"]].to_numpy().T}
    made = propose(newer(content, "log"), ship)
    assert {"log.psi", "log.t"} <= set(made.file.numbers) and "log.uv.2" in made.left_out
    np.testing.assert_array_equal(made.file.numbers["log.uv.2"], zz20["v"])


def test_signals_with_times_of_their_own_are_put_on_one_axis(zz20, frame, tmp_path, newer, columns, ship):
    signals = {k: {"Time": frame["t"].to_numpy(), "Data": v} for k, v in vectors(frame).items() if k != "t"}
    signals["r"] = {"Time": zz20.time[::2], "Data": zz20["r"][::2]}
    savemat(tmp_path / "old.mat", signals)
    read = columns(time={"column": "time [s]", "unit": "s"})
    record = read_recording(tmp_path / "old.mat", read, ship)
    np.testing.assert_allclose(record["v"], zz20["v"][::2])
    flat = {f"{name}/{k}": v for name, both in signals.items() for k, v in both.items()}
    np.testing.assert_allclose(read_recording(newer(flat), read, ship)["v"], zz20["v"][::2])


def test_links_out_of_a_mat_file_of_version_7_3_are_not_followed(frame, newer, columns, ship, tmp_path):
    path = newer(vectors(frame.drop(columns="psi")))
    h5py = pytest.importorskip("h5py")
    write_mat73(tmp_path / "other.mat", {"psi": frame["psi"].to_numpy()})
    with h5py.File(path, "r+") as file:
        file["psi"] = h5py.ExternalLink(str(tmp_path / "other.mat"), "psi")
        layout = h5py.VirtualLayout(shape=(1, len(frame)), dtype="f8")
        layout[:] = h5py.VirtualSource(str(tmp_path / "other.mat"), "psi", shape=(1, len(frame)))
        file.create_virtual_dataset("psi2", layout)
    refused(path, columns(), ship, "no column 'psi'; it has: delta, r, t, u, v, x, y")


def test_a_mat_file_of_version_7_3_that_does_not_fit_into_memory_is_refused(newer, columns, ship, tmp_path):
    path = newer({"t": np.arange(5.0)})
    with pytest.importorskip("h5py").File(path, "r+") as file:
        file.create_dataset("u", shape=(1, 10**13), dtype="f8", chunks=(1, 1000))
    refused(path, columns(), ship, "^run.mat: 8e.04 GB of numbers need about 1.6e.05 GB of memory")


def test_without_h5py_the_extra_is_named(frame, newer, columns, ship, monkeypatch):
    path = newer(vectors(frame))
    monkeypatch.setitem(__import__("sys").modules, "h5py", None)
    refused(path, columns(), ship, r"pip install 'manoeuvre-nn\[mat\]', or save it again")


def test_a_mat_file_called_csv_is_refused(frame, tmp_path, columns, ship):
    (tmp_path / "run.csv").write_bytes(whole_file(frame, tmp_path))
    refused(tmp_path / "run.csv", columns(), ship, "not a text file")


def test_parquet_without_pyarrow_names_the_extra(frame, tmp_path, columns, ship, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pyarrow", None)
    (tmp_path / "run.parquet").write_bytes(b"PAR1")
    refused(tmp_path / "run.parquet", columns(), ship, r"pip install 'manoeuvre-nn\[parquet\]'")


@pytest.fixture
def parquet(tmp_path):
    pytest.importorskip("pyarrow", reason="pyarrow is not installed: pip install pyarrow")

    def write(table: pd.DataFrame):
        table.to_parquet(tmp_path / "run.parquet", index=False)
        return tmp_path / "run.parquet"

    return write


def test_a_parquet_file_is_read_with_times_as_dates(zz20, frame, parquet, columns, ship):
    frame["t"] = pd.Timestamp("2020-07-31T12:00:00") + pd.to_timedelta(frame["t"], unit="s")
    frame["u"] = frame["u"].astype("float32")
    read = columns(time={"column": "t", "unit": "iso"}, time_zone="Asia/Tokyo")
    record = read_recording(parquet(frame), read, ship)
    np.testing.assert_allclose(record["u"], zz20["u"], rtol=1e-6)
    np.testing.assert_allclose(record.time, zz20.time)
    assert record.meta["started"] == 1596164400.0


def test_a_mapping_is_proposed_for_a_parquet_file_by_units_in_its_names(zz20, parquet, ship):
    names = ["t [s]", "lat", "lon", "SOG (kn)", "COG deg", "Heading (deg)", "ROT deg/min", "rudder [°]", "u kn", "v kn"]
    path = parquet(placed(zz20).set_axis(names, axis=1))
    made = propose(path, ship)
    assert made.finding is None and {c.channel: c.unit for c in made.choices}["r"] == "deg/min"
    record = read_recording(path, made.mapping, ship)
    for name in ("u", "v", "r", "delta", "psi"):
        np.testing.assert_allclose(record[name], zz20[name], atol=1e-12)


def test_a_parquet_file_without_a_column_is_refused(frame, parquet, columns, ship):
    refused(parquet(frame.drop(columns="psi")), columns(), ship, "no column 'psi'; it has: t, u, v, r, x, y, delta")


def test_a_parquet_file_of_nothing_or_of_lists_is_refused(frame, parquet, columns, ship):
    refused(parquet(frame.head(0)), columns(), ship, "empty file")
    lists = frame.assign(u=[[1.0, 2.0]] * len(frame))
    refused(parquet(lists), columns(), ship, "row 1: column 'u' is .* expected a number")


@pytest.mark.parametrize("how", ["cut", "text", "head"])
def test_a_broken_parquet_file_is_refused(frame, parquet, columns, ship, how):
    path = parquet(frame)
    whole = path.read_bytes()
    path.write_bytes({"cut": whole[:-100], "text": b"t,u\n1,2\n", "head": b"PAR1" + bytes(50) + b"PAR1"}[how])
    refused(path, columns(), ship, "not a parquet file, or cut off")


def test_a_folder_is_read_whatever_its_files_are(frame, tmp_path, columns, ship):
    savemat(tmp_path / "b.mat", vectors(frame))
    frame.to_csv(tmp_path / "a.csv", index=False)
    (tmp_path / "notes.txt").write_text("calm")
    assert [r.name for r in read_recordings(tmp_path, columns(), ship)] == ["a", "b"]


def test_a_mapping_is_proposed_for_a_structure_in_a_mat_file(zz20, frame, tmp_path, ship):
    savemat(tmp_path / "run.mat", {"ship": vectors(frame)})
    made = propose(tmp_path / "run.mat", ship)
    assert made.mapping.channels["psi"].column == "ship.psi" and made.finding is None
    np.testing.assert_allclose(read_recording(tmp_path / "run.mat", made.mapping, ship)["v"], zz20["v"])


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="only Linux says what memory is free")
def test_what_a_file_unpacks_to_is_bounded_by_the_memory_that_is_free_while_it_is_read(tmp_path, monkeypatch):
    import resource

    def unpack(path, columns):
        try:
            mmap.mmap(-1, 60_000_000).close()
        except OSError as error:
            raise MemoryError from error
        return pd.DataFrame({"t": [0.0, 1.0]})

    path, before = tmp_path / "run.packed", resource.getrlimit(resource.RLIMIT_AS)
    path.write_bytes(b"little")
    monkeypatch.setitem(containers.READERS, ".packed", unpack)
    monkeypatch.setattr(memory, "MAPPED", 0.0)
    monkeypatch.setattr(memory, "free_memory", lambda: 2e8)
    assert len(columns_in(path)) == 2
    monkeypatch.setattr(memory, "free_memory", lambda: 3e7)
    with pytest.raises(InputError, match=r"run\.packed: what it holds takes more memory than is free: cut it into"):
        columns_in(path)
    assert resource.getrlimit(resource.RLIMIT_AS) == before
