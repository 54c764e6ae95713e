"""What Levenberg-Marquardt asks of a least-squares problem, and the product that such problems are made of."""

from abc import ABC, abstractmethod

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

Carry = tuple[Tensor, ...]
"""What an evaluation leaves for the derivatives at the same weights; every tensor has K rows."""


class LeastSquares(ABC):
    """K independent least-squares problems of one shape, a row each.

    Attributes:
        residuals: Errors of a row.
    """

    residuals: int

    @abstractmethod
    def evaluate(self, weights: Float[Tensor, "k p"]) -> tuple[Float[Tensor, " k"], Carry]:
        """Errors.

        Returns:
            Mean square error of every row, and what :meth:`linearise` can use at the same weights.
        """

    @abstractmethod
    def linearise(
        self, weights: Float[Tensor, "k p"], carry: Carry
    ) -> tuple[Float[Tensor, "k p p"], Float[Tensor, "k p"]]:
        """Normal equations.

        Args:
            weights: Unknowns of every row.
            carry: What :meth:`evaluate` left at these weights.

        Returns:
            J^T J and J^T e.
        """

    def take(self, rows: Int[Tensor, " k"]) -> "LeastSquares":
        """The problem with some of the rows.

        Returns:
            A problem that shares the data; this one where all rows have the same.
        """
        return self


def gram(rows: Float[Tensor, "k p n"]) -> Float[Tensor, "k p p"]:
    """``X X^T`` of every matrix.

    The product is symmetric, and BLAS has a routine that forms only half of it (syrk). torch does not call it; numpy
    does for a product of an array with its own transpose.

    Args:
        rows: X; it is not followed by autograd.

    Returns:
        The products.
    """
    if rows.device.type != "cpu":
        return rows @ rows.mT
    products = np.empty((*rows.shape[:2], rows.shape[1]), dtype=str(rows.dtype).removeprefix("torch."))
    for matrix, product in zip(rows.detach().numpy(), products, strict=True):
        np.matmul(matrix, matrix.T, out=product)
    return torch.from_numpy(products)
