"""The low-speed MMG model: by its equations written out for one sample at a time, and what holds for any numbers."""

from dataclasses import replace
from math import atan2, cos, pi, sin, sqrt

import numpy as np
import pytest
import torch
from pytest import approx

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.ship.esso_osaka_model import esso_osaka_mmg
from manoeuvre_nn.ship.mmg import MMGShip, cross_flow

SHIP = esso_osaka_mmg()
L, T, RHO = 3.0, 0.20114, 998.0
MOTIONS = np.random.default_rng(0).uniform([-0.3, -0.2, -0.06, -0.6, -15], [0.6, 0.2, 0.06, 0.6, 17], (200, 5))


def written_out(u, v, r, d, n):
    """Accelerations; the cross flow by 4000 strips."""
    area, volume = 0.5 * RHO * L * T, 0.5 * RHO * L**2 * T
    speed = sqrt(u * u + v * v)
    x = (np.arange(4000) + 0.5) / 4000 - 0.5
    flow_y, flow_n = v + 2.217 * r * L * x, v + 0.8097 * r * L * x
    resistance = -0.02139 + (-0.03189 + 0.02139) * abs(atan2(v, u)) / pi
    along = area * (resistance * u * speed - 0.0081 * v * r * L)
    across = area * (-0.3728 * v * abs(u) + 0.116 * r * L * u - 0.9665 * np.mean(np.abs(flow_y) * flow_y))
    turning = -0.1458 * v * u - 0.04849 * r * L * abs(u) - 0.9665 * np.mean(np.abs(flow_n) * flow_n * x)
    b = (v - 0.517 * r * L) / speed
    wake = 0.614 - 0.871 * abs(b) + 0.359 * b * b
    inflow = min(max(1 - wake, 1e-9), 1.0) if u > 0 else 1.0
    x_p, y_p, n_p, kt = propeller(u, n, inflow)
    lift, moment, drag = rudder(u, v, r, d, n, inflow, kt)
    surge = along + x_p - drag
    sway = across + area * y_p - lift
    yaw = area * L * turning + area * L * n_p + moment
    m, mx, my, off = 0.27078 * volume, 0.0467 * volume, 0.2579 * volume, 0.03119 * L
    inertia = 0.0286 * volume * L**2 + off**2 * m
    udot = (surge + (m + my) * v * r + off * m * r * r) / (m + mx)
    matrix = [[m + my, off * m], [off * m, inertia]]
    vdot, rdot = np.linalg.solve(matrix, [sway - (m + mx) * u * r, yaw - off * m * u * r])
    return [udot, vdot, rdot]


def propeller(u, n, inflow):
    """X [N], Y and N over .5 rho L T and .5 rho L^2 T, and K_T as the rudder feels it."""
    size, js = RHO * n**2 * 0.084**4, u / (0.084 * n)
    if n > 0:
        kt = 0.3278 - 0.3223 * js * inflow - 0.156 * (js * inflow) ** 2
        side = [(5.08e-3, 1.702e-3, 9.16e-4), (-2.16e-3, 6.27e-5, 6.25e-5)]
        pitch = (n * 0.084 * 0.7151) ** 2
        y, z = (pitch * (a * js**2 + b * js + c) if u < 0 else 0.0 for a, b, c in side)
        return 0.78 * size * kt, y, z, kt
    kt = -0.175 + 0.330 * js if js >= -0.233 else -0.251
    if js < -0.35:
        y, z = -4.93e-3 - 5.87e-3 * js, 1.96e-3 + 2.33e-3 * js
    elif js <= -0.06:
        y, z = -7.90e-5 + 7.99e-3 * js, 3.50e-5 - 3.17e-3 * js
    else:
        y, z = -5.58e-4, 2.25e-4
    return size * kt, y * (n * 0.084) ** 2, z * (n * 0.084) ** 2, kt


def rudder(u, v, r, d, n, inflow, kt):
    """Lift and drag [N], moment [N m]."""
    eta, up = 0.084 / sqrt(0.01063 * 1.539), u * inflow
    if n > 0 and kt > 0:
        race = up + 0.288 / 1.42 * (sqrt(up**2 + 8 * kt * (n * 0.084) ** 2 / pi) - up)
        u_r = 1.42 * sqrt(eta * race**2 + (1 - eta) * up**2)
    elif u < 0:
        u_r = u
    else:
        behind = 1.42 * up
        one = behind + n * 0.084 * 0.144 * sqrt(8 * abs(kt) / pi)
        square = eta * np.sign(one) * one**2 + (1 - eta) * behind**2 - 0.176 * u**2
        u_r = np.sign(square) * sqrt(abs(square))
    v_r = -(0.3506 if v - 1.5 * r >= 0 else 0.4406) * (v - 1.08 * L * r)
    slope = 6.13 * 1.539 / (2.25 + 1.539)
    normal = 0.5 * RHO * 0.01063 * slope * (u_r**2 + v_r**2) * sin(d - atan2(v_r, u_r))
    moment = (1.5 + 0.393 * 0.45 * L) * normal * cos(d)
    return (1 + 0.393) * normal * cos(d), moment, (1 - 0.19) * normal * sin(d)


