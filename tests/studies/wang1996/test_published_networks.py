"""The printed weights of Wang's thesis, in both readings, against the ships that they were trained on."""

from functools import cache

import pytest
import torch
from fleet import ship_named, unchecked
from tiers import mainly

from manoeuvre_nn.core.scaling import Scaling
from manoeuvre_nn.dynamics.model import CalmWater, IdentifiedShip
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.recording.tuples import to_tuples
from manoeuvre_nn.scoring.score import score
from manoeuvre_nn.ship.known import clarke_part
from studies.wang1996.published_networks import printed_weights, published_network

SHIPS = ["mariner", "great_lakes_bulker"]
BOUNDS = {"mariner": [0.02, 0.01, 0.01], "great_lakes_bulker": [0.04, 0.035, 0.02]}
FOUND = {"mariner": [0.015, 0.009, 0.009], "great_lakes_bulker": [0.037, 0.031, 0.017]}
ZIGZAG = zigzag(35.0, duration=360.0)


@cache
def recorded(name):
    with unchecked():
        (run,) = roll_out(CalmWater(ship_named(name)), [ZIGZAG], step=0.5)
    return run


def port_positive():
    one = torch.ones(4, dtype=torch.float64)
    return Scaling(torch.zeros_like(one), torch.tensor([1.0, 1.0, 1.0, -1.0], dtype=torch.float64), one[:3])


def identified(name, reading="corrected"):
    return IdentifiedShip(clarke_part(ship_named(name)), published_network(name, reading), port_positive())


def errors(name, reading):
    """RMSE of g1, g2, g3, and their root mean squares and standard deviations."""
    tuples = to_tuples([recorded(name)], clarke_part(ship_named(name)))
    g = published_network(name, reading)(port_positive().inputs(tuples.inputs))
    y = tuples.targets
    return (g - y).square().mean(0).sqrt(), y.square().mean(0).sqrt(), y.std(0, correction=0)


@pytest.mark.parametrize("ship", mainly(1, SHIPS))
def test_read_in_the_order_of_the_file_the_weights_give_the_simulated_forces(ship):
    rmse, size, spread = errors(ship, "corrected")
    assert all(e <= bound for e, bound in zip(rmse / size, BOUNDS[ship], strict=True))
    assert (rmse / spread).tolist() == pytest.approx(FOUND[ship], abs=6e-4)


@pytest.mark.parametrize("ship", mainly(1, SHIPS))
def test_read_as_labelled_they_are_off_by_a_hundredfold(ship):
    rmse, _, spread = errors(ship, "printed")
    assert (rmse / spread).min() > 100


@pytest.mark.parametrize("ship", mainly(1, SHIPS))
def test_the_published_networks_sail_the_zigzag_that_they_were_trained_on(ship):
    with unchecked():
        (run,) = roll_out(identified(ship), [ZIGZAG])
    assert score(run, recorded(ship), ship_named(ship).particulars.length).dev_L <= 0.015


def test_the_table_has_its_labels_in_order_and_numbers_from_its_four_corners():
    labels, numbers = printed_weights("mariner")
    inner = [f"W {i} {j}" for i in range(1, 12) for j in range(1, 6)]
    assert list(labels) == inner + [f"B {i} 1" for i in range(1, 13)]
    assert numbers[0].tolist() == [6.881667e-01, 1.124596e-01, 1.445560e-01]
    assert numbers[-1].tolist() == [1.259074e00, -2.960220e00, -3.138889e-02]
    labels, numbers = printed_weights("great_lakes_bulker")
    assert list(labels) == inner + [f"B {i} 1" for i in range(1, 13)]
    assert numbers[0].tolist() == [5.895030e-01, -1.644226e-02, -4.978991e-01]
    assert numbers[-1].tolist() == [2.748926e-01, -7.088545e00, -5.379578e-01]


def test_both_readings_hold_the_same_numbers():
    for ship in SHIPS:
        a, b = (
            torch.cat([p.flatten() for p in published_network(ship, r).parameters()]) for r in ("corrected", "printed")
        )
        assert torch.equal(a.sort().values, b.sort().values)
        assert not torch.equal(a, b)


def test_the_first_printed_row_is_the_first_output_weight_or_as_labelled_the_first_input_weight():
    first = printed_weights("mariner")[1][0]
    assert torch.equal(published_network("mariner").output_weights[:, 0, 0], first)
    assert torch.equal(published_network("mariner", "printed").input_weights[:, 0, 0], first)
