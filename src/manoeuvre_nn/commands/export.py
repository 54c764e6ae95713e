"""The job of ``manoeuvre export``: a trained model as formulas or for another simulator, checked against the model."""

import json
from collections.abc import Callable, Sequence
from functools import partial
from math import isfinite
from pathlib import Path
from subprocess import CalledProcessError
from tempfile import gettempdir
from typing import Any

from omegaconf import DictConfig, OmegaConf
from rich.console import Console

from manoeuvre_nn import __version__
from manoeuvre_nn.commands import config as configs
from manoeuvre_nn.commands.job import NOTHING_HELD_OUT, config_beside, load_model, prepare, verdict_beside
from manoeuvre_nn.commands.provenance import shown
from manoeuvre_nn.commands.response import load_response
from manoeuvre_nn.commands.shelves import build
from manoeuvre_nn.core.data_files import load_json
from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.core.plain_text import harmless
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.core.terminal import Say, Terminal
from manoeuvre_nn.core.threads import use_threads
from manoeuvre_nn.core.waiting import waiting
from manoeuvre_nn.core.writing import write_file
from manoeuvre_nn.dynamics.base import Model
from manoeuvre_nn.dynamics.model import IdentifiedShip
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.formulas.check import COMPILERS
from manoeuvre_nn.formulas.conversions import price
from manoeuvre_nn.formulas.formats import CONVERSIONS, FORMATS, Written, write_down
from manoeuvre_nn.formulas.models import to_program
from manoeuvre_nn.formulas.program import Program
from manoeuvre_nn.formulas.ranges import Ranges, trained_ranges
from manoeuvre_nn.formulas.rollouts import sailed
from manoeuvre_nn.report.tables import rich_table

ALL = "all"
NEEDS_COMPILER = {
    "c": f"not run: no compiler of C was found ({', '.join(COMPILERS)})",
    "fmu": f"holds its sources without a binary, and was not run: no compiler of C was found ({', '.join(COMPILERS)})",
}
"""Format -> what is told where there is no compiler."""
FOLDER, NOTES = "export", "export.json"
"""Folder of a run that holds what was exported of it, and the file there that says how well."""


def export(cfg: DictConfig, out: Path, console: Console | None = None) -> list[Written]:
    """Write a trained model down and say what was written.

    Args:
        cfg: The config.
        out: Not used: files go to the folder of the run, or where ``out`` of the config says.
        console: Where to print.

    Returns:
        What was written.

    Raises:
        InputError: If settings do not go together, or the compiler of C fails.
    """
    console = console or Terminal()
    use_threads(1)
    check_choice("format", cfg.format, [*FORMATS, ALL])
    if cfg.run is None:
        raise InputError("run must be given: write run=OUT, the output folder of manoeuvre train")
    cfg = configs.with_effects(cfg)
    checkpoint = checkpoint_of(Path(str(cfg.run)))
    with waiting(console, "reading the model and what it was trained on") as say:
        effect = cfg.get("effect")
        program = program_of(checkpoint, partial(configs.chosen_effects, effect) if effect else None)
        try:
            made, left_out = _written(program, cfg, say)
        except CalledProcessError as error:  # a compiler that fails is no reason to leave a format out
            raise InputError(_of_compiler(error)) from error
    paths = [_path(one, cfg, checkpoint) for one in made]
    fresh = [one.save(path) for one, path in zip(made, paths, strict=True)]
    if program.vessel is not None:
        _note(made, paths)
    _print(made, paths, fresh, console)
    for line in left_out:
        console.print(line, highlight=False, markup=False)
    return made


def _of_compiler(error: CalledProcessError) -> str:
    """What to do where a compiler has failed, and the last line that it said."""
    lines = [line.strip() for line in error.stderr.decode(errors="replace").splitlines() if line.strip()]
    said = harmless(lines[-1])[:120] if lines else "nothing was said"
    return (
        f"the compiler {error.cmd[0]} ended with code {error.returncode} ({said}): make room in {gettempdir()}, "
        "mend it, or take it off the PATH: then C is written and not compiled"
    )


def _written(program: Program, cfg: DictConfig, say: Say) -> tuple[list[Written], list[str]]:
    """What was asked for; of all formats those that the model has, and why it has not the others."""
    if cfg.format != ALL:
        say(f"writing {cfg.format}, and sailing by it")
        return [write_down(program, cfg.format, document=cfg.document, runs=sailed(program))], []
    say("sailing by the model")
    runs, made, left_out = sailed(program), [], []
    for k, kind in enumerate(FORMATS):
        say(f"writing {kind}, and sailing by it", k / len(FORMATS))
        try:
            made.append(write_down(program, kind, document=cfg.document, runs=runs))
        except InputError as error:
            left_out.append(f"not written: {error}")
    return made, left_out


def _note(made: Sequence[Written], paths: Sequence[Path]) -> None:
    """Keep how well each file does in ``export.json`` beside it; what stands there of other files stays."""
    for one, path in zip(made, paths, strict=True):
        noted = path.with_name(NOTES)
        known = load_json(noted) if noted.is_file() else {}
        known = known if isinstance(known, dict) else {}
        tracks = {
            d.manoeuvre: {"largest_over_L": d.largest, "rms_over_L": d.rms} if isfinite(d.largest) else None
            for d in one.deviations
        }
        known[path.name] = {"format": one.kind, "difference": one.difference, "tracks": tracks}
        write_file(noted, json.dumps(known, indent=2) + "\n")


