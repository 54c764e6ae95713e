"""MAT and parquet files are read as texts are, and foreign, hostile or broken ones are refused in one line."""

import pickle
import struct

import numpy as np
import pandas as pd
import pytest
from scipy.io import savemat

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.recording.propose.proposal import propose
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
    "HDF5": (lambda whole, trap: b"\x89HDF\r\n\x1a\n" + bytes(200), "version 7.3; save it again as"),
    "7.3": (lambda whole, trap: b"MATLAB 7.3 MAT-file, Platform".ljust(600), "version 7.3; save it again as"),
}  # fmt: skip


@pytest.mark.parametrize("how", BROKEN)
def test_a_broken_mat_file_is_refused(frame, tmp_path, columns, ship, how):
    make, message = BROKEN[how]
    trap = tmp_path / "trap"
    (tmp_path / "run.mat").write_bytes(make(whole_file(frame, tmp_path), trap))
    refused(tmp_path / "run.mat", columns(), ship, message)
    assert not trap.exists()


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
