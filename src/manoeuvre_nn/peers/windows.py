"""Events within a run: when a force acts, found as the interval in which it explains most."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.peers.noise import Noise
from manoeuvre_nn.peers.residual import Smooth
from manoeuvre_nn.peers.stand import Guess

NEVER = 7000.0
"""Start and end of an event that a run does not have [s]."""
ALWAYS = (-1e4, 1e5)
"""Start and end of an event that lasts all the time [s]."""
WORTH = 3.0
"""Gain in squared deviations below which a run has no event."""
GRID = 2
"""Samples between the times that are tried."""


def timed(effect: Effect) -> list[int]:
    """Columns of an effect's times.

    Args:
        effect: The effect.

    Returns:
        None for an effect that acts throughout, one for an onset, two for an interval.
    """
    return [c for c, p in enumerate(effect.declared) if p.per_run]


@dataclass(frozen=True)
class Scene:
    """A run in which an event is looked for.

    Attributes:
        track: The run.
        left: Averaged errors without the event.
        nuisance: What is uncertain anyway, as columns of them.
        spread: Prior standard deviations of that.
    """

    track: Smooth
    left: Float[np.ndarray, "b 6"]
    nuisance: Float[np.ndarray, "b 6 m"]
    spread: Float[np.ndarray, " m"]

    def scan(self, effect: Effect, values: Float[np.ndarray, " p"], noise: Noise) -> tuple[np.ndarray, float]:
        """Times between which a force of given size explains most of the errors, nuisances integrated out.

        What it does from the start of the run up to any time is whitened once; every interval is a difference of two.

        Args:
            effect: The force.
            values: Its parameters, times among them.
            noise: Of the errors.

        Returns:
            The values with new times, and the squared deviations that are saved.
        """
        columns, always, whole = timed(effect), values.copy(), [slice(0, len(self.left))]
        always[columns] = ALWAYS[: len(columns)]
        white = noise.white(self._upto(effect, always), whole)
        target = noise.white(self.left[..., None], whole)
        loose = noise.white(self.nuisance * self.spread, whole)
        kept = np.linalg.inv(np.eye(loose.shape[1]) + loose.T @ loose)
        seen = white - loose @ (kept @ (loose.T @ white))
        overlap, gram = (target.T @ seen)[0], white.T @ seen
        size = np.diag(gram)
        saved = np.triu(2 * (overlap[None] - overlap[:, None]) - size[None] - size[:, None] + 2 * gram, 1)
        if len(columns) == 1:
            saved[:, :-1] = 0.0
        start, end = np.unravel_index(int(saved.argmax()), saved.shape)
        run, best, new = self.track.run, float(saved[start, end]), values.copy()
        times = run.time[0] + GRID * run.step * np.array([start, end])
        new[columns] = times[: len(columns)] if best > WORTH else NEVER
        return new, best

    def _upto(self, effect: Effect, always: Float[np.ndarray, " p"]) -> Float[np.ndarray, "b 6 g"]:
        """What a force that acts up to each time of the grid takes off the averaged errors."""
        push = self.track.contribution(effect, always[None])[1][..., 0] / self.track.unit[:3]
        sums = np.cumsum(self.track.weights.T[:, :, None] * push[:, None, :], axis=0)[GRID - 1 :: GRID]
        rows = np.zeros((len(self.left), 6, len(sums) + 1))
        rows[:, :3, 1:] = sums.transpose(1, 2, 0)
        return rows


def placed(
    scenes: Sequence[Scene], effect: Effect, values: Float[np.ndarray, "runs p"], noise: Noise
) -> tuple[Float[np.ndarray, "runs p"], float]:
    """The best times in several runs.

    Args:
        scenes: The runs.
        effect: The force.
        values: Its parameters in each.
        noise: Of the errors.

    Returns:
        Values with new times, and what is saved in all.
    """
    found = [scene.scan(effect, row, noise) for scene, row in zip(scenes, values, strict=True)]
    return np.stack([row for row, _ in found]), sum(gain for _, gain in found)


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
        last = float(track.run.time[-1])
        start, end = [*row[columns], last][:2]
        found[track.run.name] = [[float(start), float(min(end, last))]] if start < last else []
    return found
