"""Samples looked at one channel at a time: rate, gaps, outliers, channels that are stuck or coarsely written."""

from collections.abc import Sequence
from functools import partial

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.integrate import cumulative_trapezoid

from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.recording.check.finding import LEAVE_OUT, Change, Finding
from manoeuvre_nn.recording.local_cubics import WINDOW, smoothed
from manoeuvre_nn.recording.outliers import middle_of_neighbours, robust_sd, spikes
from manoeuvre_nn.recording.read.mending import line_across

MAX_INTERVAL = 0.15
"""Longest interval between samples over L/U0: local cubics over .8 L/U0 need six samples."""
JITTER = 0.2
"""Share of the interval by which a sample may be off the even grid."""
GAP_STEPS = 1.5
"""Steps of time this many times longer than usual are gaps."""
MAX_BRIDGED_GAP = 0.5
"""Longest gap over L/U0 that is bridged by a straight line without harm."""
MAX_OUTLIER_SHARE = 0.05
"""Share of samples up to which what lies far off is an outlier and not noise."""
NOTED_STEP, USELESS_STEP = 0.02, 0.08
"""Step of a channel over its range from which on it is noted, and from which on it is of no use."""
NOTED_POSITION_STEP, USELESS_POSITION_STEP = 0.01, 0.05
"""Step of a position over L from which on it is noted, and from which on it is of no use."""
TURN = 4 * DEGREE
"""Change of heading that a channel which stands still belies."""
STEADY = 0.01
"""Change of the rate of turn over itself up to which a turn is steady: then speeds stand still too, but for noise."""
MAX_WINDOW_SAMPLES = 400
"""Samples beyond which a longer window tells no more of the noise."""
CHANNELS = ("u", "v", "r", "x", "y", "psi", "delta")
"""Channels that are looked at, if they were recorded."""
REPLACEMENTS = {
    "r": (("r",), "r then follows from psi"),
    "u": (("u", "v", "sog", "cog"), "u and v then follow from the track"),
    "x": (("x", "y", "lat", "lon"), "the track then follows from u and v"),
}
REPLACEMENTS |= {"v": REPLACEMENTS["u"], "y": REPLACEMENTS["x"]}
"""Channel -> what is left out of the mapping with it, and what takes its place."""

Series = Float[np.ndarray, " n"]
Flags = dict[str, Bool[np.ndarray, " n"]]
"""Channel -> samples that are odd."""
Spans = Sequence[tuple[float, float]]
"""Times from and to [s]."""


def sampling(recording: Recording, ship: Particulars) -> Finding:
    """Rate against the ship's own time, and evenness."""
    steps, interval = np.diff(recording.time), recording.step
    slowest = MAX_INTERVAL * ship.time_unit
    found = partial(Finding, "sampling", measured=interval, unit="s", expected=f"below {slowest:.3g} s")
    if interval > slowest * 1.001:
        text = f"a sample every {interval:.3g} s; the {ship.name} sails its length in {ship.time_unit:.3g} s"
        return found("mend", text, remedy=f"give a record with a sample every {slowest:.2g} s or more often")
    text = f"a sample every {interval:.3g} s, {ship.time_unit / interval:.0f} in the time of a ship length"
    regular = steps[steps < GAP_STEPS * interval]
    off = float(np.abs(regular - interval).max(initial=0.0) / interval)
    if off > JITTER:
        return found("note", f"{text}; intervals differ by up to {100 * off:.0f} %: it is smoothed on an even grid")
    return found("ok", text)


