"""Shift and scale between quantities and what a network sees of them."""

from jaxtyping import Float
from torch import Tensor, nn


class Scaling(nn.Module):
    """Shift and scale of a network's inputs and outputs.

    ``x = (z - shift)/scale`` goes in, ``z_out = output_scale y + output_shift`` comes out.

    Attributes:
        shift: Subtracted from the inputs, of a ship's forces u', v', r', delta.
        scale: Divides them then.
        output_scale: Multiplies the network's outputs, of a ship's forces g'.
        output_shift: Added then; None adds nothing.
    """

    shift: Tensor
    scale: Tensor
    output_scale: Tensor
    output_shift: Tensor | None

    def __init__(
        self,
        shift: Float[Tensor, " inputs"],
        scale: Float[Tensor, " inputs"],
        output_scale: Float[Tensor, " outputs"],
        output_shift: Float[Tensor, " outputs"] | None = None,
    ) -> None:
        """Store the numbers as buffers, so that a checkpoint holds them."""
        super().__init__()
        self.register_buffer("shift", shift)
        self.register_buffer("scale", scale)
        self.register_buffer("output_scale", output_scale)
        self.register_buffer("output_shift", output_shift)

    def inputs(self, values: Float[Tensor, "*batch inputs"]) -> Float[Tensor, "*batch inputs"]:
        """What the network sees."""
        return (values - self.shift) / self.scale

    def outputs(self, values: Float[Tensor, "*batch outputs"]) -> Float[Tensor, "*batch outputs"]:
        """What the network is trained on."""
        moved = values if self.output_shift is None else values - self.output_shift
        return moved / self.output_scale

    def restore(self, outputs: Float[Tensor, "*batch outputs"]) -> Float[Tensor, "*batch outputs"]:
        """What the network's outputs stand for."""
        scaled = outputs * self.output_scale
        return scaled if self.output_shift is None else scaled + self.output_shift
