"""Samples looked at one channel at a time: rate, gaps, outliers, channels that are stuck or coarsely written."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.integrate import cumulative_trapezoid

from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.ship import Particulars
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.recording.check.finding import LEAVE_OUT, Change, Finding
from manoeuvre_nn.recording.local_cubics import WINDOW, smoothed
from manoeuvre_nn.recording.outliers import middle_of_neighbours, robust_sd, spikes

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
MAX_WINDOW_SAMPLES = 400
"""Samples beyond which a longer window tells no more of the noise."""
BRIDGED = "short beside L/U0, the smoother takes most of it away"
CHANNELS = ("u", "v", "r", "x", "y", "psi", "delta", "n")
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


def sampling(recording: Recording, ship: Particulars) -> Finding:
    """Rate against the ship's own time, and evenness.

    Args:
        recording: The recording.
        ship: The ship.

    Returns:
        The finding.
    """
    steps, interval = _steps(recording)
    slowest = MAX_INTERVAL * ship.time_unit
    regular = steps[steps < GAP_STEPS * interval]
    off = float(np.abs(regular - interval).max() / interval) if len(regular) else 0.0
    said: dict[str, Any] = {"measured": interval, "unit": "s", "expected": f"below {slowest:.3g} s"}
    if interval > slowest * 1.001:
        text = f"a sample every {interval:.3g} s; the {ship.name} sails its length in {ship.time_unit:.3g} s"
        remedy = f"give a record with a sample every {slowest:.2g} s or more often"
        return Finding("sampling", "mend", text, remedy=remedy, **said)
    text = f"a sample every {interval:.3g} s, {ship.time_unit / interval:.0f} in the time of a ship length"
    if off > JITTER:
        text += f"; intervals differ by up to {100 * off:.0f} %: it is smoothed on an even grid"
        return Finding("sampling", "note", text, **said)
    return Finding("sampling", "ok", text, **said)


def _steps(recording: Recording) -> tuple[Series, float]:
    """Steps of time and the usual one [s]."""
    steps = np.diff(recording.time)
    return steps, float(np.median(steps))


def gaps(recording: Recording, ship: Particulars) -> Finding:
    """Samples that are missing.

    Args:
        recording: The recording.
        ship: The ship.

    Returns:
        The finding.
    """
    steps, interval = _steps(recording)
    holes = np.flatnonzero(steps > GAP_STEPS * interval)
    filled = recording.meta.get("gaps", {})
    told = "; filled: " + ", ".join(f"{n} of {k}" for k, n in filled.items()) if filled else ""
    if not len(holes):
        return Finding("gaps", "note" if filled else "ok", f"no sample is missing{told}", tuple(filled), 0.0, unit="s")
    longest = float(steps.max())
    spans = tuple((float(recording.time[k]), float(recording.time[k + 1])) for k in holes)
    said: dict[str, Any] = {
        "measured": longest,
        "unit": "s",
        "expected": f"below {MAX_BRIDGED_GAP * ship.time_unit:.3g} s",
        "spans": spans,
    }
    text = f"{len(holes)} gap{'s' if len(holes) > 1 else ''}, the longest of {longest:.3g} s{told}"
    if longest <= MAX_BRIDGED_GAP * ship.time_unit:
        return Finding("gaps", "note", text, **said)
    long = [span for span in spans if span[1] - span[0] > MAX_BRIDGED_GAP * ship.time_unit]
    remedy, changes = cut(recording, long)
    return Finding("gaps", "mend", text, remedy=remedy, changes=changes, **said)


def outliers(recording: Recording) -> tuple[Finding, Flags]:
    """Single samples far off their neighbours.

    Args:
        recording: The recording as written.

    Returns:
        The finding, and which samples.
    """
    odd = {k: _off(recording[k]) for k in _recorded(recording) if k != "n"}
    odd = {k: flags for k, flags in odd.items() if 0 < flags.mean() <= MAX_OUTLIER_SHARE}
    filled = recording.meta.get("outliers", {})
    count = sum(int(f.sum()) for f in odd.values())
    if not odd:
        told = "filled: " + ", ".join(f"{n} of {k}" for k, n in filled.items()) if filled else "none"
        return Finding("outliers", "note" if filled else "ok", told, tuple(filled), 0.0, expected="0"), {}
    text = "single samples far off: " + ", ".join(f"{int(f.sum())} of {k}" for k, f in odd.items())
    found = Finding(
        "outliers", "mend", text, tuple(odd), float(count), expected="0", remedy="replace them by straight lines",
        changes=(Change("outliers", value="fill"),), spans=_spans(recording.time, np.any(list(odd.values()), axis=0)),
    )  # fmt: skip
    return found, odd


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
    found = []
    turned = _turned(recording)
    for name in _recorded(recording):
        if name == "n":
            continue
        begins, lengths = _runs(recording[name])
        usual = 1.0 if len(lengths) < 5 else float(np.quantile(np.repeat(lengths, lengths), 0.5))
        spans = []
        for begin, length in zip(begins, lengths, strict=True):
            seconds = recording.time[begin + length - 1] - recording.time[begin]
            lasting = length > 5 * usual and length >= 5 and seconds > 0.15 * ship.time_unit
            if name == "delta":
                lasting = length == len(recording)
            if lasting and _belied(recording, name, turned, begin, begin + length - 1):
                spans.append((float(recording.time[begin]), float(recording.time[begin + length - 1])))
        if spans:
            found.append((name, spans))
    if not found:
        return [Finding("stuck", "ok", "every channel moves when the ship does")]
    if any(name not in {*REPLACEMENTS, "delta"} for name, _ in found):  # nothing replaces it: the piece is cut out
        names, every = zip(*found, strict=True)
        return [_frozen(recording, ship, names, sorted(span for spans in every for span in spans))]
    return [_stuck(recording, ship, name, spans) for name, spans in found]


def quantized(recording: Recording, ship: Particulars) -> list[Finding]:
    """Channels that were written with too few digits.

    Args:
        recording: The recording as written.
        ship: The ship.

    Returns:
        One finding a channel that is coarse; one ``ok`` if there is none.
    """
    found = []
    for name in (k for k in _recorded(recording) if k not in {"delta", "n"}):
        if name in {"x", "y"}:
            found += _coarse_position(recording, name, ship)
            continue
        step, noise = _step(recording[name]), _noise(recording, name, ship)
        extent = float(np.ptp(np.quantile(recording[name], [0.02, 0.98])))
        # Noise of half a step dithers: averages are then finer than the step.
        if not step or noise > 0.5 * step or step < NOTED_STEP * extent:
            continue
        text = f"{name} is written in steps of {step:.3g}, {100 * step / extent:.2g} % of its range, with less noise"
        said: dict[str, Any] = {
            "measured": 100 * step / extent,
            "unit": "% of range",
            "expected": f"below {100 * NOTED_STEP:.0f} %",
        }
        if step > USELESS_STEP * extent and name in REPLACEMENTS:
            remedy, changes = _leave_out(name, recording)
            found.append(Finding("quantized", "mend", text, (name,), remedy=remedy, changes=changes, **said))
        else:
            more = "write more digits; what is smoothed is still of use"
            found.append(Finding("quantized", "note", text, (name,), remedy=more, **said))
    return found or [Finding("quantized", "ok", "steps are small beside noise or range")]


def _coarse_position(recording: Recording, name: str, ship: Particulars) -> list[Finding]:
    """Steps of a position against the ship's length, where they are largest: few digits are fewer far out."""
    time, values = recording.time, recording[name]
    pieces = np.array_split(np.arange(len(values)), max(int(recording.duration / ship.time_unit), 1))
    steps = [_step(values[rows]) for rows in pieces]
    step, rows = steps[int(np.argmax(steps))], pieces[int(np.argmax(steps))]
    if step < NOTED_POSITION_STEP * ship.length:
        return []
    text = f"{name} is written in steps of up to {step:.3g} m, {100 * step / ship.length:.2g} % of L"
    said: dict[str, Any] = {
        "measured": step,
        "unit": "m",
        "expected": f"below {NOTED_POSITION_STEP * ship.length:.2g} m",
        "spans": ((float(time[rows[0]]), float(time[rows[-1]])),),
    }
    if step < USELESS_POSITION_STEP * ship.length:
        return [Finding("quantized", "note", text, (name,), remedy="write more digits", **said)]
    remedy, changes = _leave_out(name, recording)
    return [Finding("quantized", "mend", text, (name,), remedy=remedy, changes=changes, **said)]


