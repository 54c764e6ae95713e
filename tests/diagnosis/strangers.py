"""Runs of eight minutes of a Mariner with scattered coefficients and a small coloured force, and a stranger or none."""

from collections.abc import Callable, Sequence

import numpy as np
import torch
from fleet import unchecked
from trials import CALM, NOISE, SHIP, run_of

from manoeuvre_nn.core.effect import Effect, Parameter, Situation
from manoeuvre_nn.core.manoeuvre import Manoeuvre, Stage
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.diagnosis.case import Case, Question
from manoeuvre_nn.diagnosis.search import SearchResult
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.effect.common import in_tight_turns, typical
from manoeuvre_nn.estimation.corrections import Calibrated, Corrections
from manoeuvre_nn.estimation.data_set import whitened_data_set
from manoeuvre_nn.estimation.hypothesis import Hypothesis
from manoeuvre_nn.estimation.marginal_likelihood import MarginalLikelihood

SCATTER, LACKS, MODEL_ERROR_TIME = 0.04, 0.01, 30.0
"""Relative error of the coefficients; coloured force over the typical ones; its correlation time [s]."""
DURATION = 480.0
STEP = 4.0
"""Between samples [s]; their noise is such that they tell as much in all as at one every second."""
Shape = Callable[[Situation], torch.Tensor]


def _of_runs(values: torch.Tensor, s: Situation) -> torch.Tensor:
    """One value a run: a run is a row, samples follow each other along it."""
    return values[:, None] if s.u.ndim > 1 else values


class Stranger(Effect):
    """A force that no shelf has, in one equation, over the resistance or that of 20 deg of rudder, in some runs."""

    name = site = "force"
    family = label = fingerprint = source = "stranger"
    equations = ("N",)
    declared = (Parameter("size", "-", -9.0, 9.0, 0.0, 1.0, (1.0,)),)

    def __init__(self, size: float, equation: str, shape: Shape, lag: float = 0.0, runs=(1.0, 1.0, 1.0)) -> None:
        super().__init__(SHIP, size=size)
        self.shape, self.lag, self.memory = shape, lag, int(lag > 0)  # type: ignore[misc]
        self.register_buffer("unit", typical(SHIP) * torch.tensor([e == equation for e in "XYN"]))
        self.register_buffer("runs", torch.tensor(runs).double())

    def memory_rate(self, s, memory):
        return (self.shape(s)[..., None] - memory) / self.lag if self.lag else super().memory_rate(s, memory)

    def acceleration(self, s, memory):
        if not s.u.ndim:  # tried once before the runs begin
            return 0 * s.nu
        value = memory[..., 0] if self.lag else self.shape(s)
        return (self.value("size") * _of_runs(self.get_buffer("runs"), s) * value)[..., None] * self.get_buffer("unit")


def coloured(rng: np.random.Generator, time: float) -> Shape:
    """Courses of a first-order Markov process of size one, one a run."""
    x = rng.standard_normal((int(DURATION) + 3, len(TRIALS)))
    for k in range(1, len(x)):
        x[k] = np.exp(-1 / time) * x[k - 1] + np.sqrt(1 - np.exp(-2 / time)) * x[k]
    course = torch.tensor(x)

    def shape(s: Situation) -> torch.Tensor:
        k, run = s.time.clamp(0, len(x) - 2).long(), _of_runs(torch.arange(len(TRIALS)), s)
        return course[k, run] + (s.time - k) * (course[k + 1, run] - course[k, run])

    return shape


def periodic(period: float, *phases: float) -> Shape:
    """A sine whose phase [rad] is 0 in all runs, or one of these in each."""
    phase = torch.tensor(phases or [0.0] * len(TRIALS)).double()
    return lambda s: torch.sin(2 * torch.pi * s.time / period + _of_runs(phase, s)) + 0 * s.u


def ramp(s: Situation) -> torch.Tensor:
    """One after ten minutes."""
    return s.time / 600.0 + 0 * s.u


def of(letter: str) -> Shape:
    """The motion in units of a tight turn."""
    return lambda s: in_tight_turns(SHIP, s)[letter]


def _trial(name: str, *orders: tuple[float, float | None]) -> Manoeuvre:
    stages = tuple(Stage(angle * DEGREE, hold=hold) for angle, hold in ((0.0, 60.0), *orders))
    return Manoeuvre(name, "random_rudder", stages, duration=DURATION)


WEAVE = [((-1) ** k * -20.0, 55.0) for k in range(7)]
TRIALS = (
    _trial("turn", (25.0, None)),
    _trial("weave", *WEAVE, (0.0, None)),
    _trial("held out", (-20.0, 100.0), (20.0, 100.0), (-10.0, None)),
)


def strange_runs(
    seed: int,
    *acting: Effect,
    random: Sequence[tuple[float, str, float]] = (),
    scatter: float = SCATTER,
    step: float = STEP,
) -> list[Recording]:
    """Three runs in which something acts, or a random force (size, equation, correlation time) beside usual errors."""
    rng, names = np.random.default_rng(seed), Corrections(CALM).names
    printed = [k for k, name in enumerate(names) if "+" not in name and name not in ("Mu", "Mv", "Mr")]
    shares = torch.zeros(len(names), dtype=torch.float64)
    shares[printed] = scatter * torch.tensor(rng.standard_normal(len(printed)))
    usual = [(LACKS, e, MODEL_ERROR_TIME) for e in "XYN"]
    added = [Stranger(size, e, coloured(rng, time)) for size, e, time in (*usual, *random)]
    with unchecked():
        ship = Vessel(Calibrated(CALM, shares), [*added, *acting])
        records = roll_out(ship, TRIALS, step=min(step, 2.0), interval=step)
    return [run_of(record, NOISE / step**0.5, 10 * seed + number) for number, record in enumerate(records)]


def asked(runs: Sequence[Recording], effects: Sequence[Effect] = ()) -> Question:
    """A question whose last run is held out."""
    case = Case("strange", "mariner", tuple(runs), SHIP, 40.0, frozenset({runs[-1].name}))
    return Question(case, CALM, list(effects))


def calm_only(question: Question) -> SearchResult:
    """A search that has tried nothing but calm water."""
    likelihood = MarginalLikelihood(whitened_data_set(CALM, question.case.fitted))
    return SearchResult(likelihood.evaluate(Hypothesis((), ())), [], likelihood)
