"""A recording made ready for diagnosis: even samples, gaps and outliers marked, the rudder freed of noise."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import median_filter, uniform_filter1d

CHANNELS = ("x", "y", "vn", "ve", "psi", "r", "u_log", "n")
"""What is measured: position [m], velocity over ground [m/s], heading [rad], yaw rate [rad/s], log [m/s], shaft [-]."""
COUNT = len(CHANNELS)
MOTION_POWERS = (0.5, 0.5, -0.5, 1.0, 1.0, 0.0)
"""Exponents of length with which u, v, r, x, y, psi go by Froude's law."""
OWN_ORDER = 0.05
"""A shaft speed that is farther from the nominal one at the first sample was ordered otherwise [-]."""


@dataclass(frozen=True)
class Run:
    """One recorded manoeuvre.

    Attributes:
        name: What it is called.
        time: Sample times, evenly spaced [s].
        measured: Channels in the order of ``CHANNELS``; NaN where nothing usable was recorded.
        delta: Indicated rudder angle, noise taken out where the rudder rests [rad], positive to starboard.
        order: Helm order [rad]; the indicated angle if it was not recorded.
        lead: Share of the step before each sample during which a new order was in force already [-].
        shaft: Shaft speed over the nominal one, noise taken out; 1 if it was not recorded or stayed nominal [-].
        rudder_noise: Standard deviation of the noise of the indicated angle [rad].
        kind: What was sailed, as far as known.
        held_out: Whether it is kept for the proof.
        warmup: Time up to which a held-out run may be looked at [s].
    """

    name: str
    time: Float[np.ndarray, " n"]
    measured: Float[np.ndarray, "n 8"]
    delta: Float[np.ndarray, " n"]
    order: Float[np.ndarray, " n"]
    lead: Float[np.ndarray, " n"]
    shaft: Float[np.ndarray, " n"]
    rudder_noise: float
    kind: str = ""
    held_out: bool = False
    warmup: float = 40.0
    source: object = field(default=None, repr=False)

    @property
    def step(self) -> float:
        """Time between samples [s]."""
        return float(self.time[1] - self.time[0])

    def __len__(self) -> int:
        """Number of samples."""
        return len(self.time)

    def before(self, end: float) -> "Run":
        """The part up to a time.

        Args:
            end: Last time [s].

        Returns:
            The first part of the run.
        """
        k = self.time <= end + 1e-9
        rows = {n: getattr(self, n)[k] for n in ("time", "measured", "delta", "order", "lead", "shaft")}
        return replace(self, **rows)

    def without(self, bad: Bool[np.ndarray, "n 8"]) -> "Run":
        """The run with some samples marked as unusable.

        Args:
            bad: Which.

        Returns:
            A new run.
        """
        return replace(self, measured=np.where(bad, np.nan, self.measured))


def smooth_rudder(
    recorded: Float[np.ndarray, " n"], order: Float[np.ndarray, " n"], step: float, rate: float, window: float = 15.0
) -> tuple[Float[np.ndarray, " n"], float]:
    """Take the noise out of an indicated rudder angle where the rudder rests.

    While the rudder moves the record is kept: a mean would blur the ramp. It moves from a change of the order until the
    nominal gear would have arrived and two seconds more.

    Args:
        recorded: Indicated angle [rad].
        order: Helm order [rad].
        step: Time between samples [s].
        rate: Nominal rate of the gear [rad/s].
        window: Length of the mean [s].

    Returns:
        The angle and the standard deviation of its noise [rad].
    """
    shown = _gear(order, step, rate, recorded[0])
    busy = np.abs(np.diff(shown, prepend=shown[0])) > 1e-9
    reach = max(1, round(2.0 / step))
    busy = np.convolve(busy, np.ones(2 * reach + 1), mode="same") > 0
    busy |= np.abs(np.diff(order, prepend=order[0])) > 1e-9
    result = recorded.copy()
    half = max(1, round(0.5 * window / step))
    edges = np.flatnonzero(np.diff(np.concatenate([[True], busy, [True]]).astype(int)))
    residuals = []
    for start, end in zip(edges[::2], edges[1::2], strict=False):
        piece = recorded[start:end]
        if len(piece) >= 3:
            result[start:end] = _mean(_despiked(piece), half)
            residuals.append(piece - result[start:end])
    if not residuals:
        return result, 0.0
    return result, float(1.4826 * np.median(np.abs(np.concatenate(residuals))))


