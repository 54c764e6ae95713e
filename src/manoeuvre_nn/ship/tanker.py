"""Large tankers: propeller, rudder in the propeller race and shallow water in the BIS system."""

import copy
from collections.abc import Mapping
from dataclasses import replace
from math import inf
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor, nn

from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.core.limits import Endless
from manoeuvre_nn.core.network import times
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.prime import bis_system
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.core.units import RPM

TERMS = {
    "uu": ("Xuu", "", ""), "Lvr": ("Xvr", "", ""), "vv": ("Xvv", "", ""), "ccdd": ("Xccdd", "", ""),
    "ccbd": ("Xccbd", "", ""), "LgT": ("1 - t", "YT", "NT"), "uv": ("", "Yuv", "Nuv"), "|v|v": ("", "Yvv", ""),
    "ccd": ("", "Yccd", "Nccd"), "Lur": ("", "Yur", "Nur"), "cross": ("", "Yccbbd", "Nccbbd"), "L|v|r": ("", "", "Nvr"),
}  # fmt: skip
"""Product -> its coefficients in surge, sway and yaw; ``cc`` is c^2 and cross c^2 |beta| beta |d|."""
DEPTH_TERMS = {
    "uu": ("Xuuz", "", ""), "Lvr": ("Xvrz", "", ""), "uv": ("", "", "Nuvz"), "|v|v": ("", "Yvvz", ""),
    "Lur": ("", "Yurz", "Nurz"), "cross": ("", "Yccbbdz", "Nccbbdz"), "L|v|r": ("", "", "Nvrz"),
}  # fmt: skip
"""Product -> coefficients of it times zeta, likewise."""
YUVZ, KINK = -0.85, 0.8
"""``zeta Yuvz`` is YUVZ (zeta - KINK) beyond KINK and 0 below: Rajesh & Bhattacharyya 2009, Table 1."""


