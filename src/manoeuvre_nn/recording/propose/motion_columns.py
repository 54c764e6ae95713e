"""Heading, rate of turn, positions and velocities of an undescribed file: units, signs and axes by agreement."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.ship import Particulars
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.recording.check.agreement import (
    AGAINST,
    MIN_SCORE_GAP,
    POINTS,
    Axes,
    Motion,
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
MAX_VALUE = 1e30
"""Numbers beyond this are none of a ship's, and their squares overflow."""
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


@dataclass(frozen=True)
class Motions:
    """How everything that moves is read.

    Attributes:
        choices: How the channels are read.
        settings: Setting of the mapping -> its value and why.
        turned: Largest change of heading [rad].
        speed: Usual speed [m/s].
        stand_in: The ship; where it is not known one of about its length and speed.
    """

    choices: tuple[Choice, ...]
    settings: dict[str, tuple[Any, str]]
    turned: float
    speed: float
    stand_in: Particulars = field(repr=False)


def read_motions(
    time: Series, columns: dict[str, Heading], values: dict[str, Series], ship: Particulars | None
) -> Motions:
    """Find units, signs and axes.

    Args:
        time: Sample times [s].
        columns: Channel -> its heading.
        values: Channel -> its column without gaps, as in the file.
        ship: The ship, if it is known.

    Returns:
        How each channel is read, and why.

    Raises:
        InputError: If numbers are too large to be compared.
    """
    largest = max(float(np.abs(v).max()) for v in values.values())
    if largest > MAX_VALUE:
        raise InputError(f"columns reach {largest:.3g}, which no motion of a ship does: mend or leave out such samples")
    units = _speed_units(time, columns, values, ship)
    if "cog" in columns:
        units["cog"] = _course_unit(columns["cog"], values["cog"])
    best: tuple[Yaw, list[Yaw], Motion, list[Axes]] | None = None
    scores: list[float] = []
    for reading, others in _headings(time, columns, values):
        motion = _motion(time, values, units, reading, ship)
        axes = axes_readings(motion, *_open(columns))
        scores.append(reading.score + axes[0].score)
        if scores[-1] == min(scores):
            best = reading, others, motion, axes
        if columns["psi"].unit == reading.psi_unit and axes[0].evidence < MAX_DOUBTLESS_EVIDENCE:
            break
    assert best is not None
    told_apart = len(scores) > 1 and sorted(scores)[1] - min(scores) > MIN_SCORE_GAP
    return _in_words(best, columns, units, ship, told_apart)


def _headings(time: Series, columns: dict[str, Heading], values: dict[str, Series]) -> list[tuple[Yaw, list[Yaw]]]:
    """Ways to read the heading that are worth a closer look."""
    psi, said = values["psi"], columns["psi"].unit
    sizes = units_of("psi")
    order = [said] if said in sizes else ["deg", "rad"] if np.abs(psi).max() > FULL_CIRCLE else ["rad", "deg"]
    if "r" in values:
        told = (said, columns["r"].unit)
        stated = [columns["r"].unit] if columns["r"].unit in units_of("r") else []
        rates = {u: units_of("r")[u] for u in dict.fromkeys([*stated, *units_of("r")])}
        made = yaw_readings(time, psi, values["r"], {u: sizes[u] for u in dict.fromkeys([*order, *sizes])}, rates, told)
        likely = [next(y for y in made if y.psi_unit == unit) for unit in sizes]
        # Degrees and degrees a second fit as well as radians do: the turned velocities tell which.
        return [(y, made) for y in likely if y.misfit < made[0].misfit + MIN_SCORE_GAP]
    return [(Yaw(unit, "", 1, np.nan, 0.05 * k), []) for k, unit in enumerate(order)]


def _speed_units(
    time: Series, columns: dict[str, Heading], values: dict[str, Series], ship: Particulars | None
) -> dict[str, tuple[str, str, bool]]:
    """Units of positions and of velocities under which speeds are alike: pair -> unit, why, whether it is decided."""
    raw: dict[str, float] = {}
    if "x" in values:
        raw["x"] = float(np.median(np.hypot(*(smoothed(time, values[k], window(time))[1] for k in ("x", "y")))))
    if "lat" in values:
        north, east = _metres(values)
        raw["lat"] = float(np.median(np.hypot(*(smoothed(time, c, window(time))[1] for c in (north, east)))))
    if "u" in values:
        raw["u"] = float(np.median(np.hypot(values["u"], values["v"])))
    if "sog" in values:
        raw["sog"] = float(np.median(values["sog"]))
    options = {k: list(units_of(k)) if k != "lat" else ["deg"] for k in raw}
    rated = []
    for chosen in product(*options.values()):
        units = dict(zip(raw, chosen, strict=True))
        speeds = [raw[k] * (1.0 if k == "lat" else units_of(k)[u]) for k, u in units.items()]
        logs = np.log(np.maximum(speeds, 1e-9))
        apart = float(np.ptp(logs))
        if ship is not None:
            apart += 0.5 * max(0.0, float(abs(logs.mean() - np.log(ship.speed))) - np.log(USUAL_SPEED))
        rated.append((apart + sum(_unit_price(columns[k], options[k], u) for k, u in units.items()), apart, units))
    rated.sort(key=lambda item: item[0])
    score, apart, units = rated[0]
    result = {}
    for k, unit in units.items():
        other = min((item for item in rated if item[2][k] != unit), key=lambda item: item[1], default=None)
        said = columns[k].unit
        told = f"speeds differ by {_share(apart)}"
        told += f", next {_share(other[1])} ({other[2][k]})" if other else ""
        compared = len(raw) > 1 or ship is not None
        if said == unit:
            result[k] = unit, "unit by name", True
        elif said:
            result[k] = unit, f"unit by data, against its heading: {told}", False
        elif compared and other is not None and other[1] - apart > MIN_SCORE_GAP:
            result[k] = unit, "unit by data", True
        else:
            result[k] = unit, "usual unit", False
    return result


