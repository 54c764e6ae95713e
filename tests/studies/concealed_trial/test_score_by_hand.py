"""Every mark and every summary of the scorer on answers that are made by hand, where the value follows by hand."""

import json
from math import inf, radians

import numpy as np
import pytest
from pytest import approx
from referee_folder import write_manifest

from studies.concealed_trial import score, true_model
from studies.concealed_trial.score import names_right, overlap, parameter_marks, probabilities, read_answer
from studies.concealed_trial.scoreboard import label_losses, markdown, scoreboard
from studies.concealed_trial.ships import trial_ships
from studies.concealed_trial.stated import claimed
from studies.concealed_trial.summaries import (
    bootstrap,
    brier,
    calibration,
    calibration_error,
    overlap_mean,
    rate,
    share_mean,
    share_median,
    share_stated,
    share_together,
    wilson,
)

MARINER = trial_ships()["mariner"]


def effect(name, equation=("X",), strength="weak", intervals="all", equivalent=(), **parameters):
    return {"name": name, "equation": list(equation), "equation_accepted": [list(equation)], "strength": strength,
            "equivalent_names": list(equivalent), "intervals": intervals, "parameters": parameters}  # fmt: skip


@pytest.mark.parametrize(("given", "right", "covered", "error"), [
    ([10.99], True, None, 0.099), ([11.01], False, None, 0.101), ([9.01], True, None, 0.099),
    ([8.99], False, None, 0.101), ([11.5, 0.76], True, True, 0.15), ([11.5, 0.74], False, False, 0.15),
    ([10.5, 0.24], True, False, 0.05), ([10.5, 0.26], True, True, 0.05),
])  # fmt: skip
@pytest.mark.parametrize("sign", [1, -1])
def test_a_parameter_is_right_within_a_tenth_or_two_standard_errors_and_covered_by_the_latter(
    given, right, covered, error, sign
):
    value, *se = given
    marks = parameter_marks("force_kN", sign * 10.0, [sign * value, *se])
    assert (marks["right"], marks["covered"], marks["error"]) == (right, covered, approx(error))


@pytest.mark.parametrize(("true", "value", "se", "right", "covered"), [
    (2.0, 352.01, None, True, None), (2.0, 351.99, None, False, None), (2.0, 12.01, 5.1, True, True),
    (350.0, 0.5, 5.2, False, False), (350.0, 0.5, 5.3, True, True), (10.0, 195.0, 80.0, False, False),
])  # fmt: skip
def test_a_direction_is_right_within_ten_degrees_the_shorter_way_round(true, value, se, right, covered):
    for name in ("from_deg", "toward_deg"):
        marks = parameter_marks(name, true, [value, se, "deg"])
        miss = min(abs(value - true), 360 - abs(value - true))
        assert (marks["right"], marks["covered"], marks["error"]) == (right, covered, approx(radians(miss)))
    assert parameter_marks("bias_deg", true, [value, se, "deg"])["error"] == approx(abs(value - true) / true)


def test_a_true_value_of_nothing_has_no_relative_error():
    assert parameter_marks("dy_m", 0.0, [0.5, 0.3, "m"]) | {"name": ""} == {
        "name": "", "true": 0.0, "value": 0.5, "se": 0.3, "right": True, "covered": True, "error": None,
    }  # fmt: skip


def test_overlap_counts_seconds_half_open_over_all_runs():
    manifest = {"runs": [{"run": "a", "duration_s": 50}, {"run": "b", "duration_s": 80}]}
    true = {"a": [[10, 20], [30, 40]], "b": [[60, 80]]}
    assert overlap(true, {"a": [[15, 35]], "b": []}, manifest) == approx(10 / 50)
    assert overlap(true, {"a": [[9, 21], [30, 40]], "b": [[59, 90]]}, manifest) == approx(40 / 43)
    assert overlap({"a": [], "b": []}, {}, manifest) == 1.0, "nothing was there and nothing was said"
    assert overlap("all", {"a": [[0, 25]]}, manifest) == approx(25 / 130)
    assert overlap("all", "all", manifest) == 1.0


