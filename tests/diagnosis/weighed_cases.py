"""Log evidences of searches over generated runs, stored as ``weighed_cases.json``: cases that decisions are held by.

    PYTHONPATH=src:tests python tests/diagnosis/weighed_cases.py [decide]

makes the file again in some minutes; with ``decide`` only the decisions in it. Three runs of a Mariner are sailed
whose coefficients are off by 3 %, with a small coloured force and the noise of the other tests; nothing acts, or
effects of a known size, or a force that no candidate has. Six candidates are searched. Stored is what a decision sees:
the log evidence over calm water of every hypothesis, of something unknown and of a short formula. ``decided`` is what
was decided of that.
"""

import json
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import patch

import numpy as np
import torch
from fleet import unchecked
from strangers import Stranger, coloured, periodic, ramp
from trials import CALM, NOISE, SHIP, run_of, values

from manoeuvre_nn.core.effect import Effect
from manoeuvre_nn.core.manoeuvre import Manoeuvre, Stage
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.diagnosis import decision
from manoeuvre_nn.diagnosis.decision import Decision
from manoeuvre_nn.diagnosis.formula import short_formula
from manoeuvre_nn.diagnosis.search import SearchResult, search
from manoeuvre_nn.diagnosis.unknown import ReceiverWander, random_force, unknown_evidence
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.dynamics.vessel import Vessel
from manoeuvre_nn.effect.current import Current
from manoeuvre_nn.effect.propulsion import HullFouling
from manoeuvre_nn.effect.rudder import RudderOffset
from manoeuvre_nn.effect.sensors import HeadingBias, LogScale
from manoeuvre_nn.effect.wind import SteadyWind
from manoeuvre_nn.estimation.corrections import Calibrated, Corrections
from manoeuvre_nn.estimation.data_set import whitened_data_set
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis, Hypothesis
from manoeuvre_nn.estimation.marginal_likelihood import MarginalLikelihood
from manoeuvre_nn.estimation.process_noise import ProcessLevels
from manoeuvre_nn.estimation.relinearise import beside

STORED = Path(__file__).with_name("weighed_cases.json")
CANDIDATES = [kind(SHIP) for kind in (Current, SteadyWind, RudderOffset, HullFouling, HeadingBias, LogScale)]
SCATTER, LACKS = 0.03, 0.005
"""Relative error of the coefficients; coloured force over the resistance and that of 20 deg of rudder."""
GROUPS = {"clean": 16, "weak": 12, "strong": 6, "pair": 6, "unknown": 6}
"""Cases of each kind."""
SEVERAL = 4
"""Hypotheses of more than one effect that are kept, the best ones."""
HELM = [((25.0, None),), ((-15.0, None),), ((20.0, 30.0), (-20.0, 60.0), (20.0, None))]
WEAK = {
    "current": lambda size, angle: Current(SHIP, speed=0.01 * size, toward_deg=angle),
    "wind_steady": lambda size, angle: SteadyWind(SHIP, speed=4.0 * size**0.5, from_deg=angle),
    "rudder_offset": lambda size, angle: RudderOffset(SHIP, offset_deg=0.22 * size),
    "log_scale": lambda size, angle: LogScale(SHIP, factor=1 + 0.0016 * size),
    "heading_bias": lambda size, angle: HeadingBias(SHIP, bias_deg=0.11 * size),
}
"""Effects that are sometimes seen; ten times as large they always are."""


def acting(kind: str, rng: np.random.Generator) -> tuple[list[Effect], list[str]]:
    """What acts in a case, and the names of what can be found."""
    if kind == "clean":
        return [], []
    if kind == "unknown":
        shape = periodic(50.0) if rng.random() < 0.5 else ramp
        return [Stranger(rng.uniform(0.3, 1.0), str(rng.choice(["Y", "N"])), shape)], []
    names = [str(n) for n in rng.permutation(list(WEAK))[: 2 if kind == "pair" else 1]]
    sizes = rng.uniform(0.5, 2.0, len(names)) * (1.0 if kind == "weak" else 8.0)
    return [WEAK[n](float(s), float(rng.uniform(0, 360))) for n, s in zip(names, sizes, strict=True)], names


