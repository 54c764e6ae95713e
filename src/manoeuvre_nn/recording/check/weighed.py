"""Findings that an effect could explain: they are told and weighed by a diagnosis, which refuses only the others.

The speed log and the velocity over ground, ``u_ground = u_log + c ahead``, differ by a current c or by a unit. A wrong
unit multiplies, a current adds and goes with the compass: where the ship turns, the two are told apart. Where she does
not, speed through the water that she cannot have by herself speaks for a unit. Without a log all runs of a day are
taken together, ``(vn, ve) = u_k (cos psi, sin psi) + b r (-sin psi, cos psi) + c``, u_k the speed in run k and b r the
sway of a steady turn: a current is common to them, whichever way they were sailed.

Velocities of the track and those that were recorded may be of two points of the ship, ``u_track = u - b r``, ``v_track
= v + a r``, or of one antenna; near the pivot point of a turn its sway is so small that noise is large beside it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot, inf

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.frames import earth_to_body
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.recording import CAMPAIGN, Recording
from manoeuvre_nn.core.units import DEGREE, KNOT
from manoeuvre_nn.numerics.finite_algebra import lstsq
from manoeuvre_nn.recording.check.axes import (
    HELD_TURN,
    RUDDER_WINDOW,
    STRONG_EVIDENCE,
    mistakes,
    robust_slope,
    rudder_effect,
    turned_by_held_rudder,
)
from manoeuvre_nn.recording.check.finding import Finding
from manoeuvre_nn.recording.check.motion import smoothed_motion
from manoeuvre_nn.recording.local_cubics import WINDOW, noise_left, smoothed
from manoeuvre_nn.recording.thinning import thinned

MAX_OWN_SPEED = 1.3
"""Largest speed through the water over the approach speed that a ship may have by herself."""
MAX_MISFIT = 0.25
"""Largest misfit of a story over the speed through the water: sway and noise leave less."""
MIN_MISFIT_RATIO = 0.5
"""A story is told from another if its misfit is below so much of the other's."""
MIN_TOLD = 0.25
"""Smallest current over the approach speed that is told beforehand."""
AROUND = 90 * DEGREE
"""Turn from which a current is told from a speed without a log."""
MAX_NOISE_RATIO = 3.0
"""Difference of two smoothed velocities over what white noise of the samples' size leaves, up to which it is noise: a
running median of five samples leaves up to 2.4 times as much at low frequencies."""
ZIGZAGS = ("zz", "zigzag")
"""How names of zigzags begin."""
OPEN = 2.0
"""Standard errors of what a rudder does within which a run leaves its sign open."""
RUDDER_LAGS = 30
"""Delays to either side at which a late rudder is looked for."""
TINY = 1e-12
"""Share of a sum of squares below which there is nothing but rounding."""
UNITS = (KNOT, 1 / KNOT, 1 / 3.6, 3.6)
"""Factors of speeds that were written in other units."""

Series = Float[np.ndarray, " n"]


@dataclass(frozen=True)
class Bounds:
    """How far effects go that could explain a finding.

    Attributes:
        current: Fastest current [m/s].
        rudder_offset: Largest angle between rudder and indicator [rad].
        antenna: How far ahead and abeam of the reference point a receiver may be [m].
        rudder_delay: Longest time by which the recorded rudder may be late or early [s].
    """

    current: float = 0.0
    rudder_offset: float = 0.0
    antenna: tuple[float, float] = (0.0, 0.0)
    rudder_delay: float = 0.0


@dataclass(frozen=True)
class _Story:
    """What the velocity over ground is made of.

    Attributes:
        speed: Usual speed through the water [m/s].
        current: Speed of the current [m/s].
        misfit: What is left over the speed through the water [-].
    """

    speed: float
    current: float
    misfit: float


def weighed(
    finding: Finding, run: Recording, ship: Particulars, bounds: Bounds, runs: Sequence[Recording] = ()
) -> Finding:
    """A finding as a note if an effect within its bounds could explain it.

    Args:
        finding: What a check found.
        run: The run, without gaps and spikes.
        ship: The ship.
        bounds: How far effects go.
        runs: All runs of the same recorder; the run itself may be among them.

    Returns:
        The finding, or a note.
    """
    if finding.check == "rudder stop":
        beyond = float(np.abs(run["delta"]).max()) - ship.rudder_limit
        # An offset shifts the range of a rudder from stop to stop, it does not stretch it.
        if beyond <= bounds.rudder_offset and float(np.ptp(run["delta"])) <= 2 * ship.rudder_limit:
            return _note(f"{finding.text}: the indicator may be off by {beyond / DEGREE:.2g} deg, or more")
    if finding.check in {"log unit", "speed", "course"}:
        story = _with_current(run, ship, bounds, runs)
        if story is not None:
            return _note(f"{finding.text}: a current of {story.current:.2g} m/s would explain it")
    if finding.check == "frame":
        lever = _antenna(run, ship, bounds)
        if lever is not None:
            where = f"x and y are of a point {_where(*lever)} that of u and v"
            return _note(f"{finding.text}: noise and an antenna off the reference point would explain it ({where})")
    if finding.check == "rudder sign":
        late = _rudder_delay(run, ship, bounds, runs)
        if late is not None:
            when = "late" if late > 0 else "early"
            return _note(f"{finding.text}: a rudder written down some {abs(late):.0f} s {when} would explain it")
        if _comes_round_in_a_zigzag(run, ship, runs):
            return _note(f"{finding.text}: in a zigzag of the other sign it would have been put over long before")
    return finding


