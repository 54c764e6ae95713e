"""A ship's series taken apart: what the hull does in drift and in yaw, what its mass does; and hulls that change."""

from abc import abstractmethod
from typing import ClassVar

import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.effect import Effect, Situation
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.limits import Endless
from manoeuvre_nn.core.network import times
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.effect.common import columns

DRIFT, YAW = {"uv", "|v|v"}, {"Lur", "L|v|r", "Lvr", "vr"}
"""Products that the hull makes and whose letters do not say so: the BIS tanker's, and v r, which is even."""
LINEAR = {"v", "uv", "r", "ur", "Lur", "vr", "Lvr"}
"""Terms linear in v or r, and v r of the added mass in surge."""
MAX_SORTED = 16
"""Ships whose sorted terms an effect keeps."""
GYRATION = 0.25
"""Radius of gyration in yaw over L [-], where the inertia is parted into mass and added mass."""


class _SortedSeries:
    """A ship's products and coefficients, sorted.

    Attributes:
        ship: The ship.
        mass: Mass of the ship in its prime system, m' [-].
        masses: m', m', Iz' [-]: the inertia without added masses.
        added: Added masses [-].
        drift, yaw: 1 for the hull's terms with more v than r and without rudder, and for its terms with r, else 0.
        of_drift, of_yaw: Coefficients of these, mass excluded [-].
        of_mass: What mass has in the table, ``m' v' r'`` in surge and ``-m' u' r'`` in sway [-].
        linear: 1 for :data:`LINEAR` terms, else 0.
    """

    def __init__(self, ship: Ship, effect: str) -> None:
        """Sort the terms.

        Args:
            ship: The ship.
            effect: Name of the effect that needs them, for the message.

        Raises:
            InputError: If the ship's forces are no series.
        """
        table = ship.table
        if table is None:
            raise InputError(f"effect.{effect}: the {ship.particulars.name} has no coefficients; give a ship with some")
        self.ship = ship
        diagonal = ship.inertia.diagonal()
        # Never more than the inertia in surge: a rounded displacement must not make an added mass negative.
        self.mass = min(ship.particulars.mass / ship.prime.mass, float(diagonal[0]))
        self.masses = diagonal.new_tensor([self.mass, self.mass, self.mass * GYRATION**2])
        self.added = (diagonal - self.masses).clamp(min=0.0)
        mass = torch.zeros_like(table)
        for row, term in enumerate(ship.terms):
            # Products with the length in them are in m^2/s^2, all others over the square of the speed.
            unit = self.mass / ship.prime.speed**2 if "L" in term else self.mass
            mass[..., row, 0] = unit if term in {"vr", "Lvr"} else 0.0
            mass[..., row, 1] = -unit if term in {"r", "ur", "Lur"} else 0.0
        kinds, hull = [_kind(t) for t in ship.terms], table - mass
        self.drift, self.yaw = _rows(kinds, "drift", table), _rows(kinds, "yaw", table)
        self.of_drift, self.of_yaw, self.of_mass = hull * self.drift, hull * self.yaw, mass
        self.linear = _rows([t in LINEAR for t in ship.terms], True, table)


def _kind(term: str) -> str:
    """Whether a product is made by the hull's drift, by its yaw, or by something else."""
    drift, yaw = term.count("v"), term.count("r")
    if term in DRIFT | YAW:
        return "drift" if term in DRIFT else "yaw"
    if set(term) - set("uvr") or (drift + yaw) % 2 == 0:
        return ""
    return "drift" if drift > yaw else "yaw"


def _rows(kinds: list, kind: object, like: Tensor) -> Tensor:
    """1 in the rows of one kind, else 0, as a column."""
    return like.new_tensor([float(k == kind) for k in kinds])[:, None]


def diagonal(*parts: Float[Tensor, "*#batch"]) -> Float[Tensor, "*batch 3 3"]:
    """Shares of X', Y', N' that stay in their equations, as matrices."""
    return torch.diag_embed(columns(*parts))