@pytest.mark.parametrize(("named", "marks"), [
    (["propeller_side_force", "current"], (True, True, True, True)),
    (["current", "propeller_side_force"], (True, True, True, True)),
    (["rudder_offset", "propeller_side_force"], (True, True, False, True)),
    (["log_scale", "rudder_offset"], (False, True, False, False)),
    (["rudder_slow", "log_scale"], (False, False, False, True)),
    (["log_scale", "trim_change", "current"], (False, False, False, False)),
])  # fmt: skip
def test_names_of_a_pair(named, marks):
    pair = [effect("rudder_offset", equivalent=("propeller_side_force",)), effect("current")]
    found = names_right(named[0], named, pair)
    keys = ("first_right", "first_two_right", "both_right", "family_right")
    assert tuple(found[k] for k in keys) == marks
    assert found["all_right"] is found["both_right"] and found["unknown_right"] is None and not found["unknown_wrong"]
    none = names_right("none", named, pair)
    assert not any(none[k] for k in keys), "a verdict of none names nothing"


def test_unknown_is_right_where_it_was_and_wrong_elsewhere():
    assert names_right("unknown", ["unknown"], [effect("unknown")])["unknown_right"] is True
    assert names_right("current", ["current"], [effect("unknown")])["unknown_right"] is False
    assert names_right("current", ["current"], [effect("wave_drift")])["unknown_right"] is None
    single = names_right("current", ["current"], [effect("current")])
    assert single["both_right"] is single["all_right"] is None and single["first_right"]


def test_probabilities_of_names_that_cannot_be_told_apart_add_up_to_one_at_most():
    answer = {
        "effects": [
            {"name": n, "probability": p}
            for n, p in (
                ("rudder_offset", 0.5),
                ("propeller_side_force", 0.3),
                ("current", 0.1),
                ("current", 0.2),
                ("nonsense", 0.9),
            )
        ]
    }
    concealed = [effect("propeller_side_force", equivalent=("rudder_offset",))]
    found = probabilities(answer, concealed)
    assert found["propeller_side_force"] == (0.8, 1) and found["current"] == (0.2, 0) and len(found) == 25
    assert "rudder_offset" not in found and "nonsense" not in found
    answer["effects"][0]["probability"] = 0.9
    assert probabilities(answer, concealed)["propeller_side_force"] == (1.0, 1)
    assert sum(y for _, y in probabilities(answer, []).values()) == 0 and len(probabilities(answer, [])) == 26


def test_an_answer_is_read_with_its_probabilities_between_nothing_and_one(tmp_path):
    path = tmp_path / "answer.json"

    def read(**answer):
        path.write_text(json.dumps(answer))
        return read_answer(path)

    entries = [{"name": "current", "probability": p} for p in (1.7, -0.2, None)]
    answer, note = read(verdict="mismatch", effects=entries, model=["current"])
    assert [e["probability"] for e in answer["effects"]] == [1.0, 0.0, 0.0] and note is None
    assert answer["effects"][0] | {"name": ""} == {"name": "", "probability": 1.0, "equation": [], "intervals": "all",
                                                   "parameters": {}}  # fmt: skip
    assert answer["model"] == ["current"] and read(verdict="none", model="current")[0]["model"] is None
    for wrong in ({"verdict": "maybe"}, {"effects": []}, {"verdict": "mismatch", "effects": [{"probability": 1}]}):
        assert read(**wrong)[0] == {"verdict": "none", "effects": []}
    assert "'maybe' is neither" in read(verdict="maybe")[1]


@pytest.fixture
def case(tmp_path):
    return write_manifest(tmp_path)


def scored(case, monkeypatch, answer, effects, **truth):
    """Marks of an answer, without those of the predictions."""
    monkeypatch.setattr(score, "gap", lambda *_: {})
    (case / "answer.json").write_text(json.dumps(answer))
    return score.score_case(case, case, {"case": "c1", "ship": "mariner", "effects": effects, **truth})


