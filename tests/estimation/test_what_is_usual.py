"""Sizes that are taken for usual before any run is seen."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from pytest import approx
from scipy.stats import rayleigh

from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.core.wind import AIR, COEFFICIENTS, WindAreas, wind_load
from manoeuvre_nn.estimation.coefficient_forces import own_unit
from manoeuvre_nn.estimation.coefficient_priors import WIND, own_prior, series_prior
from manoeuvre_nn.estimation.data_set import COEFFICIENT_SD_LEVELS
from manoeuvre_nn.estimation.marginal_likelihood import COEFFICIENT_SD_PRIOR
from manoeuvre_nn.estimation.run_states import RunStates
from manoeuvre_nn.ship.clarke import clarke_derivatives
from manoeuvre_nn.ship.mariner import mariner

SHIP = mariner().particulars


def test_a_model_heels_as_much_as_a_ship_and_rolls_faster_by_froudes_law():
    model = replace(SHIP, length=1.6, beam=0.23, draught=0.085)
    states = RunStates(("phi", "p"))
    assert states.own_start_sd(model) == approx(states.own_start_sd(SHIP) * [1.0, 10.0]), "1.6 m of 160 m"
    assert (states.own_start_sd(SHIP) > 0).all()


@pytest.mark.parametrize("angle", [0.0, 90.0])
def test_the_wind_is_expected_to_push_a_ship_as_blendermanns_cargo_ship_to_a_tenth(angle):
    """From ahead and from the side; from the bow quarter it turns the bow away from it, as he says too."""
    names = [(0, "wx |w|"), (1, "wy |w|"), (2, "wx wy")]
    mean, _ = series_prior([*names, (1, "u r")], SHIP)
    air = torch.tensor([np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))], dtype=torch.float64)  # of the ship
    x, y, _ = wind_load(SHIP.above_water, COEFFICIENTS["cargo_loaded"], *(air * SHIP.speed))
    unit = 0.5 * SHIP.rho * SHIP.length * SHIP.draught * SHIP.speed**2
    wx, wy = -air.numpy()  # of the air relative to the ship
    assert [mean[0] * wx, mean[1] * wy] == approx([float(x) / unit, float(y) / unit], rel=0.1, abs=1e-9)
    bow = torch.tensor(0.5**0.5 * SHIP.speed, dtype=torch.float64)
    *_, arm = wind_load(replace(SHIP.above_water, lateral_centre=0.0), COEFFICIENTS["cargo_loaded"], bow, -bow)
    assert mean[2] < 0 < float(arm)


def test_levels_of_the_coefficients_errors_stand_close_where_they_are_likely_and_end_where_they_are_not():
    usual, beyond = np.array(COEFFICIENT_SD_LEVELS[1:]), COEFFICIENT_SD_LEVELS[-1] / COEFFICIENT_SD_PRIOR
    assert (usual[1:] / usual[:-1] < 2.6).all()
    assert rayleigh.sf(beyond) < 1e-4 < rayleigh.sf(0.9 * beyond)


DRIFT, CIRCLE, HELM = np.sin(np.deg2rad(17.5)), 2 / 3.3, np.deg2rad(29.0)
"""A hard turn: drift of 17.5 deg on a circle of 3.3 lengths with 29 deg of helm."""
IN_A_HARD_TURN = [
    ("v", DRIFT), ("|v| v", DRIFT**2), ("|v| |v| v", DRIFT**3), ("r", CIRCLE), ("|r| r", CIRCLE**2),
    ("d", HELM), ("|d| d", HELM**2), ("u u v", 0.9**2 * DRIFT), ("a a v", 0.3**2 * DRIFT), ("1 n n v /U", DRIFT),
]  # fmt: skip
"""Products and their values, at nine tenths of the speed, three tenths off it, and the nominal shaft speed."""


@pytest.mark.parametrize("product, value", IN_A_HARD_TURN)
def test_a_product_of_which_nothing_is_known_adds_so_much_in_a_hard_turn_whatever_it_is_made_of(product, value):
    """A fiftieth of the unit ahead, a tenth to the side, a twentieth to the moment."""
    names = [(1, "u r"), (0, product), (1, product), (2, product)]
    _, spread = series_prior(names, SHIP, relative=1e-9)
    assert spread[1:] * value == approx([0.02, 0.1, 0.05], rel=0.05)


def test_what_pushes_a_ship_to_one_side_alike_in_turns_to_either_is_expected_to_be_a_fifth_as_large():
    names = [(1, "u r"), (1, "v v"), (1, "v"), (2, "v v"), (2, "v"), (0, "v v"), (0, "1"), (1, "1")]
    _, spread = series_prior(names, SHIP, relative=1e-9)
    assert spread[[1, 3]] * 0.3 / spread[[2, 4]] == approx(0.2, rel=1e-3)
    assert spread[5] == approx(0.02 / 0.3**2, rel=1e-3), "ahead everything is alike to port and to starboard"
    assert spread[6:] == approx([0.02, 0.1 * 0.2], rel=1e-3), "what pushes her ahead and aside on a straight course"


def test_the_winds_push_on_a_ship_is_known_to_half_of_a_drag_coefficient_of_one_and_her_turning_to_a_fifth_of_that():
    """Over the frontal area ahead, and over a fifth of the lateral one abeam, for which more is published."""
    names = [(1, "u r"), (0, "wx |w|"), (1, "wy |w|"), (2, "wx wy")]
    _, spread = series_prior(names, SHIP, relative=1e-9)
    unit = AIR / SHIP.rho / (SHIP.length * SHIP.draught)
    areas = SHIP.above_water
    assert spread[1:] == approx(
        0.5 * unit * np.array([areas.frontal, 0.2 * areas.lateral, 0.2 * areas.lateral]), rel=1e-6
    )


def test_small_published_coefficients_are_as_uncertain_as_a_fiftieth_of_the_largest_of_their_equation():
    ship = mariner()
    table = ship.table.detach().double().numpy().T * own_unit(ship)
    used, sizes = table != 0, np.abs(table)
    _, spread = own_prior(ship, 0.1)
    largest = (sizes.max(axis=1, keepdims=True) * np.ones_like(table))[used]
    small = sizes[used] < largest / 50
    assert small.any() and (~small).any()
    assert spread[small] == approx(0.1 * largest[small] / 50) and spread[~small] == approx(0.1 * sizes[used][~small])


def test_what_products_of_the_same_derivative_add_on_the_approach_is_clarkes_derivative():
    """Powers of u and n are one there. Where one of the products is the derivative itself it has all of it."""
    d = clarke_derivatives(SHIP)
    shared = [(1, "u v"), (1, "n v"), (1, "v v v"), (2, "v"), (2, "u v"), (1, "d n n"), (0, "d d"), (1, "u r")]
    mean, _ = series_prior(shared, SHIP)
    assert mean[:6] == approx([d["Yv"] / 2, d["Yv"] / 2, 0.0, d["Nv"], 0.0, -d["Yd"]])
    assert mean[6] == approx(SHIP.rudder_drag / 2)
    unknown = series_prior(shared, replace(SHIP, rudder_drag=None))[0]
    assert unknown[6] == approx(-d["Yd"]), "without a published one a rudder brakes by its angle times its side force"


def test_a_ship_turns_with_her_mass_whatever_the_product_is_that_stands_for_it():
    """-m u r in a series of products, -m (1 + a) r in one about the approach; m' = 2 C_b B / L in units of L^2 T."""
    mass, yaw = 2 * SHIP.block * SHIP.beam / SHIP.length, clarke_derivatives(SHIP)["Yr"]
    assert series_prior([(1, "u r"), (1, "v")], SHIP)[0][0] == approx(yaw - mass)
    assert series_prior([(1, "r"), (1, "a r"), (2, "a r")], SHIP)[0] == approx([yaw - mass, -mass, 0.0])


@pytest.mark.parametrize("kind", ["cargo_loaded", "container_loaded", "tanker_loaded", "tanker_ballast"])
def test_the_wind_loads_a_ship_as_blendermanns_curves_do_over_all_directions(kind):
    """X = c |w| wx, Y = c |w| wy and N = c wx wy, fitted to the curves; within a quarter, as ships of a kind differ."""
    areas, angle = WindAreas(400.0, 2000.0, 0.0, 150.0), torch.arange(1.0, 180.0, dtype=torch.float64) * DEGREE
    x, y = -torch.cos(angle), torch.sin(angle)  # of unit speed, towards which it blows
    surge, sway, arm = wind_load(areas, COEFFICIENTS[kind], -x, -y)
    unit = 0.5 * AIR
    loads = {
        "X wx |w|": (surge / (unit * areas.frontal), x),
        "Y wy |w|": (sway / (unit * areas.lateral), y),
        "N wx wy": (sway * arm / (unit * areas.lateral), x * y),
    }
    fitted = {name: float((load @ shape) / (shape @ shape)) for name, (load, shape) in loads.items()}
    assert fitted == {name: approx(c, rel=0.25) for name, c in WIND.items()}