def weighed(kind: str, seed: int) -> dict:
    """What a decision sees of one generated case."""
    rng, names = np.random.default_rng([seed, *kind.encode()]), Corrections(CALM).names
    printed = [k for k, name in enumerate(names) if "+" not in name and name not in ("Mu", "Mv", "Mr")]
    shares = torch.zeros(len(names), dtype=torch.float64)
    shares[printed] = SCATTER * torch.tensor(rng.standard_normal(len(printed)))
    effects, there = acting(kind, rng)
    usual = [Stranger(LACKS, e, coloured(rng, 30.0)) for e in "XYN"]
    trials = [
        Manoeuvre(f"r{k}", "random_rudder", tuple(Stage(a * DEGREE, hold=t) for a, t in ((0.0, 40.0), *helm)), 180.0)
        for k, helm in enumerate(HELM)
    ]
    with unchecked():
        records = roll_out(Vessel(Calibrated(CALM, shares), [*usual, *effects]), trials, step=1.0)
        runs = [run_of(record, NOISE, 100 * seed + k) for k, record in enumerate(records)]
        result = search(whitened_data_set(CALM, runs), CANDIDATES)
        at_calm = beside(result.likelihood, result.none.hypothesis)
        formula = short_formula(at_calm, result.none)
        unknown = unknown_evidence(at_calm, result.none, formula, random=random_force(at_calm, result.none))
        singles = [j for j in result.fitted if len(j.names) == 1]
        several = [j for j in result.fitted if len(j.names) > 1]
    none = result.none.evidence
    return {
        "kind": kind,
        "acts": sorted(there),
        "unknown": round(unknown - none, 2),
        "formula": None if formula is None else round(formula.evidence - none, 2),
        "gains": {" + ".join(j.names): round(j.evidence - none, 2) for j in [*singles, *several[:SEVERAL]]},
    }


def search_of(case: dict) -> SearchResult:
    """A search that ended as a stored one."""
    effects = {e.name: e for e in CANDIDATES}

    def judged(gain: float, *names: str) -> FittedHypothesis:
        acting = tuple(effects[name] for name in names)
        h = Hypothesis(acting, tuple(values(e) for e in acting))
        return FittedHypothesis(h, gain, np.zeros((1, 1)), np.eye(len(h.vector())))

    made = [judged(gain, *names.split(" + ")) for names, gain in case["gains"].items()]
    likelihood = object.__new__(MarginalLikelihood)
    likelihood.data_set = SimpleNamespace(dynamics=CALM, levels=ProcessLevels((0.0,)))  # type: ignore[assignment]
    return SearchResult(judged(0.0), sorted(made, key=lambda j: -j.evidence), likelihood)


def decision_of(case: dict) -> Decision:
    """What is decided of a stored search."""
    result = search_of(case)
    rule = None if case["formula"] is None else replace(result.none, evidence=case["formula"])
    with (
        patch.object(decision, "beside", lambda likelihood, hypothesis: likelihood),
        patch.object(decision, "gain_by_coefficient_priors", lambda data_set, j: 0.0),
        patch.object(decision, "short_formula", lambda there, none: rule),
        patch.object(decision, "random_force", lambda there, none: None),
        patch.object(decision, "unknown_evidence", lambda *_: case["unknown"]),
        patch.object(decision, "receiver_wander", lambda there, none: ReceiverWander(0.0, 1.0, -np.inf)),
        patch.object(decision, "unknown_by_receiver", lambda there, none: -np.inf),
    ):
        return decision.decide(result)


def told(d: Decision) -> dict:
    """A decision as it is stored."""
    return {
        "named": d.named,
        "strange": d.strange,
        "none": round(d.none, 3),
        "unknown": round(d.unknown, 3),
        "best": None if d.best is None else " + ".join(d.best.names),
        "likely": {name: round(p, 3) for name, p in d.effects.items() if p > 0.005},
        "claims": [" + ".join(c.names) or "formula" for c in d.claims],
    }


def main(again: bool) -> None:
    """Write the file."""
    made = (
        json.loads(STORED.read_text())
        if again
        else [weighed(k, n) for k, count in GROUPS.items() for n in range(count)]
    )
    with unchecked():
        made = [case | {"decided": told(decision_of(case))} for case in made]
    STORED.write_text("[\n" + ",\n".join(json.dumps(case) for case in made) + "\n]\n")


if __name__ == "__main__":
    main(sys.argv[1:] == ["decide"])