def test_marks_of_a_case_by_hand(case, monkeypatch):
    times = {"a": [[20, 60]], "b": [[50, 80]]}
    effects = [effect("side_force", ("Y", "N"), "strong", times, force_kN=100.0, lever_m=20.0), effect("log_scale")]
    said = {"name": "side_force", "probability": 0.75, "equation": ["N", "Y"], "intervals": {"a": [[20, 40]]},
            "parameters": {"force_kN": [95.0, 1.0, "kN"]}}  # fmt: skip
    other = {"name": "current", "probability": 0.6, "equation": "kinematics"}
    row = scored(case, monkeypatch, {"verdict": "mismatch", "effects": [said, other]}, effects, channels="no_shaft")
    assert row["false_alarm"] is None and row["detected"] and row["first"] == "side_force" and row["answered"]
    assert (row["truth"], row["strength"]) == (["side_force", "log_scale"], ["strong", "weak"])
    assert (row["strongest"], row["channels"], row["family"]) == ("strong", "no_shaft", ["local force", "sensors"])
    force, log = row["effects"]
    assert (force["named"], force["place_right"], log["named"], log["place_right"]) == (True, True, False, False)
    assert force["overlap"] == approx(20 / 70) and log["overlap"] is None
    assert [(p["name"], p["right"], p["covered"]) for p in force["parameters"]] == [
        ("force_kN", True, False), ("lever_m", False, None),
    ]  # fmt: skip
    assert log["parameters"] == [] and row["places"] == (1, 1, 1)
    assert row["brier"] == approx(0.25**2 + 0.6**2 + 1.0)
    third = scored(case, monkeypatch, {"verdict": "mismatch", "effects": [other, other, said]}, effects)
    assert not third["effects"][0]["named"], "as many entries count as there are effects"
    clean = scored(case, monkeypatch, {"verdict": "mismatch", "effects": [other]}, [])
    assert clean["false_alarm"] is True and clean["detected"] is clean["strongest"] is None
    quiet = scored(case, monkeypatch, {"verdict": "none", "effects": [other]}, [])
    assert (quiet["false_alarm"], quiet["first"], quiet["places"]) == (False, "none", (0, 0, 0))
    assert quiet["brier"] == approx(0.36), "listed probabilities count under a verdict of none, too"


def test_a_name_that_counts_as_equal_has_no_parameters_and_unknown_none_either(case, monkeypatch):
    offset = effect("rudder_offset", ("actuator:rudder",), equivalent=("propeller_side_force",), offset_deg=2.0)
    entry = {"name": "propeller_side_force", "probability": 1.0, "equation": "actuator:rudder",
             "parameters": {"offset_deg": [2.0, 0.1, ""]}}  # fmt: skip
    (marks,) = scored(case, monkeypatch, {"verdict": "mismatch", "effects": [entry]}, [offset])["effects"]
    assert marks["named"] and marks["place_right"] and marks["parameters"] == []
    unknown = effect("unknown", a=1.0)
    entry = {"name": "unknown", "probability": 1.0, "equation": ["X"], "parameters": {"a": [1.0]}}
    (marks,) = scored(case, monkeypatch, {"verdict": "mismatch", "effects": [entry]}, [unknown])["effects"]
    assert marks["named"] and marks["parameters"] == []


def test_an_answer_claims_what_is_half_probable_or_in_its_model_or_first():
    entries = [{"name": n, "probability": p} for n, p in (("a", 0.49), ("b", 0.5), ("c", 0.9))]
    assert [e["name"] for e in claimed({"verdict": "mismatch", "effects": entries})] == ["b", "c"]
    assert [e["name"] for e in claimed({"verdict": "mismatch", "effects": entries, "model": ["a", "c"]})] == ["a", "c"]
    assert [e["name"] for e in claimed({"verdict": "mismatch", "effects": entries[:1]})] == ["a"]
    assert claimed({"verdict": "none", "effects": entries}) == []


@pytest.fixture
def gap(monkeypatch, tmp_path):
    """The gap of J before, after, of the true model and of the stated effects; J stands for its errors."""

    def of(before, after, best, stated=None, name="current"):
        effects = [effect(name)] if name else []
        answers = {"before": before, "after": after}
        monkeypatch.setattr(score, "_read_predictions", lambda folder, which: which)
        monkeypatch.setattr(true_model, "rmse", lambda case, which: answers[which] and {"J": answers[which]})
        monkeypatch.setattr(true_model, "total", lambda ship, errors: errors["J"])
        calm = {"J": 5.0}
        monkeypatch.setattr(score, "_simulated", lambda case, said: calm if said == "[]" else best and {"J": best})
        monkeypatch.setattr(score, "_total_of", lambda case, effects, ship: stated)
        found = score.gap(tmp_path, tmp_path, {"ship": "mariner", "effects": effects}, None if stated is None else [])
        return found["closable"], found["share"], found["harmed"], found["share_stated"]

    return of


