"""A mapping for a file that nobody has described: from the names of its columns, and from what the columns say."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.recording.check.agreement import Motion
from manoeuvre_nn.recording.check.axes import STRONG_EVIDENCE, rudder_effect
from manoeuvre_nn.recording.check.checks import check_recording
from manoeuvre_nn.recording.outliers import spikes
from manoeuvre_nn.recording.propose.choice import Choice
from manoeuvre_nn.recording.propose.headings import COMPASS, Heading, assign
from manoeuvre_nn.recording.propose.motion_columns import FULL_CIRCLE, Settings, read_motions, usual_speed
from manoeuvre_nn.recording.propose.questions import SETTINGS, question_of
from manoeuvre_nn.recording.propose.sniff import Sniffed, sniff
from manoeuvre_nn.recording.propose.time_column import choose_time
from manoeuvre_nn.recording.read.mapping import RECORD, Mapping, mapping
from manoeuvre_nn.recording.read.mending import line_across
from manoeuvre_nn.recording.read.position import misplaced
from manoeuvre_nn.recording.read.quantity import COUNT, PAIRS, QUANTITY, units_of
from manoeuvre_nn.recording.read.reader import MAX_FILLED_CELLS, read_recording

LARGEST_RUDDER = 1.2
"""Rudder angles beyond this are in degrees [rad]."""
MOVING = ("u", "v", "r", "x", "y", "psi", "lat", "lon", "sog", "cog")
"""Channels that say nothing if they stand still."""
SMALL_RUDDER = 0.6
"""Rudder angles below this are in radians if the ship turns at all [deg or rad]."""
TURNED, MIN_TURNED = 0.5, 0.1
"""Change of heading that no degree of rudder makes, and below which a ship runs straight [rad]."""
FASTEST_SHAFT = 25.0
"""Shaft speeds above this are in revolutions a minute [1/s]."""

MAX_VALUE = 1e30
"""Numbers beyond this are none of a ship's, and their squares overflow."""

Series = Float[np.ndarray, " n"]


@dataclass(frozen=True)
class Proposal:
    """A mapping and the reasons for it.

    Attributes:
        file: What was looked at.
        settings: The mapping as a config.
        time: How time is read.
        choices: How the channels are read.
        reasons: Setting of the mapping -> why.
        undecided: Settings that neither names nor data decided.
        notes: What a person should know, a sentence each.
        left_out: Columns of numbers that no channel is read from.
        finding: What the checks say of the file as it would be read; None if they pass.
    """

    file: Sniffed
    settings: dict[str, Any]
    time: Choice
    choices: tuple[Choice, ...]
    reasons: dict[str, str] = field(default_factory=dict)
    undecided: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()
    finding: str | None = None

    @property
    def mapping(self) -> Mapping:
        """The mapping."""
        return mapping(**self.settings)

    @property
    def questions(self) -> dict[str, str]:
        """Channel or setting that is undecided -> what a person must answer."""
        looked = [choice for choice in (self.time, *self.choices) if not choice.decided]
        return {c.channel: question_of(c, self.file.called(c.column)) for c in looked} | {
            key: SETTINGS.get(key, "is this so?") for key in self.undecided
        }


