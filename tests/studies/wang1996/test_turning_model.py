from dataclasses import replace
from functools import cache
from math import exp, inf

import numpy as np
import pytest
import torch
from fleet import ship_named, unchecked
from pytest import approx
from tiers import mainly

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.dynamics.limits import OK
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.dynamics.simulate import simulate
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.scoring.score import score
from manoeuvre_nn.ship.mariner import COEFFICIENTS, INERTIA, WANG
from manoeuvre_nn.ship.taylor import TaylorShip
from studies.wang1996.sway_curve import SwayCurve, gate, stack
from studies.wang1996.turning import _Joined, find_fold, fit_turn
from studies.wang1996.turning_model import TurningModel, predict

SLOPE = -0.45
UNIT = WANG.time_unit


def mirrored_ship():
    """The Mariner without the offsets Y0 and N0: port and starboard are alike."""
    even = {e: {k: c for k, c in terms.items() if k != "0"} for e, terms in COEFFICIENTS.items()}
    return TaylorShip(WANG, INERTIA, even, positive_rudder_turns_to="port")


def linear_ship():
    """A ship with a linear yaw equation."""
    linear = {"X": COEFFICIENTS["X"], "Y": {}, "N": {k: COEFFICIENTS["N"][k] for k in "vrd"}}
    return TaylorShip(WANG, INERTIA, linear, positive_rudder_turns_to="port")


@cache
def turn(angle, side="starboard", ship="mariner", duration=300.0):
    made = mirrored_ship() if ship == "mirrored" else ship_named(ship)
    with unchecked():
        (run,) = roll_out(CalmWater(made), [turning_circle(float(angle), side, duration=duration)])
    return run


@cache
def fitted(angle, side="starboard", ship="mariner", branches=2):
    with unchecked():
        return fit_turn(turn(angle, side, ship), WANG, branches=branches, starts=2, iterations=200)


def made_up(r_prime, v_prime, name="made up"):
    """A turn with a given v'(t) and r'(t)."""
    times = np.arange(len(r_prime), dtype=float)
    return Recording(name, times, {"r": r_prime / UNIT, "v": v_prime * WANG.speed})


def straight_line(side=1):
    r = side * 0.3 * (1 - np.exp(-np.arange(200) / 20.0))
    return made_up(r, SLOPE * r)


class ByTime(torch.nn.Module):
    """The sway velocity of a simulation as a function of time alone: cubics through v and vdot."""

    def __init__(self, run):
        super().__init__()
        self.register_buffer("v", torch.tensor(run["v"] / WANG.speed))
        self.register_buffer("rate", torch.tensor(run["vdot"] / WANG.speed * UNIT))
        self.step = (run.time[1] - run.time[0]) / UNIT

    def forward(self, r, time):
        at = (time / self.step).clamp(max=len(self.v) - 1.000001)
        low, s = at.floor().long(), at - at.floor()
        h, a, b = self.step, self.v[low], self.v[low + 1]
        c, d = h * self.rate[low], h * self.rate[low + 1]
        third, second = 2 * a - 2 * b + c + d, -3 * a + 3 * b - 2 * c - d
        v = ((third * s + second) * s + c) * s + a
        return v, torch.zeros_like(r), ((3 * third * s + 2 * second) * s + c) / h

    def row(self, index):
        return self


class Line(torch.nn.Module):
    """v' = slope r'."""

    def __init__(self, slope):
        super().__init__()
        self.slope = slope

    def forward(self, r, time):
        return self.slope * r, torch.full_like(r, self.slope), torch.zeros_like(r)

    def row(self, index):
        return self


def analytic(angle_deg, times):
    """r' of ``(Iz - Nrdot - Nvdot a) rdot = (Nv a + Nr) r + Nd d`` with the rudder going over at its rate."""
    N = COEFFICIENTS["N"]
    inertia, damping, rudder = INERTIA["mz"] - INERTIA["Nvdot"] * SLOPE, N["v"] * SLOPE + N["r"], -N["d"]
    pole, gain = damping / inertia, -rudder / damping
    rate, arrival = WANG.rudder_rate * UNIT, angle_deg * DEGREE / (WANG.rudder_rate * UNIT)
    ramp = lambda t: gain * rate * (t + (1 - exp(pole * t)) / pole)  # noqa: E731
    over = gain * angle_deg * DEGREE
    late = lambda t: over + (ramp(arrival) - over) * exp(pole * (t - arrival))  # noqa: E731
    return np.array([ramp(t) if t < arrival else late(t) for t in times / UNIT])


