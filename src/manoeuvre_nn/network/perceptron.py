"""Perceptrons with one hidden layer, several of them as one tensor."""

from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor, nn

from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.core.limits import Factor
from manoeuvre_nn.core.network import Network

Activation = Literal["sigmoid", "tanh"]
Initial = Literal["uniform", "symmetric", "normal"]


class Perceptron(Network):
    """K perceptrons of one shape that see the same inputs.

    Row k gives ``y_o = sum_h B_oh f(sum_i W_hi x_i + W_h,I+1) + B_o,H+1``.

    Attributes:
        input_weights: W, bias last, shape (K, H, I + 1).
        output_weights: B, bias last, shape (K, O, H + 1).

    Source:
        Wang 1996, eqs 2.1, 2.2 and 2.4; Rajesh & Bhattacharyya 2009, eqs 17-19.
    """

    def __init__(
        self,
        sizes: tuple[int, int, int, int],
        activation: Activation = "sigmoid",
        initial: Initial = "uniform",
        spread: Factor = 1.0,
        *,
        seed: int = 0,
        dtype: torch.dtype = torch.float64,
    ) -> None:
        """Draw the first weights.

        Args:
            sizes: K networks, I inputs (the bias not counted), H nodes with an activation, O outputs of each network.
            activation: ``sigmoid`` or ``tanh``.
            initial: First weights: ``uniform`` U[0, 1), ``symmetric`` U[-1, 1), or ``normal`` N(0, spread^2).
            spread: Standard deviation of ``normal`` [-].
            seed: Seed of the weights.
            dtype: Floating type.

        Raises:
            InputError: If a number is less than 1, or a setting unknown or out of its range.
        """
        super().__init__()
        networks, inputs, hidden, outputs = sizes
        if min(sizes) < 1:
            raise InputError(f"network of {networks} x {inputs}-{hidden}-{outputs}: every number must be at least 1")
        check_choice("network.activation", activation, ["sigmoid", "tanh"])
        check_choice("network.initial", initial, ["uniform", "symmetric", "normal"])
        if not spread > 0:
            raise InputError(f"network.spread={spread}: expected a standard deviation, more than 0")
        self.activation = activation
        # Drawn in float64 whatever the type, so that float32 and float64 networks start alike.
        generator = torch.Generator().manual_seed(seed)
        shapes = (networks, hidden, inputs + 1), (networks, outputs, hidden + 1)
        first, last = (_draw(shape, initial, spread, generator).to(dtype) for shape in shapes)
        self.input_weights, self.output_weights = nn.Parameter(first), nn.Parameter(last)

    @property
    def rows_count(self) -> int:
        """K, the number of independent networks."""
        return self.input_weights.shape[0]

    def forward(self, x: Float[Tensor, "*batch inputs"]) -> Float[Tensor, "*batch outputs"]:
        """Outputs of all networks side by side."""
        first, last = self.input_weights, self.output_weights
        networks, hidden, _ = first.shape
        flat = x.reshape(-1, x.shape[-1])
        nodes = torch.addmm(first[..., -1].reshape(-1), flat, first[..., :-1].reshape(networks * hidden, -1).T)
        values = self._squash(nodes).reshape(-1, networks, hidden)
        y = torch.einsum("nkh,koh->nko", values, last[..., :-1]) + last[..., -1]
        return y.reshape(*x.shape[:-1], -1)

    def rows(self, x: Float[Tensor, "n inputs"]) -> Float[Tensor, "k n outputs"]:
        """Outputs network by network, as a fit of independent rows wants them."""
        values = self._hidden(x)
        return values @ self.output_weights[..., :-1].mT + self.output_weights[..., None, :, -1]

    @torch.no_grad()
    def jacobian(self, x: Float[Tensor, "n inputs"]) -> Float[Tensor, "k residuals parameters"]:
        """Derivatives of ``rows(x)`` by each row's own weights, many times cheaper than autograd's.

        ``dy_o/dB_oh = f_h``, ``dy_o/dW_hi = B_oh f'_h x_i`` with ``f' = f (1 - f)`` (sigmoid) or ``1 - f^2`` (tanh).

        Args:
            x: Inputs.

        Returns:
            (K, n O, P), P running over ``input_weights`` and then ``output_weights`` of the row.

        Source:
            Wang 1996, eqs 2.15 and 2.19 with ``f(M)(1 - f(M))`` for the misprinted ``M(1 - M)``.
        """
        values = self._hidden(x)
        networks, count, hidden = values.shape
        outputs = self.output_weights.shape[1]
        ones = x.new_ones(count, 1)
        slope = values * (1 - values) if self.activation == "sigmoid" else 1 - values.square()
        back = slope[:, :, None, :] * self.output_weights[:, None, :, :-1]  # (K, n, O, H)
        by_input = back[..., None] * torch.cat([x, ones], 1)[:, None, None, :]  # (K, n, O, H, I + 1)
        nodes = torch.cat([values, ones.expand(networks, -1, -1)], -1)
        by_output = torch.einsum("knh,op->knoph", nodes, torch.eye(outputs, dtype=x.dtype, device=x.device))
        parts = by_input.reshape(networks, count * outputs, -1), by_output.reshape(networks, count * outputs, -1)
        return torch.cat(parts, -1)

    def _hidden(self, x: Tensor) -> Tensor:
        return self._squash(x @ self.input_weights[..., :-1].mT + self.input_weights[..., None, :, -1])

    def _squash(self, nodes: Tensor) -> Tensor:
        return torch.sigmoid(nodes) if self.activation == "sigmoid" else torch.tanh(nodes)


