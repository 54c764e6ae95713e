"""A run linearised about smoothed states by Runge-Kutta steps of any model: derivatives by forward differences.

The unknowns of a run are its states at all samples: u, v, r, x, y, psi, the model's own (heel and roll rate), and the
process noise of the accelerations (what no hypothesis explains), see :class:`.RunStates`. How they are integrated out
is in :mod:`.linear_run`. The trapezoidal rule of :mod:`.collocation` would not do here: it takes products of
coefficients, and rudders that arrive between two samples.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.effect import Situation
from manoeuvre_nn.core.frames import body_to_earth, body_to_earth_derivatives, kinematics
from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.dynamics.base import Model, calm_accelerations, runge_kutta_step
from manoeuvre_nn.estimation.linear_run import Columns, IntegratedRun, RunEquations
from manoeuvre_nn.estimation.process_noise import ProcessNoise
from manoeuvre_nn.estimation.run_states import RunStates
from manoeuvre_nn.recording.holes import in_breaks
from manoeuvre_nn.recording.preparation import measured, smooth_heel

RUDDER_DIFFERENCE = 1e-3
"""Step of the difference quotient by the rudder [rad]."""
MAX_STEPS = 2048
"""Steps that are made at once: of hours of recording, all would take gigabytes."""
AFTER_BREAK = 10.0
"""How little is known of a state after a time without a rudder, over how little is known of the first one."""


@dataclass(frozen=True)
class Rate:
    """Rates of a calm-water model: u, v, r and own states (..., n, 3 + k), rudder and shaft (n,) -> theirs.

    Attributes:
        dynamics: The model.
    """

    dynamics: Model

    @cached_property
    def states(self) -> RunStates:
        """States of a run of the model."""
        return RunStates(self.dynamics.own_names)

    def __call__(
        self, moving: Tensor, delta: Tensor, shaft: Tensor, sides: Mapping[str, Tensor] | None = None
    ) -> Float[Tensor, "*batch k"]:
        """Accelerations [m/s^2, rad/s^2], then the rates of the own states.

        Args:
            moving: u, v [m/s], r [rad/s], own states.
            delta: Rudder angle [rad].
            shaft: Shaft speed over the nominal one [-].
            sides: How the sides differ, by names of :class:`.Inputs`.

        Returns:
            Rates.
        """
        delta = delta.expand(moving.shape[:-1])
        turns = None if bool((shaft == 1).all()) else shaft.expand(delta.shape)
        if moving.shape[-1] == 3 and not sides:
            return calm_accelerations(self.dynamics, moving, delta, turns)
        state = torch.cat([moving[..., :3], torch.zeros_like(moving[..., :3]), moving[..., 3:]], dim=-1)
        rate = self.dynamics(state, Inputs(delta, turns, **(sides or {})))
        return torch.cat([rate[..., :3], rate[..., 6:]], dim=-1)


@dataclass(frozen=True)
class LinearisedRun:
    """A run's equations about a track.

    Attributes:
        run: The run.
        track: States of the track.
        rate: Rates of the calm-water model.
        transition: Derivative of the next state by the present one, the process noise being as it was:
            :func:`run_equations` says how fast it is forgotten.
        defect: What a step of the model from the track misses it by.
        observed: Derivative of the channels by the state.
        residual: Measured minus what the track shows; 0 where nothing was measured.
        rudder_push: What a radian of rudder adds to the state within a step.
        indicated: What the rudder indicator showed [rad]: the record, unless that is said to be late or early. All
            derivatives are about it; the defect is that of the record.
        receiver: What errors of sensors add to x, y, vn, ve of the satellite receiver: its delay is one of that, too.
    """

    run: Recording
    track: Float[np.ndarray, "n k"]
    rate: Rate
    transition: Float[np.ndarray, "steps s s"]
    defect: Float[np.ndarray, "steps k"]
    observed: Float[np.ndarray, "n c s"]
    residual: Float[np.ndarray, "n c"]
    rudder_push: Float[np.ndarray, "steps k"]
    indicated: Float[np.ndarray, " n"]
    receiver: Float[np.ndarray, "#n 4"] = field(default_factory=lambda: np.zeros((1, 4)))

    @property
    def states(self) -> RunStates:
        """What the states are."""
        return self.rate.states

    @property
    def sails(self) -> bool:
        """Whether steps of the model are finite, and a radian of rudder changes u, v by less than the ship's speed."""
        whole = np.isfinite(self.transition).all() and np.isfinite(self.rudder_push).all()
        return bool(whole and np.abs(self.rudder_push[:, :2]).max(initial=0.0) < self.rate.dynamics.particulars.speed)

    @cached_property
    def present(self) -> Float[np.ndarray, "n c"]:
        """One where a channel was measured, else 0: what was made from other channels says nothing that they do not."""
        there = np.isfinite(measured(self.run, self.states.channels))
        return (there & [name not in self.run.derived for name in self.states.channels]).astype(float)

    @cached_property
    def moving(self) -> Float[Tensor, "n k"]:
        """u, v, r and the own states along the track."""
        return torch.tensor(np.delete(self.track, range(3, 6), axis=1))

    @cached_property
    def calm(self) -> Float[Tensor, "n k"]:
        """Their rates in calm water."""
        return self._calm(self.indicated)

    @cached_property
    def as_recorded(self) -> Float[Tensor, "n k"]:
        """The same if the recorded rudder was right."""
        return self._calm(self.run["delta"])

    def _calm(self, delta: Float[np.ndarray, " n"]) -> Float[Tensor, "n k"]:
        with torch.no_grad():
            return self.rate(self.moving, torch.tensor(delta), torch.tensor(self.run["shaft"]), self.sides)

    @cached_property
    def sides(self) -> dict[str, Tensor]:
        """How the sides of rudders and shafts differ."""
        return sides_of(self.run, self.rate.dynamics)

    @cached_property
    def carried(self) -> Float[Tensor, "steps k k"]:
        """What is left at the end of a step of what moved the state at any time within it, on average.

        ``1/h`` times the integral of ``exp(J s)`` from 0 to h. Of accelerations the transition has it, in the columns
        of the process noise, which is one that lasts a step; of the other rates it is ``(I + A)/2``, by which a ship
        that is pushed hard would turn faster than she yaws.
        """
        states, k = self.states, self.states.count
        kept = 0.5 * (np.eye(k) + self.transition[:, :k, :k])
        kept[:, :, [states.moving.index(name) for name in states.driven]] = self.transition[:, :k, k:] / self.run.step
        return torch.tensor(kept)

    @cached_property
    def situation(self) -> Situation:
        """What effects see along the track."""
        run, state = self.run, torch.tensor(self.track)
        delta, shaft, time = (torch.tensor(part) for part in (self.indicated, run["shaft"], run.time))
        heel = heel_of(self.run, self.rate.dynamics)
        known = None if not heel else torch.stack(list(heel.values()), dim=-1)
        x, y, psi = state[:, 3:6].unbind(-1)
        return Situation(state[:, :3], self.calm[:, :3], x, y, psi, delta, shaft, time, known)

    @property
    def data(self) -> Columns:
        """The recording itself as a column: what the track and the model leave unexplained."""
        return Columns(self.residual[..., None], -self.defect[:, :, None])


