"""Catalogue of what can be drawn: family, place, rivals that count as equal, and how one number sets the size."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from studies.concealed_trial import unmodelled
from studies.concealed_trial.ships import TrialShip

NOISE = {
    "position_m": 0.7,
    "gps_velocity_m_s": 0.04,
    "heading_deg": 0.1,
    "yaw_rate_deg_s": 0.02,
    "log_m_s": 0.05,
    "rudder_deg": 0.1,
    "rpm": 0.1,
}
"""Nominal standard deviations of the sensors' noise, as in the manifests."""

Extras = dict[str, float]
Make = Callable[[TrialShip, float, Extras], dict[str, float]]
RUDDER = (("actuator:rudder",), ("sensor:delta",), ("Y", "N"), ("X", "Y", "N"))
HULL = (("X", "Y", "N"),)
UNKNOWN = "unknown"


@dataclass(frozen=True)
class Kind:
    """One kind of effect.

    Attributes:
        name: As in the recordings' format.
        family: Family for scores.
        accepted: Places that count as right; the first is the place.
        low: Smallest sensible size.
        high: Largest size that is possible at sea; what keeps the ship in her range may be less.
        make: Parameters from the ship, the size and what is drawn besides.
        extras: What is drawn besides: name and range; ``sign`` is -1 or 1.
        equivalent: Names that count as equal.
        confined: ``""``, ``interval`` or ``onset``.
        per_unit: For sensors, error in standard deviations of the channel's noise at size 1.
        ships: Ships on which the effect is sensible; all if empty.
        detail: Name of an unmodelled effect.
    """

    name: str
    family: str
    accepted: tuple[tuple[str, ...], ...]
    low: float
    high: float
    make: Make
    extras: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    equivalent: tuple[str, ...] = ()
    confined: str = ""
    per_unit: Callable[[TrialShip], float] | None = None
    ships: tuple[str, ...] = ()
    detail: str | None = None


def _plain(name: str, signed: bool = False) -> Make:
    """The size is the parameter."""
    return lambda ship, s, extra: {name: s * (extra["sign"] if signed else 1.0)}


def _force(name: str = "force_kN", of: str = "unit", lever: bool = False) -> Make:
    """The size is a force over 0.5 rho L T U0^2, or over the resistance."""

    def make(ship: TrialShip, s: float, extra: Extras) -> dict[str, float]:
        unit = ship.force_unit if of == "unit" else ship.resistance
        parameters = {name: 1e-3 * s * unit * extra.get("sign", 1.0)}
        return parameters | ({"lever_m": extra["lever"] * ship.length} if lever else {})

    return make


def _from(ship: TrialShip, s: float, extra: Extras) -> dict[str, float]:
    """Wind: the size is its speed."""
    return {"speed": s, "from_deg": extra["angle"]}


def _gusty(ship: TrialShip, s: float, extra: Extras) -> dict[str, float]:
    """Wind with gusts in proportion."""
    return {"speed": s, "from_deg": extra["angle"], "gust_sd": s * extra["gustiness"]}


def _lever(ship: TrialShip, s: float, extra: Extras) -> dict[str, float]:
    """Antenna on the ship."""
    angle = np.radians(extra["angle"])
    across = float(np.clip(s * np.sin(angle), -0.5 * ship.beam, 0.5 * ship.beam))
    ahead = float(np.clip(s * np.cos(angle), -0.5 * ship.length, 0.5 * ship.length))
    return {"dx_m": ahead, "dy_m": across}


def _slow(ship: TrialShip, s: float, extra: Extras) -> dict[str, float]:
    """The nominal rate over 1 + s."""
    return {"rate_deg_s": float(np.degrees(ship.rate)) / (1 + s)}


def _factor(ship: TrialShip, s: float, extra: Extras) -> dict[str, float]:
    """1 plus or minus the size."""
    return {"factor": 1 + s * extra["sign"]}


SIGN, ANGLE = {"sign": (-1.0, 1.0)}, {"angle": (0.0, 360.0)}