def wang_network(
    hidden: int = 11,
    activation: Activation = "sigmoid",
    initial: Initial = "uniform",
    spread: Factor = 1.0,
    *,
    seed: int = 0,
    dtype: torch.dtype = torch.float64,
) -> Perceptron:
    """Three 4-m-1 networks, one for each g; m counts the sigmoids, the bias comes on top.

    Args:
        hidden: m.
        activation: As in :class:`Perceptron`; by default that of the thesis, as are the first weights.
        initial: Likewise.
        spread: Likewise.
        seed: Seed of the first weights.
        dtype: Floating type.

    Returns:
        The networks.

    Raises:
        InputError: If m is less than 1.

    Source:
        Wang 1996, eq 2.4 (``net + 1`` nodes) and section 4.4.1 (m = 11).
    """
    if hidden < 1:
        raise InputError(f"network.hidden={hidden}: three 4-m-1 networks need at least 1 sigmoid each")
    return Perceptron((3, 4, hidden, 1), activation, initial, spread, seed=seed, dtype=dtype)


def rajesh_network(
    hidden: int = 15,
    activation: Activation = "sigmoid",
    initial: Initial = "symmetric",
    spread: Factor = 1.0,
    *,
    seed: int = 0,
    dtype: torch.dtype = torch.float64,
) -> Perceptron:
    """One 4-m-3 network for all g; m counts the bias node of the hidden layer, so there are m - 1 sigmoids.

    Args:
        hidden: m.
        activation: As in :class:`Perceptron`; by default that of the paper, as are the first weights.
        initial: Likewise.
        spread: Likewise.
        seed: Seed of the first weights.
        dtype: Floating type.

    Returns:
        The network; the paper's input 1 is the bias of its nodes.

    Raises:
        InputError: If m is less than 2.

    Source:
        Rajesh & Bhattacharyya 2009, eqs 16-19.
    """
    if hidden < 2:
        raise InputError(f"network.hidden={hidden}: a 4-m-3 network counts its bias node, so m must be at least 2")
    return Perceptron((1, 4, hidden - 1, 3), activation, initial, spread, seed=seed, dtype=dtype)


def mlp(
    hidden: int = 7,
    activation: Activation = "tanh",
    spread: Factor = 0.3,
    *,
    inputs: int = 4,
    outputs: int = 3,
    seed: int = 0,
    dtype: torch.dtype = torch.float64,
) -> Perceptron:
    """One i-m-o network; m counts the nodes with an activation, biases come on top.

    Args:
        hidden: m.
        activation: As in :class:`Perceptron`.
        spread: Standard deviation of the first weights, which are normal [-].
        inputs: i.
        outputs: o.
        seed: Seed of the first weights.
        dtype: Floating type.

    Returns:
        The network.

    Source:
        Cepowski 2007, Fig. 7: 5-7-1.
    """
    return Perceptron((1, inputs, hidden, outputs), activation, "normal", spread, seed=seed, dtype=dtype)


def _draw(shape: tuple[int, ...], initial: Initial, spread: float, generator: torch.Generator) -> Tensor:
    """First weights in float64."""
    if initial == "normal":
        return spread * torch.randn(shape, generator=generator, dtype=torch.float64)
    uniform = torch.rand(shape, generator=generator, dtype=torch.float64)
    return uniform if initial == "uniform" else 2 * uniform - 1
