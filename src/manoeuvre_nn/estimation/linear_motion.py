"""What coefficients and their errors say of the ship's steering: stability, Nomoto's constants, the hardest turn.

All follow from accelerations, and so from ratios of force to inertia, which is what free runs show.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from jaxtyping import Float

from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.estimation.coefficient_forces import CoefficientForces

DRAWS = 2000
"""Draws from the coefficients' uncertainty."""
TURN_DRAWS = 100
"""Draws that are sailed to a steady turn, which takes longer."""
TURN_RUDDER, TURN_TIME, TURN_STEP = 35 * DEGREE, 25.0, 0.1
"""Rudder angle of the turn [rad], how long it is sailed, and the step of Heun's rule, in L/U0."""
DIFFERENCE_STEP = 1e-5
"""Step of difference quotients about the approach."""
COLUMNS = ["name", "value", "low", "high", "words"]
"""Of the numbers that follow from coefficients."""


@dataclass(frozen=True)
class _Linear:
    """Sway and yaw about the straight approach, ``(v', r')' = A (v', r') + b delta``, for several sets of coefficients.

    Attributes:
        a: A, shape (k, 2, 2).
        b: b, shape (k, 2).
    """

    a: Float[np.ndarray, "k 2 2"]
    b: Float[np.ndarray, "k 2"]

    @property
    def determinant(self) -> Float[np.ndarray, " k"]:
        """Det A; the criterion C over the determinant of the inertia."""
        return np.linalg.det(self.a)

    @property
    def straight(self) -> Float[np.ndarray, " k"]:
        """1 where the ship comes back to a straight course after a disturbance, else 0."""
        return ((self.determinant > 0) & (np.trace(self.a, axis1=1, axis2=2) < 0)).astype(float)

    @property
    def gain(self) -> Float[np.ndarray, " k"]:
        """Nomoto's K': r' over delta in a steady turn."""
        return self._turning / self.determinant

    @property
    def lag(self) -> Float[np.ndarray, " k"]:
        """Nomoto's T' = T1' + T2' - T3'."""
        return -np.trace(self.a, axis1=1, axis2=2) / self.determinant - self.b[:, 1] / self._turning

    @property
    def _turning(self) -> Float[np.ndarray, " k"]:
        return self.a[:, 1, 0] * self.b[:, 0] - self.a[:, 0, 0] * self.b[:, 1]


def linear_motion(force: CoefficientForces, values: Float[np.ndarray, "k p"]) -> _Linear:
    """Linearise about the approach, u = n = 1 in still air."""
    state, delta, both = np.zeros((6, 6)), np.zeros(6), (DIFFERENCE_STEP, -DIFFERENCE_STEP)
    state[:, 0] = 1.0
    state[:2, 1] = state[2:4, 2] = delta[4:] = both
    columns = force.columns(state, _still(delta))[:, 1:] / (2 * DIFFERENCE_STEP)
    by_v, by_r, by_rudder = (((columns[k] - columns[k + 1]) @ values.T).T for k in (0, 2, 4))
    return _Linear(np.stack([by_v, by_r], axis=2), by_rudder.copy())


