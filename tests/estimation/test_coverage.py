"""Intervals hold the truth as often as they say: ships whose coefficients are known, sailed with noise."""

from functools import cache
from math import radians
from pathlib import Path

import numpy as np
import pytest
import torch
import yaml
from fleet import ship_named, unchecked
from noisy_zigzags import CHANNELS, FORCE, NOISE, errors, run_of, with_noise, zigzags
from pytest import approx
from tiers import mainly

from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.scaling import Scaling
from manoeuvre_nn.dynamics.model import IdentifiedShip
from manoeuvre_nn.estimation.agreement import birge_ratio
from manoeuvre_nn.estimation.closed_loop import first, solve
from manoeuvre_nn.estimation.coefficient_forces import CoefficientForces, own_forces, series_forces
from manoeuvre_nn.estimation.coefficient_priors import own_prior, series_prior
from manoeuvre_nn.estimation.own_terms import fit_own_terms
from manoeuvre_nn.estimation.problem import EstimationProblem
from manoeuvre_nn.network.series import Series, SeriesSettings
from manoeuvre_nn.ship.known import no_part

CONF = Path(__file__).parents[2] / "conf" / "network"
LENGTH = {"esso_190k": 40.0, "mariner_corrected": 18.0}


@cache
def sailed(name: str, count: int, lacking: float):
    """A 20/20 and a 10/10 zigzag for every seed."""
    with unchecked():
        runs = [zigzags(ship_named(name), radians(a), LENGTH[name], count, int(a), lacking) for a in (20.0, 10.0)]
    return list(zip(*runs, strict=True))


def of_tanker():
    ship = ship_named("esso_190k")
    return own_forces(ship), *own_prior(ship, 0.2)


def of_mariner():
    """The Mariner as a member of Abkowitz's series; what its table does not have is 0."""
    ship = ship_named("mariner_corrected")
    terms = yaml.safe_load((CONF / "abkowitz.yaml").read_text())["network"]
    series = Series(SeriesSettings(terms["surge"], terms["lateral"]))
    unit = Scaling(*(f(k, dtype=torch.float64) for f, k in ((torch.zeros, 4), (torch.ones, 4), (torch.ones, 3))))
    force = series_forces(IdentifiedShip(no_part(ship), series, unit))
    own = zip(own_forces(ship).names, own_prior(ship, 0.2)[0], strict=True)
    table = {(o, _sorted(t)): v * (-1) ** t.split().count("d") for (o, t), v in own}
    truth = np.array([table.pop((o, _sorted(t)), 0.0) for o, t in series.names])
    assert not table
    return force, truth, 0.5 * series_prior(series.names, ship.particulars)[1]


def _sorted(term: str) -> str:
    return " ".join(sorted(term.split()))


@pytest.mark.slow
@pytest.mark.parametrize("made", [of_tanker, of_mariner])
@pytest.mark.parametrize("lacking", [1.0, 0.0])
def test_nineteen_of_twenty_intervals_hold_the_true_coefficients(made, lacking):
    """With the accelerations that the fit allows for intervals are right; without these they are on the safe side."""
    runs = sailed("esso_190k" if made is of_tanker else "mariner_corrected", 20, lacking)
    with unchecked():
        every, sharp = errors(*made(), runs, 3)
    assert 0.9 < (np.abs(every) < 1.96).mean() < 0.99
    assert (np.abs(sharp) < 1.96).mean() > 0.93
    if lacking:
        assert np.sqrt((sharp**2).mean()) == approx(1.0, abs=0.1)


@pytest.mark.slow
def test_intervals_of_the_tanker_hold_its_published_coefficients():
    runs = sailed("esso_190k", 3, 1.0)
    with unchecked():
        every, sharp = errors(*of_tanker(), runs, 3)
    assert 0.88 < (np.abs(every) < 1.96).mean() and np.sqrt((sharp**2).mean()) == approx(1.0, abs=0.25)


def ones(state, inputs):
    return torch.ones(len(state), 1)


CONSTANT = CoefficientForces([(k, "1") for k in range(3)], ones, np.zeros(3, dtype=int), np.eye(3))
"""Accelerations that are the coefficients themselves."""


