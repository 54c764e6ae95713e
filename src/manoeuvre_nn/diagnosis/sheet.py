"""One recorded run as it comes: columns in SI, gaps as NaN; then on even times as the diagnosis wants it."""

from collections.abc import Mapping as AnyMapping
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil
from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import Float
from scipy.ndimage import median_filter

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.frames import body_to_earth
from manoeuvre_nn.core.manoeuvre import side_sign
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.ship import Particulars
from manoeuvre_nn.core.units import DEGREE, RPM
from manoeuvre_nn.diagnosis.runs import CHANNELS, Run, order_lead, smooth_rudder, smooth_shaft
from manoeuvre_nn.recording.accelerations import WINDOW, smoothed
from manoeuvre_nn.recording.mapping import RECORD, ChannelMap, Mapping
from manoeuvre_nn.recording.reader import FEWEST
from manoeuvre_nn.recording.table import Table, read_table

COLUMNS = {
    "t": 1.0, "x_north": 1.0, "y_east": 1.0, "sog": 1.0, "cog": DEGREE, "u": 1.0, "v": 1.0, "u_log": 1.0,
    "psi": DEGREE, "r": DEGREE, "delta_order": DEGREE, "delta": DEGREE, "n": RPM,
}  # fmt: skip
"""Columns that a csv may have -> their unit in SI: they are in s, m, m/s, deg, deg/s and rpm."""
REQUIRED = ("t", "psi", "delta")
PAIRS = (("x_north", "y_east"), ("sog", "cog"), ("u", "v"))
"""At least one of these pairs is needed too; half a pair is none."""
# The reader of tables wants a pair of velocities named. Which pair a file has is seen later: time stands in for it.
HEADINGS = Mapping(
    ChannelMap("t", "s"),
    {k: ChannelMap(k, "deg") for k in ("psi", "delta")} | {k: ChannelMap("t", "m/s") for k in ("u", "v")},
)
SHORTEST = 4.0
"""Shortest run over L/U0: the state at the end of the warm-up takes half of it."""
COARSEST = 0.25
"""Longest time between samples over L/U0."""
FINEST, LONGEST_STEP = 1.0, 0.05
"""Runs are read off once a second, or every .05 L/U0 where that is less."""
MOST_LOST = 0.2
"""Largest share of empty cells in the rudder angle."""
MOST_UNEVEN = 0.2
"""Largest share of times between samples that are far from the usual."""


@dataclass(frozen=True)
class Sheet:
    """What one file holds.

    Attributes:
        name: Name of the run.
        time: Sample times from 0 on [s].
        channels: Those of ``runs.CHANNELS`` that were recorded, in SI, the shaft speed over the nominal one; ``delta``
            and maybe ``order`` [rad], positive to starboard. NaN in gaps.
        derived: Channels that were computed from others.
    """

    name: str
    time: Float[np.ndarray, " n"]
    channels: AnyMapping[str, Float[np.ndarray, " n"]]
    derived: frozenset[str] = frozenset()

    @property
    def step(self) -> float:
        """Usual time between samples [s]: whole seconds or whole samples a second where written times only round it."""
        usual = float(np.median(np.diff(self.time)))
        whole = float(round(usual)) if usual > 0.75 else 1.0 / round(1.0 / usual)
        return whole if abs(usual / whole - 1) < 0.01 else usual

    def filled(self, name: str) -> Float[np.ndarray, " n"]:
        """A channel with its gaps filled by straight lines.

        Args:
            name: The channel.

        Returns:
            Samples.
        """
        values = self.channels[name]
        good = np.isfinite(values)
        return np.interp(self.time, self.time[good], values[good])


def read_sheet(path: Path, name: str, ship: Particulars, rudder_positive_to: str) -> Sheet:
    """Read a csv with columns t, psi, delta, a pair of (x_north, y_east), (sog, cog), (u, v), and any of the others.

    Args:
        path: The file.
        name: Name of the run.
        ship: The ship.
        rudder_positive_to: Side that a positive rudder angle of the file turns the ship to.

    Returns:
        Its columns in SI; columns without numbers count as not recorded.
    """
    table = read_table(path, HEADINGS)
    time = _times(table, ship)
    _check_times(path.name, time, ship)
    columns = _columns(table)
    side = side_sign("rudder_positive_to", rudder_positive_to)
    channels = {"psi": _unwrapped(columns["psi"]), "delta": side * columns["delta"]}
    if "delta_order" in columns:
        channels["order"] = side * columns["delta_order"]
    channels |= {k: columns[k] for k in ("r", "u_log") if k in columns}
    if "n" in columns:
        channels["n"] = columns["n"] / (ship.rpm * RPM)
    if "x_north" in columns:
        channels |= {"x": columns["x_north"], "y": columns["y_east"]}
    if "sog" in columns:
        speed, course = columns["sog"], columns["cog"]
        channels |= {"vn": speed * np.cos(course), "ve": speed * np.sin(course)}
    elif "u" in columns:
        channels["vn"], channels["ve"] = body_to_earth(columns["u"], columns["v"], channels["psi"])
    return _with_velocity(Sheet(name, time - time[0], channels), ship)


