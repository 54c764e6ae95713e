"""Mappings as files: yaml is data and names no code."""

from collections.abc import Mapping as AnyMapping
from pathlib import Path
from typing import Any

from manoeuvre_nn.core.channels import DECLARED
from manoeuvre_nn.core.data_files import CONF, check_plain, load_yaml, without_format
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.recording.read.captive import CaptiveMapping, captive_mapping
from manoeuvre_nn.recording.read.mapping import REQUIRED, ChannelMap, Mapping, mapping
from manoeuvre_nn.recording.read.table import headings_of

SI_DEGREES, CONCEALED = "si_degrees", "concealed"
"""Mappings of the csv that a diagnosis reads where none is given, and of concealed cases."""
WRITTEN = Mapping(
    ChannelMap("t [s]", "s"),
    {c.name: ChannelMap(f"{c.name} [{c.unit}]", c.unit) for c in DECLARED if c.name != "t"},
    optional=True,
)
"""How :meth:`~manoeuvre_nn.core.recording.Recording.to_csv` writes."""


def read_mapping(name: str | Path, own: str | Path | None = None) -> Mapping:
    """Read a mapping of a record over time: a yaml, by its path or its name in conf/recording or ``own``/recording."""
    content = _content("mapping", name, own)
    if not isinstance(content, AnyMapping) or "channels" not in content:
        raise InputError(f"mapping={name} is no mapping of a record over time: write time: and channels: into it")
    return mapping(**_without_code(content, f"mapping={name}", "manoeuvre_nn.recording.mapping.mapping"))


def read_captive_mapping(name: str | Path | None, own: str | Path | None = None) -> CaptiveMapping:
    """Read a mapping of a table of captive tests, found as in :func:`read_mapping`."""
    if name is None:
        raise InputError("captive.mapping is not given: write the path of a yaml, or a name in conf/recording/")
    content = _content("captive.mapping", name, own)
    if not isinstance(content, AnyMapping) or "columns" not in content:
        raise InputError(f"captive.mapping={name} is no mapping of captive tests: write columns: into it")
    old = "manoeuvre_nn.recording.captive.captive_mapping"
    return captive_mapping(**_without_code(content, f"captive.mapping={name}", old))


def _content(setting: str, name: str | Path, own: str | Path | None) -> Any:
    """What a yaml holds that a setting gives by its name or its path."""
    if not isinstance(name, str | Path):
        raise InputError(f"{setting}={name}: expected the path of a yaml, or a name in conf/recording/")
    folders = [CONF, *([Path(own)] if own else [])]
    named = [folder / "recording" / f"{name}.yaml" for folder in folders]
    try:
        return load_yaml(next((path for path in named if path.is_file()), Path(name)))
    except InputError as error:
        raise InputError(f"{setting}={name}: {error}") from error


def _without_code(content: AnyMapping[Any, Any], where: str, old: str) -> dict[str, Any]:
    """Settings of a file from outside; what names code is refused."""
    rest = without_format(content, where)
    settings = {str(key): value for key, value in rest.items() if (key, value) != ("_target_", old)}
    check_plain(settings, where)
    return settings


def is_written_by_package(path: Path) -> bool:
    """Tell by its headings, ``t [s]``, ``psi [rad]`` and ``delta [rad]``, a recording that this package wrote."""
    wanted = {WRITTEN.time.column, *(WRITTEN.channels[name].column for name in REQUIRED)}
    return wanted <= set(headings_of(path))


def mapping_of(path: Path) -> Mapping:
    """The mapping of a file that comes without one, refused unless this package wrote it."""
    if not is_written_by_package(path):
        raise InputError(
            f"{path.name} is no recording that this package wrote, and mapping is not given: write mapping=FILE.yaml; "
            f"manoeuvre import {path} proposes one"
        )
    return WRITTEN
