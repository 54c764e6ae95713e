"""Every force by a second route: the equations written out (tests/equations.py)."""

import numpy as np
import pytest
import torch
from equations import chislett, esso, wang
from fleet import unchecked
from pytest import approx

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.ship import great_lakes_bulker as bulker
from manoeuvre_nn.ship import mariner
from manoeuvre_nn.ship.esso_190k import PARTICULARS, esso_190k
from manoeuvre_nn.ship.taylor import TaylorForce, TaylorShip

MOTIONS = np.random.default_rng(0).uniform([0.4, -0.3, -1.0, -0.6], [1.1, 0.3, 1.0, 0.6], (20, 4))


def compare(ship, equation, rel=1e-12):
    """Random motions; the equations' rudder is positive to port."""
    p = ship.particulars
    motions = MOTIONS * [p.speed, p.speed, p.speed / p.length, 1.0]
    columns = torch.tensor(motions)
    found = ship.acceleration(columns[:, :3], -columns[:, 3]).numpy()
    expected = np.array([equation(*m) for m in motions])
    assert found == approx(expected, rel=1e-9, abs=rel * np.abs(expected).max())


@pytest.mark.parametrize("make, sign", [(mariner.mariner, 1), (mariner.mariner_corrected, -1)])
def test_the_mariner_moves_by_the_thesis_equations(make, sign):
    k = {e: dict(c) for e, c in mariner.COEFFICIENTS.items()}
    k["N"]["dvv"] = sign * 0.2064
    compare(make(), lambda u, v, r, d: wang(k, mariner.INERTIA, 152.4, 7.614, u, v, r, d))


def test_the_bulk_carrier_moves_by_the_thesis_equations():
    k, inertia = bulker.COEFFICIENTS, bulker.INERTIA
    compare(bulker.great_lakes_bulker(), lambda u, v, r, d: wang(k, inertia, 217.627, 5.144, u, v, r, d))


def test_the_mariner_of_1965_moves_by_the_equations_in_wide_use():
    compare(mariner.mariner_chislett1965(), chislett)


@pytest.mark.parametrize("ratio, zeta", [(None, 0.0), (2.5, 1 / 1.5), (1.2, 5.0)])
@pytest.mark.parametrize("rpm", [80.0, 50.0])
def test_the_tanker_moves_by_its_equations_in_any_depth(ratio, zeta, rpm):
    depth = float("inf") if ratio is None else ratio * PARTICULARS.draught
    compare(esso_190k(depth=depth, rpm=rpm), lambda u, v, r, d: esso(u, v, r, d, zeta, rpm))


@pytest.mark.parametrize("make", [mariner.mariner, mariner.mariner_chislett1965, bulker.great_lakes_bulker, esso_190k])
def test_more_speed_is_slowed_down_more_up_to_twice_that_of_the_approach(make):
    ship = make()
    u = torch.linspace(0.1, 2.0, 39, dtype=torch.float64) * ship.particulars.speed
    surge = ship.force(torch.stack([u, 0 * u, 0 * u], dim=-1), 0 * u)[:, 0]
    assert (surge.diff() < 0).all() and float(surge[18]) == approx(0.0, abs=1e-4)


def test_a_derivative_is_divided_by_the_factorials_and_a_plain_factor_is_not():
    values = {"Y": {"vvv": 6.0, "rvv": 2.0, "d": 1.0, "0": 0.5}}
    motion = torch.tensor([0.0, 2.0, 3.0, 5.0], dtype=torch.float64)
    assert TaylorForce(values)(motion).tolist() == [0.0, 6 * 8 / 6 + 2 * 3 * 4 / 2 + 5 + 0.5, 0.0]
    assert TaylorForce(values, taylor=False)(motion).tolist() == [0.0, 6 * 8 + 2 * 3 * 4 + 5 + 0.5, 0.0]


def test_letters_of_a_term_may_stand_in_any_order():
    motion = torch.tensor([0.1, 2.0, 3.0, 5.0], dtype=torch.float64)
    one, other = TaylorForce({"N": {"rvv": 2.0}}), TaylorForce({"N": {"vrv": 2.0}})
    assert one(motion).tolist() == other(motion).tolist()


@pytest.mark.parametrize("values", [{"Z": {"v": 1.0}}, {"Y": {"vx": 1.0}}])
def test_unknown_equations_and_letters_are_refused(values):
    with pytest.raises(InputError, match="choose X, Y or N|use u, v, r, d"):
        TaylorForce(values)


@pytest.mark.parametrize("make", [mariner.mariner, mariner.mariner_chislett1965, esso_190k])
def test_forces_and_accelerations_are_each_others_inverse(make):
    ship = make()
    units = torch.tensor([ship.particulars.speed, ship.particulars.speed, 1 / ship.particulars.time_unit])
    nu, delta = torch.tensor(MOTIONS[:, :3]) * units, torch.tensor(MOTIONS[:, 3])
    back = ship.force_from_acceleration(ship.acceleration(nu, delta))
    assert back.numpy() == approx(ship.force(nu, delta).numpy(), rel=1e-10)


def test_a_source_whose_rudder_turns_to_starboard_needs_no_change_of_sign():
    p, y = mariner.WANG, {"N": {"d": 0.03}}
    ships = [TaylorShip(p, mariner.INERTIA, y, positive_rudder_turns_to=s) for s in ("starboard", "port")]
    nu, delta = torch.tensor([p.speed, 0.0, 0.0], dtype=torch.float64), torch.tensor(0.1, dtype=torch.float64)
    starboard, port = (float(s.acceleration(nu, delta)[2]) for s in ships)
    assert starboard > 0 and port == approx(-starboard)


def test_water_that_is_not_deeper_than_the_ship_is_refused():
    with pytest.raises(InputError, match="write a larger depth"):
        esso_190k(depth=18.0)


def test_an_unknown_rule_for_the_shaft_is_refused():
    with pytest.raises(InputError, match="choose one of: hold, similarity"), unchecked():
        esso_190k(shaft="free")


@pytest.mark.parametrize("speed", [-1.0, 0.0, 16.0])
def test_an_approach_speed_that_is_no_speed_is_refused(speed):
    with pytest.raises(InputError, match="write manoeuvre.speed_kn between 0 and 29.6"):
        mariner.mariner().on_approach(speed)


def test_a_series_of_a_constant_alone_and_an_empty_one_are_series_too():
    motion = torch.zeros(2, 3, 4, dtype=torch.float64)
    assert (TaylorForce({"Y": {"0": 0.5}})(motion) == torch.tensor([0.0, 0.5, 0.0])).all()
    assert TaylorForce({})(motion).tolist() == [[[0.0] * 3] * 3] * 2


@pytest.mark.parametrize("build", [lambda: esso_190k(rpm=60.0), lambda: esso_190k(shaft="similarity"), mariner.mariner])
def test_recorded_shaft_speeds_are_over_the_one_of_the_approach(build):
    ship = build()
    for sailing in (ship, ship.on_approach(0.8 * ship.particulars.speed)):
        assert sailing.particulars.rpm == approx(sailing.shaft_rpm)
