"""Both solutions: order, located crossings, gradients, rows of a batch, and runs that break down."""

import copy
from dataclasses import replace
from math import inf, log2

import numpy as np
import pytest
import torch
from fleet import ship_named, unchecked
from pytest import approx
from tiers import mainly

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.manoeuvre import Manoeuvre, Stage
from manoeuvre_nn.core.units import DEGREE, KNOT
from manoeuvre_nn.dynamics.base import rate_of_state
from manoeuvre_nn.dynamics.limits import OK
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.rollout import roll_out, rollout
from manoeuvre_nn.dynamics.simulate import simulate
from manoeuvre_nn.manoeuvre.straight import straight
from manoeuvre_nn.manoeuvre.turning import pull_out, turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.ship.esso_190k import esso_190k
from manoeuvre_nn.ship.great_lakes_bulker import great_lakes_bulker
from manoeuvre_nn.ship.mariner import mariner, mariner_corrected
from studies.reproduction.stacked import Stacked

SPEED = 7.614


def run(dynamics, manoeuvres, duration, interval=1.0, step=None):
    start = torch.zeros(len(manoeuvres), 6, dtype=torch.float64)
    start[:, 0] = dynamics.particulars.speed
    times = torch.arange(0.0, duration + 1e-9, interval, dtype=torch.float64)
    with unchecked():
        return rollout(dynamics, manoeuvres, start, times, step=step)


def unstable():
    """The Mariner with its yaw damping turned into the opposite: its yaw runs away."""
    ship = mariner()
    ship.series.coefficients[ship.series.terms.index("r"), 2] *= -5
    return ship


def test_the_step_is_of_fourth_order_on_a_smooth_run():
    """A turn that the rudder is in from the start: halving the step divides the error by 16."""
    ship = mariner()
    ship.particulars = replace(ship.particulars, rudder_rate=1e6)
    ends = [run(CalmWater(ship), [turning_circle(20.0)], 96.0, 16.0, h).states[-1, 0] for h in (8.0, 4.0, 2.0, 0.5)]
    errors = [float(torch.hypot(*(e - ends[3])[3:5])) for e in ends[:3]]
    assert log2(errors[1] / errors[2]) == approx(4.0, abs=0.4)
    assert log2(errors[0] / errors[1]) == approx(4.0, abs=0.6)


@pytest.mark.parametrize("interval", mainly(1, [5.0, 1.0]))
def test_with_events_located_the_zigzag_keeps_the_order_too(interval):
    ends = [run(CalmWater(mariner()), [zigzag(20.0)], 150.0, interval, h).states[-1, 0] for h in (2.5, 1.25, 0.4)]
    errors = [float(torch.hypot(*(e - ends[2])[3:5])) for e in ends[:2]]
    assert errors[0] < 0.05 and (errors[1] < errors[0] / 6 or errors[0] < 1e-4)


@pytest.mark.parametrize("name", mainly(1, ["esso_190k", "mariner", "mariner_chislett1965"]))
@pytest.mark.parametrize("solver", ["rollout", "simulate"])
def test_the_rudder_is_reversed_at_the_heading_though_samples_are_a_second_apart(name, solver):
    """The moment of the reversal follows from the rudder, which turns evenly; the heading then is the limit."""
    model = CalmWater(ship_named(name))
    trial = zigzag(20.0, duration=130.0)
    with unchecked():
        (r,) = roll_out(model, [trial]) if solver == "rollout" else [simulate(model, trial)]
    first = int(np.argmax(r["delta_order"] < 0))
    on_its_way = first + 1  # the rudder has left 20 deg and not arrived at -20
    reversal = r.time[on_its_way] - (20 * DEGREE - r["delta"][on_its_way]) / model.particulars.rudder_rate
    dt, a, b = reversal - r.time[first - 1], r["r"][first - 1], r["rdot"][first - 1]
    heading = r["psi"][first - 1] + a * dt + b * dt**2 / 2
    assert r.time[first - 1] <= reversal <= r.time[first]
    assert heading / DEGREE == approx(20.0, abs=0.01)


