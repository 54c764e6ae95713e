"""Programs written as mathematics: LaTeX with all digits of the numbers, those of many values in tables."""

import re
from collections.abc import Mapping, Sequence
from itertools import groupby

import numpy as np
import sympy
from sympy.printing.latex import LatexPrinter

from manoeuvre_nn.formulas.program import Each, Program, Single, Step, Weighted, logistic, median, singles

MAX_INLINE_NUMBERS = 9
"""Numbers that a formula may have; more stand in a table."""
MAX_COLUMNS, MAX_BLOCKS = 7, 3
"""Inputs of sums that are columns of a table, more are its rows; pairs of product and coefficient side by side."""
LETTERS = {r"\scriptsize": 4.1, r"\tiny": 3.5}
"""Sizes of letters, and how wide a digit is [pt]."""
PAGE_WIDTH, COLUMN_GAP = 486.0, 6.0
"""Width of a line, and what stands between columns [pt]."""
LINE_WIDTH = 88
"""Letters in a line of mathematics."""
MAX_LISTED = 8
"""Inputs of a sum that are listed beside it; more are only in its table."""
PREAMBLE = r"""\documentclass[a4paper,10pt]{article}
\usepackage{amsmath,amssymb,longtable}
\usepackage[margin=19mm]{geometry}
\setlength{\parindent}{0pt}
\addtolength{\jot}{3pt}
\allowdisplaybreaks
\begin{document}
"""
NEEDS = r"""% Needs \usepackage{amsmath,amssymb,longtable} and, for pages of formulas, \allowdisplaybreaks.
"""
FIRST_LINE = "% Written by manoeuvre-nn."
SPECIAL = {
    "\\": r"\textbackslash{}", "{": r"\{", "}": r"\}", "%": r"\%", "&": r"\&", "#": r"\#", "_": r"\_", "$": r"\$",
    "~": r"\textasciitilde{}", "^": r"\textasciicircum{}",
}  # fmt: skip


class Mathematics(LatexPrinter):
    """Formulas with all digits, terms in the order in which they were given."""

    def __init__(self, symbols: Mapping[sympy.Symbol, str]) -> None:
        """Take symbols.

        Args:
            symbols: What values are written as.
        """
        self.symbols = dict(symbols)
        super().__init__({"order": "none", "symbol_names": self.symbols, "mul_symbol": r" \, "})

    def with_symbol(self, value: sympy.Symbol, written: str) -> "Mathematics":
        """The same with one more symbol."""
        return Mathematics({**self.symbols, value: written})

    def _print_Float(self, expr: sympy.Expr) -> str:  # noqa: N802  # sympy's name
        digits, _, power = repr(float(expr)).partition("e")
        return rf"{digits} \cdot 10^{{{int(power)}}}" if power else digits

    def _print_Max(self, expr: sympy.Expr, exp: str | None = None) -> str:  # noqa: N802  # sympy's name
        return self._called(r"\max", expr.args, exp)

    def _print_logistic(self, expr: sympy.Expr, exp: str | None = None) -> str:
        return self._called(r"\sigma", expr.args, exp)

    def _print_median(self, expr: sympy.Expr, exp: str | None = None) -> str:
        return self._called(r"\operatorname{median}", expr.args, exp)

    def _print_arctan2(self, expr: sympy.Expr, exp: str | None = None) -> str:
        return self._called(r"\operatorname{atan2}", expr.args, exp)

    def _print_smallest(self, expr: sympy.Expr, exp: str | None = None) -> str:
        first, last = self._print(expr.args[0]), self._print(expr.args[-1])
        return rf"\min\left({first}, \ldots, {last}\right)"

    def _called(self, name: str, arguments: Sequence[sympy.Expr], exp: str | None = None) -> str:
        """A function of arguments, to a power where one is given."""
        called = rf"{name}\left({', '.join(self._print(a) for a in arguments)}\right)"
        return called if exp is None else f"{called}^{{{exp}}}"

    def lines(self, formula: sympy.Expr) -> list[str]:
        """A formula broken into lines at its outermost signs, or between the values of a median."""
        if isinstance(formula, median):
            parts = [f"{self._print(a)}, " for a in formula.args]
            parts = [r"\operatorname{median}\bigl(" + parts[0], *parts[1:-1], parts[-1].rstrip(", ") + r"\bigr)"]
        elif isinstance(formula, sympy.Add):
            parts = [self._print(a) for a in formula.args]
            parts = [parts[0], *(f" - {p[1:].strip()}" if p.startswith("-") else f" + {p}" for p in parts[1:])]
        else:
            parts = [self._print(formula)]
        lines = [""]
        for part in parts:
            if lines[-1] and _width(lines[-1]) + _width(part) > LINE_WIDTH:
                lines.append("")
            lines[-1] += part
        return lines


