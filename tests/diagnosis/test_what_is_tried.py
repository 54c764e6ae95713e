"""What is tried: runs that are simulated, memories, sizes, peaks, blocks of time and other ships."""

from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest
from pytest import approx
from searches import fitted
from trials import CALM, SHIP

from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.diagnosis import event_blocks, formula, next_runs, recurring, right_ship
from manoeuvre_nn.diagnosis.search import SearchResult
from manoeuvre_nn.estimation.corrections import CoefficientPrior
from manoeuvre_nn.estimation.data_set import COEFFICIENT_SD_LEVELS
from manoeuvre_nn.estimation.hypothesis import Hypothesis
from manoeuvre_nn.estimation.process_noise import PROCESS_LEVELS

pytestmark = pytest.mark.usefixtures("unchecked_types")


class Seen(Exception):
    """What was to be simulated is known."""


@pytest.mark.parametrize("step, interval", [(1.0, None), (5.0, 5.0)])
def test_every_manoeuvre_is_simulated_on_four_headings_and_at_half_speed_for_sixteen_lengths(
    monkeypatch, step, interval
):
    """A sample every sixth of a length, or as rarely as was recorded."""
    seen = {}

    def rollout(acting, manoeuvres, start, times, step):
        seen.update(manoeuvres=manoeuvres, start=start.numpy(), times=times.numpy())
        raise Seen

    monkeypatch.setattr(next_runs, "rollout", rollout)
    track = np.zeros((4, 6))
    track[:, 5] = 30.0 * DEGREE
    run = SimpleNamespace(linearised=SimpleNamespace(run=SimpleNamespace(step=step), track=track))
    with pytest.raises(Seen):
        next(next_runs.new_runs(Mock(dynamics=CALM, runs=[run]), Hypothesis((), ())))
    p = SHIP.particulars
    ways = {(round(u / p.speed, 3), round(psi / DEGREE)) for u, psi in seen["start"][:, [0, 5]]}
    assert ways == {(1.0, 30), (1.0, 120), (1.0, 210), (1.0, 300), (0.5, 30)}
    assert len(seen["start"]) == 5 * len({id(m) for m in seen["manoeuvres"]})
    every = interval or p.time_unit / 6
    assert np.diff(seen["times"]) == approx(every) and seen["times"][-1] == approx(16 * p.time_unit, abs=1.01 * every)


@pytest.mark.parametrize("duration, longest", [(600.0, 200.0), (90.0, 30.0), (24.0, 10.0)])
def test_forces_that_follow_the_motion_late_are_tried_with_seven_memories_from_five_seconds_to_a_third_of_a_run(
    monkeypatch, duration, longest
):
    """Alike on a logarithmic scale; of a run of less than half a minute up to ten seconds."""
    monkeypatch.setattr(formula, "recurring", lambda data_set: [])
    run = Mock(linearised=Mock(run=Mock(duration=duration)))
    tried = {c.scales["memory_s"] for c in formula._candidates(Mock(runs=[run])) if "memory_s" in c.scales}
    assert sorted(tried) == approx([5.0 * (longest / 5.0) ** (k / 6) for k in range(7)])


def test_of_each_equation_the_two_highest_peaks_are_tried_that_are_no_neighbours():
    frequencies = np.arange(30.0)[:, None]
    amplitude = np.full((30, 3, 1), 1e-6 + 0j)
    for equation, heights in enumerate((
        {5: 3.0, 6: 2.9, 20: 2.0, 12: 1.0},
        {7: 1.0, 25: 3.0, 16: 2.0},
        {1: 1.0, 9: 4.0},
    )):
        for place, height in heights.items():
            amplitude[place, equation] = height
    found = [(e, int(f[0])) for e, f, _ in recurring._peaks(amplitude, np.ones(1), frequencies)]
    assert found == [("X", 5), ("X", 20), ("Y", 25), ("Y", 16), ("N", 9), ("N", 1)]


def test_a_force_is_never_further_from_a_size_that_is_tried_than_by_the_root_of_two():
    """Sizes go by factors of two."""
    smaller, larger = event_blocks.SCALES
    assert larger / smaller == approx(2.0) and smaller * larger == approx(1.0, rel=0.03)


