"""Units of co-simulation: valid, and the model, whoever steps them."""

import io
import shutil
import zipfile
from functools import cache

import numpy as np
import pytest
from fleet import unchecked
from fmpy import extract, read_model_description, simulate_fmu
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave
from fmpy.validation import validate_fmu
from models import model
from test_vessels_written import acting
from tiers import mainly

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.manoeuvre import Manoeuvre, Stage
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.formulas import check, formats, rollouts
from manoeuvre_nn.formulas.fmu import UNITS, fmu_bytes, signals_of
from manoeuvre_nn.formulas.formats import write_down
from manoeuvre_nn.formulas.models import to_program
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.ship.mariner import mariner

compiled = pytest.mark.skipif(
    not any(shutil.which(name) for name in check.COMPILERS), reason="no compiler of C is installed"
)
ORDERS = Manoeuvre("orders", "zigzag", (Stage(0.35, hold=20.0), Stage(-0.2)), duration=60.0)


@cache
def program(*effects: str):
    ship = mariner()
    return to_program(Vessel(CalmWater(ship), [acting(name, ship) for name in effects]))


@pytest.fixture(autouse=True)
def without_checks_of_types():
    with unchecked():
        yield


@pytest.fixture(scope="module")
def unit(tmp_path_factory):
    """The file of the Mariner in a wind and a current."""
    path = tmp_path_factory.mktemp("fmu") / "mariner.fmu"
    with unchecked():
        path.write_bytes(fmu_bytes(program("wind_steady", "current")))
    return path


@pytest.fixture
def started(unit, tmp_path):
    """``started("one")`` is an instance in a run, and its value references."""
    description = read_model_description(str(unit))
    folder = extract(str(unit), str(tmp_path / "unit"))
    places = {v.name: v.valueReference for v in description.modelVariables}
    made = []

    def instance(name: str, **values: float) -> FMU2Slave:
        one = FMU2Slave(
            guid=description.guid, unzipDirectory=folder, instanceName=name,
            modelIdentifier=description.coSimulation.modelIdentifier,
        )  # fmt: skip
        one.instantiate()
        begin(one, **values)
        made.append(one)
        return one

    def begin(one: FMU2Slave, **values: float) -> None:
        one.setupExperiment(startTime=0.0)
        one.setReal([places[name] for name in values], list(values.values()))
        one.enterInitializationMode()
        one.exitInitializationMode()

    instance.places, instance.begin = places, begin
    yield instance
    for one in made:
        one.freeInstance()


def position(one: FMU2Slave, places: dict[str, int]) -> list[float]:
    return one.getReal([places["x"], places["y"], places["psi"]])


def test_units_that_are_made_of_others_have_their_dimensions():
    speed, mass = UNITS["m/s"], {"kg": 1}
    acceleration = {**speed, "s": speed["s"] - 1}
    assert UNITS["kN"] == {**mass, **acceleration, "factor": 1000.0}
    assert UNITS["m/s per hour"] == {**acceleration, "factor": pytest.approx(1 / 3600)}
    assert UNITS["deg"]["factor"] * 360 == UNITS["rev/min"]["factor"] * 60 == pytest.approx(2 * np.pi)


@compiled
def test_a_unit_is_valid_and_its_variables_have_units_signs_and_starts(unit):
    assert validate_fmu(str(unit)) == []
    described = read_model_description(str(unit))
    known = {v.name: v for v in described.modelVariables}
    assert {v.name for v in described.modelVariables if v.causality == "output"} == set("u v r x y psi delta n".split())
    assert (
        known["delta_order"].causality == "input" and "positive turns to starboard" in known["delta_order"].description
    )
    assert float(known["u"].start) == mariner().particulars.speed and known["u"].unit == "m/s"
    assert {known[n].variability for n in ("rudder_rate", "wind_steady_speed", "current_toward_deg")} == {"tunable"}
    degrees = next(u for u in described.unitDefinitions if u.name == "deg")
    assert degrees.baseUnit.factor == pytest.approx(np.pi / 180)


@compiled
@pytest.mark.parametrize(
    "effects", mainly(2, [("wind_steady", "current"), ("roll_coupling", "propeller_side_force"), ()])
)
def test_fmpy_sails_the_models_track(effects, tmp_path):
    path = tmp_path / "ship.fmu"
    made = program(*effects)
    path.write_bytes(fmu_bytes(made))
    (run,) = roll_out(made.vessel, [ORDERS])
    orders = np.array(
        [(0.0, 0.35), (20.0, 0.35), (20.0, -0.2), (60.0, -0.2)], dtype=[("time", float), ("delta_order", float)]
    )
    found = simulate_fmu(str(path), stop_time=60.0, output_interval=1.0, input=orders)
    for name in ("u", "v", "r", "x", "y", "psi", "delta"):
        np.testing.assert_allclose(found[name], run[name], rtol=1e-9, atol=1e-9)


