"""A run as linear equations: derivatives by another route, and the likelihood by dense matrices and by a filter."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import torch
from fleet import unchecked
from pytest import approx
from scipy.linalg import expm, logm
from tiers import mainly
from trials import CALM, CIRCLE, NOISE, SHIP, STEP, TIMED, about, run_of, sailed, states_of, tensor, values

from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.dynamics.base import calm_accelerations
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.effect.propulsion import PowerLimit, PropellerSideForce
from manoeuvre_nn.estimation.data_set import COEFFICIENT_SD_LEVELS
from manoeuvre_nn.estimation.effect_columns import contribution
from manoeuvre_nn.estimation.linear_run import Columns, IntegratedRun, is_nothing, joined, nothing
from manoeuvre_nn.estimation.linearised_run import LinearisedRun, Rate, integrated, run_equations, shown
from manoeuvre_nn.estimation.posterior import posterior
from manoeuvre_nn.recording.preparation import measured, with_measured, without_samples

COUNT, STATES = 12, 9
SPREAD = np.array([0.5, 0.4, 0.004, 30.0, 30.0, 0.1])
FORCE, FORCE_TIME = np.array([4e-3, 6e-3, 5e-5]), 20.0


@cache
def short(gaps: bool = True) -> LinearisedRun:
    """Twelve noisy samples of a turn with a shaft that slows down, about a track that is a little off."""
    record = sailed([TIMED])[0].between(18.0, 18.0 + COUNT - 1)
    run = run_of(record, NOISE, seed=3, rudder_noise=0.01).with_channels(shaft=np.linspace(1.0, 0.9, COUNT))
    g = np.random.default_rng(5)
    if gaps:
        run = without_samples(run, g.random(measured(run).shape) < 0.2)
    wander = np.array([0.03, 0.03, 1e-4, 0.3, 0.3, 1e-3]) * g.standard_normal((COUNT, 6))
    return about(run, states_of(record) + wander)


def some_columns(line: LinearisedRun, count: int = 3) -> Columns:
    g = np.random.default_rng(8)
    moved = g.standard_normal((COUNT - 1, 6, count)) * np.array([0.01, 0.01, 1e-4, 0.1, 0.1, 1e-3])[:, None]
    return Columns(g.standard_normal((COUNT, 8, count)) * NOISE[:, None], moved)


def forgetting(line: LinearisedRun, k: int, decay: float) -> np.ndarray:
    """What a step makes of the states, the process noise held within it and forgotten at its end."""
    return np.diag([1.0] * 6 + [decay] * 3) @ line.transition[k]


class Dense:
    """The same linear model with every matrix written out: states of all samples stacked, measured samples kept."""

    def __init__(self, line: LinearisedRun, time: float = FORCE_TIME):
        self.keep, h = np.isfinite(measured(line.run)).ravel(), line.run.step
        decay = np.exp(-h / time)
        tiny = np.array([1e-4, 1e-4, 1e-6, 2e-3, 2e-3, 2e-6]) * np.sqrt(h)
        blocks = []
        for push in line.rudder_push * line.run.meta["rudder_noise"]:
            q = np.diag(np.concatenate([tiny**2, FORCE**2 * (1 - decay**2)]))
            q[:6, :6] += np.outer(push, push)
            blocks.append(q)
        # States follow from the first one and the pushes: s = reach @ (first, push 1, push 2, ...).
        n = COUNT * STATES
        self.reach = np.eye(n)
        for k in range(1, COUNT):
            here, before = slice(k * STATES, (k + 1) * STATES), slice((k - 1) * STATES, k * STATES)
            self.reach[here] += forgetting(line, k - 1, decay) @ self.reach[before]
        drive = np.zeros((n, n))
        drive[:STATES, :STATES] = np.diag(np.concatenate([SPREAD**2, FORCE**2]))
        for k, q in enumerate(blocks, start=1):
            drive[k * STATES : (k + 1) * STATES, k * STATES : (k + 1) * STATES] = q
        self.prior = self.reach @ drive @ self.reach.T
        watch = np.zeros((COUNT * 8, n))
        for k in range(COUNT):
            watch[k * 8 : (k + 1) * 8, k * STATES : (k + 1) * STATES] = line.observed[k]
        self.watch = watch[self.keep]
        self.covariance = self.watch @ self.prior @ self.watch.T + np.diag(np.tile(NOISE**2, COUNT)[self.keep])

    def driven(self, c: Columns) -> np.ndarray:
        """What disturbances do to the states."""
        pushes = np.zeros((COUNT, STATES, c.count))
        pushes[1:, :6] = c.moved
        return self.reach @ pushes.reshape(-1, c.count)

    def seen(self, c: Columns) -> np.ndarray:
        """What disturbances do to the measured samples."""
        return c.measured.reshape(-1, c.count)[self.keep] + self.watch @ self.driven(c)


def log_density(x: np.ndarray, covariance: np.ndarray) -> float:
    return float(-0.5 * (x @ np.linalg.solve(covariance, x) + np.linalg.slogdet(2 * np.pi * covariance)[1]))


def close(found, expected, rel=1e-6):
    assert found == approx(expected, rel=rel, abs=rel * np.abs(expected).max())


@pytest.mark.parametrize("gaps, time", [(False, FORCE_TIME), (True, FORCE_TIME), (True, 2.0), (True, 300.0)])
def test_inner_products_are_those_in_the_metric_of_the_samples_covariance(gaps, time):
    line = short(gaps)
    white, dense = integrated(line, NOISE, FORCE, time, SPREAD), Dense(line, time)
    both = joined([line.data, some_columns(line)])
    c = dense.seen(both)
    embedded = white.embed(both)
    close(embedded.dot(embedded), c.T @ np.linalg.solve(dense.covariance, c))
    assert embedded.dot(white.embed(line.data)).shape == (4, 1)


@pytest.mark.parametrize("gaps", [False, True])
def test_the_normaliser_is_that_of_the_samples_covariance(gaps):
    line = short(gaps)
    expected = -0.5 * np.linalg.slogdet(Dense(line).covariance)[1]
    assert integrated(line, NOISE, FORCE, FORCE_TIME, SPREAD).log_norm == approx(expected, abs=1e-6)


def test_equations_that_are_kept_give_at_another_size_of_the_process_noise_what_new_ones_give():
    line, size = short(), np.array([3.0, 0.2, 5.0]) * FORCE
    equations, columns = run_equations(line, NOISE, FORCE_TIME, SPREAD), joined([line.data, some_columns(line)])
    first, kept = (IntegratedRun(equations, sd) for sd in (FORCE, size))
    new = integrated(line, NOISE, size, FORCE_TIME, SPREAD)
    before, e, whole = first.embed(columns), kept.embed(columns), new.embed(columns[:])
    close(e.dot(e), whole.dot(whole), 1e-9)
    close(kept.states(e), new.states(whole), 1e-9)
    assert kept.log_norm == approx(new.log_norm, abs=1e-9)
    assert np.abs(before.dot(before) - e.dot(e)).max() > 1e-3 * np.abs(e.dot(e)).max()


@pytest.mark.parametrize("larger", [1.0, 1e7])
def test_the_root_of_a_steps_precision_makes_its_covariance_one_however_far_the_rudder_pushes(larger):
    line = short()
    line = replace(line, rudder_push=larger * line.rudder_push)
    root, push = run_equations(line, NOISE, FORCE_TIME, SPREAD).root[:, :6, :6], 0.01 * line.rudder_push
    of_push, of_rounding = np.einsum("kij,kj->ki", root, push), root * (line.states.step_sd * line.run.step**0.5)
    size = np.einsum("kij,kj->ki", np.linalg.inv(of_rounding), of_push)  # the push over rounding
    length = np.linalg.norm(size, axis=1)
    assert np.linalg.norm(of_push, axis=1) == approx(length / np.sqrt(1 + length**2))
    across = np.eye(6) - size[:, :, None] * size[:, None, :] / length[:, None, None] ** 2
    close(of_rounding.transpose(0, 2, 1) @ of_rounding @ across, across, 1e-9)
    assert (length > 1e3).any() == (larger > 1)


def test_columns_that_enter_channels_or_steps_alone_are_as_among_others():
    """A force and a sensor's error apart, sliced and joined, against all columns together."""
    line = short()
    white, columns = integrated(line, NOISE, FORCE, FORCE_TIME, SPREAD), joined([line.data, some_columns(line)])
    none = columns - columns
    parts = [Columns(columns.measured, none.moved), Columns(none.measured, columns.moved)]
    whole, (seen, moved) = white.embed(columns), (white.embed(part) for part in parts)
    both = seen.joined(moved)
    n = columns.count
    products, cross = both.dot(both), seen.dot(moved)
    close(products, np.block([[seen.dot(seen), cross], [cross.T, moved.dot(moved)]]), 1e-9)
    close(both[n:].dot(both[n:]), moved.dot(moved), 1e-9)
    close(seen.dot(seen) + cross + cross.T + moved.dot(moved), whole.dot(whole), 1e-9)
    shares = np.arange(1.0, n + 1)
    close(whole.combined(shares).dot(whole)[0], shares @ whole.dot(whole), 1e-9)


