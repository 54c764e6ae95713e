"""A folder of runs in, runs ready for diagnosis out."""

import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from sailed import manifest, sailed, write_runs

from manoeuvre_nn.api import as_sensed
from manoeuvre_nn.core.channels import MEASURED
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.units import DEGREE, KNOT
from manoeuvre_nn.diagnosis.case import Case, RunSettings, case_of, choose_held_out, read_case, read_runs
from manoeuvre_nn.diagnosis.manifest import adapted, read_manifest
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.simulate import simulate
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.recording.preparation import estimated_order, measured
from manoeuvre_nn.recording.read.mapping import mapping
from manoeuvre_nn.ship.esso_190k import esso_190k
from manoeuvre_nn.ship.mariner import mariner_corrected

SHIP = mariner_corrected()
NAMES = ("zz1", "tc1", "zz2", "tc2")


def runs_of(folder: Path, *, change=lambda t: t, names=NAMES, **settings) -> Case:
    tables = dict(zip(names, sailed(0.4), strict=False))
    write_runs(folder, {name: change(t.copy()) for name, t in tables.items()})
    return read_runs(folder, SHIP, RunSettings(**{"rudder_positive_to": "port", **settings}))


def channel(case: Case, name: str, run: int = 0) -> np.ndarray:
    return measured(case.runs[run])[:, MEASURED.index(name)]


@pytest.fixture(scope="module")
def usual(tmp_path_factory) -> Case:
    return runs_of(tmp_path_factory.mktemp("usual"))


def test_columns_arrive_in_si_and_the_rudder_positive_to_starboard(usual):
    table, run = sailed(0.4)[0], next(r for r in usual.runs if r.name == "zz1")
    k = usual.runs.index(run)
    np.testing.assert_allclose(run.time, table["t"])
    np.testing.assert_allclose(channel(usual, "x", k), table["x_north"], atol=1e-4)
    np.testing.assert_allclose(channel(usual, "u_log", k), table["u_log"], atol=1e-4)
    np.testing.assert_allclose(channel(usual, "r", k), table["r"] * DEGREE, atol=1e-6)
    np.testing.assert_allclose(channel(usual, "shaft_recorded", k), 1.0)
    np.testing.assert_allclose(np.sin(channel(usual, "psi", k)), np.sin(table["psi"] * DEGREE), atol=1e-5)
    east = table["sog"] * np.sin(table["cog"] * DEGREE)
    np.testing.assert_allclose(channel(usual, "ve", k), east, atol=1e-4)
    assert run["delta"][30] > 0.3 and measured(run)[30, MEASURED.index("r")] > 0
    np.testing.assert_allclose(run["delta_order"][1:], -table["delta_order"][1:] * DEGREE, atol=1e-5)


def test_headings_are_continuous(usual):
    turn = channel(usual, "psi", [r.name for r in usual.runs].index("tc1"))
    assert np.ptp(turn) > np.pi and np.abs(np.diff(turn)).max() < 0.1


@pytest.mark.parametrize("said", ["starboard", None])
def test_a_rudder_positive_to_starboard_is_the_same_run_and_what_is_taken_for_granted(tmp_path, usual, said):
    def other(t):
        return t.assign(delta=-t.delta, delta_order=-t.delta_order)

    turned = runs_of(tmp_path, change=other, rudder_positive_to=said)
    for a, b in zip(turned.runs, usual.runs, strict=True):
        np.testing.assert_allclose(a["delta"], b["delta"], atol=1e-12)


def test_velocities_along_and_across_the_heading_are_those_over_ground(tmp_path, usual):
    case = runs_of(tmp_path, change=lambda t: t.drop(columns=["sog", "cog"]))
    for name in ("vn", "ve"):
        np.testing.assert_allclose(channel(case, name), channel(usual, name), atol=2e-4)


def test_velocities_that_were_not_recorded_are_taken_from_the_track(tmp_path, usual):
    case = runs_of(tmp_path, change=lambda t: t.drop(columns=["sog", "cog", "u", "v"]))
    inside = slice(20, -20)
    for name in ("vn", "ve"):
        assert np.abs(channel(case, name) - channel(usual, name))[inside].max() < 0.6
    assert any("taken from the track" in sentence for sentence in case.undecided)


