"""Noise of measured channels with outliers: how large it is, and how far each sample is believed."""

from collections.abc import Sequence
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
    square: Sequence[Float[np.ndarray, "_ c"]],
    present: Sequence[Float[np.ndarray, "_ c"]],
    scale: Float[np.ndarray, " c"],
    floor: Float[np.ndarray, " c"],
    outliers: Literal["student", "cut"],
) -> tuple[Float[np.ndarray, " c"], list[Float[np.ndarray, "_ c"]]]:
    """Scale of each channel's noise and weights of its samples, from what estimated states leave of the channels.

    ``student`` is a step of expectation and maximisation under Student's t: ``w = 5 / (4 + e^2 / s^2)`` and
    ``s^2 = mean(w e^2)``. ``cut`` takes 1.48 times the median of |e|, and weights of 0 beyond five times that, else 1.

    Both are needed. Student's weights are those of one model: a fit to a model that is to be believed should spread
    outliers evenly, and a cut would make its steps jump. A diagnosis compares models that are wrong by different
    amounts: what one of them cannot explain must not lose its weight for that, so that the same samples, cut once where
    any force was allowed, count fully for all of them, and their log evidences are those of one Gaussian data set.

    Args:
        square: Expected squares of what is left of the channels of each run.
        present: One where a sample counts, else 0: there ``square`` may be NaN.
        scale: Scales so far.
        floor: What they are at least.
        outliers: ``student`` or ``cut``.

    Returns:
        New scales, and weights of each run.

    Source:
        Lange, Little & Taylor 1989 for Student's t; Hampel 1974 for the median.
    """
    square = [np.where(p > 0, s, 0.0) for s, p in zip(square, present, strict=True)]
    if outliers == "student":
        weights = [p * student_weight(s, scale) for s, p in zip(square, present, strict=True)]
        total = sum((w * s).sum(0) for w, s in zip(weights, square, strict=True))
        count = sum(p.sum(0) for p in present)
        return np.maximum(np.sqrt(total / np.maximum(count, 1.0)), floor), weights
    left, counted = np.sqrt(np.concatenate(square)), np.concatenate(present) > 0
    new, far = scale.copy(), np.zeros_like(counted)
    for k in np.flatnonzero(counted.sum(0) >= MIN_SAMPLES):
        far[:, k], new[k] = far_off(left[:, k], OUTLIER_SDS, floor[k], counted[:, k])
    ends = np.cumsum([len(s) for s in square])[:-1]
    return new, [p * ~f for p, f in zip(present, np.split(far, ends), strict=True)]


def student_weight(
    square: Float[np.ndarray, "n k"], scale: Float[np.ndarray, " k"], size: int = 1
) -> Float[np.ndarray, "n k"]:
    """Weight of samples whose expected square is given, under Student's t of a scale in so many dimensions.

    Args:
        square: Expected squares.
        scale: Scale of each column.
        size: Dimensions.

    Returns:
        Weights: 1.25 at the middle, little for outliers.
    """
    return (STUDENT_FREEDOM + size) / (STUDENT_FREEDOM + square / scale**2)
