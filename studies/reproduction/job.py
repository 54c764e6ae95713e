"""The reproduction job: the chapters of a paper done again, told, written down, and kept so that a command goes on."""

import json
import os
import re
from collections.abc import Iterable, Mapping
from contextlib import closing
from dataclasses import asdict, dataclass
from functools import partial
from itertools import chain, takewhile
from pathlib import Path
from time import monotonic
from typing import Any

from omegaconf import DictConfig, OmegaConf
from rich.console import Console

from manoeuvre_nn.commands import guard
from manoeuvre_nn.commands.config import names
from manoeuvre_nn.commands.provenance import check_same_run, versions, write_provenance
from manoeuvre_nn.commands.settings import MAX_THREADS, NAMES, PATH, SWITCH, WORD, check_settings, or_null, whole
from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.core.threads import use_threads
from manoeuvre_nn.core.writing import locked, write_file
from manoeuvre_nn.report.html import data_address, save_figure
from studies.reproduction.document import (
    Done,
    Reproduction,
    reproduction_json,
    section_from_json,
    section_to_json,
)
from studies.reproduction.figures import reproduction_figure
from studies.reproduction.page import reproduction_html
from studies.reproduction.paper import Paper, read_paper
from studies.reproduction.processes import Event, Task, do_chapters
from studies.reproduction.section import Chapter, ChapterResult, ComputingEffort, Plot
from studies.reproduction.terminal import clock, print_chapter, print_overview
from studies.reproduction.watch import Watch

RESULT, PAGE = "reproduction.json", "reproduction.html"
WIDTH = 110
"""Columns where the output goes to a file."""
SETTINGS = {
    "chapters": NAMES, "out": PATH, "paper": or_null(WORD), "quick": SWITCH, "seed": whole(0), "starts": whole(1),
    "workers": whole(1, MAX_THREADS),
}  # fmt: skip
"""Setting -> what it may be."""


@dataclass(frozen=True)
class ReproductionJob:
    """What was asked for.

    Attributes:
        paper: The paper.
        chapters: Name -> what does it, in the paper's order.
        effort: How much computing is allowed.
        workers: Processes at a time.
        out: Output folder.
    """

    paper: Paper
    chapters: Mapping[str, Chapter]
    effort: ComputingEffort
    workers: int
    out: Path

    @property
    def numbers(self) -> dict[str, Any]:
        """What the numbers depend on: a command with others may not go on in the same folder."""
        return {"paper": self.paper.name, **asdict(self.effort)}

    def kept(self, name: str, ending: str = "json") -> Path:
        """Where a finished chapter is kept.

        Args:
            name: The chapter.
            ending: Of the file; ``log`` for what it printed.

        Returns:
            The file.
        """
        return self.out / "chapters" / f"{name}.{ending}"


def run_reproduction(cfg: DictConfig) -> None:
    """Run the command; wrong input ends in one line.

    Args:
        cfg: The config.
    """
    with guard.one_line():
        use_threads(1)
        job, console = job_of(cfg), Console()
        roomy = console.is_terminal or "COLUMNS" in os.environ
        with locked(job.out):
            reproduce(job, console if roomy else Console(width=WIDTH))


def job_of(cfg: DictConfig) -> ReproductionJob:
    """Read and check the settings.

    Args:
        cfg: The config.

    Returns:
        What is asked for. A wrong setting is refused in one line.
    """
    check_settings(cfg, kinds=SETTINGS)
    paper = read_paper(cfg.paper)
    named = wanted(names(cfg.chapters), list(paper.chapters))
    effort = ComputingEffort(cfg.quick, cfg.starts, cfg.seed)
    return ReproductionJob(
        paper, {name: paper.chapter(name) for name in named}, effort, cfg.workers, Path(str(cfg.out))
    )


def wanted(named: Iterable[Any], known: list[str]) -> list[str]:
    """Chapters that were asked for.

    Args:
        named: ``all``, or numbers; 5 stands for 5.2 and 5.3 too.
        known: Chapters of the paper.

    Returns:
        Their names, in the paper's order.

    Raises:
        InputError: If there is none, or one is unknown.
    """
    asked = [str(name) for name in named]
    if not asked:
        raise InputError(f"chapters=[] names none; write chapters=all, or some of: {', '.join(known)}")
    if asked == ["all"]:
        return known
    for name in asked:
        if not any(other == name or other.startswith(f"{name}.") for other in known):
            check_choice("chapter", name, known)
    return [other for other in known if any(other == name or other.startswith(f"{name}.") for name in asked)]


