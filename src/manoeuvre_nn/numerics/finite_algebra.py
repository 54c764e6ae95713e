"""Least squares and singular values of finite numbers: with others LAPACK talks to the terminal, or never ends."""

from typing import Any

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.errors import InputError

Numbers = Float[np.ndarray, "..."]


def lstsq(a: Numbers, b: Numbers, rcond: float | None = None) -> Any:
    """Solve a least-squares problem as :func:`numpy.linalg.lstsq` does.

    Args:
        a: Columns.
        b: What they shall give.
        rcond: Smallest singular value that counts, over the largest.

    Returns:
        The solution alone.
    """
    check_finite(a, b)
    return np.linalg.lstsq(a, b, rcond=rcond)[0]


def check_finite(*arrays: Numbers) -> None:
    """Refuse what is no number, or has become too large for one.

    Args:
        arrays: What is looked at.

    Raises:
        InputError: If a number is NaN or infinite.
    """
    if not all(np.isfinite(array).all() for array in arrays):
        raise InputError(
            "numbers grew beyond all bounds while they were fitted: look in the recordings for values that no ship has"
        )
