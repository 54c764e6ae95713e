"""Small decisions of the diagnosis, each by itself: orders of channels and runs, what is left out and what is told."""

from dataclasses import replace
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pandas as pd
import pytest
import torch
from fleet import ship_named
from pytest import approx
from scipy.optimize import brentq
from searches import fitted, found
from trials import CIRCLE, SHIP, run_of, sailed, values

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.diagnosis import advise, case, fits, forecast, formula, manifest, predictive, proof, windows, words
from manoeuvre_nn.diagnosis import claims as diagnosing
from manoeuvre_nn.diagnosis import search as searching
from manoeuvre_nn.diagnosis.decision import Decision
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.replay import integrate
from manoeuvre_nn.effect.current import TidalCurrent
from manoeuvre_nn.effect.depth import ShallowWater
from manoeuvre_nn.effect.formula import library, mark_of
from manoeuvre_nn.effect.rudder import RudderBacklash, RudderOffset
from manoeuvre_nn.effect.wind import WindOnset
from manoeuvre_nn.estimation.corrections import Calibrated, Corrections
from manoeuvre_nn.estimation.hypothesis import NUMBER_OF_INTERVALS, FittedHypothesis, Hypothesis
from manoeuvre_nn.ship.container import container
from manoeuvre_nn.ship.mariner import mariner

pytestmark = pytest.mark.usefixtures("unchecked_types")


def test_without_held_out_runs_nothing_is_predicted_and_nothing_proved():
    question = Mock(dynamics=None, case=Mock(held_out=[], warmup=60.0))
    assert proof.prove(question, Mock(names=("current",)), Mock()) == []


def test_without_held_out_runs_a_hypothesis_gains_nothing_by_them():
    question, given = Mock(case=Mock(held_out=[], fitted=[Mock(meta={})])), fitted(3.0, "current")
    there = proof.in_held_out_runs(question, given)
    assert there.evidence == 0.0 and there.names == ("current",) and not there.hypothesis.unknowns()


def test_particulars_of_a_manifest_are_brought_into_si_units():
    ship = ship_named("mariner")
    numbers = {"displacement_t": 16e3, "calm_water_resistance_kN": 350.0, "rudder_rate_deg_s": 3.0, "nominal_rpm": 80.0}
    given = {"particulars": numbers}
    p = manifest.adapted(ship, given).particulars
    assert (p.displacement, p.resistance, p.rpm) == approx((16e6, 350e3, 80.0)) and p.rudder_rate == approx(3 * DEGREE)
    assert manifest.adapted(ship, {}).particulars.displacement == approx(ship.particulars.displacement)


def test_an_event_is_fitted_from_its_start_as_it_is_and_a_depth_in_a_form_that_suits_it():
    """The form of an event is that of its published curve: its size was found with that."""
    improved = Mock(improve=lambda start, level, scatter, rounds: (replace(start, campaigns=(0,)), 0.0))
    for effect, suited in ((WindOnset(SHIP), False), (ShallowWater(SHIP), True), (RudderOffset(SHIP), False)):
        start = Hypothesis((effect,), (values(effect),))
        assert bool(fits._in_form(improved, start, 0, 0).campaigns) == suited


def test_of_two_fits_of_the_same_effects_the_better_one_is_the_leader_that_rivals_are_told_from():
    best, worse, rival = fitted(20.0, "current"), fitted(12.0, "current"), fitted(18.0, "log_scale")
    verdict = Decision(True, False, 0.0, 0.0, {"current": 0.9, "log_scale": 0.2}, best, {})
    (duel,) = words._duels(found(best, rival, worse), verdict, best, True)
    assert duel[0] is best and duel[1] is rival


