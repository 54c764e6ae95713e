"""The referee's chance against what it says of itself: scatter, random force, noise, outliers, recorders.

Nothing is sailed: only drawn. Seeds are fixed; a tolerance that a right referee would break in one of a thousand seeds
is written as the statistic's own at p = .001.
"""

from collections import Counter
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from pytest import approx
from scipy.stats import chisquare, kstest, norm, uniform

from studies.concealed_trial import record
from studies.concealed_trial.channels import published, seconds_of
from studies.concealed_trial.condition import Tables, scatter
from studies.concealed_trial.drawing import (
    CUBIC,
    CasePlan,
    _drawn,
)
from studies.concealed_trial.effects import NOISE
from studies.concealed_trial.helm import Run
from studies.concealed_trial.model_error import coloured, with_model_error
from studies.concealed_trial.motion import SailedRuns
from studies.concealed_trial.ships import trial_ships
from studies.concealed_trial.truth import ConcealedEffect, build

P = 1e-3
SHIPS = trial_ships()
CLEAN = CasePlan("mariner", (), ())


@pytest.fixture(scope="module")
def drawn():
    """Many clean cases as they are drawn."""
    return [_drawn(11, index, 0, CLEAN, 1.0) for index in range(400)]


def even(counts, shares=None):
    """Whether counts are as shares say, by chi-square."""
    counts = list(counts)
    expected = None if shares is None else sum(counts) * np.array(shares)
    return chisquare(counts, expected).pvalue > P


def spread(values, sd):
    """Whether the standard deviation of normal numbers is as stated, by chi-square's normal limit."""
    values = np.asarray(values)
    return abs(values.std() / sd - 1) < norm.isf(P / 2) / np.sqrt(2 * values.size)


@pytest.mark.parametrize("name", SHIPS)
def test_coefficients_scatter_by_their_size_and_those_of_a_term_in_y_and_n_together(name):
    rng, nominal = np.random.default_rng(1), Tables.of(SHIPS[name])
    rows = []
    for _ in range(1500):
        tables = Tables.of(SHIPS[name])
        scatter(tables, 0.04, rng)
        rows.append({k: tables.k[k] / v - 1 for k, v in nominal.k.items() if v})
        assert tables.inertia == nominal.inertia and tables.ship is SHIPS[name]
    errors = {k: np.array([row[k] for row in rows]) for k in rows[0]}
    hydrodynamic = [k for k in errors if k[0] in "XYN" and not k.endswith("z")]
    assert {k for k in errors if errors[k].any()} == set(hydrodynamic), "depth terms, thrust and race stay"
    assert all(spread(errors[k], 0.04) for k in hydrodynamic)
    assert kstest(errors[hydrodynamic[0]] / 0.04, "norm").pvalue > P
    both = [k[1:] for k in hydrodynamic if k[0] == "Y" and f"N{k[1:]}" in errors]
    together = [np.corrcoef(errors[f"Y{term}"], errors[f"N{term}"])[0, 1] for term in both]
    assert len(both) >= 4 and together == approx([0.6] * len(both), abs=0.06)  # three standard errors
    apart = [(f"Y{a}", f"N{b}") for a, b in pairwise(both)]
    apart += [(f"X{t}", f"Y{t}") for t in both if f"X{t}" in errors]
    assert max(abs(np.corrcoef(errors[a], errors[b])[0, 1]) for a, b in apart) < 0.1


def test_what_is_wrong_in_every_case_is_drawn_from_the_stated_ranges(drawn):
    assert kstest([c.coefficient_sd for c in drawn], uniform(0.03, 0.03).cdf).pvalue > P
    assert kstest([c.latency for c in drawn], uniform(0.0, 0.5).cdf).pvalue > P
    for channel, sd in NOISE.items():
        assert kstest([c.noise[channel] / sd for c in drawn], uniform(0.8, 0.5).cdf).pvalue > P, channel
    outliers = Counter(c.outliers for c in drawn)
    assert set(outliers) == {0.0, 0.003} and even([outliers[0.0], outliers[0.003]], [2 / 3, 1 / 3])
    assert even(Counter(c.cubic[0] for c in drawn)[term] for term in CUBIC)
    assert spread([c.cubic[1] for c in drawn], 0.05) and abs(np.mean([c.cubic[1] for c in drawn])) < 3.3 * 0.05 / 20
    assert {c.model_error_size for c in drawn} == {0.02}
    assert len({c.chance for c in drawn}) == len({c.salt for c in drawn}) == len({c.name for c in drawn}) == 400
    half = [_drawn(11, index, 0, CLEAN, 0.5) for index in range(5)]
    assert [c.coefficient_sd for c in half] == approx([0.5 * c.coefficient_sd for c in drawn[:5]])
    assert [c.cubic[1] for c in half] == approx([0.5 * c.cubic[1] for c in drawn[:5]])
    assert {c.model_error_size for c in half} == {0.01}


