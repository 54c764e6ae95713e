"""Scores one tool's answers against what was concealed, by the rules that the recordings' format publishes.

From the command line: ``python -m studies.concealed_trial.score recordings=DIR out=DIR`` for a set whose cases hold
their answers.json; ``out`` holds the tool's answers and takes the scoreboard.
"""

import json
import sys
from collections.abc import Mapping
from functools import lru_cache
from itertools import permutations
from math import radians
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.optimize import linear_sum_assignment

from manoeuvre_nn.core.ending import one_line
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.writing import write_file
from studies.concealed_trial import true_model
from studies.concealed_trial.effects import ANGLES, EQUIVALENT, FAMILY, NAMES, UNKNOWN
from studies.concealed_trial.scoreboard import markdown, scoreboard
from studies.concealed_trial.ships import TrialShip, trial_ships
from studies.concealed_trial.stated import claimed, half_times, stated_effects
from studies.concealed_trial.strength import STRENGTHS
from studies.concealed_trial.truth import ConcealedEffect

TOLERANCE, ANGLE_TOLERANCE = 0.1, 10.0
"""A parameter is right within 10 % (a direction within 10 deg) or two standard errors."""
CLOSABLE = 0.1
"""A gap counts as closable if the J of the true model is this share below that of the calm-water model."""
HARM = 1.05
"""Predictions are made worse if J grows by this factor."""


def score_case(case_dir: Path, answer_dir: Path, truth: Mapping[str, Any]) -> dict[str, Any]:
    """Score one answer.

    Args:
        case_dir: Recordings and manifest of the case.
        answer_dir: The tool's ``answer.json`` and ``predictions`` for it; may be missing.
        truth: What was concealed, as in an ``answers.json``.

    Returns:
        All marks; those that do not apply are None.
    """
    answer, note = read_answer(answer_dir / "answer.json")
    manifest = true_model.read_manifest(case_dir)
    named = [entry["name"] for entry in answer["effects"]]
    effects = list(truth["effects"])
    present = bool(effects)
    row: dict[str, Any] = {
        "case": truth["case"],
        "ship": truth["ship"],
        "truth": [effect["name"] for effect in effects],
        "detail": [effect.get("detail") for effect in effects],
        "strength": [effect.get("strength") for effect in effects],
        "strongest": max((effect.get("strength") for effect in effects), key=_rank, default=None),
        "channels": truth.get("channels", "full"),
        "family": [FAMILY.get(effect["name"], UNKNOWN) for effect in effects],
        "answered": note is None,
        "note": note,
        "verdict": answer["verdict"],
        "false_alarm": None if present else answer["verdict"] == "mismatch",
        "detected": answer["verdict"] == "mismatch" if present else None,
        "first": named[0] if named and answer["verdict"] == "mismatch" else "none",
    }
    row |= names_right(row["first"], named, effects)
    said = answer["effects"][: len(effects)] if answer["verdict"] == "mismatch" else []
    row["effects"] = [_effect_marks(effect, said, manifest) for effect in effects]
    row["places"] = places(claimed(answer), effects)
    row["probabilities"] = probabilities(answer, effects)
    row["brier"] = sum((p - y) ** 2 for p, y in row["probabilities"].values())
    stated = stated_effects(answer, trial_ships()[truth["ship"]]) if note is None else None
    return row | gap(case_dir, answer_dir, truth, stated)


def _rank(strength: str | None) -> int:
    """Strengths in order; those of other sets that name none come first."""
    return STRENGTHS.index(strength) if strength in STRENGTHS else -1


def read_answer(path: Path) -> tuple[dict[str, Any], str | None]:
    """A tool's answer.

    Args:
        path: Its file.

    Returns:
        The answer, with the effects ranked as they data, and why it could not be used; an answer that cannot be used
        counts as ``none``.
    """
    nothing: dict[str, Any] = {"verdict": "none", "effects": []}
    if not path.is_file():
        return nothing, "no answer.json"
    try:
        answer = json.loads(path.read_text())
        effects = [
            {
                "name": str(entry["name"]),
                "probability": min(max(float(entry.get("probability") or 0.0), 0.0), 1.0),
                "equation": entry.get("equation") or [],
                "intervals": entry.get("intervals") or "all",
                "parameters": entry.get("parameters") or {},
            }
            for entry in answer.get("effects") or []
        ]
        verdict = answer["verdict"]
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        return nothing, f"answer.json cannot be read: {type(error).__name__} {error}"
    if verdict not in {"none", "mismatch"}:
        return nothing, f"verdict {verdict!r} is neither none nor mismatch"
    model = answer.get("model")
    return {"verdict": verdict, "effects": effects, "model": model if isinstance(model, list) else None}, None


