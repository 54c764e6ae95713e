"""Claims put to the proof: what held-out runs, free runs and tests make of them, and which takes another's place."""

from dataclasses import replace
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest
from pytest import approx
from scipy.integrate import trapezoid
from scipy.stats import cauchy, chi2, norm
from test_decisions_of_the_search import fit
from trials import SHIP, values

from manoeuvre_nn.diagnosis import checks as checking
from manoeuvre_nn.diagnosis import claims as proving
from manoeuvre_nn.diagnosis.predictive import REPAIRED_SAILS
from manoeuvre_nn.diagnosis.result import RIGHT_SHIP, Check
from manoeuvre_nn.effect.current import Current
from manoeuvre_nn.effect.depth import ShallowWater
from manoeuvre_nn.effect.rudder import RudderOffset
from manoeuvre_nn.effect.sensors import LeverArm, LogScale, RateBias
from manoeuvre_nn.effect.wind import GustyWind
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis, Hypothesis
from manoeuvre_nn.estimation.posterior import posterior

pytestmark = pytest.mark.usefixtures("unchecked_types")


WIDTHS = np.geomspace(0.1, 1000, 400)
"""Prior standard deviation of an effect's numbers over their standard errors."""


def most_by_chance(count: int) -> float:
    """Log Bayes factor of so many numbers that one of 2500 clean cases has, at the width of the prior that has most."""
    power = float(chi2.isf(0.01 / 25, count))
    data = np.append(1.0, np.zeros(count))
    gram = np.eye(count + 1)
    gram[0, 0], gram[0, 1], gram[1, 0] = power, np.sqrt(power), np.sqrt(power)
    with_it = [posterior(gram, 0.0, np.full(count, width), data).evidence[0] for width in WIDTHS]
    return max(with_it) + 0.5 * power


def test_few_clean_cases_reach_the_evidence_of_a_named_effect():
    """By 25 candidates, of up to four numbers; and whatever is compared (x is reached with probability 1/x: Markov)."""
    most = [most_by_chance(count) for count in (1, 2, 3, 4)]
    assert most == approx([4.5, 4.77, 4.9, 4.98], abs=0.01)
    assert max(most) < proving.MIN_GAIN_OF_NAMED < 1.05 * max(most)
    assert 25 * np.exp(-proving.SURE_BY_ITSELF) < 0.01 < 25 * np.exp(-0.95 * proving.SURE_BY_ITSELF)


def test_heavy_tails_of_a_prior_make_a_name_no_easier():
    """Evidence of the estimate z with a standard error of 1, as fits take it and summed over Cauchy's prior."""
    z = float(np.sqrt(chi2.isf(0.01 / 25, 1)))
    x = np.linspace(-400, 400, 400_001)
    likely = np.exp(x * z - 0.5 * x**2)  # over that without the effect
    (offset,) = Hypothesis((RudderOffset(SHIP),), (np.zeros((1, 1)),)).unknowns()
    taken, summed = [], []
    for width in WIDTHS[::10]:
        f, value = replace(offset, parameter=replace(offset.parameter, spread=float(width))), z
        for _ in range(200):  # to where data and prior balance
            value = z / (1 + f.prior_sd(value) ** -2)
        gram, sd = np.array([[z**2, z], [z, 1.0]]), np.array([f.prior_sd(value)])
        found = posterior(gram, 0.0, sd, np.array([1.0, 0.0])).evidence[0]
        taken.append(found + 0.5 * z**2 + f.prior_excess(value))
        summed.append(np.log(trapezoid(likely * cauchy.pdf(x, scale=f.scale), x)))
    assert max(taken) == approx(max(summed), abs=0.1) and max(summed) < most_by_chance(1)


