"""What is mended in a column before it becomes a channel: gaps, outliers, delays; a rudder that follows its order."""

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import median_filter

NEIGHBOURS = 5
"""Samples that an outlier is seen against."""
MIN_DISTANCE = 8.0
"""How far off the median of its neighbours an outlier lies, over the usual distance from the line between two."""
MIN_SPREAD_SHARE = 0.03
"""The same over the spread of the channel: a quiet channel has no outliers below that."""
MIN_TIP_RATIO = 2.0
"""How far off the middle of its neighbours an outlier lies, over how far the channel moves beside them."""

Series = Float[np.ndarray, " n"]


def outlying(values: Series) -> Bool[np.ndarray, " n"]:
    """Single samples that lie far off their neighbours.

    A sample is compared with the median of the five samples around it; the scale is how far samples usually lie off the
    line between their neighbours. Steps and ramps pass: there a sample is the median of its neighbours. So do the tips
    of peaks: an outlier lies further off the middle of its neighbours than the channel moves beside them.

    Args:
        values: Samples; NaN where there is none.

    Returns:
        True for outliers; two in a row are no outliers.

    Source:
        Hampel 1974, J. Am. Stat. Assoc. 69, 383-393; as a moving filter Pearson 2002, IEEE Trans. Control Syst.
        Technol. 10, 55-63. Deviation: one scale for the whole channel, for the median deviation of a window is 0 where
        it rises, and at least ``MIN_SPREAD_SHARE`` of its spread.
    """
    good = np.isfinite(values)
    if good.sum() <= NEIGHBOURS:
        return np.zeros(len(values), dtype=bool)
    there = values[good]
    away = np.abs(there - median_filter(there, NEIGHBOURS, mode="nearest"))
    low, high = np.quantile(there, [0.02, 0.98])
    bent = float(np.median(np.abs(there[1:-1] - 0.5 * (there[:-2] + there[2:]))))
    far = away > max(MIN_DISTANCE * 1.4826 * bent, MIN_SPREAD_SHARE * float(high - low), 1e-12)
    around = np.pad(away, 1)
    beside = np.maximum(around[:-2], around[2:]) > 0.5 * away
    moves = np.pad(np.abs(np.diff(there)), 3, mode="edge")  # moves[k + 3] leads from sample k to the next
    usual = np.maximum(moves[1 : len(there) + 1], moves[4 : len(there) + 4])
    middle = 0.5 * (np.pad(there, 1, mode="edge")[:-2] + np.pad(there, 1, mode="edge")[2:])
    result = np.zeros(len(values), dtype=bool)
    result[good] = far & ~beside & (np.abs(there - middle) > MIN_TIP_RATIO * usual)
    return result


def line_across(time: Series, values: Series, lost: Bool[np.ndarray, " n"]) -> Series:
    """Samples replaced by straight lines between the others.

    Args:
        time: Sample times [s].
        values: Samples.
        lost: Which are replaced.

    Returns:
        All samples.
    """
    return np.where(lost, np.interp(time, time[~lost], values[~lost]), values) if lost.any() else values


def without_delays(
    time: Series, channels: dict[str, Series], delays: dict[str, float]
) -> tuple[Float[np.ndarray, " m"], dict[str, Float[np.ndarray, " m"]]]:
    """Move channels that were written down too late back to where they belong.

    ``c(t) = written(t + delay)`` by linear interpolation; the ends, where a channel has no sample, are cut off all.

    Args:
        time: Sample times [s].
        channels: Channel -> samples.
        delays: Channel -> delay [s]; negative where it was written down too early.

    Returns:
        Times and channels of the common window; empty if there is none.
    """
    late = [*delays.values(), 0.0]
    kept = time[(time + min(late) >= time[0] - 1e-9) & (time + max(late) <= time[-1] + 1e-9)]
    return kept, {k: np.interp(kept + delays.get(k, 0.0), time, c) for k, c in channels.items()}


def followed(time: Series, order: Series, rate: float, start: float | None = None) -> Series:
    """The rudder of a steering gear that goes evenly towards its order.

    An order stands until the next sample. Unless it is said where the rudder begins it is taken to stand at the first
    order already: a record had better begin before the rudder is moved.

    Args:
        time: Sample times [s].
        order: Ordered angle [rad].
        rate: Rate of the steering gear [rad/s].
        start: Angle at the first sample [rad]; None is the first order.

    Returns:
        Rudder angle [rad].
    """
    angle = float(order[0] if start is None else start)
    result = [angle]
    for wanted, reach in zip(order[:-1], rate * np.diff(time), strict=True):
        angle += float(np.clip(wanted - angle, -reach, reach))
        result.append(angle)
    return np.array(result)