def _share(apart: float) -> str:
    """A difference of logarithms in words."""
    return f"{np.expm1(apart):.0%}" if apart < MANIFOLD else "more than tenfold"


def _unit_price(heading: Heading, options: Sequence[str], unit: str) -> float:
    """What a unit costs that is unusual or not the one stated."""
    if heading.unit in options:
        return 0.0 if unit == heading.unit else AGAINST
    return 0.02 * options.index(unit)


def _metres(values: dict[str, Series]) -> tuple[Series, Series]:
    """North and east from latitude and longitude in degrees."""
    return local_metres(values["lat"] * DEGREE, np.unwrap(values["lon"] * DEGREE))


def _motion(
    time: Series, values: dict[str, Series], units: dict[str, tuple[str, str, bool]], yaw: Yaw, ship: Particulars | None
) -> Motion:
    """Columns in SI, smoothed, at some times."""
    long, size = window(time), units_of("psi")[yaw.psi_unit]
    psi, rate = smoothed(time, np.unwrap(values["psi"] * size), long)
    r = yaw.same * smoothed(time, values["r"], long)[0] * units_of("r")[yaw.r_unit] if "r" in values else rate
    track = velocity = over = None
    if "x" in values:
        scale = units_of("x")[units["x"][0]]
        track = tuple(scale * smoothed(time, values[k], long)[1] for k in ("x", "y"))
    elif "lat" in values:
        track = tuple(smoothed(time, c, long)[1] for c in _metres(values))
    if "u" in values:
        scale = units_of("u")[units["u"][0]]
        velocity = tuple(scale * smoothed(time, values[k], long)[0] for k in ("u", "v"))
    if "sog" in values:
        speed, course = (
            values["sog"] * units_of("sog")[units["sog"][0]],
            values["cog"] * units_of("cog")[units["cog"][0]],
        )
        over = tuple(smoothed(time, c, long)[0] for c in (speed * np.cos(course), speed * np.sin(course)))
    at = np.unique(np.linspace(0, len(time) - 1, POINTS).astype(int))
    one, two, three = (None if p is None else (p[0][at], p[1][at]) for p in (track, velocity, over))
    given = next(p for p in (one, two, three) if p is not None)
    speed_usual = max(float(np.median(np.hypot(*given))), 1e-3)
    length = ship.length if ship else speed_usual * TURN / max(float(np.quantile(np.abs(r), 0.95)), 1e-4)
    return Motion(psi[at], r[at], one, two, three, length)


def _course_unit(heading: Heading, values: Series) -> tuple[str, str, bool]:
    """Unit of a course over ground: the one that is stated, else by size; why; whether it is decided."""
    if heading.unit in units_of("cog"):
        return heading.unit, "by name", True
    return ("deg", "unit by size", True) if np.abs(values).max() > FULL_CIRCLE else ("rad", "unit by size", False)


def _open(columns: dict[str, Heading]) -> tuple[dict[str, Sequence], list[str]]:
    """What is not known of the axes, what names say first; and what names state plainly."""
    result: dict[str, Sequence] = {}
    trusted: list[str] = []
    if "x" in columns:
        north_east, east_north = (_named(columns["x"], columns["y"], order) for order in (1, -1))
        result |= {"swapped_xy": [east_north, not east_north], "x_sign": [1, -1], "y_sign": [1, -1]}
        trusted += POSITION if north_east or east_north else ()
    if "u" in columns:
        away = _named(columns["u"], columns["v"], -1)
        result |= {"swapped_uv": [away, not away], "u_sign": [1, -1], "v_sign": [1, -1]}
        result |= {"frame": ["earth", "body"] if EARTH.search(columns["u"].name) else ["body", "earth"]}
    if {"x", "lat", "cog"} & set(columns):
        result |= {"psi_sign": [1, -1], "turn": [0.0, 90.0, 180.0, 270.0]}
    return result, trusted


def _named(one: Heading, other: Heading, order: int) -> bool:
    """Whether two columns are named north and east, in this order or the other."""
    first, second = (one, other)[::order]
    return bool(NORTH.search(first.name) and EAST.search(second.name))


