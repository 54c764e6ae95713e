"""Coefficients in tables, sentences and JSON."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd

from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.estimation.agreement import Agreement
from manoeuvre_nn.estimation.captive_fit import Towed, agreeing_inertia, compare
from manoeuvre_nn.estimation.coefficients import (
    MAX_CORRELATION,
    MEASURED,
    OWN,
    PARTLY,
    PLAIN,
    PRIOR,
    REACH,
    TAYLOR,
    TOGETHER,
    Fitted,
    coefficient_table,
)
from manoeuvre_nn.estimation.collinear import MIN_CORRELATION, collinear_groups
from manoeuvre_nn.report.tables import Row

SYSTEMS = {
    TAYLOR: "derivatives about the approach over 0.5 rho L T U0^2 (N: times L), as in Y_vvv v^3/6; velocities over U0",
    PLAIN: "factors of products over 0.5 rho L T U0^2 (N: times L); velocities over U0, n over the nominal one",
    OWN: "coefficients of the ship's own source, BIS system",
}
"""What the numbers are."""
GROUPS = "Known better together than by themselves"
"""Heading of the groups of coefficients whose errors go together."""
SURE = 1.64
"""Standard deviations that chance exceeds once in twenty times."""
NO_MATTER = 0.1
"""What a ratio may be above 1 in any case: errors that are a twentieth too small."""
ONLY_RATIOS = "Free runs show forces over inertia only: all values hold for the inertia that was taken as known."


@dataclass(frozen=True)
class Coefficients:
    """All that is told of a set of coefficients.

    Attributes:
        ship: The ship.
        fitted: The coefficients.
        derived: What follows from them.
        source: Sentence on what they were fitted to.
        tests: Captive tests to set beside them, where there are any.
        captive: Coefficients from these tests.
        agreement: How far stretches of the recordings disagree over their standard errors, squared; errors are widened
            by the root of its ratio.
    """

    ship: Particulars
    fitted: Fitted
    derived: pd.DataFrame
    source: str = ""
    tests: Towed | None = None
    captive: Fitted | None = None
    agreement: Agreement = Agreement(1.0, 0.0)

    @cached_property
    def rows(self) -> pd.DataFrame:
        """The table of coefficients."""
        return coefficient_table(self.fitted)

    @cached_property
    def groups(self) -> pd.DataFrame:
        """Coefficients whose errors go together; ``sum`` is what is known, with its 95 % interval."""
        groups = collinear_groups(self.fitted)
        known = zip(groups["determined"], groups["value"], groups["error"], strict=True)
        return groups.assign(sum=[f"{what} = {value:.3g} ± {REACH * error:.1g}" for what, value, error in known])

    @cached_property
    def compared(self) -> pd.DataFrame | None:
        """Recordings and captive tests beside each other."""
        return None if self.captive is None else compare(self.fitted, self.captive)


def sentence(told: Coefficients) -> str:
    """The verdict in one sentence: how many are measured by themselves, and how many go together."""
    words = list(told.rows["word"])
    tied_closely = f"only together with others (correlation beyond {MAX_CORRELATION:g})"
    together = f"{words.count(TOGETHER)} {tied_closely}, " if TOGETHER in words else ""
    text = (
        f"{words.count(MEASURED)} of {len(words)} coefficients are measured, {together}{words.count(PARTLY)} partly, "
        f"{words.count(PRIOR)} are what was assumed; the recordings fix {told.fitted.determined:.1f} combinations"
    )
    tied = len({s for symbols in told.groups["symbols"] for s in symbols})
    if not tied:
        return f"{text}."
    groups = f"{len(told.groups)} groups" if len(told.groups) > 1 else "a group"
    return (
        f"{text}. The errors of {tied} of all these coefficients go together in {groups} (correlation beyond "
        f"{MIN_CORRELATION:g}): a sum is known better than each by itself."
    )


def notes(told: Coefficients) -> list[str]:
    """What is to be minded, in sentences."""
    mass = np.diag(told.fitted.inertia)
    side = "port, as the source has it" if told.fitted.form == OWN else "starboard"
    lines = [
        *([told.source] if told.source else []),
        f"Values are {SYSTEMS[told.fitted.form]}; rudder positive to {side}.",
        f"{ONLY_RATIOS} Here mx' = {mass[0]:.4f}, my' = {mass[1]:.4f}, mz' = {mass[2]:.5f}.",
        _error_note(told.agreement),
    ]
    return lines + _captive_notes(told)


def _error_note(told: Agreement) -> str:
    """How far errors can be believed."""
    ratio, degrees = told
    by_chance = SURE * (2 / degrees) ** 0.5 if degrees > 0 else 0.0  # files of before do not say how many
    if ratio <= 1 + max(by_chance, NO_MATTER):
        return "Stretches of the recordings agree on the coefficients within their standard errors."
    return (
        f"Stretches of 10 L/U0 disagree on coefficients by {ratio**0.5:.2g} times their errors, more than by chance: "
        "the products are not quite those of the ship. All errors are widened so far."
    )


def _captive_notes(told: Coefficients) -> list[str]:
    """What a comparison with captive tests can show."""
    if told.tests is None or told.captive is None:
        return []
    m = agreeing_inertia(told.fitted, told.captive)
    return [
        f"Captive: {told.tests.note}. Static tests have no yaw rate: products with r are not compared. "
        "Forces of tests need no inertia.",
        "The slopes on the approach would agree with an inertia of sway and yaw of "
        f"my' = {m[0, 0]:.3f}, mz' = {m[1, 1]:.4f} (Y' by rdot' {m[0, 1]:.3f}, N' by vdot' {m[1, 0]:.3f}).",
    ]


def tables(told: Coefficients) -> dict[str, list[Row]]:
    """All tables of a report: heading -> rows."""
    made: dict[str, list[Row]] = {}
    made["Coefficients"] = [
        {"symbol": r["symbol"], "value": r["value"], "± 95 %": (r["high"] - r["low"]) / 2, "before": r["prior"],
         "± before": REACH * r["prior_error"], "narrowed by [%]": round(100 * r["learnt"]),
         "it is": _word(r["word"], r["with"])}
        for r in told.rows.to_dict("records")
    ]  # fmt: skip
    made[GROUPS] = [
        {
            "together": ", ".join(g["symbols"]),
            "corr.": round(g["correlation"], 3),
            "why": g["words"],
            "known is": g["sum"],
        }
        for g in told.groups.to_dict("records")
    ]
    made["What follows from them"] = [
        {
            "quantity": d["name"],
            "value": d["value"],
            "from": _number(d["low"]),
            "to": _number(d["high"]),
            "that is": d["words"] or None,
        }
        for d in told.derived.to_dict("records")
    ]
    if told.compared is not None:
        made["Recordings beside captive tests"] = [
            {"symbol": r["name"], "recordings": r["free"], "± 95 %": REACH * r["free_error"],
             "captive": r["towed"], "± 95 % ": REACH * r["towed_error"],
             "apart by": round(r["apart"], 1) if r["known"] else None, "they": r["word"]}
            for r in told.compared.to_dict("records")
        ]  # fmt: skip
    return made


def _word(word: str, others: Sequence[str]) -> str:
    """How far a coefficient is measured; with which others if it is only together with them."""
    if word != TOGETHER:
        return word
    more = f" and {len(others) - 1} more" if len(others) > 1 else ""
    return f"{word} with {others[0]}{more}"


def coefficients_json(told: Coefficients) -> dict[str, Any]:
    """What ``coefficients.json`` holds: plain numbers and strings."""
    fields: Mapping[str, Any] = {
        "ship": told.ship.name,
        "particulars": {k: getattr(told.ship, k) for k in ("length", "draught", "speed", "rho", "rpm")},
        "system": SYSTEMS[told.fitted.form],
        "summary": sentence(told),
        "birge_ratio": told.agreement.ratio,
        "birge_degrees": told.agreement.degrees,
        "notes": notes(told),
        "coefficients": [
            {
                "symbol": r["symbol"], "value": r["value"], "standard_error": r["error"],
                "interval_95": [r["low"], r["high"]], "prior": r["prior"], "prior_standard_deviation": r["prior_error"],
                "factor": r["factor"], "learnt": r["learnt"], "word": r["word"],
                "together_with": list(r["with"]),
            }
            for r in told.rows.to_dict("records")
        ],
        "groups": [
            {"symbols": list(g["symbols"]), "correlation": g["correlation"], "words": g["words"],
             "determined": g["determined"], "value": g["value"], "standard_error": g["error"]}
            for g in told.groups.to_dict("records")
        ],
        "derived": [
            {
                "name": d["name"], "value": _number(d["value"]), "interval_95": [_number(d["low"]), _number(d["high"])],
                "words": d["words"],
            }
            for d in told.derived.to_dict("records")
        ],
        "fitted": told.fitted.as_dict(),
    }  # fmt: skip
    return {**fields, **_captive_json(told)}


def _captive_json(told: Coefficients) -> dict[str, Any]:
    """The comparison with captive tests, if there are any."""
    if told.tests is None or told.captive is None or told.compared is None:
        return {}
    rows = [
        {"name": r["name"], "recordings": r["free"], "recordings_error": r["free_error"], "captive": r["towed"],
         "captive_error": r["towed_error"], "apart": _number(r["apart"]), "word": r["word"]}
        for r in told.compared.to_dict("records")
    ]  # fmt: skip
    inertia = agreeing_inertia(told.fitted, told.captive)
    return {"captive": {
        "tests": told.tests.note, "rows": rows, "fitted": told.captive.as_dict(), "agreeing_inertia": inertia.tolist(),
    }}  # fmt: skip


def _number(value: float) -> float | None:
    """None where there is no number: JSON has no NaN."""
    return None if np.isnan(value) else float(value)
