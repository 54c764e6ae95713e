"""Equation-error regression: every effect of the shelf as columns beside the errors, the best by an information criterion.

The accelerations come from smoothing, the calm-water model is evaluated on the smoothed track, and an effect is fitted to
what is left: its forces, and what its sensor errors or its stream change in the channels that the equations are fed
with. Errors of coefficients and the receiver's latency are fitted along, held by what is known of their size. The
number of samples that counts is the effective one.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.peers.fit import Fit, descend, fit
from manoeuvre_nn.peers.stand import RANDOM, Guess, Stand
from manoeuvre_nn.peers.windows import placed, timed

PROMISING = 2
"""Starts of an effect that are fitted to the end."""
SIZES = (0.5, 1.0, 2.0)
"""Factors on the first size of an event with which its times are looked for."""
NOT_TOGETHER = ({"wind_steady", "wind_gusty", "wind_onset"}, {"side_force", "bow_thruster"})
"""Names of one thing."""
Progress = Callable[[str], None]


@dataclass(frozen=True)
class Contest:
    """What regression has to say of a case.

    Attributes:
        stand: The runs.
        none: Calm water.
        fits: Everything else, best first.
    """

    stand: Stand
    none: Fit
    fits: list[Fit]

    def gain(self, found: Fit) -> float:
        """By how much a fit improves on calm water.

        Args:
            found: The fit.

        Returns:
            Difference of the criteria, positive if it is better.
        """
        return self.none.criterion - found.criterion


def contest(stand: Stand, effects: Sequence[Effect], progress: Progress = lambda _: None) -> Contest:
    """Fit calm water, every effect, and the best one with every other.

    Args:
        stand: The fitted runs.
        effects: Prototypes of the candidates.
        progress: Is told what is fitted.

    Returns:
        All fits.
    """
    none = fit(stand, Guess(), None)
    fits = []
    for effect in effects:
        progress(effect.name)
        fits.append(added(stand, none, effect))
    first = min(fits, key=lambda f: f.criterion)
    for effect in effects:
        both = {effect.name, first.guess.names[0]}
        if len(both) == 2 and not any(len(both & same) == 2 for same in NOT_TOGETHER):
            progress(" + ".join((*first.guess.names, effect.name)))
            fits.append(added(stand, first, effect))
    return Contest(stand, none, sorted(fits, key=lambda f: f.criterion))


def added(stand: Stand, base: Fit, effect: Effect) -> Fit:
    """The best fit with one more effect.

    Args:
        stand: The runs.
        base: What is there already.
        effect: What is to be added.

    Returns:
        The fit.
    """
    if timed(effect):
        return _event(stand, base, effect)
    tried = []
    for row in _starts(effect):
        guess = base.guess.joined(effect, np.tile(row, (len(stand.tracks), 1)))
        tried.append(descend(stand, guess, base.noise, rounds=2))
    tried.sort(key=lambda f: f.criterion)
    found = [fit(stand, f.guess, f) for f in tried[:PROMISING]]
    return min(found, key=lambda f: f.criterion)


def _starts(effect: Effect) -> Float[np.ndarray, "k p"]:
    """Values from which a fit is tried: all starts, formulas as published."""
    grids = [(p.null,) if p.form else (p.starts[:1] if p.per_run or p.name in RANDOM else p.starts) for p in effect.declared]  # fmt: skip
    return np.array(list(product(*grids)), dtype=float)


def _event(stand: Stand, base: Fit, effect: Effect) -> Fit:
    """The same for an effect that acts for a while: its times and its values in turn."""
    left = _at_samples(stand, base, None)
    weight = _at_a_sample(stand, base)
    tried = []
    for row, size in product(_starts(effect), SIZES):
        values = row.copy()
        values[0] *= size
        tried.append(placed(stand.tracks, effect, np.tile(values, (len(stand.tracks), 1)), left, weight))
    tried.sort(key=lambda t: -t[1])
    best: Fit | None = None
    for values, _ in tried[:PROMISING]:
        found = fit(stand, base.guess.joined(effect, values), base)
        for _ in range(3):
            left = _at_samples(stand, found, effect)
            times, _ = placed(stand.tracks, effect, found.guess.values[-1], left, _at_a_sample(stand, found))
            again = fit(stand, base.guess.joined(effect, times), found)
            if again.criterion >= found.criterion - 0.1:
                break
            found = again
        if best is None or found.criterion < best.criterion:
            best = found
    assert best is not None
    return best


def _at_a_sample(stand: Stand, found: Fit) -> Float[np.ndarray, "5 5"]:
    """Covariance of the errors as if all that is in an average, and its memory, were in independent samples."""
    long = 1 / (1 - found.noise.memory)
    return found.noise.covariance * np.outer(long, long) * stand.tracks[0].window / 2


def _at_samples(stand: Stand, found: Fit, but: Effect | None) -> list[Float[np.ndarray, "n 5"]]:
    """Errors at every sample, without what nuisances and effects explain, but for that of one effect.

    What explains them is known at the averages and taken as straight lines between them.
    """
    explained = stand.nuisance @ found.nuisance
    names = [e.name for e in found.guess.effects]
    rest = found.guess
    if but is not None:
        k = names.index(but.name)
        rest = replace(rest, effects=rest.effects[:k] + rest.effects[k + 1 :], values=rest.values[:k] + rest.values[k + 1 :])  # fmt: skip
    explained = explained + stand.errors - stand.evaluate(rest)[0]
    result = []
    for track, part in zip(stand.tracks, stand.parts, strict=True):
        model = [np.interp(track.run.time, track.times, explained[part, c]) for c in range(5)]
        result.append(track.errors()[0] - np.stack(model, axis=-1))
    return result
