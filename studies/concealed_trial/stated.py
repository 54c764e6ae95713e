"""What an answer states: entries that it holds to be present, and the effects that the simulator can run by them."""

from collections.abc import Mapping
from math import isfinite
from typing import Any

from studies.concealed_trial.effects import KINDS, UNKNOWN, Kind
from studies.concealed_trial.ships import TrialShip
from studies.concealed_trial.truth import ConcealedEffect

RAMP = "ramp_s"
"""What an answer may state of a wind that sets in beside what the format asks for: how long that takes [s]."""
PRESENT = 0.5
"""An entry is held to be present from this probability on, where the answer does not list its model."""


def claimed(answer: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The entries that an answer holds to be present.

    Args:
        answer: The tool's, as read.

    Returns:
        Those of its ``model``; without one those with a probability of one half at least; the first at least. None if
        the verdict is none.
    """
    entries = answer["effects"] if answer["verdict"] == "mismatch" else []
    model = answer.get("model")
    named = [e for e in entries if (e["name"] in model if model else e["probability"] >= PRESENT)]
    return named or list(entries[:1])


def stated_effects(answer: Mapping[str, Any], ship: TrialShip) -> list[ConcealedEffect]:
    """The effects of an answer with the parameters and intervals that it states.

    Args:
        answer: The tool's, as read.
        ship: The ship.

    Returns:
        What the simulator can run; ``unknown``, and what lacks a parameter, states nothing that could be run.
    """
    found = []
    for entry in claimed(answer):
        kind = _kind(entry["name"])
        parameters = {} if kind is None else _values(entry, parameter_names(kind, ship))
        if parameters:
            intervals, ramp = half_times(entry)
            found.append(ConcealedEffect(entry["name"], parameters, _intervals(intervals), ramp=ramp))
    return found


def half_times(entry: Mapping[str, Any]) -> tuple[Any, float]:
    """When an effect acts: of one that sets in over a ramp that the answer states, from when half of it is there.

    An answer tells of such an effect from where its ramp begins; the trial's own intervals begin half way up.

    Args:
        entry: Of an answer.

    Returns:
        Intervals as they are given, and the ramp [s]; 0 is at once.
    """
    kind = _kind(entry["name"])
    ramp, given = _values(entry, [RAMP]).get(RAMP, 0.0), entry["intervals"]
    if kind is None or kind.confined != "onset" or ramp <= 0 or not isinstance(given, Mapping):
        return given, 0.0
    return {run: [[start + 0.5 * ramp, end] for start, end in parts or []] for run, parts in given.items()}, ramp


def _kind(name: str) -> Kind | None:
    """The listed kind of a name."""
    return next((kind for kind in KINDS if kind.name == name), None)


def parameter_names(kind: Kind, ship: TrialShip) -> list[str]:
    """Names of a listed kind's parameters.

    Args:
        kind: The kind.
        ship: The ship.

    Returns:
        The names that the format gives them.
    """
    return [] if kind.name == UNKNOWN else list(kind.make(ship, kind.low, {k: v[1] for k, v in kind.extras.items()}))


def _values(entry: Mapping[str, Any], names: list[str]) -> dict[str, float]:
    """Values of all parameters that are named, or nothing."""
    try:
        values = {name: float(entry["parameters"][name][0]) for name in names}
    except (KeyError, TypeError, ValueError, IndexError):
        return {}
    return values if all(isfinite(value) for value in values.values()) else {}


def _intervals(given: Any) -> Mapping[str, list[list[int]]] | str:
    """Intervals as the simulator takes them."""
    if not isinstance(given, Mapping):
        return "all"
    return {str(run): [[round(float(t)) for t in interval] for interval in parts or []] for run, parts in given.items()}
