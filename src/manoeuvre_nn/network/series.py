"""Forces that are a sum of products with coefficients: the classical models, with members for their uncertainty."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import prod

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.core.network import Network, filled, products_of

VARIABLES = ("1", "u", "v", "r", "d", "n", "a", "|v|", "|r|", "|d|", "wx", "wy", "|w|", "/U")
"""What products are made of: u, v, rL over U0, rudder angle [rad], shaft speed over the nominal one, a = u - 1, and the
velocity of the air relative to the ship, forward and to starboard, over U0; /U divides by the ship's speed over U0."""
MIN_SPEED_PRIME = 0.1
"""Least speed over U0 that is divided by."""
MIRRORED = {"v": -1, "r": -1, "d": -1, "wy": -1}
"""Variables that change sign from port to starboard."""
OUTPUTS = 3


def parity(term: str) -> int:
    """1 for a product that is the same to port and to starboard, -1 for one that changes sign."""
    return prod(MIRRORED.get(token, 1) for token in term.split())


@dataclass(frozen=True)
class SeriesSettings:
    """Products of a :class:`Series`, variables parted by blanks: ``u u``, ``v r``, ``d d n n``.

    Attributes:
        surge: Products of X.
        lateral: Products of Y and N.
        wind_surge: Products of X that are used where the wind was recorded.
        wind_lateral: Likewise of Y and N.
        yaw: Products of N alone: what turns a ship need not push it aside. On the Esso Osaka model a moment that grows
            with neither the speed nor the shaft speed is eight standard errors from zero.
        symmetric: Whether products that are the same to port and to starboard are left out of Y and N; else the ship
            may have a side (a propeller that turns, a rudder that is not quite amidships).
        members: The estimate and draws from its uncertainty.
    """

    surge: Sequence[str]
    lateral: Sequence[str]
    wind_surge: Sequence[str] = ()
    wind_lateral: Sequence[str] = ()
    yaw: Sequence[str] = ()
    symmetric: bool = False
    members: int = 1

    def __post_init__(self) -> None:
        """Refuse what is no product.

        Raises:
            InputError: If a variable is unknown, a product of surge changes sign from port to starboard, or there is no
                member.
        """
        if self.members < 1:
            raise InputError(f"network.members={self.members}: expected at least 1")
        surge, _, turns = self.products
        for term in (*surge, *turns):
            for token in str(term).split():
                check_choice(f"network: variable of the product {term!r}", token, list(VARIABLES))
        odd = [t for t in surge if parity(t) < 0]
        if odd:
            raise InputError(f"network.surge has {odd[0]!r}, which changes sign from port to starboard: leave it out")

    @property
    def products(self) -> tuple[list[str], list[str], list[str]]:
        """Products of X, of Y and of N."""
        sides = [*self.lateral, *self.wind_lateral]
        sway, yaw = ([t for t in ts if parity(t) < 0 or not self.symmetric] for ts in (sides, [*sides, *self.yaw]))
        return [*self.surge, *self.wind_surge], sway, yaw


