"""Events that happen in some runs only, twice, or over minutes: their times, errors, and place in runs to predict."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import torch
from fleet import ship_named
from pytest import approx
from searches import fitted as by_hand
from strangers import strange_runs
from tiers import mainly
from trials import CALM, NOISE, SHIP, run_of, runs, unchecked

from manoeuvre_nn.core.channels import MEASURED
from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.core.manoeuvre import Manoeuvre
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.diagnosis import fits
from manoeuvre_nn.diagnosis.case import Case, Question
from manoeuvre_nn.diagnosis.causes import _when
from manoeuvre_nn.diagnosis.fits import single
from manoeuvre_nn.diagnosis.forecast import unplaced_events
from manoeuvre_nn.diagnosis.proof import in_held_out_runs
from manoeuvre_nn.diagnosis.search import _with_other_forms, search
from manoeuvre_nn.diagnosis.windows import replaced, times_of
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.effect.common import during
from manoeuvre_nn.effect.current import Current
from manoeuvre_nn.effect.depth import ShallowWater
from manoeuvre_nn.effect.local import BowThruster, SideForce
from manoeuvre_nn.effect.propulsion import ThrustLoss
from manoeuvre_nn.effect.sensors import LogScale, RateBias
from manoeuvre_nn.effect.wind import WindOnset
from manoeuvre_nn.estimation.corrections import Calibrated, Corrections
from manoeuvre_nn.estimation.data_set import whitened_data_set
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis, Hypothesis
from manoeuvre_nn.estimation.marginal_likelihood import MarginalLikelihood
from manoeuvre_nn.estimation.process_noise import PROCESS_LEVELS
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.recording.preparation import without_samples

pytestmark = pytest.mark.usefixtures("unchecked_types")
TIME = 420.0
TRIALS = [zigzag(20.0, duration=TIME), turning_circle(15.0, duration=TIME)]
TRIALS += [turning_circle(25.0, side="port", duration=TIME), zigzag(10.0, duration=TIME)]
WIND = {"speed": 13.0, "from_deg": 110.0}
STEP = 2.0
"""Between samples [s]; their noise is such that they tell as much in all as at one every second."""
SCATTER = 0.03
"""Relative error of the coefficients."""


def push(**times: float) -> SideForce:
    return SideForce(SHIP, force_kN=150.0, lever_m=30.0, ramp_s=4.0, **times)


def thrust(**times: float) -> BowThruster:
    return BowThruster(SHIP, force_kN=-110.0, ramp_s=4.0, **times)


def wind(start: float, ramp: float = 4.0) -> WindOnset:
    return WindOnset(SHIP, **WIND, start_s=start, ramp_s=ramp)


def campaign(
    acting: Sequence[Effect | None], seed: int = 0, trials: Sequence[Manoeuvre] = TRIALS, step: float = STEP
) -> list[Recording]:
    """A run a trial, each with an effect of its own or none, of a ship whose coefficients are off."""
    shares = SCATTER * np.random.default_rng(seed).standard_normal(len(Corrections(CALM).names))
    shares[len(Corrections(CALM).of_model.names) :] = 0.0
    truth, made = Calibrated(CALM, torch.tensor(shares)), []
    with unchecked():
        for k, (trial, effect) in enumerate(zip(trials, acting, strict=False)):
            (record,) = roll_out(Vessel(truth, [effect] if effect else []), [trial], step=step, interval=step)
            made.append(run_of(record, NOISE / step**0.5, 10 * seed + k))
    return made


def fitted(effect: Effect, runs: Sequence[Recording]) -> tuple[MarginalLikelihood, FittedHypothesis, FittedHypothesis]:
    with unchecked():
        likelihood = MarginalLikelihood(whitened_data_set(CALM, runs))
        none = likelihood.evaluate(Hypothesis((), ()))
        return likelihood, none, single(likelihood, effect, none)


def times(found: FittedHypothesis) -> list[tuple[tuple[float, float], ...]]:
    """When the first effect acts in every run."""
    return [times_of(found.hypothesis.effects[0], values) for values in found.hypothesis.values[0]]


def value(found: FittedHypothesis, name: str) -> float:
    declared = [p.name for p in found.hypothesis.effects[0].declared]
    return float(found.hypothesis.values[0][0, declared.index(name)])


def edges(found: Hypothesis | FittedHypothesis, effect: int = 0) -> list[tuple[int, float, float]]:
    """Run, time and standard error of every time of an event."""
    h, errors = found.hypothesis, found.errors
    free = zip(h.unknowns(), h.vector(), errors, strict=True)
    return [(f.runs[0], v, e) for f, v, e in free if f.parameter.per_run and f.effect == effect]


@cache
def one_of_three() -> tuple[MarginalLikelihood, FittedHypothesis, FittedHypothesis]:
    return fitted(SideForce(SHIP), campaign([None, push(start_s=150.0, end_s=290.0), None]))


@pytest.mark.slow
def test_an_engine_that_slows_down_is_likelier_than_a_wind_or_a_side_force():
    """In one run it comes back, in one it does not; in two of four it never happens."""
    back, lasting = (
        ThrustLoss(SHIP, rpm_loss=0.2, ramp_s=4.0, **at)
        for at in ({"start_s": 120.0, "end_s": 280.0}, {"start_s": 200.0})
    )
    runs = campaign([back, None, lasting, None])
    likelihood, none, slowed = fitted(ThrustLoss(SHIP), runs)
    for other in (WindOnset(SHIP), SideForce(SHIP)):
        with unchecked():
            assert slowed.evidence > max(single(likelihood, other, none).evidence, none.evidence) + 20
    (first, _, third, _) = times(slowed)
    assert first[0] == approx((120.0, 280.0), abs=12.0) and third[0] == approx((200.0, np.inf), abs=12.0)
    assert times(slowed)[1] == times(slowed)[3] == ()
    assert value(slowed, "rpm_loss") == approx(0.2, abs=0.03)


@pytest.mark.slow
def test_an_event_is_judged_in_each_form_at_the_same_times():
    """A force forward of midship, whose own fit stopped at other times than a thruster's, is fitted from that one's."""
    runs = campaign([None, SideForce(SHIP, force_kN=150.0, lever_m=40.0, start_s=150.0, end_s=290.0), None])
    likelihood, _, thruster = fitted(BowThruster(SHIP), runs)
    late = thruster.hypothesis.values[0].copy()
    late[1, 1:3] = 60.0, 100.0  # start, end
    astray = Hypothesis((SideForce(SHIP),), (np.insert(late[:, :-1], 1, 0.0, axis=1),))
    stopped = likelihood.evaluate(astray)
    with unchecked():
        best, *rest = _with_other_forms(likelihood, [stopped, thruster], [SideForce(SHIP), BowThruster(SHIP)])
    assert [j.names for j in rest] == [("bow_thruster",)]
    assert best.names == ("side_force",) and best.evidence > max(stopped.evidence, thruster.evidence) + 5
    assert value(best, "lever_m") == approx(40.0, abs=10.0)
    assert times(best)[1][0] == approx((150.0, 290.0), abs=10.0)


@pytest.mark.slow
def test_an_event_is_exchanged_for_another_of_the_same_times_but_for_none_that_is_already_there_in_another_form():
    runs = campaign([None, push(start_s=150.0, end_s=290.0), None])
    likelihood, _, blown = fitted(WindOnset(SHIP), runs)
    late = np.tile(SideForce(SHIP).null().numpy(), (len(runs), 1))
    late[1, 2:4] = 60.0, 100.0  # start, end
    both = Hypothesis((*blown.hypothesis.effects, SideForce(SHIP)), (*blown.hypothesis.values, late))
    acting = [WindOnset(SHIP), SideForce(SHIP), BowThruster(SHIP)]
    with unchecked():
        best = _with_other_forms(likelihood, [blown], acting)[0]
        beside = _with_other_forms(likelihood, [likelihood.evaluate(both)], acting)
    assert best.names == ("side_force",) and best.evidence > blown.evidence + 5
    assert times(best)[1][0] == approx((150.0, 290.0), abs=10.0)
    names = [set(j.names) for j in beside]
    assert {"wind_onset", "bow_thruster"} in names and {"bow_thruster", "side_force"} not in names


def test_an_event_whose_other_times_went_to_a_second_one_gets_them_back_when_it_is_judged_alone():
    twice = campaign([push(start_s=90.0, end_s=200.0, start_2_s=270.0, end_2_s=380.0), None])
    likelihood, _, found = fitted(SideForce(SHIP), twice)
    names = [p.name for p in found.hypothesis.effects[0].declared]
    once = found.hypothesis.values[0].copy()
    once[:, [names.index("start_2_s"), names.index("end_2_s")]] = np.inf
    with unchecked():
        alone = likelihood.evaluate(replace(found.hypothesis, values=(once,)))
        breeze = np.tile(WindOnset(SHIP, **WIND, start_s=270.0, end_s=380.0).values.numpy(), (2, 1))
        pair = likelihood.evaluate(Hypothesis((SideForce(SHIP), WindOnset(SHIP)), (once, breeze)))
        judged = {j.names: j for j in _with_other_forms(likelihood, [pair, alone], [])}
    assert judged["side_force",].evidence > alone.evidence + 20
    assert max(judged.values(), key=lambda j: j.evidence).names != pair.names


def test_what_leads_is_judged_beside_the_same_without_each_of_its_effects():
    """A third effect that adds nothing is only seen if the two others were fitted together, and as well as with it."""
    acting = [Current(SHIP, speed=0.6, toward_deg=200.0), RateBias(SHIP, bias_deg_s=0.06), LogScale(SHIP)]
    with unchecked():
        likelihood = MarginalLikelihood(whitened_data_set(CALM, runs(TRIALS[:2], acting[:2])))
        three = likelihood.evaluate(
            Hypothesis(tuple(acting), tuple(e.values.numpy()[None].repeat(2, 0) for e in acting))
        )
        badly = replace(likelihood.evaluate(three.hypothesis.without(2)), evidence=three.evidence - 20)
        found = {j.names: j.evidence for j in _with_other_forms(likelihood, [three, badly], acting)}
    assert set(found) == {three.names, *(three.hypothesis.without(k).names for k in range(3))}
    assert found["current", "rate_bias"] == max(found.values())


def test_a_force_that_acts_in_one_run_of_three_is_not_placed_in_the_others():
    _, none, found = one_of_three()
    first, (there,), last = times(found)
    assert (first, last) == ((), ()) and there == approx((150.0, 290.0), abs=5.0)
    assert value(found, "force_kN") == approx(150.0, rel=0.1) and value(found, "lever_m") == approx(30.0, abs=6.0)
    assert found.evidence > none.evidence + 50


@pytest.mark.slow
def test_a_thruster_that_is_used_twice_in_a_run_has_two_intervals_there_and_one_force():
    twice = thrust(start_s=90.0, end_s=170.0, start_2_s=300.0, end_2_s=380.0)
    _, _, found = fitted(BowThruster(SHIP), campaign([twice, thrust(start_s=150.0, end_s=290.0)]))
    (a, b), (only,) = times(found)
    assert [*a, *b] == approx([90.0, 170.0, 300.0, 380.0], abs=6.0) and only == approx((150.0, 290.0), abs=6.0)
    assert value(found, "force_kN") == approx(-110.0, rel=0.08)


@cache
def slow_wind() -> tuple[MarginalLikelihood, FittedHypothesis, FittedHypothesis]:
    """A wind that is half there after 210 and 180 s, and sets in over three minutes."""
    return fitted(WindOnset(SHIP), campaign([wind(210.0, 180.0), wind(180.0, 180.0)]))


@pytest.mark.slow
def test_a_wind_that_sets_in_over_three_minutes_is_found_with_its_ramp():
    _, none, found = slow_wind()
    assert found.evidence > none.evidence + 50
    assert value(found, "ramp_s") == approx(180.0, abs=30.0)
    assert value(found, "speed") == approx(13.0, rel=0.12) and value(found, "from_deg") == approx(110.0, abs=5.0)
    assert [start for ((start, _),) in times(found)] == approx([210.0, 180.0], abs=12.0)


def test_intervals_of_a_clear_ramp_begin_where_it_begins_and_last_with_the_run():
    likelihood, _, found = slow_wind()
    runs = [p.linearised.run for p in likelihood.data_set.runs]
    spans = _when(Question(Case("trial", "mariner", tuple(runs), SHIP, 40.0), CALM, []), found, 0, False)
    for run, true in zip(runs, (120.0, 90.0), strict=True):
        (((start, end), (error, of_end)),) = spans[run.name]
        assert abs(start - true) < 3 * error < 60.0 and end == run.time[-1] and np.isnan(of_end)


@pytest.mark.slow
def test_a_step_is_no_ramp_and_its_times_are_within_their_errors():
    """Over two seeds and all edges: off by as many standard errors as chance has it."""
    z, ramps = [], []
    for seed in range(2):
        _, _, found = fitted(
            SideForce(SHIP), campaign([push(start_s=100.0, end_s=200.0), push(start_s=150.0, end_s=290.0)], seed)
        )
        z += [(v - true) / e for (_, v, e), true in zip(edges(found), (100.0, 150.0, 200.0, 290.0), strict=True)]
        ramps.append(value(found, "ramp_s"))
    assert 0.3 < np.sqrt(np.mean(np.square(z))) < 1.7 and np.abs(z).max() < 3.5
    assert np.median(ramps) < 20.0


def question(runs: Sequence[Recording], held_out: Sequence[str], effects: Sequence[Effect]) -> Question:
    return Question(Case("trial", "mariner", tuple(runs), SHIP, 40.0, frozenset(held_out)), CALM, effects)


@pytest.mark.parametrize("kind", mainly(1, ["push", "wind"]))
def test_in_runs_to_predict_an_event_is_placed_by_their_recordings_or_left_out(kind):
    if kind == "wind":
        (_, _, found), half_of_ramp = slow_wind(), 90.0
        acting, true = [wind(250.0, 180.0), None], (250.0, np.inf)
    else:
        (_, _, found), half_of_ramp = one_of_three(), 0.0
        acting, true = [push(start_s=240.0, end_s=330.0), None], (240.0, 330.0)
    runs = campaign(acting, 1, TRIALS[2:])
    asked = question(runs, [r.name for r in runs], found.hypothesis.effects)
    calm, elsewhere = (in_held_out_runs(asked, j) for j in (replace(found, hypothesis=Hypothesis((), ())), found))
    there, absent = (times_of(found.hypothesis.effects[0], values) for values in elsewhere.hypothesis.values[0])
    assert absent == () and len(there) == 1
    assert there[0] == approx(true, abs=15.0)
    assert elsewhere.evidence - calm.evidence > 20
    spans = _when(asked, found, 0, True)
    ((ends, errors),) = spans[runs[0].name]
    assert spans[runs[1].name] == [] and abs(ends[0] - true[0] + half_of_ramp) < 4 * errors[0] < 60


@pytest.mark.slow  # five seconds each
@pytest.mark.parametrize(
    "ship, force_kN, best",
    [
        ("esso_190k", 19_500.0, (PROCESS_LEVELS.point(0, 4), 5)),
        ("great_lakes_bulker", 900.0, (PROCESS_LEVELS.point(0, 7), 3)),
    ],
)
def test_beside_a_depth_too_an_event_is_placed_before_or_after_the_depths_formula_is_fitted(ship, force_kN, best):
    """Without its place, the tanker's shallow water gives way to the force; with it, that of the bulk carrier stays."""
    calm = CalmWater(ship_named(ship))
    bottom = ShallowWater(calm.hull, depth_m=(1.2 if ship == "esso_190k" else 1.25) * calm.particulars.draught)
    force = SideForce(calm.hull, force_kN=force_kN, lever_m=25.0, start_s=94.0, end_s=300.0, ramp_s=4.0)
    (record,) = roll_out(
        Vessel(calm, [bottom, force]), [turning_circle(20.0, duration=400.0)], step=STEP, interval=STEP
    )
    run = run_of(record, NOISE / STEP**0.5)
    asked = Question(Case("trial", ship, (run,), calm.hull, 40.0, frozenset({run.name})), calm, [])
    both = Hypothesis((force, bottom), tuple(e.values.numpy()[None] for e in (force, bottom)))
    there = in_held_out_runs(asked, replace(by_hand(0.0), hypothesis=both, best=best)).hypothesis
    assert times_of(force, there.values[0][0]) == (approx((94.0, 300.0), abs=2.0),)


