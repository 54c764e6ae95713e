"""What an effect adds to a run, against simulations with the effect, loops and solvers."""

import copy
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import torch
from fleet import unchecked
from pytest import approx
from scipy.integrate import solve_ivp
from tiers import mainly
from trials import CALM, NOISE, SHIP, TIMED, ZIGZAG, about, run_of, sailed, states_of, values

from manoeuvre_nn.core.channels import MEASURED
from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.dynamics.base import calm_accelerations
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.effect.current import Current
from manoeuvre_nn.effect.depth import ShallowWater
from manoeuvre_nn.effect.local import Tow
from manoeuvre_nn.effect.propulsion import HullFouling, PowerLimit, PropellerSideForce
from manoeuvre_nn.effect.roll import RollCoupling
from manoeuvre_nn.effect.rudder import (
    RudderAreaLoss,
    RudderBacklash,
    RudderDelay,
    RudderOffset,
    RudderSaturation,
    RudderSlow,
)
from manoeuvre_nn.effect.sensors import GpsDelay, HeadingBias, LeverArm, LogScale, RateBias
from manoeuvre_nn.effect.wind import SteadyWind
from manoeuvre_nn.estimation.corrections import Calibrated, Corrections
from manoeuvre_nn.estimation.data_set import WhitenedDataSet, whitened_data_set
from manoeuvre_nn.estimation.effect_columns import (
    coefficient_columns,
    contribution,
    latency_column,
    own_states,
    perfect,
)
from manoeuvre_nn.estimation.hypothesis import Hypothesis
from manoeuvre_nn.estimation.linear_run import Columns, joined
from manoeuvre_nn.estimation.linearised_run import LinearisedRun, Rate, integrated, shown
from manoeuvre_nn.estimation.marginal_likelihood import MarginalLikelihood
from manoeuvre_nn.estimation.prepared_run import FIRST_NOISE
from manoeuvre_nn.estimation.relinearise import refined
from manoeuvre_nn.estimation.rudder_blades import behind_record, blade_along
from manoeuvre_nn.recording.preparation import measured

RATE = Rate(CALM)
LARGE = {
    e.name: e
    for e in (
        Current(SHIP, speed=0.8, toward_deg=60.0),
        ShallowWater(SHIP, depth_m=20.0),
        PowerLimit(SHIP, rpm_slope=0.4),
        RollCoupling(SHIP, N_phi=0.02),
        RudderSlow(SHIP, rate_deg_s=2.0),
        RudderBacklash(SHIP, width_deg=5.0),
        RudderDelay(SHIP, delay_s=2.0),
        HeadingBias(SHIP, bias_deg=1.0),
        LeverArm(SHIP, dx_m=30.0, dy_m=5.0),
        GpsDelay(SHIP, delay_s=1.0),
        SteadyWind(SHIP, speed=10.0, from_deg=60.0),
        Tow(SHIP, force_kN=100.0, angle_deg=100.0, start_s=0.0, end_s=500.0),
        HullFouling(SHIP, added_resistance=0.3),
        PropellerSideForce(SHIP, force_kN=60.0),
        RudderOffset(SHIP, offset_deg=1.5),
        RudderSaturation(SHIP, limit_deg=15.0),
        RateBias(SHIP, bias_deg_s=0.03),
        LogScale(SHIP, factor=1.05),
    )
}
"""Effects of every site at sizes that matter."""
EACH_KIND = pytest.mark.parametrize("name", mainly(11, LARGE))  # the others act as one of these does
STATES = np.array([1e-3, 1e-3, 1e-5, 1e-2, 1e-2, 1e-4])
"""Changes of the state within a step that are next to nothing."""


@cache
def calm_record() -> Recording:
    return sailed([TIMED])[0]


@cache
def truth(name: str) -> tuple[LinearisedRun, Columns]:
    """A noise-free run with an effect about its own true track, and what the effect adds to it."""
    effect = LARGE[name]
    (record,), calm = sailed([TIMED], [effect]), calm_record()
    # What a sensor writes down is not where the ship is.
    line = about(run_of(record), states_of(calm if effect.site == "sensor" else record))
    return line, added(effect, line)