def derived(
    force: CoefficientForces,
    values: Float[np.ndarray, " p"],
    covariance: Float[np.ndarray, "p p"],
    inertia: Float[np.ndarray, "3 3"],
) -> pd.DataFrame:
    """Stability, Nomoto's constants and the steady turn, with intervals by drawing from the coefficients' errors.

    ``C = Y_v (N_r - m x_G u) - N_v (Y_r - m u)`` is ``det A`` times the determinant of the inertia of sway and yaw;
    where its interval holds 0, K' and T' have none.

    Args:
        force: Columns of the coefficients.
        values: Coefficients.
        covariance: Of them.
        inertia: M' in the (rho, L, T, U0) system, for C alone.

    Returns:
        C, K', T' and the rate of the turn in rad for each ship length and unit of approach speed, one a row: name,
        value, low and high (ends of the 95 % interval; NaN where it has none), words (what it says).

    Source:
        Clarke, Gedling & Hine 1982, eq 8, for C; Nomoto et al. 1957.
    """
    sizes, vectors = np.linalg.eigh(covariance)
    noise = np.random.default_rng(0).standard_normal((DRAWS, len(values)))
    # The estimate, then draws from its uncertainty.
    sets = np.vstack([values, values + (noise * np.sqrt(np.maximum(sizes, 0.0))) @ vectors.T])
    motion = linear_motion(force, sets)
    c = motion.determinant * float(np.linalg.det(inertia[1:, 1:]))
    share = float(motion.straight[1:].mean())
    decided = not 0.025 <= share <= 0.975
    told = f"{'stable' if share > 0.975 else 'unstable'} on a straight course"
    if not decided:
        told = f"open whether stable on a straight course: {100 * share:.0f} % of what the recordings allow is"
    lasts = "" if decided else "no interval: C may be 0"
    rate, words = steady_turn(force, sets[: TURN_DRAWS + 1], TURN_RUDDER)
    rows = [
        _summary("stability C", c, told),
        _summary("Nomoto K'", motion.gain, lasts, decided),
        _summary("Nomoto T'", motion.lag, lasts, decided),
        _summary(f"r L/U0 at {TURN_RUDDER / DEGREE:.0f} deg of starboard rudder", rate, words),
    ]
    return pd.DataFrame(rows, columns=COLUMNS)


def steady_turn(
    force: CoefficientForces, values: Float[np.ndarray, "k p"], rudder: float
) -> tuple[Float[np.ndarray, " k"], str]:
    """Sail into a turn at constant shaft speed until it is steady.

    Args:
        force: Columns of the coefficients.
        values: Sets of coefficients.
        rudder: Rudder angle [rad].

    Returns:
        r L/U0 at the end, NaN where the ship left the range in which models hold; and what is to be said of it.
    """
    state = np.zeros((len(values), 6))
    state[:, 0] = 1.0
    inputs = _still(np.full(len(values), rudder))

    def rate(s: Float[np.ndarray, "k 6"]) -> Float[np.ndarray, "k 6"]:
        moved = np.zeros_like(s)
        moved[:, :3] = np.einsum("kip,kp->ki", force.columns(s, inputs), values)
        return moved

    for _ in range(round(TURN_TIME / TURN_STEP)):
        first = rate(state)
        second = rate(_held(state + TURN_STEP * first))
        state = _held(state + TURN_STEP / 2 * (first + second))
    lost = (np.abs(state[:, :3]) >= 2.0).any(axis=1) | (state[:, 0] <= 0.02) | (np.abs(second[:, 2]) > 0.01)
    share = float(lost.mean())
    words = [f"{100 * share:.0f} % of the draws find no steady turn"] if share > 0 else []
    return np.where(lost, np.nan, state[:, 2]), "; ".join([*_side(state[~lost, 2]), *words])


def _side(rates: Float[np.ndarray, " k"]) -> list[str]:
    """To which side a ship turns with the rudder to starboard, by the draws that find a steady turn."""
    if not len(rates):
        return []
    share = float((rates > 0).mean())
    if share > 0.975:
        return ["a turn to starboard"]
    if share < 0.025:
        return ["a turn to port, against the rudder"]
    return [f"open to which side: {100 * share:.0f} % of what the recordings allow turn to starboard"]


def _held(state: Float[np.ndarray, "k 6"]) -> Float[np.ndarray, "k 6"]:
    """Kept from overflow."""
    held = np.clip(state, -2.0, 2.0)
    held[:, 0] = np.maximum(held[:, 0], 0.02)
    return held


def _still(delta: Float[np.ndarray, " n"]) -> dict[str, Float[np.ndarray, " n"]]:
    """Nominal shaft speed, no wind."""
    return {"delta": delta, "n": np.ones_like(delta), "wind_north": 0 * delta, "wind_east": 0 * delta}


def _summary(name: str, found: Float[np.ndarray, " k"], words: str, decided: bool = True) -> tuple[Any, ...]:
    """The estimate and the middle 95 % of the draws."""
    drawn = found[1:][np.isfinite(found[1:])]
    low, high = np.quantile(drawn, [0.025, 0.975]) if decided and len(drawn) else (np.nan, np.nan)
    return name, found[0], low, high, words