def test_the_run_that_tells_most_stands_first(monkeypatch):
    """A first column alone: every plan adds half its square to the expected log Bayes factor."""
    grams = [np.array([[squares]]) for squares in (3.0, 2.0, 8.0, 4.0)]
    monkeypatch.setattr(advise, "_grams", lambda *_: (grams, np.zeros(0)))
    plans = [SimpleNamespace(text=text) for text in ("little", "most", "more")]
    ranked = advise._ranked(Mock(), [], Mock(), (0, 0), plans)
    assert [(gain, plan.text) for gain, plan in ranked] == [(4.0, "most"), (2.0, "more"), (1.0, "little")]


def test_noise_is_told_of_the_channels_as_they_are_shown(monkeypatch):
    """x, y, vn, ve, psi, r, log -> x, y, psi, u, v, r, log; angles in degrees."""
    monkeypatch.setattr(forecast, "joined", lambda _: Mock(combined=lambda _: Mock(measured=np.zeros((5, 8, 1)))))
    white = Mock(embed=lambda data: data, states=lambda data: np.zeros((5, 9, 1)))
    linearised = Mock(observed=np.zeros((5, 8, 9)), present=np.zeros((5, 8), dtype=bool))  # nothing was recorded
    run = Mock(base=None, linearised=linearised, noise=0.5, inflation=1.0, sample_noise=np.arange(1.0, 9.0))
    data_set = Mock(combinations=0, runs=[run], at=lambda level: Mock(white=[white]))
    noise = forecast._noise(Mock(data_set=data_set, mean=np.zeros(1), chosen=Mock(names=(), best=(0, 0))))
    assert noise == approx({
        "x": 1.0,
        "y": 2.0,
        "psi": 5.0 / DEGREE,
        "u": 3.0,
        "v": 4.0,
        "r": 6.0 / DEGREE,
        "u_log": 7.0,
    })


def test_an_event_happens_as_often_in_a_run_as_has_a_probability():
    assert NUMBER_OF_INTERVALS[windows.MAX_INTERVALS :] == (NUMBER_OF_INTERVALS[-1],) and windows.MAX_INTERVALS > 1


def test_candidates_of_a_formula_are_the_terms_of_the_library_with_shares_of_unit_length(monkeypatch):
    wave = Mock(equation="Y", mark="t", shares=((0.6, 0.8),), scales={"period_s": 60.0}, tried=8)
    monkeypatch.setattr(formula, "recurring", lambda data_set: [wave])
    run = Mock(linearised=Mock(run=Mock(duration=600.0)))
    candidates = formula._candidates(Mock(runs=[run]))
    for candidate in candidates:
        (shares,) = candidate.shares
        assert len(shares) == len(candidate.terms) and np.linalg.norm(shares) == approx(1.0)
    plain = [c.terms[0] for c in candidates if not c.scales and len(c.terms) == 1]
    assert [term for term in plain if not mark_of(term)] == [term for term in library() if not mark_of(term)]


@pytest.mark.parametrize("size", [0.02, 0.1, 0.4, 1.5])
def test_a_term_of_a_formula_has_the_size_that_makes_the_data_likeliest(size):
    """With own information I and pull p the evidence is largest where I s^2 = p^2/I - 1; here both sides are 5."""
    own = 5.0 / size**2
    pull = np.sqrt(6.0 * own)
    gram = np.array([[pull**2, 0.0, pull], [0.0, 1.0, 0.0], [pull, 0.0, own]])
    data_set = Mock(size=2, runs=[0], nuisance_sd=lambda scatter, runs: np.ones(1))
    assert formula._chosen(gram, data_set, 0, np.ones(1), [formula._Candidate(("t",))]) == [(0, size)]


