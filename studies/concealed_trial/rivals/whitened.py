"""All fitted runs of a case as one regression: averaged errors, their covariance, and what hypotheses take off them.

The covariance holds what every hypothesis has to live with: instrument noise as smoothing passes it on, a coloured
force, the receiver's delay, and errors of the published coefficients, common to all runs.
"""

from collections.abc import Sequence
from itertools import accumulate

import numpy as np
import torch
from jaxtyping import Float
from scipy.linalg import block_diag, solve_triangular, toeplitz
from scipy.signal import savgol_coeffs

from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.core.recording import Recording
from studies.concealed_trial.rivals.package import (
    FIRST_NOISE,
    ORDER,
    Corrections,
    Hypothesis,
    Model,
    process_time,
    typical_rates,
)
from studies.concealed_trial.rivals.track import ROWS, SmoothedTrack, smoother_size, track

SCATTER = 0.045
"""Relative standard deviation of published coefficients: 3 to 6 % is usual."""
LATENCY_SPREAD = 0.15
"""Standard deviation of the receiver's delay about the usual one [s]."""
ROUGH = 0.02
"""Coloured force over the resistance and the force of 20 deg of rudder."""
NUDGE = 0.02
"""Step of a parameter for derivatives, over its spread."""


class WhitenedRuns:
    """The runs, and how a hypothesis looks on them.

    Attributes:
        dynamics: Calm-water model.
        tracks: The runs.
        parts: Averages of each run among all.
        errors: Averaged errors of calm water.
        nuisances: What is uncertain anyway adds to them, flattened, times its standard deviations: delay, coefficients.
        covariance: Of the flattened errors.
    """

    def __init__(self, dynamics: Model, runs: Sequence[Recording], at_samples: bool = False) -> None:
        """Smooth the runs.

        Args:
            dynamics: Calm-water model.
            runs: The runs.
            at_samples: See :meth:`.SmoothedTrack.nuisances`.
        """
        self.dynamics, self.tracks = dynamics, [track(dynamics, run) for run in runs]
        errors = [t.errors()[..., 0] for t in self.tracks]
        ends = list(accumulate((len(e) for e in errors), initial=0))
        self.parts = [slice(a, b) for a, b in zip(ends, ends[1:], strict=False)]
        self.errors = np.concatenate(errors)
        corrections = Corrections(dynamics)
        columns = np.concatenate([t.nuisances(corrections, at_samples) for t in self.tracks])
        columns = columns.reshape(self.errors.size, -1)
        self.nuisances = columns * np.append(LATENCY_SPREAD, np.full(columns.shape[1] - 1, SCATTER))
        own = [_own(dynamics, t, len(e)) for t, e in zip(self.tracks, errors, strict=True)]
        self.covariance = block_diag(*own) + self.nuisances @ self.nuisances.T
        self._root = np.linalg.cholesky(self.covariance)

    def seen(self, errors: Float[np.ndarray, "b 6 k"]) -> Float[np.ndarray, "n rows k"]:
        """Errors as the fit compares them: here independent and of variance one.

        Args:
            errors: Averaged errors, one column a hypothesis.

        Returns:
            Samples of each row.
        """
        return solve_triangular(self._root, errors.reshape(self.errors.size, -1), lower=True).reshape(errors.shape)

    def tried(
        self, effects: Sequence[Effect], tables: Sequence[Float[np.ndarray, "runs k p"]]
    ) -> Float[np.ndarray, "b 6 k"]:
        """Errors that several sets of values leave.

        Args:
            effects: The effects.
            tables: Values of each in every run, one set a row.

        Returns:
            One column a set.
        """
        found = []
        for run, t in enumerate(self.tracks):
            parts = [t.contribution(e, table[run]) for e, table in zip(effects, tables, strict=True)]
            found.append(t.errors(*(np.sum(part, axis=0) for part in zip(*parts, strict=True))))
        return np.concatenate(found)

    def evaluate(self, h: Hypothesis) -> tuple[Float[np.ndarray, "n rows"], Float[np.ndarray, "n rows q"]]:
        """What a hypothesis leaves as the fit compares it, and its derivatives by the free numbers.

        Args:
            h: The hypothesis.

        Returns:
            Samples and slopes.
        """
        free = h.unknowns()
        tables = [np.repeat(v[:, None], 1 + len(free), axis=1) for v in h.values]
        steps = np.array([NUDGE * f.parameter.spread if not f.parameter.period else 1.0 for f in free])
        for k, f in enumerate(free):
            inside = h.values[f.effect][0, f.column] + steps[k] <= f.parameter.high or f.parameter.period
            steps[k] *= 1 if inside else -1
            tables[f.effect][:, 1 + k, f.column] += steps[k]
        view = self.seen(self.tried(h.effects, tables))
        return view[..., 0], (view[..., 1:] - view[..., :1]) / steps

    def alone(self, run: int, rows: Float[np.ndarray, "b 6 k"]) -> Float[np.ndarray, "m k"]:
        """Rows of one run, independent and of variance one.

        Args:
            run: Number of the run.
            rows: Errors or what changes them.

        Returns:
            White rows, flattened.
        """
        part = slice(self.parts[run].start * len(ROWS), self.parts[run].stop * len(ROWS))
        root = np.linalg.cholesky(self.covariance[part, part])
        return solve_triangular(root, rows.reshape(len(root), -1), lower=True)

    def shares(self, h: Hypothesis) -> Float[np.ndarray, " m"]:
        """Errors of the coefficients that what a hypothesis leaves speaks for.

        Args:
            h: The hypothesis.

        Returns:
            Relative errors.
        """
        left = self.tried(h.effects, [v[:, None] for v in h.values]).ravel()
        return SCATTER * (self.nuisances.T @ np.linalg.solve(self.covariance, left))[1:]


