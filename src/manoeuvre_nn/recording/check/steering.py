"""The rudder: does it move as a steering gear can, when does it act, and was the ship steady before it moved."""

from functools import partial

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.numerics.finite_algebra import lstsq
from manoeuvre_nn.recording.check.finding import Change, Finding
from manoeuvre_nn.recording.local_cubics import WINDOW, smoothed
from manoeuvre_nn.recording.outliers import robust_sd

MAX_RATE_RATIO = 1.5
"""Share of the steering gear's rate beyond which a rudder jumps."""
MAX_RUDDER_RATE = 350 * DEGREE
"""Rate over U0/L that no steering gear reaches: of full-scale ships 30 to 100 deg, of models the same."""
JUMP = 3 * DEGREE
"""Least step that counts as a jump."""
MIN_SIGMAS = 4.0
"""Standard errors from which on an approach is not steady."""
UNSTEADY = {"u": 0.01, "v": 0.02, "r": 0.03}
"""What u, v and r may change by in the time L/U0 of an approach, over U0, U0 and U0/L."""
SETTLED = 1.0
"""Shortest approach over L/U0 in which a slope can be seen."""
SWAY = {"u": 0.01, "v": 0.015, "r": 0.02}
"""Turning and drifting at the first sample that no straight approach has, over U0, U0 and U0/L."""
PRIME = {"u": "U0", "v": "U0", "r": "U0/L"}
LAGS = 1.0
"""Longest time over L/U0 by which the rudder may be late or early."""
GAIN = 1.3
"""What is left of the yaw acceleration without a lag over what is left with one, for the lag to be believed."""

Series = Float[np.ndarray, " n"]


def rudder_jumps(recording: Recording, ship: Particulars) -> Finding:
    """Whether the rudder moves faster than the steering gear: then the file holds the order."""
    delta, steps = recording["delta"], np.diff(recording.time)
    gear = min(ship.rudder_rate, MAX_RUDDER_RATE / ship.time_unit)
    change = np.abs(np.diff(delta))
    usual = 4 * robust_sd(change[change <= np.quantile(change, 0.9)])
    jumps = np.flatnonzero(change > np.maximum(MAX_RATE_RATIO * gear * steps + usual, JUMP))
    found = partial(
        Finding, "rudder jumps", channels=("delta",), measured=float((change / steps).max()) / DEGREE, unit="deg/s",
        expected=f"up to {gear / DEGREE:.3g} deg/s",
    )  # fmt: skip
    if len(jumps) < 2:
        return found("ok", "the rudder moves as a steering gear can")
    spans = tuple((float(recording.time[k]), float(recording.time[k + 1])) for k in jumps)
    text = (
        f"the rudder jumps {len(jumps)} times, by up to {change.max() / DEGREE:.3g} deg within "
        f"{steps[jumps].min():.3g} s; this is an order and not an angle"
    )
    if ship.rudder_rate > MAX_RATE_RATIO * gear:
        remedy = f"state the steering gear's rate (rudder_rate of the {ship.name} is not known), then rudder: order"
        return found("note", text, remedy=remedy, spans=spans)
    remedy, changes = "let the ship's steering gear follow it", (Change("rudder", value="order"),)
    return found("mend", text, remedy=remedy, changes=changes, spans=spans)


