"""Criteria of paths that are known in closed form, and of recordings as they come."""

import warnings
from math import pi, sqrt

import numpy as np
import pytest
from fleet import rolled, ship_named, unchecked
from pytest import approx

from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.manoeuvre.criteria import _last_fitted, criteria, reversal_times, trace
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag

LENGTH = 100.0


def recording(t, psi, r, delta, u=5.0, v=0.0, x=None, y=None):
    channels = {"psi": psi, "r": r, "delta": delta, "u": u + 0 * t, "v": v + 0 * t}
    if x is not None:
        channels |= {"x": x, "y": y}
    return Recording("made", t, channels)


def circle(side=1, step=1.0, course=0.0, radius=200.0, straight=0.0, rate=5.0):
    """A straight approach, then at once a perfect circle with a drift angle of nought."""
    t = np.arange(0.0, straight + 400.0 + 1e-9, step)
    late = np.clip(t - straight, 0.0, None)
    r = np.where(t >= straight, 5.0 / radius, 0.0)
    turned = late * 5.0 / radius
    ahead, abeam = 5.0 * np.minimum(t, straight) + radius * np.sin(turned), radius * (1 - np.cos(turned))
    x = ahead * np.cos(course) - side * abeam * np.sin(course) + 1000.0
    y = ahead * np.sin(course) + side * abeam * np.cos(course) - 500.0
    delta = side * np.minimum(late * rate * DEGREE, 20 * DEGREE)
    return recording(t, course + side * turned, side * r, delta, x=x, y=y)


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("course", [0.0, 2.0, -3.0])
@pytest.mark.parametrize("straight", [0.0, 60.0])
def test_a_perfect_circle_has_the_radius_that_it_was_made_with(side, course, straight):
    found = criteria(circle(side, course=course, straight=straight), "turning_circle", LENGTH)
    assert found["advance_L"] == approx(2.0, abs=2e-3)
    assert found["transfer_L"] == approx(2.0, abs=2e-3)
    assert found["tactical_diameter_L"] == approx(4.0, abs=2e-3)
    assert found["steady_diameter_L"] == approx(4.0, abs=2e-3)
    assert found["steady_u_m_s"] == approx(5.0)
    assert found["steady_r_deg_s"] == approx(0.025 / DEGREE)
    assert found["speed_loss"] == approx(0.0, abs=1e-12)
    assert found["steady_drift_deg"] == approx(0.0, abs=1e-12)


def test_sampling_every_five_seconds_costs_nothing():
    """7 deg between samples: a straight line between them would miss the crossing by much more."""
    fine, coarse = (criteria(circle(step=h), "turning_circle", LENGTH) for h in (0.5, 5.0))
    assert coarse == approx(fine, abs=1e-4)


def test_the_drift_angle_is_positive_with_the_bow_inside_the_turn():
    made = circle(-1)
    made = made.with_channels(v=np.full(len(made), 1.0), u=np.full(len(made), sqrt(3.0)))
    assert criteria(made, "turning_circle", LENGTH)["steady_drift_deg"] == approx(30.0)


def test_what_the_recording_is_too_short_for_is_absent():
    quarter = 0.5 * pi * 40.0
    whole = circle()
    assert criteria(whole.between(0.0, quarter - 3), "turning_circle", LENGTH) == {}
    assert set(criteria(whole.between(0.0, quarter + 3), "turning_circle", LENGTH)) == {"advance_L", "transfer_L"}
    half = criteria(whole.between(0.0, 2 * quarter + 3), "turning_circle", LENGTH)
    assert set(half) == {"advance_L", "transfer_L", "tactical_diameter_L"}


