"""The step ``practice``: concealed cases whose answers are known, marked as their FORMAT.md says."""

import shutil
from collections.abc import Mapping, Sequence
from math import inf, isfinite, sqrt
from pathlib import Path
from statistics import mean, median
from typing import Any

import numpy as np
import pandas as pd
from yardstick_tree import NothingToMeasureError, Result, Tree, read

DIAGNOSE, ANSWER = "diagnose.py", "answer.json"

SCALES = {"psi": 0.5, "u": 0.1, "v": 0.1, "r": 0.03, "u_log": 0.1}
"""Scales of J in FORMAT.md, beside 0.02 L for the position."""
NOISE = {"x_north": "position_m", "y_east": "position_m", "psi": "heading_deg", "u": "gps_velocity_m_s"}
NOISE |= {"v": "gps_velocity_m_s", "r": "yaw_rate_deg_s", "u_log": "log_m_s"}
ANGLES = {"from_deg", "toward_deg"}
ORACLE = {
    "c0deca8": 0.76333, "c2c3ac2": 0.50114, "c31b6df": 4.11456, "c35df2d": 1.17263, "c62694e": 0.58446,
    "c6ff9c2": 0.57109, "c8cb30c": 0.49360, "c9d9828": 0.74684, "ca628da": 0.72186, "cbf2f0a": 0.87123,
    "cd0e8f7": 1.25663, "cf0c674": 1.26636, "cfb11fe": 0.56339,
}  # fmt: skip
"""J of the true effects in the practice cases by the trial's referee, at bdc5146; one effect is unknown to it."""


def practice(tree: Tree) -> Result:
    """Cases whose answers are known; the tool gets copies without them."""
    folder = tree.data("concealed", "practice")
    cases = sorted(path.parent for path in folder.glob("*/answers.json"))
    if not cases:
        raise NothingToMeasureError(f"{folder} holds no case with an answers.json")
    marks = {case.name: _practice_case(tree, case) for case in cases}
    rows = list(marks.values())
    parameters = [p for row in rows for p in row["parameters"]]
    gaps = [row for row in rows if row["share"] is not None]
    closed = sum(row["share"] * (row["J before"] - row["J oracle"]) for row in gaps)
    overlaps = [row["overlap"] for row in rows if row["overlap"] is not None]
    metrics = {
        "failed cases": sum(row["failed"] is not None for row in rows),
        "false alarms": sum(row["false alarm"] for row in rows),
        "first names right": sum(row["first right"] for row in rows),
        "all names of a case right": sum(row["names right"] for row in rows),
        "parameters right": sum(p["right"] for p in parameters),
        "parameters covered by two standard errors": sum(p["covered"] for p in parameters),
        "interval overlap": mean(overlaps) if overlaps else None,
        "share of the gap, all together": closed / sum(r["J before"] - r["J oracle"] for r in gaps) if gaps else None,
        "share of the gap, median": median(row["share"] for row in gaps) if gaps else None,
        "J after, mean": mean(inf if row["J after"] is None else row["J after"] for row in rows),
        "CPU seconds of a case, median": median(row["cpu_s"] for row in rows),
    }
    return Result(metrics, marks)


def _practice_case(tree: Tree, case: Path) -> dict[str, Any]:
    """Diagnose a case and mark the answer."""
    copy = tree.runs / "practice_cases" / case.name
    shutil.copytree(case, copy, ignore=shutil.ignore_patterns("answers.json"), dirs_exist_ok=True)
    words = (f"cases={copy}", "out={out}", "workers=1")
    done = tree.run(f"practice/{case.name}", DIAGNOSE, *words, may_fail=True)
    path = done.out / case.name / ANSWER
    truth = read(case / "answers.json")["effects"]
    answer = read(path) if path.is_file() else {"verdict": "none", "effects": []}
    row = {"failed": None if path.is_file() else done.last_line, "cpu_s": done.cpu_s, "wall_s": done.wall_s}
    row |= {"truth": [effect["name"] for effect in truth], "verdict": answer["verdict"]}
    return row | _name_marks(answer, truth, read(case / "manifest.json")) | _gap_marks(case, path.parent, bool(truth))


def _name_marks(answer: Mapping[str, Any], truth: Sequence[Mapping[str, Any]], manifest: Any) -> dict[str, Any]:
    """Marks for names, parameters and intervals."""
    said = answer["effects"][: max(len(truth), 1)] if answer["verdict"] == "mismatch" else []
    names = [entry["name"] for entry in said]
    alike = [{effect["name"], *effect["equivalent_names"]} for effect in truth]
    parameters, overlap = list[dict[str, Any]](), None
    for effect, allowed in zip(truth, alike, strict=True):
        entry = next((e for e in said if e["name"] in allowed), None)
        if effect["intervals"] != "all":
            placed = entry or (said[0] if said else {"intervals": {}})
            overlap = _intersection_over_union(effect["intervals"], placed["intervals"], manifest)
        if entry and entry["name"] == effect["name"] != "unknown":
            given = entry["parameters"]
            parameters += [_parameter_marks(k, v, given.get(k)) for k, v in effect["parameters"].items()]
    right = all(any(name in allowed for name in names) for allowed in alike)
    return {
        "said": names or ["none"],
        "false alarm": not truth and answer["verdict"] == "mismatch",
        "first right": bool(truth) and bool(names) and any(names[0] in allowed for allowed in alike),
        "names right": right if truth else not names,
        "parameters": parameters,
        "overlap": overlap,
    }


