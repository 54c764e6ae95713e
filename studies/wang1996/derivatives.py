"""Hydrodynamic derivatives out of tuples by regression, and how they compare with those of a ship."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import prod

import numpy as np
import torch
from jaxtyping import Float
from scipy import stats
from torch import Tensor

from manoeuvre_nn.core.prime import PrimeSystem
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.estimation.derivatives import ABKOWITZ, taylor_columns
from manoeuvre_nn.recording.tuples import Tuples
from manoeuvre_nn.ship.taylor import EQUATIONS, Side, TaylorShip
from studies.wang1996.stepwise import Equation, Rules, TermEstimate, regress

Estimates = Mapping[str, Mapping[str, TermEstimate]]
"""Equation (X, Y or N) -> term -> estimate."""


def si_unit(prime: PrimeSystem, equation: str, term: str) -> float:
    """What a derivative in a prime system is multiplied by to have it in SI units.

    Args:
        prime: The system, at the speed that velocities are divided by.
        equation: X, Y or N.
        term: Its variables.

    Returns:
        Unit of force or moment over the units of the variables.
    """
    surge, sway, yaw = prime.velocity_units
    units = {"u": surge, "v": sway, "r": yaw, "d": 1.0, "0": 1.0}
    return (prime.moment if equation == "N" else prime.force) / prod(units[c] for c in term)


@dataclass(frozen=True)
class Regression:
    """Surge, sway and yaw regressed on the terms of a Taylor series about the approach.

    Attributes:
        equations: X, Y and N in units of :attr:`prime`; coefficients are derivatives (``Y_vvv v^3 / 6``).
        known: The known part that was taken off the forces, and whose inertia formed them.
        whole: Whether the whole force was regressed and not what the known part leaves.
        side: Side that a positive rudder turns to in the coefficients.
    """

    equations: Mapping[str, Equation]
    known: Ship
    whole: bool
    side: Side

    @property
    def coefficients(self) -> dict[str, dict[str, float]]:
        """Equation -> term -> value, as a Taylor ship takes them."""
        return {e: dict(q.values) for e, q in self.equations.items()}

    def estimates(self, inertia: Float[Tensor, "3 3"] | None = None) -> dict[str, dict[str, TermEstimate]]:
        """Derivatives of the whole force, the known part's among them, as a ship of another inertia has them.

        Forces were formed with the known part's inertia M_k from measured accelerations, so that a ship of inertia M
        has ``f = M M_k^-1 (g + f_k)``: sway and yaw mix. Standard errors follow from those of both equations and the
        correlation of their residuals.

        Args:
            inertia: M' in the known part's system; None leaves the known part's.

        Returns:
            Equation -> term -> estimate; p values are those of the sum.
        """
        own = self.known.inertia
        mixing = (torch.eye(3).to(own) if inertia is None else inertia @ torch.linalg.inv(own)).numpy()
        parts, given = [self.equations[e] for e in EQUATIONS], self._given()
        return {e: _mixed(parts, given, row) for e, row in zip(EQUATIONS, mixing, strict=True)}

    def _given(self) -> list[dict[str, float]]:
        """Derivatives of the known part, with this regression's sign of the rudder."""
        if self.whole or not isinstance(self.known, TaylorShip):
            return [{}, {}, {}]
        signs = -1.0 if self.known.positive_rudder_turns_to != self.side else 1.0
        table = self.known.coefficients
        return [{t: c * signs ** t.count("d") for t, c in table.get(e, {}).items()} for e in EQUATIONS]


def _mixed(
    parts: Sequence[Equation], given: Sequence[Mapping[str, float]], mixing: Float[np.ndarray, " 3"]
) -> dict[str, TermEstimate]:
    """One row of ``M M_k^-1`` times the coefficients of all equations."""
    used = [k for k in range(3) if abs(mixing[k]) > 1e-12]
    terms = list(dict.fromkeys(t for k in used for t in (*parts[k].estimates, *given[k])))
    freedom = min(parts[k].freedom for k in used)
    reach, made = float(stats.t.ppf(0.975, freedom)), {}
    for term in terms:
        value = sum(mixing[k] * (parts[k].values.get(term, 0.0) + given[k].get(term, 0.0)) for k in used)
        found = [k for k in used if term in parts[k].estimates]
        error = float(np.sqrt(max(_variance([parts[k] for k in found], mixing[found], term), 0.0)))
        p = float(2 * stats.t.sf(abs(value) / error, freedom)) if error > 0 else 0.0
        inflation = max((parts[k].estimates[term].inflation for k in found), default=1.0)
        value = float(value)
        made[term] = TermEstimate(value, error, value - reach * error, value + reach * error, p, inflation)
    return made


def _variance(parts: Sequence[Equation], weights: Float[np.ndarray, " k"], term: str) -> float:
    """Variance of a weighted sum of the estimates that several equations have of one term."""
    rows = [p.influence[list(p.estimates).index(term)] for p in parts]
    total = 0.0
    for one, first, a in zip(parts, rows, weights, strict=True):
        for other, second, b in zip(parts, rows, weights, strict=True):
            shared = one.residuals @ other.residuals / np.sqrt(one.freedom * other.freedom)
            total += a * b * (one.deviation**2 if one is other else shared) * (first @ second)
    return total


def taylor_regression(
    tuples: Tuples,
    known: Ship,
    *,
    terms: Mapping[str, Sequence[str]] = ABKOWITZ,
    rules: Rules | None = None,
    whole: bool = False,
    side: Side = "port",
) -> Regression:
    """Regress unknown forces, or whole ones, on the terms of a Taylor series.

    Args:
        tuples: Samples.
        known: The known part that they were formed with.
        terms: Equation -> terms to choose from.
        rules: How they are chosen.
        whole: Whether the known part's forces are added before.
        side: Side that positive d turns to.

    Returns:
        The three regressions in the known part's prime system, at its approach speed.

    Source:
        Wang 1996, section 5.3.
    """
    targets = tuples.targets.double()
    if whole:
        velocities = tuples.inputs[:, :3] * known.velocity_units
        targets = targets + known.force(velocities, tuples.inputs[:, 3]).double()
    targets = targets * (known.prime.speed / known.particulars.speed) ** 2
    columns = taylor_columns(tuples, known, terms, side)
    equations = {
        e: regress(dict(zip(terms[e], columns[e].T, strict=True)), targets[:, k].numpy(), rules)
        for k, e in enumerate(EQUATIONS)
    }
    return Regression(equations, known, whole, side)
