"""What a zigzag costs in a batch, beside shipmmg: CPU time of one thread, 20/20, 600 s, a sample a second.

    python benchmarks/rollouts.py [batch=1,10,100,1000,10000]

The Mariner sails all zigzags of a batch in one call of ``roll_out``, recordings included. Their heading limits are
spread over 20 +- 2 deg and their first sides alternate, so that rows reverse their rudders at times of their own, as in
any real batch: equal rows would be cheaper. shipmmg (``pip install --no-deps shipmmg``; it uses numpy and scipy, and
matplotlib on import) sails one zigzag a call, measured anew beside every batch: three degrees of freedom, its default
solver, the KVLCC2 at the Mariner's length and speed. It solves the rest of the run anew after every reversal, so that
its cost grows with their number: hence three shaft speeds, self-propulsion, that of its documentation, at which the
ship gathers way, and between them the first at which it reverses as often as the Mariner does, which is the fair one.
Of repeated measurements the least counts.
"""

import sys
import time
from collections.abc import Callable
from functools import partial

import numpy as np
import torch

from manoeuvre_nn.core.manoeuvre import Manoeuvre
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.ship.mariner import mariner

try:
    from shipmmg import mmg_3dof
except ImportError:
    mmg_3dof = None

ANGLE, DURATION, SPREAD = 20.0, 600.0, 2.0
SIZES = "1,10,100,1000,10000"
WANTED = {1: 10.0, 1000: 1 / 50}
"""Largest cost per manoeuvre over shipmmg's that is wanted, by batch size."""

# KVLCC2, 7-m model: Yasukawa & Yoshimura 2015 (doi 10.1007/s00773-014-0293-y), as in shipmmg's documentation. Lengths
# are over L, areas over L^2, masses and moments over 0.5 rho L^2 d and 0.5 rho L^4 d.
L7, BEAM, DRAUGHT, VOLUME, PROPELLER, RUDDER_AREA, RUDDER_SPAN = 7.0, 1.27, 0.46, 3.27, 0.216, 0.0539, 0.345
MODEL_SPEED, MODEL_SHAFT = 1.172, 20.338
BARE = {"f_α": 2.747, "ε": 1.09, "t_R": 0.387, "a_H": 0.312, "γ_R_minus": 0.395, "γ_R_plus": 0.640, "l_R": -0.710}
BARE |= {"κ": 0.50, "t_P": 0.220, "w_P0": 0.40, "x_P": -0.650, "η": PROPELLER / RUDDER_SPAN}
HULL = {"k_0": 0.2931, "k_1": -0.2753, "k_2": -0.1385, "R_0_dash": 0.022}
HULL |= {"X_vv_dash": -0.040, "X_vr_dash": 0.002, "X_rr_dash": 0.011, "X_vvvv_dash": 0.771}
HULL |= {"Y_v_dash": -0.315, "Y_r_dash": 0.083, "Y_vvv_dash": -1.607, "Y_vvr_dash": 0.379, "Y_vrr_dash": -0.391}
HULL |= {"Y_rrr_dash": 0.008, "N_v_dash": -0.137, "N_r_dash": -0.049, "N_vvv_dash": -0.030, "N_vvr_dash": -0.294}
HULL |= {"N_vrr_dash": 0.055, "N_rrr_dash": -0.013}


def trials(count: int) -> list[Manoeuvre]:
    """The zigzags of a batch.

    Args:
        count: How many.

    Returns:
        Manoeuvres whose heading limits lie evenly in 20 +- 2 deg.
    """
    headings = ANGLE + SPREAD * (2 * (np.arange(count) + 0.5) / count - 1)
    sides = ("starboard", "port")
    return [zigzag(ANGLE, float(h), first=sides[k % 2], duration=DURATION) for k, h in enumerate(headings)]


def peer(ship: Particulars, shaft: float | None = None) -> Callable[[], tuple[list[float], ...]]:
    """One zigzag by shipmmg.

    Args:
        ship: The ship whose length, speed and rudder rate it takes.
        shaft: Shaft speed of the 7-m model [1/s] at the speed of its documentation; None is self-propulsion.

    Returns:
        A call that sails it; its first result is the rudder angle over time [rad].
    """
    length, scale, rho = ship.length, ship.length / L7, ship.rho
    draught, mass = DRAUGHT * scale, rho * VOLUME * scale**3
    added = 0.5 * rho * length**2 * draught
    sizes = {"L_pp": length, "B": BEAM * scale, "d": draught, "x_G": 0.25 * scale, "D_p": PROPELLER * scale}
    sizes |= {"A_R": RUDDER_AREA * scale**2, "x_R": -0.5 * length, "x_H": -0.464 * length}
    sizes |= {"m": mass, "I_zG": mass * (0.25 * length) ** 2, "m_x": 0.022 * added, "m_y": 0.223 * added}
    sizes |= {"J_z": 0.011 * added * length**2}
    hull, times = mmg_3dof.Mmg3DofManeuveringParams(**HULL), np.arange(0.0, DURATION + 0.5)
    turns = _self_propulsion(ship.speed, scale) if shaft is None else shaft * ship.speed / (MODEL_SPEED * scale)
    limit = ANGLE * DEGREE
    call = partial(mmg_3dof.zigzag_test_mmg_3dof, mmg_3dof.Mmg3DofBasicParams(**sizes, **BARE), hull, limit, limit)
    return partial(call, times, np.full(len(times), turns), δ_rad_rate=ship.rudder_rate, u0=ship.speed)


