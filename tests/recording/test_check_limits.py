"""Each limit of the checks by a record a little within it and one a little beyond."""

from dataclasses import replace

import numpy as np
import pytest
from fleet import unchecked
from pytest import approx

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE, KNOT
from manoeuvre_nn.recording.check import axes, samples, steering, units
from manoeuvre_nn.recording.check.checks import check_sampling
from manoeuvre_nn.recording.check.fault_findings import fault_finding
from manoeuvre_nn.recording.check.finding import Change, in_unit
from manoeuvre_nn.recording.check.heel import heel_findings, side_findings
from manoeuvre_nn.recording.check.sensor_faults import Fault
from manoeuvre_nn.ship.mariner import mariner

SHIP = mariner().particulars
UNIT = SHIP.time_unit


@pytest.fixture(autouse=True)
def _unchecked_types():
    with unchecked():
        yield


def turning(
    turn_deg: float = 200.0, speed: float = 7.0, step: float = 1.0, length: float = 300.0, **changes
) -> Recording:
    """A steady turn from the first sample on, all channels in SI."""
    time = np.arange(0.0, length + 1e-9, step)
    r = turn_deg * DEGREE / length
    psi = r * time
    x, y = (speed / r * np.sin(psi), speed / r * (1 - np.cos(psi))) if r else (speed * time, 0 * time)
    c = {"u": speed + 0 * time, "v": 0 * time, "r": r + 0 * time, "x": x, "y": y, "psi": psi, "delta": 0.1 + 0 * time}
    c |= {"vn": speed * np.cos(psi), "ve": speed * np.sin(psi)}
    made = {
        name: value(c) if callable(value) else np.broadcast_to(value, time.shape) for name, value in changes.items()
    }
    return Recording("run", time, c | made)


UNITS = [  # check, record, whether it trips
    (units.stuck_rudder, {"turn_deg": 46.0, "delta": lambda c: np.linspace(0.0, 0.48 * DEGREE, len(c["u"]))}, True),
    (units.stuck_rudder, {"turn_deg": 46.0, "delta": lambda c: np.linspace(0.0, 0.52 * DEGREE, len(c["u"]))}, False),
    (units.stuck_rudder, {"turn_deg": 44.0}, False),
    (units.rudder_unit, {"delta": 1.18}, False),
    (units.rudder_unit, {"delta": -1.22}, True),
    (units.rudder_unit, {"delta": 1.18 * DEGREE}, True),
    (units.rudder_unit, {"delta": 1.22 * DEGREE}, False),
    (units.rudder_unit, {"delta": 0.0}, False),
    (units.rudder_unit, {"delta": 0.6 * DEGREE, "turn_deg": 28.0}, False),
    (units.rudder_unit, {"delta": 0.6 * DEGREE, "turn_deg": 29.0}, True),
    (units.rudder_stop, {"delta": -35.9 * DEGREE}, False),
    (units.rudder_stop, {"delta": -36.1 * DEGREE}, True),
    (units.log_unit, {"u_log": 7.0}, False),
    (units.log_unit, {"u_log": 7.0 / KNOT * 1.1}, True),
    (units.log_unit, {"u_log": 7.0 / KNOT * 1.14}, False),
    (units.log_unit, {"u_log": 7.0 * 3.6 * 0.9}, True),
    (units.log_unit, {"u_log": 7.0 * 3.6 * 0.86}, False),
    (units.shaft_unit, {"shaft_recorded": 0.105}, False),
    (units.shaft_unit, {"shaft_recorded": 0.095}, True),
    (units.shaft_unit, {"shaft_recorded": 4.9}, False),
    (units.shaft_unit, {"shaft_recorded": 5.1}, True),
    (units.speed_unit, {"u": 7.0 / 0.77}, False),
    (units.speed_unit, {"u": 7.0 / 0.73}, True),
    (units.speed_unit, {"u": 7.0 / 1.31}, False),
    (units.speed_unit, {"u": 7.0 / 1.35}, True),
    (units.speed_size, {"speed": 1.58 * SHIP.speed}, False),
    (units.speed_size, {"speed": 1.62 * SHIP.speed}, True),
    (units.speed_size, {"speed": 1.98 * SHIP.speed, "u_log": 1.5 * SHIP.speed}, False),
    (units.speed_size, {"speed": 2.02 * SHIP.speed, "u_log": 1.6 * SHIP.speed}, True),
    (units.speed_size, {"speed": 1.98 * SHIP.speed, "u_log": 1.45 * SHIP.speed}, True),
    (units.speed_size, {"speed": 0.052 * SHIP.speed}, False),
    (units.speed_size, {"speed": 0.048 * SHIP.speed}, True),
    (units.speed_size, {"u": lambda c: np.where(np.arange(301) < 12, 3.0, -3.0)}, True),
    (units.speed_size, {"u": lambda c: np.where(np.arange(301) < 20, 3.0, -3.0)}, False),
    (units.heading_unit, {"psi": lambda c: c["psi"] * DEGREE}, True),
    (units.heading_unit, {"turn_deg": 15.0, "psi": lambda c: c["psi"] * DEGREE}, False),
    (units.heading_unit, {"turn_deg": 17.0, "psi": lambda c: c["psi"] * DEGREE}, True),
    (units.heading_unit, {"psi": lambda c: c["psi"] * 0.62 * DEGREE}, True),
    (units.heading_unit, {"psi": lambda c: c["psi"] * 0.58 * DEGREE}, False),
    (units.heading_unit, {"psi": lambda c: c["psi"] * 1.58 * DEGREE}, True),
    (units.heading_unit, {"psi": lambda c: c["psi"] * 1.62 * DEGREE}, False),
]  # fmt: skip


