"""Windows of recorded runs that a recursive network is trained on: they grow from stage to stage to whole runs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from math import cos, inf, pi
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.core.frames import earth_to_body
from manoeuvre_nn.core.limits import Factor, Weight
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.dynamics.course import Course, course_of
from manoeuvre_nn.dynamics.recursion import RecordedSteps, Unrolled
from manoeuvre_nn.dynamics.recursive import RecursiveShip

BEFORE_FULL_RATE = 0.1
"""Share of a stage in which the training rate rises."""
FIRST_RATE, LAST_RATE = 0.04, 1e-3
"""Training rate at the start and at the end of a stage over its full one."""


HEADING = 0.2
"""Error of the heading that counts as much as a standard deviation of a velocity [rad]."""
EXECUTE = 0.5 * DEGREE
"""Change of the rudder angle by which a manoeuvre begins [rad]."""


@dataclass(frozen=True)
class WindowStage:
    """A part of the training with windows of one length.

    Attributes:
        steps: Steps of a window; None takes whole runs. One step is teacher forcing.
        updates: Number of updates.
        rows: Windows in an update; of whole runs there are as many as there are runs.
        rate: Training rate.
        track: Weight of the squared error of the track across the first course, over a tenth of what it spans there,
            and along it, over a tenth of the geometric mean of both spans.
    """

    steps: int | None
    updates: int
    rows: int = 60
    rate: Factor = 3e-3
    track: Weight = 0.0

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InputError: If one is not positive.
        """
        for name in ("updates", "rows", "rate") if self.steps is None else ("steps", "updates", "rows", "rate"):
            if not getattr(self, name) > 0:
                raise InputError(f"fit.stages: {name}={getattr(self, name)}: expected more than 0")
        if not self.track >= 0:
            raise InputError(f"fit.stages: track={self.track}: expected a weight, at least 0")


USUAL_STAGES = (
    {"steps": 10, "updates": 300, "rows": 60, "rate": 3e-3},
    {"steps": 30, "updates": 500, "rows": 60, "rate": 3e-3},
    {"steps": 90, "updates": 1500, "rows": 60, "rate": 2e-3},
    {"steps": None, "updates": 600, "rate": 1e-3, "track": 0.1},
)


@dataclass(frozen=True)
class RecursiveFitSettings:
    """How a recursive network is trained.

    Attributes:
        stages: Parts of the training in their order, see :class:`WindowStage`.
        weights: Of the squared errors of the velocities, over their standard deviations; of phi likewise; and of psi,
            over .2 rad. What is not named has none.
        approach: How much of a steady course before the first rudder is trained on, in L/U0; None is all of it.
        clip: Largest norm of the gradient.
        weight_decay: Decay of the weights at each update over the training rate.
        choose_by: ``all_runs``: the network is kept that does best on training and held-out runs together, by the
            average angle measure of u, x, y, phi and psi, as in the source; ``held_out``: by the deviation on held-out
            runs, as with other fits.
    """

    stages: Sequence[Mapping[str, float | int | None]] = USUAL_STAGES
    weights: Mapping[str, Weight] = field(
        default_factory=lambda: {"u": 1.0, "v": 1.0, "p": 0.3, "r": 1.0, "phi": 1.0, "psi": 1.0}
    )
    approach: Weight | None = 1.0
    clip: Factor = 1.0
    weight_decay: Weight = 0.0
    choose_by: str = "all_runs"

    def __post_init__(self) -> None:
        """Check the settings.

        Raises:
            InputError: If one is unknown or out of range.
        """
        check_choice("fit.choose_by", self.choose_by, ["all_runs", "held_out"])
        known = ("u", "v", "w", "p", "q", "r", "phi", "theta", "psi")
        for name, weight in self.weights.items():
            check_choice("fit.weights", name, list(known))
            if not 0 <= weight < inf:
                raise InputError(f"fit.weights: {name}={weight}: expected a finite number from 0")
        if not self.clip > 0 or not self.weight_decay >= 0:
            raise InputError(f"fit.clip={self.clip}, fit.weight_decay={self.weight_decay}: expected > 0 and >= 0")
        if not self.stages:
            raise InputError("fit.stages=[] names no stage: see conf/fit/recursive.yaml")
        assert self.windows

    @property
    def updates(self) -> int:
        """Updates of all stages."""
        return sum(stage.updates for stage in self.windows)

    @cached_property
    def windows(self) -> tuple[WindowStage, ...]:
        """The stages."""
        known = [f.name for f in fields(WindowStage)]
        for stage in self.stages:
            for key in stage:
                check_choice("fit.stages: setting", key, known)
            if not {"steps", "updates"} <= set(stage):
                raise InputError(f"fit.stages: {dict(stage)} says no steps or no updates: see conf/fit/recursive.yaml")
        return tuple(WindowStage(**stage) for stage in self.stages)  # type: ignore[arg-type]


