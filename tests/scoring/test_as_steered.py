"""Recorded zigzags as manoeuvres that a model is steered through."""

from dataclasses import replace

import numpy as np
import pytest
from fleet import unchecked

from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.scoring.as_steered import as_steered
from manoeuvre_nn.scoring.held_out import HeldOut
from manoeuvre_nn.ship.mariner import mariner, mariner_corrected

SHIP = mariner().particulars


def sailed(*manoeuvres, ship=mariner):
    with unchecked():
        runs = roll_out(CalmWater(ship()), manoeuvres)
    return [replace(r, meta={k: v for k, v in r.meta.items() if k != "manoeuvre"}) for r in runs]


@pytest.mark.parametrize("first", ["starboard", "port"])
def test_rudder_heading_and_side_are_those_of_the_helmsman(first):
    (run,) = sailed(zigzag(20.0, 10.0, first=first, duration=300.0))
    made = as_steered(run, SHIP)
    assert made.kind == "zigzag" and made.duration == pytest.approx(run.duration)
    sign = 1 if first == "starboard" else -1
    assert made.stages[0].order == pytest.approx(sign * 20 * DEGREE, rel=0.02)
    assert made.stages[0].heading == pytest.approx(sign * 10 * DEGREE, rel=0.1)


def test_a_ship_steered_through_its_own_record_repeats_it():
    (run,) = sailed(zigzag(20.0, duration=300.0))
    scorer = HeldOut((run,), SHIP.length)
    with unchecked():
        own, other = scorer.steer(CalmWater(mariner()))[0], scorer.steer(CalmWater(mariner_corrected()))[0]
        scores = scorer.score([run], steered={0: other})
    assert np.abs(own["psi"] - np.interp(own.time, run.time, run["psi"])).max() < 2.5 * DEGREE
    assert scores[0].criteria["overshoot_1_deg"] != pytest.approx(scores[0].reference["overshoot_1_deg"], abs=0.01)


def test_other_trials_and_short_zigzags_are_not_steered():
    turn, short = sailed(turning_circle(20.0, duration=200.0), zigzag(20.0, duration=40.0))
    assert as_steered(turn, SHIP) is None and as_steered(short, SHIP) is None