def test_a_planned_run_is_predicted_without_the_event_and_that_is_said():
    """Also a run that says nothing, if it is looked at all the same, has no event."""
    likelihood, _, found = one_of_three()
    run = likelihood.data_set.runs[1].linearised.run
    silent = without_samples(run, np.broadcast_to(run.time[:, None] > 40.0, (len(run), len(MEASURED))))
    (said,) = unplaced_events(question([silent], [silent.name], []), found)
    assert said == f"When a side force acts in {silent.name} is not known beforehand: predicted without it."
    there = found.hypothesis.in_other_runs([0])
    assert times_of(there.effects[0], there.values[0][0]) == ()
    assert there.values[0][0, :2] == approx(found.hypothesis.values[0][0, :2])
    blind = MarginalLikelihood(whitened_data_set(CALM, [silent]))
    fixed = frozenset(p.name for p in there.effects[0].declared if not p.per_run)
    looked = replaced(blind, replace(there, fixed=fixed), *found.best)
    assert times_of(looked.effects[0], looked.values[0][0]) == ()


@pytest.mark.slow
def test_no_partner_is_added_that_mends_the_time_of_a_wind():
    runs = campaign([wind(160.0), wind(230.0)], seed=3, step=1.0)
    kinds = (WindOnset, Current, RateBias)
    with unchecked():
        result = search(whitened_data_set(CALM, runs), [kind(SHIP) for kind in kinds])
    best = next(j for j in result.fitted if j.names == ("wind_onset",))
    more = max(j.evidence for j in result.fitted if len(j.names) > 1)
    assert more < best.evidence + 6 and all(len(j.names) > 1 for j in result.fitted if j.evidence > best.evidence)
    assert [start for ((start, _),) in times(best)] == approx([160.0, 230.0], abs=8.0)


