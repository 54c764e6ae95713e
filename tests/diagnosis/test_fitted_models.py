"""Models that were fitted to recordings: what they doubt and trust; winds that swing about a model on a pond."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest
import torch
import yaml
from fleet import unchecked
from pytest import approx
from trials import CALM, CIRCLE, NOISE, ZIGZAG, runs

from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.core.scaling import Scaling
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.diagnosis.case import Case, Question
from manoeuvre_nn.diagnosis.diagnose import diagnose
from manoeuvre_nn.diagnosis.forecast import drawn_tables, known_of
from manoeuvre_nn.diagnosis.gusts import _course, _courses, _gusts_of, _without_courses
from manoeuvre_nn.diagnosis.words import left_open, summary_sentence
from manoeuvre_nn.dynamics.base import Model, calm_accelerations, is_fitted
from manoeuvre_nn.dynamics.model import CalmWater, IdentifiedShip
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.effect.rudder import RudderOffset
from manoeuvre_nn.effect.wind import GustyWind, SteadyWind
from manoeuvre_nn.estimation.corrections import Calibrated, Corrections
from manoeuvre_nn.estimation.data_set import COEFFICIENT_SD_LEVELS, whitened_data_set
from manoeuvre_nn.estimation.hypothesis import Hypothesis
from manoeuvre_nn.estimation.linear_run import joined
from manoeuvre_nn.estimation.marginal_likelihood import (
    PROCESS_PRIOR,
    MarginalLikelihood,
    hypothesis_columns,
    log_prior_levels,
)
from manoeuvre_nn.estimation.model_corrections import USUAL_SCATTER
from manoeuvre_nn.estimation.posterior import Posterior, posterior
from manoeuvre_nn.estimation.prepared_run import FIRST_NOISE, LATENCY_SD, samples_a_state
from manoeuvre_nn.estimation.process_noise import PROCESS_LEVELS
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.network.series import Series, SeriesSettings
from manoeuvre_nn.recording.preparation import common_step, over_ground, prepared
from manoeuvre_nn.ship.esso_osaka_model import esso_osaka_mmg, esso_osaka_model
from manoeuvre_nn.ship.known import clarke_inertia_part
from manoeuvre_nn.training.closed_loop_fit import fit_series

pytestmark = pytest.mark.usefixtures("unchecked_types")
NU, DELTA, SHAFT = (torch.tensor(x, dtype=torch.float64) for x in ([[0.35, -0.03, 0.04]], [0.3], [1.2]))
STATE = torch.nn.functional.pad(NU, (0, 3))
NOISE_OF_FIT = torch.tensor([0.02, 0.03, 0.04, 0.05, 0.06, 0.07], dtype=torch.float64)
CONF = Path(__file__).parents[2] / "conf"
CANDIDATES = (SteadyWind, GustyWind, RudderOffset)
LEVEL = PROCESS_LEVELS.point(1, 1)
WINDY = {"wind_surge": ["wx |w|"], "wind_lateral": ["wy |w|"]}


def fitted(seed: int = 0, **more) -> IdentifiedShip:
    """A series with coefficients, a covariance and noise that came from anywhere."""
    network = Series(SeriesSettings(["u u", "n n"], ["v", "d n n"], **more))
    g = torch.Generator().manual_seed(seed)
    count = len(network.names)
    root = 0.01 * torch.randn(count, count, generator=g, dtype=torch.float64)
    values = 0.05 * torch.randn(count, generator=g, dtype=torch.float64)
    network.take(values, root @ root.T, NOISE_OF_FIT)
    scaling = Scaling(torch.zeros(4), torch.ones(4), torch.ones(3))
    return IdentifiedShip(clarke_inertia_part(esso_osaka_model()), network, scaling).double()


def with_values(model: IdentifiedShip, values: torch.Tensor) -> IdentifiedShip:
    made = fitted()
    made.network.take(values, model.network.covariance)
    return made


def test_sensitivities_are_what_a_standard_error_of_each_combination_adds():
    model = fitted()
    network = model.network
    sizes, axes = torch.linalg.eigh(network.covariance)
    values = network.coefficients[0][network.used].detach()
    rows = model.sensitivities(STATE, Inputs(DELTA, SHAFT))[0].detach()
    for k, row in enumerate(rows):
        moved = with_values(model, values + axes[:, k] * sizes[k].sqrt())
        change = calm_accelerations(moved, NU, DELTA, SHAFT) - calm_accelerations(model, NU, DELTA, SHAFT)
        assert row.numpy() == approx(change[0].detach().numpy(), abs=1e-12)


def test_other_models_have_no_sensitivities_and_no_noise():
    assert CALM.sensitivities(STATE, Inputs(DELTA, SHAFT)).shape == (1, 0, 3) and not CALM.noise.any()
    blank = fitted()
    blank.network.covariance.zero_()
    assert blank.sensitivities(STATE, Inputs(DELTA, SHAFT)).shape == (1, 0, 3)


def test_the_noise_of_the_fit_comes_in_si_units():
    length, speed = 3.0, 0.4
    units = [speed, speed, speed / length, length, length, 1.0]
    assert fitted().noise.numpy() == approx(NOISE_OF_FIT.numpy() * units)


def test_at_the_nominal_shaft_speed_still_air_meets_the_ship_as_she_goes():
    model = fitted(**WINDY)
    assert calm_accelerations(model, NU, DELTA, torch.ones(1).double())[0].detach().numpy() == approx(
        calm_accelerations(model, NU, DELTA)[0].detach().numpy()
    )


def test_corrections_of_a_fitted_model_are_its_sensitivities():
    model = fitted()
    corrections, rows = Corrections(model), model.sensitivities(STATE, Inputs(DELTA, SHAFT))
    count = rows.shape[1]
    assert corrections.names[:count] == [f"fit {k + 1}" for k in range(count)]
    made = corrections(NU, DELTA, SHAFT).detach()
    assert (USUAL_SCATTER * made[0, :count]).numpy() == approx(rows[0].detach().numpy())
    shares = torch.randn(len(corrections.names), generator=torch.Generator().manual_seed(3), dtype=torch.float64)
    together = corrections.together(NU, DELTA, shares, SHAFT).detach()
    assert together[0].numpy() == approx((made[0] * shares[:, None]).sum(0).numpy())
    added = calm_accelerations(Calibrated(model, shares), NU, DELTA, SHAFT) - calm_accelerations(
        model, NU, DELTA, SHAFT
    )
    assert added[0].detach().numpy() == approx(together[0].numpy())


@pytest.fixture(scope="module")
def stands():
    """The same two runs on the bench of published coefficients, and of a model that says what noise its fit had."""
    record = runs([CIRCLE, ZIGZAG], step=1.0)

    class Said(CalmWater):
        @property
        def noise(self):
            return torch.tensor([0.2, 0.2, 2e-3, 3.0, 3.0, 0.01], dtype=torch.float64)

    return whitened_data_set(CALM, record), whitened_data_set(Said(CALM.ship), record)


def test_channels_are_trusted_as_they_were_in_the_fit(stands):
    published, own = stands
    assert not is_fitted(published.dynamics) and is_fitted(own.dynamics)
    for place in own.runs:
        whole = np.sqrt(samples_a_state(own.dynamics, 1.0)) * place.noise  # that of single samples
        assert whole[:6] == approx([3.0, 3.0, 0.2, 0.2, 0.01, 2e-3]) and (place.inflation[:6] == 1).all()
    assert published.runs[0].noise[:2] == approx(NOISE[:2], rel=0.4) and (FIRST_NOISE > 0).all()


def test_what_a_fitted_model_may_lack_is_not_known_beforehand(stands):
    published, own = (log_prior_levels(stand, PROCESS_PRIOR) for stand in stands)
    assert np.ptp(own) == approx(0.0, abs=1e-12) and np.exp(own).sum() == approx(1.0)
    assert published[0].max() > published[-1].max() + 100


def held(effect) -> Hypothesis:
    """An effect whose every number is known, in both runs."""
    values = np.tile(effect.values.numpy(), (2, 1))
    return Hypothesis((effect,), (values,), frozenset(p.name for p in effect.declared))


def without_gusts(likelihood: MarginalLikelihood, hypothesis: Hypothesis) -> Posterior:
    """With the course of gusts integrated out."""
    wind, kind = _gusts_of(hypothesis)
    lin, courses = hypothesis_columns(likelihood.data_set, hypothesis), _courses(likelihood, hypothesis, wind, [kind])
    (gram,), (norm,) = _without_courses(likelihood.data_set, lin, courses, [kind], LEVEL)
    return likelihood.regress(gram, norm, hypothesis)


def test_gusts_of_no_size_are_a_steady_wind(stands):
    likelihood, wind = MarginalLikelihood(stands[0]), {"speed": 12.0, "from_deg": 70.0}
    plain = likelihood.evidence_at(held(SteadyWind(CALM.ship, **wind)), LEVEL)
    calm = without_gusts(likelihood, held(GustyWind(CALM.ship, **wind, gust_sd=1e-4)))
    assert calm.evidence.max() == approx(plain, abs=1e-3)


def test_gusts_across_are_as_large_as_they_are_told_to_be(stands):
    likelihood, hypothesis = MarginalLikelihood(stands[0]), held(SteadyWind(CALM.ship, speed=12.0, from_deg=70.0))
    one, part, along = (_course(likelihood, hypothesis, 0, 0, 20.0, across) for across in (1.0, 0.7, 0.0))
    half = along.count
    assert (one.count, part.count) == (2 * half, 2 * half)
    assert part.moved[..., :half] == approx(along.moved) and part.moved[..., half:] == approx(
        0.7 * one.moved[..., half:]
    )


def test_a_course_that_is_integrated_out_is_one_with_free_amplitudes(stands):
    """The second route: the amplitudes of the gusts' course as unknowns of the regression, with their prior."""
    likelihood, stand = MarginalLikelihood(stands[0]), stands[0]
    wind = GustyWind(CALM.ship, speed=12.0, from_deg=70.0, gust_sd=2.0, gust_time_s=20.0, gust_across=0.7)
    hypothesis = held(wind)
    lin = hypothesis_columns(stand, hypothesis)
    courses = [_course(likelihood, hypothesis, 0, run, 20.0, 0.7) for run in range(2)]
    ends = np.cumsum([1, *(c.count for c in courses)])
    index = [np.r_[0, a:b] for a, b in zip(ends[:-1], ends[1:], strict=True)]
    columns = [joined([c, more]) for c, more in zip(lin.columns, courses, strict=True)]
    gram = stand.gram(LEVEL, stand.embedded(LEVEL, columns), index, ends[-1])
    whole = stand.size
    data = np.zeros(len(gram))
    data[0], data[whole] = 1.0, -1.0
    keep = np.r_[0, whole, 1:whole, whole + 1 : len(gram)]
    prior = np.r_[np.ones(stand.combinations), np.full(2, LATENCY_SD), np.full(ends[-1] - 1, 2.0)]
    found = posterior(
        gram[np.ix_(keep, keep)],
        stand.at(LEVEL).norm,
        prior,
        data[keep],
        COEFFICIENT_SD_LEVELS,
        stand.combinations,
    )
    at_level = without_gusts(likelihood, hypothesis)
    assert at_level.evidence == approx(found.evidence, abs=1e-3)


