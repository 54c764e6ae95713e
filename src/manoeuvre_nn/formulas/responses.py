"""Responses to service parameters as programs, in the units in which people write these."""

import re
from collections.abc import Sequence

import numpy as np
import sympy
from jaxtyping import Float

from manoeuvre_nn.core.response import Response, Variable
from manoeuvre_nn.formulas.networks import closed_form, numbers
from manoeuvre_nn.formulas.program import Builder, Program, Quantity, Reference, added, checked_name, shifted, times
from manoeuvre_nn.formulas.ranges import Ranges

REACH = 2.0
"""How many of a feature's scales a range goes to both sides where neither records nor the variable say one."""
HALF_CIRCLE = (0.0, float(np.pi))
"""Such a range of an angle that is seen by its cosine [rad]."""


def response(model: Response, ranges: Ranges | None = None, notes: Sequence[str] = ()) -> Program:
    """An approximation of a response: features, network, and what its output is multiplied by.

    Returns:
        The variables to the response; names carry their units, as ``V_kn``.
    """
    given = [_input(v, ends) for v, ends in zip(model.inputs, _ends(model, ranges or {}), strict=True)]
    output = _quantity(model.output)
    build = Builder(given, [output])
    build.section("What the network sees")
    seen = _features(model, build)
    answer = closed_form(model.network, seen, build)[0]
    build.section("The response")
    scaling, size = model.scaling, model.output.size
    factor = next((v for v in model.inputs if v.name == model.per), None)
    share = 1.0 if factor is None else factor.size
    terms = [times(float(scaling.output_scale[0]) * share / size, answer)]
    if scaling.output_shift is not None:
        terms.append(sympy.Float(float(scaling.output_shift[0]) * share / size))
    if factor is None:
        build.output(output.name, added(terms))
    else:
        whole = build.let("y_s", added(terms))
        build.output(output.name, whole * build.inputs[list(model.inputs).index(factor)])
    return Program(
        name=output.name,
        title=f"{model.output.meaning[:1].upper()}{model.output.meaning[1:]}",
        inputs=given,
        outputs=[output],
        sections=[s for s in build.sections if s.steps],
        notes=list(notes),
        reference=_reference(model),
        symbols=build.symbols,
    )


def _features(model: Response, build: Builder) -> list[sympy.Expr]:
    """Scaled features; shift and scale are those of a variable in its unit."""
    shift, scale = numbers(model.scaling.shift).tolist(), numbers(model.scaling.scale).tolist()
    found: list[sympy.Expr] = []
    for v, symbol in zip(model.inputs, build.inputs, strict=True):
        if v.seen == "none" or v.name == model.per:
            continue
        k, z, size = len(found), symbol, v.size
        if v.seen == "cos":
            z, size = build.let(f"c_{v.name}", sympy.cos(times(size, symbol) if size != 1.0 else symbol)), 1.0
        found.append(build.let(f"x_{k + 1}", shifted(z, shift[k] / size, scale[k] / size)))
    return found


def _quantity(v: Variable) -> Quantity:
    """A variable under a name that carries its unit where this is not that of SI."""
    unit = re.sub(r"\W", "", v.unit)
    name = v.name if v.size == 1.0 or not unit else f"{v.name}_{unit}"
    symbol = v.symbol or sympy.latex(sympy.Symbol(v.name))
    return Quantity(checked_name(name, "variable"), v.unit, v.meaning, symbol=symbol)


def _input(v: Variable, ends: tuple[float, float]) -> Quantity:
    """An input with its range, and its middle to begin with."""
    q, (low, high) = _quantity(v), (end / v.size for end in ends)
    return Quantity(q.name, q.unit, q.meaning, low, high, float(f"{0.5 * (low + high):.3g}"), q.symbol)


def _ends(model: Response, ranges: Ranges) -> list[tuple[float, float]]:
    """Ends of each variable's range [SI]: of the records, else as it was declared, else what its scaling says."""
    shift, scale = numbers(model.scaling.shift).tolist(), numbers(model.scaling.scale).tolist()
    found, k = [], 0
    for v in model.inputs:
        is_seen = v.seen != "none" and v.name != model.per
        usual = (0.0, 1.0)
        if is_seen:
            usual = (shift[k] - REACH * scale[k], shift[k] + REACH * scale[k]) if v.seen == "value" else HALF_CIRCLE
            k += 1
        low, high = ranges.get(v.name, (v.low, v.high))
        found.append((low if np.isfinite(low) else usual[0], high if np.isfinite(high) else usual[1]))
    return found


def _reference(model: Response) -> Reference:
    """The model in the units of its variables."""
    sizes, size = np.array([v.size for v in model.inputs]), model.output.size

    def reference(points: Float[np.ndarray, "n inputs"]) -> Float[np.ndarray, "n 1"]:
        return (model.at(points * sizes) / size)[:, None]

    return reference