def order_lead(
    recorded: Float[np.ndarray, " n"], order: Float[np.ndarray, " n"], step: float, rate: float
) -> Float[np.ndarray, " n"]:
    """When, between two samples, a new order was given: the nominal gear has moved the indicator since then.

    Args:
        recorded: Indicated angle [rad].
        order: Helm order [rad].
        step: Time between samples [s].
        rate: Nominal rate of the gear [rad/s].

    Returns:
        Share of the step before each sample, 0 where the order did not change.
    """
    lead = np.zeros_like(order)
    for k in np.flatnonzero(np.abs(np.diff(order)) > rate * step) + 1:
        rest = recorded[max(k - 3, 0) : k].mean() if np.ptp(order[max(k - 3, 0) : k]) == 0 else recorded[k - 1]
        lead[k] = np.clip((recorded[k] - rest) / (np.sign(order[k] - order[k - 1]) * rate * step), 0.0, 1.0)
    return lead


def _despiked(piece: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Values far off the median held at it."""
    middle = np.median(piece)
    spread = 1.4826 * np.median(np.abs(piece - middle)) + 1e-6
    return np.where(np.abs(piece - middle) > 5 * spread, middle, piece)


def _mean(piece: Float[np.ndarray, " n"], half: int) -> Float[np.ndarray, " n"]:
    """Mean over a window, shorter at the ends."""
    window, n = np.ones(2 * half + 1), len(piece)
    return (np.convolve(piece, window) / np.convolve(np.ones(n), window))[half : half + n]


def _gear(order: Float[np.ndarray, " n"], step: float, rate: float, start: float) -> Float[np.ndarray, " n"]:
    """What a steering gear of a rate makes of orders."""
    shown = np.empty_like(order)
    shown[0] = start
    for k in range(1, len(order)):
        shown[k] = shown[k - 1] + np.clip(order[k - 1] - shown[k - 1], -rate * step, rate * step)
    return shown


def with_own_shafts(runs: Sequence[Run]) -> tuple[Run, ...]:
    """Runs whose shaft speed is what was ordered where they approach at other speeds than the model's nominal one.

    A shaft that is nominal on the approach and then falls off shows an engine at its limit. One that is another from
    the first sample on was ordered otherwise: it still drives the model, but says nothing of the engine.

    Args:
        runs: Runs of one ship.

    Returns:
        The runs; without the channel of the shaft speed if one of them was ordered otherwise.
    """
    n = CHANNELS.index("n")
    if all(abs(run.shaft[0] - 1) <= OWN_ORDER for run in runs):
        return tuple(runs)
    return tuple(replace(run, measured=np.where(np.arange(COUNT) == n, np.nan, run.measured)) for run in runs)


def smooth_shaft(ratio: Float[np.ndarray, " n"], window: int = 15) -> Float[np.ndarray, " n"]:
    """Shaft speed as an input of the model: 1 where it is nominal all the time, else the record without its noise.

    Args:
        ratio: Recorded shaft speed over the nominal one [-]; NaN in gaps.
        window: Samples of the running median.

    Returns:
        Ratio [-].
    """
    good = np.isfinite(ratio)
    if good.sum() < window:
        return np.ones_like(ratio)
    filled = np.interp(np.arange(len(ratio)), np.flatnonzero(good), ratio[good])
    smooth = uniform_filter1d(median_filter(filled, window, mode="nearest"), window // 2, mode="nearest")
    return smooth if np.abs(smooth - 1).max() > 0.01 else np.ones_like(ratio)
