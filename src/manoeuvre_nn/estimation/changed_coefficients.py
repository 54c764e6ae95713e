"""What an error of a coefficient does to a ship that effects have changed.

Shallow water multiplies the hull's terms, a smaller rudder those of the rudder, a heavier ship divides them all by her
inertia: what a term's published coefficient is wrong by is multiplied as well. With T the table, c its relative errors
and D_t what effects add to term t (X, Y, N by X, Y, N), forces are ``sum_t phi_t T_t (1 + c_t) (1 + D_t)`` and
accelerations these over ``M' + dM'``. So a hypothesis has the columns ``B G`` for the errors where calm water has B, G
of the hypothesis' values: a recombination, for which no column need be made or whitened again. Left out are what G
brings from a term of one equation to another equation that has no such term, and what a wrong inertia does to the
effect's own force.
"""

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float

from manoeuvre_nn.core.effect import Effect, Situation
from manoeuvre_nn.estimation.corrections import Calibrated, Corrections
from manoeuvre_nn.estimation.data_set import WhitenedDataSet
from manoeuvre_nn.estimation.effect_columns import hulls_beside
from manoeuvre_nn.estimation.hypothesis import Hypothesis


def changed_base(
    data_set: WhitenedDataSet, hypothesis: Hypothesis, *, combined: bool = True
) -> tuple[Float[np.ndarray, "b b"], ...]:
    """Base columns of every run under a hypothesis as combinations of those of calm water.

    With ``c = rotation z``, ``K = G - 1`` and the runs linearised about c0, errors z have ``B (1 + seen K rotation)``
    and the data have ``B seen K c0`` more.

    Args:
        data_set: The runs.
        hypothesis: At its values.
        combined: Whether the base has the data set's combinations of coefficients, else every coefficient.

    Returns:
        One matrix a run, for data, coefficients and latency; none where no effect multiplies coefficients.
    """
    made: dict[bytes, Float[np.ndarray, "k k"] | None] = {}
    found = []
    for run, prepared in enumerate(data_set.runs):
        values = [v[run] for v in hypothesis.values]
        key = b"".join(v.tobytes() for v in values)
        if key not in made:
            made[key] = change_of_coefficients(data_set.corrections, hypothesis.effects, values)
        change = made[key]
        if change is None:
            return ()
        about, seen = prepared.linearised.rate.dynamics, data_set.seen @ change if combined else change
        turned = np.eye(2 + len(seen))
        turned[1:-1, 1:-1] += seen @ data_set.rotation if combined else seen
        if isinstance(about, Calibrated):
            turned[1:-1, 0] = seen @ about.shares.numpy()
        found.append(turned)
    return tuple(found)


def change_of_coefficients(
    corrections: Corrections, effects: Sequence[Effect], values: Sequence[Float[np.ndarray, " p"]]
) -> Float[np.ndarray, "k k"] | None:
    """What effects make of unit errors of coefficients beside what these do in calm water, in units of these.

    Args:
        corrections: The errors.
        effects: Effects of a run.
        values: Their values.

    Returns:
        K, one column an error; None if nothing changes.
    """
    total = None
    for number, (effect, value) in enumerate(zip(effects, values, strict=True)):
        acting = effect.at(effect.values.new_tensor(value))
        added = acting.changed_terms() if corrections.fits(effect.ship) else None
        own = effect.overrides("with_changed_inertia")
        if added is None and not own:
            continue
        # By rows, moved = 1 @ moved: what unit accelerations are once the inertia has changed.
        moved = _moved(corrections, [acting] if own else hulls_beside(effects, values, number))
        change = _of_one(corrections, None if added is None else added.numpy(), moved, own)
        total = change if total is None else total + change
    return total


def _moved(corrections: Corrections, hulls: Sequence[Effect]) -> Float[np.ndarray, "3 3"]:
    """Prime accelerations with changed inertia, of one in surge, sway and yaw (rows)."""
    hull = corrections.dynamics.hull
    units = torch.diag(hull.acceleration_units)
    zero = hull.inertia.new_zeros(3)
    nu = torch.stack([zero + hull.particulars.speed, zero, zero], dim=-1)
    s, rows = Situation(nu, 0 * nu, zero, zero, zero, zero, zero + 1, zero), units
    for effect in hulls:
        rows = effect.with_changed_inertia(s, rows)
    return (rows / hull.acceleration_units).numpy()


def _of_one(
    corrections: Corrections, added: Float[np.ndarray, "terms 3 3"] | None, moved: Float[np.ndarray, "3 3"], own: bool
) -> Float[np.ndarray, "k k"]:
    """K of one effect: of its own inertia too, or of its force alone."""
    terms, still = corrections.of_terms(), np.eye(3) * own
    change = np.zeros((len(corrections.names),) * 2)
    place = {(equation, term): (k, size) for k, equation, term, _, size in terms}
    to_acceleration = corrections.dynamics.hull.inertia_inverse.T.numpy()
    of_force = to_acceleration @ moved @ np.linalg.inv(to_acceleration)
    for k, equation, term, row, size in terms:
        # f -> a by f A; with the effect f (1 + D) A V, and that as a force again by A^-1.
        if row is None:
            new = own * moved[equation] - still[equation]
        else:
            new = ((still + (0 if added is None else added[row])) @ of_force)[equation] - still[equation]
        for other in np.flatnonzero(new):
            at, unit = place.get((int(other), term), (k, np.inf))
            change[at, k] += new[other] * size / unit
    return change