@pytest.mark.parametrize("more, found", [(-0.1, []), (0.1, [0])])
def test_a_wave_with_a_phase_of_its_own_in_each_run_pays_for_every_weight(more, found):
    """Six weights, each with a sixth of the information: log det is 6 log(1 + I s^2 / 6), not log(1 + I s^2)."""
    wave = formula._Candidate(("Y cos periodic_by_run", "Y sin periodic_by_run"), ((0.6, 0.8),) * 3, tried=7)
    own, sizes = 4000.0, np.array(formula.SIZES)

    def log_odds(pull: float) -> float:
        of_sizes = 0.5 * pull**2 / (own + sizes**-2) - 0.5 * 6 * np.log1p(own * sizes**2 / 6)
        return float(of_sizes.max() - np.log(7) - np.log(4))  # one of seven periods, one of four sizes

    pull = brentq(lambda x: log_odds(x) - more, 1.0, 1e4)
    gram = np.array([[pull**2, 0.0, pull], [0.0, 1.0, 0.0], [pull, 0.0, own]])
    data_set = Mock(size=2, runs=[0] * 3, nuisance_sd=lambda scatter, runs: np.ones(1))
    assert [k for k, _ in formula._chosen(gram, data_set, 0, np.ones(1), [wave])] == found


def test_free_runs_are_compared_along_and_across_the_ship():
    psi, u, v = np.radians([30.0, 120.0, -70.0]), np.array([7.0, 6.0, 5.0]), np.array([-0.5, 0.2, 0.8])
    north, east = u * np.cos(psi) - v * np.sin(psi), u * np.sin(psi) + v * np.cos(psi)
    flat = np.zeros(3)
    run = np.stack([flat, flat, north, east, psi, flat, u], axis=1)
    record = pd.DataFrame({"x": 1.0, "y": 2.0, "psi": np.degrees(psi) + 359.0, "u": u + 0.1, "v": v - 0.2, "r": 3.0,
                           "u_log": u})  # fmt: skip
    off = predictive._off(np.stack([run, run]), record)
    expected = {"x": 1.0, "y": 2.0, "psi": -DEGREE, "u": 0.1, "v": -0.2, "r": 3.0 * DEGREE, "u_log": 0.0}
    assert {name: rows[0] for name, rows in off.items()} == {name: approx([e] * 3) for name, e in expected.items()}
    assert all(rows[1] == approx(flat) for rows in off.values())


@pytest.mark.parametrize("share, recorded, told", [(1.0, False, False), (0.8, False, True), (0.8, True, False)])
def test_a_shaft_that_was_ordered_is_told_where_it_was_not_recorded_and_not_the_nominal_one(share, recorded, told):
    run = run_of(sailed([CIRCLE])[0].between(0.0, 5.0), derived=())
    shaft = np.full(len(run), share if recorded else np.nan)
    run = run.with_channels(shaft=np.full(len(run), share), shaft_recorded=shaft)
    said = case._undecided(Mock(runs=[run, run], fitted=[run], planned=[], held_out=[run]))
    assert any("was ordered otherwise than the model's nominal speed" in line for line in said) is told


@pytest.mark.parametrize("ship, driven, state", [(mariner, 2, 2), (container, 3, 7)])
def test_a_random_moment_turns_or_rolls_the_ship_and_does_nothing_else_at_once(ship, driven, state):
    """Over a step of 20 ms the rate is the acceleration times the time."""
    model = CalmWater(ship())
    rows, step, push, count = 5, 0.02, 1e-3, 6 + len(model.own_names)
    first = torch.zeros(rows, count, dtype=torch.float64)
    first[:, 0] = model.particulars.speed
    columns = {name: torch.full((rows, 2), float(name == "shaft")) for name in ("delta", "shaft")}
    pushes = torch.zeros(2, rows, 3 + bool(model.own_names), dtype=torch.float64)
    pushes[:, 1:, driven] = push
    end = integrate(forecast._Pushed(model, pushes, 0.0, step), first, columns, interval=step, start=0.0)[-1]
    moved = (end - end[0]).numpy()
    assert moved[1:, state] == approx(np.full(4, push * step), rel=1e-2)
    assert np.abs(np.delete(moved, state, axis=1)).max() < 0.05 * push * step * (1.0 if ship is container else 60.0)