KINDS: tuple[Kind, ...] = (
    Kind("wind_steady", "wind and waves", HULL, 2.0, 40.0, _from, ANGLE),
    Kind("wind_gusty", "wind and waves", HULL, 2.0, 40.0, _gusty, ANGLE | {"gustiness": (0.12, 0.22)}),
    Kind("wind_onset", "wind and waves", HULL, 2.0, 40.0, _from, ANGLE, confined="onset"),
    Kind("wave_drift", "wind and waves", HULL, 0.7, 14.0, lambda h, s, e: {"Hs": s, "from_deg": e["angle"]}, ANGLE),
    Kind(
        "current",
        "current",
        (("kinematics",),),
        0.02,
        4.0,
        lambda h, s, e: {"speed": s, "toward_deg": e["angle"]},
        ANGLE,
    ),
    Kind(
        "shallow_water",
        "depth",
        (("X", "Y", "N"), ("Y", "N")),
        0.05,
        5.0,
        lambda h, s, e: {"depth_m": h.draught * (1 + 1 / s)},
    ),
    Kind(
        "rudder_offset",
        "rudder",
        RUDDER,
        0.05,
        10.0,
        _plain("offset_deg", True),
        SIGN,
        equivalent=("propeller_side_force",),
    ),
    Kind("rudder_backlash", "rudder", RUDDER, 0.3, 20.0, _plain("width_deg")),
    Kind("rudder_slow", "rudder", RUDDER, 0.05, 20.0, _slow),
    Kind("rudder_delay", "rudder", RUDDER, 0.2, 30.0, _plain("delay_s")),
    Kind("rudder_area_loss", "rudder", RUDDER, 0.01, 0.8, _plain("fraction")),
    Kind(
        "propeller_side_force",
        "propeller and resistance",
        (("Y", "N"), ("X", "Y", "N"), ("actuator:propeller",)),
        1e-4,
        0.03,
        _force(),
        SIGN,
        equivalent=("rudder_offset",),
    ),
    Kind(
        "propeller_pitch_error",
        "propeller and resistance",
        (("X",), ("actuator:propeller",), ("X", "actuator:propeller"), ("X", "Y", "N")),
        0.01,
        0.6,
        _plain("fraction", True),
        SIGN,
    ),
    Kind(
        "power_limit",
        "propeller and resistance",
        (("X",), ("actuator:propeller",), ("X", "actuator:propeller"), ("X", "Y", "N")),
        0.03,
        1.0,
        _plain("rpm_slope"),
    ),
    Kind("hull_fouling", "propeller and resistance", (("X",),), 0.01, 2.0, _plain("added_resistance")),
    Kind("ice_resistance", "propeller and resistance", (("X",),), 0.01, 1.0, _force(of="resistance")),
    Kind("displacement_change", "ship condition", (("X", "Y", "N"), ("Y", "N")), 0.01, 0.45, _factor, SIGN),
    Kind("trim_change", "ship condition", (("Y", "N"), ("X", "Y", "N")), 0.05, 5.0, _plain("trim_m")),
    Kind("roll_coupling", "roll", (("N",),), 5e-4, 0.3, _plain("N_phi", True), SIGN, ships=("mariner",)),
    Kind(
        "side_force",
        "local force",
        (("Y", "N"),),
        5e-4,
        0.1,
        _force(lever=True),
        SIGN | {"lever": (-0.25, 0.25)},
        confined="interval",
    ),
    Kind(
        "bow_thruster",
        "local force",
        (("Y", "N"),),
        2e-4,
        0.06,
        _force(),
        SIGN,
        equivalent=("side_force",),
        confined="interval",
    ),
    Kind(
        "heading_bias",
        "sensors",
        (("sensor:psi",),),
        0.2,
        30.0,
        _plain("bias_deg", True),
        SIGN,
        per_unit=lambda h: 1 / NOISE["heading_deg"],
    ),
    Kind(
        "rate_bias",
        "sensors",
        (("sensor:r",),),
        0.03,
        3.0,
        _plain("bias_deg_s", True),
        SIGN,
        per_unit=lambda h: 1 / NOISE["yaw_rate_deg_s"],
    ),
    Kind(
        "log_scale",
        "sensors",
        (("sensor:u_log",),),
        0.01,
        0.6,
        _factor,
        SIGN,
        per_unit=lambda h: h.speed / NOISE["log_m_s"],
    ),
    Kind(
        "gps_lever_arm",
        "sensors",
        (
            ("sensor:x_north", "sensor:y_east"),
            ("sensor:x_north", "sensor:y_east", "sensor:u", "sensor:v"),
            ("sensor:x_north",),
            ("sensor:gps",),
            ("kinematics",),
        ),
        1.5,
        170.0,
        _lever,
        ANGLE,
        per_unit=lambda h: 1 / NOISE["position_m"],
    ),
)
"""All names of the format's list but ``unknown``."""