def test_a_gate_is_half_open_at_its_times_and_built_up_over_its_ramp():
    time = torch.arange(0.0, 400.0, dtype=torch.float64)
    effect = SideForce(SHIP, start_s=100.0, end_s=200.0, start_2_s=300.0, end_2_s=np.inf, ramp_s=40.0)
    share = during(effect, time)
    assert share[[60, 100, 140, 200, 250, 300, 399]].tolist() == approx([0, 0.5, 1, 0.5, 0, 0.5, 1], abs=0.01)
    assert share[110] == approx(0.75, abs=0.01)
    never = SideForce(SHIP, start_s=np.inf, end_s=np.inf)
    assert during(never, time).abs().max() == 0


def test_a_time_that_never_comes_is_no_unknown_and_further_intervals_cost_prior():
    effect = SideForce(SHIP)
    table = np.tile(effect.values.numpy(), (2, 1))
    timed = [j for j, p in enumerate(effect.declared) if p.per_run]
    table[1, timed] = np.inf
    one = Hypothesis((effect,), (table,))
    assert [(f.parameter.name, f.runs) for f in one.unknowns() if f.parameter.per_run] == [
        ("start_s", (0,)),
        ("end_s", (0,)),
    ]
    more = Hypothesis((effect,), (table.copy(),))
    more.values[0][0, timed[2:4]] = (300.0, 350.0)
    # 2 times: .5 * 2 / T^2; 4 times: .15 * 24 / T^4, the powers of T by the standard deviations.
    assert more.log_prior_of_times() - one.log_prior_of_times() == approx(np.log(0.15 * 24 / (0.5 * 2)))
    sds = dict(zip([(f.parameter.name, f.runs) for f in one.unknowns()], one.prior_sds([600.0, 900.0]), strict=True))
    assert sds["start_s", (0,)] == approx(600 / np.sqrt(2 * np.pi))


