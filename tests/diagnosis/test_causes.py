"""What is told of a fitted hypothesis: its numbers, and when its events act."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from pytest import approx
from searches import fitted
from trials import SHIP, values

from manoeuvre_nn.core.recording import CAMPAIGN
from manoeuvre_nn.diagnosis import causes
from manoeuvre_nn.diagnosis.causes import _spans, _values_of, _when, causes_of
from manoeuvre_nn.diagnosis.decision import Decision
from manoeuvre_nn.effect.common import RAMP
from manoeuvre_nn.effect.current import Current, TidalCurrent
from manoeuvre_nn.effect.local import BowThruster, SideForce
from manoeuvre_nn.effect.wind import GustyWind
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis, Hypothesis

pytestmark = pytest.mark.usefixtures("unchecked_types")


def told(h: Hypothesis, error: float = 0.5, **more: object) -> FittedHypothesis:
    """A hypothesis whose numbers have standard errors of so much, twice so much, thrice, ..."""
    errors = error * np.arange(1, 1 + len(h.vector()))
    return FittedHypothesis(h, 9.0, np.zeros((1, 1)), np.diag(errors**2), **more)  # type: ignore[arg-type]


def runs(*campaigns: str) -> list[SimpleNamespace]:
    return [
        SimpleNamespace(name=f"r{k}", meta={CAMPAIGN: c} if c else {}, time=np.linspace(0.0, 900.0, 10))
        for k, c in enumerate(campaigns)
    ]


def pushed(*starts: float, ramp: float = 40.0) -> Hypothesis:
    """A side force that acts once in every run, for 200 s from these times [s]."""
    effect = SideForce(SHIP, force_kN=150.0, lever_m=30.0, ramp_s=ramp)
    rows = np.repeat(values(effect), len(starts), axis=0)
    first, second, *others = effect.timed
    rows[:, others] = np.inf
    rows[:, first], rows[:, second] = starts, np.array(starts) + 200.0
    return Hypothesis((effect,), (rows,))


def test_numbers_are_told_with_their_errors_without_times_and_what_is_uncertain_of_a_formula():
    found = _values_of(told(pushed(300.0)), 0)
    assert [(v.name, v.value, v.error) for v in found] == [("force_kN", 150.0, 0.5), ("lever_m", 30.0, 1.0),
                                                           ("ramp_s", 40.0, approx(2.5))]  # fmt: skip
    thruster = BowThruster(SHIP, force_kN=90.0, ramp_s=RAMP.low)
    (force,) = _values_of(told(Hypothesis((thruster,), (values(thruster),))), 0)
    assert (force.name, force.low, force.high) == ("force_kN", -3000.0, 3000.0)


def test_a_step_has_no_ramp_that_could_be_told():
    assert [v.name for v in _values_of(told(pushed(300.0, ramp=RAMP.low)), 0)] == ["force_kN", "lever_m"]


def test_numbers_of_another_effect_are_not_told():
    both = pushed(300.0).joined(fitted(0.0, "log_scale").hypothesis)
    assert [v.name for v in _values_of(told(both), 1)] == ["factor"]


def test_each_campaign_has_its_own_numbers_under_its_name():
    effect = Current(SHIP, speed=0.5, toward_deg=30.0)
    rows = np.repeat(values(effect), 3, axis=0)
    rows[2] = 0.8, 120.0
    h = Hypothesis((effect,), (rows,), campaigns=(0, 0, 1))
    found = [(v.name, v.value, v.campaign, v.period) for v in _values_of(told(h), 0, runs("May", "May", "June"))]
    assert found == [("speed", 0.5, "May", 0.0), ("speed", 0.8, "June", 0.0),
                     ("toward_deg", 30.0, "May", 360.0), ("toward_deg", 120.0, "June", 360.0)]  # fmt: skip
    alone = Hypothesis((effect,), (rows[:2],))
    assert [v.campaign for v in _values_of(told(alone), 0, runs("May", "May"))] == ["", ""]


def test_the_size_of_a_random_process_is_told_where_it_was_found():
    effect = GustyWind(SHIP, speed=12.0, from_deg=40.0)
    size = next(p.name for p in effect.declared if p.random)
    h = Hypothesis((effect,), (values(effect),))
    assert size not in [v.name for v in _values_of(told(h), 0)]
    last = _values_of(told(h, random={size: (2.5, 0.3)}), 0)[-1]
    assert (last.name, last.value, last.error) == (size, 2.5, 0.3)


def test_of_what_each_run_has_its_own_only_the_first_runs_is_told():
    effect = TidalCurrent(SHIP)
    rows = np.repeat(values(effect), 2, axis=0)
    speed = next(k for k, p in enumerate(effect.declared) if p.per_run)
    rows[:, speed] = 0.4, -0.7
    own = [v.value for v in _values_of(told(Hypothesis((effect,), (rows,))), 0) if v.by_run]
    assert own == [0.4]


def test_times_are_those_between_which_half_of_it_acts_and_without_a_ramp():
    h, asked = pushed(300.0, 500.0), runs("", "")
    covariance = told(h).covariance
    errors = dict(zip([(f.column, f.runs[0]) for f in h.unknowns()], np.sqrt(np.diag(covariance)), strict=True))
    start, end = h.effects[0].timed[:2]
    spans = _spans(h, 0, covariance, asked, None)
    assert spans == {
        f"r{run}": [((first, first + 200.0), (errors[start, run], errors[end, run]))]
        for run, first in enumerate((300.0, 500.0))
    }


def test_with_a_clear_ramp_they_begin_and_end_with_it_and_their_errors_have_half_of_its():
    h, asked = pushed(300.0), runs("")
    found = told(h)
    ramp = next(v for v in _values_of(found, 0) if v.name == RAMP.name)
    (((first, last), (of_first, of_last)),) = _spans(h, 0, found.covariance, asked, ramp)["r0"]
    assert (first, last) == (280.0, 520.0)
    alone = _spans(h, 0, found.covariance, asked, None)["r0"][0][1]
    assert (of_first, of_last) == approx(np.hypot(alone, ramp.error / 2))


def test_what_begins_before_a_run_or_outlasts_it_has_no_error_there_and_what_comes_after_it_no_time():
    h, asked = pushed(10.0, 800.0, 905.0, np.inf), runs("", "", "", "")
    ramp = next(v for v in _values_of(told(h), 0) if v.name == RAMP.name)
    spans = _spans(h, 0, told(h).covariance, asked, ramp)
    assert spans["r0"][0][0] == (0.0, 230.0) and np.isnan(spans["r0"][0][1][0]) and spans["r0"][0][1][1] > 0
    assert spans["r1"][0][0] == (780.0, 900.0) and np.isnan(spans["r1"][0][1][1]) and spans["r1"][0][1][0] > 0
    assert spans["r2"][0][0] == (885.0, 900.0) and spans["r3"] == [], "half of the ramp of the third is in its run"
    assert _spans(h, 0, told(h).covariance, asked, None)["r2"] == []
    none = pushed(300.0)
    none.values[0][0, none.effects[0].timed[1]] = 300.0
    assert _spans(none, 0, told(none).covariance, asked[:1], None)["r0"] == [], "it ends where it begins"


def test_an_event_that_acts_twice_has_its_times_in_their_order():
    h = pushed(500.0)
    third, fourth = h.effects[0].timed[2:4]
    h.values[0][0, third], h.values[0][0, fourth] = 100.0, 160.0
    assert [times for times, _ in _spans(h, 0, told(h).covariance, runs(""), None)["r0"]] == [
        (100.0, 160.0), (500.0, 700.0)
    ]  # fmt: skip


def test_held_out_runs_have_times_of_what_was_proved_there(monkeypatch):
    h = pushed(300.0)
    other = SimpleNamespace(name="held out", meta={}, time=np.linspace(0.0, 900.0, 10))
    asked, nothing = (SimpleNamespace(case=SimpleNamespace(fitted=runs(""), held_out=some)) for some in ([other], []))
    there = told(pushed(450.0))
    monkeypatch.setattr(causes, "in_held_out_runs", lambda question, fitted: there)
    for proved, names in ((True, {"r0", "held out"}), (False, {"r0"})):
        found = _when(asked, told(h), 0, proved)
        assert found is not None and set(found) == names
    assert [times for times, _ in _when(asked, told(h), 0, True)["held out"]] == [(430.0, 670.0)]
    assert set(_when(nothing, told(h), 0, True)) == {"r0"}, "no run was held out"
    assert _when(asked, fitted(9.0, "current"), 0, True) is None, "it acts throughout"


def answers(level: float = 1.0) -> tuple[FittedHypothesis, list]:
    """What was proved, and the causes told beside a likelier pair of it."""
    chosen, *rivals = fitted(9.0, "current"), fitted(8.0, "log_scale"), fitted(7.0, "heading_bias")
    pair = fitted(12.0, "current", "log_scale")
    pair = replace(pair, covariance=4 * pair.covariance)
    asked = SimpleNamespace(case=SimpleNamespace(fitted=runs(""), held_out=()))
    effects = {"heading_bias": 0.2, "log_scale": 0.9, "current": 0.6}
    verdict = Decision(True, False, 0.0, 0.0, effects, chosen, dict.fromkeys(effects, 1.0))
    data_set = SimpleNamespace(levels=np.array([[9.0, 9.0], [0.0, level]]))
    calm = SimpleNamespace(evaluate=lambda *_, **__: replace(chosen, best=(1, 0)), data_set=data_set)
    tried = SimpleNamespace(fitted=[chosen, *rivals, pair], likelihood=calm)
    found = causes_of(asked, tried, verdict, chosen)  # type: ignore[arg-type]
    assert [c.probability for c in found] == [verdict.probability(c.name, chosen) for c in found]
    return chosen, found


def test_what_was_proved_comes_first_then_the_likeliest():
    assert [c.name for c in answers()[1]] == ["current", "log_scale", "heading_bias", "unknown"]


def test_numbers_are_those_of_what_was_proved_and_of_others_where_they_are_likeliest():
    chosen, found = answers()
    assert found[0].parameters == _values_of(chosen, 0), "not those of the likelier pair"
    assert [v.error for v in found[1].parameters] == [2.0], "the pair's, not those of the log alone"


@pytest.mark.parametrize("level, where", [(0.0006, ("Y", "N")), (0.0004, ("kinematics",))])
def test_something_unknown_acts_where_calm_water_needs_process_noise(level, where):
    assert answers(level)[1][-1].equations == where
