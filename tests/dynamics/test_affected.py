"""A ship with effects as a dynamics: own states, rows of a batch, the blade, and what is written down."""

from dataclasses import replace
from functools import cache
from math import inf

import numpy as np
import pytest
import torch
from fleet import ship_named, unchecked
from pytest import approx

from manoeuvre_nn.core.effect import Effect, Parameter
from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.core.manoeuvre import Manoeuvre, Stage
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.dynamics.base import rate_of_state
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.replay import replay
from manoeuvre_nn.dynamics.rollout import roll_out, rollout
from manoeuvre_nn.dynamics.simulate import simulate
from manoeuvre_nn.dynamics.vessel import Vessel, as_vessel, in_words
from manoeuvre_nn.effect.current import Current
from manoeuvre_nn.effect.loading import Loading
from manoeuvre_nn.effect.propulsion import PowerLimit
from manoeuvre_nn.effect.roll import RollCoupling
from manoeuvre_nn.effect.rudder import RudderBacklash, RudderDelay, RudderOffset, RudderSlow
from manoeuvre_nn.effect.sensors import HeadingBias, LogScale, TimeSync
from manoeuvre_nn.effect.wind import SteadyWind
from manoeuvre_nn.manoeuvre.straight import straight
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.ship.mariner import mariner
from studies.reproduction.stacked import Stacked

SHIP = ship_named("mariner")
CALM = CalmWater(SHIP)
ZIGZAG = zigzag(20.0, duration=80.0)
TIMED = Manoeuvre("there and back", "random_rudder", (Stage(0.3, hold=30.0), Stage(-0.2)), duration=60.0)


def run(dynamics, manoeuvres, duration, step=1.0):
    start = torch.zeros(len(manoeuvres), 6, dtype=torch.float64)
    start[:, 0] = as_vessel(dynamics).model.particulars.speed
    times = torch.arange(0.0, duration + 1e-9, step, dtype=torch.float64)
    with unchecked():
        return rollout(
            dynamics, manoeuvres, as_vessel(dynamics).model.start(start, Inputs(start[:, 1])), times, step=step
        )


@cache
def calm(trial, solver="rollout"):
    """The ship in calm water, which several tests compare with."""
    return sailed([], trial, solver)


def sailed(effects, trial, solver="rollout"):
    dynamics = Vessel(CALM, effects) if effects else CALM
    with unchecked():
        return roll_out(dynamics, [trial])[0] if solver == "rollout" else simulate(dynamics, trial)


def measured(record):
    return replace(record, meta={})


def test_without_effects_it_is_the_calm_ship_and_its_recording():
    with unchecked():
        made = {"rollout": roll_out(Vessel(CALM, []), [ZIGZAG])[0], "simulate": simulate(Vessel(CALM, []), ZIGZAG)}
    for solver, bare in made.items():
        own = calm(ZIGZAG, solver)
        assert list(bare.channels) == list(own.channels)
        assert all(np.array_equal(bare[k], own[k]) for k in own.channels)


def test_the_state_starts_with_the_effects_own_states_behind_the_ships():
    ship = Vessel(CALM, [RollCoupling(SHIP), SteadyWind(SHIP), PowerLimit(SHIP, rpm_slope=0.2)]).model
    six = torch.tensor([7.0, 0.1, 0.01, 1.0, 2.0, 3.0], dtype=torch.float64)
    state = ship.start(six, Inputs(torch.tensor(0.0).double()))
    engine = 1 - 0.2 * (1 - 7.0 / SHIP.particulars.speed)
    assert state.tolist() == approx([*six.tolist(), 0.0, 0.0, engine])
    assert CALM.start(six, Inputs(torch.tensor(0.0).double())) is six
    assert ship(state, Inputs(torch.tensor(0.2).double())).shape == (9,)


