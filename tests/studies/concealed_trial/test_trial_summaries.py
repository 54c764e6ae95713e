"""Scores over cases: names of pairs and triples, places, stated effects alone, intervals, limits and defects."""

import numpy as np
import pytest

from studies.concealed_trial.effects import KINDS
from studies.concealed_trial.score import _effect_marks, names_right, parameter_marks, places, score_case
from studies.concealed_trial.scoreboard import label_losses, markdown, scoreboard
from studies.concealed_trial.ships import trial_ships
from studies.concealed_trial.stated import claimed, half_times, parameter_names, stated_effects
from studies.concealed_trial.summaries import bootstrap, parameter_error, place_f1
from tests.studies.concealed_trial.test_trial_score import EFFECTS, perfect, put, recordings, truth_of

__all__ = ["recordings"]
SHIP = trial_ships()["mariner"]


def effect(name, equation=("X",)):
    return {"name": name, "equation": list(equation), "equation_accepted": [], "equivalent_names": []}


@pytest.mark.parametrize(
    ("named", "marks"),
    [
        (["current", "ice_resistance", "trim_change"], (True, True, True)),
        (["trim_change", "current", "ice_resistance"], (True, True, True)),
        (["rate_bias", "current", "ice_resistance"], (False, True, False)),
        (["rate_bias", "log_scale", "current"], (False, False, False)),
        (["current", "current", "ice_resistance"], (True, True, False)),
        (["current"], (True, True, False)),
    ],
)
def test_names_of_a_triple_count_first_among_two_and_all(named, marks):
    concealed = [effect(name) for name in ("current", "trim_change", "ice_resistance")]
    found = names_right(named[0], named, concealed)
    assert (found["first_right"], found["first_two_right"], found["all_right"]) == marks
    assert found["both_right"] is None


def test_unknown_is_said_wrongly_on_clean_cases_and_listed_effects_only():
    assert names_right("unknown", ["unknown"], [])["unknown_wrong"] is True
    assert names_right("none", [], [])["unknown_wrong"] is False
    assert names_right("unknown", ["unknown"], [effect("current")])["unknown_wrong"] is True
    assert names_right("unknown", ["unknown"], [effect("unknown")])["unknown_wrong"] is None


def test_places_count_what_was_found_said_in_vain_and_missed():
    said = [{"equation": ["X"]}, {"equation": "sensor:r"}, {"equation": ["N", "Y"]}]
    concealed = [effect("a", ["Y", "N"]), effect("b", ["X"]), effect("c", ["kinematics"])]
    assert places(said, concealed) == (2, 1, 1)
    assert places(said[:1], []) == (0, 1, 0)
    assert place_f1([{"places": (2, 1, 1)}, {"places": (0, 1, 0)}]) == pytest.approx(4 / 7)
    assert place_f1([{"places": (0, 0, 0)}]) is None


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("others", [False, True])
def test_a_place_is_not_taken_from_the_effect_that_has_no_other(turned, others):
    """What a rudder does may be said of its forces, too: waves beside it act nowhere else."""
    said = [{"equation": ["X", "Y", "N"]}, {"equation": ["actuator:rudder"]}]
    forces = [["Y", "N"], ["X", "Y", "N"]]
    concealed = [
        {"equation": ["actuator:rudder"], "equation_accepted": [["actuator:rudder"], *forces]},
        {"equation": ["X", "Y", "N"], "equation_accepted": None},
    ]
    both = concealed[::-1] if turned else concealed
    wrong = [{"equation": ["sensor:r"]}] if others else []
    assert places(said[::-1] + wrong, both) == places(said + wrong, both) == (2, len(wrong), 0)
    assert places(said[:1], both) == (1, 0, 1) and places([], both) == (0, 0, 2)


def test_what_an_answer_claims_is_its_model_or_what_is_likely():
    entries = [{"name": "a", "probability": 0.4}, {"name": "b", "probability": 0.7}]
    assert [e["name"] for e in claimed({"verdict": "mismatch", "effects": entries})] == ["b"]
    assert [e["name"] for e in claimed({"verdict": "mismatch", "effects": entries, "model": ["a"]})] == ["a"]
    assert [e["name"] for e in claimed({"verdict": "mismatch", "effects": entries[:1]})] == ["a"]
    assert claimed({"verdict": "none", "effects": entries}) == []


@pytest.mark.slow
def test_stated_parameters_alone_close_the_gap_whatever_the_predictions_do(recordings, tmp_path):
    truth, case = truth_of("pair"), recordings / "c_pair"
    put(tmp_path / "right", perfect(truth), case, ())
    row = score_case(case, tmp_path / "right", truth)
    assert row["share"] == pytest.approx(0.0, abs=0.02)
    assert row["share_stated"] == pytest.approx(1.0, abs=0.01)
    wrong = perfect(truth)
    wrong["effects"][0]["parameters"]["speed"][0] *= 0.5
    put(tmp_path / "wrong", wrong, case, EFFECTS["pair"])
    row = score_case(case, tmp_path / "wrong", truth)
    assert row["share"] == pytest.approx(1.0)
    assert row["share_stated"] < 0.7
    put(tmp_path / "unknown", {"verdict": "mismatch", "effects": [{"name": "unknown", "probability": 0.9}]}, case, ())
    assert score_case(case, tmp_path / "unknown", truth)["share_stated"] == pytest.approx(0.0, abs=0.02)


