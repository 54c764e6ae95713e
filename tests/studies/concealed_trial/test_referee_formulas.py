"""The referee's formulas by a second route: the package's own equations, published tables, closed forms, hand sums.

The referee is written without the package; the two agree where their sources are the same.
"""

from dataclasses import replace
from math import cos, exp, pi, radians, sin, tanh

import numpy as np
import pytest
import torch
from pytest import approx

from manoeuvre_nn.core.effect import Situation
from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.effect.loading import DisplacementChange, TrimChange
from manoeuvre_nn.effect.local import SideForce
from manoeuvre_nn.effect.propulsion import (
    HullFouling,
    IceResistance,
    PowerLimit,
    PropellerPitchError,
    PropellerSideForce,
)
from manoeuvre_nn.effect.roll import RollCoupling
from manoeuvre_nn.effect.rudder import RudderAreaLoss
from manoeuvre_nn.effect.waves import WaveDrift
from manoeuvre_nn.ship.esso_190k import esso_190k
from manoeuvre_nn.ship.great_lakes_bulker import great_lakes_bulker
from manoeuvre_nn.ship.mariner import mariner_corrected
from studies.concealed_trial import forces, unmodelled, wind
from studies.concealed_trial.condition import Tables, change_depth, lose_rudder
from studies.concealed_trial.forces import Moment
from studies.concealed_trial.model_error import cubic
from studies.concealed_trial.motion import turned
from studies.concealed_trial.ships import trial_ships
from studies.concealed_trial.truth import SHAFT_LAG, ConcealedEffect, Gear, Sensors, build

SHIPS = trial_ships()
PACKAGE = {"mariner": mariner_corrected(), "great_lakes_bulker": great_lakes_bulker(), "esso_tanker": esso_190k()}
STATE = {"mariner": (6.2, -0.7, 0.009, -0.17), "great_lakes_bulker": (4.4, 0.5, -0.006, 0.13),
         "esso_tanker": (7.1, -0.9, 0.004, -0.22)}  # fmt: skip
"""u, v [m/s], r [rad/s] and the rudder [rad], positive to port."""
PSI, TIME, N = 2.1, 100.0, 0.9


def column(*values):
    return [np.array([float(v)]) for v in values]


def rates(name, truth, shaft=N):
    """Rates of the referee's state in that motion: x, y, psi, u, v, r, phi, p."""
    ship, (u, v, r, d) = SHIPS[name], STATE[name]
    state = np.array([[400.0], [-90.0], [PSI], [u], [v], [r], [0.06], [0.004]])
    return truth.derivative(TIME, state, *column(d, shaft * ship.rpm))[:, 0]


def situation(name, shaft=N):
    """The same for the package: the rudder is positive to starboard, accelerations are those at this shaft speed."""
    ship, (u, v, r, d) = PACKAGE[name], STATE[name]
    nu, delta, n = (torch.tensor([x], dtype=torch.float64) for x in ((u, v, r), -d, shaft))
    nudot = ship.acceleration(nu, delta) + ship.acceleration_from_force(ship.shaft_force(nu, delta, n))
    x, y, psi, time = (torch.tensor([c], dtype=torch.float64) for c in (400.0, -90.0, PSI, TIME))
    return Situation(nu, nudot, x, y, psi, delta, n, time)


def changed(name, effect, *more):
    """What a concealed effect adds to udot, vdot, rdot."""
    plain, acting = build(SHIPS[name], more, ["r01"]), build(SHIPS[name], [effect, *more], ["r01"])
    return (rates(name, acting) - rates(name, plain))[3:6]


@pytest.mark.parametrize("name", SHIPS)
def test_both_sets_of_equations_move_the_same_ship(name):
    """At another shaft speed, and with forces from outside."""
    truth, s = build(SHIPS[name], [], ["r01"]), situation(name)
    push = np.array([2e5, -3e5, 4e7])
    truth.forces.append(lambda now: push[:, None])
    expected = s.nudot[0] + PACKAGE[name].acceleration_from_si(torch.tensor(push))
    assert rates(name, truth)[3:6] == approx(expected.numpy(), rel=2e-4)


def package(name, kind, memory=0, **values):
    """What the package's effect adds."""
    effect, s = kind(PACKAGE[name], **values), situation(name)
    return effect.acceleration(s, torch.zeros(1, memory, dtype=torch.float64))[0].numpy()


