"""Free runs and the missing force: which parts, which draws, which sides and which wanders of a receiver count."""

from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pandas as pd
import pytest
from pytest import approx
from searches import EFFECTS, fitted, found

from manoeuvre_nn.diagnosis import locate, predictive, unknown
from manoeuvre_nn.diagnosis.result import Check, Residual
from manoeuvre_nn.diagnosis.unknown import ReceiverWander
from manoeuvre_nn.estimation.process_noise import ProcessLevels

pytestmark = pytest.mark.usefixtures("unchecked_types")


# Free runs -----------------------------------------------------------------------------------------------------------


NOTHING_RECORDED = pd.DataFrame({c: np.full(300, np.nan) for c in ("x", "y", "psi", "u", "v", "r", "u_log")})


def looks(monkeypatch, derived=(), wander=None, **recorded) -> dict[str, float]:
    """How large the error of a channel is in a whole run of thirty ship lengths, and in its worst part; draws are off
    by one, and a ship length takes 10 s."""
    seen = []
    monkeypatch.setattr(predictive, "recorded", lambda run, warmup: NOTHING_RECORDED.assign(**recorded))
    monkeypatch.setattr(predictive, "rarest", lambda sizes: (seen.append(sizes), (1.0, 0))[1])
    question = Mock(case=Mock(warmup=0.0, proof=()), dynamics=Mock(particulars=Mock(time_unit=10.0)))
    run = Mock(step=1.0, derived=derived, time=np.arange(-40.0, 300.0))  # the warm-up before
    run.name = "zigzag"
    free = np.zeros((9, 300, 7))
    free[1:] = np.array([1.0, -1.0] * 4)[:, None, None]
    predictive.surprise(question, [run], [Mock(noise=np.zeros(8))], [free], wander)
    return dict(zip(("whole", "worst part"), seen[0][:, 0], strict=True))


def test_an_error_that_lasts_three_ship_lengths_is_not_averaged_away_in_a_run_of_thirty(monkeypatch):
    """A part is as long as it; were parts longer or shorter, none but a longer error would fill one."""
    second, last = np.zeros(300), np.zeros(300)
    second[30:60], last[270:] = 4.0, 4.0
    for log in (second, last):
        assert looks(monkeypatch, u_log=log) == approx({"whole": 4.0 * 0.1**0.5, "worst part": 4.0})


def test_an_error_that_comes_and_goes_within_half_a_ship_length_is_averaged_away(monkeypatch):
    fast, slow = np.tile([2.0, 2.0, 0.0, -2.0, -2.0], 60), np.tile(np.repeat([2.0, -2.0], 5), 30)
    assert looks(monkeypatch, u_log=fast) == approx({"whole": 0.0, "worst part": 0.0}, abs=1e-9)
    assert looks(monkeypatch, u_log=slow) == approx({"whole": 2.0, "worst part": 2.0})


def test_a_receiver_that_wanders_makes_an_error_of_positions_less_rare(monkeypatch):
    """By the same draws of everything else; the headings stay."""
    monkeypatch.setattr(predictive, "drawn_process", lambda rng, time, memory, shape: np.full((len(time), *shape), 3.0))
    astray, still = ({"x": np.full(300, 2.0)} for _ in range(2))
    alone = looks(monkeypatch, **still)["whole"]
    assert looks(monkeypatch, (), ReceiverWander(1.0, 9.0, 60.0), **astray)["whole"] < alone


def test_a_velocity_that_was_taken_from_positions_is_not_looked_at(monkeypatch):
    log, sway = np.full(300, 2.0), np.full(300, 9.0)
    assert looks(monkeypatch, ("vn", "ve"), u_log=log, v=sway) == approx({"whole": 2.0, "worst part": 2.0})
    with pytest.raises(ValueError, match="zip"):  # four looks
        looks(monkeypatch, (), u_log=log, v=sway)


def test_within_four_fifths_of_the_draws_a_probability_is_a_rank_and_beyond_them_hills_tail():
    draws = np.arange(1.0, 101.0)
    rank, beyond = predictive.tail(np.array([79.5, 80.5]), draws)
    index = np.log(np.arange(81.0, 101.0) / 80.0).mean()  # of the twenty largest over the next
    assert rank == approx(22 / 101) and beyond == approx(0.2 * (80.5 / 80.0) ** (-1 / index))


