"""What a run leaves behind: scores, predictions, figures, report, and a table in the terminal."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from rich.console import Console

from manoeuvre_nn.commands.coefficients import coefficients_of, write_coefficients
from manoeuvre_nn.commands.provenance import SCORES, hyperparameters, shown, versions
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.terminal import Say
from manoeuvre_nn.core.writing import write_file
from manoeuvre_nn.dynamics.model import IdentifiedShip
from manoeuvre_nn.estimation.baselines import fit_baselines
from manoeuvre_nn.manoeuvre.imo import imo_table
from manoeuvre_nn.report import coefficient_tables
from manoeuvre_nn.report.chart import Chart
from manoeuvre_nn.report.figures import draw_comparison, excitation_figure, force_figure, learning_figure
from manoeuvre_nn.report.html import Report, save_figures, write_report
from manoeuvre_nn.report.manoeuvre_charts import comparison_charts
from manoeuvre_nn.report.tables import (
    Row,
    criteria_rows,
    is_good,
    main_criteria_rows,
    rich_table,
    score_rows,
    score_table,
    verdict_text,
)
from manoeuvre_nn.report.track_marks import effect_arrows
from manoeuvre_nn.scoring.held_out import HeldOut
from manoeuvre_nn.scoring.score import Score
from manoeuvre_nn.scoring.verdict import ModelVerdict, model_verdict
from manoeuvre_nn.training.closed_loop_fit import ClosedLoopFit
from manoeuvre_nn.training.data import ManoeuvreData
from manoeuvre_nn.training.rollout_score import scalars
from manoeuvre_nn.training.session import Trained

IMO = "IMO MSC.137(76), predicted"


@dataclass(frozen=True)
class _Outcome:
    """A finished run.

    Attributes:
        config: Resolved config.
        data: What it was trained on, and what it is judged by.
        trained: How the training went.
        predictions: Prediction of each held-out manoeuvre.
        members: Predictions of an ensemble's members, by held-out manoeuvre.
        scores: Held-out manoeuvres.
        training_scores: The manoeuvres that were trained on, sailed in closed loop.
        baselines: Simpler models -> their scores on the same manoeuvres.
        notes: What the simpler models know.
    """

    config: Mapping[str, Any]
    data: ManoeuvreData
    trained: Trained
    predictions: Sequence[Recording]
    members: Sequence[Sequence[Recording]]
    scores: Sequence[Score]
    training_scores: Sequence[Score]
    baselines: Mapping[str, Sequence[Score]]
    notes: Sequence[str]

    @property
    def mean_dev(self) -> float:
        """Mean over the held-out manoeuvres of the largest deviation over L [-]."""
        return float(np.mean([s.dev_L for s in self.scores]))

    @property
    def worst(self) -> Score:
        """The held-out manoeuvre that is predicted worst."""
        return max(self.scores, key=lambda s: s.dev_L)

    @property
    def error(self) -> float:
        """What a search for settings makes small."""
        return self.mean_dev

    @property
    def in_short(self) -> str:
        """What came out, in a few words."""
        return f"mean dev {self.mean_dev:.3g} L"

    @cached_property
    def relative_rmse(self) -> dict[str, float]:
        """Error of what the network gives on the training data, g1, g2, g3, over its root mean square [-]."""
        tuples = self.data.tuples
        errors = self.trained.fit.relative_rmse(tuples.inputs.double(), tuples.targets.double())
        return {name: float(error) for name, error in zip(self.trained.fit.errors_of, errors, strict=True)}

    @cached_property
    def verdict(self) -> ModelVerdict:
        """What the model may be used for."""
        return model_verdict(self.scores, self.data.held_out.references, self.baselines, self.data.recordings)

    @cached_property
    def charts(self) -> dict[str, dict[str, Chart]]:
        """What is shown of each held-out manoeuvre: manoeuvre -> name -> chart."""
        ship, arrows = self.trained.fit.dynamics.particulars, effect_arrows(self.config.get("effect") or {})
        runs = zip(self.data.held_out.references, self.predictions, self.members, strict=True)
        return {r.name: comparison_charts(r, p, members, ship.beam / ship.length, arrows) for r, p, members in runs}

    @cached_property
    def imo(self) -> list[dict[str, Any]]:
        """IMO criteria of the predictions, each at the angles that its reference was steered by."""
        found = [score.criteria for score in self.scores]
        trials = zip(self.data.held_out.references, found, strict=True)
        return imo_table(trials, self.trained.fit.dynamics.particulars, self.verdict.unfit)


def score_finally(
    config: Mapping[str, Any], trained: Trained, data: ManoeuvreData, say: Say = lambda *_: None
) -> _Outcome:
    """Score the network that is kept, on the held-out manoeuvres and on those that it was trained on."""
    model = trained.fit.double().cpu().dynamics
    held_out, known = data.held_out, HeldOut(tuple(data.recordings), data.held_out.length)
    say("scoring: the held-out manoeuvres", 0.0)
    predictions = held_out.predict(model)
    say("scoring: the members of the ensemble", 1 / 4)
    members = held_out.predict_members(model)
    say("scoring: simpler models", 1 / 2)
    baselines, missing = fit_baselines(data.reference, data.known, data.tuples)
    beside = {r.name: held_out.score(held_out.predict(r.dynamics, "rollout")) for r in baselines}
    say("scoring: criteria as steered", 3 / 4)
    scores = held_out.score(predictions, members, held_out.steer(model))
    say("scoring: the manoeuvres that were trained on", 3 / 4)
    return _Outcome(
        config=config,
        data=data,
        trained=trained,
        predictions=predictions,
        members=members,
        scores=scores,
        training_scores=known.score(known.predict(model)),
        baselines=beside,
        notes=[f"Beside the network: {r.name}: {r.note}." for r in baselines] + [f"Missing: {m}." for m in missing],
    )


def figures(outcome: _Outcome) -> dict[str, Figure]:
    """All figures of a run: ``manoeuvre/name`` -> figure."""
    references, fit, tuples = outcome.data.held_out.references, outcome.trained.fit, outcome.data.tuples
    made = {
        f"{run}/{name}": figure
        for run, of_run in outcome.charts.items()
        for name, figure in draw_comparison(of_run, run).items()
    }
    inputs, units = tuples.inputs.double(), fit.dynamics.hull.velocity_units.double().numpy()
    if isinstance(fit.dynamics, IdentifiedShip):
        network = fit.unknown_force(inputs).numpy()
        made["training/forces"] = force_figure(tuples.times.numpy(), tuples.targets.double().numpy(), network)
    sailed = {r.name: np.column_stack([r.stacked("u", "v", "r") / units, r["delta"]]) for r in references}
    made["training/excitation"] = excitation_figure(inputs.numpy(), sailed)
    if outcome.trained.history:
        made["training/learning"] = learning_figure(outcome.trained.history)
    return made


def as_dict(outcome: _Outcome) -> dict[str, Any]:
    """What ``scores.json`` holds: plain numbers and strings."""
    return {
        "verdict": outcome.verdict.as_dict(),
        "scores": {s.manoeuvre: s.as_dict() for s in outcome.scores},
        "mean_dev_L": outcome.mean_dev,
        "baselines": {name: {s.manoeuvre: s.dev_L for s in scores} for name, scores in outcome.baselines.items()},
        "trained_on": {s.manoeuvre: s.as_dict() for s in outcome.training_scores},
        "training": {
            "relrmse": outcome.relative_rmse,
            "samples": len(outcome.data.tuples.times),
            "epochs": outcome.trained.epochs,
            "stopped": outcome.trained.stopped,
            "seconds": round(outcome.trained.seconds, 3),
        },
        "seed": outcome.config["seed"],
        "chosen": outcome.trained.chosen,
        "versions": versions(),
    }


def write_results(outcome: _Outcome, out: Path) -> None:
    """Write predictions, figures, report, TensorBoard's last entries; ``scores.json`` last, as the mark of the end."""
    for reference, prediction in zip(outcome.data.held_out.references, outcome.predictions, strict=True):
        prediction.to_csv(out / "predictions" / f"{reference.name}.csv")
    drawn = figures(outcome)
    for name, path in save_figures(drawn, out / "figures").items():
        for logger in outcome.trained.loggers:
            logger.add_picture(name, path, outcome.trained.epochs)
    tables: dict[str, Sequence[Row]] = {
        "Held-out manoeuvres": score_rows(outcome.scores, outcome.baselines),
        "Manoeuvres that were trained on, in closed loop": score_rows(outcome.training_scores),
        "Main criteria of all": main_criteria_rows([*outcome.scores, *outcome.training_scores]),
        IMO: outcome.imo,
        "All criteria of the held-out manoeuvres": criteria_rows(outcome.scores),
    }
    trained_on = outcome.data.describe()
    notes = [trained_on, outcome.trained.chosen, *outcome.notes]
    fit = outcome.trained.fit
    if isinstance(fit, ClosedLoopFit):
        told = coefficients_of(fit, fit.problem, fit.estimate, trained_on)
        tables |= coefficient_tables.tables(told)
        notes += [coefficient_tables.sentence(told), *coefficient_tables.notes(told)[1:]]
        drawn |= write_coefficients(told, out)
    report = Report(
        title=f"{outcome.config['name']}: trained and scored",
        summary=summary(outcome),
        good=is_good(outcome.verdict.word),
        tables=tables,
        figures=drawn,
        charts={f"{run}/{name}": chart for run, of_run in outcome.charts.items() for name, chart in of_run.items()},
        key=f"{outcome.worst.manoeuvre}/track",
        config=outcome.config,
        versions=versions(),
        notes=notes,
    )
    write_report(out / "report.html", report)
    _log_hyperparameters(outcome, out)
    write_file(out / SCORES, json.dumps(as_dict(outcome), indent=1))


