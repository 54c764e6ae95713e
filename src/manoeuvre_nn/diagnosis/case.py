"""Folders of recordings: those of concealed cases with their manifest, and a person's own runs."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.core.ship import Particulars, Ship
from manoeuvre_nn.core.units import DEGREE, KNOT
from manoeuvre_nn.diagnosis.manifest import adapted, numbers, read_manifest
from manoeuvre_nn.diagnosis.plausible import check_sheet
from manoeuvre_nn.diagnosis.runs import CHANNELS, Run, with_own_shafts
from manoeuvre_nn.diagnosis.sheet import Sheet, common_step, from_recording, read_sheet, to_run
from manoeuvre_nn.recording.kind import guess_kind
from manoeuvre_nn.recording.mapping import Mapping as ChannelMapping
from manoeuvre_nn.recording.reader import read_recordings
from manoeuvre_nn.ship.esso_190k import esso_190k
from manoeuvre_nn.ship.great_lakes_bulker import great_lakes_bulker
from manoeuvre_nn.ship.mariner import mariner_corrected
from manoeuvre_nn.training.settings import expand

SHIPS: Mapping[str, Callable[[], Ship]] = {
    "mariner": mariner_corrected,
    "great_lakes_bulker": great_lakes_bulker,
    "esso_tanker": esso_190k,
}
"""Ship of a manifest -> calm-water model behind the recordings."""
AUTO = "auto"
WARMUP = 2.0
"""Warm-up over L/U0 where no manifest states it."""
STILL = 1.0 * DEGREE
"""A rudder that moves less has not moved."""
TURNS, ZIGZAGS = ("turning_circle", "pull_out"), ("zigzag",)


@dataclass(frozen=True)
class Case:
    """Runs of one ship.

    Attributes:
        name: Name of the case.
        ship: The ship as the manifest calls it.
        manifest: What the manifest says; empty without one.
        runs: All runs.
        hull: Calm-water model with the manifest's particulars.
        undecided: What these runs cannot decide, a sentence each.
    """

    name: str
    ship: str
    manifest: Mapping[str, Any]
    runs: tuple[Run, ...]
    hull: Ship = field(repr=False)
    undecided: tuple[str, ...] = ()

    @property
    def fitted(self) -> list[Run]:
        """Runs that parameters are taken from."""
        return [run for run in self.runs if not run.held_out]

    @property
    def held_out(self) -> list[Run]:
        """Runs for the proof."""
        return [run for run in self.runs if run.held_out]


def read_case(folder: Path, rudder_positive_to: str = "port", ship: Ship | None = None) -> Case:
    """Read a concealed case: a manifest and the csv files that it names.

    Args:
        folder: Its folder.
        rudder_positive_to: Side that a positive rudder angle of the files turns the ship to.
        ship: The ship; None takes the manifest's.

    Returns:
        The case.

    Raises:
        InputError: If the manifest or a file cannot be used; the message names it.
    """
    m = read_manifest(folder)
    if "ship" not in m or "runs" not in m:
        raise InputError(f"{folder / 'manifest.json'} lacks {'ship' if 'ship' not in m else 'runs'}: it is no case")
    return _case(folder, m, ship_of(m, ship), _sheets_listed(m["runs"], rudder_positive_to), AUTO)


def read_runs(
    folder: Path,
    ship: Ship | None = None,
    held_out: Sequence[str] | str = AUTO,
    *,
    mapping: ChannelMapping | None = None,
    files: Sequence[str] = (),
    rudder_positive_to: str = "port",
    speed_kn: float | None = None,
    rpm: float | None = None,
    warmup_s: float | None = None,
) -> Case:
    """Read a person's own runs.

    The csv files have columns t [s], psi, delta [deg], at least one pair of x_north, y_east [m], sog [m/s], cog [deg]
    and u, v [m/s] (over ground, along and across the recorded heading), and any of u_log [m/s], r [deg/s], delta_order
    [deg], n [rpm]. A manifest.json in the folder gives particulars, wind areas, warm-up and, if it lists runs, the
    files and the split.

    Args:
        folder: Where the files are.
        ship: The ship; None takes the manifest's.
        held_out: Names of the runs to prove by, or ``auto``: the manifest's, else :func:`choose_held_out`.
        mapping: How other columns are read; None takes those above.
        files: Names or patterns of files of the folder; none are all.
        rudder_positive_to: Side that a positive rudder angle turns the ship to; a mapping says so itself.
        speed_kn: Approach speed of the model [kn]; None takes the manifest's, or the ship's own.
        rpm: Nominal shaft speed [rpm]; the same.
        warmup_s: Time up to which a held-out run may be looked at [s]; None takes the manifest's, or 2 L/U0.

    Returns:
        The case.

    Raises:
        InputError: If the folder or a file cannot be used.
    """
    if not folder.is_dir():
        raise InputError(f"recordings={folder} is not a folder: write the folder that holds the csv files")
    m = read_manifest(folder) if (folder / "manifest.json").is_file() else {}
    told = {"approach_speed_m_s": speed_kn and speed_kn * KNOT, "nominal_rpm": rpm}
    m["particulars"] = {**m.get("particulars", {}), **{k: v for k, v in told.items() if v is not None}}
    m |= {} if warmup_s is None else {"warmup_s": warmup_s}
    paths = expand(folder, files, "files")
    listed = m.get("runs") if not paths else [_entry(path, folder) for path in paths]
    read: Reader = _sheets_listed(listed, rudder_positive_to) if mapping is None else _sheets_mapped(mapping, paths)
    return _case(folder, m, ship_of(m, ship), read, held_out)


def ship_of(manifest: Mapping[str, Any], ship: Ship | None = None) -> Ship:
    """The ship of a case with the manifest's particulars.

    Args:
        manifest: The manifest, or nothing.
        ship: The ship where it is known otherwise.

    Returns:
        The ship.

    Raises:
        InputError: If there is none.
    """
    if ship is None:
        if "ship" not in manifest:
            raise InputError(
                "ship= is not given: write for instance ship=esso_190k; python diagnose.py --help lists all"
            )
        check_choice("ship of manifest.json", manifest["ship"], list(SHIPS))
        ship = SHIPS[manifest["ship"]]()
    return adapted(ship, manifest)


Reader = Callable[[Path, Particulars], list[Sheet]]
"""Folder, ship -> what its files hold, checked."""


def _entry(path: Path, folder: Path) -> Mapping[str, Any]:
    """A file as a manifest would list it."""
    return {"run": path.stem, "file": str(path.relative_to(folder))}


def _sheets_listed(entries: Sequence[Mapping[str, Any]] | None, side: str) -> Reader:
    """Reads csv files with fixed columns: those that are listed, else all."""

    def read(folder: Path, ship: Particulars) -> list[Sheet]:
        files = entries or [_entry(path, folder) for path in sorted(folder.glob("*.csv"))]
        if not files:
            raise InputError(f"{folder} holds no csv file: write the folder that holds them")
        return [_sheet(folder, entry, ship, side) for entry in files]

    return read


def _sheet(folder: Path, entry: Mapping[str, Any], ship: Particulars, side: str) -> Sheet:
    """One file, read and checked."""
    sheet = read_sheet(folder / entry["file"], entry["run"], ship, side)
    rows = entry.get("rows", len(sheet.time))
    if rows != len(sheet.time):
        raise InputError(
            f"{entry['file']} has {len(sheet.time)} rows, the manifest says {rows}: it was cut off or belongs to "
            "another case"
        )
    check_sheet(sheet, ship)
    return sheet


def _sheets_mapped(mapping: ChannelMapping, paths: Sequence[Path] = ()) -> Reader:
    """Reads csv files with other columns."""

    def read(folder: Path, ship: Particulars) -> list[Sheet]:
        sheets = [from_recording(r, ship) for r in read_recordings(paths or folder, mapping, ship)]
        for sheet in sheets:
            check_sheet(sheet, ship, "mind the columns, units and signs of the mapping")
        return sheets

    return read


def _case(folder: Path, m: Mapping[str, Any], hull: Ship, read: Reader, held_out: Sequence[str] | str) -> Case:
    """Files read and put on even times with the same step, some of them held out."""
    p = hull.particulars
    sheets = read(folder, p)
    warmup = numbers(m).get("warmup_s", WARMUP * p.time_unit)
    listed = {entry["run"]: entry for entry in m.get("runs", ())}
    kinds = {s.name: str(listed.get(s.name, {}).get("manoeuvre") or guess_kind(_even_rudder(s))) for s in sheets}
    if held_out == AUTO and all(s.name in listed for s in sheets):
        split = {s.name: listed[s.name]["split"] == "held_out" for s in sheets}
    else:
        split = _split(kinds, held_out)
    _check_split(sheets, split, warmup)
    step = common_step(sheets, p)
    runs = with_own_shafts([to_run(s, step, p, kinds[s.name], split[s.name], warmup) for s in sheets])
    name = str(m.get("case", folder.resolve().name))
    return Case(name, str(m.get("ship", p.name)), m, runs, hull, (*undecided(runs), *derived(sheets)))


def _even_rudder(sheet: Sheet) -> Float[np.ndarray, " n"]:
    """Rudder angle at even times without gaps."""
    even = np.linspace(0.0, sheet.time[-1], len(sheet.time))
    return np.interp(even, sheet.time, sheet.filled("delta"))


def _split(kinds: Mapping[str, str], held_out: Sequence[str] | str) -> dict[str, bool]:
    """Run -> whether it is held out."""
    if held_out == AUTO:
        chosen = choose_held_out(kinds)
    else:
        chosen = [held_out] if isinstance(held_out, str) else [str(name) for name in held_out]
    for name in chosen:
        check_choice("run in held_out", name, list(kinds))
    return {name: name in chosen for name in kinds}


def _check_split(sheets: Sequence[Sheet], split: Mapping[str, bool], warmup: float) -> None:
    """Refuse a split that leaves nothing to fit, or a proof that ends with its warm-up."""
    if all(split.values()):
        raise InputError(f"held out are all runs ({', '.join(split)}): leave at least one to fit")
    for sheet in sheets:
        if split[sheet.name] and sheet.time[-1] < 1.5 * warmup:
            raise InputError(
                f"{sheet.name} ends after {sheet.time[-1]:.0f} s: too short to be held out with a warm-up of "
                f"{warmup:.0f} s: hold out a longer run, or write a smaller warmup_s"
            )


def choose_held_out(kinds: Mapping[str, str]) -> list[str]:
    """Choose about a third of the runs: a turn and a zigzag where there are two of each, never the only run to fit.

    Args:
        kinds: Run -> kind of manoeuvre.

    Returns:
        Names of the runs to prove by; none if there is but one run.
    """
    groups = [[n for n, k in kinds.items() if k in family] for family in (TURNS, ZIGZAGS)]
    groups.append([n for n, k in kinds.items() if k not in (*TURNS, *ZIGZAGS)])
    chosen = [group.pop() for group in groups[:2] if len(group) > 1]
    while len(chosen) < round(len(kinds) / 3):  # from the largest group; a zigzag before a turn, which says more
        largest = max(groups[1], groups[2], groups[0], key=len)
        chosen.append(largest.pop())
    return chosen


def undecided(runs: Sequence[Run]) -> tuple[str, ...]:
    """What runs cannot decide, whatever is in them.

    Args:
        runs: All runs of a case.

    Returns:
        A sentence each.
    """
    fitted = [run for run in runs if not run.held_out]
    seen = {c: any(np.isfinite(run.measured[:, k]).any() for run in fitted) for k, c in enumerate(CHANNELS)}
    moved = max(float(np.ptp(run.delta)) for run in fitted) > STILL
    ordered = any((run.shaft != 1).any() for run in fitted)
    said = {
        "The rudder never moved: nothing about rudder, hull and loading can be decided.": not moved,
        "No position: a lever arm of the antenna cannot be told, and a current by velocities alone.": not seen["x"],
        "No speed log: a current is told by turns alone, and the log cannot be judged.": not seen["u_log"],
        "No yaw rate: the rate gyro cannot be judged.": not seen["r"],
        "No shaft speed: it counts as nominal, and a power limit looks like added resistance.": not (
            seen["n"] or ordered
        ),
        "The shaft was ordered otherwise than the model's nominal speed: it is taken as recorded, and an engine at its "
        "limit cannot be told.": ordered and not seen["n"],
        "One run: agreement between runs cannot be tested.": len(fitted) == 1,
        "No held-out run: nothing is proved, and an effect is only proposed.": len(fitted) == len(runs),
    }
    return tuple(sentence for sentence, true in said.items() if true)


def derived(sheets: Sequence[Sheet]) -> tuple[str, ...]:
    """What had to be made from other channels.

    Args:
        sheets: The runs as they came.

    Returns:
        A sentence each.
    """
    said = {
        "No velocity over ground: it was taken from the track.": any("vn" in s.derived for s in sheets),
        "No helm order: it was taken from the rudder angle, so that a slow gear cannot be told.": any(
            "order" not in s.channels for s in sheets
        ),
    }
    return tuple(sentence for sentence, true in said.items() if true)
