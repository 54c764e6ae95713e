"""How a measured file's columns become channels: names, units, signs, axes."""

from collections.abc import Mapping as AnyMapping
from dataclasses import dataclass, field, fields
from typing import Any

from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.core.manoeuvre import side_sign
from manoeuvre_nn.core.units import DEGREE, KNOT, RPM

UNITS: dict[str, dict[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "min": 60.0},
    "length": {"m": 1.0, "ft": 0.3048},
    "speed": {"m/s": 1.0, "kn": KNOT, "km/h": 1 / 3.6},
    "angle": {"rad": 1.0, "deg": DEGREE},
    "rate of turn": {"rad/s": 1.0, "deg/s": DEGREE, "deg/min": DEGREE / 60},
    "shaft speed": {"1/s": 1.0, "rpm": RPM},
}
"""Quantity -> unit -> its value in SI."""
QUANTITY = {
    "u": "speed", "v": "speed", "r": "rate of turn", "x": "length", "y": "length", "psi": "angle",
    "delta": "angle", "delta_order": "angle", "n": "shaft speed",
}  # fmt: skip
"""Channels that a file may give, and what they measure."""
KINDS = ("zigzag", "turning_circle", "pull_out", "spiral", "straight", "random_rudder")
"""Kinds of manoeuvre that criteria know."""


@dataclass(frozen=True)
class ChannelMap:
    """Where one channel is found in a file.

    Attributes:
        column: The column's heading, or its number from 1 in a file without headings.
        unit: Its unit.
        sign: -1 turns the values round.
    """

    column: str
    unit: str
    sign: int = 1


@dataclass(frozen=True)
class Mapping:
    """A kind of file: columns, units, signs, axes.

    Attributes:
        time: The time column.
        channels: Channel (u v r x y psi delta, maybe n, delta_order) -> where it is. u and v may be left out where x
            and y are given and the reverse; r may be left out.
        frame: Axes of the columns given for u and v: ``body``, or ``earth`` for velocities north and east.
        reference_point: How far forward of midship the point lies whose u, v, x, y are given [m].
        rudder_positive_to: Side that a positive rudder angle of the file turns the ship to.
        delimiter: What parts the columns; ``whitespace`` for any run of blanks.
        header: Whether the first line names the columns.
        skip_rows: Lines before the headings, or before the data in a file without headings.
        fill_gaps: Whether up to 3 missing samples in a row are filled by a straight line.
        kind: Kind of manoeuvre; None guesses it from the rudder.
    """

    time: ChannelMap
    channels: AnyMapping[str, ChannelMap] = field(default_factory=dict)
    frame: str = "body"
    reference_point: float = 0.0
    rudder_positive_to: str = "starboard"
    delimiter: str = ","
    header: bool = True
    skip_rows: int = 0
    fill_gaps: bool = False
    kind: str | None = None

    def __post_init__(self) -> None:
        """Refuse what cannot be read.

        Raises:
            InputError: If a setting is unknown, or a channel is missing that nothing replaces.
        """
        _check_unit("time", "time", self.time)
        for name, channel in self.channels.items():
            check_choice("mapping: channel", name, list(QUANTITY))
            _check_unit(name, QUANTITY[name], channel)
        check_choice("mapping: frame", self.frame, ["body", "earth"])
        side_sign("mapping: rudder_positive_to", self.rudder_positive_to)
        if self.delimiter != "whitespace" and len(self.delimiter) != 1:
            raise InputError(f"mapping: delimiter={self.delimiter!r}; write one character, or whitespace")
        if self.kind is not None:
            check_choice("mapping: kind", self.kind, KINDS)
        lacking = [k for k in ("psi", "delta") if k not in self.channels]
        if not {"u", "v"} <= set(self.channels) and not {"x", "y"} <= set(self.channels):
            lacking.append("u and v (or x and y)")
        if lacking:
            raise InputError(
                f"mapping: channels has no {', '.join(lacking)}; it has: {', '.join(self.channels) or 'none'}: write "
                "e.g. psi: {column: heading_deg, unit: deg} under channels"
            )

    @property
    def columns(self) -> list[str]:
        """Columns that are read, time first."""
        return [self.time.column, *(c.column for c in self.channels.values())]

    def factor(self, channel: str) -> float:
        """What a column's numbers are multiplied by.

        Args:
            channel: ``time`` or a channel.

        Returns:
            Sign times the unit's value in SI; for the rudder also the sign of its side.
        """
        if channel == "time":
            return UNITS["time"][self.time.unit]
        where = self.channels[channel]
        side = side_sign("rudder_positive_to", self.rudder_positive_to) if channel.startswith("delta") else 1
        return where.sign * side * UNITS[QUANTITY[channel]][where.unit]


def mapping(**settings: Any) -> Mapping:
    """Read a mapping from a config.

    Args:
        settings: The keys of :class:`Mapping`; ``time`` and each of ``channels`` as ``{column: T, unit: s, sign: 1}``.

    Returns:
        The mapping.

    Raises:
        InputError: If a key is unknown or missing, or a value makes no sense.
    """
    given = {k: v for k, v in settings.items() if not k.startswith("_")}
    known = [f.name for f in fields(Mapping)]
    for key in given:
        check_choice("mapping: key", key, known)
    for key in ("time", "channels"):
        if not isinstance(given.get(key), AnyMapping):
            raise InputError(f"mapping: {key} is {given.get(key)!r}; write e.g. time: {{column: t, unit: s}}")
    time = _channel_map("time", given.pop("time"))
    channels = {str(k): _channel_map(str(k), v) for k, v in given.pop("channels").items()}
    for key, kind in (("reference_point", (int, float)), ("skip_rows", int), ("header", bool), ("fill_gaps", bool)):
        if key in given and (not isinstance(given[key], kind) or (kind is not bool and isinstance(given[key], bool))):
            wanted = {"reference_point": "metres, e.g. 0.0", "skip_rows": "a whole number, e.g. 0"}
            raise InputError(f"mapping: {key}={given[key]!r}; write {wanted.get(key, 'true or false')}")
    if "reference_point" in given:
        given["reference_point"] = float(given["reference_point"])
    return Mapping(time, channels, **given)


def _channel_map(name: str, given: object) -> ChannelMap:
    """One column's entry."""
    keys = [f.name for f in fields(ChannelMap)]
    if not isinstance(given, AnyMapping) or not {"column", "unit"} <= set(given):
        raise InputError(f"mapping: {name} is {given!r}; write {name}: {{column: HEADING, unit: UNIT}}")
    for key in given:
        check_choice(f"mapping: key of {name}", key, keys)
    if given.get("sign", 1) not in {1, -1} or isinstance(given.get("sign", 1), bool):
        raise InputError(f"mapping: sign of {name} is {given['sign']!r}; write 1 or -1")
    return ChannelMap(str(given["column"]), str(given["unit"]), int(given.get("sign", 1)))


def _check_unit(name: str, quantity: str, where: ChannelMap) -> None:
    """Refuse a unit that does not measure this quantity."""
    check_choice(f"mapping: unit of {name} ({quantity})", where.unit, list(UNITS[quantity]))
