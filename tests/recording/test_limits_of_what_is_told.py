"""Limits in what is proposed for a column and told of a recording, and holes where an instrument shows nothing."""

import numpy as np
import pytest
from fleet import unchecked
from pytest import approx
from scipy.signal import lfilter

from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.recording.check.steering import _first_execute, rudder_lag, steady_approach
from manoeuvre_nn.recording.check.units import speed_unit
from manoeuvre_nn.recording.check.weighed import strong_current
from manoeuvre_nn.recording.holes import heading_across
from manoeuvre_nn.recording.propose.headings import Heading
from manoeuvre_nn.recording.propose.motion_columns import _headings
from manoeuvre_nn.recording.propose.proposal import _other
from manoeuvre_nn.ship.mariner import mariner

SHIP = mariner().particulars


@pytest.fixture(autouse=True)
def _unchecked_types():
    with unchecked():
        yield


@pytest.mark.parametrize("largest, unit", [(24.0, "1/s"), (26.0, "rpm")])
def test_no_shaft_of_a_ship_that_is_not_known_turns_faster_than_twenty_five_times_a_second(largest, unit):
    """A model's motor makes 20; a ship's slowest engine 30 to 60 a minute."""
    chosen = _other("n", Heading("n", "n", ""), np.full(50, largest), 7.0, None)
    assert chosen.unit == unit and chosen.decided is (unit == "rpm")


@pytest.mark.parametrize("lengths, slopes", [(0.95, False), (1.05, True)])
def test_an_approach_shows_slopes_from_one_ships_length_on(lengths, slopes):
    time = np.arange(0.0, 60.0, 0.2)
    zero, begins = 0 * time, lengths * SHIP.time_unit
    c = {"u": zero + 7.0, "v": zero, "r": zero, "x": 7.0 * time, "y": zero, "psi": zero}
    run = Recording("run", time, c | {"delta": 0.2 * (time > begins)})
    assert ("straight and steady for" in steady_approach(run, SHIP).text) is slopes


@pytest.mark.parametrize(
    "name, change, steady",
    [
        ("u", 0.009, True),
        ("u", 0.011, False),
        ("v", 0.018, True),
        ("v", 0.022, False),
        ("r", 0.027, True),
        ("r", 0.033, False),
    ],
)
def test_in_the_time_of_a_ships_length_an_approach_changes_by_so_much_at_most(name, change, steady):
    """Over U0, U0 and U0/L; straight on for three ship's lengths, without noise, and then the rudder is put over."""
    time, unit = np.arange(0.0, 5 * SHIP.time_unit, 0.5), SHIP.time_unit
    scale = {"u": SHIP.speed, "v": SHIP.speed, "r": SHIP.speed / SHIP.length}[name]
    zero = 0 * time
    c = {"u": zero + SHIP.speed, "v": zero, "r": zero, "x": SHIP.speed * time, "y": zero, "psi": zero}
    c[name] = c[name] + scale * change * time / unit
    run = Recording("run", time, c | {"delta": 0.2 * (time > 3 * unit)})
    assert (steady_approach(run, SHIP).verdict == "ok") is steady


@pytest.mark.parametrize("lengths, seen", [(-0.9, True), (0.5, True), (0.9, True), (1.05, False)])
def test_a_late_or_early_rudder_is_timed_up_to_the_time_in_which_the_ship_sails_her_length(lengths, seen):
    """Nomoto's equation: ``T rdot + r = K delta``, the rudder on and off by a sum of sines."""
    time, late = np.arange(0.0, 900.0), lengths * SHIP.time_unit

    def rudder(t):
        return 0.2 * np.sin(t / 19.0) + 0.15 * np.sin(t / 31.0 + 1.0)

    fine = np.arange(0.0, 900.0, 0.1)
    r = lfilter([0.1], [1.0, 0.1 / 30.0 - 1.0], 0.05 / 30.0 * rudder(fine))[::10]
    c = {"v": -40.0 * r, "r": r, "delta": rudder(time - late)}
    found = rudder_lag(Recording("run", time, c), SHIP)
    assert (found is not None) is seen
    if found is not None:
        assert found.measured == approx(late, abs=0.05 * SHIP.time_unit)