def accelerations(motions):
    columns = torch.tensor(np.atleast_2d(motions), dtype=torch.float64)
    nu = columns[:, :3]
    shaft = columns[:, 4] / SHIP.shaft
    force = SHIP.force(nu, columns[:, 3]) + SHIP.shaft_force(nu, columns[:, 3], shaft)
    return SHIP.acceleration_from_force(force).numpy()


def test_the_model_moves_by_its_equations_in_all_four_quadrants():
    assert {(n > 0, u > 0) for u, _, _, _, n in MOTIONS} == {(a, b) for a in (True, False) for b in (True, False)}
    expected = np.array([written_out(*m) for m in MOTIONS])
    assert accelerations(MOTIONS) == approx(expected, rel=1e-4, abs=1e-6)


@pytest.mark.parametrize("v, turn", [(0.1, 0.05), (0.02, 0.4), (-0.1, 0.1), (-0.03, -0.2), (0.0, 0.3), (0.2, 0.0)])
def test_the_cross_flow_is_the_integral_along_the_hull(v, turn):
    x = (np.arange(20000) + 0.5) / 20000 - 0.5
    flow = v + turn * x
    found = cross_flow(torch.tensor(v), torch.tensor(turn))
    assert [float(f) for f in found] == approx([np.mean(abs(flow) * flow), np.mean(abs(flow) * flow * x)], abs=1e-7)


def test_the_cross_flow_of_a_ship_at_rest_has_finite_gradients():
    v, turn = torch.zeros(3, requires_grad=True), torch.tensor([0.0, 0.1, -0.1], requires_grad=True)
    sum(f.sum() for f in cross_flow(v, turn)).backward()
    assert torch.isfinite(v.grad).all() and torch.isfinite(turn.grad).all()


@pytest.mark.parametrize("speed", [0.2, 0.4, 0.6])
def test_the_approach_is_steady_at_the_shaft_speed_that_keeps_it_up(speed):
    ship = SHIP.on_approach(speed)
    nu, amidships = torch.tensor([speed, 0.0, 0.0], dtype=torch.float64), torch.tensor(0.0, dtype=torch.float64)
    assert ship.acceleration(nu, amidships).tolist() == approx([0.0, 0.0, 0.0], abs=1e-12)
    assert ship.shaft / SHIP.shaft == approx(speed / 0.4)


def test_starboard_rudder_turns_to_starboard_and_thrust_from_rest_goes_ahead():
    turn = accelerations([0.4, 0, 0, 0.3, 10])[0]
    assert turn[2] > 0 and turn[1] < 0 and turn[0] < 0
    assert accelerations([0.0, 0, 0, 0, 10])[0] == approx(
        [4.43e-3, 0, 0], rel=0.02
    )  # .78 .3278 rho n^2 D^4 / (m + m_x)
    assert accelerations([0.0, 0, 0, 0, -10])[0][0] < 0


def test_with_one_flow_straightening_on_both_sides_port_mirrors_starboard():
    ship = MMGShip(SHIP.particulars, replace(SHIP.coefficients, gamma_port=0.4, gamma_starboard=0.4))
    ahead = torch.tensor(MOTIONS[(MOTIONS[:, 4] > 0) & (MOTIONS[:, 0] > 0)])
    odd = torch.tensor([1.0, -1.0, -1.0], dtype=torch.float64)
    one = ship.force_at(ahead[:, :3], ahead[:, 3], ahead[:, 4])
    other = ship.force_at(ahead[:, :3] * odd, -ahead[:, 3], ahead[:, 4])
    assert (other * odd).numpy() == approx(one.numpy(), rel=1e-9, abs=1e-12)


def test_a_propeller_that_cannot_give_the_thrust_is_refused():
    for thrust in ((-0.1, -0.3, -0.1), (0.0, 0.3, 0.1), (-0.1, 0.9, 0.9)):
        with pytest.raises(InputError, match="no shaft speed keeps up"):
            MMGShip(SHIP.particulars, replace(SHIP.coefficients, thrust=thrust))


def test_shares_of_the_resistance_are_of_the_models_own():
    """As of fouling: X_0F' of the hull at the approach speed, which thrust balances there."""
    speed, one = SHIP.particulars.speed, torch.ones((), dtype=torch.float64)
    resistance = 0.02139 * 0.5 * RHO * L * T * speed**2
    assert SHIP.particulars.calm_resistance == approx(resistance, rel=1e-4)
    assert float(SHIP.thrust(speed * one, one)[0]) == approx(resistance, rel=1e-4)
