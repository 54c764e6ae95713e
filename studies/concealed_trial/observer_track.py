"""What the ideal observer looks at: recorded runs on whole seconds, a reference track, and what an effect leaves there.

The reference is the recorded track smoothed over seconds. It is so close to the true one that the equations are linear
between both, however strong an effect is; what a hypothesis leaves unexplained is taken along it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.signal import lfilter, savgol_filter

from studies.concealed_trial.helm import SteeringGear
from studies.concealed_trial.motion import runge_kutta
from studies.concealed_trial.record import antenna
from studies.concealed_trial.ships import TrialShip, trial_ships
from studies.concealed_trial.true_model import read_manifest, read_run
from studies.concealed_trial.truth import SHAFT_LAG, ConcealedEffect, Gear, TruthModel, build

CHANNELS = ("x", "y", "psi", "north", "east", "r", "u_log", "n")
"""Rows of the measurements: antenna [m], compass [rad], velocity over ground [m/s], gyro [rad/s], log, rpm."""
NOISES: tuple[str, ...] = (
    "position_m",
    "position_m",
    "heading_deg",
    "gps_velocity_m_s",
    "gps_velocity_m_s",
    "yaw_rate_deg_s",
)
NOISES += ("log_m_s", "rpm")
LATENCY = 0.25
"""Mean delay of the GPS [s]."""
WINDOW = 9
"""Samples that the reference is smoothed over."""
BRIDGED = 5
"""A longer gap ends a segment [s]."""
SHOWN = np.radians(0.35)
"""A recorded rudder angle this close to that of the nominal gear is noise about it [rad]."""


@dataclass(frozen=True)
class Track:
    """Runs of one case side by side, one column a second.

    Attributes:
        ship: The ship.
        runs: Run of each column.
        t: Time of each column [s].
        ends: Whether a segment ends with a column.
        reference: x, y, psi, u, v, r through the water.
        measured: Rows of :data:`CHANNELS`; NaN where nothing was recorded.
        sd: Noise of each channel.
        rudder: Orders and shown angles [rad] of each run, one row a second.
        known_blades: Blade angles of the steering gears that have been tried.
    """

    ship: TrialShip
    runs: tuple[str, ...]
    t: np.ndarray
    ends: np.ndarray
    reference: np.ndarray
    measured: np.ndarray
    sd: np.ndarray
    rudder: Mapping[str, tuple[np.ndarray, np.ndarray]]
    known_blades: dict[Gear, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)

    @cached_property
    def heel(self) -> np.ndarray:
        """Heel angle and its rate along the reference [rad, rad/s], whatever it does to the ship."""
        truth = build(self.ship, [], list(self.runs))
        truth.roll_gain = 1e-9
        blade = self.blades(Gear())[0]
        state = np.vstack([self.reference, np.zeros((3, len(self.t)))])
        rest = truth.derivative(self.t, state, blade, np.full(len(self.t), self.ship.rpm))[7]
        state[6] = 1.0
        stiffness = rest - truth.derivative(self.t, state, blade, np.full(len(self.t), self.ship.rpm))[7]
        damping = 2 * self.ship.stability["roll_damping_ratio"] * np.sqrt(stiffness)
        found, parts = np.zeros((2, len(self.t))), 20
        angle = rate = 0.0
        for k in range(len(self.t) - 1):
            found[:, k] = angle, rate
            for _ in range(parts):
                rate += (rest[k] - stiffness[k] * angle - damping[k] * rate) / parts
                angle += rate / parts
            angle, rate = (0.0, 0.0) if self.ends[k] else (angle, rate)
        return found

    def blades(self, gear: Gear) -> tuple[np.ndarray, np.ndarray]:
        """Blade angle at the start and at the end of each second.

        Args:
            gear: What is wrong with the steering gear.

        Returns:
            Two rows of angles [rad].
        """
        if gear in self.known_blades:
            return self.known_blades[gear]
        start, end = np.empty(len(self.t)), np.empty(len(self.t))
        for run, (order, shown) in self.rudder.items():
            seconds = np.arange(float(len(shown)))
            known = np.interp(seconds + gear.delay, seconds, shown)
            steering, angles = SteeringGear(gear, self.ship.rate, known[:1]), np.empty(len(shown))
            angles[0] = steering.blade[0]
            for k in range(len(shown) - 1):
                for share in (0.5, 1.0):
                    steering.show((1 - share) * known[k : k + 1] + share * known[k + 1 : k + 2], order[k : k + 1], 0.5)
                angles[k + 1] = steering.blade[0]
            here = np.array([name == run for name in self.runs])
            at = self.t[here].astype(int)
            start[here], end[here] = angles[at], angles[np.minimum(at + 1, len(angles) - 1)]
        self.known_blades[gear] = start, end
        return start, end

    def truth(self, effects: Sequence[ConcealedEffect], **how: Any) -> TruthModel:
        """The truth model with one column a second.

        Args:
            effects: What acts.
            **how: Tables to start from.

        Returns:
            The truth model.
        """
        return build(self.ship, effects, list(self.runs), **how)

    def residuals(self, truth: TruthModel, reference: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """What a truth model leaves unexplained along the reference.

        Args:
            truth: The truth model.
            reference: Another reference.

        Returns:
            State after a second minus the reference then (columns, 6), measured minus shown (columns, 8); 0 where
            nothing was recorded and at the end of a segment.
        """
        ref = self.reference if reference is None else reference
        blade, after = self.blades(truth.gear)
        state = np.vstack([ref, self.heel if truth.roll_gain else np.zeros((2, len(self.t))), self._lagged(truth)])
        n = self._shaft(truth)
        new = runge_kutta(truth, self.t, state, blade, after, n, 1.0)[:6]  # type: ignore[arg-type]
        step = new - np.roll(self.reference, -1, axis=1)
        miss = self.measured - shown(truth, ref, self.t, n)
        return np.where(self.ends, 0.0, step).T, np.nan_to_num(miss).T

    def _lagged(self, truth: TruthModel) -> np.ndarray:
        """Yaw rate behind a lag, run by run."""
        rate = self.reference[5] * self.ship.length / self.ship.speed
        if not truth.lag:
            return np.zeros((1, len(rate)))
        return self._followed(rate, truth.lag)[None]

    def _shaft(self, truth: TruthModel) -> np.ndarray:
        """Shaft speed [rpm] along the reference."""
        if not truth.rpm_slope:
            return np.full(len(self.t), self.ship.rpm)
        return self._followed(truth.shaft_speed(self.reference[3]), SHAFT_LAG)

    def _followed(self, series: np.ndarray, lag: float) -> np.ndarray:
        """First-order lag behind a series, begun anew in each segment."""
        memory, found, first = np.exp(-1 / lag), np.empty_like(series), 0
        for last in np.flatnonzero(self.ends).tolist():
            part = series[first : last + 1]
            mean = 0.5 * (part[1:] + part[:-1])
            rest = lfilter([1 - memory], [1.0, -memory], mean - part[0])
            found[first : last + 1] = np.concatenate([[part[0]], part[0] + rest])
            first = last + 1
        return found


def shown(truth: TruthModel, ref: np.ndarray, t: np.ndarray, n: np.ndarray) -> np.ndarray:
    """What the recorder shows of a state, without noise.

    Args:
        truth: The truth model.
        ref: x, y, psi, u, v, r, one column a second.
        t: Times [s].
        n: Shaft speed [rpm].

    Returns:
        Rows of :data:`CHANNELS`.
    """
    faults, psi = truth.sensors, ref[2]
    position, velocity = antenna(truth, ref.T, t, 0.0)
    log = faults.log_scale * (1 + faults.log_by_heading[0] * np.cos(psi - faults.log_by_heading[1])) * ref[3]
    rate = faults.rate_scale * ref[5] + faults.rate_bias
    late = velocity - LATENCY * change(velocity, t)
    return np.vstack([position - LATENCY * velocity, faults.heading(psi), late, rate, log, n])


def change(rows: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Change of series in a second; none where one segment ends and another begins.

    Args:
        rows: One column a second.
        t: Times [s].

    Returns:
        As many rows.
    """
    apart = np.flatnonzero(np.diff(t) != 1.0)
    slope = np.gradient(rows, axis=1)
    slope[:, apart] = slope[:, apart + 1] = 0.0
    return slope


