"""Scores of predicted runs with answers that are known: distances, errors of free runs, who predicts which run."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from fleet import unchecked
from pytest import approx

from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.manoeuvre.straight import straight
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.scoring import as_steered, held_out
from manoeuvre_nn.scoring.free_runs import SCALES, cost, counted_as_one, errors
from manoeuvre_nn.scoring.held_out import HeldOut, references, simulated_references
from manoeuvre_nn.scoring.score import score, spread
from manoeuvre_nn.scoring.sensitivity import SOBOL_POINTS, sobol_indices
from manoeuvre_nn.ship.mariner import mariner

SHIP, CALM = mariner().particulars, CalmWater(mariner())
TIME = np.arange(0.0, 101.0)
COLUMNS = ("x", "y", "psi", "u", "v", "r", "u_log")


def run(name="run", status="ok", kind="", **channels) -> Recording:
    """Straight north at 5 m/s."""
    given = {"x": 5.0 * TIME, "u": np.full(101, 5.0)} | {k: np.zeros(101) for k in ("y", "v", "r", "psi", "delta")}
    return Recording(name, TIME, {**given, **channels}, meta={"kind": kind}, status=status)


def test_errors_of_free_runs_are_root_mean_squares_channel_by_channel():
    record = pd.DataFrame(0.0, index=range(4), columns=COLUMNS)
    record["psi"], record["u_log"] = 359.0, np.nan
    record.loc[0, "v"] = np.nan
    told = record.assign(x=[3.0, 0, 0, 0], y=[4.0, 0, 0, 5.0], psi=1.0, u=0.5, v=[9.0, 1.0, 1.0, 1.0], r=[0, 0, 0, 0.2])
    found = errors(told.astype(float), record)
    assert found["pos"] == approx(np.sqrt((25.0 + 25.0) / 4)) and found["psi"] == approx(2.0)
    assert (found["u"], found["v"], found["r"]) == approx((0.5, 1.0, 0.1)) and np.isnan(found["u_log"])


def test_what_counts_as_one_is_a_fiftieth_of_a_length_half_a_degree_and_a_decimetre_a_second():
    """And of a model what Froude's law makes of it: a ship of 160 m."""
    model = replace(SHIP, length=1.6, beam=0.23, draught=0.07)
    assert counted_as_one(SHIP) == approx({"pos": 0.02, "psi": 0.5, "u": 0.1, "v": 0.1, "r": 0.03, "u_log": 0.1})
    assert model.is_model
    assert counted_as_one(model) == approx({"pos": 0.02, "psi": 0.5, "u": 0.01, "v": 0.01, "r": 0.3, "u_log": 0.01})


def test_the_cost_of_errors_that_each_count_as_one_is_one():
    one = counted_as_one(SHIP)
    one["pos"] *= SHIP.length
    assert cost([one], SHIP) == approx(1.0) and cost([], SHIP) == 0.0
    assert cost([one, {k: 3.0 * v for k, v in one.items()}], SHIP) == approx(np.sqrt(5.0))
    assert cost([one | {"pos": np.nan, "r": 5.0 * one["r"]}], SHIP) == approx(np.sqrt((4 + 25.0) / 5))
    assert list(one) == list(SCALES)


def test_a_score_is_the_largest_distance_and_errors_over_what_the_recording_varies():
    wave = np.sin(2 * np.pi * TIME / 50)
    reference = run(r=0.01 * wave, psi=0.2 * wave)
    ahead = reference.with_channels(
        x=reference["x"] + 30.0 * (TIME == 60), y=reference["y"] + 40.0 * (TIME == 60), u=reference["u"] + 0.3,
        r=reference["r"] + 0.01, v=reference["v"] - 0.1,
    )  # fmt: skip
    found = score(ahead, reference, 100.0)
    assert found.dev_L == approx(0.5) and found.spread_L is None
    assert found.nrmse["r"] == approx(1.0 / wave.std()) and found.nrmse["psi"] == 0.0
    assert (found.nrmse["u"], found.nrmse["v"]) == approx((0.3, 0.1)), "over one where a channel does not vary"
    assert "spread_L" not in found.as_dict() and found.as_dict()["dev_L"] == found.dev_L


