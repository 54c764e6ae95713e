"""``manoeuvre simulate``: a ship sailed through manoeuvres, with what effects do to it."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from omegaconf import DictConfig
from rich.console import Console

from manoeuvre_nn.commands import config as configs
from manoeuvre_nn.commands.job import ship_on_approach
from manoeuvre_nn.commands.provenance import CONFIG, write_provenance
from manoeuvre_nn.core.channels import ACCELERATION
from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.manoeuvre import Manoeuvre
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.core.terminal import Terminal
from manoeuvre_nn.core.threads import use_threads
from manoeuvre_nn.core.waiting import waiting
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.simulate import simulate as solve
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.recording.noise import add_noise
from manoeuvre_nn.report.html import save_figures
from manoeuvre_nn.report.runs import run_rows, runs_figure
from manoeuvre_nn.report.tables import rich_table
from manoeuvre_nn.training.data import Say
from manoeuvre_nn.training.settings import check_positive, check_simulable, noise_in_si


def simulate(cfg: DictConfig, out: Path, console: Console | None = None) -> list[Recording]:
    """Sail the manoeuvres of a config, and write what was recorded into the output folder."""
    console = console or Terminal()
    use_threads(1)
    cfg = configs.with_effects(cfg)
    ship = ship_on_approach(cfg)
    check_simulable(ship)
    assert isinstance(ship, Ship)
    effects = configs.chosen_effects(cfg.get("effect"), ship)
    manoeuvres = configs.training_manoeuvres(cfg.manoeuvre)
    _check_overwrites(out, [manoeuvre.name for manoeuvre in manoeuvres])
    with waiting(console) as say:
        runs = sail(ship, manoeuvres, effects, noise_in_si(cfg.noise), rate_hz=cfg.rate_hz, seed=cfg.seed, say=say)
        say("writing and drawing the runs")
        write_provenance(cfg, out)
        write_runs(runs, ship.particulars, out)
    console.print(rich_table(run_rows(runs, ship.particulars.length), f"The {ship.particulars.name}"))
    console.print(f"written: {out}/*.csv, {out / 'figures'}", soft_wrap=True, highlight=False)
    return runs


def _check_overwrites(out: Path, names: Sequence[str]) -> None:
    """Refuse to write over recordings in a folder that this command has not written to before: they may be measured."""
    there = [name for name in names if (out / f"{name}.csv").exists()]
    if there and not (out / CONFIG).exists():
        raise InputError(f"{out / there[0]}.csv is there already, and no simulation wrote it: choose another out=")


def sail(
    ship: Ship | Particulars,
    manoeuvres: Sequence[Manoeuvre],
    effects: Sequence[Effect] = (),
    noise: Mapping[str, float] | None = None,
    *,
    rate_hz: float | None = None,
    seed: int = 0,
    say: Say = lambda *_: None,
) -> list[Recording]:
    """Sail a ship through manoeuvres.

    Args:
        ship: The ship; one of which only particulars are known is refused.
        manoeuvres: What the helmsman does.
        effects: What acts on the ship beside calm water.
        noise: Channel -> standard deviation of what sensors add [SI].
        rate_hz: Samples a second; None is the ship's usual rate.
        seed: Seed of the noise.
        say: Is told what is being sailed.

    Returns:
        A recording each.

    Raises:
        InputError: If no manoeuvre is named, or the ship cannot sail one of them.
    """
    check_simulable(ship)
    assert isinstance(ship, Ship)
    check_positive("rate_hz", rate_hz)
    if not manoeuvres:
        raise InputError("manoeuvre=[] names no manoeuvre: write for instance manoeuvre=zz20")
    for manoeuvre in manoeuvres:
        manoeuvre.check(ship.particulars)
    vessel = Vessel(CalmWater(ship), effects)
    runs = []
    for k, m in enumerate(manoeuvres, start=1):
        lasts = f"{m.duration_for(ship.particulars):g} s"
        say(f"sailing {m.name} over {lasts} ({k} of {len(manoeuvres)})", (k - 1) / len(manoeuvres))
        runs.append(solve(vessel, m, interval=1 / rate_hz if rate_hz else None))
    return [add_noise(run, noise, seed=seed + k) for k, run in enumerate(runs)] if noise else runs


def as_sensed(run: Recording) -> Recording:
    """What instruments would have recorded of a simulated run.

    Args:
        run: The run; its u and v are velocities through the water.

    Returns:
        The run with the forward speed as that of a log, and without v and accelerations, which no instrument shows; its
        velocity over ground is that of its positions. A measured run stays as it is.
    """
    if not run.is_simulated:
        return run
    channels = {k: c for k, c in run.channels.items() if k not in {"u", "v", *ACCELERATION}}
    return replace(run, channels={**channels, "u_log": run.channels.get("u_log", run["u"])})


def write_runs(runs: Sequence[Recording], ship: Particulars, out: Path) -> None:
    """Write a csv each run, and a figure of all tracks, into the output folder."""
    for run in runs:
        as_sensed(run).to_csv(out / f"{run.name}.csv")
    save_figures({"runs": runs_figure(runs, ship.length)}, out / "figures")
