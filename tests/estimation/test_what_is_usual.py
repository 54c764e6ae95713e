"""Sizes that are taken for usual before any run is seen."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from pytest import approx
from scipy.stats import norm

from manoeuvre_nn.core.wind import COEFFICIENTS, wind_load
from manoeuvre_nn.estimation.coefficient_priors import series_prior
from manoeuvre_nn.estimation.data_set import COEFFICIENT_SD_LEVELS
from manoeuvre_nn.estimation.marginal_likelihood import COEFFICIENT_SD_PRIOR
from manoeuvre_nn.estimation.run_states import RunStates
from manoeuvre_nn.ship.mariner import mariner

SHIP = mariner().particulars


def test_a_model_heels_as_much_as_a_ship_and_rolls_faster_by_froudes_law():
    model = replace(SHIP, length=1.6, beam=0.23, draught=0.085)
    states = RunStates(("phi", "p"))
    assert states.own_start_sd(model) == approx(states.own_start_sd(SHIP) * [1.0, 10.0]), "1.6 m of 160 m"
    assert (states.own_start_sd(SHIP) > 0).all()


@pytest.mark.parametrize("angle", [0.0, 90.0])
def test_the_wind_is_expected_to_push_a_ship_as_blendermanns_cargo_ship_to_a_tenth(angle):
    """From ahead and from the side; from the bow quarter it turns the bow away from it, as he says too."""
    names = [(0, "wx |w|"), (1, "wy |w|"), (2, "wx wy")]
    mean, _ = series_prior([*names, (1, "u r")], SHIP)
    air = torch.tensor([np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))], dtype=torch.float64)  # of the ship
    x, y, _ = wind_load(SHIP.above_water, COEFFICIENTS["cargo_loaded"], *(air * SHIP.speed))
    unit = 0.5 * SHIP.rho * SHIP.length * SHIP.draught * SHIP.speed**2
    wx, wy = -air.numpy()  # of the air relative to the ship
    assert [mean[0] * wx, mean[1] * wy] == approx([float(x) / unit, float(y) / unit], rel=0.1, abs=1e-9)
    bow = torch.tensor(0.5**0.5 * SHIP.speed, dtype=torch.float64)
    *_, arm = wind_load(replace(SHIP.above_water, lateral_centre=0.0), COEFFICIENTS["cargo_loaded"], bow, -bow)
    assert mean[2] < 0 < float(arm)


def test_levels_of_the_coefficients_errors_stand_close_where_they_are_likely_and_end_where_they_are_not():
    usual, beyond = np.array(COEFFICIENT_SD_LEVELS[1:]), COEFFICIENT_SD_LEVELS[-1] / COEFFICIENT_SD_PRIOR
    assert (usual[1:] / usual[:-1] < 2.6).all()
    assert 2 * norm.sf(beyond) < 1e-4 < 2 * norm.sf(0.9 * beyond), "of a half-normal prior"
