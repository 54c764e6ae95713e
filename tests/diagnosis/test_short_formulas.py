"""Formulas for what has no name: the term that acted is found, its weight too, and clean runs get none."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch
from pytest import approx
from tiers import only
from trials import CALM, CIRCLE, PORT, SHIP, ZIGZAG, runs

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.diagnosis import causes, words
from manoeuvre_nn.diagnosis.formula import _Candidate, short_formula
from manoeuvre_nn.diagnosis.locate import unit_forces
from manoeuvre_nn.diagnosis.result import Cause, Value
from manoeuvre_nn.diagnosis.unknown import unknown_evidence
from manoeuvre_nn.effect.common import typical
from manoeuvre_nn.effect.formula import Formula, is_ordinary, library, mark_of, places_of
from manoeuvre_nn.estimation.data_set import whitened_data_set
from manoeuvre_nn.estimation.effect_columns import own_states
from manoeuvre_nn.estimation.hypothesis import Hypothesis
from manoeuvre_nn.estimation.hypothesis_columns import _apart
from manoeuvre_nn.estimation.marginal_likelihood import MarginalLikelihood
from manoeuvre_nn.ship.known import no_part

pytestmark = pytest.mark.usefixtures("unchecked_types")
WEIGHTS = {"Y |v||r|": 1.2, "N r|r| cos 2psi": 0.6, "X 1 sin psi": 0.8, "rudder to port": -0.3}
WEIGHTS |= {"sensor u_log cos psi": 0.5, "sensor psi cos 2psi": 0.3, "sensor north t^2": 0.4}


def found(*effects: Formula):
    likelihood = MarginalLikelihood(whitened_data_set(CALM, runs([CIRCLE, ZIGZAG, PORT], effects)))
    none = likelihood.evaluate(Hypothesis((), ()))
    return likelihood, none, short_formula(likelihood, none)


@pytest.mark.parametrize("term", only({"Y |v||r|", "sensor u_log cos psi"}, WEIGHTS))
def test_the_term_that_acted_is_found_first_and_its_weight_within_three_standard_errors(term):
    likelihood, none, formula = found(Formula(SHIP, [term], w1=WEIGHTS[term]))
    assert formula is not None and formula.hypothesis.effects[0].terms[0] == term
    weight, error = formula.hypothesis.vector()[0], formula.errors[0]
    assert abs(weight - WEIGHTS[term]) < 3 * error + 0.03 * abs(WEIGHTS[term])
    assert none.evidence + 10 < formula.evidence < likelihood.evaluate(formula.hypothesis).evidence
    assert unknown_evidence(likelihood, none, formula) > formula.evidence - np.log(2) - 0.01


def test_clean_runs_have_no_formula_that_is_worth_its_choice():
    likelihood, none, formula = found()
    assert formula is None or formula.evidence < none.evidence + 1
    assert unknown_evidence(likelihood, none, formula) < none.evidence + 1


def test_a_force_with_one_phase_in_all_runs_has_no_part_with_one_in_each():
    alike = _Candidate(("N cos periodic", "N sin periodic"), ((0.6, 0.8),), {"period_s": 50.0})
    by_run = _Candidate(("Y cos periodic_by_run", "Y sin periodic_by_run"), ((0.6, 0.8), (0.8, 0.6)), alike.scales)
    lag = _Candidate(("N lag r",), scales={"memory_s": 9.0})
    assert lag.beside([by_run]) and by_run.beside([lag]) and alike.beside([lag])
    assert not by_run.beside([lag, alike]) and not alike.beside([by_run])
    assert (alike.numbers, by_run.numbers, lag.numbers) == (1, 4, 1)
    assert (alike.of_run(1), by_run.of_run(1), lag.of_run(1)) == ((0.6, 0.8), (0.8, 0.6), (1.0,))


def test_the_derivative_by_a_period_is_taken_within_a_small_part_of_a_turn():
    """After fifty turns of 12 s, the last phases of the difference quotient are less than half a radian apart."""
    effect = Formula(SHIP, ["N sin periodic"], scales={"period_s": 12.0})
    up, down = _apart(effect.declared[1], 12.0)
    assert 0.001 < 2 * np.pi * 50 * 12.0 * (1 / down - 1 / up) < 0.5


def test_two_terms_are_both_found():
    both = Formula(SHIP, ["Y |v||r|", "sensor u_log cos psi"], w1=1.2, w2=0.5)
    formula = found(both)[2]
    assert formula is not None and set(formula.hypothesis.effects[0].terms) >= set(both.terms)


def test_a_linear_step_of_every_term_is_its_effect_for_a_small_weight():
    place = whitened_data_set(CALM, runs([ZIGZAG])).runs[0]
    s = place.linearised.situation
    for term in library():
        effect = Formula(SHIP, [term])
        memory = own_states(effect, s, 1, 1.0)[0]
        push, errors = effect.unit_of(term, s, memory)
        acting = effect.at(torch.cat([torch.tensor([1e-3], dtype=torch.float64), effect.values[1:]]))
        assert torch.allclose(acting.acceleration(s, memory), 1e-3 * push, rtol=1e-3, atol=1e-12)
        blank = {c: torch.zeros_like(s.psi) for c in ("x", "y", "vn", "ve", "psi", "r", "u_log")}
        for channel, written in acting.record(blank, s).items():
            assert torch.allclose(written, 1e-3 * errors.get(channel, torch.zeros_like(s.psi)))


def test_every_term_says_where_it_acts():
    places = {place for term in library() for place in places_of(term)}
    sensors = {f"sensor:{c}" for c in ("x", "y", "psi", "r", "u_log")}
    assert places == {"X", "Y", "N", "actuator:rudder"} | sensors
    assert len(set(library())) == len(library())


def test_ordinary_terms_are_those_that_port_and_starboard_share():
    """X keeps its sign in the mirror and Y and N change theirs, whatever the heading."""
    s = whitened_data_set(CALM, runs([ZIGZAG])).runs[0].linearised.situation
    flip = torch.tensor([1.0, -1.0, -1.0])
    other = s.with_(nu=s.nu * flip, psi=-s.psi, delta=-s.delta)
    for term in library():
        effect = Formula(SHIP, [term])
        if mark_of(term):
            assert not is_ordinary(term)
            continue
        push, errors = effect.unit_of(term, s)
        shared = not errors and torch.allclose(effect.unit_of(term, other)[0], push * flip, atol=1e-12)
        turns = " psi" in term or "2psi" in term or "3psi" in term
        assert is_ordinary(term) == (shared and not turns and not term.startswith("rudder")), term


def test_a_term_that_is_not_in_the_library_is_told():
    with pytest.raises(InputError, match=r"'N r\^9' is unknown"):
        Formula(SHIP, ["N r^9"])


def test_a_ship_of_which_only_the_inertia_is_known_has_units_for_its_terms_too():
    """Its forces are a network's; without a rudder of its own a term would weigh nothing."""
    bare = no_part(SHIP)
    size = Formula(bare, ["N |v|"]).get_buffer("size")
    own = Formula(SHIP, ["N |v|"]).get_buffer("size")
    assert (size[1:] > 0).all() and torch.allclose(size[1:], own[1:], rtol=0.5)