def rudder_lag(recording: Recording, ship: Particulars) -> Finding | None:
    """By how much the yaw acceleration follows the rudder too late for a rudder that acts at once.

    ``rdot = a r + b v + c r^3 + d delta(t + late) + e`` is fitted for every lag. A delay of the rudder's column, the
    steering gear's and the hull's own lag look alike: the lag is told, and nothing is mended by it.

    Args:
        recording: The recording, without outliers.
        ship: The ship.

    Returns:
        The finding; None where the rudder hardly moves.
    """
    time, window = recording.time, 0.5 * WINDOW * ship.time_unit
    (v, _), (r, rdot), (delta, _) = (smoothed(time, recording[k], window) for k in ("v", "r", "delta"))
    if np.ptp(np.quantile(delta, [0.02, 0.98])) < 2 * DEGREE:
        return None
    span = LAGS * ship.time_unit
    stride = max(round(0.25 * window / recording.step), 1)
    rows = np.flatnonzero((time >= time[0] + span) & (time <= time[-1] - span))[::stride]
    if len(rows) < 20:
        return None
    lags = np.linspace(-span, span, 81)
    motion = np.stack([r, v, r**3, v * r * r, np.ones_like(r)], axis=1)[rows]
    costs = np.array([_misfit(np.interp(time[rows] + lag, time, delta), motion, rdot[rows]) for lag in lags])
    best = int(np.argmin(costs))
    if best in {0, len(lags) - 1}:
        return None
    found = partial(Finding, "rudder lag", channels=("delta",))
    in_time = "rudder and yaw acceleration fit in time"
    if costs[len(lags) // 2] < GAIN * costs[best] or _moves(recording["delta"]) < 3:
        return found("ok", in_time)
    curve = np.polyfit(lags[best - 1 : best + 2] - lags[best], costs[best - 1 : best + 2], 2)
    bend = max(curve[0], 1e-300)
    late = float(lags[best] - curve[1] / (2 * bend))
    # A quarter of the samples count, for windows overlap; and the equation is not the ship's.
    error = float(np.hypot(np.sqrt(costs[best] / (len(rows) / 4) / bend), 0.05 * ship.time_unit))
    found = partial(found, measured=late, error=error, unit="s", expected="0, less gear and hull")
    if abs(late) < 3 * error:
        return found("ok", in_time)
    more = (
        "a late column, or a smoothed one"
        if late > 0
        else "an order, a steering gear or a hull that lags: they cannot be told apart without the measured angle"
    )
    side = "later" if late > 0 else "earlier"
    return found("note", f"the yaw acceleration fits the rudder of {abs(late):.2g} s {side} best: {more}")


def steady_approach(recording: Recording, ship: Particulars) -> Finding:
    """Whether the ship ran straight and steadily before its first execute; the remedy begins where it did."""
    time, execute, unit = recording.time, _first_execute(recording["delta"]), ship.time_unit
    length = float(time[execute] - time[0])
    if execute < 5 or length < SETTLED * unit:
        return _at_first_sample(recording, ship, length)
    slopes = _slopes(recording, ship, 0, execute)
    bad = _unsteady(slopes)
    name = max(bad or slopes, key=lambda k: abs(slopes[k][0]) / UNSTEADY[k])
    found = partial(
        Finding, "approach", measured=slopes[name][0], error=slopes[name][1], unit=f"{PRIME[name]} in L/U0",
        expected=f"{name}: below {UNSTEADY[name]:g}",
    )  # fmt: skip
    if not bad:
        return found("ok", f"straight and steady for {length / unit:.2g} L/U0")
    said = (f"{k} changes by {slopes[k][0]:.2g} ± {slopes[k][1]:.1g} {PRIME[k]} in L/U0" for k in bad)
    text = f"the approach is not steady: {', '.join(said)}"
    found = partial(found, text=text, channels=tuple(bad), spans=((0.0, length),))
    for start in np.linspace(0, execute, 12)[1:].astype(int):
        if time[execute] - time[start] >= SETTLED * unit and not _unsteady(_slopes(recording, ship, start, execute)):
            at = float(np.ceil(1e3 * (time[start] + recording.meta.get("since", 0.0))) / 1e3)
            remedy = f"begin at {at:.6g} s, when it is steady"
            return found(verdict="mend", remedy=remedy, changes=(Change("start", value=at),))
    remedy = (
        "it is never steady before the first execute: predict from the recorded state, not from a straight approach"
    )
    return found(verdict="note", remedy=remedy)


def _at_first_sample(recording: Recording, ship: Particulars, length: float) -> Finding:
    """Without an approach there is only the state in which the record begins."""
    count = max(int((recording.time <= max(length, 0.1 * ship.time_unit)).sum()), 2)
    level, bad = {}, []
    for name in ("v", "r"):
        scale = _scale(name, ship)
        level[name] = float(np.median(recording[name][:count])) / scale
        rest = recording[name] - smoothed(recording.time, recording[name], WINDOW * ship.time_unit)[0]
        if abs(level[name]) > SWAY[name] + MIN_SIGMAS * robust_sd(rest) / scale / np.sqrt(count):
            bad.append(name)
    begins = f"the record begins {length / ship.time_unit:.2g} L/U0 before its first execute"
    if not bad:
        return Finding("approach", "ok", f"{begins}, straight ahead", expected="v, r near 0")
    state = ", ".join(f"{k}' = {level[k]:.2g}" for k in bad)
    remedy = "give a longer record, or predict from the recorded state, not from a straight approach"
    return Finding("approach", "note", f"{begins} with {state}", tuple(bad), expected="v, r near 0", remedy=remedy)


def _first_execute(delta: Series) -> int:
    """Sample at which the rudder leaves where it was."""
    off = np.abs(delta - np.median(delta[:5]))
    moved = off > max(0.3 * float(np.quantile(off, 0.95)), 1.5 * DEGREE)
    return int(np.argmax(moved)) if moved.any() else len(delta) - 1


def _scale(name: str, ship: Particulars) -> float:
    """What u, v or r is made non-dimensional by."""
    return 1 / ship.time_unit if name == "r" else ship.speed


def _slopes(recording: Recording, ship: Particulars, first: int, last: int) -> dict[str, tuple[float, float]]:
    """Change in the time L/U0 of u', v', r' with standard errors."""
    time = recording.time[first:last] / ship.time_unit
    columns = np.stack([np.ones_like(time), time - time.mean()], axis=1)
    inverse = np.linalg.inv(columns.T @ columns)[1, 1]
    found = {}
    for name in UNSTEADY:
        values = recording[name][first:last] / _scale(name, ship)
        fit = lstsq(columns, values)
        # A bend is no noise: what a cubic leaves is.
        rest = values - np.polynomial.Polynomial.fit(time, values, 3)(time)
        variance = float(rest @ rest) / max(len(rest) / _memory(rest) - 2, 1)
        found[name] = (float(fit[1]), float(np.sqrt(variance * inverse)))
    return found


def _memory(rest: Series) -> float:
    """How many samples tell as much as one independent one."""
    size = float(rest @ rest)
    if size <= 0:
        return 1.0
    correlation = float(np.clip(rest[1:] @ rest[:-1] / size, 0.0, 0.95))
    return (1 + correlation) / (1 - correlation)


def _unsteady(slopes: dict[str, tuple[float, float]]) -> list[str]:
    return [k for k, (slope, error) in slopes.items() if abs(slope) > max(UNSTEADY[k], MIN_SIGMAS * error)]


def _moves(delta: Series) -> int:
    """How often the rudder goes from one side of its middle to the other."""
    side = np.sign(delta - 0.5 * (delta.max() + delta.min()))
    side = side[side != 0]
    return int((side[1:] != side[:-1]).sum())


def _misfit(delta: Series, motion: Float[np.ndarray, "n 5"], rdot: Series) -> float:
    """What is left of the yaw acceleration with the rudder of another time, mean square."""
    columns = np.column_stack([delta, delta**3, motion])
    columns = columns / np.maximum(np.abs(columns).max(axis=0), 1e-300)
    fit = lstsq(columns, rdot)
    return float(np.mean((rdot - columns @ fit) ** 2))
