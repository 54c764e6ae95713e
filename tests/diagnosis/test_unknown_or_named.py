"""Where something unknown and effects with names contend: held-out runs, free runs and the coefficients settle it."""

from unittest.mock import Mock

import numpy as np
import pytest
from pytest import approx
from searches import fitted
from trials import CALM

from manoeuvre_nn.diagnosis import claims as proving
from manoeuvre_nn.diagnosis.decision import Decision
from manoeuvre_nn.diagnosis.predictive import REPAIRED_SAILS
from manoeuvre_nn.diagnosis.result import RIGHT_SHIP, Check
from manoeuvre_nn.diagnosis.search import SearchResult

pytestmark = pytest.mark.usefixtures("unchecked_types")
FORMULA = Mock(names=("formula",), evidence=20.0, random={})


@pytest.mark.parametrize(
    "lead, gain, formula, claims, share",
    [
        (9.0, 10.0, -30.0, ["current", "formula"], 1 / (1 + np.exp(-1.0))),
        (9.0, 8.0, -30.0, ["formula"], None),  # calm water, which foretells as much as no rule does
        (9.0, 30.0, 25.0, ["formula"], None),  # the formula holds there as well
        (0.0, 50.0, -30.0, ["formula"], None),  # it was not likelier in the fitted runs: nothing is settled there
    ],
)
def test_a_name_that_the_unknown_leads_is_claimed_where_held_out_runs_make_up_for_it(
    lead, gain, formula, claims, share
):
    effects = {"current": 0.01, "log_scale": 0.002}
    d = Decision(True, True, 0.0, 0.988, effects, fitted(9.0, "current"), {}, 20.0, [FORMULA], FORMULA, lead)
    settled = d.with_held_out(gain, formula)
    assert [j.names[0] for j in settled.claims] == claims
    assert (settled.effects["current"], settled.unknown) == (
        approx((0.01, 0.988)) if share is None else approx((0.998 * share, 0.998 * (1 - share)))
    )
    assert settled.effects["log_scale"] == 0.002


@pytest.mark.parametrize("formula, gain, claimed", [
    (-8.0, 1.5, True), (-8.0, 0.5, False),  # it leads by 9; 8 of that are lost with the formula
    (-30.0, -5.5, True), (-30.0, -6.5, False),  # without its formula it is 15 less likely
    (3.0, 12.5, True), (3.0, 11.5, False),
])  # fmt: skip
def test_a_lead_by_a_formula_is_what_the_formula_leaves_of_it_in_held_out_runs(formula, gain, claimed):
    d = Decision(
        True, True, 0.0, 0.988, {"current": 0.01}, fitted(9.0, "current"), {}, 20.0, [FORMULA], FORMULA, 9.0, 5.0
    )
    assert (len(d.with_held_out(gain, formula).claims) == 2) is claimed


@pytest.mark.parametrize(
    "right_ship, sails, strange, claims",
    [(True, True, False, ()), (False, True, True, ("formula",)), (True, False, True, ("log_scale", "formula"))],
)
def test_calm_water_with_another_ships_coefficients_is_something_unknown(
    monkeypatch, right_ship, sails, strange, claims
):
    scale, none = fitted(4.0, "log_scale"), fitted(0.0)
    nothing = Decision(False, False, 0.8, 0.1, {"log_scale": 0.1}, scale, {}, formula=FORMULA)
    put = []
    monkeypatch.setattr(proving, "decide", lambda tried: nothing)
    monkeypatch.setattr(proving, "right_ship_check", lambda *_: Check(RIGHT_SHIP, right_ship, ""))
    monkeypatch.setattr(proving, "calm_check", lambda *_: Check("calm water", sails, ""))
    monkeypatch.setattr(proving, "_proved", lambda q, tried, some, ship: (put.append(some), (none, [], []))[1])
    verdict, (chosen, _, checks) = proving.decided(
        Mock(dynamics=CALM, held_out_evidence={}), SearchResult(none, [scale], Mock())
    )
    assert verdict.mismatch(chosen) is strange and [c.passed for c in checks] == [right_ship, sails]
    assert tuple(name for claim in put[-1] for name in claim.names) == claims


@pytest.mark.parametrize("proved, sails, unknown", [(True, True, 0.27), (True, False, 0.99), (False, True, 0.99)])
def test_a_name_that_held_out_runs_favour_but_fails_the_proof_leaves_the_unknown_as_likely_as_it_was(
    monkeypatch, proved, sails, unknown
):
    """So does one with which free runs of held-out manoeuvres miss by more than is unknown."""
    scale, none = fitted(9.0, "log_scale"), fitted(0.0)
    led = Decision(True, True, 0.0, 0.99, {"log_scale": 0.0}, scale, {}, 20.0, [FORMULA], FORMULA, 9.0)
    there = {(): -50.0, ("log_scale",): -40.0, ("formula",): -80.0}
    monkeypatch.setattr(proving, "decide", lambda tried: led)
    monkeypatch.setattr(proving, "right_ship_check", lambda *_: Check(RIGHT_SHIP, True, ""))
    monkeypatch.setattr(proving, "_as_put_to_proof", lambda question, tried, j: (None, j))
    monkeypatch.setattr(proving, "in_held_out_runs", lambda q, j, known: Mock(evidence=there[tuple(j.names)]))
    told = [Check(REPAIRED_SAILS, sails, "")]
    monkeypatch.setattr(proving, "_proved", lambda q, tried, some, ship: (some[0] if proved else FORMULA, [], told))
    verdict, (chosen, _, _) = proving.decided(
        Mock(dynamics=CALM, held_out_evidence={}), SearchResult(none, [scale], Mock())
    )
    assert chosen is (scale if proved and sails else FORMULA) and verdict.unknown == approx(unknown, abs=0.005)


