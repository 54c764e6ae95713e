"""Hess & Faller 2000, "Conclusions": is the transverse error of the overshoots (Table 6) the wind that was left out?"""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import pandas as pd

from manoeuvre_nn.core.units import KNOT
from manoeuvre_nn.manoeuvre.zigzag import overshoot
from studies.hess2000.runs import APPROACH, OVERSHOOT_ANGLES_DEG, OVERSHOOTS, SHIPS, WINDS, Counts, overshoots
from studies.hess2000.wind_models import (
    SIGNIFICANT,
    BlindAnswer,
    asked_blindly,
    errors_of,
    pairs,
    perfect_but_for_wind,
    recursive,
    repeated,
    series,
)
from studies.reproduction.claims import read_claims
from studies.reproduction.section import ChapterResult, ComputingEffort, Line, Panel, Plot, Say

SEEDS, REPEATS = 5, 20
REPEATED_KN = 12.0
"""Approach speed of the overshoots that are sailed again and again [kn]."""
QUICK_COUNTS, QUICK_REPEATS, QUICK_SHARE = Counts(2, 2, 2), 2, 0.02
OCEAN = "open ocean"
CALM = "calm"
PERFECT, SERIES, NETWORK = "the ship in calm air", "series", "recursive network"
TABLE_6 = {"own": 11.2, "validation": 16.6}
"""Percent errors in y of the paper."""
LEAST_SPREAD = 0.2
"""Least standard deviation of the logarithm of an error: a few seeds may agree by chance."""
Row = dict[str, Any]


def chapter(effort: ComputingEffort, say: Say) -> ChapterResult:
    """The wind.

    Args:
        effort: How much computing is allowed.
        say: Told what is being done.

    Returns:
        Errors in y with and without wind, with and without wind inputs; what a diagnosis says that was not told of it.
    """
    seeds = [effort.seed + k for k in range(1 if effort.quick else min(effort.starts, SEEDS))]
    counts = QUICK_COUNTS if effort.quick else OVERSHOOTS
    errors: list[Row] = []
    blind: list[Row] = []
    for seed in seeds:
        for wind in (CALM, *WINDS):
            errors += errors_in(wind, seed, counts, say, QUICK_SHARE if effort.quick else 1.0)
        for wind in (CALM, OCEAN):
            say(f"seed {seed}, {wind}: pairs of runs on opposite courses, asked blindly")
            runs = overshoots("" if wind == CALM else wind, seed, counts)
            blind += [{"wind": wind, "seed": seed, "answer": asked_blindly(runs, pair)[0]} for pair in pairs(runs)]
    table = pd.DataFrame(errors)
    twice = [overshoot(angle, approach=APPROACH).at_speed(REPEATED_KN * KNOT) for angle in OVERSHOOT_ANGLES_DEG]
    again = repeated(SHIPS[2](), twice, WINDS[OCEAN], QUICK_REPEATS if effort.quick else REPEATS)
    found = counted(blind)
    y = medians(table)
    quantities = {"y": y, "repeated": again.mean().to_dict(), **gains(y), **found}
    claims = read_claims("hess2000", "wind").beside(quantities)
    return ChapterResult(
        "The wind that was left out",
        _summary(quantities),
        claims,
        {
            "How far Table 6 is from what each cause gives": distances(table),
            f"Error in y [%], median (least - largest) of {len(seeds)} sets of runs": spreads(table),
            "Wind named by a diagnosis that was not told of it": [_row(one) for one in blind],
            "The same overshoot in other winds: largest difference over the mean [%]": [
                {"manoeuvre": str(name), **{str(k): float(v) for k, v in row.items()}} for name, row in again.iterrows()
            ],
        },
        [errors_figure(table), blind_figure([one["answer"] for one in blind if one["wind"] == OCEAN])],
    )


