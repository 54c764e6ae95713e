"""How a measured file's columns become channels: names, units, signs, axes, and what is wrong with its sensors."""

from collections.abc import Iterable
from collections.abc import Mapping as AnyMapping
from dataclasses import dataclass, field, fields
from typing import Any, get_args, get_type_hints
from zoneinfo import ZoneInfo

from manoeuvre_nn.core.data_files import without_format
from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.core.manoeuvre import side_sign
from manoeuvre_nn.recording.read.quantity import PAIRS, QUANTITY, STAMPS, units_of

RECORD = "record"
"""Kind of a file that is no manoeuvre of the ship: any channels, counts too; no model is made from it."""
KINDS = ("zigzag", "turning_circle", "pull_out", "spiral", "straight", "random_rudder", RECORD)
"""Kinds of manoeuvre that criteria know."""
REQUIRED = ("psi", "delta")
"""Channels that every manoeuvre needs."""
SIDES = {name: (f"{name}_starboard", f"{name}_port") for name in ("delta", "n")}
"""Channel -> those of both sides, whose mean it is where it is not given itself."""
WANTED = {
    "reference_point": "metres, e.g. 0.0",
    "position_point": "metres, or null",
    "start": "seconds, e.g. 12.5, or null",
    "end": "seconds, or null",
    "skip_rows": "a whole number, e.g. 0",
    "header": "true or false",
    "optional": "true or false",
    "fill_gaps": "true, false or seconds, e.g. 2.0",
    "drift": "keep, arcs, or a known one such as {speed: 0.5, toward_deg: 90}",
    "delimiter": "one character such as ; or the word whitespace",
    "rudder_positive_to": "starboard or port",
}
"""Setting -> what to write; any other is a word."""
MAX_SCALE = 1e6
"""Largest scale, and the inverse of the smallest: what is further off is another unit."""


@dataclass(frozen=True)
class ChannelMap:
    """Where one channel is found in a file: ``SI = sign scale (value - offset) unit``.

    Attributes:
        column: The column's heading, its number from 1 in a file without headings, its name in a MAT file (``a.b`` for
            field b of structure a).
        unit: Its unit.
        sign: -1 turns the values round.
        offset: What the file shows where the true value is zero, in the file's unit.
        scale: What a sensor that shows too little is corrected by [-].
        delay: How much too late the channel is written down [s]; the reader moves it back.
    """

    column: str
    unit: str
    sign: int = 1
    offset: float = 0.0
    scale: float = 1.0
    delay: float = 0.0


