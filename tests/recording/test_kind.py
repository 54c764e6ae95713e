import numpy as np
import pytest

from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.manoeuvre.spiral import spiral
from manoeuvre_nn.manoeuvre.straight import random_rudder, straight
from manoeuvre_nn.manoeuvre.turning import pull_out, turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.recording.kind import guess_kind
from manoeuvre_nn.ship.mariner import mariner

LENGTH = 360.0
MANOEUVRES = [
    zigzag(20.0), zigzag(10.0, first="port"), zigzag(5.0, 1.0), zigzag(20.0, 10.0, executes=3),
    turning_circle(25.0, duration=LENGTH), turning_circle(35.0, "port", duration=LENGTH), spiral(hold=20.0),
    pull_out(20.0, turn_deg=90.0, coast=LENGTH), random_rudder(20.0, duration=LENGTH),
    random_rudder(20.0, duration=LENGTH, seed=1), straight(),
]  # fmt: skip


@pytest.fixture(scope="module")
def rudders():
    records = roll_out(CalmWater(mariner()), MANOEUVRES)
    return {m.name: r["delta"] for m, r in zip(MANOEUVRES, records, strict=True)}


@pytest.mark.parametrize("manoeuvre", MANOEUVRES, ids=lambda m: m.name)
def test_the_kind_of_a_manoeuvre_is_guessed_from_its_rudder(manoeuvre, rudders):
    delta = rudders[manoeuvre.name]
    noise = 0.002 * np.random.default_rng(0).standard_normal(len(delta))
    assert guess_kind(delta) == manoeuvre.kind
    assert guess_kind(-delta + noise) == manoeuvre.kind
