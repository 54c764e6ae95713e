"""A channel and its slope by local cubics (Savitzky & Golay 1964), or by a cross-validated spline."""

from functools import lru_cache

import numpy as np
from jaxtyping import Float
from numpy.polynomial import legendre
from scipy.interpolate import make_smoothing_spline
from scipy.signal import oaconvolve

from manoeuvre_nn.recording.outliers import robust_sd

ORDER = 3
"""Order of the local polynomials."""
WINDOW = 0.8
"""Length of the smoother's window over L/U0."""
MAX_DIRECT = 500
"""Samples of a window up to which its sum is formed for every sample; beyond, a Fourier transform forms all at once."""


def smoothed(
    time: Float[np.ndarray, " n"], values: Float[np.ndarray, " n"], window: float | None
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Smooth a channel and take its slope.

    Args:
        time: Sample times [s], even or not.
        values: Samples.
        window: Window of the local cubics [s]; None takes a cross-validated spline.

    Returns:
        Smoothed values and their time derivative, at the same times.
    """
    if window is None and len(time) >= 5:
        spline = make_smoothing_spline(time, values)
        return spline(time), spline.derivative()(time)
    step = float(np.median(np.diff(time)))
    even = time[0] + step * np.arange(round((time[-1] - time[0]) / step) + 1)
    # Written times are rounded: what is off the even grid by less than a tenth of a step counts as on it.
    on_grid = len(even) == len(time) and np.abs(time - even).max() < 0.1 * step
    samples = values if on_grid else np.interp(even, time, values)
    count = min(max(2 * round((window or 0.0) / step / 2) + 1, ORDER + 2), (len(samples) - 1) // 2 * 2 + 1)
    order = min(ORDER, count - 1)
    value, slope = (_local_polynomial(samples, count, order, derivative, step) for derivative in (0, 1))
    return (value, slope) if on_grid else (np.interp(time, even, value), np.interp(time, even, slope))


def _local_polynomial(
    samples: Float[np.ndarray, " n"], count: int, order: int, derivative: int, step: float
) -> Float[np.ndarray, " n"]:
    """Value or slope of local polynomials over an odd number of samples; at either end, of the last whole window."""
    half, middle = count // 2, float(np.mean(samples))
    shape, fit = _window(count, order, derivative, step)
    first, last = (shape @ (fit @ some) for some in (samples[:count], samples[-count:]))
    convolve = np.convolve if count <= MAX_DIRECT else oaconvolve
    inner = convolve(samples - middle, (shape[half] @ fit)[::-1], mode="valid") + (0.0 if derivative else middle)
    return np.concatenate([first[:half], inner, last[half + 1 :]])


@lru_cache(maxsize=16)
def _window(
    count: int, order: int, derivative: int, step: float
) -> tuple[Float[np.ndarray, "count k"], Float[np.ndarray, "k count"]]:
    """Least squares in a window from -1 to 1: ``y ~ P c``, P of Legendre polynomials.

    Returns:
        P or its derivative at every sample, and what makes the coefficients of samples, ``c = P^+ y``.
    """
    at = np.linspace(-1, 1, count) if count > 1 else np.zeros(1)
    polynomials = legendre.legvander(at, order)
    terms = [legendre.legval(at, legendre.legder(c, derivative)) for c in np.eye(order + 1)]
    per_step = (2 / max(count - 1, 1) / step) ** derivative
    return per_step * np.stack(terms, axis=-1), np.linalg.pinv(polynomials)


def noise_left(
    time: Float[np.ndarray, " n"], values: Float[np.ndarray, " n"], window: float, derivative: int = 0
) -> float:
    """Standard deviation that white noise of the samples' size leaves in what :func:`smoothed` gives.

    Args:
        time: Sample times [s].
        values: Samples.
        window: Window of the local cubics [s].
        derivative: 0 of the values, 1 of the slope.

    Returns:
        The standard deviation, in the unit of either.
    """
    step = float(np.median(np.diff(time)))
    count = max(2 * round(window / step / 2) + 1, ORDER + 2)
    shape, fit = _window(count, ORDER, derivative, step)
    gain = np.linalg.norm(shape[count // 2] @ fit)
    return float(gain * robust_sd(values - smoothed(time, values, window)[0]))
