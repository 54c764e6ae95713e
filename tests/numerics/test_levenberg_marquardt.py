"""Levenberg-Marquardt where the answer is known: closed forms, published problems, a plain second implementation."""

import io
from math import inf, nan

import lightning
import numpy as np
import pytest
import torch
from fleet import unchecked
from levenberg import lm
from torch.nn import Parameter

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.network.perceptron import Perceptron, wang_network
from manoeuvre_nn.numerics.damping import Reason
from manoeuvre_nn.numerics.levenberg_marquardt import REASONS, LevenbergMarquardt

DAMPINGS = ["trainlm", "nielsen"]
MISRA1A = """10.07 77.6 14.73 114.9 17.94 141.1 23.93 190.8 29.61 239.9 35.18 289.0 40.02 332.8 44.82 378.4 50.76 434.8
55.05 477.3 61.01 536.8 66.40 593.1 75.47 689.1 81.78 760.0"""
THURBER = """80.574 -3.067 84.248 -2.981 87.264 -2.921 87.195 -2.912 89.076 -2.840 89.608 -2.797 89.868 -2.702 90.101
-2.699 92.405 -2.633 95.854 -2.481 100.696 -2.363 101.060 -2.322 401.672 -1.501 390.724 -1.460 567.534 -1.274
635.316 -1.212 733.054 -1.100 759.087 -1.046 894.206 -0.915 990.785 -0.714 1090.109 -0.566 1080.914 -0.545
1122.643 -0.400 1178.351 -0.309 1260.531 -0.109 1273.514 -0.103 1288.339 0.010 1327.543 0.119 1353.863 0.377
1414.509 0.790 1425.208 0.963 1421.384 1.006 1442.962 1.115 1464.350 1.572 1468.705 1.841 1447.894 2.047
1457.628 2.200"""


def weights(*values: float, dtype: torch.dtype = torch.float64) -> Parameter:
    return Parameter(torch.tensor(values, dtype=dtype))


def fit(closure, parameters, epochs: int, **options) -> LevenbergMarquardt:
    optimizer = lm(parameters, **options)
    with unchecked():
        for _ in range(epochs):
            optimizer.step(closure)
    return optimizer


def rosenbrock(w: torch.Tensor) -> torch.Tensor:
    """Residuals of the banana; with rows, (K, 2)."""
    return torch.stack([10 * (w[..., 1] - w[..., 0].square()), 1 - w[..., 0]], -1)


def tuples(count: int, outputs: int = 3) -> tuple[torch.Tensor, torch.Tensor]:
    x = torch.linspace(-1, 1, count, dtype=torch.float64)
    inputs = torch.stack([torch.sin(k * x + k) for k in range(1, 5)], 1)
    targets = torch.stack([torch.cos((k + 2) * x) * x for k in range(outputs)])
    return inputs, targets


def rowwise(network: Perceptron, inputs: torch.Tensor, targets: torch.Tensor):
    return lambda: (network.rows(inputs)[..., 0] - targets).flatten(1)


def test_a_linear_problem_is_solved_in_one_step():
    generator = torch.Generator().manual_seed(1)
    a = torch.randn(9, 4, generator=generator, dtype=torch.float64)
    b = torch.randn(9, generator=generator, dtype=torch.float64)
    w = Parameter(torch.zeros(4, dtype=torch.float64))
    fit(lambda: a @ w - b, [w], 1, mu=1e-13)
    torch.testing.assert_close(w.detach(), torch.linalg.lstsq(a, b[:, None]).solution[:, 0], rtol=1e-11, atol=1e-12)


