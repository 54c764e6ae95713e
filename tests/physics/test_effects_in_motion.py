"""Ships on which something acts, in all three solutions: what must hold whatever the effect's formula is."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from fleet import TRIALS, distance, ship_named, unchecked, without_offsets
from pytest import approx
from tiers import mainly

from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.replay import replay
from manoeuvre_nn.dynamics.rollout import roll_out, rollout
from manoeuvre_nn.dynamics.simulate import simulate
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.effect.current import Current, TidalCurrent
from manoeuvre_nn.effect.propulsion import PowerLimit
from manoeuvre_nn.effect.roll import RollCoupling
from manoeuvre_nn.effect.rudder import RudderBacklash, RudderDelay, RudderOffset, RudderSlow
from manoeuvre_nn.effect.sensors import GpsDelay, HeadingBias
from manoeuvre_nn.effect.waves import WaveDrift
from manoeuvre_nn.effect.wind import SteadyWind, WindOnset
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag

MAINLY_ONE = pytest.mark.parametrize("name", mainly(1, ["esso_190k", "mariner", "great_lakes_bulker"]))
SOME = (SteadyWind, TidalCurrent, RudderSlow, RudderBacklash, RudderOffset, PowerLimit, RollCoupling, WaveDrift,
        HeadingBias, RudderDelay, GpsDelay)  # fmt: skip
"""Effects of every site, with and without own states."""
MOTION = ("u", "v", "r", "x", "y", "psi", "delta", "delta_order", "udot", "vdot", "rdot")
ZIGZAG = zigzag(20.0, duration=60.0)


def affected(name, *effects) -> Vessel:
    """A ship with effects that are given as (class, values)."""
    ship = ship_named(name)
    return Vessel(CalmWater(ship), [kind(ship, **values) for kind, values in effects])


def batched(dynamics, *trials, step=None):
    with unchecked():
        return roll_out(dynamics, trials, step=step)


def accurate(dynamics, trial):
    with unchecked():
        return simulate(dynamics, trial)


def measured(record):
    """The recording without the helmsman's plan."""
    return replace(record, meta={})


@MAINLY_ONE
def test_effects_at_their_null_leave_every_trial_as_it_is(name):
    ship = ship_named(name)
    null = [kind(ship) for kind in SOME]
    dynamics = Vessel(CalmWater(ship), [effect.at(effect.null()) for effect in null])
    step = min(ship.particulars.time_unit / 20, ship.particulars.sample_interval)
    trials = [replace(trial, duration=min(trial.duration, 60.0)) for trial in TRIALS.values()]
    runs = batched(dynamics, *trials, step=step)
    for run, calm in zip(runs, batched(CalmWater(ship), *trials, step=step), strict=True):
        assert (run.status, len(run)) == (calm.status, len(calm))
        for channel in MOTION:
            assert run[channel] == approx(calm[channel], abs=1e-6), (calm.name, channel)
    if name == "mariner":
        short = zigzag(20.0, 5.0, duration=40.0)
        assert distance(accurate(dynamics, short), accurate(CalmWater(ship), short)) < 1e-3


@MAINLY_ONE
def test_a_current_that_grows_evenly_moves_the_track_and_nothing_else(name):
    """By V t + c t^2 / 2, which fixed steps integrate exactly, the parts of steps at a reversal too."""
    tide = dict(speed=1.0, toward_deg=30.0, change=3.0)
    calm, moved = CalmWater(ship_named(name)), affected(name, (TidalCurrent, tide))
    trials = ZIGZAG, turning_circle(25.0, duration=60.0)
    exact = accurate(moved, ZIGZAG), accurate(calm, ZIGZAG)
    late = measured(exact[1].between(20.0, 60.0))  # whose time counts from its first sample
    with unchecked():
        replayed = [replay(dynamics, [late], start=10.0)[0] for dynamics in (moved, calm)]
    pairs = list(zip(batched(moved, *trials), batched(calm, *trials), strict=True))
    for run, still, began, error in [(*p, 0.0, 1e-8) for p in pairs] + [(*exact, 0.0, 1e-4), (*replayed, 10.0, 1e-8)]:
        for channel in ("u", "v", "r", "psi", "delta", "udot", "vdot", "rdot"):
            assert run[channel] == approx(still[channel], abs=1e-6), channel
        t = run.time - run.time[0] + began
        drift = 1.0 * (t - began) + 3.0 / 3600 * (t**2 - began**2) / 2
        assert run["x"] - still["x"] == approx(drift * np.cos(30 * DEGREE), abs=error)
        assert run["y"] - still["y"] == approx(drift * np.sin(30 * DEGREE), abs=error)


