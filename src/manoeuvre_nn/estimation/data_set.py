"""All fitted runs of a ship, whitened: inner products of any columns of all of them, at every level of noise."""

import copy
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from manoeuvre_nn.core.memory import check_memory
from manoeuvre_nn.core.recording import CAMPAIGN, Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.dynamics.base import Model
from manoeuvre_nn.estimation.corrections import CoefficientPrior, Corrections
from manoeuvre_nn.estimation.linear_run import Columns, Embedded, IntegratedRun, RunEquations, joined, summed
from manoeuvre_nn.estimation.linearised_run import Rate, run_equations
from manoeuvre_nn.estimation.posterior import Posterior, posterior
from manoeuvre_nn.estimation.prepared_run import (
    LATENCY_SD,
    PreparedRun,
    base_columns,
    prepared_run,
    process_time,
    samples_a_state,
    start_spread,
    typical_rates,
)
from manoeuvre_nn.estimation.process_noise import PROCESS_LEVELS, ProcessLevels
from manoeuvre_nn.recording.thinning import samples_apart

COEFFICIENT_SD_LEVELS = (0.002, 0.015, 0.03, 0.05, 0.08, 0.2)
"""Levels of the relative error of the calm-water coefficients."""
MIN_SIGNAL_TO_NOISE = 0.02
"""Least signal-to-noise ratio, squared, of a combination of coefficients that is carried along."""
SAME_RUDDER = 1.0 * DEGREE
"""Standard deviation of the difference of two rudder angles from which on corrections tell them apart [rad]: of it, 5 %
are half the noise of an indicator."""
COPIES = 37.0
"""What a diagnosis holds at once, over a table of instants times states times columns, as measured."""
MAX_KEPT_BYTES = 2**31
"""What the levels of one data set may take: of a day of recording it is that of the few that are in use."""
FEWER = "write fewer files into files=, hold out more, or cut the recordings by start: and end: in the mapping"
"""What to do with recordings that are too long together."""
MAX_RUDDERS = 4
"""Sets of runs about other rudder angles that are kept."""


@dataclass(frozen=True)
class _Level:
    """All runs at one grid point."""

    white: list[IntegratedRun]
    base: list[Embedded]
    each: list[Float[np.ndarray, "b b"]]
    base_gram: Float[np.ndarray, "p p"]
    norm: float
    whole: list[tuple[Embedded, Float[np.ndarray, "c c"]]] = field(default_factory=list, repr=False)

    @cached_property
    def bytes(self) -> int:
        """Memory that the factors and the whitened columns take, those of every correction if they are asked for."""
        return sum(w.chain.factor.nbytes for w in self.white) + 2 * sum(e.inner.nbytes for e in self.base)


