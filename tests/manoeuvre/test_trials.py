"""What each trial orders, and what is refused."""

import numpy as np
import pytest
import yaml
from fleet import unchecked
from pytest import approx

from manoeuvre_nn.core.data_files import CONF
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.units import DEGREE, KNOT
from manoeuvre_nn.manoeuvre.spiral import spiral
from manoeuvre_nn.manoeuvre.straight import random_rudder, straight
from manoeuvre_nn.manoeuvre.turning import pull_out, tactical_circle, tactical_circles, turning_circle
from manoeuvre_nn.manoeuvre.zigzag import mixed_zigzag, overshoot, overshoots, zigzag
from manoeuvre_nn.ship.mariner import WANG


def test_a_zigzag_alternates_until_its_executes_are_used_up():
    stages = zigzag(20.0, 10.0, first="port", executes=3).stages
    assert [s.order / DEGREE for s in stages] == approx([-20, 20, -20, 0])
    assert [s.heading / DEGREE for s in stages[:3]] == approx([-10, 10, -10])
    assert [s.direction for s in stages[:3]] == [-1, 1, -1]


def test_a_zigzag_about_another_course_shifts_all_its_headings():
    assert [s.heading / DEGREE for s in zigzag(20.0, start_deg=5.0).stages[:2]] == approx([25, -15])


@pytest.mark.parametrize(
    "made, name",
    [
        (zigzag(20.0), "zz20"),
        (zigzag(20.0, 10.0, first="port"), "zz20_10_port"),
        (turning_circle(25.0), "tc25"),
        (turning_circle(25.0, "port"), "tc25_port"),
        (pull_out(20.0), "pullout20"),
        (spiral(), "spiral20"),
        (straight(), "straight"),
        (random_rudder(seed=3), "random3"),
        (zigzag(20.0, name="mine"), "mine"),
        (mixed_zigzag(), "zz5to25"),
        (mixed_zigzag([20.0, 10.0], first="port"), "zz20to10_port"),
    ],
)
def test_names_say_what_is_done(made, name):
    assert made.name == name


def test_any_trial_may_have_a_name_of_its_own():
    made = [make(20.0, name="mine") for make in (zigzag, turning_circle, pull_out, tactical_circle, overshoot)]
    made += [make(name="mine") for make in (spiral, straight, random_rudder, mixed_zigzag)]
    assert {m.name for m in made} == {"mine"}


def test_a_mixed_zigzag_goes_through_its_angles_to_both_sides_and_begins_anew():
    stages = mixed_zigzag([10.0, 20.0], [15.0, 30.0], first="port").stages
    assert [s.order / DEGREE for s in stages[:5]] == approx([-10, 10, -20, 20, -10])
    assert [s.heading / DEGREE for s in stages[:5]] == approx([-15, 15, -30, 30, -15])
    assert [s.direction for s in stages[:5]] == [-1, 1, -1, 1, -1]
    assert mixed_zigzag([20.0]).stages[:60] == zigzag(20.0).stages[:60]
    with pytest.raises(InputError, match="as many of the one as of the other"):
        mixed_zigzag([10.0, 20.0], [15.0])
    with pytest.raises(InputError, match="expected angles"):
        mixed_zigzag([])


def test_a_spiral_goes_to_the_other_side_and_back():
    made = spiral(10.0, 5.0, 30.0)
    assert [s.order / DEGREE for s in made.stages] == approx([10, 5, 0, -5, -10, -5, 0, 5, 10])
    assert made.duration == 270.0 and {s.hold for s in made.stages} == {30.0}
    assert [s.order for s in spiral(10.0, first="port").stages] == approx([-s.order for s in spiral(10.0).stages])


def test_a_random_rudder_has_no_period_shorter_than_asked_and_keeps_its_angle():
    made = random_rudder(20.0, shortest_period=40.0, duration=4000.0, interval=5.0, seed=1)
    orders = np.array([s.order for s in made.stages])
    assert np.abs(orders).max() <= 20 * DEGREE
    power = np.abs(np.fft.rfft(orders)) ** 2
    fast = np.fft.rfftfreq(len(orders), 5.0) > 1.05 / 40.0
    assert power[fast].sum() < 0.02 * power.sum(), "only what the clipping adds"
    again = random_rudder(20.0, shortest_period=40.0, duration=4000.0, interval=5.0, seed=1)
    assert again == made != random_rudder(20.0, shortest_period=40.0, duration=4000.0, interval=5.0, seed=2)


