"""What each setting that no group brings may be; they are checked together, before anything is read or computed.

Settings of a group are arguments of what it makes: :func:`~manoeuvre_nn.commands.shelves.check_arguments` holds them to
its annotations.
"""

import sys
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from omegaconf import DictConfig, OmegaConf

from manoeuvre_nn.core.errors import InputError

MAX_COUNT = 2**63 - 1
"""Largest whole number that torch and numpy take, as a seed for instance."""
MAX_THREADS = 256
"""Threads, or processes, that a command may be told to use at once."""
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
            raise InputError(f"{name}={value}: expected {self.expected}")


def whole(least: int, most: int = MAX_COUNT) -> SettingKind:
    """A whole number."""
    said = f"{least} or more" if most == MAX_COUNT else f"{least} to {most}"
    return SettingKind(lambda value: type(value) is int and least <= value <= most, f"a whole number, {said}")


def more_than_0(words: str = "a number more than 0") -> SettingKind:
    """A finite number more than zero; ``words`` say of what."""
    return SettingKind(lambda value: _is_number(value) and value > 0, words)


def at_most(most: float) -> SettingKind:
    """A number of either sign."""
    return SettingKind(lambda value: _is_number(value) and abs(value) <= most, f"a number from {-most:g} to {most:g}")


def or_null(kind: SettingKind) -> SettingKind:
    """A kind, or nothing."""
    return SettingKind(lambda value: value is None or kind.accepts(value), f"{kind.expected}, or null")


def _is_number(value: Any) -> bool:
    """Whether it is a finite number; a whole one may be too large for a float."""
    return type(value) in {int, float} and abs(value) <= sys.float_info.max


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
POSITIVE = more_than_0()

SETTINGS: dict[str, SettingKind] = {
    "manoeuvre": TABLE,
    "captive": TABLE,
    "trainer": TABLE,
    "data": TABLE,
    # common to several commands
    "config_dir": or_null(PATH),
    "effects": or_null(PATH),
    "manoeuvre.speed_kn": or_null(more_than_0("an approach speed in knots, more than 0")),
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
    "captive.file": or_null(PATH),
    "captive.largest_drift_deg": more_than_0("degrees, more than 0"),
    "captive.mapping": or_null(PATH),
    "captive.shaft": or_null(POSITIVE),
    "captive.speed": or_null(POSITIVE),
    "inertia": or_null(TABLE),
    "relative": more_than_0("more than 0, such as .2"),
    "terms": WORD,
    # diagnose
    "cases": or_null(PATH),
    "files": or_null(FILES),
    "held_out": NAMES,
    "mapping": or_null(PATH),
    "recordings": or_null(PATH),
    "remainder": SWITCH,
    "report": SWITCH,
    "rpm": or_null(POSITIVE),
    "rudder_positive_to": or_null(WORD),
    "speed_kn": or_null(POSITIVE),
    "warmup_s": or_null(POSITIVE),
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
    "rate_hz": or_null(POSITIVE),
    # tasks of train
    "form": TABLE,
    "inputs": TABLE,
    "learning": more_than_0("a share more than 0"),
    "output": TABLE,
    "per": or_null(WORD),
    "sees": TABLE,
    "task": WORD,
}
"""Setting -> what it may be."""


def check_settings(
    cfg: DictConfig | Mapping[str, Any], where: str = "", kinds: Mapping[str, SettingKind] = SETTINGS
) -> None:
    """Refuse a config in which a setting of no group is of the wrong kind, with an ``InputError``.

    Args:
        cfg: The config; not all settings need be in it.
        where: What to say before the setting's name.
        kinds: Setting -> what it may be.
    """
    for name, kind in kinds.items():
        place, _, key = name.rpartition(".")
        settings = cfg.get(place) if place else cfg
        if settings is not None and key in settings:
            value = settings[key]
            plain = OmegaConf.to_container(value, resolve=True) if OmegaConf.is_config(value) else value
            kind.check(f"{where}{name}", plain)
