"""Damaged checkpoints of every fit, and damaged files beside them, opened by every command that opens one.

A checkpoint is changed by field, by byte or in its archive, or is a pickle that runs a command. It must be refused in
one line, or what comes of it must have finite numbers; changed weights are never taken for the stored ones. A folder
that ``compare`` is given with sound ones must leave their rows as they are.
"""

import csv
import json
import os
import pickle
import random
import shutil
import warnings
import zipfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import torch
import yaml
from robustness_attack import Ended, Outcome
from robustness_fields import SPOILT, changed, places
from robustness_runs import inputs, legal, typed

LIMIT_S = 180.0
MORE = "trainer.max_epochs=4"
FITS = (
    "train", "train backprop", "train ensemble", "train series", "train recursive", "train pitch", "train rbf",
    "train grnn",
)  # fmt: skip
KEPT = "scores.kept"
"""What the scores of a run are called while they are not to be found."""
OF_A_RUN = ("scores.json", "config.yaml", ".hydra/overrides.yaml", "error.txt")
"""Files of a run that ``compare`` reads."""
TEXTS = (b"", b"\xff\xfe\x00", b"[", b"null", b"7", b"[1, 2]", b'"x"', b"NaN", b'{"scores": NaN}', b"{" * 5000,
         b"- - -", b"a: &a [*a]", b"!!python/object/apply:os.system ['touch executed']", b"\x1b[2J\nx",
         b"9" * 5000)  # fmt: skip
"""What may stand in such a file."""
OTHERS = (0, 1.5, "\x1b[2J", 1e308, float("inf"), [[[]]], "${oc.env:HOME}", {"_target_": "os.system"}, 2**62, False)
"""What is put into a field beside :data:`.SPOILT`."""
OPENED: dict[str, Callable[[str, Path], tuple[str, ...]]] = {
    "resume": lambda fit, run: (*legal(fit), f"trainer.resume={run / 'checkpoints' / 'last.ckpt'}", MORE),
    "go on": lambda fit, run: (*legal(fit)[:-1], f"out={run}", MORE),
    "export": lambda fit, run: ("export", f"run={run / 'checkpoints' / 'last.ckpt'}", "format=python", "out=out/a.py"),
    "diagnose": lambda fit, run: (*legal("diagnose"), f"model={run / 'checkpoints' / 'last.ckpt'}"),
    "excite": lambda fit, run: (*legal("excite"), f"model={run / 'checkpoints' / 'last.ckpt'}"),
    "coefficients": lambda fit, run: ("coefficients", f"run={run}", "out=out"),
    "compare": lambda fit, run: ("compare", str(run), str(inputs() / "trained"), str(inputs() / "series"), "out=out"),
}  # fmt: skip
"""How a checkpoint is opened -> the command, of a fit and the folder of its run."""


def attack(number: int, seed: int, folder: Path) -> Outcome:
    """Damage a checkpoint, or the files beside it, and open it."""
    draw = random.Random(f"{seed} {number}")
    fit = FITS[number % len(FITS)]
    how = draw.choice([name for name in OPENED if name != "coefficients" or fit == "train series"])
    run = folder / "run"
    shutil.copytree(_trained(fit), run, ignore=shutil.ignore_patterns("figures", "tensorboard", "predictions"))
    ways = [_field, _field, _field, _field, _bytes, _archive, _pickled, _config]
    of_files = {"coefficients": _coefficients, "compare": draw.choice([_results, _results, _results, _other_folder])}
    damage = of_files[how] if how in of_files else draw.choice(ways)
    told = damage(run, draw, folder)
    what = f"{fit}, {told}, {how}"
    return _judged(typed(OPENED[how](fit, run), folder, LIMIT_S), what, folder, run)


@cache
def _trained(fit: str) -> Path:
    """The folder of a small run of a fit."""
    folder = inputs() / fit.replace(" ", "_")
    words = [*legal(fit)[:-1], f"out={folder}"]
    ended = typed(words, inputs(), 300)
    if ended.code:
        raise RuntimeError(f"{words}: {ended.err}")
    (folder / "scores.json").rename(folder / KEPT)  # so that the run is gone on with
    return folder


def _stored(run: Path) -> dict[str, Any]:
    content: dict[str, Any] = torch.load(run / "checkpoints" / "last.ckpt", weights_only=True)
    return content


