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
from typing import Any

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.frames import earth_to_body
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.recording.local_cubics import smoothed
from manoeuvre_nn.recording.outliers import trimmed_least_squares

POINTS = 400
"""Samples that combinations are compared at."""
FLIP, SWAP, TURN, EARTH, ASKEW = 0.02, 0.02, 0.03, 0.01, 0.1
"""Prices of a sign that is -1, of exchanged columns, of a heading from another axis, of earth-fixed velocities,
of axes that are turned against the heading by any angle."""
AGAINST = 0.08
"""Price of what contradicts a heading."""
LEVER = 0.15, 0.15
"""Price of two points of the ship in one file, and of their distance over L."""
SWAY = 0.2
"""Usual sway in a manoeuvre over the speed."""
MAX_LEVER = 0.6
"""Largest distance of two points over L."""
LEVER_SDS = 2.7
"""Standard deviations beyond which a sample does not count for that distance."""
MAX_EVIDENCE = 0.5
"""Evidence against the best reading above which none fits."""
MIN_SCORE_GAP = 0.05
"""Difference of scores that decides."""

Series = Float[np.ndarray, " n"]
Pair = tuple[np.ndarray, np.ndarray]
"""Two series: without shapes, for these are looked at a thousand times a file."""


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
        turn: Heading that the file shows when the ship goes along x [deg].
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
    turn: float = 0.0
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
    """Length of a smoothing window that suits a record whose ship is not known, in the unit of time."""
    return float(np.clip(len(time) / 60, 5, 61) * np.median(np.diff(time)))


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


def axes_readings(m: Motion, open_: Mapping[str, Sequence], trusted: Sequence[str] = ()) -> list[Axes]:
    """Every way to read heading, positions and velocities together, best first.

    Where none fits, the heading may be counted from any direction: positions of a basin have axes of their own.

    Args:
        m: Heading, rates of positions, velocities.
        open_: Attribute of :class:`Axes` -> values that it may have; the first costs nothing.
        trusted: Attributes whose first value the headings state.

    Returns:
        Readings with their misfit.
    """
    rated = _Rating(m)
    prices = [
        [_price(k, value, values[0]) + AGAINST * (k in trusted and value != values[0]) for value in values]
        for k, values in open_.items()
    ]
    chosen = zip(product(*open_.values()), product(*prices), strict=True)
    made = [rated(Axes(**dict(zip(open_, values, strict=True))), sum(price)) for values, price in chosen]
    if "turn" in open_ and min(reading.evidence for reading in made) > MAX_EVIDENCE:
        straight = [reading for reading in made if reading.turn == 0]
        turned = [replace(a, turn=round(_askew(m, a), 1)) for a in straight]
        made += [rated(a, b.score - b.evidence + ASKEW) for a, b in zip(turned, straight, strict=True)]
    return sorted(made, key=lambda reading: reading.score)


def _askew(m: Motion, a: Axes) -> float:
    """Angle between the track and what heading and velocities say it should be [deg]."""
    other = m.track or m.over
    if other is None:
        return 0.0
    one, two = other[::-1] if a.swapped_xy else other
    course = np.arctan2(a.y_sign * two, a.x_sign * one)
    if m.velocity is None:
        ahead = a.psi_sign * m.psi
    else:
        u, v = m.velocity[::-1] if a.swapped_uv else m.velocity
        ahead = np.arctan2(a.v_sign * v, a.u_sign * u) + (0.0 if a.frame == "earth" else a.psi_sign * m.psi)
    away = np.angle(np.mean(np.exp(1j * (ahead - course))))
    return float(a.psi_sign * away / DEGREE) % 360.0


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

    def same(a: Axes, names: Sequence[str]) -> bool:
        return all(getattr(a, name) == getattr(best, name) for name in names)

    others = [a for a in readings if same(a, alike) and not same(a, differing)]
    return min(others, key=lambda a: a.evidence, default=None)


def _price(attribute: str, value: object, usual: object) -> float:
    """What an unusual value costs."""
    if value == usual:
        return 0.0
    return {"frame": EARTH, "turn": TURN, "swapped_xy": SWAP, "swapped_uv": SWAP}.get(attribute, FLIP)