def test_nominal_noise_is_that_of_the_format():
    assert NOISE == {
        "position_m": 0.7, "gps_velocity_m_s": 0.04, "heading_deg": 0.1, "yaw_rate_deg_s": 0.02, "log_m_s": 0.05,
        "rudder_deg": 0.1, "rpm": 0.1,
    }  # fmt: skip


def test_coloured_noise_starts_at_nothing_and_forgets_by_its_time():
    series, tau = coloured(np.random.default_rng(2), 161, (4000,), 30.0), 30.0
    assert not series[0].any()
    for k in (1, 10, 40, 160):
        assert spread(series[k], np.sqrt(1 - np.exp(-2 * k / tau))), k
    for lag in (5, 30, 60):
        found = np.corrcoef(series[100], series[100 + lag])[0, 1]
        assert found == approx(np.exp(-lag / tau), abs=0.05)
    assert abs(np.corrcoef(series[100, :2000], series[100, 2000:])[0, 1]) < 0.08


@pytest.mark.parametrize("name", ["mariner", "esso_tanker"])
def test_the_random_force_has_its_share_of_a_rudders_force_in_each_equation(drawn, name):
    """2 % of .008, .02 and .01 of the unit; 30 s; as many courses as runs."""
    ship = SHIPS[name]
    runs = tuple(Run(f"r{k:03d}", "fit", "tc20", "port", 0.0, 160) for k in range(1500))
    case = replace(drawn[0], ship=ship, runs=runs)
    error = with_model_error(case, np.random.default_rng(3)).model_error
    assert error.shape == (162, 3, 1500)
    unit = 0.5 * 1025 * ship.length * ship.draught * ship.speed**2
    late = error[150] / (0.02 * unit * np.array([0.008, 0.02, 0.01 * ship.length]))[:, None]
    assert all(spread(row, np.sqrt(1 - np.exp(-10.0))) for row in late)
    assert np.abs(np.corrcoef(late) - np.eye(3)).max() < 0.1
    assert np.corrcoef(error[120, 1], error[150, 1])[0, 1] == approx(np.exp(-1), abs=0.08)
    none = with_model_error(replace(case, model_error_size=0.0), np.random.default_rng(3)).model_error
    assert not none.any()


def test_the_coefficients_of_a_case_come_before_all_other_chance(drawn):
    """Runs that are sailed later meet the same ship in another sea."""
    case = replace(
        drawn[0], effects=(ConcealedEffect("wind_gusty", {"speed": 12.0, "from_deg": 40.0, "gust_sd": 2.0}),)
    )
    one, again, other = (
        with_model_error(case, np.random.default_rng(case.chance), fresh)
        for fresh in (None, None, np.random.default_rng(5))
    )
    np.testing.assert_array_equal(one.equations.table, other.equations.table)
    np.testing.assert_array_equal(one.model_error, again.model_error)
    assert np.abs(one.model_error - other.model_error).max() > 0
    exact = with_model_error(replace(case, coefficient_sd=0.0), np.random.default_rng(5))
    np.testing.assert_allclose(exact.equations.table, build(case.ship, [], ["r"]).equations.table)


ROWS = 12_001


def still(case, u=7.0, psi=0.5, step=1.0):
    """A track that sails straight on, and the truth that belongs to it."""
    t = np.arange(float(ROWS))
    state = np.zeros((ROWS, 9, 1))
    state[:, 0, 0], state[:, 1, 0], state[:, 2, 0], state[:, 3, 0] = u * np.cos(psi) * t, u * np.sin(psi) * t, psi, u
    held = np.full((ROWS, 1), np.radians(4.0))
    track = SailedRuns(t, state, held, held, np.full((ROWS, 1), 70.0), step)
    return build(case.ship, case.effects, ["r01"]), track


def recorded(case, seed=1):
    """Noisy channels of that track before gaps, and the same without noise."""
    run = Run("r01", "fit", "tc20", "port", 10.0, ROWS - 1)
    silent = replace(case, noise=dict.fromkeys(NOISE, 0.0))
    return [record._channels(c, *still(c), 0, run, np.random.default_rng(seed)) for c in (case, silent)]