@pytest.mark.parametrize("part", ["measured", "moved"])
def test_parts_that_add_nothing_are_as_zeros_written_out(part):
    """Of a force the samples, of a sensor the motion: whatever is made of such columns, without a number of theirs."""
    line = short()
    some = some_columns(line)
    absent = nothing(*getattr(some, part).shape)
    lean, full = (replace(some, **{part: zeros}) for zeros in (absent, np.zeros(absent.shape)))
    mask, shares = np.array([True, False, True]), np.array([1.0, -2.0, 3.0])

    def made(c: Columns) -> list[Columns]:
        return [c[1:], c[mask], c + c, c - c[:1], c / shares, c.combined(shares), joined([c, c[:1]]), c + some]

    white = integrated(line, NOISE, FORCE, FORCE_TIME, SPREAD)
    for one, other in zip(made(lean), made(full), strict=True):
        assert np.array_equal(one.measured, other.measured) and np.array_equal(one.moved, other.moved)
        close(white.embed(one).dot(white.embed(one)), white.embed(other).dot(white.embed(other)), 1e-12)
    assert all(is_nothing(getattr(c, part)) for c in made(lean)[:-1])
    assert not is_nothing(np.zeros((2, 1, 1))) and not is_nothing(np.broadcast_to(1.0, (2, 3, 1)))


