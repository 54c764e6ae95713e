from math import exp, radians

import pytest
import torch
from fleet import ship_named
from shelf import DEEP, at, made, situation

from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.core.recording import followed
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.effect.formula import Formula
from manoeuvre_nn.ship.container import container
from manoeuvre_nn.ship.mariner import mariner
from manoeuvre_nn.ship.naval_vessel import naval_vessel

RAD = radians(1.0)


def follow(effect, shown, order=None, step=1.0):
    """Blade angles [deg] behind a series of indicated angles [deg], at rest before the first."""
    order = shown if order is None else order
    blade, found = torch.tensor(shown[0] * RAD, dtype=torch.float64), []
    for seen, ordered in zip(shown, order, strict=True):
        seen, ordered = (torch.tensor(a * RAD, dtype=torch.float64) for a in (seen, ordered))
        blade = effect.blade(blade, ordered, seen, torch.tensor(step, dtype=torch.float64))
        found.append(float(blade) / RAD)
    return found


@pytest.mark.parametrize("ship", DEEP)
def test_a_positive_offset_is_a_blade_to_starboard_that_turns_the_ship_there(ship):
    s = at(ship, ship_named(ship).particulars.speed, 1e-6)
    (blade,) = follow(made("rudder_offset", ship, offset_deg=2.0), [1.0])
    assert blade == pytest.approx(3.0)
    turn = ship_named(ship).acceleration(s.nu, s.delta + 2 * RAD) - s.nudot
    assert float(turn[0, 2]) > 0


def test_play_makes_a_loop():
    shown = [0.0, 5.0, 10.0, 9.5, 8.5, 0.0, -1.0, 0.5, 1.5]
    blade = follow(made("rudder_backlash", "mariner", width_deg=2.0), shown)
    assert blade == pytest.approx([0.0, 4.0, 9.0, 9.0, 9.0, 1.0, 0.0, 0.0, 0.5])


def test_a_slow_blade_turns_at_its_own_rate_whatever_is_shown():
    order = [0.0] + [20.0] * 3 + [-20.0] * 4
    blade = follow(made("rudder_slow", "mariner", rate_deg_s=1.2), [0.0] * 8, order)
    assert blade == pytest.approx([0.0, 1.2, 2.4, 3.6, 2.4, 1.2, 0.0, -1.2])
    last = [
        follow(made("rudder_slow", "mariner", rate_deg_s=1.2), [0.0, 0.0], [0.0, 1.0], step)[-1] for step in (1.0, 0.5)
    ]
    assert last == pytest.approx([1.0, 0.6])


@pytest.mark.parametrize("ship", DEEP)
def test_a_blade_at_the_nominal_rate_is_where_the_indicator_is(ship):
    rate = ship_named(ship).particulars.rudder_rate / RAD
    shown = [min(k * rate, 20.0) for k in range(15)]
    effect = made("rudder_slow", ship)
    blade = follow(effect.at(effect.null()), shown, [0.0] + [20.0] * 14)
    assert blade == pytest.approx(shown)


def test_a_blade_stops_early_on_both_sides():
    blade = follow(made("rudder_saturation", "mariner", limit_deg=18.0), [-30.0, -10.0, 10.0, 30.0])
    assert blade == pytest.approx([-18.0, -10.0, 10.0, 18.0])


def test_a_late_recording_is_put_right_again():
    time = torch.arange(60, dtype=torch.float64)
    true = 0.01 * time - 0.2
    effect = made("rudder_delay", "mariner", delay_s=2.5)
    s = situation("mariner", n=60)
    written = effect.record({"delta": true, "psi": s.psi}, s.with_(time=time))
    torch.testing.assert_close(written["delta"][3:], true[3:] - 0.025)
    assert written["psi"] is s.psi
    torch.testing.assert_close(effect.indicated(written["delta"], None, time)[3:-3], true[3:-3])
    bent = torch.sin(0.1 * time)
    again = effect.indicated(effect.record({"delta": bent}, s.with_(time=time))["delta"], None, time)
    torch.testing.assert_close(again[5:-5], bent[5:-5], rtol=0.0, atol=3e-3)


@pytest.mark.parametrize("delay", [13.0, -13.0])
def test_a_rudder_that_moves_where_no_sample_tells_of_it_is_taken_from_the_orders(delay):
    """It is under way when the late record ends, or when the early one begins: without orders it is held there."""
    rate, time = ship_named("mariner").particulars.rudder_rate, torch.arange(60, dtype=torch.float64)
    order = torch.where(time < 7, -0.3, torch.where(time < 50, 0.2, -0.25)).double()
    true = torch.tensor(followed(time.numpy(), order.numpy(), rate, start=0.0))
    effect, s = made("rudder_delay", "mariner", delay_s=delay), situation("mariner", n=60).with_(time=time)
    written = effect.record({"delta": true}, s)["delta"]
    end = 0 if delay > 0 else -1
    assert written[end] == true[end], "before and after a run the rudder stands still"
    ordered = torch.tensor(followed(time.numpy(), order.numpy(), rate, start=0.0))
    torch.testing.assert_close(effect.indicated(written, ordered, time), true)
    held = effect.indicated(written, None, time)
    told = slice(None, -13) if delay > 0 else slice(13, None)
    untold = held[-13:] if delay > 0 else held[:13]
    torch.testing.assert_close(held[told], true[told])
    assert (untold == (written[-1] if delay > 0 else written[0])).all()


