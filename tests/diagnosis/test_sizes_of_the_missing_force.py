"""How large a missing force must be to be told, and how large it may be where the recordings say nothing."""

from dataclasses import replace

import numpy as np
import pytest
from pytest import approx
from trials import CALM, CIRCLE, SHIP, runs, values

from manoeuvre_nn.diagnosis import locate
from manoeuvre_nn.effect.local import SideForce
from manoeuvre_nn.estimation.data_set import whitened_data_set
from manoeuvre_nn.estimation.hypothesis import Hypothesis

pytestmark = pytest.mark.usefixtures("unchecked_types")
NONE = Hypothesis((), ())


@pytest.mark.parametrize("size, found", [(0.38, []), (0.42, [(100.0, 200.0)])])
def test_a_force_in_exact_recordings_has_times_from_four_tenths_of_its_standard_error_on(size, found):
    """Four times the least scatter of means over ten seconds, a tenth."""
    force = np.zeros((400, 3))
    force[100:200, 1] = size
    assert locate.changes(np.arange(400.0), force, np.ones((400, 3))) == found


def test_where_instruments_say_nothing_a_run_begins_with_half_the_resistance_of_missing_force():
    """They are worse than usual by a hundred thousand."""
    data_set = whitened_data_set(CALM, runs([CIRCLE]))
    data_set.runs = [replace(p, noise=1e5 * p.noise) for p in data_set.runs]
    (found,) = locate.residuals(data_set, NONE)
    assert found.error[:, 0] == approx(0.5 * locate.unit_forces(data_set)[0], rel=0.05)


def test_a_force_that_was_found_is_missing_as_much_as_before_it_was():
    """It turns and moves the ship, and only what a stream or a sensor does is taken out."""
    push = SideForce(SHIP, force_kN=150.0, lever_m=30.0, start_s=83.0, end_s=157.0)
    data_set = whitened_data_set(CALM, runs([CIRCLE], [push]))
    (found,) = locate.residuals(data_set, Hypothesis((push,), (values(push),)))
    (blind,) = locate.residuals(data_set, NONE)
    assert found.force == approx(blind.force, abs=1e-6 * np.abs(blind.force).max())