def test_the_likelihood_is_that_of_a_kalman_filter():
    line = short()
    white = integrated(line, NOISE, FORCE, FORCE_TIME, SPREAD)
    e = white.embed(line.data)
    samples = np.isfinite(measured(line.run)).sum()
    found = white.log_norm - 0.5 * float(e.dot(e)[0, 0]) - 0.5 * samples * np.log(2 * np.pi)
    assert found == approx(filtered(line), abs=1e-6)


def filtered(line: LinearisedRun) -> float:
    """Log likelihood of a run by a Kalman filter that takes in one channel after the other."""
    decay = np.exp(-line.run.step / FORCE_TIME)
    tiny = np.array([1e-4, 1e-4, 1e-6, 2e-3, 2e-3, 2e-6]) * np.sqrt(line.run.step)
    mean, p = np.zeros(STATES), np.diag(np.concatenate([SPREAD**2, FORCE**2]))
    total = 0.0
    for k in range(COUNT):
        if k:
            a = forgetting(line, k - 1, decay)
            push = np.concatenate([line.rudder_push[k - 1] * line.run.meta["rudder_noise"], np.zeros(3)])
            mean = a @ mean + np.concatenate([line.defect[k - 1], np.zeros(3)])
            p = a @ p @ a.T + np.outer(push, push)
            p += np.diag(np.concatenate([tiny**2, FORCE**2 * (1 - decay**2)]))
        for c in np.flatnonzero(np.isfinite(measured(line.run)[k])):
            h = line.observed[k, c]
            s = h @ p @ h + NOISE[c] ** 2
            e = line.residual[k, c] - h @ mean
            total -= 0.5 * (e**2 / s + np.log(2 * np.pi * s))
            mean, p = mean + p @ h * e / s, p - np.outer(p @ h, h @ p) / s
    return float(total)


def test_the_most_likely_states_are_the_mean_of_the_dense_posterior():
    line = short()
    white, dense, data = integrated(line, NOISE, FORCE, FORCE_TIME, SPREAD), Dense(line), line.data
    # The data's column carries minus what the model misses: states driven by the defect, corrected by the samples.
    gain = dense.prior @ dense.watch.T @ np.linalg.inv(dense.covariance)
    expected = (gain @ dense.seen(data) - dense.driven(data)).reshape(COUNT, STATES)
    found = white.states(white.embed(data))[..., 0]
    for k in range(STATES):
        close(found[:, k], expected[:, k], 1e-5)