def _log_hyperparameters(outcome: _Outcome, out: Path) -> None:
    """The hparams table of TensorBoard: choices and settings that were typed beside the final scores."""
    wanted = {k: v for k, v in scalars(list(outcome.scores)).items() if k.endswith(("dev_L", "left_range"))}
    errors = {f"train/relrmse_{name}": error for name, error in outcome.relative_rmse.items()}
    for logger in outcome.trained.loggers:
        logger.end(hyperparameters(outcome.config, out), wanted | errors, outcome.trained.epochs)


def summary(outcome: _Outcome) -> str:
    """What the model may be used for, and how close it stays to the recorded tracks."""
    worst, count = outcome.worst, len(outcome.scores)
    return (
        f"{outcome.verdict.sentence} In closed loop on {count} held-out manoeuvres the tracks are at most "
        f"{worst.dev_L:.3g} L apart ({worst.manoeuvre}; mean {outcome.mean_dev:.3g} L)."
    )


def print_outcome(outcome: _Outcome, out: Path, console: Console) -> None:
    """One table in the terminal and where the rest is."""
    console.print(score_table(outcome.scores, outcome.baselines))
    assessed = [row for row in outcome.imo if not row["verdict"].startswith("not judged")]
    if assessed:
        console.print(rich_table(assessed, IMO))
    console.print(verdict_text(outcome.verdict))
    how = outcome.trained
    errors = ", ".join(f"{name} {error:.2e}" for name, error in outcome.relative_rmse.items())
    console.print(outcome.data.describe())
    console.print(f"relRMSE on them: {errors}; {how.epochs} epochs in {how.seconds:.1f} s; {how.stopped}.")
    here = shown(out)
    logs = [logger.shown_by(here) for logger in outcome.trained.loggers]
    console.print("   ".join([f"report: {here / 'report.html'}", *logs]), soft_wrap=True)
