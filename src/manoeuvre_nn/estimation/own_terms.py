"""A ship's own coefficients from recordings, in closed loop: published values are where it starts from."""

from collections.abc import Sequence

import numpy as np

from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.estimation.agreement import Agreement, birge_scaled_covariance
from manoeuvre_nn.estimation.closed_loop import first, solve
from manoeuvre_nn.estimation.coefficient_forces import CoefficientForces, own_forces
from manoeuvre_nn.estimation.coefficient_priors import own_prior
from manoeuvre_nn.estimation.coefficients import OWN, TAYLOR, Fitted, approach_inertia
from manoeuvre_nn.estimation.prime_recordings import to_prime
from manoeuvre_nn.estimation.problem import EstimationProblem
from manoeuvre_nn.ship.tanker import TankerShip

MAX_PASSES = 20
"""Steps at most."""


def fit_own_terms(
    ship: Ship,
    recordings: Sequence[Recording],
    relative: float = 0.2,
    *,
    force: Sequence[float] = (3e-4, 5e-4, 1e-3),
    force_time: float = 1.0,
    floor: Sequence[float] = (1e-3, 1e-3, 3e-3, 2e-3, 2e-3, 3e-3),
    learn_force: bool = False,
) -> tuple[Fitted, CoefficientForces, Agreement]:
    """States and the coefficients of a ship's own products together.

    For the tanker family that is its BIS table (Xuu, Yuv, Yccd, Nur, ...), for a Taylor series its factors. Inertia,
    thrust and the race over the rudder are taken as published.

    Args:
        ship: The ship; its forces are a sum of products.
        recordings: As the sensors gave them.
        relative: Standard deviation of the published coefficients over their values [-].
        force: Standard deviation of the accelerations that the model may lack, in U0^2/L (yaw: U0^2/L^2).
        force_time: Their correlation time in L/U0.
        floor: Least noise of u, v, r, x, y, psi in U0, U0/L, L, rad.
        learn_force: Whether ``force`` is estimated; it is then the most that it may be.

    Returns:
        Coefficients with intervals; the forces that they belong to; how far stretches disagree over what noise allows
        (:mod:`.agreement`): errors are widened so far.
    """
    forces, (mean, spread) = own_forces(ship), own_prior(ship, relative)
    tanker = isinstance(ship, TankerShip)
    runs = to_prime(recordings, ship.particulars, ship.shaft_rpm, "shaft" if tanker else "approach")
    problem = EstimationProblem(
        runs, forces, mean, spread, process_time=force_time, floor=np.array(floor),
        learn_process=learn_force, max_process_sd=np.array(force),
    )  # fmt: skip
    found = solve(problem, first(problem, process_sd=force), passes=MAX_PASSES)
    (covariance, agreement), form = birge_scaled_covariance(problem, found), OWN if tanker else TAYLOR
    fitted = Fitted(tuple(forces.names), found.values, covariance, mean, spread, approach_inertia(ship), form)
    return fitted, forces, agreement
