"""Which hypotheses are linearised about their own states before a decision, and what others are about these."""

from dataclasses import replace
from types import SimpleNamespace

import pytest
from searches import EFFECTS, fitted, found
from trials import SHIP, values

from manoeuvre_nn.diagnosis import decision
from manoeuvre_nn.diagnosis import settled as under_test
from manoeuvre_nn.diagnosis.settled import settled
from manoeuvre_nn.effect.local import SideForce
from manoeuvre_nn.estimation.hypothesis import Hypothesis

pytestmark = pytest.mark.usefixtures("unchecked_types")

RACES = [
    ((20.0, 15.2, 14.8), 2),  # five behind the best are out of the race
    ((20.0, 19.0, 18.0, 17.0), 4),  # three at once; as these lose, the fourth is next
    ((20.0, 14.0), 0),
    ((0.0, -0.1), 2),  # two effects, each as often as calm water
    ((-0.1, -0.2), 0),  # calm water is likelier: nothing to race for
]


@pytest.mark.parametrize("gains, raced", RACES)
def test_hypotheses_close_behind_the_best_are_linearised_about_their_own_states(monkeypatch, gains, raced):
    made = [fitted(g - 3.0, name) for g, name in zip(gains, EFFECTS, strict=False)]
    seen = []

    def rested(data_set, j, parts, calm):
        seen.append(j)
        assert not parts
        return replace(j, evidence=30.0 - j.evidence), []

    monkeypatch.setattr(under_test, "_rested", rested)
    after = settled(found(*made, none=-3.0))
    assert [j.names for j in seen] == [j.names for j in made[:raced]]
    assert [j.evidence for j in after.fitted] == sorted((j.evidence for j in after.fitted), reverse=True)
    assert raced == 0 or after.fitted[0].names == made[raced - 1].names


PAIR, PART, OTHER = ("current", "log_scale"), ("log_scale",), ("rudder_offset",)


@pytest.mark.parametrize("behind, raced", [(6.8, True), (7.2, False)])
def test_base_rates_count_in_the_race(monkeypatch, behind, raced):
    """Five behind by weight: a pair of four effects is ln 7.95 = 2.07 less likely than one effect before all runs."""
    seen = []

    def rested(data_set, j, parts, calm):
        seen.append(j.names)
        return j, list(parts)

    monkeypatch.setattr(under_test, "_rested", rested)
    rest = [fitted(0.0, "current"), fitted(0.0, "log_scale"), fitted(0.0, "heading_bias")]
    settled(found(fitted(20.0, *PAIR), fitted(20.0 - behind, *OTHER), *rest, none=-9.0))
    assert (OTHER in seen) is raced and PAIR in seen


def test_what_has_rested_is_weighed_as_the_search_is(monkeypatch):
    """It gains what it gains beyond calm water with any prior of coefficients, once, and so do its parts."""
    gains = {PAIR: 3.0, PART: -1.0}
    there = SimpleNamespace(data_set="its own states")
    monkeypatch.setattr(under_test, "MarginalLikelihood", lambda data_set: there)
    for module in (under_test, decision):
        monkeypatch.setattr(module, "beside", lambda likelihood, h: likelihood)
    monkeypatch.setattr(under_test, "refine", lambda likelihood, h, *best: fitted(9.0, *h.names))
    monkeypatch.setattr(decision, "gain_by_coefficient_priors", lambda data_set, j: gains[j.names])
    both, part = fitted(20.0, *PAIR), fitted(1.0, *PART)
    for calm, moved, expected in (
        (0.5, 1.0, (23.5, 7.5)),
        (None, 1.0, (21.0, 9.0)),
        (0.5, 0.0, (20.0, 7.5)),  # it was at rest, and has been weighed so already
    ):
        rested = replace(both, evidence=20.0 + moved)
        monkeypatch.setattr(under_test, "at_rest", lambda *_, rested=rested: ("there", rested))
        whole, (fewer,) = under_test._rested(None, both, [part], calm)
        assert (whole.evidence, fewer.evidence) == expected


