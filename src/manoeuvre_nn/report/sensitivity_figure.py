"""A figure of how much each input of a model counts."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from manoeuvre_nn.report.style import COLOURS, legend_below, new_figure, plain_axes
from manoeuvre_nn.scoring.sensitivity import InputSensitivity

BAR = 0.36
"""Height of a bar over the distance between inputs."""


def sensitivity_figure(found: Sequence[InputSensitivity]) -> Figure:
    """Bars of error ratios and of Sobol indices, an input a line, the first on top.

    Args:
        found: Measures of each input.

    Returns:
        The figure.
    """
    figure = new_figure(1.5 + 0.45 * len(found), title="How much each input counts")
    left, right = figure.subplots(1, 2, sharey=True)
    places = np.arange(len(found))[::-1]
    parts = {
        left: ("error without it over error with it [-]", ("error_ratio", "permuted_ratio"), COLOURS[:2]),
        right: ("share of variance [-]", ("first", "total"), COLOURS[2:4]),
    }
    for axes, (label, names, colours) in parts.items():
        plain_axes(axes, label, "")
        for name, colour, shift in zip(names, colours, (0.5, -0.5), strict=True):
            values = np.array([getattr(one, name) for one in found])
            shown = np.where(np.isfinite(values), values, 0.0)
            axes.barh(places + shift * BAR, shown, BAR, color=colour)
    left.axvline(1.0, color="#4D4D4D", linewidth=1.0)
    left.set_yticks(places, [one.name for one in found])
    right.set_xlim(left=0.0)
    labels = ("replaced by its mean", "exchanged between records", "Sobol, alone", "Sobol, with others")
    handles = [Patch(color=colour, label=label) for colour, label in zip(COLOURS[:4], labels, strict=True)]
    legend_below(figure, handles, columns=2)
    return figure
