"""Each threshold, prior and veto of the diagnosis by what is decided a little below it and a little above it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from pytest import approx
from scipy.stats import norm
from searches import EFFECTS, fitted, found

from manoeuvre_nn.diagnosis import alarm, checks
from manoeuvre_nn.diagnosis import decision as under_test
from manoeuvre_nn.diagnosis.decision import PRIOR_NONE, PRIOR_OF_SIZE, PRIOR_UNKNOWN, Decision
from manoeuvre_nn.diagnosis.fits import PUBLISHED_SD_LEVEL
from manoeuvre_nn.diagnosis.predictive import REPAIRED_SAILS
from manoeuvre_nn.diagnosis.result import RIGHT_SHIP, Check
from manoeuvre_nn.diagnosis.search import worth_its_size
from manoeuvre_nn.diagnosis.unknown import ReceiverWander
from manoeuvre_nn.effect.roll import RollCoupling
from manoeuvre_nn.effect.rudder import RudderOffset
from manoeuvre_nn.estimation.data_set import COEFFICIENT_SD_LEVELS
from manoeuvre_nn.estimation.hypothesis import Hypothesis

pytestmark = pytest.mark.usefixtures("unchecked_types")


# The alarm -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("candidates, size", [(1, 50.0), (1, 0.5), (8, 50.0), (24, 1000.0)])
def test_the_alarm_is_what_the_best_of_all_candidates_exceeds_in_one_of_a_hundred_clean_sets(
    monkeypatch, candidates, size
):
    """Closed form: z^2/2 s/(1+s) - ln(1+s)/2 with z Gaussian, the largest of independent ones."""
    monkeypatch.setattr(alarm, "DRAWS", 200_000)
    monkeypatch.setattr(alarm, "_information", lambda result, hypothesis: (np.eye(1) * size / 4.0, np.array([2.0])))
    one = 0.99 ** (1 / candidates)  # none of them exceeds it in 99 of 100 sets
    z = norm.ppf(0.5 + 0.5 * one)
    expected = 0.5 * z**2 * size / (1 + size) - 0.5 * np.log1p(size)
    pair = fitted(9.0, "current", "log_scale")
    assert alarm.threshold(found(*[fitted(0.0, "current")] * candidates, pair)) == approx(expected, abs=0.06)


@pytest.mark.parametrize("sd", [0.05, 0.5])
def test_what_coefficients_may_explain_as_far_as_they_are_known_is_no_information_on_an_effect(monkeypatch, sd):
    """One coefficient and one number of an effect: ``g_ee - g_ce^2 / (g_cc + sd^-2)``."""
    gram = np.zeros((4, 4))  # of data, coefficient, effect and its number
    gram[1, 1], gram[3, 3], gram[1, 3] = 40.0, 30.0, 25.0
    gram[3, 1] = gram[1, 3]
    data_set = SimpleNamespace(size=2, runs=[None], embedded=lambda *_: None, gram=lambda *_: gram)
    data_set.nuisance_sd = lambda scatter, runs: np.array([sd])
    lin = SimpleNamespace(columns=None, index=None, count=2)
    likelihood = SimpleNamespace(data_set=data_set, columns=lambda hypothesis: lin)
    number = SimpleNamespace(mean=lambda value: 0.0, prior_sd=lambda mean: 3.0)
    effect = SimpleNamespace(unknowns=lambda: [number], vector=lambda: [1.0])
    result = SimpleNamespace(none=SimpleNamespace(best=(0, 0)), likelihood=likelihood)
    information, spread = alarm._information(result, effect)
    assert (information, spread) == (approx(np.array([[30.0 - 25.0**2 / (40.0 + sd**-2)]])), approx([3.0]))


def test_enough_clean_sets_are_drawn_for_the_share_that_may_raise_an_alarm():
    """The number beyond the threshold is Poisson's: 20 are good to a quarter."""
    assert alarm.DRAWS * alarm.FALSE_ALARMS >= 20


def test_few_clean_cases_reach_the_evidence_of_a_named_effect_whatever_the_model_lacks():
    """Markov's inequality: a Bayes factor of x is reached with probability 1/x at most, by 25 candidates."""
    assert 25 * np.exp(-alarm.MIN_GAIN_OF_NAMED) < 0.01 < 25 * np.exp(-0.95 * alarm.MIN_GAIN_OF_NAMED)


ALARMS = [
    (("current",), 4.8, 1.0, False),
    (("current",), 5.2, 1.0, True),
    (("current",), 6.1, 6.2, False),  # chance alone would reach 6.2
    (("current",), 6.3, 6.2, True),
    (("current", "log_scale"), 10.7, 1.0, False),
    (("current", "log_scale"), 11.3, 1.0, True),
    (("current", "log_scale", "heading_bias"), 16.6, 1.0, False),
    (("current", "log_scale", "heading_bias"), 17.4, 1.0, True),
]


@pytest.mark.parametrize("names, gain, chance, raised", ALARMS)
def test_an_alarm_needs_more_than_chance_five_for_the_first_effect_and_six_for_each_more(
    monkeypatch, names, gain, chance, raised
):
    monkeypatch.setattr(alarm, "threshold", lambda result: chance)
    assert alarm.raised(found(none=-3.0), fitted(gain - 3.0, *names)) is raised
    assert alarm.least_gain(fitted(0.0, *names)) == approx(8.0 + 6.0 * (len(names) - 1), abs=0.4)