def from_recording(recording: Recording, ship: Particulars) -> Sheet:
    """A run that was read by a mapping; its u and v count as velocities over ground.

    Args:
        recording: In SI, rudder positive to starboard.
        ship: The ship.

    Returns:
        The run.

    Raises:
        InputError: If it is a record of channels without heading, rudder and motion.
    """
    if recording.meta.get("kind") == RECORD:
        raise InputError(f"{recording.name}: a mapping of kind: record gives no manoeuvre that could be diagnosed")
    _check_times(recording.name, recording.time, ship)
    given, derived = recording.channels, set(recording.meta.get("derived", ()))
    channels = {"psi": given["psi"], "delta": given["delta"]}
    channels |= {"order": given["delta_order"]} if "delta_order" in given else {}
    channels |= {} if "r" in derived else {"r": given["r"]}
    channels |= {} if "x" in derived else {"x": given["x"], "y": given["y"]}
    channels |= {"n": given["n"] / (ship.rpm * RPM)} if "n" in given else {}
    channels |= {"u_log": given["u_log"]} if "u_log" in given else {}
    if "u" not in derived:
        channels["vn"], channels["ve"] = body_to_earth(given["u"], given["v"], given["psi"])
    return _with_velocity(Sheet(recording.name, recording.time, channels), ship)


def common_step(sheets: Sequence[Sheet], ship: Particulars) -> float:
    """Time between samples that all runs of a case are read off at.

    Args:
        sheets: The runs.
        ship: For L/U0.

    Returns:
        Step [s]: that of the finest record, but not less than ``FINEST`` nor more than ``LONGEST_STEP`` ask for; a
        record with longer steps is left with gaps.
    """
    longest = LONGEST_STEP * ship.time_unit
    step = max(min(s.step for s in sheets), min(FINEST, longest))
    return step / ceil(step / longest - 0.05)


def to_run(sheet: Sheet, step: float, ship: Particulars, kind: str, held_out: bool, warmup: float) -> Run:
    """Put a run on even times and take the noise out of its rudder.

    Args:
        sheet: The run as it came.
        step: Time between samples [s].
        ship: For the rate of the steering gear.
        kind: What was sailed.
        held_out: Whether it is kept for the proof.
        warmup: Time up to which a held-out run may be looked at [s].

    Returns:
        The run; channels that were not recorded are NaN.
    """
    even = on_even_times(sheet, step)
    gap = np.full(len(even.time), np.nan)
    measured = np.stack([even.channels.get(name, gap) for name in CHANNELS], axis=-1)
    shown = even.filled("delta")
    given = "order" in even.channels
    order = even.filled("order") if given else estimated_order(shown, step, ship.rudder_rate)
    if abs(order[0] - shown[0]) > ship.rudder_rate * step:
        order[0] = shown[0]  # the recording begins with a new order: until then the rudder was at rest
    delta, noise = smooth_rudder(shown, order, step, ship.rudder_rate)
    lead = order_lead(shown, order, step, ship.rudder_rate)
    shaft = smooth_shaft(measured[:, CHANNELS.index("n")])
    return Run(sheet.name, even.time, measured, delta, order, lead, shaft, noise, kind, held_out, warmup)


def on_even_times(sheet: Sheet, step: float) -> Sheet:
    """A run read off at even times; nothing is made up where nothing was recorded.

    Several samples within a step are joined to their median. Where samples are rarer, each is moved to the nearest of
    the new times along the straight line to its neighbour, and the other times stay empty.

    Args:
        sheet: The run.
        step: Time between the new samples [s].

    Returns:
        The run at 0, step, 2 step, ...
    """
    time = sheet.time
    even = step * np.arange(int(time[-1] / step + 1e-6) + 1)
    if len(even) == len(time) and np.abs(time - even).max() < 0.02 * step:
        return replace(sheet, time=even)
    place = np.minimum(np.rint(time / step).astype(int), len(even) - 1)
    joined = {k: _joined(time, v, even, place, sheet.step < 0.75 * step) for k, v in sheet.channels.items()}
    if "order" in joined:  # an order stands until the next one
        joined["order"] = sheet.filled("order")[np.searchsorted(time, even + 1e-6 * step, side="right") - 1]
    return replace(sheet, time=even, channels=joined)


def _joined(time: np.ndarray, values: np.ndarray, even: np.ndarray, place: np.ndarray, fast: bool) -> np.ndarray:
    """One channel at even times; ``place`` says which of them each sample is nearest to."""
    if fast:
        joined = pd.Series(values).groupby(place).median().reindex(range(len(even))).to_numpy(float, copy=True)
        ends = [0, -1]  # half a step on one side only: its median would be late or early
        joined[ends] = values[[np.abs(time - even[k]).argmin() for k in ends]]
        return joined
    good = np.isfinite(values)
    result = np.full(len(even), np.nan)
    hit = np.unique(place[good])
    result[hit] = np.interp(even[hit], time[good], values[good])
    return result


