"""Recordings whose channels contradict each other or the ship: the checks report them, or the file is refused.

Every fault is one that kinematics or the ship's size can tell in the run that it is planted in: a zigzag or a turning
circle with all channels, or with heading, rudder and positions alone.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml
from robustness_oracle import SHIPS, Said, Tried, sailed

from manoeuvre_nn.commands.config import read_mapping
from manoeuvre_nn.diagnosis.case import RunSettings, read_runs
from manoeuvre_nn.recording.check.checks import check_recording
from manoeuvre_nn.recording.check.inspection import inspect_file
from manoeuvre_nn.recording.noise import add_noise
from manoeuvre_nn.recording.read.reader import read_recording
from manoeuvre_nn.ship.esso_190k import esso_190k
from manoeuvre_nn.ship.mariner import mariner

DEG, FOOT = np.pi / 180, 0.3048
UNITS = {"u": "m/s", "v": "m/s", "r": "deg/s", "x": "m", "y": "m", "psi": "deg", "delta": "deg"}
SETS = {"all": tuple(UNITS), "track": ("x", "y", "psi", "delta")}
HULLS = {"mariner": mariner, "esso_190k": esso_190k}
"""Ships that a diagnosis is asked about."""

Table = pd.DataFrame
Fault = Callable[[Table, np.random.Generator], Table]


def times(factor: float, *names: str) -> Fault:
    """Columns in another unit, or with the other sign."""
    return lambda t, rng: t.assign(**{k: t[k] * factor for k in names})


def shuffled(*names: str) -> Fault:
    """Columns whose samples come in any order."""
    return lambda t, rng: t.assign(**{k: rng.permutation(t[k].to_numpy()) for k in names})


def constant(name: str) -> Fault:
    """A column that never moves."""
    return lambda t, rng: t.assign(**{name: t[name].iloc[int(rng.integers(len(t)))]})


def exchanged(one: str, other: str) -> Fault:
    """Two columns in each other's place."""
    return lambda t, rng: t.assign(**{one: t[other], other: t[one]})


def plus(name: str, more: float) -> Fault:
    """A column that is off."""
    return lambda t, rng: t.assign(**{name: t[name] + more})


def late(seconds: float, *names: str) -> Fault:
    """Columns that come too late."""
    return lambda t, rng: t.assign(**{k: np.interp(t.t - seconds, t.t, t[k]) for k in names})


