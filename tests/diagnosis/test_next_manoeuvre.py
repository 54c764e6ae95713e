"""Which run to record next: what a rival cannot imitate, by dense matrices and by what sailors know."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest
from pytest import approx
from tiers import mainly
from trials import CALM, NOISE, SHIP, run_of, sailed, values

from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.diagnosis import next_runs, words
from manoeuvre_nn.diagnosis.advise import Ranked, advise, apart, left_over
from manoeuvre_nn.diagnosis.checks import aliases
from manoeuvre_nn.diagnosis.next_runs import HALF, Plan, _manoeuvres, _sailed, new_runs, same_runs
from manoeuvre_nn.diagnosis.words import next_steps, runner_up
from manoeuvre_nn.effect.current import Current
from manoeuvre_nn.effect.propulsion import PropellerPitchError
from manoeuvre_nn.effect.rudder import RudderOffset
from manoeuvre_nn.effect.sensors import HeadingBias
from manoeuvre_nn.effect.waves import WaveDrift
from manoeuvre_nn.effect.wind import SteadyWind
from manoeuvre_nn.estimation.data_set import COEFFICIENT_SD_LEVELS, WhitenedDataSet, whitened_data_set
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis, Hypothesis
from manoeuvre_nn.estimation.marginal_likelihood import hypothesis_columns
from manoeuvre_nn.estimation.prepared_run import LATENCY_SD, PreparedRun, about_states
from manoeuvre_nn.estimation.process_noise import PROCESS_LEVELS
from manoeuvre_nn.manoeuvre.straight import straight
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.recording.preparation import measured

pytestmark = pytest.mark.usefixtures("unchecked_types")
LOG = 6
CURRENT = Current(SHIP, speed=0.5, toward_deg=90.0)
FOLLOWING = Current(SHIP, speed=0.5, toward_deg=0.0)
WIND = SteadyWind(SHIP, speed=10.0, from_deg=60.0)
COMPASS = HeadingBias(SHIP, bias_deg=3.0)
NOTHING = FittedHypothesis(Hypothesis((), ()), 0.0, np.zeros((1, 1)), np.eye(1))


@pytest.fixture
def few_manoeuvres(monkeypatch):
    """Of all that is tried a straight run and a zigzag alone, on every heading and at half speed."""
    every, few = next_runs._manoeuvres, {"a straight run", "a 20/20 zigzag, first to port,"}
    monkeypatch.setattr(next_runs, "_manoeuvres", lambda limit: {w: m for w, m in every(limit).items() if w in few})
    ranked.cache_clear()
    yield
    ranked.cache_clear()


@pytest.fixture
def short_runs(monkeypatch):
    """All that is tried, half as long."""
    monkeypatch.setattr(next_runs, "LENGTHS", 0.5 * next_runs.LENGTHS)


def judged(*effects: Effect, evidence: float = 0.0, best: tuple[int, int] = (0, 1)) -> FittedHypothesis:
    """Effects at their own values in one run."""
    h = Hypothesis(effects, tuple(values(e) for e in effects))
    return FittedHypothesis(h, evidence, np.zeros((1, 1)), np.eye(len(h.unknowns())), best=best)


@cache
def stand(trial: str = "straight", *acting: Effect, log: bool = True) -> WhitenedDataSet:
    """One run of 180 s on heading north on the bench."""
    made = straight(duration=180.0) if trial == "straight" else zigzag(20.0, duration=180.0)
    run = run_of(sailed([made], acting)[0], NOISE)
    if not log:
        run = run.with_channels(u_log=np.full(len(run), np.nan))
    return whitened_data_set(CALM, [run])


@cache
def ranked(place: WhitenedDataSet, leading: Effect, rival: Effect | None) -> Ranked:
    return advise(place, judged(leading), [NOTHING if rival is None else judged(rival)])[0]


def gain(runs: Ranked, said: str, heading_deg: float | None, share: float = 1.0) -> float:
    """What one of the runs adds."""

    def meant(a: Plan) -> bool:
        if heading_deg is None or a.heading is None:
            return heading_deg is a.heading
        return abs((np.degrees(a.heading) - heading_deg + 180) % 360 - 180) < 5 and a.share == share

    (found,) = [expected for expected, a in runs if a.words.startswith(said) and meant(a)]
    return found


def test_what_is_left_over_is_half_a_squared_distance_in_the_metric_of_noise_and_nuisance():
    g = np.random.default_rng(0)
    d, n, spread = g.standard_normal(9), g.standard_normal((9, 3)), np.array([0.3, 1.0, 40.0])
    both = np.column_stack([d, n])
    whole = np.eye(9) + (n * spread**2) @ n.T
    assert left_over(both.T @ both, spread) == approx(0.5 * d @ np.linalg.solve(whole, d))


def test_it_is_what_the_evidence_of_noise_free_data_falls_by_when_the_truth_is_taken_for_calm_water():
    """By regressions: data that are a current's contribution exactly, explained by it and by coefficients alone."""
    place = stand("zigzag", CURRENT)
    level, scatter = 0, 1
    whole = hypothesis_columns(place, judged(CURRENT).hypothesis).columns[0]
    e, base = place.at(level).white[0].embed(whole), place.at(level).base[0]
    d, n = slice(0, 1), slice(1, None)
    sd = np.r_[np.full(place.combinations, COEFFICIENT_SD_LEVELS[scatter]), LATENCY_SD]
    cross = base.dot(e)[n, d][:, 0]
    fitted = np.linalg.solve(base.dot(base)[n, n] + np.diag(sd**-2.0), cross)
    misfit = e.dot(e)[0, 0] - 2 * cross @ fitted + fitted @ base.dot(base)[n, n] @ fitted + np.sum((fitted / sd) ** 2)
    assert apart(place, judged(CURRENT).hypothesis, NOTHING.hypothesis, (level, scatter)) == approx(0.5 * misfit)