def test_winds_swing_as_much_as_they_are_told_to():
    wind = GustyWind(CALM.ship, speed=10.0, from_deg=30.0, gust_sd=2.0, gust_time_s=5.0, gust_across=0.5)
    assert wind.random == ("gust_sd", "gust_time_s", "gust_across")
    assert wind.steady(wind.values.numpy())[[p.name for p in wind.declared].index("gust_sd")] == 0
    time = torch.arange(0.0, 2500.0, 0.5, dtype=torch.float64)
    s = SimpleNamespace(time=time)
    along, across = wind._speed(s), wind._swing(s)
    assert float(along.std()) == approx(2.0, rel=0.15) and float(across.std()) == approx(1.0, rel=0.15)
    assert abs(float(torch.corrcoef(torch.stack([along, across]))[0, 1])) < 0.15


def test_a_swing_to_the_right_is_wind_from_farther_right():
    ship = CALM.ship
    turned = SteadyWind(ship, speed=10.0, from_deg=30.0 + np.degrees(np.arctan(0.3)))
    swung = SteadyWind(ship, speed=10.0, from_deg=30.0)
    swung._swing = lambda s: 3.0
    turned._speed = lambda s: np.hypot(10.0, 3.0)
    zero = torch.zeros(1, dtype=torch.float64)
    s = SimpleNamespace(u=zero + 5, v=zero, psi=zero + 0.4, time=zero)
    assert swung.force(s)[0].numpy() == approx(turned.force(s)[0].numpy())


