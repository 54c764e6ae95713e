"""From a config to objects: the only place that calls ``hydra.utils.instantiate``."""

import inspect
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, get_args

import yaml
from hydra.utils import get_object, instantiate
from omegaconf import DictConfig, ListConfig, OmegaConf

from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.core.manoeuvre import Manoeuvre
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.core.units import KNOT

ALLOWED = ("manoeuvre_nn.",)
"""Where a ``_target_`` may come from: a config can name any function, so it must not."""
TARGET = "_target_"
RECORD_OVER_TIME = "manoeuvre_nn.recording.mapping.mapping"
"""What the mapping of a record is made by; those of captive tests are made by another."""


def register_resolvers() -> None:
    """Make ``${run_name:...}`` known to OmegaConf."""
    OmegaConf.register_new_resolver("run_name", _run_name, replace=True)


def _run_name(manoeuvre: Any, data: Any, effect: Any = None) -> str:
    """Manoeuvres and effects joined, or ``recordings``: what the output folder is called after."""
    if "files" in data:
        return "recordings"
    return "_".join([k for k in manoeuvre if k != "speed_kn"] + list(effect or {}))


def build(config: Any, **more: Any) -> Any:
    """Make the object that a piece of config describes.

    Args:
        config: Mapping with ``_target_``.
        more: Further arguments.

    Returns:
        The object. Nested containers arrive as plain lists and dicts.
        A ``_target_`` outside this package is refused, and so is an argument that is unknown or of the wrong kind.
    """
    plain = OmegaConf.to_container(config, resolve=True, throw_on_missing=True) if _is_config(config) else config
    for target in targets(plain):
        check_target(target)
    # Objects are given to a partial: handed to instantiate itself, dataclasses would arrive as dicts.
    made = instantiate(plain, _convert_="all", _partial_=True)
    check_arguments(made.func, {**made.keywords, **more})
    return made(**more)


def check_target(target: str) -> None:
    """Refuse an import path that leads out of the package, also by way of what its modules import.

    Args:
        target: Import path.

    Raises:
        InputError: If it does, or leads nowhere.
    """
    refused = InputError(f"{TARGET}: {target} is refused; a config may only name things in manoeuvre_nn")
    if not target.startswith(ALLOWED):
        raise refused
    try:
        found = get_object(target)
    except ImportError as error:
        raise InputError(f"{TARGET}: {target} does not exist") from error
    if not str(getattr(found, "__module__", "")).startswith(ALLOWED):
        raise refused


def check_arguments(function: Callable[..., Any], settings: Mapping[str, Any]) -> None:
    """Refuse settings that a function does not know, and words where it expects numbers.

    Args:
        function: What is to be called.
        settings: Its keyword arguments.

    Raises:
        InputError: If one is unknown, missing or of the wrong kind.
    """
    try:
        inspect.signature(function).bind(**settings)
    except TypeError as error:
        raise InputError(f"settings of {function.__name__}: {error}") from error
    known = inspect.signature(function).parameters
    others = next((p for p in known.values() if p.kind is p.VAR_KEYWORD), None)
    for name, value in settings.items():
        parameter = known.get(name, others)
        kinds = _kinds(parameter.annotation) if parameter else {object}
        if Sequence[float] in kinds:
            _check_numbers(name, value, NoneType in kinds)
        if not kinds <= {int, float, bool, NoneType}:
            continue
        accepted = tuple(kinds | {int}) if float in kinds else tuple(kinds)
        if not isinstance(value, accepted):
            wanted = "a number" if float in kinds else "a whole number" if int in kinds else "true or false"
            raise InputError(f"{name}={value}: expected {wanted}{' or null' if NoneType in kinds else ''}")


def _kinds(annotation: Any) -> set[Any]:
    """What an argument may be, one by one."""
    return set(get_args(annotation)) if isinstance(annotation, UnionType) else {annotation}


def _check_numbers(name: str, value: Any, optional: bool) -> None:
    """Refuse what is no list of numbers."""
    numbers = isinstance(value, Sequence) and all(isinstance(v, int | float) for v in value)
    if not numbers and not (optional and value is None):
        wanted = f"numbers in brackets such as {name}=[5,10,20]"
        raise InputError(f"{name}={value}: expected {wanted}{' or null' if optional else ''}")


def whole_number(what: str, value: Any, least: int) -> int:
    """Read a setting that counts something.

    Args:
        what: Its name.
        value: What was given.
        least: Smallest value.

    Returns:
        The number.

    Raises:
        InputError: If it is no whole number or too small.
    """
    if not isinstance(value, int) or value < least:
        raise InputError(f"{what}={value}: expected a whole number, {least} or more")
    return value


def switch(what: str, value: Any) -> bool:
    """Read a setting that is on or off.

    Args:
        what: Its name.
        value: What was given.

    Returns:
        Whether it is on.

    Raises:
        InputError: If it is neither true nor false.
    """
    if not isinstance(value, bool):
        raise InputError(f"{what}={value}: expected true or false")
    return value


def targets(plain: Any) -> Iterator[str]:
    """Every import path that a config would run.

    Args:
        plain: Nested lists and dicts.

    Yields:
        Import paths.
    """
    if isinstance(plain, Mapping):
        if TARGET in plain:
            yield str(plain[TARGET])
        for value in plain.values():
            yield from targets(value)
    elif isinstance(plain, Sequence) and not isinstance(plain, str):
        for value in plain:
            yield from targets(value)


