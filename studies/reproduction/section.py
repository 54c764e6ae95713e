"""What a chapter of a paper comes to when it is done again: claims, tables and plots, as data."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

Verdict = Literal["holds", "holds in direction", "does not hold", "not comparable"]
Say = Callable[[str], None]
"""Tells the person who waits what is being done."""


@dataclass(frozen=True)
class ComputingEffort:
    """How much computing a reproduction may take.

    Attributes:
        quick: Whether it is the short form: fewer starts and shorter trainings, every table and figure all the same.
        starts: Trainings from different first weights that a distribution is made of.
        seed: Seed of everything that is drawn.
    """

    quick: bool = False
    starts: int = 8
    seed: int = 0


@dataclass(frozen=True)
class Claim:
    """One number or statement of a paper beside ours.

    Attributes:
        where: Table, figure or section of the paper: ``Table 5.1``.
        what: What it is about: ``Y_v, estimated``.
        paper: The paper's value, or its statement in our words.
        ours: Our value, or what we found.
        verdict: Whether it holds.
        why: Why it does not hold or cannot be compared, or how far it does; empty where nothing needs to be said.
        unit: Unit of both values; empty if they have none.
    """

    where: str
    what: str
    paper: float | str
    ours: float | str
    verdict: Verdict
    why: str = ""
    unit: str = ""

    @property
    def difference(self) -> float | None:
        """Ours minus the paper's, None where they are no numbers."""
        if isinstance(self.paper, str) or isinstance(self.ours, str):
            return None
        return self.ours - self.paper


@dataclass(frozen=True)
class Line:
    """A curve.

    Attributes:
        label: What it is; empty leaves it out of the legend.
        x: Abscissa.
        y: Ordinate.
        role: ``reference`` for what is to be met, ``ours`` for what we got, ``paper`` for published numbers, ``other``.
        points: Whether it is drawn as points.
    """

    label: str
    x: Float[np.ndarray, " n"]
    y: Float[np.ndarray, " n"]
    role: Literal["reference", "ours", "paper", "other"] = "ours"
    points: bool = False


@dataclass(frozen=True)
class Panel:
    """One pair of axes.

    Attributes:
        x_label: Abscissa with its unit.
        y_label: Ordinate with its unit.
        lines: Curves.
        title: Heading; empty for none.
        equal: Whether both axes have one scale, as tracks need it.
        log_y: Whether the ordinate is logarithmic.
    """

    x_label: str
    y_label: str
    lines: Sequence[Line]
    title: str = ""
    equal: bool = False
    log_y: bool = False


@dataclass(frozen=True)
class Plot:
    """A figure of a paper, drawn again.

    Attributes:
        name: File name without ending: ``figure_4_7``.
        caption: What is to be seen, with the number of the paper's figure.
        panels: Axes, from left to right and then down.
    """

    name: str
    caption: str
    panels: Sequence[Panel]


@dataclass(frozen=True)
class ChapterResult:
    """A chapter done again.

    Attributes:
        title: Heading: ``Chapter 5: generalization and regression``.
        summary: What came of it, a sentence or two.
        claims: The paper's numbers and statements beside ours.
        tables: Heading -> rows (column -> cell) for what is no comparison: distributions, condition numbers.
        plots: Figures.
    """

    title: str
    summary: str
    claims: Sequence[Claim]
    tables: Mapping[str, Sequence[Mapping[str, Any]]] = field(default_factory=dict)
    plots: Sequence[Plot] = ()


Chapter = Callable[[ComputingEffort, Say], ChapterResult]
"""Does a chapter again."""


def by_tolerance(
    paper: float, ours: float, *, within: float | None = None, relative: float | None = None, same_sign: bool = False
) -> Verdict:
    """A number beside the paper's, judged by a tolerance.

    Args:
        paper: The paper's value.
        ours: Ours.
        within: Largest difference at which it holds, in the unit of the values.
        relative: The same over the paper's value [-]; one of the two must be given, with both either suffices.
        same_sign: Whether equal signs are enough to hold in direction where the tolerance is missed.

    Returns:
        The verdict.

    Raises:
        ValueError: If no tolerance is given.
    """
    if within is None and relative is None:
        raise ValueError(f"{paper} beside {ours}: give within= or relative=")
    allowed = max(within or 0.0, (relative or 0.0) * abs(paper))
    if isfinite(ours) and abs(ours - paper) <= allowed:
        return "holds"
    return "holds in direction" if same_sign and ours * paper > 0 else "does not hold"
