"""Whether the manoeuvre that is advised as the second one beats a 20/20 zigzag, and where it stands among all others.

    python benchmarks/second_manoeuvre.py [ship=mariner|esso_190k] [first=zz35] [seeds=0,1,2] [seconds=all] [members=16]

For every seed an ensemble is trained on the first manoeuvre and asked what to sail next, as scripts/excite.py does.
Then an ensemble is trained on first and second together for every second one, and sails the targets that are neither
of the two nor the 20/20 zigzag. Printed is the largest deviation over L from the ship's own track, mean of these
targets, of the second manoeuvre and of the 20/20 zigzag on the same targets. Where the first is a 20/20 zigzag, the
second is one to the other side. ``seconds=advised`` leaves out all but the advised one.
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from manoeuvre_nn.core.manoeuvre import Manoeuvre
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.dynamics.model import CalmWater, IdentifiedShip
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.identification.excitation import prospects
from manoeuvre_nn.manoeuvre.spiral import spiral
from manoeuvre_nn.manoeuvre.straight import random_rudder
from manoeuvre_nn.manoeuvre.turning import pull_out, turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.network.hull_rudder import HullRudder
from manoeuvre_nn.optimizer.restarts import Stops, minimise
from manoeuvre_nn.optimizer.semilinear import SemiLinear
from manoeuvre_nn.recording.score import score
from manoeuvre_nn.recording.tuples import Tuples, to_tuples
from manoeuvre_nn.ship.esso_190k import esso_190k
from manoeuvre_nn.ship.known import clarke_part, no_part
from manoeuvre_nn.ship.mariner import mariner
from manoeuvre_nn.training.scalings import make_scaling


@dataclass(frozen=True)
class Setup:
    """A ship, what is known of it, and what its network is.

    Attributes:
        ship: The ship.
        known: Known part of its forces.
        network: Settings of the ensemble.
    """

    ship: Ship
    known: Ship
    network: dict


def setup(name: str, members: int) -> Setup:
    """As conf/ship has it.

    Args:
        name: ``mariner`` or ``esso_190k``.
        members: Members of an ensemble.

    Returns:
        The setup.
    """
    if name == "mariner":
        return Setup(mariner(), clarke_part(mariner()), {"members": members})
    network = {"members": members, "speed_law": "shaft", "library": "quadratic"}
    return Setup(esso_190k(), no_part(esso_190k()), network)


def candidates() -> list[Manoeuvre]:
    """What could be sailed.

    Returns:
        Those of conf/excite.yaml.
    """
    made = [zigzag(float(a)) for a in (5, 10, 15, 20, 25, 35)]
    made += [zigzag(20.0, 10.0), zigzag(35.0, 10.0), zigzag(10.0, 20.0), zigzag(20.0, first="port")]
    made += [turning_circle(a, side) for a in (10.0, 20.0, 35.0) for side in ("starboard", "port")]
    return [*made, spiral(), pull_out(20.0), random_rudder()]


def targets() -> list[Manoeuvre]:
    """What is to be predicted.

    Returns:
        Those of conf/excite.yaml.
    """
    return [
        *(zigzag(a) for a in (10.0, 20.0)),
        *(turning_circle(a) for a in (10.0, 20.0, 25.0, 35.0)),
        turning_circle(25.0, "port"),
        spiral(),
    ]


def tuples_of(s: Setup, manoeuvres: Sequence[Manoeuvre]) -> Tuples:
    """What the ship would record, exactly.

    Args:
        s: The setup.
        manoeuvres: What is sailed.

    Returns:
        Samples.
    """
    return to_tuples(roll_out(CalmWater(s.ship), manoeuvres), s.known)


@torch.no_grad()
def trained(s: Setup, tuples: Tuples, seed: int) -> IdentifiedShip:
    """An ensemble by conf/fit/ensemble.yaml.

    Args:
        s: The setup.
        tuples: What it learns from.
        seed: Of the first weights.

    Returns:
        The model.
    """
    network = HullRudder(12, seed=seed, **s.network)
    model = IdentifiedShip(s.known, network, make_scaling(network.scalings[0], s.known, tuples))
    design = dict(vars(network.design(model.scaling.inputs(tuples.inputs))))
    problem = SemiLinear(design.pop("features"), model.scaling.outputs(tuples.targets), network.sees, **design)
    for k in range(network.members):
        start = network.drawn(k)[network.sees][None]
        best = minimise(problem, start, stops=Stops(epochs=150, min_fall=1e-4), at_once=1).weights
        network.input_weights[k], network.output_weights[k] = problem.full(best)[0], problem.output_weights(best)[0]
    network.trained.fill_(network.members)
    return model


def compare(s: Setup, first: Manoeuvre, seed: int, which: str) -> list[tuple[str, float, float, float]]:
    """One seed.

    Args:
        s: The setup.
        first: First manoeuvre.
        seed: Of all weights.
        which: ``all`` or ``advised``.

    Returns:
        Second manoeuvre, expected gain, deviation, and that of the 20/20 zigzag on the same targets; advised one first.
    """
    usual = "zz20_port" if first.name == "zz20" else "zz20"
    alone = tuples_of(s, [first])
    chosen = [m for m in candidates() if m.name not in {first.name, "zz20_port"} - {usual}]
    expected = prospects(trained(s, alone, seed), alone, chosen, targets())
    gains = dict(sorted(((p.manoeuvre, p.gain) for p in expected), key=lambda pair: -pair[1]))
    advised = next(iter(gains))
    truth = roll_out(CalmWater(s.ship), targets())
    deviations: dict[str, dict[str, float]] = {}
    for second in chosen:
        if which == "all" or second.name in {advised, usual}:
            model = trained(s, tuples_of(s, [first, second]), seed)
            runs = zip(roll_out(model, targets()), truth, strict=True)
            deviations[second.name] = {t.name: score(r, t, s.ship.particulars.length).dev_L for r, t in runs}
            mean = np.mean(list(deviations[second.name].values()))
            print(f"  seed {seed}: {first.name} and {second.name}: {mean:.4f} L", file=sys.stderr, flush=True)
    rows = []
    for second in sorted(deviations, key=lambda name: -gains[name]):
        left = [t.name for t in targets() if t.name not in {first.name, second, "zz20"}]
        means = [float(np.mean([deviations[name][t] for t in left])) for name in (second, usual)]
        rows.append((second, gains[second], *means))
    return rows


def main(arguments: list[str]) -> None:
    """Measure and print.

    Args:
        arguments: As above.
    """
    torch.set_num_threads(1)
    given = dict(a.split("=", 1) for a in arguments)
    name, which = given.get("ship", "mariner"), given.get("seconds", "all")
    first = zigzag(float(given.get("first", "zz35").removeprefix("zz")))
    s = setup(name, int(given.get("members", "16")))
    won, seeds = 0, [int(seed) for seed in given.get("seeds", "0,1,2").split(",")]
    for seed in seeds:
        rows = compare(s, first, seed, which)
        print(f"\n{name}, first {first.name}, seed {seed}: advised {rows[0][0]}")
        print(f"{'second':<14}{'expected gain / L':>18}{'dev / L':>10}{'zz20 there':>12}{'ratio':>8}")
        for second, gain, own, usual in rows:
            print(f"{second:<14}{gain:18.4f}{own:10.4f}{usual:12.4f}{own / usual:8.2f}", flush=True)
        won += rows[0][2] < rows[0][3]
        better = sum(own < rows[0][2] for _, _, own, _ in rows)
        print(f"the advised one is number {better + 1} of {len(rows)} that were tried")
    print(f"\nThe advised second manoeuvre beats the 20/20 zigzag in {won} of {len(seeds)} seeds.")


if __name__ == "__main__":
    main(sys.argv[1:])
