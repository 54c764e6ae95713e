"""How the coloured accelerations of a joint estimation (:mod:`.joint`) go on from sample to sample.

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
class Colour:
    """A stationary Gaussian process for each of three accelerations, of the same correlation time.

    Rough, it is that of Ornstein and Uhlenbeck, ``exp(-|t|)``: what gusts and missing terms do. Smooth, it is Matern's
    of order 3/2, ``(1 + |t|) exp(-|t|)``: the acceleration has a rate, which is a state as well (times the correlation
    time, so that it has the acceleration's variance): what a whole ship does.

    Attributes:
        time: Correlation time.
        smooth: Which of the two.
    """

    time: float = 1.0
    smooth: bool = False

    @property
    def order(self) -> int:
        """States of each acceleration."""
        return 2 if self.smooth else 1

    @property
    def size(self) -> int:
        """States: the accelerations, then their rates if they are smooth."""
        return AXES * self.order

    def steps(self, h: Float[np.ndarray, " m"]) -> tuple[Float[np.ndarray, "m c c"], Float[np.ndarray, "m c c"]]:
        """Rows of the steps from a sample to the next, ``behind a_k + ahead a_{k+1}``: white, of the process' variance.

        Args:
            h: Steps of time.

        Returns:
            What is multiplied by the state before (behind) and after it (ahead).
        """
        x = h / self.time
        decay = np.exp(-x)
        if self.smooth:
            shift = np.array([[[1 + k, k], [-k, 1 - k]] for k in x]) * decay[:, None, None]
        else:
            shift = decay[:, None, None]
        # Of the stationary variance a step keeps shift shift^T; the rest is new.
        ahead = np.linalg.inv(np.linalg.cholesky(np.eye(self.order) - shift @ shift.transpose(0, 2, 1)))
        eye = np.eye(AXES)
        return np.kron(-ahead @ shift, eye), np.kron(ahead, eye)