def _own(dynamics: Model, t: SmoothedTrack, count: int) -> Float[np.ndarray, "m m"]:
    """Covariance of the flattened errors of one run by instruments and a coloured force."""
    speed = dynamics.particulars.speed
    value, slope = kernels(dynamics, t, 2)
    _, _, north, _, psi, r, log, shaft = FIRST_NOISE
    drift = float(np.hypot(north, speed * psi))
    through = np.abs(jacobian(t, speed)) * [log, drift, r]
    slopes = [[log], [north, speed * psi], [r], [], [psi], []]
    values = [*through.tolist(), [log, north], [r], [shaft]]
    rough = np.append(ROUGH * typical_rates(dynamics), [0.0, 0.0, 0.0])
    total = np.zeros((count, len(ROWS), count, len(ROWS)))
    for row in range(len(ROWS)):
        parts = [(value, values[row]), (slope, slopes[row])]
        total[:, row, :, row] = noise_covariance(dynamics, t, parts, float(rough[row]), count) / t.unit[row] ** 2
    return total.reshape(count * len(ROWS), -1)


def kernels(dynamics: Model, t: SmoothedTrack, orders: int) -> list[Float[np.ndarray, " k"]]:
    """From the samples of a channel to averages of it and of its derivatives.

    Args:
        dynamics: Calm-water model.
        t: The run.
        orders: 2 for value and slope, 3 for the second derivative too.

    Returns:
        One kernel an order.
    """
    size, step = smoother_size(dynamics.particulars.time_unit, t.run.step), t.run.step
    return [np.convolve(t.weight, savgol_coeffs(size, ORDER, deriv=d, delta=step)) for d in range(orders)]


def noise_covariance(
    dynamics: Model, t: SmoothedTrack, parts: Sequence[tuple[np.ndarray, Sequence[float]]], rough: float, count: int
) -> Float[np.ndarray, "n n"]:
    """Covariance of the averages of one row by white noise through kernels and a coloured force.

    Args:
        dynamics: Calm-water model.
        t: The run.
        parts: Kernels, each with the standard deviations of the noises that pass through it.
        rough: Standard deviation of the coloured force, in the row's unit.
        count: How many averages.

    Returns:
        The covariance.
    """
    gap, hop, lags = np.arange(len(t.weight)), len(t.weight) // 2, np.zeros(count)
    for lag in range(min(count, 12)):
        k = lag * hop
        for kernel, sizes in parts:
            lags[lag] += np.square(sizes).sum() * (kernel[k:] @ kernel[: len(kernel) - k] if k < len(kernel) else 0)
        fading = np.exp(-np.abs(gap[:, None] - gap - k) * t.run.step / process_time(dynamics))
        lags[lag] += rough**2 * (t.weight @ fading @ t.weight)
    return toeplitz(lags)


def jacobian(t: SmoothedTrack, speed: float) -> Float[np.ndarray, "3 3"]:
    """Derivative of the calm-water accelerations by u, v, r on the approach.

    Args:
        t: The run.
        speed: Approach speed [m/s].

    Returns:
        One row an acceleration.
    """
    steps = np.array([0.01 * speed, 0.01 * speed, 0.01 * t.unit[4]])
    nu = torch.tensor(np.vstack([np.zeros(3), np.diag(steps)]) + [speed, 0.0, 0.0])
    with torch.no_grad():
        a = t.rate(nu, torch.zeros(4, dtype=nu.dtype), torch.ones(4, dtype=nu.dtype)).numpy()
    return ((a[1:] - a[0]) / steps[:, None]).T