def test_a_turn_lasts_30_ship_lengths_and_any_trial_as_long_as_it_says():
    assert turning_circle(25.0).duration_for(WANG) == approx(30 * 152.4 / 7.614)
    assert turning_circle(25.0, duration=90.0).duration_for(WANG) == 90.0
    assert zigzag(20.0).duration_for(WANG) == WANG.record_length


def test_another_approach_speed_makes_a_new_trial():
    made = zigzag(20.0)
    assert made.at_speed(5.0).speed == 5.0 and made.speed is None and made.at_speed(None) is made


def test_naval_trials_are_an_approach_a_manoeuvre_and_an_end():
    """Stenson & Hundley: a minute from COMEX to EXECUTE, a circle of 540 deg, two cycles and a half of overshoots."""
    circle, swing = tactical_circle(35.0, "port", approach=45.0, turn_deg=500.0), overshoot(15.0, "port", cycles=1.5)
    orders = [(s.order / DEGREE, s.heading and s.heading / DEGREE, s.direction, s.hold) for s in circle.stages]
    assert orders == [(0.0, None, 1, 45.0), (approx(-35.0), approx(-500.0), -1, None), (0.0, None, 1, None)]
    assert [s.order / DEGREE for s in swing.stages] == approx([0.0, -15.0, 15.0, -15.0, 0.0])
    assert [s.hold for s in swing.stages] == [60.0, None, None, None, None]
    for made, name in ((circle, "circle35_port"), (swing, "overshoot15_port"), (tactical_circle(20.0), "circle20"),
                       (overshoot(20.0), "overshoot20")):  # fmt: skip
        assert (made.name, made.ends) == (name, True)
        assert made.duration_for(WANG) == approx(200 * 152.4 / 7.614), "long enough at 5 deg"
    assert tactical_circle(20.0).stages[0].hold == 60.0 and tactical_circle(20.0).stages[1].heading == approx(3 * np.pi)
    assert len(overshoot(20.0).stages) == 1 + 5 + 1 and len(overshoot(20.0, cycles=0.5).stages) == 3
    assert (circle.kind, swing.kind) == ("turning_circle", "zigzag")


def test_a_set_of_naval_trials_has_every_angle_at_every_speed():
    circles, swings = tactical_circles(), overshoots([10.0], [8.0], "starboard", approach=30.0, cycles=1.0)
    assert [m.name for m in circles[:4]] == [
        "circle10_12kn",
        "circle10_port_12kn",
        "circle20_12kn",
        "circle20_port_12kn",
    ]
    assert len(circles) == 12 and {m.speed / KNOT for m in circles} == {12.0, 20.0}
    assert [(m.name, m.speed, len(m.stages), m.stages[0].hold) for m in swings] == [
        ("overshoot10_8kn", approx(8 * 1852 / 3600), 4, 30.0)
    ]
    assert len(overshoots()) == 12 and len(tactical_circles([35.0], [12.0], "port", 20.0, 400.0)) == 1


@pytest.mark.parametrize("name, family", [("overshoots", overshoots), ("circles", tactical_circles)])
def test_python_and_the_commands_take_the_same_set(name, family):
    said = yaml.safe_load((CONF / "manoeuvre" / f"{name}.yaml").read_text())
    assert said.pop("_target_") == f"{family.__module__}.{family.__name__}"
    with unchecked():
        assert family(**said) == family()


def test_each_family_is_as_long_as_it_usually_takes():
    unit = 152.4 / 7.614
    for made, lengths in ((mixed_zigzag(), 40.0), (pull_out(20.0), 40.0), (turning_circle(20.0), 30.0)):
        assert made.duration_for(WANG) == approx(lengths * unit)
    assert pull_out(20.0, coast=90.0).duration_for(WANG) == 90.0
    turns = [pull_out(20.0, side).stages[0].heading for side in ("port", "starboard")]
    assert turns == approx([-1.5 * np.pi, 1.5 * np.pi]), "270 deg"
    little = [make(20.0, turn_deg=0.5).stages[k].heading for make, k in ((pull_out, 0), (tactical_circle, 1))]
    assert little == approx([0.5 * DEGREE] * 2), "any turn will do"
    assert spiral().duration == 17 * 60.0 and spiral().stages[0].order == approx(20 * DEGREE)


