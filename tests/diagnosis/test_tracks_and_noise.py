"""The smoother that knows of no effect: the track, the noise of every channel, what is left out."""

from functools import cache

import numpy as np
import pytest
import torch
from fleet import ship_named, unchecked
from pytest import approx
from strangers import Stranger
from tiers import mainly
from trials import CALM, CIRCLE, NOISE, SHIP, ZIGZAG, run_of, sailed, states_of

from manoeuvre_nn.core.channels import MEASURED
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.effect.common import typical
from manoeuvre_nn.effect.current import Current
from manoeuvre_nn.effect.propulsion import PowerLimit
from manoeuvre_nn.effect.wind import SteadyWind
from manoeuvre_nn.estimation.prepared_run import PreparedRun, prepared_run
from manoeuvre_nn.estimation.run_states import RunStates
from manoeuvre_nn.estimation.smoothed_run import first_guess, rounding_step
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.recording.preparation import measured, smooth_shaft, with_measured

SEEN = len(MEASURED) - 1
"""No state explains the shaft speed."""
WHITE = 3
"""Noises of one record."""


@cache
def record(*effects: str) -> Recording:
    made = {"current": Current(SHIP, speed=1.0), "wind": SteadyWind(SHIP, speed=15.0)}
    return sailed([CIRCLE if "wind" in effects else ZIGZAG], [made[e] for e in effects])[0]


def placed(run: Recording) -> PreparedRun:
    with unchecked():
        return prepared_run(CALM, run)


def own_noise(place: PreparedRun) -> np.ndarray:
    """Standard deviations without the allowance for correlation."""
    return (place.noise / np.sqrt(place.inflation))[:SEEN]


@pytest.mark.parametrize("effects", mainly(1, [("wind",), ("current",)]))
def test_noise_is_found_whatever_acts_on_the_ship(effects):
    found = [own_noise(placed(run_of(record(*effects), NOISE, seed))) / NOISE[:SEEN] for seed in range(WHITE)]
    # A median of 240 samples has a standard error of 7 %.
    assert np.mean(found) == approx(1.0, abs=0.1)
    assert np.mean(found, axis=0) == approx(np.ones(SEEN), abs=0.17)
    assert np.max(found) < 1.35 and np.min(found) > 0.65


def test_noise_of_another_size_is_found_too():
    factors = np.array([4.0, 0.5, 3.0, 2.0, 0.5, 3.0, 2.0, 1.0])
    found = [own_noise(placed(run_of(record(), factors * NOISE, seed))) for seed in range(4)]
    assert np.mean(found, axis=0) / (factors * NOISE)[:SEEN] == approx(np.ones(SEEN), abs=0.2)


def test_the_noise_of_few_samples_is_not_what_they_leave_of_the_states():
    """Positions and velocities every 5 s: the states follow each of them by a part."""
    found = []
    for seed in range(4):
        run = run_of(record(), NOISE, seed)
        seen = measured(run)
        seen[np.arange(len(run)) % 5 != 0, :4] = np.nan
        found.append(own_noise(placed(with_measured(run, seen))) / NOISE[:SEEN])
    assert np.mean(found, axis=0) == approx(np.ones(SEEN), abs=0.25)


def test_instruments_that_show_no_noise_are_taken_to_be_good_to_a_fifth_of_usual_ones():
    """14 cm, 8 mm/s over ground, .02 deg, .004 deg/s, 1 cm/s through the water; a tachometer to half a per cent.

    Of a ship that rolls heel is good to .02 deg, its rate to a hundredth of a degree a second.
    """
    found = placed(run_of(record(), derived=()).between(0.0, 60.0)).sample_noise
    assert found == approx([0.14, 0.14, 8e-3, 8e-3, 0.02 * DEGREE, 0.004 * DEGREE, 0.01, 5e-3], rel=0.01)
    assert 0.2 * RunStates(("phi", "p")).first_noise[-2:] == approx([0.02 * DEGREE, 0.0115 * DEGREE], rel=0.01)


