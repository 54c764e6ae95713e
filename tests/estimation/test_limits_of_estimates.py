"""Limits in an estimate of states and coefficients, each side of them: what rests, what agrees, what is told apart."""

from dataclasses import dataclass
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest
import torch
from fleet import ship_named, unchecked
from pytest import approx
from scipy.stats import norm

from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.effect.common import TIGHT_TURN
from manoeuvre_nn.estimation import (
    agreement,
    closed_loop,
    hypothesis,
    linear_motion,
    marginal_likelihood,
    prime_recordings,
    prior_average,
    record_information,
)
from manoeuvre_nn.estimation import smoothed_run as smoothing
from manoeuvre_nn.estimation.captive_fit import compare
from manoeuvre_nn.estimation.coefficients import Fitted
from manoeuvre_nn.estimation.corrections import Corrections
from manoeuvre_nn.estimation.data_set import WhitenedDataSet
from manoeuvre_nn.estimation.linearised_run import LinearisedRun
from manoeuvre_nn.estimation.measurement_noise import measured_noise
from manoeuvre_nn.estimation.prepared_run import samples_a_state


@pytest.fixture(autouse=True)
def unchecked_types():
    """Stands for problems and estimates are no arrays of the right types."""
    with unchecked():
        yield


# A fit of states and coefficients ------------------------------------------------------------------------------------


@pytest.mark.parametrize("duration, stretches", [(4.0, 1), (14.9, 1), (15.1, 2), (34.9, 3), (35.1, 4)])
def test_runs_are_cut_into_stretches_of_about_ten_times_what_a_ship_takes_for_her_length(duration, stretches):
    run = Recording("run", np.linspace(0.0, duration, 701), {"u": np.ones(701)})
    pieces = agreement._pieces(run, agreement.STRETCH)
    assert len(pieces) == stretches and pieces[0].start == 0 and pieces[-1].stop == 701


@pytest.mark.parametrize("over, sinks", [(1.01, True), (1.03, False)])
def test_a_floor_binds_where_the_noise_of_a_channel_is_within_two_per_cent_of_it(monkeypatch, over, sinks):
    floor, noise = np.full(6, 0.01), np.full(6, 0.03)
    noise[2] = over * 0.01
    monkeypatch.setattr(agreement, "birge_ratio", lambda problem, found: 0.25)
    found = agreement.agreed_floor(Mock(floor=floor), Mock(floor=floor, noise=noise))
    assert found == approx(floor * (0.5 if sinks else 1.0))


def standing(**more) -> SimpleNamespace:
    """An estimate that has come to rest."""
    rest = {"process_sd": np.full(3, 1e-4), "noise": np.full(6, 0.01), "floor": np.full(6, 0.01), "moved": 1e-9}
    return SimpleNamespace(**rest | {"passes": 6} | more)


def rests(before: dict, now: dict, learn_floor=False) -> bool:
    return closed_loop.at_rest(Mock(learn_floor=learn_floor), standing(**before), standing(**now))


def test_an_estimate_rests_where_parameters_move_by_a_thousandth_and_noise_changes_by_a_hundredth():
    assert rests({}, {}) and rests({}, {"moved": 0.9e-3}) and not rests({}, {"moved": 1.1e-3})
    for share, still in ((0.9, True), (1.1, False)):
        for sign in (1.0, -1.0):
            assert rests({}, {"noise": np.full(6, 0.01 * (1 + sign * 0.01 * share))}) is still


@pytest.mark.parametrize("size, change, still", [
    (0.1, 0.9e-3, True), (0.1, 1.1e-3, False), (1e-4, 0.97 * 3e-5, True), (1e-4, 1.03 * 3e-5, False),
])  # fmt: skip
def test_process_noise_of_less_than_three_thousandths_is_at_rest_sooner_than_by_its_own_size(size, change, still):
    assert rests({"process_sd": np.full(3, size)}, {"process_sd": np.array([size, size - change, size])}) is still


