"""Wang 1996, sections 5.1 and 5.2: how far networks that know one zigzag carry to other manoeuvres."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from studies.reproduction.claims import read_claims
from studies.reproduction.section import ChapterResult, ComputingEffort, Line, Panel, Plot, Say
from studies.wang1996.chapter3 import loop
from studies.wang1996.chapter4 import loop_values, trained_and_flown
from studies.wang1996.curves import beside, role
from studies.wang1996.networks import Flown, ThesisShip, case, spiral_points, spread_row
from studies.wang1996.trainings import BEST_START, STARTS

TRIALS = ("zz35", "zz20", "tc25", "tc10", "spiral20")
"""The training manoeuvre, the thesis' three tests, and a turn with a rudder angle that the zigzag hardly holds."""
SHOWN = "published", "scaled", BEST_START
"""Networks in the figures."""


def chapter(effort: ComputingEffort, say: Say) -> ChapterResult:
    """Test the networks of chapter 4 on manoeuvres that they were not trained on.

    Args:
        effort: How much computing.
        say: Told what is being done.

    Returns:
        Figures 5.1-5.12; section 5.3 is a chapter of its own.

    Source:
        Wang 1996, sections 5.1 and 5.2.
    """
    claims, of = read_claims("wang1996", "5.2"), case("mariner")
    flights = trained_and_flown(of, effort, say, TRIALS)
    theirs = flights["published"].dev
    return ChapterResult(
        title="Chapter 5: generalization of the networks",
        summary=f"The published networks are {theirs['zz20'][0]:.2g} L off in the 20-20 deg zigzag, "
        f"{theirs['tc25'][0]:.2g} in the 25-deg turn and {theirs['tc10'][0]:.2g} in a 10-deg turn, which the thesis "
        "does not test. Networks that fit the training manoeuvre equally well carry to others very differently.",
        claims=claims.beside(
            space_values(of) | generalization_values(flights, claims.limits["good"]) | spiral_values(of, flights)
        ),
        tables={
            "Generalization: medians over the starts, the worst in brackets": [spread_row(f) for f in flights.values()],
            "Loop of the 20-deg spiral": spiral_rows(of, flights),
        },
        plots=plots(of, [flights[k] for k in SHOWN]),
    )


def space_values(of: ThesisShip) -> dict[str, Any]:
    """Figures 5.1 and 5.2: how far the test manoeuvres go from where the training manoeuvre was.

    Args:
        of: The ship.

    Returns:
        Median distances to the nearest sample of zz35 [-].
    """
    known = scaled_motion(of, of.references["zz35"])
    apart = {}
    for name in ("zz20", "tc25"):
        other = scaled_motion(of, of.references[name])
        apart[name] = float(np.median(np.linalg.norm(other[:, None] - known[None], axis=-1).min(axis=1)))
    return {"apart": apart, "least_apart": min(apart.values())}


def scaled_motion(of: ThesisShip, run: Recording) -> np.ndarray:
    """u/U0, v/U0 and rL/U0 of a run.

    Args:
        of: The ship.
        run: The run.

    Returns:
        Samples (n, 3).
    """
    p = of.ship.particulars
    return run.stacked("u", "v", "r") * [1 / p.speed, 1 / p.speed, p.length / p.speed]


def generalization_values(flights: Mapping[str, Flown], good: float) -> dict[str, Any]:
    """The thesis' zz20 and tc25, and tc10 beside them; and whether a good fit of zz35 means a good prediction of tc25.

    Args:
        flights: Networks in closed loop.
        good: Deviation up to which a prediction is called good [L].

    Returns:
        What :func:`loop_values` gives, with the share of the starts that are good, and all starts of
        Levenberg-Marquardt in one.
    """
    found = loop_values(flights)
    for item in found["flown"]:
        item["good_share"] = {name: float(np.mean(np.array(dev) <= good)) for name, dev in item["devs"].items()}
    several = [flights[k] for k in STARTS]
    error = np.concatenate([f.networks.errors.max(1) for f in several])
    dev = np.concatenate([f.dev["tc25"] for f in several])
    together = {"least_error": error.min(), "largest_error": error.max(), "least": dev.min(), "largest": dev.max()}
    return found | {"marquardt": together | {"good_share": float(np.mean(dev <= good)), "starts": len(dev)}}


def spiral_values(of: ThesisShip, flights: Mapping[str, Flown]) -> dict[str, Any]:
    """Figure 5.12: errors of the spiral's yaw rates, medians over the starts, and the height of its loop.

    Args:
        of: The ship.
        flights: Networks in closed loop.

    Returns:
        Errors [deg/s] of the networks that are shown, and the loop.
    """
    rudder, rate = spiral_points(of.references["spiral20"])
    height, spirals = loop(rudder, rate)[0], []
    for key in SHOWN:
        points = [spiral_points(run)[1] for run in flights[key].runs["spiral20"] if run.status == "ok"]
        off = np.median([np.abs(p - rate).max() for p in points]) if points else np.inf
        spirals.append({"label": flights[key].networks.label, "error": float(off)})
    return {"spirals": spirals, "loop": height, "half_loop": height / 2}


def spiral_rows(of: ThesisShip, flights: Mapping[str, Flown]) -> list[dict[str, object]]:
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
    rows: list[dict[str, object]] = []
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


def plots(of: ThesisShip, shown: Sequence[Flown]) -> list[Plot]:
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
