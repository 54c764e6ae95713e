"""Records of significant pitch amplitude: on the paper's grid, at random points between, and spread evenly."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.stats import qmc

from manoeuvre_nn.core.response import Quantities, Records, Variable
from manoeuvre_nn.core.units import DEGREE, KNOT
from manoeuvre_nn.seakeeping.pitch import significant_pitch
from studies.cepowski2007.published import GRID, grid_conditions
from studies.reproduction.section import ComputingEffort

BETWEEN = 800
"""Random points between those of the grid."""
INPUTS = tuple(
    Variable(name, unit, size, meaning, low=min(GRID[key]), high=max(GRID[key]))
    for name, key, unit, size, meaning in (
        ("d", "d", "m", 1.0, "draught"),
        ("V", "V", "kn", KNOT, "speed"),
        ("beta", "beta", "deg", DEGREE, "heading to the waves: 0 following, 180 head sea"),
        ("Hs", "H_s", "m", 1.0, "significant wave height"),
        ("T", "T", "s", 1.0, "mean zero-crossing period of the waves"),
    )
)
OUTPUT = Variable("pitch", "deg", DEGREE, "significant pitch amplitude")
AS_PRINTED = Quantities(INPUTS, OUTPUT, ["d", "V", "beta", "Hs", "T"])
"""What the paper's networks see."""
PHYSICAL = Quantities(INPUTS, OUTPUT, ["d", "encounter_frequency", "wave_number_along", "T"], per="Hs")
"""What linear theory makes of the same five: the pitch goes with H_s, and V and beta act through the frequency of
encounter and the wave number along the ship."""


@dataclass(frozen=True)
class RecordSets:
    """Records of one method.

    Attributes:
        method: How they were computed: see :func:`.significant_pitch`.
        grid: The paper's 4400.
        between: Random points, which no network learns from.
        spread: As many as were asked for, placed by a Sobol sequence.
    """

    method: str
    grid: Records
    between: Records
    spread: Records


def record_sets(method: str, say: Callable[[str], None], *, seed: int = 0, spread: int = 0) -> RecordSets:
    """Compute records.

    Args:
        method: ``closed_form``, ``strip_theory`` or ``boundary_element``.
        say: Told what is being done.
        seed: Seed of the points between; the Sobol sequence has the next one.
        spread: Records that a Sobol sequence places.

    Returns:
        The records.
    """
    say(f"records: {method.replace('_', ' ')}")
    low, high = (np.array([end(axis) for axis in GRID.values()]) for end in (min, max))
    random = np.random.default_rng(seed).uniform(low, high, (BETWEEN, len(low)))
    even = qmc.scale(qmc.Sobol(len(low), rng=seed + 1).random(max(spread, 1)), low, high)[:spread]
    places = {"the grid": grid_conditions(), "random points between": random, "a Sobol sequence": even}
    pitch = significant_pitch(np.concatenate(list(places.values())), method, progress=say)
    parts = np.split(pitch, np.cumsum([len(c) for c in places.values()])[:-1])
    named = [
        Records(INPUTS, OUTPUT, conditions, values, f"S-175, {method}, {where}")
        for (where, conditions), values in zip(places.items(), parts, strict=True)
    ]
    return RecordSets(method, *named)


def usual_method(effort: ComputingEffort) -> str:
    """How records are computed: in the short form by the closed form, else by strips, which need no further package."""
    return "closed_form" if effort.quick else "strip_theory"


def rms_deg(wrong: Float[np.ndarray, " n"]) -> float:
    """Root mean square of errors [rad], in degrees: the paper's eq. 2."""
    return float(np.sqrt(np.mean(np.square(wrong))) / DEGREE)