def errors_in(wind: str, seed: int, counts: Counts, say: Say, share: float = 1.0) -> list[Row]:
    """Errors in y of all models in one condition.

    Args:
        wind: Key of ``WINDS``, or ``calm``.
        seed: Of the runs.
        counts: How many.
        say: Told what is being done.
        share: Of the updates of a network.

    Returns:
        A row a model: condition, model, whether it is told of the wind, seed, percent errors in y.
    """
    windy = wind != CALM
    runs = overshoots(wind if windy else "", seed, counts)
    rows: list[tuple[str, bool, Any]] = []
    if windy:
        rows.append((PERFECT, False, perfect_but_for_wind(runs)))
    for told in (False, True) if windy else (False,):
        inputs = "with" if told else "without"
        say(f"seed {seed}, {wind}: a series {inputs} wind terms")
        rows.append((SERIES, told, errors_of(series(runs, told=told), runs, told=told)))
        if wind in (CALM, OCEAN):
            say(f"seed {seed}, {wind}: a recursive network {inputs} wind inputs")
            rows.append((NETWORK, told, errors_of(recursive(runs, told=told, seed=seed, share=share), runs, told=told)))
    return [
        {"wind": wind, "model": model, "told": told, "seed": seed, **table["y"], "psi": table["psi"]["own"]}
        for model, told, table in rows
    ]


def medians(table: pd.DataFrame) -> dict[str, float]:
    """Medians over the seeds, by condition, model, whether it was told, and set of runs.

    Args:
        table: Rows of :func:`errors_in`.

    Returns:
        ``open ocean, series, told, unseen`` and its like -> error in y [%].
    """
    return {
        f"{wind}, {model}, {'told' if told else 'not told'}, {runs}": float(part[runs].median())
        for (wind, model, told), part in table.groupby(["wind", "model", "told"])
        for runs in ("own", "validation", "unseen")
    }


def gains(y: dict[str, float]) -> dict[str, float]:
    """By what factor being told of the wind makes y better on unseen runs, and a course along it on own runs."""
    better = {
        f"{name}_gain": y[f"{OCEAN}, {model}, not told, unseen"] / y[f"{OCEAN}, {model}, told, unseen"]
        for name, model in (("network", NETWORK), ("series", SERIES))
    }
    return better | {"off_course": y[f"{OCEAN}, {PERFECT}, not told, own"] / y[f"along, {PERFECT}, not told, own"]}


def spreads(table: pd.DataFrame) -> list[Row]:
    """Rows of a table: condition, model, and the spread over the seeds."""
    rows = []
    for (wind, model, told), part in table.groupby(["wind", "model", "told"], sort=False):
        row = {"wind": wind, "model": model, "told of the wind": "yes" if told else "no"}
        for name in ("own", "validation", "unseen", "psi"):
            label = "psi, own" if name == "psi" else name
            row[label] = f"{part[name].median():.1f} ({part[name].min():.1f} - {part[name].max():.1f})"
        rows.append(row)
    return rows


def distances(table: pd.DataFrame) -> list[Row]:
    """Where the paper's errors stand among those of each condition and model that knows of no wind.

    Args:
        table: Rows of :func:`errors_in`.

    Returns:
        Rows: mean of the logarithms as an error, a standard deviation as a factor, and how many of these the paper's
        error is away.
    """
    rows = []
    for (wind, model), part in table[~table["told"]].groupby(["wind", "model"], sort=False):
        row: Row = {"wind": wind, "model": model}
        for name, printed in TABLE_6.items():
            logs = np.log(part[name].to_numpy())
            spread = max(float(logs.std(ddof=1)) if len(logs) > 1 else 0.0, LEAST_SPREAD)
            row |= {
                f"{name}, y [%]": f"{np.exp(logs.mean()):.1f} x/ {np.exp(spread):.2f}",
                f"{name}: {printed} % is away by": f"{(np.log(printed) - logs.mean()) / spread:+.1f} sd",
            }
        rows.append(row)
    return rows


def counted(blind: Iterable[Row]) -> dict[str, Any]:
    """How often a wind was named, and rightly.

    Args:
        blind: Condition and answer of each pair.

    Returns:
        Counts in calm air and in wind.
    """
    asked = {wind: [one["answer"] for one in blind if one["wind"] == wind] for wind in (CALM, OCEAN)}
    windy = [a for a in asked[OCEAN] if a.windy]
    return {
        "asked": len(asked[OCEAN]),
        "named": len(windy),
        "right": sum(a.holds for a in windy),
        "named_share": len(windy) / max(len(asked[OCEAN]), 1),
        "right_share": sum(a.holds for a in windy) / max(len(windy), 1),
        "calm_asked": len(asked[CALM]),
        "calm_named": sum(bool(a.named) for a in asked[CALM]),
    }


