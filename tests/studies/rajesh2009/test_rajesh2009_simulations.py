"""Rajesh & Bhattacharyya 2009: the simulations of the Esso 190 000 dwt tanker."""

from functools import cache

import numpy as np
import pytest
import torch
from equations import esso
from fleet import coarse
from pytest import approx
from scipy.optimize import brentq, fsolve
from tiers import mainly

from manoeuvre_nn.core.units import DEGREE, KNOT
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.manoeuvre.criteria import criteria, reversal_times, trace
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.ship.esso_190k import PARTICULARS, RPM_SERVICE, SELF_PROPULSION, esso_190k

L = PARTICULARS.length
DEEP = [zigzag(20.0), turning_circle(15.0), turning_circle(20.0), turning_circle(25.0)]


@cache
def deep():
    return dict(zip([m.name for m in DEEP], coarse(esso_190k(), DEEP, 2000.0, 2.0), strict=True))


def acceleration(ship, u, v, r, rudder=0.0):
    nu = torch.tensor([u, v, r], dtype=torch.float64)
    return ship.acceleration(nu, torch.tensor(rudder, dtype=torch.float64)).numpy()


def straight_course(ship):
    """Speed, sway and rudder at which the ship goes straight ahead."""

    def error(x):
        return acceleration(ship, x[0], x[1], 0.0, x[2]) * [1, 1, L]

    return fsolve(error, [8.0, 0.0, 0.0], xtol=1e-12)


def growth(ship):
    """Largest real part of the eigenvalues of sway and yaw about the straight course [1/s]."""
    u, v, rudder = straight_course(ship)

    def force(x):
        return ship.acceleration(torch.cat([x.new_tensor([u]), x]), x.new_tensor(rudder))[1:]

    jacobian = torch.autograd.functional.jacobian(force, torch.tensor([v, 0.0], dtype=torch.float64))
    return float(torch.linalg.eigvals(jacobian).real.max())


def test_80_rpm_keep_up_15_990_kn():
    speed = brentq(lambda u: acceleration(esso_190k(), u, 0.0, 0.0)[0], 5.0, 12.0)
    assert speed / KNOT == approx(15.990, abs=5e-4)
    assert speed == approx(SELF_PROPULSION, rel=1e-4)


def test_the_neutral_rudder_is_half_a_degree_to_starboard():
    """-.50 deg with the source's positive rudder to port."""
    assert straight_course(esso_190k())[2] / DEGREE == approx(0.50, abs=0.01)


def test_the_ship_is_course_unstable_in_deep_water():
    assert growth(esso_190k()) == approx(0.00257, rel=0.01)


def test_the_ship_is_course_stable_at_one_and_a_half_times_its_draught():
    assert growth(esso_190k(depth=1.5 * PARTICULARS.draught)) < 0


@pytest.mark.parametrize("speed_kn, rpm", [(10, 50.03), (5, 25.02)])
def test_similarity_scales_the_shaft_speed_with_the_approach_speed(speed_kn, rpm):
    ship = esso_190k(shaft="similarity").on_approach(speed_kn * KNOT)
    assert ship.rpm == approx(rpm, abs=0.006)
    assert acceleration(ship, speed_kn * KNOT, 0.0, 0.0)[0] == approx(0.0, abs=1e-6)
    assert esso_190k().on_approach(speed_kn * KNOT).rpm == RPM_SERVICE


def test_the_zigzag_has_the_published_overshoots():
    found = criteria(deep()["zz20"], "zigzag", L)
    overshoots = [found[f"overshoot_{k}_deg"] for k in (1, 2, 3, 4)]
    assert overshoots == approx([12.3, 15.8, 12.9, 13.1], abs=0.1)


def test_the_zigzag_settles_from_the_published_period_to_the_published_one():
    """Counted from rudder to rudder of the same side; 418 s from the second reversal on."""
    times, _ = reversal_times(trace(deep()["zz20"]))
    periods = np.subtract(times[2:], times[:-2])
    assert periods[1] == approx(418, abs=1.0)
    assert 0.5 * (periods[4] + periods[5]) == approx(385, abs=1.0)
    assert criteria(deep()["zz20"], "zigzag", L)["period_s"] == approx(418, rel=0.01)


