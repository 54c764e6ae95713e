"""What can be drawn: events, poorer recorders, holes, strict trials, random and remembering forces, extreme sizes."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from tiers import mainly, only

from studies.concealed_trial import true_model
from studies.concealed_trial.channels import CHANNEL_SETS, GIVEN
from studies.concealed_trial.drawing import CasePlan, Trial, draw_case, plans
from studies.concealed_trial.effects import KINDS, UNMODELLED, kind_of
from studies.concealed_trial.events import draw_intervals
from studies.concealed_trial.forces import gate
from studies.concealed_trial.helm import Run
from studies.concealed_trial.motion import sail
from studies.concealed_trial.record import write_case
from studies.concealed_trial.ships import trial_ships
from studies.concealed_trial.strength import WARMUP, draw_effect
from studies.concealed_trial.truth import ConcealedEffect, build
from studies.concealed_trial.unmodelled import random_course

RUNS = (
    Run("r01", "fit", "tc20", "port", 10.0, 600),
    Run("r02", "held_out", "zz20", "starboard", 80.0, 600),
    Run("r03", "fit", "zz20", "port", 200.0, 600),
    Run("r04", "held_out", "tc20", "starboard", 300.0, 600),
)


def small_case(**changes):
    """A clean case of short runs."""
    case = draw_case(4, 0, CasePlan("mariner", (), ()), 0.0)
    runs = tuple(replace(run, duration=150) for run in RUNS[:2])
    return replace(case, runs=runs, outliers=0.0, **changes)


def test_events_act_once_or_twice_in_all_runs_some_or_one():
    rng, shapes = np.random.default_rng(1), Counter()
    for _ in range(60):
        intervals, ramp = draw_intervals(rng, "interval", RUNS)
        assert ramp == 0
        shapes[tuple(sorted(len(intervals[run.name]) for run in RUNS))] += 1
        for run in RUNS:
            edges = [t for interval in intervals[run.name] for t in interval]
            assert edges == sorted(edges)
            assert not edges or (edges[0] >= 80 and edges[-1] <= run.duration)
        acting = {run.split for run in RUNS if intervals[run.name]}
        assert "fit" in acting
    assert set(shapes) == {(1, 1, 1, 1), (2, 2, 2, 2), (0, 0, 1, 1), (0, 0, 0, 1)}


def test_wind_sets_in_at_once_or_over_minutes_and_stays():
    rng = np.random.default_rng(2)
    drawn = [draw_intervals(rng, "onset", RUNS) for _ in range(40)]
    ramps = [ramp for _, ramp in drawn]
    assert 10 < sum(ramp == 0 for ramp in ramps) < 30
    assert all(60 <= ramp <= 240 for ramp in ramps if ramp)
    for intervals, ramp in drawn:
        for parts in intervals.values():
            assert all(end == 600 and start - 0.5 * ramp >= 60 for start, end in parts)


def test_half_of_a_ramp_acts_at_the_beginning_of_its_interval():
    acts = gate({"r01": [[200, 600]], "r02": []}, ["r01", "r02"], 100.0)
    assert [acts(t)[0] for t in (149.0, 175.0, 200.0, 225.0, 260.0, 601.0)] == [0, 0.25, 0.5, 0.75, 1, 0]
    assert all(acts(t)[1] == 0 for t in (0.0, 300.0))
    np.testing.assert_array_equal(gate({"r01": [[200, 600]]}, ["r01"] * 2)(np.array([100.0, 300.0])), [0, 1])


@pytest.mark.parametrize("channels", only({"gps_heading", "two_seconds"}, CHANNEL_SETS))
def test_a_poorer_recorder_leaves_channels_or_seconds_out_and_can_still_be_scored(channels, tmp_path):
    case = small_case(channels=channels)
    write_case(case, tmp_path, 0.5)
    missing, interval = CHANNEL_SETS[channels]
    described = true_model.read_manifest(tmp_path)
    assert described["sample_interval_s"] == interval
    table = pd.read_csv(tmp_path / "r02.csv")
    assert not set(missing) & set(table) and not set(missing) & set(described["channels"])
    assert set(np.diff(table["t"])) == {interval}
    assert [len(table)] == [run["rows"] for run in described["runs"] if run["run"] == "r02"]
    errors = true_model.rmse(tmp_path, true_model.predictions(tmp_path, []))
    assert set(errors) == {"pos", "psi", "u", "v", "r", "u_log"} - set(missing)
    assert true_model.total(case.ship, errors) < 1.2


def test_a_hole_takes_rows_out_of_its_run_only(tmp_path):
    write_case(small_case(hole=("r01", 70, 130)), tmp_path, 0.5)
    times = [pd.read_csv(tmp_path / f"{run}.csv")["t"].to_numpy() for run in ("r01", "r02")]
    assert not ((times[0] >= 70) & (times[0] <= 130)).any()
    assert (len(times[0]), len(times[1])) == (90, 151)
    assert [run["rows"] for run in true_model.read_manifest(tmp_path)["runs"]] == [90, 151]


def test_holes_are_drawn_in_runs_to_fit_for_one_to_three_minutes():
    case = draw_case(5, 0, CasePlan("mariner", (), (), hole=True))
    name, start, end = case.hole
    run = next(run for run in case.runs if run.name == name)
    assert run.split == "fit"
    assert 60 <= end - start <= 180
    assert 120 <= start < end < run.duration


def test_held_out_runs_of_a_strict_trial_hold_rudder_and_warm_up_only(tmp_path):
    write_case(small_case(strict=True), tmp_path, 0.5)
    fit, held_out = (pd.read_csv(tmp_path / f"{run}.csv") for run in ("r01", "r02"))
    after = held_out[held_out["t"] > WARMUP]
    assert after[list(GIVEN)].notna().all().all()
    assert after.drop(columns=list(GIVEN)).isna().all().all()
    assert held_out.loc[held_out["t"] <= WARMUP, "psi"].notna().mean() > 0.9
    assert fit["psi"].notna().mean() > 0.9


@pytest.mark.parametrize(("sort", "count"), [("clean", 0), ("single", 1), ("pair", 2), ("triple", 3), ("unknown", 1)])
def test_a_trial_of_one_sort_strength_and_recorder_has_nothing_else(sort, count):
    found = plans(Trial(1, 12, sort=sort, strength="weak", channels="no_log", strict=True))
    assert {len(plan.kinds) for plan in found} == {count}
    assert {s for plan in found for s in plan.strengths} <= {"weak"}
    assert {plan.channels for plan in found} <= {"no_log", "full"}
    assert all(plan.strict for plan in found)
    assert all(len({k.family for k in plan.kinds}) == count for plan in found)


def test_a_random_course_has_its_size_and_memory_and_is_the_same_for_the_same_run():
    course = random_course(7.0, 30.0, ["r01", "r02"])
    np.testing.assert_array_equal(course[:, 1], random_course(7.0, 30.0, ["r02"])[:, 0])
    assert course.std() == pytest.approx(1.0, abs=0.15)
    assert np.mean(course[30:] * course[:-30]) == pytest.approx(np.exp(-1), abs=0.15)
    assert abs(np.corrcoef(course.T)[0, 1]) < 0.3


def test_a_moment_that_remembers_follows_the_yaw_rate_behind_its_lag():
    ship, runs = trial_ships()["mariner"], (replace(RUNS[0], duration=400),)
    truth = build(ship, [ConcealedEffect("unknown", {"a": 1e-6, "lag_s": 40.0}, detail="late_turn")], ["r01"])
    track = sail(truth, runs, step=0.5)
    rate, lagged = track.state[:, 5, 0] * ship.length / ship.speed, track.state[:, 8, 0]
    expected = np.zeros(len(rate))
    for k in range(1, len(rate)):
        expected[k] = expected[k - 1] + (rate[k] + rate[k - 1] - 2 * expected[k - 1]) / 2 / 40.0
    np.testing.assert_allclose(lagged[100:], expected[100:], atol=0.02 * abs(rate).max())


def test_a_random_force_is_left_out_of_what_could_have_been_predicted():
    random, known = ({"name": "unknown", "detail": d, "parameters": {"a": 0.1}} for d in ("random_push", "turn_drag"))
    found = true_model.effects_of({"effects": [random | {"intervals": "all"}, known | {"intervals": "all"}]})
    assert [effect.detail for effect in found] == ["turn_drag"]


@pytest.mark.parametrize("name", mainly(1, ["heading_bias", "current", "rudder_delay", "rudder_backlash"]))
def test_extreme_effects_go_past_what_practice_cases_hold(name):
    ship, rng = trial_ships()["mariner"], np.random.default_rng(3)
    effect, measure = draw_effect(rng, ship, kind_of(name), "extreme", RUNS)
    assert measure > (60 if name == "heading_bias" else 1.0)
    size = next(iter(effect.parameters.values()))
    assert abs(size) > {"current": 0.9, "rudder_delay": 10.0, "rudder_backlash": 6.0, "heading_bias": 5.0}[name]


def test_every_kind_has_room_between_its_sizes():
    assert all(kind.high / kind.low > 5 for kind in (*KINDS, *UNMODELLED))
