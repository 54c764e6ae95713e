"""The repaired model running free: predictions of runs that it should know exactly, and errors that are known."""

import numpy as np
import pandas as pd
import pytest
from pytest import approx
from tiers import mainly
from trials import CALM, NOISE, SHIP, run_of, sailed, states_of, tensor, values

from manoeuvre_nn.core.manoeuvre import Manoeuvre, Stage
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.diagnosis.repair import predict, predict_corrected, recorded, start_state
from manoeuvre_nn.effect.current import Current
from manoeuvre_nn.effect.loading import DisplacementChange
from manoeuvre_nn.effect.local import BowThruster
from manoeuvre_nn.effect.propulsion import PowerLimit
from manoeuvre_nn.effect.roll import RollCoupling
from manoeuvre_nn.effect.rudder import RudderAreaLoss, RudderBacklash, RudderDelay, RudderOffset, RudderSlow
from manoeuvre_nn.effect.sensors import HeadingBias, LeverArm, LogScale
from manoeuvre_nn.effect.wind import SteadyWind
from manoeuvre_nn.estimation.corrections import Calibrated, Corrections
from manoeuvre_nn.estimation.hypothesis import Hypothesis
from manoeuvre_nn.recording.preparation import measured, with_measured
from manoeuvre_nn.scoring.free_runs import errors

pytestmark = pytest.mark.usefixtures("unchecked_types")


def turns_after(straight: float) -> Manoeuvre:
    stages = ((0.0, straight), (15.0, 24.0), (-10.0, 40.0), (20.0, None))
    return Manoeuvre("late", "random_rudder", tuple(Stage(a * DEGREE, hold=t) for a, t in stages), duration=140.0)


LATE, BETWEEN = turns_after(46.0), turns_after(46.5)
"""Straight during the warm-up, then turns by the clock, ordered at samples or midway between two."""
LIMITS = {"pos": 0.5, "psi": 0.1, "u": 0.02, "v": 0.02, "r": 0.01, "u_log": 0.02}
"""Errors in m, deg, m/s and deg/s that are next to nothing after 100 s."""
ACTING = [
    [],
    [RudderDelay(SHIP, delay_s=33.0)],
    [PowerLimit(SHIP, rpm_slope=0.4)],
    [HeadingBias(SHIP, bias_deg=2.0), LogScale(SHIP, factor=1.1)],
    [Current(SHIP, speed=1.0, toward_deg=130.0), RudderOffset(SHIP, offset_deg=-2.0)],
    [Current(SHIP, speed=1.0, toward_deg=130.0)],
    [SteadyWind(SHIP, speed=12.0, from_deg=40.0)],
    [RudderOffset(SHIP, offset_deg=2.0)],
    [RudderBacklash(SHIP, width_deg=5.0)],
    [RollCoupling(SHIP, N_phi=0.02)],
    [LeverArm(SHIP, dx_m=-60.0, dy_m=8.0)],
    [BowThruster(SHIP, force_kN=150.0, start_s=60.0, end_s=115.0)],
]


WARMUP = 40.0


def acting(effects) -> Hypothesis:
    return Hypothesis(tuple(effects), tuple(values(e) for e in effects))


def late_run(effects, noise=0.0, **more):
    # The end of a rudder's late record is told by orders, whose times are known to half a step.
    trial = BETWEEN if any(isinstance(e, RudderDelay) for e in effects) else LATE
    return run_of(sailed([trial], effects)[0], noise, **more)


@pytest.mark.parametrize("effects", mainly(5, ACTING), ids=lambda e: " and ".join(x.name for x in e) or "none")
def test_the_true_model_predicts_a_noise_free_run_from_the_warm_up_on(effects):
    run = late_run(effects)
    (found,) = predict(CALM, acting(effects), [run], WARMUP)
    assert found["t"].iloc[0] == 40.0 and len(found) == len(run) - 40
    wrong = errors(found, recorded(run, WARMUP))
    assert all(wrong[k] < LIMITS[k] for k in LIMITS), wrong
    if effects:
        (blind,) = predict(CALM, acting([]), [run], WARMUP)
        assert any(errors(blind, recorded(run, WARMUP))[k] > 10 * wrong[k] + LIMITS[k] for k in LIMITS), (
            "or it shows nothing"
        )


