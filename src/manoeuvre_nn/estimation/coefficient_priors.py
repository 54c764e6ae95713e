"""What is known of coefficients before any run is seen: of a series of products, and of a ship's own ones."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.core.wind import AIR
from manoeuvre_nn.estimation.coefficient_forces import own_unit
from manoeuvre_nn.network.series import parity
from manoeuvre_nn.ship.clarke import SURGE_ADDED_MASS, clarke_derivatives

HARD_MANOEUVRE = {
    "1": 1.0, "u": 0.9, "v": 0.3, "r": 0.6, "d": 0.5, "n": 1.0, "a": 0.3, "|v|": 0.3, "|r|": 0.6, "|d|": 0.5,
    "wx": 5.0, "wy": 5.0, "|w|": 5.0, "/U": 1.0,
}  # fmt: skip
"""How large a variable becomes in hard manoeuvres: what a product must not let a force exceed."""
PRIOR_SD_PRIME = (0.02, 0.1, 0.05)
"""Standard deviation of what one product, before any run is seen, may add to X', Y', N' in a hard manoeuvre."""
EVEN_SHARE = 0.2
"""Share of it for products that are the same to port and to starboard in Y and N: ships are nearly symmetric."""
WIND = {"X wx |w|": 0.7, "Y wy |w|": 0.9, "N wx wy": -0.2}
"""Drag coefficients of a ship's sides in the wind: over A_F, over A_L, over A_L L, the means over all directions of
Blendermann's curves (1994, cargo ships)."""
MIN_RELATIVE_SD = 0.02
"""Standard deviation of a published coefficient over the largest effect of its equation, where it is small itself."""


def series_prior(
    names: Sequence[tuple[int, str]], ship: Particulars, relative: float = 0.5, size: float = 1.0
) -> tuple[Float[np.ndarray, " p"], Float[np.ndarray, " p"]]:
    """What is known of the coefficients of a series.

    Where a product of Clarke's occurs with several powers of u and n, the derivative is shared out among them: what
    holds on the approach, u = n = 1, is their sum.

    Args:
        names: Output and product of each.
        ship: The ship.
        relative: Standard deviation of Clarke's derivatives and of the resistance over their values [-].
        size: Factor on the standard deviation of all products, see :data:`PRIOR_SD_PRIME`.

    Returns:
        Mean and standard deviation.
    """
    given = _clarke(ship)
    shares = _shared(given, names)
    # The ship turns with its mass: -m u r, or -m (1 + a) r.
    mass = 2 * ship.block * ship.beam / ship.length
    for term in ("u r",) if (1, "u r") in names else ("r", "a r"):
        shares[1, term] = shares.get((1, term), 0.0) - mass
    mean = np.array([shares.get(name, 0.0) for name in names])
    allowed = np.array([_allowed(o, t, ship) for o, t in names])
    return mean, np.hypot(relative * mean, size * allowed)


def _clarke(ship: Particulars) -> dict[tuple[int, str], float]:
    """Output and product without u and n -> coefficient in the (rho, L, T, U0) system, rudder positive to starboard."""
    d = clarke_derivatives(ship)
    mass = 2 * ship.block * ship.beam / ship.length
    resistance = ship.calm_resistance / (0.5 * ship.rho * ship.length * ship.draught * ship.speed**2)
    drag = -2 * d["Yd"] if ship.rudder_drag is None else ship.rudder_drag
    air, areas = AIR / ship.rho / (ship.length * ship.draught), ship.above_water
    return {
        (0, "u u"): -0.7 * resistance, (0, "u n"): -0.3 * resistance, (0, "n n"): resistance,
        (0, "a"): ship.surge_damping, (0, "v r"): (1 + SURGE_ADDED_MASS) * mass - 0.6 * d["Yvdot"],
        (0, "d d"): drag / 2,
        (1, "v"): d["Yv"], (1, "r"): d["Yr"], (1, "d"): -d["Yd"],
        (2, "v"): d["Nv"], (2, "r"): d["Nr"], (2, "d"): -d["Nd"],
        (0, "wx |w|"): WIND["X wx |w|"] * areas.frontal * air, (1, "wy |w|"): WIND["Y wy |w|"] * areas.lateral * air,
        (2, "wx wy"): WIND["N wx wy"] * areas.lateral * air,
    }  # fmt: skip


def _shared(given: Mapping[tuple[int, str], float], names: Sequence[tuple[int, str]]) -> dict[tuple[int, str], float]:
    """Coefficients of the products that stand for the given ones."""
    shares = {name: value for name, value in given.items() if name in names}
    for (output, term), value in given.items():
        if (output, term) in shares:
            continue
        alike = [n for n in names if n[0] == output and _bare(n[1]) == term]
        shares |= {name: value / len(alike) for name in alike}
    return shares


def _bare(term: str) -> str:
    """A product without the factors that are 1 on the approach."""
    return " ".join(t for t in term.split() if t not in {"u", "n"})


def _allowed(output: int, term: str, ship: Particulars) -> float:
    """Standard deviation of a coefficient that nothing is known of."""
    if "w" in term:
        side = ship.above_water.frontal if output == 0 else 0.2 * ship.above_water.lateral
        return 0.5 * AIR / ship.rho * side / (ship.length * ship.draught)
    largest = float(np.prod([HARD_MANOEUVRE[t] for t in term.split()]))
    return PRIOR_SD_PRIME[output] / largest * (EVEN_SHARE if output > 0 and parity(term) > 0 else 1.0)


def own_prior(ship: Ship, relative: float) -> tuple[Float[np.ndarray, " p"], Float[np.ndarray, " p"]]:
    """A ship's published coefficients and how far they are believed.

    Args:
        ship: The ship; its forces are a sum of products.
        relative: Standard deviation over the value; small values get some of what their equation's largest has.

    Returns:
        Mean and standard deviation, in the order of :func:`.own_forces`.

    Raises:
        InputError: If ``relative`` is not positive.
    """
    if not relative > 0:
        raise InputError(f"fit.prior.relative={relative}: expected more than 0")
    assert ship.table is not None
    table = ship.table.detach().double().numpy().T * own_unit(ship)
    used, sizes = table != 0, np.abs(table)
    return table[used], relative * np.maximum(sizes, MIN_RELATIVE_SD * sizes.max(1, keepdims=True))[used]