@pytest.mark.usefixtures("short_runs")
def test_hypotheses_that_act_alike_are_told_apart_by_no_run():
    runs = ranked(stand(), CURRENT, CURRENT)
    assert len(runs) > 40 and all(expected == approx(0.0, abs=1e-9) for expected, _ in runs)


@pytest.mark.slow
def test_a_run_never_tells_less_and_the_most_telling_stands_first():
    gains = [expected for expected, _ in ranked(stand("straight", CURRENT), CURRENT, COMPASS)]
    assert min(gains) >= 0 and gains == sorted(gains, reverse=True) and gains[0] > 3


def test_five_times_the_noise_leaves_a_twenty_fifth(monkeypatch):
    """Noise of all kinds and errors of coefficients."""
    monkeypatch.setattr("manoeuvre_nn.diagnosis.advise.COEFFICIENT_SD_LEVELS", (0.002, 0.01))
    assert PROCESS_LEVELS.sizes[4] == approx(5 * PROCESS_LEVELS.sizes[0])
    place = stand("zigzag", WIND)
    worse = [replace(p, noise=5 * p.noise) for p in place.runs]
    loud = [{**p.linearised.run.meta, "rudder_noise": 5 * p.linearised.run.meta["rudder_noise"]} for p in worse]
    worse = [
        replace(p, linearised=replace(p.linearised, run=replace(p.linearised.run, meta=meta)))
        for p, meta in zip(worse, loud, strict=True)
    ]
    again = [about_states(CALM, p, p.linearised.track) for p in worse]
    pair = (judged(WIND).hypothesis, judged(RudderOffset(SHIP, offset_deg=1.0)).hypothesis)
    much = apart(place, *pair, (0, 0))
    little = apart(WhitenedDataSet(CALM, again), *pair, (PROCESS_LEVELS.point(4, 4), 1))
    assert much / little == approx(25.0, rel=0.15) and little > 0.01


@pytest.mark.usefixtures("few_manoeuvres")
def test_a_current_across_is_told_from_a_compass_error_by_another_heading():
    """On one heading both are an angle between heading and course; on the opposite one the current's angle turns."""
    runs = ranked(stand("straight", CURRENT), CURRENT, COMPASS)
    same, opposite = gain(runs, "a straight run", 0.0), gain(runs, "a straight run", 180.0)
    assert opposite > 5 * same and opposite > 10
    assert runs[0][1].heading is not None and abs(np.degrees(runs[0][1].heading)) > 45


@pytest.mark.slow
def test_a_current_and_wind_on_one_heading_are_told_apart_by_another():
    place = stand("straight", CURRENT)
    runs = ranked(place, CURRENT, WIND)
    assert max(gain(runs, "a straight run", h) for h in (90.0, 180.0, 270.0)) > gain(runs, "a straight run", 0.0) + 3


@pytest.mark.slow
def test_the_log_tells_a_following_current_from_more_thrust():
    """Over ground the ship is faster by both; through the water by thrust alone."""
    deaf = stand("straight", FOLLOWING, log=False)
    runs = ranked(deaf, FOLLOWING, PropellerPitchError(SHIP, fraction=0.15))
    assert gain(runs, "straight again with the speed log", None) > 2 * gain(runs, "a straight run", 0.0) + 3
    assert [a.words for _, a in runs if a.heading is None] == ["straight again with the speed log"]
    assert all(a.heading is not None for _, a in ranked(stand("straight", CURRENT), CURRENT, COMPASS)), (
        "nothing is missing there"
    )