@pytest.mark.parametrize("angle", [10, 30])
def test_a_straight_v_of_r_gives_the_analytic_turn(angle):
    order = turning_circle(float(angle), duration=120.0)
    (run,) = predict(TurningModel(linear_ship(), Line(SLOPE)), [order])
    np.testing.assert_allclose(run["r"] * UNIT, analytic(angle, run.time), atol=1e-5)
    np.testing.assert_allclose(run["v"], SLOPE * WANG.length * run["r"], atol=1e-9)


def test_a_network_trained_on_a_straight_line_gives_the_analytic_turn():
    fit = fit_turn(straight_line(), WANG, starts=3, iterations=150)
    assert float(fit.sse.min()) < 1e-8
    (run,) = predict(TurningModel(linear_ship(), fit.best), [turning_circle(6.0, duration=120.0)])
    assert run["r"].max() * UNIT < 0.3, "within what the network has seen"
    np.testing.assert_allclose(run["r"] * UNIT, analytic(6, run.time), atol=2e-4)


@pytest.mark.slow
def test_both_solvers_agree():
    model, order = TurningModel(ship_named("mariner"), fitted(30).best), turning_circle(30.0, duration=120.0)
    with unchecked():
        (batch,), accurate = predict(model, [order]), simulate(model, order)
    for name, size in (("u", 1e-4), ("v", 1e-4), ("r", 1e-6), ("x", 1e-2), ("y", 1e-2)):
        np.testing.assert_allclose(batch[name], accurate[name], atol=size, err_msg=name)


@pytest.mark.parametrize("angle, largest, settled", [(20, 0.304, 0.2855), (30, 0.372, 0.329)])
def test_v_of_r_has_two_values_in_hard_turns(angle, largest, settled):
    fold = find_fold(turn(angle), WANG)
    assert fold.double_valued
    assert (fold.r, fold.settled) == approx((largest, settled), abs=6e-4)
    assert fold.falls_by == approx(1 - settled / largest, abs=2e-3)
    assert fold.apart > 0.3 * fold.largest_v
    assert fold.window[0] < fold.time < fold.window[1]


def test_the_branches_are_as_far_apart_as_they_were_made():
    rise, fall = np.linspace(0, 0.4, 101), np.linspace(0.4, 0.3, 26)[1:]
    fold = find_fold(made_up(np.r_[rise, fall], np.r_[-0.5 * rise, -0.2 - 0.3 * (0.4 - fall)]), WANG)
    assert (fold.time, fold.r, fold.settled) == approx((100, 0.4, 0.3))
    assert (fold.apart, fold.apart_at) == approx((0.08, 0.3)), "0.5 * 0.3 on the one, 0.23 on the other"


@pytest.mark.parametrize("side", [1, -1])
def test_a_straight_line_has_one_branch(side):
    assert not find_fold(straight_line(side), WANG).double_valued
    curve = fit_turn(straight_line(side), WANG, branches=2, starts=1, iterations=5).curve
    assert curve.weights.shape[1] == 1, "the second branch is left out"


@pytest.mark.slow
@pytest.mark.parametrize(
    "ship",
    ["great_lakes_bulker", "mariner_chislett1965", "esso_190k"],
)
def test_two_branches_predict_the_turns_of_other_ships(ship):
    made = ship_named(ship)
    order = turning_circle(20.0)
    with unchecked():
        (run,) = roll_out(CalmWater(made), [order])
        fit = fit_turn(run, made.particulars, branches=2, starts=2, iterations=200)
        (ahead,) = predict(TurningModel(made, fit.best), [order])
    assert ahead.status == OK
    assert score(ahead, run, made.particulars.length).dev_L < 0.02


@pytest.mark.slow
def test_port_is_starboard_mirrored():
    folds = [find_fold(turn(30, side, "mirrored"), WANG) for side in ("starboard", "port")]
    assert (folds[1].r, folds[1].settled) == approx((-folds[0].r, -folds[0].settled), rel=1e-9)
    assert folds[1].falls_by == approx(folds[0].falls_by)
    runs = []
    for side in ("starboard", "port"):
        model = TurningModel(mirrored_ship(), fitted(30, side, "mirrored").best)
        runs += predict(model, [turning_circle(30.0, side, duration=100.0)])
    for name, sign in {"u": 1, "v": -1, "r": -1, "x": 1, "y": -1}.items():
        np.testing.assert_allclose(runs[1][name], sign * runs[0][name], rtol=1e-6, atol=1e-6, err_msg=name)


