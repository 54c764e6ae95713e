"""What a model may be used for, by the manoeuvres, or the records of a response, that it was not trained on."""

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
MAX_CRITERION, MAX_OVERSHOOT_DEG = 0.1, 2.0
"""Relative error up to which a criterion counts as predicted [-]; of an overshoot as many degrees will do."""
CLOSER = 2.0
"""How many times closer a simpler model must be, in the mean, to be preferred to one that misses manoeuvres."""
NOTABLE_L = 0.05
"""Mean deviation over L below which it is not told that a simpler model is closer [-]: both are as close as positions
of ships are known."""
MAX_SHARE = 0.1
"""Root mean square error of a response over the standard deviation of the records up to which they count as predicted
[-]: 99 % of their variance is explained."""
RANGED = {"delta": "rudder", "v": "sway", "r": "rate of turn"}
"""Channels whose size says how far a manoeuvre goes, beside the speed; and their names."""
RANGE, MARGIN = 0.99, 1.1
"""Share of the samples that makes a range, and by how much one is left: single samples are noise."""
MAX_NAMED = 4
"""Manoeuvres that a sentence names."""

Word = Literal["usable", "doubtful", "do not use"]


@dataclass(frozen=True)
class ModelVerdict:
    """What held-out manoeuvres say of a model.

    Attributes:
        word: ``usable`` if every track was predicted, or every criterion; ``do not use`` if nothing was, a run broke
            down or a simpler model is closer; ``doubtful`` otherwise.
        sentence: The same for people, with what it rests on.
        predicted: Held-out manoeuvres whose tracks were predicted.
        missed: The others -> why.
        criteria: Manoeuvres whose main criteria were predicted.
    """

    word: Word
    sentence: str
    predicted: tuple[str, ...]
    missed: Mapping[str, str]
    criteria: tuple[str, ...]

    @property
    def unfit(self) -> dict[str, str]:
        """Manoeuvres by whose criteria the ship must not be judged -> why.

        All of them where the model is not to be used; else those of which neither track nor criteria were predicted.
        """
        if self.word == "do not use":
            return {name: "is not to be used" for name in self.predicted} | dict(self.missed)
        return {name: why for name, why in self.missed.items() if name not in self.criteria}

    def as_dict(self) -> dict[str, Any]:
        """What ``scores.json`` holds.

        Returns:
            Plain strings.
        """
        names = {"predicted": list(self.predicted), "criteria": list(self.criteria), "missed": dict(self.missed)}
        return {"word": self.word, "sentence": self.sentence, **names}


def model_verdict(
    scores: Sequence[Score],
    references: Sequence[Recording],
    baselines: Mapping[str, Sequence[Score]] = MappingProxyType({}),
    trained: Sequence[Recording] = (),
) -> ModelVerdict:
    """Say what a model may be used for.

    A track is predicted if it is within :data:`MAX_DEV_L` of the recorded one, and if an ensemble's members agree to as
    much. The track of a course-unstable ship, driven by the recorded rudder, may run away while the overshoots and
    periods of her own zigzags are right: criteria count for themselves. A model that misses tracks should not be used
    where a simpler one, made from the same data or from the ship's particulars, is closer. Manoeuvres that left the
    range of the training data are told.

    Args:
        scores: Of the held-out manoeuvres.
        references: What was recorded in them, in the same order.
        baselines: Simpler models -> their scores.
        trained: What was trained on; empty if it is not known.

    Returns:
        The verdict.
    """
    beyond = {s.manoeuvre: out for s, r in zip(scores, references, strict=True) if (out := _beyond(r, trained))}
    missed = {s.manoeuvre: why for s in scores if (why := _why_missed(s))}
    missed |= {name: f"{missed[name]} ({out})" for name, out in beyond.items() if name in missed}
    predicted = tuple(s.manoeuvre for s in scores if s.manoeuvre not in missed)
    criteria = tuple(s.manoeuvre for s in scores if _has_criteria_of(s))
    covered = _covered(references)
    if far := _listed([f"{name} {beyond[name]}" for name in predicted if name in beyond]):
        covered += f" ({far})"
    word, sentence = _told(scores, missed, predicted, criteria, _closer(scores, baselines), covered)
    return ModelVerdict(word, sentence, predicted, missed, criteria)


