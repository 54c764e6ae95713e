"""Which terms are missing, found on one half of the data and tested on the other, false discoveries controlled.

Halves are drawn many times; a term's p-value is twice the median of those that its tests gave, 1 where the first half
did not choose it (Meinshausen, Meier & Buehlmann 2009). Benjamini & Hochberg's rule (1995) keeps terms so that few of
them are false. The samples are white under what every case has, so that halves of blocks are independent.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int
from scipy.stats import false_discovery_control
from scipy.stats import t as student

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.recording import Recording
from studies.concealed_trial.rivals.package import Model
from studies.concealed_trial.rivals.sindy import TERMS, library
from studies.concealed_trial.rivals.track import ROWS
from studies.concealed_trial.rivals.whitened import WhitenedRuns

SPLITS = 24
"""Draws of halves; each half chooses once and tests once."""
BLOCK = 4
"""Neighbouring averages that stay together."""
LEVEL = 0.05
"""Share of false terms among those that are kept."""
MISSED = 3.0
"""Size that a term may have without being found, in standard deviations of all the data."""
PENALTY = 0.8
"""Of the lasso, over that at which noise alone rarely brings a term in: what it lets in is tested."""
OWN_SHARE = 0.35
"""Part of a term that no simpler ones make, below which it is left out."""
MAX_TERMS = 12
"""Terms that a half may choose."""


class TestedTerms(WhitenedRuns):
    """The runs as the tested terms show them, and what a hypothesis says of these and of the others.

    A hypothesis has to take off what the kept terms find. A term that it makes and that was not kept speaks against it
    by as much as it is larger than what the tests may have missed.

    Attributes:
        discovered: The false discovery rate at which each term would be kept; 1 for those that are left out.
    """

    def __init__(self, dynamics: Model, runs: Sequence[Recording]) -> None:
        """Choose and test the terms.

        Args:
            dynamics: Calm-water model.
            runs: The runs.
        """
        super().__init__(dynamics, runs)
        table = np.concatenate([t.averaged(library(t)) for t in self.tracks])
        columns = np.einsum("bt,rs->brst", table, np.eye(len(ROWS))).reshape(*self.errors.shape, -1)
        columns = super().seen(columns).reshape(self.errors.size, -1)
        columns /= np.linalg.norm(columns, axis=0) + 1e-12
        self._calm = super().seen(self.errors[..., None]).reshape(-1, 1)
        own = distinct(columns)
        self.discovered = np.ones(columns.shape[1])
        self.discovered[own] = discoveries(columns[:, own], self._calm[:, 0])
        self._kept = self.discovered <= LEVEL
        # Kept terms come first, so that no other takes part of what they show.
        order = np.argsort(~self._kept, kind="stable")
        self._basis = np.zeros_like(columns)
        triangle = np.linalg.qr(columns[:, order])[0]
        self._basis[:, order[: triangle.shape[1]]] = triangle

    def seen(self, errors: Float[np.ndarray, "b 6 k"]) -> Float[np.ndarray, "n rows k"]:
        """What of the kept terms is left, and what of others a hypothesis should not make.

        Args:
            errors: Averaged errors, one column a hypothesis.

        Returns:
            As many numbers in each row as there are terms.
        """
        white = super().seen(errors).reshape(self.errors.size, -1)
        left, made = self._basis.T @ white, self._basis.T @ (self._calm - white)
        beyond = np.sign(made) * np.maximum(np.abs(made) - MISSED, 0.0)
        return np.where(self._kept[:, None], left, beyond).reshape(len(ROWS), len(TERMS), -1).swapaxes(0, 1)


def distinct(x: Float[np.ndarray, "m t"]) -> Int[np.ndarray, " k"]:
    """Terms that the ones before them do not make already: of two that look alike no half would choose the same.

    Args:
        x: Terms of norm one, the simpler ones first.

    Returns:
        Their numbers.
    """
    basis = np.zeros((len(x), 0))
    kept: list[int] = []
    for k in np.argsort(np.arange(x.shape[1]) % (x.shape[1] // len(ROWS)), kind="stable"):
        left = x[:, k] - basis @ (basis.T @ x[:, k])
        size = float(np.linalg.norm(left))
        if size > OWN_SHARE:
            basis, kept = np.column_stack([basis, left / size]), [*kept, int(k)]
    return np.sort(kept)


def discoveries(x: Float[np.ndarray, "m t"], y: Float[np.ndarray, " m"]) -> Float[np.ndarray, " t"]:
    """The false discovery rate at which each term would be kept.

    Args:
        x: Terms of norm one.
        y: What they are to explain.

    Returns:
        Adjusted p-values.
    """
    rng = np.random.default_rng(0)
    block = np.arange(len(y)) // (len(ROWS) * BLOCK)
    count = int(block[-1]) + 1
    p = np.ones((2 * SPLITS, x.shape[1]))
    for k in range(SPLITS):
        first = np.isin(block, rng.permutation(count)[: count // 2])
        for j, half in enumerate((first, ~first)):
            chosen = _chosen(x[half], y[half])
            p[2 * k + j, chosen] = np.minimum(_p_values(x[~half][:, chosen], y[~half]) * max(len(chosen), 1), 1.0)
    return false_discovery_control(np.minimum(2 * np.median(p, axis=0), 1.0), method="bh")


def _chosen(x: Float[np.ndarray, "m t"], y: Float[np.ndarray, " m"]) -> np.ndarray:
    """Terms that the lasso takes in on one half."""
    try:
        from sklearn.linear_model import lars_path
    except ImportError:
        raise InputError('method=sample_split needs scikit-learn: write pip install -e ".[rivals]"') from None
    size = np.linalg.norm(x, axis=0) + 1e-12
    least = PENALTY * np.sqrt(2 * np.log(x.shape[1])) / len(y)
    with np.errstate(all="ignore"):
        _, _, path = lars_path(x / size, y, method="lasso", alpha_min=least, max_iter=60)
    found = np.abs(path[:, -1])
    order = np.argsort(-found)[:MAX_TERMS]
    return np.sort(order[found[order] > 0])


def _p_values(x: Float[np.ndarray, "m k"], y: Float[np.ndarray, " m"]) -> Float[np.ndarray, " k"]:
    """Two-sided t-tests of least squares; the noise is at least what the instruments say."""
    if not x.shape[1]:
        return np.zeros(0)
    inverse = np.linalg.pinv(x.T @ x, hermitian=True)
    found, free = inverse @ (x.T @ y), len(y) - x.shape[1]
    noise = max(float(((y - x @ found) ** 2).sum() / free), 1.0)
    return 2 * student.sf(np.abs(found) / np.sqrt(noise * np.diag(inverse) + 1e-12), free)
