"""Small commands that do what they should, made in a process of their own: attacks spoil them, or their disk.

Figures are made and not drawn: a picture of their size stands for each.
"""

import atexit
import importlib
import json
import os
import resource
import runpy
import shutil
import sys
import tempfile
from collections.abc import Callable, Sequence
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch
from matplotlib.figure import Figure
from PIL import Image
from robustness_attack import Ended, in_child

from manoeuvre_nn.commands import main

torch.set_num_threads(1)  # before anything is forked
for module in (*(task.partition(".")[0] for task in main.TASKS.values()), "import_recording"):
    importlib.import_module(f"manoeuvre_nn.commands.{module}")  # once, not in every process

ROOT = Path(__file__).resolve().parents[1]
HELD_OUT = "score=[{tc25: {duration: 60}}]"
SHORT = ("data.length=60", HELD_OUT, "scoring.solver=rollout", "trainer.progress=false")
LM = ("network=wang", "network.hidden=3", "fit.iterations_per_epoch=2", "trainer.max_epochs=2", "scoring.every=2")
LM += SHORT
ENSEMBLE = ("network.members=2", "network.hidden=4", "fit.epochs=3", "scoring.every=1", *SHORT)
SERIES = ("network=modulus", "network.surge=[u u,n n]", "network.lateral=[u v,u r,d n n]", "network.members=2")
SERIES += ("data.length=150", *SHORT[1:], "trainer.max_epochs=2", "scoring.every=2")
RECURSIVE = ("ship=container_twin", "network=recursive", "network.hidden=[6]", "fit.iterations_per_epoch=2")
RECURSIVE += ("fit.stages=[{steps: 3, updates: 4, rows: 6}]", "scoring.every=1", *SHORT)
PITCH = ("task=pitch", "data.method=closed_form", "data.between=10", "inputs.d.values=[7,9]", "inputs.V.values=[0,10]")
PITCH += ("inputs.beta.values=[0,60,120,180]", "inputs.Hs.values=[2,4]", "inputs.T.values=[8,10,12]")
TRIAL = ("cases=1", "seed=3", "sort=clean", "jobs=1", "tool=candidates=[current]")
EXCITE = ("network.members=3", "network.hidden=3", "fit.epochs=3", "data.length=60", "trainer.progress=false")
EXCITE += ("candidates=[{zz20: {duration: 60}},{tc10: {duration: 60}}]", "score=[{zz10: {duration: 60}}]")
EXCITE += ("effort={truths: 1, others: 2, samples: 50}",)
LEGAL: dict[str, tuple[str, ...]] = {
    "train": ("train", *LM, "out=out"),
    "train ensemble": ("train", *ENSEMBLE, "out=out"),
    "train backprop": ("train", *LM, "fit=backprop", "fit.iterations_per_epoch=9", "out=out"),
    "train series": ("train", *SERIES, "out=out"),
    "train recursive": ("train", *RECURSIVE, "out=out"),
    "train pitch": ("train", *PITCH, "network.hidden=3", "trainer.max_epochs=2", "out=out"),
    "train rbf": ("train", *PITCH, "network=rbf", "network.hidden=9", "out=out"),
    "train grnn": ("train", *PITCH, "network=grnn", "trainer.max_epochs=2", "out=out"),
    "train recordings": ("train", *LM[:5], *SHORT[2:], "data=recording", "data.folder={inputs}/runs",
                         "data.files=[zz20.csv]", "ship=mariner_corrected", "out=out"),
    "sweep": ("train", "-m", *LM, "seed=1,2", "hydra/launcher=basic", "out=out"),
    "simulate": ("simulate", "manoeuvre.zz20.duration=60", "out=out"),
    "diagnose": ("diagnose", "ship=mariner_corrected", "recordings={inputs}/runs", "candidates=[heading_bias]",
                 "workers=1", "out=out"),
    "diagnose cases": ("diagnose", "cases={inputs}/cases", "candidates=[heading_bias]", "workers=1", "out=out"),
    "check": ("check", "ship=mariner_corrected", "data.folder={inputs}/runs", "out=out"),
    "import": ("import", "{inputs}/runs/zz20.csv", "out=out/map.yaml", "overwrite=true"),
    "coefficients": ("coefficients", "run={inputs}/series", "out=out"),
    "excite": ("excite", *EXCITE, "out=out"),
    "export": ("export", "run={inputs}/trained", "format=all", "out=out"),
    "trial": ("scripts/concealed_trial.py", *TRIAL, "out=out"),
    "reproduce": ("scripts/reproduce.py", "paper=wang1996", "chapters=3", "quick=true", "workers=1", "out=out"),
}  # fmt: skip
"""What is done -> a command and its words, which write into the folder ``out``."""
MEMORY = 6 * 2**30
"""What a command may have beyond what this process has [bytes]."""