def test_every_draw_but_the_first_of_each_run_is_pushed_by_noise_of_its_size():
    model, sd = CalmWater(mariner()), np.array([1e-2, 2e-2, 3e-4])
    shares = torch.zeros(2 * 500, len(Corrections(model).names), dtype=torch.float64)
    runs = [run_of(sailed([CIRCLE])[0].between(0.0, end), derived=()) for end in (40.0, 60.0)]
    pushed = forecast.with_process_noise(Calibrated(model, shares), sd, runs, 20.0, np.random.default_rng(4))
    assert pushed._pushes.shape[0] == len(runs[1]) and (pushed._start, pushed._interval) == (20.0, runs[0].step)
    assert (pushed._pushes[:, ::500] == 0.0).all()
    for rows in (slice(1, 500), slice(501, None)):
        assert pushed._pushes[10, rows].std(dim=0).numpy() == approx(sd, rel=0.12)


@pytest.mark.usefixtures("unchecked_types")
@pytest.mark.parametrize("latency", [0.0, 3.0])
def test_free_runs_of_calm_water_are_shown_by_a_receiver_as_late_as_the_recorded_one(latency):
    run = run_of(sailed([CIRCLE])[0].between(0.0, 120.0), derived=())
    late = run.with_channels(**{c: np.interp(run.time - latency, run.time, run[c]) for c in ("x", "y", "vn", "ve")})
    model = CalmWater(mariner())
    quiet = 1e-9 * np.array([1.0, 1.0, 1e-3])
    allowed = predictive._Allowed(np.zeros((2, len(Corrections(model).names))), latency, quiet)
    (shown,) = predictive.drawn_runs(model, [late], 40.0, allowed, np.random.default_rng(0))
    after = late.time >= 40.0
    recorded = np.stack([late[c][after] for c in ("x", "y", "vn", "ve", "psi", "r")], axis=1)
    assert shown.shape == (2, after.sum(), 7)
    assert np.abs(shown[0, :, :2] - recorded[:, :2]).max() < 0.1 * 3.0 * SHIP.particulars.speed
    assert np.abs(shown[0, :, 2:6] - recorded[:, 2:]).max() < 0.05


@pytest.mark.parametrize("best_part, helps", [(33.8, True), (34.2, False), (None, True)])
def test_the_last_of_several_effects_must_add_six_in_fitted_and_held_out_runs_to_the_best_part(
    monkeypatch, best_part, helps
):
    """A worse part says no more than the best one, whatever it predicts."""
    three = fitted(30.0, "current", "log_scale", "heading_bias")
    parts = [fitted(20.0, "current", "log_scale"), fitted(15.0, "current", "heading_bias"), fitted(12.0, "current")]
    there = {parts[0].names: fitted((best_part or 0.0) - 20.0, "current"), parts[1].names: fitted(99.0, "current")}
    monkeypatch.setattr(diagnosing, "_as_put_to_proof", lambda question, tried, j: (None, j))
    monkeypatch.setattr(diagnosing, "in_held_out_runs", lambda question, j, known: there[j.names])
    claims = [three, *parts] if best_part else [three, parts[2]]
    assert diagnosing._last_effect_helps(Mock(held_out_evidence={}), Mock(), three, 10.0, claims) is helps


@pytest.mark.parametrize("name, helps", [("rudder_offset", False), ("formula", True)])
def test_two_effects_must_add_six_to_another_one_alone_too(monkeypatch, name, helps):
    """A fouled hull less a pitch error is an ice resistance; a formula is no effect with a name."""
    two, part = fitted(20.0, "current", "log_scale"), fitted(10.0, "current")
    other = SimpleNamespace(names=(name,), evidence=19.0, hypothesis=SimpleNamespace(effects=()), random={})
    monkeypatch.setattr(diagnosing, "_as_put_to_proof", lambda question, tried, j: (None, j))
    monkeypatch.setattr(diagnosing, "in_held_out_runs", lambda question, j, known: fitted(5.0, "current"))
    assert diagnosing._last_effect_helps(Mock(held_out_evidence={}), Mock(), two, 5.0, [two, part, other]) is helps


