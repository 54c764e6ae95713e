"""Commands that take a second or two each, and what they leave behind: for attacks on them and for comparisons."""

import json
import os
import re
import runpy
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch
from hydra.core.global_hydra import GlobalHydra
from matplotlib.figure import Figure
from matplotlib.image import imsave

import manoeuvre_nn as mnn
from manoeuvre_nn.commands import main
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.writing import write_file

ROOT = Path(__file__).resolve().parents[1]
TRIAL, RIVALS, REPRODUCE = "scripts/concealed_trial.py", "scripts/rivals.py", "scripts/reproduce.py"
SHORT = ("data.length=60", "score=[{zz20: {duration: 60}}]", "scoring.solver=rollout", "trainer.progress=false")
WANG = ("network=wang", "network.hidden=3", "trainer.max_epochs=12", "scoring.every=3", *SHORT)
ENSEMBLE = ("network.members=3", "network.hidden=4", "fit.epochs=4", *SHORT)
NOISY = ("data.noise.u=0.02", "data.noise.v=0.02", "data.noise.r_deg_s=0.02", "data.noise.psi_deg=0.5")
LONGER = ("data.length=120", *SHORT[1:])
CIRCLES = (
    "ship=container_twin", "manoeuvre=circles", "manoeuvre.circles.turn_deg=30", "manoeuvre.circles.approach=20",
    "manoeuvre.circles.rudder_deg=[35]", "manoeuvre.circles.speed_kn=[18]", "score=[{tc25: {duration: 60}}]",
)  # fmt: skip
RECURSIVE = (
    "network=recursive", "network.hidden=[6]", "fit.iterations_per_epoch=2", "trainer.max_epochs=9",
    "fit.stages=[{steps: 3, updates: 8, rows: 6}, {steps: null, updates: 2}]", "scoring.every=1", *CIRCLES,
)  # fmt: skip
PITCH = (
    "task=pitch", "data.method=closed_form", "data.between=10", "inputs.d.values=[7,9]", "inputs.V.values=[0,10]",
    "inputs.beta.values=[0,60,120,180]", "inputs.Hs.values=[2,4]", "inputs.T.values=[8,10,12]",
    "trainer.progress=false", "scoring.every=2",
)  # fmt: skip
PERCEPTRON = ("network.hidden=3", "trainer.max_epochs=8")
SWEEP = ("-m", "network=wang", "trainer.max_epochs=4", "scoring.every=2", *SHORT, "out={out}")
CASES: dict[str, dict[str, Any]] = {"bias": {"effects": ["heading_bias"]}, "calm": {}}
"""Cases that the diagnosis answers: what acts on the ship."""
TIMED = frozenset({"seconds", "cpu_s", "wall_s"})
"""Keys and columns of files that say how long something took."""
SECONDS = re.compile(r"\d+(\.\d+)? s\b|\d+:\d\d\b")
"""The same in a page."""
NOT_COMPARED = re.compile(r"(^|/)(tensorboard|parts|\.lock$|sweep\.(md|html)$|.*\.log$)")
"""Files that tell how a run went, not what came out; and tables that are in ``sweep.csv`` too."""


@dataclass(frozen=True)
class Tiny:
    """A command.

    Attributes:
        name: What to call it.
        family: What is attacked equally often.
        script: Command of ``manoeuvre``, or a script.
        words: What follows it; ``{out}`` is its output folder, ``{cases}`` one of cases.
    """

    name: str
    family: str
    script: str
    words: tuple[str, ...]

    def run(self, out: Path, cases: Path, more: Sequence[str] = ()) -> None:
        """Do it in this process, which ends with it as a command does.

        Args:
            out: Its output folder.
            cases: What :func:`write_cases` wrote.
            more: Further words.
        """
        words = [w.replace("{out}", str(out)).replace("{cases}", str(cases)) for w in (*self.words, *more)]
        subprocess.Popen = _started  # type: ignore[misc, assignment]
        Figure.savefig = _stand_in  # type: ignore[method-assign, assignment]
        if self.script.endswith(".py"):
            _run_script([str(ROOT / self.script), *words])
        else:
            sys.argv = ["manoeuvre", *words]
            main.run(self.script, words)


