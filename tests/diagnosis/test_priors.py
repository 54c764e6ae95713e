"""Priors: heavy tails of what goes wrong at sea, errors of coefficients that go together, errors over noise levels."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from fleet import unchecked
from pytest import approx
from trials import CALM, CIRCLE, NOISE, SHIP, STEP, ZIGZAG, run_of, runs, values

from manoeuvre_nn.diagnosis.advise import apart
from manoeuvre_nn.diagnosis.fits import single
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.effect.current import Current
from manoeuvre_nn.effect.propulsion import ThrustLoss
from manoeuvre_nn.effect.rudder import RudderBacklash, RudderOffset
from manoeuvre_nn.effect.wind import SteadyWind
from manoeuvre_nn.estimation import marginal_likelihood as under_test
from manoeuvre_nn.estimation.corrections import Calibrated, CoefficientPrior, Corrections
from manoeuvre_nn.estimation.data_set import COEFFICIENT_SD_LEVELS, whitened_data_set
from manoeuvre_nn.estimation.hypothesis import Hypothesis
from manoeuvre_nn.estimation.marginal_likelihood import MarginalLikelihood
from manoeuvre_nn.estimation.posterior import mixture, posterior
from manoeuvre_nn.estimation.prior_average import with_likely_coefficient_prior
from manoeuvre_nn.estimation.process_noise import PROCESS_LEVELS

pytestmark = pytest.mark.usefixtures("unchecked_types")
NONE = Hypothesis((), ())


@pytest.mark.parametrize("size", [0.0, 0.5, 4.0, 40.0])
def test_a_gaussian_stands_for_a_heavy_tail_where_the_value_is(size):
    """Same height and same slope as Cauchy's density, by differences."""
    unknown = Hypothesis((RudderOffset(SHIP),), (np.array([[size]]),)).unknowns()[0]
    gamma, sd = 0.6745 * 1.5, unknown.prior_sd(size)

    def of_cauchy(x: float) -> float:
        return -np.log(np.pi * gamma * (1 + (x / gamma) ** 2))

    def of_gaussian(x: float) -> float:
        return -0.5 * (x / sd) ** 2 - np.log(np.sqrt(2 * np.pi) * sd) + unknown.prior_excess(size)

    h = 1e-4
    slopes = [(density(size + h) - density(size - h)) / (2 * h) for density in (of_cauchy, of_gaussian)]
    assert of_gaussian(size) == approx(of_cauchy(size)) and slopes[0] == approx(slopes[1], abs=1e-6)


def log_density(unknown, x: float) -> float:
    """Of the prior at x, by the Gaussian that stands for it there."""
    sd = unknown.prior_sd(x)
    return -0.5 * (x / sd) ** 2 - np.log(np.sqrt(2 * np.pi) * sd) + unknown.prior_excess(x)


@pytest.mark.parametrize(("effect", "usual"), [(Current, 0.6), (SteadyWind, 8.0)])
def test_velocities_are_vectors_whose_prior_has_no_peak_at_none(effect, usual):
    """Half of all are slower than .6745 times the usual speed; slopes by differences."""
    speed = Hypothesis((effect(SHIP),), (values(effect(SHIP)),)).unknowns()[0]
    median = 0.6745 * usual

    def share(most: float) -> float:
        x = np.linspace(1e-6, most, 4001)
        return float(np.trapezoid([np.exp(log_density(speed, one)) for one in x], x))

    assert share(median) == approx(0.5, abs=1e-4)
    assert share(0.01 * median) == approx(1 - 1 / np.sqrt(1 + 3e-4), rel=1e-2)
    assert np.exp(speed.prior_inside()) == approx(share(speed.parameter.high), abs=1e-3)
    h, at = 1e-4 * usual, 0.7 * usual
    slope = (log_density(speed, at + h) - log_density(speed, at - h)) / (2 * h) - 1 / at
    assert slope == approx(-at / speed.prior_sd(at) ** 2, rel=1e-4), "a fit looks for the likeliest vector"


def test_a_slow_current_is_as_likely_as_the_small_part_of_the_plane_that_it_takes():
    """In polar coordinates and in those of the plane the same evidence of a velocity known to an error e all around."""
    x, e = 0.02, 0.002
    speed, towards = Hypothesis((Current(SHIP),), (np.array([[x, 40.0]]),)).unknowns()
    known = np.log(np.sqrt(2 * np.pi) * e) + np.log(np.sqrt(2 * np.pi) * np.degrees(e / x))
    polar = log_density(speed, x) + known - np.log(np.sqrt(2 * np.pi) * towards.prior_sd(40.0))
    gamma = 0.6745 * 0.6 / np.sqrt(3)
    plane = np.log(2 * np.pi * e**2) - np.log(2 * np.pi * gamma**2) - 1.5 * np.log1p((x / gamma) ** 2)
    assert polar == approx(plane, abs=1e-6)