ALIKE = {
    "wave_drift": (WaveDrift, {"Hs": 3.3, "from_deg": 250.0}),
    "side_force": (SideForce, {"force_kN": -310.0, "lever_m": -22.0}),
    "propeller_side_force": (PropellerSideForce, {"force_kN": 47.0}),
    "hull_fouling": (HullFouling, {"added_resistance": 0.37}),
    "ice_resistance": (IceResistance, {"force_kN": 71.0}),
    "propeller_pitch_error": (PropellerPitchError, {"fraction": -0.14}),
    "trim_change": (TrimChange, {"trim_m": 1.3}),
    "rudder_area_loss": (RudderAreaLoss, {"fraction": 0.23}),
    "displacement_change": (DisplacementChange, {"factor": 1.17}),
}
"""Effects that both define alike, and their parameters."""
ALWAYS = {"start_s": 0.0, "end_s": 500.0}
ONLY_MASS = {"hull_exponent": 0.0}
"""The referee leaves the hull as it is."""


@pytest.mark.parametrize("effect", ALIKE)
@pytest.mark.parametrize("name", SHIPS)
def test_effects_that_both_define_alike_add_the_same(name, effect):
    kind, parameters = ALIKE[effect]
    more = {"side_force": ALWAYS, "displacement_change": ONLY_MASS}.get(effect, {})
    expected = package(name, kind, **parameters, **more)
    found = changed(name, ConcealedEffect(effect, parameters))
    # The package parts a rounded displacement from the added mass: a thousandth.
    assert found == approx(expected, rel=3e-3, abs=3e-3 * np.abs(expected[:2]).max() / 100)


@pytest.mark.parametrize("name", SHIPS)
def test_a_thruster_pushes_42_percent_of_the_length_forward(name):
    ship = SHIPS[name]
    thruster = changed(name, ConcealedEffect("bow_thruster", {"force_kN": 66.0}))
    force = ConcealedEffect("side_force", {"force_kN": 66.0, "lever_m": 0.42 * ship.length})
    assert thruster == approx(changed(name, force))


def test_heel_turns_the_mariner_and_follows_her_turn_as_in_the_package():
    truth = build(SHIPS["mariner"], [ConcealedEffect("roll_coupling", {"N_phi": 0.013})], ["r01"])
    found = rates("mariner", truth) - rates("mariner", build(SHIPS["mariner"], [], ["r01"]))
    effect, s = RollCoupling(PACKAGE["mariner"], N_phi=0.013), situation("mariner")
    memory = torch.tensor([[0.06, 0.004]], dtype=torch.float64)
    assert found[3:6] == approx(effect.acceleration(s, memory)[0].numpy(), rel=2e-4)
    # The referee's dv/dt contains what heel does.
    after = s.with_(nudot=torch.tensor(rates("mariner", truth)[3:6])[None])
    assert rates("mariner", truth)[6:] == approx(effect.memory_rate(after, memory)[0].numpy(), rel=2e-4)


def test_heel_follows_a_side_force_as_in_the_package():
    heel, force = {"N_phi": 0.05}, {"force_kN": 700.0, "lever_m": 30.0}
    both = [ConcealedEffect("roll_coupling", heel), ConcealedEffect("side_force", force)]
    ship, (u, v, r, d) = PACKAGE["mariner"], STATE["mariner"]
    aboard = Vessel(CalmWater(ship), [RollCoupling(ship, **heel), SideForce(ship, **force, **ALWAYS)])
    state = torch.tensor([[u, v, r, 400.0, -90.0, PSI, 0.06, 0.004]], dtype=torch.float64)
    delta, time = torch.tensor([-d], dtype=torch.float64), torch.tensor([TIME], dtype=torch.float64)
    found = aboard.model(state, Inputs(delta, shaft=torch.full_like(delta, N), time=time))[0].numpy()
    expected, alone = (rates("mariner", one) for one in (build(SHIPS["mariner"], e, ["r01"]) for e in (both, [])))
    # Its dv/dt contains what heel does, too.
    assert found[[0, 1, 2]] == approx(expected[3:6], rel=1e-3)
    assert found[7] == approx(expected[7], rel=0.01) and abs(expected[7] - alone[7]) > 0.02 * abs(expected[7])


