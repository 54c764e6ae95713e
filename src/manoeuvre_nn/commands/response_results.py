"""What the approximation of a response leaves behind: errors, records, figures, report, and a table in the terminal."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from jaxtyping import Float
from rich.console import Console

from manoeuvre_nn.commands.provenance import SCORES, hyperparameters, shown, versions
from manoeuvre_nn.core.response import Records, Response
from manoeuvre_nn.core.terminal import Say
from manoeuvre_nn.core.writing import draft_of, write_file
from manoeuvre_nn.numerics.finite_algebra import lstsq
from manoeuvre_nn.report.figures import learning_figure
from manoeuvre_nn.report.html import Report, save_figures, write_report
from manoeuvre_nn.report.response_figures import response_figures
from manoeuvre_nn.report.sensitivity_figure import sensitivity_figure
from manoeuvre_nn.report.tables import Row, is_good, rich_table, verdict_text
from manoeuvre_nn.scoring.sensitivity import InputSensitivity, sensitivities
from manoeuvre_nn.scoring.verdict import ModelVerdict, response_verdict
from manoeuvre_nn.training.response_data import BETWEEN, LEARNING, TESTING, VALIDATION, ResponseData, errors_of
from manoeuvre_nn.training.session import Trained

RECORDS = "records.csv"
TRAP = 1.5
"""Error between over that of testing from which on it is said how much larger it is."""


@dataclass(frozen=True)
class _ResponseOutcome:
    """A finished run.

    Attributes:
        config: Resolved config.
        data: The records.
        trained: How the training went.
        response: The approximation, in double precision.
    """

    config: Mapping[str, Any]
    data: ResponseData
    trained: Trained
    response: Response

    @cached_property
    def errors(self) -> dict[str, dict[str, float]]:
        """Errors of every set of records, in the unit of the response."""
        return self.data.errors(self.response)

    @cached_property
    def sensitivities(self) -> list[InputSensitivity]:
        """How much each variable counts, the first on top; over the ranges of the records."""
        found = self.data.sets[self.tested]
        names = [v.name for v in self.response.inputs]
        ranges = self.response.ranges.numpy()
        measured = sensitivities(self.response.at, names, found.conditions, found.values, ranges)
        return sorted(measured, key=lambda one: -one.error_ratio)

    @property
    def tested(self) -> str:
        """The set that says how good the network is."""
        return TESTING if TESTING in self.errors else LEARNING

    @property
    def error(self) -> float:
        """What a search for settings makes small: the error of records kept for validation, else of those that test."""
        return self.errors[VALIDATION if VALIDATION in self.errors else self.tested]["rms"]

    @cached_property
    def verdict(self) -> ModelVerdict:
        """What the network may be used for, by records that it was not trained on."""
        errors, sets, unit = self.errors, self.data.sets, self.data.quantities.output
        tested = [name for name in (TESTING, BETWEEN) if name in errors]
        learnt = sets[LEARNING]
        plane = lstsq(_with_ones(learnt), learnt.values)
        return response_verdict(
            {name: errors[name]["rms"] for name in tested},
            {name: float(sets[name].values.std()) / unit.size for name in tested},
            {name: errors_of(sets[name], _with_ones(sets[name]) @ plane)["rms"] for name in tested},
            _how_far(self),
        )

    @property
    def in_short(self) -> str:
        """What came out, in a few words."""
        return f"{self.tested} RMS {self.errors[self.tested]['rms']:.3g} {self.data.quantities.output.unit}"

    @property
    def rows(self) -> list[Row]:
        """The table of errors."""
        unit, sets = self.data.quantities.output.unit, self.data.sets
        return [
            {
                "records": name,
                "number": len(sets[name]),
                f"RMS [{unit}]": e["rms"],
                f"mean error [{unit}]": e["mean"],
                f"largest [{unit}]": e["largest"],
                "correlation": e["correlation"],
            }
            for name, e in self.errors.items()
        ]


def score_response(config: Mapping[str, Any], trained: Trained, data: ResponseData, say: Say) -> _ResponseOutcome:
    """Score the network that is kept; that takes no time that is worth a word."""
    response = trained.fit.double().cpu().dynamics
    assert isinstance(response, Response)
    return _ResponseOutcome(config, data, trained, response)


def _with_ones(records: Records) -> Float[np.ndarray, "n m"]:
    """What a linear function of all variables is made of."""
    return np.column_stack([np.ones(len(records)), records.conditions])


def _how_far(outcome: _ResponseOutcome) -> str:
    """How far the network is off where it was not trained."""
    unit, errors = outcome.data.quantities.output.unit, outcome.errors
    seen = "that it was not trained on" if TESTING in errors else "that it was trained on, for none was kept to test it"
    tested = errors[outcome.tested]["rms"]
    text = f"the network is off by {tested:.3g} {unit} (root mean square) on records {seen}"
    if BETWEEN not in errors:
        return text + "; how it does between the values of the records, they cannot tell"
    between = errors[BETWEEN]["rms"]
    times = f", {between / tested:.2g} times as much" if between > TRAP * tested else ""
    largest = f"largest {errors[BETWEEN]['largest']:.3g}"
    return f"{text}, and by {between:.3g} {unit} ({largest}) at random points between{times}"


def write_response(outcome: _ResponseOutcome, out: Path) -> None:
    """Write records, figures, report, TensorBoard's last entries; ``scores.json`` last, as the mark of the end."""
    with draft_of(out / RECORDS) as draft:
        pd.DataFrame(outcome.data.records.in_units()).to_csv(draft, index=False)
    drawn = response_figures(outcome.data, outcome.response)
    drawn["Errors/how much each variable counts"] = sensitivity_figure(outcome.sensitivities)
    if outcome.trained.history:
        drawn["training/learning"] = learning_figure(outcome.trained.history)
    for name, path in save_figures(drawn, out / "figures").items():
        for logger in outcome.trained.loggers:
            logger.add_picture(name, path, outcome.trained.epochs)
    tables: dict[str, Sequence[Row]] = {"Errors": outcome.rows, "Variables": variable_rows(outcome)}
    tables["How much each variable counts"] = [one.row() for one in outcome.sensitivities]
    report = Report(
        title=f"{outcome.config['name']}: trained and tested",
        summary=outcome.verdict.sentence,
        good=is_good(outcome.verdict.word),
        tables=tables,
        figures=drawn,
        config=outcome.config,
        versions=versions(),
        notes=[*told_in_notes(outcome.data), outcome.trained.chosen],
    )
    write_report(out / "report.html", report)
    errors = {f"{name}/rms": e["rms"] for name, e in outcome.errors.items()}
    for logger in outcome.trained.loggers:
        logger.end(hyperparameters(outcome.config, out), errors, outcome.trained.epochs)
    write_file(out / SCORES, json.dumps(as_dict(outcome), indent=1))


