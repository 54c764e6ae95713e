"""All fitted runs of a ship on one bench: what any column adds to any of them, at every level of noise."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from jaxtyping import Float, Int

from manoeuvre_nn.core.effect import Situation
from manoeuvre_nn.core.ship import Particulars
from manoeuvre_nn.diagnosis.columns import coefficient_columns, latency_column, situation
from manoeuvre_nn.diagnosis.linear import Columns, Embedded, Linearised, Noise, Whitened, calm_rate, joined, linearise
from manoeuvre_nn.diagnosis.runs import Run
from manoeuvre_nn.diagnosis.track import smooth
from manoeuvre_nn.dynamics.model import Dynamics
from manoeuvre_nn.effect.common import typical as usual

NOMINAL = np.array([0.7, 0.7, 0.04, 0.04, 1.75e-3, 3.5e-4, 0.05, 0.005])
"""First idea of the channels' noise [m, m, m/s, m/s, rad, rad/s, m/s, -]."""
FORCE_LEVELS = (0.003, 0.015, 0.05, 0.15, 0.5)
"""Levels of the coloured force that no hypothesis explains, over the resistance and the force of 20 deg of rudder."""
SCATTER_LEVELS = (0.002, 0.015, 0.03, 0.05, 0.08, 0.2)
"""Levels of the relative error of the calm-water coefficients."""
SEEN = 0.02
"""Least signal-to-noise ratio, squared, of a combination of coefficients that is carried along."""
LATENCY, LATENCY_SPREAD = 0.25, 0.25
"""Delay of the satellite receiver [s]: mean and s.d. before the recording is seen."""


@dataclass(frozen=True)
class Place:
    """A run on the bench.

    Attributes:
        line: Its equations about its track.
        situation: What effects see along the track.
        noise: S.d. of its channels, their correlation in time taken in.
        inflation: What that correlation multiplied their variances by.
        base: Data, coefficients and latency as columns.
        force: Coloured acceleration that the track needs [m/s^2, m/s^2, rad/s^2].
    """

    line: Linearised
    situation: Situation
    noise: Float[np.ndarray, " 8"]
    inflation: Float[np.ndarray, " 8"]
    base: Columns
    force: Float[np.ndarray, "n 3"]


@dataclass(frozen=True)
class _Level:
    """All runs at one grid point."""

    white: list[Whitened]
    base: list[Embedded]
    base_gram: Float[np.ndarray, "p p"]
    norm: float


class Bench:
    """Fitted runs, linearised and whitened at a grid of noise levels.

    The columns of the base are: the data, the coefficients (shared by the runs), the latency of each run.

    Attributes:
        dynamics: Calm-water model.
        rate: Its accelerations.
        places: The runs.
        coefficients: Names of the combinations of coefficients that the runs can show.
        rotation: The combinations, one a column: coefficients' errors are ``rotation @`` those of the combinations.
        levels: Level of the coloured acceleration in surge and in sway and yaw, one row a grid point.
    """

    def __init__(self, dynamics: Dynamics, places: Sequence[Place], coefficients: Sequence[str]) -> None:
        """Take the runs.

        Args:
            dynamics: Calm-water model.
            places: The runs.
            coefficients: Names of the coefficients.
        """
        self.dynamics, self.rate = dynamics, calm_rate(dynamics)
        self.places, self.coefficients = list(places), list(coefficients)
        self.rotation = np.eye(len(self.coefficients))
        self.unit = typical(dynamics)
        self.levels = np.array(list(product(FORCE_LEVELS, FORCE_LEVELS)))
        self._at: dict[int, _Level] = {}
        self._turn()

    def _turn(self) -> None:
        """Keep the combinations of coefficients that the runs can show; the prior is the same in all directions."""
        k = len(self.coefficients)
        values, vectors = np.linalg.eigh(self._made(0).base_gram[1 : 1 + k, 1 : 1 + k])
        self.rotation = vectors[:, values * SCATTER_LEVELS[-1] ** 2 > SEEN]
        self.coefficients = [f"combination {n + 1}" for n in range(self.rotation.shape[1])]
        self.places = [replace(p, base=_turned(p.base, self.rotation)) for p in self.places]

    def at(self, level: int) -> "_Level":
        """The runs whitened at a grid point; made when it is first asked for.

        Args:
            level: Grid point.

        Returns:
            Whitened runs, their embedded base columns and what follows from them.
        """
        if level not in self._at:
            self._at[level] = self._made(level)
        return self._at[level]

    def _made(self, level: int) -> "_Level":
        """Whiten all runs at a grid point."""
        spread = start_spread(self.dynamics.particulars)
        force = self.levels[level][[0, 1, 1]] * self.unit
        white = [
            Whitened(place.line, Noise(place.noise, force, force_time(self.dynamics)), spread) for place in self.places
        ]
        base = [w.embed(p.base) for w, p in zip(white, self.places, strict=True)]
        g = np.zeros((self.size, self.size))
        for run, e in enumerate(base):
            where = self.base_index(run)
            g[np.ix_(where, where)] += e.dot(e)
        return _Level(white, base, g, sum(w.log_norm for w in white))

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
        n, here = self.size, self.at(level)
        g = np.zeros((n + count,) * 2)
        g[:n, :n] = here.base_gram
        for run, (c, at) in enumerate(zip(extra, index, strict=True)):
            more = here.white[run].embed(c)
            cross = here.base[run].dot(more)
            g[np.ix_(self.base_index(run), n + at)] += cross
            g[np.ix_(n + at, n + at)] += more.dot(more)
        g[n:, :n] = g[:n, n:].T
        return g


