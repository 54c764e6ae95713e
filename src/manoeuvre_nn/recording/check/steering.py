"""The rudder: does it move as a steering gear can, when does it act, and was the ship steady before it moved."""

from typing import Any

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.ship import Particulars
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.recording.check.finding import Change, Finding
from manoeuvre_nn.recording.local_cubics import WINDOW, smoothed
from manoeuvre_nn.recording.outliers import robust_sd
from manoeuvre_nn.recording.read.mending import line_across

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
LAGS = 1.0
"""Longest time over L/U0 by which the rudder may be late or early."""
GAIN = 1.3
"""What is left of the yaw acceleration without a lag over what is left with one, for the lag to be believed."""

Series = Float[np.ndarray, " n"]


def rudder_jumps(recording: Recording, ship: Particulars) -> Finding:
    """Whether the rudder moves faster than the steering gear: then the file holds the order.

    Args:
        recording: The recording, without outliers.
        ship: The ship.

    Returns:
        The finding.
    """
    delta, steps = recording["delta"], np.diff(recording.time)
    gear = min(ship.rudder_rate, MAX_RUDDER_RATE / ship.time_unit)
    change = np.abs(np.diff(delta))
    usual = 4 * robust_sd(change[change <= np.quantile(change, 0.9)])
    jumps = np.flatnonzero(change > np.maximum(MAX_RATE_RATIO * gear * steps + usual, JUMP))
    fastest = float((change / steps).max())
    said: dict[str, Any] = {
        "measured": fastest / DEGREE,
        "unit": "deg/s",
        "expected": f"up to {gear / DEGREE:.3g} deg/s",
    }
    if len(jumps) < 2:
        return Finding("rudder jumps", "ok", "the rudder moves as a steering gear can", ("delta",), **said)
    spans = tuple((float(recording.time[k]), float(recording.time[k + 1])) for k in jumps)
    text = (
        f"the rudder jumps {len(jumps)} times, by up to {change.max() / DEGREE:.3g} deg within "
        f"{steps[jumps].min():.3g} s; this is an order and not an angle"
    )
    if ship.rudder_rate > MAX_RATE_RATIO * gear:
        remedy = f"state the steering gear's rate (rudder_rate of the {ship.name} is not known), then rudder: order"
        return Finding("rudder jumps", "note", text, ("delta",), remedy=remedy, spans=spans, **said)
    remedy, changes = "let the ship's steering gear follow it", (Change("rudder", value="order"),)
    return Finding("rudder jumps", "mend", text, ("delta",), remedy=remedy, changes=changes, spans=spans, **said)


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
    inside = (time >= time[0] + span) & (time <= time[-1] - span)
    stride = max(round(0.25 * window / float(np.median(np.diff(time)))), 1)
    lags = np.linspace(-span, span, 81)
    if inside[::stride].sum() < 20:
        return None
    costs = np.array([_misfit(time, (v, r, delta), rdot, lag, inside, stride) for lag in lags])
    best = int(np.argmin(costs))
    if best in {0, len(lags) - 1}:
        return None
    if costs[len(lags) // 2] < GAIN * costs[best] or _moves(recording["delta"]) < 3:
        return Finding("rudder lag", "ok", "rudder and yaw acceleration fit in time", ("delta",))
    curve = np.polyfit(lags[best - 1 : best + 2] - lags[best], costs[best - 1 : best + 2], 2)
    late = float(lags[best] - curve[1] / (2 * max(curve[0], 1e-300)))
    count = inside[::stride].sum() / 4  # a quarter: windows overlap
    error = float(np.sqrt(costs[best] / count / max(curve[0], 1e-300)))
    error = float(np.hypot(error, 0.05 * ship.time_unit))  # the equation is not the ship's
    said: dict[str, Any] = {"measured": late, "error": error, "unit": "s", "expected": "0, less gear and hull"}
    text = f"the yaw acceleration fits the rudder of {abs(late):.2g} s {'later' if late > 0 else 'earlier'} best"
    if abs(late) < 3 * error:
        return Finding("rudder lag", "ok", "rudder and yaw acceleration fit in time", ("delta",), **said)
    more = (
        "a late column, or a smoothed one"
        if late > 0
        else "an order, a steering gear or a hull that lags: they cannot be told apart without the measured angle"
    )
    return Finding("rudder lag", "note", f"{text}: {more}", ("delta",), **said)


def steady_approach(recording: Recording, ship: Particulars) -> Finding:
    """Whether the ship ran straight and steadily before its first execute.

    Args:
        recording: The recording, without outliers.
        ship: The ship.

    Returns:
        The finding; its remedy begins later where the ship was steady later.
    """
    execute = _first_execute(recording["delta"])
    unit = ship.time_unit
    length = float(recording.time[execute] - recording.time[0])
    if execute < 5 or length < SETTLED * unit:
        return _at_first_sample(recording, ship, length)
    slopes = _slopes(recording, ship, 0, execute)
    bad = _unsteady(slopes)
    said = _said(slopes, bad)
    if not bad:
        return Finding("approach", "ok", f"straight and steady for {length / unit:.2g} L/U0", **said)
    text = f"the approach is not steady: {', '.join(_words(k, slopes[k]) for k in bad)}"
    spans = ((0.0, length),)
    for start in np.linspace(0, execute, 12)[1:].astype(int):
        left = recording.time[execute] - recording.time[start]
        if left >= SETTLED * unit and not _unsteady(_slopes(recording, ship, start, execute)):
            at = float(np.ceil(1e3 * (recording.time[start] + recording.meta.get("since", 0.0))) / 1e3)
            remedy = f"begin at {at:.6g} s, when it is steady"
            return Finding(
                "approach", "mend", text, tuple(bad), remedy=remedy, changes=(Change("start", value=at),),
                spans=spans, **said,
            )  # fmt: skip
    more = "it is never steady before the first execute: predict from the recorded state, not from a straight approach"
    return Finding("approach", "note", text, tuple(bad), remedy=more, spans=spans, **said)


def _at_first_sample(recording: Recording, ship: Particulars, length: float) -> Finding:
    """Without an approach there is only the state in which the record begins."""
    units = {"u": ship.speed, "v": ship.speed, "r": 1 / ship.time_unit}
    count = max(int((recording.time <= max(length, 0.1 * ship.time_unit)).sum()), 2)
    level = {k: float(np.median(recording[k][:count])) / units[k] for k in ("v", "r")}
    noise = {k: _noise(recording, k, ship) / units[k] for k in level}
    bad = [k for k in level if abs(level[k]) > SWAY[k] + MIN_SIGMAS * noise[k] / np.sqrt(count)]
    begins = f"the record begins {length / ship.time_unit:.2g} L/U0 before its first execute"
    if not bad:
        return Finding("approach", "ok", f"{begins}, straight ahead", expected="v, r near 0")
    state = ", ".join(f"{k}' = {level[k]:.2g}" for k in bad)
    remedy = "give a longer record, or predict from the recorded state, not from a straight approach"
    return Finding("approach", "note", f"{begins} with {state}", tuple(bad), expected="v, r near 0", remedy=remedy)


def _first_execute(delta: Series) -> int:
    """Sample at which the rudder leaves where it was."""
    level = float(np.quantile(np.abs(delta - np.median(delta[:5])), 0.95))
    moved = np.abs(delta - np.median(delta[:5])) > max(0.3 * level, 1.5 * DEGREE)
    return int(np.argmax(moved)) if moved.any() else len(delta) - 1


def _slopes(recording: Recording, ship: Particulars, first: int, last: int) -> dict[str, tuple[float, float]]:
    """Change in the time L/U0 of u', v', r' with standard errors."""
    unit = ship.time_unit
    units = {"u": ship.speed, "v": ship.speed, "r": 1 / unit}
    time = recording.time[first:last] / unit
    columns = np.stack([np.ones_like(time), time - time.mean()], axis=1)
    found = {}
    for name, scale in units.items():
        values = recording[name][first:last] / scale
        fit, *_ = np.linalg.lstsq(columns, values, rcond=None)
        # A bend is no noise: what a cubic leaves is.
        rest = values - np.polynomial.Polynomial.fit(time, values, 3)(time)
        inverse = np.linalg.inv(columns.T @ columns)[1, 1]
        memory = _memory(rest)
        variance = float(rest @ rest) / max(len(rest) / memory - 2, 1)
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


def _said(slopes: dict[str, tuple[float, float]], bad: list[str]) -> dict[str, Any]:
    """The slope that is furthest off, for the table."""
    name = max(bad or slopes, key=lambda k: abs(slopes[k][0]) / UNSTEADY[k])
    value, error = slopes[name]
    unit = {"u": "U0", "v": "U0", "r": "U0/L"}[name]
    expected = f"{name}: below {UNSTEADY[name]:g}"
    return {"measured": value, "error": error, "unit": f"{unit} in L/U0", "expected": expected}


def _words(name: str, slope: tuple[float, float]) -> str:
    value, error = slope
    unit = {"u": "U0", "v": "U0", "r": "U0/L"}[name]
    return f"{name} changes by {value:.2g} ± {error:.1g} {unit} in L/U0"


def _noise(recording: Recording, name: str, ship: Particulars) -> float:
    smooth, _ = smoothed(recording.time, recording[name], WINDOW * ship.time_unit)
    return robust_sd(recording[name] - smooth)


def _moves(delta: Series) -> int:
    """How often the rudder goes from one side of its middle to the other."""
    side = np.sign(delta - 0.5 * (delta.max() + delta.min()))
    side = side[side != 0]
    return int((side[1:] != side[:-1]).sum())


def _misfit(
    time: Series, motion: tuple[Series, Series, Series], rdot: Series, late: float, inside: np.ndarray, stride: int
) -> float:
    """What is left of the yaw acceleration with the rudder of another time, mean square."""
    v, r, delta = motion
    there = np.interp(time + late, time, delta)
    columns = np.stack([there, there**3, r, v, r**3, v * r * r, np.ones_like(r)], axis=1)[inside][::stride]
    target = rdot[inside][::stride]
    size = np.maximum(np.abs(columns).max(axis=0), 1e-300)
    fit, *_ = np.linalg.lstsq(columns / size, target, rcond=None)
    return float(np.mean((target - columns / size @ fit) ** 2))


def without_outliers(recording: Recording, flags: dict[str, np.ndarray]) -> Recording:
    """Replace odd samples by straight lines between their neighbours.

    Args:
        recording: The recording.
        flags: Channel -> which samples.

    Returns:
        The recording.
    """
    return recording.with_channels(**{k: line_across(recording.time, recording[k], f) for k, f in flags.items()})
