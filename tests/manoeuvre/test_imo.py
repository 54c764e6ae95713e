"""The standards of MSC.137(76), every limit with a value just inside and one just outside of it."""

from dataclasses import replace

import numpy as np
import pytest
from pytest import approx

from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.manoeuvre.imo import imo_table, overshoot_limits
from manoeuvre_nn.ship.mariner import CHISLETT, WANG

# MSC.137(76), 5.3.1 to 5.3.3: first and second overshoot of the 10/10 zigzag at L/V [s].
OVERSHOOTS = [
    (4.0, 10.0, 25.0), (9.99, 10.0, 25.0), (10.0, 10.0, 25.0), (10.4, 10.2, 25.3), (14.0, 12.0, 28.0),
    (20.0, 15.0, 32.5), (26.0, 18.0, 37.0), (29.6, 19.8, 39.7), (30.0, 20.0, 40.0), (30.01, 20.0, 40.0),
    (75.0, 20.0, 40.0),
]  # fmt: skip


def circle(rudder, side=1, name="trial", kind="turning_circle"):
    """A recording in which the rudder goes to an angle after 20 s and the ship turns from then on."""
    time = np.arange(0.0, 200.0)
    delta = side * np.clip(2.5 * (time - 20.0), 0.0, rudder)
    return recording(time, delta, side * np.clip(time - 20.0, 0.0, None), name, kind)


def zigzag(rudder, heading, side=1, name="trial", kind="zigzag"):
    """A recording in which the rudder is reversed whenever the heading, which turns a degree a second, is reached."""
    time = np.arange(0.0, 40.0 + 6 * heading, 0.25)
    swing = np.clip(time - 20.0, 0.0, None) + heading  # the heading begins in the middle of a swing
    number = np.floor(swing / (2 * heading))
    psi = np.where(number % 2 == 0, 1, -1) * (swing - 2 * heading * number - heading)
    order = np.where(time < 20.0, 0.0, np.where(number % 2 == 0, rudder, -rudder))
    delta = np.zeros_like(time)
    for k in range(1, len(time)):
        delta[k] = delta[k - 1] + np.clip(order[k] - delta[k - 1], -2.5, 2.5)
    return recording(time, side * delta, side * psi, name, kind)


def recording(time, delta_deg, psi_deg, name, kind):
    psi = psi_deg * DEGREE
    channels = {"u": 0 * time + 7, "v": 0 * time, "r": np.gradient(psi, time), "psi": psi, "delta": delta_deg * DEGREE}
    return Recording(name, time, channels, meta={"kind": kind})


def verdicts(trial, ship=WANG, **found):
    return [row["verdict"] for row in imo_table([(trial, found)], ship)]


def with_time_unit(seconds):
    """A ship that sails its length in that time."""
    return replace(WANG, speed=WANG.length / seconds)


@pytest.mark.parametrize("time_unit, first, second", OVERSHOOTS)
@pytest.mark.parametrize("side", [1, -1])
def test_overshoots_of_the_10_10_zigzag_are_held_against_the_limits_of_length_over_speed(
    time_unit, first, second, side
):
    ship, trial = with_time_unit(time_unit), zigzag(10.0, 10.0, side)
    for key, limit in (("overshoot_1_deg", first), ("overshoot_2_deg", second)):
        assert verdicts(trial, ship, **{key: limit - 1e-6}) == ["met"]
        assert verdicts(trial, ship, **{key: limit + 1e-6}) == ["not met"]


@pytest.mark.parametrize("time_unit", [6.0, 17.0, 50.0])
@pytest.mark.parametrize("trial, key, limit", [
    (circle(35.0), "advance_L", 4.5), (circle(35.0, -1), "tactical_diameter_L", 5.0),
    (zigzag(20.0, 20.0), "overshoot_1_deg", 25.0), (zigzag(20.0, 20.0, -1), "overshoot_1_deg", 25.0),
    (zigzag(10.0, 10.0), "initial_turning_L", 2.5), (zigzag(10.0, 10.0, -1), "initial_turning_L", 2.5),
])  # fmt: skip
def test_the_other_limits_hold_for_ships_of_any_length_and_speed(trial, key, limit, time_unit):
    ship = with_time_unit(time_unit)
    assert verdicts(trial, ship, **{key: limit}) == ["met"], "up to the limit, it included"
    assert verdicts(trial, ship, **{key: limit - 1e-6}) == ["met"]
    assert verdicts(trial, ship, **{key: limit + 1e-6}) == ["not met"]
    (row,) = imo_table([(trial, {key: 1.0})], ship)
    assert (row["criterion"], row["value"], row["limit"]) == (f"trial {key}", 1.0, limit)


def test_what_the_resolution_does_not_limit_is_not_in_the_table():
    assert verdicts(circle(35.0), transfer_L=9.0, steady_diameter_L=9.0, overshoot_1_deg=90.0) == []
    assert verdicts(zigzag(20.0, 20.0), overshoot_2_deg=90.0, initial_turning_L=9.0) == []
    assert verdicts(circle(20.0, kind="pull_out"), residual_rate_deg_s=1.0) == []
    assert verdicts(zigzag(10.0, 10.0, kind=""), overshoot_1_deg=90.0) == []


