"""The runs of Hess & Faller 2000, sailed again."""

from dataclasses import replace

import numpy as np
import pytest
from fleet import unchecked
from pytest import approx

from manoeuvre_nn.core.units import DEGREE, KNOT
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.effect.wind import SteadyWind
from manoeuvre_nn.manoeuvre.turning import tactical_circle
from manoeuvre_nn.manoeuvre.zigzag import overshoot
from studies.hess2000.runs import CIRCLE_SPEEDS_KN, SHIPS, Counts, PlannedRun, plan_circles, plan_overshoots, sail


@pytest.fixture(autouse=True)
def unchecked_types():
    """Thousands of steps without the checks of shapes and types."""
    with unchecked():
        yield


@pytest.fixture(scope="module")
def ship():
    return SHIPS[2]()


@pytest.mark.slow
def test_runs_of_all_speeds_in_one_batch_are_those_sailed_alone(ship):
    fast = [replace(tactical_circle(35.0, turn_deg=90.0), speed=v * KNOT) for v in (15.0, 30.0)]
    for run, alone in zip(
        sail(ship, [PlannedRun(m) for m in fast]), roll_out(CalmWater(ship), fast, step=0.5, interval=1.0), strict=True
    ):
        first = len(alone) - len(run)
        assert first == np.ceil(60.0 - ship.particulars.length / run["u"][0])
        for name in ("u", "v", "r", "psi", "phi", "n_port", "rdot"):
            assert run[name] == approx(alone[name][first:], rel=1e-9, abs=1e-12), name


@pytest.mark.slow
def test_each_run_has_its_own_wind(ship):
    manoeuvre = replace(overshoot(10.0, cycles=0.5), speed=12.0 * KNOT, duration=90.0)
    runs = sail(ship, [PlannedRun(manoeuvre, 12.0, 10.0), PlannedRun(manoeuvre, 6.0, 190.0)])
    for run, (speed, origin) in zip(runs, [(12.0, 10.0), (6.0, 190.0)], strict=True):
        wind = SteadyWind(ship, speed=speed, from_deg=origin)
        (alone,) = roll_out(Vessel(CalmWater(ship), [wind]), [manoeuvre], step=0.5, interval=1.0)
        assert run["v"] == approx(alone["v"][-len(run) :], rel=1e-9, abs=1e-12)
        assert run["wind_speed"][0] == speed and run["wind_from"][-1] == approx(origin * DEGREE)


@pytest.mark.slow
def test_circles_end_after_540_degrees_and_begin_a_length_before_the_order():
    plan = plan_circles(2, 0, Counts(1, 0, 0))
    turn = replace(tactical_circle(35.0, "port"), speed=25.0 * KNOT)
    (run,) = replace(plan, runs=[PlannedRun(turn)]).sailed().own
    assert np.degrees(run["psi"][-1]) == approx(-540.0, abs=4.0)
    began = run.time[np.flatnonzero(run["delta_order"])[0]]
    assert began * run["u"][0] == approx(plan.ship.particulars.length, rel=0.15)
    assert run.status == "ok" and run["x"][0] == run["y"][0] == run.time[0] == 0.0


def test_circles_are_spread_over_angles_speeds_and_sides_and_none_is_sailed_twice():
    for ship, speeds in CIRCLE_SPEEDS_KN.items():
        plan = plan_circles(ship)
        own = [run.manoeuvre for run in plan.runs[: plan.counts.own]]
        assert len({(abs(m.stages[1].order), m.speed) for m in own}) == plan.counts.own == {1: 15, 2: 25}[ship]
        assert {round(m.largest_order / DEGREE) for m in own} == {10, 15, 20, 25, 30, 35}
        assert [bound(m.speed for m in own) / KNOT for bound in (min, max)] == approx(list(speeds))
        assert 0 < sum(m.stages[1].order < 0 for m in own) < plan.counts.own / 3
        assert all(10 < own[k].largest_order / DEGREE < 35 for k in plan.validation)
        assert len(plan.validation) == plan.counts.validation and len(plan.runs) == plan.counts.own + 6


def test_overshoots_with_and_without_wind_are_the_same_manoeuvres_on_opposite_courses():
    calm, windy = plan_overshoots(), plan_overshoots("open ocean")
    assert [run.manoeuvre for run in calm.runs] == [run.manoeuvre for run in windy.runs]
    assert calm.validation == windy.validation and len(calm.runs) == 40
    assert not any(run.wind_speed for run in calm.runs)
    for one, other in zip(windy.runs[::2], windy.runs[1::2], strict=True):
        assert 3.0 <= one.wind_speed == other.wind_speed <= 12.0 and one.wind_from_deg == other.wind_from_deg
        assert other.heading - one.heading == np.pi
        assert abs(np.cos(one.wind_from_deg * DEGREE)) >= np.cos(10.0 * DEGREE) - 1e-12
    assert plan_overshoots("strong").ship.particulars.above_water.lateral == approx(
        1.5 * calm.ship.particulars.above_water.lateral
    )
