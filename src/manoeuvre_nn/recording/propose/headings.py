"""What a column's heading says: the channel that it names and the unit that it states."""

import re
import unicodedata
from dataclasses import dataclass
from functools import lru_cache

from manoeuvre_nn.recording.read.quantity import units_of

UNIT_WORDS = {
    "s": "s sec secs second seconds sek", "ms": "ms msec millis", "min": "min mins minute minutes", "h": "h hours",
    "m": "m meter metre meters metres", "ft": "ft feet", "km": "km",
    "m/s": "m/s mps ms-1 m_s m/sec ms^-1 m.s-1", "kn": "kn kt kts knot knots kns", "km/h": "km/h kmh kph kmph",
    "rad": "rad rads radian radians", "deg": "deg degs degree degrees ° grad º",
    "rad/s": "rad/s radps rad_s rads-1 rad/sec rps_rad",
    "deg/s": "deg/s degps deg_s dps °/s º/s deg/sec degs-1 deg_per_s deg_per_sec degrees_per_second degrees/s",
    "deg/min": "deg/min °/min degpm dpm deg_min º/min deg_per_min degrees_per_minute degrees/min grad/min",
    "1/s": "1/s rps hz rev/s s-1", "rpm": "rpm u/min rev/min 1/min min-1", "N": "n newton", "kN": "kn_force",
    "N m": "nm n_m n.m n*m", "kN m": "knm kn_m", "count": "count counts raw adc lsb", "iso": "utc iso",
}  # fmt: skip
"""Unit -> how it is written, in small letters."""
SPELT_OUT = {"ä": "ae", "ö": "oe", "ü": "ue", "ß": "ss", "ø": "oe", "æ": "ae"}
SPELT_OUT |= {"ψ": "psi", "δ": "delta", "φ": "phi", "ϕ": "phi", "θ": "theta"}
"""Letters that are written otherwise in plain ones."""
_SPELT = {word: unit for unit, words in UNIT_WORDS.items() for word in words.split()}
WORDS: dict[str, str] = {
    "time": r"t time zeit temps tid tiempo time_?stamp stamp elapsed seconds sec clock date_?time datum date utc"
    r" (time|t)_.* .*_time .*_time_?stamp",
    "psi": r"psi (true_|gyro_|ship_|vessel_)?(heading|hdg|hdt|head)(_true|_gyro|_angle)? yaw(_angle)? kurs rumbo cap"
    r" (kreisel|steuer|rechtweisender_)kurs"
    r" compass kompass(_?kurs)? gyro psi_.* .*_psi .*heading.* .*hdg.* .*yaw_angle.* yaw_(mid|pos|position)",
    "r": r"r rot yaw_?rate rate_of_turn turn_?rate turning_rate wz omega_?z gz gyro_?z psi_?dot dpsi r_.* rot_.* .*_rot"
    r" .*yaw_?(rate|vel|velocity|speed).* .*rate_of_turn.* .*turn_rate.* drehrate (gier|wende|dreh)geschw(indigkeit)?",
    "u": r"u surge vx v_x surge_(vel|velocity|speed) u_.* .*_u vx_.* v_x_.* .*surge.* vlong v_long.* .*longitudinal.*"
    r" forward_speed .*speed_ahead.* (v_?)?laengs.* vn v_north north_vel.* vel_n(orth)? .*velocity_north.*",
    "v": r"v sway vy v_y sway_(vel|velocity|speed) v_.* .*_v vm vm_.* vy_.* v_y_.* .*sway.* vtrans v_trans.*"
    r" .*transverse.* .*lateral_(speed|vel.*) (v_?)?quer.* ve v_east east_vel.* vel_e(ast)? .*velocity_east.*",
    "x": r"x x_.* .*_x north northing pos_?x x_?pos.* .*north.* x0 xn n_pos pos_n",
    "y": r"y y_.* .*_y east easting pos_?y y_?pos.* .*east.* y0 ye e_pos pos_e",
    "delta": r"delta rudder rud rudder_angle rud_ang ruder(winkel|lage)? timon barre helm da delta_.* .*_delta"
    r" .*rudder.* .*_rud rud_.* ruderlage.* .*steering_angle.* rsa",
    "delta_order": r"delta_?(c|cmd|o|order|ord|set|ref|d|com|command|ordered|desired)"
    r" .*(rudder|rud|helm|delta).*(order|cmd|command|set|ref|demand|desired|soll).*"
    r" .*(order|cmd|command|set|demand|desired|commanded|ordered|soll).*(rudder|rud|helm|delta).*",
    "n": r"n rpm rps n_.* .*_rpm .*_rps rpm_.* rps_.* .*(shaft|propeller|prop|engine).*(speed|rpm|rps|rev|n).*"
    r" shaft revs? revolutions n_?prop.* (wellen|propeller)?drehzahl prop(eller)?",
    "lat": r"lat latitude .*_lat lat_.* .*latitude.* breite",
    "lon": r"lon lng long longitude .*_lon lon_.* .*longitude.* laenge",
    "sog": r"sog speed_over_ground .*_sog sog_.* gps_speed ground_?speed speed_?og vtg_speed fahrt_ueber_grund fueg",
    "cog": r"cog course_over_ground course .*_cog cog_.* gps_course track_?angle ground_course vtg_course track"
    r" kurs_ueber_grund kueg",
    "u_log": r"u_?log stw log log_speed speed_through_water speed_?log water_?speed stw_.* .*_stw"
    r" logge fahrt_durchs_wasser fdw",
    "phi": r"phi roll heel roll_angle phi_.* .*_phi roll_.* heel_.* .*roll_angle.* kraengung",
    "theta": r"theta pitch trim pitch_angle theta_.* pitch_.* .*pitch_angle.*",
    "p": r"p p_.* roll_?rate .*roll_?rate.* wx omega_?x phi_?dot gyro_?x",
    "thrust": r"thrust thrust_.* .*_thrust schub", "torque": r"torque torque_.* .*_torque drehmoment",
    "wind_speed": r"(true_)?wind_?(speed|velo|vel|velocity|spd|strength)(_true|_abs.*)? tws ws wspd wind",
    "wind_from": r"(true_)?wind_?(dir|direction|angle|from|course)(_true|_abs.*)? twd wd wdir",
    "wind_speed_relative": r"aws (.*_)?(rel|relative|app|apparent)_wind_?(speed|velo|vel|velocity|spd)?"
    r" wind_?(speed|velo|vel|velocity|spd)_(rel|relative|app|apparent).*",
    "wind_from_relative": r"awa (.*_)?(rel|relative|app|apparent)_wind_?(dir|direction|angle|from)"
    r" wind_?(dir|direction|angle|from)_(rel|relative|app|apparent).*",
}  # fmt: skip
"""Channel -> patterns of what its column may be called: the earlier one stands, the more it is trusted."""
for _name, _words in (("delta", "rudder|rud|delta|rudder_angle|ruder"), ("n", "n|rpm|rps|shaft|propeller|prop|screw")):
    for _side, _short in (("starboard", "stb|stbd|sb"), ("port", "bb|ps")):
        WORDS[f"{_name}_{_side}"] = (
            rf"{_name}_{_side} {_name}_{_side[0]} ({_words})_({_side}|{_short})(_.*)?"
            rf" ({_side}|{_short})_({_words})(_.*)?"
        )
