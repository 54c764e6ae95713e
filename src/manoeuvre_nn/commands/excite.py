"""The job of ``manoeuvre excite``: an ensemble of what is recorded, and what each further manoeuvre would tell it."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf
from rich.console import Console

from manoeuvre_nn.commands import config as configs
from manoeuvre_nn.commands.job import (
    NOTHING_HELD_OUT,
    Job,
    check_model,
    config_beside,
    known_part,
    load_model,
    prepare,
    with_rate,
)
from manoeuvre_nn.commands.provenance import check_same_run, shown, versions, write_provenance
from manoeuvre_nn.commands.shelves import check_arguments, plain
from manoeuvre_nn.commands.train import fit
from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.core.manoeuvre import Manoeuvre
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.core.terminal import Terminal
from manoeuvre_nn.core.threads import use_threads
from manoeuvre_nn.core.waiting import waiting
from manoeuvre_nn.core.writing import write_file
from manoeuvre_nn.design.candidates import sail
from manoeuvre_nn.design.expected_error import OF_ENSEMBLE, DesignEffort, disagreements, prospects
from manoeuvre_nn.design.expected_information import information
from manoeuvre_nn.dynamics.members import has_members
from manoeuvre_nn.dynamics.model import IdentifiedShip
from manoeuvre_nn.network.hull_rudder import HullRudder
from manoeuvre_nn.report.design_figures import gain_figure, where_figure
from manoeuvre_nn.report.design_tables import ManoeuvreAdvice, advice_json, advice_rows, sentence, target_rows
from manoeuvre_nn.report.html import Report, save_figures, write_report
from manoeuvre_nn.report.tables import rich_table
from manoeuvre_nn.training.ensemble import steps_in_noise

RESULT, PAGE = "excite.json", "report.html"
EXPECTED = "What each candidate is expected to bring"
GOALS = ("accuracy", "coefficients")
OF_MODEL = ("ship", "linear", "network", "fit", "manoeuvre", "data", "effect", "effects", "seed")
"""Parts of a config that say what a model is and what it was trained on."""


@dataclass(frozen=True)
class _Question:
    """What is asked, checked before anything is computed.

    Attributes:
        goal: ``accuracy`` or ``coefficients``.
        ship: The ship, or its particulars.
        job: What is recorded, and what is trained on it.
        model: A trained model; None trains one.
        candidates: What could be sailed.
        targets: What is to be predicted.
        left_out: Candidates that the ship cannot sail, and why.
        effort: How much is computed.
        per_minute: Whether the gain for every minute counts.
        typed: Name of a candidate that is no option's -> how it is typed for other commands.
    """

    goal: str
    ship: Ship | Particulars
    job: Job
    model: IdentifiedShip | None
    candidates: Sequence[Manoeuvre]
    targets: Sequence[Manoeuvre]
    left_out: Sequence[str]
    effort: DesignEffort
    per_minute: bool
    typed: Mapping[str, str]


def excite(cfg: DictConfig, out: Path, console: Console | None = None) -> ManoeuvreAdvice | None:
    """Train unless a model is given, ask, and write everything; None if the folder already holds the advice."""
    console = console or Terminal()
    use_threads(cfg.trainer.threads)
    cfg = configs.with_effects(_of_model(cfg))
    question = question_of(cfg)
    check_same_run(cfg, out)
    if (out / RESULT).is_file():
        console.print(f"{out} holds this advice already: nothing to do", soft_wrap=True)
        return None
    write_provenance(cfg, out)
    with waiting(console) as question.job.data.say:
        question.job.data.setup(stage=None)
    model = question.model
    if model is None:
        trained = fit(cfg, question.job, out, console)
        for logger in trained.loggers:
            logger.finalize("success")
        model = with_rate(trained.fit.dynamics.double().cpu(), "excite")
    with waiting(console, "sailing") as say:
        advice = _advice(question, model, say)
        say("drawing and writing the report")
        _write(advice, plain(cfg), out)
    _print(advice, out, console)
    return advice


def question_of(cfg: DictConfig) -> _Question:
    """Read and check the settings.

    Returns:
        What is asked.

    Raises:
        InputError: If a setting is wrong, or the ship can sail none of the candidates.
    """
    check_choice("goal", cfg.goal, GOALS)
    check_arguments(DesignEffort, cfg.effort, "effort")
    recorded = "files" in cfg.data
    job = prepare(OmegaConf.merge(cfg, {"score": "default" if recorded else NOTHING_HELD_OUT}))  # type: ignore[arg-type]
    ship, known = known_part(cfg)
    if cfg.goal == "accuracy" and not (isinstance(job.network, HullRudder) and job.network.members > 1):
        raise InputError(f"goal=accuracy asks {OF_ENSEMBLE}, or goal=coefficients")
    speed = configs.approach_speed(cfg.manoeuvre)
    candidates, targets = (
        configs.named_manoeuvres(configs.as_list(cfg[setting]), speed, cfg.get("config_dir"), setting)
        for setting in ("candidates", "score")
    )
    possible, refused = _possible(candidates, known.particulars)
    if not possible or not targets:
        raise InputError(" ".join(refused) or "candidates=[] or score=[]: name at least one manoeuvre of each")
    for target in targets:
        target.check(known.particulars)
    return _Question(
        cfg.goal,
        ship,
        job,
        None if cfg.model is None else with_rate(load_model(Path(str(cfg.model))), "excite"),
        possible,
        targets,
        refused,
        DesignEffort(**{"seed": cfg.seed, **cfg.effort}),
        cfg.per_minute,
        _as_options(cfg, speed),
    )


def _as_options(cfg: DictConfig, speed: float | None) -> dict[str, str]:
    """How candidates are typed for other commands whose names are not those of options."""
    own, found = cfg.get("config_dir"), dict[str, str]()
    for entry in configs.as_list(cfg.candidates):
        typed = json.dumps(entry).replace('"', "") if isinstance(entry, Mapping) else str(entry)
        made = configs.named_manoeuvres([entry], speed, own)
        found |= {m.name: f"manoeuvre=[{typed}]" for m in made if m.name != typed}
    return found


def _of_model(cfg: DictConfig) -> DictConfig:
    """The config with what a given model is and was trained on."""
    if cfg.model is None:
        return cfg
    path = Path(str(cfg.model))
    check_model(path)
    told = config_beside(path)
    plain = OmegaConf.to_container(cfg)
    assert isinstance(plain, dict)
    return OmegaConf.create({**plain, **{k: told[k] for k in OF_MODEL if k in told}})


def _possible(candidates: Sequence[Manoeuvre], ship: Particulars) -> tuple[list[Manoeuvre], list[str]]:
    """Candidates that the steering gear can do, and why not the others."""
    possible, refused = [], []
    for candidate in candidates:
        try:
            candidate.check(ship)
        except InputError as error:
            refused.append(f"{error}.")
        else:
            possible.append(candidate)
    return possible, refused


def _advice(q: _Question, model: IdentifiedShip, say: Any) -> ManoeuvreAdvice:
    """Ask."""
    tuples, known = q.job.data.tuples, q.job.data.known
    if q.goal == "accuracy":
        record, steps = (None, None) if q.job.data.exact else (q.job.data.would_record, steps_in_noise(model, tuples))
        options: dict[str, Any] = {"record": record, "effort": replace(q.effort, steps=steps), "say": say}
        expected = prospects(model, tuples, q.candidates, q.targets, **options)
        coefficients = ""
    else:
        interval = float((tuples.times[1:] - tuples.times[:-1]).median())
        expected, coefficients = information(q.ship, known, tuples, sail(model, q.candidates), interval)  # type: ignore[assignment]
    speed = known.particulars.speed / known.prime.speed
    inputs = tuples.inputs.double().numpy()
    several = isinstance(model.network, HullRudder) and has_members(model)
    where = disagreements(model, tuples, sail(model, q.targets)) if several else None
    return ManoeuvreAdvice(
        ship=known.particulars.name,
        goal=q.goal,
        expected=sorted(expected, key=lambda e: e.per_minute if q.per_minute else e.gain, reverse=True),
        trained_on=q.job.data.describe(),
        where=where,
        recorded=inputs[:, 1:] / [speed, speed, 1.0],
        coefficients=coefficients,
        left_out=q.left_out,
        per_minute=q.per_minute,
        typed=q.typed,
    )


def _write(a: ManoeuvreAdvice, config: dict[str, Any], out: Path) -> None:
    """Figures and page, and the result last, as the mark of the end."""
    figures = {"Candidates/gain": gain_figure(a)}
    if a.where is not None:
        figures["Where the members disagree/where"] = where_figure(a)
    save_figures({name.rpartition("/")[2]: figure for name, figure in figures.items()}, out / "figures")
    after = "Deviation over L of each target" if a.goal == "accuracy" else "Standard errors of each equation"
    report = Report(
        title=f"{a.ship}: what to sail next",
        summary=sentence(a),
        tables={EXPECTED: advice_rows(a), after: target_rows(a)},
        unfolded=(EXPECTED,),
        figures=figures,
        config=config,
        versions=versions(),
        notes=[a.trained_on, *a.left_out],
    )
    write_report(out / PAGE, report)
    write_file(out / RESULT, json.dumps(advice_json(a, versions()), indent=1))


def _print(a: ManoeuvreAdvice, out: Path, console: Console) -> None:
    """The sentence, one table, and where the rest is."""
    console.print(sentence(a), highlight=False)
    console.print(rich_table(advice_rows(a), f"{EXPECTED} for {a.goal}"))
    for line in (a.trained_on, *a.left_out):
        console.print(line, highlight=False)
    here = shown(out)
    console.print(f"report: {here / PAGE}   numbers: {here / RESULT}", soft_wrap=True, highlight=False)
