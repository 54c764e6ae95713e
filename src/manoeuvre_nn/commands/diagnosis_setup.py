"""From a config to what a diagnosis is about: the calm-water model, the candidates, the runs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from omegaconf import DictConfig

from manoeuvre_nn.commands import config as configs
from manoeuvre_nn.commands.groups import options
from manoeuvre_nn.commands.provenance import versions
from manoeuvre_nn.commands.shelves import TARGET, build, on_shelf
from manoeuvre_nn.core.data_files import FORMAT, load_yaml
from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.plain_text import harmless
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.core.writing import write_file
from manoeuvre_nn.diagnosis.case import Case, Question, RunSettings, read_case, read_runs, seen_channels
from manoeuvre_nn.diagnosis.result import Cause, Diagnosis
from manoeuvre_nn.dynamics.base import Model
from manoeuvre_nn.dynamics.model import CalmWater, IdentifiedShip
from manoeuvre_nn.effect.formula import Formula
from manoeuvre_nn.effect.remainder import Remainder
from manoeuvre_nn.recording.read.reader import place_of

DEFAULT, TANK, ALL = "default", "tank", "all"
SENSOR = "sensor:"


@dataclass(frozen=True)
class _Setup:
    """What all cases of a command have in common, checked before anything is computed.

    Attributes:
        cfg: The config.
        shelf: Effect -> its entry in conf/effect.
        wanted: Names of the candidates.
        model: Network instead of a ship's coefficients; None takes these.
        caveat: What its own training says against it.
    """

    cfg: DictConfig
    shelf: Mapping[str, Mapping[str, Any]]
    wanted: Sequence[str]
    model: IdentifiedShip | None
    caveat: str = ""

    def case(self, folder: Path) -> Case:
        """Read a concealed case."""
        return read_case(folder, self.cfg.rudder_positive_to, self.model.known if self.model else None)

    def runs(self) -> Case:
        """Read a person's own runs."""
        c = self.cfg
        told = {key: c[key] for key in ("rudder_positive_to", "speed_kn", "rpm", "warmup_s")}
        settings = RunSettings(
            held_out=c.held_out if isinstance(c.held_out, str) else configs.as_list(c.held_out),
            mapping=configs.read_mapping(c.mapping, c.get("config_dir")),
            files=[] if c.files is None else configs.names(c.files),
            **told,
        )
        return read_runs(place_of(str(c.recordings)), self._ship(), settings)

    def _ship(self) -> Ship | None:
        """What was chosen with ship= and model=; None leaves it to a manifest."""
        ship = build(self.cfg.ship, "ship") if self.cfg.get("ship") is not None else None
        if self.model is None:
            if isinstance(ship, Particulars):
                raise InputError(
                    f"the {ship.name} has particulars but no coefficients: write model=OUT/checkpoints/best.ckpt of a "
                    "network that was trained on it, or choose a ship with coefficients"
                )
            return ship
        known = self.model.particulars
        p = ship.particulars if isinstance(ship, Ship) else ship
        if p is not None and abs(p.length / known.length - 1) > 0.02:
            raise InputError(f"model={self.cfg.model} is of the {known.name}, ship= is the {p.name}: leave ship= out")
        return self.model.known

    def question(self, case: Case) -> Question:
        """What is asked about a case."""
        dynamics: Model = CalmWater(case.hull)
        if self.model is not None:
            dynamics = IdentifiedShip(case.hull, self.model.network, self.model.scaling)
        effects, left_out = self.candidates(case)
        settings = {
            "ship": case.hull.particulars.name,
            "model": str(self.cfg.model or "coefficients of the ship"),
            "candidates": ", ".join(e.name for e in effects),
            **versions(),
        }
        return Question(
            replace(case, undecided=(*case.undecided, *left_out)),
            dynamics,
            effects,
            settings,
            workers=self.cfg.workers,
            remainder=self.cfg.remainder,
            caveat=self.caveat,
        )

    def candidates(self, case: Case) -> tuple[list[Effect], list[str]]:
        """Candidates that a case can say something about.

        Returns:
            Prototypes of the effects, and a sentence for each reason to leave some out.

        Raises:
            InputError: If one that was asked for by name does not suit the ship, or none is left.
        """
        recorded = seen_channels(case.fitted) | {"delta"}
        made: list[Effect] = []
        unseen: list[Effect] = []
        unsuited: list[str] = []
        for name in self.wanted:
            try:
                effect = _prototype(self.shelf[name], case.hull)
            except InputError:
                if self.cfg.candidates not in (DEFAULT, TANK, ALL):
                    raise
                unsuited.append(name)
                continue
            (made if _can_be_seen(effect, recorded) else unseen).append(effect)
        if not made:
            raise InputError(
                f"candidates={self.cfg.candidates}: none of them can be seen in the channels of {case.name}"
            )
        said = [f"Not judged, for no channel shows it: {', '.join(e.name for e in unseen)}."] if unseen else []
        said += [f"Not judged, for the model gives no basis: {', '.join(unsuited)}."] if unsuited else []
        return made, said


