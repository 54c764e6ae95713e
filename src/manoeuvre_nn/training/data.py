"""Lightning data modules: manoeuvres in, (u, v, r, delta) -> g tuples out."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import lightning as L
import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.utils.data import DataLoader

from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.core.manoeuvre import Manoeuvre
from manoeuvre_nn.core.recording import ACCELERATION, Recording
from manoeuvre_nn.core.ship import Particulars, Ship
from manoeuvre_nn.dynamics.affected import Affected, in_words
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.simulate import Problem, simulate
from manoeuvre_nn.recording.accelerations import METHODS, accelerations, check_sensors, taken_away
from manoeuvre_nn.recording.checks import check_recording
from manoeuvre_nn.recording.held_out import HeldOut, simulated_references
from manoeuvre_nn.recording.inspection import inspect_recording, summary_lines
from manoeuvre_nn.recording.joint_smoother import sensors_in_words
from manoeuvre_nn.recording.mapping import Mapping as ChannelMapping
from manoeuvre_nn.recording.noise import add_noise, resample
from manoeuvre_nn.recording.reader import read_recording, recordings_in
from manoeuvre_nn.recording.tuples import Tuples, to_tuples
from manoeuvre_nn.training.settings import check_length, check_positive, check_simulable, expand, noise_in_si

Batch = tuple[Float[Tensor, "n 4"], Float[Tensor, "n 3"], Float[Tensor, "k 4"], Float[Tensor, "k 3"]]
"""Training inputs and targets, validation inputs and targets."""
Method = Literal["auto", "exact", "central", "smoother", "joint"]

DEFAULT_SCORE = ("zz20", "tc25", "tc25_port")
"""What a simulated ship is judged by unless ``score=`` says otherwise."""
INSTEAD = {"zz20": "zz15", "tc25": "tc20", "tc25_port": "tc20_port"}
"""What takes the place of one of them that is trained on."""


class ManoeuvreData(ABC, L.LightningDataModule):
    """Tuples of some manoeuvres, and the manoeuvres that a model of them is judged by.

    The whole set is one batch: sets are small, and the optimizers of this field want all of it or cut it themselves.

    Attributes:
        known: The known part of the forces; g is what it leaves.
        recordings: What the tuples are made from, after windowing, resampling and noise.
        measured: The same as the sensors gave it, not smoothed.
        tuples: Inputs and targets in the known part's prime system.
        held_out: The manoeuvres to judge by.
        reference: The ship, or its particulars where no more is known.
        exact: Whether the accelerations are exact, so that g carries no noise.
        noise: Standard deviations of what the sensors add to the channels [SI and radians].
    """

    known: Ship
    reference: Ship | Particulars
    exact: bool
    noise: Mapping[str, float]
    recordings: Sequence[Recording]
    measured: Sequence[Recording]
    tuples: Tuples
    held_out: HeldOut

    def __init__(
        self, known: Ship, *, accelerations: Method, delays: Sequence[str], offsets: Sequence[str], validation: float,
        seed: int, dtype: torch.dtype,
    ) -> None:  # fmt: skip
        """Store what is common to all sources.

        Args:
            known: Known part of the forces.
            accelerations: ``exact`` (simulations), ``central`` differences, ``smoother``, ``joint`` (all channels at
                once), or ``auto``: exact where they are known and the channels are clean, else the smoother.
            delays: Channels whose sensor may be late, for ``joint``.
            offsets: Channels whose sensor may be off, for ``joint``.
            validation: Share of the tuples that is kept from training for early stopping [-].
            seed: Seed of the choice of that share and of the noise.
            dtype: Floating type of the tuples.

        Raises:
            InputError: If a setting is out of range.
        """
        super().__init__()
        check_choice("data.accelerations", accelerations, ["auto", *METHODS])
        check_sensors(accelerations, delays, offsets)
        if not 0 <= validation < 1:
            raise InputError(f"data.validation={validation}: expected a share from 0 to below 1")
        self.known, self.method, self.validation = known, accelerations, validation
        self.delays, self.offsets = tuple(delays), tuple(offsets)
        self.seed, self.dtype = seed, dtype

    @abstractmethod
    def setup(self, stage: str | None = None) -> None:
        """Make the tuples and the held-out manoeuvres.

        Args:
            stage: Lightning's stage; nothing depends on it.
        """

    @abstractmethod
    def describe(self) -> str:
        """What the model is trained on, in words for the report."""

    def remarks(self) -> list[str]:
        """What should be known of the recordings before anything is learnt from them, a line each.

        Returns:
            Lines; none for a simulation.
        """
        return []

    def prepare(self, recordings: Sequence[Recording], noisy: bool) -> None:
        """Form the tuples.

        Args:
            recordings: What to train on.
            noisy: Whether the channels carry noise, so that accelerations must be smoothed.
        """
        clean = not noisy and all(name in r.channels for r in recordings for name in ACCELERATION)
        method = ("exact" if clean else "smoother") if self.method == "auto" else self.method
        self.exact = method == "exact"
        self.measured = tuple(recordings)
        self.recordings = tuple(accelerations(r, method, delays=self.delays, offsets=self.offsets) for r in recordings)
        self.form_tuples()

    def form_tuples(self) -> None:
        """Tuples of the recordings; a known part that learns its own coefficients does so first."""
        self.tuples = to_tuples(self.recordings, self.known)
        learnt = getattr(self.known, "learnt", None)
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
        method = self.method if self.method in {"central", "joint"} else "smoother"
        return to_tuples([accelerations(sensed, method).resampled(run.time)], self.known)

    def train_mask(self) -> Bool[Tensor, " n"]:
        """Which tuples are trained on.

        Returns:
            True for training, False for validation.
        """
        count = len(self.tuples.inputs)
        kept = torch.ones(count, dtype=torch.bool)
        chosen = np.random.default_rng(self.seed).permutation(count)[: round(self.validation * count)]
        kept[torch.as_tensor(chosen, dtype=torch.long)] = False
        return kept

    def train_dataloader(self) -> DataLoader:
        """One batch an epoch: all tuples.

        Returns:
            A loader of one :data:`Batch`.
        """
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
        length: float | None = None,
        rate_hz: float | None = None,
        noise: Mapping[str, float] | None = None,
        accelerations: Method = "auto",
        delays: Sequence[str] = (),
        offsets: Sequence[str] = (),
        validation: float = 0.0,
        seed: int = 0,
        dtype: torch.dtype = torch.float64,
    ) -> None:
        """Check everything that can be checked before computing starts.

        Args:
            ship: The reference ship.
            known: Known part of the forces.
            manoeuvres: What to train on.
            score: What to judge by.
            effects: What acts on the ship, in the manoeuvres to judge by too.
            length: How much of each manoeuvre is used [s]; None is all of it.
            rate_hz: Sampling rate [1/s]; None is the ship's usual one.
            noise: Standard deviations in the units of :data:`NOISE_UNITS`.
            accelerations: See :class:`ManoeuvreData`.
            delays: See :class:`ManoeuvreData`.
            offsets: See :class:`ManoeuvreData`.
            validation: Share kept for early stopping [-].
            seed: Seed of noise and validation share.
            dtype: Floating type of the tuples.

        Raises:
            InputError: If the ship has no coefficients, a manoeuvre is in both lists, or a setting is out of range.
        """
        super().__init__(
            known, accelerations=accelerations, delays=delays, offsets=offsets, validation=validation, seed=seed,
            dtype=dtype,
        )  # fmt: skip
        check_simulable(ship)
        check_positive("data.length", length)
        check_positive("data.rate_hz", rate_hz)
        self.noise = noise_in_si(noise or {})
        for manoeuvre in (*manoeuvres, *score):
            manoeuvre.check(ship.particulars)
        both = sorted({m.name for m in manoeuvres} & {m.name for m in score})
        if both:
            raise InputError(f"{', '.join(both)} is both in manoeuvre= and in score=: a model is judged on unseen runs")
        if not manoeuvres:
            raise InputError("manoeuvre=[] names no manoeuvre: write for instance manoeuvre=zz35")
        if not score:
            raise InputError("score=[] names no manoeuvre to judge by: write for instance score=[zz20]")
        self.ship = Affected(CalmWater(ship), effects) if effects else CalmWater(ship)
        self.reference = ship
        self.effects, self.manoeuvres, self.score_manoeuvres = effects, manoeuvres, score
        self.length, self.rate_hz = length, rate_hz
        if length is not None:
            for manoeuvre in manoeuvres:
                check_length(manoeuvre.name, length, ship.particulars)

    def setup(self, stage: str | None = None) -> None:
        """Simulate.

        Args:
            stage: Lightning's stage; nothing depends on it.
        """
        del stage
        if hasattr(self, "tuples"):
            return
        made = []
        for index, manoeuvre in enumerate(self.manoeuvres):
            # A record longer than the trial's usual length is simulated for as long as it is asked for.
            asked = manoeuvre if self.length is None else replace(manoeuvre, duration=self.length)
            record = simulate(Problem(self.ship, asked, interval=1 / self.rate_hz if self.rate_hz else None))
            made.append(add_noise(record, self.noise, seed=self.seed + index) if self.noise else record)
        self.prepare(made, noisy=bool(self.noise))
        references = simulated_references(self.ship, self.score_manoeuvres)
        self.held_out = HeldOut(references, self.ship.particulars.length)

    def describe(self) -> str:
        """Ship, effects, manoeuvres, length, rate and noise.

        Returns:
            A sentence.
        """
        names = ", ".join(f"{r.name} ({r.duration:g} s)" for r in self.recordings)
        noise = ", ".join(f"{k} {v:g}" for k, v in self.noise.items()) or "none"
        count = len(self.tuples.inputs)
        acting = f" with {in_words(self.effects)}" if self.effects else ""
        return (
            f"{count} tuples of the simulated {self.ship.particulars.name}{acting}: {names}; noise (SI): {noise}."
            + (sensors_in_words(self.recordings))
        )


class RecordedData(ManoeuvreData):
    """Measured manoeuvres."""

    def __init__(
        self,
        ship: Ship | Particulars,
        known: Ship,
        files: Sequence[str],
        score: Sequence[str],
        mapping: ChannelMapping,
        *,
        folder: str = ".",
        length: float | None = None,
        rate_hz: float | None = None,
        accelerations: Method = "auto",
        delays: Sequence[str] = (),
        offsets: Sequence[str] = (),
        validation: float = 0.0,
        seed: int = 0,
        dtype: torch.dtype = torch.float64,
    ) -> None:
        """Read and check the files, so that a bad one is refused before computing starts.

        Args:
            ship: The ship, for its particulars.
            known: Known part of the forces.
            files: What to train on, relative to ``folder``.
            score: What to judge by, relative to ``folder``; empty takes every other recording in the folder.
            mapping: Columns, units and signs.
            folder: Where the files are.
            length: How much of each recording is trained on [s]; None is all of it.
            rate_hz: Sampling rate that recordings are reduced to [1/s]; None is the ship's usual one, or the
                recording's own where that is slower.
            accelerations: See :class:`ManoeuvreData`.
            delays: See :class:`ManoeuvreData`.
            offsets: See :class:`ManoeuvreData`.
            validation: Share kept for early stopping [-].
            seed: Seed of the validation share.
            dtype: Floating type of the tuples.

        Raises:
            InputError: If no file is named, or one is in both lists.
        """
        super().__init__(
            known, accelerations=accelerations, delays=delays, offsets=offsets, validation=validation, seed=seed,
            dtype=dtype,
        )  # fmt: skip
        check_positive("data.length", length)
        check_positive("data.rate_hz", rate_hz)
        self.particulars = ship if isinstance(ship, Particulars) else ship.particulars
        self.reference, self.mapping = ship, mapping
        where = Path(folder)
        paths = expand(where, files, "data.files")
        if not paths:
            raise InputError("data.files=[] names no recording: write data.files=[FILE,...], relative to data.folder")
        judged = expand(where, score, "score") or [p for p in recordings_in(where) if p not in paths]
        both = sorted({p.name for p in paths} & {p.name for p in judged})
        if both:
            raise InputError(f"{', '.join(both)} is both in data.files and in score: a model is judged on unseen runs")
        if not judged:
            raise InputError(f"no recording is left in {where} to judge by: write score=[FILE,...]")
        self._read = [read_recording(p, mapping, self.particulars) for p in paths]
        self._judged = [read_recording(p, mapping, self.particulars) for p in judged]
        for record in (*self._read, *self._judged):
            check_recording(record, self.particulars)
        if length is not None:
            check_length("data.length", length, self.particulars)
        self.length, self.rate_hz = length, rate_hz

    def setup(self, stage: str | None = None) -> None:
        """Cut, resample, smooth.

        Args:
            stage: Lightning's stage; nothing depends on it.
        """
        del stage
        if hasattr(self, "tuples"):
            return
        cut = [r.between(r.time[0], r.time[0] + min(self.length or r.duration, r.duration)) for r in self._read]
        self.measured = tuple(cut)
        smooth = "smoother" if self.method == "auto" else self.method
        with_rates = [accelerations(r, smooth, delays=self.delays, offsets=self.offsets) for r in cut]
        self.recordings = tuple(self._read_off(r) for r in with_rates)
        self.exact, self.noise = False, taken_away(cut, with_rates)
        self.form_tuples()
        # Initial states and references come from the smoothed channels: noise is nothing a model should be asked for.
        references = tuple(accelerations(r, "smoother") for r in self._judged)
        self.held_out = HeldOut(references, self.particulars.length)

    def remarks(self) -> list[str]:
        """What the checks find in the files that are trained on.

        Returns:
            A line each finding that asks for something to be done, at most six.
        """
        return summary_lines([inspect_recording(r, self.particulars, mapping=self.mapping) for r in self._read])

    def _read_off(self, recording: Recording) -> Recording:
        """A recording at the rate asked for, else the ship's usual one, or its own where that is slower."""
        own = (len(recording) - 1) / recording.duration
        reduced = resample(recording, self.rate_hz or min(own, 1 / self.particulars.sample_interval))
        return replace(reduced, meta={**reduced.meta, "raw_rate": own})

    def describe(self) -> str:
        """Files, lengths and rate.

        Returns:
            A sentence.
        """
        names = ", ".join(f"{r.name} ({r.duration:.0f} s)" for r in self.recordings)
        words = f"{len(self.tuples.inputs)} tuples of the measured {self.particulars.name}: {names}."
        return words + sensors_in_words(self.recordings)
