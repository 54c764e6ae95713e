"""Runs that could be recorded next: manoeuvres sailed with what was found, as the recorder would write them down."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import ceil

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.effect import Effect, Parameter, Situation
from manoeuvre_nn.core.manoeuvre import Manoeuvre
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.diagnosis.bench import NOMINAL, Bench, Place, moved_track
from manoeuvre_nn.diagnosis.hypothesis import RANDOM, Hypothesis
from manoeuvre_nn.diagnosis.linear import shown
from manoeuvre_nn.diagnosis.runs import Run, order_lead
from manoeuvre_nn.dynamics.affected import Affected
from manoeuvre_nn.dynamics.base import Dynamics
from manoeuvre_nn.dynamics.rollout import rollout
from manoeuvre_nn.manoeuvre.straight import straight
from manoeuvre_nn.manoeuvre.turning import pull_out, turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag

LENGTHS, PER_LENGTH = 16.0, 6
"""Length of a simulated run over L/U0, and samples in L/U0: their noise is that of the means of those recorded."""
HEADINGS = (0.0, 90.0, 180.0, 270.0)
"""Approach headings relative to the recorded one [deg]."""
HALF = 0.5
"""Shaft speed, and with it approach speed, over the nominal one, of further runs on the recorded heading."""
CHANNELS = {"position": (0, 1), "speed and course over ground": (2, 3), "heading": (4,), "rate of turn": (5,),
            "speed log": (6,), "shaft speed": (7,)}  # fmt: skip
"""What can be written down too -> channels of a run."""


@dataclass(frozen=True)
class Plan:
    """A run that could be recorded.

    Attributes:
        words: What to sail.
        place: The run on the bench, as it would go.
        heading: Approach heading [rad]; None is that of the run that is repeated.
        share: Approach speed over the nominal one.
        row: Recorded run whose values of the hypotheses it takes over.
    """

    words: str
    place: Place
    heading: float | None = None
    share: float = 1.0
    row: int = 0


def same_runs(stand: Bench) -> Iterator[Plan]:
    """Every recorded run once more, with one of the channels that no run has.

    Args:
        stand: The recordings.

    Yields:
        Plans.
    """
    present = np.any([np.isfinite(p.line.run.measured).any(axis=0) for p in stand.places], axis=0)
    for words, channels in CHANNELS.items():
        if present[list(channels)].any():
            continue
        for row, place in enumerate(stand.places):
            run, track = place.line.run, place.line.track
            measured = run.measured.copy()
            measured[:, channels] = shown(track)[:, channels]
            noise = np.where(np.isin(np.arange(len(NOMINAL)), channels), NOMINAL, place.noise)
            more = replace(place, line=replace(place.line, run=replace(run, measured=measured)), noise=noise)
            yield Plan(f"{run.name} again with the {words}", moved_track(stand.dynamics, more, track)[0], row=row)


def _manoeuvres(limit: float) -> dict[str, Manoeuvre]:
    """What is tried, in words."""
    made = {"a straight run": straight(), "a pull-out after a 20 deg turn": pull_out(20.0, turn_deg=60.0)}
    for side in ("starboard", "port"):
        made |= {f"a {a:.0f}/{a:.0f} zigzag, first to {side},": zigzag(a, first=side) for a in (10.0, 20.0, 35.0)}
        made |= {f"a {a:.0f} deg turning circle to {side}": turning_circle(a, side) for a in (20.0, 35.0)}
    return {words: m for words, m in made.items() if m.largest_order <= limit + 1e-9}


def new_runs(stand: Bench, hypothesis: Hypothesis) -> Iterator[Plan]:
    """Every manoeuvre on every heading, and at half speed, sailed with what was found, unless it breaks down.

    Args:
        stand: The recordings: their channels and noise, and the heading of the first.
        hypothesis: What acts.

    Yields:
        Plans.
    """
    dynamics, first = stand.dynamics, stand.places[0].line
    ship, step = dynamics.particulars, first.run.step
    interval = step * max(1, ceil(ship.time_unit / PER_LENGTH / step - 0.5))
    made = _manoeuvres(ship.rudder_limit)
    begun = [(first.track[0, 5] + h * DEGREE, 1.0) for h in HEADINGS] + [(first.track[0, 5], HALF)]
    tried = [(words, m, *how) for words, m in made.items() for how in begun]
    times = np.arange(0.0, LENGTHS * ship.time_unit, interval)
    acting = _acting(dynamics, hypothesis, [share for *_, share in tried])
    state = torch.zeros(len(tried), 6, dtype=torch.float64)
    state[:, 0] = ship.speed * torch.tensor([share for *_, share in tried])
    state[:, 5] = torch.tensor([heading for _, _, heading, _ in tried])
    with torch.no_grad():
        start = acting.start(state, acting.blade_at_rest(state[:, 0] * 0)[:, -1])
        runs = rollout(acting, [m for _, m, *_ in tried], start, torch.tensor(times), step=interval)
    for row, (words, manoeuvre, heading, share) in enumerate(tried):
        end = min(float(runs.ended[row]), ship.longest_turn if manoeuvre.kind == "turning_circle" else np.inf)
        n = int(np.sum(times < end - 1e-9))
        if n < 0.5 * len(times):
            continue
        delta, order = (x[:n, row].numpy() for x in (runs.rudders, runs.orders))
        lead = order_lead(delta, order, interval, ship.rudder_rate)
        track = runs.states[:n, row, :6].numpy()
        blank = Run(words, times[:n], shown(track), delta, order, lead, np.full(n, share), first.run.rudder_noise)
        yield Plan(words, _seen(stand, blank, track, step / interval), heading, share)


def _seen(stand: Bench, run: Run, track: Float[np.ndarray, "n 6"], thinned: float) -> Place:
    """A simulated run with the channels and the noise of the recorded ones, thinned out to some share of samples."""
    present = np.any([np.isfinite(p.line.run.measured).any(axis=0) for p in stand.places], axis=0)
    noise = np.sqrt(thinned * np.mean([p.noise**2 for p in stand.places], axis=0))
    run = replace(run, measured=np.where(present, run.measured, np.nan), rudder_noise=run.rudder_noise * thinned**0.5)
    some = stand.places[0]
    bare = replace(some, line=replace(some.line, run=run), noise=noise, force=np.zeros((len(run), 3)))
    return moved_track(stand.dynamics, bare, track)[0]


def _acting(dynamics: Dynamics, hypothesis: Hypothesis, shares: Sequence[float]) -> Affected:
    """The ship with a hypothesis acting, gusts left out, its shaft at shares of its nominal speed."""
    effects = [_Telegraph(dynamics.hull).at(torch.tensor(shares, dtype=torch.float64)[:, None])]
    for effect, values in zip(hypothesis.effects, hypothesis.values, strict=True):
        steady = np.array([p.name != RANDOM[0] for p in effect.declared], dtype=float)
        effects.append(effect.at(torch.tensor(values[0] * steady)))
    return Affected(dynamics, effects)


class _Telegraph(Effect):
    """A shaft at a share of its nominal speed."""

    declared = (Parameter("share", "-", 0.1, 1.0, 1.0, 0.1, (1.0,)),)

    def shaft(self, s: Situation, memory: Float[Tensor, "*batch m"]) -> Float[Tensor, "*batch"]:
        """Its share at any time.

        Args:
            s: The situation.
            memory: Not used.

        Returns:
            Ratio [-].
        """
        del memory
        return self.value("share").expand(s.delta.shape)
