"""Short cuts of the search that must not change what it finds."""

import os
import signal
import threading
import time
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from functools import partial

import pytest
from pytest import approx
from trials import CALM, CIRCLE, SHIP, ZIGZAG, runs, values

from manoeuvre_nn.core.ending import explain
from manoeuvre_nn.diagnosis import workers
from manoeuvre_nn.diagnosis.search import search
from manoeuvre_nn.diagnosis.workers import shared_out
from manoeuvre_nn.effect.current import Current
from manoeuvre_nn.effect.local import SideForce
from manoeuvre_nn.effect.rudder import RudderOffset
from manoeuvre_nn.estimation.data_set import whitened_data_set
from manoeuvre_nn.estimation.hypothesis import Hypothesis
from manoeuvre_nn.estimation.marginal_likelihood import MAX_KEPT, MarginalLikelihood, hypothesis_columns

pytestmark = pytest.mark.usefixtures("unchecked_types")
ACTING = (Current(SHIP, speed=0.6, toward_deg=50.0), RudderOffset(SHIP, offset_deg=1.5))
PUSH = SideForce(SHIP, force_kN=100.0, lever_m=20.0, start_s=80.0, end_s=150.0)


def alone(effect) -> Hypothesis:
    return Hypothesis((effect,), (values(effect, 2),))


@pytest.mark.parametrize("level, scatter", [(6, 1), (12, 3)])
def test_a_pair_from_pieces_is_as_likely_as_the_pair_itself(level, scatter):
    likelihood = MarginalLikelihood(whitened_data_set(CALM, runs([CIRCLE, ZIGZAG], ACTING)))
    for first, second in ((ACTING[0], ACTING[1]), (ACTING[1], PUSH), (PUSH, ACTING[0])):
        a, b = alone(first), alone(second)
        whole = likelihood.posterior(hypothesis_columns(likelihood.data_set, a.joined(b)), level).evidence[scatter]
        assert likelihood.pair_evidence(a, b, level, scatter) == approx(float(whole), abs=1e-5)
    assert likelihood._piece(a, level) is likelihood._piece(a, level)


def process(number: int) -> tuple[int, int]:
    return number, os.getpid()


def test_results_come_in_order_from_several_processes():
    found = list(shared_out([partial(process, number) for number in range(5)], 2))
    assert [number for number, _ in found] == list(range(5)) and os.getpid() not in {pid for _, pid in found}
    assert [pid for _, pid in shared_out([partial(process, number) for number in range(3)], 1)] == [os.getpid()] * 3
    assert list(shared_out([], 2)) == []


def killed(number: int) -> int:
    if number == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def test_a_process_that_is_killed_is_told_and_not_waited_for():
    with pytest.raises(BrokenProcessPool) as broken:
        list(shared_out([partial(killed, number) for number in range(4)], 2))
    assert "one of several processes was killed" in str(explain(broken.value))
    assert list(shared_out([partial(abs, number) for number in range(4)], 2)) == [0, 1, 2, 3]


def test_two_threads_that_share_out_tasks_each_get_their_own_results(monkeypatch):
    both_began, got = threading.Barrier(2, timeout=30), dict[str, list]()

    def pool(*args):
        both_began.wait()
        return ProcessPoolExecutor(*args)

    def share_out(name: str) -> None:
        got[name] = list(shared_out([partial(str.upper, f"{name}{k}") for k in range(3)], 2))

    monkeypatch.setattr(workers, "ProcessPoolExecutor", pool)
    threads = [threading.Thread(target=share_out, args=(name,)) for name in "ab"]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert got == {"a": ["A0", "A1", "A2"], "b": ["B0", "B1", "B2"]}


@pytest.mark.slow  # shares of work in processes of their own, above, and pairs in one
def test_two_processes_find_what_one_finds():
    stand = whitened_data_set(CALM, runs([replace(trial, duration=60.0) for trial in (CIRCLE, ZIGZAG)], ACTING))
    once, twice = (search(stand, [type(e)(SHIP) for e in ACTING], workers=n) for n in (1, 2))
    assert [j.names for j in once.fitted] == [j.names for j in twice.fitted]
    assert [j.evidence for j in once.fitted] == approx([j.evidence for j in twice.fitted], abs=1e-9)
    assert {"current", "rudder_offset"} <= set(once.fitted[0].names)


def test_a_hypothesis_that_was_forgotten_is_not_taken_for_another():
    """Hypotheses made for one score get the memory of those before them: sizes and values must be their own."""
    stand = whitened_data_set(CALM, runs([CIRCLE, ZIGZAG], ACTING))
    likelihood = MarginalLikelihood(stand)
    first = Hypothesis((ACTING[0],), (values(ACTING[0], 2),))
    level, scatter = likelihood.evaluate(first).best
    kinds = [type(e)(SHIP) for e in (*ACTING, PUSH)]

    def score(k: int, judge: MarginalLikelihood) -> float:
        other = kinds[k % len(kinds)]
        table = values(other, 2)
        table[:, 0] *= 1 + 0.01 * k
        return judge.pair_evidence(first, Hypothesis((other,), (table,)), level, scatter)

    apart = [score(k, MarginalLikelihood(stand)) for k in range(9)]
    found = []
    for k in range(9):
        found += [score(k, likelihood) for _ in range(MAX_KEPT)][-1:]  # equal ones come and go
    assert found == approx(apart)


def test_no_columns_at_all_are_columns_too():
    """A hypothesis whose scan leaves nothing to be looked at."""
    stand = whitened_data_set(CALM, runs([CIRCLE]))
    white, base = stand.at(6).white[0], stand.runs[0].base
    nothing = white.embed(base[:0])
    assert nothing.dot(white.embed(base[:2])).shape == (0, 2) and nothing.dot(nothing).shape == (0, 0)


def test_where_one_task_fails_nobody_waits_for_the_others(tmp_path):
    """They would end in a second."""
    done = tmp_path / "done"

    def late():
        time.sleep(1.0)
        done.touch()

    with pytest.raises(ZeroDivisionError):
        list(shared_out([lambda: 1 / 0, late], 2))
    assert not done.exists()
