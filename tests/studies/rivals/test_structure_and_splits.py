from dataclasses import replace

import numpy as np
import pytest
from fleet import unchecked
from rival_runs import CALM, SHIP, case_with, sailed

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.diagnosis.answers import answer
from manoeuvre_nn.effect.current import Current
from manoeuvre_nn.effect.propulsion import IceResistance
from manoeuvre_nn.effect.sensors import LogScale, RateBias
from studies.concealed_trial.rivals import split, structural
from studies.concealed_trial.rivals.methods import judge
from studies.concealed_trial.rivals.package import shelf
from studies.concealed_trial.rivals.result import Limits, diagnosis
from studies.concealed_trial.rivals.sindy import TERMS
from studies.concealed_trial.rivals.track import ROWS
from studies.concealed_trial.rivals.whitened import WhitenedRuns

CURRENT = (Current, (("speed", 0.5), ("toward_deg", 70.0)))
FEW = (Current, IceResistance, RateBias, LogScale)


@pytest.fixture(autouse=True)
def quick():
    with unchecked():
        yield


def said(method, limits, *kinds):
    case = case_with(*kinds)
    found = judge(case, method, [kind(SHIP) for kind in FEW])
    return answer(diagnosis(case, found, limits))


def test_splits_find_the_terms_that_made_a_signal_and_no_others():
    pytest.importorskip("sklearn")
    rng = np.random.default_rng(0)
    x = rng.standard_normal((360, 30))
    x /= np.linalg.norm(x, axis=0)
    y = 9.0 * x[:, 4] - 8.0 * x[:, 21] + rng.standard_normal(360)
    assert np.flatnonzero(split.discoveries(x, y) <= split.LEVEL).tolist() == [4, 21]


def test_noise_is_no_discovery():
    pytest.importorskip("sklearn")
    rng = np.random.default_rng(1)
    x = rng.standard_normal((240, 20))
    least = [split.discoveries(x, rng.standard_normal(240)).min() for _ in range(6)]
    assert min(least) > split.LEVEL


def test_of_two_terms_that_look_alike_the_simpler_one_is_tested():
    first = np.repeat(np.eye(6), 3, axis=0) / np.sqrt(3)
    alike = first + 0.05 * np.roll(first, 1, axis=1)
    x = np.stack([first, alike / np.linalg.norm(alike, axis=0)], axis=-1).reshape(18, 12)
    assert split.distinct(x).tolist() == [0, 2, 4, 6, 8, 10]


@pytest.mark.slow
def test_a_current_is_named_by_the_harmonics_that_stand_the_tests():
    pytest.importorskip("sklearn")
    terms = split.TestedTerms(CALM, case_with(CURRENT).fitted)
    kept = [f"{row} {term}" for row in ROWS for term in TERMS]
    kept = [name for name, rate in zip(kept, terms.discovered, strict=True) if rate <= split.LEVEL]
    assert {"log cos", "log sin"} <= set(kept)
    first = said("sample_split", Limits(6.0, 6.0), CURRENT)["effects"][0]
    assert first["name"] == "current"
    assert first["parameters"]["speed"][0] == pytest.approx(0.5, abs=0.05)


def test_every_residual_is_computed_with_a_minimal_overdetermined_set():
    pytest.importorskip("faultdiagnosistoolbox")
    heard, wrong = structural.signatures()
    assert wrong == ()
    assert len(heard) == len(structural.generators()) == 15


def test_residuals_are_deaf_to_the_sensor_that_they_do_not_use():
    pytest.importorskip("faultdiagnosistoolbox")
    heard, _ = structural.signatures()
    for g, faults in zip(structural.generators(), heard, strict=True):
        if g.row < 3:
            assert ("flog" in faults, "fr" in faults) == (g.speed == "log", g.rate == "gyro"), g.name
    data = WhitenedRuns(CALM, sailed([LogScale(SHIP, factor=1.06)]), at_samples=True)
    loud = dict(zip(structural.generators(), structural.quantities_of(data), strict=True))
    assert max(q for g, q in loud.items() if g.row < 3 and g.speed == "gps") < 5.0
    assert next(q for g, q in loud.items() if g.name == "log") > 10.0


def test_every_effect_of_the_shelf_is_a_fault_that_some_residual_hears():
    pytest.importorskip("faultdiagnosistoolbox")
    heard = frozenset().union(*structural.signatures()[0])
    assert [e.name for e in shelf(SHIP) if not structural.faults_of(e) & heard] == []


def test_the_nearest_consistent_fault_mode_is_named():
    pytest.importorskip("faultdiagnosistoolbox")
    told = said("structural", Limits(6.0, 6.0), CURRENT)
    assert (told["verdict"], told["effects"][0]["name"]) == ("mismatch", "current")


def test_a_fault_far_from_every_class_is_unknown():
    pytest.importorskip("faultdiagnosistoolbox")
    case = case_with(CURRENT)
    found = judge(case, "structural", [IceResistance(SHIP), RateBias(SHIP)])
    assert found.verdict(Limits(6.0, 5.0)) == "unknown"
    assert replace(found, rest=4.0).verdict(Limits(6.0, 5.0)) == "named"


@pytest.mark.parametrize("method, module", [("structural", "faultdiagnosistoolbox"), ("sample_split", "sklearn")])
def test_what_is_missing_is_said_in_a_line(method, module, monkeypatch):
    structural.signatures.cache_clear()
    for name in (module, f"{module}.linear_model"):
        monkeypatch.setitem(__import__("sys").modules, name, None)
    with pytest.raises(InputError, match=r'write pip install -e "\.\[rivals\]"'):
        judge(case_with(CURRENT), method, [RateBias(SHIP)])