@pytest.mark.parametrize("angle", mainly(1, [20, 30]))
def test_with_the_true_sway_velocity_the_prediction_is_the_simulation(angle):
    run = turn(angle)
    model = TurningModel(ship_named("mariner"), ByTime(run))
    (ahead,) = predict(model, [turning_circle(float(angle), duration=300.0)])
    assert score(ahead, run, WANG.length).dev_L < 2e-4
    np.testing.assert_allclose(ahead["r"], run["r"], atol=2e-4 * np.abs(run["r"]).max())


@pytest.mark.slow
@pytest.mark.parametrize("angle", [20, 30])
def test_two_branches_cure_what_one_network_cannot_do(angle):
    order, dev = turning_circle(float(angle), duration=300.0), {}
    for branches in (1, 2):
        with unchecked():
            (run,) = predict(TurningModel(ship_named("mariner"), fitted(angle, branches=branches).best), [order])
        dev[branches] = score(run, turn(angle), WANG.length).dev_L
    assert dev[1] > 0.1
    assert dev[2] < 0.002
    assert float(fitted(angle, branches=2).sse.min()) < 1e-4 * float(fitted(angle, branches=1).sse.min())


def test_the_curve_and_its_derivatives_fit_together():
    curve, h = fitted(30).best, 1e-6
    r, time = (
        x.flatten()
        for x in torch.meshgrid(torch.linspace(0, 0.4, 9).double(), torch.arange(4).double() + 0.7, indexing="ij")
    )
    v, by_r, by_t = curve(r, time)
    torch.testing.assert_close((curve(r + h, time)[0] - curve(r - h, time)[0]) / (2 * h), by_r, atol=1e-6, rtol=1e-6)
    torch.testing.assert_close((curve(r, time + h)[0] - curve(r, time - h)[0]) / (2 * h), by_t, atol=1e-6, rtol=1e-6)
    assert bool((by_t != 0).any()) and bool((by_t == 0).any()), "within the join and outside"


def test_the_join_has_no_kink():
    share, rate = gate(torch.tensor([0.0, 1.0, 2.0, 3.0, 9.0, inf]).double(), torch.tensor([1.0, 3.0]).double())
    assert share.tolist() == [0, 0, 0.5, 1, 1, 1]
    assert rate.tolist() == [0, 0, 0.75, 0, 0, 0]


def test_stacked_curves_are_each_their_own():
    curves = [fitted(20).curve, fitted(30, branches=1).curve]
    whole, r = stack(curves), torch.linspace(0.05, 0.3, 4).double()
    time = torch.full_like(r, 1.5)
    alone = [
        c.row(k)(r[i], time[i])
        for i, (c, k) in enumerate([(curves[0], 0), (curves[0], 1), (curves[1], 0), (curves[1], 1)])
    ]
    for together, one in zip(whole(r, time), zip(*alone, strict=True), strict=True):
        torch.testing.assert_close(together, torch.stack(one))
        torch.testing.assert_close(torch.stack([whole.row(k)(r[k], time[k])[0] for k in range(4)]), whole(r, time)[0])


def test_a_denominator_that_vanishes_ends_the_run_and_says_why():
    steep = INERTIA["mz"] / INERTIA["Nvdot"] * 1.2

    class Steeper(Line):
        def forward(self, r, time):  # the slope passes its limit at r' = .083
            return torch.zeros_like(r), 10 * steep * r, torch.zeros_like(r)

    (run,) = predict(TurningModel(linear_ship(), Steeper(0.0)), [turning_circle(10.0, duration=60.0)])
    assert "singular" in run.status and "dv/dr" in run.status
    assert run.time[-1] < 60 and np.isfinite(run["r"]).all()
    assert 0.05 < run["r"][-1] * UNIT < 1 / 12


def test_a_ship_that_runs_away_is_not_called_singular():
    (run,) = predict(TurningModel(linear_ship(), Line(-2.0)), [turning_circle(30.0, duration=900.0)])
    assert run.status.startswith("left the physical range")


