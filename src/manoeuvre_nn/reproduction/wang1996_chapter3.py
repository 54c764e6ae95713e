"""Wang 1996, chapter 3: the Mariner's zigzags, turning circle and spiral."""

from collections.abc import Callable, Mapping

import numpy as np
import torch
from jaxtyping import Float

from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.manoeuvre.criteria import criteria
from manoeuvre_nn.manoeuvre.spiral import spiral
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.reproduction.section import Claim, Effort, Line, Panel, Plot, Say, Section, compared
from manoeuvre_nn.reproduction.wang1996_curves import panels
from manoeuvre_nn.reproduction.wang1996_networks import spiral_points
from manoeuvre_nn.ship.mariner import mariner, mariner_corrected
from manoeuvre_nn.ship.taylor import Coefficients, TaylorShip

PARTICULARS = {"length": 152.4, "beam": 21.763, "draught": 8.138, "block": 0.600, "speed": 7.614, "rudder_rate": 2.5}
"""Table 3.1 as printed: m, m, m, -, m/s, deg/s."""
COEFFICIENTS = {
    "X": {"u": -0.02530, "uu": 0.01896, "uuu": -0.01302, "vv": -0.37800, "rr": 0.01272, "dd": -0.04000}
    | {"vr": 0.16800, "vd": 0.01960},
    "Y": {"v": -0.24400, "vvv": -10.2120, "vdd": -0.00160, "r": -0.10500, "rvv": 6.46000, "d": 0.05860}
    | {"ddd": -0.05850, "dvv": 0.50000, "0": -0.00080},
    "N": {"v": -0.05550, "vvv": 2.07000, "vdd": 0.00528, "r": -0.03747, "rvv": -2.31600, "d": -0.02930}
    | {"ddd": 0.02892, "dvv": 0.20640, "0": 0.00059},
}
"""Table 3.2 as printed, without what is 0 there and without the inertia."""
INERTIA = {"m - X_udot": (0.177, 0, 0), "m - Y_vdot": (0.327, 1, 1), "I_z - N_rdot": (0.0175, 2, 2)}
INERTIA |= {"N_vdot": (0.00221, 2, 1), "Y_rdot": (-0.00077, 1, 2)}
SLOW = "spiral5_600s"
"""A spiral with holds ten times as long."""
LOST = "drawn in the thesis without numbers, and the drawing is lost in the scan: the numbers are ours"


def chapter(effort: Effort, say: Say) -> Section:
    """Simulate what chapter 3 simulates.

    Args:
        effort: How much computing.
        say: Told what is being done.

    Returns:
        Tables 3.1 and 3.2, Figures 3.2-3.12.

    Source:
        Wang 1996, chapter 3.
    """
    say("chapter 3: the Mariner's zigzags, turns and spirals")
    ships = {"mariner": mariner(), "mariner_corrected": mariner_corrected()}
    runs = {name: trials(ship) for name, ship in ships.items()}
    say("chapter 3: what the time step does")
    steps = step_rows(ships["mariner"], 150.0 if effort.quick else 360.0)
    first = runs["mariner"]
    return Section(
        title="Chapter 3: numerical simulation of ship motions",
        summary="All manoeuvres are simulated again. The spiral's loop is the lag of 60-s holds: with 600-s holds it "
        "is gone, and the linear terms say that the ship is straight-line stable.",
        claims=[*table_claims(ships["mariner"]), *figure_claims(first), *spiral_claims(ships["mariner"], first)],
        tables={
            "Criteria (crossings located; N_dvv as printed and with the physical sign)": criteria_rows(runs),
            "What the time step does to zz35": steps,
        },
        plots=plots(first),
    )


def trials(ship: TaylorShip) -> dict[str, Recording]:
    """Every manoeuvre of the chapter, and a spiral with holds ten times as long.

    Args:
        ship: The ship.

    Returns:
        Name -> run.
    """
    zigzags, turns = [zigzag(angle) for angle in (20.0, 35.0, 15.0)], [turning_circle(25.0), turning_circle(35.0)]
    batches = (
        zigzags,
        turns,
        [spiral()],
        [spiral(5.0, hold=600.0, name=SLOW)],
    )  # of like length: a batch is as long as its longest
    return {run.name: run for batch in batches for run in roll_out(CalmWater(ship), batch, step=1.0)}


def table_claims(ship: TaylorShip) -> list[Claim]:
    """Tables 3.1 and 3.2 beside the ship that is simulated.

    Args:
        ship: The ship.

    Returns:
        One claim a number.
    """
    return ship_claims(ship, ("Table 3.1", PARTICULARS), ("Table 3.2", COEFFICIENTS), INERTIA)


