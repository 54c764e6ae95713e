"""Linear regression of Taylor terms on smoothed derivatives: ridge, robust, its strength chosen by held-out runs."""

from dataclasses import dataclass, replace

import numpy as np
from esso_osaka_data import ClosedLoop, mirrored, relative, smooth
from jaxtyping import Float

from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.recording import Recording

RIDGES = (1e-5, 1e-4, 1e-3, 1e-2, 1e-1)
"""Ridge over the number of samples, columns scaled to a mean square of 1."""
HUBER = 1.5
"""Residuals beyond this many robust standard deviations count less: the positions that u, v come from jump at times."""
SHAFT = 0.084
"""Propeller diameter [m]: makes the shaft speed a speed."""
EQUATIONS = ("udot", "vdot", "rdot")

Matrix = Float[np.ndarray, "n k"]


@dataclass(frozen=True)
class TaylorRegression:
    """Third-order terms in v, r and the rudder, forces in u^2, u n and n^2, as accelerations of each equation.

    Attributes:
        hull: ``cubic``: v^3/U and its kin (Abkowitz made non-dimensional by the speed of the moment); ``modulus``:
            v|v| and its kin.
        slowest: Samples with u below are left out [m/s].
        ahead_only: Whether samples with a shaft at rest are left out as well as those with one astern.
        symmetric: Whether port and starboard are alike: every run counts mirrored too, and there are no offsets.
        window: Window of the smoother over L/U0.
        step: Time between samples [s].
        least: Least speed U in the cubic terms [m/s].
    """

    hull: str = "cubic"
    slowest: float = 0.05
    ahead_only: bool = True
    symmetric: bool = False
    window: float = 1.6
    step: float = 0.5
    least: float = 0.05

    def fit(self, recordings: list[Recording], ship: Particulars, wind: bool) -> ClosedLoop:
        """Regress the smoothed accelerations.

        Args:
            recordings: Training runs.
            ship: The ship; its L/U0 sets the smoother.
            wind: Whether the terms of the wind are taken too.

        Returns:
            The model.
        """
        unit = ship.time_unit * self.window / 0.8
        runs = [smooth(replace(r, meta={**r.meta, "time_unit": unit}), self.step) for r in recordings]
        if self.symmetric:
            runs += [mirrored(r) for r in runs]
        parts = [self._data(run, wind) for run in runs]
        weights = [robust_ridge([(c[i], y[:, i]) for c, y in parts]) for i in range(3)]

        def rate(nu: np.ndarray, helm: np.ndarray) -> np.ndarray:
            columns = self.columns(nu[None], helm[None], wind)
            return np.array([(c @ w)[0] for c, w in zip(columns, weights, strict=True)])

        return ClosedLoop(rate, wind)

    def _data(self, run: Recording, wind: bool) -> tuple[tuple[Matrix, ...], Matrix]:
        """Columns of the three equations and the accelerations of one run, samples that do not count left out."""
        ahead, across = relative(*run.stacked("psi", "u", "v", "wind_north", "wind_east").T)
        helm = np.stack([run["delta"], run["n"], ahead, across], axis=1)
        kept = (run["u"] > self.slowest) & ((run["n"] > 0) if self.ahead_only else (run["n"] >= 0))
        nu, y = run.stacked("u", "v", "r"), run.stacked(*EQUATIONS)
        return self.columns(nu[kept], helm[kept], wind), y[kept]

    def columns(self, nu: Matrix, helm: Matrix, wind: bool) -> tuple[Matrix, Matrix, Matrix]:
        """Terms of surge, sway and yaw.

        Args:
            nu: u, v [m/s], r [rad/s].
            helm: Rudder [rad], shaft [1/s], relative wind from ahead and from starboard [m/s].
            wind: Whether the terms of the wind are taken too.

        Returns:
            Columns [m^2/s^2] of the three equations.
        """
        u, v, r = nu[:, 0], nu[:, 1], 3.0 * nu[:, 2]
        d, n, ahead, across = helm[:, 0], SHAFT * helm[:, 1], helm[:, 2], helm[:, 3]
        speed = np.maximum(np.hypot(u, v), self.least)
        thrust = [u * np.abs(u), u * n, n * np.abs(n)]
        surge = [*thrust, v * v, r * r, v * r, *(d * d * f for f in thrust), v * d * n, r * d * n]
        if self.hull == "cubic":
            surge += [v * v * n / speed, v * r * n / speed, r * r * n / speed]
        linear = [u * v, u * r, n * v, n * r]
        if self.hull == "cubic":
            bent = [v**3 / speed, v * v * r / speed, v * r * r / speed, r**3 / speed]
        else:
            bent = [v * np.abs(v), np.abs(v) * r, v * np.abs(r), r * np.abs(r)]
        rudder = [*(d * f for f in thrust), d**3 * thrust[1], d**3 * thrust[2], v * d * d * n, r * d * d * n]
        rudder += [v * v * d * n / speed, r * r * d * n / speed, v * r * d * n / speed]
        side = [*linear, *bent, *rudder] + ([] if self.symmetric else [u * u, n * n])
        if wind:
            air = np.hypot(ahead, across)
            surge += [air * ahead, air * air]
            side += [air * across, ahead * across]
        return np.stack(surge, 1), np.stack(side, 1), np.stack(side, 1)


def robust_ridge(runs: list[tuple[Matrix, np.ndarray]]) -> np.ndarray:
    """Weights by ridge regression with Huber's weights; the ridge is chosen by runs left out, five groups of them.

    Args:
        runs: Columns and target of every run.

    Returns:
        One weight a column.
    """
    groups = [[r for i, r in enumerate(runs) if i % 5 == k] for k in range(5)]
    losses = []
    for ridge in RIDGES:
        loss = []
        for k, held in enumerate(groups):
            weights = _solve([r for j, g in enumerate(groups) if j != k for r in g], ridge)
            loss += [np.abs(y - c @ weights) for c, y in held]
        losses.append(np.concatenate(loss).mean())
    return _solve(runs, RIDGES[int(np.argmin(losses))])


def _solve(runs: list[tuple[Matrix, np.ndarray]], ridge: float) -> np.ndarray:
    """Ridge regression with Huber's weights."""
    columns, y = np.concatenate([c for c, _ in runs]), np.concatenate([t for _, t in runs])
    scale = np.sqrt(np.mean(columns**2, axis=0)) + 1e-12
    columns = columns / scale
    settings, weights = np.ones(len(y)), np.zeros(columns.shape[1])
    for _ in range(8):
        gram = columns.T @ (settings[:, None] * columns) + ridge * len(y) * np.eye(len(weights))
        weights = np.linalg.solve(gram, columns.T @ (settings * y))
        error = np.abs(y - columns @ weights)
        settings = np.minimum(1.0, HUBER * 1.4826 * np.median(error) / np.maximum(error, 1e-12))
    return weights / scale
