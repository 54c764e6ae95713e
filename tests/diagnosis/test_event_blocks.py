"""When events may act: intervals of blocks, what they gain, and the sizes and courses that are tried."""

from itertools import pairwise
from unittest.mock import Mock

import numpy as np
import pytest
from pytest import approx
from scipy.special import logsumexp
from test_claims_put_to_proof import fit, proved, proving
from trials import SHIP

from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.diagnosis import event_blocks, windows
from manoeuvre_nn.diagnosis.windows import replaced, times_of
from manoeuvre_nn.effect.current import Current
from manoeuvre_nn.effect.local import SideForce
from manoeuvre_nn.effect.wind import WindOnset
from manoeuvre_nn.estimation.hypothesis import STOPS, Hypothesis
from manoeuvre_nn.estimation.marginal_likelihood import MarginalLikelihood

EDGES = np.arange(0.0, 101.0, 10.0)


@pytest.mark.parametrize("may_last", [False, True])
def test_times_of_an_event_have_a_flat_prior_and_last_two_blocks(may_last):
    blocks = event_blocks.Blocks(EDGES, np.zeros((1, 10)), np.zeros((1, 10, 10)), (1.0, 1.0))
    gates = blocks.intervals(may_last, 0.0)
    length = np.diff(gates.times, axis=1)[:, 0]
    assert logsumexp(gates.prior) == approx(0.0, abs=1e-12) and length.min() == 20.0
    assert len(gates.times) == 10 * 9 / 2 and np.isinf(length).sum() == (9 if may_last else 0)
    if may_last:
        assert np.exp(logsumexp(gates.prior[np.isfinite(length)])) == approx(STOPS)
    inside = gates.shares[(gates.times == [20.0, 50.0]).all(axis=1)][0]
    assert inside.tolist() == [0, 0, 1, 1, 1, 0, 0, 0, 0, 0]


@pytest.mark.parametrize("ramp", [60.0, 180.0, 420.0])
def test_what_builds_up_for_minutes_begins_and_goes_on(ramp):
    blocks = event_blocks.Blocks(EDGES, np.zeros((1, 10)), np.zeros((1, 10, 10)), (1.0, 1.0))
    gates = blocks.intervals(True, ramp)
    assert np.isinf(gates.times[:, 1]).all()
    (begun,) = gates.shares[gates.times[:, 0] == 50.0]
    assert begun == approx(np.clip((EDGES[:-1] + 5.0 - 50.0) / ramp + 0.5, 0.0, 1.0))


@pytest.mark.parametrize("left_out, courses", [(0.0105, 2), (0.0095, 1)])
def test_courses_of_forces_leave_out_less_than_a_hundredth_of_their_square(left_out, courses):
    """Two of correlation c, unit size each, have mean squares 1 + c and 1 - c: (1 - c) / 2 of all is left out."""
    c = 1 - 2 * left_out
    moved = np.array([[1.0, c], [0.0, np.sqrt(1 - c**2)]])[:, None] * np.array([2.0, 3.0, 4.0])[:, None] / np.sqrt(3.0)
    kept, shares = event_blocks._main_courses(moved, np.array([2.0, 3.0, 4.0]))
    assert kept.shape == (2, 3, courses) and shares.shape == (2, courses)
    assert np.abs(kept @ shares.T - moved).max() < (1e-9 if courses == 2 else 0.4)


def test_the_likelihood_ratio_of_an_event_is_that_of_its_blocks_at_the_likeliest_size():
    """Pull b and square a of all blocks within: s b - s^2 a / 2, s from 0.7 to 1.4; beside others at its own size."""
    right, gram = np.array([[3.0, 1.0, 8.0]]), np.diag([2.0, 2.0, 1.0])[None]
    blocks = event_blocks.Blocks(np.arange(4.0), right, gram, event_blocks.SCALES)
    gates = np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
    ratios = blocks.ratios(0, gates)
    assert ratios == approx([4.0 - 2.0, 1.4 * 8.0 - 0.98, 0.7 - 0.49], abs=1e-6)
    beside = blocks.ratios(0, gates, np.array([0.0, 0.5, 1.0]))
    assert beside == approx([3.0 - 2.0, 7.0 - 0.5, 0.0 - 1.0], abs=1e-6)
    several = event_blocks.Blocks(
        np.arange(4.0), np.vstack([right, -right]), np.vstack([gram, 3 * gram]), event_blocks.SCALES
    )
    assert several.ratios(slice(None), gates) == approx(np.stack([several.ratios(row, gates) for row in (0, 1)]))


SETS = [
    ((), (30.0, 60.0), 1.0, ((30.0, 60.0),)),
    (((70.0, 90.0),), (30.0, 50.0), 1.0, ((30.0, 50.0), (70.0, 90.0))),
    (((10.0, 90.0),), (30.0, 50.0), -1.0, ((10.0, 30.0), (50.0, 90.0))),
    (((10.0, 20.0), (25.0, 90.0)), (30.0, 50.0), -1.0, ((10.0, 20.0), (25.0, 30.0), (50.0, 90.0))),
]