def test_stated_values_that_cannot_be_run_count_as_harm(recordings, tmp_path):
    shallow = {
        "name": "shallow_water",
        "probability": 1.0,
        "equation": ["X"],
        "parameters": {"depth_m": [2.0, 0.1, "m"]},
    }
    put(tmp_path, {"verdict": "mismatch", "effects": [shallow]}, recordings / "c_offset", ())
    assert score_case(recordings / "c_offset", tmp_path, truth_of("offset"))["share_stated"] == -1.0


def onset(name="wind_onset", **more):
    values = {"speed": [20.0, 1.0, "m/s"], "from_deg": [30.0, 2.0, "deg"], **more}
    return {
        "name": name,
        "probability": 1.0,
        "equation": ["X"],
        "intervals": {"r01": [[100.0, 900.0]], "r02": []},
        "parameters": values,
    }


def test_a_wind_that_sets_in_over_a_stated_ramp_acts_from_half_way_up_it():
    """Its interval is told from the foot of the ramp on; a trial's own begins where half of the wind blows."""
    slow, at_once = onset(ramp_s=[120.0, 9.0, "s"]), onset()
    assert half_times(slow) == ({"r01": [[160.0, 900.0]], "r02": []}, 120.0)
    assert half_times(at_once) == (at_once["intervals"], 0.0)
    assert half_times(onset("side_force", ramp_s=[120.0])) == (at_once["intervals"], 0.0), "it does not set in"
    (stated,) = stated_effects({"verdict": "mismatch", "effects": [slow]}, SHIP)
    assert (stated.intervals, stated.ramp) == ({"r01": [[160, 900]], "r02": []}, 120.0)
    truth = {**effect("wind_onset"), "intervals": {"r01": [[160, 900]]}, "parameters": {"speed": 20.0}}
    manifest = {"runs": [{"run": name, "duration_s": 900} for name in ("r01", "r02")]}
    marks = [_effect_marks(truth, [said], manifest) for said in (slow, at_once)]
    assert [mark["overlap"] for mark in marks] == [1.0, pytest.approx(740 / 800)]


def test_an_effect_without_all_its_parameters_states_nothing():
    entry = {"name": "current", "probability": 1.0, "intervals": "all", "parameters": {"speed": [1.0, 0.1, "m/s"]}}
    answer = {"verdict": "mismatch", "effects": [entry]}
    assert stated_effects(answer, SHIP) == []
    entry["parameters"]["toward_deg"] = [30.0]
    assert dict(stated_effects(answer, SHIP)[0].parameters) == {"speed": 1.0, "toward_deg": 30.0}
    assert all(parameter_names(kind, SHIP) for kind in KINDS)


def test_errors_of_parameters_are_relative_and_those_of_directions_in_radians():
    speed, angle = parameter_marks("speed", 10.0, [10.5]), parameter_marks("from_deg", 359.0, [5.0])
    assert (speed["error"], angle["error"]) == (pytest.approx(0.05), pytest.approx(np.radians(6.0)))
    rows = [{"effects": [{"parameters": [speed, angle, parameter_marks("speed", 1.0, None)]}]}]
    assert parameter_error(rows) == pytest.approx((0.05 + np.radians(6.0)) / 2)


def test_a_bootstrap_interval_covers_the_mean_as_often_as_it_says():
    def mean(rows):
        return float(np.mean([row["x"] for row in rows]))

    inside = []
    for seed in range(40):
        drawn = np.random.default_rng(seed).normal(2.0, 1.0, 30)
        low, high = bootstrap([{"x": x} for x in drawn], mean)
        inside.append(low < 2.0 < high)
        assert high - low == pytest.approx(4 * drawn.std() / np.sqrt(30), rel=0.3)
    assert 34 <= sum(inside) <= 40
    assert bootstrap([{"x": 1.0}], lambda rows: None) is None


def test_a_loss_is_a_limit_where_the_ideal_observer_loses_too(recordings, tmp_path):
    rows = [score_case(recordings / f"c_{name}", tmp_path, truth_of(name)) for name in EFFECTS]
    ideal = [dict(row) for row in rows]
    ideal[1]["first_right"] = True
    label_losses(rows, ideal)
    assert [row["loss"] for row in rows] == [None, "defect", "limit"]
    board = scoreboard(rows)
    limits = board["totals"]["of the losses, limits"]
    assert (limits["right"], limits["count"]) == (1, 2)
    assert "| of the losses, limits |" in markdown({"tool": board})


def test_scores_stand_by_the_strongest_effect_and_by_channel_set(recordings, tmp_path):
    truths = [truth_of(name) | {"channels": channels} for name, channels in (("pair", "no_log"), ("offset", "full"))]
    truths[0]["effects"][1]["strength"] = "extreme"
    rows = []
    for truth in truths:
        put(tmp_path / truth["case"], perfect(truth))
        rows.append(score_case(recordings / truth["case"], tmp_path / truth["case"], truth))
    board = scoreboard(rows)
    assert [board["by_strength"][s]["first name"]["count"] for s in ("moderate", "extreme")] == [1, 1]
    assert [board["by_strength"][s]["effects"] for s in ("moderate", "extreme")] == [2, 1]
    assert board["by_channels"]["no_log"]["effects"] == 2
    assert board["intervals"]["place, F1"] == (1.0, 1.0)
