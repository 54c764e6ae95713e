"""One run of states and coefficients together: its equations by the trapezoidal rule about the present states.

The rule needs the coefficients' columns at the samples only, which give the rates and the derivatives by the
coefficients at once, and takes uneven times as they are. Models that are no sum of products are stepped by Runge-Kutta
(:mod:`.linearised_run`).
"""

from functools import cached_property

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.frames import body_to_earth
from manoeuvre_nn.estimation.linear_run import Columns, IntegratedRun, RunEquations
from manoeuvre_nn.estimation.measurement_noise import INFORMATION
from manoeuvre_nn.estimation.problem import CHANNELS, DELAY, MOTION, Estimate, EstimationProblem

STEP_SD = 3e-4
"""Standard deviation of what a step of one unit of time may miss the equations by beside the process noise."""
STATE_DIFFERENCE = 1e-5
"""Step of the difference quotient of forces by the state."""


class CollocatedRun:
    """A run linearised about its present states, the states integrated out.

    Attributes:
        places: Where its unknowns stand among all.
        solved: Its equations with the states integrated out.
        gram: Inner products of the data and the run's unknowns.
        cost: Half the sum of squares at the present states and values.
    """

    def __init__(self, problem: EstimationProblem, now: Estimate, run: int) -> None:
        """Assemble and factor."""
        self.problem, self.now, self.run = problem, now, run
        self.recording, self.state = problem.recordings[run], now.states[run]
        self.places = np.concatenate([np.arange(problem.shared), problem.own(run)])
        self.size = MOTION + problem.process.size
        (left, right, root, log_det), missed, pushed = self._steps()
        residual, self.marks = self._samples()
        observed = np.broadcast_to(np.eye(MOTION, self.size), (len(self.state), MOTION, self.size))
        precision = INFORMATION * now.sample_weights[run] / now.noise**2
        start = np.concatenate([np.zeros(MOTION), np.tile(1 / now.process_sd**2, problem.process.order)])
        self.solved = IntegratedRun(RunEquations(left, right, root, log_det, observed, precision, start))
        # Data, coefficients, sensors' errors: what each adds to channels, steps and the first process noise.
        shared, count = problem.shared, 1 + len(self.places)
        columns = Columns(np.zeros((len(self.state), MOTION, count)), np.zeros((len(missed), self.size, count)))
        columns.measured[:, :, 0], columns.measured[:, :, 1 + shared :] = -residual, self.marks
        columns.moved[:, :, 0], columns.moved[:, :3, 1 : 1 + shared] = missed, pushed
        first = np.zeros((self.size, count))
        first[MOTION:, 0] = self.state[0, MOTION:]
        self._embedded = self.solved.embed(Columns(columns.measured, columns.moved, first))
        self.gram = self._embedded.dot(self._embedded)
        data = self._embedded.outer.combined(np.eye(count)[0])
        self.cost = 0.5 * float(data.dot(data)[0, 0])

    def _steps(self) -> tuple[tuple[np.ndarray, np.ndarray, np.ndarray, float], np.ndarray, np.ndarray]:
        """Equations of the steps from sample k to k + 1, what they miss, and what the coefficients push."""
        # s_{k+1} - s_k = h/2 (f_k + f_{k+1}), and the process noise goes on as ProcessNoise says.
        s, theta = self.state, self.now.values[: self.problem.shared]
        gaps = np.diff(self.recording.time)
        h = gaps[:, None, None]
        columns = self.problem.force_columns(self.run, s[:, :MOTION])
        self.rate, slope = self._rate(columns @ theta, theta)
        eye = np.eye(self.size)[:MOTION]
        left, right = (np.zeros((len(s) - 1, self.size, self.size)) for _ in range(2))
        left[:, :MOTION] = -(eye + h / 2 * slope[:-1])  # -(1 + h/2 df/ds_k)
        right[:, :MOTION] = eye - h / 2 * slope[1:]  # 1 - h/2 df/ds_{k+1}
        self.left, self.right = self.problem.process.steps(gaps)
        left[:, MOTION:, MOTION:], right[:, MOTION:, MOTION:] = self.left, self.right
        moved = s[1:, :MOTION] - s[:-1, :MOTION] - gaps[:, None] / 2 * (self.rate[:-1] + self.rate[1:])
        missed = np.concatenate([moved, self.innovations(s)], axis=1)
        tight = np.repeat(1 / (STEP_SD**2 * gaps)[:, None], MOTION, axis=1)
        free = self.now.step_weights[self.run] / self.now.process_sd**2 / self.problem.process_variance(self.run)
        precision = np.concatenate([tight, np.tile(free, self.problem.process.order)], axis=1)
        log_det = 0.5 * float(np.log(precision).sum()) + float(np.linalg.slogdet(self.right)[1].sum())
        root = np.sqrt(precision)[:, :, None] * np.eye(self.size)
        return (left, right, root, log_det), missed, h / 2 * (columns[:-1] + columns[1:])

    def innovations(self, state: Float[np.ndarray, "n s"]) -> Float[np.ndarray, "m c"]:
        """What is new in the process noise at each step, of its variance."""
        process = state[:, MOTION:, None]
        return (self.right @ process[1:] + self.left @ process[:-1])[:, :, 0]

    def _rate(self, force: Float[np.ndarray, "n 3"], theta: Float[np.ndarray, " p"]) -> tuple[np.ndarray, np.ndarray]:
        """Rates of the motion and their derivatives by the state."""
        s = self.state
        u, v, psi = s[:, 0], s[:, 1], s[:, 5]
        rate = np.empty((len(s), MOTION))
        rate[:, :3] = force + s[:, MOTION : MOTION + 3]
        (rate[:, 3], rate[:, 4]), rate[:, 5] = body_to_earth(u, v, psi), s[:, 2]
        slope = np.zeros((len(s), MOTION, self.size))
        for k in (0, 1, 2, 5) if len(theta) else ():
            nudge = STATE_DIFFERENCE * np.eye(MOTION)[k]
            ahead, behind = (self.problem.force_columns(self.run, s[:, :MOTION] + sign * nudge) for sign in (1, -1))
            slope[:, :3, k] = (ahead - behind) @ theta / (2 * STATE_DIFFERENCE)
        slope[:, range(3), range(MOTION, MOTION + 3)] = 1.0
        slope[:, 3, 0], slope[:, 3, 1], slope[:, 3, 5] = np.cos(psi), -np.sin(psi), -rate[:, 4]
        slope[:, 4, 0], slope[:, 4, 1], slope[:, 4, 5] = np.sin(psi), np.cos(psi), rate[:, 3]
        slope[:, 5, 2] = 1.0
        return rate, slope

    def _samples(self) -> tuple[np.ndarray, np.ndarray]:
        """What channels show beyond what was measured, and what the sensors' errors add."""
        # A channel that is written down late by tau shows s(t - tau) = s - tau ds/dt.
        faults, values = self.problem.faults, self.now.values[self.problem.own(self.run)]
        shown, marks = self.state[:, :MOTION].copy(), np.zeros((len(self.state), MOTION, len(faults)))
        for f, (fault, value) in enumerate(zip(faults, values, strict=True)):
            k = CHANNELS.index(fault.channel)
            marks[:, k, f] = -self.rate[:, k] if fault.kind == DELAY else 1.0
            shown[:, k] += value * marks[:, k, f]
        residual = np.where(self.problem.present[self.run] > 0, shown - self.problem.measured[self.run], 0.0)
        return residual, marks

    def moved(self, step: Float[np.ndarray, " p"]) -> Float[np.ndarray, "n s"]:
        """States after a step of the unknowns.

        Args:
            step: Step of the run's unknowns.

        Returns:
            New states.
        """
        left = np.concatenate([[1.0], -step])[:, None]
        return self.state + self.solved.chain.unwhiten(self._embedded.inner @ left)[:, :, 0]

    @cached_property
    def _by_unknowns(self) -> Float[np.ndarray, "n s p"]:
        """How the states follow the unknowns."""
        return -self.solved.chain.unwhiten(np.asfortranarray(self._embedded.inner[:, 1:]))

    def state_covariance(self, covariance: Float[np.ndarray, "q q"]) -> Float[np.ndarray, "n s s"]:
        """Of every sample's state, that of the unknowns included."""
        follow = self._by_unknowns
        own = covariance[np.ix_(self.places, self.places)]
        return self.solved.covariances[0] + follow @ own @ follow.transpose(0, 2, 1)

    def innovation_variance(self, covariance: Float[np.ndarray, "q q"]) -> Float[np.ndarray, "m c"]:
        """Posterior variance of what is new in the process noise at each step."""
        # Of right a_{k+1} + left a_k: right S_{k+1} right^T + left S_k left^T + 2 right S_{k+1,k} left^T.
        on, below = (m[:, MOTION:, MOTION:] for m in self.solved.covariances)
        right, left = self.right.transpose(0, 2, 1), self.left.transpose(0, 2, 1)
        given = self.right @ on[1:] @ right + self.left @ on[:-1] @ left + 2 * self.right @ below @ left
        follow = self._by_unknowns[:, MOTION:]
        new = self.right @ follow[1:] + self.left @ follow[:-1]
        own = covariance[np.ix_(self.places, self.places)]
        return np.einsum("nii->ni", given) + ((new @ own) * new).sum(-1)
