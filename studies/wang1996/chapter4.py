"""Wang 1996, chapters 2 and 4: the network, its trainings, and the 35-deg zigzag predicted in closed loop."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch

from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.network.perceptron import Activation, Initial
from manoeuvre_nn.numerics.steepest_descent import RateSchedule
from manoeuvre_nn.recording.tuples import to_tuples
from manoeuvre_nn.ship.clarke import clarke_derivatives
from manoeuvre_nn.ship.taylor import TaylorShip
from studies.reproduction.claims import read_claims
from studies.reproduction.section import ChapterResult, ComputingEffort, Line, Panel, Plot, Say
from studies.wang1996.curves import beside, role
from studies.wang1996.networks import Flown, ThesisShip, TrainedShips, case, flown, published, spread_row
from studies.wang1996.trainings import (
    BEST_START,
    STARTS,
    Descent,
    backpropagation,
    levenberg_marquardt,
)

G = ("g1", "g2", "g3")


def plans(effort: ComputingEffort) -> dict[str, Descent]:
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


def chapter(effort: ComputingEffort, say: Say) -> ChapterResult:
    """Train and judge the networks of chapter 4.

    Args:
        effort: How much computing.
        say: Told what is being done.

    Returns:
        Tables 4.1-4.3, Figures 2.2 and 4.1-4.17.

    Source:
        Wang 1996, chapters 2 and 4.
    """
    claims, of = read_claims("wang1996", "4"), case("mariner")
    flights = trained_and_flown(of, effort, say, ("zz35",))
    figures = figure_plots(of, flights)
    theirs, ours = (float(np.median(flights[k].dev["zz35"])) for k in ("published", BEST_START))
    return ChapterResult(
        title="Chapters 2 and 4: networks for the lumped nonlinear functions",
        summary="Read in the right order, the printed weights are what the thesis says they are (zz35 within "
        f"{theirs:.2g} L). Steepest descent gets there slowly; Levenberg-Marquardt comes within {ours:.1g} L, "
        "median of the starts.",
        claims=claims.beside(
            slope_values()
            | estimate_values(of.known)
            | sample_values(of)
            | weight_values(of)
            | training_values(flights)
            | loop_values(flights)
        ),
        tables={"Trainings: medians over the starts, the worst in brackets": [spread_row(f) for f in flights.values()]},
        plots=figures,
    )


def trained_and_flown(of: ThesisShip, effort: ComputingEffort, say: Say, names: Sequence[str]) -> dict[str, Flown]:
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


def slope_values() -> dict[str, float]:
    """The slope of the sigmoid f at M = .7 by differences, beside f (1 - f).

    Returns:
        Both.
    """
    m, h = torch.tensor(0.7, dtype=torch.float64), 1e-6
    f = float(torch.sigmoid(m))
    slope = float((torch.sigmoid(m + h) - torch.sigmoid(m - h)) / (2 * h))
    return {"sigmoid_slope": slope, "f_times_1_minus_f": f * (1 - f)}


def estimate_values(known: TaylorShip) -> dict[str, Any]:
    """Clarke's estimate by the names that the thesis prints, and his rudder drag, -2 Y_d.

    Args:
        known: The linear part.

    Returns:
        ``clarke`` and ``clarke_drag``.
    """
    inertia, c = known.inertia, known.coefficients
    values: dict[str, Any] = {"m - X_udot": inertia[0, 0], "m - Y_vdot": inertia[1, 1], "I_z - N_rdot": inertia[2, 2]}
    values |= {"Y_rdot": -inertia[1, 2], "N_vdot": -inertia[2, 1], "X_u": c["X"]["u"], "X_dd": c["X"]["dd"]}
    values |= {"Y_v": c["Y"]["v"], "Y_r - m": c["Y"]["r"], "Y_d": c["Y"]["d"]}
    values |= {"N_v": c["N"]["v"], "N_r": c["N"]["r"], "N_d": c["N"]["d"]}
    return {"clarke": values, "clarke_drag": -2 * clarke_derivatives(known.particulars)["Yd"]}


def sample_values(of: ThesisShip) -> dict[str, Any]:
    """Section 4.4.1 and 4.4.2: what the 35-deg zigzag holds.

    Args:
        of: The ship.

    Returns:
        Share of the samples at 34 deg and more, size of g beside that in zz15, largest g' and r'.
    """
    x, y = of.tuples.inputs, of.tuples.targets
    small = to_tuples([of.references["zz15"]], of.known).targets
    over_zz15 = (y.square().mean(0).sqrt() / small.square().mean(0).sqrt()).tolist()
    return {
        "share_at_34_deg": float((x[:, 3].abs() >= 34 * DEGREE).double().mean()),
        "g_over_zz15": over_zz15,
        "least_g_over_zz15": min(over_zz15),
        "largest_g": y.abs().amax(0).tolist(),
        "largest_r": float(x[:, 2].abs().max()),
    }


def weight_values(of: ThesisShip) -> dict[str, dict[str, float]]:
    """Errors of the published weights over the spread of g, in both readings.

    Args:
        of: The ship.

    Returns:
        ``corrected`` and ``as_labelled``, by g.
    """
    readings = {"corrected": published(of), "as_labelled": published(of, "printed")}
    return {reading: dict(zip(G, some.errors[0].tolist(), strict=True)) for reading, some in readings.items()}


def training_values(flights: dict[str, Flown]) -> dict[str, Any]:
    """Section 4.4.3: how the training went.

    Args:
        flights: Networks.

    Returns:
        Errors of g1, g2, g3 (medians over the starts) and iterations of each training.
    """
    own, found = flights["printed"].networks, {}
    for key in ("published", "faster", "scaled", BEST_START):
        networks = flights[key].networks
        name = "marquardt" if key == BEST_START else key
        found[f"{name}_errors"] = np.median(networks.errors, axis=0).tolist()
        found[f"{name}_iterations"] = float(networks.iterations)
    assert own.course is not None
    marks = sorted(own.course)
    before = own.course[min(marks, key=lambda n: abs(n - own.iterations * 16 / 76))]
    after, last = own.course[marks[-1]].tolist(), found["faster_errors"]
    return found | {
        "slow_iterations": own.iterations * 60 // 76,
        "errors_before": before.tolist(),
        "errors_after": after,
        "largest_error_after": max(after),
        "g1_over_others": last[0] / max(last[1:]),
        "starts_side_by_side": len(flights["faster"].networks.models),
    }


def loop_values(flights: Mapping[str, Flown]) -> dict[str, list[dict[str, Any]]]:
    """Networks in closed loop: deviations of the tracks from the simulated ones.

    Args:
        flights: Networks in closed loop.

    Returns:
        ``published`` and ``trained``, each a list: label, number of starts, and for each manoeuvre the median, least
        and largest deviation [L].
    """
    items = {}
    for key, flight in flights.items():
        count = len(flight.networks.models)
        errors = np.array2string(np.median(flight.networks.errors, axis=0), precision=2)
        items[key] = {
            "label": flight.networks.label + (", median" if count > 1 else ""),
            "starts": count,
            "errors": errors,
            "devs": {name: dev.tolist() for name, dev in flight.dev.items()},
            "dev": {name: float(np.median(dev)) for name, dev in flight.dev.items()},
            "least": {name: float(dev.min()) for name, dev in flight.dev.items()},
            "largest": {name: float(dev.max()) for name, dev in flight.dev.items()},
        }
    trained = [item for key, item in items.items() if key != "published"]
    return {"published": [items["published"]], "trained": trained, "flown": list(items.values())}


def figure_plots(of: ThesisShip, flights: dict[str, Flown]) -> list[Plot]:
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


def target_plot(of: ThesisShip, networks: Sequence[TrainedShips], name: str, caption: str) -> Plot:
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
