"""Hypotheses fitted and judged: evidence by quadrature and by sums, fits from far off, bounds, standard errors."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from pytest import approx
from scipy.special import logsumexp
from scipy.stats import rayleigh
from trials import CALM, CIRCLE, NOISE, SHIP, ZIGZAG, run_of, runs, sailed, values

from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.effect.current import Current
from manoeuvre_nn.effect.local import BowThruster, SideForce
from manoeuvre_nn.effect.propulsion import HullFouling, PropellerPitchError
from manoeuvre_nn.effect.rudder import RudderBacklash, RudderOffset
from manoeuvre_nn.effect.sensors import HeadingBias, LogScale
from manoeuvre_nn.effect.wind import GustyWind, SteadyWind
from manoeuvre_nn.estimation.corrections import Corrections
from manoeuvre_nn.estimation.data_set import COEFFICIENT_SD_LEVELS, WhitenedDataSet, whitened_data_set
from manoeuvre_nn.estimation.effect_columns import contribution
from manoeuvre_nn.estimation.hypothesis import Hypothesis
from manoeuvre_nn.estimation.linear_run import Columns
from manoeuvre_nn.estimation.marginal_likelihood import (
    PROCESS_PRIOR,
    MarginalLikelihood,
    hypothesis_columns,
    log_prior_levels,
)
from manoeuvre_nn.estimation.posterior import posterior
from manoeuvre_nn.estimation.prepared_run import LATENCY_SD, base_columns, prepared_run

pytestmark = pytest.mark.usefixtures("unchecked_types")
NONE = Hypothesis((), ())
ACTING = {
    "nothing": (),
    "current": (Current(SHIP, speed=0.7, toward_deg=60.0),),
    "wind": (SteadyWind(SHIP, speed=10.0, from_deg=60.0),),
    "thrust": (PropellerPitchError(SHIP, fraction=0.15),),
    "backlash": (RudderBacklash(SHIP, width_deg=3.0),),
    "offset and compass": (RudderOffset(SHIP, offset_deg=1.5), HeadingBias(SHIP, bias_deg=-1.0)),
}
LEVEL, SCATTER = 6, 1


@cache
def stand(name: str) -> WhitenedDataSet:
    """A circle and a zigzag of 240 s on the bench."""
    return whitened_data_set(CALM, runs([CIRCLE, ZIGZAG], ACTING[name]))


def hypothesis(*effects: Effect) -> Hypothesis:
    """Effects at their own values in two runs."""
    return Hypothesis(effects, tuple(values(e, 2) for e in effects))


def fitted(likelihood: MarginalLikelihood, start: Hypothesis, rounds: int = 12):
    found, _ = likelihood.improve(start, LEVEL, SCATTER, rounds)
    return likelihood.evaluate(found)


def test_the_evidence_of_one_unknown_is_the_integral_over_it():
    """Data d, column c and prior sd in the plane of two vectors, summed up by hand."""
    g = np.random.default_rng(0)
    d, c, sd, norm = g.standard_normal(7), g.standard_normal(7), 1.3, -4.2
    vectors = np.stack([d, c], axis=1)
    found = posterior(vectors.T @ vectors, norm, np.array([sd]), np.array([1.0, 0.0]), COEFFICIENT_SD_LEVELS, 0)
    theta = np.linspace(-12, 12, 20001)
    density = np.exp(norm - 0.5 * np.sum((d[:, None] - c[:, None] * theta) ** 2, axis=0) - 0.5 * (theta / sd) ** 2)
    density /= np.sqrt(2 * np.pi) * sd
    total = np.trapezoid(density, theta)
    mean = np.trapezoid(theta * density, theta) / total
    variance = np.trapezoid((theta - mean) ** 2 * density, theta) / total
    assert found.evidence == approx(np.full(len(COEFFICIENT_SD_LEVELS), np.log(total)))
    assert found.mean(0)[0] == approx(mean) and found.covariance(0)[0, 0] == approx(variance)
    assert found.misfit[0] == approx(np.sum((d - c * mean) ** 2) + (mean / sd) ** 2)


def test_coefficients_spread_as_the_level_says_and_other_unknowns_as_they_are():
    g = np.random.default_rng(1)
    vectors = g.standard_normal((9, 3))
    gram, prior = vectors.T @ vectors, np.array([2.0, 0.5])
    data = np.array([1.0, 0.0, 0.0])
    levels = posterior(gram, 0.0, prior, data, COEFFICIENT_SD_LEVELS, 1)
    for s, scatter in enumerate(COEFFICIENT_SD_LEVELS):
        plain = posterior(gram, 0.0, prior * [scatter, 1.0], data, scaled=0)
        assert levels.evidence[s] == approx(plain.evidence[0])
        assert levels.mean(s) == approx(plain.mean(0))


def test_the_prior_of_the_levels_sums_to_one_and_favours_little_force():
    for scale in (None, PROCESS_PRIOR):
        assert logsumexp(log_prior_levels(stand("nothing"), scale)) == approx(0.0, abs=1e-12)
    held = log_prior_levels(stand("nothing"), PROCESS_PRIOR)
    assert held[0].max() == held.max() and held[-1, -1] == held.min()
    of_scatter = rayleigh(scale=0.045).pdf(COEFFICIENT_SD_LEVELS) * COEFFICIENT_SD_LEVELS
    assert np.exp(held[3]) / np.exp(held[3]).sum() == approx(of_scatter / of_scatter.sum()), "of ln s"


@pytest.mark.parametrize("name", ["nothing", "current"])
def test_judging_outward_from_one_level_is_the_sum_over_all_levels(name):
    likelihood = MarginalLikelihood(stand(name))
    prior = log_prior_levels(stand(name), PROCESS_PRIOR)
    whole = np.stack([
        posterior(
            likelihood.data_set.at(g).base_gram, likelihood.data_set.at(g).norm,
            np.r_[np.ones(likelihood.data_set.combinations), np.full(2, LATENCY_SD)],
            np.eye(likelihood.data_set.size)[0], COEFFICIENT_SD_LEVELS, likelihood.data_set.combinations,
        ).evidence
        for g in range(len(prior))
    ])  # fmt: skip
    for around in (0, 12, None):
        judged = likelihood.evaluate(NONE, around=around)
        assert judged.evidence == approx(logsumexp(whole + prior), abs=0.05)
        assert judged.best == np.unravel_index(np.argmax(whole + prior), whole.shape)
        counts = whole + prior > (whole + prior).max() - 4.6
        assert judged.by_level[counts] == approx(whole[counts], abs=0.1)
        assert not np.isfinite(judged.by_level).all(), "nor is every level looked at"


def test_an_effect_at_zero_is_calm_water():
    """A speed of 0 adds nothing, so that the data alone are left: the evidence is less what the freedom costs."""
    likelihood = MarginalLikelihood(stand("nothing"))
    still = Hypothesis((Current(SHIP),), (np.zeros((2, 2)),), frozenset({"toward_deg"}))
    lin = hypothesis_columns(likelihood.data_set, still)
    assert not any(c.measured[..., 0].any() or c.moved[..., 0].any() for c in lin.columns)
    judged = likelihood.evaluate(still)
    assert -12 < judged.evidence - likelihood.evaluate(NONE).evidence < 2


FAR = [
    ("current", (Current(SHIP, speed=2.0, toward_deg=300.0),), [0.7, 60.0], [0.01, 1.0]),
    ("wind", (SteadyWind(SHIP, speed=4.0, from_deg=150.0),), [10.0, 60.0], [2.5, 9.0]),
    (
        "offset and compass",
        (RudderOffset(SHIP, offset_deg=-3.0), HeadingBias(SHIP, bias_deg=4.0)),
        [1.5, -1.0],
        [0.4, 0.1],
    ),
]


@pytest.mark.parametrize("name, start, true, surest", FAR, ids=[f[0] for f in FAR])
def test_a_fit_reaches_the_true_values_from_far_off(name, start, true, surest):
    likelihood = MarginalLikelihood(stand(name))
    judged = fitted(likelihood, hypothesis(*start))
    at = [k for k, f in enumerate(judged.hypothesis.unknowns()) if not f.parameter.form]
    found, errors = judged.hypothesis.vector()[at], judged.errors[at]
    assert (np.abs(found - true) < 3.5 * errors + 0.01 * np.abs(true)).all() and (errors < surest).all()
    assert judged.evidence > likelihood.evaluate(NONE).evidence + 8


def test_standard_errors_are_what_estimates_scatter_by():
    record, true, z = sailed([ZIGZAG], ACTING["offset and compass"])[0], np.array([1.5, -1.0]), []
    for seed in range(6):
        likelihood = MarginalLikelihood(whitened_data_set(CALM, [run_of(record, NOISE, seed)]))
        start = Hypothesis(ACTING["offset and compass"], tuple(values(e) for e in ACTING["offset and compass"]))
        judged = fitted(likelihood, start, 4)
        z.append((judged.hypothesis.vector() - true) / judged.errors)
    # Chi-square of 12 degrees of freedom: 2.2 and 32.9 are its 0.1 % points.
    assert 2.2 < np.sum(np.square(z)) < 32.9


def test_what_the_data_do_not_say_stays_as_it_was_before():
    """A scale error of a log that was not recorded: prior mean and spread, and the evidence of calm water."""
    silent = runs([ZIGZAG])[0]
    silent = silent.with_channels(u_log=np.full(len(silent), np.nan))
    likelihood = MarginalLikelihood(whitened_data_set(CALM, [silent]))
    scale = Hypothesis((LogScale(SHIP),), (np.array([[1.0]]),))
    judged = likelihood.evaluate(scale)
    (unknown,) = scale.unknowns()
    assert judged.hypothesis.vector() == approx([1.0]) and judged.errors == approx([unknown.scale / np.sqrt(2)])
    # Laplace's method sees the peak of Cauchy's law, not its tails: 1 / sqrt(pi) of it.
    lost = 0.5 * np.log(np.pi)
    assert judged.evidence == approx(likelihood.evaluate(NONE).evidence - lost, abs=0.05)


def test_a_value_outside_its_bounds_gains_no_evidence():
    """More thrust would be a hull cleaner than clean: fouling below zero, which there is not."""
    likelihood = MarginalLikelihood(stand("thrust"))
    clean = likelihood.evaluate(NONE).evidence
    thrust = fitted(likelihood, hypothesis(PropellerPitchError(SHIP)))
    fouled = fitted(likelihood, hypothesis(HullFouling(SHIP)))
    assert thrust.evidence > clean + 6 and thrust.hypothesis.vector() == approx([0.15], abs=0.03)
    assert fouled.hypothesis.vector() == approx([0.0]) and fouled.evidence < clean + 1.0


def test_a_prior_that_its_bound_cuts_in_half_counts_double():
    """Inside the bounds the evidence is that of a prior of any sign and log 2; little lies beyond 35 deg."""
    likelihood = MarginalLikelihood(stand("backlash"))
    judged = likelihood.evaluate(hypothesis(*ACTING["backlash"]))
    weighted = judged.by_level + log_prior_levels(likelihood.data_set, PROCESS_PRIOR)
    assert judged.evidence - logsumexp(weighted[np.isfinite(weighted)]) == approx(np.log(2), abs=0.03)


def test_directions_go_round_and_long_steps_are_cut():
    likelihood = MarginalLikelihood(stand("current"))
    found, _ = likelihood.improve(hypothesis(Current(SHIP, speed=0.7, toward_deg=355.0)), LEVEL, SCATTER, rounds=12)
    assert found.vector()[1] == approx(60.0, abs=2.0)
    near, _ = likelihood.improve(hypothesis(Current(SHIP, speed=0.7, toward_deg=355.0)), LEVEL, SCATTER, rounds=2)
    assert abs((near.vector()[1] - 355.0 + 180) % 360 - 180) <= 45.0 + 1e-9


def test_free_numbers_go_into_a_vector_and_back():
    """A force with times of its own in each of two runs, and a wind that is the same in both; gusts have no column."""
    force, gusts = SideForce(SHIP), GustyWind(SHIP)
    table = values(force, 2)
    table[:, :4] = [[100.0, 20.0, 30.0, 90.0], [100.0, 20.0, 40.0, 80.0]]
    h = Hypothesis((force, gusts), (table, values(gusts, 2)), frozenset({"still_air"}))
    free = h.unknowns()
    names = [(f.parameter.name, f.runs) for f in free]
    times = [(name, (run,)) for name in ("start_s", "end_s") for run in (0, 1)]
    assert names[:6] == [("force_kN", (0, 1)), ("lever_m", (0, 1)), *times]
    assert not {"gust_sd", "gust_time_s", "still_air"} & {n for n, _ in names}
    assert h.vector()[:6].tolist() == [100.0, 20.0, 30.0, 40.0, 90.0, 80.0]
    moved = h.vector() + np.arange(len(free))
    again = h.with_vector(moved)
    assert again.vector() == approx(moved) and again.values[0][:, :4].tolist() == [[100, 21, 32, 94], [100, 21, 43, 85]]
    assert h.values[0] is table and table[0, 0] == 100.0, "the old one is as it was"
    kept = [p.name in {"gust_sd", "gust_time_s", "still_air"} for p in gusts.declared]
    assert (again.values[1][:, kept] == h.values[1][:, kept]).all()
    assert h.joined(h).names == ("side_force", "wind_gusty") * 2


def test_columns_of_a_hypothesis_are_its_contribution_and_slopes_in_the_runs_they_belong_to():
    likelihood, thruster = MarginalLikelihood(stand("nothing")), BowThruster(SHIP)
    table = values(thruster, 2)
    table[:, :3] = [[120.0, 60.0, 150.0], [120.0, 90.0, 200.0]]
    table[:, -2] = 20.0  # the ramp, off its bound
    h = Hypothesis((thruster, ACTING["current"][0]), (table, values(ACTING["current"][0], 2)))
    lin = hypothesis_columns(likelihood.data_set, h)
    names = [(f.parameter.name, f.runs) for f in h.unknowns()]
    assert lin.count == 1 + len(names)
    for run, place in enumerate(likelihood.data_set.runs):
        mine = [k for k, (_, r) in enumerate(names) if run in r]
        assert sorted(lin.index[run]) == [0, *(1 + k for k in mine)]

        def whole(at: Hypothesis, place=place, run=run):
            parts = [contribution(e, v[[run]], place.linearised) for e, v in zip(at.effects, at.values, strict=True)]
            return sum(p.moved[..., 0] for p in parts), sum(p.measured[..., 0] for p in parts)

        assert lin.columns[run].moved[..., 0] == approx(whole(h)[0], abs=1e-12)
        assert lin.columns[run].measured[..., 0] == approx(whole(h)[1], abs=1e-12)
        for column, number in enumerate(lin.index[run][1:], start=1):
            up = h.vector()
            size = {"start_s": 2.0, "end_s": 2.0, "ramp_s": 1.2}.get(names[number - 1][0], 0.01)
            up[number - 1] += size
            down = up.copy()
            down[number - 1] -= 2 * size
            slopes = [
                (a - b) / (2 * size) for a, b in zip(whole(h.with_vector(up)), whole(h.with_vector(down)), strict=True)
            ]
            for found, slope in zip((lin.columns[run].moved, lin.columns[run].measured), slopes, strict=True):
                assert found[..., column] == approx(slope, abs=0.02 * np.abs(slope).max() + 1e-15)


def test_a_bench_adds_up_the_inner_products_of_its_runs():
    """Base and extra columns of both runs, one by one, with a latency of each run's own."""
    stood = stand("nothing")
    h = hypothesis(*ACTING["current"])
    lin = hypothesis_columns(stood, h)
    g = stood.gram(LEVEL, stood.embedded(LEVEL, lin.columns), lin.index, lin.count)
    n, k = stood.size, stood.combinations
    expected = np.zeros_like(g)
    for run, place in enumerate(stood.runs):
        wide = np.zeros((n + lin.count, place.base.count + lin.columns[run].count))
        wide[[*range(1 + k), 1 + k + run, *(n + lin.index[run])], range(wide.shape[1])] = 1.0
        white = stood.at(LEVEL).white[run]
        base, more = white.embed(place.base), white.embed(lin.columns[run])
        blocks = np.block([[base.dot(base), base.dot(more)], [more.dot(base), more.dot(more)]])
        expected += wide @ blocks @ wide.T
    assert g == approx(expected, rel=1e-9, abs=1e-9 * np.abs(expected).max())
    assert stood.at(LEVEL).norm == approx(sum(w.log_norm for w in stood.at(LEVEL).white))


