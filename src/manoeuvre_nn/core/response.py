"""A response of a ship in a seaway as a function of a few service parameters: records of it, and approximations."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite, pi
from typing import Any, TypeVar

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.core.network import Network
from manoeuvre_nn.core.scaling import Scaling
from manoeuvre_nn.core.units import GRAVITY

Number = TypeVar("Number", Tensor, Any)
"""What formulas are made of: tensors, or symbols of an export."""


def encounter_frequency(of: Mapping[str, Number], cos: Callable[[Number], Number]) -> Number:
    """Frequency at which waves are met, ``w - w^2 V cos(beta)/g`` with w = 2 pi/T [rad/s]; beta = 0 is following."""
    wave = 2 * pi / of["T"]
    return wave - wave**2 * of["V"] * cos(of["beta"]) / GRAVITY


def wave_number_along(of: Mapping[str, Number], cos: Callable[[Number], Number]) -> Number:
    """Wave number along the ship on deep water, ``w^2 |cos(beta)|/g`` with w = 2 pi/T [rad/m]."""
    return (2 * pi / of["T"]) ** 2 * abs(cos(of["beta"])) / GRAVITY


Formula = Callable[[Mapping[str, Any], Callable[[Any], Any]], Any]
DERIVED: Mapping[str, tuple[Formula, tuple[str, ...], str, str]] = {
    "encounter_frequency": (encounter_frequency, ("V", "beta", "T"), r"\omega_e", "rad/s"),
    "wave_number_along": (wave_number_along, ("beta", "T"), "k_x", "rad/m"),
}
"""Inputs that linear theory makes of the variables -> formula, variables that it needs, symbol, unit."""
SYMBOLS = frozenset(
    "alpha beta gamma delta epsilon varepsilon zeta eta theta vartheta iota kappa lambda mu nu xi pi rho varrho sigma "
    "tau upsilon phi varphi chi psi omega Gamma Delta Theta Lambda Xi Pi Sigma Upsilon Phi Psi Omega nabla mathrm "
    "mathbf mathit mathcal text bar hat tilde vec dot ddot overline prime".split()
)
"""Commands of LaTeX in a symbol: it may come from a file, and others, such as one that reads a file, are obeyed."""
COSINE = "cos_"
"""Before the name of an angle: its cosine."""


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
    """

    name: str
    unit: str
    size: float
    meaning: str
    symbol: str = ""
    low: float = -np.inf
    high: float = np.inf

    def __post_init__(self) -> None:
        """Refuse what is no variable.

        Raises:
            InputError: If the name is no word, or the range is empty.
        """
        if not self.name.isidentifier():
            raise InputError(f"{self.name!r} names no variable: expected a word of letters, digits and underscores")
        rest = re.sub(r"\\([A-Za-z]+)", lambda found: "" if found[1] in SYMBOLS else found[0], self.symbol)
        if "^^" in rest or not re.fullmatch(r"[\w{}^ /,.()'+-]*", rest):
            raise InputError(
                f"inputs.{self.name}: symbol is {self.symbol!r}: write letters, Greek ones, bars and indices: H_s"
            )
        if not self.low < self.high:
            low, high = self.low / self.size, self.high / self.size
            raise InputError(f"inputs.{self.name}: from {low:g} to {high:g} {self.unit} is no range")

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


