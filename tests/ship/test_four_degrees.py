"""Ships that roll: Son & Nomoto's container ship and Blanke & Christensen's naval vessel."""

from dataclasses import replace
from math import atan, cos, pi, sin, sqrt

import numpy as np
import pytest
import torch
from pytest import approx

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.replay import replay
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.dynamics.simulate import simulate
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.effect.wind import SteadyWind
from manoeuvre_nn.manoeuvre.turning import tactical_circle, tactical_circles
from manoeuvre_nn.manoeuvre.zigzag import overshoot
from manoeuvre_nn.ship.container import DRIVE, container
from manoeuvre_nn.ship.four_degrees import FourDegreeShip, twin
from manoeuvre_nn.ship.naval_vessel import ADDED, naval_vessel

SHIPS = {"container": container, "twin": lambda: container(screws=2), "naval": naval_vessel}


def tensor(*values: float) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.float64)


def moving(ship: FourDegreeShip) -> tuple[torch.Tensor, torch.Tensor]:
    """A state in a turn to starboard: u, v, r; phi, p."""
    p = ship.particulars
    return tensor(0.8 * p.speed, -0.1 * p.speed, 0.3 * p.speed / p.length), tensor(-0.1, 0.01)


def son_and_nomoto(u: float, v: float, r: float, p: float, phi: float, delta: float, n: float) -> list[float]:
    """udot, vdot, rdot, pdot [SI] by the equations as printed, in prime values of the instantaneous speed."""
    length, speed = 175.0, sqrt(u * u + v * v)
    u, v, r, p = u / speed, v / speed, r * length / speed, p * length / speed
    m, mx, my, weight = 0.00792, 0.000238, 0.007049, 9.81 * 21222 / (length**2 * speed**2 / 2)
    u_p = u * ((1 - 0.184) + 1.09 * (v - 0.526 * r) ** 2)
    advance = u_p * speed / (n * 6.533)
    k_t = 0.527 - 0.455 * advance
    u_r = u_p * 0.921 * sqrt(1 + 8 * 0.631 * k_t / (pi * advance**2))
    v_r = 0.088 * v - 0.156 * r - 0.275 * r**3 + 1.96 * r**2 * v
    attack = delta + atan(v_r / u_r)
    normal = -6.13 * 1.8219 / (1.8219 + 2.25) * 33.0376 / length**2 * (u_r**2 + v_r**2) * sin(attack)
    thrust = 2 * 6.533**4 / (speed**2 * length**2) * k_t * n * n
    surge = -0.0004226 * u**2 + (1 - 0.175) * thrust - 0.00311 * v * r - 0.00386 * v**2 + 0.0002 * r**2
    surge += -0.0002 * phi**2 + 0.71 * normal * sin(delta) + (m + my) * v * r
    sway = -0.0116 * v + 0.00242 * r - 0.000063 * phi - 0.109 * v**3 + 0.00177 * r**3 + 0.0214 * v**2 * r
    sway += -0.0405 * v * r**2 + 0.04605 * v**2 * phi + 0.00304 * v * phi**2 + 0.009325 * r**2 * phi
    sway += -0.001368 * r * phi**2 + 1.237 * normal * cos(delta) - (m + mx) * u * r
    heel = 0.0003026 * v - 0.000063 * r - 0.0000075 * p - 0.000021 * phi + 0.002843 * v**3 - 0.0000462 * r**3
    heel += -0.000588 * v**2 * r + 0.0010565 * v * r**2 - 0.0012012 * v**2 * phi - 0.0000793 * v * phi**2
    heel += -0.000243 * r**2 * phi + 0.00003569 * r * phi**2 - 1.237 * 0.033 * normal * cos(delta)
    heel += mx * 0.0313 * u * r - weight * 0.3 / length * phi
    yaw = -0.0038545 * v - 0.00222 * r + 0.000213 * p - 0.0001424 * phi + 0.001492 * v**3 - 0.00229 * r**3
    yaw += -0.0424 * v**2 * r + 0.00156 * v * r**2 - 0.019058 * v**2 * phi - 0.0053766 * v * phi**2
    yaw += -0.0038592 * r**2 * phi + 0.0024195 * r * phi**2 + (-0.5 - 0.237 * 0.48) * normal * cos(delta)
    lever, arm = -my * 0.0313, my * 0.05
    mass = np.array([[m + my, arm, lever], [arm, 0.000875, 0.0], [lever, 0.0, 0.000021]])
    vdot, rdot, pdot = np.linalg.solve(mass, [sway, yaw, heel])
    unit = speed**2 / length
    return [surge / (m + mx) * unit, vdot * unit, rdot * unit / length, pdot * unit / length]


