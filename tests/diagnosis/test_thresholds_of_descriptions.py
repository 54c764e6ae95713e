"""Limits in what is said of something unknown, of events and of runs to sail, each side of them."""

from dataclasses import replace
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pandas as pd
import pytest
import torch
from pytest import approx
from scipy.stats import chi2, norm
from searches import fitted, found
from trials import SHIP, values

from manoeuvre_nn.diagnosis import causes, gusts, locate, predictive, unknown, words
from manoeuvre_nn.diagnosis.decision import Decision
from manoeuvre_nn.diagnosis.remainder import is_left
from manoeuvre_nn.diagnosis.result import Residual
from manoeuvre_nn.diagnosis.unknown import ReceiverWander
from manoeuvre_nn.effect.common import RAMP
from manoeuvre_nn.effect.current import Current
from manoeuvre_nn.effect.formula import Formula
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis, Hypothesis
from manoeuvre_nn.estimation.process_noise import PROCESS_LEVELS, ProcessLevels

pytestmark = pytest.mark.usefixtures("unchecked_types")


# Something unknown ---------------------------------------------------------------------------------------------------


def instruments(*inflation: float, derived=(), error: float = 4.0) -> SimpleNamespace:
    """Runs whose position east has slow errors of so many times the usual variance, and an error [m]."""
    run = SimpleNamespace(run=SimpleNamespace(meta={"derived": derived}))
    factors = [np.array([1.0, f] + 6 * [1.0]) for f in inflation]
    return SimpleNamespace(
        runs=[SimpleNamespace(linearised=run, inflation=f, noise=error * np.sqrt(f)) for f in factors]
    )


@pytest.mark.parametrize("inflation, evidence", [
    ((3.8, 3.8), 0.0), ((4.2, 3.8), 12.0), ((4.2, 4.2), 24.0), ((4.2, 1.0, 1.0), 0.0), ((4.2, 4.2, 1.0), 24.0),
])  # fmt: skip
def test_a_sensor_with_slow_errors_in_half_of_the_runs_is_strange_by_twelve_a_run(inflation, evidence):
    assert unknown._strange_sensors(instruments(*inflation)) == approx(evidence, rel=0.04)


@pytest.mark.parametrize("error, evidence", [(3.2, 0.0), (3.3, 24.0)])
def test_positions_that_wander_no_more_than_those_of_a_usual_receiver_are_not_strange(error, evidence):
    assert unknown._strange_sensors(instruments(20.0, 20.0, error=error)) == evidence


def test_a_velocity_taken_from_positions_is_no_strange_sensor():
    assert unknown._strange_sensors(instruments(9.0, 9.0, derived=("y",))) == 0.0


@pytest.mark.parametrize("level, left", [(0.0095, False), (0.0105, True)])
def test_a_network_is_tried_where_more_than_a_hundredth_is_left(level, left):
    assert is_left(found(levels=[(0.0, level)]).likelihood, fitted(0.0)) is left


def test_something_unknown_is_calm_water_with_any_process_noise_and_its_formula_is_half_of_it(monkeypatch):
    """With process noise of any size, as likely one as another, calm water has a log evidence of 7."""
    data_set, judged = instruments(1.0), []
    data_set.levels = PROCESS_LEVELS

    def evaluate(hypothesis, process_prior, around):
        judged.append((hypothesis.effects, process_prior, around))
        return fitted(7.0, best=(0, 0))

    likelihood, inside = SimpleNamespace(data_set=data_set, evaluate=evaluate), fitted(0.0, best=(16, 0))
    assert unknown.unknown_evidence(likelihood, inside, None) == approx(7.0 - np.log(2))
    assert judged == [((), None, 16)]
    with_rule = unknown.unknown_evidence(likelihood, inside, fitted(9.0))
    assert with_rule == approx(np.logaddexp(7.0, 9.0) - np.log(2))
    # What has no rule may be loose in all equations or random in one.
    at_random = unknown.unknown_evidence(likelihood, inside, None, random=SimpleNamespace(evidence=12.0))
    assert at_random == approx(np.logaddexp(7.0, 12.0) - np.log(4))
    all_three = unknown.unknown_evidence(likelihood, inside, fitted(9.0), random=SimpleNamespace(evidence=12.0))
    assert all_three == approx(np.logaddexp(at_random, 9.0 - np.log(2)))
    # By any prior of coefficients it gains what it gains beyond calm water; the formula's evidence is weighed already.
    asked = []
    monkeypatch.setattr(unknown, "gain_by_coefficient_priors", lambda data_set, *how: asked.append(how) or -0.5)
    weighed = unknown.unknown_evidence(likelihood, inside, fitted(9.0), calm=-2.0)
    assert weighed == approx(np.logaddexp(8.5, 9.0) - np.log(2))
    ((about, levels, process_prior),) = asked
    assert about is inside and levels == PROCESS_LEVELS.beside(0) and process_prior is None


