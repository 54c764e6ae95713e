"""The effect of heel on an upright ship beside a ship that rolls by itself."""

from dataclasses import replace
from math import pi

import numpy as np
import pytest
import torch
from fleet import unchecked
from pytest import approx

from manoeuvre_nn.core.effect import Situation
from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.core.units import GRAVITY
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.effect.roll import RollCoupling
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.ship.container import DRIVE, container
from manoeuvre_nn.ship.four_degrees import FourDegreeShip, HullSeries

FORMS = {"N_rrphi": -0.08, "N_p": 0.003, "Y_phi": 0.01, "Y_rrphi": 0.2}


def pair(gm: float, coupling: dict[str, float]) -> tuple[FourDegreeShip, FourDegreeShip]:
    """A ship that rolls as the oscillator of the effect, coupled by these alone; the same one held upright."""
    like = container(gm=gm).particulars
    heel, prime, length, mass = like.heeling, like.prime, like.length, like.mass
    force, moment, unit = prime.force, prime.moment, like.time_unit
    omega, inertia = 2 * pi / heel.roll_period, 2e9
    lever = inertia * omega**2 * (heel.kg - 0.5 * like.draught) / (GRAVITY * heel.gm)
    # M dp/dt + lever (dv/dt + u r) + 2 zeta omega M p + omega^2 M phi = 0
    matrix = torch.diag(torch.tensor([1.05 * mass, 1.9 * mass, 0.11 * mass * length**2, inertia], dtype=torch.float64))
    matrix[3, 1] = lever
    size = coupling["N_phi"] ** 2
    share = {name: 1.0 if name == "N_phi" else size / (size + 0.01**2) for name in coupling}
    c = {**dict.fromkeys(FORMS, 0.0), **{name: share[name] * value for name, value in coupling.items()}}
    u = like.speed
    terms = {
        "X": {"u |u|": -0.03 * force / u**2, "v r": 1.3 * mass},
        "Y": {"u v": -0.25 * force / u**2, "|v| v": -1.2 * force / u**2, "u r": -0.9 * mass,
              "phi": c["Y_phi"] * force, "r r phi": c["Y_rrphi"] * force * unit**2},
        "N": {"u v": -0.08 * moment / u**2, "u r": -0.05 * moment * unit / u, "|r| r": -0.03 * moment * unit**2,
              "phi": c["N_phi"] * moment, "p": c["N_p"] * moment * unit, "r r phi": c["N_rrphi"] * moment * unit**2},
        "K": {"u r": -lever, "p": -2 * heel.roll_damping * omega * inertia},
    }  # fmt: skip
    hull = HullSeries(terms, prime=False, restoring=omega**2 * inertia)
    drives = [replace(DRIVE, z_r=0.0)]
    return FourDegreeShip(like, matrix, hull, drives), FourDegreeShip(like, matrix, hull, drives, rolls=False)


CASES = [(0.3, {"N_phi": -0.01}), (1.0, {"N_phi": 0.012, "N_rrphi": -0.08, "N_p": 0.003})]


@pytest.mark.slow
@pytest.mark.parametrize("gm, coupling", CASES, ids=["linear", "turning"])
def test_a_ship_whose_heel_turns_it_as_the_effect_says_moves_as_the_upright_one_with_the_effect(gm, coupling):
    rolls, upright = pair(gm, coupling)
    trials = [zigzag(20.0, duration=200.0), turning_circle(30.0, duration=200.0)]
    with unchecked():
        free = roll_out(CalmWater(rolls), trials)
        held = roll_out(Vessel(CalmWater(upright), [RollCoupling(upright, **coupling)]), trials)
        bare = roll_out(CalmWater(upright), trials)
    for a, b, c in zip(free, held, bare, strict=True):
        assert np.abs(a["phi"]).max() > (0.1 if gm < 0.5 else 0.03)
        changed = np.hypot(a["x"] - c["x"], a["y"] - c["y"]).max()
        assert changed > 5.0
        assert np.hypot(a["x"] - b["x"], a["y"] - b["y"]).max() < 0.001 * changed
        assert b["psi"] == approx(a["psi"], abs=1e-3)


def test_at_a_recorded_heel_the_effect_is_what_heel_does_to_the_ship_that_rolls():
    rolls, upright = pair(0.6, {"N_phi": 0.006, **FORMS})
    effect = RollCoupling(upright, N_phi=0.006, **FORMS)
    tensor = torch.tensor
    nu, own = tensor([8.0, -0.9, 0.02], dtype=torch.float64), tensor([-0.12, 0.01], dtype=torch.float64)
    delta = nu[1] * 0 + 0.3
    free = rolls.forces(nu, own, Inputs(delta)) - rolls.forces(nu, 0 * own, Inputs(delta))
    expected = upright.acceleration_from_si(free[:3])
    zero = 0 * delta
    heel = torch.cat([own, own[1:] * 0])
    s = Situation(nu, upright.acceleration(nu, delta), zero, zero, zero, delta, zero + 1, zero, heel)
    found = effect.acceleration(s, torch.zeros(2, dtype=torch.float64))  # its own heel does not count then
    torch.testing.assert_close(found, expected, rtol=1e-9, atol=1e-15)


def test_without_a_yaw_moment_by_heel_nothing_of_the_effect_is_left():
    """Else forces that no reported number tells of could be evidence for it."""
    upright = container(rolls=False)
    one = torch.ones((), dtype=torch.float64)
    s = Situation(
        torch.tensor([8.0, -0.9, 0.02], dtype=torch.float64), torch.zeros(3, dtype=torch.float64),
        0 * one, 0 * one, 0 * one, 0.3 * one, one, 0 * one,
    )  # fmt: skip
    memory = torch.tensor([0.1, 0.01], dtype=torch.float64)
    made = [RollCoupling(upright, N_phi=size, Y_pdot=0.004, **FORMS).acceleration(s, memory) for size in (0.0, 0.02)]
    assert (made[0] == 0).all() and (made[1][1:] != 0).all()


def test_roll_dies_away_by_its_damping():
    """``phi ~ exp(-zeta omega t)``: twice the damping, the square of what is left after a period."""
    upright = container(rolls=False)
    heel, still = upright.particulars.heeling, torch.zeros((), dtype=torch.float64)
    s = Situation(torch.zeros(3, dtype=torch.float64), torch.zeros(3, dtype=torch.float64), *[still] * 6)
    omega = 2 * pi / heel.roll_period
    for factor in (1.0, 2.0):
        effect = RollCoupling(upright, damping=factor)
        units = torch.eye(2, dtype=torch.float64)
        matrix = torch.stack([effect.memory_rate(s, unit) for unit in units], dim=-1)
        assert np.linalg.eigvals(matrix.numpy()).real == approx([-factor * heel.roll_damping * omega] * 2)