def test_a_force_that_follows_the_motion_late_has_its_time_constant():
    """``m' = (z - m) / memory_s`` of a step is ``1 - exp(-t / memory_s)``."""
    effect = Formula(SHIP, ["N lag d"], scales={"memory_s": 25.0})
    line = whitened_data_set(CALM, runs([ZIGZAG])).runs[0].linearised
    s, half = line.situation, 0.5 * line.run.step
    stepped = s.with_(delta=torch.where(s.time < 100.0, 0.0, 0.35).double())
    memory = own_states(effect, stepped, 1, line.run.step)[0, :, 0]
    late = (s.time - s.time[s.time >= 100.0][0] + half).clamp(min=0.0)  # the rudder is linear in between samples
    assert torch.allclose(memory, 1 - torch.exp(-late / 25.0), atol=2e-3)


UNITS = {
    "X |d|": "kN", "N r|r| cos psi": "MN m", "Y lag v": "kN", "N r t": "MN m/min", "rudder to port": "deg/deg",
    "sensor psi cos psi": "deg", "sensor psi t^2": "deg/min^2", "sensor r t": "deg/s/min", "sensor u_log |v|": "m/s",
    "sensor north t^2": "m/min^2",
}  # fmt: skip


def test_every_coefficient_of_a_formula_has_a_unit_in_which_it_gives_the_force_or_error_that_acts():
    """In a motion of one tight turn everywhere, at the start and after ten minutes."""
    data_set = SimpleNamespace(dynamics=CALM, unit=typical(SHIP).numpy())
    formula = Formula(SHIP, list(UNITS), **{f"w{k + 1}": 0.5 for k in range(len(UNITS))})
    given = [Value(p.name, 0.5, 0.1, p.unit) for p in formula.declared]
    found = causes._with_units(data_set, formula, given)
    assert {v.name: v.unit for v in found[: len(UNITS)]} == UNITS and found[-1].name == "memory_s"
    by_name = {v.name: v for v in found}
    assert by_name["X |d|"].value == approx(0.5 * unit_forces(data_set)[0])
    p, minutes = SHIP.particulars, 10.0
    assert by_name["N r t"].value * minutes == approx(0.5 * unit_forces(data_set)[2])
    assert by_name["sensor psi t^2"].value * minutes**2 == approx(2.5)
    assert by_name["sensor north t^2"].value * minutes**2 == approx(0.1 * p.length)
    assert all(v.error == approx(v.value / 5) for v in found[: len(UNITS)])
    cause = Cause("unknown", "", 0.9, 9.0, ("N",), found, None, "", "", tuple(UNITS))
    said = words._formula(cause)
    assert (
        f"N = {by_name['N r|r| cos psi'].value:.3g} MN m r|r| cos psi + {by_name['N r t'].value:.3g} MN m/min r t"
        in said
    )
    assert "more rudder = 0.5 deg/deg of the angle to port" in said and "error of u_log =" in said
    assert "positive: X ahead, N bow to starboard, Y to starboard" in said
