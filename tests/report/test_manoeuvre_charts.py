from dataclasses import replace
from math import pi

import numpy as np
import pytest
from pytest import approx

from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.manoeuvre.criteria import criteria
from manoeuvre_nn.report.manoeuvre_charts import comparison_charts, time_chart, track_chart, turning_segments
from manoeuvre_nn.report.track_marks import effect_arrows, rudder_marks, ship_shape, ships

LENGTH = 100.0


def turning(side: int = 1, course: float = 0.4, radius: float = 150.0) -> Recording:
    """60 s straight ahead at 5 m/s, then a circle with the rudder at 20 deg in a current of .5 m/s ahead."""
    time = np.arange(0.0, 400.0)
    late = np.clip(time - 60.0, 0.0, None)
    turned = late * 5.0 / radius
    ahead, abeam = 5.0 * np.minimum(time, 60.0) + radius * np.sin(turned) + 0.5 * late, radius * (1 - np.cos(turned))
    channels = {
        "x": ahead * np.cos(course) - side * abeam * np.sin(course) + 3000.0,
        "y": ahead * np.sin(course) + side * abeam * np.cos(course) - 70.0,
        "psi": course + side * turned, "r": side * np.where(late > 0, 5.0 / radius, 0.0),
        "u": np.full(400, 5.0), "v": np.zeros(400), "delta": side * np.minimum(late * 5, 20) * DEGREE,
    }  # fmt: skip
    return Recording("tc20", time, channels, "ok", {"kind": "turning_circle", "length": LENGTH})


@pytest.mark.parametrize("side", [1, -1])
def test_the_measures_drawn_in_a_turning_circle_are_its_criteria_and_end_on_the_track(side):
    run = turning(side)
    found = criteria(run, "turning_circle", LENGTH)
    mapped = track_chart(run, run).panels[0]
    lines = [curve for curve in mapped.curves if curve.style.get("linestyle") == ":"]
    drawn = [float(np.hypot(np.diff(line.x), np.diff(line.y))[0]) for line in lines]
    names = ("advance", "transfer", "tactical_diameter")
    assert drawn == approx([found[f"{name}_L"] for name in names], rel=1e-9)
    shown = [mark.text for mark in mapped.marks if not mark.symbol]
    assert shown == [f"{name.replace('_', ' ')} {found[f'{name}_L']:.3g} L" for name in names]
    east, north = (run["y"] - run["y"][0]) / LENGTH, (run["x"] - run["x"][0]) / LENGTH
    for line in (lines[1], lines[2]):
        assert np.hypot(east - line.x[1], north - line.y[1]).min() < 0.03
    assert (lines[0].x[0], lines[0].y[0]) == approx((3.0 * np.sin(0.4), 3.0 * np.cos(0.4)), abs=0.03)


def test_a_circle_that_is_too_short_or_broke_down_has_the_measures_that_it_reached():
    run = turning()
    assert set(turning_segments(run.between(0.0, 120.0), LENGTH)) == {"advance", "transfer"}
    assert turning_segments(replace(run, status="left the physical range at 300 s"), LENGTH) == {}
    zigzag = replace(run, meta={**run.meta, "kind": "zigzag"})
    assert not any(curve.style.get("linestyle") == ":" for curve in track_chart(zigzag, run).panels[0].curves)


def swinging(size: float = 30.0) -> Recording:
    """A heading of 30 sin(w t) deg; the rudder goes over at once whenever it has passed 20 deg."""
    time, w = np.arange(0.0, 361.0), 2 * pi / 120
    first = np.arcsin(20 / size) / w
    delta = 20 * (-1) ** np.maximum(np.ceil((time - first) / 60), 0) * (time > 0)
    psi, r = size * np.sin(w * time), size * w * np.cos(w * time)
    channels = {"psi": psi * DEGREE, "r": r * DEGREE, "delta": delta * DEGREE, "u": np.full(361, 5.0)}
    channels |= {"v": np.zeros(361), "x": 5.0 * time, "y": np.zeros(361)}
    return Recording("zz20", time, channels, "ok", {"kind": "zigzag", "length": LENGTH})


def test_overshoots_are_marked_where_the_heading_turns_back_and_are_the_criteria():
    recorded, predicted = swinging(), swinging(28.0)
    panel = time_chart(recorded, predicted).panels[0]
    by, model = (criteria(run, "zigzag", LENGTH) for run in (recorded, predicted))
    for k, mark in enumerate(panel.marks, 1):
        assert mark.text == f"{by[f'overshoot_{k}_deg']:.3g}° ({model[f'overshoot_{k}_deg']:.3g}°)"
        assert (mark.x, abs(mark.y)) == (approx(30.0 + 60 * (k - 1), abs=0.1), approx(30.0, abs=0.01))
        assert mark.place.startswith("top" if mark.y > 0 else "bottom")
    assert len(panel.marks) == 6 and "recorded (predicted)" in panel.title


