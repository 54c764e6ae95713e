"""When a force acts: the times in each run between which it explains most, found on a grid."""

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.effect import Effect
from studies.concealed_trial.rivals.package import Hypothesis
from studies.concealed_trial.rivals.whitened import WhitenedRuns

TIMES = frozenset(f"{what}{number}_s" for what in ("start", "end") for number in ("", "_2", "_3"))
"""Parameters that are found on the grid, or stay where they are; least squares cannot move them."""
NEVER, ALWAYS = 7000.0, (-1e4, 1e5)
"""Start and end of an event that a run does not have, and of one that lasts all the time [s]."""
GRID, SHORTEST = 8.0, 4
"""Time between the times that are tried [s], and least number of such steps in an event."""
WORTH = 6.0
"""Gain in squared deviations below which a run has no event."""


def timed(effect: Effect) -> list[int]:
    """Columns of an effect's times.

    Args:
        effect: The effect.

    Returns:
        None for an effect that acts throughout, one for an onset, two for an interval.
    """
    return [k for k, p in enumerate(effect.declared) if p.per_run and np.isfinite(p.starts[0])]


def placed(
    data: WhitenedRuns, rest: Hypothesis, effect: Effect, values: Float[np.ndarray, " p"], scaled: bool = True
) -> tuple[Float[np.ndarray, "runs p"], float]:
    """The best times of an event in every run.

    Args:
        data: The runs.
        rest: What else acts.
        effect: The event.
        values: Its values; times do not matter.
        scaled: Whether the first of them (the size) is free.

    Returns:
        Values of every run, and the squared deviations that they save.
    """
    left = data.tried(rest.effects, [v[:, None] for v in rest.values])
    found = [_scan(data, run, left[part], effect, values, scaled) for run, part in enumerate(data.parts)]
    table = np.repeat(values[None], len(found), axis=0)
    for run, (times, _, gain) in enumerate(found):
        table[run, timed(effect)] = times if gain > WORTH else NEVER
    gains = np.array([gain for *_, gain in found])
    if scaled and gains.max() > WORTH:
        p = effect.declared[0]
        factor = np.average([f for _, f, _ in found], weights=gains * (gains > WORTH))
        # Pressures go with the square of a speed, forces with themselves.
        table[:, 0] = np.clip(values[0] * (np.sqrt(factor) if p.name == "speed" else factor), p.low, p.high)
    return table, float(gains[gains > WORTH].sum())


def _scan(
    data: WhitenedRuns, run: int, left: Float[np.ndarray, "b 6"], effect: Effect, values: np.ndarray, scaled: bool
) -> tuple[np.ndarray, float, float]:
    """Times, factor on the size and gain of the best interval of one run."""
    t = data.tracks[run]
    columns, always = timed(effect), values.copy()
    always[columns] = ALWAYS[: len(columns)]
    grid = np.arange(t.run.time[0], t.run.time[-1] + GRID, GRID)
    push = t.contribution(effect, always[None])[1] / t.unit[:3, None] * (t.run.time[:, None, None] < grid)
    # What acts up to each time is made white once: every interval is a difference of two.
    upto = t.averaged(np.concatenate([push, np.zeros_like(push)], axis=1))
    white = data.alone(run, upto)
    along, gram = white.T @ data.alone(run, left[..., None])[:, 0], white.T @ white
    start, end = np.triu_indices(len(grid), SHORTEST)
    if len(columns) == 1:
        start, end = start[end == len(grid) - 1], end[end == len(grid) - 1]
    size = gram[start, start] + gram[end, end] - 2 * gram[start, end] + 1e-9
    product = along[end] - along[start]
    factor = np.maximum(product / size, 0.0) if scaled else np.ones_like(size)
    gain = factor * (2 * product - factor * size)
    best = int(gain.argmax())
    return np.array([grid[start[best]], grid[end[best]]])[: len(columns)], float(factor[best]), float(gain[best])
