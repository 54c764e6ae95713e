"""Marginal likelihood along a reference track: states, coefficients, missing term and coloured force integrated out.

Between reference and truth all is linear: ``dx' = F dx + B w + G p + d`` and ``e = H dx + l q + noise``, with w the
coloured force (first-order Markov), p the errors of the coefficients and the missing terms, q that of the latency; d
and e are what a hypothesis leaves unexplained (:meth:`studies.concealed_trial.observer_track.Track.residuals`).
Covariances do not depend on them: one Kalman filter gives gains that whiten any number of hypotheses at once.
"""

from dataclasses import dataclass
from functools import partial
from math import sqrt

import numpy as np

from studies.concealed_trial.condition import Tables
from studies.concealed_trial.drawing import CUBIC
from studies.concealed_trial.forces import Moment
from studies.concealed_trial.model_error import TYPICAL, cubic
from studies.concealed_trial.observer_track import Track, change, shown
from studies.concealed_trial.truth import ConcealedEffect

COEFFICIENT_SD, CORRELATION = 0.045, 0.6
"""Scatter of the coefficients, and the correlation of one term's in Y and N, as the referee draws them."""
CUBIC_SD, FORCE, TAU = 0.05, 0.02, 30.0
"""Size of the missing term, of the coloured force, and its correlation time [s]."""
LATENCY_SD = sqrt(1 / 48)
"""Of a latency between 0 and 0.5 s."""
STEPS = np.array([1.0, 1.0, 1e-3, 0.01, 0.01, 1e-4])
"""Changes of x, y [m], psi [rad], u, v [m/s], r [rad/s] for the slopes."""
START_SD = np.array([5.0, 5.0, 0.05, 0.5, 0.5, 0.005])
"""Of the reference at the start of a segment."""
UNSEEN = 1e6
"""Noise that stands for a channel that was not recorded, over its own."""


@dataclass(frozen=True)
class RandomForce:
    """A random force beside that of every case.

    Attributes:
        direction: X, Y [N], N [N m] at size 1, one column a second.
        sd: Its standard deviation.
        tau: Correlation time [s].
    """

    direction: np.ndarray
    sd: float
    tau: float


@dataclass(frozen=True)
class LinearModel:
    """The linear model between reference and truth, one entry a second.

    Attributes:
        state: F, (columns, 6, 6).
        force: B for X, Y [N], N [N m], (columns, 6, 3).
        model: G for coefficients and missing terms, (columns, 6, parameters).
        shown: H, (columns, 8, 6).
        latency: l, (columns, 8).
        spread: Prior covariance of p and q.
    """

    state: np.ndarray
    force: np.ndarray
    model: np.ndarray
    shown: np.ndarray
    latency: np.ndarray
    spread: np.ndarray


def slopes(track: Track, effects: list[ConcealedEffect], nuisance: float = 1.0) -> LinearModel:
    """Linearise about the reference.

    Args:
        track: The track.
        effects: What is held to act.
        nuisance: Size of what is wrong with the model in every case.

    Returns:
        The linear model.
    """
    truth, count = track.truth(effects), len(track.t)
    base, _ = track.residuals(truth)
    n = np.full(count, track.ship.rpm)
    now = shown(truth, track.reference, track.t, n)
    state, output = [], []
    for row, size in enumerate(STEPS):
        moved = track.reference.copy()
        moved[row] += size
        state.append((track.residuals(truth, moved)[0] - base) / size)
        output.append((shown(truth, moved, track.t, n) - now).T / size)
    force = []
    for row, size in enumerate(track.ship.force_unit * np.array([1e-3, 1e-3, 1e-3 * track.ship.length])):
        pushed = track.truth(effects)
        column = np.zeros((3, 1))
        column[row] = size
        pushed.forces.append(partial(_constant, column))
        force.append((track.residuals(pushed)[0] - base) / size)
    model, spread = _model_slopes(track, effects, base, nuisance)
    velocity = now[3:5]
    latency = np.zeros((8, count))
    latency[:2], latency[3:5] = -velocity, -change(velocity, track.t)
    keep = ~track.ends[:, None, None]
    by_state, by_force, by_model = (np.stack(part, axis=-1) * keep for part in (state, force, model))
    return LinearModel(by_state, by_force, by_model, np.stack(output, axis=-1), latency.T, spread)


def _constant(column: np.ndarray, now: Moment) -> np.ndarray:
    """A force that is the same at any moment."""
    return column


