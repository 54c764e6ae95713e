"""What a model may be used for: a useless one does not look fine."""

from dataclasses import replace

import numpy as np
import pytest

from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.scoring.score import Score
from manoeuvre_nn.scoring.verdict import CLOSER, MAX_DEV_L, model_verdict, response_verdict

TIME = np.arange(5.0)
RUNS = [
    Recording(
        name,
        TIME,
        {
            "u": speed - 0.2 * TIME,
            "v": 0.1 * TIME,
            "r": 0.01 * TIME,
            "delta": np.array([0, -1, 1, np.nan, 0.5]) * angle * DEGREE,
        },
    )
    for name, speed, angle in (("zz20", 7.0, 20.0), ("tc35", 8.0, 35.0))
]


def scores(*devs, **more):
    return [Score(run.name, "ok", dev, {}, **more) for run, dev in zip(RUNS, devs, strict=True)]


def judged(own, **baselines):
    return model_verdict(own, RUNS, baselines)


def test_a_model_that_predicts_every_manoeuvre_is_usable_for_what_they_cover():
    found = judged(scores(MAX_DEV_L, 0.01))
    assert found.word == "usable" and found.predicted == ("zz20", "tc35") and found.missed == {}
    assert found.sentence == (
        "Usable for manoeuvres like zz20, tc35, rudder to 35 deg, 6.2 to 8 m/s: each is within 0.5 L."
    )


def test_a_network_twenty_lengths_off_beside_terms_that_are_closer_is_not_to_be_used():
    found = judged(scores(20.0, 0.2), linear=scores(30.0, 9.0), terms=scores(1.4, 1.4))
    assert found.word == "do not use" and found.missed == {"zz20": "is 20 L off"}
    assert found.sentence == (
        "Do not use: zz20 is 20 L off; the simpler model 'terms' is closer: 1.4 L in the mean, this one 10 L."
    )


def test_a_model_that_misses_one_manoeuvre_is_doubtful():
    found = judged(scores(0.6, 0.1), linear=scores(0.5, 0.1))
    assert (found.word, found.predicted) == ("doubtful", ("tc35",))
    assert found.sentence == "Doubtful: tc35 within 0.5 L; but zz20 is 0.6 L off."


def test_a_model_that_misses_all_is_not_to_be_used():
    assert judged(scores(0.51, 0.52)).word == "do not use"


def test_one_that_breaks_down_anywhere_is_not_to_be_used():
    own = scores(0.1, 0.1)
    own[1] = replace(own[1], status="left the physical range at 30 s")
    found = judged(own)
    assert found.word == "do not use" and found.sentence == "Do not use: tc35 left the physical range at 30 s."


def scaled(run, **by):
    return replace(run, channels=run.channels | {name: factor * run[name] for name, factor in by.items()})


@pytest.mark.parametrize(
    ("by", "told"),
    [({"delta": 0.6}, "rudder"), ({"r": 0.8}, "rate of turn"), ({"v": 0.8, "u": 1.35}, "sway, speed"),
     ({"u": 0.8}, "speed"), ({"delta": 0.95, "r": 0.95, "v": 0.95, "u": 1.05}, ""), ({"delta": 2.0, "r": -3.0}, "")],
)  # fmt: skip
def test_what_left_the_range_of_the_training_data_is_told(by, told):
    trained = [scaled(run, **by) for run in RUNS]
    close, off = (model_verdict(scores(0.1, dev), RUNS, {}, trained) for dev in (0.1, 20.0))
    assert (f"tc35 beyond the training data in {told})" if told else "") in close.sentence and close.word == "usable"
    assert off.missed == {"tc35": "is 20 L off" + (f" (beyond the training data in {told})" if told else "")}
    assert ("beyond" in close.sentence) == ("beyond" in off.sentence) == bool(told)


def test_the_range_is_that_of_all_training_data_together():
    found = model_verdict(scores(0.1, 0.1), RUNS, {}, [RUNS[0], scaled(RUNS[1], delta=0.5)])
    assert "tc35 beyond the training data in rudder)" in found.sentence and "zz20 beyond" not in found.sentence
    assert "beyond" not in model_verdict(scores(0.1, 0.1), RUNS, {}, RUNS).sentence


