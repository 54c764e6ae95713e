"""Recorded runs of the Mariner as a csv has them: what the tests of the diagnosis command read."""

from collections.abc import Mapping
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
from fleet import unchecked

from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.effect.current import Current
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.ship.mariner import mariner_corrected

TRIALS = (
    zigzag(20.0, duration=240.0),
    turning_circle(25.0, duration=240.0),
    zigzag(10.0, first="port", duration=240.0),
    turning_circle(20.0, side="port", duration=240.0),
)
NOISE = {"x_north": 0.7, "y_east": 0.7, "sog": 0.04, "cog": 0.3, "psi": 0.1, "r": 0.02, "u_log": 0.05, "delta": 0.1}
"""Standard deviations in the columns' units."""


@cache
def sailed(current: float = 0.0, toward: float = 60.0) -> tuple[pd.DataFrame, ...]:
    """Four runs at 1 Hz with all columns, rudder positive to port."""
    ship = mariner_corrected()
    dynamics = Vessel(CalmWater(ship), [Current(ship, speed=current, toward_deg=toward)])
    with unchecked():
        runs = roll_out(dynamics, list(TRIALS), step=1.0)
    return tuple(table_of(run, seed) for seed, run in enumerate(runs))


def to_starboard(table: pd.DataFrame) -> pd.DataFrame:
    """The same with a rudder angle that is positive to starboard."""
    return table.assign(delta=-table.delta, delta_order=-table.delta_order)


def table_of(run, seed: int) -> pd.DataFrame:
    """A run with noise, in the columns of a csv."""
    north, east = run["vn"], run["ve"]
    table = pd.DataFrame({
        "t": run.time, "x_north": run["x"], "y_east": run["y"], "sog": np.hypot(north, east),
        "cog": np.arctan2(east, north) / DEGREE, "psi": run["psi"] / DEGREE, "u_log": run["u_log"],
        "r": run["r"] / DEGREE, "delta_order": -run["delta_order"] / DEGREE, "delta": -run["delta"] / DEGREE,
        "n": 76.0,
    })  # fmt: skip
    stream = np.random.default_rng(seed)
    for column, sd in NOISE.items():
        table[column] += sd * stream.standard_normal(len(table))
    away = (table["cog"] - table["psi"]) * DEGREE
    table["u"], table["v"] = table["sog"] * np.cos(away), table["sog"] * np.sin(away)
    table[["psi", "cog"]] %= 360.0
    return table


def write_runs(folder: Path, runs: Mapping[str, pd.DataFrame]) -> Path:
    """One csv a run."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, table in runs.items():
        table.to_csv(folder / f"{name}.csv", index=False, float_format="%.4f")
    return folder


def manifest(*runs: str, held_out: str = "", **more) -> dict:
    """What a manifest of the Mariner says."""
    listed = [
        {"run": r, "file": f"{r}.csv", "split": "held_out" if r == held_out else "fit", "rows": 241} for r in runs
    ]
    return {
        "case": "c1", "ship": "mariner", "warmup_s": 40.0, "runs": listed,
        "particulars": {
            "length_m": 152.4, "beam_m": 21.763, "draft_m": 8.138, "approach_speed_m_s": 7.614,
            "rudder_rate_deg_s": 2.5, "nominal_rpm": 76.0, "calm_water_resistance_kN": 350.1, "displacement_t": 16274,
        },
        "wind_areas": {
            "frontal_m2": 420.0, "lateral_m2": 1650.0, "lateral_centroid_fwd_of_midship_m": -4.0,
            "length_overall_m": 158.0,
        },
        "stability": {"GM_m": 0.6, "KG_m": 8.4, "roll_period_s": 21.5, "roll_damping_ratio": 0.08},
    } | more  # fmt: skip