@pytest.mark.parametrize("passes, moved, still", [
    (5, 0.0, False), (6, 0.0, True), (7, 0.0, False), (8, 0.0, False), (9, 0.0, True), (6, 0.049, True),
    (6, 0.051, False), (6, -0.051, False),
])  # fmt: skip
def test_a_floor_is_looked_at_every_third_pass_and_rests_where_it_changes_by_less_than_a_twentieth(
    passes, moved, still
):
    now = {"passes": passes, "floor": np.full(6, 0.01 * (1 + moved))}
    assert rests({}, now, learn_floor=True) is still


@pytest.mark.parametrize("equation, most", list(enumerate((1.0e-3, 1.5e-3, 3.0e-3))))
def test_a_floor_sinks_under_a_model_that_is_wrong_by_a_thousandth_ahead_three_in_yaw_and_no_more(equation, most):
    """Over U0^2/L: what a right model's integration leaves; more takes up what stretches disagree on."""
    for share, sinks in ((0.97, True), (1.0, True), (1.03, False)):
        size = np.zeros(3)
        size[equation] = share * most
        now = standing(process_sd=size)
        assert closed_loop._sinks(Mock(learn_floor=True), now) is sinks
        assert not closed_loop._sinks(Mock(learn_floor=False), now)
        assert rests({"process_sd": size}, {"process_sd": size, "passes": 7}, learn_floor=True) is not sinks


@dataclass(frozen=True)
class Sized:
    """What is told of the process noise of an estimate."""

    process_sd: np.ndarray
    states: tuple = (None,)
    covariance: None = None
    step_weights: tuple = ()


@pytest.mark.parametrize("size, seen, unsure, after", [
    (1e-2, 0.0, 0.0, 1e-2 / 3), (2e-4, 0.0, 0.0, 1e-4), (1e-2, 0.5e-2, 1.1e-2, 3e-2), (1e-2, 1e-2, 0.0, 1e-2),
])  # fmt: skip
def test_the_size_of_the_process_noise_changes_by_a_factor_of_three_at_most_and_stays_above_a_ten_thousandth(
    size, seen, unsure, after
):
    """Of innovations with that standard error; where this is all that they are, nothing is known of the size."""
    run = Mock(innovations=lambda state: np.full((7, 3), seen))
    run.innovation_variance = lambda covariance: np.full((7, 3), unsure**2)
    problem = Mock(max_process_sd=None, process=Mock(order=1), process_variance=lambda k: np.ones((7, 3)))
    now = Sized(np.full(3, size))
    assert closed_loop._with_process(problem, now, [run]).process_sd == approx(np.full(3, after), rel=1e-3)


# Noise ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("off, kept", [(4.8, True), (5.2, False)])
def test_a_sample_five_standard_deviations_off_is_cut_out(off, kept):
    e = norm.ppf((np.arange(1000) + 0.5) / 1000)[:, None]
    e[500] = off
    scale, weights = measured_noise(e**2, np.ones_like(e), np.ones(1), np.zeros(1), "cut")
    assert scale == approx(1.0, rel=0.01) and weights[500, 0] == float(kept) and weights.sum() == 999 + kept


@pytest.mark.parametrize("samples, found", [(9, 7.0), (10, 0.2)])
def test_the_noise_of_a_channel_is_measured_from_ten_samples_on(samples, found):
    e = np.full((samples, 1), 0.1)
    scale, weights = measured_noise(e**2, np.ones_like(e), np.array([7.0]), np.array([0.2]), "cut")
    assert scale == approx(found) and (weights == 1).all()


POWER_OF_LENGTH = {"m": 1.0, "m/s": 0.5, "rad/s": -0.5, "rad": 0.0, "-": 0.0}
"""By Froude's law time goes with the root of length."""


def test_what_is_usual_goes_with_length_as_its_unit_by_froudes_law():
    errors = ["m/s", "m/s", "rad", "-", "rad/s", "-", "m", "m"]  # stream, compass, log, rate gyro twice, antenna
    motion = ["m/s", "m/s", "rad/s", "m", "m", "rad"]
    assert list(smoothing.KINEMATIC_ERROR_POWERS) == [POWER_OF_LENGTH[unit] for unit in errors]
    assert list(smoothing.MOTION_POWERS) == [POWER_OF_LENGTH[unit] for unit in motion]


