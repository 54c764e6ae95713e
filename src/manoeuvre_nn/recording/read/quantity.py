"""What the channels of a measured file are, and the units that they come in."""

import numpy as np
from jaxtyping import Bool, Float

from manoeuvre_nn.core.channels import DECLARED
from manoeuvre_nn.core.units import DEGREE, KNOT, RPM

COUNT = "count"
"""Unit of a channel whose scale nobody wrote down; only records of ``kind: record`` may have it."""
STAMPS = ("iso", "clock")
"""Units of time that are text: 2020-07-31T13:04:24.5 (or a column of date and time), and 13:04:24.5."""
UNITS: dict[str, dict[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "min": 60.0, "h": 3600.0, "d": 86400.0, **dict.fromkeys(STAMPS, 1.0)},
    "length": {"m": 1.0, "ft": 0.3048, "km": 1e3},
    "speed": {"m/s": 1.0, "kn": KNOT, "km/h": 1 / 3.6},
    "angle": {"rad": 1.0, "deg": DEGREE},
    "rate of turn": {"rad/s": 1.0, "deg/s": DEGREE, "deg/min": DEGREE / 60},
    "shaft speed": {"1/s": 1.0, "rpm": RPM},
    "force": {"N": 1.0, "kN": 1e3},
    "torque": {"N m": 1.0, "kN m": 1e3},
    "ratio": {"-": 1.0},
    "acceleration": {"m/s^2": 1.0},
    "yaw acceleration": {"rad/s^2": 1.0},
}
"""Quantity -> unit -> its value in SI."""
MEASURED_BY = {
    "m/s": "speed", "rad/s": "rate of turn", "m": "length", "rad": "angle", "1/s": "shaft speed", "N": "force",
    "N m": "torque", "-": "ratio", "m/s^2": "acceleration", "rad/s^2": "yaw acceleration",
}  # fmt: skip
"""Unit inside the package -> what it measures."""
QUANTITY = {c.name: MEASURED_BY[c.unit] for c in DECLARED if c.name != "t"}
"""Channels that a file may give, and what they measure."""
LIMITS = {"length": 2e7, "force": 1e12, "torque": 1e14}
"""Quantity -> what nothing on the water reaches, in SI: of positions half the way round the Earth from the median."""
LIMIT = 1e6
"""The same of all other quantities; also beyond the 9999 and 99999 by which loggers mark what is missing."""
PAIRS = (("u", "v"), ("x", "y"), ("lat", "lon"), ("sog", "cog"), ("vn", "ve"))
"""Where the ship is and how it moves: one pair is needed, half a pair is of no use."""


def beyond_all(channel: str, values: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Which values of a channel [SI] no ship and no instrument can mean; an empty one is none of them."""
    quantity = QUANTITY.get(channel, "")
    middle = np.nanmedian(values) if quantity == "length" else 0.0
    with np.errstate(invalid="ignore", over="ignore"):
        return np.abs(values - middle) > LIMITS.get(quantity, LIMIT)


def units_of(channel: str, record: bool = False) -> dict[str, float]:
    """Units that a channel, or ``time``, may come in, of a ``record`` counts too -> their values in SI."""
    known = UNITS["time" if channel == "time" else QUANTITY[channel]]
    return {**known, COUNT: 1.0} if record and channel != "time" else known
