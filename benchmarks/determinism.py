"""Do the same commands again under other circumstances, and say whether the same numbers come out.

    python benchmarks/determinism.py [only=closed_loop,diagnose]

A row a command, a column a circumstance: ``same`` is bit for bit, in scores, checkpoints, predictions, tables and
answers; else the largest difference over the largest number of its column or array. Circumstances are *elsewhere*: at
another time, with another order of sets (PYTHONHASHSEED), time zone and folder; *threads*: two for torch and linear
algebra; *processes*: two at work instead of one, or one instead of two.
"""

import json
import os
import subprocess
import sys
import tempfile
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

LIMIT_S = 600.0
ONE_THREAD = {name: "1" for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")}
CIRCUMSTANCES: dict[str, dict[str, str]] = {
    "first": {"PYTHONHASHSEED": "0", "TZ": "UTC"},
    "elsewhere": {"PYTHONHASHSEED": "77", "TZ": "Pacific/Auckland"},
    "threads": {name: "2" for name in ONE_THREAD},
    "processes": {},
}
"""What differs in the environment."""
THREADS = ("trainer.threads=2",)
TOLD = ("config.yaml", "multirun.yaml", "overrides.yaml", "sweep.csv", ".png", ".html")
"""Files that repeat words of the command or show numbers that stand in other files."""
PROCESSES = {"diagnose": ("workers=2",), "sweep": ("hydra.launcher.n_jobs=2",), "trial": ("jobs=1",)}
"""Family of commands -> words that change the number of processes."""


def main(words: list[str]) -> int:
    """Run everything under every circumstance; exit code 1 if a command fails."""
    settings = dict(word.partition("=")[::2] for word in words)
    if "_circumstance" in settings:
        return _run_all(settings["_circumstance"], Path(settings["_into"]), settings["only"])
    with tempfile.TemporaryDirectory(prefix="same_") as place:
        for name, environment in CIRCUMSTANCES.items():
            into = Path(place, f"{name}_folder" if name == "elsewhere" else name)
            into.mkdir()
            command = [sys.executable, __file__, f"_circumstance={name}", f"_into={into}"]
            command += [f"only={settings.get('only', '')}"]
            subprocess.run(command, env=os.environ | ONE_THREAD | environment, cwd=into, check=True)
        return _print_table(Path(place))


def _run_all(circumstance: str, into: Path, only: str) -> int:
    """All commands under one circumstance, each in a forked process; what they leave is written down."""
    from robustness_attack import in_child
    from tiny_commands import COMMANDS, SHORT, Tiny, results, write_cases

    more = (
        Tiny("coefficients", "coefficients", "coefficients", ("data.length=120", "out={out}")),
        Tiny("excite", "excite", "excite", ("candidates=[zz10,tc20]", "network.members=2", "network.hidden=4",
             "fit.epochs=3", SHORT[0], "out={out}")),
        Tiny("simulate", "simulate", "simulate", ("manoeuvre=zz20", "effect=[wind_gusty]", "out={out}")),
    )  # fmt: skip
    cases, kept_in = into / "cases", into / "found.jsonl"
    in_child(partial(write_cases, cases), into, LIMIT_S)  # threads of linear algebra do not outlive a fork: none here
    kept_in.touch()
    for command in (c for c in (*COMMANDS, *more) if any(part in c.name for part in only.split(","))):
        words: tuple[str, ...] = THREADS if circumstance == "threads" and command.family in {"train", "sweep"} else ()
        if circumstance == "processes":
            if command.family not in PROCESSES:
                continue
            words = PROCESSES[command.family]
        out = into / command.name.replace(" ", "_") / "out"
        out.parent.mkdir()
        ended = in_child(partial(command.run, out, cases, words), out.parent, LIMIT_S)
        found = results(out) if ended.code == 0 else {"failed": ended.err[-500:]}
        kept = {name: content for name, content in found.items() if not name.endswith(TOLD)}
        text = json.dumps({command.name: kept}, default=lambda content: content.decode(errors="replace"))
        text = text.replace(f",{THREADS[0]}", "")  # in the name of a job's folder
        with kept_in.open("a") as file:
            file.write(text + "\n")
    return 0


def _print_table(place: Path) -> int:
    """A row a command, a column a circumstance."""
    found: dict[str, dict[str, Any]] = {}
    for name in CIRCUMSTANCES:
        lines = next(place.glob(f"{name}*")).joinpath("found.jsonl")
        found[name] = {k: v for line in lines.read_text().splitlines() for k, v in json.loads(line).items()}
    columns = [name for name in CIRCUMSTANCES if name != "first"]
    print(f"{'':28}" + "".join(f"{name:>14}" for name in columns))
    for command, expected in found["first"].items():
        cells = (told(expected, found[name].get(command)) for name in columns)
        print(f"{command:28}" + "".join(f"{cell:>14}" for cell in cells), flush=True)
        if "failed" in expected:
            print(expected["failed"])
    return int(any("failed" in content for commands in found.values() for content in commands.values()))


def told(one: Any, other: Any) -> str:
    """``same``, the largest relative difference of numbers, or what else differs.

    Args:
        one: What a command left.
        other: What it left under other circumstances; None if it was not done.

    Returns:
        A cell of the table.
    """
    if other is None:
        return ""
    if json.dumps(one, sort_keys=True) == json.dumps(other, sort_keys=True):  # where NaN is equal to itself
        return "same"
    try:
        return f"{_difference(one, other):.0e}"
    except _NoNumbers as place:
        return f"not {place}"


class _NoNumbers(Exception):
    """More than numbers differs; the name of what does."""


def _difference(one: Any, other: Any, name: str = "all") -> float:
    """Largest difference of numbers over the largest of their list."""
    if isinstance(one, dict) and isinstance(other, dict) and one.keys() == other.keys():
        return max((_difference(one[key], other[key], str(key)) for key in one), default=0.0)
    if isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
        if all(isinstance(v, int | float) for v in (*one, *other)):
            a, b = np.array(one, dtype=float), np.array(other, dtype=float)
            differ = (a != b) & ~(np.isnan(a) & np.isnan(b))
            largest = max(np.nanmax(np.abs(a), initial=0.0), 1e-300)
            return float(np.max(np.abs(a[differ] - b[differ]), initial=0.0) / largest)
        return max((_difference(a, b, name) for a, b in zip(one, other, strict=True)), default=0.0)
    if isinstance(one, int | float) and isinstance(other, int | float):
        return abs(one - other) / max(abs(one), 1e-300)
    if one != other:
        raise _NoNumbers(name)
    return 0.0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
