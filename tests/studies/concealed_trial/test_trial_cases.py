"""Drawing, recording and committing."""

import json
from collections import Counter
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from manoeuvre_nn.core.errors import InputError
from studies.concealed_trial.channels import CHANNEL_SETS, shows
from studies.concealed_trial.commitments import check, commitment
from studies.concealed_trial.drawing import Trial, case_name, draw_case, draw_runs, plans
from studies.concealed_trial.effects import KINDS, NAMES, UNKNOWN, kind_of
from studies.concealed_trial.record import DECIMALS, GPS, manifest, write_case
from studies.concealed_trial.ships import trial_ships
from studies.concealed_trial.strength import DRIFT, SIGMAS, STRENGTHS, deviation, draw_effect, sized, strength_of


@pytest.fixture(scope="module")
def clean():
    """A clean case with an exact model."""
    wanted = plans(Trial(3, 20, channels="full"))
    index = next(k for k, plan in enumerate(wanted) if not plan.kinds and plan.ship == "mariner")
    case = draw_case(3, index, wanted[index], 0.0)
    return replace(case, runs=tuple(replace(run, duration=120) for run in case.runs[:3]), hole=None)


@pytest.fixture(scope="module")
def written(clean, tmp_path_factory):
    folder = tmp_path_factory.mktemp("recordings") / clean.name
    write_case(clean, folder, 0.5)
    return folder


def test_the_same_case_gives_the_same_files(clean, written, tmp_path):
    write_case(clean, tmp_path / "again", 0.5)
    names = sorted(path.name for path in written.iterdir())
    assert names == sorted(["manifest.json", *(f"{run.name}.csv" for run in clean.runs)])
    for name in names:
        assert (written / name).read_bytes() == (tmp_path / "again" / name).read_bytes()


def test_the_same_seed_draws_the_same_case_and_another_another():
    wanted = plans(Trial(7, 12))
    sensors = {kind.name for kind in KINDS if kind.per_unit}
    index = next(k for k, plan in enumerate(wanted) if not plan.kinds or plan.kinds[0].name in sensors)
    first, again = (draw_case(7, index, plans(Trial(7, 12))[index]) for _ in range(2))
    assert first == again
    assert plans(Trial(7, 12)) == wanted != plans(Trial(8, 12))
    assert case_name(7, index) == first.name != case_name(8, index)


def test_shares_of_a_trial_are_those_that_are_wanted():
    wanted = plans(Trial(1, 100))
    sorts = Counter("none" if not p.kinds else UNKNOWN if p.kinds[0].detail else str(len(p.kinds)) for p in wanted)
    assert sorts == {"none": 20, "1": 44, "2": 12, "3": 6, UNKNOWN: 18}
    assert {s for plan in wanted for s in plan.strengths} == set(STRENGTHS)
    assert {plan.channels for plan in wanted} == set(CHANNEL_SETS)
    assert all(shows(plan.channels, kind) for plan in wanted for kind in plan.kinds)
    assert 10 < sum(plan.hole for plan in wanted) < 25
    drawn = {kind.name for plan in wanted for kind in plan.kinds}
    assert drawn == set(NAMES)
    assert all(not k.ships or plan.ship in k.ships for plan in wanted for k in plan.kinds)
    assert all(len({k.family for k in plan.kinds}) == len(plan.kinds) for plan in wanted)


@pytest.mark.parametrize("seed", range(8))
def test_a_turn_and_a_zigzag_are_there_to_fit_and_two_runs_are_held_out(seed):
    for ship in trial_ships().values():
        runs = draw_runs(np.random.default_rng(seed), ship)
        fit = [run.manoeuvre[:2] for run in runs if run.split == "fit"]
        assert 4 <= len(runs) <= 6
        assert {"tc", "zz"} <= set(fit)
        assert len(runs) - len(fit) >= 2
        assert [run.name for run in runs] == [f"r{k:02d}" for k in range(1, len(runs) + 1)]


def test_recordings_have_the_columns_decimals_and_gaps_of_the_format(clean, written):
    described = json.loads((written / "manifest.json").read_text())
    for run in described["runs"]:
        table = pd.read_csv(written / run["file"])
        assert list(table) == list(DECIMALS)
        assert len(table) == run["rows"]
        assert table[["t", "delta", "delta_order", "n"]].notna().all().all()
        assert table["psi"].isna().mean() < 0.06
        assert (table[GPS].isna().sum(axis=1).isin([0, len(GPS)])).all()
        assert table["psi"].dropna().between(0, 360, inclusive="left").all()
        np.testing.assert_allclose(table["x_north"], table["x_north"].round(2))


def test_a_clean_case_shows_nothing_but_noise(clean, written):
    for run in clean.runs:
        table = pd.read_csv(written / f"{run.name}.csv")
        approach = table[table["t"] < 60]
        assert approach["psi"].mean() == pytest.approx(run.heading_deg, abs=0.15)
        assert approach["u_log"].mean() == pytest.approx(clean.ship.speed, abs=0.05)
        assert approach["r"].mean() == pytest.approx(0.0, abs=0.02)
        assert approach["r"].std() == pytest.approx(clean.noise["yaw_rate_deg_s"], rel=0.4)


def test_the_manifest_tells_nothing_of_the_effects(clean):
    text = json.dumps(manifest(clean))
    assert not [name for name in NAMES if name in text]
    assert clean.salt not in text


def test_an_answer_that_was_changed_is_refused(clean):
    answers = clean.answers()
    commitments = {clean.name: commitment(clean.salt, answers)}
    check(commitments, clean.salt, answers)
    with pytest.raises(InputError, match="is not the one in commitments.json"):
        check(commitments, clean.salt, answers | {"verdict": "mismatch"})
    with pytest.raises(InputError, match="is not the one in commitments.json"):
        check(commitments, "another salt", answers)
    with pytest.raises(InputError, match="not in commitments.json"):
        check({}, clean.salt, answers)


def test_a_size_is_found_within_its_bounds():
    assert sized(lambda s: 3.0 * s**1.5, 0.3, 0.01, 10.0) == pytest.approx(0.1 ** (1 / 1.5), rel=0.1)
    assert sized(lambda s: 1e-3 * s, 1.0, 0.1, 2.0) == 2.0
    thrown = sized(lambda s: s if s < 0.2 else float("inf"), 1.0, 0.01, 10.0)
    assert 0.1 < thrown < 0.2


def test_strengths_are_told_apart_between_their_ranges():
    for bounds, sensor in ((DRIFT, False), (SIGMAS, True)):
        for strength, ends in bounds.items():
            assert [strength_of(x, sensor) for x in ends] == [strength, strength]
    assert [strength_of(x, False) for x in (0.02, 20.0)] == ["weak", "extreme"]


def test_an_effect_moves_the_roll_outs_by_what_its_strength_says():
    ship, rng = trial_ships()["mariner"], np.random.default_rng(2)
    runs = tuple(replace(run, duration=120) for run in draw_runs(rng, ship)[:1])
    effect, measure = draw_effect(rng, ship, kind_of("current"), "moderate", runs)
    assert effect.strength == "moderate"
    assert 0.54 <= measure <= 1.25
    assert deviation(ship, effect, runs) == pytest.approx(measure)