class _Material(NamedTuple):
    """Recorded runs as they are trained on.

    Attributes:
        course: The runs.
        steps: The same step by step.
        scales: What errors of each run are divided by: of the velocities, the angles, the track along and across.
        weights: Of these, without the track.
        counts: Steps of each run.
    """

    course: Course
    steps: RecordedSteps
    scales: Float[Tensor, "rows columns"]
    weights: Float[Tensor, " columns"]
    counts: Int[Tensor, " rows"]


class GrowingWindows:
    """Windows of recorded runs, and updates of a network by them.

    The network runs in closed loop from recorded steps on, its time its own; the recorded motion is read off at that
    time. Windows begin anywhere in the runs, grow from stage to stage, and are whole runs at last.

    Attributes:
        ship: Ship and network.
        settings: How it is trained.
        course: The runs, in double precision.
        material: The same in the network's floating type on its device.
    """

    def __init__(self, ship: RecursiveShip, runs: Sequence[Recording], settings: RecursiveFitSettings) -> None:
        """Bring recordings into dimensionless steps, and scale the network to them."""
        self.ship, self.settings, own = ship, settings, ship.network.settings
        cut = [_from_execute(run, ship.particulars, settings.approach) for run in runs]
        self.course = course_of(cut, ship.hull, own.velocities, step=own.step, wind=own.wind)
        self._ends = np.cumsum([stage.updates for stage in settings.windows])
        self.material = self.prepared()
        rows, k = _places(self.material.counts)
        ship.network.scale_to(*self._seen(rows, k))

    def optimizer(self) -> torch.optim.AdamW:
        """Adam; its rate is set update by update."""
        decay = self.settings.weight_decay
        return torch.optim.AdamW(self.ship.network.parameters(), lr=1e-3, betas=(0.9, 0.99), weight_decay=decay)

    def _seen(self, rows: Int[Tensor, " n"], k: Int[Tensor, " n"]) -> tuple[Tensor, Tensor]:
        """What the network sees at recorded steps, and the velocities there."""
        steps, network = self.material.steps, self.ship.network
        start = steps.start(rows, k, network.settings.past)
        return network.join((steps.forces[rows, k], *start.forces), (start.velocities, start.before)), start.velocities

    @torch.no_grad()
    def prepared(self) -> _Material:
        """The runs in the network's floating type on its device."""
        ship, course = self.ship, self.course.to(self.ship.network.shift)
        steps = ship.recorded(course)
        counts = (steps.time < course.duration[:, None]).sum(1)
        rows, k = _places(counts)
        names = ship.network.settings.velocities
        angles = [name for rate, name in {"p": "phi", "q": "theta", "r": "psi"}.items() if rate in names]
        spreads = torch.cat([steps.velocities[rows, k], steps.angles[rows, k][:, :-1]], dim=1).std(0)
        shared = torch.cat([spreads.clamp(min=1e-6), spreads.new_tensor([HEADING])])
        track = _along_course(course.motion.values[..., -2:], course.motion.values[:, 0, -3])
        extent = (track.amax(1) - track.amin(1)).clamp(min=0.1)
        # Zigzags are long: along the course as much as a circle of the same area counts.
        along = (extent[:, 0] * extent[:, 1]).sqrt()
        scales = torch.cat([shared.expand(len(track), -1), 0.1 * torch.stack([along, extent[:, 1]], 1)], dim=1)
        weights = [self.settings.weights.get(name, 0.0) for name in (*names, *angles)] + [0.0, 0.0]
        return _Material(course, steps, scales, scales.new_tensor(weights), counts)

    def update(
        self, optimizer: torch.optim.Optimizer, number: int, total: int, draw: torch.Generator
    ) -> tuple[Float[Tensor, ""], WindowStage, float]:
        """Set gradients and training rate of an update; the optimizer's step is left to the caller.

        Args:
            optimizer: That of :meth:`optimizer`.
            number: Of the update, from 0.
            total: Of all updates: where these are not as many as the stages have, the stages are stretched.
            draw: Draws the windows.

        Returns:
            Error, stage and training rate.
        """
        stage, rate = self._schedule(number * self.settings.updates / total)
        for group in optimizer.param_groups:
            if group.get("steps", stage.steps) != stage.steps:
                optimizer.state.clear()  # moments of another stage's errors would lead astray
            group |= {"lr": rate, "steps": stage.steps}
        loss = self.loss(*self._windows(stage, draw), steps=stage.steps, track=stage.track)
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.ship.network.parameters(), self.settings.clip)
        return loss.detach(), stage, rate

    def _schedule(self, update: float) -> tuple[WindowStage, float]:
        """Stage and training rate of an update."""
        number = int(np.searchsorted(self._ends, min(update, self._ends[-1] - 1), side="right"))
        stage = self.settings.windows[number]
        began = int(self._ends[number]) - stage.updates
        share = min((update - began) / stage.updates, 1.0)
        if share < BEFORE_FULL_RATE:
            low, part = FIRST_RATE, 1 - share / BEFORE_FULL_RATE
        else:
            low, part = LAST_RATE, (share - BEFORE_FULL_RATE) / (1 - BEFORE_FULL_RATE)
        return stage, stage.rate * (low + (1 - low) * 0.5 * (1 + cos(pi * part)))

    def _windows(self, stage: WindowStage, draw: torch.Generator) -> tuple[Tensor, Tensor]:
        """Runs and steps where the windows of an update begin."""
        counts = self.material.counts
        if stage.steps is None:
            rows = torch.arange(len(counts), device=counts.device)
            return rows, torch.zeros_like(rows)
        # The last windows may reach beyond the end of their run by half: the rest of them counts.
        rows, k = _places((counts - max(stage.steps // 2, 1)).clamp(min=1))
        chosen = torch.randint(len(rows), (stage.rows,), generator=draw).to(rows.device)
        return rows[chosen], k[chosen]

    def loss(
        self, rows: Int[Tensor, " some"], k: Int[Tensor, " some"], *, steps: int | None, track: float = 0.0
    ) -> Float[Tensor, ""]:
        """Weighted mean square error of windows in closed loop.

        Args:
            rows: Runs.
            k: Steps of these at which the network takes over.
            steps: Length of the windows; None goes on to the end of the longest run.
            track: Weight of x and y.

        Returns:
            The error [-].
        """
        material, course = self.material, self.material.course
        steps = steps or int(material.counts.max())
        start = material.steps.start(rows, k, self.ship.network.settings.past)
        made = self.ship.unroll(start, course.controls.rows(rows).at, course.speed[rows], steps)
        there = course.motion.rows(rows).at(made.time)
        error = _columns(made) - there
        # A track begins at the origin: its error is that of the way since the start.
        way = _along_course(error[..., -2:] - error[:, :1, -2:], course.motion.values[rows, 0, -3])
        error = (torch.cat([error[..., :-2], way], dim=-1) / material.scales[rows, None])[:, 1:]
        counted = (made.time[:, 1:] <= course.duration[rows, None]).to(error)
        weights = torch.cat([material.weights[:-2], material.weights.new_tensor([track, track])])
        return ((error.square() @ weights) * counted).sum() / counted.sum().clamp(min=1.0)

    @torch.no_grad()
    def single_steps(self) -> tuple[Float[Tensor, "n inputs"], Float[Tensor, "n freedom"]]:
        """Inputs at all recorded steps but the last of each run, and the velocities a step later."""
        rows, k = _places((self.material.counts - 1).clamp(min=1))
        return self._seen(rows, k)[0], self.material.steps.velocities[rows, k + 1]

    @torch.no_grad()
    def step_errors(self) -> dict[str, float]:
        """Root mean square error of each velocity a step ahead, over its standard deviation [-]."""
        seen, after = self.single_steps()
        names = self.ship.network.settings.velocities
        relative = (self.ship.network(seen) - after).square().mean(0).sqrt() / self.material.scales[0, : len(names)]
        return dict(zip(names, relative.tolist(), strict=True))


def _from_execute(run: Recording, ship: Particulars, approach: float | None) -> Recording:
    """A run from some time, in L/U0, before its rudder first moves."""
    if approach is None:
        return run
    moved = np.flatnonzero(np.abs(run["delta"] - run["delta"][0]) > EXECUTE)
    speed = max(float(run["u"][0]), 0.1 * ship.speed)
    start = run.time[moved[0]] - approach * ship.length / speed if len(moved) else run.time[0]
    return run.between(max(start, run.time[0]), run.time[-1])


def _along_course(
    track: Float[Tensor, "rows steps 2"], course: Float[Tensor, " rows"]
) -> Float[Tensor, "rows steps 2"]:
    """North and east turned to along and across the first heading of each run [rad]."""
    return torch.stack(earth_to_body(track[..., 0], track[..., 1], course[:, None]), dim=-1)


def _columns(made: Unrolled) -> Float[Tensor, "rows steps columns"]:
    """Velocities, angles, x and y, as the motion of a course has them."""
    return torch.cat([made.velocities, made.angles, made.track], dim=-1)


def _places(counts: Int[Tensor, " rows"]) -> tuple[Int[Tensor, " places"], Int[Tensor, " places"]]:
    """Run and step of all steps of runs."""
    rows = torch.repeat_interleave(torch.arange(len(counts), device=counts.device), counts)
    first = torch.repeat_interleave(counts.cumsum(0) - counts, counts)
    return rows, torch.arange(len(rows), device=counts.device) - first