def ship_claims(
    ship: TaylorShip,
    particulars: tuple[str, Mapping[str, float]],
    coefficients: tuple[str, Coefficients],
    inertia: Mapping[str, tuple[float, int, int]],
) -> list[Claim]:
    """Printed tables of a ship beside the one that is simulated.

    Args:
        ship: The ship.
        particulars: Table, and its main dimensions (rudder rate in deg/s).
        coefficients: Table, and its coefficients by equation and term.
        inertia: What the same table says of the left-hand sides -> value, row and column of M'.

    Returns:
        One claim a number.
    """
    (first, sizes), (second, printed) = particulars, coefficients
    ours = {k: getattr(ship.particulars, k) / (DEGREE if k == "rudder_rate" else 1.0) for k in sizes}
    claims = [compared(first, k, value, ours[k], within=1e-9) for k, value in sizes.items()]
    for equation, values in printed.items():
        for term, value in values.items():
            what = f"{equation}_{term}" + (" - m" if equation + term == "Yr" else " + m" if term == "vr" else "")
            claims.append(compared(second, what, value, ship.coefficients[equation].get(term, 0.0), within=1e-9))
    for what, (value, i, j) in inertia.items():
        entry = float(ship.inertia[i, j])
        claims.append(compared(second, what, value, entry if i == j else -entry, within=1e-9))
    return claims


def figure_claims(runs: dict[str, Recording]) -> list[Claim]:
    """What can be read off Figures 3.2-3.11.

    Args:
        runs: Runs of the ship as printed.

    Returns:
        Claims that have no printed number beside them.
    """
    claims = []
    for name, figures in (("zz20", "Figs 3.2-3.5, 3.7"), ("zz35", "Figs 3.2-3.6")):
        found = read(runs[name])
        ours = f"overshoots {found['overshoot_1_deg']:.1f} and {found['overshoot_2_deg']:.1f} deg, period "
        ours += f"{found['period_s']:.0f} s"
        claims.append(Claim(figures, f"{name}: overshoots and period", "drawn", ours, "not comparable", LOST))
    found = read(runs["tc25"])
    ours = f"advance {found['advance_L']:.2f}, transfer {found['transfer_L']:.2f}, tactical diameter "
    ours += f"{found['tactical_diameter_L']:.2f}, steady diameter {found['steady_diameter_L']:.2f} L"
    claims.append(Claim("Figs 3.8-3.11", "25-deg turn to starboard", "drawn", ours, "not comparable", LOST))
    return claims


def spiral_claims(ship: TaylorShip, runs: dict[str, Recording]) -> list[Claim]:
    """Whether the loop of Figure 3.12 means instability.

    Args:
        ship: The ship.
        runs: Its runs.

    Returns:
        The loop, its cause and the linear criterion.
    """
    rudder, rate = spiral_points(runs["spiral20"])
    height, width = loop(rudder, rate)
    slow = read(runs[SLOW])
    c = ship.coefficients
    margin = c["Y"]["v"] * c["N"]["r"] - c["N"]["v"] * c["Y"]["r"]
    drawn = Claim(
        "Fig 3.12", "a loop with 60-s holds", "a sloped loop", f"{height:.3f} deg/s high, {width:.2f} deg wide", "holds"
    )
    why = (
        f"the loop is lag: with 600-s holds {slow['loop_height_deg_s']:.4f} deg/s are left, Y_v N_r - N_v (Y_r - m) = "
        f"{margin:+.4f} > 0 means straight-line stability; neutral rudder "
        f"{-slow['neutral_rudder_deg']:+.2f} deg (to port)"
    )
    stable = Claim(
        "Section 3.5",
        "the loop's meaning",
        "slight directional instability",
        "straight-line stable",
        "does not hold",
        why,
    )
    return [drawn, stable]


def loop(rudder: Float[np.ndarray, " n"], rate: Float[np.ndarray, " n"]) -> tuple[float, float]:
    """Height of a spiral's loop at rudder amidships and its width at zero yaw rate.

    Args:
        rudder: Rudder angle of each hold [deg].
        rate: Yaw rate at its end [deg/s].

    Returns:
        Height [deg/s] and width [deg].
    """
    middle = len(rudder) // 2
    there, back = slice(middle, None, -1), slice(middle, None)

    def crossing(at: np.ndarray, values: np.ndarray) -> float:
        order = np.argsort(at)
        return float(np.interp(0.0, at[order], values[order]))

    height = crossing(rudder[there], rate[there]) - crossing(rudder[back], rate[back])
    return abs(height), abs(crossing(rate[there], rudder[there]) - crossing(rate[back], rudder[back]))


def read(run: Recording) -> dict[str, float]:
    """Criteria of a run of the Mariner.

    Args:
        run: The run.

    Returns:
        Name with unit -> value.
    """
    return criteria(run, run.meta["kind"], PARTICULARS["length"])


