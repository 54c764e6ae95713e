"""The diagnosis job: a folder of cases answered one by one, or a person's own runs with everything to look at.

Columns of a csv: see :func:`~manoeuvre_nn.diagnosis.case.read_runs`.
"""

from collections.abc import Mapping
from pathlib import Path

from matplotlib.figure import Figure
from omegaconf import DictConfig, OmegaConf
from rich.console import Console

from manoeuvre_nn.commands import guard
from manoeuvre_nn.commands.diagnosis_setup import found_effects, setup, write_effects
from manoeuvre_nn.commands.provenance import check_same_run, shown, write_provenance
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.terminal import Terminal
from manoeuvre_nn.core.threads import use_threads
from manoeuvre_nn.core.waiting import PAUSE_S, waiting
from manoeuvre_nn.core.writing import FolderInUse, locked
from manoeuvre_nn.diagnosis.answers import write_answer
from manoeuvre_nn.diagnosis.case import Question
from manoeuvre_nn.diagnosis.diagnose import diagnose
from manoeuvre_nn.diagnosis.result import Diagnosis
from manoeuvre_nn.dynamics.base import Model
from manoeuvre_nn.report.diagnosis_figures import draw_diagnosis
from manoeuvre_nn.report.diagnosis_html import diagnosis_html, log_to_tensorboard
from manoeuvre_nn.report.diagnosis_tables import of_campaign, print_diagnosis, value_text, verdict_text
from manoeuvre_nn.report.html import save_figures
from manoeuvre_nn.scoring.free_runs import cost

ANSWER = "answer.json"
OF_ANSWERS = ["candidates", "model", "rudder_positive_to"]
"""Settings that answers of cases depend on; a command with others may not go on in their folder."""
ALONE, PROOF, OF_REST = 0.3, 0.65, 0.1
"""Share of a diagnosis' time at which all candidates have been tried alone (twice that where calm water is far off,
for then they are tried twice) and at which the proof begins; share of what is left between these that a combination
takes, and half of it the linearising before it. Measured on the sample and four concealed cases (proof: .57 to .81)."""


def diagnose_all(cfg: DictConfig, out: Path, console: Console | None = None) -> None:
    """Answer cases, or diagnose recordings.

    Raises:
        InputError: If it is not clear which.
    """
    console = console or Terminal()
    use_threads(1)
    if (cfg.cases is None) == (cfg.recordings is None):
        raise InputError(
            "write either cases=DIR or recordings=DIR, or recordings=sample, which comes with the package; "
            f"{guard.program()} --help tells more"
        )
    (answer_cases if cfg.recordings is None else diagnose_recordings)(cfg, out, console)


def answer_cases(cfg: DictConfig, out: Path, console: Console) -> None:
    """Answer every case that has no answer yet in a folder of its own; a broken one does not stop the others.

    Raises:
        InputError: If there is no case.
        KeyboardInterrupt: On ctrl-C, after a line.
    """
    folders = case_folders(Path(str(cfg.cases)))
    if cfg.get("ship") is not None:
        raise InputError("ship= goes with recordings=: the ship of a case is in its manifest.json")
    kept = OmegaConf.masked_copy(cfg, OF_ANSWERS)
    common = setup(cfg)
    check_same_run(kept, out)
    write_provenance(kept, out)
    todo = [f for f in folders if not (out / f.name / ANSWER).is_file()]
    answered, failed = [], []
    with _Tracker(console, len(todo), len(common.wanted)) as tracker:
        for folder in todo:
            tracker.begin(folder.name)
            try:
                with locked(out / folder.name):
                    question = common.question(common.case(folder))
                    tracker.say(_answer_case(question, out / folder.name, cfg.report, tracker))
                answered.append(folder.name)
            except FolderInUse:
                tracker.say(f"{folder.name}: another process is at work on it")
            except KeyboardInterrupt:
                tracker.say(f"{folder.name}: stopped; the same command goes on from here")
                raise
            except Exception as error:  # whatever it is, the other cases go on
                failed.append(folder.name)
                tracker.say(f"{folder.name}: failed: {guard.write_error(error, out / folder.name)}")
    done = len(folders) - len(todo)
    before = f"{done} done before, " if done else ""
    console.print(
        f"{len(folders)} cases: {before}{len(answered)} answered, {len(failed)} failed; {out}", soft_wrap=True
    )
    guard.failed_jobs += failed


def case_folders(place: Path) -> list[Path]:
    """Cases in a folder.

    Returns:
        Folders with a manifest, by name: the folder itself, or those in it.

    Raises:
        InputError: If there is none.
    """
    if not place.is_dir():
        raise InputError(f"cases={place} is not a folder: write a folder of cases, or one case")
    if (place / "manifest.json").is_file():
        return [place.resolve() if not place.name else place]
    found = sorted(path.parent for path in place.glob("*/manifest.json"))
    if not found:
        raise InputError(
            f"cases={place}: neither it nor a folder in it has a manifest.json; for csv files alone write recordings="
        )
    return found


