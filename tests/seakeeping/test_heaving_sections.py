"""Waves that long cylinders make by heaving."""

import numpy as np
import pytest
from pytest import approx
from scipy.integrate import quad
from scipy.special import exp1

from manoeuvre_nn.core.units import GRAVITY
from manoeuvre_nn.seakeeping.strips import heaving_sections

RADIUS = 10.0


def semicircle(panels=20):
    return RADIUS * np.exp(1j * np.linspace(-np.pi / 2, 0, panels + 1))


def forces(contour, numbers):
    """Added mass and damping over w, both over rho pi R^2/2, at values of nu R."""
    frequency = np.sqrt(np.array(numbers) * GRAVITY / RADIUS)
    potential = heaving_sections(contour[None], frequency)[:, 0]
    force = -2 * potential @ (-1j * np.diff(contour)).imag / (np.pi * RADIUS**2 / 2)
    return force.real, -force.imag


def test_a_semicircle_that_heaves_fast_carries_half_the_water_of_a_whole_circle():
    # the free surface is then a plane of no pressure; Ursell 1949: 1 - 4/(3 pi nu R)
    added, damping = forces(semicircle(60), [15.0])
    assert added[0] == approx(1 - 4 / (3 * np.pi * 15.0), abs=0.02)
    assert damping[0] < 0.005


def test_a_semicircle_that_heaves_slowly_makes_the_waves_of_a_piston_as_wide_as_it_is():
    # wave height ratio nu B, hence damping rho w B^2 (Newman 1977, chapter 6), up to terms in nu R ln(nu R)
    numbers = np.array([0.0005, 0.002])
    _, damping = forces(semicircle(40), numbers)
    limit = (2 * RADIUS) ** 2 / (np.pi * RADIUS**2 / 2)
    np.testing.assert_allclose(damping, limit, rtol=0.02)
    assert abs(damping[0] / limit - 1) < abs(damping[1] / limit - 1)


def test_added_mass_grows_without_bound_as_the_motion_gets_slow():
    # far away the flow is that of a source as strong as the breadth: - 8/pi^2 ln(nu R) and a constant
    added, _ = forces(semicircle(40), [1e-4, 1e-3])
    assert (added[0] - added[1]) / np.log(10) == approx(8 / np.pi**2, rel=0.03)


@pytest.mark.parametrize("number", [0.25, 1.0])
def test_waves_far_away_carry_off_the_work_of_the_damping(number):
    # Haskind in two dimensions: B = |X|^2/(2 rho g V_g), with the force X of waves of 1 m and V_g = g/(2 w)
    contour, nu = semicircle(80), number / RADIUS
    omega = np.sqrt(nu * GRAVITY)
    points, steps = (contour[1:] + contour[:-1]) / 2, np.diff(contour)
    normal, length = -1j * steps / np.abs(steps), np.abs(steps)
    potential = heaving_sections(contour[None], np.array([omega]))[0, 0]
    # X = - rho int (g n_z e^(nu z) cos nu y + i w psi dphi_0/dn): both sides of a wave that runs along y
    height, side = np.exp(nu * points.imag), nu * points.real
    pressure = GRAVITY * height * np.cos(side) * normal.imag
    flow = 1j * GRAVITY * nu / omega * height * (np.cos(side) * normal.imag - np.sin(side) * normal.real)
    force = -2 * np.sum((pressure + 1j * omega * potential * flow) * length)
    _, damping = forces(contour, [number])
    radiated = abs(force) ** 2 * omega / GRAVITY**2
    assert omega * damping[0] * np.pi * RADIUS**2 / 2 == approx(radiated, rel=0.02)


def test_no_irregular_frequency_shows_up():
    # without a lid the added mass of a semicircle jumps near nu R = 1.8
    added, damping = forces(semicircle(12), np.linspace(1.2, 2.8, 60))
    assert np.abs(np.diff(added)).max() < 0.02
    assert np.all(np.diff(damping) < 0.005)


def test_finer_panels_change_little():
    (coarse, coarse_b), (fine, fine_b) = (forces(semicircle(n), [0.1, 0.5, 1.0]) for n in (10, 80))
    np.testing.assert_allclose(coarse, fine, rtol=0.04)
    np.testing.assert_allclose(coarse_b, fine_b, rtol=0.03)


def test_sections_do_not_know_of_each_other():
    frequency = np.array([0.5, 1.0])
    box = np.array([-8.0j, 5 - 8j, 10 - 8j, 10 - 4j, 10 + 0j])
    wedge = np.array([-8.0j, 1 - 6j, 2 - 4j, 3 - 2j, 4 + 0j])
    both = heaving_sections(np.stack([box, wedge]), frequency)
    np.testing.assert_allclose(both[:, 1], heaving_sections(wedge[None], frequency)[:, 0])


@pytest.mark.parametrize("a", [2 + 1j, 2 - 1j, 5 + 3j])
def test_the_principal_value_is_the_integral_over_the_pole(a):
    nu = 0.3
    integral = quad(lambda k: np.exp(-k * a).real, 0, 1, weight="cauchy", wvar=nu)[0]
    integral += quad(lambda k: np.exp(-k * a).real / (k - nu), 1, 60, limit=500)[0]
    closed = np.exp(-nu * a) * (exp1(-nu * a) + 1j * np.pi * np.sign((-nu * a).imag))
    assert closed.real == approx(integral, rel=1e-8)
