"""Runs of a recursive network: by recorded controls, and by a helmsman."""

from dataclasses import replace
from math import pi

import numpy as np
import pytest
import torch

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.dynamics.limits import OK
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.recursive import RecursiveShip
from manoeuvre_nn.dynamics.replay import replay
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.dynamics.simulate import simulate
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.manoeuvre.straight import straight
from manoeuvre_nn.manoeuvre.turning import tactical_circle
from manoeuvre_nn.manoeuvre.zigzag import overshoot, zigzag
from manoeuvre_nn.network.force_modules import BasicForces
from manoeuvre_nn.network.recursive import RecursiveNetwork, RecursiveSettings
from manoeuvre_nn.ship.container import container

SHIP = container(2)
LENGTH, SPEED = SHIP.particulars.length, SHIP.particulars.speed
RATE = 0.4
"""Yaw rate over U0/L that the network below answers a full rudder with."""


class _Fixed(RecursiveNetwork):
    """Speed kept; yaw rate in proportion to the lift of the starboard rudder; heel by nothing."""

    def answer(self, x, folded):
        lift = x[:, self.input_names.index("lift_starboard-0")]
        zero = torch.zeros_like(lift)
        return torch.stack([zero + 1, zero, zero, self.gain * lift], dim=-1)


def turning(gain=RATE):
    network = _Fixed(RecursiveSettings(hidden=(1,)), dtype=torch.float64)
    made = RecursiveShip(SHIP, network)
    controls = torch.tensor([[35 * DEGREE, 35 * DEGREE, *2 * [SHIP.shaft_rpm / 60 * LENGTH / SPEED]]]).double()
    ahead = torch.tensor([[1.0, 0.0, 0.0, 0.0]], dtype=torch.float64)
    full = made.forces(ahead, torch.zeros(1, 2).double(), controls, made.froude(torch.tensor([SPEED]).double()))
    network.gain = gain / float(full[0, 2])
    return made


@pytest.fixture(scope="module")
def ship():
    return turning()


@pytest.fixture(scope="module")
def circle(ship):
    return simulate(ship, tactical_circle(35.0))


def test_a_circle_ends_when_the_heading_has_come_round(circle):
    run = circle
    assert run.status == OK and run.meta["kind"] == "turning_circle"
    assert run["psi"][-1] == pytest.approx(540 * DEGREE, abs=run["r"][-1])
    assert run["u"] == pytest.approx(np.full(len(run), SPEED))
    moved = run["delta"] > 1e-9
    assert run.time[moved][0] == 61.0 and run["delta"].max() == pytest.approx(35 * DEGREE)
    assert np.diff(run["delta"]).max() == pytest.approx(SHIP.particulars.rudder_rate)


def test_a_run_has_the_accelerations_of_what_it_has_velocities_of(circle):
    run = circle
    assert {name for name in run.channels if name.endswith("dot")} == {"udot", "vdot", "pdot", "rdot"}
    assert run["rdot"] == pytest.approx(np.gradient(run["r"], run.time), abs=0.1 * np.ptp(run["rdot"]))
    assert np.abs(run["udot"]).max() < 1e-9 < np.abs(run["rdot"]).max()


def test_the_helmsman_reverses_at_the_heading_that_the_network_predicts(ship):
    run = simulate(ship, zigzag(20.0))
    changed = np.flatnonzero(np.diff(run["delta_order"]))
    at = run.time[changed]  # the last sample before the reversal
    assert len(changed) >= 3
    for time, sign in zip(at[:3], (1, -1, 1), strict=True):
        before, after = (sign * np.interp(t, run.time, run["psi"]) for t in (time, time + 1.0))
        assert before <= 20 * DEGREE <= after + 0.1 * DEGREE