@pytest.mark.parametrize("change, steady", [(0.019, True), (0.021, False), (-0.019, True), (-0.021, False)])
@pytest.mark.parametrize("channel", ["u", "r"])
def test_a_turn_is_steady_if_speed_and_rate_change_by_less_than_2_percent_over_its_last_90_deg(channel, change, steady):
    made = circle(step=0.5)
    # 90 deg take 62.8 s; the change is over the middle value.
    course = 1 + change * (made.time - made.time[-1] + 0.25 * pi * 40.0) / (0.5 * pi * 40.0)
    slow = made.with_channels(**{channel: made[channel] * course})
    found = criteria(slow, "turning_circle", LENGTH)
    assert ("steady_u_m_s" in found) == steady
    if steady:  # read over the last fifth: its middle is .4 of the stretch after that of the whole
        expected = {"u": 5.0, "r": 0.025}[channel] * (1 + 0.4 * change)
        assert found["steady_u_m_s" if channel == "u" else "steady_r_deg_s"] == approx(
            expected if channel == "u" else expected / DEGREE, rel=5e-4
        )


def test_a_steady_turn_needs_270_deg_and_three_samples_of_its_last_quarter():
    made = circle(step=0.5)
    quarter = 0.5 * pi * 40.0
    assert "steady_u_m_s" in criteria(made.between(0.0, 3 * quarter + 1), "turning_circle", LENGTH)
    assert "steady_u_m_s" not in criteria(made.between(0.0, 3 * quarter - 1), "turning_circle", LENGTH)
    assert "steady_u_m_s" not in criteria(circle(step=45.0), "turning_circle", LENGTH)
    lost = criteria(circle(straight=60.0).with_channels(u=np.where(circle(straight=60.0).time <= 60, 5.0, 4.0)),
                    "turning_circle", LENGTH)  # fmt: skip
    assert lost["speed_loss"] == approx(0.2) and lost["steady_diameter_L"] == approx(2 * 4.0 / 0.025 / LENGTH)


@pytest.mark.parametrize("deg, moved", [(0.97, False), (1.03, True)])
def test_a_rudder_that_moves_by_less_than_a_degree_is_no_execute(deg, moved):
    t = np.arange(100.0)
    delta = (2.0 + np.where(t > 30, deg, 0.0)) * DEGREE
    seen = trace(recording(t, 0 * t, 0 * t, delta))
    assert (seen is not None) == moved
    assert not moved or (seen.side, seen.base) == (1, approx(2 * DEGREE))


def test_four_whole_samples_make_a_trace():
    made = circle().between(0.0, 4.0)
    assert len(made) == 5 and trace(made) is not None
    for gaps, enough in ((1, True), (2, False)):
        holed = made.with_channels(psi=np.where(np.arange(5) < gaps, np.nan, made["psi"]))
        assert (trace(holed) is not None) == enough


def test_a_turn_that_still_slows_down_has_no_steady_part():
    made = circle()
    slowing = made.with_channels(u=5.0 - 0.01 * made.time)
    assert "steady_diameter_L" not in criteria(slowing, "turning_circle", LENGTH)


@pytest.mark.parametrize("kind", ["", "random_rudder", "turning_circle", "zigzag", "pull_out", "spiral"])
def test_a_rudder_that_never_moves_and_a_kind_without_criteria_give_nothing(kind):
    t = np.arange(10.0)
    still = recording(t, 0 * t, 0 * t, 0 * t + 0.3 * DEGREE)
    assert criteria(still, kind, LENGTH) == {}
    assert criteria(circle(), "" if kind else "unheard of", LENGTH) == {}


def test_a_recording_without_positions_has_the_criteria_that_need_none():
    bare = circle()
    bare = Recording("bare", bare.time, {k: c for k, c in bare.channels.items() if k not in {"x", "y"}})
    found = criteria(bare, "turning_circle", LENGTH)
    assert "steady_diameter_L" in found and "advance_L" not in found


