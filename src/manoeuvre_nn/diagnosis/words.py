"""Sentences for people."""

import re
from collections.abc import Mapping, Sequence
from math import log
from types import MappingProxyType

import numpy as np

from manoeuvre_nn.core.units import three_digits
from manoeuvre_nn.diagnosis.advise import Ranked, advise
from manoeuvre_nn.diagnosis.decision import Decision, base_rate, effects_tried, plausible
from manoeuvre_nn.diagnosis.locate import PUSHES
from manoeuvre_nn.diagnosis.next_runs import Plan
from manoeuvre_nn.diagnosis.result import PHASE, RIGHT_SHIP, USABLE_MODEL, Cause, Check, Nature, Proof, Value
from manoeuvre_nn.diagnosis.search import SearchResult
from manoeuvre_nn.dynamics.base import is_fitted
from manoeuvre_nn.effect.formula import BY_RUN, PERIODIC, mark_of
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis

POSSIBLE = 0.05
"""Probability of a rival from which a run is sought that tells it from what was found."""
AT_NOISE = 1.5
"""RMS error over the measurement noise up to which runs are predicted to the noise."""
MIN_EXPECTED_EVIDENCE = 3.0
"""Log Bayes factor, odds of 1 to 20, that a run must be expected to add."""
WAVE = re.compile(rf"(cos|sin) ({PERIODIC}|{BY_RUN})$")
"""Shape of a term that comes again in time."""
EQUATIONS = {"X": "surge", "Y": "sway", "N": "yaw", "kinematics": "kinematics or sensors"}


def summary_sentence(
    causes: Sequence[Cause],
    model: Sequence[str],
    proofs: Sequence[Proof],
    mismatch: bool,
    lacking: str = "",
    left: str = "",
    noise: Mapping[str, float] = MappingProxyType({}),
) -> str:
    """One sentence that a captain understands.

    Args:
        causes: Candidates, best first.
        model: What was switched on.
        proofs: Held-out runs.
        mismatch: Whether recordings and model differ.
        lacking: What is open where nothing is proved, see :func:`left_open`; empty if nothing is.
        left: How far free runs of the repaired model miss those that were not used; empty where they do as they should.
        noise: Channel -> RMS of its measurement noise.

    Returns:
        The sentence.
    """
    if not mismatch and lacking:
        return f"Nothing is proved: {lacking}."
    if not mismatch:
        corrected = any(p.rmse_after != p.rmse_before for p in proofs)
        gain = _gain(proofs, "coefficients corrected within their scatter", seen=True) if corrected else ""
        agree = f"The recordings agree with the calm-water model {_agreement(proofs, noise)}"
        return f"{agree}: nothing needs to be added{gain}."
    more = f"; something is still missing: {left}" if left else ""
    if set(model) <= {"unknown"}:
        where = next((c.equations for c in causes if c.name == "unknown"), ())
        shown = f" in {_and([EQUATIONS.get(e, e) for e in where])}" if where else ""
        told = "".join(f"; it is {nature_words(c.nature)}" for c in causes if c.nature and not c.nature.refuted)
        told += next((_formula(c) for c in causes if c.terms), "")
        own = any(mark_of(term) == BY_RUN for c in causes for term in c.terms)
        gain = _gain(proofs, "that, its size and phase taken from each run," if own else "that") if model else ""
        known = "no effect that is known explains it"
        return f"Unknown: the recordings differ from calm water{shown}, and {known}{told}{gain}{more}."
    named = [c for c in causes if c.name in model]
    said = _and([f"{c.label} ({'; '.join(part for part in (_values(c), _times(c)) if part)})" for c in named])
    them = "it" if len(named) == 1 else "them"
    if proofs and not any(c.intervals is None or c.intervals.get(p.run) for c in named for p in proofs):
        return f"The recordings show {said}; no run that was not used had {them}, so that none can prove {them}{more}."
    by_run = sorted({v.name for c in named for v in c.parameters if v.by_run})
    taken = f"{them}, {_and(by_run)} taken from each run," if by_run else them
    return f"The recordings show {said}{_gain(proofs, taken)}{more}."