def gaps(recording: Recording, ship: Particulars) -> Finding:
    """Samples that are missing."""
    steps = np.diff(recording.time)
    holes = np.flatnonzero(steps > GAP_STEPS * recording.step)
    filled = recording.meta.get("gaps", {})
    told = "; filled: " + ", ".join(f"{n} of {k}" for k, n in filled.items()) if filled else ""
    if not len(holes):
        return Finding("gaps", "note" if filled else "ok", f"no sample is missing{told}", tuple(filled), 0.0, unit="s")
    longest, bridged = float(steps.max()), MAX_BRIDGED_GAP * ship.time_unit
    spans = tuple((float(recording.time[k]), float(recording.time[k + 1])) for k in holes)
    text = f"{len(holes)} gap{'s' if len(holes) > 1 else ''}, the longest of {longest:.3g} s{told}"
    found = partial(
        Finding, "gaps", text=text, measured=longest, unit="s", expected=f"below {bridged:.3g} s", spans=spans
    )
    if longest <= bridged:
        return found(verdict="note")
    remedy, changes = cut(recording, [span for span in spans if span[1] - span[0] > bridged])
    return found(verdict="mend", remedy=remedy, changes=changes)


def outliers(recording: Recording) -> tuple[Finding, Flags]:
    """Single samples far off their neighbours, in a recording as it was written: the finding, and which samples."""
    odd = {k: _off(recording[k]) for k in _recorded(recording)}
    odd = {k: flags for k, flags in odd.items() if 0 < flags.mean() <= MAX_OUTLIER_SHARE}
    filled = recording.meta.get("outliers", {})
    if not odd:
        told = "filled: " + ", ".join(f"{n} of {k}" for k, n in filled.items()) if filled else "none"
        return Finding("outliers", "note" if filled else "ok", told, tuple(filled), 0.0, expected="0"), {}
    count = {k: int(flags.sum()) for k, flags in odd.items()}
    text = "single samples far off: " + ", ".join(f"{n} of {k}" for k, n in count.items())
    when = recording.time[np.any(list(odd.values()), axis=0)]
    found = Finding(
        "outliers", "mend", text, tuple(odd), float(sum(count.values())), expected="0",
        remedy="replace them by straight lines", changes=(Change("outliers", value="fill"),),
        spans=tuple((float(t), float(t)) for t in when),
    )  # fmt: skip
    return found, odd


def without_outliers(recording: Recording, flags: Flags) -> Recording:
    """Odd samples replaced by straight lines between their neighbours."""
    return recording.with_channels(**{k: line_across(recording.time, recording[k], f) for k, f in flags.items()})


def _off(values: Series) -> Bool[np.ndarray, " n"]:
    """Spikes of more than a channel's own step."""
    return spikes(values) & (np.abs(values - middle_of_neighbours(values)) > 1.6 * _step(values))


def stuck(recording: Recording, ship: Particulars) -> list[Finding]:
    """Channels that stand still while the ship turns.

    A run of equal samples counts if it is far longer than the others of its channel, which is what its resolution
    explains, and if the heading changes meanwhile; a heading is belied by r, r by the heading. A rudder may be held:
    it is stuck only where it never moves while the ship turns.

    Args:
        recording: The recording as written.
        ship: The ship.

    Returns:
        One finding a channel that is stuck; one ``ok`` if there is none.
    """
    turned = {"r": cumulative_trapezoid(recording["r"], recording.time, initial=0.0), "psi": recording["psi"]}
    every = {name: _standing(recording, ship, name, turned) for name in _recorded(recording)}
    found = {name: spans for name, spans in every.items() if spans}
    if not found:
        return [Finding("stuck", "ok", "every channel moves when the ship does")]
    if set(found) <= {*REPLACEMENTS, "delta"}:
        return [_stuck(recording, ship, (name,), spans) for name, spans in found.items()]
    # Nothing replaces one of them: what is left is a piece without the time in which they stand.
    return [_stuck(recording, ship, tuple(found), sorted(span for spans in found.values() for span in spans))]


def _standing(recording: Recording, ship: Particulars, name: str, turned: dict[str, Series]) -> Spans:
    """Times in which a channel stands still and others say that it should not."""
    begins, lengths = _runs(recording[name])
    usual = 1.0 if len(lengths) < 5 else float(np.quantile(np.repeat(lengths, lengths), 0.5))
    first, last = recording.time[begins], recording.time[begins + lengths - 1]
    lasting = (lengths > max(5 * usual, 4)) & (last - first > 0.15 * ship.time_unit)
    if name == "delta":
        lasting = lengths == len(recording)
    ends = zip(begins[lasting].tolist(), (begins + lengths - 1)[lasting].tolist(), strict=True)
    belied = [(a, b) for a, b in ends if _belied(recording, name, turned, a, b)]
    return [(float(recording.time[a]), float(recording.time[b])) for a, b in belied]


