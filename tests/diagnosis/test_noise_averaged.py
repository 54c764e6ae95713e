"""Values and standard errors averaged over levels and correlation times of the process noise."""

import numpy as np
import pytest
from pytest import approx
from test_hypotheses_judged import ACTING, LEVEL, fitted, hypothesis, stand
from trials import CALM, CIRCLE, SHIP, ZIGZAG, runs

from manoeuvre_nn.diagnosis import fits
from manoeuvre_nn.effect.current import Current
from manoeuvre_nn.effect.propulsion import PropellerPitchError
from manoeuvre_nn.effect.wind import SteadyWind
from manoeuvre_nn.estimation import noise_average
from manoeuvre_nn.estimation.data_set import WhitenedDataSet
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis
from manoeuvre_nn.estimation.marginal_likelihood import MarginalLikelihood
from manoeuvre_nn.estimation.noise_average import averaged, with_time
from manoeuvre_nn.estimation.prepared_run import prepared_run
from manoeuvre_nn.estimation.process_noise import PROCESS_LEVELS, QUIET_SIZE, ProcessLevels

pytestmark = pytest.mark.usefixtures("unchecked_types")


@pytest.fixture
def of_times(monkeypatch):
    """What is found at every correlation time, to be written down in place of fits."""

    def give(*found):
        waiting = iter(found)
        monkeypatch.setattr(noise_average, "_at_time", lambda data_set, j, time: next(waiting))

    return give


def wind(speed: float, from_deg: float, evidence: float, sd: float, correction: float = 0.0) -> FittedHypothesis:
    """A fitted wind."""
    h = hypothesis(SteadyWind(SHIP, speed=speed, from_deg=from_deg))
    return FittedHypothesis(
        h, evidence, np.zeros((1, 1)), sd**2 * np.eye(len(h.unknowns())), corrections=np.full(3, correction),
        latencies=np.full(2, correction),
    )  # fmt: skip


def test_means_and_covariances_add_up_as_the_law_of_total_variance_has_it(of_times):
    """Of three times with weights 1/2, 1/4, 1/4, by hand."""
    of_times(wind(10.0, 90.0, np.log(2.0), 1.0, 0.4), wind(12.0, 90.0, 0.0, 2.0), wind(14.0, 94.0, 0.0, 3.0))
    found = averaged(stand("wind"), wind(10.0, 90.0, 5.0, 1.0))
    assert found.hypothesis.vector()[:2] == approx([11.5, 91.0])
    between = 0.5 * 1.5**2 + 0.25 * 0.5**2 + 0.25 * 2.5**2
    assert found.errors[0] ** 2 == approx(0.5 * 1 + 0.25 * 4 + 0.25 * 9 + between)
    assert found.covariance[0, 1] == approx(0.5 * 1.5 * 1.0 - 0.25 * 0.5 * 1.0 + 0.25 * 2.5 * 3.0)
    assert found.corrections == approx(np.full(3, 0.2))
    assert found.latencies == approx(np.full(2, 0.2))
    assert found.evidence == 5.0


def test_directions_are_averaged_the_shorter_way_round(of_times):
    of_times(wind(10.0, 358.0, 0.0, 1.0), wind(10.0, 4.0, 0.0, 1.0), wind(10.0, 1.0, 0.0, 1.0))
    found = averaged(stand("wind"), wind(10.0, 359.0, 0.0, 1.0))
    assert found.hypothesis.vector()[1] == approx(1.0)
    assert found.errors[1] == approx(np.sqrt(1 + 6.0))


def test_at_the_usual_time_nothing_changes():
    stood = stand("wind")
    usual, there = MarginalLikelihood(stood), MarginalLikelihood(with_time(stood, stood.process_time))
    h = hypothesis(SteadyWind(SHIP, speed=10.0, from_deg=60.0))
    for level in (0, LEVEL, 13):
        assert there.evidence_at(h, level) == approx(usual.evidence_at(h, level), abs=1e-6)


def test_levels_of_the_noise_lie_no_further_apart_than_comparisons_bear():
    """At a level that is off by the root of a step a gain of 10 is told as 6.7 to 15, not as 3 to 33."""
    steps = np.array(PROCESS_LEVELS.sizes[1:]) / PROCESS_LEVELS.sizes[:-1]
    assert 1.4 < steps.min() <= steps.max() < 1.52


def test_what_goes_on_longer_leaves_a_constant_effect_less_certain():
    """The mean of a process over a time much longer than its memory T varies as T does, its error as the root of T."""
    # With a state for every sample: a memory of one step is not resolved.
    stood = WhitenedDataSet(
        CALM, [prepared_run(CALM, run) for run in runs([CIRCLE, ZIGZAG], ACTING["thrust"], step=1.0)]
    )
    errors = []
    h = hypothesis(PropellerPitchError(SHIP, fraction=0.15))
    for time in (2.0, 8.0):
        likelihood = MarginalLikelihood(with_time(stood, time))
        largest = likelihood.data_set.levels.sizes.index(0.5)
        level = likelihood.data_set.levels.point(largest, largest)
        errors.append(np.sqrt(likelihood.posterior(likelihood.columns(h), level).covariance(0)[-1, -1]))
    assert errors[1] / errors[0] == approx(2.0, rel=0.15)


