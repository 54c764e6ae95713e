"""Hull forms made of coefficients, and their panels."""

from dataclasses import replace

import numpy as np
import pytest
from pytest import approx

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.units import GRAVITY, SEA_WATER
from manoeuvre_nn.seakeeping.form import S175, HullForm, estimated_form
from manoeuvre_nn.seakeeping.hull import immerse
from manoeuvre_nn.seakeeping.panels import MAX_DRAUGHT, panelled
from manoeuvre_nn.ship.esso_190k import esso_190k
from manoeuvre_nn.ship.mariner import mariner

BALANCED = HullForm(100.0, 16.0, 6.0, 0.6, 0.75, 0.97, 0.0, 0.0, 0.25, 6.0)
"""Fore and after body alike."""
FORMS = [S175, BALANCED, estimated_form(mariner().particulars), estimated_form(esso_190k().particulars)]


def moments(form, draught):
    """Volume, LCB, waterplane area, LCF by quadrature over a fine table."""
    hull = form.offsets(801, 401)
    z = draught * np.linspace(0, 1, 801) ** 3
    half = hull.half_breadth(hull.stations, z)
    area, line = 2 * np.trapezoid(half, z, axis=1), 2 * half[:, -1]
    volume, plane = np.trapezoid(area, hull.stations), np.trapezoid(line, hull.stations)
    x = hull.stations
    return volume, np.trapezoid(area * x, x) / volume, plane, np.trapezoid(line * x, x) / plane


@pytest.mark.parametrize("form", FORMS)
def test_a_form_has_the_coefficients_that_it_was_made_of(form):
    volume, centre, plane, flotation = moments(form, form.draught)
    assert volume / (form.length * form.breadth * form.draught) == approx(form.block, rel=3e-3)
    assert plane / (form.length * form.breadth) == approx(form.waterplane, rel=1e-3)
    assert centre == approx(form.centre, abs=1.5e-3 * form.length)
    assert flotation == approx(form.flotation, abs=1e-3 * form.length)
    midship = 2 * np.trapezoid(form.half_breadth(np.array([0.0]), z := form.draught * np.linspace(0, 1, 4001) ** 3), z)
    assert midship[0] == approx(form.midship * form.breadth * form.draught, rel=2e-3)


def test_the_part_under_water_of_its_table_displaces_what_the_block_coefficient_says():
    assert immerse(S175.offsets(), 9.5, 400, 80).volume == approx(0.573 * 175 * 25.4 * 9.5, rel=3e-3)


def test_a_deeper_ship_has_a_larger_waterplane_and_a_fuller_body():
    shallow, deep = moments(S175, 5.0), moments(S175, 11.0)
    assert shallow[2] < S175.waterplane * 175 * 25.4 < deep[2]
    assert shallow[0] / 5.0 < deep[0] / 11.0


@pytest.mark.parametrize("draught", [5.0, 9.5, 11.0])
def test_panels_close_and_carry_the_ship(draught):
    hull = panelled(S175, draught, 56, 16)
    volume, centre, plane, flotation = moments(S175, draught)
    assert hull.volume == approx(volume, rel=6e-3)
    assert hull.buoyancy[0] == approx(centre, abs=0.2)
    assert np.sum(hull.directed_area[:, 0]) == approx(0.0, abs=1e-9)  # no thrust from a closed hull
    assert np.all(hull.directed_area[:, 1] >= -1e-9)  # the port side looks to port
    x = hull.centre[:, 0]
    assert 2 * np.sum(x * hull.directed_area[:, 0]) == approx(hull.volume, rel=1e-3)
    weight = SEA_WATER * GRAVITY
    assert hull.restoring[1, 1] == approx(weight * plane, rel=3e-3)
    assert hull.restoring[1, 2] == approx(-weight * plane * (flotation - centre), rel=0.05)
    assert hull.mass[0, 0] == approx(SEA_WATER * hull.volume)


def test_the_longitudinal_metacentric_height_is_near_the_published_one():
    # 204.4 m: ShipX, design waterline of the S-175 (MSS toolbox, HYDRO/vessels_shipx/s175/s175.hyd)
    hull = panelled(S175, 9.5, 56, 12)
    assert hull.restoring[2, 2] / (hull.mass[0, 0] * GRAVITY) == approx(204.4, rel=0.05)


def test_a_higher_centre_of_gravity_takes_its_height_off_the_metacentric_height():
    low = panelled(S175, 9.5, 56, 12)
    high = replace(low, weight_depth=low.weight_depth + 3.0)
    weight = SEA_WATER * GRAVITY * low.volume
    assert low.restoring[2, 2] - high.restoring[2, 2] == approx(3.0 * weight)
    at_buoyancy = replace(low, weight_depth=low.buoyancy[1])  # GM = BM, of the waterplane alone
    x, plane = low.centre[:, 0] - low.buoyancy[0], -2 * low.directed_area[:, 2]
    assert at_buoyancy.restoring[2, 2] == approx(SEA_WATER * GRAVITY * np.sum(plane * x**2))


@pytest.mark.parametrize(
    "change, message",
    [
        ({"breadth": 180.0}, "length > breadth > draught"),
        ({"block": 0.75}, "block < waterplane < 1"),
        ({"centre": 40.0}, r"no hull has this block coefficient and LCB \(form.block, form.centre\): "),
        ({"flotation": -60.0}, r"coefficient and LCF \(form.waterplane, form.flotation\): fullness"),
        ({"gyradius": 0.5}, "gyradius 0.5 and"),
        ({"weight_height": float("nan")}, "weight_height nan: write"),
    ],
)
def test_what_is_no_hull_is_refused(change, message):
    with pytest.raises(InputError, match=message):
        replace(S175, **change)


def test_a_ship_may_lie_as_deep_as_her_sides_reach_and_no_deeper():
    assert panelled(S175, MAX_DRAUGHT * S175.draught).vertices[..., 2].max() == 0.0
    with pytest.raises(InputError, match="write 0 to 13.3 m"):
        panelled(S175, 14.0)


@pytest.mark.parametrize("block", [0.36, 0.5, 0.65, 0.8, 0.91])
def test_any_ship_has_a_form(block):
    form = estimated_form(replace(mariner().particulars, block=block))
    volume, centre, *_ = moments(form, form.draught)
    assert volume / (form.length * form.breadth * form.draught) == approx(block, rel=0.01)
    assert centre == approx(form.centre, abs=0.005 * form.length)