def swinging(side=1, step=1.0, start=0.0, rate=4.0):
    """A heading of 30 sin(w t) deg; the rudder begins to go over when the heading has passed 20 deg."""
    t = np.arange(0.0, start + 420.0 + 1e-9, step)
    w, late = 2 * pi / 120.0, np.clip(t - start, 0.0, None)
    psi, r = 30 * np.sin(w * late), 30 * w * np.cos(w * late) * (t >= start)
    first = np.arcsin(2 / 3) / w
    delta, was = np.zeros_like(t), 0.0
    moments = [0.0] + [first + 60.0 * k for k in range(9)]
    for k, moment in enumerate(moments):
        target = 20.0 * (-1) ** k
        moved = np.clip(rate * (late - moment), 0.0, abs(target - was))
        delta = np.where(late > moment, was + np.sign(target - was) * moved, delta)
        was = target
    return recording(t, side * psi * DEGREE, side * r * DEGREE, side * delta * DEGREE), first + start, 120.0


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("start", [0.0, 34.0])
@pytest.mark.parametrize("step", [0.1, 1.0, 2.0])
def test_a_heading_that_swings_like_a_sine_has_its_overshoot_and_period(side, start, step):
    made, first, period = swinging(side, step, start)
    found = criteria(made, "zigzag", LENGTH)
    overshoots = [found[f"overshoot_{k}_deg"] for k in range(1, 7)]
    assert overshoots == approx([10.0] * 6, abs=0.01)
    assert found["period_s"] == approx(period, abs=0.01)
    assert found["reversals"] == 7
    times, _ = reversal_times(trace(made))
    assert times == approx([first + 60.0 * k for k in range(7)], abs=0.01)
    ten = np.arcsin(1 / 3) * 120 / (2 * pi)
    assert found["initial_turning_time_s"] == approx(ten, abs=0.02)
    assert found["initial_turning_L"] == approx(5.0 * ten / LENGTH, abs=1e-3)


def test_the_overshoot_counts_from_the_heading_at_the_reversal_not_from_the_one_that_was_meant():
    """A helmsman 2 deg late: his 20/20 zigzag is reversed at 22 deg."""
    trial = zigzag(20.0, 22.0, duration=200.0)
    with unchecked():
        (late,) = roll_out(CalmWater(ship_named("mariner")), [trial])
    found = criteria(late, "zigzag", 152.4)
    assert found["overshoot_1_deg"] == approx(late["psi"].max() / DEGREE - 22.0, abs=0.01)


def test_the_last_overshoot_ends_where_the_rudder_is_given_up():
    """Amidships after three executes: what the heading does later is no overshoot of the third."""
    made, first, _ = swinging(step=0.5)
    last = first + 60.0 + 15.0  # the third rudder is over
    given_up = made.with_channels(delta=np.where(made.time < last, made["delta"], 0.0))
    times, end = reversal_times(trace(given_up))
    assert times == approx([first, first + 60.0], abs=0.01) and end == approx(last, abs=1.0)
    found = criteria(given_up, "zigzag", LENGTH)
    assert found["reversals"] == 2 and "period_s" not in found and "overshoot_2_deg" not in found
    assert found["overshoot_1_deg"] == approx(10.0, abs=0.01)


def test_a_rudder_counts_as_over_beyond_three_tenths_of_its_largest_angle():
    t = np.arange(0.0, 200.0, 0.5)
    psi = 20 * np.sin(2 * pi * t / 100) * DEGREE
    for share, reversals in ((0.28, 0), (0.32, 1)):
        delta = np.where(t < 2, 0.0, np.where(t < 80, 20.0, -20.0 * share)) * DEGREE
        found = criteria(recording(t, psi, np.gradient(psi, t), delta), "zigzag", LENGTH)
        assert found["reversals"] == reversals


def test_a_ship_that_curves_has_sailed_the_length_of_her_path_at_ten_degrees():
    """Speed 5 m/s ahead and 2 to the side, growing evenly: the mean of both ends times the time."""
    t = np.arange(0.0, 60.0)
    r = np.full_like(t, 0.5 * DEGREE)
    made = recording(t, r * t, r, np.where(t < 1, 0.0, 10.0) * DEGREE, u=5.0 + 0.1 * t, v=0.4 * (5.0 + 0.1 * t))
    found = criteria(made, "zigzag", LENGTH)
    # From the execute at 0 s to 20 s: hypot(1, .4) times 5 to 7 m/s.
    assert found["initial_turning_time_s"] == approx(20.0, abs=1e-6)
    assert found["initial_turning_L"] == approx(np.hypot(1.0, 0.4) * 6.0 * 20.0 / LENGTH, rel=1e-6)