@pytest.mark.parametrize("ship", DEEP)
def test_without_any_area_the_rudder_does_nothing(ship):
    s = situation(ship)
    effect = made("rudder_area_loss", ship)
    lost = effect.at(torch.ones(1, dtype=torch.float64)).acceleration(s, s.nu.new_zeros(4, 0))
    torch.testing.assert_close(s.nudot + lost, ship_named(ship).acceleration(s.nu, 0 * s.delta))


def test_the_tankers_rudder_is_lost_with_its_race():
    ship = ship_named("esso_190k")
    s = situation(ship).with_(shaft=torch.full((4,), 0.6, dtype=torch.float64))
    lost = made("rudder_area_loss", ship).at(torch.ones(1, dtype=torch.float64))

    def turning(delta):
        force = ship.force(s.nu, delta) + ship.shaft_force(s.nu, delta, s.shaft)
        return ship.acceleration_from_force(force)

    change = lost.acceleration(s, s.nu.new_zeros(4, 0))
    torch.testing.assert_close(turning(s.delta) + change, turning(0 * s.delta))


@pytest.mark.parametrize("ship", DEEP)
def test_a_rudder_stalls_beyond_its_angle_and_recovers_in_the_turn(ship):
    p = ship_named(ship).particulars
    effect = made("rudder_stall", ship, angle_deg=25.0, loss=0.4)

    def lost(delta_deg, r=0.0):
        s = at(ship, p.speed, 1e-9, r, delta=delta_deg * RAD)
        rudder = s.nudot - ship_named(ship).acceleration(s.nu, 0 * s.delta)
        change = effect.acceleration(s, s.nu.new_zeros(1, 0))
        assert float(change[0, 0]) == 0.0
        return (-change[0, 1:] / rudder[0, 1:]).tolist()

    assert lost(35.0) == pytest.approx([0.4 / (1 + exp(-5))] * 2, rel=1e-6)
    assert max(lost(15.0)) < 0.01
    assert lost(25.0) == pytest.approx([0.2, 0.2], rel=1e-6)
    assert max(lost(35.0, r=1.0 * p.speed / p.length)) < 0.5 * 0.4


@pytest.mark.parametrize("ship", DEEP)
def test_the_race_of_the_approach_is_in_the_model_and_more_shaft_speed_is_more_rudder(ship):
    speed = ship_named(ship).particulars.speed
    effect = made("slipstream", ship, share=1.0)
    memory = torch.zeros(1, 0, dtype=torch.float64)
    approach = effect.acceleration(at(ship, speed, 1e-9, delta=0.3), memory)
    assert float(approach.abs().max()) < 1e-15
    kick = effect.acceleration(at(ship, 0.7 * speed, 1e-9, delta=0.3, shaft=1.5), memory)
    coast = effect.acceleration(at(ship, 0.7 * speed, 1e-9, delta=0.3, shaft=0.3), memory)
    assert float(kick[0, 2]) > 0 > float(coast[0, 2])


@pytest.mark.parametrize("build", [container, naval_vessel, mariner])
def test_what_a_rudder_does_too_little_heels_too_little_too(build):
    ship = build()
    calm, exact = CalmWater(ship), {"rtol": 0.0, "atol": 1e-12}
    moving = [0.9 * ship.particulars.speed, 0.4, -0.01, 0.0, 0.0, 0.3, 0.1, 0.02]
    state, over = torch.tensor([moving[: 6 + len(ship.own_names)]]).double(), torch.tensor([20 * RAD]).double()

    def rates(share: float, *effects: Effect) -> torch.Tensor:
        return Vessel(calm, effects).model(state, Inputs(share * over))

    lost, half = (rates(1.0, made("rudder_area_loss", ship, fraction=share)) for share in (1.0, 0.5))
    torch.testing.assert_close(lost, rates(0.0), **exact)
    torch.testing.assert_close(half, 0.5 * (rates(0.0) + rates(1.0)), **exact)
    weak = Formula(ship, ["rudder to starboard"], w1=-0.3)
    torch.testing.assert_close(rates(1.0, weak), rates(0.7), **exact)
    s = Vessel(calm, [weak]).situation(state, Inputs(over))
    (force, _), heeling = weak.unit_of("rudder to starboard", s), weak.heeling_of_unit("rudder to starboard", s)
    of_unit = torch.cat(ship.added(force, heeling), dim=-1)
    expected = (rates(1.0, Formula(ship, ["rudder to starboard"], w1=1e-3)) - rates(1.0)) / 1e-3
    torch.testing.assert_close(of_unit, expected[:, [0, 1, 2, *range(6, len(moving))][: of_unit.shape[-1]]], **exact)


@pytest.mark.parametrize("name", ["rudder_backlash", "rudder_slow", "rudder_offset"])
@pytest.mark.parametrize("kept", [1, 40])
def test_a_blade_over_many_times_at_once_is_where_it_is_one_time_after_another(name, kept):
    """Orders that change at every time, and after 40; times of no length, too."""
    generator = torch.Generator().manual_seed(kept)
    order, shown, elapsed = (torch.rand(6, 200, generator=generator).double() for _ in range(3))
    order = (order[:, ::kept].repeat_interleave(kept, dim=-1) - 0.5).clone()
    elapsed = elapsed * (elapsed > 0.2)
    effect = made(name, "mariner")
    effect = effect.at(torch.linspace(0.2, 2.5, 6).double()[:, None, None])
    start = torch.full((6, 1), 0.1).double()
    found = effect.blade_in_turn(start, order, shown - 0.5, elapsed)
    assert found.numpy() == pytest.approx(
        Effect.blade_in_turn(effect, start, order, shown - 0.5, elapsed).numpy(), abs=1e-14
    )
    assert found.shape == (6, 200) and float(found.std()) > 0.01
