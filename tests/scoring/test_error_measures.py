"""Absolute, percent, average angle and correlation, with answers that are known."""

from dataclasses import replace
from math import acos, pi, sqrt

import numpy as np
import pytest

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.report.views import Scores
from manoeuvre_nn.scoring.error_measures import (
    VARIABLES,
    average_angle_measure,
    correlation,
    error_measures,
    normalisations,
    run_measures,
)
from manoeuvre_nn.ship.mariner import mariner_corrected

SAMPLES = np.random.default_rng(0).standard_normal((3, 200))
TIME = np.arange(0.0, 601.0)
RATE, SPEED = 2 * pi / 400, 5.0


def circle(name="tc", course=0.7, **channels):
    """A steady turn of 540 deg from the first sample on: 2 pi x 5 / RATE m around, 2 deg of roll to and fro."""
    psi = course + RATE * TIME
    north, east = SPEED / RATE * (np.sin(psi) - np.sin(course)), -SPEED / RATE * (np.cos(psi) - np.cos(course))
    given = {
        "u": np.full_like(TIME, SPEED),
        "v": np.zeros_like(TIME),
        "r": np.full_like(TIME, RATE),
        "x": 400.0 + north,
        "y": east - 70.0,
        "psi": psi,
        "phi": 1.0 * DEGREE * np.sin(TIME / 10),
        "delta": np.where(TIME < 1, 0.0, 20 * DEGREE),
    }
    return Recording(name, TIME, {**given, **channels}, meta={"kind": "turning_circle"})


def test_the_average_angle_is_1_0_and_minus_1_at_its_limits():
    assert average_angle_measure(SAMPLES, SAMPLES) == pytest.approx(1)
    assert average_angle_measure(SAMPLES, 0 * SAMPLES) == pytest.approx(0)
    assert average_angle_measure(SAMPLES, -SAMPLES) == pytest.approx(-1)
    assert average_angle_measure(0 * SAMPLES, 0 * SAMPLES) == pytest.approx(1)


def test_the_average_angle_is_what_its_equation_says():
    s, p = np.array([1.0, 2.0, -3.0]), np.array([2.0, 2.0, 1.0])
    size = [sqrt(5), sqrt(8), sqrt(10)]
    angle = [acos(3 / sqrt(10)), 0.0, acos(2 / sqrt(20))]
    expected = 1 - 4 / pi * sum(d * a for d, a in zip(size, angle, strict=True)) / sum(size)
    assert average_angle_measure(s, p) == pytest.approx(expected, abs=1e-12)


def test_the_average_angle_keeps_its_value_where_both_are_scaled_or_change_places():
    s, p = SAMPLES[0], SAMPLES[0] + 0.3 * SAMPLES[1]
    own = average_angle_measure(s, p)
    assert average_angle_measure(p, s) == pytest.approx(own)
    assert average_angle_measure(-7 * s, -7 * p) == pytest.approx(own)
    assert average_angle_measure(s[::-1], p[::-1]) == pytest.approx(own)
    assert average_angle_measure(s + 10, p + 10) > own + 0.1  # why positions are counted from the start


def test_correlation_is_that_of_numpy_and_has_no_value_for_what_is_constant():
    s, p = SAMPLES, SAMPLES + 0.5 * SAMPLES[::-1]
    assert correlation(s, p) == pytest.approx([np.corrcoef(a, b)[0, 1] for a, b in zip(s, p, strict=True)])
    assert correlation(s, 3 - 2 * s) == pytest.approx(-1)
    assert np.isnan(correlation(s[0], np.ones(200)))


def test_circles_are_normalised_by_speed_diameter_roll_and_change_of_heading():
    scale = normalisations([circle(), circle("port", u=np.full_like(TIME, 2 * SPEED))]).loc["turning_circle"]
    assert scale["u"] == pytest.approx(1.5 * SPEED)
    assert scale["x"] == scale["y"] == pytest.approx(1.5 * 2 * SPEED / RATE)
    assert scale["phi"] == pytest.approx(2.0, rel=1e-3) and scale["psi"] == pytest.approx(540.0)


def test_overshoots_are_normalised_by_late_speed_spatial_period_and_spans():
    period = 100.0
    wave = np.sin(2 * pi * TIME / period)
    rudder = -20 * DEGREE * np.sign(np.sin(2 * pi * (TIME - 40) / period)) * (TIME >= 10)
    turned = {
        "psi": 0.2 * wave,
        "r": 0.2 * 2 * pi / period * np.cos(2 * pi * TIME / period),
        "x": 4.0 * TIME,
        "y": 30.0 * wave,
        "u": np.where(TIME < 400, 9.0, np.where(TIME < 500, 5.0, 3.0)),
        "delta": rudder,
    }
    run = replace(circle(course=0.0, **turned), meta={"kind": "zigzag"})
    scale = normalisations([run]).loc["zigzag"]
    assert scale["u"] == pytest.approx(4.0, abs=0.01) and scale["x"] == pytest.approx(400.0, rel=0.01)
    assert scale["y"] == pytest.approx(60.0, rel=0.01) and scale["psi"] == pytest.approx(0.4 / DEGREE, rel=0.01)
    no_track = replace(run, channels={k: c for k, c in run.channels.items() if k not in ("x", "y")})
    without = normalisations([no_track]).loc["zigzag"]
    assert np.isnan(without[["x", "y"]]).all() and without["u"] == scale["u"] and without["psi"] == scale["psi"]


