"""manoeuvre import as it is typed."""

import io
import os
import runpy
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from rich.console import Console

from manoeuvre_nn.commands.config import read_mapping
from manoeuvre_nn.commands.import_recording import import_recording, request, ship_called
from manoeuvre_nn.core.data_files import load_yaml
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.terminal import Terminal
from manoeuvre_nn.core.units import DEGREE

ROOT = Path(__file__).parents[2]
CONF = ROOT / "conf"


@pytest.fixture(scope="module")
def recorded(tmp_path_factory, zz20):
    columns = {"t": zz20.time, "u": zz20["u"], "v": -zz20["v"], "rot_degps": zz20["r"] / DEGREE, "x": zz20["x"],
               "y": zz20["y"], "hdg": np.mod(zz20["psi"] / DEGREE, 360), "rudder": -zz20["delta"] / DEGREE}  # fmt: skip
    path = tmp_path_factory.mktemp("runs") / "zz (1).csv"
    pd.DataFrame(columns).to_csv(path, index=False)
    return path


def printed(asked):
    text = io.StringIO()
    import_recording(asked, Console(file=text, width=130))
    return text.getvalue()


def test_the_table_shows_what_was_chosen_and_why_and_ends_with_the_next_command(recorded, tmp_path):
    said = printed(request([str(recorded), "ship=mariner", f"out={tmp_path / 'my.yaml'}"]))
    rows = {line.split()[0]: line for line in said.splitlines() if line.strip()}
    assert rows["v"].split()[:5] == ["v", "v", "m/s", "-", "0.00"] and "unit by data" in rows["v"]
    assert rows["r"].split()[1:4] == ["rot_degps", "deg/s", "+"] and "unit by name" in rows["r"]
    assert "rudder_positive_to: port" in said and "reference_point: 0.0  (undecided" in said
    check, last = (shlex.split(line) for line in said.splitlines()[-2:])
    assert check[:4] == ["next:", "manoeuvre", "check", "ship=mariner"] and check[4:] == last[5:]
    assert last[:5] == ["then:", "manoeuvre", "train", "ship=mariner", "data=recording"]
    assert f"data.mapping={tmp_path / 'my.yaml'}" in last and 'data.files=["zz (1).csv"]' in last
    assert max(map(len, said.splitlines()[:12])) <= 130
    assert "put a second recording into that folder before you train" in said


def test_where_another_recording_lies_beside_it_no_second_one_is_asked_for(recorded, tmp_path):
    for name in ("a.csv", "b.csv"):
        (tmp_path / name).write_bytes(recorded.read_bytes())
    said = printed(request([str(tmp_path / "a.csv"), "ship=mariner", f"out={tmp_path / 'my.yaml'}"]))
    assert "then: manoeuvre train" in said and "second recording" not in said


def test_what_is_undecided_is_asked_in_the_terminal_and_in_the_yaml(recorded, tmp_path):
    table = pd.read_csv(recorded).assign(u=lambda f: f["u"] / 0.5144, v=lambda f: f["v"] / 0.5144)
    table.drop(columns=["x", "y"]).to_csv(tmp_path / "a.csv", index=False)
    said = printed(request([str(tmp_path / "a.csv"), f"out={tmp_path / 'my.yaml'}"]))
    question = "is 'u' in m/s, positive ahead? If not, change its unit (to kn, km/h), sign."
    assert f"  u: {question}" in said and question in (tmp_path / "my.yaml").read_text()
    assert "write your ship for SHIP" in said and "next: manoeuvre check ship=SHIP" in said


@pytest.mark.slow
def test_the_command_that_is_told_next_runs_as_it_stands(recorded, tmp_path):
    said = printed(request([str(recorded), "ship=mariner", f"out={tmp_path / 'my.yaml'}"]))
    words = shlex.split(next(line for line in said.splitlines() if line.startswith("next: ")))[3:]
    command = [sys.executable, str(ROOT / "scripts" / "check_recordings.py"), *words, "figures=false"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, cwd=tmp_path)
    assert done.returncode == 0 and "1 recording" in done.stdout, done.stderr


