"""What a person holds in Python: runs, scores and an answer that print as tables and plot themselves."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from io import StringIO
from types import MappingProxyType
from typing import overload

import pandas as pd
from matplotlib.figure import Figure

from manoeuvre_nn.core.errors import check_choice
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.terminal import Terminal
from manoeuvre_nn.diagnosis.result import Diagnosis
from manoeuvre_nn.recording.check.turn_drift import is_circle
from manoeuvre_nn.recording.drift import drift_by_arcs, known_drift, without_drift
from manoeuvre_nn.report.diagnosis_figures import draw_diagnosis
from manoeuvre_nn.report.diagnosis_tables import print_diagnosis
from manoeuvre_nn.report.figures import track_figure
from manoeuvre_nn.report.runs import run_rows, runs_figure
from manoeuvre_nn.report.tables import rich_table, score_table, verdict_text
from manoeuvre_nn.scoring.error_measures import error_measures
from manoeuvre_nn.scoring.score import Score
from manoeuvre_nn.scoring.verdict import ModelVerdict, model_verdict

TABLE_COLUMNS = 100
"""Letters in a line of a printed table."""


def _printed(show: Callable[[Terminal], None]) -> str:
    """What is shown on a console, as text."""
    # A notebook shows what is printed by itself: rich would show it there a second time.
    console = Terminal(width=TABLE_COLUMNS, record=True, file=StringIO(), force_jupyter=False)
    show(console)
    return console.export_text().rstrip()


class Runs(Sequence[Recording]):
    """Recordings of one ship; printed as a table."""

    def __init__(self, runs: Sequence[Recording], ship: Particulars) -> None:
        """Keep recordings of a ship."""
        self.runs, self.ship = tuple(runs), ship

    def __len__(self) -> int:
        """Number of recordings."""
        return len(self.runs)

    @overload
    def __getitem__(self, which: int) -> Recording: ...
    @overload
    def __getitem__(self, which: slice) -> "Runs": ...
    def __getitem__(self, which: int | slice) -> "Recording | Runs":
        """One recording, or some of them."""
        return Runs(self.runs[which], self.ship) if isinstance(which, slice) else self.runs[which]

    def __add__(self, others: "Runs") -> "Runs":
        """These and others of the same ship."""
        return Runs([*self.runs, *others.runs], self.ship)

    def __repr__(self) -> str:
        """A table: a line each recording."""
        table = rich_table(run_rows(self.runs, self.ship.length), f"Runs of the {self.ship.name}")
        return _printed(lambda console: console.print(table, highlight=False))

    def plot(self) -> Figure:
        """Figure of tracks from above, heading and rudder over time."""
        return runs_figure(self.runs, self.ship.length)

    def drifts(self) -> pd.DataFrame:
        """Drift over ground of every turning circle, by its arcs one turn apart; :mod:`.recording.drift` says how.

        Returns:
            A line a circle: speed, its standard error [m/s], direction towards, its standard error [deg], error of the
            drift in a turn over the diameter [-].
        """
        found = {run.name: drift_by_arcs(run) for run in self.runs if is_circle(run)}
        names = ("speed", "speed_error", "toward_deg", "toward_error_deg", "error")
        return pd.DataFrame({run: {name: getattr(d, name) for name in names} for run, d in found.items()}).T

    def without_drift(self, speed: float | None = None, toward_deg: float = 0.0) -> "Runs":
        """The runs without their drift over ground.

        Args:
            speed: Speed of a known current [m/s], which every run loses. None takes from each turning circle what its
                arcs tell, and leaves other manoeuvres as they are.
            toward_deg: Direction that the known current goes towards, clockwise from north [deg].

        Returns:
            Runs.
        """
        if speed is not None:
            return Runs([without_drift(run, known_drift(speed, toward_deg)) for run in self.runs], self.ship)
        made = [without_drift(run, drift_by_arcs(run)) if is_circle(run) else run for run in self.runs]
        return Runs(made, self.ship)


class Scores(Sequence[Score]):
    """How far a model ends up from recordings; printed as a table."""

    def __init__(self, scores: Sequence[Score], runs: Sequence[Recording], predictions: Sequence[Recording]) -> None:
        """Keep the score, the recording and the prediction of each run."""
        self.scores, self.runs, self.predictions = tuple(scores), tuple(runs), tuple(predictions)

    def __len__(self) -> int:
        """Number of runs."""
        return len(self.scores)

    @overload
    def __getitem__(self, which: int) -> Score: ...
    @overload
    def __getitem__(self, which: slice) -> "Scores": ...
    def __getitem__(self, which: int | slice) -> "Score | Scores":
        """One score, or some of them."""
        if isinstance(which, slice):
            return Scores(self.scores[which], self.runs[which], self.predictions[which])
        return self.scores[which]

    def __repr__(self) -> str:
        """A table: a line each run."""
        table = score_table(self.scores, title="Predicted and recorded")
        return _printed(lambda console: console.print(table, verdict_text(self.verdict), highlight=False))

    @property
    def verdict(self) -> ModelVerdict:
        """What the model may be used for, by these runs; no simpler models are beside it."""
        return model_verdict(self.scores, self.runs)

    def plot(self, which: int | None = None) -> Figure:
        """Predicted and recorded track of a run by its number; None takes the run that is predicted worst."""
        chosen = max(range(len(self)), key=lambda k: self.scores[k].dev_L) if which is None else which
        return track_figure(self.runs[chosen], self.predictions[chosen])

    def error_measures(self, sets: Mapping[str, Collection[str]] = MappingProxyType({})) -> pd.DataFrame:
        """Absolute and percent errors, average angle measure and correlation of u, x, y, phi, psi over all runs.

        Args:
            sets: Further sets of runs by their names, ``{"validation": ["tc20"]}``.

        Returns:
            As :func:`.scoring.error_measures.error_measures` says.
        """
        return error_measures(self.predictions, self.runs, sets)


@dataclass(frozen=True, repr=False)
class Answer:
    """What a diagnosis found.

    Attributes:
        diagnosis: Everything: causes, values, evidence, proof, what to record next.
    """

    diagnosis: Diagnosis

    @property
    def summary(self) -> str:
        """What is missing, in a sentence."""
        return self.diagnosis.sentence

    @property
    def effects(self) -> dict[str, dict[str, float]]:
        """Effects of the repaired model -> parameter -> value."""
        named = [c for c in self.diagnosis.causes if c.name in self.diagnosis.model]
        return {c.name: {v.name: v.value for v in c.parameters} for c in named}

    def __repr__(self) -> str:
        """The short tables that ``manoeuvre diagnose`` prints."""
        return _printed(lambda console: print_diagnosis(self.diagnosis, console))

    def figures(self) -> dict[str, Figure]:
        """All figures of the report: name -> figure."""
        return draw_diagnosis(self.diagnosis)

    def plot(self, name: str = "probabilities") -> Figure:
        """One figure of the report, by its name among :meth:`figures`."""
        drawn = self.figures()
        check_choice("figure", name, list(drawn))
        return drawn[name]
