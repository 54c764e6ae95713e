"""Stepwise regression: designs whose answer is known, and the coefficients of a ship found again."""

from functools import cache

import numpy as np
import pytest
import torch
from fleet import ship_named, unchecked
from pytest import approx
from scipy import stats
from tiers import mainly

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.simulate import simulate
from manoeuvre_nn.estimation.derivatives import ABKOWITZ, coefficient_name, taylor_columns
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.recording.tuples import Tuples, to_tuples
from manoeuvre_nn.ship.clarke import clarke_derivatives
from manoeuvre_nn.ship.known import clarke_part, no_part
from studies.wang1996.derivatives import si_unit, taylor_regression
from studies.wang1996.stepwise import Rules, regress

N = 200


def draws(seed, *names, n=N):
    generator = np.random.default_rng(seed)
    return {name: generator.standard_normal(n) for name in names}


def noisy_line(seed, slope=0.7, n=N):
    columns = {"0": np.ones(n), **draws(seed, "x", n=n)}
    noise = np.random.default_rng([seed, 1]).standard_normal(n)
    return columns, 2.0 + slope * columns["x"] + noise


@cache
def zz35(name="mariner") -> Recording:
    with unchecked():
        return simulate(CalmWater(ship_named(name)), zigzag(35.0, duration=300.0))


@cache
def found(name="mariner", method="backward", whole=False, side="port", known=clarke_part):
    part = known(ship_named(name))
    return taylor_regression(to_tuples([zz35(name)], part), part, rules=Rules(method), whole=whole, side=side)


def printed(name):
    """The ship's coefficients with letters in the package's order."""
    table = ship_named(name).coefficients
    return {e: {"".join(sorted(t, key="0uvrd".index)): c for t, c in terms.items()} for e, terms in table.items()}


def test_on_columns_at_right_angles_a_coefficient_is_the_projection_on_its_column():
    angle = 2 * np.pi * np.arange(N) / N
    columns = {"0": np.ones(N), "a": np.cos(angle), "b": np.sin(angle), "c": np.cos(2 * angle)}
    target = np.random.default_rng(0).standard_normal(N)
    result = regress(columns, target, Rules("all"))
    for name, column in columns.items():
        assert result.estimates[name].value == approx(column @ target / (column @ column), rel=1e-10)
        assert result.estimates[name].inflation == approx(1.0)
    assert result.condition == approx(1.0)


def test_slope_p_value_and_interval_are_those_of_a_t_test():
    columns, target = noisy_line(0, slope=0.15)
    result = regress(columns, target, Rules("all"))
    expected = stats.linregress(columns["x"], target)
    slope = result.estimates["x"]
    assert slope.p == approx(expected.pvalue, rel=1e-9)
    assert (slope.value, slope.error) == approx((expected.slope, expected.stderr), rel=1e-9)
    reach = stats.t.ppf(0.975, N - 2) * expected.stderr
    assert (slope.low, slope.high) == approx((expected.slope - reach, expected.slope + reach))
    assert result.r_squared == approx(expected.rvalue**2)
    assert result.freedom == N - 2


def test_two_groups_differ_as_students_two_sample_test_says():
    group = np.repeat([0.0, 1.0], 30)
    target = 0.5 * group + np.random.default_rng(3).standard_normal(60)
    result = regress({"0": np.ones(60), "group": group}, target, Rules("all"))
    expected = stats.ttest_ind(target[30:], target[:30])
    assert result.estimates["group"].p == approx(expected.pvalue, rel=1e-9)


def test_95_of_100_intervals_hold_the_true_slope():
    held = 0
    for seed in range(400):
        slope = regress(*noisy_line(seed, n=25), Rules("all")).estimates["x"]
        held += slope.low < 0.7 < slope.high
    assert stats.binomtest(held, 400, 0.95).pvalue > 0.01


@pytest.mark.parametrize("method", ["backward", "stepwise"])
def test_of_noisy_data_the_terms_that_matter_are_kept(method):
    columns = draws(1, "a", "b", "c", "d", "e")
    noise = np.random.default_rng(2).standard_normal(N)
    kept = regress(columns, 3 * columns["b"] - 2 * columns["d"] + noise, Rules(method, level=0.001))
    assert list(kept.estimates) == ["b", "d"]
    assert all(e.p < 0.001 for e in kept.estimates.values())


@pytest.mark.parametrize("method", ["backward", "stepwise"])
def test_of_exact_data_exactly_the_true_terms_are_kept(method):
    columns = draws(4, *"abcdefgh")
    columns["g"] = columns["a"] + 1e-3 * columns["g"]  # nearly a double of a true term
    result = regress(columns, 5 * columns["a"] + 1e-4 * columns["c"], Rules(method))
    assert result.values == approx({"a": 5.0, "c": 1e-4}, rel=1e-9)


