import numpy as np
import pytest
from fleet import unchecked
from rival_runs import CALM, SHIP, sailed
from tiers import mainly

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.effect.current import Current
from manoeuvre_nn.effect.propulsion import HullFouling, PowerLimit
from manoeuvre_nn.effect.rudder import RudderOffset
from manoeuvre_nn.effect.sensors import HeadingBias, LeverArm, LogScale, RateBias
from manoeuvre_nn.estimation.hypothesis import Hypothesis
from manoeuvre_nn.recording.preparation import measured, with_measured
from studies.concealed_trial.rivals.track import ROWS, track
from studies.concealed_trial.rivals.track import _filled as filled
from studies.concealed_trial.rivals.whitened import SCATTER, WhitenedRuns

FIRST = {
    "log": Current(SHIP, speed=0.5, toward_deg=70.0), "X": HullFouling(SHIP, added_resistance=0.4),
    "shaft": PowerLimit(SHIP, rpm_slope=0.3), "N": RudderOffset(SHIP, offset_deg=1.5),
    "Y": HeadingBias(SHIP, bias_deg=2.0), "gyro": RateBias(SHIP, bias_deg_s=0.05),
}  # fmt: skip
"""Row in which an effect shows."""
OTHERS = {"Y": LeverArm(SHIP, dx_m=40.0, dy_m=5.0), "log": LogScale(SHIP, factor=1.05)}


@pytest.fixture(autouse=True)
def quick():
    with unchecked():
        yield


def stacked(runs, effect=None) -> np.ndarray:
    rows = []
    for run in runs:
        t = track(CALM, run)
        taken = () if effect is None else t.contribution(effect, effect.values.numpy()[None])
        rows.append(t.errors(*taken)[..., 0])
    return np.concatenate(rows)


@pytest.fixture(scope="module")
def calm():
    with unchecked():
        return stacked(sailed(noise=0.0))


def test_calm_water_leaves_next_to_nothing_of_perfect_recordings(calm):
    assert np.sqrt((calm**2).mean(axis=0)).max() < 0.003


@pytest.mark.parametrize(
    "row, effect", mainly(2, [*FIRST.items(), *OTHERS.items()]), ids=lambda x: getattr(x, "name", x)
)
def test_an_effect_shows_in_its_row_and_is_gone_once_its_contribution_is_taken_off(row, effect, calm):
    runs = sailed([effect], noise=0.0)
    before, after = stacked(runs), stacked(runs, effect)
    k = ROWS.index(row)
    assert np.abs(before[:, k]).max() > 10 * np.abs(calm[:, k]).max()
    assert np.sqrt((after**2).mean(axis=0)) == pytest.approx(np.sqrt((calm**2).mean(axis=0)), abs=0.003)


def test_gaps_and_spikes_do_not_reach_the_track():
    run = sailed(noise=0.1)[1]
    seen = measured(run)
    seen[50:53, 5] = np.nan
    seen[120, 0] += 40.0
    spoiled = with_measured(run, seen)
    good, bad = track(CALM, run), track(CALM, spoiled)
    assert np.abs(good.channels[:, 0] - bad.channels[:, 0]).max() < 0.5
    assert np.abs(good.channels[:, 5] - bad.channels[:, 5]).max() < 1e-3


def test_good_samples_stay_where_a_channel_runs_one_way_and_spikes_there_do_not():
    rng, t = np.random.default_rng(4), np.arange(400.0)
    running = 1.2 * t + 0.7 * rng.standard_normal(400)  # a position: most samples are the median of their neighbours
    assert filled(running, 0.7) == pytest.approx(running, abs=1e-9)
    creeping = 0.003 * t + 1e-6 * rng.standard_normal(400)  # smoother than its sensor is said to be
    assert filled(creeping, 0.04) == pytest.approx(creeping, abs=1e-9)
    spoiled = running.copy()
    spoiled[[50, 90, 92, 397]] += [30.0, -8.0, 40.0, 9.0]
    assert filled(spoiled, 0.7) == pytest.approx(running, abs=3.0)
    assert (filled(spoiled, 0.7) != spoiled).sum() == 4


def test_a_run_without_a_channel_is_refused_in_a_line():
    run = sailed()[0]
    seen = measured(run)
    seen[:, 6] = np.nan
    with pytest.raises(InputError, match="has no u_log: the rival methods need all channels"):
        track(CALM, with_measured(run, seen))


@pytest.mark.slow
def test_errors_by_noise_have_the_variance_that_is_said():
    data = WhitenedRuns(CALM, sailed(noise=0.0))
    errors = WhitenedRuns(CALM, sailed(seed=10)).errors - data.errors
    said = np.diag(data.covariance - data.nuisances @ data.nuisances.T).reshape(-1, 6).mean(axis=0)
    ratio = (errors**2).mean(axis=0) / said
    # An allowance for rough water is in the first three, which these runs do not need; damping is linear there.
    assert (ratio[:5] > 0.15).all()
    assert (ratio[:5] < 4.0).all()


def test_shares_of_the_coefficients_explain_what_wrong_coefficients_leave():
    data = WhitenedRuns(CALM, sailed(noise=0.0))
    biggest = 1 + int(np.abs(data.nuisances[:, 1:]).max(axis=0).argmax())
    left = 2.0 * data.nuisances[:, biggest]
    data.tried = lambda *_: left.reshape(*data.errors.shape, 1)
    found = data.shares(Hypothesis((), ())) / SCATTER
    assert np.abs(data.nuisances[:, 1:] @ found - left).max() < 0.2 * np.abs(left).max()
