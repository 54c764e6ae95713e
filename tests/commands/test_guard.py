import os
import runpy
from io import StringIO
from pathlib import Path

import pytest
from hydra import compose, initialize_config_dir
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import ConfigCompositionException, InstantiationException
from hydra.utils import instantiate
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from manoeuvre_nn import __version__
from manoeuvre_nn.commands import guard, main
from manoeuvre_nn.commands.guard import as_word, explain, guarded, of_home, one_line
from manoeuvre_nn.core.data_files import CONF
from manoeuvre_nn.core.ending import WRONG_INPUT
from manoeuvre_nn.core.errors import InputError


def raised(act) -> BaseException:
    with pytest.raises(BaseException) as caught:  # noqa: B017, PT011
        act()
    return caught.value


@pytest.mark.parametrize(
    "words, told",
    [
        (["ship=submarine"], "ship=submarine is unknown; choose one of: container, container_twin, esso_190k,"),
        (
            ["experiment=nope"],
            "experiment=nope is unknown; choose one of: cepowski2007, rajesh2009, structure, wang1996",
        ),
        (["hydra/launcher=nope"], "hydra/launcher=nope is unknown; choose one of: basic, joblib, "),
        (["manoeuvre=[zz35,nope]"], "manoeuvre=nope is unknown; manoeuvre train --help lists the choices"),
        (
            ["network.hiden=3"],
            "there is no setting network.hiden: the nearest is network.hidden; manoeuvre train --cfg job lists",
        ),
        (
            ["effect.current.speed=3"],
            "there is no setting effect.current.speed; manoeuvre train --cfg job lists them all; those of current are "
            "there once 'effect=[current]' is written",
        ),
        (["recordings=x"], "there is no setting recordings; the folder of measured files is data.folder=FOLDER; manoe"),
        (["mapping=x"], "there is no setting mapping; how they are read is data.mapping=NAME or FILE.yaml; manoeuvre"),
        (["data.folder=x"], "there is no setting data.folder; it is there once data=recording is written; manoeuvre"),
        (["nosuch=3"], "there is no setting nosuch; manoeuvre train --cfg job lists them all"),
        (["zz35"], "Error parsing override 'zz35'"),
        (
            ["out=d/ü"],
            "Error parsing override 'out=d/ü': a name with other than plain letters is quoted twice: write "
            "'out=\"d/ü\"'",
        ),
        (["data.files=[a b,ü]"], "Error parsing override 'data.files=[a b,ü]': write each name in it within double"),
        (["seed=1,2"], "seed=1,2: several values: write 'seed=[1,2]' for a list, 'seed=\"1,2\"' for one name, or -m"),
    ],
)
def test_hydras_complaints_become_one_line(words, told, composed):
    line = explain(raised(lambda: composed(*words)))
    assert line.startswith(told) and "\n" not in line and len(line) <= 400


def test_the_package_is_the_command_where_its_script_is_not_on_the_path(monkeypatch, capsys):
    for words in (["--version"], ["train", "--version"]):
        monkeypatch.setattr("sys.argv", ["manoeuvre_nn/__main__.py", *words])
        runpy.run_module("manoeuvre_nn", run_name="__main__")
        assert capsys.readouterr().out == f"{__version__}\n"
    monkeypatch.setattr("sys.argv", ["manoeuvre_nn/__main__.py", "export"])
    with pytest.raises(SystemExit):
        runpy.run_module("manoeuvre_nn", run_name="__main__")
    assert "run=OUT" in capsys.readouterr().err and guard.program() == "python -m manoeuvre_nn export"


def test_a_group_that_is_null_is_told(monkeypatch, capsys, composed):
    monkeypatch.setattr("sys.argv", ["train.py", "ship=null", "seed=null"])
    with pytest.raises(SystemExit) as caught, one_line():
        composed("ship=null")
    assert caught.value.code == WRONG_INPUT
    assert capsys.readouterr().err.startswith("error: ship=null seed=null: a group cannot be empty")
    assert explain(ValueError("mine")) is None


