"""What wind does to the overshoots of ship 2: models that do not know of it, that do, and a diagnosis that is asked."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

import manoeuvre_nn as mnn
from manoeuvre_nn.core.manoeuvre import Manoeuvre
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.diagnosis.result import Diagnosis
from manoeuvre_nn.dynamics.base import Model
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.recursive import RecursiveShip
from manoeuvre_nn.dynamics.replay import replay
from manoeuvre_nn.network.recursive import RecursiveNetwork, RecursiveSettings
from manoeuvre_nn.scoring.error_measures import error_measures, normalisations
from manoeuvre_nn.ship.four_degrees import FourDegreeShip
from manoeuvre_nn.training.recursive_fit import FitPlan, fit_recursive
from manoeuvre_nn.training.recursive_windows import RecursiveFitSettings
from studies.hess2000.runs import PlannedRun, RunSet, TrueWinds, sail
from studies.hess2000.training import OVERSHOOT_STAGES

WIND_CHANNELS = ("wind_speed", "wind_from")
SERIES_EPOCHS = 10
TEST_EVERY = 100
SIGNIFICANT = 1.96
"""Standard errors to either side within which the truth lies in 95 % of the cases."""


def without_wind(runs: Sequence[Recording]) -> list[Recording]:
    """Runs whose wind was not written down."""
    return [replace(r, channels={k: c for k, c in r.channels.items() if k not in WIND_CHANNELS}) for r in runs]


def percent_errors(predictions: Sequence[Recording], runs: RunSet) -> pd.DataFrame:
    """Percent errors as the paper has them.

    Args:
        predictions: Of own and unseen runs, in this order.
        runs: The runs.

    Returns:
        A line each for ``own`` (training and validation), ``validation`` and ``unseen``; a column a variable.
    """
    parts = {"own": runs.own, "validation": runs.validation, "unseen": runs.unseen}
    sets = {label: [r.name for r in part] for label, part in parts.items()}
    table = error_measures(predictions, [*runs.own, *runs.unseen], sets)["percent"].unstack()
    return table.loc[list(sets)]


def errors_of(model: Model, runs: RunSet, *, told: bool) -> pd.DataFrame:
    """Percent errors of a model that gets the recorded controls, and the wind if it is told.

    Args:
        model: The model.
        runs: The runs.
        told: Whether the wind is among what it gets.

    Returns:
        As :func:`percent_errors`.
    """
    recorded = [*runs.own, *runs.unseen]
    return percent_errors(replay(model, recorded if told else without_wind(recorded)), runs)


def perfect_but_for_wind(runs: RunSet) -> pd.DataFrame:
    """Percent errors of the ship herself in calm air, driven by the controls that were recorded in wind."""
    return errors_of(CalmWater(runs.ship), runs, told=False)


def series(runs: RunSet, *, told: bool, epochs: int = SERIES_EPOCHS) -> Model:
    """A series of products identified in closed loop from the training runs, on three degrees of freedom.

    Args:
        runs: The runs.
        told: Whether the wind is recorded, and then has terms of its own.
        epochs: Passes of the estimator.

    Returns:
        The model, the particulars of the ship being all that it knows of her.
    """
    training = runs.training if told else without_wind(runs.training)
    settings = ["network.members=1", f"trainer.max_epochs={epochs}"]
    return mnn.fit(runs.ship.particulars, list(training), "cubic", settings).model


def recursive(runs: RunSet, *, told: bool, seed: int = 0, share: float = 1.0) -> Model:
    """The recursive network, trained in closed loop.

    Args:
        runs: Training runs teach it, training and validation runs decide which weights are kept.
        told: Whether force and moment of the recorded wind act on its output nodes.
        seed: Of first weights and windows.
        share: Of the updates of :data:`.OVERSHOOT_STAGES` that are done.

    Returns:
        The model.
    """
    model = RecursiveShip(runs.ship, RecursiveNetwork(RecursiveSettings(wind=told), seed=seed))
    settings = RecursiveFitSettings(stages=OVERSHOOT_STAGES)
    plan = FitPlan(max(round(share * settings.updates), 1), TEST_EVERY, seed)
    fit_recursive(model, runs.training, runs.validation, settings=settings, plan=plan)
    return model


@dataclass(frozen=True)
class BlindAnswer:
    """What a diagnosis said of two runs on opposite courses whose wind it was not told.

    Attributes:
        named: Effects of the repaired model; empty where it found nothing to repair.
        speed: Wind speed [m/s], estimate and standard error; NaN where it named no wind.
        from_deg: Where it comes from [deg], likewise.
        true_speed: True wind [m/s].
        true_from_deg: Where it comes from [deg].
    """

    named: tuple[str, ...]
    speed: tuple[float, float]
    from_deg: tuple[float, float]
    true_speed: float
    true_from_deg: float

    @property
    def windy(self) -> bool:
        """Whether it named a wind and nothing else."""
        return len(self.named) == 1 and self.named[0].startswith("wind_")

    @property
    def holds(self) -> bool:
        """Whether both intervals of 95 % hold the truth."""
        turned = abs(self.from_deg[0] - self.true_from_deg + 180.0) % 360.0 - 180.0
        near = abs(self.speed[0] - self.true_speed) <= SIGNIFICANT * self.speed[1]
        return bool(near and abs(turned) <= SIGNIFICANT * self.from_deg[1])


def pairs(runs: RunSet) -> list[tuple[Recording, Recording]]:
    """Own runs two by two: those that share a wind."""
    ordered = sorted(runs.own, key=lambda r: r.name)
    return list(zip(ordered[::2], ordered[1::2], strict=True))


def asked_blindly(runs: RunSet, pair: Sequence[Recording]) -> tuple[BlindAnswer, Diagnosis]:
    """Ask a diagnosis that has the ship in calm air for its model, and is not told of the wind.

    Args:
        runs: Where the runs are from.
        pair: Runs that share a wind.

    Returns:
        What it said beside the truth, and all of it.
    """
    found = mnn.diagnose(runs.ship, without_wind(pair), held_out=[]).diagnosis
    first = pair[0].channels
    windy = "wind_speed" in first
    truth = (float(first["wind_speed"][0]), float(first["wind_from"][0] / DEGREE)) if windy else (0.0, np.nan)
    values = {v.name: (v.value, v.error) for c in found.causes if c.name in found.model for v in c.parameters}
    none = (np.nan, np.nan)
    return BlindAnswer(tuple(found.model), values.get("speed", none), values.get("from_deg", none), *truth), found


def repeated(
    ship: FourDegreeShip, manoeuvres: Sequence[Manoeuvre], wind: TrueWinds, count: int, seed: int = 0
) -> pd.DataFrame:
    """The same overshoots sailed again and again, each time in another wind.

    Args:
        ship: The ship.
        manoeuvres: Overshoots with their approach speeds.
        wind: What is drawn from.
        count: How often each is sailed.
        seed: Of the winds.

    Returns:
        By how much two of them differ at most, over their mean [%]: a line a manoeuvre; spatial period x, peak-to-peak
        y, phi and psi.
    """
    draw, rows = np.random.default_rng(seed), {}
    for manoeuvre in manoeuvres:
        runs = sail(ship, [PlannedRun(manoeuvre, *wind.draw(draw)) for _ in range(count)])
        sizes = pd.concat([normalisations([run]) for run in runs])[["x", "y", "phi", "psi"]]
        rows[manoeuvre.name] = 100 * (sizes.max() - sizes.min()) / sizes.mean()
    return pd.DataFrame(rows).T
