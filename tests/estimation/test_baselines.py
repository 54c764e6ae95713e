"""The models that stand beside a network: what each must get right by itself."""

from dataclasses import replace
from functools import cache

import pytest
import torch
from fleet import distance, ship_named, unchecked
from tiers import only

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.dynamics.base import calm_accelerations
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.estimation.accelerations import accelerations
from manoeuvre_nn.estimation.baselines import (
    fit_baselines,
    own_part,
    taylor_baseline,
    true_terms_baseline,
)
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.recording.noise import add_noise
from manoeuvre_nn.recording.tuples import Tuples, to_tuples
from manoeuvre_nn.ship.known import clarke_part, no_part
from manoeuvre_nn.ship.kvlcc2 import kvlcc2

MARINER, BULKER, TANKER = "mariner", "great_lakes_bulker", "esso_190k"
KNOWN = {MARINER: clarke_part, "mariner_chislett1965": clarke_part, BULKER: clarke_part, TANKER: no_part}
TRAINED = {MARINER: (zigzag(35.0),), BULKER: (zigzag(35.0),), TANKER: (zigzag(20.0, duration=600.0),)}
TRAINED["mariner_chislett1965"] = (zigzag(35.0),)

COARSE = 4.0
"""Steps of tracks that are compared with each other [s]: what they miss of the truth both miss."""


@cache
def sailed(name: str, *trials) -> list[Recording]:
    with unchecked():
        return roll_out(CalmWater(ship_named(name)), trials)


@cache
def learnt_from(name: str) -> Tuples:
    return to_tuples(sailed(name, *TRAINED[name]), KNOWN[name](ship_named(name)))


@cache
def baselines(name: str) -> dict:
    ship = ship_named(name)
    return {baseline.name: baseline for baseline in fit_baselines(ship, KNOWN[name](ship), learnt_from(name))[0]}


def missed(name: str, baseline: str, *trials) -> list[float]:
    """Largest distances from the ship's own tracks over L."""
    with unchecked():
        runs, true = (
            roll_out(model, trials, step=COARSE, interval=COARSE)
            for model in (baselines(name)[baseline].dynamics, CalmWater(ship_named(name)))
        )
    length = ship_named(name).particulars.length
    return [distance(a, b) / length for a, b in zip(runs, true, strict=True)]


