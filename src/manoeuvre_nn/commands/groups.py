"""Where the groups of conf are, in the package and in a folder of the user's own; nothing here loads torch."""

import fnmatch
import importlib
import json
import os
import re
import sys
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import hydra
import yaml
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, OmegaConf

from manoeuvre_nn.commands import guard
from manoeuvre_nn.commands.guard import as_word, quoted
from manoeuvre_nn.commands.settings import check_settings
from manoeuvre_nn.core.data_files import CONF, load_yaml
from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.core.plain_text import as_file_name

OWN = ("config_dir", "--config-dir", "-cd")
"""How a folder of the user's own is named."""
UNCHECKED = ("-cp", "-cn", *(f"{sign}hydra.searchpath" for sign in ("", "+", "++")))
UNCHECKED_BEGIN = ("--config-p", "--config-n", "--exp")
"""Hydra's own ways to configs that nobody has checked, and to a pickled one: ``--experimental-rerun``."""
GROUPS = sorted(path.name for path in CONF.iterdir() if path.is_dir())
OF_THE_USER = {"hydra", "plugins", "config_dir"}
"""Settings that are said on the command line and nowhere else."""
OUTPUT = "out"
"""Where a command writes: the same."""
COMMON = ("speed_kn", "rudder_split_deg", "shaft_split")
"""Settings of the group manoeuvre that hold for all manoeuvres."""
own_modules: set[str] = set()
"""Modules of the user's own that were named with ``plugins=``: configs may name what they define."""
_composing = threading.Lock()
"""Hydra knows one config at a time."""
OF_SEVERAL = ("manoeuvre", "effect")
"""Groups of which several options hold at once, each under its name."""
EXAMPLE = "manoeuvre=[zz20,{spiral: {rudder_deg: 15}}]"
"""How an option is chosen with its settings."""
FOLLOWING = ("linear", "network", "fit")
"""Groups that a ship, a network or recordings may choose too; what the user writes always holds."""


def options(group: str, own: str | None = None) -> dict[str, Path]:
    """The options of a group by name, and their files; the package's come before those in the user's own folder."""
    folders = [Path(own)] if own else []
    found = {path.stem: path for folder in [*folders, CONF] for path in (folder / group).glob("*.yaml")}
    return dict(sorted(found.items()))


def option(group: str, name: Any, own: str | None = None, what: str = "") -> dict[str, Any]:
    """What the file of an option says.

    Args:
        group: Group of conf.
        name: The option.
        own: Folder of the user's own; None if there is none.
        what: What the name stands for, for the message; by default the group.

    Returns:
        Settings of the group. An option that there is not is refused with a list of those that there are.
    """
    known = options(group, own)
    check_choice(what or group, name, list(known))
    return settings_in(known[name], group)


def settings_in(path: Path, group: str) -> dict[str, Any]:
    """What a file like those of a group says of that group; refused if it holds no settings."""
    content = load_yaml(path)
    found = content.get(group, content) if isinstance(content, Mapping) else content  # some choose other groups too
    if not isinstance(found, Mapping):
        raise InputError(f"{path} holds no settings of a {group}: write name: value, as in the files of conf/{group}")
    return dict(found)


def compose(name: str, words: Sequence[str] = ()) -> DictConfig:
    """The config of a command, from Python.

    Args:
        name: The command: ``train``, ``diagnose``, ``check``, ``coefficients``, ``excite``.
        words: What one would write on the command line, ``config_dir=FOLDER`` among it.

    Returns:
        The config; hydra's own part is left out.
    """
    words, folder = own_folder(with_settings(words))
    if folder is not None:
        words.append(f"hydra.searchpath=[{quoted('file://' + str(folder))}]")
    with _composing:
        GlobalHydra.instance().clear()
        HydraConfig.instance().cfg = None  # the choices of a command that ran before in this process are not this one's
        with hydra.initialize_config_dir(str(CONF), version_base="1.3"):
            cfg = hydra.compose(name, words)
    accept(cfg)
    return cfg


