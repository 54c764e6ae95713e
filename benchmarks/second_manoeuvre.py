"""Whether the manoeuvre that is advised as the second one beats a 20/20 zigzag, and where it stands among all others.

    python benchmarks/second_manoeuvre.py [ship=mariner|esso_190k] [first=zz35] [seeds=0,1,2] [seconds=all] [members=16]
                                          [noise=0.005]

For every seed an ensemble is trained on the first manoeuvre and asked what to sail next, as scripts/excite.py does.
Then an ensemble is trained on first and second together for every second one, and sails the targets that are neither
of the two nor the 20/20 zigzag. Printed is the largest deviation over L from the ship's own track, mean of these
targets, of the second manoeuvre and of the 20/20 zigzag on the same targets. Where the first is a 20/20 zigzag, the
second is one to the other side. ``seconds=advised`` leaves out all but the advised one. ``noise`` is that of u, v and
r in all recordings, over the standard deviation of these channels in the first one.
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from network_physics import chosen

from manoeuvre_nn.core.manoeuvre import Manoeuvre
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.design.expected_error import DesignEffort, prospects
from manoeuvre_nn.dynamics.model import CalmWater, IdentifiedShip
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.manoeuvre.spiral import spiral
from manoeuvre_nn.manoeuvre.straight import random_rudder, straight
from manoeuvre_nn.manoeuvre.turning import pull_out, turning_circle
from manoeuvre_nn.manoeuvre.zigzag import mixed_zigzag, zigzag
from manoeuvre_nn.network.hull_rudder import HullRudder, HullRudderSettings
from manoeuvre_nn.scoring.score import score
from manoeuvre_nn.ship.esso_190k import esso_190k
from manoeuvre_nn.ship.known import clarke_part, no_part
from manoeuvre_nn.ship.mariner import mariner
from manoeuvre_nn.training.data import DataSettings, SimulatedData
from manoeuvre_nn.training.ensemble import steps_in_noise, train_ensemble


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
        return Setup(mariner(), clarke_part(mariner()), chosen("hull_rudder") | {"members": members})
    return Setup(esso_190k(), no_part(esso_190k()), chosen("hull_rudder_shaft") | {"members": members})


def candidates() -> list[Manoeuvre]:
    """What could be sailed.

    Returns:
        Those of conf/excite.yaml.
    """
    made = [zigzag(float(a)) for a in (5, 10, 15, 20, 25, 35)]
    made += [zigzag(20.0, 10.0), zigzag(35.0, 10.0), zigzag(10.0, 20.0), zigzag(20.0, first="port")]
    made += [turning_circle(a, side) for a in (10.0, 20.0, 35.0) for side in ("starboard", "port")]
    made += [mixed_zigzag(), mixed_zigzag([10.0, 20.0, 30.0])]
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


def noise_of(s: Setup, first: Manoeuvre, share: float) -> dict[str, float]:
    """Noise of u, v and r in proportion to a manoeuvre.

    Args:
        s: The setup.
        first: The manoeuvre.
        share: Noise over the standard deviation of a channel [-].

    Returns:
        Standard deviations by the names that ``data.noise`` has.
    """
    (run,) = roll_out(CalmWater(s.ship), [first])
    units = {"u": ("u", 1.0), "v": ("v", 1.0), "r_deg_s": ("r", DEGREE)}
    return {name: share * float(run[c].std()) / unit for name, (c, unit) in units.items()}


def recorded(s: Setup, manoeuvres: Sequence[Manoeuvre], noise: dict[str, float], seed: int) -> SimulatedData:
    """What is recorded.

    Args:
        s: The setup.
        manoeuvres: What is sailed.
        noise: As :func:`noise_of` has it.
        seed: Of the noise.

    Returns:
        Tuples and how they were formed.
    """
    data = SimulatedData(s.ship, s.known, manoeuvres, [straight(60.0)], settings=DataSettings(noise=noise, seed=seed))
    data.setup()
    return data


def trained(s: Setup, data: SimulatedData, seed: int) -> IdentifiedShip:
    """The ensemble that train.py would make of data.

    Args:
        s: The setup.
        data: What is recorded.
        seed: Of the first weights.

    Returns:
        The model.
    """
    return train_ensemble(
        s.known, HullRudder(HullRudderSettings(**s.network), seed=seed), data.tuples, exact=data.exact
    )


def compare(
    s: Setup, first: Manoeuvre, noise: dict[str, float], seed: int, which: str
) -> list[tuple[str, float, float, float]]:
    """One seed.

    Args:
        s: The setup.
        first: First manoeuvre.
        noise: Of all recordings.
        seed: Of all weights and of the noise.
        which: ``all`` or ``advised``.

    Returns:
        Second manoeuvre, expected gain, deviation, and that of the 20/20 zigzag on the same targets; advised one first.
    """
    usual = "zz20_port" if first.name == "zz20" else "zz20"
    alone = recorded(s, [first], noise, seed)
    possible = [m for m in candidates() if m.name not in {first.name, "zz20_port"} - {usual}]
    model, tuples = trained(s, alone, seed), alone.tuples
    record, steps = (None, None) if alone.exact else (alone.would_record, steps_in_noise(model, tuples))
    expected = prospects(model, tuples, possible, targets(), record=record, effort=DesignEffort(seed=seed, steps=steps))
    gains = dict(sorted(((p.manoeuvre, p.gain) for p in expected), key=lambda pair: -pair[1]))
    advised = next(iter(gains))
    truth = roll_out(CalmWater(s.ship), targets())
    deviations: dict[str, dict[str, float]] = {}
    for second in possible:
        if which == "all" or second.name in {advised, usual}:
            model = trained(s, recorded(s, [first, second], noise, seed), seed)
            runs = zip(roll_out(model, targets()), truth, strict=True)
            deviations[second.name] = {t.name: score(r, t, s.ship.particulars.length).dev_L for r, t in runs}
            mean = np.mean(list(deviations[second.name].values()))
            print(f"  seed {seed}: {first.name} and {second.name}: {mean:.5f} L", file=sys.stderr, flush=True)
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
    given = dict(a.partition("=")[::2] for a in arguments)
    name, which = given.get("ship", "mariner"), given.get("seconds", "all")
    first = zigzag(float(given.get("first", "zz35").removeprefix("zz")))
    s = setup(name, int(given.get("members", "16")))
    noise = noise_of(s, first, float(given.get("noise", "0")))
    both, seeds = list[tuple[float, float]](), [int(seed) for seed in given.get("seeds", "0,1,2").split(",")]
    for seed in seeds:
        rows = compare(s, first, noise, seed, which)
        print(f"\n{name}, first {first.name}, seed {seed}: advised {rows[0][0]}")
        print(f"{'second':<14}{'expected gain / L':>18}{'dev / L':>10}{'zz20 there':>12}{'ratio':>8}")
        for second, gain, own, usual in rows:
            print(f"{second:<14}{gain:18.4f}{own:10.5f}{usual:12.5f}{own / usual:8.2f}", flush=True)
        both.append(rows[0][2:])
        better = sum(own < rows[0][2] for _, _, own, _ in rows)
        print(f"the advised one is number {better + 1} of {len(rows)} that were tried")
    won = sum(own < usual for own, usual in both)
    own, usual = np.median(both, axis=0)
    print(f"\nThe advised second manoeuvre beats the 20/20 zigzag in {won} of {len(seeds)} seeds; medians", end=" ")
    print(f"{own:.5f} and {usual:.5f} L.")


if __name__ == "__main__":
    main(sys.argv[1:])
