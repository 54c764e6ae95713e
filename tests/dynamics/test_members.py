"""Members of an ensemble as rows of a batch, against each sailing alone; what a model takes along to other speeds."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from fleet import unchecked
from pytest import approx
from tiers import mainly

from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.core.scaling import Scaling
from manoeuvre_nn.dynamics.base import calm_accelerations
from manoeuvre_nn.dynamics.members import Members, has_members, replay_members, sail_members
from manoeuvre_nn.dynamics.model import CalmWater, IdentifiedShip
from manoeuvre_nn.dynamics.replay import replay
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.manoeuvre.straight import straight
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.network.hull_rudder import HullRudder, HullRudderSettings
from manoeuvre_nn.network.perceptron import wang_network
from manoeuvre_nn.ship.esso_190k import esso_190k
from manoeuvre_nn.ship.known import clarke_part, no_part
from manoeuvre_nn.ship.mariner import mariner

COUNT, FEW = 6, 3
"""Members; members where each is sailed alone as well."""


def doubles(*values: float) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.float64)


def ensemble(members: int = COUNT, trained: int = 0, size: float = 2e-4, **options) -> IdentifiedShip:
    """Clarke's Mariner and a little of its own for every member."""
    network = HullRudder(HullRudderSettings(4, members, spread=1.0, **options), seed=1)
    drawn = torch.randn(network.output_weights.shape, generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    network.output_weights.data.copy_(size * drawn)
    network.trained.fill_(trained)
    scaling = Scaling(doubles(1, 0, 0, 0), doubles(0.2, 0.2, 0.3, 0.4), doubles(1, 2, 0.5))
    return IdentifiedShip(clarke_part(mariner()), network.requires_grad_(False), scaling)


def member(model: IdentifiedShip, k: int) -> IdentifiedShip:
    """The model with one member alone."""
    network = model.network
    options = {"speed_law": network.speed_law, "library": network.library, "symmetric": network.symmetric}
    one = HullRudder(HullRudderSettings(network.input_weights.shape[1], 1, **options))
    one.input_weights.data.copy_(network.input_weights[k : k + 1])
    one.output_weights.data.copy_(network.output_weights[k : k + 1])
    one.shaft.copy_(network.shaft)
    return IdentifiedShip(model.known, one.requires_grad_(False), model.scaling)


def states(rows: int) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(4)
    nu = torch.randn(rows, 3, generator=generator, dtype=torch.float64) * doubles(0.5, 0.5, 0.01) + doubles(7, 0, 0)
    return nu, 0.3 * torch.randn(rows, generator=generator, dtype=torch.float64)


def rates(model: Members, nu: torch.Tensor, delta: torch.Tensor) -> torch.Tensor:
    return model(model.start(whole(nu), Inputs(delta)), Inputs(delta))


def whole(nu: torch.Tensor) -> torch.Tensor:
    """Velocities with places and headings."""
    return torch.cat([nu, nu.new_tensor([10.0, 20.0, 0.5]).expand_as(nu)], -1)


@pytest.mark.parametrize("runs", [1, 3])
@pytest.mark.parametrize("law", ["approach", "shaft"])
def test_rows_are_all_runs_of_the_first_member_then_of_the_next(runs, law):
    model = ensemble(speed_law=law)
    nu, delta = states(COUNT * runs)
    together = rates(Members(model), nu, delta)
    for k in range(COUNT):
        own = slice(k * runs, (k + 1) * runs)
        alone = member(model, k)(whole(nu[own]), Inputs(delta[own]))
        torch.testing.assert_close(together[own, :6], alone, rtol=1e-11, atol=1e-13)
    assert together[:, 6:].abs().sum() == 0, "a row keeps its member"
    assert (together[:, :3] - calm_accelerations(model, nu, delta)).abs().amax(0).min() > 1e-7, "members disagree"


def test_rows_know_their_member_in_any_order_and_shape():
    members = Members(ensemble())
    nu, delta = states(2 * COUNT)
    start = members.start(whole(nu), Inputs(delta))
    straight = members(start, Inputs(delta))
    mixed = torch.randperm(2 * COUNT, generator=torch.Generator().manual_seed(1))[: COUNT + 1]
    torch.testing.assert_close(members(start[mixed], Inputs(delta[mixed])), straight[mixed], rtol=1e-11, atol=1e-13)
    square = members(start.reshape(3, 4, 7), Inputs(delta.reshape(3, 4)))
    torch.testing.assert_close(square.reshape(-1, 7), straight, rtol=1e-11, atol=1e-13)


def test_only_trained_members_have_rows():
    model = ensemble(trained=4)
    assert Members(model).count == 4 and Members(ensemble()).count == COUNT
    nu, delta = states(8)
    together = rates(Members(model), nu, delta)
    torch.testing.assert_close(
        together[6:, :6], member(model, 3)(whole(nu[6:]), Inputs(delta[6:])), rtol=1e-11, atol=1e-13
    )


def test_members_have_the_ship_of_their_model():
    model = ensemble()
    assert Members(model).particulars is model.particulars and Members(model).hull is model.known


def test_members_approach_as_their_model_does():
    model = tanker(shaft="similarity")
    slow = Members(model).on_approach(4.0)
    assert isinstance(slow, Members) and slow.particulars.speed == 4.0
    assert float(slow.model.network.shaft) == float(model.on_approach(4.0).network.shaft) < 1
    nu, delta = states(COUNT)
    assert torch.equal(rates(slow, nu, delta), rates(Members(model.on_approach(4.0)), nu, delta))


def test_an_ensemble_is_a_network_of_more_than_one_trained_member():
    assert has_members(ensemble(trained=2)) and has_members(ensemble(trained=COUNT))
    assert not has_members(ensemble(trained=1)) and not has_members(ensemble())
    plain = ensemble()
    assert not has_members(IdentifiedShip(plain.known, wang_network(3), plain.scaling))
    assert not has_members(CalmWater(mariner()))


TRIALS = [
    zigzag(20.0, duration=40.0),
    turning_circle(25.0, "port", duration=30.0),
    straight(30.0),
    zigzag(10.0, 3.0, duration=40.0).at_speed(5.0),
]
"""Of three lengths and two speeds: they are sailed, and written down, in batches that are not in their order."""


def same(one, other) -> None:
    assert one.time.tolist() == other.time.tolist() and one.status == other.status and one.name == other.name
    for name in ("u", "v", "r", "x", "y", "psi", "delta", "udot", "vdot", "rdot"):
        assert one[name] == approx(other[name], rel=1e-9, abs=1e-11), name


@pytest.mark.parametrize("trials", mainly(1, [TRIALS[:1], TRIALS]))
def test_members_sail_together_as_each_would_alone(trials):
    model = ensemble(FEW)
    with unchecked():
        together = sail_members(model, trials)
        assert [len(runs) for runs in together] == [FEW] * len(trials)
        for k in range(FEW):
            for runs, own in zip(together, roll_out(member(model, k), trials), strict=True):
                same(runs[k], own)
    for runs in together:
        assert np.ptp([run["x"][-1] for run in runs]) > 0.01, "members disagree"


def test_only_trained_members_sail():
    with unchecked():
        (runs,) = sail_members(ensemble(trained=2), TRIALS[:1])
    assert len(runs) == 2


@pytest.mark.slow
def test_members_are_driven_along_recordings_as_each_would_be_alone():
    model = ensemble()
    with unchecked():
        recordings = roll_out(CalmWater(mariner()), TRIALS[:3])
        together = replay_members(model, recordings)
        assert [len(runs) for runs in together] == [COUNT] * 3
        for k in range(COUNT):
            for runs, own in zip(together, replay(member(model, k), recordings), strict=True):
                same(runs[k], own)


def test_a_member_that_breaks_down_leaves_the_others_as_they_are():
    model = ensemble(FEW)
    model.network.output_weights[1] *= 1e4
    with unchecked():
        (runs,) = sail_members(model, TRIALS[:1])
        for k in range(FEW):
            (own,) = roll_out(member(model, k), TRIALS[:1])
            same(runs[k], own)
    assert [run.status == "ok" for run in runs] == [k != 1 for k in range(FEW)]


def tanker(rpm: float = 80.0, **options) -> IdentifiedShip:
    network = HullRudder(HullRudderSettings(4, COUNT, speed_law="shaft", library="quadratic"), seed=1)
    drawn = torch.randn(network.output_weights.shape, generator=torch.Generator().manual_seed(3), dtype=torch.float64)
    network.output_weights.data.copy_(drawn)
    ship = esso_190k(rpm=rpm, **options)
    fast = ship.particulars.speed / ship.prime.speed
    scaling = Scaling(doubles(0, 0, 0, 0), doubles(fast, 0.1, 0.3, 0.4), doubles(1e-3, 1e-3, 1e-3))
    return IdentifiedShip(no_part(ship), network.requires_grad_(False), scaling)


def test_a_shaft_that_follows_the_speed_is_told_to_the_network_and_one_that_is_held_is_not():
    follows, held = tanker(shaft="similarity"), tanker(shaft="hold")
    slow = follows.on_approach(4.0)
    ratio = slow.known.shaft_rpm / 80.0
    assert float(slow.network.shaft) == approx(ratio) and 0.4 < ratio < 0.6
    assert float(follows.network.shaft) == 1.0
    assert held.on_approach(4.0).network is held.network and float(held.network.shaft) == 1.0
    assert held.on_approach(4.0).known.shaft_rpm == 80.0


def test_the_ratio_counts_from_the_training_over_whatever_speeds_the_ship_came_by():
    model = tanker(shaft="similarity")
    once, twice = model.on_approach(5.0), model.on_approach(6.5).on_approach(5.0)
    assert float(twice.network.shaft) == approx(float(once.network.shaft), rel=1e-12)
    back = twice.on_approach(model.known._ship[0].self_propulsion)
    assert float(back.network.shaft) == approx(1.0, rel=1e-12)


def test_speeds_and_shaft_in_proportion_give_forces_in_proportion_to_their_square():
    """In the BIS system nothing scales by itself: the network has to."""
    model = tanker(shaft="similarity")
    slow = model.on_approach(0.5 * model.known._ship[0].self_propulsion)
    assert float(slow.network.shaft) == approx(0.5, rel=1e-12)
    nu, delta = states(5)
    torch.testing.assert_close(
        calm_accelerations(slow, nu / 2, delta), calm_accelerations(model, nu, delta) / 4, rtol=1e-9, atol=0
    )


def test_a_network_that_knows_no_shaft_is_shared_as_it_is():
    model = ensemble()
    slow = model.on_approach(4.0)
    assert slow.network is model.network and slow.particulars.speed == 4.0
    nu, delta = states(5)
    scaled = nu * 4.0 / model.particulars.speed
    factor = (4.0 / model.particulars.speed) ** 2
    torch.testing.assert_close(calm_accelerations(slow, scaled, delta), factor * calm_accelerations(model, nu, delta))
    plain = IdentifiedShip(model.known, wang_network(3), model.scaling)
    assert plain.on_approach(4.0).network is plain.network


def test_the_shaft_speed_of_a_ship_is_its_own_or_the_nominal_one():
    assert esso_190k(rpm=57.0).shaft_rpm == 57.0 == no_part(esso_190k(rpm=57.0)).shaft_rpm
    assert esso_190k(rpm=57.0).particulars.rpm == 57.0
    half = esso_190k(shaft="similarity").on_approach(4.0)
    assert half.shaft_rpm == half.rpm < 60.0 and no_part(half).shaft_rpm == half.rpm
    ship = mariner()
    ship.particulars = replace(ship.particulars, rpm=91.0)
    assert ship.shaft_rpm == clarke_part(ship).shaft_rpm == no_part(ship).shaft_rpm == 91.0


def test_ensembles_put_together_move_each_row_by_the_median_of_one():
    model = tanker()
    network, (nu, delta) = model.network, states(4)
    with torch.no_grad():
        more = [torch.cat([w, 1.1 * w]) for w in (network.input_weights[:COUNT], network.output_weights[:COUNT])]
    both = IdentifiedShip(model.known, network.with_weights(*more), model.scaling)
    whole = Members(both, COUNT)
    assert whole.count == 2 and whole.on_approach(4.0).together == COUNT
    found = rates(whole, nu, delta)
    for row, part in enumerate((slice(0, COUNT), slice(0, COUNT), slice(COUNT, None), slice(COUNT, None))):
        alone = IdentifiedShip(model.known, network.with_weights(*(w[part] for w in more)), model.scaling)
        with torch.no_grad():
            torch.testing.assert_close(
                found[row, :3], calm_accelerations(alone, nu[row], delta[row]), rtol=1e-12, atol=1e-14
            )