def _parameter_marks(name: str, true: float, given: Sequence[Any] | None) -> dict[str, Any]:
    """Whether a parameter is within 10 % (a direction within 10 deg) or two standard errors."""
    value, error = (None, 0.0) if given is None else (given[0], given[1] or 0.0)
    if value is None:
        return {"name": name, "true": true, "value": None, "error": None, "right": False, "covered": False}
    miss = abs((value - true + 180) % 360 - 180) if name in ANGLES else abs(value - true)
    allowed = 10.0 if name in ANGLES else 0.1 * abs(true)
    marks = {"right": miss <= max(allowed, 2 * error), "covered": miss <= 2 * error}
    return {"name": name, "true": true, "value": value, "error": error} | marks


def _intersection_over_union(true: Any, said: Any, manifest: Mapping[str, Any]) -> float:
    """Overlap of intervals over all runs of a case, to the second."""
    both = either = 0
    for run in manifest["runs"]:
        seconds = np.arange(int(run["duration_s"]))
        a, b = (_acting(which, run["run"], seconds) for which in (true, said))
        both, either = both + int((a & b).sum()), either + int((a | b).sum())
    return both / either if either else 1.0


def _acting(intervals: Any, run: str, seconds: np.ndarray) -> np.ndarray:
    """In which seconds of a run an effect acts."""
    if isinstance(intervals, str):
        return np.ones(len(seconds), bool)
    acts = np.zeros(len(seconds), bool)
    for start, end in intervals.get(run) or []:
        acts |= (seconds >= start) & (seconds < end)
    return acts


def _gap_marks(case: Path, answer: Path, present: bool) -> dict[str, Any]:
    """J before and after, and the share of the gap that was closed."""
    before, after = (_total_error(case, answer / "predictions" / when) for when in ("before", "after"))
    best = ORACLE.get(case.name) if present else None
    known = before is not None and after is not None and best is not None
    share = max((before - after) / (before - best), -1.0) if known else None
    return {"J before": before, "J after": after, "J oracle": best, "share": share}


def _total_error(case: Path, predictions: Path) -> float | None:
    """J of predictions, recomputed from the recordings; None if a prediction is missing, too short or infinite."""
    manifest, squares = read(case / "manifest.json"), list[dict[str, float]]()
    for run in manifest["runs"]:
        path = predictions / f"{run['run']}.csv"
        if run["split"] != "held_out":
            continue
        recorded = _recorded_run(case / run["file"], manifest["nominal_noise_sd"])
        recorded = recorded[recorded["t"] >= manifest["warmup_s"]].reset_index(drop=True)
        predicted = pd.read_csv(path) if path.is_file() else recorded[:0]
        if len(predicted) != len(recorded):
            return None
        squares.append(_square_errors(recorded, predicted))
    scales = SCALES | {"pos": 0.02 * manifest["particulars"]["length_m"]}
    total = sqrt(mean(mean(s[c] for s in squares) / scale**2 for c, scale in scales.items()))
    return total if isfinite(total) else None


def _recorded_run(path: Path, noise: Mapping[str, float]) -> pd.DataFrame:
    """A recording without its outliers."""
    table = pd.read_csv(path)
    known = table["psi"].notna()
    table.loc[known, "psi"] = np.degrees(np.unwrap(np.radians(table.loc[known, "psi"])))
    for channel, name in NOISE.items():
        middle = table[channel].rolling(7, center=True, min_periods=3).median()
        table.loc[(table[channel] - middle).abs() > 8 * noise[name] + 0.01, channel] = np.nan
    return table


def _square_errors(recorded: pd.DataFrame, predicted: pd.DataFrame) -> dict[str, float]:
    """Mean square error of each channel, gaps of the recording left out."""
    miss = {c: (predicted[c] - recorded[c])[recorded[c].notna()] for c in SCALES}
    miss["psi"] = (miss["psi"] + 180) % 360 - 180
    there = recorded["x_north"].notna() & recorded["y_east"].notna()
    miss["pos"] = np.hypot(predicted["x"] - recorded["x_north"], predicted["y"] - recorded["y_east"])[there]
    return {c: float((m**2).mean(skipna=False)) for c, m in miss.items()}