def _leave_out(name: str, recording: Recording) -> tuple[str, tuple[Change, ...]]:
    """Take a channel out of the mapping, where something takes its place."""
    derived = recording.derived
    source = {"u": "x", "v": "x", "x": "u", "y": "u"}.get(name)
    if name not in REPLACEMENTS or source in derived:
        return "nothing replaces it: give another record", ()
    group, instead = REPLACEMENTS[name]
    said = " and ".join(k for k in group if len(k) == 1)
    changes = tuple(Change(f"channels.{k}", "set", LEAVE_OUT) for k in group)
    return f"leave {said} out of the mapping, {instead}", changes


def cut(recording: Recording, spans: Sequence[tuple[float, float]]) -> tuple[str, tuple[Change, ...]]:
    """Keep the longest piece between some times.

    Args:
        recording: The recording.
        spans: Times to leave out, in order [s].

    Returns:
        The remedy in words and as changes.
    """
    ends = [(0.0, 0.0), *spans, (recording.duration, recording.duration)]
    pieces = [(a[1], b[0]) for a, b in zip(ends, ends[1:], strict=False)]
    begin, end = max(pieces, key=lambda p: p[1] - p[0])
    # Seconds from the file's first sample: a recording that was cut already begins later.
    shift = float(recording.meta.get("since", 0.0))
    changes = []
    if begin > 0:
        changes.append(Change("start", value=_up(begin + shift)))
    if end < recording.duration:
        changes.append(Change("end", value=_down(end + shift)))
    return f"keep the piece from {begin + shift:.6g} to {end + shift:.6g} s", tuple(changes)


