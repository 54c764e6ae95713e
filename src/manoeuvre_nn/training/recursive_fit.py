"""A fit of a recursive network in closed loop: backpropagation through time on windows that grow to whole runs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from math import cos, pi
from typing import Any, NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.dynamics.course import Course, course_of
from manoeuvre_nn.dynamics.recursion import RecordedSteps, Unrolled
from manoeuvre_nn.dynamics.recursive import RecursiveShip
from manoeuvre_nn.dynamics.replay import replay
from manoeuvre_nn.network.recursive import RecursiveNetwork
from manoeuvre_nn.scoring.error_measures import run_measures
from manoeuvre_nn.training.data import Batch, ManoeuvreData
from manoeuvre_nn.training.fits import Fit

DONE = "all stages done"
BEFORE_FULL_RATE = 0.1
"""Share of a stage in which the training rate rises."""
FIRST_RATE, LAST_RATE = 0.04, 1e-3
"""Training rate at the start and at the end of a stage over its full one."""


@dataclass(frozen=True)
class WindowStage:
    """A part of the training with windows of one length.

    Attributes:
        steps: Steps of a window; None takes whole runs. One step is teacher forcing.
        share: Share of all updates [-].
        rows: Windows in an update; of whole runs there are as many as there are runs.
        rate: Training rate.
    """

    steps: int | None
    share: float
    rows: int = 60
    rate: float = 3e-3

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InputError: If one is not positive.
        """
        for name in ("share", "rows", "rate") if self.steps is None else ("steps", "share", "rows", "rate"):
            if not getattr(self, name) > 0:
                raise InputError(f"fit.stages: {name}={getattr(self, name)}: expected more than 0")


USUAL_STAGES = (
    {"steps": 10, "share": 0.1, "rows": 60, "rate": 3e-3},
    {"steps": 30, "share": 0.15, "rows": 60, "rate": 3e-3},
    {"steps": 90, "share": 0.6, "rows": 60, "rate": 2e-3},
    {"steps": None, "share": 0.15, "rate": 5e-4},
)


@dataclass(frozen=True)
class RecursiveFitSettings:
    """How a recursive network is trained.

    Attributes:
        stages: Parts of the training in their order, see :class:`WindowStage`.
        weights: Of the squared errors of the velocities, over their standard deviations; of phi likewise; of psi, over
            .2 rad; and of the track, over L. What is not named has none.
        clip: Largest norm of the gradient.
        weight_decay: Decay of the weights at each update over the training rate.
        choose_by: ``all_runs``: the network is kept that does best on training and held-out runs together, by the
            average angle measure of u, x, y, phi and psi, as in the source; ``held_out``: by the deviation on held-out
            runs, as with other fits.
    """

    stages: Sequence[Mapping[str, float | int | None]] = USUAL_STAGES
    weights: Mapping[str, float] = field(
        default_factory=lambda: {"u": 1.0, "v": 1.0, "p": 0.3, "r": 1.0, "phi": 1.0, "psi": 1.0}
    )
    clip: float = 1.0
    weight_decay: float = 0.0
    choose_by: str = "all_runs"

    def __post_init__(self) -> None:
        """Check the settings.

        Raises:
            InputError: If one is unknown or out of range.
        """
        check_choice("fit.choose_by", self.choose_by, ["all_runs", "held_out"])
        known = ("u", "v", "w", "p", "q", "r", "phi", "theta", "psi", "track")
        for name, weight in self.weights.items():
            check_choice("fit.weights", name, list(known))
            if not weight >= 0:
                raise InputError(f"fit.weights: {name}={weight}: expected a number from 0")
        if not self.clip > 0 or not self.weight_decay >= 0:
            raise InputError(f"fit.clip={self.clip}, fit.weight_decay={self.weight_decay}: expected > 0 and >= 0")
        if not self.stages:
            raise InputError("fit.stages=[] names no stage: see conf/fit/recursive.yaml")
        assert self.windows

    @property
    def windows(self) -> tuple[WindowStage, ...]:
        """The stages."""
        known = [f.name for f in fields(WindowStage)]
        for stage in self.stages:
            for key in stage:
                check_choice("fit.stages: setting", key, known)
        return tuple(WindowStage(**stage) for stage in self.stages)  # type: ignore[arg-type]


class _Material(NamedTuple):
    """Recorded runs as they are trained on.

    Attributes:
        course: The runs.
        steps: The same step by step.
        scales: What errors are divided by: of the velocities, the angles, x and y.
        weights: Of these.
        counts: Steps of each run.
    """

    course: Course
    steps: RecordedSteps
    scales: Float[Tensor, " columns"]
    weights: Float[Tensor, " columns"]
    counts: Int[Tensor, " rows"]