@pytest.mark.parametrize("check, record, trips", UNITS)
def test_units_and_sizes(check, record, trips):
    found = check(turning(**record), SHIP)
    assert (found is not None and found.trips) is trips


@pytest.mark.parametrize("factor, said", [(KNOT, "u and v look like knots"), (1 / 3.6, "u and v look like km/h")])
@pytest.mark.parametrize("off, told", [(1.08, True), (1.13, False)])
def test_a_unit_is_named_within_a_tenth(factor, said, off, told):
    """A number in this unit that was read as SI is so many times too large."""
    assert (said in str(units.speed_unit(turning(u=lambda c: c["u"] / factor * off), SHIP))) is told


def test_a_track_in_feet_is_told_from_speeds_that_are_not_in_kilometres_an_hour():
    feet = {k: (lambda c, k=k: c[k] / 0.3048) for k in "xy"}
    assert "x and y look like feet" in str(units.speed_unit(turning(**feet), SHIP))
    assert "u and v look like m/s, not km/h" in str(units.speed_unit(turning(u=lambda c: c["u"] / 3.6), SHIP))


def long_enough(run: Recording) -> bool:
    try:
        check_sampling(run, SHIP)
    except InputError:
        return False
    return True


def with_holes(share_of_rudder: float = 0.0, hole: float = 0.0) -> Recording:
    run = turning(length=10 * UNIT)
    lost = np.arange(len(run)) < share_of_rudder * len(run)
    channels = {k: np.where((run.time > 1.0) & (run.time < 1.0 + hole), np.nan, v) for k, v in run.channels.items()}
    return replace(run, channels=channels | {"delta": np.where(lost, np.nan, channels["delta"])})


def uneven(share: float) -> Recording:
    steps = np.where(np.arange(400) < share * 400, 1.6, 1.0)
    time = np.r_[0.0, np.cumsum(np.roll(steps, 1))]
    return replace(turning(length=400.0), time=time)


SAMPLED = [
    (turning(length=np.ceil(4.05 * UNIT)), True),
    (turning(length=np.floor(3.95 * UNIT)), False),
    (turning(step=0.24 * UNIT), True),
    (turning(step=0.26 * UNIT), False),
    (with_holes(share_of_rudder=0.19), True),
    (with_holes(share_of_rudder=0.21), False),
    (with_holes(hole=5.7 * UNIT), True),
    (with_holes(hole=6.3 * UNIT), False),
    (uneven(0.19), True),
    (uneven(0.21), False),
]


@pytest.mark.parametrize("number", range(len(SAMPLED)))
def test_a_diagnosis_needs_four_lengths_four_samples_a_length_and_most_of_the_rudder(number):
    run, good = SAMPLED[number]
    assert long_enough(run) is good


def test_a_record_needs_a_sample_in_a_seventh_of_a_length_at_even_times():
    verdicts = [samples.sampling(turning(step=s * UNIT), SHIP).verdict for s in (0.148, 0.152)]
    assert verdicts == ["ok", "mend"]
    for off, verdict in ((0.19, "ok"), (0.21, "note"), (0.6, "ok")):  # what is longer is a gap
        time = np.arange(301.0)
        time[100:] += off
        assert samples.sampling(replace(turning(), time=time), SHIP).verdict == verdict


@pytest.mark.parametrize("hole, verdict", [(1.4, "ok"), (1.6, "note"), (0.48 * UNIT, "note"), (0.52 * UNIT, "mend")])
def test_a_gap_is_longer_than_one_and_a_half_steps_and_bridged_up_to_half_a_length(hole, verdict):
    time = np.arange(301.0)
    time[200:] += hole - 1.0
    found = samples.gaps(replace(turning(), time=time), SHIP)
    assert found.verdict == verdict
    if verdict == "mend":
        assert [(c.path, c.value) for c in found.changes] == [("end", 199.0)], "the longer piece is kept"


