"""From evidence to probabilities, with contests made up of evidences alone."""

from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest
from pytest import approx
from trials import SHIP, values

from manoeuvre_nn.diagnosis import decision as under_test
from manoeuvre_nn.diagnosis.decision import (
    MIN_GAIN_OF_UNKNOWN,
    PRIOR_NONE,
    PRIOR_OF_SIZE,
    PRIOR_UNKNOWN,
    base_rate,
    decide,
)
from manoeuvre_nn.diagnosis.search import MIN_GAIN_OF_SECOND, SearchResult
from manoeuvre_nn.diagnosis.unknown import ReceiverWander
from manoeuvre_nn.dynamics.base import Model
from manoeuvre_nn.effect.current import Current
from manoeuvre_nn.effect.local import SideForce
from manoeuvre_nn.effect.rudder import RudderOffset
from manoeuvre_nn.effect.sensors import HeadingBias, LogScale
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis, Hypothesis
from manoeuvre_nn.estimation.marginal_likelihood import MarginalLikelihood

EFFECTS = {e.name: e for e in (Current(SHIP), RudderOffset(SHIP), HeadingBias(SHIP), LogScale(SHIP))}
FORCE = {"force_kN": 200.0, "start_s": 60.0, "end_s": 120.0}
END = 0.6 * SHIP.particulars.length
EFFECTS |= {where: SideForce(SHIP, **FORCE, lever_m=m) for where, m in {"aft": -END, "ahead": END, "on": 50.0}.items()}
EFFECTS["wide"] = RudderOffset(SHIP, offset_deg=RudderOffset.declared[0].high)
CALM_EVIDENCE = -1000.0
AS_LIKELY = float(np.log(PRIOR_NONE / base_rate(1, 4)))
"""Log evidence at which one of four effects is as likely as calm water."""


def judged(evidence: float, *names: str) -> FittedHypothesis:
    effects = tuple(EFFECTS[n] for n in names)
    return FittedHypothesis(
        Hypothesis(effects, tuple(values(e) for e in effects)), evidence, np.zeros((1, 1)), np.eye(1)
    )


@pytest.fixture
def decided(monkeypatch):
    """Decides on log Bayes factors over calm water; the evidence of something unknown is given."""

    def run(factors: dict, unknown: float = -5.0, lacked: float | None = None):
        monkeypatch.setattr(under_test, "beside", lambda likelihood, hypothesis: likelihood)
        monkeypatch.setattr(under_test, "gain_by_coefficient_priors", lambda data_set, j: 0.0)
        monkeypatch.setattr(under_test, "short_formula", lambda likelihood, none: None)
        monkeypatch.setattr(under_test, "random_force", lambda *_: None)
        monkeypatch.setattr(under_test, "unknown_evidence", lambda *_: CALM_EVIDENCE + unknown)
        monkeypatch.setattr(under_test, "receiver_wander", lambda *_: ReceiverWander(0.0, 1.0, -np.inf))
        monkeypatch.setattr(under_test, "unknown_by_receiver", lambda *_: -np.inf)
        made = [judged(CALM_EVIDENCE + f, *key.split(" + ")) for key, f in factors.items()]
        made.sort(key=lambda j: -j.evidence)
        likelihood = object.__new__(MarginalLikelihood)
        levels = np.array([[0.003, lacked or 0.003]])
        likelihood.data_set = SimpleNamespace(dynamics=Mock(Model, noise=np.array(lacked is not None)), levels=levels)
        return decide(SearchResult(judged(CALM_EVIDENCE), made, likelihood))

    return run


SINGLES = {"current": 12.0, "rudder_offset": 3.0, "heading_bias": -1.0, "log_scale": -2.0}


@pytest.mark.parametrize("gain", [-3.0, 0.0, AS_LIKELY - 0.1, AS_LIKELY + 0.1, 20.0])
@pytest.mark.parametrize("unknown", [-5.0, MIN_GAIN_OF_UNKNOWN - 0.1, MIN_GAIN_OF_UNKNOWN + 0.1, 30.0])
@pytest.mark.parametrize("others", [-1.0, -30.0])
def test_single_causes_none_and_unknown_add_up_to_one(decided, gain, unknown, others):
    """The last pair is a name that something unknown speaks against."""
    v = decided(dict.fromkeys(SINGLES, others) | {"current": gain}, unknown)
    assert v.none + v.unknown + sum(v.effects.values()) == approx(1.0)
    assert all(0 <= p <= 1 for p in (v.none, v.unknown, *v.effects.values()))


