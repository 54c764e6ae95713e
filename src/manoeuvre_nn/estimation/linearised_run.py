"""A run linearised about smoothed states by Runge-Kutta steps of any model: derivatives by forward differences.

The unknowns of a run are its states at all samples: u, v, r, x, y, psi and the process noise of three accelerations
(what no hypothesis explains). How they are integrated out is in :mod:`.linear_run`. The trapezoidal rule of
:mod:`.collocation` would not do here: it takes products of coefficients, and rudders that arrive between two samples.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.channels import MEASURED
from manoeuvre_nn.core.effect import Situation
from manoeuvre_nn.core.frames import kinematics
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.dynamics.base import Model, calm_accelerations, runge_kutta_step
from manoeuvre_nn.estimation.linear_run import Columns, IntegratedRun, RunEquations
from manoeuvre_nn.estimation.process_noise import ProcessNoise
from manoeuvre_nn.recording.preparation import measured

SIZE = 9
"""u, v, r, x, y, psi and the process noise of surge, sway and yaw."""
STATE_UNIT = np.array([0.05, 0.05, 5e-4, 1.0, 1.0, 2e-3])
"""Usual size of u, v [m/s], r [rad/s], x, y [m], psi [rad], for the condition of the factor."""
STEP_SD = np.array([1e-4, 1e-4, 1e-6, 2e-3, 2e-3, 2e-6])
"""Standard deviation of what a step of one second may miss the equations by beside the process noise."""
STATE_DIFFERENCE = np.array([0.02, 0.02, 2e-4, 1.0, 1.0, 1e-3, 1e-4, 1e-4, 1e-6])
"""Steps of the difference quotients by the state."""
RUDDER_DIFFERENCE = 1e-3
"""Step of the difference quotient by the rudder [rad]."""


@dataclass(frozen=True)
class LinearisedRun:
    """A run's equations about a track.

    Attributes:
        run: The run.
        track: States of the track.
        rate: Accelerations of the calm-water model.
        transition: Derivative of the next state by the present one.
        defect: What a step of the model from the track misses it by.
        observed: Derivative of the channels by the state.
        residual: Measured minus what the track shows; 0 where nothing was measured.
        rudder_push: What a radian of rudder adds to u, v, r within a step.
    """

    run: Recording
    track: Float[np.ndarray, "n 6"]
    rate: "Rate"
    transition: Float[np.ndarray, "steps 9 9"]
    defect: Float[np.ndarray, "steps 6"]
    observed: Float[np.ndarray, "n 8 9"]
    residual: Float[np.ndarray, "n 8"]
    rudder_push: Float[np.ndarray, "steps 3"]

    @cached_property
    def present(self) -> Float[np.ndarray, "n 8"]:
        """One where a channel was measured, else 0."""
        return np.isfinite(measured(self.run)).astype(float)

    @cached_property
    def situation(self) -> Situation:
        """What effects see along the track."""
        run, state = self.run, torch.tensor(self.track)
        delta, shaft, time = (torch.tensor(part) for part in (run["delta"], run["shaft"], run.time))
        with torch.no_grad():
            nudot = self.rate(state[:, :3], delta, shaft)
        return Situation(state[:, :3], nudot, *state[:, 3:6].unbind(-1), delta, shaft, time)  # type: ignore[call-arg]

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
    h = np.zeros((len(state), len(MEASURED), SIZE))
    h[:, 0, 3] = h[:, 1, 4] = h[:, 4, 5] = h[:, 5, 2] = h[:, 6, 0] = 1.0
    h[:, 2, 0], h[:, 2, 1], h[:, 2, 5] = cos, -sin, -u * sin - v * cos
    h[:, 3, 0], h[:, 3, 1], h[:, 3, 5] = sin, cos, u * cos - v * sin
    return h


Rate = Callable[[Tensor, Tensor, Tensor], Tensor]
"""Velocities (..., n, 3), rudder and shaft (n,) -> accelerations (..., n, 3)."""


def calm_rate(dynamics: Model) -> Rate:
    """Accelerations of a calm-water model at a shaft speed.

    Returns:
        Velocities, rudder, shaft -> accelerations.
    """

    def rate(nu: Tensor, delta: Tensor, shaft: Tensor) -> Tensor:
        delta = delta.expand(nu.shape[:-1])
        if bool((shaft == 1).all()):
            return calm_accelerations(dynamics, nu, delta)
        return calm_accelerations(dynamics, nu, delta, shaft.expand(delta.shape))

    return rate


def linearise(run: Recording, rate: Rate, track: Float[np.ndarray, "n 6"], process_time: float) -> LinearisedRun:
    """Linearise a run's equations about a track.

    Args:
        run: The run.
        rate: Accelerations of the calm-water model.
        track: States; its process noise is 0, so that all of them shows in the data.
        process_time: Correlation time of the process noise [s].

    Returns:
        The linear equations.
    """
    delta, shaft = torch.tensor(run["delta"]), torch.tensor(run["shaft"])
    decay = float(np.exp(-run.step / process_time))
    state = torch.nn.functional.pad(torch.tensor(track[:-1]), (0, 3))
    size = state.new_tensor(STATE_DIFFERENCE)
    nudges = torch.cat([torch.diag(size), -torch.diag(size)])[:, None, :]
    with torch.no_grad():
        forward = _step(rate, state, delta, shaft, run.step, decay)
        moved = _step(rate, state + nudges, delta, shaft, run.step, decay)
        push = _step(rate, state, delta + RUDDER_DIFFERENCE, shaft, run.step, decay) - forward
    transition = ((moved[:SIZE] - moved[SIZE:]) / (2 * size[:, None, None])).permute(1, 2, 0).numpy()
    defect = forward.numpy()[:, :6] - track[1:]
    residual = measured(run) - shown(track)
    residual[:, 4] = (residual[:, 4] + np.pi) % (2 * np.pi) - np.pi
    residual = np.nan_to_num(residual, nan=0.0)
    rudder_push = push[:, :3].numpy() / RUDDER_DIFFERENCE
    return LinearisedRun(run, track, rate, transition, defect, _observed(track), residual, rudder_push)


def _step(rate: Rate, state: Tensor, delta: Tensor, shaft: Tensor, h: float, decay: float) -> Tensor:
    """One Runge-Kutta step from every sample to the next at once, rudder and shaft linear in between."""
    start, end = delta[:-1], delta[1:]
    turns = 0.5 * (shaft[:-1] + shaft[1:])

    def f(s: Tensor, rudder: Tensor) -> Tensor:
        accelerations = rate(s[..., :3], rudder, turns) + s[..., 6:]
        return torch.cat([accelerations, kinematics(s[..., :6]), torch.zeros_like(accelerations)], dim=-1)

    new = runge_kutta_step(f, state, (start, 0.5 * (start + end), end), state.new_tensor(h))
    return torch.cat([new[..., :6], decay * state[..., 6:]], dim=-1)


def integrated(
    linearised: LinearisedRun,
    noise: Float[np.ndarray, " 8"],
    process_sd: Float[np.ndarray, " 3"],
    process_time: float,
    start_sd: Float[np.ndarray, " 6"],
) -> IntegratedRun:
    """Integrate the states out at given noise.

    Args:
        linearised: The run's linear equations.
        noise: Standard deviation of the measured channels' noise, in their units.
        process_sd: That of the process noise in surge, sway [m/s^2] and yaw [rad/s^2].
        process_time: Correlation time of the process noise [s].
        start_sd: Prior standard deviation of the first state about the track.

    Returns:
        The run without its states.
    """
    run = linearised.run
    process_sd = np.maximum(process_sd, 1e-12)
    steps = len(linearised.transition)
    # A step's covariance is that of rounding and of the rudder's noise, Q = diag(STEP_SD^2 h) + push push^T.
    push = linearised.rudder_push * run.meta["rudder_noise"]
    covariance = np.zeros((steps, 6, 6))
    covariance[:, range(6), range(6)] = STEP_SD**2 * run.step
    covariance[:, :3, :3] += push[:, :, None] * push[:, None, :]
    root = np.zeros((steps, SIZE, SIZE))
    # root^T root = Q^-1, and the innovations of the process noise.
    scale = STEP_SD[:, None] * STEP_SD
    root[:, :6, :6] = np.linalg.cholesky(np.linalg.inv(covariance / scale)).transpose(0, 2, 1) / STEP_SD
    root[:, 6:, 6:] = ProcessNoise(process_time).steps(np.full(1, run.step))[1] / process_sd
    # ds_{k+1} - A_k ds_k = ...
    right = np.broadcast_to(np.eye(SIZE), root.shape)
    log_det = float(np.linalg.slogdet(root)[1].sum())
    precision = linearised.present / noise**2
    start, unit = np.concatenate([start_sd, process_sd]) ** -2.0, np.concatenate([STATE_UNIT, process_sd])
    return IntegratedRun(
        RunEquations(-linearised.transition, right, root, log_det, linearised.observed, precision, start, unit)
    )
