"""What must hold for every ship, whatever its coefficients."""

import copy
from dataclasses import replace
from itertools import product
from math import inf, sqrt

import numpy as np
import pytest
import torch
from fleet import SHIPS, TRIALS, coarse, rolled, ship_named, solved, unchecked, without_offsets
from pytest import approx
from tiers import mainly, only

from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.dynamics import rollout as rollout_module
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.manoeuvre.turning import tactical_circle, turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.ship.esso_190k import PARTICULARS as ESSO
from manoeuvre_nn.ship.esso_190k import SELF_PROPULSION, esso_190k
from manoeuvre_nn.ship.tanker import TankerShip

MIRRORED = only(
    {("great_lakes_bulker", False), ("mariner", True), ("esso_190k", True)},
    [("great_lakes_bulker", False), *((name, True) for name in SHIPS)],
)
EVERY_SHIP = pytest.mark.parametrize("name", SHIPS)
SOLVED = pytest.mark.parametrize(
    "name, trial",
    only(
        {*product(["mariner"], set(TRIALS) - {"zz10_5_port"}), *product(["esso_190k_shallow"], ["zz20", "tc25"])},
        product(SHIPS, TRIALS),
    ),
)
"""A ship of each kind of equations is enough to compare solutions in, and of one of them every kind of trial."""


def acceleration(ship, u, rudder=0.0):
    nu = torch.tensor([u, 0.0, 0.0], dtype=torch.float64)
    return ship.acceleration(nu, torch.tensor(rudder, dtype=torch.float64))


@EVERY_SHIP
def test_without_the_offsets_the_approach_is_steady(name):
    ship = without_offsets(ship_named(name))
    speed = SELF_PROPULSION if name.startswith("esso") else ship.particulars.speed
    surge, sway, yaw = acceleration(ship, speed).tolist()
    assert (sway, yaw) == approx((0.0, 0.0), abs=1e-15)
    if name != "esso_190k_shallow":  # 80 rpm do not keep up 16 kn in shallow water
        assert surge == approx(0.0, abs=2e-6)


@EVERY_SHIP
def test_the_offsets_alone_hardly_turn_the_ship_in_100_s(name):
    assert np.abs(rolled(name)["straight"]["psi"]).max() < 30 * DEGREE
    assert rolled(name)["straight"]["u"] == approx(ship_named(name).particulars.speed, rel=0.03)


@EVERY_SHIP
def test_starboard_rudder_turns_to_starboard(name):
    ship = ship_named(name)
    assert acceleration(ship, ship.particulars.speed, 20 * DEGREE)[2] > 0
    assert acceleration(ship, ship.particulars.speed, -20 * DEGREE)[2] < 0
    turn = rolled(name)["tc25"].between(2 * ship.particulars.time_unit, inf)
    assert turn["r"].min() > 0
    assert turn["v"].max() < 0, "the ship drifts outwards"
    assert turn["y"][-1] > turn["y"][0] > 0


@pytest.mark.parametrize("name, bare", MIRRORED)
def test_the_mirrored_zigzag_gives_the_mirrored_track(name, bare):
    """The bulk carrier as it is; the others once the terms that push to one side are zero."""
    ship = without_offsets(ship_named(name)) if bare else ship_named(name)
    starboard, port = coarse(ship, [zigzag(20.0, first=side) for side in ("starboard", "port")], 200.0, 2.0)
    for channel, sign in {"u": 1, "x": 1, "v": -1, "r": -1, "y": -1, "psi": -1, "delta": -1}.items():
        assert port[channel] == approx(sign * starboard[channel], abs=1e-9), channel


@pytest.mark.parametrize("name", ["mariner", "esso_190k"])
def test_with_the_offsets_the_mirrored_zigzag_is_not_mirrored(name):
    trials = [zigzag(20.0, first=side) for side in ("starboard", "port")]
    starboard, port = coarse(ship_named(name), trials, 200.0, 2.0)
    assert np.abs(starboard["psi"] + port["psi"]).max() > 0.5 * DEGREE


@pytest.mark.parametrize(
    "name", mainly(2, ["mariner", "great_lakes_bulker", "mariner_corrected", "mariner_chislett1965"])
)
def test_at_twice_the_speed_the_track_is_the_same_in_half_the_time(name):
    """The rudder's rate is not part of the prime system and is doubled by hand."""
    slow = ship_named(name)
    fast = slow.on_approach(2 * slow.particulars.speed)
    fast.particulars = replace(fast.particulars, rudder_rate=2 * slow.particulars.rudder_rate)
    (a,) = coarse(slow, [zigzag(20.0)], 200.0, 2.0)
    (b,) = coarse(fast, [zigzag(20.0)], 100.0, 1.0)
    assert b["x"] == approx(a["x"], abs=1e-6) and b["y"] == approx(a["y"], abs=1e-6)
    assert b["u"] == approx(2 * a["u"], abs=1e-8) and b["udot"] == approx(4 * a["udot"], abs=1e-8)