def test_every_channel_has_white_noise_of_its_own_size(drawn):
    noisy, silent = recorded(drawn[0])
    noise = {name: noisy[name] - silent[name] for name in noisy}
    noise["psi"] = np.degrees(noise["psi"])
    of = {
        "x_north": "position_m", "y_east": "position_m", "north": "gps_velocity_m_s", "east": "gps_velocity_m_s",
        "psi": "heading_deg", "r": "yaw_rate_deg_s", "u_log": "log_m_s", "delta": "rudder_deg", "n": "rpm",
    }  # fmt: skip
    assert {name for name in noise if noise[name].any()} == set(of)
    for name, channel in of.items():
        assert spread(noise[name], drawn[0].noise[channel]), name
        assert abs(np.corrcoef(noise[name][1:], noise[name][:-1])[0, 1]) < 3.3 / np.sqrt(ROWS), name
    across = np.corrcoef([noise[name] for name in of]) - np.eye(len(of))
    assert np.abs(across).max() < 4 / np.sqrt(ROWS)
    assert (silent["delta_order"][0], silent["delta"][0], silent["n"][0]) == approx((4.0, 4.0, 70.0))
    assert silent["u_log"][0] == approx(7.0) and silent["psi"][0] == approx(0.5) and silent["r"][0] == approx(0.0)


def test_the_receiver_is_late_by_the_latency(drawn):
    case = replace(drawn[0], latency=0.4)
    _, silent = recorded(case)
    t = np.arange(float(ROWS))
    np.testing.assert_allclose(silent["x_north"], 7.0 * np.cos(0.5) * (t - 0.4), atol=1e-6)
    np.testing.assert_allclose(silent["y_east"], 7.0 * np.sin(0.5) * (t - 0.4), atol=1e-6)
    # In a turn the velocity is that of before, to first order.
    truth, (n, rate) = build(case.ship, [], ["r01"]), (200, 0.01)
    psi = rate * np.arange(float(n))
    state = np.stack([np.sin(psi) / rate, (1 - np.cos(psi)) / rate, psi, 1 + 0 * psi, 0 * psi, rate + 0 * psi], axis=1)
    position, velocity = record.antenna(truth, state, np.arange(float(n)), 0.4)
    np.testing.assert_allclose(velocity[:, 5:-5], [np.cos(psi - 0.004)[5:-5], np.sin(psi - 0.004)[5:-5]], atol=3e-5)
    np.testing.assert_allclose(position[0], np.sin(psi - 0.004) / rate, atol=1e-3)


def finished(case, seed=4):
    noisy, _ = recorded(replace(case, noise=dict.fromkeys(NOISE, 0.0)))
    return record._finish(case, noisy, np.random.default_rng(seed))


def test_a_hundredth_of_the_samples_is_missing_and_the_rest_is_rounded_as_the_format_says(drawn):
    table = finished(replace(drawn[0], outliers=0.0))
    gaps = {name: table[name].isna() for name in ("x_north", "psi", "r", "u_log")}
    allowed = 3.3 * np.sqrt(0.01 * 0.99 / ROWS)
    assert all(gap.mean() == approx(0.01, abs=allowed) for gap in gaps.values())
    assert all((table[name].isna() == gaps["x_north"]).all() for name in record.GPS), "the receiver is out as a whole"
    assert not (gaps["x_north"] == gaps["psi"]).all() and not (gaps["r"] == gaps["u_log"]).all()
    assert table[["t", "delta", "delta_order", "n"]].notna().all().all()
    assert record.DECIMALS == {"t": 1, "x_north": 2, "y_east": 2, "sog": 3, "cog": 2, "psi": 2, "u": 3, "v": 3,
                               "u_log": 3, "r": 3, "delta_order": 2, "delta": 2, "n": 2}  # fmt: skip
    for name, digits in record.DECIMALS.items():
        np.testing.assert_allclose(table[name], table[name].round(digits), atol=1e-9)
    whole = table.dropna()
    assert whole["sog"].to_numpy() == approx(7.0) and whole["cog"].to_numpy() == approx(round(np.degrees(0.5), 2))
    assert whole["u"].to_numpy() == approx(7.0) and np.abs(whole["v"]).max() == 0.0
    assert finished(replace(drawn[0], outliers=0.0), 4).equals(table)


def test_outliers_are_as_many_and_as_large_as_they_are_said_to_be(drawn):
    plain, wild = (finished(replace(drawn[0], outliers=share)) for share in (0.0, 0.05))
    ranges = {"x_north": (15.0, 60.0), "y_east": (15.0, 60.0), "r": (0.25, 0.6), "u_log": (0.7, 1.3)}
    # Both tables are drawn with the same uniforms until the first outlier: gaps differ, what stands is compared.
    for name, (low, high) in ranges.items():
        jump = (wild[name] - plain[name]).dropna()
        hit = jump[jump.abs() > 0.02]
        assert len(hit) / len(jump) == approx(0.05, abs=3.3 * np.sqrt(0.05 * 0.95 / ROWS)), name
        assert kstest(hit.abs(), uniform(low, high - low).cdf).pvalue > P, name
        assert abs((hit > 0).mean() - 0.5) < 3.3 * 0.5 / np.sqrt(len(hit)), name
    both = [((wild[n] - plain[n]).abs() > 0.02)[wild[n].notna() & plain[n].notna()] for n in ("x_north", "y_east")]
    assert (both[0] == both[1]).all(), "a receiver jumps in both"
    for name in ("psi", "delta", "n", "sog", "u"):
        same = (wild[name] - plain[name]).dropna()
        assert same.abs().max() == 0.0, name