def test_a_setting_that_must_be_given_is_named_in_full():
    cfg = OmegaConf.create({"linear": {"inertia": {"mx": "???"}}})
    error = raised(lambda: OmegaConf.to_container(cfg.linear, throw_on_missing=True))
    assert isinstance(error, OmegaConfBaseException)
    assert explain(error) == "linear.inertia.mx must be given: write linear.inertia.mx=..."


def refuse(**_):
    raise InputError("write a smaller one")


def fail(**_):
    return 1 / 0


def mistaken(**_):
    return int("three")


def test_an_input_error_is_found_inside_hydras():
    error = raised(lambda: instantiate({"_target_": f"{__name__}.refuse"}))
    assert isinstance(error, InstantiationException)
    assert explain(error) == "write a smaller one"


def test_a_fault_of_the_program_is_no_wrong_input():
    assert explain(raised(lambda: instantiate({"_target_": f"{__name__}.fail"}))) is None
    assert explain(ZeroDivisionError("x")) is None
    assert explain(raised(lambda: instantiate({"_target_": f"{__name__}.mistaken"}))) is not None


def test_one_line_and_code_2_for_wrong_input(capsys):
    with pytest.raises(SystemExit) as end, one_line():
        refuse()
    assert end.value.code == 2
    assert capsys.readouterr().err == "error: write a smaller one\n"


def test_a_fault_inside_hydra_is_told_as_one_and_kept_whole(capsys):
    with pytest.raises(SystemExit) as end, one_line():
        instantiate({"_target_": f"{__name__}.fail"})
    told = capsys.readouterr().err
    path = Path(told.split()[-1])
    assert end.value.code == 1 and told.startswith("error: InstantiationException: ") and told.count("\n") == 1
    assert "ZeroDivisionError" in path.read_text()
    path.unlink()


def test_guarded_ends_with_1_if_jobs_failed_and_with_nothing_if_not_whatever_ran_before(monkeypatch):
    monkeypatch.setenv("HYDRA_FULL_ERROR", "0")
    monkeypatch.setattr(guard, "failed_jobs", [])
    with pytest.raises(SystemExit) as end:
        guarded(lambda: guard.failed_jobs.append("3"))
    assert end.value.code == 1
    guarded(lambda: None)


def test_guarded_reports_wrong_input(monkeypatch, capsys):
    monkeypatch.setenv("HYDRA_FULL_ERROR", "0")

    def main():
        raise ConfigCompositionException("Could not override 'a.b'.\nNo match\nSet HYDRA_FULL_ERROR=1")

    with pytest.raises(SystemExit) as end:
        guarded(main)
    assert end.value.code == 2
    assert capsys.readouterr().err == "error: there is no setting a.b; manoeuvre train --cfg job lists them all\n"


def test_a_folder_that_cannot_be_written_is_named_in_one_line(tmp_path, capsys):
    (tmp_path / "file").touch()
    with pytest.raises(SystemExit) as ended, one_line():
        (tmp_path / "file" / "run").mkdir(parents=True)
    assert ended.value.code == 2
    told = capsys.readouterr().err
    assert "cannot write" in told and "(out=)" in told and told.count("\n") == 1


def test_a_file_that_may_not_be_read_is_not_taken_for_one_that_cannot_be_written(tmp_path, monkeypatch, capsys):
    path = tmp_path / "columns.yaml"
    path.write_text("a: 1")
    monkeypatch.setattr("os.access", lambda *_: False)
    with pytest.raises(SystemExit) as caught, one_line():
        raise PermissionError(13, "Permission denied", str(path))
    assert caught.value.code == WRONG_INPUT
    assert capsys.readouterr().err == f"error: cannot read {path}: Permission denied; ask its owner, or copy it\n"


