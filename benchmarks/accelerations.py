"""Accelerations out of noisy channels: the methods of ``data.accelerations`` side by side.

    RECORDINGS=FOLDER OMP_NUM_THREADS=1 python benchmarks/accelerations.py [seeds=8]

The Mariner's zz35 with white noise of .5 % of the standard deviation on u, v, r, psi and .5 m on x, y; in the third set
r is late by 2 s. RMS error of udot, vdot, rdot over the standard deviation of the true ones; for ``joint`` also what
u, v, r, udot, vdot, rdot are wrong by over what it states (1 is right). Where ``RECORDINGS`` is set: the part of the
KVLCC2's measured accelerations (HSVA, 20/5 zigzag, 20 Hz) that no cubic polynomial of u, v, r and the rudder explains.
Medians over the seeds.
"""

import os
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import combinations_with_replacement
from pathlib import Path

import numpy as np
import yaml
from jaxtyping import Float
from scipy.signal import savgol_filter

from manoeuvre_nn.core.channels import ACCELERATION
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.simulate import simulate
from manoeuvre_nn.estimation.accelerations import accelerations
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.recording.local_cubics import smoothed
from manoeuvre_nn.recording.noise import add_noise
from manoeuvre_nn.recording.read.mapping import mapping
from manoeuvre_nn.recording.read.reader import read_recording
from manoeuvre_nn.ship.kvlcc2 import kvlcc2_hsva
from manoeuvre_nn.ship.mariner import mariner

SHIP = mariner()
LATE = 2.0
"""Delay of r in the third set [s]."""
STATED = ("u", "v", "r", *ACCELERATION)
Method = Callable[[Recording], Recording]


def spline(recording: Recording) -> Recording:
    """Cross-validated cubic splines.

    Args:
        recording: What was recorded.

    Returns:
        With accelerations.
    """
    pairs = {k: smoothed(recording.time, recording[k], None) for k in ("u", "v", "r")}
    return recording.with_channels(**{f"{k}dot": slope for k, (_, slope) in pairs.items()})


def parabolas(recording: Recording) -> Recording:
    """Local parabolas over .4 L/U0.

    Args:
        recording: What was recorded, at even times.

    Returns:
        With accelerations.
    """
    step = float(np.median(np.diff(recording.time)))
    count = max(2 * round(0.2 * recording.meta["time_unit"] / step) + 1, 5)
    slopes = {f"{k}dot": savgol_filter(recording[k], count, 2, deriv=1, delta=step) for k in ("u", "v", "r")}
    return recording.with_channels(**slopes)


METHODS: dict[str, Method] = {
    "central differences": lambda r: accelerations(r, "central"),
    "local cubics, .8 L/U0": lambda r: accelerations(r, "smoother"),
    "local parabolas, .4 L/U0": parabolas,
    "spline, cross-validated": spline,
    "joint": lambda r: accelerations(r, "joint"),
    "joint, delay of r": lambda r: accelerations(r, "joint", delays=["r"]),
}


def recorded(truth: Recording, seed: int, late: float) -> Recording:
    """What sensors wrote.

    Args:
        truth: What happened.
        seed: Of the noise.
        late: Delay of r [s].

    Returns:
        The recording.
    """
    sd = {k: 0.005 * float(truth[k].std()) for k in ("u", "v", "r", "psi")}
    noisy = add_noise(truth, {**sd, "x": 0.5, "y": 0.5}, seed)
    return noisy.with_channels(r=np.interp(truth.time - late, truth.time, noisy["r"])) if late else noisy


def errors(found: Recording, truth: Recording) -> list[float]:
    """How wrong accelerations are.

    Args:
        found: With accelerations.
        truth: What happened.

    Returns:
        RMS error over standard deviation of udot, vdot, rdot [-].
    """
    return [float(np.sqrt(np.mean((found[k] - truth[k]) ** 2)) / truth[k].std()) for k in ACCELERATION]


def pulls(found: Recording, truth: Recording) -> list[float]:
    """Whether stated errors are right.

    Args:
        found: With standard deviations.
        truth: What happened.

    Returns:
        RMS of error over stated error of :data:`STATED` [-].
    """
    return [float(np.sqrt(np.mean(((found[k] - truth[k]) / found[f"{k}_sd"]) ** 2))) for k in STATED]


def unexplained(found: Recording) -> list[float]:
    """Part of the accelerations that no cubic polynomial of u, v, r and the rudder explains.

    Args:
        found: With accelerations.

    Returns:
        Standard deviation of the rest over that of all, udot, vdot, rdot [-].
    """
    x = found.stacked("u", "v", "r", "delta")
    x = x / x.std(0)
    powers = [c for degree in range(4) for c in combinations_with_replacement(range(4), degree)]
    columns: Float[np.ndarray, "n p"] = np.stack([x[:, list(c)].prod(1) for c in powers], axis=1)
    y = found.stacked(*ACCELERATION)
    rest = y - columns @ np.linalg.lstsq(columns, y, rcond=None)[0]
    return [float(part) for part in rest.std(0) / y.std(0)]


def measured() -> Recording | None:
    """The KVLCC2's 20/5 zigzag, if it is there."""
    root = os.environ.get("RECORDINGS")
    if not root:
        return None
    conf = Path(__file__).parents[1] / "conf" / "recording" / "kvlcc2_hsva.yaml"
    settings = yaml.safe_load(conf.read_text())
    path = Path(root) / "kvlcc2-hsva-cpmc" / "Z_20_05.csv"
    return read_recording(path, mapping(**settings), kvlcc2_hsva())


def cell(rows: list[list[float]]) -> str:
    """Medians over the seeds.

    Args:
        rows: A row a seed.

    Returns:
        Three digits each.
    """
    return " ".join(f"{value:.3f}" for value in np.median(rows, axis=0))


def main(arguments: list[str]) -> None:
    """Measure and print.

    Args:
        arguments: See the module.
    """
    seeds = range(int(dict(a.partition("=")[::2] for a in arguments).get("seeds", "8")))
    truths = {}
    for hz in (1, 10):
        truths[hz] = simulate(CalmWater(SHIP), replace(zigzag(35.0), duration=360.0), interval=1 / hz)
    file = measured()
    print("| | zz35, 1 Hz | zz35, 10 Hz | 1 Hz, r 2 s late | measured | s at 10 Hz |\n|---|---|---|---|---|---|")
    told = []
    for name, method in METHODS.items():
        cells, seconds = [], {}
        for hz, late in ((1, 0.0), (10, 0.0), (1, LATE)):
            truth, runs = truths[hz], [recorded(truths[hz], seed, late) for seed in seeds]
            began = time.process_time()
            found = [method(run) for run in runs]
            seconds[hz] = (time.process_time() - began) / len(runs)
            cells.append(cell([errors(f, truth) for f in found]))
            if name.startswith("joint"):
                stated = cell([pulls(f, truth) for f in found])
                told.append(f"{name}, {hz} Hz{', r late' if late else ''}: {stated}")
        cells.append(cell([unexplained(method(file))]) if file else "")
        print(f"| {name} | {' | '.join(cells)} | {seconds[10]:.2f} |", flush=True)
    print("\nError over stated error of u, v, r, udot, vdot, rdot:", *told, sep="\n")


if __name__ == "__main__":
    main(sys.argv[1:])
