"""Disks that are full or read-only, under every command: one line, nothing half-written, nothing lost.

A disk is full when a file reaches a size (as ``tests/full_disk.py`` makes it), or it is a small file system in memory
that has no room or no inodes left; it is read-only by how it is mounted, or for a user who may not write. Mounting
needs root and a mount namespace: where there is none, the attack is refused, and only the first kind can be made.

Half of the disks hold what the same command has written before, which is to be written again.
"""

import codecs
import ctypes
import json
import os
import resource
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Literal

import torch
import yaml
from PIL import Image
from robustness_attack import BAD, Outcome
from robustness_runs import LEGAL, inputs, legal, typed

COMMANDS = tuple(
    name for name in LEGAL if name not in {"train backprop", "train rbf", "train grnn", "train recordings"}
)
LIMIT_S = 300.0
CLONE_NEWNS = 0x20000
NOBODY = 65534
OF_PARTS = {"sweep", "diagnose cases", "reproduce"}
"""Commands that go on where a part fails, say so, and end with code 1."""
LEFT_OUT = {"scores.json", "answer.json", "excite.json", "commitments.json", "scoreboard.json"}
"""Files that say that a command was finished: without them it does its work again."""


@dataclass(frozen=True)
class _Disk:
    """A disk.

    Attributes:
        kind: ``file``: no file may be larger; ``room``: no more may be written; ``inodes``: no more files may be made;
            ``read-only``; ``nobody``: of a user who may not write.
        size: Bytes, or number of files.
        before: Whether it holds what the same command has written before.
    """

    kind: Literal["file", "room", "inodes", "read-only", "nobody"]
    size: int = 0
    before: bool = False


DISKS = (
    _Disk("file", 0), _Disk("file", 100), _Disk("file", 3000), _Disk("file", 30_000), _Disk("file", 30_000, True),
    _Disk("file", 200_000), _Disk("file", 200_000, True), _Disk("room", 4096), _Disk("room", 16_384),
    _Disk("room", 65_536),
    _Disk("room", 65_536, True), _Disk("room", 262_144), _Disk("room", 524_288, True), _Disk("room", 1_048_576),
    _Disk("inodes", 1), _Disk("inodes", 4), _Disk("inodes", 8, True), _Disk("read-only"), _Disk("read-only", 0, True),
    _Disk("nobody", 0, True),
)  # fmt: skip


def attack(number: int, seed: int, folder: Path) -> Outcome:
    """Run every command on a disk; the worst that comes of it."""
    disk = DISKS[number % len(DISKS)]
    outcomes = [_on(disk, name, folder / name.replace(" ", "_")) for name in COMMANDS]
    return next((o for o in outcomes if o.result in BAD), outcomes[0])


def _on(disk: _Disk, name: str, place: Path) -> Outcome:
    """Run a command on a disk."""
    place.mkdir()
    good = written(name) if disk.before else None
    with_disk = _mounted if disk.kind in {"room", "inodes", "read-only"} else _plain
    what = f"{disk}, {name}"
    return with_disk(disk, place, good, lambda: _made(disk, name, place, what))


@cache
def written(name: str) -> Path:
    """What a command writes on a good disk."""
    folder = inputs() / "written" / name.replace(" ", "_")
    folder.mkdir(parents=True)
    ended = typed(legal(name), folder, LIMIT_S)
    if ended.code:
        raise RuntimeError(f"{name}: {ended.err}")
    for path in folder.rglob("*"):
        if path.name in LEFT_OUT:
            path.unlink()
    return folder


def _plain(disk: _Disk, place: Path, good: Path | None, made: Callable[[], Outcome]) -> Outcome:
    """A folder, with what was written before."""
    if good is not None:
        shutil.copytree(good, place, dirs_exist_ok=True)
    return made()


def _mounted(disk: _Disk, place: Path, good: Path | None, made: Callable[[], Outcome]) -> Outcome:
    """A file system in memory, with what was written before and room for so much more."""
    _alone()
    _mount("-t", "tmpfs", "-o", "size=1g,nr_inodes=100k", "tmpfs", str(place))
    try:
        if good is not None:
            shutil.copytree(good, place, dirs_exist_ok=True)
        now = os.statvfs(place)
        room = (now.f_blocks - now.f_bfree) * now.f_frsize + disk.size
        files = now.f_files - now.f_ffree + disk.size
        limit = {"room": f"size={room}", "inodes": f"nr_inodes={files}", "read-only": "ro"}[disk.kind]
        _mount("-o", f"remount,{limit}", str(place))
        return made()
    finally:
        subprocess.run(["umount", "-l", str(place)], check=True)