def names_right(first: str, named: list[str], effects: list[Mapping[str, Any]]) -> dict[str, Any]:
    """Marks for the names.

    Args:
        first: The first name, ``none`` if the verdict was that.
        named: All names, ranked.
        effects: What was concealed.

    Returns:
        Whether the first name is one of them; whether one of the first two is; whether the first two are those of a
        pair, and as many as there are those of a pair or triple; the family of the first name; unknown where it was,
        and where it was not.
    """
    wrong = first == UNKNOWN if UNKNOWN not in [effect["name"] for effect in effects] else None
    if not effects:
        none = ("first_right", "first_two_right", "both_right", "all_right", "family_right", "unknown_right")
        return dict.fromkeys(none) | {"unknown_wrong": wrong}
    alike = [_equal_names(effect) for effect in effects]
    said = named if first != "none" else []
    every = _assigned(said[: len(effects)], alike)
    families = {FAMILY.get(name, UNKNOWN) for names in alike for name in names}
    return {
        "first_right": any(first in names for names in alike),
        "first_two_right": any(name in names for name in said[:2] for names in alike),
        "both_right": every if len(effects) == 2 else None,
        "all_right": every if len(effects) > 1 else None,
        "family_right": FAMILY.get(first) in families,
        "unknown_right": first == UNKNOWN if effects[0]["name"] == UNKNOWN else None,
        "unknown_wrong": wrong,
    }


def _equal_names(effect: Mapping[str, Any]) -> set[str]:
    """Names that count as right for an effect."""
    return {effect["name"], *(effect.get("equivalent_names") or EQUIVALENT.get(effect["name"], ()))}


def _assigned(names: list[str], alike: list[set[str]]) -> bool:
    """Whether as many names as effects are those of the effects, in any order."""
    if len(names) < len(alike):
        return False
    return any(all(n in a for n, a in zip(order, alike, strict=True)) for order in permutations(names))


def places(said: list[dict[str, Any]], effects: list[Mapping[str, Any]]) -> tuple[int, int, int]:
    """Places that were found, said in vain and missed, with as many of them found as any order of the effects allows.

    Args:
        said: Entries that the answer holds to be present.
        effects: What was concealed.

    Returns:
        True positives, false positives, false negatives.
    """
    told = [_as_set(entry["equation"]) for entry in said]
    right = [
        [_as_set(place) for place in (effect["equation"], *(effect.get("equation_accepted") or []))]
        for effect in effects
    ]
    fits = np.array([[place in accepted for place in told] for accepted in right], dtype=int)
    fits = fits.reshape(len(effects), len(said))
    true = int(fits[linear_sum_assignment(fits, maximize=True)].sum())
    return true, len(said) - true, len(effects) - true


def _effect_marks(
    effect: Mapping[str, Any], entries: list[dict[str, Any]], manifest: Mapping[str, Any]
) -> dict[str, Any]:
    """Marks for one effect: named among the first (as many as there are effects), place, interval, parameters."""
    alike = _equal_names(effect)
    entry = next((e for e in entries if e["name"] in alike), None)
    said = entry or (entries[0] if entries else None)
    marks: dict[str, Any] = {
        "name": effect["name"],
        "detail": effect.get("detail"),
        "strength": effect.get("strength"),
        "family": FAMILY.get(effect["name"], UNKNOWN),
        "named": entry is not None,
        "place_right": False,
        "overlap": None,
        "parameters": [],
    }
    if said is not None:
        places = [effect["equation"], *(effect.get("equation_accepted") or [])]
        marks["place_right"] = _as_set(said["equation"]) in [_as_set(place) for place in places]
    if effect["intervals"] != "all":
        marks["overlap"] = overlap(effect["intervals"], half_times(said)[0] if said else {}, manifest)
    if entry is not None and entry["name"] == effect["name"] and effect["name"] != UNKNOWN:
        marks["parameters"] = [
            parameter_marks(name, float(value), entry["parameters"].get(name))
            for name, value in effect["parameters"].items()
        ]
    return marks


