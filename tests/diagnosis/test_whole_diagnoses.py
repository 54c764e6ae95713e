"""From recordings to a named cause and a better prediction, and from clean recordings to nothing."""

from collections.abc import Sequence
from functools import cache
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest
import torch
from fleet import unchecked
from pytest import approx
from tiers import mainly
from trials import CALM, NOISE, SHIP, run_of

from manoeuvre_nn.commands.diagnose import summary
from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.core.manoeuvre import Manoeuvre, Stage
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.diagnosis import claims as under_test
from manoeuvre_nn.diagnosis.answers import answer
from manoeuvre_nn.diagnosis.case import Case, Question
from manoeuvre_nn.diagnosis.diagnose import diagnose
from manoeuvre_nn.diagnosis.predictive import REPAIRED_SAILS
from manoeuvre_nn.diagnosis.result import Diagnosis
from manoeuvre_nn.dynamics.base import Model
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.effect.common import typical
from manoeuvre_nn.effect.current import Current
from manoeuvre_nn.effect.depth import ShallowWater
from manoeuvre_nn.effect.formula import Formula
from manoeuvre_nn.effect.loading import DisplacementChange
from manoeuvre_nn.effect.local import SideForce
from manoeuvre_nn.effect.rudder import RudderOffset
from manoeuvre_nn.effect.sensors import HeadingBias, LogScale
from manoeuvre_nn.estimation.corrections import Calibrated, Corrections
from manoeuvre_nn.report.diagnosis_tables import verdict_text
from manoeuvre_nn.report.views import Answer

pytestmark = pytest.mark.usefixtures("unchecked_types", "few_draws")
CANDIDATES = [kind(SHIP) for kind in (Current, RudderOffset)]
FEW = [kind(SHIP) for kind in (Current, RudderOffset, LogScale, HeadingBias)]
"""Where what is asked is not which of many it is."""
OF_THE_HULL = [kind(SHIP) for kind in (ShallowWater, DisplacementChange)]


def trial(name: str, *stages: tuple[float, float | None]) -> Manoeuvre:
    """Straight for 40 s, then turns by the clock."""
    orders = ((0.0, 40.0), *stages)
    return Manoeuvre(name, "random_rudder", tuple(Stage(a * DEGREE, hold=t) for a, t in orders), duration=180.0)


TRIALS = [
    trial("starboard", (25.0, None)),
    trial("weave", (20.0, 30.0), (-20.0, 60.0), (20.0, None)),
    trial("held out", (-20.0, 50.0), (20.0, None)),
]
IN_FULL = [TRIALS[0], trial("port", (-15.0, None)), *TRIALS[1:]]
"""What tells terms of a formula apart that are much alike."""
STEP, LONG_STEP = 2.0, 4.0
"""Between samples [s], the second where something acts; noise is such that they tell as much as at one every second."""
SAMPLED = NOISE / LONG_STEP**0.5
STRANGE = ("Y |v||r|", "N r|r| cos psi")
DEPTH = 1.4 * SHIP.particulars.draught
TRUE = {
    "current": Current(SHIP, speed=0.7, toward_deg=200.0),
    "offset": RudderOffset(SHIP, offset_deg=2.0),
    "log": LogScale(SHIP, factor=1.1),
    "strange": Formula(SHIP, STRANGE, w1=1.5, w2=0.5),
    "depth": ShallowWater(SHIP, depth_m=DEPTH),
}


def sail(trials: Sequence[Manoeuvre], *effects: Effect, ship: Model = CALM, step: float = STEP) -> list[Recording]:
    """What happened."""
    with unchecked():
        return roll_out(Vessel(ship, effects), list(trials), step=min(step, STEP), interval=step)


def asked(name: str, records: Sequence[Recording], seed: int, effects: Sequence[Effect], **more) -> Question:
    """With noise; the last one is held out."""
    noise = NOISE / (records[0].time[1] - records[0].time[0]) ** 0.5
    made = tuple(run_of(r, noise, k) for k, r in enumerate(records, start=seed))
    return Question(Case(name, "mariner", made, SHIP, 40.0, frozenset({made[-1].name})), CALM, effects, **more)


@cache
def diagnosis(*acting: str, remainder: bool = False, weaker: float = 0.0) -> Diagnosis:
    """Of runs of a ship whose rudder is so much weaker than published, with these effects."""
    shares = [-weaker if name in ("Yd", "Nd") else 0.0 for name in Corrections(CALM).names]
    ship = Calibrated(CALM, torch.tensor(shares, dtype=torch.float64)) if weaker else CALM
    trials, step = (IN_FULL, 1.0) if "strange" in acting else (TRIALS, LONG_STEP if "current" in acting else STEP)
    records = sail(trials, *(TRUE[a] for a in acting), ship=ship, step=step)
    candidates = OF_THE_HULL if "depth" in acting else (FEW if weaker or len(acting) > 1 else CANDIDATES)
    return diagnose(asked("trial", records, 20, candidates, remainder=remainder))


