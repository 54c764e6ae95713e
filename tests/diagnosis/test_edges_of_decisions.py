"""Decisions of claims and of the search a little off their edges: gusts on ponds, receivers, slack water."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from pytest import approx
from searches import fitted, found
from trials import SHIP, values

from manoeuvre_nn.diagnosis import checks, partners
from manoeuvre_nn.diagnosis import claims as proving
from manoeuvre_nn.diagnosis import decision as deciding
from manoeuvre_nn.diagnosis import search as searching
from manoeuvre_nn.diagnosis.decision import Decision
from manoeuvre_nn.diagnosis.gusts import refined_with_gusts
from manoeuvre_nn.diagnosis.unknown import ReceiverWander
from manoeuvre_nn.effect.current import Current, TidalCurrent
from manoeuvre_nn.effect.rudder import RudderBacklash
from manoeuvre_nn.effect.sensors import LeverArm
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis, Hypothesis

pytestmark = pytest.mark.usefixtures("unchecked_types")


# Claims about their own states ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("random, on_pond, fits, states, noise", [
    ({}, False, [()], "its own", (0, 0)),
    ({}, True, [()], "its own", (0, 0)),
    ({"gust_sd": (2.0, 0.3)}, False, [(refined_with_gusts,)], "its own", (7, 2)),
    ({"gust_sd": (2.0, 0.3)}, True, [], "of the search", (0, 0)),
])  # fmt: skip
def test_gusts_have_states_of_their_own_at_sea_and_stay_where_they_were_found_on_ponds(
    monkeypatch, random, on_pond, fits, states, noise
):
    """At sea they are fitted with their course, and then taken for the random force that this leaves without it."""
    asked = []
    monkeypatch.setattr(proving, "at_rest", lambda data_set, j, *fit: asked.append(fit) or (own, j))
    monkeypatch.setattr(proving, "MarginalLikelihood", lambda there: SimpleNamespace(
        evaluate=lambda hypothesis, around: replace(fitted(0.0, "current"), best=(7, 2))
    ))  # fmt: skip
    dynamics = SimpleNamespace(particulars=SimpleNamespace(is_model=on_pond))
    first, own = (SimpleNamespace(dynamics=dynamics, states=name) for name in ("of the search", "its own"))
    there, claim = proving._about_own_states(first, replace(fitted(9.0, "current"), random=random))
    assert (asked, there.states, claim.best) == (fits, states, noise) and claim.evidence == 9.0


# Decisions ------------------------------------------------------------------------------------------------------------


def test_where_nothing_unknown_leads_held_out_runs_settle_nothing():
    verdict = Decision(True, False, 0.1, 0.1, {"current": 0.8}, fitted(9.0, "current"), {})
    assert verdict.with_held_out(best=10.0) is verdict


@pytest.mark.parametrize("unmodelled, gains", [(6.9, 0.0), (7.1, 40.0 - np.log(2))])
def test_whether_a_receiver_wanders_is_not_asked_where_calm_water_is_likeliest_anyway(monkeypatch, unmodelled, gains):
    monkeypatch.setattr(deciding, "receiver_wander", lambda there, j: ReceiverWander(1.0, 60.0, 40.0))
    monkeypatch.setattr(deciding, "unknown_by_receiver", lambda there, none: -np.inf)
    assert deciding._by_usual_receiver(found(), None, unmodelled) == (approx(gains), 0.0)


@pytest.mark.parametrize("chance, passed", [(0.96e-3, False), (1.04e-3, True)])
def test_streams_that_are_slack_as_all_runs_begin_are_not_believed_below_a_thousandth(chance, passed):
    """Three runs, each within two standard errors s of none: the prior's density there times 4 s, to the third."""
    effect = TidalCurrent(SHIP)
    speed = next(j for j, p in enumerate(effect.declared) if p.per_run)
    rows = values(effect, 3)
    rows[:, speed] = 0.0
    h = Hypothesis((effect,), (rows,))
    unknowns = h.unknowns()
    (sd,) = {f.prior_sd(0.0) for f in unknowns if f.parameter.per_run}
    errors = np.ones(len(unknowns))
    errors[[f.parameter.per_run for f in unknowns]] = chance ** (1 / 3) * np.sqrt(2 * np.pi) * sd / 4
    (check,) = checks._goes_on(FittedHypothesis(h, 0.0, np.zeros((1, 1)), np.diag(errors**2)))
    assert check.passed is passed and f"probability {chance:.2g}" in check.text


# The search -----------------------------------------------------------------------------------------------------------


def test_without_effects_there_is_nothing_to_exchange():
    assert searching._with_other_forms(SimpleNamespace(), [], [Current(SHIP)]) == []


@pytest.mark.parametrize("anew", [False, True])
def test_a_partner_with_a_direction_is_tried_from_four_sides_and_another_from_its_starts_if_it_is_tried_anew(anew):
    def tried(effect) -> list[list[float]]:
        alone = Hypothesis((effect,), (values(effect, 2),))
        return [h.values[0].tolist() for h in partners._elsewhere(alone, anew)]

    stream, play, lever = Current(SHIP, speed=0.7), RudderBacklash(SHIP), LeverArm(SHIP)
    (speed,) = [p.starts[0] for p in stream.declared if not p.period]
    assert tried(stream) == [[[speed, angle]] * 2 for angle in (0.0, 90.0, 180.0, 270.0)]
    assert tried(play) == [[[s]] * 2 for s in play.declared[0].starts if anew]
    assert len(tried(lever)) == anew * np.prod([len(p.starts) for p in lever.declared])
