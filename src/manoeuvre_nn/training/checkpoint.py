"""Reading checkpoints without trusting them."""

import pickle
from pathlib import Path
from typing import Any

import torch

from manoeuvre_nn import __version__
from manoeuvre_nn.core.errors import InputError

VERSION_KEY = "manoeuvre_nn_version"


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
    try:
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
    return stored


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
    stored = read_checkpoint(path)
    try:
        module.load_state_dict(stored["state_dict"])
    except RuntimeError as error:
        lines = [line.strip() for line in str(error).splitlines() if line.strip()]
        raise InputError(
            f"checkpoint {path} is of another network: {lines[1] if len(lines) > 1 else lines[0]}"
        ) from error
