"""Hess & Faller 2000, "RNN architecture" and Tables 4 to 6 as they are printed: inputs, weights, percents."""

from math import pi
from pathlib import Path
from typing import Any

from manoeuvre_nn.core.data_files import load_yaml
from manoeuvre_nn.network.force_modules import ForceConstants, RudderLift
from manoeuvre_nn.network.recursive import RecursiveNetwork
from manoeuvre_nn.network.recursive_settings import STEP, RecursiveSettings
from studies.reproduction.claims import read_claims
from studies.reproduction.section import ChapterResult, ComputingEffort, Say

PRINTED: dict[str, dict[str, Any]] = load_yaml(Path(__file__).with_name("printed.yaml"))
"""Tables 4 to 6 as printed."""
RUNS = ("all", "validation")
"""The two numbers of a cell."""
LAST_DIGIT = {"u": 0.005, "x": 0.05, "y": 0.05, "phi": 0.005, "psi": 0.05}
"""Half of the last digit of the printed absolute errors."""
LAST_DIGIT_OF_SCALE = {"u": 0.05, "x": 0.5, "y": 0.5, "phi": 0.05, "psi": 0.5}
LARGE_ASPECT = 1000.0


def chapter(effort: ComputingEffort, say: Say) -> ChapterResult:
    """The network's shape, and the printed tables checked against themselves.

    Args:
        effort: Not used: nothing is trained.
        say: Told what is being done.

    Returns:
        Counts and checks.
    """
    say("counts")
    paper = RecursiveNetwork(RecursiveSettings(freedom=6))
    other = RecursiveNetwork(RecursiveSettings(freedom=6, hidden=(56, 56), biases=False))
    quantities = {
        "inputs": _inputs(paper.input_names),
        "remembered": STEP * paper.settings.past,
        "weights": {"54-54": paper.weights_count, "56-56": other.weights_count},
        "nodes": {"54-54": 54 + 54 + 6, "56-56": 56 + 56 + 6},
        "lift_slope": _slope_of_a_long_rudder() / (2 * pi),
        "percents": _percents(),
        # Eight training and two validation runs.
        "possible": 0.8 + 0.2 * PRINTED["T6"]["correlation"]["psi"][1],
    }
    return ChapterResult(
        "RNN architecture (Table 2), and Tables 4 to 6 as printed",
        f"{paper.inputs_count} inputs; 54-54 nodes with biases have {paper.weights_count} weights, 56-56 without "
        f"{other.weights_count}, the printed number.",
        read_claims("hess2000", "2").beside(quantities),
    )


def _slope_of_a_long_rudder() -> float:
    """Slope of the lift coefficient of a rudder of very large aspect ratio [1/rad]."""
    constants = ForceConstants(
        (0.6, -0.4), wake=0.2, deduction=0.1, diameter=0.03, rudder_area=1.0, rudder_aspect=LARGE_ASPECT,
        rudder_position=-0.5, volume=0.004, gm=0.006,
    )  # fmt: skip
    return RudderLift(constants).slope


def _inputs(names: tuple[str, ...]) -> dict[str, int]:
    """Inputs of each kind."""
    kinds = [name.partition("-")[0] for name in names]
    counts = {kind: kinds.count(kind) for kind in dict.fromkeys(kinds)}
    velocities = [kind for kind in counts if kind in {"u", "v", "w", "p", "q", "r"}]
    forces = {kind: count for kind, count in counts.items() if kind not in velocities}
    return {**forces, "velocities": sum(counts[kind] for kind in velocities), "total": len(names)}


def _percents() -> list[dict[str, Any]]:
    """Printed percent errors beside those that follow from printed absolute errors and scales."""
    rows = []
    for table, content in PRINTED.items():
        for variable, scale in content["scales"].items():
            for k, runs in enumerate(RUNS):
                error, half = content["absolute"][variable][k], LAST_DIGIT[variable]
                of = LAST_DIGIT_OF_SCALE[variable]
                rows.append({
                    "table": f"Table {table[1:]}", "variable": variable, "runs": runs,
                    "printed": content["percent"][variable][k], "computed": 100 * error / scale,
                    "low": 100 * (error - half) / (scale + of), "high": 100 * (error + half) / (scale - of),
                })  # fmt: skip
    return rows
