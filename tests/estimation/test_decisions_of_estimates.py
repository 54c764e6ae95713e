"""Estimation, decision by decision: what is refused, what is kept, what is said, and what a number stands for."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch
from fleet import ship_named, unchecked
from pytest import approx
from scipy.stats import norm

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.effect.current import Current
from manoeuvre_nn.effect.depth import ShallowWater
from manoeuvre_nn.effect.propulsion import ThrustLoss
from manoeuvre_nn.effect.rudder import RudderOffset
from manoeuvre_nn.estimation import baselines, captive_fit, changed_coefficients, data_set, record_information
from manoeuvre_nn.estimation.coefficient_forces import own_forces
from manoeuvre_nn.estimation.coefficient_priors import series_prior
from manoeuvre_nn.estimation.coefficients import Fitted
from manoeuvre_nn.estimation.collinear import _words
from manoeuvre_nn.estimation.corrections import Calibrated, Corrections
from manoeuvre_nn.estimation.data_set import COEFFICIENT_SD_LEVELS, SAME_RUDDER, WhitenedDataSet
from manoeuvre_nn.estimation.derivatives import taylor_columns
from manoeuvre_nn.estimation.hypothesis import STOPS, FittedHypothesis, Hypothesis
from manoeuvre_nn.estimation.hypothesis_columns import _apart
from manoeuvre_nn.estimation.noise_average import TIMES
from manoeuvre_nn.estimation.prime_recordings import PACE, to_prime
from manoeuvre_nn.estimation.process_noise import ProcessNoise
from manoeuvre_nn.recording.tuples import Tuples
from manoeuvre_nn.ship.container import container
from manoeuvre_nn.ship.esso_osaka_model import esso_osaka_mmg
from manoeuvre_nn.ship.kvlcc2 import kvlcc2_hsva

SHIP = ship_named("mariner")


# Hypotheses and their priors ------------------------------------------------------------------------------------------


def test_a_loss_of_thrust_lasts_to_the_end_of_a_run_three_times_of_four():
    """Odds of one that ends before, beside the two times' own: ``2! p(ends) / (1! p(lasts))``."""
    loss = ThrustLoss(SHIP)
    start, end = loss.timed
    table = np.array([[p.starts[0] if p.starts else 0.0 for p in loss.declared]])
    table[0, start] = 100.0
    log_priors = []
    for ends in (np.inf, 200.0):
        table[0, end] = ends
        log_priors.append(Hypothesis((loss,), (table.copy(),)).log_prior_of_times())
    assert log_priors[1] - log_priors[0] == approx(np.log(2 * 0.25 / 0.75)) and STOPS == 0.25


def test_standard_errors_are_roots_of_variances_however_small():
    h = Hypothesis((RudderOffset(SHIP),), (np.array([[1.0]]),))
    assert FittedHypothesis(h, 0.0, np.zeros((1, 1)), np.array([[1e-6]])).errors == approx([1e-3])
    assert FittedHypothesis(h, 0.0, np.zeros((1, 1)), np.array([[-1e-9]])).errors == approx([0.0])


def test_the_prior_of_a_formulas_part_is_gaussian_within_its_bounds():
    """Of a factor of 1 give or take its spread the share above its least value; heavy tails would leave more below."""
    water = ShallowWater(SHIP)
    part = next(f for f in Hypothesis((water,), (_at_starts(water),)).unknowns() if f.parameter.form)
    p = part.parameter
    distance = min(p.high - part.mean(0.0), part.mean(0.0) - p.low) / p.spread
    assert np.exp(part.prior_inside()) == approx(norm.cdf(distance), rel=1e-9)


def _at_starts(effect) -> np.ndarray:
    return np.array([[p.starts[0] for p in effect.declared]])


def test_difference_quotients_by_a_direction_go_beyond_north_and_those_by_a_speed_not_below_none():
    speed, towards = Current(SHIP).declared
    assert _apart(towards, 359.8) == approx((360.3, 359.3)) and _apart(towards, 0.1) == approx((0.6, -0.4))
    assert _apart(speed, 0.0) == approx((0.02 * speed.spread, 0.0))


# Runs, noise and levels -----------------------------------------------------------------------------------------------


def test_levels_of_coefficient_errors_rise_and_hold_the_usual_ones_between_them():
    """Published sets scatter by 3 to 6 %: three levels or more from there to half and twice as much."""
    levels = np.array(COEFFICIENT_SD_LEVELS)
    assert (np.diff(levels) > 0).all() and ((levels >= 0.015) & (levels <= 0.12)).sum() >= 3


