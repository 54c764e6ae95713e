"""Which manoeuvre to sail next: what the members of an ensemble would still disagree about after each of several."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import cast

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.manoeuvre import Manoeuvre
from manoeuvre_nn.core.ship import Particulars
from manoeuvre_nn.core.units import DEGREE, GRAVITY
from manoeuvre_nn.dynamics.base import Dynamics
from manoeuvre_nn.dynamics.limits import OK, left_range
from manoeuvre_nn.dynamics.members import Members, has_members
from manoeuvre_nn.dynamics.model import IdentifiedShip
from manoeuvre_nn.dynamics.rollout import rollout
from manoeuvre_nn.dynamics.simulate import Problem
from manoeuvre_nn.network.hull_rudder import HullRudder
from manoeuvre_nn.optimizer.semilinear import SemiLinear
from manoeuvre_nn.recording.tuples import Tuples

PER_LENGTH = 8
"""Steps, and samples, in the time L/U0: a model's forces over a few lengths are smooth."""
LOST = 5.0
"""Deviation over L beyond which a track is lost, however far it goes [-]."""

HEEL = 12.0
"""Angle of heel in a turn that is worth a word [deg]."""

Say = Callable[[str], None]


@dataclass(frozen=True)
class Sailed:
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
class Prospect:
    """What sailing a candidate is expected to bring.

    Attributes:
        manoeuvre: Its name.
        seconds: How long it takes [s].
        now: Expected deviation from the targets' tracks over L with what is known now, mean of the targets other than
            the candidate itself [-].
        then: The same after it.
        targets: Target -> both of them.
        status: ``ok``, or what speaks against sailing it.
    """

    manoeuvre: str
    seconds: float
    now: float
    then: float
    targets: Mapping[str, tuple[float, float]]
    status: str = OK

    @property
    def gain(self) -> float:
        """Deviation over L that it takes away [-]."""
        return self.now - self.then

    @property
    def per_minute(self) -> float:
        """The same for every minute of sailing [1/min]."""
        return 60 * self.gain / self.seconds


@dataclass(frozen=True)
class Effort:
    """How much is computed.

    Attributes:
        truths: Members that are taken as the truth, one after the other.
        others: Members that learn from it each time.
        samples: Samples of a run that they learn from at most.
        seed: Seed of the noise.
    """

    truths: int = 4
    others: int = 8
    samples: int = 400
    seed: int = 0

    def __post_init__(self) -> None:
        """Refuse what computes nothing.

        Raises:
            InputError: If a number is too small.
        """
        for name, least in (("truths", 1), ("others", 2), ("samples", 50)):
            if getattr(self, name) < least:
                raise InputError(f"effort.{name}={getattr(self, name)}: expected {least} or more")


def sail(model: IdentifiedShip, manoeuvres: Sequence[Manoeuvre]) -> list[Sailed]:
    """Every member through every manoeuvre, in steps of L/(8 U0).

    Args:
        model: An ensemble; any other model is its own single member.
        manoeuvres: What is sailed.

    Returns:
        One a manoeuvre, in their order.
    """
    made: dict[int, Sailed] = {}
    for speed in dict.fromkeys(m.speed for m in manoeuvres):
        rows = [k for k, m in enumerate(manoeuvres) if m.speed == speed]
        made |= zip(rows, _sailed(model, [manoeuvres[k] for k in rows]), strict=True)
    return [made[k] for k in range(len(manoeuvres))]


def _sailed(model: IdentifiedShip, group: Sequence[Manoeuvre]) -> Iterator[Sailed]:
    """Manoeuvres of one approach speed in one batch, member after member."""
    moving: Dynamics = Members(model) if has_members(model) else model
    moving, start, _ = Problem(moving, group[0]).on_approach()
    ship, count = moving.particulars, moving.count if isinstance(moving, Members) else 1
    for manoeuvre in group:
        manoeuvre.check(ship)
    step = ship.time_unit / PER_LENGTH
    ends = [m.duration_for(ship) for m in group]
    with torch.inference_mode():
        times = start.new_tensor(np.arange(0.0, max(ends) + 1e-9, step))
        rows = start[:6].repeat(count * len(group), 1)
        first = moving.start(rows, rows[:, 5])
        run = rollout(moving, list(group) * count, first, times, step=step)
    states = run.states[..., :6].unflatten(1, (count, len(group))).clone()
    rudders, ended = run.rudders.unflatten(1, (count, len(group))).clone(), run.ended.view(count, len(group))
    for k, (manoeuvre, end) in enumerate(zip(group, ends, strict=True)):
        n = max(int((times <= end + 1e-9).sum()), 2)
        gone = torch.where(ended[:, k] <= end, ended[:, k], torch.inf)
        yield Sailed(manoeuvre, times[:n].clone(), states[:n, :, k].movedim(0, 1), rudders[:n, :, k].T, gone)