@MAINLY_ONE
def test_a_mirrored_wind_and_the_mirrored_zigzag_give_the_mirrored_track(name):
    calm = without_offsets(ship_named(name))

    def run(side, sign):
        wind = SteadyWind(calm, speed=12.0, from_deg=sign * 70.0 % 360)
        effects = [wind, Current(calm, toward_deg=sign * 20.0 % 360), RudderBacklash(calm, width_deg=3.0)]
        return batched(Vessel(CalmWater(calm), effects), zigzag(20.0, first=side, duration=80.0))[0]

    starboard, port = run("starboard", 1), run("port", -1)
    for channel, sign in {"u": 1, "x": 1, "vn": 1, "v": -1, "r": -1, "y": -1, "ve": -1, "psi": -1, "vdot": -1}.items():
        assert port[channel] == approx(sign * starboard[channel], abs=1e-8), channel
    assert distance(starboard, batched(CalmWater(calm), zigzag(20.0, duration=80.0))[0]) > 5.0, "the wind matters"


BLADES = [
    ("mariner", (RudderSlow, {})),
    ("great_lakes_bulker", (RudderBacklash, dict(width_deg=4.0))),
    ("esso_190k", (RudderOffset, dict(offset_deg=-2.0))),
]


@pytest.mark.parametrize("name, blade", mainly(1, BLADES))
def test_the_batched_solution_is_the_accurate_one_with_wind_current_and_a_blade_of_its_own(name, blade):
    wind = (WindOnset, dict(speed=15.0, from_deg=60.0, start_s=20.0))
    dynamics = affected(name, wind, (TidalCurrent, {}), blade)
    fast, exact = batched(dynamics, ZIGZAG)[0], accurate(dynamics, ZIGZAG)
    length = dynamics.model.particulars.length
    assert fast.status == exact.status == "ok"
    assert distance(fast, exact) < 0.002 * length
    assert np.abs(fast["psi"] - exact["psi"]).max() < 0.1 * DEGREE
    assert fast["vdot"] == approx(exact["vdot"], abs=2e-3 * np.abs(exact["vdot"]).max() + 1e-4)
    without = batched(affected(name, wind, (TidalCurrent, {})), ZIGZAG)[0]
    assert distance(fast, without) > 2.0, "the blade matters"


@pytest.mark.parametrize(
    "name, own", mainly(1, [("esso_190k", (PowerLimit, dict(rpm_slope=0.8))), ("mariner", (RollCoupling, {}))])
)
def test_own_states_move_alike_in_both_solutions(name, own):
    dynamics, trial = affected(name, own), zigzag(20.0, duration=90.0)  # a tanker's engine needs as long to tell
    fast, exact = batched(dynamics, trial)[0], accurate(dynamics, trial)
    assert distance(fast, exact) < 0.002 * dynamics.model.particulars.length
    for channel in ("u", "r", "rdot", "shaft"):
        assert fast[channel] == approx(exact[channel], abs=2e-3 * np.abs(exact[channel]).max()), channel
    assert distance(fast, batched(CalmWater(ship_named(name)), trial)[0]) > 0.3, "they matter"
    with unchecked():
        (again,) = replay(dynamics, [measured(exact)])
    assert distance(again, exact) < 0.01 * dynamics.model.particulars.length


def test_gradients_of_a_rollout_by_the_values_of_effects_are_those_of_finite_differences():
    """Through the reversal, whose moment moves with the effects, a blade with a state, and an engine."""
    calm = CalmWater(ship_named("mariner"))
    kinds = [kind(calm.ship) for kind in (SteadyWind, Current, RudderSlow, PowerLimit)]
    scale = torch.tensor([10.0, 90.0, 1.0, 90.0, 1.3, 0.3, 8.0], dtype=torch.float64)
    start = torch.tensor([[7.7, 0, 0, 0, 0, 0]] * 2, dtype=torch.float64)

    def end(ones):
        *wind, speed, toward, rate, slope, lag = (ones * scale).unbind()
        form = kinds[0].values[2:].unbind()
        values = [torch.stack(v) for v in ((*wind, *form), (speed, toward), (rate,), (slope, lag))]
        ship = Vessel(calm, [e.at(v) for e, v in zip(kinds, values, strict=True)])
        trials = [zigzag(10.0, 4.0), turning_circle(15.0, "port")]
        with unchecked():
            out = rollout(
                ship, trials, ship.model.start(start, Inputs(start[:, 1])), 4.0 * torch.arange(11).double(), step=4.0
            )
        assert float(out.orders[-1, 0].detach()) < 0, "the rudder has been reversed"
        return (out.states[-1] / out.states.new_tensor([1.0, 1.0, 0.01, 10.0, 10.0, 0.1, 0.1])).sum(0)

    ones = torch.ones(7, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(end, (ones,), eps=1e-5, atol=1e-4, rtol=1e-3, fast_mode=True)
