"""Data files that people write or send, and where those are that come with the package.

A file is data: plain values, each of the kind that is expected. Nothing in it is run, and nothing that it names is
imported by reading it.
"""

import json
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import NoneType
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ValidationError

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.plain_text import harmless

_PACKAGE = Path(__file__).resolve().parents[1]
CONF = _PACKAGE / "conf" if (_PACKAGE / "conf").is_dir() else _PACKAGE.parents[1] / "conf"
"""Folder of the settings: in a wheel it lies in the package, in the repository at the top."""
OVERRIDES = ".hydra/overrides.yaml"
"""Where hydra writes, in a run's folder, what was typed."""
FORMAT = 1
"""Number of the form that files of the package's own have; a file says it as ``format: 1``."""
MAX_YAML, MAX_JSON = 300_000, 10_000_000
"""Largest files [bytes]: yaml is read at about 100 kB a second."""
MAX_VALUES = 300_000
"""Most values in a file, where a reference counts as what it refers to."""
MAX_BITS = 1023
"""Bits of a whole number: as a float it is finite, and it can be printed."""
PLAIN = (str, int, float, bool, NoneType)
"""Kinds of values that settings have."""
REFUSED = re.compile("[\x00-\x08\x0b-\x1f\x7f\ud800-\udfff]")
"""Characters that no text has. Others that a terminal would obey stand in headings of old programs: they are shown
harmlessly, see :mod:`~manoeuvre_nn.core.plain_text`."""
Schema = TypeVar("Schema", bound=BaseModel)


def load_yaml(path: Path) -> Any:
    """Read a yaml file that a person wrote.

    Args:
        path: The file.

    Returns:
        Its content as plain lists and dicts.

    Raises:
        InputError: If it is missing, no yaml, or more than settings: too large, or not of plain values.
    """
    text = _text(path, "yaml", "conf/recording/esso_osaka.yaml", MAX_YAML)
    try:
        content = yaml.load(text, _OnlyOnce)  # noqa: S506 - a safe loader
        _count(content, {})
    except Exception as error:  # a tag such as !!int before what is none ends in whatever its constructor meets
        line = getattr(getattr(error, "problem_mark", None), "line", None)
        where = "" if line is None else f", line {line + 1}"
        raise InputError(f"{path}{where} is no valid yaml: {_said(error)}") from error
    return content


def load_json(path: Path) -> Any:
    """Read a JSON file; the same is refused as by :func:`load_yaml`."""
    try:
        content = json.loads(_text(path, "JSON", "manifest.json", MAX_JSON))
        _count(content, {})
    except InputError:
        raise
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path} is no valid JSON: {_said(error)}") from error
    return content


def read_as(schema: type[Schema], content: Any, where: str) -> Schema:
    """Take what a file holds as what it should hold.

    Args:
        schema: What it should hold.
        content: What it holds.
        where: What to call the file in the message.

    Returns:
        The content, checked; what the schema does not know is left out.

    Raises:
        InputError: If a value is missing or of another kind.
    """
    try:
        return schema.model_validate(content)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False)[0]
        place = ".".join(map(str, first["loc"])) or "all of it"
        given = "" if first["type"] == "missing" else f" is {_short(first['input'])}"
        raise InputError(f"{where}: {place}{given}: {first['msg'][:1].lower()}{first['msg'][1:]}") from error


def check_plain(value: Any, where: str, allowed: Sequence[str] = ()) -> None:
    """Refuse settings that are more than numbers, words, and lists and tables of them.

    Args:
        value: The settings.
        where: What they are settings of, for the message.
        allowed: Keys beginning with _ that are checked elsewhere.

    Raises:
        InputError: If one names code, or refers to something else.
    """
    if isinstance(value, Mapping):
        for key, inner in value.items():
            if str(key).startswith("_") and key not in allowed:
                raise InputError(f"{where}: {key}: {inner} is refused; settings are plain values and name no code")
            check_plain(inner, f"{where}.{key}", allowed)
    elif isinstance(value, Sequence) and not isinstance(value, str | bytes):
        for inner in value:
            check_plain(inner, where, allowed)
    elif not isinstance(value, PLAIN) or (isinstance(value, str) and "${" in value):
        raise InputError(f"{where}={value}: expected a plain value: a number, a word, true, false or null")


