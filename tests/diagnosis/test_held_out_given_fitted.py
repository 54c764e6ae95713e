"""Held-out runs are weighed given the fitted ones: coefficients are off by the same in all runs of a ship."""

from collections.abc import Sequence
from functools import cache

import pytest
import torch
from fleet import unchecked
from pytest import approx
from tiers import mainly
from trials import CALM, NOISE, SHIP, run_of

from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.diagnosis.case import Case, Question
from manoeuvre_nn.diagnosis.fits import at_rest, refine, single
from manoeuvre_nn.diagnosis.gusts import gusty_evidence, refined_with_gusts
from manoeuvre_nn.diagnosis.proof import in_held_out_runs
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.effect.rudder import RudderAreaLoss
from manoeuvre_nn.effect.sensors import HeadingBias
from manoeuvre_nn.effect.wind import GustyWind
from manoeuvre_nn.estimation.corrections import Calibrated, Corrections
from manoeuvre_nn.estimation.data_set import WhitenedDataSet, whitened_data_set
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis, Hypothesis
from manoeuvre_nn.estimation.marginal_likelihood import MarginalLikelihood
from manoeuvre_nn.estimation.prior_average import gain_by_coefficient_priors
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag

pytestmark = pytest.mark.usefixtures("unchecked_types")
STEP = 2.0
CALM_WATER = Hypothesis((), ())
TRIALS = [turning_circle(20.0, duration=160.0), zigzag(20.0, duration=160.0)]


def asked(effects: Sequence[Effect] = (), off: float = 0.0) -> Question:
    """One run to fit and one held out, of a ship whose rudder forces are off by a share of theirs."""
    shares = torch.tensor([off * (name in {"Yd", "Nd"}) for name in Corrections(CALM).names]).double()
    with unchecked():
        records = roll_out(Vessel(Calibrated(CALM, shares), list(effects)), TRIALS, step=STEP, interval=STEP)
    runs = tuple(run_of(record, NOISE / STEP**0.5, seed) for seed, record in enumerate(records))
    return Question(Case("trial", "mariner", runs, SHIP, 40.0, frozenset(run.name for run in runs[1:])), CALM, ())


def bayes_factors(question: Question, effect: Effect) -> dict[str, float]:
    """Log Bayes factors of an effect over calm water: fitted runs, held-out ones in two ways, all fitted at once."""

    def rested(runs):
        likelihood = MarginalLikelihood(whitened_data_set(CALM, runs))
        none = likelihood.evaluate(CALM_WATER)
        fit = refined_with_gusts if effect.random else refine
        return [at_rest(likelihood.data_set, single(likelihood, effect, none), fit), at_rest(likelihood.data_set, none)]

    fitted, everywhere = rested(question.case.fitted), rested(question.case.runs)
    found = {}
    for which, pairs in {"fitted": fitted, "all": everywhere}.items():
        acting, calm = (log_evidence(data_set, j) + gain_by_coefficient_priors(data_set, j) for data_set, j in pairs)
        found[which] = acting - calm
    for which, given in {"given": True, "alone": False}.items():
        acting, calm = (in_held_out_runs(question, j, known if given else None).evidence for known, j in fitted)
        found[which] = acting - calm
    return found


def log_evidence(data_set: WhitenedDataSet, fitted: FittedHypothesis) -> float:
    """Of a hypothesis, the course of gusts integrated out."""
    gusts = any(e.random for e in fitted.hypothesis.effects)
    return gusty_evidence(MarginalLikelihood(data_set), fitted.hypothesis, fitted.best[0]) if gusts else fitted.evidence


COMPASS = HeadingBias(SHIP, bias_deg=1.0)
ACTING = [COMPASS, RudderAreaLoss(SHIP, fraction=0.3), GustyWind(SHIP, speed=14.0, from_deg=60.0)]


@cache
def acting(effect: Effect) -> dict[str, float]:
    """Log Bayes factors of an effect that acts."""
    return bayes_factors(asked([effect]), effect)


# A lost area is weighed in both ways below, where it is none.
@pytest.mark.parametrize("effect", mainly(1, ACTING), ids=lambda effect: effect.name)
def test_fitted_runs_and_held_out_ones_given_these_say_together_what_all_runs_say_at_once(effect):
    """``ln p(fitted) + ln p(held-out | fitted) = ln p(all)``, the latter by another way: one data set, one fit."""
    found = acting(effect)
    assert found["all"] > 15 and found["fitted"] + found["given"] == approx(found["all"], rel=0.03, abs=1.0)


def test_what_a_coefficient_is_off_by_is_not_credited_to_an_effect_twice():
    """A rudder of 15 % less force by wrong coefficients, not by area: each half of the runs calls it a loss of area."""
    found = bayes_factors(asked(off=-0.15), RudderAreaLoss(SHIP))
    assert found["alone"] > found["given"] + 2
    assert found["fitted"] + found["given"] == approx(found["all"], abs=1.0)


def test_what_no_coefficient_imitates_is_confirmed_by_runs_that_were_not_used():
    found = acting(COMPASS)
    assert found["given"] > 0.8 * found["alone"] > 5
