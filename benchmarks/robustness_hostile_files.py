"""Files of others that name code: what stands in them, and where."""

import json
import pickle
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import torch
import yaml
from robustness_runs import inputs

PAYLOADS = (
    "os.system", "subprocess.run", "builtins.eval", "builtins.exec", "pathlib.Path.write_text", "pickle.loads",
    "torch.load",
    "hydra.utils.instantiate", "manoeuvre_nn.core.writing.write_file", "manoeuvre_nn.core.recording.Recording.to_csv",
    "manoeuvre_nn.report.html.write_report", "manoeuvre_nn.formulas.check.subprocess.run", "my_evil.run",
    "studies.concealed_trial.stages.answer", "manoeuvre_nn.training.data.recorded_files",
)  # fmt: skip
"""What a ``_target_`` names."""


GLOBAL = "# @package _global_\n"


class _Touches:
    """An object whose unpickling runs a command."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Any, tuple[str]]:
        import os

        return os.system, (f"touch {self.path}",)


class Place(NamedTuple):
    """Where a payload stands.

    Attributes:
        name: Of the place.
        command: The command that reads it.
        write: Writes it into a folder; what is given is the payload. Returns a word of the command line.
    """

    name: str
    command: str
    write: Callable[[Path, dict[str, Any]], str]


def hostile_files(folder: Path, asked: Sequence[str]) -> dict[str, str]:
    """Write what ``HOSTILE place target`` asks for.

    Args:
        folder: Folder of the attack.
        asked: Words.

    Returns:
        Word -> what to type instead.
    """
    made = {}
    for word in asked:
        place, target = word.removeprefix("HOSTILE ").rsplit(" ", 1)
        (folder / "my_evil.py").write_text(f"from pathlib import Path\nPath({str(folder / 'executed')!r}).touch()\n")
        payload = {
            "_target_": target,
            "path": str(folder / "canary.txt"),
            "content": "theirs",
            "args": "touch executed",
        }
        made[word] = next(p for p in FOLDERS if p.name == place).write(folder, payload)
    return made


def _run_with(folder: Path, change: Callable[[dict[str, Any]], None], trained: str = "trained") -> Path:
    """A copy of a trained run with another config beside its checkpoint."""
    shutil.copytree(inputs() / trained, folder / "run", ignore=shutil.ignore_patterns("figures", "tensorboard"))
    cfg = yaml.safe_load((folder / "run" / "config.yaml").read_text())
    change(cfg)
    (folder / "run" / "config.yaml").write_text(yaml.safe_dump(cfg))
    return folder / "run" / "checkpoints" / "best.ckpt"


def _in_own(group: str, text: Callable[[dict[str, Any]], str]) -> Callable[[Path, dict[str, Any]], str]:
    """A file in a folder of one's own; it is chosen."""

    def write(folder: Path, payload: dict[str, Any]) -> str:
        (folder / "theirs" / group).mkdir(parents=True)
        shutil.copy(folder / "my_evil.py", folder / "theirs")
        (folder / "theirs" / group / "mine.yaml").write_text(text(payload))
        return f"--config-dir={folder / 'theirs'}"

    return write


def _pickled(folder: Path, payload: dict[str, Any]) -> str:
    path = folder / "a.ckpt"
    (torch.save if payload["_target_"] > "n" else lambda o, p: Path(p).write_bytes(pickle.dumps(o)))(
        {"state_dict": {}, "manoeuvre_nn_version": _Touches(folder / "executed")}, path
    )
    return f"trainer.resume={path}"


def _mapping(setting: str, wrap: Callable[[dict[str, Any]], Any]) -> Callable[[Path, dict[str, Any]], str]:
    def write(folder: Path, payload: dict[str, Any]) -> str:
        (folder / "map.yaml").write_text(yaml.safe_dump(wrap(payload)))
        return f"{setting}={folder / 'map.yaml'}"

    return write


def _manifest(folder: Path, payload: dict[str, Any]) -> str:
    shutil.copytree(inputs() / "cases", folder / "cases")
    path = folder / "cases" / "one" / "manifest.json"
    good = json.loads(path.read_text())
    path.write_text(json.dumps(good | {"ship": payload, "particulars": payload, "runs": [*good["runs"], payload]}))
    return f"cases={folder / 'cases' / 'one'}"


def _yaml(content: Any) -> str:
    return yaml.safe_dump(content)


_captive = _mapping("captive.mapping", lambda payload: payload)
FOLDERS = (
    Place("effects", "simulate", _mapping("effects", lambda p: {"current": {"speed": p}})),
    Place("effects itself", "simulate", _mapping("effects", lambda p: {"current": p})),
    Place("mapping", "train recordings", _mapping("data.mapping", lambda p: p)),
    Place("mapping of time", "check", _mapping("data.mapping", lambda p: {"time": p, "channels": {"u": p}})),
    Place("tag", "check", lambda f, p: _tagged(f, p, "data.mapping")),
    Place("captive", "coefficients", lambda f, p: f"{_captive(f, p)} captive.file=empty"),
    Place("diagnosis mapping", "diagnose", _mapping("mapping", lambda p: {**p, "time": {"column": "t", "unit": "s"}})),
    Place("beside model=", "diagnose", lambda f, p: f"model={_run_with(f, lambda c: c.update(network=p))}"),
    Place("beside excite", "excite", lambda f, p: f"model={_run_with(f, lambda c: c['ship'].update(deep=p))}"),
    Place("beside run=", "export", lambda f, p: f"run={_run_with(f, lambda c: c.update(ship=p))}"),
    Place("in fit", "export", lambda f, p: f"run={_run_with(f, lambda c: c['fit'].update(damping=p))}"),
    Place("plugins", "export", lambda f, p: f"run={_run_with(f, lambda c: c.update(plugins=['my_evil'], linear=p))}"),
    Place("checkpoint", "train", _pickled),
    Place("ship", "train", lambda f, p: f"ship={_in_line(p)}"),
    Place("word", "train", lambda f, p: f"network._target_={p['_target_']}"),
    Place("manoeuvre", "simulate", lambda f, p: f"+manoeuvre.x={_in_line(p)}"),
    Place("effect", "simulate", lambda f, p: f"+effect.x={_in_line(p)}"),
    Place("fit", "train", lambda f, p: f"fit._target_={p['_target_']}"),
    Place("score", "train", lambda f, p: f"score=[{{zz20: {_in_line(p)}}}]"),
    Place("hydra", "simulate", _in_own("ship", lambda p: GLOBAL + _yaml({"hydra": {"callbacks": {"a": p}}}))),
    Place("plugins of own", "simulate", _in_own("ship", lambda p: GLOBAL + _yaml({"plugins": ["my_evil"], "a": p}))),
    Place("launcher", "sweep", _in_own("hydra/launcher", _yaml)),
    Place("manifest", "diagnose cases", _manifest),
)  # fmt: skip
"""Every place where a file or a word might name code."""


def _in_line(payload: dict[str, Any]) -> str:
    """As hydra's grammar has it."""
    return "{" + ", ".join(f"{key}: '{value}'" for key, value in payload.items()) + "}"


def _tagged(folder: Path, payload: dict[str, Any], setting: str) -> str:
    (folder / "map.yaml").write_text(
        f"time: !!python/object/apply:{payload['_target_']} ['touch executed']\nchannels: {{}}\n"
    )
    return f"{setting}={folder / 'map.yaml'}"
