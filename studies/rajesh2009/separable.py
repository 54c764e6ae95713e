"""Variable projection of perceptrons with one hidden layer: the exact form of the fit, beside the paper's."""

import copy

import torch
from jaxtyping import Float, Int
from torch import Tensor

from manoeuvre_nn.numerics.least_squares import Carry, LeastSquares
from manoeuvre_nn.numerics.one_hidden import OneHidden, pull, spread


class Separable(LeastSquares):
    """K perceptrons on the same inputs; unknown are the input weights alone, as rows (K, H (I + 1)).

    With nodes A(W), a 1 among them, and orthonormal columns ``A = Q R`` the errors that the best output weights leave
    are ``e = (Q Q^T - 1) y``. Their Jacobian has two parts that are orthogonal to each other, ``(1 - Q Q^T) dA B`` and
    ``Q R^-T dA^T e``; Kaufman leaves out the second. Both are products of ``P`` with Q and e, so that
    again no Jacobian is formed.

    Nodes that saturate or run together make A lose rank. A ridge keeps R regular: rows ``ridge sqrt(N) 1`` below A and
    zeros below y, which the mean square error counts.

    Attributes:
        layer: The perceptrons, with room for the ridge below the samples.
        residuals: N O, errors of a row.
        parameters: Input weights of a row.

    Source:
        Golub & Pereyra 1973; Kaufman 1975; Sjoberg & Viberg 1997 for perceptrons.
    """

    def __init__(
        self,
        x: Float[Tensor, "n i"],
        y: Float[Tensor, "*k n o"],
        hidden: int,
        *,
        activation: str = "sigmoid",
        kaufman: bool = True,
        ridge: float = 1e-10,
    ) -> None:
        """Store the data.

        Args:
            x: Inputs.
            y: Targets, of all rows or of each.
            hidden: H.
            activation: ``sigmoid`` or ``tanh``.
            kaufman: Whether to leave the Jacobian's second part out, which is of second order in the errors and grows
                beyond bounds where A loses rank.
            ridge: Size of the rows below A over the size of a column of ones [-].
        """
        self.layer = layer = OneHidden(x, y, hidden, activation=activation)
        layer.z, layer.y = (layer.padded(part[..., : len(x)], hidden + 1) for part in (layer.z, layer.y))
        self.kaufman, self.samples, self.ridge = kaufman, len(x), ridge * len(x) ** 0.5
        self.residuals, self.parameters = layer.residuals, hidden * layer.width

    def take(self, rows: Int[Tensor, " k"]) -> "Separable":
        """See :meth:`.LeastSquares.take`."""
        part = copy.copy(self)
        part.layer = self.layer.take(rows)
        return part

    def evaluate(self, weights: Float[Tensor, "k p"]) -> tuple[Float[Tensor, " k"], Carry]:
        """Mean square errors with the best output weights; A, Q, R, Q^T y and the errors for the derivatives."""
        layer = self.layer
        nodes = layer.nodes(weights.unflatten(1, (layer.hidden, layer.width)))
        columns = torch.cat([nodes, layer.z[-1].expand(len(nodes), 1, -1)], 1)
        columns[..., self.samples : self.samples + layer.hidden + 1].diagonal(dim1=1, dim2=2).fill_(self.ridge)
        q, r = torch.linalg.qr(columns.mT)
        part = layer.y @ q
        errors = (part @ q.mT).sub_(layer.y)
        return errors.square().sum((1, 2)) / self.residuals, (nodes, q, r, part, errors)

    def linearise(
        self, weights: Float[Tensor, "k p"], carry: Carry
    ) -> tuple[Float[Tensor, "k p p"], Float[Tensor, "k p"]]:
        """Normal equations of the input weights."""
        nodes, q, r, part, errors = carry
        inverse = torch.linalg.solve_triangular(r, torch.eye(len(r[0]), dtype=r.dtype, device=r.device), upper=True)
        last = (part @ inverse.mT)[..., :-1]
        products = self.layer.products(nodes, q.mT, errors)
        sizes = [self.parameters, len(r[0]), self.layer.outputs]
        by_node, by_q, by_error = products[:, : self.parameters].split(sizes, 2)
        reduced = by_node - by_q @ by_q.mT
        normal = spread(last, reduced, torch.empty_like(reduced))
        if not self.kaufman:
            normal += spread(inverse[:, :-1].mT, by_error @ by_error.mT, reduced)
        return normal, pull(last, by_error)

    def output_weights(self, weights: Float[Tensor, "k p"]) -> Float[Tensor, "k o nodes"]:
        """The best output weights.

        Args:
            weights: Input weights.

        Returns:
            B, bias last.
        """
        _, (_, _, r, part, _) = self.evaluate(weights)
        return torch.linalg.solve_triangular(r, part.mT, upper=True).mT