def test_a_power_limit_is_that_of_the_package_with_its_lag():
    truth = build(SHIPS["mariner"], [ConcealedEffect("power_limit", {"rpm_slope": 0.35})], ["r01"])
    limit = PowerLimit(PACKAGE["mariner"], rpm_slope=0.35)
    u = np.array([5.0])
    s = situation("mariner").with_(nu=torch.tensor([[5.0, 0.0, 0.0]], dtype=torch.float64))
    assert truth.shaft_speed(u)[0] / 76.0 == approx(float(limit.memory_at_start(s)))
    truth.telegraph = np.array([0.8])
    assert truth.shaft_speed(u)[0] == approx(0.8 * 76.0 * (1 - 0.35 * (1 - 5.0 / (0.8 * 7.614))))
    after = turned(truth, u, np.array([70.0]), 2.0)[0]
    goal = truth.shaft_speed(u)[0]
    assert after == approx(goal + (70.0 - goal) * exp(-2.0 / 8.0)) and SHAFT_LAG == 8.0
    assert turned(build(SHIPS["mariner"], [], ["r01"]), u, np.array([70.0]), 2.0)[0] == 70.0


def test_a_current_moves_the_place_and_nothing_else():
    effect = ConcealedEffect("current", {"speed": 0.9, "toward_deg": 200.0})
    change = rates("mariner", build(SHIPS["mariner"], [effect], ["r01"]))
    change -= rates("mariner", build(SHIPS["mariner"], [], ["r01"]))
    assert change == approx([0.9 * cos(radians(200)), 0.9 * sin(radians(200)), *[0.0] * 6], abs=1e-12)


FAULTS = {
    "rudder_offset": ({"offset_deg": -2.0}, Gear(offset=radians(-2.0))),
    "rudder_backlash": ({"width_deg": 3.0}, Gear(play=radians(3.0))),
    "rudder_slow": ({"rate_deg_s": 1.1}, Gear(slow_rate=radians(1.1))),
    "rudder_delay": ({"delay_s": 2.5}, Gear(delay=2.5)),
    "heading_bias": ({"bias_deg": 4.0}, Sensors(heading_bias=radians(4.0))),
    "rate_bias": ({"bias_deg_s": -0.2}, Sensors(rate_bias=radians(-0.2))),
    "log_scale": ({"factor": 1.07}, Sensors(log_scale=1.07)),
    "gps_lever_arm": ({"dx_m": -31.0, "dy_m": 4.0}, Sensors(lever=(-31.0, 4.0))),
}


@pytest.mark.parametrize("name", FAULTS)
def test_faults_of_gear_and_sensors_are_where_the_format_puts_them(name):
    parameters, fault = FAULTS[name]
    truth = build(SHIPS["mariner"], [ConcealedEffect(name, parameters)], ["r01"])
    assert (truth.gear, truth.sensors) == ((fault, Sensors()) if isinstance(fault, Gear) else (Gear(), fault))
    both = build(SHIPS["mariner"], [ConcealedEffect(n, FAULTS[n][0]) for n in FAULTS], ["r01"])
    assert both.gear == Gear(radians(-2.0), radians(3.0), radians(1.1), 2.5)
    assert both.sensors == Sensors(radians(4.0), rate_bias=radians(-0.2), log_scale=1.07, lever=(-31.0, 4.0))


def test_unlisted_sensors_are_wrong_as_they_say():
    def sensors(detail, **p):
        return build(SHIPS["mariner"], [ConcealedEffect("unknown", p, detail=detail)], ["r01"]).sensors

    beats = sensors("compass_two_beats", a=2.0, direction_deg=50.0)
    assert beats.heading(np.array([0.3]))[0] == approx(0.3 + radians(2.0) * cos(0.6 - radians(50.0)))
    assert sensors("log_by_heading", a=0.1, direction_deg=70.0).log_by_heading == approx((0.1, radians(70.0)))
    away = sensors("position_runs_away", a=1e-4, direction_deg=160.0).runaway
    assert away == approx((1e-4 * cos(radians(160)), 1e-4 * sin(radians(160))))
    assert sensors("rate_scale", a=-0.2).rate_scale == approx(0.8)


@pytest.mark.parametrize("ratio", [1.25, 1.6, 2.1, 4.0])
def test_the_tanker_in_shallow_water_is_that_of_the_package(ratio):
    depth = ratio * 18.46
    found = rates(
        "esso_tanker", build(SHIPS["esso_tanker"], [ConcealedEffect("shallow_water", {"depth_m": depth})], ["r"])
    )
    ship, s = esso_190k(depth=depth), situation("esso_tanker")
    force = ship.force(s.nu, s.delta) + ship.shaft_force(s.nu, s.delta, s.shaft)
    assert found[3:6] == approx(ship.acceleration_from_force(force)[0].numpy(), rel=2e-4)


