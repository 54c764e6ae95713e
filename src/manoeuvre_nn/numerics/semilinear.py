"""Separable least squares of networks whose outputs are linear in all but the weights of their nodes."""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from manoeuvre_nn.core.errors import check_choice
from manoeuvre_nn.numerics.least_squares import Carry, LeastSquares, gram


@dataclass(eq=False)
class SemiLinear(LeastSquares):
    """K fits of ``y_o = sum_c C_oc b_j(c) [f_h(c)(z) + s_o f_h(c)(z~)] + sum_e D_oe t_oe``.

    Unknown are the weights inside f. z~ are mirrored inputs, s_o the parity of an output, b factors of the sample, t a
    library. Every parity has a design of its own, and the derivative of a column is a sum over both sides. The best C
    and D are found at every step (Golub & Pereyra 1973), the Jacobian is Kaufman's (1975), and rows of a ridge below
    every design keep it of full rank.

    Attributes:
        y: Targets.
        z: What the nodes see.
        sees: Which of it, and the bias last, each node sees.
        mirror: Sign of every feature when the ship is mirrored [-].
        parity: Sign of every output then; 0 where none is imposed.
        factors: b_j at every sample.
        node: Node of every column of the first kind.
        factor: Its factor.
        library: Columns of the second kind, output by output; a column of zeros is none.
        shrink: Ridge on the columns of the first kind over the size of a column of ones [-]: what the library can say
            is then left to the library.
        activation: ``tanh`` or ``sigmoid``.
        ridge: Size of the ridge over the size of a column of ones [-].
        residuals: N O, errors of a row.
        parameters: P, free weights of a row.
    """

    y: Float[Tensor, "n o"]
    z: Float[Tensor, "n i"]
    sees: Bool[Tensor, "h w"]
    mirror: Float[Tensor, " i"]
    parity: Float[Tensor, " o"]
    factors: Float[Tensor, "j n"]
    node: Int[Tensor, " c"]
    factor: Int[Tensor, " c"]
    library: Float[Tensor, "o e n"]
    shrink: float = 0.0
    activation: str = "tanh"
    ridge: float = 1e-10

    def __post_init__(self) -> None:
        """Lay the data out for the steps."""
        check_choice("network.activation", self.activation, ["sigmoid", "tanh"])
        z = self.z
        self.residuals, self.parameters = self.y.numel(), int(self.sees.sum())
        self._z = torch.cat([z, z.new_ones(len(z), 1)], 1).mT.contiguous()
        self._mirrored = self._z * torch.cat([self.mirror, self.mirror.new_ones(1)])[:, None]
        self._y, self._factors = self.y.mT, self.factors[self.factor]
        rows = [max(self.ridge, self.shrink)] * len(self.node) + [self.ridge] * self.library.shape[1]
        self._ridge = torch.diag(z.new_tensor(rows)) * len(z) ** 0.5
        # Outputs of one parity and one library share a design.
        self._groups = _alike(self.parity, self.library)

    def full(self, weights: Float[Tensor, "k p"]) -> Float[Tensor, "k h w"]:
        """Free weights among those that are 0.

        Returns:
            All weights of the nodes.
        """
        whole = weights.new_zeros(len(weights), *self.sees.shape)
        whole[:, self.sees] = weights
        return whole

    def evaluate(self, weights: Float[Tensor, "k p"]) -> tuple[Float[Tensor, " k"], Carry]:
        """Mean square errors with the best C and D; nodes of both sides; of every group Q, R, Q^T y and the errors."""
        whole = self.full(weights)
        sides = self._squash(whole @ self._z), self._squash(whole @ self._mirrored)
        carry: list[Tensor] = list(sides)
        total = weights.new_zeros(len(weights))
        for outputs in self._groups:
            q, r = torch.linalg.qr(self._columns(outputs[0], *sides))
            y = torch.nn.functional.pad(self._y[outputs].mT, (0, 0, 0, r.shape[-1]))
            part = q.mT @ y
            errors = q @ part - y
            total = total + errors.square().sum((1, 2))
            carry += [q, r, part, errors]
        return total / self.residuals, tuple(carry)

    def linearise(
        self, weights: Float[Tensor, "k p"], carry: Carry
    ) -> tuple[Float[Tensor, "k p p"], Float[Tensor, "k p"]]:
        """Normal equations of the free weights."""
        left, right = (self._slopes(side, z) for side, z in zip(carry[:2], (self._z, self._mirrored), strict=True))
        normal = weights.new_zeros(*weights.shape, weights.shape[1])
        gradient = torch.zeros_like(weights)
        for k, outputs in enumerate(self._groups):
            q, r, part, errors = carry[2 + 4 * k : 6 + 4 * k]
            best = torch.linalg.solve_triangular(r, part, upper=True)
            sign, count = float(self.parity[outputs[0]]), left.shape[-1]
            slopes = left if sign == 0 else left + sign * right
            for index in range(len(outputs)):
                strength = self._strength(best[:, : len(self.node), index])
                jacobian = (slopes * strength[:, :, None]).flatten(1, 2)[:, self.sees.flatten()]
                within = jacobian @ q[:, :count]
                normal = normal + gram(jacobian) - within @ within.mT
                gradient = gradient + (jacobian @ errors[:, :count, index, None])[..., 0]
        return normal, gradient

    def output_weights(self, weights: Float[Tensor, "k p"]) -> Float[Tensor, "k o c"]:
        """The best C and D.

        Returns:
            C and then D of every output.
        """
        _, carry = self.evaluate(weights)
        columns = len(self.node) + self.library.shape[1]
        found = weights.new_zeros(len(weights), len(self._y), columns)
        for k, outputs in enumerate(self._groups):
            _, r, part, _ = carry[2 + 4 * k : 6 + 4 * k]
            found[:, outputs] = torch.linalg.solve_triangular(r, part, upper=True).mT
        return found

    def _columns(self, output: int, left: Tensor, right: Tensor) -> Tensor:
        """Design of an output with its ridge: (K, N + columns, columns)."""
        sign = float(self.parity[output])
        nodes = left if sign == 0 else left + sign * right
        columns = torch.cat([nodes[:, self.node] * self._factors, self.library[output].expand(len(left), -1, -1)], 1)
        return torch.cat([columns, self._ridge.expand(len(left), -1, -1)], 2).mT

    def _slopes(self, nodes: Tensor, z: Tensor) -> Tensor:
        """Derivatives of the nodes by their weights: (K, H, W, N)."""
        slope = nodes - nodes.square() if self.activation == "sigmoid" else 1 - nodes.square()
        return slope[:, :, None] * z

    def _strength(self, best: Float[Tensor, "k c"]) -> Float[Tensor, "k h n"]:
        """What a node's value is multiplied by at every sample."""
        whole = best.new_zeros(len(best), len(self.sees), self._factors.shape[1])
        return whole.index_add(1, self.node, best[..., None] * self._factors)

    def _squash(self, inner: Tensor) -> Tensor:
        return inner.sigmoid_() if self.activation == "sigmoid" else inner.tanh_()


def _alike(parity: Float[Tensor, " o"], library: Float[Tensor, "o e n"]) -> list[list[int]]:
    """Outputs whose columns are the same."""
    groups: list[list[int]] = []
    for o in range(len(parity)):
        same = (g for g in groups if parity[g[0]] == parity[o] and torch.equal(library[g[0]], library[o]))
        found = next(same, None)
        if found is None:
            groups.append([o])
        else:
            found.append(o)
    return groups