def criteria_rows(runs: dict[str, dict[str, Recording]]) -> list[dict[str, object]]:
    """Criteria of both ships.

    Args:
        runs: Name of the ship -> its runs.

    Returns:
        One row a manoeuvre and criterion.
    """
    rows: list[dict[str, object]] = []
    for name, run in runs["mariner"].items():
        other = read(runs["mariner_corrected"][name])
        rows += [
            {"manoeuvre": name, "criterion": k, "mariner": f"{v:.4g}", "mariner_corrected": f"{other[k]:.4g}"}
            for k, v in read(run).items()
            if k in other and not k.startswith(("overshoot_3", "overshoot_4", "overshoot_5", "reversals"))
        ]
    return rows


def step_rows(ship: TaylorShip, duration: float) -> list[dict[str, object]]:
    """How far zz35 goes astray with coarse steps, with the crossings located and without.

    Args:
        ship: The ship.
        duration: Length of the trial [s].

    Returns:
        One row a way to integrate.
    """
    trial = zigzag(35.0, duration=duration)
    located = {dt: roll_out(CalmWater(ship), [trial], step=dt)[0] for dt in (0.1, 1.0)}
    exact, length = located[0.1], ship.particulars.length

    def dev(x: Float[np.ndarray, " n"], y: Float[np.ndarray, " n"]) -> str:
        return f"{np.hypot(x - exact['x'], y - exact['y']).max() / length:.2g}"

    rows: list[dict[str, object]] = [
        {
            "way": "Runge-Kutta, heading crossing located",
            "step [s]": 1.0,
            "dev [L]": dev(located[1.0]["x"], located[1.0]["y"]),
        }
    ]
    for dt in (1.0, 0.1):
        x, y = stepwise_zigzag(ship, 35.0, duration, dt)
        every = round(1.0 / dt)
        rows.append({
            "way": "Runge-Kutta, reversed at the next step",
            "step [s]": dt,
            "dev [L]": dev(x[::every], y[::every]),
        })
    return rows


def stepwise_zigzag(
    ship: TaylorShip, angle_deg: float, duration: float, step: float
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """The thesis' own way: plain Runge-Kutta steps, the rudder reversed at the first step past the heading.

    Args:
        ship: The ship.
        angle_deg: Rudder and heading [deg].
        duration: Length of the trial [s].
        step: Time step [s].

    Returns:
        Track x, y [m] at every step.

    Source:
        Wang 1996, sections 3.2 and 3.3, eqs 3.15-3.17.
    """
    dynamics, order, reach = CalmWater(ship), angle_deg * DEGREE, ship.particulars.rudder_rate * step
    state, rudder, side = torch.zeros(6, dtype=torch.float64), 0.0, 1
    state[0] = ship.particulars.speed
    states = [state]
    rate: Callable = torch.inference_mode()(lambda at, angle: dynamics(at, state.new_tensor(angle)))
    for _ in range(round(duration / step)):
        side = -side if side * float(state[5]) >= order else side
        later = rudder + float(np.clip(side * order - rudder, -reach, reach))
        half = 0.5 * (rudder + later)
        k1 = rate(state, rudder)
        k2 = rate(state + 0.5 * step * k1, half)
        k3 = rate(state + 0.5 * step * k2, half)
        state = state + step / 6 * (k1 + 2 * k2 + 2 * k3 + rate(state + step * k3, later))
        rudder = later
        states.append(state)
    track = torch.stack(states)[:, 3:5].numpy()
    return track[:, 0], track[:, 1]


def plots(runs: dict[str, Recording]) -> list[Plot]:
    """Figures 3.2-3.12.

    Args:
        runs: Runs of the ship as printed.

    Returns:
        Four plots.
    """
    both = {"20-20 deg": runs["zz20"], "35-35 deg": runs["zz35"]}
    zigzags = panels(both, PARTICULARS["length"], ("u", "v", "r", "track"))
    steering = [
        Panel(
            "t [s]",
            "deg",
            [Line(k, run.time, run[c] / DEGREE) for k, c in (("heading", "psi"), ("rudder", "delta"))],
            n,
        )
        for n, run in reversed(both.items())
    ]
    turn = panels({"25 deg to starboard": runs["tc25"]}, PARTICULARS["length"], ("u", "v", "r", "track"))
    rudder, rate = spiral_points(runs["spiral20"])
    slow, slow_rate = spiral_points(runs[SLOW])
    slow, slow_rate = slow[9::10], slow_rate[9::10]
    lines = [Line("60-s holds", rudder, rate), Line("600-s holds", slow, slow_rate, "other", points=True)]
    return [
        Plot("figure_3_2_to_3_5", "Figs 3.2-3.5: the 20-20 and the 35-35 deg zigzag.", zigzags),
        Plot("figure_3_6_to_3_7", "Figs 3.6 and 3.7: heading and rudder, positive to starboard.", steering),
        Plot("figure_3_8_to_3_11", "Figs 3.8-3.11: the 25-deg turn to starboard.", turn),
        Plot("figure_3_12", "Fig 3.12: yaw rate over rudder angle, positive to starboard; longer holds close the loop.",
             [Panel("rudder [deg]", "yaw rate [deg/s]", lines)]),
    ]  # fmt: skip