def _summary(found: dict[str, Any]) -> str:
    y = found["y"]
    perfect = y[f"{OCEAN}, {PERFECT}, not told, own"]
    return (
        f"A model that is perfect but for the wind errs in y by {perfect:.1f} % on ten runs (the paper's Table 6: "
        f"{TABLE_6['own']} %). A series identified from eight of them: "
        f"{y[f'{OCEAN}, {SERIES}, not told, unseen']:.1f} % on unseen runs without wind terms, "
        f"{y[f'{OCEAN}, {SERIES}, told, unseen']:.1f} % with them; the recursive network "
        f"{y[f'{OCEAN}, {NETWORK}, not told, unseen']:.1f} % without and "
        f"{y[f'{OCEAN}, {NETWORK}, told, unseen']:.1f} % with wind inputs, and in calm air "
        f"{y[f'{CALM}, {NETWORK}, not told, unseen']:.1f} %. Asked blindly, a diagnosis named the wind for "
        f"{found['named']} of {found['asked']} pairs of runs, with intervals that hold the truth for {found['right']}."
    )


def _row(one: Row) -> Row:
    a: BlindAnswer = one["answer"]
    return {
        "wind": one["wind"], "seed": one["seed"], "named": ", ".join(a.named) or "nothing",
        "speed [m/s]": f"{a.speed[0]:.2f} +- {a.speed[1]:.2f}" if a.windy else "",
        "true speed": f"{a.true_speed:.2f}" if one["wind"] != CALM else "",
        "from [deg]": f"{a.from_deg[0]:.1f} +- {a.from_deg[1]:.1f}" if a.windy else "",
        "truly from": f"{a.true_from_deg:.1f}" if one["wind"] != CALM else "",
    }  # fmt: skip


def errors_figure(table: pd.DataFrame) -> Plot:
    """Errors in y of own and unseen runs, a point a seed."""
    groups = list(table.groupby(["wind", "model", "told"], sort=False))
    panels = []
    for part, title in (("own", "own runs"), ("unseen", "unseen runs")):
        lines = []
        for place, ((wind, model, told), rows) in enumerate(groups, 1):
            label = f"{place}: {wind}, {model}{', told' if told else ''}"
            lines.append(Line(label, np.full(len(rows), float(place)), rows[part].to_numpy(), points=True))
        ends = np.array([0.5, len(groups) + 0.5])
        paper = Line("Table 6", ends, np.full(2, TABLE_6["own"]), "paper")
        panels.append(Panel("condition and model", "error in y [%]", [*lines, paper], title, log_y=True))
    return Plot(
        "wind_errors", "Error in y with and without wind, one point a set of runs; line: Table 6, all runs", panels
    )


def blind_figure(answers: Sequence[BlindAnswer]) -> Plot:
    """Wind as it was named over the wind as it was, with intervals of 95 %."""
    windy = [a for a in answers if a.windy]
    speed = [(a.true_speed, *a.speed) for a in windy]
    # Winds from either side of north stand together.
    along = [((a.true_from_deg + 90) % 180 - 90, (a.from_deg[0] + 90) % 180 - 90, a.from_deg[1]) for a in windy]
    panels = []
    for values, what in ((speed, "speed [m/s]"), (along, "off the approach [deg]")):
        lines = [
            Line("", np.full(2, true), np.array([x - SIGNIFICANT * e, x + SIGNIFICANT * e]), "other")
            for true, x, e in values
        ]
        true, found = (np.array([v[k] for v in values]) for k in (0, 1))
        lines.append(Line("named", true, found, points=True))
        ends = np.array([true.min(), true.max()]) if len(true) else np.zeros(2)
        lines.append(Line("as it was", ends, ends, "reference"))
        panels.append(Panel(f"true wind: {what}", f"named: {what}", lines))
    return Plot("wind_named", "Wind named blindly from two runs on opposite courses, with intervals of 95 %", panels)
