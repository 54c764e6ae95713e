"""How often the referee draws what: sorts, names, strengths, recorders, runs, events, holes, errors of sensors; seals.

Nothing is sailed. Seeds are fixed; tolerances are those that a right referee breaks once in a thousand seeds.
"""

from collections import Counter
from hashlib import sha256

import numpy as np
import pytest
from pytest import approx
from scipy.stats import chisquare, kstest, uniform

from studies.concealed_trial.channels import CHANNEL_SETS, shows
from studies.concealed_trial.drawing import CasePlan, Trial, _draw_hole, _drawn, case_name, draw_runs, plans, salt_of
from studies.concealed_trial.effects import KINDS, UNMODELLED, kind_of
from studies.concealed_trial.events import draw_intervals
from studies.concealed_trial.helm import Run
from studies.concealed_trial.ships import trial_ships
from studies.concealed_trial.strength import SIGMAS, draw_effect

P = 1e-3
SHIPS = trial_ships()


def even(counts, shares=None):
    """Whether counts are as shares say, by chi-square."""
    counts = list(counts)
    expected = None if shares is None else sum(counts) * np.array(shares)
    return chisquare(counts, expected).pvalue > P


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
    short = [Run("r01", "fit", "tc20", "port", 0.0, 200)]
    assert {_draw_hole(rng, short)[1] for _ in range(40)} == {120}, "a short run begins as late"


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
    both = [_drawn(3, 0, 0, plan, 1.0) for plan in (CasePlan("mariner", (), ()), with_effect)]
    assert both[0].salt == both[1].salt == salts[0] and both[0].runs == both[1].runs