@pytest.mark.parametrize(
    "columns, empty, told",
    [
        (["x_north", "y_east"], ["x", "y"], "No position: a lever arm of the antenna cannot be told"),
        (["u_log"], ["u_log"], "No speed log: a current is told by turns alone"),
        (["r"], ["r"], "No yaw rate: the rate gyro cannot be fitted."),
        (["n"], ["shaft_recorded"], "No shaft speed: it counts as nominal"),
        (["delta_order"], [], "No helm order: it was taken from the rudder angle"),
    ],
)
def test_what_was_not_recorded_is_empty_and_said(tmp_path, usual, columns, empty, told):
    case = runs_of(tmp_path, change=lambda t: t.drop(columns=columns))
    for name in MEASURED:
        assert np.isnan(channel(case, name)).all() == (name in empty), name
    assert [s for s in case.undecided if s not in usual.undecided][0].startswith(told)


def test_a_channel_without_numbers_counts_as_not_recorded(tmp_path):
    case = runs_of(tmp_path, change=lambda t: t.assign(u_log=np.nan, y_east=""))
    assert np.isnan(channel(case, "u_log")).all() and np.isnan(channel(case, "x")).all()


def test_gaps_stay_empty_and_the_rudder_is_carried_over_them(tmp_path, usual):
    def holed(t):
        t.loc[100:104, ["x_north", "psi", "delta", "delta_order"]] = np.nan
        return t

    case = runs_of(tmp_path, change=holed)
    assert np.flatnonzero(np.isnan(channel(case, "x"))).tolist() == [100, 101, 102, 103, 104]
    assert np.isfinite(case.runs[0]["delta"]).all() and np.isfinite(channel(case, "y")).all()


def test_runs_at_ten_samples_a_second_are_joined_to_one(tmp_path, usual):
    rng = np.random.default_rng(0)

    def fast(t):
        even = np.arange(0.0, 240.01, 0.1)
        made = pd.DataFrame({k: np.interp(even, t["t"], np.unwrap(t[k], period=360.0)) for k in t})
        made["u_log"] = 7.0 + 0.3 * rng.standard_normal(len(even))
        return made.assign(t=even, delta_order=t["delta_order"].to_numpy()[(even + 1e-9).astype(int)])

    case = runs_of(tmp_path, change=fast)
    np.testing.assert_allclose(case.runs[0].time, usual.runs[0].time)
    assert channel(case, "u_log").std() < 0.3 / np.sqrt(10) * 1.5
    np.testing.assert_allclose(case.runs[0]["delta_order"][1:], usual.runs[0]["delta_order"][1:], atol=1e-5)
    assert np.abs(channel(case, "x") - channel(usual, "x")).max() < 1.0


def test_runs_with_rare_samples_keep_them_and_stay_empty_between(tmp_path, usual):
    case = runs_of(tmp_path, change=lambda t: t[::2])
    assert case.runs[0].step == 1.0
    np.testing.assert_allclose(channel(case, "x")[::2], channel(usual, "x")[::2], atol=1e-9)
    assert np.isnan(channel(case, "x")[1::2]).all() and np.isfinite(case.runs[0]["delta"]).all()


def test_uneven_times_are_read_off_at_even_ones(tmp_path, usual):
    shift = np.random.default_rng(1).uniform(-0.2, 0.2, 241)
    shift[0] = 0.0

    def shaken(t):
        at = t["t"] + shift
        return t.assign(t=at, x_north=np.interp(at, t["t"], t["x_north"]), u_log=10.0 + at)

    case = runs_of(tmp_path, change=shaken)
    np.testing.assert_allclose(np.diff(case.runs[0].time), 1.0)
    filled = np.isfinite(channel(case, "u_log"))
    assert filled.mean() > 0.95
    np.testing.assert_allclose(channel(case, "u_log")[filled], 10.0 + case.runs[0].time[filled], atol=1e-3)


def test_times_count_from_the_first_sample(tmp_path, usual):
    case = runs_of(tmp_path, change=lambda t: t.assign(t=t["t"] + 3600.0))
    np.testing.assert_allclose(case.runs[0].time, usual.runs[0].time)


