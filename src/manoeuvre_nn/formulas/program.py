"""A model as a program: inputs, values that follow from them one after the other, and outputs."""

import keyword
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import sympy
from jaxtyping import Float

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.dynamics.vessel import Vessel

TAKEN = frozenset(
    "abs acos asin atan2 auto break case char const continue cos default do double else enum exp extern fabs float "
    "fmax fmin for goto if inline int log logistic long math max median min pow register restrict return short signed "
    "sin sinh sizeof sqrt static struct switch tan tanh typedef union unsigned void volatile while".split()
)
"""Words of C, and functions that the written texts use: no value may be called so."""

Numbers = Float[np.ndarray, "rows terms"]
Reference = Callable[[Float[np.ndarray, "n inputs"]], Float[np.ndarray, "n outputs"]]
"""A model as a function of a table of inputs, a row a point."""


class logistic(sympy.Function):  # noqa: N801  # sympy writes functions as mathematics does
    """``1 / (1 + exp(-x))``, written as ``(1 + tanh(x/2))/2``, which does not overflow."""


class median(sympy.Function):  # noqa: N801
    """The value in the middle; of an even number of values the mean of the two there."""


class smallest(sympy.Function):  # noqa: N801
    """The smallest of many values."""


class arctan2(sympy.Function):  # noqa: N801
    """The angle of the point (x, y), of y and x."""


@dataclass(frozen=True)
class Quantity:
    """An input or an output of a program.

    Attributes:
        name: Its name, a word.
        unit: Its unit.
        meaning: What it is, with its sign.
        low: Lower end of the range that the model was trained on, in the unit; of outputs not used.
        high: Upper end.
        example: A value of an input to begin with.
        symbol: Symbol in LaTeX; empty takes the name.
        parameter: Whether it is a number that is chosen once for a run, not an input that changes in it.
    """

    name: str
    unit: str
    meaning: str
    low: float = 0.0
    high: float = 0.0
    example: float = 0.0
    symbol: str = ""
    parameter: bool = False


@dataclass(frozen=True)
class Weighted:
    """Values by one formula with other numbers: ``y_i = outer(b_i sum_j term(z_j, a_ij))``.

    Attributes:
        targets: y.
        inputs: z.
        numbers: a; a weight of 0 leaves its term out.
        outer: What is taken of the sum; None takes the sum itself.
        distance: Whether a term is ``(z - a)^2``; else it is ``a z``.
        factors: b; None leaves it out.
    """

    targets: tuple[sympy.Symbol, ...]
    inputs: tuple[sympy.Expr, ...]
    numbers: Numbers
    outer: Callable[[sympy.Expr], sympy.Expr] | None = None
    distance: bool = False
    factors: Float[np.ndarray, " rows"] | None = None

    def value(self, row: int) -> sympy.Expr:
        """What one of the values is."""
        terms = [self.term(z, float(a)) for z, a in zip(self.inputs, self.numbers[row], strict=True)]
        total = added([term for term in terms if term is not None])
        if self.factors is not None:
            total = sympy.Mul(sympy.Float(float(self.factors[row])), total, evaluate=False)
        return total if self.outer is None else self.outer(total)

    def term(self, z: sympy.Expr, a: float) -> sympy.Expr | None:
        """One term; None where there is none."""
        if self.distance:
            return sympy.Pow(added([z, sympy.Float(-a)]), 2, evaluate=False)
        return times(a, z) if a else None


@dataclass(frozen=True)
class Single:
    """One value by a formula of its own.

    Attributes:
        target: The value.
        formula: What it is.
    """

    target: sympy.Symbol
    formula: sympy.Expr


@dataclass(frozen=True)
class Each:
    """Values by one formula of one other value each: ``y_i = formula(z_i)``.

    Attributes:
        targets: y.
        sources: z.
        formula: What is done to each.
    """

    targets: tuple[sympy.Symbol, ...]
    sources: tuple[sympy.Symbol, ...]
    formula: Callable[[sympy.Expr], sympy.Expr]


Step = Single | Weighted | Each


@dataclass(frozen=True)
class Section:
    """Steps that belong together.

    Attributes:
        title: What they give.
        steps: In the order in which they are done.
    """

    title: str
    steps: list[Step] = field(default_factory=list)


