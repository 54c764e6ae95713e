"""Learn from some records, and say how well what was learnt, what was not, and what lies between is foretold."""

from collections.abc import Callable
from dataclasses import dataclass
from time import process_time

import numpy as np
import torch
from jaxtyping import Float, Int

from manoeuvre_nn.core.response import Quantities, Records
from studies.cepowski2007.learners import Learn
from studies.cepowski2007.records import rms_deg


@dataclass(frozen=True)
class Approximation:
    """What was learnt.

    Attributes:
        pitch: Conditions [SI] -> pitch [rad].
        seconds: Processor time that it took [s].
    """

    pitch: Callable[[Float[np.ndarray, "n 5"]], Float[np.ndarray, " n"]]
    seconds: float

    def rms(self, records: Records) -> float:
        """Root mean square error [deg]."""
        return rms_deg(self.pitch(records.conditions) - records.values)


def approximate(learn: Learn, quantities: Quantities, records: Records, seed: int = 0) -> Approximation:
    """Learn from records; inputs and values have mean 0 and standard deviation 1 for the method.

    Args:
        learn: The method.
        quantities: What it sees of the conditions, and what the pitch is proportional to.
        records: What to learn from.
        seed: Seed of whatever is drawn.

    Returns:
        What was learnt.
    """
    began = process_time()
    seen, factor = _seen(quantities, records.conditions)
    values = records.values / factor
    middle, spread = seen.mean(0), seen.std(0)
    spread = np.where(spread > 0, spread, 1.0)
    mean, size = float(values.mean()), float(values.std()) or 1.0
    predict = learn((seen - middle) / spread, (values - mean) / size, seed)

    def pitch(conditions: Float[np.ndarray, "n 5"]) -> Float[np.ndarray, " n"]:
        at, proportional = _seen(quantities, conditions)
        return (predict((at - middle) / spread) * size + mean) * proportional

    return Approximation(pitch, process_time() - began)


def halves(records: Records, seed: int, count: int | None = None) -> tuple[Records, Records]:
    """Split by sampling as the paper does: half of the records learn, the others test.

    Args:
        records: The records.
        seed: Seed of the draw.
        count: Draw only as many, half of which learn; None takes all.

    Returns:
        Those that are learnt, and all others.
    """
    order = np.random.default_rng(seed).permutation(len(records))
    learnt = (count or len(records)) // 2
    return records.at(order[:learnt]), records.at(order[learnt:])


def without(records: Records, column: int, value: float) -> tuple[Records, Records]:
    """Leave one value of a variable out.

    Args:
        records: The records.
        column: Which variable.
        value: Which value [SI].

    Returns:
        Half of the records with other values, drawn at random, and all with this one.
    """
    out = np.isclose(records.conditions[:, column], value)
    order: Int[np.ndarray, " m"] = np.random.default_rng(0).permutation(np.flatnonzero(~out))
    return records.at(order[: len(records) // 2]), records.at(out)


def _seen(quantities: Quantities, conditions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What a method sees, and what its values are multiplied by."""
    at = torch.tensor(conditions)
    return quantities.features(at).numpy(), quantities.factor(at).numpy()
