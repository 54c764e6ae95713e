"""External forces of the listed effects that act on the hull, each from its definition or a public formula.

A force is a function of a :class:`Moment` and gives X, Y [N] and N [N m] as three rows; ``parameters`` hold the names
and units of the recordings' format.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from studies.concealed_trial.ships import GRAVITY, RHO, TrialShip
from studies.concealed_trial.wind import Isherwood

PROPELLER, THRUSTER = -0.48, 0.42
"""Levers of the propeller's side force and of the bow thruster over length, forward positive."""


@dataclass(slots=True)
class Moment:
    """All runs at one time.

    Attributes:
        t: Time [s].
        x: North position [m], one for each run, as all that follow.
        y: East position [m].
        psi: Heading [rad].
        u: Forward speed through the water [m/s].
        v: Sway speed through the water [m/s].
        r: Yaw rate [rad/s].
        d: Rudder angle [rad], positive to port.
        n: Shaft speed [rpm].
        lagged: Yaw rate r L/U0 behind a first-order lag [-]; None where nothing remembers.
    """

    t: float | np.ndarray
    x: np.ndarray
    y: np.ndarray
    psi: np.ndarray
    u: np.ndarray
    v: np.ndarray
    r: np.ndarray
    d: np.ndarray
    n: np.ndarray
    lagged: np.ndarray | None = None


Force = Callable[[Moment], np.ndarray]
Gate = Callable[[float | np.ndarray], np.ndarray]


def gate(intervals: Mapping[str, list[list[int]]] | str, runs: list[str], ramp: float = 0.0) -> Gate:
    """How much of an effect acts in each run.

    Args:
        intervals: ``"all"``, or for each run its intervals [s].
        runs: Names of the runs.
        ramp: How long it takes to set in [s]; half of it acts at the start of an interval.

    Returns:
        Function of time: 1 or 0 for each run, between them while it sets in.
    """
    if isinstance(intervals, str):
        always = np.ones(len(runs))
        return lambda t: always
    edges = np.full((2, max((len(parts) for parts in intervals.values()), default=0) or 1, len(runs)), np.inf)
    names = np.array(runs)
    for run, parts in intervals.items():
        for row, (start, end) in enumerate(parts):
            edges[:, row, names == run] = np.array([[start], [end]])
    if not ramp:
        return lambda t: ((edges[0] <= t) & (t < edges[1])).any(0).astype(float)
    return lambda t: np.where(t < edges[1], np.clip((t - edges[0]) / ramp + 0.5, 0.0, 1.0), 0.0).max(0)


def wind(ship: TrialShip, parameters: Mapping[str, float], acts: Gate, gusts: np.ndarray | None = None) -> Force:
    """True wind; gusts add to its speed.

    Args:
        ship: The ship.
        parameters: ``speed`` [m/s], ``from_deg``.
        acts: When it blows.
        gusts: Gust speed [m/s] at 0, 1, 2 ... s, for each run.

    Returns:
        The force; the ship's speed through the water stands for that over ground.
    """
    coefficients, speed = Isherwood(ship), parameters["speed"]
    toward = np.radians(parameters["from_deg"] + 180.0)

    def force(now: Moment) -> np.ndarray:
        blowing = speed * acts(now.t)
        if gusts is not None:
            blowing = np.maximum(blowing + _at_second(gusts, float(now.t)), 0.0)
        return coefficients.force(blowing, toward, now.psi, now.u, now.v)

    return force


def _at_second(series: np.ndarray, t: float) -> np.ndarray:
    """A series of seconds between its samples; its first value before it."""
    at = min(max(t, 0.0), len(series) - 1.001)
    low = int(at)
    return series[low] + (at - low) * (series[low + 1] - series[low])


def wave_drift(ship: TrialShip, parameters: Mapping[str, float], acts: Gate) -> Force:
    """Mean wave force as the format defines it.

    Args:
        ship: The ship.
        parameters: ``Hs`` [m], ``from_deg``.
        acts: When it acts.

    Returns:
        The force.
    """
    q, come_from = RHO * GRAVITY * ship.length * parameters["Hs"] ** 2 / 16, np.radians(parameters["from_deg"])

    def force(now: Moment) -> np.ndarray:
        a = come_from - now.psi
        sine = np.sin(a)
        moment = -0.03 * ship.length * np.sin(2 * a)
        return q * acts(now.t) * np.array([-0.08 * np.cos(a), -0.35 * sine * np.abs(sine), moment])

    return force


def lateral(force_kn: float, lever_m: float, acts: Gate) -> Force:
    """A constant force to starboard at a lever forward of midship.

    Args:
        force_kn: Force [kN].
        lever_m: Lever [m].
        acts: When it acts.

    Returns:
        The force.
    """
    column = 1e3 * force_kn * np.array([[0.0], [1.0], [lever_m]])
    return lambda now: column * acts(now.t)


def propeller_side(ship: TrialShip, parameters: Mapping[str, float]) -> Force:
    """A side force at the propeller, proportional to n squared.

    Args:
        ship: The ship.
        parameters: ``force_kN``.

    Returns:
        The force.
    """
    column = 1e3 * parameters["force_kN"] * np.array([[0.0], [1.0], [PROPELLER * ship.length]])
    return lambda now: column * np.square(now.n / ship.rpm)


def surge(size: Callable[[Moment], np.ndarray]) -> Force:
    """A force along the ship.

    Args:
        size: X [N] as a function of the moment.

    Returns:
        The force.
    """

    def force(now: Moment) -> np.ndarray:
        rows = np.zeros((3, now.u.size))
        rows[0] = size(now)
        return rows

    return force


def fouling(ship: TrialShip, fraction: float) -> Force:
    """Added resistance that grows with u squared.

    Args:
        ship: The ship.
        fraction: Of the calm-water resistance at approach speed.

    Returns:
        The force.
    """
    return surge(lambda now: -fraction * ship.resistance * np.square(now.u / ship.speed))


def ice(force_kn: float) -> Force:
    """A constant resisting force.

    Args:
        force_kn: Force [kN].

    Returns:
        The force.
    """
    return surge(lambda now: -1e3 * force_kn * np.sign(now.u))
