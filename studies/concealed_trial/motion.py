"""Fixed-step Runge-Kutta motion of all runs of a case at once: steered by the helm, or driven by a known rudder."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from studies.concealed_trial.helm import Run, SteeringGear, TrialHelm
from studies.concealed_trial.truth import SHAFT_LAG, TruthModel

STEP = 0.1
"""Time step [s]."""
COARSE = 0.5
"""Time step where a coarse one will do [s]."""


@dataclass(frozen=True)
class SailedRuns:
    """True motion of all runs, one row for each second.

    Attributes:
        t: Time [s].
        state: x, y [m], psi [rad], u, v [m/s], r [rad/s], phi, dphi/dt, r L/U0 lagged; shape
            (times, 9, runs).
        order: Helm orders [rad].
        indicator: Angle that the gear shows [rad], one row for each step.
        n: Shaft speed [rpm].
        step: Time step [s].
    """

    t: np.ndarray
    state: np.ndarray
    order: np.ndarray
    indicator: np.ndarray
    n: np.ndarray
    step: float

    def shown(self, delay: float = 0.0) -> np.ndarray:
        """The rudder angle as recorded.

        Args:
            delay: How late it is [s].

        Returns:
            Angle [rad], one row for each second.
        """
        fine = np.arange(len(self.indicator)) * self.step
        columns = [np.interp(self.t - delay, fine, column) for column in self.indicator.T]
        return np.stack(columns, axis=1)


def sail(truth: TruthModel, runs: Sequence[Run], *, step: float = STEP, settle: float = 24.0) -> SailedRuns:
    """Runs with the helm in command: a long approach, then what is recorded.

    Args:
        truth: The ship and its effects.
        runs: The runs; all are as long as the longest.
        step: Time step [s].
        settle: Length of the approach before t = 0 in units of L/U0.

    Returns:
        The motion from t = 0, with the position at t = 0 as origin.
    """
    helm, unit = TrialHelm(truth.ship, runs), truth.ship.length / truth.ship.speed
    large = max(step, COARSE)
    before = -large * np.ceil(settle * unit / large)
    state = np.zeros((9, len(runs)))
    share = np.array([run.share for run in runs])
    truth.telegraph = share
    state[2], state[3] = helm.course - truth.sensors.heading_bias, share * truth.ship.speed
    gear = SteeringGear(replace(truth.gear, play=0.0), truth.ship.rate, np.zeros(len(runs)))  # no hunting in the play
    n = share * truth.ship.rpm
    for k in range(round(-before / large)):
        state, n, _ = _step(truth, helm, gear, before + k * large, state, n, large)
    state[:2], gear.gear = 0.0, truth.gear
    per_second, last = round(1 / step), max(run.duration for run in runs)
    states, orders, shafts, indicators = [], [], [], []
    for k in range(last * per_second + 1):
        indicators.append(gear.indicator)
        kept, n_now = state, n
        state, n, order = _step(truth, helm, gear, k * step, state, n, step)
        if k % per_second == 0:
            states.append(kept)
            orders.append(order)
            shafts.append(n_now)
    times = np.arange(last + 1.0)
    return SailedRuns(times, np.array(states), np.array(orders), np.array(indicators), np.array(shafts), step)


def _step(
    truth: TruthModel, helm: TrialHelm, gear: SteeringGear, t: float, state: np.ndarray, n: np.ndarray, step: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """One step under command: state, shaft speed, order."""
    order = helm.order(t, truth.sensors.heading(state[2]), state[5], step)
    start = gear.blade
    gear.advance(order, step)
    new = runge_kutta(truth, t, state, start, gear.blade, n, step)
    return new, turned(truth, state[3], n, step), order


def turned(truth: TruthModel, u: np.ndarray, n: np.ndarray, step: float) -> np.ndarray:
    """Shaft speed after a step.

    Args:
        truth: The truth model.
        u: Forward speed [m/s].
        n: Shaft speed [rpm].
        step: Time step [s].

    Returns:
        n [rpm].
    """
    if not truth.rpm_slope:
        return n
    return n + (1 - np.exp(-step / SHAFT_LAG)) * (truth.shaft_speed(u) - n)


def runge_kutta(
    truth: TruthModel,
    t: float,
    state: np.ndarray,
    blade: np.ndarray,
    blade_after: np.ndarray,
    n: np.ndarray,
    step: float,
) -> np.ndarray:
    """One classical step of fourth order with a rudder that moves evenly.

    Args:
        truth: The truth model.
        t: Time [s].
        state: 9 rows.
        blade: Blade angle at the start [rad].
        blade_after: Blade angle at the end [rad].
        n: Shaft speed [rpm].
        step: Time step [s].

    Returns:
        The state after the step.
    """
    half, middle = 0.5 * step, 0.5 * (blade + blade_after)
    k1 = truth.derivative(t, state, blade, n)
    k2 = truth.derivative(t + half, state + half * k1, middle, n)
    k3 = truth.derivative(t + half, state + half * k2, middle, n)
    k4 = truth.derivative(t + step, state + step * k3, blade_after, n)
    return state + step / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)


def replay(
    truth: TruthModel,
    start: np.ndarray,
    t: np.ndarray,
    order: np.ndarray,
    shown: np.ndarray,
    *,
    step: float = COARSE,
) -> np.ndarray:
    """Runs driven by a rudder that is known once a second.

    Args:
        truth: The truth model.
        start: State at the first time, 9 rows.
        t: Times [s], one second apart.
        order: Orders [rad], (times, runs).
        shown: Angles of the indicator [rad], (times, runs).
        step: Time step [s].

    Returns:
        States (times, 9, runs).
    """
    per_second = round(1 / step)
    gear = SteeringGear(truth.gear, truth.ship.rate, shown[0])
    state, n, states = start, np.where(np.isfinite(start[3]), truth.shaft_speed(start[3]), 0.0), [start]
    for k in range(len(t) - 1):
        for part in range(per_second):
            before, share = gear.blade, (part + 1) / per_second
            gear.show((1 - share) * shown[k] + share * shown[k + 1], order[k], step)
            state = runge_kutta(truth, t[k] + part * step, state, before, gear.blade, n, step)
            n = turned(truth, state[3], n, step)
        states.append(state)
    return np.array(states)
