"""Rajesh & Bhattacharyya 2009: the paper's networks trained from many starts, and how they do in closed loop."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from math import ceil, inf
from typing import Any, Literal

import numpy as np
import torch
from jaxtyping import Float

from manoeuvre_nn.core.manoeuvre import Manoeuvre
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.scaling import Scaling
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.core.units import KNOT
from manoeuvre_nn.dynamics.base import Model
from manoeuvre_nn.dynamics.limits import OK, left_range
from manoeuvre_nn.dynamics.model import CalmWater, IdentifiedShip
from manoeuvre_nn.dynamics.rollout import roll_out, rollout
from manoeuvre_nn.dynamics.simulate import simulate
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.network.perceptron import Activation, Perceptron, rajesh_network
from manoeuvre_nn.numerics.damping import Damping, Rule, Stops
from manoeuvre_nn.numerics.one_hidden import OneHidden
from manoeuvre_nn.numerics.restarts import Solutions, minimise
from manoeuvre_nn.recording.tuples import Tuples, to_tuples
from manoeuvre_nn.scoring.score import score
from manoeuvre_nn.ship.esso_190k import PARTICULARS, esso_190k
from manoeuvre_nn.ship.known import no_part
from studies.rajesh2009.separable import Separable
from studies.reproduction.section import ComputingEffort, Line, Panel
from studies.reproduction.stacked import Stacked

Row = dict[str, Any]
"""Cells of a table by column."""
LENGTH = PARTICULARS.length
BEAM = PARTICULARS.beam / LENGTH
"""What counts as a good agreement of two tracks [L]: their lines on paper touch."""
EPOCHS, QUICK_EPOCHS, QUICK_STARTS = 3000, 300, 4
"""Steps that a start may take: the error falls slowly by then, and 30 000 would take the time of eight starts."""
INTERVAL = 2.0
"""Time between samples of a network's run and its Runge-Kutta step [s]; rudder and crossings have their own."""
GOAL = 1e-11
"""Least tolerance that the paper stopped at (m = 26)."""


@dataclass(frozen=True)
class Setting:
    """What a network is trained on, and how.

    Attributes:
        m: Nodes of the hidden layer, the bias counted: ``m - 1`` are active.
        manoeuvre: Where the data are from.
        depth: Water depth [m].
        activation: ``sigmoid`` by eq 18; ``tanh`` is what Table 2 turns out to hold.
        rule: Damping.
        exact: Whether the output layer is solved exactly at every step.
        scaled: Whether inputs and outputs are brought to zero mean and a standard deviation of 1 (outputs: scale only).
    """

    m: int = 15
    manoeuvre: Manoeuvre = zigzag(20.0, duration=1500.0)
    depth: float = inf
    activation: Activation = "sigmoid"
    rule: Rule = "trainlm"
    exact: bool = False
    scaled: bool = False


@dataclass(frozen=True)
class TankerNetworks:
    """One setting from many starts.

    Attributes:
        models: One for each start.
        mse: Mean square error over the three g in the BIS system, which is the paper's tolerance, of each start.
        solutions: Epochs, tries and reasons.
    """

    models: tuple[IdentifiedShip, ...]
    mse: Float[np.ndarray, " starts"]
    solutions: Solutions

    @property
    def epochs(self) -> Float[np.ndarray, " starts"]:
        """Steps that each start took."""
        return self.solutions.epochs.double().numpy()


