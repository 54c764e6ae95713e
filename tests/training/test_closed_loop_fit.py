"""fit=closed_loop on recordings with noise: through Lightning and without it, resumed, at two speeds, refused."""

from dataclasses import replace
from functools import cache
from io import StringIO
from pathlib import Path
from shutil import copytree

import numpy as np
import pytest
import tiny
import torch
import yaml
from fleet import unchecked
from rich.console import Console

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.dynamics.model import CalmWater, IdentifiedShip
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.estimation.agreement import birge_scaled_covariance
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.network.series import Series, SeriesSettings
from manoeuvre_nn.recording.noise import add_noise
from manoeuvre_nn.scoring.score import score
from manoeuvre_nn.ship.known import clarke_inertia_part, clarke_part
from manoeuvre_nn.ship.mariner import mariner
from manoeuvre_nn.training import closed_loop_fit
from manoeuvre_nn.training.checkpoint import load_weights
from manoeuvre_nn.training.closed_loop_fit import (
    DEFAULT_SETTINGS,
    RESTING,
    ClosedLoopFit,
    ClosedLoopSettings,
    as_stored,
    explained,
    fit_series,
)
from manoeuvre_nn.training.data import DataSettings, SimulatedData
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
    return Series(SeriesSettings(**kept, members=members))


def blank(known=KNOWN):
    return IdentifiedShip(known, abkowitz(), approach_scaling(known))


@cache
def noisy():
    with unchecked():
        settings = DataSettings(noise=NOISE)
        data = SimulatedData(SHIP, KNOWN, [zigzag(35.0)], [turning_circle(25.0, duration=200.0)], settings=settings)
        data.setup()
    return data


@cache
def short(noise):
    length = 90.0 if noise == 1 else 400.0  # so long that its stretches have a say
    return tiny.simulated(noise={channel: noise * sd for channel, sd in NOISE.items()}, length=length)


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    fit = ClosedLoopFit(blank())
    folder = tmp_path_factory.mktemp("fit")
    done, scorer = tiny.train(fit, folder, data=noisy(), max_epochs=20, every=20, keep="last")
    return done, scorer, folder


def test_a_turning_circle_is_predicted_from_one_noisy_zigzag(trained):
    done, scorer, _ = trained
    assert done.stopped == RESTING
    assert scorer.scores[0].dev_L < 0.4
    assert max(scorer.scores[0].nrmse[k] for k in ("u", "v", "r")) < 0.12
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


def test_it_is_computed_on_the_processor_although_a_gpu_is_asked_for_and_says_so(tmp_path, monkeypatch):
    monkeypatch.setattr("manoeuvre_nn.training.session._has_gpu", lambda kind: True)  # there is none
    console = Console(file=StringIO(), width=200)
    done, _ = tiny.train(
        ClosedLoopFit(blank()), tmp_path, data=short(1), max_epochs=1, accelerator="gpu", console=console
    )
    assert done.epochs == 1
    assert "trainer.accelerator=gpu: this fit is computed on the processor" in console.file.getvalue()


def lost(epoch):
    """A callback that pulls the plug when an epoch is stored."""

    def pull(now, trainer):
        if now == epoch:
            raise KeyError("pulled the plug")

    return tiny.Each(pull)


LATE = replace(DEFAULT_SETTINGS, delays=["psi"], offsets=["r"])
FIXED = replace(DEFAULT_SETTINGS, learn_force=False, learn_floor=False, force=(1e-3, 1e-3, 3e-3))


@pytest.mark.parametrize(
    ("settings", "noise", "epochs", "kept"),
    [
        (DEFAULT_SETTINGS, 1.0, 40, 3),
        pytest.param(DEFAULT_SETTINGS, 0.1, 9, 5, marks=pytest.mark.slow),
        (LATE, 1.0, 4, 2),
        pytest.param(FIXED, 1.0, 4, 3, marks=pytest.mark.slow),
    ],
    ids=["until it rests", "past a change of the floor", "sensors' errors", "nothing learnt of the noise"],
)
def test_a_fit_that_was_killed_goes_on_as_if_it_had_not_been_bit_for_bit(settings, noise, epochs, kept, tmp_path):
    straight, killed, resumed = (ClosedLoopFit(blank(), settings) for _ in range(3))
    common = {"data": short(noise), "every": 99, "keep": "last", "max_epochs": epochs}
    done, _ = tiny.train(straight, tmp_path / "straight", **common)
    assert (straight.estimate.floor < straight.problem.floor).any() == (noise < 1)
    with pytest.raises(KeyError, match="plug"):
        tiny.train(killed, tmp_path / "killed", extra=[lost(kept)], **common)
    again, _ = tiny.train(resumed, tmp_path / "killed", **common)
    assert again.epochs == done.epochs > kept and again.stopped == done.stopped
    assert again.history == done.history
    ours, theirs = (as_stored(fit.estimate) for fit in (resumed, straight))
    for name, value in theirs.items():
        torch.testing.assert_close(ours[name], value, rtol=0, atol=0, msg=name)
    for name, value in straight.state_dict().items():
        assert torch.equal(resumed.state_dict()[name], value), name


