"""Motions of three ships computed elsewhere, if the file is there: set RECORDINGS to the folder beside it."""

import os
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from fleet import unchecked
from pytest import approx

from manoeuvre_nn.core.manoeuvre import Manoeuvre, Stage
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.ship.esso_190k import esso_190k
from manoeuvre_nn.ship.great_lakes_bulker import great_lakes_bulker
from manoeuvre_nn.ship.mariner import mariner_corrected

MOTIONS = Path(os.environ.get("RECORDINGS", "nowhere")).parent / "concealed" / "check_motions.csv"
SHIPS = {"mariner": mariner_corrected, "great_lakes_bulker": great_lakes_bulker, "esso_tanker": esso_190k}

pytestmark = [
    pytest.mark.recordings,
    pytest.mark.skipif("RECORDINGS" not in os.environ or not MOTIONS.exists(), reason="set RECORDINGS=folder"),
]


@pytest.mark.parametrize("name", SHIPS)
def test_the_ships_move_as_computed_elsewhere(name):
    """20 deg of rudder to starboard, at 150 s to port; the file's rudder is positive to port."""
    table = pd.read_csv(MOTIONS)
    table = table[table.ship == name]
    stages = (Stage(20 * DEGREE, hold=150.0), Stage(-20 * DEGREE))
    speed = float(table.u.iloc[0])
    trial = Manoeuvre("check", "random_rudder", stages, duration=float(table.t.max()), speed=speed)
    with unchecked():
        (run,) = roll_out(CalmWater(SHIPS[name]()), [trial])
    at = np.searchsorted(run.time, table.t)
    assert run["delta"][at] / DEGREE == approx(-table.delta.to_numpy(), abs=1e-3)
    for channel, unit, digits in [("x", 1, 1e-3), ("y", 1, 1e-3), ("u", 1, 1e-5), ("v", 1, 1e-5)]:
        assert run[channel][at] / unit == approx(table[channel].to_numpy(), abs=20 * digits), channel
    assert run["psi"][at] / DEGREE == approx(table.psi.to_numpy(), abs=2e-3)
    assert run["r"][at] / DEGREE == approx(table.r.to_numpy(), abs=2e-5)