def test_a_trial_in_which_no_rudder_is_laid_or_reversed_is_not_in_the_table():
    straight = circle(0.0)
    for kind in ("turning_circle", "zigzag"):
        assert verdicts(replace(straight, meta={"kind": kind}), advance_L=4.0, overshoot_1_deg=3.0) == []
    assert verdicts(circle(20.0, kind="zigzag"), overshoot_1_deg=3.0) == []


@pytest.mark.parametrize("angle, limit", [(15.0, "10/10"), (15.5, "20/20"), (5.0, "10/10"), (25.0, "20/20")])
def test_a_zigzag_at_another_angle_is_listed_with_the_limits_of_the_nearest(angle, limit):
    rows = imo_table([(zigzag(angle, angle), {"overshoot_1_deg": 3.0, "overshoot_2_deg": 3.0})], with_time_unit(20.0))
    assert [row["limit"] for row in rows] == ([15.0, 32.5] if limit == "10/10" else [25.0])
    (said,) = {row["verdict"] for row in rows}
    assert said.startswith(f"not judged: the resolution asks for 10/10 and 20/20 zigzags, this is {angle:g}/")


@pytest.mark.parametrize("stop, judged, other", [(35.0, 34.1, 33.9), (32.0, 32.0, 35.0), (45.0, 35.9, 36.1)])
def test_circles_are_judged_at_35_deg_or_at_the_stop_if_that_comes_first(stop, judged, other):
    ship, largest = replace(WANG, rudder_limit=stop * DEGREE), min(stop, 35.0)
    assert verdicts(circle(judged), ship, advance_L=4.0) == ["met"]
    assert verdicts(circle(other), ship, advance_L=4.0) == [
        f"not judged: the resolution asks for {largest:g} deg of rudder, this is {other:g}"
    ]


@pytest.mark.parametrize("name", ["tc35", "zz10", "zz20", "trial"])
def test_the_recorded_rudder_says_what_a_trial_is_and_not_its_name(name):
    assert verdicts(circle(20.0, name=name), advance_L=4.0)[0].endswith("35 deg of rudder, this is 20")
    assert verdicts(circle(35.0, name=name), advance_L=4.0) == ["met"]
    assert verdicts(zigzag(20.0, 10.0, name=name), overshoot_1_deg=9.0)[0].startswith("not judged")
    assert verdicts(zigzag(20.0, 20.0, name=name), overshoot_1_deg=25.1) == ["not met"]


@pytest.mark.parametrize("rudder, heading, judged", [
    (10.9, 10.0, True), (11.2, 10.0, False), (9.1, 11.5, True), (10.0, 12.5, False), (19.5, 21.0, True),
])  # fmt: skip
def test_a_rudder_is_read_to_a_degree_and_a_helmsman_is_a_second_or_two_late(rudder, heading, judged):
    (said,) = verdicts(zigzag(rudder, heading), overshoot_1_deg=3.0)
    assert (said == "met") is judged


def test_the_rudder_of_the_approach_is_taken_off():
    trial = circle(35.0)
    assert verdicts(trial.with_channels(delta=trial["delta"] + 2 * DEGREE), advance_L=4.0) == ["met"]


@pytest.mark.parametrize(
    "time_unit, first, second",
    [(5.0, 10.0, 25.0), (10.0, 10.0, 25.0), (20.0, 15.0, 32.5), (30.0, 20.0, 40.0), (60.0, 20.0, 40.0)],
)
def test_overshoot_limits_are_those_of_the_resolution(time_unit, first, second):
    assert overshoot_limits(time_unit) == approx((first, second, 25.0))


def test_a_ship_is_judged_by_what_was_run():
    trials = [
        (circle(35.0, name="hard over"), {"advance_L": 4.6, "transfer_L": 2.0, "tactical_diameter_L": 4.9}),
        (
            zigzag(10.0, 10.0, name="small"),
            {"overshoot_1_deg": 15.1, "overshoot_2_deg": 15.0, "initial_turning_L": 2.5},
        ),
        (zigzag(20.0, 20.0, -1, name="large"), {"overshoot_1_deg": 25.1}),
        (circle(20.0, kind="spiral"), {"loop_width_deg": 3.0}),
    ]
    rows = {row["criterion"]: row for row in imo_table(trials, WANG)}
    assert {k: row["verdict"] for k, row in rows.items()} == {
        "hard over advance_L": "not met",
        "hard over tactical_diameter_L": "met",
        "small initial_turning_L": "met",
        "small overshoot_1_deg": "not met",
        "small overshoot_2_deg": "met",
        "large overshoot_1_deg": "not met",
    }
    assert rows["small overshoot_1_deg"]["limit"] == approx(5 + 0.5 * 152.4 / 7.614)
    assert imo_table([], WANG) == []


def test_criteria_of_a_trial_that_the_model_does_not_predict_are_not_judged():
    trials = [(circle(35.0, name="a"), {"advance_L": 4.0}), (circle(35.0, name="b"), {"advance_L": 4.0})]
    said = [row["verdict"] for row in imo_table(trials, WANG, {"b": "is 20 L off"})]
    assert said == ["met", "not judged: the model is 20 L off"]


def test_a_ship_whose_rudder_goes_further_is_judged_at_35_deg():
    assert verdicts(circle(35.0), CHISLETT, advance_L=4.0) == ["met"]
    assert "35 deg" in verdicts(circle(40.0), CHISLETT, advance_L=4.0)[0]