def test_headings_of_a_zigzag_count_from_that_of_the_approach():
    recorded, predicted = swinging(), swinging(28.0)
    west = [run.with_channels(psi=run["psi"] + 270 * DEGREE) for run in (recorded, predicted)]
    one, other = (time_chart(*runs, [runs[1]]).panels[0] for runs in ((recorded, predicted), west))
    for a, b in zip([*one.curves], [*other.curves], strict=True):
        assert b.y == approx(a.y, abs=1e-9)
    assert [mark.y for mark in other.marks] == approx([mark.y for mark in one.marks])
    assert other.bands[0].low == approx(one.bands[0].low, abs=1e-9)


def test_the_loop_drawn_in_a_spiral_has_the_width_and_height_of_its_criteria():
    """r = .05 (delta - 1.5) deg/s with 2 deg of lag: 4 deg wide, .2 deg/s high."""
    angles = np.array([15, 10, 5, 0, -5, -10, -15, -10, -5, 0, 5, 10, 15.0])
    time = np.arange(60.0 * len(angles))
    hold, rising = np.repeat(angles, 60), np.repeat(np.sign(np.diff(angles, prepend=16.0)), 60)
    hold[0] = 0.0
    r = 0.05 * (hold - 1.5 - 2.0 * rising) * DEGREE
    channels = dict.fromkeys(("x", "y", "v"), np.zeros(len(time))) | {"u": np.full(len(time), 5.0)}
    channels |= {"psi": np.cumsum(r), "r": r, "delta": hold * DEGREE}
    run = Recording("spiral15", time, channels, "ok", {"kind": "spiral", "length": LENGTH})
    found = criteria(run, "spiral", LENGTH)
    (panel,) = comparison_charts(run, run)["rate against rudder"].panels
    width, height = panel.curves[-2:]
    assert abs(np.diff(width.x)[0]) == approx(found["loop_width_deg"]) == approx(4.0, abs=0.01)
    assert abs(np.diff(height.y)[0]) == approx(found["loop_height_deg_s"]) == approx(0.2, abs=1e-3)
    assert (width.y.tolist(), height.x.tolist()) == ([0.0, 0.0], [0.0, 0.0])
    assert [mark.text for mark in panel.marks] == ["loop width 4°", "loop height 0.2°/s"]


def test_the_rudder_is_marked_where_it_goes_to_a_side_with_the_side_in_words():
    run = swinging()
    marks = rudder_marks(run, np.stack([run["y"], run["x"]], axis=-1))
    words = [f"δ 20° {side}" for side in ("starboard", "port")]
    assert [mark.text for mark in marks] == [words[k % 2] for k in range(len(marks))] and len(marks) == 7
    assert [mark.symbol for mark in marks[:2]] == [">", "<"] and marks[0].colour != marks[1].colour
    still = run.with_channels(delta=run["delta"] * 0.01)
    assert rudder_marks(still, np.stack([run["y"], run["x"]], axis=-1)) == []


@pytest.mark.parametrize("heading, to_starboard, to_port", [
    (90, "top center", "bottom center"), (270, "bottom center", "top center"), (60, "top center", "bottom center"),
    (30, "top right", "bottom right"), (200, "bottom right", "top right"),
])  # fmt: skip
def test_the_rudders_angle_is_written_on_the_outer_side_of_the_turn_and_never_on_the_axis(
    heading, to_starboard, to_port
):
    run = swinging().with_channels(psi=np.full(361, heading * DEGREE))
    first, second, *_ = rudder_marks(run, np.zeros((361, 2)))
    assert (first.place, second.place) == (to_starboard, to_port)


def test_ships_are_drawn_to_scale_with_the_rudder_to_its_side():
    hull = ship_shape(0.0, 20 * DEGREE, 160.0, 23.0)
    assert np.ptp(hull[:5], axis=0) == approx([23.0, 160.0])
    assert hull[6, 0] > 0 > hull[6, 1] and hull[6, 0] == approx(0.08 * 160 * np.sin(20 * DEGREE))
    run = swinging()
    outlines = ships(run, np.zeros((361, 2)), np.array([0.0, 100.0, 1e4]), (160.0, 23.0), {"color": "k"})
    assert np.isnan(outlines.x).sum() == 2  # one gap after each ship, and none beyond the run's end


def test_arrows_point_the_way_that_wind_and_current_go():
    wind, current = effect_arrows({
        "wind_steady": {"speed": 15.0, "from_deg": 60.0}, "current": {"speed": 0.5, "toward_deg": 200.0},
        "shallow_water": {"depth": 20.0}, "wind_onset": {"speed": 0.0, "from_deg": 10.0},
    })  # fmt: skip
    (ebb,) = effect_arrows({"tidal_current": {"speed": -0.5, "toward_deg": 200.0}})
    assert np.rad2deg(ebb.toward) % 360 == approx(20.0) and ebb.text == "current 0.5 m/s towards 20°"
    assert np.rad2deg(wind.toward) == approx(240.0) and wind.text == "wind 15 m/s from 60°"
    assert np.rad2deg(current.toward) == approx(200.0) and current.text == "current 0.5 m/s towards 200°"
    blown = swinging().with_channels(wind_speed=np.full(361, 8.0), wind_from=np.full(361, 350 * DEGREE))
    (arrow,) = track_chart(blown, blown).panels[0].arrows
    assert arrow.text == "wind 8 m/s from 350°, recorded mean" and np.rad2deg(arrow.toward) % 360 == approx(170.0)
    assert track_chart(swinging(), swinging()).panels[0].arrows == []