def _train(name: str, *words: str) -> Tiny:
    """A training."""
    return Tiny(f"train {name}", "train", "train", (*words, "out={out}"))


def _sweep(name: str, *words: str) -> Tiny:
    """Trainings with several settings."""
    return Tiny(f"sweep {name}", "sweep", "train", (*SWEEP, *words))


COMMANDS = (
    _train("levenberg_marquardt", *WANG, "fit=levenberg_marquardt", "fit.iterations_per_epoch=2"),
    _train("backprop", *WANG, "fit=backprop", "fit.iterations_per_epoch=50", "fit.batch_size=16"),
    _train("ensemble", *ENSEMBLE, "scoring.every=1"),
    _train("closed_loop", "network=abkowitz", "fit.delays=[psi]", "fit.offsets=[r]", "trainer.max_epochs=8",
           "scoring.every=2", *NOISY, *LONGER),
    _train("recursive", *RECURSIVE),
    _train("pitch levenberg_marquardt", *PITCH, *PERCEPTRON),
    _train("pitch bayesian", *PITCH, *PERCEPTRON, "fit=bayesian"),
    _train("pitch rbf", *PITCH, "network=rbf", "network.hidden=12"),
    _train("pitch grnn", *PITCH, "network=grnn", "trainer.max_epochs=8"),
    _sweep("of sizes", "network.hidden=2,3", "hydra.launcher.n_jobs=1"),
    _sweep("of seeds", "network.hidden=2", "seed=1,2", "hydra.launcher.n_jobs=1"),
    _sweep("in two processes", "network.hidden=2,3"),
    Tiny("diagnose cases", "diagnose", "diagnose", (
        "cases={cases}", "out={out}", "candidates=[heading_bias]", "report=true", "workers=1",
    )),
    Tiny("concealed trial", "trial", TRIAL, (
        "cases=2", "seed=3", "out={out}", "jobs=2", "sort=clean", "channels=full", "methods=regression",
    )),
    Tiny("reproduce cepowski2007", "reproduce", REPRODUCE, (
        "paper=cepowski2007", "quick=true", "chapters=[formula]", "starts=1", "out={out}",
    )),
)  # fmt: skip


def write_cases(folder: Path) -> Path:
    """Write a few small cases to diagnose.

    Args:
        folder: Where.

    Returns:
        The folder.
    """
    for name, acting in CASES.items():
        place, listed = folder / name, []
        place.mkdir(parents=True)
        for sails in ("zz20", "tc25", "zz10"):
            noise = {"psi_deg": 0.1, "x": 0.7, "y": 0.7}
            run = mnn.simulate("mariner_corrected", {sails: {"duration": 100}}, noise=noise, **acting)[0]
            _as_csv(run).to_csv(place / f"{sails}.csv", index=False)
            split = "held_out" if sails == "zz10" else "fit"
            listed.append({"run": sails, "file": f"{sails}.csv", "split": split})
        particulars = {"approach_speed_m_s": 7.614, "nominal_rpm": 76.0}
        manifest = {"case": name, "ship": "mariner", "warmup_s": 40.0, "runs": listed, "particulars": particulars}
        (place / "manifest.json").write_text(json.dumps(manifest))
    return folder


def _as_csv(run: Recording) -> pd.DataFrame:
    """Columns as the diagnosis reads them; positive rudder angles to port."""
    degrees = {name: np.degrees(run[name]) for name in ("psi", "r")} | {"delta": -np.degrees(run["delta"])}
    table = {"t": run.time, "x_north": run["x"], "y_east": run["y"], "u_log": run["u"], **degrees}
    return pd.DataFrame(table).round(4)


def results(folder: Path) -> dict[str, Any]:
    """What a command left behind, to be compared.

    Args:
        folder: Its output folder.

    Returns:
        File -> content, without times.
    """
    files = {str(path.relative_to(folder)): path for path in sorted(folder.rglob("*")) if path.is_file()}
    return {name: _content(path, folder) for name, path in files.items() if not NOT_COMPARED.search(name)}


def _content(path: Path, folder: Path) -> Any:
    """What a file holds."""
    if path.suffix == ".json":
        return _untimed(json.loads(path.read_text()))
    if path.suffix == ".csv":
        return pd.read_csv(path).drop(columns=list(TIMED), errors="ignore").to_dict("list")
    if path.suffix == ".ckpt":
        return _untimed(torch.load(path, weights_only=True))
    if path.suffix in {".html", ".md"}:
        return SECONDS.sub("... s", path.read_text())
    return path.read_bytes().replace(os.fsencode(folder), b"OUT")


