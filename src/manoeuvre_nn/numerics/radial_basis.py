"""Radial basis functions: where their centres stand, how wide they are, and their weights by ridge regression."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from manoeuvre_nn.core.errors import InputError

MAX_ITERATIONS = 100
"""Iterations of the clusters' centres at most; fewer if no point changes its cluster."""


def gaussian_nodes(
    x: Float[Tensor, "n i"], centres: Float[Tensor, "h i"], widths: Float[Tensor, " h"]
) -> Float[Tensor, "n h"]:
    """``exp(-|x - c_h|^2 / (2 s_h^2))``.

    Args:
        x: Where.
        centres: c.
        widths: s.

    Returns:
        Values of the nodes.

    Source:
        Broomhead & Lowe 1988.
    """
    return torch.exp(-0.5 * squared_distances(x, centres) / widths.square())


def squared_distances(x: Float[Tensor, "n i"], centres: Float[Tensor, "h i"]) -> Float[Tensor, "n h"]:
    """``|x - c_h|^2`` as the sum of its parts: ``x^2 - 2 x c + c^2`` cancels where x and c are close and far from 0."""
    parts = ((a[:, None] - c).square() for a, c in zip(x.mT, centres.mT, strict=True))
    return sum(parts, x.new_zeros(len(x), len(centres)))


def k_means(x: Float[Tensor, "n i"], count: int, *, seed: int = 0) -> Float[Tensor, "h i"]:
    """Centres of clusters by Lloyd's iteration, first ones drawn among the points, far from each other.

    Args:
        x: Points.
        count: Number of clusters; with as many as there are points every point is a centre.
        seed: Seed of the first centres.

    Returns:
        Centres; a cluster that loses all its points keeps its centre.

    Raises:
        InputError: If there are fewer points than clusters.

    Source:
        Lloyd 1982; Arthur & Vassilvitskii 2007 (first centres); Moody & Darken 1989 for its use here.
    """
    if not 1 <= count <= len(x):
        share = "as many as records are learnt; learning= says the share"
        raise InputError(f"network.hidden={count}: expected from 1 to {len(x)}, {share}")
    centres = x[_far_apart(x, count, torch.Generator().manual_seed(seed))].clone()
    nearest: Tensor | None = None
    for _ in range(MAX_ITERATIONS):
        last, nearest = nearest, torch.cdist(x, centres).argmin(1)
        if last is not None and torch.equal(last, nearest):
            break
        sums = torch.zeros_like(centres).index_add_(0, nearest, x)
        members = torch.bincount(nearest, minlength=count)[:, None]
        centres = torch.where(members > 0, sums / members.clamp(min=1), centres)
    return centres


def _far_apart(x: Tensor, count: int, generator: torch.Generator) -> Int[Tensor, " h"]:
    """Points drawn one after the other, by the square of the distance to those drawn before."""
    chosen = [int(torch.randint(len(x), (1,), generator=generator))]
    square = (x - x[chosen[0]]).square().sum(1)
    for _ in range(count - 1):
        left = square if square.sum() > 0 else torch.ones_like(square).index_fill(0, torch.tensor(chosen), 0.0)
        chosen.append(int(torch.multinomial(left.cpu().double(), 1, generator=generator)))
        square = torch.minimum(square, (x - x[chosen[-1]]).square().sum(1))
    return torch.tensor(chosen, device=x.device)


def neighbour_distances(centres: Float[Tensor, "h i"], neighbours: int) -> Float[Tensor, " h"]:
    """Root mean square distance of every centre to its nearest others.

    Args:
        centres: Centres.
        neighbours: How many others; as many as there are, if there are fewer.

    Returns:
        Distances; 1 for a centre that stands alone.

    Source:
        Moody & Darken 1989, the heuristic of the P nearest neighbours.
    """
    if len(centres) == 1:
        return torch.ones_like(centres[:, 0])
    distance = torch.cdist(centres, centres).fill_diagonal_(torch.inf)
    nearest = distance.sort(1).values[:, : min(neighbours, len(centres) - 1)]
    found = nearest.square().mean(1).sqrt()
    positive = found[found > 0]
    return torch.where(found > 0, found, positive.min() if len(positive) else torch.ones_like(found))


@dataclass(frozen=True)
class RidgeFit:
    """Linear weights and what they are worth.

    Attributes:
        weights: Weights of the nodes and, last, the bias.
        ridge: What was added to the diagonal.
        press: Mean square error of every record foretold by weights fitted to the others.
        mse: Mean square error of the fit.
    """

    weights: Float[Tensor, "o nodes"]
    ridge: float
    press: float
    mse: float


def ridge_by_press(nodes: Float[Tensor, "n h"], values: Float[Tensor, "n o"], ridges: Sequence[float]) -> RidgeFit:
    """``min |y - A w - b|^2 + ridge |w|^2`` with the ridge that foretells left-out records best.

    With ``A = U S V^T`` of the centred nodes the fit is ``(1 1^T / n + U D U^T) y``, D = s^2 / (s^2 + ridge), and the
    error of a record without itself is that with it over 1 less its diagonal element: no fit is done twice.

    Args:
        nodes: A, values of the nodes.
        values: y.
        ridges: Ridges to choose from, over the largest s^2 [-].

    Returns:
        The best fit.

    Raises:
        InputError: If there is no ridge to choose from.

    Source:
        Allen 1974 (PRESS); Golub, Heath & Wahba 1979. The bias is not shrunk.
    """
    middle, mean = nodes.mean(0), values.mean(0)
    left, size, right = torch.linalg.svd(nodes - middle, full_matrices=False)
    heard = size > max(nodes.shape) * torch.finfo(size.dtype).eps * size.max()  # others are rounding errors
    left, size, right = left[:, heard], size[heard], right[heard]
    seen, square = left.mT @ (values - mean), size.square()
    best: RidgeFit | None = None
    for relative in ridges:
        ridge = relative * float(square[:1].sum())
        share = square / (square + ridge)
        error = values - mean - left @ (share[:, None] * seen)
        kept = 1 / len(nodes) + left.square() @ share
        press = float((error / (1 - kept).clamp(min=1e-12)[:, None]).square().mean())
        if best is None or press < best.press:
            weights = right.mT @ ((share / size)[:, None] * seen)
            bias = mean - middle @ weights
            both = torch.cat([weights, bias[None]]).mT.contiguous()
            best = RidgeFit(both, ridge, press, float(error.square().mean()))
    if best is None:
        raise InputError("no ridge to choose from: expected at least one")
    return best
