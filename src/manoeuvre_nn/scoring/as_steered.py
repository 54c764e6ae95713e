"""A recorded trial as a manoeuvre that a model can be steered through."""

from dataclasses import replace

import numpy as np

from manoeuvre_nn.core.manoeuvre import Manoeuvre
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.dynamics.recorded_inputs import approach_speed
from manoeuvre_nn.manoeuvre.criteria import held_angle, reversal_times, trace
from manoeuvre_nn.manoeuvre.zigzag import zigzag

MIN_REVERSALS = 2
"""Reversals below which nothing is known of the helmsman."""


def as_steered(recording: Recording, ship: Particulars) -> Manoeuvre | None:
    """The zigzag that a recorded helmsman steered: his rudder angle, and the headings at which his rudder went over.

    With its recorded rudder a model's zigzag has the recorded period whatever the model is; overshoots and period say
    something only when the rudder answers to the model's own heading. A helmsman is late: the rudder leaves its angle
    when the heading is past the one agreed upon, which is why the recorded headings are taken.

    Args:
        recording: A trial.
        ship: The ship.

    Returns:
        The manoeuvre; None for other trials and for zigzags with fewer than two reversals.
    """
    seen = trace(recording) if recording.meta.get("kind") == "zigzag" else None
    if seen is None:
        return None
    times, _ = reversal_times(seen)
    if len(times) < MIN_REVERSALS:
        return None
    heading = np.interp(times, recording.time, recording["psi"]) - recording["psi"][0]
    before = np.interp(times[0], recording.time, recording["delta"])
    held, first = held_angle(np.abs(recording["delta"])), "starboard" if before > 0 else "port"
    speed = approach_speed(recording, ship)
    manoeuvre = zigzag(
        held / DEGREE, float(np.median(np.abs(heading))) / DEGREE, first=first,
        duration=recording.duration, name=recording.name,
    )  # fmt: skip
    return manoeuvre if speed == ship.speed else replace(manoeuvre, speed=speed)