def _field(run: Path, draw: random.Random, folder: Path) -> str:
    """Another value in one field."""
    content = _stored(run)
    place, value = draw.choice(list(places(content))), draw.choice((*SPOILT, *OTHERS))
    torch.save(changed(content, place, value), run / "checkpoints" / "last.ckpt")
    return f"{'.'.join(map(str, place))} = {str(value)[:40]!r}"


def _bytes(run: Path, draw: random.Random, folder: Path) -> str:
    """Bytes cut off, or a few of them others."""
    path = run / "checkpoints" / "last.ckpt"
    content = bytearray(path.read_bytes())
    if draw.random() < 0.4:
        size = draw.randrange(len(content))
        path.write_bytes(content[:size])
        return f"cut at byte {size}"
    spots = [draw.randrange(len(content)) for _ in range(draw.choice((1, 1, 5, 50)))]
    for spot in spots:
        content[spot] ^= 1 << draw.randrange(8)
    path.write_bytes(content)
    return f"{len(spots)} bits flipped"


def _archive(run: Path, draw: random.Random, folder: Path) -> str:
    """An entry of the archive removed, doubled, renamed, or made another's."""
    path = run / "checkpoints" / "last.ckpt"
    with zipfile.ZipFile(path) as archive:
        entries = [(info.filename, archive.read(info)) for info in archive.infolist()]
    k, how = (
        draw.randrange(len(entries)),
        draw.choice(("removed", "doubled", "renamed", "exchanged", "emptied", "packed")),
    )
    name, content = entries[k]
    if how == "removed":
        del entries[k]
    elif how == "doubled":
        entries.append((name, content[::-1]))
    elif how == "renamed":
        entries[k] = (draw.choice(("../../executed", "/tmp/executed", name + "x", " ")), content)
    elif how == "exchanged":
        entries[k] = (name, draw.choice(entries)[1])
    elif how == "emptied":
        entries[k] = (name, b"")
    packed = zipfile.ZIP_DEFLATED if how == "packed" else zipfile.ZIP_STORED
    with zipfile.ZipFile(path, "w", packed) as archive, warnings.catch_warnings(action="ignore"):
        for entry in entries:
            archive.writestr(*entry)
    return f"{name} {how}"


class _Runs:
    """An object whose unpickling runs a command."""

    def __init__(self, command: str) -> None:
        self.command = command

    def __reduce__(self) -> tuple[Any, tuple[str]]:
        return os.system, (self.command,)


def _pickled(run: Path, draw: random.Random, folder: Path) -> str:
    """A pickle that runs a command when it is opened by one who trusts it."""
    path, content = run / "checkpoints" / "last.ckpt", _stored(run)
    place = draw.choice(list(places(content)))
    hostile = changed(content, place, _Runs(f"touch {folder / 'executed'}"))
    how = draw.choice(("torch", "old torch", "pickle"))
    if how == "pickle":
        path.write_bytes(pickle.dumps(hostile))
    else:
        torch.save(hostile, path, _use_new_zipfile_serialization=how == "torch")
    return f"{how} with a command in {'.'.join(map(str, place))}"


def _config(run: Path, draw: random.Random, folder: Path) -> str:
    """Another value in one field of the config beside it, or half of the file."""
    path = run / "config.yaml"
    content = yaml.safe_load(path.read_text())
    if draw.random() < 0.2:
        path.write_bytes(path.read_bytes()[: draw.randrange(path.stat().st_size)])
        return "half a config"
    place = draw.choice(list(places(content)))
    value = draw.choice([v for v in (*SPOILT, *OTHERS) if not isinstance(v, torch.Tensor)])
    path.write_text(yaml.safe_dump(changed(content, place, value)))
    return f"config: {'.'.join(map(str, place))} = {str(value)[:40]!r}"


def _coefficients(run: Path, draw: random.Random, folder: Path) -> str:
    """Another value in one field of the coefficients that a series leaves."""
    path = run / "coefficients.json"
    content = json.loads(path.read_text())
    place = draw.choice(list(places(content)))
    value = draw.choice([v for v in (*SPOILT, *OTHERS) if not isinstance(v, torch.Tensor)])
    path.write_text(json.dumps(changed(content, place, value)))
    return f"coefficients: {'.'.join(map(str, place))} = {str(value)[:40]!r}"