def spiked(name: str, size: float) -> Fault:
    """A few samples that are far off, none near another: of several together no check says that they are outliers."""
    return lambda t, rng: t.assign(**{name: t[name] + size * np.isin(t.index, 8 * rng.integers(3, len(t) // 8 - 3, 3))})


ALL: dict[str, tuple[Fault, tuple[str, ...]]] = {
    "psi in rad": (times(DEG, "psi"), ("psi",)),
    "delta in rad": (times(DEG, "delta"), ("delta",)),
    "delta in thousandths": (times(1000 * DEG, "delta"), ("delta",)),
    "r in rad/s": (times(DEG, "r"), ("r",)),
    "r in deg/min": (times(60, "r"), ("r",)),
    "u, v in kn": (times(3600 / 1852, "u", "v"), ("u", "x")),
    "u, v in km/h": (times(3.6, "u", "v"), ("u", "x")),
    "u, v in kn, said twice": (times(1852 / 3600, "u", "v"), ("u", "x")),
    "x, y in ft": (times(1 / FOOT, "x", "y"), ("x",)),
    "time in ms": (times(1000, "t"), ("time", "sample every")),
    "r to port": (times(-1, "r"), ("r", "psi")),
    "psi to port": (times(-1, "psi"), ("psi", "r")),
    "v to port": (times(-1, "v"), ("v",)),
    "u astern": (times(-1, "u"), ("u",)),
    "x south": (times(-1, "x"), ("x",)),
    "y west": (times(-1, "y"), ("y",)),
    "delta to port": (times(-1, "delta"), ("rudder",)),
    "x and y exchanged": (exchanged("x", "y"), ("x",)),
    "u and v exchanged": (exchanged("u", "v"), ("u",)),
    "psi off": (plus("psi", 40), ("psi",)),
    "psi out of order": (shuffled("psi"), ("psi",)),
    "x out of order": (shuffled("x"), ("x",)),
    "y out of order": (shuffled("y"), ("y",)),
    "r out of order": (shuffled("r"), ("r",)),
    "v out of order": (shuffled("v"), ("v",)),
    "psi constant": (constant("psi"), ("psi",)),
    "x constant": (constant("x"), ("x",)),
    "y constant": (constant("y"), ("y",)),
    "r constant": (constant("r"), ("r",)),
    "v constant": (constant("v"), ("v",)),
    "r spiked": (spiked("r", 8), ("r",)),
    "psi spiked": (spiked("psi", 60), ("psi",)),
}
"""Fault -> how it is planted where all channels are there, and words of which a finding holds one."""
OF_TRACK = (
    "delta in rad", "delta in thousandths", "time in ms", "delta to port", "psi out of order", "x out of order",
    "y out of order", "psi constant", "x constant", "y constant", "psi spiked", "x and y exchanged", "y west",
    "x south", "psi to port",
)  # fmt: skip
TRACK = {k: ALL[k] for k in OF_TRACK} | {"x, y in km": (times(0.001, "x", "y"), ("speed", "u"))}
"""The same where there are positions, heading and rudder."""
OF_DIAGNOSIS = ("psi in rad", "psi out of order", "psi constant", "x out of order", "y out of order", "x constant",
                "y constant", "r to port", "r in rad/s", "delta to port", "x and y exchanged")  # fmt: skip
"""Faults that a diagnosis has to see too; others it may weigh against effects."""


def attack(rng: np.random.Generator, folder: Path) -> Tried:
    """One fault, none, or one column for two channels."""
    ship = str(rng.choice(SHIPS))
    kind = str(rng.choice(["all", "track"]))
    run = sailed(ship)[int(rng.integers(2))]
    noise = float(rng.choice([0.0, 0.3, 1.0]))
    table = _written(run, SETS[kind], noise * sailed(ship).ship.length / 160, rng)
    said = _said(SETS[kind])
    faults = ALL if kind == "all" else TRACK
    fault = str(rng.choice([*faults, "none", "none", "none", "two of one"]))
    name = f"{ship} {run.name} {kind} noise {noise:g}: {fault}"
    if fault == "two of one":
        one, other = rng.choice(SETS[kind], 2, replace=False)
        said["channels"][one] = dict(said["channels"][other])
        _put(folder, table, said)
        return Tried(name, partial(_checked, folder, ship, ()), "refuse", (str(one), str(other)))
    if fault == "delta to port" and run.meta["kind"] != "zigzag":
        fault = "none"  # one movement of the rudder tells little beside noise
    if fault == "v out of order" and noise == 1.0:
        fault = "none"  # noise of the size of the sway itself has no order either
    spoilt = table if fault == "none" else faults[fault][0](table, rng)
    _put(folder, spoilt, said)
    if ship in HULLS and fault in OF_DIAGNOSIS and rng.random() < 0.3:
        return Tried(f"{name}, diagnosed", partial(_diagnosed, folder, ship), "refuse", faults[fault][1])
    words = () if fault == "none" else faults[fault][1]
    return Tried(name, partial(_checked, folder, ship, words), "read" if fault == "none" else "either")


def _written(run: Any, names: tuple[str, ...], size: float, rng: np.random.Generator) -> Table:
    """Columns with the noise of sensors, of a ship of 160 m one metre and a tenth of a degree where it is 1."""
    sd = {"u": 0.05, "v": 0.05, "r": 0.02 * DEG, "x": 1.0, "y": 1.0, "psi": 0.1 * DEG, "delta": 0.05 * DEG}
    noisy = add_noise(run, {k: v * size for k, v in sd.items() if k in names}, int(rng.integers(1 << 30)))
    return Table({"t": run.time, **{k: noisy[k] / (DEG if "deg" in UNITS[k] else 1.0) for k in names}})


def _said(names: tuple[str, ...]) -> Said:
    """The mapping that holds for a table without a fault."""
    columns = {k: {"column": k, "unit": UNITS[k]} for k in names}
    return {"time": {"column": "t", "unit": "s"}, "channels": columns, "rudder_positive_to": "starboard"}


def _put(folder: Path, table: Table, said: Said) -> None:
    """Table and mapping, written."""
    (folder / "runs").mkdir()
    table.to_csv(folder / "runs" / "run.csv", index=False)
    (folder / "mapping.yaml").write_text(yaml.safe_dump(said))


def _checked(folder: Path, ship: str, words: tuple[str, ...]) -> str:
    """Look at a file as ``manoeuvre check`` and ``manoeuvre train`` do; what they should have said, or should not."""
    mapping, particulars = read_mapping(str(folder / "mapping.yaml")), sailed(ship).ship
    found = inspect_file(folder / "runs" / "run.csv", mapping, particulars)
    tripped = [f"{f} {f.channels} {f.changes}" for f in found.findings if f.trips]
    if words:
        return "" if any(word in said for said in tripped for word in words) else f"not told; but {tripped}"
    if tripped:
        return f"a false alarm: {tripped}"
    check_recording(read_recording(folder / "runs" / "run.csv", mapping, particulars), particulars)
    return ""


def _diagnosed(folder: Path, ship: str) -> str:
    """Read a file as ``manoeuvre diagnose`` does."""
    read_runs(folder / "runs", HULLS[ship](), RunSettings(mapping=read_mapping(str(folder / "mapping.yaml"))))
    return ""
