"""Blendermann's coefficients as published, and his functions at the angles at which they are closed forms."""

import pytest
import torch
from pytest import approx

from manoeuvre_nn.core.particulars import WindAreas
from manoeuvre_nn.core.wind import COEFFICIENTS, wind_load

AREAS = WindAreas(frontal=400.0, lateral=1500.0, lateral_centre=-6.0, length_overall=150.0)
RHO, SPEED = 1.225, 12.0
PRESSURE = 0.5 * RHO * SPEED**2
PUBLISHED = {  # hundredths, in the order of the source: transverse, from ahead, from astern, cross-force
    "car_carrier": (95, 55, 60, 80), "cargo_loaded": (85, 65, 55, 40), "container_loaded": (90, 55, 55, 40),
    "ferry": (90, 45, 50, 80), "gas_carrier": (70, 60, 65, 50), "research": (85, 55, 65, 60),
    "tanker_loaded": (70, 90, 55, 40), "tanker_ballast": (70, 75, 55, 40),
}  # fmt: skip


def load(kind: str, ahead: float, across: float) -> list[float]:
    """X, Y, N/Y over L_oa of a ship that moves through the air so."""
    parts = wind_load(AREAS, COEFFICIENTS[kind], *torch.tensor([ahead, across], dtype=torch.float64))
    return [float(part) for part in parts]


def test_coefficients_are_those_of_the_source():
    """Blendermann 1994; the same in Fossen 2021, section 10.1.2."""
    assert {kind: tuple(round(100 * c) for c in row) for kind, row in COEFFICIENTS.items()} == PUBLISHED
    assert all(100 * c == approx(round(100 * c)) for row in COEFFICIENTS.values() for c in row)


@pytest.mark.parametrize("kind", COEFFICIENTS)
def test_from_ahead_astern_and_the_side_each_coefficient_acts_alone(kind):
    side, bow, stern, _ = (c / 100 for c in PUBLISHED[kind])
    assert load(kind, SPEED, 0.0)[:2] == approx([-PRESSURE * 400.0 * bow, 0.0], abs=1e-3)
    assert load(kind, -SPEED, 0.0)[:2] == approx([PRESSURE * 400.0 * stern, 0.0], abs=1e-3)
    assert load(kind, 0.0, -SPEED) == approx([0.0, PRESSURE * 1500.0 * side, -6.0 / 150.0], abs=1e-3)


@pytest.mark.parametrize("kind", COEFFICIENTS)
def test_at_forty_five_degrees_the_cross_force_lifts_both_forces_by_the_same_factor(kind):
    side, bow, _, cross = (c / 100 for c in PUBLISHED[kind])
    more = 1 / (1 - 0.5 * cross * (1 - bow * 400.0 / (1500.0 * side)))
    half = 0.5**0.5
    expected = [-PRESSURE * 400.0 * bow * half * more, PRESSURE * 1500.0 * side * half * more]
    assert load(kind, SPEED * half, -SPEED * half)[:2] == approx(expected, rel=1e-5)
    arm = -6.0 / 150.0 + 0.18 * torch.pi / 4
    assert load(kind, SPEED * half, -SPEED * half)[2] == approx(arm), "ahead of that of a beam wind"
