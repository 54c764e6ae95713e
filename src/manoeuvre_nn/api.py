"""The front door: read, simulate, fit, score, diagnose and export from Python, by the functions of the commands.

import manoeuvre_nn as mnn

runs = mnn.simulate("mariner", ["zz20", "tc25", "zz10"], effects=["wind_steady"])
model = mnn.fit("mariner", runs[:1])
print(mnn.score(model, runs[1:]))
print(mnn.diagnose("mariner", runs))
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from matplotlib.figure import Figure

from manoeuvre_nn.commands import config as configs
from manoeuvre_nn.commands.diagnosis_setup import setup
from manoeuvre_nn.commands.export import checkpoint_of, program_of, with_effects
from manoeuvre_nn.commands.groups import compose, option, settings_in
from manoeuvre_nn.commands.job import load_model, prepare, with_rate
from manoeuvre_nn.commands.provenance import write_provenance
from manoeuvre_nn.commands.shelves import build
from manoeuvre_nn.commands.simulate import as_sensed, sail
from manoeuvre_nn.commands.train import fit as fit_job
from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.manoeuvre import Manoeuvre
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.core.terminal import Terminal
from manoeuvre_nn.core.units import KNOT
from manoeuvre_nn.core.writing import locked
from manoeuvre_nn.diagnosis.case import case_of
from manoeuvre_nn.diagnosis.diagnose import diagnose as find_causes
from manoeuvre_nn.dynamics.model import CalmWater, IdentifiedShip
from manoeuvre_nn.dynamics.recursive import RecursiveShip
from manoeuvre_nn.formulas.formats import FORMATS, kind_of, write_down
from manoeuvre_nn.formulas.models import to_program
from manoeuvre_nn.formulas.ranges import recorded_ranges
from manoeuvre_nn.recording.read.mapping import Mapping as ColumnMapping
from manoeuvre_nn.recording.read.reader import read_recordings
from manoeuvre_nn.report.views import Answer, Runs, Scores
from manoeuvre_nn.scoring.held_out import references
from manoeuvre_nn.training.settings import noise_in_si

Named = str | Mapping[str, Mapping[str, Any]]
"""The name of a yaml in conf, or ``{name: {setting: value}}``."""
AnyShip = str | Ship | Particulars
"""The name of a ship in conf/ship, the path of a yaml like those there, or an object."""
YAML = ".yaml"


@dataclass(frozen=True, repr=False)
class FittedModel:
    """A model that was fitted to recordings.

    Attributes:
        model: The model: particulars, known part and network.
        runs: What it was fitted to.
        source: Sentence on the data.
        folder: Where checkpoint and config are, if they were kept.
    """

    model: IdentifiedShip | RecursiveShip
    runs: Runs
    source: str
    folder: Path | None = None

    @cached_property
    def scores(self) -> Scores:
        """How it does on the runs that it was fitted to, in closed loop."""
        return score(self, self.runs)

    def __repr__(self) -> str:
        """What it was fitted to, and how it does there."""
        return f"Fitted to {self.source}\n{self.scores!r}"

    def plot(self) -> Figure:
        """Predicted and recorded track of the run that it does worst on."""
        return self.scores.plot()


def read(
    path: str | Path | Sequence[str | Path], mapping: str | ColumnMapping | None = None, ship: AnyShip = "mariner"
) -> Runs:
    """Read recordings.

    Args:
        path: A file, a folder, a pattern such as ``runs/zz*.csv``, or a list of files.
        mapping: Path of a yaml that says which column holds what, its name in conf/recording, or a mapping. None: the
            files were written by this package (or have its columns in SI and radians).
        ship: The ship: a name in conf/ship, the path of a yaml of your own, or an object.

    Returns:
        The recordings.
    """
    columns = configs.read_mapping(mapping) if isinstance(mapping, str) else mapping
    particulars = _ship(ship).particulars
    return Runs(read_recordings(path, columns, particulars), particulars)


def simulate(
    ship: AnyShip,
    manoeuvre: Named | Manoeuvre | Sequence[Named | Manoeuvre],
    effects: Named | Effect | Sequence[Named | Effect] = (),
    noise: Mapping[str, float] | None = None,
    *,
    speed_kn: float | None = None,
    seed: int = 0,
) -> Runs:
    """Sail a ship through manoeuvres.

    Args:
        ship: A name in conf/ship, the path of a yaml of your own, or a ship with coefficients.
        manoeuvre: A name in conf/manoeuvre, ``{name: {setting: value}}``, a manoeuvre, or a list of these.
        effects: What acts on it beside calm water: a name in conf/effect, ``{name: {parameter: value}}``, an
            effect, or a list of these.
        noise: Standard deviations of what sensors add: u, v [m/s], x, y [m], r_deg_s, psi_deg, delta_deg.
        speed_kn: Approach speed [kn]; None is the ship's own.
        seed: Seed of the noise.

    Returns:
        The recordings.
    """
    chosen, speed = _ship(ship), None if speed_kn is None else speed_kn * KNOT
    if speed is not None and isinstance(chosen, Ship):
        chosen = chosen.on_approach(speed)
    wanted = [manoeuvre] if isinstance(manoeuvre, str | Mapping | Manoeuvre) else list(manoeuvre)
    sailed = [m if isinstance(m, Manoeuvre) else configs.named_manoeuvres([m], speed)[0] for m in wanted]
    listed = [effects] if isinstance(effects, str | Mapping | Effect) else effects
    acting = [made for given in listed for made in _effects(given, chosen)]
    return Runs(sail(chosen, sailed, acting, noise_in_si(noise or {}), seed=seed), chosen.particulars)


def fit(
    ship: AnyShip,
    runs: Runs | Sequence[Recording],
    network: str = "cubic",
    settings: Sequence[str] = (),
    out: str | Path | None = None,
) -> FittedModel:
    """Fit a model to recordings, as ``manoeuvre train data=recording`` does.

    Args:
        ship: A name in conf/ship, the path of a yaml of your own, or an object; of measured ships particulars are
            enough.
        runs: Recordings of it.
        network: Model to fit, by its name in conf/network: a series (``cubic``, ``modulus``, ``abkowitz``), an
            ensemble (``hull_rudder``); it chooses its fit, unless ``settings`` do.
        settings: Further words as on the command line: ``["network.members=4", "trainer.max_epochs=10"]``.
        out: Folder to keep checkpoint and config in; None keeps nothing.

    Returns:
        The model.

    Raises:
        InputError: If ``out`` is to keep the config of a ship that no yaml describes.
    """
    if out is not None and not isinstance(ship, str):
        raise InputError(f"out={out} keeps a config, which says the ship by name or by a yaml: give one of these")
    named = [f"ship={ship}"] if isinstance(ship, str) and not ship.endswith(YAML) else []
    words = ["data=recording", f"network={network}", *named, "trainer.progress=false", *settings]
    cfg = compose("train", words)
    if isinstance(ship, str) and not named:
        cfg.ship = _described(ship)
    job = prepare(cfg, tuple(runs), None if isinstance(ship, str) else ship)
    with TemporaryDirectory() as scratch:
        folder = Path(scratch if out is None else out)
        with locked(folder):
            write_provenance(cfg, folder)
            trained = fit_job(cfg, job, folder, Terminal(quiet=True))
            for logger in trained.loggers:
                logger.finalize("success")
    model = trained.fit.dynamics.double().cpu()
    kept = None if out is None else Path(out)
    return FittedModel(model, Runs(tuple(runs), model.particulars), job.data.describe(), kept)


def score(model: Any, runs: Runs | Sequence[Recording]) -> Scores:
    """Sail a model through recorded runs, in closed loop from their first samples on, and compare.

    Args:
        model: What :func:`fit` gave, a model, a ship (name or object) in calm water, or the path of a checkpoint.
        runs: Recordings.

    Returns:
        Scores.
    """
    sailed = _model(model)
    held_out = references(tuple(runs), sailed.particulars)
    predictions = held_out.predict(sailed)
    scores = held_out.score(predictions, held_out.predict_members(sailed), held_out.steer(sailed))
    return Scores(scores, held_out.references, predictions)


def diagnose(
    ship: AnyShip,
    runs: Runs | Sequence[Recording],
    model: Any = None,
    candidates: str | Sequence[str] = "default",
    held_out: str | Sequence[str] = "auto",
    workers: int = 1,
) -> Answer:
    """Find out what a calm-water model leaves out of recordings, as ``manoeuvre diagnose`` does.

    Args:
        ship: A name in conf/ship, the path of a yaml of your own, or a ship with coefficients.
        runs: Recordings of it.
        model: A fitted model, or the path of a checkpoint, instead of the ship's coefficients. Beside a checkpoint lies
            what its own training says of the model; where that is bad, the answer says it.
        candidates: ``default``, ``tank``, ``all``, or names of effects.
        held_out: Names of the runs to prove by; ``auto`` chooses about a third.
        workers: Processes among which the fits are shared out.

    Returns:
        The answer.

    Raises:
        InputError: If the ship has no coefficients and no model is given.
    """
    listed = candidates if isinstance(candidates, str) else f"[{','.join(candidates)}]"
    cfg = compose("diagnose", [f"candidates={listed}", f"workers={workers}", "out=."])
    fitted = None
    if _is_checkpoint(model):
        cfg.model = str(model)  # setup reads what its own training says of it, too
    elif model is not None:
        fitted = with_rate(_model(model), "a diagnosis")
    common = setup(cfg, fitted)
    hull = _ship(ship) if common.model is None else common.model.known
    if not isinstance(hull, Ship):
        raise InputError(
            f"the {hull.name} has particulars but no coefficients: give model=, or a ship with coefficients"
        )
    proved_by = held_out if held_out == "auto" else configs.as_list(held_out)
    case = case_of([as_sensed(run) for run in runs], hull, proved_by)
    return Answer(find_causes(common.question(case)))


def export(
    model: Any,
    to: str | Path = "python",
    *,
    effects: Named | Effect | Sequence[Named | Effect] = (),
    document: bool = True,
) -> str | bytes:
    """Write a model down as ``manoeuvre export`` does; what is written is run and compared with the model.

    Args:
        model: What :func:`fit` gave, the output folder of a training or a checkpoint of it, a model, or a ship (name or
            object) in calm water.
        to: A format: ``latex``, ``python``, ``c``, ``csv``, ``onnx``, ``fmu``, ``gazebo`` or ``mss``; or a file to
            write, whose ending (``.tex``, ``.py``, ``.c``, ``.csv``, ``.onnx``, ``.fmu``, ``.sdf``, ``.m``) says the
            format.
        effects: What acts on the ship, see :func:`simulate`.
        document: Whether LaTeX is a document of its own; else it is a part of one.

    Returns:
        The text; of ONNX and FMU the bytes of the file.
    """
    listed = [effects] if isinstance(effects, str | Mapping | Effect) else effects

    def make(ship: Ship) -> list[Effect]:
        return [made for given in listed for made in _effects(given, ship)]

    path = None if str(to) in FORMATS else Path(to)
    kind = str(to) if path is None else kind_of(path)
    if isinstance(model, FittedModel):
        notes = [f"Network: {type(model.model.network).__name__}. Trained on {model.source}"]
        program = to_program(with_effects(model.model, make), recorded_ranges(model.model, tuple(model.runs)), notes)
    elif isinstance(model, Path) or (isinstance(model, str) and Path(model).exists()):
        program = program_of(checkpoint_of(Path(model)), make if listed else None)
    else:
        moves = _model(model)
        program = to_program(with_effects(moves, make) if listed else moves)
    written = write_down(program, kind, document=document)
    if path is not None:
        written.save(path)
    return written.content


def _ship(ship: AnyShip) -> Ship | Particulars:
    """A ship by its name in conf/ship, by its yaml, or as it is."""
    return build(_described(ship), "ship") if isinstance(ship, str) else ship


def _described(ship: str) -> dict[str, Any]:
    """What a ship's yaml says, found by its path or by its name in conf/ship."""
    if not ship.endswith(YAML):
        return option("ship", ship)
    return settings_in(Path(ship), "ship")


def _effects(named: Named | Effect, ship: Ship | Particulars) -> list[Effect]:
    """Effects by their names in conf/effect, values changed where some are given; or one as it is."""
    if isinstance(named, Effect):
        return [named]
    entries: Mapping[str, Mapping[str, Any]] = {named: {}} if isinstance(named, str) else named
    return [build({**option("effect", n), **values}, "effect", ship=ship) for n, values in entries.items()]


def _is_checkpoint(model: Any) -> bool:
    """Whether a path of a checkpoint is meant."""
    return isinstance(model, Path) or (isinstance(model, str) and model.endswith(".ckpt"))


def _model(model: Any) -> Any:
    """What moves: a fitted model, a checkpoint's, or a ship in calm water."""
    if isinstance(model, FittedModel):
        return model.model
    if _is_checkpoint(model):
        return load_model(Path(model))
    if isinstance(model, str | Ship):
        ship = _ship(model)
        if not isinstance(ship, Ship):
            raise InputError(f"the {ship.name} has particulars but no coefficients and cannot be sailed")
        return CalmWater(ship)
    return model