@dataclass(frozen=True)
class Program:
    """A model in closed form.

    Attributes:
        name: The function's name.
        title: What it is, in a line.
        inputs: What it takes.
        outputs: What it gives; values of these names are among those of the steps.
        sections: How.
        notes: Where it is from, and what holds of it, a sentence each.
        reference: The model itself: inputs, a row a point, to outputs.
        symbols: Name of a value -> its symbol in LaTeX, where sympy's own would not do.
        vessel: The ship that moves so; None for a response.
    """

    name: str
    title: str
    inputs: Sequence[Quantity]
    outputs: Sequence[Quantity]
    sections: Sequence[Section]
    notes: Sequence[str]
    reference: Reference
    symbols: Mapping[str, str]
    vessel: Vessel | None = None

    @property
    def gives_rates(self) -> bool:
        """Whether it gives a ship's accelerations; else a response, or where she stands a step later."""
        return any(q.name == "udot" for q in self.outputs)

    def assignments(self) -> list[tuple[str, list[tuple[sympy.Symbol, sympy.Expr]]]]:
        """Title of each section, and its values one by one."""
        return [(s.title, [pair for step in s.steps for pair in singles(step)]) for s in self.sections]


def singles(step: Step) -> list[tuple[sympy.Symbol, sympy.Expr]]:
    """The values of a step one by one, each with what it is."""
    if isinstance(step, Single):
        return [(step.target, step.formula)]
    if isinstance(step, Each):
        return [(target, step.formula(source)) for target, source in zip(step.targets, step.sources, strict=True)]
    return [(target, step.value(row)) for row, target in enumerate(step.targets)]


class Builder:
    """What a model writes its program with: every call names a value and gives the symbol that stands for it."""

    def __init__(self, inputs: Sequence[Quantity], outputs: Sequence[Quantity]) -> None:
        """Begin with symbols for the inputs.

        Args:
            inputs: What the program takes.
            outputs: What it gives; only a value that is meant to be one of them may have its name.
        """
        self.sections: list[Section] = []
        self.symbols = {q.name: q.symbol for q in (*inputs, *outputs) if q.symbol}
        self._written = {q.symbol or sympy.latex(sympy.Symbol(q.name)) for q in (*inputs, *outputs)}
        self._used = {q.name for q in (*inputs, *outputs)} | TAKEN | set(keyword.kwlist)
        self.inputs = [sympy.Symbol(q.name, real=True) for q in inputs]

    def go_on(self, program: Program) -> list[sympy.Symbol]:
        """Begin with the steps of another program, whose inputs are among those of this one.

        Args:
            program: The other program.

        Returns:
            Symbols that stand for its outputs.
        """
        renamed = {sympy.Symbol(q.name, real=True): self._named([f"{q.name}_0"], [""])[0] for q in program.outputs}

        def moved(step: Step) -> Step:
            if isinstance(step, Single):
                return replace(step, target=renamed.get(step.target, step.target))
            return replace(step, targets=tuple(renamed.get(t, t) for t in step.targets))

        self.sections += [Section(s.title, [moved(step) for step in s.steps]) for s in program.sections]
        steps = [step for s in program.sections for step in s.steps]
        self._used |= {str(target) for step in steps for target, _ in singles(step)}
        self.symbols = {**program.symbols, **self.symbols}
        self._written |= set(program.symbols.values())
        return list(renamed.values())

    def section(self, title: str) -> None:
        """Begin a new section."""
        self.sections.append(Section(title))

    def let(self, name: str, formula: sympy.Expr, symbol: str = "") -> sympy.Symbol:
        """A value by a formula of its own, and perhaps how LaTeX writes its name; its symbol is returned."""
        (target,) = self._named([name], [symbol])
        self.sections[-1].steps.append(Single(target, formula))
        return target

    def weighted(
        self,
        names: Sequence[str],
        inputs: Sequence[sympy.Expr],
        numbers: Numbers,
        outer: Callable[[sympy.Expr], sympy.Expr] | None = None,
        *,
        distance: bool = False,
        factors: Float[np.ndarray, " rows"] | None = None,
        symbols: Sequence[str] = (),
    ) -> list[sympy.Symbol]:
        """Several values by one formula, see :class:`Weighted`.

        Args:
            names: Their names.
            inputs: z.
            numbers: a, a row a value.
            outer: What is taken of the sum.
            distance: Whether terms are squared distances.
            factors: b.
            symbols: Their symbols in LaTeX.

        Returns:
            Their symbols.
        """
        targets = self._named(names, symbols or [""] * len(names))
        numbers = np.asarray(numbers, dtype=np.float64)
        self.sections[-1].steps.append(Weighted(tuple(targets), tuple(inputs), numbers, outer, distance, factors))
        return targets

    def each(
        self, names: Sequence[str], sources: Sequence[sympy.Symbol], formula: Callable[[sympy.Expr], sympy.Expr]
    ) -> list[sympy.Symbol]:
        """Several values, each by the same formula of another one, see :class:`Each`."""
        targets = self._named(names, [""] * len(names))
        self.sections[-1].steps.append(Each(tuple(targets), tuple(sources), formula))
        return targets

    def outputs(self, names: Sequence[str], inputs: Sequence[sympy.Expr], numbers: Numbers) -> None:
        """Weighted sums that are outputs of the program."""
        targets = tuple(sympy.Symbol(name, real=True) for name in names)
        self.sections[-1].steps.append(Weighted(targets, tuple(inputs), np.asarray(numbers, dtype=np.float64)))

    def output(self, name: str, formula: sympy.Expr) -> None:
        """A value that is an output of the program."""
        self.sections[-1].steps.append(Single(sympy.Symbol(name, real=True), formula))

    def _named(self, names: Sequence[str], symbols: Sequence[str]) -> list[sympy.Symbol]:
        """Symbols of values; a name that is taken is given an underscore, a symbol of LaTeX a star."""
        found = []
        written = [symbol or sympy.latex(sympy.Symbol(name)) for name, symbol in zip(names, symbols, strict=True)]
        while self._written & set(written):
            written = [f"{{}}^{{*}}{symbol}" for symbol in written]
        self._written |= set(written)
        for name, symbol in zip(names, written, strict=True):
            while name in self._used:
                name += "_"
            self._used.add(name)
            self.symbols[name] = symbol
            found.append(sympy.Symbol(name, real=True))
        return found