def test_the_rudder_is_reversed_8_times_in_1500_s_and_there_are_4_9_cycles_in_2000_s():
    times, _ = reversal_times(trace(deep()["zz20"]))
    assert sum(t < 1500 for t in times) == 8
    cycles = 0.5 * (len(times) - 1) + 0.5 * (2000 - times[-1]) / (times[-1] - times[-2])
    assert cycles == approx(4.9, abs=0.05)


@pytest.mark.parametrize(
    "trial, advance, transfer, tactical, u, v, r",
    [
        ("tc15", 4.74, 2.27, 4.75, 3.454, -0.942, 0.389),
        ("tc20", 4.15, 1.92, 4.15, 3.162, -0.923, 0.408),
        ("tc25", 3.75, 1.68, 3.74, 2.906, -0.884, 0.424),
    ],
)
def test_the_turns_are_the_published_ones(trial, advance, transfer, tactical, u, v, r):
    found = criteria(deep()[trial], "turning_circle", L)
    assert found["advance_L"] == approx(advance, rel=0.01)
    assert found["transfer_L"] == approx(transfer, rel=0.01)
    assert found["tactical_diameter_L"] == approx(tactical, rel=0.01)
    assert found["steady_u_m_s"] == approx(u, rel=0.01)
    assert -u * np.tan(found["steady_drift_deg"] * DEGREE) == approx(v, rel=0.01)
    assert found["steady_r_deg_s"] == approx(r, rel=0.01)


@pytest.mark.parametrize(
    "ratio, tactical, overshoot", mainly(1, [(1.5, 5.50, 7.5), (2.0, 4.35, 11.2), (1.2, 10.67, 2.8)])
)
def test_shallow_water_widens_the_turn_and_checks_the_overshoot(ratio, tactical, overshoot):
    ship = esso_190k(depth=ratio * PARTICULARS.draught)
    zz, tc = coarse(ship, [zigzag(20.0), turning_circle(20.0)], 900.0, 2.0)
    assert criteria(tc, "turning_circle", L)["tactical_diameter_L"] == approx(tactical, rel=0.01)
    # The published overshoots are those of a rudder up to half a second late (see the next test).
    late = 0.5 * np.abs(zz["r"]).max() / DEGREE
    assert -0.05 - late < criteria(zz, "zigzag", L)["overshoot_1_deg"] - overshoot < 0.1


@pytest.mark.parametrize("ratio, overshoot", [(2.0, 11.2), (1.5, 7.5), (1.2, 2.8)])
def test_half_second_steps_without_locating_the_crossing_give_the_published_shallow_overshoots(ratio, overshoot):
    step, zeta = 0.5, 1 / (ratio - 1)
    state, rudder, side, headings = np.array([PARTICULARS.speed, 0.0, 0.0, 0.0]), 0.0, 1, []

    def rate(state, rudder):
        return np.array([*esso(*state[:3], -rudder, zeta), state[2]])

    for _ in range(int(220 / step)):
        side = -side if side * state[3] >= 20 * DEGREE else side
        reach = PARTICULARS.rudder_rate * step
        later = rudder + float(np.clip(side * 20 * DEGREE - rudder, -reach, reach))
        k1 = rate(state, rudder)
        k2 = rate(state + step / 2 * k1, (rudder + later) / 2)
        k3 = rate(state + step / 2 * k2, (rudder + later) / 2)
        state = state + step / 6 * (k1 + 2 * k2 + 2 * k3 + rate(state + step * k3, later))
        rudder = later
        headings.append(state[3] / DEGREE)
    assert max(headings) - 20 == approx(overshoot, abs=0.05)


@pytest.mark.parametrize("speed_kn, turn", mainly(1, [(10, (2.99, 1.45, 3.49)), (5, (1.95, 1.06, 2.93))]))
def test_80_rpm_turn_the_slow_ship_faster(speed_kn, turn):
    ship = CalmWater(esso_190k()).on_approach(speed_kn * KNOT).ship
    (recording,) = coarse(ship, [turning_circle(20.0)], 700.0, 2.0)
    found = criteria(recording, "turning_circle", L)
    assert [found[k] for k in ("advance_L", "transfer_L", "tactical_diameter_L")] == approx(turn, rel=0.01)
