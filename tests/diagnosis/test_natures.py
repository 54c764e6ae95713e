"""What has no name is described: its kind, equation, size and time scale; what can be predicted is."""

import json
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from pytest import approx
from strangers import SHIP, STEP, Stranger, asked, calm_only, of, periodic, ramp, strange_runs
from tiers import mainly

from manoeuvre_nn.diagnosis.answers import answer
from manoeuvre_nn.diagnosis.causes import with_nature
from manoeuvre_nn.diagnosis.diagnose import diagnose
from manoeuvre_nn.diagnosis.result import Cause, Diagnosis, Nature, Value
from manoeuvre_nn.diagnosis.unknown import random_force
from manoeuvre_nn.diagnosis.words import nature_sentence
from manoeuvre_nn.effect.common import typical
from manoeuvre_nn.scoring.free_runs import cost

pytestmark = pytest.mark.usefixtures("unchecked_types", "few_draws")


def closed(d: Diagnosis) -> float:
    """Share of the error of free runs that is gone, the noise counted as what nobody can take away."""
    before, after = (cost([getattr(p, k) for p in d.proofs], SHIP.particulars) for k in ("rmse_before", "rmse_after"))
    left = cost([d.noise], SHIP.particulars)
    return (before - after) / (before - left)


def nature(d: Diagnosis) -> Nature:
    assert (d.verdict, d.unknown, d.causes[0].name) == ("mismatch", True, "unknown")
    found = d.causes[0].nature
    assert found is not None and d.statements[0] == nature_sentence(found)
    return found


def scale(found: Nature, name: str) -> Value:
    return next(v for v in found.scales if v.name == name)


@pytest.mark.slow  # a random one is found below, periods in test_periodograms.py
def test_a_periodic_yaw_moment_has_its_period_its_phase_and_its_amplitude():
    d = diagnose(asked(strange_runs(2, Stranger(0.15, "N", periodic(50.0)))))
    found = nature(d)
    assert (found.kind, found.equations, found.predictable) == ("periodic", ("N",), True)
    assert scale(found, "period").value == approx(50.0, rel=0.01) and found.against > 20
    assert abs((scale(found, "phase at the start").value + 180) % 360 - 180) < 10
    assert closed(d) > 0.8 and "periodic force in yaw" in d.sentence


@pytest.mark.slow
def test_a_periodic_yaw_moment_of_another_phase_in_each_run_has_its_period_and_its_amplitude():
    """In runs that were not used it is there, too: at a size and a phase that are taken from these."""
    d = diagnose(asked(strange_runs(2, Stranger(0.15, "N", periodic(50.0, 0.3, 2.2, 4.6)))))
    found = nature(d)
    assert (found.kind, found.equations, found.refuted) == ("periodic", ("N",), False)
    assert d.causes[0].terms[:2] == ("N cos periodic_by_run", "N sin periodic_by_run")
    (period,) = found.scales
    moment = float(SHIP.force_from_acceleration(0.15 * typical(SHIP) * torch.tensor([0.0, 0.0, 1.0]))[2])
    assert period.value == approx(50.0, abs=4 * period.error) and found.against > 20
    assert found.size.value == approx(moment * SHIP.prime.moment / 1e6, rel=0.1)
    cosine, sine = (d.causes[0].parameters[k].value for k in range(2))  # of the first run
    assert math.atan2(cosine, sine) == approx(0.3, abs=0.1)
    assert closed(d) > 0.8
    assert "with its own size and phase in each run" in d.sentence
    assert "with that, its size and phase taken from each run, the predicted" in d.sentence


@pytest.mark.slow  # seven seconds
def test_a_yaw_moment_that_grows_has_its_growth_a_minute():
    d = diagnose(asked(strange_runs(4, Stranger(0.2, "N", ramp))))
    found = nature(d)
    assert (found.kind, found.equations, found.frame, found.parity) == ("growing", ("N",), "body", "even")
    (growth,) = found.scales
    moment = float(SHIP.force_from_acceleration(0.2 * typical(SHIP) * torch.tensor([0.0, 0.0, 1.0]))[2])
    assert growth.unit == "MN m"
    assert growth.value == approx(moment * SHIP.prime.moment / 1e6 / 10, rel=0.15)
    assert closed(d) > 0.8 and "grows with time" in d.sentence