@pytest.mark.parametrize("p, wandering, passed", [
    (0.004, -1.0, False), (0.005, -1.0, False), (0.006, -1.0, True), (0.004, 1.0, True), (0.005, 1.0, True),
    (0.0001, 1.0, False),
])  # fmt: skip
def test_the_repaired_model_fails_the_held_out_runs_at_one_half_per_cent_a_receiver_may_wander(
    monkeypatch, p, wandering, passed
):
    """Where the fitted runs are likelier with a receiver that wanders, what it may do is no fault of the model."""
    slow = ReceiverWander(2.0, 60.0, wandering)
    monkeypatch.setattr(predictive, "is_fitted", lambda dynamics: True)
    monkeypatch.setattr(predictive, "known_of", lambda data_set, chosen: None)
    monkeypatch.setattr(predictive, "drawn_tables", lambda *_: [])
    monkeypatch.setattr(predictive, "beside", lambda likelihood, hypothesis: likelihood)
    monkeypatch.setattr(predictive, "receiver_wander", lambda likelihood, fitted: slow)
    said = {(): (p, "psi of held-out", 3.0), (slow,): (40 * p, "psi of held-out", 2.0)}
    monkeypatch.setattr(predictive, "surprise", lambda question, runs, prepared, free, *wander: said[wander])
    question = Mock(held_out=Mock(data_set=Mock(runs=[])))
    check = predictive.repaired_check(question, Mock(), fitted(0.0, "current"), Mock())
    assert check.passed is passed and f"by {3.0 if wandering < 0 or p > 0.005 else 2.0} times" in check.text
    others = [Check("little is left", False, "much is left: 9 %"), check]
    said_so = "" if passed else check.text.partition(": p")[0]
    assert predictive.still_missing(others) == said_so


# A receiver that wanders ---------------------------------------------------------------------------------------------


def wandered(monkeypatch, duration=1000.0, samples=1000, fitted_model=False, present=True):
    """Which shares of white noise, spacings of knots, times and sizes are tried; the evidence that comes out."""
    tried, now = [], {}
    monkeypatch.setattr(unknown, "is_fitted", lambda dynamics: fitted_model)
    monkeypatch.setattr(unknown, "log_prior_levels", lambda data_set, scale: np.zeros((1, 1)))

    def other_noise(data_set, base, level, share):
        now["share"] = share
        return [(None, None)], 0.0

    def course(embedded, white, prepared, spacing, time):
        now.update(spacing=spacing, time=time)
        return (None, None, None)

    def without(base, own, cross, size):
        tried.append((now["share"], now["spacing"], now["time"], size))
        return 0.0, 0.0

    monkeypatch.setattr(unknown, "_with_other_noise", other_noise)
    monkeypatch.setattr(unknown, "_wander", course)
    monkeypatch.setattr(unknown, "without_course", without)
    monkeypatch.setattr(unknown, "summed", lambda *_: None)
    measured = np.broadcast_to(np.zeros(()), (samples, 8, 1))
    shown = np.zeros((samples, 8), dtype=bool)
    shown[:, 1] = present
    run = SimpleNamespace(
        linearised=SimpleNamespace(run=SimpleNamespace(duration=duration), present=shown),
        base=SimpleNamespace(measured=measured),
    )
    data_set = Mock(runs=[run], size=1, levels=ProcessLevels((0.01,)))
    likelihood = Mock(data_set=data_set, regress=lambda gram, norm: Mock(evidence=np.array([5.0])))
    return tried, unknown.receiver_wander(likelihood, fitted(0.0)).evidence


def test_a_receiver_is_tried_with_wanders_of_one_two_and_three_metres_over_half_a_minute_to_five(monkeypatch):
    """Of the noise of positions all, a half or a quarter is white; every combination is as likely before."""
    tried, evidence = wandered(monkeypatch)
    assert len(set(tried)) == 27 and evidence == approx(5.0)
    shares, spacings, times, sizes = (sorted(set(column)) for column in zip(*tried, strict=True))
    assert sizes == approx([1.0, 2.0, 3.3], rel=0.03) and times == approx([30.0, 100.0, 300.0])
    assert shares == [0.25, 0.5, 1.0] and spacings == [10.0]