def _unlisted(detail: str, low: float, high: float, **extras: tuple[float, float]) -> Kind:
    """A force or rudder of our own; the size is ``a``."""
    place = unmodelled.FORCES[detail][0] if detail in unmodelled.FORCES else "actuator:rudder"
    accepted = RUDDER if detail in unmodelled.RUDDERS else ((place,),)

    def make(ship: TrialShip, s: float, extra: Extras) -> dict[str, float]:
        others = {k: v for k, v in extra.items() if k != "sign"}
        if "spacing" in others:
            others["spacing_m"] = others.pop("spacing") * ship.length
        return {"a": s * extra.get("sign", 1.0)} | others

    return Kind(UNKNOWN, UNKNOWN, accepted, low, high, make, extras, detail=detail)


def _unlisted_sensor(
    detail: str, low: float, high: float, per_unit: Callable[[TrialShip], float], extras: Mapping = ANGLE
) -> Kind:
    """A sensor error of our own; the size is ``a``."""

    def make(ship: TrialShip, s: float, extra: Extras) -> dict[str, float]:
        parameters = {"a": s * extra.get("sign", 1.0)}
        return parameters | ({"direction_deg": extra["angle"]} if "angle" in extra else {})

    place = (unmodelled.SENSORS[detail],)
    accepted = (place, ("sensor:x_north", "sensor:y_east")) if place == ("sensor:x_north",) else (place,)
    return Kind(UNKNOWN, UNKNOWN, accepted, low, high, make, extras, per_unit=per_unit, detail=detail)


UNMODELLED: tuple[Kind, ...] = (
    _unlisted("cubic_by_heading", 0.003, 3.0, **SIGN),
    _unlisted("lopsided_turn", 2e-4, 0.15, **SIGN),
    _unlisted("beat", 2e-4, 0.1, period_s=(25.0, 90.0)),
    _unlisted("turn_drag", 5e-4, 0.3),
    _unlisted("by_speed", 0.001, 0.3, **SIGN),
    _unlisted("striped_water", 2e-4, 0.15, stripes_deg=(0.0, 180.0), spacing=(4.0, 9.0)),
    _unlisted("damped_drift", 0.002, 1.5, **SIGN),
    _unlisted("sway_beat", 2e-4, 0.3, period_s=(50.0, 240.0)),
    _unlisted("late_turn", 2e-4, 0.1, lag_s=(20.0, 120.0), **SIGN),
    _unlisted("growing_push", 2e-4, 0.1, **SIGN),
    _unlisted("growing_drag", 2e-4, 0.1),
    _unlisted("random_push", 5e-4, 0.3, tau_s=(10.0, 120.0), chance=(0.0, 9999.0)),
    _unlisted("random_moment", 2e-4, 0.1, tau_s=(10.0, 120.0), chance=(0.0, 9999.0)),
    _unlisted("rudder_hole", 0.05, 0.9),
    _unlisted("weak_to_port", 0.02, 0.6),
    _unlisted_sensor("compass_two_beats", 0.3, 25.0, lambda h: 0.7 / NOISE["heading_deg"]),
    _unlisted_sensor("log_by_heading", 0.02, 0.6, lambda h: 0.7 * h.speed / NOISE["log_m_s"]),
    _unlisted_sensor("position_runs_away", 5e-6, 3e-3, lambda h: 0.45 * 600**2 / NOISE["position_m"]),
    _unlisted_sensor("rate_scale", 0.05, 0.9, lambda h: 0.5 / NOISE["yaw_rate_deg_s"], SIGN),
)
"""Effects that no list holds."""

NAMES = (*(kind.name for kind in KINDS), UNKNOWN)
FAMILY = {kind.name: kind.family for kind in KINDS} | {UNKNOWN: UNKNOWN}
EQUIVALENT = {kind.name: kind.equivalent for kind in KINDS} | {UNKNOWN: ()}
ANGLES = ("from_deg", "toward_deg")
"""Parameters that are directions."""


def kind_of(name: str, detail: str | None = None) -> Kind:
    """The kind of a name.

    Args:
        name: As in the format.
        detail: Which unmodelled effect.

    Returns:
        Its entry in the catalogue.
    """
    table = UNMODELLED if name == UNKNOWN else KINDS
    return next(kind for kind in table if (kind.detail == detail if name == UNKNOWN else kind.name == name))
