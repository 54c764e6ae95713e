"""How figures look: colours, axes and legends; no pyplot, so no global state."""

import textwrap
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import Locator, MaxNLocator, NullLocator

COLOURS = ("#D55E00", "#0072B2", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#7A5195", "#8C6D31")
"""Colours that the colour-blind can tell apart (Okabe and Ito 2008, and two more)."""
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")
"""A second way to tell curves apart, for print."""
RECORDED: dict[str, Any] = {"color": "#8C8C8C", "linestyle": "-", "linewidth": 3.0}
PREDICTED: dict[str, Any] = {"color": COLOURS[0], "linestyle": (0, (4, 2)), "linewidth": 1.5}
"""Broad and grey below thin and dashed: where they coincide, both are seen, in print too."""
FIGURE_WIDTH_IN = 5.8
"""Width of a figure [in]: text stays legible when a phone scales it to its screen."""


def plain_axes(axes: Axes, xlabel: str, ylabel: str) -> Axes:
    """Label an axes, take away what carries no information, and return it."""
    axes.set_xlabel(xlabel)
    axes.set_ylabel(ylabel)
    axes.grid(visible=True, color="#DDDDDD", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    return axes


def short_name(words: str, width: int) -> str:
    """Words on two lines of a width at most, without their middle if need be, and never taken for a formula."""
    if len(words) > 2 * width:
        words = f"{words[: width - 1]}… {words[1 - width :]}"
    return "\n".join(textwrap.wrap(words, width)).replace("$", r"\$")


def new_figure(height: float, width: float = FIGURE_WIDTH_IN, title: str = "") -> Figure:
    """An empty figure of a height and width [in], whose parts make room for one another."""
    figure = Figure(figsize=(width, height), layout="constrained", facecolor="white")
    if title:
        figure.suptitle(title, fontsize=11, fontweight="bold")
    return figure


def legend_below(figure: Figure, handles: Sequence[Any], columns: int = 3) -> None:
    """Put a legend of artists with labels below all axes, where it hides no curve; ``columns`` stand side by side."""
    figure.legend(
        handles=list(handles), loc="outside lower center", ncols=min(columns, len(handles)), frameon=False, fontsize=9
    )


class _DecadeLocator(Locator):
    """Ticks of a logarithmic axis: even within a decade, at 1, 2 and 5 over few, at powers of ten over many."""

    def __call__(self) -> list[float]:
        """Ticks of the axis as it stands."""
        assert self.axis is not None
        return self.tick_values(*self.axis.get_view_interval())

    def tick_values(self, vmin: float, vmax: float) -> list[float]:
        """Ticks between two values, at most about eight."""
        low, high = np.sort(np.log10(np.maximum([vmin, vmax], 1e-300)))
        span = high - low
        if span < 0.8:
            places = np.asarray(MaxNLocator(5).tick_values(10.0**low, 10.0**high))
        else:
            exponents = np.arange(np.floor(low), np.ceil(high) + 1, 1 if span < 2.2 else np.ceil(span / 6))
            places = np.multiply.outer(10.0**exponents, [1.0, 2.0, 5.0] if span < 2.2 else [1.0]).ravel()
        return [float(place) for place in places if 10.0**low * 0.999 <= place <= 10.0**high * 1.001]


def log_axis(axes: Axes, which: Literal["x", "y"] = "y") -> Axes:
    """Make an axis logarithmic, with plain numbers, and return the axes."""
    axes.set(**{f"{which}scale": "log"})
    axis = axes.xaxis if which == "x" else axes.yaxis
    axis.set_major_locator(_DecadeLocator())
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(lambda value, _: f"{value:g}")
    return axes