def test_usual_sizes_of_a_model_are_those_of_a_ship_by_froudes_law():
    ship, model = CALM.ship.particulars, esso_osaka_model()
    share = 3.0 / 160.0
    powers = (1.0, 0.5, -0.5, 3.0)
    assert model.is_model and model.sized([2.0] * 4, powers) == approx([2 * share**p for p in powers])
    assert not ship.is_model and ship.sized([2.0] * 4, powers) == approx([2.0] * 4)
    speed = SteadyWind(clarke_inertia_part(model)).declared[0]
    of_ship = SteadyWind(CALM.ship).declared[0]
    assert speed.spread == approx(of_ship.spread * share**0.5) and (speed.low, speed.high) == (0.0, of_ship.high)
    lasting = next(p for p in GustyWind(clarke_inertia_part(model)).declared if p.name == "gust_time_s")
    assert lasting.spread == next(p for p in GustyWind(CALM.ship).declared if p.name == "gust_time_s").spread


def test_what_a_fitted_model_leaves_open_is_said():
    def tried(fits: bool):
        likelihood = SimpleNamespace(
            data_set=SimpleNamespace(dynamics=Mock(Model, noise=np.array(fits)), levels=np.array([[0.05, 0.015]]))
        )
        return SimpleNamespace(likelihood=likelihood, none=SimpleNamespace(best=(0, 0)))

    quiet = SimpleNamespace(named=False, best=None)
    assert left_open(tried(False), quiet) == ""
    said = summary_sentence([], [], [], False, left_open(tried(True), quiet))
    assert "5 % of the resistance and 1.5 % of 20 deg of rudder" in said and "no effect explains" in said
    wind = SteadyWind(CALM.ship)
    named = SimpleNamespace(named=True, best=SimpleNamespace(hypothesis=Hypothesis((wind,), (np.zeros((1, 9)),))))
    assert "no effect predicts runs that were not used better" in left_open(tried(True), named)
    assert "wind" not in left_open(tried(True), named)
    told = left_open(tried(False), named)
    assert told.startswith("with a steady wind the fitted runs are explained better") and "not used" in told


