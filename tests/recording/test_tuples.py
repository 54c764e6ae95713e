import numpy as np
import pytest
import torch

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.recording.tuples import to_tuples
from manoeuvre_nn.ship.known import clarke_part
from manoeuvre_nn.ship.mariner import INERTIA, mariner
from manoeuvre_nn.ship.taylor import TaylorShip


def motion(record):
    return torch.as_tensor(record.stacked("u", "v", "r")), torch.as_tensor(record["delta"])


def test_a_known_ship_leaves_nothing_unknown(zz20, zz35):
    tuples = to_tuples([zz20, zz35], mariner())
    assert tuples.targets.shape == (len(zz20) + len(zz35), 3)
    assert tuples.targets.abs().max() < 1e-10


def test_with_inertia_alone_the_targets_are_the_ships_forces(zz20):
    true = mariner()
    inert = TaylorShip(true.particulars, INERTIA, {}, positive_rudder_turns_to="port")
    tuples = to_tuples([zz20], inert)
    torch.testing.assert_close(tuples.targets, true.force(*motion(zz20)), atol=1e-12, rtol=0.0)


def test_with_clarkes_estimate_the_targets_are_inertia_times_acceleration_less_the_linear_forces(zz20, ship):
    clarke, (nu, delta) = clarke_part(ship), motion(zz20)
    tuples = to_tuples([zz20], clarke)
    length, speed = ship.length, ship.speed
    k = clarke.coefficients
    vdot, rdot = (torch.as_tensor(zz20[c]) for c in ("vdot", "rdot"))
    v, r = nu[:, 1] / speed, nu[:, 2] * length / speed
    inertia = clarke.inertia[1, 1] * vdot * length / speed**2 + clarke.inertia[1, 2] * rdot * (length / speed) ** 2
    sway = inertia - k["Y"]["v"] * v - k["Y"]["r"] * r + k["Y"]["d"] * delta
    torch.testing.assert_close(tuples.targets[:, 1], sway, atol=1e-12, rtol=0.0)
    assert tuples.targets[:, 1].abs().max() > 1e-3


def test_inputs_are_prime_velocities_and_the_rudder_in_radians(zz20, ship):
    inputs = to_tuples([zz20], mariner()).inputs
    assert inputs.dtype == torch.float64
    np.testing.assert_allclose(inputs[:, 0], zz20["u"] / ship.speed)
    np.testing.assert_allclose(inputs[:, 2], zz20["r"] * ship.length / ship.speed)
    np.testing.assert_allclose(inputs[:, 3], zz20["delta"])


def test_each_sample_knows_its_recording_and_time(zz20, zz35):
    tuples = to_tuples([zz20, zz35], mariner(), start=60.0, length=100.0)
    assert torch.bincount(tuples.index).tolist() == [101, 101]
    assert tuples.times[:101].tolist() == list(np.arange(60.0, 161.0))
    np.testing.assert_allclose(tuples.inputs[101:, 3], zz35["delta"][60:161])


def test_a_window_beyond_the_recording_is_refused(zz20):
    with pytest.raises(InputError, match="window 400"):
        to_tuples([zz20], mariner(), start=400.0)
