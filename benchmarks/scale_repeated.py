"""What is done again and again in one process."""

import gc
import importlib
import json
import os
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from scale_growing import command
from scale_inputs import write_case

Done = Callable[[int], None]
"""Is told how many repetitions are done."""
Kinds = Iterator[tuple[str, Callable[[Done], object]]]
READINGS = 60
"""Least number of readings that are taken, where there are as many repetitions."""
TINY = (
    "ship=mariner", "manoeuvre=zz35", "data.length=60", "score=[{zz20: {duration: 60}}]", "scoring.solver=rollout",
    "trainer.progress=false",
)  # fmt: skip
ONE_STEP = ("network=wang", "network.hidden=2", "fit=levenberg_marquardt", "fit.iterations_per_epoch=1")
METHODS = {
    "levenberg_marquardt": (*ONE_STEP, "fit.stops.min_grad=0"),
    "backprop": ("network=wang", "network.hidden=2", "fit=backprop", "fit.iterations_per_epoch=2"),
    "closed_loop": ("network=modulus", "fit=closed_loop", "fit.enough=1e-300", "data.length=150"),
    "ensemble": ("network=hull_rudder", "network.members={count}", "network.hidden=2", "fit=ensemble", "fit.epochs=3"),
}
"""Way of training -> settings; an ensemble trains a member an epoch."""


def watched(work: Callable[[Done], object], told: Path) -> None:
    """Do the work, and write down repetitions done, memory [MB], open files, threads and CPU time now and then."""
    with told.open("w") as file:

        def read(done: int) -> None:
            gc.collect()
            size = int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20
            files, threads = len(os.listdir("/proc/self/fd")), threading.active_count()
            print(done, size, files, threads, time.process_time(), file=file, flush=True)

        work(read)


def epochs(count: int, folder: Path) -> Kinds:
    """A training of so many epochs by each method; a reading after the callback that comes last has kept it."""
    from manoeuvre_nn.training import session

    for method, words in METHODS.items():

        def work(read: Done, method: str = method, words: tuple[str, ...] = words) -> None:
            def reading(keeper: Any, trainer: Any, module: Any) -> None:
                keep(keeper, trainer, module)
                if (trainer.current_epoch + 1) % max(count // READINGS, 1) == 0:
                    read(trainer.current_epoch + 1)

            keep = session._BestAndLast.on_train_epoch_end
            session._BestAndLast.on_train_epoch_end = reading  # type: ignore[method-assign]
            length = (f"trainer.max_epochs={count}", f"scoring.every={count}", f"out={folder / method}")
            command("train", *TINY, *(word.format(count=count) for word in words), *length)

        yield method, work


def jobs(count: int, folder: Path) -> Kinds:
    """A sweep of so many trainings, all in one process: hydra's own launcher."""

    def work(read: Done) -> None:
        _watch("manoeuvre_nn.commands.train", "run_job", read, count)
        sweep = ("hydra/launcher=basic", f"out={folder / 'sweep'}", f"seed=range(0,{count})")
        command("train", "-m", *TINY, *ONE_STEP, "trainer.max_epochs=1", *sweep)

    yield "one process", work


def cases(count: int, folder: Path) -> Kinds:
    """A folder of so many cases, two runs of 150 s each and one candidate."""
    place = folder / "cases"

    def work(read: Done) -> None:
        _watch("manoeuvre_nn.commands.diagnose", "_answer_case", read, count)
        _write_cases(place, count)
        asked = ("candidates=[current]", "workers=1", "rudder_positive_to=starboard")
        command("diagnose", f"cases={place}", f"out={folder / 'answers'}", *asked)

    yield "one process", work


def _write_cases(place: Path, count: int) -> None:
    """The same two runs in every case."""
    runs = [{"run": n, "file": f"{n}.csv", "split": split} for n, split in (("a", "fit"), ("b", "held_out"))]
    for number in range(count):
        case = place / f"c{number:04}"
        case.mkdir(parents=True)
        for run in runs:
            write_case(case / run["file"])
        told = {"ship": "mariner", "case": case.name, "runs": runs}
        (case / "manifest.json").write_text(json.dumps(told))


def _watch(module: str, function: str, read: Done, count: int) -> None:
    """Take a reading after some of the calls of a function."""
    home = importlib.import_module(module)
    done, inner = [0], getattr(home, function)

    def counted(*given: Any, **named: Any) -> Any:
        result = inner(*given, **named)
        done[0] += 1
        if done[0] % max(count // READINGS, 1) == 0:
            read(done[0])
        return result

    setattr(home, function, counted)
