"""Do the bands of a series' members hold the truth where something pushed the ship that the model does not know?

    OMP_NUM_THREADS=1 python benchmarks/bands.py [seeds=10] [winds=0,8,15] [network=abkowitz] [learn_floor=true]
        [floor=1.0]

The Mariner's zz35 at 1 Hz, .5 % of noise, in a gusty wind of another direction and realisation for every seed, which
the model knows nothing of; judged in calm water. Share of the samples of u, v, r, from 20 s on, that lie between the
least and the largest of 16 members: 15/17 = .88 if the truth were one of their kind. Once with members drawn from the
covariance of noise alone, once, as ``fit=closed_loop`` does, from one as wide as stretches disagree. dev/L and floor:
medians.
"""

import sys
from dataclasses import replace

import numpy as np
import torch
from esso_osaka_closed_loop import settings
from noise import JUDGED, SHIP, recorded

from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.dynamics.members import sail_members
from manoeuvre_nn.dynamics.model import CalmWater, IdentifiedShip
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.dynamics.simulate import simulate
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.effect.wind import GustyWind
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.network.series import Series, SeriesSettings
from manoeuvre_nn.scoring.score import score
from manoeuvre_nn.ship.known import clarke_inertia_part
from manoeuvre_nn.training.closed_loop_fit import DEFAULT_SETTINGS, fit_series

FROM = 20.0
"""Time from which on samples count: before, all members do the same [s]."""


def sailed(wind: float, seed: int) -> Recording:
    """What is learnt from.

    Args:
        wind: Mean wind [m/s]; 0 is calm.
        seed: Of its direction, its gusts and the noise.

    Returns:
        The recording; the wind was not recorded.
    """
    ship = CalmWater(SHIP)
    if wind:
        origin = float(np.random.default_rng(seed).uniform(0, 360))
        ship = Vessel(ship, [GustyWind(SHIP, speed=wind, from_deg=origin, seed=seed)])
    truth = simulate(ship, replace(zigzag(35.0), duration=360.0))
    known = {k: c for k, c in truth.channels.items() if "wind" not in k}
    return recorded(replace(truth, channels=known), 0.005, 0.5, seed)


def held(model: IdentifiedShip, truth: list[Recording]) -> list[float]:
    """Share of what happened that lies in the band.

    Args:
        model: With members.
        truth: What happened, manoeuvre by manoeuvre.

    Returns:
        Share of the samples of u, v and r, a number a manoeuvre [-].
    """
    shares = []
    for run, members in zip(truth, sail_members(model, JUDGED), strict=True):
        late = run.time >= FROM
        inside = []
        for k in ("u", "v", "r"):
            said = np.array([np.interp(run.time, m.time, m[k]) for m in members])
            inside.append(((run[k] >= said.min(0)) & (run[k] <= said.max(0)))[late])
        shares.append(float(np.mean(inside)))
    return shares


def main(arguments: list[str]) -> None:
    """Measure and print.

    Args:
        arguments: See the module.
    """
    usual = {"seeds": "10", "winds": "0,8,15", "network": "abkowitz", "learn_floor": "true", "floor": "1"}
    given = usual | dict(a.partition("=")[::2] for a in arguments)
    floor = tuple(float(given["floor"]) * f for f in DEFAULT_SETTINGS.floor)
    noise_settings = replace(DEFAULT_SETTINGS, floor=floor, learn_floor=given["learn_floor"] == "true")
    truth = roll_out(CalmWater(SHIP), JUDGED)
    print("| wind, m/s | dev/L of zz20, tc25, tc10 | floor | of noise alone | widened |\n|---|---|---|---|---|")
    for wind in map(float, given["winds"].split(",")):
        rows: dict[str, list[list[float]]] = {"dev": [], "floor": [], "plain": [], "wide": []}
        for seed in range(int(given["seeds"])):
            network = Series(SeriesSettings(**settings(given["network"], wind=False)))
            model, found = fit_series(network, clarke_inertia_part(SHIP), [sailed(wind, seed)], settings=noise_settings)
            pairs = zip(roll_out(model, JUDGED), truth, strict=True)
            rows["dev"].append([score(a, b, SHIP.particulars.length).dev_L for a, b in pairs])
            rows["floor"].append([float(found.floor[0] / DEFAULT_SETTINGS.floor[0])])
            rows["wide"].append(held(model, truth))
            network.take(torch.as_tensor(found.values), torch.as_tensor(found.covariance))
            rows["plain"].append(held(model, truth))
        dev, least = (" ".join(f"{v:.2f}" for v in np.median(rows[k], axis=0)) for k in ("dev", "floor"))
        plain, wide = (" ".join(f"{v:.2f}" for v in np.mean(rows[k], axis=0)) for k in ("plain", "wide"))
        print(f"| {wind:g} | {dev} | {least} | {plain} | {wide} |", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
