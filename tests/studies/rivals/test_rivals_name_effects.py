import importlib.util
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from fleet import unchecked
from rival_runs import CALM, SHIP, case_with, sailed
from tiers import mainly

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.diagnosis.answers import answer
from manoeuvre_nn.effect.current import Current
from manoeuvre_nn.effect.local import SideForce
from manoeuvre_nn.effect.propulsion import HullFouling, IceResistance
from manoeuvre_nn.effect.rudder import RudderOffset
from manoeuvre_nn.effect.sensors import HeadingBias, LogScale
from manoeuvre_nn.effect.wind import GustyWind, SteadyWind
from manoeuvre_nn.estimation.hypothesis import Hypothesis
from studies.concealed_trial.rivals import sindy
from studies.concealed_trial.rivals.events import TIMES, placed
from studies.concealed_trial.rivals.methods import METHODS, judge
from studies.concealed_trial.rivals.package import shelf
from studies.concealed_trial.rivals.result import Limits, diagnosis
from studies.concealed_trial.rivals.search import LONG, fitted, gusts
from studies.concealed_trial.rivals.whitened import WhitenedRuns

ROOT = Path(__file__).parents[3]
LIMITS = Limits(12.0, 6.0)
PLAIN = ("regression", "pysindy")
NEEDS = {"pysindy": "pysindy", "sample_split": "sklearn", "structural": "faultdiagnosistoolbox"}
FEW = (Current, HullFouling, IceResistance, RudderOffset, HeadingBias, LogScale)
OFFSET = (RudderOffset, (("offset_deg", 1.5),))
LOG = (LogScale, (("factor", 1.06),))


@pytest.fixture(autouse=True)
def quick():
    with unchecked():
        yield


def judged(method, *kinds):
    if method in NEEDS:
        pytest.importorskip(NEEDS[method])
    case = case_with(*kinds)
    found = judge(case, method, [kind(SHIP) for kind in FEW])
    return case, found, answer(diagnosis(case, found, LIMITS))


@pytest.mark.slow  # the unlisted one, below, takes the same way
@pytest.mark.parametrize("method", PLAIN)
def test_an_offset_is_named_sized_and_helps_on_held_out_runs(method):
    _, _, said = judged(method, OFFSET)
    first = said["effects"][0]
    assert (said["verdict"], first["name"], said["model"]) == ("mismatch", "rudder_offset", ["rudder_offset"])
    value, error, unit = first["parameters"]["offset_deg"]
    assert 0 < error < 0.2
    assert value == pytest.approx(-1.5, abs=2 * error)  # the answer's rudder is positive to port
    assert unit == "deg"
    assert said["heldout_rmse_after"]["pos"] < 0.2 * said["heldout_rmse_before"]["pos"]


@pytest.mark.slow
@pytest.mark.parametrize("method", PLAIN)
def test_two_effects_are_named_together(method):
    _, found, said = judged(method, OFFSET, LOG)
    assert {e["name"] for e in said["effects"][:2]} == {"rudder_offset", "log_scale"} == set(said["model"])
    assert found.evidence.gain > found.none.criterion - min(f.criterion for f in found.fits if len(f.names) == 1)


@pytest.mark.parametrize("method", mainly(1, ["structural", "pysindy", "sample_split", "regression"]))
def test_nothing_is_found_where_nothing_is(method):
    _, found, said = judged(method)
    assert (said["verdict"], said["model"]) == ("none", [])
    assert found.evidence.gain < 5.0
    assert said["heldout_rmse_after"] == said["heldout_rmse_before"]
    assert max(e["probability"] for e in said["effects"]) <= 0.1


def test_a_misfit_that_no_candidate_explains_is_unknown():
    case = case_with(OFFSET)
    found = judge(case, "regression", [IceResistance(SHIP), LogScale(SHIP)])
    said = answer(diagnosis(case, found, Limits(12.0, 4.5)))
    assert (said["verdict"], said["effects"][0]["name"], said["model"]) == ("mismatch", "unknown", ["unknown"])


def test_slopes_of_a_hypothesis_are_those_of_what_it_leaves():
    data = WhitenedRuns(CALM, sailed(noise=0.0))
    fouling, offset = HullFouling(SHIP), RudderOffset(SHIP)

    def left(a: float, b: float):
        return data.evaluate(Hypothesis((fouling, offset), (np.full((2, 1), a), np.full((2, 1), b)), TIMES))

    here, slopes = left(0.2, 0.7)
    for k, there in enumerate((left(0.21, 0.7), left(0.2, 0.71))):
        np.testing.assert_allclose((there[0] - here) / 0.01, slopes[..., k], atol=0.02 * np.abs(slopes).max())


def test_a_fit_finds_the_least_squares_solution_of_a_linear_effect():
    data = WhitenedRuns(CALM, sailed([IceResistance(SHIP, force_kN=80.0)]))
    ice = IceResistance(SHIP)
    found = fitted(data, Hypothesis((ice,), (np.full((2, 1), 20.0),), TIMES), *LONG)
    white, slope = data.evaluate(found.hypothesis)
    weight = 1 / (1 + (white**2).mean(axis=0))
    assert abs((weight * slope[..., 0] * white).sum()) < 0.05 * np.sqrt((weight * slope[..., 0] ** 2).sum())
    assert found.hypothesis.values[0][0, 0] == pytest.approx(80.0, abs=3 * np.sqrt(found.spread[0, 0]))


