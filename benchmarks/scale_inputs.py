"""Large recordings: hours of the Mariner under a helmsman, noise of its sensors, as this package writes them.

One hour is simulated: rudder orders of half a minute to two, then the rudder amidships until the ship moves as when the
hour began. Longer voyages are that hour again and again, each going on from where and which way the last one ended: a
solution of the same equations, for calm water knows no place and no direction. Noise is drawn for the whole.
"""

from functools import cache
from pathlib import Path

import numpy as np
import pyarrow as pa
from pyarrow import csv
from scipy.interpolate import CubicSpline

from manoeuvre_nn.core.channels import UNITS
from manoeuvre_nn.core.manoeuvre import Manoeuvre, Stage
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.simulate import simulate
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.ship.mariner import mariner_corrected

HOUR, STEERED, SETTLED = 3600, 2400.0, 1200.0
NOISE = {"x": 1.0, "y": 1.0, "u": 0.05, "v": 0.05, "r": 5e-4, "psi": 2e-3, "delta": 1e-3}
"""Standard deviations of the sensors [SI and radians]."""
AT_ONCE = 1_000_000
"""Rows that are written at once."""


@cache
def hour() -> Recording:
    """The hour, a sample a second, without noise."""
    random = np.random.default_rng(3)
    stages, time = [Stage(0.0, hold=SETTLED)], 0.0
    while time < STEERED - 120.0:
        held = float(random.uniform(30.0, 120.0))
        stages.append(Stage(float(random.uniform(-20.0, 20.0)) * DEGREE, hold=held))
        time += held
    trial = Manoeuvre("hour", "random_rudder", (*stages, Stage(0.0)), duration=SETTLED + HOUR)
    run = simulate(Vessel(CalmWater(mariner_corrected()), ()), trial, interval=1.0).between(SETTLED, SETTLED + HOUR)
    turn = np.exp(-1j * run["psi"][0])
    place = (run["x"] - run["x"][0] + 1j * (run["y"] - run["y"][0])) * turn
    moved = run.with_channels(x=place.real, y=place.imag, psi=run["psi"] - run["psi"][0])
    return Recording("hour", moved.time - SETTLED, moved.channels)


def part(start: int, end: int, rate_hz: float = 1.0) -> dict[str, np.ndarray]:
    """Channels with noise of the samples from one number to another of a voyage of any length."""
    once, number = hour(), np.arange(start, end)
    since, round_ = np.mod(number / rate_hz, HOUR), (number / rate_hz // HOUR).astype(int)
    smooth = {name: CubicSpline(once.time, once[name])(since) for name in ("u", "v", "r", "x", "y", "psi")}
    smooth["delta"] = np.interp(since, once.time, once["delta"])
    turn, way = once["psi"][-1], once["x"][-1] + 1j * once["y"][-1]
    begun = np.concatenate([[0.0], np.cumsum(way * np.exp(1j * turn * np.arange(round_.max() + 1)))])[round_]
    place = begun + (smooth["x"] + 1j * smooth["y"]) * np.exp(1j * turn * round_)
    exact = {**smooth, "x": place.real, "y": place.imag, "psi": smooth["psi"] + turn * round_}
    noise = np.random.default_rng([7, start])
    sensed = {name: exact[name] + sd * noise.standard_normal(len(number)) for name, sd in NOISE.items()}
    return {"t": number / rate_hz, **{name: np.round(values, 6) for name, values in sensed.items()}}


def write_voyage(path: Path, samples: int, rate_hz: float = 1.0) -> Path:
    """Write a voyage of so many samples as a csv; the path."""
    with path.open("wb") as file:
        for start in range(0, samples, AT_ONCE):
            columns = part(start, min(start + AT_ONCE, samples), rate_hz)
            table = pa.table({f"{name} [{UNITS[name]}]": values for name, values in columns.items()})
            csv.write_csv(table, file, csv.WriteOptions(include_header=start == 0))
    return path


def write_case(path: Path) -> Path:
    """Write 150 s of the hour, in the columns and units of a concealed case; the path."""
    columns = part(0, 151)
    named = {"t": columns["t"], "x_north": columns["x"], "y_east": columns["y"], "u": columns["u"], "v": columns["v"]}
    named |= {"psi": columns["psi"] / DEGREE, "r": columns["r"] / DEGREE, "delta": columns["delta"] / DEGREE}
    csv.write_csv(pa.table(named), path, csv.WriteOptions(quoting_style="none"))
    return path
