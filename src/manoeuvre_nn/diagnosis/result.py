"""What a diagnosis says: plain values, nothing computed here."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import pandas as pd
from jaxtyping import Float

Interval = tuple[float, float]
GAIN = "held-out gain"
"""Name of the test of one claim after another; those that fail it are refused."""
RIGHT_SHIP = "the coefficients are this ship's"
"""Name of the test that calls the ship in question, or her model."""
PHASE = "phase at the start"
"""Name of a periodic force's phase, where it is alike in all runs."""


@dataclass(frozen=True)
class Value:
    """A parameter as it was found.

    Attributes:
        name: Its name.
        value: Its value.
        error: Standard error.
        unit: Unit of both.
        campaign: Where every campaign has its own value, which one; else empty.
        sides: What a positive value means, and a negative one; empty where the sign needs no words.
        low: Least value that is possible.
        high: Largest one.
        period: After which values are the same again, of a direction; 0 without one.
        by_run: Whether every run has its own; this is that of the first.
    """

    name: str
    value: float
    error: float
    unit: str
    campaign: str = ""
    sides: tuple[str, str] | tuple[()] = ()
    low: float = float("-inf")
    high: float = float("inf")
    period: float = 0.0
    by_run: bool = False

    @property
    def interval(self) -> Interval | None:
        """Ends of the 95 % interval within what is possible; those of a direction go round, 0 and the period are any.

        Returns:
            The ends in the value's unit; None where the standard error is not known.
        """
        if not (np.isfinite(self.error) and self.error > 0):
            return None
        low, high = (float(min(max(self.value + sign * 1.96 * self.error, self.low), self.high)) for sign in (-1, 1))
        if not self.period:
            return low, high
        return (0.0, self.period) if high - low >= self.period else (low % self.period, high % self.period)


@dataclass(frozen=True)
class Nature:
    """What something unknown is like.

    Attributes:
        kind: ``random``, ``periodic``, ``lagging``, ``growing``, ``tied to the place``, ``tied to the heading``,
            ``tied to the motion``, ``constant``, or ``in an instrument``.
        equations: Where it acts: X, Y, N, actuator:rudder, sensor:<channel>.
        size: Standard deviation of a random force, amplitude of a periodic one, root mean square of others.
        scales: Correlation time, period, phase at time 0, memory, growth a minute, spacing of stripes: what there is.
        against: Log evidence for this kind against the likeliest other: of a periodic force against a random one.
        predictable: Whether it can be foreseen in other runs; of a random force only its size is known.
        frame: ``body``, ``earth``, or empty where the recordings do not tell.
        parity: Of the missing force in port and starboard turns: ``even``, ``odd``, ``mixed``; empty without both.
        regime: Share of the missing force's square that falls into hard helm; NaN where the helm was always alike.
        refuted: Whether it is told by a formula that does not predict runs that were not used.
        clearest: Equations in which a force without a rule is clearest; empty where none was asked for.
    """

    kind: str
    equations: tuple[str, ...]
    size: Value
    scales: tuple[Value, ...] = ()
    against: float = 0.0
    predictable: bool = True
    frame: str = ""
    parity: str = ""
    regime: float = float("nan")
    refuted: bool = False
    clearest: tuple[str, ...] = ()

    @property
    def places(self) -> tuple[str, ...]:
        """Where it acts; of a force whose rule failed in other runs, where it is clearest if it follows no rule."""
        in_instruments = any(e.startswith("sensor:") for e in self.equations)
        return self.clearest if self.refuted and not in_instruments else self.equations


@dataclass(frozen=True)
class Cause:
    """A candidate for what was left out.

    Attributes:
        name: Name of the effect, ``unknown`` included.
        label: The same in words.
        probability: Of being present, between 0 and 1.
        evidence: Log Bayes factor of the best hypothesis that contains it over calm water.
        equations: Where it acts: X, Y, N, kinematics, actuator:rudder, sensor:psi, ...
        parameters: Its values with standard errors.
        intervals: Run -> times in which it acts [s], none where it does not act; None: throughout.
        fingerprint: How it is recognised.
        source: Where its formula is from.
        terms: Terms of the formula of something unknown, one a parameter; what these share stands behind.
        weights: The formula's own parameters, those of conf/effect/formula.yaml.
        nature: What something unknown is like; None for effects, and where nothing unknown was found.
        interval_errors: Standard errors of ``intervals`` [s]; NaN where a run begins or ends within.
    """

    name: str
    label: str
    probability: float
    evidence: float
    equations: tuple[str, ...]
    parameters: tuple[Value, ...]
    intervals: Mapping[str, list[Interval]] | None
    fingerprint: str
    source: str
    terms: tuple[str, ...] = ()
    weights: Mapping[str, float] = field(default_factory=dict)
    nature: Nature | None = None
    interval_errors: Mapping[str, list[Interval]] = field(default_factory=dict)


@dataclass(frozen=True)
class Residual:
    """Force that the calm-water model lacks, over one run.

    Attributes:
        run: The run.
        time: Sample times [s].
        force: X, Y and N that must be added to calm water, in ``units``.
        error: Their standard deviations.
        left: The same after the model was repaired.
        windows: Times in which something is missing that was not there before [s].
        units: Of X, Y and N.
    """

    run: str
    time: Float[np.ndarray, " n"]
    force: Float[np.ndarray, "n 3"]
    error: Float[np.ndarray, "n 3"]
    left: Float[np.ndarray, "n 3"]
    windows: list[Interval]
    units: tuple[str, str, str] = ("kN", "kN", "MN m")


