"""Lightning data modules: manoeuvres in, (u, v, r, delta) -> g tuples out."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import lightning as L
import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.utils.data import DataLoader

from manoeuvre_nn.core.channels import ACCELERATION
from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.core.limits import Rate
from manoeuvre_nn.core.manoeuvre import Manoeuvre, check_duration
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.core.terminal import Say
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.simulate import simulate
from manoeuvre_nn.dynamics.vessel import Vessel, in_words
from manoeuvre_nn.estimation.accelerations import METHODS, Method, accelerations, check_sensors, taken_away
from manoeuvre_nn.estimation.smoother import sensors_in_words
from manoeuvre_nn.recording.check.checks import check_recording
from manoeuvre_nn.recording.check.inspection import inspect_recording, summary_lines
from manoeuvre_nn.recording.noise import add_noise, resample
from manoeuvre_nn.recording.read.mapping import Mapping as ChannelMapping
from manoeuvre_nn.recording.read.reader import place_of, read_recording, recordings_in
from manoeuvre_nn.recording.tuples import Tuples, to_tuples
from manoeuvre_nn.scoring.held_out import HeldOut, references, simulated_references
from manoeuvre_nn.training.settings import check_length, check_positive, check_simulable, expand, noise_in_si

Batch = tuple[
    Float[Tensor, "n inputs"], Float[Tensor, "n outputs"], Float[Tensor, "k inputs"], Float[Tensor, "k outputs"]
]
"""Training inputs and targets, validation inputs and targets."""
DEFAULT_SCORE = ("zz20", "tc25", "tc25_port")
"""What a model of a simulated ship is scored on unless ``score=`` says otherwise."""
SUBSTITUTES = {"zz20": "zz15", "tc25": "tc20", "tc25_port": "tc20_port"}
"""What takes the place of one of them that is trained on."""


@dataclass(frozen=True)
class DataSettings:
    """What of the manoeuvres is used, and how.

    Attributes:
        length: How much of each manoeuvre is used [s]; None is all of it.
        rate_hz: Sampling rate [1/s]; None is the ship's usual one.
        noise: Standard deviations that are added to a simulation, in the units of :data:`.NOISE_UNITS`.
        accelerations: ``exact`` (simulations), ``central`` differences, ``smoother``, ``joint`` (all channels at once),
            or ``auto``: exact where they are known and the channels are clean, else the smoother.
        delays: Channels whose sensor may be late, for ``joint``.
        offsets: Channels whose sensor may be off, for ``joint``.
        validation: Share of the tuples that is kept from training for early stopping, from 0 to below 1 [-].
        seed: Seed of the choice of that share and of the noise.
        dtype: Floating type of the tuples.
    """

    length: float | None = None
    rate_hz: Rate | None = None
    noise: Mapping[str, float] = field(default_factory=dict)
    accelerations: Method | Literal["auto"] = "auto"
    delays: Sequence[str] = ()
    offsets: Sequence[str] = ()
    validation: float = 0.0
    seed: int = 0
    dtype: torch.dtype = torch.float64

    def __post_init__(self) -> None:
        """Check the settings.

        Raises:
            InputError: If one is out of range.
        """
        check_duration("data.length", self.length)
        check_positive("data.rate_hz", self.rate_hz)
        check_choice("data.accelerations", self.accelerations, ["auto", *METHODS])
        check_sensors(self.accelerations, self.delays, self.offsets)
        if not 0 <= self.validation < 1:
            raise InputError(f"data.validation={self.validation}: expected a share from 0 to below 1")


class ManoeuvreData(ABC, L.LightningDataModule):
    """Tuples of some manoeuvres, and the manoeuvres that a model of them is scored on.

    The whole set is one batch: sets are small, and the optimizers of this field want all of it or cut it themselves.

    Attributes:
        known: The known part of the forces; g is what it leaves.
        recordings: What the tuples are made from, after windowing, resampling and noise.
        measured: The same as the sensors gave it, not smoothed.
        tuples: Inputs and targets in the known part's prime system.
        held_out: The held-out manoeuvres.
        reference: The ship, or its particulars where no more is known.
        exact: Whether the accelerations are exact, so that g carries no noise.
        noise: Standard deviations of what the sensors add to the channels [SI and radians].
        say: Is told what is being computed.
    """

    known: Ship
    reference: Ship | Particulars
    exact: bool
    noise: Mapping[str, float]
    recordings: Sequence[Recording]
    measured: Sequence[Recording]
    tuples: Tuples
    held_out: HeldOut
    say: Say = staticmethod(lambda *_: None)

    def __init__(self, known: Ship, settings: DataSettings) -> None:
        """Store what is common to all sources."""
        super().__init__()
        self.known, self.settings, self.dtype = known, settings, settings.dtype

    @abstractmethod
    def setup(self, stage: str | None = None) -> None:
        """Make the tuples and the held-out manoeuvres."""

    @abstractmethod
    def describe(self) -> str:
        """What the model is trained on, in words for the report."""

    def remarks(self) -> list[str]:
        """What should be known of the recordings before anything is learnt from them, a line each."""
        return []

    def prepare(self, recordings: Sequence[Recording], noisy: bool) -> None:
        """Form the tuples.

        Args:
            recordings: What to train on.
            noisy: Whether the channels carry noise, so that accelerations must be smoothed.
        """
        clean = not noisy and all(name in r.channels for r in recordings for name in ACCELERATION)
        asked = self.settings.accelerations
        method = ("exact" if clean else "smoother") if asked == "auto" else asked
        self.exact = method == "exact"
        self.measured = tuple(recordings)
        self.recordings = tuple(self.with_accelerations(r, method) for r in recordings)
        self.form_tuples()

    def prepare_measured(self, recordings: Sequence[Recording], ship: Particulars) -> None:
        """Form the tuples of recordings that sensors gave: cut, smoothed, then read off at the rate asked for.

        Args:
            recordings: What to train on.
            ship: For the usual rate, where none is asked for and the recording's own is not slower.
        """
        length = self.settings.length or float("inf")
        self.measured = tuple(r.between(r.time[0], r.time[0] + min(length, r.duration)) for r in recordings)
        method = "smoother" if self.settings.accelerations == "auto" else self.settings.accelerations
        smooth = [self.with_accelerations(r, method) for r in self.measured]
        made = []
        for run in smooth:
            own = (len(run) - 1) / run.duration
            reduced = resample(run, self.settings.rate_hz or min(own, 1 / ship.sample_interval))
            made.append(replace(reduced, meta={**reduced.meta, "raw_rate": own}))
        self.recordings, self.exact, self.noise = tuple(made), False, taken_away(self.measured, smooth)
        self.form_tuples()

    def with_accelerations(self, recording: Recording, method: Method) -> Recording:
        """A recording with its accelerations, its sensors' delays and offsets taken away where they are asked for."""
        return accelerations(recording, method, delays=self.settings.delays, offsets=self.settings.offsets)

    def form_tuples(self) -> None:
        """Tuples of the recordings; a known part that learns its own coefficients does so first."""
        self.tuples = to_tuples(self.recordings, self.known)
        learnt: Any = getattr(self.known, "learnt", None)
        if learnt is not None:
            self.known = learnt(self.tuples)
            self.tuples = to_tuples(self.recordings, self.known)

    def would_record(self, run: Recording, seed: int) -> Tuples:
        """What a further manoeuvre would be learnt as: with this set's noise, rate and way to form accelerations.

        Args:
            run: The manoeuvre as it is sailed.
            seed: Seed of the noise.

        Returns:
            Tuples at the times of the run.
        """
        rate = max(r.meta.get("raw_rate", 0.0) for r in self.recordings)
        count = max(round(run.duration * rate), len(run) - 1)
        sensed = add_noise(run.resampled(np.linspace(run.time[0], run.time[-1], count + 1)), self.noise, seed=seed)
        method = self.settings.accelerations
        method = method if method in {"central", "joint"} else "smoother"
        return to_tuples([accelerations(sensed, method).resampled(run.time)], self.known)

    def train_mask(self) -> Bool[Tensor, " n"]:
        """True for tuples that are trained on, False for those of the validation."""
        count = len(self.tuples.inputs)
        kept = torch.ones(count, dtype=torch.bool)
        chosen = np.random.default_rng(self.settings.seed).permutation(count)[: round(self.settings.validation * count)]
        kept[torch.as_tensor(chosen, dtype=torch.long)] = False
        return kept

    def train_dataloader(self) -> DataLoader:
        """One batch an epoch: all tuples."""
        mask = self.train_mask()
        x, y = self.tuples.inputs.to(self.dtype), self.tuples.targets.to(self.dtype)
        batch: Batch = (x[mask], y[mask], x[~mask], y[~mask])
        return DataLoader([batch], batch_size=None, collate_fn=tuple)  # type: ignore[arg-type]