def test_a_fit_that_was_killed_when_it_had_come_to_rest_makes_no_further_pass(trained, tmp_path):
    done, _, folder = trained
    copytree(folder / "checkpoints", tmp_path / "checkpoints")
    again, _ = tiny.train(ClosedLoopFit(blank()), tmp_path, data=noisy(), max_epochs=20, every=20, keep="last")
    assert (again.epochs, again.stopped, again.history) == (done.epochs, RESTING, done.history)
    assert torch.equal(again.fit.values, done.fit.values) and torch.equal(again.fit.covariance, done.fit.covariance)
    tuples = noisy().tuples
    ours, theirs = (fit.relative_rmse(tuples.inputs, tuples.targets) for fit in (again.fit, done.fit))
    assert torch.equal(ours, theirs)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda stored: stored.pop("estimate"), "its states are missing, as in those of earlier versions"),
        (lambda stored: stored["estimate"].pop("floor"), "its states are missing"),
        (lambda stored: stored["estimate"]["noise"].fill_(torch.nan), "estimate.noise is damaged"),
        (lambda stored: stored["estimate"].update(passes="3"), "estimate.passes is damaged"),
        (lambda stored: stored["estimate"].update(states=(torch.ones(7, 9),)), "estimate.states is damaged"),
    ],
)  # fmt: skip
def test_a_checkpoint_without_where_the_fit_was_is_refused_to_go_on_from_and_is_still_a_model(
    trained, change, told, tmp_path
):
    done, _, folder = trained
    stored = torch.load(folder / "checkpoints" / "last.ckpt", weights_only=True)
    change(stored)
    torch.save(stored, tmp_path / "old.ckpt")
    with pytest.raises(InputError, match=f"{told}.*write trainer.resume=never"):
        tiny.train(ClosedLoopFit(blank()), tmp_path, data=noisy(), max_epochs=40, resume=str(tmp_path / "old.ckpt"))
    load_weights(model := ClosedLoopFit(blank()), tmp_path / "old.ckpt")
    assert torch.equal(model.network.coefficients, done.fit.network.coefficients)


def test_members_are_as_far_apart_as_runs_disagree():
    """The rudder of the second run was written down a third too small: no coefficients are right for both."""
    with unchecked():
        runs = roll_out(CalmWater(SHIP), [replace(zigzag(a), duration=300.0) for a in (35.0, 30.0)])
        one, other = (add_noise(r, SI, seed=k) for k, r in enumerate(runs))
        settings = replace(DEFAULT_SETTINGS, floor=tuple(0.1 * f for f in DEFAULT_SETTINGS.floor))
        recorded = [one, other.with_channels(delta=other["delta"] / 1.5)]
        model, found = fit_series(abkowitz(40), KNOWN, recorded, settings=settings)
        problem = explained(model, recorded, settings)
        covariance, agreement = birge_scaled_covariance(problem, found)
    assert agreement.ratio > 2 and agreement.degrees > 1
    count = problem.shared
    narrow, wide = abkowitz(40), abkowitz(40)
    for series, of in ((narrow, found.covariance[:count, :count]), (wide, covariance)):
        series.take(torch.as_tensor(found.values[:count]), torch.as_tensor(of))
    torch.testing.assert_close(model.network.coefficients, wide.coefficients)
    rudder = narrow.names.index((2, "d"))
    spread = [s.coefficients[:, s.used].detach()[1:, rudder].std() for s in (narrow, wide)]
    assert spread[1] > 1.2 * spread[0]


@pytest.mark.slow
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
    with pytest.raises(InputError, match="ClosedLoopFit does not train a Perceptron"):
        ClosedLoopFit(tiny.dynamics(tiny.usual()))
    with pytest.raises(InputError, match="linear=clarke_inertia"):
        ClosedLoopFit(blank(clarke_part(SHIP)))
    with pytest.raises(InputError, match=r"fit\.delays"):
        ClosedLoopFit(blank(), ClosedLoopSettings(delays=["heading"]))
    with pytest.raises(InputError, match=r"fit\.force=\[1\.0, 2\.0\]: expected 3 numbers"):
        ClosedLoopFit(blank(), ClosedLoopSettings(force=[1.0, 2.0]))
    with pytest.raises(InputError, match="relative=0.0"):
        ClosedLoopFit(blank(), ClosedLoopSettings(prior={"relative": 0.0, "size": 1.0}))
    for beyond in ({"prior": {"relative": 1e308}}, {"force_time": 1e9}, {"floor": [1e9] * 6}):
        with pytest.raises(InputError, match=r"to 1e\+06"):
            ClosedLoopSettings(**beyond)


def test_stretches_are_compared_once_where_a_series_has_no_members(tmp_path, monkeypatch):
    """It costs as much as a third of a pass; with members it is needed in every pass."""
    looked = []
    monkeypatch.setattr(
        closed_loop_fit, "birge_scaled_covariance", lambda *a: looked.append(1) or birge_scaled_covariance(*a)
    )
    fit = ClosedLoopFit(IdentifiedShip(KNOWN, abkowitz(1), approach_scaling(KNOWN)))
    tiny.train(fit, tmp_path, data=noisy(), max_epochs=4, every=9, keep="last")
    assert len(looked) == 1
