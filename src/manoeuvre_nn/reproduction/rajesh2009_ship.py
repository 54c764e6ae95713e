"""Rajesh & Bhattacharyya 2009, section 5.1: Table 1 with its misprints, the training manoeuvre, the ship's figures."""

import numpy as np
import torch
from scipy.optimize import brentq, fsolve

from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE, KNOT, RPM
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.manoeuvre.criteria import criteria, reversal_times
from manoeuvre_nn.manoeuvre.trace import trace
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.reproduction.rajesh2009_networks import LENGTH, track
from manoeuvre_nn.reproduction.section import Claim, Effort, Line, Panel, Plot, Say, Section, compared
from manoeuvre_nn.ship.esso_190k import COEFFICIENTS, PARTICULARS, RPM_SERVICE, VOLUME, esso_190k
from manoeuvre_nn.ship.tanker import TankerShip

# Rajesh & Bhattacharyya 2009, Table 1: label as printed, value, our name; in the order of the page.
TABLE_1 = [
    ("1 - X_udot", 1.050, "m11"), ("X_uu", -0.0377, "Xuu"), ("1 + X_vr", 2.020, "Xvr"), ("X_vv", 0.300, "Xvv"),
    ("X_ccdd", -0.093, "Xccdd"), ("X_ccbd", 0.152, "Xccbd"), ("X_udot zeta", -0.05, "Xudz"),
    ("X_uu zeta", -0.0061, "Xuuz"), ("X_vr zeta", 0.387, "Xvrz"), ("X_vv zeta", 0.0125, "Xvvzz"),
    ("1 - Y_vdot", 2.020, "m22"), ("Y_ur - 1", -0.752, "Yur"), ("Y_uv", -1.205, "Yuv"), ("Y_v|v|", -2.400, "Yvv"),
    ("Y_ccd", 0.208, "Yccd"), ("Y_cc|b|b|d|", -2.16, "Yccbbd"), ("Y_rdot", 0.04, "YT"), ("Y_v zeta", -0.387, "Yvdz"),
    ("Y_ur zeta", 0.182, "Yurz"), ("Y_v|v| zeta", -1.50, "Yvvz"), ("Y_cc|b|b|d| zeta", -0.191, "Yccbbdz"),
    ("k_z^2 - N_rdot", 0.1232, "m33"), ("N_ur - x_G", -0.231, "Nur"), ("N_uv", -0.451, "Nuv"),
    ("N_|v|r", -0.300, "Nvr"), ("N_ccd", -0.098, "Nccd"), ("N_cc|b|b|d|", 0.688, "Nccbbd"), ("N_rdot", -0.02, "NT"),
    ("N_rdot zeta", -0.0045, "Nrdz"), ("N_ur zeta", -0.047, "Nurz"), ("N_uv zeta", -0.241, "Nuvz"),
    ("N_|v|r zeta", -0.120, "Nvrz"), ("N_cc|b|b|d| zeta", 0.344, "Nccbbdz"), ("T_uu", -0.00695, "Tuu"),
    ("T_un", -0.000630, "Tun"), ("T_|n|n", 0.0000354, "Tnn"), ("t", 0.22, "t"), ("c_un", 0.605, "cun"),
    ("c_nn", 38.2, "cnn"),
]  # fmt: skip
MISPRINTS = {
    "Y_rdot": "a label only: eq 5 has no Y_rdot but a Y_T, for which Table 1 has no value otherwise; read as Y_T",
    "N_rdot": "a label only: N_rdot stands in k_z^2 - N_rdot, and eq 6 has an N_T without a value; read as N_T",
    "Y_v zeta": "a label only: eq 5 has no Y_v zeta but a Y_vdot zeta; read as Y_vdot zeta",
    "X_vv zeta": "used with zeta^2 as in eq 13; eq 4 has zeta",
}
DEPTHS = (2.0, 1.5, 1.2)
"""Depth over draught."""


def chapter(effort: Effort, say: Say) -> Section:
    """Section 5.1.

    Args:
        effort: How much computing is allowed; all of it is simulation.
        say: Told what is being done.

    Returns:
        Table 1, Fig. 2, and the key figures of the ship in deep and shallow water.
    """
    del effort
    say("Table 1 and the straight course")
    ship = esso_190k()
    claims = _table_1() + _straight_claims(ship)
    say("zigzag and turning circles")
    trials = [zigzag(20.0, duration=2000.0), *(turning_circle(a) for a in (15.0, 20.0, 25.0))]
    deep = roll_out(CalmWater(ship), trials)
    claims += _zigzag_claims(deep[0])
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
    return Section(
        "Section 5.1: the tanker, Table 1 and Fig. 2",
        "All printed numbers of Table 1 are the well-known ones under three wrong labels. With n in rev/s, not rpm, 80 "
        "rpm keep up 16 kn; the ship is course-unstable, and shallow water makes it stable.",
        claims,
        tables,
        [_figure_2(deep[0].between(0.0, 1500.0)), Plot("shallow_turns", caption, tracks)],
    )


