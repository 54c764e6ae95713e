"""How the commands end: one line for whatever ends them early, hydra's complaints among it."""

import os
import re
import shlex
import sys
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from difflib import get_close_matches
from pathlib import Path
from types import MappingProxyType

import yaml
from hydra.errors import HydraException, OverrideParseException
from omegaconf import DictConfig
from omegaconf.errors import OmegaConfBaseException

from manoeuvre_nn.core import ending
from manoeuvre_nn.core.ending import DEFECT, causes, full_story, in_short
from manoeuvre_nn.core.writing import write_file

ERROR = "error.txt"
"""File that says why one of many jobs failed."""
OF_CONFIG = (HydraException, OmegaConfBaseException, yaml.YAMLError)
NO_GROUP = "Config group override must be a string"
"""How hydra complains of ``ship=null``, with a traceback."""
NO_OPTION = re.compile(r"[^.=]*=\W*(\d|true$|false$|\{)", re.IGNORECASE)
"""What is written for a group and is no name."""
OF_EXTRAS = {
    "hydra/sweeper=optuna": "search",
    **dict.fromkeys(("hydra/launcher=submitit_local", "hydra/launcher=submitit_slurm"), "sweep"),
    "hydra/launcher=ray": "ray",
}
"""Option that an extra of the package brings -> the extra."""
WRITTEN = {
    "recordings": "; the folder of measured files is data.folder=FOLDER",
    "mapping": "; how they are read is data.mapping=NAME or FILE.yaml",
    "files": "; those that are read of the folder are data.files=[FILE,...]",
    **dict.fromkeys(("data.folder", "data.mapping", "data.files"), "; it is there once data=recording is written"),
}
WRITTEN_IN_DIAGNOSE = {
    "data.folder": "; the folder of measured files is recordings=FOLDER",
    "data.mapping": "; how they are read is mapping=NAME or FILE.yaml",
    "data.files": "; those that are read of the folder are files=[FILE,...]",
}
"""Setting of other commands -> what is written for it where it does not exist; in ``diagnose`` besides."""
PLAIN = re.compile(r"[A-Za-z0-9_./-]*")
"""What hydra's grammar takes without quotes, where it is no number."""
NO_WORDS = {"", "null", "true", "false"}
"""What it takes for something else than a word."""
AMBIGUOUS = re.compile(r"Ambiguous value for argument '(.*)'$", re.MULTILINE)
"""How hydra complains of ``data.folder=a,b``."""
MIN_LIKENESS = 0.7
"""Likeness of two names, of 1, from which one may be meant for the other."""
MAX_ADVISED, QUOTES = 100, "'\""
"""Letters of a value up to which advice repeats it; what may stand around one."""
MAX_NESTED = 100
"""Brackets of a word that hydra's parser surely reads: each is several calls deep."""
command = "train"
"""The command that runs, for advice."""
until_the_end = ExitStack()
"""What is held until a command ends, however it ends: the lock of a sweep's folder."""
failed_jobs: list[str] = []
"""Jobs of a sweep that failed; the sweep goes on and ends with exit code 1."""


@contextmanager
def one_line() -> Generator[None]:
    """What :func:`manoeuvre_nn.core.ending.one_line` does, and hydra's complaints explained."""
    with ending.one_line(explain):
        yield


def guarded(main: Callable[[], None]) -> None:
    """Run an entry point.

    Args:
        main: The function that ``hydra.main`` made.

    Raises:
        SystemExit: As :func:`one_line` says, and with code 1 if jobs of a sweep failed.
    """
    failed_jobs.clear()  # of a command that ran before in this process
    os.environ["HYDRA_FULL_ERROR"] = "1"  # hydra then raises instead of printing its own traceback
    with one_line(), until_the_end:
        main()
    if failed_jobs:
        raise SystemExit(DEFECT)


def explain(error: BaseException) -> str | None:
    """The one line that a person needs.

    Args:
        error: What was raised.

    Returns:
        The line; None if the cause is a fault of the program.
    """
    known = ending.explain(error)
    if known is not None:
        return known
    if NO_GROUP in str(error):
        empty = [word for word in sys.argv[1:] if word.endswith("=null")]
        given, why = empty or [word for word in sys.argv[1:] if NO_OPTION.match(word)], "cannot be empty"
        return f"{' '.join(given)}: a group {why if empty else 'has names'}: leave it out or choose an option"
    if any(isinstance(cause, RecursionError) for cause in causes(error)):
        opened, word = max(((word.count("[") + word.count("{"), word) for word in sys.argv[1:]), default=(0, ""))
        if opened > MAX_NESTED:
            return f"{word[:60]}...: {opened} brackets are opened in it: no setting is nested so deep, write fewer"
    if not isinstance(error, OF_CONFIG):
        return None
    if isinstance(error, OverrideParseException):  # whatever its parser broke on
        return _unread(error.override)
    ambiguous = AMBIGUOUS.search(str(error))
    if ambiguous:
        return _several(ambiguous[1])
    ours = any(not isinstance(cause, (*OF_CONFIG, TypeError, ValueError)) for cause in causes(error))
    return None if ours else _one_line(str(error), _settings_beside(error))


def quoted(text: str) -> str:
    """A word as hydra's grammar takes it, whatever is in it."""
    return '"' + re.sub(r"(\\+)(?=\"|\Z)", r"\1\1", text).replace('"', '\\"') + '"'


