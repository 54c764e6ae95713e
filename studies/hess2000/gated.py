"""LSTM and GRU of the size of the recursive network, from controls alone: what memory does in place of forces."""

from collections.abc import Sequence
from time import process_time
from typing import Literal

import numpy as np
import torch
from jaxtyping import Float
from scipy.interpolate import CubicSpline
from torch import Tensor, nn

from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.core.units import GRAVITY
from manoeuvre_nn.dynamics.course import Course, course_of
from manoeuvre_nn.dynamics.recursion import track_of
from manoeuvre_nn.network.recursive_settings import STEP
from studies.hess2000.runs import RunSet
from studies.hess2000.training import BestWeights, TrainedSimulator
from studies.reproduction.section import Say

Kind = Literal["LSTM", "GRU"]
HIDDEN = {"LSTM": 37, "GRU": 43}
"""Nodes with which they have the weights of the recursive network."""
UPDATES, QUICK_UPDATES, SCORES, QUICK_SCORES = 1500, 10, 30, 2
STEADY = 20
"""Steps of a steady approach before the run, in which the memory fills."""
RATE = 5e-3
VELOCITIES = ("u", "v", "p", "r")
MIRROR = (1.0, -1.0, -1.0, -1.0)
"""Signs of u, v, p, r when port and starboard change places."""
WEIGHTS = (1.0, 1.0, 0.3, 1.0, 1.0, 1.0)
"""Of the squared errors of u, v, p, r, phi, psi, as in the training of the recursive network; and of x and y:"""
TRACK_WEIGHT = 0.1
HEADING = 0.2
"""Error of the heading that counts as much as a standard deviation of a velocity [rad]."""


class GatedSimulator(nn.Module):
    """Controls over time to velocities over time: a layer of gated cells and a linear one.

    Steps are .09 L/U0, inputs rudder angles and shaft speeds of both sides and the Froude number, outputs u, v, p, r
    over U0 and U0/L. Port and starboard are alike: ``(f(x) + S f(M x)) / 2``, M changing sides and signs.

    Source:
        torch.nn.LSTM and torch.nn.GRU; Hochreiter & Schmidhuber 1997, Cho et al. 2014.
    """

    signs: Tensor
    size: Tensor

    def __init__(self, kind: Kind, ship: Ship, seed: int) -> None:
        """Draw the first weights.

        Args:
            kind: Cells.
            ship: The ship.
            seed: Seed.
        """
        super().__init__()
        torch.manual_seed(seed)
        self.kind, self.ship = kind, ship
        self.cells = getattr(nn, kind)(5, HIDDEN[kind], batch_first=True)
        self.outputs = nn.Linear(HIDDEN[kind], len(VELOCITIES))
        self.register_buffer("signs", torch.tensor(MIRROR))
        self.register_buffer("size", torch.ones(5))

    @property
    def weights_count(self) -> int:
        """Number of weights and biases."""
        return sum(p.numel() for p in self.parameters())

    def course(self, runs: Sequence[Recording]) -> Course:
        """Runs in dimensionless time."""
        made = course_of(runs, self.ship, VELOCITIES, step=STEP)
        return made.to(self.outputs.weight)

    def sail(self, course: Course) -> tuple[Float[Tensor, "rows steps 8"], Float[Tensor, "rows steps"]]:
        """Runs from their controls and approach speeds.

        Args:
            course: The runs.

        Returns:
            u, v, p, r, phi, psi, x, y, dimensionless; and times in L/U0.
        """
        rows = torch.arange(len(course.speed))
        time = (STEP * torch.arange(int(course.duration.max() / STEP) + 2)).expand(len(rows), -1)
        controls = course.controls.rows(rows).at(time)
        froude = (course.speed / (GRAVITY * course.length) ** 0.5)[:, None, None].expand(*time.shape, 1)
        seen = torch.cat([controls, froude], dim=-1)
        seen = torch.cat([seen[:, :1].expand(-1, STEADY, -1), seen], dim=1) / self.size
        velocities = self._both_sides(seen)[:, STEADY:]
        first = course.motion.rows(rows).at(time[:, :1])
        # The start is known; what the network says is the change since then.
        velocities = first[..., :4] + velocities - velocities[:, :1]
        angles = first[..., 4:6] + nn.functional.pad(
            (0.5 * STEP * (velocities[:, 1:, 2:] + velocities[:, :-1, 2:])).cumsum(1), (0, 0, 1, 0)
        )
        return torch.cat([velocities, angles, track_of(velocities, angles[..., 1], time)], dim=-1), time

    def _both_sides(self, seen: Float[Tensor, "rows steps 5"]) -> Float[Tensor, "rows steps 4"]:
        """The mean of the answer and its mirror image's."""
        mirrored = seen[..., [1, 0, 3, 2, 4]] * seen.new_tensor([-1.0, -1.0, 1.0, 1.0, 1.0])
        here, there = self.outputs(self.cells(torch.cat([seen, mirrored]))[0]).chunk(2)
        return 0.5 * (here + there * self.signs)

    @torch.no_grad()
    def predict(self, runs: Sequence[Recording]) -> list[Recording]:
        """Predictions of runs from their controls and first samples.

        Args:
            runs: The recorded runs.

        Returns:
            As many, at the recorded times.
        """
        course, length = self.course(runs), self.ship.particulars.length
        made, time = self.sail(course)
        found = []
        for k, (run, speed) in enumerate(zip(runs, course.speed.tolist(), strict=True)):
            units = np.array([speed, speed, speed / length, speed / length, 1.0, 1.0, length, length])
            curve = CubicSpline(time[k].double().numpy() * length / speed, made[k].double().numpy() * units)
            values = curve(run.time - run.time[0]).T
            channels = dict(zip((*VELOCITIES, "phi", "psi", "x", "y"), values, strict=True))
            channels |= {axis: channels[axis] + run[axis][0] for axis in ("x", "y")}
            found.append(Recording(run.name, run.time, channels, meta=run.meta))
        return found