def _comes_round_in_a_zigzag(run: Recording, ship: Particulars, runs: Sequence[Recording]) -> bool:
    """Whether a run is a zigzag in which the ship comes round against a rudder whose movements leave its sign open.

    All runs of a recorder together may show the right sign, too: a ship that is unstable on course, or a moment that a
    small rudder does not hold, turns against it in one.

    Returns:
        True for what no other sign explains.
    """
    told = str(run.meta.get("kind", "")).startswith(ZIGZAGS)
    if not told or turned_by_held_rudder(run, ship) >= -HELD_TURN:
        return False
    b, error = rudder_effect(run, ship)
    own, *others = (
        _evidence_of_delays(one, ship, np.zeros(1))[:, 0] for one in [run, *(r for r in runs if r is not run)]
    )
    right, wrong = sum(others, own)
    return abs(b) < OPEN * error or bool(own[0] >= own[1] and right > wrong + STRONG_EVIDENCE**2 / 2)


def strong_current(run: Recording, ship: Particulars) -> Finding | None:
    """A log and a velocity over ground that differ by a good part of the speed."""
    if "u_log" not in run.channels:
        return None
    more = float(np.median(_ahead(run) - run["u_log"]))
    size = _story(run, 1.0, run["u_log"]).current
    if size < MIN_TOLD * ship.speed:
        return None
    than = f"{abs(more):.2g} m/s {'less' if more > 0 else 'more'} than the speed over ground"
    return _note(
        f"the log shows {than}: a current of {size:.2g} m/s would explain it, or a log of another unit or scale"
    )


def _note(text: str) -> Finding:
    return Finding("weighed", "note", text)


def _where(ahead: float, abeam: float) -> str:
    """A point of the ship beside another one, in words."""
    along = f"{abs(ahead):.2g} m {'ahead' if ahead > 0 else 'aft'}"
    return f"{along} and {abs(abeam):.2g} m to {'starboard' if abeam > 0 else 'port'} of"


def _antenna(run: Recording, ship: Particulars, bounds: Bounds) -> tuple[float, float] | None:
    """How far ahead and to starboard of the point of u, v that of the track is [m]; None if it explains nothing."""
    # It explains the difference if noise is left, and less than without the best of all simple mistakes.
    raw = thinned(run, ship)
    m, most = smoothed_motion(raw, ship), MAX_NOISE_RATIO * _noise_of_difference(raw, ship)
    lever = [robust_slope(m["psidot"], moved) for moved in _differences(m)]
    ahead, abeam = (float(np.clip(arm, -high, high)) for arm, high in zip(lever, bounds.antenna, strict=True))
    left = _rms(m.with_channels(u=m["u"] - abeam * m["psidot"], v=m["v"] + ahead * m["psidot"]), ship)
    others = [_rms(mended, ship) for _, _, mended in mistakes(m)]
    explained = left < min(most, *others) or _rms(m, ship) < most
    return (ahead, abeam) if explained else None


def _rudder_delay(run: Recording, ship: Particulars, bounds: Bounds, runs: Sequence[Recording]) -> float | None:
    """How late the rudder was recorded [s]; None if the ship does not clearly turn to the right side at any delay."""
    # In one zigzag the other sign and half a period look much alike, in one circle little but its beginning tells a
    # late rudder from the other sign: all runs of the recorder have one delay.
    if not bounds.rudder_delay:
        return None
    lags = np.linspace(-1.0, 1.0, 2 * RUDDER_LAGS + 1) * bounds.rudder_delay
    own = _evidence_of_delays(run, ship, lags)
    right, wrong = sum((_evidence_of_delays(other, ship, lags) for other in runs if other is not run), own)
    best, strong = int(right.argmax()), STRONG_EVIDENCE**2 / 2
    explained = right[best] > wrong.max() + strong and own[0, best] > own[1, best] - strong
    return float(lags[best]) if explained else None


def _evidence_of_delays(run: Recording, ship: Particulars, lags: Series) -> Float[np.ndarray, "2 lags"]:
    """Log likelihood of ``rdot = a r + b delta(t + lag) + c`` over that without a rudder, for b >= 0 and for b <= 0."""
    run, window = thinned(run, ship), RUDDER_WINDOW * ship.time_unit
    (rudder, _), (r, rdot) = (smoothed(run.time, run[k], window) for k in ("delta", "r"))
    # Samples half a window apart have nearly independent errors.
    rows = slice(None, None, max(round(0.5 * window / run.step), 1))
    time, target, others = run.time[rows], rdot[rows], np.stack([r, np.ones_like(r)], axis=1)[rows]
    found = np.zeros((2, len(lags)))
    for k, lag in enumerate(lags):
        known = time + lag <= run.time[-1]  # on the approach, before the record begins, the rudder was held
        columns = np.column_stack([np.interp(time[known] + lag, run.time, rudder), target[known]])
        base = np.linalg.qr(others[known])[0]
        (late, left) = (columns - base @ (base.T @ columns)).T
        along, size, whole = late @ left, late @ late, left @ left
        if size * whole > TINY * np.prod((columns**2).sum(axis=0)):
            share = min(along**2 / (size * whole), 1 - TINY)
            found[int(along < 0), k] = -0.5 * known.sum() * np.log1p(-share)
    return found


