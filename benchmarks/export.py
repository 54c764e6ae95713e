"""What each format of ``manoeuvre export`` makes of each kind of model: how far it sails off, and what a step costs.

    python benchmarks/export.py [models=wang,cubic] [out=export.md]

Networks are trained on the Mariner's zz35 (360 s, without noise) in short forms. What is written sails a zz20 and a
tc25 beside the model; printed is the largest distance between the tracks over L. Pages of LaTeX and spreadsheets are
compared point by point alone: theirs is the largest difference of the rates over the largest rate. Times are the least
of repeated measurements of one thread: an evaluation of the rates at one state; of the unit of co-simulation a step of
one second: four evaluations and the steering gear; of a recursive network its own step. Where libcosimpy is installed,
two units are stepped through a turning circle by libcosim too, the core of the Open Simulation Platform.
"""

import logging
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import torch

import manoeuvre_nn as mnn
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.core.threads import use_threads
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.effect.current import Current
from manoeuvre_nn.effect.depth import ShallowWater
from manoeuvre_nn.effect.wind import SteadyWind
from manoeuvre_nn.formulas.check import LOADERS
from manoeuvre_nn.formulas.fmu import signals_of
from manoeuvre_nn.formulas.formats import FORMATS, Written, write_down
from manoeuvre_nn.formulas.models import to_program
from manoeuvre_nn.formulas.program import Program
from manoeuvre_nn.formulas.rollouts import TRIALS, Unit, sailed
from manoeuvre_nn.ship.esso_190k import esso_190k
from manoeuvre_nn.ship.mariner import mariner, mariner_chislett1965

try:
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
    from libcosimpy.CosimManipulator import CosimManipulator
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave
except ImportError:
    CosimExecution = None

REPEATS, TIMED = 5, ("python", "c", "onnx")
SECOND = 1.0


def trained(network: str, *settings: str) -> Callable[[], torch.nn.Module]:
    """A network that is trained on the Mariner's zz35 when it is asked for."""

    def make() -> torch.nn.Module:
        runs = mnn.simulate("mariner", [{"zz35": {"duration": 360.0}}])
        return mnn.fit("mariner", list(runs), network, settings).model

    return make


def windy() -> Vessel:
    """A trained series in a wind and a current."""
    model = trained("cubic")()
    wind, current = SteadyWind(model.hull, speed=12.0, from_deg=60.0), Current(model.hull, speed=0.8, toward_deg=30.0)
    return Vessel(model, [wind, current])


def shallow() -> Vessel:
    """The tanker in water of 1.5 draughts."""
    ship = esso_190k()
    return Vessel(CalmWater(ship), [ShallowWater(ship, depth_m=1.5 * ship.particulars.draught)])


MODELS: Mapping[str, Callable[[], torch.nn.Module | Vessel]] = {
    "hull_rudder (16 members)": trained("hull_rudder", "fit.epochs=3"),
    "cubic": trained("cubic"),
    "abkowitz": trained("abkowitz"),
    "wang": trained("wang", "linear=clarke", "fit=levenberg_marquardt", "trainer.max_epochs=20"),
    "rajesh": trained("rajesh", "linear=clarke", "fit=levenberg_marquardt", "trainer.max_epochs=20"),
    "cubic, wind and current": windy,
    "Mariner of 1965": lambda: CalmWater(mariner_chislett1965()),
    "Mariner": lambda: CalmWater(mariner()),
    "tanker in shallow water": shallow,
    "recursive": trained("recursive", "network.freedom=3", "trainer.max_epochs=2"),
}


def least(call: Callable[[], object], count: int) -> float:
    """Least time of a call [us] of repeated measurements of several calls."""
    found = []
    for _ in range(REPEATS):
        begun = time.perf_counter()
        for _ in range(count):
            call()
        found.append((time.perf_counter() - begun) / count)
    return 1e6 * min(found)