@pytest.mark.parametrize("scatter", range(len(COEFFICIENT_SD_LEVELS)))
def test_the_evidence_is_the_density_of_a_dense_gaussian_with_coefficients_and_parameters_integrated_out(scatter):
    """Two coefficients, whose spread is the level of scatter, and a parameter with a mean of its own."""
    line = short()
    white, dense, columns = integrated(line, NOISE, FORCE, FORCE_TIME, SPREAD), Dense(line), some_columns(line)
    e = white.embed(joined([line.data, columns]))
    prior = np.array([1.0, 2.0, 3.0])
    data = np.array([1.0, 0.0, 0.0, -0.7])
    found = posterior(e.dot(e), white.log_norm, prior, data, COEFFICIENT_SD_LEVELS, 2)
    sd = prior * np.array([COEFFICIENT_SD_LEVELS[scatter]] * 2 + [1.0])
    c, d = dense.seen(columns), dense.seen(line.data)[:, 0]
    d = d - 0.7 * c[:, 2]
    whole = dense.covariance + (c * sd**2) @ c.T
    evidence = found.evidence[scatter] - 0.5 * len(d) * np.log(2 * np.pi)
    assert evidence == approx(log_density(d, whole), abs=1e-6)
    mean = sd**2 * (c.T @ np.linalg.solve(whole, d))
    close(found.mean(scatter), mean, 1e-6)
    precision = c.T @ np.linalg.solve(dense.covariance, c) + np.diag(sd**-2)
    close(found.covariance(scatter), np.linalg.inv(precision), 1e-6)


def fine_step(state: torch.Tensor, start: float, end: float, shaft: float, h: float, parts: int = 20) -> torch.Tensor:
    """One sample further by many small steps, the rudder turning evenly; differentiable."""
    rate = Rate(CALM)

    def slope(s, share):
        cos, sin = torch.cos(s[5]), torch.sin(s[5])
        delta = s.new_tensor(start) + share * (end - start)
        a = rate(s[:3], delta, s.new_tensor(shaft)) + s[6:]
        return torch.cat([a, torch.stack([s[0] * cos - s[1] * sin, s[0] * sin + s[1] * cos, s[2]]), 0 * s[6:]])

    dt = h / parts
    for k in range(parts):
        k1 = slope(state, k / parts)
        k2 = slope(state + 0.5 * dt * k1, (k + 0.5) / parts)
        k3 = slope(state + 0.5 * dt * k2, (k + 0.5) / parts)
        k4 = slope(state + dt * k3, (k + 1) / parts)
        state = state + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return state


@pytest.mark.parametrize("k", mainly(1, [7, 0]))
def test_the_transition_is_the_derivative_of_a_fine_solution_by_autograd(k):
    line = short()
    run, h = line.run, line.run.step
    state = torch.cat([tensor(line.track[k]), torch.zeros(3).double()])
    shaft = float(run["shaft"][k : k + 2].mean())
    step = (float(run["delta"][k]), float(run["delta"][k + 1]), shaft, h)
    with unchecked():
        jacobian = torch.autograd.functional.jacobian(lambda s: fine_step(s, *step), state).numpy()
        end = fine_step(state, *step).numpy()
        turned = fine_step(state, step[0] + 1e-4, step[1] + 1e-4, shaft, h).numpy()
    size = np.array([0.05, 0.05, 5e-4, 1.0, 1.0, 2e-3, 1e-3, 1e-3, 1e-5])
    difference = (line.transition[k] - jacobian) * size / size[:, None]
    assert np.abs(difference).max() < 1e-3 and line.transition[k, 5, 2] == approx(1.0, rel=0.1)
    assert line.defect[k] == approx(end[:6] - line.track[k + 1], abs=1e-4)
    push = (turned - end)[:3] / 1e-4
    assert line.rudder_push[k, :3] == approx(push, rel=0.01)


def test_what_is_observed_is_the_difference_quotient_of_what_sensors_show():
    line = short()
    for j, size in enumerate((1e-3, 1e-3, 1e-5, 1e-2, 1e-2, 1e-5)):
        nudge = size * np.eye(6)[j]
        slope = (shown(line.track + nudge) - shown(line.track - nudge)) / (2 * size)
        assert line.observed[:, :, j] == approx(slope, abs=1e-7)
    assert not line.observed[:, :, 6:].any()


def test_perfect_sensors_show_the_rate_of_the_track():
    with unchecked():
        record = sailed([TIMED])[0]
        path, t = shown(states_of(record)), record.time
    for position, velocity in ((0, 2), (1, 3), (4, 5)):
        assert np.gradient(path[:, position], t)[1:-1] == approx(path[1:-1, velocity], rel=0.01, abs=0.02)
    assert np.array_equal(path[:, 6], record["u"]) and (path[:, 7] == 1).all()