class RecursiveFit(Fit):
    """Backpropagation through time with Adam; an epoch is some updates.

    The network runs in closed loop from recorded steps on, its time its own; the recorded motion is read off at that
    time. Windows begin anywhere in the runs, grow from stage to stage, and are whole runs at last.

    Source:
        Hess & Faller 2000, "Training procedure": gradient descent, 100 000 epochs, stopped at the best generalization,
        which is tested every 10 epochs on training and validation runs together. Here Adam and growing windows.
    """

    made_for = RecursiveNetwork
    errors_of = ("u", "v", "r")
    dynamics: RecursiveShip  # type: ignore[assignment]

    def __init__(
        self,
        dynamics: RecursiveShip,
        settings: RecursiveFitSettings | None = None,
        *,
        iterations_per_epoch: int = 20,
        seed: int = 0,
    ) -> None:
        """Set up the method.

        Args:
            dynamics: Ship and network.
            settings: How it is trained.
            iterations_per_epoch: Updates in an epoch.
            seed: Of the windows that are drawn.
        """
        super().__init__(dynamics, iterations_per_epoch)
        self.settings, self.seed = settings or RecursiveFitSettings(), seed
        shares = np.array([stage.share for stage in self.settings.windows])
        self._ends = np.cumsum(shares) / shares.sum()

    @property
    def network(self) -> RecursiveNetwork:
        """The network."""
        return self.dynamics.network

    def configure_optimizers(self) -> torch.optim.AdamW:
        """Adam; its rate is set update by update."""
        return torch.optim.AdamW(
            self.network.parameters(), lr=1e-3, betas=(0.9, 0.99), weight_decay=self.settings.weight_decay
        )

    def on_train_start(self) -> None:
        """Bring the recordings into dimensionless steps, and scale the network to them."""
        data: Any = self.trainer.datamodule  # type: ignore[attr-defined]
        assert isinstance(data, ManoeuvreData)
        settings = self.network.settings
        self.course = course_of(
            data.recordings, self.dynamics.hull, settings.velocities, step=settings.step, wind=settings.wind
        )
        self._material = self._prepare(scale=True)

    @torch.no_grad()
    def _prepare(self, *, scale: bool = False) -> _Material:
        """The runs in the network's floating type on its device."""
        ship, course = self.dynamics, self.course.to(self.network.shift)
        steps = ship.recorded(course)
        counts = (steps.time < course.duration[:, None]).sum(1)
        rows, k = _places(counts)
        if scale:
            start = steps.start(rows, k, self.network.settings.past)
            seen = self.network.join((steps.forces[rows, k], *start.forces), (start.velocities, start.before))
            self.network.scale_to(seen, start.velocities)
        names = self.network.settings.velocities
        angles = [name for rate, name in {"p": "phi", "q": "theta", "r": "psi"}.items() if rate in names]
        spreads = torch.cat([steps.velocities[rows, k], steps.angles[rows, k][:, :-1]], dim=1).std(0)
        scales = torch.cat([spreads.clamp(min=1e-6), spreads.new_tensor([0.2, 1.0, 1.0])])
        weight = self.settings.weights
        weights = [weight.get(name, 0.0) for name in (*names, *angles, "track", "track")]
        return _Material(course, steps, scales, scales.new_tensor(weights), counts)

    def training_step(self, batch: Batch, batch_idx: int) -> None:
        """Some updates.

        Args:
            batch: Not used: nothing is learnt from tuples.
            batch_idx: 0.
        """
        optimizer: Any = self.optimizers()
        draw = torch.Generator().manual_seed(self.seed * 1_000_003 + self.current_epoch)
        epochs = self.trainer.max_epochs or 1
        total, losses = epochs * self.iterations_per_epoch, []
        for k in range(self.iterations_per_epoch):
            stage, rate, first = self._schedule(self.current_epoch * self.iterations_per_epoch + k, total)
            inner = optimizer.optimizer
            if first:
                inner.state.clear()
            for group in inner.param_groups:
                group["lr"] = rate
            loss = self.loss(*self._windows(stage, draw), steps=stage.steps)
            inner.zero_grad(set_to_none=True)
            loss.backward()
            torch.nn.utils.clip_grad_norm_(self.network.parameters(), self.settings.clip)
            # Lightning counts one step an epoch; its wrapper would cost more than the step itself.
            (optimizer if k == self.iterations_per_epoch - 1 else inner).step()
            losses.append(loss.detach())
        self.log("train/rate", rate)
        self.log("train/steps", float(stage.steps or int(self._material.counts.max())))
        self.finish(batch, torch.stack(losses).mean())

    def _schedule(self, update: int, total: int) -> tuple[WindowStage, float, bool]:
        """Stage and training rate of an update, and whether it is the first of its stage."""
        ends = np.maximum(np.round(self._ends * total), np.arange(1, len(self._ends) + 1))
        number = min(int(np.searchsorted(ends, update, side="right")), len(ends) - 1)
        stage, began = self.settings.windows[number], float(ends[number - 1]) if number else 0.0
        share = (update - began) / max(float(ends[number]) - began, 1.0)
        if share < BEFORE_FULL_RATE:
            low, part = FIRST_RATE, 1 - share / BEFORE_FULL_RATE
        else:
            low, part = LAST_RATE, (share - BEFORE_FULL_RATE) / (1 - BEFORE_FULL_RATE)
        return stage, stage.rate * (low + (1 - low) * 0.5 * (1 + cos(pi * part))), update == began

    def _windows(self, stage: WindowStage, draw: torch.Generator) -> tuple[Tensor, Tensor]:
        """Runs and steps where the windows of an update begin."""
        counts = self._material.counts
        if stage.steps is None:
            rows = torch.arange(len(counts), device=counts.device)
            return rows, torch.zeros_like(rows)
        # The last windows may reach beyond the end of their run by half: the rest of them counts.
        rows, k = _places((counts - max(stage.steps // 2, 1)).clamp(min=1))
        chosen = torch.randint(len(rows), (stage.rows,), generator=draw).to(rows.device)
        return rows[chosen], k[chosen]

    def loss(self, rows: Int[Tensor, " some"], k: Int[Tensor, " some"], *, steps: int | None) -> Float[Tensor, ""]:
        """Weighted mean square error of windows in closed loop.

        Args:
            rows: Runs.
            k: Steps of these at which the network takes over.
            steps: Length of the windows; None goes on to the end of the longest run.

        Returns:
            The error [-].
        """
        material, course = self._material, self._material.course
        steps = steps or int(material.counts.max())
        start = material.steps.start(rows, k, self.network.settings.past)
        made = self.dynamics.unroll(start, course.controls.rows(rows).at, course.speed[rows], steps)
        there = course.motion.rows(rows).at(made.time)
        error = (_columns(made) - there) / material.scales
        # A track begins at the origin: its error is that of the way since the start.
        error = torch.cat([error[..., :-2], error[..., -2:] - error[:, :1, -2:]], dim=-1)[:, 1:]
        counted = (made.time[:, 1:] <= course.duration[rows, None]).to(error)
        return ((error.square() @ material.weights) * counted).sum() / counted.sum().clamp(min=1.0)

    @torch.no_grad()
    def relative_rmse(self, inputs: Float[Tensor, "n 4"], targets: Float[Tensor, "n 3"]) -> Float[Tensor, " 3"]:
        """Root mean square error of u, v and r a step ahead over their standard deviation.

        Args:
            inputs: Not used: the network does not learn forces.
            targets: Not used.

        Returns:
            For u, v, r [-].
        """
        material = self._prepare()
        rows, k = _places((material.counts - 1).clamp(min=1))
        start = material.steps.start(rows, k, self.network.settings.past)
        seen = self.network.join((material.steps.forces[rows, k], *start.forces), (start.velocities, start.before))
        error = (self.network(seen) - material.steps.velocities[rows, k + 1]).square().mean(0).sqrt()
        names = self.network.settings.velocities
        chosen = [names.index(name) for name in ("u", "v", "r")]
        return (error / material.scales[: len(names)])[chosen].to(inputs)

    def generalization_error(self, data: ManoeuvreData) -> float | None:
        """One less the average angle measure, over u, x, y, phi, psi, training and held-out runs.

        The runs are driven by their recorded controls.

        Args:
            data: What is trained on, and what is held out.

        Returns:
            The error [-], 0 for a perfect prediction; None where the network is chosen by held-out runs alone.

        Source:
            Hess & Faller 2000, "Training procedure".
        """
        if self.settings.choose_by == "held_out":
            return None
        runs = [*data.recordings, *data.held_out.references]
        found = replay(self.dynamics, runs)
        return float(
            np.mean([1 - run_measures(p, r)["average_angle"].mean() for p, r in zip(found, runs, strict=True)])
        )


def _columns(made: Unrolled) -> Float[Tensor, "rows steps columns"]:
    """Velocities, angles, x and y, as the motion of a course has them."""
    return torch.cat([made.velocities, made.angles, made.track], dim=-1)


def _places(counts: Int[Tensor, " rows"]) -> tuple[Int[Tensor, " places"], Int[Tensor, " places"]]:
    """Run and step of all steps of runs."""
    rows = torch.repeat_interleave(torch.arange(len(counts), device=counts.device), counts)
    first = torch.repeat_interleave(counts.cumsum(0) - counts, counts)
    return rows, torch.arange(len(rows), device=counts.device) - first
