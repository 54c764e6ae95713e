"""Workbooks, logs of NMEA 0183, bags, MCAP and MAT 7.3, whole and damaged: ``import`` reads each or says a line."""

import importlib.util
from functools import partial
from pathlib import Path
from types import ModuleType

import numpy as np
from robustness_oracle import Tried, sailed
from robustness_recordings import CHANGES

from manoeuvre_nn.recording.propose.proposal import propose

LOGS = Path(__file__).parents[1] / "tests" / "recording" / "logs.py"
"""Writes such files for the tests, too."""
FILES = ("run.xlsx", "run.nmea", "run.bag", "run_mcap", "run.mat")
DAMAGE = ("as it is", "bytes", "bytes", "cut", "garbage inside")


def damaged(rng: np.random.Generator, folder: Path) -> Tried:
    """One such file; a whole one must be read, of a damaged one anything but a traceback may come."""
    path, how = folder / str(rng.choice(FILES)), str(rng.choice(DAMAGE))
    _write(_logs(), path)
    hit = next(path.glob("*.mcap")) if path.is_dir() else path
    if how != "as it is":
        hit.write_bytes(CHANGES[how](rng, hit.read_bytes()))
    names = (path.name, hit.name)
    return Tried(f"{path.name} {how}", partial(_proposes, path), "read" if how == "as it is" else "either", names)


def _logs() -> ModuleType:
    """The module that writes them."""
    spec = importlib.util.spec_from_file_location("logs", LOGS)
    assert spec is not None and spec.loader is not None
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    return made


def _write(logs: ModuleType, path: Path) -> None:
    """A zigzag of the Mariner."""
    run = sailed("mariner")[0]
    if path.suffix == ".xlsx":
        logs.placed(run).to_excel(path, index=False)
    elif path.suffix == ".nmea":
        logs.write_nmea(path, run)
    elif path.suffix == ".mat":
        logs.write_mat73(path, {"t": run.time, **{k: run[k] for k in ("u", "v", "r", "x", "y", "psi", "delta")}})
    else:
        logs.write_bag(path, run)


def _proposes(path: Path) -> str:
    """Nothing is wrong with a proposal: a byte that changed a number cannot be told from a measurement."""
    propose(path)
    return ""
