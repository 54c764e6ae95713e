"""The job of ``manoeuvre coefficients``: coefficients with intervals from recordings, beside captive tests."""

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from omegaconf import DictConfig, OmegaConf
from pydantic import BaseModel, ConfigDict, Field
from rich.console import Console

from manoeuvre_nn.commands.job import NOTHING_HELD_OUT, make_fit, prepare
from manoeuvre_nn.commands.provenance import shown, versions, write_provenance
from manoeuvre_nn.commands.shelves import build, made_by, plain
from manoeuvre_nn.core.data_files import FORMAT, load_json, read_as, without_format
from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.core.terminal import Terminal
from manoeuvre_nn.core.threads import use_threads
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.core.waiting import waiting
from manoeuvre_nn.core.writing import write_file
from manoeuvre_nn.estimation.agreement import Agreement, birge_scaled_covariance
from manoeuvre_nn.estimation.captive_fit import fit_captive, towed
from manoeuvre_nn.estimation.closed_loop import first, solve
from manoeuvre_nn.estimation.coefficients import Fitted, approach_inertia, fitted_from, form_of
from manoeuvre_nn.estimation.linear_motion import COLUMNS, derived
from manoeuvre_nn.estimation.own_terms import fit_own_terms
from manoeuvre_nn.estimation.problem import Estimate, EstimationProblem
from manoeuvre_nn.recording.read.captive import CaptiveTests, read_captive
from manoeuvre_nn.recording.read.mapping import is_number
from manoeuvre_nn.recording.read.mapping_file import read_captive_mapping
from manoeuvre_nn.report.coefficient_figures import figures
from manoeuvre_nn.report.coefficient_tables import GROUPS, Coefficients, coefficients_json, notes, sentence, tables
from manoeuvre_nn.report.html import Report, save_figures, write_report
from manoeuvre_nn.report.tables import rich_table
from manoeuvre_nn.training.closed_loop_fit import ClosedLoopFit, breakdown_told, explained

PAGE, RESULT = "coefficients.html", "coefficients.json"
INERTIA = ("mx", "my", "mz", "Yrdot", "Nvdot")


Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
STRICT = ConfigDict(strict=True)


class _StoredShip(BaseModel):
    """Particulars of whose coefficients these are."""

    model_config = STRICT
    length: Positive
    draught: Positive
    speed: Positive
    rho: Positive
    rpm: Positive


class _StoredDerived(BaseModel):
    """What follows from coefficients."""

    model_config = STRICT
    name: str
    value: float | None
    interval_95: Annotated[list[float | None], Field(min_length=2, max_length=2)]
    words: str


class _StoredCoefficients(BaseModel):
    """What is read again of ``coefficients.json``."""

    model_config = STRICT
    ship: str
    particulars: _StoredShip
    derived: list[_StoredDerived]
    fitted: dict[str, Any]
    notes: Annotated[list[str], Field(min_length=1)]
    birge_ratio: Positive
    birge_degrees: float | None = None


def tell(cfg: DictConfig, out: Path, console: Console | None = None) -> Coefficients:
    """Fit or read coefficients, set captive tests beside them, and write everything.

    Args:
        cfg: The config.
        out: Output folder.
        console: Where to print.

    Returns:
        What is told.

    Raises:
        InputError: If settings do not go together.
    """
    console = console or Terminal()
    use_threads(1)
    check_choice("terms", cfg.terms, ["network", "own"])
    if cfg.captive.file is not None and cfg.terms == "own":
        raise InputError("captive.file: compares coefficients of series; choose terms=network")
    if made_by(cfg.fit, "fit") is not ClosedLoopFit:
        raise InputError(
            "coefficients are fitted in closed loop: write fit=closed_loop and network=cubic, modulus or abkowitz"
        )
    tests, inertia = _captive_tests(cfg), _inertia(cfg)
    told = _read(Path(str(cfg.run))) if cfg.run is not None else _fitted(cfg, console)
    if inertia is not None:
        told = _for_inertia(told, inertia)
    if tests is not None:
        told = _beside(told, tests, cfg)
    write_provenance(cfg, out)
    with waiting(console, "drawing and writing the report"):
        report = Report(
            title=f"Coefficients of the {told.ship.name}",
            summary=sentence(told),
            tables=tables(told),
            figures=write_coefficients(told, out),
            config=plain(cfg),
            versions=versions(),
            notes=notes(told),
            unfolded=tuple(tables(told)),
        )
        write_report(out / PAGE, report)
    _print(told, out, console)
    return told


