"""Coefficients that recordings do not tell apart: which, what of them is determined, and what would part them."""

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from jaxtyping import Float, Int
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.sparse.csgraph import connected_components
from scipy.spatial.distance import squareform

from manoeuvre_nn.estimation.coefficients import MAX_CORRELATION, Fitted
from manoeuvre_nn.network.series import VARIABLES

MIN_CORRELATION = 0.9
"""Correlation beyond which two coefficients are not told apart."""
MOTIONS = {"v": "drift", "|v|": "drift", "r": "yaw rate", "|r|": "yaw rate", "d": "rudder angle", "|d|": "rudder angle"}
MOTIONS |= {"wx": "wind", "wy": "wind", "|w|": "wind"}
UNSPELT_PRODUCTS = {"ccbd": ["v", "d"], "cross": ["v", "|v|", "|d|"]}
"""Products of the tanker family whose names do not spell their variables."""
PARTED_BY = {
    frozenset({"drift", "yaw rate"}): "a drift test, or a pull-out and turning circles at several rudder angles",
    frozenset({"drift", "rudder angle"}): "runs that drift with the rudder amidships: a pull-out",
    frozenset({"yaw rate", "rudder angle"}): "runs that turn with the rudder amidships: a pull-out",
}
"""Motions that go together -> what would part them."""


COLUMNS = ["symbols", "correlation", "determined", "value", "error", "words"]
"""Of groups of coefficients."""


def collinear_groups(fitted: Fitted) -> pd.DataFrame:
    """Groups of coefficients that are known only together.

    Complete linkage: in a group every pair is correlated; groups of which two coefficients are tied beyond
    :data:`.MAX_CORRELATION` are one. What is determined is the eigenvector of the least variance in units of the prior.

    Args:
        fitted: The coefficients.

    Returns:
        One row a group, the closest first: symbols; correlation: the largest in size; determined: combination that the
        recordings fix, in symbols; value, error: its value and standard error; words: what is not told apart, and what
        would part it.

    Source:
        Belsley, Kuh & Welsch 1980, chapter 3; manoeuvring: Hwang 1982, "cancellation" of drift and yaw coefficients.
    """
    if len(fitted.values) < 2:
        return pd.DataFrame(columns=COLUMNS)
    correlation = fitted.correlation
    apart = np.clip(1 - np.abs(correlation), 0.0, None)
    np.fill_diagonal(apart, 0.0)
    labels = fcluster(linkage(squareform(apart, checks=False), "complete"), 1 - MIN_CORRELATION, "distance")
    alike = (labels[:, None] == labels) | (np.abs(correlation) > MAX_CORRELATION)
    labels = connected_components(alike, directed=False)[1]
    groups = [np.flatnonzero(labels == k) for k in np.unique(labels)]
    made = [_group(fitted, correlation, g) for g in groups if len(g) > 1]
    return pd.DataFrame(made, columns=COLUMNS).sort_values("correlation", key=lambda c: -c.abs(), kind="stable")


def _group(fitted: Fitted, correlation: Float[np.ndarray, "p p"], places: Int[np.ndarray, " g"]) -> tuple[Any, ...]:
    """What is to be said of a group."""
    inner = correlation[np.ix_(places, places)]
    off = inner[np.triu_indices(len(places), 1)]
    _, vectors = np.linalg.eigh(fitted.in_prior_units[np.ix_(places, places)])
    weights = vectors[:, 0] / fitted.spread[places]
    weights = weights / weights[np.argmax(np.abs(vectors[:, 0]))]
    symbols = tuple(fitted.symbols[k] for k in places)
    value = float(weights @ fitted.values[places])
    error = float(np.sqrt(max(weights @ fitted.covariance[np.ix_(places, places)] @ weights, 0.0)))
    largest = float(off[np.argmax(np.abs(off))])
    return symbols, largest, _sum(weights, symbols), value, error, _words([fitted.names[k] for k in places])


def _sum(weights: Float[np.ndarray, " g"], symbols: Sequence[str]) -> str:
    """A weighted sum in symbols."""
    parts = []
    for weight, name in zip(weights, symbols, strict=True):
        sign = "-" if weight < 0 else "+"
        size = "" if abs(abs(weight) - 1) < 5e-4 else f"{abs(weight):.3g} "
        parts.append(f"{sign} {size}{name}")
    return " ".join(parts).removeprefix("+ ")


def _variables(term: str) -> list[str]:
    """Its variables that say how the ship moves; those of a ship's own source are read from its letters."""
    tokens = term.split()
    if len(tokens) == 1 and tokens[0] not in VARIABLES:
        tokens = UNSPELT_PRODUCTS.get(term) or re.findall(r"\|v\||[vrd]", term)
    return [t for t in tokens if t in MOTIONS]


def _words(names: Sequence[tuple[int, str]]) -> str:
    """What is not told apart, and what would."""
    motions = [frozenset(MOTIONS[v] for v in _variables(term)) for _, term in names]
    if len({o for o, _ in names}) > 1 and len({t for _, t in names}) == 1:
        return "forces and moment of the same motion show together; weigh the inertia again, or measure forces"
    if len(set(motions)) == 1:
        return _within(names)
    shared = frozenset.intersection(*motions)
    parts = sorted({m for one in motions for m in one - shared}) or sorted(shared)
    if len(parts) == 1:
        return f"{parts[0]} goes with the rest of the motion in these runs; add runs with more and with less of it"
    cure = PARTED_BY.get(frozenset(parts), "runs in which they differ: a spiral, a pull-out, turning circles")
    return f"{', '.join(parts[:-1])} and {parts[-1]} are not told apart in these runs; add {cure}"


def _within(names: Sequence[tuple[int, str]]) -> str:
    """Products of one motion that differ in order, or in the powers of speed and shaft speed."""
    bare = {" ".join(sorted(_variables(term))) for _, term in names}
    if len(bare) > 1 and len({len(b.split()) for b in bare}) == 1:
        return "these products are alike in these runs; add more drift for the same yaw rate, or leave one out"
    if len(bare) > 1:
        return "small and large motions are not told apart; add gentler and harder runs (5/5 zigzag, 35 deg turn)"
    return "speed and shaft speed do not differ enough; add runs at other shaft speeds, or a stop"