class TankerShip(Ship):
    """Van Berlekom & Goddard's tanker model.

    With n [1/s], ``beta = v/u``, ``gT = Tuu u^2/L + Tun u n + L Tnn |n| n``, ``c^2 = cun u n + cnn n^2`` and
    ``zeta = T/(h - T)``, the accelerations [m/s^2] that the forces make are

        X: [(Xuu + Xuuz zeta) u^2 + L (Xvr + Xvrz zeta) v r + (Xvv + Xvvzz zeta^2) v^2 + Xccdd c^2 d^2
            + Xccbd c^2 beta d + L gT (1 - t)] / L
        Y: [(Yuv + Yuvz zeta) u v + (Yvv + Yvvz zeta) |v| v + Yccd c^2 d + L (Yur + Yurz zeta) u r
            + (Yccbbd + Yccbbdz zeta) c^2 |beta| beta |d| + L YT gT] / L
        N: [(Nuv + Nuvz zeta) u v + L (Nvr + Nvrz zeta) |v| r + Nccd c^2 d + L (Nur + Nurz zeta) u r
            + (Nccbbd + Nccbbdz zeta) c^2 |beta| beta |d| + L NT gT] / L^2

    with d positive to port, and are divided by ``1 - Xudot - Xudz zeta`` and so on. ``|c| c`` is written c^2: the set
    holds for a propeller that turns ahead on a ship that moves ahead.

    Attributes:
        rpm: Shaft speed [rpm], constant in a manoeuvre.
        depth: Water depth h [m]; ``inf`` is deep water.

    Source:
        Van Berlekom & Goddard 1972; Rajesh & Bhattacharyya 2009, eqs 1-15, read as follows: n in rev/s; eq 13 has
        ``Xvvzz zeta^2``; "Y_rdot .04" of Table 1 is YT, "N_rdot -.02" is NT, "Yv zeta" is Yvdot zeta.
    """

    coefficient_table: Tensor
    depth_tables: Tensor
    depth_inertia: Tensor
    race: Tensor
    thrust_series: Tensor

    def __init__(
        self,
        particulars: Particulars,
        volume: float,
        coefficients: Mapping[str, float],
        *,
        rpm: float,
        self_propulsion: float,
        depth: Endless = inf,
        shaft: Literal["hold", "similarity"] = "hold",
    ) -> None:
        """Build a tanker from its table.

        Args:
            particulars: Main dimensions and steering gear.
            volume: Displaced volume [m^3].
            coefficients: The table of the source; sums such as ``1 + Xvr`` under the name of the derivative.
            rpm: Shaft speed [rpm].
            self_propulsion: Speed that this shaft speed keeps up on a straight course in deep water [m/s].
            depth: Water depth h [m].
            shaft: What the shaft does at another approach speed: ``hold`` keeps its rpm (the ship speeds up in the
                manoeuvre, as in the paper), ``similarity`` scales it with the speed.

        Raises:
            InputError: If the water is not deeper than the draught or ``shaft`` is unknown.
        """
        if not depth > particulars.draught:
            raise InputError(
                f"ship.depth={depth} m; the {particulars.name} draws {particulars.draught} m: write a larger depth"
            )
        check_choice("ship.shaft", shaft, ["hold", "similarity"])
        zeta = particulars.draught / (depth - particulars.draught)
        k = coefficients
        deep = torch.tensor([k["m11"], k["m22"], k["m33"]], dtype=torch.float64)
        change = -torch.tensor([k["Xudz"], k["Yvdz"], k["Nrdz"]], dtype=torch.float64)
        prime = bis_system(particulars.length, particulars.rho * volume)
        # Recorded shaft speeds are over this one everywhere.
        super().__init__(replace(particulars, rpm=rpm), prime, torch.diag(deep + zeta * change))
        self.volume, self.coefficients = volume, coefficients
        self.rpm, self.self_propulsion, self.shaft = rpm, self_propulsion, shaft
        self.depth, self.terms = depth, tuple(TERMS)
        self.register_buffer("depth_inertia", change, persistent=False)
        self._store(zeta)

    def _store(self, zeta: float) -> None:
        """Put the coefficients into buffers, so that tankers at other depths or rpm can be rows of one batch."""
        k, n, length = self.coefficients, self.rpm * RPM, self.particulars.length
        values, products = {**k, "1 - t": 1 - k["t"], "": 0.0}, list(TERMS)
        by_zeta = self.inertia.new_zeros(3, len(TERMS), 3)  # times zeta, its square, and what is beyond the kink
        table = by_zeta.new_tensor([[values[part] for part in parts] for parts in TERMS.values()])
        for name, parts in DEPTH_TERMS.items():
            by_zeta[0, products.index(name)] = by_zeta.new_tensor([values[part] for part in parts])
        by_zeta[1, products.index("vv"), 0] = k["Xvvzz"]
        by_zeta[2, products.index("uv"), 1] = YUVZ
        for share, change in zip((zeta, zeta**2, max(zeta - KINK, 0.0)), by_zeta, strict=True):
            table = table + share * change
        self.register_buffer("coefficient_table", table / self.prime.speed**2)
        self.register_buffer("depth_tables", by_zeta / self.prime.speed**2, persistent=False)
        race = [k["cun"] * n, k["cnn"] * n**2]
        self.register_buffer("race", self.inertia.new_tensor(race))
        thrust = [k["Tuu"] / length, k["Tun"] * n, length * k["Tnn"] * abs(n) * n]
        self.register_buffer("thrust_series", self.inertia.new_tensor(thrust))

    @property
    def table(self) -> Float[Tensor, "terms 3"]:
        """Coefficients over the BIS unit of acceleration."""
        return self.coefficient_table

    def with_table(self, table: Float[Tensor, "*rows terms 3"]) -> "TankerShip":
        """The same tanker with other coefficients; her terms in zeta are as they were."""
        made = copy.copy(self)
        made._buffers = {**made._buffers, "coefficient_table": table}
        return made

    @property
    def shaft_rpm(self) -> float:
        """Shaft speed [rpm]."""
        return self.rpm

    def thrust(self, u: Float[Tensor, "*batch"], shaft: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch 3"]:
        """``m gT [1 - t, YT, L NT]`` [N, N, N m]: a screw pushes the stern to one side too."""
        units = u.new_tensor([self.prime.force, self.prime.force, self.prime.moment])
        product = self.particulars.length * self._thrust_over_mass(u, shaft)[..., None]
        return units * product * self.table[..., self.terms.index("LgT"), :]

    def _thrust_over_mass(self, u: Tensor, shaft: Tensor | float) -> Tensor:
        """GT [m/s^2]."""
        square, linear, constant = self.thrust_series.unbind()
        return square * u.square() + linear * shaft * u + constant * shaft**2

    def products(
        self,
        nu: Float[Tensor, "*batch 3"],
        delta: Float[Tensor, "*batch"],
        shaft: Float[Tensor, "*batch"] | float = 1.0,
    ) -> Float[Tensor, "*batch terms"]:
        """What the coefficients are multiplied by, in the order of ``TERMS`` [m^2/s^2]."""
        length = self.particulars.length
        u, v, r, d = nu[..., 0], nu[..., 1], nu[..., 2] * length, -delta
        slope, constant = self.race.unbind()
        beta, race, across = v / u, slope * shaft * u + constant * shaft**2, v.abs()
        rudder = race * d
        products = [u.square(), v * r, v.square(), rudder * d, rudder * beta, length * self._thrust_over_mass(u, shaft)]
        products += [u * v, across * v, rudder, u * r, race * beta.abs() * beta * d.abs(), across * r]
        return torch.stack(products, dim=-1)

    def shallow_change(
        self,
        nu: Float[Tensor, "*batch 3"],
        delta: Float[Tensor, "*batch"],
        shaft: Float[Tensor, "*batch"],
        zeta: Float[Tensor, "*own"],
    ) -> tuple[Float[Tensor, "*both 3"], Float[Tensor, "*own 3"]]:
        """By the table's own terms in zeta, the kink of Yuvz rounded."""
        products, zeta = self.products(nu, delta, shaft), zeta[..., None]
        linear, square, kink = (products @ table for table in self.depth_tables)
        beyond = nn.functional.softplus(zeta - KINK, beta=50.0)
        return linear * zeta + square * zeta.square() + kink * beyond, zeta * self.depth_inertia

    def shaft_force(
        self, nu: Float[Tensor, "*batch 3"], delta: Float[Tensor, "*batch"], shaft: Float[Tensor, "*batch"]
    ) -> Float[Tensor, "*batch 3"]:
        """What another shaft speed changes: thrust, and the race over the rudder."""
        return times(self.products(nu, delta, shaft) - self.products(nu, delta), self.table)

    def on_approach(self, speed: float) -> "TankerShip":
        """The tanker at another approach speed; the forces are as they are, ``shaft`` says what the propeller does."""
        rpm = self.rpm * speed / self.self_propulsion if self.shaft == "similarity" else self.rpm
        return TankerShip(
            self.particulars.at_speed(speed),
            self.volume,
            self.coefficients,
            rpm=rpm,
            self_propulsion=speed if self.shaft == "similarity" else self.self_propulsion,
            depth=self.depth,
            shaft=self.shaft,
        ).to(self.inertia)