def test_an_overshoot_that_is_still_growing_is_absent():
    made, first, _ = swinging()
    found = criteria(made.between(0.0, first + 10.0), "zigzag", LENGTH)
    assert found["reversals"] == 1 and "overshoot_1_deg" not in found and "period_s" not in found


@pytest.mark.parametrize("seed", range(3))
def test_noise_and_gaps_do_not_change_what_is_read(seed):
    made, _, period = swinging(step=0.5, start=40.0)
    random = np.random.default_rng(seed)
    noise = {"psi": 0.05, "r": 0.01, "delta": 0.2}
    noisy = made.with_channels(**{k: made[k] + random.normal(0, s * DEGREE, len(made)) for k, s in noise.items()})
    noisy["psi"][random.integers(0, len(made), 20)] = np.nan
    found = criteria(noisy, "zigzag", LENGTH)
    assert found["reversals"] == 7
    assert [found[f"overshoot_{k}_deg"] for k in range(1, 7)] == approx([10.0] * 6, abs=0.4)
    assert found["period_s"] == approx(period, abs=0.5)
    assert all(np.isfinite(v) for v in found.values())


def test_both_sides_of_a_symmetric_ship_have_the_same_criteria():
    model = CalmWater(ship_named("great_lakes_bulker"))
    for make, kind in ((zigzag, "zigzag"), (turning_circle, "turning_circle")):
        sides = ("starboard", "port")
        trials = [make(20.0, duration=250.0, **{"side" if make is turning_circle else "first": s}) for s in sides]
        with unchecked():
            a, b = (criteria(r, kind, 217.627) for r in roll_out(model, trials))
        assert len(a) > 1 and b == approx(a, abs=1e-6)


def test_an_approach_before_the_execute_changes_nothing():
    """The same zigzag 50 s later, on another course and with a degree of rudder carried on the approach."""
    plain = rolled("mariner")["zz20"]
    t = np.concatenate([np.arange(50.0), plain.time + 50.0])
    ahead = {k: np.concatenate([np.full(50, c[0]), c]) for k, c in plain.channels.items() if k in plain.channels}
    ahead["x"] = np.concatenate([-plain["u"][0] * np.arange(50.0, 0.0, -1.0), plain["x"]])
    turned = {"psi": ahead["psi"] + 1.0, "x": -ahead["y"] * np.sin(1) + ahead["x"] * np.cos(1)}
    turned["y"] = ahead["x"] * np.sin(1) + ahead["y"] * np.cos(1)
    late = Recording("late", t, {**ahead, **turned})
    assert trace(late).execute == approx(50.0, abs=0.01)
    assert criteria(late, "zigzag", 152.4) == approx(criteria(plain, "zigzag", 152.4), rel=1e-3)


def test_a_pull_out_leaves_the_residual_rate_and_its_half_time():
    t = np.arange(0.0, 400.0)
    r = np.where(t < 100, 0.8, 0.1 + 0.7 * np.exp(-(np.clip(t - 100, 0, None)) / 20.0))
    delta = np.interp(t, [0, 8, 100, 100.001], [0, 20, 20, 0])
    made = recording(t, np.cumsum(r) * DEGREE, r * DEGREE, delta * DEGREE)
    found = criteria(made, "pull_out", LENGTH)
    assert found["residual_rate_deg_s"] == approx(0.1, abs=1e-3)
    assert found["half_time_s"] == approx(20.0 * np.log(2), abs=1.1)
    assert criteria(made.between(0.0, 90.0), "pull_out", LENGTH) == {}


