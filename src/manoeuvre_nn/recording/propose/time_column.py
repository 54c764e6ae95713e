"""Which column of an undescribed file is the time, and in which unit."""

from dataclasses import dataclass, field
from itertools import product

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.ship import Particulars
from manoeuvre_nn.recording.check.agreement import AGAINST, window, yaw_readings
from manoeuvre_nn.recording.local_cubics import smoothed
from manoeuvre_nn.recording.propose.headings import Heading, take_apart, word_score
from manoeuvre_nn.recording.propose.sniff import Sniffed
from manoeuvre_nn.recording.read.quantity import UNITS, units_of
from manoeuvre_nn.recording.read.reader import MIN_LENGTH
from manoeuvre_nn.recording.read.table import EMPTY

ORDER = ("s", "ms", "min", "h", "d")
"""Units of time in the order in which they are believed."""
UNUSUAL, ODD = 0.05, 0.2
"""Prices of a unit that is not written down and is not the second, and of a record that no ship makes."""
FASTEST_TURN = 0.5
"""No ship, and no model in a basin, turns faster for long [rad/s]."""
FEW_SECONDS, MANY_SECONDS = 15.0, 2e5
"""Records are longer than the one and shorter than the other [s]."""
TOLD = 0.05
"""Difference of scores that decides."""


@dataclass(frozen=True)
class TimeColumn:
    """How time is read.

    Attributes:
        column: The column.
        unit: Its unit.
        why: In words.
        decided: Whether name or data decided.
        reasons: Settings that go with it -> why.
    """

    column: str
    unit: str
    why: str
    decided: bool = True
    reasons: dict[str, str] = field(default_factory=dict)


def choose_time(
    file: Sniffed, named: dict[str, list[Heading]], ship: Particulars | None
) -> tuple[TimeColumn, Float[np.ndarray, " n"]]:
    """Find the column of time.

    Args:
        file: The file.
        named: Channel -> columns by name.
        ship: The ship, if it is known.

    Returns:
        How time is read, and the sample times [s].

    Raises:
        InputError: If there is none, or it does not increase.
    """
    rated = [(word_score("time", h), h) for h in file.headings]
    stamped = [h for h in file.headings if h.column in file.stamps]
    numeric = [h for score, h in sorted(rated, key=lambda p: -p[0]) if score and h.column in file.numbers]
    rising = [h for h in numeric if _rises(file.numbers[h.column])]
    if rising:
        column = min(rising, key=lambda h: (-word_score("time", h), _unevenness(file.numbers[h.column])))
        return _with_unit(file, column, named, ship)
    if stamped:
        return _stamped(file, stamped[0])
    if numeric:
        _refuse(file, numeric[0].column)
    _refuse_words(file)
    others = {h.column for hs in named.values() for h in hs}
    unnamed = [h for h in file.headings if h.column in set(file.numbers) - others and _rises(file.numbers[h.column])]
    even = [h for h in unnamed if _unevenness(file.numbers[h.column]) < 0.1]
    if not even:
        there = ", ".join(file.called(h.column) for h in file.headings[:20])
        raise InputError(
            f"{file.path.name}: no column of time; it has: {there}; name one t, or time. A table of captive tests has "
            "a mapping of its own: see conf/recording/kvlcc2_hmri.yaml"
        )
    chosen, seconds = _with_unit(file, even[0], named, ship)
    return TimeColumn(chosen.column, chosen.unit, f"rises evenly; {chosen.why}", chosen.decided), seconds


def _refuse_words(file: Sniffed) -> None:
    """Say which column is named a time and holds words that cannot be read as times."""
    known = {h.column for h in file.headings}
    for column in (c for c in map(str, file.table.cells.columns) if c not in known and c not in file.twice):
        name = file.called(column)
        if not word_score("time", take_apart(name)):
            continue
        words = file.table.cells[column].dropna().astype(str).str.strip()
        first = next((word for word in words if word.lower() not in EMPTY), None)
        if first is not None:
            raise InputError(
                f"{file.path.name}: column {name!r} is {first[:40]!r}; expected seconds, 13:04:24.5 or "
                "2020-07-31T13:04:24.5: write times so"
            )


def _rises(values: Float[np.ndarray, " n"]) -> bool:
    """Whether every value is there and larger than the one before."""
    return bool(np.isfinite(values).all() and (np.diff(values) > 0).all())


def _unevenness(values: Float[np.ndarray, " n"]) -> float:
    """Spread of the steps over their size."""
    steps = np.diff(values)
    return float(np.std(steps) / np.mean(steps))


