"""What a peer says of a case, in the form in which concealed cases are scored, and the threshold for ``none``."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path

from manoeuvre_nn.core.errors import InputError

OTHER_SIGN = ("offset_deg",)
"""Parameters whose sign goes with the rudder's: positive to port in the cases, to starboard in the package."""
SURE = 0.97
"""Largest probability that is stated."""


@dataclass(frozen=True)
class Named:
    """An effect that a peer names.

    Attributes:
        name: Its name.
        probability: Of being present.
        equations: Where it acts.
        parameters: Name -> value, standard error, unit; in the package's signs.
        intervals: Run -> times in which it acts [s]; None: throughout.
    """

    name: str
    probability: float
    equations: tuple[str, ...]
    parameters: Mapping[str, tuple[float, float, str]]
    intervals: Mapping[str, list[list[float]]] | None = None


@dataclass(frozen=True)
class Opinion:
    """What a peer says of a case.

    Attributes:
        case: Name of the case.
        score: How much speaks against calm water; the verdict is ``mismatch`` above a threshold.
        named: Effects, most probable first, given that there is one.
    """

    case: str
    score: float
    named: Sequence[Named]


def content(opinion: Opinion, threshold: float) -> dict:
    """An answer as it is scored.

    Args:
        opinion: What the peer says.
        threshold: Score above which there is a mismatch.

    Returns:
        Plain values; the score stands in it too, so that thresholds can be chosen afterwards.
    """
    mismatch = opinion.score > threshold
    return {
        "case": opinion.case,
        "verdict": "mismatch" if mismatch else "none",
        "score": _number(opinion.score),
        "effects": [_effect(n, 1.0 if mismatch else DOUBT) for n in opinion.named],
    }


DOUBT = 0.3
"""Factor on all probabilities below the threshold."""


def _effect(n: Named, factor: float) -> dict:
    """One entry."""
    return {
        "name": n.name,
        "probability": round(min(n.probability, SURE) * factor, 4),
        "equation": list(n.equations),
        "intervals": "all" if n.intervals is None else {k: [[round(t, 1) for t in i] for i in v] for k, v in n.intervals.items()},
        "parameters": {
            k: [_number(-v if k in OTHER_SIGN else v), _number(e), unit] for k, (v, e, unit) in n.parameters.items()
        },
    }  # fmt: skip


def _number(x: float) -> float | None:
    return float(f"{x:.5g}") if isfinite(x) else None


def write(opinion: Opinion, threshold: float, folder: Path) -> None:
    """Write ``answer.json``, at once: a case with one is complete.

    Args:
        opinion: What the peer says.
        threshold: Score above which there is a mismatch.
        folder: Folder of the answer; it is made.
    """
    folder.mkdir(parents=True, exist_ok=True)
    draft = folder / "answer.json.part"
    draft.write_text(json.dumps(content(opinion, threshold), indent=1) + "\n")
    draft.replace(folder / "answer.json")


def threshold_at(scores: Sequence[float], rate: float) -> float:
    """The lowest threshold at which no more than a share of clean cases is taken for a mismatch.

    Args:
        scores: Scores of cases without any effect.
        rate: The share.

    Returns:
        The threshold: a score itself counts as none.

    Raises:
        InputError: If there are no clean cases.
    """
    if not scores:
        raise InputError("calibrate=true needs cases without any effect; there is none among these")
    ranked = sorted(scores, reverse=True)
    return float(ranked[min(int(rate * len(ranked) + 1e-9), len(ranked) - 1)])
