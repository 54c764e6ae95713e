"""Gusts: how often their wind is fitted again, how large and how lasting they may be, and what noise is beside them."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from pytest import approx
from trials import CALM, SHIP, values

from manoeuvre_nn.diagnosis import gusts
from manoeuvre_nn.effect.wind import GustyWind
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis, Hypothesis

pytestmark = pytest.mark.usefixtures("unchecked_types")
WIND = GustyWind(SHIP, speed=12.0, from_deg=60.0, gust_sd=2.0, gust_time_s=30.0)


def found(evidence: float = 0.0) -> FittedHypothesis:
    """The wind with its gusts in two runs."""
    h = Hypothesis((WIND,), (values(WIND, 2),))
    return FittedHypothesis(h, evidence, np.zeros((1, 1)), np.eye(len(h.unknowns())))


@pytest.mark.parametrize("gains, kept, count", [
    ((0.47, 9.0), 0.0, 1), ((0.53, 0.47), 0.53, 2), ((0.53, 0.53, 9.0), 1.06, 2), ((-1.0,), 0.0, 1)
])  # fmt: skip
def test_a_wind_with_gusts_is_fitted_up_to_three_times_as_long_as_it_gains_a_half(gains, kept, count):
    evidences = iter(np.cumsum(gains).tolist())
    made = []
    best = gusts._repeated(lambda h: made.append(found(next(evidences))) or made[-1], found(), lambda some: some)
    assert best.evidence == approx(kept) and len(made) == count


@pytest.mark.parametrize("larger, longer", [(1, 1), (1, -1), (-1, 1), (-1, -1)])
def test_gusts_may_be_twice_as_large_or_half_as_large_as_they_were_found_and_last_half_or_twice_as_long(
    monkeypatch, larger, longer
):
    """Where the runs ask for the end of what is tried: e^.75 = 2.1 times 2 m/s, or over it; 60 s, or 15."""
    monkeypatch.setattr(gusts, "MarginalLikelihood", lambda data_set: data_set)
    monkeypatch.setattr(gusts, "beside", lambda likelihood, h: likelihood)
    monkeypatch.setattr(gusts, "_level_beside", lambda data_set, fitted: 0)
    monkeypatch.setattr(gusts, "_at_kinds", lambda likelihood, h, wind, kinds, *levels: [
        found(1e4 * (larger * np.log(kind.size) + longer * np.log(kind.memory))) for kind in kinds
    ])  # fmt: skip
    there = gusts.averaged_over_gusts(SimpleNamespace(dynamics=CALM), found(7.0))
    told = dict(zip((p.name for p in WIND.declared), there.hypothesis.values[0][0], strict=True))
    assert told["gust_sd"] == approx(2.0 * np.exp(0.75 * larger)) == there.random["gust_sd"][0]
    assert told["gust_time_s"] == approx(30.0 * 2.0**longer) and there.evidence == 7.0


def test_where_runs_do_not_tell_gusts_stay_as_lasting_as_is_usual_and_their_size_is_uncertain_by_half(monkeypatch):
    monkeypatch.setattr(gusts, "MarginalLikelihood", lambda data_set: data_set)
    monkeypatch.setattr(gusts, "beside", lambda likelihood, h: likelihood)
    monkeypatch.setattr(gusts, "_level_beside", lambda data_set, fitted: 0)
    monkeypatch.setattr(gusts, "_at_kinds", lambda likelihood, h, wind, kinds, *levels: [found() for _ in kinds])
    there = gusts.averaged_over_gusts(SimpleNamespace(dynamics=CALM), replace(found(), evidence=7.0))
    told = dict(zip((p.name for p in WIND.declared), there.hypothesis.values[0][0], strict=True))
    size, error = there.random["gust_sd"]
    assert told["gust_time_s"] == approx(30.0)
    assert size == approx(2.0 * np.sinh(0.75) / 0.75, rel=0.03) and error == approx(0.5 * size, rel=0.1)


@pytest.mark.parametrize("size, error, faint", [(1.0, 0.09, True), (1.0, 0.11, False), (1.3, 0.01, False)])
def test_gusts_are_faint_below_a_tenth_of_the_mean_wind_give_or_take_two_standard_errors(size, error, faint):
    """Of 12 m/s: the open sea has .06 (1 + .043 U) = .091, 1.09 m/s, at all frequencies."""
    assert gusts.fainter_than_at_sea(replace(found(), random={"gust_sd": (size, error)})) is faint


def test_gusts_are_tried_at_a_tenth_to_a_third_of_the_wind_and_last_half_a_minute():
    sizes = [g.size for g in gusts.AT_SEA]
    assert sizes[0] == approx(0.1) and sizes[-1] == approx(1 / 3, rel=0.05)
    assert np.ptp(np.diff(np.log(sizes))) < 0.06, "even on a logarithmic scale, as the mean over sizes takes them"
    assert all(20.0 <= g.memory <= 60.0 and g.across == 0.0 for g in gusts.AT_SEA)
    on_ponds = np.array([g.size for g in gusts.ON_PONDS]).reshape(2, 3)
    assert np.ptp(np.diff(np.log(on_ponds), axis=1)) < 0.06 and (on_ponds[0] == on_ponds[1]).all()
    assert {(g.memory, g.across) for g in gusts.ON_PONDS} == {(10.0, 1.0), (5.0, 1.0)}
