"""Each threshold, prior and veto of the diagnosis by what is decided a little below it and a little above it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from pytest import approx
from searches import EFFECTS, fitted, found
from trials import SHIP, values

from manoeuvre_nn.diagnosis import checks
from manoeuvre_nn.diagnosis import decision as under_test
from manoeuvre_nn.diagnosis.decision import (
    PRIOR_NONE,
    PRIOR_OF_SIZE,
    PRIOR_UNKNOWN,
    Decision,
)
from manoeuvre_nn.diagnosis.fits import PUBLISHED_SD_LEVEL
from manoeuvre_nn.diagnosis.predictive import REPAIRED_SAILS
from manoeuvre_nn.diagnosis.result import RIGHT_SHIP, Check
from manoeuvre_nn.diagnosis.search import worth_its_size
from manoeuvre_nn.diagnosis.unknown import ReceiverWander
from manoeuvre_nn.effect.current import TidalCurrent
from manoeuvre_nn.effect.formula import BY_RUN, Formula, library, mark_of
from manoeuvre_nn.effect.roll import RollCoupling
from manoeuvre_nn.effect.rudder import RudderOffset
from manoeuvre_nn.estimation.data_set import COEFFICIENT_SD_LEVELS
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis, Hypothesis

pytestmark = pytest.mark.usefixtures("unchecked_types")


# What is put to the proof ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("names, prior", [
    (("current",), 0.53 / 4), (("current", "log_scale"), 0.10 / 6), (("current", "log_scale", "heading_bias"), 0.02 / 4)
])  # fmt: skip
@pytest.mark.parametrize("more, likelier", [(-0.1, False), (0.1, True)])
def test_what_is_likelier_than_calm_water_by_its_base_rate_is_put_to_the_proof(names, prior, more, likelier):
    """Of four effects there are six pairs and four triples; calm water is the case once in four."""
    result = found(*[fitted(-9.0, name) for name in EFFECTS], none=-3.0)
    least = float(np.log(0.25 / prior))
    assert len(EFFECTS) == 4
    assert under_test.likelier_than_calm_water(result, fitted(least + more - 3.0, *names)) is likelier


# The decision --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("effects", [3, 25])
def test_base_rates_of_everything_that_can_be_the_case_sum_to_one(effects):
    """Every effect, pair and triple of a shelf, calm water and something unknown, all with the same evidence."""
    counts = [effects, effects * (effects - 1) // 2, effects * (effects - 1) * (effects - 2) // 6]
    every = [SimpleNamespace(names=("x",) * size, evidence=0.0) for size, n in enumerate(counts, 1) for _ in range(n)]
    weights = np.exp(under_test._log_weights(0.0, 0.0, every, effects))
    assert weights.sum() == approx(1.0) and len(weights) == 2 + sum(counts)
    of_size = [weights[2 + sum(counts[:k]) :][:n].sum() for k, n in enumerate(counts)]
    assert of_size == approx(list(PRIOR_OF_SIZE)) and weights[:2] == approx([PRIOR_NONE, PRIOR_UNKNOWN])


def test_calm_water_and_one_effect_are_likelier_than_several_and_than_something_unknown():
    one, two, three = PRIOR_OF_SIZE
    assert one > 0.5 > PRIOR_NONE > PRIOR_UNKNOWN > three and two > 4 * three


@pytest.fixture
def decided(monkeypatch):
    """Decides on log Bayes factors over calm water, those of something unknown and of its formula among them."""

    def run(gains: dict, unmodelled=-9.0, rule=None, lacked=None, wandering=(-np.inf,) * 2, loose=-9.0,
            seen_unknown=-np.inf) -> Decision:  # fmt: skip
        calm, named = wandering  # seen by a receiver that wanders: calm water, and the best hypothesis with a name
        monkeypatch.setattr(under_test, "beside", lambda likelihood, hypothesis: likelihood)
        monkeypatch.setattr(under_test, "gain_by_coefficient_priors", lambda data_set, j: 0.0)
        monkeypatch.setattr(under_test, "short_formula", lambda there, none: rule)
        monkeypatch.setattr(under_test, "random_force", lambda there, none: None)
        told = lambda there, none, formula, *_: (unmodelled if formula or rule is None else loose) - 3.0  # noqa: E731
        monkeypatch.setattr(under_test, "unknown_evidence", told)
        wanders = lambda there, j: ReceiverWander(1.0, 60.0, (named if j.names else calm) - 3.0)  # noqa: E731
        monkeypatch.setattr(under_test, "receiver_wander", wanders)
        monkeypatch.setattr(under_test, "unknown_by_receiver", lambda there, none: seen_unknown - 3.0)
        monkeypatch.setattr(under_test, "is_fitted", lambda dynamics: lacked is not None)
        made = sorted((fitted(g - 3.0, *n.split(" + ")) for n, g in gains.items()), key=lambda j: -j.evidence)
        result = found(*made, levels=[(0.001, lacked or 0.0)], none=-3.0)
        result.likelihood.data_set.dynamics = None  # type: ignore[assignment]
        return under_test.decide(result)

    return run


def test_a_receiver_that_wanders_is_calm_water_before_anything_is_unknown(decided):
    """Half of calm water has such a receiver. An effect that is likelier with such a receiver, too, stays."""
    unknown, explained, nearly = (decided({}, unmodelled=20.0, wandering=(w, 0.0)) for w in (-np.inf, 40.0, 13.6))
    assert unknown.strange and not explained.strange and explained.none >= 0.6
    assert explained.unmodelled == approx(20.0 - 40.0 + np.log(2))
    assert nearly.strange and not decided({}, unmodelled=20.0, wandering=(13.8, 0.0)).strange, "less than 7 more"
    for named, stays in ((38.7, True), (38.4, False)):  # 40 less log 2; one effect acts twice as often as none
        found_there = decided({"current": 30.0}, unmodelled=20.0, wandering=(40.0, named))
        assert found_there.named == stays and not found_there.strange, "if the name is refuted, nothing is unknown"
    assert decided({"current": 50.0}, unmodelled=20.0, wandering=(40.0, 0.0)).named, "likelier even without"


def test_something_unknown_is_seen_by_a_receiver_that_wanders_as_often_as_calm_water(decided):
    """Half of it: what calm water gains by that, it gains too, and then leads a name that gains less."""
    how = {"unmodelled": 20.0, "wandering": (40.0, 50.0)}
    without, less, with_it = (decided({"current": 30.0}, seen_unknown=seen, **how) for seen in (-np.inf, 48.0, 80.0))
    assert without.named and not without.strange and without.unknown < 0.01
    assert less.strange and less.named and less.unknown < 0.1, "the name gains by such a receiver, too"
    assert with_it.strange and with_it.unknown > 0.99 and with_it.unmodelled == approx(80.0 - 40.0)
    assert not decided({}, seen_unknown=46.0, unmodelled=20.0, wandering=(40.0, 0.0)).strange, "less than 7 more"


def test_calm_water_keeps_six_of_ten_if_it_is_likeliest_and_no_more_than_four_if_something_unknown_acts(decided):
    quiet, strange = decided(dict.fromkeys(EFFECTS, 0.6)), decided({"current": -9.0}, unmodelled=-9.0, lacked=0.2)
    assert (quiet.named, quiet.strange, strange.strange) == (False, False, True)
    assert quiet.none == approx(0.6, abs=0.03) and strange.none == approx(0.4, abs=0.03)
    for d in (quiet, strange):
        assert d.none + d.unknown + sum(d.effects.values()) == approx(1.0)


def test_where_held_out_runs_make_calm_water_likelier_nothing_is_left_of_what_was_best(decided):
    before = decided({"current": 3.0})
    after = before.with_calm_water()
    assert before.named and before.none < 0.1 and not after.named and after.none == approx(0.6, abs=0.03)
    assert after.none + after.unknown + sum(after.effects.values()) == approx(1.0)
    assert after.effects["current"] < 0.5 and decided({"current": -9.0}).with_calm_water().none > 0.6


def test_beside_a_fitted_model_no_formula_makes_something_unknown_likelier(decided):
    """Its errors are taken up by one: what is unknown is weighed without it, and rests on none."""
    published, fitted_model = (decided({}, 20.0, fitted(17.0, "current"), lacked) for lacked in (None, 0.2))
    assert (published.unmodelled, fitted_model.unmodelled) == (20.0, -9.0)
    assert published.without_rule == -9.0 and fitted_model.without_rule > 1e9


@pytest.mark.parametrize("unmodelled, strange", [(6.8, False), (7.2, True)])
def test_something_unknown_is_told_from_seven_on(decided, unmodelled, strange):
    assert decided({"current": -1.0}, unmodelled).strange is strange


@pytest.mark.parametrize("lacked, strange", [(0.096, False), (0.104, True)])
def test_a_fitted_model_may_lack_a_tenth_of_its_forces(decided, lacked, strange):
    d = decided({"current": -1.0}, lacked=lacked)
    assert d.strange is strange
    assert not decided({"current": -1.0}).strange, "a published model has no such bound"


def test_what_is_unknown_leads_by_its_odds_a_name_that_is_likelier_than_calm_water_too(decided):
    assert decided({"current": 20.0}, unmodelled=24.0).lead == approx(4.0 + np.log(PRIOR_UNKNOWN / PRIOR_OF_SIZE[0]))
    assert decided({"current": 24.0}, unmodelled=20.0).lead == 0.0, "the name leads"
    assert decided({"current": -1.0}, unmodelled=24.0).lead == 0.0, "calm water is likelier than the name"


CLAIMED = [
    ({"current": 20.0, "log_scale": 1.0}, -9.0, None, [("current",)]),
    ({"current": 20.0}, 24.0, None, []),  # something unknown is likelier by far
    ({"current": 20.0}, -9.0, 6.8, [("current",)]),
    ({"current": 20.0}, -9.0, 7.2, [("current",), ("formula",)]),
    ({"current": -1.0}, 8.0, 2.0, [("formula",)]),
    ({"current": -1.0}, 2.0, 2.0, []),
    ({"current + log_scale": 40.0, "current": 20.0, "log_scale": 9.0, "heading_bias": 30.0}, -9.0, None,
     [("current", "log_scale"), ("current",)]),
    ({"current + log_scale + heading_bias": 70.0, "log_scale + heading_bias": 45.0, "current + log_scale": 42.0,
      "current + heading_bias": 30.0, "current": 20.0, "heading_bias": 21.0, "rudder_offset": 30.0}, -9.0, None,
     [("current", "log_scale", "heading_bias"), ("log_scale", "heading_bias"), ("current", "log_scale"),
      ("current", "heading_bias"), ("heading_bias",)]),
    # One effect more that two effects' base rates make likelier, though its gain may be chance, is asked first.
    ({"current + log_scale": 25.9, "current": 20.0}, -9.0, None, [("current", "log_scale"), ("current",)]),
    ({"current + log_scale": 21.1, "current": 20.0}, -9.0, None, [("current", "log_scale"), ("current",)]),
    ({"current + log_scale": 20.8, "current": 20.0}, -9.0, None, [("current",)]),
    # A rival is put to the proof beside its best part; what its last effect adds by chance is no rival.
    ({"log_scale + heading_bias": 44.4, "heading_bias": 31.0, "current + rudder_offset": 44.0, "current": 37.8}, -9.0,
     None, [("log_scale", "heading_bias"), ("current", "rudder_offset"), ("heading_bias",), ("current",)]),
    ({"log_scale + heading_bias": 44.4, "heading_bias": 31.0, "current + rudder_offset": 44.0, "current": 38.1}, -9.0,
     None, [("log_scale", "heading_bias"), ("heading_bias",)]),
]  # fmt: skip


@pytest.mark.parametrize("gains, unmodelled, rule, claims", CLAIMED)
def test_claims_are_the_best_effects_rivals_then_the_better_of_them_alone_then_a_formula(
    decided, gains, unmodelled, rule, claims
):
    made = None if rule is None else replace(fitted(rule - 3.0), hypothesis=SimpleNamespace(names=("formula",)))
    assert [c.names for c in decided(gains, unmodelled, made).claims] == claims


TOLD = [  # named, strange, proved, what, probability before -> after
    (True, False, ("current",), "current", 0.9, 0.9),
    (True, False, (), "current", 0.9, 0.49),
    (True, False, (), "current", 0.3, 0.3),
    (False, True, (), "current", 0.9, 0.49),
    (False, False, (), "current", 0.3, 0.3),
    (False, False, ("current",), "current", 0.3, 0.6),  # proved although calm water was likelier
    (False, False, ("current",), "current", 0.8, 0.8),
    (True, False, ("formula",), "unknown", 0.3, 0.6),
    (True, False, ("current",), "unknown", 0.3, 0.3),
    (True, False, ("current",), "unknown", 0.7, 0.49),
    (False, True, (), "unknown", 0.3, 0.6),
    (False, True, (), "unknown", 0.8, 0.8),
]


@pytest.mark.parametrize("named, strange, proved, what, before, after", TOLD)
def test_what_was_not_proved_stays_below_one_half_and_what_was_does_not(named, strange, proved, what, before, after):
    d = Decision(named, strange, 0.1, before, {"current": before}, None, {})
    assert d.probability(what, SimpleNamespace(names=proved)) == approx(after, abs=0.008)
    assert d.mismatch(SimpleNamespace(names=proved)) is (bool(proved) or strange)


@pytest.mark.parametrize("gain, claimed", [(2.9, []), (3.1, ["best"])])
def test_where_free_runs_miss_calm_water_the_best_effect_is_claimed_from_three_on(gain, claimed):
    best = fitted(gain - 5.0, "current")
    d = Decision(False, False, 0.8, 0.05, {"current": 0.15}, best, {}, formula=None)
    missed = d.without_calm_water(found(best, fitted(-9.0, "log_scale"), none=-5.0))
    assert missed.strange and missed.none == approx(0.4, abs=0.03)
    assert missed.none + missed.unknown + missed.effects["current"] == approx(1.0)
    assert missed.unknown / missed.effects["current"] == approx(1 / 3)
    assert missed.claims == [best] * len(claimed)
    assert replace(d, none=0.2).without_calm_water(found()).none == 0.2
    several = [
        fitted(-0.5 - 0.2 * k, name) for k, name in enumerate(("current", "log_scale", "rudder_offset", "heading_bias"))
    ]
    assert d.without_calm_water(found(*several, none=-5.0)).claims == several[:3], "runs that were not used decide"


@pytest.mark.parametrize("gain, worth", [(5.8, False), (6.2, True)])
def test_one_more_effect_must_add_six_to_the_best_of_its_parts(gain, worth):
    known = {frozenset({"current"}): 9.0, frozenset({"log_scale"}): 2.0, frozenset({"heading_bias"}): 40.0}
    assert worth_its_size(fitted(9.0 + gain, "current", "log_scale"), known) is worth
    assert worth_its_size(fitted(-50.0, "current"), known)


def test_published_coefficients_are_off_by_three_per_cent():
    assert COEFFICIENT_SD_LEVELS[PUBLISHED_SD_LEVEL] == 0.03


# The checks of a claim -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("left, before, passed", [
    (0.0145, 0.01, True), (0.0155, 0.01, False), (0.2, 0.3, True), (0.2, 0.2, False)
])  # fmt: skip
def test_little_is_left_below_one_and_a_half_per_cent_or_where_calm_water_left_more(left, before, passed):
    check = checks._little_left(found(levels=[(0.0, before), (left, 0.0)]), fitted(0.0, "current", best=(1, 0)))
    assert check.passed is passed


@pytest.mark.parametrize("left, more", [(0.2, True), (0.15, False), (0.1, False)])
def test_more_is_left_than_in_calm_water_only_where_the_level_is_higher(left, more):
    tried = found(levels=[(0.0, 0.15), (left, 0.0)])
    assert checks.more_is_left(tried, fitted(0.0, "current", best=(1, 0))) is more


@pytest.mark.parametrize("loose, wandering, rests", [(6.9, -np.inf, True), (7.1, -np.inf, False), (9.0, 3.0, True)])
def test_something_unknown_rests_on_its_formula_where_it_is_no_likelier_than_seven_without(
    decided, loose, wandering, rests
):
    """Seen by a receiver that wanders calm water gains ln((1 + e^3) / 2) = 2.36 on both."""
    d = decided({}, unmodelled=12.0, rule=fitted(12.0, "current"), wandering=(wandering, -np.inf), loose=loose)
    assert d.strange and d.rests_on_formula is rests


@pytest.mark.parametrize("random, passed", [({"gust_sd": (2.0, 0.3)}, True), ({}, False)])
def test_gusts_that_were_integrated_out_are_not_told_as_a_random_force_that_is_left(random, passed):
    """About the states of the mean wind alone, their course would be one."""
    searched = replace(fitted(9.0, "current", best=(1, 0)), random=random)
    tried = found(searched, levels=[(0.2, 0.2), (0.01, 0.01)])
    assert checks._little_left(tried, replace(searched, best=(0, 0))).passed is passed


@pytest.mark.parametrize("offset, passed", [(5.0, False), (-5.0, False), (4.0, True)])
def test_a_parameter_on_its_bound_fails_the_check(offset, passed):
    bound = RudderOffset.declared[0].high
    j = fitted(0.0, "rudder_offset")
    j = replace(j, hypothesis=j.hypothesis.with_vector(np.array([offset / 5.0 * bound])))
    check = checks._off_bounds(j)
    assert check.passed is passed and ("offset_deg" in check.text) is not passed


@pytest.mark.parametrize("sds, passed", [(3.9, True), (-3.9, True), (4.1, False), (-4.1, False)])
def test_a_formula_that_is_four_standard_deviations_off_what_is_published_fails_the_check(sds, passed):
    effect = RollCoupling(EFFECTS["current"].ship, N_phi=0.01)
    form = next(p for p in effect.declared if p.name == "N_p")
    h = Hypothesis((effect,), (effect.values.numpy()[None].copy(),))
    h.values[0][0, effect.declared.index(form)] = sds * form.spread
    check = checks._as_published(replace(fitted(0.0, "current"), hypothesis=h))
    assert check.passed is passed and ("N_p by 4.1" in check.text) is not passed


@pytest.mark.parametrize("apart_by, passed", [(0.0, True), (4.3, True), (4.42, False)])
def test_runs_must_agree_within_six_standard_deviations_of_chi_square(monkeypatch, apart_by, passed):
    """Two runs, one number, errors of one: chi-square is half the squared distance, 1 + 6 sqrt(2) at 4.355."""
    monkeypatch.setattr(checks, "hypothesis_columns", lambda data_set, h: None)
    monkeypatch.setattr(checks, "_alone", lambda data_set, lin, run, best: (np.array([run * apart_by]), np.eye(1)))
    tried = found()
    tried.likelihood.data_set.runs = [0, 1]  # type: ignore[assignment]
    check = checks._same_in_all_runs(tried, fitted(0.0, "current"))
    assert check.passed is passed and "for 1 degrees" in check.text
    tried.likelihood.data_set.runs = [0]  # type: ignore[assignment]
    assert checks._same_in_all_runs(tried, fitted(0.0, "current")).passed


ALIASES = [
    ({}, 4.3, {"current": ["log_scale"]}),
    ({}, 4.7, {}),
    ({"log_scale": 11.2}, 4.3, {"current": ["log_scale"]}),
    ({"log_scale": 10.8}, 4.3, {}),  # tried in its place, it fell behind by nine
]


@pytest.mark.parametrize("tried, gap, rivals", ALIASES)
def test_effects_within_nine_of_twice_the_log_evidence_are_reported_together(monkeypatch, tried, gap, rivals):
    monkeypatch.setattr(checks, "apart", lambda data_set, leading, rival, best: gap)
    singles = {"current": 20.0, "log_scale": 15.0} | tried
    result = found(*(fitted(e, name) for name, e in singles.items()))
    assert checks.aliases(result, result.fitted[0]) == rivals


# What is only the nearest to something else --------------------------------------------------------------------------


FITTED = [[], []]
"""Effects of a claim about a model that was fitted: whether it is the right ship is not asked."""


@pytest.mark.parametrize("timed, failed, nearest", [
    ([[0, 1]], {REPAIRED_SAILS}, True),
    ([[0, 1], [2, 3]], {REPAIRED_SAILS}, True),
    ([[0, 1], []], {REPAIRED_SAILS}, False),  # a wind beside it acts always
    ([[]], {REPAIRED_SAILS}, False),
    ([[0, 1]], {checks.ON_BOUNDS, checks.LEFT}, False),
    ([[]], {checks.ON_BOUNDS, checks.LEFT, REPAIRED_SAILS}, True),
    ([[]], {checks.FORM, checks.LEFT, REPAIRED_SAILS}, True),
    ([[]], {checks.ON_BOUNDS, RIGHT_SHIP}, True),  # the end of what is possible is not enough for another ship
    ([[]], {RIGHT_SHIP, checks.LEFT, REPAIRED_SAILS}, False),
    ([[0, 1]], {RIGHT_SHIP, checks.LEFT}, False),
    ([[]], {RIGHT_SHIP, checks.FORM}, False),  # a large effect of another form changes all coefficients
    ([[]], {checks.FORM}, True),
    (FITTED, {checks.FORM}, False),
    ([], {REPAIRED_SAILS}, False),
])  # fmt: skip
def test_what_is_only_the_nearest_to_something_else_is_told_by_two_or_three_tests_of_events_alone_by_one(
    timed, failed, nearest
):
    """With times of their own in every run they come near to any force in runs that were fitted."""
    names = (checks.ON_BOUNDS, checks.FORM, checks.LEFT, REPAIRED_SAILS, RIGHT_SHIP)
    made = [Check(name, name not in failed, "") for name in names]
    if timed == FITTED:
        made.pop()
    effects = [SimpleNamespace(timed=columns) for columns in timed]
    claim = SimpleNamespace(names=("some",) * len(effects), hypothesis=SimpleNamespace(effects=effects))
    assert bool(checks.only_nearest(claim, made)) is nearest


@pytest.mark.parametrize("also, stands_again", [(set(), True), ({checks.LEFT}, False), ({RIGHT_SHIP}, True)])
def test_events_do_not_stand_again_if_they_leave_as_much_of_the_missing_force_as_calm_water(also, stands_again):
    made = [Check(name, name not in also, "") for name in (checks.LEFT, RIGHT_SHIP)]
    claim = SimpleNamespace(names=("side_force",), hypothesis=SimpleNamespace(effects=[SimpleNamespace(timed=[0, 1])]))
    why = checks.only_nearest(claim, [*made, Check(REPAIRED_SAILS, False, "")])
    assert why.startswith(checks.ANY_FORCE) and (why == checks.ANY_FORCE) is stands_again


@pytest.mark.parametrize(
    "speeds, sd, passed",
    [
        ((0.006, 0.013, 0.011), 0.005, False),  # an error of the receiver that grows from the start of each recording
        ((0.006, 0.013), 0.005, True),  # two runs may begin at slack water
        ((0.006, 0.013, 0.3), 0.005, True),
        ((0.006, 0.013, 0.011), 0.2, True),  # nobody knows
    ],
)
def test_a_stream_that_is_still_as_each_of_many_runs_begins_is_not_believed(speeds, sd, passed):
    effect = TidalCurrent(SHIP)
    rows = np.array([[speed, 200.0, 0.8] for speed in speeds])
    h = Hypothesis((effect,), (rows,))
    tide = FittedHypothesis(h, 0.0, np.zeros((1, 1)), sd**2 * np.eye(len(h.vector())))
    (check,) = checks._goes_on(tide)
    assert check.passed is passed and bool(checks.only_nearest(tide, [check])) is not passed
    assert checks._goes_on(fitted(0.0, "current")) == [], "what all runs share"


def test_small_weights_that_a_formula_has_in_each_run_are_its_sizes():
    rule = Formula(SHIP, [next(term for term in library() if mark_of(term) == BY_RUN)])
    h = Hypothesis((rule,), (np.tile(values(rule) * 0 + 0.001, (3, 1)),))
    assert h.unknowns()[0].parameter.per_run
    found_rule = FittedHypothesis(h, 0.0, np.zeros((1, 1)), 1e-8 * np.eye(len(h.vector())))
    assert checks._goes_on(found_rule) == []