def _answer_case(question: Question, out: Path, report: bool, tracker: "_Tracker") -> str:
    """Answer one case, with a report if it is asked for; what came out, on a line."""
    d = diagnose(question, tracker.step)
    if report:
        write_page(d, draw_diagnosis(d), out)
    (out / guard.ERROR).unlink(missing_ok=True)
    write_answer(d, out)
    return summary(d, question.dynamics)


def summary(d: Diagnosis, dynamics: Model) -> str:
    """Verdict, effects of the repaired model, error on the held-out runs before and after, and time on one line."""
    named = [
        f"{c.name} ({', '.join(f'{v.name}{of_campaign(v)} {value_text(v)}' for v in c.parameters)})"
        for c in d.causes
        if c.name in d.model
    ]
    found = " + ".join(named) or ("unknown" if d.verdict == "mismatch" else "nothing is missing")
    before = cost([p.rmse_before for p in d.proofs], dynamics.particulars)
    after = cost([p.rmse_after for p in d.proofs], dynamics.particulars)
    alone = [p.rmse_alone for p in d.proofs if p.rmse_alone]
    of_effects = f" ({cost(alone, dynamics.particulars):.2f} with published coefficients)" if alone else ""
    proof = f"J {before:.2f} -> {after:.2f}{of_effects}" if d.proofs else "not proved"
    first = f"{verdict_text(d)}; if she is: " if d.doubtful else ""
    return f"{d.case}: {d.verdict}, {first}{found}; {proof}; {d.seconds:.0f} s"


def diagnose_recordings(cfg: DictConfig, out: Path, console: Console) -> None:
    """Diagnose a person's own runs, with report, figures and dashboard."""
    common = setup(cfg)
    with waiting(console, "reading and checking the recordings"):
        case = common.runs()
    check_same_run(cfg, out)
    if (out / ANSWER).is_file():
        console.print(f"{out} holds this diagnosis already: nothing to do", soft_wrap=True)
        return
    write_provenance(cfg, out)
    told = ", ".join(f"{run.name} ({run.meta['kind']})" for run in case.held_out) or "none"
    console.print(f"{len(case.fitted)} runs are fitted; held out: {told}", soft_wrap=True, highlight=False)
    with _Tracker(console, 1, len(common.wanted)) as tracker:
        tracker.begin(case.name)
        question = common.question(case)
        d = diagnose(question, tracker.step)
    with waiting(console, "drawing and writing the report"):
        log_to_tensorboard(d, write_page(d, draw_diagnosis(d), out), out / "tensorboard")
    write_effects(found_effects(d, question.effects, common.shelf), f"{d.case}: {d.sentence}", out / "effects.yaml")
    write_answer(d, out)
    print_diagnosis(d, console)
    here = shown(out)
    console.print(f"report: {here / 'report.html'}   dashboard: tensorboard --logdir {here.parent}", soft_wrap=True)


def write_page(d: Diagnosis, figures: Mapping[str, Figure], out: Path) -> dict[str, Path]:
    """Write ``figures/*.png`` and ``report.html``, and return the files of the figures by their names."""
    pictures = save_figures(figures, out / "figures")
    diagnosis_html(d, figures, out / "report.html")
    return pictures


class _Tracker:
    """Which candidate of which case is under test, and how long it will take."""

    def __init__(self, console: Console, cases: int, candidates: int, seconds: float = PAUSE_S) -> None:
        """Set up the display of cases with so many candidates; seconds between lines where there is no terminal."""
        self.console, self.cases, self.candidates = console, cases, candidates
        self._shown = waiting(console, seconds=seconds)
        self._case, self._name, self._done = 0, "", 0.0

    def __enter__(self) -> "_Tracker":
        """Begin."""
        self._say = self._shown.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        """End, whatever happened."""
        self._shown.__exit__(None, None, None)

    def begin(self, name: str) -> None:
        """A case begins."""
        self._case, self._name, self._done = self._case + 1, name, 0.0
        self._show("reading")

    def step(self, what: str) -> None:
        """A candidate has been tried, or another step begins."""
        if what == "proof":
            self._done = PROOF
        self._show(what)
        if "linearisation" in what:
            self._done += max(PROOF - self._done, 0.0) / 2
        elif " + " in what:
            self._done += OF_REST * max(PROOF - self._done, 0.0)
        elif what not in {"proof", "remainder", "tracks and noise"}:
            self._done += ALONE / self.candidates

    def _show(self, what: str) -> None:
        """What is under way, and how much of all is done."""
        share = (self._case - 1 + self._done) / self.cases
        of_all = f" ({self._case}/{self.cases})" if self.cases > 1 else ""
        self._say(f"{self._name}{of_all}: {what}", share)

    def say(self, line: str) -> None:
        """A line that stays."""
        self.console.print(line, soft_wrap=True, highlight=False, markup=False)
