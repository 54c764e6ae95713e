"""A matrix times its own transpose, at half the price where a library offers it."""

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor


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