def test_a_fitted_wind_stays_within_its_errors():
    before = fitted(MarginalLikelihood(stand("wind")), hypothesis(SteadyWind(SHIP, speed=10.0, from_deg=60.0)))
    found = averaged(stand("wind"), before)
    moved = np.abs(found.hypothesis.vector() - before.hypothesis.vector())
    assert (0 < moved[:2]).all()
    assert (moved < 0.5 * before.errors).all()
    assert found.by_level is before.by_level
    assert found.best == before.best


def test_the_grid_of_process_noise_is_numbered_row_by_row_and_has_neighbours():
    """Of three sizes: 0 1 2 / 3 4 5 / 6 7 8, a row for each size in surge; the second is the last quiet one."""
    grid, unit = ProcessLevels((0.1, 0.2, 0.4)), np.array([10.0, 1.0, 2.0, 3.0])
    assert len(grid) == 9 and [grid.point(*grid.at(g)) for g in range(9)] == list(range(9))
    assert grid[5].tolist() == [0.2, 0.4] and grid.sd(5, unit) == approx([2.0, 0.4, 0.8, 1.2])
    assert grid.beside(4) == [1, 3, 4, 5, 7] and grid.beside(8) == [5, 7, 8] and grid.beside(3) == [0, 3, 4, 6]
    assert [grid.largest(size) for size in (0.05, 0.1, 0.39, 0.4, 7.0)] == [0, 0, 1, 2, 2] and grid.point(9, 1) == 7
    low = ProcessLevels((0.5 * QUIET_SIZE, QUIET_SIZE, 2 * QUIET_SIZE))
    assert (low.quiet(8), low.quiet(6), low.quiet(1)) == (4, 3, 1) and grid.quiet(8) == 0


def test_levels_are_taken_on_until_the_best_is_surrounded_by_worse_ones():
    """On a hill about the point (2, 5) of eight by eight; no point is asked for twice."""
    grid, asked = ProcessLevels(tuple(0.01 * 1.5**k for k in range(8))), []

    def height(point):
        asked.append(point)
        row, column = grid.at(point)
        return -float((row - 2) ** 2 + (column - 5) ** 2)

    known = grid.uphill(grid.point(6, 1), height)
    assert max(known, key=known.get) == grid.point(2, 5) and {*grid.beside(grid.point(2, 5))} <= {*known}
    assert sorted(asked) == sorted(known) and len(known) < 35
    assert sorted(grid.uphill(0, lambda point: -5.0 * point)) == grid.beside(0)
    flat = grid.uphill(grid.point(3, 3), lambda point: 0.0)
    assert len(flat) == 15, "all in the row and the column of the first: none weighs less"


def test_what_was_not_looked_at_is_as_if_surge_and_the_rest_only_added_up():
    """Of three by three sizes the middle row and column are known; 1 + 10 in row and column."""
    grid, whole = ProcessLevels((0.1, 0.2, 0.4)), np.add.outer([0.0, 1.0, 0.5], [0.0, 10.0, 2.0]).reshape(9, 1)
    known = np.where(np.isin(np.arange(9), grid.beside(4))[:, None], whole, -np.inf)
    assert grid.filled(known) == approx(whole)
    other = np.where(np.isfinite(known), 5.0, known)
    other[4] = 1.0  # at another level of what is summed over: there they do not add up to 5 + 5 - 1
    assert grid.filled(np.hstack([known, other]))[0].tolist() == [0.0, 1.0]
    known[3] = -np.inf  # then nothing is known of the first column
    assert np.isneginf(grid.filled(known)[[0, 3, 6]]).all() and grid.filled(known)[[2, 8]] == approx(whole[[2, 8]])


@pytest.mark.parametrize("behind, direction, error", [
    (0.0, 43.0, np.sqrt(1 + 9.0**2)),
    (4.0, 34.0 + 18.0 / (1 + np.exp(4.0)), np.sqrt(1 + 18.0**2 * np.exp(4.0) / (1 + np.exp(4.0)) ** 2)),
    (6.0, 34.0, 1.0),
])  # fmt: skip
def test_a_wind_that_rests_at_two_directions_is_averaged_over_both(monkeypatch, behind, direction, error):
    """It is turned by -45, 45 and 180 deg: to where it was, to 52 deg and to what explains far less."""
    there = {
        349.0: wind(34.0, 34.5, 9.0, 1.0),
        79.0: wind(40.0, 52.0, 9.0 - behind, 1.0),
        214.0: wind(2.0, 200.0, 0.0, 1.0),
    }
    monkeypatch.setattr(fits, "refine", lambda _, h, *at, placing: there[h.values[0][0, 1] % 360.0])
    found = fits.over_directions(stand("wind"), wind(34.0, 34.0, 9.0, 1.0))
    assert found.hypothesis.vector()[1] == approx(direction) and found.errors[1] == approx(error)
    assert found.evidence == 9.0


def test_a_current_has_one_direction(monkeypatch):
    """Its effect on a track is linear in north and east."""
    monkeypatch.setattr(fits, "refine", lambda *_, placing: pytest.fail("fitted again"))
    current = hypothesis(Current(SHIP, speed=0.5, toward_deg=30.0))
    found = FittedHypothesis(current, 5.0, np.zeros((1, 1)), np.eye(2))
    assert fits.over_directions(stand("wind"), found) is found
