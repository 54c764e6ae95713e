"""Forces that act for a while, and winds whose course is random."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import torch
from pytest import approx
from tiers import mainly
from trials import CALM, CIRCLE, NOISE, PORT, SHIP, STEP, ZIGZAG, run_of, runs, sailed, values

from manoeuvre_nn.diagnosis import event_blocks
from manoeuvre_nn.diagnosis.claims import _about_own_states
from manoeuvre_nn.diagnosis.fits import at_rest, refine, single
from manoeuvre_nn.diagnosis.gusts import averaged_over_gusts, fitted_gusts
from manoeuvre_nn.diagnosis.locate import Shape, changes, residuals
from manoeuvre_nn.diagnosis.search import search
from manoeuvre_nn.diagnosis.windows import EventGrid
from manoeuvre_nn.effect.current import Current, TidalCurrent
from manoeuvre_nn.effect.local import SideForce
from manoeuvre_nn.effect.wind import GustyWind, SteadyWind, WindOnset
from manoeuvre_nn.estimation.data_set import WhitenedDataSet, whitened_data_set
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis, Hypothesis
from manoeuvre_nn.estimation.marginal_likelihood import MarginalLikelihood
from manoeuvre_nn.estimation.process_noise import markov_course, without_course

pytestmark = pytest.mark.usefixtures("unchecked_types")
NONE = Hypothesis((), ())
PUSH = SideForce(SHIP, force_kN=150.0, lever_m=30.0, start_s=83.0, end_s=157.0)
ONSET = WindOnset(SHIP, speed=14.0, from_deg=110.0, start_s=108.0)
STEADY = SteadyWind(SHIP, speed=14.0, from_deg=60.0)
GUSTS = 2.5


@cache
def stand(name: str) -> WhitenedDataSet:
    made = {"push": [PUSH], "onset": [ONSET], "steady": [STEADY]}
    return whitened_data_set(CALM, runs([ZIGZAG] if name == "onset" else [CIRCLE, ZIGZAG], made[name]))


class GustsOfRuns(GustyWind):
    """Gusts of each row of a batch its own: in every run the realisation goes on so many seconds later."""

    LATER = 3000.0

    def _course(self, s, series):
        if not s.u.ndim:  # tried once before the runs begin
            return 0.0 * s.u
        later = self.LATER * torch.arange(len(s.u)).to(s.u)
        return super()._course(replace(s, time=s.time + (later[:, None] if s.u.ndim > 1 else later)), series)


@cache
def gusty(memory: float = 30.0) -> tuple[WhitenedDataSet, float]:
    """Three runs in one wind, the gusts of each their own; and the size that these gusts have."""
    seed = int(memory // 30.0)  # others for those that last a minute
    wind = GustsOfRuns(SHIP, seed=seed, speed=14.0, from_deg=60.0, gust_sd=GUSTS, gust_time_s=memory)
    records = sailed([CIRCLE, ZIGZAG, PORT], [wind], STEP)
    made = [run_of(record, NOISE / STEP**0.5, k) for k, record in enumerate(records)]
    places = [torch.tensor(r.time + k * wind.LATER) / memory / wind.STEP for k, r in enumerate(records)]
    return whitened_data_set(CALM, made), float(GUSTS * wind.gusts[torch.cat(places).long()].std())


@cache
def found_gusty(memory: float = 30.0) -> tuple[MarginalLikelihood, FittedHypothesis, FittedHypothesis]:
    """The runs with gusts, and what is found there with a steady and with a gusty wind."""
    likelihood = MarginalLikelihood(gusty(memory)[0])
    steady = single(likelihood, SteadyWind(SHIP), likelihood.evaluate(NONE))
    return likelihood, steady, fitted_gusts(likelihood, steady, GustyWind(SHIP))


def test_the_window_of_a_force_is_found_to_a_block_and_by_the_fit_to_five_seconds():
    likelihood = MarginalLikelihood(stand("push"))
    none = likelihood.evaluate(NONE)
    first = next(EventGrid(likelihood, PUSH).best_windows(*none.best))
    assert first[:, 2:4] == approx(np.tile([83.0, 157.0], (2, 1)), abs=12.0)
    assert (first[:, 0] > 50.0).all(), "its side and size"


def test_a_wind_that_sets_in_is_found_with_its_time():
    likelihood = MarginalLikelihood(stand("onset"))
    none = likelihood.evaluate(NONE)
    found = single(likelihood, WindOnset(SHIP), none)
    assert found is not None and found.evidence > none.evidence + 20
    names = [p.name for p in found.hypothesis.effects[0].declared]
    for name, true, most in (("start_s", 108.0, 12.0), ("speed", 14.0, 4.0), ("from_deg", 110.0, 20.0)):
        k = names.index(name)
        error = np.sqrt(found.covariance[k, k])
        assert abs(found.hypothesis.values[0][0, k] - true) < 3 * error < most


def test_gusts_are_found_with_their_size_and_a_steady_wind_gains_nothing_by_them():
    _, steady, found = found_gusty()
    value, error = found.random["gust_sd"]
    assert found.evidence > steady.evidence + 20 and abs(value - gusty()[1]) < 2 * error < 1.2
    likelihood = MarginalLikelihood(stand("steady"))
    steady = refine(likelihood, Hypothesis((STEADY,), (values(STEADY, 2),)), *likelihood.evaluate(NONE).best)
    assert fitted_gusts(likelihood, steady, GustyWind(SHIP)).evidence < steady.evidence


@pytest.mark.parametrize("speed, from_deg", mainly(1, [(3.0, 240.0), (25.0, 150.0)]))
def test_the_mean_of_a_gusty_wind_is_found_though_the_steady_wind_was_taken_for_another(speed, from_deg):
    """A fit that knows no gusts may rest where one of them blew longest."""
    likelihood, steady, right = found_gusty()
    astray = values(SteadyWind(SHIP, speed=speed, from_deg=from_deg), 3)
    wrong = replace(steady, hypothesis=replace(steady.hypothesis, values=(astray,)))
    found = fitted_gusts(likelihood, wrong, GustyWind(SHIP))
    names = [p.name for p in found.hypothesis.effects[0].declared]
    mean = dict(zip(names, found.hypothesis.values[0][0], strict=True))
    assert found.evidence > right.evidence - 1
    assert abs(mean["speed"] - 14.0) < 3.0 and abs(mean["from_deg"] - 60.0) < 15.0


def test_about_its_own_states_a_gusty_wind_is_fitted_with_its_gusts():
    """Without them they are a random force, beside which the mean is known four times worse, or is another one."""
    likelihood, _, found = found_gusty()
    _, there = _about_own_states(likelihood.data_set, found)
    speed, direction = (there.hypothesis.vector()[k] for k in (0, 1))
    assert abs(speed - 14.0) < 2 * there.errors[0] < 4.0 and abs(direction - 60.0) < 2 * there.errors[1] < 3.0
    _, without = at_rest(likelihood.data_set, found)
    assert without.errors[1] > 3 * there.errors[1] and there.best[0] == without.best[0] != found.best[0]


@pytest.mark.slow  # the averages are taken in test_gusts_weighed.py
@pytest.mark.parametrize("memory", [60.0, 20.0])
def test_gusts_are_averaged_over_how_long_they_last(memory):
    """Those of a minute would be held for smaller ones of half a minute, and these for ones as well known."""
    likelihood, _, found = found_gusty(memory)
    there = averaged_over_gusts(*_about_own_states(likelihood.data_set, found))
    (size, error), (before, too_little) = there.random["gust_sd"], found.random["gust_sd"]
    names = [p.name for p in there.hypothesis.effects[0].declared]
    held = dict(zip(names, there.hypothesis.values[0][0], strict=True))
    assert abs(size - gusty(memory)[1]) < min(error, abs(before - gusty(memory)[1])) and 2 * error < 1.2
    assert held["gust_sd"] == size and held["gust_time_s"] == approx(memory, rel=0.4)
    assert error > 1.4 * too_little or memory == 20.0, "what lasts longer is seen less often"
    assert abs(there.hypothesis.vector()[1] - 60.0) < 2 * there.errors[1] < 4.0


@pytest.mark.slow
@pytest.mark.parametrize("speeds, change, tidal", [((0.4, 0.6, -0.1), 1.0, True), ((0.5, 0.5, 0.5), 0.0, False)])
def test_a_tide_is_told_by_its_change_and_the_speed_of_each_run_where_runs_show_them(speeds, change, tidal):
    made = []
    for seed, (trial, speed) in enumerate(zip((CIRCLE, ZIGZAG, PORT), speeds, strict=True)):
        stream = TidalCurrent(SHIP, speed=speed, toward_deg=100.0, change=change)
        made.append(run_of(sailed([trial], [stream], STEP)[0], NOISE / STEP**0.5, seed))
    tried = search(whitened_data_set(CALM, made), [Current(SHIP), TidalCurrent(SHIP)])
    best = tried.fitted[0]
    assert best.names == ("tidal_current" if tidal else "current",)
    assert ({j.names for j in tried.fitted} == {("current",), ("tidal_current",)}) == tidal
    if tidal:
        found, errors = best.hypothesis.vector(), best.errors
        assert (np.abs(found - [*speeds, 100.0, change]) < 3 * errors).all()
        assert (errors < [0.05, 0.05, 0.05, 3.0, 0.5]).all()


def test_an_event_is_looked_for_in_what_another_effect_leaves():
    """A strong current is given: the window is where the push is, not where calm water misses most."""
    drift = Current(SHIP, speed=1.2, toward_deg=100.0)
    likelihood = MarginalLikelihood(whitened_data_set(CALM, runs([CIRCLE, ZIGZAG], [PUSH, drift])))
    given = Hypothesis((drift,), (values(drift, 2),))
    level = likelihood.evaluate(NONE).best
    grid = EventGrid(likelihood, PUSH)
    alone, found = (next(grid.best_windows(*level, there)) for there in (None, given))
    assert found[:, 2:4] == approx(np.tile([83.0, 157.0], (2, 1)), abs=12.0)
    assert found[:, 2:4] != approx(alone[:, 2:4], abs=1.0)
    # What was made before, for other company or other noise, changes nothing.
    assert found == approx(next(EventGrid(likelihood, PUSH).best_windows(*level, given)), rel=1e-9)
    cut = event_blocks.block_columns(likelihood.data_set, 0, PUSH, values(PUSH, 1))
    for noise in (0, likelihood.start_level):
        white = likelihood.data_set.at(noise).white[0]
        anew = white.embed(cut.columns)
        assert cut.at(noise, white)[1] == approx(anew.dot(anew), rel=1e-9)


@pytest.mark.parametrize("sides, told", [((-2.0, -2.2), "even"), ((2.0, -1.8), "odd"), ((0.1, 3.0), "mixed"), ((), "")])
def test_port_and_starboard_turns_are_compared(sides, told):
    assert Shape(1, np.ones(3), sides=sides).parity == told


def noise(n: int, seed: int = 0) -> np.ndarray:
    """Missing force in standard deviations, as a smoother leaves it: correlated over some ten seconds."""
    white = np.random.default_rng(seed).standard_normal((n + 10, 3))
    return np.stack([np.convolve(w, np.ones(11) / np.sqrt(11), mode="valid") for w in white.T], axis=-1)


def test_a_force_in_the_middle_is_one_window():
    time, force = np.arange(400.0), noise(400)
    force[150:260, 1] += 8.0
    (window,) = changes(time, force, np.ones((400, 3)))
    assert window == approx((150.0, 260.0), abs=10.0)


def test_a_force_with_two_equations_is_still_one_window():
    time, force = np.arange(0.0, 400.0, 0.5), noise(800)
    force[300:520, 1:] += [8.0, -8.0]
    (window,) = changes(time, force, np.ones((800, 3)))
    assert window == approx((150.0, 260.0), abs=10.0)


@pytest.mark.parametrize("size", [0.0, 8.0])
@pytest.mark.parametrize("seed", range(5))
def test_a_force_that_is_missing_throughout_or_nowhere_has_no_window(size, seed):
    assert changes(np.arange(400.0), noise(400, seed) + [0.0, size, 0.0], np.ones((400, 3))) == []


@pytest.mark.parametrize("size, found", [(0.02, False), (2.0, True)])
def test_exact_recordings_show_no_window_of_a_force_of_a_hundredth_of_its_standard_error(size, found):
    force = 1e-4 * noise(400, 1)
    force[100:200, 1] += size
    assert bool(changes(np.arange(400.0), force, np.ones((400, 3)))) is found


def test_short_runs_have_no_windows():
    force = noise(100)
    force[40:70] += 20.0
    assert changes(np.arange(100.0), force, np.ones((100, 3))) == []


def test_the_missing_force_is_the_one_that_acted_and_is_gone_with_the_repair():
    stood, truth = stand("push"), Hypothesis((PUSH,), (values(PUSH, 2),))
    for r in residuals(stood, truth):
        inside, outside = (r.time > 95) & (r.time < 145), (r.time < 70) | (r.time > 170)
        # kN and MN m: 150 kN, 30 m forward.
        assert r.force[inside, 1].mean() == approx(150.0, rel=0.25)
        assert r.force[inside, 2].mean() == approx(4.5, rel=0.25)
        assert np.abs(r.force[outside, 1].mean()) < 40 and np.abs(r.left[inside, 1].mean()) < 40
        z = (r.left / r.error)[10:-10]
        assert 0.3 < np.sqrt(np.mean(z**2)) < 1.5, "what is left is what the smoother is unsure of"
        assert (r.error > 0).all() and r.force.shape == r.left.shape == r.error.shape


def test_what_a_stream_or_a_sensor_does_is_no_force():
    current = Current(SHIP, speed=1.0, toward_deg=200.0)
    stood = whitened_data_set(CALM, runs([CIRCLE], [current]))
    (found,) = residuals(stood, Hypothesis((current,), (values(current),)))
    (blind,) = residuals(stood, NONE)
    assert found.force == approx(found.left)
    assert np.sqrt(np.mean(blind.force[:, 1] ** 2)) > 3 * np.sqrt(np.mean(found.force[:, 1] ** 2))


def test_what_acts_throughout_began_long_before_any_ramp():
    assert event_blocks.ALWAYS < -10 * max(event_blocks.LONG_RAMPS)


def test_a_markov_course_has_its_covariance_and_is_integrated_out_as_any_columns_are():
    """At its knots exp(-|t| / T); of data y = C a + e with a of s.d. s, the log density is that of 1 + s^2 C C^T."""
    time = np.arange(0.0, 61.0)
    course = markov_course(time, 10.0, 30.0)
    apart = np.abs(time[::10, None] - time[::10])
    assert (course @ course.T)[::10, ::10] == approx(np.exp(-apart / 30.0), abs=1e-6)
    y = np.random.default_rng(0).standard_normal((len(time), 1))
    left, norm = without_course(y.T @ y, course.T @ course, course.T @ y, 2.0)
    covariance = np.eye(len(time)) + 4.0 * course @ course.T
    assert left == approx(y.T @ np.linalg.solve(covariance, y)) and norm == approx(
        -0.5 * np.linalg.slogdet(covariance)[1]
    )