def test_shallow_water_of_the_other_ships_is_kijimas_by_hand():
    """The bulk carrier at 1.5 draughts: 3^q - 2/3 of q = 1.0281, 1.0924 and .96849; zeta is 2."""
    tables, before = Tables.of(SHIPS["great_lakes_bulker"]), Tables.of(SHIPS["great_lakes_bulker"])
    change_depth(tables, 1.5 * 8.1)
    fullness = 0.905 * 23.005 / 8.1
    sway, moment = 3 ** (0.4 * fullness) - 2 / 3, 3 ** (0.425 * fullness) - 2 / 3
    turn, mass = 3 ** (1.5 - 14.28 * 8.1 / 217.627) - 2 / 3, before.ship.model["Delta"]
    k = before.k
    wanted = {"Yv": sway * k["Yv"], "Yvvv": sway * k["Yvvv"], "Nv": moment * k["Nv"], "Nr": turn * k["Nr"]}
    wanted["Yr"] = turn * (k["Yr"] + mass) - mass
    assert {n: v for n, v in tables.k.items() if v != k[n]} == approx(wanted)
    i = before.inertia
    assert tables.inertia["my"] == approx(mass + (i["my"] - mass) * 1.76)
    assert tables.inertia["mz"] == approx(mass / 16 + (i["mz"] - mass / 16) * 1.3)
    assert (tables.inertia["mx"], tables.inertia["Nvd"]) == (i["mx"], i["Nvd"])
    assert tables.resistance_gain == approx(1 / tanh(9.81 * 12.15 / 5.144**2))
    effect = ConcealedEffect("shallow_water", {"depth_m": 12.15})
    surge = changed("great_lakes_bulker", effect)[0] * i["mx"] * 0.5 * 1025 * 217.627**2 * 8.1
    assert surge == approx(-179.3e3 * (tables.resistance_gain - 1) * (4.4 / 5.144) ** 2, rel=1e-9)
    with pytest.raises(ValueError, match="the draught is 8.1 m"):
        change_depth(tables, 8.1)


def test_a_lost_rudder_is_lost_in_every_term_with_the_rudder_and_in_no_other():
    tables, before = Tables.of(SHIPS["esso_tanker"]), Tables.of(SHIPS["esso_tanker"])
    lose_rudder(tables, 0.4)
    lost = {n for n in tables.k if tables.k[n] != before.k[n]}
    assert lost == {"Xccdd", "Xccbd", "Yccd", "Yccbbd", "Yccbbdz", "Nccd", "Nccbbd", "Nccbbdz"}
    assert [tables.k[n] / before.k[n] for n in lost] == approx([0.6] * 8)


# Isherwood 1972, Tables 1 to 3, as the Marine Systems Simulator's isherwood72.m prints them: sums over the angles of
# each column, of the column times its row, and of the column times the square of its row.
SUMS = {
    "SURGE": [
        (6.664, -13.63, 0.929, -0.633, -2.477, 4.63, 0.115),
        (-84.332, 227.52, -2.878, 4.437, -37.898, 78.99, -0.925),
        (-2037.896, 4878.06, -95.098, 115.985, -521.194, 1350.41, -24.465),
    ],
    "SWAY": [
        (11.104, 7.43, 1.686, 0.003, -1.283, -7.54, 1.43),
        (103.45, 33.23, 18.936, -0.75, -13.827, -63.93, 19.17),
        (1115.738, 171.83, 231.58, -14.73, -167.909, -624.43, 258.55),
    ],
    "YAW": [
        (2.3069, 2.589, -0.2483, 0.086, 0.4644, -6.981),
        (17.7024, 13.014, -3.3457, 0.8768, 6.0998, -65.292),
        (173.4182, 73.69, -46.0005, 10.7238, 81.3794, -739.9),
    ],
}


@pytest.mark.parametrize("table", SUMS)
def test_isherwoods_tables_have_the_sums_of_the_published_ones(table):
    rows = np.arange(19)[:, None]
    found = [(rows**power * getattr(wind, table)).sum(0) for power in (0, 1, 2)]
    np.testing.assert_allclose(found, SUMS[table], atol=1e-4)


