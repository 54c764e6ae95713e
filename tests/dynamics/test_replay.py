"""Predictions that are driven by a recorded rudder."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from fleet import unchecked
from tiers import mainly

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.dynamics.limits import OK
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.replay import blade_series, integrate, replay
from manoeuvre_nn.dynamics.simulate import simulate
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.effect.rudder import RudderBacklash
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.scoring.held_out import HeldOut
from manoeuvre_nn.ship.container import container
from manoeuvre_nn.ship.esso_190k import esso_190k
from manoeuvre_nn.ship.mariner import WANG, mariner
from manoeuvre_nn.ship.taylor import TaylorShip


def measured(record):
    """The recording as a towing tank would hand it over: without the helmsman's plan."""
    return replace(record, meta={k: v for k, v in record.meta.items() if k != "manoeuvre"})


@pytest.fixture(scope="module")
def runs():
    with unchecked():
        trials = zigzag(20.0, duration=120.0), turning_circle(25.0, duration=200.0)
        return [measured(simulate(CalmWater(mariner()), trial)) for trial in trials]


def test_the_ship_that_made_the_recordings_repeats_them_whatever_their_lengths(runs):
    with unchecked():
        again = replay(CalmWater(mariner()), runs)
    for run, own in zip(runs, again, strict=True):
        assert own.status == OK
        assert len(own) == len(run)
        # The rudder is linear between samples of 1 s, its kinks are not on them: a little is lost.
        assert np.hypot(own["x"] - run["x"], own["y"] - run["y"]).max() < 0.01 * WANG.length


def test_a_replay_may_take_over_in_the_middle(runs):
    with unchecked():
        (own,) = replay(CalmWater(mariner()), runs[1:], start=100.0)
    assert own.time[0] == 100.0
    assert own["x"][0] == runs[1]["x"][100]
    assert np.hypot(own["x"] - runs[1]["x"][100:], own["y"] - runs[1]["y"][100:]).max() < 0.001 * WANG.length


def test_nothing_can_be_replayed_after_the_end(runs):
    with pytest.raises(InputError, match="nothing is left after 500 s"):
        replay(CalmWater(mariner()), runs, start=500.0)


def test_a_ship_that_breaks_down_is_ended_and_its_numbers_stay_finite(runs):
    broken = TaylorShip(
        WANG, {"mx": 0.177, "my": 0.327, "mz": 0.0175}, {"N": {"r": 1.0, "d": -0.03}},
        positive_rudder_turns_to="port",
    )  # fmt: skip
    with unchecked():
        own = replay(CalmWater(broken), runs)
    assert all("left the physical range" in run.status for run in own)
    assert all(np.isfinite(run[name]).all() for run in own for name in ("u", "v", "r", "x", "y", "psi"))


def test_steered_and_replayed_references_keep_their_order(runs):
    with unchecked():
        steered = simulate(CalmWater(mariner()), zigzag(10.0, duration=100.0))
        held_out = HeldOut((runs[1], steered, runs[0]), WANG.length)
        scores = held_out.score(held_out.predict(CalmWater(mariner())))
    assert [s.manoeuvre for s in scores] == ["tc25", "zz10", "zz20"]
    assert all(s.dev_L < 0.01 for s in scores)


def test_a_blade_with_play_is_behind_the_indicator_by_half_of_it():
    """Once the play is taken up, and whichever way it goes."""
    vessel = Vessel(CalmWater(mariner()), [RudderBacklash(mariner(), width_deg=4.0)])
    shown = torch.tensor([[0.0, 5.0, 10.0, 15.0, 10.0, 5.0, -5.0]], dtype=torch.float64) * DEGREE
    with unchecked():
        blade = blade_series(vessel, shown, shown, 2.0)
    behind = torch.tensor([[-2.0, -2.0, -2.0, 2.0, 2.0, 2.0]], dtype=torch.float64) * DEGREE
    torch.testing.assert_close(blade[:, 1:], shown[:, 1:] + behind)


@pytest.mark.parametrize(("largest", "per_sample"), [(None, 4), (2.0, 2), (4.0, 1)])
def test_steps_are_as_long_as_they_may_be_and_end_at_samples(largest, per_sample):
    """L/U0 is 21 s: rollouts take 20 steps in it, so four in the 4 s between two samples."""
    called = []

    class Counted(CalmWater):
        def forward(self, state, inputs):
            called.append(state)
            return super().forward(state, inputs)

    ship, samples = mariner(), 6
    first = torch.tensor([[ship.particulars.speed, 0.0, 0.0, 0.0, 0.0, 0.0]], dtype=torch.float64)
    columns = {"delta": torch.full((1, samples), 0.2, dtype=torch.float64)}
    with torch.no_grad():
        states = integrate(Counted(ship), first, columns, interval=4.0, start=0.0, largest_step=largest)
    assert len(states) == samples
    assert len(called) == 4 * per_sample * (samples - 1)


@pytest.mark.parametrize(
    "make, samples", mainly(2, [(mariner, 31), (mariner, 33), (esso_190k, 202), (mariner, 202), (container, 202)])
)
def test_a_step_over_several_samples_leads_to_the_same_states_at_all_of_them(make, samples):
    """With a rudder that kinks at samples; a last step is shorter where they do not fill it."""
    called, ship = [], make()

    class Counted(CalmWater):
        def forward(self, state, inputs):
            called.append(state)
            return super().forward(state, inputs)

    largest = 0.1 * ship.particulars.time_unit
    first = torch.tensor([[ship.particulars.speed, 0.0, 0.0, 0.0, 0.0, 0.0]], dtype=torch.float64)
    rudder = np.radians(np.clip(40.0 * np.sin(0.05 * np.arange(samples)), -20.0, 20.0))
    columns = {"delta": torch.tensor(rudder)[None]}
    with torch.no_grad():
        few = integrate(Counted(ship), first, columns, interval=0.5, start=0.0, largest_step=largest)
        steps = len(called) / 4
        many = integrate(CalmWater(ship), first, columns, interval=0.5, start=0.0, largest_step=0.25)
    assert len(few) == len(many) == samples and steps == -(-(samples - 1) // int(largest / 0.5 + 1e-9))
    assert float((few - many)[:, 0, 3:5].abs().max()) < 1e-4 * ship.particulars.length
    assert np.degrees(float((few - many)[:, 0, 5].abs().max())) < (2e-3 if make is mariner else 4e-3)
