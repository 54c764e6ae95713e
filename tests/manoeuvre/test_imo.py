"""The standards of MSC.137(76), every limit with a value just inside and one just outside of it."""

from dataclasses import replace

import pytest
from pytest import approx

from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.manoeuvre.imo import imo_table, overshoot_limits
from manoeuvre_nn.ship.mariner import CHISLETT, WANG

# MSC.137(76), 5.3.1 to 5.3.3: first and second overshoot of the 10/10 zigzag at L/V [s].
OVERSHOOTS = [
    (4.0, 10.0, 25.0), (9.99, 10.0, 25.0), (10.0, 10.0, 25.0), (10.4, 10.2, 25.3), (14.0, 12.0, 28.0),
    (20.0, 15.0, 32.5), (26.0, 18.0, 37.0), (29.6, 19.8, 39.7), (30.0, 20.0, 40.0), (30.01, 20.0, 40.0),
    (75.0, 20.0, 40.0),
]  # fmt: skip


def verdicts(name, ship=WANG, **found):
    return [row["verdict"] for row in imo_table({name: found}, ship)]


def with_time_unit(seconds):
    """A ship that sails its length in that time."""
    return replace(WANG, speed=WANG.length / seconds)


@pytest.mark.parametrize("time_unit, first, second", OVERSHOOTS)
@pytest.mark.parametrize("side", ["", "_port", "_starboard"])
def test_overshoots_of_the_10_10_zigzag_are_held_against_the_limits_of_length_over_speed(
    time_unit, first, second, side
):
    ship = with_time_unit(time_unit)
    for key, limit in (("overshoot_1_deg", first), ("overshoot_2_deg", second)):
        assert verdicts(f"zz10{side}", ship, **{key: limit - 1e-6}) == ["met"]
        assert verdicts(f"zz10{side}", ship, **{key: limit + 1e-6}) == ["not met"]


@pytest.mark.parametrize("time_unit", [6.0, 17.0, 50.0])
@pytest.mark.parametrize("name, key, limit", [
    ("tc35", "advance_L", 4.5), ("tc35_port", "tactical_diameter_L", 5.0), ("zz20", "overshoot_1_deg", 25.0),
    ("zz20_port", "overshoot_1_deg", 25.0), ("zz10", "initial_turning_L", 2.5), ("zz10_10", "initial_turning_L", 2.5),
])  # fmt: skip
def test_the_other_limits_hold_for_ships_of_any_length_and_speed(name, key, limit, time_unit):
    ship = with_time_unit(time_unit)
    assert verdicts(name, ship, **{key: limit}) == ["met"], "up to the limit, it included"
    assert verdicts(name, ship, **{key: limit - 1e-6}) == ["met"]
    assert verdicts(name, ship, **{key: limit + 1e-6}) == ["not met"]
    (row,) = imo_table({name: {key: 1.0}}, ship)
    assert (row["criterion"], row["value"], row["limit"]) == (f"{name} {key}", 1.0, limit)


def test_what_the_resolution_does_not_limit_is_not_in_the_table():
    assert verdicts("tc35", transfer_L=9.0, steady_diameter_L=9.0, overshoot_1_deg=90.0) == []
    assert verdicts("zz20", overshoot_2_deg=90.0, initial_turning_L=9.0) == []
    assert verdicts("pullout20", residual_rate_deg_s=1.0) == verdicts("my zz10", overshoot_1_deg=90.0) == []


@pytest.mark.parametrize("name, limit", [("zz15", "10/10"), ("zz15.5", "20/20"), ("zz5", "10/10"), ("zz25", "20/20")])
def test_a_zigzag_at_another_angle_is_listed_with_the_limits_of_the_nearest(name, limit):
    rows = imo_table({name: {"overshoot_1_deg": 3.0, "overshoot_2_deg": 3.0}}, with_time_unit(20.0))
    assert [row["limit"] for row in rows] == ([15.0, 32.5] if limit == "10/10" else [25.0])
    assert {row["verdict"] for row in rows} == {"not judged: the resolution asks for 10/10 and 20/20 zigzags"}


@pytest.mark.parametrize("stop, judged, other", [(35.0, 35.4, 34.4), (32.0, 32.0, 35.0), (45.0, 34.6, 36.0)])
def test_circles_are_judged_at_35_deg_or_at_the_stop_if_that_comes_first(stop, judged, other):
    ship, largest = replace(WANG, rudder_limit=stop * DEGREE), min(stop, 35.0)
    assert verdicts(f"tc{judged}", ship, advance_L=4.0) == ["met"]
    assert verdicts(f"tc{other}", ship, advance_L=4.0) == [
        f"not judged: the resolution asks for {largest:g} deg of rudder"
    ]


@pytest.mark.parametrize(
    "time_unit, first, second",
    [(5.0, 10.0, 25.0), (10.0, 10.0, 25.0), (20.0, 15.0, 32.5), (30.0, 20.0, 40.0), (60.0, 20.0, 40.0)],
)
def test_overshoot_limits_are_those_of_the_resolution(time_unit, first, second):
    assert overshoot_limits(time_unit) == approx((first, second, 25.0))


def test_a_ship_is_judged_by_what_was_run():
    values = {
        "tc35": {"advance_L": 4.6, "transfer_L": 2.0, "tactical_diameter_L": 4.9},
        "zz10": {"overshoot_1_deg": 15.1, "overshoot_2_deg": 15.0, "initial_turning_L": 2.5},
        "zz20_port": {"overshoot_1_deg": 25.1},
        "spiral20": {"loop_width_deg": 3.0},
    }
    rows = {row["criterion"]: row for row in imo_table(values, WANG)}
    assert {k: row["verdict"] for k, row in rows.items()} == {
        "tc35 advance_L": "not met",
        "tc35 tactical_diameter_L": "met",
        "zz10 initial_turning_L": "met",
        "zz10 overshoot_1_deg": "not met",
        "zz10 overshoot_2_deg": "met",
        "zz20_port overshoot_1_deg": "not met",
    }
    assert rows["zz10 overshoot_1_deg"]["limit"] == approx(5 + 0.5 * 152.4 / 7.614)
    assert imo_table({}, WANG) == []


@pytest.mark.parametrize("name", ["tc25", "zz20_10", "zz15", "zz35"])
def test_trials_at_other_angles_are_not_judged_and_the_table_says_so(name):
    values = {name: {"advance_L": 9.0, "overshoot_1_deg": 90.0}}
    rows = imo_table(values, WANG)
    assert len(rows) == 1
    assert rows[0]["verdict"].startswith("not judged: the resolution asks for")


def test_a_ship_whose_rudder_goes_further_is_judged_at_35_deg():
    assert [r["verdict"] for r in imo_table({"tc35": {"advance_L": 4.0}}, CHISLETT)] == ["met"]
    assert "35 deg" in imo_table({"tc40": {"advance_L": 4.0}}, CHISLETT)[0]["verdict"]
