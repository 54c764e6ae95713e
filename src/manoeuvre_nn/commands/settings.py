"""What each setting that no group brings may be; they are checked together, before anything is read or computed.

Settings of a group are arguments of what it makes: :func:`~manoeuvre_nn.commands.shelves.check_arguments` holds them to
its annotations. Here they are held to what holds for all: a group holds settings, and a number can be meant.
"""

from collections.abc import Callable, Iterator, Mapping
from math import isinf
from typing import Any, NamedTuple

from omegaconf import DictConfig, OmegaConf

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.limits import LARGEST_NUMBER, MAX_SEED, SMALLEST_NUMBER, is_sensible

MAX_THREADS = 256
"""Threads, or processes, that a command may be told to use at once."""
MAX_SHOWN = 200
"""Letters of a value that a message repeats."""
MAX_PATH, MAX_NAME = 4096, 255
"""Longest path, and name of a file, that systems take [bytes]."""


class SettingKind(NamedTuple):
    """What a setting may be.

    Attributes:
        accepts: Whether a plain value is of this kind.
        expected: What is, in words.
    """

    accepts: Callable[[Any], bool]
    expected: str

    def check(self, name: str, value: Any) -> None:
        """Refuse a plain value that is not of this kind; ``name`` is the setting's."""
        if not self.accepts(value):
            raise InputError(f"{name}={abridged(value)}: expected {self.expected}")


def abridged(value: Any) -> str:
    """A value as a message repeats it: its beginning."""
    said = str(value)
    return said if len(said) <= MAX_SHOWN else f"{said[:MAX_SHOWN]}..."


def whole(least: int, most: int = MAX_SEED) -> SettingKind:
    """A whole number."""
    said = f"{least} or more" if most == MAX_SEED else f"{least} to {most}"
    return SettingKind(lambda value: type(value) is int and least <= value <= most, f"a whole number, {said}")


def more_than_0(words: str = "a number more than 0", most: float = LARGEST_NUMBER) -> SettingKind:
    """A finite number more than zero; ``words`` say of what."""
    said = words if most == LARGEST_NUMBER else f"{words}, to {most:g}"
    return SettingKind(lambda value: is_sensible(value) and 0 < value <= most, said)


def at_most(most: float) -> SettingKind:
    """A number of either sign."""
    return SettingKind(lambda value: is_sensible(value) and abs(value) <= most, f"a number from {-most:g} to {most:g}")


def or_null(kind: SettingKind) -> SettingKind:
    """A kind, or nothing."""
    return SettingKind(lambda value: value is None or kind.accepts(value), f"{kind.expected}, or null")


def _is_word(value: Any) -> bool:
    """Whether it is a word, or what hydra takes for a number, such as 2026."""
    return type(value) in {str, int, float} and value != ""


def _can_name(value: Any) -> bool:
    """Whether a file may be called so."""
    said = str(value) if _is_word(value) else ""
    sizes = [len(part.encode("utf-8", "surrogatepass")) for part in said.split("/")]
    return said != "" and sum(sizes) + len(sizes) <= MAX_PATH and max(sizes) <= MAX_NAME


def _or_several(accepts: Callable[[Any], bool]) -> Callable[[Any], bool]:
    """Whether a value, or each in a list, is accepted."""
    return lambda value: all(map(accepts, value)) if isinstance(value, list) else accepts(value)


def _is_choice(value: Any) -> bool:
    """A name, or ``{name: {setting: value}}``."""
    return _is_word(value) or (isinstance(value, dict) and [type(v) for v in value.values()] == [dict])


SWITCH = SettingKind(lambda value: type(value) is bool, "true or false")
WORD = SettingKind(_is_word, "a word")
PATH = SettingKind(_can_name, "the path of a file or folder")
NAMES = SettingKind(_or_several(_is_word), "a name, or several such as [A,B]")
FILES = SettingKind(_or_several(_can_name), "names of files, such as [A.csv,B.csv]")
CHOICES = SettingKind(_or_several(_is_choice), "a name, or a list of names and {name: {setting: value}}")
TABLE = SettingKind(lambda value: isinstance(value, dict), "settings in braces such as {a: 1}")
SPEED = SettingKind(lambda value: is_sensible(value) and 0.05 <= value <= 200, "an approach speed in knots, .05 to 200")

