"""Wang 1996, appendix A: chapters 4 and 5 once more, with a Great Lakes bulk carrier."""

from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.ship.taylor import TaylorShip
from studies.reproduction.claims import read_claims
from studies.reproduction.section import ChapterResult, ComputingEffort, Plot, Say
from studies.wang1996.chapter3 import ship_values
from studies.wang1996.chapter4 import estimate_values, target_plot, trained_and_flown, weight_values
from studies.wang1996.chapter5 import SHOWN, TRIALS, generalization_values, spiral_rows
from studies.wang1996.curves import beside
from studies.wang1996.networks import Flown, ThesisShip, case, spread_row


def chapter(effort: ComputingEffort, say: Say) -> ChapterResult:
    """Do with the bulk carrier what chapters 4 and 5 do with the Mariner.

    Args:
        effort: How much computing.
        say: Told what is being done.

    Returns:
        Tables A.1-A.7, Figures A.1-A.17.

    Source:
        Wang 1996, appendix A.
    """
    claims, of = read_claims("wang1996", "A"), case("great_lakes_bulker")
    flights = trained_and_flown(of, effort, say, TRIALS)
    theirs = flights["published"].dev
    return ChapterResult(
        title="Appendix A: a Great Lakes bulk carrier",
        summary="The same reading of the printed weights holds. The published networks are "
        f"{theirs['zz20'][0]:.2g} L off in the 20-20 deg zigzag and {theirs['tc25'][0]:.2g} in the 25-deg turn; the "
        "ship's coefficients let it run astern late in a turn, so that turns are cut short.",
        claims=claims.beside(
            {"table": ship_values(of.ship)}
            | estimate_values(of.known)
            | weight_values(of)
            | generalization_values(flights, claims.limits["good"])
            | astern_values(of.ship)
        ),
        tables={
            "Trainings and generalization: medians over the starts, the worst in brackets": [
                spread_row(f) for f in flights.values()
            ],
            "Loop of the 20-deg spiral (not in the thesis)": spiral_rows(of, flights),
        },
        plots=plots(of, flights),
    )


def astern_values(ship: TaylorShip) -> dict[str, str | float]:
    """When the ship would run astern in the 25-deg turn: why turns are limited to 400 s.

    Args:
        ship: The ship.

    Returns:
        What happens, and the length of a turn [s].
    """
    (run,) = roll_out(CalmWater(ship), [turning_circle(25.0, duration=620.0)], step=1.0)
    astern = run.time[run["u"] < 0]
    told = f"runs astern after {astern[0]:.0f} s" if len(astern) else "keeps going ahead"
    return {"end_of_turn": told, "longest_turn": ship.particulars.longest_turn}


def plots(of: ThesisShip, flights: dict[str, Flown]) -> list[Plot]:
    """Figures A.1-A.17.

    Args:
        of: The ship.
        flights: Networks in closed loop.

    Returns:
        The plots.
    """
    shown, motion = [flights[k] for k in SHOWN], ("u", "v", "r", "psi", "track")
    networks = [f.networks for f in shown]
    return [
        target_plot(of, networks, "figure_a_1_to_a_3", "Figs A.1-A.3: networks and simulated g over time."),
        beside(of, shown, "zz35", "figure_a_4_to_a_8", "Figs A.4-A.8: the 35-35 deg zigzag.", motion),
        beside(of, shown, "zz20", "figure_a_9_to_a_13", "Figs A.9-A.13: the 20-20 deg zigzag.", motion),
        beside(of, shown, "tc25", "figure_a_14_to_a_17", "Figs A.14-A.17: the 25-deg turn.", ("u", "v", "r", "track")),
    ]
