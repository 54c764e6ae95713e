"""Delays, offsets, scales and the point of the sensors, each with its error, out of the identities of a recording."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.recording import Recording
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
    """A simple fault of the sensors, and how large it is once it was measured.

    Attributes:
        name: Its name, as :mod:`~manoeuvre_nn.recording.check.identities` calls it.
        matters: Size from which on it is to be mended [SI].
        unit: Unit in which people read it.
        shown: That unit in SI.
        value: Its size [SI]; of a current its two components.
        error: Standard error of each [SI].
        found: Whether it is real and explains what no other fault explains better.
        rivals: Faults that explain it as well.
    """

    name: str
    matters: float
    unit: str
    shown: float = 1.0
    value: tuple[float, ...] = ()
    error: tuple[float, ...] = ()
    found: bool = False
    rivals: tuple[str, ...] = ()

    @property
    def parts(self) -> tuple[str, ...]:
        """Its numbers, as the identities call them."""
        return ("current north", "current east") if self.name == "current" else (self.name,)

    @property
    def size(self) -> float:
        """Its length, for a current; else its value [SI]."""
        return self.value[0] if len(self.value) == 1 else float(np.linalg.norm(self.value))

    @property
    def size_error(self) -> float:
        """Standard error of the size [SI]."""
        if len(self.value) == 1:
            return self.error[0]
        return float(np.linalg.norm(np.multiply(self.value, self.error)) / max(self.size, 1e-300))

    @property
    def is_clear(self) -> bool:
        """Whether it is neither noise nor nothing."""
        return abs(self.size) > MIN_SIGMAS * self.size_error and abs(self.size) > MIN_SHARE * self.matters

    def measured(self, estimate: FaultEstimate, found: bool = True) -> "Fault":
        """The fault as an estimate has it."""
        value, error = (tuple(of[part] for part in self.parts) for of in (estimate.values, estimate.errors))
        return replace(self, value=value, error=error, found=found)


def possible_faults(recording: Recording, ship: Particulars, identities: Identities) -> list[Fault]:
    """Faults that a recording's channels could show; what matters follows from the ship and what they do."""
    late, abeam = 0.01 * ship.time_unit, 0.02 * ship.length
    turning, drift = (float(np.quantile(np.abs(recording[k]), 0.9)) for k in ("r", "v"))
    speed = float(np.median(np.hypot(recording["u"], recording["v"])))
    faults = []
    if identities.heading:
        faults += [
            Fault("delay of r", late, "s"),
            Fault("offset of r", 0.01 * turning, "deg/s", DEGREE),
            Fault("scale of r", 0.02, "%", 0.01),
        ]
    if identities.heading or identities.track:
        faults.append(Fault("delay of psi", late, "s"))
    if identities.track:
        faults += [
            Fault("offset of psi", 0.5 * DEGREE, "deg", DEGREE),
            Fault("delay of u, v", 2 * late, "s"),
            Fault("scale of u", 0.01, "%", 0.01),
            Fault("offset of u", 0.01 * speed, "m/s"),
            Fault("scale of v", 0.05, "%", 0.01),
            Fault("offset of v", max(0.05 * drift, 0.005 * speed), "m/s"),
            Fault("delay of x, y", late, "s"),
            Fault("point of x, y", abeam, "m"),
            Fault("point of x, y abeam", abeam, "m"),
            Fault("current", 0.02 * speed, "m/s"),
        ]
    return faults


def measure_faults(recording: Recording, ship: Particulars) -> list[Fault]:
    """Measure every fault, and find those that are there.

    Faults are taken in one by one, each time the one that explains most of what is left, as long as it is at least
    :data:`MIN_SIGMAS` standard errors from zero. Every other fault is measured beside those that were found.

    Args:
        recording: The recording, without outliers.
        ship: The ship.

    Returns:
        All possible faults, measured; none where the channels say nothing of each other.
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
            others = [f for f in faults if f not in found]
            rivals = _rivals(identities, [f for f in found if f is not fault], others, noise, together)
            measured.append(replace(fault.measured(together), rivals=rivals))
        else:
            beside = identities.estimate(_parts([*found, fault]), noise, start=together.values, rounds=2)
            measured.append(fault.measured(beside, found=False))
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
            if won > gain and fault.measured(tried).is_clear:
                best, gain = fault, won
        if best is None:
            break
        now = identities.estimate(_parts([*found, best]), noise, start=now.values)
        if not best.measured(now).is_clear:
            break
        found.append(best)
    found = fewest_delays(identities, found, faults, noise)
    together = identities.estimate(_parts(found), noise)
    return [f for f in found if f.measured(together).is_clear]


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


def _rivals(
    identities: Identities, kept: Sequence[Fault], others: Sequence[Fault], noise: Noise, together: FaultEstimate
) -> tuple[str, ...]:
    """Which of the others explain as well what is lost where only some faults are kept."""
    gain = identities.estimate(_parts(kept), noise, start=together.values).misfit - together.misfit
    limit = min(MIN_MISFIT_GAP * together.spread, ALIKE * gain)
    tried = {
        rival.name: identities.estimate(_parts([*kept, rival]), noise, start=together.values, rounds=3)
        for rival in others
    }
    return tuple(name for name, estimate in tried.items() if estimate.misfit - together.misfit < limit)


def _parts(faults: Sequence[Fault]) -> list[str]:
    return [part for f in faults for part in f.parts]
