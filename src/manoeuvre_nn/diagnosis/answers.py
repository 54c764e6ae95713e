"""Answers in the form in which concealed cases are scored."""

import json
import math
from dataclasses import replace
from pathlib import Path

import pandas as pd

from manoeuvre_nn.core.writing import draft_of, write_file
from manoeuvre_nn.diagnosis.result import Cause, Diagnosis, Nature, Value

OTHER_SIGN = frozenset({"offset_deg"})
"""Parameters whose sign goes with the rudder's: positive to port in the cases, to starboard in the package."""
COLUMNS = {"x": "x_north", "y": "y_east", "vn": "u", "ve": "v"}
"""Channel -> its column in the csv of a case, where velocity over ground is along and across the heading."""


def write_answer(d: Diagnosis, folder: Path) -> None:
    """Write ``answer.json`` and the predictions of a case into a folder."""
    for when in ("before", "after"):
        place = folder / "predictions" / when
        for proof in [*d.proofs, *d.forecasts]:
            table: pd.DataFrame = getattr(proof, when).copy()
            whole = table["psi"] - table["psi"] % 360
            for name in [c for c in ("psi", "psi_low", "psi_high") if c in table]:
                table[name] = table[name] - whole
            with draft_of(place / f"{proof.run}.csv") as draft:
                table.to_csv(draft, index=False, float_format="%.5f")
    # Last, and at once: a case with an answer is complete.
    write_file(folder / "answer.json", json.dumps(answer(d), indent=1) + "\n")


def answer(d: Diagnosis) -> dict:
    """The content of ``answer.json``: plain values."""
    model = d.model if d.model else (["unknown"] if d.verdict == "mismatch" else [])
    return {
        "case": d.case,
        "verdict": d.verdict,
        "sentence": d.sentence,
        "this_ship": not d.doubtful,
        "effects": [_effect(c) for c in d.causes if c.probability >= 1e-4],
        "model": model,
        "next_run": d.next_run,
        "heldout_rmse_before": {k: _number(v) for k, v in d.rmse("before").items()},
        "heldout_rmse_after": {k: _number(v) for k, v in d.rmse("after").items()},
        "heldout_rmse_of_effects_alone": {k: _number(v) for k, v in d.rmse("alone").items()},
        "measurement_noise": {k: _number(v) for k, v in d.noise.items()},
        "checks": [{"name": c.name, "passed": c.passed, "text": c.text} for c in d.checks],
    }


def _effect(c: Cause) -> dict:
    intervals = (
        "all" if c.intervals is None else {r: [[round(t, 1) for t in i] for i in v] for r, v in c.intervals.items()}
    )
    more = {} if c.nature is None else {"nature": _nature(c.nature)}
    return {
        "name": c.name,
        "probability": round(c.probability, 4),
        "equation": [_place(e) for e in c.equations],
        "intervals": intervals,
        "parameters": {_key(v): _with_error(_signed(v)) for v in c.parameters},
        "intervals_95": {_key(v): _ends(_signed(v)) for v in c.parameters},
        **more,
    }


def _place(equation: str) -> str:
    """A place in the words of the cases: sensors by their columns."""
    kind, _, channel = equation.partition(":")
    return f"{kind}:{COLUMNS.get(channel, channel)}" if channel else equation


def _nature(nature: Nature) -> dict:
    """What something unknown is like; null is what the recordings do not tell."""
    return {
        "kind": nature.kind,
        "equation": [_place(e) for e in nature.equations],
        "size": {"name": nature.size.name, "value": _with_error(nature.size)},
        "scales": {v.name: _with_error(v) for v in nature.scales},
        "log_evidence": _number(nature.against),
        "predictable": nature.predictable and not nature.refuted,
        "frame": nature.frame or None,
        "parity": nature.parity or None,
        "share_in_hard_helm": _number(nature.regime),
    }


def _key(v: Value) -> str:
    return f"{v.name} ({v.campaign})" if v.campaign else v.name


def _signed(v: Value) -> Value:
    """A value in the sign of the cases."""
    return replace(v, value=-v.value, low=-v.high, high=-v.low) if v.name in OTHER_SIGN else v


def _ends(v: Value) -> list[float | None] | None:
    """The 95 % interval; from north on 350 to 10 go round; null where the standard error is not known."""
    return None if v.interval is None else [_number(end) for end in v.interval]


def _with_error(v: Value) -> list:
    return [_number(v.value), _number(v.error), v.unit]


def _number(x: float) -> float | None:
    return float(f"{x:.5g}") if math.isfinite(x) else None