def response_verdict(
    errors: Mapping[str, float], spread: Mapping[str, float], linear: Mapping[str, float], text: str
) -> ModelVerdict:
    """Say what the approximation of a response may be used for.

    Args:
        errors: Records that it was not trained on, set by set -> root mean square error.
        spread: The same -> standard deviation of these records, in the same unit.
        linear: The same -> error of a linear function of all variables, fitted to the records that were learnt.
        text: How far it is off, beginning with a small letter.

    Returns:
        ``usable`` if every set is predicted to :data:`MAX_SHARE` of its standard deviation; ``do not use`` if none is,
        or the linear function is closer; ``doubtful`` otherwise, or where nothing was kept to test it.
    """
    shares = {name: error / spread[name] if spread[name] > 0 else np.inf for name, error in errors.items()}
    missed = {n: f"is off by {100 * s:.2g} % of what it varies by" for n, s in shares.items() if not s <= MAX_SHARE}
    predicted = tuple(name for name in errors if name not in missed)
    closer = [name for name, error in errors.items() if linear[name] < error]
    if not errors:
        return ModelVerdict("doubtful", f"Doubtful, for no record was kept to test it: {text}.", (), {}, ())
    told = "".join(f"; {name}: {why}" for name, why in missed.items())
    if closer or not predicted:
        told += "".join(f"; a linear function is closer ({name}: {linear[name]:.3g})" for name in closer)
        return ModelVerdict("do not use", f"Do not use: {text}{told}.", predicted, missed, ())
    if missed:
        return ModelVerdict("doubtful", f"Doubtful: {text}{told}.", predicted, missed, ())
    return ModelVerdict("usable", f"Usable within the ranges of the records: {text}.", predicted, {}, ())


def _told(
    scores: Sequence[Score],
    missed: Mapping[str, str],
    predicted: Sequence[str],
    criteria: Sequence[str],
    simpler: str,
    covered: str,
) -> tuple[Word, str]:
    """The verdict's word and sentence."""
    if not missed:
        also = simpler if np.mean([s.dev_L for s in scores]) > NOTABLE_L else ""
        like = f"Usable for manoeuvres like {_listed(predicted)}, {covered}"
        return "usable", f"{like}: each is within {MAX_DEV_L:g} L{also}."
    but = _listed([f"{name} {why}" for name, why in missed.items()])
    if simpler or any(s.status != OK for s in scores) or not (predicted or criteria):
        return "do not use", f"Do not use: {but}{simpler}."
    close = f"within {100 * MAX_CRITERION:.0f} %, overshoots {MAX_OVERSHOOT_DEG:g} deg"
    if len(criteria) == len(scores):
        return "usable", f"Usable for criteria, {covered}, not for tracks: all criteria are {close}; but {but}."
    tracks = f"{_listed(predicted)} within {MAX_DEV_L:g} L; " if predicted else ""
    count = sum(bool(s.main_criteria) for s in scores)
    counted = f"criteria of {len(criteria)} of {count} manoeuvres {close}; " if count else ""
    return "doubtful", f"Doubtful: {tracks}{counted}but {but}."


def _has_criteria_of(score: Score) -> bool:
    """Whether the main criteria of a manoeuvre, if it has any, were predicted and an ensemble's members agree."""
    names, errors = score.main_criteria, score.errors

    def close(name: str) -> bool:
        most = max(
            MAX_OVERSHOOT_DEG if name.startswith("overshoot") else 0.0, MAX_CRITERION * abs(score.reference[name])
        )
        return abs(errors[name]) <= most and score.spread_criteria.get(name, 0.0) <= most

    return bool(names) and all(name in errors and close(name) for name in names)


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


def _beyond(reference: Recording, trained: Sequence[Recording]) -> str:
    """In what a manoeuvre left the range of the training data; empty if it did not, or these are not known."""
    if not trained:
        return ""

    def largest(run: Recording, channel: str) -> float:
        return float(np.quantile(np.abs(run.filled(channel)), RANGE))

    left = [name for c, name in RANGED.items() if largest(reference, c) > MARGIN * max(largest(t, c) for t in trained)]
    speeds = np.quantile(np.concatenate([t.filled("u") for t in trained]), (1 - RANGE, RANGE))
    slowest, fastest = np.quantile(reference.filled("u"), (1 - RANGE, RANGE))
    if slowest < speeds[0] / MARGIN or fastest > MARGIN * speeds[1]:
        left.append("speed")
    return f"beyond the training data in {', '.join(left)}" if left else ""


def _covered(references: Sequence[Recording]) -> str:
    """Rudder and speed that the held-out manoeuvres cover."""
    rudder = max(float(np.abs(r.filled("delta")).max()) for r in references) / DEGREE
    speeds = np.concatenate([r.filled("u") for r in references])
    return f"rudder to {rudder:.2g} deg, {speeds.min():.2g} to {speeds.max():.2g} m/s"


def _listed(words: Sequence[str]) -> str:
    """Some words one after another, and how many more there are."""
    more = len(words) - MAX_NAMED
    return ", ".join(words[:MAX_NAMED]) + (f" and {more} more" if more > 0 else "")
