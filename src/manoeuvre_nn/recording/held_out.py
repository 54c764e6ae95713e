"""Manoeuvres that a model is judged by and never trained on."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from manoeuvre_nn.core.manoeuvre import Manoeuvre
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.dynamics.base import Dynamics
from manoeuvre_nn.dynamics.replay import replay
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.dynamics.simulate import Problem, simulate
from manoeuvre_nn.recording.score import Score, score

Solver = Literal["torchdiffeq", "rollout"]


@dataclass(frozen=True)
class HeldOut:
    """References and how each is predicted.

    A simulated reference carries its manoeuvre: the model is steered by the same helmsman, who reverses the rudder when
    the *model's* heading says so. A measured one is replayed with its recorded rudder.

    Attributes:
        references: What was recorded or simulated.
        length: L [m], for deviations.
        rtol: Relative tolerance of torchdiffeq's solution.
    """

    references: tuple[Recording, ...]
    length: float
    rtol: float = 1e-6

    def __post_init__(self) -> None:
        """Give every reference the ship's length, which figures need."""
        known = tuple(replace(r, meta={**r.meta, "length": self.length}) for r in self.references)
        object.__setattr__(self, "references", known)

    def predict(self, dynamics: Dynamics, solver: Solver = "torchdiffeq") -> list[Recording]:
        """Run a model through all manoeuvres in closed loop.

        Args:
            dynamics: The model.
            solver: ``torchdiffeq`` one by one to a tolerance, or ``rollout``, all as one fixed-step batch.

        Returns:
            One prediction a reference, in their order.
        """
        steered = [k for k, r in enumerate(self.references) if "manoeuvre" in r.meta]
        recorded = [k for k, r in enumerate(self.references) if "manoeuvre" not in r.meta]
        manoeuvres = [self.references[k].meta["manoeuvre"] for k in steered]
        if solver == "rollout" and manoeuvres:
            runs = roll_out(dynamics, manoeuvres)
        else:
            runs = [simulate(Problem(dynamics, m), rtol=self.rtol, atol=0.1 * self.rtol) for m in manoeuvres]
        if recorded:
            runs += replay(dynamics, [self.references[k] for k in recorded])
        return [run for _, run in sorted(zip(steered + recorded, runs, strict=True), key=lambda pair: pair[0])]

    def score(self, predictions: Sequence[Recording]) -> list[Score]:
        """Judge predictions.

        Args:
            predictions: One a reference, in their order.

        Returns:
            One score each.
        """
        return [score(p, r, self.length) for p, r in zip(predictions, self.references, strict=True)]


def simulated_references(ship: Dynamics, manoeuvres: Sequence[Manoeuvre]) -> tuple[Recording, ...]:
    """What the reference ship does in the held-out manoeuvres.

    Args:
        ship: The reference ship, with whatever acts on it.
        manoeuvres: Manoeuvres to judge by.

    Returns:
        Accurate simulations.
    """
    return tuple(simulate(Problem(ship, m)) for m in manoeuvres)
