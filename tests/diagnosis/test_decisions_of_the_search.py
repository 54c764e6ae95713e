"""What the search decides between its fits: about which states, from which noise levels, which gusts, what suffices."""

from dataclasses import replace
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest
from trials import SHIP, values

from manoeuvre_nn.diagnosis import diagnose as proving
from manoeuvre_nn.diagnosis import search as under_test
from manoeuvre_nn.diagnosis.search import PUBLISHED_SD_LEVEL, search, single
from manoeuvre_nn.effect.current import Current
from manoeuvre_nn.effect.local import SideForce
from manoeuvre_nn.effect.sensors import LogScale
from manoeuvre_nn.effect.wind import GustyWind, SteadyWind
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis, Hypothesis

pytestmark = pytest.mark.usefixtures("unchecked_types")
EFFECTS = [Current(SHIP), SteadyWind(SHIP), LogScale(SHIP), GustyWind(SHIP)]


def fit(evidence: float, *names: str) -> SimpleNamespace:
    """A fitted hypothesis of these effects."""
    return SimpleNamespace(evidence=evidence, names=names, best=(4, 3), hypothesis=Hypothesis((), ()))


def searched(monkeypatch, alone: dict[str, float], more: list[SimpleNamespace]) -> tuple[list, list, list]:
    """About what a search linearises again, for what it tries gusts, what it builds upon: fits leave this evidence."""
    calm, about, windy, built_upon = fit(0.0), [], [], []
    likelihood = SimpleNamespace(data_set=None, evaluate=lambda hypothesis, around=None: calm)

    def again(likelihood, none, fitted, workers, leads):
        about.append(leads.names)
        return likelihood, none, list(fitted)

    def gusts(likelihood, steady, variant):
        windy.append(steady.names)
        return fit(-9.0, variant.name)

    monkeypatch.setattr(under_test, "MarginalLikelihood", lambda data_set: likelihood)
    monkeypatch.setattr(under_test, "with_likely_coefficient_prior", lambda data_set, fitted: data_set)
    monkeypatch.setattr(under_test, "single", lambda likelihood, e, none: fit(alone.get(e.name, -5.0), e.name))
    monkeypatch.setattr(under_test, "_again", again)

    def extended(likelihood, leading, *_):
        built_upon.append([j.names for j in leading])
        return [j for j in more if any(len(j.names) == len(first.names) + 1 for first in leading)]

    monkeypatch.setattr(under_test, "_extended", extended)
    monkeypatch.setattr(under_test, "fitted_gusts", gusts)
    dynamics = SimpleNamespace(particulars=SimpleNamespace(is_model=False))
    data_set = SimpleNamespace(dynamics=dynamics, release=lambda: None)
    search(data_set, EFFECTS)
    return about, windy, built_upon


@pytest.mark.parametrize("worse, built_upon", [(1, []), (2, ["wind", "log"])])
def test_pairs_are_built_upon_the_best_beside_published_coefficients_where_calm_water_needs_worse_ones(
    worse, built_upon
):
    """Two strong effects: coefficients that are off by 20 % explain them better than either alone."""

    def fitted(published: float, anything: float, name: str) -> FittedHypothesis:
        by_level = np.array([[published] * (PUBLISHED_SD_LEVEL + 1) + [anything] * 3])
        effect = SimpleNamespace(name=name)
        return FittedHypothesis(Hypothesis((effect,), (np.zeros((1, 0)),)), anything, by_level, np.zeros((0, 0)))

    none = replace(fitted(-300.0, 0.0, ""), best=(6, PUBLISHED_SD_LEVEL + worse))
    found = under_test._beside_published(none, [fitted(-200.0, -4.0, "log"), fitted(-100.0, -9.0, "wind")])
    assert [j.names[0] for j in found] == built_upon
    assert all(j.best == (under_test.quiet(6), PUBLISHED_SD_LEVEL) for j in found)


@pytest.mark.parametrize("gain, pair_leads", [(12.5, True), (11.5, False)])
def test_a_pair_that_gains_much_is_what_runs_are_linearised_about_again(monkeypatch, gain, pair_leads):
    pair = fit(40.0 + gain, "current", "log_scale")
    about, _, _ = searched(monkeypatch, {"current": 40.0, "log_scale": 8.0}, [pair])
    assert about == [("current",), *([("current", "log_scale")] if pair_leads else [])]


@pytest.mark.parametrize("gain, about", [(11.5, ()), (12.5, ("current",))])
def test_below_twelve_runs_are_linearised_about_calm_water(monkeypatch, gain, about):
    assert searched(monkeypatch, {"current": gain}, [])[0] == [about]


@pytest.mark.parametrize("gain, built_upon", [(2.8, []), (3.2, [("log_scale",)])])
def test_effects_are_combined_that_alone_gain_three_and_none_has_more_than_three(monkeypatch, gain, built_upon):
    names = ("current", "log_scale", "wind_steady", "rudder_offset")
    more = [fit(40.0 + 7.0 * k, *names[:k]) for k in (2, 3, 4)]
    _, _, leading = searched(monkeypatch, {"current": 40.0, "log_scale": gain}, more)
    assert leading == [[("current",), *built_upon], [names[:2]]], "pairs of the first, triples of the pair"


@pytest.mark.parametrize("second, kept", [(5.8, []), (6.2, [("current", "log_scale")])])
def test_a_pair_is_built_upon_that_adds_six(monkeypatch, second, kept):
    _, _, leading = searched(monkeypatch, {"current": 40.0}, [fit(40.0 + second, "current", "log_scale")])
    assert leading[1] == kept


