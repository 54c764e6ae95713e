"""When a local force acts: the pair of times in each run that the whitened data ask for most."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.estimation.data_set import WhitenedDataSet, quiet
from manoeuvre_nn.estimation.effect_columns import with_roll
from manoeuvre_nn.estimation.hypothesis import Hypothesis
from manoeuvre_nn.estimation.linear_run import Columns
from manoeuvre_nn.estimation.marginal_likelihood import MarginalLikelihood, hypothesis_columns

BLOCK = 10.0
"""Length of the blocks that windows are made of [s]."""
MIN_BLOCKS = 3
"""Least number of blocks in a window."""


def best_windows(
    likelihood: MarginalLikelihood,
    effect: Effect,
    grid: Float[np.ndarray, "k p"],
    level: int,
    scatter: int,
    given: Hypothesis | None = None,
) -> Iterator[Float[np.ndarray, "runs p"]]:
    """Start values of an effect with times of its own in every run.

    Args:
        likelihood: The runs.
        effect: The effect; its per-run parameters are a start, or a start and an end.
        grid: Starts of its other parameters.
        level: Force level at which data are whitened.
        scatter: Scatter level.
        given: Effects that are there already; what they explain is no event.

    Yields:
        Values for every run.
    """
    names = [p.name for p in effect.declared]
    timed = [j for j, p in enumerate(effect.declared) if p.per_run]
    ends = len(timed) > 1
    # Not the levels that calm water needs: there the event itself is taken for a coloured force and wrong coefficients.
    low, scatter = quiet(level), min(scatter, 2)
    there = None if given is None else hypothesis_columns(likelihood.data_set, given).columns
    found = [
        _scan(likelihood.data_set, run, low, scatter, not ends, None if there is None else there[run])
        for run in range(len(likelihood.data_set.runs))
    ]
    others = np.unique(np.delete(grid, timed, axis=1), axis=0)
    for row in others[:8]:
        values = np.zeros((len(found), len(names)))
        values[:, [j for j in range(len(names)) if j not in timed]] = row
        for run, (start, end, _) in enumerate(found):
            values[run, timed[0]] = start
            if ends:
                values[run, timed[1]] = end
        if "force_kN" in names:
            values[:, names.index("force_kN")] = np.median([p for *_, p in found]) or row[0]
        yield values


def _scan(
    data_set: WhitenedDataSet, run: int, level: int, scatter: int, open_end: bool, given: Columns | None
) -> tuple[float, float, float]:
    """Start and end of the best window of a run, and the lateral force in it [kN]."""
    prepared, white = data_set.runs[run], data_set.at(level).white[run]
    time, step = prepared.linearised.run.time, prepared.linearised.run.step
    edges = np.arange(time[0], time[-1] + BLOCK, BLOCK)
    count = len(edges) - 1
    which = np.clip(((time[1:] - step / 2 - edges[0]) / BLOCK).astype(int), 0, count - 1)
    hull = data_set.dynamics.hull
    states = prepared.linearised.states
    velocities = np.r_[:3, 6 : states.count]
    moved = np.zeros((len(time) - 1, states.count, 2 * count))
    for k, force in enumerate(((0.0, 1e3, 0.0), (0.0, 0.0, 1e3 * hull.particulars.length))):
        caused = hull.acceleration_from_si(hull.inertia.new_tensor(force))
        push = with_roll(hull, caused, 0 * caused[0]).numpy()
        moved[np.arange(len(time) - 1)[:, None], velocities, (k * count + which)[:, None]] = push * step
    base, blocks = (
        data_set.at(level).base[run],
        white.embed(Columns(np.zeros((len(time), len(states.channels), 2 * count)), moved)),
    )
    if given is not None:  # the data less what is known
        known = white.embed(given[:1])
        base = base[:1].joined(known).combined(np.array([1.0, -1.0])).joined(base[1:])
    # Inner products of blocks with themselves and the data, coefficients and latency taken out.
    own, cross = base.dot(base), base.dot(blocks)
    nuisance = own[1:, 1:] + np.diag(data_set.nuisance_sd(scatter, runs=1) ** -2.0)
    weights = np.linalg.solve(nuisance, cross[1:])
    gram, right = blocks.dot(blocks) - cross[1:].T @ weights, cross[0] - own[0, 1:] @ weights
    return _best(gram, right, edges, open_end)


def _best(
    gram: Float[np.ndarray, "q q"], right: Float[np.ndarray, " q"], edges: Float[np.ndarray, " k"], open_end: bool
) -> tuple[float, float, float]:
    """The window with the largest likelihood ratio for a constant force and moment in it."""
    count = len(edges) - 1
    total = np.zeros((2, count + 1))
    total[:, 1:] = np.cumsum(right.reshape(2, count), axis=1)
    area = np.zeros((2, 2, count + 1, count + 1))
    area[:, :, 1:, 1:] = gram.reshape(2, count, 2, count).transpose(0, 2, 1, 3).cumsum(2).cumsum(3)
    start, end = np.triu_indices(count + 1, MIN_BLOCKS)
    if open_end:
        keep = end == count
        start, end = start[keep], end[keep]
    b = (total[:, end] - total[:, start]).T
    g = area[:, :, end, end] - area[:, :, start, end] - area[:, :, end, start] + area[:, :, start, start]
    g = g.transpose(2, 0, 1) + 1e-9 * np.eye(2)
    amplitude = np.linalg.solve(g, b[..., None])[..., 0]
    k = int((b * amplitude).sum(axis=1).argmax())
    return float(edges[start[k]]), float(edges[min(end[k], count)]), float(amplitude[k, 0])