@pytest.mark.parametrize("names, least", [
    (("current",), 5.0), (("current", "log_scale"), 11.0), (("current", "log_scale", "heading_bias"), 17.0)
])  # fmt: skip
def test_a_claim_needs_five_and_six_for_each_further_effect(names, least):
    assert proving.least_gain(fit(0.0, *names)) == approx(least, abs=0.4)
    assert proving.least_gain(fit(0.0, *names), proving.SURE_BY_ITSELF) == approx(least + 3.0, abs=0.4)


ONE, TWO, RULE = ("current",), ("current", "log_scale"), ("formula",)
PROVED = [  # effects, model was fitted, gain in fitted runs, in held-out ones, growth of the error; whether it is named
    (ONE, False, 4.5, 0.3, 1.0, False), (ONE, False, 4.5, 0.7, 1.0, True), (ONE, False, 30.0, -4.8, 1.0, True),
    (ONE, False, 30.0, -5.2, 1.0, False), (ONE, False, 30.0, 9.0, 1.04, True), (ONE, False, 30.0, 7.5, 1.06, False),
    (ONE, False, 30.0, 8.5, 1.06, True),  # enough by itself, whatever free runs do
    (ONE, True, 30.0, 2.8, 1.0, False),  # the errors of a fitted model may look like an effect
    (ONE, True, 30.0, 3.2, 1.0, True), (ONE, True, 30.0, 7.5, 1.01, False), (ONE, True, 30.0, 8.5, 1.01, True),
    (ONE, True, 30.0, 8.5, 1.06, False), (TWO, True, 30.0, 13.5, 1.01, False), (RULE, False, 30.0, 2.8, 1.0, False),
    (RULE, False, 30.0, 3.2, 1.0, True), (TWO, False, 8.5, 2.2, 1.0, False), (TWO, False, 8.5, 2.8, 1.0, True),
    (ONE, True, 4.5, 3.2, 1.0, False), (ONE, True, 4.5, 3.8, 1.0, True),
]  # fmt: skip


@pytest.mark.parametrize("names, trained, fitted, held_out, growth, named", PROVED)
def test_a_named_effect_must_gain_five_in_fitted_and_held_out_runs_together(
    monkeypatch, names, trained, fitted, held_out, growth, named
):
    """And six for a second one, eight beside a fitted model, and in held-out runs alone where free runs get worse.

    Whatever is gained in fitted runs, held-out ones refute what loses five there.
    """
    claim = fit(100.0 + fitted, *names)
    errors = {names: (2.0 * growth, 2.0 * growth)}
    chosen, _, checks = proved(monkeypatch, [claim], {names: held_out}, errors, trained)
    assert chosen.names == (names if named else ()) and checks[0].passed is named


@pytest.mark.parametrize("names, trained, held_out, apart, named", [
    (ONE, False, -8.0, 2.8, False), (ONE, False, -8.0, 3.2, True), (ONE, False, -25.0, 9.0, False),
    (ONE, True, 2.8, 9.0, False), (RULE, False, 2.8, 9.0, False),
])  # fmt: skip
def test_coefficients_that_take_the_place_of_an_effect_do_not_refute_it_in_other_runs(
    monkeypatch, names, trained, held_out, apart, named
):
    """Held-out runs given the fitted ones tell a pitch error from a thrust of half as much again by little.

    They have to speak for it by themselves, and fitted and held-out runs together too.
    """
    claim = fit(130.0, *names)
    assert proved(monkeypatch, [claim], {names: held_out}, {}, trained, apart=apart)[0].names == (
        names if named else ()
    )


@pytest.mark.parametrize("trained", [False, True])
def test_an_event_that_no_held_out_run_had_is_named_by_published_coefficients_alone(monkeypatch, trained):
    """It is taken for an error of a fitted model, whatever the held-out runs gain by what was fitted beside it."""
    monkeypatch.setattr(proving, "acting", lambda hypothesis, runs: [False])
    chosen, _, (check, *_) = proved(monkeypatch, [fit(130.0, "side_force")], {("side_force",): 9.0}, {}, trained)
    assert chosen.names == (() if trained else ("side_force",)) and "did not act in a held-out run" in check.text


