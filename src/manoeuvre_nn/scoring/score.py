"""How far a predicted manoeuvre is from the recorded one."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.dynamics.limits import OK
from manoeuvre_nn.manoeuvre.criteria import criteria

SCORED_CHANNELS = ("u", "v", "r", "psi")
"""Channels whose errors a score reports."""
MAIN_CRITERIA = ("overshoot_1", "overshoot_2", "period", "advance", "tactical_diameter")
"""Criteria that zigzags and turning circles are known by, by the start of their names."""


@dataclass(frozen=True)
class Score:
    """One manoeuvre, predicted against recorded.

    Attributes:
        manoeuvre: Its name.
        status: ``ok``, or why the prediction was ended.
        dev_L: Largest distance between the two tracks over L [-].
        nrmse: Root mean square error over the standard deviation of the recording, for u, v, r, psi [-].
        criteria: Criteria of the prediction, names with units (``overshoot_1_deg``, ``tactical_diameter_L``, ...).
        reference: The same of the recording.
        spread_L: Distance over L that nine of ten members of an ensemble keep from its prediction, where it is largest
            [-]; None for a model that is no ensemble. It grows where the data leave open what the ship does.
        spread_criteria: How far nine of ten members keep from the prediction's criteria, of turning circles.
    """

    manoeuvre: str
    status: str
    dev_L: float  # noqa: N815
    nrmse: Mapping[str, float]
    criteria: Mapping[str, float] = field(default_factory=dict)
    reference: Mapping[str, float] = field(default_factory=dict)
    spread_L: float | None = None  # noqa: N815
    spread_criteria: Mapping[str, float] = field(default_factory=dict)

    @property
    def errors(self) -> dict[str, float]:
        """Prediction minus recording of every criterion that both have."""
        return {k: v - self.reference[k] for k, v in self.criteria.items() if k in self.reference}

    @property
    def main_criteria(self) -> list[str]:
        """Names of :data:`MAIN_CRITERIA` that the recording or the prediction has."""
        known = [*self.reference, *(name for name in self.criteria if name not in self.reference)]
        return [name for start in MAIN_CRITERIA for name in known if name.startswith(f"{start}_")]

    def as_dict(self) -> dict[str, Any]:
        """What ``scores.json`` holds for the manoeuvre.

        Returns:
            Plain numbers and strings; None is infinite.
        """
        apart = {name: off if np.isfinite(off) else None for name, off in self.spread_criteria.items()}
        return {
            "dev_L": self.dev_L,
            **({} if self.spread_L is None else {"spread_L": self.spread_L}),
            **({"spread_criteria": apart} if apart else {}),
            "nrmse": dict(self.nrmse),
            "status": self.status,
            "criteria": dict(self.criteria),
            "reference": dict(self.reference),
        }


def score(prediction: Recording, reference: Recording, length: float) -> Score:
    """Compare a prediction with what was recorded.

    A prediction that was ended early is taken to rest where it ended, so that a run which breaks down can never score
    better than one that goes on.

    Args:
        prediction: Predicted manoeuvre.
        reference: Recorded manoeuvre; its times are the ones compared at, as far as the prediction was meant to go.
        length: L [m].

    Returns:
        The score.
    """
    reference, ahead = at_recorded_times(prediction, reference, ("x", "y", *SCORED_CHANNELS))
    distance = np.hypot(ahead["x"] - reference["x"], ahead["y"] - reference["y"])
    nrmse = {k: _nrmse(ahead[k], reference[k]) for k in SCORED_CHANNELS}
    kind = reference.meta.get("kind", "")
    return Score(
        reference.name,
        prediction.status,
        float(distance.max() / length),
        nrmse,
        criteria(prediction, kind, length) if prediction.status == OK else {},
        criteria(reference, kind, length),
    )


def at_recorded_times(
    prediction: Recording, reference: Recording, names: Sequence[str]
) -> tuple[Recording, dict[str, Float[np.ndarray, " n"]]]:
    """What was predicted, at the times of what was recorded.

    Args:
        prediction: Predicted manoeuvre; one that was ended early is taken to rest where it ended.
        reference: Recorded manoeuvre.
        names: Channels.

    Returns:
        The recording as far as the prediction was meant to go, and the predicted channels at its times.
    """
    end = reference.time[-1] if prediction.status != OK else min(reference.time[-1], prediction.time[-1])
    cut = reference.between(reference.time[0], end)
    # np.interp holds the last value beyond the end of a prediction.
    return cut, {k: np.interp(cut.time, prediction.time, prediction[k]) for k in names}


def spread(prediction: Recording, members: Sequence[Recording], length: float) -> float:
    """How far the members of an ensemble go apart.

    Args:
        prediction: What the ensemble predicts.
        members: What each member predicts; one that ended early is taken to rest where it ended.
        length: L [m].

    Returns:
        Distance over L to the prediction that nine of ten members keep, where it is largest [-].
    """
    gaps = [np.hypot(*(np.interp(prediction.time, m.time, m[k]) - prediction[k] for k in ("x", "y"))) for m in members]
    return float(np.quantile(gaps, 0.9, axis=0).max() / length)


def spread_of_criteria(
    found: Mapping[str, float], members: Sequence[Recording], kind: str, length: float
) -> dict[str, float]:
    """How far the criteria of an ensemble's members are from its own.

    Args:
        found: Criteria of the ensemble's prediction.
        members: What each member predicts.
        kind: Family of the manoeuvre.
        length: L [m].

    Returns:
        Criterion -> difference that nine of ten members keep; infinite where they do not reach it. Of turning circles
        alone: criteria of a zigzag are those of the ship as she is steered, which members are not.
    """
    if kind != "turning_circle":
        return {}
    each = [criteria(m, kind, length) if m.status == OK else {} for m in members]
    off = {name: [abs(one.get(name, np.inf) - value) for one in each] for name, value in found.items()}
    return {name: float(np.sort(gaps)[int(np.ceil(0.9 * len(gaps))) - 1]) for name, gaps in off.items()}


def _nrmse(prediction: Float[np.ndarray, " n"], reference: Float[np.ndarray, " n"]) -> float:
    """RMSE over the standard deviation of the reference; over 1 where that does not vary (a straight run)."""
    spread = float(reference.std())
    return float(np.sqrt(np.mean((prediction - reference) ** 2)) / (spread if spread > 1e-12 else 1.0))