def _stuck(recording: Recording, ship: Particulars, names: tuple[str, ...], spans: Spans) -> Finding:
    """What to do about channels that stand still."""
    longest = max(b - a for a, b in spans)
    verb = "stands" if len(names) == 1 else "stand"
    found = partial(
        Finding, "stuck", text=f"{', '.join(names)} {verb} still for up to {longest:.3g} s while the ship moves",
        channels=names, measured=longest, unit="s", expected="shorter than its resolution explains", spans=tuple(spans),
    )  # fmt: skip
    if names == ("delta",):
        return found(verdict="refuse", remedy="map the column that holds the rudder angle: nothing replaces it")
    if longest < MAX_BRIDGED_GAP * ship.time_unit:
        return found(verdict="note", remedy="short beside L/U0, the smoother takes most of it away")
    remedy, changes = _leave_out(names[0], recording) if len(names) == 1 else ("", ())
    if not changes:
        remedy, changes = cut(recording, spans)
    return found(verdict="mend", remedy=remedy, changes=changes)


def quantized(recording: Recording, ship: Particulars) -> list[Finding]:
    """Channels that were written with too few digits: one finding each; one ``ok`` if there is none."""
    found = []
    for name in (k for k in _recorded(recording) if k != "delta"):
        if name in {"x", "y"}:
            found += _coarse_position(recording, name, ship)
            continue
        step, noise = _step(recording[name]), _noise(recording, name, ship)
        extent = float(np.ptp(np.quantile(recording[name], [0.02, 0.98])))
        # Noise of half a step dithers: averages are then finer than the step.
        if not step or noise > 0.5 * step or step < NOTED_STEP * extent:
            continue
        share = 100 * step / extent
        coarse = partial(
            Finding, "quantized", channels=(name,), measured=share, unit="% of range",
            text=f"{name} is written in steps of {step:.3g}, {share:.2g} % of its range, with less noise",
            expected=f"below {100 * NOTED_STEP:.0f} %",
        )  # fmt: skip
        if step > USELESS_STEP * extent and name in REPLACEMENTS:
            remedy, changes = _leave_out(name, recording)
            found.append(coarse(verdict="mend", remedy=remedy, changes=changes))
        else:
            found.append(coarse(verdict="note", remedy="write more digits; what is smoothed is still of use"))
    return found or [Finding("quantized", "ok", "steps are small beside noise or range")]


def _coarse_position(recording: Recording, name: str, ship: Particulars) -> list[Finding]:
    """Steps of a position against the ship's length, where they are largest: few digits are fewer far out."""
    time, values = recording.time, recording[name]
    pieces = np.array_split(np.arange(len(values)), max(int(recording.duration / ship.time_unit), 1))
    steps = [_step(values[rows]) for rows in pieces]
    step, rows = steps[int(np.argmax(steps))], pieces[int(np.argmax(steps))]
    if step < NOTED_POSITION_STEP * ship.length:
        return []
    coarse = partial(
        Finding, "quantized", channels=(name,), measured=step, unit="m",
        text=f"{name} is written in steps of up to {step:.3g} m, {100 * step / ship.length:.2g} % of L",
        expected=f"below {NOTED_POSITION_STEP * ship.length:.2g} m",
        spans=((float(time[rows[0]]), float(time[rows[-1]])),),
    )  # fmt: skip
    if step < USELESS_POSITION_STEP * ship.length:
        return [coarse(verdict="note", remedy="write more digits")]
    remedy, changes = _leave_out(name, recording)
    return [coarse(verdict="mend", remedy=remedy, changes=changes)]


