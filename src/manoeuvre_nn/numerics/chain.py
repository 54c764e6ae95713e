"""Normal equations of a chain: every sample is tied to itself and to its neighbours only.

States over time that obey a law with noise have a precision matrix of small blocks on and next to the diagonal. LAPACK
factors and solves such a band in time proportional to its length; what it lacks, the covariance of each sample and of
neighbours, is a short recursion.

Source:
    Golub & Van Loan 2013, Matrix Computations, sections 4.3.5 and 4.5; Takahashi, Fagan & Chin 1973 for the inverse.
"""

from functools import cached_property

import numpy as np
from jaxtyping import Float
from scipy.linalg import lapack


class Chain:
    """A positive definite block tridiagonal matrix ``A``, factored ``A = C C^T``.

    Attributes:
        samples: Number of blocks n.
        size: Size of a block k.
        log_det: log det A.
    """

    def __init__(self, diagonal: Float[np.ndarray, "n k k"], below: Float[np.ndarray, "m k k"]) -> None:
        """Factor.

        Args:
            diagonal: Blocks on the diagonal.
            below: The n - 1 blocks below it.

        Raises:
            LinAlgError: If the matrix is not positive definite.
        """
        self.samples, self.size = diagonal.shape[:2]
        self.factor, info = lapack.dpbtrf(band(diagonal, below), lower=1)
        if info:
            raise np.linalg.LinAlgError("the precision of a run's states is not positive definite")
        self.log_det = 2 * float(np.log(self.factor[0]).sum())

    def whiten(self, right: Float[np.ndarray, "n k p"] | Float[np.ndarray, "nk p"]) -> Float[np.ndarray, "nk p"]:
        """``C^-1 b``: inner products of such vectors are those of ``A^-1``; no copy of (n k, p) in Fortran's order."""
        if not right.size:  # LAPACK does not stand arrays without columns
            return np.zeros((self.samples * self.size, 0))
        white, _ = lapack.dtbtrs(self.factor, right.reshape(self.samples * self.size, -1), uplo="L")
        return white

    def unwhiten(self, white: Float[np.ndarray, "nk p"]) -> Float[np.ndarray, "n k p"]:
        """``C^-T w``: solutions from whitened right-hand sides."""
        if not white.size:
            return np.zeros((self.samples, self.size, 0))
        solved, _ = lapack.dtbtrs(self.factor, white, uplo="L", trans="T")
        return solved.reshape(self.samples, self.size, -1)

    @cached_property
    def covariances(self) -> tuple[Float[np.ndarray, "n k k"], Float[np.ndarray, "m k k"]]:
        """Blocks of ``A^-1`` on and below the diagonal.

        With ``A = C C^T`` and ``G = C_below C_own^-1``, from the last sample back:
        ``S = (C_own C_own^T)^-1 + G^T S_next G``, and below it ``-S_next G``.
        """
        own, below = self._blocks()
        inverse = np.linalg.inv(own)
        gain = below @ inverse[:-1]
        on = inverse.transpose(0, 2, 1) @ inverse
        for k in range(self.samples - 2, -1, -1):
            on[k] += gain[k].T @ on[k + 1] @ gain[k]
        return on, -on[1:] @ gain

    def _blocks(self) -> tuple[Float[np.ndarray, "n k k"], Float[np.ndarray, "m k k"]]:
        """The factor as blocks."""
        n, k = self.samples, self.size
        rows = self.factor.reshape(2 * k, n, k)
        own, below = np.zeros((n, k, k)), np.zeros((n - 1, k, k))
        for j in range(k):
            for i in range(k):
                if i >= j:
                    own[:, i, j] = rows[i - j, :, j]
                below[:, i, j] = rows[k + i - j, :-1, j]
        return own, below


def band(diagonal: Float[np.ndarray, "n k k"], below: Float[np.ndarray, "m k k"]) -> Float[np.ndarray, "b nk"]:
    """Lower band storage of a block tridiagonal matrix: element (i, j) at [i - j, j].

    Args:
        diagonal: Blocks on the diagonal.
        below: The n - 1 blocks below it.

    Returns:
        2 k rows, one column a row of the matrix, in Fortran's order.
    """
    n, k = diagonal.shape[:2]
    columns = np.zeros((n, k, 2 * k))
    for j in range(k):
        columns[:, j, : k - j] = diagonal[:, j:, j]
        columns[:-1, j, k - j : 2 * k - j] = below[:, :, j]
    return columns.reshape(n * k, 2 * k).T
