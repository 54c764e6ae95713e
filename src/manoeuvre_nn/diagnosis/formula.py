"""A short formula for what no effect of the shelf explains, chosen term by term by the evidence."""

from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float

from manoeuvre_nn.core.channels import MEASURED
from manoeuvre_nn.effect.formula import Formula, is_ordinary, library
from manoeuvre_nn.estimation.data_set import PreparedRun, WhitenedDataSet, quiet
from manoeuvre_nn.estimation.effect_columns import moved_by, with_roll
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis, Hypothesis
from manoeuvre_nn.estimation.linear_run import Columns
from manoeuvre_nn.estimation.marginal_likelihood import MarginalLikelihood

MAX_TERMS = 4
"""Terms in a formula."""
ORDINARY = 12.0
"""Log evidence that a formula must have besides if a calm-water model could have all its terms: it may be a coefficient
that is off by more than is usual."""
SIZES = (0.02, 0.1, 0.4, 1.5)
"""What a term may add, root mean square over the runs, over the resistance and the force of 20 deg of rudder."""


def short_formula(likelihood: MarginalLikelihood, none: FittedHypothesis) -> FittedHypothesis | None:
    """Choose terms one after another as long as each raises the evidence by more than its choice costs.

    A library of 140 shapes is rolled out through all runs once; what any further term would add to the evidence follows
    from the inner products, coefficients, initial states, latency and coloured force integrated out.

    Returns:
        The formula, its evidence less what the choice of its terms costs; None if no term is worth that.
    """
    data_set, terms = likelihood.data_set, library()
    made = [_columns(data_set, prepared, terms) for prepared in data_set.runs]
    columns, index = [c for c, _ in made], [np.arange(len(terms))] * len(made)
    unit = 1 / np.sqrt(np.mean([m for _, m in made], axis=0) + 1e-12)
    level, scatter = quiet(none.best[0]), min(none.best[1], 2)
    chosen = _chosen(
        data_set.gram(level, data_set.embedded(level, columns), index, len(terms)), data_set, scatter, unit
    )
    if not chosen:
        return None
    effect = Formula(data_set.dynamics.hull, [terms[k] for k, _ in chosen], [float(spread) for _, spread in chosen])
    start = Hypothesis((effect,), (np.zeros((len(data_set.runs), len(chosen))),))
    best, _ = likelihood.improve(start, level, scatter)
    fitted = likelihood.evaluate(best, around=level)
    choices = sum(np.log(len(SIZES) * (len(terms) - k) / (k + 1)) for k in range(len(chosen)))
    ordinary = ORDINARY if all(is_ordinary(term) for term in effect.terms) else 0.0
    return replace(fitted, evidence=fitted.evidence - float(choices) - ordinary)


def _columns(
    data_set: WhitenedDataSet, prepared: PreparedRun, terms: tuple[str, ...]
) -> tuple[Columns, Float[np.ndarray, " terms"]]:
    """What a unit of every term does to a run, and its mean square force."""
    effect, s = Formula(data_set.dynamics.hull, terms), prepared.linearised.situation
    measured = np.zeros((len(s.psi), len(prepared.linearised.states.channels), len(terms)))
    pushes, squares = [], np.zeros(len(terms))
    with torch.no_grad():
        for k, term in enumerate(terms):
            push, errors = effect.unit_of(term, s)
            pushes.append(push)
            squares[k] = float((push / effect.get_buffer("size")).square().mean(dim=0).max())
            for channel, error in errors.items():
                measured[:, MEASURED.index(channel), k] = error.numpy()
                squares[k] = 1.0
        a = with_roll(effect.ship, torch.stack(pushes), 0 * s.u)
        moved = moved_by(a, a.new_zeros(*a.shape[:2], 2), prepared.linearised).permute(1, 2, 0).numpy()
    return Columns(measured, moved), squares


def _chosen(
    gram: Float[np.ndarray, "p p"], data_set: WhitenedDataSet, scatter: int, unit: Float[np.ndarray, " terms"]
) -> list[tuple[int, float]]:
    """Numbers of the terms and the prior spread of their weights, greedily by evidence."""
    n = data_set.size
    precision = data_set.nuisance_sd(scatter, len(data_set.runs)) ** -2.0
    chosen: list[tuple[int, float]] = []
    while len(chosen) < MAX_TERMS:
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
