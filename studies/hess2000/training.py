"""Recursive networks trained on runs of Hess & Faller 2000, stopped where training and validation runs are met best."""

from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from functools import partial
from time import process_time

import numpy as np
import pandas as pd
import torch

from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.dynamics.recursive import RecursiveShip
from manoeuvre_nn.dynamics.replay import replay
from manoeuvre_nn.network.recursive import RecursiveNetwork, RecursiveSettings
from manoeuvre_nn.scoring.error_measures import MEAN, MEASURES, error_measures
from manoeuvre_nn.training.recursive_fit import FitPlan, fit_recursive
from manoeuvre_nn.training.recursive_windows import USUAL_STAGES, RecursiveFitSettings
from studies.hess2000.runs import RunSet
from studies.reproduction.section import Say

QUICK_UPDATES = 60
"""Updates of the weights in the short form; else as many as the stages have. The paper has 100 000 epochs."""
OVERSHOOT_STAGES = (
    {"steps": 10, "updates": 200, "rows": 60, "rate": 3e-3},
    {"steps": 30, "updates": 400, "rows": 60, "rate": 3e-3},
    {"steps": 90, "updates": 600, "rows": 60, "rate": 2e-3, "track": 0.1},
    {"steps": None, "updates": 100, "rate": 1e-3, "track": 0.1},
)
"""Training on the eight overshoots: the usual stages are longer, and learn them more by heart."""
SCORES, QUICK_SCORES = 40, 4
"""How often in a training the generalization is tested; in the paper every 10 epochs."""

Predict = Callable[[Sequence[Recording]], list[Recording]]
"""Recorded runs -> predictions from their controls and first samples alone."""


@dataclass(frozen=True)
class TrainedSimulator:
    """A simulator that was made from the training runs.

    Attributes:
        name: What it is called in tables.
        predict: Sails it.
        seconds: CPU time that it took to make [s].
        weights: How many numbers it has that were learnt.
        history: Tests of the generalization: update, then measures averaged over variables and runs; None for one
            that is made in one go.
    """

    name: str
    predict: Predict
    seconds: float
    weights: int
    history: pd.DataFrame | None = None

    @property
    def stopped(self) -> float:
        """When the weights that were kept were reached, as a share of the updates."""
        assert self.history is not None
        updates = self.history["update"].to_numpy(dtype=float)
        best = int(self.history["average_angle"].to_numpy(dtype=float).argmax())
        return float(updates[best] / updates.max())


@dataclass
class BestWeights:
    """Weights at the best generalization so far.

    Attributes:
        network: Whose weights they are.
        predict: Sails it.
        runs: What it is tested on: training and validation runs together, as in the paper.
        rows: Tests so far.
        kept: Weights at the best.
    """

    network: torch.nn.Module
    predict: Predict
    runs: RunSet
    rows: list[dict[str, float]]
    kept: Mapping[str, torch.Tensor]

    @classmethod
    def of(cls, network: torch.nn.Module, predict: Predict, runs: RunSet) -> "BestWeights":
        """Before the first test."""
        return cls(network, predict, runs, [], deepcopy(network.state_dict()))

    def test(self, update: int, loss: float) -> None:
        """Test the generalization, and keep the weights if it is the best so far.

        Args:
            update: Updates that were done.
            loss: Error of the last one.
        """
        own = self.runs.own
        measures = error_measures(self.predict(own), own).loc["all"]
        row = {name: float(measures[name][MEAN]) for name in MEASURES} | {"update": float(update), "loss": loss}
        row["absolute"] = float(measures["absolute"].drop(MEAN).mean())  # of unlike units, as in the paper's Fig. 7
        if not self.rows or row["average_angle"] > max(r["average_angle"] for r in self.rows):
            self.kept = deepcopy(self.network.state_dict())
        self.rows.append(row)

    def restore(self) -> pd.DataFrame:
        """Give the network its best weights back, and tell the tests."""
        self.network.load_state_dict(self.kept)
        return pd.DataFrame(self.rows)


def recursive_network(
    runs: RunSet,
    seed: int,
    *,
    stages: Sequence[Mapping[str, float | int | None]] = USUAL_STAGES,
    quick: bool = False,
    about_last: bool = True,
    say: Say = lambda _: None,
) -> TrainedSimulator:
    """Train a recursive network in closed loop.

    Args:
        runs: Training runs teach it, training and validation runs decide which weights are kept.
        seed: Of first weights and windows.
        stages: Parts of the training.
        quick: Whether it is the short form.
        about_last: Whether output nodes give the change of the last outputs; else the velocities, as in the paper.
        say: Told how far it is.

    Returns:
        The simulator.
    """
    began = process_time()
    network = RecursiveNetwork(RecursiveSettings(about_last=about_last), seed=seed)
    model = RecursiveShip(runs.ship, network)
    settings = RecursiveFitSettings(stages)
    updates, scores = (QUICK_UPDATES, QUICK_SCORES) if quick else (settings.updates, SCORES)

    def tell(row: Mapping[str, float]) -> None:
        say(f"seed {seed}: {row['update']:.0f} of {updates} updates, angle measure {row['average_angle']:.4f}")

    plan = FitPlan(updates, updates // scores, seed)
    found = fit_recursive(model, runs.training, runs.validation, settings=settings, plan=plan, say=tell)
    history = pd.DataFrame(found)
    name = "recursive network" if about_last else "recursive network, outputs as in the paper"
    return TrainedSimulator(name, partial(replay, model), process_time() - began, network.weights_count, history)


def measures_of(model: TrainedSimulator, runs: RunSet) -> pd.DataFrame:
    """Error measures of a simulator.

    Args:
        model: The simulator.
        runs: What it is tested on.

    Returns:
        Lines (set, variable) for ``all`` own runs, ``validation`` and ``unseen``; percent errors of the own runs are of
        their scales, of the unseen runs of theirs.
    """
    own = error_measures(model.predict(runs.own), runs.own, {"validation": [r.name for r in runs.validation]})
    if not runs.unseen:
        return own
    unseen = error_measures(model.predict(runs.unseen), runs.unseen).loc["all"]
    return pd.concat([own, pd.concat({"unseen": unseen}, names=["set"])])


def median_measures(models: Sequence[TrainedSimulator], runs: RunSet) -> pd.DataFrame:
    """Medians over the seeds of each measure."""
    tables = [measures_of(model, runs) for model in models]
    median = np.median([table.to_numpy() for table in tables], axis=0)
    return pd.DataFrame(median, tables[0].index, tables[0].columns)
