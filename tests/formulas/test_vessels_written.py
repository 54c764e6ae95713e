"""Ships with effects as formulas: what an effect's own code computes, written down."""

import json

import numpy as np
import pytest
import sympy
import torch
from fleet import unchecked
from models import joined
from onnx import load_from_string

from manoeuvre_nn.commands.groups import option, options
from manoeuvre_nn.commands.shelves import build
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.formulas.check import largest_difference
from manoeuvre_nn.formulas.code import python_text
from manoeuvre_nn.formulas.formats import write_down
from manoeuvre_nn.formulas.models import to_program
from manoeuvre_nn.formulas.onnx_graph import onnx_bytes
from manoeuvre_nn.formulas.program import Builder, Quantity
from manoeuvre_nn.formulas.tracing import Trace
from manoeuvre_nn.network.perceptron import rajesh_network
from manoeuvre_nn.ship.esso_190k import esso_190k
from manoeuvre_nn.ship.known import clarke_part
from manoeuvre_nn.ship.mariner import mariner

MOVING = (
    "bank", "bow_thruster", "current", "displacement_change", "formula", "hull_fouling", "ice_resistance", "loading",
    "propeller_pitch_error", "propeller_side_force", "remainder", "roll_coupling", "rudder_area_loss", "rudder_stall",
    "shallow_water", "side_force", "slipstream", "squat", "thrust_loss", "tidal_current", "tow", "trim_change",
    "wave_drift", "wind_onset", "wind_steady",
)  # fmt: skip
"""Effects that act on the motion itself; gusts are drawn by chance."""


@pytest.fixture(autouse=True)
def without_checks_of_types():
    with unchecked():
        yield


def acting(name: str, ship, **values):
    return build({**option("effect", name), **values}, "effect", ship=ship)


def written(name: str, ship=None, **values):
    ship = ship or mariner()
    return to_program(Vessel(CalmWater(ship), [acting(name, ship, **values)]))


@pytest.mark.parametrize("name", MOVING)
def test_what_an_effect_does_is_written_down_at_any_of_its_values(name):
    program = written(name)
    assert largest_difference(program, "onnx", onnx_bytes(program)) < 1e-10


@pytest.mark.parametrize("name", sorted(set(options("effect")) - set(MOVING) - {"wind_gusty"}))
def test_what_acts_on_gear_engine_or_sensors_is_refused(name):
    with pytest.raises(InputError, match=f"effect.{name} acts on (the steering gear|the engine|a sensor), which is no"):
        written(name)


def test_an_effect_by_chance_is_refused_with_the_reason():
    with pytest.raises(InputError, match="effect.wind_gusty cannot be exported: it uses remainder of torch"):
        written("wind_gusty")


def test_what_a_person_may_change_of_an_effect_is_an_input_and_its_form_is_not():
    program = written("wind_steady", speed=12.0)
    changed = [q for q in program.inputs if q.parameter]
    assert [(q.name, q.unit, q.example) for q in changed] == [
        ("wind_steady_speed", "m/s", 12.0), ("wind_steady_from_deg", "deg", 90.0)
    ]  # fmt: skip
    assert "psi" in [q.name for q in program.inputs] and "x" not in [q.name for q in program.inputs]


def test_a_current_moves_the_water_and_not_the_ship_in_it():
    program = written("current", speed=0.8, toward_deg=30.0)
    names = [q.name for q in program.inputs]
    point = {**{q.name: q.example for q in program.inputs}, "u": 6.0, "v": -0.3, "r": 0.01, "delta": 0.2}
    found = dict(
        zip([q.name for q in program.outputs], program.reference(np.array([[point[n] for n in names]]))[0], strict=True)
    )
    calm = to_program(CalmWater(mariner())).reference(np.array([[6.0, -0.3, 0.01, 0.2]]))[0]
    assert found["c_N"] == pytest.approx(0.8 * np.cos(np.pi / 6)) and found["c_E"] == pytest.approx(0.4)
    assert [found[name] for name in ("udot", "vdot", "rdot")] == pytest.approx(calm.tolist(), rel=1e-12)
    assert "but for a current (speed=0.8 m/s" in " ".join(program.notes).lower()


def test_two_effects_on_a_network_act_together_and_one_on_the_inertia_changes_what_the_other_does():
    network, known = rajesh_network(4), clarke_part(mariner())
    model = joined(known, network).double()
    pair = [acting("wind_steady", known, speed=15.0), acting("shallow_water", known, depth_m=14.0)]
    program = to_program(Vessel(model, pair))
    assert largest_difference(program, "python", python_text(program)) < 1e-11
    assert sum(q.parameter for q in program.inputs) == 3


@pytest.mark.parametrize("kind", ["latex", "csv"])
@pytest.mark.parametrize("name", ["shallow_water", "wind_steady"])
def test_powers_of_functions_and_angles_stand_on_a_page_and_in_cells(name, kind):
    program = written(name, esso_190k())
    assert write_down(program, kind).difference < 1e-10


def test_the_metadata_of_a_graph_say_which_column_is_what():
    made = load_from_string(onnx_bytes(written("wind_steady")))
    said = {one.key: one.value for one in made.metadata_props}
    assert [one["name"] for one in json.loads(said["state"])] == ["u", "v", "r", "x", "y", "psi"]
    (rudder,) = json.loads(said["inputs"])
    assert rudder["unit"] == "rad" and "positive turns the ship to starboard" in rudder["meaning"]
    assert [one["unit"] for one in json.loads(said["rates"])][:3] == ["m/s^2", "m/s^2", "rad/s^2"]
    assert "psi clockwise from north" in said["axes"]


def test_an_operation_that_nobody_has_written_down_is_refused_not_guessed():
    build_of = Builder([Quantity("z", "-", "a number")], [])
    build_of.section("Here")
    with torch.no_grad(), Trace(build_of) as trace:
        z = trace.variable(torch.tensor([0.5], dtype=torch.float64), build_of.inputs)
        assert trace.formulas(2.0 * z + 1.0) == [2.0 * build_of.inputs[0] + 1.0]
        with pytest.raises(InputError, match="uses erf of torch, which has no formula here"):
            torch.erf(z)


def test_values_that_are_moved_about_stay_themselves():
    build_of = Builder([Quantity(name, "-", "a number") for name in "abc"], [])
    a, b, c = build_of.inputs
    with torch.no_grad(), Trace(build_of) as trace:
        z = trace.variable(torch.zeros(1, 3, dtype=torch.float64), [a, b, c])
        moved = torch.cat([z.T[1:], torch.nn.functional.pad(z, (1, 0)).T])[:, 0]
        assert trace.formulas(moved) == [b, c, sympy.Float(0.0), a, b, c]
