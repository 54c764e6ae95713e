"""This package's own method: states and coefficients together, in closed loop with what was recorded."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import yaml

from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.dynamics.model import IdentifiedShip
from manoeuvre_nn.dynamics.replay import replay
from manoeuvre_nn.estimation.accelerations import accelerations
from manoeuvre_nn.network.series import Series, SeriesSettings
from manoeuvre_nn.ship.known import clarke_inertia_part
from manoeuvre_nn.training.closed_loop_fit import fit_series

CONF = Path(__file__).parents[1] / "conf" / "network"
CALM = {"wind_speed", "wind_from"}


def settings(name: str, wind: bool) -> dict[str, Any]:
    """Settings of a series as users have them.

    Args:
        name: Name of its file in conf/network.
        wind: Whether its products of the wind are kept.

    Returns:
        Arguments of :class:`Series`.
    """
    given = yaml.safe_load((CONF / f"{name}.yaml").read_text())["network"]
    kept = {k: v for k, v in given.items() if k not in {"_target_", "scaling", "dtype"}}
    return kept if wind else {**kept, "wind_surge": [], "wind_lateral": []}


@dataclass(frozen=True)
class ClosedLoopSeries:
    """``network=cubic fit=closed_loop``, with everything as it is by default.

    Attributes:
        network: Name of the series.
    """

    network: str = "cubic"

    def fit(self, recordings: list[Recording], ship: Particulars, wind: bool) -> "Replayed":
        """Fit.

        Args:
            recordings: Training runs.
            ship: The ship.
            wind: Whether the recorded wind is used.

        Returns:
            The model.
        """
        series = Series(SeriesSettings(**settings(self.network, wind)))
        model, _ = fit_series(series, clarke_inertia_part(ship), [_seen(r, wind) for r in recordings])
        return Replayed(model, wind)


@dataclass(frozen=True)
class Replayed:
    """A model that is driven by what was recorded.

    Attributes:
        model: The model.
        wind: Whether the recorded wind blows.
    """

    model: IdentifiedShip
    wind: bool

    def predict(self, recording: Recording) -> Recording:
        """Run from the recording's first smoothed state with its rudder, shaft and wind.

        Args:
            recording: What was recorded.

        Returns:
            The prediction.
        """
        (made,) = replay(self.model, [accelerations(_seen(recording, self.wind), "smoother")])
        return made


def _seen(recording: Recording, wind: bool) -> Recording:
    """The recording with or without its wind."""
    if wind:
        return recording
    return replace(recording, channels={k: v for k, v in recording.channels.items() if k not in CALM})