@pytest.mark.parametrize("there, more, sign, after", SETS)
def test_an_interval_is_added_or_cut_out_of_another(there, more, sign, after):
    assert windows._with(there, more, sign) == after


def test_two_intervals_are_two_blocks_apart_and_a_hole_two_from_the_ends():
    times = np.array([[0.0, 20.0], [0.0, 30.0], [60.0, 80.0], [80.0, 100.0], [90.0, 100.0], [50.0, 60.0]])
    gates = event_blocks.Intervals(times, np.zeros((6, 1)), np.zeros(6))
    (sign, beside), (hole_sign, holes) = windows._allowed(gates, ((40.0, 70.0),))
    assert (sign, beside.tolist()) == (1.0, [True, False, False, False, True, False])
    assert hole_sign == -1.0 and not holes.any()
    (_, everywhere), (_, holes) = [
        next(iter(windows._allowed(gates, ()))),
        list(windows._allowed(gates, ((30.0, 100.0),)))[1],
    ]
    assert everywhere.all() and holes.tolist() == [False, False, True, False, False, True]


class Gains:
    """One interval a stretch of a run, each with the log Bayes factor that it adds, whatever there is beside it."""

    def __init__(self, *gains: float) -> None:
        times = np.array([[100.0 * k, 100.0 * k + 40.0] for k in range(len(gains))])
        self.all = event_blocks.Intervals(times, np.eye(len(gains)), np.zeros(len(gains)))
        self.gains, self.edges, self.scales = np.array(gains), np.append(0.0, 1.0), (1.0, 1.0)
        self.right, self.gram = self.gains[None], np.zeros((1, len(gains), len(gains)))

    def intervals(self, may_last: bool, ramp: float) -> event_blocks.Intervals:
        return self.all

    def ratios(self, row: int, shares: np.ndarray, there: np.ndarray | None = None) -> np.ndarray:
        return shares @ self.gains - 1e9 * (shares @ (np.zeros(len(self.gains)) if there is None else there))


@pytest.mark.parametrize("gains, every, count", [
    ((-0.1,), False, 0), ((0.1,), False, 1),  # once is more usual than never, but a run that says nothing has none
    ((9.0, 1.1), False, 1), ((9.0, 1.3), False, 2),  # log(.50 / .15): twice is rarer than once
    ((9.0, 8.0, 1.0), False, 2), ((9.0, 8.0, 1.2), False, 3),  # log(.15 / .05)
    ((0.1,), True, 1), ((-0.1,), True, 0),
])  # fmt: skip
@pytest.mark.usefixtures("unchecked_types")
def test_another_interval_is_worth_its_prior(gains, every, count):
    _, sets = windows._sets_of_times(Gains(*gains), 0, SideForce(SHIP), 0.0, every)
    assert [len(times) for times in sets] == list(range(count + 1))
    assert sets[-1] == tuple((100.0 * k, 100.0 * k + 40.0) for k in range(count))


@pytest.mark.parametrize("other, alike", [
    (((10.0, 40.0),), True), (((24.0, 26.0),), True), (((24.0, 56.0),), False), (((26.0, 40.0),), False), ((), False),
])  # fmt: skip
def test_times_less_than_a_quarter_of_a_minute_apart_lead_to_one_fit(other, alike):
    assert windows._alike(((10.0, 40.0),), other) is alike
    assert windows._alike(((10.0, np.inf),), ((24.0, np.inf),)) and windows._alike((), ())


def blocks(*blocks_on: int, size: float = 1.0, length: float = 10.0) -> event_blocks.Blocks:
    """A run of 30 blocks in which a force of so much acted; what one block does is seen in the next, too."""
    count, acts = 30, np.zeros(30)
    acts[list(blocks_on)] = size
    seen = np.eye(count) + 0.5 * np.eye(count, k=1)
    gram = 40.0 * seen @ seen.T
    return event_blocks.Blocks(length * np.arange(count + 1), (gram @ acts)[None], gram[None], (0.7, 1.4))


@pytest.mark.parametrize("first, second", [((2, 8), (18, 26)), ((4, 10), (12, 20)), ((3, 7), (11, 16))])
def test_two_intervals_are_found_together_where_one_over_both_says_more_than_either(first, second):
    """Times that are no edges of the coarse pairs are found by moving each."""
    run = blocks(*range(*first), *range(*second))
    weight, sets = windows._sets_of_times(run, 0, SideForce(SHIP), 0.0)
    assert sets[2] == tuple((10.0 * start, 10.0 * end) for start, end in (first, second))
    weaker, _ = windows._sets_of_times(blocks(*range(*first), *range(*second), size=0.5), 0, SideForce(SHIP), 0.0)
    acting = run.intervals(False, 0.0).share_of(sets[2])
    assert weight == approx(float(0.5 * acting @ run.gram[0] @ acting), rel=0.15) and weaker < 0.5 * weight