def test_a_fault_ten_times_as_large_as_usual_costs_little_more_than_a_usual_one():
    """Odds of 1 to 100, where a Gaussian prior would say 1 to 1e20."""
    usual, large = (Hypothesis((RudderOffset(SHIP),), (np.array([[size]]),)).unknowns()[0] for size in (1.0, 15.0))
    density = [u.prior_excess(x) - 0.5 * (x / u.prior_sd(x)) ** 2 - np.log(u.prior_sd(x)) for u, x in
               ((usual, 1.0), (large, 15.0))]  # fmt: skip
    assert 4.0 < density[0] - density[1] < 6.0


@pytest.mark.slow
def test_a_fault_far_beyond_its_usual_size_is_measured():
    """Rudder that stands 12 deg off, play of 15 deg: both were out of bounds when these fitted what is usual."""
    for effect, true in ((RudderOffset(SHIP, offset_deg=12.0), 12.0), (RudderBacklash(SHIP, width_deg=15.0), 15.0)):
        likelihood = MarginalLikelihood(whitened_data_set(CALM, runs([CIRCLE, ZIGZAG], [effect])))
        judged = single(likelihood, type(effect)(SHIP), likelihood.evaluate(NONE))
        assert judged.hypothesis.vector()[0] == approx(true, abs=max(4 * judged.errors[0], 0.05))


def test_a_speed_below_zero_is_one_toward_the_opposite():
    there = Hypothesis((Current(SHIP),), (np.array([[0.3, 40.0]]),))
    moved = under_test._limited(there, np.array([-0.8, 0.0])).vector()
    assert moved == approx([0.5, 220.0])


def test_a_step_turns_a_direction_by_45_deg_moves_a_time_by_a_minute_and_other_numbers_by_one_and_a_half_usual_sizes():
    """What goes furthest beyond holds all of the step back."""
    current = Hypothesis((Current(SHIP),), (np.array([[0.3, 40.0]]),))
    assert under_test._limited(current, np.array([0.0, 90.0])).vector() == approx([0.3, 85.0])
    assert under_test._limited(current, np.array([0.1, -180.0])).vector() == approx([0.3 + 0.1 / 4, 355.0])
    offset = Hypothesis((RudderOffset(SHIP),), (np.array([[0.2]]),))
    assert under_test._limited(offset, np.array([9.0])).vector() == approx([0.2 + 1.5 * 1.5]), "usual are 1.5 deg"
    loss = Hypothesis((ThrustLoss(SHIP),), (values(ThrustLoss(SHIP)),))
    begins = ThrustLoss(SHIP).timed[0]
    loss.values[0][0, begins] = 300.0
    step = np.where(loss.vector() == 300.0, 100.0, 0.0)
    assert under_test._limited(loss, step).values[0][0, begins] == approx(360.0)


def test_standard_errors_hold_over_levels_of_noise():
    """Two levels of equal weight with means 1 and 3, variances 4: mean 2, variance 4 + 1."""
    data = np.array([1.0, 0.0])
    found = [
        posterior(np.array([[9.0, m / 4], [m / 4, 1 / 4 - 1e-12]]), 0.0, np.array([1e6]), data) for m in (1.0, 3.0)
    ]
    mean, covariance = mixture(
        np.array([0.5, 0.5]), np.array([p.mean() for p in found]), [p.covariance() for p in found]
    )
    assert under_test.weighty(np.array([[0.0], [0.0], [-99.0]])) == [(0, 0), (1, 0)]
    assert mean == approx([2.0]) and covariance[0, 0] == approx(5.0, rel=1e-6)


def test_errors_of_a_term_in_sway_and_yaw_go_together_by_the_stated_correlation():
    names = ["Xuu", "Yv", "Nv", "Yrr", "N+uv", "Y+uv", "Nd"]
    root = CoefficientPrior(0.6, 3.0).root(names)
    expected = np.eye(7)
    expected[1, 2] = expected[2, 1] = 0.6
    expected[4, 4] = expected[5, 5] = 9.0
    assert root @ root.T == approx(expected)


def test_a_coupling_that_is_there_is_found():
    """Coefficients of Y and N off by the same share, or by opposite ones: the sign of the arm is not free."""
    chosen = {}
    for sign in (1.0, -1.0):
        shares = [0.1 if n in ("Yv", "Yr", "Yd") else sign * 0.1 if n in ("Nv", "Nr", "Nd") else 0.0
                  for n in Corrections(CALM).names]  # fmt: skip
        ship = Calibrated(CALM, torch.tensor(shares, dtype=torch.float64))
        with unchecked():
            tracks = roll_out(Vessel(ship), [CIRCLE, ZIGZAG], step=STEP, interval=STEP)
        data_set = whitened_data_set(CALM, [run_of(track, NOISE / STEP**0.5) for track in tracks])
        chosen[sign] = with_likely_coefficient_prior(
            data_set, MarginalLikelihood(data_set).evaluate(NONE)
        ).coefficient_prior.coupling
    assert chosen[1.0] >= 0.6 and chosen[-1.0] == 0.0