USABLE_MODEL = "the model predicts its own held-out runs"
"""Name of the check of a model that was trained before."""


@dataclass(frozen=True)
class Check:
    """A test that a claim must pass.

    Attributes:
        name: What is tested.
        passed: Whether it holds.
        text: What was measured, in a sentence.
    """

    name: str
    passed: bool
    text: str


@dataclass(frozen=True)
class Proof:
    """A held-out run predicted before and after, beside the recording; or a planned one, of which nothing was recorded.

    Attributes:
        run: The run.
        kind: What was sailed.
        recorded: t, x, y [m], psi [deg], u, v [m/s] over ground, r [deg/s], u_log [m/s], delta [deg]; NaN in
            gaps and at outliers.
        before: The calm-water model's prediction, same times and columns but the last.
        after: The repaired model's; of a planned run with x_low, x_high and so on: what 95 % of recordings lie between.
        rmse_before: Channel (pos, psi, u, v, r, u_log) -> RMS error.
        rmse_after: The same after.
        rmse_alone: The same of the effects alone, with the published coefficients: what of the gain is theirs, and not
            that of corrected coefficients; empty where the two are the same.
    """

    run: str
    kind: str
    recorded: pd.DataFrame
    before: pd.DataFrame
    after: pd.DataFrame
    rmse_before: Mapping[str, float]
    rmse_after: Mapping[str, float]
    rmse_alone: Mapping[str, float] = field(default_factory=dict)


def rmse(proofs: Sequence[Proof], when: str) -> dict[str, float]:
    """Errors of several held-out runs together.

    Args:
        proofs: The runs.
        when: ``before``, ``after``, or ``alone``, of the effects alone.

    Returns:
        Channel -> root mean square over the runs' RMS errors; runs that did not record it are left out, NaN where none
        did.
    """
    tables = [getattr(p, f"rmse_{when}") for p in proofs]
    found = {}
    for channel in dict.fromkeys(c for table in tables for c in table):
        errors = np.array([table.get(channel, np.nan) for table in tables])
        good = errors[np.isfinite(errors)]
        found[channel] = float(np.sqrt(np.mean(good**2))) if len(good) else float("nan")
    return found


@dataclass(frozen=True)
class Diagnosis:
    """The whole answer.

    Attributes:
        case: Name of the case or folder.
        ship: Name of the ship.
        verdict: ``none``, ``mismatch``; :attr:`unknown` says whether what was missed has no name.
        sentence: The answer in one sentence.
        causes: Candidates, most probable first.
        model: Names of the effects switched on in the repaired model.
        alias: Effect of the repaired model -> names that these recordings cannot tell from it.
        sites: Site (surge, sway and yaw, inflow, hull, ...) -> log Bayes factor over calm water of allowing anything
            there.
        statements: What the missing force looks like, a sentence each: equation, frame, parity, region, windows.
        residuals: Missing force over each fitted run.
        checks: Tests that the claim passed or not.
        runner_up: What speaks for and against the runner-up, a sentence each.
        proofs: Held-out runs before and after.
        noise: Channel -> RMS of its measurement noise as estimated.
        next_steps: What to record next, most useful first.
        next_run: The run that is advised first, see :attr:`~manoeuvre_nn.diagnosis.next_runs.Plan.as_dict`; None
            without one.
        undecided: What cannot be decided with these recordings and why.
        tracks: Fitted run -> recorded x and y [m], NaN in gaps.
        forecasts: Planned runs: rudder and warm-up are known, and nothing that could prove anything.
        network: Weights of the network that learned what physics leaves; empty without one.
        dimensions: Length and beam of the ship [m], None where they are not known.
        settings: Versions, seed, options, for the record.
        seconds: Time that it took.
    """

    case: str
    ship: str
    verdict: str
    sentence: str
    causes: list[Cause]
    model: list[str]
    alias: Mapping[str, list[str]]
    sites: Mapping[str, float]
    statements: list[str]
    residuals: list[Residual]
    checks: list[Check]
    runner_up: list[str]
    proofs: list[Proof]
    noise: Mapping[str, float]
    next_steps: list[str]
    undecided: list[str]
    tracks: Mapping[str, Float[np.ndarray, "n 2"]] = field(default_factory=dict, repr=False)
    forecasts: list[Proof] = field(default_factory=list)
    network: Mapping[str, float] = field(default_factory=dict, repr=False)
    next_run: Mapping[str, str | float] | None = None
    dimensions: tuple[float, float] | None = None
    settings: Mapping[str, str] = field(default_factory=dict)
    seconds: float = 0.0

    @property
    def doubtful(self) -> bool:
        """Whether the recordings may not be of this ship, or her model does not hold: asked before any cause."""
        return any(check.name == RIGHT_SHIP and not check.passed for check in self.checks)

    @property
    def unproved(self) -> bool:
        """Whether something explains the fitted runs better than calm water, but not runs that were not used."""
        return self.verdict == "none" and any(check.name == GAIN and not check.passed for check in self.checks)

    @property
    def unknown(self) -> bool:
        """Whether the recordings differ from calm water and no effect that is known explains it."""
        return self.verdict == "mismatch" and self.model in ([], ["unknown"])

    @property
    def repaired(self) -> bool:
        """Whether the model predicts otherwise than the published one: effects were added or coefficients corrected."""
        return bool(self.model) or any(p.rmse_after != p.rmse_before for p in self.proofs)

    def rmse(self, when: str) -> dict[str, float]:
        """Errors of all held-out runs together, ``before``, ``after``, or of the effects ``alone``: see :func:`rmse`.

        Returns:
            Channel -> RMS error.
        """
        return rmse(self.proofs, when)
