"""Free decay out of records in random excitation: autocorrelation, random decrement, and the rates that they show."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float
from numpy.lib.stride_tricks import sliding_window_view
from scipy.fft import next_fast_len

from manoeuvre_nn.core.errors import InputError

Window = Literal["whole", "common"]
"""``whole`` sums all products that the record has at a lag; ``common`` the same instants at every lag."""


def correlations(
    motion: Float[np.ndarray, "*batch times channels"], lags: int, window: Window = "whole"
) -> Float[np.ndarray, "*batch lags channels channels"]:
    """Auto- and cross-correlation functions of a record.

    ``C_ij(k) = 1/n sum_t x_i(t + k) x_j(t)``. A mean is not taken off. With ``whole``, as in the source, a decay that
    has not died out at the end bends the functions, since fewer products remain at the larger lags; with ``common``
    a free decay keeps its own form, ``C(k) = exp(A k h) C(0)``, however short the record is.

    Args:
        motion: Samples x at equal steps.
        lags: Largest lag k in steps.
        window: Instants that are summed over.

    Returns:
        Correlations at the lags 0 to ``lags``.

    Raises:
        InputError: If the record is not longer than the lags.

    Source:
        Wang 1996, eq 7.28.
    """
    times = motion.shape[-2]
    if not 0 < lags < times:
        raise InputError(f"{lags} lags of a record of {times} samples: write 1 to {times - 1}")
    early = motion[..., : times - lags if window == "common" else times, :]
    # Products of Fourier transforms, padded so that nothing runs round the end.
    padded = next_fast_len(times + lags, real=True)
    waves, early_waves = (np.fft.rfft(x, padded, axis=-2) for x in (motion, early))
    products = np.fft.irfft(waves[..., :, None] * early_waves.conj()[..., None, :], padded, axis=-3)
    return np.asarray(products[..., : lags + 1, :, :] / early.shape[-2])


def autocorrelation(
    record: Float[np.ndarray, "*batch times"], lags: int, window: Window = "whole"
) -> Float[np.ndarray, "*batch lags"]:
    """Autocorrelation function of one channel; see :func:`correlations`.

    Args:
        record: Samples at equal steps.
        lags: Largest lag in steps.
        window: Instants that are summed over.

    Returns:
        Autocorrelation at the lags 0 to ``lags``.
    """
    return correlations(record[..., None], lags, window)[..., 0, 0]


def random_decrement(
    record: Float[np.ndarray, " times"], level: float, lags: int
) -> tuple[Float[np.ndarray, " lags"], int]:
    """Random decrement signature: the mean of all pieces of a record that begin where it crosses a level.

    For a Gaussian record of zero mean it is ``level R(k)/R(0)``. It is the free decay only if the excitation is white.

    Args:
        record: Samples at equal steps.
        level: Level, crossed upward or downward.
        lags: Length of the pieces in steps.

    Returns:
        Signature, which begins at the level, and the number of pieces.

    Raises:
        InputError: If the record never crosses the level.

    Source:
        Cole 1973; relation to the autocorrelation: Vandiver, Dunwoody, Campbell & Cook 1982.
    """
    above = record[: len(record) - lags] >= level
    before = np.flatnonzero(above[1:] != above[:-1])
    if not len(before):
        raise InputError(
            f"the record never crosses {level:g}: write a level between {record.min():g} and {record.max():g}"
        )
    # The crossing lies between two samples: pieces that begin at either, mixed, begin at the level itself.
    share = (level - record[before]) / (record[before + 1] - record[before])
    pieces = sliding_window_view(record, lags + 2)[before]
    return (pieces[:, :-1] + share[:, None] * np.diff(pieces)).mean(0), len(before)


def decay_rate(correlation: Float[np.ndarray, "*batch lags"], step: float) -> Float[np.ndarray, "*batch"]:
    """Slope of the straight line through the logarithm of a decay, by least squares.

    Negative values are folded up, as in the source; where there are any, the slope means little.

    Args:
        correlation: Autocorrelation function or free decay.
        step: Time between its values [s].

    Returns:
        Rate [1/s], below 0 for a decay.

    Source:
        Wang 1996, eqs 7.31 and 7.32.
    """
    lag = step * np.arange(correlation.shape[-1])
    centred = lag - lag.mean()
    return np.asarray(np.log(np.abs(correlation)) @ centred / (centred @ centred))


def motion_matrix(
    correlation: Float[np.ndarray, "*batch lags n n"], step: float, stride: int = 1
) -> Float[np.ndarray, "*batch n n"]:
    """Matrix A of ``xdot = A x`` whose free motion has these correlation functions.

    ``C(t + s) = exp(A s) C(t)`` is solved for ``exp(A s)`` by least squares over all lags. Channels are scaled by their
    root mean squares first, so that their units do not matter.

    Args:
        correlation: Correlation functions of :func:`correlations`.
        step: Time between lags [s].
        stride: s in steps; a longer one is disturbed less by what is left of the excitation.

    Returns:
        A [1/s, in the units of the channels]; not a number where ``exp(A s)`` has a root that is no decay or growth.

    Source:
        The time-domain method of Ibrahim & Mikulcik 1977 on correlation functions.
    """
    scale = np.sqrt(np.abs(np.diagonal(correlation[..., 0, :, :], axis1=-2, axis2=-1)))
    scaled = correlation / (scale[..., None, :, None] * scale[..., None, None, :])
    now, then = scaled[..., :-stride, :, :], scaled[..., stride:, :, :]
    moved = np.einsum("...tij,...tkj->...ik", then, now) @ np.linalg.inv(np.einsum("...tij,...tkj->...ik", now, now))
    roots, vectors = np.linalg.eig(moved)
    # A negative real root belongs to no linear system in continuous time.
    sound = ~np.any((np.abs(roots.imag) < 1e-12) & (roots.real <= 0), axis=-1)
    logs = np.log(np.where(sound[..., None], roots, 1.0).astype(complex)) / (stride * step)
    matrix = (vectors * logs[..., None, :] @ np.linalg.inv(vectors)).real
    matrix = matrix * scale[..., :, None] / scale[..., None, :]
    return np.where(sound[..., None, None], matrix, np.nan)


@dataclass(frozen=True)
class Modes:
    """A free motion as a sum of exponentials, ``x_i(t) = sum_k c_ik exp(lambda_k t)``.

    Attributes:
        rates: lambda [1/s], rising.
        amplitudes: c, a row for each channel.
    """

    rates: Float[np.ndarray, " modes"]
    amplitudes: Float[np.ndarray, "channels modes"]

    def motion(self, time: Float[np.ndarray, " times"]) -> Float[np.ndarray, "channels times"]:
        """The motion.

        Args:
            time: Times [s].

        Returns:
            x.
        """
        return np.asarray(self.amplitudes @ np.exp(np.outer(self.rates, time)))

    def autocorrelation(self, lag: Float[np.ndarray, " lags"], duration: float) -> Float[np.ndarray, "channels lags"]:
        """Autocorrelation functions in closed form, for an observation much longer than the decay.

        Args:
            lag: Lags [s].
            duration: Observation time T* [s].

        Returns:
            ``-1/T* sum_jk c_j c_k exp(lambda_k lag) / (lambda_j + lambda_k)``.

        Source:
            Wang 1996, eqs 7.29, 7.30, 7.45 and 7.46.
        """
        energy = -self.amplitudes @ (1 / (self.rates[:, None] + self.rates)) * self.amplitudes / duration
        return np.asarray(energy @ np.exp(np.outer(self.rates, lag)))


def free_modes(matrix: Float[np.ndarray, "n n"], start: Float[np.ndarray, " n"]) -> Modes:
    """Modes of ``xdot = A x`` from a start.

    Args:
        matrix: A [1/s].
        start: x at time 0.

    Returns:
        Rates and amplitudes.

    Raises:
        InputError: If the free motion swings.

    Source:
        Wang 1996, eqs 7.37-7.40, with amplitudes that meet the rates of the system at time 0, not rates of zero.
    """
    rates, vectors = np.linalg.eig(matrix)
    if rates.imag.any():  # from numpy 2.5 on they are complex numbers in any case
        raise InputError(f"the free motion swings, with roots {rates[0]:.4g} and so on: modes are for real roots")
    rates, vectors = rates.real, vectors.real
    amplitudes = vectors * np.linalg.solve(vectors, start)
    order = np.argsort(rates)
    return Modes(rates[order], amplitudes[:, order])
