"""Wang 1996, section 5.3: what is computed: networks, regressions of their g, and zigzags with the coefficients."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import torch

from manoeuvre_nn.core.prime import PrimeSystem
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.scaling import Scaling
from manoeuvre_nn.dynamics.base import Model
from manoeuvre_nn.dynamics.model import CalmWater, IdentifiedShip
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.network.perceptron import Perceptron, wang_network
from manoeuvre_nn.numerics.damping import Stops
from manoeuvre_nn.numerics.one_hidden import OneHidden
from manoeuvre_nn.numerics.restarts import minimise
from manoeuvre_nn.recording.tuples import Tuples, to_tuples
from manoeuvre_nn.ship.known import clarke_part
from manoeuvre_nn.ship.mariner import INERTIA as OWN_INERTIA
from manoeuvre_nn.ship.mariner import mariner
from manoeuvre_nn.ship.taylor import TaylorShip
from studies.reproduction.section import ComputingEffort, Say
from studies.wang1996.derivatives import Estimates, Regression, si_unit, taylor_regression
from studies.wang1996.printed_coefficients import INERTIA, RHO, ROWS, SLIPS, SURGE_RR
from studies.wang1996.published_networks import published_network
from studies.wang1996.stepwise import Rules

RECORD, REGRESSED = 360.0, 300.0
"""Length of the zigzag that networks learn from and of the one that is regressed [s]: sections 4.4.1 and 5.3."""
THESIS_TERMS = {e: [r.term for r in (*ROWS, SURGE_RR) if r.equation == e and r.regression] for e in "XYN"}
"""Terms that the thesis kept."""
ZZ15 = zigzag(15.0)

Values = Mapping[str, Mapping[str, float]]


@dataclass(frozen=True)
class RegressedForces:
    """A regression of g and what it says of the whole forces.

    Attributes:
        regression: The regression of g.
        clarke: Whole forces with Clarke's inertia, as the thesis has them.
        own: Brought to the ship's own inertia.
    """

    regression: Regression
    clarke: Estimates
    own: Estimates


@dataclass(frozen=True)
class Study:
    """Everything that is computed.

    Attributes:
        ship: The Mariner.
        known: Clarke's part.
        runs: zz35 of the ship, of the published networks and of each trained one, 300 s.
        exact: Regression of the ship's own g.
        published: Of the published networks' g on the terms that the thesis kept.
        eliminated: Of the same by backward elimination.
        trained: Of the g of each of our networks.
        networks: Our networks with Clarke's part.
    """

    ship: TaylorShip
    known: TaylorShip
    runs: Sequence[Recording]
    exact: RegressedForces
    published: Regression
    eliminated: Regression
    trained: Sequence[RegressedForces]
    networks: Sequence[IdentifiedShip]


def study(effort: ComputingEffort, say: Say) -> Study:
    """Simulate, train and regress.

    Args:
        effort: How much computing it may take.
        say: Tells what is being done.

    Returns:
        The study.
    """
    ship = mariner()
    known = clarke_part(ship)
    say("35-35 zigzag of the Mariner, regressed")
    (record,) = roll_out(CalmWater(ship), [zigzag(35.0, duration=RECORD)])
    exact = record.between(0.0, REGRESSED)
    say(f"{3 * _starts(effort)} networks by Levenberg-Marquardt for g1, g2, g3")
    networks = _trained(known, to_tuples([record], known), effort)
    trial = zigzag(35.0, duration=REGRESSED)
    say("their 35-35 zigzags, regressed")
    (paper,) = roll_out(_published(known), [trial])
    ours = [run for network in networks for run in roll_out(network, [trial])]
    tuples: list[Tuples] = [to_tuples([r], known) for r in (exact, paper, *ours)]
    return Study(
        ship,
        known,
        [exact, paper, *ours],
        _found(ship, known, tuples[0]),
        taylor_regression(tuples[1], known, terms=THESIS_TERMS, rules=Rules("all")),
        taylor_regression(tuples[1], known),
        [_found(ship, known, t) for t in tuples[2:]],
        networks,
    )


def _found(ship: TaylorShip, known: TaylorShip, tuples: Tuples) -> RegressedForces:
    """Backward elimination at p < .05, and both inertias."""
    made = taylor_regression(tuples, known)
    return RegressedForces(made, made.estimates(), made.estimates(ship.inertia))


def _starts(effort: ComputingEffort) -> int:
    return min(effort.starts, 3) if effort.quick else effort.starts


def _plain_scaling() -> Scaling:
    """Inputs as the thesis has them; its rudder is positive to port."""
    sign = torch.tensor([1.0, 1.0, 1.0, -1.0], dtype=torch.float64)
    return Scaling(torch.zeros_like(sign), sign, torch.ones(3, dtype=torch.float64))


def _published(known: TaylorShip) -> IdentifiedShip:
    return IdentifiedShip(known, published_network("mariner"), _plain_scaling())


def _trained(known: TaylorShip, tuples: Tuples, effort: ComputingEffort) -> list[IdentifiedShip]:
    """Three 4-11-1 networks for each start, all of them in one batch."""
    starts = [wang_network(seed=effort.seed + k) for k in range(_starts(effort))]
    first = torch.cat([torch.cat([w.detach().flatten(1) for w in n.parameters()], dim=1) for n in starts])
    inputs = _plain_scaling().inputs(tuples.inputs)
    targets = tuples.targets.T[:, :, None].repeat(len(starts), 1, 1)
    problem = OneHidden(inputs, targets, 11)
    found = minimise(problem, first, stops=Stops(epochs=300 if effort.quick else 1000)).weights
    filled = [_filled(network, w) for network, w in zip(starts, found.split(3), strict=True)]
    return [IdentifiedShip(known, network, _plain_scaling()) for network in filled]


def _filled(network: Perceptron, weights: torch.Tensor) -> Perceptron:
    """The network with these weights."""
    sizes = [p[0].numel() for p in network.parameters()]
    with torch.no_grad():
        for parameter, values in zip(network.parameters(), weights.split(sizes, dim=1), strict=True):
            parameter.copy_(values.reshape(parameter.shape))
    return network.requires_grad_(False)


def sailed(study: Study) -> dict[str, list[Recording]]:
    """A 15-15 zigzag with every set of coefficients, and with the networks themselves.

    Args:
        study: Regressions and networks.

    Returns:
        Name -> runs, more than one for our networks.
    """
    clarke = {key: value for _, key, value, _ in INERTIA.values()}
    printed = _thesis_values(corrected=False), _thesis_values(corrected=True)
    ships: dict[str, Model] = {
        "original coefficients": CalmWater(study.ship),
        "thesis, as printed": CalmWater(_with(study.known, clarke, printed[0])),
        "thesis, slips corrected": CalmWater(_with(study.known, clarke, printed[1])),
        "ours, exact g": CalmWater(_with(study.ship, OWN_INERTIA, _values(study.exact.own))),
        "published networks": _published(study.known),
    }
    runs = {name: roll_out(ship, [ZZ15]) for name, ship in ships.items()}
    ours = [CalmWater(_with(study.ship, OWN_INERTIA, _values(f.own))) for f in study.trained]
    runs["ours, networks' g"] = [run for ship in ours for run in roll_out(ship, [ZZ15])]
    runs["our networks"] = [run for network in study.networks for run in roll_out(network, [ZZ15])]
    return runs


def _with(ship: TaylorShip, inertia: Mapping[str, float], values: Values) -> TaylorShip:
    """A Mariner with other coefficients."""
    return TaylorShip(ship.particulars, inertia, values, positive_rudder_turns_to="port", prime=ship.prime)


def _values(estimates: Estimates) -> dict[str, dict[str, float]]:
    return {e: {t: x.value for t, x in terms.items()} for e, terms in estimates.items()}


def _thesis_values(*, corrected: bool) -> dict[str, dict[str, float]]:
    """The fifth column; corrected, with what the regression values make of the slips and with X_rr."""
    prime = thesis_prime()
    values: dict[str, dict[str, float]] = {e: {} for e in "XYN"}
    for row in ROWS:
        values[row.equation][row.term] = row.estimated
    if corrected:
        for equation, term in SLIPS:
            row = next(r for r in ROWS if (r.equation, r.term) == (equation, term))
            values[equation][term] = row.regression / si_unit(prime, equation, term)
        values["X"]["rr"] = SURGE_RR.regression / si_unit(prime, "X", "rr")
    return values


def thesis_prime() -> PrimeSystem:
    """The thesis' prime system with the density that its tables were made with.

    Returns:
        The system.
    """
    ship = mariner()
    return replace(ship.prime, mass=ship.prime.mass * RHO / ship.particulars.rho)