class HullEffect(Effect):
    """Coefficients and inertia that are not the ship's: adds ``(M' + dM')^-1 (f' + df') - M'^-1 f'``.

    f' is that of the whole ship, which the situation's accelerations tell. df' multiplies the hull's terms as they are:
    ``df' = products dT``, ``dT = w (T_drift drift + T_yaw yaw)`` with the shares of both and w 1 for :data:`LINEAR`
    terms and :meth:`nonlinear` for others, and what else there is.
    """

    site = "hull"
    equations: ClassVar[tuple[str, ...]] = ("X", "Y", "N")

    def __init__(self, ship: Ship, **values: Endless) -> None:
        """Sort the ship's terms: its forces must be a series."""
        super().__init__(ship, **values)
        self._sorted = {id(ship): _SortedSeries(ship, self.name)}

    @property
    def series(self) -> _SortedSeries:
        """The ship's terms, sorted once for each of the last ships that the effect was taken to."""
        series = self._sorted.get(id(self.ship))
        if series is None or series.ship is not self.ship:  # back from another process its ids may be others' here
            if len(self._sorted) >= MAX_SORTED:
                self._sorted.clear()
            series = self._sorted[id(self.ship)] = _SortedSeries(self.ship, self.name)
        return series

    @abstractmethod
    def shares(self, s: Situation) -> tuple[Float[Tensor, "*batch 3 3"], Float[Tensor, "*batch 3 3"]]:
        """What is added to the hull's drift terms and to its yaw terms, by their own X', Y', N' (rows)."""

    def nonlinear(self) -> float | Float[Tensor, "*rows 1 1"]:
        """Share of this that the nonlinear terms get."""
        return 1.0

    def rescaled(
        self, drift: Float[Tensor, "*batch 3 3"], yaw: Float[Tensor, "*batch 3 3"]
    ) -> Float[Tensor, "*rows terms 3"]:
        """dT: what such :meth:`shares` add to the ship's table of coefficients [-]."""
        series = self.series
        return self._of_terms() * (series.of_drift @ drift + series.of_yaw @ yaw)

    def _of_terms(self) -> Float[Tensor, "*rows terms 1"]:
        """Which share of all this every term gets."""
        return self.series.linear + self.nonlinear() * (1 - self.series.linear)

    def force_of(self, s: Situation, table: Float[Tensor, "*rows terms 3"]) -> Float[Tensor, "*batch 3"]:
        """Right-hand sides f' by a table of coefficients [-]: one product where a row's is the same at all samples."""
        products = self.ship.products(s.nu, s.delta)
        whole = table.ndim > 2 and table.shape[-3] == 1
        return products @ table[..., 0, :, :] if whole else times(products, table)

    def changed_terms(self) -> Float[Tensor, "terms 3 3"]:
        """What :meth:`shares` add on the approach: the whole correction of a coefficient is the hull's."""
        zero = self.ship.inertia.new_zeros(1)
        nu = torch.stack([zero + self.ship.particulars.speed, zero, zero], dim=-1)
        s = Situation(nu, 0 * nu, zero, zero, zero, zero, zero + 1, zero)
        drift, yaw = (m.reshape(-1, 3, 3)[0] for m in self.shares(s))
        series, of_terms = self.series, self._of_terms().reshape(-1, *self.series.linear.shape)[0]
        return (of_terms * series.drift)[..., None] * drift + (of_terms * series.yaw)[..., None] * yaw

    @abstractmethod
    def change(self, s: Situation) -> tuple[Float[Tensor, "*batch 3"], Float[Tensor, "*rows 3"]]:
        """What changes in a situation: df' [-] and the diagonal of dM' [-]."""

    def acceleration(self, s: Situation, memory: Float[Tensor, "*own m"]) -> Float[Tensor, "*batch 3"]:
        """What the changed hull adds."""
        force, inertia = self.change(s)
        return self._caused(self.ship.force_from_acceleration(s.nudot) + force, inertia) - s.nudot

    def with_changed_inertia(self, s: Situation, nudot: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
        """``(M' + dM')^-1 M' nudot``: the forces are as they were, the ship is not."""
        return self._caused(self.ship.force_from_acceleration(nudot), self.change(s)[1])

    def _caused(self, force: Float[Tensor, "*batch 3"], inertia: Float[Tensor, "*rows 3"]) -> Float[Tensor, "*batch 3"]:
        """Accelerations by right-hand sides f' with a change of the inertia's diagonal."""
        surge, sway, yaw = force.unbind(-1)
        (m11, _, _), (_, m22, m23), (_, m32, m33) = self.ship.inertia.tolist()
        dx, dy, dz = inertia.unbind(-1)
        determinant = (m22 + dy) * (m33 + dz) - m23 * m32
        rates = [surge / (m11 + dx), ((m33 + dz) * sway - m23 * yaw) / determinant]
        rates.append(((m22 + dy) * yaw - m32 * sway) / determinant)
        return torch.stack(rates, dim=-1) * self.ship.acceleration_units