def checkpoint_of(run: Path) -> Path:
    """The checkpoint that is meant.

    Args:
        run: A checkpoint, or the output folder of a training.

    Returns:
        Of a folder that which its training kept.

    Raises:
        InputError: If there is none.
    """
    if not run.exists():
        raise InputError(f"run={run}: there is no such folder; write the output folder of manoeuvre train")
    if run.is_file():
        return run
    found = [run / "checkpoints" / name for name in ("best.ckpt", "last.ckpt")]
    there = [path for path in found if path.is_file()]
    if not there:
        raise InputError(f"run={run}: there is no {found[0]}; write the output folder of manoeuvre train")
    keep = OmegaConf.select(config_beside(there[0], ()), "trainer.keep")
    return there[-1] if keep == "last" else there[0]


def program_of(checkpoint: Path, effects: Callable[[Ship], list[Effect]] | None = None) -> Program:
    """The program of a checkpoint's model, with the ranges of what it was trained on.

    Args:
        checkpoint: The checkpoint.
        effects: Gives what acts on its ship beside calm water; None is nothing.

    Returns:
        The program.
    """
    notes, verdict = [f"Written by manoeuvre-nn {__version__} from {checkpoint}."], verdict_beside(checkpoint)[1]
    notes += [f"Verdict of its own training: {verdict}"] if verdict else []
    cfg = config_beside(checkpoint, ())
    if "task" in cfg:
        learnt = load_response(checkpoint)
        return to_program(with_effects(learnt, effects) if effects else learnt, None, [*notes, _records_of(cfg)])
    model = load_model(checkpoint)
    if not isinstance(model, IdentifiedShip):
        return to_program(model, None, notes)  # which says why not
    ranges, source = _trained_on(cfg, model)
    moves = with_effects(model, effects) if effects else model
    return to_program(moves, ranges, [*notes, f"Network: {type(model.network).__name__}. {source}"])


def with_effects(model: Any, make: Callable[[Ship], list[Effect]]) -> Any:
    """A model with what acts on it.

    Args:
        model: The model.
        make: Gives the effects on its ship.

    Returns:
        The vessel; the model itself where nothing acts on it.

    Raises:
        InputError: If it is no ship.
    """
    if not isinstance(model, Model):
        raise InputError(f"a {type(model).__name__} is no ship: leave effects out")
    effects = make(model.corrected(model.hull))
    return Vessel(model, effects) if effects else model


def _records_of(cfg: DictConfig) -> str:
    """What a response was learnt from, a sentence."""
    if "files" in cfg.data:
        return f"Learnt from {cfg.learning:.0%} of the records of {', '.join(configs.as_list(cfg.data.files))}."
    how = f"{cfg.data.method.replace('_', ' ')} ({cfg.data.design})"
    ship = build(cfg.ship, "ship").particulars.name
    return f"Learnt from {cfg.learning:.0%} of the records computed for the {ship} by {how}."


def _trained_on(cfg: DictConfig, model: IdentifiedShip) -> tuple[Ranges | None, str]:
    """Ranges of what a model was trained on, and a sentence; usual ones where it is not there any more."""
    recorded = "files" in cfg.data
    try:
        cfg = configs.with_effects(OmegaConf.merge(cfg, {"score": cfg.score if recorded else NOTHING_HELD_OUT}))  # type: ignore[arg-type]
        data = prepare(cfg).data
        data.setup(stage=None)
    except (InputError, OSError) as error:
        return None, f"What it was trained on is not to be had ({error}): ranges are those of hard manoeuvres."
    return trained_ranges(
        model, data.tuples, data.recordings
    ), f"Trained on {data.describe().rstrip('.')}; ranges are those of these data."


def _path(one: Written, cfg: DictConfig, checkpoint: Path) -> Path:
    """Where a text goes: to ``out``, which of several formats is a folder, or to the run's own folder."""
    if cfg.out is None:
        return checkpoint.resolve().parents[1] / FOLDER / one.file_name
    out = Path(str(cfg.out))
    return out / one.file_name if cfg.format == ALL else out


def _print(made: Sequence[Written], paths: Sequence[Path], fresh: Sequence[bool], console: Console) -> None:
    """Ranges, one table and where the files are."""
    program = made[0].program
    ranges = "; ".join(f"{q.name} {q.low:.4g} to {q.high:.4g} {q.unit}" for q in program.inputs if not q.parameter)
    changeable = "; ".join(f"{q.name} = {q.example:.6g} {q.unit}" for q in program.inputs if q.parameter)
    sailed_by = list(dict.fromkeys(d.manoeuvre for one in made for d in one.deviations))
    rows = [_row(one, sailed_by) for one in made]
    console.print(rich_table(rows, program.title))
    for note in program.notes[1:]:
        console.print(note, highlight=False, markup=False)
    console.print(f"range of validity: {ranges}", highlight=False)
    if changeable:
        console.print(f"may be changed: {changeable}", highlight=False)
    for one in made:
        for line in price(one.deviations) if one.kind in CONVERSIONS else ():
            console.print(f"{one.kind}: {line}", highlight=False)
        if one.kind in NEEDS_COMPILER and one.difference is None and not one.deviations:
            console.print(f"{one.kind}: {NEEDS_COMPILER[one.kind]}", highlight=False)
    for path, new in zip(paths, fresh, strict=True):
        console.print(f"{'written' if new else 'there already'}: {shown(path)}", soft_wrap=True, highlight=False)


def _row(one: Written, trials: Sequence[str]) -> dict[str, str]:
    """A row of the table: differences from the model, of rates over the largest rate, of tracks over L."""
    row = {"format": one.kind, "kB": f"{len(one.bytes) / 1000:.1f}"}
    unknown = "fitted" if one.kind in CONVERSIONS else "-" if one.deviations else "not run"
    row["rates"] = unknown if one.difference is None else f"{one.difference:.1e}"
    tracks = {d.manoeuvre: d for d in one.deviations}
    return row | {f"{n} (L)": f"{tracks[n].largest:.1e}" if n in tracks else "not sailed" for n in trials}
