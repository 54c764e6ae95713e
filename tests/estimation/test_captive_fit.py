"""Captive tests beside free runs: made from the same coefficients they must agree."""

from dataclasses import replace

import numpy as np
import pytest
from pytest import approx

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.estimation.captive_fit import (
    agreeing_inertia,
    compare,
    fit_captive,
    forces,
    products_of,
    towed,
)
from manoeuvre_nn.estimation.coefficients import OWN, Fitted
from manoeuvre_nn.recording.read.captive import CaptiveTests

NAMES = tuple((o, t) for o in (1, 2) for t in ("u v", "u r", "v |v|", "d n n")) + ((0, "u u"), (0, "n n"), (0, "v v"))
TRUE = np.array([-0.3, -0.2, -0.6, -0.06, -0.13, -0.05, 0.1, 0.03, -0.02, 0.02, 0.05])
INERTIA = np.array([[0.3, 0, 0], [0, 0.5, 0.01], [0, 0.01, 0.03]])
RATIO, U0, N0 = 15.0, 1.2, 9.9


def free(values=TRUE, error=0.002):
    p = len(NAMES)
    return Fitted(NAMES, np.array(values), np.eye(p) * error**2, np.zeros(p), np.ones(p), INERTIA)


def model_tests(noise=0.0, speeds=(1.2, 0.6)):
    """Drift and rudder tests at two speeds, forces over L^2."""
    angles = np.radians([-20, -10, -4, 0, 4, 10, 20])
    rows = [(b, d, s) for s in speeds for b, d in [(a, 0.0) for a in angles] + [(0.0, a) for a in angles] * 2]
    beta, delta, speed = (np.array(c) for c in zip(*rows, strict=True))
    ratio = speed / U0
    still = np.zeros(len(rows))
    motion = np.stack([ratio * np.cos(beta), -ratio * np.sin(beta), still, delta, still + 1, still, still], axis=1)
    force, _ = forces(free(), motion)
    force = force + noise * np.random.default_rng(2).standard_normal(force.shape)
    parts = (force / ratio[:, None] ** 2 / RATIO).T
    return CaptiveTests("made", beta, delta, still, speed, still + N0, *parts, area="LL")


def test_captive_tests_give_back_the_coefficients_that_they_were_made_with():
    fit = fit_captive(towed(model_tests(), RATIO, U0), free())
    kept = [k for k, (_, t) in enumerate(NAMES) if "r" not in t]
    assert [NAMES[k] for k in kept] == list(fit.names) and fit.values == approx(TRUE[kept], abs=1e-6)


def test_errors_of_captive_coefficients_follow_from_the_scatter_of_the_tests():
    tests = towed(model_tests(noise=2e-3), RATIO, U0)
    fit = fit_captive(tests, free())
    of = [k for k, (o, _) in enumerate(fit.names) if o == 1]
    columns = products_of(fit.names, tests.motion)[:, of]
    expected = 2e-3 * np.sqrt(np.diag(np.linalg.inv(columns.T @ columns)))
    assert fit.errors[of] == approx(expected, rel=0.25)


def test_the_speed_of_most_tests_is_taken_as_the_approach():
    used = towed(model_tests(speeds=(1.2, 1.2, 0.6)), RATIO)
    assert used.motion[:, 0].max() == approx(1.0) and "U0 = 1.2 m/s" in used.note and used.motion[0, 4] == 1.0


def test_what_was_made_alike_agrees_and_what_was_not_differs():
    fit = fit_captive(towed(model_tests(noise=1e-3), RATIO, U0), free())
    rows = {r.name: r for r in compare(free(), fit).itertuples()}
    assert all(r.word == "agree" for r in rows.values())
    assert {"Y' by drift", "N' by rudder", "Y_uv", "X_vv"} <= set(rows) and "Y_ur" not in rows
    assert rows["Y' by drift"].free == approx(-0.3, abs=1e-3) and rows["N' by rudder"].towed == approx(0.03, rel=0.05)
    other = np.where(np.arange(len(TRUE)) == 0, -0.4, TRUE)
    rows = {r.name: r for r in compare(free(other), fit).itertuples()}
    assert rows["Y_uv"].word == "differ" and rows["Y' by drift"].word == "differ" and rows["N_uv"].word == "agree"


def test_a_coefficient_that_one_of_both_does_not_know_is_left_open():
    fit = fit_captive(towed(model_tests(), RATIO, U0), free())
    rows = {r.name: r for r in compare(free(error=0.9), fit).itertuples()}
    assert rows["Y_uv"].word == "open"


def test_what_no_test_shows_stays_what_was_known_before():
    used = towed(model_tests(noise=1e-3), RATIO, U0)
    amidships = used.motion[:, 3] == 0
    drifts = replace(used, motion=used.motion[amidships], force=used.force[amidships])
    before = replace(free(), mean=np.full(len(NAMES), 0.7), spread=np.full(len(NAMES), 0.2))
    fit = fit_captive(drifts, before)
    for output in (1, 2):
        rudder, drift = (fit.names.index((output, t)) for t in ("d n n", "u v"))
        assert fit.values[rudder] == approx(0.7) and fit.errors[rudder] == approx(0.2)
        assert fit.errors[drift] < 0.02


def test_the_inertia_with_which_both_agree_is_that_of_the_ship():
    """Told for a wrong inertia the free coefficients differ; the right one is found from the slopes."""
    wrong = np.diag([0.3, 0.6, 0.05])
    fit = fit_captive(towed(model_tests(), RATIO, U0), free())
    told = free().with_inertia(wrong)
    assert abs(told.values[0] / TRUE[0] - 1) > 0.03
    assert agreeing_inertia(told, fit) == approx(INERTIA[1:, 1:], rel=1e-2, abs=1e-4)


def test_tests_that_cannot_be_compared_are_refused_in_one_line():
    tests = model_tests()
    with pytest.raises(InputError, match=r"captive.largest_drift=-1 deg leaves 0 tests"):
        towed(tests, RATIO, U0, largest_drift=-1 * DEGREE)
    silent = CaptiveTests(**{**vars(tests), "speed": np.full(len(tests), np.nan)})
    with pytest.raises(InputError, match="no speed"):
        towed(silent, RATIO)
    own = Fitted(**{**vars(free()), "form": OWN})
    with pytest.raises(InputError, match="choose terms=network"):
        fit_captive(towed(tests, RATIO, U0), own)
