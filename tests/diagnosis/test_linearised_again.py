"""Runs linearised again: about states at rest, about what leads, about corrected coefficients in any combinations."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from fleet import ship_named, unchecked
from pytest import approx
from searches import fitted as fitted_by_hand
from test_hypotheses_judged import LEVEL, NONE, fitted, hypothesis, stand
from tiers import mainly
from trials import CALM, CIRCLE, NOISE, PORT, SHIP, TIMED, ZIGZAG, about, run_of, runs, sailed, states_of, values

from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.diagnosis import fits, settled
from manoeuvre_nn.diagnosis.case import Case, Question
from manoeuvre_nn.diagnosis.fits import at_rest
from manoeuvre_nn.diagnosis.proof import in_held_out_runs
from manoeuvre_nn.diagnosis.search import search
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.effect.depth import ShallowWater
from manoeuvre_nn.effect.loading import DisplacementChange
from manoeuvre_nn.effect.local import SideForce
from manoeuvre_nn.effect.propulsion import HullFouling, PropellerPitchError
from manoeuvre_nn.effect.rudder import RudderAreaLoss, RudderDelay, RudderOffset
from manoeuvre_nn.effect.sensors import HeadingBias, LeverArm, LogScale, RateBias
from manoeuvre_nn.effect.wind import SteadyWind
from manoeuvre_nn.estimation import noise_average, relinearise
from manoeuvre_nn.estimation.corrections import Calibrated, CoefficientPrior, Corrections
from manoeuvre_nn.estimation.data_set import COEFFICIENT_SD_LEVELS, WhitenedDataSet, whitened_data_set
from manoeuvre_nn.estimation.effect_columns import beside_it, contribution, with_feedback
from manoeuvre_nn.estimation.hypothesis import Hypothesis
from manoeuvre_nn.estimation.linearised_run import shown
from manoeuvre_nn.estimation.marginal_likelihood import MarginalLikelihood
from manoeuvre_nn.estimation.model_corrections import USUAL_SCATTER
from manoeuvre_nn.estimation.prepared_run import about_states, base_columns
from manoeuvre_nn.estimation.relinearise import MAX_CORRECTION, STATES_AT_REST, beside, change_of_states, refined
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.ship.esso_190k import esso_190k

pytestmark = pytest.mark.usefixtures("unchecked_types")
NOTHING = fitted_by_hand(0.0)


@pytest.mark.parametrize(
    "changes, corrected, published, rests, scatter, kept",
    [
        ((6.0, 2.0, 3.0), -9.0, 20.0, True, 0, "published"),
        ((3.0, 2.0, 6.0), -9.0, 20.0, True, 0, "published"),
        ((3.0, 2.0, 1.0), -9.0, 20.0, True, 0, "corrected"),  # they come nearer to rest
        ((3.0, 2.0, 6.0), -9.0, -10.0, True, 0, "corrected"),  # the others rest, but explain less still
        ((3.0, 2.0, 6.0), -9.0, 20.0, False, 0, "corrected"),  # neither rest
        ((3.0, 2.0, 6.0), 1.0, 20.0, True, 0, "corrected"),  # what gains is on its way
        ((3.0, 2.0, 1.0), 1.0, 20.0, True, 5, "published"),  # but by coefficients of another ship
        ((3.0, 2.0, 1.0), 1.0, 20.0, True, 4, "corrected"),
        ((3.0, 2.0, 1.0), 1.0, 0.0, True, 5, "corrected"),
        ((3.0, 0.1), 1.0, 20.0, True, 5, "corrected"),  # they rest
    ],
)
def test_where_corrected_coefficients_drive_states_away_those_of_published_ones_are_sought(
    monkeypatch, changes, corrected, published, rests, scatter, kept
):
    evidence, passes = {"corrected": corrected, "published": published}, []
    assert COEFFICIENT_SD_LEVELS[5] > 2 * USUAL_SCATTER > COEFFICIENT_SD_LEVELS[4]

    def moved(data_set, j, is_corrected):
        passes.append("corrected" if is_corrected else "published")
        return SimpleNamespace(by=passes[-1])

    def change(before, after, level):
        if "published" in passes:
            return 0.1 if rests and passes.count("published") > 1 else 7.0
        return changes[len(passes) - 1]

    monkeypatch.setattr(fits, "MarginalLikelihood", lambda data_set: SimpleNamespace(data_set=data_set))
    monkeypatch.setattr(fits, "beside", lambda likelihood, h: likelihood)
    monkeypatch.setattr(fits, "refined", moved)
    monkeypatch.setattr(fits, "change_of_states", change)

    def fit(there, h, *at):
        return replace(NOTHING, evidence=evidence[there.data_set.by], best=(0, scatter))

    there, found = at_rest(SimpleNamespace(by="start"), NOTHING, fit)
    assert (there.by, found.evidence) == (kept, evidence[kept])


@pytest.mark.parametrize("changes, passes", [
    ((9.0, 8.0, 7.0, 6.0, 5.0, 4.0, 3.5, 3.2, 3.1), 8),
    ((9.0, 8.0, 4.0, 2.9, 2.8), 4),
    ((9.0, 8.0, 8.5, 4.0), 3),  # not nearer than before
    ((9.0, 2.0, 1.0, 0.9), 3),
    ((9.0, 0.1), 2),
])  # fmt: skip
def test_states_far_from_rest_are_followed_as_long_as_they_come_nearer(monkeypatch, changes, passes):
    asked = []
    monkeypatch.setattr(fits, "MarginalLikelihood", lambda data_set: SimpleNamespace(data_set=data_set))
    monkeypatch.setattr(fits, "beside", lambda likelihood, h: likelihood)
    monkeypatch.setattr(fits, "refined", lambda data_set, j, is_corrected: data_set)
    monkeypatch.setattr(fits, "change_of_states", lambda *_: asked.append(1) or changes[len(asked) - 1])
    at_rest(SimpleNamespace(), NOTHING, lambda *_: NOTHING)
    assert len(asked) == passes


def test_events_are_placed_about_the_first_new_states_alone(monkeypatch):
    changes, asked = iter([9.0, 3.0, 0.1]), []
    monkeypatch.setattr(fits, "MarginalLikelihood", lambda data_set: SimpleNamespace(data_set=data_set))
    monkeypatch.setattr(fits, "beside", lambda likelihood, h: likelihood)
    monkeypatch.setattr(fits, "refined", lambda data_set, j, is_corrected: data_set)
    monkeypatch.setattr(fits, "change_of_states", lambda *_: next(changes))
    monkeypatch.setattr(fits, "refine", lambda *_, placing, fine: asked.append((placing, fine)) or NOTHING)
    at_rest(SimpleNamespace(), NOTHING)
    assert asked == [(True, False), (False, False), (False, True)], "every level of the noise where states rest"


def test_a_late_receiver_is_late_with_what_its_antenna_shows():
    """The antenna's own way in a turn belongs to a delay: x = x0 + a cos psi, vn = vn0 - a r sin psi."""
    arm = LeverArm(SHIP, dx_m=40.0)
    data_set = whitened_data_set(CALM, runs([CIRCLE], [arm]))
    held = Hypothesis((arm,), (values(arm),), fixed=frozenset({"dx_m", "dy_m"}))
    found = MarginalLikelihood(data_set).evaluate(held)
    there = refined(data_set, found)
    late, finer = there.runs[0], noise_average.with_time(there, 30.0).runs[0]
    track, step = late.linearised.track, late.linearised.run.step
    r, psi, path = track[:, 2], track[:, 5], shown(track)
    for channel, of_antenna in ((0, 40 * np.cos(psi)), (2, -40 * r * np.sin(psi))):
        expected = -np.gradient(path[:, channel] + of_antenna, step)
        without = -np.gradient(path[:, channel], step)
        for base in (late.base, finer.base):
            assert base.measured[:, channel, -1] == approx(expected, abs=0.4 * abs(expected - without).max())


