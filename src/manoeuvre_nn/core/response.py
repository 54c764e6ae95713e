"""A response of a ship in a seaway as a function of a few service parameters: records of it, and approximations."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from typing import Literal

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.core.network import Network
from manoeuvre_nn.core.scaling import Scaling

Seen = Literal["value", "cos", "none"]
"""How a network sees a variable: as it is, by its cosine (an angle of which only the side ahead or astern counts), or
not at all."""


@dataclass(frozen=True)
class Variable:
    """A service parameter that a response depends on, or the response itself.

    Attributes:
        name: Short name, a word: ``Hs``.
        unit: Unit at the edge, in which people write it: ``kn``.
        size: That unit in SI: a value in the unit times this is in SI.
        meaning: What it is, with its sign.
        symbol: Symbol in a formula, in LaTeX; empty takes the name.
        low: Lower end of the range that it is meant for [SI].
        high: Upper end [SI].
        seen: How a network sees it.
    """

    name: str
    unit: str
    size: float
    meaning: str
    symbol: str = ""
    low: float = -np.inf
    high: float = np.inf
    seen: Seen = "value"

    def __post_init__(self) -> None:
        """Refuse what is no variable.

        Raises:
            InputError: If the name is no word, the range is empty, or it is seen in an unknown way.
        """
        if not self.name.isidentifier():
            raise InputError(f"inputs.{self.name}: expected a word of letters, digits and underscores")
        if not self.low < self.high:
            low, high = self.low / self.size, self.high / self.size
            raise InputError(f"inputs.{self.name}: from {low:g} to {high:g} {self.unit} is no range")
        check_choice(f"inputs.{self.name}.seen", self.seen, ["value", "cos", "none"])

    @property
    def heading(self) -> str:
        """Name and unit, as a column of a file is headed: ``V [kn]``."""
        return f"{self.name} [{self.unit}]"


@dataclass(frozen=True)
class Records:
    """Values of a response at service parameters.

    Attributes:
        inputs: What the columns of the conditions are.
        output: What the values are.
        conditions: A row a record [SI].
        values: The response [SI].
        source: Where they are from, in words.
    """

    inputs: Sequence[Variable]
    output: Variable
    conditions: Float[np.ndarray, "n k"]
    values: Float[np.ndarray, " n"]
    source: str = ""

    def __len__(self) -> int:
        """Number of records."""
        return len(self.values)

    def at(self, rows: Bool[np.ndarray, " n"] | Int[np.ndarray, " m"]) -> "Records":
        """Some of the records."""
        return replace(self, conditions=self.conditions[rows], values=self.values[rows])

    def in_units(self) -> Mapping[str, Float[np.ndarray, " n"]]:
        """Columns by their headings, in the units of the edge, the response last."""
        columns = {v.heading: self.conditions[:, k] / v.size for k, v in enumerate(self.inputs)}
        return {**columns, self.output.heading: self.values / self.output.size}


class Response(nn.Module):
    """An approximation of a response by a network.

    ``y(x) = x_p [a_out net((f(x) - shift)/scale) + b_out]``: f(x) are the variables as the network sees them, x_p is
    the one that the response is proportional to, or 1. In a linear theory that is the wave height.

    Attributes:
        network: Scaled features to scaled response.
        scaling: Shift and scale of both.
        inputs: The variables, in the order of the columns.
        output: The response.
        per: Name of the variable that the response is proportional to; None for none.
    """

    def __init__(
        self, network: Network, scaling: Scaling, inputs: Sequence[Variable], output: Variable, per: str | None = None
    ) -> None:
        """Join the parts."""
        super().__init__()
        self.network, self.scaling = network, scaling
        self.inputs, self.output, self.per = tuple(inputs), output, per

    def forward(self, conditions: Float[Tensor, "*batch k"]) -> Float[Tensor, " *batch"]:
        """The response.

        Args:
            conditions: The variables [SI].

        Returns:
            Its value [SI].
        """
        seen = self.scaling.inputs(features(conditions, self.inputs, self.per))
        return self.scaling.restore(self.network(seen))[..., 0] * factor(conditions, self.inputs, self.per)

    @torch.no_grad()
    def at(self, conditions: Float[np.ndarray, "n k"]) -> Float[np.ndarray, " n"]:
        """The response to conditions that are no tensor [SI]."""
        like = self.scaling.shift
        return self(torch.as_tensor(conditions, dtype=like.dtype, device=like.device)).double().cpu().numpy()


def features(
    conditions: Float[Tensor, "*batch k"], inputs: Sequence[Variable], per: str | None = None
) -> Float[Tensor, "*batch features"]:
    """What a network sees of the variables.

    Args:
        conditions: The variables [SI].
        inputs: What they are.
        per: The variable that the response is proportional to, which is not seen.

    Returns:
        A column for each variable that is seen.

    Raises:
        InputError: If none is left.
    """
    columns = [
        conditions[..., k].cos() if v.seen == "cos" else conditions[..., k]
        for k, v in enumerate(inputs)
        if v.seen != "none" and v.name != per
    ]
    if not columns:
        raise InputError("inputs: the network sees none of them; write inputs.NAME.seen=value for one")
    return torch.stack(columns, dim=-1)


def factor(
    conditions: Float[Tensor, "*batch k"], inputs: Sequence[Variable], per: str | None = None
) -> Float[Tensor, " *batch"]:
    """What the network's output is multiplied by: the variable that the response is proportional to, or 1."""
    if per is None:
        return torch.ones_like(conditions[..., 0])
    names = [v.name for v in inputs]
    check_choice("per", per, names)
    return conditions[..., names.index(per)]


def check_records(records: Records) -> None:
    """Refuse records that cannot be learnt from.

    Args:
        records: The records.

    Raises:
        InputError: If there are too few, or one is not finite.
    """
    if len(records) < 8:
        raise InputError(f"{len(records)} records are too few to learn from; expected 8 or more")
    bad = ~(np.isfinite(records.conditions).all(1) & np.isfinite(records.values))
    if bad.any():
        row = int(np.argmax(bad))
        given = [*records.conditions[row], records.values[row]]
        named = [v.name for v in (*records.inputs, records.output)]
        name = next(n for n, v in zip(named, given, strict=True) if not isfinite(v))
        raise InputError(f"record {row + 1}: {name} is {dict(zip(named, given, strict=True))[name]}; expected a number")
