"""Real files: set RECORDINGS to the folder that holds them."""

import os
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import yaml
from fleet import unchecked
from tiers import mainly

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.estimation.accelerations import accelerations
from manoeuvre_nn.recording.check.checks import check_recording
from manoeuvre_nn.recording.check.inspection import inspect_recording
from manoeuvre_nn.recording.propose.proposal import propose
from manoeuvre_nn.recording.read.captive import captive_mapping, read_captive
from manoeuvre_nn.recording.read.mapping import mapping
from manoeuvre_nn.recording.read.reader import read_recording, read_recordings
from manoeuvre_nn.ship.esso_osaka_model import esso_osaka_model
from manoeuvre_nn.ship.kvlcc2 import kvlcc2, kvlcc2_hsva

pytestmark = pytest.mark.recordings
CONF = Path(__file__).parents[2] / "conf" / "recording"
SETS = {
    "kvlcc2-hsva-cpmc": ("kvlcc2_hsva", kvlcc2_hsva, 13, "zigzag"),
    "kvlcc2-marin-free": ("kvlcc2_marin", kvlcc2, 4, "zigzag"),
    "esso-osaka-frt/zigzag": ("esso_osaka", esso_osaka_model, 7, "zigzag"),
    "esso-osaka-frt/turning": ("esso_osaka", esso_osaka_model, 10, "turning_circle"),
    "esso-osaka-frt/random": ("esso_osaka", esso_osaka_model, 8, "random_rudder"),
}


def folder(name):
    root = os.environ.get("RECORDINGS")
    if not root:
        pytest.skip("RECORDINGS is not set: write RECORDINGS=FOLDER with the measured files")
    if not (Path(root) / name).is_dir():
        pytest.skip(f"{root} has no folder {name}")
    return Path(root) / name


def read(name, **changes):
    conf, ship, _, _ = SETS[name]
    settings = yaml.safe_load((CONF / f"{conf}.yaml").read_text())
    return read_recordings(folder(name), mapping(**{**settings, **changes}), ship()), ship()


@cache
def plain(name):
    return read(name)


@pytest.fixture(params=SETS)
def dataset(request):
    return request.param


def test_every_file_is_read_and_passes_all_checks(dataset):
    records, ship = plain(dataset)
    assert len(records) == SETS[dataset][2]
    for record in records:
        check_recording(record, ship)


def test_positions_heading_and_rudder_alone_pass_all_checks(dataset):
    columns = yaml.safe_load((CONF / f"{SETS[dataset][0]}.yaml").read_text())["channels"]
    records, ship = read(dataset, channels={name: columns[name] for name in ("x", "y", "psi", "delta")})
    for record in records:
        check_recording(record, ship)


def test_the_kind_of_manoeuvre_is_guessed_from_the_rudder(dataset):
    records, _ = read(dataset, kind=None)
    assert {r.meta["kind"] for r in records} == {SETS[dataset][3]}


def test_a_rudder_read_the_wrong_way_round_is_found_in_every_file(dataset):
    records, ship = plain(dataset)
    for record in records:
        with pytest.raises(InputError, match="rudder sign opposite to the turn"):
            check_recording(record.with_channels(delta=-record["delta"]), ship)


def test_headings_in_degrees_taken_for_radians_are_found_in_every_file(dataset):
    records, ship = plain(dataset)
    for record in records:
        with pytest.raises(InputError, match="psi looks like degrees"):
            check_recording(record.with_channels(psi=np.degrees(record["psi"])), ship)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (lambda r: {"u": r["v"], "v": r["u"]}, "u and v look swapped"),
        (lambda r: {"v": -r["v"]}, "write sign: -1 for v"),
        (lambda r: {"u": r["u"] / 0.514444, "v": r["v"] / 0.514444}, "look like knots"),
        (lambda r: {"r": -r["r"]}, "write sign: -1 for r"),
    ],
    ids=["swapped", "sway", "knots", "rate"],
)
def test_a_spoilt_file_is_found_in_every_zigzag(changes, message):
    for name in ("kvlcc2-hsva-cpmc", "kvlcc2-marin-free", "esso-osaka-frt/zigzag"):
        records, ship = plain(name)
        for record in records:
            with pytest.raises(InputError, match=message):
                check_recording(record.with_channels(**changes(record)), ship)


def test_the_model_basins_earth_fixed_velocities_give_the_same_body_velocities():
    earth = {"u": {"column": "vx_file_mps", "unit": "m/s"}, "v": {"column": "vy_file_mps", "unit": "m/s"}}
    records, _ = plain("kvlcc2-hsva-cpmc")
    channels = yaml.safe_load((CONF / "kvlcc2_hsva.yaml").read_text())["channels"]
    turned, _ = read("kvlcc2-hsva-cpmc", channels=channels | earth, frame="earth")
    for one, other in zip(records, turned, strict=True):
        np.testing.assert_allclose(one["u"], other["u"], atol=1e-3)
        np.testing.assert_allclose(one["v"], other["v"], atol=1e-3)


