"""Totals over the cases of a trial, with Wilson intervals, and the same as Markdown."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from math import sqrt
from typing import Any

import numpy as np

BINS = 10
"""Bins of the calibration."""
Z = 1.959964
"""Two-sided 95 % quantile of the normal distribution."""


def wilson(right: int, count: int) -> tuple[float, float]:
    """95 % interval of a share.

    Args:
        right: How many of them.
        count: Of how many.

    Returns:
        Lower and upper bound; 0 and 1 without any.

    Source:
        Wilson 1927.
    """
    if not count:
        return 0.0, 1.0
    p, weight = right / count, Z**2 / count
    centre = (p + weight / 2) / (1 + weight)
    half = Z * sqrt(p * (1 - p) / count + weight / (4 * count)) / (1 + weight)
    return max(0.0, centre - half), min(1.0, centre + half)


def rate(marks: Iterable[bool | None]) -> dict[str, Any] | None:
    """Share of marks that are true, of those that apply.

    Args:
        marks: True, False, or None where it does not apply.

    Returns:
        ``right``, ``count``, ``share`` and its bounds ``low`` and ``high``; None if none applies.
    """
    known = [bool(mark) for mark in marks if mark is not None]
    if not known:
        return None
    low, high = wilson(sum(known), len(known))
    return {"right": sum(known), "count": len(known), "share": sum(known) / len(known), "low": low, "high": high}


def scoreboard(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Totals of a tool.

    Args:
        rows: What :func:`studies.concealed_trial.score.score_case` gave for each case.

    Returns:
        ``totals``, ``by_strength``, ``by_family``, ``confusion`` and ``calibration``.
    """
    effects = [effect for row in rows for effect in row["effects"]]
    strengths = [s for s in ("weak", "moderate", "strong") if any(e["strength"] == s for e in effects)]
    families = sorted({effect["family"] for effect in effects})
    return {
        "totals": _totals(rows, effects),
        "by_strength": {s: _part(rows, effects, "strength", s) for s in strengths},
        "by_family": {f: _part(rows, effects, "family", f) for f in families},
        "confusion": _confusion(rows),
        "calibration": calibration([pair for row in rows for pair in row["probabilities"].values()]),
        "notes": {row["case"]: row["note"] for row in rows if row["note"]},
    }