@pytest.mark.parametrize("dev", [np.nan, np.inf])
def test_a_deviation_that_is_no_number_is_a_miss(dev):
    assert judged(scores(dev, dev)).word == "do not use"


def test_what_the_members_leave_open_is_not_predicted():
    assert judged(scores(0.01, 0.01, spread_L=MAX_DEV_L)).word == "usable"
    found = judged(scores(0.01, 0.01, spread_L=0.7))
    assert found.word == "do not use" and found.missed["zz20"] == "is left open by the data (members 0.7 L apart)"


def test_a_simpler_model_must_be_clearly_closer_and_sail_all_manoeuvres():
    own = scores(0.6, 0.2)
    near, closer = scores(0.6 / CLOSER + 0.01, 0.2 / CLOSER), scores(0.6 / CLOSER - 0.01, 0.2 / CLOSER)
    assert judged(own, near=near).word == "doubtful"
    assert judged(own, closer=closer).word == "do not use"
    lost = [replace(s, status="left the physical range at 30 s") for s in closer]
    assert judged(own, lost=lost).word == "doubtful"


@pytest.mark.parametrize(("dev", "told"), [(0.45, True), (0.06, True), (0.04, False)])
def test_a_simpler_model_that_is_closer_is_named_where_both_are_good_enough(dev, told):
    found = judged(scores(dev, dev), linear=scores(0.01, 0.01), taylor=scores(0.02, 0.02))
    assert found.word == "usable" and ("simpler model 'linear' is closer: 0.01 L" in found.sentence) is told
    assert judged(scores(dev, dev), linear=scores(0.6 * dev, 0.6 * dev)).sentence.endswith("each is within 0.5 L.")


def test_no_criterion_is_judged_by_a_model_that_is_not_to_be_used():
    """The criteria of the one that was missed, and all of the one that was predicted, may be right by chance."""
    first, second = zigzags(20.0)
    found = judged([first, replace(second, dev_L=0.2)], terms=scores(1.4, 1.4))
    assert found.criteria == ("zz20", "tc35")
    assert found.unfit == {"zz20": "is 20 L off", "tc35": "is not to be used"}


def test_many_manoeuvres_are_not_all_named():
    runs = [replace(RUNS[0], name=f"run {k}") for k in range(7)]
    found = model_verdict([Score(run.name, "ok", 3.0, {}) for run in runs], runs)
    assert found.sentence.endswith("run 3 is 3 L off and 3 more.") and len(found.missed) == 7


def test_scores_hold_it_in_plain_words():
    told = judged(scores(0.6, 0.1)).as_dict()
    assert told == {
        "word": "doubtful",
        "sentence": "Doubtful: tc35 within 0.5 L; but zz20 is 0.6 L off.",
        "predicted": ["tc35"],
        "criteria": [],
        "missed": {"zz20": "is 0.6 L off"},
    }


RECORDED = {"overshoot_1_deg": 9.0, "overshoot_2_deg": 30.0, "overshoot_3_deg": 9.0, "period_s": 50.0}


def zigzags(dev, **wrong):
    """Two zigzags whose tracks are off by as much, the criteria of the first by what is named."""
    good = Score("zz20", "ok", dev, {}, RECORDED, RECORDED)
    return [
        replace(good, criteria=RECORDED | {k: RECORDED[k] + e for k, e in wrong.items()}),
        replace(good, manoeuvre="tc35"),
    ]


