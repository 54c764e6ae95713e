"""The next step of a recursive network, written down: the same as the network's, and the same manoeuvres."""

from functools import cache

import numpy as np
import pytest
import torch
from pytest import approx

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.dynamics.recursive import RecursiveShip
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.effect.current import Current
from manoeuvre_nn.formulas import rollouts
from manoeuvre_nn.formulas.check import load_python, sample
from manoeuvre_nn.formulas.code import python_text
from manoeuvre_nn.formulas.formats import write_down
from manoeuvre_nn.formulas.models import to_program
from manoeuvre_nn.formulas.recursive_step import ship_by_steps
from manoeuvre_nn.formulas.rollouts import sailed
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.network.recursive import RecursiveNetwork
from manoeuvre_nn.network.recursive_settings import RecursiveSettings
from manoeuvre_nn.ship.naval_vessel import naval_vessel

SHIP = naval_vessel()
TRIALS = zigzag(20.0, duration=40.0), turning_circle(25.0, duration=40.0)
SHAPES = {
    "symmetric, three": {"hidden": (5, 4), "freedom": 3},
    "wind beside": {"hidden": (4, 3), "freedom": 4, "wind": True},
    "wind through, six, no biases": {
        "hidden": (4,), "freedom": 6, "wind": True, "wind_nodes": True, "symmetric": False, "biases": False,
        "about_last": False, "past": 3,
    },
    "two large tables of the same numbers": {"hidden": (30, 8), "freedom": 3, "past": 1},
    "long memory of thrust": {"hidden": (3,), "past": 3, "past_thrust": 3},
}  # fmt: skip


@pytest.fixture(autouse=True)
def short(monkeypatch):
    """What is sailed for the comparison, shorter: these networks turn so little that the rudder moves only once."""
    monkeypatch.setattr(rollouts, "TRIALS", TRIALS)


def ship_by(seed: int = 1, **shape) -> RecursiveShip:
    """A ship that goes by a network of weights and scalings from anywhere."""
    network = RecursiveNetwork(RecursiveSettings(**shape), seed=seed, dtype=torch.float64)
    draw = torch.Generator().manual_seed(seed)
    with torch.no_grad():
        network.shift.normal_(0.0, 0.1, generator=draw)
        network.scale.uniform_(0.5, 1.5, generator=draw)
        network.half_range.uniform_(0.2, 0.6, generator=draw)
        network.middle[0] = 0.8
        if network.links is not None:
            network.links.normal_(0.0, 0.3, generator=draw)
    return RecursiveShip(SHIP, network)


@cache
def program_and_runs(shape: str):
    program = to_program(ship_by(**SHAPES[shape]))
    return program, sailed(program)


EVERY_KIND = "wind through, six, no biases"
"""The shape of most parts, of which every kind of text is made; of the others what is run fastest, the rest slowly."""
SYMMETRIC = "symmetric, three"
"""As the two large tables are."""


def by_default(shape: str, kind: str) -> bool:
    return shape == EVERY_KIND or (kind == "python" and shape != SYMMETRIC)


@pytest.mark.parametrize(
    "shape, kind",
    [
        pytest.param(shape, kind, marks=() if by_default(shape, kind) else pytest.mark.slow)
        for shape in SHAPES
        for kind in ("python", "c", "csv", "latex", "onnx")
    ],
)
def test_what_is_written_takes_the_networks_steps_and_sails_its_manoeuvres(shape, kind):
    program, runs = program_and_runs(shape)
    assert not program.gives_rates
    made = write_down(program, kind, runs=runs)
    assert made.difference is not None
    assert made.difference < 1e-12
    if kind in {"python", "c", "onnx"}:
        assert [d.manoeuvre for d in made.deviations] == ["zz20", "tc25"]
        assert max(d.largest for d in made.deviations) < 1e-9


def test_the_runs_that_are_compared_are_those_of_the_ship_herself():
    model = ship_by(**SHAPES["wind beside"])
    own, written = roll_out(model, TRIALS), sailed(to_program(model))
    for one, other in zip(own, written, strict=True):
        assert other["x"] == approx(one["x"], abs=1e-9)
        assert other["psi"] == approx(one["psi"], abs=1e-12)


def test_a_wrong_weight_is_seen_in_the_tracks():
    program = to_program(ship_by(**SHAPES["symmetric, three"]))
    text = python_text(program).replace("u_next = ", "u_next = 1.01 * ", 1)
    run = load_python(program, text)
    (zigzag, _), (own, _) = roll_out(ship_by_steps(program, run), TRIALS), sailed(program)
    count = min(len(zigzag), len(own))
    assert np.hypot(zigzag["x"][:count] - own["x"][:count], zigzag["y"][:count] - own["y"][:count]).max() > 1.0


def test_units_are_si_and_the_range_is_that_of_the_training():
    model = ship_by(**SHAPES["wind beside"])
    program, network, p = to_program(model), model.network, model.particulars
    given = {q.name: q for q in program.inputs}
    k = network.input_names.index("r-0")
    mean, sd = float(network.shift[k]), float(network.scale[k])
    assert [given["r"].low, given["r"].high] == approx(np.array([mean - 2 * sd, mean + 2 * sd]) * p.speed / p.length)
    assert (given["n_port"].unit, given["delta_port"].high) == ("1/s", approx(p.rudder_limit))
    units = {q.name: q.unit for q in program.outputs}
    assert units.keys() >= {"dt", "u_next", "phi_next", "psi_next", "lift_port_0", "wind_N_0"}
    assert [units[f"{k}_next"] for k in ("u", "v", "r", "phi", "psi")] == ["m/s", "m/s", "rad/s", "rad", "rad"]
    # A step of .09 L/U takes as long as it does at the speed of the last outputs.
    points = sample(program, 5)
    columns = dict(zip(given, points.T, strict=True))
    step = dict(zip([q.name for q in program.outputs], program.reference(points).T, strict=True))
    assert step["dt"] == approx(0.09 * p.length / np.hypot(columns["u"], columns["v"]))


@pytest.mark.parametrize("kind", ["fmu", "gazebo", "mss"])
def test_formats_of_rates_and_forces_refuse_a_ship_that_goes_by_steps(kind):
    with pytest.raises(InputError, match=f"format={kind} is for .*recursive network"):
        write_down(to_program(ship_by(hidden=(3,))), kind)


def test_effects_are_refused():
    with pytest.raises(InputError, match="goes from step to step by itself: leave effects out"):
        to_program(Vessel(ship_by(hidden=(3,)), [Current(SHIP, speed=1.0)]))
