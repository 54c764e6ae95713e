"""Reference ships through the same manoeuvres, simulated once a process: hundreds of tests ask for the same few."""

import copy
from collections.abc import Generator
from contextlib import contextmanager
from unittest.mock import patch

from torch import nn

from manoeuvre_nn.core.manoeuvre import Manoeuvre
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.dynamics.simulate import simulate
from manoeuvre_nn.dynamics.vessel import Vessel

_made: dict[tuple[object, ...], Recording] = {}


def remembered(ship: Vessel, manoeuvre: Manoeuvre, interval: float | None = None) -> Recording:
    """The recording of this ship, its coefficients and whatever acts on it included; a copy that may be changed."""
    asked = (_told(ship.calm), *map(_told, ship.effects), repr(manoeuvre), interval)
    if " at 0x" in str(asked):  # an object that does not say what it holds
        return simulate(ship, manoeuvre, interval)
    if asked not in _made:
        _made[asked] = simulate(ship, manoeuvre, interval)
    return copy.deepcopy(_made[asked])


def _told(module: nn.Module) -> str:
    """All that a ship or an effect is made of."""
    own = vars(nn.Module())
    parts = [(type(m).__name__, {k: v for k, v in vars(m).items() if k not in own}) for m in module.modules()]
    return repr([parts, [(name, values.tolist()) for name, values in module.named_buffers()]])


def _references(ship: Vessel, manoeuvres: list[Manoeuvre]) -> tuple[Recording, ...]:
    return tuple(remembered(ship, m) for m in manoeuvres)


@contextmanager
def simulations_remembered() -> Generator[None]:
    """Training data and references of :class:`.SimulatedData` are simulated once."""
    data = "manoeuvre_nn.training.data"
    with patch(f"{data}.simulate", remembered), patch(f"{data}.simulated_references", _references):
        yield
