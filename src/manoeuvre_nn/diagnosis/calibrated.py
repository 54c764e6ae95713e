"""What a calm-water model may be wrong by, coefficient by coefficient, and the model with such errors taken out."""

import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.ship import Particulars, Ship
from manoeuvre_nn.dynamics.model import Dynamics

SURGE_TERMS = ("uu", "vv", "rr", "dd", "vr", "vd", "rd", "uvv", "uvr", "udd")
LATERAL_TERMS = (
    *("vV", "rR", "vvv", "vvr", "vrr", "rrr", "vdd", "rdd", "vvd", "rrd", "vrd", "ddd"),
    *("uv", "ur", "ud", "uuv", "uur", "uud"),
)
"""Terms that a published set may lack; a capital letter is a magnitude."""
TURN = {"u": -0.3, "v": 0.25, "r": 0.7, "d": 0.35}
"""A tight turn in prime variables: where such a term is weighed."""
MISSING = 0.6
"""Size of each such term beside a printed one: one by one they are less likely."""


class Corrections:
    """Accelerations per unit of every correction: each coefficient by 100 %, terms that are missing, inertias by 100 %.

    A term that the model lacks is weighed by the model's own force in a tight turn. A model whose forces
    are no series of coefficients (a network) has its hull and rudder forces corrected equation by equation.

    Attributes:
        dynamics: The calm-water model.
        names: One a correction.
    """

    def __init__(self, dynamics: Dynamics) -> None:
        """Find out what can be corrected.

        Args:
            dynamics: The calm-water model.
        """
        self.dynamics, hull = dynamics, dynamics.hull
        table = hull.table
        self._entries = [] if table is None else [tuple(e) for e in torch.nonzero(table).tolist()]
        names = ["XYN"[e] + (hull.terms[t] or "0") for t, e in self._entries]
        if table is None:
            names = [f"{e}{part}" for part in ("hull", "rudder") for e in "XYN"]
        self._missing = [
            (e, term) for e, terms in enumerate((SURGE_TERMS, LATERAL_TERMS, LATERAL_TERMS)) for term in terms
        ]
        self.names = names + [f"{'XYN'[e]}+{term}" for e, term in self._missing] + ["Mu", "Mv", "Mr"]
        p = dynamics.particulars
        units = hull.inertia.new_tensor([p.speed, p.speed, p.speed / p.length])
        hard = units * units.new_tensor([1 + TURN["u"], -TURN["v"], TURN["r"]])
        d = units.new_tensor(TURN["d"])
        with torch.no_grad():
            total = dynamics.acceleration(hard, d)
            rudder = total - dynamics.acceleration(hard, torch.zeros_like(d))
        self._units, self._size = units, (float(0.5 * total[0].abs()), float(rudder[1].abs()), float(rudder[2].abs()))

    def __call__(self, nu: Float[Tensor, "*batch 3"], delta: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch k 3"]:
        """Accelerations per unit of every correction.

        Args:
            nu: u, v [m/s], r [rad/s].
            delta: Rudder angle [rad].

        Returns:
            One row a correction.
        """
        acceleration = self.dynamics.acceleration(nu, delta)
        rows = [*self._of_model(nu, delta, acceleration), *self._of_missing(nu, delta)]
        for equation in range(3):
            rows.append(_only(equation, -acceleration[..., equation]))
        return torch.stack(rows, dim=-2)

    def _of_model(self, nu: Tensor, delta: Tensor, acceleration: Tensor) -> list[Tensor]:
        """Every coefficient, or hull and rudder of every equation."""
        hull = self.dynamics.hull
        if hull.table is not None:
            made = hull.products(nu, delta)
            forces = [_only(e, made[..., t] * hull.table[t, e]) for t, e in self._entries]
        else:
            calm = hull.force_from_acceleration(self.dynamics.acceleration(nu, torch.zeros_like(delta)))
            parts = (calm, hull.force_from_acceleration(acceleration) - calm)
            forces = [_only(e, part[..., e]) for part in parts for e in range(3)]
        return [hull.acceleration_from_force(nu, f) for f in forces]

    def _of_missing(self, nu: Tensor, delta: Tensor) -> list[Tensor]:
        """Terms that the model lacks."""
        prime = nu / self._units
        z = {"u": prime[..., 0] - 1, "v": prime[..., 1], "r": prime[..., 2], "d": delta}
        rows = []
        for equation, term in self._missing:
            value, there = torch.ones_like(delta), 1.0
            for letter in term:
                factor = z[letter.lower()]
                value = value * (factor.abs() if letter.isupper() else factor)
                there *= abs(TURN[letter.lower()])
            rows.append(_only(equation, value * (MISSING * self._size[equation] / there)))
        return rows


def _only(equation: int, value: Tensor) -> Tensor:
    """A vector with one component."""
    zero = torch.zeros_like(value)
    return torch.stack([value if e == equation else zero for e in range(3)], dim=-1)


class Calibrated(Dynamics):
    """A calm-water model with its errors taken out, as far as recordings show them.

    Attributes:
        calm: The model.
        shares: Size of every correction [-].
    """

    shares: Tensor

    def __init__(self, calm: Dynamics, shares: Float[Tensor, " k"]) -> None:
        """Store the corrections.

        Args:
            calm: The model.
            shares: Size of every correction, in the order of :attr:`Corrections.names`.
        """
        super().__init__()
        self.calm, self._corrections = calm, Corrections(calm)
        self.register_buffer("shares", shares)

    @property
    def particulars(self) -> Particulars:
        """Those of the model."""
        return self.calm.particulars

    @property
    def hull(self) -> Ship:
        """That of the model."""
        return self.calm.hull

    def acceleration(self, nu: Float[Tensor, "*batch 3"], delta: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch 3"]:
        """Accelerations with the corrections.

        Args:
            nu: u, v [m/s], r [rad/s].
            delta: Rudder angle [rad], positive turns to starboard.

        Returns:
            udot, vdot [m/s^2], rdot [rad/s^2].
        """
        more = (self._corrections(nu, delta) * self.shares[:, None]).sum(dim=-2)
        return self.calm.acceleration(nu, delta) + more

    def on_approach(self, speed: float) -> "Calibrated":
        """The corrected ship at another approach speed.

        Args:
            speed: Approach speed [m/s].

        Returns:
            New dynamics.
        """
        return Calibrated(self.calm.on_approach(speed), self.shares)
