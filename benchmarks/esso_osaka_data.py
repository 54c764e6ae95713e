"""The free-running Esso Osaka: its recordings with wind, and closed-loop runs with what was recorded.

Every method is given the same things: recordings with the channels of the mapping and ``wind_speed`` [m/s] and
``wind_from`` (true, where it comes from, clockwise from x) [rad]; and of the run that is to be predicted the smoothed
state at its first sample, its rudder, its shaft speed and, with the wind on, its wind.
"""

import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import numpy as np
import pandas as pd
import yaml
from jaxtyping import Float

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.estimation.accelerations import accelerations
from manoeuvre_nn.recording.local_cubics import smoothed
from manoeuvre_nn.recording.read.mapping import mapping
from manoeuvre_nn.recording.read.reader import read_recordings
from manoeuvre_nn.ship.esso_osaka_model import esso_osaka_model

CONF = Path(__file__).parents[1] / "conf" / "recording" / "esso_osaka.yaml"
WIND = {"wind_speed": "wind_velo_true [m/s]", "wind_from": "wind_dir_true [rad]"}
"""Channel -> column, as long as the mapping does not name them."""
STEP = 0.2
"""Step of the closed-loop runs [s]: a fortieth of L/U0."""
GUST = 3.0
"""Window that the wind is smoothed over [s]: what is faster does not reach the whole ship at once."""
FASTEST = (1.5, 1.0, 0.3)
"""Speeds that no run comes near: |u|, |v| [m/s], |r| [rad/s]; a prediction that passes them has broken down."""

Series = Float[np.ndarray, " n"]
Rate = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""u, v, r and (delta, n, relative wind from ahead, from starboard) -> their rates."""


class Predictor(Protocol):
    """A fitted method."""

    def predict(self, recording: Recording) -> Recording:
        """Predict a run from its first sample with its rudder, shaft and wind."""
        ...


class Method(Protocol):
    """A way to make a model out of recordings."""

    def fit(self, recordings: list[Recording], ship: Particulars, wind: bool) -> Predictor:
        """Make a model out of recordings; ``wind`` says whether it may use that."""
        ...


def read_group(group: str) -> list[Recording]:
    """Read one kind of runs.

    Args:
        group: ``zigzag``, ``turning``, ``random`` or ``berthing``.

    Returns:
        Recordings with wind, in the order of their names; ``meta["group"]`` is the group.

    Raises:
        InputError: If RECORDINGS does not say where they are.
    """
    if not os.environ.get("RECORDINGS"):
        raise InputError("RECORDINGS is not set: write RECORDINGS=FOLDER with the folder esso-osaka-frt")
    folder = Path(os.environ["RECORDINGS"]) / "esso-osaka-frt" / group
    settings = mapping(**yaml.safe_load(CONF.read_text()))
    return [_with_wind(r, group) for r in read_recordings(folder, settings, esso_osaka_model())]


def _with_wind(recording: Recording, group: str) -> Recording:
    """The recording with the recorder's true wind, if the mapping has not read it."""
    recording = replace(recording, meta={**recording.meta, "group": group})
    if set(WIND) <= set(recording.channels):
        return recording
    table = pd.read_csv(recording.meta["source"])
    return recording.with_channels(**{k: table[c].to_numpy(float) for k, c in WIND.items()})


def smooth(recording: Recording, step: float) -> Recording:
    """Smoothed channels with accelerations, and the wind's components, at even times.

    Args:
        recording: As read.
        step: Time between samples [s].

    Returns:
        The recording with udot, vdot, rdot and ``wind_north``, ``wind_east``: the true wind's components, positive
        where it comes from north and east [m/s].
    """
    made = accelerations(recording, "smoother").with_channels(**_components(recording))
    return made.resampled(np.arange(made.time[0], made.time[-1] + 1e-9, step))


def _components(recording: Recording) -> dict[str, Series]:
    """The true wind from north and from east [m/s], without its fastest gusts."""
    speed, angle = recording["wind_speed"], recording["wind_from"]
    north, east = (smoothed(recording.time, speed * f(angle), GUST)[0] for f in (np.cos, np.sin))
    return {"wind_north": north, "wind_east": east}


