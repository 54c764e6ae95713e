"""Tables 4 to 6 of Hess & Faller 2000 beside ours: trainings, rivals on the same runs, claims and figures."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from manoeuvre_nn.core.frames import earth_to_body
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.scoring.error_measures import MEAN, MEASURES, VARIABLES, normalisations
from manoeuvre_nn.training.recursive_windows import USUAL_STAGES
from studies.hess2000.architecture import PRINTED, RUNS
from studies.hess2000.rivals import LINEAR, SERIES, rival_tables, rivals
from studies.hess2000.runs import CIRCLES, OVERSHOOTS, Counts, RunSet, circles, overshoots
from studies.hess2000.training import (
    OVERSHOOT_STAGES,
    TrainedSimulator,
    measures_of,
    median_measures,
    recursive_network,
)
from studies.reproduction.claims import read_claims
from studies.reproduction.section import ChapterResult, ComputingEffort, Line, Panel, Plot, Say

SEEDS = 3
QUICK = {"T4": Counts(3, 1, 1), "T5": Counts(4, 1, 1), "T6": Counts(3, 1, 2)}
"""Runs of the short form."""
FULL = {"T4": CIRCLES[1], "T5": CIRCLES[2], "T6": OVERSHOOTS}
TITLES = {
    "T4": "Table 4: tactical circles of ship 1",
    "T5": "Table 5: tactical circles of ship 2",
    "T6": "Table 6: horizontal overshoots of ship 2",
}
FIGURES = {"T4": ("8",), "T5": ("9", "10"), "T6": ("11", "12")}
"""The paper's figures of tracks, and of motion over time where there is one."""
WITH_RIVALS = ("T4", "T6")
SHOWN = 4
"""Training runs whose tracks are drawn, as in the paper."""
OVER_TIME = {"u": "u [m/s]", "phi": "phi [deg]", "psi": "psi [deg]", "v": "v [m/s]", "p": "p [deg/s]", "r": "r [deg/s]"}
IN_DEGREES = ("phi", "psi", "p", "r")
ROUNDING = {"percent": 0.05, "average_angle": -0.0005, "correlation": -0.0005, "absolute": 0.0}
"""What the last printed digit leaves open."""
Row = dict[str, Any]


def table_chapter(table: str, effort: ComputingEffort, say: Say) -> ChapterResult:
    """A table of the paper done again.

    Args:
        table: ``T4``, ``T5`` or ``T6``.
        effort: How much computing is allowed.
        say: Told what is being done.

    Returns:
        Errors beside the paper's, for two of the tables beside rivals too.
    """
    say("sailing")
    runs = run_set(table, effort)
    models = trainings(table, runs, effort, say)
    others = list(rivals(runs, effort.seed, quick=effort.quick, say=say)) if table in WITH_RIVALS else []
    return told(table, models, others, runs)


def told(
    table: str, models: Sequence[TrainedSimulator], others: Sequence[TrainedSimulator], runs: RunSet
) -> ChapterResult:
    """A table done again, once all is trained.

    Args:
        table: ``T4``, ``T5`` or ``T6``.
        models: Recursive networks from some seeds.
        others: Rivals, if any.
        runs: The runs.

    Returns:
        Claims, tables, figures.
    """
    found = quantities(table, models, runs)
    beside = error_tables(table, models, runs)
    if others:
        compared = rival_tables(models, others, runs)
        found |= rival_quantities(compared["unseen"])
        beside |= {f"Rivals, {part} runs: percent errors": rows for part, rows in compared.items()}
    return ChapterResult(
        TITLES[table],
        f"Percent errors of speed, x, heading: at most {found['worst_but_y_all']:.2g} over all runs; of y "
        f"{found['y_all']:.2g} over all, {found['y_unseen']:.2g} over unseen runs (paper, all: "
        f"{PRINTED[table]['percent']['y'][0]:g}).",
        read_claims("hess2000", table[1:]).beside(found),
        beside,
        figures(table, models[0], runs),
    )


def rival_quantities(rows: Sequence[Row]) -> dict[str, Any]:
    """What the claims say of rivals.

    Args:
        rows: Errors of unseen runs, the recursive network first.

    Returns:
        Quantities by name.
    """
    named = {"network": rows[0], **{row["simulator"]: row for row in rows[1:]}}
    keys = {"network": "network", "LSTM": "LSTM", "GRU": "GRU", "linear": LINEAR}
    mean = {key: float(named[name][MEAN]) for key, name in keys.items()}
    return {
        "mean": mean,
        "mean_y": {"network": float(rows[0]["y"])},
        "best_series_y": min(float(named[name]["y"]) for name in SERIES.values()),
        "beats_gated": mean["network"] < min(mean["LSTM"], mean["GRU"]),
        "beats_linear": mean["network"] < mean["linear"],
    }


