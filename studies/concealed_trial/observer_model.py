"""Hypotheses of the ideal observer: effects of the referee's catalogue, evaluated and fitted along a track."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from math import exp, log, pi

import numpy as np

from studies.concealed_trial.effects import Kind
from studies.concealed_trial.observer_filter import Whitening
from studies.concealed_trial.observer_track import Track
from studies.concealed_trial.ships import TrialShip
from studies.concealed_trial.truth import ConcealedEffect

DRAWN_ONLY = ("sign", "chance", "gustiness", "tau_s")
"""Extras that are not fitted."""
COUNTS = {"angle": 8, "stripes_deg": 6, "spacing": 6, "lag_s": 4, "lever": 3, "period_s": 48}
"""Values that are tried of each extra; a period is told from its neighbour by one cycle in a run."""
SIZES = 2
"""Sizes that are tried: what they do tells what a size between them would do."""
KEPT, CHUNK = 2, 50
"""Starts of a kind that are kept, and hypotheses that are evaluated at once."""
ITERATIONS, DAMPINGS = 6, (0.0, 0.1, 3.0, 100.0)
CHANGE = 1e-3
"""Of a parameter, over its range, for the slopes."""
FAR = 1e12
"""Misfit of a ship that was thrown out of her range."""


@dataclass(frozen=True)
class Part:
    """One effect of a hypothesis.

    Attributes:
        kind: Kind of the effect.
        size: Its size.
        extras: What is drawn besides.
        intervals: When it acts.
        ramp: How long it takes to set in [s].
    """

    kind: Kind
    size: float
    extras: dict[str, float]
    intervals: dict[str, list[list[int]]] | str = "all"
    ramp: float = 0.0

    def effect(self, ship: TrialShip) -> ConcealedEffect:
        """The effect as the simulator takes it.

        Args:
            ship: The ship.

        Returns:
            The effect.
        """
        parameters = self.kind.make(ship, self.size, self.extras)
        return ConcealedEffect(self.kind.name, parameters, self.intervals, self.kind.detail, ramp=self.ramp)

    @property
    def free(self) -> list[tuple[float, float]]:
        """Ranges of what is fitted: the log of the size, then the extras."""
        extras = [span for name, span in self.kind.extras.items() if name not in DRAWN_ONLY]
        return [(log(self.kind.low), log(self.kind.high)), *extras]

    @property
    def values(self) -> list[float]:
        """Values of what is fitted."""
        return [log(self.size), *(v for name, v in self.extras.items() if name not in DRAWN_ONLY)]

    def at(self, values: Sequence[float]) -> "Part":
        """The same effect with other values.

        Args:
            values: As :attr:`values`; angles go round, all else stays in its range.

        Returns:
            Another part.
        """
        extras, names = dict(self.extras), [name for name in self.extras if name not in DRAWN_ONLY]
        for name, value in zip(names, values[1:], strict=True):
            low, high = self.kind.extras[name]
            extras[name] = float(value % 360.0 if high == 360.0 else np.clip(value, low, high))
        return replace(self, size=float(np.clip(exp(values[0]), self.kind.low, self.kind.high)), extras=extras)


@dataclass(frozen=True)
class ObservedFit:
    """A hypothesis at its most likely values.

    Attributes:
        parts: Its effects; none in calm water.
        log_likelihood: With the log determinant.
        log_evidence: With the priors of the values, by Laplace's approximation; without that of the hypothesis.
        covariance: Of the values of all parts.
    """

    parts: tuple[Part, ...]
    log_likelihood: float
    log_evidence: float
    covariance: np.ndarray

    @property
    def names(self) -> frozenset[str]:
        """Names of the effects."""
        return frozenset(part.kind.name for part in self.parts)


class Evaluation:
    """Misfits of hypotheses along one track."""

    def __init__(self, track: Track, whitening: Whitening) -> None:
        """Keep what all hypotheses share.

        Args:
            track: The track.
            whitening: Its gains.
        """
        self.track, self.whitening = track, whitening

    def misfits(self, hypotheses: Sequence[Sequence[Part]]) -> np.ndarray:
        """Standardised innovations of hypotheses.

        Args:
            hypotheses: Their effects.

        Returns:
            One column a hypothesis.
        """
        return self.whitening.whiten(*self._left(hypotheses))

    def process(self, hypotheses: Sequence[Sequence[Part]]) -> np.ndarray:
        """What hypotheses leave unexplained of the motion.

        Args:
            hypotheses: Their effects.

        Returns:
            State after a second minus the reference then, (columns, 6, hypotheses).
        """
        return self._left(hypotheses)[0]

    def _left(self, hypotheses: Sequence[Sequence[Part]]) -> tuple[np.ndarray, np.ndarray]:
        """What hypotheses leave unexplained of motion and measurements."""
        process, measured = [], []
        for parts in hypotheses:
            with np.errstate(all="ignore"):
                d, e = self.track.residuals(self.track.truth([part.effect(self.track.ship) for part in parts]))
            process.append(np.nan_to_num(d, nan=FAR, posinf=FAR, neginf=-FAR))
            measured.append(e)
        return np.stack(process, axis=2), np.stack(measured, axis=2)

    def log_likelihood(self, misfit: np.ndarray) -> float:
        """Log likelihood of one column but for a constant of the recordings.

        Args:
            misfit: Standardised innovations.

        Returns:
            The log likelihood.
        """
        return -0.5 * float(misfit @ misfit) - 0.5 * self.whitening.log_determinant

    def fit(self, parts: tuple[Part, ...]) -> ObservedFit:
        """Gauss-Newton with a few dampings at once, then Laplace's approximation.

        Args:
            parts: Effects at first values.

        Returns:
            The hypothesis at its best.
        """
        spans = np.array([span for part in parts for span in part.free])
        width = spans[:, 1] - spans[:, 0] if len(spans) else np.empty(0)
        values = np.array([value for part in parts for value in part.values])
        best, slopes = self._slopes(parts, values, width)
        for _ in range(ITERATIONS if len(values) else 0):
            normal, down = slopes.T @ slopes, slopes.T @ best
            prior = np.diag(12 / width**2)
            tried = [values - np.linalg.solve(normal + prior + k * np.diag(np.diag(normal)), down) for k in DAMPINGS]
            misfits = self.misfits([moved(parts, v) for v in tried])
            found = int(np.argmin(np.sum(misfits**2, axis=0)))
            gain = 0.5 * float(best @ best - misfits[:, found] @ misfits[:, found])
            if gain < 1e-3:
                break
            parts = moved(parts, tried[found])
            values = np.array([value for part in parts for value in part.values])
            best, slopes = self._slopes(parts, values, width)
        precision = slopes.T @ slopes + np.diag(12 / width**2)
        likely = self.log_likelihood(best)
        evidence = likely - 0.5 * np.linalg.slogdet(precision / (2 * pi))[1] - np.log(width).sum()
        signs = sum("sign" in part.kind.extras for part in parts)
        return ObservedFit(parts, likely, float(evidence - signs * log(2)), np.linalg.inv(precision))

    def _slopes(self, parts: tuple[Part, ...], values: np.ndarray, width: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Misfit, and its slopes by all values; inwards at a bound."""
        changes = np.diag(CHANGE * width)
        tried = [moved(parts, values + change) for change in changes]
        now = [value for part in parts for value in part.values]
        for k, trial in enumerate(tried):
            there = [value for part in trial for value in part.values]
            if there[k] == now[k]:
                changes[k] *= -1
                tried[k] = moved(parts, values + changes[k])
        misfits = self.misfits([parts, *tried])
        return misfits[:, 0], (misfits[:, 1:] - misfits[:, :1]) / changes.sum(1)

    def starts(
        self, kinds: Sequence[Kind], beside: tuple[Part, ...], misfit: np.ndarray
    ) -> list[tuple[float, tuple[Part, ...]]]:
        """Values of kinds that promise most, from sizes whose effect is stretched as if it were linear.

        Args:
            kinds: Kinds that always act.
            beside: Effects that act already.
            misfit: What they leave.

        Returns:
            What is left, squared, and the hypothesis: the best two of each kind.
        """
        grid = [Part(k, s, extras) for k in kinds for extras in combinations(k) for s in _sizes(k)]
        proposals: dict[int, list[tuple[float, Part]]] = {}
        for some, left in self._chunks(grid, beside):
            change = left - misfit[:, None]
            power, along = np.sum(change**2, axis=0), -(change.T @ misfit)
            stretch = np.where(power > 0, along / np.maximum(power, 1e-300), 0.0)
            for part, p, a, s in zip(some, power, along, stretch, strict=True):
                if not s > 0:
                    continue
                size = float(np.clip(part.size * s, part.kind.low, part.kind.high))
                used = size / part.size
                promised = used * a - 0.5 * used**2 * p
                proposals.setdefault(id(part.kind), []).append((promised, replace(part, size=size)))
        for ranked in proposals.values():
            ranked.sort(key=lambda one: -one[0])
        return self.best([[part for _, part in ranked[: 4 * KEPT]] for ranked in proposals.values()], beside)

    def best(self, parts: Sequence[Sequence[Part]], beside: tuple[Part, ...]) -> list[tuple[float, tuple[Part, ...]]]:
        """The parts of each group that leave least, really.

        Args:
            parts: Groups of parts.
            beside: Effects that act already.

        Returns:
            As of :meth:`starts`.
        """
        left = [float(x) for _, some in self._chunks([p for g in parts for p in g], beside) for x in np.sum(some**2, 0)]
        found, first = [], 0
        for group in parts:
            here = left[first : first + len(group)]
            found += [(here[k], (*beside, group[k])) for k in np.argsort(here)[:KEPT]]
            first += len(group)
        return found

    def _chunks(self, parts: Sequence[Part], beside: tuple[Part, ...]) -> Iterator[tuple[Sequence[Part], np.ndarray]]:
        """Parts and what they leave, some at once: a pass through the filter costs as much as a few of them."""
        for first in range(0, len(parts), CHUNK):
            some = parts[first : first + CHUNK]
            yield some, self.misfits([(*beside, part) for part in some])


def _sizes(kind: Kind) -> list[float]:
    """Sizes that are tried of a kind."""
    return [float(size) for size in np.geomspace(kind.low, kind.high, SIZES)]


def moved(parts: tuple[Part, ...], values: np.ndarray) -> tuple[Part, ...]:
    """Effects with other values.

    Args:
        parts: The effects.
        values: Values of all of them.

    Returns:
        Other effects.
    """
    found, first = [], 0
    for part in parts:
        count = len(part.free)
        found.append(part.at(list(values[first : first + count])))
        first += count
    return tuple(found)


def combinations(kind: Kind) -> list[dict[str, float]]:
    """All combinations of the extras that are tried.

    Args:
        kind: A kind.

    Returns:
        Name and value of the extras.
    """
    axes = []
    for name, (low, high) in kind.extras.items():
        if name == "sign":
            axes.append([-1.0, 1.0])
        elif name == "period_s":
            axes.append(list(1 / np.linspace(1 / high, 1 / low, COUNTS[name])))
        else:
            count = COUNTS.get(name, 1)
            axes.append([low + (k + 0.5) * (high - low) / count for k in range(count)])
    return [dict(zip(kind.extras, values, strict=True)) for values in product(*axes)]
