"""A ship by numbers alone: what a yaml in a person's own folder names, in metres, knots and degrees."""

from collections.abc import Mapping
from dataclasses import dataclass

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.units import DEGREE, GRAVITY, KNOT, SEA_WATER
from manoeuvre_nn.ship.taylor import Coefficients, Side, TaylorShip

SLENDER, MAX_FROUDE = (1.5, 15.0), 2.0
"""Length over beam, and Froude number U0/sqrt(g L), beyond which a length is in feet or a speed in another unit: barges
have about 2, destroyers 10; the fastest planing craft reach about 1.5."""
INERTIA = ("mx", "my", "mz")
"""Entries of M' that every ship has."""


@dataclass(frozen=True)
class OwnParticulars:
    """Main dimensions and steering gear as a ship document has them.

    Attributes:
        name: The ship's name.
        length: Length between perpendiculars L [m].
        beam: Beam B [m].
        draught: Draught T [m].
        block: Block coefficient C_B [-].
        speed_kn: Approach speed U0 [kn].
        rudder_rate_deg_s: Turning rate of the rudder [deg/s].
        rudder_limit_deg: Largest rudder angle [deg].
        rudder_area_ratio: Rudder area over L T [-].
        rpm: Nominal shaft speed [rpm].
        record_length: How long a manoeuvre usually is recorded [s].
        sample_interval: Time between samples that resolves the ship's motion [s]; None takes .05 L/U0.
        displacement_t: Displacement [t]; None takes rho C_B L B T.
        rho: Density of the water [kg/m^3].
        source: Where the numbers are from.
    """

    name: str
    length: float
    beam: float
    draught: float
    block: float
    speed_kn: float
    rudder_rate_deg_s: float = 2.5
    rudder_limit_deg: float = 35.0
    rudder_area_ratio: float = 0.02
    rpm: float = 80.0
    record_length: float = 360.0
    sample_interval: float | None = None
    displacement_t: float | None = None
    rho: float = SEA_WATER
    source: str = ""


def own_particulars(settings: OwnParticulars) -> Particulars:
    """A ship of which only the dimensions are known: for recordings, or as Clarke's estimate.

    Args:
        settings: The dimensions.

    Returns:
        The same in SI.

    Raises:
        InputError: If the name is blank, the speed is not positive, or no ship is so slender or so fast.
    """
    s = settings
    if not s.name.strip():
        raise InputError(f"a ship's name is {s.name!r}: write letters")
    if not s.speed_kn > 0:
        raise InputError(f"ship {s.name}: speed_kn is {s.speed_kn}; it must be positive")
    speed = s.speed_kn * KNOT
    made = Particulars(
        name=s.name, length=s.length, beam=s.beam, draught=s.draught, block=s.block, speed=speed,
        rudder_rate=s.rudder_rate_deg_s * DEGREE, rudder_limit=s.rudder_limit_deg * DEGREE,
        rudder_area_ratio=s.rudder_area_ratio, rpm=s.rpm, record_length=s.record_length,
        sample_interval=s.sample_interval or 0.05 * s.length / speed, rho=s.rho, source=s.source,
        displacement=None if s.displacement_t is None else 1e3 * s.displacement_t,
    )  # fmt: skip
    if not SLENDER[0] < s.length / s.beam < SLENDER[1]:
        raise InputError(
            f"ship {s.name}: length {s.length:g} m over beam {s.beam:g} m is {s.length / s.beam:.3g}; expected "
            f"{SLENDER[0]:g} to {SLENDER[1]:g}: mind that both are in m"
        )
    if (froude := speed / (GRAVITY * s.length) ** 0.5) > MAX_FROUDE:
        raise InputError(
            f"ship {s.name}: speed_kn {s.speed_kn:g} on {s.length:g} m is a Froude number of {froude:.2g}; expected up "
            f"to {MAX_FROUDE:g}: write the speed in knots, the length in m"
        )
    return made


def own_ship(
    settings: OwnParticulars,
    inertia: Mapping[str, float],
    coefficients: Coefficients,
    positive_rudder_turns_to: Side = "starboard",
    taylor: bool = True,
) -> TaylorShip:
    """A ship whose forces are a Taylor series about the approach, in the (rho, L, T, U0) system.

    ``M' nudot' = f'(u' - 1, v', r', delta)``, forces over ``.5 rho L T U0^2``, moments over ``.5 rho L^2 T U0^2``.

    Args:
        settings: Dimensions and steering gear.
        inertia: ``mx``, ``my``, ``mz`` with added masses, and ``Yrdot``, ``Nvdot`` where they are not zero [-].
        coefficients: Equation (X, Y, N) -> term (``v``, ``vvr``, ``d``, ``0`` for a constant) -> value [-], mass terms
            included: ``Y: {r: Yr - m}``.
        positive_rudder_turns_to: Sign of the rudder in them.
        taylor: Whether values are derivatives (``Yvvv v^3 / 6``), or factors of the bare products.

    Returns:
        The ship.

    Raises:
        InputError: If an inertia is missing.

    Source:
        Abkowitz 1964; Wang 1996, eqs 4.24-4.29, for the units.
    """
    missing = set(INERTIA) - set(inertia)
    if missing:
        raise InputError(f"ship {settings.name}: inertia lacks {', '.join(sorted(missing))}; write them in the yaml")
    p = own_particulars(settings)
    return TaylorShip(p, inertia, coefficients, positive_rudder_turns_to=positive_rudder_turns_to, taylor=taylor)