def test_correlation_times_lie_evenly_about_the_usual_one_on_a_logarithmic_scale():
    assert np.diff(np.log(TIMES)) == approx([np.log(2)] * 2) and TIMES[1] == ProcessNoise().time == 1.0


def test_corrections_at_four_other_rudders_are_kept_the_oldest_giving_way(monkeypatch):
    """And angles that differ by less than matters are the same."""
    line = SimpleNamespace(indicated=np.zeros(9))
    runs = data_set.WhitenedDataSet.__new__(WhitenedDataSet)
    runs.runs, runs._by_rudder = [SimpleNamespace(linearised=line)], {}
    runs.dynamics, runs.coefficient_prior, runs.levels, runs.process_time = None, None, None, 1.0
    monkeypatch.setattr(data_set, "replace", lambda thing, **new: SimpleNamespace(**{**vars(thing), **new}))
    monkeypatch.setattr(data_set, "base_columns", lambda *_: None)
    monkeypatch.setattr(data_set, "WhitenedDataSet", lambda _, made, *__: made[0].linearised.indicated[1])
    course = np.array([0.0, 1.0] + [0.0] * 7)
    angles = [0.1 * k for k in range(1, 6)]
    with unchecked():
        assert runs.with_rudders([0.9 * SAME_RUDDER * course / np.std(course)]) is runs
        assert [runs.with_rudders([angle * course]) for angle in angles] == angles
        oldest = next(iter(runs._by_rudder))
        assert runs.with_rudders([angles[1] * course]) == angles[1] and next(iter(runs._by_rudder)) == oldest
    assert sorted(runs._by_rudder.values()) == approx(angles[1:])


def test_recordings_are_averaged_to_a_twentieth_of_the_time_in_which_a_ship_sails_its_length():
    p = SHIP.particulars
    unit = p.time_unit
    time = np.arange(0.0, 8 * unit, 0.01 * unit)
    flat = np.zeros_like(time)
    channels = {"u": flat + p.speed, "v": flat, "r": flat, "x": p.speed * time, "y": flat, "psi": flat, "delta": flat}
    (track,) = to_prime([Recording("run", time, channels)], p, 80.0, "approach")
    assert np.diff(track.time) == approx(0.05, rel=1e-6) and PACE == 0.05


# Coefficients ---------------------------------------------------------------------------------------------------------


def test_what_effects_do_to_errors_of_coefficients_is_told_of_each_run(monkeypatch):
    """Combinations that runs show: ``1 + seen K rotation``; the data about corrected ones: ``seen K c``."""
    rng = np.random.default_rng(2)
    change, seen, rotation, shares = (rng.standard_normal(s) for s in ((4, 4), (2, 4), (4, 2), 4))
    about = Calibrated.__new__(Calibrated)
    torch.nn.Module.__init__(about)
    about.shares = torch.tensor(shares)
    runs = [SimpleNamespace(linearised=SimpleNamespace(rate=SimpleNamespace(dynamics=d))) for d in (about, None)]
    stood = SimpleNamespace(runs=runs, corrections=None, seen=seen, rotation=rotation)
    h = Hypothesis((RudderOffset(SHIP),), (np.array([[1.0], [1.0]]),))
    with unchecked():
        monkeypatch.setattr(changed_coefficients, "change_of_coefficients", lambda *_: change)
        first, second = changed_coefficients.changed_base(stood, h)
        assert second[1:-1, 1:-1] == approx(np.eye(2) + seen @ change @ rotation) and not second[1:-1, 0].any()
        assert first[1:-1, 0] == approx(seen @ change @ shares) and first[0, 0] == first[-1, -1] == 1.0
        monkeypatch.setattr(changed_coefficients, "change_of_coefficients", lambda *_: None)
        assert changed_coefficients.changed_base(stood, h) == ()


def test_an_effect_that_multiplies_no_term_changes_no_error():
    """Alone nothing, beside one that does nothing more."""
    corrections, offset, depth = Corrections(CalmWater(SHIP)), RudderOffset(SHIP), ShallowWater(SHIP)
    both = [np.array([2.0]), _at_starts(depth)[0]]
    with unchecked():
        assert changed_coefficients.change_of_coefficients(corrections, [offset], both[:1]) is None
        alone = changed_coefficients.change_of_coefficients(corrections, [depth], both[1:])
        beside = changed_coefficients.change_of_coefficients(corrections, [offset, depth], both)
    assert np.abs(alone).max() > 0.01 and beside == approx(alone)


