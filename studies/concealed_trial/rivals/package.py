"""All that the rival methods use of the package's rooms for models, estimation and diagnosis, in one place."""

from manoeuvre_nn.diagnosis.case import Case
from manoeuvre_nn.diagnosis.repair import predict, recorded
from manoeuvre_nn.diagnosis.result import Cause, Diagnosis, Interval, Proof, Value
from manoeuvre_nn.dynamics.base import Model
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.estimation.corrections import Calibrated
from manoeuvre_nn.estimation.data_set import FIRST_NOISE, process_time, typical
from manoeuvre_nn.estimation.effect_columns import coefficient_columns, contribution
from manoeuvre_nn.estimation.hypothesis import Hypothesis
from manoeuvre_nn.estimation.linear_run import Columns
from manoeuvre_nn.estimation.linearised_run import LinearisedRun, Rate, linearise
from manoeuvre_nn.recording.local_cubics import ORDER, smoothed
from manoeuvre_nn.recording.preparation import measured
from manoeuvre_nn.scoring.free_runs import errors

__all__ = [
    "Calibrated",
    "CalmWater",
    "Case",
    "Cause",
    "coefficient_columns",
    "Columns",
    "contribution",
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
    "recorded",
    "smoothed",
    "typical",
    "Value",
]
