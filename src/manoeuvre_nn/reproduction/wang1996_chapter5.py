"""Wang 1996, sections 5.1 and 5.2: how far networks that know one zigzag carry to other manoeuvres."""

from collections.abc import Mapping, Sequence

import numpy as np

from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.reproduction.section import Claim, Effort, Line, Panel, Plot, Say, Section, Verdict
from manoeuvre_nn.reproduction.wang1996_chapter3 import loop
from manoeuvre_nn.reproduction.wang1996_chapter4 import trained_and_flown
from manoeuvre_nn.reproduction.wang1996_curves import beside, role
from manoeuvre_nn.reproduction.wang1996_networks import Case, Flown, case, spiral_points, spread_row
from manoeuvre_nn.reproduction.wang1996_trainings import BEST_START, STARTS

TRIALS = ("zz35", "zz20", "tc25", "tc10", "spiral20")
"""The training manoeuvre, the thesis' three tests, and a turn with a rudder angle that the zigzag hardly holds."""
SHOWN = "published", "scaled", BEST_START
"""Networks in the figures."""
FIGURES = {"zz20": "Figs 5.3-5.7", "tc25": "Figs 5.8-5.11", "tc10": "Section 5.2"}
STATEMENTS = {"zz20": "fits well", "tc25": "good agreement", "tc10": "not tested"}
GOOD = 0.1
"""Deviation up to which a prediction is called good [L]; the thesis says "good agreement" and shows curves."""


def chapter(effort: Effort, say: Say) -> Section:
    """Test the networks of chapter 4 on manoeuvres that they were not trained on.

    Args:
        effort: How much computing.
        say: Told what is being done.

    Returns:
        Figures 5.1-5.12; section 5.3 is a chapter of its own.

    Source:
        Wang 1996, sections 5.1 and 5.2.
    """
    of = case("mariner")
    flights = trained_and_flown(of, effort, say, TRIALS)
    theirs = flights["published"].dev
    return Section(
        title="Chapter 5: generalization of the networks",
        summary=f"The published networks are {theirs['zz20'][0]:.2g} L off in the 20-20 deg zigzag, "
        f"{theirs['tc25'][0]:.2g} in the 25-deg turn and {theirs['tc10'][0]:.2g} in a 10-deg turn, which the thesis "
        "does not test. Networks that fit the training manoeuvre equally well carry to others very differently.",
        claims=[
            space_claim(of),
            *generalization_claims(flights, FIGURES),
            spread_claim(flights),
            *spiral_claims(of, flights),
        ],
        tables={
            "Generalization: medians over the starts, the worst in brackets": [spread_row(f) for f in flights.values()],
            "Loop of the 20-deg spiral": spiral_rows(of, flights),
        },
        plots=plots(of, [flights[k] for k in SHOWN]),
    )


def space_claim(of: Case) -> Claim:
    """Figures 5.1 and 5.2: whether the test manoeuvres go where the training manoeuvre was not.

    Args:
        of: The ship.

    Returns:
        The claim.
    """
    known = scaled_motion(of, of.references["zz35"])
    far = {}
    for name in ("zz20", "tc25"):
        other = scaled_motion(of, of.references[name])
        apart = np.linalg.norm(other[:, None] - known[None], axis=-1).min(axis=1)
        far[name] = float(np.median(apart))
    told = ", ".join(f"{name} {value:.2f}" for name, value in far.items())
    return Claim(
        "Figs 5.1 and 5.2", "distance in (u', v', r') to the nearest sample of zz35, median [-]",
        "a totally different path",
        told, "holds" if min(far.values()) > 0.01 else "does not hold",
    )  # fmt: skip


def scaled_motion(of: Case, run: Recording) -> np.ndarray:
    """u/U0, v/U0 and rL/U0 of a run.

    Args:
        of: The ship.
        run: The run.

    Returns:
        Samples (n, 3).
    """
    p = of.ship.particulars
    return run.stacked("u", "v", "r") * [1 / p.speed, 1 / p.speed, p.length / p.speed]


def generalization_claims(flights: Mapping[str, Flown], figures: Mapping[str, str]) -> list[Claim]:
    """The thesis' zz20 and tc25, and tc10 beside them.

    Args:
        flights: Networks in closed loop.
        figures: Manoeuvre -> where the thesis has it.

    Returns:
        A claim for each manoeuvre and training.
    """
    claims = []
    for name, where in figures.items():
        for flight in flights.values():
            dev, count = flight.dev[name], len(flight.networks.models)
            middle = float(np.median(dev))
            share = (
                f"{np.mean(dev <= GOOD):.0%} of {count} starts within {GOOD} L, from {dev.min():.2g} to {dev.max():.2g}"
            )
            why = share if count > 1 else f"good is up to {GOOD} L here; the thesis shows curves"
            verdict: Verdict = (
                "holds" if middle <= GOOD else "holds in direction" if middle <= 3 * GOOD else "does not hold"
            )
            if name == "tc10":
                verdict, why = "not comparable", f"the thesis has no test at a small rudder angle; {why}"
            what = f"{name}, dev, {flight.networks.label}" + (", median" if count > 1 else "")
            claims.append(Claim(where, what, STATEMENTS[name], middle, verdict, why, "L"))
    return claims