def _in_words(
    best: tuple[Yaw, list[Yaw], Motion, list[Axes]],
    columns: dict[str, Heading],
    units: dict[str, tuple[str, str, bool]],
    ship: Particulars | None,
    told_apart: bool,
) -> Motions:
    """The readings as choices with their reasons."""
    yaw, others, m, axes = best
    a = axes[0]
    read: list[Choice] = []
    settings: dict[str, tuple[Any, str]] = {}
    rest = (*POSITION, *COURSE, "frame")
    if "u" in columns:
        told = _told(axes, VELOCITY, rest, "sides by the track" if m.track or m.over else "as a ship moves")
        pair = ("v", "u") if a.swapped_uv else ("u", "v")
        read += _pair(("u", "v"), pair, (a.u_sign, a.v_sign), columns, units["u"], told)
        by_frame = _told(axes, ("frame",), (*POSITION, *COURSE), "by data")
        if a.frame == "earth" or not by_frame.clear:
            compared = f": misfit {by_frame.misfit}, next {by_frame.next}" if by_frame.why else ""
            said = f"by data{compared}"
            settings["frame"] = a.frame, said if by_frame.clear else f"undecided: {said}"
    if "x" in columns:
        told = _told(
            axes,
            POSITION,
            (*VELOCITY, *COURSE, "frame"),
            "axes by heading, u, v" if "u" in columns else "axes by heading",
        )
        pair = ("y", "x") if a.swapped_xy else ("x", "y")
        read += _pair(("x", "y"), pair, (a.x_sign, a.y_sign), columns, units["x"], told)
    if "lat" in columns:
        read += [Choice(k, columns[k].column, "deg", why="by name") for k in ("lat", "lon")]
    if "sog" in columns:
        for k in ("sog", "cog"):
            unit, why, decided = units[k]
            read.append(Choice(k, columns[k].column, unit, why=why, decided=decided))
    read += _yaw_in_words(yaw, others, axes, columns, told_apart)
    settings |= _points(a, columns, m)
    speeds = [np.hypot(*p) for p in (m.velocity, m.track, m.over) if p is not None]
    speed = float(np.median(speeds[0]))
    turned = float(np.ptp(m.psi))
    return Motions(tuple(read), settings, turned, speed,
                   ship or _stand_in(m.length, speed))  # fmt: skip


@dataclass(frozen=True)
class _Told:
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
    compared = not np.isnan(best.misfit)
    own, others = (best.misfit, other.misfit) if compared else (best.evidence, other.evidence)
    return _Told(what, f"{own:.2f}", f"{others:.2f} {instead}", other.evidence - best.evidence > MIN_SCORE_GAP)


def _instead(attribute: str, value: object) -> str:
    """A value of the runner-up in words."""
    if attribute.startswith("swapped"):
        return "exchanged" if value else "not exchanged"
    if attribute == "frame":
        return f"{value} axes"
    name, _, rest = attribute.partition("_")
    return (
        f"{name} {value} deg off" if name == "turn" else f"{name} {'+' if value == 1 else '-'}" if rest else str(value)
    )


def _pair(
    names: tuple[str, str],
    sources: tuple[str, str],
    signs: tuple[int, int],
    columns: dict[str, Heading],
    unit: tuple[str, str, bool],
    told: _Told,
) -> list[Choice]:
    """Two channels that are rated together."""
    word, why, known = unit
    made = []
    for name, source, sign in zip(names, sources, signs, strict=True):
        changed = "columns exchanged" if name != source else ""
        said = "; ".join(part for part in (why, changed, told.why) if part)
        made.append(
            Choice(name, columns[source].column, word, sign, 0.0, said, known and told.clear, told.misfit, told.next)
        )
    return made


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


def _points(a: Axes, columns: dict[str, Heading], m: Motion) -> dict[str, tuple[Any, str]]:
    """Which point of the ship the file speaks of."""
    of_track = [c for c in ("x", "lat") if c in columns]
    middle = [c for c in (*of_track, "u") if c in columns and MIDSHIP.search(columns[c].name)]
    if abs(a.lever) > LEAST_LEVER * m.length:
        said = f"x, y are those of a point {a.lever:.3g} m forward of that of u, v, by their sway in turns"
        if middle == of_track:
            return {"reference_point": (round(-a.lever, 2), said), "position_point": (0.0, "x, y: by name")}
        return {"position_point": (round(a.lever, 2), f"{said}; u, v are taken for midship's")}
    if middle:
        return {}
    return {"reference_point": (0.0, "undecided: no data show which point it is; midship is assumed")}


def _stand_in(length: float, speed: float) -> Particulars:
    """A ship of about this length and speed, where nobody said which ship it is."""
    particulars = Particulars(
        "ship", length, length / 6, length / 16, 0.7, speed, rudder_rate=1e3 * DEGREE, rudder_limit=1.5
    )
    return replace(particulars, source="guessed from the record")