class GustsOfTheirOwn(GustyWind):
    """Each row of a batch sails in another stretch of the realisation."""

    def _course(self, s, series):
        apart = 25 * self.value("gust_time_s")
        return super()._course(SimpleNamespace(time=s.time + apart * torch.ones_like(s.u).cumsum(-1)), series)


@pytest.fixture(scope="module")
def pond():
    """A model fitted to noisy runs in calm air; questions about runs in calm air and in a wind that gusts."""
    ship = esso_osaka_mmg()
    p, calm, hull = ship.particulars, CalmWater(ship), clarke_inertia_part(ship)
    sizes = {"u": 0.004, "v": 0.004, "r": 0.1 * DEGREE, "x": 0.01, "y": 0.01, "psi": 0.2 * DEGREE}

    def sail(trials, number, *effects, step=0.2):
        made = roll_out(Vessel(calm, list(effects)), trials, step=step, interval=step)
        return [noisy(record, number + k, (0.2 / step) ** 0.5) for k, record in enumerate(made)]

    def noisy(record, number, share):
        g = np.random.default_rng(number)
        channels = {k: record[k] + share * sd * g.standard_normal(len(record)) for k, sd in sizes.items()}
        return replace(record.with_channels(**channels), name=f"run {number}")

    learnt = [zigzag(20.0, duration=150.0), zigzag(30.0, duration=150.0), turning_circle(35.0, duration=200.0)]
    learnt.append(turning_circle(20.0, side="port", duration=200.0))
    asked = [turning_circle(25.0), turning_circle(25.0, side="port"), turning_circle(35.0, side="port")]
    terms = yaml.safe_load((CONF / "network" / "cubic.yaml").read_text())["network"]
    with unchecked():
        series = Series(SeriesSettings(terms["surge"], terms["lateral"], yaw=terms["yaw"]))
        # Half as many samples tell as much in all if their noise is that of the mean of two.
        model, _ = fit_series(series, hull, sail(learnt, 0, step=0.4))

    def question(*wind, duration: float) -> Question:
        with unchecked():
            records = sail([replace(m, duration=duration) for m in asked], 10, *wind, step=0.4)
        raw = [over_ground(record, p) for record in records]
        step = common_step(raw, p)
        made = [prepared(run, step, p, "turning_circle") for run in raw]
        case = Case("pond", hull.particulars.name, tuple(made), hull, 15.0, frozenset({made[2].name}))
        return Question(case, model, [e(hull) for e in CANDIDATES])

    return ship, question