def test_a_slow_rudder_is_predicted_but_for_the_samples_in_which_it_arrives():
    slow = [RudderSlow(SHIP, rate_deg_s=1.3)]
    run = late_run(slow)
    own, blind = (errors(predict(CALM, acting(e), [run], WARMUP)[0], recorded(run, WARMUP)) for e in (slow, []))
    assert own["pos"] < 0.7 < 2.5 < blind["pos"] and own["psi"] < 0.3 < 1.0 < blind["psi"]


def test_nothing_but_the_rudder_is_taken_from_the_recording_after_the_warm_up():
    run = late_run([])
    spoilt = measured(run)
    spoilt[41:] = 99.0
    (found,), (again,) = (
        predict(CALM, acting([]), [run], WARMUP),
        predict(CALM, acting([]), [with_measured(run, spoilt)], WARMUP),
    )
    pd.testing.assert_frame_equal(found, again)


def test_runs_that_are_predicted_together_are_predicted_as_if_alone():
    """Of other lengths, and with values of their own: a thruster at other times."""
    thruster = BowThruster(SHIP, force_kN=150.0, start_s=60.0, end_s=115.0)
    runs = [late_run([thruster]), late_run([thruster]).between(0.0, 110.0), late_run([])]
    table = np.tile(thruster.values.numpy(), (3, 1))
    table[:, :3] = [[150.0, 60.0, 115.0], [150.0, 70.0, 90.0], [80.0, 50.0, 130.0]]
    together = predict(CALM, Hypothesis((thruster,), (table,)), runs, WARMUP)
    for run, row, found in zip(runs, table, together, strict=True):
        (alone,) = predict(CALM, Hypothesis((thruster,), (row[None],)), [run], WARMUP)
        # Steps of the longest run do not end where a shorter one does.
        pd.testing.assert_frame_equal(found, alone, atol=1e-5)


@pytest.mark.parametrize("warmup", mainly(1, [45.0, 40.0]))
def test_a_prediction_begins_at_the_end_of_the_warm_up(warmup):
    """A force with a time of its own acts at that time, wherever the prediction begins."""
    thruster = BowThruster(SHIP, force_kN=150.0, start_s=60.0, end_s=115.0)
    run = late_run([thruster])
    (found,) = predict(CALM, acting([thruster]), [run], warmup)
    assert found["t"].iloc[0] == warmup
    assert errors(found, recorded(run, warmup))["pos"] < LIMITS["pos"]


def test_the_state_at_the_end_of_the_warm_up_is_better_than_the_samples():
    """Noise of ten recordings of one approach: u, r and the heading are averaged over it."""
    record = sailed([LATE])[0]
    off = []
    for seed in range(10):
        run = run_of(record, NOISE, seed).between(0.0, 40.0)
        off.append(start_state(CALM, acting([]), run) - states_of(record)[40])
    rms = np.sqrt(np.mean(np.square(off), axis=0))
    assert (rms < [0.4 * NOISE[6], NOISE[3], 0.4 * NOISE[5], 0.5 * NOISE[0], 0.6 * NOISE[1], 0.5 * NOISE[4]]).all()


def test_the_heel_at_the_end_of_the_warm_up_is_that_of_the_rudder_and_not_of_its_late_record():
    """A rudder ordered 10 s before; the record of it is 8 s late, as told by the same ship with a prompt one."""
    stages = ((0.0, 30.5), (20.0, None))
    trial = Manoeuvre("early", "random_rudder", tuple(Stage(a * DEGREE, hold=t) for a, t in stages), duration=60.0)
    roll, late = RollCoupling(SHIP, N_phi=0.02), RudderDelay(SHIP, delay_s=8.0)
    told, prompt = (run_of(sailed([trial], e)[0]).between(0.0, 40.0) for e in ([roll, late], [roll]))
    assert np.abs(told["delta"] - prompt["delta"]).max() > 10 * DEGREE
    found, expected = start_state(CALM, acting([roll, late]), told), start_state(CALM, acting([roll]), prompt)
    assert len(found) == 8 and np.abs(expected[6:]).min() > 1e-3
    assert found[6:] == approx(expected[6:], rel=0.05), "heel and its rate"


def frame(**columns) -> pd.DataFrame:
    zero = np.zeros(50)
    return pd.DataFrame({k: zero + columns.get(k, 0.0) for k in ("x", "y", "psi", "u", "v", "r", "u_log")})