@compiled
def test_two_instances_at_once_do_not_know_of_each_other_and_one_is_set_back(started):
    places = started.places
    one, other = started("one"), started("other")
    one.setReal([places["delta_order"]], [0.3])
    for now in range(30):
        one.doStep(float(now), 1.0)
        other.doStep(float(now), 1.0)
    turned = position(one, places)
    assert turned[2] > 0.2 and abs(position(other, places)[2]) < 0.1
    one.terminate()
    one.reset()
    started.begin(one)
    assert position(one, places) == [0.0, 0.0, 0.0]
    one.setReal([places["delta_order"]], [0.3])
    for now in range(30):
        one.doStep(float(now), 1.0)
    assert position(one, places) == turned


@compiled
def test_a_state_that_was_kept_is_gone_back_to_also_by_another_instance(started):
    places, one = started.places, started("one")
    one.setReal([places["delta_order"]], [0.3])
    one.doStep(0.0, 20.0)
    kept = one.getFMUState()
    one.doStep(20.0, 20.0)
    later = position(one, places)
    one.setFMUState(kept)
    one.doStep(20.0, 20.0)
    assert position(one, places) == later
    bytes_of = one.serializeFMUState(kept)
    other = started("other")
    other.setFMUState(other.deserializeFMUState(bytes_of))
    other.doStep(20.0, 20.0)
    assert position(other, places) == later


@compiled
def test_what_cannot_be_done_is_an_error_and_no_crash(started):
    places, one = started.places, started("one")
    with pytest.raises(FMICallException):
        one.setReal([places["step"]], [0.1])  # in a run
    with pytest.raises(FMICallException):
        one.setReal([places["n"]], [90.0])
    with pytest.raises(FMICallException):
        one.setReal([len(places) + 7], [1.0])
    with pytest.raises(FMICallException):
        one.setReal([places["wind_steady_speed"]], [-3.0])
    with pytest.raises(FMICallException):
        one.setReal([places["delta_order"]], [float("nan")])
    with pytest.raises(FMICallException):
        one.doStep(0.0, 0.0)
    one.doStep(0.0, 1.0)
    assert position(one, places)[0] > 0
    with pytest.raises(FMICallException):
        started("fast", u=1000.0)


@compiled
def test_a_wind_that_is_changed_in_a_run_acts_from_then_on_and_the_rudder_stops_at_its_limit(started):
    places, calm, windy = (
        started.places,
        started("calm", wind_steady_speed=0.0),
        started("windy", wind_steady_speed=0.0),
    )
    for one in (calm, windy):
        one.setReal([places["delta_order"]], [2.0])
        one.doStep(0.0, 40.0)
    assert position(calm, places) == position(windy, places)
    assert calm.getReal([places["delta"]]) == pytest.approx([mariner().particulars.rudder_limit])
    windy.setReal([places["wind_steady_speed"]], [25.0])
    for one in (calm, windy):
        one.doStep(40.0, 40.0)
    assert abs(position(calm, places)[1] - position(windy, places)[1]) > 1.0


@compiled
def test_a_unit_that_would_sail_elsewhere_is_never_given_away(monkeypatch):
    monkeypatch.setattr(rollouts, "TRIALS", (zigzag(20.0, duration=20.0),))
    assert write_down(program("current"), "fmu").deviations[0].largest < 1e-12
    wrong = fmu_bytes(to_program(CalmWater(mariner())))
    monkeypatch.setitem(formats.WRITERS, "fmu", lambda made: wrong)
    with pytest.raises(RuntimeError, match="sails zz20 .* L beside the model"):
        write_down(program("hull_fouling"), "fmu")


def test_without_a_compiler_a_unit_holds_its_sources_alone(monkeypatch):
    monkeypatch.setattr(check, "COMPILERS", ())
    made = write_down(program(), "fmu")
    with zipfile.ZipFile(io.BytesIO(made.content)) as archive:
        assert sorted(archive.namelist()) == [
            "modelDescription.xml", "sources/accelerations.c", "sources/fmi2.h", "sources/fmu.c", "sources/model.h"
        ]  # fmt: skip
    assert made.deviations == []


def test_the_same_model_is_the_same_file_and_another_has_another_guid(unit):
    (first, again), other = (fmu_bytes(program()) for _ in range(2)), unit.read_bytes()
    assert first == again
    texts = [zipfile.ZipFile(io.BytesIO(one)).read("modelDescription.xml").decode() for one in (first, other)]
    assert len({text.partition('guid="')[2][:38] for text in texts}) == 2


def test_a_network_that_takes_shaft_and_wind_has_them_as_inputs():
    signals = {s.quantity.name: s for s in signals_of(to_program(model("modulus")))}
    assert signals["n_order"].kind == signals["w_N"].kind == signals["w_E"].kind == "input"
    assert signals["n_order"].quantity.unit == "rev/min" and signals["n_order"].quantity.example > 10
    approach = {s.quantity.name: s for s in signals_of(to_program(model("abkowitz")))}
    assert approach["p"].kind == "fixed" and approach["p"].quantity.example == 1.0


def test_a_response_is_no_system_over_time():
    with pytest.raises(InputError, match="a response is no system over time, and .* write format=c"):
        fmu_bytes(to_program(model("response")))
