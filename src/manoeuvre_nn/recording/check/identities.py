"""What the channels of a recording must tell each other, and what a faulty sensor does to it.

The heading is the integral of the rate of turn; the track is the integral of the velocities, turned by the heading.
What is left over is regressed on what each simple fault (a delay, an offset, a scale, another reference point) would
leave.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.integrate import cumulative_trapezoid
from scipy.linalg import cholesky_banded, solve_banded
from scipy.optimize import minimize_scalar

from manoeuvre_nn.core.frames import body_to_earth
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.numerics.finite_algebra import lstsq
from manoeuvre_nn.recording.local_cubics import WINDOW, smoothed
from manoeuvre_nn.recording.outliers import robust_sd, trimmed_least_squares

BIN = 0.1
"""Length of the averages that are compared over L/U0: shorter ones tell no more, longer ones blur delays."""
EDGE = 0.2
"""Ends over L/U0 that are left out, so that delays up to that compare the same samples."""
MAX_RESIDUAL = 4.0
"""Averages that lie further off, over their usual size, are left out."""

Values = Mapping[str, float]
"""Fault -> its size [SI]; faults that are not named are absent."""
Series = Float[np.ndarray, " n"]
Noise = Sequence[tuple[float, float]]
"""Of each leftover: standard deviation, wild averages apart, and correlation with the neighbour."""


@dataclass(frozen=True)
class FaultEstimate:
    """A least-squares estimate of some faults.

    Attributes:
        values: Fault -> size [SI].
        errors: Fault -> standard error [SI].
        misfit: Weighted sum of squares that is left [-].
        spread: By how much errors exceed those of white noise, squared [-].
    """

    values: dict[str, float]
    errors: dict[str, float]
    misfit: float
    spread: float


class Identities:
    """The identities of one recording.

    Attributes:
        heading: Whether heading and rate of turn were both recorded.
        track: Whether track and velocities were both recorded.
    """

    def __init__(self, recording: Recording, ship: Particulars) -> None:
        """Smooth what the derivatives are taken of; the recording has no outliers."""
        derived = recording.derived
        self.heading, self.track = "r" not in derived, not derived & {"u", "v", "x", "y"}
        self.time, self.unit, self.ship = recording.time, ship.time_unit, ship
        names = ("u", "v", "r", "x", "y", "psi")
        self._raw = {k: recording[k] for k in names}
        window = WINDOW * ship.time_unit
        self._smooth = {k: smoothed(recording.time, recording[k], window)[0] for k in names}
        self._per_bin = max(round(BIN * ship.time_unit / float(np.median(np.diff(recording.time)))), 1)
        self._columns: dict[str, Float[np.ndarray, "s n"]] = {}

    def leftover(self, values: Values, smooth: bool = False) -> Float[np.ndarray, "s n"]:
        """What heading and track leave over once faults are taken out: averages, each less the one before.

        Returns:
            Of psi [rad], x and y [m], as far as they were recorded; NaN where a delay reaches out of the record.
        """
        time = self.time
        inside, c = _without_faults(time, self._smooth if smooth else self._raw, values)
        left = [c["psi"] - cumulative_trapezoid(c["r"], time, initial=0.0)] if self.heading else []
        if self.track:
            rates = body_to_earth(c["u"], c["v"], c["psi"])
            drift = (values.get("current north", 0.0), values.get("current east", 0.0))
            left += [
                c[k] - cumulative_trapezoid(rate + flow, time, initial=0.0)
                for k, rate, flow in zip("xy", rates, drift, strict=True)
            ]
        averaged = np.stack([_averaged(y, self._per_bin) for y in left])
        margin = EDGE * self.unit
        inside &= (time >= time[0] + margin) & (time <= time[-1] - margin)
        averaged[:, _averaged(np.cumsum(~inside, dtype=float), self._per_bin) > 0] = np.nan
        return averaged

    def slopes(self, names: Sequence[str]) -> Float[np.ndarray, "s n k"]:
        """What one unit of each fault adds to the leftover of a recording that has no other."""
        for name in names:
            if name not in self._columns:
                step = self._step(name)
                pair = [self.leftover({name: sign * step}, smooth=True) for sign in (-1, 1)]
                self._columns[name] = np.nan_to_num((pair[1] - pair[0]) / (2 * step))
        if not names:
            return np.zeros((*self.leftover({}).shape, 0))
        return np.stack([self._columns[name] for name in names], axis=-1)

    def estimate(
        self, names: Sequence[str], noise: Noise, start: Values | None = None, rounds: int = 4
    ) -> FaultEstimate:
        """Fit some faults at once by Gauss and Newton's method.

        Args:
            names: The faults.
            noise: Of the leftover.
            start: Where to start.
            rounds: Iterations.

        Returns:
            Values with standard errors that hold for correlated noise (Newey & West 1987).
        """
        values = {name: (start or {}).get(name, 0.0) for name in names}
        for _ in range(rounds if names else 1):
            y, x, lost = self._whitened(values, names, noise)
            flat = x.reshape(y.size, len(names)), y.ravel()
            step, covariance, kept = trimmed_least_squares(*flat, MAX_RESIDUAL, 1.0, ~lost.ravel())
            values = {n: self._bounded(n, values[n] - float(d)) for n, d in zip(names, step, strict=True)}
        rest = y - x @ step
        # Wild averages count as much as the wildest that is kept: stories can then be compared.
        misfit = float(np.minimum(rest**2, MAX_RESIDUAL**2)[~lost].sum())
        if not names:
            return FaultEstimate({}, {}, misfit, 1.0)
        kept = kept.reshape(y.shape)
        x, rest = x * kept[..., None], rest * kept
        robust = _correlated(x, rest, covariance)
        white, found = np.diag(covariance), np.diag(robust)
        errors = np.sqrt(np.maximum(white, found))
        used = white > 0
        spread = float(np.median(np.maximum(found, white)[used] / white[used])) if used.any() else 1.0
        return FaultEstimate(values, dict(zip(names, map(float, errors), strict=True)), misfit, spread)

    def noise(self, names: Sequence[str], values: Values | None = None) -> Noise:
        """Noise of the leftover, measured on what some faults together leave; what they are is known as far as said."""
        y, x = np.nan_to_num(self.leftover(values or {})), self.slopes(names)
        size = np.maximum(y.std(axis=1), 1e-12)
        fit = lstsq((x / size[:, None, None]).reshape(y.size, -1), (y / size[:, None]).ravel(), rcond=1e-8)
        rest = y - x @ fit
        groups = ([rest[:1]] if self.heading else []) + ([rest[-2:]] if self.track else [])
        models = [model for group in groups for model in [_noise_model(group)] * len(group)]
        scaled = []
        for part, (_, correlation) in zip(rest, models, strict=True):
            white = _whitened(part, correlation)
            scaled.append((max(robust_sd(white[white != 0]), 1e-12) if white.any() else 1e-12, correlation))
        return scaled

    def _whitened(
        self, values: Values, names: Sequence[str], noise: Noise
    ) -> tuple[Float[np.ndarray, "s n"], Float[np.ndarray, "s n k"], Bool[np.ndarray, "s n"]]:
        """Leftover and slopes over their noise, and which of them are lost."""
        y, x = self.leftover(values), self.slopes(names)
        lost = np.isnan(y)
        both = np.where(lost[..., None], 0.0, np.concatenate([y[..., None], x], axis=-1))
        white = np.stack([_whitened(part, rho) / sd for part, (sd, rho) in zip(both, noise, strict=True)])
        white *= ~lost[..., None]
        return white[..., 0], white[..., 1:], lost

    def _step(self, name: str) -> float:
        """Step of the numerical derivative by a fault."""
        speed, length = 0.005 * self.ship.speed, self.ship.length
        steps = {"delay": 0.02 * self.unit, "scale": 0.005, "point": 0.01 * length, "current": speed, "offset": speed}
        return {"offset of psi": 0.002, "offset of r": 0.005 / self.unit}.get(name, steps[name.split()[0]])

    def _bounded(self, name: str, value: float) -> float:
        """No step out of the range in which the linearization means something."""
        limit = {"delay": self.unit, "scale": 0.5, "point": 3 * self.ship.length}.get(name.split()[0], np.inf)
        return float(np.clip(value, -limit, limit))


def _without_faults(
    time: Series, c: Mapping[str, Series], values: Values
) -> tuple[Bool[np.ndarray, " n"], dict[str, Series]]:
    """Channels as they would be without faults: ``c = scale (written(t + delay) - offset)``, positions at the point."""
    late = {k: values.get(f"delay of {_of(k)}", 0.0) for k in c}
    first, last = min(*late.values(), 0.0), max(*late.values(), 0.0)
    inside = (time + first >= time[0] - 1e-9) & (time + last <= time[-1] + 1e-9)
    good = {}
    for name, written in c.items():
        there = np.interp(time + late[name], time, written) if late[name] else written
        scale = 1.0 + values.get(f"scale of {name}", 0.0)
        good[name] = scale * (there - values.get(f"offset of {name}", 0.0))
    ahead, abeam = values.get("point of x, y", 0.0), values.get("point of x, y abeam", 0.0)
    north, east = body_to_earth(np.full(len(time), ahead), np.full(len(time), abeam), good["psi"])
    return inside, {**good, "x": good["x"] - north, "y": good["y"] - east}


def _of(channel: str) -> str:
    """The sensor that a channel comes from, as delays name it."""
    return {"u": "u, v", "v": "u, v", "x": "x, y", "y": "x, y"}.get(channel, channel)


def _averaged(values: Series, count: int) -> Float[np.ndarray, " k"]:
    """Averages over so many samples, each less the one before."""
    whole = len(values) // count * count
    return np.diff(values[:whole].reshape(-1, count).mean(axis=1))


def _correlated(x: Float[np.ndarray, "s n k"], rest: Float[np.ndarray, "s n"], white: np.ndarray) -> np.ndarray:
    """Covariance of the solution for noise that is correlated over a few averages and between the leftovers."""
    score = (x * rest[..., None]).sum(axis=0)
    count = len(score)
    reach = min(round(1.5 * count ** (1 / 3)), count // 3)
    meat = score.T @ score
    for lag in range(1, reach + 1):
        part = score[lag:].T @ score[:-lag]
        meat += (1 - lag / (reach + 1)) * (part + part.T)
    freedom = max(rest.size - x.shape[-1], 1)
    bread = white / max(float((rest**2).sum()) / freedom, 1e-300)
    return bread @ meat @ bread * (count / max(count - x.shape[-1], 1))


def _noise_model(parts: Float[np.ndarray, "s n"]) -> tuple[float, float]:
    """Deviation and neighbours' correlation of a moving average of order one, by maximum likelihood."""
    if float(np.abs(parts).max()) < 1e-15:
        return 1e-12, 0.0
    limits = [MAX_RESIDUAL * max(robust_sd(p), 1e-15) for p in parts]
    centre = [np.clip(p, -limit, limit) for p, limit in zip(parts, limits, strict=True)]

    def cost(correlation: float) -> float:
        total = sum(float((_whitened(p, correlation) ** 2).sum()) for p in centre)
        logs = sum(2 * float(np.log(_factor(len(p), correlation)[0]).sum()) for p in centre)
        return parts.size * np.log(total / parts.size) + logs

    best = float(minimize_scalar(cost, bounds=(-0.4995, 0.4995), method="bounded").x)
    squares = [(_whitened(p, best) ** 2).mean() for p in centre]
    return float(np.sqrt(np.mean(squares))), best


def _factor(count: int, correlation: float) -> Float[np.ndarray, "2 n"]:
    """Lower Cholesky factor of a tridiagonal correlation matrix, banded."""
    band = np.vstack([np.ones(count), np.full(count, correlation)])
    return cholesky_banded(band, lower=True)


def _whitened(values: Float[np.ndarray, "n *k"], correlation: float) -> Float[np.ndarray, "n *k"]:
    """Values freed of their neighbours' correlation."""
    return solve_banded((1, 0), _factor(len(values), correlation), values)