def _mount(*words: str) -> None:
    subprocess.run(["mount", *words], check=True)


@cache
def _alone() -> None:
    """Take this process out of the others' mounts: what it mounts ends with it."""
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.unshare(CLONE_NEWNS):
        raise SystemExit(f"error: {os.strerror(ctypes.get_errno())}: small disks need root and a mount namespace")
    _mount("--make-rprivate", "/")


def _made(disk: _Disk, name: str, place: Path, what: str) -> Outcome:
    """Run the command, and look at what it leaves; what it prints is kept elsewhere."""
    before = _hashes(place)
    for folder in (place.parent, inputs()):
        folder.chmod(0o755)  # for a user who may read
    pipes = [os.pipe(), os.pipe()]
    ended = typed(legal(name), place, LIMIT_S, lambda: _prepare(disk, pipes), texts=place.parent)
    out, err = (_heard(*pipe) for pipe in pipes)
    said = f"{what}: code {ended.code}: {' | '.join(err)[-400:]}"
    wrong = damage(before, place) or (missing(name, place) if ended.code == 0 else "")
    if ended.code is None:
        return Outcome("hang", said)
    if wrong:
        return Outcome("wrong", f"{said}: {wrong}")
    if ended.code == 0:
        return Outcome("right answer", said)
    if name in OF_PARTS and ended.code == 1 and any("failed: cannot write" in line for line in out):
        return Outcome("clear error", said)
    errors = [line for line in err if line.startswith("error: ")]
    alone = len(errors) == 1 and (len(err) == 1 or name == "trial")  # which tells how far it is
    if ended.code == 2 and alone and "Traceback" not in said:
        return Outcome("clear error", said)
    return Outcome(
        "traceback" if ended.code not in {0, 2} or "Traceback" in said else "wrong", said + "".join(out[-2:])
    )


def _heard(reads: int, writes: int) -> list[str]:
    """Lines that came through a pipe."""
    os.close(writes)
    with os.fdopen(reads, errors="replace") as told:
        return told.read().splitlines()


def _prepare(disk: _Disk, pipes: list[tuple[int, int]]) -> None:
    """In the process of the command: what it prints goes to no files, whose size would be limited too."""
    for number, (_, writes) in zip((1, 2), pipes, strict=True):
        os.dup2(writes, number)
    if disk.kind == "file":
        resource.setrlimit(resource.RLIMIT_FSIZE, (disk.size, disk.size))
    elif disk.kind == "nobody":
        codecs.lookup("utf-8-sig")  # the interpreter itself may lie where this user reads nothing
        os.setresgid(NOBODY, NOBODY, NOBODY)
        os.setresuid(NOBODY, NOBODY, NOBODY)


def _hashes(place: Path) -> dict[str, str]:
    """File -> what it holds."""
    files = (path for path in sorted(place.rglob("*")) if path.is_file())
    return {str(path.relative_to(place)): sha256(path.read_bytes()).hexdigest() for path in files}


def damage(before: dict[str, str], place: Path) -> str:
    """What is lost, left over or half-written; empty if nothing is."""
    after = _hashes(place)
    lost = sorted(set(before) - set(after))
    if lost:
        return f"{lost[0]} is lost"
    for name in after:
        if name.endswith((".part", ".lock")):
            return f"{name} is left"
        if after[name] != before.get(name) and not _whole(place / name):
            return f"{name} is half-written"
    return ""


def missing(name: str, place: Path) -> str:
    """A file that the command writes on a good disk, and has not written here though it says that all is well."""
    wanted = {path.relative_to(written(name)) for path in written(name).rglob("*") if path.is_file()}
    absent = sorted(str(path) for path in wanted if "tfevents" not in path.name and not (place / path).exists())
    return f"{absent[0]} is missing" if absent else ""


def _whole(path: Path) -> bool:
    """Whether a file is complete; logs are written line by line."""
    content = path.read_bytes()
    try:
        if path.suffix in {".json", ".yaml"}:
            (json.loads if path.suffix == ".json" else yaml.safe_load)(content)
        elif path.suffix == ".png":
            Image.open(path).load()
        elif path.suffix == ".ckpt":
            torch.load(path, weights_only=True)
        elif path.suffix == ".csv":
            return content.endswith(b"\n")
    except (ValueError, OSError, SyntaxError, RuntimeError, yaml.YAMLError):
        return False
    return path.suffix != ".html" or content.rstrip().endswith(b"</html>")
