"""What a calm-water model may be wrong by, coefficient by coefficient, and the model with such errors taken out."""

from collections.abc import Sequence
from math import prod
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.core.network import products_of, times
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.dynamics.base import Model, ModelAround, calm_accelerations, rate_of_state
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.effect.common import TIGHT_TURN
from manoeuvre_nn.estimation.model_corrections import CoefficientCorrections, MotionState, model_corrections

SURGE_TERMS = ("uu", "vv", "rr", "dd", "vr", "vd", "rd", "uvv", "uvr", "udd")
LATERAL_TERMS = (
    *("vV", "rR", "vvv", "vvr", "vrr", "rrr", "vdd", "rdd", "vvd", "rrd", "vrd", "ddd"),
    *("uv", "ur", "ud", "uuv", "uur", "uud"),
)
"""Terms that a published set may lack; a capital letter is a magnitude."""
MISSING = 0.6
"""Size of each such term beside a printed one: one by one they are less likely."""
OF_ROLL = ("Xheel", "Yheel", "Nheel", "Khull", "Krudder", "Kheel", "Mp")
"""Corrections of a ship that rolls: what heel does to the forces, heeling moments, righting moment and inertia."""
FACTORS = "uvrdVR1"
"""Factors of terms: prime variables, magnitudes, one."""


class CoefficientPrior(NamedTuple):
    """How the errors of a set of coefficients go together before any run is seen.

    What is wrong with a force is wrong with its moment by the same share if the arm is right. Terms that a set lacks
    have an arm of unknown sign, so that their errors are independent; how large they are beside the errors of those
    that it has depends on how many terms it was given.

    Attributes:
        coupling: Correlation of one term's errors in Y and N.
        missing: Size of the terms that the set lacks, over ``MISSING``.
        usual: Whether all errors are as large as those of published sets usually are, and no larger.
    """

    coupling: float = 0.0
    missing: float = 1.0
    usual: bool = False

    def root(self, names: Sequence[str]) -> Float[np.ndarray, "k k"]:
        """Root R of the prior covariance ``R R^T`` of the corrections, that of one alone being 1.

        Args:
            names: Of the corrections: equation and term.

        Returns:
            The root; errors are ``R @`` independent ones.
        """
        root, place = np.eye(len(names)), {name: k for k, name in enumerate(names)}
        for name, k in place.items():
            if name[1:2] == "+":
                root[k, k] = self.missing
            pair = place.get("N" + name[1:]) if name.startswith("Y") and name[1:2] != "+" else None
            if pair is not None:
                root[pair, k], root[pair, pair] = self.coupling, np.sqrt(1 - self.coupling**2)
        return root