@pytest.mark.parametrize("step, share", [(3.9, 1.0), (4.1, 4.0 / 4.1), (-8.0, 0.5)])
def test_a_step_of_the_velocities_is_held_within_half_of_the_mean_speed(step, share):
    track, change = np.zeros((9, 6)), np.zeros((9, 9))
    track[:, :2] = np.sqrt(32.0)  # u and v; the speed is 8 m/s
    change[4, 1] = step
    assert smoothing.step_share(track, change) == approx(share)
    assert smoothing.step_share(track, np.zeros((9, 9))) == 1.0


@pytest.mark.parametrize("off, step", [(0.0095, 0.1), (0.0105, 0.0)])
def test_a_channel_was_rounded_where_its_values_are_whole_steps_to_a_hundredth(off, step):
    values = 0.1 * np.array([0.0, 1.0, 3.0, 3.0, 6.0, np.nan])
    values[4] += 0.1 * off
    assert smoothing.rounding_step(values[:, None]) == approx([step])
    assert smoothing.rounding_step(values[:2, None]) == [0.0], "two values tell of no step"


# Priors of events ----------------------------------------------------------------------------------------------------


def test_an_event_happens_once_in_half_of_the_runs_never_in_three_tenths_and_more_often_in_the_rest():
    never, once, twice, thrice = hypothesis.NUMBER_OF_INTERVALS
    assert never + once + twice + thrice == approx(1.0)
    assert (never, once) == approx((0.3, 0.5)) and twice == approx(3 * thrice), "each one more is less likely"


def test_half_of_a_gaussian_is_within_the_median_size_of_a_cauchy_that_stands_for_the_same_usual_size():
    assert hypothesis.MEDIAN_OF_GAUSSIAN == approx(norm.ppf(0.75), abs=1e-4)


# What is told of coefficients ----------------------------------------------------------------------------------------


NAMES = tuple((o, t) for o in (1, 2) for t in ("u v", "d n n"))


def told_by(values, error, spread=1.0) -> Fitted:
    p = len(NAMES)
    return Fitted(NAMES, np.array(values), np.eye(p) * error**2, np.zeros(p), np.full(p, spread), np.eye(3))


@pytest.mark.parametrize("distance, word", [
    (1.9, "agree"), (2.1, "doubtful"), (-1.9, "agree"), (-2.9, "doubtful"), (3.1, "differ"), (-3.1, "differ"),
])  # fmt: skip
def test_towed_and_free_coefficients_agree_within_two_standard_errors_and_differ_beyond_three(distance, word):
    """The errors of both add up by their squares: 3 and 4 are 5."""
    rows = compare(told_by(np.full(4, 0.5 + distance * 0.05), 0.03), told_by(np.full(4, 0.5), 0.04))
    assert set(rows["word"]) == {word} and rows["apart"].to_numpy() == approx(distance)


@pytest.mark.parametrize("errors, word", [((0.49, 0.49), "agree"), ((0.51, 0.49), "open"), ((0.49, 0.51), "open")])
def test_coefficients_are_compared_that_both_have_narrowed_to_half(errors, word):
    rows = compare(*(told_by(np.full(4, 0.5), error) for error in errors))
    assert set(rows["word"][4:]) == {word} and set(rows["word"][:4]) == {"agree"}, "slopes are compared in any case"


@pytest.mark.parametrize("error, told", [(0.95, True), (1.0, True), (1.05, False)])
def test_a_coefficient_is_identified_up_to_an_error_of_a_fifth(error, told):
    one = record_information._Identifiable(("Y_v",), np.array([-5.0]), np.array([error]), (), {"Y": 1.0})
    assert one.identified == (("Y_v",) if told else ())


