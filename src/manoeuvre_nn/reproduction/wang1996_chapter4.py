"""Wang 1996, chapters 2 and 4: the network, its trainings, and the 35-deg zigzag predicted in closed loop."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch

from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.network.perceptron import Activation, Initial
from manoeuvre_nn.optimizer.steepest_descent import RateSchedule
from manoeuvre_nn.recording.tuples import to_tuples
from manoeuvre_nn.reproduction.section import Claim, Effort, Line, Panel, Plot, Say, Section, Verdict, compared
from manoeuvre_nn.reproduction.wang1996_curves import beside, role
from manoeuvre_nn.reproduction.wang1996_networks import Case, Flown, Networks, case, flown, published, spread_row
from manoeuvre_nn.reproduction.wang1996_trainings import (
    BEST_START,
    STARTS,
    Descent,
    backpropagation,
    levenberg_marquardt,
)
from manoeuvre_nn.ship.clarke import clarke_derivatives
from manoeuvre_nn.ship.taylor import TaylorShip

CLARKE = {
    "Table 5.1": {"m - X_udot": 0.17993, "X_u": -0.0253, "X_dd": -0.04008},
    "Table 5.2": {"m - Y_vdot": 0.364741, "Y_rdot": -0.01209, "Y_v": -0.27543, "Y_r - m": -0.1043, "Y_d": 0.06},
    "Table 5.3": {"N_vdot": -0.00796, "I_z - N_rdot": 0.024085, "N_v": -0.10538, "N_r": -0.04602, "N_d": -0.03},
}
"""Clarke columns of Tables 5.1-5.3 as printed; Table 4.1, which held the same, is lost in the scan."""
BOUNDS = 0.02, 0.01, 0.01
"""What the errors of the published g1, g2, g3 may be for the corrected reading to hold [-]."""
G = ("g1", "g2", "g3")


def plans(effort: Effort) -> dict[str, Descent]:
    """The trainings by steepest descent.

    Args:
        effort: Whether they are to be short.

    Returns:
        ``printed``: the thesis' rates for the mean over the samples; ``faster``: larger rates, shaken likewise;
        ``scaled``: inputs and targets scaled, tanh, first weights N(0,.3).
    """
    short = 10 if effort.quick else 1
    own = RateSchedule(iterations=(6_000 // short, 10_000 // short, 60_000 // short))
    faster = RateSchedule((0.02,), (60_000 // short,), 0.05, 70_000 // short, 10_000 // short)
    scaled = RateSchedule((0.1, 0.03, 0.01), (24_000 // short, 8_000 // short, 8_000 // short), 0.0)
    tanh: tuple[Activation, Initial, float] = "tanh", "normal", 0.3
    return {
        "printed": Descent("steepest descent, printed rates", "source", own, 76_000 // short),
        "faster": Descent("steepest descent", "source", faster, 350_000 // short if not effort.quick else 12_000),
        "scaled": Descent("steepest descent, scaled, tanh", "balanced", scaled, 40_000 // short, 0.95, start=tanh),
    }


def chapter(effort: Effort, say: Say) -> Section:
    """Train and judge the networks of chapter 4.

    Args:
        effort: How much computing.
        say: Told what is being done.

    Returns:
        Tables 4.1-4.3, Figures 2.2 and 4.1-4.17.

    Source:
        Wang 1996, chapters 2 and 4.
    """
    of = case("mariner")
    flights = trained_and_flown(of, effort, say, ("zz35",))
    figures = figure_plots(of, flights)
    theirs, ours = (float(np.median(flights[k].dev["zz35"])) for k in ("published", BEST_START))
    return Section(
        title="Chapters 2 and 4: networks for the lumped nonlinear functions",
        summary="Read in the right order, the printed weights are what the thesis says they are (zz35 within "
        f"{theirs:.2g} L). Steepest descent gets there slowly; Levenberg-Marquardt comes within {ours:.1g} L, "
        "median of the starts.",
        claims=[
            *network_claims(),
            *estimate_claims(of.known, CLARKE, "Table 4.1 (lost; columns of Tables 5.1-5.3)"),
            *sample_claims(of),
            *weight_claims(of, "Tables 4.2 and 4.3", BOUNDS),
            *training_claims(flights),
            *loop_claims(flights, "Figs 4.10-4.17", 0.015),
        ],
        tables={"Trainings: medians over the starts, the worst in brackets": [spread_row(f) for f in flights.values()]},
        plots=figures,
    )


def trained_and_flown(of: Case, effort: Effort, say: Say, names: Sequence[str]) -> dict[str, Flown]:
    """Published networks, steepest descent and Levenberg-Marquardt in closed loop.

    Args:
        of: The ship.
        effort: How much computing.
        say: Told what is being done.
        names: Manoeuvres to run.

    Returns:
        ``published``, ``printed``, ``faster``, ``scaled`` and the names of the starts -> runs.
    """
    found = {"published": published(of)}
    for key, plan in plans(effort).items():
        say(f"{of.ship.particulars.name}: {plan.label}, {plan.iterations} iterations")
        found[key] = backpropagation(of.name, plan, effort)
    for start in STARTS:
        say(f"{of.ship.particulars.name}: Levenberg-Marquardt, {start}, {effort.starts} starts")
        found[start] = levenberg_marquardt(of.name, start, effort)  # type: ignore[arg-type]
    say(f"{of.ship.particulars.name}: {', '.join(names)} in closed loop")
    return flown(of, found, names)


def network_claims() -> list[Claim]:
    """Equations 2.18 and 2.19 beside the derivative by differences.

    Returns:
        The misprint.
    """
    m, h = torch.tensor(0.7, dtype=torch.float64), 1e-6
    slope = float((torch.sigmoid(m + h) - torch.sigmoid(m - h)) / (2 * h))
    f = float(torch.sigmoid(m))
    why = f"slip: M(1 - M) stands for f(M)(1 - f(M)), which is {f * (1 - f):.4f} there"
    return [
        compared("Eqs 2.18-2.19", "slope of the sigmoid at M = .7", float(m * (1 - m)), slope, within=1e-6, why=why)
    ]


def estimate_claims(known: TaylorShip, printed: dict[str, dict[str, float]], where: str) -> list[Claim]:
    """Clarke's estimate beside the printed columns.

    Args:
        known: The linear part.
        printed: Table -> name -> value as printed.
        where: Where the claims belong; empty takes the tables' names.

    Returns:
        One claim a number, and eq 4.18 for the rudder drag.
    """
    inertia, c = known.inertia, known.coefficients
    ours: dict[str, Any] = {"m - X_udot": inertia[0, 0], "m - Y_vdot": inertia[1, 1], "I_z - N_rdot": inertia[2, 2]}
    ours |= {"Y_rdot": -inertia[1, 2], "N_vdot": -inertia[2, 1], "X_u": c["X"]["u"], "X_dd": c["X"]["dd"]}
    ours |= {"Y_v": c["Y"]["v"], "Y_r - m": c["Y"]["r"], "Y_d": c["Y"]["d"]}
    ours |= {"N_v": c["N"]["v"], "N_r": c["N"]["r"], "N_d": c["N"]["d"]}
    claims = [
        compared(where or table, f"{name}, Clarke", value, float(ours[name]), within=2e-5)
        for table, values in printed.items()
        for name, value in values.items()
    ]
    drag = -2 * clarke_derivatives(known.particulars)["Yd"]
    used = c["X"]["dd"]
    why = f"the formula gives {drag:.4f}, the table has {used}"
    verdict: Verdict = "holds" if abs(drag - used) < 2e-5 else "does not hold"
    return [*claims, Claim("Eq 4.18", "X_dd = -2 Y_d", used, drag, verdict, why)]


def sample_claims(of: Case) -> list[Claim]:
    """Section 4.4.1 and 4.4.2: what the 35-deg zigzag holds.

    Args:
        of: The ship.

    Returns:
        Claims on the samples.
    """
    x, y = of.tuples.inputs, of.tuples.targets
    share = float((x[:, 3].abs() >= 34 * DEGREE).double().mean())
    small = to_tuples([of.references["zz15"]], of.known).targets
    ratio = y.square().mean(0).sqrt() / small.square().mean(0).sqrt()
    sizes = ", ".join(f"{float(v):.3f}" for v in y.abs().amax(0))
    turning = float(x[:, 2].abs().max())
    why = f"{share:.0%} of the samples are at 34 deg and more: interior angles are hardly seen, see chapter 5"
    strong = ", ".join(f"{float(v):.1f}" for v in ratio)
    return [
        Claim("Section 4.4.1", "one zz35 tells of all rudder angles", "sufficient",
              f"{share:.0%} at >= 34 deg", "does not hold", why),
        Claim("Figs 4.1-4.3", "g in zz35 over g in zz15 (root mean squares)", "larger in zz35", strong,
              "holds" if bool((ratio > 1).all()) else "does not hold"),
        Claim("Section 4.4.2", "size of r'", "between .1 and 1", f"up to {turning:.2f}",
              "holds" if 0.1 < turning < 1 else "does not hold"),
        Claim("Section 4.4.2", "size of g1', g2', g3'", "about .1", f"up to {sizes}", "holds in direction",
              "they are between .01 and .1"),
    ]  # fmt: skip


def weight_claims(of: Case, where: str, bounds: Sequence[float]) -> list[Claim]:
    """The published weights in both readings.

    Args:
        of: The ship.
        where: Tables.
        bounds: Errors of g1, g2, g3 up to which the corrected reading holds [-].

    Returns:
        Two claims for each g.
    """
    good, labelled = published(of).errors[0], published(of, "printed").errors[0]
    mislabelled = (
        "mislabelled: the first 12 rows are B(1..12), the other 55 W(11 x 5) row by row, as appendix B writes its file"
    )
    claims = []
    for name, value, bound, wrong in zip(G, good, bounds, labelled, strict=True):
        fits: Verdict = "holds" if value <= bound else "does not hold"
        claims.append(
            Claim(
                where, f"{name} as labelled, RMSE over spread", "a good fit", float(wrong), "does not hold", mislabelled
            )
        )
        claims.append(Claim(where, f"{name}, corrected reading, RMSE over spread", "a good fit", float(value), fits))
    return claims


def training_claims(flights: dict[str, Flown]) -> list[Claim]:
    """Section 4.4.3: how the training went.

    Args:
        flights: Networks.

    Returns:
        Claims on rates, g1, and what another method does.
    """
    own, faster = flights["printed"].networks, flights["faster"].networks
    best = flights[BEST_START].networks
    assert own.course is not None and faster.course is not None
    marks = sorted(own.course)
    before = own.course[min(marks, key=lambda n: abs(n - own.iterations * 16 / 76))]
    after, last = own.course[marks[-1]], np.median(faster.errors, axis=0)

    def told(values: np.ndarray) -> str:
        return "/".join(f"{v:.2g}" for v in values)

    settled: Verdict = "holds" if after.max() < 0.1 else "does not hold"
    rate = Claim(
        "Section 4.4.3", f"errors before and after the {own.iterations * 60 // 76} iterations at rate 1e-6",
        "quite satisfactory after them", f"{told(before)} -> {told(after)}", settled,
        "an iteration read as one step by the mean of E over the samples: at 1e-6 hardly anything moves then",
    )  # fmt: skip
    slow = Claim(
        "Section 4.4.3", "g1 converges three times as slowly as g2 and g3", "three times",
        f"errors {told(last)} at the same iteration",
        "holds in direction" if last[0] > max(last[1], last[2]) else "does not hold",
        "errors at the same iteration are compared, not iterations to the same error",
    )  # fmt: skip
    total = Claim(
        "Section 4.4.3", "iterations", 6e6, float(faster.iterations), "not comparable",
        f"the thesis took 10 h; here {len(faster.models)} starts side by side with rates of .02 and .05, all samples, "
        f"errors {told(last)} (published {told(flights['published'].networks.errors[0])}); with tanh and scaled, "
        f"{told(np.median(flights['scaled'].networks.errors, axis=0))} in {flights['scaled'].networks.iterations}",
    )  # fmt: skip
    other = Claim(
        "Section 4.4.3", "cost of a good fit", "6 million iterations",
        f"{told(np.median(best.errors, axis=0))} in {best.iterations}",
        "not comparable", "Levenberg-Marquardt, median over the starts",
    )  # fmt: skip
    return [rate, slow, total, other]


def loop_claims(flights: dict[str, Flown], where: str, bound: float) -> list[Claim]:
    """Section 4.5: the training manoeuvre in closed loop.

    Args:
        flights: Networks in closed loop.
        where: Figures.
        bound: Largest deviation of the published networks at which it holds [L].

    Returns:
        One claim for the published networks and one for each training.
    """
    claims = []
    for flight in flights.values():
        dev = float(np.median(flight.dev["zz35"]))
        what = f"zz35 in closed loop, dev, {flight.networks.label}" + (
            ", median" if len(flight.networks.models) > 1 else ""
        )
        why = (
            ""
            if dev <= bound
            else f"errors of g {np.array2string(np.median(flight.networks.errors, axis=0), precision=2)}"
        )
        claims.append(Claim(where, what, "fits", dev, "holds" if dev <= bound else "does not hold", why, "L"))
    return claims


def figure_plots(of: Case, flights: dict[str, Flown]) -> list[Plot]:
    """Figures 2.2 and 4.1-4.17.

    Args:
        of: The ship.
        flights: Networks in closed loop.

    Returns:
        The plots.
    """
    shown = [flights[k] for k in ("published", "faster", BEST_START)]
    runs = {"35-35 deg": of.references["zz35"], "15-15 deg": of.references["zz15"]}
    g = {label: to_tuples([run], of.known) for label, run in runs.items()}
    size = [
        Panel(
            "t [s]", f"{name}' [-]", [Line(label, t.times.numpy(), t.targets[:, k].numpy()) for label, t in g.items()]
        )
        for k, name in enumerate(G)
    ]
    accelerations, motion = ("udot", "vdot", "rdot"), ("u", "v", "r", "psi", "track")
    zigzag = {"figure_4_4_to_4_6": "Figs 4.4-4.6 and 4.15-4.17: accelerations in the 35-35 deg zigzag."}
    return [
        sigmoid_plot(),
        Plot(
            "figure_4_1_to_4_3", "Figs 4.1-4.3: lumped nonlinear functions in the 35-35 and the 15-15 deg zigzag.", size
        ),
        *(beside(of, shown, "zz35", name, caption, accelerations) for name, caption in zigzag.items()),
        target_plot(
            of, [f.networks for f in shown], "figure_4_7_to_4_9", "Figs 4.7-4.9: networks and simulated g over time."
        ),
        course_plot(flights),
        beside(
            of,
            shown,
            "zz35",
            "figure_4_10_to_4_14",
            "Figs 4.10-4.14: the 35-35 deg zigzag predicted in closed loop.",
            motion,
        ),
    ]


def sigmoid_plot() -> Plot:
    """Figure 2.2: one input, one node, one output.

    Returns:
        The plot.
    """
    x = np.linspace(-6, 6, 121)
    lines = [
        Line(f"W = {w:g}, bias {b:g}", x, 1 / (1 + np.exp(-(w * x + b))), "ours" if k == 0 else "other")
        for k, (w, b) in enumerate(((1.0, 0.0), (3.0, 0.0), (1.0, 3.0)))
    ]
    return Plot(
        "figure_2_2",
        "Fig 2.2: the weight stretches the sigmoid, the bias shifts it.",
        [Panel("input", "f(W I + bias)", lines)],
    )


def target_plot(of: Case, networks: Sequence[Networks], name: str, caption: str) -> Plot:
    """Simulated g and networks over time; of many starts the one with the middling error.

    Args:
        of: The ship.
        networks: Networks.
        name: Name of the plot.
        caption: Its caption.

    Returns:
        Three panels.
    """
    tuples, lines = (
        of.tuples,
        {
            k: [Line("simulation", of.tuples.times.numpy(), of.tuples.targets[:, k].numpy(), "reference")]
            for k in range(3)
        },
    )
    for some in networks:
        middle = int(np.argsort(some.errors.mean(1))[len(some.errors) // 2])
        model = some.models[middle]
        with torch.no_grad():
            g = model.scaling.restore(model.network(model.scaling.inputs(tuples.inputs))).numpy()
        for k in range(3):
            lines[k].append(Line(some.label, tuples.times.numpy(), g[:, k], role(some.label)))
    return Plot(name, caption, [Panel("t [s]", f"{G[k]}' [-]", lines[k]) for k in range(3)])


def course_plot(flights: dict[str, Flown]) -> Plot:
    """Error over iterations of the trainings by steepest descent.

    Args:
        flights: Networks.

    Returns:
        One panel for each g; the thesis has no such figure.
    """
    panels = []
    for k, name in enumerate(G):
        lines = []
        for key in ("printed", "faster", "scaled"):
            networks = flights[key].networks
            marks = sorted(networks.course or {})
            values = np.array([(networks.course or {})[n][k] for n in marks])
            lines.append(Line(networks.label, np.array(marks, dtype=float), values))
        panels.append(Panel("iterations", f"error of {name} [-]", lines, log_y=True))
    return Plot("steepest_descent", "Error over spread while steepest descent goes on, median of the starts.", panels)
