"""What a run leaves behind: scores, predictions, figures, report, and a table in the terminal."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from matplotlib.figure import Figure
from matplotlib.image import imread
from rich.console import Console

from manoeuvre_nn.commands.coefficient_report import coefficient_report
from manoeuvre_nn.commands.provenance import SCORES, flat, versions
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.dynamics.limits import OK
from manoeuvre_nn.estimation.baselines import fit_baselines
from manoeuvre_nn.manoeuvre.imo import imo_table
from manoeuvre_nn.report.figures import comparison_figures, excitation_figure, force_figure, learning_figure
from manoeuvre_nn.report.html import Report, write_report
from manoeuvre_nn.report.tables import criteria_rows, rich_table, score_rows, score_table
from manoeuvre_nn.scoring.held_out import HeldOut
from manoeuvre_nn.scoring.score import Score
from manoeuvre_nn.training.callbacks import scalars
from manoeuvre_nn.training.data import ManoeuvreData
from manoeuvre_nn.training.fits import Fit
from manoeuvre_nn.training.session import Trained

IMO_TITLE = "IMO MSC.137(76), predicted"


@dataclass(frozen=True)
class Outcome:
    """A finished run.

    Attributes:
        config: Resolved config.
        trained_on: Sentence on the data.
        scores: Held-out manoeuvres.
        training_scores: The manoeuvres that were trained on, sailed in closed loop.
        predictions: Prediction of each held-out manoeuvre.
        references: Recording of each held-out manoeuvre.
        relative_rmse: relRMSE of g1, g2, g3 on the training tuples [-].
        times: Time of each training tuple [s].
        g: Target and network (N, 3) each [-].
        inputs: Training inputs (N, 4), and those along each held-out manoeuvre.
        trained: How the training went.
        imo: IMO criteria of the predictions.
        members: Predictions of an ensemble's members, by held-out manoeuvre.
        baselines: Simpler models -> their scores on the same manoeuvres.
        notes: What the simpler models know.
    """

    config: Mapping[str, Any]
    trained_on: str
    scores: Sequence[Score]
    training_scores: Sequence[Score]
    predictions: Sequence[Recording]
    references: Sequence[Recording]
    relative_rmse: tuple[float, float, float]
    times: np.ndarray
    g: tuple[np.ndarray, np.ndarray]
    inputs: tuple[np.ndarray, Mapping[str, np.ndarray]]
    trained: Trained
    imo: Sequence[Mapping[str, Any]]
    members: Sequence[Sequence[Recording]] = ()
    baselines: Mapping[str, Sequence[Score]] = field(default_factory=dict)
    notes: Sequence[str] = ()

    @property
    def mean_dev(self) -> float:
        """Mean over the held-out manoeuvres of the largest deviation over L [-]."""
        return float(np.mean([s.dev_L for s in self.scores]))


def score_finally(config: Mapping[str, Any], trained: Trained, data: ManoeuvreData) -> Outcome:
    """Score the network that is kept, on the held-out manoeuvres and on those that it was trained on.

    Args:
        config: Resolved config.
        trained: The training.
        data: What it was trained on.

    Returns:
        The outcome.
    """
    fit = trained.fit.double().cpu()
    held_out, known = data.held_out, HeldOut(tuple(data.recordings), data.held_out.length)
    predictions, members = held_out.predict(fit.dynamics), held_out.predict_members(fit.dynamics)
    scores = held_out.score(predictions, members, held_out.steer(fit.dynamics))
    baselines, missing = fit_baselines(data.reference, data.known, data.tuples)
    inputs, targets = data.tuples.inputs.double(), data.tuples.targets.double()
    rmse = tuple(float(e) for e in fit.relative_rmse(inputs, targets))
    return Outcome(
        config=config,
        trained_on=data.describe(),
        scores=scores,
        training_scores=known.score(known.predict(fit.dynamics)),
        predictions=predictions,
        references=held_out.references,
        relative_rmse=(rmse[0], rmse[1], rmse[2]),
        times=data.tuples.times.numpy(),
        g=(targets.numpy(), fit.unknown_force(inputs).numpy()),
        inputs=(inputs.numpy(), {r.name: _inputs(r, fit) for r in held_out.references}),
        trained=trained,
        imo=imo_table({s.manoeuvre: s.criteria for s in scores}, fit.dynamics.particulars),
        members=members,
        baselines={r.name: held_out.score(held_out.predict(r.dynamics, "rollout")) for r in baselines},
        notes=[f"Beside the network: {r.name}: {r.note}." for r in baselines] + [f"Missing: {m}." for m in missing],
    )


def _inputs(recording: Recording, fit: Fit) -> np.ndarray:
    """u', v', r', delta along a recording."""
    units = fit.dynamics.known.velocity_units.double().numpy()
    return np.column_stack([recording.stacked("u", "v", "r") / units, recording["delta"]])


def draw(reference: Recording, prediction: Recording, members: Sequence[Recording] = ()) -> Mapping[str, Figure]:
    """Figures of one manoeuvre for TensorBoard.

    Args:
        reference: What was recorded.
        prediction: What was predicted.
        members: What each member of an ensemble predicts.

    Returns:
        Name -> figure.
    """
    return comparison_figures(reference, prediction, float(reference.meta["length"]), members)


def figures(outcome: Outcome) -> dict[str, Figure]:
    """All figures of a run.

    Args:
        outcome: What came out.

    Returns:
        ``manoeuvre/name`` -> figure.
    """
    made = {
        f"{reference.name}/{name}": figure
        for reference, prediction, members in zip(outcome.references, outcome.predictions, outcome.members, strict=True)
        for name, figure in draw(reference, prediction, members).items()
    }
    made["training/forces"] = force_figure(outcome.times, *outcome.g)
    made["training/excitation"] = excitation_figure(*outcome.inputs)
    if outcome.trained.history:
        made["training/learning"] = learning_figure(outcome.trained.history)
    return made