def test_after_the_separation_time_the_ship_turns_steadily():
    model = TurningModel(ship_named("mariner"), fitted(20).best, separation=60.0)
    with unchecked():
        (held,) = predict(model, [turning_circle(20.0, duration=120.0)])
        (free,) = predict(TurningModel(ship_named("mariner"), fitted(20).best), [turning_circle(20.0, duration=120.0)])
    for name in ("v", "r"):
        np.testing.assert_allclose(held[name][60:], held[name][60], rtol=1e-9)
        np.testing.assert_allclose(held[name][:60], free[name][:60], rtol=1e-9)
    assert held["u"][120] < held["u"][60] and free["r"][120] != held["r"][120]


def test_with_the_speed_held_u_stays_and_the_yaw_rate_of_the_mariner_is_the_same():
    order = turning_circle(20.0, duration=100.0)
    with unchecked():
        runs = [
            predict(TurningModel(ship_named("mariner"), fitted(20).best, constant_speed=x), [order])[0]
            for x in (True, False)
        ]
    np.testing.assert_array_equal(runs[0]["u"], WANG.speed)
    np.testing.assert_allclose(runs[0]["r"], runs[1]["r"], rtol=1e-9)


def test_at_another_speed_the_turn_is_the_same_in_lengths():
    ship = ship_named("mariner")
    order = turning_circle(30.0, duration=100.0)
    slow = replace(order, duration=200.0).at_speed(WANG.speed / 2)
    model = TurningModel(ship, Line(SLOPE))
    # The rudder goes over at its own rate, so that only the steady turn is alike.
    fast_run, slow_run = predict(model, [order])[0], predict(model, [slow])[0]
    assert slow_run["r"][-1] * 2 == approx(fast_run["r"][-1], rel=1e-3)
    assert slow_run["v"][-1] * 2 == approx(fast_run["v"][-1], rel=1e-3)


def test_gradient_and_jacobian_are_those_of_autograd():
    x, shares = torch.linspace(-1, 1, 7).double(), torch.rand(7, 2, generator=torch.Generator().manual_seed(1)).double()
    weights = torch.randn(3, 20, generator=torch.Generator().manual_seed(2), dtype=torch.float64, requires_grad=True)
    problem = _Joined(x, x.square(), shares)
    mse, carry = problem.evaluate(weights)
    (slope,) = torch.autograd.grad(mse.sum(), weights)
    torch.testing.assert_close(problem.gradient(weights.detach()), slope)
    _, pull = problem.linearise(weights.detach(), tuple(c.detach() for c in carry))
    torch.testing.assert_close(2 / 7 * pull, slope)


def test_steepest_descent_lowers_the_error_from_negative_output_weights():
    few, more = (fit_turn(straight_line(), WANG, method="steepest_descent", iterations=n, starts=2) for n in (1, 300))
    assert bool((more.sse < 0.2 * few.sse).all())
    assert float(few.curve.weights[..., 10:15].mean()) < -0.1, "B is negative at the start, as v is"


def test_starts_are_those_of_the_seed():
    first, again, other = (
        fit_turn(straight_line(), WANG, starts=1, iterations=3, seed=s).sse.item() for s in (1, 1, 2)
    )
    assert first == again != other


@pytest.mark.parametrize("wrong", [{"branches": 3}, {"starts": 0}], ids=str)
def test_settings_that_make_no_sense_are_refused(wrong):
    with pytest.raises(InputError):
        fit_turn(straight_line(), WANG, **wrong)


def test_a_window_that_is_no_share_is_refused():
    with pytest.raises(InputError, match="window=1.0"):
        find_fold(straight_line(), WANG, window=1.0)


def test_a_run_that_is_no_turn_is_refused():
    still, weave = np.zeros(50), 0.2 * np.sin(np.arange(50) * 2 * np.pi / 49)
    for r in (still, weave):
        with pytest.raises(InputError, match="turn to one side"):
            find_fold(made_up(r, SLOPE * r), WANG)


def test_a_separation_time_that_is_not_positive_is_refused():
    with pytest.raises(InputError, match="separation"):
        TurningModel(linear_ship(), Line(SLOPE), separation=0.0)


def test_turns_of_different_length_are_not_predicted_together():
    orders = [turning_circle(10.0, duration=d) for d in (50.0, 60.0)]
    with pytest.raises(InputError, match="one after the other"):
        predict(TurningModel(linear_ship(), stack([fitted(20).curve])), orders)


def test_a_curve_with_one_row_is_its_own_row():
    assert isinstance(fitted(20).best.row(0), SwayCurve)
