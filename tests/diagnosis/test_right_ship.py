"""Whether recordings are of the named ship at all: asked of other ships' runs, and not of the right one's."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from fleet import ship_named
from searches import fitted
from strangers import Stranger, asked, calm_only, strange_runs
from tiers import mainly
from trials import CALM, CIRCLE, SHIP, ZIGZAG, runs

from manoeuvre_nn.diagnosis import right_ship
from manoeuvre_nn.diagnosis.formula import short_formula
from manoeuvre_nn.diagnosis.result import RIGHT_SHIP
from manoeuvre_nn.diagnosis.right_ship import MIN_GAIN_OF_ANOTHER, _Accounts, right_ship_check
from manoeuvre_nn.diagnosis.search import SearchResult
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.effect.common import in_tight_turns
from manoeuvre_nn.estimation.corrections import CoefficientPrior
from manoeuvre_nn.estimation.data_set import COEFFICIENT_SD_LEVELS, whitened_data_set
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis, Hypothesis
from manoeuvre_nn.estimation.marginal_likelihood import PROCESS_PRIOR, MarginalLikelihood, log_prior_levels
from manoeuvre_nn.estimation.posterior import posterior
from manoeuvre_nn.estimation.process_noise import PROCESS_LEVELS

pytestmark = pytest.mark.usefixtures("unchecked_types")
DATA_SET = SimpleNamespace(dynamics=CALM, levels=PROCESS_LEVELS, coefficient_prior=CoefficientPrior())


def explaining(*names: str, usual: float = -1e4, other: float = -1e4, any_force: float = -1e4) -> FittedHypothesis:
    """A hypothesis with these log evidences: coefficients usual, or off by 20 %, or usual beside a large force."""
    by_level = np.full((len(PROCESS_LEVELS), len(COEFFICIENT_SD_LEVELS)), -1e4)
    by_level[0, 2], by_level[0, -1], by_level[-1, 2] = usual, other, any_force
    prior = log_prior_levels(DATA_SET, PROCESS_PRIOR)
    whole = np.logaddexp.reduce((by_level + prior).ravel())
    return replace(fitted(float(whole), *names), by_level=by_level)


def gain(none: FittedHypothesis, *named: FittedHypothesis, formula: FittedHypothesis | None = None) -> float:
    return _Accounts(SearchResult(none, list(named), SimpleNamespace(data_set=DATA_SET)), formula).gain()


def test_unusual_coefficients_are_weighed_against_all_that_may_act_on_the_named_ship(monkeypatch):
    monkeypatch.setattr(
        _Accounts, "_unusual", lambda self, j: np.append(self._evidence(j, slice(-1, None)), [-np.inf] * 3)
    )
    calm = explaining(usual=-60.0, other=0.0)
    assert gain(calm) == pytest.approx(58.0, abs=4.0)
    assert gain(calm, explaining("current", usual=40.0)) < 0, "an effect that is known"
    assert gain(calm, formula=explaining(usual=40.0)) < 0, "a formula"
    assert gain(explaining(usual=-60.0, other=0.0, any_force=40.0)) < 0, "any force"
    still_off = explaining("current", usual=40.0, other=80.0)
    assert gain(calm, still_off) > 30, "an effect that leaves the coefficients what they were"


def test_the_two_best_of_each_account_are_looked_at_with_all_process_noise_and_calm_water(monkeypatch):
    monkeypatch.setattr(
        _Accounts, "_unusual", lambda self, j: np.append(self._evidence(j, slice(-1, None)), [-np.inf] * 3)
    )
    seen = []
    monkeypatch.setattr(_Accounts, "_everywhere", lambda self, j: (seen.append(j.names), j)[1])
    usual = {"current": 50.0, "log_scale": 40.0, "heading_bias": 30.0, "rudder_offset": 20.0}
    other = {"current": -10.0, "log_scale": -20.0, "heading_bias": 60.0, "rudder_offset": 0.0}
    named = [explaining(name, usual=usual[name], other=other[name]) for name in usual]
    calm = explaining(usual=-90.0, other=-90.0)
    _Accounts(SearchResult(calm, named, SimpleNamespace(data_set=DATA_SET)), None).completed()
    assert sorted(seen) == [(), ("current",), ("heading_bias",), ("log_scale",), ("rudder_offset",)]
    seen.clear()
    third = explaining("heading_bias", usual=30.0, other=-30.0)
    _Accounts(SearchResult(calm, [*named[:2], third], SimpleNamespace(data_set=DATA_SET)), None).completed()
    assert sorted(seen) == [(), ("current",), ("log_scale",)]


@pytest.mark.parametrize("gain, completed, passed, asked", [
    (6.9, 99.0, True, False), (7.1, 7.1, False, True), (7.1, 6.9, True, True),
])  # fmt: skip
def test_before_the_ship_is_called_in_question_accounts_are_completed(monkeypatch, gain, completed, passed, asked):
    """A force without a rule has no evidence of its own here; what is told is what the completed accounts say."""
    later = SimpleNamespace(gain=lambda least: completed if least == -5.0 else 99.0, size=0.6)
    first = SimpleNamespace(gain=lambda: gain, completed=lambda: later, size=0.4)
    monkeypatch.setattr(right_ship, "_Accounts", lambda tried, formula: first)
    monkeypatch.setattr(right_ship, "random_force", lambda *_: SimpleNamespace(evidence=-9.0))
    monkeypatch.setattr(right_ship, "receiver_wander", lambda *_: SimpleNamespace(evidence=-5.0))
    check = right_ship_check(SimpleNamespace(likelihood=None, none=None), None)
    assert check.passed is passed and ("60 %" in check.text) == (not passed)
    assert check.text.endswith(f"{completed if asked else gain:+.0f}")


def test_evidence_at_other_scales_of_the_prior_is_that_of_a_posterior_made_at_them():
    rng = np.random.default_rng(5)
    columns, scales = rng.standard_normal((40, 7)), np.array([0.05, 0.5, 2.0])
    given = columns.T @ columns, -3.0, np.array([1.0, 1.0, 1.0, 2.0, 0.5, 1.0]), np.eye(7)[0]
    made, others = (posterior(*given, s, 3) for s in ((0.2, 0.7), scales))
    assert made.evidence_at(scales) == pytest.approx(others.evidence, rel=1e-12)


@pytest.mark.slow
def test_of_runs_of_the_right_ship_nothing_is_asked_whatever_acts_on_her():
    """Coefficients off by 4 %, and beside them a side force in turns that no calm water has, or one without a rule."""
    even = Stranger(0.6, "Y", lambda s: in_tight_turns(SHIP, s)["r"].abs())
    for acting, random in (((even,), ()), ((), ((0.4, "N", 20.0),))):
        tried = calm_only(asked(strange_runs(3, *acting, random=random, step=2.0)))
        check = right_ship_check(tried, short_formula(tried.likelihood, tried.none))
        assert check.passed, (acting, random, check.text)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [3, 4, 5])
def test_a_ship_whose_coefficients_are_off_by_far_more_than_their_scatter_is_called_in_question(seed):
    tried = calm_only(asked(strange_runs(seed, scatter=0.3, step=2.0)))
    assert not right_ship_check(tried, short_formula(tried.likelihood, tried.none)).passed


@pytest.mark.parametrize("other", mainly(1, ["esso_190k", "great_lakes_bulker"]))
def test_runs_of_the_mariner_are_not_taken_for_those_of_another_ship(other):
    likelihood = MarginalLikelihood(whitened_data_set(CalmWater(ship_named(other)), runs([ZIGZAG, CIRCLE])))
    tried = SearchResult(likelihood.evaluate(Hypothesis((), ())), [], likelihood)
    check = right_ship_check(tried, short_formula(likelihood, tried.none))
    assert check.name == RIGHT_SHIP and not check.passed
    assert re.search(
        "coefficients would have to be off by some (50|100|200) %, not by 8 % at most as usual", check.text
    )
    assert float(check.text.rpartition("+")[2]) > MIN_GAIN_OF_ANOTHER
