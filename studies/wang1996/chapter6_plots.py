"""Wang 1996, chapter 6: the turns as they were sailed and predicted, and Figures 6.1 to 6.16 of them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float

from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.ship.mariner import mariner
from studies.reproduction.section import Line, Panel, Plot
from studies.wang1996.sway_curve import SwayCurve
from studies.wang1996.turning import Fold, TurnFit

KINDS = ("one network", "two branches", "steepest descent", "one network, trained longer")
"""What gives v(r): one network or two by Levenberg-Marquardt, one by the thesis' method, and one that follows the turn
with 10 deg of rudder so closely that dv/dr becomes too steep for the yaw equation."""


@dataclass(frozen=True)
class Turn:
    """One turn of the chapter and what was made of it.

    Attributes:
        angle: Rudder angle [deg].
        simulated: The simulation.
        fits: Kind of network -> networks of all starts.
        predicted: Kind of network -> prediction with each of them.
        dev: Kind of network -> largest distance of the tracks over L [-]; infinite where a prediction broke down.
    """

    angle: int
    simulated: Recording
    fits: Mapping[str, TurnFit]
    predicted: Mapping[str, Sequence[Recording]]
    dev: Mapping[str, Float[np.ndarray, " starts"]]

    @property
    def fold(self) -> Fold:
        """What its v(r) does."""
        return self.fits[KINDS[0]].fold

    def chosen(self, kind: str) -> int:
        """The start with the least training error among those whose prediction goes through.

        Args:
            kind: Kind of network.

        Returns:
            Its number.
        """
        errors = np.where(np.isfinite(self.dev[kind]), self.fits[kind].sse.numpy(), np.inf)
        return int(errors.argmin())

    def best(self, kind: str) -> Recording:
        """Its prediction.

        Args:
            kind: Kind of network.

        Returns:
            The recording.
        """
        return self.predicted[kind][self.chosen(kind)]

    def curve(self, kind: str) -> SwayCurve:
        """Its curve.

        Args:
            kind: Kind of network.

        Returns:
            v(r).
        """
        return self.fits[kind].curve.row(self.chosen(kind))


def plots(turns: Sequence[Turn]) -> list[Plot]:
    """Figures 6.1 to 6.16.

    Args:
        turns: The turns.

    Returns:
        One plot a figure.
    """
    """Figures 6.1-6.16."""
    made = [_curves(turns)]
    deg = 1 / DEGREE
    channels = {"v": ("sway velocity", "v [m/s]", 1.0), "r": ("yaw rate", "r [deg/s]", deg)}
    channels |= {"vdot": ("sway acceleration", "vdot [m/s^2]", 1.0)}
    channels |= {"rdot": ("yaw acceleration", "rdot [deg/s^2]", deg)}
    number = 2
    for t in turns:
        runs = {"simulation": t.simulated} | {f"yaw equation, {kind}": t.best(kind) for kind in KINDS[:2]}
        for name in ("v", "r", "track", "vdot", "rdot"):
            if name == "track":
                label, panel = "track", _panel(runs, "y", "x", "y [m]", "x [m]", equal=True)
            else:
                label, axis, factor = channels[name]
                panel = _panel(runs, None, name, "t [s]", axis, factor=factor)
            caption = f"{label.capitalize()} in the turn with {t.angle} deg of rudder (Figure 6.{number})"
            made.append(Plot(f"figure_6_{number}", caption, [panel]))
            number += 1
    return made


def _panel(
    runs: Mapping[str, Recording],
    x: str | None,
    y: str,
    x_label: str,
    y_label: str,
    *,
    factor: float = 1.0,
    equal: bool = False,
) -> Panel:
    roles = ("reference", "ours", "other")
    lines = [
        Line(label, run.time if x is None else run[x], factor * run[y], role)  # type: ignore[arg-type]
        for (label, run), role in zip(runs.items(), roles, strict=True)
    ]
    return Panel(x_label, y_label, lines, equal=equal)


def _curves(turns: Sequence[Turn]) -> Plot:
    """Figure 6.1."""
    unit, lines = mariner().particulars, []
    for t in turns:
        r, v = t.simulated["r"] * unit.time_unit, t.simulated["v"] / unit.speed
        clock, rate = (torch.tensor(x) for x in (t.simulated.time / unit.time_unit, r))
        lines.append(Line(f"{t.angle} deg, simulation", r, v, "reference"))
        for kind, role in zip(KINDS[:2], ("ours", "other"), strict=True):
            made = t.curve(kind)(rate, clock)[0].numpy()
            lines.append(Line(f"{t.angle} deg, {kind}", r, made, role))  # type: ignore[arg-type]
    caption = "v' over r' in turns with 10, 20 and 30 deg of rudder (Figure 6.1)"
    return Plot("figure_6_1", caption, [Panel("r L / U0 [-]", "v / U0 [-]", lines)])