def test_columns_that_are_kept_are_those_of_the_values_that_are_asked_for():
    stood = stand("nothing")
    likelihood, effects = MarginalLikelihood(stood), ACTING["current"]
    first = likelihood.columns(hypothesis(*effects))
    evidence = likelihood.posterior(first, LEVEL).evidence
    assert likelihood.columns(hypothesis(*effects)) is first
    other = hypothesis(*effects).with_vector(np.array([0.3, 200.0]))
    for h in (other, replace(other, fixed=frozenset({"speed"}))):
        found, new = likelihood.columns(h), hypothesis_columns(stood, h)
        assert found.count == new.count
        assert [c.moved for c in found.columns] == [approx(c.moved, abs=0) for c in new.columns]
        apart = MarginalLikelihood(stood).posterior(new, LEVEL).evidence
        assert likelihood.posterior(found, LEVEL).evidence == approx(apart, abs=1e-9)
        assert apart != approx(evidence, abs=0.01)


def test_effects_that_are_there_are_found_better_than_calm_water_and_others_are_not():
    likelihood = MarginalLikelihood(stand("offset and compass"))
    clean = likelihood.evaluate(NONE).evidence
    both = fitted(likelihood, hypothesis(*ACTING["offset and compass"]))
    compass = fitted(likelihood, hypothesis(ACTING["offset and compass"][1]))
    log = fitted(likelihood, hypothesis(LogScale(SHIP)))
    assert both.evidence > compass.evidence + 4 > clean + 25
    assert log.evidence < compass.evidence - 25


