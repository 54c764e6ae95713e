"""A short formula for what no effect of the shelf explains, chosen term by term by the evidence."""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float

from manoeuvre_nn.diagnosis.bench import LATENCY_SPREAD, SCATTER_LEVELS, Bench, Place, quiet
from manoeuvre_nn.diagnosis.columns import moved_by
from manoeuvre_nn.diagnosis.court import Court
from manoeuvre_nn.diagnosis.hypothesis import Hypothesis, Judged
from manoeuvre_nn.diagnosis.linear import Columns
from manoeuvre_nn.diagnosis.runs import CHANNELS, COUNT
from manoeuvre_nn.effect.formula import Formula, is_ordinary, library

MOST = 4
"""Terms in a formula."""
ORDINARY = 12.0
"""Log evidence that a formula must have besides if a calm-water model could have all its terms: it may be a coefficient
that is off by more than is usual."""
SIZES = (0.02, 0.1, 0.4, 1.5)
"""What a term may add, root mean square over the runs, over the resistance and the force of 20 deg of rudder."""


@dataclass(frozen=True)
class Found:
    """A formula.

    Attributes:
        terms: Its terms, in the order in which they were chosen.
        judged: It, as a hypothesis.
        evidence: Its log evidence less what its choice costs.
    """

    terms: tuple[str, ...]
    judged: Judged
    evidence: float


def short_formula(court: Court, none: Judged) -> Found | None:
    """Choose terms one after another as long as each raises the evidence by more than its choice costs.

    A library of 140 shapes is rolled out through all runs once; what any further term would add to the evidence follows
    from the inner products, coefficients, initial states, latency and coloured force integrated out.

    Args:
        court: The runs.
        none: Calm water, for the noise levels.

    Returns:
        The formula; None if no term is worth its choice.
    """
    bench, terms = court.bench, library()
    made = [_columns(bench, place, terms) for place in bench.places]
    columns, index = [c for c, _ in made], [np.arange(len(terms))] * len(made)
    unit = 1 / np.sqrt(np.mean([m for _, m in made], axis=0) + 1e-12)
    level, scatter = quiet(none.best[0]), min(none.best[1], 2)
    chosen = _chosen(bench.gram(level, columns, index, len(terms)), bench, scatter, unit)
    if not chosen:
        return None
    effect = Formula(bench.dynamics.hull, [terms[k] for k, _ in chosen], [float(spread) for _, spread in chosen])
    start = Hypothesis((effect,), (np.zeros((len(bench.places), len(chosen))),))
    fitted, _ = court.improve(start, level, scatter)
    judged = court.judge(fitted, around=level)
    choices = sum(np.log(len(SIZES) * (len(terms) - k) / (k + 1)) for k in range(len(chosen)))
    ordinary = ORDINARY if all(is_ordinary(term) for term in effect.terms) else 0.0
    return Found(effect.terms, judged, judged.evidence - float(choices) - ordinary)


def _columns(bench: Bench, place: Place, terms: tuple[str, ...]) -> tuple[Columns, Float[np.ndarray, " terms"]]:
    """What a unit of every term does to a run, and its mean square force."""
    effect, s = Formula(bench.dynamics.hull, terms), place.situation
    measured = np.zeros((len(s.psi), COUNT, len(terms)))
    pushes, squares = [], np.zeros(len(terms))
    with torch.no_grad():
        for k, term in enumerate(terms):
            push, errors = effect.unit_of(term, s)
            pushes.append(push)
            squares[k] = float((push / effect.get_buffer("size")).square().mean(dim=0).max())
            for channel, error in errors.items():
                measured[:, CHANNELS.index(channel), k] = error.numpy()
                squares[k] = 1.0
        a = torch.stack(pushes)
        moved = moved_by(a, a.new_zeros(*a.shape[:2], 2), place.line).permute(1, 2, 0).numpy()
    return Columns(measured, moved), squares


def _chosen(
    gram: Float[np.ndarray, "p p"], bench: Bench, scatter: int, unit: Float[np.ndarray, " terms"]
) -> list[tuple[int, float]]:
    """Numbers of the terms and the prior spread of their weights, greedily by evidence."""
    n = bench.size
    coefficients = np.full(len(bench.coefficients), SCATTER_LEVELS[scatter] ** -2.0)
    precision = np.r_[coefficients, np.full(len(bench.places), LATENCY_SPREAD**-2)]
    chosen: list[tuple[int, float]] = []
    while len(chosen) < MOST:
        at = np.r_[1:n, n + np.array([k for k, _ in chosen], dtype=int)]
        a = gram[np.ix_(at, at)] + np.diag(np.r_[precision, [spread**-2 for _, spread in chosen]])
        solved = np.linalg.solve(a, gram[at])
        own = np.diag(gram)[n:] - np.einsum("ij,ij->j", gram[at, n:], solved[:, n:])
        pull = gram[0, n:] - gram[0, at] @ solved[:, n:]
        spreads = np.array(SIZES)[:, None] * unit
        gain = 0.5 * pull**2 / (own + spreads**-2) - 0.5 * np.log1p(own * spreads**2)
        gain[:, [k for k, _ in chosen]] = -np.inf
        size, best = np.unravel_index(int(gain.argmax()), gain.shape)
        if gain[size, best] < np.log(gain.size / (len(chosen) + 1)):
            break
        chosen.append((int(best), float(spreads[size, best])))
    return chosen
