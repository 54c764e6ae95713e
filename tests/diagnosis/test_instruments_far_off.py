"""Instruments that are far off: the track, their noise, and a formula for their error are found all the same."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from pytest import approx
from searches import fitted, found
from trials import CALM, NOISE, ZIGZAG, run_of, sailed

from manoeuvre_nn.core.channels import MEASURED
from manoeuvre_nn.diagnosis import decision
from manoeuvre_nn.diagnosis.decision import decide
from manoeuvre_nn.diagnosis.formula import short_formula
from manoeuvre_nn.diagnosis.search import _calm_water
from manoeuvre_nn.estimation.data_set import whitened_data_set
from manoeuvre_nn.estimation.prepared_run import prepared_run
from manoeuvre_nn.recording.preparation import measured, with_measured

pytestmark = pytest.mark.usefixtures("unchecked_types")
RATE = MEASURED.index("r")


def seen(scale: float):
    """A zigzag of which the rate gyro shows so much of the yaw rate."""
    true = sailed([ZIGZAG])[0]
    run = run_of(true, NOISE, seed=1)
    values = measured(run)
    values[:, RATE] += (scale - 1) * measured(true)[:, RATE]
    return with_measured(run, values)


@pytest.mark.parametrize("scale", [0.1, 1.9])
def test_a_rate_gyro_of_another_scale_is_no_noise_and_turns_no_ship(scale):
    far_off, as_it_was = (prepared_run(CALM, seen(share)) for share in (scale, 1.0))
    assert far_off.inflation[RATE] < 1.4
    assert far_off.noise[RATE] == approx(as_it_was.noise[RATE], rel=0.1)
    track, expected = (p.linearised.track[:, 2] for p in (far_off, as_it_was))
    assert np.abs(track - expected).max() < 0.05 * np.abs(expected).max()


@pytest.mark.parametrize("scale", [0.1, 1.9])
def test_its_error_is_found_as_a_formula_about_the_smoothed_states(scale):
    likelihood, none = _calm_water(whitened_data_set(CALM, [seen(scale)])).smoothed
    rule = short_formula(likelihood, none)
    effect, values = rule.hypothesis.effects[0], rule.hypothesis.values[0][0]
    assert effect.terms == ("sensor r r",) and rule.evidence > none.evidence + 1000
    shown = values[0] * effect.unit_of("sensor r r", likelihood.data_set.runs[0].linearised.situation)[1]["r"].numpy()
    true = likelihood.data_set.runs[0].linearised.track[:, 2]
    assert shown == approx((scale - 1) * true, rel=0.02, abs=1e-4)


@pytest.mark.parametrize("more, chosen", [(13.0, "heading_bias"), (11.0, "log_scale"), (None, "log_scale")])
def test_the_formula_is_that_of_the_smoothed_states_where_it_is_clearly_likelier_about_these(monkeypatch, more, chosen):
    smoothed = SimpleNamespace(data_set=SimpleNamespace())
    rules = {id(smoothed): None if more is None else fitted(50.0 + more, "heading_bias")}
    monkeypatch.setattr(decision, "beside", lambda likelihood, h: likelihood)
    monkeypatch.setattr(
        decision, "short_formula", lambda likelihood, none: rules.get(id(likelihood), fitted(50.0, "log_scale"))
    )
    monkeypatch.setattr(decision, "random_force", lambda *_: None)
    monkeypatch.setattr(decision, "unknown_evidence", lambda *_: 20.0)
    monkeypatch.setattr(decision, "_by_usual_receiver", lambda *_: (0.0, 0.0))
    result = replace(found(), smoothed=(smoothed, fitted(-1.0)))
    result.likelihood.data_set.dynamics = CALM
    assert decide(result).formula.names == (chosen,)
