"""Generalised least squares with autoregressive errors of unknown covariance, and the information criterion of a fit."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.peers.noise import Noise, noise_of
from manoeuvre_nn.peers.stand import Guess, Stand

LONGEST_STEP = 1.5
"""Parameters move by no more than so many of their spreads at once; directions by 45 degrees."""
ROUNDS, SWEEPS = 6, 3
"""Most Gauss-Newton steps, and most turns of weighting anew."""
CLOSE = 0.1
"""Gain of the criterion below which a fit has converged."""


@dataclass(frozen=True)
class Fit:
    """A guess at its best values.

    Attributes:
        guess: It.
        left: Errors that remain.
        noise: What they look like.
        penalty: How far formulas, coefficients and latency are from what is known of them, in squared deviations.
        spread: Covariance of the free numbers.
        nuisance: Latency [s] and relative errors of the coefficients.
        criterion: Bayesian information criterion, smaller is better.
    """

    guess: Guess
    left: Float[np.ndarray, "b 6"] = field(repr=False)
    noise: Noise = field(repr=False)
    penalty: float
    spread: Float[np.ndarray, "q q"] = field(repr=False)
    nuisance: Float[np.ndarray, " m"] = field(repr=False)
    criterion: float


def fit(stand: Stand, guess: Guess, start: Fit | None) -> Fit:
    """Fit a guess, weighting by the noise that it leaves itself.

    Args:
        stand: The runs.
        guess: Where to begin.
        start: Whose noise to begin with; None takes that of calm water's errors.

    Returns:
        The best fit met.
    """
    best = descend(stand, guess, noise_of(stand.errors, stand.parts) if start is None else start.noise)
    for _ in range(SWEEPS):
        again = descend(stand, best.guess, best.noise)
        gain = best.criterion - again.criterion
        best = again if gain > 0 else best
        if gain < CLOSE:
            break
    return best


def descend(stand: Stand, guess: Guess, noise: Noise, rounds: int = ROUNDS) -> Fit:
    """Gauss-Newton steps at a given noise.

    Args:
        stand: The runs.
        guess: Where to begin.
        noise: Of the averaged errors.
        rounds: Most steps.

    Returns:
        The best fit met.
    """
    best, lowest, now, move = None, np.inf, guess, np.zeros(0)
    for _ in range(rounds):
        found, cost, step = _look(stand, guess, noise)
        if best is None or cost < lowest:
            enough = lowest - cost < CLOSE
            best, lowest, now, move = found, cost, guess, step
            if enough:
                break
        else:
            move = 0.35 * move
        limits = [45.0 if p.period else LONGEST_STEP * p.spread for *_, p in now.free]
        reach = min([1.0, *(most / max(abs(d), 1e-12) for most, d in zip(limits, move, strict=True))])
        guess = now.at(now.vector + reach * move)
        if not len(move) or np.allclose(guess.vector, now.vector, rtol=1e-4, atol=1e-7):
            break
    assert best is not None
    return best


def _look(stand: Stand, guess: Guess, noise: Noise) -> tuple[Fit, float, Float[np.ndarray, " q"]]:
    """The fit of the nuisances at a guess, its cost, and the step to where the guess would be better."""
    errors, slopes = stand.evaluate(guess)
    q = slopes.shape[-1]
    white = noise.white(np.concatenate([slopes, stand.nuisance], axis=-1), stand.parts)
    target = noise.white(errors[..., None], stand.parts)[:, 0]
    off, held, sizes = _known(guess)
    prior = np.concatenate([held, 1 / np.maximum(stand.spread, 1e-9) ** 2])
    gram, right = white.T @ white + np.diag(prior), white.T @ target
    nuisance = np.linalg.solve(gram[q:, q:], right[q:])
    left = errors - stand.nuisance @ nuisance
    penalty = float((nuisance**2 * prior[q:]).sum() + (off**2 * held).sum())
    # Numbers without a prior may have no influence here (a direction at speed zero): a touch of ridge.
    gram[range(q), range(q)] += 1e-4 / np.maximum(sizes, 1e-12) ** 2
    spread = np.linalg.inv(gram)
    right[:q] += held * off
    found = noise_of(left, stand.parts)
    criterion = found.deviance(len(left), len(stand.parts)) + penalty + guess.size * np.log(len(left))
    cost = float(((target - white[:, q:] @ nuisance) ** 2).sum()) + penalty
    return Fit(guess, left, found, penalty, spread[:q, :q], nuisance, criterion), cost, (spread @ right)[:q]


def _known(guess: Guess) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """How far each free number is from its formula's value, with what precision that is known, and its usual size."""
    off, held = np.zeros(len(guess.free)), np.zeros(len(guess.free))
    for m, ((*_, p), value) in enumerate(zip(guess.free, guess.vector, strict=True)):
        if p.form and p.null is not None:
            off[m], held[m] = p.null - value, p.spread**-2
    return off, held, np.array([p.spread for *_, p in guess.free])
