"""The rival methods by name: each takes a case and says what it finds."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

from manoeuvre_nn.core.effect import Effect
from studies.concealed_trial.rivals import neural, structural
from studies.concealed_trial.rivals.neural_result import judge_by_network
from studies.concealed_trial.rivals.package import CalmWater, Case, shelf
from studies.concealed_trial.rivals.result import RivalResult, compared
from studies.concealed_trial.rivals.search import LONG, fitted, gusts, search
from studies.concealed_trial.rivals.sindy import Terms
from studies.concealed_trial.rivals.split import TestedTerms
from studies.concealed_trial.rivals.whitened import WhitenedRuns

METHODS = ("regression", "pysindy", "sample_split", "structural", "neural", "neural_referee")
LEARNT = ("neural", "neural_referee")
"""Those that learn from examples: of our own shelf, and of the referee."""


def judge(case: Case, method: str, effects: Sequence[Effect] | None = None, model: Path | None = None) -> RivalResult:
    """Judge a case.

    Args:
        case: The case.
        method: One of ``METHODS``.
        effects: Prototypes of the candidates; None takes all.
        model: File of what was learnt, for ``LEARNT``.

    Returns:
        What the method finds.
    """
    effects = shelf(case.hull) if effects is None else effects
    if method in LEARNT:
        return judge_by_network(case, _loaded(model or Path(f"{method}.pt")), effects)
    by_method: dict[str, Callable[[Case, Sequence[Effect]], RivalResult]] = {
        "regression": by_regression,
        "structural": structural.judge_by_structure,
        "pysindy": by_terms,
        "sample_split": partial(by_terms, kind=TestedTerms),
    }
    return by_method[method](case, effects)


_loaded = cache(neural.load)


def by_regression(case: Case, effects: Sequence[Effect]) -> RivalResult:
    """Every effect fitted to the errors, compared by an information criterion.

    Args:
        case: The case.
        effects: Prototypes of the candidates.

    Returns:
        What is found.
    """
    data = WhitenedRuns(CalmWater(case.hull), case.fitted)
    none, fits = search(data, effects)
    fits += [gusts(data, f, g) for f in fits for g in effects if g.random and "wind_steady" in f.names]
    return compared(data, none, sorted(fits, key=lambda f: f.criterion))


def by_terms(case: Case, effects: Sequence[Effect], kind: type[Terms] | type[TestedTerms] = Terms) -> RivalResult:
    """Terms found by sparse regression, and the effect that makes the same ones.

    Args:
        case: The case.
        effects: Prototypes of the candidates.
        kind: How terms are found: by pySINDy, or with tests.

    Returns:
        What is found.
    """
    calm = CalmWater(case.hull)
    data = WhitenedRuns(calm, case.fitted)
    none, fits = search(kind(calm, case.fitted), effects)
    best = fitted(data, fits[0].hypothesis, *LONG)
    if "wind_steady" in best.names:  # terms know no gusts: they are read off what the steady wind leaves
        best = min([best, *(gusts(data, best, g) for g in effects if g.random)], key=lambda f: f.criterion)
        fits[0] = replace(fits[0], hypothesis=best.hypothesis)
    return compared(data, none, fits, best)
