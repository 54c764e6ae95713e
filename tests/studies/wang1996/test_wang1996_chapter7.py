"""Wang 1996, chapter 7, done again."""

from functools import cache

import numpy as np
import pytest
from pytest import approx

from manoeuvre_nn.seakeeping.froude_krylov import encounter_frequency, sway_and_yaw
from manoeuvre_nn.seakeeping.hull import immerse
from manoeuvre_nn.ship.mariner import mariner
from studies.reproduction.section import ComputingEffort
from studies.wang1996.chapter7 import chapter
from studies.wang1996.free_decay import autocorrelation, decay_rate, free_modes
from studies.wang1996.offsets import wang_hull
from studies.wang1996.sway_yaw import (
    START,
    STEP,
    linear,
    nonlinear,
    sail,
    sea,
    simplest,
    to_heading,
    wave_force,
)

SHIP = mariner()


@cache
def voyages():
    return sail(SHIP, [simplest(SHIP), linear(SHIP), nonlinear(SHIP)], 40, 0)


@cache
def section():
    said = []
    result = chapter(ComputingEffort(quick=True), said.append)
    assert said
    return result


def claims(text, where=""):
    return [c for c in section().claims if text in c.what and where in c.where]


def test_coefficients_of_the_simplest_system():
    np.testing.assert_allclose(simplest(SHIP).matrix, [[-0.03728, 0], [0, -0.10697]], atol=1e-5)


def test_coefficients_and_roots_of_the_linear_system():
    matrix = linear(SHIP).matrix
    assert (matrix[0, 0], matrix[1, 1]) == (approx(-0.03690, abs=1e-5), approx(-0.10897, abs=1e-5))
    modes = free_modes(matrix, START)
    np.testing.assert_allclose(modes.rates, [-0.13517, -0.01069], atol=1e-5)
    np.testing.assert_allclose(modes.amplitudes[0], [-0.176, 1.176], atol=5e-4)
    assert (matrix @ START)[0] == approx(0.0112, abs=5e-5)


def test_the_equations_as_printed_have_complex_roots():
    assert np.abs(np.linalg.eigvals(linear(SHIP, bare=True).matrix).imag).max() > 0.01


def test_the_nonlinear_system_is_the_linear_one_for_small_motions_and_without_its_constants():
    free, matrix = nonlinear(SHIP).free, linear(SHIP).matrix
    small = 1e-4 * START
    np.testing.assert_allclose(free(small[None])[0] - free(0 * small[None])[0], matrix @ small, rtol=1e-5)


def test_accelerations_of_the_nonlinear_system_are_those_of_the_equations_in_full():
    v, r = START[0] / 7.614, START[1] * 152.4 / 7.614
    y = -0.0008 - 0.244 * v - 10.212 * v**3 / 6 - 0.105 * r + 6.46 * r * v**2 / 2
    n = 0.00059 - 0.0555 * v + 2.07 * v**3 / 6 - 0.03747 * r - 2.316 * r * v**2 / 2
    vdot, rdot = np.linalg.solve([[0.327, 0.00077], [-0.00221, 0.0175]], [y, n])
    unit = 7.614**2 / 152.4
    np.testing.assert_allclose(nonlinear(SHIP).free(START[None])[0], [vdot * unit, rdot * unit / 152.4], rtol=1e-9)


@pytest.mark.slow
def test_a_long_voyage_in_waves_ends_in_the_answer_of_the_transfer_function():
    waves, system = sea(1), simplest(SHIP)
    heading, p = to_heading(45.0), SHIP.particulars
    transfer = sway_and_yaw(immerse(wang_hull(), p.draught), waves.frequency, heading, p.rho)
    met = encounter_frequency(waves.frequency, heading, p.speed)
    inertia = 0.5 * p.rho * p.length**2 * p.draught * np.array([0.327, 0.0175 * p.length**2])
    trip = voyages()["simplest"]
    for channel, rate in enumerate(np.diag(system.matrix)):
        answer = waves.record(trip.time, transfer[channel] / inertia[channel] / (1j * met - rate), met)[0]
        late = trip.waves[45.0][0, -80:, channel]
        assert np.abs(late - answer[-80:]).max() < 2e-3 * np.abs(answer).max()


