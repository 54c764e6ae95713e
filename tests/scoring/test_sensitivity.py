"""Sensitivities where they are known: published indices, linear functions, inputs that do nothing."""

from math import inf, pi

import numpy as np
import pytest
from matplotlib.figure import Figure

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.report.sensitivity_figure import sensitivity_figure
from manoeuvre_nn.scoring.sensitivity import InputSensitivity, error_ratios, sensitivities, sobol_indices

SLOPES = np.array([3.0, -1.0, 0.0, 0.5])


def line(x: np.ndarray) -> np.ndarray:
    return 2.0 + x @ SLOPES


def ishigami(x: np.ndarray) -> np.ndarray:
    return np.sin(x[:, 0]) + 7.0 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0])


def records(count: int = 500, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Inputs, and what the line misses by a known error."""
    draw = np.random.default_rng(seed)
    x = draw.uniform([0.0, -2.0, 5.0, 1.0], [1.0, 2.0, 6.0, 3.0], (count, 4))
    return x, line(x) + draw.normal(0.0, 0.2, count)


def test_indices_of_ishigamis_function_are_the_published_ones():
    first, total = sobol_indices(ishigami, np.array([[-pi, pi]] * 3), seed=1)
    # Ishigami & Homma 1990, a = 7, b = .1; Saltelli et al. 2010.
    np.testing.assert_allclose(first, [0.3139, 0.4424, 0.0], atol=0.01)
    np.testing.assert_allclose(total, [0.5576, 0.4424, 0.2437], atol=0.01)


def test_indices_of_a_line_are_squares_of_slope_times_range():
    ranges = np.array([[0.0, 1.0], [-2.0, 2.0], [5.0, 6.0], [1.0, 3.0]])
    shares = (SLOPES * (ranges[:, 1] - ranges[:, 0])) ** 2
    for indices in sobol_indices(line, ranges):
        np.testing.assert_allclose(indices, shares / shares.sum(), atol=3e-3)


def test_an_input_that_cannot_vary_and_a_model_that_does_not_have_indices_of_0():
    ranges = np.array([[0.0, 1.0], [0.5, 0.5], [5.0, 6.0], [1.0, 3.0]])
    first, total = sobol_indices(line, ranges)
    assert first[1] == total[1] == 0.0 and first[0] == pytest.approx(9.0 / 10.0, abs=3e-3)
    for indices in (*sobol_indices(lambda x: np.full(len(x), 3.0), ranges), *sobol_indices(line, ranges[:, [0, 0]])):
        np.testing.assert_array_equal(indices, 0.0)


def test_the_error_without_an_input_of_a_line_is_that_of_its_slope():
    x, y = records()
    error = y - line(x)
    without = error[:, None] + SLOPES * (x - x.mean(axis=0))
    wanted = np.sqrt(np.square(without).mean(axis=0) / np.square(error).mean())
    found = error_ratios(line, x, y)
    np.testing.assert_allclose(found, wanted, rtol=1e-12)
    assert found[2] == 1.0  # which does nothing
    assert np.argsort(-found).tolist() == [1, 0, 3, 2]


def test_exchanged_values_cost_twice_the_variance():
    x, y = records(4000)
    noise = np.square(y - line(x)).mean()
    wanted = np.sqrt(1 + 2 * SLOPES**2 * x.var(axis=0) / noise)
    found = error_ratios(line, x, y, "permuted")
    np.testing.assert_allclose(found, wanted, rtol=0.02)
    assert found[2] == 1.0
    np.testing.assert_array_equal(found, error_ratios(line, x, y, "permuted"))
    assert (found != error_ratios(line, x, y, "permuted", seed=1))[[0, 1, 3]].all()


def test_a_model_without_error_has_ratios_of_1_and_infinity():
    x, _ = records(20)
    assert error_ratios(line, x, line(x)).tolist() == [inf, inf, 1.0, inf]


def test_all_measures_are_told_of_every_input_and_ranked():
    x, y = records()
    found = sensitivities(line, ["a", "b", "c", "d"], x, y)
    assert [one.name for one in found] == ["b", "a", "d", "c"]
    assert (found[-1].error_ratio, found[-1].permuted_ratio) == pytest.approx((1.0, 1.0), rel=1e-14)
    assert found[0].first == pytest.approx(16.0 / 26.0, abs=0.01) and found[0].total == pytest.approx(
        16.0 / 26.0, abs=0.01
    )
    assert list(found[0].row()) == ["input", "error ratio, mean", "error ratio, permuted", "Sobol first", "Sobol total"]
    assert found[0].row()["input"] == "b"
    half = sensitivities(line, ["a", "b", "c", "d"], x, y, np.array([[0.0, 1.0], [0.0, 0.0], [5.0, 6.0], [1.0, 3.0]]))
    assert {one.name: one.first for one in half}["b"] == 0.0


@pytest.mark.parametrize(
    "call, told",
    [
        (lambda: sobol_indices(line, np.array([[1.0, 0.0]] * 4)), "the lower one first"),
        (lambda: sobol_indices(line, np.array([[0.0, inf]] * 4)), "expected finite ends"),
        (
            lambda: sobol_indices(line, np.array([[0.0, 1.0]] * 4), 1000),
            "1000 points of Sobol indices: expected a power",
        ),
        (lambda: error_ratios(line, np.zeros((0, 4)), np.zeros(0)), "needs records"),
    ],
)
def test_what_makes_no_sense_is_refused(call, told):
    with pytest.raises(InputError, match=told):
        call()


def test_bars_stand_for_the_measures_with_the_first_input_on_top():
    found = [InputSensitivity("beta", 14.1, 12.0, 0.6, 0.8), InputSensitivity("d", 1.3, inf, 0.01, 0.02)]
    figure = sensitivity_figure(found)
    assert isinstance(figure, Figure)
    left, right = figure.axes
    assert [bar.get_width() for bar in left.patches] == [14.1, 1.3, 12.0, 0.0]
    assert [bar.get_width() for bar in right.patches] == [0.6, 0.01, 0.8, 0.02]
    heights = dict(zip([t.get_text() for t in left.get_yticklabels()], left.get_yticks(), strict=True))
    assert heights["beta"] > heights["d"]
