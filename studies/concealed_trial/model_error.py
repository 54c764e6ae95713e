"""What is wrong with the model in every case, clean ones too: coefficients, a missing term, a coloured force, gusts."""

import numpy as np

from studies.concealed_trial.case import TrialCase
from studies.concealed_trial.condition import Tables, scatter
from studies.concealed_trial.forces import Force, Moment
from studies.concealed_trial.ships import TrialShip
from studies.concealed_trial.truth import TruthModel, build

TYPICAL = {"X": 0.008, "Y": 0.02, "N": 0.01}
"""Force and moment of a rudder at 20 deg in units of 0.5 rho L T U0^2 (moment: L)."""
USUAL = {"u": 0.3, "v": 0.2, "r": 0.35, "d": 0.35}
"""Size of (u - U0)/U0, v/U0, r L/U0 and d [rad] in a manoeuvre."""


def with_model_error(case: TrialCase, rng: np.random.Generator, fresh: np.random.Generator | None = None) -> TruthModel:
    """The truth model of a case with what is wrong in every case: coefficients, a missing term, a force, gusts.

    Args:
        case: The case.
        rng: Source of chance; the coefficients are the first that is taken from it.
        fresh: Source of gusts and of the force, if they are to be others than those of the case.

    Returns:
        The truth model.
    """
    tables, names = Tables.of(case.ship), [run.name for run in case.runs]
    scatter(tables, case.coefficient_sd, rng)
    rng = fresh or rng
    seconds, count = max(run.duration for run in case.runs) + 2, len(names)
    gust_sd = next((e.parameters["gust_sd"] for e in case.effects if e.name == "wind_gusty"), 0.0)
    gusts = gust_sd * coloured(rng, seconds, (count,), float(rng.uniform(20, 60)))
    truth = build(case.ship, case.effects, names, tables=tables, gusts=gusts)
    truth.forces.append(cubic(case.ship, *case.cubic))
    unit = case.ship.force_unit * np.array([TYPICAL["X"], TYPICAL["Y"], TYPICAL["N"] * case.ship.length])
    truth.model_error = case.model_error_size * unit[:, None] * coloured(rng, seconds, (3, count), 30.0)
    return truth


def coloured(rng: np.random.Generator, seconds: int, shape: tuple[int, ...], tau: float) -> np.ndarray:
    """First-order Markov noise of standard deviation 1 that starts at 0.

    Args:
        rng: Source of chance.
        seconds: Samples, one a second.
        shape: Independent series.
        tau: Correlation time [s].

    Returns:
        The series, time first.
    """
    memory = np.exp(-1 / tau)
    series = np.zeros((seconds, *shape))
    for k in range(1, seconds):
        series[k] = memory * series[k - 1] + np.sqrt(1 - memory**2) * rng.standard_normal(shape)
    return series


def cubic(ship: TrialShip, term: str, size: float) -> Force:
    """A third-order term that the model lacks.

    Args:
        ship: The ship.
        term: Equation and three factors.
        size: Its share in the force of a rudder at 20 deg, at usual values of the factors.

    Returns:
        The force.
    """
    row = "XYN".index(term[0])
    unit = size * TYPICAL[term[0]] * ship.force_unit * (ship.length if row == 2 else 1.0)
    unit /= float(np.prod([USUAL[letter] for letter in term[1:]]))

    def force(now: Moment) -> np.ndarray:
        factors = {
            "u": now.u / ship.speed - 1,
            "v": now.v / ship.speed,
            "r": now.r * ship.length / ship.speed,
            "d": now.d,
        }
        rows = np.zeros((3, now.u.size))
        rows[row] = unit * factors[term[1]] * factors[term[2]] * factors[term[3]]
        return rows

    return force
