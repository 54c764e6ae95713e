"""Coefficients with intervals, what they say of the ship, and which of them recordings do not tell apart."""

import json

import numpy as np
import pandas as pd
import pytest
import torch
from fleet import SHIPS, ship_named, unchecked
from pytest import approx

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.scaling import Scaling
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.dynamics.model import CalmWater, IdentifiedShip
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.estimation.agreement import Agreement, widened
from manoeuvre_nn.estimation.coefficient_forces import own_forces, series_forces
from manoeuvre_nn.estimation.coefficient_priors import own_prior
from manoeuvre_nn.estimation.coefficients import (
    PLAIN,
    TAYLOR,
    Fitted,
    approach_inertia,
    coefficient_table,
    fitted_from,
    form_of,
    symbol,
)
from manoeuvre_nn.estimation.collinear import collinear_groups
from manoeuvre_nn.estimation.linear_motion import COLUMNS, derived, linear_motion, steady_turn
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.network.series import Series, SeriesSettings
from manoeuvre_nn.report.coefficient_tables import Coefficients, coefficients_json, notes, sentence, tables
from manoeuvre_nn.ship.clarke import clarke_derivatives
from manoeuvre_nn.ship.known import clarke_inertia_part
from manoeuvre_nn.ship.kvlcc2 import kvlcc2_hsva

PAIR = ((1, "u v"), (1, "u r"))


def fitted(names=PAIR, values=None, covariance=None, spread=None, form=PLAIN, inertia=None):
    p = len(names)
    values = np.zeros(p) if values is None else np.array(values, dtype=float)
    covariance = np.eye(p) * 1e-4 if covariance is None else np.array(covariance, dtype=float)
    spread = np.ones(p) if spread is None else np.array(spread, dtype=float)
    inertia = np.eye(3) if inertia is None else inertia
    return Fitted(tuple(names), values, covariance, np.zeros(p), spread, inertia, form)


def of_series(surge, lateral, ship=None):
    """Columns of a series for a ship with Clarke's inertia."""
    ship = ship or kvlcc2_hsva()
    unit = Scaling(*(f(k, dtype=torch.float64) for f, k in ((torch.zeros, 4), (torch.ones, 4), (torch.ones, 3))))
    with unchecked():
        return series_forces(IdentifiedShip(clarke_inertia_part(ship), Series(SeriesSettings(surge, lateral)), unit))


@pytest.mark.parametrize(
    ("output", "term", "form", "expected"),
    [(1, "v |v|", PLAIN, "Y_v|v|"), (2, "d n n", PLAIN, "N_dnn"), (0, "u u", PLAIN, "X_uu"), (0, "1", TAYLOR, "X_0")]
    + [(1, "r v v", TAYLOR, "Y_vvr"), (1, "a v v", TAYLOR, "Y_uvv"), (0, "wx |w|", TAYLOR, "X_wx|w|")],
)
def test_symbols_are_those_of_the_literature(output, term, form, expected):
    assert symbol(output, term, form) == expected


def test_a_series_about_the_approach_is_known_by_its_variables():
    assert form_of(["1", "a v", "v v v", "wy |w|"]) == TAYLOR
    assert form_of(["u v", "v |v|"]) == PLAIN
    every = "d v a r 1"
    assert form_of([every]) == TAYLOR and form_of([f"{every} n"]) == PLAIN, "a product may have all of them"
    assert symbol(1, every, TAYLOR) == "Y_0uvrd"


def test_derivatives_are_factors_times_the_factorials():
    """Y_vvv v^3/6 + Y_vvr v^2 r/2: a factor of 1 is a derivative of 6 and 2; a plain product keeps its factor."""
    names = [(1, "v v v"), (1, "v v r"), (1, "1")]
    one, two, constant = coefficient_table(fitted(names, [1.0, 1.0, 1.0], form=TAYLOR)).itertuples()
    assert (one.value, two.value, constant.value, one.factor) == (6.0, 2.0, 1.0, 1.0)
    assert one.error == approx(0.06) and one.prior_error == approx(6.0)
    assert coefficient_table(fitted(names, [1.0, 1.0, 1.0]))["value"][0] == 1.0


