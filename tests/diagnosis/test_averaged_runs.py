"""One state for several samples: it tells as much of a ship, and the noise of single samples besides."""

from dataclasses import replace

import numpy as np
import pytest
from fleet import unchecked
from pytest import approx
from test_columns_of_effects import ON_BENCH, misfits
from test_ships_that_roll import CALM as ROLLS
from tiers import only
from trials import CALM, NOISE, SHIP, ZIGZAG, run_of, sailed

from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.diagnosis import diagnose
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.estimation.data_set import WhitenedDataSet, whitened_data_set
from manoeuvre_nn.estimation.prepared_run import prepared_run, samples_a_state
from manoeuvre_nn.recording.preparation import measured, with_measured
from manoeuvre_nn.ship.esso_osaka_model import esso_osaka_mmg


@pytest.mark.parametrize("name", only({"current", "rudder_offset"}, ON_BENCH))
def test_states_of_averages_leave_hardly_more_than_those_of_all_samples(name):
    """Averages of the rudder, without its corners, leave up to ten times as much."""
    effect, left, size = ON_BENCH[name], [], []
    run = run_of(sailed([replace(ZIGZAG, duration=160.0)], [effect])[0])
    for count in (1, 2):
        with unchecked():
            g = misfits(WhitenedDataSet(CALM, [prepared_run(CALM, run, count)]), effect)
        left.append((g[0, 0] - 2 * g[0, 1] + g[1, 1]) / g[0, 0])
        size.append(g[0, 1] / g[1, 1])
    assert left[1] < left[0] + 7e-4
    assert size[1] == approx(size[0], abs=0.01)


def test_how_many_samples_share_a_state_goes_by_the_ship():
    """Two seconds of a full-scale ship, by Froude's law of a model, a tenth of L/U0 at most; all where she rolls."""
    assert SHIP.particulars.time_unit > 20.0
    assert [samples_a_state(CALM, step) for step in (0.5, 1.0, 2.0, 5.0)] == [4, 2, 1, 1]
    model = CalmWater(esso_osaka_mmg())
    longest = float(model.particulars.sized([2.0], [0.5])[0])
    assert longest < 0.3 < 0.1 * model.particulars.time_unit
    assert [samples_a_state(model, share * longest) for share in (0.25, 0.5, 1.0, 2.0)] == [4, 2, 1, 1]
    assert samples_a_state(ROLLS, 0.05) == 1 < samples_a_state(CALM, 0.05)


def test_noise_of_single_samples_is_told_beside_that_of_averages():
    run = run_of(sailed([ZIGZAG])[0], NOISE, 4)
    with unchecked():
        found = prepared_run(CALM, run, 2)
    assert found.sample_noise[:7] == approx(NOISE[:7], rel=0.2)
    assert found.noise[:7] / np.sqrt(found.inflation[:7]) == approx(NOISE[:7] / np.sqrt(2), rel=0.25)
    assert prepared_run(CALM, run).sample_noise[:7] == approx(NOISE[:7], rel=0.2)
    told = diagnose._noise(WhitenedDataSet(CALM, [found]))
    assert told["u"] == found.sample_noise[2] and told["pos"] == approx(np.hypot(*found.sample_noise[:2]))


@pytest.mark.parametrize("every", [2, 3, 7])
def test_noise_of_samples_that_are_rarer_than_the_times_of_a_run_is_theirs(every):
    """Between states of two seconds a sample every two would lie halfway, every three or seven now here, now there."""
    runs = [run_of(sailed([ZIGZAG])[0], NOISE, seed) for seed in range(4, 8)]
    lacks = (np.arange(len(runs[0])) % every > 0)[:, None]
    runs = [with_measured(run, np.where(lacks, np.nan, measured(run))) for run in runs]
    with unchecked():
        found = whitened_data_set(CALM, runs).runs
    rel = 5 / np.sqrt(2 * len(runs) * np.count_nonzero(~lacks))
    assert np.mean([p.sample_noise[:7] for p in found], axis=0) == approx(NOISE[:7], rel=rel)
    assert np.mean([p.noise[:7] for p in found], axis=0) == approx(NOISE[:7], rel=rel)


@pytest.mark.parametrize(("samples", "count"), [(39, 8), (31, 8), (44, 3)])
def test_samples_that_fill_no_average_are_left_out_and_few_are_left_as_they_are(samples, count):
    run = run_of(sailed([ZIGZAG])[0], NOISE, 4).rows(slice(samples))
    with unchecked():
        found = prepared_run(CALM, run, count)
    whole = samples < 4 * count
    assert len(found.linearised.run) == (samples if whole else samples // count)
    assert found.linearised.run.meta["rudder_noise"] == approx(run.meta["rudder_noise"] / (1 if whole else count**0.5))
    assert (found.sample_noise >= found.noise / np.sqrt(found.inflation) * (1 - 1e-9)).all()
    assert found.sample_noise[5] == approx(NOISE[5], rel=1.0)


def test_averages_of_whole_degrees_are_trusted_no_more_than_these():
    run = run_of(sailed([ZIGZAG])[0], NOISE, 4)
    seen = measured(run)
    seen[:, 4] = np.round(seen[:, 4] / DEGREE) * DEGREE
    with unchecked():
        found = prepared_run(CALM, with_measured(run, seen), 2)
    assert found.noise[4] >= DEGREE / np.sqrt(12.0) * (1 - 1e-6)