def test_a_damped_step_solves_the_damped_normal_equations():
    a = torch.tensor([[1.0, 2.0], [0.0, 1.0], [1.0, -1.0]], dtype=torch.float64)
    b = torch.tensor([1.0, 2.0, 3.0], dtype=torch.float64)
    w = weights(0.5, -0.5)
    start = w.detach().clone()
    optimizer = fit(lambda: a @ w - b, [w], 1, mu=0.7)
    move = torch.linalg.solve(a.T @ a + 0.7 * torch.eye(2, dtype=torch.float64), a.T @ (b - a @ start))
    torch.testing.assert_close(w.detach(), start + move, rtol=1e-13, atol=1e-14)
    torch.testing.assert_close(optimizer.loss, (a @ w - b).detach().square().mean()[None], rtol=1e-13, atol=0)
    assert float(optimizer.mu) == pytest.approx(0.07, rel=1e-14)
    assert optimizer.evaluations == 2


def textbook(damping: str, w: np.ndarray, mu: float, epochs: int) -> tuple[np.ndarray, float]:
    """Both rules on the banana, written once more after the books, for one problem and without a batch."""

    def e(w: np.ndarray) -> np.ndarray:
        return np.array([10 * (w[1] - w[0] ** 2), 1 - w[0]])

    nu = 2.0
    for epoch in range(epochs):
        j = np.array([[-20 * w[0], 10.0], [-1.0, 0.0]])
        a, g = j.T @ j, j.T @ e(w)
        mu = mu * a.diagonal().max() if damping == "nielsen" and epoch == 0 else mu
        while True:
            h = np.linalg.solve(a + mu * np.eye(2), -g)
            gain = 0.5 * (e(w) @ e(w) - e(w + h) @ e(w + h))
            if gain > 0:
                rho, w = gain / (0.5 * h @ (mu * h - g)), w + h
                mu, nu = mu * (0.1 if damping == "trainlm" else max(1 / 3, 1 - (2 * rho - 1) ** 3)), 2.0
                break
            mu, nu = mu * (10 if damping == "trainlm" else nu), 2 * nu
    return w, mu


@pytest.mark.parametrize("damping", DAMPINGS)
@pytest.mark.parametrize("first", [1e-3, 1e-9])  # the small one is refused many times in a row
@pytest.mark.parametrize("epochs", [1, 4, 9])
def test_the_damping_follows_its_rule(damping, first, epochs):
    w = weights(-1.2, 1.0)
    optimizer = fit(lambda: rosenbrock(w), [w], epochs, damping=damping, mu=first)
    expected, mu = textbook(damping, np.array([-1.2, 1.0]), first, epochs)
    np.testing.assert_allclose(w.detach().numpy(), expected, rtol=1e-8)
    assert float(optimizer.mu) == pytest.approx(mu, rel=1e-6)


@pytest.mark.parametrize("damping", DAMPINGS)
@pytest.mark.parametrize(("dtype", "tolerance"), [(torch.float64, 1e-9), (torch.float32, 1e-4)])
def test_the_banana_is_followed_to_its_minimum(damping, dtype, tolerance):
    w = weights(-1.2, 1.0, dtype=dtype)
    optimizer = fit(lambda: rosenbrock(w), [w], 60, damping=damping, min_grad=0.0)
    assert w.dtype == optimizer.loss.dtype == optimizer.mu.dtype == dtype
    torch.testing.assert_close(w.detach(), torch.ones(2, dtype=dtype), rtol=0, atol=tolerance)


def table(text: str) -> tuple[torch.Tensor, torch.Tensor]:
    y, x = torch.tensor([float(word) for word in text.split()], dtype=torch.float64).reshape(-1, 2).T
    return x, y


@pytest.mark.parametrize("damping", DAMPINGS)
def test_misra1a_ends_at_the_certified_parameters(damping):
    x, y = table(MISRA1A)
    b = weights(250.0, 0.0005)
    optimizer = fit(lambda: b[0] * (1 - torch.exp(-b[1] * x)) - y, [b], 200, damping=damping, min_grad=0.0)
    certified = torch.tensor([2.3894212918e02, 5.5015643181e-04], dtype=torch.float64)
    torch.testing.assert_close(b.detach(), certified, rtol=1e-8, atol=0)
    assert float(optimizer.loss) * len(x) == pytest.approx(1.2455138894e-01, rel=1e-9)


