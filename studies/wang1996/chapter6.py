"""Wang 1996, chapter 6: turns predicted from the yaw equation alone, sway being a function v(r) that networks learn."""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.dynamics.limits import OK
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.scoring.score import score
from manoeuvre_nn.ship.mariner import mariner
from studies.reproduction.claims import read_claims
from studies.reproduction.section import ChapterResult, ComputingEffort, Say
from studies.wang1996.chapter6_plots import KINDS, Turn, plots
from studies.wang1996.sway_curve import stack
from studies.wang1996.turning import TurnFit, fit_turn
from studies.wang1996.turning_model import TurningModel, predict

ANGLES = (10, 20, 30)
ITERATIONS = 150
"""Steps for one network: with many more it grows so steep near the largest r that the yaw equation breaks down."""
SEPARATION = 150.0
"""Time after which r and v are held [s]; the thesis does not state its own."""

# Table 6.2: W_1,1 to W_5,2, then B_1,1 to B_6,1, as labelled; one column for each turn.
PRINTED_WEIGHTS = {
    10: (-1.906287e-2, 1.843463, -2.470639e-2, -3.105290e-3, -3.202809e-1, -1.748573, 1.298166e2, -2.677744e1)
    + (1.105923e1, 1.990898e1, -1.658517e1, -4.133165e-1, -1.456758e1, 6.416173, -1.276617, 0.0),
    20: (1.978335e-2, 4.399924e-1, -3.093730, -6.400691e-2, 7.327562e-2, -2.120439e-1, 9.839515, 7.365877)
    + (8.051810, 7.150448e-1, -2.982559, 1.544899, 6.082410, 9.207373, 8.060044, 0.0),
    30: (5.776109e-2, 2.766127e-1, -4.756842, -8.601323e-2, 9.395256e-2, -2.111839e-1, 9.838378, 7.451086)
    + (9.432881, 6.660824, -3.795949, 7.996171e-1, 6.027607, 9.205272, 8.167284, 0.0),
}


def chapter(effort: ComputingEffort, say: Say) -> ChapterResult:
    """Do chapter 6 again.

    Args:
        effort: How much computing it may take.
        say: Is told what is being done.

    Returns:
        Tables 6.1 and 6.2, Figures 6.1-6.16 and the statements of the chapter beside ours.

    Source:
        Wang 1996, chapter 6; the turns are those of its chapter 3.
    """
    claims, ship = read_claims("wang1996", "6"), mariner()
    say("chapter 6: three turns, and networks for v(r)")
    turns = sail(ship, effort)
    say("chapter 6: other ways to predict")
    compared = claims.beside(_curve_values(turns) | _turn_values(turns) | _variant_values(ship, turns))
    devs = {kind: ", ".join(f"{t.dev[kind][t.chosen(kind)]:.2g}" for t in turns) for kind in KINDS[:2]}
    summary = (
        f"With one network for v(r) the yaw equation alone keeps within {devs[KINDS[0]]} L of the turns with 10, 20 "
        "and 30 deg of rudder. r passes a largest value and comes back, so that v(r) has two values; with one branch "
        f"before and one after it, joined in time, it keeps within {devs[KINDS[1]]} L."
    )
    tables = {"Where v(r) has two values": _folds(turns), "Networks over their starts": _starts(turns)}
    tables["Table 6.2 in several readings"] = published_errors(turns)
    return ChapterResult("Chapter 6: turning from the yaw equation alone", summary, compared, tables, plots(turns))


