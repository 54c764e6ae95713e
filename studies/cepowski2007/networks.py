"""Cepowski 2007, the networks: 5-7-1, GRNN and RBF over many splits, off the grid, and what cures them there."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from manoeuvre_nn.core.response import Quantities, Records
from manoeuvre_nn.core.units import DEGREE
from studies.cepowski2007.learners import (
    PAPERS,
    RECOMMENDED,
    Learn,
    back_propagation,
    general_regression,
    perceptron,
    radial_basis,
)
from studies.cepowski2007.perceptrons import Structure
from studies.cepowski2007.records import AS_PRINTED, PHYSICAL, RecordSets, record_sets, usual_method
from studies.cepowski2007.scores import approximate, halves, without
from studies.reproduction.claims import read_claims
from studies.reproduction.section import ChapterResult, ComputingEffort, Line, Panel, Plot, Say

SPLITS, FEW_SPLITS, QUICK_SPLITS = 20, 3, 4
SPREAD_RECORDS = 4096
COUNTS = (50, 100, 200, 400, 800, 2048)
"""Records that are learnt, drawn from the grid or placed by a Sobol sequence."""
OVER_HEIGHT = replace(AS_PRINTED, sees=["d", "V", "beta", "T"], per="Hs")
COSINES = replace(AS_PRINTED, sees=["d", "V", "cos_beta", "T"], per="Hs")
WITH_HEIGHT = replace(PHYSICAL, sees=[*PHYSICAL.sees, "Hs"], per=None)
LEFT_OUT = (("d", 0, (5, 7, 9, 11)), ("V", 1, (0, 10, 20)), ("beta", 2, (60, 90)), ("Hs", 3, (3, 5)),
            ("T", 4, (6.5, 8.5, 10.5, 12.5, 14.5)))  # fmt: skip
PAIR: Mapping[str, tuple[Learn, Quantities]] = {"5-7-1": (PAPERS, AS_PRINTED), "recommended": (RECOMMENDED, PHYSICAL)}
SETS = ("learning", "testing", "between")
Row = dict[str, Any]
Method = tuple[str, Learn, Quantities, int]
"""Name, method, what it sees, splits."""


def chapter(effort: ComputingEffort, say: Say) -> ChapterResult:
    """The networks.

    Args:
        effort: How much computing is allowed.
        say: Told what is being done.

    Returns:
        Errors over many splits, the cures one by one, left-out values, and records placed by a Sobol sequence.
    """
    sets = record_sets(usual_method(effort), say, seed=effort.seed, spread=SPREAD_RECORDS)
    many, few = (QUICK_SPLITS, 1) if effort.quick else (SPLITS, FEW_SPLITS)
    errors = {name: over_splits(sets, learn, sees, n, say, name) for name, learn, sees, n in methods(many, few)}
    cures = {name: over_splits(sets, learn, sees, few * 2, say, name) for name, learn, sees in CURES}
    quantities: dict[str, Any] = {key: _medians(errors[name]) for key, name in KEYS.items()}
    quantities["most_accurate"] = _most_accurate(quantities)
    quantities["splits"] = many
    placed = placements(sets, few, say)
    return ChapterResult(
        "The networks",
        f"5-7-1: learning {quantities['papers']['learning']:.3f}, testing {quantities['papers']['testing']:.3f} deg as "
        f"printed, but {quantities['papers']['between']:.2f} deg between the points of the grid. With the frequency of "
        f"encounter and the wave number along the ship as inputs {quantities['recommended']['between']:.3f} deg.",
        read_claims("cepowski2007", "networks").beside(quantities),
        {
            f"RMS errors [deg], median and worst of splits; {BETWEEN_SAID}": _rows(errors),
            "What cures the errors between [deg]": _rows(cures),
            "A value left out: RMS error there [deg]": left_out(sets.grid, few, say),
            "Records placed by a Sobol sequence: RMS between [deg]": placed,
        },
        [placement_figure(placed)],
    )


BETWEEN_SAID = "between: 800 random points off the grid"
KEYS = {
    "papers": "5-7-1 as in the paper",
    "over_height": "4-14-1 for psi/H_s",
    "recommended": "4-7-1 with physical inputs, shrunk",
    "backprop": "5-7-1 by back-propagation",
    "grnn": "GRNN, one width",
    "rbf": "RBF, 300 nodes",
}


def methods(many: int, few: int) -> list[Method]:
    """Networks of the paper, and ours.

    Args:
        many: Splits of what is quick.
        few: Splits of what is slow.

    Returns:
        The methods.
    """
    named = {name: key for key, name in KEYS.items()}
    fourteen = partial(perceptron, structure=Structure(14))
    found: dict[str, tuple[Learn, Quantities, int]] = {
        "papers": (PAPERS, AS_PRINTED, many),
        "over_height": (fourteen, OVER_HEIGHT, many),
        "recommended": (RECOMMENDED, PHYSICAL, many),
        "backprop": (back_propagation, AS_PRINTED, few),
        "grnn": (partial(general_regression, common=True), AS_PRINTED, few),
        "rbf": (radial_basis, AS_PRINTED, few),
    }
    paper = [(name, *found[key]) for name, key in named.items()]
    own: list[Method] = [("GRNN, a width for every input", general_regression, AS_PRINTED, few)]
    return [*paper, *own]


CURES: Sequence[tuple[str, Learn, Quantities]] = (
    ("5-7-1: d, V, beta, H_s, T -> psi", PAPERS, AS_PRINTED),
    ("tanh for the sigmoid", partial(perceptron, structure=Structure(7)), AS_PRINTED),
    ("the best learner of 8 starts", partial(perceptron, structure=Structure(7, "sigmoid", 8)), AS_PRINTED),
    ("14 nodes", partial(perceptron, structure=Structure(14, "sigmoid")), AS_PRINTED),
    ("weights shrunk, ridge .01", partial(perceptron, structure=Structure(7, ridge=0.01)), AS_PRINTED),
    ("weights shrunk, ridge 1", partial(perceptron, structure=Structure(7, ridge=1.0)), AS_PRINTED),
    ("weights shrunk by the evidence", RECOMMENDED, AS_PRINTED),
    ("d, V, beta, T -> psi/H_s", partial(perceptron, structure=Structure(7)), OVER_HEIGHT),
    ("d, V, cos beta, T -> psi/H_s", partial(perceptron, structure=Structure(7)), COSINES),
    ("d, omega_e, k_x, T, H_s -> psi", partial(perceptron, structure=Structure(7)), WITH_HEIGHT),
    ("d, omega_e, k_x, T -> psi/H_s", partial(perceptron, structure=Structure(7)), PHYSICAL),
    ("the same, shrunk by the evidence: recommended", RECOMMENDED, PHYSICAL),
    ("the same with 5 nodes", partial(perceptron, structure=Structure(5, bayesian=True)), PHYSICAL),
    ("the same with 11 nodes", partial(perceptron, structure=Structure(11, bayesian=True)), PHYSICAL),
)


def over_splits(
    sets: RecordSets, learn: Learn, sees: Quantities, splits: int, say: Say, name: str
) -> dict[str, list[float]]:
    """Errors of a method over random halves.

    Args:
        sets: Records.
        learn: The method.
        sees: What it sees.
        splits: How many; the seed of each is that of the first weights too.
        say: Told what is being done.
        name: Of the method.

    Returns:
        RMS [deg] of learning, testing and between, and seconds, one for each split.
    """
    found: dict[str, list[float]] = {key: [] for key in (*SETS, "seconds")}
    for seed in range(splits):
        say(f"{name}: split {seed + 1} of {splits}")
        learnt, tested = halves(sets.grid, seed)
        made = approximate(learn, sees, learnt, seed)
        for key, records in zip(SETS, (learnt, tested, sets.between), strict=True):
            found[key].append(made.rms(records))
        found["seconds"].append(made.seconds)
    return found


def left_out(grid: Records, seeds: int, say: Say) -> list[Row]:
    """Errors at a value that no network saw.

    Args:
        grid: Records.
        seeds: First weights that medians are taken of.
        say: Told what is being done.

    Returns:
        A row a value.
    """
    rows = []
    for name, column, values in LEFT_OUT:
        size = grid.inputs[column].size
        for value in values:
            say(f"without {name} {value:g}")
            learnt, out = without(grid, column, value * size)
            errors = {
                name: [approximate(learn, sees, learnt, seed).rms(out) for seed in range(seeds)]
                for name, (learn, sees) in PAIR.items()
            }
            rows.append({
                "left out": f"{name} = {value:g} {grid.inputs[column].unit}",
                "mean pitch there": float(out.values.mean()) / DEGREE,
                **{name: float(np.median(found)) for name, found in errors.items()},
            })  # fmt: skip
    return rows


def placements(sets: RecordSets, seeds: int, say: Say) -> list[Row]:
    """Records drawn from the grid beside as many placed by a Sobol sequence.

    Args:
        sets: Records.
        seeds: Draws and first weights that medians are taken of.
        say: Told what is being done.

    Returns:
        RMS between [deg], a row a number of records.
    """
    rows = []
    for count in COUNTS:
        row: Row = {"records": count}
        draws: Mapping[str, Callable[[int], Records]] = {
            "grid": lambda seed, n=count: halves(sets.grid, seed, 2 * n)[0],  # type: ignore[misc]
            "Sobol": lambda seed, n=count: sets.spread.at(np.arange(n)),  # type: ignore[misc]
        }
        for name, (learn, sees) in PAIR.items():
            for place, draw in draws.items():
                say(f"{count} records, {place}, {name}")
                errors = [approximate(learn, sees, draw(seed), seed).rms(sets.between) for seed in range(2 * seeds)]
                row[f"{name}, {place}"] = float(np.median(errors))
        rows.append(row)
    return rows


def placement_figure(rows: Sequence[Row]) -> Plot:
    """Errors between over the number of records.

    Args:
        rows: Of :func:`placements`.

    Returns:
        The plot.
    """
    count = np.array([row["records"] for row in rows], dtype=float)
    names = ("5-7-1, grid", "5-7-1, Sobol", "recommended, grid", "recommended, Sobol")
    found = {name: np.array([row[name] for row in rows]) for name in names}
    lines = [Line(name, np.log10(count), e, "ours" if "recommended" in name else "paper") for name, e in found.items()]
    panel = Panel("log10 of the number of records learnt", "RMS between [deg]", lines, log_y=True)
    return Plot("placement", "Records drawn from the paper's grid, and placed by a Sobol sequence", [panel])


def _medians(errors: Mapping[str, Sequence[float]]) -> dict[str, float]:
    return {key: float(np.median(values)) for key, values in errors.items()}


def _rows(methods: Mapping[str, Mapping[str, Sequence[float]]]) -> list[Row]:
    """Median and worst of each method."""
    rows: list[Row] = []
    for name, errors in methods.items():
        row: Row = {"network": name, "splits": len(errors["learning"])}
        for key in SETS:
            row[key], row[f"{key}, worst"] = float(np.median(errors[key])), float(max(errors[key]))
        rows.append(row | {"CPU [s]": float(np.median(errors["seconds"]))})
    return rows


def _most_accurate(found: Mapping[str, Mapping[str, float]]) -> bool:
    """Whether 5-7-1 tests better than the GRNN and the RBF, as the paper has them."""
    return found["papers"]["testing"] < min(found["grnn"]["testing"], found["rbf"]["testing"])
