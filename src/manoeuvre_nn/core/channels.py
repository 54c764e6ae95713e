"""Channels of a recording: what each means, its unit and whether it comes round. Declared here and nowhere else."""

from dataclasses import dataclass


@dataclass(frozen=True)
class _Channel:
    """One quantity over time.

    Attributes:
        name: Key in a recording.
        unit: Unit inside the package.
        meaning: What it is, with its sign.
        periodic: Whether it is an angle that comes round; recordings hold such angles continuous.
        offset: Prior standard deviation of a constant sensor error, over U0, U0/L, L or 1 rad as its quantity asks;
            None if no constant error is fitted.
    """

    name: str
    unit: str
    meaning: str
    periodic: bool = False
    offset: float | None = None


DECLARED = (
    _Channel("t", "s", "time"),
    _Channel("u", "m/s", "speed along the ship, positive forward", offset=0.02),
    _Channel("v", "m/s", "speed across the ship, positive to starboard", offset=0.02),
    _Channel("r", "rad/s", "rate of turn, positive to starboard", offset=0.02),
    _Channel("x", "m", "position north", offset=0.1),
    _Channel("y", "m", "position east", offset=0.1),
    _Channel("psi", "rad", "heading, clockwise from north", periodic=True, offset=0.02),
    _Channel("delta", "rad", "rudder angle, of two rudders their mean, positive turns the ship to starboard"),
    _Channel("delta_starboard", "rad", "angle of the starboard rudder of two"),
    _Channel("delta_port", "rad", "angle of the port rudder of two"),
    _Channel("delta_order", "rad", "helm order, signed as the rudder angle"),
    _Channel("order_lead", "-", "share of the step before a sample during which a new helm order was in force"),
    _Channel("udot", "m/s^2", "acceleration along the ship"),
    _Channel("vdot", "m/s^2", "acceleration across the ship"),
    _Channel("rdot", "rad/s^2", "yaw acceleration"),
    _Channel("pdot", "rad/s^2", "roll acceleration"),
    _Channel("n", "1/s", "shaft speed, of two shafts their mean"),
    _Channel("n_starboard", "1/s", "speed of the starboard shaft of two"),
    _Channel("n_port", "1/s", "speed of the port shaft of two"),
    _Channel("shaft", "-", "shaft speed over the nominal one, as it drives the ship"),
    _Channel("shaft_recorded", "-", "shaft speed over the nominal one, as the tachometer shows it"),
    _Channel("vn", "m/s", "velocity over ground, north"),
    _Channel("ve", "m/s", "velocity over ground, east"),
    _Channel("u_log", "m/s", "speed through the water by the log"),
    _Channel("sog", "m/s", "speed over ground"),
    _Channel("cog", "rad", "course over ground, clockwise from north", periodic=True),
    _Channel("lat", "rad", "latitude, positive north"),
    _Channel("lon", "rad", "longitude, positive east", periodic=True),
    _Channel("phi", "rad", "roll angle, positive to starboard"),
    _Channel("theta", "rad", "pitch angle, positive bow up"),
    _Channel("p", "rad/s", "roll rate, positive to starboard"),
    _Channel("w", "m/s", "heave velocity, positive down"),
    _Channel("q", "rad/s", "pitch rate, positive bow up"),
    _Channel("thrust", "N", "propeller thrust"),
    _Channel("torque", "N m", "propeller torque"),
    _Channel("wind_speed", "m/s", "true wind speed"),
    _Channel("wind_from", "rad", "direction that the true wind comes from, clockwise from north", periodic=True),
    _Channel("wind_speed_relative", "m/s", "wind speed relative to the ship"),
    _Channel("wind_from_relative", "rad", "direction that the relative wind comes from, from the bow", periodic=True),
)
"""All channels that the package knows; a recording may hold others, which are kept as they come."""
CHANNELS = {channel.name: channel for channel in DECLARED}
SMOOTHED = ("u", "v", "r", "x", "y", "psi", "udot", "vdot", "rdot")
"""Channels whose standard deviation a smoother states, as ``<name>_sd``."""
UNITS = {c.name: c.unit for c in DECLARED} | {f"{name}_sd": CHANNELS[name].unit for name in SMOOTHED}
"""Unit of every channel that the package knows."""
PERIODIC = tuple(c.name for c in DECLARED if c.periodic)
"""Angles that come round: recordings hold them continuous, so that nothing is interpolated across a jump."""
MOTION = ("u", "v", "r", "x", "y", "psi", "delta")
"""Channels that a manoeuvre is judged by."""
ACCELERATION = ("udot", "vdot", "rdot")
"""Channels of known accelerations; only simulations have them."""
MEASURED = ("x", "y", "vn", "ve", "psi", "r", "u_log", "shaft_recorded")
"""Channels that a diagnosis compares with a model, in the order of its matrices."""