def added(effect: Effect, line: LinearisedRun) -> Columns:
    with unchecked():
        return contribution(effect, values(effect), line)


@EACH_KIND
def test_an_effect_moves_the_ship_as_calm_water_lacks_along_its_true_track(name):
    line, c = truth(name)
    missing = -line.defect
    off = np.abs(c.moved[..., 0] - missing) / (np.abs(missing).max(axis=0) + STATES)
    # A rudder that comes to rest between two samples is not linear between them. Positions see it later.
    assert np.quantile(off[:, :3], 0.9, axis=0).max() < 0.01 and off.max() < 0.1


@pytest.mark.parametrize("fault", [RudderAreaLoss(SHIP, fraction=0.3), RudderBacklash(SHIP, width_deg=6.0)])
def test_what_acts_beside_a_late_record_of_the_rudder_does_so_when_the_rudder_is_laid(fault):
    both = [RudderDelay(SHIP, delay_s=9.0), fault]
    line = about(run_of(sailed([TIMED], both)[0]), states_of(sailed([TIMED], both)[0]))
    with unchecked():
        behind = behind_record(line, both, [e.values.numpy() for e in both])
        added = sum(contribution(e, values(e), behind).moved[..., 0] for e in both)
        late = sum(contribution(e, values(e), line).moved[..., 0] for e in both)
    off, without = (np.abs(a + line.defect)[:, :3] / np.abs(line.defect)[:, :3].max(axis=0) for a in (added, late))
    assert np.quantile(off, 0.9, axis=0).max() < 0.01 and off.max() < 0.1
    assert np.quantile(without, 0.9, axis=0).min() > 0.03


@EACH_KIND
def test_an_effect_changes_the_channels_as_the_recorder_wrote_them(name):
    line, c = truth(name)
    assert (np.abs(c.measured[..., 0] - line.residual) < 5e-3 * NOISE).all()


SMALL = [
    (Current(SHIP, speed=0.05, toward_deg=60.0), 0.01),
    (RudderSlow(SHIP, rate_deg_s=2.0), 0.12),
    (PowerLimit(SHIP, rpm_slope=0.02), 0.02),
    (HeadingBias(SHIP, bias_deg=0.1), 0.01),
    (SteadyWind(SHIP, speed=0.5, from_deg=60.0), 0.01),
    (ShallowWater(SHIP, depth_m=185.0), 0.03),
    (RudderOffset(SHIP, offset_deg=0.1), 0.01),
    (RollCoupling(SHIP, N_phi=5e-4), 0.02),
    (LogScale(SHIP, factor=1.01), 0.01),
    (LeverArm(SHIP, dx_m=3.0, dy_m=1.0), 0.01),
]


@pytest.mark.parametrize("effect, tolerance", mainly(6, SMALL), ids=[e.name for e, _ in SMALL])
def test_carried_on_by_the_transitions_it_is_the_difference_of_two_simulations(effect, tolerance):
    """A second route past the smoother: sensitivities about the calm track, summed up over two minutes."""
    (record,), calm = sailed([TIMED], [effect]), calm_record()
    line = about(run_of(calm), states_of(calm))
    c = added(effect, line)
    off = np.zeros((len(calm), 9))
    for k in range(len(calm) - 1):
        off[k + 1] = line.transition[k] @ off[k]
        off[k + 1, :6] += c.moved[k, :, 0]
    predicted = np.einsum("kci,ki->kc", line.observed, off) + c.measured[..., 0]
    happened = measured(run_of(record)) - measured(run_of(calm))
    assert np.abs(happened / NOISE).max() > 0.1, "too small to see"
    left = np.abs(predicted - happened).max(axis=0)
    assert (left < tolerance * np.abs(happened).max(axis=0) + 2e-3 * NOISE).all()