def test_a_prediction_that_broke_down_rests_and_one_that_was_shorter_is_compared_as_far_as_it_goes():
    reference = run()
    short = reference.between(0.0, 40.0)
    assert score(replace(short, status="left_range"), reference, 100.0).dev_L == approx(3.0)
    assert score(short, reference, 100.0).dev_L == 0.0
    assert score(reference, short, 100.0).dev_L == 0.0


def test_criteria_are_compared_where_both_have_them_and_a_broken_run_has_none():
    with unchecked():
        (turn,) = simulated_references(CALM, [turning_circle(25.0, duration=600.0)])
    found = score(turn.with_channels(x=1.1 * turn["x"], y=1.1 * turn["y"]), turn, SHIP.length)
    assert found.errors["tactical_diameter_L"] > 0.05 and set(found.errors) <= set(found.reference)
    broken = score(replace(turn, status="left_range"), turn, SHIP.length)
    assert broken.criteria == {} and broken.reference == found.reference and broken.errors == {}


def test_the_spread_of_members_is_what_nine_of_ten_keep_where_it_is_largest():
    """Eleven members, the k-th 10 k m off at the end: nine of ten within 90 m, over a length of 100 m."""
    middle = run()
    members = [middle.with_channels(y=10.0 * k * TIME / 100.0) for k in range(11)]
    assert spread(middle, members, 100.0) == approx(0.9)
    scorer = HeldOut((middle, middle), 100.0)
    first, second = scorer.score([middle, middle], [members, []])
    assert first.spread_L == approx(0.9) and first.as_dict()["spread_L"] == first.spread_L
    assert second.spread_L is None


def test_the_criteria_of_members_are_compared_in_circles_and_one_that_breaks_down_reaches_none():
    with unchecked():
        (turn,) = simulated_references(CALM, [turning_circle(25.0, duration=600.0)])
    scorer = HeldOut((turn,), SHIP.length)
    (alone,) = scorer.score([turn])
    diameter = alone.criteria["tactical_diameter_L"]
    wider = [turn.with_channels(x=s * turn["x"], y=s * turn["y"]) for s in np.linspace(1.0, 1.09, 10)]
    (found,) = scorer.score([turn], [wider])
    assert found.spread_criteria["tactical_diameter_L"] == approx(0.08 * diameter, rel=0.02)
    assert found.as_dict()["spread_criteria"] == found.spread_criteria and alone.spread_criteria == {}
    lost = [replace(one, status="left the physical range at 30 s") for one in wider[:2]]
    (open_,) = scorer.score([turn], [[*wider[2:], *lost]])
    assert open_.spread_criteria["tactical_diameter_L"] == np.inf
    assert open_.as_dict()["spread_criteria"]["tactical_diameter_L"] is None
    zigzag = replace(turn, meta={**turn.meta, "kind": "zigzag"})
    assert HeldOut((zigzag,), SHIP.length).score([zigzag], [wider])[0].spread_criteria == {}


def test_every_reference_is_predicted_in_its_place_by_its_helmsman_or_its_recorded_rudder():
    with unchecked():
        steered = simulated_references(CALM, [straight(60.0), turning_circle(20.0, duration=60.0)])
        recorded = replace(steered[1], name="recorded", meta={"kind": "turning_circle"})
        scorer = HeldOut((recorded, *steered), SHIP.length)
        for solver in ("rollout", "torchdiffeq"):
            runs = scorer.predict(CALM, solver)
            assert [r.name for r in runs] == ["recorded", steered[0].name, steered[1].name]
            assert max(s.dev_L for s in scorer.score(runs)) < 1e-3
        assert scorer.predict_members(CALM) == [[], [], []], "a model that is no ensemble has none"
    assert all(r.meta["length"] == SHIP.length for r in scorer.references)


