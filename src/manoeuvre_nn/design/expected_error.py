"""Which manoeuvre to sail next: what the members of an ensemble would still disagree about after each of several."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import cast

import pandas as pd
import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.channels import MOTION
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.core.limits import as_seed
from manoeuvre_nn.core.manoeuvre import Manoeuvre
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.terminal import Say
from manoeuvre_nn.design.candidates import CandidateRun, ExpectedGain, remark, sail
from manoeuvre_nn.dynamics.members import has_members
from manoeuvre_nn.dynamics.model import IdentifiedShip
from manoeuvre_nn.network.hull_rudder import HullRudder
from manoeuvre_nn.numerics.damping import Stops
from manoeuvre_nn.numerics.restarts import minimise
from manoeuvre_nn.recording.tuples import Tuples

FURTHER_STEPS = 3
"""Steps in which members take in what is new after an exact fit."""
OF_ENSEMBLE = "the members of an ensemble: network=hull_rudder with network.members=2 or more"
"""What can be asked for the accuracy of predictions."""
MAX_DEVIATION = 5.0
"""Deviation over L beyond which a track is lost, however far it goes [-]."""

Record = Callable[[Recording, int], Tuples]
"""What a sailed manoeuvre would be learnt as, with noise of a seed."""


@dataclass(frozen=True)
class DesignEffort:
    """How much is computed.

    Attributes:
        truths: Members that are taken as the truth, one after the other; all of them where they are fewer.
        others: Members that learn from it each time.
        samples: Samples of what is recorded already that they learn from at most; a candidate's are as dense.
        seed: Seed of the noise.
        steps: Steps from first weights in which members are trained, as in noise; None lets them go on from the weights
            that they have, as after an exact fit.
    """

    truths: int = 4
    others: int = 8
    samples: int = 400
    seed: int = 0
    steps: int | None = None

    def __post_init__(self) -> None:
        """Refuse what computes nothing.

        Raises:
            InputError: If a number is too small.
        """
        for name, least in (("truths", 1), ("others", 2), ("samples", 50)):
            if getattr(self, name) < least:
                raise InputError(f"effort.{name}={getattr(self, name)}: expected {least} or more")


@torch.no_grad()
def disagreements(model: IdentifiedShip, tuples: Tuples, runs: Sequence[CandidateRun]) -> pd.DataFrame:
    """Where the members of an ensemble, trained on tuples, disagree about the forces along manoeuvres that they sail.

    Returns:
        manoeuvre; v, r [-] over U0 and U0/L, delta [rad]: medians of the members; spread: standard deviation of the
        forces over the root mean square of those that were trained on [-]. One row a sample.
    """
    network, ship, made = cast(HullRudder, model.network), model.particulars, []
    size = model.scaling.outputs(tuples.targets).square().mean(0).sqrt()
    units = torch.tensor([ship.speed, ship.speed / ship.length, 1.0]).to(size)
    for run in runs:
        path = torch.cat([run.states[..., :3], run.rudders[..., None]], dim=-1).quantile(0.5, dim=0)
        each = network.each(
            model.network_inputs(path[:, :3], Inputs(path[:, 3])).expand(len(run.states), -1, -1), len(run.states)
        )
        spread = (each.std(dim=0) / size).square().mean(-1).sqrt()
        motion = pd.DataFrame((path[:, 1:] / units).numpy(), columns=["v", "r", "delta"])
        made.append(motion.assign(manoeuvre=run.manoeuvre.name, spread=spread.numpy()))
    return pd.concat(made, ignore_index=True)


def prospects(
    model: IdentifiedShip,
    tuples: Tuples,
    candidates: Sequence[Manoeuvre],
    targets: Sequence[Manoeuvre],
    *,
    record: Record | None = None,
    effort: DesignEffort | None = None,
    say: Say = lambda *_: None,
) -> list[ExpectedGain]:
    """What each candidate is expected to bring for the prediction of the targets.

    One member after the other is taken as the truth. Where the data were recorded it would have made its own forces, to
    which the ensemble's errors there are added as they are: a bootstrap. It sails the candidate too. The others are
    trained on the one, and on both. Expected is the largest distance over L between the truth's track of a target and
    the median of the others' tracks, averaged over truths and targets, before and after.

    Where sensors are noisy, what they and the smoothing make of a candidate counts as much as where it leads: a rudder
    that moves often leaves errors in the accelerations that no length of record averages out. ``record`` does to a
    candidate what was done to the data. Without it forces are recorded as they are, but for white noise of the size
    that the members leave of the data that they were trained on.

    Args:
        model: An ensemble that was trained on the tuples.
        tuples: What it was trained on.
        candidates: What could be sailed next.
        targets: What is to be predicted.
        record: What sensors and smoothing make of a run.
        effort: How much is computed.
        say: Called before each candidate with what is done.

    Returns:
        One a candidate, in their order.

    Raises:
        InputError: If the model is no ensemble of hulls and rudders, or there is nothing to choose from.

    Source:
        Expected error over members taken as the truth: MacKay 1992 (information-based objective functions for active
        data selection), Cohn, Ghahramani & Jordan 1996 (variance of what is predicted, not of the parameters); Efron &
        Tibshirani 1993, chapter 9 (bootstrap of residuals).
    """
    network = model.network
    if not isinstance(network, HullRudder) or not has_members(model):
        raise InputError(f"goal=accuracy asks {OF_ENSEMBLE}, or goal=coefficients")
    if not candidates or not targets:
        raise InputError("candidates=[] or targets=[]: name at least one manoeuvre of each, such as candidates=[zz20]")
    truths = _MemberTruths(model, network, tuples, sail(model, targets), record, effort or DesignEffort())
    found: list[ExpectedGain] = []
    for run in sail(model, candidates, truths.interval):
        say(f"sailing after {run.manoeuvre.name}", len(found) / len(candidates))
        found.append(truths.prospect(run))
    return found


class _MemberTruths:
    """The members, each taken as the truth for the others."""

    def __init__(
        self,
        model: IdentifiedShip,
        network: HullRudder,
        tuples: Tuples,
        targets: list[CandidateRun],
        record: Record | None,
        effort: DesignEffort,
    ) -> None:
        """Find out how well the targets are known now."""
        self.model, self.network, self.targets, self.effort = model, network, targets, effort
        self.record = record
        self.interval = float((tuples.times[1:] - tuples.times[:-1]).median())
        self.every = -(-len(tuples.times) // effort.samples)
        count = int(network.trained)
        self.truths = torch.linspace(0, count - 1, min(effort.truths, count)).round().long().tolist()
        self.others = [[(t + 1 + k) % count for k in range(min(effort.others, count - 1))] for t in self.truths]
        x, y = self._scaled(tuples)
        with torch.no_grad():
            each = network.each(x.expand(count, -1, -1), count)
        self.noise = (each - y).square().mean((0, 1)).sqrt()
        # What would have been recorded already, truth by truth.
        self.seen = [(x, forces) for forces in each[self.truths] + (y - each.quantile(0.5, dim=0))]
        self.now = self._missed(self.seen)

    def prospect(self, run: CandidateRun) -> ExpectedGain:
        """What a candidate would bring."""
        recorded = [self._scaled(self._recorded(run, truth)) for truth in self.truths]
        both = [
            (torch.cat([x, new_x]), torch.cat([y, new_y]))
            for (x, y), (new_x, new_y) in zip(self.seen, recorded, strict=True)
        ]
        after = self._missed(both)
        pairs = zip(self.now.mean(0).tolist(), after.mean(0).tolist(), strict=True)
        by_target = dict(zip([t.manoeuvre.name for t in self.targets], pairs, strict=True))
        # A candidate that is itself to be predicted would else be praised for having been seen.
        other = [k for k, t in enumerate(self.targets) if t.manoeuvre.name != run.manoeuvre.name]
        other = other or list(range(len(self.targets)))
        now, left = float(self.now.mean()), after[:, other].mean() / self.now[:, other].mean().clamp(min=1e-12)
        then, status = now * float(left), remark(run, self.model.particulars)
        return ExpectedGain(run.manoeuvre.name, run.seconds, now, then, now - then, by_target, status)

    def _recorded(self, run: CandidateRun, truth: int) -> Tuples:
        """What would be learnt from a member's run, as long as it stays in the physical range."""
        alive = run.times < run.ended[truth]
        times, states, rudder = run.times[alive], run.states[truth, alive], run.rudders[truth, alive]
        seed = as_seed(self.effort.seed * 1_009 + truth)
        if self.record is not None:
            channels = dict(zip(MOTION, [*states.T.numpy(), rudder.numpy()], strict=True))
            meta = {"time_unit": self.model.particulars.time_unit}
            return self.record(Recording(run.manoeuvre.name, times.numpy(), channels, meta=meta), seed)
        with torch.no_grad():
            x = self.model.network_inputs(states, Inputs(rudder))
            forces = self.network.of(x, torch.full((len(x),), truth))
        generator = torch.Generator().manual_seed(seed)
        forces = forces + self.noise * torch.randn(forces.shape, generator=generator, dtype=torch.float64).to(forces)
        targets = self.model.scaling.restore(forces)
        inputs = torch.cat([states[:, :3] / self.model.known.velocity_units, rudder[:, None]], dim=-1)
        return Tuples(inputs, targets, times, torch.zeros_like(times).long())

    def _scaled(self, tuples: Tuples) -> tuple[Tensor, Tensor]:
        """Every k-th sample as the members see them."""
        scaling, part = self.model.scaling, slice(None, None, self.every)
        return scaling.inputs(tuples.inputs[part]), scaling.outputs(tuples.targets[part])

    @torch.no_grad()
    def _trained(self, members: list[int], x: Tensor, y: Tensor) -> tuple[Tensor, Tensor]:
        """Weights of members after they were trained on something."""
        network, cold = self.network, self.effort.steps is not None
        first = [network.drawn(k) if cold else network.input_weights[k] for k in members]
        problem = network.least_squares(x, y)
        start = torch.stack([weights[network.sees] for weights in first])
        stops = Stops(epochs=FURTHER_STEPS if self.effort.steps is None else self.effort.steps)
        found = minimise(problem, start, stops=stops, at_once=1).weights
        return problem.full(found), problem.output_weights(found)

    def _missed(self, data: Sequence[tuple[Tensor, Tensor]]) -> Float[Tensor, "truths targets"]:
        """How far the others, trained on some data of each truth, are from the truths' tracks of the targets."""
        trained = [self._trained(rows, x, y) for rows, (x, y) in zip(self.others, data, strict=True)]
        weights = [torch.cat(parts) for parts in zip(*trained, strict=True)]
        model = IdentifiedShip(self.model.known, self.network.with_weights(*weights), self.model.scaling)
        runs = sail(model, [t.manoeuvre for t in self.targets])
        parts = torch.arange(len(weights[0])).split([len(first) for first, _ in trained])
        length = self.model.particulars.length
        far = [
            [
                (run.tracks[rows].quantile(0.5, dim=0) - target.tracks[truth]).norm(dim=-1).max() / length
                for run, target in zip(runs, self.targets, strict=True)
            ]
            for truth, rows in zip(self.truths, parts, strict=True)
        ]
        return torch.tensor(far).clamp(max=MAX_DEVIATION)