class Series(Network):
    """Surge force, sway force and yaw moment as sums of products of velocities, rudder angle, shaft speed and wind.

    ``X' = sum_k c_k prod(variables of term k)``, Y' and N' likewise, over ``0.5 rho L T U0^2`` (N: times L). Two sets
    of terms are in ``conf/network``: ``abkowitz``, a Taylor series of third order about the approach, and ``modulus``,
    the second-order modulus form with propeller and rudder. Any other is a list of products in a yaml.

    The first member is the estimate; others, if there are any, are drawn from its uncertainty, so that where they go
    apart is where the recordings leave open what the ship does.

    Attributes:
        coefficients: One row a member, then an output, then a product.
        trained: Members that answer.
        shaft: n over the nominal shaft speed where no recording says it [-].
        covariance: Of the coefficients that are used, in the order of :attr:`names`; 0 before a fit.
        noise: Standard deviation that u, v, r, x, y, psi were given in the fit, in U0, U0/L, L, rad.

    Source:
        Abkowitz 1964; Fedyaevsky & Sobolev 1963 and Norrbin 1970 for ``|v| v`` and its like; products of rudder angle
        with u and n: MMG's rudder inflow, Yasukawa & Yoshimura 2015, eqs 19-29, multiplied out; wind: Isherwood 1972.
    """

    any_fit = False
    places: Tensor
    used: Tensor
    trained: Tensor
    shaft: Tensor
    covariance: Tensor
    noise: Tensor

    def __init__(self, settings: SeriesSettings, *, seed: int = 0, dtype: torch.dtype = torch.float64) -> None:
        """Collect the products.

        Args:
            settings: Products of the three outputs, and the number of members.
            seed: Seed of the draws.
            dtype: Floating type.
        """
        super().__init__()
        each = settings.products
        self.terms = list(dict.fromkeys(term for products in (each[0], each[2]) for term in products))
        used = [[t in of for t in self.terms] for of in each]
        self.seed = seed
        self.register_buffer("places", filled([[VARIABLES.index(t) for t in term.split()] for term in self.terms]))
        self.register_buffer("used", torch.tensor(used))
        self.register_buffer("trained", torch.tensor(0))
        self.register_buffer("shaft", torch.ones((), dtype=dtype))
        count = int(self.used.sum())
        self.register_buffer("covariance", torch.zeros(count, count, dtype=torch.float64))
        self.register_buffer("noise", torch.zeros(6, dtype=torch.float64))
        self.coefficients = nn.Parameter(torch.zeros(settings.members, OUTPUTS, len(self.terms), dtype=dtype))

    @property
    def members(self) -> int:
        """The estimate and its draws."""
        return len(self.coefficients)

    @property
    def scalings(self) -> tuple[str, ...]:
        """Velocities over U0, so that coefficients are what the field calls them."""
        return ("approach",)

    @cached_property
    def takes(self) -> tuple[str, ...]:
        """The shaft speed if a product has n in it, else the approach speed; the wind if a product has it."""
        return (self.speed_law, *(("wind_north", "wind_east") if self.feels_wind else ()))

    @property
    def names(self) -> list[tuple[int, str]]:
        """Output (0 X, 1 Y, 2 N) and product of every coefficient that is used, in the order of ``used``."""
        return [(o, self.terms[k]) for o, k in self.used.nonzero().tolist()]

    @cached_property
    def speed_law(self) -> str:
        """``shaft`` if a product has n in it: speeds are over one U0 for all runs; else over the approach of each."""
        return "shaft" if any("n" in t.split() for t in self.terms) else "approach"

    @cached_property
    def feels_wind(self) -> bool:
        """Whether a product has the wind in it."""
        return any("w" in t for t in self.terms)

    def products(self, x: Float[Tensor, "*batch inputs"]) -> Float[Tensor, "*batch terms"]:
        """Values of all products.

        Args:
            x: u, v, r, delta; with three more n and the air's velocity forward and to starboard.

        Returns:
            One column a product.
        """
        u, v, r, d = x[..., :4].unbind(-1)
        # Without a record the air is still, and meets the ship as she goes.
        n, wx, wy = x[..., 4:].unbind(-1) if x.shape[-1] == 7 else (self.shaft.expand_as(u), -u, -v)
        slow = 1 / torch.hypot(u, v).clamp(min=MIN_SPEED_PRIME)
        moduli = v.abs(), r.abs(), d.abs()
        table = torch.stack([torch.ones_like(u), u, v, r, d, n, u - 1, *moduli, wx, wy, torch.hypot(wx, wy), slow])
        return products_of(table, self.places)

    def forward(self, x: Float[Tensor, "*batch inputs"]) -> Float[Tensor, "*batch 3"]:
        """Forces by the estimate."""
        x, scale = self._of_approach(x)
        return self.products(x) @ self.coefficients[0].T * scale

    def of(self, x: Float[Tensor, "n inputs"], member: Int[Tensor, " n"]) -> Float[Tensor, "n 3"]:
        """Every input by a member of its own."""
        x, scale = self._of_approach(x)
        return torch.einsum("nt,not->no", self.products(x), self.coefficients[member]) * scale

    def _of_approach(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Inputs over a run's own approach speed, and what forces are then multiplied by, where n is not known."""
        one = torch.ones_like(x[..., :1])
        if self.speed_law == "shaft" or x.shape[-1] != 7:
            return x, one
        ratio = x[..., 4:5]
        return x / torch.cat([ratio, ratio, ratio, one, ratio, ratio, ratio], dim=-1), ratio.square()

    def sensitivities(self, x: Float[Tensor, "*batch inputs"]) -> Float[Tensor, "*batch p 3"]:
        """Forces by one standard error of each eigenvector of :attr:`covariance`; no row before a fit."""
        if not bool(self.covariance.any()):
            return super().sensitivities(x)
        x, scale = self._of_approach(x)
        sizes, axes = torch.linalg.eigh(self.covariance)
        output, term = self.used.nonzero().T
        each = self.products(x)[..., term, None] * torch.eye(OUTPUTS).to(x)[output] * scale[..., None]
        return torch.einsum("...pe,pk->...ke", each, (axes * sizes.clamp(min=0).sqrt()).to(x))

    @torch.no_grad()
    def take(
        self,
        values: Float[Tensor, " p"],
        covariance: Float[Tensor, "p p"],
        noise: Float[Tensor, " 6"] | None = None,
    ) -> None:
        """Set the estimate and its covariance, in the order of :attr:`names`, and draw the other members from them."""
        self.covariance.copy_(covariance)
        self.noise.copy_(torch.zeros_like(self.noise) if noise is None else noise)
        generator = torch.Generator().manual_seed(self.seed)
        noise = torch.randn(self.members - 1, len(values), generator=generator, dtype=torch.float64)
        sizes, vectors = torch.linalg.eigh(covariance.double())
        drawn = values + (noise * sizes.clamp(min=0).sqrt()) @ vectors.T
        rows = torch.cat([values[None], drawn.to(values)])
        self.coefficients[:, self.used] = rows.to(self.coefficients)
        self.trained.fill_(self.members)
