"""Recordings with heel, and with starboard and port rudders and shafts: read, checked, and how they are proposed."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from fleet import unchecked
from pytest import approx
from tiers import only

from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.manoeuvre.turning import tactical_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.recording.check.heel import heel_findings, side_findings
from manoeuvre_nn.recording.check.inspection import inspect_recording
from manoeuvre_nn.recording.noise import add_noise
from manoeuvre_nn.recording.propose.headings import WORDS
from manoeuvre_nn.recording.read.mapping_file import SI_DEGREES, read_mapping
from manoeuvre_nn.recording.read.reader import read_recording
from manoeuvre_nn.ship.container import container
from manoeuvre_nn.ship.naval_vessel import naval_vessel

SHIPS = {"container": lambda: container(screws=2), "stiff": lambda: container(gm=1.0), "naval": naval_vessel}
TRIALS = {"zz20": zigzag(20.0, duration=200.0), "circle": tactical_circle(20.0, "port", turn_deg=200.0)}
NOISE = {"phi": 0.1 * DEGREE, "p": 0.05 * DEGREE, "r": 0.02 * DEGREE, "u": 0.04, "v": 0.04, "delta": 0.1 * DEGREE}


@cache
def recorded(ship: str, trial: str) -> Recording:
    with unchecked():
        return add_noise(roll_out(CalmWater(SHIPS[ship]()), [TRIALS[trial]])[0], NOISE, seed=4)


def scaled(run: Recording, **factors: float) -> Recording:
    return run.with_channels(**{name: factor * run[name] for name, factor in factors.items()})


def faults(run: Recording, ship: str = "container") -> dict[str, dict[str, object]]:
    found = heel_findings(run, SHIPS[ship]().particulars)
    return {f.check: {c.path: c.value if c.how == "set" else c.how for c in f.changes} for f in found if f.trips}


@pytest.mark.parametrize(
    "ship, trial",
    only({("container", "zz20")}, [(ship, trial) for ship in SHIPS for trial in TRIALS]),
)
def test_a_good_record_of_heel_raises_nothing_and_each_fault_is_found(ship, trial):
    run = recorded(ship, trial)
    assert faults(run, ship) == {}
    assert faults(scaled(run, phi=-1.0, p=-1.0), ship) == {"heel side": {"channels.phi": "turn", "channels.p": "turn"}}
    assert faults(scaled(run, p=-1.0), ship) == {"roll rate": {"channels.p": "turn"}}
    assert faults(scaled(run, p=DEGREE), ship) == {"roll rate": {"channels.p.unit": "rad/s"}}
    assert faults(scaled(run, p=1 / DEGREE), ship) == {"roll rate": {"channels.p.unit": "deg/s"}}


def test_degrees_taken_for_radians_are_found_by_the_size_of_the_heel():
    run = recorded("container", "zz20")
    assert faults(scaled(run, phi=1 / DEGREE)) == {"heel unit": {"channels.phi.unit": "deg"}}


def test_a_rate_of_something_else_is_none_of_the_heel():
    run = recorded("container", "zz20")
    noise = np.random.default_rng(1).standard_normal(len(run)) * run["p"].std()
    (rate, _) = heel_findings(run.with_channels(p=noise), container().particulars)
    assert rate.check == "roll rate" and rate.verdict == "note" and "not the rate" in rate.text


def test_an_upright_ship_says_nothing_of_its_heel():
    run = recorded("container", "zz20")
    still = run.with_channels(phi=0.0 * run["phi"])
    assert [f.verdict for f in heel_findings(still, container().particulars)] == ["ok"]
    bare = replace(run, channels={k: c for k, c in run.channels.items() if k not in ("phi", "p")})
    assert heel_findings(bare, container().particulars) == []


def test_means_of_both_sides_are_checked():
    run = recorded("container", "zz20")
    assert {f.verdict for f in side_findings(run)} == {"ok"} and len(side_findings(run)) == 2
    turned = scaled(run, delta_port=-1.0)
    assert [(f.verdict, f.channels[0]) for f in side_findings(turned)] == [("mend", "delta"), ("ok", "n")]
    slow = scaled(run, n_port=0.9)
    assert [f.verdict for f in side_findings(slow)] == ["ok", "mend"]


def test_the_inspection_tells_of_heel():
    run = scaled(recorded("container", "zz20"), p=-1.0)
    with unchecked():
        found = inspect_recording(run, container(screws=2).particulars)
    assert {"roll rate": "mend", "heel side": "ok"}.items() <= {f.check: f.verdict for f in found.findings}.items()


def test_rudder_and_shaft_are_the_means_of_both_sides_where_only_these_are_given(tmp_path):
    run, ship = recorded("container", "zz20"), container(screws=2).particulars
    sides = run.with_channels(delta_port=run["delta_port"] - 2 * DEGREE)
    columns = {
        "t": run.time, "x_north": run["x"], "y_east": run["y"], "psi": run["psi"] / DEGREE, "u": run["u"],
        "v": run["v"],
        "delta_starboard": sides["delta_starboard"] / DEGREE, "delta_port": sides["delta_port"] / DEGREE,
        "n_starboard": run["n_starboard"] * 60, "n_port": run["n_port"] * 60, "phi": run["phi"] / DEGREE,
        "p": run["p"] / DEGREE,
    }  # fmt: skip
    path = tmp_path / "zz20.csv"
    table = np.stack(list(columns.values()), axis=-1)
    np.savetxt(path, table, delimiter=",", header=",".join(columns), comments="", fmt="%.8f")
    made = read_recording(path, read_mapping(SI_DEGREES), ship)
    assert made["delta"] == approx(0.5 * (sides["delta_starboard"] + sides["delta_port"]), abs=1e-6)
    assert made["n"] == approx(run["n"], rel=1e-6)
    assert made["phi"] == approx(run["phi"], abs=1e-6) and made["p"] == approx(run["p"], abs=1e-6)


NAMES = {
    "delta_starboard": ["delta_starboard", "rudder_stbd", "starboard_rudder", "rudder_angle_starboard", "stb_rudder"],
    "delta_port": ["delta_port", "rudder_port", "port_rudder_angle"],
    "n_starboard": ["n_starboard", "rpm_stbd", "starboard_shaft", "stbd_rpm"],
    "n_port": ["n_port", "port_rpm", "shaft_port"],
    "phi": ["phi", "roll", "heel"],
    "p": ["p", "roll_rate"],
}


@pytest.mark.parametrize("channel", NAMES)
def test_usual_names_of_heel_and_sides_are_known(channel):
    import re

    for name in NAMES[channel]:
        assert any(re.fullmatch(pattern, name) for pattern in WORDS[channel].split()), name
