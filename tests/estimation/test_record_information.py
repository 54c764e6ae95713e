"""Which coefficients a record can identify: errors are honest, and another manoeuvre helps as is said."""

from dataclasses import replace

import numpy as np
import pytest
from fleet import unchecked

from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.estimation.record_information import LINEAR_TERMS, excitation_findings, identifiable
from manoeuvre_nn.manoeuvre.straight import straight
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.recording.noise import add_noise
from manoeuvre_nn.ship.known import clarke_part
from manoeuvre_nn.ship.mariner import mariner_corrected

NOISE = {"u": 0.05, "v": 0.05, "r": 0.02 * DEGREE, "psi": 0.1 * DEGREE}
SHIP = mariner_corrected()
KNOWN = clarke_part(SHIP)


@pytest.fixture(scope="module")
def runs():
    trials = {
        "zz5": zigzag(5.0, duration=400.0), "tc25": turning_circle(25.0, duration=400.0),
        "straight": straight(duration=400.0),
    }  # fmt: skip
    with unchecked():
        sailed = roll_out(CalmWater(SHIP), list(trials.values()), step=0.5)
    even = np.arange(0.0, 400.1, 1.0)
    unit = SHIP.particulars.time_unit
    return {
        name: replace(run.resampled(even), meta={**run.meta, "time_unit": unit})
        for name, run in zip(trials, sailed, strict=True)
    }


def noisy(run, seed=0):
    return add_noise(run, NOISE, seed=seed)


def test_errors_are_what_estimates_scatter_by(runs):
    with unchecked():
        told = [identifiable([noisy(runs["tc25"], seed)], KNOWN, LINEAR_TERMS) for seed in range(40)]
    scatter, error = np.std([t.values for t in told], axis=0), np.mean([t.errors for t in told], axis=0)
    ratio = dict(zip(told[0].names, scatter / error, strict=True))
    assert all(0.4 < r < 1.5 for r in ratio.values()), ratio


def test_a_turning_circle_beside_a_weak_zigzag_tells_drift_from_turning(runs):
    with unchecked():
        alone = identifiable([noisy(runs["zz5"])], KNOWN, LINEAR_TERMS)
        (advice, _) = excitation_findings([noisy(runs["zz5"])], KNOWN)
        both = identifiable([noisy(runs["zz5"]), noisy(runs["tc25"], 1)], KNOWN, LINEAR_TERMS)
    assert any(pair[:2] == ("Y_v", "Y_r") for pair in alone.pairs) and "Y_v and Y_r (+0.9" in advice.text
    assert "add a turning circle or a spiral" in advice.remedy and advice.verdict == "note"
    assert not any(pair[:2] == ("Y_v", "Y_r") for pair in both.pairs)
    assert len(both.identified) > len(alone.identified)


def test_a_straight_run_identifies_nothing_and_a_zigzag_is_advised(runs):
    with unchecked():
        (advice, _) = excitation_findings([noisy(runs["straight"])], KNOWN)
    assert advice.remedy == "add a zigzag: the rudder does not move" and "Y_d" in advice.text.partition("; not ")[2]