def test_members_of_an_ensemble_are_in_the_place_of_their_reference(monkeypatch):
    monkeypatch.setattr(held_out, "has_members", lambda dynamics: True)
    monkeypatch.setattr(held_out, "sail_members", lambda dynamics, manoeuvres: [[f"sailed {m}"] for m in manoeuvres])
    monkeypatch.setattr(held_out, "replay_members", lambda dynamics, runs: [[f"replayed {r.name}"] for r in runs])
    known = replace(run("steered"), meta={"manoeuvre": "m"})
    with unchecked():
        found = HeldOut((run("first"), known, run("last")), 100.0).predict_members(CALM)
        assert HeldOut((known,), 100.0).predict_members(CALM) == [["sailed m"]]
    assert found == [["replayed first"], ["sailed m"], ["replayed last"]]


def test_criteria_are_those_of_a_run_that_was_steered_unless_it_broke_down():
    with unchecked():
        (own,) = simulated_references(CALM, [zigzag(20.0, duration=300.0)])
    scorer = HeldOut((own,), SHIP.length)
    other = own.with_channels(psi=1.2 * own["psi"], r=1.2 * own["r"])
    (plain,), (steered,) = scorer.score([own]), scorer.score([own], steered={0: other})
    assert steered.criteria["overshoot_1_deg"] > plain.criteria["overshoot_1_deg"] + 1.0
    assert scorer.score([own], steered={0: replace(other, status="left_range")})[0].criteria == {}


def test_simulated_references_are_exact_and_measured_ones_are_smoothed(monkeypatch):
    asked = []
    monkeypatch.setattr(held_out, "accelerations", lambda run, how: asked.append((run.name, how)) or run)
    exact = {k: np.zeros(101) for k in held_out.ACCELERATION}
    simulated = replace(run("simulated", **exact), meta={"manoeuvre": "m"})
    bare, measured = replace(run("bare"), meta={"manoeuvre": "m"}), run("measured", **exact)
    assert references([simulated, bare, measured], SHIP).length == SHIP.length
    assert asked == [("bare", "smoother"), ("measured", "smoother")]


@pytest.mark.parametrize("reversals, heading", [(1, None), (2, 15.0), (3, 20.0)])
def test_two_reversals_say_how_a_helmsman_steered(reversals, heading):
    """His rudder goes over at 10, 20 and again at 20 deg: what he keeps to is the middle one."""
    time, over = np.arange(0.0, 300.0), np.array([20.0, 40.0, 90.0, 150.0])[: reversals + 1]
    psi = np.interp(time, [0, 20, 40, 90, 150, 299], np.array([0.0, 0.0, 10.0, -20.0, 20.0, -40.0])) * DEGREE
    sides = np.searchsorted(over, time, side="right")
    delta = 20 * DEGREE * np.where(sides == 0, 0.0, np.where(sides % 2 == 1, 1.0, -1.0))
    channels = {"psi": psi, "delta": delta, "r": np.gradient(psi), "u": np.full(300, 5.0), "v": 0 * time}
    recording = Recording("z", time, channels, meta={"kind": "zigzag"})
    made = as_steered.as_steered(recording, SHIP)
    assert (None if made is None else made.stages[0].heading / DEGREE) == (heading and approx(heading, rel=0.05))
    assert made is None or made.stages[0].order == approx(20 * DEGREE)


def test_sobol_points_are_a_power_of_two_and_enough_for_two_digits():
    first, _ = sobol_indices(lambda x: x[:, 0] + 0.5 * x[:, 1], np.array([[0.0, 1.0], [0.0, 1.0]]))
    assert first == approx([0.8, 0.2], abs=0.005) and SOBOL_POINTS & (SOBOL_POINTS - 1) == 0
