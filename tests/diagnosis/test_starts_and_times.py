"""Where fits begin and where they are looked for again: starts of values, other directions, times of events."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch
from pytest import approx
from scipy.special import logsumexp
from test_hypotheses_judged import hypothesis
from trials import SHIP

from manoeuvre_nn.diagnosis import fits, windows
from manoeuvre_nn.diagnosis.event_blocks import Intervals
from manoeuvre_nn.effect.local import SideForce, Tow
from manoeuvre_nn.effect.propulsion import ThrustLoss
from manoeuvre_nn.effect.rudder import RudderOffset
from manoeuvre_nn.effect.wind import SteadyWind
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis, Hypothesis

pytestmark = pytest.mark.usefixtures("unchecked_types")


# Values ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("count, begun", [(4, [1.0, 2.0, 3.0, 4.0]), (5, [4.0, 3.0])])
def test_an_effect_with_more_than_four_starts_is_fitted_from_the_two_best_of_them(count, begun):
    declared = [SimpleNamespace(starts=tuple(np.arange(1.0, 1.0 + count)), form=False, null=0.0)]
    effect = SimpleNamespace(name="some", timed=[], declared=declared, null=lambda: torch.zeros(1))
    likelihood = SimpleNamespace(
        data_set=SimpleNamespace(runs=[0, 1], campaigns=()),
        columns=lambda h: h,
        posterior=lambda h, level: SimpleNamespace(evidence=[0.0, -abs(float(h.values[0][0, 0]) - 3.9)]),
    )
    starts = fits._starts(likelihood, effect, 0, 1)
    assert [h.values[0].tolist() for h in starts] == [[[start]] * 2 for start in begun]


def wind(direction: float, evidence: float = 9.0) -> FittedHypothesis:
    """One that is known to a degree."""
    h = hypothesis(SteadyWind(SHIP, speed=10.0, from_deg=direction))
    return FittedHypothesis(h, evidence, np.zeros((1, 1)), np.eye(len(h.unknowns())))


@pytest.mark.parametrize("lost, begun", [(0.95, 200.0), (1.05, 100.0)])
def test_a_mean_that_is_less_likely_by_more_than_one_than_what_was_fitted_is_not_gone_on_from(monkeypatch, lost, begun):
    """Fitted was 100 deg, the mean over all levels of noise is 200 deg; where the next fit begins."""
    at, mean, started = wind(100.0).hypothesis, wind(200.0), list[float]()

    def improve(h: Hypothesis, level: int, scatter: int, rounds: int = 2) -> tuple[Hypothesis, float]:
        direction = float(h.values[0][0, 1])
        started.append(direction)
        return h, 0.0 if direction == 100.0 else -lost

    there = SimpleNamespace(improve=improve, evaluate=lambda h, around, fine: mean)
    monkeypatch.setattr(fits, "beside", lambda likelihood, h: there)
    fits.refine(there, at, 2, 2, placing=False)
    assert started[-1] == begun


@pytest.mark.parametrize("turned, rests", [(-45.0, 60.0), (45.0, 140.0), (180.0, 290.0)])
@pytest.mark.parametrize("behind, counts", [(4.8, True), (5.2, False)])
def test_a_wind_that_also_rests_an_eighth_of_a_turn_aside_or_opposite_counts_up_to_five_behind(
    monkeypatch, turned, rests, behind, counts
):
    """Its weight is exp(-4.8), 0.8 %."""
    monkeypatch.setattr(fits, "MarginalLikelihood", lambda data_set: data_set)
    elsewhere = {(100.0 + turned) % 360.0: wind(rests, 9.0 - behind)}
    monkeypatch.setattr(
        fits, "refine", lambda _, h, *at, placing: elsewhere.get(h.values[0][0, 1] % 360.0, wind(100.0, 9.0))
    )
    found = fits.over_directions(SimpleNamespace(), wind(100.0))
    share = np.exp(-behind) / (1 + np.exp(-behind)) if counts else 0.0
    off = (rests - 100.0 + 180.0) % 360.0 - 180.0
    assert found.hypothesis.vector()[1] == approx(100.0 + share * off, abs=1e-6)


# Times ----------------------------------------------------------------------------------------------------------------


class Told:
    """A run in three intervals, each row of values with the log Bayes factor of its own."""

    def __init__(self, gains: np.ndarray) -> None:
        self.right, self.gram = gains[:, None] * np.array([0.01, 1.0, 0.02]), np.zeros((len(gains), 3, 3))
        self.edges, self.scales = np.array([0.0, 40.0, 100.0, 140.0, 200.0, 240.0]), (1.0, 1.0)

    def intervals(self, may_last: bool, ramp: float) -> Intervals:
        return Intervals(self.edges.reshape(3, 2), np.eye(3), np.zeros(3))

    def ratios(self, row: int | slice, shares: np.ndarray, there: np.ndarray | None = None) -> np.ndarray:
        return self.right[row] @ shares.T - (0.0 if there is None else 1e9 * (shares @ there))


def test_a_fit_of_an_event_begins_at_its_three_best_directions_and_levers_each_at_its_best_size(monkeypatch):
    effect = Tow(SHIP)
    rows, names = windows._grid(effect), [p.name for p in effect.declared]
    size, angle, lever = (rows[:, names.index(name)] for name in ("force_kN", "angle_deg", "lever_m"))
    ahead = lever.max()
    gains = 40.0 - 0.01 * angle - np.where(lever == ahead, 0.0, 3.0) - np.abs(np.log2(np.abs(size) / 100.0))
    monkeypatch.setattr(windows, "block_columns", lambda *_: None)
    monkeypatch.setattr(windows, "in_blocks", lambda *_: [Told(gains)])
    grid = windows.EventGrid(SimpleNamespace(data_set=SimpleNamespace(runs=[0])), effect)
    found = [dict(zip(names, values[0].tolist(), strict=True)) for values in grid.best_windows(0, 0)]
    best = rows[(lever == ahead)]
    nearest = best[np.abs(np.log2(np.abs(best[:, 0]) / 100.0)).argmin(), 0]
    assert [(one["angle_deg"], one["lever_m"]) for one in found] == [(a, ahead) for a in sorted(set(angle))[:3]]
    assert all(abs(one["force_kN"]) == approx(abs(nearest)) for one in found)
    assert all((one["start_s"], one["end_s"]) == (100.0, 140.0) for one in found)


def offered(monkeypatch, times, gain: float) -> tuple[list[Hypothesis], bool]:
    """What is fitted where a force from 50 to 150 s is offered other times; whether it takes them for their gain."""
    force = SideForce(SHIP, force_kN=300.0, start_s=50.0, end_s=150.0)
    there, fitted = Hypothesis((force,), (force.values.numpy()[None],)), []
    monkeypatch.setattr(windows, "block_columns", lambda *_: None)
    monkeypatch.setattr(windows, "in_blocks", lambda *_: [None])
    monkeypatch.setattr(windows, "_sets_of_times", lambda *_, every: (0.0, [(times,)]))
    monkeypatch.setattr(
        windows, "_score", lambda _, h, *at: 0.0 if windows.times_of(force, h.values[0][0])[0][0] == 50.0 else gain
    )
    likelihood = SimpleNamespace(data_set=None, improve=lambda h, *at, rounds: fitted.append(h) or (h, 0.0))
    found = windows.replaced(likelihood, there, 0, 0)
    return fitted, found is not there


@pytest.mark.parametrize("gain, taken", [(0.47, False), (0.53, True)])
def test_other_times_of_an_event_must_gain_half_a_unit_of_log_evidence(monkeypatch, gain, taken):
    assert offered(monkeypatch, (250.0, 300.0), gain)[1] is taken


@pytest.mark.parametrize("start, tried", [(64.0, False), (66.0, True)])
def test_times_near_those_that_an_event_has_are_not_fitted_again(monkeypatch, start, tried):
    fitted, _ = offered(monkeypatch, (start, 150.0), 9.0)
    assert bool(fitted) is tried


def test_an_event_is_laid_on_blocks_with_the_ramp_that_it_has_and_on_a_grid_with_that_of_its_start():
    for kind in (SideForce, ThrustLoss, Tow):
        effect = kind(SHIP, ramp_s=70.0)
        column = [p.name for p in effect.declared].index("ramp_s")
        assert windows._ramp(effect, effect.values.numpy()) == 70.0
        assert set(windows._grid(effect)[:, column]) == {effect.declared[column].starts[0]} == {15.0}
    offset = RudderOffset(SHIP, offset_deg=2.0)
    assert windows._ramp(offset, offset.values.numpy()) == 1.0, "a step"


def test_the_evidence_of_one_interval_is_the_mean_of_all():
    gates = SimpleNamespace(shares=np.eye(3), prior=np.full(3, -np.log(3.0)))
    expected = logsumexp([0.2, 20.0, 0.4]) - np.log(3.0)
    assert windows._evidence(Told(np.array([20.0])), 0, gates) == approx(expected)