def test_the_container_ship_has_the_accelerations_of_the_printed_equations():
    ship = container()
    generator = np.random.default_rng(0)
    for _ in range(20):
        scale = [1.0, 1.0, 0.02, 0.02, 0.2, 0.3]
        u, v, r, p, phi, delta = generator.normal(size=6) * scale
        u += 8.0
        nudot, own = ship.rates(tensor(u, v, r), tensor(phi, p), Inputs(tensor(delta)[0]))
        expected = son_and_nomoto(u, v, r, p, phi, delta, ship.shaft)
        assert [*nudot.tolist(), float(own[1])] == approx(expected, rel=1e-9, abs=1e-12)
        assert float(own[0]) == p


@pytest.mark.parametrize("make", [SHIPS["twin"], naval_vessel])
def test_two_screws_stand_apart_within_the_breadth_of_the_hull(make):
    ship = make()
    starboard, port = ship.drives
    assert starboard.y == -port.y and starboard.diameter == port.diameter
    assert starboard.diameter < 2 * starboard.y < ship.particulars.beam - starboard.diameter


def test_two_screws_on_the_centre_plane_are_the_single_one():
    single = container()
    p = single.particulars
    both = FourDegreeShip(p, single.mass_matrix, single.hull, twin(DRIVE, 0.0))
    assert both.shaft == approx(sqrt(2) * single.shaft)
    nu, own = moving(single)
    for one, two in zip(
        single.rates(nu, own, Inputs(tensor(0.3)[0])), both.rates(nu, own, Inputs(tensor(0.3)[0])), strict=True
    ):
        torch.testing.assert_close(one, two, rtol=1e-9, atol=1e-14)


@pytest.mark.parametrize("name", SHIPS)
def test_port_and_starboard_are_alike(name):
    ship = SHIPS[name]()
    nu, own = moving(ship)
    flip = tensor(1.0, -1.0, -1.0)
    split = tensor(0.1 * (ship.sides == 2))[0]
    here = ship.rates(nu, own, Inputs(tensor(0.3)[0], shaft_split=split))
    there = ship.rates(nu * flip, -own, Inputs(tensor(-0.3)[0], shaft_split=-split))
    torch.testing.assert_close(there[0], here[0] * flip)
    torch.testing.assert_close(there[1], -here[1])


@pytest.mark.parametrize("name", SHIPS)
def test_on_a_straight_course_at_the_approach_speed_nothing_changes(name):
    for share in (0.5, 1.0, 1.2):
        ship = SHIPS[name]()
        ship = ship.on_approach(share * ship.particulars.speed)
        nudot, own = ship.rates(tensor(ship.particulars.speed, 0.0, 0.0), tensor(0.0, 0.0), Inputs(tensor(0.0)[0]))
        assert nudot.tolist() == approx([0.0, 0.0, 0.0], abs=1e-9) and own.tolist() == approx([0.0, 0.0], abs=1e-12)


