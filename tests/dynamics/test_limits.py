"""Where a run is ended."""

from manoeuvre_nn.core.units import KNOT
from manoeuvre_nn.dynamics.limits import OK
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.simulate import simulate
from manoeuvre_nn.manoeuvre.straight import straight
from manoeuvre_nn.ship.esso_190k import esso_190k


def test_a_slow_tanker_whose_shaft_turns_at_full_speed_may_gather_way():
    run = simulate(CalmWater(esso_190k()), straight(4000.0).at_speed(5 * KNOT))
    assert run.status == OK
    assert run["u"].max() > 2.5 * 5 * KNOT
