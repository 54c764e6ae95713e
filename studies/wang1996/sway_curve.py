"""Curves v(r) of turns, made of one or two small networks each."""

import torch
from jaxtyping import Float
from torch import Tensor, nn


class SwayCurve(nn.Module):
    """Networks for v(r): ``v' = side sum_b w_b(t') [B_b f(W_b |r'|) + B_b,0]``, several curves as rows.

    With one branch w is 1. With two, w_2 goes from 0 to 1 by ``3 s^2 - 2 s^3`` while t' goes through the window of the
    join, and w_1 is what is left: v, dv/dr and dv/dt are continuous in r and in t. The join has to be one in time: at
    the largest r the true dv/dr is infinite, and where it then passes ``(Iz - Nrdot) / Nvdot`` the yaw equation reads
    0 = 0, so that a branch chosen by r alone leaves the ship there.

    Attributes:
        weights: (rows, branches, 3 H + 1): W (H, 2), bias last, then B (H + 1), bias last.
        units: What r' is reduced by before and divided by, and the same for v', (4,) or (rows, 4).
        join: First and last t' of the join, (2,) or (rows, 2).
        side: +1 or -1, () or (rows,).
    """

    weights: Tensor
    units: Tensor
    join: Tensor
    side: Tensor

    def __init__(
        self,
        weights: Float[Tensor, "*rows branches parameters"],
        units: Float[Tensor, "*some 4"],
        join: Float[Tensor, "*other 2"],
        side: Float[Tensor, "*more"],
    ) -> None:
        """Store the numbers.

        Args:
            weights: Weights.
            units: Shifts and scales of r' and v'.
            join: First and last t' of the join.
            side: Side of the turn.
        """
        super().__init__()
        for name, value in {"weights": weights, "units": units, "join": join, "side": side}.items():
            self.register_buffer(name, value)

    def forward(
        self, r: Float[Tensor, "*batch"], time: Float[Tensor, "*batch"]
    ) -> tuple[Float[Tensor, "*batch"], Float[Tensor, "*batch"], Float[Tensor, "*batch"]]:
        """The curve and its derivatives.

        Args:
            r: r' [-]; with rows, one for each in the last dimension.
            time: t' [-].

        Returns:
            v', dv'/dr', dv'/dt'.
        """
        shift, scale, v_shift, v_scale = self.units.unbind(-1)
        first, inner, last, constant = unpack(self.weights)
        nodes = torch.sigmoid(first * ((self.side * r - shift) / scale)[..., None, None] + inner)
        values = (nodes * last).sum(-1) + constant
        slopes = (nodes * (1 - nodes) * last * first).sum(-1)
        if self.weights.shape[-2] == 1:
            v, by_r, by_t = values[..., 0], slopes[..., 0], torch.zeros_like(r)
        else:
            late, rate = gate(time, self.join)
            v = (1 - late) * values[..., 0] + late * values[..., 1]
            by_r = (1 - late) * slopes[..., 0] + late * slopes[..., 1]
            by_t = rate * (values[..., 1] - values[..., 0])
        return self.side * (v * v_scale + v_shift), by_r * v_scale / scale, self.side * by_t * v_scale

    @property
    def rows(self) -> int:
        """Number of curves."""
        return len(self.weights) if self.weights.dim() == 3 else 1

    def row(self, index: int) -> "SwayCurve":
        """One of several curves.

        Args:
            index: Which.

        Returns:
            That curve alone.
        """
        if self.weights.dim() == 2:
            return self
        shared = {"units": self.units, "join": self.join, "side": self.side}
        whole = {"units": 2, "join": 2, "side": 1}
        own = {k: x[index] if x.dim() == whole[k] else x for k, x in shared.items()}
        return SwayCurve(self.weights[index], **own)


def unpack(weights: Float[Tensor, "*rows parameters"]) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Weights of 1-H-1 networks.

    Args:
        weights: W (H, 2), bias last, then B (H + 1), bias last, flattened.

    Returns:
        Slopes and biases of the nodes, their output weights, (..., H) each, and the output's bias (...).
    """
    hidden = (weights.shape[-1] - 1) // 3
    first = weights[..., : 2 * hidden].unflatten(-1, (hidden, 2))
    return first[..., 0], first[..., 1], weights[..., 2 * hidden : -1], weights[..., -1]


def gate(time: Float[Tensor, "*batch"], join: Float[Tensor, "*some 2"]) -> tuple[Tensor, Tensor]:
    """Share of the second branch.

    Args:
        time: t' [-].
        join: First and last t' of the join.

    Returns:
        Share and its rate by t'.
    """
    begin, end = join.unbind(-1)
    s = ((time - begin) / (end - begin)).clamp(0.0, 1.0)
    return s * s * (3 - 2 * s), 6 * s * (1 - s) / (end - begin)


def stack(curves: list[SwayCurve]) -> SwayCurve:
    """Curves of several turns as the rows of one; a curve with one branch has it twice.

    Args:
        curves: Curves with any number of rows.

    Returns:
        All rows in their order.
    """
    flat = [c.row(k) for c in curves for k in range(c.rows)]
    weights = torch.stack([c.weights.expand(2, -1) for c in flat])
    one_branch = torch.tensor([0.0, 1.0], dtype=weights.dtype)
    joins = torch.stack([c.join if len(c.weights) == 2 else one_branch for c in flat])
    return SwayCurve(weights, torch.stack([c.units for c in flat]), joins, torch.stack([c.side for c in flat]))