@dataclass(frozen=True)
class Judged:
    """Manoeuvres of many networks beside the ship's.

    Attributes:
        references: What the ship does.
        runs: What each network does, manoeuvre by manoeuvre.
        dev: Largest distance of the tracks [L].
        left: Whether the run left the physical range.
    """

    references: list[Recording]
    runs: list[list[Recording]]
    dev: Float[np.ndarray, "manoeuvres starts"]
    left: Float[np.ndarray, "manoeuvres starts"]

    def typical(self, row: int) -> Recording:
        """The run that half of the starts are better than.

        Args:
            row: Number of the manoeuvre.

        Returns:
            The run.
        """
        return self.runs[row][int(np.argsort(self.dev[row])[(self.dev.shape[1] - 1) // 2])]


def starts(effort: ComputingEffort) -> int:
    """How many starts a distribution is made of.

    Args:
        effort: How much computing is allowed.

    Returns:
        As many as asked for, in the short form at most ``QUICK_STARTS``.
    """
    return min(effort.starts, QUICK_STARTS) if effort.quick else effort.starts


@cache
def networks(setting: Setting, effort: ComputingEffort) -> TankerNetworks:
    """Train a network from many starts; each goes its own way, so that their number changes nothing.

    First weights are U[-1, 1) from seeds ``effort.seed``, ``effort.seed + 1``, ...

    Args:
        setting: What and how.
        effort: Number of starts and first seed.

    Returns:
        The networks.

    Source:
        Rajesh & Bhattacharyya 2009, sections 4 and 5, eqs 10-20. The rudder is positive to starboard here, to port
        there: with first weights that are as often positive as negative it is the same.
    """
    known, tuples = _data(setting.manoeuvre, setting.depth)
    shift, scale, output = torch.zeros(4).double(), torch.ones(4).double(), torch.ones(3).double()
    if setting.scaled:
        shift, scale, output = tuples.inputs.mean(0), tuples.inputs.std(0), tuples.targets.std(0)
    scaling = Scaling(shift, scale, output)
    x, y = scaling.inputs(tuples.inputs), scaling.outputs(tuples.targets)
    made = [
        rajesh_network(setting.m, activation=setting.activation, seed=effort.seed + k) for k in range(starts(effort))
    ]
    problem: OneHidden | Separable = (Separable if setting.exact else OneHidden)(
        x, y, setting.m - 1, activation=setting.activation
    )
    first = torch.cat([torch.cat([p.detach().flatten(1) for p in net.parameters()], 1) for net in made])
    stops = Stops(QUICK_EPOCHS if effort.quick else EPOCHS, 0.0 if setting.scaled else GOAL)
    first = first[:, : problem.parameters].contiguous()
    found = minimise(problem, first, damping=Damping(setting.rule), stops=stops, at_once=1)
    models = tuple(
        IdentifiedShip(known, _filled(net, problem, found.weights[k : k + 1]), scaling) for k, net in enumerate(made)
    )
    errors = [_tolerance(model, tuples.inputs, tuples.targets) for model in models]
    return TankerNetworks(models, np.array(errors), found)


@cache
def _data(manoeuvre: Manoeuvre, depth: float) -> tuple[Ship, Tuples]:
    """Inertia and training tuples."""
    ship = esso_190k(depth)
    known = no_part(ship)
    return known, to_tuples([simulate(CalmWater(ship), manoeuvre)], known)


@torch.no_grad()
def _filled(net: Perceptron, problem: OneHidden | Separable, weights: torch.Tensor) -> Perceptron:
    """A perceptron with the weights of a solution."""
    if isinstance(problem, Separable):
        first = weights.unflatten(1, (problem.layer.hidden, problem.layer.width))
        last = problem.output_weights(weights)
    else:
        first, last = problem.split(weights)
    net.input_weights.copy_(first)
    net.output_weights.copy_(last)
    return net


@torch.no_grad()
def _tolerance(model: IdentifiedShip, inputs: torch.Tensor, targets: torch.Tensor) -> float:
    """The paper's tolerance: mean over samples and outputs of the squared errors of g."""
    g = model.scaling.restore(model.network(model.scaling.inputs(inputs)))
    return float((g - targets).square().mean())


def judged(
    models: Sequence[IdentifiedShip],
    manoeuvres: Sequence[Manoeuvre],
    *,
    speed_kn: float | None = None,
    depth: float = inf,
    shaft: Literal["hold", "similarity"] = "hold",
) -> Judged:
    """Run networks and the ship through manoeuvres, all networks and manoeuvres as one batch.

    Args:
        models: Networks.
        manoeuvres: What is to be done.
        speed_kn: Approach speed [kn]; None is the ship's own.
        depth: Water depth of the ship's runs [m].
        shaft: Whether the ship keeps its 80 rpm at another speed.

    Returns:
        Runs and deviations.
    """
    ship: Model = CalmWater(esso_190k(depth, shaft=shaft))
    speed = None if speed_kn is None else speed_kn * KNOT
    trials = [m.at_speed(speed) for m in manoeuvres]
    references = roll_out(ship, trials)
    rows = [m if speed is None else m.on_approach(speed) for _ in trials for m in models]
    batch = Stacked(rows)
    flat = _run(batch, [t for t in trials for _ in models])
    runs = [flat[k * len(models) : (k + 1) * len(models)] for k in range(len(trials))]
    runs = [[_cut(run, ref) for run in row] for row, ref in zip(runs, references, strict=True)]
    dev = [[score(run, ref, LENGTH).dev_L for run in row] for row, ref in zip(runs, references, strict=True)]
    left = [[float(run.status != OK) for run in row] for row in runs]
    return Judged(references, runs, np.array(dev), np.array(left))


def _run(batch: Stacked, trials: list[Manoeuvre]) -> list[Recording]:
    """All rows over the longest of the trials."""
    particulars = batch.particulars
    end = max(t.duration_for(particulars) for t in trials)
    clock = INTERVAL * np.arange(ceil(end / INTERVAL - 1e-9) + 1)
    start = torch.zeros(len(trials), 6, dtype=torch.float64)
    start[:, 0] = particulars.speed
    with torch.no_grad():
        made = rollout(batch, trials, start, torch.tensor(clock), step=INTERVAL)
    values = torch.cat([made.states, made.shown[..., None]], -1).numpy()
    names = ("u", "v", "r", "x", "y", "psi", "delta")
    recordings = []
    for row, (trial, ended) in enumerate(zip(trials, made.ended.tolist(), strict=True)):
        own = {name: values[:, row, k].copy() for k, name in enumerate(names)}
        meta = {"kind": trial.kind, "ended": ended}
        recordings.append(Recording(trial.name, clock, own, OK, meta))
    return recordings


def _cut(run: Recording, reference: Recording) -> Recording:
    """A run as long as the reference, or until it left the physical range."""
    ended = run.meta["ended"]
    last = float(reference.time[-1])
    if ended > last + 1e-9:
        return run.between(0.0, last)
    part = run.between(0.0, max(ended - 1e-6, run.time[1]))
    return Recording(part.name, part.time, part.channels, left_range(ended), part.meta)


def spread(values: Float[np.ndarray, " starts"], left: Float[np.ndarray, " starts"] | None = None) -> Row:
    """A distribution over the starts as cells of a table.

    Args:
        values: One a start.
        left: Whether the run of a start left the physical range.

    Returns:
        Median, best, worst and, if asked for, how many left.
    """
    cells: Row = {"median": float(np.median(values)), "best": float(np.min(values)), "worst": float(np.max(values))}
    return cells if left is None else cells | {"left the range": float(np.sum(left))}


def tracks(judgement: Judged, row: int, title: str, label: str = "network, median start") -> Panel:
    """Axes with the ship's track and that of the median start.

    Args:
        judgement: Runs.
        row: Number of the manoeuvre.
        title: Heading.
        label: Of our line.

    Returns:
        The axes.
    """
    reference, run = judgement.references[row], judgement.typical(row)
    lines = [track(reference, "reference", "reference"), track(run, label)]
    return Panel("y [L]", "x [L]", lines, title, equal=True)


def track(run: Recording, label: str, role: Literal["reference", "ours", "paper", "other"] = "ours") -> Line:
    """A track in ship lengths, east to the right and north up.

    Args:
        run: The run.
        label: What it is.
        role: Whose it is.

    Returns:
        The line.
    """
    return Line(label, run["y"] / LENGTH, run["x"] / LENGTH, role)
