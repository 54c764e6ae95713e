"""What the search decides between its fits: about which states, from which noise levels, which gusts, what suffices."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from searches import fitted as by_hand
from trials import SHIP, values

from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.diagnosis import fits, partners
from manoeuvre_nn.diagnosis import search as under_test
from manoeuvre_nn.diagnosis.fits import PUBLISHED_SD_LEVEL, single
from manoeuvre_nn.diagnosis.search import search
from manoeuvre_nn.effect.current import Current
from manoeuvre_nn.effect.depth import ShallowWater
from manoeuvre_nn.effect.local import SideForce
from manoeuvre_nn.effect.rudder import RudderBacklash
from manoeuvre_nn.effect.sensors import HeadingBias, LeverArm, LogScale, RateBias
from manoeuvre_nn.effect.wind import GustyWind, SteadyWind
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis, Hypothesis
from manoeuvre_nn.estimation.marginal_likelihood import USUAL_LEVELS
from manoeuvre_nn.estimation.process_noise import PROCESS_LEVELS

pytestmark = pytest.mark.usefixtures("unchecked_types")
EFFECTS = [Current(SHIP), SteadyWind(SHIP), LogScale(SHIP), GustyWind(SHIP)]


def fit(evidence: float, *names: str) -> SimpleNamespace:
    """A fitted hypothesis of these effects."""
    return SimpleNamespace(evidence=evidence, names=names, best=(4, 3), hypothesis=Hypothesis((), ()), random={})


def searched(
    monkeypatch, alone: dict[str, float], more: list[SimpleNamespace], published: tuple[str, ...] = (), known=None
) -> tuple[list, list, list]:
    """About what a search linearises again, for what it tries gusts, what it builds upon: fits leave this evidence."""
    calm, about, windy, built_upon = fit(0.0), [], [], []
    dynamics = SimpleNamespace(particulars=SimpleNamespace(is_model=False))
    kept = SimpleNamespace(dynamics=dynamics, release=lambda: None)
    likelihood = SimpleNamespace(data_set=kept, evaluate=lambda hypothesis, around=None: calm)

    def again(so_far, leads, workers):
        about.append(leads.names)
        return so_far

    def gusts(likelihood, steady, variant):
        windy.append(steady.names)
        return fit(-9.0, variant.name)

    monkeypatch.setattr(under_test, "MarginalLikelihood", lambda data_set: likelihood)
    monkeypatch.setattr(under_test, "with_likely_coefficient_prior", lambda data_set, fitted: data_set)
    monkeypatch.setattr(under_test, "single", lambda likelihood, e, none: fit(alone.get(e.name, -5.0), e.name))
    monkeypatch.setattr(under_test, "_again", again)
    monkeypatch.setattr(under_test, "at_rest", lambda data_set, j: (data_set, j))
    beside = [fit(-20.0, name) for name in published]
    monkeypatch.setattr(under_test, "_beside_published", lambda none, singles: beside)

    def extended(likelihood, leading, *_):
        built_upon.append([j.names for j in leading])
        return [j for j in more if any(len(j.names) == len(first.names) + 1 for first in leading)]

    monkeypatch.setattr(under_test, "extended", extended)
    monkeypatch.setattr(under_test, "fitted_gusts", gusts)
    search(kept, EFFECTS, known=known)
    return about, windy, built_upon


@pytest.mark.parametrize("worse, built_upon", [(1, []), (2, ["wind", "log"])])
def test_pairs_are_built_upon_the_best_beside_published_coefficients_where_calm_water_needs_worse_ones(
    worse, built_upon
):
    """Two strong effects: coefficients that are off by 20 % explain them better than either alone."""

    def fitted(published: float, anything: float, name: str) -> FittedHypothesis:
        by_level = np.array([[published] * (PUBLISHED_SD_LEVEL + 1) + [anything] * 3])
        effect = SimpleNamespace(name=name)
        return FittedHypothesis(Hypothesis((effect,), (np.zeros((1, 0)),)), anything, by_level, np.zeros((0, 0)))

    none = replace(fitted(-300.0, 0.0, ""), best=(6, PUBLISHED_SD_LEVEL + worse))
    found = under_test._beside_published(none, [fitted(-200.0, -4.0, "log"), fitted(-100.0, -9.0, "wind")])
    assert [j.names[0] for j in found] == built_upon
    assert all(j.best == (PROCESS_LEVELS.quiet(6), PUBLISHED_SD_LEVEL) for j in found)


@pytest.mark.parametrize("anew, plays", [(True, [30.0]), (False, [])])
def test_the_right_partner_is_fitted_beside_published_coefficients_though_any_explains_more_beside_worse_ones(
    monkeypatch, anew, plays
):
    """Where calm water is far off, from a play that it is tried with anew: alone it was fitted to another error."""

    def alone(effect: Effect, scatter: int) -> FittedHypothesis:
        row = effect.values.numpy()[None]
        return FittedHypothesis(
            Hypothesis((effect,), (row,)), 0.0, np.zeros((1, 1)), np.zeros((0, 0)), best=(6, scatter)
        )

    def explained(first: Hypothesis, partner: Hypothesis, level: int, scatter: int) -> float:
        play = partner.values[0][0, 0] if partner.names == ("rudder_backlash",) else 0.0
        return 0.0 if scatter > PUBLISHED_SD_LEVEL else -1000.0 + play

    fitted = []
    monkeypatch.setattr(
        partners, "refine", lambda likelihood, h, level, scatter: fitted.append((h, scatter)) or alone(EFFECTS[0], 0)
    )
    kinds = (Current, SteadyWind, ShallowWater, LeverArm, RateBias, HeadingBias)
    singles = [alone(kind(SHIP), 5) for kind in kinds] + [alone(RudderBacklash(SHIP, width_deg=0.0), 5)]
    leading = [alone(LogScale(SHIP), scatter) for scatter in (5, PUBLISHED_SD_LEVEL)]
    list(partners.extended(SimpleNamespace(pair_evidence=explained), leading, singles, anew, lambda _: None, 1))
    assert [scatter for _, scatter in fitted] == 5 * [5] + 5 * [PUBLISHED_SD_LEVEL]
    assert [h.values[1][0, 0] for h, _ in fitted[5:] if h.names[1] == "rudder_backlash"] == plays


@pytest.mark.parametrize("gain, pair_leads", [(12.5, True), (11.5, False)])
def test_a_pair_that_gains_much_is_what_runs_are_linearised_about_again(monkeypatch, gain, pair_leads):
    pair = fit(40.0 + gain, "current", "log_scale")
    about, _, _ = searched(monkeypatch, {"current": 40.0, "log_scale": 8.0}, [pair])
    assert about == [("current",), *([("current", "log_scale")] if pair_leads else [])]


def test_what_leads_is_fitted_without_each_of_its_effects_again_where_it_was_linearised_again(monkeypatch):
    """There an event may have found the times that it missed alone, and need its partner no more."""
    # Of the effects alone, of the pairs, of these about their states.
    left = iter([[], [], [lambda: fit(90.0, "current")]])
    monkeypatch.setattr(under_test, "_without_each", lambda likelihood, fitted: next(left, []))
    pairs = [fit(80.0, "current", "log_scale"), fit(70.0, "current", "wind_steady")]
    _, _, built_upon = searched(monkeypatch, {"current": 40.0, "log_scale": 8.0}, pairs)
    assert built_upon[1] == [], "no pair adds to it"


@pytest.mark.parametrize("gain, about", [(11.5, ()), (12.5, ("current",))])
def test_below_twelve_runs_are_linearised_about_calm_water(monkeypatch, gain, about):
    assert searched(monkeypatch, {"current": gain}, [])[0] == [about]


@pytest.mark.parametrize("gain, built_upon", [(2.8, []), (3.2, [("log_scale",)])])
def test_effects_are_combined_that_alone_gain_three_and_none_has_more_than_three(monkeypatch, gain, built_upon):
    names = ("current", "log_scale", "wind_steady", "rudder_offset")
    more = [fit(40.0 + 7.0 * k, *names[:k]) for k in (2, 3, 4)]
    _, _, leading = searched(monkeypatch, {"current": 40.0, "log_scale": gain}, more)
    assert leading == [[("current",), *built_upon], [names[:2]]], "pairs of the first, triples of the pair"


def test_pairs_are_built_upon_effects_that_do_well_with_published_coefficients_too(monkeypatch):
    _, _, leading = searched(monkeypatch, {"current": 40.0}, [], published=("rudder_offset",))
    assert leading[0] == [("current",), ("rudder_offset",)]


@pytest.mark.parametrize("scatter, begun_at", [(5, USUAL_LEVELS - 1), (2, 2)])
@pytest.mark.parametrize("known, place", [(("rudder_offset",), 1), (("current", "rudder_offset"), 2)])
def test_what_led_among_any_coefficients_is_built_upon_by_itself_among_usual_ones(
    monkeypatch, known, place, scatter, begun_at
):
    """A slow rudder beside another displacement: with usual coefficients the one alone does worse than others do."""
    begun = []
    monkeypatch.setattr(under_test, "refine", lambda there, h, *best: begun.append(best) or fit(-30.0, *known))
    led = SimpleNamespace(**{**vars(fit(90.0, *known)), "best": (4, scatter)})
    more = [fit(80.0, "current", "log_scale")]
    _, _, leading = searched(monkeypatch, {"current": 40.0}, more, known=led)
    assert leading.pop(place) == [known] and begun == [(4, begun_at)]
    assert leading[:2] == [[("current",)], [("current", "log_scale")]], "beside the others, each for themselves"


@pytest.mark.parametrize("gain, fits_made", [(11.5, 1), (12.5, 2)])
def test_where_calm_water_is_far_off_effects_are_fitted_about_both_states_and_weighed_about_their_own(
    monkeypatch, gain, fits_made
):
    """An effect behind all others about the first states leads about its own; what is worse there stays as it was."""
    asked, own = [], {"current": 5.0, "log_scale": 70.0, "wind_steady": 1.0}
    searched(monkeypatch, {}, [])
    singles = {"current": 20.0, "log_scale": 15.0, "wind_steady": 18.0}
    monkeypatch.setattr(
        under_test, "single", lambda likelihood, e, none: asked.append(e.name) or fit(singles[e.name], e.name)
    )
    monkeypatch.setattr(under_test, "at_rest", lambda kept, j: (kept, fit(gain)))
    monkeypatch.setattr(under_test, "fitted_at_rest", lambda kept, j: fit(own[j.names[0]], *j.names))
    about = []
    monkeypatch.setattr(under_test, "_again", lambda so_far, leads, workers: about.append(leads) or so_far)
    dynamics = SimpleNamespace(particulars=SimpleNamespace(is_model=False))
    search(SimpleNamespace(dynamics=dynamics, release=lambda: None), EFFECTS)
    assert asked == fits_made * ["current", "wind_steady", "log_scale"]
    assert (about[0].names, about[0].evidence) == ((("log_scale",), 70.0) if fits_made > 1 else (("current",), 20.0))


@pytest.mark.parametrize("evidence, tried", [(1.0, True), (-1.0, False)])
def test_gusts_are_tried_beside_the_best_pair_with_a_steady_wind_however_many_others_are_ahead(
    monkeypatch, evidence, tried
):
    """Strong gusts are taken for others before they are taken for the mean wind."""
    ahead = [fit(50.0 + k, "current", name) for k, name in enumerate(("log_scale", "heading_bias", "rate_bias"))]
    ahead += [fit(40.0 + k, "log_scale", name) for k, name in enumerate(("heading_bias", "rate_bias"))]
    pair = fit(evidence, "current", "wind_steady")
    _, windy, _ = searched(monkeypatch, {"current": 20.0}, [*ahead, pair, fit(-2.0, "log_scale", "wind_steady")])
    assert windy == ([pair.names] if tried else [])


@pytest.mark.parametrize("second, kept", [(5.8, []), (6.2, [("current", "log_scale")])])
def test_a_pair_is_built_upon_that_adds_six(monkeypatch, second, kept):
    _, _, leading = searched(monkeypatch, {"current": 40.0}, [fit(40.0 + second, "current", "log_scale")])
    assert leading[1] == kept


REFINED = [  # evidence of the fit, and after each of two more; what is worked on; how many fits
    ((5.0, 5.05, 9.0), -99.0, 5.05, 2),
    ((5.0, 5.15, 9.0), -99.0, 9.0, 3),
    ((5.0, 4.0, 9.0), -99.0, 5.0, 2),
    ((5.0, 9.0, 9.5), 5.5, 5.0, 1),
]


@pytest.mark.parametrize("evidences, least, best, count", REFINED)
def test_a_fit_goes_on_as_long_as_it_gains_a_tenth_and_is_worth_it(monkeypatch, evidences, least, best, count):
    left, rounds = list(evidences), []
    there = SimpleNamespace(
        improve=lambda h, level, scatter, rounds_=None, **more: (rounds.append(more.get("rounds")) or h, 0.0),
        evaluate=lambda h, around, fine: FittedHypothesis(
            h, left.pop(0), np.zeros((1, 1)), np.zeros((0, 0)), best=(1, 1)
        ),
    )
    monkeypatch.setattr(fits, "beside", lambda likelihood, hypothesis: there)
    monkeypatch.setattr(fits, "replaced", lambda there, hypothesis, level, scatter: hypothesis)
    assert fits.refine(there, Hypothesis((), ()), 1, 1, least).evidence == best
    assert len([r for r in rounds if r != 1]) == count, "single rounds only look"


@pytest.mark.parametrize("start, noise", [(np.inf, (2, 1)), (100.0, (7, 5))])
def test_an_event_without_a_time_is_looked_for_at_the_noise_that_was_asked_for(monkeypatch, start, noise):
    """Without it coefficients that are off by far explain the runs, and then nothing asks for it."""
    effect, looked = SideForce(SHIP), []
    columns = [p.name for p in effect.declared]
    row = values(effect).copy()
    row[:, [p.per_run for p in effect.declared]] = np.inf
    row[:, columns.index("start_s")], row[:, columns.index("end_s")] = start, start + 50.0
    hypothesis = Hypothesis((effect,), (row,))
    there = SimpleNamespace(
        improve=lambda h, level, scatter, rounds=5: (h, 0.0),
        evaluate=lambda h, around, fine: FittedHypothesis(h, 1.0, np.zeros((1, 1)), np.zeros((0, 0)), best=(7, 5)),
    )
    monkeypatch.setattr(fits, "beside", lambda likelihood, hypothesis: there)
    monkeypatch.setattr(fits, "replaced", lambda there, h, *at: looked.append(at) or h)
    fits.refine(there, hypothesis, 2, 1)
    assert looked == [noise]


def test_gusts_are_tried_for_a_wind_alone_behind_any_number_of_pairs(monkeypatch):
    pairs = [fit(60.0 - k, "wind_steady", f"other {k}") for k in range(4)]
    _, windy, _ = searched(monkeypatch, {"wind_steady": 20.0}, pairs)
    assert windy == [*(j.names for j in pairs[:3]), ("wind_steady",)]


def test_gusts_are_not_tried_for_a_wind_that_says_less_than_calm_water(monkeypatch):
    assert searched(monkeypatch, {"wind_steady": -1.0, "current": 20.0}, [])[1] == []


@pytest.mark.parametrize("best", ["published", "calm water's"])
def test_the_better_of_the_fits_from_published_scatter_and_from_that_of_calm_water_is_taken(monkeypatch, best):
    """Where calm water calls a large effect wrong coefficients, a fit that begins there stays where it is small."""
    quiet = PROCESS_LEVELS.quiet(6)
    begun = {(quiet, PUBLISHED_SD_LEVEL): "published", (6, 4): "calm water's"}
    monkeypatch.setattr(fits, "_starts", lambda *_: ["start"])
    monkeypatch.setattr(fits, "_in_form", lambda likelihood, start, level, scatter: start)
    monkeypatch.setattr(fits, "_within_errors", lambda values, fitted: False)
    monkeypatch.setattr(fits, "refine", lambda likelihood, hypothesis, level, scatter, least: SimpleNamespace(
        evidence=9.0 if begun[level, scatter] == best else 2.0, begun=begun[level, scatter], least=least
    ))  # fmt: skip
    likelihood = SimpleNamespace(improve=lambda hypothesis, level, scatter, rounds: (hypothesis, 0.0))
    none = SimpleNamespace(best=(6, 4), evidence=2.0)
    found = single(likelihood, Current(SHIP), none)
    assert found.begun == best and found.least == -28.0, "thirty behind calm water a fit is given up"
    assert single(likelihood, SideForce(SHIP), none).begun == "published", "events explain the misfit or nothing"


@pytest.mark.parametrize(("off", "fits_made"), [(0.4, 1), (0.6, 2)])
def test_an_effect_is_fitted_once_where_both_scatters_lead_within_half_a_standard_error(monkeypatch, off, fits_made):
    """From there on it would come to rest where the first fit did: fitting it to the end is half of the time."""
    made = []
    current, errors = Hypothesis((Current(SHIP),), (np.array([[1.0, 90.0]]),)), np.array([0.1, 5.0])

    def improve(hypothesis: Hypothesis, level: int, scatter: int, rounds: int) -> tuple[Hypothesis, float]:
        return hypothesis.with_vector(hypothesis.vector() + (off * errors if (level, scatter) == (6, 4) else 0)), 0.0

    def refine(likelihood: object, hypothesis: Hypothesis, *_: object) -> FittedHypothesis:
        made.append(hypothesis)
        return FittedHypothesis(hypothesis, 9.0, np.zeros((1, 1)), np.diag(errors**2))

    monkeypatch.setattr(fits, "_starts", lambda *_: [current])
    monkeypatch.setattr(fits, "refine", refine)
    single(SimpleNamespace(improve=improve), Current(SHIP), SimpleNamespace(best=(6, 4), evidence=2.0))
    assert len(made) == fits_made


def test_the_form_of_an_effect_is_fitted_at_each_start_of_its_size_first():
    """Else a right depth is left for the sake of a resistance that is a little off; other effects have no form."""
    asked = []
    likelihood = SimpleNamespace(improve=lambda h, level, scatter, rounds: (asked.append(h.fixed) or h, 0.0))
    for effect, fixed in ((ShallowWater(SHIP), [{"depth_m"}]), (LogScale(SHIP), []), (SideForce(SHIP), [])):
        asked.clear()
        start = Hypothesis((effect,), (values(effect),))
        assert fits._in_form(likelihood, start, 6, 2).fixed == frozenset() and asked == fixed


def test_of_many_starts_the_two_most_promising_are_fitted_each_campaigns_own_and_of_up_to_four_all():
    """What acts in one campaign is sought with nothing in the others: here .4 m/s in the first, 2.2 in the second."""
    runs = SimpleNamespace(runs=[0, 1, 2], campaigns=(0, 1, 1))
    asked: list[np.ndarray] = []

    def posterior(h: Hypothesis, level: int) -> SimpleNamespace:
        (values,) = h.values
        asked.append(values)
        here = values[:, 0] != 0
        near = -abs(values[here, 0] - (0.4 if here[0] else 2.2)) - 1e-3 * abs(values[here, 1] - 90.0)
        return SimpleNamespace(evidence=[np.nan, near.sum()])

    likelihood = SimpleNamespace(data_set=runs, columns=lambda h: h, posterior=posterior)
    scale = fits._starts(likelihood, LogScale(SHIP), 0, 1)
    assert [h.values[0][:, 0].tolist() for h in scale] == [[s] * 3 for s in LogScale(SHIP).declared[0].starts]
    assert not asked, "four starts are all fitted"
    effect = Current(SHIP)
    first, second = (h.values[0] for h in fits._starts(likelihood, effect, 0, 1))
    speeds = np.array(effect.declared[0].starts)
    nearest = [float(speeds[abs(speeds - s).argmin()]) for s in (0.4, 2.2, 2.2)]
    assert first.tolist() == [[s, 90.0] for s in nearest] and second.tolist() != first.tolist()
    assert all(
        len({bool(v) for v in values[1:, 0]}) == 1 and (values[0, 0] == 0) != (values[1, 0] == 0) for values in asked
    )


@pytest.mark.parametrize("there, here", [(100.0, 92.0), (130.0, 134.0), (90.0, 82.0), (120.0, 120.0)])
def test_about_other_states_what_does_as_well_as_calm_water_still_does_and_what_does_as_well_as_the_leading_one(
    there, here
):
    """Calm water loses eight, the leading one, forty ahead, gains eight: the others lie between them or behind."""
    calm, leading = (by_hand(100.0), by_hand(92.0)), (by_hand(140.0, "current"), by_hand(148.0, "current"))
    (found,) = under_test._between(calm, leading, [by_hand(there, "log_scale")])
    assert (found.names, found.evidence) == (("log_scale",), pytest.approx(here))


def test_about_the_states_of_calm_water_all_gain_what_it_gains():
    calm = by_hand(100.0), by_hand(107.0)
    assert [j.evidence for j in under_test._between(calm, calm, [by_hand(104.0, "current"), by_hand(95.0)])] == [
        111.0, 102.0
    ]  # fmt: skip