def test_linearised_until_it_rests_another_linearisation_changes_little():
    """From a wind taken for half as strong, whose states are its own only after the first pass."""
    stood = stand("wind")
    likelihood = MarginalLikelihood(stood)
    far = fitted(likelihood, hypothesis(SteadyWind(SHIP, speed=5.0, from_deg=80.0)), 4)
    there, found = at_rest(stood, far)
    first, again = refined(stood, far), refined(there, found)
    assert change_of_states(stood, first, far.best[0]) > change_of_states(there, again, found.best[0])
    assert change_of_states(there, again, found.best[0]) < STATES_AT_REST
    once_more = MarginalLikelihood(again).evaluate(found.hypothesis, around=found.best[0])
    assert once_more.evidence == approx(found.evidence, abs=0.3)
    kept = [k for k, f in enumerate(found.hypothesis.unknowns()) if not f.parameter.form]
    found_at, true = found.hypothesis.vector()[kept], np.array([10.0, 60.0])
    assert (np.abs(found_at - true) < 3.5 * found.errors[kept] + 0.01 * true).all()


def test_a_part_of_several_effects_is_fitted_about_the_states_of_all_of_them():
    """An offset of the rudder of 12 deg beside a wind that is not there: about the states of both it is as likely."""
    trial = [RudderOffset(SHIP, offset_deg=12.0)]
    data_set = whitened_data_set(CALM, runs([CIRCLE, ZIGZAG], trial))
    offset, wind = RudderOffset(SHIP, offset_deg=11.0), SteadyWind(SHIP, speed=1.0, from_deg=80.0)
    likelihood = MarginalLikelihood(data_set)
    one, both = (fits.refine(likelihood, hypothesis(*some), 4, 2) for some in ((offset,), (wind, offset)))
    found, (part,) = settled._rested(data_set, both, [one], None)
    there, again = at_rest(data_set, both)
    assert found.evidence == approx(again.evidence) and found.names == both.names
    beside_it = fits.refine(MarginalLikelihood(there), one.hypothesis, *one.best)
    assert part.evidence == approx(beside_it.evidence) and part.names == one.names
    assert abs(part.evidence - one.evidence) > 1.0, "or any states would do"
    assert part.evidence > found.evidence - 3.0


