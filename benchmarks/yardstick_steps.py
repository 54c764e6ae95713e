"""The steps but ``practice``: each runs commands of a tree and reads what they wrote."""

import ast
import io
import re
import tokenize
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from math import inf, isfinite, sqrt
from pathlib import Path
from statistics import median_high
from typing import Any

import pandas as pd
from yardstick_practice import practice
from yardstick_tree import PACKAGE, SOURCE, Result, Tree, YardstickError, finite, python_files, read

# What is known of the tree: its commands, which may move to another folder, the files that they write, and their keys.
TRAIN, REPRODUCE, TRIAL = "train.py", "scripts/reproduce.py", "scripts/concealed_trial.py"
ESSO, OPTIMIZERS, ROLLOUTS = "benchmarks/esso_osaka.py", "benchmarks/levenberg_marquardt.py", "benchmarks/rollouts.py"
SCORES, RUNS, REPRODUCTION, BOARD = "scores.json", "runs.csv", "reproduction.json", "scoreboard.json"
CRITERIA = {"overshoot 1, deg": "overshoot_1_deg", "overshoot 2, deg": "overshoot_2_deg", "period, %": "period_s"}
COUNTS = ("answered", "false alarms", "first name", "both names of pairs", "unknown found", "unknown said rightly")
COUNTS += ("predictions made worse",)
RATES = ("parameters right", "covered by two standard errors")
VALUES = ("interval overlap, mean", "share of the gap closed, all together", "share of the gap closed, median")
VALUES += ("calibration error",)
"""Of the scoreboard of the concealed trial: how often, as a share, as they stand."""
TOOL = "manoeuvre_nn"
"""Name of the package's own answers there."""

SEEDS = range(8)
MARINER = ("ship=mariner", "manoeuvre=zz35", "score=[zz20,tc10,tc25,spiral]")
TANKER = ("ship=esso_190k", "manoeuvre=zz20", "data.length=1500")
TANKER += ("score=[{zz20: {duration: 2000, name: zz20_2000_s}},zz25,zz15,zz10,tc15,tc20,tc25]",)
"""What is trained on may be judged under another name only; README judges it for longer than it was trained on."""
HSVA = {
    "first set": "Z_10_10_S.csv,Z_10_01.csv,Z_20_10_P.csv,Z_35_05.csv",
    "second set": "Z_10_10_S.csv,Z_05_01.csv,Z_20_10_P.csv,Z_30_05.csv",
}
STARTS, BATCHES = 4, (1, 10, 100, 1000)
CASES = 24
TRIALS = {"trial": (212712, 1), "trial_exact": (212713, 0)}
"""Seed and nuisance."""


# Step: code


def _code(tree: Tree) -> Result:
    """Size and shape of the source; this script is left out."""
    sources = {path: path.read_text() for path in python_files(tree.root)}
    lines = Counter[str]()
    for path, text in sources.items():
        lines[_room(path.relative_to(tree.root))] += text.count("\n")
    package_files = [path for path in sources if path.is_relative_to(tree.source)]
    package = [ast.parse(sources[path]) for path in package_files]
    classes = Counter(
        n.name for t in package for n in ast.walk(t) if isinstance(n, ast.ClassDef) and not n.name.startswith("_")
    )
    judged = {p: t for p, t in sources.items() if not p.is_relative_to(tree.root / "tests")}
    functions = [(p, f) for p, t in judged.items() for f in ast.walk(ast.parse(t)) if isinstance(f, ast.FunctionDef)]
    many = [f"{p.relative_to(tree.root)}:{f.lineno} {f.name}" for p, f in functions if _parameters(f) > 7]
    long = [f"{p.relative_to(tree.root)}:{f.lineno} {f.name}" for p, f in functions if _body_lines(f) > 60]
    big = [str(p.relative_to(tree.root)) for p, t in judged.items() if t.count("\n") > 400]
    twice = [name for name, count in classes.items() if count > 1]
    metrics = {f"lines, {name}": count for name, count in sorted(lines.items())}
    metrics |= {"lines of the package": sum(n for name, n in lines.items() if name.startswith(PACKAGE))}
    metrics |= {"lines of code of the package": sum(map(_code_lines, (sources[p] for p in package_files)))}
    metrics |= {"lines of all but tests": sum(lines.values()) - lines["tests"]}
    metrics |= {"public classes": sum(classes.values()), "class names that stand twice": len(twice)}
    metrics |= {"functions with more than 7 parameters": len(many), "bodies over 60 lines": len(long)}
    metrics |= {"files over 400 lines": len(big)}
    return Result(metrics, {"many parameters": many, "long bodies": long, "big files": big, "twice": sorted(twice)})