def test_a_fitted_model_that_lacks_much_has_missed_something(decided):
    assert decided(SINGLES | {"current": -1.0}, lacked=0.15).strange
    assert not decided(SINGLES | {"current": -1.0}, lacked=0.05).strange


def test_a_pair_counts_for_both_of_its_effects(decided):
    v = decided(SINGLES | {"current + rudder_offset": 30.0})
    only = decided(SINGLES)
    assert v.best is not None and v.best.names == ("current", "rudder_offset")
    assert v.effects["current"] == approx(1.0, abs=1e-4) and v.effects["rudder_offset"] == approx(1.0, abs=1e-4)
    assert only.effects["rudder_offset"] < 0.01
    assert v.bayes == approx({"current": 30.0, "rudder_offset": 30.0, "heading_bias": -1.0, "log_scale": -2.0})


@pytest.mark.parametrize("where", ["aft", "ahead"])
def test_a_force_at_the_end_of_where_it_can_act_is_no_cause(decided, where):
    v = decided(SINGLES | {where: 40.0})
    assert v.best is not None and v.best.names == ("current",) and v.effects["side_force"] == 0.0
    v = decided(SINGLES | {f"current + {where}": 60.0, "current + rudder_offset": 30.0})
    assert (
        v.best is not None
        and v.best.names == ("current", "rudder_offset")
        and [len(c.names) for c in v.claims] == [2, 1]
    )


def test_a_force_on_board_and_a_steady_effect_on_its_bound_are(decided):
    for name, said in {"on": "side_force", "wide": "rudder_offset"}.items():
        v = decided({"current": 12.0, name: 40.0})
        assert v.best is not None and v.best.names == (said,) and v.effects[said] > 0.99


def test_a_second_effect_must_earn_its_place(decided):
    v = decided(SINGLES | {"current + rudder_offset": 12.0 + MIN_GAIN_OF_SECOND - 0.1})
    assert v.best is not None and v.best.names == ("current",) and v.effects["rudder_offset"] < 0.01


def test_odds_are_those_of_evidence_times_prior(decided):
    """Two singles far above calm water."""
    v = decided({"current": 30.0, "rudder_offset": 28.5, "heading_bias": -9.0}, unknown=28.0)
    assert v.effects["current"] / v.effects["rudder_offset"] == approx(np.exp(1.5))
    odds = np.exp(2.0) * PRIOR_OF_SIZE[0] / 3 / PRIOR_UNKNOWN
    assert v.effects["current"] / v.unknown == approx(odds)


def test_more_evidence_is_more_probability(decided):
    found = [decided(SINGLES | {"current": e}) for e in map(float, range(-4, 16))]
    probability = [v.effects["current"] for v in found]
    assert (np.diff(probability) > 0).all() and probability[0] < 0.1 and probability[-1] > 0.95
    assert (np.diff([v.none for v in found]) <= 0).all()


def test_what_is_likelier_than_calm_water_is_put_to_the_proof(decided):
    others = dict.fromkeys(SINGLES, -9.0)
    quiet, loud = (decided(others | {"current": AS_LIKELY + more}) for more in (-0.1, 0.1))
    assert (quiet.named, loud.named, quiet.strange) == (False, True, False)
    assert quiet.none > 0.5 > loud.none
    strange = decided(others, unknown=MIN_GAIN_OF_UNKNOWN + 0.1)
    assert strange.strange and not strange.named and strange.none < 0.5


def test_two_effects_need_more_than_one_to_be_put_to_the_proof(decided):
    def named(gain, *names):
        return decided(dict.fromkeys(SINGLES, -9.0) | {" + ".join(names): gain}).named

    assert not named(AS_LIKELY - 0.1, "current") and named(AS_LIKELY + 0.1, "current")
    both, least = ("current", "rudder_offset"), float(np.log(PRIOR_NONE / base_rate(2, 4)))
    assert not named(least - 0.1, *both) and named(least + 0.1, *both)


def test_nothing_judged_is_calm_water(decided):
    v = decided({})
    assert v.best is None and v.effects == {} and v.none > 0.9