SAILED, MORE = Check(REPAIRED_SAILS, True, ""), "more is left than in calm water"


def proved(
    monkeypatch, claims, gains, errors, trained=False, surplus=(), poor=(), apart=0.0, asked=None, unsure=-np.inf
) -> tuple:
    """What is chosen among claims with these gains in held-out runs; errors of effects alone, with corrections.

    By themselves, coefficients unknown, held-out runs make each of them so much likelier than calm water (``apart``).
    Those of ``surplus`` have one effect too many; the first fails the tests ``poor``; one alone may be
    nothing as long as these add less than ``unsure``.
    """
    none = fit(100.0)
    acting = Hypothesis((Current(SHIP),), (values(Current(SHIP)),))
    for j in (none, *claims):
        j.hypothesis, j.corrections = acting, np.ones(1)

    def prove(question, j, *_):
        alone, corrected = errors.get(j.names, (2.0, 2.0))
        after = corrected if j.corrections.any() else alone
        return [SimpleNamespace(rmse_before={"cost": 2.0}, rmse_after={"cost": after}, rmse_alone={"cost": alone})]

    for name, made in {
        "prove": prove, "at_rest": lambda data_set, j: (data_set, j), "averaged": lambda data_set, j: j,
        "over_directions": lambda data_set, j: j,
        "replace": lambda j, **new: SimpleNamespace(**{**vars(j), **new}) if hasattr(j, "names") else replace(j, **new),
        "in_held_out_runs": lambda question, j, known=None: SimpleNamespace(
            hypothesis=acting, evidence=7.0 + (gains.get(j.names, 0.0) if known else apart * bool(j.names))
        ),
        "is_fitted": lambda dynamics: trained, "_cost": lambda question, errors: errors[0]["cost"],
        "_last_effect_helps": lambda question, tried, claim, *_: claim.names not in surplus,
        "labels": lambda j: "", "unit_of_error": lambda question: "",
        "repaired_check": lambda _, tried, j, there: replace(
            SAILED, passed=j.names != claims[0].names or REPAIRED_SAILS not in poor
        ),
    }.items():  # fmt: skip
        monkeypatch.setattr(proving, name, made)
    failed = {claims[0].names: [Check(name, False, "") for name in poor if name not in (REPAIRED_SAILS, MORE)]}
    monkeypatch.setattr(proving.checking, "checks", lambda _, j: failed.get(j.names, []))
    monkeypatch.setattr(
        proving.checking, "may_be_nothing", lambda j, effect, gain=0.0: len(j.names) == 1 and gain < unsure
    )
    monkeypatch.setattr(proving.checking, "chance_of_nothing", lambda j, effect: 0.0)
    monkeypatch.setattr(proving.checking, "more_is_left", lambda _, j: MORE in poor and j.names == claims[0].names)
    asked = asked or Mock(workers=1, put_to_proof={}, held_out_evidence={}, case=Mock(held_out=[1], fitted=[1]))
    tried = SimpleNamespace(likelihood=Mock(), none=none)
    return proving._proved(asked, tried, claims, Check(RIGHT_SHIP, RIGHT_SHIP not in poor, ""))


