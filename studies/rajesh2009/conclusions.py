"""Rajesh & Bhattacharyya 2009, sections 5.1, 5.3 and 6: shallow water, the best training manoeuvre, conclusions."""

import numpy as np

from manoeuvre_nn.core.manoeuvre import Manoeuvre
from manoeuvre_nn.manoeuvre.spiral import spiral
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.ship.esso_190k import PARTICULARS
from studies.rajesh2009.networks import (
    Judged,
    Row,
    Setting,
    TankerNetworks,
    judged,
    networks,
    spread,
    starts,
    tracks,
)
from studies.rajesh2009.ship import DEPTHS
from studies.rajesh2009.size import beats
from studies.reproduction.claims import read_claims
from studies.reproduction.section import ChapterResult, ComputingEffort, Plot, Say

TRIALS = [zigzag(15.0, duration=1500.0), zigzag(20.0, duration=1500.0), zigzag(25.0, duration=1500.0)]
TRIALS += [turning_circle(15.0), turning_circle(20.0), turning_circle(25.0)]
SHALLOW = [zigzag(20.0, duration=1500.0), zigzag(15.0, duration=1500.0), turning_circle(20.0)]
TRAINED_AT = 1.5
"""Depth over draught at which a network is trained in shallow water."""


def teachers() -> dict[str, Manoeuvre]:
    """Training manoeuvres to choose from, about 1500 s each.

    Returns:
        Name -> manoeuvre.
    """
    return {
        "zz20": zigzag(20.0, duration=1500.0),
        "tc20": turning_circle(20.0, duration=1500.0),
        "spiral": spiral(20.0, 10.0, hold=170.0),
    }


def chapter(effort: ComputingEffort, say: Say) -> ChapterResult:
    """Shallow water and section 6.

    Args:
        effort: How much computing is allowed.
        say: Told what is being done.

    Returns:
        Every conclusion with the share of the starts that bear it out.
    """
    claims, found, runs = read_claims("rajesh2009", "6"), {}, {}
    for name, manoeuvre in teachers().items():
        say(f"{starts(effort)} starts trained on {name}")
        found[name] = networks(Setting(manoeuvre=manoeuvre), effort)
        runs[name] = judged(found[name].models, TRIALS)
    say("networks of deep water in shallow water")
    water = {ratio: judged(found["zz20"].models, SHALLOW, depth=ratio * PARTICULARS.draught) for ratio in DEPTHS}
    say(f"{starts(effort)} starts in shallow water, h/d = {TRAINED_AT:g}")
    depth = TRAINED_AT * PARTICULARS.draught
    own = networks(Setting(depth=depth), effort)
    there = judged(own.models, SHALLOW, depth=depth)
    tables = {
        "Trained on, dev [L]": [row for name in runs for row in _rows({"trained on": name}, runs[name])],
        "Shallow water, trained in deep water, dev [L]": [
            row for ratio, run in water.items() for row in _rows({"h/d": ratio}, run)
        ],
        f"Shallow water, trained on zz20 there (h/d = {TRAINED_AT:g}), dev [L]": _rows({"h/d": TRAINED_AT}, there),
        "Tolerance of the trainings": _tolerances(found, own),
    }
    typical = {ratio: float(np.median(run.dev[0])) for ratio, run in water.items()}
    return ChapterResult(
        "Section 6: conclusions, the training manoeuvre and shallow water",
        "Networks of deep water are wrong in shallow water: zz20 is off by a median of "
        + ", ".join(f"{value:.2g} L at h/d = {ratio:g}" for ratio, value in typical.items())
        + f"; trained in it, by {np.median(there.dev[0]):.2g} L at h/d = {TRAINED_AT:g}.",
        claims.beside(_values(runs, water, there, claims.limits["acceptable"])),
        tables,
        [_plot(water, there)],
    )


def _rows(head: Row, run: Judged) -> list[Row]:
    trials = enumerate(run.references)
    return [head | {"manoeuvre": r.name} | spread(run.dev[k], run.left[k]) for k, r in trials]


def _tolerances(found: dict[str, TankerNetworks], own: TankerNetworks) -> list[Row]:
    rows: list[Row] = [{"trained on": name} | spread(nets.mse) for name, nets in found.items()]
    return [*rows, {"trained on": f"zz20, h/d = {TRAINED_AT:g}"} | spread(own.mse)]


def _values(runs: dict[str, Judged], water: dict[float, Judged], there: Judged, acceptable: float) -> dict[str, float]:
    """Shares of the starts that bear the conclusions out."""
    total = {name: run.dev.max(0) for name, run in runs.items()}
    zz = runs["zz20"].dev
    return {
        "better_than_tc20": beats(total["zz20"], total["tc20"]),
        "better_than_spiral": beats(total["zz20"], total["spiral"]),
        "angles": float((zz[[0, 2]].max(0) <= acceptable).mean()),
        "all_six": float((total["zz20"] <= acceptable).mean()),
        "training": float((zz[1] <= acceptable).mean()),
        "valid": float(np.stack([run.dev[0] <= acceptable for run in water.values()]).all(0).mean()),
        "trained_there": float((there.dev[0] <= acceptable).mean()),
        "trained_at": TRAINED_AT,
    }


def _plot(water: dict[float, Judged], there: Judged) -> Plot:
    panels = [tracks(run, k, f"{run.references[k].name}, h/d = {r:g}") for k in (0, 2) for r, run in water.items()]
    panels += [tracks(there, k, f"{there.references[k].name}, trained at h/d = {TRAINED_AT:g}") for k in (0, 2)]
    return Plot(
        "shallow_water", "zz20 and tc20 in shallow water by networks of deep water, and by one trained there", panels
    )