ON_BENCH = {
    name: LARGE[name]
    for name in (
        "current", "wind_steady", "rudder_slow", "roll_coupling", "heading_bias", "power_limit", "shallow_water",
        "rudder_offset", "log_scale",
    )
} | {"gps_lever_arm": LeverArm(SHIP, dx_m=8.0, dy_m=2.0)}  # fmt: skip
FAR = {"gps_lever_arm": LARGE["gps_lever_arm"], "shallow_water": LARGE["shallow_water"], "wind": LARGE["wind_steady"]}
"""Effects that the first track may take for something else."""


def on_bench(effect: Effect) -> WhitenedDataSet:
    """A noise-free zigzag; the smoother knows nothing of the effect."""
    run = run_of(sailed([replace(ZIGZAG, duration=160.0)], [effect])[0])
    with unchecked():
        return whitened_data_set(CALM, [run])


def misfits(stand: WhitenedDataSet, effect: Effect) -> np.ndarray:
    """Inner products of the data and the effect's columns at the true values, with next to no other force."""
    (place,), p = stand.runs, SHIP.particulars
    force = 1e-3 * p.speed**2 / p.length * np.array([1.0, 1.0, 1.0 / p.length])
    white = integrated(place.linearised, FIRST_NOISE, force, p.time_unit, np.array([2.0, 2.0, 0.01, 50.0, 50.0, 0.3]))
    e = white.embed(joined([place.data, added(effect, place.linearised)]))
    return e.dot(e)


@pytest.mark.parametrize("name", mainly(5, ON_BENCH))
def test_on_the_bench_the_true_values_leave_no_misfit_and_calm_water_much(name):
    g = misfits(on_bench(ON_BENCH[name]), ON_BENCH[name])
    assert g[0, 0] > 100
    assert g[0, 0] - 2 * g[0, 1] + g[1, 1] < 0.015 * g[0, 0]
    assert g[0, 1] / g[1, 1] == approx(1.0, abs=0.05), "the size that fits best"


@pytest.mark.parametrize("name", FAR)
def test_about_the_track_of_the_true_hypothesis_less_is_left(name):
    effect, first = FAR[name], on_bench(FAR[name])
    held = Hypothesis((effect,), (values(effect),), frozenset(p.name for p in effect.declared))
    with unchecked():
        second = refined(first, MarginalLikelihood(first).evaluate(held))
    left = []
    for stand in (first, second):
        g = misfits(stand, effect)
        left.append((g[0, 0] - 2 * g[0, 1] + g[1, 1]) / g[0, 0])
    assert left[1] < max(0.3 * left[0], 2e-4) < 0.1
    assert g[0, 1] / g[1, 1] == approx(1.0, abs=0.01)


def test_several_sets_of_values_are_several_columns():
    line, _ = truth("wind_steady")
    effect = LARGE["wind_steady"]
    sets = np.repeat(values(effect), 3, axis=0)
    sets[:, 0] = [0.0, 5.0, 10.0]
    with unchecked():
        many, alone = contribution(effect, sets, line), contribution(effect, sets[1:2], line)
    # Without wind its load is that of still air, but for last digits: functions of many and of few numbers round apart.
    assert many.count == 3 and np.abs(many.moved[..., 0]).max() < 1e-15 * np.abs(many.moved).max()
    assert many.moved[..., 1] == approx(alone.moved[..., 0], abs=1e-15)


def test_the_blade_behind_play_moves_only_where_the_indicator_pushes_it():
    run = truth("rudder_backlash")[0].run
    half, blade = 2.5 * DEGREE, [run["delta"][0]]
    for shown_now in run["delta"][1:]:
        blade.append(min(max(blade[-1], shown_now - half), shown_now + half))
    with unchecked():
        found = blade_along(LARGE["rudder_backlash"].at(torch.tensor([[[5.0]]]).double()), run, deltas(run))
    assert found[0].numpy() == approx(np.array(blade), abs=1e-12)
    assert np.abs(blade - run["delta"]).max() == approx(half)


def deltas(run) -> torch.Tensor:
    return torch.tensor(run["delta"])[None]