def remark(run: Sailed, ship: Particulars) -> str:
    """What speaks against sailing a manoeuvre.

    Args:
        run: The manoeuvre as the members sail it.
        ship: The ship, for its stability.

    Returns:
        ``ok``, or that members leave the physical range, or heel more than :data:`HEEL`.

    Source:
        Heel in a turn, ``tan phi = u r (KG - T/2) / (g GM)``: Biran & Lopez-Pulido 2014, section 6.4.
    """
    lost = int(run.ended.isfinite().sum())
    if lost:
        return f"{lost} of {len(run.ended)} members {left_range(float(run.ended.min()))}"
    hull = ship.heeling
    outward = (run.states[..., 0] * run.states[..., 2]).abs().amax(1).median()
    heel = float(torch.atan(outward * (hull.kg - ship.draught / 2) / (GRAVITY * hull.gm))) / DEGREE
    return f"heels {heel:.0f} deg" if heel > HEEL else OK


@dataclass(frozen=True)
class Disagreement:
    """How far the members disagree about the forces along a manoeuvre.

    Attributes:
        manoeuvre: Its name.
        times: Sample times [s].
        motion: v', r' [-] over U0 and U0/L, rudder angle [rad]: medians of the members.
        spread: Standard deviation of the forces over the root mean square of those that were trained on [-].
    """

    manoeuvre: str
    times: Float[np.ndarray, " t"]
    motion: Float[np.ndarray, "t 3"]
    spread: Float[np.ndarray, " t"]


@torch.no_grad()
def disagreements(model: IdentifiedShip, tuples: Tuples, runs: Sequence[Sailed]) -> list[Disagreement]:
    """Where the members disagree.

    Args:
        model: An ensemble.
        tuples: What it was trained on.
        runs: Manoeuvres as the members sail them.

    Returns:
        One a manoeuvre, in their order.
    """
    network, ship, made = cast(HullRudder, model.network), model.particulars, []
    size = model.scaling.outputs(tuples.targets).square().mean(0).sqrt()
    units = torch.tensor([ship.speed, ship.speed / ship.length, 1.0]).to(size)
    for run in runs:
        path = torch.cat([run.states[..., :3], run.rudders[..., None]], dim=-1).quantile(0.5, dim=0)
        each = network.each(network_inputs(model, path).expand(len(run.states), -1, -1), len(run.states))
        spread = (each.std(dim=0) / size).square().mean(-1).sqrt()
        made.append(Disagreement(run.manoeuvre.name, *(x.numpy() for x in (run.times, path[:, 1:] / units, spread))))
    return made


def network_inputs(model: IdentifiedShip, path: Float[Tensor, "*batch 4"]) -> Float[Tensor, "*batch 4"]:
    """What a model's network sees.

    Args:
        model: The model.
        path: u, v [m/s], r [rad/s], rudder angle [rad].

    Returns:
        Scaled inputs.
    """
    return model.scaling.inputs(torch.cat([path[..., :3] / model.known.velocity_units, path[..., 3:]], dim=-1))


def prospects(
    model: IdentifiedShip,
    tuples: Tuples,
    candidates: Sequence[Manoeuvre],
    targets: Sequence[Manoeuvre],
    *,
    effort: Effort | None = None,
    say: Say = lambda _: None,
) -> list[Prospect]:
    """What each candidate is expected to bring for the prediction of the targets.

    One member after the other is taken as the truth and sails the candidate; what it would record is given to the
    others, which change their linear weights by least squares over all data, in ridge regression about those they have:
    a change of a weight's own size costs as much as the noise of one sample. Expected is the largest distance over L
    between the truth's track of a target and the median of the others' tracks, averaged over truths and targets. The
    recorder's noise is what the members leave of the data that they were trained on.

    Args:
        model: An ensemble that was trained on the tuples.
        tuples: What it was trained on.
        candidates: What could be sailed next.
        targets: What is to be predicted.
        effort: How much is computed.
        say: Called before each candidate.

    Returns:
        One a candidate, in their order.

    Raises:
        InputError: If the model is no ensemble of hulls and rudders, or there is nothing to choose from.

    Source:
        Expected error over members taken as the truth: MacKay 1992 (information-based objective functions for active
        data selection), Cohn, Ghahramani & Jordan 1996 (variance of what is predicted, not of the parameters).
    """
    network = model.network
    if not isinstance(network, HullRudder) or not has_members(model):
        raise InputError("goal=accuracy asks the members of an ensemble: network=hull_rudder, or goal=coefficients")
    if not candidates or not targets:
        raise InputError("candidates=[] or targets=[]: name at least one manoeuvre of each, such as candidates=[zz20]")
    world = _World(model, network, tuples, sail(model, targets), effort or Effort())
    found = []
    for run in sail(model, candidates):
        say(run.manoeuvre.name)
        found.append(world.prospect(run))
    return found