def sail(ship: Ship, effort: ComputingEffort) -> list[Turn]:
    """Simulate the turns, train the networks and predict with all of them in one batch.

    Args:
        ship: The ship.
        effort: How much computing it may take.

    Returns:
        The three turns.
    """
    p, starts = ship.particulars, effort.starts // 2 if effort.quick else effort.starts
    trials = {a: turning_circle(float(a)) for a in ANGLES}
    simulated = dict(zip(ANGLES, roll_out(CalmWater(ship), list(trials.values())), strict=True))
    steps, more = (3_000, 300) if effort.quick else (15_000, 600)
    fits: dict[tuple[int, str], TurnFit] = {}
    for angle, run in simulated.items():
        every_4_s = run.resampled(run.time[::4])  # as the program of appendix B takes its samples
        usual, longer = (
            partial(fit_turn, ship=p, starts=starts, seed=effort.seed, iterations=n) for n in (ITERATIONS, more)
        )
        fits[angle, KINDS[0]], fits[angle, KINDS[3]] = usual(run), longer(run)
        fits[angle, KINDS[1]] = longer(run, branches=2)
        fits[angle, KINDS[2]] = longer(every_4_s, method="steepest_descent", iterations=steps)
    model = TurningModel(ship, stack([fit.curve for fit in fits.values()]))
    runs = predict(model, [trials[angle] for angle, _ in fits for _ in range(starts)])
    batches = {key: runs[k * starts : (k + 1) * starts] for k, key in enumerate(fits)}
    return [
        Turn(
            angle,
            run,
            {kind: fits[angle, kind] for kind in KINDS},
            {kind: batches[angle, kind] for kind in KINDS},
            {kind: np.array([_dev(x, run, p.length) for x in batches[angle, kind]]) for kind in KINDS},
        )
        for angle, run in simulated.items()
    ]


def _dev(prediction: Recording, reference: Recording, length: float) -> float:
    return score(prediction, reference, length).dev_L if prediction.status == OK else float("inf")


def _curve_values(turns: Sequence[Turn]) -> dict[str, Any]:
    """Section 6.1: is v(r) almost a straight line?"""
    shares = [float(np.corrcoef(t.simulated["r"], t.simulated["v"])[0, 1] ** 2) for t in turns]
    settled = [float(t.simulated["v"][-1] / t.simulated["r"][-1] / mariner().particulars.length) for t in turns]
    return {"r_squared": shares, "least_r_squared": min(shares), "settled": settled}


def _error(run: Recording, reference: Recording, start: float, end: float) -> float:
    """Root mean square error of v in a time over the largest v."""
    part = (reference.time >= start) & (reference.time <= end)
    return float(np.sqrt(np.mean((run["v"] - reference["v"])[part] ** 2)) / np.abs(reference["v"]).max())


def _turn_values(turns: Sequence[Turn]) -> dict[str, Any]:
    """Tables 6.1 and 6.2, Figures 6.4, 6.9 and 6.14, and where a network follows the curve: ``turn_10`` and so on."""
    rows, found = published_errors(turns), {}
    for t in turns:
        best, until = t.best(KINDS[0]), t.fold.window[0]
        early, late = (_error(best, t.simulated, a, b) for a, b in ((0.0, until), (until, np.inf)))
        reading = min(rows, key=lambda row: row[f"{t.angle} deg"])
        one, two = (float(t.dev[kind][t.chosen(kind)]) for kind in KINDS[:2])
        longer = t.dev[KINDS[3]]
        broken = int(np.isinf(longer).sum())
        steep = f"; trained longer, {broken} of {len(longer)} networks are too steep for the yaw equation"
        found[f"turn_{t.angle}"] = {
            "angle": t.angle,
            "early": early,
            "late": late,
            "larger": max(early, late),
            "apart": t.fold.apart,
            "sse": float(t.fits[KINDS[0]].sse.min()),
            "last": float(t.fits[KINDS[0]].last.median()),
            "last_by_descent": float(t.fits[KINDS[2]].last.median()),
            "published_error": reading[f"{t.angle} deg"],
            "reading": reading["reading"],
            "input": reading["input"],
            "dev": one,
            "dev_of_two_branches": two,
            "steep": steep if broken else "",
        }
    return {**found, "turns": list(found.values())}


