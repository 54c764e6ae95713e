"""Totals over the cases of a trial, with their intervals, and the same as Markdown."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from studies.concealed_trial import summaries
from studies.concealed_trial.strength import STRENGTHS
from studies.concealed_trial.summaries import Rows, bootstrap, calibration, rate


def scoreboard(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Totals of a tool.

    Args:
        rows: What :func:`studies.concealed_trial.score.score_case` gave for each case.

    Returns:
        ``totals``, their ``intervals`` where they are no shares, ``by_strength``, ``by_family``, ``by_channels``,
        ``confusion`` and ``calibration``.
    """
    effects = [effect for row in rows for effect in row["effects"]]
    strengths = [s for s in STRENGTHS if any(row["strongest"] == s for row in rows)]
    families = sorted({effect["family"] for effect in effects})

    def part(key: str, value: str) -> dict[str, Any]:
        """Cases and effects of one family, strength or channel set; the strength of a case is that of its strongest."""
        with_it = [row for row in rows if value == row[key] or value in (row[key] or ())]
        of_it = [effect for effect in effects if effect[key.replace("strongest", "strength")] == value]
        return _part(with_it, of_it)

    recorders = sorted({str(row["channels"]) for row in rows})
    by_recorder = {c: [row for row in rows if row["channels"] == c] for c in recorders}
    return {
        "totals": _totals(rows, effects),
        "intervals": {name: bootstrap(rows, statistic) for name, statistic in STATISTICS.items()},
        "by_strength": {s: part("strongest", s) for s in strengths},
        "by_family": {f: part("family", f) for f in families},
        "by_channels": {c: _part(r, [e for row in r for e in row["effects"]]) for c, r in by_recorder.items()},
        "confusion": _confusion(rows),
        "calibration": calibration([pair for row in rows for pair in row["probabilities"].values()]),
        "notes": {row["case"]: row["note"] for row in rows if row["note"]},
    }


STATISTICS: dict[str, Callable[[Rows], float | None]] = {
    "place, F1": summaries.place_f1,
    "interval overlap, mean": summaries.overlap_mean,
    "parameter error, median": summaries.parameter_error,
    "Brier score, sum over names": summaries.brier,
    "calibration error": summaries.calibration_error,
    "share of the gap closed, mean": summaries.share_mean,
    "share of the gap closed, median": summaries.share_median,
    "share of the gap closed, all together": summaries.share_together,
    "share of the gap closed by the stated effects alone, mean": summaries.share_stated,
}
"""Scores that are no shares of marks: what each is stands at its function."""


def _totals(rows: Rows, effects: Rows) -> dict[str, Any]:
    """The scores that the format names."""
    parameters = [p for effect in effects for p in effect["parameters"]]
    said_unknown = ["unknown" in row["truth"] for row in rows if row["first"] == "unknown"]
    shares = {
        "answered": rate(row["answered"] for row in rows),
        "false alarms": rate(row["false_alarm"] for row in rows),
        "detection": rate(row["detected"] for row in rows),
        "first name": rate(row["first_right"] for row in rows),
        "first name, listed effects": rate(row["first_right"] for row in rows if "unknown" not in row["truth"]),
        "first two names": rate(row["first_two_right"] for row in rows),
        "both names of pairs": rate(row["both_right"] for row in rows),
        "all names of triples": rate(row["all_right"] for row in rows if len(row["truth"]) == 3),
        "family right": rate(row["family_right"] for row in rows),
        "place": rate(effect["place_right"] for effect in effects),
        "parameters right": rate(p["right"] for p in parameters),
        "covered by two standard errors": rate(p["covered"] for p in parameters),
        "unknown found": rate(row["unknown_right"] for row in rows),
        "unknown said rightly": rate(said_unknown),
        "unknown wrongly said": rate(row["unknown_wrong"] for row in rows),
        "predictions made worse": rate(row["harmed"] for row in rows),
    }
    if any("loss" in row for row in rows):
        shares["of the losses, limits"] = rate(row["loss"] == "limit" for row in rows if row.get("loss"))
    return {"cases": len(rows)} | shares | {name: statistic(rows) for name, statistic in STATISTICS.items()}


def label_losses(rows: Sequence[dict[str, Any]], ideal: Rows) -> None:
    """Say of each loss whether it could have been helped.

    A loss is a false alarm, or a first name that is wrong. It is a ``limit`` where the ideal observer loses the same
    case, and a ``defect`` where it does not.

    Args:
        rows: A tool's cases; each gets ``loss``: limit, defect or None.
        ideal: Those of the ideal observer, in the same order.
    """
    for row, best in zip(rows, ideal, strict=True):
        row["loss"] = ("limit" if _lost(best) else "defect") if _lost(row) else None


def _lost(row: Mapping[str, Any]) -> bool:
    """Whether the first name is wrong, or a clean case raised an alarm."""
    return row["false_alarm"] is True or row["first_right"] is False


def _part(rows: Rows, effects: Rows) -> dict[str, Any]:
    """Scores of a part of the cases, and of a part of the effects."""
    parameters = [p for effect in effects for p in effect["parameters"]]
    return {
        "effects": len(effects),
        "detection": rate(row["detected"] for row in rows),
        "first name": rate(row["first_right"] for row in rows),
        "first two names": rate(row["first_two_right"] for row in rows),
        "named": rate(effect["named"] for effect in effects),
        "family right": rate(row["family_right"] for row in rows),
        "parameters right": rate(p["right"] for p in parameters),
        "parameter error, median": summaries.parameter_error(rows),
        "share of the gap closed, median": summaries.share_median(rows),
        "by the stated effects alone, mean": summaries.share_stated(rows),
    }


def _confusion(rows: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, int]]:
    """How often which first name was given for what; pairs under both names joined."""
    counts: dict[str, Counter[str]] = {}
    for row in rows:
        counts.setdefault(" + ".join(sorted(row["truth"])) or "none", Counter())[row["first"]] += 1
    return {truth: dict(counts[truth].most_common()) for truth in sorted(counts)}


def markdown(boards: Mapping[str, Mapping[str, Any]]) -> str:
    """Scoreboards as text, the totals of all tools side by side.

    Args:
        boards: Scoreboard of each tool.

    Returns:
        Markdown.
    """
    tools = list(boards)
    intervals = "Shares with 95 % Wilson intervals and the numbers behind them, other scores with bootstrap intervals."
    lines = ["# Concealed trial", "", intervals, ""]
    names = list(dict.fromkeys(name for tool in tools for name in boards[tool]["totals"]))
    rows = [[name, *(_total(boards[tool], name) for tool in tools)] for name in names]
    lines += _table(["score", *tools], rows)
    for tool in tools:
        lines += ["", f"## {tool}", ""]
        lines += _sections(boards[tool])
    return "\n".join(lines) + "\n"


def _sections(board: Mapping[str, Any]) -> list[str]:
    """The tables of one tool."""
    lines = []
    titles = {"By strength": "by_strength", "By family": "by_family", "By channel set": "by_channels"}
    for title, key in titles.items():
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


def _total(board: Mapping[str, Any], name: str) -> str:
    """A total with its interval."""
    bounds = board["intervals"].get(name)
    text = _cell(board["totals"].get(name))
    return text if bounds is None else f"{text} [{bounds[0]:.3f}, {bounds[1]:.3f}]"


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