def test_a_word_says_how_far_the_recordings_narrowed_a_coefficient():
    names = [(1, "v"), (1, "r"), (1, "d")]
    rows = coefficient_table(fitted(names, [3.0, 0.0, 0.0], np.diag([0.01, 0.25, 0.95])))
    assert list(rows["word"]) == ["measured", "partly", "prior"]
    assert list(rows["learnt"]) == approx([0.9, 0.5, 0.025], abs=5e-4)
    assert (rows["low"][0], rows["high"][0]) == approx((3 - 0.196, 3 + 0.196))


@pytest.mark.parametrize("left, word", [
    (0.24, "measured"), (0.25, "measured"), (0.26, "partly"), (0.895, "partly"), (0.905, "prior"), (1.2, "prior"),
])  # fmt: skip
def test_an_error_that_is_a_quarter_of_what_it_was_is_measured_and_one_of_nine_tenths_partly(left, word):
    (row,) = coefficient_table(fitted([(1, "v")], covariance=[[(2 * left) ** 2]], spread=[2.0])).itertuples()
    assert row.word == word and row.learnt == approx(max(1 - left, 0.0))


def test_errors_correlated_by_ninety_nine_hundredths_are_not_yet_beyond_it():
    names, covariance = [(1, "v"), (1, "r")], np.array([[1.0, 0.99], [0.99, 1.0]])
    table = coefficient_table(fitted(names, covariance=covariance, spread=[10.0, 10.0]))
    assert list(table["word"]) == 2 * ["measured"] and list(table["with"]) == [(), ()]


def test_a_coefficient_that_is_known_exactly_can_be_taken_up():
    stored = fitted(covariance=[[0.0, 0.0], [0.0, 1e-4]]).as_dict()
    assert fitted_from(stored).errors.tolist() == [0.0, 1e-2]


def test_a_coefficient_whose_error_is_that_of_another_is_not_measured_by_itself():
    """Y_v and Y_r were narrowed to a tenth, but their errors are correlated by .995; those of Y_d and N_d by .985."""
    names = [(1, "v"), (1, "r"), (1, "d"), (2, "d")]
    close, open_ = 0.995, 0.985
    covariance = 0.01 * np.array([[1, close, 0, 0], [close, 1, 0, 0], [0, 0, 1, open_], [0, 0, open_, 1]])
    rows = coefficient_table(fitted(names, covariance=covariance))
    assert list(rows["word"]) == ["together", "together", "measured", "measured"]
    assert list(rows["with"]) == [("Y_r",), ("Y_v",), (), ()]
    told = Coefficients(kvlcc2_hsva(), fitted(names, covariance=covariance), derived=pd.DataFrame(columns=COLUMNS))
    said = sentence(told)
    assert said.startswith("2 of 4 coefficients are measured, 2 only together with others (correlation beyond 0.99)")
    assert "errors of 4 of all these coefficients go together in 2 groups (correlation beyond 0.9)" in said
    assert [row["it is"] for row in tables(told)["Coefficients"]] == ["together with Y_r", "together with Y_v"] + 2 * [
        "measured"
    ]
    stored = coefficients_json(told)
    assert [c["together_with"] for c in stored["coefficients"]] == [["Y_r"], ["Y_v"], [], []]
    assert [g["symbols"] for g in stored["groups"]] == [["Y_v", "Y_r"], ["Y_d", "N_d"]]


@pytest.mark.parametrize(
    ("ratio", "degrees", "agree"), [(1.006, 30.0, True), (1.3, 30.0, True), (2.0, 30.0, False), (1.006, 0.0, True)]
)
def test_stretches_agree_where_chance_alone_would_part_them_as_far(ratio, degrees, agree):
    told = Coefficients(kvlcc2_hsva(), fitted(), pd.DataFrame(columns=COLUMNS), agreement=Agreement(ratio, degrees))
    assert any("agree on the coefficients" in line for line in notes(told)) == agree


