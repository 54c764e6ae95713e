"""All fitted runs of a ship on one bench: what any column adds to any of them, at every level of noise."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
from jaxtyping import Float, Int

from manoeuvre_nn.core.effect import Situation
from manoeuvre_nn.diagnosis.columns import coefficient_columns, latency_column, situation
from manoeuvre_nn.diagnosis.linear import Columns, Embedded, Linearised, Noise, Whitened, calm_rate, joined
from manoeuvre_nn.diagnosis.runs import Run
from manoeuvre_nn.diagnosis.track import smooth
from manoeuvre_nn.dynamics.model import Dynamics

NOMINAL = np.array([0.7, 0.7, 0.04, 0.04, 1.75e-3, 3.5e-4, 0.05, 0.005])
"""First idea of the channels' noise [m, m, m/s, m/s, rad, rad/s, m/s, -]."""
FORCE_LEVELS = (1e-4, 1e-3, 3e-3, 8e-3, 2.5e-2)
"""Levels of the coloured acceleration that no hypothesis explains, over U0^2/L (times 1/L in yaw)."""
SCATTER_LEVELS = (0.002, 0.01, 0.03, 0.07)
"""Levels of the relative error of the calm-water coefficients."""
LATENCY, LATENCY_SPREAD = 0.25, 0.25
"""Delay of the satellite receiver [s]: mean and s.d. before the recording is seen."""


@dataclass(frozen=True)
class Place:
    """A run on the bench.

    Attributes:
        line: Its equations about its track.
        situation: What effects see along the track.
        noise: S.d. of its channels, their correlation in time taken in.
        base: Data, coefficients and latency as columns.
        force: Coloured acceleration that the track needs [m/s^2, m/s^2, rad/s^2].
    """

    line: Linearised
    situation: Situation
    noise: Float[np.ndarray, " 8"]
    base: Columns
    force: Float[np.ndarray, "n 3"]


class Bench:
    """Fitted runs, linearised and whitened at a grid of noise levels.

    The columns of the base are: the data, the coefficients (shared by the runs), the latency of each run.

    Attributes:
        dynamics: Calm-water model.
        rate: Its accelerations.
        places: The runs.
        coefficients: Names of the coefficients.
        levels: Level of the coloured acceleration in surge and in sway and yaw, one row a grid point.
    """

    def __init__(self, dynamics: Dynamics, places: Sequence[Place], coefficients: Sequence[str]) -> None:
        """Factor every run at every level.

        Args:
            dynamics: Calm-water model.
            places: The runs.
            coefficients: Names of the coefficients.
        """
        self.dynamics, self.rate = dynamics, calm_rate(dynamics)
        self.places, self.coefficients = list(places), list(coefficients)
        p = dynamics.particulars
        self.unit = p.speed**2 / p.length * np.array([1.0, 1.0, 1.0 / p.length])
        self.levels = np.array(list(product(FORCE_LEVELS, FORCE_LEVELS)))
        spread = np.array([0.3 * p.speed, 0.3 * p.speed, 0.3 * p.speed / p.length, 50.0, 50.0, 0.3])
        self.white = [
            [
                Whitened(place.line, Noise(place.noise, level[[0, 1, 1]] * self.unit, force_time(dynamics)), spread)
                for place in self.places
            ]
            for level in self.levels
        ]
        self.norm = np.array([sum(w.log_norm for w in row) for row in self.white])

    @property
    def size(self) -> int:
        """Number of base columns: data, coefficients, one latency a run."""
        return 1 + len(self.coefficients) + len(self.places)

    def base_index(self, run: int) -> Int[np.ndarray, " k"]:
        """Where a run's base columns stand among those of all runs.

        Args:
            run: Number of the run.

        Returns:
            Indices.
        """
        shared = np.arange(1 + len(self.coefficients))
        return np.append(shared, 1 + len(self.coefficients) + run)

    @cached_property
    def base(self) -> list[list[Embedded]]:
        """Base columns embedded, by level and run."""
        return [[w.embed(p.base) for w, p in zip(row, self.places, strict=True)] for row in self.white]

    @cached_property
    def base_gram(self) -> Float[np.ndarray, "levels p p"]:
        """Inner products of the base columns over all runs, by level."""
        g = np.zeros((len(self.levels), self.size, self.size))
        for level, row in enumerate(self.base):
            for run, e in enumerate(row):
                at = self.base_index(run)
                g[level][np.ix_(at, at)] += e.dot(e)
        return g

    def gram(
        self, level: int, extra: Sequence[Columns], index: Sequence[Int[np.ndarray, " k"]], count: int
    ) -> Float[np.ndarray, "p p"]:
        """Inner products of base and extra columns over all runs.

        Args:
            level: Grid point.
            extra: Further columns of each run.
            index: Where each run's extra columns stand among ``count``.
            count: Number of extra columns of all runs.

        Returns:
            Base first, then the extra ones.
        """
        n = self.size
        g = np.zeros((n + count,) * 2)
        g[:n, :n] = self.base_gram[level]
        for run, (c, at) in enumerate(zip(extra, index, strict=True)):
            more = self.white[level][run].embed(c)
            cross = self.base[level][run].dot(more)
            g[np.ix_(self.base_index(run), n + at)] += cross
            g[np.ix_(n + at, n + at)] += more.dot(more)
        g[n:, :n] = g[:n, n:].T
        return g


def force_time(dynamics: Dynamics) -> float:
    """Correlation time of what no hypothesis explains: the time in which the ship sails its length.

    Args:
        dynamics: Calm-water model.

    Returns:
        Time [s].
    """
    return dynamics.particulars.time_unit


def bench(dynamics: Dynamics, runs: Sequence[Run]) -> Bench:
    """Put runs on the bench: find their tracks and noise, linearise, whiten.

    Args:
        dynamics: Calm-water model.
        runs: The fitted runs.

    Returns:
        The bench.
    """
    places, names = [], []
    for run in runs:
        place, names = place_run(dynamics, run)
        places.append(place)
    return Bench(dynamics, places, names)


def place_run(dynamics: Dynamics, run: Run) -> tuple[Place, list[str]]:
    """One run made ready.

    Args:
        dynamics: Calm-water model.
        run: The run.

    Returns:
        Its place and the coefficients' names.
    """
    rate, p = calm_rate(dynamics), dynamics.particulars
    unit = p.speed**2 / p.length * np.array([1.0, 1.0, 1.0 / p.length])
    found = smooth(run, rate, NOMINAL, np.array([0.05, 0.1, 0.1]) * unit, force_time(dynamics))
    line = found.line
    s = situation(line, rate)
    coefficients, names = coefficient_columns(dynamics, line, s)
    latency = latency_column(line)
    data = line.data
    centred = Columns(data.measured - LATENCY * latency.measured, data.moved - LATENCY * latency.moved)
    base = joined([centred, coefficients, latency])
    return Place(line, s, found.noise * np.sqrt(found.inflation), base, found.force), names
