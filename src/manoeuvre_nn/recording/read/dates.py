"""Time stamps whose dates are not written as 2026-05-02: 02.05.2026, 2026/05/02, 02/05/2026, 05/02/2026 09:00:00 AM."""

from typing import Any

import pandas as pd

DATED = (
    r"(?:(?P<year>\d{4})[-/.](?P<month>\d{1,2})[-/.](?P<day>\d{1,2})"
    r"|(?P<one>\d{1,2})(?P<sign>[-/.])(?P<other>\d{1,2})[-/.](?P<last>\d{4}))"
    r"[T ]+(?P<hour>\d{1,2}):(?P<minute>\d\d)(?P<seconds>:\d\d(?:[.,]\d+)?)? ?(?P<half>[AaPp][Mm])?"
    r" ?(?P<zone>Z|[+-]\d\d:?\d\d)?"
)
"""Date and time of day as programs write them."""
OTHERWISE = r"^\d{1,2}[-/.]|[,AaPp]"
"""Stands in some of the stamps that are not ISO 8601 already."""
MONTHS = 12
"""A number above that is a day."""


def stamps_of(text: "pd.Series[str]") -> list["pd.Series[str]"]:
    """Time stamps with the year first, as ISO 8601 wants them.

    Args:
        text: A column of a file. A date with points has its day first; of others, a number above 12 says for the whole
            column whether it is the day that stands first.

    Returns:
        The column as it can be read: once, or twice where day and month can be exchanged. What is no date stays.
    """
    if not text.str.contains(OTHERWISE).any():
        return [text]
    parts = text.str.extract(f"^{DATED}$")
    there = parts["hour"].notna()
    if not there.any():
        return [text]
    short = there & parts["one"].notna()
    one, other = (parts.loc[short, name].astype(int) for name in ("one", "other"))
    points = bool((parts.loc[short, "sign"] == ".").any())
    if points or not short.any() or (one > MONTHS).any():
        orders = [("other", "one")]
    elif (other > MONTHS).any():
        orders = [("one", "other")]
    else:
        orders = [("other", "one"), ("one", "other")]
    return [text.where(~there, _iso(parts, *order)) for order in orders]


def _iso(parts: pd.DataFrame, month: str, day: str) -> "pd.Series[str]":
    """Stamps out of their parts; month and day of dates with the year last stand in columns of these names."""
    year = parts["year"].fillna(parts["last"])
    months, days = (parts[a].fillna(parts[b]).str.zfill(2) for a, b in (("month", month), ("day", day)))
    hours, half = parts["hour"].fillna("0").astype(int), parts["half"].str.lower()
    hours = hours.where(half.isna(), hours % 12 + 12 * (half == "pm"))
    clock = hours.astype(str).str.zfill(2) + ":" + parts["minute"] + parts["seconds"].fillna(":00")
    zone = parts["zone"].fillna("")
    return year + "-" + months + "-" + days + "T" + clock.str.replace(",", ".", regex=False) + zone


def unlike(one: pd.Series, other: pd.Series) -> int | None:
    """The first sample whose time since the first of all depends on the reading; None if there is none."""
    differ = (_since_first(one) != _since_first(other)) & one.notna()
    return int(differ.to_numpy().argmax()) if differ.any() else None


def _since_first(stamps: pd.Series) -> pd.Series:
    """Times since the first that is there."""
    first: Any = stamps.dropna().iloc[:1].squeeze()
    return stamps - first
