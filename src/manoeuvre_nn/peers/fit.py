"""Generalised least squares with errors of unknown covariance, and the Bayesian information criterion of what comes out."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

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
        covariance: Of the remaining errors, one average.
        penalty: How far formulas, coefficients and latency are from what is known of them, in squared deviations.
        spread: Covariance of the free numbers.
        nuisance: Latency [s] and relative errors of the coefficients.
    """

    guess: Guess
    left: Float[np.ndarray, "b 7"] = field(repr=False)
    covariance: Float[np.ndarray, "7 7"] = field(repr=False)
    penalty: float
    spread: Float[np.ndarray, "q q"] = field(repr=False)
    nuisance: Float[np.ndarray, " m"] = field(repr=False)

    def criterion(self, stretch: float) -> float:
        """Bayesian information criterion with an effective sample size, smaller is better.

        Args:
            stretch: Samples that carry as much as one independent one.

        Returns:
            ``n log|S| + k log n`` and the penalty, n effective.
        """
        n = len(self.left) / stretch
        return float(n * np.linalg.slogdet(self.covariance)[1] + self.penalty + self.guess.size * np.log(n))


def covariance_of(errors: Float[np.ndarray, "b 7"]) -> Float[np.ndarray, "7 7"]:
    """Covariance of errors about zero, regular.

    Args:
        errors: Errors.

    Returns:
        Covariance.
    """
    return errors.T @ errors / len(errors) + 1e-8 * np.eye(errors.shape[1])


def stretch_of(stand: Stand, fit: Fit, lags: int = 12) -> float:
    """How many averages carry as much as one independent one.

    Args:
        stand: The runs.
        fit: What explains them best so far.
        lags: Longest lag.

    Returns:
        ``1 + 2 sum rho``, the sum up to the first small autocorrelation.
    """
    white = fit.left @ np.linalg.cholesky(np.linalg.inv(fit.covariance))
    power = float((white**2).sum())
    total = 1.0
    for lag in range(1, lags + 1):
        rho = sum(float((white[p][lag:] * white[p][:-lag]).sum()) for p in stand.parts) / power
        if rho < 0.05:
            break
        total += 2 * rho
    return total


def fit(stand: Stand, guess: Guess, start: Fit | None, stretch: float) -> Fit:
    """Fit a guess, weighting by the covariance of what it leaves itself.

    Args:
        stand: The runs.
        guess: Where to begin.
        start: Whose covariance to begin with; None takes that of calm water's errors.
        stretch: Samples that carry as much as one independent one.

    Returns:
        The best fit met.
    """
    weight = covariance_of(stand.errors) if start is None else start.covariance
    best = descend(stand, guess, weight, stretch)
    for _ in range(SWEEPS):
        again = descend(stand, best.guess, best.covariance, stretch)
        gain = best.criterion(stretch) - again.criterion(stretch)
        best = again if gain > 0 else best
        if gain < CLOSE:
            break
    return best


def descend(
    stand: Stand, guess: Guess, weight: Float[np.ndarray, "7 7"], stretch: float, rounds: int = ROUNDS
) -> Fit:
    """Gauss-Newton steps with errors of a given covariance.

    Args:
        stand: The runs.
        guess: Where to begin.
        weight: Covariance of the errors.
        stretch: Samples that carry as much as one independent one.
        rounds: Most steps.

    Returns:
        The best fit met.
    """
    root = np.linalg.cholesky(np.linalg.inv(weight)).T / np.sqrt(stretch)
    best, lowest = None, np.inf
    for _ in range(rounds):
        found, cost, step = _look(stand, guess, root)
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


def _look(stand: Stand, guess: Guess, root: Float[np.ndarray, "7 7"]) -> tuple[Fit, float, Float[np.ndarray, " q"]]:
    """The fit of the nuisances at a guess, its cost, and the step to where the guess would be better."""
    errors, slopes = stand.evaluate(guess)
    q, m = slopes.shape[-1], len(stand.spread)
    form = np.array([p.form for *_, p in guess.free], dtype=bool)
    sizes = np.array([p.spread for *_, p in guess.free])
    off = np.array([p.null - v if p.form and p.null is not None else 0.0 for (*_, p), v in zip(guess.free, guess.vector, strict=True)])  # fmt: skip
    prior = np.concatenate([np.where(form, 1 / np.maximum(sizes, 1e-12) ** 2, 0.0), _precision(stand)])
    columns = np.concatenate([slopes, stand.nuisance], axis=-1)
    white = np.einsum("ij,bjk->bik", root, columns).reshape(-1, q + m)
    target = (errors @ root.T).reshape(-1)
    gram = white.T @ white + np.diag(prior)
    right = white.T @ target
    nuisance = np.linalg.solve(gram[q:, q:], right[q:])
    left = errors - stand.nuisance @ nuisance
    penalty = float((nuisance**2 * prior[q:]).sum() + (off**2 * prior[:q]).sum())
    # Numbers without a prior may have no influence here (a direction at speed zero): a touch of ridge.
    touch = 1e-9 * np.diag(gram) + 1e-300
    touch[:q] = np.maximum(touch[:q], 1e-6 / np.maximum(sizes, 1e-12) ** 2)
    spread = np.linalg.inv(gram + np.diag(touch))
    right[:q] += prior[:q] * off
    step = (spread @ right)[:q]
    found = Fit(guess, left, covariance_of(left), penalty, spread[:q, :q], nuisance)
    return found, float(((left @ root.T) ** 2).sum()) + penalty, step


def _precision(stand: Stand) -> Float[np.ndarray, " m"]:
    """Prior precision of the nuisances; none at all is allowed where a spread is zero."""
    return 1 / np.maximum(stand.spread, 1e-9) ** 2
