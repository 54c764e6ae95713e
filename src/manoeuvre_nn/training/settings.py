"""Checks of what a person sets for the data, made before any computing starts."""

from collections.abc import Mapping, Sequence
from math import ceil, isnan
from pathlib import Path

from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.recording.read.reader import recordings_in

NOISE_UNITS = {
    "u": ("u", 1.0), "v": ("v", 1.0), "x": ("x", 1.0), "y": ("y", 1.0),
    "r_deg_s": ("r", DEGREE), "psi_deg": ("psi", DEGREE), "delta_deg": ("delta", DEGREE),
    "phi_deg": ("phi", DEGREE), "p_deg_s": ("p", DEGREE),
}  # fmt: skip
"""Setting of ``data.noise`` -> channel and SI value of its unit."""
MAX_NOISE = 1e6
"""Largest standard deviation of a sensor's noise [m, m/s, deg ...]."""


def check_simulable(ship: object) -> None:
    """Refuse to simulate a ship of which only particulars are known.

    Args:
        ship: What the config gave.

    Raises:
        InputError: If it has no coefficients.
    """
    if isinstance(ship, Particulars):
        raise InputError(
            f"the {ship.name} has particulars but no coefficients and cannot be simulated: write data=recording "
            "data.folder=FOLDER data.files=[FILE,...], or choose a ship with coefficients"
        )


def check_positive(what: str, value: float | None) -> None:
    """Refuse a number that is not positive.

    Args:
        what: The setting.
        value: Its value or None.

    Raises:
        InputError: If it is zero or negative.
    """
    if value is not None and (not value > 0 or isnan(value)):
        raise InputError(f"{what}={value}: expected a number more than 0")


def check_length(what: str, length: float, ship: Particulars) -> None:
    """Refuse a record in which a ship hardly begins to turn.

    Args:
        what: Manoeuvre or setting, for the message.
        length: Length [s].
        ship: The ship.

    Raises:
        InputError: If it is shorter than 2 L/U0.
    """
    shortest = 2 * ship.time_unit
    if length < shortest:
        raise InputError(
            f"data.length={length:g} s of {what} is too short for the {ship.name}: "
            f"write at least {ceil(10 * shortest) / 10:g} s (two ship lengths), or a higher manoeuvre.speed_kn"
        )


def noise_in_si(noise: Mapping[str, float]) -> dict[str, float]:
    """Standard deviations as given -> by channel in SI.

    Args:
        noise: Setting of :data:`NOISE_UNITS` -> standard deviation.

    Returns:
        Channel -> standard deviation [SI].

    Raises:
        InputError: If a setting is unknown, negative, or beyond any sensor.
    """
    result = {}
    for key, value in noise.items():
        check_choice("data.noise", key, list(NOISE_UNITS))
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value <= MAX_NOISE:
            raise InputError(f"data.noise.{key}={value}: expected a standard deviation, 0 or more, to {MAX_NOISE:g}")
        channel, unit = NOISE_UNITS[key]
        if value:
            result[channel] = value * unit
    return result


MAX_PARTS, MAX_TOLD = 100, 200
"""Folders within folders of a name that are looked through, and letters of a name that a message repeats."""


def expand(folder: Path, names: Sequence[str], what: str) -> list[Path]:
    """File names and patterns -> paths.

    Args:
        folder: Where they are.
        names: Names or patterns such as ``Z_*_05.csv``.
        what: The setting, for the message.

    Returns:
        Paths.

    Raises:
        InputError: If the folder or a file is missing.
    """
    if not folder.is_dir():
        raise InputError(f"data.folder={folder} is not a folder: write the folder that holds the recordings")
    found: list[Path] = []
    for name in names:
        path = Path(name)
        within = not path.is_absolute() and len(path.parts) <= MAX_PARTS
        hits = sorted(folder.glob(str(name) or " ")) if within else []
        if not hits:
            there = ", ".join([p.name for p in recordings_in(folder)][:12]) or "no recording"
            raise InputError(f"{what}: {str(name)[:MAX_TOLD]} is not in {folder}; it holds {there}")
        found += hits
    return found
