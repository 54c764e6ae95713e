"""Sentences of a diagnosis by what stands in them a little below a decision and a little above it."""

from types import SimpleNamespace

import pytest
from searches import fitted, found

from manoeuvre_nn.diagnosis.result import PHASE, Cause, Nature, Value
from manoeuvre_nn.diagnosis.words import _formula, nature_words, runner_up, summary_sentence

pytestmark = pytest.mark.usefixtures("unchecked_types")


def proof(before: float, after: float) -> SimpleNamespace:
    """A held-out run whose track was predicted so far off [m]."""
    return SimpleNamespace(run="r9", rmse_before={"pos": before}, rmse_after={"pos": after}, rmse_alone={})


@pytest.mark.parametrize("off, within", [(1.45, True), (1.55, False)])
def test_runs_agree_within_the_measurement_noise_if_they_are_predicted_to_one_and_a_half_times_it(off, within):
    """Of two runs with a root mean square of so many times it; of 2 m."""
    proofs = [proof(2.0 * off * share**0.5, 2.0 * off * share**0.5) for share in (0.5, 1.5)]
    said = summary_sentence([], [], proofs, False, noise={"pos": 2.0})
    assert ("within the measurement noise:" in said) is within
    assert ("3.1 m off, 1.6 times the measurement noise" in said) is not within


@pytest.mark.parametrize("terms, each", [
    (("N cos periodic_by_run", "N sin periodic_by_run"), True), (("N r|r|",), False), (("N cos periodic",), False),
    (("Y |v|", "N cos periodic_by_run"), True),
])  # fmt: skip
def test_size_and_phase_are_taken_from_each_run_of_what_has_its_own_in_each(terms, each):
    cause = Cause("unknown", "", 0.9, 9.0, ("N",), (), None, "", "", terms)
    said = summary_sentence([cause], ["unknown"], [proof(9.0, 3.0)], True)
    assert ("with that, its size and phase taken from each run, the predicted track" in said) is each
    assert ("with that the predicted track" in said) is not each


OWN = (Value("N cos periodic_by_run", 3.0, 0.1, "MN m"), Value("N sin periodic_by_run", -4.0, 0.1, "MN m"))
OTHER, PERIOD = Value("Y |v|", 20.0, 1.0, "kN"), Value("period_s", 50.0, 1.0, "s")
BEATS = Nature("periodic", ("N",), Value("amplitude", 5.0, 0.1, "MN m"))
WAVES = "N = 3 MN m cos(2 pi t/period) - 4 MN m sin(2 pi t/period)"
FIRST = "what is periodic as in the first run: every other has its own size and phase"


@pytest.mark.parametrize("terms, nature, told, left_out", [
    (OWN, BEATS, [], [WAVES, FIRST]),  # its nature says all that holds for every run
    (OWN, None, [WAVES, FIRST, "period 50 s", "positive: N bow to starboard"], ["Y ="]),
    ((OTHER, *OWN), BEATS, ["Y = 20 kN |v|", "positive: Y to starboard;"], ["N =", FIRST]),
    ((OTHER,), None, ["Y = 20 kN |v|"], [FIRST]),
])  # fmt: skip
def test_waves_of_a_formula_with_their_own_phase_in_each_run_are_told_where_no_nature_tells_them(
    terms, nature, told, left_out
):
    cause = Cause(
        "unknown", "", 0.9, 9.0, ("N",), (*terms, PERIOD), None, "", "", tuple(v.name for v in terms), nature=nature
    )
    said = _formula(cause)
    assert all(words in said for words in told) and not any(words in said for words in left_out)
    assert bool(said) is bool(told)


def test_a_periodic_force_has_one_phase_or_its_own_in_each_run_and_can_be_foreseen():
    period, phase = Value("period", 50.0, 0.5, "s"), Value(PHASE, 30.0, 4.0, "deg", period=360.0)
    alike, each = (
        nature_words(Nature("periodic", ("N",), Value("amplitude", 5.0, 0.1, "MN m"), scales))
        for scales in ((period, phase), (period,))
    )
    begun = "a periodic force in yaw, amplitude 5.00 ± 0.10 MN m, period 50.00 ± 0.50 s"
    assert alike == f"{begun}, phase at the start 30.0 ± 4.0 deg"
    assert each == f"{begun}, with its own size and phase in each run"


def test_a_named_effect_that_all_others_hold_has_no_runner_up():
    best, more = fitted(30.0, "current"), fitted(31.0, "current", "log_scale")
    verdict = SimpleNamespace(best=best, named=True, strange=False, unknown=0.0)
    assert runner_up(found(more, best), verdict) == []
