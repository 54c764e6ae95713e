"""Nothing is said to be missing only after free runs of calm water were looked at, all of them."""

from dataclasses import replace

import numpy as np
import pytest
import strangers
from pytest import approx
from strangers import Stranger, asked, calm_only, of, periodic, strange_runs
from tiers import mainly
from trials import CALM, SHIP

from manoeuvre_nn.api import as_sensed
from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.diagnosis.case import Question, case_of
from manoeuvre_nn.diagnosis.decision import MIN_GAIN_OF_UNKNOWN, decide
from manoeuvre_nn.diagnosis.diagnose import diagnose
from manoeuvre_nn.diagnosis.predictive import calm_check, repaired_check, tail
from manoeuvre_nn.diagnosis.proof import in_held_out_runs
from manoeuvre_nn.diagnosis.result import RIGHT_SHIP
from manoeuvre_nn.diagnosis.search import SearchResult, search
from manoeuvre_nn.diagnosis.unknown import receiver_wander, unknown_evidence
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.effect.rudder import RudderOffset
from manoeuvre_nn.effect.sensors import LogScale, PositionConversion
from manoeuvre_nn.estimation.data_set import WhitenedDataSet, whitened_data_set
from manoeuvre_nn.estimation.hypothesis import Hypothesis
from manoeuvre_nn.estimation.marginal_likelihood import MarginalLikelihood
from manoeuvre_nn.estimation.process_noise import drawn_process
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.recording.noise import add_noise

pytestmark = pytest.mark.usefixtures("unchecked_types")
NAME = "calm water sails these runs"


@pytest.mark.slow
def test_what_acts_in_the_held_out_run_alone_is_a_mismatch_without_a_name():
    """The fitted runs ask for nothing: evidence does not see it."""
    d = diagnose(asked(strange_runs(4, Stranger(1.0, "N", of("v"), runs=(0.0, 0.0, 1.0)))))
    assert (d.verdict, d.unknown) == ("mismatch", True)
    (check,) = [c for c in d.checks if c.name == NAME]
    assert not check.passed and "held" in check.text
    assert next(c.probability for c in d.causes if c.name == "unknown") > 0.5


@pytest.fixture
def short(monkeypatch):
    """Runs of four minutes, which show as much of what is large."""
    monkeypatch.setattr(strangers, "TRIALS", [replace(trial, duration=240.0) for trial in strangers.TRIALS])


@pytest.mark.usefixtures("short")
def test_calm_water_does_not_sail_a_held_out_run_in_which_something_acts():
    turn, _, held_out = strange_runs(4, Stranger(1.0, "N", of("v"), runs=(0.0, 0.0, 1.0)))
    question = asked([turn, held_out])
    check = calm_check(question, calm_only(question))
    assert check.name == NAME and not check.passed and "held" in check.text


@pytest.mark.slow  # five seconds; a random force in yaw is found in test_natures.py
def test_a_random_force_in_surge_and_sway_is_too_much_for_calm_water():
    question = asked(strange_runs(5, random=[(0.2, "X", 60.0), (0.2, "Y", 60.0)]))
    assert not calm_check(question, calm_only(question)).passed


@pytest.mark.slow  # what the model itself sailed, below, passes the same checks
def test_clean_runs_show_the_check_that_they_passed():
    """Coefficients off by 4 % and a small coloured force are calm water."""
    d = diagnose(asked(strange_runs(1)))
    ship, check = d.checks
    assert d.verdict == "none" and check.name == NAME and check.passed and "p = " in check.text
    assert ship.name == RIGHT_SHIP and ship.passed and not d.doubtful


INSTRUMENTS = {"x": 1.0, "y": 1.0, "u": 0.05, "v": 0.05, "psi": 0.002, "r": 2e-4}


@pytest.mark.parametrize("noise", mainly(1, [INSTRUMENTS, {}]))
def test_of_what_the_model_itself_sailed_nothing_is_missing_however_good_the_instruments_are(noise):
    """Exact ones leave errors that are slow and smaller than any noise; velocities that are taken from positions have
    the positions' noise, and say nothing that these do not."""
    turn = turning_circle(20.0, duration=200.0)
    sailed = roll_out(CALM, [zigzag(20.0, duration=200.0), turn, turn])
    runs = [replace(add_noise(run, noise, k), name=f"run {k}") for k, run in enumerate(sailed)]
    case = case_of([as_sensed(run) for run in runs], SHIP, ["run 2"])
    d = diagnose(Question(case, CALM, [RudderOffset(SHIP)]))
    assert d.verdict == "none" and all(check.passed for check in d.checks), [check.text for check in d.checks]
    assert [check.name for check in d.checks] == [RIGHT_SHIP, NAME] and "p = " in d.checks[1].text and not d.doubtful
    assert next(c.probability for c in d.causes if c.name == "unknown") < 0.1
    assert d.model == [] and d.rmse("before") == approx(d.rmse("after"), nan_ok=True)
    assert all(r.windows == [] for r in d.residuals)
    assert "vn" in case.runs[0].derived and np.isnan(d.noise["v"]) and d.noise["psi"] > 0