def test_a_rounded_channel_has_at_least_the_error_of_rounding():
    """In a turn by just a step a sample the errors are alike for minutes, and their median is no noise."""
    (circle,) = sailed([CIRCLE])
    step = float(np.median(circle["r"][-60:])) * circle.step
    run = run_of(circle, NOISE * np.where(np.arange(len(NOISE)) == 4, 0.05, 1.0), seed=1)
    seen = measured(run)
    seen[:, 4] = np.round(seen[:, 4] / step) * step
    rounded = placed(with_measured(run, seen))
    assert own_noise(rounded)[4] >= abs(step) / np.sqrt(12.0) * 0.999
    lost = np.isnan(measured(rounded.linearised.run)[:, 4]).sum()
    assert lost <= 0.02 * len(run), "rounding makes no outliers"
    values = np.array([[0.5, 0.0, 1.0], [1.0, 0.3, 1.0], [2.5, 0.7, 1.0], [np.nan, 1.3, 1.0]])
    assert rounding_step(values) == approx(np.array([0.5, 0.0, 0.0])), "whole steps, none, one value alone"


@pytest.mark.parametrize("slope", mainly(1, [0.4, 0.0]))
def test_the_noise_of_the_other_channels_is_no_matter_of_the_tachometer(slope):
    (path,) = sailed([ZIGZAG], [PowerLimit(SHIP, rpm_slope=slope)])
    run = run_of(path, NOISE)
    silent = measured(run)
    silent[:, SEEN] = np.nan
    shaft = smooth_shaft(measured(run)[:, SEEN])
    with_it, without = (
        own_noise(placed(with_measured(run.with_channels(shaft=shaft), m))) for m in (measured(run), silent)
    )
    assert with_it == approx(without, rel=0.01)


@pytest.mark.parametrize("channel", ["x", "ve", "r", "u_log"])
def test_a_channel_whose_error_wanders_is_trusted_less(channel):
    k, run = MEASURED.index(channel), run_of(record(), NOISE, seed=1)
    g, wander = np.random.default_rng(5), np.zeros(len(run))
    for i in range(1, len(run)):  # a Markov process of 10 s
        wander[i] = np.exp(-0.1) * wander[i - 1] + np.sqrt(1 - np.exp(-0.2)) * g.standard_normal()
    seen = measured(run)
    seen[:, k] += 2 * NOISE[k] * wander
    coloured, white = placed(with_measured(run, seen)), placed(run)
    assert white.inflation[:SEEN].max() < 1.4
    assert coloured.inflation[k] > 1.6 and coloured.noise[k] > 2.0 * white.noise[k]
    assert coloured.inflation[k] == coloured.inflation[:SEEN].max()


def test_outliers_are_left_out_and_little_else():
    run = run_of(record(), NOISE, seed=2)
    spikes = [
        (50, 0, 30.0),
        (120, 1, -8.0),
        (150, 2, 2.0),
        (130, 3, -0.6),
        (100, 4, 0.02),
        (60, 5, 0.02),
        (180, 6, 3.0),
    ]
    seen = measured(run)
    for k, channel, size in spikes:
        seen[k, channel] += size
    spoilt = placed(with_measured(run, seen))
    marked = np.isnan(measured(spoilt.linearised.run))
    assert all(marked[k, channel] for k, channel, _ in spikes)
    assert marked.sum() < len(spikes) + 8
    assert spoilt.noise[:SEEN] == approx(placed(run).noise[:SEEN], rel=0.1)


def test_gaps_stay_gaps_and_the_track_goes_through_them():
    run = run_of(record(), NOISE, seed=3)
    seen = measured(run)
    seen[100:115, :4] = np.nan
    found = placed(with_measured(run, seen))
    assert np.isnan(measured(found.linearised.run)[100:115, :4]).all()
    off = found.linearised.track - placed(run).linearised.track
    assert np.abs(off[100:115, 3:5]).max() < 3 and np.abs(off[:, 5]).max() < 0.01


def test_the_track_is_closer_to_the_truth_than_the_samples_are():
    """Constant errors apart: what a compass, a log or an antenna may be off is laid aside, whether it is or not."""
    found = placed(run_of(record(), NOISE, seed=4)).linearised.track
    scatter = (found - states_of(record())).std(axis=0)
    # u by the log, r, x, psi; an antenna off the reference point or a stream take up some of the drift.
    assert (scatter[[0, 2, 3, 5]] < 0.7 * NOISE[[6, 5, 0, 4]]).all() and (scatter[[1, 4]] < 2 * NOISE[[3, 1]]).all()


