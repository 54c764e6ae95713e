"""A model of any kind as a program; a new kind of model adds a line here."""

from collections.abc import Sequence
from functools import singledispatch
from typing import Any

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.response import Response
from manoeuvre_nn.dynamics.model import CalmWater, IdentifiedShip
from manoeuvre_nn.dynamics.recursive import RecursiveShip
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.formulas.motion import identified_ship, ship_in_calm_water
from manoeuvre_nn.formulas.program import Program
from manoeuvre_nn.formulas.ranges import Ranges
from manoeuvre_nn.formulas.recursive_step import recursive_step
from manoeuvre_nn.formulas.responses import response
from manoeuvre_nn.formulas.vessels import with_effects


@singledispatch
def to_program(model: Any, ranges: Ranges | None = None, notes: Sequence[str] = ()) -> Program:
    """Write a model down in closed form: a program.

    Args:
        model: The model.
        ranges: Ranges of what it was trained on [SI]; None takes usual ones.
        notes: Where it is from.

    Raises:
        InputError: If it has no closed form.
    """
    raise InputError(f"a {type(model).__name__} has no closed form here: export a model of manoeuvre train")


@to_program.register
def ship_with_effects(model: Vessel, ranges: Ranges | None = None, notes: Sequence[str] = ()) -> Program:
    """Accelerations of a ship with what acts on her."""
    if model.effects and isinstance(model.calm, RecursiveShip):
        raise InputError("a recursive network goes from step to step by itself: leave effects out")
    calm = to_program(model.calm, ranges, notes)
    return with_effects(calm, model) if model.effects else calm


to_program.register(CalmWater, ship_in_calm_water)
to_program.register(IdentifiedShip, identified_ship)
to_program.register(RecursiveShip, recursive_step)
to_program.register(Response, response)