UNITS = [  # track over u and v, what is told
    (1852 / 3600, "knots: write unit: kn"), (3600 / 1852, "m/s, not knots"), (1000 / 3600, "km/h: write unit: km/h"),
    (3600 / 1000, "m/s, not km/h"), (12 * 0.0254, "metres, not feet"), (1 / (12 * 0.0254), "feet: write unit: ft"),
    (0.001, "milliseconds"), (1000.0, "seconds, not milliseconds"), (60.0, "minutes"),
    (1 / 60.0, "seconds, not minutes"),
]  # fmt: skip


@pytest.mark.parametrize("off", [0.96, 1.0, 1.04])
@pytest.mark.parametrize("ratio, told", UNITS)
def test_a_wrong_unit_is_told_by_the_track(ratio, told, off):
    time = np.arange(0.0, 300.0)
    c = {"u": 0 * time + 7.0, "v": 0 * time, "r": 0 * time, "x": 7.0 * ratio * off * time, "y": 0 * time}
    found = speed_unit(Recording("run", time, c | {"psi": 0 * time, "delta": 0 * time}), SHIP)
    assert found is not None and told in str(found.remedy)


def test_a_rudder_that_never_moves_has_its_first_execute_at_the_end():
    assert _first_execute(np.full(50, 0.1)) == 49
    assert _first_execute(np.r_[np.full(20, 0.1), np.full(30, 0.4)]) == 20


@pytest.mark.parametrize("largest, unit, read", [
    (3.0, "", ["rad", "deg"]), (300.0, "", ["deg", "rad"]), (3.0, "deg", ["deg"]),
])  # fmt: skip
def test_without_a_yaw_rate_a_heading_is_read_in_the_unit_that_it_states_or_by_its_size(largest, unit, read):
    columns, values = {"psi": Heading("psi", "psi", unit)}, {"psi": np.linspace(0.0, largest, 50)}
    found = _headings(np.arange(50.0), columns, values)
    assert [yaw.psi_unit for yaw, _ in found] == read and [yaw.misfit for yaw, _ in found] == sorted(
        yaw.misfit for yaw, _ in found
    )


def circling(**channels) -> Recording:
    """A circle in four minutes at 7 m/s through the water, in a current of 2.5 m/s to the north."""
    time = np.arange(0.0, 240.0)
    psi = 2 * np.pi * time / 240.0
    north, east = 7.0 * np.cos(psi) + 2.5, 7.0 * np.sin(psi)
    c = {"psi": psi, "vn": north, "ve": east, "u": north * np.cos(psi) + east * np.sin(psi), "u_log": 0 * time + 7.0}
    return Recording("circle", time, c | channels)


def test_a_log_and_a_velocity_over_ground_that_differ_tell_the_current_in_a_circle():
    run = circling()
    found = strong_current(run, SHIP)
    assert found is not None and "a current of 2.5 m/s would explain it" in found.text
    still = circling(vn=run["vn"] - 2.5, u=run["u"] - 2.5 * np.cos(run["psi"]))
    assert strong_current(still, SHIP) is None


@pytest.mark.parametrize("silent", ["before", "after", "throughout"])
def test_where_the_gyro_shows_nothing_the_heading_tells_the_rate_of_turn(silent):
    time = np.r_[0.0:60.0, 215.0:300.0]
    psi = 2 * DEGREE * time
    r = np.full_like(time, 2 * DEGREE)
    r[{"before": time < 100, "after": time > 100, "throughout": time >= 0}[silent]] = np.nan
    across = heading_across(Recording("turn", time, {"psi": np.unwrap(np.angle(np.exp(1j * psi))), "r": r}))
    assert across["psi"] == approx(psi, abs=1e-9)
