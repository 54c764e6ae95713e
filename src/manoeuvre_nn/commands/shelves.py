"""From a config to objects: a ``_target_`` may only name what stands on the shelf of its group."""

import importlib
import inspect
import pkgutil
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import fields, is_dataclass, replace
from types import NoneType, UnionType
from typing import Any, Literal, NamedTuple, Union, get_args, get_origin

from omegaconf import DictConfig, ListConfig, OmegaConf

from manoeuvre_nn.commands.groups import option, options, own_modules
from manoeuvre_nn.core.data_files import PLAIN, check_plain
from manoeuvre_nn.core.errors import InputError

TARGET = "_target_"


class _Shelf(NamedTuple):
    """Packages and modules that define the things of a group, and the classes (import paths) that these are of."""

    places: tuple[str, ...]
    kinds: tuple[str, ...]


SHELVES = {
    "ship": _Shelf(
        ("manoeuvre_nn.ship",), ("manoeuvre_nn.core.ship.Ship", "manoeuvre_nn.core.particulars.Particulars")
    ),
    "linear": _Shelf(
        ("manoeuvre_nn.ship.known", "manoeuvre_nn.estimation.baselines"), ("manoeuvre_nn.core.ship.Ship",)
    ),
    "network": _Shelf(("manoeuvre_nn.network",), ("manoeuvre_nn.core.network.Network",)),
    "effect": _Shelf(("manoeuvre_nn.effect",), ("manoeuvre_nn.core.effect.Effect",)),
    "manoeuvre": _Shelf(("manoeuvre_nn.manoeuvre",), ("manoeuvre_nn.core.manoeuvre.Manoeuvre",)),
    "fit": _Shelf(("manoeuvre_nn.training",), ("manoeuvre_nn.training.fits.Fit",)),
    "data": _Shelf(
        ("manoeuvre_nn.training.data", "manoeuvre_nn.training.response_data"),
        ("manoeuvre_nn.training.data.ManoeuvreData", "manoeuvre_nn.training.response_data.ResponseData"),
    ),
    "logger": _Shelf(("manoeuvre_nn.training.loggers",), ("manoeuvre_nn.training.loggers.LogTo",)),
}
"""Group of conf -> its shelf."""
MAX_WHOLE = 2**63 - 1
"""Largest whole number that a tensor holds."""
SEVERAL = ("manoeuvre", "effect", "logger")
"""Groups of which several are chosen at once, each under its name."""


def build(config: Any, group: str, **more: Any) -> Any:
    """Make the object that a piece of config describes.

    Args:
        config: Mapping with ``_target_`` and settings. Flat settings are gathered into an argument that is a dataclass.
        group: Group of conf that it belongs to.
        more: Further arguments.

    Returns:
        The object.

    Raises:
        InputError: If it is not on the group's shelf, or an argument is unknown or of the wrong kind.
    """
    described = plain(config)
    made = on_shelf(str(described.get(TARGET)), group)
    settings = {name: value for name, value in described.items() if name != TARGET}
    check_plain(settings, group)
    for name in settings.keys() & more.keys():
        raise InputError(f"{group}: {name}={settings[name]} is no setting of {made.__name__}: leave {name} out")
    settings = gathered(made, {**settings, **more})
    check_arguments(made, settings)
    return made(**settings)


def plain(config: Any) -> dict[str, Any]:
    """A piece of config as plain dicts and lists, interpolations resolved; what is no mapping is refused."""
    if isinstance(config, DictConfig | ListConfig):
        config = OmegaConf.to_container(config, resolve=True, throw_on_missing=True)
    if not isinstance(config, Mapping):
        raise InputError(f"{config!r}: expected settings, as in the files of conf")
    return {str(key): value for key, value in config.items()}


