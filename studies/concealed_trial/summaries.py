"""Statistics over the cases of a trial, with intervals: Wilson for shares, bootstrap over cases for all else."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from math import sqrt
from typing import Any

import numpy as np

BINS = 10
"""Bins of the calibration."""
RESAMPLES = 400
"""Resampled trials of a bootstrap interval."""
Z = 1.959964
"""Two-sided 95 % quantile of the normal distribution."""

Rows = Sequence[Mapping[str, Any]]


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


def bootstrap(rows: Rows, statistic: Callable[[Rows], float | None]) -> tuple[float, float] | None:
    """95 % interval of a statistic over cases that could have been others.

    Args:
        rows: The cases.
        statistic: What is taken of them; None where it does not apply.

    Returns:
        The percentiles at 2.5 and 97.5 % over trials resampled by case; None if it does not apply to these.

    Source:
        Efron 1979, with a fixed seed.
    """
    if statistic(rows) is None:
        return None
    rng = np.random.default_rng(0)
    again = [statistic([rows[k] for k in rng.integers(len(rows), size=len(rows))]) for _ in range(RESAMPLES)]
    low, high = np.quantile([value for value in again if value is not None], [0.025, 0.975])
    return float(low), float(high)


def place_f1(rows: Rows) -> float | None:
    """F1 of the places over all cases: 2 TP / (2 TP + FP + FN).

    An effect is a true positive if an entry that the answer holds to be present states its place (one that counts as
    right); such entries that meet no effect are false positives, on clean cases too.

    Args:
        rows: The cases.

    Returns:
        Between 0 and 1; None if nothing was there or said.
    """
    true, extra, missed = np.sum([row["places"] for row in rows], axis=0) if rows else (0, 0, 0)
    return float(2 * true / (2 * true + extra + missed)) if true + extra + missed else None


def overlap_mean(rows: Rows) -> float | None:
    """Mean intersection over union of the intervals of confined effects; what is not named has none.

    Args:
        rows: The cases.

    Returns:
        Between 0 and 1; None without confined effects.
    """
    return _mean([effect["overlap"] for row in rows for effect in row["effects"] if effect["overlap"] is not None])


def parameter_error(rows: Rows) -> float | None:
    """Median error of the stated parameters over their true values; of directions in rad.

    Args:
        rows: The cases.

    Returns:
        Median over the parameters of all effects that were named; None without any.
    """
    errors = [p["error"] for row in rows for effect in row["effects"] for p in effect["parameters"]]
    return _median([error for error in errors if error is not None])


def share_mean(rows: Rows) -> float | None:
    """Mean share of the closable gap that the tool's predictions closed, by case; -1 at least.

    Args:
        rows: The cases.

    Returns:
        The mean over cases with a gap that can be closed; None without.
    """
    return _mean([row["share"] for row in rows if row["share"] is not None])


def share_median(rows: Rows) -> float | None:
    """Median of the same.

    Args:
        rows: The cases.

    Returns:
        The median; None without cases with a gap.
    """
    return _median([row["share"] for row in rows if row["share"] is not None])


def share_together(rows: Rows) -> float | None:
    """What was closed of all gaps over what could be closed: cases weigh by their gap.

    Args:
        rows: The cases.

    Returns:
        The share; None without cases with a gap.
    """
    closable = [row for row in rows if row["share"] is not None]
    possible = sum(row["j_before"] - row["j_true_model"] for row in closable)
    closed = sum(row["share"] * (row["j_before"] - row["j_true_model"]) for row in closable)
    return closed / possible if possible else None


def share_stated(rows: Rows) -> float | None:
    """Mean share that the stated effects close alone, in the referee's simulator with nominal coefficients.

    Args:
        rows: The cases.

    Returns:
        The mean over cases with a gap whose effects are all listed; None without.
    """
    return _mean([row["share_stated"] for row in rows if row["share_stated"] is not None])


def calibration_error(rows: Rows) -> float | None:
    """Mean distance between what was said and what was found, over bins of the probability, weighted by count.

    Args:
        rows: The cases.

    Returns:
        The expected calibration error; None if nothing was said.
    """
    bins = calibration([pair for row in rows for pair in row["probabilities"].values()])
    counted = sum(b["count"] for b in bins)
    return sum(b["count"] * abs(b["said"] - b["found"]) for b in bins) / counted if counted else None


def brier(rows: Rows) -> float | None:
    """Mean over cases of the squared errors of the probabilities, summed over names.

    Args:
        rows: The cases.

    Returns:
        The score; None without cases.
    """
    return _mean([row["brier"] for row in rows])


def _mean(values: Sequence[float]) -> float | None:
    """Mean, or None of nothing."""
    return float(np.mean(values)) if values else None


def _median(values: Sequence[float]) -> float | None:
    """Median, or None of nothing."""
    return float(np.median(values)) if values else None


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
