"""What is mended in a column before it becomes a channel: gaps, delays."""

import numpy as np
from jaxtyping import Bool, Float

Series = Float[np.ndarray, " n"]


def line_across(time: Series, values: Series, lost: Bool[np.ndarray, " n"]) -> Series:
    """Samples with those that are lost replaced by straight lines between the others."""
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
