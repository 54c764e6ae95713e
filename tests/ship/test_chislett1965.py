"""The widely used Mariner set against a published result."""

import pytest

from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.simulate import simulate
from manoeuvre_nn.manoeuvre.criteria import criteria
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.ship.mariner import CHISLETT, mariner_chislett1965


def test_fifteen_degrees_to_port_give_the_steady_turning_radius_of_fossens_worked_example():
    turn = turning_circle(15.0, "port", duration=900.0)
    circle = simulate(CalmWater(mariner_chislett1965()), turn)
    diameter = criteria(circle, "turning_circle", CHISLETT.length)["steady_diameter_L"] * CHISLETT.length
    # Fossen, Marine Control Systems, turning circle of the Mariner at 15 kn with -15 deg: steady turning radius 711 m.
    assert diameter / 2 == pytest.approx(711.0, abs=0.5)
