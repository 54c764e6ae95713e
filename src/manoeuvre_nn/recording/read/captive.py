"""Tables of captive model tests: forces at given drift and rudder angles, in prime units and the ship's own signs."""

from collections.abc import Mapping as AnyMapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.core.manoeuvre import side_sign
from manoeuvre_nn.recording.read.mapping import ChannelMap, check_once, column_of, is_number, sign_of
from manoeuvre_nn.recording.read.quantity import UNITS
from manoeuvre_nn.recording.read.table import read_table

COLUMNS = {
    "beta": "angle", "delta": "angle", "r": "ratio", "speed": "speed", "n": "shaft speed", "X": "ratio", "Y": "ratio",
    "N": "ratio", "run": "ratio",
}  # fmt: skip
"""What a table may hold, and what it measures; run is the number of a test."""
NEEDED = ("beta", "delta", "X", "Y", "N")
AREAS = ("LL", "LT")
"""What forces are divided by beside ``0.5 rho U^2``: L^2 or L T; moments by L times that."""

Series = Float[np.ndarray, " n"]


@dataclass(frozen=True)
class CaptiveMapping:
    """Where a table of captive tests has what.

    Attributes:
        columns: What -> its column, unit and sign.
        rudder_positive_to: Side that a positive rudder angle of the file turns the ship to.
        area: ``LL`` or ``LT``, see :data:`AREAS`.
        moment_point: How far forward of midship the point lies that N is about [m/L].
    """

    columns: AnyMapping[str, ChannelMap]
    rudder_positive_to: str = "starboard"
    area: str = "LL"
    moment_point: float = 0.0


@dataclass(frozen=True)
class CaptiveTests:
    """Captive tests, one a row, in the axes of the ship: x forward, y to starboard, z down, about midship.

    Attributes:
        name: Name of the file.
        beta: Drift angle ``-atan(v/u)`` [rad].
        delta: Rudder angle, positive turns the ship to starboard [rad].
        r: Rate of turn over U/L [-].
        speed: Speed through the water U [m/s]; NaN where the table does not say it.
        n: Shaft speed [1/s]; NaN likewise.
        X: Force forward over ``0.5 rho U^2 L^2`` or ``0.5 rho U^2 L T`` [-].
        Y: Force to starboard, likewise [-].
        N: Moment about midship, bow to starboard, over L times that [-].
        area: ``LL`` or ``LT``: which of the two.
    """

    name: str
    beta: Series
    delta: Series
    r: Series
    speed: Series
    n: Series
    X: Series
    Y: Series
    N: Series
    area: str

    def __len__(self) -> int:
        """Number of tests."""
        return len(self.beta)

    @property
    def u(self) -> Series:
        """Forward speed over U, cos beta [-]."""
        return np.cos(self.beta)

    @property
    def v(self) -> Series:
        """Sway over U, -sin beta [-]."""
        return -np.sin(self.beta)


def captive_mapping(**settings: Any) -> CaptiveMapping:
    """Read a mapping of captive tests from a config.

    Args:
        settings: ``columns`` (beta, delta, X, Y, N, maybe r, speed, n, run, each as ``{column: C, unit: U, sign: 1}``),
            ``rudder_positive_to``, ``area``, ``moment_point``.

    Returns:
        The mapping.

    Raises:
        InputError: If a key is unknown or missing, or a value makes no sense.
    """
    for key in settings:
        check_choice("captive mapping: key", key, [f.name for f in fields(CaptiveMapping)])
    given = settings.get("columns")
    if not isinstance(given, AnyMapping):
        raise InputError(
            f"captive mapping: columns is {given!r}; write columns: {{beta: {{column: b, unit: deg}}, ...}}"
        )
    columns = {}
    for name, where in given.items():
        check_choice("captive mapping: column", name, list(COLUMNS))
        if not isinstance(where, AnyMapping) or "column" not in where or not set(where) <= {"column", "unit", "sign"}:
            raise InputError(f"captive mapping: {name} is {where!r}; write {name}: {{column: HEADING, unit: UNIT}}")
        unit, sign = str(where.get("unit", "-")), sign_of(f"captive mapping: sign of {name}", where.get("sign", 1))
        check_choice(f"captive mapping: unit of {name}", unit, list(UNITS[COLUMNS[name]]))
        columns[name] = ChannelMap(column_of(f"captive mapping: column of {name}", where["column"]), unit, sign)
    check_once("captive mapping", columns)
    lacking = [name for name in NEEDED if name not in columns]
    if lacking:
        raise InputError(f"captive mapping: columns has no {', '.join(lacking)}")
    others: dict[str, Any] = {k: v for k, v in settings.items() if k != "columns"}
    side_sign("captive mapping: rudder_positive_to", others.get("rudder_positive_to", "starboard"))
    check_choice("captive mapping: area", others.get("area", AREAS[0]), AREAS)
    point = others.get("moment_point", 0.0)
    if not is_number(point):
        raise InputError(f"captive mapping: moment_point={point!r}; write ship lengths, e.g. 0.02")
    others["moment_point"] = float(point)
    return CaptiveMapping(columns, **others)


def read_captive(path: str | Path, mapping: CaptiveMapping) -> CaptiveTests:
    """Read a table of captive tests, a text or a file of another format; a run that stands there twice comes once."""
    path = Path(path)
    table = read_table(path, [where.column for where in mapping.columns.values()])
    side = side_sign("rudder_positive_to", mapping.rudder_positive_to)
    values: dict[str, Series] = {}
    for name, where in mapping.columns.items():
        numbers = table.numbers(where.column)
        if np.isnan(numbers).any():
            raise table.error(where.column, int(np.argmax(np.isnan(numbers))), "is empty; delete or mend this row")
        values[name] = numbers * where.sign * UNITS[COLUMNS[name]][where.unit] * (side if name == "delta" else 1)
    runs = values.pop("run", np.arange(len(values["beta"])))
    kept = np.sort(np.unique(runs, return_index=True)[1])
    unsaid = {k: np.full(len(runs), v) for k, v in (("r", 0.0), ("speed", np.nan), ("n", np.nan))}
    filled = {k: v[kept] for k, v in (unsaid | values).items()}
    filled["N"] = filled["N"] + mapping.moment_point * filled["Y"]
    _check_plausible(path, filled)
    return CaptiveTests(path.stem, **filled, area=mapping.area)


def _check_plausible(path: Path, values: dict[str, Series]) -> None:
    """Refuse angles in the wrong unit, and forces with the wrong sign."""
    for name in ("beta", "delta"):
        largest = float(np.abs(values[name]).max())
        if largest > np.pi:
            raise InputError(f"{path.name}: {name} reaches {largest:.3g} rad: it looks like degrees: write unit: deg")
    straight = np.abs(values["r"]) < 1e-9
    drifting = straight & (np.abs(values["beta"]) > 0.02)
    # A hull that moves to port is pushed to starboard; a rudder that turns it to starboard pushes the stern to port.
    if drifting.sum() > 1 and float(values["beta"][drifting] @ values["Y"][drifting]) < 0:
        raise InputError(f"{path.name}: Y pulls the hull along with its drift: mind the signs of beta and Y")
    steered = straight & (np.abs(values["beta"]) < 0.02) & (np.abs(values["delta"]) > 0.02)
    if steered.sum() > 1 and float(values["delta"][steered] @ values["N"][steered]) < 0:
        raise InputError(f"{path.name}: N turns the ship against the rudder: change rudder_positive_to, or N's sign")