@pytest.mark.parametrize("angle", [45.0, 20.0, 90.0])
def test_waves_shake_heading_and_rate_by_a_dozen_periods_of_6_to_14_s(angle):
    t = np.arange(0.0, 4000.0, 0.25)
    table = {"t": t, "psi": np.zeros_like(t), "r": np.zeros_like(t)}
    record._shake(table, 3.0, np.radians(angle), np.random.default_rng(6))
    sd = 0.008 * 3.0 * (0.3 + 0.7 * abs(np.sin(np.radians(2 * angle))))
    assert np.degrees(table["psi"]).std() == approx(sd, rel=0.02)
    slope = np.degrees(table["psi"][2:] - table["psi"][:-2]) / 0.5
    np.testing.assert_allclose(table["r"][1:-1], slope, atol=0.02 * sd)
    power = np.abs(np.fft.rfft(table["psi"] * np.hanning(len(t)))) ** 2
    period = 1 / np.maximum(np.fft.rfftfreq(len(t), 0.25), 1e-9)
    assert power[(period > 5.9) & (period < 14.2)].sum() > 0.999 * power.sum()
    assert power[(period > 6.0) & (period < 9.0)].sum() > 0.05 * power.sum() < power[period > 9.0].sum()


def test_a_recorder_leaves_out_its_columns_its_seconds_and_a_hole(drawn):
    run = Run("r00", "fit", "tc20", "port", 0.0, 1000)
    case = replace(drawn[0], runs=(run,), channels="gps_heading", hole=("r00", 100, 160))
    table = record._finish(case, {k: v[:1001] for k, v in recorded(case)[0].items()}, np.random.default_rng(1))
    kept = published(case, run, table)
    assert len(kept) == 1001 - 61 and not kept["t"].between(100, 160).any()
    assert [c for c in table if c not in kept] == ["u_log", "r", "n"]
    assert [c for c in table if c not in published(case, run, table, ("r",))] == ["u_log", "n"]
    assert list(seconds_of(replace(case, channels="two_seconds", hole=None), run)[:4]) == [0, 2, 4, 6]
    strict = published(replace(case, strict=True, hole=None), replace(run, split="held_out"), table)
    blank = strict[strict["t"] > 40].drop(columns=["t", "delta_order", "delta"])
    assert blank.isna().all().all() and strict[strict["t"] <= 40]["psi"].notna().any()


def test_the_manifest_says_what_the_recordings_hold(drawn):
    runs = (Run("r01", "fit", "tc20", "port", 33.0, 200), Run("r02", "held_out", "zz10", "starboard", 210.0, 150))
    case = replace(drawn[0], runs=runs, channels="two_seconds", hole=("r01", 100, 120))
    found = record.manifest(case)
    assert (found["sample_interval_s"], found["warmup_s"], found["manoeuvre_start_s"]) == (2.0, 40.0, 60.0)
    assert [run["rows"] for run in found["runs"]] == [101 - 11, 76] and found["nominal_noise_sd"] == NOISE
    held_out = {"split": "held_out", "manoeuvre": "zz10", "first_turn": "starboard", "initial_heading_deg": 210.0}
    assert found["runs"][1] == held_out | {"run": "r02", "file": "r02.csv", "rows": 76, "duration_s": 150}
    assert (found["case"], found["ship"], found["particulars"]) == (case.name, "mariner", case.ship.particulars)
    bare = record.manifest(replace(case, channels="gps_heading"))
    assert set(found["channels"]) - set(bare["channels"]) == {"r", "u_log", "n"}
    assert found["channels"] | {"r": "deg/s", "delta": "deg", "n": "rpm", "v": "m/s"} == found["channels"]


def test_a_coloured_force_acts_second_by_second_from_the_start_of_the_recording_on(drawn):
    truth, ship = build(drawn[0].ship, [], ["a", "b"]), drawn[0].ship
    truth.model_error = 1e5 * np.arange(1.0, 13.0).reshape(2, 3, 2)
    state = np.zeros((9, 2))
    state[3] = 7.0

    def push(t):
        return truth.derivative(t, state, np.zeros(2), np.full(2, 76.0))[3:6]

    plain = build(ship, [], ["a", "b"]).derivative(0.0, state, np.zeros(2), np.full(2, 76.0))[3:6]
    by_force = truth.equations.external
    for t, row in ((0.0, 0), (0.9, 0), (1.0, 1), (1.7, 1), (500.0, 1)):
        np.testing.assert_allclose(push(t) - plain, by_force @ truth.model_error[row], rtol=1e-9, atol=1e-12)
    np.testing.assert_array_equal(push(-0.1), plain)