@pytest.mark.parametrize("solver", ["rollout", "simulate"])
def test_the_blade_of_a_slow_rudder_moves_evenly_to_every_order_at_its_own_rate(solver):
    """The acceleration at every sample is the calm ship's at the blade's angle, which is known."""
    rate, t = 1.2, np.arange(0.0, 61.0)
    record = sailed([RudderSlow(SHIP, rate_deg_s=rate)], TIMED, solver)
    reach = np.minimum(rate * DEGREE * t, 0.3)
    blade = np.where(t <= 30.0, reach, np.maximum(0.3 - rate * DEGREE * (t - 30.0), -0.2))
    expected = SHIP.acceleration(torch.tensor(record.stacked("u", "v", "r")), torch.tensor(blade)).numpy()
    assert record.stacked("udot", "vdot", "rdot") == approx(expected, abs=1e-9)
    assert record["delta"] == approx(calm(TIMED, solver)["delta"]), "the indicator is not the blade"


@pytest.mark.parametrize("solver", ["rollout", "simulate"])
def test_play_of_the_rudder_is_passed_through_before_the_blade_follows(solver):
    width = 5 * DEGREE
    record = sailed([RudderBacklash(SHIP, width_deg=5.0)], TIMED, solver)
    shown = record["delta"]
    blade = np.where(
        record.time <= 30.0, np.maximum(shown - width / 2, 0.0), np.minimum(0.3 - width / 2, shown + width / 2)
    )
    expected = SHIP.acceleration(torch.tensor(record.stacked("u", "v", "r")), torch.tensor(blade)).numpy()
    assert record.stacked("udot", "vdot", "rdot") == approx(expected, abs=1e-9)


def test_effects_on_the_rudder_act_in_turn():
    """A slow blade behind an offset forgets it, an offset behind a slow blade stays."""
    slow, beside = RudderSlow(SHIP, rate_deg_s=1.0), RudderOffset(SHIP, offset_deg=2.0)
    ends = {
        order: float(run(Vessel(CALM, order), [turning_circle(20.0)], 40.0).inputs.delta[-1, 0]) / DEGREE
        for order in ((slow, beside), (beside, slow))
    }
    assert list(ends.values()) == approx([22.0, 20.0])
    at_rest = Vessel(CALM, [slow, beside, RudderBacklash(SHIP, width_deg=1.0)]).gear.at_rest(torch.zeros(2).double())
    assert at_rest.shape == (2, 3) and at_rest[0].tolist() == approx([0.0, 2 * DEGREE, 1.5 * DEGREE])


def test_a_run_starts_with_the_blade_where_it_rests():
    runs = run(Vessel(CALM, [RudderOffset(SHIP, offset_deg=3.0)]), [straight()], 40.0)
    assert (runs.inputs.delta[:, 0] / DEGREE).tolist() == approx([3.0] * 41) and (runs.shown == 0).all()
    assert runs.states[-1, 0, 5] > 1 * DEGREE + run(CALM, [straight()], 40.0).states[-1, 0, 5]


@pytest.mark.parametrize("busy", [[straight(), zigzag(20.0, 5.0), zigzag(10.0, 3.0, first="port")]])
def test_rows_of_one_batch_may_have_values_of_their_own(busy):
    """Every row reverses its rudder at its own time, so that rows are taken out of the batch and put back."""
    rows = torch.tensor([[5.0, 30.0], [15.0, 200.0], [10.0, 300.0]], dtype=torch.float64)
    kinds = [SteadyWind(SHIP), RudderSlow(SHIP, rate_deg_s=1.1), PowerLimit(SHIP, rpm_slope=0.5), Current(SHIP)]
    wind = torch.cat([rows, kinds[0].values[2:].expand(3, -1)], dim=-1)
    shared = kinds[3].at(torch.tensor([[1.0, 45.0]], dtype=torch.float64))
    together = run(Vessel(CALM, [kinds[0].at(wind), *kinds[1:3], shared]), busy, 60.0, 2.0)
    for k, trial in enumerate(busy):
        effects = [kinds[0].at(wind[k]), *kinds[1:3], kinds[3].at(shared.values[0])]
        alone = run(Vessel(CALM, effects), [trial], 60.0, 2.0)
        for name in ("states", "shown", "orders"):
            assert torch.allclose(getattr(together, name)[:, k], getattr(alone, name)[:, 0], rtol=0, atol=1e-9), name
        assert torch.allclose(together.inputs.delta[:, k], alone.inputs.delta[:, 0], rtol=0, atol=1e-9)