def with_caveats(sentence: str, ship: str, checks: Sequence[Check]) -> str:
    """The sentence; if need be that it may not be this ship before it, that the model may err by itself after it."""
    caveat = next((c.text for c in checks if c.name == USABLE_MODEL and not c.passed), "")
    sentence = f"{sentence} But {caveat}." if caveat else sentence
    why = next((c.text for c in checks if c.name == RIGHT_SHIP and not c.passed), "")
    return f"This may not be the {ship}, or her model is wrong: {why}. If she is: {sentence}" if why else sentence


def left_open(tried: SearchResult, verdict: Decision) -> str:
    """A clause on what is open where nothing is proved: an effect that was not, or what a fitted model lacks."""
    data_set = tried.likelihood.data_set
    if not is_fitted(data_set.dynamics):
        if not verdict.named or verdict.best is None:
            return ""
        better = f"with {labels(verdict.best)} the fitted runs are explained better than by calm water alone"
        return f"{better}, but with the runs that were not used there is too little evidence to name it"
    surge, lateral = (100 * level for level in data_set.levels[tried.none.best[0]])
    said = (
        f"the fitted model lacks forces of about {surge:.2g} % of the resistance and {lateral:.2g} % of 20 deg of "
        "rudder here, which it may do by itself"
    )
    if not verdict.named or verdict.best is None:
        return f"{said}, and no effect explains them"
    return f"{said}, and no effect predicts runs that were not used better"


def _scored(proofs: Sequence[Proof]) -> tuple[str, str, str, list[Proof]]:
    """Channel that runs are told by, its curve and unit, and the runs that recorded it: the track, else the heading."""
    located = [p for p in proofs if np.isfinite(p.rmse_before.get("pos", np.nan))]
    return ("pos", "track", "m", located) if located else ("psi", "heading", "deg", list(proofs))


def _agreement(proofs: Sequence[Proof], noise: Mapping[str, float]) -> str:
    """How far recordings agree with calm water: to the noise of the instruments only if they are predicted to it."""
    channel, curve, unit, scored = _scored(proofs)
    off = float(np.sqrt(np.mean([p.rmse_after.get(channel, np.nan) ** 2 for p in scored]))) if scored else np.nan
    ratio = off / noise[channel] if noise.get(channel, 0.0) > 0 else np.nan
    if ratio < AT_NOISE:
        return "within the measurement noise"
    known = "as far as its coefficients are known"
    if not np.isfinite(ratio):
        return known
    return f"{known} (the predicted {curve} is {three_digits(off)} {unit} off, {ratio:.1f} times the measurement noise)"


def _gain(proofs: Sequence[Proof], what: str, seen: bool = False) -> str:
    """How much better runs that were not used are predicted; if wanted, only where two digits show it."""
    if not proofs:
        return ""
    channel, curve, unit, scored = _scored(proofs)
    parted = all(p.rmse_alone for p in scored)
    before, after, *alone = (
        np.sqrt(np.mean([getattr(p, w)[channel] ** 2 for p in scored]))
        for w in ("rmse_before", "rmse_after", *(["rmse_alone"] if parted else []))
    )
    if seen and f"{before:.2g}" == f"{after:.2g}":
        return ""
    closer = after <= before
    before, after, *alone = (three_digits(value) for value in (before, after, *alone))
    told = f" ({alone[0]} {unit} with published coefficients)" if alone and alone[0] != after else ""
    unused = f"the predicted {curve} of runs that were not used is"
    if not closer and after != before:
        return f"; {unused} no closer with {what}: {after} {unit} off{told} instead of {before} {unit}; see the checks"
    return f"; with {what} {unused} {after} {unit} off{told} instead of {before} {unit}"


def _values(cause: Cause) -> str:
    """What was found, campaign by campaign where each has its own; to a side only what is larger than its error."""
    sided = [v for v in cause.parameters if not (v.sides and abs(v.value) < v.error)] or cause.parameters
    told = {v.campaign: [w for w in sided if w.campaign == v.campaign] for v in sided}
    said = {
        campaign: ", ".join(f"{v.name.removesuffix(f'_{v.unit}').replace('_', ' ')} {_sized(v)}" for v in values)
        for campaign, values in told.items()
    }
    return "; ".join(f"{campaign}: {values}" if campaign else values for campaign, values in said.items())


