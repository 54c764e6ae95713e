"""Heave and pitch of the box, in closed form."""

import numpy as np
import pytest
from pytest import approx

from manoeuvre_nn.core.units import GRAVITY
from manoeuvre_nn.seakeeping.closed_form import box_motions
from manoeuvre_nn.seakeeping.form import S175


def box(frequency, draught=9.5, speed=0.0, heading=np.pi):
    return box_motions(S175, np.atleast_1d(frequency), *(np.array([v]) for v in (draught, speed, heading)))[0]


@pytest.mark.parametrize("heading", [0.0, 0.8, 2.5, np.pi])
@pytest.mark.parametrize("speed", [0.0, 10.0])
def test_on_long_waves_the_box_follows_surface_and_slope(heading, speed):
    frequency = 0.02
    heave, pitch = box(frequency, speed=speed, heading=heading)[0]
    assert heave == approx(1.0, rel=5e-3)
    assert pitch == approx(frequency**2 / GRAVITY * abs(np.cos(heading)), rel=5e-3)


def test_at_rest_waves_from_ahead_and_astern_are_alike():
    frequency = np.linspace(0.2, 1.2, 11)
    np.testing.assert_allclose(box(frequency, heading=0.4), box(frequency, heading=np.pi - 0.4), rtol=1e-12)


def test_the_equations_as_printed_at_one_point():
    # every symbol of the source written out, at w = .6 rad/s, 10 m/s, waves from 30 deg off the bow
    w, speed, heading, draught = 0.6, 10.0, np.deg2rad(150.0), 8.0
    k, b, length = w**2 / GRAVITY, 0.573 * 25.4, 175.0
    alpha = 1 - speed / np.sqrt(GRAVITY * length) * np.sqrt(k * length) * np.cos(heading)
    a = 2 * np.sin(0.5 * k * b * alpha**2) * np.exp(-k * draught * alpha**2)
    f = np.sqrt((1 - k * draught) ** 2 + (a**2 / (k * b * alpha**3)) ** 2)
    ke = abs(k * np.cos(heading))
    kappa = np.exp(-ke * draught)
    eta = 1 / np.sqrt((1 - 2 * k * draught * alpha**2) ** 2 + (a**2 / (k * b * alpha**2)) ** 2)
    push = kappa * f * 2 / (ke * length) * np.sin(ke * length / 2)
    tilt = np.sin(ke * length / 2) - ke * length / 2 * np.cos(ke * length / 2)
    tilt *= kappa * f * 24 / ((ke * length) ** 2 * length)
    np.testing.assert_allclose(box(w, draught, speed, heading)[0], eta * np.abs([push, tilt]), rtol=1e-12)


def test_without_damping_it_would_resonate_at_the_root_of_g_over_twice_the_draught():
    # at 2 k T a^2 = 1 only the damping holds the box
    draught = 30.0  # deep: hardly any waves are made
    natural = np.sqrt(GRAVITY / (2 * draught))
    frequency = np.linspace(0.8, 1.2, 401) * natural
    answer = box(frequency, draught, heading=np.pi / 2 - 1e-6)
    assert frequency[np.argmax(answer[:, 0])] == approx(natural, rel=0.02)


def test_waves_that_keep_up_with_the_ship_leave_the_answer_finite_and_smooth():
    speed = 10.0
    at = GRAVITY / speed  # a = 0 in following seas
    answer = box(at * np.array([1 - 1e-4, 1 - 1e-9, 1.0, 1 + 1e-9, 1 + 1e-4]), speed=speed, heading=0.0)
    assert np.isfinite(answer).all()
    np.testing.assert_allclose(answer, answer[2:3] * np.ones((5, 1)), rtol=1e-2, atol=1e-9)
