"""Noise of measured channels with outliers: how large it is, and how far each sample is believed."""

from typing import Literal

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.recording.outliers import far_off

STUDENT_FREEDOM = 4.0
"""Degrees of freedom of Student's t, the distribution of measurement noise with outliers."""
GAUSSIAN = 1.203
"""Standard deviation of Gaussian noise over the scale of the Student's t that fits it best."""
INFORMATION = (STUDENT_FREEDOM + 1) / (STUDENT_FREEDOM + 3)
"""Fisher's information of a sample under Student's t over that of a weight of 1. With it standard errors are right for
noise with outliers and, to 3 %, for Gaussian noise; without it they are a sixth too small."""
OUTLIER_SDS = 5.0
"""Samples further off than this many standard deviations are cut out."""
MIN_SAMPLES = 10
"""Samples of a channel from which on its noise is measured where outliers are cut out."""


def measured_noise(
    square: Float[np.ndarray, "n c"],
    present: Float[np.ndarray, "n c"],
    scale: Float[np.ndarray, " c"],
    floor: Float[np.ndarray, " c"],
    outliers: Literal["student", "cut"],
) -> tuple[Float[np.ndarray, " c"], Float[np.ndarray, "n c"]]:
    """Scale of each channel's noise and weights of its samples, from what estimated states leave of the channels.

    ``student`` is a step of expectation and maximisation under Student's t: ``w = 5 / (4 + e^2 / s^2)`` and
    ``s^2 = mean(w e^2)``. ``cut`` takes 1.48 times the median of
    |e|, and weights of 0 beyond five times that, else 1.

    Both are needed. Student's weights are those of one model: a fit to a model that is to be believed should spread
    outliers evenly, and a cut would make its steps jump. A diagnosis compares models that are wrong by different
    amounts: what one of them cannot explain must not lose its weight for that, so that the same samples, cut once where
    any force was allowed, count fully for all of them, and their log evidences are those of one Gaussian data set.

    Args:
        square: Expected squares of what is left of the channels, of all runs.
        present: One where a sample counts, else 0: there ``square`` may be NaN.
        scale: Scales so far.
        floor: What they are at least.
        outliers: ``student`` or ``cut``.

    Returns:
        New scales, and weights.

    Source:
        Lange, Little & Taylor 1989 for Student's t; :func:`.far_off` for the cut.
    """
    counts = present > 0
    if outliers == "student":
        weights = present * student_weight(np.where(counts, square, 0.0), scale)
        total = (weights * np.where(counts, square, 0.0)).sum(0)
        return np.maximum(np.sqrt(total / np.maximum(present.sum(0), 1.0)), floor), weights
    new, weights = scale.copy(), present.copy()
    for k in np.flatnonzero(counts.sum(0) >= MIN_SAMPLES):
        far, new[k] = far_off(np.sqrt(square[:, k]), OUTLIER_SDS, floor[k], counts[:, k])
        weights[far, k] = 0.0
    return new, weights


def student_weight(
    square: Float[np.ndarray, "n k"], scale: Float[np.ndarray, " k"], size: int = 1
) -> Float[np.ndarray, "n k"]:
    """Weight of samples whose expected square is given, under Student's t of a scale in so many dimensions.

    Returns:
        Weights: 1.25 at the middle, little for outliers.
    """
    return (STUDENT_FREEDOM + size) / (STUDENT_FREEDOM + square / scale**2)
