"""No prior of the coefficients' errors is preferred: hypotheses are weighed with all of them, calm water too."""

from dataclasses import replace
from functools import cache
from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pytest
from pytest import approx
from scipy.special import logsumexp
from searches import fitted as by_hand
from searches import found
from test_hypotheses_judged import hypothesis, stand
from tiers import mainly
from trials import CALM, SHIP, values

from manoeuvre_nn.diagnosis import claims as proving
from manoeuvre_nn.diagnosis import decision, proof
from manoeuvre_nn.diagnosis.decision import MAX_SETTLED, by_any_coefficient_prior, decide
from manoeuvre_nn.diagnosis.fits import at_rest, refine
from manoeuvre_nn.effect.current import Current
from manoeuvre_nn.effect.loading import TrimChange
from manoeuvre_nn.effect.wind import GustyWind, SteadyWind
from manoeuvre_nn.estimation.corrections import CoefficientPrior
from manoeuvre_nn.estimation.data_set import COEFFICIENT_SD_LEVELS, WhitenedDataSet
from manoeuvre_nn.estimation.hypothesis import Hypothesis
from manoeuvre_nn.estimation.hypothesis_columns import HypothesisColumns
from manoeuvre_nn.estimation.marginal_likelihood import (
    PROCESS_PRIOR,
    MarginalLikelihood,
    log_prior_levels,
    to_prior_means,
    weighty,
)
from manoeuvre_nn.estimation.prepared_run import PreparedRun, base_columns
from manoeuvre_nn.estimation.prior_average import (
    COEFFICIENT_PRIORS,
    gain_by_coefficient_priors,
    over_coefficient_priors,
)
from manoeuvre_nn.estimation.process_noise import PROCESS_LEVELS

pytestmark = pytest.mark.usefixtures("unchecked_types")
LEVEL = PROCESS_LEVELS.point(0, 13)


@cache
def _whole() -> list[PreparedRun]:
    return [replace(p, base=base_columns(CALM, p.linearised)) for p in stand("wind").runs]


def _blown(speed: float) -> Hypothesis:
    return hypothesis(SteadyWind(SHIP, speed=speed, from_deg=80.0)) if speed else Hypothesis((), ())


@cache
def _whitened_with(prior: CoefficientPrior, speed: float) -> tuple[MarginalLikelihood, HypothesisColumns | None]:
    likelihood = MarginalLikelihood(WhitenedDataSet(CALM, _whole(), prior))
    return likelihood, likelihood.columns(_blown(speed)) if speed else None


@cache
def _with_prior(prior: CoefficientPrior, speed: float, level: int) -> np.ndarray:
    """Log evidence at every standard deviation of the coefficients: the same whichever prior the runs have."""
    likelihood, columns = _whitened_with(prior, speed)
    return likelihood.posterior(columns, level).evidence


@pytest.mark.parametrize("own", [CoefficientPrior(), CoefficientPrior(0.6, 3.0)])
@pytest.mark.parametrize("speed", mainly(1, [5.0, 0.0]))
def test_the_gain_is_the_mean_over_runs_that_were_made_with_each_prior(own, speed):
    """A second route: runs whitened anew with each of them, noise levels summed out."""
    data_set = WhitenedDataSet(CALM, _whole(), own)
    h = _blown(speed)
    beside = data_set.levels.beside(LEVEL)

    def evidence(prior: CoefficientPrior, levels=beside, of: float | None = PROCESS_PRIOR) -> float:
        of_levels = log_prior_levels(data_set, of)
        return float(logsumexp([_with_prior(prior, speed, g) + of_levels[g] for g in levels]))

    at = replace(MarginalLikelihood(data_set).evaluate(h, around=LEVEL), hypothesis=h, best=(LEVEL, 2))
    each = [evidence(prior) for prior in COEFFICIENT_PRIORS]
    assert max(each) - min(each) > 0.5, "or any mean would do"
    assert gain_by_coefficient_priors(data_set, at) == approx(logsumexp(each) - np.log(16) - evidence(own), abs=0.05)
    few, alone = (
        [LEVEL, data_set.levels.point(4, 0), data_set.levels.point(7, 10)],
        [evidence(p, [LEVEL], None) for p in (*COEFFICIENT_PRIORS, own)],
    )
    each = [evidence(prior, few, None) for prior in COEFFICIENT_PRIORS]
    gained = logsumexp(each) - np.log(16) - evidence(own, few, None)
    assert gain_by_coefficient_priors(data_set, at, few, None) == approx(gained, abs=0.05)
    assert abs(gained - (logsumexp(alone[:-1]) - np.log(16) - alone[-1])) > 0.1, "or any levels would do"


