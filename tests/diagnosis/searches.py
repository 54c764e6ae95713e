"""Searches that have ended, made by hand: what was fitted, and with which log evidence."""

from types import SimpleNamespace

import numpy as np
from trials import SHIP, values

from manoeuvre_nn.diagnosis.search import SearchResult
from manoeuvre_nn.effect.current import Current
from manoeuvre_nn.effect.rudder import RudderOffset
from manoeuvre_nn.effect.sensors import HeadingBias, LogScale
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis, Hypothesis

EFFECTS = {e.name: e for e in (Current(SHIP), RudderOffset(SHIP), HeadingBias(SHIP), LogScale(SHIP))}


def fitted(evidence: float, *names: str, best: tuple[int, int] = (0, 0)) -> FittedHypothesis:
    """A hypothesis of these effects at their null values."""
    effects = tuple(EFFECTS[name] for name in names)
    h = Hypothesis(effects, tuple(values(e) for e in effects))
    return FittedHypothesis(h, evidence, np.zeros((1, 1)), np.eye(len(h.vector())), best=best)


def found(*hypotheses: FittedHypothesis, levels=((0.003, 0.003),), none: float = 0.0) -> SearchResult:
    """A search that ended with these."""
    likelihood = SimpleNamespace(data_set=SimpleNamespace(levels=np.array(levels)))
    return SearchResult(fitted(none), list(hypotheses), likelihood)  # type: ignore[arg-type]
