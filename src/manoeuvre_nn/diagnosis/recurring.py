"""What comes again in the missing force, in time or over the sea: periodograms of the smoothed force of all runs."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float

from manoeuvre_nn.core.effect import Situation
from manoeuvre_nn.diagnosis.locate import missing_accelerations
from manoeuvre_nn.effect.common import in_tight_turns
from manoeuvre_nn.effect.formula import BY_RUN, PERIODIC, STRIPES
from manoeuvre_nn.estimation.data_set import WhitenedDataSet
from manoeuvre_nn.numerics.finite_algebra import lstsq

PEAKS = 2
"""Peaks of each equation that are tried."""
MIN_WAVELENGTH = 0.5
"""Shortest period over L/U0, and shortest spacing over L, that a ship answers to."""
OVERSAMPLED = 3.0
"""Frequencies within the inverse of the longest run, or of the largest extent of the track."""
MAX_PER_SIDE = 40
"""SpectralPeak numbers tried north and east, either side."""
AT_ONCE = 1 << 13
"""Samples whose waves over the place are in memory at once."""


@dataclass(frozen=True)
class SpectralPeak:
    """A peak of a periodogram.

    Attributes:
        equation: X, Y or N.
        mark: ``periodic``, ``periodic_by_run`` or ``stripes``.
        scales: Period, or waves a kilometre.
        shares: Of cosine and sine: of all runs, or of each run where phases differ.
        tried: Number of independent frequencies among which it is the peak.
    """

    equation: str
    mark: str
    scales: Mapping[str, float]
    shares: tuple[tuple[float, float], ...]
    tried: int


def recurring(data_set: WhitenedDataSet) -> list[SpectralPeak]:
    """Peaks of the periodograms of missing X, Y and N: over time, with one phase or one a run, and over place."""
    situations = [p.linearised.situation for p in data_set.runs]
    force = np.concatenate(missing_accelerations(data_set))
    basis = np.concatenate([_of_the_motion(data_set, s) for s in situations])
    force = force - basis @ lstsq(basis, force)
    clock = np.concatenate([s.time.numpy() for s in situations])
    north, east = (np.concatenate([getattr(s, k).numpy() for s in situations]) / 1000 for k in "xy")
    ship = data_set.dynamics.particulars
    longest = max(float(s.time[-1]) for s in situations)
    frequencies = np.arange(1.5, longest / (MIN_WAVELENGTH * ship.time_unit), 1 / OVERSAMPLED) / longest
    ends = np.cumsum([len(s.time) for s in situations])[:-1]
    of_runs = [_over_time(f, t, frequencies) for f, t in zip(np.split(force, ends), np.split(clock, ends), strict=True)]
    weights = np.array([len(s.time) for s in situations]) / len(force)
    alike = {PERIODIC: (np.tensordot(weights, of_runs, 1)[..., None], np.ones(1))}
    by_run = {BY_RUN: (np.stack(of_runs, axis=-1), weights)} if len(of_runs) > 1 else {}
    found = [
        SpectralPeak(e, mark, {"period_s": float(1 / f[0])}, shares, round(longest * frequencies[-1]))
        for mark, (amplitude, weight) in (alike | by_run).items()
        for e, f, shares in _peaks(amplitude, weight, frequencies[:, None])
    ]
    extent = max(np.ptp(north), np.ptp(east), 1e-3)
    side = np.arange(0, min(extent / (MIN_WAVELENGTH * ship.length / 1000) * OVERSAMPLED, MAX_PER_SIDE) + 1)
    sides = side / (OVERSAMPLED * extent), np.r_[-side[:0:-1], side] / (OVERSAMPLED * extent)
    k = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 2)
    long = (k**2).sum(axis=1) <= (1.5 / extent) ** 2 * (1 + 1e-9)  # longer than the track: a trend, not a wave
    over_place = _over_place(force, (north, east), sides)[~long]
    found += [
        SpectralPeak(
            e, STRIPES, {"north_per_km": float(n), "east_per_km": float(w)}, shares,
            round(np.count_nonzero(~long) / OVERSAMPLED**2),
        )
        for e, (n, w), shares in _peaks(over_place[..., None], np.ones(1), k[~long])
    ]  # fmt: skip
    return found


def _of_the_motion(data_set: WhitenedDataSet, s: Situation) -> Float[np.ndarray, "n k"]:
    """What wrong coefficients may look like: it is no wave."""
    z = {k: v.numpy() for k, v in in_tight_turns(data_set.dynamics.hull, s).items()}
    u, v, r, d = (z[k] for k in "uvrd")
    return np.stack([np.ones_like(u), u, v, r, d, abs(v), abs(r), abs(d), r * abs(r), v * abs(v), u * r], axis=-1)


def _over_time(
    force: Float[np.ndarray, "n 3"], clock: Float[np.ndarray, " n"], frequencies: Float[np.ndarray, " w"]
) -> Complex[np.ndarray, "w 3"]:
    """Amplitudes ``sum_k f_k exp(-2 pi i w t_k) / n`` at even frequencies w and times that are whole steps."""
    # With the spacing of w as 1/(N h) they are a discrete Fourier transform over N steps h of f exp(-2 pi i w_0 t).
    if len(frequencies) < 2:
        return np.exp(-2j * np.pi * np.outer(frequencies, clock)) @ force / len(force)
    step = float(np.diff(clock[:2])[0])
    number, length = np.rint(clock / step).astype(int), round(1 / ((frequencies[1] - frequencies[0]) * step))
    begun = np.exp(-2j * np.pi * frequencies[0] * clock)[:, None] * force
    together = np.zeros((length, force.shape[1]), dtype=complex)
    np.add.at(together, number % length, begun)
    return np.fft.fft(together, axis=0)[: len(frequencies)] / len(force)


def _over_place(
    force: Float[np.ndarray, "n 3"],
    place: tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]],
    waves: tuple[Float[np.ndarray, " a"], Float[np.ndarray, " b"]],
) -> Complex[np.ndarray, "ab 3"]:
    """Amplitudes ``sum_k f_k exp(-2 pi i (a x_k + b y_k)) / n``: a product of what goes north and what goes east."""
    total = np.zeros((force.shape[1], len(waves[0]), len(waves[1])), dtype=complex)
    for start in range(0, len(force), AT_ONCE):
        rows = slice(start, start + AT_ONCE)
        along, across = (np.exp(-2j * np.pi * np.outer(p[rows], w)) for p, w in zip(place, waves, strict=True))
        total += [along.T @ (f[:, None] * across) for f in force[rows].T]
    return total.reshape(force.shape[1], -1).T / len(force)


def _peaks(
    amplitude: Complex[np.ndarray, "w 3 r"], weight: Float[np.ndarray, " r"], waves: Float[np.ndarray, "w q"]
) -> Iterator[tuple[str, Float[np.ndarray, " q"], tuple[tuple[float, float], ...]]]:
    """Equation, wave numbers and shares of cosine and sine of the highest peaks.

    Args:
        amplitude: Of X, Y and N, of all runs or of each.
        weight: Share of each in all samples.
        waves: Frequency or waves a kilometre of each row.

    Yields:
        Two peaks an equation; the root mean square of their shares over the runs is one.
    """
    for k, equation in enumerate("XYN"):
        power, taken = np.sqrt(np.abs(amplitude[:, k]) ** 2 @ weight), np.zeros(len(waves), dtype=bool)
        for _ in range(min(PEAKS, len(waves))):
            best = int(np.where(taken, -1.0, power).argmax())
            near = np.linalg.norm(waves - waves[best], axis=1)
            taken |= near <= 1.01 * np.sort(near)[min(4, len(near) - 1)]
            a = amplitude[best, k] / max(power[best], 1e-30)
            yield equation, waves[best], tuple(zip(a.real.tolist(), (-a.imag).tolist(), strict=True))