def test_values_and_errors_hold_for_all_priors_by_the_law_of_total_variance():
    """A second route: runs whitened anew with each of them, every level of both deviations a part of the mixture."""
    data_set = WhitenedDataSet(CALM, _whole(), CoefficientPrior(0.9, 0.3))
    about = hypothesis(TrimChange(SHIP, trim_m=1.0))
    at = MarginalLikelihood(data_set).evaluate(about, around=LEVEL)
    of_levels, weights, values, variances = log_prior_levels(data_set, PROCESS_PRIOR), [], [], []
    for prior in COEFFICIENT_PRIORS:
        likelihood = MarginalLikelihood(WhitenedDataSet(CALM, _whole(), prior))
        for g in sorted({g for g, _ in weighty(at.by_level + of_levels)}):
            found = likelihood.posterior(likelihood.columns(about), g)
            weights += (found.evidence + of_levels[g]).tolist()
            values += [1.0 + found.mean(s)[-1] + to_prior_means(about)[0] for s in range(len(COEFFICIENT_SD_LEVELS))]
            variances += [found.covariance(s)[-1, -1] for s in range(len(COEFFICIENT_SD_LEVELS))]
    w, values = np.exp(np.array(weights) - logsumexp(weights)), np.array(values)
    over = over_coefficient_priors(data_set, at, about)
    assert over.hypothesis.vector() == approx([w @ values], rel=2e-3)
    assert over.errors == approx([np.sqrt(w @ variances + w @ (values - w @ values) ** 2)], rel=0.02)
    assert over.errors > 1.1 * at.errors, "or one prior would do"
    assert (len(over.corrections), len(over.latencies)) == (len(at.corrections), len(at.latencies))


@pytest.fixture
def weighed(monkeypatch):
    """Log evidence after the search has been weighed with all priors, of which hypotheses gain so much."""

    def run(gains: dict, *hypotheses, formula=None):
        monkeypatch.setattr(decision, "beside", lambda likelihood, h: likelihood)
        monkeypatch.setattr(decision, "gain_by_coefficient_priors", lambda data_set, j: gains.get(j.names, 0.0))
        result = by_any_coefficient_prior(found(*hypotheses, none=-3.0))
        assert result.none.evidence == -3.0 and result.calm_gain in (None, gains.get((), 0.0))
        monkeypatch.setattr(decision, "short_formula", lambda there, none: formula)
        told = [] if formula is None else [decision._formula(result, result.likelihood)]
        return [("+".join(j.names), round(j.evidence, 6)) for j in [*result.fitted, *told]]

    return run


def test_a_name_and_a_formula_gain_what_they_gain_beyond_calm_water(weighed):
    some = by_hand(9.0, "current"), by_hand(3.5, "rudder_offset"), by_hand(2.0, "current", "rudder_offset")
    gains = {(): -2.5, ("current",): -2.0, ("rudder_offset",): 1.0, ("current", "rudder_offset"): -2.6}
    named = [("current", 9.5), ("rudder_offset", 7.0), ("current+rudder_offset", 1.9)]
    assert weighed(gains, *some) == named
    rule = by_hand(1.0, "heading_bias")
    assert weighed(gains | {rule.names: 0.75}, *some, formula=rule) == [*named, ("heading_bias", 4.25)]


@pytest.mark.parametrize("evidence, gained", [(-3.1, 0.0), (-2.9, 1.0), (900.0, 1.0)])
def test_where_calm_water_is_likeliest_nothing_is_weighed_again(weighed, evidence, gained):
    """Calm water has -3. Where a name leads, by however much, the prior of the runs may not be its own."""
    rule = by_hand(-5.0, "heading_bias")
    there = weighed({("current",): 1.0, rule.names: 2.0}, by_hand(evidence, "current"), formula=rule)
    assert there == [("current", approx(evidence + gained)), ("heading_bias", -5.0 + 2 * gained)]


def test_what_is_behind_the_first_few_gains_the_least_of_these(weighed):
    names = ["current", "rudder_offset", "heading_bias", "log_scale"]
    every = [*combinations(names, 1), *combinations(names, 2)]
    some = [by_hand(5.0 - k, *one) for k, one in enumerate(every)]
    found = [evidence for _, evidence in weighed({one: 0.25 for one in every} | {every[2]: -0.5}, *some)]
    assert found == [5.25, 4.25, 2.5] + [5.25 - k for k in range(3, MAX_SETTLED)] + [4.5 - MAX_SETTLED]
    assert weighed({}) == []


def test_a_gusty_wind_gains_what_the_steady_one_does(weighed):
    """Without its course, which is no column, coefficients would have to explain the gusts."""

    def made(effect, evidence: float):
        return replace(by_hand(evidence), hypothesis=Hypothesis((effect,), (values(effect),)))

    gusty, steady = made(GustyWind(SHIP, speed=9.0), 8.0), made(SteadyWind(SHIP, speed=9.0), 4.0)
    gains = {("wind_steady",): 1.5, ("wind_gusty",): 50.0}
    assert weighed(gains, gusty, steady) == [("wind_gusty", 9.5), ("wind_steady", 5.5)]
    assert weighed(gains, gusty) == [("wind_gusty", 8.0)]
    drift = by_hand(7.0, "current")
    assert weighed(gains | {("current",): 0.5}, gusty, drift) == [("wind_gusty", 8.5), ("current", 7.5)], "the least"


