"""A ship's own coefficients from recordings, in closed loop: published values are where it starts from."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float

from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.estimation.agreement import birge_scaled_covariance
from manoeuvre_nn.estimation.baselines import FittedProducts
from manoeuvre_nn.estimation.closed_loop import first, solve
from manoeuvre_nn.estimation.coefficients import OWN, TAYLOR, Fitted, approach_inertia
from manoeuvre_nn.estimation.prime_recordings import to_prime
from manoeuvre_nn.estimation.problem import CoefficientForces, Estimate, EstimationProblem
from manoeuvre_nn.estimation.products_force import ProductsForce
from manoeuvre_nn.ship.tanker import TankerShip


@dataclass(frozen=True)
class Known:
    """What a closed-loop fit takes as known.

    Attributes:
        relative: Standard deviation of the published coefficients over their values [-].
        force: Standard deviation of the accelerations that the model may lack, in U0^2/L (yaw: U0^2/L^2).
        force_time: Their correlation time in L/U0.
        floor: Least noise of u, v, r, x, y, psi in U0, U0/L, L, rad.
        passes: Steps at most.
        learn_force: Whether ``force`` is estimated; it is then the most that it may be.
    """

    relative: float = 0.2
    force: tuple[float, ...] = (3e-4, 5e-4, 1e-3)
    force_time: float = 1.0
    floor: tuple[float, ...] = (1e-3, 1e-3, 3e-3, 2e-3, 2e-3, 3e-3)
    passes: int = 20
    learn_force: bool = False


@dataclass(frozen=True)
class OwnFit:
    """A ship's own products, fitted.

    Attributes:
        fitted: Coefficients with intervals.
        force: Columns of the products.
        estimate: States, noise and the rest.
        ship: The ship with the coefficients that were found.
        ratio: How far stretches disagree over what noise allows (:mod:`.agreement`); errors are widened so far.
    """

    fitted: Fitted
    force: CoefficientForces
    estimate: Estimate
    ship: FittedProducts
    ratio: float


def fit_own_terms(ship: Ship, recordings: Sequence[Recording], known: Known | None = None) -> OwnFit:
    """States and the coefficients of a ship's own products together.

    For the tanker family that is its BIS table (Xuu, Yuv, Yccd, Nur, ...), for a Taylor series its factors. Inertia,
    thrust and the race over the rudder are taken as published.

    Args:
        ship: The ship; its forces are a sum of products.
        recordings: As the sensors gave them.
        known: What is taken as known.

    Returns:
        The fit.
    """
    known = known or Known()
    force = ProductsForce(ship)
    mean, spread = force.prior(known.relative)
    tanker = isinstance(ship, TankerShip)
    runs = to_prime(recordings, ship.particulars, ship.shaft_rpm, "shaft" if tanker else "approach")
    problem = EstimationProblem(
        runs, force, mean, spread, process_time=known.force_time, floor=np.array(known.floor),
        learn_process=known.learn_force, max_process_sd=np.array(known.force),
    )  # fmt: skip
    found = solve(problem, first(problem, process_sd=known.force), passes=known.passes)
    (covariance, ratio), form = birge_scaled_covariance(problem, found), OWN if tanker else TAYLOR
    fitted = Fitted(tuple(force.names), found.values, covariance, mean, spread, approach_inertia(ship), form)
    return OwnFit(fitted, force, found, with_coefficients(ship, force, found.values), ratio)


def with_coefficients(ship: Ship, force: ProductsForce, values: Float[np.ndarray, " p"]) -> FittedProducts:
    """The ship with other coefficients, ready to be sailed or to be the known part of a network.

    Args:
        ship: The ship.
        force: Its products.
        values: Coefficients in the order of the force's names.

    Returns:
        A ship.
    """
    table = force.with_coefficients(values).to(torch.float64)
    return FittedProducts(ship, ship.inertia, ship.prime.mass, table)
