"""Delays, offsets, scales and the point of the sensors, each with its error, out of the identities of a recording."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.ship import Particulars
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.recording.check.identities import FaultEstimate, Identities, Noise

MIN_SIGMAS = 4.0
"""Standard errors from which on a fault is taken for real."""
MIN_SHARE = 0.25
"""Share of the size that matters from which on a fault is looked for at all."""
MAX_FAULTS = 6
"""Most faults that are taken out of one recording."""
MIN_MISFIT_GAP = 9.0
"""Difference of the sums of squares below which two faults cannot be told apart: ln B of 4.5."""
ALIKE = 0.25
"""Share of what a fault explains that another must not lack to be named beside it."""


@dataclass(frozen=True)
class Fault:
    """A simple fault of the sensors.

    Attributes:
        name: Its name.
        parts: Its numbers, as :mod:`~manoeuvre_nn.recording.check.identities` calls them.
        matters: Size from which on it is to be mended [SI].
        unit: Unit in which people read it.
        shown: That unit in SI.
    """

    name: str
    parts: tuple[str, ...]
    matters: float
    unit: str
    shown: float = 1.0


@dataclass(frozen=True)
class Measured:
    """A fault as measured.

    Attributes:
        fault: Which.
        value: Its size [SI]; of a current its two components.
        error: Standard error [SI].
        found: Whether it is real and explains what no other fault explains better.
        rivals: Faults that explain it as well.
    """

    fault: Fault
    value: tuple[float, ...]
    error: tuple[float, ...]
    found: bool
    rivals: tuple[str, ...] = ()

    @property
    def size(self) -> float:
        """Its length, for a current; else its value [SI]."""
        return self.value[0] if len(self.value) == 1 else float(np.linalg.norm(self.value))

    @property
    def size_error(self) -> float:
        """Standard error of the size [SI]."""
        if len(self.value) == 1:
            return self.error[0]
        parts, errors = np.array(self.value), np.array(self.error)
        return float(np.sqrt(((parts * errors) ** 2).sum()) / max(self.size, 1e-300))


def possible_faults(recording: Recording, ship: Particulars, identities: Identities) -> list[Fault]:
    """The faults that this recording's channels could show.

    Args:
        recording: The recording.
        ship: The ship.
        identities: Its identities.

    Returns:
        Faults; sizes that matter follow from the ship's size and what the channels do.
    """
    late = 0.01 * ship.time_unit
    turning, drift = (float(np.quantile(np.abs(recording[k]), 0.9)) for k in ("r", "v"))
    speed = float(np.median(np.hypot(recording["u"], recording["v"])))
    faults = []
    if identities.heading:
        faults += [
            Fault("delay of r", ("delay of r",), late, "s"),
            Fault("offset of r", ("offset of r",), 0.01 * turning, "deg/s", DEGREE),
            Fault("scale of r", ("scale of r",), 0.02, "%", 0.01),
        ]
    if identities.heading or identities.track:
        faults.append(Fault("delay of psi", ("delay of psi",), late, "s"))
    if identities.track:
        sway = max(0.05 * drift, 0.005 * speed)
        faults += [
            Fault("offset of psi", ("turn of psi",), 0.5 * DEGREE, "deg", DEGREE),
            Fault("delay of u, v", ("delay of u, v",), 2 * late, "s"),
            Fault("scale of u", ("scale of u",), 0.01, "%", 0.01),
            Fault("offset of u", ("offset of u",), 0.01 * speed, "m/s"),
            Fault("scale of v", ("scale of v",), 0.05, "%", 0.01),
            Fault("offset of v", ("offset of v",), sway, "m/s"),
            Fault("delay of x, y", ("delay of x, y",), late, "s"),
            Fault("point of x, y", ("point ahead",), 0.02 * ship.length, "m"),
            Fault("point of x, y abeam", ("point abeam",), 0.02 * ship.length, "m"),
            Fault("current", ("current north", "current east"), 0.02 * speed, "m/s"),
        ]
    return faults


def measure_faults(recording: Recording, ship: Particulars) -> list[Measured]:
    """Measure every fault, and find those that are there.

    Faults are taken in one by one, each time the one that explains most of what is left, as long as it is at least
    :data:`MIN_SIGMAS` standard errors from zero. Every other fault is measured beside those that were found.

    Args:
        recording: The recording, without outliers.
        ship: The ship.

    Returns:
        One a possible fault; none where the channels say nothing of each other.
    """
    identities = Identities(recording, ship)
    faults = possible_faults(recording, ship, identities)
    if not faults:
        return []
    noise = identities.noise(_parts(faults))
    # Large delays bend what they leave, and that is no noise. Only differences of delays show: the last stands still.
    delays = _parts([f for f in faults if f.name.startswith("delay")])[:-1]
    for _ in range(2):
        noise = identities.noise(_parts(faults), identities.estimate(delays, noise, rounds=8).values)
    found = _found(identities, faults, noise)
    # That is too little of the slow noise: errors are those of what the real faults leave.
    noise = identities.noise(_parts(found), identities.estimate(_parts(found), noise).values)
    together = identities.estimate(_parts(found), noise)
    measured = []
    for fault in faults:
        if fault in found:
            rivals = _rivals(identities, fault, found, faults, noise, together)
            measured.append(_measured(fault, together, found=True, rivals=rivals))
        else:
            beside = identities.estimate(_parts([*found, fault]), noise, start=together.values, rounds=2)
            measured.append(_measured(fault, beside, found=False))
    return measured


def _found(identities: Identities, faults: Sequence[Fault], noise: Noise) -> list[Fault]:
    """Faults that are there, the one that explains most first."""
    found: list[Fault] = []
    now = identities.estimate([], noise)
    while len(found) < MAX_FAULTS:
        best, gain = None, 0.0
        for fault in (f for f in faults if f not in found):
            tried = identities.estimate(_parts([*found, fault]), noise, start=now.values, rounds=2)
            won = (now.misfit - tried.misfit) / tried.spread - 2 * len(fault.parts)
            one = _measured(fault, tried, found=True)
            if won > gain and _clear(one):
                best, gain = fault, won
        if best is None:
            break
        found.append(best)
        now = identities.estimate(_parts(found), noise, start=now.values)
        if not _clear(_measured(best, now, found=True)):
            found.remove(best)
            break
    found = fewest_delays(identities, found, faults, noise)
    together = identities.estimate(_parts(found), noise)
    return [f for f in found if _clear(_measured(f, together, found=True))]


def fewest_delays(identities: Identities, found: Sequence[Fault], faults: Sequence[Fault], noise: Noise) -> list[Fault]:
    """The simplest story of the delays: that all others are late is said as well by one that is early.

    Args:
        identities: The identities.
        found: Faults that were found.
        faults: All that are possible.
        noise: Of the leftover.

    Returns:
        The faults, with the fewest delays that explain as much; of equal stories the one that moves least.
    """
    delays, others = ([f for f in g if f.name.startswith("delay") == late] for g, late in ((faults, 1), (found, 0)))
    now = [f for f in found if f in delays]
    if not now:
        return others
    spread = identities.estimate(_parts(found), noise).spread
    stories = []
    for count in range(min(len(now), len(delays) - 1) + 1):
        for some in combinations(delays, count):
            tried = identities.estimate(_parts([*others, *some]), noise, rounds=6)
            moved = sum(abs(tried.values[f.name]) for f in some)
            stories.append((tried.misfit / spread + MIN_SIGMAS**2 * count, moved, some))
    least = min(cost for cost, *_ in stories)
    return [*others, *min((s for s in stories if s[0] < least + MIN_MISFIT_GAP), key=lambda s: s[1])[2]]


def _clear(one: Measured) -> bool:
    """Whether a fault is neither noise nor nothing."""
    return abs(one.size) > MIN_SIGMAS * one.size_error and abs(one.size) > MIN_SHARE * one.fault.matters


def _rivals(
    identities: Identities,
    fault: Fault,
    found: Sequence[Fault],
    faults: Sequence[Fault],
    noise: Noise,
    together: FaultEstimate,
) -> tuple[str, ...]:
    """Faults that explain the same as well."""
    others = [f for f in found if f is not fault]
    gain = identities.estimate(_parts(others), noise, start=together.values).misfit - together.misfit
    rivals = []
    for rival in (f for f in faults if f not in found):
        tried = identities.estimate(_parts([*others, rival]), noise, start=together.values, rounds=3)
        if tried.misfit - together.misfit < min(MIN_MISFIT_GAP * together.spread, ALIKE * gain):
            rivals.append(rival.name)
    return tuple(rivals)


def _parts(faults: Sequence[Fault]) -> list[str]:
    return [part for f in faults for part in f.parts]


def _measured(fault: Fault, estimate: FaultEstimate, found: bool, rivals: tuple[str, ...] = ()) -> Measured:
    values = tuple(estimate.values[part] for part in fault.parts)
    return Measured(fault, values, tuple(estimate.errors[part] for part in fault.parts), found, rivals)