def estimated_order(shown: Float[np.ndarray, " n"], step: float, rate: float) -> Float[np.ndarray, " n"]:
    """Helm orders behind an indicated angle: while the rudder moves, the angle at which it will come to rest.

    Args:
        shown: Indicated angle [rad].
        step: Time between samples [s].
        rate: Rate of the steering gear [rad/s].

    Returns:
        Orders [rad].
    """
    smooth = median_filter(shown, 5, mode="nearest")
    moving = np.abs(np.gradient(smooth, step)) > 0.25 * rate
    piece = np.cumsum(np.diff(moving, prepend=moving[0]))
    rest = pd.Series(shown).groupby(piece).transform("median").mask(moving)
    return rest.bfill().fillna(smooth[-1]).to_numpy(float, copy=True)


def _columns(table: Table) -> dict[str, Float[np.ndarray, " n"]]:
    """All known columns that hold numbers, in SI; pairs are complete."""
    file, headings = table.path.name, list(table.cells.columns)
    for name in headings:
        if headings.count(name) > 1:
            raise InputError(f"{file}: column {name!r} stands {headings.count(name)} times; rename one")
    found = {k: table.numbers(k) * unit for k, unit in COLUMNS.items() if k in headings}
    found = {k: v for k, v in found.items() if np.isfinite(v).sum() >= FEWEST}
    for name in REQUIRED[1:]:
        if name not in found:
            raise InputError(f"{file}: column {name!r} holds no numbers; a diagnosis needs heading and rudder angle")
    lost = float(np.mean(np.isnan(found["delta"])))
    if lost > MOST_LOST:
        raise InputError(f"{file}: {lost:.0%} of column 'delta' is empty; a diagnosis needs the rudder throughout")
    for name, partner, meant in (("u", "v", "the log's speed u_log"), ("sog", "cog", "")):
        if name in found and partner not in headings:
            hint = f"; if it is {meant}, rename it" if meant else ""
            raise InputError(f"{file}: column {name!r} stands without {partner!r}{hint}")
    kept = [name for pair in PAIRS if set(pair) <= set(found) for name in pair]
    if not kept:
        pairs = " or ".join(f"{a}, {b}" for a, b in PAIRS)
        raise InputError(f"{file}: neither position nor velocity: it needs {pairs}; it has: {', '.join(headings[:20])}")
    single = {name for pair in PAIRS for name in pair} - set(kept)
    return {k: v for k, v in found.items() if k not in single}


def _times(table: Table, ship: Particulars) -> Float[np.ndarray, " n"]:
    """Sample times [s], refused unless they rise without a hole."""
    time = table.numbers("t")
    if np.isnan(time).any():
        raise table.error("t", int(np.argmax(np.isnan(time))), "is empty; a sample without a time cannot be used")
    steps = np.diff(time)
    if (steps <= 0).any():
        row = int(np.argmax(steps <= 0)) + 1
        raise table.error("t", row, f"goes from {time[row - 1]:g} to {time[row]:g}; times must increase")
    if len(steps) and steps.max() > max(ship.time_unit, 5 * np.median(steps)):
        row = int(np.argmax(steps)) + 1
        raise table.error("t", row, f"jumps by {steps.max():.4g} s; cut the file in two at this hole")
    return time


def _check_times(name: str, time: Float[np.ndarray, " n"], ship: Particulars) -> None:
    """Refuse a run that is too short, too coarse or too uneven."""
    length, shortest, coarsest = time[-1] - time[0], SHORTEST * ship.time_unit, COARSEST * ship.time_unit
    if len(time) < FEWEST or length < shortest:
        raise InputError(
            f"{name}: too short a run: {len(time)} samples over {length:.4g} s; the {ship.name} needs at least "
            f"{FEWEST} samples and {shortest:.0f} s ({SHORTEST:g} L/U0): give a longer one, with t in s"
        )
    steps = np.diff(time)
    usual = float(np.median(steps))
    if usual > coarsest:
        raise InputError(
            f"{name}: samples are {usual:.4g} s apart; the {ship.name} needs one every {coarsest:.2g} s or more "
            "often: sample faster, with t in s"
        )
    uneven = float(np.mean(np.abs(steps - usual) > 0.5 * usual))
    if uneven > MOST_UNEVEN:
        raise InputError(
            f"{name}: {uneven:.0%} of the times between samples are more than half off the usual {usual:.3g} s: write "
            "samples at even times"
        )


def _with_velocity(sheet: Sheet, ship: Particulars) -> Sheet:
    """Velocity over ground from the positions where it was not recorded: the search starts from it."""
    if "vn" in sheet.channels:
        return sheet
    made = {}
    for place, rate in (("x", "vn"), ("y", "ve")):
        slope = smoothed(sheet.time, sheet.filled(place), WINDOW * ship.time_unit)[1]
        made[rate] = np.where(np.isfinite(sheet.channels[place]), slope, np.nan)
    return replace(sheet, channels={**sheet.channels, **made}, derived=sheet.derived | {"vn", "ve"})


def _unwrapped(angle: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """A heading without jumps at north; gaps stay gaps."""
    result, good = angle.copy(), np.isfinite(angle)
    result[good] = np.unwrap(angle[good])
    return result
