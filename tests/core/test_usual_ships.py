"""What is taken of a ship of which little is known, and of her thrust: the formulas of the docstrings by numbers."""

from dataclasses import replace
from math import inf, sqrt

import numpy as np
import pytest
import torch
from fleet import ship_named
from pytest import approx

from manoeuvre_nn.core.channels import CHANNELS, MEASURED, PERIODIC, SMOOTHED
from manoeuvre_nn.core.effect import Parameter
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.manoeuvre import Manoeuvre, Stage
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.recording import Recording, followed
from manoeuvre_nn.core.units import DEGREE, KNOT

SHIP = Particulars("ship", 120.0, 20.0, 7.0, 0.65, 8.0, 0.04, 0.6)
MASS = 1025 * 0.65 * 120 * 20 * 7


def test_of_a_ship_of_which_little_is_known_the_usual_is_taken():
    assert SHIP.mass == approx(MASS) and replace(SHIP, displacement=9e6, rho=1000.0).mass == 9e6
    surface = 1.7 * 120 * 7 + MASS / 1025 / 7  # Mumford
    assert SHIP.calm_resistance == approx(0.5 * 1025 * 0.003 * surface * 64)
    air = SHIP.above_water
    assert (air.frontal, air.lateral) == approx((0.8 * 400, 120**2 * 0.052)), (
        "a freeboard of .04 L and a house of .012 L^2"
    )
    assert (air.lateral_centre, air.length_overall) == approx((-6.0, 123.6))
    heel = SHIP.heeling
    assert (heel.gm, heel.kg, heel.roll_damping) == approx((0.8, 11.2, 0.08))
    assert heel.roll_period == approx(0.8 * 20 / sqrt(0.8)), "Weiss"
    assert (SHIP.thrust_slope, SHIP.rpm, SHIP.rudder_area_ratio, SHIP.surge_damping) == (1.0, 80.0, 0.02, -0.025)
    assert (SHIP.record_length, SHIP.sample_interval, SHIP.rho) == (360.0, 1.0, 1025.0)


def test_models_have_usual_sizes_by_froudes_law_and_ships_as_they_are():
    model = replace(SHIP, length=4.0, beam=0.7, draught=0.3)
    assert model.is_model and not SHIP.is_model
    assert not replace(model, length=20.0).is_model and replace(model, length=19.99).is_model
    sizes = model.sized([2.0, 2.0, 2.0, 2.0, 2.0], [1.0, 0.5, -0.5, 3.0, 0.0])
    assert sizes.tolist() == approx([2 / 40, 2 / sqrt(40), 2 * sqrt(40), 2 / 40**3, 2.0]), "4 m of 160 m"
    assert SHIP.sized([2.0, 3.0], [1.0, 3.0]).tolist() == [2.0, 3.0]


@pytest.mark.parametrize("unit, power", [("m", 1.0), ("m/s", 0.5), ("kN", 3.0), ("deg", 0.0)])
def test_the_usual_size_of_a_parameter_goes_by_its_unit_or_by_what_it_says(unit, power):
    model = replace(SHIP, length=4.0, beam=0.7, draught=0.3)
    parameter = Parameter("size", unit, -1e9, 1e9, 0.0, 2.0, (1.0, inf))
    assert parameter.on(model).spread == approx(2.0 / 40**power) and parameter.on(SHIP).spread == 2.0
    assert parameter.on(model).starts == approx((1 / 40**power, inf))
    assert replace(parameter, power=-0.5).on(model).spread == approx(2.0 * sqrt(40))


def test_an_approach_may_be_up_to_twice_as_fast_as_the_ship():
    fast = SHIP.at_speed(16.0)
    assert (fast.speed, fast.top_speed, fast.time_unit) == (16.0, 16.0, 7.5)
    slow = replace(SHIP, resistance=4e5).at_speed(4.0)
    assert (slow.top_speed, slow.resistance, slow.service_speed) == (8.0, 1e5, 8.0)
    for wrong in (16.01, 0.0, -1.0):
        with pytest.raises(InputError, match=f"between 0 and {16 / KNOT:.3g}"):
            SHIP.at_speed(wrong)


@pytest.mark.parametrize("wrong", [
    {"length": 0.0}, {"beam": -1.0}, {"draught": 0.0}, {"block": 0.0}, {"speed": 0.0}, {"rudder_rate": 0.0},
    {"beam": 130.0}, {"draught": 20.0}, {"block": 1.01},
])  # fmt: skip
def test_no_ship_has_such_dimensions(wrong):
    with pytest.raises(InputError, match="ship ship"):
        replace(SHIP, **wrong)
    assert replace(SHIP, block=1.0).block == 1.0


def test_thrust_falls_with_the_advance_ratio_by_its_slope():
    """``R0 [(1 + s) n^2 - s n u/U0]`` with a slope that is not one."""
    bulker = ship_named("great_lakes_bulker")
    ship = bulker.on_approach(5.144)
    ship.particulars = replace(bulker.particulars, thrust_slope=0.7)
    u, n = torch.tensor([4.0], dtype=torch.float64), torch.tensor([1.2], dtype=torch.float64)
    thrust = 179.3e3 * (1.7 * 1.44 - 0.7 * 1.2 * 4.0 / 5.144)
    assert ship.thrust(u, n)[0].tolist() == approx([thrust, 0.0, 0.0])
    nominal = 179.3e3 * (1.7 - 0.7 * 4.0 / 5.144)
    nu = torch.tensor([[4.0, 0.2, 0.01]], dtype=torch.float64)
    unit = 0.5 * 1025 * 217.627 * 8.1 * 5.144**2
    assert ship.shaft_force(nu, 0 * u, n)[0].tolist() == approx([(thrust - nominal) / unit, 0.0, 0.0])
    with_shaft = ship.acceleration_from_si(torch.tensor([[thrust - nominal, 0.0, 0.0]], dtype=torch.float64))
    assert float(with_shaft[0, 0]) == approx((thrust - nominal) / (0.19505 * unit) * 5.144**2 / 217.627)


