"""The job of ``manoeuvre export``: a trained model as formulas, checked against the model."""

from collections.abc import Sequence
from pathlib import Path

from omegaconf import DictConfig, OmegaConf
from rich.console import Console

from manoeuvre_nn import __version__
from manoeuvre_nn.commands import config as configs
from manoeuvre_nn.commands.job import NOTHING_HELD_OUT, config_beside, load_model, prepare
from manoeuvre_nn.commands.provenance import shown
from manoeuvre_nn.commands.response import load_response
from manoeuvre_nn.commands.shelves import build
from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.core.terminal import Terminal
from manoeuvre_nn.core.threads import use_threads
from manoeuvre_nn.core.waiting import waiting
from manoeuvre_nn.dynamics.model import IdentifiedShip
from manoeuvre_nn.formulas.formats import WRITERS, Written, write_down
from manoeuvre_nn.formulas.models import to_program
from manoeuvre_nn.formulas.program import Program
from manoeuvre_nn.formulas.ranges import Ranges, trained_ranges
from manoeuvre_nn.report.tables import rich_table

ALL = "all"
FOLDER = "export"
"""Folder of a run that holds what was exported of it."""


def export(cfg: DictConfig, out: Path, console: Console | None = None) -> list[Written]:
    """Write a trained model down and say what was written.

    Args:
        cfg: The config.
        out: Not used: files go to the folder of the run, or where ``out`` of the config says.
        console: Where to print.

    Returns:
        What was written.

    Raises:
        InputError: If settings do not go together.
    """
    console = console or Terminal()
    use_threads(1)
    check_choice("format", cfg.format, [*WRITERS, ALL])
    if cfg.run is None:
        raise InputError("run must be given: write run=OUT, the output folder of manoeuvre train")
    checkpoint = checkpoint_of(Path(str(cfg.run)))
    with waiting(console, "reading the model and what it was trained on"):
        program = program_of(checkpoint)
    kinds, made = list(WRITERS) if cfg.format == ALL else [cfg.format], list[Written]()
    with waiting(console) as say:
        for kind in kinds:
            say(f"writing {kind} and comparing it with the model", len(made) / len(kinds))
            made.append(write_down(program, kind, document=cfg.document))
    paths = [_path(one, cfg, checkpoint) for one in made]
    fresh = [one.save(path) for one, path in zip(made, paths, strict=True)]
    _print(made, paths, fresh, console)
    return made


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


def program_of(checkpoint: Path) -> Program:
    """The program of a checkpoint's model, with the ranges of what it was trained on."""
    notes = [f"Written by manoeuvre-nn {__version__} from {checkpoint}."]
    cfg = config_beside(checkpoint, ())
    if "task" in cfg:
        return to_program(load_response(checkpoint), None, [*notes, _records_of(cfg)])
    model = load_model(checkpoint)
    if not isinstance(model, IdentifiedShip):
        return to_program(model, None, notes)  # which says why not
    ranges, source = _trained_on(cfg, model)
    return to_program(model, ranges, [*notes, f"Network: {type(model.network).__name__}. {source}"])


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
    ranges = "; ".join(f"{q.name} {q.low:.4g} to {q.high:.4g} {q.unit}" for q in program.inputs)
    rows = [
        {
            "format": one.kind,
            "numbers": program.numbers_count,
            "characters": len(one.text),
            "largest difference": "not run: no C compiler" if one.difference is None else f"{one.difference:.1e}",
        }
        for one in made
    ]
    console.print(rich_table(rows, f"{program.title}: differences from the model over its largest outputs"))
    for note in program.notes[1:]:
        console.print(note, highlight=False)
    console.print(f"range of validity: {ranges}", highlight=False)
    for path, new in zip(paths, fresh, strict=True):
        console.print(f"{'written' if new else 'there already'}: {shown(path)}", soft_wrap=True, highlight=False)
