"""What a diagnosis found, written down and sailed with: a formula and a network too."""

from pathlib import Path

import torch
import yaml
from fleet import ship_named

from manoeuvre_nn.commands.diagnosis_setup import found_effects, write_effects
from manoeuvre_nn.core.effect import Situation
from manoeuvre_nn.diagnosis.result import Cause, Diagnosis, Value
from manoeuvre_nn.effect.formula import Formula
from manoeuvre_nn.effect.remainder import Remainder

CONF = Path(__file__).parents[2] / "conf" / "effect"
SHELF = {path.stem: yaml.safe_load(path.read_text()) for path in CONF.glob("*.yaml")}
TERMS = ("Y r|r| cos 2psi", "rudder to port")
SHIP = ship_named("mariner")


def situation() -> Situation:
    nu = torch.tensor([[6.0, -0.8, 0.008]], dtype=torch.float64)
    one = torch.ones(1, dtype=torch.float64)
    return Situation(nu, 0 * nu, one, one, 0.7 * one, -0.3 * one, one, 50 * one)


def diagnosis(**more) -> Diagnosis:
    values = tuple(Value(t, w, 0.01, "kN") for t, w in zip(TERMS, (812.0, -507.0), strict=True))
    weights = {"w1": 0.4, "w2": -0.25}
    cause = Cause("unknown", "something", 0.9, 30.0, ("Y",), values, None, "It is real.", "", TERMS, weights)
    given = {"model": ["unknown"], **more}
    rest = {"alias": {}, "sites": {}, "statements": [], "residuals": [], "checks": [], "runner_up": []}
    rest |= {"proofs": [], "noise": {}, "next_steps": [], "undecided": []}
    return Diagnosis("c", "Mariner", "mismatch", "Unknown.", [cause], **given, **rest)


def test_a_formula_is_written_and_acts_as_it_was_found(tmp_path):
    found = found_effects(diagnosis(), [], SHELF)
    write_effects(found, "Unknown.", tmp_path / "effects.yaml")
    read = yaml.safe_load((tmp_path / "effects.yaml").read_text())
    effect, true = Formula(SHIP, **read["formula"]), Formula(SHIP, TERMS, w1=0.4, w2=-0.25)
    s = situation()
    assert list(read) == ["format", "formula"] and effect.terms == TERMS
    assert torch.equal(effect.acceleration(s, s.nu[..., :0]), true.acceleration(s, s.nu[..., :0]))


def test_a_network_on_top_is_written_with_its_weights():
    weights = {p.name: 0.01 * k for k, p in enumerate(Remainder.declared)}
    found = found_effects(diagnosis(network=weights), [], SHELF)
    effect = Remainder(SHIP, **found["remainder"])
    assert list(found) == ["formula", "remainder"] and effect.values.tolist() == list(weights.values())


def test_nothing_is_written_for_what_has_no_formula():
    assert found_effects(diagnosis(model=[]), [], SHELF) == {}