def with_settings(words: Sequence[str]) -> list[str]:
    """Say ``manoeuvre=[zz20,{spiral: {rudder_deg: 15}}]`` as hydra does: the options, and their settings beside them.

    Args:
        words: The words.

    Returns:
        The words with such ones taken apart.

    Raises:
        InputError: If an entry is neither a name nor a name with settings, or a name stands twice.
    """
    made = []
    for word in words:
        group, _, value = word.partition("=")
        if group not in OF_SEVERAL or "{" not in value:
            made.append(word)
            continue
        try:
            given = yaml.safe_load(value)
        except yaml.YAMLError:
            given = None
        chosen: dict[str, Mapping[str, Any]] = {}
        for entry in given if isinstance(given, list) else [given]:
            named = dict([(entry, {})]) if isinstance(entry, str) else entry
            named = named if isinstance(named, dict) and len(named) == 1 else {"": None}
            ((name, settings),) = named.items()
            if not isinstance(settings, Mapping) or name in chosen:
                raise InputError(
                    f"{word}: expected names, each once, or {{name: {{setting: value}}}}, such as {EXAMPLE}"
                )
            chosen[str(name)] = settings
        made.append(f"{group}=[{','.join(chosen)}]")
        made += [
            f"{group}.{name}.{key}={_typed(v)}" for name, settings in chosen.items() for key, v in settings.items()
        ]
    return made


def _typed(value: Any) -> str:
    """A value as it is typed for hydra."""
    return as_word(value) if isinstance(value, str) else json.dumps(value)


def own_folder(words: Sequence[str]) -> tuple[list[str], Path | None]:
    """Take the user's own folder out of a command line and check it.

    Args:
        words: The words, with ``config_dir=FOLDER`` or hydra's ``--config-dir FOLDER`` among them.

    Returns:
        Words with ``config_dir=`` alone, the path made absolute; and the folder, None if none is named.

    Raises:
        InputError: If it is no folder, or its files reach beyond their groups; or if hydra is told another way to it.
    """
    kept, named = [], None
    left = list(words)
    while left:
        key, sign, value = left.pop(0).partition("=")
        if key in UNCHECKED or key.startswith(UNCHECKED_BEGIN):
            raise InputError(
                f"{key} is refused: what hydra finds there may run code: write config_dir=FOLDER; its files are checked"
            )
        if key not in OWN and not key.startswith("--config-d"):  # hydra takes the beginning of a word for the word
            kept.append(f"{key}{sign}{value}")
        elif value not in {"", "null"}:
            named = value
        elif not sign:
            if not left:
                raise InputError(f"{key} names no folder: write config_dir=FOLDER")
            named = left.pop(0)
    if named is None:
        return kept, None
    folder = Path(os.path.realpath(Path(named.strip("'\"")).expanduser()))  # unlike resolve, also of a link to itself
    if not folder.is_dir():
        raise InputError(f"config_dir={named} is not a folder: write one with ship/, effect/, manoeuvre/ ... in it")
    for group in GROUPS:  # other folders, such as those of runs, may hold anything: nothing of theirs can be chosen
        for place, _, names in os.walk(folder / group, followlinks=True):
            for name in fnmatch.filter(names, "*.yaml"):
                _check_own_file(Path(place, name), folder)
    return [*kept, f"config_dir={quoted(str(folder))}"], folder


def _check_own_file(path: Path, folder: Path) -> None:
    """Refuse a yaml that would set what only the user says: hydra's settings and plugins= name code that is run."""
    content = load_yaml(path) or {}
    if not isinstance(content, Mapping):
        raise InputError(f"{path} is refused: it holds a {type(content).__name__}; expected settings, such as beam: 20")
    package = re.findall(r"^\s*#\s*@package\s+(\S+)", path.read_text(encoding="utf-8"), flags=re.MULTILINE)
    reached = [*content, *package, content.get("defaults", ""), path.relative_to(folder).with_suffix("")]
    places = {str(key).partition(".")[0] for key in [*content, *package]}
    if OF_THE_USER & set(re.findall(r"\w+", " ".join(map(str, reached)))) or OUTPUT in places:
        named = ", ".join(sorted([*OF_THE_USER, OUTPUT]))
        raise InputError(f"{path} is refused: a file in config_dir= may not set {named}")
    group, name = path.relative_to(folder).parts[0], path.stem
    if group in OF_SEVERAL and "_target_" in content and f"{group}.{name}" not in package:
        raise InputError(f"{path}: its first line must say where it stands: # @package {group}.{name}")
    defaults = content.get("defaults", [])
    if not isinstance(defaults, list) or not all(isinstance(entry, str | Mapping) and entry for entry in defaults):
        raise InputError(f"{path} is refused: its defaults name {defaults}; write a list such as [pitch, _self_]")
    for entry in defaults:
        named = next(iter(entry), "") if isinstance(entry, Mapping) else entry
        group = str(named).rpartition(" ")[2].partition("@")[0]
        if ".." in str(entry) or (group.startswith("/") and group.split("/")[1] not in GROUPS):
            raise InputError(
                f"{path} is refused: its defaults name {entry}, which is in no group ({', '.join(GROUPS)})"
            )


