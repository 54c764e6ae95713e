"""The referee's chance against what it says of itself: scatter, random force, noise, base rates, events, seals.

Nothing is sailed: only drawn. Seeds are fixed; a tolerance that a right referee would break in one of a thousand seeds
is written as the statistic's own at p = .001.
"""

from collections import Counter
from dataclasses import replace
from hashlib import sha256
from itertools import pairwise

import numpy as np
import pytest
from pytest import approx
from scipy.stats import chisquare, kstest, norm, uniform

from studies.concealed_trial import record
from studies.concealed_trial.channels import CHANNEL_SETS, published, seconds_of, shows
from studies.concealed_trial.condition import Tables, scatter
from studies.concealed_trial.drawing import (
    CUBIC,
    CasePlan,
    Trial,
    _draw_hole,
    _drawn,
    case_name,
    draw_runs,
    plans,
    salt_of,
)
from studies.concealed_trial.effects import KINDS, NOISE, UNMODELLED, kind_of
from studies.concealed_trial.events import draw_intervals
from studies.concealed_trial.helm import Run
from studies.concealed_trial.model_error import coloured, with_model_error
from studies.concealed_trial.motion import SailedRuns
from studies.concealed_trial.ships import trial_ships
from studies.concealed_trial.strength import SIGMAS, draw_effect
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


FIT = [Run(f"r{k:02d}", "fit" if k < 3 else "held_out", "tc20", "port", 0.0, 1000) for k in range(6)]


def test_events_follow_their_patterns_and_start_at_any_time_before_45_percent_of_a_run():
    rng, patterns, starts, lengths, second = np.random.default_rng(7), Counter(), [], [], []
    for _ in range(600):
        intervals, ramp = draw_intervals(rng, "interval", FIT)
        assert ramp == 0.0
        counts = [len(intervals[run.name]) for run in FIT]
        patterns["twice" if max(counts) == 2 else {6: "every", 2: "some", 1: "one"}[sum(counts)]] += 1
        if sum(counts) == 2:
            assert [sum(counts[:3]), sum(counts[3:])] == [1, 1], "half of three is one, in either split"
        assert sum(counts[:3]) > 0, "one run to fit at least"
        for parts in intervals.values():
            if len(parts) == 1:
                starts.append(parts[0][0])
                lengths.append(parts[0][1] - parts[0][0])
            elif parts:
                (a, b), (c, d) = parts
                second.append((a, b - a, c - b, d - c))
    assert even([patterns[k] for k in ("every", "twice", "some", "one")], [0.4, 0.2, 0.2, 0.2])
    assert kstest(starts, uniform(79.5, 370.0).cdf).pvalue > P  # whole seconds
    assert kstest(lengths, uniform(219.5, 180.0).cdf).pvalue > P
    for column, (low, high) in zip(np.transpose(second), ((80, 180), (120, 220), (100, 250), (120, 220)), strict=True):
        assert kstest(column, uniform(low - 0.5, high - low).cdf).pvalue > P


def test_winds_set_in_at_once_in_half_of_the_cases_else_over_one_to_four_minutes():
    rng, ramps, earliest, sudden = np.random.default_rng(8), [], [], []
    for _ in range(800):
        intervals, ramp = draw_intervals(rng, "onset", FIT)
        ramps.append(ramp)
        for parts in intervals.values():
            assert len(parts) <= 1 and all(end == 1000 for _, end in parts)
            if parts:
                first = max(80.0, 60.0 + ramp / 2)
                (sudden if not ramp else earliest).append((parts[0][0] + 0.5 - first) / (450.0 - first))
    slow = [ramp for ramp in ramps if ramp]
    assert even([len(slow), 800 - len(slow)])
    assert kstest(slow, uniform(60.0, 180.0).cdf).pvalue > P
    assert kstest(sudden, "uniform").pvalue > P and kstest(earliest, "uniform").pvalue > P
    assert draw_intervals(rng, "", FIT) == ("all", 0.0)