@pytest.mark.parametrize("there, outweighed", [(-2.0, False), (-4.0, True)])
def test_calm_water_outweighs_what_held_out_runs_take_more_from_than_fitted_ones_gave(monkeypatch, there, outweighed):
    """Of one effect, twice as often as calm water: 2.1 ahead in the fitted runs is 2.9 by its odds."""
    best, evidence = fitted(2.1, "current"), {(): 7.0, ("current",): 7.0 + there}
    monkeypatch.setattr(diagnosing, "_as_put_to_proof", lambda question, tried, j: (None, j))
    monkeypatch.setattr(diagnosing, "in_held_out_runs", lambda question, j, known: fitted(evidence[j.names], *j.names))
    assert diagnosing._outweighed(Mock(held_out_evidence={}), found(best), best) is outweighed


@pytest.mark.parametrize("degrees, moved", [(1.0, False), (1.05, True)])
def test_an_indicator_that_flickers_between_two_neighbouring_whole_degrees_shows_no_rudder_that_moves(degrees, moved):
    run = run_of(sailed([CIRCLE])[0].between(0.0, 5.0), derived=())
    run = run.with_channels(delta=degrees * DEGREE * (np.arange(len(run)) % 2))
    said = case._undecided(Mock(runs=[run, run], fitted=[run], planned=[], held_out=[run]))
    assert any(line.startswith("The rudder never moved") for line in said) is not moved


@pytest.mark.parametrize("ends, long_enough", [(59.0, False), (60.0, True), (61.0, True)])
def test_a_run_of_a_minute_can_be_held_out_with_a_warm_up_of_forty_seconds(ends, long_enough):
    """Half as long again as its warm-up."""
    run = Mock(time=np.array([0.0, ends]))
    run.name = "zigzag"
    if long_enough:
        case._check_split([run], {"zigzag": True, "circle": False}, 40.0)
    else:
        with pytest.raises(InputError, match="zigzag ends after 59 s: too short to be held out"):
            case._check_split([run], {"zigzag": True, "circle": False}, 40.0)


@pytest.mark.parametrize("more, told", [(2.9, []), (3.1, [("tidal_current",)])])
def test_a_current_that_changes_is_told_where_it_is_twenty_times_as_likely_as_a_steady_one(monkeypatch, more, told):
    changing = SimpleNamespace(names=("tidal_current",), evidence=20.0 + more)
    monkeypatch.setattr(searching, "_with_variant", lambda likelihood, j, variant: changing)
    sea = SimpleNamespace(dynamics=SimpleNamespace(particulars=SimpleNamespace(is_model=False)))
    tried = found(fitted(20.0, "current"))
    tried = replace(tried, likelihood=SimpleNamespace(data_set=sea))
    assert [j.names for j in searching._varied(tried, [TidalCurrent(SHIP)], lambda _: None, 1)] == told


@pytest.mark.parametrize("moved, kept", [(-0.95, 0.1), (-1.05, 30.0)])
def test_a_value_of_which_nothing_is_recorded_stays_where_it_was_fitted(monkeypatch, moved, kept):
    """A play of 30 deg holds the blade, like any larger one: its mean over all levels is that of the prior."""
    effect = RudderBacklash(SHIP)
    fitted, mean = (Hypothesis((effect,), (np.array([[width]]),)) for width in (30.0, 0.1))
    there = SimpleNamespace(
        improve=lambda h, level, scatter, rounds=5: (h, moved * (h.values[0][0, 0] == 0.1)),
        evaluate=lambda h, around, fine: FittedHypothesis(
            mean, 12.0 if h is fitted else 1.0, np.zeros((1, 1)), np.zeros((0, 0)), best=(1, 1)
        ),
    )
    monkeypatch.setattr(fits, "beside", lambda likelihood, hypothesis: there)
    monkeypatch.setattr(fits, "replaced", lambda there, hypothesis, level, scatter: hypothesis)
    found = fits.refine(there, fitted, 1, 1)
    assert found.evidence == 12.0 and found.hypothesis.values[0][0, 0] == kept