@pytest.mark.parametrize("acting", mainly(1, ["wind", "nothing"]))
def test_all_hypotheses_are_weighed_about_the_states_of_what_leads(acting):
    """Of calm water where no effect gains much: about the first, rough states small effects gain by chance."""
    stood = stand(acting)
    found = search(stood, [SteadyWind(SHIP), RudderOffset(SHIP)])
    leads = found.none if acting == "nothing" else found.fitted[0]
    there = found.likelihood.data_set
    assert leads.names == (() if acting == "nothing" else ("wind_steady",))
    # The prior of the coefficients was chosen there, after the states were at rest: with it they move once more.
    moved = change_of_states(stood, there, leads.best[0])
    assert change_of_states(there, refined(there, leads), leads.best[0]) < 0.05 * moved > 1.0  # standard errors


@cache
def weak_rudder_off() -> tuple[Recording, ...]:
    """A circle and a zigzag of a ship with a rudder 12 % weaker than published that stands 5 deg off."""
    shares = torch.tensor([-0.12 * (name in ("Yd", "Nd")) for name in Corrections(CALM).names], dtype=torch.float64)
    offset = RudderOffset(SHIP, offset_deg=5.0)
    with unchecked():
        records = roll_out(Vessel(Calibrated(CALM, shares), [offset]), [CIRCLE, ZIGZAG], step=1.0)
    return tuple(run_of(r, NOISE, seed) for seed, r in enumerate(records))


def test_held_out_runs_judge_an_effect_about_its_own_states_and_on_the_corrected_ship():
    """About the first, rough states and published coefficients 4.4 deg explain more than the true 5."""
    runs = weak_rudder_off()
    asked = Question(Case("trial", "mariner", runs, SHIP, 40.0, frozenset(r.name for r in runs)), CALM, ())
    true, less = (
        asked.held_out.evaluate(
            replace(hypothesis(RudderOffset(SHIP, offset_deg=angle)), fixed=frozenset({"offset_deg"}))
        )
        for angle in (5.0, 4.4)
    )
    assert true.evidence < less.evidence
    assert in_held_out_runs(asked, true).evidence > in_held_out_runs(asked, less).evidence + 10


def test_a_hypothesis_that_would_need_another_ship_is_linearised_about_its_states_and_the_published_one():
    """Calm water for a log that shows three times the speed: no coefficients make a track of it."""
    stood = whitened_data_set(CALM, runs([CIRCLE, PORT], [LogScale(SHIP, factor=3.0)]))
    calm = MarginalLikelihood(stood).evaluate(NONE)
    assert np.abs(calm.corrections).max() > MAX_CORRECTION
    there = refined(stood, calm)
    assert all(p.linearised.rate.dynamics is CALM for p in there.runs)
    assert change_of_states(stood, there, calm.best[0]) > STATES_AT_REST