def test_a_part_of_a_run_is_a_run_that_begins_with_it():
    """As a person cuts it in Python; the warm-up is that of the part."""
    whole = simulate(CalmWater(SHIP), zigzag(20.0, duration=240.0))
    part = as_sensed(whole).between(100.0, 240.0)
    moved = replace(part, time=part.time - 100.0)
    cut, usual = (case_of([replace(run, name=name) for name in "ab"], SHIP, ["b"]) for run in (part, moved))
    assert cut.runs[0].time[0] == 0.0 and len(cut.runs[0]) == len(usual.runs[0])
    for name, values in usual.runs[0].channels.items():
        np.testing.assert_allclose(cut.runs[0][name], values, atol=1e-9, equal_nan=True)


def test_a_slow_ship_needs_no_finer_steps_and_a_model_gets_them(tmp_path):
    table = sailed(0.4)[0]
    write_runs(tmp_path, {"a": table, "b": table})
    assert read_runs(tmp_path, SHIP, RunSettings(speed_kn=11.0, rudder_positive_to="port")).runs[0].step == 1.0
    assert read_runs(tmp_path, SHIP, RunSettings(speed_kn=18.0, rudder_positive_to="port")).runs[0].step == 0.5


def test_helm_orders_are_told_from_the_rudder():
    rate = 2.5 * DEGREE
    order = np.repeat([0.0, 0.35, -0.35, 0.1], 60)
    shown = np.zeros_like(order)
    for k in range(1, len(order)):
        shown[k] = shown[k - 1] + np.clip(order[k - 1] - shown[k - 1], -rate, rate)
    noisy = shown + 0.1 * DEGREE * np.random.default_rng(0).standard_normal(len(shown))
    found = estimated_order(noisy, 1.0, rate)
    at_steps = np.abs(np.arange(len(order))[:, None] - [60, 120, 180]).min(axis=1) <= 2
    assert np.abs(found - order)[~at_steps].max() < 0.1 * DEGREE


def test_a_rudder_that_was_ordered_over_as_the_recording_began_is_seen_to_move(usual):
    turn = next(run for run in usual.runs if run.name == "tc1")
    assert abs(turn["delta"][0]) < 1 * DEGREE and turn["delta"][20] > 24 * DEGREE


def test_a_name_that_is_no_text_is_refused_before_anything_is_read(tmp_path):
    (tmp_path / os.fsdecode(b"z\xff.csv")).write_text("")
    with pytest.raises(InputError, match=r"recording: name 'z\\udcff' is no plain name; write one of up to"):
        read_runs(tmp_path, esso_190k())


def test_another_file_format_is_the_same_run(tmp_path, usual):
    def renamed(t):
        made = pd.DataFrame({"zeit": t["t"] / 60.0, "x": t["x_north"], "y": t["y_east"], "vor": t["u"] / KNOT})
        return made.assign(quer=t["v"] / KNOT, kurs=t["psi"] * DEGREE, dreh=t["r"] * 60.0, ruder=-t["delta"])

    named = {"x": ("x", "m"), "y": ("y", "m"), "u": ("vor", "kn"), "v": ("quer", "kn"), "psi": ("kurs", "rad")}
    named |= {"r": ("dreh", "deg/min"), "delta": ("ruder", "deg")}
    channels = {k: {"column": column, "unit": unit} for k, (column, unit) in named.items()}
    case = runs_of(
        tmp_path,
        change=renamed,
        mapping=mapping(time={"column": "zeit", "unit": "min"}, channels=channels),
        rudder_positive_to=None,
    )
    assert [run.name for run in case.runs] == [run.name for run in usual.runs]
    for name in ("x", "y", "vn", "ve", "psi", "r"):
        np.testing.assert_allclose(channel(case, name), channel(usual, name), atol=1e-2, err_msg=name)
    assert np.isnan(channel(case, "u_log")).all()