@pytest.mark.parametrize("angle, row", [(40, "starboard"), (130, "port")])
def test_wind_on_the_mariner_has_isherwoods_force_written_out(angle, row):
    """Rows of 40 and 130 deg; A_F 420, A_L 1650, L_oa 158, B 21.763, S 200, A_SS 480 m, C 83 m, three masts."""
    lateral, frontal, slender, outline, centre = (
        2 * 1650 / 158**2,
        2 * 420 / 21.763**2,
        158 / 21.763,
        200 / 158,
        83 / 158,
    )
    if angle == 40:
        cx = -(2.333 - 5.99 * lateral + 0.247 * frontal - 0.190 * slender + 0.042 * 3)
        cy = 0.329 + 1.82 * lateral + 0.043 * slender - 0.59 * centre
        cn = 0.2017 + 0.457 * lateral + 0.0067 * slender - 0.472 * centre
    else:
        cx = -(-0.142 + 3.58 * lateral + 0.047 * slender - 0.700 * outline - 0.028 * 3)
        cy = 1.014 + 0.191 * frontal - 0.280 * outline - 0.69 * centre + 0.44 * 480 / 1650
        cn = -0.0189 - 0.0488 * frontal + 0.0101 * slender + 0.1128 * outline - 0.420 * centre
    side = -1 if row == "starboard" else 1  # wind from port pushes to starboard
    q = 0.5 * 1.225 * 11.0**2
    expected = [q * 420 * cx, side * q * 1650 * cy, side * q * 1650 * 158 * cn]
    # A ship at rest on heading 25 deg; the wind comes out of the angle on that side.
    blows_from = 25.0 + (angle if row == "starboard" else -angle)
    blowing = forces.wind(SHIPS["mariner"], {"speed": 11.0, "from_deg": blows_from}, forces.gate("all", ["r01"]))
    now = Moment(3.0, *column(0, 0, radians(25.0), 0, 0, 0, 0, 76))
    assert blowing(now)[:, 0] == approx(expected, rel=1e-9)


def test_wind_is_that_of_the_ships_motion_through_air_less_still_air_with_its_gusts():
    ship, acts = SHIPS["great_lakes_bulker"], forces.gate({"r01": [[50, 400]]}, ["r01"], 40.0)
    air, given = wind.Isherwood(ship), {"speed": 9.0, "from_deg": 300.0}
    gusts = np.array([[0.0], [2.0], [5.0], *[[-20.0]] * 80])
    now = {t: Moment(t, *column(0, 0, 0.9, 4.0, -0.6, 0, 0, 88)) for t in (-5.0, 1.25, 45.0, 60.0, 500.0)}
    plain, gusty = forces.wind(ship, given, acts), forces.wind(ship, given, acts, gusts)

    def expected(speed):
        ahead = 4.0 + speed * cos(radians(300) - 0.9)
        across = -0.6 + speed * sin(radians(300) - 0.9)
        return (air._at(*column(ahead, across)) - air._at(*column(4.0, -0.6)))[:, 0]

    for t, share in ((1.25, 0.0), (45.0, 0.375), (60.0, 0.75), (500.0, 0.0)):
        assert plain(now[t])[:, 0] == approx(expected(9.0 * share), abs=1e-6), t
    assert gusty(now[1.25])[:, 0] == approx(expected(2.75)), "three quarters of the first second, one of the next"
    assert gusty(now[-5.0])[:, 0] == approx(expected(0.0), abs=1e-6)
    assert gusty(now[60.0])[:, 0] == approx(expected(0.0), abs=1e-6), "a lull does not blow the other way"


@pytest.mark.parametrize("term, factors", [
    ("Xuvv", "uvv"), ("Xuvr", "uvr"), ("Yvrd", "vrd"), ("Yrrd", "rrd"), ("Nuuv", "uuv"), ("Nuud", "uud"),
])  # fmt: skip
def test_a_missing_term_has_its_share_of_a_rudders_force_at_usual_sizes(term, factors):
    ship = SHIPS["great_lakes_bulker"]
    usual = {"u": 0.3, "v": 0.2, "r": 0.35, "d": 0.35}
    a, b, q, d = 0.11, -0.17, 0.23, -0.3
    now = Moment(0.0, *column(0, 0, 0, ship.speed * (1 + a), ship.speed * b, q * ship.speed / ship.length, d, 88))
    product = np.prod([{"u": a, "v": b, "r": q, "d": d}[f] / usual[f] for f in factors])
    typical = {"X": 0.008, "Y": 0.02, "N": 0.01 * ship.length}[term[0]]
    unit = 0.5 * 1025 * 217.627 * 8.1 * 5.144**2
    expected = np.zeros(3)
    expected["XYN".index(term[0])] = 0.07 * typical * unit * product
    assert cubic(ship, term, 0.07)(now)[:, 0] == approx(expected)