def test_states_may_be_sought_by_published_coefficients_too():
    stood = whitened_data_set(CALM, runs([CIRCLE, PORT], [RateBias(SHIP, bias_deg_s=0.02)]))
    calm = MarginalLikelihood(stood).evaluate(NONE)
    for corrected in (True, False):
        there = refined(stood, calm, corrected)
        assert all((p.linearised.rate.dynamics is CALM) is not corrected for p in there.runs)


def test_states_of_a_ship_that_lies_still_are_not_taken(monkeypatch):
    """At no speed a tanker's equations, which divide by it, follow no rudder: nothing can be linearised about that."""
    tanker, about_states = CalmWater(ship_named("esso_190k")), relinearise.about_states
    (sailing,) = roll_out(Vessel(tanker), [replace(ZIGZAG, speed=tanker.particulars.speed)], step=1.0)
    stood = whitened_data_set(tanker, [run_of(sailing, NOISE)])
    calm = MarginalLikelihood(stood).evaluate(NONE)
    assert refined(stood, calm).runs[0].linearised is not stood.runs[0].linearised
    at_rest_there = np.array([1e-3, 1.0, 1.0, 1.0, 1.0, 1.0])
    monkeypatch.setattr(
        relinearise,
        "about_states",
        lambda model, run, track, *more: about_states(model, run, at_rest_there * track, *more),
    )
    assert refined(stood, calm).runs[0].linearised is stood.runs[0].linearised


@pytest.mark.slow
def test_of_two_large_effects_both_are_found_although_calm_water_is_far_off():
    """A rudder without most of its area and a propeller with little thrust, beside two instruments that might err."""
    acting = [RudderAreaLoss(SHIP, fraction=0.8), PropellerPitchError(SHIP, fraction=0.6)]
    data_set = whitened_data_set(CALM, runs([CIRCLE, ZIGZAG], acting))
    others = [LeverArm(SHIP), HeadingBias(SHIP)]
    found = search(data_set, [RudderAreaLoss(SHIP), PropellerPitchError(SHIP), *others]).fitted[0]
    assert set(found.names) == {"rudder_area_loss", "propeller_pitch_error"}
    assert sorted(found.hypothesis.vector()) == approx([0.6, 0.8], abs=0.05)


def test_an_effect_acts_on_the_ship_as_her_corrected_coefficients_say():
    """Of a weak rudder that stands off, angle and strength are told apart."""
    found = search(whitened_data_set(CALM, weak_rudder_off()), [RudderOffset(SHIP)]).fitted[0]
    assert found.hypothesis.vector()[0] == approx(5.0, abs=0.1)
    assert abs(found.hypothesis.vector()[0] - 5.0) < 3 * found.errors[0] < 0.3


@pytest.mark.slow
def test_a_rudder_recorded_so_late_that_movements_do_not_overlap_is_found():
    late = runs([CIRCLE, PORT], [RudderDelay(SHIP, delay_s=44.0)])
    found = search(whitened_data_set(CALM, late), [RudderDelay(SHIP)]).fitted[0]
    assert found.hypothesis.vector()[0] == approx(44.0, abs=1.0)


@pytest.mark.slow
def test_corrections_of_a_rudder_that_is_recorded_late_act_when_it_is_laid():
    """Of a rudder 12 % weaker than published and recorded 25 s late, strength and delay are found."""
    shares = np.array([-0.12 * (name in ("Yd", "Nd")) for name in Corrections(CALM).names])
    weak = Vessel(Calibrated(CALM, torch.tensor(shares)), [RudderDelay(SHIP, delay_s=25.0)])
    with unchecked():
        records = roll_out(weak, [CIRCLE, ZIGZAG], step=1.0)
    stood = whitened_data_set(CALM, [run_of(r, NOISE, seed) for seed, r in enumerate(records)])
    there, late = at_rest(stood, fitted(MarginalLikelihood(stood), hypothesis(RudderDelay(SHIP, delay_s=22.0))))
    assert late.hypothesis.vector()[0] == approx(25.0, abs=4 * late.errors[0] + 0.05)
    turning = [Corrections(CALM).names.index("Nd")]
    assert late.corrections[turning] == approx(shares[turning], abs=0.04)
    assert beside(MarginalLikelihood(there), NONE).data_set is not there, "calm water has the rudder as it was recorded"
    assert beside(MarginalLikelihood(stood), NONE).data_set is stood


