"""Measured faults of the sensors as findings: in words, with the setting of the mapping that takes each away."""

from typing import Any

from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.ship import Particulars
from manoeuvre_nn.recording.check.finding import LEAVE_OUT, Change, Finding, number
from manoeuvre_nn.recording.check.sensor_faults import Measured, measure_faults
from manoeuvre_nn.recording.read.mapping import Mapping

SENSORS = {"u, v": ("u", "v", "sog", "cog"), "x, y": ("x", "y", "lat", "lon"), "r": ("r",), "psi": ("psi",)}
"""Sensor -> columns that it may come in."""
MIN_NOTED_SIGMAS = 3.0
"""Standard errors from which on a fault is told that is not taken for real."""
MAX_RIVALS = 3
"""Most other explanations that are named."""
NO_TRACK = tuple(Change(f"channels.{k}", value=LEAVE_OUT) for k in SENSORS["x, y"])


def fault_findings(recording: Recording, ship: Particulars, mapping: Mapping | None = None) -> list[Finding]:
    """Delays, offsets, scales and the point of the sensors.

    Args:
        recording: The recording, without outliers.
        ship: The ship.
        mapping: The mapping that it was read with, for what its columns are.

    Returns:
        One finding a fault that the channels could show.
    """
    return [_finding(one, recording, mapping) for one in measure_faults(recording, ship)]


def _finding(one: Measured, recording: Recording, mapping: Mapping | None) -> Finding:
    """One fault in words."""
    shown, fault = one.fault.shown, one.fault
    said: dict[str, Any] = {
        "measured": one.size / shown,
        "error": one.size_error / shown,
        "unit": fault.unit,
        "expected": f"below {fault.matters / shown:.2g} {fault.unit}",
    }
    channels = _channels(fault.name)
    if not one.found:
        if abs(one.size) > max(MIN_NOTED_SIGMAS * one.size_error, fault.matters):
            text = (
                f"{fault.name}: perhaps {number(one.size / shown, one.size_error / shown, fault.unit)}; another record "
            )
            return Finding(fault.name, "note", text + "must tell", channels, **said)
        known = 2 * one.size_error < fault.matters
        text = f"{fault.name}: {'none' if known else 'this record cannot tell'}"
        return Finding(fault.name, "ok", text, channels, **said)
    text = _words(one)
    if one.rivals:
        more = " ..." if len(one.rivals) > MAX_RIVALS else ""
        text += f" (or: {', '.join(one.rivals[:MAX_RIVALS])}{more}; this record cannot tell them apart)"
    if abs(one.size) < fault.matters:
        return Finding(fault.name, "note", text, channels, **said)
    remedy, changes = _remedy(one, mapping)
    return Finding(fault.name, "mend", text, channels, remedy=remedy, changes=changes, **said)


def _channels(name: str) -> tuple[str, ...]:
    """Channels that a fault is about."""
    if name == "current":
        return ("u", "v")
    sensor = name.removesuffix(" abeam").split(" of ")[1]
    return tuple(sensor.split(", "))


def _words(one: Measured) -> str:
    """What is wrong, with its error."""
    shown, unit, name = one.fault.shown, one.fault.unit, one.fault.name
    size = number(abs(one.size) / shown, one.size_error / shown, unit)
    kind, _, sensor = name.partition(" of ")
    more = one.value[0] > 0
    if kind == "delay":
        return f"{sensor}: written down {size} too {'late' if more else 'early'}"
    if kind == "scale":
        return f"{sensor} shows {size} too {'little' if more else 'much'}"
    if kind == "offset":
        return f"{sensor} shows {size} too {'much' if more else 'little'}"
    if name == "current":
        north, east = one.value
        return (
            f"u, v and the track differ by {size} that does not turn with the ship ({north:.2g}, {east:.2g}): a current"
        )
    side = ("ahead" if more else "aft") if name == "point of x, y" else ("to starboard" if more else "to port")
    return f"x, y are of a point {size} {side} of that of u, v"


def _remedy(one: Measured, mapping: Mapping | None) -> tuple[str, tuple[Change, ...]]:
    """What takes the fault away."""
    name, value = one.fault.name, one.size
    kind, _, sensor = name.partition(" of ")
    turned = mapping is not None and mapping.frame == "earth" and sensor in {"u", "v"}
    if kind == "delay":
        return f"move {sensor} back", tuple(Change(f"channels.{k}.delay", "delay", value) for k in SENSORS[sensor])
    if kind in {"scale", "offset"} and not turned and (mapping is None or sensor in mapping.channels):
        factor = 1 + value if kind == "scale" else value
        return f"take it out of {sensor}", (Change(f"channels.{sensor}.{kind}", kind, factor),)  # type: ignore[arg-type]
    if kind in {"scale", "offset"}:
        without = tuple(Change(f"channels.{k}", value=LEAVE_OUT) for k in SENSORS["u, v"])
        return "leave u and v out of the mapping, they then follow from the track", without
    if name == "point of x, y":
        return "carry x and y to the point of u and v", (Change("position_point", "add", value),)
    if name == "current":
        more = "(were they over ground, x and y would drift)"
        return f"u and v are through the water: leave x and y out of the mapping {more}", NO_TRACK
    return "leave x and y out of the mapping, the track then follows from u and v", NO_TRACK
