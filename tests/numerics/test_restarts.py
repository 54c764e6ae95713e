"""Many starts as one batch: the same as one by one, each with its own end."""

from math import nan

import pytest
import torch
from fleet import unchecked

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.network.perceptron import Perceptron
from manoeuvre_nn.numerics.damping import Damping, Reason, Stops
from manoeuvre_nn.numerics.one_hidden import OneHidden
from manoeuvre_nn.numerics.restarts import Solutions, minimise
from studies.rajesh2009.separable import Separable

HIDDEN = 3


class Plain:
    """Residuals by a function of one row of weights, derivatives by autograd."""

    def __init__(self, function, residuals: int):
        self.function, self.residuals = function, residuals

    def evaluate(self, weights):
        errors = torch.stack([self.function(w) for w in weights])
        return errors.square().mean(1), (errors,)

    def linearise(self, weights, carry):
        with torch.enable_grad():
            jacobian = torch.stack([torch.autograd.functional.jacobian(self.function, w) for w in weights])
        return jacobian.mT @ jacobian, (jacobian.mT @ carry[0][..., None])[..., 0]

    def take(self, rows):
        return self


def banana(w: torch.Tensor) -> torch.Tensor:
    return torch.stack([10 * (w[1] - w[0].square()), 1 - w[0]])


def row(*values: float) -> torch.Tensor:
    return torch.tensor([values], dtype=torch.float64)


def problem(kind: type[OneHidden | Separable], own: bool = False) -> tuple[OneHidden | Separable, torch.Tensor]:
    x = torch.stack([torch.sin(k * torch.linspace(0, 3, 45, dtype=torch.float64) + k) for k in range(1, 4)], 1)
    y = torch.stack([x.prod(1), x.sum(1).tanh()], 1)
    given = torch.stack([y + 0.1 * k * x[:, :2] for k in range(5)]) if own else y
    made = kind(x, given, HIDDEN, activation="tanh")
    network = Perceptron((5, 3, HIDDEN, 2), activation="tanh", initial="symmetric", seed=2)
    start = torch.cat([p.detach().flatten(1) for p in network.parameters()], 1)
    return made, start[:, : made.parameters]


@pytest.mark.parametrize("kind", [OneHidden, Separable])
@pytest.mark.parametrize("rule", ["trainlm", "nielsen"])
@pytest.mark.parametrize("own", [False, True])
def test_a_batch_is_the_same_as_one_by_one(kind, rule, own):
    made, start = problem(kind, own)
    kept = start.clone()
    stops, damping = Stops(epochs=12, goal=8e-3), Damping(rule)
    with unchecked():
        whole = minimise(made, start, damping=damping, stops=stops)
        halves = minimise(made, start, damping=damping, stops=stops, at_once=2)
        single = [
            minimise(made.take(torch.tensor([k])), start[k : k + 1], damping=damping, stops=stops) for k in range(5)
        ]
    assert torch.equal(start, kept)
    assert len(set(whole.tries.tolist())) > 1  # rows go at their own pace
    for k, one in enumerate(single):
        for found in (whole, halves):
            torch.testing.assert_close(found.weights[k], one.weights[0], rtol=1e-6, atol=1e-7)
            torch.testing.assert_close(found.mse[k], one.mse[0], rtol=1e-5, atol=1e-14)  # products round differently
            assert (found.epochs[k], found.tries[k]) == (one.epochs[0], one.tries[0])
            assert found.reasons[k] == one.reasons[0] != Reason.RUNNING


@pytest.mark.parametrize("rule", ["trainlm", "nielsen"])
def test_the_banana_is_solved_from_everywhere(rule):
    start = torch.tensor([[-1.2, 1.0], [0.0, 0.0], [3.0, -2.0]], dtype=torch.float64)
    with unchecked():
        found = minimise(Plain(banana, 2), start, damping=Damping(rule), stops=Stops(epochs=200, goal=1e-28))
    torch.testing.assert_close(found.weights, torch.ones(3, 2, dtype=torch.float64), rtol=0, atol=1e-12)
    assert found.reasons == [Reason.GOAL] * 3


@pytest.mark.parametrize(
    ("function", "start", "stops", "reason"),
    [
        (banana, (-1.2, 1.0), Stops(goal=1e-6), Reason.GOAL),
        (banana, (1.0, 1.0), Stops(goal=-1.0), Reason.GRADIENT),
        (banana, (-1.2, 1.0), Stops(epochs=3), Reason.EPOCHS),
        (banana, (-1.2, 1.0), Stops(min_step=10.0), Reason.STEP),
        (banana, (-1.2, 1.0), Stops(min_fall=1.0), Reason.FALL),
        (lambda w: w.square() + 1, (0.0,), Stops(min_grad=0.0, min_step=-1.0), Reason.DAMPING),
        (lambda w: torch.sqrt(w) - 1, (-1.0,), Stops(), Reason.NOT_FINITE),
    ],
)
def test_every_reason_to_stop_is_told(function, start, stops, reason):
    with unchecked():
        found = minimise(Plain(function, len(start)), row(*start), stops=stops)
    assert found.reasons == [reason] and found.reasons[0] != ""
    if reason == Reason.EPOCHS:
        assert int(found.epochs) == 3 <= int(found.tries)
    if reason == Reason.DAMPING:  # from the smallest number to 1e10 by factors of 2, 4, 8 ..; to infinity it is 63
        assert int(found.tries) < 50
    if reason in {Reason.STEP, Reason.FALL}:
        assert int(found.tries) == 1


def test_a_start_without_a_number_does_not_spoil_the_others():
    made, start = problem(OneHidden)
    bad = start.clone()
    bad[1] = nan
    with unchecked():
        found, clean = (minimise(made, s, stops=Stops(epochs=5)) for s in (bad, start))
    assert found.reasons[1] == Reason.NOT_FINITE
    others = [0, 2, 3, 4]
    torch.testing.assert_close(found.mse[others], clean.mse[others], rtol=1e-9, atol=0)
    assert found.best != 1


def test_the_best_start_is_one_with_a_number():
    mse = torch.tensor([3.0, nan, 1.0, 2.0, 5.0], dtype=torch.float64)
    counts = torch.zeros(5, dtype=torch.long)
    found = Solutions(torch.zeros(5, 2, dtype=torch.float64), mse, [Reason.GOAL] * 5, counts, counts)
    assert found.best == 2


def test_no_row_in_a_batch_is_refused():
    with unchecked(), pytest.raises(InputError, match="at_once=0"):
        minimise(Plain(banana, 2), row(0.0, 0.0), at_once=0)


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU")
@pytest.mark.parametrize("kind", [OneHidden, Separable])
def test_the_gpu_finds_what_the_processor_finds(kind):
    made, start = problem(kind)
    layer = made if kind is OneHidden else made.layer
    there = kind(layer.z[:-1, :45].mT.cuda(), layer.y[0, :, :45].mT.cuda(), HIDDEN, activation="tanh")
    with unchecked():
        here, found = minimise(made, start, stops=Stops(epochs=6)), minimise(there, start.cuda(), stops=Stops(epochs=6))
    torch.testing.assert_close(found.mse.cpu(), here.mse, rtol=1e-6, atol=1e-12)
