"""Wang 1996, chapter 7: sway and yaw in random waves, and what their autocorrelation tells."""

from collections import Counter
from typing import Any

from manoeuvre_nn.ship.mariner import mariner
from manoeuvre_nn.ship.taylor import TaylorShip
from studies.reproduction.claims import read_claims
from studies.reproduction.section import ChapterResult, Claim, ComputingEffort, Plot, Say
from studies.wang1996 import autocorrelation, identification, waves
from studies.wang1996 import chapter7_plots as plots
from studies.wang1996.sway_yaw import LONG, System, Voyages, linear, nonlinear, sail, simplest


def chapter(effort: ComputingEffort, say: Say) -> ChapterResult:
    """Chapter 7 again: spectrum, wave forces, three systems in random waves and the identification from them.

    Args:
        effort: 200 realisations of the sea, 40 in the quick form.
        say: Tells what is being done.

    Returns:
        Claims, the spread over seas and angles, and Figs 7.1 and 7.3 to 7.19.
    """
    paper = read_claims("wang1996", "7")
    ship, seas = mariner(), 40 if effort.quick else 200
    say("Chapter 7: wave forces")
    found, figures = waves.spectrum_values() | waves.force_values(ship), _sea_plots(ship)
    systems = [simplest(ship), linear(ship), nonlinear(ship)]
    say(f"Chapter 7: three systems in {seas} seas from three directions")
    voyages = sail(ship, systems, seas, effort.seed)
    say("Chapter 7: autocorrelations and identification")
    more, tables = _identified(ship, systems, voyages)
    claims = paper.beside(found | more | autocorrelation.stationary_values(ship, systems[0], effort.seed))
    tables = {"Froude-Krylov force of a wave of .503 m and .65 rad/s": waves.force_table(ship)} | tables
    for name, each in voyages.items():
        figures += [*plots.response_plots(name, each), *plots.autocorrelation_plots(name, each)]
        if name == "simplest":
            figures.append(plots.logarithm_plot(systems[0], each))
    return ChapterResult("Chapter 7: sway and yaw in random waves", _summary(claims), claims, tables, figures)


def _sea_plots(ship: TaylorShip) -> list[Plot]:
    """Section 7.1."""
    figures = [waves.spectrum_plot(), waves.offsets_plot(ship)]
    return [*figures, *waves.history_plots(ship), *waves.amplitude_plots(ship)]


def _identified(
    ship: TaylorShip, systems: list[System], voyages: dict[str, Voyages]
) -> tuple[dict[str, Any], dict[str, list[dict[str, Any]]]]:
    """Sections 7.2 to 7.5: quantities for the claims, and tables."""
    first, second, _ = systems
    simple, simple_rows = identification.simple_identification(first, voyages["simplest"])
    coupled, coupled_rows = identification.coupled_identification(second, voyages["linear"])
    last_v, last_r = voyages["nonlinear"].free[-1].tolist()
    found = simple | coupled | autocorrelation.coupled_values(ship, second)
    found |= {"long": LONG, "last_v": last_v, "last_r": last_r}
    found["share_folded"] = autocorrelation.share_folded(voyages["simplest"])
    for system in (first, second):
        found[system.name] = autocorrelation.formula_errors(system, voyages[system.name])
    alike: list[dict[str, Any]] = []
    for name, each in voyages.items():
        found[f"alike_{name}"], rows = autocorrelation.likeness_values(name, each)
        alike += rows
    return found, {
        "Simplest system: rates from waves [1/s], spread over seas": simple_rows,
        "Linear system: rates from waves [1/s], spread over seas": coupled_rows,
        "Autocorrelations in waves less those without, over those without [-]": alike,
    }


def _summary(claims: list[Claim]) -> str:
    """What came of it, with the verdicts on single records counted."""
    single = Counter(c.verdict for c in claims if "one record" in c.what)
    return (
        "Without waves the autocorrelations give the coefficients of the simplest and the linear system exactly. In "
        f"waves a single record does so for {single['holds']} of {single.total()} coefficients and directions: only "
        "where the start dominates the record. Averaging autocorrelations leaves an error that averaging the records "
        "does not."
    )
