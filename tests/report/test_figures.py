from dataclasses import replace

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from manoeuvre_nn.commands.simulate import as_sensed
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.simulate import simulate
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.report.figures import (
    _end_to_end,
    comparison_figures,
    excitation_figure,
    force_figure,
    learning_figure,
    time_series_figure,
    track_figure,
)
from manoeuvre_nn.report.runs import run_rows, runs_figure
from manoeuvre_nn.report.style import PREDICTED, RECORDED, log_axis
from manoeuvre_nn.report.track_marks import ship_shape
from manoeuvre_nn.scoring.score import score
from manoeuvre_nn.ship.mariner import mariner

LENGTH = 100.0


def texts(figure: Figure) -> str:
    axes_texts = [axes.get_title(loc) for axes in figure.axes for loc in ("left", "center", "right")]
    return " ".join([figure.get_suptitle(), *axes_texts])


def curve(axes, style):
    return next(line for line in axes.get_lines() if line.get_color() == style["color"])


def test_the_track_is_drawn_north_up_in_ship_lengths(recorded, make_course):
    axes = track_figure(recorded, make_course(drift=1.0)).axes[0]
    east, north = curve(axes, PREDICTED).get_data()
    assert (east[-1], north[-1]) == pytest.approx((2.0, 20.0))
    assert axes.get_aspect() == 1.0


def test_the_track_starts_at_the_origin_wherever_the_recording_starts(recorded):
    moved = recorded.with_channels(x=recorded["x"] + 5e4, y=recorded["y"] - 3e4)
    east, north = curve(track_figure(moved, moved).axes[0], RECORDED).get_data()
    assert (east[0], north[0]) == pytest.approx((0.0, 0.0))


def test_the_largest_distance_in_the_figure_is_the_score(recorded, make_course):
    prediction = make_course(drift=0.7, status="left the physical range at 120 s", end=120.0)
    judged = score(prediction, recorded, LENGTH)
    axes = track_figure(recorded, prediction).axes[1]
    assert axes.get_lines()[0].get_ydata().max() == pytest.approx(judged.dev_L)
    assert f"{judged.dev_L:.3g} L" in axes.get_title("left")


@pytest.mark.parametrize(("psi", "bow"), [(0.0, (0.0, 0.5)), (np.pi / 2, (0.5, 0.0)), (np.pi, (0.0, -0.5))])
def test_the_bow_points_where_the_heading_says(psi, bow):
    assert ship_shape(psi)[2] == pytest.approx(np.array(bow), abs=1e-12)


def test_a_prediction_that_ended_early_is_shaded_and_says_why(recorded, make_course):
    prediction = make_course(status="left the physical range at 120 s", end=120.0)
    figure = time_series_figure(recorded, prediction)
    assert "left the physical range at 120 s" in texts(figure)
    for axes in figure.axes:
        (patch,) = axes.patches
        assert (patch.get_x(), patch.get_x() + patch.get_width()) == pytest.approx((120.0, 200.0))


def test_a_prediction_that_went_on_to_the_end_is_not_shaded(recorded):
    assert not any(axes.patches for axes in time_series_figure(recorded, recorded).axes)


def test_angles_are_shown_in_degrees(recorded):
    panel, rate, *_ = time_series_figure(recorded, recorded).axes
    assert curve(panel, RECORDED).get_ydata().max() == pytest.approx(20.0, abs=0.05)
    assert curve(rate, RECORDED).get_ydata().max() == pytest.approx(1.0, abs=0.01)


def test_the_rudder_gets_its_own_panel_when_the_heading_goes_far(recorded):
    turning = recorded.with_channels(psi=recorded.time * 0.02)
    assert len(time_series_figure(recorded, recorded).axes) == 4
    assert len(time_series_figure(turning, turning).axes) == 5


def test_the_points_of_a_spiral_are_the_steady_ones(spiral):
    axes = comparison_figures(spiral, spiral)["rate against rudder"].axes[0]
    points = next(line for line in axes.get_lines() if line.get_marker() == "o")
    delta, r = points.get_data()
    assert delta == pytest.approx([20, 10, 0, -10, -20], abs=1e-9)
    assert r == pytest.approx(delta / 20)


def test_where_the_rudder_moves_both_ways_there_is_a_figure_of_rate_against_rudder(recorded, spiral):
    circle = replace(recorded, meta={**recorded.meta, "kind": "turning_circle"})
    assert set(comparison_figures(circle, circle)) == {"track", "time series"}
    assert "rate against rudder" in comparison_figures(spiral, spiral)


def test_recordings_are_laid_end_to_end():
    clock, breaks = _end_to_end(np.array([0.0, 1.0, 2.0, 0.0, 1.0]))
    assert clock.tolist() == [0, 1, 2, 3, 4]
    assert breaks.tolist() == [3]


def test_the_force_figure_shows_the_error_beside_the_forces():
    times = np.arange(10.0)
    target = np.stack([times, 2 * times, 3 * times], axis=-1)
    figure = force_figure(times, target, target + np.array([0.1, 0.2, 0.3]))
    for row in range(3):
        assert figure.axes[2 * row + 1].get_lines()[0].get_ydata() == pytest.approx(np.full(10, 0.1 * (row + 1)))


