"""Fewer samples where there are more than a ship's motion needs: what is computed of a run takes as long as it has."""

import numpy as np
from jaxtyping import Float
from scipy.linalg import solveh_banded

from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.recording.preparation import measured

SAMPLES_PER_TIME_UNIT = 400
"""Samples in the time L/U0 that tell all of a ship's motion: local cubics over .8 L/U0 have 320 then."""
ORDERS = ("delta_order", "order_lead")
"""Channels that are no samples of anything: what is ordered stands until the next order."""
RUDDER = "delta"
"""Channel that moves the ship, evenly from sample to sample."""
PARTS = 8
"""Parts of a step that a broken line is fitted by."""
MAX_MOVED = 5
"""Times to either side within which there must be other samples if one is moved."""


def thinned(recording: Recording, ship: Particulars) -> Recording:
    """Averages over so many samples that at least :data:`SAMPLES_PER_TIME_UNIT` are left in the time L/U0.

    Returns:
        A recording of averages, less the samples at the end that fill no average; the same one if it has no more.
    """
    count = int(ship.time_unit / (SAMPLES_PER_TIME_UNIT * recording.step))
    if count < 2 or len(recording) < 4 * count:
        return recording
    # As they were recorded: uneven times, and gaps of which checks are told.
    whole = len(recording) // count * count
    given = {"time": recording.time, **recording.channels}
    means = {name: values[:whole].reshape(-1, count).mean(axis=1) for name, values in given.items()}
    return Recording(recording.name, means.pop("time"), means, recording.status, recording.meta)