def test_neighbours_that_are_not_measured_by_themselves_are_in_one_group():
    """Errors of five coefficients, each correlated with the next by .991, the ends by .87: two groups by their ends."""
    angle = np.deg2rad(7.5 * np.arange(5))
    names = [(1, "v"), (1, "r"), (1, "d"), (2, "v"), (2, "r")]
    told = fitted(names, covariance=0.01 * np.cos(angle[:, None] - angle) + 1e-9 * np.eye(5))
    (group,) = collinear_groups(told).itertuples()
    assert group.symbols == tuple(coefficient_table(told)["symbol"])
    assert all(set(others) <= set(group.symbols) and others for others in coefficient_table(told)["with"])


def test_coefficients_can_be_written_and_taken_up_again():
    before = fitted(values=[1.0, 2.0])
    after = fitted_from(json.loads(json.dumps(before.as_dict())))
    assert after.names == before.names and after.values.tolist() == [1.0, 2.0] and after.form == PLAIN


def test_a_damaged_file_of_coefficients_is_refused_in_one_line():
    stored = fitted().as_dict()
    with pytest.raises(InputError, match="'covariance' is missing"):
        fitted_from({k: v for k, v in stored.items() if k != "covariance"})
    with pytest.raises(InputError, match="values has shape"):
        fitted_from({**stored, "values": [1.0]})
    for key, spoilt in (
        ("values", [1.0, np.inf]),
        ("inertia", [[1, 0, 0], [0, 1, 0], [0, "inf", 1]]),
        ("inertia", [[1, 0, 0], [0, 1, 2], [0, 1, 1]]),
        ("inertia", [[-1, 0, 0], [0, 1, 0], [0, 0, 1]]),
        ("inertia", [[0, 0, 0], [0, 1, 0], [0, 0, 1]]),
        ("inertia", [[1, 0, 0], [0, 0, 1], [0, -1, 1]]),
        ("inertia", [[1, 0, 0], [0, 1, 1], [0, 1, 1]]),  # sways and turns at once without energy
        ("covariance", [[-1, 0], [0, 1]]),
        ("spread", [0, 1]),
        ("names", [[0, "u"], [10**30, "v"]]),
    ):
        with pytest.raises(InputError, match=key):
            fitted_from({**stored, key: spoilt})


def test_what_is_known_of_two_coefficients_that_go_together_is_their_sum():
    """Only ``Y_uv + 2 Y_ur = 0.5 +- .01`` was measured: the group says so, with the interval of that sum."""
    row = np.array([1.0, 2.0])
    covariance = np.linalg.inv(np.outer(row, row) / 0.01**2 + np.eye(2))
    (group,) = collinear_groups(fitted(values=[0.1, 0.2], covariance=covariance)).itertuples()
    assert group.symbols == ("Y_uv", "Y_ur") and group.correlation < -0.99
    assert group.determined == "0.5 Y_uv + Y_ur" and (group.value, group.error) == approx((0.25, 0.005), rel=1e-3)
    assert "drift and yaw rate are not told apart" in group.words and "a drift test" in group.words


def test_scales_of_coefficients_make_no_difference_to_what_goes_together():
    size = np.array([1.0, 1e-3])
    covariance = np.linalg.inv(np.outer([1, 2], [1, 2]) / 1e-4 + np.eye(2)) * size[:, None] * size
    (group,) = collinear_groups(fitted(values=[0.1, 2e-4], covariance=covariance, spread=size)).itertuples()
    assert group.determined == "0.0005 Y_uv + Y_ur"


def test_coefficients_that_are_told_apart_are_in_no_group():
    assert collinear_groups(fitted()).empty
    assert collinear_groups(fitted(names=PAIR[:1])).empty


@pytest.mark.parametrize(
    ("names", "said"),
    [([(1, "u v"), (1, "n v")], "speed and shaft speed"), ([(2, "v"), (2, "v v v")], "small and large motions")]
    + [([(2, "v |r|"), (2, "r |v|")], "these products are alike"), ([(1, "v"), (1, "d")], "drift and rudder angle")]
    + [([(1, "uv"), (1, "Lur")], "drift and yaw rate"), ([(0, "ccdd"), (0, "LgT")], "rudder angle goes with the rest")],
)
def test_words_name_the_motions_that_go_together(names, said):
    covariance = np.array([[1.0, 0.99], [0.99, 1.0]]) * 0.1
    (group,) = collinear_groups(fitted(names, [1.0, 1.0], covariance)).itertuples()
    assert said in group.words


