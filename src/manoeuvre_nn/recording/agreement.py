"""Units, signs and axes under which the columns of a file agree with each other best.

A ship's heading, rate of turn, velocities and positions say the same in several ways: ``psidot = r``; velocities turned
by the heading are the rates of the positions. Every combination of units, signs and axes is tried, and the one that
fits best is taken, with a small price for each thing that is unusual or against what a heading says. A *misfit* is the
typical error over the typical size [-].
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from math import inf

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.frames import earth_to_body
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.recording.accelerations import smoothed

POINTS = 600
"""Samples that combinations are compared at."""
FLIP, SWAP, TURN, EARTH = 0.02, 0.02, 0.03, 0.01
"""Prices of a sign that is -1, of exchanged columns, of a heading from another axis, of earth-fixed velocities."""
AGAINST = 0.08
"""Price of what contradicts a heading."""
LEVER = 0.03, 0.15
"""Price of two points of the ship in one file, and of their distance over L."""
FARTHEST = 0.6
"""Largest distance of two points over L."""
CLEAR = 0.05
"""Difference of scores that decides."""

Series = Float[np.ndarray, " n"]


@dataclass(frozen=True)
class Yaw:
    """A way to read heading and rate of turn.

    Attributes:
        psi_unit: Unit of the heading.
        r_unit: Unit of the rate of turn.
        same: +1 if both count the same way round, else -1.
        misfit: Of the heading's rate and r.
        score: Misfit and prices.
    """

    psi_unit: str
    r_unit: str
    same: int
    misfit: float
    score: float


@dataclass(frozen=True)
class Axes:
    """A way to read heading, positions and velocities.

    Attributes:
        psi_sign: Sign of the heading.
        turn: Heading that the file shows when the ship goes along x [deg]: 0, 90, 180 or 270.
        swapped_xy: Whether the columns called x and y are exchanged.
        x_sign: Sign of x after that.
        y_sign: Sign of y after that.
        swapped_uv: Whether the columns called u and v are exchanged.
        u_sign: Sign of u after that.
        v_sign: Sign of v after that.
        frame: ``body`` or ``earth``.
        lever: How far forward of the point of u and v the point of x and y lies [m].
        misfit: Of velocities and the rates of positions; NaN where nothing can be compared.
        evidence: Misfit, and what a ship does not do.
        score: Evidence and prices.
    """

    psi_sign: int = 1
    turn: int = 0
    swapped_xy: bool = False
    x_sign: int = 1
    y_sign: int = 1
    swapped_uv: bool = False
    u_sign: int = 1
    v_sign: int = 1
    frame: str = "body"
    lever: float = 0.0
    misfit: float = np.nan
    evidence: float = inf
    score: float = inf


@dataclass(frozen=True)
class Motion:
    """Smoothed columns at some times, in SI but for signs and axes; what the file lacks is None.

    Attributes:
        psi: Heading [rad].
        r: Rate of turn with the heading's sign [rad/s].
        track: Rates of the two positions [m/s].
        velocity: The two velocities [m/s].
        over: Velocity over ground to north and east, from speed and course [m/s].
        length: The ship's length, or a guess [m].
    """

    psi: Series
    r: Series
    track: tuple[Series, Series] | None
    velocity: tuple[Series, Series] | None
    over: tuple[Series, Series] | None
    length: float


def window(time: Series) -> float:
    """A smoothing window that suits a record whose ship is not known.

    Args:
        time: Sample times.

    Returns:
        Its length, in the unit of time.
    """
    samples = float(np.clip(len(time) / 60, 5, 61))
    return samples * float(np.median(np.diff(time)))


def yaw_readings(
    time: Series,
    psi: Series,
    r: Series,
    psi_units: Mapping[str, float],
    r_units: Mapping[str, float],
    said: tuple[str, str] = ("", ""),
) -> list[Yaw]:
    """Every way to read a heading and a rate of turn, best first.

    Args:
        time: Sample times [s].
        psi: Heading as in the file.
        r: Rate of turn as in the file.
        psi_units: Units that it may have -> their value [rad].
        r_units: Units that it may have -> their value [rad/s].
        said: Units that the headings state; empty if they do not.

    Returns:
        Readings with their misfit.
    """
    made = []
    long = window(time)
    rate_of = {unit: smoothed(time, np.unwrap(psi * size), long)[1] for unit, size in psi_units.items()}
    turning = smoothed(time, r, long)[0]
    for psi_unit, r_unit in product(psi_units, r_units):
        rate, read = rate_of[psi_unit], turning * r_units[r_unit]
        size = max(float(np.quantile(np.abs(rate), 0.9)), float(np.quantile(np.abs(read), 0.9)), 1e-12)
        price = sum(AGAINST for s, unit in zip(said, (psi_unit, r_unit), strict=True) if s and s != unit)
        price += 0.01 * (list(psi_units).index(psi_unit) + list(r_units).index(r_unit))
        for same in (1, -1):
            misfit = float(np.median(np.abs(rate - same * read))) / size
            misfit += 0.5 * float(np.quantile(np.abs(rate - same * read), 0.9)) / size
            made.append(Yaw(psi_unit, r_unit, same, misfit, misfit + price + FLIP * (same < 0)))
    return sorted(made, key=lambda reading: reading.score)


def axes_readings(m: Motion, fixed: Axes, open_: Mapping[str, Sequence]) -> list[Axes]:
    """Every way to read heading, positions and velocities together, best first.

    Args:
        m: Heading, rates of positions, velocities.
        fixed: What is known; also what costs nothing.
        open_: Attribute of :class:`Axes` -> values that it may have; the first costs nothing.

    Returns:
        Readings with their misfit.
    """
    made = []
    for values in product(*open_.values()):
        reading = replace(fixed, **dict(zip(open_, values, strict=True)))
        price = sum(_price(k, value, choices[0]) for (k, choices), value in zip(open_.items(), values, strict=True))
        made.append(_judged(m, reading, price))
    return sorted(made, key=lambda reading: reading.score)


def runner_up(readings: Sequence[Axes], differing: Sequence[str], alike: Sequence[str] = ()) -> Axes | None:
    """What the data alone would choose next.

    Args:
        readings: The best one first.
        differing: Attributes of which at least one differs from the best reading's.
        alike: Attributes that are as in the best reading. A world seen in a mirror agrees as well as the true one: what
            is asked is always which sign fits the others.

    Returns:
        The reading with the best evidence; None if there is none.
    """
    best = readings[0]

    def picked(a: Axes, names: Sequence[str]) -> list:
        return [getattr(a, name) for name in names]

    others = [r for r in readings if picked(r, alike) == picked(best, alike)]
    others = [r for r in others if picked(r, differing) != picked(best, differing)]
    return min(others, key=lambda r: r.evidence, default=None)


def _price(attribute: str, value: object, usual: object) -> float:
    """What an unusual value costs."""
    if value == usual:
        return 0.0
    return {"frame": EARTH, "turn": TURN, "swapped_xy": SWAP, "swapped_uv": SWAP}.get(attribute, FLIP)


def _judged(m: Motion, a: Axes, price: float) -> Axes:
    """A reading with its misfit and score."""
    psi = a.psi_sign * (m.psi - a.turn * DEGREE)
    r = a.psi_sign * m.r
    bodies: dict[str, tuple[Series, Series]] = {}
    if m.track is not None:
        one, other = m.track[::-1] if a.swapped_xy else m.track
        bodies["track"] = earth_to_body(a.x_sign * one, a.y_sign * other, psi)
    if m.over is not None:
        bodies["over"] = earth_to_body(*m.over, psi)
    if m.velocity is not None:
        one, other = m.velocity[::-1] if a.swapped_uv else m.velocity
        one, other = a.u_sign * one, a.v_sign * other
        bodies["velocity"] = earth_to_body(one, other, psi) if a.frame == "earth" else (one, other)
    odd = max((_unlike_a_ship(b, r) for b in bodies.values()), default=0.0)
    if len(bodies) < 2:
        return replace(a, evidence=odd, score=odd + price)
    pairs = [("velocity", "track"), ("velocity", "over"), ("track", "over")]
    both = [(bodies[one], bodies[other]) for one, other in pairs if one in bodies and other in bodies]
    misfit, lever = float(np.mean([_misfit(*pair) for pair in both])), 0.0
    if {"velocity", "track"} <= set(bodies):
        lever = _lever(bodies["velocity"], bodies["track"], r, FARTHEST * m.length)
        moved = _misfit((bodies["velocity"][0], bodies["velocity"][1] + lever * r), bodies["track"])
        worth = moved + LEVER[0] + LEVER[1] * abs(lever) / m.length
        if len(both) == 1 and worth < misfit:
            return replace(a, lever=lever, misfit=moved, evidence=worth + odd, score=worth + odd + price)
    return replace(a, lever=0.0, misfit=misfit, evidence=misfit + odd, score=misfit + odd + price)


def _misfit(one: tuple[Series, Series], other: tuple[Series, Series]) -> float:
    """Typical error of the forward speed over the speed plus that of the sway over the sway."""
    speed = max(float(np.median(np.hypot(*other))), 1e-9)
    sway = 0.5 * float(np.quantile(np.abs(one[1]), 0.9)) + 0.5 * float(np.quantile(np.abs(other[1]), 0.9))
    surge = float(np.median(np.abs(one[0] - other[0]))) / speed
    return surge + float(np.median(np.abs(one[1] - other[1]))) / max(sway, 0.01 * speed)


def _unlike_a_ship(body: tuple[Series, Series], r: Series) -> float:
    """Price of going astern or sideways, and of not drifting outward in a turn."""
    u, v = body
    speed = np.maximum(np.hypot(u, v), 1e-9)
    astern = float(np.mean(np.clip(-u / speed, 0, 1)))
    sideways = float(np.median(np.abs(v) / speed))
    size = float(np.linalg.norm(v) * np.linalg.norm(r))
    inward = 0.5 + 0.5 * float(v @ r) / size if size > 1e-12 else 0.5
    return 0.5 * astern + 0.3 * sideways + 0.1 * inward


def _lever(velocity: tuple[Series, Series], track: tuple[Series, Series], r: Series, most: float) -> float:
    """Distance of two points along the ship, from ``v_track - v = lever r``, twice without outlying samples [m]."""
    away, keep, lever = track[1] - velocity[1], np.ones(len(r), dtype=bool), 0.0
    for _ in range(3):
        lever = float(r[keep] @ away[keep] / max(r[keep] @ r[keep], 1e-30))
        error = np.abs(away - lever * r)
        keep = error <= 4 * np.median(error) + 1e-12
    return float(np.clip(lever, -most, most))
