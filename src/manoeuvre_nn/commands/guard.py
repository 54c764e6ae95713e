"""One line and exit code 2 for what a person got wrong; a traceback only for what we did."""

import errno
import os
import re
import sys
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from pathlib import Path

import yaml
from hydra.errors import HydraException
from omegaconf.errors import OmegaConfBaseException

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.plain_text import harmless

WRONG_INPUT = 2
FAILED_JOBS = 1
OF_CONFIG = (HydraException, OmegaConfBaseException, yaml.YAMLError)
OF_FILES = (errno.ENOENT, errno.EACCES, errno.ENOTDIR, errno.EEXIST, errno.EROFS, errno.ENOSPC)
NO_GROUP = "Config group override must be a string"
"""How hydra complains of ``ship=null``, with a traceback."""
OF_EXTRAS = {"hydra/sweeper=optuna": "search", "hydra/launcher=submitit_local": "sweep"}
"""Option that an extra of the package brings -> the extra."""
command = "train"
"""The command that runs, for advice."""
failed_jobs: list[str] = []
"""Jobs of a sweep that failed; the sweep goes on and ends with exit code 1."""


@contextmanager
def one_line() -> Generator[None]:
    """Turn wrong input into one line and exit code 2; let faults of the program through."""
    try:
        yield
    except (*OF_CONFIG, ValueError, OSError) as error:
        message = explain(error)
        if message is None:
            raise
        print(f"error: {harmless(' '.join(message.split()))}", file=sys.stderr)
        raise SystemExit(WRONG_INPUT) from None


def _of_file(error: OSError) -> str | None:
    """What to do about a file or folder that cannot be read or written."""
    if error.filename is None or error.errno not in OF_FILES:
        return None
    path = str(error.filename)
    if os.path.isfile(path) and not os.access(path, os.R_OK):
        return f"cannot read {path}: {error.strerror}; ask its owner, or copy it"
    return f"cannot write {path}: {error.strerror}; choose another folder (hydra.run.dir=, or out=)"


def guarded(main: Callable[[], None]) -> None:
    """Run an entry point.

    Args:
        main: The function that ``hydra.main`` made.

    Raises:
        SystemExit: With code 2 after one line for wrong input, with code 1 if jobs of a sweep failed.
    """
    os.environ["HYDRA_FULL_ERROR"] = "1"  # hydra then raises instead of printing its own traceback
    with one_line():
        main()
    if failed_jobs:
        raise SystemExit(FAILED_JOBS)


def explain(error: BaseException) -> str | None:
    """The one line that a person needs.

    Args:
        error: What was raised.

    Returns:
        The line; None if the cause is a fault of the program.
    """
    chain = list(_causes(error))
    for cause in chain:
        if isinstance(cause, InputError):
            return str(cause)
    if isinstance(error, OSError) and not isinstance(error, OF_CONFIG):  # a config that hydra misses is both
        return _of_file(error)
    if NO_GROUP in str(error):
        given = [word for word in sys.argv[1:] if word.endswith("=null")]
        return f"{' '.join(given)}: a group cannot be empty: leave it out or choose an option"
    if not isinstance(error, OF_CONFIG) or any(not isinstance(c, (*OF_CONFIG, TypeError, ValueError)) for c in chain):
        return None
    return _one_line(str(error))


def _causes(error: BaseException | None) -> Iterator[BaseException]:
    while error is not None:
        yield error
        error = error.__cause__ or error.__context__


def _one_line(text: str) -> str:
    """Hydra's own messages, shortened: choices are kept, advice about stack traces is not."""
    missing = re.search(r"Could not find '([^']+)/([^'/]+)'", text)
    if missing and f"{missing[1]}={missing[2]}" in OF_EXTRAS:
        extra = OF_EXTRAS[f"{missing[1]}={missing[2]}"]
        return f"{missing[1]}={missing[2]} is not installed: pip install 'manoeuvre-nn[{extra}]'"
    if missing:
        options = re.findall(r"^\t(\w+)$", text, flags=re.MULTILINE)
        return f"{missing[1]}={missing[2]} is unknown; choose one of: {', '.join(options)}"
    missing = re.search(r"Could not load '([^']+)/([^'/]+)'", text)
    if missing:
        return f"{missing[1]}={missing[2]} is unknown; {program()} --help lists the choices"
    key = re.search(r"Could not override '([^']+)'", text) or re.search(r"Key '([^']+)' is not in struct", text)
    full = re.search(r"full_key: (\S+)", text)
    if key:
        return f"there is no setting {(full or key)[1]}; {program()} --cfg job lists them all"
    mandatory = re.search(r"Missing mandatory value: (\S+)", text)
    if mandatory:
        name = (full or mandatory)[1]
        return f"{name} must be given: write {name}=..."
    lines = [line.strip() for line in text.splitlines() if line.strip() and "HYDRA_FULL_ERROR" not in line]
    return " ".join(lines[:3])[:400]


def program() -> str:
    """What was typed, for advice: ``manoeuvre COMMAND``, or a script of the repository."""
    called = Path(sys.argv[0])
    if called.parent.name == "scripts":
        return f"python scripts/{called.name}"
    return f"python {called.name}" if called.name in {"train.py", "diagnose.py"} else f"manoeuvre {command}"
