"""Diagnosis of ships that roll: heel and roll rate are states of their runs, recorded or not."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import torch
from fleet import unchecked
from pytest import approx
from tiers import mainly

from manoeuvre_nn.commands.simulate import as_sensed
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.core.manoeuvre import Manoeuvre, Stage
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.diagnosis.case import Question, case_of
from manoeuvre_nn.diagnosis.diagnose import diagnose
from manoeuvre_nn.diagnosis.repair import predict
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.effect.current import Current
from manoeuvre_nn.effect.roll import RollCoupling
from manoeuvre_nn.effect.rudder import RudderOffset
from manoeuvre_nn.effect.wind import SteadyWind
from manoeuvre_nn.estimation.corrections import OF_ROLL, Calibrated, Corrections
from manoeuvre_nn.estimation.effect_columns import contribution
from manoeuvre_nn.estimation.hypothesis import Hypothesis
from manoeuvre_nn.estimation.linearised_run import LinearisedRun, Rate, linearise
from manoeuvre_nn.estimation.prepared_run import prepared_run
from manoeuvre_nn.manoeuvre.turning import tactical_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.recording.noise import add_noise
from manoeuvre_nn.recording.preparation import MAX_STEP
from manoeuvre_nn.ship.container import container

SHIP = container(gm=0.6, screws=2)
CALM = CalmWater(SHIP)
ZIGZAGS = [replace(zigzag(20.0, duration=120.0), name="zz20"), zigzag(10.0, first="port", duration=120.0)]
CIRCLES = [tactical_circle(a, approach=5.0, turn_deg=180.0) for a in (15.0, 30.0)]
NOISE = {"x": 0.7, "y": 0.7, "u": 0.04, "v": 0.04, "r": 3.5e-4, "psi": 1.7e-3, "delta": 1.7e-3}
NOISE |= {"phi": 1.7e-3, "p": 1e-3}
HEEL = ("phi", "p")
STEP = MAX_STEP * SHIP.particulars.time_unit
"""What recordings of this ship are read off at [s]."""


TIMED = Manoeuvre(
    "timed", "random_rudder", tuple(Stage(a * DEGREE, hold=20 * STEP) for a in (10.0, -20.0, 20.0, -5.0)), 100 * STEP
)
"""Orders by the clock, so that effects do not shift them."""


def sailed(trials, effects=()) -> list[Recording]:
    with unchecked():
        return roll_out(Vessel(CALM, list(effects)), list(trials), step=STEP, interval=STEP)


def prepared_runs(runs) -> tuple[Recording, ...]:
    return case_of([as_sensed(r) for r in runs], SHIP, held_out=[]).runs


def without_heel(run: Recording) -> Recording:
    return replace(run, channels={k: c for k, c in run.channels.items() if k not in HEEL})


@cache
def calm_record() -> Recording:
    return sailed([TIMED])[0]


def states_of(record: Recording) -> np.ndarray:
    return record.stacked("u", "v", "r", "x", "y", "psi", *HEEL)


def about_itself(record: Recording) -> LinearisedRun:
    (run,) = prepared_runs([record])
    with unchecked():
        track = record.resampled(run.time).stacked("u", "v", "r", "x", "y", "psi", *HEEL)
        return linearise(run, Rate(CALM), track)


def test_a_noise_free_run_about_its_own_track_leaves_nothing():
    line = about_itself(calm_record())
    assert line.track.shape[1] == 8 and line.transition.shape[1:] == (12, 12)
    small = np.array([2e-3, 2e-3, 2e-5, 5e-3, 5e-3, 2e-5, 1e-4, 1e-4])
    assert np.quantile(np.abs(line.defect) / small, 0.98, axis=0).max() < 1.0
    assert np.abs(line.residual[:, -2:]).max() < 1e-9 and line.present[:, -2:].all()


@pytest.mark.parametrize(
    "effect", mainly(1, [SteadyWind(SHIP, speed=1.0, from_deg=60.0), RudderOffset(SHIP, offset_deg=0.1)])
)
def test_an_effect_carried_on_by_the_transitions_is_the_difference_of_two_simulations_heel_included(effect):
    (record,), calm = sailed([TIMED], [effect]), calm_record()
    line, other = about_itself(calm), about_itself(record)
    with unchecked():
        c = contribution(effect, effect.values.numpy()[None], line)
    off = np.zeros((len(line.track), 12))
    for k in range(len(line.track) - 1):
        off[k + 1] = line.transition[k] @ off[k]
        off[k + 1, :8] += c.moved[k, :, 0]
    happened = other.track - line.track
    largest = np.abs(happened).max(axis=0)
    assert largest[6] > 2e-4 and (np.abs(off[:, :8] - happened).max(axis=0) < 0.08 * largest).all()


def test_what_is_corrected_of_a_ship_that_rolls_is_all_that_acts_on_it():
    """Hull, rudder and heel by 100 % in every equation are the whole of the rates once more."""
    corrections, line = Corrections(CALM), about_itself(calm_record())
    delta = torch.tensor(line.run["delta"])
    with unchecked():
        rows, rates = corrections(line.moving, delta), Rate(CALM)(line.moving, delta, torch.ones_like(delta))
    of_forces = [f"{e}{part}" for part in ("hull", "rudder") for e in "XYN"] + list(OF_ROLL[:-1])
    whole = rows[:, [corrections.names.index(name) for name in of_forces]].sum(dim=1)
    torch.testing.assert_close(whole[:, :3], rates[:, :3], rtol=1e-6, atol=1e-12)
    torch.testing.assert_close(whole[:, 4], rates[:, 4], rtol=1e-6, atol=1e-12)
    assert not whole[:, 3].any(), "the rate of heel is no force"
    shares = torch.zeros(len(corrections.names), dtype=torch.float64)
    shares[corrections.names.index("Kheel")] = 0.1
    state = torch.tensor([[8.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.1, 0.0]], dtype=torch.float64)
    stiff = Calibrated(CALM, shares)(state, Inputs(state[:, 1])) - CALM(state, Inputs(state[:, 1]))
    still = CALM(torch.nn.functional.pad(state[:, :6], (0, 2)), Inputs(state[:, 1]))
    assert float(stiff[0, 7]) == approx(0.1 * float((CALM(state, Inputs(state[:, 1])) - still)[0, 7]), rel=0.2)


@pytest.mark.parametrize("recorded", [True, False])
def test_heel_is_found_whether_it_was_recorded_or_not(recorded):
    run = add_noise(calm_record(), NOISE, seed=3)
    (seen,) = prepared_runs([run if recorded else without_heel(run)])
    with unchecked():
        found = prepared_run(CALM, seen)
    true = calm_record().resampled(seen.time)["phi"]
    off = found.linearised.track[20:, 6] - true[20:]
    assert np.abs(true).max() > 4 * DEGREE
    assert off.std() < (0.1 if recorded else 1.5) * DEGREE
    if recorded:
        assert found.noise[8:] == approx([NOISE["phi"], NOISE["p"]], rel=0.3)


def test_sides_that_differ_drive_the_run():
    parted = replace(TIMED, shaft_split=0.2, rudder_split=3.0 * DEGREE)
    line = about_itself(sailed([parted])[0])
    assert set(line.sides) == {"delta_split", "shaft_split"}
    assert line.run["shaft_split"] == approx(0.2, rel=1e-6) and line.run["delta_split"] == approx(3 * DEGREE, rel=1e-3)
    blind = replace(line.run, channels={k: c for k, c in line.run.channels.items() if not k.endswith("_split")})
    with unchecked():
        alike = linearise(blind, Rate(CALM), line.track)
        (free,) = predict(CALM, Hypothesis((), ()), [line.run], 20.0)
    assert np.abs(line.defect[:, 2]).mean() < 0.05 * np.abs(alike.defect[:, 2]).mean()
    assert np.abs(free["psi"].to_numpy() * DEGREE - line.track[-len(free) :, 5]).max() < 1.0 * DEGREE


def candidates():
    return [kind(SHIP) for kind in (SteadyWind, Current, RudderOffset)]


@pytest.mark.slow
def test_the_wind_on_a_ship_that_rolls_is_named_with_its_parameters():
    runs = sailed([*ZIGZAGS, CIRCLES[0]], [SteadyWind(SHIP, speed=12.0, from_deg=60.0)])
    runs = [add_noise(run, NOISE, seed=k) for k, run in enumerate(runs)]
    runs = [as_sensed(without_heel(r)) for r in runs]
    with unchecked():
        found = diagnose(Question(case_of(runs, SHIP, held_out=[runs[1].name]), CALM, candidates()[::2]))
    assert found.model == ["wind_steady"]
    speed, origin = found.causes[0].parameters
    assert speed.value == approx(12.0, abs=max(0.6, 3 * speed.error)) and origin.value == approx(60.0, abs=3.0)
    (proof,) = found.proofs
    assert proof.rmse_after["pos"] < 0.2 * proof.rmse_before["pos"]


@pytest.mark.slow
@pytest.mark.parametrize("tried", [1, 3])
def test_calm_recordings_of_a_ship_that_rolls_raise_no_alarm(tried):
    runs = [as_sensed(add_noise(r, NOISE, seed=k)) for k, r in enumerate(sailed([ZIGZAGS[0], CIRCLES[0]]))]
    with unchecked():
        found = diagnose(Question(case_of(runs, SHIP, held_out=[]), CALM, candidates()[:tried]))
    assert found.verdict == "none" and not found.model


def test_a_ship_that_rolls_by_itself_takes_no_second_roll():
    with pytest.raises(InputError, match="rolls by itself"):
        RollCoupling(SHIP)
    RollCoupling(container(rolls=False))


def test_all_corrections_at_once_are_the_sum_of_their_rows():
    corrections, draw = Corrections(CALM), torch.Generator().manual_seed(3)
    moving = torch.randn(6, 5, generator=draw, dtype=torch.float64) * torch.tensor([1.0, 0.5, 0.01, 0.1, 0.02])
    moving[:, 0] += SHIP.particulars.speed
    delta, shares = (torch.randn(*size, generator=draw).double() * 0.2 for size in ((6,), (6, len(corrections.names))))
    together, rows = corrections.together(moving, delta, shares), corrections(moving, delta)
    torch.testing.assert_close(together, (rows * shares[..., None]).sum(dim=-2), rtol=1e-12, atol=1e-15)
    assert (rows[:, -len(OF_ROLL) :].abs().amax(dim=(0, 2)) > 0).all(), "each of those of roll adds something"
