"""Draws the cases of a trial: ship, runs, effects, and all that makes a recording less than ideal."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from itertools import cycle, islice
from typing import TypeVar

import numpy as np

from studies.concealed_trial.case import TrialCase
from studies.concealed_trial.channels import CHANNEL_SETS, shows
from studies.concealed_trial.effects import KINDS, NOISE, UNKNOWN, UNMODELLED, Kind
from studies.concealed_trial.helm import MANOEUVRE_START, Run
from studies.concealed_trial.model_error import with_model_error
from studies.concealed_trial.motion import sail
from studies.concealed_trial.ships import TrialShip, trial_ships
from studies.concealed_trial.strength import LESS, STEP, STRENGTHS, draw_effect, in_range

SHARES = {"clean": 0.20, "single": 0.44, "pair": 0.12, "triple": 0.06, UNKNOWN: 0.18}
"""How many cases of each sort a trial has."""
COUNT = {"clean": 0, "single": 1, "pair": 2, "triple": 3, UNKNOWN: 1}
"""Effects of each sort."""
RECORDERS = ("full",) * 6 + tuple(name for name in CHANNEL_SETS if name != "full")
HOLES = (True, False, False, False, False, False)
"""Channel sets, and cases in which a minute to three of one run are missing, by their shares."""
HOLE = (60, 180)
"""Length of a hole [s]."""
ALL = "all"
"""Every sort, strength or channel set, by its share."""
CUBIC = ("Xuvv", "Xudd", "Xuvr", "Yvrd", "Yuur", "Yrrd", "Nvrd", "Nuuv", "Nvvr", "Nuud")
"""Small terms of which one is missing from the model in every case; the last three letters are its factors."""

Item = TypeVar("Item")
ATTEMPTS, TRIES = 8, 3
"""Where a ship is thrown out of its range, the errors of the coefficients shrink; then all is drawn again, smaller."""


@dataclass(frozen=True)
class Trial:
    """What a trial is made from; all of it is needed again to open the answers.

    Attributes:
        seed: Seed.
        cases: How many.
        nuisance: Size of what is wrong with the model in every case; 0 leaves the model exact.
        sort: A key of :data:`SHARES`, or all.
        strength: One of the strengths, or all.
        channels: A channel set, or all.
        strict: Whether held-out runs hold rudder and warm-up only.
    """

    seed: int
    cases: int
    nuisance: float = 1.0
    sort: str = ALL
    strength: str = ALL
    channels: str = ALL
    strict: bool = False


@dataclass(frozen=True)
class CasePlan:
    """What a case is to be before anything is drawn.

    Attributes:
        ship: Name of the ship.
        kinds: Kinds of the effects.
        strengths: How strong they are to be.
        channels: Channel set.
        hole: Whether a part of one run to fit is missing.
        strict: Whether held-out runs hold rudder and warm-up only.
    """

    ship: str
    kinds: tuple[Kind, ...]
    strengths: tuple[str, ...]
    channels: str = "full"
    hole: bool = False
    strict: bool = False


def plans(trial: Trial) -> list[CasePlan]:
    """What the cases of a trial are to be: sorts by their shares; names, strengths, ships and channel sets in turn.

    Args:
        trial: The trial.

    Returns:
        One plan a case, in random order.
    """
    rng = np.random.default_rng([trial.seed, 0])
    sorts = _by_share(trial.cases) if trial.sort == ALL else [trial.sort] * trial.cases
    listed, other = _shuffled_cycle(rng, KINDS), _shuffled_cycle(rng, UNMODELLED)
    strengths = _shuffled_cycle(rng, STRENGTHS if trial.strength == ALL else (trial.strength,))
    recorders = _shuffled_cycle(rng, RECORDERS if trial.channels == ALL else (trial.channels,))
    ships, holes = _shuffled_cycle(rng, tuple(trial_ships())), _shuffled_cycle(rng, HOLES)
    found = []
    for sort in sorts:
        kinds: list[Kind] = []
        for _ in range(COUNT[sort]):
            source = other if sort == UNKNOWN else listed
            families, equal = {k.family for k in kinds}, {name for k in kinds for name in k.equivalent}
            kinds.append(next(k for k in source if k.family not in families and k.name not in equal))
        ship = next(s for s in ships if all(not k.ships or s in k.ships for k in kinds))
        channels = next(recorders)
        channels = channels if all(shows(channels, kind) for kind in kinds) else "full"
        drawn = tuple(next(strengths) for _ in kinds)
        found.append(CasePlan(ship, tuple(kinds), drawn, channels, next(holes), trial.strict))
    return [found[k] for k in rng.permutation(trial.cases)]


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
    share = LESS**attempt
    drawn = [draw_effect(rng, ship, k, s, runs, share) for k, s in zip(plan.kinds, plan.strengths, strict=True)]
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
        channels=plan.channels,
        hole=_draw_hole(rng, runs) if plan.hole else None,
        strict=plan.strict,
    )


def _draw_hole(rng: np.random.Generator, runs: Sequence[Run]) -> tuple[str, int, int]:
    """Minutes that are missing after the manoeuvre began, in a run to fit."""
    run = runs[int(rng.choice([k for k, run in enumerate(runs) if run.split == "fit"]))]
    length = int(rng.uniform(*HOLE))
    start = int(rng.uniform(2 * MANOEUVRE_START, max(0.8 * run.duration - length, 2 * MANOEUVRE_START + 1)))
    return run.name, start, start + length


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
