"""The trainings of Wang's networks from many starts: steepest descent as in the thesis, and Levenberg-Marquardt."""

from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.scaling import Scaling
from manoeuvre_nn.dynamics.model import IdentifiedShip
from manoeuvre_nn.network.perceptron import Activation, Initial, Perceptron
from manoeuvre_nn.numerics.damping import Stops
from manoeuvre_nn.numerics.one_hidden import OneHidden
from manoeuvre_nn.numerics.restarts import minimise
from manoeuvre_nn.numerics.steepest_descent import RateSchedule, SteepestDescent
from manoeuvre_nn.training.scalings import make_scaling
from studies.reproduction.section import ComputingEffort
from studies.wang1996.networks import ThesisShip, TrainedShips, case, errors, paper_scaling
from studies.wang1996.published_networks import HIDDEN, INPUTS, NETWORKS, PublishedShip

Start = Literal["standardised, N(0,1)", "thesis scaling, U[0,1)", "u'-1, tanh, N(0,.3)"]
STARTS: dict[Start, tuple[str, Activation, Initial, float]] = {
    "standardised, N(0,1)": ("standard", "sigmoid", "normal", 1.0),
    "thesis scaling, U[0,1)": ("source", "sigmoid", "uniform", 1.0),
    "u'-1, tanh, N(0,.3)": ("centred", "tanh", "normal", 0.3),
}
"""How Levenberg-Marquardt is started -> scaling, activation, first weights and their spread."""
BEST_START: Start = "u'-1, tanh, N(0,.3)"


@cache
def levenberg_marquardt(name: PublishedShip, start: Start, effort: ComputingEffort) -> TrainedShips:
    """Train three 4-11-1 networks from ``effort.starts`` starts as one batch.

    Args:
        name: The ship.
        start: Scaling and first weights.
        effort: Number of starts, and whether it is to be quick.

    Returns:
        The trained networks.
    """
    of, (kind, activation, initial, spread) = case(name), STARTS[start]
    scaling = paper_scaling() if kind == "source" else make_scaling(kind, of.known, of.tuples)
    x, y = scaling.inputs(of.tuples.inputs), scaling.outputs(of.tuples.targets)
    first = _drawn(effort, activation, initial, spread)
    weights = torch.cat([first.input_weights.flatten(1), first.output_weights.flatten(1)], 1).detach()
    problem = OneHidden(x, y.T[..., None].repeat(effort.starts, 1, 1), HIDDEN, activation=activation)
    epochs = 200 if effort.quick else 600
    solved = minimise(problem, weights, stops=Stops(epochs=epochs))
    models = _models(of, scaling, activation, *problem.split(solved.weights))
    return TrainedShips(f"Levenberg-Marquardt, {start}", models, errors(of, models), epochs)


@dataclass(frozen=True)
class Descent:
    """A training by steepest descent.

    Attributes:
        label: What it is.
        scaling: Kind of scaling, see :func:`.make_scaling`; ``source`` is the thesis'.
        schedule: Rates over iterations, for the mean of E (eq 2.6) over the samples.
        iterations: Iterations.
        momentum: alpha [-].
        every: Only every n-th sample is used.
        start: Activation, first weights and their spread; by default the thesis'.
    """

    label: str
    scaling: str
    schedule: RateSchedule
    iterations: int
    momentum: float = 0.9
    every: int = 4
    start: tuple[Activation, Initial, float] = "sigmoid", "uniform", 1.0