class WhitenedDataSet:
    """Fitted runs, linearised and whitened at a grid of noise levels.

    The columns of the base are: the data, the coefficients (shared by the runs), the latency of each run.

    Attributes:
        dynamics: Calm-water model.
        runs: The runs.
        combinations: How many combinations of coefficients the runs can show.
        corrections: What may be wrong, and is combined.
        rotation: These combinations, one a column: coefficients' errors are ``rotation @`` those of the combinations.
        seen: What the runs see of coefficients' errors: those of the combinations are ``seen @`` these.
        coefficient_prior: How errors of the coefficients go together before the runs are seen.
        levels: Standard deviations of the process noise.
        process_time: Its correlation time [s].
    """

    def __init__(
        self,
        dynamics: Model,
        runs: Sequence[PreparedRun],
        coefficient_prior: CoefficientPrior | None = None,
        levels: ProcessLevels = PROCESS_LEVELS,
        time: float | None = None,
    ) -> None:
        """Take the runs, what is known of the coefficients' errors, and the process noise; None is its usual time."""
        self.dynamics, self.runs = dynamics, list(runs)
        self.coefficient_prior = coefficient_prior or CoefficientPrior()
        self.unit = typical_rates(dynamics)
        self.levels, self.process_time = levels, time or process_time(dynamics)
        self._equations: list[RunEquations] = []
        self._at: dict[int, _Level] = {}
        self._by_rudder: dict[bytes, WhitenedDataSet] = {}
        # Keep the combinations of coefficients that the runs can show; the prior is the same in all directions.
        self.combinations = k = self.runs[0].base.count - 2  # of the base, data and latency are none
        self.corrections = Corrections(dynamics)
        root = self.coefficient_prior.root(self.corrections.names)
        values, vectors = np.linalg.eigh(root.T @ self._made(0).base_gram[1 : 1 + k, 1 : 1 + k] @ root)
        kept = vectors[:, values * COEFFICIENT_SD_LEVELS[-1] ** 2 > MIN_SIGNAL_TO_NOISE]
        # Combinations are orthogonal in what runs show: of any errors they show ``seen @`` these; seen @ rotation = 1.
        self.rotation, self.seen = root @ kept, np.linalg.solve(root.T, kept).T
        self.combinations = self.rotation.shape[1]
        self.runs = [replace(p, base=_turned(p.base, self.rotation)) for p in self.runs]

    def at(self, level: int) -> "_Level":
        """The runs whitened at a grid point; made when it is asked for, and kept as long as there is room.

        Returns:
            Whitened runs, their embedded base columns and what follows from them.
        """
        found = self._at.pop(level, None) or self._made(level)
        self._at[level] = found  # what was asked for last stands last
        while len(self._at) > 1 and sum(one.bytes for one in self._at.values()) > MAX_KEPT_BYTES:
            del self._at[next(iter(self._at))]
        return found

    def _made(self, level: int) -> "_Level":
        """Whiten all runs at a grid point."""
        if not self._equations:
            start = start_spread(self.dynamics)
            self._equations = [run_equations(x.linearised, x.noise, self.process_time, start) for x in self.runs]
        process_sd = self.levels.sd(level, self.unit)
        white = [IntegratedRun(equations, process_sd) for equations in self._equations]
        base = [w.embed(p.base) for w, p in zip(white, self.runs, strict=True)]
        each = [e.dot(e) for e in base]
        g = summed(each, [self.base_index(k) for k in range(len(base))], self.size)
        return _Level(white, base, each, g, sum(w.log_norm for w in white))

    @cached_property
    def whole(self) -> list[PreparedRun]:
        """The runs with a base column for every correction, not for combinations of them."""
        return [replace(p, base=base_columns(self.dynamics, p.linearised)) for p in self.runs]

    def whole_at(self, level: int) -> list[tuple[Embedded, Float[np.ndarray, "c c"]]]:
        """Of each run the base columns of every correction whitened at a grid point, and their inner products."""
        here = self.at(level)
        if not here.whole:
            embedded = [white.embed(p.base) for white, p in zip(here.white, self.whole, strict=True)]
            here.whole.extend((e, e.dot(e)) for e in embedded)
        return here.whole

    def release(self) -> None:
        """Free the memory of all that can be made again: of a data set that another one has followed."""
        self._equations, self._at, self._by_rudder = [], {}, {}
        self.__dict__.pop("whole", None)

    def with_prior(self, prior: CoefficientPrior) -> "WhitenedDataSet":
        """The same runs with another prior of the coefficients that goes together in the same way."""
        made = copy.copy(self)
        made.coefficient_prior, made._by_rudder, made._at = prior, {}, dict(self._at)
        return made

    def with_rudders(self, indicated: Sequence[Float[np.ndarray, " n"]]) -> "WhitenedDataSet":
        """The same runs about the same states, corrections of rudder forces acting at other angles.

        Args:
            indicated: What the rudder indicator showed in each run [rad].

        Returns:
            The runs; these if the angles differ by less than matters.
        """
        lines = [p.linearised for p in self.runs]
        if max(np.std(a - x.indicated) for a, x in zip(indicated, lines, strict=True)) < SAME_RUDDER:
            return self
        key = b"".join(a.tobytes() for a in indicated)
        if key not in self._by_rudder:
            moved = [replace(x, indicated=a) for a, x in zip(indicated, lines, strict=True)]
            made = [
                replace(p, linearised=x, base=base_columns(self.dynamics, x))
                for p, x in zip(self.runs, moved, strict=True)
            ]
            if len(self._by_rudder) >= MAX_RUDDERS:
                del self._by_rudder[next(iter(self._by_rudder))]
            noise = self.levels, self.process_time
            self._by_rudder[key] = WhitenedDataSet(self.dynamics, made, self.coefficient_prior, *noise)
        return self._by_rudder[key]

    @property
    def campaigns(self) -> tuple[int, ...]:
        """Number of each run's campaign, where they are of several days, loads or speeds; else empty."""
        names = [str(prepared.linearised.run.meta.get(CAMPAIGN, "")) for prepared in self.runs]
        each = list(dict.fromkeys(names))
        return tuple(each.index(name) for name in names) if len(each) > 1 else ()

    @property
    def size(self) -> int:
        """Number of base columns: data, coefficients, one latency a run."""
        return 1 + self.combinations + len(self.runs)

    def nuisance_sd(self, scatter: int, runs: int) -> Float[np.ndarray, " k"]:
        """Prior standard deviations of the coefficients at a level of theirs, and of the latencies of so many runs."""
        return np.r_[np.full(self.combinations, COEFFICIENT_SD_LEVELS[scatter]), np.full(runs, LATENCY_SD)]

    def base_index(self, run: int) -> Int[np.ndarray, " k"]:
        """Where a run's base columns stand among those of all runs."""
        shared = np.arange(1 + self.combinations)
        return np.append(shared, 1 + self.combinations + run)

    def gram(
        self,
        level: int,
        extra: Sequence[Embedded],
        index: Sequence[Int[np.ndarray, " k"]],
        count: int,
        turned: Sequence[Float[np.ndarray, "b b"]] = (),
    ) -> Float[np.ndarray, "p p"]:
        """Inner products of base and extra columns over all runs.

        Args:
            level: Grid point.
            extra: Further columns of each run, embedded at it.
            index: Where each run's extra columns stand among ``count``.
            count: Number of extra columns of all runs.
            turned: Base columns of each run as combinations S of those of calm water (:func:`.changed_base`).

        Returns:
            Base first, then the extra ones.
        """
        n, here = self.size, self.at(level)
        g = np.zeros((n + count,) * 2)
        g[:n, :n] = here.base_gram
        if turned:
            own = [s.T @ products @ s for s, products in zip(turned, here.each, strict=True)]
            g[:n, :n] = summed(own, [self.base_index(run) for run in range(len(own))], n)
        for run, (more, at) in enumerate(zip(extra, index, strict=True)):
            cross = here.base[run].dot(more)
            g[np.ix_(self.base_index(run), n + at)] += turned[run].T @ cross if turned else cross
            g[np.ix_(n + at, n + at)] += more.dot(more)
        g[n:, :n] = g[:n, n:].T
        return g

    def embedded(self, level: int, columns: Sequence[Columns]) -> list[Embedded]:
        """Columns of each run whitened."""
        return [white.embed(c) for white, c in zip(self.at(level).white, columns, strict=True)]

    def posterior(
        self, gram: Float[np.ndarray, "p p"], norm: float, data: Float[np.ndarray, " p"], numbers: Sequence[float] = ()
    ) -> Posterior:
        """What the runs say of coefficients, latencies and numbers, at every level of the coefficients' prior.

        Args:
            gram: Inner products; these unknowns stand last.
            norm: Log normaliser.
            data: What is to be explained, as a combination of all columns.
            numbers: Prior standard deviations of the numbers.

        Returns:
            The posterior.
        """
        prior = np.r_[np.ones(self.combinations), np.full(len(self.runs), LATENCY_SD), np.array(numbers)]
        return posterior(gram, norm, prior, data, COEFFICIENT_SD_LEVELS, self.combinations)


