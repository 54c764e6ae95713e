"""Make the sample recordings that come with the package again: ``python scripts/sample_recordings.py [FOLDER]``.

A Mariner sails four trials in a disturbance that nothing in the files tells. Who wants to find it with
``manoeuvre diagnose recordings=sample`` had better not read on.
"""

import sys
from pathlib import Path

import numpy as np

import manoeuvre_nn as mnn
from manoeuvre_nn.commands.simulate import as_sensed
from manoeuvre_nn.core.recording import Recording

FOLDER = Path(__file__).parents[1] / "src" / "manoeuvre_nn" / "recording" / "sample"
SHIP = "mariner_corrected"
TRIALS = ("zz20", "tc25", "zz10", "tc20_port")
CONCEALED = {"wind_steady": {"speed": 13, "from_deg": 215}}
NOISE = {"x": 1.0, "y": 1.0, "u": 0.05, "v": 0.05, "psi_deg": 0.1, "r_deg_s": 0.01}
"""Standard deviations of what the sensors add; u, v [m/s], x, y [m]."""
SEED = 2026
DIGITS = {"x": 2, "y": 2, "vn": 3, "ve": 3, "u_log": 2}
"""Decimals that an instrument shows; 6 of the others."""


def sample(trial: str) -> Recording:
    """What is recorded of a trial, with the digits of instruments."""
    seed = SEED + TRIALS.index(trial)
    run = as_sensed(mnn.simulate(SHIP, trial, CONCEALED, NOISE, seed=seed)[0])
    return run.with_channels(**{name: np.round(run[name], DIGITS.get(name, 6)) for name in run.channels})


if __name__ == "__main__":
    where = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER
    for trial in TRIALS:
        sample(trial).to_csv(where / f"{trial}.csv")
