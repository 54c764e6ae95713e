"""What a person can get wrong on the command line ends with one line and code 2, before anything is trained."""

import numpy as np
import pandas as pd
import pytest
from conftest import TINY
from tiers import mainly

from manoeuvre_nn.core.units import DEGREE, KNOT
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.simulate import simulate
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.ship.mariner import mariner

MAPPING = """time: {column: t, unit: s}
channels:
  u: {column: u, unit: m/s}
  v: {column: v, unit: m/s}
  r: {column: r, unit: rad/s}
  x: {column: x, unit: m}
  y: {column: y, unit: m}
  psi: {column: psi, unit: rad}
  delta: {column: delta, unit: rad}
rudder_positive_to: starboard
"""


def refused(ended, out, *told) -> None:
    assert ended.code == 2, ended
    (line,) = ended.err.splitlines()
    assert line.startswith("error: ") and len(line) < 640
    for part in told:
        assert part in line
    assert not (out / "checkpoints").exists() and not (out / "scores.json").exists()


COMMANDS = [
    ("ship=submarine", "choose one of: container"),
    ("effect=wind", "effect=wind is unknown; choose one of: bank, bow_thruster, current"),
    ("score=[zz20,zz21]", "manoeuvre in score 'zz21' is unknown; choose one of: circles"),
    ("manoeuvre=zz21", "manoeuvre=zz21 is unknown; choose one of: circles"),
    ("manoeuvre=zigzag manoeuvre.zigzag.rudder_deg=50", "the Mariner stops at 35 deg: write a smaller rudder_deg"),
    ("manoeuvre.speed_kn=-5", "manoeuvre.speed_kn=-5: expected an approach speed in knots, .05 to 200"),
    ("data.length=10", "too short for the Mariner: write at least 40.1 s"),
    (
        "network.hiden=3",
        "there is no setting network.hiden: the nearest is network.hidden; python train.py --cfg job lists",
    ),
    ("scoring.every=0", "scoring.every=0: expected a whole number, 1 or more"),
    ("--nosuch", "unrecognized arguments: --nosuch"),
    ("--cfg=banana", "invalid choice: 'banana'"),
    ("config_dir=loop", "config_dir=loop is not a folder"),
    ("zz35", "Error parsing override 'zz35'"),
    ("+a=" + 2000 * "[" + 2000 * "]", "2000 brackets are opened in it: no setting is nested so deep"),
    ("seed=${oc.decode:'{a:b}'}", "Error parsing override"),
    ("experiment=7", "experiment=7: a group has names: leave it out or choose an option"),
    ("seed=${nosuch:1}", "seed=${nosuch:1}: Unsupported interpolation type nosuch"),
    ("seed=${seed}", "seed=${seed}: Recursive interpolation detected"),
    ("data=recording data.mapping=none.yaml", "none.yaml does not exist"),
    ("data=recording data.mapping=/", "mapping=/: / is a folder: write the path of a yaml file"),
    ("effect=../ship/mariner", "effect=../ship/mariner: expected the name of an option of effect: bank"),
    ("effects={a:1}", "effects={'a': 1}: expected the path of a file or folder"),
    ("effects=2026", "effects=2026 does not exist"),
    ("plugins=[../evil]", "plugins=../evil: no name of a module"),
    ("data=recording data.files=[true]", "data.files=[True]: expected names of files, such as [A.csv,B.csv]"),
    ("data.noise.p_deg_s=1", "noise of p: recording zz35 has no such channel; it has: u, v, r"),
]
"""Neighbours are alike: every second one is enough by default."""


@pytest.mark.parametrize("words, told", mainly(13, COMMANDS[::2] + COMMANDS[1::2]))
def test_wrong_commands_are_refused(cli, tmp_path, words, told):
    out = tmp_path / "run"
    (tmp_path / "loop").symlink_to("loop")
    refused(cli(*common(words), f"out={out}"), out, told)