@pytest.mark.parametrize("damping", DAMPINGS)
def test_thurber_ends_at_the_certified_parameters(damping):
    x, y = table(THURBER)
    b = weights(1300.0, 1500.0, 500.0, 75.0, 1.0, 0.4, 0.05)

    def residual() -> torch.Tensor:
        above = b[0] + x * (b[1] + x * (b[2] + x * b[3]))
        return above / (1 + x * (b[4] + x * (b[5] + x * b[6]))) - y

    optimizer = fit(residual, [b], 400, damping=damping, min_grad=0.0)
    certified = [1.2881396800e03, 1.4910792535e03, 5.8323836877e02, 7.5416644291e01]
    certified += [9.6629502864e-01, 3.9797285797e-01, 4.9727297349e-02]
    torch.testing.assert_close(b.detach(), torch.tensor(certified, dtype=torch.float64), rtol=1e-7, atol=0)
    assert float(optimizer.loss) * len(x) == pytest.approx(5.6427082397e03, rel=1e-9)


@pytest.mark.parametrize("damping", DAMPINGS)
def test_rows_fitted_together_are_the_rows_fitted_alone(damping):
    starts = [[-1.2, 1.0], [3.0, -2.0], [0.5, 0.5], [1.0, 1.0]]
    together = Parameter(torch.tensor(starts, dtype=torch.float64))
    batch = fit(lambda: rosenbrock(together), [together], 12, rows=4, damping=damping)
    for k, start in enumerate(starts):
        alone = weights(*start)
        single = fit(lambda alone=alone: rosenbrock(alone), [alone], 12, damping=damping)
        torch.testing.assert_close(together[k].detach(), alone.detach(), rtol=1e-9, atol=1e-9)
        assert batch.reasons[k] == single.reasons[0]
        assert float(batch.mu[k]) == pytest.approx(float(single.mu), rel=1e-6)
    assert len(set(batch.mu.tolist())) > 2


def test_a_row_that_is_not_a_number_does_not_harm_the_others():
    starts = torch.tensor([[-1.2, 1.0], [3.0, -2.0]], dtype=torch.float64)
    w, healthy = Parameter(torch.cat([starts[:1], starts.new_full((1, 2), nan), starts[1:]])), Parameter(starts.clone())
    spoiled = fit(lambda: rosenbrock(w), [w], 3, rows=3)
    fit(lambda: rosenbrock(healthy), [healthy], 3, rows=2)
    torch.testing.assert_close(w.detach()[[0, 2]], healthy.detach(), rtol=1e-12, atol=1e-12)
    assert spoiled.reasons == ["", "error is not finite", ""]
    assert not spoiled.stopped


def test_a_try_that_gives_no_number_is_taken_back():
    w = weights(0.01)
    optimizer = fit(lambda: torch.sqrt(w) * (1 + w) - 1e-3, [w], 40, mu=1e-9)
    assert float(w.detach()) == pytest.approx(1e-6, rel=1e-4)
    assert optimizer.reasons[0] in {"goal reached", "gradient below min_grad"}


def test_a_row_stops_at_the_goal():
    w = weights(-1.2, 1.0)
    optimizer = fit(lambda: rosenbrock(w), [w], 60, goal=1e-4, min_grad=0.0)
    assert optimizer.reasons == ["goal reached"] and optimizer.stopped
    assert 1e-12 < float(optimizer.loss) <= 1e-4


def test_a_row_that_reaches_the_goal_stops_within_the_same_step():
    w = weights(0.0)
    optimizer = fit(lambda: w - 2, [w], 1, mu=1e-12, goal=1e-6)
    assert optimizer.reasons == ["goal reached"]


def test_a_row_that_gives_up_keeps_its_weights():
    w = weights(-1.2, 1.0)
    uphill = torch.tensor([[-24.0, -10.0], [1.0, 0.0]], dtype=torch.float64)  # the Jacobian with the wrong sign
    optimizer = fit(lambda: rosenbrock(w), [w], 1, jacobian=lambda: uphill)
    assert optimizer.reasons == ["mu above mu_max: no step lowers the error any more"]
    assert torch.equal(w.detach(), torch.tensor([-1.2, 1.0], dtype=torch.float64))