def test_the_likeliest_prior_of_coefficients_is_the_same_from_whichever_noise_it_is_looked_for():
    """A term is missing that process noise may stand for: about much of it missing terms are likelier to be small."""
    shares = torch.tensor([0.6 if n == "N+uuv" else 0.0 for n in Corrections(CALM).names], dtype=torch.float64)
    with unchecked():
        tracks = roll_out(Vessel(Calibrated(CALM, shares)), [CIRCLE, ZIGZAG], step=STEP, interval=STEP)
    data_set = whitened_data_set(CALM, [run_of(track, NOISE / STEP**0.5) for track in tracks])
    found = MarginalLikelihood(data_set).evaluate(NONE)
    from_each = {
        with_likely_coefficient_prior(data_set, replace(found, best=(level, found.best[1]))).coefficient_prior
        for level in (found.best[0], PROCESS_LEVELS.point(1, 3), PROCESS_LEVELS.point(3, 3))
    }
    assert from_each == {CoefficientPrior(0.9, 3.0)}


def test_each_campaign_has_its_own_wind_and_the_same_coefficients():
    """Two days with winds from opposite sides, and a ship whose rudder is 10 % weaker than published."""
    shares = torch.tensor([-0.1 if n in ("Yd", "Nd") else 0.0 for n in Corrections(CALM).names], dtype=torch.float64)
    days = {
        "monday": SteadyWind(SHIP, speed=14.0, from_deg=60.0),
        "friday": SteadyWind(SHIP, speed=9.0, from_deg=250.0),
    }
    recorded = []
    for day, wind in days.items():
        with unchecked():
            tracks = roll_out(Vessel(Calibrated(CALM, shares), [wind]), [CIRCLE, ZIGZAG], step=STEP, interval=2 * STEP)
        recorded += [
            run_of(track, NOISE / (2 * STEP) ** 0.5, seed=len(recorded) + k, campaign=day)
            for k, track in enumerate(tracks)
        ]
    data_set = whitened_data_set(CALM, recorded)
    assert data_set.campaigns == (0, 0, 1, 1)
    likelihood = MarginalLikelihood(data_set)
    none = likelihood.evaluate(NONE)
    found = single(likelihood, SteadyWind(SHIP), none)
    told = {(f.parameter.name, f.runs): (v, e) for f, v, e in
            zip(found.hypothesis.unknowns(), found.hypothesis.vector(), found.errors, strict=True)}  # fmt: skip
    for number, wind in enumerate(days.values()):
        for name in ("speed", "from_deg"):
            value, error = told[name, (2 * number, 2 * number + 1)]
            assert value == approx(float(wind.value(name)), abs=max(3 * error, 0.1))
    assert found.evidence > none.evidence + 50
    # What the other day's numbers are is no matter of a run: a rival can be compared all the same.
    calm = MarginalLikelihood(data_set).evaluate(Hypothesis((RudderOffset(SHIP),), (np.full((4, 1), 0.5),)))
    assert apart(data_set, calm.hypothesis, found.hypothesis, found.best) > 5
    assert apart(data_set, found.hypothesis, found.hypothesis, found.best) == approx(0.0, abs=1e-6)
    elsewhere = found.hypothesis.of_runs([3, 0])
    assert elsewhere.campaigns == (1, 0) and elsewhere.values[0][1, 0] == found.hypothesis.values[0][0, 0]


@pytest.mark.slow
def test_scatter_is_that_of_the_printed_coefficients_where_no_term_is_missing():
    """Coefficients 8 % off in some ships, exact in others that lack terms: the prior says which of them are wrong."""
    names, errors = Corrections(CALM).names, np.random.default_rng(4)
    printed = np.array(["+" not in n and not n.startswith("M") for n in names])
    added = np.array(["+" in n for n in names])
    chosen: dict[str, list[tuple[float, float]]] = {"printed": [], "missing": []}
    for what, off in 3 * [("printed", 0.08 * printed), ("missing", 0.08 * added)]:
        ship = Calibrated(CALM, torch.tensor(off * errors.standard_normal(len(names))))
        with unchecked():
            tracks = roll_out(Vessel(ship), [CIRCLE, ZIGZAG], step=1.0)
        data_set = whitened_data_set(CALM, [run_of(track, NOISE) for track in tracks])
        likely = with_likely_coefficient_prior(data_set, MarginalLikelihood(data_set).evaluate(NONE))
        scatter = COEFFICIENT_SD_LEVELS[MarginalLikelihood(likely).evaluate(NONE).best[1]]
        chosen[what].append((likely.coefficient_prior.missing, scatter))
    assert all(missing < 1.0 for missing, _ in chosen["printed"])
    scatters = [scatter for _, scatter in chosen["printed"]]
    assert 0.04 < scatters[0] < 0.12 and 0.04 < sorted(scatters)[1] < 0.12
    # Where errors of what is printed are as likely to do it, terms that are missing need not be larger than these.
    missing = sorted(missing for missing, _ in chosen["missing"])
    assert missing[0] >= 1.0 and missing[1] > 1.0