def test_a_target_that_nothing_explains_keeps_no_term():
    columns = draws(5, "a", "b")
    result = regress(columns, np.random.default_rng(6).standard_normal(N), Rules(level=1e-4))
    assert result.estimates == {} and result.r_squared == 0.0


@pytest.mark.parametrize("method", ["backward", "stepwise", "all"])
def test_of_a_target_that_is_zero_throughout_nothing_is_kept(method):
    assert regress(draws(5, "a", "b"), np.zeros(N), Rules(method)).estimates == {}


def test_a_column_that_the_ones_before_it_make_up_is_left_out_and_named():
    columns = draws(7, "a", "b", "e")
    columns = {"a": columns["a"], "b": columns["b"], "sum": columns["a"] - 3 * columns["b"], "e": columns["e"]}
    columns["none"] = np.zeros(N)
    result = regress(columns, columns["sum"] + columns["e"], Rules("all"))
    assert result.dependent == ("sum", "none")
    assert result.values == approx({"a": 1.0, "b": -3.0, "e": 1.0})


def test_inflation_and_condition_tell_of_two_columns_with_a_correlation():
    shared, own = draws(8, "a", "b").values()
    columns = {"0": np.ones(N), "a": 50 + shared, "b": -9 + shared + 0.1 * own}
    result = regress(columns, shared + own, Rules("all"))
    rho = np.corrcoef(columns["a"], columns["b"])[0, 1]
    assert result.estimates["a"].inflation == approx(1 / (1 - rho**2), rel=1e-6)
    assert result.estimates["b"].inflation == approx(1 / (1 - rho**2), rel=1e-6)
    assert result.condition == approx(np.sqrt((1 + rho) / (1 - rho)), rel=1e-6)


def test_estimates_are_the_target_weighted_by_their_influence():
    columns, target = noisy_line(9)
    result = regress(columns, target, Rules("all"))
    assert result.influence @ target == approx(np.array(list(result.values.values())))
    fitted = sum(result.values[t] * columns[t] for t in columns)
    assert result.residuals == approx(target - fitted, abs=1e-12)
    assert result.deviation == approx(np.sqrt(result.residuals @ result.residuals / (N - 2)))


def test_samples_that_do_not_fit_are_taken_out():
    columns, target = noisy_line(10)
    target[[3, 70, 150]] += [40.0, -60.0, 50.0]
    spoilt, cured = regress(columns, target), regress(columns, target, Rules(unusual=4.0))
    assert cured.unusual.tolist() == [3, 70, 150]
    assert (cured.residuals[cured.unusual] == 0).all() and (cured.influence[:, cured.unusual] == 0).all()
    assert abs(cured.estimates["x"].value - 0.7) < 0.2
    assert cured.deviation == approx(1.0, abs=0.15) and spoilt.deviation > 5


def test_no_more_than_a_share_of_the_samples_is_taken_out():
    columns, target = noisy_line(11)
    result = regress(columns, target, Rules(unusual=1.5, share=0.1))
    assert len(result.unusual) <= 0.1 * N


def test_units_of_columns_change_estimates_and_nothing_else():
    columns, target = noisy_line(12)
    small = {"0": columns["0"], "x": columns["x"] * 1e-9}
    one, other = regress(columns, target), regress(small, target * 1e6)
    assert other.estimates["x"].value == approx(1e15 * one.estimates["x"].value)
    assert other.estimates["x"].p == approx(one.estimates["x"].p)
    assert other.condition == approx(one.condition)


@pytest.mark.parametrize(
    "columns, target, message",
    [
        (draws(0, *"abc", n=3), np.ones(3), "3 samples for 3 terms"),
        ({"a": np.array([1.0, np.nan, 2.0, 3.0])}, np.ones(4), "a holds values that are no numbers"),
        (draws(0, "a", n=4), np.array([1.0, np.inf, 1.0, 1.0]), "the target holds values"),
    ],
)
def test_data_that_cannot_be_regressed_are_refused(columns, target, message):
    with pytest.raises(InputError, match=message):
        regress(columns, target)


@pytest.mark.parametrize("rules", [{"method": "forward"}, {"level": 0.0}, {"unusual": 0.5}])
def test_rules_that_make_no_sense_are_refused(rules):
    with unchecked(), pytest.raises(InputError):
        Rules(**rules)


@pytest.mark.parametrize("name", mainly(1, ["mariner", "mariner_corrected"]))
@pytest.mark.parametrize("method", ["backward", "stepwise"])
def test_from_exact_g_exactly_the_mariners_terms_are_kept(name, method):
    result, true = found(name, method), printed(name)
    lateral = set(true["Y"]) | set(true["N"])
    assert set(result.equations["X"].estimates) == set(true["X"])
    assert set(result.equations["Y"].estimates) == set(result.equations["N"].estimates) == lateral