@pytest.mark.parametrize("depth", mainly(1, [1.5 * ESSO.draught, inf]))
def test_a_tanker_twice_as_large_moves_alike_by_froude(depth):
    small = esso_190k(depth=depth)
    table = small.coefficients | {"cun": 2 * small.coefficients["cun"], "cnn": 4 * small.coefficients["cnn"]}
    sizes = {k: 2 * getattr(ESSO, k) for k in ("length", "beam", "draught")}
    large = replace(ESSO, **sizes, speed=ESSO.speed * sqrt(2), rudder_rate=ESSO.rudder_rate / sqrt(2))
    rpm, speed = small.rpm / sqrt(2), SELF_PROPULSION * sqrt(2)
    ship = TankerShip(large, 8 * small.volume, table, rpm=rpm, self_propulsion=speed, depth=2 * depth)
    (a,) = coarse(small, [zigzag(20.0)], 400.0, 2.0)
    (b,) = coarse(ship, [zigzag(20.0)], 400.0 * sqrt(2), 2.0 * sqrt(2))
    assert b["x"] / 2 == approx(a["x"], abs=1e-6) and b["y"] / 2 == approx(a["y"], abs=1e-6)
    assert b["u"] / sqrt(2) == approx(a["u"], abs=1e-8)


def test_shallow_water_tends_to_deep_water_as_the_depth_grows():
    nu = torch.tensor([7.0, -0.6, 0.006], dtype=torch.float64)
    rudder = torch.tensor(0.3, dtype=torch.float64)
    deep = esso_190k().acceleration(nu, rudder)
    gaps = [
        float(((esso_190k(depth=h * ESSO.draught).acceleration(nu, rudder) - deep) / deep).abs().max())
        for h in (2, 10, 100, 1000, 1e6)
    ]
    assert gaps == sorted(gaps, reverse=True)
    assert gaps[0] > 0.1 and gaps[3] < 2e-3 and gaps[4] < 2e-6


@SOLVED
def test_the_batched_solution_is_the_accurate_one(name, trial):
    batched, accurate, half = rolled(name)[trial], solved(name, trial), rolled(name, parts=2)[trial]
    length = ship_named(name).particulars.length
    for a, b in ((batched, accurate), (batched, half)):
        assert (a.status, len(a)) == (b.status, len(b)) == ("ok", len(a))
        assert np.hypot(a["x"] - b["x"], a["y"] - b["y"]).max() < 0.002 * length
        assert np.abs(a["psi"] - b["psi"]).max() < 0.1 * DEGREE
        assert np.abs(a["delta"] - b["delta"]).max() < 0.1 * DEGREE


@SOLVED
def test_rudder_rate_and_stop_are_kept(name, trial):
    ship = ship_named(name).particulars
    for recording in (rolled(name)[trial], solved(name, trial)):
        speed = np.diff(recording["delta"]) / np.diff(recording.time)
        assert np.abs(speed).max() <= ship.rudder_rate * (1 + 1e-9)
        assert np.abs(recording["delta"]).max() <= min(ship.rudder_limit, TRIALS[trial].largest_order) + 1e-12
        if trial == "zz20":
            assert np.abs(speed).max() == approx(ship.rudder_rate), "the rudder moves as fast as it can"


@EVERY_SHIP
def test_recorded_velocities_are_the_rates_of_position_and_accelerations_those_of_velocities(name):
    recording = rolled(name)["tc25"].between(40.0, 160.0)
    t = recording.time
    heading = np.stack([np.cos(recording["psi"]), np.sin(recording["psi"])])
    north = recording["u"] * heading[0] - recording["v"] * heading[1]
    east = recording["u"] * heading[1] + recording["v"] * heading[0]
    rates = {"x": north, "y": east, "psi": recording["r"]}
    rates |= {k: recording[f"{k}dot"] for k in ("u", "v", "r")}
    for name_, rate in rates.items():
        middle = np.gradient(recording[name_], t)[1:-1]
        assert middle == approx(rate[1:-1], abs=5e-3 * np.abs(rate).max()), name_


def test_a_turn_to_port_from_a_copy_leaves_the_ship_as_it_was():
    ship = ship_named("mariner")
    before = copy.deepcopy(ship.state_dict())
    roll_out(CalmWater(ship), [turning_circle(25.0, "port", duration=50.0).at_speed(5.0)])
    assert all(torch.equal(v, before[k]) for k, v in ship.state_dict().items())
    assert ship.particulars.speed == 7.614


def test_a_trial_that_is_over_does_not_sail_on_to_the_longest_end_of_its_batch(monkeypatch):
    """A circle that may take forty minutes has come round after one: nobody sails on for the rest."""
    passes = []
    one = rollout_module._pass
    monkeypatch.setattr(rollout_module, "_pass", lambda *args: passes.append(1) or one(*args))
    trials = [zigzag(20.0, duration=20.0), tactical_circle(35.0, approach=5.0, turn_deg=20.0)]
    weave, circle = roll_out(CalmWater(ship_named("mariner")), trials, step=1.0)
    assert weave.time[-1] == 20.0 and circle.time[-1] < 60.0
    assert len(passes) < 100


def test_a_row_that_has_ended_is_stepped_on_by_usual_steps_and_its_numbers_stay_those_of_a_ship():
    seen = []

    class Watched(CalmWater):
        def forward(self, state, inputs):
            seen.append(state)
            return super().forward(state, inputs)

    trials = zigzag(20.0, duration=60.0), turning_circle(25.0, duration=320.0)
    with unchecked():
        short, long = roll_out(Watched(ship_named("mariner")), trials)
    assert short.time[-1] == 60.0 and long.time[-1] > 300.0
    largest = torch.stack([s[:, :3].abs().amax(0) for s in seen if len(s) == 2]).amax(0)
    assert (largest < torch.tensor([10.0, 3.0, 0.05])).all()
    alone = roll_out(CalmWater(ship_named("mariner")), [zigzag(20.0, duration=60.0)])[0]
    assert short["psi"] == approx(alone["psi"], abs=1e-12)