@pytest.mark.usefixtures("short")
def test_a_repaired_model_must_sail_the_held_out_runs_too():
    """With its offset of the rudder it does; where positions were converted by 2 % too long it misses what it should
    not, although it is better than calm water by far."""
    turn, _, last = strange_runs(3, RudderOffset(SHIP, offset_deg=2.0))
    question = asked([turn, last], [RudderOffset(SHIP)])
    tried = search(whitened_data_set(CALM, question.case.fitted), question.effects)
    stretched = asked([turn, last.with_channels(x=1.02 * last["x"], y=1.02 * last["y"])], question.effects)
    for here, passes in ((question, True), (stretched, False)):
        check = repaired_check(here, tried, tried.fitted[0], in_held_out_runs(here, tried.fitted[0]).hypothesis)
        assert check.passed is passes, check.text
    assert " x of " in check.text or " y of " in check.text


@pytest.mark.slow
def test_positions_that_were_converted_wrongly_are_named_by_how_much():
    """A quarter of a per cent, which speed over ground contradicts."""
    question = asked(strange_runs(3, PositionConversion(SHIP, north=0.24, east=0.24)))
    tried = search(whitened_data_set(CALM, question.case.fitted), [PositionConversion(SHIP), LogScale(SHIP)])
    best = tried.fitted[0]
    assert best.names == ("position_conversion",) and best.evidence > tried.none.evidence + 20
    assert best.hypothesis.vector() == approx([0.24, 0.24, 0.0], abs=0.1)
    there = in_held_out_runs(question, best)
    assert there.evidence > in_held_out_runs(question, tried.none).evidence + 20


def test_the_tail_goes_on_where_draws_end():
    """Of a Pareto law of exponent 4 the rank is right within the draws and the law beyond them."""
    draws = np.random.default_rng(0).pareto(4.0, 20000) + 1
    p = tail(np.array([0.5, 1.05, 2.0, 10.0, 100.0]), draws)
    assert p[:3] == approx([1.0, 1.05**-4.0, 2.0**-4.0], rel=0.05)
    assert np.log(p[3:]) == approx(-4 * np.log([10.0, 100.0]), rel=0.05)


def test_drawn_process_noise_has_its_size_and_its_memory():
    courses = drawn_process(np.random.default_rng(0), np.arange(0.0, 400.0, 2.0), 20.0, (800, 2))
    noise = np.array([1.0, 3.0]) * courses
    assert noise.std(axis=(0, 1)) == approx([1.0, 3.0], rel=0.03)
    assert np.corrcoef(noise[:-10, :, 0].ravel(), noise[10:, :, 0].ravel())[0, 1] == approx(np.exp(-1), abs=0.03)


def positions_alone(wander: float, *acting: Effect) -> Question:
    """Runs of which position, heading and rate of turn were recorded, the position with a slow error of so many m."""
    rng, made = np.random.default_rng(7), []
    trials = [zigzag(20.0, duration=260.0), turning_circle(20.0, duration=260.0), zigzag(10.0, duration=260.0)]
    for k, run in enumerate(roll_out(Vessel(CALM, acting), trials, step=2.0, interval=2.0)):
        noisy = as_sensed(add_noise(run, {"x": 0.5, "y": 0.5, "psi": 0.002, "r": 2e-4}, k))
        x, y = wander * drawn_process(rng, noisy.time, 60.0, (2, 1))[:, :, 0].T
        made.append(noisy.with_channels(x=noisy["x"] + x, y=noisy["y"] + y))
    return Question(case_of(made, SHIP, [made[-1].name]), CALM, [])


@pytest.mark.slow  # the allowance is made in test_looks_and_wanders.py
def test_a_receiver_that_wanders_as_usual_ones_do_is_nothing_unknown():
    """2.5 m in a minute look like a random force; a yaw moment that comes again does not look like a receiver."""
    clean, moved = positions_alone(2.5), positions_alone(0.0, Stranger(0.25, "N", periodic(50.0)))
    for question, wanders in ((clean, True), (moved, False)):
        tried = search(whitened_data_set(CALM, question.case.fitted), [])
        loose = unknown_evidence(tried.likelihood, tried.none, None)
        wandering = receiver_wander(tried.likelihood, tried.none).evidence
        assert loose > tried.none.evidence + MIN_GAIN_OF_UNKNOWN
        assert (wandering > loose + 20) == wanders and (loose > wandering + 20) != wanders
        assert decide(tried).strange != wanders


@pytest.mark.parametrize("size, strange", [(6.0, True), (0.0, False)])
def test_a_force_that_was_taken_for_noise_is_no_receiver_that_wanders(size, strange):
    """A yaw moment that comes again every 41 s, six times that of 20 deg of rudder, in noise four times too large.

    With less noise calm water is likelier, but so is something unknown.
    """
    known = whitened_data_set(CALM, strange_runs(1, *([Stranger(size, "N", periodic(41.0))] if size else []))[:2])
    wide = [replace(run, noise=4.0 * run.noise) for run in known.whole]
    likelihood = MarginalLikelihood(WhitenedDataSet(CALM, wide, known.coefficient_prior))
    tried = SearchResult(likelihood.evaluate(Hypothesis((), ())), [], likelihood)
    assert decide(tried).strange is strange