def propose(path: Path, ship: Particulars | None = None) -> Proposal:
    """Propose a mapping for a file.

    Names give each channel its column and, where a heading states it, its unit. Then the data are asked: which units,
    signs and axes make heading and rate of turn, velocities and positions agree, which side a rudder angle turns the
    ship to. A file without heading, rudder or motion becomes a mapping of ``kind: record``.

    Args:
        path: The file.
        ship: The ship, if it is known: its speed and rudder tell units apart.

    Returns:
        The mapping, and why.

    Raises:
        InputError: If the file cannot be read, has no time, or no column is known.
    """
    file = sniff(path)
    named = assign([h for h in file.headings if h.column in file.numbers])
    _check_sizes(file, named)
    time, seconds = choose_time(file, named, ship)
    others = {c: _moving_first(file, c, [h for h in hs if h.column != time.column]) for c, hs in named.items()}
    columns, spare = _columns({c: hs for c, hs in others.items() if hs}, file)
    if not columns:
        raise InputError(
            f"{path.name}: no column is called like a known channel ({file.overview()}); write the mapping by hand, "
            "see conf/recording, or name the columns t, u, v, r, x, y, psi, delta"
        )
    base = {**file.layout, "time": {"column": time.column, "unit": time.unit}}
    notes = [*_open_questions(file, columns), *spare]
    if _is_record(columns):
        choices, settings = _record(columns, file)
    else:
        values = {c: file.numbers[h.column] for c, h in columns.items()}
        values = {c: line_across(seconds, v, np.isnan(v)) for c, v in values.items()}
        choices, settings, motion = read_motions(seconds, columns, values, ship)
        rudders = [c for c in ("delta", "delta_order") if c in columns]
        choices += [_rudder(c, columns[c], values[c], float(np.ptp(motion.psi))) for c in rudders]
        if columns["delta"].name.startswith("order_"):
            settings["rudder"] = "order", "the column is named an order", True
        settings["rudder_positive_to"] = _rudder_side(path, _config(base, settings, choices), ship or _stand_in(motion))
        rest = set(columns) - {choice.channel for choice in choices}
        choices += [_other(c, h, values[c], usual_speed(motion), ship) for c, h in columns.items() if c in rest]
        notes += _mirrored(columns)
    choices = [_assumed(choice, file) for choice in choices]
    raw = {c.channel: file.numbers[c.column] for c in choices}
    settings |= _gaps(seconds, raw)
    notes += _outlying(raw)
    used = {time.column, *(h.column for h in columns.values())}
    config = _config(base, settings, choices)
    return Proposal(
        file,
        config,
        time,
        tuple(choices),
        reasons={key: why for key, (_, why, _) in settings.items()},
        undecided=tuple(key for key, (_, _, decided) in settings.items() if not decided),
        notes=tuple(notes),
        left_out=tuple(h.column for h in file.headings if h.column not in used),
        finding=_finding(path, config, ship),
    )


def _check_sizes(file: Sniffed, named: dict[str, list[Heading]]) -> None:
    """Refuse numbers whose differences overflow, and positions most of which are nowhere: single ones are outliers."""
    for channel, heading in ((channel, h) for channel, headings in named.items() for h in headings):
        values = file.numbers[heading.column]
        if (huge := np.abs(values) > MAX_VALUE).any():
            row = int(np.argmax(huge))
            raise file.table.error(
                heading.column, row, f"is {values[row]:.3g}, which no motion of a ship does: mend this cell, or leave "
                "the column out"
            )  # fmt: skip
        nowhere, why = misplaced(channel, values * DEGREE)
        if nowhere.mean() > 0.5 and heading.unit in {"", "deg"}:
            row = int(np.argmax(nowhere))
            raise file.table.error(heading.column, row, f"is {values[row]:.6g} deg, {why}")


def _moving_first(file: Sniffed, channel: str, headings: list[Heading]) -> list[Heading]:
    """Columns for a channel, those last that never move: messages hold zeros for what a sensor does not measure."""
    return sorted(headings, key=lambda h: channel in MOVING and _is_still(file.numbers[h.column]))


def _is_still(values: Series) -> bool:
    """Whether a column holds one value throughout."""
    return bool(np.nanmin(values) == np.nanmax(values))


def _assumed(choice: Choice, file: Sniffed) -> Choice:
    """A choice about which the file's reader had to assume something, marked as undecided."""
    said = file.table.questions.get(choice.column)
    return replace(choice, why=f"{said}; {choice.why}", decided=False) if said else choice


def _open_questions(file: Sniffed, columns: dict[str, Heading]) -> list[str]:
    """What its reader has to say, and what is wrong with columns by themselves."""
    notes = [*file.table.notes]
    notes += [f"Several columns are called {name!r} and are left out: rename them." for name in file.twice]
    moving = {c: file.numbers[h.column] for c, h in columns.items() if c in MOVING}
    still = [f"{c} ({file.called(columns[c].column)})" for c, v in moving.items() if _is_still(v)]
    if still:
        notes.append(f"Never moving, so that nothing can be compared with it: {', '.join(still)}; name another column.")
    return notes