def test_a_row_stops_on_a_flat_gradient():
    x = torch.tensor([1.0, 2.0, 3.0], dtype=torch.float64)
    w = weights(0.0)
    optimizer = fit(lambda: w - x, [w], 20)
    assert optimizer.reasons == ["gradient below min_grad"]
    assert float(w.detach()) == pytest.approx(2.0, rel=1e-7)


@pytest.mark.parametrize("damping", DAMPINGS)
@pytest.mark.parametrize("first", [1e-3, 1e-300])
def test_a_row_stops_where_no_step_lowers_the_error(damping, first):
    w = weights(0.0)
    optimizer = fit(lambda: w.square() + 1, [w], 1, min_grad=0.0, damping=damping, mu=first)
    assert optimizer.reasons == ["mu above mu_max: no step lowers the error any more"]
    assert float(optimizer.mu) > 1e10


def test_damping_that_only_fell_can_rise_again():
    w = weights(1.0, dtype=torch.float32)
    optimizer = lm([w], min_grad=0.0, goal=-1.0)
    with unchecked():
        for _ in range(60):
            optimizer.step(lambda: w**3 + 1e-30)
    assert optimizer.stopped
    assert float(optimizer.mu) > 1e10


def test_an_error_without_a_number_stops_at_once():
    w = weights(-1.0)
    optimizer = fit(lambda: torch.sqrt(w) - 1, [w], 1)
    assert optimizer.reasons == ["error is not finite"]
    assert float(w.detach()) == -1.0


def test_stopped_rows_are_left_alone():
    w = Parameter(torch.tensor([[1.0, 1.0], [-1.2, 1.0]], dtype=torch.float64))
    optimizer = fit(lambda: rosenbrock(w), [w], 5, rows=2)
    assert optimizer.reasons == ["goal reached", ""]
    assert torch.equal(w.detach()[0], torch.ones(2, dtype=torch.float64))
    assert not optimizer.stopped
    fit_on = optimizer.evaluations
    w.data[1] = 1.0
    optimizer.step(lambda: rosenbrock(w))
    assert optimizer.stopped and optimizer.evaluations > fit_on
    done = optimizer.evaluations
    optimizer.step(lambda: rosenbrock(w))
    assert optimizer.evaluations == done


def test_rising_validation_errors_bring_the_best_weights_back():
    w = Parameter(torch.zeros(2, 1, dtype=torch.float64))
    optimizer = lm([w], rows=2, mu=1.0, max_fail=3)
    history = [w.detach().clone()]

    def residual() -> torch.Tensor:
        return torch.atan(w) - 1

    losses = []
    # The first row fails at 1.5, 1.6 and nan (1.0 again is no rise); a new best makes the second start counting afresh.
    for first, second in [(3.0, 3.0), (1.0, 3.5), (1.5, 3.6), (1.0, 2.0), (1.6, 2.1), (nan, 2.2)]:
        losses.append(optimizer.step(residual).clone())
        history.append(w.detach().clone())
        assert optimizer.reasons == ["", ""]
        optimizer.validate(torch.tensor([first, second], dtype=torch.float64))
    assert optimizer.reasons == ["validation error rose max_fail times", ""]
    assert torch.equal(w.detach()[0], history[2][0])
    assert torch.equal(w.detach()[1], history[6][1])
    assert float(optimizer.loss[0]) == float(losses[1][0])
    torch.testing.assert_close(optimizer.loss, residual().detach().square().mean(1), rtol=1e-14, atol=0)