def test_without_a_candidate_there_is_no_alarm():
    assert alarm.raised(found(), None) is False


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

    def run(gains: dict, unmodelled=-9.0, rule=None, lacked=None, chance=1.0, wandering=(-np.inf,) * 2) -> Decision:
        calm, named = wandering  # seen by a receiver that wanders: calm water, and the best hypothesis with a name
        monkeypatch.setattr(under_test, "beside", lambda likelihood, hypothesis: likelihood)
        monkeypatch.setattr(under_test, "gain_by_coefficient_priors", lambda data_set, j: 0.0)
        monkeypatch.setattr(under_test, "short_formula", lambda there, none: rule)
        monkeypatch.setattr(under_test, "unknown_evidence", lambda there, none, formula: unmodelled - 3.0)
        wanders = lambda there, j: ReceiverWander(1.0, 60.0, (named if j.names else calm) - 3.0)  # noqa: E731
        monkeypatch.setattr(under_test, "receiver_wander", wanders)
        monkeypatch.setattr(under_test, "is_fitted", lambda dynamics: lacked is not None)
        monkeypatch.setattr(alarm, "threshold", lambda result: chance)
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
    for named, stays in ((46.0, True), (43.0, False)):  # five more than 40 less log 2
        found_there = decided({"current": 30.0}, unmodelled=20.0, wandering=(40.0, named))
        assert found_there.named == stays and not found_there.strange, "if the name is refuted, nothing is unknown"
    assert decided({"current": 50.0}, unmodelled=20.0, wandering=(40.0, 0.0)).named, "likelier even without"


def test_without_an_alarm_calm_water_keeps_six_of_ten_and_with_one_no_more_than_four(decided):
    quiet, alarmed = decided({"current": 4.8}), decided({"current": -9.0}, unmodelled=-9.0, lacked=0.2)
    assert (quiet.named, quiet.strange, alarmed.strange) == (False, False, True)
    assert quiet.none == approx(0.6, abs=0.03) and alarmed.none == approx(0.4, abs=0.03)
    for d in (quiet, alarmed):
        assert d.none + d.unknown + sum(d.effects.values()) == approx(1.0)


@pytest.mark.parametrize("unmodelled, strange", [(6.8, False), (7.2, True)])
def test_something_unknown_is_told_from_seven_on(decided, unmodelled, strange):
    assert decided({"current": 0.0}, unmodelled).strange is strange


@pytest.mark.parametrize("lacked, strange", [(0.096, False), (0.104, True)])
def test_a_fitted_model_may_lack_a_tenth_of_its_forces(decided, lacked, strange):
    d = decided({"current": 0.0}, lacked=lacked)
    assert d.strange is strange
    assert not decided({"current": 0.0}).strange, "a published model has no such bound"


def test_what_is_unknown_leads_by_its_odds_a_name_that_raises_the_alarm_too(decided):
    assert decided({"current": 20.0}, unmodelled=24.0).lead == approx(4.0 + np.log(PRIOR_UNKNOWN / PRIOR_OF_SIZE[0]))
    assert decided({"current": 24.0}, unmodelled=20.0).lead == 0.0, "the name leads"
    assert decided({"current": 0.0}, unmodelled=24.0).lead == 0.0, "a name without an alarm"


CLAIMED = [
    ({"current": 20.0, "log_scale": 1.0}, -9.0, None, [("current",)]),
    ({"current": 20.0}, 24.0, None, []),  # something unknown is likelier by far
    ({"current": 20.0}, -9.0, 6.8, [("current",)]),
    ({"current": 20.0}, -9.0, 7.2, [("current",), ("formula",)]),
    ({"current": 1.0}, 8.0, 2.0, [("formula",)]),
    ({"current": 1.0}, 2.0, 2.0, []),
    ({"current + log_scale": 40.0, "current": 20.0, "log_scale": 9.0, "heading_bias": 30.0}, -9.0, None,
     [("current", "log_scale"), ("current",)]),
    ({"current + log_scale + heading_bias": 70.0, "log_scale + heading_bias": 45.0, "current + log_scale": 42.0,
      "current + heading_bias": 30.0, "current": 20.0, "heading_bias": 21.0, "rudder_offset": 30.0}, -9.0, None,
     [("current", "log_scale", "heading_bias"), ("log_scale", "heading_bias"), ("current", "log_scale"),
      ("current", "heading_bias"), ("heading_bias",)]),
    ({"current + log_scale": 25.9, "current": 20.0}, -9.0, None, [("current",)]),
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
    (False, False, ("current",), "current", 0.3, 0.6),  # proved although no alarm was raised
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
    ([], {REPAIRED_SAILS}, False),
])  # fmt: skip
def test_what_is_only_the_nearest_to_something_else_is_told_by_two_or_three_tests_of_events_alone_by_one(
    timed, failed, nearest
):
    """With times of their own in every run they come near to any force in runs that were fitted."""
    names = (checks.ON_BOUNDS, checks.FORM, checks.LEFT, REPAIRED_SAILS, RIGHT_SHIP)
    made = [Check(name, name not in failed, "") for name in names]
    effects = [SimpleNamespace(timed=columns) for columns in timed]
    claim = SimpleNamespace(names=("some",) * len(effects), hypothesis=SimpleNamespace(effects=effects))
    assert bool(checks.only_nearest(claim, made)) is nearest