GUSTS = GustyWind(SHIP, speed=9.0), SteadyWind(SHIP, speed=9.0)


@pytest.mark.parametrize("steady_there, helps", [(24.8, False), (23.2, True)])
@pytest.mark.parametrize("beside", [(), (Current(SHIP),)])
def test_gusts_must_add_six_in_fitted_and_held_out_runs_to_the_steady_wind(monkeypatch, steady_there, helps, beside):
    """Wrong load functions look like gusts in one run, not in all."""

    def made(effect, evidence: float):
        effects = (*beside, effect)
        return replace(by_hand(evidence), hypothesis=Hypothesis(effects, tuple(values(e) for e in effects)))

    gusty, steady, other = made(GUSTS[0], 30.0), made(GUSTS[1], 20.0), by_hand(21.0, "rudder_offset")
    assert decision.has_one_less(steady, gusty) and not decision.has_one_less(gusty, steady)
    assert not decision.has_one_less(other, gusty) and not decision.has_one_less(steady, steady)
    claims = decision._claims(found(gusty, other, steady), gusty, None, False)
    assert claims[:2] == [gusty, steady] and claims.count(steady) == 1
    assert decision._claims(found(gusty, steady), steady, None, False)[0] is steady, "gusts are no further effect"
    monkeypatch.setattr(proving, "_as_put_to_proof", lambda question, tried, j: (None, j))
    monkeypatch.setattr(proving, "in_held_out_runs", lambda question, j, known: replace(j, evidence=steady_there))
    alone = [c for c in claims if len(c.names) == len(gusty.names)]
    assert proving._last_effect_helps(SimpleNamespace(held_out_evidence={}), found(), gusty, 20.0, alone) is helps


def test_the_decision_is_made_on_what_all_priors_say(monkeypatch):
    order, rule = [], by_hand(1.0, "heading_bias")
    monkeypatch.setattr(decision, "beside", lambda likelihood, h: likelihood)
    monkeypatch.setattr(decision, "short_formula", lambda likelihood, none: rule)
    monkeypatch.setattr(decision, "gain_by_coefficient_priors", lambda data_set, j: 4.0)
    monkeypatch.setattr(decision, "random_force", lambda there, none: None)
    monkeypatch.setattr(decision, "unknown_evidence", lambda there, none, f, calm, _: order.append((f, calm)) or 20.0)
    monkeypatch.setattr(decision, "_by_usual_receiver", lambda *_: (0.0, 0.0))
    result = replace(found(levels=[(0.001, 0.0)]), calm_gain=-0.75)
    result.likelihood.data_set.dynamics = CALM  # type: ignore[assignment]
    assert decide(result).formula.evidence == 1.0 + 4.0 + 0.75
    assert [(f and f.evidence, calm) for f, calm in order] == [(5.75, -0.75), (None, -0.75)]
    assert decide(replace(result, calm_gain=None)).formula is rule


def test_held_out_runs_are_weighed_with_all_priors_too(monkeypatch):
    likelihood = MarginalLikelihood(stand("wind"))
    wind = likelihood.evaluate(hypothesis(SteadyWind(SHIP, speed=10.0, from_deg=60.0)), around=LEVEL)
    question = SimpleNamespace(held_out=likelihood, case=SimpleNamespace(held_out=[1], fitted=[]), elsewhere={})
    monkeypatch.setattr(proof, "same_campaigns", lambda fitted, held_out: [0, 1])
    held = replace(wind.hypothesis, fixed=frozenset({"speed", "from_deg"}))
    data_set, there = at_rest(likelihood.data_set, refine(likelihood, held, *wind.best))
    gain, found = gain_by_coefficient_priors(data_set, there), proof.in_held_out_runs(question, wind)
    assert abs(gain) > 0.03 and found.evidence == approx(there.evidence + gain)
    # The formula's uncertain parts are free there, and yet predictions are made with those of the fitted runs.
    assert not there.hypothesis.values[0] == approx(wind.hypothesis.values[0])
    np.testing.assert_array_equal(found.hypothesis.values[0], wind.hypothesis.values[0])
    assert found.hypothesis.unknowns() == [] and found.covariance.shape == (0, 0)
    # What is asked again is not fitted again.
    monkeypatch.setattr(proof, "at_rest", lambda *_: pytest.fail("fitted again"))
    again = proof.in_held_out_runs(question, wind)
    assert again.evidence == found.evidence and np.array_equal(again.covariance, found.covariance)
