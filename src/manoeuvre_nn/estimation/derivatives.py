"""Terms of a Taylor series about the approach: which there are, their symbols, and their values in tuples."""

from collections import Counter
from collections.abc import Mapping, Sequence
from math import factorial, prod

import numpy as np
import torch
from jaxtyping import Float

from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.recording.tuples import Tuples
from manoeuvre_nn.ship.taylor import VARIABLES, Side, TaylorForce

SURGE = ("0", "u", "uu", "uuu", "vv", "rr", "dd", "uvv", "urr", "udd", "vr", "vd", "rd", "uvr", "uvd", "urd")
"""Terms of X up to third order that are the same to port and to starboard."""
LATERAL = (
    "0", "u", "uu", "v", "vvv", "vrr", "vdd", "uv", "uuv", "r", "rrr", "vvr", "rdd", "ur", "uur",
    "d", "ddd", "vvd", "rrd", "ud", "uud", "vrd",
)  # fmt: skip
"""Terms of Y and N up to third order that change sign from port to starboard, and those of a side force ahead."""
ABKOWITZ = {"X": SURGE, "Y": LATERAL, "N": LATERAL}
"""Abkowitz's third-order series; Wang 1996, section 5.3, starts from the same terms."""


def coefficient_name(equation: str, term: str) -> str:
    """A derivative's symbol, d for the rudder angle.

    Args:
        equation: X, Y or N.
        term: Its variables; ``0`` for the constant.

    Returns:
        ``Y_vvd``, variables in the order u, v, r, d.

    Source:
        ITTC 2021, symbols and terminology list, section 3.2.1 (Y_v, Y_vvv, ...).
    """
    return f"{equation}_{''.join(sorted(term, key=('0' + VARIABLES).index))}"


def taylor_columns(
    tuples: Tuples, known: Ship, terms: Mapping[str, Sequence[str]] = ABKOWITZ, side: Side = "starboard"
) -> dict[str, Float[np.ndarray, "n _"]]:
    """Terms of a Taylor series about the approach, as derivatives multiply them: ``v^3 / 6``.

    Args:
        tuples: Samples.
        known: The known part, for its prime system and approach speed.
        terms: Equation -> products of u, v, r, d; ``0`` is the constant.
        side: Side that positive d turns to.

    Returns:
        Equation -> one column a term; u' as deviation from 1 and all velocities over the approach speed.
    """
    speed = known.particulars.speed / known.prime.speed
    u, v, r, d = tuples.inputs.double().unbind(-1)
    motion = torch.stack([u / speed - 1, v / speed, r / speed, d if side == "starboard" else -d], dim=-1)

    def column(term: str) -> Float[np.ndarray, " n"]:
        share = prod(factorial(n) for n in Counter(term).values())
        return (TaylorForce({"X": {term: 1.0}}).products(motion)[:, 0] / share).numpy()

    return {equation: np.stack([column(t) for t in chosen], axis=1) for equation, chosen in terms.items()}
