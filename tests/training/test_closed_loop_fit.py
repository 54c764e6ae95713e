"""fit=closed_loop on recordings with noise: through Lightning and without it, resumed, at two speeds, refused."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import tiny
import yaml
from fleet import unchecked

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.dynamics.model import CalmWater, IdentifiedShip
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.network.series import Series
from manoeuvre_nn.recording.noise import add_noise
from manoeuvre_nn.recording.score import score
from manoeuvre_nn.ship.known import clarke_inertia_part, clarke_part
from manoeuvre_nn.ship.mariner import mariner
from manoeuvre_nn.training.data import SimulatedData
from manoeuvre_nn.training.joint_fit import RESTING, ClosedLoopFit, fit_series
from manoeuvre_nn.training.scalings import approach_scaling

SHIP = mariner()
KNOWN = clarke_inertia_part(SHIP)
NOISE = {"u": 0.02, "v": 0.02, "r_deg_s": 0.02, "psi_deg": 0.5, "x": 0.5, "y": 0.5}
SI = {"u": 0.02, "v": 0.02, "r": 3.5e-4, "psi": 9e-3, "x": 0.5, "y": 0.5}
"""About 2 % of the standard deviation of u, v, r, psi in a 35/35 zigzag, and half a metre."""


def abkowitz(members=4):
    conf = Path(__file__).parents[2] / "conf" / "network" / "abkowitz.yaml"
    given = yaml.safe_load(conf.read_text())["network"]
    kept = {k: given[k] for k in ("surge", "lateral")}
    return Series(**kept, members=members)


def blank(known=KNOWN):
    return IdentifiedShip(known, abkowitz(), approach_scaling(known))


@cache
def noisy():
    with unchecked():
        data = SimulatedData(SHIP, KNOWN, [zigzag(35.0)], [turning_circle(25.0, duration=200.0)], noise=NOISE)
        data.setup()
    return data


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    fit = ClosedLoopFit(blank())
    folder = tmp_path_factory.mktemp("fit")
    done, judge = tiny.train(fit, folder, data=noisy(), max_epochs=20, every=20, keep="last")
    return done, judge, folder


def test_a_turning_circle_is_predicted_from_one_noisy_zigzag(trained):
    done, judge, _ = trained
    assert done.stopped == RESTING
    assert judge.scores[0].dev_L < 0.4
    assert max(judge.scores[0].nrmse[k] for k in ("u", "v", "r")) < 0.12
    assert int(done.fit.network.trained) == 4


def test_it_is_the_same_without_lightning(trained):
    done, *_ = trained
    with unchecked():
        model, found = fit_series(abkowitz(), KNOWN, noisy().measured, passes=done.epochs)
    np.testing.assert_allclose(found.values, done.fit.values, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(
        model.network.coefficients.detach(), done.fit.network.coefficients.detach(), rtol=1e-6, atol=1e-9
    )


def test_what_the_model_lacks_is_little_on_a_ship_of_its_own_kind(trained):
    done, *_ = trained
    tuples = noisy().tuples
    assert (done.fit.relative_rmse(tuples.inputs, tuples.targets) < 0.1).all()


def test_a_fit_that_was_left_goes_on_from_its_coefficients(trained, tmp_path):
    done, *_ = trained
    half = ClosedLoopFit(blank())
    tiny.train(half, tmp_path, data=noisy(), max_epochs=3, every=9, keep="last")
    again = ClosedLoopFit(blank())
    tiny.train(again, tmp_path, data=noisy(), max_epochs=20, every=9, keep="last")
    errors = np.sqrt(np.diag(done.fit.covariance.numpy()))
    assert np.abs((again.values - done.fit.values).numpy() / errors).max() < 0.05


def test_runs_at_two_speeds_are_one_model_that_knows_a_third():
    own = CalmWater(SHIP)
    u0 = SHIP.particulars.speed
    with unchecked():
        runs = [replace(zigzag(30.0, duration=400.0), speed=s * u0, name=f"zz{s}") for s in (1.0, 0.6)]
        recorded = [add_noise(r, SI, seed=k) for k, r in enumerate(roll_out(own, runs))]
        model, _ = fit_series(abkowitz(1), KNOWN, recorded)
        third = replace(turning_circle(20.0, duration=300.0), speed=0.8 * u0)
        (truth,), (made,) = roll_out(own, [third]), roll_out(model, [third])
    assert score(made, truth, SHIP.particulars.length).dev_L < 0.25


def test_settings_that_make_no_sense_are_refused():
    with pytest.raises(InputError, match="network=cubic, modulus or abkowitz"):
        ClosedLoopFit(tiny.dynamics(tiny.usual()))
    with pytest.raises(InputError, match="linear=clarke_inertia"):
        ClosedLoopFit(blank(clarke_part(SHIP)))
    with pytest.raises(InputError, match=r"fit\.delays"):
        ClosedLoopFit(blank(), delays=["heading"])
    with pytest.raises(InputError, match=r"fit\.force=\[1\.0, 2\.0\]: expected 3 numbers"):
        ClosedLoopFit(blank(), force=[1.0, 2.0])
    with pytest.raises(InputError, match="relative=0.0"):
        ClosedLoopFit(blank(), prior={"relative": 0.0, "size": 1.0})