def _sized(v: Value) -> str:
    """A value with its unit, and where its sign has words with these in its place: ``222 kN to port``."""
    value, side = (abs(v.value), v.sides[v.value < 0]) if v.sides else (v.value, "")
    run = "in the first run" if v.by_run else ""
    return " ".join(part for part in (three_digits(value), v.unit.strip("-"), side, run) if part)


def _times(cause: Cause) -> str:
    """When an event happens, two times and how many more: ``r01 191 to 383 s, r03 266 to 402 s and 4 more``."""
    spans = [f"{run} {a:.0f} to {b:.0f} s" for run, times in (cause.intervals or {}).items() for a, b in times]
    return ", ".join(spans) if len(spans) <= 2 else f"{', '.join(spans[:2])} and {len(spans) - 2} more"


def _formula(cause: Cause) -> str:
    """The formula of something unknown, equation by equation, every coefficient with its unit."""
    sums: dict[str, str] = {}
    # Of what is periodic with its own size and phase in each run the nature tells all that holds for every run.
    told = cause.nature is not None and not cause.nature.refuted
    own = {term for term in cause.terms if told and mark_of(term) == BY_RUN}
    for v in (v for v in cause.parameters[: len(cause.terms)] if v.name not in own):
        kind, _, shape = v.name.partition(" ")
        channel, _, of_channel = shape.partition(" ")
        place, shape = {
            "rudder": ("more rudder", f"of the angle {shape}"),
            "sensor": (f"error of {channel}", of_channel),
        }.get(kind, (kind, shape))
        shape = WAVE.sub(r"\1(2 pi t/period)", shape.removeprefix("1").lstrip())
        term = f"{abs(v.value):.3g} {v.unit} {shape}".rstrip()
        sign = "-" if v.value < 0 else "+"
        sums[place] = f"{sums[place]} {sign} {term}" if place in sums else f"{place} = {sign.strip('+')}{term}"
    if not sums:
        return ""
    scales = [
        f"{v.name.removesuffix('_s').replace('_', ' ')} {v.value:.3g} {v.unit}"
        for v in cause.parameters[len(cause.terms) :]
    ]
    positive = [f"{e} {PUSHES[e][0]}" for e in sums if e in PUSHES]
    read = [f"positive: {', '.join(positive)}"] if positive else []
    read.append("motion in units of a tight turn")
    if any(mark_of(term) == BY_RUN for term in cause.terms) and not own:
        read.append("what is periodic as in the first run: every other has its own size and phase")
    return f"; a short formula for it is {', '.join([*sums.values(), *scales])} ({'; '.join(read)})"


def nature_words(nature: Nature) -> str:
    """What something unknown is like, such as ``a periodic force in yaw, amplitude 5.1 ± 0.2 MN m, period 50 ± 1 s``.

    Args:
        nature: It.

    Returns:
        A clause.
    """
    where = _and([EQUATIONS.get(e, e) for e in nature.equations])
    kind = {
        "lagging": "a force{} that follows the motion late",
        "growing": "a force{} that grows with time",
        "in an instrument": "an error{}",
        "periodic": "a periodic force{}",
        "random": "a random force{}",
        "constant": "a constant force{}",
    }.get(nature.kind, f"a force{{}} {nature.kind}")
    told = [f"{v.name} {_measured(v)}" for v in (nature.size, *nature.scales) if np.isfinite(v.value)]
    if nature.kind == "periodic" and not any(v.name == PHASE for v in nature.scales):
        told.append("with its own size and phase in each run")
    if nature.kind == "in an instrument":
        told = []
    clause = ", ".join([kind.format(f" in {where}"), *told])
    if nature.predictable:
        return clause
    return f"{clause}; its course cannot be predicted, only how far it throws a run off"


