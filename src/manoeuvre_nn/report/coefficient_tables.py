"""Coefficients in tables, sentences and JSON."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from manoeuvre_nn.core.ship import Particulars
from manoeuvre_nn.estimation.captive_fit import Compared, Towed
from manoeuvre_nn.estimation.coefficients import (
    MEASURED,
    OWN,
    PARTLY,
    PLAIN,
    PRIOR,
    REACH,
    TAYLOR,
    Coefficient,
    Fitted,
    coefficient_table,
)
from manoeuvre_nn.estimation.collinear import Group, collinear_groups
from manoeuvre_nn.estimation.linear_motion import Derived
from manoeuvre_nn.report.tables import Row

SYSTEMS = {
    TAYLOR: "derivatives about the approach over 0.5 rho L T U0^2 (N: times L), as in Y_vvv v^3/6; velocities over U0",
    PLAIN: "factors of products over 0.5 rho L T U0^2 (N: times L); velocities over U0, n over the nominal one",
    OWN: "coefficients of the ship's own source, BIS system",
}
"""What the numbers are."""
ONLY_RATIOS = "Free runs show forces over inertia only: all values hold for the inertia that was taken as known."


@dataclass(frozen=True)
class Beside:
    """Captive tests beside a fit to recordings.

    Attributes:
        tests: The tests.
        fitted: Coefficients from them.
        rows: Both beside each other.
        inertia: Of sway and yaw, with which the slopes would agree.
    """

    tests: Towed
    fitted: Fitted
    rows: Sequence[Compared]
    inertia: np.ndarray


@dataclass(frozen=True)
class Coefficients:
    """All that is told of a set of coefficients.

    Attributes:
        ship: The ship.
        fitted: The coefficients.
        derived: What follows from them.
        source: Sentence on what they were fitted to.
        beside: Captive tests, where there are any.
        ratio: How far stretches of the recordings disagree over what noise allows; errors are widened by its root.
    """

    ship: Particulars
    fitted: Fitted
    derived: Sequence[Derived] = ()
    source: str = ""
    beside: Beside | None = None
    ratio: float = 1.0
    groups: Sequence[Group] = field(init=False)
    rows: Sequence[Coefficient] = field(init=False)

    def __post_init__(self) -> None:
        """Work out rows and groups once."""
        object.__setattr__(self, "rows", coefficient_table(self.fitted))
        object.__setattr__(self, "groups", collinear_groups(self.fitted))


def _coefficient_rows(rows: Sequence[Coefficient]) -> list[Row]:
    """The table of coefficients."""
    return [
        {
            "": r.symbol,
            "value": r.value,
            "± 95 %": (r.high - r.low) / 2,
            "before": r.prior,
            "± before": REACH * r.prior_error,
            "narrowed by": f"{100 * r.learnt:.0f} %",
            "it is": r.word,
        }
        for r in rows
    ]


def _group_rows(groups: Sequence[Group]) -> list[Row]:
    """Coefficients that go together."""
    return [
        {"together": ", ".join(g.symbols), "corr.": round(g.correlation, 3), "why": g.words, "known is": g.sum}
        for g in groups
    ]


def _derived_rows(found: Sequence[Derived]) -> list[Row]:
    """What follows from the coefficients."""
    return [
        {"": d.name, "value": d.value, "from": _number(d.low), "to": _number(d.high), "that is": d.words or None}
        for d in found
    ]


def _compared_rows(rows: Sequence[Compared]) -> list[Row]:
    """Recordings and captive tests beside each other."""
    return [
        {
            "": r.name,
            "recordings": r.free,
            "± 95 %": REACH * r.free_error,
            "captive": r.towed,
            "± 95 % ": REACH * r.towed_error,
            "apart by": round(r.apart, 1) if r.known else None,
            "they": r.word,
        }
        for r in rows
    ]


def sentence(told: Coefficients) -> str:
    """The verdict in one sentence.

    Args:
        told: The coefficients.

    Returns:
        How many are measured, and how many go together.
    """
    words = [r.word for r in told.rows]
    text = (
        f"{words.count(MEASURED)} of {len(words)} coefficients are measured, {words.count(PARTLY)} partly, "
        f"{words.count(PRIOR)} are what was assumed; the recordings fix {told.fitted.determined:.1f} combinations"
    )
    tied = len({s for g in told.groups for s in g.symbols})
    return text + (f", and {tied} coefficients in {len(told.groups)} groups are known only together." if tied else ".")


def notes(told: Coefficients) -> list[str]:
    """What is to be minded.

    Args:
        told: The coefficients.

    Returns:
        Sentences.
    """
    mass = np.diag(told.fitted.inertia)
    lines = [f"Values are {SYSTEMS[told.fitted.form]}; rudder positive to starboard."] if told.fitted.form != OWN else [
        f"Values are {SYSTEMS[OWN]}; rudder positive to port, as the source has it."
    ]  # fmt: skip
    lines.append(f"{ONLY_RATIOS} Here mx' = {mass[0]:.4f}, my' = {mass[1]:.4f}, mz' = {mass[2]:.5f}.")
    lines.append(_error_note(told.ratio))
    if told.source:
        lines.insert(0, told.source)
    if told.beside is not None:
        lines += _captive_notes(told.beside)
    return lines


def _error_note(ratio: float) -> str:
    """How far errors can be believed."""
    if ratio <= 1.0:
        return "Stretches of the recordings agree on the coefficients as noise allows: errors are those of noise."
    return (
        f"Stretches of 10 L/U0 disagree on coefficients by {ratio**0.5:.1f} times what noise allows: the products are "
        "not quite those of the ship. All errors are widened so far."
    )


def _captive_notes(beside: Beside) -> list[str]:
    """What a comparison with captive tests can show."""
    m = beside.inertia
    return [
        f"Captive: {beside.tests.note}. Static tests have no yaw rate: products with r are not compared. "
        "Forces of tests need no inertia.",
        "The slopes on the approach would agree with an inertia of sway and yaw of "
        f"my' = {m[0, 0]:.3f}, mz' = {m[1, 1]:.4f} (Y' by rdot' {m[0, 1]:.3f}, N' by vdot' {m[1, 0]:.3f}).",
    ]


def tables(told: Coefficients) -> dict[str, list[Row]]:
    """All tables of a report.

    Args:
        told: The coefficients.

    Returns:
        Heading -> rows.
    """
    made = {"Coefficients": _coefficient_rows(told.rows), "Known only together": _group_rows(told.groups)}
    made["What follows from them"] = _derived_rows(told.derived)
    if told.beside is not None:
        made["Recordings beside captive tests"] = _compared_rows(told.beside.rows)
    return made


def coefficients_json(told: Coefficients) -> dict[str, Any]:
    """What ``coefficients.json`` holds.

    Args:
        told: The coefficients.

    Returns:
        Plain numbers and strings.
    """
    fields: Mapping[str, Any] = {
        "ship": told.ship.name,
        "particulars": {k: getattr(told.ship, k) for k in ("length", "draught", "speed", "rho", "rpm")},
        "system": SYSTEMS[told.fitted.form],
        "summary": sentence(told),
        "birge_ratio": told.ratio,
        "notes": notes(told),
        "coefficients": [
            {
                "symbol": r.symbol, "value": r.value, "standard_error": r.error, "interval_95": [r.low, r.high],
                "prior": r.prior, "prior_standard_deviation": r.prior_error, "factor": r.factor, "learnt": r.learnt,
                "word": r.word,
            }
            for r in told.rows
        ],
        "groups": [
            {"symbols": list(g.symbols), "correlation": g.correlation, "words": g.words, "determined": g.determined,
             "value": g.value, "standard_error": g.error}
            for g in told.groups
        ],
        "derived": [
            {
                "name": d.name, "value": _number(d.value), "interval_95": [_number(d.low), _number(d.high)],
                "words": d.words,
            }
            for d in told.derived
        ],
        "fitted": told.fitted.as_dict(),
    }  # fmt: skip
    return {**fields, "captive": _captive_json(told.beside)} if told.beside is not None else dict(fields)


def _captive_json(beside: Beside) -> dict[str, Any]:
    """The comparison."""
    rows = [
        {"name": r.name, "recordings": r.free, "recordings_error": r.free_error, "captive": r.towed,
         "captive_error": r.towed_error, "apart": r.apart if r.known else None, "word": r.word}
        for r in beside.rows
    ]  # fmt: skip
    return {
        "tests": beside.tests.note, "rows": rows, "fitted": beside.fitted.as_dict(),
        "agreeing_inertia": beside.inertia.tolist(),
    }  # fmt: skip


def _number(value: float) -> float | None:
    """None where there is no number: JSON has no NaN."""
    return None if np.isnan(value) else float(value)
