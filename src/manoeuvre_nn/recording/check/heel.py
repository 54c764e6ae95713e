"""Checks of heel, and of what starboard and port rudders and shafts tell beside their means."""

from functools import partial

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.recording.check.finding import Change, Finding, in_unit, other_sign
from manoeuvre_nn.recording.local_cubics import smoothed
from manoeuvre_nn.recording.preparation import HEEL_WINDOW

MAX_HEEL = 1.2
"""Heel beyond which degrees were taken for radians [rad]."""
MIN_HEEL = 0.5 * DEGREE
"""Standard deviation of heel from which its rate and its side can be checked."""
NO_RATE = 0.5
"""Correlation of the roll rate with the rate of the heel below which it is none of it [-]."""
MAX_SLOPE_OFF = 0.2
"""Largest difference from 1 of the slope of one on the other that is put down to noise and filters [-]."""
OUTWARD = 0.6
"""Correlation of heel with the centripetal acceleration from which a ship heels to one side of its turns [-]."""
MAX_MEAN_OFF = {"delta": 0.5 * DEGREE, "n": 0.02}
"""Largest distance of a mean from that of both sides: rudder [rad], shaft over its usual speed [-]."""


def heel_findings(run: Recording, ship: Particulars) -> list[Finding]:
    """What heel and roll rate say of each other and of the turns; nothing where heel was not recorded.

    Args:
        run: The recording, without outliers.
        ship: For L/U0.

    Returns:
        Findings on the unit of phi, on ``p = dphi/dt`` and on the side of the heel.
    """
    if "phi" not in run.channels:
        return []
    largest = float(np.abs(run["phi"]).max())
    if largest > MAX_HEEL:
        text = f"phi reaches {largest:.3g} rad; no ship heels so far: it looks like degrees"
        return [Finding("heel unit", "mend", text, ("phi",), remedy="write unit: deg", changes=in_unit("deg", "phi"))]
    phi, slope = smoothed(run.time, run.filled("phi"), HEEL_WINDOW * ship.time_unit)
    if phi.std() < MIN_HEEL:
        text = f"phi varies by {phi.std() / DEGREE:.2g} deg: too little to check its rate and its side"
        return [Finding("heel", "ok", text, ("phi",))]
    found = [] if "p" not in run.channels or "p" in run.derived else [_roll_rate(run, slope, ship)]
    return [*found, _side(run, phi, ship)]


def _roll_rate(run: Recording, slope: Float[np.ndarray, " n"], ship: Particulars) -> Finding:
    """Whether ``p = dphi/dt``."""
    p = smoothed(run.time, run.filled("p"), HEEL_WINDOW * ship.time_unit)[0]
    inside = slice(len(p) // 50, -(len(p) // 50) or None)  # slopes are poor at the ends
    p, slope = p[inside] - p[inside].mean(), slope[inside] - slope[inside].mean()
    size = float(np.sqrt((p @ p) * (slope @ slope)))
    alike = float(p @ slope) / size if size > 0 else 0.0
    ratio = float(np.sqrt((p @ p) / (slope @ slope))) * (1.0 if alike > 0 else -1.0)
    found = partial(Finding, "roll rate", channels=("phi", "p"), measured=ratio, expected="1")
    if abs(alike) < NO_RATE:
        text = f"p is not the rate of phi: their correlation is {alike:.2f}"
        return found("note", text, remedy="map the right columns, or leave p out")
    turned = other_sign("p") if ratio < 0 else None
    for factor, other in ((DEGREE, "rad"), (1 / DEGREE, "deg")):
        if abs(np.log(abs(ratio) / factor)) < np.log(1.5):
            unit = f"{other}/s"
            changes = (*in_unit(unit, "p"), *([turned] if turned else []))
            text = f"p is {ratio:.3g} times the rate of phi: one of them is in another unit"
            remedy = f"write unit: {unit} of p, or mind that of phi"
            return found("mend", text, remedy=remedy, changes=changes)
    if turned:
        text = "p has the other sign than the rate of phi"
        return found("mend", text, remedy="turn p round", changes=(turned,))
    if abs(ratio - 1) > MAX_SLOPE_OFF:
        text = f"p is {ratio:.3g} times the rate of phi; expected 1"
        return found("note", text, remedy="mind the scale of p, or of phi")
    return found("ok", f"p is {ratio:.3g} times the rate of phi")


def _side(run: Recording, phi: Float[np.ndarray, " n"], ship: Particulars) -> Finding:
    """Whether the ship heels out of its turns, as displacement ships do: to port in a turn to starboard."""
    # A steady turn's heel: what is faster than two lengths is the ship's way into it, inward at first.
    push = smoothed(run.time, run["u"] * run["r"], 2.0 * ship.time_unit)[0]
    heel = smoothed(run.time, phi, 2.0 * ship.time_unit)[0]
    alike = float(np.corrcoef(push, heel)[0, 1]) if push.std() > 0 and heel.std() > 0 else 0.0
    found = partial(Finding, "heel side", channels=("phi", "p"), measured=alike, expected="below 0")
    if alike > OUTWARD:
        text = (
            "the ship heels into its turns; a displacement ship heels outward, to port (phi < 0) when turning to "
            "starboard"
        )
        changes = tuple(other_sign(name) for name in ("phi", "p") if name in run.channels)
        remedy = "turn phi and p round, unless this hull planes"
        return found("mend", text, remedy=remedy, changes=changes)
    if alike > -OUTWARD:
        text = f"heel goes little with the turns (correlation {alike:.2f}): its sign cannot be told"
        return found("ok", text)
    return found("ok", "the ship heels out of its turns, as displacement ships do")


def side_findings(run: Recording) -> list[Finding]:
    """Whether rudder angle and shaft speed are the means of those of both sides.

    Args:
        run: The recording, without outliers.

    Returns:
        One finding each of delta and n that was recorded beside its sides.
    """
    found = []
    for name, most in MAX_MEAN_OFF.items():
        both = [f"{name}_{side}" for side in ("starboard", "port")]
        if not {name, *both} <= set(run.channels) or name in run.derived:
            continue
        mean = 0.5 * (run[both[0]] + run[both[1]])
        usual = 1.0 if name == "delta" else float(np.median(np.abs(mean))) or 1.0
        off = float(np.median(np.abs(run[name] - mean))) / usual
        said = f"{off / DEGREE:.2g} deg" if name == "delta" else f"{off:.1%}"
        channels = (name, *both)
        if off <= most:
            text = f"{name} is the mean of both sides (within {said})"
            found.append(Finding("sides", "ok", text, channels, measured=off))
            continue
        text = f"{name} is {said} off the mean of {both[0]} and {both[1]}"
        remedy = f"leave {name} out, so that it is their mean, or mind the signs and units of the sides"
        changes = (Change(f"channels.{name}", value=None),)
        found.append(Finding("sides", "mend", text, channels, measured=off, remedy=remedy, changes=changes))
    return found