EARTH = re.compile(r"(^|_)(vn|ve|north|east|v_?n|v_?e|earth|ned|enu)(_|$)|velocity_(north|east)")
"""Velocities named like this are those north and east."""
NORTH, EAST = re.compile(r"north|^xn$|(^|_)n(_|$)"), re.compile(r"east|^ye$|(^|_)e(_|$)")
MIDSHIP = re.compile(r"(^|_)(mid|midship|midships)(_|$)")
COMPASS = re.compile(r"head|hdg|hdt|compass|kompass|gyro|course|kurs")
"""A heading named like this is counted clockwise from north."""
COMPONENT = re.compile(
    r"\.([a-z_]*(?:position|orientation|linear|angular|velocity|acceleration|field|vector))\.([xyz])\b"
)
"""A part of a vector, as messages of ROS name it."""
COMPONENTS = {
    ("position", "x"): "x", ("position", "y"): "y", ("linear", "x"): "u", ("linear", "y"): "v",
    ("angular", "z"): "r", ("angular_velocity", "z"): "r", ("angular", "x"): "p", ("angular_velocity", "x"): "p",
}  # fmt: skip
"""Vector and axis -> channel; of any other vector no part is one."""
PERFECT = 100.0
MAX_LETTERS = 120
"""Letters of a heading that are looked at: patterns take long over more."""


