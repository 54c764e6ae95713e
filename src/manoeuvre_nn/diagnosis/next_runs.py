"""Runs that could be recorded next: manoeuvres sailed with what was found, as the recorder would write them down."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from manoeuvre_nn.core.effect import Effect, Parameter, Situation
from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.core.manoeuvre import Manoeuvre
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.diagnosis.case import seen_channels
from manoeuvre_nn.dynamics.base import Model
from manoeuvre_nn.dynamics.rollout import rollout
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.estimation.data_set import WhitenedDataSet
from manoeuvre_nn.estimation.hypothesis import Hypothesis
from manoeuvre_nn.estimation.linearised_run import shown
from manoeuvre_nn.estimation.prepared_run import PreparedRun, about_states
from manoeuvre_nn.manoeuvre.straight import straight
from manoeuvre_nn.manoeuvre.turning import pull_out, turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.recording.preparation import measured, order_lead, with_measured

LENGTHS, PER_LENGTH = 16.0, 6
"""Length of a simulated run over L/U0, and samples in L/U0: their noise is that of the means of those recorded."""
HEADINGS = (0.0, 90.0, 180.0, 270.0)
"""Approach headings relative to the recorded one [deg]."""
KIND_IN_SHORT = {"zigzag": "zz", "turning_circle": "tc", "pull_out": "po", "straight": "straight"}
"""Kind of manoeuvre -> how its name begins for machines; the rudder angle follows."""
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
        sailed: The same for machines: ``manoeuvre`` (zz20, tc35, po20, straight) and ``first_turn``; or ``repeat``, the
            name of a recorded run, and ``channel``, what to write down too.
        prepared: The run as it would go.
        heading: Approach heading [rad]; None is that of the run that is repeated.
        share: Approach speed over the nominal one.
        row: Recorded run whose values of the hypotheses it takes over.
    """

    words: str
    sailed: Mapping[str, str]
    prepared: PreparedRun
    heading: float | None = None
    share: float = 1.0
    row: int = 0

    @property
    def text(self) -> str:
        """The run in words, as the subject of a sentence."""
        begun = "" if self.heading is None else f" begun on heading {self.heading / DEGREE % 360:03.0f}"
        return f"{self.words}{begun}{' at half speed' if self.share < 1 else ''}"

    @property
    def as_dict(self) -> dict[str, str | float]:
        """The run for machines: ``sailed``, and of a new one ``speed_share``, and ``heading_deg`` where it matters."""
        if "repeat" in self.sailed:
            return dict(self.sailed)
        heading = {} if self.heading is None else {"heading_deg": round(self.heading / DEGREE) % 360.0}
        return {**self.sailed, **heading, "speed_share": self.share}


def same_runs(data_set: WhitenedDataSet) -> Iterator[Plan]:
    """Every recorded run once more, with one of the channels that no run has."""
    states = data_set.runs[0].linearised.states
    present = np.isin(states.channels, [*seen_channels([p.linearised.run for p in data_set.runs], states.channels)])
    rolls = {"roll angle": (states.channels.index("phi"),)} if "phi" in states.own else {}
    for words, channels in (CHANNELS | rolls).items():
        if present[list(channels)].any():
            continue
        for row, prepared in enumerate(data_set.runs):
            run, track = prepared.linearised.run, prepared.linearised.track
            seen = measured(run, states.channels)
            seen[:, channels] = shown(track)[:, channels]
            noise = np.where(np.isin(np.arange(len(present)), channels), states.first_noise, prepared.noise)
            run = with_measured(run, seen, states.channels)
            more = replace(
                prepared,
                linearised=replace(prepared.linearised, run=run),
                noise=noise,
            )
            again = about_states(data_set.dynamics, more, track)
            yield Plan(f"{run.name} again with the {words}", {"repeat": run.name, "channel": words}, again, row=row)


def _manoeuvres(limit: float) -> dict[str, Manoeuvre]:
    """What is tried, in words."""
    made = {"a straight run": straight(), "a pull-out after a 20 deg turn": pull_out(20.0, turn_deg=60.0)}
    for side in ("starboard", "port"):
        made |= {f"a {a:.0f}/{a:.0f} zigzag, first to {side},": zigzag(a, first=side) for a in (10.0, 20.0, 35.0)}
        made |= {f"a {a:.0f} deg turning circle to {side}": turning_circle(a, side) for a in (20.0, 35.0)}
    return {words: m for words, m in made.items() if m.largest_order <= limit + 1e-9}