@pytest.mark.parametrize("share, outliers", [(0.045, True), (0.055, False)])
def test_what_lies_far_off_in_one_of_twenty_samples_is_noise(share, outliers):
    run, rng = turning(length=999.0), np.random.default_rng(1)
    values = run["v"] + 0.01 * rng.standard_normal(1000)
    values[np.linspace(3, 990, round(1000 * share)).astype(int)] += 5.0
    finding, flags = samples.outliers(run.with_channels(v=values))
    assert ("v" in flags) is outliers and finding.trips is outliers


@pytest.mark.parametrize("step, verdict", [(0.0095, None), (0.0105, "note"), (0.048, "note"), (0.052, "mend")])
def test_positions_in_steps_of_a_hundredth_of_a_length_are_noted_and_of_a_twentieth_useless(step, verdict):
    size = step * SHIP.length
    run = turning(length=600.0, speed=1.0, step=0.5)
    run = run.with_channels(x=size * np.round(run["x"] / size))
    found = [f for f in samples.quantized(run, SHIP) if f.channels == ("x",)]
    assert [f.verdict for f in found] == ([verdict] if verdict else [])


@pytest.mark.parametrize("share, verdict", [(0.0185, None), (0.0215, "note"), (0.076, "note"), (0.084, "mend")])
def test_a_channel_in_steps_of_a_fiftieth_of_its_range_is_noted_and_of_a_twelfth_useless(share, verdict):
    run = turning(length=600.0, step=0.5)
    values = np.linspace(0.0, 0.02, len(run))
    step = share * np.ptp(np.quantile(values, [0.02, 0.98]))
    found = [
        f for f in samples.quantized(run.with_channels(r=step * np.round(values / step)), SHIP) if "r" in f.channels
    ]
    assert [f.verdict for f in found] == ([verdict] if verdict else [])


@pytest.mark.parametrize("noise, verdict", [(0.3, "note"), (0.8, None)])
def test_noise_of_half_a_step_leaves_averages_that_are_finer_than_the_step(noise, verdict):
    run, step = turning(length=999.0), 0.1
    rough = np.linspace(0.0, 3.0, len(run)) + noise * step * np.random.default_rng(1).standard_normal(len(run))
    found = samples.quantized(run.with_channels(v=step * np.round(rough / step)), SHIP)
    assert [f.verdict for f in found if "v" in f.channels] == ([verdict] if verdict else [])


@pytest.mark.parametrize("jumps, rate, verdict", [(2, 1.6, "mend"), (1, 1.6, "ok"), (2, 1.4, "ok")])
def test_a_rudder_that_twice_goes_half_as_fast_again_as_its_gear_is_an_order(jumps, rate, verdict):
    """Of 2.5 deg/s; small steps of less than 3 deg are none."""
    delta = np.zeros(301)
    for k in range(jumps):
        delta[60 * (k + 1) :] += rate * SHIP.rudder_rate
    assert steering.rudder_jumps(turning(delta=delta), SHIP).verdict == verdict
    small = np.repeat(np.arange(61) % 2 * 2.9 * DEGREE, 5)[:301]
    slow = replace(SHIP, rudder_rate=0.5 * DEGREE)
    assert steering.rudder_jumps(turning(delta=small), slow).verdict == "ok"
    assert steering.rudder_jumps(turning(delta=small * 3.2 / 2.9), slow).verdict == "mend"


def heeling(degrees: float, rate: float = 1.0, push: float = -1.0) -> Recording:
    """A weave whose heel follows its turns at once, with a roll rate of so many times its own."""
    time = np.arange(0.0, 900.0)
    turn, omega = np.sin(2 * np.pi * time / 300), 2 * np.pi / 300
    phi = push * degrees * DEGREE * turn
    p = rate * push * degrees * DEGREE * omega * np.cos(2 * np.pi * time / 300)
    return Recording("run", time, {"u": 7.0 + 0 * time, "r": 0.01 * turn, "phi": phi, "p": p})


HEEL = [
    (heeling(66.0), {"heel unit": None, "roll rate": "ok", "heel side": "ok"}),
    (heeling(71.0), {"heel unit": "mend"}),
    (heeling(0.68), {"heel": "ok"}),  # standard deviation of .48 deg
    (heeling(0.74), {"roll rate": "ok", "heel side": "ok"}),
    (heeling(5.0, rate=1.18), {"roll rate": "ok"}),
    (heeling(5.0, rate=1.23), {"roll rate": "note"}),
    (heeling(5.0, rate=0.82), {"roll rate": "ok"}),
    (heeling(5.0, rate=0.78), {"roll rate": "note"}),
    (heeling(5.0, rate=-1.0), {"roll rate": "mend"}),
    (heeling(5.0, rate=1.4 / DEGREE), {"roll rate": "mend"}),
    (heeling(5.0, rate=1.6 / DEGREE), {"roll rate": "note"}),
    (heeling(5.0, push=1.0), {"heel side": "mend"}),
]


