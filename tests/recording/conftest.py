"""A Mariner's zigzag as a file, so that it can be spoilt in every way."""

from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pytest

from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.recording.read.mapping import Mapping, mapping

UNITS = {"u": "m/s", "v": "m/s", "r": "rad/s", "x": "m", "y": "m", "psi": "rad", "delta": "rad"}


@pytest.fixture
def frame(zz20: Recording) -> pd.DataFrame:
    return pd.DataFrame({"t": zz20.time, **{k: zz20[k] for k in UNITS}})


@pytest.fixture
def write(tmp_path: Path) -> Callable[[pd.DataFrame | str | bytes], Path]:
    def to_file(content: pd.DataFrame | str | bytes) -> Path:
        path = tmp_path / "run.csv"
        if isinstance(content, pd.DataFrame):
            content.to_csv(path, index=False)
        elif isinstance(content, bytes):
            path.write_bytes(content)
        else:
            path.write_text(content)
        return path

    return to_file


@pytest.fixture
def columns() -> Callable[..., Mapping]:
    """A mapping of the plain file, some settings changed; ``channels`` are laid over, None takes one out."""

    def build(channels: dict | None = None, **settings: object) -> Mapping:
        named: dict = {k: {"column": k, "unit": unit} for k, unit in UNITS.items()} | (channels or {})
        kept = {k: v for k, v in named.items() if v is not None}
        return mapping(**{"time": {"column": "t", "unit": "s"}, "channels": kept, **settings})

    return build