def training_manoeuvres(config: DictConfig) -> list[Manoeuvre]:
    """The manoeuvres that were chosen with ``manoeuvre=``.

    Args:
        config: ``cfg.manoeuvre``: one entry a manoeuvre, and ``speed_kn``.

    Returns:
        Manoeuvres at the approach speed.
    """
    chosen = [v for v in config.values() if _is_config(v) and TARGET in v]
    return [build(v).at_speed(approach_speed(config)) for v in chosen]


def chosen_effects(config: DictConfig | None, ship: Ship) -> list[Effect]:
    """What was chosen with ``effect=``, acting on a ship.

    Args:
        config: ``cfg.effect``: one entry an effect; None if there is none.
        ship: The ship that they act on.

    Returns:
        Effects, in the order in which they were named.
    """
    return [build(settings, ship=ship) for settings in (config or {}).values()]


def with_effects(cfg: DictConfig) -> DictConfig:
    """Take the effects of ``effects=FILE``, as diagnose.py writes it, among those that were chosen with ``effect=``.

    Args:
        cfg: The config.

    Returns:
        The config with the file's entries in ``cfg.effect``.

    Raises:
        InputError: If the file holds anything else than entries of effects, or one that was chosen already.
    """
    if cfg.get("effects") is None:
        return cfg
    found, chosen = load_yaml(Path(cfg.effects)), cfg.get("effect") or {}
    entries = found.values() if isinstance(found, Mapping) else [None]
    if not all(isinstance(entry, Mapping) and TARGET in entry for entry in entries):
        raise InputError(
            f"effects={cfg.effects}: expected entries as in conf/effect, such as an effects.yaml of diagnose.py"
        )
    for name, entry in found.items():
        check_target(str(entry[TARGET]))
        made = get_object(str(entry[TARGET]))
        if not (inspect.isclass(made) and issubclass(made, Effect)):
            raise InputError(f"effects={cfg.effects}: {entry[TARGET]} is no effect")
        if name in chosen:
            raise InputError(f"{name} is both in effect= and in {cfg.effects}: leave one out")
    return OmegaConf.merge(OmegaConf.create(OmegaConf.to_container(cfg)), {"effect": dict(found)})  # type: ignore


def approach_speed(config: DictConfig) -> float | None:
    """``manoeuvre.speed_kn`` in m/s.

    Args:
        config: ``cfg.manoeuvre``.

    Returns:
        Speed [m/s], None for the ship's own.

    Raises:
        InputError: If it is not a positive number.
    """
    speed = config.get("speed_kn")
    if speed is None:
        return None
    if not isinstance(speed, int | float) or not speed > 0:
        raise InputError(f"manoeuvre.speed_kn={speed}: expected an approach speed in knots, more than 0")
    return speed * KNOT


def named_manoeuvres(names: Sequence[Any], folder: Path, speed: float | None) -> list[Manoeuvre]:
    """Manoeuvres by the names of their files in ``conf/manoeuvre``.

    Args:
        names: Names, or ``{name: {setting: value}}``.
        folder: ``conf/manoeuvre``.
        speed: Approach speed [m/s]; None is the ship's own.

    Returns:
        Manoeuvres. An unknown name is refused with a list of those that exist.

    Raises:
        InputError: If an entry is neither.
    """
    choices = sorted(p.stem for p in folder.glob("*.yaml"))
    made = []
    for entry in names:
        if isinstance(entry, Mapping) and [type(v) for v in entry.values()] != [dict]:
            raise InputError(f"score has an entry {entry}: write a name, or {{name: {{setting: value}}}}")
        name, settings = next(iter(entry.items())) if isinstance(entry, Mapping) else (entry, {})
        check_choice("manoeuvre in score", name, choices)
        described = OmegaConf.merge(OmegaConf.load(folder / f"{name}.yaml"), settings)
        made.append(build(described).at_speed(speed))
    return made


def as_list(value: Any) -> list[Any]:
    """``score=zz20`` and ``score=[zz20]`` alike.

    Args:
        value: A name or a list.

    Returns:
        Plain list.
    """
    if isinstance(value, ListConfig | list | tuple):
        return list(OmegaConf.to_container(value) if isinstance(value, ListConfig) else value)  # type: ignore
    return [value]


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
        """A dict.

        Args:
            node: What was written.
            deep: Whether all below is made at once.

        Returns:
            The dict.

        Raises:
            ConstructorError: If a key stands twice.
        """
        keys = [key.value for key, _ in node.value if isinstance(key, yaml.ScalarNode) and key.value != "<<"]
        twice = next((key for k, key in enumerate(keys) if key in keys[:k]), None)
        if twice is not None:
            raise yaml.constructor.ConstructorError(None, None, f"{twice} stands twice", node.start_mark)
        return super().construct_mapping(node, deep)


def load_mapping(name: str | None, folder: Path) -> Any:
    """Read how a kind of file is mapped.

    Args:
        name: Path of a yaml, or the name of one in the folder; None is refused with the names that there are.
        folder: ``conf/recording``.

    Returns:
        Its content.

    Raises:
        InputError: If it describes something else than a record over time.
    """
    if name is None:
        ready = ", ".join(sorted(p.stem for p in folder.glob("*.yaml") if RECORD_OVER_TIME in p.read_text()))
        raise InputError(f"data.mapping is not given: write the path of a yaml that maps columns, or one of: {ready}")
    named = folder / f"{name}.yaml"
    content = load_yaml(named if named.is_file() else Path(str(name)))
    if not isinstance(content, Mapping) or content.get(TARGET) != RECORD_OVER_TIME:
        raise InputError(
            f"mapping={name} is no mapping of a record over time: its first line must be {TARGET}: {RECORD_OVER_TIME}"
        )
    return content


def _is_config(value: Any) -> bool:
    return isinstance(value, DictConfig | ListConfig)