@cache
def backpropagation(name: PublishedShip, plan: Descent, effort: ComputingEffort) -> TrainedShips:
    """Train three 4-11-1 networks from several starts, all samples in every iteration.

    Args:
        name: The ship.
        plan: What is done.
        effort: Number of starts (half of ``effort.starts``, at least two), and the seed.

    Returns:
        The trained networks, with the course of their errors.

    Source:
        Wang 1996, eqs 2.15, 2.19 (with ``f (1 - f)`` for the misprinted ``M (1 - M)``), 2.20 and 2.21.
    """
    of, part = case(name), ComputingEffort(effort.quick, max(2, effort.starts // 2), effort.seed)
    scaling = paper_scaling() if plan.scaling == "source" else make_scaling(plan.scaling, of.known, of.tuples)
    x, y = scaling.inputs(of.tuples.inputs), scaling.outputs(of.tuples.targets)
    some = slice(None, None, plan.every)
    network, marks = _drawn(part, *plan.start), _marks(plan.iterations)
    optimizer = SteepestDescent(network.parameters(), momentum=plan.momentum, schedule=plan.schedule)
    size, course = of.unit_error / scaling.output_scale, {}
    rows = y.T.repeat(part.starts, 1)
    slope = Slopes(network, x[some], rows[:, some])
    for iteration in range(1, plan.iterations + 1):
        slope.set_gradients()
        optimizer.step()
        if iteration in marks:
            with torch.no_grad():
                off = (network.rows(x)[..., 0] - rows).square().mean(1).sqrt().view(-1, 3) / size
            course[iteration] = np.median(off.numpy(), axis=0)
    models = _models(of, scaling, plan.start[0], network.input_weights.detach(), network.output_weights.detach())
    return TrainedShips(plan.label, models, errors(of, models), plan.iterations, course)


class Slopes:
    """Gradients of E by formula, into memory that is used again: autograd would take three times as long."""

    def __init__(self, network: Perceptron, x: Float[Tensor, "n i"], y: Float[Tensor, "k n"]) -> None:
        """Lay out the memory.

        Args:
            network: K networks with one output each.
            x: Inputs.
            y: Targets of each network.
        """
        self.network, self.y = network, y
        self.z = torch.cat([x, x.new_ones(len(x), 1)], 1).mT.contiguous()
        k, hidden, _ = network.input_weights.shape
        self.nodes = x.new_ones(k, hidden + 1, len(x))
        self.back, self.one = x.new_empty(k, hidden, len(x)), x.new_ones(())
        for weights in network.parameters():
            weights.grad = torch.zeros_like(weights)

    @torch.no_grad()
    def set_gradients(self) -> None:
        """Derivatives of the mean of E over the samples, into ``grad`` of the network's weights."""
        first, last = self.network.input_weights, self.network.output_weights
        hidden = self.nodes[:, :-1]
        sums = (first.flatten(0, 1) @ self.z).view_as(hidden)
        sigmoid = self.network.activation == "sigmoid"
        (torch.sigmoid if sigmoid else torch.tanh)(sums, out=hidden)
        off = (torch.bmm(last, self.nodes)[:, 0] - self.y)[:, None].mul_(2 / self.y.shape[1])
        torch.bmm(off, self.nodes.mT, out=last.grad)
        torch.addcmul(hidden if sigmoid else self.one, hidden, hidden, value=-1, out=self.back)
        self.back.mul_(off).mul_(last[:, 0, :-1, None])
        torch.mm(self.back.flatten(0, 1), self.z.mT, out=first.grad.flatten(0, 1))  # type: ignore[union-attr]


def _drawn(effort: ComputingEffort, activation: Activation, initial: Initial, spread: float) -> Perceptron:
    """First weights of all starts as rows of one perceptron."""
    return Perceptron((NETWORKS * effort.starts, INPUTS, HIDDEN, 1), activation, initial, spread, seed=effort.seed)


def _models(
    of: ThesisShip, scaling: Scaling, activation: Activation, first: Tensor, last: Tensor
) -> tuple[IdentifiedShip, ...]:
    """Rows of weights as ships, three networks each."""
    models = []
    for inner, outer in zip(first.split(NETWORKS), last.split(NETWORKS), strict=True):
        network = Perceptron((NETWORKS, INPUTS, HIDDEN, 1), activation=activation)
        with torch.no_grad():
            network.input_weights.copy_(inner)
            network.output_weights.copy_(outer)
        models.append(IdentifiedShip(of.known, network.requires_grad_(False), scaling))
    return tuple(models)


def _marks(iterations: int) -> set[int]:
    """Iterations at which the error is noted: evenly on a logarithmic scale."""
    return {int(n) for n in np.unique(np.geomspace(min(100, iterations), iterations, 40).round())}