@pytest.mark.parametrize("wrong, close", [
    ({"overshoot_1_deg": 1.9}, True), ({"overshoot_1_deg": -2.1}, False), ({"overshoot_2_deg": 2.9}, True),
    ({"overshoot_2_deg": 3.1}, False), ({"period_s": 4.9}, True), ({"period_s": -5.1}, False),
    ({"overshoot_3_deg": 9.0}, True),
])  # fmt: skip
def test_criteria_count_for_themselves_where_tracks_run_away(wrong, close):
    found = judged(zigzags(9.0, **wrong))
    assert found.word == ("usable" if close else "doubtful")
    assert found.predicted == () and found.criteria == (("zz20", "tc35") if close else ("tc35",))
    assert found.unfit == ({} if close else {"zz20": "is 9 L off"})
    said = "not for tracks: all criteria are" if close else "criteria of 1 of 2 manoeuvres"
    assert f"{said} within 10 %, overshoots 2 deg; but zz20 is 9 L off, tc35 is 9 L off." in found.sentence


@pytest.mark.parametrize(("off", "close"), [(0.4, True), (0.6, False), (np.inf, False)])
def test_criteria_that_the_members_leave_open_are_not_predicted(off, close):
    circle = {"advance_L": 3.1, "tactical_diameter_L": 5.0}
    apart = {"spread_L": 2.5, "spread_criteria": {"advance_L": 0.1, "tactical_diameter_L": off}}
    found = judged([Score(run.name, "ok", 1.4, {}, circle, circle, **apart) for run in RUNS])
    assert found.word == ("usable" if close else "do not use")
    assert bool(found.unfit) is not close


def test_a_criterion_that_was_not_reached_is_not_predicted():
    first, second = zigzags(9.0)
    short = replace(first, criteria={k: v for k, v in RECORDED.items() if k != "period_s"})
    assert judged([short, second]).criteria == ("tc35",)
    assert judged([replace(s, criteria={}) for s in zigzags(9.0)]).word == "do not use"


def test_criteria_do_not_make_up_for_a_simpler_model_that_is_closer():
    assert judged(zigzags(9.0), terms=scores(1.0, 1.0)).word == "do not use"


@pytest.mark.parametrize(
    ("errors", "linear", "word", "told"),
    [
        ({"testing": 0.02, "between": 0.099}, {"testing": 0.5, "between": 0.5}, "usable", "Usable within the ranges"),
        ({"testing": 0.02, "between": 0.11}, {"testing": 0.5, "between": 0.5}, "doubtful", "between: is off by 11 %"),
        ({"testing": 0.2, "between": 0.3}, {"testing": 0.5, "between": 0.5}, "do not use", "testing: is off by 20 %"),
        (
            {"testing": 0.02, "between": 0.3},
            {"testing": 0.5, "between": 0.29},
            "do not use",
            "a linear function is closer (between: 0.29)",
        ),
        ({"testing": 0.02}, {"testing": 0.5}, "usable", "Usable within the ranges"),
        ({}, {}, "doubtful", "no record was kept to test it"),
        ({"testing": np.nan}, {"testing": 0.5}, "do not use", "Do not use"),
    ],
)
def test_a_response_is_judged_by_records_that_were_not_learnt(errors, linear, word, told):
    found = response_verdict(errors, {name: 1.0 for name in errors}, linear, "the network is off by 0.1 deg")
    assert found.word == word and told in found.sentence and "the network is off by 0.1 deg" in found.sentence
    assert set(found.predicted) | set(found.missed) == set(errors)


def test_of_records_that_are_all_alike_nothing_is_explained():
    assert response_verdict({"testing": 0.0}, {"testing": 0.0}, {"testing": 0.0}, "exact").word == "do not use"


@pytest.mark.parametrize("worst, told", [(0.2, True), (0.12, False)])
def test_of_a_usable_model_a_simpler_one_is_told_from_a_twentieth_of_a_length_in_the_mean_on(worst, told):
    """Not in the median: one manoeuvre that is off is what a simpler model would mend."""
    runs = [*RUNS, replace(RUNS[0], name="zz10")]
    devs = dict(zip([run.name for run in runs], (0.01, 0.01, worst), strict=True))
    own = [Score(name, "ok", dev, {}) for name, dev in devs.items()]
    found = model_verdict(own, runs, {"terms": [replace(s, dev_L=s.dev_L / (2 * CLOSER)) for s in own]})
    assert found.word == "usable" and ("simpler model 'terms'" in found.sentence) == told
