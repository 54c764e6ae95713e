import numpy as np
import pytest
import tiny
import torch
from levenberg import split

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.network.hull_rudder import HullRudder
from manoeuvre_nn.network.perceptron import Perceptron
from manoeuvre_nn.network.radial import GeneralRegression, RadialBasis
from manoeuvre_nn.network.recursive import RecursiveNetwork
from manoeuvre_nn.network.series import Series
from manoeuvre_nn.numerics.steepest_descent import RateSchedule, StoppingRules
from manoeuvre_nn.training.fits import BackpropFit, LevenbergMarquardtFit


def errors(trained) -> list[float]:
    return [row["train/mse"] for row in trained.history]


def loss(fit, data=None) -> float:
    """Mean square error over all outputs, in the network's scaling, by its plain forward pass."""
    x, y, *_ = next(iter((data or tiny.usual()).train_dataloader()))
    scaling = fit.dynamics.scaling
    with torch.no_grad():
        wrong = fit.dynamics.network(scaling.inputs(x)) - scaling.outputs(y)
    return float(wrong.square().mean())


@pytest.mark.parametrize("make", [tiny.lm, tiny.backprop])
def test_one_epoch_lowers_the_error_and_tells_the_true_one(make, tmp_path):
    fit = make()
    before = loss(fit)
    trained, _ = tiny.train(fit, tmp_path, max_epochs=1, every=1, checked=True)
    assert loss(fit) < before
    if make is tiny.lm:  # backpropagation logs before its last iteration's weights are judged: see below
        assert errors(trained) == [pytest.approx(loss(fit), rel=1e-9)]


def test_levenberg_marquardt_identifies_the_mariner_in_few_epochs(tmp_path):
    data = tiny.simulated(length=300.0, score=[zigzag(20.0, duration=60.0)])
    fit = LevenbergMarquardtFit(tiny.dynamics(data, 7), **split(damping="nielsen"), iterations_per_epoch=10)
    trained, scorer = tiny.train(fit, tmp_path, data=data, max_epochs=20, every=20, keep="last")
    assert fit.relative_rmse(data.tuples.inputs, data.tuples.targets).max() < 0.01
    assert scorer.scores[0].dev_L < 0.05


@pytest.mark.parametrize("network", [GeneralRegression, HullRudder, RadialBasis, RecursiveNetwork, Series])
def test_a_network_that_has_a_fit_of_its_own_is_trained_by_no_other(network):
    for fit in (BackpropFit, LevenbergMarquardtFit):
        assert fit.trains(Perceptron) and not fit.trains(network)


def test_relative_rmse_is_the_error_of_each_g_over_its_root_mean_square():
    fit, data = tiny.lm(), tiny.usual()
    x, g = data.tuples.inputs, data.tuples.targets
    found = fit.relative_rmse(x, g).numpy()
    wrong = fit.unknown_force(x).numpy() - g.numpy()
    np.testing.assert_allclose(found, np.sqrt((wrong**2).mean(0) / (g.numpy() ** 2).mean(0)))
    assert len(set(found.round(6))) == 3


def test_iterations_of_an_epoch_are_as_good_as_epochs(tmp_path):
    many, _ = tiny.train(tiny.lm(), tmp_path / "a", max_epochs=6, keep="last")
    few, _ = tiny.train(tiny.lm(iterations_per_epoch=3), tmp_path / "b", max_epochs=2, keep="last")
    assert all(np.array_equal(a, b) for a, b in zip(tiny.weights(many.fit), tiny.weights(few.fit), strict=True))


def test_the_jacobian_in_blocks_leads_where_the_whole_one_leads(tmp_path, monkeypatch):
    whole, _ = tiny.train(tiny.lm(), tmp_path / "a", max_epochs=3, keep="last")
    monkeypatch.setattr("manoeuvre_nn.training.fits.LARGEST_BLOCK", 500)
    parts, _ = tiny.train(tiny.lm(), tmp_path / "b", max_epochs=3, keep="last")
    for a, b in zip(tiny.weights(whole.fit), tiny.weights(parts.fit), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-6, atol=1e-9)


def test_a_rising_validation_error_ends_levenberg_marquardt(tmp_path):
    data = tiny.simulated(validation=0.3, noise={"v": 0.2, "r_deg_s": 0.2}, accelerations="central")
    fit = tiny.lm(data, hidden=12, max_fail=2)
    trained, _ = tiny.train(fit, tmp_path, data=data, max_epochs=150, every=150)
    assert trained.epochs < 150 and "validation" in trained.stopped


def presentations(count=10, epoch=0, **options):
    fit = tiny.backprop(**options)
    type(fit).current_epoch = property(lambda self: epoch)
    try:
        return [int(i) for part in fit._presentations(count) for i in part]
    finally:
        del type(fit).current_epoch


def test_samples_are_presented_in_an_order_of_seed_and_epoch_alone():
    torch.manual_seed(1)
    first = presentations(batch_size=1, iterations_per_epoch=10, seed=4, epoch=2)
    torch.manual_seed(2)
    assert presentations(batch_size=1, iterations_per_epoch=10, seed=4, epoch=2) == first
    assert presentations(batch_size=1, iterations_per_epoch=10, seed=5, epoch=2) != first
    assert presentations(batch_size=1, iterations_per_epoch=10, seed=4, epoch=3) != first
    assert sorted(first) == list(range(10))


def test_every_sample_is_presented_before_any_is_again():
    order = presentations(batch_size=3, iterations_per_epoch=7, seed=0)
    assert len(order) == 21
    assert sorted(order[:10]) == sorted(order[10:20]) == list(range(10))