def test_an_affected_row_that_breaks_down_rests_and_leaves_the_others_alone():
    wild = mariner()
    wild.series.coefficients[wild.series.terms.index("r"), 2] *= -5
    effects = [SteadyWind(SHIP), RollCoupling(SHIP), RudderBacklash(SHIP, width_deg=2.0)]
    runs = run(Vessel(Stacked([CALM, CalmWater(wild)]), effects), [zigzag(20.0)] * 2, 50.0, 2.0)
    alone = run(Vessel(CALM, effects), [zigzag(20.0)], 50.0, 2.0)
    assert runs.ended[0] == inf and runs.ended[1] < 50.0 and runs.states.isfinite().all()
    assert torch.allclose(runs.states[:, 0], alone.states[:, 0], rtol=0, atol=1e-8)
    after = runs.times >= runs.ended[1]
    assert runs.states.shape[-1] == 8 and (runs.states[after, 1] == runs.states[after, 1][:1]).all()


def test_effects_act_on_the_ship_at_its_approach_speed_and_keep_their_choices():
    effects = [SteadyWind(SHIP, kind="ferry", from_deg=40.0), PowerLimit(SHIP, rpm_slope=0.8)]
    slow = Vessel(CALM, effects).on_approach(5.0)
    assert [e.ship.particulars.speed for e in slow.effects] == [5.0, 5.0]
    assert slow.effects[0].coefficients == effects[0].coefficients
    there = SHIP.on_approach(5.0)
    made = [SteadyWind(there, kind="ferry", from_deg=40.0), PowerLimit(there, rpm_slope=0.8)]
    with unchecked():
        (own,) = roll_out(Vessel(CalmWater(there), made), [zigzag(20.0, duration=40.0)])
    moved = sailed(effects, zigzag(20.0, duration=40.0).at_speed(5.0))
    assert all(np.array_equal(moved[k], own[k]) for k in own.channels)
    assert effects[0].ship is SHIP, "the original is as it was"


@pytest.mark.parametrize("solver", ["rollout", "simulate"])
def test_a_recording_with_effects_has_what_sensors_write(solver):
    record = sailed(
        [Current(SHIP, speed=1.0, toward_deg=90.0), PowerLimit(SHIP, rpm_slope=0.2)],
        turning_circle(25.0, duration=80.0),
        solver,
    )
    late = record.between(40.0, 80.0)
    for position, velocity in (("x", "vn"), ("y", "ve")):
        assert np.gradient(late[position], late.time)[1:-1] == approx(late[velocity][1:-1], abs=5e-3)
    assert np.array_equal(record["u_log"], record["u"]), "the log shows speed through the water"
    east = record["u"] * np.sin(record["psi"]) + record["v"] * np.cos(record["psi"])
    assert record["ve"] - east == approx(1.0)
    assert record["shaft"][0] == approx(1.0) and record["shaft"][-1] < 0.97


def test_sensors_change_what_is_written_down_and_not_the_motion():
    wrong = [HeadingBias(SHIP, bias_deg=2.0), LogScale(SHIP, factor=1.1), TimeSync(SHIP, offset_s=1.0)]
    true = sailed([Current(SHIP)], ZIGZAG)
    record = sailed([Current(SHIP), *wrong, RudderDelay(SHIP, delay_s=2.0)], ZIGZAG)
    for channel in ("u", "v", "x", "y", "vn", "ve", "udot", "vdot", "rdot", "delta_order", "shaft"):
        assert np.array_equal(record[channel], true[channel]), channel
    assert record["psi"] - true["psi"] == approx(2 * DEGREE)
    assert record["u_log"] == approx(1.1 * true["u"])
    assert record["r"][1:] == approx(true["r"][:-1], abs=1e-12)
    assert record["delta"][2:] == approx(true["delta"][:-2], abs=1e-12)


def test_a_replay_undoes_what_the_recorder_did_to_the_rudder():
    late = RudderDelay(SHIP, delay_s=2.5)
    record = sailed([late], ZIGZAG, "simulate")
    with unchecked():
        (own,), (blind,) = replay(Vessel(CALM, [late]), [measured(record)]), replay(CALM, [measured(record)])
    true = calm(ZIGZAG, "simulate")
    length = SHIP.particulars.length
    assert np.hypot(own["x"] - true["x"], own["y"] - true["y"]).max() < 0.01 * length
    assert np.hypot(blind["x"] - true["x"], blind["y"] - true["y"]).max() > 0.02 * length
    assert np.array_equal(own["delta"], record["delta"]), "late once, not twice"