def with_a_network_to_try(*acting: str) -> Diagnosis:
    """One diagnosis for many tests: a network that is not taken changes nothing but that this is said."""
    return diagnosis(*acting, remainder=True)


def probability(d: Diagnosis, name: str) -> float:
    return next(c.probability for c in d.causes if c.name == name)


def test_a_current_is_named_with_its_speed_and_direction():
    d = with_a_network_to_try("current")
    assert (d.verdict, d.model, d.causes[0].name) == ("mismatch", ["current"], "current")
    (sails,) = [c for c in d.checks if c.name == REPAIRED_SAILS]
    over_noise = max(error / d.noise[c] for c, error in d.rmse("after").items() if error / d.noise[c] > 0)
    assert sails.passed and f"RMS errors are up to {over_noise:.2g} times the measurement noise" in sails.text
    assert not any("RMS errors" in c.text for c in d.checks if c is not sails)
    assert probability(d, "current") > 0.9
    found = {v.name: v for v in d.causes[0].parameters}
    assert abs(found["speed"].value - 0.7) < 4 * found["speed"].error < 0.1
    assert abs(found["toward_deg"].value - 200.0) < 4 * found["toward_deg"].error < 8.0
    assert "a current" in d.sentence


def test_with_the_current_the_run_that_was_not_used_is_predicted_to_the_noise():
    d = with_a_network_to_try("current")
    before, after = d.rmse("before"), d.rmse("after")
    assert after["pos"] < 0.1 * before["pos"] and after["v"] < 0.5 * before["v"]
    assert after["psi"] < 0.5 and after["u_log"] < 1.2 * SAMPLED[6]
    assert {c.name: c.passed for c in d.checks}["held-out gain"]
    (proof,) = d.proofs
    assert proof.run == "held out" and len(proof.after) == len(proof.before) == len(proof.recorded)


@pytest.mark.slow  # what the model itself sailed ends with nothing in test_calm_water_checked.py
def test_clean_recordings_end_with_nothing():
    d = with_a_network_to_try()
    assert (d.verdict, d.model) == ("none", [])
    assert all(probability(d, e.name) < 0.5 for e in CANDIDATES) and probability(d, "unknown") < 0.5
    assert d.rmse("before") == approx(d.rmse("after"))
    assert all(r.windows == [] for r in d.residuals)


@pytest.mark.slow
def test_what_effects_gain_alone_is_told_from_what_corrected_coefficients_gain():
    """A current, and a rudder that is 8 % weaker than published."""
    d = diagnosis("current", weaker=0.08)
    before, alone, after = (d.rmse(when)["pos"] for when in ("before", "alone", "after"))
    assert d.model == ["current"] and before > 1.5 * alone > 3 * after
    assert f"({alone:.3g} m with published coefficients)" in d.sentence


@pytest.mark.slow
def test_an_event_that_no_held_out_run_had_is_named_by_the_run_that_had_it():
    """What it predicts of other runs is calm water, which neither proves nor refutes it."""
    push = SideForce(SHIP, force_kN=250.0, lever_m=20.0, start_s=70.0, end_s=140.0)
    records = sail(TRIALS[:1], push, step=LONG_STEP) + sail(TRIALS[1:], step=LONG_STEP)
    d = diagnose(asked("pushed once", records, 50, [SideForce(SHIP), RudderOffset(SHIP)]))
    assert (d.verdict, d.model) == ("mismatch", ["side_force"]) and probability(d, "side_force") > 0.9
    intervals = d.causes[0].intervals
    assert intervals is not None and [len(intervals[r.name]) for r in records] == [1, 0, 0]
    assert "no run that was not used had it" in d.sentence
    (check,) = (c for c in d.checks if c.name == "held-out gain")
    assert check.passed and "did not act in a held-out run: not proved" in check.text


@pytest.mark.slow  # claims are put to the proof in test_claims_put_to_proof.py
def test_a_claim_that_runs_which_were_not_used_do_not_bear_out_is_in_no_headline():
    """A current in the fitted runs alone: the search is sure of it, and the held-out run had none."""
    records = sail(TRIALS[:-1], TRUE["current"], step=LONG_STEP) + sail(TRIALS[-1:], step=LONG_STEP)
    d = diagnose(asked("gone", records, 70, [Current(SHIP)]))
    refused = [c.text for c in d.checks if c.name == "held-out gain" and not c.passed]
    assert any("a current" in text for text in refused) and "current" not in d.model
    found = next(c for c in d.causes if c.name == "current")
    assert found.evidence > 50 and found.probability < 0.5
    for said in (d.sentence, verdict_text(d), summary(d, CALM), Answer(d).summary, answer(d)["sentence"]):
        assert "current" not in said


def test_where_nothing_is_missing_corrected_coefficients_predict():
    d = diagnosis(weaker=0.06)
    assert (d.verdict, d.model) == ("none", []) and d.repaired
    assert d.rmse("after")["pos"] < 0.5 * d.rmse("before")["pos"] and np.isnan(d.rmse("alone").get("pos", np.nan))
    assert "coefficients corrected within their scatter" in d.sentence


