"""Reading checkpoints without trusting them."""

import pickle
import warnings
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import torch
from pydantic import BaseModel, ConfigDict, Field
from torch import Tensor

from manoeuvre_nn import __version__
from manoeuvre_nn.core.data_files import read_as
from manoeuvre_nn.core.errors import InputError

VERSION_KEY, STOPPED_KEY = "manoeuvre_nn_version", "stopped"
"""Where a checkpoint says who wrote it, and why the optimizer had stopped: empty while it ran."""
MAX_COUNT = 10**9
"""Largest count of epochs, steps or samples in a checkpoint."""
Count = Annotated[int, Field(ge=0, le=MAX_COUNT)]
STRICT = ConfigDict(strict=True, arbitrary_types_allowed=True)


class _StoredWeights(BaseModel):
    """What a model is made from."""

    model_config = STRICT
    state_dict: dict[str, Tensor]


class _StoredCount(BaseModel):
    """How often something was begun and ended."""

    model_config = STRICT
    ready: Count
    started: Count
    processed: Count
    completed: Count


class _StoredEpochs(BaseModel):
    """Epochs, of this run and in all."""

    model_config = STRICT
    current: _StoredCount
    total: _StoredCount


class _StoredFitLoop(BaseModel):
    """Where Lightning was."""

    model_config = STRICT
    epoch_progress: _StoredEpochs


class _StoredLoops(BaseModel):
    """The loops of Lightning, of which one runs here."""

    model_config = STRICT
    fit_loop: _StoredFitLoop


class _StoredRun(BaseModel):
    """What a training is gone on with, beside the weights."""

    model_config = STRICT
    epoch: Count
    global_step: Count
    lightning: Annotated[str, Field(alias="pytorch-lightning_version")]
    optimizer_states: Annotated[list[dict[str, Any]], Field(min_length=1)]
    lr_schedulers: list[dict[str, Any]]
    loops: _StoredLoops
    callbacks: dict[str, dict[str, Any]]
    stopped: str = ""


def _check_sums(path: Path) -> None:
    """Refuse a file that is not what was written: torch does not look at the checksums that its archives hold."""
    try:
        if not zipfile.is_zipfile(path):  # torch itself refuses it, or reads an old form
            return
        with zipfile.ZipFile(path) as archive:
            damaged = archive.testzip()
    except Exception as error:  # damaged archives end in whatever they happen to cause
        raise InputError(f"checkpoint {path} cannot be read ({_first_line(error)})") from error
    if damaged is not None:
        raise InputError(f"checkpoint {path} is damaged: {damaged} is not what was written")


def read_checkpoint(path: Path) -> dict[str, Any]:
    """Read a checkpoint that holds tensors, numbers and names, and nothing that runs.

    Args:
        path: The file.

    Returns:
        What Lightning stored.

    Raises:
        InputError: If the file is missing, damaged, foreign, made by another major version, or holds code.
    """
    if not path.is_file():
        raise InputError(f"checkpoint {path} does not exist: write the path of a .ckpt file of an earlier run")
    _check_sums(path)
    try:
        with warnings.catch_warnings(action="ignore"):  # torch's, on files of old forms: they are refused or read
            stored = torch.load(path, map_location="cpu", weights_only=True)
    except pickle.UnpicklingError as error:
        raise InputError(
            f"checkpoint {path} is refused: it is damaged or holds objects that are not tensors, numbers or names "
            f"({_first_line(error)})"
        ) from error
    except Exception as error:  # torch meets bytes that are no checkpoint with whatever they happen to cause
        raise InputError(f"checkpoint {path} cannot be read ({_first_line(error)})") from error
    if not isinstance(stored, dict) or "state_dict" not in stored or VERSION_KEY not in stored:
        raise InputError(f"{path} is not a checkpoint of manoeuvre-nn: it lacks {VERSION_KEY}")
    version = str(stored[VERSION_KEY])
    if version.split(".")[:2] != __version__.split(".")[:2]:
        raise InputError(
            f"checkpoint {path} was made by manoeuvre-nn {version}, this is {__version__}: train anew, or install "
            f"manoeuvre-nn {version}"
        )
    read_as(_StoredWeights, stored, f"checkpoint {path} is damaged")
    return stored


def read_training(path: Path) -> dict[str, Any]:
    """Read a checkpoint to go on from, as :func:`read_checkpoint` does.

    Args:
        path: The file.

    Returns:
        What Lightning stored, each part of the kind that it must be.

    Raises:
        InputError: If a part is missing or of another kind, or its counts belong to different epochs.
    """
    stored, damaged = read_checkpoint(path), f"checkpoint {path} is damaged"
    run = read_as(_StoredRun, stored, damaged)
    counts = run.loops.fit_loop.epoch_progress.current
    if not {counts.ready, counts.started, counts.processed, counts.completed} <= {run.epoch, run.epoch + 1}:
        raise InputError(f"{damaged}: it is of epoch {run.epoch}, its counts are of others: {counts}")
    _check_counts(stored["loops"], damaged)
    _check_numbers(stored["optimizer_states"], damaged)
    return stored


def _check_counts(value: Any, damaged: str, place: str = "loops") -> None:
    """Refuse what is no count among counts."""
    if isinstance(value, Mapping):
        for key, inner in value.items():
            _check_counts(inner, damaged, f"{place}.{key}")
    elif not isinstance(value, int) or not 0 <= value <= MAX_COUNT:
        raise InputError(f"{damaged}: {place} is {str(value)[:40]!r}: expected a count")


def _check_numbers(value: Any, damaged: str, place: str = "optimizer_states") -> None:
    """Refuse NaN among what an optimizer keeps."""
    if isinstance(value, Mapping | list | tuple):
        for key, inner in value.items() if isinstance(value, Mapping) else enumerate(value):
            _check_numbers(inner, damaged, f"{place}.{key}")
    elif isinstance(value, float | Tensor) and torch.as_tensor(value).isnan().any():
        raise InputError(f"{damaged}: {place} is not a number: go on from an older checkpoint, or train anew")


def _first_line(error: Exception) -> str:
    """What an error says, or its kind where it says nothing."""
    return next(iter(str(error).splitlines()), type(error).__name__)[:120]


def load_weights(module: torch.nn.Module, path: Path) -> None:
    """Put a checkpoint's weights into a fit of the same shape.

    Args:
        module: The fit.
        path: The file.

    Raises:
        InputError: If the checkpoint cannot be used or belongs to another network.
    """
    stored = read_checkpoint(path)["state_dict"]
    check_weights(module, stored, path)
    try:
        module.load_state_dict(stored)
    except RuntimeError as error:
        lines = [line.strip() for line in str(error).splitlines() if line.strip()]
        raise InputError(
            f"checkpoint {path} is of another network: {lines[1] if len(lines) > 1 else lines[0]}"
        ) from error


def check_weights(module: torch.nn.Module, weights: Mapping[str, Tensor], path: Path) -> None:
    """Refuse weights of a checkpoint that are no numbers where the fit's own are.

    Args:
        module: The fit.
        weights: Name -> weights.
        path: The file, for the message.

    Raises:
        InputError: If one is NaN or infinite; the message names it.
    """
    for name, own in module.state_dict().items():
        stored = weights.get(name)
        if stored is None or not own.isfinite().all():  # what is infinite before the first epoch may stay so
            continue
        if not stored.isfinite().all():
            count = int((~stored.isfinite()).sum())
            raise InputError(
                f"checkpoint {path} is refused: {count} of {stored.numel()} numbers of {name} are NaN or infinite: use "
                "an older checkpoint, or train anew"
            )