def setup(cfg: DictConfig, model: IdentifiedShip | None = None) -> _Setup:
    """Check everything that concerns all cases, with a fitted model that is at hand or else that of the config."""
    caveat = ""
    shelf = {name: load_yaml(path) for name, path in options("effect", cfg.get("config_dir")).items()}
    if model is None and cfg.model is not None:
        # It brings Lightning, seconds that a ship's own model needs not.
        from manoeuvre_nn.commands.job import caveat_of, load_model, with_rate

        model = with_rate(load_model(Path(str(cfg.model))), "a diagnosis")
        caveat = caveat_of(Path(str(cfg.model)))
    chosen = cfg.candidates
    if chosen == DEFAULT and cfg.mapping is not None:
        given = configs.read_mapping(cfg.mapping, cfg.get("config_dir"))
        chosen = TANK if given is not None and given.place == TANK else DEFAULT
    return _Setup(cfg, shelf, wanted(chosen, shelf), model, caveat)


def wanted(chosen: Any, shelf: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """What ``candidates=`` chooses from conf/effect.

    Returns:
        Names of effects.

    Raises:
        InputError: If a name is unknown or cannot be fitted.
    """
    classes = {name: _class_of(entry) for name, entry in shelf.items()}
    possible = [name for name, kind in classes.items() if kind.fittable]
    listed = [name for name in possible if classes[name].candidate]
    if chosen == DEFAULT:
        return listed
    if chosen == TANK:
        return [name for name in listed if classes[name].acts_indoors]
    names = possible if chosen == ALL else configs.names(chosen)
    for name in names:
        check_choice("candidates:", name, possible)
    if not names:
        raise InputError("candidates=[] names no effect: write for instance candidates=[wind_steady,current]")
    return names


def _class_of(entry: Mapping[str, Any]) -> type[Effect]:
    return on_shelf(entry.get(TARGET), "effect")  # type: ignore[return-value]


def _prototype(entry: Mapping[str, Any], ship: Ship) -> Effect:
    """An effect with its choices as in conf/effect; values are for the fit to find."""
    values = {p.name for p in _class_of(entry).declared}
    return build({k: v for k, v in entry.items() if k not in values}, "effect", ship=ship)


def _can_be_seen(effect: Effect, recorded: set[str]) -> bool:
    """Whether it is more than an error of sensors that were not there."""
    sensors = {e.removeprefix(SENSOR) for e in effect.equations if e.startswith(SENSOR)}
    return len(sensors) < len(effect.equations) or bool(sensors & recorded)


def found_effects(d: Diagnosis, effects: Sequence[Effect], shelf: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Effects of the repaired model as entries of conf/effect with the values found, in the package's signs."""
    known = {e.name: e for e in effects}
    found: dict[str, Any] = {}
    for c in [c for c in d.causes if c.name in d.model]:
        if c.terms:
            weights = {name: float(f"{value:.6g}") for name, value in c.weights.items()}
            found[Formula.name] = {"terms": list(c.terms), **weights}
        else:
            choices = {name: value for name, value in shelf[c.name].items() if name != TARGET}
            found[c.name] = choices | _values(c, known[c.name])
    if d.network:
        found[Remainder.name] = dict(d.network)
    return found


def _values(cause: Cause, effect: Effect) -> dict[str, float]:
    """Values within the effect's bounds; times of an event are those of the first run that shows it."""
    found = {v.name: v.value for v in cause.parameters}
    half = 0.5 * found.get("ramp_s", 0.0)
    times = next((times for times in (cause.intervals or {}).values() if times), [])
    halfway = [t for start, end in times for t in (start + half, end - half)]
    found |= dict(zip([effect.declared[column].name for column in effect.timed], halfway, strict=False))
    bounds = {p.name: (p.low, p.high) for p in effect.declared}
    return {name: float(f"{np.clip(value, *bounds[name]):.6g}") for name, value in found.items()}


def write_effects(found: Mapping[str, Any], sentence: str, path: Path) -> None:
    """Write what was found, after a sentence on it, so that ``manoeuvre train effects=FILE`` sails with it."""
    text = yaml.safe_dump({"format": FORMAT, **found}, sort_keys=False, allow_unicode=True)
    said = harmless(" ".join(sentence.split()))
    write_file(path, f"# {said}\n# manoeuvre train ship=... effects={path.name}\n{text}")
