"""Ideal observer: names what the recordings can tell at all, with the referee's own formulas, error model and priors.

    python -m studies.concealed_trial.ideal cases=DIR out=DIR [nuisance=1]

It knows the catalogue that the cases are drawn from, effects that no list has among it, and looks at the runs to fit
only. The evidence of each hypothesis is that of the linear model along the recorded track, with coefficients, missing
terms, coloured force, latency and initial states integrated out, and the parameters by Laplace's approximation. Pairs
and triples are found by what is added to the best so far. What it gets wrong is taken for a limit: nobody with less
knowledge does better on average.
"""

import json
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from math import log
from pathlib import Path
from typing import Any

import numpy as np

from manoeuvre_nn.core.ending import one_line
from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.writing import write_file
from studies.concealed_trial.drawing import SHARES
from studies.concealed_trial.effects import KINDS, UNKNOWN, UNMODELLED, Kind
from studies.concealed_trial.observer_events import cost_of_times, event_starts, sharpened
from studies.concealed_trial.observer_filter import RandomForce, Whitening, slopes
from studies.concealed_trial.observer_model import Evaluation, ObservedFit, Part, combinations
from studies.concealed_trial.observer_track import Track, read_track, referred
from studies.concealed_trial.ships import TrialShip
from studies.concealed_trial.unmodelled import FORCES, RANDOM

FINALISTS, CANDIDATES = 3, 8
"""Hypotheses that are linearised again, and those that are fitted."""
LEAST_GAIN = 3.0
"""Log likelihood that an effect has to add to be fitted; its prior takes more."""
CLOSE = 25.0
"""A rival this far behind the best in log evidence is not linearised again."""
ROUNDS = 2
"""Linearisations about the values that were found."""
RESTING = 0.5
"""Change of the log evidence that ends them."""
GUSTINESS, GUST_TAUS = (0.13, 0.2), (40.0,)
"""What is tried of gusts, as drawn: standard deviation over mean speed, and correlation time [s]."""
RANDOM_SIZES, RANDOM_TAUS = 5, (40.0,)
"""What is tried of random courses."""
EXACT = 0.2
"""Size that stands for a model without errors: orders and angles are known once a second only."""


