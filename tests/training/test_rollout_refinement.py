"""Closed-loop refinement: moved weights are found again, and what is right is left as it is."""

from dataclasses import replace
from functools import cache

import pytest
import torch
from fleet import unchecked
from tiny import ships

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.dynamics.model import CalmWater, IdentifiedShip
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.network.hull_rudder import HullRudder, HullRudderSettings
from manoeuvre_nn.recording.tuples import to_tuples
from manoeuvre_nn.training.rollout_refinement import Refinement, refine, stretches
from manoeuvre_nn.training.scalings import make_scaling


@cache
def sailed_by_a_network():
    """A ship that is a network itself, so that weights exist with which nothing is left to explain."""
    with unchecked():
        ship, known = ships()
        trial = replace(zigzag(20.0), duration=80.0)
        tuples = to_tuples(roll_out(CalmWater(ship), [trial]), known)
        network = HullRudder(HullRudderSettings(4, 1), seed=3)
        model = IdentifiedShip(known, network, make_scaling("mirrored", known, tuples))
        problem = network.least_squares(model.scaling.inputs(tuples.inputs), model.scaling.outputs(tuples.targets))
        with torch.no_grad():
            network.output_weights.copy_(problem.output_weights(network.drawn(0)[network.sees][None]))
        runs = roll_out(model, [trial])
        return model, runs, model.scaling.inputs(to_tuples(runs, known).inputs)


def moved(by: float):
    model, recordings, inputs = sailed_by_a_network()
    weights = model.network.output_weights.detach()
    away = by * torch.randn(weights.shape, generator=torch.Generator().manual_seed(7), dtype=torch.float64)
    other = IdentifiedShip(
        model.known, model.network.with_weights(model.network.input_weights, weights + away), model.scaling
    )
    return other, recordings, inputs


def test_refined_weights_sail_as_the_recording_does():
    with unchecked():
        model, recordings, inputs = moved(by=2e-3)
        # Two stretches are sailed side by side, in half the time of one as long as both.
        _, history = refine(model, 0, recordings, inputs, Refinement(steps=3, stretch=2.5))
    assert len(history) >= 3 and history[-1] < 1e-3 * history[0]


@pytest.mark.slow
def test_weights_that_are_right_stay_where_they_are():
    with unchecked():
        model, recordings, inputs = moved(by=0.0)
        weights, history = refine(model, 0, recordings, inputs, Refinement(steps=2, stretch=5.0))
    start = model.network.output_weights[0]
    assert (weights - start).norm() < 1e-3 * start.norm()
    assert history[0] < 1e-6  # the rudder is taken as straight between samples


@pytest.mark.slow
def test_a_strong_pull_keeps_the_first_fit():
    with unchecked():
        model, recordings, inputs = moved(by=2e-3)
        free, _ = refine(model, 0, recordings, inputs, Refinement(steps=1, stretch=5.0))
        held, _ = refine(model, 0, recordings, inputs, Refinement(steps=1, stretch=5.0, pull=1e6))
    start = model.network.output_weights[0]
    assert (held - start).norm() < 1e-3 * (free - start).norm()


def test_no_steps_change_nothing():
    with unchecked():
        model, recordings, inputs = moved(by=2e-3)
        weights, history = refine(model, 0, recordings, inputs, Refinement(steps=0))
    assert torch.equal(weights, model.network.output_weights[0]) and history == []


def test_stretches_cover_the_recording_and_are_even():
    with unchecked():
        _, (recording,), _ = sailed_by_a_network()
        pieces = stretches([recording], 35.0)
    assert [p.time[0] for p in pieces] == pytest.approx([0.0, 40.0])
    assert [p.time[-1] for p in pieces] == pytest.approx([40.0, 80.0])
    assert len(stretches([recording], 1e6)) == 1


@pytest.mark.parametrize("settings", [{"steps": -1}, {"stretch": 1.0}, {"pull": -1.0}])
def test_settings_out_of_range_are_refused(settings):
    with pytest.raises(InputError, match=r"fit\.refine"):
        Refinement(**settings)