def _as_set(place: str | list[str]) -> frozenset[str]:
    """A place that may be one string or a list."""
    return frozenset([place] if isinstance(place, str) else map(str, place))


def parameter_marks(name: str, true: float, given: Any) -> dict[str, Any]:
    """Marks for one parameter.

    Args:
        name: Its name; directions are compared modulo 360 deg.
        true: True value.
        given: ``[value, standard error, unit]`` or nothing.

    Returns:
        Error over the true value (of a direction in rad), whether it is right, and whether two standard errors cover it
        (None without a standard error).
    """
    try:
        value, se = float(given[0]), float(given[1]) if len(given) > 1 and given[1] is not None else None
    except (TypeError, ValueError, IndexError):
        nothing = {"name": name, "true": true, "value": None, "se": None, "right": False, "covered": None}
        return nothing | {"error": None}
    miss = abs(value - true)
    if name in ANGLES:
        miss = abs((value - true + 180.0) % 360.0 - 180.0)
    allowed = ANGLE_TOLERANCE if name in ANGLES else TOLERANCE * abs(true)
    covered = None if se is None else bool(miss <= 2 * se)
    right = bool(miss <= max(allowed, 2 * se if se is not None else 0.0))
    error = radians(miss) if name in ANGLES else miss / abs(true) if true else None
    marks = {"name": name, "true": true, "value": value, "se": se, "right": right, "covered": covered}
    return marks | {"error": error}


def overlap(true: Mapping[str, Any] | str, given: Mapping[str, Any] | str, manifest: Mapping[str, Any]) -> float:
    """Intersection over union of intervals over all runs of a case, to the second.

    Args:
        true: Intervals of each run, or ``"all"``.
        given: The same, as answered.
        manifest: Of the case.

    Returns:
        Between 0 and 1.
    """
    both = either = 0
    for run in manifest["runs"]:
        seconds = np.arange(int(run["duration_s"]))
        a, b = (_acting(which, run["run"], seconds) for which in (true, given))
        both, either = both + int((a & b).sum()), either + int((a | b).sum())
    return both / either if either else 1.0


def _acting(intervals: Mapping[str, Any] | str, run: str, seconds: np.ndarray) -> np.ndarray:
    """In which seconds of a run an effect acts."""
    if isinstance(intervals, str):
        return np.ones(len(seconds), bool)
    acts = np.zeros(len(seconds), bool)
    for start, end in intervals.get(run) or []:
        acts |= (seconds >= float(start)) & (seconds < float(end))
    return acts


def probabilities(answer: Mapping[str, Any], effects: list[Mapping[str, Any]]) -> dict[str, tuple[float, int]]:
    """Probability and truth of every name; names that cannot be told apart share theirs.

    Args:
        answer: The tool's.
        effects: What was concealed.

    Returns:
        Name, with its probability and 1 if it is present.
    """
    given = dict.fromkeys(NAMES, 0.0)
    for entry in answer["effects"]:
        if entry["name"] in given:
            given[entry["name"]] = max(given[entry["name"]], entry["probability"])
    present = {effect["name"] for effect in effects}
    for effect in effects:
        for rival in _equal_names(effect) - present:
            given[effect["name"]] = min(1.0, given[effect["name"]] + given.pop(rival, 0.0))
    return {name: (p, int(name in present)) for name, p in given.items()}