def read_track(case_dir: Path, split: str = "fit") -> Track:
    """The runs of a case as the observer sees them.

    Args:
        case_dir: Folder of the case.
        split: Which runs.

    Returns:
        The track, with a reference that takes every sensor as it is.
    """
    manifest = read_manifest(case_dir)
    ship, noise = trial_ships()[manifest["ship"]], manifest["nominal_noise_sd"]
    runs, times, ends, measured, rudder = [], [], [], [], {}
    for run in manifest["runs"]:
        if run["split"] != split:
            continue
        table = read_run(case_dir, run, noise)
        rudder[run["run"]] = _rudder(ship, table)
        rows = _measured(table)
        for first, last in _segments(rows):
            runs += [run["run"]] * (last - first)
            times.append(np.arange(float(first), float(last)))
            ends.append(np.arange(first, last) == last - 1)
            measured.append(rows[:, first:last])
    units = [np.radians(1.0) if "deg" in name else 1.0 for name in NOISES]
    sd = np.array([noise[name] * unit for name, unit in zip(NOISES, units, strict=True)])
    every, last_ones = np.hstack(measured), np.concatenate(ends)
    sd = np.array([_noise(row, last_ones, low) for row, low in zip(every, sd, strict=True)])
    bare = Track(ship, tuple(runs), np.concatenate(times), last_ones, np.zeros((6, len(runs))), every, sd, rudder)
    return referred(bare, build(ship, [], []))