@pytest.mark.parametrize("correlation, apart", [(0.94, True), (-0.94, True), (0.96, False), (-0.96, False)])
def test_estimates_are_told_apart_up_to_a_correlation_of_nineteen_twentieths(correlation, apart):
    errors = np.array([1.0, 2.0, 1.0])
    covariance = np.array([[1.0, correlation, 0.99], [correlation, 1.0, 0.0], [0.99, 0.0, 1.0]])
    pairs = record_information._alike(
        ["Y_v", "Y_r", "Y_0"], covariance * np.outer(errors, errors), errors, ["v", "r", "0"]
    )
    assert pairs == ([] if apart else [("Y_v", "Y_r", approx(correlation))])


@pytest.mark.parametrize("starboard, port, said", [
    (100, 0, "a turn to starboard"), (98, 2, "a turn to starboard"), (97, 3, "open to which side: 97 %"),
    (3, 97, "open to which side: 3 %"), (2, 98, "a turn to port, against the rudder"), (0, 1, "a turn to port"),
    (39, 1, "open to which side"), (1, 39, "open to which side"),
])  # fmt: skip
def test_to_which_side_a_ship_turns_is_told_where_all_but_a_fortieth_of_what_may_be_turns_there(starboard, port, said):
    (told,) = linear_motion._side(np.repeat([0.4, -0.4], [starboard, port]))
    assert told.startswith(said) and linear_motion._side(np.zeros(0)) == []


def test_a_term_that_a_published_set_lacks_may_do_six_tenths_of_what_the_rudder_does_in_a_tight_turn():
    """In sway and yaw; in surge six tenths of half of what slows the ship down there."""
    ship = ship_named("mariner")
    p, dynamics = ship.particulars, CalmWater(ship)
    turn = torch.tensor([1 - TIGHT_TURN["u"], -TIGHT_TURN["v"], TIGHT_TURN["r"]], dtype=torch.float64)
    turn = turn * torch.tensor([p.speed, p.speed, p.speed / p.length])
    rudder = torch.tensor(TIGHT_TURN["d"], dtype=torch.float64)
    corrections = Corrections(dynamics)
    there, calm, without = (f(turn, d) for f, d in (
        (corrections, rudder), (dynamics.hull.acceleration, rudder), (dynamics.hull.acceleration, 0 * rudder)
    ))  # fmt: skip
    allowed = [0.5 * abs(calm[0]), *abs(calm - without)[1:]]
    sizes = {name: abs(row["XYN".index(name[0])]) for name, row in zip(corrections.names, there, strict=True)
             if "+" in name}  # fmt: skip
    assert len(sizes) > 40
    assert all(float(size) == approx(0.6 * float(allowed["XYN".index(name[0])])) for name, size in sizes.items())


def test_errors_of_coefficients_are_tried_from_any_arm_to_nearly_known_ones_and_missing_terms_over_a_factor_of_thirty():
    coupling, missing, usual = (sorted(set(column)) for column in zip(*prior_average.COEFFICIENT_PRIORS, strict=True))
    assert usual == [False]
    assert coupling == approx(np.linspace(0.0, 0.9, 4)) and len(prior_average.COEFFICIENT_PRIORS) == 16
    assert np.log10(missing) == approx([-1.0, -0.5, 0.0, 0.5], abs=0.03), "from sets that lack next to nothing"


# Levels, states and rudders ------------------------------------------------------------------------------------------


def test_a_level_of_noise_counts_that_is_a_hundredth_as_likely_as_the_best():
    weights = np.log([[1.0, 0.0105], [0.0095, 0.5]]) + 7.0
    assert marginal_likelihood.weighty(weights) == [(0, 0), (0, 1), (1, 1)]


@pytest.mark.parametrize("apart, same", [(0.95, True), (1.05, False)])
def test_corrections_tell_two_rudder_angles_apart_that_differ_by_a_degree_in_one_of_the_runs(apart, same):
    """Root mean square about their mean; what was made for other angles before is kept."""
    flat, way = np.zeros(100), apart * DEGREE * np.tile([1.0, -1.0], 50)
    angles = [flat + 0.3, way]  # the same but for a constant in the first run
    here = Mock(runs=[SimpleNamespace(linearised=SimpleNamespace(indicated=flat))] * 2)
    here._by_rudder = {b"".join(a.tobytes() for a in angles): "made before"}
    assert WhitenedDataSet.with_rudders(here, angles) == (here if same else "made before")


