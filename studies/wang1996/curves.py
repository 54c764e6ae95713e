"""Histories and tracks of runs as panels, for the figures of Wang's thesis."""

from collections.abc import Mapping, Sequence
from typing import Literal

from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from studies.reproduction.section import Line, Panel, Plot
from studies.wang1996.networks import Flown, ThesisShip

AXES = {
    "u": ("u [m/s]", 1.0),
    "v": ("v [m/s]", 1.0),
    "r": ("r [deg/s]", DEGREE),
    "psi": ("heading [deg]", DEGREE),
    "udot": ("surge acceleration [m/s^2]", 1.0),
    "vdot": ("sway acceleration [m/s^2]", 1.0),
    "rdot": ("yaw acceleration [deg/s^2]", DEGREE),
}
"""Channel -> label and unit of its axis."""
Role = Literal["reference", "ours", "paper", "other"]
SIMULATED = "simulation"
"""Label of what is to be met."""


def panels(runs: Mapping[str, Recording], length: float, channels: Sequence[str]) -> list[Panel]:
    """One panel for each channel, with all runs in it.

    Args:
        runs: Label -> run; the label ``simulation`` is the reference, ``published`` the thesis'.
        length: L [m].
        channels: Channels, or ``track``.

    Returns:
        The panels.
    """
    made = []
    for channel in channels:
        if channel == "track":
            lines = [Line(k, run["y"] / length, run["x"] / length, role(k)) for k, run in runs.items()]
            made.append(Panel("y / L", "x / L", lines, equal=True))
        else:
            label, unit = AXES[channel]
            lines = [Line(k, run.time, run[channel] / unit, role(k)) for k, run in runs.items()]
            made.append(Panel("t [s]", label, lines))
    return made


def beside(
    of: ThesisShip, flights: Sequence[Flown], trial: str, name: str, caption: str, channels: Sequence[str]
) -> Plot:
    """A manoeuvre as simulated and as networks predict it; of many starts the one of middling quality.

    Args:
        of: The ship.
        flights: Networks in closed loop.
        trial: The manoeuvre.
        name: Name of the plot.
        caption: Its caption.
        channels: Channels, or ``track``.

    Returns:
        The plot.
    """
    runs = {SIMULATED: of.references[trial]} | {f.networks.label: f.middle(trial) for f in flights}
    return Plot(name, caption, panels(runs, of.length, channels))


def role(label: str) -> Role:
    """How a curve is drawn.

    Args:
        label: What it is.

    Returns:
        ``reference`` for the simulation, ``paper`` for the published networks, else ``ours``.
    """
    return "reference" if label == SIMULATED else "paper" if label == "published" else "ours"
