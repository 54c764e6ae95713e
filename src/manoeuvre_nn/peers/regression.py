"""Equation-error regression: every effect of the shelf as columns beside the errors, the best by an information criterion.

The accelerations come from smoothing, the calm-water model is evaluated on the smoothed track, and an effect is fitted to
what is left: its forces, and what its sensor errors or its stream change in the channels that the equations are fed
with. Errors of coefficients and the receiver's latency are fitted along, held by what is known of their size. The
number of samples that counts is the effective one.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.effect.wind import GustyWind
from manoeuvre_nn.peers.fit import CLOSE, Fit, descend, fit
from manoeuvre_nn.peers.gusts import with_gusts
from manoeuvre_nn.peers.noise import noise_of
from manoeuvre_nn.peers.stand import RANDOM, Guess, Stand
from manoeuvre_nn.peers.windows import Scene, placed, timed

PROMISING = 2
"""Starts of an effect that are fitted to the end."""
SHORT = 0.2
"""Most memory that is granted to noise while an event is looked for."""
TURNS = 4
"""Turns of fitting values and times."""
SIZES = (0.5, 1.0, 2.0, 4.0)
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
    gusty = next((e for e in effects if isinstance(e, GustyWind)), None)
    plain = [e for e in effects if e is not gusty]
    for effect in plain:
        progress(effect.name)
        fits.append(added(stand, none, effect))
    first = min(fits, key=lambda f: f.criterion)
    for effect in plain:
        both = {effect.name, first.guess.names[0]}
        if len(both) == 2 and not any(len(both & same) == 2 for same in NOT_TOGETHER):
            progress(" + ".join((*first.guess.names, effect.name)))
            fits.append(added(stand, first, effect))
    if gusty is not None:
        windy = [f for f in fits if "wind_steady" in f.guess.names and f.criterion < none.criterion]
        fits += [with_gusts(stand, f, gusty) for f in windy]
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
    # What calm water leaves contains the event: taken for noise with a long memory, it would hide itself.
    noise = noise_of(base.left, stand.parts, most=SHORT)
    scenes = scenes_of(stand, base.guess)
    tried = []
    for row, size in product(_starts(effect), SIZES):
        values = np.tile(row, (len(stand.tracks), 1))
        values[:, 0] *= size
        tried.append(placed(scenes, effect, values, noise))
    tried.sort(key=lambda t: -t[1])
    found = [_settled(stand, base, effect, values) for values, _ in tried[:PROMISING]]
    return min(found, key=lambda f: f.criterion)


def _settled(stand: Stand, base: Fit, effect: Effect, values: Float[np.ndarray, "runs p"]) -> Fit:
    """Values at given times, times at given values, until nothing is gained."""
    best = fit(stand, base.guess.joined(effect, values), base)
    for _ in range(TURNS):
        scenes = scenes_of(stand, base.guess.at(best.guess.vector[: len(base.guess.free)]))
        times, _ = placed(scenes, effect, best.guess.values[-1], best.noise)
        again = fit(stand, base.guess.joined(effect, times), best)
        if again.criterion >= best.criterion - CLOSE:
            break
        best = again
    return best


def scenes_of(stand: Stand, guess: Guess) -> list[Scene]:
    """Runs in which an event is looked for.

    Args:
        stand: The runs.
        guess: What else acts.

    Returns:
        One a run.
    """
    errors = stand.evaluate(guess)[0]
    return [
        Scene(track, errors[part], stand.nuisance[part], stand.spread)
        for track, part in zip(stand.tracks, stand.parts, strict=True)
    ]