class _Rating:
    """Rates readings of one file; what several readings have in common is computed once."""

    def __init__(self, motion: Motion) -> None:
        self.motion = motion
        self.kept: dict[tuple, tuple[Pair, float]] = {}

    def __call__(self, a: Axes, price: float) -> Axes:
        """A reading with its misfit and score."""
        bodies = self.bodies(a)
        odd = max((odd for _, odd in bodies.values()), default=0.0)
        pairs = [("velocity", "track"), ("velocity", "over"), ("track", "over")]
        both = [(bodies[one][0], bodies[other][0]) for one, other in pairs if one in bodies and other in bodies]
        if not both:
            return replace(a, evidence=odd, score=odd + price)
        speed = max(float(_median(np.hypot(*both[0][0]))), 1e-9)
        errors = [_errors(*pair, speed) for pair in both]
        misfit, lever = float(np.mean([sum(error) for error in errors])), 0.0
        worth = misfit
        velocity, track = both[0]
        # Another point of the ship is worth a thought only where forward speeds agree and a sway was recorded.
        alone = len(both) == 1 and "over" not in bodies and np.ptp(velocity[1]) > 1e-9
        if alone and misfit > LEVER[0] and errors[0][0] < LEVER[0]:
            r = a.psi_sign * self.motion.r
            away = _lever(velocity, track, r, MAX_LEVER * self.motion.length)
            moved = sum(_errors((velocity[0], velocity[1] + away * r), track, speed))
            dear = moved + LEVER[0] + LEVER[1] * abs(away) / self.motion.length
            misfit, lever, worth = (moved, away, dear) if dear < misfit else (misfit, 0.0, misfit)
        return replace(a, lever=lever, misfit=misfit, evidence=worth + odd, score=worth + odd + price)

    def bodies(self, a: Axes) -> dict[str, tuple[Pair, float]]:
        """Velocities in body axes by every way that the file has, and how unlike a ship's they are."""
        m, course = self.motion, (a.psi_sign, a.turn)
        asked = {
            "track": (m.track, *course, a.swapped_xy, a.x_sign, a.y_sign, "earth"),
            "over": (m.over, *course, False, 1, 1, "earth"),
            "velocity": (m.velocity, *course, a.swapped_uv, a.u_sign, a.v_sign, a.frame),
        }
        return {k: self.body(k, *how) for k, (given, *how) in asked.items() if given is not None}

    def body(self, what: str, *how: Any) -> tuple[Pair, float]:
        """One of them."""
        if (what, *how) not in self.kept:
            psi_sign, turn, swapped, first, second, frame = how
            one, other = getattr(self.motion, what)[:: -1 if swapped else 1]
            body = first * one, second * other
            if frame == "earth":
                body = earth_to_body(*body, psi_sign * (self.motion.psi - turn * DEGREE))
            self.kept[what, *how] = body, _unlike_a_ship(body, psi_sign * self.motion.r)
        return self.kept[what, *how]


def _median(values: np.ndarray) -> float:
    """The upper median: numpy's own takes as long as all the rest."""
    half = len(values) // 2
    return float(np.partition(values, half)[half])


def _errors(one: Pair, other: Pair, speed: float) -> tuple[float, float]:
    """Typical error of the forward speed over the speed, and that of the sway over a usual sway."""
    ahead, aside = (_median(np.abs(a - b)) for a, b in zip(one, other, strict=True))
    # Not over the sway of this reading: a wrong one makes it large, and the error small beside it.
    return ahead / speed, aside / (SWAY * speed)


def _unlike_a_ship(body: Pair, r: np.ndarray) -> float:
    """Price of going astern or sideways, and of not drifting outward in a turn."""
    u, v = body
    speed = np.maximum(np.hypot(u, v), 1e-9)
    astern = float(np.mean(np.clip(-u / speed, 0, 1)))
    sideways = float(np.median(np.abs(v) / speed))
    size = float(np.linalg.norm(v) * np.linalg.norm(r))
    inward = 0.5 + 0.5 * float(v @ r) / size if size > 1e-12 else 0.5
    return 0.5 * astern + 0.5 * sideways + 0.1 * inward


def _lever(velocity: Pair, track: Pair, r: np.ndarray, most: float) -> float:
    """Distance of two points along the ship, from ``v_track - v = lever r`` [m]."""
    lever = trimmed_least_squares(r[:, None], track[1] - velocity[1], LEVER_SDS, 1e-12)[0][0]
    return float(np.clip(lever, -most, most))
