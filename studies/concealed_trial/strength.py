"""How strong an effect is: by what it does to the predictions of the calm-water model, not by its physics."""

from collections.abc import Callable, Sequence
from math import log

import numpy as np

from studies.concealed_trial.effects import Kind
from studies.concealed_trial.events import draw_intervals
from studies.concealed_trial.helm import Run
from studies.concealed_trial.motion import replay, sail
from studies.concealed_trial.ships import TrialShip
from studies.concealed_trial.truth import ConcealedEffect, build

STRENGTHS = ("weak", "moderate", "strong", "extreme")
DRIFT = {"weak": (0.15, 0.5), "moderate": (0.6, 1.1), "strong": (1.4, 2.5), "extreme": (3.0, 8.0)}
"""RMS distance over length that the calm-water roll-outs then miss."""
SIGMAS = {"weak": (3.0, 5.0), "moderate": (8.0, 15.0), "strong": (20.0, 40.0), "extreme": (60.0, 300.0)}
"""Error of a sensor in standard deviations of its noise."""
LESS = 0.7
"""What is left of the wanted size at each further attempt, where the ship was thrown out of her range."""
WARMUP = 40
"""Roll-outs start here [s]."""
STEP = 1.0
"""Time step of the trials [s]."""


def deviation(ship: TrialShip, effect: ConcealedEffect, runs: Sequence[Run]) -> float:
    """How far calm-water roll-outs, driven by the recorded rudder, stray from the ship with the effect.

    Args:
        ship: The ship.
        effect: The effect; gusts are left out.
        runs: The runs.

    Returns:
        RMS distance over the samples of a run and over runs, in lengths; infinite if the ship is thrown out of the
        range in which its equations hold.
    """
    names = [run.name for run in runs]
    truth = build(ship, [effect], names)
    with np.errstate(all="ignore"):
        track = sail(truth, runs, step=STEP, settle=12.0)
        shown, calm = track.shown(truth.gear.delay), build(ship, [], names)
        start = track.state[WARMUP]
        rolled = replay(calm, start, track.t[WARMUP:], track.order[WARMUP:], shown[WARMUP:], step=STEP)
        if not in_range(ship, track.state, runs):
            return float("inf")
        square = np.sum((rolled[:, :2] - track.state[WARMUP:, :2]) ** 2, axis=1)
    parts = [square[: run.duration - WARMUP + 1, k].mean() for k, run in enumerate(runs)]
    return float(np.sqrt(np.mean(parts)) / ship.length)


def in_range(ship: TrialShip, states: np.ndarray, runs: Sequence[Run]) -> bool:
    """Whether the ships stayed where their equations hold.

    Args:
        ship: The ship.
        states: (times, 9, runs).
        runs: The runs; what is past their ends does not count.

    Returns:
        True if all kept moving ahead, without excessive drift or turning.
    """
    u, v, r = (np.nan_to_num(states[:, k], nan=1e9) for k in (3, 4, 5))
    good = (u > 0.2 * ship.speed) & (u < 1.7 * ship.speed) & (np.abs(v) < 0.8 * u)
    good &= np.abs(r) < 2 * ship.speed / ship.length
    return all(bool(good[: run.duration + 1, k].all()) for k, run in enumerate(runs))


def sized(measure: Callable[[float], float], target: float, low: float, high: float, trials: int = 6) -> float:
    """The size at which a growing measure meets its target, within bounds.

    Args:
        measure: What a size does.
        target: What is wanted.
        low: Smallest size.
        high: Largest size.
        trials: How many sizes are tried.

    Returns:
        The size.
    """
    size, floor, ceiling = (low * high) ** 0.5, low, high
    best, miss = size, float("inf")
    for _ in range(trials):
        found = measure(size)
        ratio = target / max(found, 1e-9)  # 0 if the ship was thrown out of the range
        if ratio > 0 and abs(log(ratio)) < miss:
            best, miss = size, abs(log(ratio))
        if miss < 0.1 or (size == high and ratio > 1):
            break
        floor, ceiling = (size, ceiling) if ratio > 1 else (floor, size)
        size *= ratio**0.7  # measures grow as the size to the power of 1/2 to 2
        if size >= ceiling == high:
            size = high
        elif not floor < size < ceiling:
            size = (floor * ceiling) ** 0.5
    return best


def strength_of(measured: float, sensor: bool) -> str:
    """The strength that a measured size amounts to.

    Args:
        measured: Lengths, or standard deviations for a sensor.
        sensor: Whether it is a sensor's.

    Returns:
        One of :data:`STRENGTHS`.
    """
    bounds = SIGMAS if sensor else DRIFT
    edges = [(bounds[a][1] * bounds[b][0]) ** 0.5 for a, b in zip(STRENGTHS, STRENGTHS[1:], strict=False)]
    return STRENGTHS[int(np.searchsorted(edges, measured))]


def draw_effect(
    rng: np.random.Generator, ship: TrialShip, kind: Kind, strength: str, runs: Sequence[Run], share: float = 1.0
) -> tuple[ConcealedEffect, float]:
    """One effect of the strength that is wanted, as far as its bounds allow.

    Args:
        rng: Source of chance.
        ship: The ship.
        kind: What kind.
        strength: How strong it is to be.
        runs: The runs.
        share: Of the size that is wanted.

    Returns:
        The effect with the strength that it has, and its measure.
    """
    extras = {key: float(rng.uniform(*span)) for key, span in kind.extras.items()}
    if "sign" in extras:
        extras["sign"] = float(np.sign(extras["sign"]) or 1.0)
    where, ramp = draw_intervals(rng, kind.confined, runs)

    def effect(size: float, label: str = strength) -> ConcealedEffect:
        parameters = {k: float(f"{v:.4g}") for k, v in kind.make(ship, size, extras).items()}
        return ConcealedEffect(kind.name, parameters, where, kind.detail, label, ramp)

    if kind.per_unit is not None:
        gain = kind.per_unit(ship)
        size = float(np.clip(share * rng.uniform(*SIGMAS[strength]) / gain, kind.low, kind.high))
        return effect(size, strength_of(size * gain, True)), size * gain
    target = share * float(rng.uniform(*DRIFT[strength]))
    size = sized(lambda s: deviation(ship, effect(s), runs), target, kind.low, kind.high)
    found = deviation(ship, effect(size), runs)
    return effect(size, strength_of(found, False)), found