def test_a_force_moves_a_ship_whose_inertia_couples_sway_and_yaw():
    """The Mariner's two lateral equations, solved by Cramer's rule."""
    ship = ship_named("mariner")
    push = torch.tensor([2e5, 3e5, -5e7], dtype=torch.float64)
    unit, length = 0.5 * 1025 * 152.4 * 8.138 * 7.614**2, 152.4
    y, n = 3e5 / unit, -5e7 / unit / length
    determinant = 0.327 * 0.0175 - 0.00077 * -0.00221
    sway = (0.0175 * y - 0.00077 * n) / determinant * 7.614**2 / length
    yaw = (0.327 * n + 0.00221 * y) / determinant * 7.614**2 / length**2
    surge = 2e5 / unit / 0.177 * 7.614**2 / length
    found = ship.acceleration_from_si(push)
    assert found.tolist() == approx([surge, sway, yaw])
    assert ship.force_from_acceleration(found).tolist() == approx([2e5 / unit, y, n])


def test_a_gear_goes_evenly_to_each_order_and_rests_there():
    time, order = np.array([0.0, 1.0, 2.0, 4.0, 5.0, 6.0]), np.array([0.0, 0.3, 0.3, -0.1, -0.1, -0.1])
    assert followed(time, order, 0.2).tolist() == approx([0.0, 0.1, 0.3, 0.1, -0.1, -0.1])
    assert followed(time, order, 0.2, start=0.1).tolist() == approx([0.1, 0.1, 0.3, 0.1, -0.1, -0.1])
    assert followed(time, -order, 0.2).tolist() == approx([0.0, -0.1, -0.3, -0.1, 0.1, 0.1])
    ordered = Recording("r", time, {"delta_order": np.where(order < 0, np.nan, order)})
    assert ordered.ordered_rudder(0.2).tolist() == approx([0.0, 0.1, 0.3, 0.3, 0.3, 0.3]), "gaps are filled"
    assert ordered.ordered_rudder(0.1).tolist() == approx([0.0, 0.05, 0.15, 0.3, 0.3, 0.3]), "a gear of another rate"
    assert Recording("r", time, {"delta": order}).ordered_rudder(0.2) is None
    derived = Recording("r", time, {"delta_order": order}, meta={"derived": ["delta_order"]})
    assert derived.ordered_rudder(0.2) is None


@pytest.mark.parametrize("after", [0.05, 0.5, 0.95])
def test_an_order_between_two_samples_is_off_by_half_a_step_at_most(after):
    """The gear of a rudder that goes at .04 rad/s, ordered so many seconds after a sample, against every sample."""
    time = np.arange(0.0, 30.0)
    order = np.where(time < 4.0 + after, -0.3, 0.3)
    true = np.clip(-0.3 + 0.04 * (time - 4.0 - after), -0.3, 0.3)
    error = followed(time, order, 0.04) - true
    assert np.abs(error).max() == approx(0.04 * abs(after - 0.5))


def test_windows_keep_a_sample_that_is_off_by_rounding():
    made = Recording("r", np.arange(5) * 0.1, {"u": np.arange(5.0)})
    assert made.between(0.1 + 1e-12, 0.3 - 1e-12)["u"].tolist() == [1.0, 2.0, 3.0]
    assert made.rows(slice(1, 4, 2))["u"].tolist() == [1.0, 3.0] and made.duration == approx(0.4)
    assert made.filled("u").tolist() == made["u"].tolist()


def test_a_trial_ends_where_its_last_stage_begins_and_orders_no_more_than_the_stop():
    stages = (Stage(0.0, hold=3.0), Stage(0.2, heading=1.0), Stage(0.0))
    trial = Manoeuvre("mine", "zigzag", stages, ends=True, rudder_split=0.05)
    time = np.arange(8.0)
    assert trial.end(time, np.array([0, 0, 0, 0.2, 0.2, 0.2, 0, 0])) == 5.0
    assert trial.end(time, np.array([0, 0, 0, 0.2, 0.2, 0.2, 0.2, 0.2])) == 7.0, "it did not come to its end"
    assert replace(trial, ends=False).end(time, np.array([0, 0, 0, 0.2, 0.2, 0.2, 0, 0])) == 7.0
    assert trial.largest_order == approx(0.25)
    trial.check(replace(SHIP, rudder_limit=0.25))
    with pytest.raises(InputError, match=f"orders {0.25 / DEGREE:.4g} deg of rudder"):
        trial.check(replace(SHIP, rudder_limit=0.249))
    turn = Manoeuvre("tc", "turning_circle", stages, ship_lengths=30.0)
    assert turn.duration_for(SHIP) == 450.0 and turn.duration_for(replace(SHIP, longest_turn=400.0)) == 400.0
    swing = replace(turn, kind="zigzag")
    assert swing.duration_for(replace(SHIP, longest_turn=400.0)) == 450.0


def test_sensors_err_by_fractions_of_the_ships_own_units_and_angles_come_round():
    offsets = {name: c.offset for name, c in CHANNELS.items() if c.offset is not None}
    assert offsets == {"u": 0.02, "v": 0.02, "r": 0.02, "x": 0.1, "y": 0.1, "psi": 0.02}
    assert set(PERIODIC) == {"psi", "cog", "lon", "wind_from", "wind_from_relative"}
    assert MEASURED == ("x", "y", "vn", "ve", "psi", "r", "u_log", "shaft_recorded") and len(SMOOTHED) == 9
