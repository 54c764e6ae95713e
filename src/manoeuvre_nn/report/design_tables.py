"""Which manoeuvre to sail next, in words: one sentence, a table, and JSON."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd

from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.design.candidates import ExpectedGain
from manoeuvre_nn.dynamics.limits import OK


@dataclass(frozen=True)
class ManoeuvreAdvice:
    """What to sail next, and why.

    Attributes:
        ship: Name of the ship.
        goal: ``accuracy`` or ``coefficients``.
        expected: What every candidate is expected to bring, best first.
        trained_on: Sentence on what is recorded.
        where: Disagreement of the members along the targets, see :func:`.disagreements`; None for a model without
            members.
        recorded: v', r' [-], rudder angle [rad] of what is recorded.
        coefficients: What the coefficients are.
        left_out: Candidates that were not tried, and why.
        per_minute: Whether candidates are ranked by the gain for every minute.
        typed: Name of a candidate that is no option's -> how it is typed for other commands.
    """

    ship: str
    goal: str
    expected: Sequence[ExpectedGain]
    trained_on: str
    where: pd.DataFrame | None
    recorded: np.ndarray
    coefficients: str = ""
    left_out: Sequence[str] = field(default_factory=tuple)
    per_minute: bool = False
    typed: Mapping[str, str] = field(default_factory=dict)

    @property
    def best(self) -> ExpectedGain:
        """The first candidate that nothing speaks against; the very first if there is none."""
        return next((e for e in self.expected if e.status == OK), self.expected[0])


def sentence(a: ManoeuvreAdvice) -> str:
    """What to sail next and why, in one sentence."""
    best = a.best
    typed = f"'{a.typed[best.manoeuvre]}', " if best.manoeuvre in a.typed else ""
    begin = f"Sail next: {best.manoeuvre} ({typed}{best.seconds / 60:.0f} min)"
    if best.status != OK:
        begin += f", with care ({best.status})"
    if a.goal == "coefficients":
        equation = max(best.targets, key=lambda e: best.targets[e][0] / best.targets[e][1])
        fall = best.targets[equation]
        return (
            f"{begin}, because it tells most about the coefficients of {a.coefficients}: their standard errors fall to "
            f"{100 * best.then / best.now:.0f} % on average, those of {equation} to {100 * fall[1] / fall[0]:.0f} %."
        )
    # Not itself: that it is known once it is sailed says nothing.
    others = [name for name in best.targets if name != best.manoeuvre] or list(best.targets)
    worst = max(others, key=lambda name: best.targets[name][0])
    now, then = best.targets[worst]
    return (
        f"{begin}, because the members disagree most about {worst} ({now:.2g} L apart now, {then:.2g} L after it)"
        f"{_place(a, worst)}; on average the error falls from {best.now:.2g} to {best.then:.2g} L."
    )


def _place(a: ManoeuvreAdvice, target: str) -> str:
    """Where on a target they disagree most."""
    if a.where is None:
        return ""
    along = a.where[a.where["manoeuvre"] == target]
    v, r, delta = along[["v", "r", "delta"]].iloc[along["spread"].argmax()]
    rudder = f"{abs(delta) / DEGREE:.0f} deg of rudder{_side(delta)}"
    return f", above all at {rudder}, v' = {v:.2f} (sway{_side(v)}), r' = {r:.2f} (yaw rate{_side(r)})"


def _side(value: float) -> str:
    """To which side a rudder angle, a sway velocity or a yaw rate is; empty of one that is 0."""
    return f" to {'starboard' if value > 0 else 'port'}" if abs(value) > 5e-4 else ""


def advice_rows(a: ManoeuvreAdvice) -> list[dict[str, Any]]:
    """Candidates as rows, best first."""
    names = ("dev/L now", "then") if a.goal == "accuracy" else ("errors now", "then")
    return [
        {
            "manoeuvre": e.manoeuvre,
            "min": round(e.seconds / 60, 1),
            names[0]: e.now,
            names[1]: e.then,
            "gain": e.gain,
            "gain/min": e.per_minute,
            "status": e.status,
        }
        for e in a.expected
    ]


def target_rows(a: ManoeuvreAdvice) -> list[dict[str, Any]]:
    """What is left of each target's deviation, or each equation's standard errors, by candidate; first now."""
    now = {"after": "nothing", **{name: pair[0] for name, pair in a.expected[0].targets.items()}}
    return [now, *({"after": e.manoeuvre, **{name: pair[1] for name, pair in e.targets.items()}} for e in a.expected)]


def advice_json(a: ManoeuvreAdvice, versions: Mapping[str, str]) -> dict[str, Any]:
    """What ``excite.json`` holds: plain numbers and strings."""
    return {
        "sail_next": a.best.manoeuvre,
        "sentence": sentence(a),
        "ship": a.ship,
        "goal": a.goal,
        "per_minute": a.per_minute,
        "trained_on": a.trained_on,
        "coefficients": a.coefficients,
        "candidates": [
            {
                "manoeuvre": e.manoeuvre,
                "seconds": e.seconds,
                "now": e.now,
                "then": e.then,
                "gain": e.gain,
                "gain_per_minute": e.per_minute,
                "status": e.status,
                "targets": {name: {"now": pair[0], "then": pair[1]} for name, pair in e.targets.items()},
            }
            for e in a.expected
        ],
        "not_tried": list(a.left_out),
        "versions": dict(versions),
    }
