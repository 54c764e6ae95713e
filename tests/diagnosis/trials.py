"""Simulated trials of the Mariner as a diagnosis gets them: sampled, noisy, with effects."""

from collections.abc import Sequence
from functools import cache

import numpy as np
import torch
from fleet import ship_named, unchecked

from manoeuvre_nn.core.channels import MEASURED
from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.core.manoeuvre import Manoeuvre, Stage
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.estimation.linearised_run import LinearisedRun, Rate, linearise
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.recording.preparation import order_lead, smooth_rudder, with_measured

SHIP = ship_named("mariner")
CALM = CalmWater(SHIP)
RATE = SHIP.particulars.rudder_rate
NOISE = np.array([0.8, 0.8, 0.05, 0.05, 0.1 * DEGREE, 0.02 * DEGREE, 0.05, 0.003])
"""Standard deviations of the channels."""
STEP = 2.0
"""Between samples of runs [s]; their noise is such that they tell as much in all as at one every second."""
ZIGZAG = zigzag(20.0, duration=240.0)
CIRCLE = turning_circle(25.0, duration=240.0)
PORT = turning_circle(15.0, side="port", duration=240.0)
HELM = ((10.0, 20.0), (-10.0, 25.0), (20.0, 20.0), (-5.0, None))
TIMED = Manoeuvre("timed", "random_rudder", tuple(Stage(a * DEGREE, hold=t) for a, t in HELM), duration=80.0)
"""Orders by the clock, so that effects do not shift them; the Mariner's rudder arrives on full seconds."""


def sailed(trials: Sequence[Manoeuvre], effects: Sequence[Effect] = (), step: float = 1.0) -> list[Recording]:
    """What happened; steps of a second are good to a millimetre a minute."""
    return list(_sailed_once(tuple(trials), tuple(effects), step))


@cache
def _sailed_once(trials: tuple[Manoeuvre, ...], effects: tuple[Effect, ...], step: float) -> tuple[Recording, ...]:
    """The same for all tests; effects are told apart as objects."""
    with unchecked():
        return tuple(roll_out(Vessel(CALM, list(effects)), list(trials), step=step, interval=step))


def run_of(record: Recording, noise: np.ndarray | float = 0.0, seed: int = 0, **more) -> Recording:
    """A recording as a run: perfect, or with white noise on all channels and a rudder indicator with noise too."""
    c = record.channels
    if "vn" not in c:
        cos, sin = np.cos(c["psi"]), np.sin(c["psi"])
        c = {**c, "vn": c["u"] * cos - c["v"] * sin, "ve": c["u"] * sin + c["v"] * cos, "u_log": c["u"]}
    measured = np.stack([*(c[k] for k in MEASURED[:7]), c.get("shaft", np.ones_like(c["u"]))], axis=-1)
    g = np.random.default_rng(seed)
    measured = measured + noise * g.standard_normal(measured.shape)
    order, shown = c["delta_order"], c["delta"]
    step = float(record.time[1] - record.time[0])
    lead, jitter = order_lead(shown, order, step, RATE), 0.0
    if np.any(noise):
        shown = shown + 0.1 * DEGREE * g.standard_normal(len(shown))
        shown, jitter = smooth_rudder(shown, order, step, RATE)
    inputs = {"delta": shown, "delta_order": order, "order_lead": lead, "shaft": np.ones_like(order)}
    meta = {"rudder_noise": jitter, "kind": str(record.meta["kind"]), **more}
    return with_measured(Recording(record.name, record.time, inputs, meta=meta), measured)


def runs(
    trials: Sequence[Manoeuvre],
    effects: Sequence[Effect] = (),
    noise: np.ndarray | float = NOISE,
    seed: int = 0,
    step: float = STEP,
) -> list[Recording]:
    """Trials as runs, the noise of each its own."""
    return [run_of(r, noise / step**0.5, seed + k) for k, r in enumerate(sailed(trials, effects, step))]


def states_of(record: Recording) -> np.ndarray:
    """u, v, r, x, y, psi; those that effects on sensors change are as written down."""
    return record.stacked("u", "v", "r", "x", "y", "psi")


def about(run: Recording, track: np.ndarray) -> LinearisedRun:
    """A run's equations about a track."""
    with unchecked():
        return linearise(run, Rate(CALM), track)


def values(effect: Effect, count: int = 1) -> np.ndarray:
    """An effect's own values, one row a run."""
    return np.tile(effect.values.numpy(), (count, 1))


def tensor(x: np.ndarray) -> torch.Tensor:
    """The same numbers."""
    return torch.tensor(x)
