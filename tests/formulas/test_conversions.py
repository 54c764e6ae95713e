"""Coefficients for other simulators: fitted, read back from what was written, at a price that is told."""

from functools import cache, partial
from math import inf

import numpy as np
import pytest
import torch
from fleet import unchecked
from models import model
from test_vessels_written import written

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.formulas import conversions, rollouts
from manoeuvre_nn.formulas.conversions import inertia_of, price, product_of, rigid_body, samples_of
from manoeuvre_nn.formulas.formats import write_down
from manoeuvre_nn.formulas.gazebo import GazeboShip, sdf_text
from manoeuvre_nn.formulas.models import to_program
from manoeuvre_nn.formulas.mss import NUMBER, mss_ship, mss_text
from manoeuvre_nn.formulas.rollouts import TrackDeviation
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.ship.mariner import mariner, mariner_chislett1965


@cache
def chislett():
    """The Mariner of 1965, and what coefficients are fitted to."""
    program = to_program(CalmWater(mariner_chislett1965()))
    return program, samples_of(program, "mss")


@cache
def gazebo():
    """The Mariner, and the ship that her file of SDFormat says."""
    program = to_program(CalmWater(mariner()))
    text = sdf_text(program, samples_of(program, "gazebo"))
    return program, text, GazeboShip(program, text)


@pytest.fixture(autouse=True)
def short(monkeypatch):
    """Few and short manoeuvres, without checks of types."""
    monkeypatch.setattr(conversions, "ZIGZAGS_DEG", (30.0,))
    monkeypatch.setattr(conversions, "CIRCLES_DEG", (15.0,))
    for made in (zigzag, turning_circle):
        monkeypatch.setattr(conversions, made.__name__, partial(made, duration=150.0))
    monkeypatch.setattr(rollouts, "TRIALS", (zigzag(20.0, duration=80.0),))
    with unchecked():
        yield


def test_the_ship_of_mariner_m_is_written_with_her_own_coefficients():
    values = {name: float(number) for name, number in NUMBER.findall(mss_text(*chislett()))}
    # Chislett & Stroem-Tejsen 1965, as mariner.m has them.
    wanted = {"Xu": -184e-5, "Xvv": -899e-5, "Yv": -1160e-5, "Yvvr": 15356e-5, "Yd": 278e-5, "Nd": -139e-5, "N0": 3e-5}
    assert {name: values[name] for name in wanted} == pytest.approx(wanted, rel=1e-6)
    assert values["m"] - values["Yvdot"] == pytest.approx(798e-5 + 748e-5, rel=1e-9)
    program, _ = chislett()
    (one,) = rollouts.deviations_of(program, mss_ship(program, mss_text(*chislett())), rollouts.sailed(program))
    assert one.largest < 1e-9


def test_a_conversion_that_cannot_be_exact_tells_its_price_in_the_file():
    made = write_down(to_program(CalmWater(mariner())), "gazebo")
    (one,) = made.deviations
    assert 1e-4 < one.rms < one.largest < 0.5
    assert (
        f"zz20: the track deviates from the model's by {one.largest:.3g} L at most, {one.rms:.3g} L rms" in made.content
    )
    again = rollouts.deviations_of(made.program, GazeboShip(made.program, made.content), rollouts.sailed(made.program))
    assert again == made.deviations  # of the file itself, header and all


def test_gazebos_parameters_have_the_signs_of_derivatives_and_add_up_to_the_ships_inertia():
    found = gazebo()[2].numbers
    mass, turning = rigid_body(mariner())
    inertia = inertia_of(mariner())
    assert max(found[name] for name in ("xDotU", "yDotV", "nDotR", "yVabsV", "nRabsR")) < 0
    assert mass - found["yDotV"] == pytest.approx(inertia[1, 1])
    assert turning - found["nDotR"] == pytest.approx(inertia[2, 2])


def test_a_ship_by_gazebos_axes_turns_to_the_same_side():
    program, _, made = gazebo()
    state = torch.tensor([[7.0, 0.4, -0.01, 0.0, 0.0, 0.0]], dtype=torch.float64)
    rudder = torch.tensor([-0.2], dtype=torch.float64)
    found = made(state, Inputs(rudder))[0, :3].numpy()
    expected = program.vessel.model(state, Inputs(rudder))[0, :3].numpy()
    np.testing.assert_allclose(found, expected, atol=0.15 * np.abs(expected).max())


def test_products_are_those_of_their_variables():
    given = {"u": np.array([2.0]), "v": np.array([-3.0])}
    assert product_of("u v |v|", given) == [-18.0] and product_of("1", given) == [1.0]


@pytest.mark.parametrize("kind", ["gazebo", "mss"])
def test_what_has_no_such_coefficients_is_refused_with_what_is_possible(kind):
    with pytest.raises(InputError, match="calm water alone: leave effect= out, or write format=fmu"):
        write_down(written("current"), kind)
    with pytest.raises(InputError, match="models of a ship's motion: write format=c for a response"):
        write_down(to_program(model("response")), kind)


def test_a_track_that_ends_before_the_other_is_told_so():
    near, lost = TrackDeviation("zz20", 0.2, 0.1), TrackDeviation("tc25", inf, inf)
    assert price([near, lost])[0] == "zz20: the track deviates from the model's by 0.2 L at most, 0.1 L rms"
    assert price([lost]) == ["tc25: it leaves the physical range where the model does not, or the model does"]