@pytest.mark.slow
def test_a_rudder_offset_looks_the_same_on_all_headings():
    runs = ranked(stand("zigzag"), RudderOffset(SHIP, offset_deg=1.0), None)
    gains = [gain(runs, "a 20/20 zigzag, first to port", h) for h in (0.0, 90.0, 180.0, 270.0)]
    assert gains == approx([gains[0]] * 4, rel=0.02) and gains[0] > 1


@pytest.mark.usefixtures("short_runs")
@pytest.mark.parametrize("effect", mainly(1, [WIND, None, CURRENT, RudderOffset(SHIP, offset_deg=2.0)]))
def test_simulated_runs_obey_the_equations_by_which_they_are_judged(effect):
    """What a step of calm water from each state misses is what the hypothesis adds; at half speed too."""
    h = Hypothesis((), ()) if effect is None else judged(effect).hypothesis
    plans = list(new_runs(stand("zigzag"), h))
    assert {p.share for p in plans} == {1.0, HALF} and len({p.words for p in plans}) == 12
    for plan in plans:
        line = plan.prepared.linearised
        added = 0.0
        if effect is not None:
            added = hypothesis_columns(WhitenedDataSet(CALM, [plan.prepared]), h).columns[0].moved[..., 0]
        off = np.abs(line.data.moved[..., 0] - added)
        assert (off.mean(axis=0) < [0.004, 0.004, 2e-5, 0.02, 0.02, 1e-4]).all(), plan.words
        assert line.track[0, 0] == approx(plan.share * SHIP.particulars.speed)
        if "circle" in plan.words:
            assert (line.track[-1, 5] > line.track[0, 5]) == plan.words.endswith("starboard")


@pytest.mark.usefixtures("few_manoeuvres")
def test_at_half_speed_the_ship_keeps_about_half_its_speed():
    plan = next(p for p in new_runs(stand(), Hypothesis((), ())) if p.words == "a straight run" and p.share == HALF)
    assert plan.prepared.linearised.track[-1, 0] == approx(HALF * SHIP.particulars.speed, rel=0.25)
    assert (plan.prepared.linearised.run["shaft"] == HALF).all()


@pytest.mark.usefixtures("few_manoeuvres")
def test_simulated_runs_have_the_channels_of_the_recorded_ones_and_the_noise_of_their_means():
    deaf = stand("straight", FOLLOWING, log=False)
    plan = next(iter(new_runs(deaf, Hypothesis((), ()))))
    run, recorded = plan.prepared.linearised.run, deaf.runs[0]
    assert np.isnan(measured(run)[:, LOG]).all() and np.isfinite(np.delete(measured(run), LOG, axis=1)).all()
    assert plan.prepared.noise == approx(recorded.noise * np.sqrt(recorded.linearised.run.step / run.step))
    (more,) = same_runs(deaf)
    assert (plan.row, more.row, more.share) == (0, 0, 1.0), "the values of the first run, and the speed that it had"
    assert np.isfinite(measured(more.prepared.linearised.run)).all() and more.prepared.noise[LOG] == 0.05


def test_every_named_effect_has_its_own_aliases():
    """On one heading a weak current is a compass error, with a rudder offset beside it or without."""
    weak, turned = Current(SHIP, speed=0.05, toward_deg=90.0), HeadingBias(SHIP, bias_deg=0.3)
    alone, compass = judged(weak, evidence=30.0), judged(turned, evidence=29.0)
    offset = judged(RudderOffset(SHIP, offset_deg=2.0), evidence=5.0)
    pair = judged(weak, *offset.hypothesis.effects, evidence=70.0)
    assert aliases(search(alone, compass, offset), alone) == {"current": ["heading_bias"]}
    assert aliases(search(pair, alone, compass, offset), pair) == {"current": ["heading_bias"]}
    assert aliases(search(alone, replace(compass, evidence=10.0), offset), alone) == {}, "it was tried and fell behind"
    strong = judged(CURRENT, evidence=30.0)
    assert aliases(search(strong, compass), strong) == {} == aliases(search(alone, compass), NOTHING)


def search(*found: FittedHypothesis) -> SimpleNamespace:
    return SimpleNamespace(
        none=NOTHING, fitted=list(found), likelihood=SimpleNamespace(data_set=stand("straight", CURRENT))
    )