def averaged(recording: Recording, count: int) -> Recording:
    """Averages of a prepared recording over so many times, at the middle of the samples that were taken in them.

    That is the same in all: where samples are rarer than times, an average may be one sample, at its own time. Where
    others lack, those that are there are moved to it by the slope of the samples about them. The rudder is the
    broken line that departs least from the recorded one: averages would cut the corners where it is laid, and a ship
    moves by it as by the whole record. Orders stand as they do at the middle, and are in force as long before it.

    Args:
        recording: At even times; gaps as NaN, none in the rudder.
        count: How many.

    Returns:
        A recording of averages, less the samples at the end that fill no average; the same one if it has few samples.
    """
    if count < 2 or len(recording) < 4 * count:
        return recording
    time = recording.time[: len(recording) // count * count].reshape(-1, count)
    middle = time.mean(axis=1) + _off_the_middle(recording, count)
    sampled = {k: v for k, v in recording.channels.items() if k not in (RUDDER, *ORDERS)}
    made = {k: _means(recording.time, v, time, middle) for k, v in sampled.items()}
    made[RUDDER] = _broken_line(recording.time, recording[RUDDER], middle)
    made |= _orders(recording, middle)
    return Recording(recording.name, middle, made, recording.status, recording.meta)


def _off_the_middle(recording: Recording, count: int) -> float:
    """How much later than the middle of so many times the samples among them usually are [s]."""
    samples = measured(recording)[: len(recording) // count * count]
    taken = np.isfinite(samples.reshape(-1, count, samples.shape[1])).max(axis=2)
    number = taken.sum(axis=1)
    mean = (taken @ np.arange(count))[number > 0] / number[number > 0]
    return float(np.median(mean) - (count - 1) / 2) * recording.step if len(mean) else 0.0


def samples_apart(recording: Recording) -> int:
    """After how many of a recording's even times there is usually a sample of some channel: 1 where each has one."""
    at = np.flatnonzero(np.isfinite(measured(recording)).any(axis=1))
    return round(float(np.median(np.diff(at)))) if len(at) > 1 else 1


def _means(
    time: Float[np.ndarray, " n"],
    values: Float[np.ndarray, " n"],
    parts: Float[np.ndarray, "m count"],
    middle: Float[np.ndarray, " m"],
) -> Float[np.ndarray, " m"]:
    """Means of a channel; NaN where nothing is near."""
    samples = values[: parts.size].reshape(parts.shape)
    there = np.isfinite(samples)
    if there.all():
        return samples.mean(axis=1)
    good, some, number = np.isfinite(values), there.any(axis=1), np.maximum(there.sum(axis=1), 1)
    means, at = (np.where(there, x, 0.0).sum(axis=1) / number for x in (samples, parts))
    if good.any():
        known, step = time[good], time[1] - time[0]
        line = (middle - at) * np.interp(at, known, _slopes(known, values[good], (MAX_MOVED + 0.5) * step))
        after = np.clip(np.searchsorted(known, 0.5 * (at + middle)), 1, max(len(known) - 1, 1))
        wide = known[after] - known[after - 1] if len(known) > 1 else np.full(len(middle), np.inf)
        off = some & (np.abs(at - middle) > 1e-6 * step)
        means = means + np.where(off, line, 0.0)
        some &= ~(off & (wide > (MAX_MOVED + 0.5) * step))
    return np.where(some, means, np.nan)


def _slopes(time: Float[np.ndarray, " n"], values: Float[np.ndarray, " n"], near: float) -> Float[np.ndarray, " n"]:
    """Slope at each sample, from two to either side: from one, it would have half of their noise in a step.

    Args:
        time: Of the samples.
        values: The samples.
        near: Time between two samples from which nothing is known of what lies between.

    Returns:
        Slopes; 0 at a sample that none is near to.
    """
    part, k = np.cumsum(np.diff(time, prepend=time[0]) > near), np.arange(len(time))
    before = np.maximum(k - 2, np.searchsorted(part, part))
    after = np.minimum(k + 2, np.searchsorted(part, part, side="right") - 1)
    apart = time[after] - time[before]
    return (values[after] - values[before]) / np.where(apart > 0, apart, np.inf)


def _broken_line(
    time: Float[np.ndarray, " n"], values: Float[np.ndarray, " n"], at: Float[np.ndarray, " m"]
) -> Float[np.ndarray, " m"]:
    """Values at even times of the broken line through them that departs least from a finer one, squared, over time.

    Normal equations ``(h . h^T) c = h . y``, h the hat functions about these times.

    Returns:
        Values c.
    """
    step = at[1] - at[0]
    fine = np.arange(at[0] - 0.5 * step, at[-1] + 0.5 * step, (time[1] - time[0]) / PARTS)
    y = np.interp(fine, time, values)
    left = np.clip(((fine - at[0]) // step).astype(int), 0, len(at) - 2)
    after = np.clip((fine - at[left]) / step, 0.0, 1.0)

    def onto(first: Float[np.ndarray, " k"], second: Float[np.ndarray, " k"]) -> Float[np.ndarray, " m"]:
        return np.bincount(left, first, len(at)) + np.bincount(left + 1, second, len(at))

    beside = np.append(0.0, np.bincount(left, (1 - after) * after, len(at))[:-1])
    return solveh_banded(np.stack([beside, onto((1 - after) ** 2, after**2)]), onto((1 - after) * y, after * y))


def _orders(recording: Recording, middle: Float[np.ndarray, " m"]) -> dict[str, Float[np.ndarray, " m"]]:
    """Helm orders at other times, and for which share of the step before they are in force."""
    time, order = recording.time, recording[ORDERS[0]]
    latest = np.searchsorted(time, middle + 1e-9, side="right") - 1
    came = 1 + np.flatnonzero(np.diff(order) != 0)
    given = time[came] - recording[ORDERS[1]][came] * (time[1] - time[0])
    step, lead = middle[1] - middle[0], np.zeros(len(middle))
    after = np.searchsorted(middle, time[came] - 1e-9)
    inside = (after > 0) & (after < len(middle))
    lead[after[inside]] = np.minimum((middle[after[inside]] - given[inside]) / step, 1.0)
    return {ORDERS[0]: order[latest], ORDERS[1]: lead}
