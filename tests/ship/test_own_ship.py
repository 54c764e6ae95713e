"""A ship by numbers alone is the same ship as one of the shelf with these numbers."""

from dataclasses import replace

import pytest
import torch
from fleet import unchecked

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.units import DEGREE, KNOT
from manoeuvre_nn.ship.mariner import COEFFICIENTS, INERTIA, WANG, mariner
from manoeuvre_nn.ship.own import OwnParticulars, own_particulars, own_ship
from manoeuvre_nn.ship.taylor import TaylorShip

MINE = OwnParticulars(
    name="mine", length=WANG.length, beam=WANG.beam, draught=WANG.draught, block=WANG.block,
    speed_kn=WANG.speed / KNOT, rudder_rate_deg_s=WANG.rudder_rate / DEGREE, rho=WANG.rho,
)  # fmt: skip


def test_units_of_the_yaml_become_si():
    p = own_particulars(OwnParticulars("mine", 100.0, 16.0, 6.0, 0.7, 12.0, 3.0, 30.0, displacement_t=7000.0))
    assert p.speed == pytest.approx(12 * 1852 / 3600)
    assert p.rudder_rate == pytest.approx(3 * torch.pi / 180)
    assert p.rudder_limit == pytest.approx(30 * torch.pi / 180)
    assert p.mass == 7e6
    assert p.sample_interval == pytest.approx(0.05 * p.time_unit)


def test_what_is_not_said_of_an_own_ship_is_what_is_usual():
    p = own_particulars(OwnParticulars("mine", 100.0, 16.0, 6.0, 0.7, 12.0))
    usual = Particulars("mine", 100.0, 16.0, 6.0, 0.7, p.speed, 2.5 * DEGREE, 35 * DEGREE)
    same = ("rudder_rate", "rudder_limit", "rpm", "rudder_area_ratio", "record_length", "rho", "mass")
    assert {name: getattr(p, name) for name in same} == {name: getattr(usual, name) for name in same}


def test_the_mariner_by_numbers_accelerates_as_the_mariner_does():
    own = own_ship(MINE, INERTIA, COEFFICIENTS, "port")
    nu, delta = torch.tensor([6.5, -0.4, 0.01], dtype=torch.float64), torch.tensor(0.3, dtype=torch.float64)
    torch.testing.assert_close(own.acceleration(nu, delta), mariner().acceleration(nu, delta))


def test_a_missing_inertia_and_a_speed_of_nothing_are_refused():
    with pytest.raises(InputError, match="inertia lacks my, mz"):
        own_ship(MINE, {"mx": 0.1}, COEFFICIENTS)
    for key in ("displacement_t", "rpm", "rho", "rudder_limit_deg", "length", "record_length"):
        for value in (-1.0, float("nan"), float("inf")):
            with pytest.raises(InputError, match="ship mine: .* must be positive|expected length > beam"):
                own_particulars(replace(MINE, **{key: value}))
    with pytest.raises(InputError, match="speed_kn is 0"):
        own_particulars(OwnParticulars("mine", 100.0, 16.0, 6.0, 0.7, 0.0))


@pytest.mark.parametrize("side", ["left", "Starboard", ""])
def test_a_side_of_the_rudder_that_is_none_is_refused(side):
    with (
        unchecked(),
        pytest.raises(InputError, match=f"positive_rudder_turns_to {side!r} is unknown; choose one of: port, star"),
    ):
        TaylorShip(mariner().particulars, {"mx": 1.0, "my": 1.0, "mz": 1.0}, {}, positive_rudder_turns_to=side)


@pytest.mark.parametrize("changes, said", [
    ({"length": 394.0}, "length 394 m over beam 20 m is 19.7; expected 1.5 to 15: mind that both are in m"),
    ({"speed_kn": 180.0}, r"speed_kn 180 on 120 m is a Froude number of 2.7; expected up to 2"),
])  # fmt: skip
def test_a_length_in_feet_and_a_speed_in_no_knots_are_refused(changes, said):
    ferry = OwnParticulars("ferry", length=120.0, beam=20.0, draught=5.4, block=0.6, speed_kn=18.0)
    assert own_particulars(ferry).length == 120.0
    with pytest.raises(InputError, match=said):
        own_particulars(replace(ferry, **changes))
