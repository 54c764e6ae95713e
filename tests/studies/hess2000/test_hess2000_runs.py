"""The runs of Hess & Faller 2000, sailed again."""

from dataclasses import replace

import numpy as np
import pytest
from pytest import approx

from manoeuvre_nn.core.units import DEGREE, KNOT
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.effect.wind import SteadyWind
from manoeuvre_nn.manoeuvre.turning import tactical_circle
from manoeuvre_nn.manoeuvre.zigzag import overshoot
from studies.hess2000.runs import SHIPS, Counts, PlannedRun, circles, overshoots, sail

SOME = Counts(3, 1, 1)


@pytest.fixture(scope="module")
def ship():
    return SHIPS[2]()


def test_runs_of_all_speeds_in_one_batch_are_those_sailed_alone(ship):
    fast = [replace(tactical_circle(35.0, turn_deg=90.0), speed=v * KNOT) for v in (15.0, 30.0)]
    for run, alone in zip(
        sail(ship, [PlannedRun(m) for m in fast]), roll_out(CalmWater(ship), fast, step=0.5, interval=1.0), strict=True
    ):
        first = len(alone) - len(run)
        assert first == np.ceil(60.0 - ship.particulars.length / run["u"][0])
        for name in ("u", "v", "r", "psi", "phi", "n_port", "rdot"):
            assert run[name] == approx(alone[name][first:], rel=1e-9, abs=1e-12), name


def test_each_run_has_its_own_wind(ship):
    manoeuvre = replace(overshoot(10.0, cycles=0.5), speed=8.0 * KNOT)
    runs = sail(ship, [PlannedRun(manoeuvre, 12.0, 10.0), PlannedRun(manoeuvre, 6.0, 190.0)])
    for run, (speed, origin) in zip(runs, [(12.0, 10.0), (6.0, 190.0)], strict=True):
        wind = SteadyWind(ship, speed=speed, from_deg=origin)
        (alone,) = roll_out(Vessel(CalmWater(ship), [wind]), [manoeuvre], step=0.5, interval=1.0)
        assert run["v"] == approx(alone["v"][-len(run) :], rel=1e-9, abs=1e-12)
        assert run["wind_speed"][0] == speed and run["wind_from"][-1] == approx(origin * DEGREE)


def test_circles_end_after_540_degrees_and_begin_a_length_before_the_order():
    made = circles(2, 0, SOME)
    assert (len(made.training), len(made.validation), len(made.unseen), len(made.own)) == (3, 1, 1, 4)
    for run in (*made.own, *made.unseen):
        assert abs(np.degrees(run["psi"][-1])) == approx(540.0, abs=4.0)
        began = run.time[np.flatnonzero(run["delta_order"])[0]]
        assert began * run["u"][0] == approx(made.ship.particulars.length, rel=0.15)
        assert run.status == "ok" and run["x"][0] == run["y"][0] == run.time[0] == 0.0
    assert any(run["r"][-1] < 0 for run in made.own)


def test_overshoots_with_and_without_wind_are_the_same_manoeuvres():
    calm, windy = overshoots("", 0, SOME), overshoots("open ocean", 0, SOME)
    assert [r.name for r in calm.own] == [r.name for r in windy.own]
    assert not any("wind_speed" in r.channels for r in calm.own)
    for run in windy.own:
        assert 3.0 <= run["wind_speed"][0] <= 12.0
        assert abs(np.cos(run["wind_from"][0])) >= np.cos(10.0 * DEGREE) - 1e-12
    assert np.count_nonzero(np.diff(calm.own[0]["delta_order"])) == 5


def test_areas_above_the_water_are_larger_where_a_strong_wind_is_to_be_felt():
    calm, strong = overshoots("", 0, SOME).ship, overshoots("strong", 0, SOME).ship
    assert strong.particulars.above_water.lateral == approx(1.5 * calm.particulars.above_water.lateral)
    assert strong.on_approach(5.0).particulars.above_water == strong.particulars.above_water
