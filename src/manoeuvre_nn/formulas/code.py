"""Programs written as code: Python that needs math alone, and C99."""

import textwrap
from collections.abc import Callable

import sympy
from sympy.printing.c import C99CodePrinter
from sympy.printing.pycode import PythonCodePrinter

from manoeuvre_nn.core.plain_text import harmless
from manoeuvre_nn.formulas.program import Program, Quantity, logistic, median, smallest

LINE = 110
"""Letters in a line of code."""
PYTHON_HELPERS = {
    logistic: '''def _logistic(x):
    """1 / (1 + exp(-x)), which does not overflow so."""
    return 0.5 + 0.5 * math.tanh(0.5 * x)
''',
    median: '''def _median(*values):
    """The value in the middle, of an even number the mean of the two there."""
    ordered = sorted(values)
    low, high = ordered[(len(ordered) - 1) // 2], ordered[len(ordered) // 2]
    return low + 0.5 * (high - low)
''',
}
C_HELPERS = {
    logistic: """static double logistic(double x)
{
    return 0.5 + 0.5 * tanh(0.5 * x); /* 1 / (1 + exp(-x)), which does not overflow so */
}
""",
    median: """static double median(int count, double *values)
{
    for (int i = 1; i < count; i++)
        for (int k = i; k > 0 && values[k - 1] > values[k]; k--) {
            const double higher = values[k - 1];
            values[k - 1] = values[k];
            values[k] = higher;
        }
    const double low = values[(count - 1) / 2], high = values[count / 2];
    return low + 0.5 * (high - low);
}
""",
    smallest: """static double smallest(int count, const double *values)
{
    double least = values[0];
    for (int i = 1; i < count; i++)
        least = fmin(least, values[i]);
    return least;
}
""",
}


class _Python(PythonCodePrinter):
    """Formulas with all digits, terms in the order in which they were given."""

    def __init__(self) -> None:
        super().__init__({"order": "none"})

    def _print_Float(self, expr: sympy.Expr) -> str:  # noqa: N802  # sympy's name
        return repr(float(expr))

    def _print_logistic(self, expr: sympy.Expr) -> str:
        return f"_logistic({self._print(expr.args[0])})"

    def _print_median(self, expr: sympy.Expr) -> str:
        return f"_median({', '.join(self._print(a) for a in expr.args)})"

    def _print_smallest(self, expr: sympy.Expr) -> str:
        return f"min({', '.join(self._print(a) for a in expr.args)})"

    def _print_arctan2(self, expr: sympy.Expr) -> str:
        return f"math.atan2({', '.join(self._print(a) for a in expr.args)})"


class _C99(C99CodePrinter):
    """The same in C."""

    def __init__(self) -> None:
        super().__init__({"order": "none"})

    def _print_Float(self, expr: sympy.Expr) -> str:  # noqa: N802  # sympy's name
        return repr(float(expr))

    def _print_logistic(self, expr: sympy.Expr) -> str:
        return f"logistic({self._print(expr.args[0])})"

    def _print_median(self, expr: sympy.Expr) -> str:
        values = ", ".join(self._print(a) for a in expr.args)
        return f"{expr.func.__name__}({len(expr.args)}, (double[]){{{values}}})"

    _print_smallest = _print_median

    def _print_arctan2(self, expr: sympy.Expr) -> str:
        return f"atan2({', '.join(self._print(a) for a in expr.args)})"