def _untimed(value: Any) -> Any:
    """Plain values without times, tensors as bytes and type or as lists of numbers."""
    if isinstance(value, dict):
        return {key: _untimed(inner) for key, inner in value.items() if key not in TIMED}
    if isinstance(value, list | tuple):
        return [_untimed(inner) for inner in value]
    return value.detach().flatten().tolist() if isinstance(value, torch.Tensor) else value


def _stand_in(figure: Figure, target: Any, **_: Any) -> None:
    """Write a picture that costs nothing: drawing takes two thirds of a tiny run."""
    imsave(target, np.zeros((2, 2)), format="png")


_REAL = subprocess.Popen


def _started(words: Any, *more: Any, **given: Any) -> Any:
    """Start a program: a script of Python in a forked process, which need not import torch again."""
    script = words[0] == sys.executable and words[1].endswith(".py")
    return (_Forked if script else _REAL)(words, *more, **given)


class _Forked:
    """What the concealed trial needs of ``subprocess.Popen``."""

    def __init__(self, words: Sequence[str], *, stdout: Any = None, preexec_fn: Any = None, **given: Any) -> None:
        """Start a script."""
        self.returncode: int | None = None
        reader, self.stdin = os.pipe()
        self.pid = os.fork()
        if self.pid:
            os.close(reader)
            return
        os.close(self.stdin)
        os.dup2(reader, 0)
        sys.stdin = os.fdopen(0)
        for number in (1, 2) if stdout is not None else ():
            os.dup2(stdout.fileno(), number)
        os.environ.update(given.get("env") or {})
        os.chdir(given.get("cwd") or ".")
        code = 1
        try:
            if preexec_fn is not None:
                preexec_fn()
            _run_script(list(words[1:]))
            code = 0
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else int(end.code is not None)
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code)

    def __enter__(self) -> "_Forked":
        """As a context."""
        return self

    def __exit__(self, *_: object) -> None:
        """Wait for its end."""
        self._wait(0)

    def communicate(self, text: str = "") -> None:
        """Say something, and wait for its end."""
        os.write(self.stdin, text.encode())
        os.close(self.stdin)
        self._wait(0)

    def poll(self) -> int | None:
        """Exit code, None while it runs."""
        return self._wait(os.WNOHANG)

    def terminate(self) -> None:
        """End it."""
        if self.poll() is None:
            os.kill(self.pid, signal.SIGTERM)

    def kill(self) -> None:
        """End it at once."""
        if self.poll() is None:
            os.kill(self.pid, signal.SIGKILL)

    def wait(self, timeout: float | None = None) -> int | None:
        """Wait for its end."""
        until = None if timeout is None else time.monotonic() + timeout
        while until is not None and self.poll() is None:
            if time.monotonic() > until:
                raise subprocess.TimeoutExpired("a script", timeout or 0.0)
            time.sleep(0.01)
        return self._wait(0)

    def _wait(self, options: int) -> int | None:
        """Exit code, None while it runs."""
        if self.returncode is None:
            ended, status = os.waitpid(self.pid, options)
            self.returncode = os.waitstatus_to_exitcode(status) if ended else None
        return self.returncode


def _run_script(words: list[str]) -> None:
    """Run a script with its words, as ``python`` does."""
    GlobalHydra.instance().clear()
    if words[0] == RIVALS:
        _answer_at_once(dict(word.partition("=")[::2] for word in words[1:]))
        return
    sys.argv = words
    sys.path.insert(0, str(Path(words[0]).parent))
    runpy.run_path(words[0], run_name="__main__")


def _answer_at_once(given: Mapping[str, str]) -> None:
    """Stand for a tool of the trial: its own answers take seconds, and what is of interest are the trial's stages."""
    for case in sorted(Path(given["cases"]).iterdir()):
        path = Path(given["out"]) / case.name / "answer.json"
        if not path.is_file():
            time.sleep(0.1)
            write_file(path, json.dumps({"case": case.name, "verdict": "none", "effects": [], "model": []}))
