"""A paper done again as one HTML file that needs nothing else: opens offline, on a phone, light or dark."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from manoeuvre_nn.report.html import write_page
from studies.reproduction.document import Reproduction, verdict_counts
from studies.reproduction.section import Claim, Verdict
from studies.reproduction.terminal import HOLDS, SHORT, about, by_place, clock, difference, number, tally

CLASSES: dict[Verdict, str] = {
    "holds": "good",
    "holds in direction": "part",
    "does not hold": "bad",
    "not comparable": "none",
}
"""Verdict -> style class."""
LONG_LIST = 40
"""Claims of a chapter beyond which those that hold are folded away."""


def reproduction_html(r: Reproduction, images: Mapping[str, Sequence[str]], path: Path) -> None:
    """Write the page; everything that is given as text is escaped.

    The counts and the list of chapters come first, then each chapter: what came of it, claims, tables, figures.

    Args:
        r: The reproduction.
        images: Chapter -> addresses of its figures, in order.
        path: File to write.
    """
    functions = (about, by_place, clock, difference, number, tally, verdict_counts)
    write_page(
        path,
        "reproduction.html",
        "studies.reproduction",
        r=r,
        chapters=[(done, images.get(done.name, ())) for done in r.chapters],
        classes=CLASSES,
        short=SHORT,
        split=split,
        **{function.__name__: function for function in functions},
    )


def split(claims: Sequence[Claim]) -> tuple[list[Claim], list[Claim]]:
    """Claims to show at once, and claims to fold away.

    Args:
        claims: Claims of a chapter.

    Returns:
        All and none if they are few; otherwise those that do not hold, and those that do.
    """
    if len(claims) <= LONG_LIST:
        return list(claims), []
    held = [claim for claim in claims if claim.verdict == HOLDS]
    return [claim for claim in claims if claim.verdict != HOLDS], held