@pytest.mark.parametrize(
    ("called", "told"),
    [
        ("scripts/coefficients.py", "python scripts/coefficients.py"),
        ("diagnose.py", "python diagnose.py"),
        ("train.py", "python train.py"),
        ("bin/manoeuvre", "manoeuvre excite"),
        ("ipykernel_launcher.py", "manoeuvre excite"),
    ],
)
def test_advice_names_the_command_that_was_typed(monkeypatch, composed, called, told):
    monkeypatch.setattr("sys.argv", [f"/somewhere/{called}"])
    monkeypatch.setattr(guard, "command", "excite")
    assert f"{told} --cfg job" in explain(raised(lambda: composed("nosuch=3")))


@pytest.mark.parametrize("command", ["train", "simulate", "diagnose", "check", "coefficients", "excite"])
def test_help_is_of_the_command_that_was_typed(monkeypatch, command):
    monkeypatch.setattr("sys.argv", ["/somewhere/bin/manoeuvre"])
    monkeypatch.setattr(guard, "command", command)
    with initialize_config_dir(str(CONF), version_base="1.3"):
        told = str(compose(command, return_hydra_config=True).hydra.help.template)
    assert f"  manoeuvre {command} " in told and ".py" not in told


def test_an_option_of_an_extra_that_is_not_installed_says_how_to_get_it():
    missing = ConfigCompositionException(
        "In 'task/pitch': Could not find 'hydra/sweeper/optuna'\n\nAvailable options:\n\tbasic\n"
    )
    assert explain(missing) == "hydra/sweeper=optuna is not installed: pip install 'manoeuvre-nn[search]'"


@pytest.mark.parametrize(
    "name",
    ["plain/a-b_1.csv", "ü", "runs (1)", "[1]", "a,b", "it's", 'q"q', "x=y", "#h", "back\\s", "end\\", '\\"', " trail ",
     "1e5", "2020", "null", "True", "nan", "a:b", "100%", "a*b", "~", ""],
)  # fmt: skip
def test_whatever_a_name_holds_is_written_so_that_hydra_reads_it_again(name):
    parser = OverridesParser.create()
    assert parser.parse_override(f"data.folder={as_word(name)}").value() == name
    assert parser.parse_override(f"data.files=[{as_word(name)}]").value() == [name]
    assert as_word("plain/a-b_1.csv") == "plain/a-b_1.csv"


def test_the_users_folder_is_put_in_place_of_its_sign(monkeypatch):
    monkeypatch.setenv("HOME", "/home/ü")
    assert of_home("out=~/run", hydras=True) == 'out="/home/ü/run"' and of_home("out=~", hydras=False) == "out=/home/ü"
    assert [of_home(word, hydras=True) for word in ("out=a/~/b", "~effect", "-m")] == ["out=a/~/b", "~effect", "-m"]


@pytest.mark.parametrize("words", [["--help"], ["--version"], ["train", "--version"]])
def test_help_on_a_full_disk_is_refused_in_a_line(words, monkeypatch, capsys):
    full = StringIO()
    full.flush = lambda: os.write(os.open("/dev/full", os.O_WRONLY), b"x")
    monkeypatch.setattr("sys.argv", ["manoeuvre", *words])
    monkeypatch.setattr("sys.stdout", full)
    with pytest.raises(SystemExit) as end:
        main.main()
    assert end.value.code == 2 and capsys.readouterr().err.startswith("error: cannot write: No space left on device")


def test_how_loud_a_command_is_may_be_said_before_it(monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["manoeuvre", "-q", "nowhere"])
    with pytest.raises(SystemExit) as end:
        main.main()
    assert end.value.code == 2 and capsys.readouterr().err.startswith("error: there is no command nowhere; choose")


@pytest.mark.parametrize("command", ["simulate", "compare"])
def test_a_working_folder_that_was_removed_is_told(command, tmp_path, monkeypatch, capsys):
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    with pytest.raises(SystemExit) as end:
        main.run(command, [])
    told = capsys.readouterr().err
    assert (
        end.value.code == 2
        and told == "error: the folder in which you are is not there any more: go to another one (cd ..)\n"
    )
