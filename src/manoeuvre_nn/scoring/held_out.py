"""Held-out manoeuvres: a model is scored on them and never trained on them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Literal

from manoeuvre_nn.core.channels import ACCELERATION
from manoeuvre_nn.core.manoeuvre import Manoeuvre
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.dynamics.base import Model
from manoeuvre_nn.dynamics.limits import OK
from manoeuvre_nn.dynamics.members import has_members, replay_members, sail_members
from manoeuvre_nn.dynamics.replay import replay
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.dynamics.simulate import simulate
from manoeuvre_nn.dynamics.vessel import Vessel, as_vessel
from manoeuvre_nn.estimation.accelerations import accelerations
from manoeuvre_nn.manoeuvre.criteria import criteria
from manoeuvre_nn.scoring.as_steered import as_steered
from manoeuvre_nn.scoring.score import Score, score, spread, spread_of_criteria

Solver = Literal["torchdiffeq", "rollout"]
RTOL = 1e-6
"""Relative tolerance of torchdiffeq's solution [-]."""


@dataclass(frozen=True)
class HeldOut:
    """References and how each is predicted.

    A simulated reference carries its manoeuvre: the model is steered by the same helmsman, who reverses the rudder when
    the *model's* heading says so. A measured one is replayed with its recorded rudder.

    Attributes:
        references: What was recorded or simulated.
        length: L [m], for deviations.
    """

    references: tuple[Recording, ...]
    length: float

    def __post_init__(self) -> None:
        """Give every reference the ship's length, which figures need."""
        known = tuple(replace(r, meta={**r.meta, "length": self.length}) for r in self.references)
        object.__setattr__(self, "references", known)

    def predict(self, dynamics: Model | Vessel, solver: Solver = "torchdiffeq") -> list[Recording]:
        """Run a model through all manoeuvres in closed loop.

        Args:
            dynamics: The model.
            solver: ``torchdiffeq`` one by one to a tolerance, or ``rollout``, all as one fixed-step batch.

        Returns:
            One prediction a reference, in their order.
        """
        steered, recorded = self._sorted()
        manoeuvres = [self.references[k].meta["manoeuvre"] for k in steered]
        if solver == "rollout" and manoeuvres:
            runs = roll_out(dynamics, manoeuvres)
        else:
            runs = [simulate(dynamics, m, rtol=RTOL, atol=0.1 * RTOL) for m in manoeuvres]
        if recorded:
            runs += replay(dynamics, [self.references[k] for k in recorded])
        return [run for _, run in sorted(zip(steered + recorded, runs, strict=True), key=lambda pair: pair[0])]

    def predict_members(self, dynamics: Model | Vessel) -> list[list[Recording]]:
        """Run every member of an ensemble for itself.

        Args:
            dynamics: A model.

        Returns:
            The members' runs, reference by reference; empty lists for a model that is no ensemble.
        """
        if not has_members(dynamics):
            return [[] for _ in self.references]
        steered, recorded = self._sorted()
        runs = sail_members(dynamics, [self.references[k].meta["manoeuvre"] for k in steered]) if steered else []
        runs += replay_members(dynamics, [self.references[k] for k in recorded]) if recorded else []
        return [run for _, run in sorted(zip(steered + recorded, runs, strict=True), key=lambda pair: pair[0])]

    def _sorted(self) -> tuple[list[int], list[int]]:
        """Numbers of the references that a helmsman steers, and of those with a recorded rudder."""
        steered = [k for k, r in enumerate(self.references) if r.is_simulated]
        return steered, [k for k in range(len(self.references)) if k not in steered]

    def steer(self, dynamics: Model | Vessel) -> dict[int, Recording]:
        """Steer a model through recorded zigzags as their helmsmen did, instead of with the recorded rudder.

        Args:
            dynamics: A model.

        Returns:
            Number of the reference -> the run; zigzags only, see :func:`.as_steered`.
        """
        made = {k: as_steered(self.references[k], as_vessel(dynamics).model.particulars) for k in self._sorted()[1]}
        found = {k: m for k, m in made.items() if m is not None}
        return dict(zip(found, roll_out(dynamics, list(found.values())), strict=True)) if found else {}

    def score(
        self,
        predictions: Sequence[Recording],
        members: Sequence[Sequence[Recording]] = (),
        steered: Mapping[int, Recording] = MappingProxyType({}),
    ) -> list[Score]:
        """Score predictions.

        Args:
            predictions: One a reference, in their order.
            members: Runs of an ensemble's members, as :meth:`predict_members` gives them.
            steered: Runs as :meth:`steer` gives them: criteria are then theirs.

        Returns:
            One score each.
        """
        scores = [score(p, r, self.length) for p, r in zip(predictions, self.references, strict=True)]
        for k, run in steered.items():
            found = criteria(run, "zigzag", self.length) if run.status == OK else {}
            scores[k] = replace(scores[k], criteria=found)
        each = zip(scores, predictions, self.references, members or [[]] * len(scores), strict=True)
        return [
            replace(
                s,
                spread_L=spread(p, m, self.length),
                spread_criteria=spread_of_criteria(s.criteria, m, r.meta.get("kind", ""), self.length),
            )
            if m
            else s
            for s, p, r, m in each
        ]


def simulated_references(ship: Model | Vessel, manoeuvres: Sequence[Manoeuvre]) -> tuple[Recording, ...]:
    """What the reference ship, with whatever acts on it, does in the held-out manoeuvres."""
    return tuple(simulate(ship, m) for m in manoeuvres)


def references(runs: Sequence[Recording], ship: Particulars) -> HeldOut:
    """Recordings to judge a model by.

    Args:
        runs: The recordings.
        ship: The ship.

    Returns:
        The recordings; initial states and references of measured ones come from smoothed channels, since noise is
        nothing that a model should be asked for.
    """
    exact = [run.is_simulated and all(name in run.channels for name in ACCELERATION) for run in runs]
    smooth = (run if known else accelerations(run, "smoother") for run, known in zip(runs, exact, strict=True))
    return HeldOut(tuple(smooth), ship.length)