def on_shelf(target: str, group: str) -> Callable[..., Any]:
    """Find what a ``_target_`` names; nothing outside the shelf is imported.

    Args:
        target: Import path.
        group: Group of conf.

    Returns:
        A class, or a function that says that it returns one of the shelf's kinds.

    Raises:
        InputError: If it is not defined on that shelf.
        ModuleNotFoundError: If its module imports one that is not installed.
    """
    shelf, (module, _, name) = SHELVES[group], target.rpartition(".")
    places = " or ".join(shelf.places)
    foreign = module.partition(".")[0] in {"manoeuvre_nn", *own_modules, *sys.stdlib_module_names}
    own = "" if foreign else f"; if {module} is a module of your own that you trust, add plugins=[{module}]"
    refused = InputError(f"{TARGET}: {target} is refused; a config may only name things in {places} for {group}{own}")
    here = module in own_modules or any(f"{module}.".startswith(f"{place}.") for place in shelf.places)
    if not here or name.startswith("_"):
        raise refused
    try:
        found = getattr(importlib.import_module(module), name)
    except ModuleNotFoundError as error:
        if error.name is None or not module.startswith(error.name):
            raise  # the module is there, but what it imports is not
        parent = error.name.rpartition(".")[0]
        is_module = not hasattr(importlib.import_module(parent), "__path__") if parent else False
        raise refused if is_module else InputError(f"{TARGET}: {target} does not exist") from error
    except AttributeError as error:
        raise InputError(f"{TARGET}: {target} does not exist") from error
    if getattr(found, "__module__", None) != module or not _makes(found, shelf):
        raise refused
    return found


def without_targets(config: Mapping[str, Any]) -> dict[str, Any]:
    """A config without the ``_target_`` of each group, where one may stand; any other is left where it is."""
    kept: dict[str, Any] = {}
    for name, settings in config.items():
        if name in SEVERAL and isinstance(settings, Mapping):
            kept[name] = {key: _without_target(entry) for key, entry in settings.items()}
        else:
            kept[name] = _without_target(settings) if name in SHELVES else settings
    return kept


def _without_target(settings: Any) -> Any:
    """Settings of one thing."""
    return {k: v for k, v in settings.items() if k != TARGET} if isinstance(settings, Mapping) else settings


def made_by(config: Any, group: str) -> Any:
    """The class of what a piece of config describes, without making it; None if its function does not say."""
    made = on_shelf(str(config[TARGET]), group)
    return made if inspect.isclass(made) else inspect.get_annotations(made, eval_str=True).get("return")


def kinds(group: str, own: str | None = None) -> dict[str, Any]:
    """Options of a group -> the class that each describes; those that do not say, or may not be named, are left out."""
    found = {}
    for name in options(group, own):
        with suppress(InputError, ModuleNotFoundError):
            found[name] = made_by(option(group, name, own), group)
    return {name: kind for name, kind in found.items() if kind is not None}


def _makes(found: Any, shelf: _Shelf) -> bool:
    """Whether it is a final class of the shelf's kinds, or a function that returns one."""
    kinds = tuple(map(pkgutil.resolve_name, shelf.kinds))
    if inspect.isclass(found):
        return issubclass(found, kinds) and not inspect.isabstract(found)
    if not inspect.isfunction(found):
        return False
    returned = inspect.get_annotations(found, eval_str=True).get("return")
    if returned is None and found.__module__ in own_modules:
        return True  # the user's own need not say what it returns
    answers = get_args(returned) or (returned,)
    return all(inspect.isclass(answer) and issubclass(answer, kinds) for answer in answers)


def gathered(function: Callable[..., Any], settings: Mapping[str, Any]) -> dict[str, Any]:
    """Put settings into the dataclasses that a function takes.

    Args:
        function: What is to be called.
        settings: Settings, those of a dataclass either flat or as a mapping under the argument's name; what is not
            given is as in the argument's default.

    Returns:
        Its arguments.
    """
    left = dict(settings)
    for name, parameter in inspect.signature(function).parameters.items():
        kind = next((k for k in _kinds(parameter.annotation) if inspect.isclass(k) and is_dataclass(k)), None)
        if kind is None or (name in left and not isinstance(left[name], Mapping)):
            continue
        of_kind = {f.name for f in fields(kind)}
        if isinstance(left.get(name), Mapping):
            given = dict(left[name])
        elif name == "settings":
            strange = () if _takes_others(function) else left.keys() - inspect.signature(function).parameters.keys()
            given = {key: left.pop(key) for key in list(left) if key in {*of_kind, *strange}}
        else:
            continue
        check_arguments(kind, given)
        usual = parameter.default
        left[name] = replace(usual, **given) if isinstance(usual, kind) else kind(**given)
    return left