def _sailed(manoeuvre: Manoeuvre) -> dict[str, str]:
    """A manoeuvre for machines."""
    angle = manoeuvre.stages[0].order / DEGREE
    short = KIND_IN_SHORT[manoeuvre.kind] + (f"{abs(angle):.0f}" if angle else "")
    return {"manoeuvre": short, "first_turn": "port" if angle < 0 else "starboard"}


def new_runs(data_set: WhitenedDataSet, hypothesis: Hypothesis) -> Iterator[Plan]:
    """Every manoeuvre on every heading, and at half speed, sailed with what was found, unless it breaks down.

    They have channels and noise of the recordings, and begin on the heading of the first.

    Yields:
        Plans.
    """
    dynamics, first = data_set.dynamics, data_set.runs[0].linearised
    ship, step = dynamics.particulars, first.run.step
    interval = max(step, ship.time_unit / PER_LENGTH)
    made = _manoeuvres(ship.rudder_limit)
    begun = [(first.track[0, 5] + h * DEGREE, 1.0) for h in HEADINGS] + [(first.track[0, 5], HALF)]
    tried = [(words, m, *how) for words, m in made.items() for how in begun]
    times = np.arange(0.0, LENGTHS * ship.time_unit, interval)
    acting = _acting(dynamics, hypothesis, [share for *_, share in tried])
    state = torch.zeros(len(tried), 6, dtype=torch.float64)
    state[:, 0] = ship.speed * torch.tensor([share for *_, share in tried])
    state[:, 5] = torch.tensor([heading for _, _, heading, _ in tried])
    with torch.no_grad():
        start = acting.model.start(state, Inputs(acting.gear.at_rest(state[:, 0] * 0)[:, -1]))
        runs = rollout(acting, [m for _, m, *_ in tried], start, torch.tensor(times), step=interval)
    for row, (words, manoeuvre, heading, share) in enumerate(tried):
        end = min(float(runs.ended[row]), ship.longest_turn if manoeuvre.kind == "turning_circle" else np.inf)
        n = int(np.sum(times < end - 1e-9))
        if n < 0.5 * len(times):
            continue
        delta, order = (x[:n, row].numpy() for x in (runs.shown, runs.orders))
        lead = order_lead(delta, order, interval, ship.rudder_rate)
        states = first.states
        track = runs.states[:n, row, : states.count].numpy()
        inputs = {"delta": delta, "delta_order": order, "order_lead": lead, "shaft": np.full(n, share)}
        noise = first.run.meta["rudder_noise"] * (step / interval) ** 0.5
        blank = with_measured(
            Recording(words, times[:n], inputs, meta={"rudder_noise": noise}), shown(track), states.channels
        )
        yield Plan(words, _sailed(manoeuvre), _seen(data_set, blank, track, step / interval), heading, share)


def _seen(data_set: WhitenedDataSet, run: Recording, track: Float[np.ndarray, "n k"], thinned: float) -> PreparedRun:
    """A simulated run with the channels and the noise of the recorded ones, thinned out to some share of samples."""
    kept = data_set.runs[0].linearised.states.channels
    present = np.isin(kept, [*seen_channels([p.linearised.run for p in data_set.runs], kept)])
    noise = np.sqrt(thinned * np.mean([p.noise**2 for p in data_set.runs], axis=0))
    run = with_measured(run, np.where(present, measured(run, kept), np.nan), kept)
    some = data_set.runs[0]
    equations, process = replace(some.linearised, run=run), np.zeros((len(run), len(some.linearised.states.driven)))
    bare = replace(some, linearised=equations, noise=noise, process=process)
    return about_states(data_set.dynamics, bare, track)


def _acting(dynamics: Model, hypothesis: Hypothesis, shares: Sequence[float]) -> Vessel:
    """The ship with a hypothesis acting, gusts left out, its shaft at shares of its nominal speed."""
    effects = [_Telegraph(dynamics.hull).at(torch.tensor(shares, dtype=torch.float64)[:, None])]
    for effect, values in zip(hypothesis.effects, hypothesis.values, strict=True):
        effects.append(effect.at(torch.tensor(effect.steady(values[0]))))
    return Vessel(dynamics, effects)


class _Telegraph(Effect):
    """A shaft at a share of its nominal speed."""

    site = "actuator"
    declared = (Parameter("share", "-", 0.1, 1.0, 1.0, 0.1, (1.0,)),)

    def shaft(self, s: Situation, memory: Float[Tensor, "*batch m"]) -> Float[Tensor, "*batch"]:
        """Its share at any time [-]."""
        return self.value("share").expand(s.delta.shape)