def without_format(content: Mapping[Any, Any], where: str) -> dict[Any, Any]:
    """Take the number of the form out of what a file holds.

    Args:
        content: What it holds.
        where: What to call the file in the message.

    Returns:
        The rest; a file without a number is of the first form.

    Raises:
        InputError: If this version does not know that form.
    """
    rest = dict(content)
    form = rest.pop("format", FORMAT)
    if type(form) is not int or form != FORMAT:
        raise InputError(
            f"{where}: format is {_short(form)}, this version reads {FORMAT}: install the manoeuvre-nn that wrote it"
        )
    return rest


def _text(path: Path, kind: str, such: str, limit: int) -> str:
    """What a file of settings says."""
    if not path.is_file():
        wrong = "is a folder" if path.is_dir() else "is no file" if path.exists() else "does not exist"
        raise InputError(f"{path} {wrong}: write the path of a {kind} file, such as {such}")
    if path.stat().st_size > limit:
        raise InputError(f"{path} has {path.stat().st_size} bytes; a {kind} file of settings has {limit} at most")
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is no valid {kind}: {_said(error)}") from error
    except OSError as error:
        raise InputError(
            f"{path} cannot be read: {error.strerror}: write the path of a {kind} file, such as {such}"
        ) from error


def _said(error: Exception) -> str:
    """What is wrong, on a line."""
    said = getattr(error, "problem", None) or next(iter(str(error).splitlines()), "") or type(error).__name__
    return harmless(str(said))[:200]


def _short(value: Any) -> str:
    """The beginning of a value."""
    return harmless(" ".join(repr(value).split()))[:60]


def _count(value: Any, counted: dict[int, int | None]) -> int:
    """How many values there are if references count as what they refer to; refused are too many, and endless ones."""
    if isinstance(value, str) and REFUSED.search(value):
        raise ValueError(f"{_short(value)} holds a control character; write letters")
    if isinstance(value, set | bytes | tuple):  # of tags such as !!set
        raise ValueError(f"{_short(value)} is a {type(value).__name__}; write numbers, words, lists or tables")
    if isinstance(value, int) and value.bit_length() > MAX_BITS:
        raise ValueError("a whole number is larger than anything counts; write fewer digits")
    if not isinstance(value, dict | list):
        return 1
    if id(value) in counted:
        known = counted[id(value)]
        if known is None:
            raise ValueError("a value holds itself")
        return known
    counted[id(value)] = None
    parts = [part for entry in value.items() for part in entry] if isinstance(value, dict) else value
    count = 1 + sum(_count(part, counted) for part in parts)
    if count > MAX_VALUES:
        raise ValueError(f"more than {MAX_VALUES} values")
    counted[id(value)] = count
    return count


class _OnlyOnce(yaml.SafeLoader):
    """Plain lists and dicts, as yaml.safe_load makes them; a key that stands twice is refused."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """Make a dict of a node, and refuse a key that stands twice."""
        seen = Counter(key.value for key, _ in node.value if isinstance(key, yaml.ScalarNode) and key.value != "<<")
        twice = next((key for key, count in seen.items() if count > 1), None)
        if twice is not None:
            raise yaml.constructor.ConstructorError(None, None, f"{twice} stands twice", node.start_mark)
        return super().construct_mapping(node, deep)

    def flatten_mapping(self, node: yaml.MappingNode) -> None:
        """Put what ``<<`` refers to into a node, and refuse what multiplies itself so."""
        super().flatten_mapping(node)
        if len(node.value) > MAX_VALUES:
            raise yaml.constructor.ConstructorError(None, None, f"more than {MAX_VALUES} values", node.start_mark)


def overrides_of(path: Path) -> dict[str, Any]:
    """Settings that a job was given.

    Args:
        path: Hydra's list of them.

    Returns:
        Name -> number, or text; nothing where the file is damaged or missing.
    """
    try:
        lines = load_yaml(path)
    except (OSError, InputError):
        return {}
    pairs = [str(line).lstrip("+~").partition("=") for line in lines] if isinstance(lines, list) else []
    return {key: _value(value) for key, equals, value in pairs if equals}


def _value(value: str) -> Any:
    """A number where the text is one."""
    for kind in (int, float):
        try:
            return kind(value)
        except ValueError:
            continue
    return value
