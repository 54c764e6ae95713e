"""Many pairs of hypotheses fitted by a linear step each: what one adds is whitened once, not once a pair."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.estimation.hypothesis import Hypothesis
from manoeuvre_nn.estimation.linear_run import Embedded
from manoeuvre_nn.estimation.marginal_likelihood import MarginalLikelihood, hypothesis_columns


@dataclass(frozen=True)
class WhitenedHypothesis:
    """A hypothesis at one force level: its columns in every run, whitened, and their products with the base.

    Attributes:
        hypothesis: It.
        columns: Its columns of each run.
        cross: Inner products of all base columns with them, runs summed.
        own: Inner products with themselves.
        index: Where the columns of each run data_set.
    """

    hypothesis: Hypothesis
    columns: list[Embedded]
    cross: Float[np.ndarray, "base k"]
    own: Float[np.ndarray, "k k"]
    index: list[np.ndarray]


class PairScreen:
    """Pieces of hypotheses, kept."""

    def __init__(self, likelihood: MarginalLikelihood) -> None:
        """Begin with none.

        Args:
            likelihood: Where they are fitted.
        """
        self.likelihood = likelihood
        self._pieces: dict[tuple[int, int], WhitenedHypothesis] = {}

    def piece(self, hypothesis: Hypothesis, level: int) -> WhitenedHypothesis:
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

    def _made(self, hypothesis: Hypothesis, level: int) -> WhitenedHypothesis:
        data_set = self.likelihood.data_set
        lin = hypothesis_columns(data_set, hypothesis)
        columns = data_set.embedded(level, lin.columns)
        gram = data_set.gram(level, columns, lin.index, lin.count)
        size = data_set.size
        return WhitenedHypothesis(hypothesis, columns, gram[:size, size:], gram[size:, size:], lin.index)

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
        data_set = self.likelihood.data_set
        a, b = self.piece(first, level), self.piece(second, level)
        between = np.zeros((a.own.shape[0], b.own.shape[0]))
        for mine, at, other, to in zip(a.columns, a.index, b.columns, b.index, strict=True):
            between[np.ix_(at, to)] += mine.dot(other)
        base = data_set.at(level)
        gram = np.block([
            [base.base_gram, a.cross, b.cross],
            [a.cross.T, a.own, between],
            [b.cross.T, between.T, b.own],
        ])
        unknowns, now = [*first.unknowns(), *second.unknowns()], np.r_[first.vector(), second.vector()]
        shift = np.array([f.mean(v) - v for f, v in zip(unknowns, now, strict=True)])
        size, many = data_set.size, len(first.unknowns())
        wholes = [size, size + 1 + many]
        numbers = np.r_[size + 1 : size + 1 + many, size + 2 + many : len(gram)]
        data = np.zeros(len(gram))
        data[0], data[wholes], data[numbers] = 1.0, -1.0, -shift
        keep = np.r_[0, wholes, 1:size, numbers]
        found = data_set.posterior(gram[np.ix_(keep, keep)], base.norm, data[keep], [f.spread for f in unknowns])
        return float(found.evidence[scatter])
