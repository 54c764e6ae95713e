"""What the sentences of NMEA 0183 say that matters to a manoeuvre: a function each, from fields to columns."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float

Series = Float[np.ndarray, " n"]
Columns = dict[str, np.ndarray]
UTC, DATE = "utc", "date"
"""Time of day [s] and date [s since 1970] that a sentence gives; no columns."""
SPEED = {"N": 1852 / 3600, "K": 1 / 3.6, "M": 1.0, "S": 1609.344 / 3600}
"""Letter of a unit of wind speed -> its value in m/s."""
CENTURY = 80
"""Years of two digits from here on are those of the 20th century: GPS began to count in 1980."""


@dataclass(frozen=True)
class Fields:
    """Fields of sentences of one kind, a row a sentence; those that a sentence lacks are empty.

    Attributes:
        rows: Each sentence cut at its commas, without its name.
    """

    rows: Sequence[Sequence[bytes]]

    def raw(self, k: int) -> list[bytes]:
        """One field as it stands."""
        return [row[k].strip() if k < len(row) else b"" for row in self.rows]

    def words(self, k: int) -> np.ndarray:
        """One field as text; a byte that is no letter is kept as some sign."""
        return np.char.decode(np.array(self.raw(k), dtype="S12"), "latin-1")

    def numbers(self, k: int) -> Series:
        """One field as numbers; NaN where it is empty or none."""
        cells = [cell or b"nan" for cell in self.raw(k)]
        try:
            values = np.fromiter(map(float, cells), dtype=float, count=len(cells))
        except ValueError:
            text = pd.Series([cell.decode("latin-1") for cell in cells], dtype=object)
            values = pd.to_numeric(text, errors="coerce").to_numpy(dtype=float)
        return np.where(np.isfinite(values), values, np.nan)

    def degrees(self, k: int) -> Series:
        """Latitude or longitude out of degrees and minutes ``ddmm.mmm`` and, in the next field, the hemisphere."""
        whole = np.floor(self.numbers(k) / 100)
        size = whole + (self.numbers(k) - 100 * whole) / 60
        return np.where(np.isin(self.words(k + 1), ["S", "W"]), -size, size)

    def utc(self, k: int) -> Series:
        """Time of day out of ``hhmmss.ss`` [s]."""
        clock = self.numbers(k)
        hours, minutes = np.floor(clock / 1e4), np.floor(clock / 100) % 100
        return 3600 * hours + 60 * minutes + clock % 100

    def is_letter(self, k: int, letters: str) -> Bool[np.ndarray, " n"]:
        """Whether a field is one of some letters."""
        return np.isin(self.words(k), list(letters))


def _where(good: Bool[np.ndarray, " n"], columns: Columns) -> Columns:
    """Columns without what a status says is not valid."""
    return {name: np.where(good, values, np.nan) for name, values in columns.items()}


def _place(f: Fields, k: int) -> Columns:
    return {"latitude [deg]": f.degrees(k), "longitude [deg]": f.degrees(k + 2)}


def _rmc(f: Fields) -> Columns:
    columns = {**_place(f, 2), "sog [kn]": f.numbers(6), "cog [deg]": f.numbers(7)}
    day, month, year = (np.floor(f.numbers(8) / size) % 100 for size in (1e4, 100, 1))
    return _where(f.is_letter(1, "A"), columns) | {UTC: f.utc(0), DATE: _date(year, month, day)}


def _gga(f: Fields) -> Columns:
    return _where(f.numbers(5) > 0, _place(f, 1)) | {UTC: f.utc(0)}


def _gns(f: Fields) -> Columns:
    fixed = np.array([any(letter not in "NS" for letter in word) for word in f.words(5)])
    return _where(fixed, _place(f, 1)) | {UTC: f.utc(0)}


def _gll(f: Fields) -> Columns:
    return _where(~f.is_letter(5, "V"), _place(f, 0)) | {UTC: f.utc(4)}


def _zda(f: Fields) -> Columns:
    return {UTC: f.utc(0), DATE: _date(f.numbers(3), f.numbers(2), f.numbers(1))}


def _date(year: Series, month: Series, day: Series) -> Series:
    """Midnights [s since 1970]; NaN where there is no such date."""
    full = np.where(year >= 100, year, np.where(year >= CENTURY, year + 1900, year + 2000))
    made = pd.to_datetime(pd.DataFrame({"year": full, "month": month, "day": day}), errors="coerce")
    return ((made - pd.Timestamp(0)) / pd.Timedelta(seconds=1)).to_numpy(dtype=float)


def _vtg(f: Fields) -> Columns:
    return {"cog [deg]": f.numbers(0), "sog [kn]": f.numbers(4)}


def _vhw(f: Fields) -> Columns:
    return {"speed_through_water [kn]": f.numbers(4), "heading [deg]": f.numbers(0),
            "heading_magnetic [deg]": f.numbers(2)}  # fmt: skip


def _vbw(f: Fields) -> Columns:
    ground = {"surge_over_ground [kn]": f.numbers(3), "sway_over_ground [kn]": f.numbers(4)}
    water = {"speed_through_water [kn]": f.numbers(0), "athwart_through_water [kn]": f.numbers(1)}
    return _where(f.is_letter(5, "A"), ground) | _where(f.is_letter(2, "A"), water)


def _hdg(f: Fields) -> Columns:
    magnetic = f.numbers(0) + np.nan_to_num(_east(f, 1))
    return {"heading [deg]": np.mod(magnetic + _east(f, 3), 360), "heading_magnetic [deg]": np.mod(magnetic, 360)}


def _east(f: Fields, k: int) -> Series:
    """Deviation or variation, positive to the east."""
    return f.numbers(k) * np.where(f.is_letter(k + 1, "W"), -1, 1)


def _rsa(f: Fields) -> Columns:
    sides = [_where(f.is_letter(k + 1, "A"), {"": f.numbers(k)})[""] for k in (0, 2)]
    if np.isnan(sides[1]).all():
        return {"rudder [deg]": sides[0]}
    return {"rudder_starboard [deg]": sides[0], "rudder_port [deg]": sides[1]}


def _rpm(f: Fields) -> Columns:
    good = f.is_letter(0, "S") & ~f.is_letter(4, "V")
    number = np.where(good, f.numbers(1), np.nan)
    sides = {"starboard": number % 2 == 1, "port": (number % 2 == 0) & (number > 0), "": number == 0}
    if not sides["port"].any():  # a single shaft, which some number 1
        sides = {"": good}
    return {f"shaft{'_' * bool(side)}{side} [rpm]": np.where(it, f.numbers(2), np.nan) for side, it in sides.items()
            if it.any()}  # fmt: skip


def _mwv(f: Fields) -> Columns:
    unit = np.array([SPEED.get(letter, np.nan) for letter in f.words(3)])
    speed, good = f.numbers(2) * unit, f.is_letter(4, "A")
    relative = {"apparent_wind_angle [deg]": f.numbers(0), "apparent_wind_speed [m/s]": speed}
    true = {"theoretical_wind_angle [deg]": f.numbers(0), "theoretical_wind_speed [m/s]": speed}  # from the bow
    return _where(good & f.is_letter(1, "R"), relative) | _where(good & f.is_letter(1, "T"), true)


def _mwd(f: Fields) -> Columns:
    speed = np.where(np.isnan(f.numbers(6)), f.numbers(4) * SPEED["N"], f.numbers(6))
    return {"wind_direction [deg]": f.numbers(0), "wind_speed [m/s]": speed}


def _order(f: Fields) -> Columns:
    return {"rudder_order [deg]": np.abs(f.numbers(1)) * np.where(f.is_letter(2, "L"), -1, 1)}


LEADING: dict[str, Callable[[Fields], Columns]] = {
    "GGA": _gga, "RMC": _rmc, "GNS": _gns, "GLL": _gll, "ZDA": _zda,
    "HDT": lambda f: {"heading [deg]": f.numbers(0)},
    "THS": lambda f: _where(~f.is_letter(1, "V"), {"heading [deg]": f.numbers(0)}),
    "HDG": _hdg,
    "HDM": lambda f: {"heading_magnetic [deg]": f.numbers(0)},
    "ROT": lambda f: _where(~f.is_letter(1, "V"), {"rot [deg/min]": f.numbers(0)}),
    "RSA": _rsa, "VBW": _vbw, "VTG": _vtg,
}  # fmt: skip
"""Sentences of position, motion and rudder, the more trusted first."""
OTHERS: dict[str, Callable[[Fields], Columns]] = {
    "VHW": _vhw, "RPM": _rpm, "HTD": _order, "HTC": _order, "MWV": _mwv, "MWD": _mwd,
    "DPT": lambda f: {"depth [m]": f.numbers(0)}, "DBT": lambda f: {"depth [m]": f.numbers(2)},
}  # fmt: skip
"""Sentences beside them."""
SENTENCES = {**LEADING, **OTHERS}
"""Three letters of a sentence, without its talker, -> its fields to columns."""