@pytest.mark.slow
def test_three_effects_at_once_are_all_named_with_their_values():
    d = diagnosis("current", "offset", "log")
    assert set(d.model) == {"current", "rudder_offset", "log_scale"}
    found = {v.name: v for c in d.causes if c.name in d.model for v in c.parameters}
    for name, true in {"speed": 0.7, "toward_deg": 200.0, "offset_deg": 2.0, "factor": 1.1}.items():
        assert abs(found[name].value - true) < 4 * found[name].error


@pytest.mark.parametrize("fitted, held_out, helps", [(7.0, 3.0, True), (7.0, -3.0, False), (4.0, 1.0, False)])
def test_the_last_of_two_effects_must_add_six_in_fitted_and_held_out_runs_together(
    monkeypatch, fitted, held_out, helps
):
    still = {"hypothesis": SimpleNamespace(effects=()), "random": {}}  # nothing of it gusts
    one, two = (SimpleNamespace(names=names, evidence=20.0, **still) for names in (("current",), ("current", "wind")))
    two.evidence += fitted
    monkeypatch.setattr(under_test, "in_held_out_runs", lambda question, j, known: SimpleNamespace(evidence=5.0))
    monkeypatch.setattr(under_test, "_as_put_to_proof", lambda question, tried, j: (None, j))
    assert under_test._last_effect_helps(Mock(held_out_evidence={}), Mock(), two, 5.0 + held_out, [two, one]) is helps
    assert under_test._last_effect_helps(Mock(held_out_evidence={}), Mock(), one, 5.0, [two, one])


@pytest.mark.slow  # three at once, below, take the same way
def test_two_effects_at_once_are_both_named():
    d = diagnosis("current", "offset")
    assert set(d.model) == {"current", "rudder_offset"}
    assert d.rmse("after")["pos"] < 0.2 * d.rmse("before")["pos"]
    offset = next(c for c in d.causes if c.name == "rudder_offset").parameters[0]
    assert abs(offset.value - 2.0) < 4 * offset.error < 1.5


def test_probabilities_and_noise_are_numbers_that_can_be_shown():
    d = with_a_network_to_try("current")
    assert [c.probability for c in d.causes[1:]] == sorted((c.probability for c in d.causes[1:]), reverse=True)
    assert all(0 <= c.probability <= 1 and np.isfinite(c.evidence) for c in d.causes)
    assert d.noise["pos"] == approx(np.hypot(*SAMPLED[:2]), rel=0.2)
    assert d.noise["psi"] == approx(SAMPLED[4] / DEGREE, rel=0.2)
    assert {r.run for r in d.residuals} == {"starboard", "weave"} == set(d.tracks)


@pytest.mark.slow  # a nature is found in test_natures.py, a formula in test_short_formulas.py
def test_a_force_without_a_name_is_unknown_and_its_formula_predicts_the_run_that_was_not_used():
    d = diagnosis("strange")
    assert (d.verdict, d.model, d.unknown) == ("mismatch", ["unknown"], True)
    cause = d.causes[0]
    assert cause.name == "unknown" and cause.terms[0] in STRANGE and set(cause.terms) >= set(STRANGE)
    assert set(cause.equations) <= {"Y", "N"}
    found = next(v for v in cause.parameters if v.name == "Y |v||r|")
    weight = cause.weights[f"w{cause.terms.index(found.name) + 1}"]
    assert abs(weight - 1.5) < 4 * weight * found.error / found.value + 0.05
    # A weight of one is the force of 20 deg of rudder: on the approach, Y_d 20 deg.
    of_rudder = SHIP.force_from_acceleration(typical(SHIP))[1] * SHIP.prime.force / 1e3
    assert found.unit == "kN" and found.value == approx(weight * float(of_rudder), rel=0.1)
    assert f"{found.value:.3g} kN |v||r|" in d.sentence
    assert d.rmse("before")["pos"] > 3 * d.noise["pos"] and d.rmse("after")["pos"] < 1.2 * d.noise["pos"]


@pytest.mark.parametrize("acting", mainly(1, [["current"], []]))
def test_a_network_is_not_taken_where_physics_reaches_the_noise(acting):
    d = with_a_network_to_try(*acting)
    assert d.network == {} and d.model == list(acting)


@pytest.mark.slow
def test_a_depth_is_named_and_measured_although_coefficients_are_off():
    """Depth changes all that the coefficients change: they must not take its share."""
    d = diagnosis("depth", weaker=0.06)
    assert (d.verdict, d.model) == ("mismatch", ["shallow_water"])
    (found,) = (v for v in d.causes[0].parameters if v.name == "depth_m")
    assert abs(found.value - DEPTH) < 2.5 * found.error < 0.25 * DEPTH
    before, alone, after = (d.rmse(when)["pos"] for when in ("before", "alone", "after"))
    assert alone < 0.5 * before and after < 0.2 * before