def _results(run: Path, draw: random.Random, folder: Path) -> str:
    """Another value in one field of what a run left, or a file that is cut, foreign, a folder or not there."""
    (run / KEPT).rename(run / OF_A_RUN[0])
    path = run / draw.choice(OF_A_RUN)
    path.parent.mkdir(exist_ok=True)
    how = draw.choice(("field", "field", "field", "cut", "foreign", "foreign", "folder", "link", "missing"))
    content = path.read_bytes() if path.exists() else b""
    if how == "field" and path.suffix in {".json", ".yaml"}:
        found = yaml.safe_load(content)
        place = draw.choice(list(places(found)))
        value = draw.choice([v for v in (*SPOILT, *OTHERS, 2**1024 - 1) if not isinstance(v, torch.Tensor)])
        made = changed(found, place, value)
        path.write_text(json.dumps(made) if path.suffix == ".json" else yaml.safe_dump(made))
        return f"{path.name}: {'.'.join(map(str, place))} = {str(value)[:40]!r}"
    path.unlink(missing_ok=True)
    if how == "cut":
        path.write_bytes(content[: draw.randrange(len(content) + 1)])
    elif how == "folder":
        path.mkdir()
    elif how == "link":
        path.symlink_to(draw.choice((path.name, "nowhere", "/dev/zero")))
    elif how != "missing":
        path.write_bytes(draw.choice(TEXTS))
    return f"{path.name}: {how}"


def _other_folder(run: Path, draw: random.Random, folder: Path) -> str:
    """A folder of another command, or of none, in the place of the run."""
    shutil.rmtree(run)
    name = draw.choice(("runs", "cases", ""))
    if name:
        shutil.copytree(inputs() / name, run)
    else:
        run.mkdir()
    return f"{name or 'empty'} folder"


def _rows_left(folder: Path) -> bool:
    """Whether ``compare`` tells of the sound runs what their files say."""
    with (folder / "out" / "runs.csv").open(encoding="utf-8", newline="") as file:
        rows = {row["job"].rpartition("/")[2]: row for row in csv.DictReader(file)}
    sound = [inputs() / name for name in ("trained", "series")]
    told = {run.name: json.loads((run / "scores.json").read_text())["mean_dev_L"] for run in sound}
    return all(name in rows and abs(float(rows[name]["mean dev/L"]) / dev - 1) < 1e-9 for name, dev in told.items())


def _judged(ended: Ended, what: str, folder: Path, run: Path) -> Outcome:
    """What came of it."""
    lines = ended.err.splitlines()
    said = f"{what}: code {ended.code}: {' | '.join(lines)[-300:]}"
    if list(folder.rglob("executed*")):
        return Outcome("executed", said)
    if ended.code is None:
        return Outcome("hang", said)
    if ended.code == 0:
        flipped = "flipped" in what and not _same_weights(run, what)
        if what.endswith(", compare"):
            return Outcome("right answer" if _rows_left(folder) else "wrong", said)
        return Outcome("wrong" if flipped or not _finite(folder) else "right answer", said)
    if ended.code != 2 or "Traceback" in ended.err:
        return Outcome("traceback", said)
    clear = len(lines) == 1 and lines[0].startswith("error: ") and len(lines[0]) < 1000
    return Outcome("clear error" if clear and "\x1b" not in lines[0] else "wrong", said)


def _same_weights(run: Path, what: str) -> bool:
    """Whether a checkpoint that was taken in spite of flipped bits holds what was stored."""
    if "go on" in what:
        return True  # it has been gone over since, by the run that went on
    stored, own = _stored(_trained(what.partition(",")[0]))["state_dict"], _stored(run)["state_dict"]
    return all(bool((stored[name] == own[name]).all()) for name in stored)


def _finite(folder: Path) -> bool:
    """Whether what was written has numbers."""
    for path in [*(folder / "out").rglob("*.json"), *(folder / "run").glob("scores.json")]:
        found: list[str] = []
        json.loads(path.read_text(), parse_constant=found.append)
        if found:
            return False
    for path in (folder / "out").rglob("*.ckpt"):
        weights = torch.load(path, weights_only=True)["state_dict"]  # beside them, what is infinite before a first test
        if not all(bool(w.isfinite().all()) for name, w in weights.items() if name.startswith("dynamics.")):
            return False
    return not any("nan" in path.read_text() for path in (folder / "out").rglob("*.py"))