def relative(psi: Series, u: Series, v: Series, north: Series, east: Series) -> tuple[Series, Series]:
    """The wind that is felt on board.

    Args:
        psi: Heading [rad].
        u: Surge velocity [m/s].
        v: Sway velocity [m/s].
        north: True wind from north [m/s].
        east: True wind from east [m/s].

    Returns:
        Relative wind from ahead and from starboard [m/s].
    """
    cos, sin = np.cos(psi), np.sin(psi)
    return north * cos + east * sin + u, east * cos - north * sin + v


@dataclass(frozen=True)
class ClosedLoop:
    """Velocities and track from accelerations that depend on velocities, rudder, shaft and wind; fourth-order steps.

    Attributes:
        rate: The accelerations.
        wind: Whether the recorded wind blows; still air otherwise.
        step: Step [s].
    """

    rate: Rate
    wind: bool
    step: float = STEP

    def predict(self, recording: Recording) -> Recording:
        """Run from the recording's first state with its rudder, shaft and wind.

        Args:
            recording: What was recorded.

        Returns:
            The prediction at the recording's times.
        """
        given = smooth(recording, 0.5 * self.step)
        helm = given.stacked("delta", "n", "wind_north", "wind_east")
        helm[:, 2:] *= self.wind
        state = given.stacked("u", "v", "r", "x", "y", "psi")[0]
        states = [state]
        for k in range(0, len(helm) - 2, 2):
            state = self._step(state, helm[k : k + 3])
            states.append(state)
            if (np.abs(state[:3]) > FASTEST).any():
                break
        return as_recording(recording, given.time[0] + self.step * np.arange(len(states)), np.array(states))

    def _step(self, state: np.ndarray, helm: np.ndarray) -> np.ndarray:
        """One step of Runge and Kutta."""
        h = self.step
        a = self._rates(state, helm[0])
        b = self._rates(state + 0.5 * h * a, helm[1])
        c = self._rates(state + 0.5 * h * b, helm[1])
        d = self._rates(state + h * c, helm[2])
        return state + h / 6 * (a + 2 * b + 2 * c + d)

    def _rates(self, state: np.ndarray, helm: np.ndarray) -> np.ndarray:
        """Rates of u, v, r, x, y, psi."""
        u, v, r, _, _, psi = state
        ahead, across = relative(psi, u, v, helm[2], helm[3])
        cos, sin = np.cos(psi), np.sin(psi)
        nudot = self.rate(state[:3], np.array([helm[0], helm[1], ahead, across]))
        return np.array([*nudot, u * cos - v * sin, u * sin + v * cos, r])


def as_recording(recording: Recording, times: Series, states: Float[np.ndarray, "m 6"]) -> Recording:
    """States over time as a prediction of a recording.

    Args:
        recording: What was recorded.
        times: Times of the states [s]; where they end early by more than a step the prediction has broken down.
        states: u, v, r, x, y, psi.

    Returns:
        The prediction at the recording's times, with its rudder and shaft; a broken one ends where it broke.
    """
    kept = recording.time[: max(int(np.searchsorted(recording.time, times[-1] + 1e-9, side="right")), 2)]
    broken = (np.abs(states[-1, :3]) > FASTEST).any() or not np.isfinite(states[-1]).all()
    status = f"left the range of any run at {times[-1]:.0f} s" if broken else "ok"
    if not broken:
        kept = recording.time
    names = ("u", "v", "r", "x", "y", "psi")
    channels = {k: np.interp(kept, times, states[:, i]) for i, k in enumerate(names)}
    held = {k: recording[k][: len(kept)] for k in ("delta", "n")}
    return Recording(recording.name, kept, {**channels, **held}, status, recording.meta)


def mirrored(recording: Recording) -> Recording:
    """The same run on the other side.

    Args:
        recording: With any of the channels of this module.

    Returns:
        v, r, rudder, heading, y and the wind from east with the opposite sign.
    """
    odd = ("v", "r", "y", "psi", "delta", "vdot", "rdot", "wind_east", "wind_from")
    return recording.with_channels(**{k: -recording[k] for k in odd if k in recording.channels})