@pytest.mark.parametrize("names, nothing, left", [
    (TWO, None, TWO), (TWO, 1, ("current",)), (TWO, 0, ("log_scale",)), (ONE, 0, ONE),
])  # fmt: skip
def test_of_several_effects_one_that_may_be_nothing_is_left_out(monkeypatch, names, nothing, left):
    """What is alone is judged by its evidence, and asked for more."""
    of_all = proved(monkeypatch, [fit(150.0, *names)], {names: 30.0}, {})[0]
    assert of_all.names == names
    several = lambda j, effect, gain=0.0: effect == nothing and len(j.names) > 1  # noqa: E731
    monkeypatch.setattr(proving.checking, "may_be_nothing", several)
    monkeypatch.setattr(proving, "MarginalLikelihood", lambda known: None)
    monkeypatch.setattr(Hypothesis, "without", lambda h, number: number)

    def refine(likelihood, without, *best):
        rest = fit(140.0, *(name for k, name in enumerate(names) if k != without))
        return SimpleNamespace(**{**vars(rest), "hypothesis": of_all.hypothesis, "corrections": np.ones(1)})

    monkeypatch.setattr(proving, "refine", refine)
    asked, tried = (
        Mock(workers=1, held_out_evidence={}, put_to_proof={}, case=Mock(held_out=[1], fitted=[1])),
        SimpleNamespace(likelihood=Mock(), none=fit(100.0)),
    )
    tried.none.hypothesis, tried.none.corrections = of_all.hypothesis, np.ones(1)
    claim = fit(150.0, *names)
    claim.hypothesis, claim.corrections = of_all.hypothesis, np.ones(1)
    assert proving._proved(asked, tried, [claim])[0].names == left


def test_of_several_effects_the_one_that_is_least_clear_is_left_out(monkeypatch):
    """Both may be nothing: without one the other may be clear."""
    asked = proved(monkeypatch, [fit(150.0, *TWO)], {TWO: 30.0}, {})[0]
    chances, left = {0: 0.01, 1: 0.2}, []
    monkeypatch.setattr(proving.checking, "may_be_nothing", lambda j, effect, gain=0.0: len(j.names) > 1)
    monkeypatch.setattr(proving.checking, "chance_of_nothing", lambda j, effect: chances[effect])
    monkeypatch.setattr(proving, "MarginalLikelihood", lambda known: None)
    monkeypatch.setattr(Hypothesis, "without", lambda h, number: left.append(number))
    rest = SimpleNamespace(**{**vars(fit(140.0, "current")), "hypothesis": asked.hypothesis})
    monkeypatch.setattr(proving, "refine", lambda *_: rest)
    claim = fit(150.0, *TWO)
    claim.hypothesis = asked.hypothesis
    proving._as_put_to_proof(Mock(case=Mock(fitted=[1])), SimpleNamespace(likelihood=Mock()), claim)
    assert left == [1]


SIZED = [  # effect, offsets of its numbers in standard errors -> whether it may be nothing
    (RudderOffset(SHIP), (3.5,), True), (RudderOffset(SHIP), (-3.6,), False),
    (LogScale(SHIP), (3.5,), True), (LogScale(SHIP), (-3.6,), False),  # about 1
    (LeverArm(SHIP), (3.5, 1.8), True), (LeverArm(SHIP), (3.5, 1.9), False),  # chi-square of two numbers: 15.65
    (Current(SHIP), (3.9, 90.0), True), (Current(SHIP), (4.0, 90.0), False),  # two numbers: a speed and a direction
    (ShallowWater(SHIP), (0.1,), False), (GustyWind(SHIP), (0.1, 90.0), False),
]  # fmt: skip


@pytest.mark.parametrize("effect, off, nothing", SIZED)
def test_an_effect_may_be_nothing_within_three_and_a_half_standard_errors_of_its_sizes(effect, off, nothing):
    """The second of two, the errors of the first being large."""
    first, errors = RateBias(SHIP), np.full(len(off), 0.2)
    own = [p for p in effect.declared if not (p.form or p.random)]
    own_values = values(effect)
    for p, distance in zip(own, off, strict=False):
        own_values[:, effect.declared.index(p)] = distance if p.period else (p.null or 0.0) + 0.2 * distance
    h = Hypothesis((first, effect), (values(first), own_values))
    sd = np.full(len(h.vector()), 9.0)
    sd[1 : 1 + len(errors)] = errors
    assert checking.may_be_nothing(FittedHypothesis(h, 9.0, np.zeros((1, 1)), np.diag(sd**2)), 1) is nothing