@pytest.mark.parametrize("gain, axes", [(2.8, (2,)), (3.2, (2, 0))])
def test_a_random_force_is_judged_over_all_sizes_and_times_that_it_could_have(monkeypatch, gain, axes):
    """A Gaussian peak of known width where the fit begins: Laplace's method is exact, a third for each equation.

    Of the noise beside one other size, the next larger in surge, is half as likely.
    """
    sds, start = np.array([0.2, 0.3]), np.log([0.15, 40.0])
    beside = {6: 0.0, PROCESS_LEVELS.point(1, 6): np.log(0.5)}

    def evidence(these, x, level=6):
        best = {(2,): 50.0, (2, 0): 50.0 + gain}.get(these, 20.0)
        return best - 0.5 * float((((x - start) / sds) ** 2).sum()) + beside.get(level, -50.0)

    process = SimpleNamespace(evidence=evidence, longest=480.0, least=PROCESS_LEVELS.sizes[0], level=6)
    monkeypatch.setattr(unknown, "_RandomProcess", lambda likelihood, level, scatters: process)
    monkeypatch.setattr(unknown, "process_time", lambda dynamics: 40.0)
    runs = SimpleNamespace(data_set=SimpleNamespace(dynamics=None, levels=PROCESS_LEVELS))
    course = unknown.random_force(runs, fitted(0.0, best=(6, 0)))
    volume = np.log(3.0 / 0.003) * np.log(480.0 / 2.0) * 3
    assert course.evidence == approx(50.0 + np.log(1.5 * 2 * np.pi * sds.prod() / volume), abs=1e-6)
    assert course.axes == axes and course.errors == approx(sds) and (course.size, course.time) == approx((0.15, 40.0))


WINDS = [  # whether the ship is a model, evidence of each round -> rounds
    (False, (5.0, 9.0, 12.0, 15.0), 3),
    (True, (5.0, 9.0, 12.0, 15.0), 3),
    (True, (5.0, 5.4, 12.0, 15.0), 2),
    (False, (5.0, 5.6, 5.9, 15.0), 3),
]


@pytest.mark.parametrize("is_model, evidences, rounds", WINDS)
def test_gusts_are_fitted_as_long_as_the_mean_wind_gains_by_them(monkeypatch, is_model, evidences, rounds):
    """From where little coloured force competes with them."""
    seen = []

    def tried(likelihood, hypothesis, wind, kinds, level):
        seen.append((len(kinds), level))
        return [(fitted(evidences[len(seen) - 1]), "size")]

    monkeypatch.setattr(gusts, "_tried", tried)
    monkeypatch.setattr(gusts, "_chosen", lambda found, wind, gusty: found)
    monkeypatch.setattr(gusts, "is_fitted", lambda dynamics: False)
    dynamics, levels = SimpleNamespace(particulars=SimpleNamespace(is_model=is_model)), ProcessLevels((0.01, 0.02, 0.5))
    likelihood = SimpleNamespace(data_set=SimpleNamespace(dynamics=dynamics, levels=levels))
    steady = SimpleNamespace(names=("wind_steady", "other"), hypothesis=None, best=(levels.point(2, 1), 0))
    gusts.fitted_gusts(likelihood, steady, SimpleNamespace(variant_of="wind_steady"))
    assert len(seen) == rounds and seen[0] == (12 if is_model else 6, levels.point(0, 0))


# What is said --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("value, error, step", [(RAMP.low + 9.0, 5.0, True), (RAMP.low + 11.0, 5.0, False)])
def test_a_ramp_of_less_than_two_standard_errors_is_a_step(value, error, step):
    assert causes._is_step(RAMP, value, error) is step
    assert not causes._is_step(Current.declared[0], value, error)


@pytest.mark.parametrize("second, where", [(0.52, ("Y", "N")), (0.48, ("Y",))])
def test_a_term_with_a_quarter_of_the_clearest_ones_chi_square_counts_for_the_place(monkeypatch, second, where):
    monkeypatch.setattr(causes, "unit_forces", lambda data_set: np.ones(3))
    monkeypatch.setattr(causes, "units", lambda data_set: ("N", "N", "N m"))
    effect = Formula(SHIP, ["Y |v||r|", "N r|r|"], w1=1.0, w2=second)
    h = Hypothesis((effect,), (values(effect),))
    j = FittedHypothesis(h, 9.0, np.zeros((1, 1)), np.eye(2) * 0.01)
    verdict = Decision(False, True, 0.1, 0.8, {}, None, {})
    assert causes._unmodelled(Mock(), verdict, j).equations == where


