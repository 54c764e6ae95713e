"""What a diagnosis says of runs in a pond whose recorded wind is hidden from it: the table of docs/real_data.md.

    RECORDINGS=FOLDER python benchmarks/pond_wind.py [sets=1,2,3,4] [workers=2]

FOLDER holds ``esso-osaka-frt``. For each set a model is fitted to other runs, with their wind, and asked about runs of
which it is not told that a wind blew. Minutes a set.
"""

import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import yaml

import manoeuvre_nn as mnn
from manoeuvre_nn.commands.config import load_yaml
from manoeuvre_nn.commands.groups import options
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.diagnosis.result import Diagnosis
from manoeuvre_nn.ship.esso_osaka_model import esso_osaka_model

SHIP = esso_osaka_model()
DELAY = 0.9
"""By how much u, v, r and psi were written down late [s]: ``manoeuvre check`` finds .93 +- .01 s."""
ZIGZAGS = [f"zigzag/zigzag_31-Jul-2020_{t}" for t in ("13_04_24", "13_29_19", "13_42_53")]
OTHER_ZIGZAGS = [f"zigzag/zigzag_31-Jul-2020_{t}" for t in ("13_14_21", "13_22_52", "13_57_45", "14_03_39")]
SEPTEMBER = [f"turning/turn_14-Sep-2020_{t}" for t in ("13_51_45", "14_50_41", "15_58_08", "13_39_32")]
SEPTEMBER += ["turning/turn_cut_14-Sep-2020_16_09_02"]
OCTOBER = [f"turning/turn_14-Oct-2020_{t}" for t in ("14_08_51", "14_17_39", "14_29_49", "14_56_07", "15_21_57")]


@dataclass(frozen=True)
class RunSet:
    """Files that are asked about together, and those of the model that is asked.

    Attributes:
        words: What they are.
        fitted: From which the effect is found.
        held_out: On which it is proved.
        learnt: From which the model is identified.
    """

    words: str
    fitted: Sequence[str]
    held_out: Sequence[str]
    learnt: Sequence[str]


SETS = {
    1: RunSet("three turns, 14 October", OCTOBER[:3], OCTOBER[3:], [*SEPTEMBER, *ZIGZAGS]),
    2: RunSet("three zigzags, 31 July", OTHER_ZIGZAGS[:3], OTHER_ZIGZAGS[3:], [*SEPTEMBER, *ZIGZAGS]),
    3: RunSet("three turns, 14 September", SEPTEMBER[:3], SEPTEMBER[3:], [*OCTOBER, *ZIGZAGS, *OTHER_ZIGZAGS]),
    4: RunSet("two zigzags, 31 July", ZIGZAGS[:2], ZIGZAGS[2:], [*SEPTEMBER, *OCTOBER, *OTHER_ZIGZAGS]),
}


def mean_wind(run: Recording) -> tuple[float, float]:
    """The recorded wind of a run, its mean as a vector: speed [m/s] and where it comes from [deg]."""
    north, east = (float(np.mean(run["wind_speed"] * part(run["wind_from"]))) for part in (np.cos, np.sin))
    return float(np.hypot(north, east)), float(np.arctan2(east, north) / DEGREE % 360)


def asked(runs: RunSet, folder: Path, mended: str, hidden: str, workers: int) -> Diagnosis:
    """What is said of runs by a model that was fitted to others."""

    def read(names: Sequence[str], mapping: str) -> Sequence[Recording]:
        return mnn.read([folder / f"{name}.csv" for name in names], mapping, SHIP)

    model = mnn.fit(SHIP, read(runs.learnt, mended), network="cubic")
    held_out = [Path(name).stem for name in runs.held_out]
    told = read([*runs.fitted, *runs.held_out], hidden)
    answer = mnn.diagnose(SHIP, told, model=model, held_out=held_out, workers=workers)
    for what, names in (("fitted", runs.fitted), ("held out", runs.held_out)):
        winds = [mean_wind(run) for run in read(names, mended)]
        print(f"recorded, {what}: " + ", ".join(f"{speed:.2f} m/s from {origin:.0f} deg" for speed, origin in winds))
    return answer.diagnosis


def show(found: Diagnosis) -> None:
    """The answer, its leading candidates, and what held-out runs say of it."""
    print(f"{found.sentence}\n{found.seconds:.0f} s")
    for cause in found.causes[:3]:
        values = ", ".join(f"{v.name} {v.value:.3g} +- {v.error:.2g} {v.unit}" for v in cause.parameters)
        print(f"  {cause.name}: probability {cause.probability:.3f}, log evidence {cause.evidence:.0f}; {values}")
    told = [*(f"{check.name}: {check.text}" for check in found.checks), *found.runner_up]
    print(*(f"  {line}" for line in told), sep="\n")
    if found.proofs:
        before, after = (found.rmse(when)["pos"] for when in ("before", "after"))
        print(f"  held-out track: {before:.2f} m, then {after:.2f} m")


def main(words: Sequence[str]) -> None:
    """Do the sets that are asked for, and print each as it is done."""
    given = {"sets": "1,2,3,4", "workers": "2"} | dict(word.split("=", 1) for word in words)
    folder = Path(os.environ["RECORDINGS"]) / "esso-osaka-frt"
    settings = load_yaml(options("recording")["esso_osaka"])
    for channel in ("u", "v", "r", "psi"):
        settings["channels"][channel]["delay"] = DELAY
    without = {k: v for k, v in settings["channels"].items() if not k.startswith("wind")}
    with TemporaryDirectory() as scratch:
        mended, hidden = (str(Path(scratch) / f"{name}.yaml") for name in ("mended", "hidden"))
        for path, channels in ((mended, settings["channels"]), (hidden, without)):
            Path(path).write_text(yaml.safe_dump({**settings, "channels": channels}, sort_keys=False))
        for runs in (SETS[int(number)] for number in given["sets"].split(",")):
            print(f"\n{runs.words}", flush=True)
            show(asked(runs, folder, mended, hidden, int(given["workers"])))


if __name__ == "__main__":
    main(sys.argv[1:])
