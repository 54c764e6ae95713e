"""Heading, rate of turn, positions and velocities of an undescribed file: units, signs and axes by agreement."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.recording.check.agreement import (
    AGAINST,
    MIN_SCORE_GAP,
    POINTS,
    Axes,
    Motion,
    Pair,
    Yaw,
    axes_readings,
    runner_up,
    window,
    yaw_readings,
)
from manoeuvre_nn.recording.local_cubics import smoothed
from manoeuvre_nn.recording.propose.choice import Choice
from manoeuvre_nn.recording.propose.headings import EARTH, EAST, MIDSHIP, NORTH, Heading
from manoeuvre_nn.recording.read.position import local_metres
from manoeuvre_nn.recording.read.quantity import units_of

TURN = 0.5
"""Usual rate of turn in a manoeuvre over U0/L: how a ship's L/U0 is guessed."""
USUAL_SPEED = 1.5
"""Speeds of a ship lie within this factor of U0 unless something is wrong [-]."""
LEAST_LEVER = 0.05
"""Distance of two points over L that is told apart."""
MANIFOLD = float(np.log(10.0))
"""Differences of logarithms beyond this are not worth a number."""
FULL_CIRCLE = 2 * np.pi + 0.5
"""Directions beyond this are in degrees [rad]."""
MAX_DOUBTLESS_EVIDENCE = 0.2
"""Evidence against the best reading below which a unit that the heading states needs no doubt."""
POSITION = ("swapped_xy", "x_sign", "y_sign")
VELOCITY = ("swapped_uv", "u_sign", "v_sign")
COURSE = ("psi_sign", "turn")

Series = Float[np.ndarray, " n"]


Settings = dict[str, tuple[Any, str, bool]]
"""Setting of a mapping -> its value, why, and whether names or data decided."""


def read_motions(
    time: Series, columns: dict[str, Heading], values: dict[str, Series], ship: Particulars | None
) -> tuple[list[Choice], Settings, Motion]:
    """Find units, signs and axes of everything that moves.

    Args:
        time: Sample times [s].
        columns: Channel -> its heading.
        values: Channel -> its column without gaps, as in the file.
        ship: The ship, if it is known.

    Returns:
        How each channel is read, what is set beside, and the motion in SI but for signs and axes.
    """
    track = _track(time, values)
    units = _speed_units(columns, values, track, ship)
    if "cog" in columns:
        units["cog"] = _course_unit(columns["cog"], values["cog"])
    given = _velocities(time, values, units, track)
    best: tuple[Yaw, list[Yaw], Motion, list[Axes]] | None = None
    scores: list[float] = []
    for reading, others in _headings(time, columns, values):
        motion = _motion(time, values, reading, given, ship)
        axes = axes_readings(motion, *_open(columns))
        scores.append(reading.score + axes[0].score)
        if scores[-1] == min(scores):
            best = reading, others, motion, axes
        if columns["psi"].unit == reading.psi_unit and axes[0].evidence < MAX_DOUBTLESS_EVIDENCE:
            break
    assert best is not None
    yaw, others, motion, axes = best
    told_apart = len(scores) > 1 and sorted(scores)[1] - min(scores) > MIN_SCORE_GAP
    choices, settings = _axes_in_words(axes, motion, columns, units)
    choices += _yaw_in_words(yaw, others, axes, columns, told_apart)
    return choices, settings | _points(axes[0], columns, motion), motion


def usual_speed(motion: Motion) -> float:
    """Median speed, of velocities if there are any [m/s]."""
    return float(np.median(np.hypot(*next(p for p in (motion.velocity, motion.track, motion.over) if p is not None))))


def _headings(time: Series, columns: dict[str, Heading], values: dict[str, Series]) -> list[tuple[Yaw, list[Yaw]]]:
    """Ways to read the heading that are worth a closer look."""
    psi, said = values["psi"], columns["psi"].unit
    sizes = units_of("psi")
    order = [said] if said in sizes else ["deg", "rad"] if np.abs(psi).max() > FULL_CIRCLE else ["rad", "deg"]
    if "r" not in values:
        return [(Yaw(unit, "", 1, np.nan, 0.05 * k), []) for k, unit in enumerate(order)]
    rates, stated = units_of("r"), columns["r"].unit
    rates = ({stated: rates[stated]} if stated in rates else {}) | rates
    made = yaw_readings(time, psi, values["r"], {u: sizes[u] for u in order} | sizes, rates, (said, stated))
    likely = [next(y for y in made if y.psi_unit == unit) for unit in sizes]
    # Degrees and degrees a second fit as well as radians do: the turned velocities tell which.
    return [(y, made) for y in likely if y.misfit < made[0].misfit + MIN_SCORE_GAP]