@pytest.mark.parametrize("name", mainly(2, ["mariner", "great_lakes_bulker", "mariner_corrected"]))
@pytest.mark.parametrize("whole", [False, True])
def test_brought_to_the_ships_inertia_the_coefficients_are_its_own(name, whole):
    estimates = found(name, whole=whole).estimates(ship_named(name).inertia)
    for equation, true in printed(name).items():
        for term, e in estimates[equation].items():
            assert e.value == approx(true.get(term, 0.0), abs=1e-4), (equation, term)
        assert set(true) <= set(estimates[equation])


def test_without_bringing_them_there_they_are_those_of_the_known_inertia():
    ship, estimates = ship_named("mariner"), found().estimates()
    mixing = (clarke_part(ship).inertia @ torch.linalg.inv(ship.inertia)).numpy()
    assert mixing[0, 0] == approx(0.17993 / 0.177, rel=1e-4)
    for term in ("v", "vvv", "d", "vvr"):
        own = [printed("mariner")[e].get(term, 0.0) for e in "XYN"]
        assert [estimates[e][term].value for e in "YN"] == approx((mixing @ own)[1:], abs=1e-8)


def test_the_sign_of_the_rudder_turns_terms_with_an_odd_number_of_it():
    port, starboard = (found(side=side).estimates(ship_named("mariner").inertia) for side in ("port", "starboard"))
    for equation, terms in port.items():
        for term, e in terms.items():
            sign = (-1) ** term.count("d")
            assert starboard[equation][term].value == approx(sign * e.value, rel=1e-6, abs=1e-12)


def test_with_the_ships_own_inertia_alone_known_its_coefficients_come_at_once():
    known = no_part(ship_named("mariner"))
    result = taylor_regression(to_tuples([zz35()], known), known)
    for equation, true in printed("mariner").items():
        assert result.coefficients[equation] == approx(true, abs=1e-8)


def test_errors_that_mix_are_those_of_a_regression_after_mixing():
    ship, known = ship_named("mariner"), clarke_part(ship_named("mariner"))
    tuples = to_tuples([zz35()], known)
    noise = 1e-3 * torch.randn(tuples.targets.shape, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    spoilt = Tuples(tuples.inputs, tuples.targets + noise, tuples.times, tuples.index)
    terms = {e: list(t) for e, t in printed("mariner").items()}
    before = taylor_regression(spoilt, known, terms=terms, rules=Rules("all"))
    mixing = ship.inertia @ torch.linalg.inv(known.inertia)
    mixed = Tuples(tuples.inputs, spoilt.targets @ mixing.T, tuples.times, tuples.index)
    after = taylor_regression(mixed, known, terms=terms, rules=Rules("all"))
    ours = before.estimates(ship.inertia)
    for equation in "YN":
        for term, e in after.equations[equation].estimates.items():
            assert ours[equation][term].error == approx(e.error, rel=1e-9)
            assert ours[equation][term].high - ours[equation][term].low == approx(e.high - e.low, rel=1e-9)


def test_columns_are_what_derivatives_multiply():
    known = clarke_part(ship_named("mariner"))
    tuples = to_tuples([zz35()], known)
    terms = ("0", "u", "vvd", "rrr")
    columns = dict(zip(terms, taylor_columns(tuples, known, {"Y": terms}, "port")["Y"].T, strict=True))
    u, v, r, d = tuples.inputs.numpy().T
    assert columns["0"] == approx(np.ones(len(u)))
    assert columns["u"] == approx(u - 1)
    assert columns["vvd"] == approx(-(v**2) * d / 2)
    assert columns["rrr"] == approx(r**3 / 6)


def test_names_are_written_in_one_order():
    assert [coefficient_name("Y", t) for t in ("0", "dvv", "rvv", "du")] == ["Y_0", "Y_vvd", "Y_vvr", "Y_ud"]
    assert all("".join(sorted(t, key="0uvrd".index)) == t for terms in ABKOWITZ.values() for t in terms)


def test_derivatives_in_si_units_are_those_of_the_dimensional_force():
    known = clarke_part(ship_named("mariner"))
    p, prime = known.particulars, known.prime
    derivatives = clarke_derivatives(p)
    half = 0.5 * p.rho * p.length * p.draught
    assert si_unit(prime, "Y", "v") * derivatives["Yv"] == approx(derivatives["Yv"] * half * p.speed)
    assert si_unit(prime, "N", "vvr") == approx(half * p.length**2 / p.speed)
    assert si_unit(prime, "X", "0") == approx(half * p.speed**2)
