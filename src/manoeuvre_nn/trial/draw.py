"""Draws the cases of a trial: ship, runs, effects, and all that makes a recording less than ideal."""

from collections.abc import Sequence
from dataclasses import dataclass
from hashlib import sha256
from itertools import cycle, islice
from typing import Any

import numpy as np

from manoeuvre_nn.trial.effects import KINDS, NOISE, UNKNOWN, UNLISTED, Kind, kind_of
from manoeuvre_nn.trial.helm import Run
from manoeuvre_nn.trial.ships import TrialShip, trial_ships
from manoeuvre_nn.trial.size import STRENGTHS, draw_effect
from manoeuvre_nn.trial.world import Effect

SHARES = {"none": 0.20, "single": 0.50, "pair": 0.12, UNKNOWN: 0.18}
"""How many cases of each sort a trial has."""
CUBIC = ("Xvvr", "Xrrd", "Yvrd", "Yuvv", "Yurd", "Nvrd", "Nurr", "Nvvr", "Nuud")
"""Small terms of which one is missing from the model in every case; the last three letters are its factors."""


@dataclass(frozen=True)
class Plan:
    """What a case is to be before anything is drawn.

    Attributes:
        ship: Name of the ship.
        kinds: Kinds of the effects.
        strengths: How strong they are to be.
    """

    ship: str
    kinds: tuple[Kind, ...]
    strengths: tuple[str, ...]


@dataclass(frozen=True)
class Case:
    """A case with all that was drawn.

    Attributes:
        name: Looks random.
        ship: The ship.
        runs: The runs.
        effects: What is concealed.
        measures: Size of each effect in lengths, or in standard deviations for a sensor.
        coefficient_sd: Relative standard deviation of the coefficients.
        cubic: Name and size of the term that the model lacks.
        roughness: Size of the coloured force.
        noise: Standard deviation of each sensor's noise.
        latency: How late the GPS is [s].
        outliers: Share of samples that are outliers.
        chance: Seed of all series.
        salt: Salt of the commitment.
    """

    name: str
    ship: TrialShip
    runs: tuple[Run, ...]
    effects: tuple[Effect, ...]
    measures: tuple[float, ...]
    coefficient_sd: float
    cubic: tuple[str, float]
    roughness: float
    noise: dict[str, float]
    latency: float
    outliers: float
    chance: int
    salt: str

    def answers(self) -> dict[str, Any]:
        """What was concealed, as published when a set is opened.

        Returns:
            Case, ship, verdict and effects.
        """
        effects = [_published(e, m) for e, m in zip(self.effects, self.measures, strict=True)]
        verdict = "mismatch" if effects else "none"
        return {"case": self.name, "ship": self.ship.name, "verdict": verdict, "effects": effects}


def _published(effect: Effect, measure: float) -> dict[str, Any]:
    """One effect as published."""
    kind = kind_of(effect.name, effect.detail)
    return {
        "name": effect.name,
        "detail": effect.detail,
        "strength": effect.strength,
        "measure": float(f"{measure:.3g}"),
        "parameters": dict(effect.parameters),
        "equation": list(kind.accepted[0]),
        "equation_accepted": [list(place) for place in kind.accepted],
        "equivalent_names": list(kind.equivalent),
        "intervals": effect.intervals,
    }


def plans(seed: int, cases: int) -> list[Plan]:
    """What the cases of a trial are to be: sorts by their shares, names, strengths and ships in turn.

    Args:
        seed: Seed of the trial.
        cases: How many.

    Returns:
        One plan a case, in random order.
    """
    rng = np.random.default_rng([seed, 0])
    sorts = _by_share(cases)
    listed, other = _shuffled_cycle(rng, KINDS), _shuffled_cycle(rng, UNLISTED)
    strengths, ships = _shuffled_cycle(rng, STRENGTHS), _shuffled_cycle(rng, tuple(trial_ships()))
    found = []
    for sort in sorts:
        kinds: tuple[Kind, ...] = ()
        if sort == "single":
            kinds = (next(listed),)
        elif sort == UNKNOWN:
            kinds = (next(other),)
        elif sort == "pair":
            first = next(listed)
            second = next(k for k in listed if k.family != first.family and k.name not in first.equivalent)
            kinds = (first, second)
        ship = next(s for s in ships if all(not k.ships or s in k.ships for k in kinds))
        found.append(Plan(ship, kinds, tuple(next(strengths) for _ in kinds)))
    return [found[k] for k in rng.permutation(cases)]