def test_corrections_are_those_of_the_ship_in_whatever_combinations_they_were_found():
    """Fitted to runs combined in one way, a hypothesis may be linearised again about runs combined in another."""
    stood = stand("thrust")
    found = MarginalLikelihood(stood).evaluate(NONE, around=LEVEL)
    whole = [replace(p, base=base_columns(CALM, p.linearised)) for p in stood.runs]
    other = WhitenedDataSet(CALM, whole, CoefficientPrior(0.9, 3.0))
    assert other.combinations != stood.combinations
    assert change_of_states(refined(stood, found), refined(other, found), LEVEL) < 3.0  # standard errors


PUSHED = SideForce(SHIP, force_kN=5.0, lever_m=40.0, start_s=0.0, end_s=500.0)


@pytest.mark.parametrize(
    "effect, calm_is_off",  # the component of u, v, r, x, y, psi that calm water's transitions carry on worst
    [
        (ShallowWater(SHIP, depth_m=14.0), 0.4),
        (DisplacementChange(SHIP, factor=1.6), 0.6),
        (SteadyWind(SHIP, speed=25.0, from_deg=60.0), 0.9),
        (HullFouling(SHIP, added_resistance=1.0), 0.07),
        (RudderOffset(SHIP, offset_deg=8.0), 0.15),
    ],
    ids=lambda value: getattr(value, "name", ""),
)
def test_a_small_push_is_carried_on_as_it_is_with_the_effect_aboard(effect, calm_is_off):
    """A second route: the difference of two simulations with the effect, one of them with the push, over 80 s."""
    both = [effect, PUSHED]
    (alone,), (other,) = sailed([TIMED], [effect]), sailed([TIMED], both)
    happened = states_of(other) - states_of(alone)
    calm = about(run_of(alone), states_of(alone))
    line = with_feedback(calm, [effect], [effect.values.numpy()])

    def worst(line) -> float:
        beside = beside_it(both, [e.values.numpy() for e in both], 1, line)
        moved, off = contribution(PUSHED, values(PUSHED), line, beside=beside).moved[..., 0], np.zeros((len(alone), 9))
        for k, push in enumerate(moved):
            off[k + 1] = line.transition[k] @ off[k] + np.append(push, np.zeros(3))
        return float((np.abs(off[:, :6] - happened).max(axis=0) / np.abs(happened).max(axis=0)).max())

    assert worst(line) < 0.04 and worst(calm) > calm_is_off
    assert np.array_equal(line.defect, calm.defect)


def test_what_sensors_show_wrongly_changes_no_transition():
    """Nor does a late record of the rudder: derivatives in calm water are taken behind it already."""
    line = about(run_of(sailed([TIMED])[0]), states_of(sailed([TIMED])[0]))
    assert with_feedback(line, [RudderDelay(SHIP, delay_s=9.0)], [np.array([9.0])]) is line
    assert with_feedback(line, [HeadingBias(SHIP, bias_deg=3.0)], [np.array([3.0])]) is line
    assert with_feedback(line, [], []) is line


def test_the_evidence_of_an_effect_is_that_of_a_ship_which_has_it_in_her_equations():
    """The tanker's own terms in zeta, as an effect on her in deep water and as the ship in shallow water."""
    depth, step = 1.3 * ship_named("esso_190k").particulars.draught, 2.0
    deep, shallow = CalmWater(esso_190k()), CalmWater(esso_190k(depth=depth))
    (record,) = roll_out(Vessel(shallow, []), [zigzag(20.0, duration=400.0)], step=step, interval=step)
    there = whitened_data_set(shallow, [run_of(record, NOISE / step**0.5)])
    level = there.levels.point(1, 1)
    expected = MarginalLikelihood(there).evaluate(Hypothesis((), ()), around=level).by_level[level]
    bottom = ShallowWater(deep.hull, depth_m=depth)
    known = Hypothesis((bottom,), (values(bottom),), fixed=frozenset(p.name for p in bottom.declared))

    def evidence(*effects) -> np.ndarray:
        acting = effects, [e.values.numpy() for e in effects]
        about_it = [about_states(deep, p, p.linearised.track, acting=acting) for p in there.runs]
        data_set = WhitenedDataSet(deep, about_it, there.coefficient_prior)
        return MarginalLikelihood(data_set).evaluate(known, around=level).by_level[level]

    # By scatter 1.5 to 5 %: errors of the terms in zeta are no corrections of the ship in deep water.
    assert np.abs(evidence(bottom) - expected)[1:4].max() < 3.0
    assert (evidence() < expected - 8.0)[1:4].all()
