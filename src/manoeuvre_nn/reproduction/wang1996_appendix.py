"""Wang 1996, appendix A: chapters 4 and 5 once more, with a Great Lakes bulk carrier."""

from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.reproduction.section import Claim, Effort, Plot, Say, Section
from manoeuvre_nn.reproduction.wang1996_chapter3 import ship_claims
from manoeuvre_nn.reproduction.wang1996_chapter4 import (
    estimate_claims,
    loop_claims,
    target_plot,
    trained_and_flown,
    weight_claims,
)
from manoeuvre_nn.reproduction.wang1996_chapter5 import SHOWN, TRIALS, generalization_claims, spiral_rows
from manoeuvre_nn.reproduction.wang1996_curves import beside
from manoeuvre_nn.reproduction.wang1996_networks import Case, Flown, case, spread_row
from manoeuvre_nn.ship.taylor import TaylorShip

PARTICULARS = {"length": 217.627, "beam": 23.005, "draught": 8.100, "block": 0.905, "speed": 5.144, "rudder_rate": 2.5}
"""Table A.1 as printed: m, m, m, -, m/s, deg/s."""
COEFFICIENTS = {
    "X": {"u": -0.02000, "uu": 0.01800, "vv": -0.26007, "rr": 0.01310, "dd": -0.09833, "vr": 0.299023},
    "Y": {
        "v": -0.32535,
        "vvv": -7.38289,
        "vrr": -0.60718,
        "r": -0.16200,
        "rrr": 2.40185,
        "d": 0.08194,
        "ddd": -0.25469,
    },
    "N": {"v": -0.08732, "vvv": -3.04665, "vrr": 0.07576, "r": -0.04433, "rrr": -0.24180, "rvv": -0.84361}
    | {"d": -0.04675, "ddd": 0.23857},
}
"""Table A.2 as printed, without what is 0 there and without the inertia."""
CLARKE = {
    "Table A.3": {"m - X_udot": 0.20089, "X_u": -0.02, "X_dd": -0.0972},
    "Table A.4": {"m - Y_vdot": 0.34968, "Y_rdot": -0.00516, "Y_v": -0.23715, "Y_r - m": -0.13349, "Y_d": 0.081},
    "Table A.5": {"N_vdot": 0.00002, "I_z - N_rdot": 0.02577, "N_v": -0.06891, "N_r": -0.03526, "N_d": -0.0405},
}
"""Rows "Clarke values" of Tables A.3-A.5 as printed."""
INERTIA = {"m - X_udot": (0.19505, 0, 0), "m - Y_vdot": (0.33234, 1, 1), "I_z - N_rdot": (0.02724, 2, 2)}
BOUNDS = 0.04, 0.035, 0.02
"""What the errors of the published g1, g2, g3 may be for the corrected reading to hold [-]."""


def chapter(effort: Effort, say: Say) -> Section:
    """Do with the bulk carrier what chapters 4 and 5 do with the Mariner.

    Args:
        effort: How much computing.
        say: Told what is being done.

    Returns:
        Tables A.1-A.7, Figures A.1-A.17.

    Source:
        Wang 1996, appendix A.
    """
    of = case("great_lakes_bulker")
    flights = trained_and_flown(of, effort, say, TRIALS)
    theirs = flights["published"].dev
    return Section(
        title="Appendix A: a Great Lakes bulk carrier",
        summary="The same reading of the printed weights holds. The published networks are "
        f"{theirs['zz20'][0]:.2g} L off in the 20-20 deg zigzag and {theirs['tc25'][0]:.2g} in the 25-deg turn; the "
        "ship's coefficients let it run astern late in a turn, so that turns are cut short.",
        claims=[
            *table_claims(of.ship),
            *estimate_claims(of.known, CLARKE, ""),
            *weight_claims(of, "Tables A.6 and A.7", BOUNDS),
            *loop_claims(flights, "Figs A.4-A.8", 0.015),
            *generalization_claims(flights, {"zz20": "Figs A.9-A.13", "tc25": "Figs A.14-A.17", "tc10": "Appendix A"}),
            astern_claim(of.ship),
        ],
        tables={
            "Trainings and generalization: medians over the starts, the worst in brackets": [
                spread_row(f) for f in flights.values()
            ],
            "Loop of the 20-deg spiral (not in the thesis)": spiral_rows(of, flights),
        },
        plots=plots(of, flights),
    )


def table_claims(ship: TaylorShip) -> list[Claim]:
    """Tables A.1 and A.2 beside the ship that is simulated.

    Args:
        ship: The ship.

    Returns:
        One claim a number.
    """
    return ship_claims(ship, ("Table A.1", PARTICULARS), ("Table A.2", COEFFICIENTS), INERTIA)


def astern_claim(ship: TaylorShip) -> Claim:
    """Why turns are limited to 400 s.

    Args:
        ship: The ship.

    Returns:
        When the ship would run astern in the 25-deg turn.
    """
    (run,) = roll_out(CalmWater(ship), [turning_circle(25.0, duration=620.0)], step=1.0)
    astern = run.time[run["u"] < 0]
    ours = f"runs astern after {astern[0]:.0f} s" if len(astern) else "keeps going ahead"
    why = (
        f"no term of Y or N depends on the speed, so that the turn grows ever tighter while the ship slows down; turns "
        f"are limited to {ship.particulars.longest_turn:.0f} s"
    )
    return Claim("Figs A.14-A.17", "end of the 25-deg turn", "drawn", ours, "not comparable", why)


def plots(of: Case, flights: dict[str, Flown]) -> list[Plot]:
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