def test_cases_have_the_base_rates_of_the_page():
    """20 clean, 44 of one effect, 12 of two, 6 of three, 18 of one that no list has; in random order."""
    for cases in (100, 50, 37):
        found = plans(Trial(5, cases))
        sorts = [("unknown" if p.kinds and p.kinds[0].detail else len(p.kinds)) for p in found]
        for sort, share in {0: 0.20, 1: 0.44, 2: 0.12, 3: 0.06, "unknown": 0.18}.items():
            assert abs(sorts.count(sort) - share * cases) < 1
        assert len({k for k, s in enumerate(sorts[: cases // 2]) if s == 1}) not in (0, cases // 2)


def test_names_strengths_ships_recorders_and_holes_come_in_turn():
    single = plans(Trial(6, 4 * len(KINDS), sort="single"))
    assert set(Counter(p.kinds[0].name for p in single).values()) == {4}
    assert set(Counter(p.strengths[0] for p in single).values()) == {len(KINDS)}
    unknown = plans(Trial(6, 2 * len(UNMODELLED), sort="unknown"))
    assert Counter(p.kinds[0].detail for p in unknown) == {k.detail: 2 for k in UNMODELLED}
    clean = plans(Trial(6, 60, sort="clean"))
    assert Counter(p.channels for p in clean) == {"full": 36, **dict.fromkeys(list(CHANNEL_SETS)[1:], 6)}
    assert Counter(p.ship for p in clean) == dict.fromkeys(SHIPS, 20) and sum(p.hole for p in clean) == 10
    triples = plans(Trial(6, 60, sort="triple"))
    for plan in triples:
        families = [k.family for k in plan.kinds]
        equal = {name for k in plan.kinds for name in k.equivalent}
        assert len(set(families)) == 3 and not equal & {k.name for k in plan.kinds}
    assert {p.ship for p in plans(Trial(6, 60)) if any(k.name == "roll_coupling" for k in p.kinds)} == {"mariner"}


def test_an_effect_whose_only_trace_is_in_a_missing_channel_gets_all_of_them():
    assert CHANNEL_SETS == {"full": ((), 1), "no_shaft": (("n",), 1), "no_log": (("u_log",), 1),
                            "gps_heading": (("r", "u_log", "n"), 1), "two_seconds": ((), 2)}  # fmt: skip
    hidden = {name: {k.name for k in KINDS if not shows(name, k)} for name in CHANNEL_SETS}
    assert hidden["no_log"] == {"log_scale"} and hidden["gps_heading"] == {"log_scale", "rate_bias"}
    assert not hidden["full"] | hidden["two_seconds"] | hidden["no_shaft"]
    assert not shows("gps_heading", kind_of("unknown", "rate_scale"))


def test_a_recorder_leaves_out_its_columns_its_seconds_and_a_hole(drawn):
    run = FIT[0]
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


def test_runs_are_drawn_in_their_shares():
    rng, ship = np.random.default_rng(9), SHIPS["mariner"]
    sets = [draw_runs(rng, ship) for _ in range(800)]
    assert even((Counter(len(runs) for runs in sets)[k] for k in (4, 5, 6)), [0.2, 0.2, 0.6])
    headings = [run.heading_deg for runs in sets for run in runs]
    assert kstest(headings, uniform(0.5, 360).cdf).pvalue > P and {min(headings), max(headings)} == {1.0, 360.0}
    longer = [runs for runs in sets if len(runs) > 4]
    spirals = sum(any(run.manoeuvre == "spiral" for run in runs) for runs in longer)
    assert even([spirals, len(longer) - spirals], [0.15, 0.85])
    for runs in sets:
        turn, zigzag = ([r for r in runs if r.split == "fit" and r.manoeuvre[:2] == m] for m in ("tc", "zz"))
        out = [r for r in runs if r.split == "held_out"]
        assert turn and zigzag and len(out) >= 2
        assert any(r.first_turn != turn[0].first_turn or len(turn) > 1 for r in out if r.manoeuvre[:2] == "tc")
        assert all(r.duration == ship.manoeuvres_s[r.manoeuvre] and 1 <= r.heading_deg <= 360 for r in runs)


def test_holes_last_one_to_three_minutes_and_begin_after_the_manoeuvre_did():
    rng = np.random.default_rng(10)
    holes = [_draw_hole(rng, FIT) for _ in range(500)]
    lengths = np.array([end - start for _, start, end in holes])
    assert kstest(lengths, uniform(59.5, 120.0).cdf).pvalue > P
    places = [(start + 0.5 - 120) / (800 - length - 120) for (_, start, _), length in zip(holes, lengths, strict=True)]
    assert kstest(places, "uniform").pvalue > P
    assert even(Counter(name for name, *_ in holes)[run.name] for run in FIT[:3])


PER_UNIT = {
    "heading_bias": 10.0, "rate_bias": 50.0, "log_scale": 5.144 / 0.05, "gps_lever_arm": 1 / 0.7,
    "compass_two_beats": 7.0, "log_by_heading": 0.7 * 5.144 / 0.05, "rate_scale": 25.0,
    "position_runs_away": 0.45 * 360_000 / 0.7,
}  # fmt: skip
"""Standard deviations of its channel's noise that an error of size one is on the bulk carrier, 5.144 m/s."""


@pytest.mark.parametrize("kind", [k for k in (*KINDS, *UNMODELLED) if k.per_unit], ids=lambda k: k.detail or k.name)
@pytest.mark.parametrize("strength", SIGMAS)
def test_errors_of_sensors_are_as_many_standard_deviations_as_their_strength_says(kind, strength):
    """As far as the sizes that are possible allow; what is stated is the size that was reached."""
    ship, rng, name = SHIPS["great_lakes_bulker"], np.random.default_rng(12), kind.detail or kind.name
    drawn = [draw_effect(rng, ship, kind, strength, ()) for _ in range(60)]
    measures = np.array([measure for _, measure in drawn])
    low, high = np.clip(SIGMAS[strength], PER_UNIT[name] * kind.low, PER_UNIT[name] * kind.high)
    assert low - 1e-9 <= measures.min() and measures.max() <= high + 1e-9
    assert high < SIGMAS[strength][1] or measures.max() - measures.min() > 0.8 * (high - low)
    for effect, measure in drawn:
        p = list(effect.parameters.values())
        size = np.hypot(*p) if name == "gps_lever_arm" else abs(p[0] - (name == "log_scale"))
        if name != "gps_lever_arm" or (abs(p[0]) < 108.8 and abs(p[1]) < 11.5):  # else it stays on board
            assert size * PER_UNIT[name] == approx(measure, rel=0.02 if name == "log_scale" else 2e-3)
        else:
            assert abs(p[0]) < 108.82 and abs(p[1]) < 11.51
    signs = {np.sign(next(iter(e.parameters.values())) - (name == "log_scale")) for e, _ in drawn}
    assert signs == ({-1.0, 1.0} if "sign" in kind.extras or name == "gps_lever_arm" else {1.0})
    half, full = (draw_effect(np.random.default_rng(1), ship, kind, strength, (), share)[1] for share in (0.5, 1.0))
    unbounded = np.random.default_rng(1)
    [unbounded.uniform() for _ in kind.extras]
    wanted = unbounded.uniform(*SIGMAS[strength])
    bounds = PER_UNIT[name] * kind.low, PER_UNIT[name] * kind.high
    assert (half, full) == approx((np.clip(0.5 * wanted, *bounds), np.clip(wanted, *bounds)))


def test_a_case_is_sealed_by_a_salt_of_its_own_stream():
    """Name and salt tell nothing of what was drawn: they come from a stream that nothing else uses."""
    salts = [salt_of(3, k) for k in range(300)]
    assert len(set(salts)) == 300 and {len(s) for s in salts} == {64} and salt_of(4, 0) not in salts
    assert salts[0] == sha256(np.random.default_rng([3, 2, 0]).bytes(32)).hexdigest()
    digits = Counter("".join(salts))
    assert even(digits[d] for d in "0123456789abcdef")
    names = [case_name(3, k) for k in range(300)]
    assert all(n == f"c{sha256(f'name {s}'.encode()).hexdigest()[:6]}" for n, s in zip(names, salts, strict=True))
    with_effect = CasePlan("mariner", (kind_of("heading_bias"),), ("weak",))
    both = [_drawn(3, 0, 0, plan, 1.0) for plan in (CLEAN, with_effect)]
    assert both[0].salt == both[1].salt == salts[0] and both[0].runs == both[1].runs
