"""Which column of an undescribed file is the time, and in which unit."""

from itertools import product

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.recording.check.agreement import AGAINST, window, yaw_readings
from manoeuvre_nn.recording.local_cubics import smoothed
from manoeuvre_nn.recording.propose.choice import Choice
from manoeuvre_nn.recording.propose.headings import Heading, take_apart, word_score
from manoeuvre_nn.recording.propose.sniff import Sniffed
from manoeuvre_nn.recording.read.mending import line_across
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
DATE = r"\d{4}-\d\d-\d\d"
"""A date without a time of day."""
TOLD = 0.05
"""Difference of scores that decides."""

Series = Float[np.ndarray, " n"]
Named = dict[str, list[Heading]]
"""Channel -> columns that are named like it, best first."""


def choose_time(file: Sniffed, named: Named, ship: Particulars | None) -> tuple[Choice, Series]:
    """Find the column of time: the best named one that rises, else time stamps, else what rises evenly.

    Args:
        file: The file.
        named: Channel -> columns by name.
        ship: The ship, if it is known.

    Returns:
        How time is read, and the sample times [s].

    Raises:
        InputError: If there is none, or it does not increase.
    """
    scores = {h.column: word_score("time", h) for h in file.headings}
    numeric = [h for h in file.headings if h.column in file.numbers]
    called = sorted((h for h in numeric if scores[h.column]), key=lambda h: -scores[h.column])
    rising = [h for h in numeric if _rises(file.numbers[h.column])]
    if best := [h for h in called if h in rising]:
        chosen = min(best, key=lambda h: (-scores[h.column], _unevenness(file.numbers[h.column])))
        return _with_unit(file, chosen, named, ship)
    if any(h.column not in file.numbers for h in file.headings):
        return _stamped(file)
    if called:
        file.table.check_rises(called[0].column, file.numbers[called[0].column])
    _refuse_words(file)
    others = {h.column for hs in named.values() for h in hs}
    even = [h for h in rising if h.column not in others and _unevenness(file.numbers[h.column]) < 0.1]
    if not even:
        raise InputError(
            f"{file.path.name}: no column of time; it has: {file.overview()}; name one t, or time. A table of captive "
            "tests has a mapping of its own: see conf/recording/kvlcc2_hmri.yaml"
        )
    return _with_unit(file, even[0], named, ship, "rises evenly; ")


def _stamped(file: Sniffed) -> tuple[Choice, Series]:
    """The first column of time stamps; beside a date alone, the time of day, which may pass midnight."""
    stamped = [h for h in file.headings if h.column not in file.numbers]
    dates = [h for h in stamped if h.unit == "iso" and file.table.text(h.column).str.fullmatch(DATE).all()]
    chosen = next((h for h in stamped if h not in dates), stamped[0])
    seconds = file.table.times(chosen.column, chosen.unit)
    file.table.check_rises(chosen.column, seconds)
    file.table.check_holes(chosen.column, seconds)
    clock = "time of day, which may pass midnight"
    why = clock if chosen.unit == "clock" else "time stamps; UTC unless they say otherwise, or time_zone does"
    return Choice("time", chosen.column, chosen.unit, why=why), seconds


def _refuse_words(file: Sniffed) -> None:
    """Say which column is named a time and holds words that cannot be read as times."""
    known = {h.column for h in file.headings}
    for column in (c for c in file.table.cells.columns if c not in known and c not in file.twice):
        name = file.called(column)
        if not word_score("time", take_apart(name)):
            continue
        first = next((word for word in file.table.text(column) if word.lower() not in EMPTY), None)
        if first is not None:
            raise InputError(
                f"{file.path.name}: column {name!r} is {first[:40]!r}; expected seconds, 13:04:24.5 or "
                "2020-07-31T13:04:24.5: write times so"
            )


def _rises(values: Series) -> bool:
    """Whether every value is there and larger than the one before."""
    return bool(np.isfinite(values).all() and (np.diff(values) > 0).all())


def _unevenness(values: Series) -> float:
    """Spread of the steps over their size."""
    steps = np.diff(values)
    return float(np.std(steps) / np.mean(steps))


def _with_unit(
    file: Sniffed, heading: Heading, named: Named, ship: Particulars | None, found: str = ""
) -> tuple[Choice, Series]:
    """The unit under which the motion makes most sense."""
    raw = file.numbers[heading.column]
    file.table.check_holes(heading.column, raw)
    said = heading.unit if heading.unit in ORDER else ""
    columns = {c: hs[0] for c, hs in named.items()}
    values = {c: file.numbers[h.column] for c, h in columns.items()}
    values = {c: line_across(np.arange(float(len(v))), v, np.isnan(v)) for c, v in values.items()}
    scores = {}
    for unit in ORDER:
        price = AGAINST if said and unit != said else UNUSUAL if not said and unit != "s" else 0.0
        scores[unit] = float(price + _disagreement(raw * UNITS["time"][unit], columns, values, ship))
    best, second = sorted(ORDER, key=lambda u: scores[u])[:2]
    clear = scores[second] - scores[best] > TOLD + 1e-9
    told = f"misfit {scores[best]:.2f}, next {scores[second]:.2f} ({second})"
    if said == best:
        why, decided = "by name", True
    elif said:
        why, decided = f"unit by data, against its heading: {told}", False
    else:
        why, decided = f"unit by data: {told}" if clear else "usual unit", clear
    return Choice("time", heading.column, best, why=found + why, decided=decided), raw * UNITS["time"][best]


def _disagreement(
    time: Series, columns: dict[str, Heading], values: dict[str, Series], ship: Particulars | None
) -> float:
    """How badly heading and rate of turn, positions and velocities fit together with these times."""
    length, step = float(time[-1] - time[0]), float(np.median(np.diff(time)))
    least = FEW_SECONDS if ship is None else MIN_LENGTH * ship.time_unit
    odd = ODD * (length < least) + ODD * (length > MANY_SECONDS or step > 100.0)
    if "psi" in values:
        sizes = _sizes("psi", columns["psi"])
        rates = [smoothed(time, np.unwrap(values["psi"] * size), window(time))[1] for size in sizes.values()]
        odd += ODD * all(float(np.quantile(np.abs(rate), 0.9)) > FASTEST_TURN for rate in rates)
        if "r" in values:
            said = columns["psi"].unit, columns["r"].unit
            read = yaw_readings(time, values["psi"], values["r"], sizes, _sizes("r", columns["r"]), said)
            odd += min(read[0].score, 1.0)
    if {"x", "y", "u", "v"} <= set(values):
        # The difference of the logarithms of speeds from positions and from velocities, for the best units.
        rates = [smoothed(time, values[c], window(time))[1] for c in ("x", "y")]
        ratio = float(np.median(np.hypot(*rates)) / max(np.median(np.hypot(values["u"], values["v"])), 1e-9))
        options = product(_sizes("x", columns["x"]).values(), _sizes("u", columns["u"]).values())
        odd += min(1.0, min(abs(np.log(max(ratio * a / b, 1e-9))) for a, b in options))
    return odd


def _sizes(channel: str, heading: Heading) -> dict[str, float]:
    """Units that a column may have: the one that it states, else all."""
    known = units_of(channel)
    return {heading.unit: known[heading.unit]} if heading.unit in known else known
