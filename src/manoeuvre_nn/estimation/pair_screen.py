"""Many pairs of hypotheses fitted by a linear step each: what one adds is whitened once, not once a pair."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.estimation.hypothesis import Hypothesis
from manoeuvre_nn.estimation.linear_run import Embedded
from manoeuvre_nn.estimation.marginal_likelihood import HypothesisColumns, MarginalLikelihood, hypothesis_columns


class _Piece(NamedTuple):
    """A hypothesis at one force level: whitened columns of every run, and their inner products, runs summed."""

    lin: HypothesisColumns
    columns: list[Embedded]
    cross: Float[np.ndarray, "base k"]
    own: Float[np.ndarray, "k k"]


class PairScreen:
    """Pieces of hypotheses, kept."""

    def __init__(self, likelihood: MarginalLikelihood) -> None:
        """Begin with none."""
        self.likelihood = likelihood
        self._pieces: dict[tuple[int, int], _Piece] = {}

    def piece(self, hypothesis: Hypothesis, level: int) -> _Piece:
        """A hypothesis at a force level; made when it is first asked for.

        Args:
            hypothesis: It; asked for again as the same object.
            level: Force level.

        Returns:
            The piece.
        """
        key = (id(hypothesis), level)
        if key not in self._pieces:
            data_set = self.likelihood.data_set
            lin, size = hypothesis_columns(data_set, hypothesis), data_set.size
            columns = data_set.embedded(level, lin.columns)
            gram = data_set.gram(level, columns, lin.index, lin.count)
            self._pieces[key] = _Piece(lin, columns, gram[:size, size:], gram[size:, size:])
        return self._pieces[key]

    def evidence(self, first: Hypothesis, second: Hypothesis, level: int, scatter: int) -> float:
        """Log evidence of two hypotheses together after a linear step of all their numbers."""
        a, b, base = self.piece(first, level), self.piece(second, level), self.likelihood.data_set.at(level)
        between = np.zeros((len(a.own), len(b.own)))
        for mine, at, other, to in zip(a.columns, a.lin.index, b.columns, b.lin.index, strict=True):
            between[np.ix_(at, to)] += mine.dot(other)
        gram = np.block([
            [base.base_gram, a.cross, b.cross],
            [a.cross.T, a.own, between],
            [b.cross.T, between.T, b.own],
        ])
        return float(self.likelihood.regress(gram, base.norm, first, second).evidence[scatter])