def gap(
    case_dir: Path, answer_dir: Path, truth: Mapping[str, Any], stated: list[ConcealedEffect] | None = None
) -> dict[str, Any]:
    """Errors before, after and of the true model, and the share of the closable gap that was closed.

    The stated effects alone are run by the referee's simulator, with nominal coefficients, as the true model is.

    Args:
        case_dir: Recordings and manifest.
        answer_dir: The tool's predictions.
        truth: What was concealed.
        stated: Effects with the parameters that the answer states.

    Returns:
        J of all and the shares, at least -1; None where a prediction is missing or nothing could be closed, and by the
        stated effects where an effect that no list has was concealed.
    """
    ship = trial_ships()[truth["ship"]]
    before, after = (true_model.rmse(case_dir, _read_predictions(answer_dir, which)) for which in ("before", "after"))
    calm, best = _simulated(case_dir, "[]"), _simulated(case_dir, json.dumps(truth["effects"]))
    before = before or calm  # a tool without predictions is held against the calm-water model
    j_before, j_after, j_best = (None if e is None else true_model.total(ship, e) for e in (before, after, best))
    closable = bool(truth["effects"]) and j_before is not None and j_best is not None
    share = harmed = j_stated = share_stated = None
    if j_before is not None and j_best is not None:
        closable = closable and j_before - j_best > CLOSABLE * j_before
        if closable and j_after is not None:
            share = max((j_before - j_after) / (j_before - j_best), -1.0)
        if closable and stated is not None and UNKNOWN not in [effect["name"] for effect in truth["effects"]]:
            j_stated = _total_of(case_dir, stated, ship)
            share_stated = max((j_before - j_stated) / (j_before - j_best), -1.0)
    if j_before is not None and j_after is not None:
        harmed = j_after > HARM * j_before
    errors = {"rmse_before": before, "rmse_after": after, "rmse_true_model": best}
    marks = {"j_before": j_before, "j_after": j_after, "j_true_model": j_best}
    marks |= {"j_stated": j_stated, "share_stated": share_stated}
    return errors | marks | {"closable": closable, "share": share, "harmed": harmed}


def _total_of(case_dir: Path, stated: list[ConcealedEffect], ship: TrialShip) -> float:
    """J of the simulator with stated effects; infinite where their values cannot be run."""
    plain = [
        {"name": e.name, "parameters": dict(e.parameters), "intervals": e.intervals, "ramp_s": e.ramp} for e in stated
    ]
    try:
        errors = _simulated(case_dir, json.dumps(plain))
    except (ArithmeticError, ValueError, TypeError):  # a depth less than the draught, a rate of nothing
        return float("inf")
    return float("inf") if errors is None else true_model.total(ship, errors)


@lru_cache(maxsize=512)
def _simulated(case_dir: Path, published: str) -> dict[str, float] | None:
    """Errors of the simulator's own predictions, once for all tools; None with an effect that is not known here."""
    effects = true_model.effects_of({"effects": json.loads(published)})
    return None if effects is None else true_model.rmse(case_dir, true_model.predictions(case_dir, effects))


def _read_predictions(answer_dir: Path, which: str) -> dict[str, pd.DataFrame]:
    """Prediction tables of an answer."""
    folder = answer_dir / "predictions" / which
    return {path.stem: pd.read_csv(path) for path in sorted(folder.glob("*.csv"))}


def main(arguments: list[str]) -> None:
    """Score a set whose cases hold their answers.

    Args:
        arguments: ``recordings=DIR`` and ``out=DIR``.

    Raises:
        InputError: If an argument is not understood or a folder holds no cases.
    """
    given = dict(argument.split("=", 1) for argument in arguments if "=" in argument)
    if set(given) != {"recordings", "out"} or len(arguments) != 2:
        raise InputError(f"got {' '.join(arguments) or 'nothing'}; write recordings=DIR out=DIR")
    recordings, out = Path(given["recordings"]), Path(given["out"])
    cases = sorted(path.parent for path in recordings.glob("*/answers.json"))
    if not cases:
        raise InputError(f"recordings={recordings} holds no case with an answers.json; give the folder above the cases")
    if not out.is_dir():
        raise InputError(f"out={out} does not exist; give the folder with the tool's answers")
    rows = [score_case(case, out / case.name, json.loads((case / "answers.json").read_text())) for case in cases]
    board = scoreboard(rows)
    write_file(out / "scoreboard.json", json.dumps({"board": board, "cases": rows}, indent=1))
    text = markdown({"answers": board})
    write_file(out / "scoreboard.md", text)
    print(text)


if __name__ == "__main__":
    with one_line():
        main(sys.argv[1:])