@dataclass(frozen=True)
class Mapping:
    """A kind of file: columns, units, signs, axes.

    Attributes:
        time: The time column. Unit ``iso`` is date and time as text (or as such a column of a parquet file), ``clock``
            the time of day, which may pass midnight.
        channels: Channel (u v r x y psi delta, maybe n, delta_order, wind_speed ...) -> where it is. One pair of u v,
            x y, lat lon, sog cog is enough; r may be left out; delta and n are the means of delta_starboard and
            delta_port, n_starboard and n_port where only these are given.
        frame: Axes of the columns given for u and v: ``body``, or ``earth`` for velocities north and east.
        reference_point: How far forward of midship the point lies whose u, v, x, y are given [m].
        position_point: The same for x, y (lat, lon) alone; None is the point of u, v.
        rudder_positive_to: Side that a positive rudder angle of the file turns the ship to.
        rudder: ``angle``, or ``order`` where the column of delta holds what was ordered: the ship's steering gear then
            follows it at its rate, and the order is kept as ``delta_order``.
        delimiter: What parts the columns of a text; ``whitespace`` for any run of blanks.
        decimal: ``point`` or ``comma``.
        header: Whether the first line names the columns.
        skip_rows: Lines before the headings, or before the data in a file without headings.
        fill_gaps: Whether up to 3 missing samples in a row are filled by a straight line; a number is how many seconds
            at most are filled.
        outliers: ``keep``, or ``fill``: single samples far off their neighbours are replaced by a straight line.
        drift: ``keep``; ``arcs``: turning circles lose the drift that their overlapping arcs tell, others stay as they
            are; or a known current, ``{speed: m/s, toward_deg: deg}``, which every recording loses.
        start: Time from the file's first sample at which the record begins [s]; None is that sample.
        end: The same of its end.
        time_zone: Where the clock stood, for time stamps that do not say it, e.g. ``Asia/Tokyo``; None is UTC.
        kind: Kind of manoeuvre; None guesses it from the rudder; ``record`` is no manoeuvre and may lack any channel.
        place: ``open_water``, or ``tank``, where neither wind nor waves, current, lines or ice act: a diagnosis names
            none of them then, unless they are asked for.
        optional: Whether a file may lack columns: time, psi, delta and one pair are needed, columns that are not there
            or hold no numbers count as not recorded. Where several pairs of velocities are there, sog and cog are
            taken.
    """

    time: ChannelMap
    channels: AnyMapping[str, ChannelMap] = field(default_factory=dict)
    frame: str = "body"
    reference_point: float = 0.0
    position_point: float | None = None
    rudder_positive_to: str = "starboard"
    rudder: str = "angle"
    delimiter: str = ","
    decimal: str = "point"
    header: bool = True
    skip_rows: int = 0
    fill_gaps: bool | float = False
    outliers: str = "keep"
    drift: str | AnyMapping[str, float] = "keep"
    start: float | None = None
    end: float | None = None
    time_zone: str | None = None
    kind: str | None = None
    place: str = "open_water"
    optional: bool = False

    def __post_init__(self) -> None:
        """Refuse what cannot be read.

        Raises:
            InputError: If a setting is unknown, or a channel is missing that nothing replaces.
        """
        _check_unit("time", self.time)
        for name, channel in self.channels.items():
            check_choice("mapping: channel", name, list(QUANTITY))
            _check_unit(name, channel, self.kind == RECORD)
        check_choice("mapping: frame", self.frame, ["body", "earth"])
        check_choice("mapping: rudder", self.rudder, ["angle", "order"])
        check_choice("mapping: decimal", self.decimal, ["point", "comma"])
        check_choice("mapping: outliers", self.outliers, ["keep", "fill"])
        check_choice("mapping: place", self.place, ["open_water", "tank"])
        side_sign("mapping: rudder_positive_to", self.rudder_positive_to)
        _check_drift(self.drift)
        if self.delimiter != "whitespace" and (len(self.delimiter) != 1 or self.delimiter in '"\n\r'):
            raise InputError(f"mapping: delimiter={self.delimiter!r}; write {WANTED['delimiter']}")
        if self.kind is not None:
            check_choice("mapping: kind", self.kind, KINDS)
        _check_window(self.start, self.end)
        _check_zone(self.time_zone, self.time.unit)
        if self.rudder == "order" and "delta_order" in self.channels:
            raise InputError(
                "mapping: rudder=order says that the column of delta holds the order; take delta_order out of channels"
            )
        check_once("mapping", {"time": self.time, **self.channels})
        if self.kind != RECORD:
            _check_complete(with_means(self.channels), self.optional)
        elif not self.channels:
            raise InputError("mapping: channels is empty; write e.g. r: {column: yaw_rate, unit: count} under channels")

    @property
    def table(self) -> dict[str, Any]:
        """What :func:`~manoeuvre_nn.recording.read.table.read_table` asks: columns, how a text is cut into them."""
        columns = {name: c.column for name, c in self.channels.items()}
        always = {name for name in REQUIRED if name not in SIDES or not set(columns).issuperset(SIDES[name])}
        needed = {self.time.column, *(c for name, c in columns.items() if name in always or not self.optional)}
        settings = {key: getattr(self, key) for key in ("delimiter", "decimal", "header", "skip_rows")}
        optional = [c for c in columns.values() if c not in needed]
        return {"columns": [self.time.column, *columns.values()], "optional": optional, **settings}

    @property
    def is_record(self) -> bool:
        """Whether this is no manoeuvre: any channels."""
        return self.kind == RECORD

    def factor(self, channel: str) -> float:
        """What a column's numbers are multiplied by, after its offset has been taken off.

        Args:
            channel: ``time`` or a channel.

        Returns:
            Sign times scale times the unit's value in SI; for the rudder also the sign of its side.
        """
        where = self.time if channel == "time" else self.channels[channel]
        unit = units_of(channel, self.is_record)[where.unit]
        side = side_sign("rudder_positive_to", self.rudder_positive_to) if channel.startswith("delta") else 1
        return where.sign * side * where.scale * unit


