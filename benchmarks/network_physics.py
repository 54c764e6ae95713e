"""What each piece of physics in the network is worth: dev/L of held-out manoeuvres, medians over seeds, on two ships.

    OMP_NUM_THREADS=1 python benchmarks/network_physics.py [ship=mariner|esso_190k] [seeds=8] [from=0] [rows=NAME,NAME]

The Mariner is trained on 360 s of zz35 with Clarke's part known, the tanker on 1500 s of zz20 with its inertia known,
both without noise. Rows add one thing at a time, from one network on scaled inputs to the default; then come things
that were tried beside the default (with fewer members), and the models without a network. A run that leaves the
physical range counts as infinitely far off, and how many did is said. Each row ends with the CPU time of a training.
"""

import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
import yaml

from manoeuvre_nn.core.manoeuvre import Manoeuvre
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.core.units import KNOT
from manoeuvre_nn.dynamics.base import Model
from manoeuvre_nn.dynamics.limits import OK
from manoeuvre_nn.dynamics.members import Members
from manoeuvre_nn.dynamics.model import CalmWater, IdentifiedShip
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.dynamics.simulate import simulate
from manoeuvre_nn.estimation.accelerations import accelerations
from manoeuvre_nn.estimation.baselines import fit_baselines, own_part
from manoeuvre_nn.manoeuvre.spiral import spiral
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.network.hull_rudder import HullRudder, HullRudderSettings
from manoeuvre_nn.recording.tuples import Tuples, to_tuples
from manoeuvre_nn.scoring.score import score
from manoeuvre_nn.ship.esso_190k import esso_190k
from manoeuvre_nn.ship.known import clarke_part, no_part
from manoeuvre_nn.ship.mariner import mariner
from manoeuvre_nn.training.ensemble import train_ensemble
from manoeuvre_nn.training.rollout_refinement import Refinement, refine

PLAIN: dict[str, Any] = {"symmetric": False, "modular": False, "library": "none", "speed_law": "approach", "members": 1}
PER_LENGTH = 12
"""Samples and steps in the time L/U0 at which models are judged: a ship's own terms are then off by .002 L at most."""
CONF = Path(__file__).parents[1] / "conf" / "network"


def chosen(name: str) -> dict[str, Any]:
    """Settings of an ensemble as users have them.

    Args:
        name: Name of its file in conf/network.

    Returns:
        Arguments of :class:`HullRudder`.
    """
    settings = yaml.safe_load((CONF / f"{name}.yaml").read_text())
    return {k: v for k, v in settings.items() if k not in {"_target_", "scaling", "dtype"}}


@dataclass(frozen=True)
class Study:
    """A ship, what it is trained on, and what it is judged by.

    Attributes:
        ship: The reference ship.
        known: Its known part.
        first: The manoeuvre that is trained on.
        second: One more, for the row with two.
        judged: Held-out manoeuvres.
        law: Defaults that depend on the ship.
    """

    ship: Ship
    known: Ship
    first: Manoeuvre
    second: Manoeuvre
    judged: Sequence[Manoeuvre]
    law: Mapping[str, Any]


def studies() -> dict[str, Study]:
    """Both ships.

    Returns:
        Name -> study.
    """
    wang, esso = mariner(), esso_190k()
    at_sea = [replace(zigzag(20.0), duration=2000.0), *(zigzag(a) for a in (25.0, 15.0, 10.0))]
    at_sea += [turning_circle(a) for a in (15.0, 20.0, 25.0)]
    slow = [
        replace(m, speed=kn * KNOT, name=f"{m.name} {kn} kn")
        for kn in (10, 5)
        for m in (zigzag(20.0), turning_circle(20.0))
    ]
    thesis = [
        zigzag(20.0),
        zigzag(15.0),
        turning_circle(10.0),
        turning_circle(25.0),
        turning_circle(25.0, "port"),
        spiral(),
    ]
    tight, wide = replace(zigzag(35.0), duration=360.0), replace(zigzag(20.0), duration=1500.0)
    return {
        "mariner": Study(wang, clarke_part(wang), tight, spiral(25.0), thesis, chosen("hull_rudder")),
        "esso_190k": Study(esso, no_part(esso), wide, spiral(25.0), [*at_sea, *slow], chosen("hull_rudder_shaft")),
    }


def rows(study: Study) -> dict[str, dict[str, Any]]:
    """Settings of every row.

    Args:
        study: The ship.

    Returns:
        Name -> settings of :func:`train`.
    """
    steps: list[tuple[str, dict[str, Any]]] = [
        ("one network, inputs and outputs scaled", PLAIN),
        ("+ two sides alike", {"symmetric": True}),
        ("+ hull nodes do not see the rudder", {"modular": True}),
        ("+ terms beside the nodes", {"library": study.law["library"]}),
        ("+ forces in u^2, u n, n^2", {"speed_law": "shaft"}),
        ("+ nodes shrunk", {"shrink": study.law["shrink"]}),
        ("+ median of 8", {"members": 8}),
        ("+ median of 16", {"members": 16}),
    ]
    if study.law["speed_law"] == "approach":
        steps = [s for s in steps if not {"speed_law", "shrink"} & set(s[1]) or s[1] is PLAIN]
    made: dict[str, dict[str, Any]] = {}
    settings: dict[str, Any] = {}
    for name, more in steps:
        settings = {**settings, **more}
        made[name] = settings
    other = "approach" if study.law["speed_law"] == "shaft" else "shaft"
    default = list(made)[-1]
    made[f"{default} = default"] = made.pop(default)
    beside: dict[str, dict[str, Any]] = {
        "of 8, sides not alike": {"symmetric": False},
        "of 8, all nodes see the rudder": {"modular": False},
        "of 8, no terms beside the nodes": {"library": "none"},
        "of 8, the other terms": {"library": "linear" if study.law["library"] == "quadratic" else "quadratic"},
        f"of 8, speed law: {other}": {"speed_law": other},
        f"of 8, nodes {'not ' if study.law['shrink'] else ''}shrunk": {"shrink": 0.0 if study.law["shrink"] else 1e-4},
        "of 8, 8 nodes": {"hidden": 8},
        "of 8, 16 nodes": {"hidden": 16},
        "of 4, refined in closed loop": {"members": 4, "refined": 1},
        "of 4": {"members": 4},
        "of 8, spiral as second manoeuvre": {"second": True},
        "of 8, own terms known": {"own": True},
    }
    return made | {name: {**settings, "members": 8, **more} for name, more in beside.items()}