def run_set(table: str, effort: ComputingEffort) -> RunSet:
    """The runs that a table is about.

    Args:
        table: ``T4``, ``T5`` or ``T6``.
        effort: Seed, and whether it is the short form.

    Returns:
        The runs.
    """
    counts = (QUICK if effort.quick else FULL)[table]
    return overshoots("", effort.seed, counts) if table == "T6" else circles(int(table[1]) - 3, effort.seed, counts)


def trainings(table: str, runs: RunSet, effort: ComputingEffort, say: Say) -> list[TrainedSimulator]:
    """Recursive networks from some seeds.

    Args:
        table: ``T4``, ``T5`` or ``T6``, which has stages of its own.
        runs: The runs.
        effort: First seed, how many at most, and whether it is the short form.
        say: Told how far it is.

    Returns:
        One a seed: 3, in the short form 1.
    """
    seeds = 1 if effort.quick else min(effort.starts, SEEDS)
    stages = OVERSHOOT_STAGES if table == "T6" else USUAL_STAGES
    numbers = [effort.seed + k for k in range(seeds)]
    return [recursive_network(runs, seed, stages=stages, quick=effort.quick, say=say) for seed in numbers]


def cells(table: str, measures: pd.DataFrame) -> dict[str, list[Row]]:
    """Printed cells beside ours.

    Args:
        table: ``T4``, ``T5`` or ``T6``.
        measures: Ours, medians over the seeds.

    Returns:
        Measure -> a row a cell, with what still counts as printed, and what does in direction.
    """
    found: dict[str, list[Row]] = {name: [] for name in MEASURES}
    for name in MEASURES:
        for variable, unit in VARIABLES.items():
            for k, part in enumerate(RUNS):
                printed = float(PRINTED[table][name][variable][k])
                rounded = printed + ROUNDING[name]
                larger = 1.5 * rounded if name == "percent" else rounded - 0.05
                found[name].append({
                    "where": f"Table {table[1:]}", "variable": variable, "runs": f"{part} runs", "printed": printed,
                    "ours": float(measures[name][part, variable]), "rounded": rounded, "larger": larger,
                    "unit": unit,
                })  # fmt: skip
    return found


def quantities(table: str, models: Sequence[TrainedSimulator], runs: RunSet) -> dict[str, Any]:
    """What the claims of a table are about.

    Args:
        table: ``T4``, ``T5`` or ``T6``.
        models: Networks from some seeds.
        runs: The runs.

    Returns:
        Quantities by name.
    """
    measures = median_measures(models, runs)
    percent = {part: _percent(measures, part) for part in ("all", "validation", "unseen")}
    but_phi, but_y = ["u", "x", "y", "psi"], ["u", "x", "psi"]
    hardest = max(VARIABLES, key=lambda name: percent["all"][name])
    validation = [percent["validation"][name] for name in but_phi]
    return {
        **cells(table, measures),
        "where": f"Table {table[1:]}",
        "worst_all": max(percent["all"][name] for name in but_phi),
        "worst_validation": max(validation),
        "least_validation": min(validation),
        "worst_but_y_all": max(percent["all"][name] for name in but_y),
        "worst_but_y_validation": max(percent["validation"][name] for name in but_y),
        "y_all": percent["all"]["y"],
        "y_unseen": percent["unseen"]["y"],
        "hardest": hardest,
        "roll_is_hardest": hardest == "phi",
        "stopped": float(np.median([model.stopped for model in models])),
        "largest_training_m": float(np.median([_largest_deviation(model, runs.training) for model in models])),
        "length": runs.ship.particulars.length,
    }


def _percent(measures: pd.DataFrame, part: str) -> dict[str, float]:
    """Percent errors of a set of runs by variable."""
    return {str(name): float(value) for name, value in measures.loc[part]["percent"].items()}


def _largest_deviation(model: TrainedSimulator, runs: Sequence[Recording]) -> float:
    """Largest distance of predicted from recorded positions at the same time [m]."""
    worst = 0.0
    for made, run in zip(model.predict(runs), runs, strict=True):
        x, y = (np.interp(run.time, made.time, made[axis]) - run[axis] for axis in ("x", "y"))
        worst = max(worst, float(np.hypot(x, y).max()))
    return worst