def test_one_sample_an_iteration_is_the_thesis_rule(tmp_path):
    """w(n+1) = w(n) - eta dE/dw + alpha (w(n) - w(n-1)), E the sum of squares over the outputs of ONE sample."""
    fit, copy = (tiny.backprop(batch_size=1, iterations_per_epoch=30, momentum=0.5, seed=7) for _ in range(2))
    order = presentations(91, batch_size=1, iterations_per_epoch=30, seed=7)
    data, moves = tiny.usual(), [0.0, 0.0]
    x, y = copy.dynamics.scaling.inputs(data.tuples.inputs), copy.dynamics.scaling.outputs(data.tuples.targets)
    parameters = list(copy.dynamics.network.parameters())
    for k in order:
        gradients = torch.autograd.grad((copy.dynamics.network(x[k]) - y[k]).square().sum(), parameters)
        moves = [0.5 * m - 0.1 * g for m, g in zip(moves, gradients, strict=True)]
        with torch.no_grad():
            for p, m in zip(parameters, moves, strict=True):
                p += m
    tiny.train(fit, tmp_path, max_epochs=1, keep="last")
    for a, b in zip(tiny.weights(fit), tiny.weights(copy), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("batch_size", [None, 16])
def test_backpropagation_is_torchs_sgd_where_the_rate_is_constant(tmp_path, batch_size):
    constant = RateSchedule(rates=(0.05,), iterations=(1,), shake_rate=0.0)
    fit, copy = (tiny.backprop(batch_size=batch_size, schedule=constant, iterations_per_epoch=25) for _ in range(2))
    data, network = tiny.usual(), copy.dynamics.network
    x, y = copy.dynamics.scaling.inputs(data.tuples.inputs), copy.dynamics.scaling.outputs(data.tuples.targets)
    sgd = torch.optim.SGD(network.parameters(), lr=0.05, momentum=0.9)
    for epoch in range(2):
        order = [None] * 25
        if batch_size:
            order = torch.tensor(presentations(91, epoch, batch_size=16, iterations_per_epoch=25)).split(16)
        for chosen in order:
            part, target = (x, y) if chosen is None else (x[chosen], y[chosen])
            sgd.zero_grad()
            (network(part) - target).square().sum(1).mean().backward()
            sgd.step()
    tiny.train(fit, tmp_path, max_epochs=2, keep="last")
    for a, b in zip(tiny.weights(fit), tiny.weights(copy), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-11)


def test_backpropagation_tells_the_error_at_the_end_of_the_epoch(tmp_path):
    fit = tiny.backprop()
    trained, _ = tiny.train(fit, tmp_path, max_epochs=3, every=1, keep="last")
    assert errors(trained)[-1] == pytest.approx(loss(fit), rel=1e-9)
    assert errors(trained) == sorted(errors(trained), reverse=True)


@pytest.mark.parametrize(
    "rules, reason",
    [
        (StoppingRules(max_iterations=60), "iterations used up"),
        (StoppingRules(goal=0.9), "goal reached"),
        (StoppingRules(test_rise=1.0 + 1e-9), "error on the test data rises"),
    ],
)
def test_each_stopping_rule_ends_the_training(tmp_path, rules, reason):
    data = tiny.simulated(validation=0.2)
    lively = RateSchedule(rates=(0.3,), iterations=(1,), shake_rate=0.0) if rules.test_rise < 2 else None
    more = {"schedule": lively} if lively else {}
    trained, _ = tiny.train(tiny.backprop(data, stopping=rules, **more), tmp_path, data=data, max_epochs=100, every=100)
    assert trained.stopped == reason and trained.epochs < 100
    if reason == "iterations used up":
        assert trained.epochs == 3


def test_an_error_that_is_not_finite_ends_backpropagation(tmp_path):
    wild = RateSchedule(rates=(1e200,), iterations=(1,), shake_rate=0.0)
    trained, scorer = tiny.train(
        tiny.backprop(schedule=wild, stopping=StoppingRules()), tmp_path, max_epochs=50, every=50, keep="last"
    )
    assert trained.stopped == "error is not finite" and trained.epochs < 5
    assert scorer.scores[0].status.startswith("left the physical range")


@pytest.mark.parametrize("kind", [LevenbergMarquardtFit, BackpropFit])
def test_single_precision_trains_and_stays_single(tmp_path, kind):
    data = tiny.simulated(dtype=torch.float32)
    fit = kind(tiny.dynamics(data, 3, "balanced", dtype=torch.float32), iterations_per_epoch=5)
    before = loss(fit, data)
    tiny.train(fit, tmp_path, data=data, max_epochs=1)
    assert {p.dtype for p in fit.parameters()} == {torch.float32}
    assert loss(fit, data) < before


@pytest.mark.parametrize(
    "make, told",
    [
        (lambda: tiny.lm(iterations_per_epoch=0), "fit.iterations_per_epoch=0: expected 1 to 1e+06"),
        (lambda: tiny.lm(iterations_per_epoch=10**21), f"fit.iterations_per_epoch={10**21}: expected 1 to 1e+06"),
        (lambda: tiny.backprop(batch_size=0), "fit.batch_size=0: expected at least 1, or null for all samples"),
        (lambda: tiny.backprop(momentum=1.5).configure_optimizers(), "fit.momentum=1.5: expected 0 or more"),
        (lambda: tiny.lm(mu=-1.0).configure_optimizers(), "expected 0 < mu < mu_max"),
    ],
)
def test_settings_out_of_range_are_refused_in_one_line(make, told):
    with pytest.raises(InputError) as refusal:
        make()
    assert told in str(refusal.value)