def reproduce(job: ReproductionJob, console: Console) -> None:
    """Do the chapters that were not done before, tell what came of each, and write everything.

    Args:
        job: What is asked for.
        console: Where to print.

    Raises:
        KeyboardInterrupt: On ctrl-C, after a line.
    """
    began = monotonic()
    settings = OmegaConf.create(job.numbers)
    check_same_run(settings, job.out)
    before = {name: done for name in job.chapters if (done := read_kept(job, name))}
    write_provenance(settings, job.out)
    try:
        chapters = _do_and_tell(job, before, console)
    except KeyboardInterrupt:
        console.print(f"stopped; the same command with out={job.out} goes on from here", soft_wrap=True)
        raise
    paper = job.paper
    whole = Reproduction(paper.name, paper.title, paper.source, job.effort, chapters, versions(), monotonic() - began)
    write_all(whole, job.out, console)
    print_overview(whole, console)
    here = job.out.relative_to(Path.cwd()) if job.out.is_relative_to(Path.cwd()) else job.out
    console.print(
        f"report: {here / PAGE}   numbers: {here / RESULT}   in {clock(monotonic() - began)}",
        soft_wrap=True,
        highlight=False,
    )
    guard.failed_jobs += [done.name for done in chapters if done.section is None]


def _do_and_tell(job: ReproductionJob, before: Mapping[str, Done], console: Console) -> list[Done]:
    """Do what is left; each chapter is printed as soon as it and all before it are there."""
    done, told = dict(before), list[str]()
    todo = [name for name in job.chapters if name not in done]
    if before:
        console.print(f"done before: chapter {', '.join(before)}", highlight=False)
    tasks = [Task(name, job.chapters[name], partial(keep, job, name), job.kept(name, "log")) for name in todo]
    events = do_chapters(tasks, job.effort, job.workers)
    with Watch(console, len(todo)) as watch, closing(events):
        for event in chain([Event("tick")], events):
            watch.see(event)
            if event.kind == "finished":
                done[event.name] = read_kept(job, event.name) or Done(event.name, None, "it was not kept")
            elif event.kind == "failed":
                done[event.name] = Done(event.name, None, event.text, watch.seconds(event.name))
            for name in takewhile(done.__contains__, list(job.chapters)[len(told) :]):
                told.append(name)
                print_chapter(done[name], console)
    return [done[name] for name in job.chapters]


def keep(job: ReproductionJob, name: str, section: ChapterResult, seconds: float) -> None:
    """Keep a finished chapter; nobody ever finds half a file.

    Args:
        job: What is asked for.
        name: The chapter.
        section: What came of it.
        seconds: How long it took [s].
    """
    content = {**job.numbers, "chapter": name, "seconds": seconds, "section": section_to_json(section)}
    write_file(job.kept(name), json.dumps(content))


def read_kept(job: ReproductionJob, name: str) -> Done | None:
    """A chapter that was finished before.

    Args:
        job: What is asked for.
        name: The chapter.

    Returns:
        The chapter, None if there is none.

    Raises:
        InputError: If the file is damaged or of something else.
    """
    path = job.kept(name)
    if not path.is_file():
        return None
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        same = {key: found[key] for key in (*job.numbers, "chapter")} == {**job.numbers, "chapter": name}
        done = Done(name, section_from_json(found["section"]), seconds=float(found["seconds"]))
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{path} is damaged: remove it, and the same command does chapter {name} again") from error
    if not same:
        raise InputError(f"{path} is of another command: remove it or choose another out")
    return done


def write_all(r: Reproduction, out: Path, console: Console) -> None:
    """Write ``reproduction.json``, ``reproduction.html`` and ``figures/*.png``.

    Args:
        r: The reproduction.
        out: Output folder.
        console: Where to say what is being done.
    """
    files: dict[str, list[str]] = {}
    images: dict[str, list[str]] = {}
    taken: set[str] = set()
    with console.status("drawing") as status:
        for done in r.chapters:
            for plot in done.section.plots if done.section else ():
                status.update(f"drawing {plot.name}")
                name = _file_name(plot, done.name, taken)
                figure = reproduction_figure(plot)
                save_figure(figure, out / "figures" / name, dpi=120)
                files.setdefault(done.name, []).append(f"figures/{name}")
                images.setdefault(done.name, []).append(data_address(figure))
    write_file(out / RESULT, json.dumps(reproduction_json(r, files), indent=1, allow_nan=False))
    reproduction_html(r, images, out / PAGE)


def _file_name(plot: Plot, chapter: str, taken: set[str]) -> str:
    """A name that no other figure has."""
    stem = re.sub(r"[^\w.-]+", "_", plot.name)
    name = f"{stem}.png" if f"{stem}.png" not in taken else f"{stem}_chapter_{chapter}_{len(taken)}.png"
    taken.add(name)
    return name
