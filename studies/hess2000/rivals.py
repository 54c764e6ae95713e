"""What else can learn the runs of Hess & Faller 2000: linear regression, physical series, an ensemble, gated cells."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from time import process_time
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

import manoeuvre_nn as mnn
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.dynamics.recursive import RecursiveShip
from manoeuvre_nn.dynamics.replay import replay
from manoeuvre_nn.network.recursive import Folded, RecursiveNetwork, RecursiveSettings
from manoeuvre_nn.network.series import Series
from manoeuvre_nn.scoring.error_measures import MEAN, VARIABLES
from manoeuvre_nn.training.recursive_windows import GrowingWindows, RecursiveFitSettings
from studies.hess2000.gated import gated
from studies.hess2000.runs import RunSet
from studies.hess2000.training import TrainedSimulator, measures_of, median_measures
from studies.reproduction.section import Say

SERIES = {
    "cubic": "series of third order (speed and shaft), closed loop",
    "modulus": "modulus series (speed and shaft), closed loop",
}
"""Networks of the package that are fitted in closed loop, on three degrees of freedom."""
ENSEMBLE = "hull_rudder_shaft"
EPOCHS, QUICK_EPOCHS, MEMBERS = 10, 2, 4
RIDGE = 1e-8
"""Share of the mean square that is added to the diagonal of the normal equations."""
LINEAR = "linear regression"
NETWORK = "recursive network, median of the seeds"
ROLL = ("phi", "p", "pdot")
"""What models of three degrees of freedom are not given."""


class LinearStep(RecursiveNetwork):
    """One matrix in place of the nodes: ``y(t + dt) = A x(t)`` with the inputs of the recursive network, scaled.

    Outputs are cut to the network's range, so that a run that grows stays finite.
    """

    def __init__(self, settings: RecursiveSettings) -> None:
        """No weights yet."""
        super().__init__(settings, dtype=torch.float64)
        self.matrix = torch.zeros(self.inputs_count + 1, len(settings.velocities), dtype=torch.float64)

    def _terms(self, x: Float[Tensor, "n inputs"]) -> Float[Tensor, "n terms"]:
        """Inputs scaled, and a constant."""
        return torch.cat([(x - self.shift) / self.scale, torch.ones_like(x[:, :1])], dim=1)

    @torch.no_grad()
    def learn(self, x: Float[Tensor, "n inputs"], y: Float[Tensor, "n freedom"]) -> None:
        """Least squares on single steps and their mirror images.

        Args:
            x: Inputs.
            y: Velocities a step later.
        """
        x, y = torch.cat([x, self.mirrored(x)]), torch.cat([y, y * self.output_signs])
        terms = self._terms(x)
        normal = terms.T @ terms
        normal += RIDGE * normal.diagonal().mean() * torch.eye(len(normal), dtype=normal.dtype)
        self.matrix = torch.linalg.solve(normal, terms.T @ y)

    def answer(self, x: Float[Tensor, "n inputs"], folded: Folded, *more: Tensor) -> Float[Tensor, "n freedom"]:
        """Velocities of the next step, in range."""
        made = self._terms(x) @ self.matrix
        return torch.clamp(made, self.middle - self.half_range, self.middle + self.half_range)


def linear_step(runs: RunSet) -> TrainedSimulator:
    """Linear regression on single steps, with the inputs of the recursive network."""
    began = process_time()
    network = LinearStep(RecursiveSettings())
    model = RecursiveShip(runs.ship, network)
    windows = GrowingWindows(model, runs.training, RecursiveFitSettings())
    network.learn(*windows.single_steps())
    return TrainedSimulator(LINEAR, partial(replay, model), process_time() - began, network.matrix.numel())


def physical(runs: RunSet, network: str, settings: Sequence[str], name: str) -> TrainedSimulator:
    """A model of the package on three degrees of freedom, from the ship's particulars and the training runs.

    Args:
        runs: The runs; recorded rudder and shaft drive it.
        network: Name in conf/network.
        settings: Further words as on the command line.
        name: What it is called in tables.

    Returns:
        The simulator.
    """
    began = process_time()
    model = mnn.fit(runs.ship.particulars, upright(runs.training), network, settings).model
    learnt = model.network
    weights = len(learnt.names) if isinstance(learnt, Series) else sum(p.numel() for p in learnt.parameters())
    return TrainedSimulator(name, lambda r: replay(model, upright(r)), process_time() - began, weights)


def upright(runs: Sequence[Recording]) -> list[Recording]:
    """Runs without their roll; what was ordered is left out too, so that they are only driven by recorded controls."""
    made = []
    for run in runs:
        kept = {name: c for name, c in run.channels.items() if name not in ROLL}
        meta = {key: value for key, value in run.meta.items() if key != "manoeuvre"}
        made.append(replace(run, channels=kept, meta=meta))
    return made


def rivals(runs: RunSet, seed: int, *, quick: bool = False, say: Say = lambda _: None) -> Iterator[TrainedSimulator]:
    """All of them, made from the same training runs.

    Args:
        runs: The runs.
        seed: Of what is drawn.
        quick: Whether it is the short form.
        say: Told which is being made.

    Yields:
        The simulators.
    """
    say("linear regression")
    yield linear_step(runs)
    for network, name in SERIES.items():
        say(name)
        yield physical(
            runs, network, ["network.members=1", f"trainer.max_epochs={QUICK_EPOCHS if quick else EPOCHS}"], name
        )
    say("ensemble")
    effort = ["network.members=1", f"fit.epochs={QUICK_EPOCHS}"] if quick else [f"network.members={MEMBERS}"]
    yield physical(runs, ENSEMBLE, effort, "ensemble of hull and rudder (shaft)")
    for kind in ("LSTM", "GRU"):
        yield gated(kind, runs, seed, quick=quick, say=say)


def rival_tables(
    networks: Sequence[TrainedSimulator], others: Sequence[TrainedSimulator], runs: RunSet
) -> dict[str, list[dict[str, Any]]]:
    """Percent errors of simulators on own and unseen runs.

    Args:
        networks: Recursive networks from some seeds, of which the medians are taken.
        others: The rivals.
        runs: The runs.

    Returns:
        ``own`` and ``unseen`` -> a row a simulator: errors by variable and their mean [%], weights, CPU time. A model
        without roll has the mean of the others.
    """
    seconds = float(np.median([network.seconds for network in networks]))
    made = [(NETWORK, median_measures(networks, runs), networks[0].weights, seconds)]
    made += [(other.name, measures_of(other, runs), other.weights, other.seconds) for other in others]
    found: dict[str, list[dict[str, Any]]] = {"own": [], "unseen": []}
    for name, measures, weights, took in made:
        for part, label in (("own", "all"), ("unseen", "unseen")):
            percent = measures.loc[label]["percent"]
            errors = {variable: float(percent.get(variable, float("nan"))) for variable in (*VARIABLES, MEAN)}
            found[part].append({"simulator": name, **errors, "weights": weights, "CPU [s]": took})
    return found
