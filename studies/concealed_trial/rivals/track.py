"""What the calm-water equations leave over on a smoothed track: three equation errors and three kinematic misfits.

Local cubics (Savitzky & Golay 1964) smooth the channels and give their slopes, from which the calm-water accelerations
at the smoothed velocities are taken. Three misfits need no model: speed over ground along the heading less the log,
rate of the heading less the gyro, shaft speed less the nominal. All are averaged while the ship sails two lengths.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Float
from scipy.signal import savgol_filter

from manoeuvre_nn.core.channels import MEASURED
from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.recording import Recording
from studies.concealed_trial.rivals.package import (
    FIRST_NOISE,
    ORDER,
    Columns,
    Corrections,
    LinearisedRun,
    Model,
    Rate,
    coefficient_columns,
    contribution,
    linearise,
    measured,
)

ROWS = ("X", "Y", "N", "log", "gyro", "shaft")
"""Equation errors of surge, sway, yaw; speed over ground less log; rate of heading less gyro; shaft less nominal."""
SMOOTH, AVERAGE = 0.4, 2.0
"""Windows of the local cubics and of the averages over L/U0."""
LATENCY = 0.25
"""Usual delay of a satellite receiver [s]."""
MOST = 200
"""Contributions that a run keeps in mind."""
SPIKE, NEIGHBOURS = 6.0, 3
"""Samples further from their neighbours' lines than this many standard deviations are left out; neighbours a side."""