def _mirrored(columns: dict[str, Heading]) -> list[str]:
    """What no data can tell, unless a compass or a receiver wrote them down."""
    if COMPASS.search(columns["psi"].name) or {"lat", "cog"} & set(columns):
        return []
    return ["Data cannot tell a ship from her image in a mirror: psi is taken to grow when she turns to starboard."]


def _outlying(raw: dict[str, Series]) -> list[str]:
    """Single samples far off their neighbours."""
    odd = {name: int(spikes(v).sum()) for name, v in raw.items()}
    said = ", ".join(f"{k} {v}" for k, v in odd.items() if v)
    return [f"Single samples far off their neighbours: {said}; outliers: fill takes them out."] if said else []


def _columns(named: dict[str, list[Heading]], file: Sniffed) -> tuple[dict[str, Heading], list[str]]:
    """Columns that can be used, and what is set aside in words."""
    columns, said = {channel: headings[0] for channel, headings in named.items()}, []
    if "v" not in columns and "u" in columns:
        log = columns.pop("u")
        columns.setdefault("u_log", log)
    for one, other in (("u", "v"), ("x", "y"), ("lat", "lon"), ("sog", "cog")):
        if (one in columns) != (other in columns):
            half, lacking = (one, other) if one in columns else (other, one)
            del columns[half]
            called = " and ".join(repr(file.called(h.column)) for h in named[half])
            said.append(f"{half} ({called}) is left out: no column is called like {lacking}, which belongs to it.")
    sides = [c for c in ("delta_starboard", "delta_port") if c in columns]
    if "delta" not in columns and len(sides) == 1:  # the only rudder: "Rudder PS+" names the side of its sign
        columns["delta"] = columns.pop(sides[0])
    if "delta" not in columns and "delta_order" in columns:
        order = columns.pop("delta_order")
        columns["delta"] = replace(order, name=f"order_{order.name}")
    for kept, same in ((("x", "y"), ("lat", "lon")), (("u", "v"), ("sog", "cog"))):
        if {*kept, *same} <= set(columns):
            columns = {c: h for c, h in columns.items() if c not in same}
            said.append(f"{same[0]} and {same[1]} are left out: {kept[0]} and {kept[1]} say the same.")
    return columns, [" ".join(said)] if said else []


def _is_record(columns: dict[str, Heading]) -> bool:
    """Whether this is no manoeuvre: heading, rudder or motion are missing, or have no scale."""
    moving = any(set(pair) <= set(columns) for pair in PAIRS)
    counts = any(columns[c].unit == COUNT for c in ("psi", "delta", "r") if c in columns)
    return counts or not moving or not {"psi", "delta"} <= set(columns)


def _record(columns: dict[str, Heading], file: Sniffed) -> tuple[list[Choice], Settings]:
    """A mapping that reads what there is."""
    choices = []
    for channel, heading in columns.items():
        why = "unit by name" if heading.unit else "no unit is stated: kept as it is"
        choice = Choice(channel, heading.column, heading.unit or COUNT, why=why, decided=bool(heading.unit))
        largest = float(np.nanquantile(np.abs(file.numbers[heading.column]), 0.98))
        if not heading.unit and QUANTITY[channel] == "angle" and largest > FULL_CIRCLE:
            choice = Choice(channel, heading.column, "deg", why=f"unit by size: {largest:.3g}")
        choices.append(choice)
    lacking = [c for c in ("psi", "delta") if c not in columns]
    lacking += [] if any(set(p) <= set(columns) for p in PAIRS) else ["u and v (or x and y)"]
    said = f"it has no {', '.join(lacking)}" if lacking else "rudder or heading have no scale"
    return choices, {"kind": (RECORD, f"no manoeuvre that a model could be made from: {said}", True)}


def _rudder(channel: str, heading: Heading, values: Series, turned: float) -> Choice:
    """Unit of a rudder angle: degrees if radians would be beyond every stop, or would hardly turn the ship."""
    largest, by_data, clear = float(np.abs(values).max()), "", True
    if largest > LARGEST_RUDDER:
        by_data, said = "deg", f"reaches {largest:.3g}"
    elif turned > TURNED or (turned > MIN_TURNED and largest < SMALL_RUDDER):
        by_data, clear = "rad", turned > TURNED
        said = f"stays within {largest:.3g} while the heading changes by {turned / DEGREE:.0f} deg"
    read = Choice(channel, heading.column, by_data or heading.unit or "deg", why="unit by name")
    if by_data and not heading.unit:
        return replace(read, why=f"unit by data: {said}", decided=clear)
    if by_data and by_data != heading.unit:
        return replace(read, why=f"unit by data, against its heading: {said}", decided=False)
    return read if heading.unit else replace(read, why="usual unit", decided=False)