@pytest.mark.parametrize("outliers", mainly(1, [True, False]))
def test_standard_errors_are_right_with_and_without_outliers(outliers):
    """Least squares with Student's weights claims a sixth too much unless a sample counts as Fisher says."""
    random, found = np.random.default_rng(4), []
    for _ in range(60):
        draw = random.standard_t(4, (120, 6)) if outliers else random.standard_normal((120, 6))
        time = 0.05 * np.arange(120)
        truth = np.zeros((120, 6))
        truth[:, 0], truth[:, 3] = 1.0, time
        track = run_of("straight", time, truth + 0.01 * draw, {})
        problem = EstimationProblem([track], CONSTANT, np.zeros(3), np.full(3, 10.0))
        with unchecked():
            e = solve(problem, first(problem, process_sd=(1e-6, 1e-6, 1e-6)))
        found.append(e.values / np.sqrt(np.diag(e.covariance)))
    assert np.sqrt(np.mean(np.square(found))) == approx(1.0, abs=0.1)


def noisy(tracks, seed=5):
    random = np.random.default_rng(seed)
    return [with_noise(t, NOISE, random.standard_normal) for t in tracks]


@pytest.mark.slow
def test_stretches_of_a_ship_of_these_products_agree_and_of_another_ship_do_not():
    """The tanker without cross-flow drag in sway and yaw is no tanker: stretches want coefficients of their own."""
    force, mean, spread = of_tanker()
    tracks = noisy(sailed("esso_190k", 3, 1.0)[0])
    ratios = []
    for kept in (1.0, 1e-4):
        lame = np.where([t in {"|v|v", "cross", "L|v|r"} for _, t in force.names], kept, 1.0)
        problem = EstimationProblem(tracks, force, mean * lame, spread * lame)
        with unchecked():
            ratios.append(birge_ratio(problem, solve(problem, first(problem, process_sd=tuple(FORCE)))))
    assert 0.5 < ratios[0] < 1.6 and ratios[1] > 2 * ratios[0]


@pytest.mark.parametrize("right", mainly(1, [True, False]))
def test_a_floor_that_is_too_high_sinks_to_the_noise_of_the_sensors_if_the_model_is_right(right):
    """It was ten times the noise. The tanker without cross-flow drag in sway and yaw is no tanker, and keeps it."""
    force, mean, spread = of_tanker()
    lame = np.where([not right and t in {"|v|v", "cross", "L|v|r"} for _, t in force.names], 1e-4, 1.0)
    tracks = [t.between(0.0, 20.0) for t in noisy(sailed("esso_190k", 3, 1.0)[0])]  # in lengths
    high = EstimationProblem(tracks, force, mean * lame, spread * lame, floor=10 * NOISE, learn_floor=True)
    with unchecked():
        found = solve(high, first(high, process_sd=tuple(FORCE)), passes=40)
    if right:
        assert (found.floor < 0.2 * high.floor).all() and found.noise / NOISE == approx(1.0, abs=0.3)
    else:
        assert found.floor == approx(high.floor)
    assert (found.noise >= found.floor).all()


def test_the_tankers_own_table_is_fitted_to_a_recording():
    ship = ship_named("esso_190k")
    (track, *_) = noisy(sailed("esso_190k", 3, 1.0)[1])
    p = ship.particulars
    second = p.length / p.speed
    units = np.array([p.speed, p.speed, 1 / second, p.length, p.length, 1.0])
    columns = dict(zip(CHANNELS, (track.stacked(*CHANNELS) * units).T, strict=True))
    recording = Recording("zz20", track.time * second, {**columns, "delta": track["delta"]})
    with unchecked():
        fitted, forces, agreement = fit_own_terms(ship, [recording])
    z = (fitted.values - fitted.mean) / fitted.errors
    assert np.abs(z).max() < 3.5 and fitted.determined > 12 and agreement.ratio < 1.5
    assert fitted.names == tuple(forces.names) and fitted.values[:3] == approx(fitted.mean[:3], rel=0.1)