@pytest.mark.parametrize("where", [0, 20, 40])
def test_a_wild_position_in_the_warm_up_leaves_the_state_at_its_end_alone(where):
    record = sailed([LATE])[0]
    run = run_of(record).between(0.0, 40.0)
    wild = run["x"] + 300.0 * (np.arange(len(run)) == where)
    usual, spoilt = (start_state(CALM, acting([]), r) for r in (run, run.with_channels(x=wild)))
    assert spoilt - usual == approx(np.zeros(6), abs=0.3)  # a sample less of some noise


def test_errors_of_known_offsets_are_these():
    found = errors(frame(x=3.0, y=-4.0, psi=10.0, u=0.2, v=-0.3, r=0.01, u_log=7.5), frame(psi=9.0, u_log=7.0))
    assert found == approx({"pos": 5.0, "psi": 1.0, "u": 0.2, "v": 0.3, "r": 0.01, "u_log": 0.5})


def test_a_heading_that_passes_north_is_compared_the_short_way():
    assert errors(frame(psi=719.0), frame(psi=2.0))["psi"] == approx(3.0)
    assert errors(frame(psi=-179.0), frame(psi=179.0))["psi"] == approx(2.0)


def test_gaps_do_not_count():
    gaps = frame(x=3.0)
    gaps.loc[10:20, ["x", "u"]] = np.nan
    assert errors(frame(), gaps)["pos"] == approx(3.0) and errors(frame(), gaps)["u"] == 0.0


def test_errors_grow_with_the_distance_as_the_mean_square():
    one = frame()
    one.loc[0, "x"] = 10.0
    assert errors(one, frame())["pos"] == approx(10.0 / np.sqrt(50))


def test_a_recording_is_compared_without_its_outliers_and_from_the_warm_up_on():
    run = late_run([], NOISE)
    spoilt = measured(run)
    spoilt[100, 0] += 80.0
    spoilt[120, 4] += 0.3
    table, clean = recorded(with_measured(run, spoilt), WARMUP), recorded(run, WARMUP)
    assert table["t"].iloc[0] == 40.0 and np.isnan(table["x"][60]) and np.isnan(table["psi"][80])
    rest = np.setdiff1d(np.arange(len(table)), [*range(57, 64), *range(77, 84)])
    assert clean.isna().sum().max() <= 2, "noise is no outlier"
    pd.testing.assert_frame_equal(table.loc[rest], clean.loc[rest])
    true = states_of(sailed([LATE])[0])[40:]
    perfect = recorded(late_run([]), WARMUP)[["u", "v"]].to_numpy()
    assert np.abs(perfect - true[:, :2])[np.isfinite(perfect)].max() < 1e-9


def test_runs_without_and_with_corrections_side_by_side_are_those_of_each_model():
    effects = [RudderOffset(SHIP, offset_deg=2.0)]
    h = Hypothesis(tuple(effects), tuple(values(e, 2) for e in effects))
    both = [late_run([]), late_run(effects)]
    shares = tensor(0.05 * np.cos(np.arange(len(Corrections(CALM).names))))
    alone, corrected = predict_corrected(CALM, shares, h, both, WARMUP, 0.2)
    for found, model in ((alone, CALM), (corrected, Calibrated(CALM, shares))):
        for one, other in zip(found, predict(model, h, both, WARMUP, 0.2), strict=True):
            assert one.to_numpy() == approx(other.to_numpy(), abs=1e-6)
    assert abs(alone[0]["psi"].iloc[-1] - corrected[0]["psi"].iloc[-1]) > 0.5


@pytest.mark.slow
def test_effects_on_the_hull_run_on_the_corrected_ship_beside_the_published_one():
    effects = [DisplacementChange(SHIP, factor=1.5), RudderAreaLoss(SHIP, fraction=0.3)]
    h = Hypothesis(tuple(effects), tuple(values(e) for e in effects))
    runs, shares = [late_run(effects)], tensor(0.1 * np.cos(np.arange(len(Corrections(CALM).names))))
    alone, corrected = predict_corrected(CALM, shares, h, runs, WARMUP, 0.2)
    for found, model in ((alone, CALM), (corrected, Calibrated(CALM, shares))):
        assert found[0].to_numpy() == approx(predict(model, h, runs, WARMUP, 0.2)[0].to_numpy(), abs=1e-6)