class SimulatedData(ManoeuvreData):
    """Manoeuvres of a reference ship, simulated in calm water or with what effects do to it.

    Known part and network know nothing of effects: what these do is part of what is learnt, as far as it follows from
    u, v, r and the rudder.
    """

    def __init__(
        self,
        ship: Ship,
        known: Ship,
        manoeuvres: Sequence[Manoeuvre],
        score: Sequence[Manoeuvre],
        *,
        effects: Sequence[Effect] = (),
        settings: DataSettings | None = None,
    ) -> None:
        """Check everything that can be checked before computing starts.

        Args:
            ship: The reference ship.
            known: Known part of the forces.
            manoeuvres: What to train on.
            score: Held-out manoeuvres.
            effects: What acts on the ship, in the held-out manoeuvres too.
            settings: What of the manoeuvres is used, and how; by default all of it, without noise.

        Raises:
            InputError: If the ship has no coefficients, a manoeuvre is in both lists, or a setting is out of range.
        """
        super().__init__(known, settings or DataSettings())
        check_simulable(ship)
        self.noise = noise_in_si(self.settings.noise)
        for manoeuvre in (*manoeuvres, *score):
            manoeuvre.check(ship.particulars)
        both = sorted({m.name for m in manoeuvres} & {m.name for m in score})
        if both:
            raise InputError(f"{', '.join(both)} is both in manoeuvre= and in score=: a model is scored on unseen runs")
        if not manoeuvres:
            raise InputError("manoeuvre=[] names no manoeuvre: write for instance manoeuvre=zz35")
        if not score:
            raise InputError("score=[] names no manoeuvre to score: write for instance score=[zz20]")
        self.ship = Vessel(CalmWater(ship), effects)
        self.reference = ship
        self.effects, self.manoeuvres, self.score_manoeuvres = effects, manoeuvres, score
        if self.settings.length is not None:
            for manoeuvre in manoeuvres:
                check_length(manoeuvre.name, self.settings.length, ship.particulars)

    def setup(self, stage: str | None = None) -> None:
        """Simulate."""
        if hasattr(self, "tuples"):
            return
        made, length, rate = [], self.settings.length, self.settings.rate_hz
        count = len(self.manoeuvres) + len(self.score_manoeuvres)
        for index, manoeuvre in enumerate(self.manoeuvres):  # for as long as it is asked, beyond the usual length too
            asked = manoeuvre if length is None else replace(manoeuvre, duration=length)
            lasts = asked.duration_for(self.ship.model.particulars)
            self.say(f"simulating {asked.name} over {lasts:g} s ({index + 1} of {count})", index / count)
            record = simulate(self.ship, asked, interval=1 / rate if rate else None)
            made.append(add_noise(record, self.noise, seed=self.settings.seed + index) if self.noise else record)
        self.prepare(made, noisy=bool(self.noise))
        unseen: tuple[Recording, ...] = ()
        for index, manoeuvre in enumerate(self.score_manoeuvres, start=len(made)):
            self.say(f"simulating {manoeuvre.name} ({index + 1} of {count})", index / count)
            unseen += simulated_references(self.ship, [manoeuvre])
        self.held_out = HeldOut(unseen, self.ship.model.particulars.length)

    def describe(self) -> str:
        """Ship, effects, manoeuvres, length, rate and noise, a sentence."""
        names = ", ".join(f"{r.name} ({r.duration:g} s)" for r in self.recordings)
        noise = ", ".join(f"{k} {v:g}" for k, v in self.noise.items()) or "none"
        acting = f" with {in_words(self.effects)}" if self.effects else ""
        return (
            f"{len(self.tuples.inputs)} tuples of the simulated {self.ship.model.particulars.name}{acting}: {names}; "
            f"noise (SI): {noise}.{sensors_in_words(self.recordings)}"
        )


