"""Ships whose forces are a Taylor series in u, v, r and delta (Abkowitz's form)."""

import copy
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from math import factorial, prod
from typing import Literal, get_args

import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.core.network import Network, filled, products_of
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.prime import PrimeSystem
from manoeuvre_nn.core.ship import Ship

VARIABLES = "uvrd"
EQUATIONS = "XYN"

Side = Literal["port", "starboard"]
Coefficients = Mapping[str, Mapping[str, float]]
"""Equation (X, Y or N) -> term (``vvr``: v^2 r; ``0``: constant) -> value."""


class TaylorForce(Network):
    """A polynomial in u, v, r, delta for each of X, Y and N.

    ``f'_e = sum_k c_ek prod(variables of term k)``; with ``taylor=True`` a coefficient is a derivative, so that every
    repeated variable is divided by the factorial of its count (``Yvvv v^3 / 6``), else it multiplies the bare product.

    Attributes:
        terms: The products that occur, sorted by order.
        coefficients: Factors of the bare products, shape (terms, 3).
    """

    columns: Tensor
    coefficients: Tensor

    def __init__(self, coefficients: Coefficients, *, taylor: bool = True, dtype: torch.dtype = torch.float64) -> None:
        """Collect the terms of the three equations.

        Args:
            coefficients: Equation -> term -> value.
            taylor: Whether the values are derivatives.
            dtype: Floating type.

        Raises:
            InputError: If an equation or a letter is unknown.
        """
        super().__init__()
        self.terms = sorted({_sorted(t) for e in coefficients.values() for t in e}, key=lambda t: (len(t), t))
        # Each product is one of columns of (1, u, v, r, d).
        self.register_buffer("columns", filled([[VARIABLES.index(c) + 1 for c in t] for t in self.terms]))
        matrix = torch.zeros(len(self.terms), 3, dtype=dtype)
        for equation, values in coefficients.items():
            if equation not in EQUATIONS:
                raise InputError(f"equation {equation!r} of a Taylor series is unknown; choose X, Y or N")
            for term, value in values.items():
                share = prod(factorial(n) for n in Counter(term).values()) if taylor and term != "0" else 1
                matrix[self.terms.index(_sorted(term)), EQUATIONS.index(equation)] += value / share
        self.register_buffer("coefficients", matrix)

    def forward(self, motion: Float[Tensor, "*batch 4"]) -> Float[Tensor, "*batch 3"]:
        """Evaluate the three polynomials."""
        return self.products(motion) @ self.coefficients

    def products(self, motion: Float[Tensor, "*batch 4"]) -> Float[Tensor, "*batch terms"]:
        """The bare products of u', v', r' and delta, one column each in the order of ``terms``."""
        variables = motion.unbind(-1)
        return products_of(torch.stack([torch.ones_like(variables[0]), *variables]), self.columns)


def _sorted(term: str) -> str:
    """The term with its letters in the order u, v, r, d, so that Yrvv and Yvvr are one; ``0`` becomes empty."""
    unknown = set(term) - set(VARIABLES + "0")
    if unknown:
        raise InputError(f"term {term!r} of a Taylor series has unknown letters; use u, v, r, d, or 0 for a constant")
    return "".join(sorted(term.strip("0"), key=VARIABLES.index))