def train(
    study: Study, seed: int, *, second: bool = False, own: bool = False, refined: int = 0, **network: Any
) -> Model:
    """Train an ensemble as ``fit=ensemble`` does.

    Args:
        study: The ship.
        seed: Seed of the first weights.
        second: Whether a second manoeuvre is trained on.
        own: Whether the ship's own terms are fitted first.
        refined: Closed-loop steps.
        network: Settings of :class:`HullRudder`.

    Returns:
        The model.
    """
    recordings, known, tuples = data(study, second, own)
    net = HullRudder(HullRudderSettings(**network), seed=seed)
    model = train_ensemble(known, net, tuples)
    x = model.scaling.inputs(tuples.inputs)
    with torch.no_grad():
        for k in range(net.members if refined else 0):
            net.output_weights[k] = refine(model, k, recordings, x, Refinement(steps=refined))[0]
    return model


def data(study: Study, second: bool, own: bool) -> tuple[list[Recording], Ship, Tuples]:
    """Recordings, known part and tuples."""
    trials = [study.first, study.second] if second else [study.first]
    recordings = [accelerations(simulate(CalmWater(study.ship), m), "exact") for m in trials]
    known = study.known
    if own:
        start = own_part(study.ship)
        known = start.learnt(to_tuples(recordings, start))
    return recordings, known, to_tuples(recordings, known)


def judge(study: Study, references: Sequence[Recording], dynamics: Model, count: int = 1) -> list[list[float]]:
    """dev/L of every held-out manoeuvre by each of some models; infinite for a run that left the physical range."""
    interval = study.ship.particulars.time_unit / PER_LENGTH
    runs = roll_out(dynamics, list(study.judged) * count, step=interval, interval=interval)
    length, pairs = study.ship.particulars.length, zip(runs, list(references) * count, strict=True)
    found = [score(p, r, length).dev_L if p.status == OK else inf for p, r in pairs]
    return [found[k :: len(references)] for k in range(len(references))]


def together(models: Sequence[IdentifiedShip]) -> Members:
    """Ensembles of one known part and scaling as one batch."""
    networks = [cast(HullRudder, m.network) for m in models]
    parts = [torch.cat([getattr(n, name) for n in networks]) for name in ("input_weights", "output_weights")]
    whole = IdentifiedShip(models[0].known, networks[0].with_weights(*parts), models[0].scaling)
    return Members(whole, networks[0].members)


def line(name: str, values: Sequence[Sequence[float]], seconds: float) -> str:
    """A row of the table: medians, worst in brackets."""
    found = np.array(values)
    middle = np.quantile(found, 0.5, axis=1, method="higher")
    cells = [f"{m:.3f} ({w:.2f})" for m, w in zip(middle, found.max(axis=1), strict=True)]
    lost = int(np.isinf(found).sum())
    return f"| {name} | {' | '.join(cells)} | {lost} | {seconds:.1f} |"


def main(arguments: Sequence[str]) -> None:
    """Print the table of one ship or both.

    Args:
        arguments: ``ship=``, ``seeds=``, ``from=`` (the first seed), ``rows=``.
    """
    given = dict(a.partition("=")[::2] for a in arguments)
    first, wanted = int(given.get("from", "0")), given.get("rows", "")
    seeds = range(first, first + int(given.get("seeds", "8")))
    torch.set_num_threads(1)
    for name, study in studies().items():
        if given.get("ship", name) != name:
            continue
        interval = study.ship.particulars.time_unit / PER_LENGTH
        references = roll_out(CalmWater(study.ship), study.judged, interval=interval)
        print(f"\n{study.ship.particulars.name}: dev/L, median (worst) of seeds {first} to {seeds[-1]}")
        print(f"| | {' | '.join(m.name for m in study.judged)} | left the range | s |")
        print("|---" * (len(study.judged) + 3) + "|")
        for row, settings in rows(study).items():
            if wanted and not any(row.endswith(part) for part in wanted.split(",")):
                continue
            began = time.process_time()
            models = [train(study, seed, **settings) for seed in seeds]
            seconds = (time.process_time() - began) / len(seeds)
            print(line(row, judge(study, references, together(models), len(models)), seconds), flush=True)
        recordings, known, tuples = data(study, second=False, own=False)
        del recordings
        for baseline in fit_baselines(study.ship, known, tuples)[0]:
            print(line(baseline.name, judge(study, references, baseline.dynamics), 0.0), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