def test_times_that_the_data_do_not_say_are_no_evidence():
    """A force too small to be seen, anywhere in two runs: Laplace's Gaussian is as wide as the prior, not wider."""
    likelihood = MarginalLikelihood(whitened_data_set(CALM, campaign([None, None])))
    effect = SideForce(SHIP, force_kN=1e-4, start_s=150.0, end_s=290.0)
    nothing = likelihood.evaluate(Hypothesis((effect,), (np.tile(effect.values.numpy(), (2, 1)),)))
    assert nothing.evidence < likelihood.evaluate(Hypothesis((), ())).evidence + 0.5


@pytest.mark.slow  # a force of usual size is placed above
@pytest.mark.parametrize("force_kN", [-600.0, -2500.0])
def test_a_large_force_is_placed_in_all_runs_that_were_not_used(force_kN):
    """As long as one of two such runs lacks it, coefficients that are off by far explain both better than it does."""
    push = SideForce(SHIP, force_kN=force_kN, lever_m=60.0, start_s=150.0, end_s=300.0)
    records = strange_runs(6, push, step=STEP)
    case = Case("strange", "mariner", tuple(records), SHIP, 40.0, frozenset({r.name for r in records[1:]}))
    asked = Question(case, CALM, [SideForce(SHIP)])
    fitted = search(whitened_data_set(CALM, case.fitted), asked.effects).fitted[0]
    there = in_held_out_runs(asked, fitted).hypothesis
    assert [times_of(there.effects[0], values) for values in there.values[0]] == [
        (approx((150.0, 300.0), abs=2.0),)
    ] * 2


