"""A case of the trial with all that was drawn for it, and what of it is published when it is opened."""

from dataclasses import dataclass
from typing import Any

from studies.concealed_trial.effects import kind_of
from studies.concealed_trial.helm import Run
from studies.concealed_trial.ships import TrialShip
from studies.concealed_trial.truth import ConcealedEffect


@dataclass(frozen=True)
class TrialCase:
    """A case with all that was drawn.

    Attributes:
        name: Looks random.
        ship: The ship.
        runs: The runs.
        effects: What is concealed.
        measures: Size of each effect in lengths, or in standard deviations for a sensor.
        coefficient_sd: Relative standard deviation of the coefficients.
        cubic: Name and size of the term that the model lacks.
        model_error_size: Size of the coloured force.
        noise: Standard deviation of each sensor's noise.
        latency: How late the GPS is [s].
        outliers: Share of samples that are outliers.
        chance: Seed of all series.
        salt: Salt of the commitment.
        channels: What the recorder writes, a name of :data:`studies.concealed_trial.channels.CHANNEL_SETS`.
        hole: Run of which minutes are missing, first and last second of them; None if none are.
        strict: Whether held-out runs hold rudder and warm-up only.
    """

    name: str
    ship: TrialShip
    runs: tuple[Run, ...]
    effects: tuple[ConcealedEffect, ...]
    measures: tuple[float, ...]
    coefficient_sd: float
    cubic: tuple[str, float]
    model_error_size: float
    noise: dict[str, float]
    latency: float
    outliers: float
    chance: int
    salt: str
    channels: str = "full"
    hole: tuple[str, int, int] | None = None
    strict: bool = False

    def answers(self) -> dict[str, Any]:
        """What was concealed, as published when a set is opened.

        Returns:
            Case, ship, verdict, effects and the name of the channel set.
        """
        effects = [_published(e, m) for e, m in zip(self.effects, self.measures, strict=True)]
        verdict = "mismatch" if effects else "none"
        answers = {"case": self.name, "ship": self.ship.name, "verdict": verdict, "effects": effects}
        return answers | {"channels": self.channels}


def _published(effect: ConcealedEffect, measure: float) -> dict[str, Any]:
    """One effect as published."""
    kind = kind_of(effect.name, effect.detail)
    ramp = {"ramp_s": effect.ramp} if effect.ramp else {}
    return ramp | {
        "name": effect.name,
        "detail": effect.detail,
        "strength": effect.strength,
        "measure": float(f"{measure:.3g}"),
        "parameters": dict(effect.parameters),
        "equation": list(kind.accepted[0]),
        "equation_accepted": [list(place) for place in kind.accepted],
        "equivalent_names": list(kind.equivalent),
        "intervals": effect.intervals,
    }