def _differences(m: Recording) -> tuple[Series, Series]:
    """What the track moves faster than u and v say [m/s]: a psidot to starboard, b psidot aft of a rigid body."""
    ahead, abeam = earth_to_body(m["xdot"], m["ydot"], m["psi"])
    return abeam - m["v"], m["u"] - ahead


def _rms(m: Recording, ship: Particulars) -> float:
    """Size of the larger difference of both velocities [m/s]; near its ends a smoothed record is noisier."""
    end = WINDOW * ship.time_unit / 2
    inside = (m.time >= m.time[0] + end) & (m.time <= m.time[-1] - end)
    return max(float(np.sqrt(np.mean(d[inside] ** 2))) for d in _differences(m))


def _noise_of_difference(raw: Recording, ship: Particulars) -> float:
    """Standard deviation that the samples' noise leaves between a recorded velocity and that of the track [m/s]."""
    window = WINDOW * ship.time_unit
    slope, level = (
        max(noise_left(raw.time, raw[k], window, derivative) for k in names)
        for names, derivative in (("xy", 1), ("uv", 0))
    )
    return hypot(slope, level)


def _ahead(run: Recording) -> Series:
    """Speed over ground along the heading [m/s]."""
    return run["vn"] * np.cos(run["psi"]) + run["ve"] * np.sin(run["psi"])


def _story(run: Recording, factor: float, log: Series, side: int = 1) -> _Story:
    """Velocity over ground, in a unit of so many m/s, as logged way through the water and a current.

    Args:
        run: The run.
        factor: Unit of the velocity over ground, over that of the log.
        log: Speed through the water.
        side: -1 for a heading that counts to the other side.

    Returns:
        The story.
    """
    cos, sin = np.cos(run["psi"]), side * np.sin(run["psi"])
    # Along the heading alone: sway does not count.
    columns, left = np.stack([cos, sin], axis=1), factor * (run["vn"] * cos + run["ve"] * sin) - log
    current = lstsq(columns, left, rcond=0.05)
    speed = float(np.median(log))
    misfit = float(np.median(np.abs(left - columns @ current))) / speed if speed > 0 else inf
    return _Story(speed, hypot(*current), misfit)


def _story_of_all(runs: Sequence[Recording], side: int = 1) -> _Story:
    """The same without a log, of all runs: each has a speed of its own, sway is ``v = b r``, the current one.

    Args:
        runs: The story's speed is that of the first.
        side: -1 for a heading that counts to the other side.

    Returns:
        The story.
    """
    blocks = []
    for k, run in enumerate(runs):
        cos, sin, r = np.cos(run["psi"]), side * np.sin(run["psi"]), side * run["r"]
        block = np.zeros((2, len(run), len(runs) + 3))
        block[:, :, k] = cos, sin
        block[:, :, -3] = -sin * r, cos * r
        block[0, :, -2] = block[1, :, -1] = 1.0
        blocks.append(block)
    columns = np.concatenate(blocks, axis=1)
    ground = np.concatenate([np.stack([run["vn"], run["ve"]]) for run in runs], axis=1)
    found = lstsq(columns.reshape(-1, len(runs) + 3), ground.ravel())
    rest = np.hypot(*(ground - columns @ found))
    speeds = np.repeat(found[: len(runs)], [len(run) for run in runs])
    left = float(np.median(rest / speeds)) if speeds.min() > 0 else inf
    return _Story(float(found[0]), hypot(*found[-2:]), left)


def _with_current(run: Recording, ship: Particulars, bounds: Bounds, runs: Sequence[Recording]) -> _Story | None:
    """The story of a current, if it holds and no wrong unit or side tells a better one."""
    log = run.channels.get("u_log")
    if log is not None:
        story = _story(run, 1.0, log)
        others = [_story(run, 1.0, log, side=-1)]
        others += [_story(run, factor, log) for factor in UNITS]
        others += [_story(run, 1.0, factor * log) for factor in UNITS]
    else:
        # A day has one current, and runs that hardly turn share it with others that do.
        day = [other for other in runs if other is not run and other.meta.get(CAMPAIGN) == run.meta.get(CAMPAIGN)]
        if max(np.ptp(r["psi"]) for r in [run, *day]) < AROUND:
            return None
        story, others = _story_of_all([run, *day]), [_story_of_all([run, *day], side=-1)]
    if not 0 < story.speed <= MAX_OWN_SPEED * ship.speed or story.current > bounds.current:
        return None
    best = min(other.misfit for other in others)
    return story if story.misfit < MAX_MISFIT and best > MIN_MISFIT_RATIO * story.misfit else None
