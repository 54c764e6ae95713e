"""The networks that Wang's thesis prints, three 4-11-1 networks for each of its two ships, read from wang1996.json."""

import json
from functools import cache
from importlib.resources import files
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.errors import check_choice
from manoeuvre_nn.network.perceptron import Perceptron

HIDDEN, INPUTS, NETWORKS = 11, 4, 3
"""Sigmoids of each network, its inputs (the bias not counted), and networks: one for each of g1, g2, g3."""

PublishedShip = Literal["mariner", "great_lakes_bulker"]
Reading = Literal["corrected", "printed"]


def published_network(ship: PublishedShip, reading: Reading = "corrected") -> Perceptron:
    """The weights of Tables 4.2 and 4.3 (Mariner) or A.6 and A.7 (bulk carrier).

    Inputs are u/U0, v/U0, rL/U0 and the rudder angle [rad], **positive to port** as in the thesis; row k gives
    ``g_k' = g_k / (.5 rho L T U0^2)``, for yaw over ``.5 rho L^2 T U0^2``: what Clarke's linear part leaves
    unexplained.

    The tables are mislabelled. The numbers stand in the order in which the training program of appendix B writes its
    file, B(1) ... B(12) and then W row by row, while the labels count W first. ``corrected`` takes the first 12 rows
    for B and the other 55 for W(11 x 5); ``printed`` believes the labels, with errors beyond 100 times g itself.

    Args:
        ship: ``mariner`` or ``great_lakes_bulker``.
        reading: ``corrected`` or ``printed``.

    Returns:
        Three 4-11-1 networks.

    Source:
        Wang 1996, Tables 4.2, 4.3, A.6 and A.7, eqs 2.1-2.4; appendix B for the order of the numbers.
    """
    check_choice("ship", ship, ["mariner", "great_lakes_bulker"])
    check_choice("reading", reading, ["corrected", "printed"])
    labels, numbers = printed_weights(ship)
    outer = [label.startswith("B") for label in labels]
    if reading == "corrected":
        outer = [row <= HIDDEN for row in range(len(labels))]
    mask = torch.tensor(outer)
    network = Perceptron((NETWORKS, INPUTS, HIDDEN, 1))
    with torch.no_grad():
        network.input_weights.copy_(numbers[~mask].T.reshape(NETWORKS, HIDDEN, INPUTS + 1))
        network.output_weights.copy_(numbers[mask].T.reshape(NETWORKS, 1, HIDDEN + 1))
    return network.requires_grad_(False)


@cache
def printed_weights(ship: PublishedShip) -> tuple[tuple[str, ...], Float[Tensor, "rows 3"]]:
    """A table as it is printed.

    Args:
        ship: ``mariner`` or ``great_lakes_bulker``.

    Returns:
        Labels from top to bottom (``W 1 1``, ..., ``B 12 1``) and the weights of g1, g2, g3 beside them.
    """
    rows = json.loads(files("studies.wang1996").joinpath("published_networks.json").read_text())[ship]["rows"]
    return tuple(label for label, *_ in rows), torch.tensor([row[1:] for row in rows], dtype=torch.float64)
