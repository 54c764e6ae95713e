"""What a check of a recording finds: what was measured, a verdict, and the change of the mapping that mends it."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, Literal

import numpy as np

from manoeuvre_nn.core.errors import check_choice
from manoeuvre_nn.core.manoeuvre import side_sign
from manoeuvre_nn.recording.read.mapping import ChannelMap
from manoeuvre_nn.recording.read.mapping import Mapping as ChannelMapping

VERDICTS = ("ok", "note", "mend", "refuse")
"""From good to bad: nothing to do; know it; can be mended; cannot be used as it is."""
How = Literal["set", "add", "turn", "exchange", "scale", "offset", "delay"]
LEAVE_OUT = None
"""Value of a channel that is left out of the mapping."""
DIGITS = 5
"""Significant digits of a number that is written into a mapping."""


@dataclass(frozen=True)
class Change:
    """One change of a mapping.

    Attributes:
        path: What is changed: ``start``, ``channels.v``, ``channels.v.unit``.
        how: ``set`` to the value; ``add`` the value to a setting; of a channel: ``turn`` its sign (or the rudder's
            side) round; ``exchange`` columns with another; ``scale`` (times the value), ``offset`` (less the value
            [SI]) and ``delay`` (earlier by the value [s]) are laid over what it has already.
        value: Such as 12.5, ``deg``, a channel to exchange with, or None for a channel that is left out.
    """

    path: str
    how: How = "set"
    value: Any = None


@dataclass(frozen=True)
class Finding:
    """What one check says of one recording.

    Attributes:
        check: Name of the check.
        verdict: One of :data:`VERDICTS`.
        text: The complaint or the confirmation, one sentence; printed as it is.
        channels: What it is about.
        measured: The number that was measured; None where there is none.
        error: Its standard error, in the same unit; None where it has none.
        unit: Of both.
        expected: What was expected, in words.
        remedy: What to do, in words; empty where nothing is to be done.
        changes: The remedy as changes of the mapping; empty where no setting of the mapping mends it.
        spans: Times that it is about, from and to [s].
    """

    check: str
    verdict: str
    text: str
    channels: tuple[str, ...] = ()
    measured: float | None = None
    error: float | None = None
    unit: str = ""
    expected: str = ""
    remedy: str = ""
    changes: tuple[Change, ...] = ()
    spans: tuple[tuple[float, float], ...] = field(default=(), repr=False)

    def __post_init__(self) -> None:
        """Refuse a verdict that nobody knows."""
        check_choice("verdict", self.verdict, VERDICTS)

    def __str__(self) -> str:
        """The sentence, with what to do."""
        return f"{self.text}: {self.remedy}" if self.remedy else self.text

    @property
    def trips(self) -> bool:
        """Whether something is to be done."""
        return self.verdict in {"mend", "refuse"}


def refused(check: str, text: str, remedy: str, *changes: Change) -> Finding:
    """What cannot be used as it is."""
    return Finding(check, "refuse", text, remedy=remedy, changes=changes)


def in_unit(unit: str, *names: str) -> tuple[Change, ...]:
    """Another unit for some channels, or for ``time``."""
    return tuple(Change("time.unit" if k == "time" else f"channels.{k}.unit", value=unit) for k in names)


def other_sign(name: str) -> Change:
    """A channel with the other sign."""
    return Change(f"channels.{name}", "turn")


def number(value: float | None, error: float | None = None, unit: str = "") -> str:
    """A number with its standard error, as many digits as that has, such as ``0.873 ± 0.026 s``; a dash for None."""
    if value is None:
        return "–"
    if not error or not np.isfinite(error):
        return f"{value:.3g} {unit}".strip()
    digits = int(np.clip(1 - np.floor(np.log10(error)), 0, 6))
    return f"{value:.{digits}f} ± {error:.{digits}f} {unit}".strip()


def worst(findings: Iterable[Finding]) -> str:
    """The gravest verdict; ``ok`` where there is no finding."""
    return max((f.verdict for f in findings), key=VERDICTS.index, default="ok")


def settings(findings: Sequence[Finding], mapping: ChannelMapping) -> dict[str, Any]:
    """What is to be written into the mapping that a file was read with: path -> value; None leaves a channel out."""
    said: dict[str, Any] = {}
    for change in (c for f in findings for c in f.changes):
        said |= _settled(change, mapping, said)
    out = tuple(f"{path}." for path, value in said.items() if value is LEAVE_OUT and path.count(".") == 1)
    return {path: value for path, value in said.items() if not path.startswith(out)}


def finding_json(finding: Finding, mapping: ChannelMapping) -> dict[str, Any]:
    """A finding as plain numbers and strings; ``changes`` as path -> value of the mapping that it was read with."""
    plain = {f.name: getattr(finding, f.name) for f in fields(finding)}
    return plain | {
        "channels": list(finding.channels),
        "spans": [list(span) for span in finding.spans],
        "changes": settings([finding], mapping),
    }


def _settled(change: Change, mapping: ChannelMapping, said: Mapping[str, Any]) -> dict[str, Any]:
    """Path -> value of one change, laid over what others have said; nothing for a channel that is not mapped."""
    first, _, rest = change.path.partition(".")
    if first == "channels" and rest.split(".")[0] not in mapping.channels:
        return {}
    if change.how == "set":
        return {change.path: change.value}
    if change.how == "add":
        now = said.get(change.path, getattr(mapping, change.path))
        now = mapping.reference_point if now is None else now
        return {change.path: _rounded(now + change.value)}
    if change.path == "rudder_positive_to":
        now = said.get(change.path, mapping.rudder_positive_to)
        return {change.path: "port" if side_sign("rudder_positive_to", now) > 0 else "starboard"}
    name = change.path.split(".")[1]
    where = _as_said(mapping.channels[name], name, said)
    at = f"channels.{name}"
    if change.how == "turn":
        return {f"{at}.sign": -where.sign}
    if change.how == "exchange":
        other = mapping.channels[change.value]
        return {
            f"{at}.column": other.column,
            f"{at}.unit": other.unit,
            f"channels.{change.value}.column": where.column,
            f"channels.{change.value}.unit": where.unit,
        }
    if change.how == "offset":
        return {f"{at}.offset": _rounded(where.offset + change.value / mapping.factor(name))}
    if change.how == "scale":
        return {f"{at}.scale": _rounded(where.scale * change.value)}
    return {f"{at}.delay": _rounded(where.delay + change.value)}


def _as_said(where: ChannelMap, name: str, said: Mapping[str, Any]) -> ChannelMap:
    """A channel's entry with what has been said of it already."""
    start = f"channels.{name}."
    return replace(where, **{k.removeprefix(start): v for k, v in said.items() if k.startswith(start)})


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")