@dataclass(frozen=True)
class Heading:
    """A heading taken apart.

    Attributes:
        column: As it stands in the file.
        name: Without its unit, small letters, words joined by ``_``.
        unit: The unit that it states; empty if it states none.
    """

    column: str
    name: str
    unit: str


def take_apart(column: str, below: str = "") -> Heading:
    """Part a heading's name from its unit.

    Args:
        column: The heading.
        below: What stands below it in a line of units; it counts only if it is a unit.

    Returns:
        Name and unit: of ``psi [deg]``, ``yawRate_degps``, ``Speed (kn)``.
    """
    text = column[:MAX_LETTERS].strip().strip("#%'\"").strip()
    unit = _SPELT.get(below.strip().strip("[](){}").lower(), "")
    front, _, last = re.sub(r"\s*/\s*", "/", text).rpartition(" ")
    if front and last.lower() in _SPELT and re.search("[/°º]", last):  # ROT deg/min, and no "min" after a stroke
        return Heading(column, _snake(front), unit or _SPELT[last.lower()])
    bracket = re.search(r"[\[\(\{<]\s*([^\]\)\}>]*?)\s*[\]\)\}>]|[,/:]\s*(\S+)$", text)
    if bracket and (word := (bracket[1] or bracket[2] or "").lower().replace(" ", "")) in _SPELT:
        unit, text = unit or _SPELT[word], text[: bracket.start()] + text[bracket.end() :]
    name = _snake(text)
    if not unit:
        parts = name.split("_")
        for count in (3, 2, 1):
            front, word = "_".join(parts[:-count]), "_".join(parts[-count:])
            if front and word in _SPELT:
                parted = Heading(column, front, _SPELT[word])
                if _names_something(parted) or not _names_something(Heading(column, name, "")):
                    return parted  # the n of pos_n is no newton
        if name in {"rpm", "rps", "utc"}:
            unit = _SPELT[name]
    return Heading(column, name, unit)


def _names_something(heading: Heading) -> bool:
    """Whether it fits any channel."""
    return any(word_score(channel, heading) for channel in WORDS)


def _snake(text: str) -> str:
    """Small letters, words joined by ``_``: of ``YawRate``, ``yaw rate``, ``ship.yaw.rate``."""
    parted = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", unicodedata.normalize("NFKC", text))
    spelt = "".join(SPELT_OUT.get(letter, letter) for letter in parted.lower())
    plain = "".join(letter for letter in unicodedata.normalize("NFD", spelt) if not unicodedata.combining(letter))
    return re.sub(r"[^0-9a-z]+", "_", plain).strip("_")


def word_score(channel: str, heading: Heading) -> float:
    """How well a heading fits a channel, or ``time``.

    Returns:
        0 if it does not; more the better, up to ``PERFECT`` and 5 for a unit that is stated. A unit that measures
        something else rules it out.
    """
    if heading.unit and heading.unit not in units_of(channel, record=True):
        return 0.0
    name = heading.name
    component = COMPONENT.search(heading.column)
    if component:
        return PERFECT / 2 if COMPONENTS.get((component[1], component[2])) == channel else 0.0
    options = [name, _last_part(heading.column)] if "." in heading.column else [name]
    best = 0.0
    for place, pattern in enumerate(WORDS[channel].split()):
        for k, option in enumerate(options):
            if re.fullmatch(pattern, option):
                best = max(best, PERFECT - place - 15 * k - (30 if ".*" in pattern else 0))
    return best + 5.0 if heading.unit and best else best


@lru_cache(maxsize=512)
def _last_part(column: str) -> str:
    """What stands behind the last point of a heading, without its unit: of ``ship.yaw_rate [deg/s]``."""
    return take_apart(column.rpartition(".")[2]).name


def assign(headings: list[Heading]) -> dict[str, list[Heading]]:
    """Columns for channels by name alone, best first: each goes to the channel that it fits best."""
    found: dict[str, list[tuple[float, Heading]]] = {}
    for heading in headings:
        score, channel = max((word_score(c, heading), c) for c in WORDS if c != "time")
        if score > 0:
            found.setdefault(channel, []).append((score, heading))
    return {c: [h for _, h in sorted(named, key=lambda item: -item[0])] for c, named in found.items()}
