"""Folders of recordings: those of concealed cases with their manifest, and a person's own runs."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.channels import MEASURED
from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.plain_text import check_name
from manoeuvre_nn.core.recording import CAMPAIGN, Recording
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.core.units import DEGREE, KNOT
from manoeuvre_nn.diagnosis.manifest import adapted, numbers, read_manifest
from manoeuvre_nn.dynamics.base import Model
from manoeuvre_nn.effect.current import SPEED
from manoeuvre_nn.effect.rudder import RudderDelay, RudderOffset
from manoeuvre_nn.effect.sensors import LeverArm
from manoeuvre_nn.estimation.data_set import WhitenedDataSet, whitened_data_set
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis, Hypothesis
from manoeuvre_nn.estimation.marginal_likelihood import MarginalLikelihood
from manoeuvre_nn.recording.check.checks import COLUMNS, check_over_ground, check_sampling
from manoeuvre_nn.recording.check.weighed import Bounds
from manoeuvre_nn.recording.holes import answers, told
from manoeuvre_nn.recording.kind import guess_kind
from manoeuvre_nn.recording.preparation import common_step, measured, over_ground, prepared, with_own_shafts
from manoeuvre_nn.recording.read.mapping import Mapping as ChannelMapping
from manoeuvre_nn.recording.read.mapping_file import CONCEALED, SI_DEGREES, WRITTEN, is_written_by_package, read_mapping
from manoeuvre_nn.recording.read.reader import read_measured, recordings_in
from manoeuvre_nn.ship.esso_190k import esso_190k
from manoeuvre_nn.ship.great_lakes_bulker import great_lakes_bulker
from manoeuvre_nn.ship.mariner import mariner_corrected
from manoeuvre_nn.training.settings import expand

if TYPE_CHECKING:
    from manoeuvre_nn.diagnosis.claims import Tried

SHIPS: Mapping[str, Callable[[], Ship]] = {
    "mariner": mariner_corrected,
    "great_lakes_bulker": great_lakes_bulker,
    "esso_tanker": esso_190k,
}
"""Ship of a manifest -> calm-water model behind the recordings."""
AUTO = "auto"
WARMUP = 2.0
"""Warm-up over L/U0 where no manifest states it."""
MIN_RUDDER_TRAVEL = 1.0 * DEGREE
"""A rudder that moves less has not moved."""
TURNS, ZIGZAGS = ("turning_circle", "pull_out"), ("zigzag",)


@dataclass(frozen=True)
class Case:
    """Runs of one ship.

    Attributes:
        name: Name of the case.
        ship: The ship as the manifest calls it.
        runs: All runs, prepared.
        hull: Calm-water model with the manifest's particulars.
        warmup: Time up to which a held-out run may be looked at [s].
        proof: Names of the runs that are held out.
        undecided: What these runs cannot decide, a sentence each.
    """

    name: str
    ship: str
    runs: tuple[Recording, ...]
    hull: Ship = field(repr=False)
    warmup: float
    proof: frozenset[str] = frozenset()
    undecided: tuple[str, ...] = ()

    @property
    def fitted(self) -> list[Recording]:
        """Runs that parameters are taken from."""
        return [run for run in self.runs if run.name not in self.proof]

    @property
    def held_out(self) -> list[Recording]:
        """Runs for the proof."""
        return [run for run in self.runs if run.name in self.proof and answers(run, self.warmup)]

    @property
    def planned(self) -> list[Recording]:
        """Held-out runs of which nothing but rudder and shaft is known after the warm-up: they prove nothing."""
        return [run for run in self.runs if run.name in self.proof and not answers(run, self.warmup)]


@dataclass(frozen=True)
class Question:
    """What is asked about a case.

    Attributes:
        case: What is recorded.
        dynamics: Calm-water model.
        effects: Prototypes of the candidates.
        settings: For the record.
        workers: Processes among which the fits are shared out.
        remainder: Whether a network may learn what physics leaves.
        caveat: What speaks against the model itself before these runs are looked at; empty if nothing does.
    """

    case: Case
    dynamics: Model
    effects: Sequence[Effect]
    settings: Mapping[str, str] = field(default_factory=dict)
    workers: int = 1
    remainder: bool = False
    caveat: str = ""
    elsewhere: dict[int, tuple[FittedHypothesis, WhitenedDataSet, FittedHypothesis, Hypothesis]] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )
    """By its id a hypothesis, the held-out runs about it, it fitted to them, and at its values (:mod:`.proof`)."""
    held_out_evidence: dict[int, tuple[FittedHypothesis, float]] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )
    """By its id a claim, and the log evidence of the held-out runs under it (:mod:`.claims`)."""
    put_to_proof: dict[int, tuple[FittedHypothesis, "Tried"]] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )
    """By its id a claim, and what came out when it was put to the proof."""

    @cached_property
    def held_out(self) -> MarginalLikelihood:
        """The held-out runs, whitened: what claims are proved by."""
        return MarginalLikelihood(whitened_data_set(self.dynamics, self.case.held_out))


@dataclass(frozen=True)
class RunSettings:
    """How a person's own runs are read.

    Attributes:
        held_out: Names of the runs to prove by, or ``auto``: the manifest's, else :func:`choose_held_out`.
        mapping: Columns, units and signs; None takes ``conf/recording/si_degrees.yaml``, or for files that this package
            wrote their headings.
        files: Names or patterns of files of the folder; none are those that the manifest lists, else all.
        rudder_positive_to: Side that a positive rudder angle turns the ship to; None takes the mapping's.
        speed_kn: Approach speed of the model [kn]; None takes the manifest's, or the ship's own.
        rpm: Nominal shaft speed [rpm]; the same.
        warmup_s: Time up to which a held-out run may be looked at [s]; None takes the manifest's, or 2 L/U0.
    """

    held_out: Sequence[str] | str = AUTO
    mapping: ChannelMapping | None = None
    files: Sequence[str] = ()
    rudder_positive_to: str | None = None
    speed_kn: float | None = None
    rpm: float | None = None
    warmup_s: float | None = None


def read_case(folder: Path, rudder_positive_to: str | None = None, ship: Ship | None = None) -> Case:
    """Read a concealed case: a manifest and the csv files that it names, mapped by ``conf/recording/concealed.yaml``.

    Args:
        folder: Its folder.
        rudder_positive_to: Side that a positive rudder angle of the files turns the ship to; None takes the mapping's.
        ship: The ship; None takes the manifest's.

    Returns:
        The case.

    Raises:
        InputError: If the manifest or a file cannot be used; the message names it.
    """
    m = read_manifest(folder)
    if "ship" not in m or "runs" not in m:
        raise InputError(f"{folder / 'manifest.json'} lacks {'ship' if 'ship' not in m else 'runs'}: it is no case")
    settings = RunSettings(mapping=read_mapping(CONCEALED), rudder_positive_to=rudder_positive_to)
    return read_runs(folder, ship, settings)


def read_runs(folder: Path, ship: Ship | None = None, settings: RunSettings | None = None) -> Case:
    """Read a person's own runs.

    A manifest.json in the folder gives particulars, wind areas, warm-up and, if it lists runs, the files and the split.

    Args:
        folder: Where the files are.
        ship: The ship; None takes the manifest's.
        settings: How they are read; None takes the defaults.

    Returns:
        The case.

    Raises:
        InputError: If the folder or a file cannot be used.
    """
    if not folder.is_dir():
        raise InputError(f"recordings={folder} is not a folder: write the folder that holds the csv files")
    asked = settings or RunSettings()
    m = read_manifest(folder) if (folder / "manifest.json").is_file() else {}
    speed = None if asked.speed_kn is None else asked.speed_kn * KNOT
    told = {"approach_speed_m_s": speed, "nominal_rpm": asked.rpm}
    m["particulars"] = {**m.get("particulars", {}), **{k: v for k, v in told.items() if v is not None}}
    m |= {} if asked.warmup_s is None else {"warmup_s": asked.warmup_s}
    hull = _ship_of(m, ship)
    return _case(folder, m, hull, _read(folder, m, hull.particulars, asked), asked.held_out)


def case_of(
    runs: Sequence[Recording], ship: Ship, held_out: Sequence[str] | str = AUTO, name: str = "recordings"
) -> Case:
    """Runs that have been read already.

    Args:
        runs: Recordings in SI, rudder positive to starboard.
        ship: The ship.
        held_out: Names of the runs to prove by, or ``auto``: see :func:`choose_held_out`.
        name: What the case is called.

    Returns:
        The case.
    """
    hull = adapted(ship, {})
    raw = _checked(runs, hull.particulars, "mind the units and signs of the channels")
    return _case(Path(name), {}, hull, raw, held_out)


def _ship_of(manifest: Mapping[str, Any], ship: Ship | None = None) -> Ship:
    """The ship of a case with the manifest's particulars."""
    if ship is None:
        if "ship" not in manifest:
            raise InputError(
                "ship= is not given, and the folder of recordings= names none: write for instance ship=esso_190k; "
                "manoeuvre diagnose --help lists all"
            )
        check_choice("ship of manifest.json", manifest["ship"], list(SHIPS))
        ship = SHIPS[manifest["ship"]]()
    return adapted(ship, manifest)


