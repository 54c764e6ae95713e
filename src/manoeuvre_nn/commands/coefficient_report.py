"""Coefficients of a closed-loop fit in the folder and in the report of a run."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from matplotlib.figure import Figure

from manoeuvre_nn.commands.provenance import versions
from manoeuvre_nn.estimation.agreement import birge_scaled_covariance
from manoeuvre_nn.estimation.coefficients import Fitted, approach_inertia, form_of
from manoeuvre_nn.estimation.linear_motion import derived
from manoeuvre_nn.estimation.problem import Estimate, EstimationProblem
from manoeuvre_nn.report.coefficient_figures import figures
from manoeuvre_nn.report.coefficient_tables import Coefficients, coefficients_json, notes, sentence, tables
from manoeuvre_nn.report.tables import Row
from manoeuvre_nn.training.closed_loop_fit import ClosedLoopFit
from manoeuvre_nn.training.fits import Fit

RESULT = "coefficients.json"


@dataclass(frozen=True)
class CoefficientSection:
    """What coefficients add to a report: nothing where the model has none.

    Attributes:
        tables: Heading -> rows.
        figures: Name -> figure.
        notes: Sentences.
    """

    tables: Mapping[str, Sequence[Row]] = field(default_factory=dict)
    figures: Mapping[str, Figure] = field(default_factory=dict)
    notes: Sequence[str] = ()


def coefficient_report(fit: Fit, source: str, out: Path) -> CoefficientSection:
    """Write the coefficients of a fit, if it has any.

    Args:
        fit: The fit, trained.
        source: Sentence on what it was fitted to.
        out: Output folder.

    Returns:
        What the report shows of them.
    """
    if not isinstance(fit, ClosedLoopFit):
        return CoefficientSection()
    told = coefficients_of(fit, fit.problem, fit.estimate, source)
    return CoefficientSection(tables(told), write_coefficients(told, out), [sentence(told), *notes(told)[1:]])


def coefficients_of(fit: ClosedLoopFit, problem: EstimationProblem, found: Estimate, source: str) -> Coefficients:
    """Coefficients of a series, their errors as wide as stretches of the recordings disagree.

    Args:
        fit: The fit.
        problem: What was explained.
        found: The solution.
        source: Sentence on what it was fitted to.

    Returns:
        Coefficients and what follows from them.
    """
    known, network, count = fit.dynamics.known, fit.network, fit.forces.count
    values, (covariance, ratio) = found.values[:count], birge_scaled_covariance(problem, found)
    fitted = Fitted(
        tuple(network.names), values, covariance, problem.mean, problem.spread, approach_inertia(known),
        form_of(network.terms),
    )  # fmt: skip
    follows = derived(fit.forces, values, covariance, fitted.inertia)
    return Coefficients(known.particulars, fitted, follows, source, ratio=ratio)


def write_coefficients(told: Coefficients, out: Path) -> dict[str, Figure]:
    """Write ``coefficients.json`` and the figures.

    Args:
        told: The coefficients.
        out: Output folder.

    Returns:
        The figures.
    """
    (out / "figures").mkdir(parents=True, exist_ok=True)
    drawn = figures(told)
    for name, figure in drawn.items():
        figure.savefig(out / "figures" / f"{name.replace('/', '_')}.png", dpi=110)
        figure.set_layout_engine("none")  # laid out once: the report draws it again
    text = json.dumps({**coefficients_json(told), "versions": versions()}, indent=1)
    (out / RESULT).write_text(text, encoding="utf-8")
    return drawn
