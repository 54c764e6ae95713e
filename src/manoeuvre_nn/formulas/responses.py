"""Responses to service parameters as programs, in the units in which people write these."""

import re
from collections.abc import Sequence

import numpy as np
import sympy
from jaxtyping import Float

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.response import COSINE, DERIVED, Response, Variable
from manoeuvre_nn.formulas.networks import closed_form, numbers
from manoeuvre_nn.formulas.program import Builder, Program, Quantity, Reference, added, checked_name, shifted, times
from manoeuvre_nn.formulas.ranges import Ranges


def response(model: Response, ranges: Ranges | None = None, notes: Sequence[str] = ()) -> Program:
    """An approximation of a response: features, network, and what its output is multiplied by.

    Returns:
        The variables to the response; names carry their units, as ``V_kn``.
    """
    given = [_input(v, (ranges or {}).get(v.name, (v.low, v.high))) for v in model.inputs]
    output = _quantity(model.output)
    build = Builder(given, [output])
    seen = _features(model, build)
    answer = closed_form(model.network, seen, build)[0]
    build.section("The response")
    scaling, size = model.scaling, model.output.size
    factor = next((v for v in model.inputs if v.name == model.quantities.per), None)
    share = 1.0 if factor is None else factor.size
    terms = [times(float(scaling.output_scale[0]) * share / size, answer)]
    if scaling.output_shift is not None:
        terms.append(sympy.Float(float(scaling.output_shift[0]) * share / size))
    if factor is None:
        build.output(output.name, added(terms))
    else:
        whole = build.let("y_s", added(terms))
        build.output(output.name, whole * build.inputs[model.inputs.index(factor)])
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
    """Scaled features; where one is a variable itself, shift and scale are in the variable's unit."""
    shift, scale = numbers(model.scaling.shift).tolist(), numbers(model.scaling.scale).tolist()
    variables = {v.name: (symbol, v.size) for v, symbol in zip(model.inputs, build.inputs, strict=True)}
    made_of = {name for one in model.quantities.sees for name in _needs(one, list(variables))}
    build.section("Variables in SI")
    in_si = {name: _in_si(name, symbol, size, build) for name, (symbol, size) in variables.items() if name in made_of}
    build.section("What the network sees")
    found: list[sympy.Expr] = []
    formulas = model.quantities.seen({**{name: symbol for name, (symbol, _) in variables.items()}, **in_si}, sympy.cos)
    for k, (one, formula) in enumerate(zip(model.quantities.sees, formulas, strict=True)):
        z, size = variables[one] if one in variables else (build.let(one, formula, _symbol(one, build)), 1.0)
        found.append(build.let(f"x_{k + 1}", shifted(z, shift[k] / size, scale[k] / size)))
    return found


def _symbol(one: str, build: Builder) -> str:
    """How LaTeX writes a feature that is no variable itself."""
    if one in DERIVED:
        return DERIVED[one][2]
    name = one.removeprefix(COSINE)
    return rf"c_{{{build.symbols.get(name) or sympy.latex(sympy.Symbol(name))}}}"


def _needs(one: str, names: Sequence[str]) -> Sequence[str]:
    """Variables that a feature is made of; none of a variable itself."""
    if one in DERIVED:
        return DERIVED[one][1]
    return [] if one in names else [one.removeprefix(COSINE)]


def _in_si(name: str, symbol: sympy.Symbol, size: float, build: Builder) -> sympy.Expr:
    """A variable in SI."""
    written = build.symbols.get(symbol.name) or sympy.latex(sympy.Symbol(name))
    return symbol if size == 1.0 else build.let(f"{name}_SI", times(size, symbol), rf"\tilde{{{written}}}")


def _quantity(v: Variable) -> Quantity:
    """A variable under a name that carries its unit where this is not that of SI."""
    unit = re.sub(r"\W", "", v.unit)
    name = v.name if v.size == 1.0 or not unit else f"{v.name}_{unit}"
    symbol = v.symbol or sympy.latex(sympy.Symbol(v.name))
    return Quantity(checked_name(name, "variable"), v.unit, v.meaning, symbol=symbol)


def _input(v: Variable, ends: tuple[float, float]) -> Quantity:
    """An input with its range, and its middle to begin with."""
    if not np.isfinite(ends).all():
        raise InputError(f"the range of {v.name} is not known: give inputs.{v.name}.low and inputs.{v.name}.high")
    q, (low, high) = _quantity(v), (end / v.size for end in ends)
    return Quantity(q.name, q.unit, q.meaning, low, high, float(f"{0.5 * (low + high):.3g}"), q.symbol)


def _reference(model: Response) -> Reference:
    """The model in the units of its variables."""
    sizes, size = np.array([v.size for v in model.inputs]), model.output.size

    def reference(points: Float[np.ndarray, "n inputs"]) -> Float[np.ndarray, "n 1"]:
        return (model.at(points * sizes) / size)[:, None]

    return reference
