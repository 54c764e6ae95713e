"""Which run to record next: each one that could be is fitted by how far a rival could imitate what was found.

Under the leading hypothesis A a run contributes ``a`` to the recordings, under a rival B ``b + J t`` with its free
numbers moved by ``t``, and coefficients, latency, initial states and the process noise are free under both. In the
whitened metric of the samples, ``N = (columns of the nuisance, J)`` and ``P`` their prior precision, the log Bayes
factor by which A is expected to beat B is

    ln B = 1/2 [d'd - d'N (N'N + P)^-1 N'd],    d = a - b,

half the squared norm of what neither B nor the nuisance can imitate: the Fisher information on "how much of A" with
all else projected out. What a run adds is ln B over the recordings *and* the run, less ln B over the recordings alone:
the same values of B have to explain both. The noise is what B needs to explain the recordings: what B calls noise there
it will call noise again.

Source:
    Atkinson & Fedorov 1975 (Biometrika 62:57), T-optimality, with a prior on the rival's numbers; Box & Hill 1967
    (Technometrics 9:57) for the expected evidence. What the sizes of the posteriors add (Occam's factors) is left out.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.diagnosis.next_runs import Plan, new_runs, same_runs
from manoeuvre_nn.estimation.data_set import COEFFICIENT_SD_LEVELS, WhitenedDataSet
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis, Hypothesis
from manoeuvre_nn.estimation.hypothesis_columns import HypothesisColumns, hypothesis_columns
from manoeuvre_nn.estimation.linear_run import Columns, joined
from manoeuvre_nn.estimation.prepared_run import LATENCY_SD, about_states

REFIT_SPREADS = 3.0
"""Prior spreads within which a rival may be fitted again."""


Ranked = list[tuple[float, Plan]]
"""Runs worth recording, the most telling first, each with what it is expected to add to the log Bayes factor."""


def advise(data_set: WhitenedDataSet, leading: FittedHypothesis, rivals: Sequence[FittedHypothesis]) -> list[Ranked]:
    """Simulate what could be recorded next and rank it by how well it tells the leading hypothesis from each rival.

    Args:
        data_set: The recordings.
        leading: What was found, or what calm water is to be told from.
        rivals: Other explanations; a hypothesis without effects is calm water.

    Returns:
        One list a rival; among the runs are the recorded ones with a channel more.
    """
    plans = [*new_runs(data_set, leading.hypothesis), *same_runs(data_set)]
    again = [about_states(data_set.dynamics, p, p.linearised.track) for p in data_set.runs]
    # Coefficients as they are, not in the combinations that the recordings show: a new run may show others.
    data_set = WhitenedDataSet(
        data_set.dynamics, [*again, *(plan.prepared for plan in plans)], data_set.coefficient_prior
    )
    rows = [*range(len(again)), *(plan.row for plan in plans)]
    whole = _whole(data_set, leading.hypothesis, rows)
    return [_ranked(data_set, whole, r.hypothesis.of_runs(rows), r.best, plans) for r in rivals]


def apart(data_set: WhitenedDataSet, leading: Hypothesis, rival: Hypothesis, best: tuple[int, int]) -> float:
    """Log Bayes factor by which one hypothesis is expected to beat another, fitted at its best noise levels."""
    grams, sd = _grams(data_set, _whole(data_set, leading, range(len(data_set.runs))), rival, best)
    return left_over(sum(grams, np.zeros_like(grams[0])), sd)


def _grams(
    data_set: WhitenedDataSet, whole: Sequence[Columns], rival: Hypothesis, best: tuple[int, int]
) -> tuple[list[Float[np.ndarray, "p p"]], Float[np.ndarray, " m"]]:
    """Inner products in every run, and the prior spreads of all but the first column."""
    lin = hypothesis_columns(data_set, rival) if rival.effects else None
    shared = np.array([not f.parameter.per_run for f in rival.unknowns()], dtype=bool)
    spreads = (REFIT_SPREADS * rival.prior_sds())[shared].tolist()
    sd = np.array([COEFFICIENT_SD_LEVELS[best[1]]] * data_set.combinations + spreads)
    first = 1 + data_set.combinations
    place = first + np.cumsum(shared) - 1  # a run of a campaign has the numbers of that alone
    grams = []
    for run, c in enumerate(whole):
        mine = np.zeros(0, dtype=int) if lin is None else lin.index[run][1:] - 1
        at = np.r_[:first, place[mine[shared[mine]]]].astype(int)
        gram = np.zeros((1 + len(sd),) * 2)
        gram[np.ix_(at, at)] = _shared(data_set, best[0], run, c, lin)
        grams.append(gram)
    return grams, sd


def _ranked(
    data_set: WhitenedDataSet,
    whole: Sequence[Columns],
    rival: Hypothesis,
    best: tuple[int, int],
    plans: Sequence[Plan],
) -> Ranked:
    """What every plan adds to the recordings, at the noise that the rival itself needs."""
    grams, sd = _grams(data_set, whole, rival, best)
    recorded = len(grams) - len(plans)
    known = sum(grams[:recorded], np.zeros_like(grams[0]))
    before = left_over(known, sd)
    made = [(left_over(known + g, sd) - before, plan) for plan, g in zip(plans, grams[recorded:], strict=True)]
    return sorted(made, key=lambda run: -run[0])


def left_over(gram: Float[np.ndarray, "p p"], spread: Float[np.ndarray, " m"]) -> float:
    """Half the squared norm of the first column that the others cannot imitate within their priors.

    Args:
        gram: Inner products of all columns.
        spread: Prior standard deviations of the factors of all but the first.

    Returns:
        An expected log Bayes factor.
    """
    inner = gram[1:, 1:] * spread[:, None] * spread[None, :] + np.eye(len(spread))
    b = gram[1:, 0] * spread
    return max(0.5 * float(gram[0, 0] - b @ np.linalg.solve(inner, b)), 0.0)


def _shared(
    data_set: WhitenedDataSet, level: int, run: int, whole: Columns, lin: HypothesisColumns | None
) -> Float[np.ndarray, "p p"]:
    """Inner products in one run of: A less B, coefficients, numbers of B; those of this run alone integrated out."""
    here, k = data_set.at(level), data_set.combinations
    free = [] if lin is None else [lin.hypothesis.unknowns()[i - 1] for i in lin.index[run][1:]]
    sds = np.zeros(0) if lin is None else REFIT_SPREADS * lin.hypothesis.prior_sds()[lin.index[run][1:] - 1]
    columns = whole
    if lin is not None:
        b = lin.columns[run]
        columns = joined([whole - b[:1], b[1:]])
    both = here.base[run].joined(here.white[run].embed(columns))
    # The base last, its data without a part.
    g, p = both.dot(both), 1 + len(free)
    g = g if lin is None else lin.turn(run, g, gram=True)
    order = np.r_[2 + k : len(g), 0 : 2 + k]
    g, latency = g[np.ix_(order, order)], p + 1 + k
    own = [*(j for j, f in enumerate(free, 1) if f.parameter.per_run), latency]
    kept = [0, *range(p + 1, latency), *(j for j, f in enumerate(free, 1) if not f.parameter.per_run)]
    spread = np.array([*(sd for sd, f in zip(sds, free, strict=True) if f.parameter.per_run), LATENCY_SD])
    cross = g[np.ix_(own, kept)]
    return g[np.ix_(kept, kept)] - cross.T @ np.linalg.solve(g[np.ix_(own, own)] + np.diag(spread**-2.0), cross)


def _whole(data_set: WhitenedDataSet, hypothesis: Hypothesis, rows: Sequence[int]) -> list[Columns]:
    """All that a hypothesis adds to every run, at its values."""
    held = frozenset(p.name for e in hypothesis.effects for p in e.declared)
    return hypothesis_columns(data_set, replace(hypothesis.of_runs(rows), fixed=held)).columns
