"""Wang 1996: its simulations and its table of estimated coefficients."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import torch
from equations import wang
from fleet import coarse, ship_named
from pytest import approx
from tiers import mainly

from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.manoeuvre.criteria import criteria
from manoeuvre_nn.manoeuvre.spiral import spiral
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.ship.clarke import clarke_derivatives
from manoeuvre_nn.ship.great_lakes_bulker import PARTICULARS as BULKER
from manoeuvre_nn.ship.known import clarke_part
from manoeuvre_nn.ship.mariner import COEFFICIENTS, INERTIA, WANG

TRIALS = [zigzag(20.0), zigzag(35.0), zigzag(15.0), turning_circle(25.0), turning_circle(35.0), spiral()]


@cache
def runs(name):
    """Every trial of the thesis, each 1020 s long."""
    return dict(zip([m.name for m in TRIALS], coarse(ship_named(name), TRIALS, 1020.0, 1.0), strict=True))


def read(name, trial):
    return criteria(runs(name)[trial], runs(name)[trial].meta["kind"], WANG.length)


def stepwise_zigzag(angle_deg, step=0.1):
    """The source's own way: plain Runge-Kutta steps, the rudder reversed at the first step past the heading."""
    state, order, rudder, side, headings = np.array([WANG.speed, 0.0, 0.0, 0.0]), angle_deg * DEGREE, 0.0, 1, []

    def rate(state, rudder):
        u, v, r, _ = state
        return np.array([*wang(COEFFICIENTS, INERTIA, WANG.length, WANG.speed, u, v, r, -rudder), r])

    for _ in range(int(200.0 / step)):
        side = -side if side * state[3] >= order else side
        reach = WANG.rudder_rate * step
        later = rudder + float(np.clip(side * order - rudder, -reach, reach))
        k1 = rate(state, rudder)
        k2 = rate(state + step / 2 * k1, (rudder + later) / 2)
        k3 = rate(state + step / 2 * k2, (rudder + later) / 2)
        state = state + step / 6 * (k1 + 2 * k2 + 2 * k3 + rate(state + step * k3, later))
        rudder = later
        headings.append(state[3] / DEGREE)
    return max(headings) - angle_deg, -min(headings) - angle_deg


@pytest.mark.parametrize(
    "ship, u, v, r, advance, transfer, tactical, steady",
    [
        ("mariner", 0.5569, -0.1429, 0.3093, 3.81, 2.30, 5.02, 3.72),
        pytest.param("mariner_corrected", 0.5359, -0.1447, 0.3376, 3.62, 2.12, 4.62, 3.29, marks=pytest.mark.slow),
    ],
)
def test_the_25_deg_turn_is_the_published_one(ship, u, v, r, advance, transfer, tactical, steady):
    found = read(ship, "tc25")
    assert found["advance_L"] == approx(advance, rel=0.01)
    assert found["transfer_L"] == approx(transfer, rel=0.01)
    assert found["tactical_diameter_L"] == approx(tactical, rel=0.01)
    assert found["steady_diameter_L"] == approx(steady, rel=0.01)
    assert found["steady_u_m_s"] / WANG.speed == approx(u, rel=0.01)
    assert np.tan(found["steady_drift_deg"] * DEGREE) == approx(-v / u, rel=0.01)
    assert found["steady_r_deg_s"] * DEGREE * WANG.time_unit == approx(r, rel=0.01)


def test_the_35_deg_turn_is_the_published_one():
    found = read("mariner", "tc35")
    assert found["tactical_diameter_L"] == approx(4.09, rel=0.01)
    assert found["steady_diameter_L"] == approx(2.53, rel=0.01)
    assert found["steady_u_m_s"] / WANG.speed == approx(0.405, rel=0.01)


ZIGZAGS = [
    ("mariner", "zz20", 10.4, 8.8, 182),
    ("mariner", "zz35", 16.1, 14.5, 230),
    ("mariner", "zz15", 8.1, 6.9, 171),
    ("mariner_corrected", "zz20", 10.6, 9.2, 178),
]


@pytest.mark.parametrize("ship, trial, first, second, period", mainly(3, ZIGZAGS))  # one ship is sailed, in all trials
def test_the_zigzags_have_the_published_overshoots_and_periods(ship, trial, first, second, period):
    found = read(ship, trial)
    # The source's rudder is up to .1 s late (see the next test); meanwhile the heading goes on at its yaw rate.
    late = 0.1 * np.abs(runs(ship)[trial]["r"]).max() / DEGREE
    assert -0.1 - late < found["overshoot_1_deg"] - first < 0.1
    assert -0.1 - late < found["overshoot_2_deg"] - second < 0.1
    assert found["period_s"] == approx(period, abs=1.0)


@pytest.mark.parametrize("angle, first, second", [(20, 10.4, 8.8), (35, 16.1, 14.5)])
def test_without_locating_the_crossing_the_published_overshoots_are_met_to_their_last_digit(angle, first, second):
    assert stepwise_zigzag(angle) == approx((first, second), abs=0.055)


