"""A short formula for what no effect of the shelf explains, chosen term by term by the evidence."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import torch
from jaxtyping import Float

from manoeuvre_nn.core.channels import MEASURED
from manoeuvre_nn.diagnosis.recurring import recurring
from manoeuvre_nn.effect.formula import BY_RUN, GROWING, LAG, PERIODIC, Formula, in_time, is_ordinary, library, mark_of
from manoeuvre_nn.estimation.data_set import WhitenedDataSet
from manoeuvre_nn.estimation.effect_columns import moved_by, own_states, with_roll
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis, Hypothesis
from manoeuvre_nn.estimation.linear_run import Columns
from manoeuvre_nn.estimation.marginal_likelihood import MarginalLikelihood

MAX_TERMS = 4
"""Terms in a formula."""
ORDINARY = 12.0
"""Log evidence that a formula must have besides for terms that a calm-water model could have: they may be coefficients
that are off by more than is usual."""
SIZES = (0.02, 0.1, 0.4, 1.5)
"""What a term may add, root mean square over the runs, over the resistance and the force of 20 deg of rudder."""
PROMPT = 0.5
"""Memory over L/U0 below which a force follows the motion as any force of a hull does."""
SHORTEST_MEMORY_S, MEMORIES = 5.0, 7
"""Time constant from which forces are tried that follow the motion late; up to a third of a run; how many."""


@dataclass(frozen=True)
class _Candidate:
    """What may be added to a formula.

    Attributes:
        terms: Its terms, two for a wave of unknown phase.
        shares: Their shares, in all runs or in each.
        scales: Memory, period or waves a kilometre.
        tried: Of how many alike it is the best already.
    """

    terms: tuple[str, ...]
    shares: tuple[tuple[float, ...], ...] = ((1.0,),)
    scales: Mapping[str, float] = field(default_factory=dict)
    tried: int = 1

    @property
    def numbers(self) -> int:
        """How many weights its shares stand for: those of a wave with its own phase in each run are free in each."""
        return sum(map(len, self.shares)) if len(self.shares) > 1 else 1

    def of_run(self, run: int) -> tuple[float, ...]:
        """Shares in a run."""
        return self.shares[run if len(self.shares) > 1 else 0]

    def beside(self, others: Sequence["_Candidate"]) -> bool:
        """Whether it can stand beside others: what terms of a kind share must be the same, and the kind of phase."""
        marks = {mark_of(term) for c in (self, *others) for term in c.terms}
        if marks >= {PERIODIC, BY_RUN}:
            return False
        told = {name: value for other in others for name, value in other.scales.items()}
        new = not any(set(self.terms) & set(other.terms) for other in others)
        return new and all(told.get(name, value) == value for name, value in self.scales.items())


def _candidates(data_set: WhitenedDataSet) -> list[_Candidate]:
    """All terms of the library, late ones at several time constants, and what comes again most clearly."""
    plain = [_Candidate((term,)) for term in library() if not mark_of(term)]
    grown = [_Candidate((term,)) for term in in_time() if mark_of(term) == GROWING]
    longest = min(p.linearised.run.duration for p in data_set.runs) / 3
    memories = np.geomspace(SHORTEST_MEMORY_S, max(longest, 2 * SHORTEST_MEMORY_S), MEMORIES)
    late = [
        _Candidate((term,), scales={"memory_s": float(m)})
        for term in in_time()
        if mark_of(term) == LAG
        for m in memories
    ]
    waves = [
        _Candidate((f"{w.equation} cos {w.mark}", f"{w.equation} sin {w.mark}"), w.shares, w.scales, w.tried)
        for w in recurring(data_set)
    ]
    return [*plain, *grown, *late, *waves]


def short_formula(likelihood: MarginalLikelihood, none: FittedHypothesis) -> FittedHypothesis | None:
    """Choose terms one after another as long as each raises the evidence by more than its choice costs.

    Some 250 shapes are rolled out through all runs once; what any further term would add to the evidence follows
    from the inner products, coefficients, initial states, latency and process noise integrated out.

    Returns:
        The formula, its evidence less what the choice of its terms costs; without the terms that a calm-water model
        could have if it is likelier so. None if no term is worth that.
    """
    data_set = likelihood.data_set
    candidates = _candidates(data_set)
    made = [_columns(data_set, run, candidates) for run in range(len(data_set.runs))]
    columns, index = [c for c, _ in made], [np.arange(len(candidates))] * len(made)
    unit = 1 / np.sqrt(np.mean([m for _, m in made], axis=0) + 1e-12)
    level, scatter = data_set.levels.quiet(none.best[0]), min(none.best[1], 2)
    gram = data_set.gram(level, data_set.embedded(level, columns), index, len(candidates))
    chosen = [(candidates[k], spread) for k, spread in _chosen(gram, data_set, scatter, unit, candidates)]
    found = []
    while chosen:
        fitted, usual = _fitted(likelihood, level, scatter, chosen)
        # How often a period was tried is in its prior.
        choices = sum(np.log(len(SIZES) * (len(candidates) - k) / (k + 1)) for k in range(len(chosen)))
        ordinary = ORDINARY if any(usual) else 0.0
        found.append(replace(fitted, evidence=fitted.evidence - float(choices) - ordinary))
        chosen = [one for one, is_usual in zip(chosen, usual, strict=True) if any(usual) and not is_usual]
    return max(found, key=lambda j: j.evidence, default=None)


def _fitted(
    likelihood: MarginalLikelihood, level: int, scatter: int, chosen: Sequence[tuple[_Candidate, float]]
) -> tuple[FittedHypothesis, list[bool]]:
    """A formula of some candidates with the prior spreads of their weights; which of them calm water could have."""
    data_set = likelihood.data_set
    terms = [term for c, _ in chosen for term in c.terms]
    spreads = [spread for c, spread in chosen for _ in c.terms]
    effect = Formula(data_set.dynamics.hull, terms, spreads, {k: v for c, _ in chosen for k, v in c.scales.items()})
    values = effect.values.numpy() * [not p.name.startswith("w") for p in effect.declared]
    start = Hypothesis((effect,), (np.tile(values, (len(data_set.runs), 1)),))
    best, _ = likelihood.improve(start, level, scatter, rounds=5 if len(values) == len(terms) else 9)
    at = dict(zip((p.name for p in effect.declared), best.values[0][0], strict=True))
    prompt = at.get("memory_s", 0.0) < PROMPT * data_set.dynamics.particulars.time_unit
    usual = [all(is_ordinary(term) or (prompt and mark_of(term) == LAG) for term in c.terms) for c, _ in chosen]
    return likelihood.evaluate(best, around=level), usual


def _columns(
    data_set: WhitenedDataSet, run: int, candidates: Sequence[_Candidate]
) -> tuple[Columns, Float[np.ndarray, " terms"]]:
    """What a unit of every candidate does to a run, and its mean square force."""
    hull, prepared = data_set.dynamics.hull, data_set.runs[run]
    s, plain = prepared.linearised.situation, Formula(hull)
    measured = np.zeros((len(s.psi), len(prepared.linearised.states.channels), len(candidates)))
    pushes, moments, squares = [], [], np.zeros(len(candidates))
    with torch.no_grad():
        for k, c in enumerate(candidates):
            effect = Formula(hull, c.terms, scales=c.scales) if c.scales else plain
            memory = own_states(effect, s, 1, prepared.linearised.run.step)[0] if effect.memory else None
            made = [effect.unit_of(term, s, memory) for term in c.terms]
            shares = c.of_run(run)
            push = torch.stack([share * p for share, (p, _) in zip(shares, made, strict=True)]).sum(dim=0)
            errors = made[0][1]
            pushes.append(push)
            heeling = [share * effect.heeling_of_unit(term, s) for share, term in zip(shares, c.terms, strict=True)]
            moments.append(torch.stack(heeling).sum(dim=0))
            squares[k] = float((push / plain.get_buffer("size")).square().mean(dim=0).max())
            for channel, error in errors.items():
                measured[:, MEASURED.index(channel), k] = error.numpy()
                squares[k] = 1.0
        a = with_roll(hull, torch.stack(pushes), torch.stack(moments))
        moved = moved_by(a, a.new_zeros(*a.shape[:2], 2), prepared.linearised).permute(1, 2, 0).numpy()
    return Columns(measured, moved), squares


def _chosen(
    gram: Float[np.ndarray, "p p"],
    data_set: WhitenedDataSet,
    scatter: int,
    unit: Float[np.ndarray, " terms"],
    candidates: Sequence[_Candidate],
) -> list[tuple[int, float]]:
    """Numbers of the candidates and the prior spread of their weights, greedily by evidence."""
    n, searched = data_set.size, np.log([c.tried for c in candidates])
    numbers = np.array([c.numbers for c in candidates])
    precision = data_set.nuisance_sd(scatter, len(data_set.runs)) ** -2.0
    chosen: list[tuple[int, float]] = []
    while len(chosen) < MAX_TERMS:
        at = np.r_[1:n, n + np.array([k for k, _ in chosen], dtype=int)]
        a = gram[np.ix_(at, at)] + np.diag(np.r_[precision, [spread**-2 for _, spread in chosen]])
        solved = np.linalg.solve(a, gram[at])
        own = np.diag(gram)[n:] - np.einsum("ij,ij->j", gram[at, n:], solved[:, n:])
        pull = gram[0, n:] - gram[0, at] @ solved[:, n:]
        spreads = np.array(SIZES)[:, None] * unit
        # Each of a candidate's weights has its part of what the runs say and the same prior.
        gain = 0.5 * pull**2 / (own + spreads**-2) - 0.5 * numbers * np.log1p(own * spreads**2 / numbers)
        mine = [candidates[k] for k, _ in chosen]
        gain = np.where([c.beside(mine) for c in candidates], gain - searched, -np.inf)
        size, best = np.unravel_index(int(gain.argmax()), gain.shape)
        if gain[size, best] < np.log(gain.size / (len(chosen) + 1)):
            break
        chosen.append((int(best), float(spreads[size, best])))
    return chosen