class _World:
    """The members, each taken as the truth for the others."""

    def __init__(
        self, model: IdentifiedShip, network: HullRudder, tuples: Tuples, targets: list[Sailed], effort: Effort
    ) -> None:
        """Find out how well the targets are known now."""
        self.model, self.network, self.targets, self.effort = model, network, targets, effort
        count = int(network.trained)
        self.truths = torch.linspace(0, count - 1, min(effort.truths, count)).round().long().tolist()
        self.others = [[(t + 1 + k) % count for k in range(min(effort.others, count - 1))] for t in self.truths]
        scaling = model.scaling
        self.known = _thinned(scaling.inputs(tuples.inputs), scaling.outputs(tuples.targets), effort.samples)
        with torch.no_grad():
            each = network.each(self.known[0].expand(count, -1, -1), count)
        self.noise = (each - self.known[1]).square().mean((0, 1)).sqrt()
        self.now = self._deviations([[run.tracks[rows] for run in targets] for rows in self.others])

    def prospect(self, run: Sailed) -> Prospect:
        """What a candidate would bring."""
        learnt = [self._learnt(run, t, rows) for t, rows in zip(self.truths, self.others, strict=True)]
        weights = [torch.cat(parts) for parts in zip(*learnt, strict=True)]
        network, scaling = self.network.with_weights(*weights), self.model.scaling
        after = sail(IdentifiedShip(self.model.known, network, scaling), [t.manoeuvre for t in self.targets])
        parts = torch.arange(len(weights[0])).split([len(rows) for rows in self.others])
        then = self._deviations([[run.tracks[rows] for run in after] for rows in parts])
        pairs = zip(self.now.mean(0).tolist(), then.mean(0).tolist(), strict=True)
        by_target = dict(zip([t.manoeuvre.name for t in self.targets], pairs, strict=True))
        # A candidate that is itself to be predicted would else be praised for having been seen.
        other = [k for k, t in enumerate(self.targets) if t.manoeuvre.name != run.manoeuvre.name]
        other = other or list(range(len(self.targets)))
        means = float(self.now[:, other].mean()), float(then[:, other].mean())
        return Prospect(run.manoeuvre.name, run.seconds, *means, by_target, remark(run, self.model.particulars))

    def _learnt(self, run: Sailed, truth: int, rows: list[int]) -> tuple[Tensor, Tensor]:
        """Weights of the others after they learnt what one member would record."""
        alive = run.times <= float(run.ended[truth]) - 1e-9 if isfinite(run.ended[truth]) else run.times >= 0
        path = torch.cat([run.states[truth, :, :3], run.rudders[truth, :, None]], dim=-1)
        x = network_inputs(self.model, path[alive])
        with torch.no_grad():
            forces = self.network.of(x, torch.full((len(x),), truth))
        generator = torch.Generator().manual_seed(self.effort.seed * 1_009 + truth)
        forces = forces + self.noise * torch.randn(forces.shape, generator=generator, dtype=torch.float64).to(forces)
        x, forces = _thinned(x, forces, self.effort.samples)
        x, y = torch.cat([self.known[0], x]), torch.cat([self.known[1], forces])
        weights = [self._updated(member, x, y) for member in rows]
        return self.network.input_weights[rows].detach(), torch.cat(weights)

    @torch.no_grad()
    def _updated(self, member: int, x: Tensor, y: Tensor) -> Tensor:
        """Linear weights of a member by all data; how far they may go is of their own size, and less in noise."""
        network, now = self.network, self.network.output_weights[member]
        missed = y - network.of(x, torch.full((len(x),), member))
        ridge = float(self.noise.mean() / now.abs().median().clamp(min=1e-12)) / len(x) ** 0.5
        design = dict(vars(network.design(x)))
        problem = SemiLinear(design.pop("features"), missed, network.sees, ridge=max(ridge, 1e-10), **design)
        return now + problem.output_weights(network.input_weights[member][network.sees][None])

    def _deviations(self, tracks: Sequence[Sequence[Float[Tensor, "_ _ 2"]]]) -> Float[Tensor, "truths targets"]:
        """Largest distance over L between every truth and the median of the others, target by target."""
        length = self.model.particulars.length
        far = [
            [(_median(o) - run.tracks[t]).norm(dim=-1).max() / length for o, run in zip(row, self.targets, strict=True)]
            for t, row in zip(self.truths, tracks, strict=True)
        ]
        return torch.tensor(far).clamp(max=LOST)


def _median(tracks: Float[Tensor, "j t 2"]) -> Float[Tensor, "t 2"]:
    return tracks.quantile(0.5, dim=0)


def _thinned(x: Tensor, y: Tensor, most: int) -> tuple[Tensor, Tensor]:
    """Every k-th sample, so that at most some number is left."""
    step = -(-len(x) // most)
    return x[::step], y[::step]