WRONG_SETTINGS = [
    ("manoeuvre=[zz35,zz21]", "manoeuvre=zz21 is unknown; manoeuvre train --help lists the choices"),
    ("manoeuvre.speed_kn=fast", "manoeuvre.speed_kn=fast: expected an approach speed in knots"),
    ("manoeuvre.speed_kn=100", "100"),
    ("data.length=long", "length=long: expected a number or null"),
    ("data.noise.u=-1", "data.noise.u=-1: expected a standard deviation, 0 or more"),
    ("data.noise.y=1e8", "data.noise.y=100000000.0: expected a standard deviation, 0 or more, to 1e+06"),
    ("data.noise.q=1", "there is no setting data.noise.q"),
    ("data.rate_hz=-1", "data.rate_hz=-1: expected a number from 1e-06 to 10000 or null"),
    ("data.rate_hz=1e4 data.length=1e6", "samples; expected 1 to 1e+08: mind its times, and rate_hz"),
    ("linear.Xu=-1e12", "linear.Xu=-1000000000000.0: expected a number from -10 to 10 or null"),
    ("data.rate_hz=1e9", "data.rate_hz=1000000000.0: expected a number from 1e-06 to 10000 or null"),
    ("fit.iterations_per_epoch=0", "fit.iterations_per_epoch=0: expected 1 to 1e+06"),
    ("trainer.resume=/", "trainer.resume=/: expected auto, never, or the path of a .ckpt file that exists"),
    ("data.length=1e8", "data.length=100000000.0: expected a time in seconds, more than 0 and up to 1e+06"),
    ("nosuch=3", "there is no setting nosuch; manoeuvre train --cfg job lists them all"),
    ("+network.foo=1", "network.foo: there is no such setting; those of wang_network are: hidden, activation"),
    ("+trainer.foo=1", "trainer.foo: there is no such setting; those of Session are: max_epochs, patience"),
    ("+fit.foo=1", "fit.foo: there is no such setting; those of LevenbergMarquardtFit are: damping, stops"),
    ("network.hidden=0", "network.hidden=0"),
    ("network.scaling=log", "network.scaling 'log' is unknown; choose one of: source"),
    ("network.dtype=float16", "network.dtype 'float16' is unknown; choose one of: float64, float32"),
    ("trainer.max_epochs=many", "max_epochs=many: expected a whole number"),
    ("trainer.max_epochs=0", "trainer.max_epochs=0: expected a whole number, 1 or more"),
    ("trainer.threads=0", "trainer.threads=0: expected a whole number, 1 to 256"),
    ("trainer.threads=1000000", "trainer.threads=1000000: expected a whole number, 1 to 256"),
    ("network.hidden=1000000000", "network.hidden=1e+09: expected 100000 at most"),
    ("data.delays=7", "delays=7: expected a list such as delays=[a,b]"),
    ("network.spread=nan", "network.spread=nan: expected 0, or a number of a size from 1e-30 to 1e+15"),
    ("network.spread=true", "spread=True: expected a number"),
    ("trainer.resume=7", "resume=7: expected a word"),
    (
        "trainer.resume=nowhere.ckpt",
        "trainer.resume=nowhere.ckpt: expected auto, never, or the path of a .ckpt file that exists",
    ),
    ("scoring.solver=euler", "scoring.solver=euler: expected torchdiffeq or rollout"),
    ("fit.iterations_per_epoch=small", "iterations_per_epoch=small: expected a whole number"),
    ("seed=-1", "seed=-1: expected a whole number, 0 or more"),
    ("score=[]", "score=[] names no manoeuvre to score"),
    ("linear=given", "linear.inertia.mx must be given: write linear.inertia.mx=..."),
    ("experiment=nope", "experiment=nope is unknown; choose one of: cepowski2007, rajesh2009, structure, wang1996"),
    ("ship=kvlcc2", "write data=recording"),
    ("ship._target_=os.system", "os.system is refused; a config may only name things in manoeuvre_nn"),
    ("effect=[current,wind]", "effect=wind is unknown; manoeuvre train --help lists the choices"),
    (
        "effect=current effect.current.sped=1",
        "there is no setting effect.current.sped: the nearest is effect.current.speed; manoeuvre train",
    ),
    ("effect=current +effect.current.sped=1", "effect.current.sped: unknown parameter; current has speed, toward"),
    ("effect=current effect.current.speed=90", "effect.current.speed=90: expected 0 to 10 m/s"),
    ("effect=current effect.current.speed=fast", "speed=fast: expected a number"),
    ("effect=bank effect.bank.side=left", "effect.bank.side=left: expected starboard or port"),
    ("effect.current.speed=1", "there is no setting effect.current.speed"),
    ("effect=current data=recording", "effect=[current] acts on simulated ships, data=recording are measured"),
    ("data=recording", "names no recording: write data.files=[FILE,...], relative to data.folder"),
    ("data=recording manoeuvre.zz35.heading_deg=[1,[2]]", "heading_deg=[1, [2]]: expected a number"),
    ("data=recording data.mapping=kvlcc2_hsva data.files=[/no/x]", "data.files: /no/x is not in .; it holds"),
    ("data=recording data.mapping=kvlcc2_hsva data.files=['']", "data.files=['']: expected names of files"),
    ("data=recording data.mapping=kvlcc2_hsva", "data.files=[] names no recording"),
]
"""Neighbours are alike: every second one is enough by default."""


