"""What a person must answer where neither names nor data decided."""

from manoeuvre_nn.recording.propose.choice import Choice
from manoeuvre_nn.recording.read.quantity import units_of

POSITIVE = {
    "psi": "clockwise from north", "cog": "clockwise from north", "r": "positive when the bow turns to starboard",
    "u": "positive ahead", "v": "positive to starboard", "x": "positive to the north", "y": "positive to the east",
    "delta_order": "on the same side as delta", "wind_from": "where it comes from, clockwise from north",
    "wind_from_relative": "where it comes from, clockwise from the bow", "phi": "positive to starboard",
    "n": "positive ahead",
}  # fmt: skip
"""Channel -> what else than its unit a mapping takes for granted."""
SETTINGS = {
    "reference_point": "how many metres forward of midship is the point whose velocities and positions these are?",
    "position_point": "how many metres forward of midship is the point whose positions these are?",
    "rudder_positive_to": "to which side does a positive rudder angle turn the ship, starboard or port?",
    "frame": "are u and v along the ship (body) or to north and east (earth)?",
}
"""Setting of a mapping -> its question."""


def question_of(choice: Choice, called: str) -> str:
    """The question about a channel, or ``time``, that nobody has decided.

    Args:
        choice: How it is read.
        called: What its column is called in the file.

    Returns:
        A sentence that ends in what to change where the answer is no.
    """
    others = ", ".join(unit for unit in units_of(choice.channel, record=choice.unit == "count") if unit != choice.unit)
    meant = f", {POSITIVE[choice.channel]}" if choice.channel in POSITIVE else ""
    change = [f"unit (to {others})"] if others else []
    change += ["sign"] if meant else []
    change += ["offset"] if choice.channel in {"psi", "cog"} else []
    return f"is {called!r} in {choice.unit}{meant}? If not, change its {', '.join(change)}."
