"""A working tree whose commands are run, and what they wrote."""

import json
import os
import resource
import subprocess
import sysconfig
import time
import venv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from typing import Any

PACKAGE, SOURCE = "manoeuvre_nn", "src"
ROOMS = (SOURCE, "studies", "scripts", "benchmarks", "tests")


class YardstickError(Exception):
    """Wrong input, or a command that failed; told in one line."""


class NothingToMeasureError(YardstickError):
    """A step's data are not there."""


@dataclass(frozen=True)
class Result:
    """What a step found.

    Attributes:
        metrics: Name -> number; None stands for something that got lost: a run that left the physical range.
        details: What is behind them.
        errors: Standard errors of some metrics.
    """

    metrics: Mapping[str, float | None]
    details: Any = None
    errors: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Ran:
    """A command that ended.

    Attributes:
        out: Its folder.
        cpu_s: CPU time of it and its children, of all tries together [s].
        wall_s: The same by the clock [s].
        printed: What it printed.
        code: Exit code.
    """

    out: Path
    cpu_s: float
    wall_s: float
    printed: str
    code: int

    @property
    def last_line(self) -> str:
        """The last line that it printed."""
        return (self.printed.strip().splitlines() or ["nothing was printed"])[-1].strip()


class Tree:
    """A working tree whose commands are run.

    Attributes:
        root: Its root.
        runs: Where its commands write.
        shared: Folder of the data.
        ran: Commands of the present step.
    """

    def __init__(self, root: Path, runs: Path, shared: Path, peers: Path | None = None) -> None:
        """Make an interpreter for the tree.

        Args:
            root: Its root.
            runs: Where its commands write.
            shared: Folder of the data.
            peers: Folder with other packages to compare with.
        """
        self.root, self.runs, self.shared, self.ran = root, runs, shared, list[Ran]()
        self.source, self.python = root / SOURCE, runs / "python" / "bin" / "python"
        threads = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
        places = {"PYTHONPATH": str(self.source), "RECORDINGS": str(shared / "recordings")}
        self.environment = os.environ | threads | places
        self._make_interpreter([self.source, Path(sysconfig.get_path("purelib")), *([peers] if peers else [])])

    def _make_interpreter(self, places: Sequence[Path]) -> None:
        """An interpreter that has its packages from these places, also where a command clears the environment."""
        folder = self.runs / "python"
        venv.create(folder, symlinks=True)
        compiled = f"import sys; sys.pycache_prefix, sys.dont_write_bytecode = {str(self.runs / 'pycache')!r}, False"
        lines = "\n".join([compiled, *map(str, places)])  # a .pth file: lines that begin with import are run
        (next(folder.glob("lib/python*/site-packages")) / "yardstick.pth").write_text(f"{lines}\n")
        words = [str(self.python), "-c", f"import {PACKAGE}; print({PACKAGE}.__file__)"]
        found = subprocess.run(words, cwd=self.runs, env={}, capture_output=True, text=True, check=False)
        if not found.stdout.startswith(str(self.source)):
            raise YardstickError(f"root={self.root}: {PACKAGE} cannot be imported from {self.source}")

    def _script(self, name: str) -> str:
        """A script's path seen from the root; if it is not there, the one file of this name counts."""
        if (self.root / name).is_file():
            return name
        found = [path for path in python_files(self.root) if path.name == Path(name).name]
        if len(found) != 1:
            raise YardstickError(f"{len(found)} files in {self.root} are named {Path(name).name}, instead of one")
        return str(found[0].relative_to(self.root))

    def data(self, *parts: str) -> Path:
        """A folder of the shared data; a step without its data is left out.

        Args:
            parts: Its place.

        Returns:
            The folder.

        Raises:
            NothingToMeasureError: If it is not there.
        """
        folder = self.shared.joinpath(*parts)
        if not folder.is_dir():
            raise NothingToMeasureError(f"{folder} is not there: give shared=FOLDER")
        return folder

    def run(self, name: str, script: str, *words: str, may_fail: bool = False) -> Ran:
        """Run a command, unless it ended well before.

        Args:
            name: Of its folder; ``{out}`` in the words stands for that.
            script: The script, seen from the root.
            words: Its arguments.
            may_fail: Whether the step goes on if it fails.

        Returns:
            What came of it.

        Raises:
            YardstickError: If it fails.
        """
        out, log, record = self.runs / name, self.runs / f"{name}.log", self.runs / f"{name}.json"
        before = json.loads(record.read_text()) if record.is_file() else {"cpu_s": 0.0, "wall_s": 0.0, "code": None}
        if before["code"] != 0:
            out.parent.mkdir(parents=True, exist_ok=True)
            command = [str(self.python), self._script(script), *(word.replace("{out}", str(out)) for word in words)]
            before = self._timed(command, log, before)
            write(record, before | {"command": command})
        done = Ran(out, before["cpu_s"], before["wall_s"], log.read_text(errors="replace"), before["code"])
        self.ran.append(done)
        if done.code and not may_fail:
            raise YardstickError(f"{script} ended with code {done.code}: {done.last_line} (see {log})")
        return done

    def _timed(self, command: Sequence[str], log: Path, before: Mapping[str, Any]) -> dict[str, Any]:
        """Run a command; the times of earlier tries are added."""
        began, cpu = time.monotonic(), _children_seconds()
        with log.open("w") as told:
            code = subprocess.run(
                command, cwd=self.root, env=self.environment, stdout=told, stderr=subprocess.STDOUT, check=False
            ).returncode
        wall_s = before["wall_s"] + time.monotonic() - began
        return {"cpu_s": before["cpu_s"] + _children_seconds() - cpu, "wall_s": wall_s, "code": code}


def _children_seconds() -> float:
    """CPU time of all children that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def write(path: Path, content: Any) -> None:
    """Write JSON so that the file is whole at any time."""
    part = path.with_name(f"{path.name}.part")
    part.write_text(json.dumps(content, indent=1, default=float))
    part.replace(path)


def read(path: Path) -> Any:
    """Read JSON that must be there."""
    try:
        return json.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise YardstickError(f"{path} cannot be read: {error}") from error


def python_files(root: Path) -> list[Path]:
    """Python files of a tree, without those of the yardstick."""
    found = [*root.glob("*.py"), *(path for name in ROOMS for path in (root / name).rglob("*.py"))]
    return sorted(path for path in found if not path.name.startswith("yardstick"))


def finite(value: float | None) -> float | None:
    """A number as JSON has it: None if it is none or infinite."""
    return value if value is not None and isfinite(value) else None
