"""How a prediction starts: the state that explains the steady approach up to the warm-up best."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from studies.concealed_trial.effects import NOISE
from studies.concealed_trial.motion import COARSE, replay
from studies.concealed_trial.record import antenna
from studies.concealed_trial.ships import TrialShip
from studies.concealed_trial.truth import ConcealedEffect, TruthModel, build

CHANNELS = {"x_north": "x", "y_east": "y", "psi": "psi", "u": "u", "v": "v", "r": "r", "u_log": "u_log"}
"""Columns of a recording and of a prediction."""
NOISE_OF = {
    "x_north": "position_m",
    "y_east": "position_m",
    "psi": "heading_deg",
    "u": "gps_velocity_m_s",
    "v": "gps_velocity_m_s",
    "r": "yaw_rate_deg_s",
    "u_log": "log_m_s",
}


STEPS = np.array([1.0, 1.0, 1e-3, 0.05, 0.05, 1e-4])
"""Changes of x, y [m], psi [rad], u, v [m/s], r [rad/s] for the slopes."""


def smoothed_start(
    ship: TrialShip, effects: Sequence[ConcealedEffect], names: list[str], tables: Sequence[pd.DataFrame], warmup: int
) -> np.ndarray:
    """States at the warm-up: roll-outs from t = 0, driven by the recorded rudder, fitted to all channels.

    Args:
        ship: The ship.
        effects: What acts.
        names: Names of the runs.
        tables: Their recordings.
        warmup: End of the warm-up [s].

    Returns:
        9 rows, one column for each run.
    """
    count, t = len(names), np.arange(warmup + 1.0)
    truth = build(ship, effects, names * (len(STEPS) + 1))
    approach = [table[table["t"] <= warmup] for table in tables]
    start = np.stack([first_start(truth, table) for table in approach], axis=1)
    moved = [start + np.pad(row, (0, 3))[:, None] for row in np.diag(STEPS)]
    order, shown = (np.tile(angle, len(STEPS) + 1) for angle in rudder(truth, tables, 0, warmup + 1))
    states = replay(truth, np.concatenate([start, *moved], axis=1), t, order, shown, step=COARSE)
    ends = []
    for k, table in enumerate(approach):
        columns = states[:, :, k::count]
        rows = [_weighted(shown_by_recorder(truth, t, columns[:, :6, j]), table) for j in range(columns.shape[2])]
        slopes = np.stack([row - rows[0] for row in rows[1:]], axis=1)
        share = np.linalg.lstsq(slopes, -rows[0], rcond=None)[0]
        ends.append(columns[-1, :, 0] + (columns[-1, :, 1:] - columns[-1, :, :1]) @ share)
    return np.stack(ends, axis=1)


def _weighted(predicted: pd.DataFrame, recorded: pd.DataFrame) -> np.ndarray:
    """Prediction minus recording over the noise, all channels in a row; 0 where nothing was recorded."""
    misses = []
    for channel, column in CHANNELS.items():
        miss = predicted[column].to_numpy() - recorded[channel].to_numpy()
        miss = (miss + 180.0) % 360.0 - 180.0 if channel == "psi" else miss
        misses.append(np.nan_to_num(miss / NOISE[NOISE_OF[channel]]))
    return np.concatenate(misses)


def rudder(truth: TruthModel, tables: Sequence[pd.DataFrame], first: int, last: int) -> tuple[np.ndarray, np.ndarray]:
    """Orders and rudder angles that drive a prediction; a delay of the recorded angle is taken off.

    Args:
        truth: The ship and its effects.
        tables: Recordings of the runs.
        first: First second.
        last: Second after the last; shorter runs keep their last value.

    Returns:
        Orders and angles [rad], (times, runs).
    """
    order, shown = (_stacked(tables, name, last) for name in ("delta_order", "delta"))
    if truth.gear.delay:
        t = np.arange(float(last))
        shown = np.stack([np.interp(t + truth.gear.delay, t, column) for column in shown.T], axis=1)
    return order[first:], shown[first:]


def _stacked(tables: Sequence[pd.DataFrame], name: str, last: int) -> np.ndarray:
    """A rudder column of all runs [rad]."""
    columns = [table[name].interpolate(limit_direction="both").to_numpy()[:last] for table in tables]
    return np.radians(np.stack([np.pad(c, (0, last - len(c)), mode="edge") for c in columns], axis=1))


def first_start(truth: TruthModel, table: pd.DataFrame) -> np.ndarray:
    """State at t = 0 from means and lines through a steady approach, with the sensors' known faults taken off.

    Args:
        truth: The ship and its effects.
        table: Recording up to the warm-up.

    Returns:
        x, y [m], psi [rad], u, v [m/s], r [rad/s], 0, 0, 0.
    """
    faults, t = truth.sensors, table["t"].to_numpy()
    now = float(t[0])

    def line(values: np.ndarray) -> tuple[float, float]:
        """Slope, and value at the start."""
        known = np.isfinite(values)
        slope, first = np.polyfit(t[known] - now, values[known], 1)
        return float(slope), float(first)

    r, first = np.radians(line(table["psi"].to_numpy()))
    psi = 2 * first - float(faults.heading(np.array([first]))[0])
    heading = np.radians(table["psi"].to_numpy())
    along, across = table["u"].to_numpy(), table["v"].to_numpy()
    drift = 2 * np.array(faults.runaway) * t.mean()
    north = float(np.nanmean(along * np.cos(heading) - across * np.sin(heading))) - truth.current[0] - drift[0]
    east = float(np.nanmean(along * np.sin(heading) + across * np.cos(heading))) - truth.current[1] - drift[1]
    forward, aside = faults.lever
    cosine, sine = np.cos(psi), np.sin(psi)
    u, v = north * cosine + east * sine + r * aside, east * cosine - north * sine - r * forward
    x = line(table["x_north"].to_numpy())[1] - forward * cosine + aside * sine - faults.runaway[0] * now**2
    y = line(table["y_east"].to_numpy())[1] - forward * sine - aside * cosine - faults.runaway[1] * now**2
    return np.array([x, y, psi, u, v, r, 0.0, 0.0, 0.0])


def shown_by_recorder(truth: TruthModel, t: np.ndarray, state: np.ndarray) -> pd.DataFrame:
    """What the recorder shows of a motion, without noise.

    Args:
        truth: The ship and its effects.
        t: Times [s].
        state: (times, 6).

    Returns:
        Columns of a prediction.
    """
    faults, psi, u = truth.sensors, state[:, 2], state[:, 3]
    position, (north, east) = antenna(truth, state, t, 0.0)
    heading = faults.heading(psi)
    log = faults.log_scale * (1 + faults.log_by_heading[0] * np.cos(psi - faults.log_by_heading[1]))
    columns = {"t": t, "x": position[0], "y": position[1], "psi": np.degrees(heading)}
    columns["u"] = north * np.cos(heading) + east * np.sin(heading)
    columns["v"] = east * np.cos(heading) - north * np.sin(heading)
    columns["r"] = np.degrees(faults.rate_scale * state[:, 5] + faults.rate_bias)
    columns["u_log"] = log * u
    return pd.DataFrame(columns)