def test_smoothed_accelerations_integrate_back_to_the_recorded_velocities():
    records, _ = plain("kvlcc2-hsva-cpmc")
    for record in records:
        found = accelerations(record)
        steps = np.diff(record.time)
        for name in ("u", "v", "r"):
            rate = found[f"{name}dot"]
            back = found[name][0] + np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * steps)])
            assert np.std(back - record[name]) < 0.1 * np.std(record[name])


@pytest.mark.parametrize("dataset", mainly(1, SETS))
def test_the_proposed_mapping_reads_what_the_ready_one_reads(dataset):
    records, ship = plain(dataset)
    for record, known in ((records[0], None), (records[-1], ship)):
        path = Path(record.meta["source"])
        made = propose(path, known)
        proposed = read_recording(path, made.mapping, ship)
        assert set(proposed.channels) >= set(record.channels)
        for name, samples in record.channels.items():
            np.testing.assert_allclose(proposed[name], samples, atol=1e-9, err_msg=f"{path.name} {name}")
        assert all(c.decided for c in (made.time, *made.choices)) and made.finding is None


def test_wind_is_read_where_it_was_measured_and_does_not_jump():
    (record, *_), _ = plain("esso-osaka-frt/zigzag")
    assert 1.0 < record["wind_speed"].mean() < 2.0
    for name in ("wind_from", "wind_from_relative"):
        assert np.abs(np.diff(record[name])).max() < np.pi
    # relative wind and motion add up to the true wind
    blown = record["wind_speed"] * np.exp(1j * record["wind_from"])
    felt = record["wind_speed_relative"] * np.exp(1j * (record["wind_from_relative"] + record["psi"]))
    moved = (record["u"] + 1j * record["v"]) * np.exp(1j * record["psi"])
    assert np.median(np.abs(felt - moved - blown)) < 0.1 * np.median(np.abs(blown))


def test_counts_without_heading_are_read_as_a_record_and_proposed_as_one():
    path = folder("hakusan-seaway") / "hakusan_1Hz.csv"
    settings = yaml.safe_load((CONF / "hakusan.yaml").read_text())
    ready, ship = mapping(**settings), kvlcc2()
    record = read_recording(path, ready, ship)
    assert len(record) == 1000 and record.meta["kind"] == "record"
    assert record["delta"].mean() == pytest.approx(-420, abs=5)
    assert propose(path).mapping.channels == ready.channels
    with pytest.raises(InputError, match="kind: record"):
        check_recording(record, ship)


def test_captive_tests_are_read_in_the_ships_signs():
    path = folder("kvlcc2-hmri-captive") / "static_tests.csv"
    settings = yaml.safe_load((CONF / "kvlcc2_hmri.yaml").read_text())
    tests = read_captive(path, captive_mapping(**settings))
    assert len(tests) == 63
    steered = (np.abs(tests.beta) < 1e-9) & (tests.speed > 1.1)
    assert np.polyfit(tests.delta[steered], tests.N[steered], 1)[0] > 0
    assert np.polyfit(tests.v, tests.Y, 1)[0] < 0 and np.polyfit(tests.v, tests.N, 1)[0] < 0


def sensors(name, fault):
    """A fault as measured in each record."""
    records, ship = plain(name)
    with unchecked():
        found = [inspect_recording(r, ship).findings for r in records]
    return [f for findings in found for f in findings if f.check == fault]


@pytest.mark.slow
def test_the_positions_of_the_pond_are_ahead_of_its_velocities_in_every_zigzag():
    found = sensors("esso-osaka-frt/zigzag", "delay of x, y")
    assert [f.verdict for f in found] == ["mend"] * 7
    assert all(abs(f.measured + 0.91) < 0.05 + 3 * f.error for f in found)


@pytest.mark.slow
def test_the_rate_of_turn_of_the_full_scale_records_has_an_offset():
    found = sensors("kvlcc2-marin-free", "offset of r")
    records, _ = plain("kvlcc2-marin-free")
    for f, r in zip(found, records, strict=True):
        drift = np.degrees(np.trapezoid(r["r"], r.time) - (r["psi"][-1] - r["psi"][0])) / r.duration
        assert f.verdict == "mend" and f.measured == pytest.approx(drift, abs=6 * f.error)


@pytest.mark.slow
def test_the_records_of_the_towing_carriage_need_no_mending():
    records, ship = plain("kvlcc2-hsva-cpmc")
    with unchecked():
        assert {f.check for r in records for f in inspect_recording(r, ship).findings if f.trips} == set()
