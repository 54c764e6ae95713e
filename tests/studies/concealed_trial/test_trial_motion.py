"""The generator's own motion, against published numbers and closed forms."""

import numpy as np
import pytest
from tiers import only

from studies.concealed_trial.condition import Tables, change_depth
from studies.concealed_trial.helm import PULL_OUT, SPIRAL_DEG, Run, SteeringGear, TrialHelm, play
from studies.concealed_trial.motion import replay, runge_kutta, sail
from studies.concealed_trial.ships import trial_ships
from studies.concealed_trial.truth import ConcealedEffect, Gear, build

SHIPS = trial_ships()
CHECKS = {
    "mariner": {
        150: (584.391, 584.815, 121.9949, 5.65169, -1.02005, 0.875750),
        300: (455.021, 1340.257, 34.3698, 5.31390, 0.98702, -0.826611),
    },
    "great_lakes_bulker": {
        150: (603.861, 212.226, 72.4212, 3.47860, -0.77495, 0.615934),
        300: (724.254, 682.591, 41.3356, 2.78075, 0.75931, -0.606152),
    },
    "esso_tanker": {
        150: (1084.409, 276.390, 57.2978, 6.44249, -1.41132, 0.555253),
        300: (1492.307, 1091.690, 49.6732, 5.96963, 0.87910, -0.456581),
    },
}
"""Published check motions: x, y, psi, u, v, r at two times, rudder to -20 deg at 0 s and to +20 deg at 150 s."""


def at_speed(ship, columns=1):
    state = np.zeros((8, columns))
    state[3] = ship.speed
    return state


def held(truth, degrees, seconds, columns=1, start=None, step=0.5):
    """States with a rudder that is held from the start."""
    shown = np.full((seconds + 1, columns), np.radians(degrees))
    start = at_speed(truth.ship, columns) if start is None else start
    return replay(truth, start, np.arange(seconds + 1.0), shown, shown, step=step)