@dataclass
class Observer:
    """The hypotheses about one case.

    Attributes:
        track: The recordings.
        nuisance: Size of what is wrong with the model in every case.
        found: Hypotheses with what is drawn before any is looked at, as log weights.
    """

    track: Track
    nuisance: float
    found: list[tuple[ObservedFit, float]]

    @classmethod
    def of(cls, track: Track, nuisance: float = 1.0) -> "Observer":
        """Look at a case.

        Args:
            track: The recordings.
            nuisance: As drawn.

        Returns:
            All that was found.
        """
        observer = cls(track, max(nuisance, EXACT), [])
        base = observer._evaluation(track, ())
        calm = base.fit(())
        observer._add(calm)
        best = observer._extended(base, calm)
        observer._random(track, calm)
        before = calm
        for _ in range(2):  # a second effect, and a third
            if best is None or UNKNOWN in best.names or best.log_evidence < before.log_evidence:
                break
            before, best = best, observer._extended(observer._about(best), best)
        return observer

    def _evaluation(self, track: Track, parts: tuple[Part, ...], more: RandomForce | None = None) -> Evaluation:
        """Gains about a reference."""
        linear = slopes(track, [part.effect(track.ship) for part in parts], self.nuisance)
        return Evaluation(track, Whitening(track, linear, self.nuisance, more))

    def _about(self, fitted: ObservedFit) -> Evaluation:
        """Linearised again where a hypothesis rests."""
        truth = self.track.truth([part.effect(self.track.ship) for part in fitted.parts])
        return self._evaluation(referred(self.track, truth), fitted.parts)

    def _extended(self, base: Evaluation, before: ObservedFit) -> ObservedFit | None:
        """The best with one effect more; all that come close are kept."""
        misfit = base.misfits([before.parts])[:, 0]
        taken = {part.kind.family for part in before.parts} | {n for p in before.parts for n in p.kind.equivalent}
        kinds = [k for k in (*KINDS, *(UNMODELLED if not before.parts else ())) if _possible(k, self.track.ship, taken)]
        starts = base.starts([kind for kind in kinds if not kind.confined], before.parts, misfit)
        events = [event_starts(base, k, before.parts, misfit, combinations(k)) for k in kinds if k.confined]
        starts += base.best(events, before.parts)
        starts = [start for start in starts if start[0] < misfit @ misfit - 2 * LEAST_GAIN]
        starts.sort(key=lambda start: start[0])
        chosen: dict[tuple[str, str | None], ObservedFit] = {}
        for _, parts in starts:
            key = (parts[-1].kind.name, parts[-1].kind.detail)
            if len(chosen) < CANDIDATES or key in chosen:
                fitted = _priced(base.fit(parts))
                if key not in chosen or fitted.log_evidence > chosen[key].log_evidence:
                    chosen[key] = fitted
        ranked = sorted(chosen.values(), key=lambda fitted: -fitted.log_evidence)
        near = [f for f in ranked if f.log_evidence > ranked[0].log_evidence - self._margin(f, before)]
        again = [self._rested(fitted) for fitted in near[:FINALISTS]]
        for fitted in again:
            self._add(fitted)
        return max(again, key=lambda fitted: fitted.log_evidence, default=None)

    def _margin(self, fitted: ObservedFit, before: ObservedFit) -> float:
        """How far behind a hypothesis may be: a strong effect is far from where it was linearised first."""
        return CLOSE + 0.5 * abs(fitted.log_likelihood - before.log_likelihood)

    def _rested(self, fitted: ObservedFit) -> ObservedFit:
        """Linearised about its own values until it rests."""
        for _ in range(ROUNDS):
            before = fitted.log_evidence
            base, parts = self._about(fitted), fitted.parts
            if not isinstance(parts[-1].intervals, str):
                parts = (*parts[:-1], sharpened(base, parts[-1], parts[:-1]))
            fitted = _priced(base.fit(parts))
            if abs(fitted.log_evidence - before) < RESTING:
                break
        return fitted

    def _random(self, track: Track, calm: ObservedFit) -> None:
        """Random forces, and gusts beside the steady wind."""
        unit = track.ship.force_unit * np.array([1.0, 1.0, track.ship.length])
        for kind in UNMODELLED:
            if kind.detail not in RANDOM:
                continue
            direction = (unit * [letter == FORCES[kind.detail][0] for letter in "XYN"])[:, None]
            sizes = np.geomspace(kind.low, kind.high, RANDOM_SIZES)
            self._mixed(track, calm, kind, [RandomForce(direction, s, tau) for s in sizes for tau in RANDOM_TAUS])
        ranked = sorted((fitted for fitted, _ in self.found), key=lambda fitted: -fitted.log_evidence)[:2]
        winds = [fitted for fitted in ranked if [p.kind.name for p in fitted.parts] == ["wind_steady"]]
        if winds:
            steady, kind = winds[0], next(k for k in KINDS if k.name == "wind_gusty")
            part = steady.parts[0]
            truth = track.truth([part.effect(track.ship)])
            about = referred(track, truth)
            direction = _gust_direction(about, part)
            forces = [RandomForce(direction, g * part.size, tau) for g in GUSTINESS for tau in GUST_TAUS]
            self._mixed(about, steady, kind, forces)

    def _mixed(self, track: Track, fitted: ObservedFit, kind: Kind, forces: Sequence[RandomForce]) -> None:
        """A hypothesis with a random course: the mean of its evidence over sizes and correlation times."""
        linear = slopes(track, [part.effect(track.ship) for part in fitted.parts], self.nuisance)
        occam = fitted.log_evidence - fitted.log_likelihood
        found = []
        for force in forces:
            base = Evaluation(track, Whitening(track, linear, self.nuisance, force))
            found.append(base.log_likelihood(base.misfits([fitted.parts])[:, 0]) + occam)
        part = fitted.parts[0] if fitted.parts else Part(kind, kind.low, {})
        evidence = float(np.logaddexp.reduce(found) - log(len(found)))
        named = replace(part, kind=kind, extras={**part.extras, "gustiness": GUSTINESS[1]} if fitted.parts else {})
        self._add(ObservedFit((named,), max(found), evidence, fitted.covariance))

    def _add(self, fitted: ObservedFit) -> None:
        """Keep a hypothesis with its prior."""
        sort = ("clean", "single", "pair", "triple")[len(fitted.parts)]
        listed = len(KINDS)
        count = {"clean": 1, "single": listed, "pair": listed * (listed - 1) / 2}
        weight = log(SHARES[sort]) - log(count.get(sort, listed * (listed - 1) * (listed - 2) / 6))
        if fitted.names == {UNKNOWN}:
            weight = log(SHARES[UNKNOWN]) - log(len(UNMODELLED))
        self.found.append((fitted, weight))

    def posterior(self) -> list[tuple[ObservedFit, float]]:
        """Hypotheses and their probabilities.

        Returns:
            The most probable first.
        """
        logs = np.array([fitted.log_evidence + weight for fitted, weight in self.found])
        share = np.exp(logs - np.logaddexp.reduce(logs))
        return [(self.found[k][0], float(share[k])) for k in np.argsort(-share)]