def test_the_blade_of_a_slow_rudder_follows_each_order_from_the_time_at_which_it_was_given():
    """Orders between samples: a loop with steps of a thousandth of a second, less the same with the nominal gear."""
    run = truth("rudder_slow")[0].run
    order = np.select([run.time < 20.6, run.time < 50.3], [0.0, 12 * DEGREE], -12 * DEGREE)
    lead = np.zeros_like(order)
    lead[[21, 51]] = 0.4, 0.7  # given at 20.6 and 50.3 s

    def moved(rate: float) -> np.ndarray:
        blade, samples = 0.0, [0.0]
        for k in range(int(1000 * run.time[-1])):
            wanted = 0.0 if k < 20600 else 12 * DEGREE if k < 50300 else -12 * DEGREE
            blade += min(max(wanted - blade, -1e-3 * rate), 1e-3 * rate)
            samples += [blade] * ((k + 1) % 1000 == 0)
        return np.array(samples)

    nominal = SHIP.particulars.rudder_rate
    shown_angle = moved(nominal) + 0.01  # an indicator that is off all the time: the fault is added to it
    made = run.with_channels(delta_order=order, order_lead=lead, delta=shown_angle)
    slow = LARGE["rudder_slow"].at(torch.tensor([[[1.5]], [[2.0]]]).double())
    with unchecked():
        found = blade_along(slow, made, deltas(made).expand(2, -1)).numpy()
    for row, rate in enumerate((1.5, 2.0)):
        expected = shown_angle + moved(rate * DEGREE) - moved(nominal)
        assert found[row] == approx(expected, abs=2e-3 * DEGREE)


@pytest.mark.parametrize("name", ["roll_coupling", "power_limit"])
def test_own_states_are_those_of_an_ode_solver_along_the_track(name):
    line, _ = truth(name)
    effect = LARGE[name]
    with unchecked():
        s = line.situation
        found = own_states(effect.at(effect.values[None, None]), s, 1, line.run.step)[0].numpy()
    t, p = line.run.time, SHIP.particulars
    u, r, vdot = line.track[:, 0], line.track[:, 2], s.nudot[:, 1].numpy()
    if name == "power_limit":
        at = np.interp
        limit = 1 - 0.4 * (1 - u / p.speed)
        path = solve_ivp(lambda x, n: (at(x, t, limit) - n) / 8.0, (0, t[-1]), limit[:1], t_eval=t, max_step=0.5)
    else:
        heel = p.heeling
        steady = -(heel.kg - 0.5 * p.draught) / (9.80665 * heel.gm) * (u * r + vdot)
        w = 2 * np.pi / heel.roll_period

        def roll(x, y):
            return [y[1], w * w * (np.interp(x, t, steady) - y[0]) - 2 * heel.roll_damping * w * y[1]]

        path = solve_ivp(roll, (0, t[-1]), [0.0, 0.0], t_eval=t, max_step=0.5)
    # The drive is taken constant within a step, at its mean.
    size = np.abs(path.y - path.y[:, :1]).max(axis=1)
    assert (np.abs(found.T - path.y).max(axis=1) < 0.02 * size).all() and (size > 1e-3).all()


def calm_line() -> LinearisedRun:
    return about(run_of(calm_record()), states_of(calm_record()))


def changed(coefficient: tuple[int, int] | None = None, inertia: int | None = None) -> CalmWater:
    """The ship with one number of its set, or its inertia in one direction, larger by a thousandth."""
    ship = copy.deepcopy(SHIP)
    if coefficient is not None:
        ship.series.coefficients[coefficient] *= 1.001
    if inertia is not None:
        ship.inertia_inverse[inertia] /= 1.001
    return CalmWater(ship)