def _room(path: Path) -> str:
    """The room that a file is in."""
    if path.parts[0] == SOURCE:
        return "/".join(path.parts[1:-1][:2])
    return path.parts[0] if len(path.parts) > 1 else "top"


def _code_lines(text: str) -> int:
    """Lines that hold code: no docstrings, comments or blank lines."""
    silent = (tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER)
    tokens = [t for t in tokenize.generate_tokens(io.StringIO(text).readline) if t.type not in silent]
    lines = {line for t in tokens for line in range(t.start[0], t.end[0] + 1)}
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, documented) and ast.get_docstring(node, clean=False) is not None:
            lines -= set(range(node.body[0].lineno, (node.body[0].end_lineno or 0) + 1))
    return len(lines)


def _parameters(function: ast.FunctionDef) -> int:
    """Number of parameters, without ``self`` and ``cls``."""
    given = function.args
    return sum(a.arg not in {"self", "cls"} for a in (*given.posonlyargs, *given.args, *given.kwonlyargs))


def _body_lines(function: ast.FunctionDef) -> int:
    """Lines of a function's body, without its docstring."""
    body = function.body[1:] if ast.get_docstring(function, clean=False) is not None else function.body
    return (body[-1].end_lineno or 0) - body[0].lineno + 1 if body else 0


# Steps: mariner, tanker, hsva, esso_osaka


def _trained(tree: Tree, name: str, *, words: Sequence[str]) -> Result:
    """README's default row of a simulated ship: dev/L of held-out manoeuvres."""
    ways = (*words, "trainer.progress=false", "out={out}")
    runs = [read(tree.run(f"{name}/{s}", TRAIN, *ways, f"seed={s}").out / SCORES)["scores"] for s in SEEDS]
    found = {m: [r[m]["dev_L"] if r[m]["status"] == "ok" else inf for r in runs] for m in runs[0]}
    metrics: dict[str, float | None] = {"left the range": sum(v == inf for vs in found.values() for v in vs)}
    errors = {}
    for manoeuvre, values in found.items():
        middle = median_high(values)
        spread = median_high(abs(v - middle) for v in values) if middle < inf else inf
        metrics |= {f"{manoeuvre}, median": middle, f"{manoeuvre}, worst": max(values)}
        errors[f"{manoeuvre}, worst"] = 1.48 * spread  # of a normal distribution with this median deviation
        errors[f"{manoeuvre}, median"] = 1.25 * 1.48 * spread / sqrt(len(values))
    details = {m: [finite(v) for v in values] for m, values in found.items()}
    return Result(metrics, details, {k: e for k, e in errors.items() if isfinite(e)})


def _hsva(tree: Tree) -> Result:
    """KVLCC2's zigzags of docs/measured.md: largest errors over the nine that were not trained on."""
    folder = tree.data("recordings", "kvlcc2-hsva-cpmc")
    words = ("ship=kvlcc2_hsva", "data=recording", "data.mapping=kvlcc2_hsva", f"data.folder={folder}")
    metrics, details = dict[str, float | None](), dict[str, Any]()
    for name, files in HSVA.items():
        ways = (*words, f"data.files=[{files}]", "trainer.progress=false", "out={out}")
        scores = read(tree.run(f"hsva/{name.replace(' ', '_')}", TRAIN, *ways).out / SCORES)["scores"]
        metrics |= {f"{name}, {what}": _largest_error(scores, key, "%" in what) for what, key in CRITERIA.items()}
        details[name] = {m: {k: s[k] for k in ("dev_L", "status", "criteria", "reference")} for m, s in scores.items()}
    return Result(metrics, details)


def _largest_error(scores: Mapping[str, Any], key: str, relative: bool) -> float | None:
    """Largest error of a criterion over the runs that have it; None if a prediction lacks it."""
    pairs = [(s["criteria"].get(key), s["reference"][key]) for s in scores.values() if key in s["reference"]]
    if any(ours is None for ours, _ in pairs):
        return None
    return max(abs(ours - theirs) * (100 / theirs if relative else 1) for ours, theirs in pairs)


def _esso_osaka(tree: Tree) -> Result:
    """Esso Osaka in closed loop with the recorded wind."""
    tree.data("recordings", "esso-osaka-frt")
    done = tree.run("esso_osaka", ESSO, "methods=closed_loop", "wind=on", "out={out}")
    table = pd.read_csv(done.out / RUNS)
    metrics = {
        f"{group}, {column}": float(rows[column].median())
        for group, rows in table.groupby("group")
        for column in ("u", "v", "r", "dev_L")
    }
    metrics |= {"broke down": int((table["status"] != "ok").sum())}
    return Result(metrics, table.to_dict("records"))


