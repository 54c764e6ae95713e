"""One run of a joint estimation: its equations about the present states, the states solved for."""

from functools import cached_property

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.dynamics.banded import Chain
from manoeuvre_nn.dynamics.joint_problem import CHANNELS, DELAY, FREEDOM, MOTION, Estimate, Problem

TIGHT = 3e-4
"""Standard deviation of what a step of one unit of time may miss the equations by beside the coloured acceleration."""
INFORMATION = (FREEDOM + 1) / (FREEDOM + 3)
"""Fisher's information of a sample under Student's t over that of a weight of 1. With it standard errors are right for
noise with outliers and, to 3 %, for Gaussian noise; without it they are a sixth too small."""
NUDGE = 1e-5
"""Step of the difference quotient of forces by the state."""


class Line:
    """A run's equations about its present states: rows of each step and sample, the states solved for.

    A step from sample k to k + 1 obeys the trapezoidal rule, ``s_{k+1} - s_k = h/2 (f_k + f_{k+1})``, and the coloured
    accelerations go on as :class:`.Colour` says.
    """

    def __init__(self, problem: Problem, now: Estimate, run: int) -> None:
        """Assemble and factor.

        Args:
            problem: The problem.
            now: Where it stands.
            run: Number of the run.
        """
        self.problem, self.now, self.run = problem, now, run
        self.track, self.state = problem.tracks[run], now.states[run]
        self.places = np.concatenate([np.arange(problem.shared), problem.own(run)])
        self.h = np.diff(self.track.time)
        self.size = MOTION + problem.colour.size
        self._steps()
        self._samples()
        self._assemble()

    def _steps(self) -> None:
        """Rows of the steps: what is missed, and its derivatives by both ends and by the parameters."""
        s, h, theta = self.state, self.h[:, None, None], self.now.values[: self.problem.shared]
        columns = self.problem.force.columns(s[:, :MOTION], self.track.inputs)
        rate, slope = self._rate(columns @ theta, theta)
        self.rate = rate
        eye = np.eye(self.size)[:MOTION]
        self.left, self.right = (np.zeros((len(s) - 1, self.size, self.size)) for _ in range(2))
        self.left[:, :MOTION] = -(eye + h / 2 * slope[:-1])
        self.right[:, :MOTION] = eye - h / 2 * slope[1:]
        self.behind, self.ahead = self.problem.colour.steps(self.h)
        self.left[:, MOTION:, MOTION:], self.right[:, MOTION:, MOTION:] = self.behind, self.ahead
        self.missed = np.concatenate(
            [
                s[1:, :MOTION] - s[:-1, :MOTION] - self.h[:, None] / 2 * (rate[:-1] + rate[1:]),
                self.fresh(s),
            ],
            axis=1,
        )
        self.pushed = -h / 2 * (columns[:-1] + columns[1:])
        tight = np.repeat(1 / (TIGHT**2 * self.h)[:, None], MOTION, axis=1)
        free = self.now.calm[self.run] / self.now.force**2 / self.problem.swell(self.run)
        free = np.tile(free, self.problem.colour.order)
        self.precision = np.concatenate([tight, free], axis=1)

    def fresh(self, state: Float[np.ndarray, "n s"]) -> Float[np.ndarray, "m c"]:
        """What is new in the coloured accelerations at each step, of their variance.

        Args:
            state: States.

        Returns:
            Innovations.
        """
        coloured = state[:, MOTION:, None]
        return (self.ahead @ coloured[1:] + self.behind @ coloured[:-1])[:, :, 0]

    def _rate(self, force: Float[np.ndarray, "n 3"], theta: Float[np.ndarray, " p"]) -> tuple[np.ndarray, np.ndarray]:
        """Rates of the motion and their derivatives by the state."""
        s = self.state
        u, v, psi = s[:, 0], s[:, 1], s[:, 5]
        cos, sin = np.cos(psi), np.sin(psi)
        rate = np.empty((len(s), MOTION))
        rate[:, :3] = force + s[:, MOTION : MOTION + 3]
        rate[:, 3], rate[:, 4], rate[:, 5] = u * cos - v * sin, u * sin + v * cos, s[:, 2]
        slope = np.zeros((len(s), MOTION, self.size))
        for k in (0, 1, 2, 5) if len(theta) else ():
            nudge = NUDGE * np.eye(MOTION)[k]
            ahead, behind = (
                self.problem.force.columns(s[:, :MOTION] + sign * nudge, self.track.inputs) for sign in (1, -1)
            )
            slope[:, :3, k] = (ahead - behind) @ theta / (2 * NUDGE)
        slope[:, range(3), range(MOTION, MOTION + 3)] = 1.0
        slope[:, 3, 0], slope[:, 3, 1], slope[:, 3, 5] = cos, -sin, -rate[:, 4]
        slope[:, 4, 0], slope[:, 4, 1], slope[:, 4, 5] = sin, cos, rate[:, 3]
        slope[:, 5, 2] = 1.0
        return rate, slope

    def _samples(self) -> None:
        """Rows of the samples: what the channels miss, and its derivatives by the sensors' errors.

        A channel that is written down late by tau shows ``s(t - tau) = s - tau ds/dt``.
        """
        faults, values = self.problem.faults, self.now.values[self.problem.own(self.run)]
        shown, self.marks = self.state[:, :MOTION].copy(), np.zeros((len(self.state), MOTION, len(faults)))
        for f, (fault, value) in enumerate(zip(faults, values, strict=True)):
            k = CHANNELS.index(fault.channel)
            self.marks[:, k, f] = -self.rate[:, k] if fault.kind == DELAY else 1.0
            shown[:, k] += value * self.marks[:, k, f]
        self.residual = np.where(self.track.present > 0, shown - self.track.measured, 0.0)
        self.trust = INFORMATION * self.now.weights[self.run] / self.now.noise**2

    def _assemble(self) -> None:
        """The chain of the states, and the parameters' equations with the states taken out."""
        shared, faults = self.problem.shared, len(self.problem.faults)
        left, right = (m.transpose(0, 2, 1) * self.precision[:, None, :] for m in (self.left, self.right))
        diagonal = np.zeros((len(self.state), self.size, self.size))
        diagonal[:-1] += left @ self.left
        diagonal[1:] += right @ self.right
        motion, coloured = np.arange(MOTION), np.arange(MOTION, self.size)
        first = np.tile(1 / self.now.force**2, self.problem.colour.order)
        diagonal[:, motion, motion] += self.trust
        diagonal[0, coloured, coloured] += first
        sides = np.zeros((len(self.state), self.size, 1 + shared + faults))
        wide = np.zeros((len(self.h), self.size, 1 + shared))
        wide[:, :, 0], wide[:, :3, 1:] = self.missed, self.pushed
        sides[:-1, :, : 1 + shared] += left @ wide
        sides[1:, :, : 1 + shared] += right @ wide
        seen = np.concatenate([self.residual[:, :, None], self.marks], axis=2)
        sides[:, :MOTION, [0, *range(1 + shared, 1 + shared + faults)]] += self.trust[:, :, None] * seen
        sides[0, coloured, 0] += self.state[0, MOTION:] * first
        self.chain = Chain(diagonal, right @ self.left)
        self.white = self.chain.whiten(sides)
        gram = np.zeros((1 + shared + faults,) * 2)
        flat = (wide * np.sqrt(self.precision)[:, :, None]).reshape(-1, 1 + shared)
        gram[: 1 + shared, : 1 + shared] = flat.T @ flat
        looked = (seen * np.sqrt(self.trust)[:, :, None]).reshape(-1, 1 + faults)
        own = [0, *range(1 + shared, 1 + shared + faults)]
        gram[np.ix_(own, own)] += looked.T @ looked
        gram[0, 0] += float((self.state[0, MOTION:] ** 2 * first).sum())
        reduced = gram - self.white.T @ self.white
        self.cost, self.normal, self.gradient = 0.5 * float(gram[0, 0]), reduced[1:, 1:], reduced[1:, 0]

    @property
    def log_norm(self) -> float:
        """Logarithm of all normalising constants, the states integrated out."""
        there = self.track.present > 0
        noise = float(np.where(there, 0.5 * np.log(np.where(there, self.trust, 1.0)), 0.0).sum())
        steps = 0.5 * float(np.log(self.precision).sum()) + float(np.linalg.slogdet(self.ahead)[1].sum())
        steps -= self.problem.colour.order * float(np.log(self.now.force).sum())
        return noise + steps - 0.5 * self.chain.log_det

    def moved(self, step: Float[np.ndarray, " p"]) -> Float[np.ndarray, "n s"]:
        """States after a step of the parameters.

        Args:
            step: Step of the run's parameters.

        Returns:
            New states.
        """
        return self.state - self.chain.unwhiten(self.white @ np.concatenate([[1.0], step])[:, None])[:, :, 0]

    @cached_property
    def _by_parameters(self) -> Float[np.ndarray, "n s p"]:
        """How the states follow the parameters."""
        return -self.chain.unwhiten(np.asfortranarray(self.white[:, 1:]))

    def state_covariance(self, covariance: Float[np.ndarray, "q q"]) -> Float[np.ndarray, "n s s"]:
        """Of every sample's state, that of the parameters included.

        Args:
            covariance: Of all parameters.

        Returns:
            One matrix a sample.
        """
        follow = self._by_parameters
        own = covariance[np.ix_(self.places, self.places)]
        return self.chain.covariances[0] + follow @ own @ follow.transpose(0, 2, 1)

    def innovation_variance(self, covariance: Float[np.ndarray, "q q"]) -> Float[np.ndarray, "m c"]:
        """Posterior variance of what is new in the coloured accelerations at each step.

        Args:
            covariance: Of all parameters.

        Returns:
            Variances.
        """
        on, below = (m[:, MOTION:, MOTION:] for m in self.chain.covariances)
        chain = self.ahead @ on[1:] @ self.ahead.transpose(0, 2, 1) + self.behind @ on[:-1] @ self.behind.transpose(
            0, 2, 1
        )
        chain += 2 * self.ahead @ below @ self.behind.transpose(0, 2, 1)
        follow = self._by_parameters[:, MOTION:]
        new = self.ahead @ follow[1:] + self.behind @ follow[:-1]
        own = covariance[np.ix_(self.places, self.places)]
        return np.einsum("nii->ni", chain) + np.einsum("nip,pq,niq->ni", new, own, new)
