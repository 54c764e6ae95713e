"""From a config to objects: a ``_target_`` may only name what stands on the shelf of its group."""

import importlib
import inspect
import pkgutil
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import fields, is_dataclass, replace
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin

from omegaconf import DictConfig, ListConfig, OmegaConf

from manoeuvre_nn.commands.groups import option, options, own_modules
from manoeuvre_nn.commands.settings import SEVERAL, abridged
from manoeuvre_nn.core.data_files import PLAIN, check_plain
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.limits import MAX_COUNTED, MAX_SEED, NumberLimits

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


def build(config: Any, group: str, where: str | None = None, /, **more: Any) -> Any:
    """Make the object that a piece of config describes.

    Args:
        config: Mapping with ``_target_`` and settings. Flat settings are gathered into an argument that is a dataclass.
        group: Group of conf that it belongs to.
        where: Where it stands in a config, for messages; by default in the group.
        more: Further arguments.

    Returns:
        The object.

    Raises:
        InputError: If it is not on the group's shelf, or an argument is unknown or of the wrong kind.
    """
    where = where or group
    described = plain(config, where)
    made = on_shelf(described.get(TARGET), group, where)
    settings = {name: value for name, value in described.items() if name != TARGET}
    check_plain(settings, where)
    for name in settings.keys() & more.keys():
        raise InputError(
            f"{where}.{name}={abridged(settings[name])} is no setting of {made.__name__}: leave {name} out"
        )
    settings = gathered(made, {**settings, **more}, where)
    check_arguments(made, settings, where, list(more))
    return made(**settings)


def plain(config: Any, where: str = "") -> dict[str, Any]:
    """A piece of config as plain dicts and lists, interpolations resolved; what is no mapping is refused."""
    if isinstance(config, DictConfig | ListConfig):
        config = OmegaConf.to_container(config, resolve=True, throw_on_missing=True)
    if not isinstance(config, Mapping):
        raise InputError(f"{where}={abridged(config)}: expected settings, as in the files of conf")
    return {str(key): value for key, value in config.items()}


def on_shelf(target: Any, group: str, where: str | None = None) -> Callable[..., Any]:
    """Find what a ``_target_`` names; nothing outside the shelf is imported.

    Args:
        target: Import path.
        group: Group of conf.
        where: Where it stands in a config, for messages; by default in the group.

    Returns:
        A class, or a function that says that it returns one of the shelf's kinds.

    Raises:
        InputError: If it is not defined on that shelf.
        ModuleNotFoundError: If its module imports one that is not installed.
    """
    said = f"{where or group}.{TARGET}"
    if not isinstance(target, str) or not target:
        raise InputError(f"{said} is {abridged(target)}: expected what is made, as in the files of conf/{group}")
    shelf, (module, _, name) = SHELVES[group], target.rpartition(".")
    places = " or ".join(shelf.places)
    foreign = module.partition(".")[0] in {"manoeuvre_nn", *own_modules, *sys.stdlib_module_names}
    own = "" if foreign else f"; if {module} is a module of your own that you trust, add plugins=[{module}]"
    refused = InputError(
        f"{said}: {abridged(target)} is refused; a config may only name things in {places} for {group}{own}"
    )
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
        raise refused if is_module else InputError(f"{said}: {target} does not exist") from error
    except AttributeError as error:
        raise InputError(f"{said}: {target} does not exist") from error
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
    made = on_shelf(plain(config, group).get(TARGET), group)
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