# Step: speed


def _speed(tree: Tree) -> Result:
    """Costs beside other packages in the same run, as README tells them; less is better."""
    fits = tree.run("speed/levenberg_marquardt", OPTIMIZERS, str(STARTS)).printed
    sizes = ",".join(map(str, BATCHES))
    rollouts = tree.run("speed/rollouts", ROLLOUTS, f"batch={sizes}").printed
    metrics = dict(_optimizer_ratios(fits)) | dict(_rollout_costs(rollouts))
    if not metrics:
        raise YardstickError("the benchmarks of speed print their tables in another form")
    return Result(metrics, {"levenberg_marquardt": fits.splitlines(), "rollouts": rollouts.splitlines()})


def _optimizer_ratios(printed: str) -> Iterator[tuple[str, float]]:
    """CPU time of the fastest method of this package over that of scipy's fastest, for each problem."""
    for part in printed.strip().split("\n\n"):
        title, *lines = part.splitlines()
        rows = [re.split(" {2,}", line) for line in lines]  # method, ms an epoch, ratio, ms to the goal, ...
        for column, what in ((1, "an epoch"), (3, "to the goal")):
            ours, theirs = (
                [float(row[column]) for row in rows if row[0].startswith(who) and len(row) > column]
                for who in ("this", "scipy")
            )
            if ours and theirs:
                yield f"Levenberg-Marquardt over scipy's, {title.split(':')[0]}, {what}", min(ours) / min(theirs)


def _rollout_costs(printed: str) -> Iterator[tuple[str, float]]:
    """Cost of a zigzag by size of the batch."""
    peers = printed.count("shipmmg ms")
    for size in BATCHES:
        row = re.search(rf"^ *{size} +(\d.*)$", printed, re.MULTILINE)
        if row:
            cells = [float(cell) for cell in row[1].split()]
            name = f"a zigzag in a batch of {size}"
            yield (f"{name} over one of shipmmg", cells[-1]) if peers else (f"{name}, ms", cells[0])


# Steps: wang, rajesh


def _paper(tree: Tree, name: str, *, which: str) -> Result:
    """A paper done again in its short form."""
    words = (f"paper={which}", "quick=true", "workers=1", "out={out}")
    done = tree.run(name, REPRODUCE, *words, may_fail=True)
    if not (done.out / REPRODUCTION).is_file():
        raise YardstickError(f"{REPRODUCE} ended with code {done.code}: {done.last_line}")
    found = read(done.out / REPRODUCTION)
    claims = dict(_claims_of(found["chapters"]))
    return Result({**found["verdicts"], "failed chapters": len(found["failed"])}, claims)


def _claims_of(chapters: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Every claim with its verdict."""
    seen = Counter[str]()
    for chapter, content in chapters.items():
        for claim in content.get("claims", ()):
            name = f"{chapter} | {claim['where']} | {claim['what']}"
            seen[name] += 1
            yield (name if seen[name] == 1 else f"{name} #{seen[name]}"), claim["verdict"]


# Steps: trial_exact, trial


def _trial(tree: Tree, name: str) -> Result:
    """Concealed cases, drawn from a fixed seed."""
    seed, nuisance = TRIALS[name]
    done = tree.run(name, TRIAL, f"cases={CASES}", f"seed={seed}", f"nuisance={nuisance}", "jobs=1", "out={out}")
    found = read(done.out / BOARD)["tools"][TOOL]
    totals = found["board"]["totals"]
    metrics = {key: totals[key]["right"] for key in COUNTS if totals[key]}
    metrics |= {f"{key}, share": totals[key]["share"] for key in RATES if totals[key]}
    metrics |= {key: totals[key] for key in VALUES} | {"CPU seconds of a case": done.cpu_s / CASES}
    kept = ("truth", "strength", "verdict", "first", "first_right", "share", "j_before", "j_after")
    cases = {row["case"]: {key: row[key] for key in kept} for row in found["cases"]}
    return Result(metrics, {"totals": totals, "cases": cases})


STEPS: dict[str, Callable[[Tree], Result]] = {
    "code": _code,
    "practice": practice,
    "mariner": partial(_trained, name="mariner", words=MARINER),
    "tanker": partial(_trained, name="tanker", words=TANKER),
    "hsva": _hsva,
    "esso_osaka": _esso_osaka,
    "speed": _speed,
    "wang": partial(_paper, name="wang", which="wang1996"),
    "rajesh": partial(_paper, name="rajesh", which="rajesh2009"),
    "trial_exact": partial(_trial, name="trial_exact"),
    "trial": partial(_trial, name="trial"),
}
