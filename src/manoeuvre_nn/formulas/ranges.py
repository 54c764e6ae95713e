"""What a model was trained on, as a range of each of its inputs: where its closed form holds."""

from collections.abc import Mapping, Sequence

import numpy as np

from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.dynamics.base import Model
from manoeuvre_nn.dynamics.recorded_inputs import recorded_inputs
from manoeuvre_nn.recording.tuples import Tuples

Ranges = Mapping[str, tuple[float, float]]
"""Name of an input -> its ends [SI]."""
USUAL_SPEEDS, USUAL_DRIFT, USUAL_TURN = (0.2, 1.1), 0.3, 0.8
"""Speeds over U0, sway over U0 and yaw rate over U0/L that hard manoeuvres stay within: at 35 deg of rudder a tanker of
190,000 dwt falls to .26 U0, and the ships whose coefficients are here drift by .2 U0 and turn with .52 U0/L at most."""
USUAL_SHAFTS, USUAL_WIND = (0.5, 1.1), 1.0
"""Shaft speeds over the nominal one, and wind speed over U0, that a model is checked at where none were recorded."""


def usual_ranges(ship: Ship) -> Ranges:
    """Ranges of hard manoeuvres of a ship: where it is not known what a model was trained on."""
    p = ship.particulars
    turn, wind = USUAL_TURN * p.speed / p.length, USUAL_WIND * p.speed
    return {
        "u": (USUAL_SPEEDS[0] * p.speed, USUAL_SPEEDS[1] * p.speed),
        "v": (-USUAL_DRIFT * p.speed, USUAL_DRIFT * p.speed),
        "r": (-turn, turn),
        "delta": (-p.rudder_limit, p.rudder_limit),
        "shaft": USUAL_SHAFTS,
        "approach": USUAL_SHAFTS,
        "wind_north": (-wind, wind),
        "wind_east": (-wind, wind),
        "psi": (-np.pi, np.pi),
    }


def trained_ranges(model: Model, tuples: Tuples, recordings: Sequence[Recording]) -> Ranges:
    """Ranges of what a model was trained on.

    Args:
        model: The model.
        tuples: Samples of motion and rudder, in the units of its known part.
        recordings: What they were made from, for shaft and wind.

    Returns:
        Ranges of what was recorded, and the usual ones of what was not; an input that did not vary has equal ends.
    """
    motion = tuples.inputs.double().cpu().numpy()
    units = [*model.hull.velocity_units.double().tolist(), 1.0]
    found = {
        name: motion[:, k] * unit for k, (name, unit) in enumerate(zip(("u", "v", "r", "delta"), units, strict=True))
    }
    return {**usual_ranges(model.hull), **_ends(found), **_ends(_controls(model, recordings))}


def recorded_ranges(model: Model, recordings: Sequence[Recording]) -> Ranges:
    """The same from recordings alone; what they do not hold is taken to be usual."""
    found = {
        name: np.concatenate([r[name] for r in recordings])
        for name in ("u", "v", "r", "delta")
        if all(name in r.channels for r in recordings)
    }
    return {**usual_ranges(model.hull), **_ends(found), **_ends(_controls(model, recordings))}


def _controls(model: Model, recordings: Sequence[Recording]) -> dict[str, np.ndarray]:
    """Recorded inputs beside the rudder that the model takes."""
    taken = recorded_inputs(model, recordings, [r.time for r in recordings])
    return {name: np.concatenate(rows) for name, rows in taken.items() if rows}


def _ends(columns: Mapping[str, np.ndarray]) -> dict[str, tuple[float, float]]:
    """Least and largest value."""
    return {name: (float(np.nanmin(values)), float(np.nanmax(values))) for name, values in columns.items()}