def test_a_track_that_a_mapping_makes_from_velocities_is_no_recorded_one(tmp_path, usual):
    named = {"u": ("u", "m/s"), "v": ("v", "m/s"), "psi": ("psi", "deg"), "delta": ("delta", "deg")}
    channels = {k: {"column": column, "unit": unit} for k, (column, unit) in named.items()}
    read = mapping(time={"column": "t", "unit": "s"}, channels=channels, rudder_positive_to="port")
    case = runs_of(tmp_path / "long", mapping=read, rudder_positive_to=None)
    assert np.isnan(channel(case, "x")).all() and np.isnan(channel(case, "r")).all()
    np.testing.assert_allclose(channel(case, "vn"), channel(usual, "vn"), atol=1e-3)
    with pytest.raises(InputError, match="too short a record: 71 samples over 70 s"):
        runs_of(tmp_path / "short", change=lambda t: t[t["t"] <= 70], mapping=read, rudder_positive_to=None)


@pytest.mark.parametrize(
    "kinds, expected",
    [
        ({"a": "zigzag"}, []),
        ({"a": "zigzag", "b": "turning_circle"}, ["a"]),
        ({"a": "zigzag", "b": "zigzag", "c": "turning_circle"}, ["b"]),
        ({"a": "zigzag", "b": "zigzag", "c": "turning_circle", "d": "pull_out"}, ["b", "d"]),
        ({"a": "turning_circle", "b": "turning_circle"}, ["b"]),
        ({k: "spiral" for k in "abc"}, ["c"]),
    ],
)
def test_about_a_third_is_held_out_and_never_all(kinds, expected):
    assert sorted(choose_held_out(kinds)) == expected


def test_a_person_says_what_is_held_out(tmp_path):
    case = runs_of(tmp_path, held_out=["tc1"])
    assert [run.name for run in case.held_out] == ["tc1"] and len(case.fitted) == 3
    assert case.warmup == pytest.approx(2 * 152.4 / 7.614)
    none = read_runs(tmp_path, SHIP, RunSettings([], warmup_s=55.0, rudder_positive_to="port"))
    assert none.held_out == [] and none.warmup == 55.0
    assert "No held-out run: nothing is proved, and an effect is only proposed." in none.undecided


def test_one_run_and_a_still_rudder_are_said(tmp_path):
    n = 241
    rng = np.random.default_rng(0)
    still = pd.DataFrame({"t": np.arange(n), "psi": 0.1 * rng.standard_normal(n), "sog": 7.6, "cog": 0.0})
    write_runs(tmp_path, {"still": still.assign(delta=0.1 * rng.standard_normal(n))})
    said = read_runs(tmp_path, SHIP).undecided
    assert said[0] == "The rudder never moved: nothing about rudder, hull and loading can be decided."
    assert "One run: agreement between runs cannot be tested." in said


def a_case(folder: Path, more=None, **settings) -> Path:
    write_runs(folder, dict(zip(NAMES[:2], sailed(0.4), strict=False)))
    (folder / "manifest.json").write_text(json.dumps(manifest(*NAMES[:2], held_out="tc1", **settings) | (more or {})))
    return folder


def test_a_case_is_read_as_its_manifest_says(tmp_path):
    case = read_case(a_case(tmp_path / "folder", {"warmup_s": 30}))
    assert (case.name, case.ship) == ("c1", "mariner")
    assert ([r.name for r in case.runs], case.proof, case.warmup) == (["zz1", "tc1"], {"tc1"}, 30.0)


def test_a_persons_manifest_gives_particulars_and_split(tmp_path):
    to_port = RunSettings(rudder_positive_to="port")
    case = read_runs(a_case(tmp_path), settings=to_port)
    assert case.hull.particulars.name == "Mariner" and [r.name for r in case.held_out] == ["tc1"]
    assert [r.name for r in read_runs(tmp_path, settings=replace(to_port, held_out=["zz1"])).held_out] == ["zz1"]


def test_a_ship_takes_what_the_manifest_says_and_keeps_the_rest():
    said = manifest("a", wind_areas={"lateral_m2": 2000.0}, stability={"GM_m": 1.1})
    said["particulars"] |= {"approach_speed_m_s": 6.0, "nominal_rpm": 60.0, "calm_water_resistance_kN": 200.0}
    ship = adapted(SHIP, said)
    p = ship.particulars
    assert (p.speed, p.rpm, p.resistance) == (6.0, 60.0, 200e3)
    assert (p.above_water.lateral, p.above_water.frontal) == (2000.0, SHIP.particulars.above_water.frontal)
    assert (p.heeling.gm, p.heeling.kg) == (1.1, 8.4)
    assert SHIP.particulars.speed == 7.614 and SHIP.particulars.above_water.lateral == 1650.0
    with pytest.raises(InputError, match=r"length_m is 152.4; that of the Esso 190 000 dwt tanker is 304.8: another"):
        adapted(esso_190k(), said)