def test_the_learning_curve_has_a_panel_a_quantity_and_leaves_out_what_a_logarithm_cannot_show():
    history = [
        {"epoch": 1, "train/mse": 1.0, "train/relrmse_g1": 0.5, "score/dev_L": 2.0, "zz20/dev_L": float("nan")},
        {
            "epoch": 2,
            "train/mse": 0.0,
            "train/relrmse_g1": 0.1,
            "score/dev_L": 1.0,
            "zz20/dev_L": 0.5,
            "zz20/nrmse_u": 9,
        },
        {"epoch": 3, "train/mse": 0.01},
    ]
    figure = learning_figure(history)
    mse, relative, held_out = figure.axes
    assert mse.get_lines()[0].get_xydata().tolist() == [[1, 1.0], [3, 0.01]]
    assert [line.get_label() for line in relative.get_lines()] == ["g1"]
    assert [line.get_label() for line in held_out.get_lines()] == ["mean", "zz20"]
    assert held_out.get_lines()[1].get_xydata().tolist() == [[2, 0.5]]


def test_an_empty_history_still_gives_a_figure():
    assert learning_figure([]).axes


def test_coverage_shows_rudder_in_degrees_against_yaw_rate():
    inputs = np.array([[1.0, 0.1, 0.2, np.deg2rad(15)], [1.0, 0.2, 0.4, np.deg2rad(30)]])
    left, right = excitation_figure(inputs, {"zz20": inputs}).axes
    assert left.get_lines()[0].get_xdata() == pytest.approx([15, 30])
    assert right.get_lines()[0].get_xdata() == pytest.approx([0.1, 0.2])
    assert left.collections[0].get_offsets().data == pytest.approx(np.array([[15, 0.2], [30, 0.4]]))


def test_every_axis_has_a_unit(recorded, spiral):
    inputs = np.ones((3, 4))
    figures = [
        *comparison_figures(recorded, recorded).values(),
        *comparison_figures(spiral, spiral).values(),
        force_figure(np.arange(3.0), np.ones((3, 3)), np.ones((3, 3))),
        excitation_figure(inputs, {}),
    ]
    for figure in figures:
        labels = [label for axes in figure.axes for label in (axes.get_xlabel(), axes.get_ylabel()) if label]
        assert len(labels) >= len(figure.axes)
        assert all("[" in label and "]" in label for label in labels), labels


def test_recorded_is_solid_grey_and_predicted_dashed_and_coloured(recorded):
    lines = time_series_figure(recorded, recorded).axes[1].get_lines()
    assert [line.get_linestyle() for line in lines] == ["-", "--"]
    red, green, blue = (int(to_hex(lines[0].get_color())[k : k + 2], 16) for k in (1, 3, 5))
    assert red == green == blue


@pytest.mark.parametrize(
    ("ends", "ticks"),
    [
        ((0.29, 0.42), [0.30, 0.33, 0.36, 0.39, 0.42]),
        ((0.04, 1.1), [0.05, 0.1, 0.2, 0.5, 1.0]),
        ((0.9, 1100.0), [1.0, 10.0, 100.0, 1000.0]),
        ((1e-12, 1.0), [1e-12, 1e-10, 1e-8, 1e-6, 1e-4, 1e-2, 1.0]),
    ],
)
def test_a_logarithmic_axis_has_some_ticks_and_never_too_many(ends, ticks):
    axis = log_axis(Figure().subplots()).yaxis
    assert axis.get_major_locator().tick_values(*ends) == pytest.approx(ticks)


def test_the_map_of_a_track_to_the_east_is_as_high_as_it_needs(recorded):
    eastward = recorded.with_channels(x=recorded["y"], y=recorded["x"], psi=recorded["psi"] + np.pi / 2)
    figure = track_figure(eastward, eastward)
    assert figure.get_figheight() < figure.get_figwidth()
    assert np.diff(figure.axes[0].get_xlim()) == pytest.approx(4 * np.diff(figure.axes[0].get_ylim()))


@pytest.mark.parametrize(("seconds", "status"), [(12.0, "never reversed"), (200.0, "ok")])
def test_a_zigzag_too_short_for_its_heading_is_told(seconds, status):
    run = simulate(CalmWater(mariner()), zigzag(20.0, duration=seconds))
    assert run_rows([run], LENGTH)[0]["status"] == status
    assert run_rows([as_sensed(run)], LENGTH)[0]["status"] == "ok", "no velocity through the water was recorded"


def test_headings_of_runs_are_told_and_drawn_without_the_whole_turns_at_their_start(recorded):
    once_round = recorded.with_channels(psi=recorded["psi"] + 2 * np.pi)
    assert run_rows([once_round], LENGTH) == run_rows([recorded], LENGTH)
    first, second = (runs_figure([run], LENGTH).axes[1].get_lines()[0].get_ydata() for run in (recorded, once_round))
    np.testing.assert_allclose(first, second)
    bare = Recording("bare", recorded.time, {"psi": np.full(len(recorded), np.nan)}, "ok", {})
    assert run_rows([bare], LENGTH)[0]["heading [deg]"] == "–" == run_rows([bare], LENGTH)[0]["rudder [deg]"]