def test_the_spiral_with_60_s_holds_draws_the_published_loop():
    """The published loop is that of the samples one second before each rudder order: the yaw rate still lags."""
    recording = runs("mariner")["spiral20"]
    last = np.arange(1, 18) * 60 - 1
    rudder, rate = recording["delta"][last] / DEGREE, recording["r"][last] / DEGREE
    assert rate[4] - rate[12] == approx(0.290, rel=0.01)
    width = np.interp(0, rate[8:], rudder[8:]) - np.interp(0, rate[8::-1], rudder[8::-1])
    assert width == approx(3.25, rel=0.01)
    found = read("mariner", "spiral20")
    at_the_end = recording["r"][last + 1] / DEGREE
    assert found["loop_height_deg_s"] == approx(at_the_end[4] - at_the_end[12], rel=0.001)
    assert found["loop_width_deg"] == approx(3.25, rel=0.02)


def test_the_spiral_with_600_s_holds_draws_no_loop():
    (recording,) = coarse(ship_named("mariner"), [spiral(10.0, hold=600.0)], 5400.0, 10.0)
    found = criteria(recording, "spiral", WANG.length)
    assert found["loop_height_deg_s"] < 0.0003
    assert found["neutral_rudder_deg"] == approx(-1.44, abs=0.1), "the source's positive rudder turns to port"


@pytest.mark.parametrize("ship, published", [("mariner", 0.0033), ("great_lakes_bulker", 0.0003)])
def test_both_ships_are_straight_line_stable(ship, published):
    coefficients = ship_named(ship).coefficients
    Y, N = coefficients["Y"], coefficients["N"]
    assert Y["v"] * N["r"] - N["v"] * Y["r"] == approx(published, abs=5e-5)


def test_the_bulk_carrier_runs_astern_late_in_the_25_deg_turn():
    (recording,) = coarse(ship_named("great_lakes_bulker"), [turning_circle(25.0)], 600.0, 2.0)
    first_astern = recording.time[np.argmax(recording["u"] < 0)]
    assert first_astern == approx(578, rel=0.01)


CLARKE = {
    "Mariner": (WANG, -0.0253, -0.04008, {
        "my": 0.364741, "Yrdot": -0.01209, "Yv": -0.27543, "Yr-m": -0.1043, "Yd": 0.06,
        "Nvdot": -0.00796, "mz": 0.024085, "Nv": -0.10538, "Nr": -0.04602, "Nd": -0.03, "mx": 0.17993,
    }),
    "bulk carrier": (BULKER, -0.02, -0.0972, {
        "my": 0.34968, "Yrdot": -0.00516, "Yv": -0.23715, "Yr-m": -0.13349, "Yd": 0.081,
        "Nvdot": 0.00002, "mz": 0.02577, "Nv": -0.06891, "Nr": -0.03526, "Nd": -0.0405, "mx": 0.20089,
    }),
}  # fmt: skip


@pytest.mark.parametrize("ship", CLARKE)
def test_the_estimated_coefficients_are_those_of_tables_5_and_a(ship):
    particulars, Xu, Xdd, published = CLARKE[ship]
    estimate = clarke_part(particulars)
    M, c = estimate.inertia, estimate.coefficients
    found = {"mx": M[0, 0], "my": M[1, 1], "Yrdot": -M[1, 2], "Nvdot": -M[2, 1], "mz": M[2, 2]}
    found |= {"Yv": c["Y"]["v"], "Yr-m": c["Y"]["r"], "Yd": c["Y"]["d"]}
    found |= {"Nv": c["N"]["v"], "Nr": c["N"]["r"], "Nd": c["N"]["d"]}
    assert {k: float(v) for k, v in found.items()} == approx(published, abs=2e-5)
    assert c["X"] == {"u": Xu, "dd": Xdd}


def test_the_estimate_moves_by_equations_4_30_to_4_32():
    """Dimensional, written out: (m - Xudot) udot = Xu (u - U0) + Xdd d^2/2 and so on."""
    estimate, d = clarke_part(WANG), clarke_derivatives(WANG)
    u, v, r, rudder = 6.0, -0.7, 0.011, 0.3
    force = 0.5 * WANG.rho * WANG.length * WANG.draught * WANG.speed**2
    m = 2 * WANG.block * WANG.beam / WANG.length
    a, b, q, port = u / WANG.speed - 1, v / WANG.speed, r * WANG.time_unit, -rudder
    x = force * (-0.0253 * a - 0.04008 * port**2 / 2)
    y = force * (d["Yv"] * b + (d["Yr"] - m) * q + d["Yd"] * port)
    n = force * WANG.length * (d["Nv"] * b + d["Nr"] * q + d["Nd"] * port)
    unit, L = 0.5 * WANG.rho * WANG.length**2 * WANG.draught, WANG.length
    sway_yaw = unit * np.array([
        [m - d["Yvdot"], -d["Yrdot"] * L],
        [-d["Nvdot"] * L, (m * 0.28**2 - d["Nrdot"]) * L**2],
    ])
    expected = [x / (unit * 1.05 * m), *np.linalg.solve(sway_yaw, [y, n])]
    nu = torch.tensor([u, v, r], dtype=torch.float64)
    assert estimate.acceleration(nu, torch.tensor(rudder, dtype=torch.float64)).tolist() == approx(expected)


def test_the_default_rudder_drag_is_that_of_equation_4_18():
    assert clarke_part(replace(WANG, rudder_drag=None)).coefficients["X"]["dd"] == approx(-2 * 0.06)