def python_text(program: Program) -> str:
    """A module with one function, which needs nothing but ``math``.

    Args:
        program: The program.

    Returns:
        Its text.
    """
    printer = _Python()
    body = [
        f'    """{_quoted(program.title)}.',
        "",
        "    Args:",
        *[f"        {line}" for q in program.inputs for line in _wrapped(_quoted(described(q)))],
        "",
        "    Returns:",
        *[f"        {line}" for line in _wrapped(_quoted(_given(program)))],
        '    """',
    ]
    for title, values in program.assignments():
        body.append(f"    # {title}")
        body += [line for target, value in values for line in _assigned(printer.doprint(value), str(target))]
    body.append(f"    return {', '.join(q.name for q in program.outputs)}")
    notes = [line for note in program.notes for line in _wrapped(_quoted(note))]
    head = ['"""' + f"{_quoted(program.title)}.", "", *notes, '"""', "", "import math"]
    helpers = [f"\n\n{text.rstrip()}" for kind, text in PYTHON_HELPERS.items() if uses(program, kind)]
    signature = f"\n\ndef {program.name}({', '.join(q.name for q in program.inputs)}):"
    return "\n".join([*head, *helpers, signature, *body]) + "\n"


def _assigned(value: str, target: str) -> list[str]:
    """An assignment in Python, over several lines where it is long."""
    line = f"    {target} = {value}"
    if len(line) <= LINE:
        return [line]
    lines = textwrap.wrap(value, LINE - 8, break_long_words=False, break_on_hyphens=False)
    return [f"    {target} = (", *[f"        {part}" for part in lines], "    )"]


def c_text(program: Program) -> str:
    """A file with one function in C99, which needs nothing but math.h.

    Args:
        program: The program.

    Returns:
        Its text.
    """
    printer = _C99()
    single = len(program.outputs) == 1
    comment = [*(f"{n}" for n in program.notes), "", *(described(q) for q in program.inputs)]
    given = _given(program)
    comment += ["", f"returned: {given}" if single else f"out: {given}"]
    lines = [line for text in comment for line in (_wrapped(text) or [""])]
    arguments = [f"double {q.name}" for q in program.inputs]
    if not single:
        arguments.append(f"double out[{len(program.outputs)}]")
    body = []
    for title, values in program.assignments():
        body.append(f"    /* {title} */")
        for target, value in values:
            line = f"const double {target} = {printer.doprint(value)};"
            body += textwrap.wrap(
                line, LINE, initial_indent="    ", subsequent_indent=" " * 8, break_long_words=False,
                break_on_hyphens=False,
            )  # fmt: skip
    names = [q.name for q in program.outputs]
    body += [f"    return {names[0]};"] if single else [f"    out[{k}] = {name};" for k, name in enumerate(names)]
    helpers = [f"{text}\n" for kind, text in C_HELPERS.items() if uses(program, kind)]
    kind = "double" if single else "void"
    return "\n".join([
        f"/* {_uncommented(program.title)}.", " *", *[f" * {_uncommented(line)}".rstrip() for line in lines], " */",
        "#include <math.h>", "", *helpers, f"{kind} {program.name}({', '.join(arguments)})", "{", *body, "}", "",
    ])  # fmt: skip


def _given(program: Program) -> str:
    """Outputs in words."""
    return "; ".join(f"{q.name}: {q.meaning} [{q.unit}]" for q in program.outputs)


def _quoted(text: str) -> str:
    """Words on one line that do not end a docstring, wherever they are from."""
    return " ".join(harmless(text).split()).replace("\\", "/").replace('"', "'")


def _uncommented(line: str) -> str:
    """A line that does not end a comment of C; by a stroke or ``??/`` at its end C would join it to the next one."""
    joined = harmless(line).replace("\n", " ").replace("\\", "/").replace("??", "? ?")
    return joined.replace("*/", "* /").replace("/*", "/ *")


def uses(program: Program, kind: Callable) -> bool:
    """Whether a function of ours occurs in a program."""
    return any(value.has(kind) for _, values in program.assignments() for _, value in values)


def described(q: Quantity) -> str:
    """An input in words, with its unit and range."""
    return f"{q.name}: {q.meaning} [{q.unit}], {q.low:.6g} to {q.high:.6g}"


def _wrapped(text: str) -> list[str]:
    return textwrap.wrap(text, LINE - 8, subsequent_indent="    ", break_long_words=False, break_on_hyphens=False)