@pytest.mark.slow
def test_times_of_a_side_force_are_found_and_a_run_without_it_has_none():
    event = SideForce(SHIP, force_kN=250.0, lever_m=20.0, start_s=150.0, end_s=280.0)
    runs = [sailed([event])[0], sailed(seed=3)[1]]
    start = SideForce(SHIP, force_kN=100.0, lever_m=20.0)
    table, gain = placed(WhitenedRuns(CALM, runs), Hypothesis((), ()), start, start.values.numpy())
    assert table[0, 2:4] == pytest.approx([150.0, 280.0], abs=12.0)
    assert table[1, 2] == 7000.0
    assert table[0, 0] == pytest.approx(250.0, rel=0.25)
    assert gain > 50.0


@pytest.mark.slow
def test_gusts_are_read_off_a_wind_speed_that_scatters():
    data = WhitenedRuns(CALM, sailed([SteadyWind(SHIP, speed=12.0, from_deg=40.0)], seed=20))
    wind = Hypothesis(
        (SteadyWind(SHIP),), (np.tile(SteadyWind(SHIP, speed=12.0, from_deg=40.0).values, (2, 1)),), TIMES
    )
    steady = fitted(data, wind, *LONG)
    assert gusts(data, steady, GustyWind(SHIP)).criterion > steady.criterion
    slope = data.evaluate(steady.hypothesis)[1][..., 0]
    blown = slope * 4.0 * np.random.default_rng(0).standard_normal((len(slope), 1))
    found = gusts(data, replace(steady, left=steady.left + blown), GustyWind(SHIP))
    assert found.criterion < steady.criterion
    assert found.names == ("wind_gusty",)


def test_sparse_regression_finds_the_terms_that_made_a_signal():
    pytest.importorskip("pysindy")
    rng = np.random.default_rng(0)
    columns = rng.standard_normal((300, 8))
    target = columns[:, [1]] * 2.0 - columns[:, [6]] + rng.standard_normal((300, 1))
    found = sindy.sparse(columns, target)
    assert np.flatnonzero(found).tolist() == [1, 6]
    assert found[[1, 6]] == pytest.approx([2.0, -1.0], abs=0.2)


def test_a_current_makes_harmonics_of_the_heading_in_the_log():
    pytest.importorskip("pysindy")
    terms = sindy.Terms(CALM, sailed([Current(SHIP, speed=0.5, toward_deg=0.0)]))
    found = dict(zip(sindy.TERMS, terms.found[3], strict=True))
    assert found["cos"] == pytest.approx(0.5 / SHIP.particulars.speed, rel=0.15)
    assert abs(found["sin"]) < 0.2 * abs(found["cos"])


def test_a_missing_pysindy_is_said_in_one_line(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pysindy", None)
    with pytest.raises(InputError, match=r'write pip install -e "\.\[rivals\]"'):
        sindy.sparse(np.eye(3), np.ones((3, 1)))


def test_the_shelf_is_what_a_trial_may_hide_and_a_loss_of_thrust():
    """The names of the trial's instructions."""
    assert {e.name for e in shelf(SHIP)} - {"thrust_loss"} == {
        *("wind_steady", "wind_gusty", "wind_onset", "current", "shallow_water", "wave_drift", "rudder_offset"),
        *("rudder_backlash", "rudder_slow", "rudder_delay", "rudder_area_loss", "propeller_side_force"),
        *("propeller_pitch_error", "power_limit", "hull_fouling", "ice_resistance", "displacement_change"),
        *("trim_change", "roll_coupling", "side_force", "bow_thruster", "heading_bias", "rate_bias", "log_scale"),
        "gps_lever_arm",
    }


@pytest.fixture(scope="module")
def script():
    spec = importlib.util.spec_from_file_location("rivals_script", ROOT / "scripts" / "rivals.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    "arguments, said",
    [
        (["speed=1"], "'speed=1' is not understood"),
        (["method=guess", "cases=a", "out=b"], "method"),
        (["cases=a"], "cases= or out= is missing"),
        (["calibrate=one"], "write whole numbers"),
        (["cases=.", "out=.", "limits=/nowhere.yaml"], "has none for regression"),
    ],
)
def test_wrong_settings_are_refused_in_a_line(script, arguments, said):
    with pytest.raises(InputError, match=said):
        script.main(arguments)


def test_limits_are_the_largest_values_of_the_clean_cases():
    known = yaml.safe_load((ROOT / "studies" / "concealed_trial" / "rivals" / "limits.yaml").read_text())
    assert set(known) <= set(METHODS)
    for row in known.values():
        assert len(row["reached"]) == row["clean"] >= 20
        assert [row["gain"], row["misfit"]] == np.max(row["reached"], axis=0).tolist()