def _fitted(cfg: DictConfig, console: Console) -> Coefficients:
    """Fit the recordings."""
    if cfg.terms == "own":
        return _own(cfg, console)
    with waiting(console, "reading and checking the recordings"):
        job = prepare(unscored(cfg))
        remarks = job.data.remarks()
    for line in remarks:
        console.print(f"note: {line}", highlight=False, soft_wrap=True)
    with waiting(console, "fitting in closed loop"):
        job.data.setup(stage=None)
        fit = make_fit(cfg, job)
        assert isinstance(fit, ClosedLoopFit)  # by the fit's _target_, which was checked first
        problem = explained(fit.dynamics, job.data.measured, fit.settings)
        with breakdown_told():
            start = first(problem, process_sd=fit.settings.force)
            found = solve(problem, start, passes=int(cfg.trainer.max_epochs), enough=fit.settings.enough)
            return coefficients_of(fit, problem, found, job.data.describe())


def coefficients_of(fit: ClosedLoopFit, problem: EstimationProblem, found: Estimate, source: str) -> Coefficients:
    """Coefficients of a series, their errors as wide as stretches of the recordings disagree.

    Args:
        fit: The fit.
        problem: What was explained.
        found: The solution.
        source: Sentence on what it was fitted to.

    Returns:
        Coefficients and what follows from them.
    """
    known, network, count = fit.dynamics.known, fit.network, fit.forces.count
    values, (covariance, agreement) = found.values[:count], birge_scaled_covariance(problem, found)
    fitted = Fitted(
        tuple(network.names), values, covariance, problem.mean, problem.spread, approach_inertia(known),
        form_of(network.terms),
    )  # fmt: skip
    follows = derived(fit.forces, values, covariance, fitted.inertia)
    return Coefficients(known.particulars, fitted, follows, source, agreement=agreement)


def write_coefficients(told: Coefficients, out: Path) -> dict[str, Figure]:
    """Write ``coefficients.json`` and the figures, which are returned."""
    drawn = figures(told)
    save_figures({f"coefficients/{name}": figure for name, figure in drawn.items()}, out / "figures")
    text = json.dumps({"format": FORMAT, **coefficients_json(told), "versions": versions()}, indent=1)
    write_file(out / RESULT, text)
    return {f"Coefficients in figures/{name}": figure for name, figure in drawn.items()}


def unscored(cfg: DictConfig) -> DictConfig:
    """The config without held-out manoeuvres and files, which would be sailed and read for nothing."""
    return OmegaConf.merge(cfg, {"score": None if "files" in cfg.data else NOTHING_HELD_OUT})  # type: ignore[return-value]


def _own(cfg: DictConfig, console: Console) -> Coefficients:
    """Fit the ship's own products."""
    ship = build(cfg.ship, "ship")
    if not isinstance(ship, Ship) or ship.table is None:
        name = ship.particulars.name
        raise InputError(f"terms=own: the forces of the {name} are no sum of known products; write terms=network")
    with waiting(console, "fitting in closed loop"):
        job = prepare(unscored(cfg))
        job.data.setup(stage=None)
        f = cfg.fit
        fitted, forces, agreement = fit_own_terms(
            ship, job.data.measured, float(cfg.relative), force=tuple(f.force), force_time=float(f.force_time),
            floor=tuple(f.floor), learn_force=bool(f.learn_force),
        )  # fmt: skip
    follows = derived(forces, fitted.values, fitted.covariance, fitted.inertia)
    return Coefficients(ship.particulars, fitted, follows, job.data.describe(), agreement=agreement)