@pytest.mark.parametrize("first", [1, -1])
def test_a_spiral_with_a_known_loop(first):
    """r = .05 (delta - 1.5) deg/s with 2 deg of lag: neutral at 1.5 deg, 4 deg wide, .2 deg/s high."""
    angles = first * np.array([15, 10, 5, 0, -5, -10, -15, -10, -5, 0, 5, 10, 15.0])
    t = np.arange(0.0, 60.0 * len(angles))
    which = np.clip(np.ceil(t / 60) - 1, 0, None).astype(int)
    hold, rising = angles[which], np.sign(np.diff(angles, prepend=angles[0] + first))[which]
    r = 0.05 * (hold - 1.5 - 2.0 * rising)
    before = np.where(which == 0, 0.0, angles[np.clip(which - 1, 0, None)])
    delta = before + np.clip(2.0 * (t - 60 * which) / np.maximum(np.abs(hold - before), 1e-9), 0, 1) * (hold - before)
    found = criteria(recording(t, np.cumsum(r) * DEGREE, r * DEGREE, delta * DEGREE), "spiral", LENGTH)
    assert found["neutral_rudder_deg"] == approx(1.5, abs=0.01)
    assert found["loop_width_deg"] == approx(4.0, abs=0.01)
    assert found["loop_height_deg_s"] == approx(0.2, abs=1e-3)


def test_the_rate_after_a_pull_out_is_the_mean_of_its_last_fifth_and_falls_by_half_between_samples():
    t = np.arange(0.0, 301.0)
    late = np.clip(t - 100.0, 0.0, None)
    rate = np.where(t < 100, 1.0, np.maximum(0.3, 1.0 - 0.01 * late) - 1e-4 * late)
    delta = np.where((t > 0) & (t <= 100), 20.0, 0.0)
    found = criteria(recording(t, np.cumsum(rate) * DEGREE, rate * DEGREE, delta * DEGREE), "pull_out", LENGTH)
    residual = 0.3 - 1e-4 * 180.0
    assert found["residual_rate_deg_s"] == approx(residual)
    # From 1 deg/s half of the rest is gone where 1 - .0101 t has come down to the middle of both.
    assert found["half_time_s"] == approx((1 - 0.5 * (1 + residual)) / 0.0101, abs=0.02)
    still = recording(t, 0 * t, 0 * t + 0.5 * DEGREE, delta * DEGREE)
    assert set(criteria(still, "pull_out", LENGTH)) == {"residual_rate_deg_s"}, "nothing falls"


@pytest.mark.parametrize("count", [5, 12, 40])
def test_the_value_at_an_end_is_that_of_a_line_through_the_last_tenth_or_of_the_last_of_few_samples(count):
    time = np.linspace(0.0, 100.0, count)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert _last_fitted(time, 2.0 + 0.1 * time) == approx(12.0)
    bent = np.where(time < 90.0, 50.0, 3.0 - 0.2 * (time - 100.0))
    assert _last_fitted(time, bent) == approx(3.0), "what was before does not count"


def test_a_straight_run_is_read_over_its_first_and_last_fifth():
    t = np.arange(0.0, 101.0)
    made = recording(
        t, 0 * t + 0.3 + 0.001 * t, 0 * t, 0 * t, u=np.where(t <= 20, 5.0, np.where(t >= 80, 3.0, 9.0)), v=0.0
    )
    found = criteria(made, "straight", LENGTH)
    assert found == approx({"speed_change": -0.4, "heading_change_deg": 0.1 / DEGREE})
    drifting = made.with_channels(u=0 * t + 4.0, v=0 * t + 3.0, x=1.0 * t, y=2.0 * t)
    found = criteria(drifting, "straight", LENGTH)
    assert found["drift_L"] == approx((200 * np.cos(0.3) - 100 * np.sin(0.3)) / LENGTH) and found["speed_change"] == 0


def test_a_straight_run_has_its_loss_of_speed_and_drift():
    t = np.arange(0.0, 101.0)
    made = recording(t, 0 * t + pi / 2, 0 * t, 0 * t, u=np.where(t < 50, 5.0, 4.0), x=-0.5 * t, y=5.0 * t)
    found = criteria(made, "straight", LENGTH)
    assert found == approx({"speed_change": -0.2, "heading_change_deg": 0.0, "drift_L": 0.5})
