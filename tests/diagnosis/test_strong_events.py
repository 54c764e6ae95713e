"""Forces many times as strong as the usual, which act twice: their size and all their times are found together."""

import numpy as np
import pytest
import torch
from pytest import approx
from trials import CALM, NOISE, SHIP, run_of, unchecked

from manoeuvre_nn.diagnosis.fits import single
from manoeuvre_nn.diagnosis.windows import times_of
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.effect.local import SideForce
from manoeuvre_nn.estimation.corrections import Calibrated, Corrections
from manoeuvre_nn.estimation.data_set import whitened_data_set
from manoeuvre_nn.estimation.hypothesis import Hypothesis
from manoeuvre_nn.estimation.marginal_likelihood import MarginalLikelihood
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag

pytestmark = pytest.mark.usefixtures("unchecked_types")
STEP, SCATTER = 2.0, 0.03
TRIALS = [turning_circle(35.0, duration=540.0), zigzag(10.0, duration=480.0)]


@pytest.mark.parametrize("force_kN, lever_m, times", [
    pytest.param(-1600.0, -19.0, [(90, 165, 255, 325), (115, 193, 296, 373)], marks=pytest.mark.slow),
    (4000.0, 10.0, [(100, 230), (120, 190, 260, 330)]),
    pytest.param(-700.0, 40.0, [(), (80, 140, 250, 300)], marks=pytest.mark.slow),
])  # fmt: skip
def test_a_strong_force_that_acts_twice_is_found_with_its_size_and_all_its_times(force_kN, lever_m, times):
    shares = SCATTER * np.random.default_rng(3).standard_normal(len(Corrections(CALM).names))
    shares[len(Corrections(CALM).of_model.names) :] = 0.0
    runs, truth = [], Calibrated(CALM, torch.tensor(shares))
    with unchecked():
        for k, (trial, when) in enumerate(zip(TRIALS, times, strict=True)):
            at = dict(zip(("start_s", "end_s", "start_2_s", "end_2_s"), map(float, when), strict=False))
            acting = [SideForce(SHIP, force_kN=force_kN, lever_m=lever_m, ramp_s=1.0, **at)] if at else []
            (track,) = roll_out(Vessel(truth, acting), [trial], step=STEP, interval=STEP)
            runs.append(run_of(track, NOISE / STEP**0.5, k))
        likelihood = MarginalLikelihood(whitened_data_set(CALM, runs))
        none = likelihood.evaluate(Hypothesis((), ()))
        found = single(likelihood, SideForce(SHIP), none)
    (effect,), (values,) = found.hypothesis.effects, found.hypothesis.values
    assert [tuple(np.ravel(times_of(effect, row))) for row in values] == [approx(when, abs=6.0) for when in times]
    assert values[0, :2] == approx([force_kN, lever_m], rel=0.1)
    assert found.evidence > none.evidence + 100