def test_the_first_guess_of_perfect_channels_is_the_motion():
    true, run = states_of(record()), run_of(record())
    guess = first_guess(run)
    assert np.abs(guess - true)[5:-5].max(axis=0) == approx(np.zeros(6), abs=0.3)
    silent = measured(run)
    silent[:, 6] = np.nan
    assert first_guess(with_measured(run, silent))[5:-5, 0] == approx(true[5:-5, 0], abs=0.05), "u over ground"
    drifting = run_of(record("current"))
    assert first_guess(drifting)[5:-5, 0] == approx(states_of(record("current"))[5:-5, 0], abs=0.05), "u by the log"


@pytest.mark.parametrize("speed", mainly(1, [8.0, 10.0]))
def test_a_stream_as_fast_as_the_ship_is_no_drift_of_hers(speed):
    """Across her way a ship is no calm-water model's: begun there, the smoother finds nothing that sails."""
    run = sailed([CIRCLE], [Current(SHIP, speed=speed, toward_deg=90.0)])[0]
    found = placed(run_of(run, NOISE, seed=4)).linearised.track
    assert np.abs(first_guess(run_of(run))[:, 1]).max() > 0.9 * speed
    assert (np.abs(found - states_of(run))[:, [0, 2]] < [0.5, 1e-3]).all() and np.abs(found[:, 1]).max() < 2.0


def test_a_ship_that_a_stream_stops_over_ground_goes_on_through_the_water():
    """Neither log nor gyro: over ground she lies still in her turn, and drifts across her heading."""
    tanker = CalmWater(ship_named("esso_190k"))
    stream = Current(tanker.ship, speed=4.5, toward_deg=250.0)
    with unchecked():
        (sailing,) = roll_out(Vessel(tanker, [stream]), [turning_circle(35.0, duration=800.0)], step=2.0, interval=2.0)
    seen = measured(run_of(sailing, NOISE))
    seen[:, 5:] = np.nan
    run, speed = with_measured(run_of(sailing, NOISE), seen), tanker.particulars.speed
    with unchecked():
        found = prepared_run(tanker, run).linearised.track
    assert first_guess(run)[:, 0].min() < 0 < 0.25 * speed < sailing["u"].min()
    assert found[:, 0] == approx(sailing["u"], abs=0.15 * speed)


@pytest.mark.parametrize("runaway", mainly(1, [2e-3, 4e-3]))
def test_positions_that_run_away_ahead_of_a_slow_turning_ship_leave_her_underway(runaway):
    tanker = CalmWater(ship_named("esso_190k"))
    with unchecked():
        (sailing,) = roll_out(Vessel(tanker), [zigzag(10.0, duration=900.0)], step=2.0, interval=2.0)
    seen = measured(run_of(sailing, NOISE))
    seen[:, 0] += 0.5 * runaway * sailing.time**2  # it would take a stream, and a log that shows twice the speed
    with unchecked():
        speed = prepared_run(tanker, with_measured(run_of(sailing, NOISE), seen)).linearised.track[:, 0]
    assert speed == approx(sailing["u"], abs=0.3 * tanker.particulars.speed)


@pytest.mark.parametrize("size", mainly(1, [2e-3, 3e-3]))
def test_a_ship_that_a_swell_yaws_is_not_smoothed_to_states_that_no_model_sails(size):
    """A yaw acceleration of so many rad/s^2; without a log her way comes to nothing step by step: the model breaks."""
    tanker = CalmWater(ship_named("esso_190k"))
    with unchecked():
        swell = Stranger(
            size / typical(SHIP)[2], "N", lambda s: torch.sin(2 * torch.pi * s.time / 75.0) + 0 * s.u, runs=(1.0,)
        )
        vessel = Vessel(tanker, [swell])
        (sailing,) = roll_out(vessel, [zigzag(20.0, duration=900.0)], step=2.0, interval=2.0)
    seen = measured(run_of(sailing, NOISE))
    seen[:, 6] = np.nan
    with unchecked():
        found = prepared_run(tanker, with_measured(run_of(sailing, NOISE), seen)).linearised
    assert found.sails and np.isfinite(found.track).all()


def test_the_force_that_the_track_needs_is_that_of_the_effect():
    wind = SteadyWind(SHIP, speed=15.0)
    found = placed(run_of(record("wind"), 0.02 * NOISE, seed=5))
    with unchecked():
        s = found.linearised.situation
        true = wind.acceleration(s, s.nu[..., :0]).numpy()
    for k in range(3):
        assert np.corrcoef(found.process[40:-40, k], true[40:-40, k])[0, 1] > 0.85
