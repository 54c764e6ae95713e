"""A small job on the Mariner that trains in a second: what the tests of training and of the command line share."""

import io
import random
from collections.abc import Sequence
from contextlib import nullcontext
from functools import cache
from pathlib import Path

import lightning as L
import numpy as np
import torch
from fleet import unchecked
from levenberg import split
from remembered import simulations_remembered
from rich.console import Console

from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.dynamics.model import IdentifiedShip
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.network.perceptron import wang_network
from manoeuvre_nn.numerics.steepest_descent import RateSchedule
from manoeuvre_nn.ship.known import clarke_part
from manoeuvre_nn.ship.mariner import mariner
from manoeuvre_nn.training import session
from manoeuvre_nn.training.data import DataSettings, SimulatedData
from manoeuvre_nn.training.fits import BackpropFit, Fit, LevenbergMarquardtFit
from manoeuvre_nn.training.rollout_score import RolloutScore
from manoeuvre_nn.training.scalings import make_scaling
from manoeuvre_nn.training.session import Session, Trained


@cache
def ships() -> tuple[Ship, Ship]:
    ship = mariner()
    return ship, clarke_part(ship)


def simulated(**settings) -> SimulatedData:
    """A Mariner's zz35, 90 s of it, judged by the first half minute of zz20."""
    given = {"manoeuvres": [zigzag(35.0)], "score": [zigzag(20.0, duration=30.0)], "length": 90.0} | settings
    manoeuvres, score, effects = given.pop("manoeuvres"), given.pop("score"), given.pop("effects", ())
    data = SimulatedData(*ships(), manoeuvres, score, effects=effects, settings=DataSettings(**given))
    with unchecked(), simulations_remembered():
        data.setup()
    return data


@cache
def usual() -> SimulatedData:
    return simulated()


def dynamics(
    data: SimulatedData, hidden: int = 3, scaling: str = "centred", dtype: torch.dtype = torch.float64, **network
) -> IdentifiedShip:
    made = wang_network(hidden, **{"activation": "tanh", "initial": "normal", "spread": 0.3} | network, dtype=dtype)
    return IdentifiedShip(data.known, made, make_scaling(scaling, data.known, data.tuples)).to(data.dtype)


def lm(data: SimulatedData | None = None, hidden: int = 3, **options) -> LevenbergMarquardtFit:
    return LevenbergMarquardtFit(dynamics(data or usual(), hidden), **split(damping="nielsen", **options))


def backprop(data: SimulatedData | None = None, hidden: int = 3, **options) -> BackpropFit:
    schedule = RateSchedule(rates=(0.1, 0.03), iterations=(70, 10_000), shake_rate=0.0)
    given = {"momentum": 0.9, "schedule": schedule, "iterations_per_epoch": 20} | options
    return BackpropFit(dynamics(data or usual(), hidden, "balanced"), **given)


def train(
    fit: Fit,
    out: Path,
    *,
    data: SimulatedData | None = None,
    every: int = 2,
    extra: Sequence[L.Callback] = (),
    console: Console | None = None,
    checked: bool = False,
    **settings,
) -> tuple[Trained, RolloutScore]:
    """A session; ``extra`` are callbacks that it does not know of; ``checked`` checks shapes and types, and is slow."""
    random.seed()
    np.random.seed(random.randrange(2**31))  # noqa: NPY002  whatever depends on global random states differs each time
    torch.manual_seed(random.randrange(2**31))
    scorer = RolloutScore((data or usual()).held_out, every=every, solver="rollout")
    if extra:
        scorer.setup = lambda trainer, pl_module, stage: trainer.callbacks.extend(extra)  # type: ignore[method-assign]
    quiet = console or Console(file=io.StringIO())
    given = Session(**{"max_epochs": 4} | settings)
    with nullcontext() if checked else unchecked():
        return session.run(fit, data or usual(), scorer, given, out, quiet), scorer


class Each(L.Callback):
    """Calls a function at the end of every epoch with the epoch's number, from 1, and the trainer."""

    def __init__(self, act):
        self.act = act

    def on_train_epoch_end(self, trainer, pl_module):
        self.act(trainer.current_epoch + 1, trainer)


def weights(fit: Fit) -> list[np.ndarray]:
    return [p.detach().numpy().copy() for p in fit.dynamics.network.parameters()]