def gated(kind: Kind, runs: RunSet, seed: int, *, quick: bool = False, say: Say = lambda _: None) -> TrainedSimulator:
    """Train gated cells on whole runs, chosen as the recursive network is.

    Args:
        kind: Cells.
        runs: Training runs teach it, training and validation runs decide which weights are kept.
        seed: Of the first weights.
        quick: Whether it is the short form.
        say: Told how far it is.

    Returns:
        The simulator.
    """
    began = process_time()
    network = GatedSimulator(kind, runs.ship, seed)
    course = network.course(runs.training)
    there, scales, weights, counted = _targets(network, course)
    best = BestWeights.of(network, network.predict, runs)
    updates, scores = (QUICK_UPDATES, QUICK_SCORES) if quick else (UPDATES, SCORES)
    optimizer = torch.optim.AdamW(network.parameters(), lr=RATE, weight_decay=0.0, betas=(0.9, 0.99))
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, RATE, total_steps=updates, pct_start=0.1)
    for k in range(updates):
        made, _ = network.sail(course)
        loss = (((made - there) / scales).square() * weights * counted).sum() / counted.sum()
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        optimizer.step()
        schedule.step()
        if (k + 1) % (updates // scores) == 0 or k == updates - 1:
            best.test(k + 1, float(loss.detach()))
            say(f"{kind}: {k + 1} of {updates} updates, angle measure {best.rows[-1]['average_angle']:.4f}")
    history = best.restore()
    return TrainedSimulator(kind, network.predict, process_time() - began, network.weights_count, history)


@torch.no_grad()
def _targets(network: GatedSimulator, course: Course) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Recorded motion at the steps, what errors are divided by, weights, and which steps count; sizes the inputs."""
    time = network.sail(course)[1]
    rows = torch.arange(len(time))
    there, controls = course.motion.rows(rows).at(time), course.controls.rows(rows).at(time)
    counted = (time <= course.duration[:, None]).to(there)[..., None]
    spreads = there[counted[..., 0] > 0].std(0)
    extent = (there[..., 6:].amax(1) - there[..., 6:].amin(1)).clamp(min=0.1)
    shared = torch.cat([spreads[:5], spreads.new_tensor([HEADING])]).expand(len(rows), -1)
    scales = torch.cat([shared, 0.1 * extent], dim=1)[:, None]
    largest = controls.abs().amax((0, 1)).clamp(min=1e-6)
    network.size.copy_(torch.cat([largest, largest.new_ones(1)]))
    return there, scales, there.new_tensor([*WEIGHTS, TRACK_WEIGHT, TRACK_WEIGHT]), counted
