"""The simpler models that a network must beat: Clarke's estimate, a Taylor series, the ship's own terms."""

from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.scaling import Scaling
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.dynamics.base import Model
from manoeuvre_nn.dynamics.model import CalmWater, IdentifiedShip
from manoeuvre_nn.estimation.derivatives import ABKOWITZ, taylor_columns
from manoeuvre_nn.numerics.finite_algebra import check_finite, lstsq
from manoeuvre_nn.recording.tuples import Tuples
from manoeuvre_nn.ship.known import clarke_part
from manoeuvre_nn.ship.taylor import TaylorForce

VALIDATION_BLOCKS = 3
"""Stretches of time, one of which at a time is predicted from the others to find how much of a fit can be trusted."""
MIN_SINGULAR_RATIO = 1e-10
"""Singular value over the largest below which a direction of the coefficients is rounding [-]."""


@dataclass(frozen=True)
class _Baseline:
    """A model without a network.

    Attributes:
        name: ``linear``, ``taylor`` or ``true terms``.
        dynamics: The model, ready to be rolled out.
        parameters: Numbers that were learnt from the tuples.
        note: What it knows and what it learnt.
    """

    name: str
    dynamics: Model
    parameters: int
    note: str


class FittedProducts(Ship):
    """A ship whose force is a ship's own products times learnt coefficients."""

    def __init__(
        self, ship: Ship, inertia: Float[Tensor, "3 3"], mass: float, coefficients: Float[Tensor, "terms 3"]
    ) -> None:
        """Join products and coefficients.

        Args:
            ship: The ship whose products are taken.
            inertia: M' that the coefficients were learnt with.
            mass: Unit of mass of M' [kg].
            coefficients: One row a product, in units of the ship's speed and length and of this mass.
        """
        super().__init__(ship.particulars, replace(ship.prime, mass=mass), inertia)
        self._ship, self.terms = ship, ship.terms
        self.register_buffer("coefficients", coefficients)

    @property
    def whose(self) -> Ship:
        """The ship whose products are taken."""
        return self._ship

    @property
    def table(self) -> Float[Tensor, "terms 3"]:
        """The learnt coefficients."""
        return self.get_buffer("coefficients")

    def products(self, nu: Float[Tensor, "*batch 3"], delta: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch terms"]:
        """The ship's products.

        Args:
            nu: u, v [m/s], r [rad/s].
            delta: Rudder angle [rad], positive turns to starboard.

        Returns:
            One column a term.
        """
        return self._ship.products(nu, delta)

    @property
    def shaft_rpm(self) -> float:
        """Shaft speed of the ship [rpm]."""
        return self._ship.shaft_rpm

    def learnt(self, tuples: Tuples) -> "FittedProducts":
        """The same products with coefficients by least squares.

        Args:
            tuples: Tuples that were formed with this ship as the known part.

        Returns:
            A new ship.
        """
        return _with_true_terms(self._ship, self, tuples)[0]

    def on_approach(self, speed: float) -> "FittedProducts":
        """The products as the ship has them at that speed; what was learnt stays.

        Args:
            speed: Approach speed [m/s].

        Returns:
            A new ship.
        """
        return FittedProducts(self._ship.on_approach(speed), self.inertia, self.prime.mass, self.table)


def own_part(ship: Ship | Particulars) -> FittedProducts:
    """The ship's own products as the known part, their coefficients learnt before the network sees what is left.

    Returns:
        The known part, still with coefficients of zero.

    Raises:
        InputError: If the ship's force is no sum of products.
    """
    if isinstance(ship, Particulars) or ship.table is None:
        raise InputError(
            f"linear=own: the forces of the {ship.particulars.name} are no sum of known products; write "
            "linear=clarke or none"
        )
    return FittedProducts(ship, ship.inertia, ship.prime.mass, torch.zeros_like(ship.table))


def fit_baselines(ship: Ship | Particulars, known: Ship, tuples: Tuples) -> tuple[list[_Baseline], list[str]]:
    """The models that stand beside a network, from the least knowledge to the most.

    Args:
        ship: The ship, or its particulars where no more is known.
        known: The known part that the tuples were formed with.
        tuples: What the network learns from.

    Returns:
        ``linear`` (Clarke, Gedling & Hine 1982 as in Wang 1996, eqs 4.7-4.16), ``taylor`` and, for a ship whose forces
        are a series of known products, ``true terms``; and why one of them is missing.
    """
    linear = _Baseline(
        "linear", CalmWater(clarke_part(ship)), 0, "Clarke's estimate from the particulars; nothing learnt"
    )
    baselines, missing = [linear], []
    makers = {"taylor": lambda: taylor_baseline(known, tuples)}
    if isinstance(ship, Ship) and ship.table is not None:
        makers["true terms"] = lambda: true_terms_baseline(ship, known, tuples)
    for name, make in makers.items():
        try:
            baselines.append(make())
        except InputError as error:  # a short recording that a network can still be trained on
            missing.append(f"{name}: {error}")
    return baselines, missing


def taylor_baseline(known: Ship, tuples: Tuples) -> _Baseline:
    """A third-order Taylor series about the approach in place of the network, fitted by truncated least squares.

    As many directions of the coefficients are kept as predict stretches of time best that they were not fitted to.
    Measured, in L: the Mariner trained on zz35 with 0.5 % noise misses zz20 by .16 and tc25 by .23 (backward
    elimination .84, .37; all directions 6, .7; medians of 4 seeds); the Esso tanker trained on an exact zz20 misses
    zz25 by .39, tc15 by .14, tc25 by .44 (both others 1.4, .27, .79). With exact data of a ship that is such a series
    all directions stay.

    Args:
        known: The known part that the tuples were formed with.
        tuples: What is learnt from.

    Returns:
        The model; at other approach speeds it does what the known part does.

    Source:
        Abkowitz 1964 for the terms.
    """
    targets, coefficients, ranks = tuples.targets.double().numpy(), {}, []
    for e, (equation, columns) in enumerate(taylor_columns(tuples, known).items()):
        values, rank = _truncated(columns, targets[:, e])
        coefficients[equation] = dict(zip(ABKOWITZ[equation], values.tolist(), strict=True))
        ranks.append(rank)
    dtype, speed = known.inertia.dtype, known.particulars.speed / known.prime.speed
    scaling = Scaling(*(torch.tensor(x, dtype=dtype) for x in ([speed, 0, 0, 0], [speed] * 3 + [1], [1.0] * 3)))
    series = TaylorForce(coefficients, dtype=dtype)
    note = f"known part + Taylor series of third order, rank {', '.join(map(str, ranks))} of X, Y, N"
    return _Baseline("taylor", IdentifiedShip(known, series, scaling), sum(ranks), note)


def true_terms_baseline(ship: Ship, known: Ship, tuples: Tuples) -> _Baseline:
    """Least squares of the coefficients that the ship's own products have.

    Where the known inertia differs from the ship's, forces of sway and yaw mix, and so do their terms.

    Args:
        ship: A ship whose force is a sum of products.
        known: The known part that the tuples were formed with.
        tuples: What is learnt from.

    Returns:
        The model.
    """
    fitted, count = _with_true_terms(ship, known, tuples)
    note = f"the ship's own {count} terms, coefficients by least squares"
    return _Baseline("true terms", CalmWater(fitted), count, note)


def _with_true_terms(ship: Ship, known: Ship, tuples: Tuples) -> tuple[FittedProducts, int]:
    """The ship's products with coefficients by least squares, and how many these are."""
    if ship.table is None:
        raise InputError(f"ship {ship.particulars.name} has no products to fit: leave out the baseline `true terms`")
    with torch.no_grad():
        nu, delta = tuples.inputs[:, :3] * known.velocity_units, tuples.inputs[:, 3]
        whole = tuples.targets + known.force(nu, delta)
        nudot = known.acceleration_from_force(whole)
        targets = ((nudot / ship.acceleration_units) @ known.inertia.T).double().numpy()
        products = ship.products(nu, delta).double().numpy()
    pattern = _pattern(ship, known)
    table = np.zeros(pattern.shape)
    for e in range(3):
        rows = np.flatnonzero(pattern[:, e])
        table[rows, e] = _solved(products[:, rows], targets[:, e])
    learnt = torch.tensor(table).to(known.inertia)
    return FittedProducts(ship, known.inertia, known.prime.mass, learnt), int(pattern.sum())


def _pattern(ship: Ship, known: Ship) -> Bool[np.ndarray, "terms 3"]:
    """Which products stand in which equation, formed with the known part's inertia."""
    assert ship.table is not None
    mixing = known.inertia @ torch.linalg.inv(ship.inertia)
    used = (ship.table != 0).to(mixing) @ (mixing.abs() > 1e-9).to(mixing).T
    return (used > 0).numpy()


def _scaled(columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Columns over their size, and the sizes; a column of zeros stays."""
    size = np.sqrt(np.square(columns).mean(axis=0))
    size = np.where(size > 0, size, 1.0)
    return columns / size, size


def _solved(columns: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Least squares; of coefficients that the samples do not tell apart the smallest."""
    _check(columns)
    part, size = _scaled(columns)
    return lstsq(part, target, rcond=MIN_SINGULAR_RATIO) / size


def _truncated(
    columns: Float[np.ndarray, "n k"], target: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, " k"], int]:
    """Least squares in as many of the largest singular directions as predict held-out stretches of time best."""
    _check(columns)
    part, size = _scaled(columns)
    samples = np.arange(len(target))
    errors = np.zeros(columns.shape[1])
    for block in np.array_split(samples, VALIDATION_BLOCKS):
        rest = np.setdiff1d(samples, block)
        errors += np.square(target[block, None] - part[block] @ _by_rank(part[rest], target[rest])).sum(axis=0)
    rank = int(np.argmin(errors)) + 1
    return _by_rank(part, target)[:, rank - 1] / size, rank


def _by_rank(part: np.ndarray, target: np.ndarray) -> Float[np.ndarray, "k ranks"]:
    """Solutions in 1, 2, ... singular directions, one a column."""
    check_finite(part)
    left, sizes, right = np.linalg.svd(part, full_matrices=False)
    along = np.where(sizes > MIN_SINGULAR_RATIO * sizes[0], left.T @ target / np.maximum(sizes, 1e-300), 0.0)
    return np.cumsum(right.T * along, axis=1)


def _check(columns: np.ndarray) -> None:
    """Refuse samples of which not more than terms are left without one block."""
    count, terms = columns.shape
    if count - count // VALIDATION_BLOCKS <= terms:
        raise InputError(f"{count} samples for {terms} terms: give at least {2 * terms} samples, a longer recording")
