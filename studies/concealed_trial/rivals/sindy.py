"""Sparse regression of the errors on a library of terms by pySINDy, and the errors as seen through what it found.

Through this glass a hypothesis is judged by how well its own contribution, projected on the library, agrees with the
terms that were found; nothing else of the recording counts.
"""

import warnings
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.recording import Recording
from studies.concealed_trial.rivals.package import Model
from studies.concealed_trial.rivals.track import ROWS, SmoothedTrack
from studies.concealed_trial.rivals.whitened import WhitenedRuns

TERMS = ("1", "u", "v", "r", "d", "uu", "rr", "dd", "rrr", "ddd", "ud", "cos", "sin", "cos2", "sin2")
"""Prime velocities (u less the approach speed), rudder angle, and harmonics of the heading."""
THRESHOLD, RIDGE = 3.0, 0.05
"""Of sequentially thresholded least squares, in standard deviations; columns have norm one."""


class Terms(WhitenedRuns):
    """The runs as a sparse model sees them.

    Attributes:
        found: Coefficient of every term in every row.
    """

    def __init__(self, dynamics: Model, runs: Sequence[Recording]) -> None:
        """Find the terms.

        Args:
            dynamics: Calm-water model.
            runs: The runs.
        """
        super().__init__(dynamics, runs)
        table = np.concatenate([t.averaged(library(t)) for t in self.tracks])
        columns = np.einsum("bt,rs->brst", table, np.eye(len(ROWS))).reshape(*self.errors.shape, -1)
        white = super().seen(columns).reshape(self.errors.size, -1)
        self._calm = super().seen(self.errors[..., None]).reshape(-1, 1)
        found = sparse(white, self._calm)
        self.found = found.reshape(len(ROWS), len(TERMS))
        self._basis = np.linalg.qr(white)[0]
        self._off = (white @ found)[:, None] - self._calm

    def seen(self, errors: Float[np.ndarray, "b 6 k"]) -> Float[np.ndarray, "n rows k"]:
        """What of the found terms is left, projected on the library.

        Args:
            errors: Averaged errors, one column a hypothesis.

        Returns:
            Independent numbers of variance one: as many in each row as there are terms.
        """
        white = super().seen(errors).reshape(self.errors.size, -1)
        return (self._basis.T @ (white + self._off)).reshape(len(ROWS), len(TERMS), -1).swapaxes(0, 1)


def library(t: SmoothedTrack) -> Float[np.ndarray, "n t"]:
    """All terms along a run.

    Args:
        t: The run on its track.

    Returns:
        One column a term.
    """
    speed, turn = t.unit[3], t.unit[4]
    nu, psi, d = t.states[:, :3] / [speed, speed, turn], t.channels[:, 4], t.run["delta"]
    z = {"u": nu[:, 0] - 1, "v": nu[:, 1], "r": nu[:, 2], "d": d}
    made = {term: np.prod([z[letter] for letter in term], axis=0) for term in TERMS if set(term) <= set(z)}
    made |= {"1": np.ones_like(d), "cos": np.cos(psi), "sin": np.sin(psi)}
    made |= {"cos2": np.cos(2 * psi), "sin2": np.sin(2 * psi)}
    return np.stack([made[term] for term in TERMS], axis=-1)


def sparse(columns: Float[np.ndarray, "m t"], target: Float[np.ndarray, "m 1"]) -> Float[np.ndarray, " t"]:
    """Sparse regression (Brunton, Proctor & Kutz 2016).

    Args:
        columns: Terms, white.
        target: What they are to explain.

    Returns:
        Coefficients, most of them 0.

    Raises:
        InputError: If pySINDy is not installed.
    """
    try:
        import pysindy
    except ImportError:
        raise InputError('method=pysindy needs pySINDy: write pip install -e ".[rivals]"') from None
    optimizer = pysindy.STLSQ(threshold=THRESHOLD, alpha=RIDGE, normalize_columns=True)
    model = pysindy.SINDy(optimizer=optimizer, feature_library=pysindy.IdentityLibrary())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that every term fell: calm water
        model.fit(columns, t=1.0, x_dot=target)
    return np.asarray(model.coefficients())[0]