def gathered(function: Callable[..., Any], settings: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Put settings into the dataclasses that a function takes.

    Args:
        function: What is to be called.
        settings: Settings, those of a dataclass either flat or as a mapping under the argument's name; what is not
            given is as in the argument's default.
        where: Where they stand in a config, for messages.

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
        check_arguments(kind, given, where if name == "settings" else f"{where}.{name}")
        usual = parameter.default
        left[name] = replace(usual, **given) if isinstance(usual, kind) else kind(**given)
    return left


def check_arguments(
    function: Callable[..., Any], settings: Mapping[str, Any], where: str, given: Sequence[str] = ()
) -> None:
    """Refuse settings (keyword arguments) that a function does not know, that it lacks, or that are of the wrong kind.

    Args:
        function: What is to be called. Its annotations say what an argument is, and within which limits
            (:class:`~manoeuvre_nn.core.limits.NumberLimits`).
        settings: Its keyword arguments.
        where: Where they stand in a config, for messages.
        given: Arguments that the caller gives, which no setting may.

    Raises:
        InputError: If one is refused.
    """
    known = inspect.signature(function).parameters
    variable = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    needed = [name for name, p in known.items() if p.default is p.empty and p.kind not in variable]
    others = next((p for p in known.values() if p.kind is p.VAR_KEYWORD), None)
    lacking, strange = [n for n in needed if n not in {*settings, *given}], [n for n in settings if n not in known]
    if lacking:
        instead = f", in the place of {strange[0]}" if strange else ""
        raise InputError(f"{where}.{lacking[0]} is missing: write it in the yaml{instead}")
    if strange and not _takes_others(function):
        there = ", ".join(name for name in known if name not in given) or "none"
        raise InputError(f"{where}.{strange[0]}: there is no such setting; those of {function.__name__} are: {there}")
    for name, value in settings.items():
        parameter = known.get(name, others)
        if parameter and name not in given and not _fits(value, parameter.annotation, name):
            raise InputError(
                f"{where}.{name}={abridged(value)}: expected {_in_words(name, value, parameter.annotation)}"
            )


def _takes_others(function: Callable[..., Any]) -> bool:
    """Whether a function takes settings whatever their names."""
    return any(p.kind is p.VAR_KEYWORD for p in inspect.signature(function).parameters.values())


def _kinds(annotation: Any) -> set[Any]:
    """What an argument may be, one by one."""
    return set(get_args(annotation)) if get_origin(annotation) in {UnionType, Union} else {annotation}


def _number(annotation: Any, name: str) -> tuple[type, NumberLimits] | None:
    """Whole or not, and the limits of an argument that is a number; None for another one."""
    kind, *said = get_args(annotation) if get_origin(annotation) is Annotated else (annotation,)
    limits = next((limits for limits in said if isinstance(limits, NumberLimits)), _usual(kind, name))
    return (kind, limits) if kind in {int, float} else None


def _usual(kind: Any, name: str) -> NumberLimits:
    """Limits of a number that says none."""
    most = MAX_SEED if name == "seed" else MAX_COUNTED
    return NumberLimits(-most, most) if kind is int else NumberLimits()


def _fits(value: Any, annotation: Any, name: str) -> bool:
    """Whether a plain value is of the kind that an argument has; what a config cannot give is the caller's matter."""
    if len(kinds := _kinds(annotation)) > 1:
        return any(_fits(value, kind, name) for kind in kinds)
    origin, inner = get_origin(annotation), get_args(annotation)
    if origin in {list, tuple, Sequence}:
        of = inner[0] if inner else object
        return isinstance(value, Sequence) and not isinstance(value, str) and all(_fits(v, of, name) for v in value)
    if origin in {dict, Mapping}:
        return isinstance(value, Mapping) and all(_fits(v, inner[1], name) for v in value.values())
    if number := _number(annotation, name):
        kind, limits = number
        return limits.hold(value) and (kind is float or isinstance(value, int))
    if origin is Literal:
        return value in inner
    if annotation is str:  # a path of the caller's is as good
        return isinstance(value, str) or not isinstance(value, (*PLAIN, Sequence, Mapping))
    if annotation in {bool, None, NoneType}:
        return isinstance(value, annotation or NoneType)
    made = inspect.isclass(annotation) and annotation not in {object, inspect.Parameter.empty}
    return not (made and isinstance(value, (*PLAIN, list, dict))) or isinstance(value, annotation)


def _in_words(name: str, value: Any, annotation: Any) -> str:
    """What an argument may be, for a person who gave a value; limits of all numbers are told where it is one."""
    words = []
    for kind in sorted(_kinds(annotation) - {NoneType}, key=str):
        if get_origin(kind) in {list, tuple, Sequence}:
            numbers = _number(get_args(kind)[0], name) if get_args(kind) else None
            words.append(f"numbers in brackets such as {name}=[5,10,20]" if numbers else f"a list such as {name}=[a,b]")
        elif get_origin(kind) in {dict, Mapping} or inspect.isclass(kind) and is_dataclass(kind):
            words.append(f"settings in braces such as {name}={{a: 1}}")
        elif number := _number(kind, name):
            a_number = isinstance(value, int | float) and not isinstance(value, bool)
            told = number[1] if a_number or number[1] != _usual(number[0], name) else ""
            words.append(f"a {'whole ' if number[0] is int else ''}number{told}")
        elif get_origin(kind) is Literal:
            words.append(" or ".join(map(str, get_args(kind))))
        else:
            words.append({bool: "true or false"}.get(kind, "a word"))
    return " or ".join([*dict.fromkeys(words), *(["null"] if NoneType in _kinds(annotation) else [])])