def _leave_out(name: str, recording: Recording) -> tuple[str, tuple[Change, ...]]:
    """Take a channel out of the mapping, where something takes its place."""
    source = {"u": "x", "v": "x", "x": "u", "y": "u"}.get(name)
    if name not in REPLACEMENTS or source in recording.derived:
        return "nothing replaces it: give another record", ()
    group, instead = REPLACEMENTS[name]
    said = " and ".join(k for k in group if len(k) == 1)
    changes = tuple(Change(f"channels.{k}", "set", LEAVE_OUT) for k in group)
    return f"leave {said} out of the mapping, {instead}", changes


def cut(recording: Recording, spans: Spans) -> tuple[str, tuple[Change, ...]]:
    """Keep the longest piece between times that are left out, in order: the remedy in words and as changes."""
    ends = [(0.0, 0.0), *spans, (recording.duration, recording.duration)]
    begin, end = max(((a[1], b[0]) for a, b in zip(ends, ends[1:], strict=False)), key=lambda p: p[1] - p[0])
    # Seconds from the file's first sample: a recording that was cut already begins later.
    shift = float(recording.meta.get("since", 0.0))
    return piece(begin + shift, end + shift, begin > 0, end < recording.duration)


def piece(begin: float, end: float, later: bool, earlier: bool) -> tuple[str, tuple[Change, ...]]:
    """Keep what lies between two times of a file [s], where it begins later or ends earlier than the file."""
    changes = []
    if later:
        changes.append(Change("start", value=float(np.ceil(begin * 1e3 - 1e-6) / 1e3)))
    if earlier:
        changes.append(Change("end", value=float(np.floor(end * 1e3 + 1e-6) / 1e3)))
    return f"keep the piece from {begin:.6g} to {end:.6g} s", tuple(changes)


def _recorded(recording: Recording) -> list[str]:
    """Channels that the file has."""
    return [k for k in CHANNELS if k in recording.channels and k not in recording.derived]


def _runs(values: Series) -> tuple[Int[np.ndarray, " k"], Int[np.ndarray, " k"]]:
    """First samples and lengths of runs of equal values."""
    begins = np.concatenate([[0], np.flatnonzero(np.diff(values) != 0) + 1])
    return begins, np.diff(np.append(begins, len(values)))


def _belied(recording: Recording, name: str, turned: dict[str, Series], first: int, last: int) -> bool:
    """Whether the other channels say that a channel which stands still from one sample to another should not."""
    by_r, by_psi = (turned[k][last] - turned[k][first] for k in ("r", "psi"))
    if name == "r":
        return bool(abs(by_psi - by_r) > TURN)
    if name == "psi":
        return bool(abs(by_r) > TURN)
    if name == "delta":
        return bool(np.ptp(turned["psi"]) > 45 * DEGREE)
    if name in {"x", "y"}:
        rows = slice(first, last + 1)
        u, v, psi = (recording[k][rows] for k in ("u", "v", "psi"))
        along = np.cos if name == "x" else np.sin
        way = np.trapezoid(np.hypot(u, v) * along(psi + np.arctan2(v, u)), recording.time[rows])
        usual = float(np.quantile(np.abs(np.diff(recording[name])), 0.9))
        return bool(abs(way) > 5 * usual)
    rate = recording["r"][first : last + 1]
    if np.ptp(rate) < STEADY * abs(rate.mean()):  # nothing moves in a steady turn
        return False
    return bool(max(abs(by_r), abs(by_psi)) > 2 * TURN)


def _step(values: Series) -> float:
    """Smallest step between values that stand in the channel; 0 if it is too fine to matter."""
    levels = np.unique(values)
    if len(levels) < 2 or len(levels) > len(values) / 2:
        return 0.0
    steps = np.diff(levels)
    return float(np.median(steps[steps < 3 * np.quantile(steps, 0.25)]))


def _noise(recording: Recording, name: str, ship: Particulars) -> float:
    """Standard deviation of what the smoother takes away, as far as that is not the step itself."""
    window = min(WINDOW * ship.time_unit, MAX_WINDOW_SAMPLES * recording.step)
    rest = recording[name] - smoothed(recording.time, recording[name], window)[0]
    return float(np.sqrt(max(robust_sd(rest) ** 2 - _step(recording[name]) ** 2 / 12, 0.0)))
