"""Whether a written text says what the model does: it is run, and compared with the model."""

import ctypes
import math
import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.formulas import latex_reader
from manoeuvre_nn.formulas.program import Program
from manoeuvre_nn.formulas.spreadsheet import cells

POINTS = 1000
"""Points that a text is compared with the model at."""
MAX_DIFFERENCE = 1e-9
"""Largest difference between text and model over the largest output [-]."""
RANGE = re.compile(r"B(\d+):B(\d+)")
"""Cells of a spreadsheet one below the other."""
LITTLE = 0.1
"""How far to both sides of its value an input is varied for the comparison that did not vary in the training."""
COMPILERS = ("cc", "gcc", "clang")
Points = Float[np.ndarray, "n inputs"]
Outputs = Float[np.ndarray, "n outputs"]
CELL_FUNCTIONS: dict[str, Any] = {
    "TANH": math.tanh, "COS": math.cos, "SIN": math.sin, "EXP": math.exp, "LN": math.log, "ABS": abs, "MAX": max,
    "MIN": min, "SQRT": math.sqrt, "POWER": pow, "MEDIAN": lambda *values: median(values),
}  # fmt: skip
"""What functions of a spreadsheet do."""


def sample(program: Program, count: int = POINTS, seed: int = 0) -> Float[np.ndarray, "n inputs"]:
    """Random points over the ranges of a program's inputs; one whose ends are equal varies a little all the same."""
    low, high = (np.array([getattr(q, end) for q in program.inputs]) for end in ("low", "high"))
    low, high = low - np.where(low < high, 0.0, LITTLE), high + np.where(low < high, 0.0, LITTLE)
    return low + (high - low) * np.random.default_rng(seed).random((count, len(low)))


def largest_difference(program: Program, kind: str, text: str) -> float | None:
    """Compare a text with the model.

    Args:
        program: What was written.
        kind: ``python``, ``c``, ``csv`` or ``latex``.
        text: The text.

    Returns:
        Largest difference over the largest size of the output [-]; None for C where there is no compiler.
    """
    points = sample(program)
    found = RUN[kind](program, text, points)
    if found is None:
        return None
    expected = program.reference(points)
    sizes = np.maximum(np.abs(expected).max(axis=0), np.finfo(float).tiny)
    return float((np.abs(found - expected).max(axis=0) / sizes).max())


def run_python(program: Program, text: str, points: Points) -> Outputs:
    """Outputs of a written module."""
    module: dict[str, Any] = {}
    exec(compile(text, program.name, "exec"), module)  # our own text, a moment old
    return np.array([np.atleast_1d(module[program.name](*row)) for row in points.tolist()])


def run_c(program: Program, text: str, points: Points) -> Outputs | None:
    """Outputs of a written file of C; None without a compiler."""
    compiler = next((c for c in COMPILERS if shutil.which(c)), None)
    if compiler is None:
        return None
    with TemporaryDirectory() as folder:
        source, library = Path(folder, "model.c"), Path(folder, "model.so")
        source.write_text(text, encoding="utf-8")
        options = ["-std=c99", "-O1", "-fPIC", "-shared"]
        subprocess.run([compiler, *options, str(source), "-o", str(library), "-lm"], check=True, capture_output=True)
        function = getattr(ctypes.CDLL(str(library)), program.name)
        count = len(program.outputs)
        out = (ctypes.c_double * count)()
        function.restype = ctypes.c_double if count == 1 else None
        function.argtypes = [ctypes.c_double] * len(program.inputs) + ([] if count == 1 else [type(out)])
        if count == 1:
            return np.array([[function(*row)] for row in points.tolist()])
        found = []
        for row in points.tolist():
            function(*row, out)
            found.append(list(out))
        return np.array(found)


def run_csv(program: Program, text: str, points: Points) -> Outputs:
    """Outputs of a spreadsheet, its cells computed from top to bottom."""
    rows = cells(text)
    start = next(k for k, row in enumerate(rows) if row[:1] == ["inputs"])
    ends = next(k for k, row in enumerate(rows) if row[:1] == ["outputs"])
    inputs = [f"B{k + 1}" for k in range(start + 1, start + 1 + len(program.inputs))]
    formulas = {
        f"B{k + 1}": compile(RANGE.sub(r"*CELLS(\1, \2)", row[1][1:].replace("$", "")), "cell", "eval")
        for k, row in enumerate(rows)
        if k > ends and len(row) > 1 and row[1].startswith("=")
    }
    outputs = [f"B{k + 1}" for k in range(ends + 1, ends + 1 + len(program.outputs))]
    last = {name: formulas.pop(name) for name in outputs}  # above what they are made of
    return np.array([_cells_at(dict(zip(inputs, row, strict=True)), formulas, last) for row in points.tolist()])


def _cells_at(values: dict[str, float], formulas: dict[str, Any], last: dict[str, Any]) -> list[float]:
    """Cells of outputs for values of the input cells."""
    known: dict[str, Any] = {**CELL_FUNCTIONS, **values, "__builtins__": {}}
    known["CELLS"] = lambda first, last: [known[f"B{k}"] for k in range(first, last + 1)]
    for name, formula in formulas.items():
        known[name] = eval(formula, known)  # our own text, a moment old
    return [float(eval(formula, known)) for formula in last.values()]


def run_latex(program: Program, text: str, points: Points) -> Outputs:
    """Outputs of a page of mathematics, read back."""
    return latex_reader.evaluate(text, points)


RUN: dict[str, Callable[[Program, str, Points], Outputs | None]] = {
    "latex": run_latex, "python": run_python, "c": run_c, "csv": run_csv,
}  # fmt: skip
"""Kind of text -> what computes its outputs."""
