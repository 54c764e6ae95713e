"""Identification in noise: the Mariner's zz35 at 1 Hz with noise on u, v, r, psi and a receiver's on x, y.

    OMP_NUM_THREADS=1 python benchmarks/noise.py [seeds=8] [methods=abkowitz,...] [shares=0.005,0.02] [gps=0.5]
        [floor=1.0] [late=0]

Noise of u, v, r, psi is white, a share of the standard deviation of each channel. Judged by dev/L of zz20, tc25, tc10,
which were not trained on: median and largest over the seeds. In closed loop: ``fit=closed_loop`` with each series as it
is by default. Pointwise: a Taylor series on smoothed accelerations, as the score table of train.py has it;
``pointwise_joint``: all channels smoothed at once (``data.accelerations=joint``). ``late``: delay of r [s], which the
closed loop and the joint smoother then estimate.
"""

import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import yaml

from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.dynamics.base import Model
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.dynamics.simulate import simulate
from manoeuvre_nn.estimation.accelerations import accelerations
from manoeuvre_nn.estimation.baselines import taylor_baseline
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.network.series import Series, SeriesSettings
from manoeuvre_nn.recording.noise import add_noise
from manoeuvre_nn.recording.tuples import to_tuples
from manoeuvre_nn.scoring.score import score
from manoeuvre_nn.ship.known import clarke_inertia_part, clarke_part
from manoeuvre_nn.ship.mariner import mariner
from manoeuvre_nn.training.closed_loop_fit import DEFAULT_SETTINGS, fit_series

SHIP = mariner()
JUDGED = (zigzag(20.0), turning_circle(25.0), turning_circle(10.0))
METHODS = ("abkowitz", "cubic", "modulus", "pointwise", "pointwise_joint")


def recorded(truth: Recording, share: float, gps: float, seed: int, late: float = 0.0) -> Recording:
    """What sensors wrote.

    Args:
        truth: What happened.
        share: Noise of u, v, r, psi over their standard deviations [-].
        gps: Noise of x and y [m].
        seed: Of the noise.
        late: Delay of r [s].

    Returns:
        The recording.
    """
    sd = {k: share * float(truth[k].std()) for k in ("u", "v", "r", "psi")}
    noisy = add_noise(truth, {**sd, "x": gps, "y": gps}, seed)
    return noisy.with_channels(r=np.interp(truth.time - late, truth.time, noisy["r"]))


def model_of(method: str, recording: Recording, floor: float, delays: Sequence[str] = ()) -> Model:
    """Fit a model.

    Args:
        method: One of :data:`METHODS`.
        recording: What is learnt from.
        floor: Factor on the least noise of the closed-loop fit, ``fit.floor`` [-].
        delays: Channels whose delay is estimated, where the method can.

    Returns:
        The model.
    """
    if method.startswith("pointwise"):
        known = clarke_part(SHIP)
        joint = method == "pointwise_joint"
        smooth = accelerations(recording, "joint", delays=delays) if joint else accelerations(recording, "smoother")
        return taylor_baseline(known, to_tuples([smooth], known)).dynamics
    conf = Path(__file__).parents[1] / "conf" / "network" / f"{method}.yaml"
    given = yaml.safe_load(conf.read_text())["network"]
    network = Series(SeriesSettings(given["surge"], given["lateral"], yaw=given.get("yaw", ())))
    settings = replace(DEFAULT_SETTINGS, floor=tuple(floor * f for f in DEFAULT_SETTINGS.floor), delays=delays)
    return fit_series(network, clarke_inertia_part(SHIP), [recording], settings=settings)[0]


def main(arguments: list[str]) -> None:
    """Run all and print the table.

    Args:
        arguments: See the module.
    """
    usual = {
        "seeds": "8",
        "methods": ",".join(METHODS),
        "shares": "0.005,0.02",
        "gps": "0.5",
        "floor": "1",
        "late": "0",
    }
    given = usual | dict(a.partition("=")[::2] for a in arguments)
    gps, floor, late = (float(given[k]) for k in ("gps", "floor", "late"))
    truth = simulate(CalmWater(SHIP), replace(zigzag(35.0), duration=360.0))
    references = roll_out(CalmWater(SHIP), JUDGED)
    print("| noise | method | zz20 | tc25 | tc10 | CPU s |\n|---|---|---|---|---|---|")
    for share in map(float, given["shares"].split(",")):
        for method in given["methods"].split(","):
            began, rows = time.process_time(), []
            for seed in range(int(given["seeds"])):
                recording = recorded(truth, share, gps, seed, late)
                model = model_of(method, recording, floor, ["r"] if late else [])
                runs = roll_out(model, JUDGED)
                rows.append([score(a, b, SHIP.particulars.length).dev_L for a, b in zip(runs, references, strict=True)])
            spent = (time.process_time() - began) / len(rows)
            middle, worst = np.median(rows, axis=0), np.max(rows, axis=0)
            cells = " | ".join(f"{m:.3f} ({w:.2f})" for m, w in zip(middle, worst, strict=True))
            print(f"| {100 * share:g} % | {method} | {cells} | {spent:.1f} |", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