def test_what_is_said_to_be_identified_are_no_constants():
    told = SimpleNamespace(names=("Y_0", "Y_v", "Y_r"), identified=("Y_0", "Y_r"))
    with unchecked():
        assert record_information._wanted(told) == (["Y_v", "Y_r"], ["Y_r"])


def test_an_error_of_the_roll_inertia_changes_the_roll_rate_alone():
    """All of it, with the other sign."""
    ship = container()
    corrections = Corrections(CalmWater(ship))
    moving, delta = torch.tensor([[8.0, -0.5, 0.01, 0.1, 0.02]], dtype=torch.float64), torch.tensor([0.2])
    shares = torch.zeros(len(corrections.names), dtype=torch.float64)
    shares[corrections.names.index("Mp")] = 0.1
    with unchecked(), torch.no_grad():
        change = corrections.together(moving, delta.double(), shares, None, None)[0]
        rates = CalmWater(ship)(torch.cat([moving[:, :3], 0 * moving[:, :3], moving[:, 3:]], dim=-1), Inputs(delta))[0]
    assert change[:-1].tolist() == approx([0.0] * (len(change) - 1), abs=1e-12)
    assert float(change[-1]) == approx(-0.1 * float(rates[-1]), rel=1e-6) and float(change[-1]) != 0


def test_a_ship_whose_forces_are_no_sum_of_products_has_no_own_part():
    with pytest.raises(InputError, match=r"linear=own: the forces of the .* are no sum of known products"):
        baselines.own_part(kvlcc2_hsva())
    with pytest.raises(InputError, match="linear=own"):
        baselines.own_part(esso_osaka_mmg())


def test_as_many_samples_as_terms_without_one_block_are_too_few():
    count = 10 * baselines.VALIDATION_BLOCKS
    baselines._check(np.ones((count, count - 11)))
    with pytest.raises(InputError, match=f"{count} samples for {count - 10} terms"):
        baselines._check(np.ones((count, count - 10)))


def test_the_usual_speed_of_tests_is_that_of_most_and_unknown_where_none_has_one():
    assert captive_fit._most(np.array([1.0, np.nan, 2.0, 2.0])) == 2.0
    assert np.isnan(captive_fit._most(np.array([np.nan, np.nan])))


def test_errors_of_captive_forces_are_roots_of_their_variances():
    """A drift force of coefficients .3 +- .02 and .1 +- .01, both independent: at v' = .5 of .0112."""
    names = ((1, "u v"), (1, "v |v|"))
    fitted = Fitted(names, np.array([-0.3, -0.1]), np.diag([4e-4, 1e-4]), np.zeros(2), np.ones(2), np.eye(3))
    force, error = captive_fit.forces(fitted, np.array([[1.0, 0.5, 0.0, 0.0, 1.0, 0.0, 0.0]]))
    assert force[0] == approx([0.0, -0.175, 0.0])
    assert error[0] == approx([0.0, np.hypot(0.02 * 0.5, 0.01 * 0.25), 0.0])


def test_an_equation_of_which_no_coefficient_is_asked_is_left_alone():
    names = ((1, "u v"), (2, "u v"))
    like = Fitted(names, np.zeros(2), np.eye(2), np.zeros(2), np.ones(2), np.eye(3))
    v = np.linspace(-0.4, 0.4, 9)
    motion = np.stack([v * 0 + 1, v, v * 0, v * 0, v * 0 + 1, v * 0, v * 0], axis=1)
    tests = captive_fit.Towed(motion, np.stack([0 * v, -0.3 * v, -0.1 * v], axis=1), "")
    assert captive_fit.fit_captive(tests, like).values == approx([-0.3, -0.1], abs=1e-3)


@pytest.mark.parametrize("ship", ["esso_190k", "mariner"])
def test_own_products_of_a_tanker_go_with_the_shaft_speed_and_a_constant_is_written_1(ship):
    forces = own_forces(ship_named(ship))
    state = np.array([[0.9, 0.1, 0.2, 0.0, 0.0, 0.0], [0.7, -0.2, -0.4, 0.0, 0.0, 0.0]])
    inputs = {"delta": np.array([0.2, -0.3]), "n": np.array([0.8, 1.1])}
    still = {"delta": np.array([0.2, -0.3]), "n": np.array([1.0, 1.0])}
    columns, nominal = forces.columns(state, inputs), forces.columns(state, still)
    moved = np.abs(columns - nominal).max(axis=(0, 1)) > 0
    assert moved.any() == (ship == "esso_190k")
    assert all(name for _, name in forces.names)
    assert ((1, "1") in forces.names) == (ship == "mariner"), "the propeller's side force of the Mariner"
    assert len(forces.names) == columns.shape[2]


