"""Measure what must survive a rebuild of the package, and compare two such measurements.

    python benchmarks/yardstick.py out=FILE.json [root=FOLDER] [steps=practice,trial] [shared=FOLDER] [peers=FOLDER]
        [ci_s=SECONDS]
    python benchmarks/yardstick.py compare BEFORE.json AFTER.json

Commands of the tree in ``root`` are run as a user runs them, one at a time and with one thread, and only the files that
they write are read; the two benchmarks of speed write none, so that what they print is read. They run under an
interpreter of their own, which finds the package in ``root/src`` and all other packages where this interpreter has
them: it does not matter which tree is installed. ``shared`` holds ``concealed/practice`` and ``recordings``; a step
whose data are not there is left out. ``peers`` is a folder with shipmmg, beside which roll-outs are timed (``pip
install --no-deps --target FOLDER shipmmg``). What the commands write goes to ``FILE_runs/``.

Every step is stored in ``out`` as soon as it is done, and the same command goes on where it was stopped: steps that are
done are left out, and so are commands that ended well. Each step has its CPU seconds and its seconds by the clock:

    code                size and shape of the source
    practice            cases whose answers are known, marked as their FORMAT.md says
    mariner, tanker     README's default rows; without other approach speeds, which train.py does not score
    hsva, esso_osaka    measured runs, as in docs/measured.md
    speed               Levenberg-Marquardt beside scipy's, roll-outs beside shipmmg's
    wang, rajesh        the papers in their short form: the verdict of every claim
    trial_exact, trial  concealed cases from fixed seeds, with exact and with scattered coefficients
    ci                  seconds that CI takes, measured by hand: ``ci_s``

``compare`` calls a metric worse if it is so by more than its tolerance in ``RULES``, and by more than two standard
errors where seeds show its scatter. It exits with 1 if anything is worse, or is no longer there.
"""

import platform
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from fnmatch import fnmatch
from functools import partial
from math import hypot
from pathlib import Path
from typing import Any

from yardstick_steps import STEPS
from yardstick_tree import NothingToMeasureError, Result, Tree, YardstickError, finite, read, write

LESS, MORE, SHOWN = -1, 1, 0
ABSENT = "absent"
RULES: tuple[tuple[str, int, float, float], ...] = (
    ("*: seconds by the clock", SHOWN, 0, 0),
    ("code: CPU seconds", SHOWN, 0, 0),
    ("*: *seconds*", LESS, 2, 0.3),
    ("code: lines, *", SHOWN, 0, 0),
    ("code: lines of *", LESS, 0, 0.05),
    ("code: public classes", LESS, 0, 0.05),
    ("code: *", LESS, 0, 0),
    ("practice: false alarms", LESS, 0, 0),
    ("practice: failed cases", LESS, 0, 0),
    ("practice: share*", MORE, 0.02, 0),
    ("practice: J*", LESS, 0, 0.05),
    ("practice: interval overlap", MORE, 0.03, 0),
    ("practice: *", MORE, 0, 0),
    ("mariner: *", LESS, 0.002, 0.3),
    ("tanker: *", LESS, 0.005, 0.3),
    ("hsva: *period*", LESS, 0.3, 0),
    ("hsva: *", LESS, 0.1, 0),
    ("esso_osaka: *", LESS, 0.01, 0.03),
    ("speed: *", LESS, 0, 0.25),
    ("*: does not hold", LESS, 3, 0),
    ("*: failed chapters", LESS, 0, 0),
    ("*: holds", MORE, 3, 0),
    ("*: holds in direction", SHOWN, 0, 0),
    ("*: not comparable", LESS, 1, 0),
    ("trial*: false alarms", LESS, 0, 0),
    ("trial*: predictions made worse", LESS, 0, 0),
    ("trial*: answered", MORE, 0, 0),
    ("trial*: first name", MORE, 1, 0),
    ("trial*: unknown*", MORE, 1, 0),
    ("trial*: both names*", MORE, 1, 0),
    ("trial*: calibration error", LESS, 0.01, 0),
    ("trial*: share*", MORE, 0.05, 0),
    ("trial*: *", MORE, 0.05, 0),
)
"""Metric, whether less or more of it is better, and by how much it may be worse: absolutely, and as a share of itself.

The first that fits counts; a metric without a rule is shown and not judged."""


