"""Recordings that are at hand, not in files, as a data module."""

from collections.abc import Sequence
from dataclasses import replace

from manoeuvre_nn.core.channels import ACCELERATION
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.ship import Particulars, Ship
from manoeuvre_nn.estimation.accelerations import accelerations
from manoeuvre_nn.recording.check.checks import check_recording
from manoeuvre_nn.scoring.held_out import HeldOut
from manoeuvre_nn.training.data import DataSettings, ManoeuvreData
from manoeuvre_nn.training.settings import check_length


class GivenData(ManoeuvreData):
    """Recordings, simulated or measured, that a program has read already; they are what is judged by too."""

    def __init__(
        self,
        ship: Ship | Particulars,
        known: Ship,
        runs: Sequence[Recording],
        settings: DataSettings | None = None,
    ) -> None:
        """Check the recordings.

        Args:
            ship: The ship, for its particulars.
            known: Known part of the forces.
            runs: The recordings.
            settings: What of the recordings is used, and how; by default all of it.

        Raises:
            InputError: If there is none, or one makes no sense.
        """
        super().__init__(known, settings or DataSettings())
        if not runs:
            raise InputError("fit: no recording is given")
        self.particulars = ship if isinstance(ship, Particulars) else ship.particulars
        self.reference, self.runs = ship, tuple(runs)
        for run in self.runs:
            if "manoeuvre" not in run.meta:  # simulated: effects make channels disagree that sensors would not
                check_recording(run, self.particulars)
        if self.settings.length is not None:
            check_length("data.length", self.settings.length, self.particulars)

    def setup(self, stage: str | None = None) -> None:
        """Cut, smooth and resample as a recording of a file is.

        Args:
            stage: Lightning's stage; nothing depends on it.
        """
        del stage
        # Known accelerations are left out: only simulations have them.
        bare = [replace(r, channels={k: c for k, c in r.channels.items() if k not in ACCELERATION}) for r in self.runs]
        self.prepare_measured(bare, self.particulars)
        self.held_out = references(self.runs, self.particulars)

    def describe(self) -> str:
        """Names and lengths.

        Returns:
            A sentence.
        """
        names = ", ".join(f"{run.name} ({run.duration:.0f} s)" for run in self.recordings)
        return f"{len(self.tuples.inputs)} tuples of the {self.particulars.name}: {names}."


def references(runs: Sequence[Recording], ship: Particulars) -> HeldOut:
    """Recordings to judge a model by.

    Args:
        runs: The recordings.
        ship: The ship.

    Returns:
        The recordings; initial states and references of measured ones come from smoothed channels, since noise is
        nothing that a model should be asked for.
    """
    smooth = tuple(run if "manoeuvre" in run.meta and _exact(run) else accelerations(run, "smoother") for run in runs)
    return HeldOut(smooth, ship.length)


def _exact(run: Recording) -> bool:
    """Whether a run is simulated without noise."""
    return all(name in run.channels for name in ACCELERATION)