def test_the_share_of_the_gap_by_hand(gap):
    assert gap(2.0, 1.0, 0.5, 0.8) == (True, approx(2 / 3), False, approx(0.8))
    assert gap(None, 1.0, 0.5) == (True, approx(4 / 4.5), False, None), "without predictions before: calm water's"
    assert gap(2.0, None, 0.5, 0.5) == (True, None, None, approx(1.0))
    assert gap(2.0, 9.0, 0.5, inf) == (True, -1.0, True, -1.0), "a share is -1 at least"
    assert gap(2.0, 0.4, 0.5)[1] == approx(1.6 / 1.5), "a tool may be better than the true model"


def test_a_gap_is_closable_from_a_tenth_on_and_predictions_are_worse_from_a_twentieth_on(gap):
    assert gap(2.0, 1.9, 1.79)[:2] == (True, approx(0.1 / 0.21))
    assert gap(2.0, 1.9, 1.81, 1.9) == (False, None, False, None)
    assert (gap(2.0, 2.09, 0.5)[2], gap(2.0, 2.11, 0.5)[2]) == (False, True)
    assert gap(2.0, 1.0, 0.5, name="")[:2] == (False, None) and gap(2.0, 2.2, 0.5, name="")[2] is True
    assert gap(2.0, 1.0, 0.5, 0.8, name="unknown")[3] is None, "what no list has cannot be stated"
    assert gap(2.0, 1.0, None) == (False, None, False, None)


@pytest.mark.parametrize(("right", "count", "bounds"), [
    (0, 0, (0.0, 1.0)), (81, 263, (0.2553, 0.3662)), (15, 148, (0.0624, 0.1605)), (0, 20, (0.0, 0.1611)),
    (1, 29, (0.0061, 0.1718)), (29, 29, (0.8830, 1.0)),
])  # fmt: skip
def test_wilsons_interval_has_newcombes_published_values(right, count, bounds):
    """Newcombe 1998, Statistics in Medicine 17, Table I, method 3."""
    assert wilson(right, count) == approx(bounds, abs=6e-5)


def test_rates_leave_out_what_does_not_apply():
    found = rate([True, None, False, True, None])
    assert (found["right"], found["count"], found["share"]) == (2, 3, approx(2 / 3))
    assert (found["low"], found["high"]) == wilson(2, 3) and rate([None]) is None


def test_calibration_has_ten_bins_and_its_error_weighs_them_by_their_count():
    pairs = [(0.05, 0), (0.15, 1), (0.15, 0), (0.1, 0), (0.95, 1), (1.0, 0), (0.0, 1)]
    bins = calibration(pairs)
    assert [(b["from"], b["to"], b["count"]) for b in bins] == [(0.0, 0.1, 1), (0.1, 0.2, 3), (0.9, 1.0, 2)]
    assert [b["said"] for b in bins] == approx([0.05, 0.4 / 3, 0.975])
    assert [b["found"] for b in bins] == approx([0, 1 / 3, 0.5])
    assert (bins[1]["low"], bins[1]["high"]) == wilson(1, 3)
    rows = [{"probabilities": dict(enumerate(pairs)), "brier": 0.4}, {"probabilities": {}, "brier": 1.0}]
    assert calibration_error(rows) == approx((0.05 + 3 * 0.2 + 2 * 0.475) / 6)
    assert brier(rows) == approx(0.7) and calibration_error(rows[1:]) is None


def test_shares_over_cases_by_hand():
    def row(share, before=2.0, best=1.0, stated=None):
        return {"share": share, "j_before": before, "j_true_model": best, "share_stated": stated}

    rows = [row(1.0), row(0.0, 6.0, 2.0, 0.3), row(0.5, 3.0, 1.0, 0.9), row(None, None, None)]
    assert share_mean(rows) == approx(0.5) and share_median(rows) == approx(0.5)
    assert share_together(rows) == approx((1.0 * 1 + 0.0 * 4 + 0.5 * 2) / 7) and share_stated(rows) == approx(0.6)
    assert share_mean(rows[3:]) is share_median(rows[3:]) is share_together(rows[3:]) is share_stated(rows[3:]) is None
    overlaps = [{"effects": [{"overlap": 0.2}, {"overlap": None}]}, {"effects": [{"overlap": 0.8}]}]
    assert overlap_mean(overlaps) == approx(0.5)