@pytest.mark.parametrize("pace, interval, apart, count", [
    (30.0, 1.0, 1, 2), (30.0, 0.5, 1, 4), (30.0, 2.5, 1, 1), (10.0, 0.1, 1, 10), (10.0, 0.5, 1, 2), (19.0, 0.1, 1, 19),
    (22.0, 0.1, 1, 20), (30.0, 1.0, 2, 2), (30.0, 1.0, 3, 1), (30.0, 1.0, 10, 2), (30.0, 0.5, 3, 3), (30.0, 0.1, 7, 14),
    (30.0, 0.1, 30, 15),
])  # fmt: skip
def test_samples_are_averaged_over_a_tenth_of_a_ship_length_and_two_seconds_at_most(pace, interval, apart, count):
    """Where samples are rarer than times, a state takes so many times that none of them is between its samples."""
    ship = Mock(time_unit=pace, sized=lambda values, powers: np.array(values))
    assert samples_a_state(Mock(particulars=ship, own_names=()), interval, apart) == count
    assert samples_a_state(Mock(particulars=ship, own_names=("phi", "p")), interval, apart) == 1


@pytest.mark.parametrize("push, sails", [(7.9, True), (8.1, False), (-8.1, False), (np.inf, False)])
def test_a_ship_that_a_radian_of_rudder_pushes_by_all_her_speed_in_a_step_is_none(push, sails):
    pushed, transition = np.zeros((5, 6)), np.zeros((5, 9, 9))
    pushed[2, 1], pushed[:, 2] = push, 99.0  # of u and v alone
    line = Mock(transition=transition, rudder_push=pushed)
    line.rate.dynamics.particulars.speed = 8.0
    assert LinearisedRun.sails.fget(line) is sails
    line.transition, line.rudder_push = np.full((5, 9, 9), np.nan), np.zeros((5, 6))
    assert not LinearisedRun.sails.fget(line)


def test_errors_are_added_up_over_a_little_less_than_thirty_samples():
    """Three tenths of the variance wander for thousands of samples: 1 + 2 times .3 a lag."""
    slow = np.sqrt(2 * 3 / 7) * np.cos(2 * np.pi * np.arange(40_000) / 8000)
    found = smoothing._long_run((np.random.default_rng(0).standard_normal(40_000) + slow)[:, None])
    assert found == approx([1 + 2 * 0.3 * 29], rel=0.015)


# Recordings of ships that go ahead -----------------------------------------------------------------------------------


def ahead_for(samples: int, u=1.0, n=1.0, start=30) -> list[Recording]:
    """Pieces of a run, a sample every tenth of a length, that goes ahead for so many samples and is at rest before."""
    still = np.zeros(start + samples + 5)
    speed, shaft = still.copy(), still.copy()
    speed[start : start + samples], shaft[start : start + samples] = u, n
    return prime_recordings._pieces(Recording("run", 0.1 * np.arange(len(still)), {"u": speed, "n": shaft}), "shaft")


@pytest.mark.parametrize("more, kept", [
    ({}, True), ({"samples": 30}, False), ({"u": 0.12}, False), ({"u": 0.13}, True), ({"u": -1.0}, False),
    ({"n": 0.0095}, False), ({"n": 0.0105}, True), ({"n": -1.0}, False),
])  # fmt: skip
def test_a_piece_of_three_lengths_ahead_at_an_eighth_of_the_speed_with_a_turning_shaft_is_kept(more, kept):
    """Thirty-one samples a tenth of a length apart are three lengths."""
    pieces = ahead_for(**{"samples": 31} | more)
    assert [len(piece) for piece in pieces] == ([31] if kept else [])
    if kept:
        assert pieces[0].time[0] == approx(3.0)