class Corrections:
    """Accelerations per unit of every correction: each coefficient by 100 %, terms that are missing, inertias by 100 %.

    A term that the model lacks is weighed by the model's own force in a tight turn. A model that was fitted to
    recordings and knows how well has its coefficients corrected by the standard errors of that fit instead, and one
    whose forces are no series of coefficients (a network) its hull and rudder forces equation by equation. A ship that
    rolls is corrected likewise in what heel does to these forces, in the heeling moments of hull and rudder, in the
    moment that rights her and in her inertia in roll.

    Attributes:
        dynamics: The calm-water model.
        of_model: What is corrected of its own forces.
        names: One a correction.
    """

    def __init__(self, dynamics: Model) -> None:
        """Find out what can be corrected."""
        self.dynamics, self.of_model = dynamics, model_corrections(dynamics)
        self._missing = [
            (e, term) for e, terms in enumerate((SURGE_TERMS, LATERAL_TERMS, LATERAL_TERMS)) for term in terms
        ]
        self.names = self.of_model.names + [f"{'XYN'[e]}+{term}" for e, term in self._missing] + ["Mu", "Mv", "Mr"]
        self.names += list(OF_ROLL) if dynamics.own_names else []
        p = dynamics.particulars
        self._units = units = dynamics.hull.inertia.new_tensor([p.speed, p.speed, p.speed / p.length])
        hard = units * units.new_tensor([1 - TIGHT_TURN["u"], -TIGHT_TURN["v"], TIGHT_TURN["r"]])
        d = units.new_tensor(TIGHT_TURN["d"])
        with torch.no_grad():
            total = calm_accelerations(dynamics, hard, d)
            rudder = total - calm_accelerations(dynamics, hard, torch.zeros_like(d))
        size = (float(0.5 * total[0].abs()), float(rudder[1].abs()), float(rudder[2].abs()))
        # Each missing term as three of the factors of `_terms`.
        self._letters = torch.tensor([[FACTORS.index(f) for f in term.ljust(3, "1")] for _, term in self._missing])
        there = [prod(TIGHT_TURN[f.lower()] for f in term) for _, term in self._missing]
        weights = [MISSING * size[e] / scale for (e, _), scale in zip(self._missing, there, strict=True)]
        self._weights = units.new_tensor(weights)[:, None] * torch.eye(3).to(units)[[e for e, _ in self._missing]]

    def of_terms(self) -> list[tuple[int, int, str, int | None, float]]:
        """Corrections of single terms of the forces.

        Returns:
            Number, equation, term, its row in the table, coefficient. Missing terms, as ``+`` and their letters, and
            inertias, as ``M``, have no row: they are prime accelerations.
        """
        terms, units = self.dynamics.hull.terms, self.dynamics.hull.acceleration_units
        first = len(self.of_model.names)
        last, of_model = first + len(self._missing), self.of_model
        found: list[tuple[int, int, str, int | None, float]] = []
        if isinstance(of_model, CoefficientCorrections):
            for k, (row, equation) in enumerate(of_model.entries):
                found.append((k, equation, terms[row], row, of_model.coefficient(row, equation)))
        for k, (equation, term) in enumerate(self._missing):
            found.append((first + k, equation, "+" + term, None, float(self._weights[k, equation] / units[equation])))
        return found + [(last + k, k, "M", None, 1.0) for k in range(3)]

    def fits(self, ship: Ship) -> bool:
        """Whether what is corrected are coefficients of such a ship."""
        ours = isinstance(self.of_model, CoefficientCorrections)
        return ours and ship.table is not None and ship.terms == self.dynamics.hull.terms

    def __call__(
        self,
        moving: Float[Tensor, "*batch m"],
        delta: Float[Tensor, "*batch"],
        shaft: Float[Tensor, "*batch"] | None = None,
    ) -> Float[Tensor, "*batch k m"]:
        """Accelerations, and rates of the own states, per unit of every correction.

        Args:
            moving: u, v [m/s], r [rad/s], own states.
            delta: Rudder angle [rad].
            shaft: Shaft speed over the nominal one [-]; None is nominal.

        Returns:
            One row a correction.
        """
        motion, parts = self._motion(moving, delta, shaft)
        of_missing = self._terms(motion.nu, delta)[..., None] * self._weights
        of_inertia = -motion.acceleration[..., None, :] * torch.eye(3).to(motion.acceleration)
        of_forces = torch.cat([self.of_model.rows(motion), of_missing, of_inertia], dim=-2)
        if parts is None:
            return of_forces
        caused = torch.cat(self.dynamics.hull.added(of_forces, torch.zeros_like(of_forces[..., 0])), dim=-1)
        return torch.cat([caused, self._of_roll(parts)], dim=-2)

    def together(
        self,
        moving: Float[Tensor, "*batch m"],
        delta: Float[Tensor, "*batch"],
        shares: Float[Tensor, "*#batch k"],
        shaft: Float[Tensor, "*batch"] | None = None,
        calm: Float[Tensor, "*batch 3"] | None = None,
    ) -> Float[Tensor, "*batch m"]:
        """Accelerations of all corrections at given sizes; the sum of the rows, without making them.

        Args:
            moving: u, v [m/s], r [rad/s], own states.
            delta: Rudder angle [rad].
            shares: Size of every correction, the same everywhere or one row each.
            shaft: Shaft speed over the nominal one [-]; None is nominal.
            calm: Accelerations without corrections at the nominal shaft speed, if they are known.

        Returns:
            udot, vdot [m/s^2], rdot [rad/s^2], rates of the own states.
        """
        motion, parts = self._motion(moving, delta, shaft, calm)
        first = len(self.of_model.names)
        last = first + len(self._missing)
        of_model, of_missing, of_inertia = shares[..., :first], shares[..., first:last], shares[..., last : last + 3]
        changed = self.of_model.together(motion, of_model) - motion.acceleration * of_inertia
        changed = changed + times(self._terms(motion.nu, delta), self._weights * of_missing[..., None])
        if parts is None:
            return changed
        caused = torch.cat(self.dynamics.hull.added(changed, torch.zeros_like(changed[..., 0])), dim=-1)
        return caused + (self._of_roll(parts) * shares[..., last + 3 :, None]).sum(dim=-2)

    def products(self, nu: Float[Tensor, "*batch 3"], delta: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch terms"]:
        """Products of the ship's forces, then those of the terms that the model lacks.

        Args:
            nu: u, v [m/s], r [rad/s].
            delta: Rudder angle [rad].

        Returns:
            One column a product.
        """
        return torch.cat([self.dynamics.hull.products(nu, delta), self._terms(nu, delta)], dim=-1)

    def accelerations(self, shares: Float[Tensor, "*rows k"]) -> Float[Tensor, "*rows terms 3"] | None:
        """Accelerations per unit of :meth:`products` of a ship with corrections: her calm water and they in one table.

        ``(1 - c_M) M^-1 (p @ T) + M^-1 (p @ T c) + m @ W c_m`` for products p of the ship and m of what is missing.

        Args:
            shares: Size of every correction, or one row each.

        Returns:
            The table; None where the model is more than a ship of such products that stays upright.
        """
        of_model, hull = self.of_model, self.dynamics.hull
        upright = isinstance(self.dynamics, CalmWater) and not self.dynamics.own_names
        if not upright or not isinstance(of_model, CoefficientCorrections) or hull.table is None:
            return None
        last = len(of_model.names) + len(self._missing)
        of_missing, of_inertia = shares[..., len(of_model.names) : last], shares[..., last:]
        calm = hull.acceleration_from_force(hull.table)
        forces = hull.acceleration_from_force(of_model.table(hull, shares)) - calm * of_inertia[..., None, :]
        return torch.cat([forces, self._weights * of_missing[..., None]], dim=-2)

    def table(self, ship: Ship, shares: Float[Tensor, "*rows k"]) -> Float[Tensor, "*rows terms 3"] | None:
        """Coefficients of a ship with their corrections, ``T (1 + c)``.

        Args:
            ship: A ship of the model's terms.
            shares: Size of every correction, or one row each.

        Returns:
            The table; None where other things than coefficients are corrected.
        """
        if not isinstance(self.of_model, CoefficientCorrections) or not self.fits(ship):
            return None
        return self.of_model.table(ship, shares)

    def _motion(
        self, moving: Tensor, delta: Tensor, shaft: Tensor | None, calm: Tensor | None = None
    ) -> tuple[MotionState, "_Parts | None"]:
        """What forces act at: of a rolling ship without the heeling moment, whose parts stand beside."""
        nu = moving[..., :3]
        if self.dynamics.own_names:
            parts = self._parts(moving, delta, shaft)
            return MotionState(nu, delta, shaft, parts.accelerations[1], parts.accelerations[0]), parts
        calm = self.of_model.accelerations(nu, delta, shaft) if calm is None else calm
        return MotionState(nu, delta, shaft, calm), None

    def _of_roll(self, parts: "_Parts") -> Tensor:
        """Rates by what :data:`OF_ROLL` names."""
        hull, (_, still, heeled), (k_hull, k_still, k_heeled) = self.dynamics.hull, parts.accelerations, parts.moments
        by_heel = hull.force_from_acceleration(heeled - still)[..., None, :] * torch.eye(3).to(still)
        pushed = hull.acceleration_from_force(by_heel)
        forces = torch.cat(hull.added(pushed, torch.zeros_like(pushed[..., 0])), dim=-1)
        moments = torch.stack([k_hull, k_still - k_hull, k_heeled - k_still], dim=-1)
        moments = torch.cat(hull.added(torch.zeros_like(pushed), moments), dim=-1)
        inertia = torch.zeros_like(forces[..., 0, :])
        inertia[..., -1] = -parts.roll
        return torch.cat([forces, moments, inertia[..., None, :]], dim=-2)

    def _parts(self, moving: Tensor, delta: Tensor, shaft: Tensor | None) -> "_Parts":
        """A rolling ship upright without rudder, upright with it, and as she heels: in one step of the model."""
        hull, upright = self.dynamics.hull, torch.cat([moving[..., :3], torch.zeros_like(moving[..., 3:])], dim=-1)
        delta = delta.expand(moving.shape[:-1])
        nu = torch.stack([upright, upright, moving])
        rudders = torch.stack([torch.zeros_like(delta), delta, delta])
        state = torch.cat([nu[..., :3], torch.zeros_like(nu[..., :3]), nu[..., 3:]], dim=-1)
        rates = self.dynamics(state, Inputs(rudders, None if shaft is None else shaft.expand(rudders.shape)))
        accelerations, roll = rates[..., :3], rates[..., -1]
        one, still = torch.ones_like(roll), torch.zeros_like(accelerations)
        by_moment, rolled = hull.added(still, one)  # of 1 N m
        # pdot = roll(a) + K / M_pp, with a the accelerations and roll(a) what forces without a moment add to it.
        free = roll - hull.added(accelerations, 0 * one)[1][..., -1]
        moments = free / (rolled[..., -1] - hull.added(by_moment, 0 * one)[1][..., -1])
        return _Parts(accelerations - moments[..., None] * by_moment, moments, roll[-1])

    def _terms(self, nu: Tensor, delta: Tensor) -> Tensor:
        """Products of factors of the terms that the model lacks."""
        u, v, r = (nu / self._units).unbind(-1)
        u = u - 1
        return products_of(
            torch.stack(torch.broadcast_tensors(u, v, r, delta, v.abs(), r.abs(), torch.ones_like(u))), self._letters
        )


class _Parts(NamedTuple):
    """A rolling ship upright without rudder, upright with it, and as she heels.

    Attributes:
        accelerations: By the forces without the heeling moment [m/s^2, rad/s^2].
        moments: Heeling moment [N m].
        roll: Acceleration of roll as she heels [rad/s^2].
    """

    accelerations: Float[Tensor, "3 *batch 3"]
    moments: Float[Tensor, "3 *batch"]
    roll: Float[Tensor, "*batch"]


class Calibrated(ModelAround):
    """A calm-water model with its errors taken out, as far as recordings show them.

    Attributes:
        calm: The model.
        shares: Size of every correction [-].
    """

    shares: Tensor
    _table: Tensor | None

    def __init__(self, calm: Model, shares: Float[Tensor, "*rows k"]) -> None:
        """Store the corrections.

        Args:
            calm: The model.
            shares: Size of every correction, in the order of :attr:`Corrections.names`; a row for each row of a batch.
        """
        super().__init__(calm)
        self._corrections, self._ships = Corrections(calm), dict[int, tuple[Ship, Tensor, Ship]]()
        self.register_buffer("shares", shares)
        self.register_buffer("_table", self._corrections.accelerations(shares), persistent=False)

    def forward(self, state: Float[Tensor, "*batch n"], inputs: Inputs) -> Float[Tensor, "*batch n"]:
        """Rate of the state with the corrections.

        Args:
            state: u, v, r, x, y, psi, own states.
            inputs: Rudder, shaft and wind.

        Returns:
            Its time derivative.
        """
        if self._table is not None:
            nu = state[..., :3]
            nudot = times(self._corrections.products(nu, inputs.delta), self._table)
            if inputs.shaft is not None:
                nudot = nudot + self.hull.acceleration_from_force(self.hull.shaft_force(nu, inputs.delta, inputs.shaft))
            return rate_of_state(state, nudot)
        moving = torch.cat([state[..., :3], state[..., 6:]], dim=-1) if self.own_names else state[..., :3]
        rate = self.calm(state, inputs)
        nominal = rate[..., :3] if inputs.given.keys() <= {"delta", "time"} else None
        change = self._corrections.together(moving, inputs.delta, self.shares, inputs.shaft, nominal)
        still = torch.zeros_like(change[..., :3])
        return rate + torch.cat([change[..., :3], still, change[..., 3:]], dim=-1)

    def corrected(self, ship: Ship) -> Ship:
        """The ship with ``table (1 + c)``, so that effects act on her as she is; made once a ship and its shares."""
        known, shares, corrected = self._ships.get(id(ship), (None, None, ship))
        if known is not ship or shares is None or not torch.equal(shares, self.shares):
            table = self._corrections.table(ship, self.shares)
            corrected = ship if table is None else ship.with_table(table) or ship
            self._ships[id(ship)] = ship, self.shares.clone(), corrected
        return corrected

    def on_approach(self, speed: float) -> "Calibrated":
        """The corrected ship at another approach speed.

        Args:
            speed: Approach speed [m/s].

        Returns:
            New dynamics.
        """
        return Calibrated(self.calm.on_approach(speed), self.shares)
