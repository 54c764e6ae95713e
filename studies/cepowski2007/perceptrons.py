"""Perceptrons with one hidden layer trained from several starts as one batch: the paper's 5-7-1 and others."""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.network.perceptron import Activation, Perceptron
from manoeuvre_nn.numerics.damping import Damping, Stops
from manoeuvre_nn.numerics.evidence import WeightDecay, nothing_shrunk
from manoeuvre_nn.numerics.levenberg_marquardt import LevenbergMarquardt
from manoeuvre_nn.numerics.one_hidden import OneHidden

ITERATIONS = 200
MIN_FALL = 1e-6
"""Fall of the error over the error that counts as none [-]."""
SPREAD = 0.7
"""Standard deviation of the first weights."""


@dataclass(frozen=True)
class Structure:
    """A perceptron and how it is trained.

    Attributes:
        hidden: Nodes.
        activation: ``sigmoid`` or ``tanh``.
        starts: Trainings from different first weights; the one that learns best is taken.
        bayesian: Whether weights are shrunk as far as the evidence says.
        ridge: Fixed shrinkage over that of the errors [-], beside scaled inputs and outputs.
    """

    hidden: int = 7
    activation: Activation = "tanh"
    starts: int = 1
    bayesian: bool = False
    ridge: float = 0.0


def train_perceptrons(
    x: Float[np.ndarray, "n i"], y: Float[np.ndarray, " n"], structure: Structure, seed: int = 0
) -> tuple[Perceptron, Float[np.ndarray, " starts"]]:
    """Train by Levenberg-Marquardt.

    Args:
        x: Scaled inputs.
        y: Scaled targets.
        structure: The network, and how it is trained.
        seed: Seed of the first weights.

    Returns:
        A network for every start, side by side, and their mean square errors.
    """
    sizes = structure.starts, x.shape[1], structure.hidden, 1
    network = Perceptron(sizes, structure.activation, "normal", SPREAD, seed=seed)
    training = _Training(network, torch.tensor(x), torch.tensor(y)[:, None], structure)
    stops = Stops(min_step=0.0, min_fall=0.0 if structure.bayesian else MIN_FALL)
    optimizer = LevenbergMarquardt(
        network.parameters(), rows=structure.starts, normal=training.normal, damping=Damping("nielsen"), stops=stops
    )
    with torch.no_grad():
        for _ in range(ITERATIONS):
            optimizer.step(training.residuals)
            if structure.bayesian:
                training.shrink_again()
            if optimizer.stopped:
                break
        return network, training.errors().square().mean(1).numpy()


class _Training:
    """What an optimizer asks of networks and records."""

    def __init__(self, network: Perceptron, x: Tensor, y: Tensor, structure: Structure) -> None:
        self.network, self.x, self.y = network, x, y
        self.problem = OneHidden(x, y, structure.hidden, activation=structure.activation)
        first = nothing_shrunk(self.weights())
        self.decay = WeightDecay(first.alpha + structure.ridge, first.beta, first.effective)
        self.of_errors = torch.empty(0)

    def weights(self) -> Tensor:
        """Weights, a row a network."""
        return torch.cat([p.detach().flatten(1) for p in self.network.parameters()], 1)

    def errors(self) -> Tensor:
        """Errors, a row a network."""
        return (self.network.rows(self.x) - self.y).flatten(1)

    def residuals(self) -> Tensor:
        """Errors, and what stands for the shrinkage."""
        return self.decay.residuals(self.errors(), self.weights())

    def normal(self) -> tuple[Tensor, Tensor]:
        """Normal equations of the residuals."""
        self.of_errors, gradient = self.problem.normal_equations(self.weights())
        return self.decay.normal_equations(self.of_errors, gradient, self.weights())

    def shrink_again(self) -> None:
        """Estimate the shrinkage once more."""
        self.decay = self.decay.again(self.of_errors, self.errors(), self.weights())
