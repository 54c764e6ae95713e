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


def searched(monkeypatch, alone: dict[str, float], more: list[SimpleNamespace]) -> tuple[list, list]:
    """What a search linearises about again, and what gusts are tried for, where fits leave this log evidence."""
    calm, about, windy = fit(0.0), [], []
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
    monkeypatch.setattr(under_test, "_extended", lambda likelihood, leading, *_: (
        j for j in more if any(len(j.names) == len(first.names) + 1 for first in leading)
    ))  # fmt: skip
    monkeypatch.setattr(under_test, "fitted_gusts", gusts)
    data_set = SimpleNamespace(dynamics=SimpleNamespace(particulars=SimpleNamespace(is_model=False)))
    search(data_set, EFFECTS)
    return about, windy


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


@pytest.mark.parametrize("gain, pair_leads", [(13.0, True), (11.0, False)])
def test_a_pair_that_gains_much_is_what_runs_are_linearised_about_again(monkeypatch, gain, pair_leads):
    pair = fit(40.0 + gain, "current", "log_scale")
    about, _ = searched(monkeypatch, {"current": 40.0, "log_scale": 8.0}, [pair])
    assert about == [("current",), *([("current", "log_scale")] if pair_leads else [])]


def test_gusts_are_tried_for_a_wind_alone_behind_any_number_of_pairs(monkeypatch):
    pairs = [fit(60.0 - k, "wind_steady", f"other {k}") for k in range(4)]
    _, windy = searched(monkeypatch, {"wind_steady": 20.0}, pairs)
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
        evidence=9.0 if begun[level, scatter] == best else 2.0, begun=begun[level, scatter]
    ))  # fmt: skip
    likelihood = SimpleNamespace(improve=lambda hypothesis, level, scatter, rounds: (hypothesis, 0.0))
    none = SimpleNamespace(best=(6, 4), evidence=0.0)
    assert single(likelihood, Current(SHIP), none).begun == best
    assert single(likelihood, SideForce(SHIP), none).begun == "published", "events explain the misfit or nothing"


@pytest.mark.parametrize(
    "names, fitted, held_out, named",
    [
        (("current",), 5.5, 2.0, False),
        (("current",), 5.5, 3.0, True),
        (("current",), 30.0, -4.0, True),
        (("current",), 30.0, -6.0, False),
        (("current", "log_scale"), 9.5, 4.0, False),
        (("current", "log_scale"), 9.5, 5.0, True),
    ],
)
def test_a_named_effect_must_gain_eight_in_fitted_and_held_out_runs_together(
    monkeypatch, names, fitted, held_out, named
):
    """And six more for a second one; whatever is gained in fitted runs, held-out ones refute what loses five there."""
    none, claim = fit(100.0), fit(100.0 + fitted, *names)
    none.hypothesis = claim.hypothesis = Hypothesis(tuple(EFFECTS[:1]), (values(EFFECTS[0]),))
    proof = SimpleNamespace(rmse_before={}, rmse_after={})
    for name, made in {
        "prove": lambda *_: [proof], "at_rest": lambda data_set, j: (data_set, j),
        "in_held_out_runs": lambda question, j: SimpleNamespace(
            hypothesis=j.hypothesis, evidence=7.0 + (held_out if j is claim else 0.0)
        ),
        "is_fitted": lambda dynamics: False, "_cost": lambda *_: 1.0,
        "_last_effect_helps": lambda *_: True, "labels": lambda j: "", "_unit": lambda question: "",
    }.items():  # fmt: skip
        monkeypatch.setattr(proving, name, made)
    monkeypatch.setattr(proving.checking, "checks", lambda *_: [])
    chosen, _, _ = proving._proved(Mock(), SimpleNamespace(likelihood=Mock(), none=none), [claim])
    assert chosen is (claim if named else none)
