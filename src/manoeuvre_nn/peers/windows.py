"""Events within a run: when a force acts, found as the stretch of time in which it explains most."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.peers.residual import Smooth
from manoeuvre_nn.peers.stand import Guess

NEVER = 7000.0
"""Start and end of an event that a run does not have [s]."""
ALWAYS = (-1e4, 1e5)
"""Start and end of an event that lasts all the time [s]."""
WORTH = 6.0
"""Gain in squared deviations below which a run has no event."""


def timed(effect: Effect) -> list[int]:
    """Columns of an effect's times.

    Args:
        effect: The effect.

    Returns:
        None for an effect that acts throughout, one for an onset, two for an interval.
    """
    return [c for c, p in enumerate(effect.declared) if p.per_run]


def scan(
    track: Smooth, effect: Effect, values: Float[np.ndarray, " p"], left: Float[np.ndarray, "n 5"],
    weight: Float[np.ndarray, "5 5"],
) -> tuple[Float[np.ndarray, " p"], float]:  # fmt: skip
    """Times between which a force of given size explains most of the errors.

    The squared deviations that it saves add up over the samples, so that the best interval is the one with the largest
    sum.

    Args:
        track: The run.
        effect: The force.
        values: Its parameters, times among them.
        left: Errors at every sample without it.
        weight: Covariance of the errors at a sample, their correlation in time taken in.

    Returns:
        The values with new times, and what is saved.
    """
    columns, always = timed(effect), values.copy()
    always[columns] = ALWAYS[: len(columns)]
    _, pushed = track.contribution(effect, always[None])
    root = np.linalg.cholesky(np.linalg.inv(weight)).T
    unit = pushed[..., 0] / track.unit[:3]
    push, target = unit @ root[:, :3].T, left @ root.T
    saved = np.concatenate([[0.0], np.cumsum((2 * target * push - push * push).sum(axis=1))])
    time = np.append(track.run.time, track.run.time[-1] + track.run.step)
    if len(columns) == 1:
        start, end = int(saved.argmin()), len(saved) - 1
    else:
        end = int((saved - np.minimum.accumulate(saved)).argmax())
        start = int(saved[: end + 1].argmin())
    gain = float(saved[end] - saved[start])
    new = values.copy()
    new[columns] = [time[start], time[end]][: len(columns)] if gain > WORTH else NEVER
    return new, max(gain, 0.0)


def placed(
    tracks: Sequence[Smooth], effect: Effect, values: Float[np.ndarray, "runs p"], left: Sequence[np.ndarray],
    weight: Float[np.ndarray, "5 5"],
) -> tuple[Float[np.ndarray, "runs p"], float]:  # fmt: skip
    """The same in several runs.

    Args:
        tracks: The runs.
        effect: The force.
        values: Its parameters in each.
        left: Errors at every sample of each without it.
        weight: Covariance of the errors at a sample.

    Returns:
        Values with new times, and what is saved in all.
    """
    found = [scan(t, effect, v, e, weight) for t, v, e in zip(tracks, values, left, strict=True)]
    return np.stack([v for v, _ in found]), sum(gain for _, gain in found)


def intervals(guess: Guess, effect: int, tracks: Sequence[Smooth]) -> dict[str, list[list[float]]] | None:
    """When an effect acts.

    Args:
        guess: Effects and values.
        effect: Number of the effect.
        tracks: The runs, one a row of the values.

    Returns:
        Run and its intervals [s]; None if it acts throughout.
    """
    columns = timed(guess.effects[effect])
    if not columns:
        return None
    found = {}
    for track, row in zip(tracks, guess.values[effect], strict=True):
        times = [*row[columns], track.run.time[-1]][:2]
        acts = times[0] < min(times[1], track.run.time[-1])
        found[track.run.name] = [[float(max(times[0], 0.0)), float(times[1])]] if acts else []
    return found
