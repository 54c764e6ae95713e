"""Steepest descent against torch's own, a closed form, and the thesis' schedule and rules."""

import io
from itertools import accumulate, pairwise
from math import inf, nan, sqrt

import pytest
import torch
from fleet import unchecked
from torch.nn import Parameter

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.network.perceptron import wang_network
from manoeuvre_nn.numerics.steepest_descent import RateSchedule, SteepestDescent, StoppingRules

QUICK = RateSchedule(rates=(0.1, 0.02), iterations=(3, 4), shake_rate=0.05, shake_every=5, shake_iterations=2)


def constant(rate: float) -> RateSchedule:
    return RateSchedule(rates=(rate,), iterations=(1,), shake_rate=0.0)


def gradients(parameters: list[Parameter]) -> None:
    loss = sum((p.square().sum() - 1).square() + p.sin().sum() for p in parameters)
    for p, gradient in zip(parameters, torch.autograd.grad(loss, parameters), strict=True):
        p.grad = gradient


def pair_of_parameters() -> list[Parameter]:
    generator = torch.Generator().manual_seed(3)
    return [Parameter(torch.randn(size, generator=generator, dtype=torch.float64)) for size in ((2, 3), (4,))]


def test_at_a_constant_rate_it_is_torchs_sgd_with_momentum():
    ours, theirs = pair_of_parameters(), pair_of_parameters()
    descent = SteepestDescent(ours, momentum=0.8, schedule=constant(0.01))
    sgd = torch.optim.SGD(theirs, lr=0.01, momentum=0.8)
    for _ in range(50):
        for parameters, optimizer in ((ours, descent), (theirs, sgd)):
            gradients(parameters)
            optimizer.step()
    for p, q in zip(ours, theirs, strict=True):
        torch.testing.assert_close(p, q, rtol=1e-12, atol=1e-13)


def test_where_the_rate_changes_the_last_move_is_kept_and_not_rescaled():
    w = Parameter(torch.tensor([1.0], dtype=torch.float64))
    descent = SteepestDescent([w], momentum=0.5, schedule=QUICK)
    track = [1.0]
    for _ in range(20):
        w.grad = torch.tensor([2.0], dtype=torch.float64)
        descent.step()
        track.append(float(w.detach()))
    for n in range(20):
        past = track[n] - track[n - 1] if n else 0.0
        assert track[n + 1] - track[n] == pytest.approx(-QUICK.stage(n)[0] * 2.0 + 0.5 * past, rel=1e-12)


def test_in_a_bowl_the_weights_follow_the_closed_form_of_the_recursion():
    rate, momentum, curvature = 0.1, 0.64, 2.0
    w = Parameter(torch.tensor([3.0], dtype=torch.float64))
    descent = SteepestDescent([w], momentum=momentum, schedule=constant(rate))
    # w(n+1) = (1 + alpha - eta c) w(n) - alpha w(n-1): damped oscillation, modulus sqrt(alpha).
    cosine = (1 + momentum - rate * curvature) / (2 * sqrt(momentum))
    angle = torch.arccos(torch.tensor(cosine, dtype=torch.float64))
    second = 3.0 * (1 - rate * curvature)
    sine = (second / sqrt(momentum) - 3.0 * cosine) / torch.sin(angle)
    for n in range(40):
        expected = momentum ** (n / 2) * (3.0 * torch.cos(n * angle) + sine * torch.sin(n * angle))
        assert float(w.detach()) == pytest.approx(float(expected), rel=1e-9, abs=1e-12)
        w.grad = curvature * w.detach()
        descent.step()


@pytest.mark.parametrize(
    ("iteration", "rate"),
    [
        (0, 1e-2),
        (5_999, 1e-2),
        (6_000, 1e-3),
        (15_999, 1e-3),
        (16_000, 1e-6),
        (75_999, 1e-6),
        (76_000, 1e-3),
        (85_999, 1e-3),
        (86_000, 1e-6),
        (145_999, 1e-6),
        (146_000, 1e-3),
    ],
)
def test_the_rate_follows_the_thesis(iteration, rate):
    assert RateSchedule().stage(iteration)[0] == rate


def test_without_shaking_the_last_rate_goes_on():
    schedule = RateSchedule(rates=(0.5, 0.1), iterations=(2, 3), shake_rate=0.0)
    assert [schedule.stage(n)[0] for n in range(8)] == [0.5, 0.5, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1]
    assert schedule.stage(5)[1] == inf


