"""Forces and sensor errors of the generator, against their definitions."""

import numpy as np
import pytest

from studies.concealed_trial import forces, unmodelled
from studies.concealed_trial.condition import Tables, change_displacement, change_trim, lose_rudder
from studies.concealed_trial.effects import KINDS, NAMES, UNMODELLED
from studies.concealed_trial.motion import replay
from studies.concealed_trial.ships import trial_ships
from studies.concealed_trial.start import shown_by_recorder
from studies.concealed_trial.truth import ConcealedEffect, build
from studies.concealed_trial.wind import Isherwood

SHIPS = trial_ships()
MARINER = SHIPS["mariner"]


def moment(ship=MARINER, **changes):
    values = {"x": 0.0, "y": 0.0, "psi": 0.0, "u": ship.speed, "v": 0.0, "r": 0.0, "d": 0.0, "n": ship.rpm} | changes
    return forces.Moment(
        changes.pop("t", 100.0), **{k: np.array([float(values[k])]) for k in "x y psi u v r d n".split()}
    )


def always(runs=("r01",)):
    return forces.gate("all", list(runs))


@pytest.mark.parametrize("from_deg", [0.0, 50.0, 90.0, 200.0, 300.0])
def test_wave_drift_is_that_of_the_definition(from_deg):
    force = forces.wave_drift(MARINER, {"Hs": 3.0, "from_deg": from_deg}, always())
    q, a = 1025 * 9.81 * 152.4 * 9.0 / 16, np.radians(from_deg - 40.0)
    expected = [-0.08 * q * np.cos(a), -0.35 * q * np.sin(a) * abs(np.sin(a)), -0.03 * q * 152.4 * np.sin(2 * a)]
    np.testing.assert_allclose(force(moment(psi=np.radians(40.0)))[:, 0], expected, rtol=1e-12)


def test_no_wind_is_no_force_and_wind_from_either_side_mirrors():
    wind, zero = Isherwood(MARINER), np.zeros(1)
    speed = np.array([7.0])
    np.testing.assert_allclose(wind.force(zero, 1.0, zero, speed, zero), 0.0, atol=1e-9)
    from_port = wind.force(np.array([10.0]), np.radians(70.0), zero, speed, zero)
    from_starboard = wind.force(np.array([10.0]), np.radians(-70.0), zero, speed, zero)
    np.testing.assert_allclose(from_port[:, 0], [1, -1, -1] * from_starboard[:, 0])
    assert from_port[1, 0] > 0


def test_wind_coefficients_are_those_of_isherwoods_table_on_the_beam():
    wind, zero = Isherwood(MARINER), np.zeros(1)
    y = wind.force(np.array([10.0]), np.radians(90.0), zero, zero, zero)[1, 0]
    coefficient = 0.889 + 0.138 * 2 * 420 / 21.763**2 - 0.66 * (79.0 + 4.0) / 158
    assert y == pytest.approx(0.5 * 1.225 * 100 * 1650 * coefficient, rel=1e-9)


def test_a_force_in_an_interval_acts_in_its_own_run_only():
    gate = forces.gate({"r01": [[100, 200]], "r02": [[150, 160], [300, 310]]}, ["r01", "r02", "r03"])
    np.testing.assert_array_equal(gate(99.9), [0, 0, 0])
    np.testing.assert_array_equal(gate(155.0), [1, 1, 0])
    np.testing.assert_array_equal(gate(305.0), [0, 1, 0])


def test_the_propellers_side_force_goes_with_n_squared_at_its_lever():
    force = forces.propeller_side(MARINER, {"force_kN": 10.0})(moment(n=38.0))
    np.testing.assert_allclose(force[:, 0], [0.0, 2500.0, -0.48 * 152.4 * 2500.0])


def test_fouling_and_ice_resist_as_they_are_defined():
    slow = moment(u=MARINER.speed / 2)
    assert forces.fouling(MARINER, 0.2)(slow)[0, 0] == pytest.approx(-0.2 * 350.1e3 / 4)
    assert forces.ice(80.0)(slow)[0, 0] == -80e3


@pytest.mark.parametrize("name", SHIPS)
def test_thrust_at_the_approach_speed_is_the_resistance(name):
    ship = SHIPS[name]
    thrust = build(ship, [], ["a"]).equations.thrust(np.array([ship.speed]), np.array([ship.rpm]))
    assert thrust[0] == pytest.approx(ship.resistance, rel=0.01)


@pytest.mark.parametrize("name", SHIPS)
def test_a_pitch_error_pushes_by_its_share_of_the_thrust(name):
    ship = SHIPS[name]
    wrong = build(ship, [ConcealedEffect("propeller_pitch_error", {"fraction": 0.1})], ["a"])
    state, n = np.zeros((8, 1)), np.array([ship.rpm])
    state[3] = ship.speed
    gain = (
        wrong.derivative(0.0, state, np.zeros(1), n) - build(ship, [], ["a"]).derivative(0.0, state, np.zeros(1), n)
    )[3]
    inertia = ship.model["coefficients"].get("m11") or ship.model["inertia"]["mx"] / ship.mass_prime
    mass = ship.mass_prime * 0.5 * 1025 * ship.length**2 * ship.draught
    assert gain[0] * inertia * mass == pytest.approx(0.1 * ship.resistance, rel=0.01)


