"""When a confined effect acts: its intervals in every run, found by what each part of the time gains."""

from collections.abc import Sequence
from dataclasses import replace
from math import log

import numpy as np

from studies.concealed_trial.effects import Kind
from studies.concealed_trial.events import RAMPS
from studies.concealed_trial.observer_model import Evaluation, Part

BIN, STEPS = 20, (8, 3, 1)
"""Resolution of the scan, and by what edges are then moved once or twice [s]."""
RAMP_TIMES = (0.0, *np.arange(RAMPS[0], RAMPS[1] + 1, 30))
"""Ramps that are tried [s]; every other wind sets in at once, as drawn."""
EDGE = 3.0
"""What an edge of an interval costs in log evidence: it is one of some twenty that could be told apart."""
EARLIEST = 60
"""Before the manoeuvre nothing sets in [s]."""
FACTORS, WIND_POWER = 9, 1.5
"""Sizes that are tried, and the power of its speed that the force of a wind grows with while the ship moves."""


def _binned(evaluation: Evaluation, part: Part, beside: tuple[Part, ...]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """For each run the edges of its bins, and what the effect changes if it acts in one of them."""
    track, changed = evaluation.track, evaluation.process([(*beside, part), beside])
    runs, found, bins = np.array(track.runs), {}, list[np.ndarray]()
    for run in dict.fromkeys(track.runs):
        last = int(track.t[runs == run].max()) + 1
        edges = np.append(np.arange(EARLIEST, last - BIN, BIN), last)
        found[run] = edges, slice(len(bins), len(bins) + len(edges) - 1)
        bins += [(runs == run) & (track.t >= a) & (track.t < b) for a, b in zip(edges, edges[1:], strict=False)]
    # Along the reference a second knows nothing of those before: what acts throughout is cut into bins.
    pushed = (changed[..., :1] - changed[..., 1:]) * np.stack(bins, axis=1)[:, None]
    columns = evaluation.whitening.whiten(pushed, np.zeros((len(pushed), 8, len(bins))))
    return {run: (edges, columns[:, part]) for run, (edges, part) in found.items()}


def _intervals(columns: np.ndarray, misfit: np.ndarray, confined: str) -> tuple[list[tuple[int, int]], float]:
    """Bins from and to, and what they gain: for an onset the first one, else one interval or two."""
    gram, along = columns.T @ columns, -(columns.T @ misfit)
    count = len(along)
    corner = np.zeros((count + 1, count + 1))
    corner[1:, 1:] = gram.cumsum(0).cumsum(1)
    summed = np.append(0.0, along.cumsum())
    a, b = np.triu_indices(count + 1, 1)
    if confined == "onset":
        a, b = np.arange(count), np.full(count, count)

    def gains(taken: np.ndarray) -> np.ndarray:
        """What each interval gains beside the bins that are taken."""
        cross = np.append(0.0, (gram @ taken).cumsum())
        power = corner[b, b] - 2 * corner[a, b] + corner[a, a]
        return summed[b] - summed[a] - 0.5 * power - (cross[b] - cross[a])

    found: list[tuple[int, int]] = []
    taken, gained, cost = np.zeros(count), 0.0, EDGE if confined == "onset" else 2 * EDGE
    for _ in range(1 if confined == "onset" else 2):
        gain = gains(taken)
        free = np.append(0.0, taken.cumsum())
        gain = np.where(free[b] - free[a] > 0, -np.inf, gain)
        best = int(np.argmax(gain))
        if gain[best] < cost:
            break
        gained += float(gain[best]) - cost
        found.append((int(a[best]), int(b[best])))
        taken[a[best] : b[best]] = 1.0
    return sorted(found), gained


def sharpened(evaluation: Evaluation, part: Part, beside: tuple[Part, ...]) -> Part:
    """Edges and ramp moved by seconds as long as that explains more.

    Args:
        evaluation: The track.
        part: The effect.
        beside: Effects that act already.

    Returns:
        The effect at better intervals.
    """
    intervals_of: dict[str, list[list[int]]] = part.intervals  # type: ignore[assignment]
    onset = part.kind.confined == "onset"
    for step in STEPS:
        if onset:
            part = _least(evaluation, [replace(part, ramp=ramp) for ramp in RAMP_TIMES], beside)
        for run, intervals in intervals_of.items():
            for k, edge in ((k, edge) for k in range(len(intervals)) for edge in (0, 1)[: 2 - onset]):
                part = _moved_edge(evaluation, part, beside, (run, k, edge), step)
    return part


def _least(evaluation: Evaluation, tried: Sequence[Part], beside: tuple[Part, ...]) -> Part:
    """The one that leaves least."""
    left = np.sum(evaluation.misfits([(*beside, trial) for trial in tried]) ** 2, axis=0)
    return tried[int(np.argmin(left))]


def _moved_edge(
    evaluation: Evaluation, part: Part, beside: tuple[Part, ...], which: tuple[str, int, int], step: int
) -> Part:
    """The best of an edge as it is, earlier and later; the end of a run stays."""
    run, k, edge = which
    intervals: dict[str, list[list[int]]] = part.intervals  # type: ignore[assignment]
    tried = []
    for change in (0, -step, step, -2 * step, 2 * step):
        other = {name: [list(i) for i in parts] for name, parts in intervals.items()}
        other[run][k][edge] += change
        if other[run][k][0] < other[run][k][1]:
            tried.append(replace(part, intervals=other))
    return _least(evaluation, tried, beside)


def event_starts(
    evaluation: Evaluation,
    kind: Kind,
    beside: tuple[Part, ...],
    misfit: np.ndarray,
    grid: Sequence[dict[str, float]],
) -> list[Part]:
    """Confined effects with their intervals, from a grid over extras and sizes.

    What an effect does in a part of the time is found at one size and stretched to others.

    Args:
        evaluation: The track.
        kind: The kind.
        beside: Effects that act already.
        misfit: What they leave.
        grid: Combinations of the extras.

    Returns:
        The two that explain most; fewer if they do not pay.
    """
    found: list[tuple[float, Part]] = []
    middle = float(np.sqrt(kind.low * kind.high))
    for extras in grid:
        unit = Part(kind, middle, extras)
        binned = _binned(evaluation, unit, beside)
        for size in np.geomspace(kind.low, kind.high, FACTORS):
            stretch = (size / middle) ** (WIND_POWER if "angle" in extras else 1.0)
            intervals, gained = {}, 0.0
            for run, (at, columns) in binned.items():
                chosen, gain = _intervals(stretch * columns, misfit, kind.confined)
                intervals[run] = [[int(at[a]), int(at[b])] for a, b in chosen]
                gained += gain
            if gained > 0:
                found.append((gained, replace(unit, size=float(size), intervals=intervals)))
    found.sort(key=lambda one: -one[0])
    return [part for _, part in found[:2]]


def cost_of_times(parts: tuple[Part, ...]) -> float:
    """What the times of events cost in log evidence.

    Args:
        parts: Effects.

    Returns:
        For every onset one edge, for an interval two; for an onset the share of its ramp among those that are tried.
    """
    cost = 0.0
    for part in parts:
        if not isinstance(part.intervals, str):
            onset = part.kind.confined == "onset"
            cost += EDGE * sum(len(i) for i in part.intervals.values()) * (1 if onset else 2)
            cost += log(2 * (len(RAMP_TIMES) - 1 if part.ramp else 1)) if onset else 0.0
    return cost