@pytest.mark.parametrize("of_rival, duels", [(0.045, 0), (0.055, 1)])
def test_a_rival_that_is_possible_is_to_be_told_apart(of_rival, duels):
    result = found(fitted(20.0, "current"), fitted(18.0, "log_scale"))
    verdict = Decision(True, False, 0.0, 0.0, {"current": 0.9, "log_scale": of_rival}, result.fitted[0], {})
    assert len(words._duels(result, verdict, result.fitted[0], True)) == duels
    calm = replace(verdict, effects={"current": of_rival})
    assert len(words._duels(result, calm, result.none, False)) == duels


def test_two_rivals_of_the_same_leader_are_told_apart_the_likelier_first():
    leader, *rivals = [fitted(9.0 - k, name) for k, name in enumerate(["current", "log_scale", "heading_bias"])]
    pair = fitted(6.0, "current", "rudder_offset")
    verdict = Decision(True, False, 0.0, 0.0, {"current": 0.9, "heading_bias": 0.08, "log_scale": 0.2}, leader, {})
    duels = words._duels(found(leader, *rivals, pair), verdict, leader, True)
    assert duels == [(leader, rivals[0], 0.2), (leader, rivals[1], 0.08)]
    beside = replace(verdict, effects={"current": 0.9, "log_scale": 0.2, "rudder_offset": 0.1})
    assert words._duels(found(leader, *rivals, pair), beside, leader, True) == duels[:1], "another leader: the pair's"


@pytest.mark.parametrize("expected, advised", [(2.8, False), (3.2, True)])
def test_a_run_is_advised_that_is_expected_to_add_three(monkeypatch, expected, advised):
    run = SimpleNamespace(text="a straight run begun on heading 090", heading=1.0)
    said, _ = words._told(fitted(20.0, "current"), fitted(18.0, "log_scale"), 0.3, [(expected, run)])
    assert (run.text in said) is advised and ("measure" in said) is not advised
    monkeypatch.setattr(words, "advise", lambda data_set, leading, rivals: [[(expected, run)]])
    result = found(fitted(4.0, "current"))
    verdict = Decision(False, False, 0.7, 0.1, {"current": 0.2}, result.fitted[0], {})
    assert len(words.next_steps(result, verdict, result.none, False)[0]) == 1 + advised


@pytest.mark.parametrize("p, wandering, passed", [
    (0.0024, -1.0, False), (0.0025, -1.0, False), (0.0026, -1.0, True), (0.0024, 1.0, True), (0.0025, 1.0, True),
    (0.00005, 1.0, False),
])  # fmt: skip
def test_calm_water_fails_the_free_runs_at_one_half_per_cent_over_both_looks(monkeypatch, p, wandering, passed):
    """Where the fitted runs are likelier with a receiver that wanders it may wander in the draws as well."""
    monkeypatch.setattr(predictive, "corrected", lambda tried, rng: None)
    monkeypatch.setattr(predictive, "published", lambda tried, rng: None)
    monkeypatch.setattr(predictive, "drawn_runs", lambda *_: None)
    monkeypatch.setattr(predictive, "beside", lambda likelihood, hypothesis: likelihood)
    slow = ReceiverWander(2.0, 60.0, wandering)
    monkeypatch.setattr(predictive, "receiver_wander", lambda likelihood, fitted: slow)
    looks = {None: iter([(0.4, "x of fitted", 1.0), (p, "psi of held-out", 3.0)])}
    looks[slow] = iter([(0.4, "x of fitted", 1.0), (40 * p, "psi of held-out", 3.0)])
    monkeypatch.setattr(predictive, "surprise", lambda *given: next(looks[given[-1]]))
    calm = Mock(likelihood=Mock(data_set=Mock(runs=[])), none=Mock(evidence=0.0))
    check = predictive.calm_check(Mock(case=Mock(fitted=[], held_out=[])), calm)
    assert check.passed is passed and "psi of held-out" in check.text and "as published" in check.text


