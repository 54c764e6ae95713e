"""What each trial orders, and what is refused."""

import numpy as np
import pytest
from pytest import approx

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.manoeuvre.spiral import spiral
from manoeuvre_nn.manoeuvre.straight import random_rudder, straight
from manoeuvre_nn.manoeuvre.turning import pull_out, tactical_circle, turning_circle
from manoeuvre_nn.manoeuvre.zigzag import mixed_zigzag, overshoot, zigzag
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
    ],
)
def test_what_makes_no_sense_is_refused_with_the_cure(make, message):
    with pytest.raises(InputError) as error:
        make()
    assert message in str(error.value)
    assert "\n" not in str(error.value)