def _possible(kind: Kind, ship: TrialShip, taken: set[str]) -> bool:
    """Whether a kind can be drawn beside those that are there, and has no random course."""
    drawn = kind.detail not in RANDOM and kind.name != "wind_gusty"
    return drawn and (not kind.ships or ship.name in kind.ships) and not {kind.family, kind.name} & taken


def _priced(fitted: ObservedFit) -> ObservedFit:
    """Its evidence with what the times of its events cost."""
    return replace(fitted, log_evidence=fitted.log_evidence - cost_of_times(fitted.parts))


def _gust_direction(track: Track, part: Part) -> np.ndarray:
    """Force of one m/s more wind along the reference: X, Y [N], N [N m]."""
    linear = slopes(track, [], EXACT)
    stronger = part.at([log(part.size * 1.02), *part.values[1:]])
    d = [track.residuals(track.truth([p.effect(track.ship)]))[0] for p in (part, stronger)]
    change = (d[1] - d[0]) / (stronger.size - part.size)
    into = np.where(track.ends[:, None, None], np.eye(3), linear.force[:, 3:6])
    return np.linalg.solve(into, change[:, 3:6, None])[..., 0].T


def answer_of(case: str, observer: Observer) -> dict[str, Any]:
    """The answer in the form that is scored.

    Args:
        case: Name of the case.
        observer: What was found.

    Returns:
        Content of ``answer.json``.
    """
    ranked = observer.posterior()
    names: dict[str, float] = {}
    for fitted, probability in ranked:
        for name in fitted.names:
            names[name] = names.get(name, 0.0) + probability
    clean = sum(probability for fitted, probability in ranked if not fitted.parts)
    entries = []
    for name, probability in sorted(names.items(), key=lambda item: -item[1]):
        fitted = next(fitted for fitted, _ in ranked if name in fitted.names)
        part = next(part for part in fitted.parts if part.kind.name == name)
        entry = {"name": name, "probability": min(probability, 1.0), "equation": list(part.kind.accepted[0])}
        entry |= {"intervals": part.intervals, "parameters": _parameters(observer.track.ship, fitted, part)}
        entries.append(entry)
    return {"case": case, "verdict": "none" if clean > 0.5 else "mismatch", "effects": entries}


def _parameters(ship: TrialShip, fitted: ObservedFit, part: Part) -> dict[str, list[Any]]:
    """Parameters of a listed effect with standard errors, by their slopes."""
    if part.kind.name == UNKNOWN:
        return {}
    first = sum(len(other.free) for other in fitted.parts[: fitted.parts.index(part)])
    values, centre = part.values, dict(part.effect(ship).parameters)
    covariance = fitted.covariance[first : first + len(values), first : first + len(values)]
    slopes_of: dict[str, list[float]] = {name: [] for name in centre}
    for k, (low, high) in enumerate(part.free):
        change = 1e-4 * (high - low)
        other = part.at([v + change * (j == k) for j, v in enumerate(values)]).effect(ship).parameters
        for name in centre:
            slopes_of[name].append((other[name] - centre[name]) / change)
    found = {}
    for name, value in centre.items():
        row = np.array(slopes_of[name])[: len(covariance)]
        found[name] = [float(value), float(np.sqrt(max(row @ covariance @ row, 0.0))), ""]
    return found


def observe(cases: Iterable[Path], out: Path, nuisance: float = 1.0) -> None:
    """Answer all cases that have no answer yet.

    Args:
        cases: Their folders.
        out: Takes ``<case>/answer.json``.
        nuisance: Size of what is wrong with the model in every case.
    """
    for case in cases:
        path = out / case.name / "answer.json"
        if path.is_file():
            continue
        answer = answer_of(case.name, Observer.of(read_track(case), nuisance))
        write_file(path, json.dumps(answer, indent=1))


def main(arguments: list[str]) -> None:
    """Answer a folder of cases.

    Args:
        arguments: ``cases=DIR``, ``out=DIR`` and ``nuisance=NUMBER``.

    Raises:
        InputError: If an argument is not understood or there are no cases.
    """
    given = {"nuisance": "1"} | dict(argument.split("=", 1) for argument in arguments if "=" in argument)
    if set(given) != {"cases", "out", "nuisance"}:
        raise InputError(f"got {' '.join(arguments) or 'nothing'}; write cases=DIR out=DIR nuisance=1")
    cases = sorted(path.parent for path in Path(given["cases"]).glob("*/manifest.json"))
    if not cases:
        raise InputError(f"cases={given['cases']} holds no case with a manifest.json; give the folder above the cases")
    observe(cases, Path(given["out"]), float(given["nuisance"]))


if __name__ == "__main__":
    with one_line():
        main(sys.argv[1:])