def as_often(ship: Particulars, reversals: int) -> float:
    """Shaft speed of the 7-m model at which shipmmg's ship reverses its rudder as often as another.

    Args:
        ship: The ship whose length and speed it takes.
        reversals: Of the other's rudder.

    Returns:
        The least of some between self-propulsion and that of its documentation [1/s].

    Raises:
        ValueError: If there is none.
    """
    scale = ship.length / L7
    least = _self_propulsion(ship.speed, scale) * MODEL_SPEED * scale / ship.speed
    for shaft in np.linspace(least, MODEL_SHAFT, 17):
        if executes(np.array(peer(ship, float(shaft))()[0])) == reversals:
            return float(shaft)
    raise ValueError(f"shipmmg's ship reverses {reversals} times at no shaft speed that was tried")


def _self_propulsion(speed: float, scale: float) -> float:
    """Shaft speed [1/s] at which thrust is the resistance: a quadratic equation of the advance ratio."""
    inflow, loss = speed * (1 - BARE["w_P0"]), 1 - BARE["t_P"]
    drag = HULL["R_0_dash"] * 0.5 * L7 * DRAUGHT / (loss * PROPELLER**2 * (1 - BARE["w_P0"]) ** 2)
    advance = max(np.roots([HULL["k_2"] - drag, HULL["k_1"], HULL["k_0"]]).real)
    return float(inflow / (advance * PROPELLER * scale))


def cost(call: Callable[[], object], repeats: int) -> float:
    """CPU time of a call.

    Args:
        call: What is measured.
        repeats: How often.

    Returns:
        The least [s].
    """
    taken = []
    for _ in range(repeats):
        begun = time.process_time()
        call()
        taken.append(time.process_time() - begun)
    return min(taken)


def executes(rudder: np.ndarray) -> int:
    """How often a rudder goes through amidships.

    Args:
        rudder: Its angle over time [rad].

    Returns:
        Number.
    """
    sides = np.sign(rudder)
    sides = sides[sides != 0]
    return int(np.sum(sides[1:] != sides[:-1]))


def apart(coarse: list[Recording], fine: list[Recording]) -> tuple[float, float]:
    """Largest distance between tracks and between headings.

    Args:
        coarse: Runs.
        fine: The same runs by another step.

    Returns:
        Metres and degrees.
    """
    track = max(np.hypot(a["x"] - b["x"], a["y"] - b["y"]).max() for a, b in zip(coarse, fine, strict=True))
    return float(track), max(np.abs(a["psi"] - b["psi"]).max() for a, b in zip(coarse, fine, strict=True)) / DEGREE


def main(arguments: list[str]) -> None:
    """Measure and print.

    Args:
        arguments: ``batch=1,10,...`` or nothing.
    """
    torch.set_num_threads(1)
    given = dict(a.partition("=")[::2] for a in arguments)
    ship = CalmWater(mariner())
    sample, default = 1.0, roll_out(ship, trials(10))
    fine = roll_out(ship, trials(10), step=sample / 2)
    print(
        f"{ANGLE:.0f}/{ANGLE:.0f} zigzags of {DURATION:.0f} s, a sample a second; the {ship.particulars.name},", end=" "
    )
    print(
        f"{executes(default[0]['delta'])} reversals, steps of {sample:g} s; with steps halved the tracks move by",
        end=" ",
    )
    print("{:.1e} m and the headings by {:.1e} deg at most.".format(*apart(default, fine)))
    shafts = {"self-propelled": None, "with the shaft of its documentation": MODEL_SHAFT}
    if mmg_3dof is not None:
        shafts["with a shaft between them"] = as_often(ship.particulars, executes(default[0]["delta"]))
    others = [] if mmg_3dof is None else [peer(ship.particulars, shaft) for shaft in shafts.values()]
    if not others:
        print("shipmmg is not there, so that there is nothing to compare with: pip install --no-deps shipmmg")
    for other, how in zip(others, shafts, strict=False):
        print(
            f"shipmmg: KVLCC2 at that length and speed, {how}, {executes(np.array(other()[0]))} reversals; RK45, 1e-3."
        )
    print(f"\n{'batch':>6}  {'ms each':>9}  {'wanted':>7}" + f"  {'shipmmg ms':>10}  {'ratio':>8}" * len(others))
    for size in map(int, given.get("batch", SIZES).split(",")):
        beside = [cost(other, 10) for other in others]
        each = cost(partial(roll_out, ship, trials(size)), 5 if size <= 1000 else 1) / size
        wanted = f"{WANTED[size]:7.3f}" if size in WANTED else " " * 7
        compared = "".join(f"  {1e3 * b:10.2f}  {each / b:8.4f}" for b in beside)
        print(f"{size:6d}  {1e3 * each:9.3f}  {wanted}{compared}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
