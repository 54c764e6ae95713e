"""Samples that are wrong: the two outlier routines of the package, and the fit that uses the second.

:func:`spikes` looks at a channel alone, where nothing else says what a sample should be: its neighbours do.
:func:`far_off` looks at what a model leaves of one: there the model says it, and neighbours may be wrong together.
"""

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import median_filter

NEIGHBOURS = 5
"""Samples that a spike is seen against."""
MIN_DISTANCE = 8.0
"""How far off the median of its neighbours a spike lies, over the usual distance from the line between two."""
MIN_SPREAD_SHARE = 0.03
"""The same over the spread of the channel: a quiet channel has no spikes below that."""
MIN_TIP_RATIO = 2.0
"""How far off the middle of its neighbours a spike lies, over how far the channel moves beside them."""
MAD_TO_SD = 1.4826
"""Standard deviation of Gaussian noise over its median absolute deviation."""

Series = Float[np.ndarray, " n"]


def robust_sd(values: Float[np.ndarray, " n"]) -> float:
    """Standard deviation of noise about zero that outliers do not enlarge: 1.4826 times the median of its size."""
    return MAD_TO_SD * float(np.median(np.abs(values)))


def spikes(values: Series, min_spread_share: float = MIN_SPREAD_SHARE) -> Bool[np.ndarray, " n"]:
    """Single samples that lie far off their neighbours.

    A sample is compared with the median of the five samples around it; the scale is how far samples usually lie off the
    line between their neighbours. Steps and ramps pass: there a sample is the median of its neighbours. So do the tips
    of peaks: a spike lies further off the middle of its neighbours than the channel moves beside them. Neighbours of
    the first and of the last sample count for both of their sides, and these two may move as the channel does anywhere.

    Args:
        values: Samples; NaN where there is none.
        min_spread_share: Smallest spike over the spread of the channel [-]; 0 finds those of a few metres in a track of
            kilometres.

    Returns:
        True for spikes; two in a row are none.

    Source:
        Hampel 1974, J. Am. Stat. Assoc. 69, 383-393; as a moving filter Pearson 2002, IEEE Trans. Control Syst.
        Technol. 10, 55-63. Deviation: one scale for the whole channel, for the median deviation of a window is 0 where
        it rises, and at least ``min_spread_share`` of its spread.
    """
    good = np.isfinite(values)
    if good.sum() <= NEIGHBOURS:
        return np.zeros(len(values), dtype=bool)
    there = values[good]
    away = np.abs(there - median_filter(there, NEIGHBOURS, mode="mirror"))
    low, high = np.quantile(there, [0.02, 0.98])
    bent = robust_sd(there[1:-1] - 0.5 * (there[:-2] + there[2:]))
    far = away > max(MIN_DISTANCE * bent, min_spread_share * float(high - low), 1e-12)
    around = np.pad(away, 1)
    beside = np.maximum(around[:-2], around[2:]) > 0.5 * away
    moves = np.pad(np.abs(np.diff(there)), 3)  # moves[k + 3] leads from sample k to the next
    usual = np.maximum(moves[1 : len(there) + 1], moves[4 : len(there) + 4])
    # What begins to move with the last sample, as a rudder does, may move as it does elsewhere; so may what just ended.
    elsewhere = moves[3 : len(there) + 2][~far[:-1] & ~far[1:]].max(initial=0.0)
    usual[[0, -1]] = np.maximum(usual[[0, -1]], elsewhere)
    result = np.zeros(len(values), dtype=bool)
    result[good] = far & ~beside & (np.abs(there - middle_of_neighbours(there)) > MIN_TIP_RATIO * usual)
    return result


def middle_of_neighbours(values: Series) -> Series:
    """Mean of the samples before and after each; at the ends the sample itself counts for the one that lacks."""
    padded = np.pad(values, 1, mode="edge")
    return 0.5 * (padded[:-2] + padded[2:])


def far_off(
    residual: Series, sds: float, min_sd: float = 0.0, among: Bool[np.ndarray, " n"] | None = None
) -> tuple[Bool[np.ndarray, " n"], float]:
    """Residuals that no noise explains: ``|residual| > sds sd`` with the robust standard deviation sd of the others.

    Args:
        residual: What a model leaves; NaN where there is no sample.
        sds: Standard deviations that noise stays within.
        min_sd: What the standard deviation is never taken to be less than, in the unit of the residual.
        among: Samples that it is taken of; None takes all that are there.

    Returns:
        Which are far off, and the standard deviation.
    """
    sd = max(robust_sd(residual[np.isfinite(residual) if among is None else among]), min_sd)
    return np.abs(residual) > sds * sd, sd


def trimmed_least_squares(
    x: Float[np.ndarray, "n k"], y: Series, sds: float, min_sd: float, among: Bool[np.ndarray, " n"] | None = None
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, "k k"], Bool[np.ndarray, " n"]]:
    """Least squares without the samples that it leaves :func:`far_off`, three times over.

    Args:
        x: One column an unknown; those that say the same share what they explain.
        y: What they add up to.
        sds: Standard deviations that noise stays within.
        min_sd: Least standard deviation of the noise.
        among: Samples that may be used; None takes all.

    Returns:
        The unknowns, their covariance for white noise of the size that is left, and the samples that were kept.
    """
    among = np.ones(len(y), dtype=bool) if among is None else among
    kept = among
    for _ in range(3):
        solution, _ = least_squares(x[kept], y[kept])
        kept = among & ~far_off(y - x @ solution, sds, min_sd, among)[0]
    return solution, least_squares(x[kept], y[kept])[1], kept


def least_squares(x: Float[np.ndarray, "n k"], y: Series) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, "k k"]]:
    """Unknowns of ``y = x a``, and their covariance for white noise of the size that is left."""
    size = np.maximum(np.sqrt((x**2).sum(axis=0)), 1e-150)  # its square is no 0
    gram = (x / size).T @ (x / size)
    # That of one column is 1, or 0 where it is 0 throughout: no decomposition is needed.
    inverse = np.linalg.pinv(gram, rcond=1e-9, hermitian=True) if len(gram) > 1 else np.round(gram)
    solution = inverse @ ((x / size).T @ y) / size
    rest = y - x @ solution
    variance = float(rest @ rest) / max(len(y) - x.shape[1], 1)
    return solution, variance * inverse / size[:, None] / size  # one by one: the square of the least size is 0