def times(program: Program, made: Mapping[str, Written]) -> dict[str, float]:
    """Time of an evaluation of the rates by each format and by the model itself, and of a unit's step [us]."""
    vessel = program.vessel
    assert vessel is not None
    columns = {q.name: np.array([q.example]) for q in program.inputs} | {
        "v": np.array([-0.3]),
        "delta": np.array([0.2]),
    }
    found = {}
    for kind in TIMED:
        run = LOADERS[kind](program, made[kind].content)
        if run is not None:
            found[kind] = least(lambda run=run: run(columns), 200)
    if not program.gives_rates:
        point = np.array([[columns[q.name][0] for q in program.inputs]])
        return found | {"model": least(lambda: program.reference(point), 200)}
    state = torch.zeros(1, 6, dtype=torch.float64)
    state[0, 0] = vessel.model.particulars.speed
    inputs = Inputs(torch.full((1,), 0.2, dtype=torch.float64), time=torch.zeros(1, dtype=torch.float64))
    state = vessel.model.start(state, inputs)
    with torch.inference_mode():
        found["model"] = least(lambda: vessel.model(state, inputs), 200)
    unit = Unit(program, made["fmu"].content)
    if unit.library is not None:
        ship = unit.started()
        found["fmu"] = least(lambda: unit.step(ship, 0.0, SECOND), 200)
        unit.free(ship)
    return found


def in_libcosim(program: Program, content: bytes) -> float | None:
    """Largest distance over L between two units in libcosim, one to each side, and the model; None if not installed."""
    if CosimExecution is None:
        return None
    assert program.vessel is not None
    (run,) = [r for r in sailed(program) if r.name == TRIALS[1].name]
    places = {s.quantity.name: k for k, s in enumerate(signals_of(program))}
    with TemporaryDirectory() as folder:
        path = Path(folder, "ship.fmu")
        path.write_bytes(content)
        execution = CosimExecution.from_step_size(step_size=int(1e9 * float(run.time[1] - run.time[0])))
        slaves = [execution.add_local_slave(CosimLocalSlave(fmu_path=str(path), instance_name=n)) for n in ("a", "b")]
        observer, hand = CosimObserver.create_last_value(), CosimManipulator.create_override()
        execution.add_observer(observer)
        execution.add_manipulator(hand)
        order = float(run["delta_order"][0])
        for slave, side in zip(slaves, (1.0, -1.0), strict=True):
            hand.slave_real_values(slave, [places["delta_order"]], [side * order])
        execution.simulate_until(target_time=int(1e9 * float(run.time[-1])))
        x, y = observer.last_real_values(slaves[0], [places["x"], places["y"]])
    return float(np.hypot(x - run["x"][-1], y - run["y"][-1]) / program.vessel.model.particulars.length)


def row(name: str, make: Callable[[], torch.nn.Module | Vessel]) -> tuple[list[str], list[str]]:
    """A row of both tables."""
    try:
        program = to_program(make())
    except InputError as error:
        print(f"{name}: {error}", flush=True)
        return [name, *["refused"] * len(FORMATS)], []
    runs, made, cells = sailed(program), {}, []
    for kind in FORMATS:
        try:
            made[kind] = write_down(program, kind, runs=runs)
        except InputError as error:
            print(f"{name}: {error}", flush=True)
            cells.append("refused")
            continue
        tracks = made[kind].deviations
        cells.append(f"{max(d.largest for d in tracks):.1e}" if tracks else f"{made[kind].difference:.1e} (rates)")
    measured = times(program, made)
    apart = in_libcosim(program, made["fmu"].content) if "fmu" in made else None
    columns = ("model", *TIMED, "fmu")
    print(f"{name}: {dict(zip(FORMATS, cells, strict=True))}; libcosim {apart}; {measured}", flush=True)
    timed = [f"{measured[kind]:.3g}" if kind in measured else "-" for kind in columns]
    return [name, *cells], [name, *timed, "-" if apart is None else f"{apart:.1e}"]


def table(heading: list[str], rows: list[list[str]]) -> str:
    """A table in Markdown."""
    lines = [heading, ["---"] * len(heading), *(r for r in rows if r)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"


def main(words: list[str]) -> None:
    """Print the tables, and write them where ``out`` says."""
    settings = dict(word.partition("=")[::2] for word in words)
    chosen = settings.get("models", "").split(",") if "models" in settings else list(MODELS)
    if set(settings) - {"models", "out"} or set(chosen) - set(MODELS):
        sys.exit(f"error: write models= with some of {', '.join(MODELS)}, and out=FILE")
    use_threads(1)
    logging.disable(logging.INFO)
    if CosimExecution is not None:
        log_output_level(CosimLogLevel.ERROR)
    rows = [row(name, MODELS[name]) for name in chosen]
    text = table(["model", *FORMATS], [r for r, _ in rows])
    text += "\n" + table(
        ["model", "model [us]", *(f"{k} [us]" for k in TIMED), "fmu, a step of 1 s [us]", "libcosim [L]"],
        [r for _, r in rows],
    )
    print(text)
    if "out" in settings:
        Path(settings["out"]).write_text(text)


if __name__ == "__main__":
    main(sys.argv[1:])