def _at(ratio: float) -> TankerShip:
    return esso_190k(ratio * PARTICULARS.draught)


def _table_1() -> list[Claim]:
    """Every number of Table 1, main dimensions and counts."""
    claims = []
    for label, value, name in TABLE_1:
        claim = compared("Table 1", label, value, COEFFICIENTS[name], relative=1e-9)
        note = MISPRINTS.get(label, "")
        wrong = label in MISPRINTS and label != "X_vv zeta"
        verdict = "does not hold" if wrong else claim.verdict
        claims.append(Claim("Table 1", label, claim.paper, claim.ours, verdict, note))
    claims += [_stretched(zeta, paper) for zeta, paper in ((0.5, 0.0), (1.0, -0.85 * 0.2), (2.0, -0.85 * 0.6))]
    p = PARTICULARS
    for what, paper, ours, unit in (
        ("L", 304.8, p.length, "m"), ("B", 47.17, p.beam, "m"), ("draught", 18.46, p.draught, "m"),
        ("C_B", 0.83, p.block, ""), ("volume", 220_000.0, VOLUME, "m3"), ("speed", 16.0, p.speed / KNOT, "kn"),
        ("rudder rate", 2.33, p.rudder_rate / DEGREE, "deg/s"), ("n", 80.0, RPM_SERVICE, "rpm"),
    ):  # fmt: skip
        claims.append(compared("Section 5.1", what, paper, ours, relative=1e-9, unit=unit))
    forces = [name for _, _, name in TABLE_1 if name[0] in "XYNm"]
    counted = float(len(forces) + 1)  # and Y_uv zeta, which is a formula
    claims.append(compared("Section 2", "hydrodynamic derivatives", 34.0, counted, within=0.0))
    known = float(sum(name in {"m11", "m22", "m33", "Xudz", "Yvdz", "Nrdz"} for name in forces))
    claims.append(compared("Section 6", "derivatives that are left unknown", 28.0, counted - known, within=0.0))
    block = VOLUME / (p.length * p.beam * p.draught)
    why = f"volume and main dimensions give {block:.3f}; no equation uses it"
    return [*claims, compared("Section 5.1", "C_B from the volume", 0.83, block, within=0.005, why=why)]


def _stretched(zeta: float, paper: float) -> Claim:
    """Y_uv zeta, which Table 1 gives in two pieces."""
    ship = _at(1.0 + 1.0 / zeta)
    ours = (ship.k["Yuv"] - COEFFICIENTS["Yuv"]) / ship.zeta
    return compared("Table 1", f"Y_uv zeta at zeta = {zeta:g}", paper, ours, within=1e-9)


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


def _straight_claims(ship: TankerShip) -> list[Claim]:
    """What 80 rpm keep up, in both readings of n."""
    speed = self_propulsion(ship, 20.0) / KNOT
    as_printed = self_propulsion(esso_190k(rpm=RPM_SERVICE / RPM), 1200.0) / KNOT
    why = "80 put into eqs 7 and 8 as it stands; n must be in rev/s, 1.333"
    return [
        compared(
            "Section 2", "speed at n = 80, n in rpm as printed", 16.0, as_printed, within=0.05, why=why, unit="kn"
        ),
        compared("Section 5.1", "speed at 80 rpm, n in rev/s", 16.0, speed, within=0.05, unit="kn"),
    ]


def _zigzag_claims(run: Recording) -> list[Claim]:
    """How often the rudder is reversed in the training manoeuvre."""
    seen = trace(run)
    assert seen is not None
    times, _ = reversal_times(seen)
    early = float(sum(t < 1500.0 for t in times))
    cycles = 0.5 * (len(times) - 1) + 0.5 * (2000.0 - times[-1]) / (times[-1] - times[-2])
    why = f"{early:g} reversals by 1500 s, {early + 1:g} executes with the first"
    return [
        compared("Section 5.2.2", "rudder executes in 1500 s", 7.0, early, within=0.0, direction=True, why=why),
        compared("Section 5.2.2", "cycles in 1500 s", 4.0, 0.5 * early, within=0.25),
        compared("Section 5.2.2", "cycles in 2000 s", 5.0, cycles, within=0.25),
    ]


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