@pytest.mark.parametrize("words, told", mainly(26, WRONG_SETTINGS[::2] + WRONG_SETTINGS[1::2]))
def test_wrong_settings_are_refused(attempt, tmp_path, words, told):
    out = tmp_path / "run"
    refused(attempt(out, *common(words)), out, told)


def common(words: str) -> list[str]:
    """A tiny run's settings and those that are tried."""
    return [w for w in TINY if not (w.startswith("score=") and "data=recording" in words)] + words.split()


@pytest.fixture(scope="module")
def good() -> pd.DataFrame:
    run = simulate(CalmWater(mariner()), zigzag(20.0, duration=140.0))
    return pd.DataFrame({"t": run.time, **{k: run[k] for k in ("u", "v", "r", "x", "y", "psi", "delta")}})


def record(attempt, tmp_path, table, *more):
    """Train on a table, judged by another."""
    folder, out = tmp_path / "files", tmp_path / "run"
    folder.mkdir()
    (tmp_path / "map.yaml").write_text(MAPPING)
    bad, judge = table
    bad.to_csv(folder / "run.csv", index=False)
    judge.to_csv(folder / "judge.csv", index=False)
    words = ["data=recording", f"data.folder={folder}", "data.files=run.csv", f"data.mapping={tmp_path}/map.yaml"]
    short = [word for word in TINY if not word.startswith("score=")]
    return attempt(out, *short, *words, *more), out


@pytest.mark.slow
def test_a_file_in_order_is_trained_on(attempt, fast, tmp_path, good):
    ended, out = record(attempt, tmp_path, (good, good))
    assert ended.code == 0, ended.err
    assert '"judge"' in (out / "scores.json").read_text()


def without_sway(t):
    return t.drop(columns="v")


def with_a_hole(t):
    t.loc[50, "u"] = np.nan
    return t


def going_back(t):
    t.loc[50, "t"] = t.loc[48, "t"]
    return t


def in_degrees(t):
    return t.assign(psi=t.psi / DEGREE, delta=t.delta / DEGREE, r=t.r / DEGREE)


def in_knots(t):
    return t.assign(u=t.u / KNOT, v=t.v / KNOT)


def other_rudder(t):
    return t.assign(delta=-t.delta)


def words_for_numbers(t):
    return t.assign(u=t.u.astype(object).where(t.index != 50, "fast"))


@pytest.mark.parametrize(
    "spoil, told",
    [
        (without_sway, ["'v'", "t, u, r, x, y, psi, delta"]),
        (with_a_hole, ["'u'", "empty", "fill_gaps"]),
        (going_back, ["'t'", "times must increase"]),
        (in_degrees, ["looks like degrees: write unit: deg"]),
        (in_knots, ["look like knots: write unit: kn"]),
        (other_rudder, ["rudder sign opposite to the turn", "change rudder_positive_to"]),
        (words_for_numbers, ["'u'", "fast"]),
        (lambda t: t.head(15), ["too short a record"]),
        (lambda t: t.head(0), ["run.csv"]),
    ],
)
def test_bad_recordings_are_refused(attempt, tmp_path, good, spoil, told):
    ended, out = record(attempt, tmp_path, (spoil(good.copy()), good))
    refused(ended, out, "run", *told)


def test_a_bad_recording_to_judge_by_is_refused_before_training(attempt, tmp_path, good):
    ended, out = record(attempt, tmp_path, (good, other_rudder(good)))
    refused(ended, out, "recording judge", "rudder sign")


def test_a_file_in_both_lists_is_refused(attempt, tmp_path, good):
    ended, out = record(attempt, tmp_path, (good, good), "score=[run.csv]")
    refused(ended, out, "run.csv is both in data.files and in score")


def test_a_mapping_that_runs_code_is_refused(attempt, tmp_path, good):
    (tmp_path / "evil.yaml").write_text(f"_target_: os.mkdir\npath: {tmp_path}/was_here\n")
    ended, out = record(attempt, tmp_path, (good, good), f"data.mapping={tmp_path}/evil.yaml")
    refused(ended, out, "is no mapping of a record over time")
    assert not (tmp_path / "was_here").exists()


def test_a_foreign_checkpoint_in_the_folder_is_refused(cli, tmp_path):
    (tmp_path / "run" / "checkpoints").mkdir(parents=True)
    (tmp_path / "run" / "checkpoints" / "last.ckpt").write_text("hello\n")
    ended = cli(*TINY, f"out={tmp_path}/run")
    assert ended.code == 2 and len(ended.err.splitlines()) == 1 and "last.ckpt" in ended.err
