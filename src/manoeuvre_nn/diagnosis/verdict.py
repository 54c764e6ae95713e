"""From evidence to a verdict: probabilities of every effect, of none, and of something unknown."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from manoeuvre_nn.diagnosis.alarm import LEAST_MORE, LEAST_UNKNOWN, raised
from manoeuvre_nn.diagnosis.formula import Found, short_formula
from manoeuvre_nn.diagnosis.hypothesis import Judged
from manoeuvre_nn.diagnosis.search import Contest
from manoeuvre_nn.diagnosis.unknown import unknown_evidence

PRIOR = {"none": 0.25, "single": 0.53, "pair": 0.12, "unknown": 0.10}
"""Declared base rates: calm water holds, one effect, two, or something that the shelf does not have."""
MOST_LACKED = 0.1
"""Coloured force over the resistance and over 20 deg of rudder that a model fitted to other recordings may lack by
itself; more is something that it never met."""
QUIET = 0.6
"""Least probability of calm water as long as no alarm is raised."""


@dataclass(frozen=True)
class Verdict:
    """Probabilities.

    Attributes:
        named: Whether the best named hypothesis beats calm water by more than chance.
        strange: Whether something unknown does.
        none: That calm water explains the recordings.
        unknown: That something acts which the shelf does not have.
        effects: Of every effect being present.
        best: The most probable hypothesis with a name; None if there is none.
        bayes: Log Bayes factor of the best hypothesis of every effect over calm water.
        stranger: Log Bayes factor of something unknown over calm water.
        formula: The best short formula for something unknown; None if no term is worth its choice.
    """

    named: bool
    strange: bool
    none: float
    unknown: float
    effects: Mapping[str, float]
    best: Judged | None
    bayes: Mapping[str, float]
    stranger: float = 0.0
    formula: Found | None = None


def decide(contest: Contest, temperature: float = 1.0) -> Verdict:
    """Weigh all hypotheses.

    Args:
        contest: What was judged.
        temperature: Log evidences are divided by it: more than 1 where they were found too sure of themselves.

    Returns:
        The verdict.
    """
    formula = short_formula(contest.court, contest.none)
    # A fitted model has errors that a formula takes up: to raise the alarm it must hold on other runs first.
    bench = contest.court.bench
    stranger = unknown_evidence(contest.court, contest.none, None if bench.dynamics.fitted else formula)
    judged = [j for j in contest.judged if _worth_its_size(contest, j)]
    names = sorted({n for j in contest.judged for n in j.names})
    singles, pairs = len(names), max(len(names) * (len(names) - 1) / 2, 1)
    weights: list[tuple[tuple[str, ...], float, float]] = [((), contest.none.evidence, PRIOR["none"])]
    weights.append((("unknown",), stranger, PRIOR["unknown"]))
    for j in judged:
        prior = PRIOR["single"] / singles if len(j.names) == 1 else PRIOR["pair"] / pairs
        weights.append((j.names, j.evidence, prior))
    log_weight = np.array([evidence / temperature + np.log(prior) for _, evidence, prior in weights])
    share = np.exp(log_weight - log_weight.max())
    share /= share.sum()
    best = judged[int(log_weight[2:].argmax())] if judged else None
    named, strange = raised(contest, best), stranger - contest.none.evidence > LEAST_UNKNOWN
    strange |= bench.dynamics.fitted and bool(bench.levels[contest.none.best[0]].max() > MOST_LACKED)
    if named or strange:
        if share[0] > 1 - QUIET:
            share[1:] *= QUIET / share[1:].sum()
            share[0] = 1 - QUIET
    elif share[0] < QUIET:
        share[1:] *= (1 - QUIET) / share[1:].sum()
        share[0] = QUIET
    effects = {n: float(sum(p for (has, *_), p in zip(weights, share, strict=True) if n in has)) for n in names}
    bayes = {n: max(j.evidence for j in contest.judged if n in j.names) - contest.none.evidence for n in names}
    return Verdict(
        named,
        strange,
        float(share[0]),
        float(share[1]),
        effects,
        best,
        bayes,
        stranger - contest.none.evidence,
        formula,
    )


def _worth_its_size(contest: Contest, judged: Judged) -> bool:
    """A second effect must add more than chance does."""
    if len(judged.names) < 2:
        return True
    parts = [j.evidence for j in contest.judged if len(j.names) == 1 and j.names[0] in judged.names]
    return judged.evidence > max(parts, default=-np.inf) + LEAST_MORE
