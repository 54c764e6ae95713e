"""What a short formula is chosen from, what its terms must be worth, and what calm-water terms cost it."""

from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest
from pytest import approx
from searches import fitted
from trials import CALM, SHIP

from manoeuvre_nn.diagnosis import formula
from manoeuvre_nn.effect.formula import LAG, in_time, mark_of
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis
from manoeuvre_nn.estimation.process_noise import PROCESS_LEVELS

pytestmark = pytest.mark.usefixtures("unchecked_types")


@pytest.mark.parametrize("durations, longest", [((600.0, 900.0), 200.0), ((21.0, 600.0), 10.0)])
def test_forces_that_follow_late_are_tried_with_memories_of_five_seconds_to_a_third_of_the_shortest_run(
    monkeypatch, durations, longest
):
    """But of ten seconds at least, however short it is."""
    monkeypatch.setattr(formula, "recurring", lambda data_set: [])
    runs = [SimpleNamespace(linearised=SimpleNamespace(run=SimpleNamespace(duration=d))) for d in durations]
    late = [c for c in formula._candidates(SimpleNamespace(runs=runs)) if c.scales]
    assert {c.terms for c in late} == {(term,) for term in in_time() if mark_of(term) == LAG}
    for term in {c.terms for c in late}:
        memories = [c.scales["memory_s"] for c in late if c.terms == term]
        assert memories == approx(np.geomspace(5.0, longest, 7).tolist())


def test_there_is_no_formula_where_no_term_explains_anything(monkeypatch):
    monkeypatch.setattr(formula, "_candidates", lambda data_set: [formula._Candidate(("N |v|",))])
    monkeypatch.setattr(formula, "_columns", lambda *_: (None, np.ones(1)))
    gram = np.diag([9.0, 1.0, 4.0])  # the data, a coefficient, the term: nothing of one is in another
    data_set = Mock(size=2, runs=[0], nuisance_sd=lambda scatter, runs: np.ones(1), gram=lambda *_: gram)
    assert formula.short_formula(Mock(data_set=data_set), fitted(0.0)) is None


def gram_of(*pulls: float) -> np.ndarray:
    """Inner products of data, one nuisance column and independent candidates that each explain pull^2 / 2."""
    gram = np.diag([sum(p**2 for p in pulls) + 1.0, 1.0, *np.ones(len(pulls))])
    gram[0, 2:] = gram[2:, 0] = pulls
    return gram


def chosen_terms(pulls, tried=1) -> list[int]:
    data_set = SimpleNamespace(size=2, runs=[0], nuisance_sd=lambda scatter, runs: np.ones(1))
    candidates = [formula._Candidate((f"t{k}",), tried=tried) for k in range(len(pulls))]
    return [k for k, _ in formula._chosen(gram_of(*pulls), data_set, 0, np.ones(len(pulls)), candidates)]


def test_terms_are_chosen_as_long_as_each_gains_more_than_the_logarithm_of_its_choices():
    """With spread s a pull p gains p^2/2 s^2/(1+s^2) - ln(1+s^2)/2, the best s of four 1.5 for p = 3; 8 choices."""
    gain = 0.5 * 9.0 * 2.25 / 3.25 - 0.5 * np.log(3.25)
    assert np.log(4 * 2) < gain < np.log(4 * 4)
    assert chosen_terms([3.0, 0.0]) == [0] and chosen_terms([3.0, 0.0, 0.0, 0.0]) == []
    assert chosen_terms([2.80, 0.0]) == [0] and chosen_terms([2.74, 0.0]) == [], "ln 8 at a pull of 2.777"
    assert chosen_terms([5.0, 3.0, 0.0, 0.0]) == [0, 1], "the second has half the choices"
    assert chosen_terms([3.0, 0.0], tried=8) == [], "a peak among eight frequencies is no better than its search"


def test_a_formula_has_four_terms_at_most():
    assert chosen_terms([9.0, 8.0, 7.0, 6.0, 5.0]) == [0, 1, 2, 3]


MIXED = ["Y v|v|", "N r|r| cos psi"]
FORMULAS = [  # terms, memory [L/U0], log evidence of the second alone, what is left of 50; the terms that are told
    (["Y v|v|"], None, 0.0, 50.0 - 12.0, 1),
    (["N r|r| cos psi"], None, 0.0, 50.0, 1),
    (["Y lag d"], 0.48, 0.0, 50.0 - 12.0, 1),
    (["Y lag d"], 0.52, 0.0, 50.0, 1),
    (MIXED, None, 35.0, 50.0 - 12.0, 2),
    (MIXED, None, 36.0, 36.0, 1),
]


@pytest.mark.parametrize("terms, memory, alone, left, told", FORMULAS)
def test_a_formula_pays_for_its_choice_and_twelve_for_terms_that_a_calm_water_model_could_have(
    monkeypatch, terms, memory, alone, left, told
):
    """Of ten candidates in four sizes; two terms are one choice whatever their order. Or it goes without."""
    scales = {} if memory is None else {"memory_s": memory * SHIP.particulars.time_unit}
    candidates = [formula._Candidate((t,), scales=scales) for t in terms] + [None] * (10 - len(terms))
    monkeypatch.setattr(formula, "_candidates", lambda data_set: candidates)
    monkeypatch.setattr(formula, "_columns", lambda data_set, run, some: (None, np.zeros(10)))
    monkeypatch.setattr(formula, "_chosen", lambda *_: [(k, 0.1) for k in range(len(terms))])
    data_set = SimpleNamespace(runs=[0], dynamics=CALM, levels=PROCESS_LEVELS)
    data_set.gram, data_set.embedded = lambda *_: None, lambda *_: None
    likelihood = SimpleNamespace(
        data_set=data_set,
        improve=lambda start, level, scatter, rounds: (start, 0.0),
        evaluate=lambda h, around: FittedHypothesis(
            h, 50.0 if len(h.effects[0].terms) == len(terms) else alone, np.zeros((1, 1)), np.eye(3)
        ),
    )
    choice = np.log(40.0) if told == 1 else np.log(40.0) + np.log(4.0 * 9.0 / 2.0)
    found = formula.short_formula(likelihood, fitted(0.0))
    assert found.hypothesis.effects[0].terms == tuple(terms[-told:])
    assert found.evidence == approx(left - choice, abs=1e-9)