@dataclass(frozen=True)
class SmoothedTrack:
    """A run on its smoothed track.

    Attributes:
        run: The run.
        states: u, v, r, x, y, psi along it.
        channels: Smoothed channels in the order of ``MEASURED``.
        slopes: Their rates.
        rate: Calm-water accelerations.
        unit: What makes the rows comparable: U0^2/L, U0^2/L, (U0/L)^2, U0, U0/L, 1.
        weight: Of the samples of an average; the next average begins half a window later.
        known: Contributions that were asked for.
    """

    run: Recording
    states: Float[np.ndarray, "n 6"]
    channels: Float[np.ndarray, "n 8"]
    slopes: Float[np.ndarray, "n 8"]
    rate: Rate
    unit: Float[np.ndarray, " 6"]
    weight: Float[np.ndarray, " w"]
    known: dict[tuple[str, bytes], tuple[np.ndarray, np.ndarray]] = field(default_factory=dict, repr=False)

    @cached_property
    def line(self) -> LinearisedRun:
        """The run about the track, as contributions of effects ask for it."""
        return linearise(self.run, self.rate, self.states)

    def averaged(self, rows: Float[np.ndarray, "n *k"]) -> Float[np.ndarray, "b *k"]:
        """Averages over time.

        Args:
            rows: Samples.

        Returns:
            One row an average.
        """
        view = np.lib.stride_tricks.sliding_window_view(rows, len(self.weight), axis=0)
        return view[:: len(self.weight) // 2] @ self.weight

    def errors(
        self, added: Float[np.ndarray, "n 8 k"] | None = None, pushed: Float[np.ndarray, "n 3 k"] | None = None
    ) -> Float[np.ndarray, "b 6 k"]:
        """Averaged errors in units of ``unit``, what hypotheses add being taken off.

        Args:
            added: What they add to the channels, one column a hypothesis.
            pushed: What they add to the accelerations.

        Returns:
            Errors; noise alone for a hypothesis that is right.
        """
        c, d = self.channels[None], self.slopes[None]
        if added is not None and added.any():
            off = added.transpose(2, 0, 1)
            c, d = c - off, d - np.gradient(off, self.run.step, axis=1)
        vn, ve, psi, r, log, shaft = c.transpose(2, 0, 1)[2:]
        cos, sin = np.cos(psi), np.sin(psi)
        ground, across = vn * cos + ve * sin, ve * cos - vn * sin
        sway = d[..., 3] * cos - d[..., 2] * sin - ground * d[..., 4]
        with torch.no_grad():
            nu = torch.tensor(np.stack([log, across, r], axis=-1))
            calm = self.rate(nu, torch.tensor(self.run["delta"]), torch.tensor(self.run["shaft"])).numpy()
        force = np.stack([d[..., 6], sway, d[..., 5]], axis=-1) - calm
        if pushed is not None:
            force = force - pushed.transpose(2, 0, 1)
        rest = np.stack([ground - log, d[..., 4] - r, shaft - 1], axis=-1)
        rest = np.broadcast_to(rest, force.shape)
        return self.averaged((np.concatenate([force, rest], axis=-1) / self.unit).transpose(1, 2, 0))

    def contribution(self, effect: Effect, values: Float[np.ndarray, "k p"]) -> tuple[np.ndarray, np.ndarray]:
        """What an effect adds along the track.

        Args:
            effect: The effect.
            values: Parameter values, one set a row.

        Returns:
            Added to the channels (n, 8, k) and to the accelerations (n, 3, k).
        """
        keys = [(effect.name, row.tobytes()) for row in values]
        if len(self.known) > MOST:
            self.known.clear()
        new = {key: row for key, row in zip(keys, values, strict=True) if key not in self.known}
        if new:
            columns = contribution(effect, np.stack(list(new.values())), self.line)
            pushed = self._pushed(columns)
            self.known.update({key: (columns.measured[..., k], pushed[..., k]) for k, key in enumerate(new)})
        found = [self.known[key] for key in keys]
        return np.stack([a for a, _ in found], axis=-1), np.stack([p for _, p in found], axis=-1)

    def nuisances(self, corrections: Corrections, at_samples: bool = False) -> Float[np.ndarray, "b 6 m"]:
        """What is uncertain under every hypothesis, as columns of the errors.

        Args:
            corrections: Of the calm-water model.
            at_samples: Whether corrections are taken at the samples instead of within the steps between them, which is
                quicker.

        Returns:
            A second more of the receiver's delay, then every correction of the model by 100 %.
        """
        added = np.zeros((len(self.run), len(MEASURED), 1))
        added[:, :4, 0] = -0.1 * self.slopes[:, :4]
        late = (self.errors() - self.errors(added)) / 0.1
        if at_samples:
            with torch.no_grad():
                moving = torch.tensor(self.states[:, :3])
                push = corrections(moving, torch.tensor(self.run["delta"])).numpy().transpose(0, 2, 1)
        else:
            push = self._pushed(coefficient_columns(corrections.dynamics, self.line))
        push = push / self.unit[:3, None]
        return np.concatenate([late, self.averaged(np.concatenate([push, 0 * push], axis=1))], axis=-1)

    def _pushed(self, columns: Columns) -> Float[np.ndarray, "n 3 k"]:
        """Accelerations at the samples of what moves a state within the steps between them."""
        push = columns.moved[:, :3] / self.run.step
        return np.concatenate([push[:1], 0.5 * (push[1:] + push[:-1]), push[-1:]])


def track(dynamics: Model, run: Recording) -> SmoothedTrack:
    """Smooth a run and make it ready for the equations.

    Args:
        dynamics: Calm-water model.
        run: The run.

    Returns:
        The run on its track.

    Raises:
        InputError: If a channel was not recorded.
    """
    p, rate = dynamics.particulars, Rate(dynamics)
    recorded = measured(run)
    missing = [c for c, column in zip(MEASURED[:-1], recorded.T, strict=False) if not np.isfinite(column).any()]
    if missing:
        raise InputError(
            f"{run.name} has no {', '.join(missing)}: the rival methods need all channels, diagnose.py does not"
        )
    run = run.with_channels(
        shaft=np.ones(len(run))
    )  # a shaft that is not at its nominal speed is a misfit like any other
    filled = np.stack([_filled(c, sd) for c, sd in zip(recorded.T, FIRST_NOISE, strict=True)], axis=-1)
    size = smoother_size(p.time_unit, run.step)
    channels, slopes = (savgol_filter(filled, size, ORDER, deriv=d, delta=run.step, axis=0) for d in (0, 1))
    channels[:, :4] += LATENCY * slopes[:, :4]
    slopes[:, :4] += LATENCY * np.gradient(slopes[:, :4], run.step, axis=0)
    x, y, vn, ve, psi, r, log, _ = channels.T
    states = np.stack([log, ve * np.cos(psi) - vn * np.sin(psi), r, x, y, psi], axis=-1)
    turn = p.speed / p.length
    unit = np.array([p.speed * turn, p.speed * turn, turn**2, p.speed, turn, 1.0])
    weight = np.hanning(2 * max(2, round(0.5 * AVERAGE * p.time_unit / run.step)) + 2)[1:-1]
    return SmoothedTrack(run, states, channels, slopes, rate, unit, weight / weight.sum())


def smoother_size(time_unit: float, step: float) -> int:
    """Samples in the window of the local cubics.

    Args:
        time_unit: L/U0 [s].
        step: Time between samples [s].

    Returns:
        An odd number.
    """
    return max(2 * round(SMOOTH * time_unit / step / 2) + 1, ORDER + 2)


def _filled(values: Float[np.ndarray, " n"], noise: float) -> Float[np.ndarray, " n"]:
    """Gaps and spikes filled in a straight line; a shaft that was not recorded is nominal."""
    at, good = np.arange(len(values)), np.isfinite(values)
    if not good.any():
        return np.ones(len(values))
    filled = np.interp(at, at[good], values[good])
    around = np.pad(filled, NEIGHBOURS, mode="reflect", reflect_type="odd")
    window = np.lib.stride_tricks.sliding_window_view(around, 2 * NEIGHBOURS + 1)
    # Lines between neighbours on both sides follow any steady motion, where a median of the neighbours is the sample.
    lines = 0.5 * (window + window[:, ::-1])[:, :NEIGHBOURS]
    off = np.abs(filled - np.median(lines, axis=1))
    good &= off <= SPIKE * max(1.4826 * float(np.median(off)), noise)
    return np.interp(at, at[good], filled[good])