def _refuse(file: Sniffed, column: str) -> None:
    """Say where a time does not increase."""
    values = file.numbers[column]
    if np.isnan(values).any():
        row = int(np.argmax(np.isnan(values)))
        raise file.table.error(column, row, "is empty; a sample without a time cannot be used")
    row = int(np.argmax(np.diff(values) <= 0)) + 1
    raise file.table.error(column, row, f"goes from {values[row - 1]:.12g} to {values[row]:.12g}; times must increase")


def _stamped(file: Sniffed, heading: Heading) -> tuple[TimeColumn, Float[np.ndarray, " n"]]:
    """Time stamps."""
    unit = file.stamps[heading.column]
    seconds = file.table.stamps(heading.column, unit, None)
    if not _rises(seconds):
        lost = np.isnan(seconds)
        row = int(np.argmax(lost)) if lost.any() else int(np.argmax(np.diff(seconds) <= 0)) + 1
        said = "is empty; a sample without a time cannot be used" if lost.any() else "goes back; times must increase"
        raise file.table.error(heading.column, row, said)
    return TimeColumn(heading.column, unit, "time stamps; UTC unless they say otherwise, or time_zone does"), seconds


def _with_unit(
    file: Sniffed, heading: Heading, named: dict[str, list[Heading]], ship: Particulars | None
) -> tuple[TimeColumn, Float[np.ndarray, " n"]]:
    """The unit under which the motion makes most sense."""
    raw = file.numbers[heading.column]
    said = heading.unit if heading.unit in ORDER else ""
    scores = {}
    for unit in ORDER:
        price = AGAINST if said and unit != said else UNUSUAL if not said and unit != "s" else 0.0
        scores[unit] = float(price + _disagreement(raw * UNITS["time"][unit], file, named, ship))
    best, second = sorted(ORDER, key=lambda u: scores[u])[:2]
    apart = scores[second] - scores[best]
    told = f"misfit {scores[best]:.2f}, next {scores[second]:.2f} ({second})"
    if said == best:
        why = "by name"
    elif said:
        why = f"unit by data, against its heading: {told}"
    else:
        why = f"unit by data: {told}" if apart > TOLD + 1e-9 else "usual unit"
    decided = said == best or (not said and apart > TOLD + 1e-9)
    return TimeColumn(heading.column, best, why, bool(decided)), raw * UNITS["time"][best]


def _disagreement(
    time: Float[np.ndarray, " n"], file: Sniffed, named: dict[str, list[Heading]], ship: Particulars | None
) -> float:
    """How badly heading and rate of turn, positions and velocities fit together with these times."""
    length, step = float(time[-1] - time[0]), float(np.median(np.diff(time)))
    least = FEW_SECONDS if ship is None else MIN_LENGTH * ship.time_unit
    odd = ODD * (length < least) + ODD * (length > MANY_SECONDS or step > 100.0)
    given = {c: (hs[0], _filled(file.numbers[hs[0].column])) for c, hs in named.items() if hs}
    if "psi" in given:
        sizes = _sizes("psi", given["psi"][0])
        rates = [smoothed(time, np.unwrap(given["psi"][1] * size), window(time))[1] for size in sizes.values()]
        odd += ODD * all(float(np.quantile(np.abs(rate), 0.9)) > FASTEST_TURN for rate in rates)
        if "r" in given:
            said = (given["psi"][0].unit, given["r"][0].unit)
            read = yaw_readings(time, given["psi"][1], given["r"][1], sizes, _sizes("r", given["r"][0]), said)
            odd += min(read[0].score, 1.0)
    if {"x", "y", "u", "v"} <= set(given):
        odd += _speeds_apart(time, given)
    return odd


def _sizes(channel: str, heading: Heading) -> dict[str, float]:
    """Units that a column may have: the one that it states, else all."""
    known = units_of(channel)
    return {heading.unit: known[heading.unit]} if heading.unit in known else known


def _speeds_apart(time: Float[np.ndarray, " n"], given: dict[str, tuple[Heading, Float[np.ndarray, " n"]]]) -> float:
    """Difference of the logarithms of speeds from positions and from velocities, for the best units."""
    rates = [smoothed(time, given[c][1], window(time))[1] for c in ("x", "y")]
    ratio = float(np.median(np.hypot(*rates)) / max(np.median(np.hypot(given["u"][1], given["v"][1])), 1e-9))
    options = product(_sizes("x", given["x"][0]).values(), _sizes("u", given["u"][0]).values())
    return min(1.0, min(abs(np.log(max(ratio * a / b, 1e-9))) for a, b in options))


def _filled(values: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Empty cells bridged."""
    good = np.isfinite(values)
    rows = np.arange(len(values))
    return values if good.all() else np.interp(rows, rows[good], values[good])
