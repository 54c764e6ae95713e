"""Force modules of a recursive network: what each tends to where the answer is known."""

from dataclasses import replace
from math import atan2, cos, hypot, pi, radians, sin, sqrt

import pytest
import torch

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.particulars import WindAreas
from manoeuvre_nn.core.wind import AIR, COEFFICIENTS
from manoeuvre_nn.network.force_modules import (
    BasicForces,
    ForceConstants,
    MunkMoment,
    PropellerRace,
    PropellerThrust,
    RightingMoment,
    RudderLift,
    WindForce,
)

SHIP = ForceConstants(
    thrust=(0.6, -0.4), wake=0.2, deduction=0.1, diameter=0.03, rudder_area=5e-4, rudder_aspect=1.8,
    rudder_position=-0.5, volume=7e-3, gm=0.002, wind_areas=WindAreas(0.02, 0.06, -0.02, 1.03),
)  # fmt: skip


def t(*values):
    return torch.tensor(values, dtype=torch.float64)


@pytest.mark.parametrize("n, advance", [(20.0, 0.8), (35.0, 0.5), (35.0, 0.0)])
def test_thrust_in_newtons_is_that_of_the_thrust_coefficient(n, advance):
    length, speed, rho, diameter = 200.0, 8.0, 1025.0, 0.03 * 200.0
    rate = n * speed / length
    j = advance * speed / (rate * diameter)
    newtons = 0.9 * rho * rate**2 * diameter**4 * (0.6 - 0.4 * j)
    made = PropellerThrust(SHIP)(t(n, n), t(advance))
    assert made[0] * 0.5 * rho * length**2 * speed**2 == pytest.approx(newtons)
    assert made[0] == made[1]


def test_thrust_vanishes_at_the_advance_ratio_where_its_coefficient_does_and_turns_with_the_shaft():
    thrust = PropellerThrust(SHIP)
    assert thrust(t(20.0, 20.0), t(1.5 * 20.0 * 0.03)).abs().max() < 1e-12
    assert thrust(t(-20.0, 20.0), t(0.0))[0] == pytest.approx(-float(thrust(t(20.0, 20.0), t(0.0))[0]))


def test_a_rudder_amidships_costs_no_thrust_and_lifts_nothing():
    loss, lift = PropellerRace(SHIP)(t(1e-3, 2e-3), t(0.8), t(0.0, 0.0))
    assert loss.tolist() == [0.0, 0.0] and lift.tolist() == [0.0, 0.0]


def test_at_the_bollard_a_rudder_turns_the_whole_thrust_and_lightly_loaded_twice_of_it():
    delta, slipstream = radians(30.0), PropellerRace(SHIP)
    loss, lift = slipstream(t(1e-3, 1e-3), t(1e-9), t(delta, -delta))
    assert lift[0] == pytest.approx(1e-3 * sin(delta)) and lift[1] == pytest.approx(-1e-3 * sin(delta))
    assert loss.tolist() == pytest.approx([1e-3 * (1 - cos(delta))] * 2)
    _, light = slipstream(t(1e-9, 1e-9), t(1.0), t(delta, delta))
    assert light[0] == pytest.approx(2e-9 * sin(delta), rel=1e-4)


def test_the_slipstream_is_faster_by_the_root_of_one_and_the_thrust_loading():
    thrust, advance = 5e-4, 0.8
    loading = thrust / (advance**2 * pi * SHIP.diameter**2 / 4)
    assert PropellerRace(SHIP).speed(t(thrust, 0.0), t(advance)).tolist() == pytest.approx([
        advance * sqrt(1 + loading),
        advance,
    ])


def test_a_propeller_that_brakes_leaves_a_finite_slipstream():
    loss, lift = PropellerRace(SHIP)(t(-1.0, -1.0), t(0.8), t(0.5, 0.5))
    assert torch.isfinite(loss).all() and torch.isfinite(lift).all()


def test_lift_tends_to_that_of_a_thin_foil_for_a_slender_rudder():
    lift = RudderLift(replace(SHIP, rudder_aspect=1e6))
    made = lift(t(0.01, 0.01), t(1.0))[0]
    assert made == pytest.approx(SHIP.rudder_area * 2 * pi * sin(0.01), rel=1e-5)  # .5 rho A U^2 over .5 rho L^2 U0^2


def test_a_turning_ship_meets_her_rudder_at_a_smaller_angle():
    lift, v, r, behind = RudderLift(SHIP), -0.1, 0.4, 1.1
    angle = lift.angle(t(0.3, 0.3), t(v), t(r), t(behind, behind))
    assert angle[0] == pytest.approx(0.3 - atan2(0.1 + 0.5 * 0.4, behind))
    assert lift.angle(t(0.3, 0.3), t(0.0), t(0.0), t(behind, behind)).tolist() == [0.3, 0.3]


def test_the_righting_moment_is_weight_times_lever():
    length, speed, rho, phi = 200.0, 8.0, 1025.0, radians(5.0)
    newton_metres = rho * 9.80665 * SHIP.volume * length**3 * SHIP.gm * length * sin(phi)
    made = RightingMoment(SHIP.volume, SHIP.gm)(t(phi, 0.0, -phi), t(speed**2 / (9.80665 * length)))
    assert made[0] * 0.5 * rho * length**3 * speed**2 == pytest.approx(newton_metres)
    assert made[1] == 0.0 and made[2] == -made[0]