@pytest.mark.parametrize("rest, of_pair, raced, other", [
    ({PAIR: 1.0, PART: 11.0}, 0.0, [PAIR, PART], 17.5 - 24.0),
    # Without the pair another one is close behind the best.
    ({PAIR: 24.0, PART: 22.0, OTHER: 20.0}, 0.0, [PAIR, PART, OTHER], 20.0),
    ({PAIR: 40.0, PART: 11.0}, 0.0, [PAIR, PART], 17.5),  # what the best gains others do not
    ({PAIR: 40.0, PART: 11.0}, 39.0, [PAIR, PART], 17.5),  # about the pair's states its part explains as much
])  # fmt: skip
def test_what_the_last_of_two_effects_adds_is_told_about_the_states_of_each(monkeypatch, rest, of_pair, raced, other):
    """About common states a pair adds 15 to its best part, about those of each less than 6."""
    seen = []

    def rested(data_set, j, parts, calm):
        seen.append(j.names)
        assert [part.names for part in parts] == ([PART] if j.names == PAIR else [])
        return replace(j, evidence=rest[j.names]), [replace(part, evidence=of_pair) for part in parts]

    monkeypatch.setattr(under_test, "_rested", rested)
    made = [fitted(25.0, *PAIR), fitted(17.5, *OTHER), fitted(10.0, *PART), fitted(9.0, "current")]
    after = settled(found(*made, none=-9.0)).fitted
    assert seen == raced and after[0].names == max(rest, key=lambda names: rest[names])
    assert {j.names: j.evidence for j in after} == {
        **rest,
        PART: max(rest[PART], of_pair),
        OTHER: other,
        ("current",): 9.0 - max(25.0 - rest[PAIR], 0.0),
    }


@pytest.mark.parametrize("gain, looked_at", [(13.0, True), (6.5, False)])
def test_where_the_best_lose_much_what_is_left_far_behind_is_looked_at_before_it_loses_as_much(
    monkeypatch, gain, looked_at
):
    rest = {("current",): 12.0, PART: 10.0, OTHER: 15.0}
    monkeypatch.setattr(under_test, "_rested", lambda data_set, j, parts, _: (replace(j, evidence=rest[j.names]), []))
    after = settled(found(fitted(30.0, "current"), fitted(27.0, *PART), fitted(gain, *OTHER), none=-9.0)).fitted
    assert {j.names: j.evidence for j in after} == rest | ({} if looked_at else {OTHER: gain - 18.0})


def test_a_pair_that_has_rested_does_so_again_for_a_part_that_comes_later(monkeypatch):
    """The better part falls about its own states and the pair's: the other one is next."""
    seen, of_part = [], {PART: 5.0, ("current",): 12.0}

    def rested(data_set, j, parts, calm):
        seen.append((j.names, [part.names for part in parts]))
        return replace(j, evidence=25.0 if j.names == PAIR else 5.0), [
            replace(p, evidence=of_part[p.names]) for p in parts
        ]

    monkeypatch.setattr(under_test, "_rested", rested)
    after = settled(found(fitted(25.0, *PAIR), fitted(10.0, *PART), fitted(9.0, "current"), none=-9.0)).fitted
    assert seen == [(PAIR, [PART]), (PART, []), (PAIR, [("current",)]), (("current",), [])]
    assert {j.names: j.evidence for j in after} == {PAIR: 25.0, PART: 5.0, ("current",): 12.0}


@pytest.mark.parametrize("lever, asked", [(0.6, False), (0.3, True)])
def test_an_event_at_the_end_of_what_is_possible_is_not_asked(lever, asked):
    """A small random moment is a force at the longest lever."""
    force = SideForce(SHIP, force_kN=50.0, lever_m=lever * SHIP.particulars.length, start_s=60.0, end_s=90.0)
    best, both = fitted(20.0, "current"), fitted(27.0, "current", "log_scale")
    effects = (best.hypothesis.effects[0], force)
    both = replace(both, hypothesis=Hypothesis(effects, tuple(values(e) for e in effects)))
    assert under_test.plausible(found(both, best)) == ([both, best] if asked else [best])


def test_a_part_that_has_rested_is_fitted_about_the_states_of_a_pair_that_comes_later(monkeypatch):
    late, seen = ("rudder_offset", "log_scale"), []

    def rested(data_set, j, parts, calm):
        seen.append((j.names, [part.names for part in parts]))
        return replace(j, evidence=13.0 if j.names == OTHER else 20.5), [replace(p, evidence=18.0) for p in parts]

    monkeypatch.setattr(under_test, "_rested", rested)
    after = settled(found(fitted(21.0, "current"), fitted(20.0, *OTHER), fitted(19.8, *late), none=-9.0)).fitted
    # About common states it added nothing to 20; of 13, which its part reaches about its own states, it is 6.3 ahead.
    assert seen == [(("current",), []), (OTHER, []), (late, [OTHER])]
    assert {j.names: j.evidence for j in after}[OTHER] == 18.0


def test_the_part_of_two_pairs_is_in_the_race_once():
    first, second = ("current", "log_scale"), ("rudder_offset", "log_scale")
    race = under_test._race(found(fitted(27.0, *first), fitted(26.0, *second), fitted(15.0, "log_scale"), none=-9.0))
    assert [j.names for j in race] == [first, second, ("log_scale",)]
