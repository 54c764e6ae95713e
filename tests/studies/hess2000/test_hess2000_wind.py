"""The wind of Hess & Faller 2000."""

import numpy as np
import pandas as pd
import pytest
from pytest import approx

from studies.hess2000.runs import Counts, overshoots
from studies.hess2000.wind import CALM, OCEAN, PERFECT, counted, medians
from studies.hess2000.wind_models import BlindAnswer, pairs, perfect_but_for_wind, repeated, without_wind

SOME = Counts(2, 2, 2)


@pytest.fixture(scope="module")
def windy():
    return overshoots(OCEAN, 0, SOME)


def test_the_ship_in_calm_air_errs_by_the_wind_alone(windy):
    calm, wind = (perfect_but_for_wind(runs) for runs in (overshoots("", 0, SOME), windy))
    assert (calm[["u", "x", "y", "psi"]] < 0.1).all(axis=None)
    assert wind["y"]["unseen"] > 10 * calm["y"]["unseen"]


def test_two_runs_in_turn_share_a_wind_on_opposite_courses(windy):
    for first, second in pairs(windy):
        for channel in ("wind_speed", "wind_from"):
            assert first[channel][0] == second[channel][0]
        assert second["psi"][0] - first["psi"][0] == approx(np.pi, abs=0.1)
    assert not any(k.startswith("wind") for r in without_wind(windy.own) for k in r.channels)


def test_repeated_overshoots_differ_by_their_wind(windy):
    across = repeated(windy, OCEAN, 3)
    assert list(across.index) == [10.0, 20.0] and (across > 0).all(axis=None)


def test_an_interval_that_holds_the_truth_holds_it_across_north():
    near = BlindAnswer(("wind_steady",), (8.0, 0.5), (359.0, 2.0), 8.5, 1.0)
    assert near.windy and near.holds
    assert not BlindAnswer(("wind_steady",), (8.0, 0.5), (355.0, 2.0), 8.5, 1.0).holds
    assert not BlindAnswer(("wind_steady",), (8.0, 0.2), (1.0, 2.0), 8.5, 1.0).holds
    assert not BlindAnswer(("current",), (np.nan, np.nan), (np.nan, np.nan), 8.5, 1.0).windy


def test_answers_are_counted_and_errors_have_their_medians():
    right = BlindAnswer(("wind_steady",), (8.0, 0.5), (1.0, 2.0), 8.5, 1.0)
    none = BlindAnswer((), (np.nan, np.nan), (np.nan, np.nan), 0.0, np.nan)
    found = counted([{"wind": OCEAN, "answer": right}, {"wind": OCEAN, "answer": none}, {"wind": CALM, "answer": none}])
    assert (found["asked"], found["named"], found["right"], found["calm_asked"], found["calm_named"]) == (2, 1, 1, 1, 0)
    row = {"wind": OCEAN, "model": PERFECT, "told": False, "own": 1.0, "validation": 2.0, "unseen": 3.0}
    table = pd.DataFrame([row, row | {"unseen": 5.0}, row | {"unseen": 4.0}])
    assert medians(table)[f"{OCEAN}, {PERFECT}, not told, unseen"] == 4.0
