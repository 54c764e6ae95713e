"""What the calm-water equations leave over on a smoothed track: equation errors and kinematic misfits, averaged in time.

Every channel is smoothed by local cubics, which also give its slope; the calm-water accelerations at the smoothed
velocities are taken off the slopes. Beside these three equation errors stand four misfits that need no model: velocity
over ground along the heading less the log, rate of the heading less the rate gyro, rate of the position less the
velocity over ground. All seven are averaged over windows as long as the ship needs to sail its length, which is the weak
form of the same equations: the accelerations are then differences of averaged velocities.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Float
from scipy.ndimage import median_filter
from scipy.signal import lfilter

from manoeuvre_nn.core.effect import Effect, Situation
from manoeuvre_nn.diagnosis.columns import contribution, situation
from manoeuvre_nn.diagnosis.linear import Columns, Linearised, Rate, calm_rate, linearise
from manoeuvre_nn.diagnosis.runs import CHANNELS, Run
from manoeuvre_nn.dynamics.base import Dynamics
from manoeuvre_nn.effect.propulsion import PowerLimit
from manoeuvre_nn.recording.accelerations import smoothed

ROWS = ("X", "Y", "N", "log", "gyro", "shaft")
"""Equation errors of surge, sway and yaw; speed over ground less log; heading rate less gyro; shaft less nominal."""
import os

SMOOTH, AVERAGE = 0.4, float(os.environ.get("AVG", "2"))
"""Windows of the local cubics and of the averages over L/U0."""
LATENCY = 0.25
"""Delay of the satellite receiver before anything is known of it [s]."""
SHAFT = CHANNELS.index("n")
"""Channel of the shaft speed."""
SPIKE = 6.0
"""Samples further from the median of their neighbours than this many standard deviations are replaced by it."""


@dataclass(frozen=True)
class Smooth:
    """A run on its smoothed track.

    Attributes:
        line: The run about that track, as the effects' contributions ask for it.
        situation: What effects see along it.
        channels: Smoothed x, y, vn, ve, psi, r, u_log, n.
        slopes: Their rates.
        rate: Calm-water accelerations.
        unit: Sizes that make the rows comparable: U0^2/L, U0^2/L, (U0/L)^2, U0, U0/L, 1.
        window: Samples of an average.
    """

    line: Linearised
    situation: Situation
    channels: Float[np.ndarray, "n 8"]
    slopes: Float[np.ndarray, "n 8"]
    rate: Rate
    unit: Float[np.ndarray, " 6"]
    window: int

    @property
    def run(self) -> Run:
        """The run."""
        return self.line.run

    @cached_property
    def times(self) -> Float[np.ndarray, " b"]:
        """Middle of every average [s]."""
        return self.averaged(self.run.time[:, None])[:, 0]

    @cached_property
    def weights(self) -> Float[np.ndarray, "b n"]:
        """Weight of every sample in every average."""
        return self.averaged(np.eye(len(self.run)))

    def averaged(self, rows: Float[np.ndarray, "n *k"], window: int | None = None) -> Float[np.ndarray, "b *k"]:
        """Averages over windows that overlap by half, under a Hann window.

        Args:
            rows: Samples over time.
            window: Samples of an average; None takes the run's own.

        Returns:
            One row an average.
        """
        size = window or self.window
        weight = np.hanning(size + 2)[1:-1]
        view = np.lib.stride_tricks.sliding_window_view(rows, size, axis=0)[:: size // 2]
        return view @ (weight / weight.sum())

    def errors(
        self, added: Float[np.ndarray, "n 8 k"] | None = None, pushed: Float[np.ndarray, "n 3 k"] | None = None
    ) -> Float[np.ndarray, "k n 6"]:
        """Equation errors and misfits at every sample, what hypotheses add being taken off.

        Args:
            added: What they add to the measured channels, one column a hypothesis.
            pushed: What they add to the accelerations.

        Returns:
            Errors in their units; zero without noise for a hypothesis that is right.
        """
        count = 1 if added is None else added.shape[-1]
        c = np.repeat(self.channels[None], count, axis=0)
        d = np.repeat(self.slopes[None], count, axis=0)
        if added is not None and np.any(added):
            off = added.transpose(2, 0, 1)
            c, d = c - off, d - np.gradient(off, self.run.step, axis=1)
        vn, ve, psi, r, log, shaft = c.transpose(2, 0, 1)[2:]
        cos, sin = np.cos(psi), np.sin(psi)
        ground, across = vn * cos + ve * sin, ve * cos - vn * sin
        slope = d[..., 3] * cos - d[..., 2] * sin - ground * d[..., 4]
        nu = np.stack([log, across, r], axis=-1)
        with torch.no_grad():
            calm = self.rate(torch.tensor(nu), self.situation.delta, self.situation.shaft).numpy()
        force = np.stack([d[..., 6], slope, d[..., 5]], axis=-1) - calm
        if pushed is not None:
            force = force - pushed.transpose(2, 0, 1)
        rest = np.stack([ground - log, d[..., 4] - r, shaft - 1], axis=-1)
        return np.concatenate([force, rest], axis=-1) / self.unit

    def contribution(self, effect: Effect, values: Float[np.ndarray, "k p"]) -> tuple[np.ndarray, np.ndarray]:
        """What an effect adds to channels and accelerations along the track.

        Args:
            effect: The effect.
            values: Parameter values, one set a row.

        Returns:
            Added to the channels (n, 8, k) and to the accelerations (n, 3, k).
        """
        c = contribution(effect, values, self.line, self.rate, self.situation)
        if isinstance(effect, PowerLimit):
            c.measured[:, SHAFT] = self._lost(effect, values)
        return c.measured, self.pushed(c)

    def _lost(self, effect: PowerLimit, values: Float[np.ndarray, "k p"]) -> Float[np.ndarray, "n k"]:
        """Shaft speed that an engine at its limit loses, with its lag [-]."""
        slope, lag = ([p.name for p in effect.declared].index(name) for name in ("rpm_slope", "lag_s"))
        want = 1 - self.line.track[:, 0] / effect.ship.particulars.speed
        keep = np.exp(-self.run.step / values[:, lag])
        filtered = [lfilter([1 - a], [1, -a], want, zi=[a * want[0]])[0] for a in keep]
        return -values[:, slope] * np.stack(filtered, axis=-1)

    def pushed(self, c: Columns) -> Float[np.ndarray, "n 3 k"]:
        """Accelerations at the samples of what moves a state within the steps between them.

        Args:
            c: Columns of the run.

        Returns:
            In m/s^2, m/s^2, rad/s^2.
        """
        push = c.moved[:, :3] / self.run.step
        return np.concatenate([push[:1], 0.5 * (push[1:] + push[:-1]), push[-1:]])


def smooth(dynamics: Dynamics, run: Run) -> Smooth:
    """Smooth a run and evaluate the calm-water equations on it.

    Args:
        dynamics: Calm-water model.
        run: The run.

    Returns:
        The run on its track.
    """
    p, rate = dynamics.particulars, calm_rate(dynamics)
    # The model runs at its nominal shaft speed, so that a shaft that does not is a misfit like any other.
    run = replace(run, shaft=np.ones(len(run)))
    pairs = [smoothed(run.time, _filled(run.measured[:, k]), SMOOTH * p.time_unit) for k in range(8)]
    channels, slopes = (np.stack(part, axis=-1) for part in zip(*pairs, strict=True))
    # Satellite channels are late: taken forward by their usual delay.
    channels[:, :4] += LATENCY * slopes[:, :4]
    slopes[:, :4] += LATENCY * np.gradient(slopes[:, :4], run.step, axis=0)
    x, y, vn, ve, psi, r, log, _ = channels.T
    track = np.stack([log, ve * np.cos(psi) - vn * np.sin(psi), r, x, y, psi], axis=-1)
    line = linearise(run, rate, track, p.time_unit)
    turn = p.speed / p.length
    unit = np.array([p.speed * turn, p.speed * turn, turn**2, p.speed, turn, 1.0])
    window = max(4, 2 * round(0.5 * AVERAGE * p.time_unit / run.step))
    return Smooth(line, situation(line, rate), channels, slopes, rate, unit, window)


def _filled(values: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Gaps filled in a straight line, single samples far off their neighbours replaced by the median."""
    good = np.isfinite(values)
    at = np.arange(len(values))
    filled = np.interp(at, at[good], values[good]) if good.any() else np.ones(len(values))
    off = filled - median_filter(filled, 7, mode="nearest")
    spread = 1.4826 * np.median(np.abs(off)) + 1e-9
    good = good & (np.abs(off) <= SPIKE * spread)
    return np.interp(at, at[good], filled[good]) if good.any() else filled
