"""The joint estimation: against a dense solver, against the truth, with faults and outliers."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import torch

from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.estimation.closed_loop import first, improve, solve
from manoeuvre_nn.estimation.coefficient_forces import CoefficientForces
from manoeuvre_nn.estimation.collocation import STEP_SD, CollocatedRun
from manoeuvre_nn.estimation.measurement_noise import INFORMATION, STUDENT_FREEDOM
from manoeuvre_nn.estimation.problem import (
    CHANNELS,
    DELAY,
    OFFSET,
    EstimationProblem,
    SensorFault,
)
from manoeuvre_nn.estimation.process_noise import ProcessNoise

TRUTH = np.array([-0.6, -0.9, 0.8, -0.5, -1.5, 1.2])
"""Surge damping; sway by v, r; yaw by v (small), r, rudder."""


NAMES = [(0, "a"), (1, "v"), (1, "-r/2"), (2, "v"), (2, "r"), (2, "d")]


def products(state, inputs):
    u, v, r = state[:, :3].T
    return torch.as_tensor(np.stack([u - 1, v, -0.5 * r, r, inputs["delta"] + 0 * r], axis=1))


SHIP = CoefficientForces(NAMES, products, np.array([0, 1, 2, 1, 3, 4]), np.eye(3))
"""A ship with six coefficients."""


@cache
def exact(n, h):
    """Times, rudder and states of a run of that ship by small steps."""
    time, fine = h * np.arange(n), 20
    delta = 0.5 * np.sign(np.sin(0.9 * time)) * (time > 0.5)
    state, states = np.array([0.9, 0.0, 0.0, 0.0, 0.0, 0.3]), []
    force = SHIP
    for k in range(n):
        states.append(state)
        ahead = delta[min(k + 1, n - 1)]
        for j in range(fine):
            rudder = delta[k] + (j + 0.5) / fine * (ahead - delta[k])
            u, v, r, _, _, psi = state
            nudot = (force.columns(state[None], {"delta": np.array([rudder])}) @ TRUTH)[0]
            rate = [*nudot, u * np.cos(psi) - v * np.sin(psi), u * np.sin(psi) + v * np.cos(psi), r]
            state = state + h / fine * np.array(rate)
    return time, delta, np.array(states)


def sailed(n=200, h=0.05, noise=0.0, seed=0):
    """A run of that ship, and its track with noise."""
    time, delta, states = exact(n, h)
    measured = states + noise * np.random.default_rng(seed).standard_normal(states.shape)
    return states, run("run", time, measured, {"delta": delta})


def run(name, time, measured, inputs=None):
    return Recording(name, time, columns(measured) | (inputs or {}))


def columns(measured):
    return dict(zip(CHANNELS, measured.T, strict=True))


def motion(track):
    return track.stacked(*CHANNELS)


def problem(track, **more):
    given = {"mean": np.zeros(6), "spread": np.full(6, 2.0)} | more
    return EstimationProblem([track], SHIP, **given)


@pytest.mark.parametrize("with_speed", [False, True])
def test_one_pass_is_the_step_of_a_dense_least_squares_solver(with_speed):
    _, track = sailed(n=14, noise=0.01)
    measured = np.where(np.arange(14)[:, None] == 5, np.nan, motion(track))
    gap = track.with_channels(**columns(measured), wind_north=np.ones(14))
    faults = [SensorFault("psi", OFFSET, 0.05), SensorFault("x", DELAY, 0.1)]
    asked = problem(gap, faults=faults, with_speed=with_speed)
    start = first(asked, noise=0.02, process_sd=(0.01, 0.01, 0.01))
    square = np.nan_to_num(measured[:, 0]) ** 2
    # Dynamic pressure, 1 at the approach speed; a tenth of it is left at rest.
    pressure = np.sqrt(((square[1:] + square[:-1]) / 2 + 0.1) / 1.1) if with_speed else np.ones(13)
    size = 0.01 * np.stack([np.ones(13), pressure, pressure], axis=1)
    decay, h = np.exp(-0.05), 0.05

    def residuals(z):
        s, theta, (offset, delay) = z[: 14 * 9].reshape(14, 9), z[14 * 9 : -2], z[-2:]
        u, v, r, _, _, psi = s[:, :6].T
        nudot = SHIP.columns(s[:, :6], gap.channels) @ theta + s[:, 6:]
        motion = np.stack([u * np.cos(psi) - v * np.sin(psi), u * np.sin(psi) + v * np.cos(psi), r], 1)
        rate = np.concatenate([nudot, motion], 1)
        missed = (s[1:, :6] - s[:-1, :6] - h / 2 * (rate[1:] + rate[:-1])) / (STEP_SD * np.sqrt(h))
        fresh = (s[1:, 6:] - decay * s[:-1, 6:]) / (size * np.sqrt(1 - decay**2))
        shown = s[:, :6].copy()
        shown[:, 5] += offset
        shown[:, 3] -= delay * rate[:, 3]
        seen = np.nan_to_num((shown - measured) / 0.02) * np.sqrt(INFORMATION)
        rest = [s[0, 6:] / 0.01, theta / 2.0, [offset / 0.05, delay / 0.1]]
        return np.concatenate([missed.ravel(), fresh.ravel(), seen.ravel(), *rest])

    z = np.concatenate([start.states[0].ravel(), start.values])
    nudges = 1e-6 * np.eye(len(z))
    jacobian = np.stack([(residuals(z + e) - residuals(z - e)) / 2e-6 for e in nudges], axis=1)
    step = np.linalg.lstsq(jacobian, -residuals(z), rcond=None)[0]
    new = improve(asked, start)
    np.testing.assert_allclose(new.states[0].ravel(), z[: 14 * 9] + step[: 14 * 9], atol=2e-5)
    np.testing.assert_allclose(new.values, step[14 * 9 :], atol=2e-4)
    assert new.cost == pytest.approx(0.5 * np.square(residuals(z)).sum(), rel=1e-9)
    covariance = np.linalg.inv(jacobian.T @ jacobian)
    np.testing.assert_allclose(new.covariance, covariance[14 * 9 :, 14 * 9 :], rtol=2e-2, atol=1e-6)
    own = new.state_covariance[0][7]
    np.testing.assert_allclose(own, covariance[63:72, 63:72], rtol=2e-2, atol=1e-7)


def test_coefficients_are_found_in_noise_and_their_errors_are_true():
    pulls = []
    for seed in range(12):
        _, track = sailed(noise=0.01, seed=seed)
        found = solve(problem(track), first(problem(track), process_sd=(1e-3, 1e-3, 1e-3)))
        pulls.append((found.values - TRUTH) / np.sqrt(np.diag(found.covariance)))
        assert np.abs(found.noise / 0.01 - 1).max() < 0.35
    assert np.abs(np.mean(pulls)) < 0.5
    assert 0.6 < np.std(pulls) < 1.5


def test_states_are_closer_to_the_truth_than_what_was_measured():
    states, track = sailed(noise=0.02)
    found = solve(problem(track), first(problem(track), process_sd=(1e-3, 1e-3, 1e-3)))
    assert np.std(found.states[0][:, :6] - states, axis=0).max() < 0.4 * 0.02


def test_without_a_force_it_is_a_smoother_that_gives_accelerations():
    states, track = sailed(noise=0.01)
    free = EstimationProblem([track], None, np.zeros(0), np.zeros(0), learn_process=True)
    found = solve(free, first(free, process_sd=(0.1, 0.1, 0.3)), passes=25)
    truth = (SHIP.columns(states, track.channels) @ TRUTH)[:, 2]
    assert np.corrcoef(found.states[0][:, 8], truth)[0, 1] > 0.9
    error = np.sqrt(found.state_covariance[0][:, 8, 8])
    assert 0.5 < np.std((found.states[0][:, 8] - truth) / error) < 1.6


def test_a_late_sensor_is_found_with_its_error():
    states, track = sailed(n=300, noise=0.003)
    late = motion(track)
    late[:, 5] = np.interp(track.time - 0.12, track.time, track["psi"])
    asked = problem(track.with_channels(**columns(late)), faults=[SensorFault("psi", DELAY, 0.2)])
    found = solve(asked, first(asked, process_sd=(1e-3, 1e-3, 1e-3)))
    error = np.sqrt(found.covariance[-1, -1])
    assert error < 0.01
    assert abs(found.values[-1] - 0.12) < 4 * error


def test_outliers_weigh_little_and_do_little():
    _, track = sailed(noise=0.01)
    spoilt = motion(track)
    spoilt[40, 2] += 1.0
    spoilt[90, 5] -= 2.0
    clean, dirty = (
        solve(problem(t), first(problem(t), process_sd=(1e-3, 1e-3, 1e-3)))
        for t in (track, track.with_channels(**columns(spoilt)))
    )
    assert dirty.sample_weights[0][40, 2] < 0.01 and dirty.sample_weights[0][90, 5] < 0.01
    assert dirty.sample_weights[0].max() <= (STUDENT_FREEDOM + 1) / STUDENT_FREEDOM
    np.testing.assert_allclose(dirty.values, clean.values, atol=0.5 * np.sqrt(np.diag(clean.covariance)).max())


def test_two_runs_tell_more_than_one():
    tracks = [sailed(noise=0.01, seed=s)[1] for s in (0, 1)]
    one = solve(problem(tracks[0]))
    two = solve(EstimationProblem(tracks, SHIP, np.zeros(6), np.full(6, 2.0)))
    assert (np.diag(two.covariance) < np.diag(one.covariance)).all()


def test_uneven_times_are_taken_as_they_are():
    _, track = sailed(n=300, noise=0.005)
    kept = np.sort(np.random.default_rng(3).choice(300, 220, replace=False))
    kept = np.unique(np.concatenate([[0], kept, [299]]))
    thin = run("thin", track.time[kept], motion(track)[kept], {"delta": track["delta"][kept]})
    found = solve(problem(thin), first(problem(thin), process_sd=(3e-3, 3e-3, 3e-3)))
    assert np.abs(found.values[4:] - TRUTH[4:]).max() < 0.15


def test_without_information_the_prior_is_what_comes_out():
    _, track = sailed(n=60, noise=0.01)
    ahead = np.tile([1.0, 0, 0, 0, 0, 0], (60, 1))
    ahead[:, 3] = track.time
    still = track.with_channels(**columns(ahead), delta=np.zeros(60))
    found = solve(problem(still, mean=TRUTH, spread=np.full(6, 0.3)))
    assert np.abs(found.values[5] - TRUTH[5]) < 1e-6
    assert np.sqrt(found.covariance[5, 5]) == pytest.approx(0.3, rel=1e-6)


@pytest.mark.parametrize("smooth", [False, True])
def test_coloured_accelerations_have_the_covariance_of_their_process(smooth):
    time = np.array([0.0, 0.1, 0.15, 0.6, 1.4, 1.5, 3.0])
    colour, n = ProcessNoise(0.7, smooth), 7
    size = colour.size
    rows = np.zeros((n * size, n * size))
    rows[:size, :size] = np.eye(size)
    for k, (behind, ahead) in enumerate(zip(*colour.steps(np.diff(time)), strict=True)):
        at = slice((k + 1) * size, (k + 2) * size)
        rows[at, k * size : (k + 1) * size], rows[at, at] = behind, ahead
    covariance = np.linalg.inv(rows.T @ rows)
    x = np.abs(time[:, None] - time) / 0.7
    np.testing.assert_allclose(covariance[::size, ::size], (1 + smooth * x) * np.exp(-x), atol=1e-9)
    np.testing.assert_allclose(covariance[::size, 1::size], 0, atol=1e-12)
    if smooth:  # the rate's covariance is minus the second derivative
        np.testing.assert_allclose(covariance[3::size, 3::size], (1 - x) * np.exp(-x), atol=1e-9)


@pytest.mark.parametrize("smooth", [False, True])
def test_the_size_of_the_coloured_accelerations_is_found(smooth):
    """Velocities that only such accelerations have moved, by exact steps of the process a hundredth of L/U0 long."""
    random, sizes, n = np.random.default_rng(8), [], 1500
    colour = ProcessNoise(1.0, smooth)
    behind, ahead = (m[0] for m in colour.steps(np.array([0.01])))
    back, new = -np.linalg.solve(ahead, behind), np.linalg.inv(ahead)
    for _ in range(3):
        coloured = np.zeros((n, colour.size))
        coloured[0] = random.standard_normal(colour.size)
        for k in range(1, n):
            coloured[k] = back @ coloured[k - 1] + new @ random.standard_normal(colour.size)
        pushed = 0.2 * coloured[:, :3]
        nu = np.cumsum(0.005 * (pushed + np.vstack([np.zeros(3), pushed[:-1]])), axis=0) + [1.0, 0.0, 0.0]
        measured = np.concatenate([nu, np.zeros((n, 3))], axis=1)
        psi = np.cumsum(0.005 * (nu[:, 2] + np.append(0.0, nu[:-1, 2])))
        rates = np.stack([
            nu[:, 0] * np.cos(psi) - nu[:, 1] * np.sin(psi),
            nu[:, 0] * np.sin(psi) + nu[:, 1] * np.cos(psi),
        ])
        measured[:, 3:5], measured[:, 5] = np.cumsum(0.01 * rates, axis=1).T, psi
        seen = measured[::5] + 1e-3 * random.standard_normal(measured[::5].shape)
        track = run("pushed", 0.05 * np.arange(n // 5), seen)
        free = EstimationProblem([track], None, np.zeros(0), np.zeros(0), learn_process=True, smooth=smooth)
        sizes.append(solve(free, first(free, process_sd=(0.1, 0.1, 0.1)), passes=40).process_sd)
    assert 0.2 * 0.75 < np.mean(sizes) < 0.2 * 1.25


@pytest.mark.parametrize("start", [1e-3, 0.1])
def test_where_nothing_is_missing_nothing_is_found_wherever_it_starts(start):
    _, track = sailed(noise=0.01)
    asked = problem(track, learn_process=True)
    found = solve(asked, first(asked, process_sd=(start,) * 3), passes=20)
    assert found.passes < 20
    assert found.process_sd.max() < 1e-3
    right = solve(problem(track), first(problem(track), process_sd=(1e-5,) * 3))
    np.testing.assert_allclose(found.values, right.values, atol=0.02)


def test_the_size_rests_where_expectation_and_maximisation_do():
    _, track = sailed(noise=0.003)
    track = track.with_channels(wind_east=np.ones(200))
    asked = EstimationProblem([track], None, np.zeros(0), np.zeros(0), learn_process=True, with_speed=True)
    found = solve(asked, first(asked, process_sd=(0.01,) * 3), passes=100, enough=1e-6)
    line = CollocatedRun(asked, found, 0)
    square = line.innovations(found.states[0]) ** 2 + line.innovation_variance(found.covariance)
    due = np.sqrt((found.step_weights[0] * square / asked.process_variance(0)).mean(0))
    assert found.process_sd.max() > 0.03
    np.testing.assert_allclose(due, found.process_sd, rtol=1e-3)


def test_the_size_keeps_below_what_is_allowed():
    _, track = sailed(noise=0.003)
    largest = np.array([0.01, 0.02, 0.03])
    asked = EstimationProblem([track], None, np.zeros(0), np.zeros(0), learn_process=True, max_process_sd=largest)
    assert solve(asked, first(asked, process_sd=(1e-3,) * 3)).process_sd[2] == largest[2]


def test_what_is_missing_goes_with_the_dynamic_pressure_in_sway_and_yaw_only():
    _, track = sailed(n=3)
    stopping = track.with_channels(u=np.array([1.0, 1.0, 0.0]))
    asked = problem(stopping.with_channels(wind_north=np.zeros(3), wind_east=np.ones(3)), with_speed=True)
    np.testing.assert_allclose(asked.process_variance(0), [[1, 1, 1], [1, 0.6 / 1.1, 0.6 / 1.1]])
    assert (replace(asked, with_speed=False).process_variance(0) == 1).all()
    unknown = problem(stopping, with_speed=True)
    assert (unknown.process_variance(0) == 1).all()