def test_a_noise_free_run_about_its_own_track_leaves_nothing():
    record = sailed([TIMED])[0]
    line = about(run_of(record), states_of(record))
    assert np.abs(line.residual).max() < 1e-9
    assert np.abs(line.defect / np.array([1e-3, 1e-3, 1e-5, 1e-3, 1e-3, 1e-5])).max() < 1.0


def test_a_heading_that_the_recorder_wraps_is_the_same_heading():
    record = sailed([TIMED])[0]
    run = run_of(record, NOISE)
    turns = np.zeros_like(measured(run))
    turns[:, 4] = 2 * np.pi * (np.arange(len(run)) % 3 - 1)
    wrapped = with_measured(run, measured(run) + turns)
    assert about(wrapped, states_of(record)).residual == approx(about(run, states_of(record)).residual, abs=1e-9)


def test_what_a_hypothesis_adds_is_taken_out_of_the_data():
    line = short()
    c = some_columns(line, 1)
    less = line.data - c
    close(less.measured, line.data.measured - c.measured)
    close(less.moved, line.data.moved - c.moved)


def test_at_another_shaft_speed_the_rate_is_that_of_a_ship_with_such_an_engine():
    """An engine that holds 0.8 of the nominal speed, as the ship with effects computes it."""
    g = torch.Generator().manual_seed(1)
    draw = torch.rand(5, 4, generator=g).double()
    u0 = SHIP.particulars.speed
    nu = torch.stack([u0 * (0.5 + 0.5 * draw[:, 0]), draw[:, 1] - 0.5, 0.02 * (draw[:, 2] - 0.5)], dim=-1)
    delta, ratio = 0.6 * (draw[:, 3] - 0.5), torch.tensor([0.6, 0.8, 0.9, 1.0, 1.1]).double()
    engine = Vessel(CALM, [PowerLimit(SHIP)]).model
    state = torch.cat([nu, torch.zeros(5, 3).double(), ratio[:, None]], dim=-1)
    expected = engine(state, Inputs(delta))[:, :3]
    assert torch.allclose(Rate(CALM)(nu, delta, ratio), expected, atol=1e-12)
    nominal = Rate(CALM)(nu, delta, torch.ones(5).double())
    assert torch.allclose(nominal, calm_accelerations(CALM, nu, delta), atol=1e-12)
    assert (nominal - expected)[:, 0].abs().argsort()[0] == 3


def test_a_run_can_be_cut_and_samples_marked():
    run: Recording = short().run
    part = run.between(0.0, run.time[4])
    assert len(part) == 5 and measured(part).shape == (5, 8) and len(part["order_lead"]) == 5
    bad = np.zeros_like(measured(run), dtype=bool)
    bad[3, 2] = True
    marked = without_samples(run, bad)
    assert np.isnan(measured(marked)[3, 2])
    assert np.isnan(measured(marked)).sum() - np.isnan(measured(run)).sum() == int(np.isfinite(measured(run)[3, 2]))


@pytest.mark.parametrize("force", [60.0, 600.0])
def test_a_ship_that_is_pushed_hard_turns_by_as_much_as_she_yaws(force):
    """Over minutes a heading that is off by a thousandth of a degree a second looks like a bias of the rate gyro."""
    pushed = PropellerSideForce(SHIP, force_kN=force)
    (record,) = sailed([CIRCLE], [pushed], STEP)
    line = about(run_of(record), states_of(record))
    with unchecked():
        added = contribution(pushed, values(pushed), line)
    left = (added.moved[..., 0] + line.defect)[:, 5] / STEP
    assert abs(left.mean()) / DEGREE < 2e-4  # deg/s; (I + A)/2 for what a step carries is off by 3.3e-4 and 2.5e-3


def test_a_step_carries_a_push_as_the_matrix_exponential_does():
    """``int_0^h exp(J s) ds / h``, J from the logarithm of the step's transition."""
    h, k = STEP, 6
    line = about(run_of(sailed([CIRCLE], (), STEP)[0]), states_of(sailed([CIRCLE], (), STEP)[0]))
    for a, carried in zip(line.transition[::30, :k, :k], line.carried[::30].numpy(), strict=True):
        j = logm(a) / h
        whole = expm(h * np.block([[j, np.eye(k)], [np.zeros((k, 2 * k))]]))[:k, k:] / h
        rows = [0, 1, 2, 5]  # how the track turns within the step, a constant J does not have
        usual = line.states.unit[:3] / line.states.unit[rows, None]
        assert usual * carried[rows, :3] == approx(usual * whole[rows, :3], rel=1e-3, abs=5e-4)
