"""Scoring, with answers made by hand."""

import json
from dataclasses import replace

import numpy as np
import pytest
from tiers import only

from manoeuvre_nn.commands.groups import option
from manoeuvre_nn.commands.shelves import build
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.diagnosis.answers import _place
from manoeuvre_nn.ship.mariner import mariner
from studies.concealed_trial import true_model
from studies.concealed_trial.case import TrialCase
from studies.concealed_trial.effects import KINDS, NOISE
from studies.concealed_trial.helm import Run
from studies.concealed_trial.record import write_case
from studies.concealed_trial.score import main, overlap, parameter_marks, probabilities, score_case
from studies.concealed_trial.scoreboard import markdown, scoreboard
from studies.concealed_trial.ships import trial_ships
from studies.concealed_trial.summaries import calibration, wilson
from studies.concealed_trial.truth import ConcealedEffect

RUNS = (
    Run("r01", "fit", "tc20", "port", 10.0, 100),
    Run("r02", "held_out", "zz20", "starboard", 80.0, 260),
    Run("r03", "held_out", "tc20", "starboard", 200.0, 220),
)
INTERVALS = {"r01": [[70, 90]], "r02": [[100, 180]], "r03": [[90, 170]]}
EFFECTS = {
    "clean": (),
    "offset": (ConcealedEffect("rudder_offset", {"offset_deg": 3.0}),),
    "pair": (
        ConcealedEffect("current", {"speed": 1.0, "toward_deg": 355.0}),
        ConcealedEffect("side_force", {"force_kN": 900.0, "lever_m": 20.0}, INTERVALS),
    ),
}


def case_with(name):
    effects = EFFECTS[name]
    return TrialCase(
        name=f"c_{name}",
        ship=trial_ships()["mariner"],
        runs=RUNS,
        effects=effects,
        measures=(0.3,) * len(effects),
        coefficient_sd=0.0,
        cubic=("Yvrd", 0.0),
        model_error_size=0.0,
        noise=dict(NOISE),
        latency=0.2,
        outliers=0.003,
        chance=5,
        salt="salt",
    )


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    folder = tmp_path_factory.mktemp("set")
    for name in EFFECTS:
        case = case_with(name)
        write_case(case, folder / case.name, 0.5)
        (folder / case.name / "answers.json").write_text(json.dumps(case.answers()))
    return folder


def truth_of(name):
    return json.loads(json.dumps(case_with(name).answers()))


def perfect(truth):
    entries = [
        {
            "name": effect["name"],
            "probability": 1.0,
            "equation": effect["equation"],
            "intervals": effect["intervals"],
            "parameters": {k: [v, 0.01 * abs(v), ""] for k, v in effect["parameters"].items()},
        }
        for effect in truth["effects"]
    ]
    return {"case": truth["case"], "verdict": truth["verdict"], "effects": entries}