def latex_text(program: Program, *, document: bool = True) -> str:
    """A page of mathematics.

    Args:
        program: The program.
        document: Whether it is a document of its own; else it is a part of one.

    Returns:
        Its text.
    """
    printer = Mathematics({sympy.Symbol(name, real=True): symbol for name, symbol in program.symbols.items()})
    tables = _Tables()
    parts = [rf"\section*{{{escaped(program.title)}}}", *(f"{escaped(note)}\n" for note in program.notes)]
    parts.append(_symbol_table(program, printer))
    if any(value.has(logistic) for _, values in program.assignments() for _, value in values):
        parts.append(r"\[ \sigma(x) = \frac{1}{1 + e^{-x}} \]")
    for section in program.sections:
        parts.append(rf"\subsection*{{{escaped(section.title)}}}")
        for inline, group in groupby(section.steps, key=_is_short):
            steps = list(group)
            parts += [_aligned(steps, printer)] if inline else [tables.written(step, printer) for step in steps]
    text = "\n".join(parts)
    return f"{FIRST_LINE}\n{PREAMBLE}{text}\n\\end{{document}}\n" if document else f"{FIRST_LINE}\n{NEEDS}{text}\n"


def escaped(text: str) -> str:
    """A text in one line, with what LaTeX takes for commands made harmless."""
    return "".join(SPECIAL.get(letter, letter) for letter in " ".join(text.split()))


def _unit(unit: str) -> str:
    """A unit with its powers."""
    powers = re.sub(r"\^(-?\d+)", r"^{\1}", unit).replace(" ", r"\,")
    return "--" if unit == "-" else rf"$\mathrm{{{powers}}}$"


def _symbol_table(program: Program, printer: Mathematics) -> str:
    """Inputs with their ranges, and outputs."""
    rows = []
    for q in program.inputs:
        symbol = printer.doprint(sympy.Symbol(q.name, real=True))
        rows.append(rf"${symbol}$ & {escaped(q.meaning)} & {_unit(q.unit)} & {q.low:.6g} to {q.high:.6g} \\")
    for q in program.outputs:
        rows.append(
            rf"${printer.doprint(sympy.Symbol(q.name, real=True))}$ & {escaped(q.meaning)} & {_unit(q.unit)} & \\"
        )
    head = r"symbol & meaning & unit & range \\ \hline"
    return "\n".join([r"\begin{center}", r"\begin{tabular}{llll}", head, *rows, r"\end{tabular}", r"\end{center}"])


def _is_short(step: Step) -> bool:
    return isinstance(step, Single) or (isinstance(step, Weighted) and step.numbers.size <= MAX_INLINE_NUMBERS)


def _aligned(steps: Sequence[Step], printer: Mathematics) -> str:
    """Values that are written out."""
    lines = []
    for step in steps:
        for target, formula in singles(step):
            first, *more = printer.lines(formula)
            lines.append(f"{printer.doprint(target)} &= {first}" + "".join(rf" \\ &\quad {part}" for part in more))
    return "\\begin{align*}\n" + " \\\\\n".join(lines) + "\n\\end{align*}"


