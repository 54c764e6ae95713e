"""A channel that never moves, or whose samples come in any order, is told by the others; noise and rest are not."""

from dataclasses import replace

import numpy as np
import pytest
from fleet import TRIALS, rolled, ship_named

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.recording.check.axes import robust_slope
from manoeuvre_nn.recording.check.checks import check_recording
from manoeuvre_nn.recording.check.order import disorder, no_order
from manoeuvre_nn.recording.noise import add_noise

NOISE = {"u": 0.05, "v": 0.05, "r": 0.02 * DEGREE, "x": 1.0, "y": 1.0, "psi": 0.1 * DEGREE, "delta": 0.05 * DEGREE}
"""Of a ship of 160 m."""
SHIPS = ("mariner", "great_lakes_bulker", "esso_190k")
DERIVED = {"all": (), "track": ("u", "v", "r")}
"""What was recorded -> channels that were derived from it."""
WIDE = ("zz20", "tc25", "pullout15_port")
"""Trials in which heading and course turn through more than 20 deg."""


def written(ship: str, trial: str, kind: str = "all", size: float = 1.0, seed: int = 0) -> Recording:
    run = rolled(ship)[trial]
    scale = size * ship_named(ship).particulars.length / 160
    noisy = add_noise(run, {k: sd * scale for k, sd in NOISE.items()}, seed)
    return Recording("run", run.time, {k: noisy[k] for k in NOISE}, meta={"derived": DERIVED[kind]})


def any_order(run: Recording, channel: str) -> Recording:
    """As a reader gives it: the heading unwrapped."""
    shuffled = np.random.default_rng(7).permutation(run[channel])
    return run.with_channels(**{channel: np.unwrap(shuffled % (2 * np.pi)) if channel == "psi" else shuffled})


def test_any_order_has_a_ratio_of_two_and_stays_above_the_critical_one():
    rng = np.random.default_rng(1)
    ratios = [disorder(rng.permutation(np.linspace(0.0, 1.0, 200) ** 3)) for _ in range(2000)]
    assert np.mean([ratio for ratio, _ in ratios]) == pytest.approx(2.0, abs=0.02)
    assert sum(ratio < critical for ratio, critical in ratios) <= 8, "one in a thousand"
    assert disorder(np.full(50, 0.1 + 0.2)) == pytest.approx((np.nan, np.nan), nan_ok=True)


def test_a_yaw_rate_that_never_moves_is_no_steady_turn_where_the_heading_says_that_it_varies():
    for ship in SHIPS:
        run, p = written(ship, "tc25"), ship_named(ship).particulars
        found = no_order(run.with_channels(r=np.full(len(run), run["r"][-1])), p)
        assert found is not None and found.text.startswith("r never moves, while by the heading"), ship
        rate = np.full(len(run), run["r"][-1])
        steady = run.with_channels(r=rate, psi=rate * run.time)
        assert no_order(steady, p) is None
        assert no_order(run.with_channels(r=0 * rate, psi=0 * rate, x=5 * run.time, y=0 * rate), p) is None


def test_nothing_follows_from_a_channel_that_is_zero_throughout():
    assert robust_slope(np.zeros(50), np.ones(50)) == 0.0
    assert robust_slope(np.arange(50.0), 2 * np.arange(50.0)) == pytest.approx(2.0)


@pytest.mark.parametrize("kind", DERIVED)
@pytest.mark.parametrize("channel", ["x", "y", "psi"])
@pytest.mark.parametrize("trial", WIDE)
def test_a_position_or_a_heading_in_any_order_or_at_rest_is_refused(trial, channel, kind):
    for ship in SHIPS:
        run, p = written(ship, trial, kind), ship_named(ship).particulars
        for spoilt, said in (
            (any_order(run, channel), "has no order in time"),
            (run.with_channels(**{channel: np.full(len(run), run[channel][9])}), "never moves"),
        ):
            found = no_order(spoilt, p)
            assert found is not None and found.verdict == "refuse", (ship, said)
            assert found.text.startswith(f"{channel} {said}") and f"holds {channel}" in found.remedy


