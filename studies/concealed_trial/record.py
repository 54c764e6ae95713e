"""What the recorder makes of the true motion: sensor errors, noise, gaps, outliers, columns and manifest."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from manoeuvre_nn.core.writing import draft_of, write_file
from studies.concealed_trial.case import TrialCase
from studies.concealed_trial.channels import CHANNEL_SETS, published, seconds_of
from studies.concealed_trial.effects import NOISE
from studies.concealed_trial.helm import MANOEUVRE_START, Run
from studies.concealed_trial.model_error import with_model_error
from studies.concealed_trial.motion import STEP, SailedRuns, sail
from studies.concealed_trial.strength import WARMUP
from studies.concealed_trial.truth import TruthModel

DECIMALS = {"t": 1, "x_north": 2, "y_east": 2, "sog": 3, "cog": 2, "psi": 2, "u": 3, "v": 3, "u_log": 3, "r": 3}
DECIMALS |= {"delta_order": 2, "delta": 2, "n": 2}
UNITS = {"t": "s", "x_north": "m", "y_east": "m", "sog": "m/s", "cog": "deg", "psi": "deg", "u": "m/s", "v": "m/s"}
UNITS |= {"u_log": "m/s", "r": "deg/s", "delta_order": "deg", "delta": "deg", "n": "rpm"}
SIGNS = "psi, cog, r clockwise positive; u forward, v to starboard; a positive rudder angle turns the ship to port"
GPS = ["x_north", "y_east", "sog", "cog", "u", "v"]
GAPS = 0.01
"""Share of samples that a sensor leaves out."""


def record(case: TrialCase, step: float = STEP, fresh: np.random.Generator | None = None) -> dict[str, pd.DataFrame]:
    """The recordings of a case, with all channels at all seconds.

    Args:
        case: The case.
        step: Time step of the motion [s].
        fresh: Source of chance of all but the coefficients, for runs that are sailed later.

    Returns:
        Table of each run.
    """
    rng = np.random.default_rng(case.chance)
    truth = with_model_error(case, rng, fresh)
    rng = fresh or rng
    track = sail(truth, case.runs, step=step)
    waves = next((e.parameters for e in case.effects if e.name == "wave_drift"), None)
    tables = {}
    for column, run in enumerate(case.runs):
        table = _channels(case, truth, track, column, run, rng)
        if waves:
            _shake(table, waves["Hs"], np.radians(waves["from_deg"]), rng)
        tables[run.name] = _finish(case, table, rng)
    return tables


def _channels(
    case: TrialCase, truth: TruthModel, track: SailedRuns, column: int, run: Run, rng: np.random.Generator
) -> dict[str, np.ndarray]:
    """Noisy channels of one run, in rad where angles are concerned but for the rudder's and the heading's errors."""
    rows, sd, faults = run.duration + 1, case.noise, truth.sensors
    t = track.t[:rows]
    psi, u, r = (track.state[:rows, k, column] for k in (2, 3, 5))
    position, velocity = antenna(truth, track.state[:rows, :6, column], t, case.latency)

    def noise(channel: str) -> np.ndarray:
        return sd[channel] * rng.standard_normal(rows)

    heading = faults.heading(psi) + np.radians(noise("heading_deg"))
    north, east = velocity[0] + noise("gps_velocity_m_s"), velocity[1] + noise("gps_velocity_m_s")
    by_heading = 1 + faults.log_by_heading[0] * np.cos(psi - faults.log_by_heading[1])
    return {
        "t": t,
        "x_north": position[0] + noise("position_m"),
        "y_east": position[1] + noise("position_m"),
        "north": north,
        "east": east,
        "psi": heading,
        "r": np.degrees(faults.rate_scale * r + faults.rate_bias) + noise("yaw_rate_deg_s"),
        "u_log": faults.log_scale * by_heading * u + noise("log_m_s"),
        "delta_order": np.degrees(track.order[:rows, column]),
        "delta": np.degrees(track.shown(truth.gear.delay)[:rows, column]) + noise("rudder_deg"),
        "n": track.n[:rows, column] + noise("rpm"),
    }


def antenna(truth: TruthModel, state: np.ndarray, t: np.ndarray, latency: float) -> tuple[np.ndarray, np.ndarray]:
    """Position and velocity over ground that the GPS shows, without noise.

    Args:
        truth: The truth model.
        state: x, y, psi, u, v, r in time, (times, 6).
        t: Times [s], one second apart.
        latency: How late it is [s].

    Returns:
        North and east [m]; north and east [m/s].
    """
    x, y, psi, u, v, r = state.T
    forward, across = truth.sensors.lever
    ahead, aside = u - r * across, v + r * forward
    north, east = np.cos(psi), np.sin(psi)
    drift = np.array(truth.sensors.runaway)[:, None]
    current = np.array(truth.current)[:, None]
    velocity = np.array([ahead * north - aside * east, ahead * east + aside * north]) + current + 2 * drift * t
    position = np.array([x + forward * north - across * east, y + forward * east + across * north]) + drift * t * t
    return position - latency * velocity, velocity - latency * np.gradient(velocity, axis=1)


def _shake(table: dict[str, np.ndarray], height: float, come_from: float, rng: np.random.Generator) -> None:
    """Yaw at wave frequencies: a dozen waves between 6 and 14 s, most from the quarters."""
    frequencies = 2 * np.pi / rng.uniform(6.0, 14.0, 12)
    phases = rng.uniform(0, 2 * np.pi, 12)
    t = table["t"][:, None]
    lever = 0.3 + 0.7 * np.abs(np.sin(2 * (come_from - table["psi"])))
    size = np.radians(0.008) * height * lever / np.sqrt(6.0)
    table["psi"] = table["psi"] + size * np.sin(frequencies * t + phases).sum(1)
    table["r"] = table["r"] + np.degrees(size * (frequencies * np.cos(frequencies * t + phases)).sum(1))


def _finish(case: TrialCase, table: dict[str, np.ndarray], rng: np.random.Generator) -> pd.DataFrame:
    """Columns as recorded: speeds along the recorded heading, degrees, outliers, gaps, decimals."""
    north, east, psi = table.pop("north"), table.pop("east"), table["psi"]
    rows = len(psi)
    table["sog"], table["cog"] = np.hypot(north, east), np.degrees(np.arctan2(east, north)) % 360
    table["u"] = north * np.cos(psi) + east * np.sin(psi)
    table["v"] = east * np.cos(psi) - north * np.sin(psi)
    table["psi"] = np.degrees(psi) % 360
    frame = pd.DataFrame({name: table[name] for name in DECIMALS})
    for channels, low, high in ((["x_north", "y_east"], 15.0, 60.0), (["r"], 0.25, 0.6), (["u_log"], 0.7, 1.3)):
        hit = rng.uniform(size=rows) < case.outliers
        for channel in channels:
            frame.loc[hit, channel] += rng.choice([-1.0, 1.0], hit.sum()) * rng.uniform(low, high, hit.sum())
    for channels in (GPS, ["psi"], ["r"], ["u_log"]):
        frame.loc[rng.uniform(size=rows) < GAPS, channels] = np.nan
    frame = frame.round(DECIMALS)
    frame[["psi", "cog"]] = frame[["psi", "cog"]].where(frame[["psi", "cog"]] < 360.0, frame[["psi", "cog"]] - 360.0)
    return frame


def manifest(case: TrialCase) -> dict[str, Any]:
    """The manifest that goes with the recordings.

    Args:
        case: The case.

    Returns:
        Its fields; nothing of the effects.
    """
    (missing, interval), ship, runs = CHANNEL_SETS[case.channels], case.ship, []
    for run in case.runs:
        row: dict[str, Any] = {"run": run.name, "file": f"{run.name}.csv", "split": run.split}
        row |= {"rows": len(seconds_of(case, run))}
        row |= {"duration_s": run.duration, "manoeuvre": run.manoeuvre, "first_turn": run.first_turn}
        runs.append(row | {"initial_heading_deg": run.heading_deg})
    return {
        "case": case.name,
        "ship": ship.name,
        "particulars": ship.particulars,
        "wind_areas": ship.wind_areas,
        "stability": ship.stability,
        "sample_interval_s": float(interval),
        "warmup_s": float(WARMUP),
        "manoeuvre_start_s": MANOEUVRE_START,
        "nominal_noise_sd": NOISE,
        "channels": {name: unit for name, unit in UNITS.items() if name not in missing},
        "signs": SIGNS,
        "runs": runs,
    }


def write_case(case: TrialCase, folder: Path, step: float = STEP) -> None:
    """Write recordings and manifest; the manifest last, so that a case with one is whole.

    Args:
        case: The case.
        folder: The case's own folder.
        step: Time step of the motion [s].
    """
    tables = record(case, step)
    for run in case.runs:
        with draft_of(folder / f"{run.name}.csv") as draft:
            published(case, run, tables[run.name]).to_csv(draft, index=False)
    write_file(folder / "manifest.json", json.dumps(manifest(case), indent=1))
