"""Tables of a response in a seaway, a record a line: loading, speed, heading to the waves, sea, and what came of it."""

from collections.abc import Mapping as AnyMapping
from collections.abc import Sequence
from dataclasses import dataclass
from math import pi
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.core.response import Records, Variable
from manoeuvre_nn.core.units import GRAVITY
from manoeuvre_nn.recording.read.mapping import ChannelMap, check_once, column_of, is_number
from manoeuvre_nn.recording.read.quantity import UNITS
from manoeuvre_nn.recording.read.table import Table, read_table

HeadingZero = Literal["following", "head"]
MAX_STEEPNESS = 1 / 7
"""Height over length of the steepest wave on deep water (Michell 1893)."""
HEIGHT, PERIOD, HEADING = "Hs", "T", "beta"
"""Variables that the checks of a sea know."""


@dataclass(frozen=True)
class RecordsMapping:
    """Where a table of responses has what.

    Attributes:
        columns: Variable -> its column and unit.
        factors: Variable -> what its numbers are multiplied by: 2 for a root mean square, of which the significant
            amplitude is twice as much; 1 where it is not said.
        heading_zero: What a heading of 0 is: ``following`` or ``head`` seas.
    """

    columns: AnyMapping[str, ChannelMap]
    factors: AnyMapping[str, float]
    heading_zero: HeadingZero = "following"


def unit_size(unit: str) -> float:
    """A unit's value in SI.

    Args:
        unit: As in :data:`.UNITS`.

    Returns:
        Its value; an unknown one is refused with those that there are.
    """
    sizes = {name: size for quantity, units in UNITS.items() for name, size in units.items() if quantity != "time"}
    sizes |= {"s": 1.0, "min": 60.0, "h": 3600.0}
    check_choice("unit", unit, sorted(sizes))
    return sizes[unit]


def records_mapping(**settings: Any) -> RecordsMapping:
    """Read a mapping of a table of responses from a config.

    Args:
        settings: ``columns`` (variable -> ``{column: C, unit: U, factor: 1}``), ``heading_zero``.

    Returns:
        The mapping.

    Raises:
        InputError: If a key is unknown or missing, or a value makes no sense.
    """
    for key in settings:
        check_choice("mapping of records: key", key, ["columns", "heading_zero"])
    given = settings.get("columns")
    if not isinstance(given, AnyMapping):
        raise InputError(
            f"mapping of records: columns is {given!r}; write columns: {{Hs: {{column: H, unit: m}}, ...}}"
        )
    columns, factors = {}, {}
    for name, where in given.items():
        if not isinstance(where, AnyMapping) or "column" not in where or not set(where) <= {"column", "unit", "factor"}:
            raise InputError(f"mapping of records: {name} is {where!r}; write {name}: {{column: HEADING, unit: UNIT}}")
        unit, times = str(where.get("unit", "-")), where.get("factor", 1.0)
        unit_size(unit)
        if not is_number(times) or not float(times) > 0:
            raise InputError(f"mapping of records: factor of {name} is {times!r}; expected a number more than 0")
        columns[str(name)] = ChannelMap(column_of(f"mapping of records: column of {name}", where["column"]), unit)
        factors[str(name)] = float(times)
    check_once("mapping of records", columns)
    zero = settings.get("heading_zero", "following")
    check_choice("mapping of records: heading_zero", zero, ["following", "head"])
    return RecordsMapping(columns, factors, zero)


def written(variables: Sequence[Variable]) -> RecordsMapping:
    """How this package writes records: ``Hs [m]``."""
    return RecordsMapping({v.name: ChannelMap(v.heading, v.unit) for v in variables}, {})


def read_records(
    paths: Sequence[Path], inputs: Sequence[Variable], output: Variable, mapping: RecordsMapping | None = None
) -> Records:
    """Read records from tables.

    Headings are folded to the range from 0 to pi: waves from port and from starboard pitch a ship alike.

    Args:
        paths: Files.
        inputs: The variables, their range being what is possible.
        output: The response, likewise.
        mapping: Columns and units; None for headings as this package writes them.

    Returns:
        The records in SI.

    Raises:
        InputError: If a column is missing, a cell holds no number or an impossible one, or the sea is too steep to be.
    """
    variables = [*inputs, output]
    where = mapping or written(variables)
    for name in [v.name for v in variables if v.name not in where.columns]:
        raise InputError(f"mapping of records: columns has no {name}; write {name}: {{column: HEADING, unit: UNIT}}")
    for name in where.columns:
        check_choice("mapping of records: column", name, [v.name for v in variables])
    tables = [read_table(path, [where.columns[v.name].column for v in variables]) for path in paths]
    parts = [np.stack([_column(table, v, where) for v in variables], axis=1) for table in tables]
    for path, part in zip(paths, parts, strict=True):
        _check_sea(path, part, [v.name for v in inputs])
    values = np.concatenate(parts)
    source = f"{len(values)} records of {', '.join(path.name for path in paths)}"
    return Records(inputs, output, values[:, :-1], values[:, -1], source)


def _column(table: Table, variable: Variable, mapping: RecordsMapping) -> Float[np.ndarray, " n"]:
    """A column in SI, every cell of it a number that can be."""
    where, name = mapping.columns[variable.name], variable.name
    numbers = table.numbers(where.column)
    if np.isnan(numbers).any():
        raise table.error(where.column, int(np.argmax(np.isnan(numbers))), "is empty; delete or mend this line")
    values = numbers * unit_size(where.unit) * mapping.factors.get(name, 1.0)
    if name == HEADING:
        if np.abs(values).max() > 2 * pi * (1 + 1e-9):
            row = int(np.argmax(np.abs(values)))
            raise table.error(where.column, row, f"is {numbers[row]:g} {where.unit}, more than a turn: mind the unit")
        values = np.abs((values + pi) % (2 * pi) - pi)
        values = pi - values if mapping.heading_zero == "head" else values
    bad = (values < variable.low - 1e-9) | (values > variable.high + 1e-9)
    if bad.any():
        row = int(np.argmax(bad))
        low, high = variable.low / variable.size, variable.high / variable.size
        said = f"is {numbers[row]:g} {where.unit}; {name} can be {low:g} to {high:g} {variable.unit}"
        raise table.error(where.column, row, f"{said}: mind column and unit")
    return values


def _check_sea(path: Path, values: Float[np.ndarray, "n k"], names: Sequence[str]) -> None:
    """Refuse a sea that would break: height and period are swapped, or in a wrong unit."""
    if not {HEIGHT, PERIOD} <= set(names):
        return
    height, period = values[:, names.index(HEIGHT)], values[:, names.index(PERIOD)]
    steepness = 2 * pi * height / (GRAVITY * np.maximum(period, 1e-9) ** 2)
    if np.median(steepness) > MAX_STEEPNESS:
        row = int(np.argmax(steepness))
        raise InputError(
            f"{path.name}: waves are {np.median(steepness):.2g} as high as long (record {row + 1}: {height[row]:g} m, "
            f"{period[row]:g} s), and break from 1/7 on: are the columns of {HEIGHT} and {PERIOD} swapped?"
        )