@pytest.mark.parametrize("off, nothing", [(3.5, True), (-3.6, False)])
def test_one_of_25_may_be_so_large_by_chance_in_one_case_of_a_hundred(off, nothing):
    """Two tails of .0002."""
    h = Hypothesis((RudderOffset(SHIP),), (np.array([[0.2 * off]]),))
    fitted = FittedHypothesis(h, 9.0, np.zeros((1, 1)), np.diag([0.04]))
    assert checking.may_be_nothing(fitted, 0) is nothing
    assert checking.chance_of_nothing(fitted, 0) == approx(2 * norm.sf(abs(off)))
    assert 2 * 25 * norm.sf(3.54) == approx(0.01, rel=0.02)


def test_other_runs_add_to_how_sure_it_is_that_an_effect_is_there():
    """Twice their log evidence to the square; by the integral over both as rarely by chance as without other runs."""
    h = Hypothesis((RudderOffset(SHIP),), (np.array([[0.6]]),))
    fitted = FittedHypothesis(h, 9.0, np.zeros((1, 1)), np.diag([0.04]))
    limit = 0.5 * (chi2.isf(4e-4, 1) - 9.0)
    assert [checking.may_be_nothing(fitted, 0, limit + more) for more in (-0.01, 0.01)] == [True, False]
    z = np.linspace(-12.0, 12.0, 24001)
    for ratio in (0.01, 0.5, 1.0, 3.0):  # error by the fitted runs over that by the others, which see z w - z^2 / 2
        there = np.maximum(np.abs(z) * ratio, 1e-9)
        least = (chi2.isf(4e-4, 1) - z**2 + there**2) / (2 * there)
        assert np.trapezoid(norm.pdf(z) * norm.sf(least), z) < 4.01e-4


@pytest.mark.parametrize("names, unsure, named", [(ONE, 9.1, False), (ONE, 8.9, True), (TWO, 9.1, True),
                                                  (RULE, 9.1, True)])  # fmt: skip
def test_what_is_named_alone_has_a_size_beyond_its_errors(monkeypatch, names, unsure, named):
    """Of several the others are there; weights of a formula are tied to no effect."""
    found, _, checks = proved(monkeypatch, [fit(130.0, *names)], {names: 9.0}, {}, unsure=unsure)
    assert (found.names, checks[0].passed) == (names if named else (), named)
    assert ("within its errors of none" in checks[0].text) is not named


@pytest.mark.parametrize("gain, chosen", [(13.5, "log_scale"), (12.5, "current")])
def test_what_fitted_runs_leave_open_held_out_ones_settle(monkeypatch, gain, chosen):
    """The rival lies three behind in the fitted runs."""
    claims = [fit(120.0, "current"), fit(117.0, "log_scale"), fit(114.0, "wind_steady")]
    gains = {("current",): 10.0, ("log_scale",): gain, ("wind_steady",): 90.0}
    found, _, checks = proved(monkeypatch, claims, gains, {})
    assert found.names == (chosen,) and checks.count(SAILED) == 1
    assert len(checks) == 3, "six behind is no rival"


ALL_THREE, ELSEWHERE = (checking.ON_BOUNDS, checking.LEFT, REPAIRED_SAILS), (checking.ON_BOUNDS, RIGHT_SHIP)
WORSE = (checking.ON_BOUNDS, checking.LEFT, MORE)