def test_the_yaml_is_a_mapping_that_training_takes(recorded, tmp_path):
    printed(request([str(recorded), f"out={tmp_path / 'deep' / 'my.yaml'}"]))
    content = load_yaml(tmp_path / "deep" / "my.yaml")
    assert read_mapping(str(tmp_path / "deep" / "my.yaml")).channels["v"].sign == -1
    assert content["channels"]["v"] == {"column": "v", "unit": "m/s", "sign": -1}
    assert content["channels"]["delta"] == {"column": "rudder", "unit": "deg"}
    assert content["rudder_positive_to"] == "port"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "0 files are given, expected one; write manoeuvre import FILE"),
        (["a.csv", "b.csv"], "2 files are given"),
        (["a.csv", "shp=mariner"], "there is no setting shp"),
        (["a.csv", "overwrite=yes"], "expected true or false"),
        (["a.csv", "name=a", "out=b.yaml"], "write one of them"),
        (["a.csv", "name=../evil"], "expected letters"),
        (["a.csv", "out=."], "is a folder"),
        (["a.csv", "name=esso_osaka", "config_dir=mine"], "name=esso_osaka is the package's own mapping"),
    ],
)
def test_a_command_that_makes_no_sense_is_refused(arguments, message):
    with pytest.raises(InputError, match=message) as error:
        request(arguments)
    assert "\n" not in str(error.value)


def test_what_is_there_is_overwritten_only_where_that_is_said(tmp_path):
    place = tmp_path / "my.yaml"
    place.write_text("kept")
    with pytest.raises(InputError, match="is there already"):
        request(["a.csv", f"out={place}"])
    assert request(["a.csv", f"out={place}", "overwrite=true"]).out == place


def test_a_named_mapping_goes_into_the_own_folder_or_this_one_and_the_next_command_finds_it(
    recorded, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    for words, written, found in (
        (["name=my_ship"], "my_ship.yaml", "data.mapping=my_ship.yaml"),
        (["name=my_ship", "config_dir=mine"], "mine/recording/my_ship.yaml", "config_dir=mine data.mapping=my_ship "),
    ):
        told = printed(request([str(recorded), *words]))
        assert Path(written).exists()
        assert f"written: {written}" in told and found in told


def test_every_ship_is_known_and_others_are_listed():
    for path in (CONF / "ship").glob("*.yaml"):
        assert ship_called(path.stem).length > 0
    with pytest.raises(InputError, match="ship=titanic is unknown; choose one of: .*mariner"):
        ship_called("titanic")


def test_a_mapping_of_captive_tests_is_not_taken_for_one_of_a_record():
    with pytest.raises(InputError, match="mapping=kvlcc2_hmri is no mapping of a record over time"):
        read_mapping("kvlcc2_hmri")


def test_a_file_that_is_missing_ends_in_one_line_and_code_2(tmp_path, monkeypatch, capsys):
    script = str(ROOT / "scripts" / "import_recording.py")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [script, str(tmp_path / "nowhere.csv")])
    with pytest.raises(SystemExit) as end:
        runpy.run_path(script, run_name="__main__")
    told = capsys.readouterr()
    assert end.value.code == 2
    assert all(line.endswith(" so far") for line in told.out.splitlines())  # of a slow machine
    assert told.err.strip().endswith("nowhere.csv: no such file") and told.err.count("\n") == 1


def test_the_file_itself_is_never_overwritten(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("t,u\n0,1\n")
    with pytest.raises(InputError, match="is the file to be imported and would be lost"):
        request([str(path), f"out={path}", "overwrite=true"])


def test_the_mapping_is_written_also_where_nobody_reads_what_is_printed(recorded, tmp_path):
    reads, writes = os.pipe()
    os.close(reads)
    with open(writes, "w") as pipe, pytest.raises(SystemExit) as end:
        import_recording(request([str(recorded), f"out={tmp_path / 'my.yaml'}"]), Terminal(file=pipe, quiet=False))
    assert end.value.code == 141 and read_mapping(str(tmp_path / "my.yaml"))
