import pytest
from pytest import approx

from manoeuvre_nn.manoeuvre.imo import imo_table, overshoot_limits
from manoeuvre_nn.ship.mariner import CHISLETT, WANG


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
