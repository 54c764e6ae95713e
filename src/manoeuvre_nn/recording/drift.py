"""Drift of a turning circle over ground from arcs that overlap one turn later, and recordings without it.

In a steady turn in a uniform current, the position over ground is a circle and the current times time: two positions
with the same heading one turn apart differ by the current times the time between them, exactly. That is the correction
of IMO MSC/Circ.1053, 3.4.2.5 (a turn of 720 deg, arcs after 180 deg, plain mean), and the automated procedure of Hess &
Faller. A turn of 540 deg is not steady in its first half: speed is still falling, and the plain mean takes the gap of
the spiral for drift (up to a third of the diameter on ships of the package). The gap turns with the heading and dies
out, the drift does neither: both are estimated together.

Wind, waves and a current that changes along the track do not move a ship uniformly. What is found then is the mean
velocity at which the turns move over ground: taken away, the circles close, and what a wind does within each turn stays
in the recording. It is not the velocity of any water.

Source:
    IMO MSC/Circ.1053, 2002, 3.4.2.5; Hess & Faller 2000, 23rd Symp. Naval Hydrodynamics (procedure named, not printed).
    Deviation: what the turn is not yet steady by is modelled instead of left out.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import atan2, cos, hypot, nan, pi, sin

import numpy as np
from jaxtyping import Bool, Complex, Float
from scipy.ndimage import find_objects, label

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.frames import body_to_earth, earth_to_body
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.recording.local_cubics import smoothed

ARC = 10.0 * DEGREE
"""Change of heading over which positions are averaged [rad]."""
MIN_ARCS = 6
"""Fewest arcs that drift and decay are told apart by."""
RATE_REACHED = 0.98
"""Share of the largest yaw rate from which on the turn counts: before, the ship is only beginning to turn."""
DECAYS = np.geomspace(0.3, 6.0, 12)
"""Rates at which what is not steady may die out, per radian of heading [-]: speed takes .4 to 1, sway and yaw more."""
USUAL_DECAY = 1.0
"""Rate below which a decay is the less expected the slower it is [-]: a ship loses speed in a turn faster."""
MIN_NOISE = 1e-3
"""Least noise of an arc over the largest distance of two arcs [-]: no decay is more exactly the sum of those above."""
MAX_ERROR = 0.02
"""Largest standard error of a drift that is taken away: over one turn, over the diameter [-]."""
RUDDER_PLAY = 0.2, 1.0 * DEGREE
"""How far from its angle a held rudder may be: a share of it, and at least so much [rad]."""

Series = Float[np.ndarray, " n"]


@dataclass(frozen=True)
class Drift:
    """A velocity over ground that a ship is moved with, whatever she does.

    Attributes:
        north: Velocity [m/s].
        east: Velocity [m/s].
        covariance: Of both [m^2/s^2]; zeros where the drift is known.
        headings: Changes of heading since the rudder was put over, of the first and the last arc [rad].
        steady_from: Change of heading from which on arcs differ by the drift alone, within their noise [rad]; NaN if
            they never do, or nothing was measured.
        period: Time of the last turn [s].
        diameter: Diameter of the last turn without the drift [m].
    """

    north: float
    east: float
    covariance: Float[np.ndarray, "2 2"] = field(default_factory=lambda: np.zeros((2, 2)))
    headings: tuple[float, float] = (nan, nan)
    steady_from: float = nan
    period: float = nan
    diameter: float = nan

    @property
    def speed(self) -> float:
        """Speed [m/s]."""
        return hypot(self.north, self.east)

    @property
    def toward_deg(self) -> float:
        """Direction that it goes towards, clockwise from north [deg]."""
        return atan2(self.east, self.north) / DEGREE % 360

    @property
    def speed_error(self) -> float:
        """Standard error of the speed [m/s]."""
        return self._error(cos(self.toward_deg * DEGREE), sin(self.toward_deg * DEGREE))

    @property
    def toward_error_deg(self) -> float:
        """Standard error of the direction [deg], at most 180."""
        across = self._error(-sin(self.toward_deg * DEGREE), cos(self.toward_deg * DEGREE))
        return min(across / max(self.speed, 1e-12) / DEGREE, 180.0)

    @property
    def error(self) -> float:
        """Standard error of the drift over one turn, over the diameter [-]; 0 where it is known."""
        return float(np.sqrt(np.trace(self.covariance))) * self.period / self.diameter if self.covariance.any() else 0.0

    def _error(self, north: float, east: float) -> float:
        """Standard error along a direction."""
        along = np.array([north, east])
        return float(np.sqrt(along @ self.covariance @ along))


def known_drift(speed: float, toward_deg: float) -> Drift:
    """A drift that is known: speed [m/s], and the direction that it goes towards, clockwise from north [deg]."""
    return Drift(speed * cos(toward_deg * DEGREE), speed * sin(toward_deg * DEGREE))


def drift_by_arcs(recording: Recording) -> Drift:
    """Estimate the drift of a turning circle from arcs of the same headings one turn apart.

    With the change of heading ``th``, ``z = x + i y`` (y to the side of the turn) and the time T between two arcs

    ``z(th + 2 pi) - z(th) = c T(th) + sum_k a_k b_k exp((i - k) th) + noise``

    where c is the drift and the sum is the gap that a turn leaves whose speeds over yaw rate die out to those of the
    steady turn as ``exp(-k th)``. The a_k are Gaussian about zero, their size and that of the noise are integrated out.
    So the standard error holds the noise, the scatter of the arcs, and what cannot be told from a drift in a turn that
    is not yet steady.

    Args:
        recording: x, y, psi, delta of a turn with the rudder held, anything before and after. Heading and positions may
            be noisy; gaps are bridged.

    Returns:
        The drift.

    Raises:
        InputError: If the ship does not turn for long enough while the rudder is held.
    """
    time, z, turned, side = _held_turn(recording)
    arcs = _arcs(time, z, turned)
    rate = _rate(time, turned)
    begin = float(turned[int(np.argmax(rate >= RATE_REACHED * np.quantile(rate, 0.995)))])
    used = arcs[:, 0].real >= begin
    if used.sum() < MIN_ARCS:
        needed = (begin + 2 * pi + (MIN_ARCS + 1) * ARC) / DEGREE
        raise InputError(
            f"recording {recording.name}: too short a circle for its drift: the heading turns through "
            f"{turned[-1] / DEGREE:.0f} deg while the rudder is held; it needs {needed:.0f} deg or more"
        )
    heading, gap, period = arcs[used, 0].real, arcs[used, 1], arcs[used, 2].real
    drift, covariance, steady_from = _posterior(heading, gap, period)
    flip = np.array([1.0, side])
    last = turned >= turned[-1] - 2 * pi
    return Drift(
        float(drift.real),
        float(side * drift.imag),
        covariance * np.outer(flip, flip),
        (float(heading[0]), float(heading[-1])),
        steady_from,
        float(time[-1] - time[last][0]),
        _diameter(z[last] - drift * time[last]),
    )


def without_drift(recording: Recording, drift: Drift) -> Recording:
    """The recording as it would have been without a drift.

    ``p(t) - c (t - t_0)``; velocities over ground lose c. u and v lose it too if they are over ground: derived from the
    track, or such that the track follows from them rather than from them and the drift.

    Args:
        recording: The recording.
        drift: What is taken away.

    Returns:
        The recording; ``meta["drift"]`` says what was taken away: north, east, speed_error [m/s].

    Raises:
        InputError: If the drift is too uncertain.
    """
    if drift.error > MAX_ERROR:
        raise InputError(
            f"recording {recording.name}: its drift is too uncertain to take away: {drift.error:.0%} of the diameter "
            "in a turn; the turn is not steady, or too short: leave drift out of the mapping"
        )
    c, since = dict(recording.channels), recording.time - recording.time[0]
    moved = {"x": drift.north * since, "y": drift.east * since, "vn": drift.north, "ve": drift.east}
    made = {name: c[name] - off for name, off in moved.items() if name in c}
    if {"u", "v"} <= set(c) and _is_over_ground(recording, drift):
        north, east = (np.full(len(recording), k) for k in (drift.north, drift.east))
        ahead, abeam = earth_to_body(north, east, c["psi"])
        made |= {"u": c["u"] - ahead, "v": c["v"] - abeam}
    told = {"north": drift.north, "east": drift.east, "speed_error": drift.speed_error}
    return replace(recording.with_channels(**made), meta={**recording.meta, "drift": told})


def _held_turn(recording: Recording) -> tuple[Series, Complex[np.ndarray, " n"], Series, int]:
    """The longest turn with a held rudder.

    Returns:
        Times [s], positions x + i y with y to the side of the turn [m], change of heading since the rudder began to
        move, smoothed and rising [rad], and the side, +1 for starboard.
    """
    psi, delta = recording.filled("psi"), recording.filled("delta")
    far = np.abs(psi - psi[0]) > 0.5 * np.abs(psi - psi[0]).max()
    level = float(np.median(delta[far])) if far.any() else 0.0
    held = np.abs(delta - level) <= max(RUDDER_PLAY[0] * abs(level), RUDDER_PLAY[1])
    pieces = [piece for (piece,) in find_objects(label(held)[0])]
    longest = max(pieces, key=lambda piece: abs(psi[piece.stop - 1] - psi[piece.start]))
    time, heading = recording.time[longest], psi[longest]
    whole = abs(heading[-1] - heading[0])
    side = 1 if heading[-1] > heading[0] else -1
    if len(time) > 4 and whole > ARC:
        heading = smoothed(time, heading, float(ARC / whole * (time[-1] - time[0])))[0]
    turned = np.maximum.accumulate(side * (heading - float(np.median(psi[: max(longest.start, 1)]))))
    turned = turned + 1e-9 * np.arange(len(turned))  # strictly rising, as np.interp asks
    x, y = (recording.filled(k)[longest] for k in ("x", "y"))
    return time, x + 1j * side * y, turned, side


def _rate(time: Series, turned: Series) -> Series:
    """Yaw rate to the side of the turn [rad/s], over four arcs, so that noise of the heading leaves .5 % in it."""
    first, last = np.maximum(turned - 2 * ARC, turned[0]), np.minimum(turned + 2 * ARC, turned[-1])
    return (last - first) / np.maximum(np.interp(last, turned, time) - np.interp(first, turned, time), 1e-12)


def _arcs(time: Series, z: Complex[np.ndarray, " n"], turned: Series) -> Complex[np.ndarray, "arcs 3"]:
    """Means over arcs: change of heading, position one turn later less position, time between the two."""
    count = max(int((turned[-1] - turned[0] - 2 * pi) / ARC), 0)
    first = turned[-1] - 2 * pi - count * ARC  # counted back from the end: the last arcs are the steadiest
    inside = (turned >= first) & (turned < turned[-1] - 2 * pi)
    heading, begin = turned[inside], time[inside]
    end = np.interp(heading + 2 * pi, turned, time)
    gap = np.interp(end, time, z.real) + 1j * np.interp(end, time, z.imag) - z[inside]
    number = np.clip(((heading - first) / ARC).astype(int), 0, max(count - 1, 0))
    samples = [heading.astype(complex), gap, (end - begin).astype(complex)]
    rows = [[s[number == k].mean() for s in samples] for k in range(count) if (number == k).any()]
    return np.array(rows, dtype=complex).reshape(-1, 3)


def _diameter(z: Complex[np.ndarray, " n"]) -> float:
    """Diameter of the circle that has the area of a turn [m]: noise of the positions hardly changes it."""
    twice_area = (z.conj() * np.roll(z, -1)).imag.sum()
    return float(2 * np.sqrt(abs(twice_area) / (2 * pi)))


def _posterior(
    heading: Float[np.ndarray, " arcs"], gap: Complex[np.ndarray, " arcs"], period: Float[np.ndarray, " arcs"]
) -> tuple[complex, Float[np.ndarray, "2 2"], float]:
    """Mean and covariance of the drift, sizes of decay and noise integrated out; heading from which arcs are steady."""
    reached = np.minimum(1.0, (DECAYS / USUAL_DECAY) ** 2) * np.abs(1 - np.exp(-2 * pi * DECAYS))
    decays = np.exp((1j - DECAYS) * (heading[:, None] - heading[0])) * reached / np.abs(1j - DECAYS)
    # In the eigenvectors of the decays' covariance every choice of the two sizes is a diagonal.
    power, axes = np.linalg.eigh(decays @ decays.conj().T / len(DECAYS))
    power = np.maximum(power, 0.0)
    y, t = axes.conj().T @ gap, axes.conj().T @ period.astype(complex)
    scale = float(np.abs(gap).max()) or 1.0
    decay = (scale * np.geomspace(3e-3, 30.0, 24))[:, None, None] ** 2
    noise = (scale * np.geomspace(MIN_NOISE, 0.1, 24))[None, :, None] ** 2
    variance = decay * power + noise
    spread = 1 / (np.abs(t) ** 2 / variance).sum(-1)
    mean = spread * (t.conj() * y / variance).sum(-1)
    misfit = (np.abs(y - mean[..., None] * t) ** 2 / variance).sum(-1)
    evidence = -misfit - np.log(variance).sum(-1) + np.log(spread)
    weight = np.exp(evidence - evidence.max())
    weight /= weight.sum()
    drift = complex((weight * mean).sum())
    off = np.stack([(mean - drift).real.ravel(), (mean - drift).imag.ravel()])
    covariance = 0.5 * np.eye(2) * float((weight * spread).sum()) + (weight.ravel() * off) @ off.T
    best = np.unravel_index(int(evidence.argmax()), evidence.shape)
    unsteady = axes @ (decay[best[0], 0] * power / variance[best] * (y - drift * t))
    within = np.abs(unsteady) < np.sqrt(noise[0, best[1]])
    steady = np.flatnonzero(np.logical_and.accumulate(within[::-1])[::-1])
    return drift, covariance, float(heading[steady[0]]) if len(steady) else nan


def track_less_velocities(recording: Recording) -> tuple[float, float] | None:
    """Mean velocity of the track less u and v, north and east [m/s]: a current where u and v are through the water.

    Args:
        recording: The recording.

    Returns:
        The difference; None where one of the two was derived from the other, or is not there.
    """
    if not {"u", "v", "psi", "x", "y"} <= set(recording.channels) or {"u", "x"} & recording.derived:
        return None
    there: Bool[np.ndarray, " n"] = np.all(np.isfinite(recording.stacked("u", "v", "psi", "x", "y")), axis=-1)
    c: Mapping[str, Series] = {k: recording[k][there] for k in ("u", "v", "psi", "x", "y")}
    time = recording.time[there]
    made = [np.trapezoid(rate, time) for rate in body_to_earth(c["u"], c["v"], c["psi"])]
    north, east = ((c[k][-1] - c[k][0] - way) / (time[-1] - time[0]) for k, way in zip("xy", made, strict=True))
    return float(north), float(east)


def _is_over_ground(recording: Recording, drift: Drift) -> bool:
    """Whether u and v hold the drift: the track then follows from them alone; so it is taken where nothing tells."""
    left = track_less_velocities(recording)
    return left is None or hypot(*left) < hypot(left[0] - drift.north, left[1] - drift.east)
