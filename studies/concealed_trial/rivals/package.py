"""All that the rival methods use of the package's rooms for models, estimation and diagnosis, in one place."""

import importlib
import pkgutil

import manoeuvre_nn.effect
from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.diagnosis.case import SHIPS, Case, read_case
from manoeuvre_nn.diagnosis.repair import predict, recorded
from manoeuvre_nn.diagnosis.result import Cause, Diagnosis, Interval, Proof, Value
from manoeuvre_nn.dynamics.base import Model
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.rollout import rollout
from manoeuvre_nn.dynamics.simulate import Solution
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.estimation.corrections import Calibrated, Corrections
from manoeuvre_nn.estimation.effect_columns import coefficient_columns, contribution
from manoeuvre_nn.estimation.hypothesis import Hypothesis
from manoeuvre_nn.estimation.linear_run import Columns
from manoeuvre_nn.estimation.linearised_run import LinearisedRun, Rate, linearise
from manoeuvre_nn.estimation.prepared_run import FIRST_NOISE, process_time, typical_rates
from manoeuvre_nn.recording.local_cubics import ORDER, smoothed
from manoeuvre_nn.recording.preparation import measured, with_measured
from manoeuvre_nn.scoring.free_runs import errors

__all__ = [
    "Calibrated",
    "CalmWater",
    "Case",
    "Cause",
    "coefficient_columns",
    "Columns",
    "contribution",
    "Corrections",
    "Diagnosis",
    "errors",
    "FIRST_NOISE",
    "Hypothesis",
    "Interval",
    "linearise",
    "LinearisedRun",
    "measured",
    "Model",
    "ORDER",
    "predict",
    "process_time",
    "Proof",
    "Rate",
    "read_case",
    "recorded",
    "rollout",
    "shelf",
    "SHIPS",
    "smoothed",
    "Solution",
    "typical_rates",
    "Value",
    "Vessel",
    "with_measured",
]


NEVER_HIDDEN = ("position_conversion", "tidal_current")
"""Candidates of the package that the trial's instructions do not have."""


def shelf(ship: Ship) -> list[Effect]:
    """Every effect that an answer may name.

    Args:
        ship: The ship.

    Returns:
        Prototypes.
    """
    found: dict[str, Effect] = {}
    for entry in pkgutil.iter_modules(manoeuvre_nn.effect.__path__):
        module = importlib.import_module(f"manoeuvre_nn.effect.{entry.name}")
        for kind in vars(module).values():
            candidate = isinstance(kind, type) and issubclass(kind, Effect) and kind.candidate
            if candidate and kind.name not in NEVER_HIDDEN:
                found.setdefault(kind.name, kind(ship))
    return list(found.values())
