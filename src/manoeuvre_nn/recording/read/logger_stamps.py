"""What a logger writes before a sentence: the time at which the sentence came."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from jaxtyping import Float

SAMPLE = 500
"""Lines that the form is guessed from."""
MOSTLY = 0.8
"""Share of them that it must read."""
DAY, MIDNIGHT = 86400.0, 43200.0
"""Seconds of a day; a time of day that goes back by more than the other has passed midnight."""
MAX_APART = 600.0
"""How far two clocks of one log may be apart, so that midnight passes twice [s]."""
NO_CLOCK, NO_DATE = ("",) * 3, ("",) * 7
"""What is found where there is no stamp."""
EPOCH = ((1e17, 1e-9), (1e14, 1e-6), (1e11, 1e-3), (1e8, 1.0))
"""Size of a count since 1970 -> its unit [s]; below, it counts from the logger's own start."""

Series = Float[np.ndarray, " n"]
CLOCK = r"(\d\d):?(\d\d):?(\d\d(?:[.,]\d+)?)"
DATE_FIRST = re.compile(rf"(?<!\d)(\d{{4}})[-/.]?(\d\d)[-/.]?(\d\d)[T ,;_]+{CLOCK}(Z|[+-]\d\d:?\d\d)?")
DAY_FIRST = re.compile(rf"(?<!\d)(\d\d)\.(\d\d)\.(\d{{4}})[T ,;_]+{CLOCK}(Z|[+-]\d\d:?\d\d)?")
TIME_OF_DAY = re.compile(r"(?<![\d:])(\d\d):(\d\d):(\d\d(?:[.,]\d+)?)")
TAG_BLOCK = re.compile(r"\\[^\\]*?\bc:(\d+(?:\.\d+)?)")
SINCE_1970 = re.compile(r"(?<![\w.:-])(\d{9,20}(?:\.\d+)?)(?![\w.:-])")
"""A large number that stands alone: a count of seconds, or of parts of them."""
SINCE_START = re.compile(r"(?<![\w.:-])(\d+\.\d+)(?![\w.:-])")
"""Seconds with decimals: a whole number may be that of the line."""


@dataclass(frozen=True)
class StampForm:
    """How a logger writes times.

    Attributes:
        pattern: What is looked for before a sentence.
        parts: What was found, one a sentence, to seconds.
        dated: Whether they count from 1970 (UTC); else from a midnight or from the logger's start.
        clock: Whether they are times of day, which pass midnight.
    """

    pattern: re.Pattern[str]
    parts: Callable[[Sequence[Sequence[str] | None]], Series]
    dated: bool = False
    clock: bool = False

    def read(self, before: Sequence[bytes]) -> Series:
        """Times [s] of what stands before each sentence on its line; NaN where there is none."""
        found = [self.pattern.search(text.decode("latin-1")) for text in before]
        return self.parts([None if m is None else m.groups("") for m in found])


def form_of(before: Sequence[bytes]) -> StampForm | None:
    """The form of most of what stands before sentences; None if a logger wrote no times that can be read."""
    some = before[:SAMPLE]
    for form in FORMS:
        times = form.read(some)
        if np.isfinite(times).sum() >= MOSTLY * max(len(some), 1):
            return replace(form, dated=form.dated or (not form.clock and bool(np.nanmedian(times) > EPOCH[-1][0])))
    return None


def without_midnights(times: Series) -> Series:
    """Times of day made to rise on over midnights, also where two clocks pass one in turn; NaN stays."""
    there = np.isfinite(times)
    steps = np.diff(times[there], prepend=times[there][:1])
    passed = np.cumsum((steps < -MIDNIGHT).astype(int) - (steps > DAY - MAX_APART))
    result = times.copy()
    result[there] += DAY * passed
    return result


def _dates(found: Sequence[Sequence[str] | None], order: tuple[int, int, int]) -> Series:
    """Seconds since 1970 of year, month, day, clock and zone; the three stand in some order."""
    known = [groups or NO_DATE for groups in found]
    days = [f"{g[order[0]]}-{g[order[1]]}-{g[order[2]]}" for g in known]
    names, which = np.unique(days, return_inverse=True)
    dates = pd.to_datetime(pd.Series(names), format="%Y-%m-%d", errors="coerce")
    midnights = ((dates - pd.Timestamp(0)) / pd.Timedelta(seconds=1)).to_numpy(dtype=float)
    return midnights[which] + _seconds([g[3:6] for g in known]) - _zones([g[6] for g in known])


def _zones(words: Sequence[str]) -> Series:
    """What clocks of zones are ahead of UTC by [s]."""
    names, which = np.unique(list(words), return_inverse=True)
    ahead = [
        0.0 if name in {"", "Z"} else float(f"{name[0]}1") * (int(name[1:3]) * 3600 + int(name[-2:]) * 60)
        for name in names
    ]
    return np.array(ahead)[which]


def _seconds(clocks: Sequence[Sequence[str]]) -> Series:
    """Seconds since midnight; NaN where there is none."""
    parts = np.array([clock if clock[0] else ("nan",) * 3 for clock in clocks])
    hours, minutes, seconds = np.char.replace(parts, ",", ".").astype(float).T
    return 3600 * hours + 60 * minutes + seconds


def _counts(found: Sequence[Sequence[str] | None]) -> Series:
    """Seconds of a count whose size tells its unit."""
    counts = np.array([float(groups[0]) if groups else np.nan for groups in found])
    usual = float(np.median(counts[np.isfinite(counts)])) if np.isfinite(counts).any() else 0.0
    return counts * next((unit for size, unit in EPOCH if usual > size), 1.0)


FORMS = (
    StampForm(TAG_BLOCK, _counts),
    StampForm(DATE_FIRST, lambda found: _dates(found, (0, 1, 2)), dated=True),
    StampForm(DAY_FIRST, lambda found: _dates(found, (2, 1, 0)), dated=True),
    StampForm(TIME_OF_DAY, lambda found: _seconds([groups or NO_CLOCK for groups in found]), clock=True),
    StampForm(SINCE_1970, _counts),
    StampForm(SINCE_START, _counts),
)
"""Forms in the order in which they are tried."""
