"""Whether a written text says what the model does: it is run, and compared with the model."""

import ctypes
import math
import re
import shutil
import subprocess
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.frames import body_to_earth
from manoeuvre_nn.formulas import latex_reader
from manoeuvre_nn.formulas.onnx_graph import INSTALL, tables
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
Columns = Mapping[str, Float[np.ndarray, " n"]]
"""Name of an input -> its values."""
Run = Callable[[Columns], dict[str, np.ndarray]]
"""Inputs to outputs by their names; of a ship x, y, psi may be given though the program does not take them."""
CELL_FUNCTIONS: dict[str, Any] = {
    "TANH": math.tanh, "COS": math.cos, "SIN": math.sin, "EXP": math.exp, "LN": math.log, "ABS": abs, "MAX": max,
    "ATAN2": lambda x, y: math.atan2(y, x), "MIN": min, "SQRT": math.sqrt, "POWER": pow,
    "MEDIAN": lambda *values: median(values),
}  # fmt: skip
"""What functions of a spreadsheet do."""


def sample(program: Program, count: int = POINTS) -> Float[np.ndarray, "n inputs"]:
    """Random points over the ranges of a program's inputs; one whose ends are equal varies a little all the same."""
    low, high = (np.array([getattr(q, end) for q in program.inputs]) for end in ("low", "high"))
    low, high = low - np.where(low < high, 0.0, LITTLE), high + np.where(low < high, 0.0, LITTLE)
    return low + (high - low) * np.random.default_rng(0).random((count, len(low)))


def largest_difference(program: Program, kind: str, content: str | bytes) -> float | None:
    """Compare what was written with the model, point by point.

    Args:
        program: What was written.
        kind: ``python``, ``c``, ``csv``, ``latex`` or ``onnx``.
        content: The text or the bytes.

    Returns:
        Largest difference over the largest size of the output [-]; None for C where there is no compiler.
    """
    run = LOADERS[kind](program, content)
    if run is None:
        return None
    points = sample(program)
    columns = dict(zip([q.name for q in program.inputs], points.T, strict=True))
    expected, found = program.reference(points), run(columns)
    sizes = np.maximum(np.abs(expected).max(axis=0), np.finfo(float).tiny)
    apart = np.abs(np.stack([found[q.name] for q in program.outputs], axis=1) - expected).max(axis=0) / sizes
    return float(apart.max())


def load_python(program: Program, text: str) -> Run:
    """What a written module computes."""
    module: dict[str, Any] = {}
    exec(compile(text, program.name, "exec"), module)  # our own text, a moment old
    function = module[program.name]

    def at(row: Sequence[float]) -> Any:
        try:
            return np.atleast_1d(function(*row))
        except OverflowError:  # which other languages call infinite
            return [math.inf] * len(program.outputs)

    return _by_rows(program, at)


def load_c(program: Program, text: str) -> Run | None:
    """What a written file of C computes; None without a compiler."""
    with TemporaryDirectory() as folder:
        library = compiled({"model.c": text}, "model.c", Path(folder), "-O1")
        if library is None:
            return None
        function = getattr(ctypes.CDLL(str(library)), program.name)
    count = len(program.outputs)
    out = (ctypes.c_double * count)()
    function.restype = ctypes.c_double if count == 1 else None
    function.argtypes = [ctypes.c_double] * len(program.inputs) + ([] if count == 1 else [type(out)])
    if count == 1:
        return _by_rows(program, lambda row: [function(*row)])

    def filled(row: Sequence[float]) -> list[float]:
        function(*row, out)
        return list(out)

    return _by_rows(program, filled)


def compiled(sources: Mapping[str, str], main: str, folder: Path, *options: str) -> Path | None:
    """Compile C to a shared library.

    Args:
        sources: Name of a file -> its text.
        main: The file that is compiled; it includes the others.
        folder: Where to.
        *options: Of the compiler.

    Returns:
        The library; None without a compiler. One that fails, as where there is no room, is a ``CalledProcessError``.
    """
    compiler = next((c for c in COMPILERS if shutil.which(c)), None)
    if compiler is None:
        return None
    for name, text in sources.items():
        (folder / name).write_text(text, encoding="utf-8")
    library = folder / f"{Path(main).stem}.so"
    words = [compiler, "-std=c99", "-fPIC", "-shared", *options, str(folder / main), "-o", str(library), "-lm"]
    subprocess.run(words, check=True, capture_output=True)
    return library


def load_csv(program: Program, text: str) -> Run:
    """What a spreadsheet computes, its cells from top to bottom."""
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
    return _by_rows(program, lambda row: _cells_at(dict(zip(inputs, row, strict=True)), formulas, last))


def _cells_at(values: dict[str, float], formulas: dict[str, Any], last: dict[str, Any]) -> list[float]:
    """Cells of outputs for values of the input cells."""
    known: dict[str, Any] = {**CELL_FUNCTIONS, **values, "__builtins__": {}}
    known["CELLS"] = lambda first, last: [known[f"B{k}"] for k in range(first, last + 1)]
    for name, formula in formulas.items():
        known[name] = eval(formula, known)  # our own text, a moment old
    return [float(eval(formula, known)) for formula in last.values()]


def load_latex(program: Program, text: str) -> Run:
    """What a page of mathematics says, read back."""
    names = [q.name for q in program.inputs]
    return lambda columns: _named(program, latex_reader.evaluate(text, np.stack([columns[n] for n in names], axis=1)))


def load_onnx(program: Program, content: bytes) -> Run:
    """What a graph computes, by onnxruntime.

    Args:
        program: What was written.
        content: The file.

    Returns:
        The program's outputs; of a ship the water's velocity too, by the graph's kinematics.

    Raises:
        InputError: If onnxruntime is not installed.
    """
    try:
        import onnxruntime
    except ImportError as error:
        raise InputError(f"format=onnx needs the packages onnx and onnxruntime: {INSTALL}") from error
    settings = onnxruntime.SessionOptions()
    settings.intra_op_num_threads = settings.inter_op_num_threads = 1
    session, taken = onnxruntime.InferenceSession(content, settings), tables(program)

    def run(columns: Columns) -> dict[str, np.ndarray]:
        zero = np.zeros(len(next(iter(columns.values()))))
        feed = {t: np.stack([columns.get(q.name, zero) for q in qs], axis=1) for t, qs in taken.items()}
        (found,) = session.run(None, feed)
        if not program.gives_rates:
            return _named(program, found)
        rates = {f"{q.name}dot": found[:, k] for k, q in enumerate(taken["state"])}
        north, east = body_to_earth(columns["u"], columns["v"], columns.get("psi", zero))
        return {**rates, "c_N": rates["xdot"] - north, "c_E": rates["ydot"] - east}

    return run


def _by_rows(program: Program, function: Callable[[Sequence[float]], Any]) -> Run:
    """A function of one point, for many."""
    names = [q.name for q in program.inputs]

    def run(columns: Columns) -> dict[str, np.ndarray]:
        rows = np.stack([columns[name] for name in names], axis=1).tolist()
        return _named(program, np.array([function(row) for row in rows]))

    return run


def _named(program: Program, table: Float[np.ndarray, "n outputs"]) -> dict[str, np.ndarray]:
    """Columns of outputs by their names."""
    return dict(zip([q.name for q in program.outputs], table.T, strict=True))


LOADERS: dict[str, Callable[[Program, Any], Run | None]] = {
    "latex": load_latex, "python": load_python, "c": load_c, "csv": load_csv, "onnx": load_onnx,
}  # fmt: skip
"""Format -> what makes of the written thing a function again."""