def _by_share(cases: int) -> list[str]:
    """Sorts of cases, as near to their shares as whole numbers allow."""
    counts = {sort: int(share * cases) for sort, share in SHARES.items()}
    by_rest = sorted(SHARES, key=lambda sort: -(SHARES[sort] * cases - counts[sort]))
    for sort in islice(cycle(by_rest), cases - sum(counts.values())):
        counts[sort] += 1
    return [sort for sort, count in counts.items() for _ in range(count)]


def _shuffled_cycle(rng: np.random.Generator, items: Sequence[Any]) -> Any:
    """All items in random order, again and again."""
    while True:
        for k in rng.permutation(len(items)):
            yield items[k]


def draw_case(seed: int, index: int, plan: Plan, nuisance: float = 1.0) -> Case:
    """Draw one case.

    Args:
        seed: Seed of the trial.
        index: Number of the case.
        plan: What it is to be.
        nuisance: Size of what is wrong with the model in every case, clean ones too; 0 leaves the model exact.

    Returns:
        The case; the same for the same arguments.
    """
    rng = np.random.default_rng([seed, 1, index])
    salt = sha256(rng.bytes(32)).hexdigest()
    ship = trial_ships()[plan.ship]
    runs = draw_runs(rng, ship)
    drawn = [draw_effect(rng, ship, k, s, runs) for k, s in zip(plan.kinds, plan.strengths, strict=True)]
    noise = {channel: sd * float(rng.uniform(0.8, 1.3)) for channel, sd in NOISE.items()}
    return Case(
        name="c" + sha256(f"name {salt}".encode()).hexdigest()[:6],
        ship=ship,
        runs=runs,
        effects=tuple(effect for effect, _ in drawn),
        measures=tuple(measure for _, measure in drawn),
        coefficient_sd=nuisance * float(rng.uniform(0.03, 0.06)),
        cubic=(str(rng.choice(CUBIC)), nuisance * 0.05 * float(rng.standard_normal())),
        roughness=nuisance * 0.02,
        noise=noise,
        latency=float(rng.uniform(0.0, 0.5)),
        outliers=float(rng.choice([0.0, 0.0, 0.003])),
        chance=int(rng.integers(2**62)),
        salt=salt,
    )


def draw_runs(rng: np.random.Generator, ship: TrialShip) -> tuple[Run, ...]:
    """Four to six runs; a turn and a zigzag at least to fit, two at least held out.

    Args:
        rng: Source of chance.
        ship: The ship.

    Returns:
        The runs in random order.
    """
    count = int(rng.choice([4, 5, 6, 6, 6]))
    turns = [m for m in ship.manoeuvres_s if m.startswith("tc")]
    zigzags = [m for m in ship.manoeuvres_s if m.startswith("zz")]
    sides = ["port", "starboard"]
    first = str(rng.choice(sides))
    other = sides[first == "port"]
    turn, zigzag = str(rng.choice(turns)), str(rng.choice(zigzags))
    wanted = [("fit", turn, first), ("fit", zigzag, str(rng.choice(sides)))]
    wanted += [("held_out", str(rng.choice([turn, *turns])), other), ("held_out", str(rng.choice(zigzags)), other)]
    rest = [("fit", "spiral", None)] if "spiral" in ship.manoeuvres_s and rng.uniform() < 0.15 else []
    rest += [(split, str(rng.choice(turns + zigzags)), str(rng.choice(sides))) for split in ("fit", "held_out")]
    wanted += rest[: count - 4]
    runs = []
    for number, k in enumerate(rng.permutation(len(wanted)), start=1):
        split, manoeuvre, side = wanted[k]
        duration = int(ship.manoeuvres_s[manoeuvre])
        runs.append(Run(f"r{number:02d}", split, manoeuvre, side, float(rng.integers(1, 361)), duration))
    return tuple(runs)