def test_what_a_fitted_model_lacks_is_claimed_as_it_is_decided(monkeypatch):
    """Not asked is whether this is the ship, whether calm water sails the runs, or what held-out ones say."""
    led = Decision(
        True, True, 0.0, 0.99, {"log_scale": 0.0}, fitted(9.0, "log_scale"), {}, 20.0, [FORMULA], FORMULA, 9.0
    )
    monkeypatch.setattr(proving, "decide", lambda tried: led)
    monkeypatch.setattr(proving, "is_fitted", lambda dynamics: True)
    for asked in ("right_ship_check", "calm_check", "in_held_out_runs"):
        monkeypatch.setattr(proving, asked, Mock(side_effect=AssertionError(asked)))
    monkeypatch.setattr(proving, "_proved", lambda q, tried, some: (list(some), [], []))
    verdict, (claims, *_) = proving.decided(Mock(), SearchResult(fitted(0.0), [], Mock()))
    assert verdict is led and claims == [FORMULA]


@pytest.mark.parametrize("there, named", [(-1.0, True), (-9.0, False)])
def test_a_name_that_is_not_proved_is_left_open_unless_all_runs_together_make_calm_water_likelier(
    monkeypatch, there, named
):
    scale, none = fitted(4.0, "log_scale"), fitted(0.0)
    best = Decision(True, False, 0.1, 0.0, {"log_scale": 0.9}, scale, {}, claims=[scale])
    monkeypatch.setattr(proving, "decide", lambda tried: best)
    for check in ("right_ship_check", "calm_check"):
        monkeypatch.setattr(proving, check, lambda *_: Check(RIGHT_SHIP, True, ""))
    monkeypatch.setattr(proving, "_proved", lambda q, tried, some, ship: (none, [], []))
    monkeypatch.setattr(proving, "_as_put_to_proof", lambda question, tried, j: (None, j))
    monkeypatch.setattr(proving, "in_held_out_runs", lambda q, j, known: Mock(evidence=there if j.names else 0.0))
    verdict, (chosen, _, _) = proving.decided(
        Mock(dynamics=CALM, held_out_evidence={}), SearchResult(none, [scale], Mock())
    )
    assert chosen is none and verdict.named is named and (verdict.effects["log_scale"] < 0.5) is not named


@pytest.mark.parametrize(
    "without_rule, there, name, strange",
    [
        (3.0, -56.0, False, False),  # the formula is all that speaks for it, and other runs refute it
        (3.0, -56.0, True, False),  # a name that was likelier than calm water is asked in its place
        (3.0, -54.0, False, True),  # less is no refutation
        (7.5, -56.0, False, True),  # a force without a rule is likelier than calm water, too
    ],
)
def test_something_unknown_that_rests_on_a_formula_falls_with_it(monkeypatch, without_rule, there, name, strange):
    scale, none = fitted(9.0, "log_scale"), fitted(0.0)
    evidence = {(): -50.0, ("formula",): there}
    led = Decision(
        name, True, 0.1, 0.8, {"log_scale": 0.1}, scale, {}, 8.0, [FORMULA], FORMULA, without_rule=without_rule
    )
    monkeypatch.setattr(proving, "decide", lambda tried: led)
    monkeypatch.setattr(proving, "_as_put_to_proof", lambda question, tried, j: (None, j))
    monkeypatch.setattr(proving, "in_held_out_runs", lambda q, j, known: Mock(evidence=evidence[tuple(j.names)]))
    for check in ("right_ship_check", "calm_check"):
        monkeypatch.setattr(proving, check, lambda *_: Check(RIGHT_SHIP, True, ""))
    monkeypatch.setattr(
        proving, "_proved", lambda q, tried, some, ship: (scale if list(some) == [scale] else none, [], [])
    )
    verdict, (chosen, *_) = proving.decided(
        Mock(dynamics=CALM, held_out_evidence={}), SearchResult(none, [scale], Mock())
    )
    assert chosen is (scale if name else none) and verdict.mismatch(chosen) is (strange or name)
    assert verdict.unknown == approx(0.8 if strange else 0.8 * np.exp(-5.0) / (0.2 + 0.8 * np.exp(-5.0)))
