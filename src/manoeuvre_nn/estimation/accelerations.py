"""Accelerations out of recorded velocities."""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from manoeuvre_nn.core.channels import ACCELERATION
from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.estimation.smoother import smoothed_jointly
from manoeuvre_nn.recording.local_cubics import WINDOW, smoothed

Method = Literal["exact", "central", "smoother", "joint"]
METHODS = ("exact", "central", "smoother", "joint")
SMOOTHED = ("u", "v", "r", "x", "y", "psi")
"""Channels that the smoother replaces; all by the same filter."""


def accelerations(
    recording: Recording, method: Method = "smoother", *, delays: Sequence[str] = (), offsets: Sequence[str] = ()
) -> Recording:
    """Add the channels udot, vdot, rdot.

    ``exact`` takes those that a simulation gives. ``central`` forms central differences, one-sided at the ends.
    ``smoother`` fits local cubics over .8 L/U0 (Savitzky-Golay) and takes their values and slopes; it replaces u, v, r,
    x, y and psi by the smoothed ones, so that inputs and accelerations belong together. One linear filter for all of
    them keeps ``psidot = r`` wherever the raw channels have it. A recording that does not say its ship's L/U0
    (``meta["time_unit"]``) is smoothed by a spline whose smoothness generalized cross-validation chooses. ``joint``
    smooths all channels at once, with standard deviations, and finds what sensors are late by (:mod:`.smoother`).

    RMS error of udot, vdot, rdot over the standard deviation of the true ones, Mariner zz35 with white noise of .5 % of
    the standard deviation on u, v, r, psi and .5 m on x, y, medians of 8 seeds; and the part of the KVLCC2's measured
    accelerations (HSVA, 20/5 zigzag, 20 Hz) that no cubic polynomial of u, v, r and the rudder explains
    (``benchmarks/accelerations.py``):

    | | zz35, 1 Hz | zz35, 10 Hz | 1 Hz, r late by 2 s | measured |
    |---|---|---|---|---|
    | central differences | .317 .109 .098 | 3.09 1.06 .939 | .317 .109 .187 | .825 .277 .047 |
    | local cubics, .8 L/U0 | .060 .023 .030 | .026 .011 .024 | .060 .023 .160 | .098 .031 .059 |
    | local parabolas, .4 L/U0 | .063 .026 .036 | .031 .014 .028 | .063 .026 .160 | .107 .026 .050 |
    | spline, cross-validated | .045 .025 .037 | .025 .014 .021 | .045 .025 .159 | .828 .308 .047 |
    | joint | .044 .020 .028 | .024 .010 .015 | .044 .020 .116 | .064 .030 .046 |
    | joint, ``delays=[r]`` | .044 .020 .032 | .024 .010 .016 | .044 .020 .027 | .063 .029 .046 |

    The spline adapts to white noise by itself, but takes the correlated errors of real sensors for the ship's motion.
    ``joint`` adapts too, and averages these away first; its errors are .72 to .99 of what it states for u, v, r and
    their rates (1.3 for r and rdot where r is late and nobody asks). It is not the default all the same: a Taylor
    series on its accelerations predicts no better than one on those of local cubics (``benchmarks/noise.py``: zz20 .071
    and .067 L with .5 % of noise, .30 and .15 L with 2 %), unless a sensor is late (r by 2 s: .064 and .423 L, .31 and
    .48 L).

    Args:
        recording: Velocities over time.
        method: ``exact``, ``central``, ``smoother`` or ``joint``.
        delays: Channels whose sensor may be late; for ``joint``.
        offsets: Channels whose sensor may be off; for ``joint``.

    Returns:
        The recording with udot, vdot [m/s^2], rdot [rad/s^2].

    Raises:
        InputError: If the method is unknown or has no delays and offsets, or exact accelerations are asked for and
            missing.
    """
    check_choice("accelerations", method, METHODS)
    check_sensors(method, delays, offsets)
    if method == "joint":
        return smoothed_jointly(recording, delays, offsets)
    if method == "exact":
        if any(name not in recording.channels for name in ACCELERATION):
            raise InputError(
                f"recording {recording.name} has no exact accelerations, only simulations do: write "
                "accelerations=smoother"
            )
        return recording
    return _central(recording) if method == "central" else _local_cubics(recording)


def _central(recording: Recording) -> Recording:
    """Central differences of u, v and r."""
    edge: Literal[1, 2] = 2 if len(recording) > 2 else 1
    slopes = {f"{k}dot": np.gradient(recording[k], recording.time, edge_order=edge) for k in ("u", "v", "r")}
    return recording.with_channels(**slopes)


def _local_cubics(recording: Recording) -> Recording:
    """All channels by one filter, with the slopes of u, v and r; by splines where L/U0 is not known."""
    given = [k for k in SMOOTHED if k in recording.channels]
    unit = recording.meta.get("time_unit")
    smooth = {k: smoothed(recording.time, recording[k], None if unit is None else WINDOW * unit) for k in given}
    values = {k: value for k, (value, _) in smooth.items()}
    return recording.with_channels(**values, **{f"{k}dot": smooth[k][1] for k in ("u", "v", "r")})


def check_sensors(method: str, delays: Sequence[str], offsets: Sequence[str]) -> None:
    """Refuse delays and offsets where nothing estimates them.

    Args:
        method: How accelerations are formed.
        delays: Channels whose sensor may be late.
        offsets: Channels whose sensor may be off.

    Raises:
        InputError: If there are any, and the method is not ``joint``; or one is no channel.
    """
    for setting, names in (("delays", delays), ("offsets", offsets)):
        if names and method != "joint":
            raise InputError(
                f"data.{setting}=[{','.join(names)}] is estimated by data.accelerations=joint only, not by {method}: "
                f"write that, or leave data.{setting} out"
            )
        for name in names:
            check_choice(f"data.{setting}", name, SMOOTHED)


def taken_away(raw: Sequence[Recording], smooth: Sequence[Recording]) -> dict[str, float]:
    """What smoothing took away: an estimate of the sensors' noise, too small by the noise that is left.

    Returns:
        Channel -> standard deviation [SI and radians].
    """
    pairs = list(zip(raw, smooth, strict=True))
    names = [k for k in SMOOTHED if all(k in r.channels for r in raw)]
    return {k: float(np.concatenate([r[k] - s[k] for r, s in pairs]).std()) for k in names}