REFINED = [  # evidence of the fit, and after each of two more; what is worked on; how many fits
    ((5.0, 5.05, 9.0), -99.0, 5.05, 2),
    ((5.0, 5.15, 9.0), -99.0, 9.0, 3),
    ((5.0, 4.0, 9.0), -99.0, 5.0, 2),
    ((5.0, 9.0, 9.5), 5.5, 5.0, 1),
]


@pytest.mark.parametrize("evidences, least, best, fits", REFINED)
def test_a_fit_goes_on_as_long_as_it_gains_a_tenth_and_is_worth_it(monkeypatch, evidences, least, best, fits):
    left, rounds = list(evidences), []
    there = SimpleNamespace(
        improve=lambda h, level, scatter, rounds_=None, **more: (rounds.append(more.get("rounds")) or h, 0.0),
        evaluate=lambda h, around: SimpleNamespace(hypothesis=h, evidence=left.pop(0), best=(1, 1)),
    )
    monkeypatch.setattr(under_test, "beside", lambda likelihood, hypothesis: there)
    monkeypatch.setattr(under_test, "replaced", lambda there, hypothesis, level, scatter: hypothesis)
    assert under_test.refine(there, Hypothesis((), ()), 1, 1, least).evidence == best
    assert len(rounds) == fits


def test_gusts_are_tried_for_a_wind_alone_behind_any_number_of_pairs(monkeypatch):
    pairs = [fit(60.0 - k, "wind_steady", f"other {k}") for k in range(4)]
    _, windy, _ = searched(monkeypatch, {"wind_steady": 20.0}, pairs)
    assert windy == [*(j.names for j in pairs[:3]), ("wind_steady",)]


def test_gusts_are_not_tried_for_a_wind_that_says_less_than_calm_water(monkeypatch):
    assert searched(monkeypatch, {"wind_steady": -1.0, "current": 20.0}, [])[1] == []


@pytest.mark.parametrize("best", ["published", "calm water's"])
def test_the_better_of_the_fits_from_published_scatter_and_from_that_of_calm_water_is_taken(monkeypatch, best):
    """Where calm water calls a large effect wrong coefficients, a fit that begins there stays where it is small."""
    quiet = under_test.quiet(6)
    begun = {(quiet, PUBLISHED_SD_LEVEL): "published", (6, 4): "calm water's"}
    monkeypatch.setattr(under_test, "_starts", lambda *_: ["start"])
    monkeypatch.setattr(under_test, "refine", lambda likelihood, hypothesis, level, scatter, least: SimpleNamespace(
        evidence=9.0 if begun[level, scatter] == best else 2.0, begun=begun[level, scatter], least=least
    ))  # fmt: skip
    likelihood = SimpleNamespace(improve=lambda hypothesis, level, scatter, rounds: (hypothesis, 0.0))
    none = SimpleNamespace(best=(6, 4), evidence=2.0)
    found = single(likelihood, Current(SHIP), none)
    assert found.begun == best and found.least == -28.0, "thirty behind calm water a fit is given up"
    assert single(likelihood, SideForce(SHIP), none).begun == "published", "events explain the misfit or nothing"


PROVED = [  # effects, model was fitted, gain in fitted runs, in held-out ones, growth of the error; whether it is named
    (("current",), False, 5.5, 2.3, 1.0, False),
    (("current",), False, 5.5, 2.7, 1.0, True),
    (("current",), False, 30.0, -4.8, 1.0, True),
    (("current",), False, 30.0, -5.2, 1.0, False),
    (("current",), False, 30.0, 9.0, 1.04, True),
    (("current",), False, 30.0, 9.0, 1.06, False),
    (("current",), True, 30.0, 2.8, 1.0, False),  # the errors of a fitted model may look like an effect
    (("current",), True, 30.0, 3.2, 1.0, True),
    (("formula",), False, 30.0, 2.8, 1.0, False),
    (("formula",), False, 30.0, 3.2, 1.0, True),
    (("current", "log_scale"), False, 9.5, 4.2, 1.0, False),
    (("current", "log_scale"), False, 9.5, 4.8, 1.0, True),
]


@pytest.mark.parametrize("names, trained, fitted, held_out, growth, named", PROVED)
def test_a_named_effect_must_gain_eight_in_fitted_and_held_out_runs_together(
    monkeypatch, names, trained, fitted, held_out, growth, named
):
    """And six more for a second one; whatever is gained in fitted runs, held-out ones refute what loses five there."""
    none, claim = fit(100.0), fit(100.0 + fitted, *names)
    none.hypothesis = claim.hypothesis = Hypothesis(tuple(EFFECTS[:1]), (values(EFFECTS[0]),))
    proof = SimpleNamespace(rmse_before={"cost": 2.0}, rmse_after={"cost": 2.0 * growth})
    for name, made in {
        "prove": lambda *_: [proof], "at_rest": lambda data_set, j: (data_set, j),
        "in_held_out_runs": lambda question, j: SimpleNamespace(
            hypothesis=j.hypothesis, evidence=7.0 + (held_out if j is claim else 0.0)
        ),
        "is_fitted": lambda dynamics: trained, "_cost": lambda question, errors: errors[0]["cost"],
        "_last_effect_helps": lambda *_: True, "labels": lambda j: "", "_unit": lambda question: "",
    }.items():  # fmt: skip
        monkeypatch.setattr(proving, name, made)
    monkeypatch.setattr(proving.checking, "checks", lambda *_: [])
    chosen, _, checks = proving._proved(Mock(), SimpleNamespace(likelihood=Mock(), none=none), [claim])
    assert chosen is (claim if named else none) and checks[0].passed is named