SETTINGS: dict[str, SettingKind] = {
    # groups
    "data": TABLE,
    "effect": or_null(TABLE),
    "fit": TABLE,
    "linear": TABLE,
    "logger": TABLE,
    "manoeuvre": TABLE,
    "network": TABLE,
    "scoring": TABLE,
    "ship": or_null(TABLE),
    "trainer": TABLE,
    # common to several commands
    "config_dir": or_null(PATH),
    "effects": or_null(PATH),
    "manoeuvre.speed_kn": or_null(SPEED),
    "manoeuvre.rudder_split_deg": or_null(at_most(70.0)),
    "manoeuvre.shaft_split": or_null(at_most(2.0)),
    "name": WORD,
    "out": or_null(PATH),
    "plugins": or_null(NAMES),
    "seed": whole(0),
    "trainer.resume": PATH,
    "trainer.threads": whole(1, MAX_THREADS),
    "data.files": FILES,
    "data.folder": PATH,
    "data.mapping": or_null(PATH),
    "model": or_null(PATH),
    "run": or_null(PATH),
    "score": CHOICES,
    "candidates": CHOICES,
    # check
    "figures": SWITCH,
    # coefficients
    "captive": TABLE,
    "captive.file": or_null(PATH),
    "captive.largest_drift_deg": more_than_0("degrees, more than 0", 180.0),
    "captive.mapping": or_null(PATH),
    "captive.shaft": or_null(more_than_0("revolutions a second, more than 0", 1e3)),
    "captive.speed": or_null(more_than_0("m/s, more than 0", 100.0)),
    "inertia": or_null(TABLE),
    "relative": more_than_0("more than 0, such as .2", 1e3),
    "terms": WORD,
    # diagnose
    "cases": or_null(PATH),
    "files": or_null(FILES),
    "held_out": NAMES,
    "mapping": or_null(PATH),
    "recordings": or_null(PATH),
    "remainder": SWITCH,
    "report": SWITCH,
    "rpm": or_null(more_than_0("revolutions a minute, more than 0", 1e5)),
    "rudder_positive_to": or_null(WORD),
    "speed_kn": or_null(SPEED),
    "warmup_s": or_null(more_than_0("seconds, more than 0", 1e6)),
    "workers": whole(1, MAX_THREADS),
    # excite
    "effort": TABLE,
    "goal": WORD,
    "per_minute": SWITCH,
    # export
    "document": SWITCH,
    "format": WORD,
    # simulate
    "noise": TABLE,
    "rate_hz": or_null(more_than_0("samples a second, more than 0", 1e4)),
    # tasks of train
    "form": TABLE,
    "inputs": TABLE,
    "learning": more_than_0("a share more than 0", 1.0),
    "output": TABLE,
    "per": or_null(WORD),
    "sees": TABLE,
    "task": WORD,
}
"""Setting -> what it may be."""


SEVERAL = ("manoeuvre", "effect", "logger")
"""Groups of which several are chosen at once, each under its name."""


def check_settings(
    cfg: DictConfig | Mapping[str, Any], where: str = "", kinds: Mapping[str, SettingKind] = SETTINGS
) -> None:
    """Refuse a config in which a setting is of the wrong kind.

    Args:
        cfg: The config; not all settings need be in it.
        where: What to say before the setting's name.
        kinds: Setting of no group -> what it may be.

    Raises:
        InputError: If one is.
    """
    for name, kind in kinds.items():
        place, _, key = name.rpartition(".")
        settings = cfg.get(place) if place else cfg
        if settings is not None and key in settings:
            kind.check(f"{where}{name}", _plain(settings[key]))
    for group in SEVERAL:
        for option, said in (_plain(cfg.get(group)) or {}).items():
            if f"{group}.{option}" not in kinds:
                TABLE.check(f"{where}{group}.{option}", said)
    for group in map(str, cfg):
        for key, value in _numbers(group, _plain(cfg[group])):
            most = MAX_SEED if key.rpartition(".")[2] == "seed" else LARGEST_NUMBER
            endless = isinstance(value, float) and isinf(value)  # which an argument says itself whether it may be
            if key not in kinds and not (endless or is_sensible(value, most)):
                sizes = f"from {SMALLEST_NUMBER:g} to {LARGEST_NUMBER:g}"
                raise InputError(f"{where}{key}={abridged(value)}: expected 0, or a number of a size {sizes}")


def _plain(value: Any) -> Any:
    """A setting as plain values, lists and dicts."""
    return OmegaConf.to_container(value, resolve=True) if OmegaConf.is_config(value) else value


def _numbers(name: str, value: Any) -> Iterator[tuple[str, int | float]]:
    """Name and value of every number among settings; one of a list has the list's name."""
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from _numbers(f"{name}.{key}", inner)
    elif isinstance(value, list | tuple):
        for inner in value:
            yield from _numbers(name, inner)
    elif type(value) in {int, float}:
        yield name, value
