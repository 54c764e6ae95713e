"""Rajesh & Bhattacharyya 2009, section 5.1: Table 1 with its misprints, the training manoeuvre, the ship's figures."""

from typing import Any

import numpy as np
import torch
from scipy.optimize import brentq, fsolve

from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE, KNOT, RPM
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.manoeuvre.criteria import criteria, reversal_times, trace
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.ship.esso_190k import COEFFICIENTS, PARTICULARS, RPM_SERVICE, VOLUME, esso_190k
from manoeuvre_nn.ship.tanker import TankerShip
from studies.rajesh2009.networks import LENGTH, track
from studies.reproduction.claims import read_claims
from studies.reproduction.section import ChapterResult, ComputingEffort, Line, Panel, Plot, Say

# Rajesh & Bhattacharyya 2009, Table 1: label as printed -> our name; in the order of the page.
TABLE_1 = {
    "1 - X_udot": "m11", "X_uu": "Xuu", "1 + X_vr": "Xvr", "X_vv": "Xvv", "X_ccdd": "Xccdd", "X_ccbd": "Xccbd",
    "X_udot zeta": "Xudz", "X_uu zeta": "Xuuz", "X_vr zeta": "Xvrz", "X_vv zeta": "Xvvzz", "1 - Y_vdot": "m22",
    "Y_ur - 1": "Yur", "Y_uv": "Yuv", "Y_v|v|": "Yvv", "Y_ccd": "Yccd", "Y_cc|b|b|d|": "Yccbbd", "Y_rdot": "YT",
    "Y_v zeta": "Yvdz", "Y_ur zeta": "Yurz", "Y_v|v| zeta": "Yvvz", "Y_cc|b|b|d| zeta": "Yccbbdz",
    "k_z^2 - N_rdot": "m33", "N_ur - x_G": "Nur", "N_uv": "Nuv", "N_|v|r": "Nvr", "N_ccd": "Nccd",
    "N_cc|b|b|d|": "Nccbbd", "N_rdot": "NT", "N_rdot zeta": "Nrdz", "N_ur zeta": "Nurz", "N_uv zeta": "Nuvz",
    "N_|v|r zeta": "Nvrz", "N_cc|b|b|d| zeta": "Nccbbdz", "T_uu": "Tuu", "T_un": "Tun", "T_|n|n": "Tnn", "t": "t",
    "c_un": "cun", "c_nn": "cnn",
}  # fmt: skip
DEPTHS = (2.0, 1.5, 1.2)
"""Depth over draught."""


def chapter(effort: ComputingEffort, say: Say) -> ChapterResult:
    """Section 5.1.

    Args:
        effort: How much computing is allowed; all of it is simulation.
        say: Told what is being done.

    Returns:
        Table 1, Fig. 2, and the key figures of the ship in deep and shallow water.
    """
    del effort
    claims = read_claims("rajesh2009", "5.1")
    say("Table 1 and the straight course")
    ship = esso_190k()
    found = table_values() | straight_values(ship)
    say("zigzag and turning circles")
    trials = [zigzag(20.0, duration=2000.0), *(turning_circle(a) for a in (15.0, 20.0, 25.0))]
    deep = roll_out(CalmWater(ship), trials)
    found |= _zigzag_values(deep[0])
    say("shallow water")
    shallow = {ratio: roll_out(CalmWater(_at(ratio)), [trials[0], trials[2]]) for ratio in DEPTHS}
    depths = {"deep": ship} | {f"{ratio:g}": _at(ratio) for ratio in DEPTHS}
    runs = {"deep": [deep[0], deep[2]]} | {f"{ratio:g}": pair for ratio, pair in shallow.items()}
    water = [_in_water(name, depths[name], *runs[name]) for name in depths]
    tables: dict[str, list[dict]] = {
        "Turning circles to starboard, 16 kn": [_turn(run) for run in deep[1:]],
        "zz20, 16 kn, first rudder to starboard": [criteria(deep[0], "zigzag", LENGTH)],
        "Straight course at 80 rpm": [_straight_row(ship)],
        "Water depth over draught": water,
    }
    tracks = [Panel("y [L]", "x [L]", [track(runs[n][1], f"h/d = {n}", "other") for n in runs], "tc20", equal=True)]
    caption = "tc20 in deep and shallow water; the paper shows deep water only"
    return ChapterResult(
        "Section 5.1: the tanker, Table 1 and Fig. 2",
        "All printed numbers of Table 1 are the well-known ones under three wrong labels. With n in rev/s, not rpm, 80 "
        "rpm keep up 16 kn; the ship is course-unstable, and shallow water makes it stable.",
        claims.beside(found),
        tables,
        [_figure_2(deep[0].between(0.0, 1500.0)), Plot("shallow_turns", caption, tracks)],
    )


def _at(ratio: float) -> TankerShip:
    return esso_190k(ratio * PARTICULARS.draught)


def table_values() -> dict[str, Any]:
    """Every number of Table 1 by its printed label, main dimensions and counts.

    Returns:
        Quantities by name.
    """
    p, zetas = PARTICULARS, (0.5, 1.0, 2.0)
    table = {label: COEFFICIENTS[name] for label, name in TABLE_1.items()}
    table |= {f"Y_uv zeta at zeta = {zeta:g}": _stretched(zeta) for zeta in zetas}
    sizes = {"L": p.length, "B": p.beam, "draught": p.draught, "C_B": p.block, "volume": VOLUME}
    sizes |= {"speed": p.speed / KNOT, "rudder rate": p.rudder_rate / DEGREE, "n": RPM_SERVICE}
    forces = [name for name in TABLE_1.values() if name[0] in "XYNm"]
    known = sum(name in {"m11", "m22", "m33", "Xudz", "Yvdz", "Nrdz"} for name in forces)
    counted = len(forces) + 1  # and Y_uv zeta, which is a formula
    block = VOLUME / (p.length * p.beam * p.draught)
    return {"table": table, "sizes": sizes, "derivatives": counted, "unknown": counted - known, "block": block}


