"""Data files that people write, and where those are that come with the package."""

from pathlib import Path
from typing import Any

import yaml

from manoeuvre_nn.core.errors import InputError

_PACKAGE = Path(__file__).resolve().parents[1]
CONF = _PACKAGE / "conf" if (_PACKAGE / "conf").is_dir() else _PACKAGE.parents[1] / "conf"
"""Folder of the settings: in a wheel it lies in the package, in the repository at the top."""


def load_yaml(path: Path) -> Any:
    """Read a yaml file that a person wrote.

    Args:
        path: The file.

    Returns:
        Its content as plain lists and dicts.

    Raises:
        InputError: If it is missing or is no yaml.
    """
    if not path.is_file():
        wrong = "is a folder" if path.is_dir() else "does not exist"
        raise InputError(f"{path} {wrong}: write the path of a yaml file, such as conf/recording/esso_osaka.yaml")
    try:
        return yaml.load(path.read_text(encoding="utf-8"), _OnlyOnce)  # noqa: S506 - a safe loader
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError) as error:
        line = getattr(getattr(error, "problem_mark", None), "line", None)
        where = "" if line is None else f", line {line + 1}"
        said = getattr(error, "problem", None) or str(error).splitlines()[0]
        raise InputError(f"{path}{where} is no valid yaml: {said}") from error


class _OnlyOnce(yaml.SafeLoader):
    """Plain lists and dicts, as yaml.safe_load makes them; a key that stands twice is refused."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """Make a dict of a node, and refuse a key that stands twice."""
        keys = [key.value for key, _ in node.value if isinstance(key, yaml.ScalarNode) and key.value != "<<"]
        twice = next((key for k, key in enumerate(keys) if key in keys[:k]), None)
        if twice is not None:
            raise yaml.constructor.ConstructorError(None, None, f"{twice} stands twice", node.start_mark)
        return super().construct_mapping(node, deep)