def shown(state: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n c"]:
    """What perfect sensors show of a state: x, y, velocity over ground, heading, yaw rate, log, nominal shaft speed.

    Args:
        state: u, v, r, x, y, psi, and own states, which are shown as they are.

    Returns:
        The channels.
    """
    u, v, r, x, y, psi = state[:, :6].T
    return np.stack([x, y, *body_to_earth(u, v, psi), psi, r, u, np.ones_like(u), *state[:, 6:].T], axis=-1)


def _observed(state: Float[np.ndarray, "n k"], states: RunStates) -> Float[np.ndarray, "n c s"]:
    """Derivative of what is shown."""
    u, v, psi = state[:, 0], state[:, 1], state[:, 5]
    h = np.zeros((len(state), len(states.channels), states.size))
    h[:, 0, 3] = h[:, 1, 4] = h[:, 4, 5] = h[:, 5, 2] = h[:, 6, 0] = 1.0
    for row, by in enumerate(body_to_earth_derivatives(u, v, psi), 2):
        h[:, row, 0], h[:, row, 1], h[:, row, 5] = by
    for k in range(len(states.own)):
        h[:, 8 + k, 6 + k] = 1.0
    return h


def sides_of(run: Recording, dynamics: Model) -> dict[str, Tensor]:
    """How the sides of rudders and shafts differ, where they were recorded and the ship has two of each."""
    names = ("delta_split", "shaft_split") if dynamics.hull.sides == 2 else ()
    return {name: torch.tensor(run[name]) for name in names if name in run.channels}


def heel_of(run: Recording, dynamics: Model) -> dict[str, Tensor]:
    """Recorded heel, its rate and acceleration by names of :class:`.Inputs`, for a model that is held upright."""
    if dynamics.own_names or "phi" not in run.channels:
        return {}
    return {name: torch.tensor(values) for name, values in smooth_heel(run).items()}


def linearise(
    run: Recording,
    rate: Rate,
    track: Float[np.ndarray, "n k"],
    indicated: Float[np.ndarray, " n"] | None = None,
) -> LinearisedRun:
    """Linearise a run's equations about a track.

    Args:
        run: The run.
        rate: Rates of the calm-water model.
        track: u, v, r, x, y, psi and own states; its process noise is 0, so that all of them shows in the data.
        indicated: What the rudder indicator showed [rad]; None is what was recorded.

    Returns:
        The linear equations.
    """
    states = rate.states
    sides = {"shaft": torch.tensor(run["shaft"])} | sides_of(run, rate.dynamics)
    between = {name: 0.5 * (each[:-1] + each[1:]) for name, each in sides.items()}
    recorded = torch.tensor(run["delta"])
    delta = recorded if indicated is None else torch.tensor(indicated)
    rudders = torch.stack([recorded, delta, delta + RUDDER_DIFFERENCE])
    start = torch.tensor(track[:-1])
    with torch.no_grad():
        pieces = [
            _step(
                rate, start[a:b], rudders[:, a : b + 1], {name: each[a:b] for name, each in between.items()}, run.step
            )
            for a, b in _pieces(len(start))
        ]
    forward, still, pushed = torch.cat([moved for moved, _ in pieces], dim=1)
    transition = torch.cat([derivative for _, derivative in pieces]).numpy()
    push = pushed - still
    defect = forward.numpy() - track[1:]
    # Where nobody knows the rudder a ship may come out of a step in any state.
    broken = in_breaks(run.time, run.meta.get("breaks", ()))
    transition[broken, : states.count], defect[broken] = 0.0, 0.0
    residual = measured(run, states.channels) - shown(track)
    residual[:, 4] = (residual[:, 4] + np.pi) % (2 * np.pi) - np.pi
    residual = np.nan_to_num(residual, nan=0.0)
    # What a turned rudder adds to position and heading within the step is left out.
    driven = [name in states.driven for name in states.moving]
    rudder_push = push.numpy() / RUDDER_DIFFERENCE * driven
    shows = _observed(track, states)
    return LinearisedRun(run, track, rate, transition, defect, shows, residual, rudder_push, delta.numpy())


def _pieces(steps: int) -> list[tuple[int, int]]:
    """First step of each piece of a run, and the one after its last."""
    return [(begin, min(begin + MAX_STEPS, steps)) for begin in range(0, steps, MAX_STEPS)]


def _step(
    rate: Rate, start: Float[Tensor, "n k"], rudders: Float[Tensor, "3 m"], between: Mapping[str, Tensor], h: float
) -> tuple[Float[Tensor, "3 n k"], Float[Tensor, "n s s"]]:
    """One Runge-Kutta step from every sample to the next at three rudders, and its derivative at the second of them.

    The rudder is linear in between, shafts are at their mean. ``Phi = I + h/6 (K1 + 2 K2 + 2 K3 + K4)``, ``K1 = J1``,
    ``K2 = J2 (I + h/2 K1)``, ``K3 = J3 (I + h/2 K2)``, ``K4 = J4 (I + h K3)``, with the derivatives J of the rates at
    the stages; the process noise is constant within the step.

    Returns:
        The states at its end, without the process noise; Phi of all states.
    """
    turns, splits = between["shaft"], {name: each for name, each in between.items() if name != "shaft"}
    moves = [0, 1, 2, *range(6, start.shape[1])]
    size = start.new_tensor(rate.states.difference)[moves]
    nudges = torch.cat([torch.diag(size), -torch.diag(size)])[:, None, :]
    stages = list[Tensor]()

    def f(s: Tensor, rudder: Tensor) -> Tensor:
        moving = torch.cat([s[..., :3], s[..., 6:]], dim=-1)
        tried, angles = torch.cat([moving, moving[1] + nudges]), torch.cat([rudder, rudder[1].expand(len(nudges), -1)])
        rates = rate(tried, angles, turns, splits)  # all at once: a step of a short run is mostly calls
        here, up, down = rates.split([3, len(size), len(size)])
        stages.append(_derivative(rate.states, s[1], ((up - down) / (2 * size[:, None, None])).permute(1, 2, 0)))
        return torch.cat([here[..., :3], kinematics(s[..., :6]), here[..., 3:]], dim=-1)

    begin, end = rudders[:, :-1], rudders[:, 1:]
    new = runge_kutta_step(f, start.expand(3, *start.shape), (begin, 0.5 * (begin + end), end), start.new_tensor(h))
    eye = torch.eye(rate.states.size, dtype=start.dtype)
    k1 = stages[0]
    k2 = stages[1] @ (eye + 0.5 * h * k1)
    k3 = stages[2] @ (eye + 0.5 * h * k2)
    k4 = stages[3] @ (eye + h * k3)
    return new, eye + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def _derivative(
    states: RunStates, state: Float[Tensor, "n k"], of_rates: Float[Tensor, "n m m"]
) -> Float[Tensor, "n s s"]:
    """Derivative of all rates by all states: of those of u, v, r and own states as given, the others in closed form."""
    count = states.count
    made = state.new_zeros(len(state), states.size, states.size)
    moves = torch.tensor([0, 1, 2, *range(6, count)])
    made[:, moves[:, None], moves] = of_rates
    u, v, psi = state[:, 0], state[:, 1], state[:, 5]
    for row, by in enumerate(body_to_earth_derivatives(u, v, psi), 3):
        made[:, row, 0], made[:, row, 1], made[:, row, 5] = by
    made[:, 5, 2] = 1.0
    for column, name in enumerate(states.driven, count):
        made[:, states.moving.index(name), column] = 1.0
    return made


def integrated(
    linearised: LinearisedRun,
    noise: Float[np.ndarray, " c"],
    process_sd: Float[np.ndarray, " p"],
    process_time: float,
    start_sd: Float[np.ndarray, " k"],
) -> IntegratedRun:
    """Integrate the states out at given noise.

    Args:
        linearised: The run's linear equations.
        noise: Standard deviation of the measured channels' noise, in their units.
        process_sd: That of the process noise in surge, sway [m/s^2], yaw and roll [rad/s^2].
        process_time: Correlation time of the process noise [s].
        start_sd: Prior standard deviation of the first state about the track.

    Returns:
        The run without its states.
    """
    return IntegratedRun(run_equations(linearised, noise, process_time, start_sd), process_sd)


def run_equations(
    linearised: LinearisedRun, noise: Float[np.ndarray, " c"], process_time: float, start_sd: Float[np.ndarray, " k"]
) -> RunEquations:
    """Equations of a run at given noise of its channels, the process noise in units of its standard deviation.

    Args:
        linearised: The run's linear equations.
        noise: Standard deviation of the measured channels' noise, in their units.
        process_time: Correlation time of the process noise [s].
        start_sd: Prior standard deviation of the first state about the track.

    Returns:
        The equations, for any size of the process noise.
    """
    run, states = linearised.run, linearised.states
    steps, k, sd = len(linearised.transition), states.count, states.step_sd
    # A step's covariance is that of rounding and of the rudder's noise, Q = S (1 + q q^T) S, S = diag(step_sd h^1/2),
    # S q = push. With w^2 = 1 + q^T q, root = (1 - q q^T / (w (w + 1))) S^-1 has root^T root = Q^-1, however large q.
    rounding = sd * np.sqrt(run.step)
    q = linearised.rudder_push * run.meta["rudder_noise"] / rounding
    w = np.sqrt(1 + np.square(q).sum(axis=1))[:, None, None]
    root = np.zeros((steps, states.size, states.size))
    root[:, :k, :k] = (np.eye(k) - q[:, :, None] * q[:, None, :] / (w * (w + 1))) / rounding
    root[in_breaks(run.time, run.meta.get("breaks", ())), :k, :k] = np.diag(1 / (AFTER_BREAK * start_sd))
    # What is left of the process noise after a step, and its innovations.
    noises, left = ProcessNoise(process_time, axes=len(states.driven)), -linearised.transition
    left[:, k:, k:] *= np.exp(-run.step / process_time)
    root[:, k:, k:] = noises.steps(np.full(1, run.step))[1]
    # ds_{k+1} - A_k ds_k = ...
    right = np.broadcast_to(np.eye(states.size), root.shape)
    log_det = float(np.linalg.slogdet(root)[1].sum())
    precision = linearised.present / noise**2
    count, ones = len(states.driven), np.ones(len(states.driven))
    start, unit = np.concatenate([start_sd**-2.0, ones]), np.concatenate([states.unit, ones])
    return RunEquations(left, right, root, log_det, linearised.observed, precision, start, unit, noises=count)