def readings(weights: Sequence[float]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Ways to read a column of Table 6.2.

    Args:
        weights: Its 16 numbers in their order.

    Returns:
        Reading -> W (5, 2), bias last, and B (6,), bias last.
    """
    w = np.array(weights)
    labelled, file = (w[:10], w[10:]), (w[6:], w[:6])
    shifted = w[5:15], np.append(w[:5], 0.0)
    named = {"as labelled": labelled, "B first": file, "five B first": shifted}
    rows = {name: (x.reshape(5, 2), b) for name, (x, b) in named.items()}
    swapped = {f"{name}, bias first": (x[:, ::-1], b) for name, (x, b) in rows.items()}
    columns = {f"{name}, W by columns": (x.reshape(2, 5).T, b) for name, (x, b) in named.items()}
    return rows | swapped | columns


def published_errors(turns: Sequence[Turn]) -> list[dict[str, Any]]:
    """What the published weights come to.

    Args:
        turns: The turns.

    Returns:
        Reading and unit of the input -> root mean square error of v over its size, output taken as v' or as v [m/s],
        whichever is better, and that after the best shift and scale of the output.
    """
    p, table = mariner().particulars, []
    inputs = {"r'": p.time_unit, "r [deg/s]": 1 / DEGREE, "r [rad/s]": 1.0}
    for reading in readings(PRINTED_WEIGHTS[10]):
        for unit, factor in inputs.items():
            row: dict[str, Any] = {"reading": reading, "input": unit}
            for t in turns:
                (w, b), v = readings(PRINTED_WEIGHTS[t.angle])[reading], t.simulated["v"]
                nodes = 1 / (1 + np.exp(-(factor * t.simulated["r"][:, None] * w[:, 0] + w[:, 1])))
                out, size = nodes @ b[:5] + b[5], np.sqrt(np.mean(v**2))
                row[f"{t.angle} deg"] = min(np.sqrt(np.mean((out * s - v) ** 2)) / size for s in (1.0, p.speed))
                fitted = np.polyval(np.polyfit(out - out.mean(), v, 1), out - out.mean())
                row[f"{t.angle} deg, rescaled"] = float(np.sqrt(np.mean((fitted - v) ** 2)) / size)
            table.append(row)
    return table


def _variant_values(ship: Ship, turns: Sequence[Turn]) -> dict[str, Any]:
    """Section 6.3: r and v held, u held, and the network of another rudder angle."""
    length, orders = ship.particulars.length, [turning_circle(float(t.angle)) for t in turns]
    curves = stack([t.curve(KINDS[0]) for t in turns])
    held = predict(TurningModel(ship, curves, separation=SEPARATION), orders)
    fast = predict(TurningModel(ship, curves, constant_speed=True), orders)
    other = predict(TurningModel(ship, stack([turns[1].curve(KINDS[0])] * len(turns))), orders)
    own = np.array([t.dev[KINDS[0]][t.chosen(KINDS[0])] for t in turns])
    devs = [[_dev(x, t.simulated, length) for x, t in zip(runs, turns, strict=True)] for runs in (held, fast, other)]
    by_held, by_fast, by_other = devs
    return {
        "separation": SEPARATION,
        "own_dev": own.tolist(),
        "held_dev": by_held,
        "held_over_own": float(max(by_held / own)),
        "fast_dev": by_fast,
        "largest_fast_dev": max(by_fast),
        "other_dev": by_other,
        "other_over_own": float(min((by_other / own)[[0, 2]])),
        "speed_left": [float(t.simulated["u"][-1] / ship.particulars.speed) for t in turns],
    }


def _folds(turns: Sequence[Turn]) -> list[dict[str, Any]]:
    return [
        {
            "rudder [deg]": t.angle, "largest r'": t.fold.r, "at [s]": t.fold.time, "r' at the end": t.fold.settled,
            "r falls by [%]": 100 * t.fold.falls_by, "branches of v' apart": t.fold.apart,
            "over largest v'": t.fold.apart / t.fold.largest_v,
            "joined from, to [s]": "{:g}, {:g}".format(*t.fold.window),
        }
        for t in turns
    ]  # fmt: skip


def _starts(turns: Sequence[Turn]) -> list[dict[str, Any]]:
    table = []
    for t in turns:
        for kind in KINDS:
            sse, dev = t.fits[kind].sse.numpy(), t.dev[kind]
            through = dev[np.isfinite(dev)]
            row: dict[str, Any] = {"rudder [deg]": t.angle, "v(r) by": kind, "starts": len(dev)}
            row |= {"samples": len(t.simulated) if kind != KINDS[2] else len(t.simulated.time[::4])}
            row |= {f"SSE {n}": float(q) for n, q in zip(("least", "median", "largest"), _spread(sse), strict=True)}
            row |= {
                f"dev {n} [L]": float(q) for n, q in zip(("least", "median", "largest"), _spread(through), strict=True)
            }
            table.append(row | {"broke down": len(dev) - len(through)})
    return table


def _spread(values: np.ndarray) -> np.ndarray:
    return np.quantile(values, [0.0, 0.5, 1.0]) if len(values) else np.full(3, np.nan)
