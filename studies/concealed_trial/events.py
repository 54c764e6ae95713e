"""When a confined effect acts: once or twice, in all runs, in some or in one, at once or over minutes."""

from collections.abc import Sequence

import numpy as np

from studies.concealed_trial.helm import MANOEUVRE_START, Run

PATTERNS = {"every run": 0.4, "twice": 0.2, "some runs": 0.2, "one run": 0.2}
"""In which runs, and how often in each; the number is its share. Wind that sets in does so once."""
RAMPS = (60.0, 240.0)
"""How long wind takes to set in where it does not do so at once [s]."""
FIRST = 80.0
"""Earliest beginning [s]."""


def draw_intervals(
    rng: np.random.Generator, confined: str, runs: Sequence[Run]
) -> tuple[dict[str, list[list[int]]] | str, float]:
    """Intervals of an effect, others in each run, and how long it takes to set in.

    Args:
        rng: Source of chance.
        confined: ``""``, ``interval`` or ``onset``.
        runs: The runs.

    Returns:
        ``"all"``, or for each run its intervals [s]; the ramp [s], which only an onset has.
    """
    if not confined:
        return "all", 0.0
    pattern = str(rng.choice(list(PATTERNS), p=list(PATTERNS.values())))
    acting = _acting(rng, pattern, runs)
    slow = confined == "onset" and rng.uniform() < 0.5
    ramp = float(np.round(rng.uniform(*RAMPS))) if slow else 0.0
    intervals: dict[str, list[list[int]]] = {}
    for run in runs:
        if run.name not in acting:
            intervals[run.name] = []
        elif confined == "onset":
            earliest = max(FIRST, MANOEUVRE_START + 0.5 * ramp)
            intervals[run.name] = [[int(rng.uniform(earliest, max(0.45 * run.duration, earliest + 1))), run.duration]]
        elif pattern == "twice":
            intervals[run.name] = _twice(rng, run.duration)
        else:
            start = int(rng.uniform(FIRST, 0.45 * run.duration))
            intervals[run.name] = [[start, start + int(rng.uniform(0.22, 0.4) * run.duration)]]
    return intervals, ramp


def _acting(rng: np.random.Generator, pattern: str, runs: Sequence[Run]) -> set[str]:
    """Names of the runs in which it acts: one to fit at least, and one held out unless it is the only one."""
    fit, held_out = ([str(run.name) for run in runs if run.split == split] for split in ("fit", "held_out"))
    if pattern == "one run":
        return {str(rng.choice(fit))}
    if pattern != "some runs":
        return {run.name for run in runs}
    some: set[str] = set()
    for names in filter(None, (fit, held_out)):
        count = max(1, len(names) // 2)
        some |= {str(name) for name in rng.choice(names, count, replace=False)}
    return some


def _twice(rng: np.random.Generator, duration: int) -> list[list[int]]:
    """Two intervals with a pause of a tenth of the run at least."""
    start = int(rng.uniform(FIRST, FIRST + 0.1 * duration))
    end = start + int(rng.uniform(0.12, 0.22) * duration)
    again = end + int(rng.uniform(0.1, 0.25) * duration)
    return [[start, end], [again, min(again + int(rng.uniform(0.12, 0.22) * duration), duration)]]