# Measuring


def _measured(step: Callable[[Tree], Result], tree: Tree) -> dict[str, Any]:
    """Do a step; whatever goes wrong in it is written down."""
    tree.ran.clear()
    cpu, wall = time.process_time(), time.monotonic()
    try:
        found = step(tree)
    except NothingToMeasureError as error:
        return {"status": "left out", "error": str(error)}
    except Exception as error:  # noqa: BLE001 - the other steps go on
        text = str(error) if isinstance(error, YardstickError) else f"{type(error).__name__}: {error}"
        return {"status": "failed", "error": text}
    own = {"cpu_s": time.process_time() - cpu, "wall_s": time.monotonic() - wall}
    spent = {key: sum(getattr(ran, key) for ran in tree.ran) if tree.ran else value for key, value in own.items()}
    times = {"CPU seconds": spent["cpu_s"], "seconds by the clock": spent["wall_s"]}
    metrics = {key: finite(value) for key, value in {**found.metrics, **times}.items()}
    return {"status": "done", "metrics": metrics, "errors": found.errors, "details": found.details}


def _described(root: Path) -> dict[str, Any]:
    """What was measured, and with what."""
    git = partial(subprocess.run, cwd=root, capture_output=True, text=True, check=False)
    changed = git(["git", "status", "--porcelain", "--untracked-files=no"]).stdout.strip()
    commit = git(["git", "rev-parse", "HEAD"]).stdout.strip()
    where = {"root": str(root), "python": platform.python_version(), "machine": platform.platform()}
    return {"commit": commit, "changed": bool(changed), **where}


def measure(given: Mapping[str, str]) -> None:
    """Do the steps that are not there yet.

    Args:
        given: Settings.

    Raises:
        YardstickError: If the file is of another commit.
    """
    out, root = Path(given["out"]).resolve(), Path(given["root"]).resolve()
    runs, head = out.with_name(f"{out.stem}_runs"), _described(root)
    found = read(out) if out.is_file() else {**head, "steps": {}}
    if found["commit"] != head["commit"]:
        raise YardstickError(
            f"{out} is of commit {found['commit'][:7]}, {root} is at {head['commit'][:7]}: choose another out"
        )
    runs.mkdir(parents=True, exist_ok=True)
    if given["ci_s"]:
        found["steps"]["ci"] = {"status": "done", "metrics": {"seconds": float(given["ci_s"])}}
    write(out, found)
    peers = Path(given["peers"]).resolve() if given["peers"] else None
    tree = Tree(root, runs, (root / given["shared"]).resolve(), peers)
    for name in given["steps"].split(","):
        if found["steps"].get(name, {}).get("status") == "done":
            print(f"{name}: done before", flush=True)
            continue
        found["steps"][name] = _measured(STEPS[name], tree)
        write(out, found)
        print(_told(name, found["steps"][name]), flush=True)


def _told(name: str, step: Mapping[str, Any]) -> str:
    """A step on a line."""
    if step["status"] != "done":
        return f"{name}: {step['status']}: {step['error']}"
    return f"{name}: " + "; ".join(f"{key} {_number(value)}" for key, value in step["metrics"].items())


# Comparing


def compare(before: Mapping[str, Any], after: Mapping[str, Any]) -> tuple[list[list[str]], int]:
    """Two measurements side by side.

    Args:
        before: The first.
        after: The second.

    Returns:
        Rows of metric, before, after, difference, verdict; and how many are worse.
    """
    rows = list[list[str]]()
    for name in (*STEPS, "ci"):
        old, new = (side["steps"].get(name, {"status": "not measured"}) for side in (before, after))
        if old["status"] == new["status"] == "done":
            keys = dict.fromkeys((*old["metrics"], *new["metrics"]))
            rows += [_compared(f"{name}: {key}", old, new, key) for key in keys]
        elif old != new:
            rows.append([name, old["status"], new["status"], "", "worse" if old["status"] == "done" else "-"])
    return rows, sum(row[-1] == "worse" for row in rows)