class Columned:
    """So many columns of nothing."""

    def __init__(self, count: int) -> None:
        self.count = count

    def dot(self, other: "Columned") -> np.ndarray:
        return np.zeros((self.count, other.count))


@pytest.mark.parametrize("duration, sizes, block", [
    (300.0, 1, 10.0), (900.0, 1, 10.0), (1800.0, 1, 20.0), (300.0, 2, 10.0), (360.0, 2, 10.0), (1800.0, 2, 50.0),
])  # fmt: skip
def test_a_run_is_block_columns_of_ten_seconds_ninety_for_one_force_and_thirty_six_for_a_grid_at_most(
    monkeypatch, duration, sizes, block
):
    monkeypatch.setattr(event_blocks, "write_times", lambda effect, values, times: None)
    monkeypatch.setattr(event_blocks, "contribution", lambda effect, table, linearised: Mock(moved=None))
    steps = round(duration)
    courses = np.zeros((steps, 6, 1)), np.ones((sizes, 1))
    monkeypatch.setattr(event_blocks, "_main_courses", lambda moved, unit: courses)
    run = SimpleNamespace(time=np.arange(steps + 1.0), step=1.0)
    linearised = SimpleNamespace(run=run, states=SimpleNamespace(channels=["x"]))
    white = SimpleNamespace(embed=lambda columns: Columned(columns.moved.shape[-1]))
    data_set = Mock(unit=np.ones(3), runs=[SimpleNamespace(linearised=linearised)])
    data_set.at = lambda level: SimpleNamespace(white=[white], base=[Columned(3)])
    data_set.nuisance_sd = lambda scatter, runs: np.ones(2)
    cut = event_blocks.block_columns(data_set, 0, Mock(), np.zeros((sizes, 4)))
    made = event_blocks._blocks(data_set, 0, cut, (0, 0), None)
    assert np.diff(made.edges)[:-1] == approx(block) and made.edges[[0, -1]] == approx([0.0, duration])
    assert made.scales == ((1.0, 1.0) if sizes == 1 else event_blocks.SCALES)


def weighed(monkeypatch, gain: float, likeliest: int) -> str:
    """What is said of the ship where another one is likelier by so much, with one of four errors of coefficients."""
    of_other = np.where(np.arange(len(right_ship.OTHER_SD)) == likeliest, 0.0, -9.0)
    monkeypatch.setattr(right_ship._Accounts, "_unusual", lambda self, j: of_other)
    monkeypatch.setattr(right_ship._Accounts, "gain", lambda self, random=0.0: gain)
    monkeypatch.setattr(right_ship._Accounts, "completed", lambda self: self)
    for course in ("random_force", "receiver_wander"):
        monkeypatch.setattr(right_ship, course, lambda *of_runs: Mock(evidence=-np.inf))
    likelihood = SimpleNamespace(
        data_set=SimpleNamespace(dynamics=CALM, levels=PROCESS_LEVELS, coefficient_prior=CoefficientPrior())
    )
    check = right_ship.right_ship_check(SearchResult(fitted(0.0), [], likelihood), None)
    assert check.passed == (gain <= 7.0)
    return check.text


@pytest.mark.parametrize("likeliest, off", [(0, 20), (1, 50), (2, 100), (3, 200)])
def test_another_ship_has_coefficients_that_are_off_by_a_fifth_half_all_or_twice_themselves(
    monkeypatch, likeliest, off
):
    said = weighed(monkeypatch, 30.0, likeliest)
    assert f"would have to be off by some {off} %, not by 8 % at most as usual" in said


@pytest.mark.parametrize("gain, passed", [(6.9, True), (7.1, False)])
def test_a_ship_is_called_in_question_from_seven_on(monkeypatch, gain, passed):
    assert ("off by no more than usual" in weighed(monkeypatch, gain, 1)) is passed


def test_unusual_coefficients_begin_where_the_levels_of_usual_ones_end():
    assert (
        right_ship.OTHER_SD[0] == COEFFICIENT_SD_LEVELS[-1]
        and right_ship.USUAL_LEVELS == len(COEFFICIENT_SD_LEVELS) - 1
    )