@pytest.mark.parametrize(
    "poor", [ALL_THREE, ALL_THREE[:2], ALL_THREE[1:], ALL_THREE[::2], ELSEWHERE, ELSEWHERE[1:], WORSE, WORSE[1:]]
)
@pytest.mark.parametrize("gap", [2.0, 9.0])
def test_a_claim_that_is_only_the_nearest_gives_way_to_the_next(monkeypatch, poor, gap):
    """At the end of its range, with as much left, and free runs that miss, or another ship. A rival or no rival."""
    claims, gains = [fit(120.0, "current"), fit(120.0 - gap, "log_scale")], {("current",): 30.0, ("log_scale",): 20.0}
    found, _, checks = proved(monkeypatch, claims, gains, {}, poor=poor)
    refused = poor in (ALL_THREE, ELSEWHERE, WORSE)
    assert (found.names, checks[0].passed) == ((("log_scale",), False) if refused else (("current",), True))
    assert ("at an end of what is possible" in checks[0].text) == refused
    if poor == ELSEWHERE:
        assert proved(monkeypatch, claims[:1], gains, {}, poor=poor)[0].names == (), "gains alone are no proof of it"


@pytest.mark.parametrize("too_many", [0, 1, 2])
def test_where_fewer_effects_do_as_well_rivals_with_as_many_are_asked_and_then_these(monkeypatch, too_many):
    """Unless a rival of three has the same third one, which it needs to make up for what is wrong in it."""
    three, rival, two = ("current", "wave_drift", "log_scale"), ("wind_steady", "wave_drift", "log_scale"), (
        "current", "wave_drift",
    )  # fmt: skip
    claims = [fit(160.0, *three), fit(158.0, *rival), fit(159.0, *two)]
    names = [three, rival, two]
    gains = {three: 30.0, rival: 20.0, two: 30.0}
    found, *_ = proved(monkeypatch, claims, gains, {}, surplus=names[:too_many])
    assert found.names == names[too_many]


@pytest.mark.parametrize("faint", [False, True])
def test_gusts_that_are_fainter_than_at_sea_are_none(monkeypatch, faint):
    """A wrong load function looks like them in held-out runs as well, however much they gain there."""
    gusty, steady = fit(150.0, "wind_gusty"), fit(130.0, "wind_steady")
    gusty.random = {"gust_sd": (1.4, 0.2)}
    monkeypatch.setattr(proving, "averaged_over_gusts", lambda known, j: j)
    monkeypatch.setattr(proving, "_about_own_states", lambda data_set, j: (data_set, j))
    monkeypatch.setattr(proving, "fainter_than_at_sea", lambda j: faint)
    gains = {gusty.names: 40.0, steady.names: 30.0}
    chosen, _, (check, *_) = proved(monkeypatch, [gusty, steady], gains, {})
    assert chosen.names == (steady.names if faint else gusty.names)
    assert check.passed is not faint and check.text.endswith("gusts at sea are larger") is faint


def test_what_two_claims_have_in_common_is_put_to_held_out_runs_once(monkeypatch):
    asked, part = [], fit(120.0, "current")
    monkeypatch.setattr(proving, "_as_put_to_proof", lambda question, tried, j: asked.append(j) or (None, j))
    monkeypatch.setattr(proving, "in_held_out_runs", lambda question, j, known: SimpleNamespace(evidence=2.0))
    question, tried = SimpleNamespace(held_out_evidence={}), SimpleNamespace(likelihood=Mock())
    for pair in (fit(130.0, "current", "log_scale"), fit(125.9, "current", "heading_bias")):
        helps = proving._last_effect_helps(question, tried, pair, 2.0, [pair, part])
        assert helps is (pair.evidence > 126.0)
    assert asked == [part]


def test_held_out_runs_weigh_a_claim_as_it_is_put_to_the_proof(monkeypatch):
    """Averaged over what else may be: formulas of several phases do as well in one recording."""
    claim, known = fit(120.0, "current"), Mock()
    monkeypatch.setattr(proving, "_about_own_states", lambda data_set, j: (known, j))
    monkeypatch.setattr(proving, "_averaged", lambda there, j: fit(j.evidence, "log_scale"))
    monkeypatch.setattr(proving, "acting", lambda hypothesis, runs: [True])
    found = {("log_scale",): 5.0, ("current",): -5.0}
    monkeypatch.setattr(proving, "in_held_out_runs", lambda q, j, there: SimpleNamespace(evidence=found[j.names]))
    question = Mock(held_out_evidence={})
    assert proving._held_out_evidence(question, Mock(), claim) == 5.0
    assert question.held_out_evidence == {id(claim): (claim, 5.0)}


