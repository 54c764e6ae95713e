import numpy as np
import pytest
from pytest import approx

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.units import DEGREE, GRAVITY
from manoeuvre_nn.seakeeping.froude_krylov import encounter_frequency, sway_and_yaw
from manoeuvre_nn.seakeeping.hull import Hull, immerse
from studies.wang1996.offsets import BOTTOM_TANGENT, HALF_BREADTHS, KEEL, STATIONS, wang_hull

L, B, T, RHO = 100.0, 16.0, 6.0, 1000.0
BARGE = Hull(np.array([-L / 2, L / 2]), np.array([0.0, 10.0]), np.full((2, 2), B / 2))
FREQUENCY = np.array([0.3, 0.65, 1.0])
WANG = immerse(wang_hull(), 8.138)


def faces(frequency, heading):
    """Sway force and yaw moment of the barge: the pressure on its four vertical sides, one after the other."""
    k = frequency**2 / GRAVITY
    a, s = k * np.cos(heading), k * np.sin(heading)
    x, y = np.linspace(-L / 2, L / 2, 20001), np.linspace(-B / 2, B / 2, 20001)
    depth = RHO * GRAVITY * (1 - np.exp(-k * T)) / k

    def pressure(x, y):
        return depth * np.exp(-1j * (a * x + s * y))

    starboard, port = pressure(x, B / 2), pressure(x, -B / 2)
    bow, stern = pressure(L / 2, y), pressure(-L / 2, y)
    sway = np.trapezoid(port - starboard, x)
    # N = x Fy - y Fx, and the bow is pushed astern.
    return sway, np.trapezoid(x * (port - starboard), x) + np.trapezoid(y * (bow - stern), y)


@pytest.mark.parametrize("heading_deg", [0.0, 30.0, 90.0, 135.0, 180.0, 250.0])
def test_the_barge_feels_the_pressure_on_its_four_sides(heading_deg):
    ours = sway_and_yaw(immerse(BARGE, T, 400, 200), FREQUENCY, heading_deg * DEGREE, RHO)
    for at, frequency in enumerate(FREQUENCY):
        sway, yaw = faces(frequency, heading_deg * DEGREE)
        largest = RHO * GRAVITY * L * T
        assert abs(ours[0, at] - sway) < 1e-4 * largest
        assert abs(ours[1, at] - yaw) < 1e-4 * largest * L


@pytest.mark.parametrize("frequency", FREQUENCY)
def test_the_barge_in_beam_seas_has_the_force_in_closed_form_and_no_moment(frequency):
    k = frequency**2 / GRAVITY
    exact = 2j * RHO * GRAVITY * np.sin(k * B / 2) * L * (1 - np.exp(-k * T)) / k
    force, moment = sway_and_yaw(immerse(BARGE, T, 10, 400), np.array([frequency]), np.pi / 2, RHO)[:, 0]
    assert force == approx(exact, rel=1e-6)
    assert abs(moment) < 1e-9 * abs(exact) * L


@pytest.mark.parametrize("heading_deg", [30.0, 60.0, 120.0])
def test_the_barge_in_oblique_seas_has_the_force_in_closed_form(heading_deg):
    k, heading = 0.65**2 / GRAVITY, heading_deg * DEGREE
    along = k * L * np.cos(heading) / 2
    exact = 2j * RHO * GRAVITY * np.sin(k * np.sin(heading) * B / 2) * (1 - np.exp(-k * T)) / k * L
    exact *= np.sin(along) / along
    force = sway_and_yaw(immerse(BARGE, T, 1000, 100), np.array([0.65]), heading, RHO)[0, 0]
    assert force == approx(exact, rel=1e-5)


@pytest.mark.parametrize("hull", [immerse(BARGE, T), WANG])
def test_head_and_following_seas_push_neither_sideways_nor_round(hull):
    for heading in (0.0, np.pi):
        force, moment = sway_and_yaw(hull, FREQUENCY, heading)
        assert np.abs(force).max() < 1e-6
        assert np.abs(moment).max() < 1e-4


