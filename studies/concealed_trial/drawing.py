"""Draws the cases of a trial: ship, runs, effects, and all that makes a recording less than ideal."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from itertools import cycle, islice
from typing import TypeVar

import numpy as np

from studies.concealed_trial.case import TrialCase
from studies.concealed_trial.effects import KINDS, NOISE, UNKNOWN, UNMODELLED, Kind
from studies.concealed_trial.helm import Run
from studies.concealed_trial.model_error import with_model_error
from studies.concealed_trial.motion import sail
from studies.concealed_trial.ships import TrialShip, trial_ships
from studies.concealed_trial.strength import STEP, STRENGTHS, draw_effect, in_range

SHARES = {"none": 0.20, "single": 0.50, "pair": 0.12, UNKNOWN: 0.18}
"""How many cases of each sort a trial has."""
CUBIC = ("Xuvv", "Xudd", "Xuvr", "Yvrd", "Yuur", "Yrrd", "Nvrd", "Nuuv", "Nvvr", "Nuud")
"""Small terms of which one is missing from the model in every case; the last three letters are its factors."""

Item = TypeVar("Item")
ATTEMPTS, TRIES = 4, 3
"""A case whose ship is thrown out of its range gets smaller errors of the coefficients, then is drawn again."""


@dataclass(frozen=True)
class CasePlan:
    """What a case is to be before anything is drawn.

    Attributes:
        ship: Name of the ship.
        kinds: Kinds of the effects.
        strengths: How strong they are to be.
    """

    ship: str
    kinds: tuple[Kind, ...]
    strengths: tuple[str, ...]


def plans(seed: int, cases: int) -> list[CasePlan]:
    """What the cases of a trial are to be: sorts by their shares, names, strengths and ships in turn.

    Args:
        seed: Seed of the trial.
        cases: How many.

    Returns:
        One plan a case, in random order.
    """
    rng = np.random.default_rng([seed, 0])
    sorts = _by_share(cases)
    listed, other = _shuffled_cycle(rng, KINDS), _shuffled_cycle(rng, UNMODELLED)
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
        found.append(CasePlan(ship, kinds, tuple(next(strengths) for _ in kinds)))
    return [found[k] for k in rng.permutation(cases)]


def _by_share(cases: int) -> list[str]:
    """Sorts of cases, as near to their shares as whole numbers allow."""
    counts = {sort: int(share * cases) for sort, share in SHARES.items()}
    by_rest = sorted(SHARES, key=lambda sort: -(SHARES[sort] * cases - counts[sort]))
    for sort in islice(cycle(by_rest), cases - sum(counts.values())):
        counts[sort] += 1
    return [sort for sort, count in counts.items() for _ in range(count)]


def _shuffled_cycle(rng: np.random.Generator, items: Sequence[Item]) -> Iterator[Item]:
    """All items in random order, again and again."""
    while True:
        for k in rng.permutation(len(items)):
            yield items[k]


def salt_of(seed: int, index: int) -> str:
    """Salt of a case's commitment.

    Args:
        seed: Seed of the trial.
        index: Number of the case.

    Returns:
        64 hexadecimal digits.
    """
    return sha256(np.random.default_rng([seed, 2, index]).bytes(32)).hexdigest()


def case_name(seed: int, index: int) -> str:
    """Name of a case, which tells nothing.

    Args:
        seed: Seed of the trial.
        index: Number of the case.

    Returns:
        ``c`` and six hexadecimal digits.
    """
    return "c" + sha256(f"name {salt_of(seed, index)}".encode()).hexdigest()[:6]


def draw_case(seed: int, index: int, plan: CasePlan, nuisance: float = 1.0) -> TrialCase:
    """Draw one case.

    Args:
        seed: Seed of the trial.
        index: Number of the case.
        plan: What it is to be.
        nuisance: Size of what is wrong with the model in every case, clean ones too; 0 leaves the model exact.

    Returns:
        The case; the same for the same arguments.
    """
    for attempt in range(ATTEMPTS):
        case = _drawn(seed, index, attempt, plan, nuisance)
        for _ in range(TRIES):
            if _stays_in_range(case):
                return case
            case = replace(case, chance=case.chance + 1, coefficient_sd=0.7 * case.coefficient_sd)
    return case


def _stays_in_range(case: TrialCase) -> bool:
    """Whether all runs of a case stay where the equations hold, tried with large steps."""
    with np.errstate(all="ignore"):
        track = sail(with_model_error(case, np.random.default_rng(case.chance)), case.runs, step=STEP)
    return in_range(case.ship, track.state, case.runs)


def _drawn(seed: int, index: int, attempt: int, plan: CasePlan, nuisance: float) -> TrialCase:
    """One case as it is drawn first; the salt has stream 2 for itself."""
    rng = np.random.default_rng([seed, 1 + 2 * attempt, index])
    salt = salt_of(seed, index)
    ship = trial_ships()[plan.ship]
    runs = draw_runs(rng, ship)
    drawn = [draw_effect(rng, ship, k, s, runs) for k, s in zip(plan.kinds, plan.strengths, strict=True)]
    noise = {channel: sd * float(rng.uniform(0.8, 1.3)) for channel, sd in NOISE.items()}
    return TrialCase(
        name=case_name(seed, index),
        ship=ship,
        runs=runs,
        effects=tuple(effect for effect, _ in drawn),
        measures=tuple(measure for _, measure in drawn),
        coefficient_sd=nuisance * float(rng.uniform(0.03, 0.06)),
        cubic=(str(rng.choice(CUBIC)), nuisance * 0.05 * float(rng.standard_normal())),
        model_error_size=nuisance * 0.02,
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
    wanted: list[tuple[str, str, str | None]] = [("fit", turn, first), ("fit", zigzag, str(rng.choice(sides)))]
    wanted += [("held_out", str(rng.choice([turn, *turns])), other), ("held_out", str(rng.choice(zigzags)), other)]
    rest: list[tuple[str, str, str | None]]
    rest = [("fit", "spiral", None)] if "spiral" in ship.manoeuvres_s and rng.uniform() < 0.15 else []
    rest += [(split, str(rng.choice(turns + zigzags)), str(rng.choice(sides))) for split in ("fit", "held_out")]
    wanted += rest[: count - 4]
    runs = []
    for number, k in enumerate(rng.permutation(len(wanted)), start=1):
        split, manoeuvre, side = wanted[k]
        duration = int(ship.manoeuvres_s[manoeuvre])
        runs.append(Run(f"r{number:02d}", split, manoeuvre, side, float(rng.integers(1, 361)), duration))
    return tuple(runs)
