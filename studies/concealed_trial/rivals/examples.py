"""Examples for the methods that learn: features of cases with their effects, of our own shelf or of the referee."""

import json
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.core.writing import draft_of
from studies.concealed_trial.drawing import CasePlan, Trial, draw_case, plans
from studies.concealed_trial.record import write_case
from studies.concealed_trial.rivals.features import features
from studies.concealed_trial.rivals.package import SHIPS, CalmWater, read_case, shelf
from studies.concealed_trial.rivals.pilot import MAX_NUMBERS, SIZE, numbers, pilot
from studies.concealed_trial.rivals.simulated import simulate_cases
from studies.concealed_trial.rivals.whitened import WhitenedRuns

WORLDS = ("shelf", "referee")
"""Who makes the cases: our own shelf, or the referee's generator (a closed world: it also draws the test)."""
BATCH = 600
"""Cases that are sailed at once and then saved."""
KINDS = ("features", "present", "targets", "pilots")
STRANGE = "unknown"
REFEREE_BATCH, REFEREE_STEP = 50, 1.0
"""Cases of the referee that are saved together, and step of its runs that are only learnt from [s]."""


@dataclass(frozen=True)
class Examples:
    """Cases as numbers.

    Attributes:
        features: Numbers of each case.
        present: Whether each of :func:`names` acts.
        targets: Numbers of each one's parameters, see :func:`.numbers`; NaN where it does not act.
        pilots: First estimates of them, likewise.
    """

    features: Float[np.ndarray, "n f"]
    present: Float[np.ndarray, "n c"]
    targets: Float[np.ndarray, "n c k"]
    pilots: Float[np.ndarray, "n c j"]

    def some(self, rows: np.ndarray | slice) -> "Examples":
        """A part of them."""
        return Examples(self.features[rows], self.present[rows], self.targets[rows], self.pilots[rows])


def names() -> tuple[str, ...]:
    """Everything that an answer may name, ``unknown`` last."""
    return (*(e.name for e in some_shelf()), STRANGE)


@cache
def some_shelf() -> tuple[Effect, ...]:
    """The shelf on a ship: names and parameters are the same on all."""
    return tuple(shelf(SHIPS["mariner"]()))


def examples(world: str, count: int, seed: int, path: Path) -> Examples:
    """Examples from a file, made as far as they are missing.

    Args:
        world: One of ``WORLDS``.
        count: How many.
        seed: Seed; never that of a trial.
        path: Their file; it takes those that are made.

    Returns:
        As many as were asked for.

    Raises:
        InputError: If the file holds others.
    """
    check_choice("world", world, WORLDS)
    head = json.dumps({"world": world, "seed": seed})
    rows: list[tuple[np.ndarray, ...]] = []
    batches = 0
    if path.is_file():
        with np.load(path) as kept:
            if str(kept["head"]) != head:
                raise InputError(f"{path} holds other examples: {kept['head']}; give another folder")
            rows = list(zip(*(kept[kind] for kind in KINDS), strict=True))
            batches = int(kept["batches"])
    while len(rows) < count:
        made = _of_shelf(seed, batches) if world == "shelf" else _of_referee(seed, batches)
        rows += list(made)
        batches += 1
        arrays = (np.stack(part) for part in zip(*rows, strict=True))
        kinds = dict(zip(KINDS, arrays, strict=True))
        with draft_of(path) as draft, draft.open("wb") as file:
            np.savez(file, head=head, batches=batches, **kinds)  # type: ignore[arg-type]
        print(f"{len(rows)} of {count} examples", flush=True)
    return Examples(*(np.stack(part) for part in zip(*rows[:count], strict=True)))


def _of_shelf(seed: int, batch: int) -> Iterator[tuple[np.ndarray, ...]]:
    """Cases of our own shelf, those of the ships mixed."""
    found = []
    for k, (name, make) in enumerate(SHIPS.items()):
        ship = make()
        calm, listed = CalmWater(ship), {e.name: e for e in shelf(ship)}
        for case in simulate_cases(ship, name, BATCH // len(SHIPS), 1000 * seed + 10 * batch + k):
            found.append(_example(WhitenedRuns(calm, case.runs, at_samples=True), listed, case.values))
    order = np.random.default_rng([seed, batch]).permutation(len(found))
    yield from (found[k] for k in order)


def _of_referee(seed: int, batch: int) -> Iterator[tuple[np.ndarray, ...]]:
    """Cases that the referee draws; rivals need all channels."""
    drawn: Sequence[CasePlan] = plans(Trial(1000 * seed + batch, REFEREE_BATCH, channels="full"))
    for index, plan in enumerate(drawn):
        concealed = draw_case(1000 * seed + batch, index, plan)
        with tempfile.TemporaryDirectory() as place:
            write_case(concealed, Path(place), REFEREE_STEP)
            case = read_case(Path(place))
        values = {e.name: _to_package(e.name, {**e.parameters, "ramp_s": e.ramp}) for e in concealed.effects}
        data = WhitenedRuns(CalmWater(case.hull), case.fitted, at_samples=True)
        yield _example(data, {e.name: e for e in shelf(case.hull)}, values)


def _to_package(name: str, parameters: Mapping[str, float]) -> dict[str, float]:
    """Parameters of the referee with the package's signs: angles of its rudders are positive to port."""
    if name == STRANGE:
        return {}
    return {key: -value if key == "offset_deg" else value for key, value in parameters.items()}


def _example(
    data: WhitenedRuns, listed: Mapping[str, Effect], values: Mapping[str, Mapping[str, float]]
) -> tuple[np.ndarray, ...]:
    """Features, what acts, numbers of its parameters and first estimates of them."""
    every = names()
    present = np.zeros(len(every))
    targets, pilots = np.full((len(every), MAX_NUMBERS), np.nan), np.full((len(every), SIZE), np.nan)
    for name, given in values.items():
        k = every.index(name if name in every else STRANGE)
        present[k] = 1.0
        if name in listed:
            targets[k], pilots[k] = numbers(listed[name], given), pilot(data, listed[name])
    return features(data), present, targets, pilots
