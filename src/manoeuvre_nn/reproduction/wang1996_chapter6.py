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
from manoeuvre_nn.identification.sway_curve import stack
from manoeuvre_nn.identification.turning import TurnFit, fit_turn
from manoeuvre_nn.identification.turning_model import TurningModel, predict
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.recording.score import score
from manoeuvre_nn.reproduction.section import Claim, Effort, Say, Section, Verdict
from manoeuvre_nn.reproduction.wang1996_chapter6_plots import KINDS, Turn, plots
from manoeuvre_nn.ship.mariner import mariner

ANGLES = (10, 20, 30)
PRINTED_ERRORS = {10: 1.778437e-8, 20: 3.168374e-8, 30: 1.638284e-7}
"""Table 6.1."""
ITERATIONS = 150
"""Steps for one network: with many more it grows so steep near the largest r that the yaw equation breaks down."""
LARGEST_DEV = {10: 0.02, 20: 0.2, 30: 0.3}
"""Distance of the tracks over L up to which a prediction counts as the slight error that the thesis speaks of."""
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


def chapter(effort: Effort, say: Say) -> Section:
    """Do chapter 6 again.

    Args:
        effort: How much computing it may take.
        say: Is told what is being done.

    Returns:
        Tables 6.1 and 6.2, Figures 6.1-6.16 and the statements of the chapter beside ours.

    Source:
        Wang 1996, chapter 6; the turns are those of its chapter 3.
    """
    ship = mariner()
    say("chapter 6: three turns, and networks for v(r)")
    turns = sail(ship, effort)
    say("chapter 6: other ways to predict")
    claims = [*_about_the_curve(turns), *_about_errors(turns), *_about_weights(turns), *_about_tracks(turns)]
    claims += _about_variants(ship, turns)
    devs = {kind: ", ".join(f"{t.dev[kind][t.chosen(kind)]:.2g}" for t in turns) for kind in KINDS[:2]}
    summary = (
        f"With one network for v(r) the yaw equation alone keeps within {devs[KINDS[0]]} L of the turns with 10, 20 "
        "and 30 deg of rudder. r passes a largest value and comes back, so that v(r) has two values; with one branch "
        f"before and one after it, joined in time, it keeps within {devs[KINDS[1]]} L."
    )
    tables = {"Where v(r) has two values": _folds(turns), "Networks over their starts": _starts(turns)}
    tables["Table 6.2 in several readings"] = published_errors(turns)
    return Section("Chapter 6: turning from the yaw equation alone", summary, claims, tables, plots(turns))


def sail(ship: Ship, effort: Effort) -> list[Turn]:
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


def _verdict(holds: bool, otherwise: Verdict = "does not hold") -> Verdict:
    return "holds" if holds else otherwise


def _about_the_curve(turns: Sequence[Turn]) -> list[Claim]:
    """Section 6.1: is v(r) almost a straight line; section 6.3: where does a network follow it?"""
    shares = [np.corrcoef(t.simulated["r"], t.simulated["v"])[0, 1] ** 2 for t in turns]
    settled = [t.simulated["v"][-1] / t.simulated["r"][-1] / mariner().particulars.length for t in turns]
    ours = "r^2 of a straight line " + ", ".join(f"{s:.2f}" for s in shares)
    why = "settled turns lie on one line, v/(r L) " + ", ".join(f"{s:.3f}" for s in settled)
    why += "; within a turn v lags behind r and keeps growing while r already falls"
    verdict = _verdict(min(shares) > 0.98, "holds in direction")
    claims = [Claim("Figure 6.1", "v over r in a turn", "almost linear (after Clarke 1971)", ours, verdict, why)]
    for t in turns:
        best, until = t.best(KINDS[0]), t.fold.window[0]
        early, late = (_error(best, t.simulated, a, b) for a, b in ((0.0, until), (until, np.inf)))
        where, what = f"Section 6.3, {t.angle} deg", "error of v over its largest value before / after the join"
        holds, ours = _verdict(max(early, late) < 0.05), f"{early:.3f} / {late:.3f}"
        why = "" if holds == "holds" else "one network takes a mean of the two branches, which comes late or early"
        claims.append(Claim(where, what, "fits well in the transient, slight error later", ours, holds, why))
    return claims


def _error(run: Recording, reference: Recording, start: float, end: float) -> float:
    """Root mean square error of v in a time over the largest v."""
    part = (reference.time >= start) & (reference.time <= end)
    return float(np.sqrt(np.mean((run["v"] - reference["v"])[part] ** 2)) / np.abs(reference["v"]).max())