def test_an_event_that_was_given_times_has_an_error_for_each_of_them(monkeypatch):
    """Where its values were fitted is then where its times were found, not where it had none."""
    effect = SideForce(SHIP)
    nowhere = np.tile(effect.values.numpy(), (2, 1))
    timed = [p.per_run for p in effect.declared]
    nowhere[1, timed] = np.inf
    somewhere = nowhere.copy()
    somewhere[1] = somewhere[0]
    without, placed = (Hypothesis((effect,), (values,)) for values in (nowhere, somewhere))
    assert len(placed.unknowns()) > len(without.unknowns())

    class Anywhere:
        def improve(self, h, level, scatter, rounds=5):
            return h, 10.0 if h is without else 0.0

        def evaluate(self, h, around=None, fine=True):
            moved = h.with_vector(h.vector() + 1.0)
            return FittedHypothesis(moved, 5.0, np.zeros((1, 1)), np.eye(len(h.unknowns())))

    monkeypatch.setattr(fits, "beside", lambda likelihood, h: likelihood)
    monkeypatch.setattr(fits, "replaced", lambda likelihood, h, level, scatter: placed)
    found = fits.refine(Anywhere(), without, 0, 0)
    assert len(found.errors) == len(found.hypothesis.unknowns()) == len(placed.unknowns())
