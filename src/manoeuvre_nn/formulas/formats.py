"""Formats that a program is written in, and what is given away: checked against the model."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.writing import write_file
from manoeuvre_nn.dynamics.base import Model
from manoeuvre_nn.formulas.check import LOADERS, MAX_DIFFERENCE, largest_difference
from manoeuvre_nn.formulas.code import c_text, python_text
from manoeuvre_nn.formulas.conversions import ForceSamples, price, samples_of
from manoeuvre_nn.formulas.fmu import fmu_bytes, slug
from manoeuvre_nn.formulas.gazebo import GazeboShip, sdf_text
from manoeuvre_nn.formulas.latex import latex_text
from manoeuvre_nn.formulas.mss import mss_ship, mss_text
from manoeuvre_nn.formulas.onnx_graph import onnx_bytes
from manoeuvre_nn.formulas.program import Program
from manoeuvre_nn.formulas.recursive_step import ship_by_steps
from manoeuvre_nn.formulas.rollouts import TrackDeviation, WrittenModel, deviations_of, of_unit, sailed
from manoeuvre_nn.formulas.spreadsheet import csv_text

WRITERS: dict[str, Callable[[Program], str | bytes]] = {
    "latex": latex_text, "python": python_text, "c": c_text, "csv": csv_text, "onnx": onnx_bytes, "fmu": fmu_bytes,
}  # fmt: skip
"""Format that says what the model does -> what writes it."""
FORMATS = (*WRITERS, "gazebo", "mss")
SUFFIXES = {
    "latex": ".tex", "python": ".py", "c": ".c", "csv": ".csv", "onnx": ".onnx", "fmu": ".fmu", "gazebo": ".sdf",
    "mss": ".m",
}  # fmt: skip
"""Format -> ending of its files."""
Converter = Callable[[Program, ForceSamples, Sequence[str]], str]
CONVERSIONS: dict[str, tuple[Converter, Callable[[Program, str], Model]]] = {
    "gazebo": (sdf_text, GazeboShip), "mss": (mss_text, mss_ship),
}  # fmt: skip
"""Format that holds other coefficients than the model's -> what writes it, and what reads it back as a ship."""
BY_SHIP = ("onnx", "fmu", *CONVERSIONS)
"""Formats of a whole ship: their files are called after her."""
SLOW = ("latex", "csv")
"""Formats that are read back too slowly to sail by: they are checked point by point alone."""
MAX_TRACK_DEVIATION = 1e-6
"""Largest distance between the tracks of a unit of co-simulation and of the model, over L [-]."""


@dataclass(frozen=True)
class Written:
    """What was written, and how well.

    Attributes:
        kind: Its format.
        content: The text, or the bytes.
        program: What it says.
        difference: Largest difference from the model over the largest output, point by point [-]; None where it was not
            run point by point.
        deviations: How far its tracks are from the model's; none where it was not sailed.
    """

    kind: str
    content: str | bytes
    program: Program
    difference: float | None
    deviations: list[TrackDeviation] = field(default_factory=list)

    @property
    def file_name(self) -> str:
        """What its file is called."""
        ship = self.kind in BY_SHIP and self.program.vessel is not None
        return f"{slug(self.program) if ship else self.program.name}{SUFFIXES[self.kind]}"

    @property
    def bytes(self) -> bytes:
        """What its file holds."""
        return self.content.encode() if isinstance(self.content, str) else self.content

    def save(self, path: Path) -> bool:
        """Write the file, unless it is there already.

        Args:
            path: Where to.

        Returns:
            Whether it was written.

        Raises:
            InputError: If a file of another content is there.
        """
        if path.exists():
            if path.is_file() and path.read_bytes() == self.bytes:
                return False
            raise InputError(f"{path} exists and holds something else: choose another out=, or remove it")
        write_file(path, self.content)
        return True


def write_down(
    program: Program, kind: str, *, document: bool = True, runs: Sequence[Recording] | None = None
) -> Written:
    """Write a program and compare what was written with the model.

    Args:
        program: The program.
        kind: One of ``FORMATS``.
        document: Whether LaTeX is a document of its own.
        runs: The model's runs of :func:`.sailed`; with them a ship by what was written sails the same. What is not
            compared point by point sails them in any case.

    Returns:
        What was written; if it says something else than the model does, that is a RuntimeError.
    """
    check_choice("format", kind, list(FORMATS))
    if kind in CONVERSIONS:
        return _converted(program, kind, runs)
    content = latex_text(program, document=document) if kind == "latex" else WRITERS[kind](program)
    if kind == "fmu":
        assert isinstance(content, bytes)
        return _checked(Written(kind, content, program, None, of_unit(program, content)))
    difference, deviations = largest_difference(program, kind, content), []
    if difference is not None and runs and kind not in SLOW:
        run = LOADERS[kind](program, content)
        assert run is not None
        written = WrittenModel(program, run) if program.gives_rates else ship_by_steps(program, run)
        deviations = deviations_of(program, written, runs)
    return _checked(Written(kind, content, program, difference, deviations))


def _checked(written: Written) -> Written:
    """Refuse what says something else than the model does."""
    title, difference = f"the {written.kind} of {written.program.title}", written.difference
    if difference is not None and not difference <= MAX_DIFFERENCE:
        raise RuntimeError(f"{title} differs from the model by {difference:.3g} of its outputs")
    for one in written.deviations:
        if not one.largest <= MAX_TRACK_DEVIATION:
            raise RuntimeError(f"{title} sails {one.manoeuvre} {one.largest:.3g} L beside the model")
    return written


def _converted(program: Program, kind: str, runs: Sequence[Recording] | None) -> Written:
    """Coefficients of another form, with what the conversion costs in the header."""
    write, read = CONVERSIONS[kind]
    samples = samples_of(program, kind)
    deviations = deviations_of(program, read(program, write(program, samples, ())), runs or sailed(program))
    return Written(kind, write(program, samples, price(deviations)), program, None, deviations)


def kind_of(path: Path) -> str:
    """The format that a file's ending stands for; others are refused."""
    kinds = {suffix: kind for kind, suffix in SUFFIXES.items()}
    check_choice("ending of a file to export to", path.suffix, list(kinds))
    return kinds[path.suffix]
