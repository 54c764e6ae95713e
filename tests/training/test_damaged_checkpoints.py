"""Checkpoints are changed field by field: each is refused in one line, or gone on with to finite weights."""

import copy
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
import tiny
import torch
from tiers import mainly

from benchmarks.robustness_fields import SPOILT, changed, places
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.training.checkpoint import load_weights

FITS = {"levenberg_marquardt": tiny.lm, "backprop": tiny.backprop}


@cache
def stored(kind: str) -> dict[str, Any]:
    with TemporaryDirectory() as folder:
        tiny.train(FITS[kind](), Path(folder), max_epochs=2)
        return torch.load(Path(folder, "checkpoints", "last.ckpt"), weights_only=True)


def endings(kind: str, every: int, tmp_path: Path) -> list[str]:
    """What comes of every so-maniest change: ``refused`` or ``right``."""
    content, ended = stored(kind), []
    changes = [(place, value) for place in places(content) for value in SPOILT]
    for number, (place, value) in enumerate(changes[::every]):
        path = tmp_path / f"{number}.ckpt"
        torch.save(changed(content, place, value), path)
        fit = FITS[kind]()
        try:
            load_weights(FITS[kind](), path)
            tiny.train(fit, tmp_path / str(number), max_epochs=3, resume=str(path))
        except InputError as error:
            assert "\n" not in str(error) and str(path) in str(error), (place, value)
            ended.append("refused")
        else:
            assert all(w.isfinite().all() for w in fit.dynamics.state_dict().values()), (place, value)
            ended.append("right")
    return ended


@pytest.mark.parametrize(("kind", "every"), mainly(1, [("backprop", 151), ("levenberg_marquardt", 131)]))
def test_a_changed_field_is_refused_in_one_line_or_does_no_harm(kind, every, tmp_path):
    ended = endings(kind, every, tmp_path)
    assert ended.count("refused") > 0.5 * len(ended) > 4


@pytest.mark.slow
@pytest.mark.parametrize("kind", FITS)
def test_every_field_changed_in_every_way_is_refused_or_does_no_harm(kind, tmp_path):
    ended = endings(kind, 1, tmp_path)
    print(f"{kind}: {len(ended)} changes, {ended.count('refused')} refused, {ended.count('right')} right")


def refusal(content: dict[str, Any], path: Path) -> str:
    torch.save(content, path)
    with pytest.raises(InputError) as refused:
        tiny.train(tiny.lm(), path.parent / "out", max_epochs=3, resume=str(path))
    return str(refused.value)


FITTED = ("optimizer_states", 0, "state", 0)
BATCHES = ("loops", "fit_loop", "epoch_loop.batch_progress", "total")
EPOCHS = ("loops", "fit_loop", "epoch_progress", "current")


@pytest.mark.parametrize(
    ("place", "value", "told"),
    [
        (("lr_schedulers",), [None], "lr_schedulers.0 is None"),
        (("lr_schedulers",), None, "lr_schedulers is None"),
        (("epoch",), None, "epoch is None"),
        (("epoch",), 7, "it is of epoch 7, its counts are of others"),
        ((*EPOCHS, "completed"), 10**8, "its counts are of others"),
        ((*BATCHES, "ready"), "x", "batch_progress.total.ready is 'x'"),
        (("pytorch-lightning_version",), 2.6, "version is 2.6"),
        (("pytorch-lightning_version",), "new", "cannot be gone on from (InvalidVersion"),
        (("optimizer_states",), [], "optimizer_states is []"),
        ((*FITTED, "mu"), torch.full((3,), torch.nan), "mu is not a number"),
        ((*FITTED, "nu"), torch.full((3,), -1.0), "nu >= 2"),
        ((*FITTED, "reason"), torch.full((3,), 99.0), "a known reason"),
        (("callbacks",), {}, "callbacks has no RolloutScore"),
        (("callbacks", "RolloutScore", "history"), [{"epoch": 1.0}], "a score lacks its epoch or"),
        (("callbacks", "BestAndLast", "best"), {"w": torch.zeros(1)}, "its best weights are of another network"),
    ],
)  # fmt: skip
def test_what_is_damaged_is_named(place, value, told, tmp_path):
    assert told in refusal(changed(stored("levenberg_marquardt"), place, value), tmp_path / "a.ckpt")


@pytest.mark.parametrize("where", [("state_dict",), ("callbacks", "BestAndLast", "best")])
@pytest.mark.parametrize("value", [torch.nan, torch.inf])
def test_weights_that_are_no_numbers_are_refused(where, value, tmp_path):
    content = copy.deepcopy(stored("levenberg_marquardt"))
    inner = content
    for key in where:
        inner = inner[key]
    inner["dynamics.network.output_weights"][0, 0, 0] = value
    told = refusal(content, tmp_path / "a.ckpt")
    assert "1 of 12 numbers of dynamics.network.output_weights are NaN or infinite: use an older checkpoint" in told


def test_a_whole_checkpoint_is_gone_on_with(tmp_path):
    torch.save(stored("levenberg_marquardt"), tmp_path / "a.ckpt")
    fit, again = tiny.lm(), tiny.lm()
    tiny.train(fit, tmp_path / "out", max_epochs=3, resume=str(tmp_path / "a.ckpt"))
    tiny.train(again, tmp_path / "again", max_epochs=3)
    assert all((a == b).all() for a, b in zip(tiny.weights(fit), tiny.weights(again), strict=True))


def test_an_archive_that_says_it_is_one_of_several_is_refused(tmp_path):
    """A flipped bit in the locator of its directory: the library raises where it only asks whether it is an archive."""
    path = tmp_path / "a.ckpt"
    torch.save(stored("levenberg_marquardt"), path)
    content = bytearray(path.read_bytes())
    disks = content.rindex(b"PK\x06\x07") + 16
    content[disks] ^= 2
    path.write_bytes(bytes(content))
    with pytest.raises(InputError, match=r"a\.ckpt cannot be read \(zipfiles that span multiple disks"):
        load_weights(tiny.lm(), path)