@pytest.mark.slow  # seven seconds
def test_a_side_force_that_follows_the_rudder_late_has_its_memory():
    d = diagnose(asked(strange_runs(3, Stranger(1.0, "Y", of("d"), lag=40.0), scatter=0.01)))
    found = nature(d)
    assert (found.kind, found.equations) == ("lagging", ("Y",))
    assert scale(found, "memory").value == approx(40.0, rel=0.25)
    assert closed(d) > 0.8 and "follows the motion late" in d.sentence


@pytest.mark.parametrize("time, seed", mainly(1, [(80.0, 7), (6.0, 7), (25.0, 7), (6.0, 8), (80.0, 8), (25.0, 8)]))
def test_a_random_yaw_moment_has_its_size_and_its_correlation_time(time, seed):
    """L/U0, at which its fit begins, is 20 s."""
    tried = calm_only(asked(strange_runs(seed, random=[(0.2, "N", time)], step=min(STEP, time / 3))))
    found = random_force(tried.likelihood, tried.none)
    assert found.axes == (2,) and found.evidence > tried.none.evidence + 7
    off = np.log([found.size / 0.2, found.time / time]) / found.errors
    assert np.abs(off).max() < 2.5 and found.errors[0] < 0.25 and found.errors[1] < 0.5


def test_what_cannot_be_predicted_is_said_to_be_so():
    random = Nature("random", ("N",), Value("standard deviation", 12.3, 2.1, "MN m"), predictable=False)
    said = nature_sentence(random)
    assert "a random force in yaw, standard deviation 12.3 ± 2.1 MN m; its course cannot be predicted" in said
    assert "log evidence against any formula" in said
    beats = Nature("periodic", ("N",), Value("amplitude", 8.0, 0.5, "MN m"), against=20.0, predictable=False)
    said = nature_sentence(beats)
    assert "its course cannot be predicted" in said and "log evidence against a random force +20" in said


def test_the_answer_holds_what_is_known_of_something_unknown():
    beats = Nature("periodic", ("N",), Value("amplitude", 8.0, 0.5, "MN m"), (Value("period", 50.0, 0.4, "s"),), 21.5)
    causes = [
        Cause(name, "", 0.9, 30.0, ("N",), (), None, "", "", nature=found)
        for name, found in (("unknown", beats), ("current", None))
    ]
    more = {"sentence": "", "doubtful": False, "noise": {}, "checks": []}
    d = SimpleNamespace(
        case="c1", verdict="mismatch", causes=causes, model=["unknown"], next_run=None, rmse=lambda when: {}, **more
    )
    unknown, current = json.loads(json.dumps(answer(d)))["effects"]
    assert unknown["nature"] == {
        "kind": "periodic", "equation": ["N"], "size": {"name": "amplitude", "value": [8.0, 0.5, "MN m"]},
        "scales": {"period": [50.0, 0.4, "s"]}, "log_evidence": 21.5, "predictable": True, "frame": None,
        "parity": None, "share_in_hard_helm": None,
    }  # fmt: skip
    assert "nature" not in current
    plain = replace(causes[0], equations=("X", "Y"), nature=None)
    of_log = replace(beats, kind="in an instrument", equations=("sensor:u_log",))
    for told, refuted, clearest, where in (
        (beats, False, ("Y",), ("N",)), (beats, True, ("Y",), ("Y",)), (beats, True, (), ("X", "Y")),
        (of_log, True, ("Y",), ("sensor:u_log",)),
    ):  # fmt: skip
        with_it = with_nature(plain, replace(told, refuted=refuted, clearest=clearest))
        assert with_it.equations == where
    assert with_nature(replace(plain, terms=("X r^2",)), beats).equations == ("X", "Y"), "its formula holds"
    causes[0] = replace(causes[0], nature=replace(beats, refuted=True))
    assert not answer(d)["effects"][0]["nature"]["predictable"], "it failed in runs that were not used"
