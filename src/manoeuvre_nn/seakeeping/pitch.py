"""Significant heave and pitch of a ship in a long-crested random sea."""

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from jaxtyping import Complex, Float

from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.seakeeping.closed_form import box_motions
from manoeuvre_nn.seakeeping.form import S175, HullForm
from manoeuvre_nn.seakeeping.motions import heave_and_pitch
from manoeuvre_nn.seakeeping.panels import panelled
from manoeuvre_nn.seakeeping.radiation import Radiation, radiate
from manoeuvre_nn.seakeeping.spectra import WaveSpectrum
from manoeuvre_nn.seakeeping.strips import radiate_strips

METHODS = ("closed_form", "strip_theory", "boundary_element")
WAVES = np.geomspace(0.08, 1.6, 120)
"""Wave frequencies of the integrals over the sea [rad/s], for a ship of 175 m: times sqrt(175 m/L) for others."""
NO_SEA_BELOW = 0.4
"""Frequency over that of zero crossings below which a sea has no waves (4e-6 of its energy)."""
MOTIONS = np.concatenate([[0.02, 0.05, 0.1, 0.15], np.linspace(0.2, 1.4, 25), np.linspace(1.5, 3.0, 11)])
"""Frequencies at which the potentials are solved for [rad/s], likewise."""
REFERENCE_LENGTH = 175.0
DRAUGHT_STEPS = 8
"""Potentials are solved for at multiples of the design draught over this number."""
FIRST_STEP, LAST_STEP = 2, 11
MIN_DRAUGHT_RATIO, MAX_DRAUGHT_RATIO = 0.3, 1.3
"""Range of draughts over the design draught."""

Progress = Callable[[str], None]


def significant_pitch(
    conditions: Float[np.ndarray, "n 5"], method: str, form: HullForm | None = None, progress: Progress | None = None
) -> Float[np.ndarray, " n"]:
    """Significant pitch amplitude, ``2 sqrt(m0)``; see :func:`significant_motions`.

    Args:
        conditions: Draught [m], speed [m/s], heading [rad], significant wave height [m], zero-crossing period [s].
        method: ``closed_form``, ``strip_theory`` or ``boundary_element``.
        form: The hull; None is the S-175.
        progress: Told what is being solved.

    Returns:
        psi_1/3 [rad].
    """
    return significant_motions(conditions, method, form, progress)[:, 1]


def significant_motions(
    conditions: Float[np.ndarray, "n 5"], method: str, form: HullForm | None = None, progress: Progress | None = None
) -> Float[np.ndarray, "n 2"]:
    """Significant amplitudes of heave and pitch, ``2 sqrt(m0)`` with ``m0 = int S |H|^2 dw``.

    S is Bretschneider's spectrum of a long-crested sea over wave frequency, so that overtaken waves need no care. The
    heading is the direction that the waves run to, off the bow: **0 is a following, pi a head sea**. Draughts outside
    .3 to 1.3 design draughts, ships that go astern, seas that are none and seas too long for the ship are refused.

    Args:
        conditions: Draught d [m], speed V [m/s], heading beta [rad], significant wave height H_s [m] and mean
            zero-crossing period T_z [s] in each row.
        method: ``closed_form``: a box, at once, a first estimate. ``strip_theory``: seconds, the one to take.
            ``boundary_element``: the flow in three dimensions by capytaine, half a minute; a check on the strips.
        form: The hull; None is the S-175.
        progress: Told what is being solved.

    Returns:
        Heave [m] and pitch [rad].
    """
    check_choice("method", method, METHODS)
    form = form or S175
    _check(conditions, form)
    frequency = WAVES * np.sqrt(REFERENCE_LENGTH / form.length)
    draught, speed, heading = conditions[:, :3].T
    if method == "closed_form":
        squares = box_motions(form, frequency, draught, speed, heading) ** 2
    else:
        squares = np.abs(transfer_functions(form, frequency, conditions[:, :3], method, progress)) ** 2
    seas = (WaveSpectrum.bretschneider(height, period) for height, period in conditions[:, 3:].tolist())
    density = np.stack([sea.density(frequency) for sea in seas])
    return np.asarray(2 * np.sqrt(np.trapezoid(density[:, :, None] * squares, frequency, axis=1)))