@pytest.mark.parametrize(
    "more, told",
    [
        ({"ship": "titanic"}, "'titanic' is unknown; choose one of: mariner, great_lakes_bulker, esso_tanker"),
        ({"runs": []}, "runs is no list of runs"),
        ({"runs": "all"}, "runs is no list of runs"),
        ({"runs": [{"run": "zz1", "file": "zz1.csv"}]}, "a run has split None; expected run, file and split"),
        ({"runs": [{"run": "zz1", "file": "zz1.csv", "split": "fitted"}]}, "choose one of: fit, held_out"),
        ({"runs": [{"run": "zz1", "file": "../zz1.csv", "split": "fit"}]}, "file '../zz1.csv' is no plain name"),
        ({"runs": [{"run": "../z", "file": "zz1.csv", "split": "fit"}]}, "run '../z' is no plain name"),
        ({"runs": [{"run": "zz9", "file": "zz9.csv", "split": "fit"}]}, "zz9.csv, which is not in the folder"),
        ({"runs": 2 * [{"run": "zz1", "file": "zz1.csv", "split": "fit"}]}, "runs stand twice: zz1, zz1"),
        ({"runs": [{"run": "zz1", "file": "zz1.csv", "split": "held_out"}]}, "held out are all runs (zz1)"),
        (
            {"runs": [{"run": "z", "file": "zz1.csv", "split": "fit", "rows": 900}]},
            "has 241 rows, the manifest says 900",
        ),
        ({"particulars": {"nominal_rpm": "fast"}}, "nominal_rpm is 'fast'; expected a number more than 0"),
        ({"particulars": {"nominal_rpm": -76}}, "nominal_rpm is -76; expected a number more than 0"),
        ({"particulars": [1, 2]}, "particulars is [1, 2]; expected an object of numbers"),
        ({"particulars": {"length": 160}}, "expected an object of numbers such as length_m"),
        ({"warmup_s": 1e30}, "warmup_s is 1e+30; expected a number more than 0"),
        ({"warmup_s": 1e9}, "warmup_s is 1000000000.0; expected a number more than 0"),
        ({"wind_areas": {"lateral_centroid_fwd_of_midship_m": True}}, "is True; expected a number"),
        ({"warmup_s": None}, "warmup_s is None; expected a number more than 0"),
        ({"warmup_s": 200}, "too short to be held out with a warm-up of 200 s"),
        ({"particulars": {"beam_m": 47.2}}, "beam_m is 47.2; that of the Mariner is 21.763: another ship?"),
    ],
)
def test_a_manifest_that_cannot_be_used_is_refused_in_a_line(tmp_path, more, told):
    with pytest.raises(InputError) as refusal:
        read_case(a_case(tmp_path, more))
    assert told in str(refusal.value) and "\n" not in str(refusal.value) and len(str(refusal.value)) < 400


@pytest.mark.parametrize("content", [b"", b"{", b"[1, 2]", b"\xff\xfe", b'"words"', b'{"case": "c1"}'])
def test_a_damaged_or_foreign_manifest_is_refused_by_name(tmp_path, content):
    (tmp_path / "manifest.json").write_bytes(content)
    with pytest.raises(InputError, match=r"manifest\.json") as refusal:
        read_case(tmp_path)
    assert "\n" not in str(refusal.value)
    with pytest.raises(InputError, match="does not exist"):
        read_manifest(tmp_path / "nowhere")


def test_the_campaign_of_a_run_stands_in_the_manifest(tmp_path):
    folder = a_case(tmp_path)
    path = folder / "manifest.json"
    said = json.loads(path.read_text())
    said["runs"][0]["campaign"] = "friday"
    path.write_text(json.dumps(said))
    first, *others = read_case(folder).runs
    assert first.meta["campaign"] == "friday" and all("campaign" not in run.meta for run in others)
    said["runs"][0]["campaign"] = 3
    path.write_text(json.dumps(said))
    with pytest.raises(InputError, match="campaign of run .* is 3; expected a name"):
        read_case(folder)
