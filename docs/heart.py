"""The picture of the README: a wind that was concealed from the model, found, named, and put into it."""

from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

import manoeuvre_nn as mnn

CONCEALED = {"speed": 15.0, "from_deg": 60.0}
"""The wind that acts in the recordings [m/s, deg]."""
NOISE = {"x": 1.0, "y": 1.0, "u": 0.05, "v": 0.05, "r_deg_s": 0.01, "psi_deg": 0.1, "delta_deg": 0.1}
TRIALS = ("zz20", "tc20", {"zz10": {"first": "port"}}, {"tc25_port": {"duration": 1200.0}})
RECORDED: dict[str, Any] = {"color": "#8C8C8C", "linewidth": 5, "alpha": 0.5, "label": "recorded"}
CALM: dict[str, Any] = {"color": "#D55E00", "linewidth": 1.6, "linestyle": (0, (4, 2)), "label": "calm-water model"}
REPAIRED: dict[str, Any] = {"color": "#0072B2", "linewidth": 1.6, "label": "model with the wind"}
FOUND: dict[str, Any] = {"color": "#0072B2", "marker": "o", "label": "found, 95 % interval"}
TRUE: dict[str, Any] = {"color": "black", "linestyle": ":", "linewidth": 1.4, "label": "concealed value"}
START: dict[str, Any] = {
    "color": "black",
    "marker": "*",
    "markersize": 11,
    "linestyle": "",
    "label": "prediction starts",
}
NORMAL_95 = 1.96
"""Standard errors in half of a 95 % interval."""


def draw(answer: Any, path: Path) -> None:
    """Draw the held-out run before and after the repair, and the named cause between them.

    Args:
        answer: A diagnosis that found a steady wind, with a held-out run.
        path: Where the picture is written.
    """
    proof, cause = answer.proofs[0], answer.causes[0]
    figure = Figure(figsize=(11.4, 4.7), layout="constrained", facecolor="white")
    axes = figure.subplot_mosaic(
        [["before", "speed", "after"], ["before", "from_deg", "after"]], width_ratios=(1, 0.72, 1)
    )
    _map(axes["before"], proof, proof.before, CALM, f"1. A mismatch: {proof.rmse_before['pos']:.0f} m off")
    _map(axes["after"], proof, proof.after, REPAIRED, f"3. Repaired: {proof.rmse_after['pos']:.1f} m off")
    axes["before"].set_ylabel("north [m]")
    values = {value.name: value for value in cause.parameters}
    _interval(axes["speed"], values["speed"], "wind speed [m/s]", 3.0)
    _interval(axes["from_deg"], values["from_deg"], "wind from [deg]", 3.0)
    share = "> 99 %" if cause.probability > 0.99 else f"{100 * cause.probability:.0f} %"
    axes["speed"].set_title(f"2. Named: {cause.label} ({share})", loc="left", fontweight="bold", fontsize=11)
    styles = (RECORDED, CALM, REPAIRED, {**FOUND, "linestyle": ""}, TRUE, {**START, "markersize": 9})
    handles = [Line2D([], [], **style) for style in styles]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False)
    figure.savefig(path, dpi=100)


def _map(axes: Axes, proof: Any, track: Any, style: dict[str, Any], title: str) -> None:
    """A held-out run from above, as recorded and as predicted."""
    axes.plot(proof.recorded["y"], proof.recorded["x"], **RECORDED)
    axes.plot(track["y"], track["x"], **style)
    first = track["x"].first_valid_index()
    axes.plot(track["y"][first], track["x"][first], **START)
    axes.set(xlabel="east [m]", aspect="equal")
    axes.set_title(title, loc="left", fontweight="bold", fontsize=11)
    axes.grid(color="#DDDDDD", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def _interval(axes: Axes, value: Any, words: str, room: float) -> None:
    """A parameter as found, with its interval, beside the value that was concealed."""
    half, true = NORMAL_95 * value.error, CONCEALED[value.name]
    axes.axvline(true, 0.0, 0.62, **TRUE)
    axes.errorbar([value.value], [0.0], xerr=[[half], [half]], capsize=6, linewidth=2, markersize=8, **FOUND)
    axes.set(xlim=(true - room * half, true + room * half), ylim=(-1.0, 2.0), yticks=[], xlabel=words)
    axes.text(0.5, 0.74, f"{value.value:.1f} ± {half:.1f} {value.unit}", transform=axes.transAxes, ha="center",
              color=FOUND["color"], fontsize=13)  # fmt: skip
    axes.spines[["top", "right", "left"]].set_visible(False)


if __name__ == "__main__":
    runs = mnn.simulate("mariner_corrected", TRIALS, effects={"wind_steady": CONCEALED}, noise=NOISE)
    found = mnn.diagnose("mariner_corrected", runs, held_out=["tc25_port"])
    print(found)
    draw(found.diagnosis, Path(__file__).with_name("heart.png"))
