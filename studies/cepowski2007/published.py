"""Eq. 3 of Cepowski 2007, the paper's 5-7-1 network as one formula, and the grid that its records stand on."""

from functools import cache
from importlib.resources import files

import numpy as np
import yaml
from jaxtyping import Float
from scipy.special import expit

from manoeuvre_nn.core.units import DEGREE, KNOT

GRID = {
    "d": (5.0, 7.0, 9.0, 11.0),
    "V": tuple(v * KNOT for v in (0, 5, 10, 15, 20)),
    "beta": tuple(b * DEGREE for b in (0, 10, 20, 30, 60, 90, 120, 150, 160, 170, 180)),
    "H_s": (2.0, 3.0, 4.0, 5.0),
    "T": (6.5, 8.5, 10.5, 12.5, 14.5),
}
"""Values of d [m], V [m/s], beta [rad] (0 following sea, pi head sea), H_s [m] and T [s] of the 4400 records."""
AS_PRINTED = np.array([1.0, 1 / KNOT, 1 / DEGREE, 1.0, 1.0])
"""SI to the units of Eq. 3."""


def grid_conditions() -> Float[np.ndarray, "4400 5"]:
    """All combinations of :data:`GRID`, T running fastest.

    Returns:
        d [m], V [m/s], beta [rad], H_s [m], T [s].
    """
    return np.stack([axis.ravel() for axis in np.meshgrid(*GRID.values(), indexing="ij")], axis=1)


def published_pitch(conditions: Float[np.ndarray, "n 5"]) -> Float[np.ndarray, " n"]:
    """Significant pitch amplitude by the printed formula.

    ``psi = (C sigmoid((x S + P) A - B) - alpha_0 - alpha_1) / alpha_2``

    The paper calls beta = 0 head waves and 180 deg following waves. The formula has it the other way round: two
    independent computations agree with it only if beta = 0 is following sea (correlation .96 and .93; as labelled .64
    and .63). So does this function, and with it everything here.

    Args:
        conditions: d [m], V [m/s], beta [rad] (0 following sea, pi head sea), H_s [m], T [s]; the formula was fitted on
            :data:`GRID`, and does not know its symmetry in beta: give 0 to pi.

    Returns:
        psi_1/3 [rad].

    Source:
        Cepowski 2007, Eq. 3. Deviations: S_11 is 1/6 for the printed .01667; S and P are not rounded
        (with the printed .0056 for 1/180 the formula is up to .05 deg off).
    """
    a, b, c, smallest, largest, alpha = _numbers()
    scaled = (conditions * AS_PRINTED - smallest) / (largest - smallest)  # x S + P
    nodes = expit(scaled @ a - b)
    return DEGREE * (nodes @ c - alpha[0] - alpha[1]) / alpha[2]


@cache
def _numbers() -> tuple[np.ndarray, ...]:
    """A, B, C, the ranges that S and P are made of, and the three alphas."""
    read = yaml.safe_load(files("studies.cepowski2007").joinpath("eq3.yaml").read_text())
    return tuple(np.array(read[name]) for name in ("A", "B", "C", "smallest", "largest", "alpha"))
