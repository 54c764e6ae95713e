"""A hull form made of its main dimensions and coefficients, for ships whose lines are not at hand."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float
from scipy.optimize import root
from scipy.special import beta

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.seakeeping.hull import Hull

AREA_POWER, WATERLINE_POWER = 1.5, 1.0
"""q of the curves ``(1 - |t|^p)^q``: fine ends of the areas, blunt ends of the waterline."""
MIN_SECTION = 0.25
"""Least fullness of a section, area over breadth times draught: the ends are no thinner V than that."""
MAX_DRAUGHT = 1.4
"""How high the sides go on above the base line, over the design draught."""

MAX_CENTRE = 0.025
"""Farthest LCB forward of midship over L that is estimated."""


@dataclass(frozen=True)
class HullForm:
    """A ship's form and weights by coefficients; sections are ``y = b(x) (z/T)^n(x)``.

    Sectional area and design waterline fall off from midship to both ends as ``(1 - |t|^p)^q`` with t = 2x/L, with one
    p for the fore and one for the after body each, such that fullness and centre are the ones asked for. The section's
    exponent follows from its fullness ``s = A/(2 b T)``: n = 1/s - 1. Below and above the design draught T the same
    sections go on.

    Attributes:
        length: Length between perpendiculars L [m].
        breadth: Breadth B [m].
        draught: Design draught T [m].
        block: Block coefficient at the design draught [-].
        waterplane: Waterplane coefficient at the design draught [-].
        midship: Midship section coefficient [-].
        centre: Centre of buoyancy forward of midship at the design draught [m].
        flotation: Centre of the waterplane forward of midship at the design draught [m].
        gyradius: Radius of gyration in pitch k_yy over L [-].
        weight_height: Centre of gravity above the keel, KG [m].
    """

    length: float
    breadth: float
    draught: float
    block: float
    waterplane: float
    midship: float
    centre: float
    flotation: float
    gyradius: float
    weight_height: float

    def __post_init__(self) -> None:
        """Refuse what is no ship.

        Raises:
            InputError: If dimensions or coefficients are out of their order, or no curve has them.
        """
        if not self.length > self.breadth > self.draught > 0:
            raise InputError(
                f"hull of {self.length} x {self.breadth} x {self.draught} m: write length > breadth > draught > 0"
            )
        if not 0 < self.block < self.waterplane < 1 or not self.block < self.midship < 1:
            raise InputError(
                f"hull with block {self.block}, waterplane {self.waterplane} and midship coefficient {self.midship}: "
                "write block < waterplane < 1 and block < midship < 1"
            )
        if not 0 < self.gyradius < 0.5 or not 0 < self.weight_height < self.length:
            raise InputError(
                f"hull with gyradius {self.gyradius} and weight_height {self.weight_height}: write a radius of "
                "gyration between 0 and half the length, as a share of it, and a height above the keel in metres"
            )
        _ = self._sections

    @cached_property
    def _sections(self) -> tuple[Callable[[np.ndarray], np.ndarray], Callable[[np.ndarray], np.ndarray]]:
        """Half-breadth of the design waterline [m] and exponent n by t = 2x/L."""
        half = self.length / 2
        area = _curve(
            self.block / self.midship,
            self.centre / half,
            AREA_POWER,
            "block coefficient and LCB (form.block, form.centre)",
        )
        line = _curve(
            self.waterplane,
            self.flotation / half,
            WATERLINE_POWER,
            "waterplane coefficient and LCF (form.waterplane, form.flotation)",
        )

        def exponent(t: np.ndarray) -> np.ndarray:
            fullness = self.midship * area(t) / np.maximum(line(t), 1e-12)
            return 1 / np.clip(fullness, MIN_SECTION, self.midship) - 1

        return lambda t: self.breadth / 2 * line(t), exponent

    def half_breadth(
        self, x: Float[np.ndarray, " stations"], z: Float[np.ndarray, " waterlines"]
    ) -> Float[np.ndarray, "stations waterlines"]:
        """Half-breadths.

        Args:
            x: Places forward of midship [m].
            z: Heights above the base line [m].

        Returns:
            Half-breadths [m].
        """
        line, exponent = self._sections
        t = 2 * x / self.length
        return np.asarray(line(t)[:, None] * (z / self.draught) ** exponent(t)[:, None])

    def offsets(self, stations: int = 81, waterlines: int = 41) -> Hull:
        """The form as a table of offsets.

        Args:
            stations: How many, denser at the ends.
            waterlines: How many, denser at the keel.

        Returns:
            Offsets from the base line to 1.4 times the design draught.
        """
        x = self.length / 2 * np.sin(np.linspace(-np.pi / 2, np.pi / 2, stations))
        z = MAX_DRAUGHT * self.draught * np.linspace(0.0, 1.0, waterlines) ** 3
        return Hull(x, z, self.half_breadth(x, z))


def _curve(fullness: float, centre: float, power: float, what: str) -> Callable[[np.ndarray], np.ndarray]:
    """``(1 - |t|^p)^q`` over -1 <= t <= 1, with two p for mean and centre that are asked for."""

    def missed(logarithms: np.ndarray) -> list[float]:
        # int_0^1 t^m (1 - t^p)^q dt = B((m+1)/p, q+1)/p
        p = np.exp(np.clip(logarithms, -5.0, 5.0))
        (aft, fore), (aft_1, fore_1) = (beta(m / p, power + 1) / p for m in (1, 2))
        return [(aft + fore) / 2 - fullness, (fore_1 - aft_1) / (aft + fore) - centre]

    found = root(missed, np.log([2.0, 2.0]))
    if not found.success or np.abs(found.fun).max() > 1e-9:
        raise InputError(f"no hull has this {what}: fullness {fullness:.3f} with its centre at {centre:.3g} L/2")
    aft, fore = np.exp(found.x).tolist()
    return lambda t: (1 - np.abs(t) ** np.where(t < 0, aft, fore)) ** power


S175 = HullForm(175.0, 25.4, 9.5, 0.573, 0.710, 0.970, -2.74, -5.0, 0.24, 9.52)
"""The S-175 container ship of the ITTC's comparative studies; the place of LCF is an estimate."""


def estimated_form(ship: Particulars) -> HullForm:
    """A form from what is known of any ship; ``dataclasses.replace`` puts in what is known better.

    ``C_M = 1.006 - .0056 C_B^-3.56``, ``C_WP = (1 + 2 C_B)/3``, ``LCB/L = -.135 + .194 C_B/C_M``, at most .025; assumed
    are an LCF .015 L abaft LCB, k_yy = .25 L and KG = T.

    Args:
        ship: Length, beam, draught and block coefficient.

    Returns:
        The form.

    Source:
        Schneekluth & Bertram 1998, "Ship design for efficiency and economy": C_M (Kerlen), C_WP, LCB (tankers).
    """
    midship = 1.006 - 0.0056 * ship.block**-3.56
    centre = min(-0.135 + 0.194 * ship.block / midship, MAX_CENTRE) * ship.length
    return HullForm(
        length=ship.length,
        breadth=ship.beam,
        draught=ship.draught,
        block=ship.block,
        waterplane=(1 + 2 * ship.block) / 3,
        midship=midship,
        centre=centre,
        flotation=centre - 0.015 * ship.length,
        gyradius=0.25,
        weight_height=ship.draught,
    )
