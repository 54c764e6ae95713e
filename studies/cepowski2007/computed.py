"""Cepowski 2007, the records: pitch of the S-175 by our own seakeeping, beside Eq. 3 (Figs 3-6)."""

from collections.abc import Mapping
from importlib.util import find_spec
from typing import Any

import numpy as np

from manoeuvre_nn.core.response import Records
from manoeuvre_nn.core.units import DEGREE
from studies.cepowski2007.published import AS_PRINTED, GRID, published_pitch
from studies.cepowski2007.records import INPUTS, RecordSets, record_sets, rms_deg, usual_method
from studies.reproduction.claims import read_claims
from studies.reproduction.section import ChapterResult, ComputingEffort, Line, Panel, Plot, Say

NAMES = tuple(v.name for v in INPUTS)
UNITS = {v.name: v.unit for v in INPUTS}
USUAL = {"d": 7.0, "V": 20.0, "Hs": 5.0, "T": 10.5}
"""What does not vary in Figs 3-6, as printed."""
FIGURES = {"3": "d", "4": "V", "5": "Hs", "6": "T"}
"""Figure -> what varies in it beside beta."""
Row = dict[str, Any]


def chapter(effort: ComputingEffort, say: Say) -> ChapterResult:
    """The records.

    Args:
        effort: How much computing is allowed.
        say: Told what is being done.

    Returns:
        Our records beside Eq. 3, by every method that there is.
    """
    methods = ["closed_form", "strip_theory"]
    if not effort.quick and find_spec("capytaine"):
        methods.append("boundary_element")
    usual = usual_method(effort)
    sets = {method: record_sets(method, say, seed=effort.seed) for method in {*methods, usual}}
    rows = [agreement(sets[method]) for method in methods]
    chosen = agreement(sets[usual])
    quantities = {
        "records": len(sets[usual].grid),
        "method": chosen["method"],
        "best": max(row["correlation"] for row in rows),
        "correlation": chosen["correlation"],
        "labelled": chosen["as labelled"],
        "rms": chosen["RMS [deg]"],
    }
    return ChapterResult(
        "The records (Figs 3-6)",
        f"Records by {chosen['method']} and Eq. 3 with the heading put right: correlation {chosen['correlation']:.3f}, "
        f"RMS {chosen['RMS [deg]']:.3f} deg; with the heading as the paper labels it {chosen['as labelled']:.2f}.",
        read_claims("cepowski2007", "records").beside(quantities),
        {"Our records beside Eq. 3": rows, "By heading": by_heading(sets[usual].grid)},
        [figure(number, sets[usual]) for number in FIGURES],
    )


def agreement(sets: RecordSets) -> Row:
    """Records beside Eq. 3.

    Args:
        sets: Records of one method.

    Returns:
        Correlation, RMS, mean difference on the grid, RMS between; and the correlation with the heading as labelled.
    """
    grid, between = sets.grid, sets.between
    published = published_pitch(grid.conditions)
    turned = grid.conditions.copy()
    turned[:, 2] = np.pi - turned[:, 2]
    return {
        "method": sets.method.replace("_", " "),
        "correlation": _correlation(grid.values, published),
        "RMS [deg]": rms_deg(grid.values - published),
        "mean difference [deg]": float(np.mean(grid.values - published)) / DEGREE,
        "RMS between [deg]": rms_deg(between.values - published_pitch(between.conditions)),
        "as labelled": _correlation(grid.values, published_pitch(turned)),
    }


def by_heading(grid: Records) -> list[Row]:
    """Where the records and Eq. 3 differ.

    Args:
        grid: Records.

    Returns:
        A row a heading.
    """
    wrong = grid.values - published_pitch(grid.conditions)
    found = []
    for beta in GRID["beta"]:
        here = np.isclose(grid.conditions[:, 2], beta)
        found.append({
            "beta [deg]": round(beta / DEGREE), "mean of ours [deg]": float(grid.values[here].mean()) / DEGREE,
            "mean difference [deg]": float(wrong[here].mean()) / DEGREE, "RMS [deg]": rms_deg(wrong[here]),
        })  # fmt: skip
    return found


def at(records: Records, fixed: Mapping[str, float]) -> Records:
    """Records at some values.

    Args:
        records: The records.
        fixed: Variable -> value in the unit of the edge.

    Returns:
        Those with these values, in order of the last variable that is not fixed.
    """
    units = records.conditions * AS_PRINTED
    here = np.all([np.isclose(units[:, NAMES.index(name)], value) for name, value in fixed.items()], axis=0)
    return records.at(np.flatnonzero(here))


def figure(number: str, sets: RecordSets) -> Plot:
    """One of Figs 3-6.

    Args:
        number: Of the figure.
        sets: The records.

    Returns:
        Pitch over heading, a panel for each value of what varies.
    """
    varying = FIGURES[number]
    fixed = {name: value for name, value in USUAL.items() if name != varying}
    column = NAMES.index(varying)
    values = np.unique(sets.grid.conditions[:, column]) * AS_PRINTED[column]
    panels = []
    for value in values:
        chosen = at(sets.grid, {**fixed, varying: float(value)})
        beta = chosen.conditions[:, 2] / DEGREE
        lines = [
            Line("Eq. 3", beta, published_pitch(chosen.conditions) / DEGREE, "paper"),
            Line("our records", beta, chosen.values / DEGREE, "ours"),
        ]
        title = f"{varying} = {value:g} {UNITS[varying]}"
        panels.append(Panel("heading beta [deg]", "pitch amplitude [deg]", lines, title))
    said = ", ".join(f"{name} {value:g} {UNITS[name]}" for name, value in fixed.items())
    caption = f"Fig. {number}: significant pitch amplitude, {said}; beta 0 following, 180 head sea"
    return Plot(f"figure_{number}", caption, panels)


def _correlation(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.corrcoef(a, b)[0, 1])