def test_munks_moment_is_that_of_the_drift_angle_and_turns_the_bow_off_the_course():
    u, v = 0.9, -0.2
    beta = atan2(-v, u)
    made = MunkMoment(SHIP.volume)(t(u), t(v))[0]
    assert made == pytest.approx(SHIP.volume * hypot(u, v) ** 2 * sin(2 * beta)) and made > 0
    assert MunkMoment(SHIP.volume)(t(1.0, 0.0), t(0.0, 1.0)).abs().max() == 0.0


def wind(u, v, psi, north, east):
    areas, coefficients = SHIP.wind_areas, SHIP.wind_coefficients
    return WindForce(areas, coefficients, 1025.0)(t(u), t(v), t(psi), t(north, east)[None])[0]


def test_still_air_adds_nothing():
    assert wind(1.0, 0.1, 0.7, 0.0, 0.0).abs().max() == 0.0


def test_wind_from_ahead_pushes_back_with_the_square_of_its_speed():
    x, y, n = wind(0.0, 0.0, 0.0, -2.0, 0.0)
    assert x == pytest.approx(-AIR / 1025.0 * 4.0 * 0.02 * 0.65, rel=1e-5)
    assert abs(y) < 1e-9 and abs(n) < 1e-9


def test_wind_from_the_side_pushes_a_loaded_cargo_ship_away_and_turns_it_about_the_middle_of_what_it_meets():
    x, y, n = wind(0.0, 0.0, 0.0, 0.0, 2.0)
    assert y == pytest.approx(AIR / 1025.0 * 4.0 * 0.06 * 0.85) and n == pytest.approx(-0.02 * y) and abs(x) < 1e-9
    assert SHIP.wind_coefficients == COEFFICIENTS["cargo_loaded"]


def test_wind_force_turns_with_the_compass_and_is_mirrored_with_the_ship():
    assert wind(0.8, 0.1, 0.3, -1.0, 0.5) == pytest.approx(wind(0.8, 0.1, 0.3 + pi / 2, -0.5, -1.0))
    assert wind(0.8, -0.1, -0.3, -1.0, -0.5) == pytest.approx(wind(0.8, 0.1, 0.3, -1.0, 0.5) * t(1.0, -1.0, -1.0))
    assert wind(0.0, 0.0, 0.0, 0.0, 2.0)[1] > 0  # wind from port


def test_all_forces_of_a_step_stand_side_by_side():
    forces = BasicForces(SHIP, rolls=True, pitches=True, wind=True)
    controls = torch.tensor([[0.3, 0.2, 35.0, 30.0, 0.5, 0.1]], dtype=torch.float64)
    velocities = torch.tensor([[0.9, -0.1, 0.01, 0.02, 0.0, 0.4]], dtype=torch.float64)
    made = forces(velocities, t(0.05, 0.01, 1.0)[None], controls, t(0.04))[0]
    assert len(made) == 10
    assert BasicForces(SHIP, rolls=True).wind is None, "it is in calm air unless it is told"
    assert made[4] == pytest.approx(float(RightingMoment(SHIP.volume, SHIP.gm)(t(0.05), t(0.04))))
    length = 1.0  # about which the metacentre lies above a trimming ship
    assert made[5] == pytest.approx(float(RightingMoment(SHIP.volume, length)(t(0.01), t(0.04))))
    assert made[6] == pytest.approx(float(MunkMoment(SHIP.volume)(t(0.9), t(-0.1))))
    swapped = forces(velocities, t(0.05, 0.01, 1.0)[None], controls[:, [1, 0, 3, 2, 4, 5]], t(0.04))[0]
    assert swapped[[1, 0, 3, 2]] == pytest.approx(made[:4])


def test_the_lift_of_a_step_is_that_of_the_rudders_and_of_the_race_that_they_turn():
    forces, controls = BasicForces(SHIP, rolls=False), t(0.3, 0.2, 35.0, 30.0)
    advance = (1 - SHIP.wake) * t(1.0)
    thrust = forces.thrust(controls[2:], advance)
    behind = forces.slipstream.speed(thrust, advance)
    _, turned = forces.slipstream(thrust, advance, controls[:2], behind)
    rudders = forces.lift(forces.lift.angle(controls[:2], t(0.0), t(0.0), behind), advance)
    lift = forces(t(1.0, 0.0, 0.0)[None], t(0.0)[None], controls[None], t(0.04))[0, 2:4]
    assert (turned > 0.1 * rudders).all()
    assert lift == pytest.approx(rudders + turned)


def test_forces_have_the_gradients_of_their_differences():
    forces = BasicForces(SHIP, rolls=True, wind=True)
    velocities = torch.tensor([[0.9, -0.1, 0.02, 0.4]], dtype=torch.float64, requires_grad=True)
    angles = t(0.05, 1.0)[None].requires_grad_()
    controls = torch.tensor([[0.3, 0.2, 35.0, 30.0, 0.5, 0.1]], dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda *x: forces(*x, t(0.04)), (velocities, angles, controls))


@pytest.mark.parametrize("change", [{"diameter": 0.0}, {"rudder_aspect": -1.0}, {"wake": 1.0}, {"deduction": -0.1}])
def test_sizes_that_no_ship_has_are_refused(change):
    with pytest.raises(InputError, match=f"forces.{next(iter(change))}"):
        replace(SHIP, **change)
