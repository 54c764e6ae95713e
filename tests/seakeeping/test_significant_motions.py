"""Significant heave and pitch in random seas."""

from dataclasses import replace

import numpy as np
import pytest
from fleet import unchecked
from pytest import approx
from tiers import mainly

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.units import GRAVITY, KNOT
from manoeuvre_nn.seakeeping import pitch as module
from manoeuvre_nn.seakeeping.closed_form import box_motions
from manoeuvre_nn.seakeeping.form import S175, estimated_form
from manoeuvre_nn.seakeeping.motions import heave_and_pitch
from manoeuvre_nn.seakeeping.panels import panelled
from manoeuvre_nn.seakeeping.pitch import WAVES, significant_motions, significant_pitch, transfer_functions
from manoeuvre_nn.seakeeping.spectra import WaveSpectrum
from manoeuvre_nn.seakeeping.strips import radiate_strips
from manoeuvre_nn.ship.mariner import mariner

QUICK = ("closed_form", "strip_theory")


@pytest.fixture(autouse=True, scope="module")
def few_frequencies():
    """Enough for what is tested here."""
    module._solved.cache_clear()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "MOTIONS", np.array([0.02, 0.1, 0.25, 0.4, 0.55, 0.7, 0.85, 1.0, 1.2, 1.5, 2.0, 3.0]))
        yield
    module._solved.cache_clear()


def conditions(*rows):
    """Draught [m], speed [kn], heading [deg], height [m], period [s]."""
    return np.array(rows, dtype=float) * [1.0, KNOT, np.pi / 180, 1.0, 1.0]


@pytest.mark.parametrize("method", QUICK)
def test_on_very_long_seas_the_ship_heaves_with_the_sea(method):
    heave = significant_motions(conditions((9.0, 0, 180, 4.0, 30.0)), method)[0, 0]
    # a significant amplitude is half a significant height; the sea's short waves do not lift the ship
    assert 0.96 < heave / (4.0 / 2) < 1.0


def test_a_narrow_spectrum_gives_twice_the_root_of_its_variance(monkeypatch):
    # a single wave of amplitude a has m0 = a^2/2 |H|^2
    at, amplitude, row = 70, 1.5, conditions((9.0, 10, 180, 3.0, 9.0))
    step = (WAVES[at + 1] - WAVES[at - 1]) / 2
    peak = np.where(np.arange(len(WAVES)) == at, amplitude**2 / 2 / step, 0.0)
    monkeypatch.setattr(WaveSpectrum, "density", lambda self, frequency: peak)
    single = box_motions(S175, WAVES, row[:, 0], row[:, 1], row[:, 2])[0, at]
    motions = significant_motions(row, "closed_form")[0]
    np.testing.assert_allclose(motions, 2 * amplitude / np.sqrt(2) * single)


@pytest.mark.parametrize("method", QUICK)
def test_pitch_goes_with_the_height_of_the_sea(method):
    low, high = significant_pitch(conditions((8.0, 10, 150, 2, 9), (8.0, 10, 150, 5, 9)), method)
    assert high == approx(2.5 * low)


@pytest.mark.parametrize("method", QUICK)
def test_head_seas_pitch_a_fast_ship_more_than_following_and_beam_seas(method):
    head, following, beam = significant_pitch(
        conditions((9.5, 20, 180, 4, 10.5), (9.5, 20, 0, 4, 10.5), (9.5, 20, 90, 4, 10.5)), method
    )
    assert head > 1.3 * following > 1.3 * beam


def test_strips_come_near_the_program_that_the_paper_took_its_records_from():
    # Cepowski 2007, eq. 3 (heading turned round), at d 7 m, 20 kn, H_s 5 m, T 10.5 s; the formula itself is .12 deg off
    headings = (0, 30, 60, 120, 150, 180)
    formula = np.array([1.65, 1.84, 1.83, 2.48, 2.98, 2.99])
    ours = np.rad2deg(significant_pitch(conditions(*((7, 20, h, 5, 10.5) for h in headings)), "strip_theory"))
    np.testing.assert_allclose(ours, formula, atol=0.3)


@pytest.mark.parametrize("draught", mainly(2, [6.37, 8.8, 5.0, 11.0]))
def test_between_the_solved_draughts_the_answer_is_that_of_a_ship_of_that_draught(draught):
    row = np.array([[draught, 7.0, 2.5]])
    hull = panelled(S175, draught, girthwise=10)
    direct = heave_and_pitch(radiate_strips(hull, module.MOTIONS), WAVES, 7.0, 2.5)
    between = transfer_functions(S175, WAVES, row)[0]
    assert np.abs(between - direct)[:, 0].max() < 0.04
    # .001 rad on waves of 1 m is .03 deg; in a sea the errors of the frequencies cancel
    sea = WaveSpectrum.bretschneider(4.0, 9.0).density(WAVES)
    expected = 2 * np.sqrt(np.trapezoid(sea * np.abs(direct[:, 1]) ** 2, WAVES))
    full = np.array([[draught, 7.0, 2.5, 4.0, 9.0]])
    assert significant_pitch(full, "strip_theory")[0] == approx(expected, abs=np.deg2rad(0.0005))