def test_constant_errors_are_their_size_along_the_approach_and_their_percentage():
    reference = circle()
    cos, sin = np.cos(0.7), np.sin(0.7)
    off = {"u": 0.1, "x": 3 * cos - 8 * sin, "y": 3 * sin + 8 * cos, "psi": 2 * DEGREE, "phi": 0.2 * DEGREE}
    prediction = reference.with_channels(**{k: reference[k] - d for k, d in off.items()})
    found = error_measures([prediction], [reference]).loc["all"]
    expected = {"u": 0.1, "x": 3.0, "y": 8.0, "phi": 0.2, "psi": 2.0}
    diameter = 2 * SPEED / RATE
    scale = {"u": SPEED, "x": diameter, "y": diameter, "phi": 2.0, "psi": 540.0}
    for name in VARIABLES:
        assert found.loc[name, "absolute"] == pytest.approx(expected[name])
        assert found.loc[name, "percent"] == pytest.approx(100 * expected[name] / scale[name], rel=1e-3)
    assert found.loc["x", "correlation"] == pytest.approx(1) and found.loc["x", "average_angle"] < 1
    of_all = found.loc[list(VARIABLES)].mean()
    assert found.loc["mean", "percent"] == pytest.approx(of_all["percent"])
    assert found.loc["mean", "average_angle"] == pytest.approx(of_all["average_angle"])
    assert np.isnan(found.loc["mean", "absolute"])


def elsewhere(run, turn, north):
    """The same run on another course from another place."""
    cos, sin = np.cos(turn), np.sin(turn)
    x, y = cos * run["x"] - sin * run["y"] + north, sin * run["x"] + cos * run["y"]
    return run.with_channels(x=x, y=y, psi=run["psi"] + turn)


def test_a_manoeuvre_on_another_course_from_another_place_has_the_same_errors():
    reference = circle()
    prediction = reference.with_channels(x=1.1 * reference["x"], y=reference["y"] + 9, psi=1.01 * reference["psi"])
    own = run_measures(prediction, reference)
    other = run_measures(elsewhere(prediction, 2.0, 1e4), elsewhere(reference, 2.0, 1e4))
    assert np.allclose(own, other, equal_nan=True) and (own.loc[["x", "y", "psi"], "absolute"] > 1).all()


def test_sets_are_averages_over_their_runs_on_the_scale_of_all():
    runs = [circle("a"), circle("b"), circle("c", phi=2 * DEGREE * np.sin(TIME / 10))]
    predictions = [r.with_channels(phi=r["phi"] + k * 0.1 * DEGREE) for k, r in enumerate(runs)]
    found = error_measures(predictions, runs, {"validation": ["c"], "training": ["a", "b"]})
    roll = found.xs("phi", level="variable")
    assert roll["absolute"].to_dict() == pytest.approx({"all": 0.1, "validation": 0.2, "training": 0.05})
    assert (roll["percent"] / roll["absolute"]).to_numpy() == pytest.approx(100 / (8 / 3), rel=1e-3)
    nobody = error_measures(predictions, runs, {"nobody": []})
    assert nobody.index.get_level_values("set").unique().tolist() == ["all"] and nobody.equals(found.loc[["all"]])
    with pytest.raises(InputError, match="set validation names d; the runs are: a, b, c"):
        error_measures(predictions, runs, {"validation": ["d"]})


def test_gaps_are_left_out_and_a_prediction_that_ended_rests():
    reference = circle()
    holes = reference["y"].copy()
    holes[100:200] = np.nan
    gaps = reference.with_channels(y=holes)
    assert run_measures(reference, gaps).loc["y", "absolute"] == pytest.approx(0)
    ended = replace(reference.between(0.0, 200.0), status="left_range")
    assert run_measures(ended, reference).loc["psi", "absolute"] == pytest.approx(
        np.maximum(TIME - 200, 0).mean() * RATE / DEGREE
    )


def test_scores_tell_the_measures_of_circles_and_zigzags_without_roll():
    runs = roll_out(
        CalmWater(mariner_corrected()), [turning_circle(20.0, duration=900.0), zigzag(20.0, duration=600.0)]
    )
    predictions = [r.with_channels(u=1.01 * r["u"]) for r in runs]
    found = Scores([], runs, predictions).error_measures({"zigzags": ["zz20"]})
    assert list(found.loc["all"].index) == ["u", "x", "y", "psi", "mean"]
    assert found.loc[("zigzags", "u"), "percent"] == pytest.approx(1.0, rel=0.2)
    assert (found["percent"].dropna() >= 0).all() and found.loc[("all", "x"), "average_angle"] == pytest.approx(1)
