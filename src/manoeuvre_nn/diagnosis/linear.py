"""A run linearised about a smooth track: what a disturbance anywhere in the model does to every sample, whitened.

The unknowns of a run are its states at all samples: u, v, r, x, y, psi and three coloured accelerations (what no
hypothesis explains). Given the track they obey linear equations with Gaussian noise, so that their precision is a band
matrix: one banded Cholesky factor gives the likelihood of the record with all states integrated out, and the whitened
effect of any number of columns (parameters, coefficients, sensor faults) at the cost of a band solve. This is the
Kalman filter's likelihood for hundreds of hypotheses at once; a filter would walk through the samples for each of them.

Source:
    The equivalence is in Bell 1994 (SIAM J. Optim. 4:626) and Aravkin et al. 2017 (Automatica 86:63).
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.diagnosis.runs import COUNT, Run
from manoeuvre_nn.dynamics.banded import Chain
from manoeuvre_nn.dynamics.model import Dynamics

SIZE = 9
"""u, v, r, x, y, psi and the coloured accelerations of surge, sway and yaw."""


@dataclass(frozen=True)
class Noise:
    """Standard deviations of all that is random in a run.

    Attributes:
        channels: Noise of the measured channels, in their units.
        force: Coloured acceleration in surge, sway [m/s^2] and yaw [rad/s^2].
        force_time: Its correlation time [s].
    """

    channels: Float[np.ndarray, " 8"]
    force: Float[np.ndarray, " 3"]
    force_time: float


@dataclass(frozen=True)
class Columns:
    """Disturbances of a run, one a column.

    Attributes:
        measured: What each adds to the measured channels.
        moved: What each adds to the state within each step; the coloured accelerations are not touched.
    """

    measured: Float[np.ndarray, "n 8 p"]
    moved: Float[np.ndarray, "steps 6 p"]

    @property
    def count(self) -> int:
        """Number of columns."""
        return self.measured.shape[-1]


def joined(parts: list[Columns]) -> Columns:
    """Columns side by side.

    Args:
        parts: At least one.

    Returns:
        All columns.
    """
    return Columns(
        np.concatenate([c.measured for c in parts], axis=-1), np.concatenate([c.moved for c in parts], axis=-1)
    )


@dataclass(frozen=True)
class Linearised:
    """A run's equations about a track.

    Attributes:
        run: The run.
        track: States of the track.
        transition: Derivative of the next state by the present one.
        defect: What a step of the model from the track misses it by.
        observed: Derivative of the channels by the state.
        residual: Measured minus what the track shows; 0 where nothing was measured.
        rudder_push: What a radian of rudder adds to u, v, r within a step.
    """

    run: Run
    track: Float[np.ndarray, "n 6"]
    transition: Float[np.ndarray, "steps 9 9"]
    defect: Float[np.ndarray, "steps 6"]
    observed: Float[np.ndarray, "n 8 9"]
    residual: Float[np.ndarray, "n 8"]
    rudder_push: Float[np.ndarray, "steps 3"]

    @cached_property
    def present(self) -> Float[np.ndarray, "n 8"]:
        """One where a channel was measured, else 0."""
        return np.isfinite(self.run.measured).astype(float)

    @property
    def data(self) -> Columns:
        """The recording itself as a column: what the track and the model leave unexplained."""
        return Columns(self.residual[..., None], -self.defect[:, :, None])


def shown(state: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n 8"]:
    """What perfect sensors show of a state: x, y, velocity over ground, heading, yaw rate, log, nominal shaft speed.

    Args:
        state: u, v, r, x, y, psi, ...

    Returns:
        The channels.
    """
    u, v, r, x, y, psi = state[:, :6].T
    cos, sin = np.cos(psi), np.sin(psi)
    return np.stack([x, y, u * cos - v * sin, u * sin + v * cos, psi, r, u, np.ones_like(u)], axis=-1)


def _observed(state: Float[np.ndarray, "n 6"]) -> Float[np.ndarray, "n 8 9"]:
    """Derivative of what is shown."""
    u, v, psi = state[:, 0], state[:, 1], state[:, 5]
    cos, sin = np.cos(psi), np.sin(psi)
    h = np.zeros((len(state), COUNT, SIZE))
    h[:, 0, 3] = h[:, 1, 4] = h[:, 4, 5] = h[:, 5, 2] = h[:, 6, 0] = 1.0
    h[:, 2, 0], h[:, 2, 1], h[:, 2, 5] = cos, -sin, -u * sin - v * cos
    h[:, 3, 0], h[:, 3, 1], h[:, 3, 5] = sin, cos, u * cos - v * sin
    return h


Rate = Callable[[Tensor, Tensor, Tensor], Tensor]
"""Velocities (..., n, 3), rudder and shaft (n,) -> accelerations (..., n, 3)."""


def calm_rate(dynamics: Dynamics) -> Rate:
    """Accelerations of a calm-water model at a shaft speed.

    Args:
        dynamics: The model.

    Returns:
        Velocities, rudder, shaft -> accelerations.
    """

    def rate(nu: Tensor, delta: Tensor, shaft: Tensor) -> Tensor:
        delta = delta.expand(nu.shape[:-1])
        if bool((shaft == 1).all()):
            return dynamics.acceleration(nu, delta)
        return dynamics.at_shaft(nu, delta, shaft.expand(delta.shape))

    return rate


def linearise(
    run: Run, rate: Rate, track: Float[np.ndarray, "n 6"], force_time: float, offset: Columns | None = None
) -> Linearised:
    """Linearise a run's equations about a track.

    Args:
        run: The run.
        rate: Accelerations of the calm-water model.
        track: States; its coloured accelerations are 0, so that all of them shows in the data.
        force_time: Correlation time of the coloured accelerations [s].
        offset: What hypotheses that are already taken on add, as one column.

    Returns:
        The linear equations.
    """
    delta, shaft = torch.tensor(run.delta), torch.tensor(run.shaft)
    decay = float(np.exp(-run.step / force_time))
    state = torch.nn.functional.pad(torch.tensor(track[:-1]), (0, 3))
    size = state.new_tensor([0.02, 0.02, 2e-4, 1.0, 1.0, 1e-3, 1e-4, 1e-4, 1e-6])
    nudges = torch.cat([torch.diag(size), -torch.diag(size)])[:, None, :]
    with torch.no_grad():
        forward = _step(rate, state, delta, shaft, run.step, decay)
        moved = _step(rate, state + nudges, delta, shaft, run.step, decay)
        turn = 1e-3
        push = _step(rate, state, delta + turn, shaft, run.step, decay) - forward
    transition = ((moved[:SIZE] - moved[SIZE:]) / (2 * size[:, None, None])).permute(1, 2, 0).numpy()
    defect = forward.numpy()[:, :6] - track[1:]
    residual = run.measured - shown(track)
    residual[:, 4] = (residual[:, 4] + np.pi) % (2 * np.pi) - np.pi
    residual = np.nan_to_num(residual, nan=0.0)
    if offset is not None:
        residual = np.where(np.isfinite(run.measured), residual - offset.measured[..., 0], 0.0)
        defect = defect + offset.moved[..., 0]
    return Linearised(run, track, transition, defect, _observed(track), residual, push[:, :3].numpy() / turn)


def _step(rate: Rate, state: Tensor, delta: Tensor, shaft: Tensor, h: float, decay: float) -> Tensor:
    """One Runge-Kutta step from every sample to the next at once, rudder and shaft linear in between."""
    start, end = delta[:-1], delta[1:]
    middle, turns = 0.5 * (start + end), 0.5 * (shaft[:-1] + shaft[1:])

    def f(s: Tensor, rudder: Tensor) -> Tensor:
        u, v, r, psi = s[..., 0], s[..., 1], s[..., 2], s[..., 5]
        cos, sin = torch.cos(psi), torch.sin(psi)
        motion = torch.stack([u * cos - v * sin, u * sin + v * cos, r], dim=-1)
        return torch.cat([rate(s[..., :3], rudder, turns) + s[..., 6:], motion, torch.zeros_like(motion)], dim=-1)

    k1 = f(state, start)
    k2 = f(state + 0.5 * h * k1, middle)
    k3 = f(state + 0.5 * h * k2, middle)
    k4 = f(state + h * k3, end)
    new = state + h / 6 * (k1 + 2 * (k2 + k3) + k4)
    return torch.cat([new[..., :6], decay * state[..., 6:]], dim=-1)


@dataclass(frozen=True)
class Embedded:
    """Columns as vectors: the inner product is that of ``outer`` less that of ``inner`` (what the states absorb)."""

    outer: Float[np.ndarray, "a p"]
    inner: Float[np.ndarray, "b p"]

    def dot(self, other: "Embedded") -> Float[np.ndarray, "p q"]:
        """Inner products of all columns with all others.

        Args:
            other: Other columns of the same run at the same noise.

        Returns:
            One row a column of this, one column a column of the other.
        """
        return self.outer.T @ other.outer - self.inner.T @ other.inner


class Whitened:
    """A linearised run at given noise: its states integrated out.

    Attributes:
        log_norm: ``-0.5 log det`` of the covariance of all measured samples, up to a constant of the run.
    """

    def __init__(self, line: Linearised, noise: Noise, start_spread: Float[np.ndarray, " 6"]) -> None:
        """Factor the precision of the states.

        Args:
            line: The run's linear equations.
            noise: Standard deviations.
            start_spread: Prior standard deviation of the first state about the track.
        """
        self.line, run = line, line.run
        # States in units of their own size, coloured accelerations in units of their own prior: well conditioned.
        self.unit = np.concatenate([[0.05, 0.05, 5e-4, 1.0, 1.0, 2e-3], np.maximum(noise.force, 1e-12)])
        decay = np.exp(-run.step / noise.force_time)
        tiny = np.array([1e-4, 1e-4, 1e-6, 2e-3, 2e-3, 2e-6]) * np.sqrt(run.step)
        push = line.rudder_push * run.rudder_noise
        q_inv = _steps_precision(tiny, push, decay, self.unit)
        self.q_inv = q_inv
        self.q_root = np.linalg.cholesky(q_inv[:, :6, :6]).transpose(0, 2, 1)
        self.a = line.transition * self.unit[None, None, :] / self.unit[None, :, None]
        self.h = line.observed * self.unit
        self.r_inv = line.present / noise.channels**2
        qa = q_inv @ self.a
        diagonal = np.einsum("kci,kc,kcj->kij", self.h, self.r_inv, self.h)
        diagonal[:-1] += self.a.transpose(0, 2, 1) @ qa
        diagonal[1:] += q_inv
        first = np.concatenate([(self.unit[:6] / start_spread) ** 2, np.ones(3)])
        diagonal[0] += np.diag(first)
        self.chain = Chain(diagonal, -qa)
        log_prior = np.linalg.slogdet(q_inv)[1].sum() + np.log(first).sum()
        noise_part = np.where(line.present > 0, np.log(noise.channels), 0.0).sum()
        self.log_norm = float(0.5 * (log_prior - self.chain.log_det) - noise_part)

    def _right(self, c: Columns) -> Float[np.ndarray, "n 9 p"]:
        """Right-hand sides of the normal equations."""
        b = self.h.transpose(0, 2, 1) @ (self.r_inv[..., None] * c.measured)
        pushed = self.q_inv[:, :, :6] @ (c.moved / self.unit[:6, None])
        b[1:] -= pushed
        b[:-1] += self.a.transpose(0, 2, 1) @ pushed
        return b

    def embed(self, c: Columns) -> "Embedded":
        """Vectors whose inner products are those of the columns in the metric of the samples' marginal covariance.

        Args:
            c: Columns; a disturbance moves the state by ``moved`` and the channels by ``measured``.

        Returns:
            The vectors.
        """
        white = self.chain.whiten(self._right(c))
        p = c.count
        m = (np.sqrt(self.r_inv)[..., None] * c.measured).reshape(-1, p)
        moved = (self.q_root @ (c.moved / self.unit[:6, None])).reshape(-1, p)
        return Embedded(np.concatenate([m, moved]), white)

    def states(self, c: Columns) -> Float[np.ndarray, "n 9 p"]:
        """Most likely deviation of the states from the track for a column, parameters at zero.

        Args:
            c: Columns.

        Returns:
            Deviations in SI.
        """
        return self.chain.unwhiten(self.chain.whiten(self._right(c))) * self.unit[None, :, None]


def _steps_precision(tiny: np.ndarray, push: np.ndarray, decay: float, unit: np.ndarray) -> Float[np.ndarray, "k 9 9"]:
    """Precision of what is random within each step: rudder noise, rounding, new coloured acceleration."""
    covariance = np.zeros((len(push), SIZE, SIZE))
    covariance[:, range(6), range(6)] = (tiny / unit[:6]) ** 2
    push = push / unit[:3]
    covariance[:, :3, :3] += push[:, :, None] * push[:, None, :]
    covariance[:, range(6, 9), range(6, 9)] = 1 - decay**2
    return np.linalg.inv(covariance)
