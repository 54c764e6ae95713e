"""What a model may be used for, by the manoeuvres that it was not trained on."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.dynamics.limits import OK
from manoeuvre_nn.scoring.score import Score

MAX_DEV_L = 0.5
"""Deviation of a track over L up to which a manoeuvre counts as predicted [-]: a tenth of the tactical diameter of 5 L
that IMO MSC.137(76) allows."""
CLOSER = 2.0
"""How many times closer a simpler model must be, in the mean, to be preferred to one that misses manoeuvres."""
MAX_NAMED = 4
"""Manoeuvres that a sentence names."""

Word = Literal["usable", "doubtful", "do not use"]


@dataclass(frozen=True)
class ModelVerdict:
    """What held-out manoeuvres say of a model.

    Attributes:
        word: ``usable`` if every one was predicted, ``do not use`` if none was, a run broke down or a simpler model is
            closer, ``doubtful`` otherwise.
        sentence: The same for people, with what it rests on.
        predicted: Held-out manoeuvres that were predicted.
        missed: The others -> why.
    """

    word: Word
    sentence: str
    predicted: tuple[str, ...]
    missed: Mapping[str, str]

    def as_dict(self) -> dict[str, Any]:
        """What ``scores.json`` holds.

        Returns:
            Plain strings.
        """
        return {
            "word": self.word, "sentence": self.sentence, "predicted": list(self.predicted), "missed": dict(self.missed)
        }  # fmt: skip


def model_verdict(
    scores: Sequence[Score],
    references: Sequence[Recording],
    baselines: Mapping[str, Sequence[Score]] = MappingProxyType({}),
) -> ModelVerdict:
    """Say what a model may be used for.

    A manoeuvre is predicted if its track is within :data:`MAX_DEV_L` of the recorded one, and if an ensemble's members
    agree to as much. A model that misses some should not be used where a simpler one, made from the same data or from
    the ship's particulars, is closer.

    Args:
        scores: Of the held-out manoeuvres.
        references: What was recorded in them, in the same order.
        baselines: Simpler models -> their scores.

    Returns:
        The verdict.
    """
    missed = {s.manoeuvre: why for s in scores if (why := _why_missed(s))}
    predicted = tuple(s.manoeuvre for s in scores if s.manoeuvre not in missed)
    known = _listed(predicted)
    if not missed:
        sentence = f"Usable for manoeuvres like {known}, {_covered(references)}: each is within {MAX_DEV_L:g} L."
        return ModelVerdict("usable", sentence, predicted, missed)
    told = _listed([f"{name} {why}" for name, why in missed.items()])
    simpler, broken = _closer(scores, baselines), any(s.status != OK for s in scores)
    if broken or simpler or not predicted:
        return ModelVerdict("do not use", f"Do not use: {told}{simpler}.", predicted, missed)
    return ModelVerdict("doubtful", f"Doubtful: {known} within {MAX_DEV_L:g} L, but {told}.", predicted, missed)


def _why_missed(score: Score) -> str:
    """Why a manoeuvre does not count as predicted; empty if it does."""
    if score.status != OK:
        return score.status
    if not score.dev_L <= MAX_DEV_L:
        return f"is {score.dev_L:.2g} L off"
    if score.spread_L is not None and not score.spread_L <= MAX_DEV_L:
        return f"is left open by the data (members {score.spread_L:.2g} L apart)"
    return ""


def _closer(scores: Sequence[Score], baselines: Mapping[str, Sequence[Score]]) -> str:
    """The simpler model that is closest, if it is much closer than the model; else empty."""
    own, means = np.mean([s.dev_L for s in scores]), dict[str, float]()
    for name, theirs in baselines.items():
        if all(s.status == OK for s in theirs):
            means[name] = float(np.mean([s.dev_L for s in theirs]))
    best = min(means, key=lambda name: means[name], default="")
    if not best or own <= CLOSER * means[best]:
        return ""
    return f"; the simpler model {best!r} is closer: {means[best]:.2g} L in the mean, this one {own:.2g} L"


def _covered(references: Sequence[Recording]) -> str:
    """Rudder and speed that the held-out manoeuvres cover."""
    rudder = max(float(np.abs(r.filled("delta")).max()) for r in references) / DEGREE
    speeds = np.concatenate([r.filled("u") for r in references])
    return f"rudder to {rudder:.2g} deg, {speeds.min():.2g} to {speeds.max():.2g} m/s"


def _listed(words: Sequence[str]) -> str:
    """Some words one after another, and how many more there are."""
    more = len(words) - MAX_NAMED
    return ", ".join(words[:MAX_NAMED]) + (f" and {more} more" if more > 0 else "")