def transfer_functions(
    form: HullForm,
    frequency: Float[np.ndarray, " waves"],
    conditions: Float[np.ndarray, "n 3"],
    method: str = "strip_theory",
    progress: Progress | None = None,
) -> Complex[np.ndarray, "n waves 2"]:
    """Transfer functions of heave and pitch at any draught.

    They are solved at fixed steps of draught and interpolated by the cubic through the four nearest ones, so that the
    answer does not depend on what else is asked for. Solved hulls stay in memory.

    Args:
        form: The hull.
        frequency: Wave frequencies [rad/s].
        conditions: Draught [m], speed [m/s] and heading [rad] in each row.
        method: ``strip_theory`` or ``boundary_element``.
        progress: Told what is being solved.

    Returns:
        Heave up [m/m] and pitch bow up [rad/m], as in :func:`heave_and_pitch`.
    """
    steps = conditions[:, 0] / form.draught * DRAUGHT_STEPS
    first = np.clip(np.floor(steps).astype(int) - 1, FIRST_STEP, LAST_STEP - 3)
    answer = np.zeros((len(conditions), len(frequency), 2), dtype=complex)
    needed = np.unique(first[:, None] + np.arange(4))
    for at, step in enumerate(needed.tolist()):
        if progress is not None:
            draught = step * form.draught / DRAUGHT_STEPS
            progress(f"heave and pitch at draught {draught:.2f} m ({at + 1} of {len(needed)})")
        radiation = _solved(form, step, method)
        rows = np.flatnonzero((first <= step) & (step < first + 4))
        courses, place = np.unique(conditions[rows, 1:], axis=0, return_inverse=True)
        found = np.stack([heave_and_pitch(radiation, frequency, *course) for course in courses.tolist()])
        answer[rows] += _weight(steps[rows], first[rows], step)[:, None, None] * found[place.reshape(-1)]
    return answer


def _weight(steps: Float[np.ndarray, " n"], first: np.ndarray, step: int) -> Float[np.ndarray, " n"]:
    """Lagrange's weight of a node among the four from the first on: ``prod (s - n_j)/(n - n_j)``."""
    weight = np.ones_like(steps)
    for other in first + np.arange(4)[:, None]:
        weight *= np.where(other == step, 1.0, (steps - other) / np.where(other == step, 1.0, step - other))
    return weight


@lru_cache(maxsize=64)
def _solved(form: HullForm, step: int, method: str) -> Radiation:
    """The hull at a step of draught."""
    frequency, draught = MOTIONS * np.sqrt(REFERENCE_LENGTH / form.length), step * form.draught / DRAUGHT_STEPS
    if method == "strip_theory":
        return radiate_strips(panelled(form, draught, girthwise=10), frequency)
    return radiate(panelled(form, draught), frequency)


def _check(conditions: Float[np.ndarray, "n 5"], form: HullForm) -> None:
    """Refuse draughts that the form does not reach, ships that go astern, and seas that are none."""
    low, high = MIN_DRAUGHT_RATIO * form.draught, MAX_DRAUGHT_RATIO * form.draught
    draught, speed, _, height, period = conditions.T
    if not (np.isfinite(conditions).all() and low <= draught.min() and draught.max() <= high):
        raise InputError(
            f"draught {draught.min():g} to {draught.max():g} m: write {low:.3g} to {high:.3g} m for this hull"
        )
    if speed.min() < 0 or height.min() <= 0 or period.min() <= 0:
        raise InputError(
            "a speed is below 0, or a wave height or period is not above 0: write speeds ahead and real seas"
        )
    longest = 2 * np.pi * NO_SEA_BELOW / (WAVES[0] * np.sqrt(REFERENCE_LENGTH / form.length))
    if period.max() > longest:
        raise InputError(
            f"period {period.max():g} s is too long a sea for {form.length:g} m: write up to {longest:.3g} s"
        )