def _turned(base: Columns, rotation: Float[np.ndarray, "k kept"]) -> Columns:
    """Base columns with the coefficients' combined."""
    k = len(rotation)

    def turn(a: np.ndarray) -> np.ndarray:
        return np.concatenate([a[..., :1], a[..., 1 : 1 + k] @ rotation, a[..., 1 + k :]], axis=-1)

    return Columns(turn(base.measured), turn(base.moved))


def quiet(level: int) -> int:
    """A force level at which hypotheses must explain what the coloured force explained at another.

    Args:
        level: Grid point that calm water needs.

    Returns:
        The grid point, neither of its levels above the second.
    """
    side = len(FORCE_LEVELS)
    return min(level // side, 1) * side + min(level % side, 1)


def typical(dynamics: Dynamics) -> Float[np.ndarray, " 3"]:
    """Accelerations that are large in a manoeuvre: by the resistance in surge, by 20 deg of rudder in sway and yaw.

    Args:
        dynamics: Calm-water model.

    Returns:
        [m/s^2, m/s^2, rad/s^2].
    """
    return usual(dynamics.hull, dynamics.acceleration).numpy()


def force_time(dynamics: Dynamics) -> float:
    """Correlation time of what no hypothesis explains: the time in which the ship sails its length.

    Args:
        dynamics: Calm-water model.

    Returns:
        Time [s].
    """
    return dynamics.particulars.time_unit


def start_spread(ship: Particulars) -> Float[np.ndarray, " 6"]:
    """Prior standard deviation of a first state about the track.

    Args:
        ship: The ship.

    Returns:
        u, v [m/s], r [rad/s], x, y [m], psi [rad].
    """
    east = float(ship.sized([50.0], [1.0])[0])
    return np.array([0.3 * ship.speed, 0.3 * ship.speed, 0.3 * ship.speed / ship.length, east, east, 0.3])


def bench(dynamics: Dynamics, runs: Sequence[Run]) -> Bench:
    """Put runs on the bench: find their tracks and noise, linearise, whiten.

    Args:
        dynamics: Calm-water model.
        runs: The fitted runs.

    Returns:
        The bench.
    """
    places: list[Place] = []
    names: list[str] = []
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
    force, least = np.array([0.05, 0.1, 0.1]) * unit, 0.2 * NOMINAL
    if dynamics.fitted:  # what recordings were trusted when the model was fitted to such is what they are trusted now
        u, v, r, x, y, psi = dynamics.noise.tolist()
        least[:6] = x, y, u, v, psi, r
    found = smooth(run, rate, NOMINAL, force, force_time(dynamics), p, least=least)
    slow = np.where((found.noise > least) | (not dynamics.fitted), found.inflation, 1.0)
    return _place(dynamics, found.line, found.noise * np.sqrt(slow), slow, found.force)


def moved_track(dynamics: Dynamics, place: Place, track: Float[np.ndarray, "n 6"]) -> tuple[Place, list[str]]:
    """The same run about another track.

    Args:
        dynamics: Calm-water model.
        place: The run.
        track: u, v, r, x, y, psi.

    Returns:
        Its new place and the coefficients' names.
    """
    line = linearise(place.line.run, calm_rate(dynamics), track, force_time(dynamics))
    return _place(dynamics, line, place.noise, place.inflation, place.force)


def _place(
    dynamics: Dynamics,
    line: Linearised,
    noise: Float[np.ndarray, " 8"],
    inflation: Float[np.ndarray, " 8"],
    force: Float[np.ndarray, "n 3"],
) -> tuple[Place, list[str]]:
    """A run's base columns about its track."""
    s = situation(line, calm_rate(dynamics))
    coefficients, names = coefficient_columns(dynamics, line, s)
    latency = latency_column(line)
    data = line.data
    centred = Columns(data.measured - LATENCY * latency.measured, data.moved - LATENCY * latency.moved)
    base = joined([centred, coefficients, latency])
    return Place(line, s, noise, inflation, base, force), names