def test_effects_held_at_their_values_are_taken_out_of_the_data():
    """The same data with the effects subtracted by hand, judged as calm water."""
    stood, h = stand("offset and compass"), hypothesis(*ACTING["offset and compass"])
    held = replace(h, fixed=frozenset({"offset_deg", "bias_deg"}))
    lin = hypothesis_columns(stood, held)
    places = []
    for place, c in zip(stood.runs, lin.columns, strict=True):
        whole = base_columns(CALM, place.linearised)
        measured, moved = whole.measured.copy(), whole.moved.copy()
        measured[..., 0] -= c.measured[..., 0]
        moved[..., 0] -= c.moved[..., 0]
        places.append(replace(place, base=Columns(measured, moved)))
    less = MarginalLikelihood(WhitenedDataSet(CALM, places))
    assert lin.count == 1 and held.vector().size == 0
    assert MarginalLikelihood(stood).evidence_at(held, LEVEL) == approx(less.evidence_at(NONE, LEVEL), abs=0.05)
    assert MarginalLikelihood(stood).evaluate(held).evidence == approx(less.evaluate(NONE).evidence, abs=0.05)


def test_combining_coefficients_loses_no_evidence_and_can_be_undone():
    """One run with every coefficient on its own, against the few combinations that the run can show."""
    place = prepared_run(CALM, run_of(sailed([ZIGZAG], ACTING["wind"])[0], NOISE))
    few = WhitenedDataSet(CALM, [place])
    white = few.at(LEVEL).white[0]
    e = white.embed(place.base)
    count = len(Corrections(CALM).names)
    prior = np.append(np.ones(count), LATENCY_SD)
    data = np.eye(len(prior) + 1)[0]
    all_of_them = posterior(e.dot(e), white.log_norm, prior, data, COEFFICIENT_SD_LEVELS, count)
    judged = MarginalLikelihood(few).evaluate(NONE, around=LEVEL)
    assert few.combinations < count
    assert judged.by_level[LEVEL] == approx(all_of_them.evidence, abs=0.5)
    g, s = judged.best
    e = few.at(g).white[0].embed(place.base)
    whole = posterior(e.dot(e), 0.0, prior, data, COEFFICIENT_SD_LEVELS, count).mean(s)
    alone = np.full(judged.by_level.shape, -1e3)
    alone[g, s] = 0.0
    at_best = MarginalLikelihood(few).over_levels(NONE, {g: MarginalLikelihood(few).posterior(None, g)}, alone)
    again = np.append(at_best.corrections, at_best.latencies)
    assert again == approx(whole, abs=0.1 * COEFFICIENT_SD_LEVELS[s])