def test_gradients_of_a_zigzag_are_those_of_finite_differences():
    """The moment of the reversal moves with the coefficients, and so does everything after it."""
    ship = mariner()
    table, name = ship.series.coefficients, ship.series.terms
    rows = torch.tensor([name.index(t) for t in ("v", "r", "d", "vvv")])

    def end(factors):
        moved = copy.deepcopy(ship)
        moved.series.coefficients = table.index_copy(0, rows, table[rows] * factors[:, None])
        out = run(CalmWater(moved), [zigzag(10.0, 4.0), turning_circle(15.0, "port")], 24.0, 2.0, 2.0)
        assert float(out.orders[-1, 0]) < 0, "the rudder has been reversed"
        return out.states[-1] / out.states.new_tensor([1.0, 1.0, 0.01, 10.0, 10.0, 0.1])

    factors = torch.ones(4, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(end, (factors,), eps=1e-5, atol=1e-5, rtol=1e-4)


def test_gradients_pass_through_the_tanker_too():
    ship = esso_190k()
    table = ship.coefficient_table

    def end(factor):
        ship.coefficient_table = table * factor
        return run(CalmWater(ship), [zigzag(20.0, 5.0)], 60.0, 4.0, 4.0).states[-1, 0, 3:] / 100

    factor = torch.ones(3, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(end, (factor,), eps=1e-5, atol=1e-5, rtol=1e-4)


TRIALS = [zigzag(20.0), turning_circle(25.0, "port"), pull_out(20.0, turn_deg=20.0), straight(), zigzag(10.0, 3.0)]


def test_rows_of_a_batch_are_the_single_runs():
    model = CalmWater(mariner())
    together = run(model, TRIALS, 100.0, 2.0, 2.0)
    for k, trial in enumerate(TRIALS):
        alone = run(model, [trial], 100.0, 2.0, 2.0)
        assert torch.allclose(together.states[:, k], alone.states[:, 0], rtol=0, atol=1e-9), trial.name
        assert torch.equal(together.orders[:, k], alone.orders[:, 0])


def test_manoeuvres_of_other_speeds_and_lengths_share_a_call():
    with unchecked():
        runs = roll_out(CalmWater(mariner()), [zigzag(20.0, duration=40.0), zigzag(20.0, duration=60.0).at_speed(5.0)])
    assert [(r.duration, r["u"][0]) for r in runs] == [(40.0, SPEED), (60.0, 5.0)]


@pytest.mark.parametrize(
    "ships",
    [
        lambda: [mariner(), mariner_corrected()],
        lambda: [esso_190k(), esso_190k(depth=30.0), esso_190k(rpm=60.0)],
    ],
)
def test_stacked_ships_move_as_each_would_alone(ships):
    models = [CalmWater(s) for s in ships()]
    together = run(Stacked(models), [zigzag(20.0, 10.0)] * len(models), 80.0, 4.0, 4.0)
    for k, model in enumerate(models):
        alone = run(model, [zigzag(20.0, 10.0)], 80.0, 4.0, 4.0)
        assert torch.allclose(together.states[:, k], alone.states[:, 0], rtol=0, atol=1e-8)
    assert (together.states[-1, 0] - together.states[-1, 1]).abs().max() > 1e-3, "they are different ships"


def turned_rudder():
    ship = mariner()
    ship.rudder_sign = 1.0
    return ship


@pytest.mark.parametrize("other", [lambda: mariner().on_approach(5.0), turned_rudder])
def test_ships_that_differ_in_more_than_their_tables_are_not_stacked(other):
    with pytest.raises(InputError, match="one after the other"):
        Stacked([CalmWater(mariner()), CalmWater(other())])


def test_a_stack_takes_no_other_speed():
    with pytest.raises(NotImplementedError, match="before stacking"):
        Stacked([CalmWater(mariner())]).on_approach(5.0)


def test_a_row_that_diverges_is_ended_and_the_others_go_on_undisturbed():
    models = [CalmWater(mariner()), CalmWater(unstable()), CalmWater(mariner_corrected())]
    runs = run(Stacked(models), [zigzag(20.0)] * 3, 50.0)
    assert runs.ended.isfinite().tolist() == [False, True, False]
    assert runs.states.isfinite().all()
    for k in (0, 2):
        alone = run(models[k], [zigzag(20.0)], 50.0)
        assert torch.allclose(runs.states[:, k], alone.states[:, 0], rtol=0, atol=1e-8)
    after = runs.times >= runs.ended[1]
    assert (runs.states[after, 1] == runs.states[after, 1][:1]).all(), "it rests where it ended"


class Pushed(CalmWater):
    """Rudder to starboard pushes the ship astern and rudder to port ahead: it could come back into the range."""

    def forward(self, state, inputs):
        delta = inputs.delta
        return rate_of_state(state, torch.stack([-delta, 0 * delta, 0 * delta], dim=-1))


def test_a_row_that_ended_does_not_come_back_to_life():
    back_and_forth = Manoeuvre("push", "random_rudder", (Stage(0.5, hold=30.0), Stage(-0.5)), duration=100.0)
    runs = run(Pushed(mariner()), [back_and_forth, straight()], 100.0)
    assert 15.0 < runs.ended[0] < 45.0 and runs.ended[1] == inf
    assert (runs.states[runs.times >= runs.ended[0], 0, 0] < 0).all()
    assert runs.states[-1, 1, 3] == approx(100 * SPEED)


def test_a_run_that_leaves_the_physical_range_ends_there_and_says_when():
    with unchecked():
        (batched,) = roll_out(CalmWater(unstable()), [turning_circle(20.0, duration=60.0)])
        accurate = simulate(CalmWater(unstable()), turning_circle(20.0, duration=60.0))
    for recording in (batched, accurate):
        assert recording.status.startswith("left the physical range at") and recording.duration < 60.0
        assert all(np.isfinite(c).all() for c in recording.channels.values())
    assert batched.status == accurate.status


def test_the_bulk_carriers_turns_end_before_its_coefficients_stop_making_sense():
    ship = great_lakes_bulker().particulars
    assert turning_circle(25.0).duration_for(ship) == 400.0
    assert zigzag(20.0).duration_for(ship) == ship.record_length
    assert turning_circle(25.0, duration=600.0).duration_for(ship) == 600.0


@pytest.mark.parametrize("solver", ["rollout", "simulate"])
def test_the_last_order_is_held_even_if_it_names_a_heading(solver):
    trial = Manoeuvre("once", "zigzag", (Stage(20 * DEGREE, heading=5 * DEGREE),), duration=60.0)
    model = CalmWater(mariner())
    with unchecked():
        (r,) = roll_out(model, [trial]) if solver == "rollout" else [simulate(model, trial)]
    assert r.status == OK and r["delta"][-1] == approx(20 * DEGREE) and r["psi"][-1] > 10 * DEGREE


def test_a_sample_interval_of_ones_own_only_changes_where_the_solution_is_read():
    model, trial = CalmWater(mariner()), zigzag(20.0, duration=60.0)
    with unchecked():
        fine, coarse = simulate(model, trial, 0.5), simulate(model, trial, 3.0)
    assert np.diff(coarse.time) == approx(3.0)
    assert coarse["x"] == approx(fine["x"][::6], abs=1e-4) and coarse["psi"] == approx(fine["psi"][::6], abs=1e-6)


def test_an_order_beyond_the_stop_is_refused_before_anything_is_computed():
    with pytest.raises(InputError, match="stops at 35 deg: write a smaller rudder_deg"):
        simulate(CalmWater(mariner()), turning_circle(40.0))
    with pytest.raises(InputError, match="stops at 35 deg: write a smaller rudder_deg"):
        roll_out(CalmWater(mariner()), [zigzag(36.0)])


@pytest.mark.parametrize("speed", [-2.0, 0.0, 40 * KNOT])
def test_an_approach_speed_that_is_none_is_refused(speed):
    with pytest.raises(InputError, match="write manoeuvre.speed_kn between 0 and"):
        simulate(CalmWater(mariner()), zigzag(20.0).at_speed(speed))


def test_nothing_ends_when_all_is_well():
    assert run(CalmWater(mariner()), [zigzag(20.0)], 20.0).ended.tolist() == [inf]


def test_a_row_with_many_events_leaves_the_others_as_they_are():
    """Rows have clocks of their own: one that is stopped often falls behind, and its samples are read off later."""
    busy = Manoeuvre("busy", "random_rudder", tuple(Stage(0.3 * (-1) ** k, hold=0.3) for k in range(99)))
    runs = run(CalmWater(mariner()), [zigzag(20.0), busy, straight()], 32.0, 2.0, 0.5)
    for k, trial in enumerate([zigzag(20.0), busy, straight()]):
        alone = run(CalmWater(mariner()), [trial], 32.0, 2.0, 0.5)
        assert torch.allclose(runs.states[:, k], alone.states[:, 0], rtol=0, atol=1e-9)
        assert torch.allclose(runs.shown[:, k], alone.shown[:, 0], rtol=0, atol=1e-12)
    assert runs.orders[:16, 1].tolist() == [0.3 * (-1) ** int(2.0 * s / 0.3 + 1e-6) for s in range(16)]


def test_stages_whose_heading_is_already_passed_are_left_at_once():
    behind = tuple(Stage(order, heading=-0.1) for order in (0.3, -0.3, 0.2))
    trial = Manoeuvre("behind", "zigzag", (*behind, Stage(0.1)), duration=20.0)
    out = run(CalmWater(mariner()), [trial, straight()], 20.0)
    assert (out.orders[1:, 0] == 0.1).all() and out.shown[-1, 0] == 0.1


def test_runs_of_a_batch_with_other_lengths_are_recorded_as_alone():
    model, trials = CalmWater(mariner()), [zigzag(20.0, duration=d) for d in (30.0, 50.0, 30.0)]
    with unchecked():
        for together, trial in zip(roll_out(model, trials), trials, strict=True):
            (alone,) = roll_out(model, [trial])
            assert together.time.tolist() == alone.time.tolist() and together.meta["manoeuvre"] == trial
            for name, values in alone.channels.items():
                assert together[name] == approx(values, abs=1e-12), name
