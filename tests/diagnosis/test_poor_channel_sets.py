"""A few channels are enough for what is strong, and what they cannot decide is said."""

import numpy as np
import pytest
from fleet import unchecked
from sailed import TRIALS, table_of, write_runs

from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.diagnosis.case import Question, RunSettings, read_runs
from manoeuvre_nn.diagnosis.diagnose import diagnose
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.effect.current import Current
from manoeuvre_nn.effect.rudder import RudderOffset
from manoeuvre_nn.effect.wind import SteadyWind
from manoeuvre_nn.ship.mariner import mariner_corrected

SHIP = mariner_corrected()
GPS_AND_HEADING = ["t", "x_north", "y_east", "psi", "delta"]
NO_LOG_NO_GYRO_NO_SHAFT = ["t", "x_north", "y_east", "sog", "cog", "psi", "delta_order", "delta"]


def tables(effect: Effect | None):
    with unchecked():
        runs = roll_out(Vessel(CalmWater(SHIP), [effect] if effect else []), list(TRIALS[:3]), step=1.0)
    for k, run in enumerate(runs):
        cos, sin = np.cos(run["psi"]), np.sin(run["psi"])
        north, east = run["u"] * cos - run["v"] * sin, run["u"] * sin + run["v"] * cos
        yield table_of(run.with_channels(**{"vn": north, "ve": east, "u_log": run["u"], **run.channels}), k)


@pytest.mark.slow
@pytest.mark.parametrize(
    "columns, step, effect, found",
    [
        (GPS_AND_HEADING, 2, None, []),
        (GPS_AND_HEADING, 2, Current(SHIP, speed=0.5, toward_deg=60.0), [0.5, 60.0]),
        (GPS_AND_HEADING, 2, RudderOffset(SHIP, offset_deg=1.5), [1.5]),
        (NO_LOG_NO_GYRO_NO_SHAFT, 2, SteadyWind(SHIP, speed=15.0, from_deg=70.0), [15.0, 70.0]),
    ],
)
def test_strong_effects_are_found_with_few_channels(tmp_path, unchecked_types, columns, step, effect, found):
    made = {f"r{k}": table[columns][::step] for k, table in enumerate(tables(effect))}
    case = read_runs(write_runs(tmp_path, made), SHIP, RunSettings(rudder_positive_to="port"))
    d = diagnose(Question(case, CalmWater(case.hull), [Current(SHIP), RudderOffset(SHIP), SteadyWind(SHIP)]))
    assert d.model == ([effect.name] if effect else [])
    if effect:
        values = d.causes[0].parameters[: len(found)]
        assert all(abs(v.value - true) < 3.5 * v.error for v, true in zip(values, found, strict=True)), values
    said = " ".join(d.undecided)
    assert all(f"No {what}" in said for what in ("speed log", "yaw rate", "shaft speed"))
    assert ("No helm order" in said) is ("delta_order" not in columns)
    assert ("No velocity over ground" in said) is ("sog" not in columns)
