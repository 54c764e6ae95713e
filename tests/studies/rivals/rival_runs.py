"""Short noisy trials of the Mariner with effects, as the rival methods get them."""

from collections.abc import Sequence
from functools import cache

import numpy as np
from fleet import unchecked

from manoeuvre_nn.core.channels import MEASURED
from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.diagnosis.case import Case
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.effect.propulsion import HullFouling
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.recording.preparation import with_measured
from manoeuvre_nn.ship.mariner import mariner_corrected

SHIP = mariner_corrected()
CALM = CalmWater(SHIP)
NOTHING = HullFouling(SHIP, added_resistance=0.0)
TRIALS = (turning_circle(20.0, side="port", duration=400.0), zigzag(20.0, duration=400.0))
NOISE = np.array([0.7, 0.7, 0.04, 0.04, 0.1 * DEGREE, 0.02 * DEGREE, 0.05, 0.00125])
"""Standard deviations of the channels."""


def sailed(
    effects: Sequence[Effect] = (), noise: float = 1.0, seed: int = 0, held_out: bool = False
) -> list[Recording]:
    """A turn to port and a zigzag, a quarter of a second late by satellite."""
    return [_run(record, noise, seed + k, held_out) for k, record in enumerate(_sailed_once(tuple(effects)))]


@cache
def _sailed_once(effects: tuple[Effect, ...]) -> tuple[Recording, ...]:
    """The same for every noise; effects are told apart as objects."""
    with unchecked():
        return tuple(roll_out(Vessel(CALM, list(effects) or [NOTHING]), list(TRIALS), step=1.0))


def _run(record, noise: float, seed: int, held_out: bool) -> Recording:
    c, n = record.channels, len(record.time)
    measured = np.stack([*(c[name] for name in MEASURED[:7]), c.get("shaft", np.ones(n))], axis=-1)
    measured[:, :4] -= 0.25 * np.gradient(measured[:, :4], axis=0)
    measured += noise * NOISE * np.random.default_rng(seed).standard_normal(measured.shape)
    name = f"{record.name}_{'proof' if held_out else 'fit'}"
    still = np.zeros(n)
    inputs = {"delta": c["delta"], "delta_order": c["delta_order"], "order_lead": still, "shaft": 1 + still}
    run = Recording(name, record.time, inputs, meta={"rudder_noise": 0.0, "kind": ""})
    return with_measured(run, measured)


@cache
def case_with(*kinds: tuple[type[Effect], tuple[tuple[str, float], ...]]) -> Case:
    """Two runs to fit and the same again, with other noise, for the proof."""
    effects = [kind(SHIP, **dict(values)) for kind, values in kinds]
    proof = sailed(effects, seed=7, held_out=True)
    return Case("c1", "mariner", (*sailed(effects), *proof), SHIP, 40.0, frozenset(run.name for run in proof))
