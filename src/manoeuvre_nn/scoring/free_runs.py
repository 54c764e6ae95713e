"""Errors of free runs beside recordings, channel by channel, and all of them in one number."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from manoeuvre_nn.core.particulars import Particulars

SCALES = {"pos": 0.02, "psi": 0.5, "u": 0.1, "v": 0.1, "r": 0.03, "u_log": 0.1}
"""Errors that count as one on a ship: position in lengths, deg, m/s, m/s, deg/s, m/s."""
SCALE_POWERS = (0.0, 0.0, 0.5, 0.5, -0.5, 0.5)
"""Exponents of length with which they go."""


def errors(prediction: pd.DataFrame, record: pd.DataFrame) -> dict[str, float]:
    """RMS errors of a prediction; pos is the distance.

    Args:
        prediction: x, y [m], psi [deg], u, v [m/s], r [deg/s], u_log [m/s].
        record: The same at the same times; NaN where nothing was recorded.

    Returns:
        pos [m], psi [deg], u, v [m/s], r [deg/s], u_log [m/s]; NaN for a channel that was not recorded.
    """
    off = prediction[["x", "y", "psi", "u", "v", "r", "u_log"]] - record[["x", "y", "psi", "u", "v", "r", "u_log"]]
    off["psi"] = (off["psi"] + 180) % 360 - 180
    off["pos"] = np.hypot(off["x"], off["y"])
    return {c: float(np.sqrt((off[c] ** 2).mean())) for c in SCALES}


def counted_as_one(ship: Particulars) -> dict[str, float]:
    """Errors that count as one: pos [L], psi [deg], u, v [m/s], r [deg/s], u_log [m/s]; models' by Froude's law."""
    return dict(zip(SCALES, ship.sized(list(SCALES.values()), SCALE_POWERS).tolist(), strict=True))


def cost(wrong: Sequence[Mapping[str, float]], ship: Particulars) -> float:
    """One number for the errors of several runs: the root mean square over channels in units of ``counted_as_one``.

    Args:
        wrong: Of every run what :func:`errors` gives.
        ship: For the units.

    Returns:
        The cost; 0 without runs.
    """
    if not wrong:
        return 0.0
    scale = counted_as_one(ship)
    scale["pos"] *= ship.length
    rows = [[of_run[c] / scale[c] for c in SCALES] for of_run in wrong]
    return float(np.sqrt(np.nanmean(np.square(rows))))  # channels that were not recorded are not fitted