@pytest.mark.parametrize("on", [(3, 4, 5, 7, 8, 9), (*range(4, 12), *range(13, 20), *range(21, 27))])
def test_pieces_of_an_interval_in_a_long_run_are_as_long_as_any(on):
    """Blocks of 25 s: a hole of one is none, and a piece of one would not be among the intervals."""
    run = blocks(*on, length=25.0)
    _, sets = windows._sets_of_times(run, 0, SideForce(SHIP), 0.0)
    known = {tuple(times) for times in run.intervals(False, 0.0).times.tolist()}
    assert len(sets) > 1 and all(set(times) <= known for times in sets)
    assert all(later[0] - sooner[1] >= 50.0 for times in sets for sooner, later in pairwise(times))


def test_sizes_of_an_event_are_tried_by_factors_of_two_up_to_what_is_possible():
    (force,) = [p for p in SideForce.declared if p.name == "force_kN"]
    grid = np.unique(windows._grid(SideForce(SHIP))[:, SideForce.declared.index(force)])
    sizes = grid[grid > 0]
    starts = np.abs(force.starts)
    assert sizes[0] == approx(starts.min() / 4) and sizes[-1] == approx(force.high)
    assert (sizes[1:] / sizes[:-1] < 2.2).all() and (sizes[1:-1] / sizes[:-2] > 1.8).all()
    assert not np.isinf(windows._grid(WindOnset(SHIP))[:, 0]).any()


def test_main_courses_leave_out_a_hundredth_of_the_squared_forces():
    """Two courses alike but for a share of e have eigenvalues 2 - e^2/2 and e^2/2 of 2."""
    for e, kept in ((0.19, 1), (0.21, 2)):
        base, other = np.zeros((2, 400))
        base[0], other[1] = 1.0, 1.0
        second = np.sqrt(1 - e**2 + e**4 / 4) * base + e * np.sqrt(1 - e**2 / 4) * other  # correlation 1 - e^2/2
        moved = np.zeros((400, 6, 2))
        moved[:, 1, 0], moved[:, 1, 1] = base, second
        courses, shares = event_blocks._main_courses(moved, np.ones(3))
        assert courses.shape[-1] == kept
        assert kept == 1 or courses @ shares.T == approx(moved)


@pytest.mark.parametrize("deficit, tried", [(19.0, True), (21.0, False)])
def test_times_that_explain_far_less_before_they_are_fitted_are_not_fitted(monkeypatch, deficit, tried):
    force = SideForce(SHIP, force_kN=300.0, start_s=50.0, end_s=150.0)
    there, fits = Hypothesis((force,), (force.values.numpy()[None],)), []
    score = {50.0: 0.0, 250.0: -deficit}
    monkeypatch.setattr(windows, "block_columns", lambda *_: None)
    monkeypatch.setattr(windows, "in_blocks", lambda *_: [None])
    monkeypatch.setattr(windows, "_sets_of_times", lambda *_, every: (0.0, [(), ((250.0, 300.0),)]))
    monkeypatch.setattr(windows, "_score", lambda _, h, *at: score[times_of(force, h.values[0][0])[0][0]])
    likelihood = Mock(spec=MarginalLikelihood, data_set=None, improve=lambda h, *at, rounds: fits.append(h) or (h, 0.0))
    assert replaced(likelihood, there, 0, 0) is there and bool(fits) is tried


@pytest.mark.parametrize("start, end, acts", [
    (50.0, 150.0, True), (50.0, np.inf, True), (np.inf, np.inf, False), (150.0, 50.0, False), (400.0, np.inf, False)
])  # fmt: skip
def test_an_event_that_has_no_time_in_any_run_or_none_before_it_ends_acts_in_none(start, end, acts):
    force, current = SideForce(SHIP, start_s=start, end_s=end), Current(SHIP)
    values = tuple(np.tile(e.values.numpy(), (2, 1)) for e in (force, current))
    values[0][1, force.timed] = np.inf
    runs = [Mock(spec=Recording, time=np.array([0.0, 300.0]))] * 2
    assert windows.acting(Hypothesis((force, current), values), runs) == [acts, True]


@pytest.mark.usefixtures("unchecked_types")
def test_what_acts_nowhere_about_its_own_states_is_taken_from_a_claim(monkeypatch):
    """An event of seconds may end before it begins once its times are averaged."""
    left = fit(120.0, "current")
    left.corrections = np.ones(1)
    monkeypatch.setattr(proving, "acting", lambda h, runs: [False, True] if h.effects else [True])
    monkeypatch.setattr(proving, "MarginalLikelihood", lambda data_set: data_set)
    monkeypatch.setattr(proving, "refine", lambda likelihood, h, *best: left)
    gains = {("current",): 20.0, ("current", "log_scale"): 20.0}
    chosen, _, _ = proved(monkeypatch, [fit(130.0, "current", "log_scale")], gains, {})
    assert chosen.names == ("current",)