def test_a_receiver_that_wanders_is_unknown_to_positions_alone(monkeypatch):
    """Two constant errors of 2 m in x and in the log are rare beside white noise; with a wander of 2 m the log is."""
    samples, draws = 60, 200
    record = pd.DataFrame({c: np.zeros(samples) for c in ("x", "y", "psi", "u", "v", "r", "u_log")})
    monkeypatch.setattr(predictive, "recorded", lambda run, warmup: record.assign(**off))
    question = Mock(case=Mock(warmup=0.0, proof=()), dynamics=Mock(particulars=Mock(time_unit=5.0)))
    run, prepared = Mock(step=1.0, time=np.arange(1.0 + samples), derived=()), Mock(noise=np.ones(8))
    run.name = "zigzag"
    free, slow = [np.zeros((1 + draws, samples, 7))], ReceiverWander(2.0, 300.0, 1.0)
    for channel in ("x", "u_log"):
        off = {channel: 2.0}
        assert predictive.surprise(question, [run], [prepared], free)[0] < 1e-4
        assert (predictive.surprise(question, [run], [prepared], free, slow)[0] > 0.05) == (channel == "x")


def test_draws_allow_noise_a_tenth_larger_or_smaller_than_was_estimated(monkeypatch):
    """A recording that is nothing but noise: its RMS among those of draws, e^(0.1 z) sqrt(chi-square_n / n)."""
    samples, draws, rms = 120, 8000, 1.08
    larger = norm.expect(lambda z: chi2.sf(samples * (rms * np.exp(-0.1 * z)) ** 2, samples))
    row = np.full(samples, rms)
    record = pd.DataFrame({c: np.nan * row for c in ("x", "y", "psi", "u", "v", "r", "u_log")}).assign(u_log=row)
    monkeypatch.setattr(predictive, "recorded", lambda run, warmup: record)
    # One look: its own rank will do, and takes no table of all draws without each.
    rank = lambda sizes: (float(predictive.tail(sizes[0, :1], sizes[0, 1:])[0]), 0)  # noqa: E731
    monkeypatch.setattr(predictive, "rarest", rank)
    monkeypatch.setattr(predictive, "BLOCK", 0.0)  # every sample by itself, all of them one part
    question = Mock(case=Mock(warmup=0.0, proof=()), dynamics=Mock(particulars=Mock(time_unit=1.0)))
    run, prepared = Mock(step=1.0, derived=()), Mock(noise=np.ones(8))
    run.name = "zigzag"
    p, look, _ = predictive.surprise(question, [run], [prepared], [np.zeros((1 + draws, samples, 7))])
    assert look == "u_log of fitted" and p == approx(larger, abs=0.006)


def test_a_recording_that_is_one_more_draw_is_as_rare_as_it_says_however_many_looks_are_taken():
    """Ranked among draws of which it is none it would be so three times too often."""
    rng, found, ranked = np.random.default_rng(0), [], []
    for _ in range(400):
        sizes = np.sqrt((rng.standard_normal((30, 49, 6)) ** 2).mean(-1))
        found.append(predictive.rarest(sizes)[0])
        least = 1 / np.min([predictive.tail(one, one[1:]) for one in sizes], axis=0)
        ranked.append(predictive.tail(least[:1], least[1:])[0])
    assert np.mean(np.array(found) < 0.05) == approx(0.05, abs=0.03)  # of 400 sets: three standard errors
    assert np.mean(np.array(ranked) < 0.05) == approx(0.15, abs=0.03)


def test_process_noise_that_calm_water_is_allowed_is_twice_its_usual_size():
    """The level next below two prior scales, of a half-normal prior: 95 % of it."""
    most = int(np.searchsorted(PROCESS_LEVELS.sizes, predictive.PRIOR_SDS * predictive.PROCESS_PRIOR)) - 1
    assert PROCESS_LEVELS.sizes[most] <= 2 * predictive.PROCESS_PRIOR < PROCESS_LEVELS.sizes[most + 1]
    assert norm.cdf(predictive.PRIOR_SDS) - norm.cdf(-predictive.PRIOR_SDS) == approx(0.95, abs=0.006)


@pytest.mark.parametrize("explained, frame", [
    ((0.52, 0.2, 0.9), "body"), ((0.2, 0.52, 0.0), "earth"), ((0.5, 0.2, 0.0), "body"), ((0.48, 0.2, 0.9), ""),
    ((), ""),
])  # fmt: skip
def test_a_frame_is_told_that_explains_half_of_the_variance(explained, frame):
    assert locate.Shape(0, np.ones(3), explained).frame == frame


@pytest.mark.parametrize("sides, parity", [
    ((1.0, 1.0), "even"), ((-1.0, 1.0), "odd"), ((2.9, 1.0), "even"), ((3.1, 1.0), "mixed"), ((-2.9, -1.0), "even"),
    ((2.9, -1.0), "odd"), ((3.1, -1.0), "mixed"), ((-2.9, 1.0), "odd"), ((), ""), ((3.0, 1.0), "mixed"),
    ((3.0, -1.0), "mixed"),
])  # fmt: skip
def test_sides_are_alike_where_their_mean_is_twice_half_their_difference(sides, parity):
    assert locate.Shape(0, np.ones(3), sides=sides).parity == parity


