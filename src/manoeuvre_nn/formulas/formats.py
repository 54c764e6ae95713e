"""Formats that a program is written in, and the text that is given away: checked against the model."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.core.writing import write_file
from manoeuvre_nn.formulas.check import MAX_DIFFERENCE, largest_difference
from manoeuvre_nn.formulas.code import c_text, python_text
from manoeuvre_nn.formulas.latex import latex_text
from manoeuvre_nn.formulas.program import Program
from manoeuvre_nn.formulas.spreadsheet import csv_text

WRITERS: dict[str, Callable[[Program], str]] = {
    "latex": latex_text, "python": python_text, "c": c_text, "csv": csv_text,
}  # fmt: skip
"""Format -> what writes it."""
SUFFIXES = {"latex": ".tex", "python": ".py", "c": ".c", "csv": ".csv"}
"""Format -> ending of its files."""


@dataclass(frozen=True)
class Written:
    """A text that was checked.

    Attributes:
        kind: Its format.
        text: The text.
        program: What it says.
        difference: Largest difference from the model over the largest output [-]; None where it could not be run.
    """

    kind: str
    text: str
    program: Program
    difference: float | None

    @property
    def file_name(self) -> str:
        """What its file is called."""
        return f"{self.program.name}{SUFFIXES[self.kind]}"

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
            if path.is_file() and path.read_bytes() == self.text.encode():
                return False
            raise InputError(f"{path} exists and holds something else: choose another out=, or remove it")
        write_file(path, self.text)
        return True


def write_down(program: Program, kind: str, *, document: bool = True) -> Written:
    """Write a program and compare the text with the model.

    Args:
        program: The program.
        kind: ``latex``, ``python``, ``c`` or ``csv``.
        document: Whether LaTeX is a document of its own.

    Returns:
        The text.

    Raises:
        RuntimeError: If the text says something else than the model does.
    """
    check_choice("format", kind, list(WRITERS))
    text = latex_text(program, document=document) if kind == "latex" else WRITERS[kind](program)
    difference = largest_difference(program, kind, text)
    if difference is not None and not difference <= MAX_DIFFERENCE:
        raise RuntimeError(f"the {kind} of {program.title} differs from the model by {difference:.3g} of its outputs")
    return Written(kind, text, program, difference)


def kind_of(path: Path) -> str:
    """The format that a file's ending stands for; others are refused."""
    kinds = {suffix: kind for kind, suffix in SUFFIXES.items()}
    check_choice("ending of a file to export to", path.suffix, list(kinds))
    return kinds[path.suffix]