def test_manoeuvres_of_several_speeds_are_one_batch(ship):
    wanted = [overshoot(20.0).at_speed(SPEED), overshoot(20.0, first="port").at_speed(0.6 * SPEED)]
    both = roll_out(ship, wanted)
    for run, manoeuvre in zip(both, wanted, strict=True):
        alone = simulate(ship, manoeuvre)
        assert run["u"][0] == pytest.approx(manoeuvre.speed) and len(run) == len(alone)
        assert np.abs(run["psi"] - alone["psi"]).max() < 1e-9
    assert both[1].duration > 1.4 * both[0].duration


def test_driven_by_the_controls_that_a_helmsman_gave_it_the_network_sails_the_same_run(ship):
    run = simulate(ship, tactical_circle(20.0, "port", turn_deg=180.0))
    (again,) = replay(ship, [run])
    # A table of recorded controls rounds the corners that a rudder's angle has.
    assert np.abs(again["psi"] - run["psi"]).max() < 0.2 * DEGREE
    assert np.hypot(again["x"] - run["x"], again["y"] - run["y"]).max() < 0.01 * LENGTH
    assert np.array_equal(again["n_port"], run["n_port"]) and np.array_equal(again["delta"], run["delta"])


def test_a_replay_that_takes_over_later_starts_where_the_recording_is(ship):
    run = simulate(CalmWater(SHIP), tactical_circle(20.0, approach=20.0, turn_deg=30.0))
    (late,) = replay(ship, [run], start=40.0)
    at = int(np.flatnonzero(run.time == 40.0)[0])
    assert late.time[0] == 40.0 and late.time[-1] == run.time[-1]
    assert all(late[k][0] == pytest.approx(run[k][at]) for k in ("u", "v", "r", "p", "phi", "x", "y", "psi"))


def test_a_recording_shorter_than_the_start_is_refused(ship):
    run = simulate(ship, tactical_circle(35.0, turn_deg=30.0))
    with pytest.raises(InputError, match="nothing is left"):
        replay(ship, [run], start=1e4)


def test_a_split_between_the_sides_reaches_the_forces_and_the_record(ship):
    plain = tactical_circle(20.0, turn_deg=90.0)
    split = replace(plain, rudder_split=5 * DEGREE, shaft_split=0.1)
    run, alike = simulate(ship, split), simulate(ship, plain)
    assert run["delta_starboard"] - run["delta_port"] == pytest.approx(np.full(len(run), 10 * DEGREE))
    assert run["n_starboard"] / run["n_port"] == pytest.approx(np.full(len(run), 1.1 / 0.9))
    assert run["r"][20] > 0.0 and abs(alike["r"][20]) < 1e-12  # the starboard rudder alone turns this ship


def test_shaft_speeds_of_both_sides_part_about_that_of_the_approach(ship, monkeypatch):
    seen, forces = [], BasicForces.forward
    monkeypatch.setattr(BasicForces, "forward", lambda self, *given: seen.append(given[2]) or forces(self, *given))
    simulate(ship, replace(tactical_circle(20.0, turn_deg=90.0), shaft_split=0.1))
    n = SHIP.shaft_rpm / 60 * LENGTH / SPEED
    assert seen[-1][0, 2:4].tolist() == pytest.approx([1.1 * n, 0.9 * n])


def test_a_run_that_leaves_the_physical_range_says_when():
    run = simulate(turning(gain=20.0), tactical_circle(35.0))
    assert run.status.startswith("left the physical range") and run.duration < 80.0
    ok, lost = roll_out(turning(gain=20.0), [straight(60.0), tactical_circle(35.0)])
    assert ok.status == OK and lost.status != OK


def test_an_order_beyond_the_stop_is_refused(ship):
    with pytest.raises(InputError, match="rudder"):
        simulate(ship, tactical_circle(60.0))


def test_effects_do_not_act_on_a_recursive_network(ship):
    from manoeuvre_nn.effect.current import Current

    with pytest.raises(InputError, match="step to step"):
        simulate(Vessel(ship, [Current(SHIP, speed=1.0, toward_deg=0.0)]), tactical_circle(20.0))


def test_headings_are_continuous(circle):
    assert circle["psi"].max() > 2.5 * pi