def put(folder, answer, recordings=None, after=()):
    """Write an answer, with predictions of the calm-water model and of some effects."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "answer.json").write_text(json.dumps(answer))
    for which, effects in (("before", ()), ("after", after)) if recordings else ():
        (folder / "predictions" / which).mkdir(parents=True)
        for run, table in true_model.predictions(recordings, effects).items():
            table.to_csv(folder / "predictions" / which / f"{run}.csv", index=False)


@pytest.mark.parametrize("name", only({"clean", "pair"}, EFFECTS))
def test_a_perfect_answer_gets_full_marks(name, recordings, tmp_path):
    truth, case = truth_of(name), recordings / f"c_{name}"
    put(tmp_path, perfect(truth), case, EFFECTS[name])
    row = score_case(case, tmp_path, truth)
    assert row["answered"]
    assert row["brier"] == 0
    if name == "clean":
        assert row["false_alarm"] is False
        assert row["detected"] is row["first_right"] is row["share"] is None
        assert row["j_after"] < 1.2
        return
    assert row["detected"] and row["first_right"] and row["family_right"]
    assert row["both_right"] is (True if name == "pair" else None)
    assert all(effect["named"] and effect["place_right"] for effect in row["effects"])
    assert all(p["right"] and p["covered"] for effect in row["effects"] for p in effect["parameters"])
    assert row["share"] == pytest.approx(1.0)
    assert row["harmed"] is False
    assert row["j_true_model"] < 1.2 < 3 < row["j_before"]
    if name == "pair":
        assert [effect["overlap"] for effect in row["effects"]] == [None, 1.0]


@pytest.mark.parametrize("name", EFFECTS)
def test_no_answer_counts_as_none(name, recordings, tmp_path):
    row = score_case(recordings / f"c_{name}", tmp_path, truth_of(name))
    assert not row["answered"]
    assert row["verdict"] == row["first"] == "none"
    assert row["brier"] == len(EFFECTS[name])
    assert row["detected"] in {None, False}
    assert row["share"] is None


def test_a_wrong_answer_gets_nothing(recordings, tmp_path):
    effects = [{"name": "log_scale", "probability": 0.9, "equation": "sensor:u_log", "intervals": "all"}]
    answer = {"verdict": "mismatch", "effects": [{"name": "unknown", "probability": 0.9}, *effects]}
    put(tmp_path, answer, recordings / "c_pair", [ConcealedEffect("current", {"speed": 1.0, "toward_deg": 175.0})])
    row = score_case(recordings / "c_pair", tmp_path, truth_of("pair"))
    assert row["detected"]
    assert not row["first_right"] and not row["both_right"] and not row["family_right"]
    assert not any(effect["named"] or effect["place_right"] for effect in row["effects"])
    assert row["share"] < 0
    assert row["harmed"]
    assert row["brier"] == pytest.approx(2 + 2 * 0.81)
    false_alarm = score_case(recordings / "c_clean", tmp_path, truth_of("clean"))
    assert false_alarm["false_alarm"]


def test_a_name_that_cannot_be_told_apart_counts_as_equal(recordings, tmp_path):
    entry = {"name": "propeller_side_force", "probability": 0.7, "equation": ["Y", "N"], "parameters": {}}
    put(tmp_path, {"verdict": "mismatch", "effects": [entry, {"name": "rudder_offset", "probability": 0.2}]})
    row = score_case(recordings / "c_offset", tmp_path, truth_of("offset"))
    assert row["first_right"] and row["family_right"] and row["both_right"] is None
    assert row["effects"][0]["place_right"]
    assert row["brier"] == pytest.approx(0.01)


def test_a_verdict_of_none_hides_what_is_listed(recordings, tmp_path):
    put(tmp_path, perfect(truth_of("offset")) | {"verdict": "none"})
    row = score_case(recordings / "c_offset", tmp_path, truth_of("offset"))
    assert row["detected"] is False
    assert row["first"] == "none"
    assert not row["first_right"] and not row["effects"][0]["named"]


def test_an_answer_that_is_not_json_counts_as_none(recordings, tmp_path):
    (tmp_path / "answer.json").write_text("{")
    row = score_case(recordings / "c_offset", tmp_path, truth_of("offset"))
    assert not row["answered"]
    assert "cannot be read" in row["note"]


def test_predictions_of_other_lengths_do_not_count(recordings, tmp_path):
    put(tmp_path, perfect(truth_of("offset")), recordings / "c_offset", EFFECTS["offset"])
    path = tmp_path / "predictions" / "after" / "r02.csv"
    path.write_text("\n".join(path.read_text().splitlines()[:50]))
    row = score_case(recordings / "c_offset", tmp_path, truth_of("offset"))
    assert row["j_after"] is row["share"] is None


@pytest.mark.parametrize(
    ("name", "true", "given", "right", "covered"),
    [
        ("speed", 10.0, [10.9, 0.1, "m/s"], True, False),
        ("speed", 10.0, [11.5, 0.8, "m/s"], True, True),
        ("speed", 10.0, [11.5, None, "m/s"], False, None),
        ("from_deg", 355.0, [4.0, 1.0, "deg"], True, False),
        ("from_deg", 5.0, [340.0, 15.0, "deg"], True, True),
        ("from_deg", 5.0, [340.0, 5.0, "deg"], False, False),
        ("bias_deg", -2.0, [2.0, 0.1, "deg"], False, False),
        ("speed", 10.0, None, False, None),
    ],
)
def test_a_parameter_is_right_within_a_tenth_or_two_standard_errors(name, true, given, right, covered):
    marks = parameter_marks(name, true, given)
    assert (marks["right"], marks["covered"]) == (right, covered)


def test_overlap_is_intersection_over_union_of_all_runs():
    manifest = {"runs": [{"run": "r01", "duration_s": 100}, {"run": "r02", "duration_s": 100}]}
    true = {"r01": [[10, 30]], "r02": [[50, 70]]}
    assert overlap(true, true, manifest) == 1.0
    assert overlap(true, {"r01": [[20, 40]], "r02": [[50, 70]]}, manifest) == pytest.approx(30 / 50)
    assert overlap(true, "all", manifest) == pytest.approx(40 / 200)
    assert overlap(true, {}, manifest) == 0.0


def test_errors_are_those_of_a_shifted_prediction(recordings):
    case = recordings / "c_clean"
    exact = true_model.predictions(case, [])
    plain, worse = (
        true_model.rmse(case, exact),
        {k: t.assign(x=t["x"] + 300.0, psi=t["psi"] + 357.0) for k, t in exact.items()},
    )
    shifted = true_model.rmse(case, worse)
    assert shifted["pos"] == pytest.approx(300.0, rel=0.02)
    assert shifted["psi"] == pytest.approx(3.0, rel=0.1)
    assert shifted["u"] == plain["u"]
    scale = true_model.scales(trial_ships()["mariner"])
    by_hand = np.sqrt(np.mean([(plain[c] / scale[c]) ** 2 for c in scale]))
    assert true_model.total(trial_ships()["mariner"], plain) == pytest.approx(by_hand)


def test_an_effect_from_elsewhere_that_is_unknown_here_has_no_true_model(recordings):
    truth = truth_of("offset")
    truth["effects"][0] |= {"name": "unknown", "detail": "something_else"}
    assert true_model.effects_of(truth) is None
    row = score_case(recordings / "c_offset", recordings / "nowhere", truth)
    assert row["j_true_model"] is row["share"] is None
    assert row["j_before"] > 1


def test_wilson_intervals_are_the_known_ones():
    assert wilson(0, 0) == (0.0, 1.0)
    np.testing.assert_allclose(wilson(0, 10), (0.0, 0.2775), atol=1e-4)
    np.testing.assert_allclose(wilson(8, 10), (0.4902, 0.9433), atol=1e-4)


def test_calibration_counts_what_was_said_and_found():
    bins = calibration([(0.0, 0), (0.25, 1), (0.21, 0), (1.0, 1)])
    assert [(b["from"], b["count"], b["found"]) for b in bins] == [(0.2, 2, 0.5), (0.9, 1, 1.0)]
    assert bins[0]["said"] == pytest.approx(0.23)
    assert calibration([]) == []


def test_rivals_that_count_as_equal_share_their_probability():
    answer = {"effects": [{"name": "rudder_offset", "probability": 0.4}, {"name": "side_force", "probability": 0.3}]}
    both = probabilities(answer, [{"name": "bow_thruster", "equivalent_names": ["side_force"]}])
    assert both["bow_thruster"] == (0.3, 1)
    assert both["rudder_offset"] == (0.4, 0)
    assert "side_force" not in both


def test_the_scoreboard_of_the_command_line_adds_up(recordings, tmp_path, capsys):
    for name in EFFECTS:
        put(tmp_path / f"c_{name}", perfect(truth_of(name)))
    main([f"recordings={recordings}", f"out={tmp_path}"])
    board = json.loads((tmp_path / "scoreboard.json").read_text())["board"]
    totals = board["totals"]
    assert (totals["false alarms"]["right"], totals["false alarms"]["count"]) == (0, 1)
    assert (totals["detection"]["right"], totals["first name"]["count"]) == (2, 2)
    assert board["by_family"]["current"]["named"]["right"] == 1
    assert board["confusion"]["current + side_force"] == {"current": 1}
    assert "| first name | 100% [34%, 100%] 2/2 |" in capsys.readouterr().out
    assert (tmp_path / "scoreboard.md").is_file()


def test_boards_of_two_tools_stand_side_by_side(recordings, tmp_path):
    rows = [score_case(recordings / f"c_{name}", tmp_path, truth_of(name)) for name in EFFECTS]
    text = markdown({"one": scoreboard(rows), "other": scoreboard(rows[:1])})
    assert "| score | one | other |" in text
    assert "| cases | 3 | 1 |" in text


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "write recordings=DIR out=DIR"),
        (["recordings=nowhere", "out=."], "holds no case"),
        (["recordings={set}", "out=nowhere"], "does not exist"),
    ],
)
def test_a_wrong_argument_ends_in_one_line(recordings, arguments, message):
    with pytest.raises(InputError, match=message):
        main([argument.format(set=recordings) for argument in arguments])


def test_a_case_with_measures_publishes_them():
    case = replace(case_with("offset"), measures=(0.31234,))
    assert case.answers()["effects"][0]["measure"] == 0.312


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_where_an_effect_is_said_to_act_is_a_place_that_counts_as_right(kind):
    """A name without its place would be a miss, and one too much, whatever the recordings show."""
    effect = build(option("effect", kind.name), "effect", ship=mariner())
    assert {_place(e) for e in effect.equations} in [set(accepted) for accepted in kind.accepted]