def _rudder_side(path: Path, config: dict[str, Any], ship: Particulars) -> tuple[str, str, bool]:
    """Side that a positive rudder angle turns the ship to."""
    try:
        recording = read_recording(path, mapping(**config, rudder_positive_to="starboard", fill_gaps=1e9), ship)
        effect, error = rudder_effect(recording, ship)
    except InputError:
        return "starboard", "the file cannot be read yet, see below", False
    times = abs(effect) / error if error else 0.0
    if times < STRONG_EVIDENCE:
        return "starboard", f"usual side; the yaw response says little ({times:.1f} standard errors)", False
    side = "starboard" if effect > 0 else "port"
    return side, f"by data: the yaw rate answers a positive angle to {side} ({times:.0f} standard errors)", True


def _stand_in(motion: Motion) -> Particulars:
    """A ship of about this length and speed, where nobody said which ship it is."""
    length = motion.length
    return Particulars(
        "ship", length, length / 6, length / 16, 0.7, usual_speed(motion), rudder_rate=1e3 * DEGREE, rudder_limit=1.5
    )


def _other(channel: str, heading: Heading, values: Series, speed: float, ship: Particulars | None) -> Choice:
    """A channel that nothing in the file can be compared with: unit by name, else by size."""
    if heading.unit:
        return Choice(channel, heading.column, heading.unit, why="by name")
    known, largest = units_of(channel), float(np.quantile(np.abs(values), 0.98))
    quantity = QUANTITY[channel]
    if quantity == "shaft speed":
        rpm = largest > FASTEST_SHAFT if ship is None else abs(np.log(largest / ship.rpm + 1e-9)) < 0.7
        return Choice(channel, heading.column, "rpm" if rpm else "1/s", why=f"unit by size: {largest:.3g}",
                      decided=rpm and largest > FASTEST_SHAFT)  # fmt: skip
    if quantity == "angle" and largest > FULL_CIRCLE:
        return Choice(channel, heading.column, "deg", why=f"unit by size: {largest:.3g}")
    if channel == "u_log":
        unit = min(known, key=lambda u: abs(np.log(largest * known[u] / speed + 1e-9)))
        return Choice(channel, heading.column, unit, why=f"unit by data: {largest:.3g} at {speed:.3g} m/s")
    unit = "deg" if quantity == "angle" else next(iter(known))
    return Choice(channel, heading.column, unit, why="usual unit", decided=False)


def _config(base: dict[str, Any], settings: Settings, choices: list[Choice]) -> dict[str, Any]:
    """A mapping as it is written."""
    values = {key: value for key, (value, *_) in settings.items()}
    return {**base, **values, "channels": {c.channel: c.entry for c in choices}}


def _gaps(seconds: Series, raw: dict[str, Series]) -> Settings:
    """How gaps are filled."""
    gaps = {name: int(np.isnan(v).sum()) for name, v in raw.items() if np.isnan(v).any()}
    if not gaps:
        return {}
    longest = max(float(np.diff(seconds[~np.isnan(raw[name])]).max(initial=0.0)) for name in gaps)
    usual = float(np.median(np.diff(seconds)))
    filled = True if longest <= (MAX_FILLED_CELLS + 1.5) * usual else round(1.01 * longest, 2)
    return {"fill_gaps": (filled, f"empty cells: {', '.join(f'{k} {v}' for k, v in gaps.items())}", True)}


def _finding(path: Path, config: dict[str, Any], ship: Particulars | None) -> str | None:
    """What the checks say of the file read as it is proposed."""
    if config.get("kind") == RECORD or ship is None:
        return None
    try:
        check_recording(read_recording(path, mapping(**config), ship), ship)
    except InputError as error:
        return str(error)
    return None