def as_dict(outcome: Outcome) -> dict[str, Any]:
    """What ``scores.json`` holds.

    Args:
        outcome: What came out.

    Returns:
        Plain numbers and strings.
    """
    return {
        "scores": {s.manoeuvre: s.as_dict() for s in outcome.scores},
        "mean_dev_L": outcome.mean_dev,
        "baselines": {name: {s.manoeuvre: s.dev_L for s in scores} for name, scores in outcome.baselines.items()},
        "trained_on": {s.manoeuvre: s.as_dict() for s in outcome.training_scores},
        "training": {
            "relrmse": {f"g{k + 1}": e for k, e in enumerate(outcome.relative_rmse)},
            "samples": len(outcome.times),
            "epochs": outcome.trained.epochs,
            "stopped": outcome.trained.stopped,
            "seconds": round(outcome.trained.seconds, 3),
        },
        "seed": outcome.config["seed"],
        "chosen": outcome.trained.chosen,
        "versions": versions(),
    }


def write_results(outcome: Outcome, out: Path) -> None:
    """Write predictions, figures, report and TensorBoard's last entries; ``scores.json`` last, as the mark of the end.

    Args:
        outcome: What came out.
        out: Output folder.
    """
    for folder in ("predictions", "figures"):
        (out / folder).mkdir(parents=True, exist_ok=True)
    for reference, prediction in zip(outcome.references, outcome.predictions, strict=True):
        prediction.to_csv(out / "predictions" / f"{reference.name}.csv")
    drawn = figures(outcome)
    for name, figure in drawn.items():
        path = out / "figures" / f"{name.replace('/', '_').replace(' ', '_')}.png"
        figure.savefig(path, dpi=110)
        figure.set_layout_engine("none")  # laid out once: the report draws it again
        outcome.trained.add_image(f"final/{name}", imread(path), outcome.trained.epochs)
    told = coefficient_report(outcome.trained.fit, outcome.trained_on, out)
    drawn |= told.figures
    report = Report(
        title=f"{outcome.config['name']}: trained and scored",
        summary=summary(outcome),
        tables={
            "Held-out manoeuvres": score_rows(outcome.scores, outcome.baselines),
            "Manoeuvres that were trained on, in closed loop": score_rows(outcome.training_scores),
            IMO_TITLE: outcome.imo,
            "All criteria of the held-out manoeuvres": criteria_rows(outcome.scores),
            **told.tables,
        },
        figures=drawn,
        config_yaml=yaml.safe_dump(dict(outcome.config), sort_keys=False, allow_unicode=True),
        versions=versions(),
        notes=[outcome.trained_on, outcome.trained.chosen, *outcome.notes, *told.notes],
    )
    write_report(out / "report.html", report)
    _log_hyperparameters(outcome)
    (out / SCORES).write_text(json.dumps(as_dict(outcome), indent=1))


def _log_hyperparameters(outcome: Outcome) -> None:
    """The hparams table of TensorBoard: the choices and numbers that make a difference, and the final scores."""
    chosen = {k: v for k, v in flat(dict(outcome.config)).items() if not k.startswith(("trainer.", "scoring."))}
    settings = {
        k.removesuffix("._target_"): str(v).rsplit(".", 1)[-1] if k.endswith("_target_") else v
        for k, v in chosen.items()
        if isinstance(v, str | int | float | bool)
    }
    wanted = {k: v for k, v in scalars(list(outcome.scores)).items() if k.endswith(("dev_L", "left_range"))}
    errors = {f"final/relrmse_g{k + 1}": e for k, e in enumerate(outcome.relative_rmse)}
    outcome.trained.close(settings, {f"final/{k}": v for k, v in wanted.items()} | errors)


def summary(outcome: Outcome) -> str:
    """The verdict in one sentence.

    Args:
        outcome: What came out.

    Returns:
        The sentence.
    """
    lost = [s.manoeuvre for s in outcome.scores if s.status != OK]
    worst = max(outcome.scores, key=lambda s: s.dev_L)
    text = (
        f"In closed loop on {len(outcome.scores)} held-out manoeuvres the model stays within {worst.dev_L:.3g} L of "
        f"the recorded tracks (worst: {worst.manoeuvre}; mean {outcome.mean_dev:.3g} L)"
    )
    return text + (f"; {', '.join(lost)} left the physical range." if lost else ".")


def print_outcome(outcome: Outcome, out: Path, console: Console) -> None:
    """One table in the terminal and where the rest is.

    Args:
        outcome: What came out.
        out: Output folder.
        console: Where to print.
    """
    console.print(score_table(outcome.scores, outcome.baselines))
    assessed = [row for row in outcome.imo if not row["verdict"].startswith("not judged")]
    if assessed:
        console.print(rich_table(assessed, IMO_TITLE))
    how = outcome.trained
    errors = ", ".join(f"g{k + 1} {e:.2e}" for k, e in enumerate(outcome.relative_rmse))
    console.print(outcome.trained_on)
    console.print(f"relRMSE on them: {errors}; {how.epochs} epochs in {how.seconds:.1f} s; {how.stopped}.")
    here = out.relative_to(Path.cwd()) if out.is_relative_to(Path.cwd()) else out
    console.print(f"report: {here / 'report.html'}   dashboard: tensorboard --logdir {here.parent}", soft_wrap=True)
