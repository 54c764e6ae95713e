"""A mapping for a file that nobody has described: from the names of its columns, and from what the columns say."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.ship import Particulars
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.recording.check.axes import STRONG_EVIDENCE, rudder_effect
from manoeuvre_nn.recording.check.checks import check_recording
from manoeuvre_nn.recording.outliers import spikes
from manoeuvre_nn.recording.propose.choice import Choice
from manoeuvre_nn.recording.propose.headings import COMPASS, Heading, assign
from manoeuvre_nn.recording.propose.motion_columns import FULL_CIRCLE, Motions, read_motions
from manoeuvre_nn.recording.propose.sniff import Sniffed, sniff
from manoeuvre_nn.recording.propose.time_column import choose_time
from manoeuvre_nn.recording.read.mapping import RECORD, Mapping, mapping
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
        left_out: Columns that no channel is read from.
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
    time, seconds = choose_time(file, named, ship)
    named = {c: [h for h in hs if h.column != time.column] for c, hs in named.items()}
    columns, spare = _columns(named)
    if not columns:
        there = ", ".join(file.called(h.column) for h in file.headings[:20])
        raise InputError(
            f"{path.name}: no column is called like a known channel ({there}); write the mapping by hand, see "
            "conf/recording, or name the columns t, u, v, r, x, y, psi, delta"
        )
    timed = Choice("time", time.column, time.unit, why=time.why, decided=time.decided)
    base = {**file.layout, "time": {"column": time.column, "unit": time.unit}}
    values = {c: _without_gaps(seconds, file.numbers[h.column]) for c, h in columns.items()}
    used = {time.column, *(h.column for h in columns.values())}
    rest = tuple(h.column for h in file.headings if h.column not in used)
    made = Proposal(file, base, timed, (), time.reasons, notes=_open_questions(file, columns), left_out=rest)
    if _is_record(columns):
        return _finished(_record(made, columns), seconds, ship)
    if spare:
        made = replace(made, notes=(*made.notes, spare))
    return _finished(_moving(made, columns, values, seconds, ship), seconds, ship)


def _open_questions(file: Sniffed, columns: dict[str, Heading]) -> tuple[str, ...]:
    """What is wrong with columns by themselves."""
    notes = [f"Several columns are called {name!r} and are left out: rename them." for name in file.twice]
    still = [c for c in columns if c in MOVING and _stands_still(file.numbers[columns[c].column])]
    if still:
        named = ", ".join(f"{c} ({file.called(columns[c].column)})" for c in still)
        notes.append(f"Never moving, so that nothing can be compared with it: {named}; name another column.")
    return tuple(notes)


def _stands_still(values: Float[np.ndarray, " n"]) -> bool:
    """Whether all samples that are there are the same."""
    return bool(np.nanmin(values) == np.nanmax(values))


def _columns(named: dict[str, list[Heading]]) -> tuple[dict[str, Heading], str]:
    """One column a channel, and what was set aside in words."""
    columns = {c: hs[0] for c, hs in named.items() if hs}
    if "v" not in columns and "u" in columns:
        log = columns.pop("u")
        columns.setdefault("u_log", log)
    if "v" in columns and "u" not in columns:
        columns.pop("v")
    for one, other in (("x", "y"), ("lat", "lon"), ("sog", "cog")):
        if (one in columns) != (other in columns):
            for half in (one, other):
                columns.pop(half, None)
    if "delta" not in columns and "delta_order" in columns:
        columns["delta"] = columns.pop("delta_order")
        columns["delta"] = replace(columns["delta"], name=f"order_{columns['delta'].name}")
    said = []
    for kept, same in ((("x", "y"), ("lat", "lon")), (("u", "v"), ("sog", "cog"))):
        if {*kept, *same} <= set(columns):
            for name in same:
                columns.pop(name)
            said.append(f"{same[0]} and {same[1]} are left out: {kept[0]} and {kept[1]} say the same.")
    return columns, " ".join(said)


def _is_record(columns: dict[str, Heading]) -> bool:
    """Whether this is no manoeuvre: heading, rudder or motion are missing, or have no scale."""
    moving = any(set(pair) <= set(columns) for pair in PAIRS)
    counts = any(columns[c].unit == COUNT for c in ("psi", "delta", "r") if c in columns)
    return counts or not moving or not {"psi", "delta"} <= set(columns)


def _record(made: Proposal, columns: dict[str, Heading]) -> Proposal:
    """A mapping that reads what there is."""
    choices = []
    for channel, heading in columns.items():
        unit = heading.unit or COUNT
        why = "unit by name" if heading.unit else "no unit is stated: kept as it is"
        choices.append(Choice(channel, heading.column, unit, why=why, decided=bool(heading.unit)))
    lacking = [c for c in ("psi", "delta") if c not in columns]
    lacking += [] if any(set(p) <= set(columns) for p in PAIRS) else ["u and v (or x and y)"]
    said = f"it has no {', '.join(lacking)}" if lacking else "rudder or heading have no scale"
    settings = {**made.settings, "kind": RECORD}
    reasons = {**made.reasons, "kind": f"no manoeuvre that a model could be made from: {said}"}
    return replace(made, settings=settings, choices=tuple(choices), reasons=reasons)


def _moving(
    made: Proposal,
    columns: dict[str, Heading],
    values: dict[str, Float[np.ndarray, " n"]],
    seconds: Float[np.ndarray, " n"],
    ship: Particulars | None,
) -> Proposal:
    """A mapping of a manoeuvre: first what moves, then the rudder, then the rest."""
    motions = read_motions(seconds, columns, values, ship)
    choices = list(motions.choices)
    settings, reasons, undecided = dict(made.settings), dict(made.reasons), list(made.undecided)
    for key, (value, why) in motions.settings.items():
        settings[key], reasons[key] = value, why
    for channel in ("delta", "delta_order"):
        if channel in columns:
            unit, why, decided = _rudder_unit(columns[channel], values[channel], motions.turned)
            choices.append(Choice(channel, columns[channel].column, unit, why=why, decided=decided))
    if columns["delta"].name.startswith("order_"):
        settings["rudder"], reasons["rudder"] = "order", "the column is named an order"
    made = replace(made, settings=settings, choices=tuple(choices), reasons=reasons)
    notes = list(made.notes)
    side, why, decided = _rudder_side(made, motions)
    settings["rudder_positive_to"], reasons["rudder_positive_to"] = side, why
    undecided += [] if decided else ["rudder_positive_to"]
    others = [c for c in columns if c not in {choice.channel for choice in choices}]
    choices += [_other(c, columns[c], values[c], motions, ship) for c in others]
    if not COMPASS.search(columns["psi"].name) and not {"lat", "cog"} & set(columns):
        notes.append(
            "Data cannot tell a ship from her image in a mirror: psi is taken to grow when she turns to starboard."
        )
    return replace(made, choices=tuple(choices), undecided=tuple(undecided), notes=tuple(notes))


def _rudder_unit(heading: Heading, values: np.ndarray, turned: float) -> tuple[str, str, bool]:
    """Unit of a rudder angle: degrees if radians would be beyond every stop, or would hardly turn the ship."""
    largest, by_data, clear = float(np.abs(values).max()), "", True
    if largest > LARGEST_RUDDER:
        by_data, said = "deg", f"reaches {largest:.3g}"
    elif turned > TURNED or (turned > MIN_TURNED and largest < SMALL_RUDDER):
        by_data, clear = "rad", turned > TURNED
        said = f"stays within {largest:.3g} while the heading changes by {turned / DEGREE:.0f} deg"
    if by_data and heading.unit in {"", by_data}:
        return by_data, "unit by name" if heading.unit else f"unit by data: {said}", bool(heading.unit) or clear
    if by_data:
        return by_data, f"unit by data, against its heading: {said}", False
    return (heading.unit or "deg"), "unit by name" if heading.unit else "usual unit", bool(heading.unit)


def _rudder_side(made: Proposal, motions: Motions) -> tuple[str, str, bool]:
    """Side that a positive rudder angle turns the ship to."""
    settings = _settings({**made.settings, "rudder_positive_to": "starboard"}, made.choices)
    try:
        recording = read_recording(made.file.path, mapping(**{**settings, "fill_gaps": 1e9}), motions.stand_in)
        effect, error = rudder_effect(recording, motions.stand_in)
    except InputError:
        return "starboard", "the file cannot be read yet, see below", False
    times = abs(effect) / error if error else 0.0
    if times < STRONG_EVIDENCE:
        return "starboard", f"usual side; the yaw response says little ({times:.1f} standard errors)", False
    side = "starboard" if effect > 0 else "port"
    return side, f"by data: the yaw rate answers a positive angle to {side} ({times:.0f} standard errors)", True


def _other(channel: str, heading: Heading, values: np.ndarray, motions: Motions, ship: Particulars | None) -> Choice:
    """A channel that nothing in the file can be compared with: unit by name, else by size."""
    if heading.unit:
        return Choice(channel, heading.column, heading.unit, why="by name")
    known, largest = list(units_of(channel)), float(np.quantile(np.abs(values), 0.98))
    quantity = QUANTITY[channel]
    if quantity == "shaft speed":
        nominal = None if ship is None else ship.rpm
        rpm = largest > FASTEST_SHAFT if nominal is None else abs(np.log(largest / nominal + 1e-9)) < 0.7
        return Choice(channel, heading.column, "rpm" if rpm else "1/s", why=f"unit by size: {largest:.3g}",
                      decided=rpm and largest > FASTEST_SHAFT)  # fmt: skip
    if quantity == "angle" and largest > FULL_CIRCLE:
        return Choice(channel, heading.column, "deg", why=f"unit by size: {largest:.3g}")
    if channel == "u_log":
        speed = motions.speed
        unit = min(known, key=lambda u: abs(np.log(largest * units_of(channel)[u] / speed + 1e-9)))
        return Choice(channel, heading.column, unit, why=f"unit by data: {largest:.3g} at {speed:.3g} m/s")
    unit = "deg" if quantity == "angle" else known[0]
    return Choice(channel, heading.column, unit, why="usual unit", decided=False)


def _settings(base: dict[str, Any], choices: tuple[Choice, ...]) -> dict[str, Any]:
    """The config of a mapping."""
    channels: dict[str, dict[str, Any]] = {}
    for c in choices:
        channels[c.channel] = {"column": c.column, "unit": c.unit}
        channels[c.channel] |= {"sign": c.sign} if c.sign != 1 else {}
        channels[c.channel] |= {"offset": c.offset} if c.offset else {}
    return {**base, "channels": channels}


def _finished(made: Proposal, seconds: Float[np.ndarray, " n"], ship: Particulars | None) -> Proposal:
    """Gaps and outliers noted, and the file read as it was proposed."""
    settings, notes, reasons = dict(made.settings), list(made.notes), dict(made.reasons)
    raw = {c.channel: made.file.numbers[c.column] for c in made.choices}
    gaps = {name: int(np.isnan(v).sum()) for name, v in raw.items() if np.isnan(v).any()}
    if gaps:
        longest = max(_longest_gap(seconds, np.isnan(raw[name])) for name in gaps)
        usual = float(np.median(np.diff(seconds)))
        settings["fill_gaps"] = True if longest <= (MAX_FILLED_CELLS + 1.5) * usual else round(1.01 * longest, 2)
        reasons["fill_gaps"] = f"empty cells: {', '.join(f'{k} {v}' for k, v in gaps.items())}"
    odd = {name: int(spikes(v).sum()) for name, v in raw.items()}
    if any(odd.values()):
        said = ", ".join(f"{k} {v}" for k, v in odd.items() if v)
        notes.append(f"Single samples far off their neighbours: {said}; outliers: fill takes them out.")
    settings = _settings(settings, made.choices)
    made = replace(made, settings=settings, notes=tuple(notes), reasons=reasons)
    if settings.get("kind") == RECORD or ship is None:
        return made
    try:
        check_recording(read_recording(made.file.path, made.mapping, ship), ship)
    except InputError as error:
        return replace(made, finding=str(error))
    return made


def _longest_gap(seconds: Float[np.ndarray, " n"], lost: np.ndarray) -> float:
    """Longest time between two samples that are there [s]."""
    return float(np.diff(seconds[~lost]).max(initial=0.0))


def _without_gaps(seconds: Float[np.ndarray, " n"], values: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """A column without empty cells; headings are bridged well enough for a guess."""
    good = np.isfinite(values)
    return values if good.all() else np.interp(seconds, seconds[good], values[good])