@cache
def inputs() -> Path:
    """A folder of what the commands read: recordings, a case, two trained models; gone when this process ends."""
    folder = Path(tempfile.mkdtemp(prefix="attack_inputs_"))
    atexit.register(_remove, folder, os.getpid())
    sailed = ("manoeuvre=[zz20,tc25]", "manoeuvre.zz20.duration=240", "manoeuvre.tc25.duration=240")
    noise = "noise={u: 0.05, v: 0.05, x: 1.0, y: 1.0, r_deg_s: 0.02, psi_deg: 0.1}"
    for words in (
        ("simulate", "ship=mariner_corrected", *sailed, noise, f"out={folder}/runs"),
        (*LEGAL["train"][:-1], f"out={folder}/trained"),
        (*LEGAL["train series"][:-1], f"out={folder}/series"),
    ):
        ended = typed(words, folder, 300)
        if ended.code:
            raise RuntimeError(f"{words}: {ended.err}")
    (folder / "runs" / "config.yaml").unlink()
    _write_case(folder / "runs", folder / "cases" / "one")
    return folder


def _remove(folder: Path, of: int) -> None:
    """Remove a folder in the process that made it, not in those that it forked."""
    if os.getpid() == of:
        shutil.rmtree(folder, ignore_errors=True)


def _write_case(runs: Path, case: Path) -> None:
    """The simulated runs as a case has them."""
    case.mkdir(parents=True)
    listed = []
    for name, split in (("zz20", "fit"), ("tc25", "held_out")):
        table = pd.read_csv(runs / f"{name}.csv")
        table.columns = [heading.partition(" ")[0] for heading in table.columns]
        degrees = table[["psi", "delta", "r"]] * 57.29577951308232
        degrees["delta"] *= -1.0  # positive to port, as cases have it
        kept = {"t": table["t"], "x_north": table["x"], "y_east": table["y"], "u_log": table["u_log"]}
        pd.DataFrame({**kept, **degrees}).to_csv(case / f"{name}.csv", index=False, float_format="%.5f")
        listed.append({"run": name, "file": f"{name}.csv", "split": split, "rows": len(table)})
    (case / "manifest.json").write_text(
        json.dumps({"case": "one", "ship": "mariner", "warmup_s": 40.0, "runs": listed})
    )


def legal(name: str) -> tuple[str, ...]:
    """A command of :data:`LEGAL` and its words; what it reads is there."""
    return tuple(word.replace("{inputs}", str(inputs())) for word in LEGAL[name])


@cache
def _picture() -> bytes:
    """A picture of some 40 kB, about as large as one of ours."""
    buffer = BytesIO()
    noise = np.random.default_rng(0).integers(0, 256, (100, 130, 3), dtype=np.uint8)
    Image.fromarray(noise).save(buffer, "PNG")
    return buffer.getvalue()


def _save(figure: Figure, file: Any, format: str = "png", **settings: Any) -> None:  # noqa: A002
    """Write what stands for a figure: to draw it takes longer than all else that a small command does."""
    content = _picture() if format == "png" else b'<svg xmlns="http://www.w3.org/2000/svg"/>'
    if isinstance(file, Path):
        file.write_bytes(content)
    else:
        file.write(content)


Figure.savefig = _save  # type: ignore[method-assign]


def typed(
    words: Sequence[str],
    folder: Path,
    limit_s: float,
    prepare: Callable[[], None] | None = None,
    texts: Path | None = None,
) -> Ended:
    """Run a command as typed in a folder, in a process of its own.

    Args:
        words: Command or script, and what follows it.
        folder: Where.
        limit_s: After this long it is killed [s].
        prepare: What is done in its process before.
        texts: Where what it prints is kept meanwhile; None: in that folder.

    Returns:
        How it ended.
    """
    return in_child(lambda: _type(words, folder, prepare), texts or folder, limit_s)


def _type(words: Sequence[str], folder: Path, prepare: Callable[[], None] | None) -> None:
    os.chdir(folder)
    most = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize() + MEMORY
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    if prepare is not None:
        prepare()
    command, *rest = words
    if command.startswith("scripts/"):
        sys.argv = [str(ROOT / command), *rest]
        sys.path.insert(0, str(ROOT))
        runpy.run_path(sys.argv[0], run_name="__main__")
        return
    sys.argv = ["manoeuvre", command, *rest]
    main.main()