def test_a_chain_of_neighbours_is_no_group_of_all():
    """1 goes with 2 and 2 with 3, but 1 and 3 are correlated by less than the limit."""
    names = [(1, "v"), (1, "r"), (1, "d")]
    covariance = 0.01 * np.array([[1.0, 0.93, 0.8], [0.93, 1.0, 0.92], [0.8, 0.92, 1.0]])
    (group,) = collinear_groups(fitted(names, [1.0, 1.0, 1.0], covariance)).itertuples()
    assert group.symbols == ("Y_v", "Y_r")


def test_the_recordings_fix_as_many_combinations_as_they_narrow():
    assert fitted(covariance=np.diag([0.0, 1.0])).determined == approx(1.0)


def test_another_inertia_leaves_the_motion_as_it_was():
    """f = M a: whatever inertia the coefficients are told for, M^-1 f is the same at any motion."""
    names = [(0, "u u"), (1, "u v"), (1, "u r"), (2, "u v"), (2, "u r")]
    old, new = np.diag([1.0, 2.0, 0.1]), np.array([[1.1, 0, 0], [0, 1.7, 0.2], [0, 0.1, 0.3]])
    before = fitted(names, [1.0, -2.0, 0.3, -0.5, -0.2], inertia=old)
    after = before.with_inertia(new)
    outputs, products = np.array([o for o, _ in names]), np.array([1.3, 0.7, -0.4, 0.7, -0.4])
    push = [np.array([(f.values * products)[outputs == o].sum() for o in range(3)]) for f in (before, after)]
    assert np.linalg.solve(old, push[0]) == approx(np.linalg.solve(new, push[1]))
    back = after.with_inertia(old)
    assert back.values == approx(before.values) and back.covariance == approx(before.covariance, abs=1e-12)
    assert after.errors[0] == approx(1.1 * before.errors[0])


def test_the_stability_criterion_of_clarkes_ship_is_its_closed_form():
    """C = Y_v N_r - N_v (Y_r - m), K' and T' from the derivatives themselves."""
    ship = kvlcc2_hsva()
    force, d = of_series([], ["v", "r", "d"], ship), clarke_derivatives(ship)
    mass = 2 * ship.block * ship.beam / ship.length
    y, n = (d["Yv"], d["Yr"] - mass, -d["Yd"]), (d["Nv"], d["Nr"], -d["Nd"])
    values = np.array([*y, *n])
    known = clarke_inertia_part(ship)
    m = approach_inertia(known)
    found = {f.name: f for f in derived(force, values, np.eye(6) * 1e-12, m).itertuples()}
    c = y[0] * n[1] - n[0] * y[1]
    assert found["stability C"].value == approx(c, rel=1e-6)
    assert found["stability C"].words == f"{'stable' if c > 0 else 'unstable'} on a straight course"
    turning = n[0] * y[2] - y[0] * n[2]
    assert found["Nomoto K'"].value == approx(turning / c, rel=1e-6)
    both = -(m[1, 1] * n[1] + m[2, 2] * y[0] - m[1, 2] * n[0] - m[2, 1] * y[1]) / c
    third = (m[1, 1] * n[2] - m[2, 1] * y[2]) / turning
    assert found["Nomoto T'"].value == approx(both - third, rel=1e-6)


def published(ship):
    return own_prior(ship, 0.2)[0]


def test_the_mariners_criterion_follows_from_its_table():
    ship = ship_named("mariner")
    force = own_forces(ship)
    (c, gain, *_) = derived(force, published(ship), np.zeros((force.count,) * 2), approach_inertia(ship)).itertuples()
    assert c.value == approx(-0.244 * -0.03747 - -0.0555 * -0.105, rel=1e-6) and "stable" in c.words
    # K' in the package's sign: the source's positive rudder turns to port.
    assert gain.value == approx((-0.0555 * -0.0586 - -0.244 * 0.0293) / c.value, rel=1e-6)


