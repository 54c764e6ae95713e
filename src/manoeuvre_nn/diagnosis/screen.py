"""Many pairs of hypotheses judged by a linear step each: what one adds is whitened once, not once a pair."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.diagnosis.bench import LATENCY_SPREAD
from manoeuvre_nn.diagnosis.court import Court, linear
from manoeuvre_nn.diagnosis.hypothesis import Hypothesis
from manoeuvre_nn.diagnosis.linear import Embedded
from manoeuvre_nn.diagnosis.regression import regress


@dataclass(frozen=True)
class Piece:
    """A hypothesis at one force level: its columns in every run, whitened, and their products with the base.

    Attributes:
        hypothesis: It.
        columns: Its columns of each run.
        cross: Inner products of all base columns with them, runs summed.
        own: Inner products with themselves.
        index: Where the columns of each run stand.
    """

    hypothesis: Hypothesis
    columns: list[Embedded]
    cross: Float[np.ndarray, "base k"]
    own: Float[np.ndarray, "k k"]
    index: list[np.ndarray]


class Screen:
    """Pieces of hypotheses, kept."""

    def __init__(self, court: Court) -> None:
        """Begin with none.

        Args:
            court: Where they are judged.
        """
        self.court = court
        self._pieces: dict[tuple[int, int], Piece] = {}

    def piece(self, hypothesis: Hypothesis, level: int) -> Piece:
        """A hypothesis at a force level; made when it is first asked for.

        Args:
            hypothesis: It; asked for again as the same object.
            level: Force level.

        Returns:
            The piece.
        """
        key = (id(hypothesis), level)
        if key not in self._pieces:
            self._pieces[key] = self._made(hypothesis, level)
        return self._pieces[key]

    def _made(self, hypothesis: Hypothesis, level: int) -> Piece:
        bench = self.court.bench
        lin, here = linear(bench, hypothesis), bench.at(level)
        cross, own = np.zeros((bench.size, lin.count)), np.zeros((lin.count, lin.count))
        columns = []
        for run, (c, at) in enumerate(zip(lin.columns, lin.index, strict=True)):
            more = here.white[run].embed(c)
            cross[np.ix_(bench.base_index(run), at)] += here.base[run].dot(more)
            own[np.ix_(at, at)] += more.dot(more)
            columns.append(more)
        return Piece(hypothesis, columns, cross, own, lin.index)

    def evidence(self, first: Hypothesis, second: Hypothesis, level: int, scatter: int) -> float:
        """Log evidence of two hypotheses together after a linear step of all their numbers.

        Args:
            first: One.
            second: The other.
            level: Force level.
            scatter: Scatter level.

        Returns:
            Log evidence.
        """
        bench, court = self.court.bench, self.court
        a, b = self.piece(first, level), self.piece(second, level)
        between = np.zeros((a.own.shape[0], b.own.shape[0]))
        for mine, at, other, to in zip(a.columns, a.index, b.columns, b.index, strict=True):
            between[np.ix_(at, to)] += mine.dot(other)
        base = bench.at(level)
        gram = np.block([
            [base.base_gram, a.cross, b.cross],
            [a.cross.T, a.own, between],
            [b.cross.T, between.T, b.own],
        ])
        free, now = [*first.free(), *second.free()], np.r_[first.vector(), second.vector()]
        shift = np.array([f.mean(v) - v for f, v in zip(free, now, strict=True)])
        size, many = bench.size, len(first.free())
        wholes = [size, size + 1 + many]
        numbers = np.r_[size + 1 : size + 1 + many, size + 2 + many : len(gram)]
        data = np.zeros(len(gram))
        data[0], data[wholes], data[numbers] = 1.0, -1.0, -shift
        keep = np.r_[0, wholes, 1:size, numbers]
        prior = np.r_[np.ones(court.coefficients), np.full(len(bench.places), LATENCY_SPREAD), [f.spread for f in free]]
        found = regress(gram[np.ix_(keep, keep)][None], np.array([base.norm]), court.coefficients, data[keep], prior)
        return float(found.by_level[0, scatter])