def _track(time: Series, values: dict[str, Series]) -> Pair | None:
    """Rates of the two positions, in the file's unit of length a second or, from latitude and longitude, in m/s."""
    if "x" in values:
        places = values["x"], values["y"]
    elif "lat" in values:
        places = local_metres(values["lat"] * DEGREE, np.unwrap(values["lon"] * DEGREE))
    else:
        return None
    long = window(time)
    return smoothed(time, places[0], long)[1], smoothed(time, places[1], long)[1]


def _speed_units(
    columns: dict[str, Heading],
    values: dict[str, Series],
    track: Pair | None,
    ship: Particulars | None,
) -> dict[str, Choice]:
    """Units of positions and of velocities under which speeds are alike."""
    raw: dict[str, float] = {}
    if track is not None:
        raw["x" if "x" in values else "lat"] = float(np.median(np.hypot(*track)))
    if "u" in values:
        raw["u"] = float(np.median(np.hypot(values["u"], values["v"])))
    if "sog" in values:
        raw["sog"] = float(np.median(values["sog"]))
    sizes = {k: units_of(k) if k != "lat" else {"deg": 1.0} for k in raw}
    rated = []
    for chosen in product(*sizes.values()):
        units = dict(zip(raw, chosen, strict=True))
        logs = np.log(np.maximum([raw[k] * sizes[k][u] for k, u in units.items()], 1e-9))
        apart = float(np.ptp(logs))
        if ship is not None:
            apart += 0.5 * max(0.0, float(abs(logs.mean() - np.log(ship.speed))) - np.log(USUAL_SPEED))
        price = sum(_unit_price(columns[k], list(sizes[k]), u) for k, u in units.items())
        rated.append((apart + price, apart, units))
    rated.sort(key=lambda item: item[0])
    _, apart, units = rated[0]
    result = {k: Choice(k, columns[k].column, unit, why="unit by name") for k, unit in units.items()}
    for k, unit in units.items():
        other = min((item for item in rated if item[2][k] != unit), key=lambda item: item[1], default=None)
        said = columns[k].unit
        compared = len(raw) > 1 or ship is not None
        if said and said != unit:
            told = f"unit by data, against its heading: speeds differ by {_share(apart)}"
            told += f", next {_share(other[1])} ({other[2][k]})" if other else ""
            result[k] = replace(result[k], why=told, decided=False)
        elif not said:
            clear = compared and other is not None and bool(other[1] - apart > MIN_SCORE_GAP)
            result[k] = replace(result[k], why="unit by data" if clear else "usual unit", decided=clear)
    return result


def _share(apart: float) -> str:
    """A difference of logarithms in words."""
    return f"{np.expm1(apart):.0%}" if apart < MANIFOLD else "more than tenfold"


def _unit_price(heading: Heading, options: Sequence[str], unit: str) -> float:
    """What a unit costs that is unusual or not the one stated."""
    if heading.unit in options:
        return 0.0 if unit == heading.unit else AGAINST
    return 0.02 * options.index(unit)


def _velocities(
    time: Series, values: dict[str, Series], units: dict[str, Choice], track: Pair | None
) -> dict[str, Pair | None]:
    """Velocities of :class:`Motion` in SI at some times, by every way that the file has."""
    size = {k: units_of(k)[choice.unit] for k, choice in units.items()} | {"lat": 1.0}
    made: dict[str, Pair | None] = {"track": track, "velocity": None, "over": None}
    if track is not None:
        scale = size["x" if "x" in values else "lat"]
        made["track"] = scale * track[0], scale * track[1]
    if "u" in values:
        u, v = (size["u"] * smoothed(time, values[k], window(time))[0] for k in ("u", "v"))
        made["velocity"] = u, v
    if "sog" in values:
        speed, course = values["sog"] * size["sog"], values["cog"] * size["cog"]
        north, east = (smoothed(time, c, window(time))[0] for c in (speed * np.cos(course), speed * np.sin(course)))
        made["over"] = north, east
    at = _some(time)
    return {k: None if p is None else (p[0][at], p[1][at]) for k, p in made.items()}