def test_mass_comes_with_its_coriolis_force():
    tables = Tables.of(MARINER)
    change_displacement(tables, 1.1)
    assert tables.inertia["mx"] == pytest.approx(0.177 + 0.0168)
    assert tables.k["Xvr"] == pytest.approx(0.168 * 1.1)
    assert tables.k["Yr"] == pytest.approx(-0.105 - 0.0168)


@pytest.mark.parametrize("name", SHIPS)
def test_trim_by_the_stern_makes_a_ship_more_stable(name):
    ship = SHIPS[name]
    tables, drift = Tables.of(ship), "Nuv" if ship.is_tanker else "Nv"
    change_trim(tables, 0.2 * ship.draught)
    assert tables.k[drift] > ship.model["coefficients"][drift]


def test_a_rudder_without_area_is_none():
    for ship in SHIPS.values():
        tables = Tables.of(ship)
        lose_rudder(tables, 1.0)
        shown = np.zeros((8, 2))
        shown[3] = ship.speed
        rates = tables.equations().accelerations(
            *shown[3:6], np.array([0.0, 0.5]), np.full(2, ship.rpm), np.zeros((3, 2))
        )
        np.testing.assert_allclose(rates[:, 0], rates[:, 1], atol=1e-15)


def test_a_shaft_under_a_power_limit_slows_down_with_the_ship():
    ship = MARINER
    truth = build(ship, [ConcealedEffect("power_limit", {"rpm_slope": 0.4})], ["a"])
    assert truth.shaft_speed(np.array([ship.speed / 2]))[0] == pytest.approx(0.8 * 76.0)
    assert truth.shaft_speed(np.array([ship.speed]))[0] == pytest.approx(76.0)


def test_an_antenna_off_centre_shows_the_speed_of_its_place():
    truth = build(MARINER, [ConcealedEffect("gps_lever_arm", {"dx_m": -40.0, "dy_m": 5.0})], ["a"])
    t = np.arange(101.0)
    shown = np.full((101, 1), np.radians(-20.0))
    start = np.zeros((8, 1))
    start[3] = MARINER.speed
    states = replay(truth, start, t, shown, shown, step=0.1)[:, :6, 0]
    table = shown_by_recorder(truth, t, states)
    r = states[:, 5]
    np.testing.assert_allclose(table["v"], states[:, 4] - 40.0 * r, atol=1e-9)
    np.testing.assert_allclose(table["u"], states[:, 3] - 5.0 * r, atol=1e-9)
    speed = np.hypot(np.gradient(table["x"]), np.gradient(table["y"]))[5:-5]
    np.testing.assert_allclose(speed, np.hypot(table["u"], table["v"])[5:-5], atol=2e-3)


def test_a_compass_bias_turns_the_recorded_speeds():
    truth = build(MARINER, [ConcealedEffect("heading_bias", {"bias_deg": 3.0})], ["a"])
    state = np.array([[0.0, 0.0, 0.5, 7.0, 0.0, 0.0]])
    table = shown_by_recorder(truth, np.zeros(2), np.vstack([state, state]))
    np.testing.assert_allclose(table["psi"], np.degrees(0.5) + 3.0)
    np.testing.assert_allclose(table["v"], -7.0 * np.sin(np.radians(3.0)))


def test_the_rudders_hole_is_between_its_two_angles():
    felt = np.degrees(unmodelled.felt_angle("rudder_hole", {"a": 0.5}, np.radians(np.array([5.0, 10.0, -10.0, 20.0]))))
    np.testing.assert_allclose(felt, [5.0, 5.0, -5.0, 20.0])
    weak = unmodelled.felt_angle("weak_to_port", {"a": 0.2}, np.array([0.1, -0.1]))
    np.testing.assert_allclose(weak, [0.08, -0.1])


def test_every_unlisted_force_acts_in_the_equation_that_it_names():
    parameters = {"a": 0.01, "period_s": 40.0, "stripes_deg": 30.0, "spacing_m": 900.0}
    parameters |= {"lag_s": 30.0, "tau_s": 30.0, "chance": 5.0}
    now = moment(x=100.0, y=20.0, psi=0.3, v=-1.0, r=0.01)
    now.lagged = np.array([0.2])
    for detail, (equation, _) in unmodelled.FORCES.items():
        force = unmodelled.unmodelled_force(MARINER, detail, parameters, ["r01"])(now)[:, 0]
        assert [row for row, value in zip("XYN", force, strict=True) if value] == [equation]


def test_every_name_of_the_format_can_be_drawn():
    listed = """wind_steady wind_gusty wind_onset current shallow_water wave_drift rudder_offset rudder_backlash
        rudder_slow rudder_delay rudder_area_loss propeller_side_force propeller_pitch_error power_limit hull_fouling
        ice_resistance displacement_change trim_change roll_coupling side_force bow_thruster heading_bias rate_bias
        log_scale gps_lever_arm unknown""".split()
    assert sorted(NAMES) == sorted(listed)
    assert len({kind.detail for kind in UNMODELLED}) >= 8
    assert all(kind.low < kind.high for kind in (*KINDS, *UNMODELLED))
