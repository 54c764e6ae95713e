"""Where a run is ended."""

import pytest
import torch

from manoeuvre_nn.core.units import KNOT
from manoeuvre_nn.dynamics.limits import OK, inside_physical_range
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.simulate import simulate
from manoeuvre_nn.manoeuvre.straight import straight
from manoeuvre_nn.ship.esso_190k import esso_190k


def test_a_slow_tanker_whose_shaft_turns_at_full_speed_may_gather_way():
    run = simulate(CalmWater(esso_190k()), straight(4000.0).at_speed(5 * KNOT))
    assert run.status == OK
    assert run["u"].max() > 2.5 * 5 * KNOT


@pytest.mark.parametrize("u, v, r, inside", [
    (2.45, 0.0, 0.0, True), (2.55, 0.0, 0.0, False), (-0.45, 0.0, 0.0, True), (-0.55, 0.0, 0.0, False),
    (1.0, -1.45, 0.0, True), (1.0, 1.55, 0.0, False), (0.5, 0.0, -2.95, True), (0.5, 0.0, 3.05, False),
    (float("nan"), 0.0, 0.0, False), (1.0, 0.0, float("inf"), False),
])  # fmt: skip
def test_no_ship_goes_faster_than_the_range_says_or_turns_twice_as_tightly_as_the_tightest_circle(u, v, r, inside):
    """Over U0 and U0/L; the tightest real circles have r L/U0 of 1.5."""
    ship = esso_190k().particulars
    state = torch.tensor([u * ship.speed, v * ship.speed, r / ship.time_unit, 9.0, 9.0, 9.0], dtype=torch.float64)
    assert bool(inside_physical_range(state, ship)) is inside
