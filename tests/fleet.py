"""Every ship and a short trial of every family: what the physics tests run over. Each run is computed once."""

import copy
from contextlib import contextmanager
from functools import cache
from math import inf

import numpy as np
import torch
from jaxtyping import config

from manoeuvre_nn.core.manoeuvre import Manoeuvre
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.rollout import roll_out, rollout
from manoeuvre_nn.dynamics.simulate import simulate, to_recordings
from manoeuvre_nn.manoeuvre.spiral import spiral
from manoeuvre_nn.manoeuvre.straight import random_rudder, straight
from manoeuvre_nn.manoeuvre.turning import pull_out, turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.ship.esso_190k import PARTICULARS as ESSO
from manoeuvre_nn.ship.esso_190k import esso_190k
from manoeuvre_nn.ship.great_lakes_bulker import great_lakes_bulker
from manoeuvre_nn.ship.mariner import mariner, mariner_chislett1965, mariner_corrected
from manoeuvre_nn.ship.taylor import TaylorShip

SHIPS = {
    "mariner": mariner,
    "mariner_corrected": mariner_corrected,
    "mariner_chislett1965": mariner_chislett1965,
    "great_lakes_bulker": great_lakes_bulker,
    "esso_190k": esso_190k,
    "esso_190k_shallow": lambda: esso_190k(depth=1.5 * ESSO.draught),
}
TRIALS = {
    trial.name: trial
    for trial in (
        zigzag(20.0, duration=160.0),
        zigzag(10.0, 5.0, first="port", executes=3, duration=150.0),
        turning_circle(25.0, duration=160.0),
        pull_out(15.0, side="port", turn_deg=30.0, coast=160.0),
        spiral(10.0, hold=15.0),
        straight(100.0),
        random_rudder(15.0, duration=60.0),
    )
}


@contextmanager
def unchecked():
    """Leaves out the checks of shapes and types, which take up to two thirds of the time; may be nested."""
    before = config.jaxtyping_disable
    config.update("jaxtyping_disable", True)
    try:
        yield
    finally:
        config.update("jaxtyping_disable", before)


@cache
def ship_named(name: str) -> Ship:
    return SHIPS[name]()


@cache
def rolled(name: str, parts: int = 1) -> dict[str, Recording]:
    """All trials of a ship by the batched solution, with the default step or a part of it."""
    ship = ship_named(name)
    step = min(ship.particulars.time_unit / 20, ship.particulars.sample_interval) / parts
    with unchecked():
        recordings = roll_out(CalmWater(ship), list(TRIALS.values()), step=step)
    return dict(zip(TRIALS, recordings, strict=True))


@cache
def solved(name: str, trial: str) -> Recording:
    """One trial of a ship by the accurate solution."""
    with unchecked():
        return simulate(CalmWater(ship_named(name)), TRIALS[trial])


def coarse(ship: Ship, trials: list[Manoeuvre], duration: float, interval: float) -> list[Recording]:
    """Long trials in one batch with steps of one interval; events are located all the same."""
    start = torch.zeros(len(trials), 6, dtype=torch.float64)
    start[:, 0] = ship.particulars.speed
    times = np.arange(0.0, duration + 1e-9, interval)
    with torch.no_grad(), unchecked():
        runs = rollout(CalmWater(ship), trials, start, torch.tensor(times), step=interval)
    assert (runs.ended == inf).all()
    return to_recordings(CalmWater(ship), trials, runs)


def distance(a: Recording, b: Recording) -> float:
    """Largest distance between two tracks [m]."""
    assert len(a) == len(b)
    return float(np.hypot(a["x"] - b["x"], a["y"] - b["y"]).max())


def without_offsets(ship: Ship) -> Ship:
    """The ship without the terms that push a straight course to one side."""
    ship = copy.deepcopy(ship)
    if isinstance(ship, TaylorShip):
        even = [sum(c in "vrd" for c in term) % 2 == 0 for term in ship.series.terms]
        ship.series.coefficients[even, 1:] = 0.0
    else:
        ship.coefficient_table[ship.terms.index("LgT"), 1:] = 0.0
    return ship