@pytest.mark.parametrize("channel", ["r", "u", "v"])
def test_a_rate_in_any_order_is_refused_where_it_is_no_noise(channel):
    for ship in SHIPS:
        run = written(ship, "zz20", size=0.3)
        found = no_order(any_order(run, channel), ship_named(ship).particulars)
        assert found is not None and found.text.startswith(f"{channel} has no order"), ship


def test_a_gyro_that_shows_so_little_that_its_noise_is_all_that_is_seen_has_not_lost_the_order():
    """That is an error of the instrument, to be weighed: samples that were mixed up would vary as the motion does."""
    for ship in SHIPS:
        run, p = written(ship, "zz20"), ship_named(ship).particulars
        noise = np.random.default_rng(5).normal(0.0, 0.3 * run["r"].std(), len(run))
        little = run.with_channels(r=0.05 * run["r"] + noise)
        assert disorder(little["r"])[0] > disorder(little["r"])[1] and no_order(little, p) is None, ship


@pytest.mark.parametrize("kind", DERIVED)
@pytest.mark.parametrize("size", [0.0, 1.0, 5.0])
def test_no_ship_in_no_trial_is_complained_of(size, kind):
    for ship in SHIPS:
        for trial in TRIALS:
            found = no_order(written(ship, trial, kind, size, seed=3), ship_named(ship).particulars)
            assert found is None, (ship, trial, found)


def test_noise_about_a_straight_course_is_no_disorder():
    """y is noise alone, and so is the heading: nothing says that they should move."""
    for seed in range(20):
        run = written("esso_190k", "straight", "track", size=5.0, seed=seed)
        run = run.with_channels(y=np.random.default_rng(seed).normal(0.0, 5.0, len(run)))
        assert disorder(run["y"])[0] > 1.5
        assert no_order(run, ship_named("esso_190k").particulars) is None


def test_a_ship_that_turns_at_anchor_is_not_complained_of(ship):
    t = np.arange(0.0, 600.0)
    rng = np.random.default_rng(0)
    x, y = rng.normal(0.0, 1.0, (2, len(t)))
    run = Recording("run", t, {"x": x, "y": y, "psi": 0.8 * np.sin(t / 150), "delta": 0 * t})
    assert no_order(run, ship) is None


def test_samples_that_lack_do_not_matter(ship):
    run = written("mariner", "zz20", "track")
    holes = {k: np.where(np.arange(len(run)) % 7 == 3, np.nan, run[k]) for k in ("x", "y", "psi")}
    assert no_order(run.with_channels(**holes), ship) is None
    shuffled = any_order(run, "x")
    found = no_order(shuffled.with_channels(**{**holes, "x": np.where(run.time % 5 == 0, np.nan, shuffled["x"])}), ship)
    assert found is not None and found.text.startswith("x has no order")


def test_degrees_taken_for_radians_are_still_told(ship):
    run = written("mariner", "zz20")
    fast = run.with_channels(psi=np.unwrap(run["psi"] / DEGREE))
    with pytest.raises(InputError, match="psi looks like degrees"):
        check_recording(fast, ship)


@pytest.mark.parametrize("channel", ["x", "y", "psi"])
def test_no_model_is_fitted_to_it(channel, ship):
    with pytest.raises(InputError, match=f"recording run: {channel} has no order in time"):
        check_recording(any_order(written("mariner", "zz20", "track"), channel), ship)


@pytest.mark.parametrize("channel", ["x", "y", "psi"])
@pytest.mark.parametrize("trial", ["zz20", "tc25"])
def test_a_track_that_does_not_go_where_the_ship_heads_is_refused(trial, channel):
    """Positions, heading and rudder alone: a mirrored axis was taken for sway."""
    for ship in SHIPS:
        p, run = ship_named(ship).particulars, written(ship, trial, "track", size=0.3)
        mirrored = run.with_channels(**{channel: -run[channel]})
        north, east = (np.gradient(mirrored[k], run.time) for k in "xy")
        cos, sin = np.cos(mirrored["psi"]), np.sin(mirrored["psi"])
        derived = {
            "u": north * cos + east * sin,
            "v": east * cos - north * sin,
            "r": np.gradient(mirrored["psi"], run.time),
        }
        with pytest.raises(InputError, match="course over ground|stays below .* rudder sign|looks"):
            check_recording(replace(mirrored, channels={**mirrored.channels, **derived}), p)