def variable_rows(outcome: _ResponseOutcome) -> list[Row]:
    """What the response is a function of, and over which range it was learnt."""
    return [
        {
            "variable": v.name,
            "meaning": v.meaning,
            "unit": v.unit,
            "from": v.low / v.size,
            "to": v.high / v.size,
        }
        for v in outcome.response.inputs
    ]


def told_in_notes(data: ResponseData) -> list[str]:
    """Number and source of the records, what the network sees, and what should be known of the records."""
    per, sees = data.quantities.per, [name.replace("_", " ") for name in data.quantities.sees]
    seen = f"The network sees {', '.join(sees)}" + (f"; its output is multiplied by {per}." if per else ".")
    return [data.describe(), seen, *data.remarks()]


def as_dict(outcome: _ResponseOutcome) -> dict[str, Any]:
    """What ``scores.json`` holds: plain numbers and strings."""
    trained, learnt = outcome.trained, outcome.data.sets[LEARNING]
    return {
        "verdict": outcome.verdict.as_dict(),
        "errors": outcome.errors,
        "unit": outcome.data.quantities.output.unit,
        "error": outcome.error,
        "sensitivities": {
            one.name: {k: v for k, v in one.row().items() if k != "input"} for one in outcome.sensitivities
        },
        "training": {
            "samples": len(learnt),
            "epochs": trained.epochs,
            "stopped": trained.stopped,
            "seconds": round(trained.seconds, 3),
        },
        "seed": outcome.config["seed"],
        "chosen": trained.chosen,
        "versions": versions(),
    }


def print_response(outcome: _ResponseOutcome, out: Path, console: Console) -> None:
    """One table in the terminal, the verdict, and where the rest is."""
    output, how = outcome.data.quantities.output, outcome.trained
    console.print(rich_table(outcome.rows, output.meaning or output.name))
    told = f"{outcome.data.describe()} {how.epochs} epochs in {how.seconds:.1f} s; {how.stopped}."
    console.print(verdict_text(outcome.verdict), soft_wrap=True, highlight=False)
    console.print(told, soft_wrap=True, highlight=False)
    here = shown(out)
    logs = [logger.shown_by(here) for logger in outcome.trained.loggers]
    console.print("   ".join([f"report: {here / 'report.html'}", *logs]), soft_wrap=True)
