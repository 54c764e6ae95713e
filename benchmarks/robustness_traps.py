"""Files that would run something or never end, where settings are expected."""

from functools import partial
from pathlib import Path

import numpy as np
from robustness_oracle import Tried

import manoeuvre_nn as mnn
from manoeuvre_nn.commands import config as configs
from manoeuvre_nn.commands.groups import compose
from manoeuvre_nn.commands.shelves import build
from manoeuvre_nn.diagnosis.case import read_case
from manoeuvre_nn.ship.great_lakes_bulker import great_lakes_bulker
from manoeuvre_nn.ship.mariner import mariner_corrected

CANARY = "canary"
"""File that what must not be run would make."""
TRAPS = (
    "!!python/object/apply:os.system ['touch {canary}']",
    "!!python/object/new:os.system ['touch {canary}']",
    "!!python/object/apply:subprocess.check_output [['touch', '{canary}']]",
    "!!python/name:os.system",
    "!!python/module:os",
    "{{_target_: os.system, command: 'touch {canary}'}}",
    "{{_target_: subprocess.call, _args_: [['touch', '{canary}']]}}",
    "{{_target_: manoeuvre_nn.core.recording.Recording.to_csv, path: '{canary}'}}",
    "{{_target_: manoeuvre_nn.commands.groups.accept, cfg: {{plugins: [evil], config_dir: '{folder}'}}}}",
    "{{plugins: [evil], config_dir: '{folder}'}}",
    "'${{oc.env:HOME}}'",
    "'${{oc.create:{{_target_: os.system}}}}'",
    "'$(touch {canary})'",
    "'`touch {canary}`; touch {canary}'",
    "&a [*a]",
    "[[[[[[[[[[" * 300,
    "{{<<: &b {{x: 1}}, y: *b}}",
    "\x1b]0;mine\x07\x1b[2J",
    "2020-99-99",
    "!!int ''",
    "!!timestamp x",
    "!!set {{a, b}}",
    "!!binary aGVsbG8=",
    "\ud7ff",
    "? [a, b]\n: c",
    "9" * 5000,
    "0x" + "f" * 5000,
    "@",
    "|",
    "%",
)
"""What stands in place of a value. The folder holds evil.py, which would make the canary."""


def trap(rng: np.random.Generator, folder: Path) -> Tried:
    """A file that would run something, or never end."""
    (folder / "evil.py").write_text(f"open({str(folder / CANARY)!r}, 'w')\n")
    text = str(rng.choice(TRAPS)).format(canary=folder / CANARY, folder=folder)
    where = str(rng.choice(["mapping", "effects", "manoeuvre", "ship", "manifest", "config_dir", "bomb"]))
    if where == "bomb":
        text = "a0: &a0 [x]\n" + "\n".join(f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]" for k in range(1, 12))
    path = {"manoeuvre": "manoeuvre/mine.yaml", "config_dir": "ship/mine.yaml", "manifest": "manifest.json"}
    place = folder / path.get(where, "mine.yaml")
    key = str(rng.choice(["rudder_deg", "speed", "current", "channels", "time", "_target_", "defaults", "hydra", "a"]))
    place.parent.mkdir(exist_ok=True)
    place.write_text(text if where == "bomb" or rng.random() < 0.3 else f"{key}: {text}\n", encoding="utf-8")
    return Tried(f"{where}: {key}: {text[:60]!r}", partial(_opens, where, folder, place), "refuse", ())


def _opens(where: str, folder: Path, place: Path) -> str:
    """Open a file as commands do."""
    if where in {"mapping", "bomb"}:
        configs.read_mapping(str(place))
    elif where == "effects":
        (entry,) = configs.read_effects(place).values()
        build(entry, "effect", ship=mariner_corrected())
    elif where == "manoeuvre":
        mnn.simulate(great_lakes_bulker(), configs.named_manoeuvres(["mine"], None, str(folder)))
    elif where == "ship":
        mnn.read("none.csv", ship=str(place))
    elif where == "manifest":
        read_case(folder)
    else:
        build(compose("check", [f"config_dir={folder}", "ship=mine"]).ship, "ship")
    return "accepted"
