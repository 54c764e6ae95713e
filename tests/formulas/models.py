"""Models of every kind that is written down, with weights that are not trained: what the tests of the room share."""

from functools import cache
from math import pi

import torch
import yaml
from fleet import SHIPS

from manoeuvre_nn.core.data_files import CONF
from manoeuvre_nn.core.response import Quantities, Response, Variable
from manoeuvre_nn.core.scaling import Scaling
from manoeuvre_nn.core.units import DEGREE, KNOT
from manoeuvre_nn.dynamics.model import CalmWater, IdentifiedShip
from manoeuvre_nn.estimation.baselines import FittedProducts, own_part
from manoeuvre_nn.network.hull_rudder import HullRudder, HullRudderSettings
from manoeuvre_nn.network.perceptron import Perceptron, rajesh_network, wang_network
from manoeuvre_nn.network.radial import GeneralRegression, RadialBasis
from manoeuvre_nn.network.series import Series, SeriesSettings
from manoeuvre_nn.ship.esso_190k import esso_190k
from manoeuvre_nn.ship.known import clarke_inertia_part, clarke_part, given_part, no_part
from manoeuvre_nn.ship.mariner import mariner
from manoeuvre_nn.ship.taylor import TaylorForce

GIVEN = {"mx": 0.2, "my": 0.3, "mz": 0.02, "Yrdot": -0.01, "Nvdot": 0.003}
VARIABLES = (
    Variable("d", "m", 1.0, "draught", low=5.0, high=11.0),
    Variable("V", "kn", KNOT, "speed", low=0.0, high=20 * KNOT),
    Variable("beta", "deg", DEGREE, "heading to the waves", r"\beta", 0.0, pi),
    Variable("Hs", "m", 1.0, "significant wave height", "H_s", 2.0, 5.0),
    Variable("T", "s", 1.0, "mean period", low=6.5, high=14.5),
)
PITCH = Variable("pitch", "deg", DEGREE, "significant pitch amplitude", r"\psi_{1/3}")


def drawn(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def scaling(inputs: int = 4, outputs: int = 3, *, shifted: bool = False) -> Scaling:
    parts = 0.3 * drawn(inputs, seed=1), 0.5 + drawn(inputs, seed=2).abs(), 0.01 * (1 + drawn(outputs, seed=3).abs())
    return Scaling(*parts, drawn(outputs, seed=4)) if shifted else Scaling(*parts)


def ensemble(**options) -> HullRudder:
    network = HullRudder(HullRudderSettings(4, 3, **options), seed=3)
    network.output_weights.data.copy_(drawn(*network.output_weights.shape, seed=5))
    network.shaft.fill_(0.9)
    return network.requires_grad_(False)


def series(name: str) -> Series:
    """One of conf/network with coefficients and draws."""
    said = yaml.safe_load((CONF / "network" / f"{name}.yaml").read_text())["network"]
    made = Series(SeriesSettings(**{k: v for k, v in said.items() if k not in {"_target_", "scaling", "dtype"}}))
    made.take(drawn(len(made.names)), torch.eye(len(made.names), dtype=torch.float64))
    made.shaft.fill_(0.9)
    return made.requires_grad_(False)


def learnt(ship) -> FittedProducts:
    part = own_part(ship)
    part.table.copy_(drawn(*part.table.shape, seed=6))
    return part


SEES = ("d", "V", "cos_beta", "Hs", "T")


def response(network=None, per: str | None = None, sees: tuple[str, ...] = SEES, *, shifted: bool = True) -> Response:
    sees = tuple(one for one in sees if one != per)
    network = Perceptron((1, len(sees), 7, 1), "sigmoid", "normal", seed=2) if network is None else network
    quantities = Quantities(VARIABLES, PITCH, sees, per)
    return Response(network, scaling(len(sees), 1, shifted=shifted), quantities).requires_grad_(False)


def radial() -> RadialBasis:
    network = RadialBasis(5, 30, 1, seed=4)
    network.output_weights.copy_(drawn(1, 31, seed=7))
    network.widths.copy_(1.0 + drawn(30, seed=8).abs())
    return network


def regression(count: int = 110) -> GeneralRegression:
    network = GeneralRegression(5, 1)
    network.store(drawn(count, 5, seed=9), drawn(count, 1, seed=10), 0.3 + drawn(5, seed=11).abs())
    return network


NETWORKS = {
    "wang": lambda: wang_network(5, "tanh", "normal"),
    "rajesh": lambda: rajesh_network(6),
    "cubic": lambda: series("cubic"),
    "modulus": lambda: series("modulus"),
    "abkowitz": lambda: series("abkowitz"),
    "hull_rudder": lambda: ensemble(),
    "hull_rudder_odd": lambda: ensemble(symmetric=False, modular=False, library="quadratic"),
    "hull_rudder_shaft": lambda: ensemble(speed_law="shaft", library="quadratic"),
    "taylor": lambda: TaylorForce({"X": {"uu": 0.3}, "Y": {"vvr": -1.2, "d": 0.4}, "N": {"0": 0.1, "vrd": 2.0}}),
}
KNOWN = {
    "clarke": lambda: clarke_part(mariner()),
    "clarke_inertia": lambda: clarke_inertia_part(mariner()),
    "none": lambda: no_part(esso_190k()),
    "given": lambda: given_part(mariner(), GIVEN, {"X": {"u": -0.02}, "Y": {"v": -0.2, "vvd": 0.1}, "N": {"r": -0.05}}),
    "own": lambda: learnt(mariner()),
    "own_tanker": lambda: learnt(esso_190k()),
}


def joined(known, network) -> IdentifiedShip:
    return IdentifiedShip(known, network, scaling())


MAKERS = {
    **{name: lambda make=make: joined(clarke_part(mariner()), make()) for name, make in NETWORKS.items()},
    **{f"linear={name}": lambda make=make: joined(make(), rajesh_network(4)) for name, make in KNOWN.items()},
    **{name: lambda make=make: CalmWater(make()) for name, make in SHIPS.items()},
    "response": lambda: response(),
    "response over wave height": lambda: response(per="Hs"),
    "response over speed": lambda: response(per="V"),
    "response without a shift": lambda: response(shifted=False),
    "response by theory's inputs": lambda: response(sees=("d", "encounter_frequency", "wave_number_along", "cos_beta")),
    "radial basis": lambda: response(radial()),
    "general regression": lambda: response(regression()),
}


@cache
def model(name: str):
    return MAKERS[name]().double()
