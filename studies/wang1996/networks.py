"""What the chapters on Wang's networks share: its two ships, its data, and closed loops."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from manoeuvre_nn.core.manoeuvre import Manoeuvre
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.scaling import Scaling
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.dynamics.model import CalmWater, IdentifiedShip
from manoeuvre_nn.dynamics.rollout import roll_out, rollout
from manoeuvre_nn.dynamics.simulate import on_approach, sample_times, to_recordings
from manoeuvre_nn.manoeuvre.spiral import spiral
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.recording.tuples import Tuples, to_tuples
from manoeuvre_nn.scoring.score import score
from manoeuvre_nn.ship.great_lakes_bulker import great_lakes_bulker
from manoeuvre_nn.ship.known import clarke_part
from manoeuvre_nn.ship.mariner import mariner
from manoeuvre_nn.ship.taylor import TaylorShip
from studies.reproduction.stacked import Stacked
from studies.wang1996.published_networks import PublishedShip, Reading, published_network

SHIPS = {"mariner": mariner, "great_lakes_bulker": great_lakes_bulker}
SPIRAL_HOLD = 60.0
"""Time between rudder orders of the spiral [s]: Wang 1996, section 3.5."""


@dataclass(frozen=True)
class ThesisShip:
    """A ship of the thesis and what is identified from it.

    Attributes:
        name: Name of the published weights.
        ship: The simulated ship.
        known: Clarke's linear part.
        references: Name -> accurate simulation of each manoeuvre.
        tuples: 360 s of the 35-deg zigzag at 1 Hz, rudder positive to starboard.
    """

    name: PublishedShip
    ship: TaylorShip
    known: TaylorShip
    references: Mapping[str, Recording]
    tuples: Tuples

    @property
    def length(self) -> float:
        """L [m]."""
        return self.ship.particulars.length

    @property
    def unit_error(self) -> Float[Tensor, " 3"]:
        """What errors of g1, g2, g3 are taken relative to: their standard deviations [-]."""
        return self.tuples.targets.std(0, correction=0)


@dataclass(frozen=True)
class TrainedShips:
    """Identified ships that were trained alike, each from a start of its own.

    Attributes:
        label: What they are.
        models: The ships.
        errors: RMSE of g1, g2, g3 over the standard deviation of the simulated ones, one row a ship [-].
        iterations: Iterations that each took at most.
        course: Iterations and, at these, the median of ``errors`` over the starts; empty where it was not followed.
    """

    label: str
    models: tuple[IdentifiedShip, ...]
    errors: Float[np.ndarray, "starts 3"]
    iterations: int = 0
    course: Mapping[int, Float[np.ndarray, " 3"]] | None = None


@cache
def case(name: PublishedShip) -> ThesisShip:
    """Simulate the manoeuvres of the thesis.

    Args:
        name: ``mariner`` or ``great_lakes_bulker``.

    Returns:
        The ship with zz35 (360 s), zz20 and zz15 (300 s as in section 4.5), tc25, tc10 (360 s) and spiral20.
    """
    ship = SHIPS[name]()
    known = clarke_part(ship)
    zigzags = [zigzag(35.0, duration=360.0), zigzag(20.0, duration=300.0), zigzag(15.0, duration=300.0)]
    turns = [turning_circle(25.0, duration=360.0), turning_circle(10.0, duration=360.0)]
    programme = [*zigzags, *turns, spiral(hold=SPIRAL_HOLD)]
    runs = roll_out(CalmWater(ship), programme, step=0.5)
    references = {run.name: run for run in runs}
    return ThesisShip(name, ship, known, references, to_tuples([references["zz35"]], known))


def paper_scaling() -> Scaling:
    """The thesis' inputs as they are, the rudder turned to its sign.

    Returns:
        u/U0, v/U0, rL/U0 unchanged, delta [rad] positive to port.
    """
    one = torch.ones(4, dtype=torch.float64)
    return Scaling(torch.zeros_like(one), torch.cat([one[:3], -one[:1]]), one[:3])


def published(of: ThesisShip, reading: Reading = "corrected") -> TrainedShips:
    """The weights that the thesis prints.

    Args:
        of: The ship.
        reading: ``corrected`` or ``printed``.

    Returns:
        One model.
    """
    model = IdentifiedShip(of.known, published_network(of.name, reading), paper_scaling())
    return TrainedShips(
        "published" if reading == "corrected" else "published, labels as printed", (model,), errors(of, [model])
    )


def errors(of: ThesisShip, models: Sequence[IdentifiedShip]) -> Float[np.ndarray, "models 3"]:
    """How far networks are from the unknown forces that they were trained on.

    Args:
        of: The ship.
        models: Identified ships.

    Returns:
        RMSE of g1, g2, g3 over their standard deviations [-].
    """
    with torch.no_grad():
        found = [m.scaling.restore(m.network(m.scaling.inputs(of.tuples.inputs))) for m in models]
        rmse = [(g - of.tuples.targets).square().mean(0).sqrt() / of.unit_error for g in found]
    return torch.stack(rmse).numpy()


def fly(models: Sequence[IdentifiedShip], manoeuvres: Sequence[Manoeuvre]) -> list[list[Recording]]:
    """Run every model through every manoeuvre in closed loop, all as one batch.

    Args:
        models: Identified ships of one structure.
        manoeuvres: What is to be done.

    Returns:
        For each model one recording a manoeuvre; a run that left the physical range ends there.
    """
    ship = models[0].particulars
    programme = list(manoeuvres) * len(models)
    longest = max(manoeuvres, key=lambda m: m.duration_for(ship))
    vessel, start = on_approach(models[0], longest)
    times = sample_times(vessel.model.particulars, longest)
    rows = Stacked([model for model in models for _ in manoeuvres])
    with torch.inference_mode():
        runs = rollout(rows, programme, start.repeat(len(programme), 1), torch.as_tensor(times))
    made: list[Recording] = []
    for row, trial in enumerate(programme):
        made += to_recordings(models[row // len(manoeuvres)], [trial], runs.row(row), [trial.duration_for(ship)])
    return [made[k : k + len(manoeuvres)] for k in range(0, len(made), len(manoeuvres))]


@dataclass(frozen=True)
class Flown:
    """Closed-loop runs of networks beside the simulated ship.

    Attributes:
        networks: The networks.
        runs: Name of the manoeuvre -> one recording a model.
        dev: Name -> largest distance between predicted and simulated track over L, one a model [-].
    """

    networks: TrainedShips
    runs: Mapping[str, Sequence[Recording]]
    dev: Mapping[str, Float[np.ndarray, " models"]]

    def middle(self, name: str) -> Recording:
        """The run of middling quality, as a distribution's face.

        Args:
            name: Manoeuvre.

        Returns:
            The recording with the (upper) median deviation.
        """
        order = np.argsort(self.dev[name])
        return self.runs[name][int(order[len(order) // 2])]


def flown(of: ThesisShip, networks: Mapping[str, TrainedShips], names: Sequence[str]) -> dict[str, Flown]:
    """Run networks through the thesis' manoeuvres and measure how far they go astray.

    All networks with the same activation are one batch, manoeuvres of like length too: a batch is as long as its
    longest run, and a row more costs next to nothing.

    Args:
        of: The ship.
        networks: Key -> networks.
        names: Manoeuvres of the case.

    Returns:
        Key -> runs and deviations.
    """
    runs: dict[str, dict[str, list[Recording]]] = {key: {} for key in networks}
    spirals = [name for name in names if name.startswith("spiral")]
    for activation in ("sigmoid", "tanh"):
        keys = [k for k, some in networks.items() if some.models[0].network.activation == activation]
        for part in ([name for name in names if name not in spirals], spirals):
            if keys and part:
                models = [model for key in keys for model in networks[key].models]
                found = iter(fly(models, [of.references[name].meta["manoeuvre"] for name in part]))
                for key in keys:
                    ships = [next(found) for _ in networks[key].models]
                    runs[key] |= {name: [ship[k] for ship in ships] for k, name in enumerate(part)}
    return {key: _judged(of, networks[key], some) for key, some in runs.items()}


def _judged(of: ThesisShip, networks: TrainedShips, runs: Mapping[str, Sequence[Recording]]) -> Flown:
    """Runs beside the references."""
    far = {n: np.array([score(run, of.references[n], of.length).dev_L for run in some]) for n, some in runs.items()}
    return Flown(networks, runs, far)


def spread_row(flight: Flown) -> dict[str, Any]:
    """A line of a table of trainings: medians over the starts, the worst in brackets.

    Args:
        flight: Networks and their runs.

    Returns:
        Column -> cell.
    """
    networks = flight.networks
    row: dict[str, Any] = {"networks": networks.label, "starts": len(networks.models)}
    row |= {"iterations": networks.iterations or "as printed"}
    row |= {f"error of g{k + 1}": f"{np.median(column):.2g}" for k, column in enumerate(networks.errors.T)}
    lone = len(networks.models) == 1
    for name, dev in flight.dev.items():
        if not name.startswith("spiral"):
            row[f"dev {name} [L]"] = f"{np.median(dev):.3g}" + ("" if lone else f" ({dev.max():.3g})")
    return row


def spiral_points(run: Recording) -> tuple[Float[np.ndarray, " holds"], Float[np.ndarray, " holds"]]:
    """Rudder and yaw rate of a spiral, read one sample before each new order.

    Args:
        run: A spiral with holds of 60 s.

    Returns:
        Rudder angle [deg] and yaw rate [deg/s].
    """
    last: Int[np.ndarray, " holds"] = np.arange(SPIRAL_HOLD, run.time[-1] + 1.0, SPIRAL_HOLD).astype(int) - 1
    return run["delta"][last] / DEGREE, run["r"][last] / DEGREE