def _model_slopes(
    track: Track, effects: list[ConcealedEffect], base: np.ndarray, nuisance: float
) -> tuple[list[np.ndarray], np.ndarray]:
    """Slopes by the coefficients and the terms that may be missing, and the prior covariance with the latency's."""
    nominal = Tables.of(track.ship)
    names = [c for c in nominal.k if c[0] in "XYN" and not c.endswith("z") and nominal.k[c]]
    found, share = [], 0.01
    for name in names:
        tables = Tables.of(track.ship)
        tables.scale([name], 1 + share)
        found.append((track.residuals(track.truth(effects, tables=tables))[0] - base) / share)
    for term in CUBIC:
        truth = track.truth(effects)
        truth.forces.append(cubic(track.ship, term, 1.0))
        found.append(track.residuals(truth)[0] - base)
    same = np.array([[a[1:] == b[1:] and "X" not in a[0] + b[0] for b in names] for a in names])
    scatter = np.where(same, CORRELATION, 0.0) + np.diag([1 - CORRELATION * (c[0] != "X") for c in names])
    spread = np.zeros((len(found) + 1,) * 2)
    spread[: len(names), : len(names)] = (COEFFICIENT_SD * nuisance) ** 2 * scatter
    terms = range(len(names), len(found))
    spread[terms, terms] = (CUBIC_SD * nuisance) ** 2 / len(CUBIC)  # one of them is missing, nobody knows which
    spread[-1, -1] = LATENCY_SD**2
    return found, spread + 1e-12 * np.eye(len(spread))


class Whitening:
    """A Kalman filter's gains along a track.

    Attributes:
        log_determinant: Sum of log determinants of the innovations' covariances.
    """

    def __init__(
        self, track: Track, linear: LinearModel, nuisance: float = 1.0, more: RandomForce | None = None
    ) -> None:
        """Run the covariances.

        Args:
            track: The track.
            linear: Its linear model.
            nuisance: Size of the coloured force over that of every case.
            more: A random force beside it.
        """
        unit = track.ship.force_unit * np.array([TYPICAL["X"], TYPICAL["Y"], TYPICAL["N"] * track.ship.length])
        sds, taus, forces = FORCE * nuisance * unit, [TAU] * 3, linear.force
        if more is not None:
            along = np.einsum("kif,fk->ki", linear.force, np.broadcast_to(more.direction, (3, len(track.t))))
            forces = np.concatenate([forces, along[..., None]], axis=2)
            sds, taus = np.append(sds, more.sd), [*taus, more.tau]
        self.decay = np.exp(-1 / np.array(taus))
        self.noise = (1 - self.decay**2) * sds**2
        self.ends, own = track.ends, 6 + len(sds)
        size = own + len(linear.spread)
        still = np.zeros((len(track.t), 6, 1))  # the latency moves nothing
        into = np.concatenate([linear.state, forces, linear.model, still], axis=2)
        seen = np.zeros((len(track.t), 8, size))
        seen[:, :, :6], seen[:, :, -1] = linear.shown, linear.latency
        known = np.isfinite(track.measured).T
        covariance = np.zeros((size, size))
        covariance[own:, own:] = linear.spread
        self.own, roots, gains = own, np.zeros((len(into), 8, 8)), np.empty((len(into), size, 8))
        self.log_determinant, fresh = 0.0, True
        for k, step in enumerate(into):
            if fresh:
                covariance[:own], covariance[:, :own] = 0.0, 0.0
                covariance[range(own), range(own)] = [*START_SD**2, *np.zeros(own - 6)]
            noise = track.sd**2 * np.where(known[k], 1.0, UNSEEN)
            cross = covariance @ seen[k].T
            root = np.linalg.cholesky(seen[k] @ cross + np.diag(noise))
            inverse = np.linalg.inv(root)
            half = inverse @ cross.T
            covariance = covariance - half.T @ half
            gains[k], roots[k] = half.T @ inverse, inverse * known[k][:, None]
            self.log_determinant += 2 * float(np.log(np.diag(root))[known[k]].sum())
            covariance = self._predicted(covariance, step)
            fresh = bool(track.ends[k])
        self.by_state = np.concatenate([-roots @ seen, self._later(into, np.eye(size) - gains @ seen)], axis=1)
        self.by_measured = np.concatenate([roots, self._later(into, gains)], axis=1)

    def _later(self, into: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Estimates a second later, of all columns; a segment begins with what is the same in all."""
        own = self.own
        moved = rows.copy()
        moved[:, :6] = into @ rows
        moved[:, 6:own] *= self.decay[:, None]
        moved[self.ends, :own] = 0.0
        return moved

    def _predicted(self, covariance: np.ndarray, step: np.ndarray) -> np.ndarray:
        """Covariance a second later."""
        own = self.own
        moved = covariance.copy()
        moved[:6] = step @ covariance
        moved[6:own] *= self.decay[:, None]
        after = moved.copy()
        after[:, :6] = moved @ step.T
        after[:, 6:own] = moved[:, 6:own] * self.decay
        after[range(6, own), range(6, own)] += self.noise
        return after

    def whiten(self, process: np.ndarray, measured: np.ndarray) -> np.ndarray:
        """Standardised innovations of any number of hypotheses.

        Args:
            process: d, (columns, 6, hypotheses).
            measured: e, (columns, 8, hypotheses).

        Returns:
            (columns times 8, hypotheses).
        """
        found = self.by_measured @ measured
        found[~self.ends, 8:14] += process[~self.ends]
        for k in range(1, len(found)):
            found[k] += self.by_state[k] @ found[k - 1, 8:]
        return found[:, :8].reshape(-1, process.shape[2])
