"""Noise of averaged errors: first-order autoregression in time, correlated between the equations."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

MEMORY = 0.9
"""Largest autocorrelation of neighbouring averages."""
BLOCKS = ((0, 1, 2), (3,), (4,), (5,))
"""Rows whose errors are correlated: the equations with each other, not with those of instruments."""


@dataclass(frozen=True)
class Noise:
    """What is random in the averaged errors.

    Attributes:
        memory: Autocorrelation of each row from one average to the next.
        covariance: Of what is new in each average.
    """

    memory: Float[np.ndarray, " 6"]
    covariance: Float[np.ndarray, "6 6"]

    def fresh(self, rows: Float[np.ndarray, "b 6 *k"], parts: list[slice]) -> Float[np.ndarray, "b 6 *k"]:
        """What is new in each average of a run; the first is all new, and as precise as its variance lets it be.

        Args:
            rows: Errors or columns.
            parts: Rows of each run.

        Returns:
            Same shape.

        Source:
            Prais & Winsten 1954.
        """
        memory = self.memory.reshape(-1, *[1] * (rows.ndim - 2))
        new = rows.copy()
        for part in parts:
            new[part][1:] -= memory * rows[part][:-1]
            new[part][0] *= np.sqrt(1 - memory**2)
        return new

    @property
    def root(self) -> Float[np.ndarray, "6 6"]:
        """Matrix that makes what is new independent and of variance one."""
        return np.linalg.cholesky(np.linalg.inv(self.covariance)).T

    def white(self, rows: Float[np.ndarray, "b 6 k"], parts: list[slice]) -> Float[np.ndarray, "m k"]:
        """Rows that are independent and of variance one, all averages under each other.

        Args:
            rows: Columns of errors.
            parts: Rows of each run.

        Returns:
            White columns.
        """
        return np.einsum("ij,bjk->bik", self.root, self.fresh(rows, parts)).reshape(-1, rows.shape[-1])

    def deviance(self, count: int, runs: int) -> float:
        """Minus twice the log likelihood at its own estimates, up to a constant.

        Args:
            count: Averages.
            runs: Runs.

        Returns:
            The deviance.
        """
        return float(count * np.linalg.slogdet(self.covariance)[1] - runs * np.log(1 - self.memory**2).sum())


def noise_of(errors: Float[np.ndarray, "b 6"], parts: list[slice], most: float = MEMORY) -> Noise:
    """Noise estimated from errors.

    Args:
        errors: Errors.
        parts: Rows of each run.
        most: Largest autocorrelation.

    Returns:
        The noise.
    """
    power = (errors**2).sum(axis=0) + 1e-12
    product = sum((errors[p][1:] * errors[p][:-1]).sum(axis=0) for p in parts)
    noise = Noise(np.clip(product / power, -MEMORY, most), np.eye(6))
    new = noise.fresh(errors, parts)
    covariance = 1e-8 * np.eye(6)
    for block in BLOCKS:
        covariance[np.ix_(block, block)] += new[:, block].T @ new[:, block] / len(new)
    return Noise(noise.memory, covariance)
