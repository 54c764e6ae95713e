"""Rajesh & Bhattacharyya 2009, Table 2: the published network, the reading in which it gives g, and what it can do."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import Any, Literal

import numpy as np
import torch
from jaxtyping import Float

from manoeuvre_nn.core.scaling import Scaling
from manoeuvre_nn.dynamics.model import CalmWater, IdentifiedShip
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.network.perceptron import Activation, Perceptron, rajesh_network
from manoeuvre_nn.recording.tuples import to_tuples
from manoeuvre_nn.ship.esso_190k import esso_190k
from manoeuvre_nn.ship.known import no_part
from studies.rajesh2009.networks import (
    BEAM,
    Judged,
    Row,
    Setting,
    judged,
    networks,
    spread,
    starts,
    tracks,
)
from studies.reproduction.claims import read_claims
from studies.reproduction.section import ChapterResult, ComputingEffort, Plot, Say

# Rajesh & Bhattacharyya 2009, Table 2: w_ij, a row for each i = 1..14, j = 1..5 from left to right.
HIDDEN = [
    [-3.568962, -4.005345, -4.017699, 0.2009315, 1.182008],
    [3.871750, 3.661926, 3.379155, -0.1656121, -1.215289],
    [3.659958, 3.974254, 3.862647, -0.1905683, -1.190215],
    [-0.6328753, -6.234695, 2.215056, 0.1255864, 0.7215229],
    [-3.786115, -3.836915, -3.601639, 0.1759966, 1.203865],
    [-0.1227300, 4.008568, -3.830145, -0.3614829, 0.6761313],
    [-2.447549, -91.88007, 19.64835, 4.925855, 0.6008219],
    [13.94800, -47.27740, 1.485011, -0.9088713, 1.500057],
    [-0.7454310, -44.63654, -1.260485, 0.5852645, 0.3067825],
    [89.64103, -136.6122, 25.93242, -13.11627, -10.05362],
    [42.05385, 142.1548, 13.70088, 4.052687, -2.848397],
    [-31.53808, -159.9179, -36.13668, -4.840950, 1.952682],
    [-27.87451, -127.3056, 49.91106, 14.46869, -1.508715],
    [37.04911, -54.12690, 27.78480, 7.815652, 0.5351363],
]
# B_ki, a row for each i = 1..15, k = 1..3 from left to right.
OUTPUT = [
    [26.992349, -18.009630, 23.188122],
    [21.030902, -9.426320, 21.292630],
    [60.729661, -37.556650, 54.689902],
    [0.035510, 0.027862, -0.008043],
    [54.760059, -28.974281, 52.767782],
    [0.022237, -0.002362, 0.000548],
    [0.000025, 0.000607, -0.000277],
    [-0.000810, 0.012706, -0.003956],
    [0.000237, -0.005796, 0.001517],
    [-0.000014, -0.000195, 0.000069],
    [-0.000020, -0.000962, 0.000269],
    [-0.000061, -0.001733, 0.000561],
    [0.000004, -0.000190, 0.000032],
    [0.000072, 0.000919, -0.000276],
    [-0.025983, -0.021579, 0.030397],
]
Side = Literal["starboard", "port"]


@dataclass(frozen=True)
class Reading:
    """A way to read Table 2.

    Attributes:
        activation: ``sigmoid`` as eq 18 has it, or ``tanh``.
        bias: Whether the input 1 is the first as in eq 16, or the last.
        rudder: Side that the network's positive rudder turns to.
        first: Side of the first execute of the zigzag that it was trained on.
    """

    activation: Activation = "tanh"
    bias: Literal["first", "last"] = "last"
    rudder: Side = "port"
    first: Side = "port"


def published_network(reading: Reading | None = None) -> IdentifiedShip:
    """The tanker with the network of Table 2.

    Args:
        reading: How the table is read; by default the way that gives g: hyperbolic tangents, the weights of a node in
            the order u, v, r, delta, 1, delta positive to port.

    Returns:
        The identified ship; its rudder is positive to starboard, as everywhere in the package.

    Source:
        Rajesh & Bhattacharyya 2009, Table 2. Printed otherwise: eq 18 has logistic functions and eq 16 puts the bias
        first. ``tanh z = 2 / (1 + exp(-2 z)) - 1``, MATLAB's TANSIG, is odd: nodes 1 and 5 are nearly the negatives of
        2 and 3, and their output weights of up to 61 cancel only so.
    """
    reading = reading or Reading()
    net = rajesh_network(15, activation=reading.activation)
    first = torch.tensor(HIDDEN, dtype=torch.float64)
    if reading.bias == "first":
        first = first.roll(-1, 1)
    with torch.no_grad():
        net.input_weights.copy_(first[None])
        net.output_weights.copy_(torch.tensor(OUTPUT, dtype=torch.float64).mT[None])
    side = torch.tensor([1.0, 1.0, 1.0, -1.0 if reading.rudder == "port" else 1.0], dtype=torch.float64)
    plain = torch.zeros_like(side)
    return IdentifiedShip(no_part(esso_190k()), net, Scaling(plain, side, plain[:3] + 1.0))


def readings() -> Iterator[tuple[Reading, float, float]]:
    """Errors of Table 2 in every reading.

    Yields:
        Reading, mean square error of g over the zigzag that it names (the paper's tolerance), and the same with the
        output weights fitted anew to the printed hidden layer.
    """
    ship = esso_190k()
    known = no_part(ship)
    sides: tuple[Side, Side] = ("port", "starboard")
    trials = {side: roll_out(CalmWater(ship), [zigzag(20.0, first=side, duration=1500.0)]) for side in sides}
    for activation, bias, rudder, first in product(("tanh", "sigmoid"), ("last", "first"), sides, sides):
        reading = Reading(activation, bias, rudder, first)  # type: ignore[arg-type]
        model, tuples = published_network(reading), to_tuples(trials[first], known)
        x, y = model.scaling.inputs(tuples.inputs), tuples.targets
        with torch.no_grad():
            error = float((model.network(x) - y).square().mean())
            nodes = _nodes(model.network, x)
            again = torch.linalg.lstsq(nodes, y, driver="gelsd").solution
        yield reading, error, float((nodes @ again - y).square().mean())


def _nodes(net: torch.nn.Module, x: Float[torch.Tensor, "n 4"]) -> Float[torch.Tensor, "n nodes"]:
    """Hidden layer with its bias."""
    assert isinstance(net, Perceptron)
    sums = torch.cat([x, torch.ones_like(x[:, :1])], 1) @ net.input_weights[0].mT
    nodes = sums.tanh() if net.activation == "tanh" else sums.sigmoid()
    return torch.cat([nodes, torch.ones_like(nodes[:, :1])], 1)


def chapter(effort: ComputingEffort, say: Say) -> ChapterResult:
    """Table 2.

    Args:
        effort: How much computing is allowed.
        say: Told what is being done.

    Returns:
        The reading that holds, the published network in closed loop, and ours of the same make beside it.
    """
    claims = read_claims("rajesh2009", "T2")
    tolerance = claims.limits["tolerance_15"]
    say("Table 2 in every reading")
    tried = sorted(readings(), key=lambda found: found[1])
    sigmoid = next(found for found in tried if found[0].activation == "sigmoid")
    table = [
        {"function": r.activation, "weight of the 1": r.bias, "delta > 0 to": r.rudder, "first rudder to": r.first}
        | {"mse": e, "mse, B fitted anew": b}
        for r, e, b in tried
    ]
    say("published network in closed loop")
    trials = [zigzag(a, first="port", duration=2000.0 if a == 20.0 else 1500.0) for a in (20.0, 25.0, 15.0, 10.0)]
    trials += [turning_circle(a, "port") for a in (15.0, 20.0, 25.0)]
    published = judged([published_network()], trials)
    say(f"{starts(effort)} starts of tanh networks, m = 15, first rudder to port")
    ours = networks(Setting(manoeuvre=zigzag(20.0, first="port", duration=1500.0), activation="tanh"), effort)
    beside = judged(ours.models, trials)
    return ChapterResult(
        "Table 2: the published network",
        f"Read as tanh nodes with inputs u, v, r, delta, 1, the printed weights give g with a mean square error of "
        f"{tried[0][1]:.2g}, against a tolerance of {tolerance:.2g} in the paper; as eqs 16-18 are printed they give "
        f"{sigmoid[1]:.0f} at best. In closed loop the published network is {np.mean(published.dev):.2g} L off on "
        f"average, ours of that make {np.mean(np.median(beside.dev, 1)):.2g} L.",
        claims.beside(_values(tried, sigmoid[1], published, beside, ours.mse)),
        {
            "Table 2 in 16 readings, over zz20 of 1500 s": table,
            "Published network and ours of the same make, dev [L]": _beside(published, beside),
        },
        [
            Plot(
                "table_2_closed_loop",
                "The published network (Table 2, tanh) in the paper's manoeuvres, first rudder to port",
                [tracks(published, k, trial.name, "published network") for k, trial in enumerate(trials)],
            )
        ],
    )


def _values(
    tried: list[tuple[Reading, float, float]], sigmoid: float, published: Judged, beside: Judged, mse: np.ndarray
) -> dict[str, Any]:
    """Errors of Table 2 in its best readings, and deviations of the published network and of ours [L]."""
    best, error, _ = tried[0]
    names = [reference.name.removesuffix("_port") for reference in published.references]
    return {
        "sigmoid": sigmoid,
        "tanh": error,
        "rudder": best.rudder,
        "first": best.first,
        "mse": mse,
        "beam": BEAM,
        "published": dict(zip(names, published.dev[:, 0].tolist(), strict=True)),
        "same_make": dict(zip(names, np.median(beside.dev, axis=1).tolist(), strict=True)),
    }


def _beside(published: Judged, ours: Judged) -> list[Row]:
    rows: list[Row] = []
    for k, reference in enumerate(published.references):
        cells = spread(ours.dev[k], ours.left[k])
        rows.append({"manoeuvre": reference.name, "published": float(published.dev[k, 0])} | cells)
    return rows
