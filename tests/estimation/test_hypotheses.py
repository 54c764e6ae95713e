"""Hypotheses: what is free in them, and what bounds are worth."""

from math import log, sqrt

import numpy as np
import pytest
from pytest import approx
from scipy.stats import cauchy, norm

from manoeuvre_nn.effect.current import Current
from manoeuvre_nn.effect.local import SideForce
from manoeuvre_nn.effect.rudder import RudderOffset
from manoeuvre_nn.estimation.hypothesis import MEDIAN_OF_GAUSSIAN, Hypothesis
from manoeuvre_nn.estimation.marginal_likelihood import _bounded
from manoeuvre_nn.ship.mariner import mariner

SHIP = mariner()


def hypothesis(effect, runs=1, **more):
    return Hypothesis((effect,), (np.tile(effect.values.numpy(), (runs, 1)),), **more)


def test_what_is_not_of_a_run_is_one_number_in_each_campaign():
    free = hypothesis(RudderOffset(SHIP, offset_deg=1.0), runs=3, campaigns=(0, 1, 0)).unknowns()
    assert [f.runs for f in free] == [(0, 2), (1,)]
    assert [f.runs for f in hypothesis(RudderOffset(SHIP), runs=3).unknowns()] == [(0, 1, 2)]


@pytest.mark.parametrize("value", [34.0, 0.0])
def test_bounds_are_worth_the_share_of_the_posterior_inside_them_over_that_of_the_prior(value):
    """The offset's prior is Cauchy's of the scale of a Gaussian's median, its posterior a Gaussian."""
    h, step, sd = hypothesis(RudderOffset(SHIP, offset_deg=value)), 0.5, 1.2
    (p,) = h.effects[0].declared
    inside = norm(value + step, sd).cdf([p.low, p.high])
    before = cauchy(p.null, MEDIAN_OF_GAUSSIAN * p.spread).cdf([p.low, p.high])
    expected = log(inside[1] - inside[0]) - log(before[1] - before[0])
    assert _bounded(h, np.array([step]), np.array([sd**2])) == approx(expected, abs=1e-6)


def test_a_direction_has_no_bounds_to_be_worth_anything():
    h = hypothesis(Current(SHIP, speed=1.0, toward_deg=359.0))
    step, variance = np.array([0.0, 0.0]), np.array([0.01, 25.0])
    speed = h.effects[0].declared[0]
    alone = log(norm(1.0, 0.1).cdf(speed.high) - norm(1.0, 0.1).cdf(speed.low))
    gamma = MEDIAN_OF_GAUSSIAN * speed.spread / sqrt(3)
    before = 1 - gamma / sqrt(gamma**2 + speed.high**2)  # of a bivariate Cauchy's vectors, those within the range
    assert _bounded(h, step, variance) == approx(alone - log(before), abs=1e-6)


@pytest.mark.parametrize("off", [0.0, 1e-9])
def test_a_step_is_a_ramp_at_its_null_however_it_was_rounded_and_no_value_on_a_bound(off):
    """The shortest ramp is a step; the longest one is the end of what is possible, and so is the lever's."""
    push = SideForce(SHIP, force_kN=100.0, lever_m=20.0, start_s=50.0, end_s=90.0)
    names = [p.name for p in push.declared]
    h = hypothesis(push)
    h.values[0][0, names.index("ramp_s")] = 1.0 + off
    assert h.on_bounds() == []
    h.values[0][0, names.index("ramp_s")] = 1800.0 - off
    h.values[0][0, names.index("lever_m")] = -0.6 * SHIP.particulars.length + off
    assert [f.parameter.name for f, _ in h.on_bounds()] == ["lever_m", "ramp_s"]