def _motion(
    time: Series, values: dict[str, Series], yaw: Yaw, given: dict[str, Pair | None], ship: Particulars | None
) -> Motion:
    """The motion under one reading of the heading; the length of a ship that is not known is guessed."""
    psi, rate = smoothed(time, np.unwrap(values["psi"] * units_of("psi")[yaw.psi_unit]), window(time))
    r = rate
    if "r" in values:
        r = yaw.same * smoothed(time, values["r"], window(time))[0] * units_of("r")[yaw.r_unit]
    speed = max(float(np.median(np.hypot(*next(p for p in given.values() if p is not None)))), 1e-3)
    length = ship.length if ship else speed * TURN / max(float(np.quantile(np.abs(r), 0.95)), 1e-4)
    return Motion(psi[_some(time)], r[_some(time)], length=length, **given)


def _some(time: Series) -> Int[np.ndarray, " m"]:
    """Samples that readings are compared at."""
    return np.unique(np.linspace(0, len(time) - 1, POINTS).astype(int))


def _course_unit(heading: Heading, values: Series) -> Choice:
    """Unit of a course over ground: the one that is stated, else by size."""
    if heading.unit in units_of("cog"):
        return Choice("cog", heading.column, heading.unit, why="by name")
    large = bool(np.abs(values).max() > FULL_CIRCLE)
    return Choice("cog", heading.column, "deg" if large else "rad", why="unit by size", decided=large)


def _open(columns: dict[str, Heading]) -> tuple[dict[str, Sequence], list[str]]:
    """What is not known of the axes, what names say first; and what names state plainly."""
    result: dict[str, Sequence] = {}
    trusted: list[str] = []
    if "x" in columns:
        north_east, east_north = _named(columns["x"], columns["y"]), _named(columns["y"], columns["x"])
        result |= {"swapped_xy": [east_north, not east_north], "x_sign": [1, -1], "y_sign": [1, -1]}
        trusted += POSITION if north_east or east_north else ()
    if "u" in columns:
        away = _named(columns["v"], columns["u"])
        result |= {"swapped_uv": [away, not away], "u_sign": [1, -1], "v_sign": [1, -1]}
        result |= {"frame": ["earth", "body"] if EARTH.search(columns["u"].name) else ["body", "earth"]}
    if {"x", "lat", "cog"} & set(columns):
        result |= {"psi_sign": [1, -1], "turn": [0.0, 90.0, 180.0, 270.0]}
    return result, trusted


def _named(north: Heading, east: Heading) -> bool:
    """Whether two columns are named north and east."""
    return bool(NORTH.search(north.name) and EAST.search(east.name))


def _axes_in_words(
    axes: list[Axes], m: Motion, columns: dict[str, Heading], units: dict[str, Choice]
) -> tuple[list[Choice], Settings]:
    """How velocities and positions are read."""
    a = axes[0]
    read: list[Choice] = []
    settings: Settings = {}
    if "u" in columns:
        what = "sides by the track" if m.track or m.over else "as a ship moves"
        told = _told(axes, VELOCITY, (*POSITION, *COURSE, "frame"), what)
        read += _pair(("u", "v"), a.swapped_uv, (a.u_sign, a.v_sign), columns, units["u"], told)
        by_frame = _told(axes, ("frame",), (*POSITION, *COURSE), "by data")
        if a.frame == "earth" or not by_frame.clear:
            compared = f": misfit {by_frame.misfit}, next {by_frame.next}" if by_frame.why else ""
            settings["frame"] = a.frame, f"by data{compared}", by_frame.clear
    if "x" in columns:
        what = "axes by heading, u, v" if "u" in columns else "axes by heading"
        told = _told(axes, POSITION, (*VELOCITY, *COURSE, "frame"), what)
        read += _pair(("x", "y"), a.swapped_xy, (a.x_sign, a.y_sign), columns, units["x"], told)
    if "lat" in columns:
        read += [Choice(k, columns[k].column, "deg", why="by name") for k in ("lat", "lon")]
    if "sog" in columns:
        read += [units["sog"], units["cog"]]
    return read, settings


class _Told(NamedTuple):
    """What data say of a choice: in words, its misfit, that of the next one, whether that is clear."""

    why: str = ""
    misfit: str = ""
    next: str = ""
    clear: bool = True


