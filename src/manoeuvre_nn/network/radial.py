"""Networks whose nodes answer to what is near: radial basis functions, and regression by stored records."""

from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.network import Network
from manoeuvre_nn.numerics.kernel_regression import kernel_mean
from manoeuvre_nn.numerics.radial_basis import gaussian_nodes, k_means

MAX_ELEMENTS = 2e7
"""Numbers in the largest table of distances that is built at once: 160 MB in double precision."""


class RadialBasis(Network):
    """Gaussian nodes and linear outputs: ``y_o = sum_h B_oh exp(-|x - c_h|^2 / (2 s_h^2)) + B_o,H+1``.

    Attributes:
        centres: c, shape (H, I).
        widths: s, shape (H,).
        output_weights: B, bias last, shape (O, H + 1).

    Source:
        Broomhead & Lowe 1988; Moody & Darken 1989.
    """

    any_fit = False
    centres: Tensor
    widths: Tensor
    output_weights: Tensor

    def __init__(
        self, inputs: int = 4, hidden: int = 300, outputs: int = 3, *, seed: int = 0, dtype: torch.dtype = torch.float64
    ) -> None:
        """A network that answers 0 until it is fitted.

        Args:
            inputs: I.
            hidden: H, nodes.
            outputs: O.
            seed: Seed of the first centres, which are normal, and of where the search for better ones begins.
            dtype: Floating type.

        Raises:
            InputError: If a number is less than 1.
        """
        super().__init__()
        if min(inputs, hidden, outputs) < 1:
            raise InputError(f"network of {inputs}-{hidden}-{outputs}: every number must be at least 1")
        self.seed = seed
        drawn = torch.randn(hidden, inputs, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
        self.register_buffer("centres", drawn.to(dtype))
        self.register_buffer("widths", torch.ones(hidden, dtype=dtype))
        self.register_buffer("output_weights", torch.zeros(outputs, hidden + 1, dtype=dtype))

    def forward(self, x: Float[Tensor, "*batch inputs"]) -> Float[Tensor, "*batch outputs"]:
        """Outputs."""
        flat = x.reshape(-1, x.shape[-1])
        y = torch.cat([self.nodes(part) for part in _parts(flat, len(self.centres))])
        return (y @ self.output_weights[:, :-1].mT + self.output_weights[:, -1]).reshape(*x.shape[:-1], -1)

    def nodes(self, x: Float[Tensor, "n inputs"]) -> Float[Tensor, "n hidden"]:
        """Values of the nodes."""
        return gaussian_nodes(x, self.centres, self.widths)

    @torch.no_grad()
    def place(self, x: Float[Tensor, "n inputs"]) -> None:
        """Put the centres where the inputs are dense, by k-means.

        Args:
            x: Scaled inputs of the records to learn from.
        """
        self.centres.copy_(k_means(x, len(self.centres), seed=self.seed))


class GeneralRegression(Network):
    """Regression by stored records (GRNN): a mean of their values, weighted by nearness.

    Its ``records`` and ``values`` grow with what it is given; a checkpoint brings as many as it holds.

    Attributes:
        records: Scaled inputs of the stored records, shape (M, I).
        values: Scaled outputs of them, shape (M, O).
        widths: Smoothing width of each input, shape (I,).

    Source:
        Specht 1991, eq. 5, with a width for every input.
    """

    any_fit = False
    records: Tensor
    values: Tensor
    widths: Tensor

    def __init__(self, inputs: int = 4, outputs: int = 3, *, seed: int = 0, dtype: torch.dtype = torch.float64) -> None:
        """A network that holds one record, and answers 0.

        Args:
            inputs: I.
            outputs: O.
            seed: Not used: nothing is drawn.
            dtype: Floating type.

        Raises:
            InputError: If a number is less than 1.
        """
        del seed
        super().__init__()
        if min(inputs, outputs) < 1:
            raise InputError(f"network of {inputs} inputs, {outputs} outputs: expected at least 1")
        self.register_buffer("records", torch.zeros(1, inputs, dtype=dtype))
        self.register_buffer("values", torch.zeros(1, outputs, dtype=dtype))
        self.register_buffer("widths", torch.ones(inputs, dtype=dtype))

    def forward(self, x: Float[Tensor, "*batch inputs"]) -> Float[Tensor, "*batch outputs"]:
        """Weighted means."""
        parts = _parts(x.reshape(-1, x.shape[-1]), len(self.records))
        y = torch.cat([kernel_mean(part, self.records, self.values, self.widths) for part in parts])
        return y.reshape(*x.shape[:-1], -1)

    def store(
        self, x: Float[Tensor, "m inputs"], y: Float[Tensor, "m outputs"], widths: Float[Tensor, " inputs"]
    ) -> None:
        """Take records in place of those that were stored.

        Args:
            x: Scaled inputs.
            y: Scaled outputs.
            widths: Smoothing widths.
        """
        like = self.widths
        self.records, self.values, self.widths = x.to(like), y.to(like), widths.to(like)

    def _load_from_state_dict(  # type: ignore[override]
        self, state_dict: dict[str, Any], prefix: str, *args: Any
    ) -> None:
        """Make room for as many records as the state has; torch then copies them."""
        for name in ("records", "values"):
            stored, own = state_dict.get(prefix + name), getattr(self, name)
            if stored is not None and stored.ndim == 2 and stored.shape[1] == own.shape[1]:
                setattr(self, name, own.new_empty(stored.shape))
        super()._load_from_state_dict(state_dict, prefix, *args)


def _parts(x: Tensor, columns: int) -> tuple[Tensor, ...]:
    """Inputs in parts of which the table of distances fits into memory."""
    return x.split(max(1, int(MAX_ELEMENTS / columns)))