@pytest.mark.parametrize("damping", DAMPINGS)
@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_a_resumed_fit_is_the_straight_fit_to_the_bit(damping, dtype):
    inputs, targets = (part.to(dtype) for part in tuples(40))

    def made(seed: int) -> tuple[Perceptron, LevenbergMarquardt]:
        network = wang_network(5, seed=seed, dtype=dtype)
        return network, lm(network.parameters(), rows=3, damping=damping, max_fail=4)

    def run(network: Perceptron, optimizer: LevenbergMarquardt, epochs: int) -> None:
        for _ in range(epochs):
            optimizer.step(rowwise(network, inputs, targets))
            optimizer.validate(rowwise(network, inputs[::7] + 0.3, targets[:, ::7])().detach().square().mean(1))

    straight, halves, resumed = made(2), made(2), made(9)
    with unchecked():
        run(*straight, 14)
        run(*halves, 6)
        file = io.BytesIO()
        torch.save([part.state_dict() for part in halves], file)
        file.seek(0)
        for part, state in zip(resumed, torch.load(file, weights_only=True), strict=True):
            part.load_state_dict(state)
        run(*resumed, 8)
    for expected, got in zip(straight[0].parameters(), resumed[0].parameters(), strict=True):
        assert torch.equal(expected, got)
    stored, again = (pair[1].state_dict()["state"][0] for pair in (straight, resumed))
    assert stored.keys() == again.keys()
    assert all(torch.equal(stored[key], again[key]) for key in stored)
    assert again["mu"].dtype == dtype and straight[1].evaluations == resumed[1].evaluations


def test_lightning_drives_it_by_hand():
    class Banana(lightning.LightningModule):
        def __init__(self) -> None:
            super().__init__()
            self.automatic_optimization = False
            self.w = weights(-1.2, 1.0)

        def configure_optimizers(self) -> LevenbergMarquardt:
            return lm(self.parameters(), min_grad=0.0)

        def training_step(self, batch, batch_idx) -> None:
            loss = self.optimizers().step(lambda: rosenbrock(self.w))
            self.last = float(loss)

        def train_dataloader(self) -> list[int]:
            return list(range(30))

    module = Banana()
    quiet = {
        "logger": False,
        "enable_checkpointing": False,
        "enable_progress_bar": False,
        "enable_model_summary": False,
    }
    lightning.Trainer(max_epochs=1, accelerator="cpu", **quiet).fit(module)
    torch.testing.assert_close(module.w.detach(), torch.ones(2, dtype=torch.float64), rtol=0, atol=1e-8)
    assert module.last < 1e-16


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ({"mu": 0.0}, "mu=0.0"),
        ({"mu_dec": 1.5}, "mu_dec=1.5"),
        ({"mu_inc": 0.5}, "mu_inc=0.5"),
        ({"mu_max": 1e-10}, "mu_max=1e-10"),
        ({"max_fail": 0}, "max_fail=0"),
        ({"damping": "fletcher"}, "trainlm, nielsen"),
        ({"rows": 3}, "rows=3"),
    ],
)
def test_a_bad_setting_is_refused_in_one_line(options, word):
    with unchecked(), pytest.raises(InputError, match=word) as caught:
        lm([weights(1.0, 2.0)], **options)
    assert "\n" not in str(caught.value)


def test_a_residual_with_its_rows_in_the_wrong_place_is_refused():
    w = Parameter(torch.zeros(3, 2, dtype=torch.float64))
    with pytest.raises(InputError, match=r"rows=3 give \(3, N\)"):
        lm([w], rows=3).step(lambda: w.sum(1)[None, :] - torch.ones(6, 3))


def test_a_row_that_runs_has_no_reason_and_infinite_loss_before_the_first_step():
    optimizer = lm([weights(1.0)])
    assert optimizer.reasons == [REASONS[0]] == [""]
    assert float(optimizer.loss) == inf and not optimizer.stopped


@pytest.mark.parametrize(
    ("options", "reason"), [({"min_step": 10.0}, Reason.STEP), ({"min_fall": 1.0}, Reason.FALL), ({}, Reason.RUNNING)]
)
def test_a_row_stops_after_a_step_that_moves_or_gains_too_little(options, reason):
    w = weights(-1.2, 1.0)
    optimizer = fit(lambda: rosenbrock(w), [w], 1, **options)
    assert optimizer.reasons == [reason]
    assert float(optimizer.loss) < 12.1