class TaylorShip(Ship):
    """A ship with a Taylor series about the approach at U0.

    With ``a = (u - U0) / Us``, ``b = v / Us``, ``q = r L / Us``: ``M' nudot' = f'(a, b, q, delta) (Us / U0)^2`` in the
    prime system of U0, where Us is U0 itself or, with ``scaling="instantaneous"``, ``hypot(u, v)``.

    Attributes:
        series: The polynomial f'.
        coefficients: The values as the source prints them.
    """

    def __init__(
        self,
        particulars: Particulars,
        inertia: Mapping[str, float],
        coefficients: Coefficients,
        *,
        positive_rudder_turns_to: Side,
        prime: PrimeSystem | None = None,
        taylor: bool = True,
        scaling: Literal["constant", "instantaneous"] = "constant",
    ) -> None:
        """Build a ship from a source's tables.

        Args:
            particulars: Main dimensions and steering gear.
            inertia: ``mx = m'-Xudot'``, ``my = m'-Yvdot'``, ``mz = Iz'-Nrdot'``, ``Yrdot`` and ``Nvdot`` (these two
                with ``m' xG'`` taken off where the centre of gravity is not the origin).
            coefficients: Equation -> term -> value, mass terms included (``Yr - m'``, ``Xvr + m'``).
            positive_rudder_turns_to: The source's sign of the rudder; the package's is starboard.
            prime: Prime system of the coefficients at U0; None is (rho, L, T, U0).
            taylor: Whether the values are derivatives (``Yvvv v^3/6``) or plain factors.
            scaling: Speed that makes velocities non-dimensional.
        """
        mass = torch.tensor(
            [
                [inertia["mx"], 0.0, 0.0],
                [0.0, inertia["my"], -inertia.get("Yrdot", 0.0)],
                [0.0, -inertia.get("Nvdot", 0.0), inertia["mz"]],
            ],
            dtype=torch.float64,
        )
        super().__init__(particulars, prime or particulars.prime, mass)
        check_choice("ship.positive_rudder_turns_to", positive_rudder_turns_to, get_args(Side))
        self.series = TaylorForce(coefficients, taylor=taylor)
        self.terms = tuple(self.series.terms)  # the constant is empty
        self.coefficients, self._inertia_values = coefficients, inertia
        self.taylor, self.scaling, self.positive_rudder_turns_to = taylor, scaling, positive_rudder_turns_to
        self.rudder_sign = 1.0 if positive_rudder_turns_to == "starboard" else -1.0

    def motion(
        self, nu: Float[Tensor, "*batch 3"], delta: Float[Tensor, "*batch"]
    ) -> tuple[Float[Tensor, "*batch 4"], Float[Tensor, "*batch"] | None]:
        """The series' own variables.

        Args:
            nu: u, v [m/s], r [rad/s].
            delta: Rudder angle [rad], positive turns to starboard.

        Returns:
            ``(a, b, q, d)`` with the source's rudder sign, and ``Us / U0``, None where Us is U0.
        """
        u, b, q = (nu / self.velocity_units).unbind(-1)
        a, ratio = u - 1, None
        if self.scaling == "instantaneous":
            ratio = torch.hypot(nu[..., 0], nu[..., 1]) / self.prime.speed
            a, b, q = a / ratio, b / ratio, q / ratio
        return torch.stack([a, b, q, self.rudder_sign * delta]).movedim(0, -1), ratio

    @property
    def table(self) -> Float[Tensor, "terms 3"]:
        """Coefficients of the bare products."""
        return self.series.coefficients

    def with_table(self, table: Float[Tensor, "*rows terms 3"]) -> "TaylorShip":
        """The same ship with other coefficients of the bare products."""
        made, series = copy.copy(self), copy.copy(self.series)
        series._buffers = {**series._buffers, "coefficients": table}
        made._modules = {**made._modules, "series": series}
        return made

    def products(self, nu: Float[Tensor, "*batch 3"], delta: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch terms"]:
        """The bare products, times ``(Us / U0)^2``."""
        motion, ratio = self.motion(nu, delta)
        products = self.series.products(motion)
        return products if ratio is None else products * ratio.square()[..., None]

    def on_approach(self, speed: float) -> "TaylorShip":
        """The ship at another approach speed: the series is about that speed and all forces scale with its square.

        This is what the prime system says of a ship whose shaft speed is set to hold the approach speed.

        Args:
            speed: Approach speed [m/s].

        Returns:
            A new ship.
        """
        return TaylorShip(
            self.particulars.at_speed(speed),
            self._inertia_values,
            self.coefficients,
            positive_rudder_turns_to=self.positive_rudder_turns_to,
            prime=replace(self.prime, speed=speed),
            taylor=self.taylor,
            scaling=self.scaling,
        ).to(self.inertia)