def accept(cfg: DictConfig | Mapping[str, Any]) -> None:
    """Check the settings, and import the user's own modules, from ``config_dir`` or as installed.

    Args:
        cfg: The config; ``plugins`` names the modules, and no other is imported.

    Raises:
        InputError: If a setting is of the wrong kind, or there is no such module.
        ModuleNotFoundError: If a module imports one that is not installed.
    """
    check_settings(cfg)
    named = cfg.get("plugins") or []
    modules = [str(name).removesuffix(".py") for name in ([named] if isinstance(named, str) else named)]
    folder = cfg.get("config_dir")
    if modules and folder is not None and folder not in sys.path:
        sys.path.append(folder)  # last, and also where worker processes look
    for module in modules:
        if not all(part.isidentifier() for part in module.split(".")):
            raise InputError(
                f"plugins={module}: no name of a module; write that of a py file in config_dir=, without a path"
            )
        try:
            importlib.import_module(module)
        except ModuleNotFoundError as error:
            if error.name != module:
                raise
            raise InputError(f"plugins={module}: no such module; write the name of a py file in config_dir=") from error
    own_modules.update(modules)


def brought_along(choices: Mapping[str, str], words: Sequence[str], config: str = "train") -> list[str]:
    """Groups of ``train`` that another choice has set: a ship's own network, the fit that suits recordings best.

    Args:
        choices: Group -> option, as hydra has composed them.
        words: What the user wrote, ``group=option`` among it.
        config: The config that was composed: ``train``, or that of a task.

    Returns:
        ``group=option`` of each that neither the user nor the command's own defaults chose.
    """
    defaults = load_yaml(CONF / f"{config}.yaml")["defaults"] if (CONF / f"{config}.yaml").is_file() else []
    entries = [entry for entry in defaults if isinstance(entry, dict)]
    usual = {group.lstrip("/"): option for entry in entries for group, option in entry.items()}
    named = {word.partition("=")[0].lstrip("+~") for word in words}
    return [f"{g}={choices[g]}" for g in FOLLOWING if g in choices and g not in named and choices[g] != usual.get(g)]


def register_resolvers() -> None:
    """Make ``${ship_name:...}``, ``${run_name:...}`` and ``${program:}`` known to OmegaConf."""
    OmegaConf.register_new_resolver("program", guard.program, replace=True)
    OmegaConf.register_new_resolver("file_name", lambda name: as_file_name(str(name)), replace=True)
    OmegaConf.register_new_resolver("ship_name", _ship_name, replace=True)
    OmegaConf.register_new_resolver("run_name", _run_name, replace=True)
    OmegaConf.register_new_resolver("task_name", _task_name, replace=True)
    OmegaConf.register_new_resolver("job_name", job_name, replace=True)


def _ship_name(ship: Any) -> str:
    """The option that was chosen; composed from Python without hydra's record of choices, the ship's function."""
    if HydraConfig.initialized() and "ship" in HydraConfig.get().runtime.choices:
        return str(HydraConfig.get().runtime.choices["ship"])
    return str(ship["_target_"]).rpartition(".")[2]


def job_name(words: Sequence[str], same: Sequence[str]) -> str:
    """What a job of a sweep is called: what it differs in from the others.

    Args:
        words: What it was given: ``ship=mariner``, ``network.hidden=7``, ``data.length=180``.
        same: Settings that are the same in all jobs.

    Returns:
        ``hidden=7,length=180``; a setting's full name if another one ends in the same word.
    """
    given = {key: value for key, _, value in (word.lstrip("+~").partition("=") for word in words)}  # the last one holds
    changed = [(key, value) for key, value in given.items() if key not in same]
    ends = [key.rpartition(".")[2] for key, _ in changed]
    names = [end if ends.count(end) == 1 else key for end, (key, _) in zip(ends, changed, strict=True)]
    told = ",".join(f"{name}={value}" for name, (_, value) in zip(names, changed, strict=True))
    return as_file_name(told) or "run"


def _task_name(task: str, data: Any) -> str:
    """The task, and whether its records are one's own."""
    return f"{task}_recordings" if "files" in data else task


def _run_name(ship: Any, manoeuvre: Any, data: Any, effect: Any = None, run: str | None = None) -> str:
    """Ship, manoeuvres and effects joined, or ``recordings``, or the name of a run: what the folder is called after."""
    if run is not None:
        return Path(str(run)).absolute().name
    sailed = [k for k in manoeuvre if k not in COMMON] + list(effect or {})
    return "_".join([_ship_name(ship), *(["recordings"] if "files" in data else sailed)])


register_resolvers()