@pytest.mark.parametrize("number", range(len(HEEL)))
def test_heel_its_rate_and_its_side(number):
    run, expected = HEEL[number]
    found = {f.check: f.verdict for f in heel_findings(run, SHIP)}
    assert {check: found.get(check) for check in expected} == expected
    assert ("heel unit" in found or "heel" in found) == (len(found) == 1)


@pytest.mark.parametrize("correlation, side", [(0.57, "ok"), (0.63, "mend"), (-0.57, "ok"), (-0.63, "ok")])
def test_a_ship_heels_to_one_side_of_its_turns_from_a_correlation_of_six_tenths_on(correlation, side):
    run = heeling(5.0)
    across = np.cos(2 * np.pi * run.time / 300)
    phi = 5 * DEGREE * (correlation * run["r"] / 0.01 + np.sqrt(1 - correlation**2) * across)
    (found,) = [f for f in heel_findings(run.with_channels(phi=phi), SHIP) if f.check == "heel side"]
    assert found.verdict == side and found.measured == approx(correlation, abs=0.02)
    assert ("cannot be told" in found.text) is (abs(correlation) < 0.6 and side == "ok")


@pytest.mark.parametrize("name, off, verdict", [
    ("delta", 0.48 * DEGREE, "ok"), ("delta", 0.52 * DEGREE, "mend"),
    ("n", 0.019 * 1.2, "ok"), ("n", 0.021 * 1.2, "mend"),
])  # fmt: skip
def test_a_mean_of_both_sides_is_within_half_a_degree_or_a_fiftieth(name, off, verdict):
    level = {"delta": 0.2, "n": 1.2}[name]
    sides = {f"{name}_starboard": level + 0.05, f"{name}_port": level - 0.05, name: level + off}
    (found,) = side_findings(turning(**sides))
    assert found.verdict == verdict


FAULTS = [  # size over what matters, its standard error, found by the fit; verdict, words
    (1.2, 0.39, False, "note", "perhaps"),
    (1.2, 0.41, False, "ok", "none"),
    (0.9, 0.48, False, "ok", "none"),
    (0.9, 0.52, False, "ok", "this record cannot tell"),
    (0.9, 0.1, True, "note", "too"),
    (1.1, 0.1, True, "mend", "too"),
]


@pytest.mark.parametrize("size, error, found, verdict, words", FAULTS)
def test_a_fault_is_told_from_three_standard_errors_and_mended_from_the_size_that_matters(
    size, error, found, verdict, words
):
    fault = Fault("scale of u", 0.02, "%", 0.01, (0.02 * size,), (0.02 * error,), found)
    finding = fault_finding(fault)
    assert finding.verdict == verdict and words in finding.text


@pytest.mark.parametrize(
    "size, error, clear", [(0.26, 0.06, True), (0.24, 0.01, False), (1.0, 0.26, False), (1.0, 0.24, True)]
)
def test_a_fault_is_clear_from_four_standard_errors_and_a_quarter_of_what_matters(size, error, clear):
    assert Fault("delay of r", 0.5, "s", 1.0, (-0.5 * size,), (0.5 * error,)).is_clear is clear
    both = Fault("current", 1.0, "m/s", 1.0, (3.0, 4.0), (0.3, 0.6))
    assert both.size == 5.0 and both.size_error == approx(np.hypot(0.9, 2.4) / 5)


def test_a_heading_in_the_place_of_the_rudder_is_exchanged_and_one_in_degrees_is_told_its_unit():
    """By where the ship goes; an angle that large without that is a rudder in degrees, and axes may be exchanged."""
    rudder = {"psi": lambda c: 0.1 + 0 * c["u"], "delta": lambda c: c["psi"]}
    found = units.rudder_unit(turning(**rudder), SHIP)
    assert found is not None and found.changes == (Change("channels.delta", "exchange", "psi"),)
    assert "delta and psi look exchanged" in found.remedy
    alone = units.rudder_unit(turning(delta=20.0), SHIP)
    assert alone is not None and alone.changes == in_unit("deg", "delta")
    in_degrees = axes.course(turning(psi=lambda c: c["psi"] / DEGREE), SHIP)
    assert in_degrees is not None and in_degrees.changes == in_unit("deg", "psi")
    to_the_east = {"turn_deg": 0.0, "psi": 90 * DEGREE}  # said of a ship that goes north: x and y are exchanged
    swapped = axes.course(turning(**to_the_east), SHIP)
    assert swapped is not None and not swapped.changes