def _read(folder: Path) -> Coefficients:
    """Take up what a run has written."""
    path = folder / RESULT if folder.is_dir() else folder
    if not path.is_file():
        raise InputError(
            f"run={folder} holds no {RESULT}: write a folder of manoeuvre train with network=cubic, modulus or abkowitz"
        )
    where = f"{path} was not written by manoeuvre train or coefficients"
    content = load_json(path)
    if not isinstance(content, Mapping):
        raise InputError(f"{where}: it holds a {type(content).__name__}")
    stored = read_as(_StoredCoefficients, without_format(content, str(path)), where)
    rows = [(d.name, d.value, *d.interval_95, d.words) for d in stored.derived]
    found = pd.DataFrame(rows, columns=COLUMNS).astype({"value": float, "low": float, "high": float})
    p = stored.particulars
    beam = 0.16 * p.length  # not stored and not used: a particulars has one
    ship = Particulars(stored.ship, p.length, beam, p.draught, 0.7, p.speed, 0.05, 0.6, rho=p.rho, rpm=p.rpm)
    agreement = Agreement(stored.birge_ratio, stored.birge_degrees or 0.0)
    return Coefficients(ship, fitted_from(stored.fitted), found, stored.notes[0], agreement=agreement)


def _inertia(cfg: DictConfig) -> np.ndarray | None:
    """The ship's inertia where the user knows it better."""
    if cfg.inertia is None:
        return None
    given = plain(cfg.inertia)
    if not {"mx", "my", "mz"} <= set(given) or not set(given) <= set(INERTIA):
        raise InputError(f"inertia={given}: write inertia={{mx: M, my: M, mz: M, Yrdot: 0, Nvdot: 0}}")
    for key, value in given.items():
        if not is_number(value):
            raise InputError(f"inertia: {key!s}={value!r}: expected a number, such as .3")
    m = {k: float(given.get(k, 0.0)) for k in INERTIA}
    if not (m["mx"] > 0 and m["my"] > 0 and m["mz"] > 0 and m["my"] * m["mz"] > m["Yrdot"] * m["Nvdot"]):
        raise InputError(f"inertia={given}: no ship's; mx, my and mz are more than 0, my mz more than Yrdot Nvdot")
    return np.array([[m["mx"], 0.0, 0.0], [0.0, m["my"], -m["Yrdot"]], [0.0, -m["Nvdot"], m["mz"]]])


def _for_inertia(told: Coefficients, inertia: np.ndarray) -> Coefficients:
    """The same motion with another inertia; of what follows, C alone changes."""
    ratio = float(np.linalg.det(inertia[1:, 1:]) / np.linalg.det(told.fitted.inertia[1:, 1:]))
    changed = told.derived.copy()
    changed.loc[changed["name"] == "stability C", ["value", "low", "high"]] *= ratio
    return replace(told, fitted=told.fitted.with_inertia(inertia), derived=changed)


def _captive_tests(cfg: DictConfig) -> CaptiveTests | None:
    """The table of captive tests, if one is named."""
    if cfg.captive.file is None:
        return None
    mapping = read_captive_mapping(cfg.captive.mapping, cfg.get("config_dir"))
    path = Path(str(cfg.captive.file))
    if not path.is_file():
        raise InputError(f"captive.file={path} does not exist")
    return read_captive(path, mapping)


def _beside(told: Coefficients, tests: CaptiveTests, cfg: DictConfig) -> Coefficients:
    """Set captive tests beside coefficients."""
    c = cfg.captive
    drift = c.largest_drift_deg * DEGREE
    used = towed(tests, told.ship.length / told.ship.draught, largest_drift=drift, speed=c.speed, shaft=c.shaft)
    return replace(told, tests=used, captive=fit_captive(used, told.fitted))


def _print(told: Coefficients, out: Path, console: Console) -> None:
    """Tables, what is to be minded, and where the rest is."""
    for heading, rows in tables(told).items():
        if rows and heading != GROUPS:
            console.print(rich_table(rows, heading))
    if len(told.groups):
        console.print(f"{GROUPS}:", style="bold")
    for g in told.groups.to_dict("records"):
        console.print(
            f"  {', '.join(g['symbols'])} (correlation {g['correlation']:.2f}): {g['words']}.", highlight=False
        )
        console.print(f"    known is {g['sum']}", highlight=False)
    for line in notes(told):
        console.print(f"note: {line}", highlight=False)
    console.print(sentence(told), highlight=False)
    here = shown(out)
    console.print(f"report: {here / PAGE}   numbers: {here / RESULT}", soft_wrap=True, highlight=False)