def check_arguments(function: Callable[..., Any], settings: Mapping[str, Any]) -> None:
    """Refuse settings (keyword arguments) that a function does not know, that it lacks, or that are of the wrong kind.

    Args:
        function: What is to be called.
        settings: Its keyword arguments.

    Raises:
        InputError: If one is refused.
    """
    known = inspect.signature(function).parameters
    variable = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    needed = [name for name, p in known.items() if p.default is p.empty and p.kind not in variable]
    lacking, strange = [n for n in needed if n not in settings], [n for n in settings if n not in known]
    if lacking:
        instead = f", in the place of {strange[0]}" if strange else ""
        raise InputError(f"settings of {function.__name__}: {lacking[0]} is missing: write it in the yaml{instead}")
    if strange and not _takes_others(function):
        possible = [name for name in known if isinstance(settings.get(name), (*PLAIN, Sequence, Mapping))]
        choose = f"it has {', '.join(possible)}" if possible else "leave it out"
        raise InputError(f"settings of {function.__name__}: {strange[0]} is unknown; {choose}")
    others = next((p for p in known.values() if p.kind is p.VAR_KEYWORD), None)
    for name, value in settings.items():
        parameter = known.get(name, others)
        if isinstance(value, int) and abs(value) > MAX_WHOLE:  # written with a point, it is a number like others
            raise InputError(f"{name}={str(value)[:40]}: expected a number of at most {MAX_WHOLE:.1e}")
        if parameter and not _fits(value, parameter.annotation):
            raise InputError(f"{name}={value}: expected {_in_words(name, parameter.annotation)}")


def _takes_others(function: Callable[..., Any]) -> bool:
    """Whether a function takes settings whatever their names."""
    return any(p.kind is p.VAR_KEYWORD for p in inspect.signature(function).parameters.values())


def _kinds(annotation: Any) -> set[Any]:
    """What an argument may be, one by one."""
    return set(get_args(annotation)) if get_origin(annotation) in {UnionType, Union} else {annotation}


def _fits(value: Any, annotation: Any) -> bool:
    """Whether a plain value is of the kind that an argument has; what a config cannot give is the caller's matter."""
    if len(kinds := _kinds(annotation)) > 1:
        return any(_fits(value, kind) for kind in kinds)
    origin, inner = get_origin(annotation), get_args(annotation)
    if origin in {list, tuple, Sequence}:
        of = inner[0] if inner else object
        return isinstance(value, Sequence) and not isinstance(value, str) and all(_fits(v, of) for v in value)
    if origin in {dict, Mapping}:
        return isinstance(value, Mapping) and all(_fits(v, inner[1]) for v in value.values())
    if annotation in {int, float}:
        accepted = int if annotation is int else (int, float)
        return isinstance(value, accepted) and not isinstance(value, bool) and value == value  # noqa: PLR0124  not NaN
    if origin is Literal or annotation is str:  # a path of the caller's is as good
        return isinstance(value, str) or not isinstance(value, (*PLAIN, Sequence, Mapping))
    return isinstance(value, annotation or NoneType) if annotation in {bool, None, NoneType} else True


def _in_words(name: str, annotation: Any) -> str:
    """What an argument may be, for a person."""
    words = []
    for kind in sorted(_kinds(annotation) - {NoneType}, key=str):
        if get_origin(kind) in {list, tuple, Sequence}:
            numbers = get_args(kind)[:1] in {(float,), (int,)}
            words.append(f"numbers in brackets such as {name}=[5,10,20]" if numbers else f"a list such as {name}=[a,b]")
        elif get_origin(kind) in {dict, Mapping}:
            words.append(f"settings in braces such as {name}={{a: 1}}")
        else:
            words.append({float: "a number", int: "a whole number", bool: "true or false"}.get(kind, "a word"))
    return " or ".join([*dict.fromkeys(words), *(["null"] if NoneType in _kinds(annotation) else [])])