def test_a_bootstrap_takes_cases_again_and_reads_the_middle_95_percent():
    rows = [{"x": float(k == 0)} for k in range(4)]
    low, high = bootstrap(rows, lambda some: float(np.mean([r["x"] for r in some])))
    # Binomial(4, 1/4) / 4: no draw has probability .316, three and more .051, all four .004.
    assert (low, high) == (0.0, 0.75)
    sizes = []
    bootstrap(rows, lambda some: sizes.append(len(some)) or 1.0)
    assert set(sizes) == {4} and len(sizes) == 401
    assert bootstrap(rows, lambda some: None if some is not rows and some[0]["x"] else 2.0) == (2.0, 2.0)


def board_row(case, truth, first, **marks):
    """A row of the scoreboard."""
    effects = [{"named": first == n, "family": f, "strength": s, "place_right": True, "overlap": None,
                "parameters": []} for n, f, s in truth]  # fmt: skip
    names = [n for n, *_ in truth]
    right = first in names if names else None
    row = {"case": case, "truth": names, "first": first, "effects": effects, "answered": True, "note": None,
           "strongest": truth[0][2] if truth else None, "family": [f for _, f, _ in truth], "channels": "full",
           "false_alarm": None if names else first != "none", "detected": first != "none" if names else None,
           "first_right": right, "first_two_right": right, "both_right": None, "all_right": None,
           "family_right": right, "unknown_right": first == "unknown" if names == ["unknown"] else None,
           "unknown_wrong": None if "unknown" in names else first == "unknown", "harmed": False, "places": (0, 0, 0),
           "probabilities": {}, "brier": 0.0, "share": None, "share_stated": None}  # fmt: skip
    return row | marks


def test_the_scoreboard_by_hand():
    wind, odd = ("wind_steady", "wind and waves", "weak"), ("unknown", "unknown", "strong")
    rows = [
        board_row("a", [], "none"), board_row("b", [], "unknown"), board_row("c", [wind], "wind_steady"),
        board_row("d", [wind], "none"), board_row("e", [odd], "unknown"), board_row("f", [odd], "wind_steady"),
        board_row("g", [wind, ("current", "current", "weak"), ("trim_change", "ship condition", "weak")], "current",
                  all_right=True, channels="no_log"),
        board_row("h", [wind, ("current", "current", "weak")], "current", both_right=False, all_right=False),
    ]  # fmt: skip
    board = scoreboard(rows)
    found = {n: (t["right"], t["count"]) for n, t in board["totals"].items() if isinstance(t, dict)}
    assert found == {
        "answered": (8, 8), "false alarms": (1, 2), "detection": (5, 6), "first name": (4, 6),
        "first name, listed effects": (3, 4), "first two names": (4, 6), "both names of pairs": (0, 1),
        "all names of triples": (1, 1), "family right": (4, 6), "place": (9, 9), "unknown found": (1, 2),
        "unknown said rightly": (1, 2), "unknown wrongly said": (1, 6), "predictions made worse": (0, 8),
    }  # fmt: skip
    assert (board["by_family"]["wind and waves"]["effects"], board["by_family"]["unknown"]["named"]["right"]) == (4, 1)
    assert {s: part["detection"]["count"] for s, part in board["by_strength"].items()} == {"weak": 4, "strong": 2}
    assert board["by_channels"]["no_log"]["first name"]["count"] == 1 and board["by_channels"]["full"]["effects"] == 6
    assert board["confusion"]["none"] == {"none": 1, "unknown": 1}
    assert board["confusion"]["current + trim_change + wind_steady"] == {"current": 1}
    assert board["confusion"]["wind_steady"] == {"wind_steady": 1, "none": 1} and board["notes"] == {}
    label_losses(rows, [*rows[:3], rows[2], *rows[4:]])
    assert [row["loss"] for row in rows] == [None, "limit", None, "defect", None, "limit", None, None]
    assert scoreboard(rows)["totals"]["of the losses, limits"]["right"] == 2
    text = markdown({"tool": board})
    assert "| false alarms | 50% [9%, 91%] 1/2 |" in text and "| cases | 8 |" in text
