"""Wang 1996, chapter 7: sway and yaw in random waves, and what their autocorrelation tells."""

from collections import Counter
from typing import Any

from manoeuvre_nn.reproduction import wang1996_autocorrelation as autocorrelation
from manoeuvre_nn.reproduction import wang1996_random_decrement as decrement
from manoeuvre_nn.reproduction import wang1996_random_decrement_plots as plots
from manoeuvre_nn.reproduction import wang1996_waves as waves
from manoeuvre_nn.reproduction.section import Claim, Effort, Plot, Say, Section
from manoeuvre_nn.reproduction.wang1996_sway_yaw import System, Voyages, linear, nonlinear, sail, simplest
from manoeuvre_nn.ship.mariner import mariner
from manoeuvre_nn.ship.taylor import TaylorShip

WHERE = {"simplest": "Figs 7.9, 7.10", "linear": "Figs 7.14, 7.15", "nonlinear": "Figs 7.18, 7.19"}


def chapter(effort: Effort, say: Say) -> Section:
    """Chapter 7 again: spectrum, wave forces, three systems in random waves and the identification from them.

    Args:
        effort: 200 realisations of the sea, 40 in the quick form.
        say: Tells what is being done.

    Returns:
        Claims, the spread over seas and angles, and Figs 7.1 and 7.3 to 7.19.
    """
    ship, seas = mariner(), 40 if effort.quick else 200
    say("Chapter 7: wave forces")
    claims, figures = _sea(ship)
    systems = [simplest(ship), linear(ship), nonlinear(ship)]
    say(f"Chapter 7: three systems in {seas} seas from three directions")
    voyages = sail(ship, systems, seas, effort.seed)
    say("Chapter 7: autocorrelations and identification")
    more, tables = _identified(ship, systems, voyages)
    claims += [*more, *autocorrelation.stationary(ship, systems[0], effort.seed)]
    tables = {"Froude-Krylov force of a wave of .503 m and .65 rad/s": waves.force_table(ship)} | tables
    for name, each in voyages.items():
        figures += [*plots.response_plots(name, each), *plots.autocorrelation_plots(name, each)]
        if name == "simplest":
            figures.append(plots.logarithm_plot(systems[0], each))
    return Section("Chapter 7: sway and yaw in random waves", _summary(claims), claims, tables, figures)


def _sea(ship: TaylorShip) -> tuple[list[Claim], list[Plot]]:
    """Section 7.1."""
    claims = [*waves.spectrum_claims(), *waves.force_claims(ship)]
    figures = [waves.spectrum_plot(), waves.offsets_plot(ship)]
    return claims, [*figures, *waves.history_plots(ship), *waves.amplitude_plots(ship)]


def _identified(
    ship: TaylorShip, systems: list[System], voyages: dict[str, Voyages]
) -> tuple[list[Claim], dict[str, list[dict[str, Any]]]]:
    """Sections 7.2 to 7.5."""
    first, second, _ = systems
    simple, simple_rows = decrement.simple_identification(first, voyages["simplest"])
    coupled, coupled_rows = decrement.coupled_identification(second, voyages["linear"])
    claims = [*autocorrelation.closed_forms(first, voyages["simplest"], "Eqs 7.23-7.30"), *simple]
    claims += [autocorrelation.folded(voyages["simplest"]), *autocorrelation.coupled_constants(ship, second)]
    claims += [*autocorrelation.closed_forms(second, voyages["linear"], "Eqs 7.39, 7.40, 7.45, 7.46"), *coupled]
    claims.append(autocorrelation.offset(voyages["nonlinear"]))
    alike: list[dict[str, Any]] = []
    for name, each in voyages.items():
        more, rows = autocorrelation.likeness_claims(name, WHERE[name], each)
        claims, alike = claims + more, alike + rows
    return claims, {
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