def _read(folder: Path, m: Mapping[str, Any], ship: Particulars, asked: RunSettings) -> list[Recording]:
    """The files that are asked for, else those that the manifest lists, else all; checked."""
    listed = {} if asked.files else {entry["file"]: entry for entry in m.get("runs", ())}
    paths = expand(folder, asked.files, "files") or [folder / file for file in listed] or recordings_in(folder)
    if not paths:
        raise InputError(f"{folder} holds no csv file: write the folder that holds them")
    mapping = asked.mapping or read_mapping(SI_DEGREES)
    runs = [_read_run(path, listed.get(path.name, {}), ship, asked, mapping) for path in paths]
    return _checked(runs, ship, COLUMNS if mapping.optional else "mind the columns, units and signs of the mapping")


def _read_run(
    path: Path, entry: Mapping[str, Any], ship: Particulars, asked: RunSettings, mapping: ChannelMapping
) -> Recording:
    """One file; gaps stay where the mapping does not say that they are filled."""
    name = check_name("recording: name", entry.get("run", path.stem))  # before anything is fitted
    if asked.mapping is None and is_written_by_package(path):
        mapping = WRITTEN
    if asked.rudder_positive_to is not None:
        mapping = replace(mapping, rudder_positive_to=asked.rudder_positive_to)
    run = read_measured(path, mapping, ship, leave_gaps=True)
    if entry.get("rows", len(run)) != len(run):
        raise InputError(
            f"{path.name} has {len(run)} rows, the manifest says {entry['rows']}: it was cut off or belongs to another "
            "case"
        )
    told = {CAMPAIGN: entry.get(CAMPAIGN), "kind": entry.get("manoeuvre")}
    meta = {**run.meta, **{key: value for key, value in told.items() if value}}
    return replace(run, name=name, meta=meta)