def times(a: float, z: sympy.Expr) -> sympy.Expr:
    """``a z`` as it is written, nothing multiplied out but whole numbers in z."""
    whole, rest = z.as_coeff_Mul()
    if rest == 1:
        return sympy.Float(a * float(whole))
    if a * whole == 1:
        return rest
    return sympy.Mul(sympy.Float(a * float(whole)), *sympy.Mul.make_args(rest), evaluate=False)


def product(a: sympy.Expr, b: sympy.Expr) -> sympy.Expr:
    """``a b`` as it is written, sums in it not multiplied out."""
    return a if b == 1 else sympy.Mul(b, a, evaluate=False)


def added(terms: Sequence[sympy.Expr]) -> sympy.Expr:
    """The sum of terms in the order in which they are given."""
    if len(terms) < 2:
        return terms[0] if terms else sympy.Float(0.0)
    return sympy.Add(*terms, evaluate=False)


def ratio(top: sympy.Expr, bottom: float) -> sympy.Expr:
    """``top / bottom`` as it is written; a bottom of 1 is left out."""
    if bottom == 1.0:
        return top
    return sympy.Mul(top, sympy.Pow(sympy.Float(bottom), -1, evaluate=False), evaluate=False)


def shifted(z: sympy.Expr, shift: float, scale: float) -> sympy.Expr:
    """``(z - shift) / scale`` as it is written; a shift of 0 and a scale of 1 are left out."""
    return ratio(z if shift == 0.0 else added([z, sympy.Float(-shift)]), scale)


def at_least(z: sympy.Expr, low: float) -> sympy.Expr:
    """The larger of the two."""
    return sympy.Max(z, sympy.Float(low))


def floats(formula: sympy.Expr) -> list[float]:
    """All numbers of a formula that are no whole ones, in the order of its tree."""
    return [float(part) for part in sympy.preorder_traversal(formula) if isinstance(part, sympy.Float)]


def checked_name(name: str, what: str) -> str:
    """A name that may be written into a program.

    Args:
        name: The name.
        what: What it stands for, for the message.

    Returns:
        The name.

    Raises:
        InputError: If no language would take it.
    """
    if not (name.isidentifier() and name.isascii()) or name in TAKEN or keyword.iskeyword(name):
        raise InputError(f"{what} {name!r} cannot be a name in a program: give it another, of letters and digits")
    return name
