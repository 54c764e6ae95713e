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
from studies.concealed_trial.rivals.package import FIRST_NOISE, ORDER, Hypothesis, Model, process_time, typical
from studies.concealed_trial.rivals.track import ROWS, SMOOTH, SmoothedTrack, track

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

    def __init__(self, dynamics: Model, runs: Sequence[Recording]) -> None:
        """Smooth the runs.

        Args:
            dynamics: Calm-water model.
            runs: The runs.
        """
        self.dynamics, self.tracks = dynamics, [track(dynamics, run) for run in runs]
        errors = [t.errors()[..., 0] for t in self.tracks]
        ends = list(accumulate((len(e) for e in errors), initial=0))
        self.parts = [slice(a, b) for a, b in zip(ends, ends[1:], strict=False)]
        self.errors = np.concatenate(errors)
        columns = np.concatenate([t.nuisances(dynamics) for t in self.tracks]).reshape(self.errors.size, -1)
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
    p, step, hop = dynamics.particulars, t.run.step, len(t.weight) // 2
    size = max(2 * round(SMOOTH * p.time_unit / step / 2) + 1, ORDER + 2)
    value = np.convolve(t.weight, savgol_coeffs(size, ORDER))
    slope = np.convolve(t.weight, savgol_coeffs(size, ORDER, deriv=1, delta=step))
    _, _, north, _, psi, r, log, shaft = FIRST_NOISE
    drift = float(np.hypot(north, p.speed * psi))
    through = np.abs(_jacobian(t, p.speed)) * [log, drift, r]
    slopes = [[log], [north, p.speed * psi], [r], [], [psi], []]
    values = [*through.tolist(), [log, north], [r], [shaft]]
    rough = np.append(ROUGH * typical(dynamics), [0.0, 0.0, 0.0])
    gap = np.arange(len(t.weight))
    total = np.zeros((count, len(ROWS), count, len(ROWS)))
    for row in range(len(ROWS)):
        lags = np.zeros(count)
        for lag in range(min(count, 12)):
            k = lag * hop
            for kernel, sizes in ((value, values[row]), (slope, slopes[row])):
                lags[lag] += np.square(sizes).sum() * (kernel[k:] @ kernel[: len(kernel) - k] if k < len(kernel) else 0)
            fading = np.exp(-np.abs(gap[:, None] - gap - k) * step / process_time(dynamics))
            lags[lag] += rough[row] ** 2 * (t.weight @ fading @ t.weight)
        total[:, row, :, row] = toeplitz(lags) / t.unit[row] ** 2
    return total.reshape(count * len(ROWS), -1)


def _jacobian(t: SmoothedTrack, speed: float) -> Float[np.ndarray, "3 3"]:
    """Derivative of the calm-water accelerations by u, v, r on the approach."""
    steps = np.array([0.01 * speed, 0.01 * speed, 0.01 * t.unit[4]])
    nu = torch.tensor(np.vstack([np.zeros(3), np.diag(steps)]) + [speed, 0.0, 0.0])
    with torch.no_grad():
        a = t.rate(nu, torch.zeros(4, dtype=nu.dtype), torch.ones(4, dtype=nu.dtype)).numpy()
    return ((a[1:] - a[0]) / steps[:, None]).T