MOVING = (300.0, -120.0, 1.3, 5.9, -0.8, 0.011)
"""x, y, psi, u, v, r of the Mariner."""
Q, B = 0.011 * 152.4 / 7.614, -0.8 / 7.614
UNLISTED = {
    "cubic_by_heading": ({}, 1, Q**3 * cos(3.9)),
    "lopsided_turn": ({}, 2, Q**2),
    "beat": ({"period_s": 41.0}, 2, sin(2 * pi * 130.0 / 41.0)),
    "turn_drag": ({}, 0, -Q * 5.9 / 7.614),
    "by_speed": ({}, 2, (5.9 / 7.614) ** 3 * B),
    "striped_water": ({"stripes_deg": 35.0, "spacing_m": 800.0}, 1,
                      sin(2 * pi * (300 * cos(radians(35)) - 120 * sin(radians(35))) / 800)),
    "damped_drift": ({}, 1, Q * -B),
    "sway_beat": ({"period_s": 77.0}, 1, sin(2 * pi * 130.0 / 77.0)),
    "late_turn": ({"lag_s": 30.0}, 2, 0.4),
    "growing_push": ({}, 1, 130.0 / 600.0),
    "growing_drag": ({}, 0, -130.0 / 600.0),
}  # fmt: skip


@pytest.mark.parametrize("detail", UNLISTED)
def test_forces_that_no_list_has_are_what_they_say(detail):
    ship = SHIPS["mariner"]
    more, row, value = UNLISTED[detail]
    unit = 0.5 * 1025 * 152.4 * 8.138 * 7.614**2 * (152.4 if row == 2 else 1.0)
    now = Moment(130.0, *column(*MOVING, 0.2, 76), np.array([0.4]))
    expected = np.zeros(3)
    expected[row] = 0.03 * unit * value
    assert unmodelled.unmodelled_force(ship, detail, {"a": 0.03, **more})(now)[:, 0] == approx(expected)
    turned = replace(now, r=-now.r)
    other = {"lopsided_turn": 0.0, "damped_drift": 1.0, "turn_drag": 1.0, "cubic_by_heading": -1.0}.get(detail)
    if other is not None:
        found = unmodelled.unmodelled_force(ship, detail, {"a": 0.03, **more})(turned)[:, 0]
        assert found == approx(other * expected)


@pytest.mark.parametrize("detail, row", [("random_push", 1), ("random_moment", 2)])
def test_a_random_force_follows_its_course_second_by_second(detail, row):
    ship, given = SHIPS["mariner"], {"a": 0.02, "tau_s": 40.0, "chance": 77.0}
    course = unmodelled.random_course(77.0, 40.0, ["r01", "r02"])
    assert course.shape == (4000, 2)
    force = unmodelled.unmodelled_force(ship, detail, given, ["r01", "r02"])
    unit = 0.02 * 0.5 * 1025 * 152.4 * 8.138 * 7.614**2 * (152.4 if row == 2 else 1.0)
    for t, second in ((-3.0, 0), (0.0, 0), (17.9, 17), (1e6, 3999)):
        two = Moment(t, *[np.array([x, x]) for x in (*MOVING, 0.2, 76.0)])
        np.testing.assert_allclose(force(two)[row], unit * course[second])
        assert np.count_nonzero(force(two).any(1)) == 1
    many = unmodelled.random_course(3.0, 20.0, [f"r{k}" for k in range(60)])[200:]
    assert many.std() == approx(1.0, abs=0.03)
    for lag in (5, 20, 40):
        assert np.mean(many[lag:] * many[:-lag]) == approx(exp(-lag / 20.0), abs=0.04)


def test_strange_rudders_lose_their_share_between_their_angles():
    angles = np.array([7.5, 7.75, 8.0, 11.0, 14.0, 14.25, 14.5, 20.0])
    kept = [1.0, 1 - 0.15, 0.7, 0.7, 0.7, 1 - 0.15, 1.0, 1.0]
    for sign in (1, -1):
        felt = unmodelled.felt_angle("rudder_hole", {"a": 0.3}, np.radians(sign * angles))
        np.testing.assert_allclose(np.degrees(felt), sign * angles * kept, atol=1e-9)
    weak = unmodelled.felt_angle("weak_to_port", {"a": 0.3}, np.array([0.2, -0.2, 0.0]))
    np.testing.assert_allclose(weak, [0.14, -0.2, 0.0])
