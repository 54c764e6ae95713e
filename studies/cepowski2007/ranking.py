"""Cepowski 2007, the sensitivity analysis: which service parameter counts most."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.response import Records
from manoeuvre_nn.scoring.sensitivity import InputSensitivity, sensitivities
from studies.cepowski2007.computed import NAMES
from studies.cepowski2007.learners import PAPERS, RECOMMENDED
from studies.cepowski2007.published import published_pitch
from studies.cepowski2007.records import AS_PRINTED, PHYSICAL, record_sets, usual_method
from studies.cepowski2007.scores import approximate, halves
from studies.reproduction.claims import read_claims
from studies.reproduction.section import ChapterResult, ComputingEffort, Say

PAPER = ("beta", "Hs", "T", "d", "V")
"""Inputs by decreasing significance, as the paper has them."""
SPLITS, QUICK_SPLITS = 20, 4
Row = dict[str, Any]
Function = Callable[[Float[np.ndarray, "n 5"]], Float[np.ndarray, " n"]]


def chapter(effort: ComputingEffort, say: Say) -> ChapterResult:
    """The sensitivity analysis.

    Args:
        effort: How much computing is allowed.
        say: Told what is being done.

    Returns:
        Error ratios and Sobol indices of Eq. 3, of 5-7-1 networks and of the recommended one.
    """
    sets = record_sets(usual_method(effort), say, seed=effort.seed)
    splits = QUICK_SPLITS if effort.quick else SPLITS
    orders: list[tuple[str, ...]] = []
    ratios: list[list[float]] = []
    for seed in range(splits):
        say(f"5-7-1: split {seed + 1} of {splits}")
        learnt, _ = halves(sets.grid, seed)
        found = measured(approximate(PAPERS, AS_PRINTED, learnt, seed).pitch, learnt)
        orders.append(tuple(one.name for one in found))
        ratios.append([next(one.error_ratio for one in found if one.name == name) for name in PAPER])
    learnt, _ = halves(sets.grid, 0)
    say("Eq. 3 and the recommended network")
    tables = {
        "Eq. 3 on our records": measured(published_pitch, sets.grid),
        "5-7-1, first split": measured(approximate(PAPERS, AS_PRINTED, learnt).pitch, learnt),
        "recommended, first split": measured(approximate(RECOMMENDED, PHYSICAL, learnt).pitch, learnt),
    }
    median = dict(zip(PAPER, np.median(ratios, axis=0).tolist(), strict=True))
    ours = sorted(PAPER, key=lambda name: -median[name])
    quantities = {
        "order": _said(ours),
        "same": tuple(ours) == PAPER,
        "first_three": ours[:3] == list(PAPER[:3]),
        "same_share": [order == PAPER for order in orders],
        "published": _said([one.name for one in tables["Eq. 3 on our records"]]),
        "published_same": [one.name for one in tables["Eq. 3 on our records"]] == list(PAPER),
        "least": min(median.values()),
    }
    rows: list[Row] = [
        {"input": name, "median": median[name], "least": float(np.min(ratios, axis=0)[k]),
         "largest": float(np.max(ratios, axis=0)[k])}
        for k, name in enumerate(PAPER)
    ]  # fmt: skip
    return ChapterResult(
        "Sensitivity",
        f"Error ratios of 5-7-1 rank the inputs {quantities['order']}; the paper has {_said(PAPER)}.",
        read_claims("cepowski2007", "sensitivity").beside(quantities),
        {
            f"Error ratio of 5-7-1 when an input is put to its mean, over {splits} splits": rows,
            **{name: [one.row() for one in found] for name, found in tables.items()},
        },
    )


def measured(model: Function, records: Records) -> list[InputSensitivity]:
    """How much each input counts.

    Args:
        model: Conditions to pitch.
        records: Over which errors are taken.

    Returns:
        One an input, the most important first.
    """
    return sensitivities(model, NAMES, records.conditions, records.values)


def _said(order: Sequence[str]) -> str:
    return ", ".join(order)