def _compared(name: str, old: Mapping[str, Any], new: Mapping[str, Any], key: str) -> list[str]:
    """One metric side by side."""
    a, b = (side["metrics"].get(key, ABSENT) for side in (old, new))
    scatter = hypot(*(side.get("errors", {}).get(key, 0.0) for side in (old, new)))
    known = not isinstance(a, str | None) and not isinstance(b, str | None)
    return [name, _number(a), _number(b), f"{b - a:+.3g}" if known else "", _judged(name, a, b, scatter)]


def _judged(name: str, a: float | str | None, b: float | str | None, scatter: float) -> str:
    """Whether a metric is better, the same or worse; what got lost or is absent is worse than any number."""
    _, better, absolute, share = next((r for r in RULES if fnmatch(name, r[0])), ("", SHOWN, 0.0, 0.0))
    if better == SHOWN or a == ABSENT:
        return "-"
    if a == b:
        return "same"
    if isinstance(a, str | None) or isinstance(b, str | None):
        return "worse" if isinstance(b, str | None) else "better"
    tolerance, gain = max(absolute + share * abs(a), 2 * scatter), better * (b - a)
    return "better" if gain > tolerance else "worse" if gain < -tolerance else "same"


def _number(value: float | str | None) -> str:
    """A number as text."""
    if isinstance(value, str | None):
        return value or "lost"
    return f"{value:.0f}" if value == round(value) else f"{value:.4g}"


def _changed_claims(before: Mapping[str, Any], after: Mapping[str, Any]) -> Iterator[str]:
    """Claims of the papers whose verdict is another."""
    for name in ("wang", "rajesh"):
        old, new = (side["steps"].get(name, {}).get("details") or {} for side in (before, after))
        if old and new:
            yield from (f"{name}: {k}: {v} -> {new[k]}" for k, v in old.items() if new.get(k, v) != v)
            gone = sum(key not in new for key in old)
            yield from [f"{name}: {gone} claims are no longer there under their names"] if gone else []


def _table(rows: Iterable[Sequence[str]]) -> str:
    """Rows with their columns aligned."""
    lines = [("metric", "before", "after", "difference", "verdict"), *rows]
    widths = [max(len(line[k]) for line in lines) for k in range(len(lines[0]))]
    return "\n".join("  ".join(cell.ljust(w) for cell, w in zip(line, widths, strict=True)).rstrip() for line in lines)


def _settings(arguments: Sequence[str]) -> dict[str, str]:
    """Settings from the command line."""
    given = {"out": "", "root": str(Path(__file__).parents[1]), "shared": "shared", "peers": "", "ci_s": ""}
    given |= {"steps": ",".join(STEPS)}
    for word in arguments:
        key, sign, value = word.partition("=")
        if not sign or key not in given:
            raise YardstickError(f"{word!r} is not understood; write {' '.join(f'{k}=...' for k in given)}")
        given[key] = value
    for name in given["steps"].split(","):
        if name not in STEPS:
            raise YardstickError(f"steps={name}: choose from {', '.join(STEPS)}")
    if not given["out"]:
        raise YardstickError("write out=FILE.json")
    if given["ci_s"] and not re.fullmatch(r"\d+(\.\d+)?", given["ci_s"]):
        raise YardstickError(f"ci_s={given['ci_s']}: write a number of seconds")
    return given


def main(arguments: Sequence[str]) -> int:
    """Measure or compare.

    Args:
        arguments: See the module.

    Returns:
        Exit code.

    Raises:
        YardstickError: If an argument is not understood.
    """
    if arguments[:1] != ["compare"]:
        measure(_settings(arguments))
        return 0
    if len(arguments) != 3:
        raise YardstickError("write compare BEFORE.json AFTER.json")
    before, after = (read(Path(path)) for path in arguments[1:])
    rows, worse = compare(before, after)
    print(_table(rows), *_changed_claims(before, after), f"{worse} worse", sep="\n")
    return int(worse > 0)


if __name__ == "__main__":
    try:
        sys.exit(main(sys.argv[1:]))
    except YardstickError as error:
        print(f"yardstick.py: {error}", file=sys.stderr)
        sys.exit(2)
