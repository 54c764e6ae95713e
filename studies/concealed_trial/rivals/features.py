"""A case as numbers of one length, for a network: what the calm-water errors have in common with terms, and their run.

All is taken from the errors made white under what every case has (instruments, coefficients, rough water), so that a
clean case gives numbers of variance one whatever the ship and the runs.
"""

import numpy as np
from jaxtyping import Float

from studies.concealed_trial.rivals.sindy import TERMS, library
from studies.concealed_trial.rivals.track import ROWS, SmoothedTrack
from studies.concealed_trial.rivals.whitened import WhitenedRuns

MORE_TERMS = ("delta rate", "udot", "vdot", "rdot", "vr", "|r|", "|d|", "late", "middle")
"""Beside :data:`.TERMS`: what moving rudders, masses, depth and trim, symmetry and events show in."""
RIDGE = 1.0
"""Added to the diagonal of the terms' correlations."""
THIRDS = 3
"""Parts of a run that are looked at one by one."""
SHIPS_LENGTHS_M = (160.0, 300.0)
"""Lengths that count as 0 and 1."""


def features(data: WhitenedRuns) -> Float[np.ndarray, " f"]:
    """Numbers of a case.

    Args:
        data: Its runs to fit.

    Returns:
        For every row and term the correlation and the joint coefficient, in standard deviations; energy, energy by
        thirds of a run, correlation with the next average and largest sum of every row; the size of the ship.
    """
    white = data.seen(data.errors[..., None])[..., 0]
    table = np.concatenate([t.averaged(terms(t)) for t in data.tracks])
    columns = np.einsum("bt,rs->brst", table, np.eye(len(ROWS))).reshape(*data.errors.shape, -1)
    columns = data.seen(columns).reshape(white.size, -1)
    columns /= np.linalg.norm(columns, axis=0) + 1e-9
    along = columns.T @ white.ravel()
    joint = np.linalg.solve(columns.T @ columns + RIDGE * np.eye(len(along)), along)
    shape = np.concatenate([_course(white[part]) for part in data.parts]).reshape(len(data.parts), -1)
    p = data.dynamics.particulars
    size = (p.length - SHIPS_LENGTHS_M[0]) / (SHIPS_LENGTHS_M[1] - SHIPS_LENGTHS_M[0])
    extra = [size, p.draught / p.beam, len(data.parts) - 2.0]
    return np.concatenate([np.arcsinh(along), np.arcsinh(joint), shape.mean(axis=0), shape.std(axis=0), extra])


def terms(t: SmoothedTrack) -> Float[np.ndarray, "n t"]:
    """All terms along a run.

    Args:
        t: The run on its track.

    Returns:
        One column for each of ``TERMS`` and ``MORE_TERMS``.
    """
    speed, turn, step = t.unit[3], t.unit[4], t.run.step
    nu, d = t.states[:, :3] / [speed, speed, turn], t.run["delta"]
    rates = np.gradient(np.column_stack([d, nu]), step, axis=0) / turn
    share = t.run.time / t.run.time[-1]
    more = [nu[:, 1] * nu[:, 2], np.abs(nu[:, 2]), np.abs(d), share > 2 / 3, (share > 1 / 3) & (share <= 2 / 3)]
    return np.column_stack([library(t), rates, *more])


def _course(white: Float[np.ndarray, "b 6"]) -> Float[np.ndarray, " k"]:
    """Energy of every row, by thirds, its correlation with the next average and its largest sum."""
    energy = [np.mean(part**2, axis=0) for part in (white, *np.array_split(white, THIRDS))]
    next_one = (white[1:] * white[:-1]).mean(axis=0)
    largest = np.abs(np.cumsum(white, axis=0)).max(axis=0) / np.sqrt(len(white))
    return np.arcsinh(np.concatenate([*energy, next_one, largest]))


COUNT = 2 * len(ROWS) * (len(TERMS) + len(MORE_TERMS)) + 2 * len(ROWS) * (3 + THIRDS) + 3
"""Numbers of a case."""

ODD_ROWS = ("Y", "N", "gyro")
ODD_TERMS = ("v", "r", "d", "rrr", "ddd", "ud", "sin", "sin2", "delta rate", "vdot", "rdot")
"""What changes its sign where starboard and port are exchanged."""


def mirrored(found: Float[np.ndarray, "n f"]) -> Float[np.ndarray, "n f"]:
    """Numbers of the cases as seen in a mirror, starboard for port.

    Args:
        found: Numbers of cases.

    Returns:
        Those of their images.
    """
    rows = np.where(np.isin(ROWS, ODD_ROWS), -1.0, 1.0)
    columns = np.where(np.isin((*TERMS, *MORE_TERMS), ODD_TERMS), -1.0, 1.0)
    signs = np.tile(np.outer(rows, columns).ravel(), 2)
    return found * np.concatenate([signs, np.ones(found.shape[1] - len(signs))])
