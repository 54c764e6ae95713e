"""Programs written as a spreadsheet: a csv whose cells are formulas, with English names of functions."""

import csv
import io
from collections.abc import Sequence

import sympy
from sympy.printing.codeprinter import CodePrinter

from manoeuvre_nn.formulas.program import Program, added, median, smallest

LONGEST_FORMULA = 8000
"""Letters that a formula may have; Excel takes 8192."""
MAX_ARGUMENTS = 100
"""Arguments that a function may have; more are a range of cells. Excel takes 255."""
TERMS_IN_PART = 100
"""Terms of a longer sum that are added up in a cell."""
FUNCTIONS = {
    sympy.tanh: "TANH", sympy.cos: "COS", sympy.sin: "SIN", sympy.exp: "EXP", sympy.log: "LN", sympy.Abs: "ABS",
    sympy.Max: "MAX", sympy.Min: "MIN", median: "MEDIAN", smallest: "MIN",
}  # fmt: skip
"""Functions and their names in a spreadsheet."""
Cells = list[list[str]]


class _Formula(CodePrinter):
    """Formulas in cells; the minus of ``-A1^2`` binds tighter in some programs, so that no power is written so."""

    printmethod = "_spreadsheet"
    language = "spreadsheet"
    _default_settings = {**CodePrinter._default_settings, "order": "none"}

    def __init__(self, places: dict[str, str]) -> None:
        super().__init__({})
        self.places = places

    def written(self, value: sympy.Expr) -> str:
        """A formula as a cell holds it."""
        return f"={self._print(value)}".replace(" ", "")

    def _print_Symbol(self, expr: sympy.Expr) -> str:  # noqa: N802  # sympy's name
        return self.places[expr.name]

    def _print_Float(self, expr: sympy.Expr) -> str:  # noqa: N802  # sympy's name
        return repr(float(expr)).replace("e", "E")

    def _print_Pow(self, expr: sympy.Expr) -> str:  # noqa: N802  # sympy's name
        base, power = expr.as_base_exp()
        if power == -1:
            return f"1/{self.parenthesize(base, 60)}"
        if power == sympy.Rational(1, 2):
            return f"SQRT({self._print(base)})"
        if power == -sympy.Rational(1, 2):
            return f"1/SQRT({self._print(base)})"
        return f"POWER({self._print(base)},{self._print(power)})"

    def _print_Function(self, expr: sympy.Expr) -> str:  # noqa: N802  # sympy's name
        if len(expr.args) > MAX_ARGUMENTS:  # of values in cells one below the other
            return f"{FUNCTIONS[expr.func]}({self._print(expr.args[0])}:{self._print(expr.args[-1])})"
        return f"{FUNCTIONS[expr.func]}({','.join(self._print(a) for a in expr.args)})"

    _print_Max = _print_Min = _print_Abs = _print_Function

    def _print_ExpBase(self, expr: sympy.Expr) -> str:  # noqa: N802  # sympy's name
        return f"EXP({self._print(expr.args[0])})"

    def _print_arctan2(self, expr: sympy.Expr) -> str:
        return f"ATAN2({self._print(expr.args[1])},{self._print(expr.args[0])})"  # of x and y

    def _print_logistic(self, expr: sympy.Expr) -> str:
        return f"(0.5+0.5*TANH(0.5*({self._print(expr.args[0])})))"


def csv_text(program: Program) -> str:
    """A spreadsheet: notes, inputs with values to change, outputs, and every value between in a cell of its own.

    Args:
        program: The program.

    Returns:
        Its text: label, value or formula, unit, comment.
    """
    head: Cells = [
        [program.title, "", "", "formulas have English names and decimal points"],
        *([n] for n in program.notes),
    ]
    places: dict[str, str] = {}
    rows: Cells = [*head, [], ["inputs", "value", "unit", "meaning and range"]]
    for q in program.inputs:
        rows.append([q.name, repr(float(q.example)), q.unit, f"{q.meaning}, {q.low:.6g} to {q.high:.6g}"])
        places[q.name] = f"$B${len(rows)}"
    rows += [[], ["outputs", "value", "unit", "meaning"]]
    first = len(rows)
    rows += [[q.name, "", q.unit, q.meaning] for q in program.outputs]
    printer = _Formula(places)
    for title, values in program.assignments():
        rows += [[], [title]]
        for target, value in values:
            _fill(rows, printer, str(target), value)
            places[str(target)] = f"$B${len(rows)}"
    for k, q in enumerate(program.outputs):
        rows[first + k][1] = f"={places[q.name]}"
    written = io.StringIO()
    csv.writer(written, lineterminator="\n").writerows([_said(row) for row in rows])
    return written.getvalue()


def _said(row: list[str]) -> list[str]:
    """A row whose words are no formulas, wherever they are from."""
    return [
        f" {cell}" if column != 1 and len(cell) > 1 and cell[0] in "=+-@" else cell for column, cell in enumerate(row)
    ]


def _fill(rows: Cells, printer: _Formula, label: str, value: sympy.Expr) -> None:
    """Append a value's row; a sum that is too long for a cell is added up in parts."""
    formula = printer.written(value)
    if len(formula) <= LONGEST_FORMULA:
        rows.append([label, formula])
        return
    whole = next((part for part in sympy.preorder_traversal(value) if isinstance(part, sympy.Add)), None)
    assert whole is not None and len(whole.args) > TERMS_IN_PART  # no function of ours is so long but for its sums
    parts: list[sympy.Symbol] = []
    for k in range(0, len(whole.args), TERMS_IN_PART):
        name = f"{label}, part {k // TERMS_IN_PART + 1}"
        _fill(rows, printer, name, added(whole.args[k : k + TERMS_IN_PART]))
        parts.append(sympy.Symbol(name, real=True))
        printer.places[name] = f"$B${len(rows)}"
    _fill(rows, printer, label, value.xreplace({whole: added(parts)}))


def cells(text: str) -> Sequence[Sequence[str]]:
    """Rows and columns of a written spreadsheet."""
    return list(csv.reader(io.StringIO(text)))