@pytest.mark.parametrize("name", only(set(SHIPS) - {"great_lakes_bulker"}, SHIPS))
def test_motion_is_that_of_the_published_check_motions(name):
    ship, step = SHIPS[name], 0.1
    truth = build(ship, [], ["r01"])
    state, n = at_speed(ship), np.array([ship.rpm])
    gear = SteeringGear(Gear(), ship.rate, np.zeros(1))
    for k in range(3000):
        before = gear.blade
        gear.advance(np.radians([-20.0 if k < 1500 else 20.0]), step)
        state = runge_kutta(truth, k * step, state, before, gear.blade, n, step)
        if (k + 1) in {1500, 3000}:
            x, y, psi, u, v, r = state[:6, 0]
            found = (x, y, np.degrees(psi), u, v, np.degrees(r))
            np.testing.assert_allclose(found, CHECKS[name][(k + 1) // 10], rtol=2e-6, atol=2e-3)


def test_a_ship_without_asymmetry_mirrors_its_turn():
    truth = build(SHIPS["great_lakes_bulker"], [], ["a"])
    starboard, port = held(truth, -15.0, 150)[-1], held(truth, 15.0, 150)[-1]
    mirror = np.array([1, -1, -1, 1, -1, -1, 1, 1.0])[:, None]
    np.testing.assert_allclose(starboard, mirror * port, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("name", SHIPS)
def test_a_current_only_shifts_the_track(name):
    ship = SHIPS[name]
    still = held(build(ship, [], ["a"]), -20.0, 200)
    current = ConcealedEffect("current", {"speed": 0.8, "toward_deg": 120.0})
    moved = held(build(ship, [current], ["a"]), -20.0, 200)
    t = np.arange(201.0)
    np.testing.assert_allclose(moved[:, 2:], still[:, 2:], atol=1e-12)
    np.testing.assert_allclose(moved[:, 0, 0] - still[:, 0, 0], 0.8 * np.cos(np.radians(120)) * t, atol=1e-8)
    np.testing.assert_allclose(moved[:, 1, 0] - still[:, 1, 0], 0.8 * np.sin(np.radians(120)) * t, atol=1e-8)


def test_the_play_operator_leaves_half_the_play_on_either_side():
    given = np.concatenate([np.linspace(0, 3, 31), np.linspace(3, -3, 61), np.linspace(-3, 3, 61)])
    output, values = np.zeros(1), []
    for value in given:
        output = play(output, np.array([value]), 1.0)
        values.append(output[0])
    values = np.array(values)
    assert np.abs(values - given).max() <= 0.5 + 1e-12
    assert values[30] == pytest.approx(2.5)  # on the way up it lags by half the play
    np.testing.assert_allclose(values[30:41], 2.5)  # and rests until the play is taken up
    assert values[91] == pytest.approx(-2.5)


def test_the_blade_of_a_slow_gear_comes_late_while_the_indicator_is_on_time():
    gear = SteeringGear(Gear(slow_rate=0.01, offset=0.02), 0.04, np.zeros(1))
    for _ in range(100):
        gear.advance(np.array([0.3]), 0.1)
    assert gear.indicator[0] == pytest.approx(0.3)
    assert gear.blade[0] == pytest.approx(0.1 + 0.02)


def test_the_shown_angle_of_a_late_rudder_is_that_of_before():
    ship = SHIPS["mariner"]
    run = Run("r01", "fit", "zz20", "port", 30.0, 120)
    track = sail(build(ship, [], ["r01"]), [run], step=0.5)
    on_time, late = track.shown(), track.shown(3.0)
    np.testing.assert_allclose(late[3:], on_time[:-3], atol=1e-12)


def test_a_ship_in_a_steady_turn_heels_by_what_the_definition_says():
    ship = SHIPS["mariner"]
    state = held(build(ship, [ConcealedEffect("roll_coupling", {"N_phi": 1e-9})], ["a"]), 10.0, 700, step=1.0)
    u, r, heel = state[-1, 3, 0], state[-1, 5, 0], state[-1, 6, 0]
    steady = -(8.4 - 8.138 / 2) / (9.81 * 0.6) * u * r
    assert heel == pytest.approx(steady, rel=1e-3)
    assert heel > 0 > r  # outwards


def test_the_approach_is_straight_and_the_first_turn_goes_where_it_should():
    ship = SHIPS["mariner"]
    runs = [Run("r01", "fit", "tc20", "port", 30.0, 150), Run("r02", "fit", "zz20", "starboard", 200.0, 150)]
    track = sail(build(ship, [], ["r01", "r02"]), runs, step=0.5)
    np.testing.assert_allclose(np.degrees(track.state[:60, 2]), np.tile([30.0, 200.0], (60, 1)), atol=0.02)
    assert track.state[120, 5, 0] < 0 < track.state[80, 5, 1]
    assert np.degrees(track.order[100, 0]) == pytest.approx(20.0)
    assert np.degrees(track.order[62, 1]) == pytest.approx(-20.0)
    turned_back = np.flatnonzero(track.order[:, 1] > 0.3)[0]
    assert np.degrees(track.state[turned_back, 2, 1]) == pytest.approx(220.0, abs=1.0)


@pytest.mark.parametrize("name", SHIPS)
def test_very_deep_water_is_deep_water(name):
    ship = SHIPS[name]
    deep = Tables.of(ship)
    change_depth(deep, 1e6 * ship.draught)
    for coefficient, value in Tables.of(ship).k.items():
        assert deep.k[coefficient] == pytest.approx(value, rel=1e-4)


@pytest.mark.parametrize("name", SHIPS)
def test_shallow_water_widens_the_turn(name):
    ship = SHIPS[name]
    shallow = build(ship, [ConcealedEffect("shallow_water", {"depth_m": 1.4 * ship.draught})], ["a"])
    deep = build(ship, [], ["a"])
    radius = [
        state[-1, 3, 0] / abs(state[-1, 5, 0]) for state in (held(w, -15.0, 400, step=1.0) for w in (shallow, deep))
    ]
    assert radius[0] > 1.1 * radius[1]


def test_a_course_is_kept_by_three_terms_and_a_manoeuvre_follows_its_plan():
    ship = SHIPS["mariner"]
    runs = [Run("a", "fit", "zz20", "port", 30.0, 400), Run("b", "fit", "po15", "starboard", 30.0, 400),
            Run("c", "fit", "spiral", None, 30.0, 840), Run("d", "fit", "straight", None, 30.0, 400),
            Run("e", "fit", "tc35", "starboard", 30.0, 400)]  # fmt: skip
    helm, unit = TrialHelm(ship, runs), 152.4 / 7.614
    heading, rate = np.radians(30.0) + np.array([0.02, -0.02, 0.5, -0.9, 0.0]), np.array([0.001, 0.002, 0, 0, 0])
    error = heading - np.radians(30.0)
    for k in (1, 2):
        expected = np.clip(1.5 * error + 3 * unit * rate + k * 0.4 * error * 0.2 / unit, -0.5, 0.5)
        np.testing.assert_allclose(helm.order(10.0, heading, rate, 0.4), expected)
    for _ in range(3000):
        helm.order(20.0, heading, 0 * rate, 0.4)
    assert np.abs(helm.integral).max() == pytest.approx(np.radians(15.0))
    at = np.radians(30.0)
    started = np.degrees(helm.order(60.0, np.full(5, at), rate, 0.4))
    np.testing.assert_allclose(started, [20.0, -15.0, -15.0, 0.0, -35.0])
    swung = np.array([at - np.radians(20.0), at + np.radians(60.0), at, at + 1.0, at + 9.0])
    assert np.degrees(helm.order(130.0, swung + [0.01, -0.01, 0, 0, 0], rate, 0.4)).tolist() == pytest.approx([
        20.0,
        -15.0,
        -10.0,
        0.0,
        -35.0,
    ]), "not yet"
    turned_back = np.degrees(helm.order(180.0, swung + [-1e-9, 1e-9, 0, 0, 0], rate, 0.4))
    np.testing.assert_allclose(turned_back, [-20.0, 0.0, -6.0, 0.0, -35.0], atol=1e-12)
    later = np.degrees(helm.order(300.0, np.full(5, at), rate, 0.4))
    np.testing.assert_allclose(later, [-20.0, 0.0, 0.0, 0.0, -35.0], atol=1e-12)
    assert np.degrees(helm.order(345.0, np.full(5, at + np.radians(20.001)), rate, 0.4))[0] == pytest.approx(20.0)
    assert np.degrees(helm.order(5000.0, np.full(5, at), rate, 0.4))[2] == pytest.approx(-15.0)
    assert np.degrees(PULL_OUT) == pytest.approx(60.0) and len(SPIRAL_DEG) == 13
    assert [SPIRAL_DEG[k] for k in (0, 3, 8, 12)] == [-15.0, -3.0, 15.0, -15.0] and sum(SPIRAL_DEG) == -15.0