def nature_sentence(nature: Nature) -> str:
    """The same as a sentence, with frame, parity, regime, and the odds against the likeliest other kind."""
    frame = {"body": "fixed to the ship", "earth": "fixed to the earth"}.get(nature.frame, "")
    parity = {
        "even": "of the same sign in port and starboard turns",
        "odd": "of opposite sign in port and starboard turns",
    }
    said = [frame, parity.get(nature.parity, "")]
    if np.isfinite(nature.regime):
        said.append(f"{nature.regime:.0%} of its square with more than half the helm")
    more = ", ".join(part for part in said if part)
    other = "any formula" if nature.kind == "random" else "a random force"
    against = f"log evidence against {other} {nature.against:+.0f}"
    failed = ["it does not predict runs that were not used better"] if nature.refuted else []
    clause = nature_words(nature)
    return f"What is unknown is {clause} ({'; '.join([*([more] if more else []), against, *failed])})."


def _measured(v: Value) -> str:
    """A value with its standard error, to two digits of it."""
    if not (np.isfinite(v.error) and v.error > 0):
        return f"{v.value:.3g} {v.unit}"
    digits = max(0, 1 - int(np.floor(np.log10(v.error))))
    return f"{v.value:.{digits}f} ± {v.error:.{digits}f} {v.unit}"


def _and(parts: Sequence[str]) -> str:
    """Parts as they stand in a sentence."""
    return " and ".join([", ".join(parts[:-1]), parts[-1]] if len(parts) > 1 else parts)


def labels(fitted: FittedHypothesis) -> str:
    """What a hypothesis says, in words, such as ``a steady wind and a rudder offset``."""
    return _and([e.label for e in fitted.hypothesis.effects]) or "calm water"


def runner_up(tried: SearchResult, verdict: Decision) -> list[str]:
    """What speaks for and against the second best, or against the best if it is not named: at most two sentences."""
    best = verdict.best
    if best is None:
        return []
    if not (verdict.named or verdict.strange):
        gain = best.evidence - tried.none.evidence
        said = f"log evidence {gain:+.1f} in the fitted runs"
        return [f"The best candidate is {labels(best)}, but calm water is likelier; {said}."]
    if verdict.unknown >= 0.5:
        against = f"something without a name is likelier ({_percent(verdict.unknown)})"
        return [_for(best, tried), f"Against it: {against}."]
    other = next((j for j in plausible(tried) if not set(best.names) <= set(j.names)), None)
    if other is None:
        return []
    gap, effects = best.evidence - other.evidence, len(effects_tried(tried))
    against = f"with {labels(best)} they are explained better still, by {_ln(gap)} ({_odds(gap)})"
    if gap < 0:  # the best one has fewer effects
        gap += log(base_rate(len(best.names), effects) / base_rate(len(other.names), effects))
        against = f"with {labels(best)} they are explained nearly as well, by fewer effects ({_odds(gap)})"
    levels = tried.likelihood.data_set.levels
    left, least = levels[other.best[0]].max(), levels[best.best[0]].max()
    if left > 1.5 * least:
        against += f", and {100 * least:.2g} % of the rudder's force at 20 deg is left, not {100 * left:.2g} %"
    return [_for(other, tried), f"Against it: {against}."]


def _for(fitted: FittedHypothesis, tried: SearchResult) -> str:
    gain = fitted.evidence - tried.none.evidence
    name = labels(fitted)
    if gain <= 0:
        return f"For {name} nothing speaks: the recordings are no likelier than in calm water."
    return f"For {name}: it explains the recordings better than calm water by {_ln(gain)} in log evidence."


def _percent(probability: float) -> str:
    return f"{100 * min(probability, 0.99):.0f} %"


def _odds(gap: float) -> str:
    """Odds of a gap in log evidence, to two digits."""
    if gap >= 13.8:
        return "odds less than one in a million"
    times = float(f"{np.exp(max(gap, 0.0)):.2g}")
    return f"odds 1 to {times:,.0f}" if times >= 10 else f"odds 1 to {times:g}"