def test_intervals_of_a_criterion_near_nought_leave_open_whether_the_ship_is_stable():
    ship = ship_named("mariner")
    force = own_forces(ship)
    _, spread = own_prior(ship, 0.3)
    c, gain, lag, _ = derived(force, published(ship), np.diag(spread**2), approach_inertia(ship)).itertuples()
    assert c.low < 0 < c.high and c.words.startswith("open whether stable")
    assert np.isnan([gain.low, gain.high, lag.low]).all() and "C may be 0" in gain.words


def test_intervals_are_those_of_linear_propagation_where_errors_are_small():
    ship = ship_named("mariner")
    force = own_forces(ship)
    place = force.names.index((2, "r"))
    covariance = np.zeros((force.count,) * 2)
    covariance[place, place] = 1e-8
    c, *_ = derived(force, published(ship), covariance, approach_inertia(ship)).itertuples()
    assert (c.high - c.low) / 2 == approx(1.96 * 0.244 * 1e-4, rel=0.06)


def test_the_steady_turn_is_the_one_that_the_ship_sails():
    ship = ship_named("mariner_corrected")
    force = own_forces(ship)
    with unchecked():
        (run,) = roll_out(CalmWater(ship), [turning_circle(35.0, duration=600.0)])
    rate, words = steady_turn(force, published(ship)[None], 35 * DEGREE)
    assert rate[0] == approx(run["r"][-1] * ship.particulars.time_unit, rel=2e-3) and words == "a turn to starboard"
    none, said = steady_turn(force, 3 * published(ship)[None] * [n == (0, "u v v") or 1 for n in force.names], 3.0)
    assert np.isnan(none).all() and said == "100 % of the draws find no steady turn"
    (*_, turn) = derived(force, published(ship), np.zeros((force.count,) * 2), approach_inertia(ship)).itertuples()
    assert turn.name == "r L/U0 at 35 deg of starboard rudder" and turn.value == approx(rate[0])


@pytest.mark.parametrize("name", SHIPS)
def test_own_products_give_the_accelerations_of_every_ship(name):
    ship = ship_named(name)
    p, force = ship.particulars, own_forces(ship)
    state = np.array([[1.0, 0.0, 0.0, 0, 0, 0], [0.7, -0.2, 0.4, 1, 2, 3]])
    delta = np.array([0.1, -0.4])
    unit = np.array([1.0, 1.0, 1 / p.length])
    expected = ship.acceleration(torch.as_tensor(state[:, :3] * unit * p.speed), torch.as_tensor(delta)).numpy()
    columns = force.columns(state, {"delta": delta, "n": np.ones(2)})
    assert columns @ published(ship) == approx(expected / (unit * p.speed**2 / p.length), rel=1e-9, abs=1e-12)


def test_a_ship_without_products_of_its_own_is_refused():
    ship = ship_named("mariner")
    with pytest.raises(InputError, match="no sum of known products"):
        own_forces(clarke_inertia_part(ship))
    with pytest.raises(InputError, match="expected more than 0"):
        own_prior(ship, 0.0)


def test_wider_errors_never_exceed_what_was_known_before():
    spread = np.array([1.0, 2.0])
    covariance = np.diag([1e-4, 3.9])
    wide = widened(covariance, spread, 25.0)
    assert wide[0, 0] == approx(25e-4, rel=0.01) and 3.9 < wide[1, 1] <= 4.0
    assert widened(covariance, spread, 0.5) == approx(covariance)


def test_the_linear_motion_of_a_symmetric_series_does_not_see_squares():
    force = of_series([], ["v", "v |v|", "d d d"])
    motion = linear_motion(force, np.array([[1.0, 5.0, 7.0, 0.0, 3.0, 2.0]]))
    alone = linear_motion(force, np.array([[1.0, 0.0, 0.0, 0.0, 0.0, 0.0]]))
    assert motion.a[0, :, 0] == approx(alone.a[0, :, 0], abs=1e-3) and motion.b[0] == approx(0.0, abs=1e-6)