def _checked(runs: Iterable[Recording], ship: Particulars, remedy: str) -> list[Recording]:
    """Recordings over ground, refused where they make no sense."""
    raw = []
    for run in runs:
        check_sampling(run, ship)
        raw.append(over_ground(run, ship))
    ahead, abeam = (parameter.on(ship).high for parameter in LeverArm.declared)
    offset, delay = RudderOffset.declared[0].high * DEGREE, RudderDelay.declared[0].high
    bounds = Bounds(SPEED.high, offset, (ahead, abeam), delay)
    findings = check_over_ground(raw, ship, remedy, bounds)
    return [replace(run, meta={**run.meta, "findings": said}) for run, said in zip(raw, findings, strict=True)]


def _case(
    folder: Path, m: Mapping[str, Any], hull: Ship, raw: Sequence[Recording], held_out: Sequence[str] | str
) -> Case:
    """Recordings put on even times with the same step, some of them held out."""
    p = hull.particulars
    warmup = numbers(m).get("warmup_s", WARMUP * p.time_unit)
    listed = {entry["run"]: entry for entry in m.get("runs", ())}
    kinds = {run.name: str(run.meta.get("kind") or guess_kind(_even_rudder(run))) for run in raw}
    if held_out == AUTO and all(s.name in listed for s in raw):
        split = {s.name: listed[s.name]["split"] == "held_out" for s in raw}
    else:
        split = _split(kinds, held_out)
    _check_split(raw, split, warmup)
    step = common_step(raw, p)
    runs = with_own_shafts([prepared(r, step, p, kinds[r.name]) for r in raw])
    name, proof = str(m.get("case", folder.resolve().name)), frozenset(name for name, held in split.items() if held)
    case = Case(name, str(m.get("ship", p.name)), runs, hull, warmup, proof)
    return replace(case, undecided=_undecided(case))


def _even_rudder(run: Recording) -> Float[np.ndarray, " n"]:
    """Rudder angle at even times without gaps."""
    even = np.linspace(0.0, run.time[-1], len(run.time))
    return np.interp(even, run.time, run.filled("delta"))