@pytest.mark.parametrize("name", SHIPS)
def test_the_upright_ship_is_the_rolling_one_whose_heel_is_held(name):
    free = SHIPS[name]()
    held = FourDegreeShip(free.particulars, free.mass_matrix, free.hull, free.drives, rolls=False)
    nu, delta = moving(free)[0], tensor(0.3)[0]
    force = free.forces(nu, tensor(0.0, 0.0), Inputs(delta))
    expected = torch.linalg.solve(free.mass_matrix[:3, :3], force[:3])
    torch.testing.assert_close(held.acceleration(nu, delta), expected)
    rates, no_roll = held.rates(nu, nu[:0], Inputs(delta))
    torch.testing.assert_close(rates, expected)
    assert no_roll.shape == (0,)
    moved, no_roll = held.added(expected, tensor(4e5)[0])
    torch.testing.assert_close(moved, expected)
    assert no_roll.shape == (0,)
    # and the 3 x 3 description of the free one gives what she does at the moment in which she is upright
    torch.testing.assert_close(free.acceleration(nu, delta), free.rates(nu, tensor(0.0, 0.0), Inputs(delta))[0])


@pytest.mark.parametrize("name", SHIPS)
def test_external_forces_meet_the_inertia_of_four_degrees_of_freedom(name):
    ship = SHIPS[name]()
    force, heeling = tensor(1e5, 2e5, -3e6), tensor(4e5)[0]
    nudot, own = ship.added(ship.acceleration_from_si(force), heeling)
    expected = torch.linalg.solve(ship.mass_matrix, torch.cat([force, heeling[None]]))
    torch.testing.assert_close(torch.cat([nudot, own[1:]]), expected)


@pytest.mark.parametrize("name", SHIPS)
def test_surge_shares_no_inertia_with_sway_yaw_and_roll(name):
    """Port and starboard are alike (Fossen 2011, section 7.5)."""
    mass = SHIPS[name]().mass_matrix
    assert not mass[0, 1:].any() and not mass[1:, 0].any()


@pytest.mark.parametrize("make, given", [(container, {"gm": 1.0}), (naval_vessel, {"scale": 2.0})])
def test_without_way_on_the_ship_rolls_with_its_natural_period(make, given):
    ship = make(**given)
    rate = lambda y: torch.cat(ship.rates(tensor(1e-3, 0.0, 0.0), y, Inputs(tensor(0.0)[0], tensor(0.0)[0])))[3:]  # noqa: E731
    omega = 2 * pi / ship.particulars.heeling.roll_period
    sway_coupled = ship.mass_matrix[3, 3] - ship.mass_matrix[3, :3] @ torch.linalg.solve(
        ship.mass_matrix[:3, :3], ship.mass_matrix[:3, 3]
    )  # sway and yaw are free too, which makes the period a little shorter
    ratio = float(ship.mass_matrix[3, 3] / sway_coupled)
    assert float(rate(tensor(0.01, 0.0))[1]) == approx(-ratio * omega**2 * 0.01, rel=1e-3)


@pytest.mark.slow
def test_she_heels_outward_in_a_turn_and_by_the_closed_form_of_a_steady_one():
    ship = container(screws=2, gm=1.0)
    (run,) = roll_out(CalmWater(ship), [replace(tactical_circle(20.0, approach=5.0), ship_lengths=25.0)])
    assert run["r"][-1] > 0 > run["phi"][-1]
    nu = tensor(*(run[k][-1] for k in ("u", "v", "r")))
    upright = ship.forces(nu, tensor(0.0, 0.0), Inputs(tensor(run["delta"][-1])[0]))
    slope = ship.forces(nu, tensor(1e-4, 0.0), Inputs(tensor(run["delta"][-1])[0])) - upright
    assert run["phi"][-1] == approx(float(-upright[3] / slope[3]) * 1e-4, rel=0.05)


def test_the_faster_starboard_screw_turns_her_to_port_and_a_deflected_rudder_to_its_side():
    model = CalmWater(container(screws=2))
    start = model.start(tensor(10.0, 0.0, 0.0, 0.0, 0.0, 0.0), Inputs(tensor(0.0)[0]))
    zero = tensor(0.0)[0]
    assert float(model(start, Inputs(zero, shaft_split=tensor(0.1)[0]))[2]) < 0
    alike = model(start, Inputs(tensor(0.1)[0]))
    parted = model(start, Inputs(tensor(0.1)[0], delta_split=tensor(0.05)[0]))
    assert float(alike[2]) > 0 and float(parted[2]) == approx(float(alike[2]), rel=0.05)


