"""Sentences for people."""

from collections.abc import Sequence

import numpy as np

from manoeuvre_nn.diagnosis.hypothesis import Judged
from manoeuvre_nn.diagnosis.result import Cause, Proof
from manoeuvre_nn.diagnosis.search import Contest
from manoeuvre_nn.diagnosis.verdict import Verdict

ADVICE = {
    frozenset({"current", "sensors"}): "reciprocal runs, or a slow turn through 720 deg",
    frozenset({
        "wind and waves"
    }): "a slow turn through 360 deg, and the same zigzag on a heading 90 deg away; log the wind",
    frozenset({"wind and waves", "current"}): "a slow turn through 720 deg",
    frozenset({"rudder", "propeller and resistance"}): "a step of the shaft speed at fixed rudder, then coasting",
    frozenset({"propeller and resistance"}): "straight runs at two shaft speeds, then a hard turn",
    frozenset({"depth", "loading"}): "the same zigzag at two speeds, then a hard turn; log the depth and the draughts",
    frozenset({"rudder"}): "a 5/5 zigzag and a hard-over step; log order and indicated angle",
    frozenset({"depth", "rudder"}): "a hard turn and a 20/20 zigzag at half speed; log the depth",
    frozenset({"sensors"}): "a straight run and its reciprocal, then one full turn",
}
"""What tells two families apart (catalogue of alias sets: IMO MSC/Circ.1053, ISO 15016 and manoeuvring practice)."""


def captain(causes: Sequence[Cause], model: Sequence[str], proofs: Sequence[Proof], mismatch: bool) -> str:
    """One sentence that a captain understands.

    Args:
        causes: Candidates, best first.
        model: What was switched on.
        proofs: Held-out runs.
        mismatch: Whether recordings and model differ.

    Returns:
        The sentence.
    """
    if not mismatch:
        return "The recordings agree with the calm-water model within their noise: nothing needs to be added."
    if not model:
        return "The recordings differ from the calm-water model, and no effect that the program knows explains it."
    named = [c for c in causes if c.name in model]
    said = " and ".join(f"{c.label} ({_values(c)})" for c in named)
    gain = ""
    if proofs:
        channel, what, unit = (
            ("pos", "track", "m") if np.isfinite(proofs[0].rmse_before["pos"]) else ("psi", "heading", "deg")
        )
        before, after = (
            np.sqrt(np.mean([getattr(p, w)[channel] ** 2 for p in proofs])) for w in ("rmse_before", "rmse_after")
        )
        gain = (
            f"; with it the {what} of runs that were not used is predicted to {after:.3g} {unit} instead of "
            f"{before:.3g} {unit}"
        )
    return f"The recordings show {said}{gain}."


def _values(cause: Cause) -> str:
    return ", ".join(f"{v.name.replace('_', ' ')} {v.value:.3g} {v.unit}".rstrip(" -") for v in cause.parameters)


def runner_up(tried: Contest, verdict: Verdict) -> list[str]:
    """What speaks for and against the second best.

    Args:
        tried: The contest.
        verdict: The probabilities.

    Returns:
        Sentences.
    """
    if verdict.best is None or len(tried.judged) < 2:
        return []
    best = verdict.best
    other = next((j for j in tried.judged if not set(best.names) <= set(j.names)), None)
    if other is None:
        return []
    gap = best.evidence - other.evidence
    names = " + ".join(other.names)
    said = [f"Next best: {names}, {gap:.1f} in log evidence behind {' + '.join(best.names)} (odds {_odds(gap)})."]
    said.append(f"For it: it explains {other.evidence - tried.none.evidence:.1f} in log evidence more than calm water.")
    levels = tried.court.bench.levels
    left, least = levels[other.best[0]].max(), levels[best.best[0]].max()
    if left > 1.5 * least:
        said.append(f"Against it: a force of {left:.2g} U0^2/L stays unexplained, with the best only {least:.2g}.")
    return said


def _odds(gap: float) -> str:
    return f"1 to {np.exp(min(gap, 13.8)):.0f}" if gap < 13.8 else "less than one in a million"


def next_steps(tried: Contest, verdict: Verdict, chosen: Judged, mismatch: bool) -> list[str]:
    """What to record next.

    Args:
        tried: The contest.
        verdict: The probabilities.
        chosen: What was found.
        mismatch: Whether recordings and model differ.

    Returns:
        Sentences, most useful first.
    """
    if not mismatch:
        return [
            "Nothing more is needed for these manoeuvres; another speed or a harder turn would test the model further."
        ]
    if not chosen.names:
        return ["Repeat one run on a heading 90 deg away and one at half speed: they show what the misfit depends on."]
    families = {j.names[0]: j.hypothesis.effects[0].family for j in tried.judged if len(j.names) == 1}
    rivals = sorted(((p, n) for n, p in verdict.effects.items() if n not in chosen.names), reverse=True)
    said = []
    for probability, rival in rivals[:2]:
        if probability < 0.01:
            break
        key = frozenset({families.get(chosen.names[0], ""), families.get(rival, "")})
        advice = ADVICE.get(key, "the same manoeuvre at another speed and on a heading 90 deg away")
        said.append(f"To tell {chosen.names[0]} from {rival} ({probability:.0%}): {advice}.")
    return said or [
        f"{' and '.join(chosen.names)} stand out clearly; a repeat at another speed would confirm the values."
    ]