def verdict(best: FittedHypothesis, **effects: float) -> SimpleNamespace:
    return SimpleNamespace(best=best, effects=effects, named=True, strange=False, unknown=0.0)


@pytest.mark.usefixtures("few_manoeuvres")
def test_the_sentence_names_the_run_its_heading_and_what_is_expected_of_it():
    first, second = judged(CURRENT, evidence=30.0), judged(COMPASS, evidence=28.8)
    (said,), advised = next_steps(search(first, second), verdict(first, current=0.7, heading_bias=0.28), first, True)
    expected, best = ranked(stand("straight", CURRENT), CURRENT, COMPASS)[0]
    assert said == (
        f"To tell a current from a compass error (28 %): {best.text} (expected log Bayes factor {expected:.0f}; "
        "these recordings: 1.2)."
    )
    assert "begun on heading " in said and advised.as_dict == best.as_dict


@pytest.mark.slow
def test_what_acts_beside_the_leader_is_looked_for_with_both_acting():
    alone, both = judged(CURRENT, evidence=30.0), judged(CURRENT, RudderOffset(SHIP, offset_deg=1.0), evidence=31.0)
    tried, seen = (
        search(both, alone, judged(WaveDrift(SHIP), evidence=1.0)),
        verdict(alone, current=1.0, rudder_offset=0.4),
    )
    assert next_steps(tried, seen, alone, True)[0][0].startswith(
        "To tell a current and a rudder offset from a current (40 %)"
    )


def test_where_no_run_tells_it_is_said_what_to_measure(monkeypatch):
    monkeypatch.setattr(words, "advise", lambda *_: [[(0.4, Plan("a straight run", {}, Mock(PreparedRun), 0.0))] * 60])
    first, second = judged(WIND, evidence=30.0), judged(COMPASS, evidence=29.0)
    (said,), advised = next_steps(search(first, second), verdict(first, heading_bias=0.3), first, True)
    assert advised is None
    assert said.endswith("measure the same with a second sensor and the wind and the waves; "
                         "none of 60 simulated runs would do (expected log Bayes factor 0.4).")  # fmt: skip


@pytest.mark.parametrize("of_other, also", [(3.5, "; or a zigzag (3.5)"), (2.5, "")])
def test_beside_a_run_on_another_heading_one_on_any_is_told_if_it_tells_enough(monkeypatch, of_other, also):
    """Three in log evidence are enough; the circle needs the heading, too."""
    circle, turned, zigzag = (Plan(name, {}, Mock(PreparedRun), h) for name, h in
                              (("a circle", 0.5), ("a circle", 1.5), ("a zigzag", None)))  # fmt: skip
    found = [(9.0, circle), (8.0, turned), (of_other, zigzag), (1.0, zigzag)]
    monkeypatch.setattr(words, "advise", lambda *_: [found])
    first, second = judged(WIND, evidence=30.0), judged(COMPASS, evidence=29.0)
    (said,), advised = next_steps(search(first, second), verdict(first, heading_bias=0.3), first, True)
    assert said.endswith(f"these recordings: 1.0){also}.") and advised is circle


@pytest.mark.usefixtures("few_manoeuvres")
def test_a_run_that_ends_in_less_than_half_of_its_time_is_not_advised(monkeypatch):
    """The first of the runs ends at .45 of the time, the second at .55."""
    whole = next_runs.rollout

    def ended(*given, **more):
        runs = whole(*given, **more)
        runs.ended[0] = 0.45 * next_runs.LENGTHS * SHIP.particulars.time_unit
        runs.ended[1] = 0.55 * next_runs.LENGTHS * SHIP.particulars.time_unit
        return runs

    every = list(new_runs(stand("zigzag"), NOTHING.hypothesis))
    monkeypatch.setattr(next_runs, "rollout", ended)
    some = list(new_runs(stand("zigzag"), NOTHING.hypothesis))
    assert [p.text for p in some] == [p.text for p in every[1:]]
    assert len(some[0].prepared.linearised.run) < 0.6 * len(every[1].prepared.linearised.run)


def test_nothing_is_simulated_where_the_verdict_is_certain(monkeypatch):
    monkeypatch.setattr(words, "advise", lambda *_: pytest.fail("simulated"))
    first, second = judged(CURRENT, evidence=30.0), judged(COMPASS, evidence=10.0)
    tried, sure = search(first, second), verdict(first, current=0.99, heading_bias=0.01)
    assert next_steps(tried, sure, first, True) == (
        ["Nothing else comes close to a current; a repeat at another speed would confirm the values."],
        None,
    )
    assert next_steps(tried, sure, NOTHING, True)[0][0].startswith("Repeat one run")
    calm = verdict(second, current=0.01, heading_bias=0.02)
    assert next_steps(tried, calm, NOTHING, False)[0][0].startswith("Nothing more is needed")


