"""A simulated zigzag as other programs would have written it: names, units, signs and axes of all kinds."""

from collections.abc import Callable

import numpy as np

from manoeuvre_nn.core.frames import body_to_earth
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE, KNOT

D, Table = 1 / DEGREE, dict[str, np.ndarray]


def plain(run: Recording) -> Table:
    return {"t": run.time, **{k: run[k] for k in ("u", "v", "r", "x", "y", "psi", "delta")}}


def wrapped(angle: np.ndarray, lowest: float = 0.0) -> np.ndarray:
    return np.mod(angle * D - lowest, 360.0) + lowest


def gps(run: Recording) -> Table:
    north, east = body_to_earth(run["u"], run["v"], run["psi"])
    return {
        "UTC time": np.array([f"2020-07-31T12:{int(t) // 60:02d}:{int(t) % 60:02d}" for t in run.time]),
        "Latitude": 43.0 + run["x"] / 111109.0, "Longitude": 5.0 + run["y"] / 81541.0,
        "SOG": np.hypot(north, east) / KNOT, "COG": np.mod(np.arctan2(east, north) * D, 360),
        "HDG": wrapped(run["psi"]), "ROT (deg/min)": run["r"] * D * 60, "Rudder Angle": -run["delta"] * D,
    }  # fmt: skip


def math(run: Recording) -> Table:
    """x east, y north, heading counterclockwise from east, rates too."""
    return {
        "time": run.time, "east": run["y"], "north": run["x"], "yaw": np.pi / 2 - run["psi"], "yaw_rate": -run["r"],
        "surge": run["u"], "sway": -run["v"], "rudder": run["delta"],
    }  # fmt: skip


def earth(run: Recording, east_first: bool = False) -> Table:
    north, east = body_to_earth(run["u"], run["v"], run["psi"])
    pair = {"vx": east, "vy": north} if east_first else {"vx": north, "vy": east}
    place = {"x": run["y"], "y": run["x"]} if east_first else {"x": run["x"], "y": run["y"]}
    return {"t": run.time, **place, "heading": wrapped(run["psi"]), "rot": run["r"] * D, **pair, "rudder": run["delta"]}


def changed(**changes: Callable[[np.ndarray], np.ndarray]) -> Callable[[Recording], Table]:
    return lambda run: {k: changes.get(k, np.asarray)(v) for k, v in plain(run).items()}


def renamed(names: str, **changes: Callable[[np.ndarray], np.ndarray]) -> Callable[[Recording], Table]:
    return lambda run: dict(zip(names.split(";"), changed(**changes)(run).values(), strict=True))


def forward(metres: float) -> Callable[[Recording], Table]:
    """Positions of an antenna forward of midship."""

    def write(run: Recording) -> Table:
        north, east = body_to_earth(np.full(len(run), metres), np.zeros(len(run)), run["psi"])
        return plain(run) | {"x": run["x"] + north, "y": run["y"] + east}

    return write


def without(*names: str, of: Callable[[Recording], Table] = plain) -> Callable[[Recording], Table]:
    return lambda run: {k: v for k, v in of(run).items() if k not in names}


EXPORTS: dict[str, Callable[[Recording], Table]] = {
    "as it is": plain,
    "degrees": changed(psi=lambda a: a * D, r=lambda a: a * D, delta=lambda a: a * D),
    "heading 0 to 360": changed(psi=wrapped, r=lambda a: a * D * 60, delta=lambda a: a * D),
    "heading -180 to 180": changed(psi=lambda a: wrapped(a, -180)),
    "axes of a basin": changed(psi=lambda a: wrapped(a + 0.65)),
    "degrees and radians": changed(psi=lambda a: a * D, delta=lambda a: -a * D),
    "knots": changed(u=lambda a: a / KNOT, v=lambda a: a / KNOT),
    "km/h and feet": changed(u=lambda a: a * 3.6, v=lambda a: a * 3.6, x=lambda a: a / 0.3048, y=lambda a: a / 0.3048),
    "milliseconds": changed(t=lambda a: a * 1000),
    "minutes": changed(t=lambda a: a / 60, r=lambda a: a * D, psi=wrapped),
    "sway to port": changed(v=np.negative),
    "west": changed(y=np.negative),
    "rate to port": changed(r=np.negative),
    "rudder to port": changed(delta=lambda a: -a * D),
    "heading to port": changed(psi=np.negative),
    "heading and rate to port": changed(psi=np.negative, r=np.negative),
    "astern": changed(u=np.negative),
    "all at once": changed(u=lambda a: -a / KNOT, v=lambda a: a / KNOT, r=lambda a: -a * D, psi=wrapped, x=np.negative),
    "heading from east": changed(psi=lambda a: a - np.pi / 2),
    "heading from south": changed(psi=lambda a: wrapped(a + np.pi), r=lambda a: a * D),
    "x and y exchanged": lambda run: plain(run) | {"x": run["y"], "y": run["x"]},
    "u and v exchanged": lambda run: plain(run) | {"u": run["v"], "v": run["u"]},
    "both exchanged": lambda run: plain(run) | {"u": run["v"], "v": run["u"], "x": run["y"], "y": run["x"]},
    "gps": gps,
    "math": math,
    "earth": earth,
    "east first": lambda run: earth(run, east_first=True),
    "no rate": without("r"),
    "no rate, degrees": without("r", of=changed(psi=lambda a: a * D, delta=lambda a: a * D)),
    "no velocities": without("u", "v"),
    "no track": without("x", "y"),
    "no track, knots": without("x", "y", of=changed(u=lambda a: a / KNOT, v=lambda a: -a / KNOT, psi=wrapped)),
    "antenna": forward(40.0),
    "antenna aft": forward(-50.0),
    "long names": renamed(
        "Elapsed Time [s];Surge velocity (m/s);Sway velocity (m/s);Rate of turn [deg/s];North position [m];"
        "East position [m];Heading [deg];Rudder angle [deg]",
        r=lambda a: a * D, psi=wrapped, delta=lambda a: -a * D,
    ),
    "camels": renamed("timeStamp;surgeVel;swayVel;yawRate;posX;posY;yawAngle;rudderAngle", psi=lambda a: a * D),
    "suffixes": renamed(
        "time_ms;u_kn;v_kn;rot_degpm;x_ft;y_ft;hdg_deg;rud_deg", t=lambda a: a * 1000, u=lambda a: a / KNOT,
        v=lambda a: a / KNOT, r=lambda a: a * D * 60, x=lambda a: a / 0.3048, y=lambda a: a / 0.3048, psi=wrapped,
        delta=lambda a: a * D,
    ),
    "german": renamed("Zeit;vlong;vtrans;Drehrate;Northing;Easting;Kurs;Ruderlage", psi=wrapped, r=lambda a: a * D),
    "headings that lie": renamed(
        "t [s];u [kn];v [kn];r [rad/s];x;y;psi [rad];delta [rad]", psi=wrapped, r=lambda a: a * D, delta=lambda a: a * D
    ),
}  # fmt: skip
"""How it was exported -> the columns."""
