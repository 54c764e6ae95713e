"""Whether stretches of recordings agree on the coefficients that are fitted to all of them.

Errors of a fit are those of noise if the equations are right. If they are not, every stretch wants coefficients of its
own, and these differ by more than noise allows: by how much more is how far the errors are too small.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.estimation.collocation import CollocatedRun
from manoeuvre_nn.estimation.problem import Estimate, EstimationProblem

STRETCH = 10.0
"""Length of a stretch over L/U0: longer than the process noise lasts."""
MIN_INFORMATION_RATIO = 4.0
"""A stretch has a say in combinations of coefficients on which it has so many times the prior's information."""
FLOOR_BINDS_BELOW = 1.02
"""Noise over the floor from which on the floor does nothing."""
MIN_FLOOR_SHARE = 0.03
"""Least of a floor that sinks, over where it began."""


class Agreement(NamedTuple):
    """How far stretches disagree on the coefficients.

    Attributes:
        ratio: Squares of what they miss over what noise allows: 1 if the errors are right, 4 if they are half of what
            they should be.
        degrees: Degrees of freedom of that sum of squares.
    """

    ratio: float
    degrees: float


def birge_ratio(problem: EstimationProblem, found: Estimate) -> float:
    """The ratio of :func:`agreement`."""
    return agreement(problem, found).ratio


def agreement(problem: EstimationProblem, found: Estimate) -> Agreement:
    """How far stretches disagree on the coefficients, over what noise allows.

    With a stretch's gradient g and information H at the common coefficients, states taken out, and C their covariance,
    ``g^T H^-1 g`` is about ``rank H - tr(H C)`` if the equations are right.

    Args:
        problem: The problem.
        found: Its solution.

    Returns:
        Sum of the one over sum of the other, and the latter.

    Source:
        Birge 1932 (Phys. Rev. 40:207); for groups of samples White 1982.
    """
    count, scale = problem.shared, problem.spread
    parts = [(k, piece) for k, run in enumerate(problem.recordings) for piece in _pieces(run, STRETCH)]
    cut = replace(problem, recordings=[problem.recordings[k].rows(piece) for k, piece in parts], faults=())
    now = replace(
        found, values=found.values[:count], states=tuple(found.states[k][piece] for k, piece in parts),
        sample_weights=tuple(found.sample_weights[k][piece] for k, piece in parts),
        step_weights=tuple(found.step_weights[k][piece.start : piece.stop - 1] for k, piece in parts),
    )  # fmt: skip
    covariance = found.covariance[:count, :count] / scale[:, None] / scale
    missed, allowed = 0.0, 0.0
    for k in range(len(parts)):
        gram = CollocatedRun(cut, now, k).gram
        one, other = _told(gram[1:, 1:] * scale[:, None] * scale, -gram[1:, 0] * scale, covariance)
        missed, allowed = missed + one, allowed + other
    return Agreement(missed / allowed if allowed > 1 else 1.0, allowed)


def widened(
    covariance: Float[np.ndarray, "p p"], spread: Float[np.ndarray, " p"], ratio: float
) -> Float[np.ndarray, "p p"]:
    """The covariance if the recordings are trusted ``1 / ratio`` as far; the prior is trusted as before.

    Args:
        covariance: Of the coefficients.
        spread: Standard deviation of what they were before.
        ratio: See :func:`birge_ratio`; less than 1 changes nothing.

    Returns:
        A covariance that is at least as large.
    """
    scaled = covariance / spread[:, None] / spread
    sizes, axes = np.linalg.eigh(0.5 * (scaled + scaled.T))
    told = np.maximum(1 / np.clip(sizes, 1e-300, 1.0) - 1, 0.0)
    wider = (axes / (told / max(ratio, 1.0) + 1)) @ axes.T
    return wider * spread[:, None] * spread


def agreed_floor(problem: EstimationProblem, found: Estimate) -> Float[np.ndarray, " 6"]:
    """The floor of the noise at which stretches disagree on the coefficients by what it allows.

    A floor stands for what a model is wrong by, and errors of a model are seen as stretches that disagree. Where they
    agree better than the floor lets them, it is too high: their disagreement over it goes with its square.

    Returns:
        Of u, v, r, x, y, psi: at most that of the problem, at least :data:`MIN_FLOOR_SHARE` of it.
    """
    if (found.noise > FLOOR_BINDS_BELOW * found.floor).all():
        return found.floor
    sunk = found.floor * np.sqrt(birge_ratio(problem, found))
    return np.clip(sunk, MIN_FLOOR_SHARE * problem.floor, problem.floor)


def birge_scaled_covariance(problem: EstimationProblem, found: Estimate) -> tuple[Float[np.ndarray, "p p"], Agreement]:
    """Covariance of the coefficients, as wide as stretches of the recordings disagree.

    Returns:
        The covariance, and the :func:`agreement` by whose ratio it was widened.
    """
    told, count = agreement(problem, found), problem.shared
    return widened(found.covariance[:count, :count], problem.spread, told.ratio), told


def _told(
    normal: Float[np.ndarray, "p p"], gradient: Float[np.ndarray, " p"], covariance: Float[np.ndarray, "p p"]
) -> tuple[float, float]:
    """What a stretch misses in combinations that it tells something of, and what noise allows it to."""
    sizes, axes = np.linalg.eigh(0.5 * (normal + normal.T))
    kept = sizes > MIN_INFORMATION_RATIO
    pulled = axes[:, kept].T @ gradient
    used = np.einsum("ik,ij,jk->k", axes[:, kept], covariance, axes[:, kept]) * sizes[kept]
    return float((pulled**2 / sizes[kept]).sum()), float(np.maximum(1 - used, 0.0).sum())


def _pieces(recording: Recording, stretch: float) -> list[slice]:
    """Even pieces of about that length; the whole where it is shorter."""
    count = max(1, round(recording.duration / stretch))
    edges = np.linspace(0, len(recording), count + 1).astype(int)
    return [slice(a, b) for a, b in zip(edges[:-1], edges[1:], strict=True)]
