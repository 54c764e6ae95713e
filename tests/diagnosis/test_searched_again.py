"""A ship with other coefficients leads: the search is made again with those as they usually are."""

from dataclasses import replace

import numpy as np
import pytest
from pytest import approx
from scipy.special import logsumexp
from searches import fitted, found
from strangers import strange_runs
from test_hypotheses_judged import hypothesis, stand
from trials import CALM, SHIP

from manoeuvre_nn.diagnosis import settled as under_test
from manoeuvre_nn.diagnosis.search import SearchResult
from manoeuvre_nn.effect.wind import SteadyWind
from manoeuvre_nn.estimation.data_set import COEFFICIENT_SD_LEVELS, whitened_data_set
from manoeuvre_nn.estimation.hypothesis import Hypothesis
from manoeuvre_nn.estimation.marginal_likelihood import (
    PROCESS_PRIOR,
    USUAL_LEVELS,
    MarginalLikelihood,
    log_prior_levels,
)
from manoeuvre_nn.estimation.prior_average import with_likely_coefficient_prior

pytestmark = pytest.mark.usefixtures("unchecked_types")
OTHER_SHIP, THIS_SHIP = (0, USUAL_LEVELS), (0, USUAL_LEVELS - 1)


@pytest.fixture
def searched(monkeypatch):
    """What is taken, and what coefficients each search had, where it ends with any and with usual ones like this."""

    def run(whole: SearchResult, usual: SearchResult | None = None, of_fit: bool = False) -> tuple[SearchResult, list]:
        asked = []

        def search(data_set, effects, progress, workers, known=None):
            asked.append(data_set.coefficient_prior)
            assert (known is not None) == data_set.coefficient_prior.usual
            return usual if data_set.coefficient_prior.usual else whole

        monkeypatch.setattr(under_test, "search", search)
        monkeypatch.setattr(under_test, "settled", lambda result, workers: result)
        monkeypatch.setattr(under_test, "_with_any_coefficients", lambda result: result)
        monkeypatch.setattr(under_test, "by_any_coefficient_prior", lambda result: result)
        monkeypatch.setattr(under_test, "is_fitted", lambda dynamics: of_fit)
        return under_test.searched(stand("nothing"), []), [prior.usual for prior in asked]

    return run


def test_hypotheses_are_weighed_with_any_coefficients_before_they_settle(monkeypatch):
    """What led by a linearisation about other states lost nothing where it was weighed after the others had rested."""
    done, end = [], found(fitted(20.0, "current", best=OTHER_SHIP))
    steps = {
        "search": lambda data_set, *_: end,
        "by_any_coefficient_prior": lambda result: result,
        "settled": lambda result, workers: result,
        "_with_any_coefficients": lambda result: result,
    }
    for name, step in steps.items():
        noted = lambda *given, name=name, step=step: (done.append(name), step(*given))[1]  # noqa: E731
        monkeypatch.setattr(under_test, name, noted)
    monkeypatch.setattr(under_test, "is_fitted", lambda dynamics: False)
    under_test.searched(stand("nothing"), [])
    first, again = ["search", "by_any_coefficient_prior", "settled"], ["search", "settled", "_with_any_coefficients"]
    assert done == [*first, *again, "by_any_coefficient_prior"]


@pytest.mark.parametrize("calm_gain, better", [(4.0, True), (2.0, False)])
def test_two_searches_are_compared_by_evidence_with_any_prior_of_coefficients(searched, calm_gain, better):
    """All of a search is weighed by what it gains beyond calm water: that is another number in each."""
    whole = replace(found(fitted(20.0, "current", best=OTHER_SHIP)), calm_gain=3.0)
    other = replace(found(fitted(20.0, "current", best=THIS_SHIP)), calm_gain=calm_gain)
    assert searched(whole, other)[0] is (other if better else whole)


def test_coefficients_as_usual_need_one_search(searched):
    whole = found(fitted(20.0, "current", best=THIS_SHIP), fitted(9.0, "log_scale", best=OTHER_SHIP))
    assert searched(whole) == (whole, [False])


