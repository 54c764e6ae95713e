"""Process noise: accelerations that no model explains, and how they go on from sample to sample.

Source:
    Rasmussen & Williams 2006, Gaussian Processes for Machine Learning, section 4.2.1 and appendix B; Hartikainen &
    Sarkka 2010 (IEEE MLSP) for the same as a chain of states.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

AXES = 3
"""Surge, sway, yaw."""


@dataclass(frozen=True)
class ProcessNoise:
    """A stationary Gaussian process for each acceleration, of the same correlation time.

    Its covariance over the variance is that of Ornstein and Uhlenbeck, ``exp(-|t|)``: what gusts and missing terms do;
    or, ``smooth``, Matern's of order 3/2, ``(1 + |t|) exp(-|t|)``: the acceleration has a rate, which is a state as
    well (times the correlation time, so that it has the acceleration's variance): what a whole ship does.

    Attributes:
        time: Correlation time.
        smooth: Which of the two.
        axes: Number of accelerations: 4 of a ship that rolls.
    """

    time: float = 1.0
    smooth: bool = False
    axes: int = AXES

    @property
    def order(self) -> int:
        """States of each acceleration."""
        return 2 if self.smooth else 1

    @property
    def size(self) -> int:
        """States: the accelerations, then their rates if they are smooth."""
        return self.axes * self.order

    def steps(self, h: Float[np.ndarray, " m"]) -> tuple[Float[np.ndarray, "m c c"], Float[np.ndarray, "m c c"]]:
        """Innovations of the steps, ``left a_k + right a_{k+1}``: white, with the variance of the process."""
        x = h / self.time
        decay = np.exp(-x)
        if self.smooth:
            shift = np.array([[[1 + k, k], [-k, 1 - k]] for k in x]) * decay[:, None, None]
        else:
            shift = decay[:, None, None]
        # Of the stationary variance a step keeps shift shift^T; the rest is new.
        right = np.linalg.inv(np.linalg.cholesky(np.eye(self.order) - shift @ shift.transpose(0, 2, 1)))
        eye = np.eye(self.axes)
        return np.kron(-right @ shift, eye), np.kron(right, eye)


def drawn_process(
    rng: np.random.Generator, time: Float[np.ndarray, " n"], correlation_time: float, shape: tuple[int, ...]
) -> Float[np.ndarray, "n *shape"]:
    """Courses of Ornstein and Uhlenbeck's process with variance 1.

    Args:
        rng: Source of chance.
        time: Sample times [s].
        correlation_time: Its correlation time [s].
        shape: Of the courses, which are independent.

    Returns:
        Time first.
    """
    courses = rng.standard_normal((len(time), *shape))
    keep = np.exp(-np.diff(time) / correlation_time)
    for k, share in enumerate(keep, 1):
        courses[k] = share * courses[k - 1] + np.sqrt(1 - share**2) * courses[k]
    return courses
