"""Channels that never move, or whose samples have no order in time, while others say that the ship moves.

Von Neumann's ratio of the mean square difference of successive samples to the variance is 2 on average if the samples
come in any order, whatever they are, and small for a motion that is sampled finely. Noise alone has no order either:
so a channel is complained of only where the others say that most of what it shows must be motion.

Source:
    von Neumann 1941, Ann. Math. Stat. 12, 367-395; the ratio's standard deviation is 2 / sqrt(n) for large n.
"""

import numpy as np
from jaxtyping import Float, Inexact

from manoeuvre_nn.core.frames import earth_to_body
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.recording.check.finding import Finding, refused
from manoeuvre_nn.recording.check.motion import TURNED
from manoeuvre_nn.recording.local_cubics import WINDOW, noise_left, smoothed
from manoeuvre_nn.recording.thinning import thinned

CRITICAL_SDS = 3.09
"""Standard deviations below 2 that a ratio is with a probability of .1 % only, if the samples come in any order."""
NOISE_SDS, RANGE_SDS = 2.0, 3.0
"""Standard deviations of noise that are taken off a variance, and that its largest and smallest sample are away."""
ROUNDING = 1e-12
"""Share of a channel's size below which its deviation is nothing but rounding."""
MOTION_SHARE = 0.5
"""Share of a channel's variance that others say is motion, from which on it must have an order, if it shows as large a
share of that motion's."""

UNEVEN = 0.1
"""Share of a rate that it must vary by, as others tell, for one that never moves to be no steady turn or speed."""

Series = Float[np.ndarray, " n"]


def disorder(values: Inexact[np.ndarray, " n"]) -> tuple[float, float]:
    """Von Neumann's ratio of a series, and what it exceeds if the samples come in any order.

    Args:
        values: Samples, NaN where there is none; complex where they have two components.

    Returns:
        The ratio and its critical value; NaN for a series that never moves.
    """
    there = np.isfinite(values)
    both = there[1:] & there[:-1]
    away = values[there] - values[there].mean() if there.any() else np.zeros(1)
    size = float(np.mean(np.abs(away) ** 2))
    if not both.any() or np.sqrt(size) <= ROUNDING * float(np.abs(values[there]).max()):
        return np.nan, np.nan
    ratio = float(np.mean(np.abs(np.diff(values)[both]) ** 2)) / size
    return ratio, 2 - 2 * CRITICAL_SDS / float(np.sqrt(both.sum()))


def no_order(recording: Recording, ship: Particulars) -> Finding | None:
    """A channel without an order in time, or one of heading and positions that never moves, where others tell."""
    run = thinned(recording, ship)
    has = {k for k in run.channels if k not in run.derived and np.isfinite(run[k]).sum() > 2}
    if not {"x", "y", "psi"} <= has:
        return None
    bad = [k for k in ("x", "y") if _is_bad(run[k])]
    if _is_bad(_direction(run)) and (np.ptp(run.filled("psi")) == 0 or _is_bad(np.diff(run["psi"]))):
        bad.append("psi")  # degrees taken for radians come round fast, but evenly
    if not bad:
        return _rate_without_order(run, ship, has)
    if len(bad) > 1:
        return None  # nothing else tells which is wrong
    said, turned = ("course", _course_turned(run, ship)) if bad == ["psi"] else ("heading", _heading_turned(run, ship))
    told = f"the {said} turns through {turned / DEGREE:.0f} deg"
    return _finding(bad[0], _direction(run) if bad == ["psi"] else run[bad[0]], told) if turned > TURNED else None


def _rate_without_order(run: Recording, ship: Particulars, has: set[str]) -> Finding | None:
    """A rate without an order in time, or a yaw rate that never moves, although heading and track say that it must."""
    if "r" in has and np.isnan(disorder(run["r"])[0]):
        varies = float(np.sqrt(max(_motion_told(run, ship, "r"), 0.0)))
        if varies > UNEVEN * float(np.nanmax(np.abs(run["r"]))) > 0:
            return _finding("r", run["r"], f"by the heading its standard deviation is {varies / DEGREE:.2g} deg/s")
    for name in (k for k in ("r", "u", "v", "vn", "ve") if k in has):
        ratio, critical = disorder(run[name])
        told, shown = _motion_told(run, ship, name), float(np.nanvar(run[name]))
        # In any order samples vary as they did. What varies much less is noise about a motion that is shown too small.
        if ratio > critical and MOTION_SHARE * shown < told < shown / MOTION_SHARE:
            source = "the heading" if name == "r" else "the track"
            return _finding(name, run[name], f"{source} says that most of what it shows must be motion")
    return None


def _motion_told(run: Recording, ship: Particulars, name: str) -> float:
    """Variance of a rate by heading and positions, without what their noise may have added to it."""
    sources = {"r": ("psi",), "vn": ("x",), "ve": ("y",)}.get(name, ("x", "y"))
    window = WINDOW * ship.time_unit
    slopes = [smoothed(run.time, run.filled(k), window)[1] for k in sources]
    noise = max(noise_left(run.time, run.filled(k), window, 1) for k in sources)
    if len(slopes) > 1:
        heading = smoothed(run.time, run.filled("psi"), window)[0]
        slopes = [earth_to_body(slopes[0], slopes[1], heading)["uv".index(name)]]
    return float(np.var(slopes[0])) - (NOISE_SDS * noise) ** 2


def _heading_turned(run: Recording, ship: Particulars) -> float:
    """Angle that the heading turns through, noise taken out [rad]."""
    return float(np.ptp(smoothed(run.time, run.filled("psi"), WINDOW * ship.time_unit)[0]))


def _course_turned(run: Recording, ship: Particulars) -> float:
    """Angle that the track turns through where the ship makes way, less what its noise may have added [rad]."""
    window = WINDOW * ship.time_unit
    north, east = (smoothed(run.time, run.filled(k), window)[1] for k in "xy")
    speed = np.hypot(north, east)
    way = speed > 0.3 * np.quantile(speed, 0.95)
    if not way.any():
        return 0.0
    noise = max(noise_left(run.time, run.filled(k), window, 1) for k in "xy") / float(speed[way].min())
    return float(np.ptp(np.unwrap(np.arctan2(east, north)[way]))) - 2 * RANGE_SDS * noise


def _finding(name: str, values: Inexact[np.ndarray, " n"], told: str) -> Finding:
    """The complaint about a channel."""
    ratio, critical = disorder(values)
    if np.isnan(ratio):
        return refused("order", f"{name} never moves, while {told}", f"map the column that holds {name}")
    text = f"{name} has no order in time (von Neumann's ratio {ratio:.2g}, expected below {critical:.2g}), while {told}"
    return refused("order", text, f"map the column that holds {name}, sampled when the others were")


def _is_bad(values: Inexact[np.ndarray, " n"]) -> bool:
    """Whether a series never moves, or may be samples in any order."""
    ratio, critical = disorder(values)
    return not ratio <= critical


def _direction(run: Recording) -> Inexact[np.ndarray, " n"]:
    """The heading as a direction, for what has no order was unwrapped to no purpose."""
    return np.exp(1j * run["psi"])