def straight_and_turning(share: float) -> tuple[SimpleNamespace, list[Residual]]:
    """A run of 300 samples: 100 without a turn, 100 each to port and starboard at a share of the largest yaw rate."""
    r = np.concatenate([np.zeros(99), [1.0], np.full(100, -share), np.full(100, share)])
    track = np.zeros((300, 6))
    track[:, 2], track[:, 5] = 0.02 * r, np.linspace(0.0, 1.0, 300)
    run = SimpleNamespace(linearised=SimpleNamespace(track=track, run={"delta": 0.3 * r}))
    force = np.zeros((300, 3))
    force[:, 1] = np.where(r > 0, 2.0, 1.0)
    return SimpleNamespace(runs=[run]), [Residual("r", np.arange(300.0), force, np.ones((300, 3)), force, [])]


@pytest.mark.parametrize("share, sides", [(0.28, ()), (0.32, (1.0, 2.0))])
def test_a_ship_turns_from_three_tenths_of_the_largest_yaw_rate_on(share, sides):
    assert locate.shape_of(*straight_and_turning(share)).sides == approx(sides)


@pytest.mark.parametrize("share, hard", [(0.48, (4.0, 1 / 300)), (0.5, (4.0, 1 / 300)), (0.52, (504.0, 201 / 300))])
def test_hard_helm_is_more_than_half_of_the_largest(share, hard):
    square = 99 * 1.0 + 100 * 1.0 + 101 * 4.0
    shape = locate.shape_of(*straight_and_turning(share))
    assert shape.strongest == 1 and shape.hard == approx((hard[0] / square, hard[1]))


@pytest.mark.parametrize("heading, told", [(1.56, False), (np.pi / 2, True), (1.58, True)])
def test_body_and_earth_axes_are_told_where_a_run_turns_through_a_right_angle(heading, told):
    data_set, residuals = straight_and_turning(0.5)
    data_set.runs[0].linearised.track[:, 5] = np.linspace(0.0, heading, 300)
    assert bool(locate.shape_of(data_set, residuals).explained) is told


@pytest.mark.parametrize("is_model, names, sizes", [
    (False, ("kN", "kN", "MN m"), [1e3, 1e3, 1e6]), (True, ("N", "N", "N m"), [1.0, 1.0, 1.0]),
])  # fmt: skip
def test_missing_forces_are_mass_times_acceleration_in_units_of_ships_or_of_models(is_model, names, sizes):
    particulars = SimpleNamespace(is_model=is_model)
    data_set = SimpleNamespace(dynamics=SimpleNamespace(particulars=particulars, hull=SHIP))
    a, prime = np.array([[0.01, 0.02, 1e-4]]), SHIP.prime
    per_unit = SHIP.force_from_acceleration(torch.tensor(a)).numpy() * [prime.force, prime.force, prime.moment]
    assert locate.units(data_set) == names and locate.in_units(data_set)(a) == approx(per_unit / sizes)


@pytest.mark.parametrize("stands_out, told", [(1.4, False), (1.5, True), (1.6, True)])
def test_a_force_below_one_and_a_half_standard_deviations_is_not_described(monkeypatch, stands_out, told):
    shape = locate.Shape(1, np.array([0.3, stands_out, 0.2]), (0.6, 0.1, 0.2), (1.0, 1.0), (0.5, 0.2))
    monkeypatch.setattr(locate, "shape_of", lambda data_set, found: shape)
    monkeypatch.setattr(locate, "units", lambda data_set: ("kN", "kN", "MN m"))
    said = locate.statements(Mock(), straight_and_turning(0.5)[1])
    assert ("In no equation" in said[1]) is not told and len(said) == (4 if told else 2)


@pytest.mark.parametrize("count, step, windows", [(119, 1.0, 0), (120, 1.0, 1), (59, 2.0, 0), (60, 2.0, 1)])
def test_windows_are_looked_for_in_means_of_ten_seconds_of_which_there_are_twelve(count, step, windows):
    time = step * np.arange(count)
    force = 0.3 * np.random.default_rng(2).standard_normal((count, 3))
    force[(time >= 40) & (time < 80), 1] += 9.0
    found = locate.changes(time, force, np.ones((count, 3)))
    assert found == [(40.0, 80.0)] * windows