def _rudder(ship: TrialShip, table: pd.DataFrame) -> tuple[np.ndarray, np.ndarray]:
    """Orders and angles; the noise of the indicator is taken off where it follows its order."""
    order, angle = (
        np.radians(table[c].interpolate(limit_direction="both").to_numpy()) for c in ("delta_order", "delta")
    )
    gear = SteeringGear(Gear(), ship.rate, angle[:1])
    followed = [angle[0]]
    for k in range(len(angle) - 1):
        gear.advance(order[k : k + 1], 1.0)
        if abs(gear.indicator[0] - angle[k + 1]) > SHOWN:
            gear = SteeringGear(Gear(), ship.rate, angle[k + 1 : k + 2])
        followed.append(gear.indicator[0])
    return order, np.array(followed)


def _measured(table: pd.DataFrame) -> np.ndarray:
    """Rows of :data:`CHANNELS`."""
    course, empty = np.radians(table["cog"]), pd.Series(np.nan, table.index)
    rows = [table["x_north"], table["y_east"], np.radians(table["psi"]), table["sog"] * np.cos(course)]
    rows += [table["sog"] * np.sin(course), np.radians(table["r"]), table["u_log"], table.get("n", empty)]
    return np.stack([np.asarray(row, dtype=float) for row in rows])


def _segments(rows: np.ndarray) -> list[tuple[int, int]]:
    """First second, and the one after the last, of each part without a hole."""
    seen = np.flatnonzero(np.isfinite(rows[:5]).any(axis=0))
    breaks = np.flatnonzero(np.diff(seen) > BRIDGED)
    firsts, lasts = [0, *(breaks + 1)], [*breaks, len(seen) - 1]
    parts = [(int(seen[a]), int(seen[b]) + 1) for a, b in zip(firsts, lasts, strict=True)]
    return [(first, last) for first, last in parts if last - first > 3 * WINDOW]


def _noise(row: np.ndarray, ends: np.ndarray, nominal: float) -> float:
    """Noise of a channel by its third differences, within what the referee draws; more where waves shake it."""
    third = np.diff(row[:: 1 if np.isfinite(row).mean() > 0.7 else 2], 3) / np.sqrt(20.0)
    third = third[np.isfinite(third)]
    if len(third) < 30 * ends.sum():
        return nominal
    usual = np.abs(third) < 6 * np.median(np.abs(third))
    return float(max(0.8 * nominal, np.sqrt(np.mean(third[usual] ** 2))))


def referred(track: Track, truth: TruthModel) -> Track:
    """The track with a reference from the measurements, the faults of the sensors and the current taken off.

    Args:
        track: The track.
        truth: What is held to be wrong.

    Returns:
        The same measurements along another reference.
    """
    faults, reference, first = truth.sensors, np.empty_like(track.reference), 0
    for last in np.flatnonzero(track.ends).tolist():
        part = slice(first, last + 1)
        x, y, psi, north, east, rate = (_smooth(row[part]) for row in track.measured[:6])
        t = track.t[part]
        for _ in range(3):
            psi = _smooth(track.measured[2, part]) - (faults.heading(psi) - psi)
        r = np.gradient(psi) if not np.isfinite(rate).all() else (rate - faults.rate_bias) / faults.rate_scale
        drift = np.array(faults.runaway)[:, None]
        north, east = np.array([north, east]) - np.array(truth.current)[:, None] - 2 * drift * t
        x, y = np.array([x + LATENCY * north, y + LATENCY * east]) - drift * t * t
        forward, across = faults.lever
        cosine, sine = np.cos(psi), np.sin(psi)
        u, v = north * cosine + east * sine + r * across, east * cosine - north * sine - r * forward
        place = [x - forward * cosine + across * sine, y - forward * sine - across * cosine]
        reference[:, part] = [*place, psi, u, v, r]
        first = last + 1
    return replace(track, reference=reference)


def _smooth(row: np.ndarray) -> np.ndarray:
    """A channel without gaps, smoothed; NaN if it was not recorded."""
    known = np.isfinite(row)
    if not known.any():
        return np.full(len(row), np.nan)
    full = np.interp(np.arange(len(row)), np.flatnonzero(known), row[known])
    return savgol_filter(full, WINDOW, 2)
