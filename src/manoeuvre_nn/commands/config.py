"""What a config says, read and checked: numbers, switches, manoeuvres, effects, mappings."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, ListConfig, OmegaConf

from manoeuvre_nn.commands.groups import COMMON, option
from manoeuvre_nn.commands.shelves import TARGET, build
from manoeuvre_nn.core.data_files import check_plain, load_yaml, without_format
from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.manoeuvre import Manoeuvre
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.core.units import DEGREE, KNOT
from manoeuvre_nn.recording.read import mapping_file
from manoeuvre_nn.recording.read.mapping import Mapping as ColumnMapping


def training_manoeuvres(config: DictConfig) -> list[Manoeuvre]:
    """The manoeuvres of ``cfg.manoeuvre`` (an entry each or for several) with what holds for all of them."""
    chosen = {str(name): said for name, said in config.items() if name not in COMMON}
    speed = approach_speed(config)
    made = [m for name, said in chosen.items() for m in _built(said, f"manoeuvre.{name}")]
    return with_sides([m.at_speed(speed) for m in made], config)


def _built(settings: Any, where: str) -> list[Manoeuvre]:
    """What an entry of conf/manoeuvre makes: one, or a set."""
    made = build(settings, "manoeuvre", where)
    return made if isinstance(made, list) else [made]


def with_sides(manoeuvres: Sequence[Manoeuvre], config: DictConfig) -> list[Manoeuvre]:
    """Manoeuvres with what ``cfg.manoeuvre`` says of two rudders and screws: rudder_split_deg and shaft_split."""
    rudders, shafts = (0.5 * (config.get(key) or 0.0) for key in ("rudder_split_deg", "shaft_split"))
    return [replace(m, rudder_split=rudders * DEGREE, shaft_split=shafts) for m in manoeuvres]


def chosen_effects(config: DictConfig | None, ship: Ship) -> list[Effect]:
    """The effects of ``cfg.effect`` (an entry each, or None) on a ship, in the order in which they were named."""
    chosen = {str(name): settings for name, settings in (config or {}).items()}
    return [build(settings, "effect", f"effect.{name}", ship=ship) for name, settings in chosen.items()]


def with_effects(cfg: DictConfig) -> DictConfig:
    """Take the effects of ``effects=FILE``, as diagnose writes it, among those that were chosen with ``effect=``.

    Args:
        cfg: The config.

    Returns:
        The config with the file's effects in ``cfg.effect``; where the file is silent, conf/effect has the values.

    Raises:
        InputError: If an effect was chosen already.
    """
    if cfg.get("effects") is None:
        return cfg
    found, chosen = read_effects(Path(str(cfg.effects)), cfg.get("config_dir")), cfg.get("effect") or {}
    for name in found:
        if name in chosen:
            raise InputError(f"{name} is both in effect= and in {cfg.effects}: leave one out")
    return OmegaConf.merge(OmegaConf.create(OmegaConf.to_container(cfg)), {"effect": found})  # type: ignore


def read_effects(path: Path, own: str | None = None) -> dict[str, dict[str, Any]]:
    """Read a file of effects: ``wind_steady: {speed: 12}``.

    Args:
        path: The file.
        own: Folder of the user's own.

    Returns:
        Effect -> its entry of conf/effect with the file's values.

    Raises:
        InputError: If it does not exist, or holds anything else than values of effects that are in conf/effect.
    """
    if not path.is_file():
        raise InputError(f"effects={path} does not exist: write the path of a yaml file, as diagnose writes it")
    found = load_yaml(path)
    found = without_format(found, f"effects={path}") if isinstance(found, Mapping) else found
    if not isinstance(found, Mapping) or not all(isinstance(entry, Mapping) for entry in found.values()):
        raise InputError(f"effects={path}: expected the values of effects, such as wind_steady: {{speed: 12}}")
    entries = {}
    for name, values in found.items():
        usual = option("effect", name, own, f"effects={path}: effect")
        if TARGET in values:
            raise InputError(f"effects={path}: {name}: {TARGET}: {values[TARGET]} is refused; write values alone")
        check_plain(values, f"effects={path}: {name}")
        entries[str(name)] = {**usual, **values}
    return entries


def approach_speed(config: DictConfig) -> float | None:
    """``speed_kn`` of ``cfg.manoeuvre`` in m/s; None is the ship's own."""
    speed = config.get("speed_kn")
    return None if speed is None else speed * KNOT


def named_manoeuvres(
    names: Sequence[Any], speed: float | None, own: str | None = None, setting: str = "score"
) -> list[Manoeuvre]:
    """Manoeuvres by the names of their files in ``conf/manoeuvre``.

    Args:
        names: Names, or ``{name: {setting: value}}``.
        speed: Approach speed [m/s]; None is the ship's own.
        own: Folder of the user's own.
        setting: The setting that names them, for messages.

    Returns:
        Manoeuvres. An unknown name is refused with a list of those that exist.

    Raises:
        InputError: If an entry is neither.
    """
    made = []
    for entry in names:
        if isinstance(entry, Mapping) and [type(v) for v in entry.values()] != [dict]:
            raise InputError(f"{setting} has an entry {entry}: write a name, or {{name: {{setting: value}}}}")
        name, settings = next(iter(entry.items())) if isinstance(entry, Mapping) else (entry, {})
        usual = option("manoeuvre", name, own, f"manoeuvre in {setting}")
        made += [m.at_speed(speed) for m in _built(OmegaConf.create({**usual, **settings}), f"{setting}.{name}")]
    return made


def as_list(value: Any) -> list[Any]:
    """``score=zz20`` and ``score=[zz20]`` alike, as a plain list."""
    if isinstance(value, ListConfig):
        value = OmegaConf.to_container(value)
    return list(value) if isinstance(value, list | tuple) else [value]


def names(value: Any) -> list[str]:
    """The same as words: a file such as 2026 is a number to hydra."""
    return [str(one) for one in as_list(value)]


def read_mapping(name: str | None, own: str | None = None) -> ColumnMapping | None:
    """Read how files of a record over time are mapped.

    Args:
        name: Path of a yaml, or the name of one in conf/recording; None for files that this package wrote.
        own: Folder of the user's own.

    Returns:
        The mapping, or None.
    """
    return None if name is None else mapping_file.read_mapping(name, own)
