"""Wang 1996, chapter 3: the Mariner's zigzags, turning circle and spiral."""

from collections.abc import Callable

import numpy as np
import torch
from jaxtyping import Float

from manoeuvre_nn.core.inputs import Inputs
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.manoeuvre.criteria import criteria
from manoeuvre_nn.manoeuvre.spiral import spiral
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.ship.mariner import mariner, mariner_corrected
from manoeuvre_nn.ship.taylor import TaylorShip
from studies.reproduction.claims import read_claims
from studies.reproduction.section import ChapterResult, ComputingEffort, Line, Panel, Plot, Say
from studies.wang1996.curves import panels
from studies.wang1996.networks import spiral_points

LENGTH = mariner().particulars.length
SLOW = "spiral5_600s"
"""A spiral with holds ten times as long."""


def chapter(effort: ComputingEffort, say: Say) -> ChapterResult:
    """Simulate what chapter 3 simulates.

    Args:
        effort: How much computing.
        say: Told what is being done.

    Returns:
        Tables 3.1 and 3.2, Figures 3.2-3.12.

    Source:
        Wang 1996, chapter 3.
    """
    claims = read_claims("wang1996", "3")
    say("chapter 3: the Mariner's zigzags, turns and spirals")
    ships = {"mariner": mariner(), "mariner_corrected": mariner_corrected()}
    runs = {name: trials(ship) for name, ship in ships.items()}
    say("chapter 3: what the time step does")
    steps = step_rows(ships["mariner"], 150.0 if effort.quick else 360.0)
    first = runs["mariner"]
    return ChapterResult(
        title="Chapter 3: numerical simulation of ship motions",
        summary="All manoeuvres are simulated again. The spiral's loop is the lag of 60-s holds: with 600-s holds it "
        "is gone, and the linear terms say that the ship is straight-line stable.",
        claims=claims.beside(
            {"table": ship_values(ships["mariner"]), "zz20": read(first["zz20"]), "zz35": read(first["zz35"])}
            | {"tc25": read(first["tc25"])}
            | spiral_values(ships["mariner"], first)
        ),
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


def ship_values(ship: TaylorShip) -> dict[str, float]:
    """What the tables of a ship hold, by the names that the thesis prints.

    Args:
        ship: The ship.

    Returns:
        Main dimensions (rudder rate in deg/s), coefficients and what stands on the left-hand sides.
    """
    p, inertia = ship.particulars, ship.inertia
    values = {name: getattr(p, name) for name in ("length", "beam", "draught", "block", "speed")}
    values |= {"rudder_rate": p.rudder_rate / DEGREE}
    mass = {"Yr": " - m", "Xvr": " + m"}
    for equation, terms in ship.coefficients.items():
        values |= {f"{equation}_{term}{mass.get(equation + term, '')}": value for term, value in terms.items()}
    for row, name in enumerate(("m - X_udot", "m - Y_vdot", "I_z - N_rdot")):
        values[name] = float(inertia[row, row])
    return values | {"N_vdot": -float(inertia[2, 1]), "Y_rdot": -float(inertia[1, 2])}


def spiral_values(ship: TaylorShip, runs: dict[str, Recording]) -> dict[str, float]:
    """Whether the loop of Figure 3.12 means instability.

    Args:
        ship: The ship.
        runs: Its runs.

    Returns:
        Size of the loop, what longer holds leave of it, and the linear criterion Y_v N_r - N_v (Y_r - m).
    """
    height, width = loop(*spiral_points(runs["spiral20"]))
    slow, c = read(runs[SLOW]), ship.coefficients
    return {
        "loop_height": height,
        "loop_width": width,
        "slow_loop_height": slow["loop_height_deg_s"],
        "stability": c["Y"]["v"] * c["N"]["r"] - c["N"]["v"] * c["Y"]["r"],
        "neutral_rudder": -slow["neutral_rudder_deg"],
    }


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
    return criteria(run, run.meta["kind"], LENGTH)


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
    rate: Callable = torch.inference_mode()(lambda at, angle: dynamics(at, Inputs(state.new_tensor(angle))))
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
    zigzags = panels(both, LENGTH, ("u", "v", "r", "track"))
    steering = [
        Panel(
            "t [s]",
            "deg",
            [Line(k, run.time, run[c] / DEGREE) for k, c in (("heading", "psi"), ("rudder", "delta"))],
            n,
        )
        for n, run in reversed(both.items())
    ]
    turn = panels({"25 deg to starboard": runs["tc25"]}, LENGTH, ("u", "v", "r", "track"))
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