def error_tables(table: str, models: Sequence[TrainedSimulator], runs: RunSet) -> dict[str, list[Row]]:
    """Percent errors of the paper, of every seed and their median; trainings; normalisations.

    Args:
        table: ``T4``, ``T5`` or ``T6``.
        models: Networks from some seeds.
        runs: The runs.

    Returns:
        Heading -> rows.
    """
    rows: list[Row] = []
    for k, part in enumerate(RUNS):
        rows.append({"runs": part, "by": "paper", **{v: PRINTED[table]["percent"][v][k] for v in VARIABLES}})
    per_seed = [measures_of(model, runs)["percent"].unstack() for model in models]
    for part in per_seed[0].index:
        stacked = pd.concat([one.loc[part] for one in per_seed], axis=1)
        rows.append({"runs": part, "by": "ours, median", **stacked.median(axis=1)[[*VARIABLES, MEAN]].to_dict()})
        for number, one in enumerate(per_seed):
            rows.append({"runs": part, "by": f"ours, seed {number}", **one.loc[part, [*VARIABLES, MEAN]].to_dict()})
    rows.sort(key=lambda row: (["all", "validation", "unseen"].index(str(row["runs"])), row["by"] != "paper"))
    own = normalisations(runs.own).iloc[0]
    made = [
        {"seed": k, "weights": model.weights, "CPU [s]": round(model.seconds), "stopped at": round(model.stopped, 2)}
        for k, model in enumerate(models)
    ]
    return {
        "Percent errors": rows,
        "What they are percent of": [
            {"by": "paper", **PRINTED[table]["scales"]},
            {"by": "ours", **{name: float(own[name]) for name in VARIABLES}},
        ],
        "Trainings": made,
    }


def figures(table: str, model: TrainedSimulator, runs: RunSet) -> list[Plot]:
    """The paper's figures: generalization over the training, tracks, and motion over time.

    Args:
        table: ``T4``, ``T5`` or ``T6``.
        model: A network.
        runs: The runs.

    Returns:
        The plots.
    """
    tracks, *over_time = FIGURES[table]
    drawn = [*runs.training[:SHOWN], *runs.validation[:SHOWN]]
    made = model.predict(drawn)
    panels = [
        _tracks(run, prediction, " (val.)" if run in runs.validation else "")
        for run, prediction in zip(drawn, made, strict=True)
    ]
    found = [_generalization(table, model)]
    found.append(Plot(f"figure_{tracks}", f"Fig. {tracks}: tracks, training runs, and validation runs (val.)", panels))
    pairs = [(runs.training[0], made[0]), (runs.validation[0], made[min(SHOWN, len(runs.training))])]
    for run, prediction in pairs:
        kind = "validation" if run is runs.validation[0] else "training"
        name = f"Fig. {over_time[0]}" if over_time else f"As Fig. 10, Table {table[1:]}"
        found.append(Plot(f"{table}_{kind}", f"{name}: {kind} run {_short(run)}", _over_time(run, prediction)))
    return found


def _generalization(table: str, model: TrainedSimulator) -> Plot:
    """As Fig. 7."""
    assert model.history is not None
    updates = model.history["update"].to_numpy(dtype=float)
    names = {
        "absolute": "absolute error",
        "average_angle": "1 - angle measure",
        "correlation": "1 - correlation",
    }
    panels = []
    for key, label in names.items():
        values = model.history[key].to_numpy(dtype=float)
        panels.append(
            Panel("updates", label, [Line("", updates, values if key == "absolute" else 1 - values)], log_y=True)
        )
    return Plot(
        f"{table}_generalization",
        f"As Fig. 7: error over training and validation runs (absolute: mean of m/s, m, deg), Table {table[1:]}",
        panels,
    )


def _over_time(run: Recording, prediction: Recording) -> list[Panel]:
    """Panels of the quantities of Figs 10 and 12 that ships of four degrees of freedom have."""
    panels = []
    for name, label in OVER_TIME.items():
        unit = DEGREE if name in IN_DEGREES else 1.0
        lines = [
            Line("recorded", run.time, run[name] / unit, "reference"),
            Line("predicted", prediction.time, prediction[name] / unit),
        ]
        panels.append(Panel("time [s]", label, lines))
    return panels


def _tracks(run: Recording, prediction: Recording, what: str) -> Panel:
    """Recorded and predicted track; those of overshoots along the approach, on two scales."""
    lines, turns = [], run.meta["kind"] == "turning_circle"
    for one, label in ((run, "recorded"), (prediction, "predicted")):
        x, y = (one[axis] - run[axis][0] for axis in ("x", "y"))
        ahead, aside = earth_to_body(x, y, np.full(len(one), run["psi"][0]))
        across, along = (aside, ahead) if turns else (ahead, aside)
        lines.append(Line(label, across, along, "reference" if label == "recorded" else "ours"))
    labels = ("y [m]", "x [m]") if turns else ("x [m]", "y [m]")
    return Panel(*labels, lines, _short(run) + what, equal=turns)


def _short(run: Recording) -> str:
    """``circle20 port 16.2 kn``."""
    return run.name.partition("_")[2].replace("_", " ").replace("kn", " kn")
