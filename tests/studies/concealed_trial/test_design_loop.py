"""Design in the loop: what is advised is sailed with the same ship and effects, and counted."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from manoeuvre_nn.core.errors import InputError
from studies.concealed_trial import loop
from studies.concealed_trial.drawing import CasePlan, Trial, draw_case
from studies.concealed_trial.helm import Run
from studies.concealed_trial.loop import advised_run, loop_table, prepare, random_run, sail_next, unresolved
from studies.concealed_trial.model_error import with_model_error
from studies.concealed_trial.motion import sail
from studies.concealed_trial.record import write_case
from studies.concealed_trial.truth import ConcealedEffect, build

CASE = replace(
    draw_case(6, 0, CasePlan("mariner", (), ()), 1.0),
    runs=(Run("r01", "fit", "tc20", "port", 10.0, 100), Run("r02", "held_out", "zz20", "starboard", 80.0, 100)),
    effects=(ConcealedEffect("side_force", {"force_kN": 500.0, "lever_m": 0.0}, {"r01": [[80, 90]]}),),
    measures=(1.0,),
    channels="no_log",
    hole=None,
)
RNG = np.random.default_rng(1)


def row(first, right, probability=0.95):
    return {"truth": ["a"], "first": first, "first_right": right, "probabilities": {first: (probability, 1)}}


def test_a_case_is_resolved_if_its_first_name_is_right_and_sure():
    assert not unresolved(row("a", True))
    assert unresolved(row("a", True, 0.6))
    assert unresolved(row("b", False))
    assert not unresolved({"truth": [], "first": "none", "first_right": None, "probabilities": {}})


@pytest.mark.parametrize(
    ("plan", "expected"),
    [
        (
            {"manoeuvre": "zz10", "first_turn": "port", "heading_deg": 90.0},
            Run("r03", "fit", "zz10", "port", 90.0, 420),
        ),
        ({"manoeuvre": "tc20", "first_turn": "starboard"}, Run("r03", "fit", "tc20", "starboard", 10.0, 600)),
        ({"repeat": "r02", "channel": "speed log"}, Run("r03", "fit", "zz20", "starboard", 80.0, 100)),
        ({"manoeuvre": "sit down"}, None),
        ({"repeat": "r09"}, None),
    ],
)
def test_what_is_advised_becomes_a_run(plan, expected):
    assert advised_run(plan, CASE, RNG) == expected


def test_a_run_at_half_speed_is_sailed_at_half_speed_for_twice_the_time():
    run = advised_run({"manoeuvre": "straight", "heading_deg": 40.0, "speed_share": 0.5}, CASE, RNG)
    assert (run.share, run.angle) == (0.5, 0.0)
    track = sail(build(CASE.ship, [], ["r03"]), (replace(run, duration=60),), step=0.5)
    assert 0.45 < track.state[-1, 3, 0] / CASE.ship.speed < 0.7
    assert set(track.n[:, 0]) == {0.5 * CASE.ship.rpm}


def test_a_pull_out_turns_by_sixty_degrees_and_then_holds_the_rudder_amidships():
    run = Run("r03", "fit", "po20", "starboard", 40.0, 300)
    track = sail(build(CASE.ship, [], ["r03"]), (run,), step=0.5)
    turned = np.degrees(track.state[:, 2, 0]) - 40.0
    order = np.degrees(track.order[:, 0])
    assert set(order[(track.t > 62) & (turned < 58)].round(6)) == {-20.0}
    assert set(order[turned > 62].round(6)) == {0.0}


def test_the_new_run_has_the_coefficients_of_the_case_and_chances_of_its_own():
    again = replace(CASE, runs=tuple(replace(run, name=f"new {run.name}") for run in CASE.runs))
    first = with_model_error(CASE, np.random.default_rng(CASE.chance))
    second = with_model_error(again, np.random.default_rng(CASE.chance), np.random.default_rng(5))
    np.testing.assert_array_equal(first.equations.table, second.equations.table)
    assert not np.allclose(first.model_error[:50, :, 0], second.model_error[:50, :, 0])


@pytest.mark.slow
def test_both_new_cases_hold_the_recordings_and_one_run_more_of_the_same_recorder(tmp_path):
    write_case(CASE, tmp_path / "recordings" / CASE.name, 0.5)
    plan = {"next_run": {"manoeuvre": "zz20", "first_turn": "port", "heading_deg": 120.0}}
    assert prepare(CASE, plan, tmp_path, [3, 0])
    assert not prepare(CASE, {"next_run": None}, tmp_path, [3, 0])
    runs = {}
    for way in loop.WAYS:
        folder = tmp_path / "loop" / way / "recordings" / CASE.name
        described = json.loads((folder / "manifest.json").read_text())
        assert [run["run"] for run in described["runs"]] == ["r01", "r02", "r03"]
        new = pd.read_csv(folder / "r03.csv")
        assert "u_log" not in new
        assert len(new) == described["runs"][-1]["rows"]
        assert (folder / "r01.csv").read_bytes() == (tmp_path / "recordings" / CASE.name / "r01.csv").read_bytes()
        runs[way] = described["runs"][-1]
    assert runs["advised"]["initial_heading_deg"] == 120.0
    assert runs["advised"]["split"] == runs["random"]["split"] == "fit"


@pytest.mark.slow
def test_a_run_sailed_again_has_the_channel_that_was_asked_for(tmp_path):
    case = replace(CASE, effects=(), measures=())
    write_case(case, tmp_path / "recordings" / CASE.name, 0.5)
    assert prepare(case, {"next_run": {"repeat": "r01", "channel": "speed log"}}, tmp_path, [3, 0])
    folder = tmp_path / "loop" / "advised" / "recordings" / CASE.name
    logged = pd.read_csv(folder / "r03.csv")["u_log"]
    assert logged.notna().mean() > 0.9
    assert json.loads((folder / "manifest.json").read_text())["channels"]["u_log"] == "m/s"
    for name in ("r01", "r02"):
        assert "u_log" not in pd.read_csv(folder / f"{name}.csv")
    assert "u_log" not in pd.read_csv(tmp_path / "loop" / "random" / "recordings" / CASE.name / "r03.csv")


def test_a_random_run_is_one_of_the_ships():
    drawn = {random_run(CASE, np.random.default_rng(k)).manoeuvre for k in range(40)}
    assert drawn == {name for name in CASE.ship.manoeuvres_s if name != "spiral"}


def test_the_table_counts_what_was_resolved():
    text = loop_table(
        [row("b", False), row("b", False)], {"advised": [row("a", True), row("a", True, 0.5)], "random": []}
    )
    assert "| as recorded | 0% [0%, 66%] 0/2 | 0% [0%, 66%] 0/2 |" in text
    assert "| with one advised run more | 100% [34%, 100%] 2/2 | 50% [9%, 91%] 1/2 |" in text
    assert "| with one random run more | - | - |" in text


def test_without_a_scoreboard_no_run_can_be_chosen(tmp_path):
    with pytest.raises(InputError, match="score the trial first"):
        sail_next(Trial(1, 1), tmp_path, tmp_path)