@pytest.mark.parametrize("duration, spacing", [(5000.0, 10.0), (10_000.0, 20.0), (15_000.0, 30.0), (15_001.0, None)])
def test_a_wander_has_a_knot_every_ten_seconds_five_hundred_at_most_and_none_further_than_thirty_apart(
    monkeypatch, duration, spacing
):
    tried, evidence = wandered(monkeypatch, duration, samples=1)
    assert {one[1] for one in tried} == ({spacing} if spacing else set())
    assert np.isfinite(evidence) == bool(spacing)


@pytest.mark.parametrize("megabytes, asked", [(239.9, True), (240.0, True), (240.1, False)])
def test_a_wander_takes_no_more_than_240_megabytes(monkeypatch, megabytes, asked):
    """A number for every channel, sample and knot, north and east: here 8 channels and 100 knots."""
    samples = round(megabytes * 1e6 / 8 / (8 * 2 * 100))
    assert bool(wandered(monkeypatch, 1000.0, samples)[0]) is asked


@pytest.mark.parametrize("how", [{"fitted_model": True}, {"present": False}])
def test_no_wander_is_tried_of_a_fitted_model_or_without_positions(monkeypatch, how):
    assert wandered(monkeypatch, **how) == ([], -np.inf)


# The missing force ---------------------------------------------------------------------------------------------------


def noisy(count: int) -> np.ndarray:
    return 0.3 * np.random.default_rng(2).standard_normal((count, 3))


def test_a_force_that_is_missing_until_the_recording_ends_is_missing_until_its_last_sample():
    force = noisy(120)
    force[80:, 1] += 9.0
    assert locate.changes(np.arange(120.0), force, np.ones((120, 3))) == [(80.0, 119.0)]


def test_a_force_that_is_missing_throughout_has_no_times_whichever_way_it_pushes():
    force = noisy(240)
    force[:120, 1], force[120:, 1] = force[:120, 1] - 9.0, force[120:, 1] + 9.0
    assert locate.changes(np.arange(240.0), force, np.ones((240, 3))) == []


def test_a_site_is_as_likely_as_the_best_single_effect_there_and_equations_as_noise_in_them():
    singles = {name: gain for gain, name in enumerate(("current", "rudder_offset", "heading_bias", "log_scale"), 30)}
    tried = found(fitted(90.0, "current", "log_scale"), *(fitted(g - 3.0, n) for n, g in singles.items()), none=-3.0)
    levels = ProcessLevels((0.001, 0.01, 0.1, 1.0))
    tried.likelihood.data_set.levels = levels
    at = {levels.point(2, 0): 7.0, levels.point(0, 2): 9.0}
    tried.likelihood.evidence_at = lambda hypothesis, point: at[point]
    expected = {"surge": 10.0, "sway and yaw": 12.0}
    for name, gain in singles.items():
        site = EFFECTS[name].site
        expected[site] = max(gain, expected.get(site, 0.0))
    assert locate.sites(tried) == approx(expected)


@pytest.mark.parametrize("port, starboard, told", [(10, 10, True), (9, 10, False), (10, 9, False)])
def test_sides_are_told_apart_by_ten_samples_of_turns_to_each(port, starboard, told):
    r = np.concatenate([np.zeros(50), np.full(port, -0.02), np.full(starboard, 0.02)])
    track, flat = np.zeros((len(r), 6)), np.zeros((len(r), 3))
    track[:, 2] = r
    run = SimpleNamespace(linearised=SimpleNamespace(track=track, run={"delta": 0.3 * r}))
    force = flat + np.where(r < 0, 1.0, 2.0)[:, None]
    shape = locate.shape_of(
        SimpleNamespace(runs=[run]), [Residual("r", np.arange(1.0 * len(r)), force, flat + 1.0, force, [])]
    )
    assert shape.sides == ((1.0, 2.0) if told else ())