def _about_errors(turns: Sequence[Turn]) -> list[Claim]:
    """Table 6.1."""
    claims = []
    for t in turns:
        printed, fit = PRINTED_ERRORS[t.angle], t.fits[KINDS[0]]
        total, last = float(fit.sse.min()), float(fit.last.median())
        why = f"at one r' the turn has two v' up to {t.fold.apart:.3f} apart, which no one network follows"
        same = _verdict(0.1 < total / printed < 10)
        where = f"Table 6.1, {t.angle} deg"
        claims.append(Claim(where, "sum of squared errors of v', whole turn", printed, total, same, why))
        descent = t.fits[KINDS[2]].last
        small: Verdict = "holds in direction" if last < 1e-6 else "does not hold"
        why = (
            "printed is probably E of eq 2.6, which is that of one sample: the last one of a training; medians of the "
        )
        why += f"starts are {last:.1g} by Levenberg-Marquardt, {float(descent.median()):.1g} by steepest descent"
        claims.append(Claim(where, "squared error of v' at the last sample", printed, last, small, why))
    return claims


def _about_weights(turns: Sequence[Turn]) -> list[Claim]:
    """Table 6.2."""
    rows, claims = published_errors(turns), []
    for t in turns:
        best = min(rows, key=lambda row: row[f"{t.angle} deg"])
        ours = f"error of v {best[f'{t.angle} deg']:.2f} of its size at best ({best['reading']}, {best['input']})"
        claims.append(
            Claim(
                f"Table 6.2, {t.angle} deg", "published weights", "give v(r)", ours, "not comparable",
                "neither the labels, nor the order of appendix B's file, nor W by columns give v(r) in any unit tried",
            )
        )  # fmt: skip
    return claims


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


def _about_tracks(turns: Sequence[Turn]) -> list[Claim]:
    """Figures 6.4, 6.9 and 6.14."""
    claims = []
    longer = KINDS[3]
    for figure, t in zip((4, 9, 14), turns, strict=True):
        dev = float(t.dev[KINDS[0]][t.chosen(KINDS[0])])
        two, broken = t.dev[KINDS[1]][t.chosen(KINDS[1])], int(np.isinf(t.dev[longer]).sum())
        why = f"with two branches {two:.1g} L; limit {LARGEST_DEV[t.angle]} L"
        if broken:
            why += f"; trained longer, {broken} of {len(t.dev[longer])} networks are too steep for the yaw equation"
        verdict = _verdict(dev <= LARGEST_DEV[t.angle])
        what = f"{t.angle} deg: largest distance from the simulated track, best network"
        claims.append(Claim(f"Figure 6.{figure}", what, "a slight error", dev, verdict, why, "L"))
    return claims


def _about_variants(ship: Ship, turns: Sequence[Turn]) -> list[Claim]:
    """Section 6.3: r and v held, u held, and the network of another rudder angle."""
    length, orders = ship.particulars.length, [turning_circle(float(t.angle)) for t in turns]
    curves = stack([t.curve(KINDS[0]) for t in turns])
    held = predict(TurningModel(ship, curves, separation=SEPARATION), orders)
    fast = predict(TurningModel(ship, curves, constant_speed=True), orders)
    other = predict(TurningModel(ship, stack([turns[1].curve(KINDS[0])] * len(turns))), orders)
    own = [float(t.dev[KINDS[0]][t.chosen(KINDS[0])]) for t in turns]
    by = [[_dev(x, t.simulated, length) for x, t in zip(runs, turns, strict=True)] for runs in (held, fast, other)]
    text = [", ".join(f"{x:.2g}" for x in xs) + " L" for xs in by]
    usual = ", ".join(f"{x:.2g}" for x in own) + " L without"
    left = ", ".join(f"{t.simulated['u'][-1] / ship.particulars.speed:.2f}" for t in turns)
    good = max(np.array(by[0]) / own) < 1.5, max(by[1]) < 0.5, min(by[2][0] / own[0], by[2][2] / own[2]) > 3
    words = [_verdict(bool(x)) for x in good]
    return [
        Claim(
            "Section 6.3", f"r and v held after {SEPARATION:g} s, tracks of 10, 20, 30 deg", "used",
            text[0], words[0], usual,
        ),
        Claim(
            "Section 6.3", "speed held, tracks of 10, 20, 30 deg", "possible if the loss of speed is insignificant",
            text[1], words[1], f"the loss is not: u falls to {left} U0; r and v stay right, for here N has no u in it",
        ),
        Claim(
            "Section 6.3", "network of the 20-deg turn in the turns with 10, 20, 30 deg",
            "each rudder angle needs its own", text[2], words[2], usual,
        ),
    ]  # fmt: skip


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