def test_a_random_rudder_has_half_the_largest_angle_for_its_size_and_four_orders_a_period():
    made = random_rudder(10.0, shortest_period=32.0, duration=16_000.0)
    orders = np.array([s.order for s in made.stages]) / DEGREE
    assert {s.hold for s in made.stages} == {8.0} and len(orders) == 2001 and np.abs(orders).max() == approx(10.0)
    assert orders.std() == approx(5.0, abs=0.25), "a twentieth of its orders is clipped"
    assert abs(orders.mean()) < 0.7
    power = np.abs(np.fft.rfft(orders)) ** 2
    inside = np.fft.rfftfreq(len(orders), 8.0) < 1 / 33.0
    assert power[inside].sum() > 0.9 * power.sum() and power[inside][50:].sum() > 0.5 * power.sum()


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda: zigzag(0.0), "expected an angle in degrees between 0 and 90"),
        (lambda: zigzag(-20.0), "expected an angle in degrees between 0 and 90"),
        (lambda: zigzag(20.0, 100.0), "heading_deg=100.0: expected"),
        (lambda: zigzag(20.0, first="left"), "first='left': write starboard or port"),
        (lambda: zigzag(20.0, executes=0), "executes=0: expected 1 to 1000"),
        (lambda: zigzag(20.0, executes=10**30), "expected 1 to 1000"),
        (lambda: overshoot(20.0, cycles=float("nan")), "cycles=nan: expected half or whole cycles"),
        (lambda: straight(1e9), "more than 0 and up to 1e+06"),
        (lambda: pull_out(20.0, turn_deg=float("nan")), "turn_deg=nan: expected a change of heading"),
        (lambda: tactical_circle(20.0, turn_deg=float("inf")), "turn_deg=inf: expected a change of heading"),
        (lambda: spiral(20.0, 1e-9), "step_deg=1e-09 makes 8e+10 rudder orders; expected 100000 at most"),
        (lambda: random_rudder(shortest_period=1e-6, duration=600.0), "shortest_period=1e-06 makes 2.4e+09 rudder"),
        (lambda: random_rudder(shortest_period=0.0), "shortest_period=0.0: expected a time in seconds"),
        (lambda: random_rudder(seed=-1), "seed=-1: expected a whole number, 0 or more"),
        (lambda: zigzag(20.0, duration=0.0), "duration=0.0: expected a time in seconds, more than 0"),
        (lambda: turning_circle(20.0, "right"), "side='right': write starboard or port"),
        (lambda: turning_circle(20.0, duration=-1.0), "more than 0"),
        (lambda: pull_out(20.0, turn_deg=0.0), "turn_deg=0.0: expected a change of heading"),
        (lambda: spiral(20.0, 3.0), "step_deg=3.0 does not divide"),
        (lambda: spiral(20.0, 25.0), "step_deg=25.0: expected an angle in degrees between 0 and 20"),
        (lambda: spiral(hold=0.0), "hold=0.0: expected a time"),
        (lambda: random_rudder(shortest_period=1.0, interval=2.0), "expected between 4 s"),
        (lambda: random_rudder(shortest_period=900.0), "and the duration, 600 s"),
        (lambda: straight(-5.0), "expected a time in seconds"),
        (lambda: overshoot(20.0, cycles=0.7), "cycles=0.7: expected half or whole cycles"),
        (lambda: overshoot(20.0, cycles=0.0), "cycles=0.0: expected half or whole cycles"),
        (lambda: tactical_circle(20.0, turn_deg=-1.0), "turn_deg=-1.0: expected a change of heading"),
        (lambda: tactical_circle(20.0, approach=0.0), "expected a time in seconds, more than 0"),
        (lambda: overshoots(first="left"), "write starboard, port or both"),
        (lambda: tactical_circles(speed_kn=[0.0]), "expected approach speeds in knots, more than 0"),
    ],
)
def test_what_makes_no_sense_is_refused_with_the_cure(make, message):
    with pytest.raises(InputError) as error:
        make()
    assert message in str(error.value)
    assert "\n" not in str(error.value)
