"""Records that are alike to a network: left-out records foretell nothing where their twins stay."""

import torch
from jaxtyping import Float
from torch import Tensor

SAME = 1e-9
"""Difference of scaled inputs below which they are the same [-]."""


def without_repeats(
    x: Float[Tensor, "n i"], y: Float[Tensor, "n o"]
) -> tuple[Float[Tensor, "m i"], Float[Tensor, "m o"]]:
    """One record in place of all that have the same inputs, with the mean of their values.

    A response over the wave height is the same at every wave height. Whoever leaves one of these records out and keeps
    the others measures nothing.

    Args:
        x: Scaled inputs.
        y: Values.

    Returns:
        Inputs, all different, and mean values; in the order of the first of each.
    """
    _, group = torch.unique((x / SAME).round(), dim=0, return_inverse=True)
    count = int(group.max()) + 1
    first = torch.full((count,), len(x), device=x.device).scatter_reduce_(
        0, group, torch.arange(len(x), device=x.device), "amin"
    )
    sums = y.new_zeros(count, y.shape[1]).index_add_(0, group, y)
    mean = sums / torch.bincount(group, minlength=count)[:, None]
    first, order = first.sort()
    return x[first], mean[order]
