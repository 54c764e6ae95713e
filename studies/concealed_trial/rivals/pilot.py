"""A first estimate of one effect's size by one linear step: what the flow for its parameters is told of a case.

A regression on simulated signatures is a summary statistic that keeps what parameters show in (Fearnhead & Prangle
2012).
"""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.effect import Effect, Parameter
from studies.concealed_trial.rivals.events import ALWAYS, timed
from studies.concealed_trial.rivals.search import starts_of
from studies.concealed_trial.rivals.whitened import WhitenedRuns

SMALL_SHARE = 0.1
"""Share of a parameter's prior standard deviation below which numbers are linear in it, above logarithmic."""
MAX_NUMBERS = 3
"""Most parameters that an answer reports of an effect."""
SIZE = MAX_NUMBERS + 2
"""Numbers of a first estimate."""
RIDGE = 0.02
"""Of the regression, over the mean energy of the signatures."""


def told_of(effect: Effect) -> list[Parameter]:
    """Parameters that an answer reports of an effect, but times.

    Args:
        effect: The effect.

    Returns:
        Its parameters.
    """
    return [p for p in effect.declared if not (p.form or p.per_run or p.name in effect.random[1:])]


def numbers(effect: Effect, values: Mapping[str, float], linear: bool = False) -> Float[np.ndarray, " k"]:
    """An effect's parameters as numbers about 1 in size on the whole plane, logarithmic where they are large.

    Args:
        effect: On its ship.
        values: Parameters that an answer reports.
        linear: Whether they are linear throughout.

    Returns:
        ``MAX_NUMBERS`` numbers; what an effect does not have is 0.
    """
    given = told_of(effect)
    found = [0.0 if p.period else _number(p, values[p.name]) for p in given]
    found = [float(np.sinh(x)) if linear else x for x in found]
    if any(p.period for p in given):  # a size and a direction are a vector
        angle = np.radians(values[given[1].name])
        found[:2] = [found[0] * np.cos(angle), found[0] * np.sin(angle)]
    return np.array(found + [0.0] * (MAX_NUMBERS - len(found)))


def values_of(effect: Effect, found: Float[np.ndarray, "n k"]) -> dict[str, Float[np.ndarray, " n"]]:
    """Parameters from their numbers, within their bounds.

    Args:
        effect: On its ship.
        found: Numbers of :func:`numbers`, a set a row.

    Returns:
        Values of each parameter.
    """
    given = told_of(effect)
    columns = list(found.T[: len(given)])
    if any(p.period for p in given):
        size, angle = np.hypot(columns[0], columns[1]), np.degrees(np.arctan2(columns[1], columns[0]))
        columns[:2] = [size, angle % 360.0]
    made = [c if p.period else np.clip(_value(p, c), p.low, p.high) for p, c in zip(given, columns, strict=True)]
    return {p.name: values for p, values in zip(given, made, strict=True)}


def _number(p: Parameter, value: float) -> float:
    """One number; a depth counts by what it leaves under the keel, its prior's spread being the draught."""
    off = (
        1.0 / max(value / p.spread - 1.0, 0.01)
        if p.null is None and p.low > 0
        else (value - (p.null or 0.0)) / p.spread
    )
    return float(np.arcsinh(off / SMALL_SHARE))


def _value(p: Parameter, number: np.ndarray) -> np.ndarray:
    """The inverse."""
    off = SMALL_SHARE * np.sinh(number)
    if p.null is None and p.low > 0:
        return p.spread * (1.0 + 1.0 / np.maximum(off, 1e-3))
    return (p.null or 0.0) + p.spread * off


def pilot(data: WhitenedRuns, effect: Effect) -> Float[np.ndarray, " k"]:
    """One linear step from nothing towards an effect that always acts.

    Args:
        data: The runs.
        effect: The effect.

    Returns:
        Its numbers, the gain and the size of its signatures, on a logarithmic scale.
    """
    starts = starts_of(effect)
    starts[:, timed(effect)] = ALWAYS[: len(timed(effect))]
    white = data.seen(data.errors[..., None]).reshape(-1)
    left = data.seen(data.tried((effect,), [np.repeat(starts[None], len(data.tracks), axis=0)]))
    columns = white[:, None] - left.reshape(len(white), -1)
    energy = (columns**2).sum(axis=0).mean()
    gram = columns.T @ columns + RIDGE * energy * np.eye(len(starts))
    shares = np.linalg.solve(gram, columns.T @ white)
    names = [p.name for p in effect.declared]
    told = [numbers(effect, dict(zip(names, row, strict=True)), linear=True) for row in starts]
    gain = max(float(shares @ columns.T @ white), 0.0)
    return np.concatenate([np.arcsinh(shares @ np.stack(told)), [np.arcsinh(np.sqrt(gain)), np.log(1e-3 + energy) / 4]])