def test_forces_by_roll_and_moments_by_sway_are_of_one_added_mass():
    """A potential flow's added masses are symmetric; the source prints Y_pdot and K_vdot with opposite signs."""
    assert ADDED["Ypdot"] == -ADDED["Kvdot"] and ADDED["Krdot"] == ADDED["Npdot"] == 0


def test_ships_of_one_form_move_alike_by_froude():
    small, large = naval_vessel(), naval_vessel(4.0)
    nu, own = moving(small)
    share = tensor(2.0, 2.0, 0.5)
    here, there = (
        ship.rates(n, o, Inputs(tensor(0.3)[0]))
        for ship, n, o in ((small, nu, own), (large, nu * share, own * tensor(1.0, 0.5)))
    )
    torch.testing.assert_close(there[0], here[0] * tensor(1.0, 1.0, 0.25), rtol=1e-7, atol=1e-12)
    torch.testing.assert_close(there[1], here[1] * tensor(0.5, 0.25), rtol=1e-7, atol=1e-12)


def test_the_rollout_and_the_replay_of_a_ship_that_rolls_follow_the_exact_solution():
    model = CalmWater(naval_vessel())
    manoeuvre = replace(overshoot(20.0, approach=10.0, cycles=1.0), shaft_split=0.1, rudder_split=0.05)
    exact, (fixed,) = simulate(model, manoeuvre), roll_out(model, [manoeuvre])
    assert len(exact) == len(fixed) and exact.status == fixed.status == "ok"
    for name in ("x", "y", "psi", "phi", "p", "n_port", "delta_starboard"):
        scale = np.ptp(exact[name]) or 1.0
        assert np.abs(exact[name] - fixed[name]).max() < 1e-3 * scale, name
    (again,) = replay(model, [exact])
    assert np.abs(again["phi"] - exact["phi"]).max() < 0.01 * np.ptp(exact["phi"])
    assert np.hypot(again["x"] - exact["x"], again["y"] - exact["y"]).max() < 0.02 * 51.5


def test_recordings_hold_both_sides_and_their_means():
    run = simulate(
        CalmWater(container(screws=2)), replace(tactical_circle(20.0, approach=5.0, turn_deg=5.0), shaft_split=0.1)
    )
    assert run["n"] == approx(0.5 * (run["n_starboard"] + run["n_port"]))
    assert (run["n_starboard"] - run["n_port"])[0] == approx(0.2 * run["n"][0])
    assert {"phi", "p", "pdot"} <= set(run.channels)
    assert abs(np.gradient(run["phi"], run.time)[2:-2] - run["p"][2:-2]).max() < 2e-4


def test_trials_of_navies_begin_after_the_approach_and_end_by_themselves():
    trials = [tactical_circle(35.0, "port", approach=20.0), overshoot(10.0, approach=20.0)]
    circle, zigzag = roll_out(CalmWater(naval_vessel()), trials)
    assert np.degrees(circle["psi"][-1]) == approx(-540.0, abs=6.0)
    assert circle["delta_order"][circle.time < 20].tolist() == [0.0] * np.count_nonzero(circle.time < 20)
    orders = zigzag["delta_order"]
    assert np.count_nonzero(np.diff(orders)) == 5 and abs(orders[-1]) == approx(np.radians(10))
    names = [m.name for m in tactical_circles([10.0], [12.0, 20.0])]
    assert names == ["circle10_12kn", "circle10_port_12kn", "circle10_20kn", "circle10_port_20kn"]


def test_a_trial_that_breaks_down_before_its_end_says_so_in_its_status():
    ship = naval_vessel()
    unstable = replace(ship.hull, terms={**ship.hull.terms, "N": {**ship.hull.terms["N"], "|u| r": 5e7}})
    model = CalmWater(FourDegreeShip(ship.particulars, ship.mass_matrix, unstable, ship.drives))
    exact, (fixed,) = simulate(model, tactical_circle(35.0, approach=5.0)), roll_out(model, [tactical_circle(35.0)])
    assert exact.status.startswith("left the physical range at") and fixed.status.startswith("left the physical range")


