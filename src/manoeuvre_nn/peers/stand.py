"""All fitted runs of a case as one regression: errors of a guess, their derivatives, and what is uncertain anyway."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.effect import Effect, Parameter
from manoeuvre_nn.diagnosis.columns import coefficient_columns
from manoeuvre_nn.diagnosis.runs import Run
from manoeuvre_nn.dynamics.base import Dynamics
from manoeuvre_nn.peers.residual import ROWS, Smooth, smooth

RANDOM = ("gust_sd", "gust_time_s")
"""Parameters of a random course: the mean does not depend on them."""
SCATTER = 0.045
"""Relative standard deviation of the calm-water coefficients: published scatter is 3 to 6 %."""
LATENCY_SPREAD = 0.15
"""Standard deviation of the receiver's delay about its usual one [s]."""


@dataclass(frozen=True)
class Guess:
    """Effects with values.

    Attributes:
        effects: Prototypes.
        values: Parameter values of each effect, one row a run; only times of an event differ between rows.
    """

    effects: tuple[Effect, ...] = ()
    values: tuple[Float[np.ndarray, "runs p"], ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects."""
        return tuple(e.name for e in self.effects)

    @property
    def free(self) -> list[tuple[int, int, Parameter]]:
        """Numbers that a regression can find: effect, column, parameter; times of events are found by scanning."""
        return [
            (k, c, p)
            for k, e in enumerate(self.effects)
            for c, p in enumerate(e.declared)
            if not p.per_run and p.name not in RANDOM
        ]

    @property
    def vector(self) -> Float[np.ndarray, " q"]:
        """Values of the free numbers."""
        return np.array([self.values[k][0, c] for k, c, _ in self.free])

    @property
    def size(self) -> int:
        """Numbers that are paid for: free ones whose formula does not bound them, and times."""
        times = sum(len(v) * sum(p.per_run for p in e.declared) for e, v in zip(self.effects, self.values, strict=True))
        return times + sum(not p.form for *_, p in self.free)

    def at(self, vector: Float[np.ndarray, " q"]) -> "Guess":
        """The same effects elsewhere, within their bounds.

        Args:
            vector: Values of the free numbers.

        Returns:
            A new guess.
        """
        values = [v.copy() for v in self.values]
        for (k, c, p), value in zip(self.free, vector, strict=True):
            values[k][:, c] = value % p.period if p.period else np.clip(value, p.low, p.high)
        return replace(self, values=tuple(values))

    def joined(self, effect: Effect, values: Float[np.ndarray, "runs p"]) -> "Guess":
        """With one more effect.

        Args:
            effect: It.
            values: Its values.

        Returns:
            A new guess.
        """
        return Guess((*self.effects, effect), (*self.values, values))


class Stand:
    """The fitted runs on their smoothed tracks, their errors stacked.

    Attributes:
        tracks: The runs.
        nuisance: What a latency of 1 s and each coefficient, wrong by all of itself, add to the errors.
        spread: Prior standard deviations of these.
        errors: Errors of calm water.
    """

    def __init__(self, dynamics: Dynamics, runs: Sequence[Run], scatter: float = SCATTER) -> None:
        """Smooth the runs.

        Args:
            dynamics: Calm-water model.
            runs: The runs.
            scatter: Relative standard deviation of the coefficients; 0 takes them as exact.
        """
        self.dynamics = dynamics
        self.tracks = [smooth(dynamics, run) for run in runs]
        self.nuisance = np.concatenate([_nuisance(dynamics, t, scatter > 0) for t in self.tracks])
        self.spread = np.append(LATENCY_SPREAD, np.full(self.nuisance.shape[-1] - 1, scatter))
        self.errors = np.concatenate([t.averaged(t.errors()[0]) for t in self.tracks])
        self._known: dict[tuple, tuple[np.ndarray, np.ndarray]] = {}

    @property
    def parts(self) -> list[slice]:
        """Rows of each run among all averages."""
        ends = np.cumsum([0, *(len(t.times) for t in self.tracks)])
        return [slice(a, b) for a, b in zip(ends, ends[1:], strict=False)]

    def evaluate(self, guess: Guess) -> tuple[Float[np.ndarray, "b 6"], Float[np.ndarray, "b 6 q"]]:
        """Errors that a guess leaves, and how they fall with each of its free numbers.

        Args:
            guess: Effects and values.

        Returns:
            Errors and minus their derivatives.
        """
        key = (guess.names, *(v.tobytes() for v in guess.values))
        if key not in self._known:
            self._known[key] = self._evaluate(guess)
        return self._known[key]

    def _evaluate(self, guess: Guess) -> tuple[np.ndarray, np.ndarray]:
        """The same, computed."""
        free = guess.free
        if not free:
            return self.errors, np.zeros((*self.errors.shape, 0))
        errors, slopes = [], []
        for run, track in enumerate(self.tracks):
            sets, steps = _nudged(guess, run)
            added: np.ndarray | float = 0.0
            pushed: np.ndarray | float = 0.0
            for effect, rows in zip(guess.effects, sets, strict=True):
                a, p = track.contribution(effect, rows)
                added, pushed = added + a, pushed + p
            e = track.averaged(track.errors(added, pushed).transpose(1, 2, 0))  # type: ignore[arg-type]
            errors.append(e[..., 0])
            slopes.append((e[..., 2::2] - e[..., 1::2]) / steps)
        return np.concatenate(errors), np.concatenate(slopes)


def _nudged(guess: Guess, run: int) -> tuple[list[Float[np.ndarray, "s p"]], Float[np.ndarray, " q"]]:
    """Values of a run, then with every free number a little up and a little down; and the distances between these."""
    free = guess.free
    sets = [np.repeat(v[run : run + 1], 1 + 2 * len(free), axis=0) for v in guess.values]
    steps = np.empty(len(free))
    for m, (k, c, p) in enumerate(free):
        half = 0.5 if p.period else 0.02 * p.spread
        up, down = sets[k][0, c] + half, sets[k][0, c] - half
        if not p.period:
            up, down = min(up, p.high), max(down, p.low)
        sets[k][1 + 2 * m, c], sets[k][2 + 2 * m, c], steps[m] = up, down, up - down
    return sets, steps


def _nuisance(dynamics: Dynamics, track: Smooth, scatter: bool) -> Float[np.ndarray, "b 6 m"]:
    """What is uncertain under every guess, as columns of the averaged errors."""
    added = np.zeros((len(track.run), 8, 1))
    added[:, :4, 0] = -0.1 * track.slopes[:, :4]
    columns = [(track.errors()[0] - track.errors(added)[0])[..., None] / 0.1]
    if scatter:
        coefficients, _ = coefficient_columns(dynamics, track.line, track.situation)
        push = track.pushed(coefficients) / track.unit[:3, None]
        columns.append(np.concatenate([push, np.zeros((len(push), len(ROWS) - 3, push.shape[-1]))], axis=1))
    return track.averaged(np.concatenate(columns, axis=-1))