def _up(value: float) -> float:
    return float(np.ceil(value * 1e3) / 1e3)


def _down(value: float) -> float:
    return float(np.floor(value * 1e3) / 1e3)


def _recorded(recording: Recording) -> list[str]:
    """Channels that the file has."""
    derived = recording.derived
    return [k for k in CHANNELS if k in recording.channels and k not in derived]


def _runs(values: Series) -> tuple[Int[np.ndarray, " k"], Int[np.ndarray, " k"]]:
    """First samples and lengths of runs of equal values."""
    begins = np.concatenate([[0], np.flatnonzero(np.diff(values) != 0) + 1])
    return begins, np.diff(np.append(begins, len(values)))


def _turned(recording: Recording) -> dict[str, Series]:
    """How far the ship has turned, by r and by psi [rad]."""
    return {"r": cumulative_trapezoid(recording["r"], recording.time, initial=0.0), "psi": recording["psi"]}


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
        along = np.cos if name == "x" else np.sin
        time = recording.time[first : last + 1]
        drift = np.arctan2(recording["v"], recording["u"])[first : last + 1]
        rate = np.hypot(recording["u"], recording["v"])[first : last + 1]
        way = np.trapezoid(rate * along(recording["psi"][first : last + 1] + drift), time)
        usual = float(np.quantile(np.abs(np.diff(recording[name])), 0.9))
        return bool(abs(way) > 5 * usual)
    return bool(max(abs(by_r), abs(by_psi)) > 2 * TURN)


def _stuck(recording: Recording, ship: Particulars, name: str, spans: Sequence[tuple[float, float]]) -> Finding:
    """A channel that something replaces, or the rudder."""
    remedy, changes = _leave_out(name, recording)
    if name == "delta":
        remedy = "map the column that holds the rudder angle: nothing replaces it"
    elif not changes:
        remedy, changes = cut(recording, spans)
    if name != "delta" and _short(spans, ship):
        return Finding("stuck", "note", remedy=BRIDGED, **_standing((name,), spans))
    verdict = "refuse" if name == "delta" else "mend"
    return Finding("stuck", verdict, remedy=remedy, changes=changes, **_standing((name,), spans))


def _short(spans: Sequence[tuple[float, float]], ship: Particulars) -> bool:
    """Whether every time is short beside the ship's own."""
    return max(b - a for a, b in spans) < MAX_BRIDGED_GAP * ship.time_unit


def _frozen(
    recording: Recording, ship: Particulars, names: Sequence[str], spans: Sequence[tuple[float, float]]
) -> Finding:
    """Channels of which one cannot be replaced: what is left is a piece without the time in which they stand."""
    if _short(spans, ship):
        return Finding("stuck", "note", remedy=BRIDGED, **_standing(tuple(names), spans))
    remedy, changes = cut(recording, spans)
    return Finding("stuck", "mend", remedy=remedy, changes=changes, **_standing(tuple(names), spans))


def _standing(names: tuple[str, ...], spans: Sequence[tuple[float, float]]) -> dict[str, Any]:
    longest = max(b - a for a, b in spans)
    verb = "stands" if len(names) == 1 else "stand"
    return {
        "text": f"{', '.join(names)} {verb} still for up to {longest:.3g} s while the ship moves",
        "channels": names,
        "measured": longest,
        "unit": "s",
        "expected": "shorter than its resolution explains",
        "spans": tuple(spans),
    }


def _step(values: Series) -> float:
    """Smallest step between values that stand in the channel; 0 if it is too fine to matter."""
    levels = np.unique(values)
    if len(levels) < 2 or len(levels) > len(values) / 2:
        return 0.0
    steps = np.diff(levels)
    return float(np.median(steps[steps < 3 * np.quantile(steps, 0.25)]))


def _noise(recording: Recording, name: str, ship: Particulars) -> float:
    """Standard deviation of what the smoother takes away, as far as that is not the step itself."""
    window = min(WINDOW * ship.time_unit, MAX_WINDOW_SAMPLES * _steps(recording)[1])
    smooth, _ = smoothed(recording.time, recording[name], window)
    rest = recording[name] - smooth
    return float(np.sqrt(max(robust_sd(rest) ** 2 - _step(recording[name]) ** 2 / 12, 0.0)))


def _spans(time: Series, flags: Bool[np.ndarray, " n"]) -> tuple[tuple[float, float], ...]:
    """Times of flagged samples."""
    return tuple((float(t), float(t)) for t in time[flags])