def _totals(rows: Sequence[Mapping[str, Any]], effects: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The scores that the format names."""
    parameters = [p for effect in effects for p in effect["parameters"]]
    overlaps = [effect["overlap"] for effect in effects if effect["overlap"] is not None]
    shares = [row["share"] for row in rows if row["share"] is not None]
    closable = [row for row in rows if row["share"] is not None]
    closed = sum(row["share"] * (row["j_before"] - row["j_true_model"]) for row in closable)
    possible = sum(row["j_before"] - row["j_true_model"] for row in closable)
    bins = calibration([pair for row in rows for pair in row["probabilities"].values()])
    counted = sum(b["count"] for b in bins)
    said_unknown = [row["truth"] == ["unknown"] for row in rows if row["first"] == "unknown"]
    return {
        "cases": len(rows),
        "answered": rate(row["answered"] for row in rows),
        "false alarms": rate(row["false_alarm"] for row in rows),
        "detection": rate(row["detected"] for row in rows),
        "first name": rate(row["first_right"] for row in rows),
        "first name, listed effects": rate(row["first_right"] for row in rows if "unknown" not in row["truth"]),
        "both names of pairs": rate(row["both_right"] for row in rows),
        "family": rate(row["family_right"] for row in rows),
        "place": rate(effect["place_right"] for effect in effects),
        "interval overlap, mean": float(np.mean(overlaps)) if overlaps else None,
        "parameters right": rate(p["right"] for p in parameters),
        "covered by two standard errors": rate(p["covered"] for p in parameters),
        "unknown found": rate(row["unknown_right"] for row in rows),
        "unknown said rightly": rate(said_unknown),
        "Brier score, sum over names": float(np.mean([row["brier"] for row in rows])) if rows else None,
        "calibration error": sum(b["count"] * abs(b["said"] - b["found"]) for b in bins) / counted if counted else None,
        "share of the gap closed, median": float(np.median(shares)) if shares else None,
        "share of the gap closed, all together": closed / possible if possible else None,
        "predictions made worse": rate(row["harmed"] for row in rows),
    }


def _part(
    rows: Sequence[Mapping[str, Any]], effects: Sequence[Mapping[str, Any]], key: str, value: str
) -> dict[str, Any]:
    """Scores of the cases, and of the effects, of one strength or family."""
    with_it = [row for row in rows if value in row[key]]
    of_it = [effect for effect in effects if effect[key] == value]
    shares = [row["share"] for row in with_it if row["share"] is not None]
    return {
        "effects": len(of_it),
        "detection": rate(row["detected"] for row in with_it),
        "named": rate(effect["named"] for effect in of_it),
        "family": rate(row["family_right"] for row in with_it),
        "parameters right": rate(p["right"] for effect in of_it for p in effect["parameters"]),
        "share of the gap closed, median": float(np.median(shares)) if shares else None,
    }


def _confusion(rows: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, int]]:
    """How often which first name was given for what; pairs under both names joined."""
    counts: dict[str, Counter[str]] = {}
    for row in rows:
        counts.setdefault(" + ".join(sorted(row["truth"])) or "none", Counter())[row["first"]] += 1
    return {truth: dict(counts[truth].most_common()) for truth in sorted(counts)}


def calibration(pairs: Iterable[tuple[float, int]]) -> list[dict[str, Any]]:
    """Stated probabilities against how often they were right.

    Args:
        pairs: Probability and 1 if the effect was present; probabilities of 0 are left out.

    Returns:
        For each bin that is not empty its bounds, count, mean probability and share present.
    """
    known = np.array([pair for pair in pairs if pair[0] > 0]).reshape(-1, 2)
    at = np.minimum((known[:, 0] * BINS).astype(int), BINS - 1)
    bins = []
    for k in sorted(set(at.tolist())):
        part = known[at == k]
        low, high = wilson(int(part[:, 1].sum()), len(part))
        bins.append({
            "from": k / BINS,
            "to": (k + 1) / BINS,
            "count": len(part),
            "said": float(part[:, 0].mean()),
            "found": float(part[:, 1].mean()),
            "low": low,
            "high": high,
        })  # fmt: skip
    return bins


def markdown(boards: Mapping[str, Mapping[str, Any]]) -> str:
    """Scoreboards as text, the totals of all tools side by side.

    Args:
        boards: Scoreboard of each tool.

    Returns:
        Markdown.
    """
    tools = list(boards)
    lines = ["# Concealed trial", "", "Shares with the 95 % Wilson interval and the numbers behind them.", ""]
    totals = [boards[tool]["totals"] for tool in tools]
    lines += _table(["score", *tools], [[name, *(_cell(t[name]) for t in totals)] for name in totals[0]])
    for tool in tools:
        lines += ["", f"## {tool}", ""]
        lines += _sections(boards[tool])
    return "\n".join(lines) + "\n"


def _sections(board: Mapping[str, Any]) -> list[str]:
    """The tables of one tool."""
    lines = []
    for title, key in (("By strength", "by_strength"), ("By family", "by_family")):
        parts = board[key]
        if parts:
            columns = list(next(iter(parts.values())))
            rows = [[name, *(_cell(part[c]) for c in columns)] for name, part in parts.items()]
            lines += [f"### {title}", "", *_table([key.removeprefix("by_"), *columns], rows), ""]
    rows = [[truth, ", ".join(f"{n} {k}" for n, k in said.items())] for truth, said in board["confusion"].items()]
    lines += ["### Truth and first name", "", *_table(["truth", "first name and how often"], rows), ""]
    bins = [
        [f"{b['from']:.1f} to {b['to']:.1f}", str(b["count"]), f"{b['said']:.2f}", f"{b['found']:.2f}"]
        + [f"{b['low']:.2f} to {b['high']:.2f}"]
        for b in board["calibration"]
    ]
    lines += ["### Calibration", "", *_table(["probability", "count", "mean", "present", "95 %"], bins)]
    if board["notes"]:
        lines += ["", "### Answers that could not be used", ""]
        lines += [f"- {case}: {note}" for case, note in board["notes"].items()]
    return lines


def _cell(value: Any) -> str:
    """One score as text."""
    if value is None:
        return "-"
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        return f"{value:.3f}"
    return f"{value['share']:.0%} [{value['low']:.0%}, {value['high']:.0%}] {value['right']}/{value['count']}"


def _table(head: list[str], rows: list[list[str]]) -> list[str]:
    """A Markdown table."""
    return [f"| {' | '.join(line)} |" for line in [head, ["---"] * len(head), *rows]]
