"""From recordings to a named cause and a better prediction, and from clean recordings to nothing."""

from functools import cache

import numpy as np
import pytest
from pytest import approx
from trials import CALM, NOISE, SHIP, run_of, sailed

from manoeuvre_nn.core.manoeuvre import Manoeuvre, Stage
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.diagnosis.case import Case, Question
from manoeuvre_nn.diagnosis.diagnose import diagnose
from manoeuvre_nn.diagnosis.result import Diagnosis
from manoeuvre_nn.effect.current import Current
from manoeuvre_nn.effect.formula import Formula
from manoeuvre_nn.effect.propulsion import HullFouling
from manoeuvre_nn.effect.rudder import RudderOffset
from manoeuvre_nn.effect.sensors import HeadingBias, LogScale
from manoeuvre_nn.effect.wind import SteadyWind

pytestmark = pytest.mark.usefixtures("unchecked_types")
CANDIDATES = [kind(SHIP) for kind in (Current, SteadyWind, RudderOffset, HullFouling, HeadingBias, LogScale)]


def trial(name: str, *stages: tuple[float, float | None]) -> Manoeuvre:
    """Straight for 40 s, then turns by the clock."""
    orders = ((0.0, 40.0), *stages)
    return Manoeuvre(name, "random_rudder", tuple(Stage(a * DEGREE, hold=t) for a, t in orders), duration=180.0)


TRIALS = [
    trial("starboard", (25.0, None)),
    trial("port", (-15.0, None)),
    trial("weave", (20.0, 30.0), (-20.0, 60.0), (20.0, None)),
    trial("held out", (-20.0, 50.0), (20.0, None)),
]


STRANGE = ("Y |v||r|", "N r|r| cos psi")
TRUE = {
    "current": Current(SHIP, speed=0.7, toward_deg=200.0),
    "offset": RudderOffset(SHIP, offset_deg=2.0),
    "strange": Formula(SHIP, STRANGE, w1=1.5, w2=0.5),
}


@cache
def diagnosis(*acting: str, remainder: bool = False) -> Diagnosis:
    records = sailed(TRIALS, [TRUE[a] for a in acting])
    *fitted, last = (run_of(r, NOISE, seed) for seed, r in enumerate(records, start=20))
    case = Case("trial", "mariner", (*fitted, last), SHIP, frozenset({last.name}))
    return diagnose(Question(case, CALM, CANDIDATES, remainder=remainder))


def probability(d: Diagnosis, name: str) -> float:
    return next(c.probability for c in d.causes if c.name == name)


def test_a_current_is_named_with_its_speed_and_direction():
    d = diagnosis("current")
    assert (d.verdict, d.model, d.causes[0].name) == ("mismatch", ["current"], "current")
    assert probability(d, "current") > 0.9
    found = {v.name: v for v in d.causes[0].parameters}
    assert abs(found["speed"].value - 0.7) < 4 * found["speed"].error < 0.1
    assert abs(found["toward_deg"].value - 200.0) < 4 * found["toward_deg"].error < 8.0
    assert "a current" in d.sentence


def test_with_the_current_the_run_that_was_not_used_is_predicted_to_the_noise():
    d = diagnosis("current")
    before, after = d.rmse("before"), d.rmse("after")
    assert after["pos"] < 0.1 * before["pos"] and after["v"] < 0.5 * before["v"]
    assert after["psi"] < 0.5 and after["u_log"] < 1.2 * NOISE[6]
    assert {c.name: c.passed for c in d.checks}["held-out gain"]
    (proof,) = d.proofs
    assert proof.run == "held out" and len(proof.after) == len(proof.before) == len(proof.recorded)


def test_clean_recordings_end_with_nothing():
    d = diagnosis()
    assert (d.verdict, d.model) == ("none", [])
    assert all(probability(d, e.name) < 0.5 for e in CANDIDATES) and probability(d, "unknown") < 0.5
    assert d.rmse("before") == approx(d.rmse("after"))
    assert all(r.windows == [] for r in d.residuals)


def test_two_effects_at_once_are_both_named():
    d = diagnosis("current", "offset")
    assert set(d.model) == {"current", "rudder_offset"}
    assert d.rmse("after")["pos"] < 0.2 * d.rmse("before")["pos"]
    offset = next(c for c in d.causes if c.name == "rudder_offset").parameters[0]
    assert abs(offset.value - 2.0) < 4 * offset.error < 1.5


def test_probabilities_and_noise_are_numbers_that_can_be_shown():
    d = diagnosis("current")
    assert [c.probability for c in d.causes[1:]] == sorted((c.probability for c in d.causes[1:]), reverse=True)
    assert all(0 <= c.probability <= 1 and np.isfinite(c.evidence) for c in d.causes)
    assert d.noise["pos"] == approx(np.hypot(*NOISE[:2]), rel=0.2) and d.noise["psi"] == approx(0.1, rel=0.2)
    assert {r.run for r in d.residuals} == {"starboard", "port", "weave"} == set(d.tracks)


def test_a_force_without_a_name_is_unknown_and_its_formula_predicts_the_run_that_was_not_used():
    d = diagnosis("strange")
    assert (d.verdict, d.model, d.unknown) == ("mismatch", ["unknown"], True)
    cause = d.causes[0]
    assert cause.name == "unknown" and cause.terms[0] in STRANGE and set(cause.terms) >= set(STRANGE)
    assert set(cause.equations) <= {"Y", "N"}
    weights = {t: v for t, v in zip(cause.terms, cause.parameters, strict=True)}
    assert abs(weights["Y |v||r|"].value - 1.5) < 4 * weights["Y |v||r|"].error + 0.05
    assert d.rmse("before")["pos"] > 3 * d.noise["pos"] and d.rmse("after")["pos"] < 1.2 * d.noise["pos"]


@pytest.mark.parametrize("acting", [(), ("current",)])
def test_a_network_is_not_taken_where_physics_reaches_the_noise(acting):
    d = diagnosis(*acting, remainder=True)
    assert d.network == {} and d.model == list(acting)