def test_wind_from_port_heels_her_to_starboard():
    calm, rest = CalmWater(container()), Inputs(tensor(0.0)[0])
    wind = Vessel(calm, [SteadyWind(calm.ship, speed=15.0, from_deg=270.0)])
    state = wind.model.start(tensor(8.0, 0.0, 0.0, 0.0, 0.0, 0.0), rest)
    assert float(wind.effects[0].heeling(wind.situation(state, rest))) > 0
    assert float(wind.model(state, rest)[7]) > 0


def test_what_makes_no_ship_or_trial_is_refused_in_one_line():
    with pytest.raises(InputError, match="screws=3: expected 1 or 2"):
        container(screws=3)
    with pytest.raises(InputError, match="gm=-1"):
        container(gm=-1.0)
    with pytest.raises(InputError, match="scale=0"):
        naval_vessel(0.0)
    with pytest.raises(InputError, match="one rudder and one screw"):
        simulate(CalmWater(container()), replace(tactical_circle(20.0), shaft_split=0.1))
    with pytest.raises(InputError, match="cycles=0.3"):
        overshoot(10.0, cycles=0.3)
    with pytest.raises(InputError, match="turn_deg=0"):
        tactical_circle(10.0, turn_deg=0.0)


def test_the_wind_heels_each_ship_about_the_axis_of_her_own_moments():
    """Of the container ship they are about G, 1.59 m above the water; of the naval vessel about the waterline."""
    for ship, axis in ((container(gm=0.3), 10.39 - 0.3 - 8.5), (naval_vessel(), 0.0)):
        calm, areas = CalmWater(ship), ship.particulars.above_water
        wind = SteadyWind(ship, speed=15.0, from_deg=270.0)
        s = Vessel(calm, [wind]).situation(tensor(8.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), Inputs(tensor(0.0)[0]))
        lever = float(wind.heeling(s) / wind.force(s)[..., 1])
        assert lever == approx(0.5 * areas.lateral / areas.length_overall - axis, rel=1e-9)


@pytest.mark.parametrize("make", [container, naval_vessel])
def test_the_race_of_a_propeller_that_turns_ahead_does_not_turn_round_as_the_ship_begins_to_go_astern(make):
    ship = make()
    still, over = torch.zeros(3, 1, dtype=torch.float64), torch.full((3,), 0.3, dtype=torch.float64)
    nu = torch.cat([torch.tensor([[1e-6], [0.0], [-1e-6]], dtype=torch.float64), still, still], dim=-1)
    force = ship.drive_forces(ship.drives[0], nu, over, torch.full_like(over, ship.shaft))
    torch.testing.assert_close(force, force[:1].expand(3, 4), rtol=1e-5, atol=0.0)
    assert float(force[1, 1].abs()) > 0.1 * float(force[1, 0].abs())
    astern = nu.new_tensor([[-5.0, 0.0, 0.0]])  # with much way astern the flow comes from behind
    behind = ship.drive_forces(ship.drives[0], astern, over[:1], over.new_tensor([0.1 * ship.shaft]))
    assert float(behind[0, 1] * force[1, 1]) < 0


@pytest.mark.parametrize("make", [container, naval_vessel])
def test_shares_of_the_resistance_are_of_the_one_that_her_propellers_overcome(make):
    """As of fouling, or of a propeller that gives less."""
    ship = make()
    one, nu = torch.ones((), dtype=torch.float64), tensor(ship.particulars.speed, 0.0, 0.0)
    pushes = [ship.drive_forces(d, nu, 0 * one, ship.shaft * one)[0] for d in ship.drives]
    assert float(ship.thrust(nu[0], one)[0]) == approx(float(sum(pushes)), rel=1e-9)
    assert ship.particulars.calm_resistance == approx(float(sum(pushes)), rel=1e-9)