def with_means(names: Iterable[str]) -> set[str]:
    """Channels, and those that are the means of both sides among them."""
    there = set(names)
    return there | {mean for mean, both in SIDES.items() if there.issuperset(both)}


def mapping(**settings: Any) -> Mapping:
    """Read a mapping from a config.

    Args:
        settings: The keys of :class:`Mapping`; ``time`` and each of ``channels`` as ``{column: T, unit: s, sign: 1}``.

    Returns:
        The mapping.

    Raises:
        InputError: If a key is unknown or missing, or a value makes no sense.
    """
    given = {k: v for k, v in without_format(settings, "mapping").items() if not k.startswith("_")}
    known = [f.name for f in fields(Mapping)]
    for key in given:
        check_choice("mapping: key", key, known)
    such = {"time": "time: {column: t, unit: s}", "channels": "channels: {psi: {column: hdg, unit: deg}, ...}"}
    for key in such:
        if not isinstance(given.get(key), AnyMapping):
            raise InputError(f"mapping: {key} is {given.get(key)!r}; write e.g. {such[key]}")
    time = _channel_map("time", given.pop("time"))
    channels = {str(k): _channel_map(str(k), v) for k, v in given.pop("channels").items()}
    return Mapping(time, channels, **{key: _setting(key, value) for key, value in given.items()})


def _setting(key: str, value: Any) -> Any:
    """A setting of the type that :class:`Mapping` declares."""
    if key == "drift":
        _check_drift(value)
        return value
    declared = get_type_hints(Mapping)[key]
    kinds = get_args(declared) or (declared,)
    fits = any(is_number(value) if kind is float else type(value) is kind for kind in kinds)
    if is_number(value) and (value < 0 if key == "skip_rows" else value <= 0 if key == "fill_gaps" else False):
        fits = False
    if not fits:
        raise InputError(f"mapping: {key}={value!r}; write {WANTED.get(key, 'a word')}")
    return float(value) if is_number(value) and float in kinds else value


def _channel_map(name: str, given: object) -> ChannelMap:
    """One column's entry."""
    keys = [f.name for f in fields(ChannelMap)]
    if not isinstance(given, AnyMapping) or not {"column", "unit"} <= set(given):
        raise InputError(f"mapping: {name} is {given!r}; write {name}: {{column: HEADING, unit: UNIT}}")
    for key in given:
        check_choice(f"mapping: key of {name}", key, keys)
    sign = sign_of(f"mapping: sign of {name}", given.get("sign", 1))
    numbers = {key: given[key] for key in ("offset", "scale", "delay") if key in given}
    for key, value in numbers.items():
        if not is_number(value):
            raise InputError(f"mapping: {key} of {name} is {value!r}; write a number")
    if not 1 / MAX_SCALE < numbers.get("scale", 1.0) < MAX_SCALE:
        raise InputError(
            f"mapping: scale of {name} is {given['scale']!r}; write a factor above 0 (to {MAX_SCALE:g}), and sign: -1"
        )
    if name == "time" and set(given) - {"column", "unit", "scale"}:
        raise InputError("mapping: time has column, unit and scale; a delay is that of a channel")
    column = column_of(f"mapping: column of {name}", given["column"])
    return ChannelMap(column, str(given["unit"]), sign, **{k: float(v) for k, v in numbers.items()})