def motions(name: str, count: int = 20) -> tuple[torch.Tensor, torch.Tensor]:
    p = ship_named(name).particulars
    x = torch.rand(count, 4, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    u, v, r, d = (0.5 + 0.5 * x[:, 0], 0.4 * x[:, 1] - 0.2, 0.8 * x[:, 2] - 0.4, x[:, 3] - 0.5)
    return torch.stack([u * p.speed, v * p.speed, r * p.speed / p.length], dim=-1), d


@pytest.mark.parametrize("name", only({"mariner"}, KNOWN))
def test_the_rungs_stand_from_the_least_knowledge_to_the_most(name):
    assert list(baselines(name)) == ["linear", "taylor", "true terms"]
    learnt = [baseline.parameters for baseline in baselines(name).values()]
    assert learnt[0] == 0 and all(count > 5 for count in learnt[1:])


@pytest.mark.parametrize("name", [MARINER, TANKER])
def test_the_linear_rung_is_clarkes_ship(name):
    clarke = CalmWater(clarke_part(ship_named(name)))
    nu, delta = motions(name)
    assert torch.equal(
        calm_accelerations(baselines(name)["linear"].dynamics, nu, delta), calm_accelerations(clarke, nu, delta)
    )


@pytest.mark.parametrize("name", [MARINER, BULKER])
def test_a_taylor_series_learns_a_ship_that_is_one(name):
    nu, delta = motions(name)
    ours = calm_accelerations(baselines(name)["taylor"].dynamics, nu, delta)
    torch.testing.assert_close(ours, ship_named(name).acceleration(nu, delta), rtol=1e-6, atol=1e-12)


def test_its_zigzags_and_turns_are_the_ships():
    assert max(missed(MARINER, "taylor", zigzag(20.0), turning_circle(25.0, duration=400.0))) < 1e-6


@pytest.mark.parametrize("name", [MARINER, BULKER, "mariner_chislett1965", TANKER])
def test_the_true_terms_give_the_ships_accelerations_far_from_what_was_learnt_from(name):
    nu, delta = motions(name)
    ours = calm_accelerations(baselines(name)["true terms"].dynamics, nu, delta)
    units = ship_named(name).acceleration_units
    torch.testing.assert_close(ours / units, ship_named(name).acceleration(nu, delta) / units, rtol=1e-6, atol=1e-9)


def test_the_tankers_true_terms_sail_every_trial():
    trials = zigzag(10.0, duration=600.0), zigzag(25.0, duration=600.0), turning_circle(20.0, duration=600.0)
    assert max(missed(TANKER, "true terms", *trials)) < 1e-3


@pytest.mark.slow
def test_the_tankers_true_terms_hold_at_other_speeds_with_the_same_rpm():
    speed = 0.5 * ship_named(TANKER).particulars.speed
    trials = [replace(zigzag(20.0, duration=600.0), speed=speed)]
    assert max(missed(TANKER, "true terms", *trials)) < 1e-3


@pytest.mark.parametrize("name, baseline", [(MARINER, "taylor"), (MARINER, "true terms"), (TANKER, "true terms")])
def test_at_another_approach_speed_a_rung_does_what_the_ship_does(name, baseline):
    speed = 0.7 * ship_named(name).particulars.speed
    nu, delta = motions(name)
    ours = calm_accelerations(baselines(name)[baseline].dynamics.on_approach(speed), nu, delta)
    torch.testing.assert_close(ours, ship_named(name).on_approach(speed).acceleration(nu, delta), rtol=1e-5, atol=1e-9)


def test_the_coefficients_of_the_true_terms_are_the_ships_where_the_inertia_is_known():
    table = baselines(TANKER)["true terms"].dynamics.hull.table
    true = ship_named(TANKER).table
    assert true is not None and table is not None
    torch.testing.assert_close(table, true, rtol=1e-6, atol=1e-12)
    assert baselines(TANKER)["true terms"].parameters == int((true != 0).sum())


def test_where_the_known_inertia_differs_sway_and_yaw_share_their_terms():
    table = baselines(BULKER)["true terms"].dynamics.hull.table
    terms = ship_named(BULKER).terms
    row = table[terms.index("vvr")]
    assert row[1] != 0 and ship_named(BULKER).table[terms.index("vvr"), 1] == 0
    assert baselines(BULKER)["true terms"].dynamics.hull.terms == terms


def test_of_a_ship_known_by_its_particulars_alone_there_are_no_true_terms():
    particulars = ship_named(MARINER).particulars
    found, _ = fit_baselines(particulars, clarke_part(particulars), learnt_from(MARINER))
    assert [baseline.name for baseline in found] == ["linear", "taylor"]
    other, _ = fit_baselines(kvlcc2(), clarke_part(kvlcc2()), learnt_from(MARINER))
    assert [baseline.name for baseline in other] == ["linear", "taylor"]
    with pytest.raises(InputError, match="no products to fit"):
        true_terms_baseline(no_part(particulars), clarke_part(particulars), learnt_from(MARINER))


def test_a_tanker_whose_known_part_is_in_another_system_keeps_its_true_terms():
    ship = ship_named(TANKER)
    known = clarke_part(ship)
    baseline = true_terms_baseline(ship, known, to_tuples(sailed(TANKER, *TRAINED[TANKER]), known))
    nu, delta = motions(TANKER)
    units = ship.acceleration_units
    ours = calm_accelerations(baseline.dynamics, nu, delta) / units
    torch.testing.assert_close(ours, ship.acceleration(nu, delta) / units, rtol=1e-6, atol=1e-9)
    assert baseline.dynamics.hull.terms == ship.terms


def test_from_noisy_samples_of_two_manoeuvres_the_series_is_cut_short_and_sails():
    ship, known = ship_named(MARINER), clarke_part(ship_named(MARINER))
    noise = {"u": 0.04, "v": 0.04, "r": 1e-4, "psi": 1e-3}
    runs = [add_noise(r, noise, seed=k) for k, r in enumerate(sailed(MARINER, zigzag(35.0), zigzag(20.0)))]
    tuples = to_tuples([accelerations(r, "smoother") for r in runs], known)
    trial = turning_circle(25.0, duration=400.0)
    cut = taylor_baseline(known, tuples)
    assert 9 < cut.parameters < baselines(MARINER)["taylor"].parameters == 60
    for baseline in (cut, true_terms_baseline(ship, known, tuples)):
        with unchecked():
            (run,) = roll_out(baseline.dynamics, [trial])
        assert distance(run, sailed(MARINER, trial)[0]) < ship.particulars.length


def test_too_few_samples_are_refused():
    tuples = learnt_from(MARINER)
    few = Tuples(tuples.inputs[:30], tuples.targets[:30], tuples.times[:30], tuples.index[:30])
    with pytest.raises(InputError, match="30 samples for 22 terms"):
        taylor_baseline(clarke_part(ship_named(MARINER)), few)


def test_a_recording_too_short_for_a_rung_costs_that_rung_alone():
    tuples = learnt_from(MARINER)
    few = Tuples(*(part[:12] for part in (tuples.inputs, tuples.targets, tuples.times, tuples.index)))
    ship = ship_named(MARINER)
    baselines, missing = fit_baselines(ship, KNOWN[MARINER](ship), few)
    assert "linear" in [baseline.name for baseline in baselines] and "taylor" not in [
        baseline.name for baseline in baselines
    ]
    assert any(text.startswith("taylor: 12 samples") for text in missing)


def test_own_terms_learnt_before_the_network_leave_it_nothing():
    ship = ship_named(MARINER)
    blank = own_part(ship)
    tuples = to_tuples(sailed(MARINER, *TRAINED[MARINER]), blank)
    known = blank.learnt(tuples)
    assert tuples.targets.abs().max() > 1e-2
    assert to_tuples(sailed(MARINER, *TRAINED[MARINER]), known).targets.abs().max() < 1e-9
    with pytest.raises(InputError, match="linear=own"):
        own_part(kvlcc2())