def spread_claim(flights: Mapping[str, Flown]) -> Claim:
    """Whether a good fit of the training manoeuvre means a good prediction of others.

    Args:
        flights: Networks in closed loop.

    Returns:
        The claim of section 5.2 over all starts of Levenberg-Marquardt.
    """
    several = [flights[k] for k in STARTS]
    error = np.concatenate([f.networks.errors.max(1) for f in several])
    dev = np.concatenate([f.dev["tc25"] for f in several])
    told = f"errors {error.min():.1g} to {error.max():.1g}, tc25 {dev.min():.2g} to {dev.max():.2g} L"
    verdict: Verdict = "holds" if dev.max() <= GOOD else "holds in direction" if dev.min() <= GOOD else "does not hold"
    why = f"{np.mean(dev <= GOOD):.0%} of {len(dev)} starts of Levenberg-Marquardt are within {GOOD} L"
    return Claim("Section 5.2", "a network that fits zz35 generalizes", "good generalization", told, verdict, why)


def spiral_claims(of: Case, flights: Mapping[str, Flown]) -> list[Claim]:
    """Figure 5.12: the spiral and what the thesis reads off it.

    Args:
        of: The ship.
        flights: Networks in closed loop.

    Returns:
        Two claims.
    """
    true = loop(*spiral_points(of.references["spiral20"]))[0]
    rate = spiral_points(of.references["spiral20"])[1]
    claims = []
    for key in SHOWN:
        points = [spiral_points(run)[1] for run in flights[key].runs["spiral20"] if run.status == "ok"]
        off = np.median([np.abs(p - rate).max() for p in points]) if points else np.inf
        verdict: Verdict = "holds" if off <= 0.05 else "holds in direction" if off < true / 2 else "does not hold"
        what = f"largest error of the yaw rate, {flights[key].networks.label}"
        why = "" if off <= 0.05 else f"the simulated loop is {true:.2f} deg/s high"
        claims.append(Claim("Fig 5.12", what, "the loop is predicted", float(off), verdict, why, "deg/s"))
    why = "the loop is the lag of 60-s holds, see chapter 3: the ship is straight-line stable"
    claims.append(
        Claim("Section 5.2", "meaning of the loop", "slight directional instability", "lag", "does not hold", why)
    )
    return claims


def spiral_rows(of: Case, flights: Mapping[str, Flown]) -> list[dict[str, object]]:
    """Height and width of the spiral's loop.

    Args:
        of: The ship.
        flights: Networks in closed loop.

    Returns:
        One row for the simulation and one for each training.
    """
    whole = {"simulation": [of.references["spiral20"]]} | {
        f.networks.label: f.runs["spiral20"] for f in flights.values()
    }
    rows = []
    for label, runs in whole.items():
        found = np.array([loop(*spiral_points(run)) for run in runs if run.status == "ok"])
        height, width = np.median(found, axis=0) if len(found) else (np.nan, np.nan)
        rows.append({
            "networks": label,
            "height [deg/s]": f"{height:.3f}",
            "width [deg]": f"{width:.2f}",
            "ended early": len(runs) - len(found),
        })
    return rows


def plots(of: Case, shown: Sequence[Flown]) -> list[Plot]:
    """Figures 5.1-5.12.

    Args:
        of: The ship.
        shown: Networks in closed loop.

    Returns:
        The plots, and the rudder angles that the training manoeuvre holds.
    """
    motion = ("u", "v", "r", "psi", "track")
    first = {k: scaled_motion(of, of.references[k]) for k in ("zz35", "zz20", "tc25")}
    planes = [
        Panel("v / U0", "r L / U0", [Line(k, first[k][:, 1], first[k][:, 2]) for k in pair], f"Fig 5.{n}")
        for n, pair in ((1, ("zz35", "zz20")), (2, ("zz35", "tc25")))
    ]
    spirals = {"simulation": of.references["spiral20"]} | {f.networks.label: f.middle("spiral20") for f in shown}
    lines = [Line(k, *spiral_points(run), role(k)) for k, run in spirals.items()]
    angles = np.sort(np.abs(of.references["zz35"]["delta"])) / DEGREE
    share = Line("zz35", angles, np.linspace(0, 1, len(angles)))
    return [
        Plot("figure_5_1_to_5_2", "Figs 5.1 and 5.2: where the manoeuvres go in the space of the velocities.", planes),
        beside(of, shown, "zz20", "figure_5_3_to_5_7", "Figs 5.3-5.7: the 20-20 deg zigzag.", motion),
        beside(of, shown, "tc25", "figure_5_8_to_5_11", "Figs 5.8-5.11: the 25-deg turn.", ("u", "v", "r", "track")),
        beside(of, shown, "tc10", "turn_10_deg", "Not in the thesis: a 10-deg turn.", ("u", "v", "r", "track")),
        Plot("figure_5_12", "Fig 5.12: the 20-deg spiral, yaw rates at the ends of the 60-s holds.",
             [Panel("rudder [deg]", "yaw rate [deg/s]", lines)]),
        Plot("rudder_angles", "Share of the training samples with a rudder angle up to a value.",
             [Panel("rudder angle [deg]", "share [-]", [share])]),
    ]  # fmt: skip