def test_a_fitted_model_has_no_usual_coefficients(searched):
    whole = found(fitted(20.0, "current", best=OTHER_SHIP))
    assert searched(whole, of_fit=True) == (whole, [False])


@pytest.mark.parametrize("usual, better", [(21.0, True), (19.0, False)])
def test_the_likelier_of_two_searches_is_taken(searched, usual, better):
    whole = found(fitted(20.0, "current", best=OTHER_SHIP))
    other = found(fitted(usual, "current", best=THIS_SHIP))
    assert searched(whole, other) == (other if better else whole, [False, True])


@pytest.mark.parametrize("gain, better", [(2.4, True), (1.6, False)])
def test_what_has_more_effects_must_be_so_much_likelier_as_it_is_rarer(searched, gain, better):
    """Of four effects: .1 / 6 for each pair, .53 / 4 for each alone; ln 7.95 = 2.07."""
    alone = fitted(20.0, "current", best=OTHER_SHIP), *(fitted(0.0, n) for n in ("log_scale", "heading_bias"))
    whole = found(*alone, fitted(0.0, "rudder_offset"))
    both = fitted(20.0 + gain, "current", "log_scale", best=THIS_SHIP)
    other = found(both, fitted(0.0, "heading_bias"), fitted(0.0, "rudder_offset"))
    assert searched(whole, other)[0] is (other if better else whole)


def test_calm_water_with_other_coefficients_leads_too(searched):
    def calm(evidence: float, best) -> SearchResult:
        return SearchResult(fitted(evidence, best=best), [fitted(evidence - 9.0, "current")], None)

    whole, other = calm(0.0, OTHER_SHIP), calm(-3.0, THIS_SHIP)
    assert searched(whole, other) == (whole, [False, True])
    assert searched(calm(0.0, THIS_SHIP))[1] == [False]


def test_coefficients_as_usual_are_off_by_no_more_than_twice_their_usual_scatter():
    whole = stand("nothing")
    usual = whole.with_prior(whole.coefficient_prior._replace(usual=True))
    some, every = log_prior_levels(usual, PROCESS_PRIOR), log_prior_levels(whole, PROCESS_PRIOR)
    assert (some[:, USUAL_LEVELS:] == -np.inf).all() and logsumexp(some) == approx(0.0, abs=1e-12)
    assert COEFFICIENT_SD_LEVELS[USUAL_LEVELS - 1] == 0.08
    assert np.ptp(some[:, :USUAL_LEVELS] - every[:, :USUAL_LEVELS]) == approx(0.0, abs=1e-12)
    assert not whole.coefficient_prior.usual


def test_the_likeliest_prior_of_coefficients_as_usual_has_them_as_usual():
    whole = stand("wind")
    usual = whole.with_prior(whole.coefficient_prior._replace(usual=True))
    none = MarginalLikelihood(usual).evaluate(Hypothesis((), ()))
    assert with_likely_coefficient_prior(usual, none).coefficient_prior.usual
    assert not with_likely_coefficient_prior(whole, none).coefficient_prior.usual


def test_what_was_found_with_coefficients_as_usual_is_weighed_with_any():
    """A second route: the same evaluated with any coefficients; these are off by 30 %."""
    whole = whitened_data_set(CALM, strange_runs(4, scatter=0.3)[:2])
    usual = whole.with_prior(whole.coefficient_prior._replace(usual=True))
    calm, wind = Hypothesis((), ()), hypothesis(SteadyWind(SHIP, speed=12.0, from_deg=80.0))
    there, here = MarginalLikelihood(usual), MarginalLikelihood(whole)
    made = SearchResult(there.evaluate(calm), [there.evaluate(wind)], there, smoothed=(there, there.evaluate(calm)))
    again = under_test._with_any_coefficients(made)
    for one, h in ((again.none, calm), (again.fitted[0], wind)):
        expected = here.evaluate(h)
        assert one.evidence == approx(expected.evidence, abs=0.1) and one.best == expected.best
        assert one.best[1] == USUAL_LEVELS > made.none.best[1], "or nothing was asked"
    assert again.none.evidence > made.none.evidence + 5
    assert not any(one.data_set.coefficient_prior.usual for one in (again.likelihood, again.smoothed[0]))
