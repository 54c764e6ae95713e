"""A paper done again, as a whole and in JSON: chapters as they are kept, and the file that is written of all."""

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, get_args

import numpy as np

from studies.reproduction.section import ChapterResult, Claim, ComputingEffort, Line, Panel, Plot, Verdict

VERDICTS: tuple[Verdict, ...] = get_args(Verdict)
"""From good to what cannot be said."""


@dataclass(frozen=True)
class Done:
    """A chapter that was tried.

    Attributes:
        name: What the command line calls it: ``5.3``.
        section: What came of it; None if it failed.
        failure: Why it failed, a line; empty if it did not.
        seconds: Wall time [s].
    """

    name: str
    section: ChapterResult | None
    failure: str = ""
    seconds: float = 0.0


@dataclass(frozen=True)
class Reproduction:
    """A paper done again.

    Attributes:
        paper: Its short name: ``wang1996``.
        title: Its title.
        source: Authors, year, place.
        effort: How much computing was allowed.
        chapters: In the paper's order.
        versions: Package -> version.
        seconds: Wall time of the command [s]; chapters that were finished before take none.
    """

    paper: str
    title: str
    source: str
    effort: ComputingEffort
    chapters: Sequence[Done]
    versions: Mapping[str, str]
    seconds: float

    @property
    def claims(self) -> list[Claim]:
        """Claims of all chapters."""
        return [claim for done in self.chapters if done.section for claim in done.section.claims]


def verdict_counts(claims: Iterable[Claim]) -> dict[Verdict, int]:
    """How often each verdict was given.

    Args:
        claims: The claims.

    Returns:
        Every verdict -> count.
    """
    found = Counter(claim.verdict for claim in claims)
    return {verdict: found[verdict] for verdict in VERDICTS}


def section_to_json(section: ChapterResult) -> dict[str, Any]:
    """A chapter as plain lists and dicts.

    Args:
        section: The chapter.

    Returns:
        What :func:`section_from_json` reads; numbers keep all their digits.
    """
    plain = _plain(asdict(section))
    assert isinstance(plain, dict)
    return plain


def section_from_json(kept: Mapping[str, Any]) -> ChapterResult:
    """A chapter as it was kept.

    Args:
        kept: What :func:`section_to_json` gave.

    Returns:
        The chapter. Where it is anything else a KeyError, TypeError or ValueError is raised.

    Raises:
        ValueError: If a verdict is unknown.
    """
    claims = [Claim(**claim) for claim in kept["claims"]]
    if not {claim.verdict for claim in claims} <= set(VERDICTS):
        raise ValueError("a verdict is unknown")
    tables = {str(heading): [dict(row) for row in rows] for heading, rows in kept["tables"].items()}
    return ChapterResult(kept["title"], kept["summary"], claims, tables, [_plot(plot) for plot in kept["plots"]])


def _plot(kept: Mapping[str, Any]) -> Plot:
    panels = []
    for panel in kept["panels"]:
        lines = [Line(**line | {axis: np.array(line[axis], dtype=float) for axis in "xy"}) for line in panel["lines"]]
        panels.append(Panel(**panel | {"lines": lines}))
    return Plot(kept["name"], kept["caption"], panels)


def _plain(value: Any) -> Any:
    """Numbers of numpy and torch as Python's, containers as lists and dicts, anything else as text."""
    if value is None or isinstance(value, bool | int | float | str):
        return float(value) if isinstance(value, np.floating) else value
    if isinstance(value, Mapping):
        return {str(name): _plain(inner) for name, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(inner) for inner in value]
    return _plain(value.tolist()) if hasattr(value, "tolist") else str(value)


def reproduction_json(r: Reproduction, figures: Mapping[str, Sequence[str]]) -> dict[str, Any]:
    """Everything but the curves, for a program to read.

    Args:
        r: The reproduction.
        figures: Chapter -> files of its figures, in order.

    Returns:
        Plain lists and dicts; numbers that are not finite are None. All that a second run need not give again is under
        ``seconds`` and ``versions``.
    """
    found = {
        "paper": r.paper,
        "title": r.title,
        "source": r.source,
        "effort": asdict(r.effort),
        "verdicts": verdict_counts(r.claims),
        "failed": [done.name for done in r.chapters if done.section is None],
        "chapters": {done.name: _chapter(done, figures.get(done.name, ())) for done in r.chapters},
        "seconds": {"command": r.seconds, "chapters": {done.name: done.seconds for done in r.chapters}},
        "versions": dict(r.versions),
    }
    return {name: _finite(value) for name, value in found.items()}


def _chapter(done: Done, figures: Sequence[str]) -> dict[str, Any]:
    if done.section is None:
        return {"failure": done.failure}
    section = done.section
    return {
        "title": section.title,
        "summary": section.summary,
        "verdicts": verdict_counts(section.claims),
        "claims": [asdict(claim) | {"difference": claim.difference} for claim in section.claims],
        "tables": section.tables,
        "figures": [{"file": file, "caption": plot.caption} for file, plot in zip(figures, section.plots, strict=True)],
    }


def _finite(value: Any) -> Any:
    """JSON has no word for what is not finite."""
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, Mapping):
        return {name: _finite(inner) for name, inner in value.items()}
    return [_finite(inner) for inner in value] if isinstance(value, list | tuple) else value
