"""Cepowski 2007, rivals: trees, Gaussian processes, polynomials and formulas on the same splits as the networks."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, Literal

import numpy as np

from manoeuvre_nn.core.response import Quantities
from studies.cepowski2007.learners import (
    PAPERS,
    RECOMMENDED,
    Learn,
    back_propagation,
    general_regression,
    polynomial,
    radial_basis,
)
from studies.cepowski2007.packages import (
    boosted_trees,
    gaussian_process,
    has_scikit_learn,
    has_symbolic_regression,
    symbolic_regression,
)
from studies.cepowski2007.records import AS_PRINTED, PHYSICAL, RecordSets, record_sets, usual_method
from studies.cepowski2007.scores import approximate, halves
from studies.reproduction.claims import read_claims
from studies.reproduction.section import ChapterResult, ComputingEffort, Line, Panel, Plot, Say

COUNTS, QUICK_COUNTS = (50, 100, 200, 400, 800, 1600, 4400), (100, 400, 4400)
"""Records of the learning curve; half of them learn."""
SEEDS = 3
COUNT = 4400
"""Records of the table."""
METHODS: Mapping[str, Learn] = {
    "perceptron, 7 nodes": PAPERS,
    "perceptron, 7 nodes, shrunk": RECOMMENDED,
    "perceptron by back-propagation": back_propagation,
    "RBF": radial_basis,
    "GRNN": general_regression,
    "polynomial": polynomial,
    **({"boosted trees": boosted_trees, "Gaussian process": gaussian_process} if has_scikit_learn() else {}),
}
NETWORK = "perceptron, 7 nodes, shrunk"
SYMBOLIC = "symbolic regression"
CURVES = tuple(
    name
    for name in (NETWORK, "perceptron, 7 nodes", "RBF", "polynomial", "boosted trees", "Gaussian process")
    if name in METHODS
)
ROLES: Mapping[str, Literal["ours", "paper"]] = {NETWORK: "ours", "perceptron, 7 nodes": "paper"}
VIEWS: Mapping[str, Quantities] = {"as printed": AS_PRINTED, "physical": PHYSICAL}
ENOUGH_DEG = 0.15
"""RMS between the points of the grid that is asked for [deg]."""
Row = dict[str, Any]


def chapter(effort: ComputingEffort, say: Say) -> ChapterResult:
    """Rivals.

    Args:
        effort: How much computing is allowed.
        say: Told what is being done.

    Returns:
        Errors of all methods on the same splits, with both kinds of inputs, and learning curves.
    """
    sets = record_sets(usual_method(effort), say, seed=effort.seed)
    seeds = 1 if effort.quick else SEEDS
    table = rival_rows(sets, seeds, say, symbolic=has_symbolic_regression() and not effort.quick)
    curve = curve_rows(sets, QUICK_COUNTS if effort.quick else COUNTS, seeds, say)
    between = {(row["method"], row["inputs"]): row["between"] for row in table}
    best = min(between, key=lambda key: between[key])
    printed = min((value, name) for (name, view), value in between.items() if view == "as printed")
    quantities = {
        "best": f"{best[0]}, {best[1]} inputs: {between[best]:.3f}",
        "network": between[NETWORK, "physical"],
        "best_printed": printed[0],
        "best_printed_name": printed[1],
        "helped": sum(between[name, "physical"] < between[name, "as printed"] for name in METHODS),
        "methods": len(METHODS),
        "enough_at": _enough_at(curve, f"{NETWORK}, physical"),
    }
    said = "" if has_scikit_learn() else " Trees and Gaussian processes are left out: pip install -e .[rivals]."
    said += "" if has_symbolic_regression() else " Symbolic regression is left out: pyoperon is not installed."
    return ChapterResult(
        "Rivals",
        f"Best between the points of the grid: {quantities['best']} deg. No method with the printed inputs is better "
        f"than {printed[0]:.2f} deg there.{said}",
        read_claims("cepowski2007", "rivals").beside(quantities),
        {
            f"RMS errors [deg], median of {seeds} splits of {COUNT} records": table,
            "Learning curve: RMS between the points of the grid [deg]; half of the records learn": curve,
        },
        [curve_figure(curve)],
    )


def rival_rows(sets: RecordSets, seeds: int, say: Say, *, symbolic: bool) -> list[Row]:
    """All methods on the same splits.

    Args:
        sets: Records.
        seeds: Splits.
        say: Told what is being done.
        symbolic: Whether symbolic regression is tried; once, as it takes a minute.

    Returns:
        A row for each method and kind of inputs.
    """
    methods: list[tuple[str, Learn, int]] = [(name, learn, seeds) for name, learn in METHODS.items()]
    if symbolic:
        methods.append((SYMBOLIC, partial(symbolic_regression, length=50), 1))
    rows = []
    for name, learn, count in methods:
        for view, sees in VIEWS.items():
            found = []
            for seed in range(count):
                say(f"{name}, {view} inputs: split {seed + 1} of {count}")
                learnt, tested = halves(sets.grid, seed, COUNT)
                made = approximate(learn, sees, learnt, seed)
                found.append([made.rms(learnt), made.rms(tested), made.rms(sets.between), made.seconds])
            learning, testing, between, seconds = np.median(found, axis=0).tolist()
            rows.append({
                "method": name, "inputs": view, "learning": learning, "testing": testing, "between": between,
                "CPU [s]": seconds,
            })  # fmt: skip
    return rows


def curve_rows(sets: RecordSets, counts: Sequence[int], seeds: int, say: Say) -> list[Row]:
    """Errors between over the number of records, which are drawn from the grid.

    Args:
        sets: Records.
        counts: Numbers of records.
        seeds: Draws that medians are taken of.
        say: Told what is being done.

    Returns:
        A row a number, a column for each method and kind of inputs.
    """
    rows = []
    for count in counts:
        row: Row = {"records": count}
        for name in CURVES:
            for view, sees in VIEWS.items():
                say(f"{count} records: {name}, {view} inputs")
                draws = [halves(sets.grid, seed, count)[0] for seed in range(seeds)]
                errors = [approximate(METHODS[name], sees, one, k).rms(sets.between) for k, one in enumerate(draws)]
                row[f"{name}, {view}"] = float(np.median(errors))
        rows.append(row)
    return rows


def curve_figure(rows: Sequence[Row]) -> Plot:
    """Learning curves.

    Args:
        rows: Of :func:`curve_rows`.

    Returns:
        A panel for each kind of inputs.
    """
    count = np.log10(np.array([row["records"] for row in rows], dtype=float))
    panels = []
    for view in VIEWS:
        lines = [
            Line(name, count, np.array([row[f"{name}, {view}"] for row in rows]), ROLES.get(name, "other"))
            for name in CURVES
        ]
        title = f"inputs {view}"
        panels.append(Panel("log10 of the number of records", "RMS between [deg]", lines, title, log_y=True))
    return Plot("learning_curve", "Errors between the points of the grid over the number of records", panels)


def _enough_at(rows: Sequence[Row], column: str) -> float:
    """Number of records from which on a method is good enough; infinite if it never is."""
    good = [row["records"] for row in rows if row[column] <= ENOUGH_DEG]
    return float(min(good)) if good else float("inf")