def as_word(text: str) -> str:
    """A word as hydra's grammar takes it, with quotes where they are needed."""
    try:
        float(text)
    except ValueError:
        return text if PLAIN.fullmatch(text) and text.lower() not in NO_WORDS else quoted(text)
    return quoted(text)


def of_home(word: str, *, hydras: bool) -> str:
    """A word of a command line with the user's folder in place of ``~``, which some shells leave (``out=~/run``).

    Args:
        word: The word.
        hydras: Whether hydra reads it.

    Returns:
        The word; others as they are.
    """
    key, sign, value = word.partition("=")
    if not sign or not key or not (value == "~" or value.startswith("~/")):
        return word
    folder = os.path.expanduser(value)
    return f"{key}={as_word(folder) if hydras else folder}"


def _unread(word: str) -> str:
    """What to say of a word that hydra's grammar does not take."""
    key, sign, value = word.partition("=")
    told = f"Error parsing override {word[:MAX_ADVISED]!r}"
    if not sign or not key:
        return f"{told}: write setting=value"
    if value[:1] in {"[", "{"}:
        return f'{told}: write each name in it within double quotes: \'{key}=["...","..."]\''
    return f"{told}: a name with other than plain letters is quoted twice: write {_twice(key, value)}"


def _several(word: str) -> str:
    """What to say of a comma in a word where no sweep is asked for."""
    key, _, value = word.partition("=")
    listed = shlex.quote(f"{key}=[{value if len(value) <= MAX_ADVISED else '...'}]")
    one = _twice(key, value)
    return f"{word[:MAX_ADVISED]}: several values: write {listed} for a list, {one} for one name, or -m to try each"


def _twice(key: str, value: str) -> str:
    """A setting as it is typed: quoted for hydra, and for the shell."""
    text = value.strip(QUOTES)
    return shlex.quote(f"{key}={quoted(text if len(text) <= MAX_ADVISED else '...')}")


def _settings_beside(error: BaseException) -> dict[str, list[str]]:
    """Name of a setting that does not exist -> those that stand where it was looked for."""
    found = {}
    for cause in causes(error):
        node = getattr(cause, "parent_node", None)
        if isinstance(node, DictConfig):
            found[str(getattr(cause, "key", ""))] = [str(key) for key in node if not str(key).startswith("_")]
    return found


def write_error(error: BaseException, out: Path) -> str:
    """Write down why one of many jobs failed, in a folder of its own; the reason on a line."""
    line = explain(error) or in_short(error)
    write_file(out / ERROR, f"{line}\n\n{full_story(error)}")
    return line


def _one_line(text: str, beside: Mapping[str, Sequence[str]] = MappingProxyType({})) -> str:
    """Hydra's own messages, shortened: choices are kept, advice about stack traces is not; the nearest of settings."""
    missing = re.search(r"Could not (?:find|load) '([^']+)/([^'/]+)'", text)
    if missing and f"{missing[1]}={missing[2]}" in OF_EXTRAS:  # a ready config of ours that asks for it, too
        extra = OF_EXTRAS[f"{missing[1]}={missing[2]}"]
        return f"{missing[1]}={missing[2]} is not installed: pip install 'manoeuvre-nn[{extra}]'"
    missing = re.search(r"Could not find '([^']+)/([^'/]+)'", text)
    if missing:
        options = re.findall(r"^\t(\w+)$", text, flags=re.MULTILINE)
        return f"{missing[1]}={missing[2]} is unknown; choose one of: {', '.join(options)}"
    missing = re.search(r"Could not load '([^']+)/([^'/]+)'", text)
    if missing:
        return f"{missing[1]}={missing[2]} is unknown; {program()} --help lists the choices"
    key = re.search(r"Could not override '([^']+)'", text) or re.search(r"Key '([^']+)' is not in struct", text)
    full = re.search(r"full_key: (\S+)", text)
    if key:
        name = (full or key)[1]
        above, dot, own = name.rpartition(".")
        group, _, option = above.rpartition(".")
        known = beside.get(own, [])
        several = group in {"effect", "manoeuvre"} and not known
        near = [f": the nearest is {above}{dot}{k}" for k in get_close_matches(own, known, 1, MIN_LIKENESS)]
        written = {**WRITTEN, **(WRITTEN_IN_DIAGNOSE if command == "diagnose" else {})}
        instead = written.get(name, "".join(near))
        chosen = f"; those of {option} are there once '{group}=[{option}]' is written" if several else ""
        return f"there is no setting {name}{instead}; {program()} --cfg job lists them all{chosen}"
    mandatory = re.search(r"Missing mandatory value: (\S+)", text)
    if mandatory:
        name = (full or mandatory)[1]
        return f"{name} must be given: write {name}=..."
    lines = [line.strip() for line in text.splitlines() if line.strip() and "HYDRA_FULL_ERROR" not in line]
    told, given = " ".join(lines[:3])[:400], [word[:200] for word in sys.argv[1:] if "${" in word]
    return f"{' '.join(given)}: {told}" if given and "interpolation" in told.lower() else told


def program() -> str:
    """What was typed, for advice: ``manoeuvre COMMAND``, ``python -m``, or a script of the repository."""
    called = Path(sys.argv[0])
    if called.name == "__main__.py" and called.parent.name == "manoeuvre_nn":
        return f"python -m manoeuvre_nn {command}"
    if called.parent.name == "scripts":
        return f"python scripts/{called.name}"
    return f"python {called.name}" if called.name in {"train.py", "diagnose.py"} else f"manoeuvre {command}"
