"""What a network is: scaled inputs -> scaled outputs.

To a ship it gives forces from velocities and rudder angle, or the next velocities from forces; to a response in a
seaway (:mod:`.core.response`) its value from what is seen of the service parameters.
"""

import copy
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import ClassVar

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn


def times(rows: Float[Tensor, "*batch k"], table: Float[Tensor, "*own k m"]) -> Float[Tensor, "*both m"]:
    """Rows times one table, or each times its own."""
    return rows @ table if table.ndim == 2 else (rows[..., None, :] @ table)[..., 0, :]


def products_of(
    variables: Float[Tensor, "variables *batch"], places: Int[Tensor, "terms order"]
) -> Float[Tensor, "*batch terms"]:
    """Products of variables, each a few look-ups instead of powers.

    Args:
        variables: One row a variable: a look-up then copies whole rows of samples, three times as fast as columns.
        places: Rows that each product is made of.

    Returns:
        One column a product.
    """
    # One look-up for all factors: where few rows are sailed, the number of operations is what takes time.
    result, *others = variables.index_select(0, places.T.flatten()).chunk(places.shape[-1])
    for factors in others:
        result = result * factors
    return result.movedim(0, -1)


def filled(places: Sequence[Sequence[int]]) -> Int[Tensor, "terms order"]:
    """Places of :func:`products_of`; products of fewer variables are filled up with the first, which is 1."""
    order = max((len(p) for p in places), default=0) or 1
    rows = torch.tensor([[*p, *[0] * (order - len(p))] for p in places], dtype=torch.long).reshape(-1, order)
    return rows.T.contiguous().T  # factor by factor in memory, as they are looked up


class Network(ABC, nn.Module):
    """Outputs by learnt weights. A ship's forces come from u, v, r, delta and whatever recorded inputs it takes.

    One that predicts velocities, step by step, has inputs and outputs of its own: :mod:`.network.recursive`.

    Three buffers mean the same in every network that has them: ``trained`` is the number of members that answer,
    ``shaft`` the nominal shaft speed over that of the training, and ``noise`` what :attr:`noise_of_fit` says.
    """

    any_fit: ClassVar[bool] = True
    """Whether methods that are made for no network in particular can train it, by its parameters' gradients."""

    @property
    def takes(self) -> tuple[str, ...]:
        """Recorded inputs that the forces depend on beside the rudder, by their names in :class:`.Inputs`."""
        return ()

    @property
    def scalings(self) -> tuple[str, ...]:
        """Scalings of the inputs that the network can be trained with; empty if any will do."""
        return ()

    @property
    def answering(self) -> int:
        """Number of trained members that answer for themselves; 0 or 1 for a network that is no ensemble."""
        return int(self._buffers.get("trained", 1))  # type: ignore[arg-type]

    @property
    def shaft_ratio(self) -> Tensor | float:
        """Nominal shaft speed over that of the training [-]."""
        return self._buffers.get("shaft", 1.0)  # type: ignore[return-value]

    @property
    def members(self) -> int:
        """Number of its members, trained or not."""
        return 1

    @property
    def noise_of_fit(self) -> Float[Tensor, " 6"]:
        """Standard deviation that u, v, r, x, y, psi were given in the fit, in U0, U0/L, L, rad; 0 without one."""
        return self._buffers.get("noise", torch.zeros(6, dtype=torch.float64))  # type: ignore[return-value]

    @abstractmethod
    def forward(self, x: Float[Tensor, "*batch inputs"]) -> Float[Tensor, "*batch outputs"]:
        """Outputs.

        Args:
            x: Scaled inputs. For forces u, v, r, delta; with three more the shaft speed (or the approach speed) over
                the nominal one and the velocity of the air relative to the ship over U0, forward and to starboard.

        Returns:
            Scaled outputs, such as forces.
        """

    def of(self, x: Float[Tensor, "n inputs"], member: Int[Tensor, " n"]) -> Float[Tensor, "n outputs"]:
        """Scaled forces at every input by a member of its own; those of the network itself where it is no ensemble."""
        return self(x)

    def at_shaft(self, ratio: float) -> "Network":
        """The same network at this many times the nominal shaft speed, if it knows one; it shares the weights."""
        shaft = self._buffers.get("shaft")
        if shaft is None or ratio == 1.0:
            return self
        other = copy.copy(self)
        other._buffers = {**self._buffers, "shaft": shaft * ratio}
        return other

    def sensitivities(self, x: Float[Tensor, "*batch inputs"]) -> Float[Tensor, "*batch k 3"]:
        """Forces by one standard deviation of each independent combination of coefficients; no row where unknown."""
        return x[..., None, :][..., :0, :3]