def test_a_calibrated_ship_is_one_with_other_numbers():
    corrections, state = Corrections(CALM), calm_line().track[::7]
    nu, delta = torch.tensor(state[:, :3]), torch.tensor(calm_line().run["delta"][::7])
    (k, e), shares = torch.nonzero(SHIP.table).tolist()[4], torch.zeros(len(corrections.names)).double()
    shares[corrections.names.index("XYN"[e] + SHIP.terms[k])] = 1e-3
    found = calm_accelerations(Calibrated(CALM, shares), nu, delta)
    assert torch.allclose(found, calm_accelerations(changed((k, e)), nu, delta), rtol=0, atol=1e-12)
    assert not torch.allclose(found, calm_accelerations(CALM, nu, delta), rtol=0, atol=1e-9)
    shares = torch.zeros_like(shares)
    shares[corrections.names.index("Mv")] = 1e-3
    found = calm_accelerations(Calibrated(CALM, shares), nu, delta)
    assert torch.allclose(found, calm_accelerations(changed(inertia=1), nu, delta), rtol=2e-6, atol=1e-12)
    slow = Calibrated(CALM, shares).on_approach(5.0)
    assert slow.particulars.speed == 5.0 and slow.hull.particulars.speed == 5.0


class Opaque(CalmWater):
    """Accelerations without a set of coefficients behind them, as a network's."""

    @property
    def hull(self):
        bare = copy.copy(self.ship)
        bare.__class__ = type("Bare", (type(self.ship),), {"table": None})
        return bare


def test_a_model_without_coefficients_is_corrected_by_hull_and_rudder():
    """Both parts by 100 % in every equation are the whole force once more."""
    corrections, line = Corrections(Opaque(SHIP)), calm_line()
    nu, delta = torch.tensor(line.track[:, :3]), torch.tensor(line.run["delta"])
    with unchecked():
        rows = corrections(nu, delta)
    at = [corrections.names.index(f"{e}{part}") for part in ("hull", "rudder") for e in "XYN"]
    assert torch.allclose(rows[:, at].sum(dim=1), calm_accelerations(CALM, nu, delta), atol=1e-12)
    assert not rows[delta == 0][:, at[3:]].any(), "a rudder amidships has no force"


def test_terms_that_the_ship_lacks_weigh_three_fifths_of_its_rudder_in_a_tight_turn():
    p = SHIP.particulars
    hard = np.array([0.7 * p.speed, -0.25 * p.speed, 0.7 * p.speed / p.length, 0.0, 0.0, 0.0])
    run = run_of(calm_record()).between(0.0, 2.0)
    line = about(run.with_channels(delta=np.full(3, 0.35)), np.tile(hard, (3, 1)))
    with unchecked():
        columns, names = coefficient_columns(CALM, line), Corrections(CALM).names
        nu = torch.tensor(hard[:3])
        rudder = calm_accelerations(CALM, nu, nu.new_tensor(0.35)) - calm_accelerations(CALM, nu, nu.new_tensor(0.0))
        unit = Corrections(CALM)(nu, nu.new_tensor(0.35))
    for equation, letter in ((1, "Y"), (2, "N")):
        sizes = [abs(columns.moved[0, equation, k]) for k, n in enumerate(names) if n.startswith(f"{letter}+")]
        assert len(sizes) > 10 and sizes == approx([sizes[0]] * len(sizes))
        assert sizes[0] == approx(0.6 * abs(float(rudder[equation])), rel=0.15), "in a second, in which she turns on"
        now = [abs(float(unit[k, equation])) for k, n in enumerate(names) if n.startswith(f"{letter}+")]
        assert now == approx([0.6 * abs(float(rudder[equation]))] * len(sizes))


def test_a_late_receiver_shows_where_the_ship_was():
    line = calm_line()
    late = latency_column(line)
    path, t = shown(line.track), line.run.time
    for k, name in enumerate(MEASURED):
        before = np.interp(t - 0.1, t, path[:, k]) if name in {"x", "y", "vn", "ve"} else path[:, k]
        expected = (before - path[:, k])[2:-2]
        assert 0.1 * late.measured[2:-2, k, 0] == approx(expected, abs=0.1 * np.abs(expected).max() + 1e-12)
    assert not late.moved.any() and late.measured[60, 0, 0] == approx(-path[60, 2], rel=0.01)


def test_perfect_sensors_write_what_the_linear_equations_observe():
    line = calm_line()
    written = perfect(line.situation)
    assert np.stack([written[k].numpy() for k in MEASURED], axis=-1) == approx(shown(line.track), abs=1e-12)
    assert np.array_equal(written["delta"].numpy(), line.run["delta"])