def test_the_prior_of_a_series_holds_the_ship_at_its_speed():
    """Thrust by n^2 is the resistance on the approach over .5 rho L T U0^2, and u takes up as much."""
    p = SHIP.particulars
    mean, _ = series_prior([(0, "u u"), (0, "u n"), (0, "n n")], p)
    unit = 0.5 * p.rho * p.length * p.draught * p.speed**2
    assert mean[2] * unit == approx(p.calm_resistance) and mean.sum() == approx(0.0, abs=1e-12)


@pytest.mark.parametrize("names, said", [
    (((1, "u v"), (2, "u v")), "forces and moment of the same motion show together"),
    (((1, "u v"), (1, "u u v")), "speed and shaft speed do not differ enough"),
    (((1, "u v"), (2, "u r")), "not told apart in these runs"),
])  # fmt: skip
def test_what_is_not_told_apart_is_said_with_what_would(names, said):
    assert said in _words(names)


def test_a_rudder_that_is_counted_to_port_changes_the_sign_of_its_odd_powers():
    known = SHIP
    inputs = torch.tensor([[known.particulars.speed / known.prime.speed, 0.4, 0.0, 0.2]])
    tuples = Tuples(inputs, torch.zeros(1, 3), torch.zeros(1), torch.zeros(1, dtype=torch.int64))
    terms = {"Y": ["v", "d", "vd", "ddd", "dd"]}
    starboard, port = (taylor_columns(tuples, known, terms, side)["Y"][0] for side in ("starboard", "port"))
    assert port == approx(starboard * [1, -1, -1, -1, 1]) and starboard[1] == approx(0.2)
    assert starboard[3] == approx(0.2**3 / 6) and starboard[0] != 0


# Which manoeuvre tells more ------------------------------------------------------------------------------------------


def sailing(u: tuple[float, float], r: float = 0.0, delta: float = 20.0) -> Recording:
    time = np.linspace(0.0, 100.0, 101)
    flat = np.zeros_like(time)
    rudder = delta * DEGREE * np.sin(0.1 * time)
    turn = flat + r if r else 0.01 * np.sin(0.1 * time)
    return Recording("run", time, {"u": np.linspace(*u, 101), "v": flat, "r": turn, "delta": rudder})


@pytest.mark.parametrize("lacking, runs, said, unsaid", [
    (["X_uu"], [sailing((7.0, 7.2))], "a hard turn", "turning circle"),
    (["X_uu"], [sailing((7.0, 3.0))], "a straight run at another speed", "hard turn"),
    (["Y_v"], [sailing((7.0, 3.0))], "a turning circle", "straight run"),
    (["N_v"], [sailing((7.0, 7.2), r=0.01)], "a zigzag", "hard turn"),
    (["N_v"], [sailing((7.0, 7.2), r=0.01), sailing((7.0, 7.2))], "more of the same", "hard turn"),
    (["Y_v"], [sailing((7.0, 7.2), delta=0.5)], "the rudder does not move", "turning circle"),
])  # fmt: skip
def test_what_runs_do_not_tell_others_would(lacking, runs, said, unsaid):
    text = record_information._remedy(runs, lacking)
    assert said in text and unsaid not in text


def test_no_error_of_a_sample_reaches_the_next_recording():
    """Two records of 40 and 60 samples: noise goes through the smoother's slope in each by itself."""
    rng = np.random.default_rng(3)
    columns, slope = rng.standard_normal((100, 2)), np.array([-1.0, 0.0, 1.0])
    target = columns @ [1.0, -2.0]
    value, covariance, _ = record_information._solved(columns, target, 0.1, slope, [40, 60])
    felt = [np.stack([np.convolve(c, slope) for c in piece.T], axis=1) for piece in np.split(columns, [40])]
    inverse = np.linalg.inv(columns.T @ columns)
    expected = inverse @ sum(0.01 * f.T @ f for f in felt) @ inverse
    assert value == approx([1.0, -2.0]) and covariance == approx(expected, rel=1e-6)