class RecordedData(ManoeuvreData):
    """Recordings, measured or simulated, whatever else is known of how they came about."""

    def __init__(
        self,
        ship: Ship | Particulars,
        known: Ship,
        runs: Sequence[Recording],
        unseen: Sequence[Recording] = (),
        *,
        mapping: ChannelMapping | None = None,
        settings: DataSettings | None = None,
    ) -> None:
        """Check the recordings.

        Args:
            ship: The ship, for its particulars.
            known: Known part of the forces.
            runs: What to train on.
            unseen: Held-out recordings; without any the model is judged by those that it is trained on.
            mapping: Columns, units and signs of the files that they were read from.
            settings: What of the recordings is used, and how; by default all of it. Where no rate is given it is the
                ship's usual one, or the recording's own where that is slower.

        Raises:
            InputError: If there is none, or one makes no sense.
        """
        super().__init__(known, settings or DataSettings())
        if not runs:
            raise InputError("fit: no recording is given")
        self.particulars = ship.particulars
        self.reference, self.mapping = ship, mapping
        self.runs, self.unseen = tuple(runs), tuple(unseen)
        for run in (*self.runs, *self.unseen):
            if not run.is_simulated:  # effects make channels disagree that sensors would not
                check_recording(run, self.particulars)
        if self.settings.length is not None:
            check_length("data.length", self.settings.length, self.particulars)

    def setup(self, stage: str | None = None) -> None:
        """Cut, smooth, resample; known accelerations are left out, since only simulations have them."""
        if hasattr(self, "tuples"):
            return
        self.prepare_measured([_without_exact_accelerations(run) for run in self.runs], self.particulars)
        self.held_out = references(self.unseen or self.runs, self.particulars)

    def remarks(self) -> list[str]:
        """What the checks of the recordings ask for before they are trained on, at most six lines."""
        return summary_lines([inspect_recording(r, self.particulars, mapping=self.mapping) for r in self.runs])

    def describe(self) -> str:
        """Names, lengths and rate, a sentence."""
        names = ", ".join(f"{r.name} ({r.duration:.0f} s)" for r in self.recordings)
        measured = "" if any(run.is_simulated for run in self.runs) else "measured "
        told = f"{len(self.tuples.inputs)} tuples of the {measured}{self.particulars.name}: {names}."
        return told + sensors_in_words(self.recordings)


