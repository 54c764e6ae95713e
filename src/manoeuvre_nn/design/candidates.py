"""Candidates and targets as every member of an ensemble would sail them."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.core.manoeuvre import Manoeuvre
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.units import DEGREE, GRAVITY
from manoeuvre_nn.dynamics.base import Model
from manoeuvre_nn.dynamics.limits import OK, left_range
from manoeuvre_nn.dynamics.members import Members, has_members
from manoeuvre_nn.dynamics.model import IdentifiedShip
from manoeuvre_nn.dynamics.rollout import rollout
from manoeuvre_nn.dynamics.simulate import on_approach

STEPS_PER_LENGTH = 8
"""Steps, and samples, in the time L/U0: a model's forces over a few lengths are smooth."""
HEEL_WARNING_DEG = 12.0
"""Angle of heel in a turn that is worth a word [deg]."""


@dataclass(frozen=True)
class CandidateRun:
    """A manoeuvre as every member sails it.

    Attributes:
        manoeuvre: What is sailed.
        times: Sample times [s].
        states: u, v, r, x, y, psi; a member that leaves the physical range rests from then on.
        rudders: Rudder angle [rad].
        ended: Time at which a member left the physical range [s]; ``inf`` if it did not.
    """

    manoeuvre: Manoeuvre
    times: Float[Tensor, " t"]
    states: Float[Tensor, "k t 6"]
    rudders: Float[Tensor, "k t"]
    ended: Float[Tensor, " k"]

    @property
    def seconds(self) -> float:
        """How long it takes [s]."""
        return float(self.times[-1])

    @property
    def tracks(self) -> Float[Tensor, "k t 2"]:
        """North and east [m]."""
        return self.states[..., 3:5]


@dataclass(frozen=True)
class ExpectedGain:
    """What sailing a candidate is expected to bring: for predictions of targets, or for coefficients.

    Attributes:
        manoeuvre: Its name.
        seconds: How long it takes [s].
        now: With what is recorded: expected deviation from the targets' tracks over L, mean of the targets; or standard
            error of a term's force over the noise of a sample, geometric mean [-].
        then: The same after it. A candidate that is a target itself gets no credit for having been seen: the others'
            share of deviation that is left counts for it too.
        gain: Deviation over L that it takes away; or growth of half the log determinant of the information matrices of
            X, Y and N, for each coefficient [-].
        targets: Target, or equation -> both of them.
        status: ``ok``, or what speaks against sailing it.
    """

    manoeuvre: str
    seconds: float
    now: float
    then: float
    gain: float
    targets: Mapping[str, tuple[float, float]]
    status: str = OK

    @property
    def per_minute(self) -> float:
        """Gain for every minute of sailing [1/min]."""
        return 60 * self.gain / self.seconds


def sail(model: IdentifiedShip, manoeuvres: Sequence[Manoeuvre], interval: float | None = None) -> list[CandidateRun]:
    """Every member through every manoeuvre, in steps of L/(8 U0) at most.

    Args:
        model: An ensemble; any other model is its own single member.
        manoeuvres: What is sailed.
        interval: Time between samples [s]; None is L/(8 U0).

    Returns:
        One a manoeuvre, in their order.
    """
    made: dict[int, CandidateRun] = {}
    for speed in dict.fromkeys(m.speed for m in manoeuvres):
        rows = [k for k, m in enumerate(manoeuvres) if m.speed == speed]
        made |= zip(rows, _sailed(model, [manoeuvres[k] for k in rows], interval), strict=True)
    return [made[k] for k in range(len(manoeuvres))]


def _sailed(model: IdentifiedShip, group: Sequence[Manoeuvre], interval: float | None) -> Iterator[CandidateRun]:
    """Manoeuvres of one approach speed in one batch, member after member."""
    moving: Model = Members(model) if has_members(model) else model
    count = moving.count if isinstance(moving, Members) else 1
    vessel, start = on_approach(moving, group[0])
    ship = vessel.model.particulars
    for manoeuvre in group:
        manoeuvre.check(ship)
    step = ship.time_unit / STEPS_PER_LENGTH
    ends = [m.duration_for(ship) for m in group]
    with torch.inference_mode():
        times = start.new_tensor(np.arange(0.0, max(ends) + 1e-9, interval or step))
        rows = start[:6].repeat(count * len(group), 1)
        first = vessel.model.start(rows, Inputs(rows[:, 5]))
        run = rollout(vessel, list(group) * count, first, times, step=step)
    states = run.states[..., :6].unflatten(1, (count, len(group))).clone()
    rudders, ended = run.shown.unflatten(1, (count, len(group))).clone(), run.ended.view(count, len(group))
    for k, (manoeuvre, end) in enumerate(zip(group, ends, strict=True)):
        n = max(int((times <= end + 1e-9).sum()), 2)
        gone = torch.where(ended[:, k] <= end, ended[:, k], torch.inf)
        yield CandidateRun(manoeuvre, times[:n].clone(), states[:n, :, k].movedim(0, 1), rudders[:n, :, k].T, gone)


def remark(run: CandidateRun, ship: Particulars) -> str:
    """What speaks against sailing a manoeuvre: members that leave the physical range, or much heel.

    Source:
        Heel in a turn, ``tan phi = u r (KG - T/2) / (g GM)``: Biran & Lopez-Pulido 2014, section 6.4.

    Returns:
        ``ok``, or the remark.
    """
    lost = int(run.ended.isfinite().sum())
    if lost:
        return f"{lost} of {len(run.ended)} members {left_range(float(run.ended.min()))}"
    hull = ship.heeling
    outward = (run.states[..., 0] * run.states[..., 2]).abs().amax(1).median()
    heel = float(torch.atan(outward * (hull.kg - ship.draught / 2) / (GRAVITY * hull.gm))) / DEGREE
    return f"heels {heel:.0f} deg" if heel > HEEL_WARNING_DEG else OK
