"""Which manoeuvre to sail next: what each of several would tell about coefficients."""

from collections.abc import Mapping, Sequence

import numpy as np
import torch
from jaxtyping import Float

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.design.candidates import CandidateRun, ExpectedGain, remark
from manoeuvre_nn.estimation.derivatives import taylor_columns
from manoeuvre_nn.recording.tuples import Tuples
from manoeuvre_nn.ship.taylor import EQUATIONS

MIN_EIGENVALUE_RATIO = 1e-9
"""Smallest eigenvalue of an information matrix over the largest: less is rounding [-]."""

Terms = Mapping[str, Float[np.ndarray, "n k"]]
"""Equation -> columns of its coefficients along a run."""


def information(
    ship: Ship | Particulars, known: Ship, tuples: Tuples, runs: Sequence[CandidateRun], interval: float
) -> tuple[list[ExpectedGain], str]:
    """What the candidates would tell about the coefficients of a regression.

    The coefficients are those of the ship's own products where these are known, else those of Abkowitz' third-order
    series. Noise of the forces is taken to be the same in all samples; it then cancels out. Standard errors are those
    of the force that a term has on average in the recorded samples.

    Args:
        ship: The ship, or its particulars where no more is known.
        known: The known part that the tuples were formed with.
        tuples: What is recorded.
        runs: Candidates as the members sail them; the median of the members' states is taken.
        interval: Time between samples of a recording [s].

    Returns:
        One a candidate, in their order, and what the coefficients are.

    Raises:
        InputError: If there are no candidates.

    Source:
        D-optimal designs: Kiefer & Wolfowitz 1959.
    """
    if not runs:
        raise InputError("candidates=[] names no manoeuvre: write for instance candidates=[zz20,spiral]")
    own = isinstance(ship, Ship) and ship.table is not None
    names = "the ship's own products" if own else "a third-order Taylor series"
    before = _columns(ship, known, tuples)
    sizes = {e: _size(c) for e, c in before.items()}
    matrices = {e: _matrix(c, sizes[e]) for e, c in before.items()}
    found = []
    for run in runs:
        more = _columns(ship, known, _predicted(run, known))
        share = float(run.times[1] - run.times[0]) / interval  # samples of a recording for each of ours
        after = {e: matrices[e] + share * _matrix(more[e], sizes[e]) for e in matrices}
        pairs = {e: (_errors(matrices[e]), _errors(after[e])) for e in matrices}
        count = sum(len(m) for m in matrices.values())
        gain = 0.5 * sum(_log_det(after[e]) - _log_det(matrices[e]) for e in matrices) / count
        now, then = (float(np.exp(np.log(np.concatenate([p[k] for p in pairs.values()])).mean())) for k in (0, 1))
        by = {e: tuple(float(np.exp(np.log(p).mean())) for p in pair) for e, pair in pairs.items()}
        found.append(ExpectedGain(run.manoeuvre.name, run.seconds, now, then, gain, by, remark(run, known.particulars)))  # type: ignore[arg-type]
    return found, names


def _predicted(run: CandidateRun, known: Ship) -> Tuples:
    """Inputs along the median of the members' paths, to where the first is lost; forces are not needed."""
    alive = run.times < float(run.ended.min())
    nu, delta = run.states[:, alive, :3].quantile(0.5, dim=0), run.rudders[:, alive].quantile(0.5, dim=0)
    inputs = torch.cat([nu / known.velocity_units, delta[:, None]], dim=-1)
    return Tuples(inputs, torch.zeros_like(nu), run.times[alive], torch.zeros(len(nu), dtype=torch.long))


def _columns(ship: Ship | Particulars, known: Ship, tuples: Tuples) -> Terms:
    """Columns of the coefficients of X, Y and N."""
    if isinstance(ship, Ship) and ship.table is not None:
        with torch.no_grad():
            products = ship.products(tuples.inputs[:, :3] * known.velocity_units, tuples.inputs[:, 3])
        columns = products.double().numpy()
        return {e: columns[:, (ship.table[:, k] != 0).numpy()] for k, e in enumerate(EQUATIONS)}
    return taylor_columns(tuples, known)


def _size(columns: Float[np.ndarray, "n k"]) -> Float[np.ndarray, " k"]:
    """Root mean square of each column; 1 for one of zeros."""
    size = np.sqrt(np.square(columns).mean(axis=0))
    return np.where(size > 1e-12, size, 1.0)


def _matrix(columns: Float[np.ndarray, "n k"], size: Float[np.ndarray, " k"]) -> Float[np.ndarray, "k k"]:
    scaled = columns / size
    return scaled.T @ scaled


def _eigen(matrix: Float[np.ndarray, "k k"]) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues, none below rounding, and eigenvectors."""
    values, vectors = np.linalg.eigh(matrix)
    return np.maximum(values, MIN_EIGENVALUE_RATIO * len(matrix)), vectors


def _log_det(matrix: Float[np.ndarray, "k k"]) -> float:
    return float(np.log(_eigen(matrix)[0]).sum())


def _errors(matrix: Float[np.ndarray, "k k"]) -> Float[np.ndarray, " k"]:
    """Standard errors for noise of 1."""
    values, vectors = _eigen(matrix)
    return np.sqrt((np.square(vectors) / values).sum(axis=1))