@pytest.mark.slow
def test_in_calm_air_a_fitted_model_has_nothing_proved_against_it(pond):
    _, question = pond
    found = diagnose(replace(question(duration=120.0), caveat="the model is doubtful"))
    assert found.residuals[0].units == ("N", "N", "N m") and 0 < np.abs(found.residuals[0].force[:, 1]).max() < 10
    assert (found.verdict, found.model) == ("none", []) and found.sentence.startswith("Nothing is proved")
    assert not found.checks[0].passed and found.sentence.endswith(" But the model is doubtful.")


@pytest.mark.slow
def test_several_runs_that_were_not_used_are_drawn_with_a_fitted_model_as_they_are_one_by_one(pond):
    _, question = pond
    runs = question(duration=60.0).case.runs
    data_set = whitened_data_set(question(duration=60.0).dynamics, runs[:1])
    offset = RudderOffset(data_set.dynamics.hull, offset_deg=1.0)
    known = known_of(
        data_set, MarginalLikelihood(data_set).evaluate(Hypothesis((offset,), (offset.values.numpy()[None],)))
    )
    there = Hypothesis((offset,), (np.tile(offset.values.numpy(), (2, 1)),))
    together = drawn_tables(known, there, runs[1:], 15.0)
    assert [len(tables) for tables in together] == [101, 101]
    for k, (mine, *_) in enumerate(together):
        ((alone, *_),) = drawn_tables(known, there.of_runs([k]), runs[1 + k : 2 + k], 15.0)
        assert mine["psi"].to_numpy() == approx(alone["psi"].to_numpy(), abs=1e-9)


@pytest.mark.slow  # a quarter of a minute; gusts on a pond that was measured are named in tests/test_notebooks.py
def test_a_wind_that_gusts_by_more_than_half_its_mean_is_named_with_its_size(pond):
    ship, question = pond
    true = {"speed": 1.5, "from_deg": 120.0, "gust_sd": 0.9}
    found = diagnose(question(GustsOfTheirOwn(ship, **true, gust_time_s=8.0, gust_across=1.0), duration=200.0))
    assert found.model == ["wind_gusty"]
    for value in found.causes[0].parameters:
        assert abs(value.value - true[value.name]) < 3 * value.error < 0.6 * true[value.name]
