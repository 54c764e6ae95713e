"""The wind of Hess & Faller 2000."""

from dataclasses import replace
from math import pi

import numpy as np
import pandas as pd
import pytest
from fleet import unchecked

from manoeuvre_nn.manoeuvre.zigzag import overshoot
from studies.hess2000.runs import APPROACH, SHIPS, PlannedRun, RunSet, TrueWinds, sail
from studies.hess2000.wind import CALM, NETWORK, OCEAN, PERFECT, SERIES, counted, distances, gains, medians
from studies.hess2000.wind_models import BlindAnswer, pairs, perfect_but_for_wind, repeated, without_wind
from studies.reproduction.claims import read_claims

SHORT = replace(overshoot(20.0, approach=APPROACH, cycles=1.0), speed=8.0, duration=130.0)


@pytest.fixture(scope="module")
def windy():
    """Four short runs, two and two in the same wind on opposite courses."""
    ship = SHIPS[2]()
    air = [(12.0, 8.0), (12.0, 8.0), (9.0, 175.0), (9.0, 175.0)]
    with unchecked():
        first, second, *others = sail(ship, [PlannedRun(SHORT, *a, heading=pi * (k % 2)) for k, a in enumerate(air)])
    return RunSet(ship, (second,), (first,), tuple(others))


@pytest.mark.slow
def test_the_ship_in_calm_air_errs_by_the_wind_alone(windy):
    with unchecked():
        ship, (run,) = windy.ship, sail(windy.ship, [PlannedRun(SHORT)])
        calm = perfect_but_for_wind(RunSet(ship, (run,), (replace(run, name="second"),), (replace(run, name="third"),)))
        wind = perfect_but_for_wind(windy)
    assert (calm[["u", "y", "psi"]] < 0.1).all(axis=None)
    assert wind["y"]["unseen"] > 20 * calm["y"]["unseen"]


@pytest.mark.slow
def test_pairs_share_a_wind_which_is_not_handed_on(windy):
    ((first, second),) = pairs(windy)
    assert first["wind_from"][0] == second["wind_from"][0] and abs(second["psi"][0] - first["psi"][0]) > 3.0
    assert not any(k.startswith("wind") for r in without_wind(windy.own) for k in r.channels)


@pytest.mark.slow
def test_repeated_overshoots_differ_by_their_wind():
    with unchecked():
        across = repeated(SHIPS[2](), [SHORT], TrueWinds(6.0, 12.0, 10.0), 2)
    assert list(across.index) == [SHORT.name] and (across[["y", "phi", "psi"]] > 0).all(axis=None)


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


def test_every_claim_finds_its_quantities_and_a_seed_its_place():
    rows = [
        {"wind": wind, "model": model, "told": told, "seed": seed, "psi": 1.0}
        | dict.fromkeys(("own", "validation", "unseen"), (1.0 + seed) * (0.2 if told or wind == CALM else 1.0))
        for wind in (CALM, OCEAN, "along")
        for model in (PERFECT, SERIES, NETWORK)
        for told in (False, True)
        for seed in (0, 1)
    ]
    table = pd.DataFrame(rows)
    y = medians(table)
    found = counted([{"wind": OCEAN, "answer": BlindAnswer(("wind_steady",), (8.0, 0.5), (1.0, 2.0), 8.5, 1.0)}])
    claims = read_claims("hess2000", "wind").beside({"y": y, "repeated": {"y": 12.0, "psi": 3.0}, **gains(y), **found})
    assert [c.verdict for c in claims if "y of unseen runs" in c.what] == ["holds", "holds"]
    away = {row["model"]: row["own: 11.2 % is away by"] for row in distances(table) if row["wind"] == OCEAN}
    assert away == dict.fromkeys((PERFECT, SERIES, NETWORK), f"{np.log(11.2 / 2**0.5) / (np.log(2) / 2**0.5):+.1f} sd")