@pytest.mark.slow
def test_a_weak_candidate_is_told_from_calm_water():
    weak = judged(CURRENT, evidence=2.0)
    said, _ = next_steps(search(weak), verdict(weak, current=0.2), NOTHING, False)
    assert said[0].startswith("To tell a current from calm water (20 %): a ") and len(said) == 2


def test_the_runner_up_is_told_with_what_speaks_for_and_against_it():
    first, second = judged(CURRENT, evidence=30.0), judged(COMPASS, evidence=9.0, best=(PROCESS_LEVELS.point(7, 7), 1))
    tried = search(first, judged(CURRENT, WIND, evidence=29.0), second)
    assert runner_up(tried, verdict(first)) == [
        "For a compass error: it explains the recordings better than calm water by 9.0 in log evidence.",
        "Against it: with a current they are explained better still, by 21 (odds less than one in a million), and "
        "0.3 % of the rudder's force at 20 deg is left, not 5 %.",
    ]
    close = runner_up(search(first, judged(COMPASS, evidence=28.0)), verdict(first))
    assert close[1] == "Against it: with a current they are explained better still, by 2.0 (odds 1 to 7.4)."
    pair = judged(COMPASS, WIND, evidence=31.0)  # of three effects a pair is as likely beforehand as one, by .53 to .10
    rarer = runner_up(search(pair, first, judged(COMPASS, evidence=20.0), judged(WIND, evidence=1.0)), verdict(first))
    assert rarer[1] == "Against it: with a current they are explained nearly as well, by fewer effects (odds 1 to 1.9)."
    behind = runner_up(search(first, judged(COMPASS, evidence=-2.0)), verdict(first))
    assert behind[0].startswith("For a compass error nothing speaks")


def test_beside_something_unknown_or_nothing_the_best_candidate_is_the_runner_up():
    weak = judged(CURRENT, evidence=2.0)
    strange = SimpleNamespace(best=weak, named=False, strange=True, unknown=0.97)
    assert runner_up(search(weak), strange)[1] == "Against it: something without a name is likelier (97 %)."
    calm = SimpleNamespace(best=weak, named=False, strange=False, unknown=0.01)
    (said,) = runner_up(search(weak), calm)
    assert said == "The best candidate is a current, but calm water is likelier; log evidence +2.0 in the fitted runs."
    assert runner_up(search(), SimpleNamespace(best=None)) == []


def test_of_something_without_a_name_nothing_is_simulated():
    assert next_steps(search(), verdict(NOTHING), judged(WIND, evidence=9.0), True)[0][0].startswith("Repeat one run")


def test_every_run_that_is_tried_has_a_name_for_machines_that_says_what_its_words_say():
    said = {words: _sailed(m) for words, m in _manoeuvres(np.pi).items()}
    assert said["a 20/20 zigzag, first to port,"] == {"manoeuvre": "zz20", "first_turn": "port"}
    assert said["a 35 deg turning circle to starboard"] == {"manoeuvre": "tc35", "first_turn": "starboard"}
    assert said["a pull-out after a 20 deg turn"] == {"manoeuvre": "po20", "first_turn": "starboard"}
    assert said["a straight run"] == {"manoeuvre": "straight", "first_turn": "starboard"}
    assert len({tuple(sailed.values()) for sailed in said.values()}) == len(said)


def test_of_two_rivals_the_run_against_the_first_is_advised_if_one_tells_them_apart(monkeypatch):
    first, second, third = (judged(e, evidence=n) for e, n in ((CURRENT, 30.0), (COMPASS, 29.5), (WIND, 29.0)))
    tried, seen = search(first, second, third), verdict(first, current=0.4, heading_bias=0.35, wind_steady=0.25)
    runs = [(9.0, Plan(name, {"manoeuvre": name}, Mock(PreparedRun), 0.0)) for name in ("tc35", "zz20")]
    monkeypatch.setattr(words, "advise", lambda *_: [[runs[0]], [runs[1]]])
    assert next_steps(tried, seen, first, True)[1] is runs[0][1]
    monkeypatch.setattr(words, "advise", lambda *_: [[(0.4, runs[0][1])], [runs[1]]])
    assert next_steps(tried, seen, first, True)[1] is runs[1][1]
    monkeypatch.setattr(words, "advise", lambda *_: [[(0.4, runs[0][1])], [(0.4, runs[1][1])]])
    assert next_steps(tried, seen, first, True)[1] is None