def column_of(what: str, given: object) -> str:
    """Read the heading of a column, or its number; refused is what yaml makes of yes, off, null without quotes."""
    if isinstance(given, bool) or not isinstance(given, str | int | float):
        raise InputError(f'{what} is {given!r}; write its heading, in quotation marks where yaml has a meaning: "yes"')
    return str(given)


def check_once(what: str, columns: AnyMapping[str, ChannelMap]) -> None:
    """Refuse a column that is mapped to two things: what it holds can be one of them only."""
    named: dict[str, str] = {}
    for name, where in columns.items():
        other = named.setdefault(where.column, name)
        if other != name:
            raise InputError(
                f"{what}: {other} and {name} both name the column {where.column!r}; a column is one of them: mend or "
                "leave out the other"
            )


def sign_of(what: str, given: object) -> int:
    """Read a sign, 1 or -1."""
    if isinstance(given, bool) or not isinstance(given, int | float) or abs(given) != 1:
        raise InputError(f"{what} is {given!r}; write 1 or -1")
    return int(given)


def is_number(value: object) -> bool:
    """Tell finite numbers from words and from true and false."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < float("inf")


def _check_unit(name: str, where: ChannelMap, record: bool = False) -> None:
    """Refuse a unit that does not measure this quantity."""
    quantity = QUANTITY.get(name, "time")
    check_choice(f"mapping: unit of {name} ({quantity})", where.unit, list(units_of(name, record)))


def _check_window(start: float | None, end: float | None) -> None:
    """Refuse a window that is none."""
    for key, value in (("start", start), ("end", end)):
        if value is not None and value < 0:
            raise InputError(f"mapping: {key}={value:g}; write seconds from the file's first sample on, 0 or more")
    if start is not None and end is not None and not start < end:
        raise InputError(f"mapping: start={start:g} and end={end:g}; the record must end after it starts")


def _check_drift(drift: object) -> None:
    """Refuse a drift that is neither a word nor a velocity."""
    if isinstance(drift, AnyMapping):
        right = set(drift) == {"speed", "toward_deg"} and all(map(is_number, drift.values()))
    else:
        right = isinstance(drift, str) and drift in {"keep", "arcs"}
    if not right:
        raise InputError(f"mapping: drift={drift!r}; write {WANTED['drift']}")


def _check_zone(zone: str | None, unit: str) -> None:
    """Refuse a time zone that is unknown, or that says nothing."""
    if zone is None:
        return
    if unit not in STAMPS:
        raise InputError(f"mapping: time_zone={zone} goes with time stamps (unit: iso); the unit of time is {unit}")
    try:
        ZoneInfo(zone)
    except (ValueError, OSError, KeyError):
        raise InputError(f"mapping: time_zone={zone!r} is unknown; write for instance UTC or Asia/Tokyo") from None


def _check_complete(given: set[str], optional: bool) -> None:
    """Refuse a mapping that lacks a channel which nothing replaces, or gives one twice."""
    lacking = [k for k in REQUIRED if k not in given]
    if not any(set(pair) <= given for pair in PAIRS):
        lacking.append("u and v (or x and y, lat and lon, sog and cog)")
    if lacking:
        raise InputError(
            f"mapping: channels has no {', '.join(lacking)}; it has: {', '.join(sorted(given)) or 'none'}: write "
            "e.g. psi: {column: heading_deg, unit: deg} under channels"
        )
    for one, other in PAIRS:
        if (one in given) != (other in given):
            there, gone = (one, other) if one in given else (other, one)
            hint = "; a speed log alone is u_log" if there == "u" else ""
            raise InputError(f"mapping: channels has {there} without {gone}: add {gone}, or leave {there} out{hint}")
    for pair, same in () if optional else ((("x", "y"), ("lat", "lon")), (("u", "v"), ("sog", "cog"))):
        if {*pair, *same} <= given:
            raise InputError(f"mapping: {' and '.join(pair)} say what {' and '.join(same)} say: leave one pair out")