def test_a_claim_is_put_to_the_proof_once_and_judged_beside_those_that_are_claimed_with_it(monkeypatch):
    claim, fewer, put, whole = fit(130.0, *TWO), fit(110.0, *ONE), [], proving._put_to_proof
    monkeypatch.setattr(proving, "_put_to_proof", lambda q, t, c, calm: put.append(c) or whole(q, t, c, calm))
    asked = Mock(workers=1, put_to_proof={}, held_out_evidence={}, case=Mock(held_out=[1], fitted=[1]))
    gains = {TWO: 4.0, ONE: 5.0}
    for surplus, names in (([TWO], ONE), ([], TWO)):
        found, _, (of_two, *_) = proved(monkeypatch, [claim, fewer], gains, {}, surplus=surplus, asked=asked)
        assert (found.names, of_two.passed) == (names, not surplus)
        assert of_two.text.endswith("less than that does as well") is bool(surplus)
    assert put == [claim, fewer]
    assert asked.held_out_evidence == {id(claim): (claim, 11.0), id(fewer): (fewer, 12.0)}


@pytest.mark.parametrize("alone, corrected, after", [(1.0, 3.0, 1.0), (1.0, 2.05, 2.05), (3.5, 3.0, None)])
def test_an_effect_is_not_refuted_by_coefficients_that_do_not_hold_in_other_runs(monkeypatch, alone, corrected, after):
    claim = fit(120.0, "current")
    found, proofs, _ = proved(monkeypatch, [claim], {("current",): 7.0}, {("current",): (alone, corrected)})
    assert (found.names, proofs[0].rmse_after["cost"]) == ((("current",), after) if after else ((), 2.0))


@pytest.mark.parametrize("poor, formula, trained, named", [
    ((), -3.0, False, True), ((REPAIRED_SAILS,), -3.0, False, False), ((), 3.0, False, False), ((), -3.0, True, False)
])  # fmt: skip
def test_where_free_runs_stray_what_is_likeliest_and_sails_is_named(monkeypatch, poor, formula, trained, named):
    """Twice as far, with 20 in log evidence of held-out runs; a formula that strays as far has less or more."""
    claims, strayed = [fit(120.0, "wind_gusty"), fit(120.0 + formula, "formula")], (4.0, 4.0)
    gains, errors = dict.fromkeys([c.names for c in claims], 20.0), dict.fromkeys([c.names for c in claims], strayed)
    found, proofs, checks = proved(monkeypatch, claims, gains, errors, trained, poor=poor)
    assert (found.names, checks[0].passed) == ((("wind_gusty",), True) if named else ((), False))
    assert proofs[0].rmse_after["cost"] == (4.0 if named else 2.0)
    assert ("would be enough" in checks[0].text) == named and not checks[1].passed


@pytest.mark.parametrize(
    "formula, error, chosen", [(20.0, 1.4, "formula"), (20.0, 1.6, "side_force"), (-20.0, 1.4, "side_force")]
)
def test_events_that_do_not_sail_stand_again_where_nothing_else_passes_or_is_nearer(
    monkeypatch, formula, error, chosen
):
    claims, said = [fit(120.0, "side_force"), fit(115.0, "formula")], {("side_force",): checking.ANY_FORCE}
    monkeypatch.setattr(proving.checking, "only_nearest", lambda j, *_: said.get(j.names, ""))
    errors = {("side_force",): (1.5, 1.5), ("formula",): (error, error)}
    found, _, checks = proved(monkeypatch, claims, {("side_force",): 30.0, ("formula",): formula}, errors)
    assert found.names == (chosen,) and checks[0].passed == (chosen == "side_force")