@cache
def slowly_steered():
    """The Mariner with a slow rudder, what was recorded of her, and the calm ship's replay of it."""
    slow = RudderSlow(SHIP, rate_deg_s=1.2)
    record = sailed([slow], TIMED, "simulate")
    with unchecked():
        return slow, record, replay(CALM, [measured(record)])[0]


@pytest.mark.parametrize("known, gap", [(True, 0.6), (False, 2.0)])
def test_a_replay_follows_the_blade_closely_where_the_order_is_recorded(known, gap):
    """Without the order the indicator stands for it: the blade then sets out as the indicator does."""
    slow, record, blind = slowly_steered()
    kept = record.channels if known else {k: c for k, c in record.channels.items() if k != "delta_order"}
    with unchecked():
        (own,) = replay(Vessel(CALM, [slow]), [replace(measured(record), channels=kept)])
    gaps = [np.hypot(p["x"] - record["x"], p["y"] - record["y"]).max() for p in (own, blind)]
    assert gaps[0] < gap < 8.0 < gaps[1]


class Lurch(Effect):
    """A memory that no steady approach has, and a blade that does not move."""

    name, site, family, label, equations, fingerprint, source = "lurch", "hull", "none", "a lurch", ("X",), "", ""
    declared = (
        Parameter("size", "m/s", 0.0, 9.0, 0.0, 1.0, (2.0,)),
        Parameter("half", "-", 0.0, 1.0, 0.5, 1.0, (0.5,), form=True),
    )
    memory = 1

    def memory_at_start(self, s):
        return torch.ones_like(s.nu[..., :1])

    def memory_rate(self, s, memory):
        return -memory

    def acceleration(self, s, memory):
        return self.value("size") * memory * s.nu.new_tensor([1.0, 0.0, 0.0])


def test_an_own_state_that_decays_does_so_exactly_in_the_accurate_solution():
    """x gains s (t - 1 + exp(-t)) if surge feels nothing else."""

    class Free(CalmWater):
        def forward(self, state, inputs):
            return rate_of_state(state, torch.zeros_like(state[..., :3]))

    with unchecked():
        record = simulate(Vessel(Free(SHIP), [Lurch(SHIP)]), straight(20.0))
    t = record.time
    assert record["u"] == approx(SHIP.particulars.speed + 2 * (1 - np.exp(-t)), abs=1e-7)
    assert record["x"] == approx(SHIP.particulars.speed * t + 2 * (t - 1 + np.exp(-t)), abs=1e-6)
    assert record["udot"] == approx(2 * np.exp(-t), abs=1e-7)


def test_effects_are_named_with_their_values_and_usual_form_parameters_are_left_out():
    wind, current = SteadyWind(SHIP, speed=12.0, from_deg=45.0), Current(SHIP, speed=0.5, toward_deg=90.0)
    assert in_words([current]) == "a current (speed=0.5 m/s, toward_deg=90)"
    assert in_words([wind, current]).startswith("a steady wind (speed=12 m/s, from_deg=45) and a current (")
    three = in_words([Lurch(SHIP), Lurch(SHIP, half=0.3), current])
    assert three.startswith("a lurch (size=2 m/s), a lurch (size=2 m/s, half=0.3) and a current")


def test_what_effects_keep_from_a_batch_of_recordings_can_be_differentiated_later():
    """On another ship an effect sorts the ship's terms at its first use, which here is in a batch without gradients."""
    slow = Vessel(CALM, [Loading(SHIP, draught_ratio=1.1)]).on_approach(5.0)
    with unchecked():
        roll_out(slow, [straight(5.0)])
    state = torch.tensor([5.0, 0.3, 0.01, 0.0, 0.0, 0.0], dtype=torch.float64, requires_grad=True)
    slow.model(state, Inputs(torch.tensor(0.1).double()))[1].backward()
    assert state.grad.abs().sum() > 0
