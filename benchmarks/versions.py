"""Install what each lock says into an environment of its own, and run the tests there.

    python benchmarks/versions.py [locks=py311-lowest,py313] [tests=tests/core] [update=true] [folder=FOLDER]

Needs uv (``pip install uv``) and the Pythons in PATH. Without ``locks`` it is all four, without ``tests`` all tests. A
lock is a file of constraints, ``locks/NAME.txt``; that of Python 3.11 is ``constraints.txt``, which CI installs.
``update=true`` first writes the named locks anew from pyproject.toml. ``folder`` keeps environments and what pytest
printed. The exit code is 1 if a test failed or an installation did.
"""

import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

ROOT = Path(__file__).parents[1]
OF_TORCH = ("cuda-", "nvidia-", "triton")
"""Packages that a CUDA build of torch pins itself and a CPU build does not have: no lock names them."""
COLUMNS = ("lock", "python", "torch", "passed", "failed", "skipped", "seconds")


@dataclass(frozen=True)
class Lock:
    """Versions to test with.

    Attributes:
        path: File of constraints.
        python: Version of Python.
        resolution: ``highest``, or ``lowest-direct``: of what pyproject.toml names the lowest release that it admits.
        extras: Extras whose packages it pins.
    """

    path: Path
    python: str
    resolution: str = "highest"
    extras: tuple[str, ...] = ("test",)


LOCKS = {
    "py311-lowest": Lock(ROOT / "locks" / "py311-lowest.txt", "3.11", "lowest-direct"),
    "py311": Lock(ROOT / "constraints.txt", "3.11", extras=("test", "rivals")),
    "py312": Lock(ROOT / "locks" / "py312.txt", "3.12"),
    "py313": Lock(ROOT / "locks" / "py313.txt", "3.13"),
}


def main(words: list[str]) -> int:
    """Test the locks that were asked for; the exit code."""
    settings = dict(word.partition("=")[::2] for word in words)
    names = settings["locks"].split(",") if "locks" in settings else list(LOCKS)
    if set(settings) - {"locks", "tests", "update", "folder"} or set(names) - set(LOCKS):
        print(f"error: write locks={','.join(LOCKS)} tests=tests/core update=true folder=FOLDER")
        return 2
    if settings.get("update") == "true":
        for name in names:
            _update(LOCKS[name])
    with tempfile.TemporaryDirectory(prefix="versions_") as scratch:
        folder = Path(settings.get("folder", scratch)).absolute()
        folder.mkdir(parents=True, exist_ok=True)
        rows = [_tested(name, folder, settings.get("tests", "tests")) for name in names]
    for row in [COLUMNS, *rows]:
        print("".join(f"{cell:>14}" for cell in row))
    return int(any(row[4] != 0 for row in rows))


def _update(lock: Lock) -> None:
    """Resolve pyproject.toml and write the file anew; its first line stays."""
    extras = [word for extra in lock.extras for word in ("--extra", extra)]
    command = ["uv", "pip", "compile", "--quiet", "pyproject.toml", *extras, "--python-version", lock.python]
    command += ["--resolution", lock.resolution, "--no-header", "--no-annotate"]
    found = subprocess.run(command, cwd=ROOT, check=True, text=True, stdout=subprocess.PIPE).stdout.splitlines()
    pinned = [line for line in found if not line.startswith(OF_TORCH)]
    first = lock.path.read_text().splitlines()[0]
    lock.path.write_text("\n".join([first, *pinned, ""]))


def _tested(name: str, folder: Path, tests: str) -> tuple[str | int, ...]:
    """A row of the table: install what a lock pins, and run the tests."""
    lock, place = LOCKS[name], folder / name
    report, python = folder / f"{name}.xml", place / "bin" / "python"
    report.unlink(missing_ok=True)
    make = ["uv", "venv", "--quiet", "--clear", "--no-python-downloads", "--python", lock.python, place]
    if subprocess.run(make, check=False).returncode:
        return name, lock.python, "-", "-", "no Python", "-", "-"
    install = ["uv", "pip", "install", "--quiet", "--python", python, "-c", lock.path, "-e", ".[test]"]
    if subprocess.run(install, cwd=ROOT, check=False).returncode:
        return name, lock.python, "-", "-", "not installed", "-", "-"
    asked = "import torch; print(torch.__version__)"
    torch = subprocess.run([python, "-c", asked], check=True, text=True, stdout=subprocess.PIPE).stdout.strip()
    with (folder / f"{name}.txt").open("w") as printed:
        words = [python, "-m", "pytest", "-q", "-p", "no:cacheprovider", f"--junitxml={report}", tests]
        subprocess.run(words, cwd=ROOT, env=_environment(place), stdout=printed, stderr=printed, check=False)
    return name, lock.python, torch, *_counts(report)


def _environment(place: Path) -> dict[str, str]:
    """The environment in which this tree is tested with what is installed in a folder."""
    path = f"{place / 'bin'}{os.pathsep}{os.environ['PATH']}"
    return os.environ | {"PATH": path, "PYTHONPATH": str(ROOT / "src"), "OMP_NUM_THREADS": "1"}


def _counts(report: Path) -> tuple[str | int, ...]:
    """How many tests passed, failed and were skipped, and the seconds; where pytest broke down nothing is counted."""
    if not report.exists():
        return "-", "broke down", "-", "-"
    suite = ElementTree.parse(report).getroot()[0]
    total, failures, errors, skipped = (int(suite.get(k, 0)) for k in ("tests", "failures", "errors", "skipped"))
    return total - failures - errors - skipped, failures + errors, skipped, round(float(suite.get("time", 0)))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
