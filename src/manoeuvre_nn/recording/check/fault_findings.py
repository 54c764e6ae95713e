"""Measured faults of the sensors as findings: in words, with the setting of the mapping that takes each away."""

from functools import partial

from manoeuvre_nn.recording.check.finding import LEAVE_OUT, Change, Finding, number
from manoeuvre_nn.recording.check.sensor_faults import Fault
from manoeuvre_nn.recording.read.mapping import Mapping

SENSORS = {"u, v": ("u", "v", "sog", "cog"), "x, y": ("x", "y", "lat", "lon"), "r": ("r",), "psi": ("psi",)}
"""Sensor -> columns that it may come in."""
MIN_NOTED_SIGMAS = 3.0
"""Standard errors from which on a fault is told that is not taken for real."""
MAX_RIVALS = 3
"""Most other explanations that are named."""


def fault_finding(fault: Fault, mapping: Mapping | None = None) -> Finding:
    """A measured fault in words; the mapping that the recording was read with says what its columns are."""
    name, size, error = fault.name, fault.size / fault.shown, fault.size_error / fault.shown
    sensor = name.removesuffix(" abeam").partition(" of ")[2] or "u, v"
    found = partial(
        Finding, name, channels=tuple(sensor.split(", ")), measured=size, error=error, unit=fault.unit,
        expected=f"below {fault.matters / fault.shown:.2g} {fault.unit}",
    )  # fmt: skip
    if not fault.found:
        if abs(fault.size) > max(MIN_NOTED_SIGMAS * fault.size_error, fault.matters):
            return found("note", f"{name}: perhaps {number(size, error, fault.unit)}; another record must tell")
        known = 2 * fault.size_error < fault.matters
        return found("ok", f"{name}: {'none' if known else 'this record cannot tell'}")
    text = _words(fault, sensor)
    if fault.rivals:
        more = " ..." if len(fault.rivals) > MAX_RIVALS else ""
        text += f" (or: {', '.join(fault.rivals[:MAX_RIVALS])}{more}; this record cannot tell them apart)"
    if abs(fault.size) < fault.matters:
        return found("note", text)
    remedy, changes = _remedy(fault, sensor, mapping)
    return found("mend", text, remedy=remedy, changes=changes)


def _words(fault: Fault, sensor: str) -> str:
    """What is wrong, with its error."""
    size = number(abs(fault.size) / fault.shown, fault.size_error / fault.shown, fault.unit)
    more = fault.value[0] > 0
    match fault.name.split()[0]:
        case "delay":
            return f"{sensor}: written down {size} too {'late' if more else 'early'}"
        case "scale":
            return f"{sensor} shows {size} too {'little' if more else 'much'}"
        case "offset":
            return f"{sensor} shows {size} too {'much' if more else 'little'}"
        case "current":
            north, east = (f"{v:.2g}" for v in fault.value)
            return f"u, v and the track differ by {size} that does not turn with the ship ({north}, {east}): a current"
    ahead = "ahead" if more else "aft"
    side = ahead if fault.name == "point of x, y" else "to starboard" if more else "to port"
    return f"x, y are of a point {size} {side} of that of u, v"


def _remedy(fault: Fault, sensor: str, mapping: Mapping | None) -> tuple[str, tuple[Change, ...]]:
    """What takes the fault away."""
    name, value, kind = fault.name, fault.size, fault.name.split()[0]
    if kind == "delay":
        return f"move {sensor} back", tuple(Change(f"channels.{k}.delay", "delay", value) for k in SENSORS[sensor])
    turned = mapping is not None and mapping.frame == "earth" and sensor in {"u", "v"}
    if kind in {"scale", "offset"} and not turned and (mapping is None or sensor in mapping.channels):
        factor = 1 + value if kind == "scale" else value
        return f"take it out of {sensor}", (Change(f"channels.{sensor}.{kind}", kind, factor),)  # type: ignore[arg-type]
    if kind in {"scale", "offset"}:
        return "leave u and v out of the mapping, they then follow from the track", _without("u, v")
    if name == "point of x, y":
        return "carry x and y to the point of u and v", (Change("position_point", "add", value),)
    if name == "current":
        more = "(were they over ground, x and y would drift)"
        return f"u and v are through the water: leave x and y out of the mapping {more}", _without("x, y")
    return "leave x and y out of the mapping, the track then follows from u and v", _without("x, y")


def _without(sensor: str) -> tuple[Change, ...]:
    """A sensor left out of the mapping."""
    return tuple(Change(f"channels.{k}", value=LEAVE_OUT) for k in SENSORS[sensor])