def test_waves_at_zero_degrees_come_from_ahead_and_push_nowhere():
    assert np.abs(wave_force(SHIP, sea(1), 0.0, np.arange(5.0))).max() < 1e-12
    assert encounter_frequency(np.array(0.65), to_heading(0.0), 7.614) > 0.65


def test_mirrored_seas_give_mirrored_motions_of_the_linear_system():
    time, waves = np.linspace(0, 50, 401), sea(2)
    port, starboard = (wave_force(SHIP, waves, a, time) for a in (60.0, -60.0))
    system = linear(SHIP)
    free = system.sail(0 * port)
    np.testing.assert_allclose(system.sail(port) - free, -(system.sail(starboard) - free), atol=1e-12)


def test_a_step_half_as_long_changes_nothing():
    waves, coarse = sea(2), np.linspace(0, 50, 401)
    fine = np.linspace(0, 50, 801)
    for system in (linear(SHIP), nonlinear(SHIP)):
        one = system.sail(wave_force(SHIP, waves, 45.0, coarse))
        two = system.sail(wave_force(SHIP, waves, 45.0, fine), STEP / 2)[:, ::2]
        np.testing.assert_allclose(one, two, rtol=0, atol=2e-4 * np.abs(two).max((0, 1)).min())


@pytest.mark.parametrize("channel, span, rate", [(0, 30, -0.0374), (1, 15, -0.1078)])
def test_twenty_autocorrelations_in_waves_at_45_degrees_come_near(channel, span, rate):
    record = voyages()["simplest"].waves[45.0][:20, :401, channel]
    mean = autocorrelation(record, int(span / STEP)).mean(0)
    assert decay_rate(mean, STEP) == approx(rate, rel=0.03)


@pytest.mark.slow
def test_what_the_source_gives_as_its_numbers_is_met():
    for text in ("amplitude at .65", "significant height of the spectrum", "wave length"):
        assert [c.verdict for c in claims(text)] == ["holds"]


@pytest.mark.slow
def test_rates_come_back_from_autocorrelations_without_waves_within_a_ten_thousandth():
    free = claims("without waves", "Eqs 7.31") + claims("without waves", "Eqs 7.45")
    assert len(free) == 6
    assert all(c.verdict == "holds" and abs(c.difference) < 1e-4 for c in free)


@pytest.mark.slow
def test_a_single_record_serves_where_the_waves_hardly_move_the_ship_and_nowhere_else():
    assert claims("a22, one record, 90 deg", "7.5")[0].verdict == "holds"
    assert claims("a11, one record, 45 deg", "7.5")[0].verdict == "holds"
    for text in ("a11, one record, 90", "a11, one record, 135", "a22, one record, 135"):
        assert claims(text, "7.5")[0].verdict == "does not hold"


@pytest.mark.slow
def test_averaging_the_records_beats_averaging_their_autocorrelations():
    rows = section().tables["Simplest system: rates from waves [1/s], spread over seas"]

    def error(rate, angle, way):
        (row,) = [r for r in rows if (r["rate"], r["angle [deg]"], r["T* [s]"], r["from"]) == (rate, angle, 100.0, way)]
        return abs(row["median"] / row["true"] - 1)

    for rate, angle in (("a11", 90.0), ("a11", 135.0), ("a22", 135.0)):
        assert error(rate, angle, "20 records") < 0.7 * error(rate, angle, "20 autocorrelations")


@pytest.mark.slow
def test_every_figure_of_the_chapter_is_drawn_once():
    names = [p.name for p in section().plots]
    assert len(names) == len(set(names))
    assert {f"figure_7_{n}" for n in (1, *range(3, 20))} <= set(names)
    for plot in section().plots:
        for panel in plot.panels:
            assert all(np.isfinite(line.y).all() and line.x.shape == line.y.shape for line in panel.lines)


@pytest.mark.slow
def test_every_claim_that_does_not_hold_says_why():
    assert all(c.why for c in section().claims if c.verdict != "holds")
    assert all(not isinstance(c.ours, float) or np.isfinite(c.ours) for c in section().claims)