def _told(axes: list[Axes], asked: Sequence[str], alike: Sequence[str], what: str) -> _Told:
    """How clearly data speak for what was chosen."""
    best, other = axes[0], runner_up(axes, asked, alike)
    if other is None:
        return _Told()
    names = [n for n in asked if getattr(best, n) != getattr(other, n)]
    instead = ", ".join(_instead(n, getattr(other, n)) for n in names)
    own, others = (best.evidence, other.evidence) if np.isnan(best.misfit) else (best.misfit, other.misfit)
    return _Told(what, f"{own:.2f}", f"{others:.2f} {instead}", other.evidence - best.evidence > MIN_SCORE_GAP)


def _instead(attribute: str, value: object) -> str:
    """A value of the runner-up in words."""
    if attribute.startswith("swapped"):
        return "exchanged" if value else "not exchanged"
    if attribute == "frame":
        return f"{value} axes"
    if attribute == "turn":
        return f"turn {value} deg off"
    return f"{attribute.removesuffix('_sign')} {'+' if value == 1 else '-'}"


def _pair(
    names: tuple[str, str],
    swapped: bool,
    signs: tuple[int, int],
    columns: dict[str, Heading],
    unit: Choice,
    told: _Told,
) -> list[Choice]:
    """Two channels that are rated together."""
    stated = {columns[name].unit for name in names}
    apart = "the headings state different units, and one is taken for both" if len(stated) > 1 else ""
    why = "; ".join(part for part in (unit.why, apart, "columns exchanged" if swapped else "", told.why) if part)
    clear = unit.decided and told.clear and not apart
    return [
        Choice(name, columns[source].column, unit.unit, sign, 0.0, why, clear, told.misfit, told.next)
        for name, source, sign in zip(names, names[::-1] if swapped else names, signs, strict=True)
    ]


def _yaw_in_words(
    yaw: Yaw, others: list[Yaw], axes: list[Axes], columns: dict[str, Heading], told_apart: bool
) -> list[Choice]:
    """Heading and rate of turn."""
    a, said = axes[0], columns["psi"].unit
    told = _told(axes, COURSE, (*POSITION, *VELOCITY, "frame"), "zero, sign by motion")
    offset = float(a.turn) if yaw.psi_unit == "deg" else round(a.turn * DEGREE, 9)
    by = "unit by name" if said == yaw.psi_unit else "unit by data" if others or told_apart else "unit by size"
    if said and said != yaw.psi_unit:
        by += ", against its heading"
    known = said == yaw.psi_unit or bool(others) or told_apart
    sure = told.clear or (a.psi_sign == 1 and a.turn == 0)
    why = "; ".join(part for part in (by, told.why) if part)
    column = columns["psi"].column
    read = [Choice("psi", column, yaw.psi_unit, a.psi_sign, offset, why, known and sure, told.misfit, told.next)]
    if "r" not in columns:
        return read
    alike = [y for y in others if y.psi_unit == yaw.psi_unit and (y.r_unit, y.same) != (yaw.r_unit, yaw.same)]
    other = min(alike, key=lambda y: y.misfit)
    stated = columns["r"].unit
    by = "unit by name" if stated == yaw.r_unit else "unit by data" + (", against its heading" if stated else "")
    instead = other.r_unit if other.same == yaw.same else f"{other.r_unit}, other sign"
    sign, clear = yaw.same * a.psi_sign, other.misfit - yaw.misfit > MIN_SCORE_GAP
    why, told_next = f"{by}; sign by psi", f"{other.misfit:.2f} {instead}"
    column = columns["r"].column
    return [*read, Choice("r", column, yaw.r_unit, sign, 0.0, why, clear, f"{yaw.misfit:.2f}", told_next)]


def _points(a: Axes, columns: dict[str, Heading], m: Motion) -> Settings:
    """Which point of the ship the file speaks of."""
    of_track = [c for c in ("x", "lat") if c in columns]
    middle = [c for c in (*of_track, "u") if c in columns and MIDSHIP.search(columns[c].name)]
    if abs(a.lever) > LEAST_LEVER * m.length:
        said = f"x, y are those of a point {a.lever:.3g} m forward of that of u, v, by their sway in turns"
        if middle == of_track:
            return {"reference_point": (round(-a.lever, 2), said, True), "position_point": (0.0, "x, y: by name", True)}
        return {"position_point": (round(a.lever, 2), f"{said}; u, v are taken for midship's", True)}
    if middle:
        return {}
    return {"reference_point": (0.0, "no data show which point it is; midship is assumed", False)}