def _split(kinds: Mapping[str, str], held_out: Sequence[str] | str) -> dict[str, bool]:
    """Run -> whether it is held out."""
    if held_out == AUTO:
        chosen = choose_held_out(kinds)
    else:
        chosen = [held_out] if isinstance(held_out, str) else [str(name) for name in held_out]
    for name in chosen:
        check_choice("run in held_out", name, list(kinds))
    return {name: name in chosen for name in kinds}


def _check_split(runs: Sequence[Recording], split: Mapping[str, bool], warmup: float) -> None:
    """Refuse a split that leaves nothing to fit, or a proof that ends with its warm-up."""
    if all(split.values()):
        raise InputError(f"held out are all runs ({', '.join(split)}): leave at least one to fit")
    for run in runs:
        if split[run.name] and run.time[-1] < 1.5 * warmup:
            raise InputError(
                f"{run.name} ends after {run.time[-1]:.0f} s: too short to be held out with a warm-up of "
                f"{warmup:.0f} s: hold out a longer run, or write a smaller warmup_s"
            )


def choose_held_out(kinds: Mapping[str, str]) -> list[str]:
    """Choose about a third of the runs: a turn and a zigzag where there are two of each, never the only run to fit.

    Args:
        kinds: Run -> kind of manoeuvre.

    Returns:
        Names of the runs to prove by.
    """
    groups = [[n for n, k in kinds.items() if k in family] for family in (TURNS, ZIGZAGS)]
    groups.append([n for n, k in kinds.items() if k not in (*TURNS, *ZIGZAGS)])
    chosen = [group.pop() for group in groups[:2] if len(group) > 1]
    while len(chosen) < round(len(kinds) / 3):  # from the largest group; a zigzag before a turn, which says more
        largest = max(groups[1], groups[2], groups[0], key=len)
        chosen.append(largest.pop())
    return chosen


def seen_channels(runs: Sequence[Recording], channels: Sequence[str] = MEASURED) -> set[str]:
    """Channels that any of the runs has."""
    present = np.any([np.isfinite(measured(run, channels)).any(axis=0) for run in runs], axis=0)
    return {channel for channel, there in zip(channels, present, strict=True) if there}


def _undecided(case: Case) -> tuple[str, ...]:
    """What runs cannot decide, whatever is in them, and what had to be made from other channels, a sentence each."""
    runs, fitted, planned = case.runs, case.fitted, ", ".join(run.name for run in case.planned)
    seen = seen_channels(fitted)
    moved = max(float(np.ptp(run["delta"])) for run in fitted) > MIN_RUDDER_TRAVEL
    ordered = any((run["shaft"] != 1).any() for run in fitted)
    said = {
        "The rudder never moved: nothing about rudder, hull and loading can be decided.": not moved,
        "No position: a lever arm of the antenna cannot be told, and a current by velocities alone.": "x" not in seen,
        "No speed log: a current is told by turns alone, and the log cannot be fitted.": "u_log" not in seen,
        "No yaw rate: the rate gyro cannot be fitted.": "r" not in seen,
        "No shaft speed: it counts as nominal, and a power limit looks like added resistance.": not (
            "shaft_recorded" in seen or ordered
        ),
        "The shaft was ordered otherwise than the model's nominal speed: it is taken as recorded, and an engine at its "
        "limit cannot be told.": ordered and "shaft_recorded" not in seen,
        "One run: agreement between runs cannot be tested.": len(fitted) == 1,
        "No held-out run: nothing is proved, and an effect is only proposed.": len(fitted) == len(runs),
        f"Nothing was recorded after the warm-up of {planned}: predicted with bands, no proof.": bool(planned),
        "No held-out run was recorded to its end: nothing is proved, and an effect is only proposed.": (
            bool(planned) and not case.held_out
        ),
        "No velocity over ground: it was taken from the track.": any("vn" in run.meta["derived"] for run in runs),
        "No helm order: it was taken from the rudder angle, so that a slow gear cannot be told.": any(
            "delta_order" in run.meta["derived"] for run in runs
        ),
    }
    return (*(sentence for sentence, true in said.items() if true), *(line for run in runs for line in _told(run)))


def _told(run: Recording) -> list[str]:
    """What was found in one run and weighed, not refused, and what became of its holes."""
    return [*(f"{run.name}: {text}." for text in run.meta.get("findings", ())), *told(run)]