def _stretched(zeta: float) -> float:
    """Y_uv zeta, which Table 1 gives in two pieces."""
    ship = _at(1.0 + 1.0 / zeta)
    return (float(ship.table[ship.terms.index("uv"), 1]) * ship.prime.speed**2 - COEFFICIENTS["Yuv"]) / zeta


def _straight(ship: TankerShip) -> tuple[float, float, float]:
    """Speed, sway [m/s] and rudder [rad] of the straight course."""

    def error(x: np.ndarray) -> np.ndarray:
        nu, delta = torch.tensor([x[0], x[1], 0.0], dtype=torch.float64), torch.tensor(x[2], dtype=torch.float64)
        return ship.acceleration(nu, delta).numpy() * [1.0, 1.0, LENGTH]

    u, v, rudder = fsolve(error, [PARTICULARS.speed, 0.0, 0.0], xtol=1e-12)
    return float(u), float(v), float(rudder)


def _growth(ship: TankerShip) -> float:
    """Largest real part of the eigenvalues of sway and yaw about the straight course [1/s]."""
    u, v, rudder = _straight(ship)

    def rate(x: torch.Tensor) -> torch.Tensor:
        return ship.acceleration(torch.cat([x.new_tensor([u]), x]), x.new_tensor(rudder))[1:]

    jacobian = torch.autograd.functional.jacobian(rate, torch.tensor([v, 0.0], dtype=torch.float64))
    return float(torch.linalg.eigvals(jacobian).real.max())


def self_propulsion(ship: TankerShip, highest: float) -> float:
    """Speed that the ship's shaft keeps up with the rudder amidships.

    Args:
        ship: The ship.
        highest: Speed that it is below [m/s].

    Returns:
        Speed [m/s].
    """

    def surge(u: float) -> float:
        nu = torch.tensor([u, 0.0, 0.0], dtype=torch.float64)
        return float(ship.acceleration(nu, torch.zeros((), dtype=torch.float64))[0])

    return float(brentq(surge, 1e-3 * highest, highest))


def straight_values(ship: TankerShip) -> dict[str, float]:
    """What 80 rpm keep up, in both readings of n.

    Args:
        ship: The ship.

    Returns:
        Speeds [kn].
    """
    return {
        "speed_with_rpm": self_propulsion(esso_190k(rpm=RPM_SERVICE / RPM), 1200.0) / KNOT,
        "speed_with_rev_s": self_propulsion(ship, 20.0) / KNOT,
    }


def _zigzag_values(run: Recording) -> dict[str, float]:
    """How often the rudder is reversed in the training manoeuvre."""
    seen = trace(run)
    assert seen is not None
    times, _ = reversal_times(seen)
    early = float(sum(t < 1500.0 for t in times))
    cycles = 0.5 * (len(times) - 1) + 0.5 * (2000.0 - times[-1]) / (times[-1] - times[-2])
    return {"reversals": early, "executes": early + 1, "early_cycles": 0.5 * early, "cycles": float(cycles)}


def _straight_row(ship: TankerShip) -> dict[str, float]:
    u, v, rudder = _straight(ship)
    cells = {"u [kn]": u / KNOT, "v [m/s]": v, "rudder to starboard [deg]": rudder / DEGREE}
    return cells | {"growth of a disturbance [1/s]": _growth(ship)}


def _turn(run: Recording) -> dict[str, float | str]:
    found = criteria(run, "turning_circle", LENGTH)
    names = ("advance_L", "transfer_L", "tactical_diameter_L", "steady_u_m_s", "steady_r_deg_s", "steady_drift_deg")
    return {"trial": run.name} | {name: found[name] for name in names}


def _in_water(name: str, ship: TankerShip, zz: Recording, tc: Recording) -> dict[str, float | str]:
    """The ship's figures at a depth."""
    overshoot = criteria(zz, "zigzag", LENGTH)["overshoot_1_deg"]
    turn = criteria(tc, "turning_circle", LENGTH)
    cells: dict[str, float | str] = {
        "h/d": name,
        "growth [1/s]": _growth(ship),
        "zz20 first overshoot [deg]": overshoot,
    }
    return cells | {f"tc20 {k}": turn.get(k, float("nan")) for k in ("advance_L", "transfer_L", "tactical_diameter_L")}


def _figure_2(run: Recording) -> Plot:
    """Track, heading and rudder of the training manoeuvre."""
    time, psi, delta = run.time, run["psi"] / DEGREE, run["delta"] / DEGREE
    lines = [Line("heading", time, psi, "reference"), Line("rudder", time, delta, "other")]
    path = Panel("y [L]", "x [L]", [track(run, "", "reference")], "track", equal=True)
    caption = "Fig. 2: zz20 at 16 kn, first rudder to starboard (to port in the paper)"
    return Plot("figure_2", caption, [path, Panel("time [s]", "angle [deg]", lines, "heading and rudder")])