class _Tables:
    """Weighted sums by their formula and a table of numbers; numbers that are used twice are written once."""

    def __init__(self) -> None:
        self.known: list[np.ndarray] = []

    def written(self, step: Step, printer: Mathematics) -> str:
        """Formula and table."""
        if isinstance(step, Each):
            return _each(step, printer)
        assert isinstance(step, Weighted)
        if len(step.targets) == 1 and step.outer is None and not step.distance and (step.numbers == 1).all():
            first, last, target = (printer.doprint(x) for x in (step.inputs[0], step.inputs[-1], step.targets[0]))
            return rf"\[ {target} = {first} + \ldots + {last} \]"
        again = next((k for k, numbers in enumerate(self.known) if np.array_equal(numbers, step.numbers)), None)
        if len(step.inputs) > MAX_LISTED:  # only the table says what they are
            again = None
        if again is None:
            self.known.append(step.numbers)
        number = len(self.known) if again is None else again + 1
        formula = self._formula(step, printer, number)
        if again is not None:
            return f"{formula}\nwith the numbers $A^{{({number})}}$ above."
        if len(step.targets) == 1:
            return f"{formula}\n{self._pairs(step, printer)}"
        return "\n".join([formula, *self._grids(step, printer)])

    def _formula(self, step: Weighted, printer: Mathematics, number: int) -> str:
        """``h_i = tanh(sum_j A_ij z_j)`` and what z is."""
        single, inputs = len(step.targets) == 1, [printer.doprint(z) for z in step.inputs]
        index = "j" if single else "ij"
        term = rf"\bigl(z_{{j}} - A^{{({number})}}_{{{index}}}\bigr)^{{2}}" if step.distance else (
            rf"A^{{({number})}}_{{{index}}} \, z_{{j}}"
        )  # fmt: skip
        total = sympy.Symbol("total", real=True)
        value = total if step.outer is None else step.outer(total)
        before = "" if step.factors is None else rf"B^{{({number})}}_{{i}} \, "
        inner = printer.with_symbol(total, rf"{before}\sum_{{j}} {term}")
        targets = list(dict.fromkeys(_indexed(printer.doprint(t)) for t in step.targets))
        left = printer.doprint(step.targets[0]) if single else ", ".join(targets)
        between = r", \, ".join(inputs)
        listed = rf", \qquad z = \bigl({between}\bigr)" if len(inputs) <= MAX_LISTED else ""
        return rf"\[ {left} = {inner.doprint(value)}{listed} \]"

    def _pairs(self, step: Weighted, printer: Mathematics) -> str:
        """What is multiplied and its number, a few pairs side by side."""
        cells = [
            f"${printer.doprint(z)}$ & ${_number(a, printer)}$"
            for z, a in zip(step.inputs, step.numbers[0], strict=True)
            if a
        ]
        rows = [" & ".join(cells[k : k + MAX_BLOCKS]) + r" \\" for k in range(0, len(cells), MAX_BLOCKS)]
        head = " & ".join([r"$z_{j}$ & $A_{j}$"] * min(MAX_BLOCKS, len(cells))) + r" \\ \hline \endhead"
        return _table("|".join(["lr"] * min(MAX_BLOCKS, len(cells))), [head, *rows])

    def _grids(self, step: Weighted, printer: Mathematics) -> list[str]:
        """A table of targets by inputs, or the other way round where there are fewer targets."""
        targets, inputs = ([f"${printer.doprint(x)}$" for x in some] for some in (step.targets, step.inputs))
        turned = len(inputs) > MAX_COLUMNS and len(targets) < len(inputs) and step.factors is None
        rows, columns, numbers = (inputs, targets, step.numbers.T) if turned else (targets, inputs, step.numbers)
        if step.factors is not None:
            columns, numbers = [*columns, "$B_{i}$"], np.column_stack([numbers, step.factors])
        corner = r"$A_{ij}$: $j$, $i$" if turned else r"$A_{ij}$: $i$, $j$"
        cells = [[f"${_number(a, printer)}$" for a in row] for row in numbers]
        return _fitted([corner, *columns], [[name, *row] for name, row in zip(rows, cells, strict=True)])


def _fitted(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """A table in letters that fit the page, or several with some of the columns each; the first column is in all."""
    widths = [max(_width(row[k]) + 2 * row[k].count("cdot") for row in rows) for k in range(len(head))]
    wide = {size: [letter * w + COLUMN_GAP for w in widths] for size, letter in LETTERS.items()}
    size = next((name for name, each in wide.items() if sum(each) <= PAGE_WIDTH), list(LETTERS)[-1])
    made, label = [], max(wide[size][0], _width(head[0]) * LETTERS[size])
    start = 1
    while start < len(head):
        stop, used = start + 1, label + wide[size][start]
        while stop < len(head) and used + wide[size][stop] <= PAGE_WIDTH:
            used, stop = used + wide[size][stop], stop + 1
        parts = [" & ".join([row[0], *row[start:stop]]) + r" \\" for row in (head, *rows)]
        made.append(_table("l|" + "r" * (stop - start), [rf"{parts[0]} \hline \endhead", *parts[1:]], size))
        start = stop
    return made


def _each(step: Each, printer: Mathematics) -> str:
    """``y_i = f(z_i)`` for all i."""
    source = sympy.Symbol("source", real=True)
    inner = printer.with_symbol(source, _indexed(printer.doprint(step.sources[0])))
    left = _indexed(printer.doprint(step.targets[0]))
    return rf"\[ {left} = {inner.doprint(step.formula(source))}, \qquad i = 1, \, \ldots, \, {len(step.targets)} \]"


def _table(columns: str, rows: Sequence[str], size: str = r"\scriptsize") -> str:
    opening = rf"{{{size}" + r"\setlength{\tabcolsep}{3pt}\renewcommand{\arraystretch}{1.35}"
    return "\n".join([opening, rf"\begin{{longtable}}{{{columns}}}", *rows, r"\end{longtable}}"])


def _number(value: float, printer: Mathematics) -> str:
    return printer.doprint(sympy.Float(float(value)))


def _indexed(symbol: str) -> str:
    """``h_{3}`` as ``h_{i}``."""
    return re.sub(r"_\{[^{}]*\}$", "_{i}", symbol)


def _width(text: str) -> int:
    """About how many letters wide mathematics is."""
    return len(re.sub(r"\\[a-zA-Z]+|[{}$\\ ^_]", "", text))