def recorded_files(
    ship: Ship | Particulars,
    known: Ship,
    files: Sequence[str],
    score: Sequence[str] | None,
    mapping: ChannelMapping | None,
    *,
    folder: str = ".",
    settings: DataSettings | None = None,
) -> RecordedData:
    """Recordings of files, read and checked, so that a bad one is refused before computing starts.

    Args:
        ship: The ship, for its particulars.
        known: Known part of the forces.
        files: What to train on, relative to ``folder``.
        score: Held-out recordings, relative to ``folder``; empty takes every other one in the folder, None takes none.
        mapping: Columns, units and signs; None for files that this package wrote.
        folder: Where the files are, or ``sample``.
        settings: What of the recordings is used, and how.

    Returns:
        The data module.

    Raises:
        InputError: If no file is named, or one is in both lists.
    """
    if settings is not None and settings.noise:
        raise InputError("data.noise: measured files carry their own noise; leave it out")
    where, particulars = place_of(folder), ship.particulars
    paths = expand(where, files, "data.files")
    if not paths:
        raise InputError("data.files=[] names no recording: write data.files=[FILE,...], relative to data.folder")
    others = [] if score is None else recordings_in(where)
    unseen = expand(where, score or (), "score") or [p for p in others if p not in paths]
    both = sorted({p.name for p in paths} & {p.name for p in unseen})
    if both:
        raise InputError(f"{', '.join(both)} is both in data.files and in score: a model is scored on unseen runs")
    if not unseen and score is not None:
        raise InputError(f"no recording is left in {where} to score: leave one out of data.files, or add one there")
    runs, held_out = ([read_recording(p, mapping, particulars) for p in some] for some in (paths, unseen))
    return RecordedData(ship, known, runs, held_out, mapping=mapping, settings=settings)


def _without_exact_accelerations(run: Recording) -> Recording:
    """A run without accelerations that only a simulation knows."""
    kept = {k: c for k, c in run.channels.items() if k not in ACCELERATION} if run.is_simulated else run.channels
    return replace(run, channels=kept)