@dataclass(frozen=True)
class Quantities:
    """What a response is a function of, and what a network sees of it.

    Attributes:
        inputs: The variables.
        output: The response.
        sees: What the network sees, one input each: a variable by its name, ``cos_`` and the name of an angle, or a
            name of :data:`DERIVED`.
        per: Variable that the response is proportional to; None for none.
    """

    inputs: Sequence[Variable]
    output: Variable
    sees: Sequence[str]
    per: str | None = None

    def __post_init__(self) -> None:
        """Refuse what cannot be seen.

        Raises:
            InputError: If there are no inputs, nothing is seen, or something that is unknown or made of a variable that
                there is not.
        """
        names = [v.name for v in self.inputs]
        if not names:
            raise InputError("inputs: there are none; write for instance inputs.T={unit: s, values: [7, 9, 11]}")
        if not self.sees:
            raise InputError("sees: the network sees nothing; write for instance sees.T=true")
        for one in self.sees:
            check_choice("sees:", one, [*names, *(f"{COSINE}{name}" for name in names), *DERIVED])
            lacking = [need for need in DERIVED[one][1] if need not in names] if one in DERIVED else []
            if lacking:
                raise InputError(f"sees.{one} is made of {lacking[0]}, which is none of the inputs {', '.join(names)}")
        if self.per is not None:
            check_choice("per", self.per, names)

    def seen(self, of: Mapping[str, Number], cos: Callable[[Number], Number]) -> list[Number]:
        """What the network sees.

        Args:
            of: Variable -> its value [SI].
            cos: Cosine of such a value.

        Returns:
            One value for each of :attr:`sees` [SI].
        """
        return [
            DERIVED[one][0](of, cos) if one in DERIVED else of[one] if one in of else cos(of[one.removeprefix(COSINE)])
            for one in self.sees
        ]

    def features(self, conditions: Float[Tensor, "*batch k"]) -> Float[Tensor, "*batch features"]:
        """What the network sees of conditions [SI], a column each."""
        of = {v.name: conditions[..., k] for k, v in enumerate(self.inputs)}
        return torch.stack(self.seen(of, torch.cos), dim=-1)

    def factor(self, conditions: Float[Tensor, "*batch k"]) -> Float[Tensor, " *batch"]:
        """What the network's output is multiplied by: the variable that the response is proportional to, or 1."""
        if self.per is None:
            return torch.ones_like(conditions[..., 0])
        return conditions[..., [v.name for v in self.inputs].index(self.per)]


class Response(nn.Module):
    """An approximation of a response by a network.

    ``y(x) = x_p [a_out net((f(x) - shift)/scale) + b_out]``: f(x) is what the network sees of the variables, x_p the
    one that the response is proportional to, or 1. In a linear theory that is the wave height.

    Attributes:
        network: Scaled features to scaled response.
        scaling: Shift and scale of both.
        quantities: Variables and response, and what is seen of them.
        ranges: Ends of the variables' ranges [SI].
    """

    ranges: Tensor

    def __init__(self, network: Network, scaling: Scaling, quantities: Quantities) -> None:
        """Join the parts."""
        super().__init__()
        self.network, self.scaling, self.quantities = network, scaling, quantities
        like = scaling.shift
        self.register_buffer("ranges", like.new_tensor([[v.low, v.high] for v in quantities.inputs]))

    @property
    def inputs(self) -> tuple[Variable, ...]:
        """The variables, in the order of the columns, with the ranges of the records that were learnt from."""
        ends = zip(self.quantities.inputs, self.ranges.double().tolist(), strict=True)
        return tuple(replace(v, low=low, high=high) for v, (low, high) in ends)

    @property
    def output(self) -> Variable:
        """The response."""
        return self.quantities.output

    def forward(self, conditions: Float[Tensor, "*batch k"]) -> Float[Tensor, " *batch"]:
        """The response.

        Args:
            conditions: The variables [SI].

        Returns:
            Its value [SI].
        """
        seen = self.scaling.inputs(self.quantities.features(conditions))
        return self.scaling.restore(self.network(seen))[..., 0] * self.quantities.factor(conditions)

    @torch.no_grad()
    def at(self, conditions: Float[np.ndarray, "n k"]) -> Float[np.ndarray, " n"]:
        """The response to conditions that are no tensor [SI]."""
        like = self.scaling.shift
        return self(torch.as_tensor(conditions, dtype=like.dtype, device=like.device)).double().cpu().numpy()


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