def _turned(base: Columns, rotation: Float[np.ndarray, "k kept"]) -> Columns:
    """Base columns with the coefficients' combined."""
    coefficients = base[1:-1]
    combined = Columns(coefficients.measured @ rotation, coefficients.moved @ rotation)
    return joined([base[:1], combined, base[-1:]])


def same_campaigns(known: Sequence[Recording], runs: Sequence[Recording]) -> list[int]:
    """For each of some runs a known run of the same campaign; the first where there is none.

    Returns:
        Numbers of known runs.
    """
    days = [run.meta.get(CAMPAIGN) for run in known]
    return [days.index(day) if (day := run.meta.get(CAMPAIGN)) in days else 0 for run in runs]


def whitened_data_set(dynamics: Model, runs: Sequence[Recording]) -> WhitenedDataSet:
    """Find states and noise of runs, linearise and whiten."""
    samples, states = sum(map(len, runs)), Rate(dynamics).states.count
    columns = len(Corrections(dynamics).names) + 2 * states
    counts = [samples_a_state(dynamics, r.step, samples_apart(r)) for r in runs]
    instants = sum(len(run) // count for run, count in zip(runs, counts, strict=True))
    check_memory(f"{samples} samples to be diagnosed", COPIES * 8 * instants * states * columns, FEWER)
    return WhitenedDataSet(dynamics, [prepared_run(dynamics, *both) for both in zip(runs, counts, strict=True)])