def test_shaking_raises_the_rate_periodically_and_restores_it():
    rates = [QUICK.stage(n)[0] for n in range(19)]
    assert rates == [0.1] * 3 + [0.02] * 4 + ([0.05] * 2 + [0.02] * 3) * 2 + [0.05] * 2


@pytest.mark.parametrize("schedule", [QUICK, constant(0.3), RateSchedule(iterations=(4, 2, 3), shake_every=11_000)])
def test_the_rate_changes_only_where_the_schedule_announces_it(schedule):
    changes = [n + 1 for n, (a, b) in enumerate(pairwise(schedule.stage(n)[0] for n in range(60))) if a != b]
    announced = {schedule.stage(n)[1] for n in range(60)}
    assert set(changes) <= announced
    assert all(schedule.stage(n)[1] > n for n in range(60))


def test_a_resumed_descent_is_the_straight_one_to_the_bit():
    def made(seed: int):
        network = wang_network(4, seed=seed)
        return network, SteepestDescent(network.parameters(), momentum=0.9, schedule=QUICK)

    def run(network, descent, steps: int) -> None:
        for _ in range(steps):
            gradients(list(network.parameters()))
            for p in network.parameters():
                p.grad *= 1e-2
            descent.step()

    straight, halves, resumed = made(1), made(1), made(2)
    run(*resumed, 3)
    run(*straight, 25)
    for done in accumulate([4, 5]):  # once within a stage, once within a shaking
        halves = made(1)
        run(*halves, done)
        file = io.BytesIO()
        torch.save([part.state_dict() for part in halves], file)
        file.seek(0)
        for part, state in zip(resumed, torch.load(file, weights_only=True), strict=True):
            part.load_state_dict(state)
        run(*resumed, 25 - done)
        for expected, got in zip(straight[0].parameters(), resumed[0].parameters(), strict=True):
            assert torch.equal(expected, got)
        assert resumed[1].param_groups[0]["iteration"] == 25


def test_a_closure_gives_its_loss_back():
    w = Parameter(torch.tensor([2.0], dtype=torch.float64))
    descent = SteepestDescent([w], momentum=0.0, schedule=constant(0.25))

    def closure() -> float:
        descent.zero_grad()
        loss = w.square().sum()
        loss.backward()
        return float(loss.detach())

    assert descent.step(closure) == 4.0
    assert float(w.detach()) == 1.0


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ({"iteration": 10, "error": 0.5}, ""),
        ({"iteration": 10, "error": 0.1}, "goal reached"),
        ({"iteration": 100, "error": 0.5}, "iterations used up"),
        ({"iteration": 99, "error": 0.5, "test": 1.2, "best_test": 1.0}, ""),
        ({"iteration": 10, "error": 0.5, "test": 1.3, "best_test": 1.0}, "error on the test data rises"),
        ({"iteration": 10, "error": nan}, "error is not finite"),
        ({"iteration": 10, "error": inf}, "error is not finite"),
    ],
)
def test_each_stopping_rule_ends_the_fit(given, reason):
    rules = StoppingRules(max_iterations=100, goal=0.1, test_rise=1.25)
    assert rules.reason(**given) == reason


def test_rules_that_were_not_given_never_stop():
    assert StoppingRules().reason(10**9, 1e-300, 1e9, 1e-9) == ""


@pytest.mark.parametrize(
    ("make", "word"),
    [
        (lambda: RateSchedule(rates=(), iterations=()), "rates"),
        (lambda: RateSchedule(rates=(0.1,), iterations=(5, 6)), "as many iterations as rates"),
        (lambda: RateSchedule(rates=(0.0,), iterations=(5,)), "all positive"),
        (lambda: RateSchedule(rates=(0.1,), iterations=(0,)), "all positive"),
        (lambda: RateSchedule(shake_every=5, shake_iterations=5), "shake_iterations < shake_every"),
        (lambda: RateSchedule(shake_rate=-1e-3), "rate of 0 or more"),
        (lambda: SteepestDescent(pair_of_parameters(), momentum=1.0, schedule=QUICK), "fit.momentum=1.0"),
    ],
)
def test_a_bad_setting_is_refused_in_one_line(make, word):
    with pytest.raises(InputError, match=word) as caught:
        make()
    assert "\n" not in str(caught.value)


def test_several_groups_of_parameters_are_refused():
    groups = [{"params": [p]} for p in pair_of_parameters()]
    with unchecked(), pytest.raises(InputError, match="2 groups"):
        SteepestDescent(groups, momentum=0.5, schedule=QUICK)