def test_a_row_does_not_know_what_stands_beside_it():
    rows = conditions((5.5, 5, 40, 3, 8), (10.5, 20, 170, 4, 12), (7.0, 0, 90, 2, 7))
    together = significant_motions(rows, "strip_theory")
    np.testing.assert_allclose(together[1:2], significant_motions(rows[1:2], "strip_theory"), rtol=1e-12)


@pytest.mark.parametrize("method", QUICK)
def test_a_ship_twice_as_large_does_the_same_in_a_sea_twice_as_high_by_froude_s_law(method):
    lengths = dict(length=350.0, breadth=50.8, draught=19.0, centre=-5.48, flotation=-10.0, weight_height=19.04)
    small, row = S175, conditions((8.0, 12, 140, 3, 9))
    large = replace(small, **lengths)
    scale = np.array([2.0, np.sqrt(2), 1.0, 2.0, np.sqrt(2)])
    heave, pitch = significant_motions(row, method, small)[0]
    np.testing.assert_allclose(significant_motions(row * scale, method, large)[0], [2 * heave, pitch], rtol=1e-6)


def test_strips_and_panels_agree_on_the_mariner(monkeypatch):
    pytest.importorskip("capytaine")
    form = estimated_form(mariner().particulars)
    rows = conditions((8.1, 0, 180, 3, 9), (8.1, 0, 30, 3, 9), (8.1, 15, 180, 3, 10))
    monkeypatch.setattr(module, "MOTIONS", np.array([0.05, 0.3, 0.5, 0.7, 0.9, 1.2, 1.8]))
    by_strips, by_panels = (significant_motions(rows, m, form) for m in ("strip_theory", "boundary_element"))
    np.testing.assert_allclose(by_strips, by_panels, rtol=0.15)


def test_each_method_solves_the_flow_by_its_own_program(monkeypatch):
    for program in ("radiate", "radiate_strips"):
        monkeypatch.setattr(module, program, lambda hull, frequency, program=program: program)
    with unchecked():
        solved = {method: module._solved.__wrapped__(S175, 8, method) for method in module.METHODS[1:]}
    assert solved == {"strip_theory": "radiate_strips", "boundary_element": "radiate"}


def test_progress_tells_every_draught_that_is_solved():
    said = []
    significant_pitch(conditions((9.0, 5, 90, 3, 9)), "strip_theory", None, said.append)
    assert len(said) == 4
    assert said[0] == "heave and pitch at draught 7.12 m (1 of 4)"


def test_pitch_is_the_slope_of_long_seas_and_next_to_nothing_in_short_ones():
    # long crests from astern, T 25 s: pitch is the slope of those waves that are longer than the ship
    row = conditions((9.0, 0, 0, 3.0, 25.0))
    sea = WaveSpectrum.bretschneider(3.0, 25.0).density(WAVES)
    slope = 2 * np.sqrt(np.trapezoid(sea * (WAVES**2 / GRAVITY) ** 2 * (WAVES < 0.45), WAVES))
    assert significant_pitch(row, "strip_theory")[0] == approx(slope, rel=0.1)
    assert significant_pitch(conditions((9.0, 0, 0, 3.0, 3.5)), "strip_theory")[0] < np.deg2rad(0.15)


@pytest.mark.parametrize(
    "row, method, message",
    [
        ((2.0, 5, 0, 3, 9), "closed_form", "write 2.85 to 12.3 m"),
        ((12.5, 5, 0, 3, 9), "strip_theory", "write 2.85 to 12.3 m"),
        ((9.0, -5, 0, 3, 9), "closed_form", "write speeds ahead and real seas"),
        ((9.0, 5, 0, 0, 9), "closed_form", "write speeds ahead and real seas"),
        ((9.0, 5, 0, 3, 40), "closed_form", "write up to 31.4 s"),
        ((9.0, 5, 0, 3, 9), "seaway", "choose one of: closed_form, strip_theory, boundary_element"),
    ],
)
def test_what_it_is_not_made_for_is_refused(row, method, message):
    with pytest.raises(InputError, match=message):
        significant_pitch(conditions(row), method)