@pytest.mark.parametrize("heading_deg", [20.0, 90.0, 160.0])
def test_in_long_waves_the_force_is_the_weight_on_the_slope_of_the_wave(heading_deg):
    k = 1e-6
    frequency = np.array([np.sqrt(k * GRAVITY)])
    force = sway_and_yaw(WANG, frequency, heading_deg * DEGREE, RHO)[0, 0]
    # A crest at the ship at time 0: a quarter of a period before, the surface falls in the direction of travel.
    exact = 1j * RHO * GRAVITY * WANG.volume * k * np.sin(heading_deg * DEGREE)
    assert force == approx(exact, rel=1e-3)
    assert force.imag > 0


def test_waves_from_the_other_side_turn_force_and_moment_round():
    for heading in np.linspace(0.1, 3.0, 7):
        np.testing.assert_allclose(sway_and_yaw(WANG, FREQUENCY, -heading), -sway_and_yaw(WANG, FREQUENCY, heading))


def test_a_hull_turned_end_for_end_answers_to_waves_from_the_other_end():
    table = wang_hull()
    turned = Hull(-table.stations[::-1], table.waterlines, table.half_breadths[::-1])
    (force, moment), (force_2, moment_2) = (
        sway_and_yaw(immerse(h, 8.138), FREQUENCY, a) for h, a in ((table, 0.7), (turned, np.pi - 0.7))
    )
    np.testing.assert_allclose(force_2, force, rtol=1e-9)
    np.testing.assert_allclose(moment_2, -moment, rtol=1e-9)


def test_the_source_s_wave_on_its_ship():
    force, moment = 0.503 * np.abs(sway_and_yaw(WANG, np.array([0.65]), 135 * DEGREE, 1000.0)[:, 0])
    assert force == approx(1.32e6, rel=0.005)
    assert moment == approx(44e6, rel=0.01)
    angles = np.arange(0, 181)
    forces = [0.503 * abs(sway_and_yaw(WANG, np.array([0.65]), a * DEGREE, 1000.0)[0, 0]) for a in angles]
    assert angles[np.argmax(forces)] == 90
    assert max(forces) == approx(3.0e6, rel=0.01)


def test_twice_as_fine_a_cut_changes_nothing_that_matters():
    coarse, fine = (sway_and_yaw(immerse(wang_hull(), 8.138, *n), FREQUENCY, 2.0) for n in ((200, 40), (400, 80)))
    np.testing.assert_allclose(coarse, fine, rtol=5e-3, atol=1e-3 * np.abs(fine).max(axis=1, keepdims=True).min())


def test_the_offsets_are_those_of_the_table():
    table = wang_hull()
    assert 2 * table.half_breadths.max() == approx(24.08, abs=0.01)
    assert len(STATIONS) == len(KEEL) == len(HALF_BREADTHS) == len(table.stations)
    bow, stern = table.half_breadth(np.array([76.2 - 1e-9, -76.2]), np.array([9.754]))[:, 0]
    assert (bow, stern) == (approx(0.133, abs=1e-6), approx(2.130))
    midship = table.half_breadth(np.array([0.0]), np.array([0.0, 1.219]))
    np.testing.assert_allclose(midship, [[BOTTOM_TANGENT[5], 11.417]])
    between = table.half_breadth(np.array([0.5 * 15.24]), np.array([(4.877 + 7.315) / 2]))
    assert between[0, 0] == approx((11.830 + 11.986 + 12.039 + 12.039) / 4)
    assert np.all(np.diff(table.stations) > 0)


def test_the_barge_displaces_its_box():
    assert immerse(BARGE, T).volume == approx(L * B * T)


def test_head_seas_are_met_more_often_and_following_ones_less():
    k = 0.65**2 / GRAVITY
    for heading, expected in ((np.pi, 0.65 + k * 7.6), (0.0, 0.65 - k * 7.6), (np.pi / 2, 0.65)):
        assert encounter_frequency(np.array(0.65), heading, 7.6) == approx(expected)


@pytest.mark.parametrize("draught", [0.0, 13.0])
def test_a_draught_outside_the_table_is_refused(draught):
    with pytest.raises(InputError, match="write 0 to 12.192 m"):
        immerse(wang_hull(), draught)