def next_steps(
    tried: SearchResult, verdict: Decision, chosen: FittedHypothesis, mismatch: bool
) -> tuple[list[str], Plan | None]:
    """What to record next, by simulation: see :mod:`~manoeuvre_nn.diagnosis.advise`.

    Args:
        tried: The search.
        verdict: What may be claimed.
        chosen: What was proved.
        mismatch: Whether anything is missing.

    Returns:
        Sentences, most useful first; the run that is advised first, if any is.
    """
    duels = _duels(tried, verdict, chosen, mismatch)
    made = advise(tried.likelihood.data_set, duels[0][0], [rival for _, rival, _ in duels]) if duels else []
    told = [
        _told(*duel, runs)
        for duel, runs in zip(duels, made, strict=True)
        if mismatch or runs[0][0] > MIN_EXPECTED_EVIDENCE
    ]
    said, advised = [text for text, _ in told], next((plan for _, plan in told if plan is not None), None)
    if not mismatch:
        more = "another speed or a harder turn would test the model further"
        return [*said, f"Nothing more is needed for these manoeuvres; {more}."], advised
    known = {n for j in tried.fitted for n in j.names}
    named = [e.label for e in chosen.hypothesis.effects if e.name in known]
    if not named:
        more = "Repeat one run on a heading 90 deg away and one at half speed: they show what the misfit depends on."
        return [more], None
    clear = f"Nothing else comes close to {_and(named)}; a repeat at another speed would confirm the values."
    return said or [clear], advised


Duel = tuple[FittedHypothesis, FittedHypothesis, float]
"""Who leads, the rival, and the probability of what is to be ruled out or found."""


def _duels(tried: SearchResult, verdict: Decision, chosen: FittedHypothesis, mismatch: bool) -> list[Duel]:
    """What is worth telling apart: at most two rivals of the same leader; none where the verdict is certain."""
    if not mismatch:
        first = verdict.best
        probability = 0.0 if first is None else min(verdict.effects[n] for n in first.names)
        return [(first, tried.none, probability)] if first is not None and probability > POSSIBLE else []
    known = {frozenset(j.names): j for j in reversed(tried.fitted)}
    singles = {n for j in tried.fitted if len(j.names) == 1 for n in j.names}
    mine = frozenset(chosen.names) & singles
    if mine not in known:
        return []
    found: list[Duel] = []
    rivals = sorted(((p, n) for n, p in verdict.effects.items() if n not in mine and p > POSSIBLE), reverse=True)
    for probability, name in rivals:
        rival = next(j for j in tried.fitted if name in j.names)
        # What acts beside the leader is found by a run in which the leader alone could not do it.
        duel = (rival, known[mine]) if mine < set(rival.names) else (known[mine], rival)
        if not found or duel[0] is found[0][0] and duel[1] is not found[0][1]:
            found.append((*duel, probability))
    return found[:2]


def _told(
    leading: FittedHypothesis, rival: FittedHypothesis, probability: float, runs: Ranked
) -> tuple[str, Plan | None]:
    """The best run, and the best channel, that tells two hypotheses apart; and that run, if one does."""
    question = f"To tell {labels(leading)} from {labels(rival)} ({_percent(probability)})"
    expected, best = runs[0]
    factor = f"expected log Bayes factor {_ln(expected)}"
    if expected < MIN_EXPECTED_EVIDENCE:
        shared = set(leading.names) & set(rival.names)
        apart = [e for j in (leading, rival) for e in j.hypothesis.effects if e.name not in shared]
        wanted = sorted({e.measured_by or e.family for e in apart})
        return f"{question}: measure {_and(wanted)}; none of {len(runs)} simulated runs would do ({factor}).", None
    more = next((a for a in runs[1:] if a[1].heading is None and a[0] > MIN_EXPECTED_EVIDENCE), None)
    also = "" if more is None or best.heading is None else f"; or {more[1].text} ({_ln(more[0])})"
    told = f"{factor}; these recordings: {_ln(leading.evidence - rival.evidence)}"
    return f"{question}: {best.text} ({told}){also}.", best


def _ln(factor: float) -> str:
    """A log Bayes factor with the digits that matter."""
    return f"{factor:.{1 if abs(factor) < 9.95 else 0}f}"
