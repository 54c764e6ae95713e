"""Wang 1996, section 5.3: coefficients out of the lumped functions by regression, and a zigzag sailed with them."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.estimation.derivatives import coefficient_name
from manoeuvre_nn.recording.tuples import to_tuples
from manoeuvre_nn.scoring.score import score
from manoeuvre_nn.ship.mariner import COEFFICIENTS
from studies.reproduction.claims import read_claims
from studies.reproduction.section import ChapterResult, ComputingEffort, Line, Panel, Plot, Say
from studies.wang1996.coefficients import RegressedForces, Study, sailed, study, thesis_prime
from studies.wang1996.derivatives import si_unit
from studies.wang1996.printed_coefficients import (
    INERTIA,
    ORIGINAL_SLIPS,
    ROWS,
    SLIPS,
    SURGE_RR,
    Row,
)
from studies.wang1996.stepwise import TermEstimate

NOTHING = TermEstimate(0.0, 0.0, 0.0, 0.0, 1.0)
"""A coefficient whose term was dropped."""
ORIGINAL, PRINTED, CORRECTED = "original coefficients", "thesis, as printed", "thesis, slips corrected"
OURS, DIRECT = "ours, networks' g", "our networks"


def chapter(effort: ComputingEffort, say: Say) -> ChapterResult:
    """Section 5.3: Tables 5.1 to 5.3, eqs 5.1 to 5.3, Figs 5.13 to 5.19.

    Args:
        effort: How much computing it may take.
        say: Tells what is being done.

    Returns:
        The section.
    """
    paper, done = read_claims("wang1996", "5.3"), study(effort, say)
    say("15-15 zigzags with the coefficients")
    runs = sailed(done)
    (reference,), length = runs[ORIGINAL], done.ship.particulars.length
    devs = {name: [score(r, reference, length).dev_L for r in some] for name, some in runs.items()}
    claims = paper.beside(_row_values(done) | _inertia_values(done) | _equation_values(done) | _text_values(done, devs))
    held = sum(c.verdict == "holds" for c in claims)
    ours, thesis = _agreeing(done)
    summary = (
        "From exact g backward elimination at p < .05 keeps exactly the true terms, and M_true M_Clarke^-1 brings them "
        "to the originals; the thesis compares what has unlike inertia. From the g of networks trained by "
        f"Levenberg-Marquardt {sum(ours)} of {len(ours)} coefficients come within 20 % (thesis: {sum(thesis)}), and "
        f"the 15-15 zigzag with them is {float(np.median(devs[OURS])):.2g} L off, by the networks themselves "
        f"{float(np.median(devs[DIRECT])):.2g} L (medians of {len(done.trained)} trainings). "
        f"{held} of {len(claims)} numbers and statements hold."
    )
    tables: dict[str, Sequence[Mapping[str, Any]]] = {
        title: [_cells(done, row) for row in (*ROWS, SURGE_RR) if row.equation == equation]
        for title, equation in (("Table 5.1: surge", "X"), ("Table 5.2: sway", "Y"), ("Table 5.3: yaw", "N"))
    }
    tables["Statistics of the regressions"] = _statistics(done)
    tables["15-15 zigzag, distance from the original's track over L"] = [
        {"coefficients": n, "median": float(np.median(d)), "best": min(d), "worst": max(d)} for n, d in devs.items()
    ]
    return ChapterResult(
        "Section 5.3: regression", summary, claims, tables, [*_lumped_plots(done), *_zigzag_plots(runs, devs)]
    )


def _estimate(of: RegressedForces, row: Row, *, own: bool = False) -> TermEstimate:
    """The estimate of a row, Clarke's part added, with Clarke's inertia or the ship's own."""
    return (of.own if own else of.clarke)[row.equation].get(row.term, NOTHING)


def _middle(done: Study, row: Row, *, own: bool = False) -> tuple[float, float, float]:
    """Median, least and largest estimate over our networks."""
    values = [_estimate(found, row, own=own).value for found in done.trained]
    return float(np.median(values)), min(values), max(values)


def _agreeing(done: Study) -> tuple[list[bool], list[bool]]:
    """Which coefficients are within 20 % of the originals: ours at the ship's inertia, and the thesis'."""
    rows = [row for row in ROWS if row.original]
    true = [_estimate(done.exact, row, own=True).value for row in rows]
    ours = [abs(_middle(done, row, own=True)[0] - t) <= 0.2 * abs(t) for row, t in zip(rows, true, strict=True)]
    return ours, [abs(row.estimated - t) <= 0.2 * abs(t) for row, t in zip(rows, true, strict=True)]


def _row_values(done: Study) -> dict[str, list[dict[str, Any]]]:
    """Rows of the tables as printed, with ours: all of them, and those with a second or a fourth column."""
    items = []
    for row in ROWS:
        middle, low, high = _middle(done, row)
        items.append({
            **asdict(row),
            "symbol": coefficient_name(row.equation, row.term),
            "our_prime": row.regression / si_unit(thesis_prime(), row.equation, row.term),
            "our_clarke": done.known.coefficients[row.equation].get(row.term),
            "middle": middle,
            "low": low,
            "high": high,
            "networks": len(done.trained),
            "from_exact_g": _estimate(done.exact, row).value,
            "from_exact_g_own_inertia": _estimate(done.exact, row, own=True).value,
            "slip": SLIPS.get((row.equation, row.term), ""),
            "original_slip": ORIGINAL_SLIPS.get((row.equation, row.term), ""),
        })
    return {
        "rows": [item for item in items if not item["slip"]],
        "rows_with_slip": [item for item in items if item["slip"]],
        "regressed_rows": [item for item in items if item["regression"]],
        "rows_of_clarke": [item for item in items if item["clarke"] is not None],
        "all_rows": items,
    }


def _inertia_values(done: Study) -> dict[str, Any]:
    """What is not regressed: Clarke's inertia beside the original's, and what the difference does to N_v."""
    clarke = dict(zip(("mx", "my", "mz"), done.known.inertia.diagonal().tolist(), strict=True))
    clarke |= {"Yrdot": -float(done.known.inertia[1, 2]), "Nvdot": -float(done.known.inertia[2, 1])}
    row = next(r for r in ROWS if (r.equation, r.term) == ("N", "v"))
    printed = [
        {"table": table, "symbol": name, "clarke": value, "our_clarke": clarke[key]}
        for name, (table, key, value, _) in INERTIA.items()
    ]
    own, other = _estimate(done.exact, row, own=True).value, _estimate(done.exact, row).value
    return {"inertia": printed, "own_N_v": own, "clarke_N_v": other}


def _equation_values(done: Study) -> dict[str, list[dict[str, Any]]]:
    """Eqs 5.1 to 5.3, and a regression of the published networks' g on the same terms, in SI units."""
    items: list[dict[str, Any]] = []
    lost: list[dict[str, Any]] = []
    for row in (*ROWS, SURGE_RR):
        if row.regression:
            found = done.published.equations[row.equation].estimates[row.term]
            unit = si_unit(thesis_prime(), row.equation, row.term)
            (lost if row is SURGE_RR else items).append({
                "equation": f"5.{'XYN'.index(row.equation) + 1}",
                "symbol": coefficient_name(row.equation, row.term),
                "regression": row.regression,
                "ours": found.value * unit,
                "low": found.low * unit,
                "high": found.high * unit,
                "prime": found.value,
            })
    return {"terms": items, "terms_with_a_digit_lost": lost}


def _text_values(done: Study, devs: Mapping[str, Sequence[float]]) -> dict[str, Any]:
    """What the section speaks of."""
    networks = [done.eliminated, *(f.regression for f in done.trained)]
    ours, thesis = _agreeing(done)
    own, direct = float(np.median(devs[OURS])), float(np.median(devs[DIRECT]))
    return _exact_values(done) | {
        "least_r_squared": min(q.r_squared for r in networks for q in r.equations.values()),
        "thesis_terms": float(sum(bool(r.regression) for r in (*ROWS, SURGE_RR))),
        "kept_terms": float(sum(len(q.estimates) for q in done.eliminated.equations.values())),
        "thesis_good": sum(thesis),
        "ours_good": sum(ours),
        "originals": len(thesis),
        "share_of_thesis_good": sum(thesis) / len(thesis),
        "covered": _coverage(done),
        "dev_printed": devs[PRINTED][0],
        "dev_corrected": devs[CORRECTED][0],
        "dev": own,
        "least_dev": min(devs[OURS]),
        "largest_dev": max(devs[OURS]),
        "dev_of_networks": direct,
        "regression_over_networks": own / direct,
    }


def _exact_values(done: Study) -> dict[str, Any]:
    """What the method itself can do, with nothing but rounding in g."""
    own = {e: {"".join(sorted(t, key="0uvrd".index)): c for t, c in q.items()} for e, q in COEFFICIENTS.items()}
    kept = {e: set(q.estimates) for e, q in done.exact.regression.equations.items()}
    wrong = (kept["X"] ^ set(own["X"])) | (kept["Y"] ^ set(own["Y"])) | (kept["N"] ^ set(own["N"]))
    off = max(abs(x.value - own[e].get(t, 0.0)) for e, terms in done.exact.own.items() for t, x in terms.items())
    told = f"wrong: {', '.join(sorted(wrong))}" if wrong else "exactly the true terms"
    return {"terms_of_exact_g": told, "wrong_terms": len(wrong), "largest_error_of_exact_g": off}


def _coverage(done: Study) -> float:
    """Share of the intervals of our networks' terms that hold the original coefficient, at the ship's inertia."""
    hits = []
    for found in done.trained:
        estimates = found.own
        for row in (*ROWS, SURGE_RR):
            e = estimates[row.equation].get(row.term)
            true = _estimate(done.exact, row, own=True).value
            if e is not None:
                hits.append(e.low <= true <= e.high)
    return float(np.mean(hits))


def _cells(done: Study, row: Row) -> dict[str, Any]:
    """A row of a table with ours beside it."""
    clarke, own = _estimate(done.exact, row), _estimate(done.exact, row, own=True)
    middle, low, high = _middle(done, row, own=True)
    sample = _estimate(done.trained[0], row, own=True)
    kept = [row.term in f.regression.equations[row.equation].estimates for f in done.trained]
    return {
        "coefficient": coefficient_name(row.equation, row.term),
        "regression [SI]": row.regression,
        "nondimensional": row.prime
        if row.printed
        else row.regression / si_unit(thesis_prime(), row.equation, row.term),
        "Clarke": "" if row.clarke is None else row.clarke,
        "estimated": row.estimated,
        "original": row.original,
        "exact g": clarke.value,
        "exact g, ship's inertia": own.value,
        "networks' g, ship's inertia, median": middle,
        "least": low,
        "largest": high,
        "kept by": f"{sum(kept)}/{len(kept)}",
        "95 % interval of one": f"{sample.low:.4g} .. {sample.high:.4g}" if kept[0] else "",
    }


def _statistics(done: Study) -> list[dict[str, Any]]:
    """How well terms can be told apart, and how well they fit."""
    sources = {"exact g": done.exact.regression, "published networks' g": done.eliminated}
    sources |= {"published networks' g, the thesis' terms": done.published}
    sources |= {f"our networks' g, start {k + 1}": f.regression for k, f in enumerate(done.trained)}
    return [
        {
            "regression of": name,
            "equation": letter,
            "terms kept": len(q.estimates),
            "R^2": q.r_squared,
            "condition number": q.condition,
            "largest variance inflation": max(e.inflation for e in q.estimates.values()),
            "residual": q.deviation,
        }
        for name, found in sources.items()
        for letter, q in found.equations.items()
    ]


def _lumped_plots(done: Study) -> list[Plot]:
    """Figs 5.13 and 5.14."""
    names = ("g1' [-]", "g2' [-]", "g3' [-]")
    pairs = zip(("exact", "published networks", "our networks, one start"), done.runs, strict=False)
    tuples = {name: to_tuples([run], done.known) for name, run in pairs}
    roles: Any = dict(zip(tuples, ("reference", "paper", "ours"), strict=True))
    lumped = [
        Panel("t [s]", label, [Line(n, t.times.numpy(), t.targets[:, k].numpy(), roles[n]) for n, t in tuples.items()])
        for k, label in enumerate(names)
    ]
    labels = ("u/U0 [-]", "v/U0 [-]", "r L/U0 [-]", "rudder, positive to port [deg]")
    units = (1.0, 1.0, 1.0, -DEGREE)
    motion = [
        Panel(
            "t [s]",
            label,
            [Line(n, t.times.numpy(), t.inputs[:, k].numpy() / unit, roles[n]) for n, t in tuples.items()],
        )
        for k, (label, unit) in enumerate(zip(labels, units, strict=True))
    ]
    return [
        Plot("figure_5_13", "Fig. 5.13: lumped nonlinear functions in the 35-35 zigzag", lumped),
        Plot("figure_5_14", "Fig. 5.14: velocities and rudder angle in the 35-35 zigzag", motion),
    ]


def _zigzag_plots(runs: Mapping[str, Sequence[Recording]], devs: Mapping[str, Sequence[float]]) -> list[Plot]:
    """Figs 5.15 to 5.19."""
    median = int(np.argsort(devs[OURS])[len(devs[OURS]) // 2])
    shown: dict[str, tuple[Any, Recording]] = {
        ORIGINAL: ("reference", runs[ORIGINAL][0]),
        PRINTED: ("paper", runs[PRINTED][0]),
        CORRECTED: ("other", runs[CORRECTED][0]),
        f"{OURS}, median": ("ours", runs[OURS][median]),
    }
    curves = {"u": ("surge velocity", "u [m/s]", 1.0), "v": ("sway velocity", "v [m/s]", 1.0)}
    curves |= {"r": ("yaw rate", "r [deg/s]", DEGREE), "psi": ("heading", "psi [deg]", DEGREE)}
    plots = []
    for number, (channel, (what, label, unit)) in enumerate(curves.items(), start=15):
        lines = [Line(name, run.time, run[channel] / unit, role) for name, (role, run) in shown.items()]
        plots.append(
            Plot(f"figure_5_{number}", f"Fig. 5.{number}: {what} in a 15-15 zigzag", [Panel("t [s]", label, lines)])
        )
    tracks = [Line(name, run["x"], run["y"], role) for name, (role, run) in shown.items()]
    track = Panel("x, north [m]", "y, east [m]", tracks, equal=True)
    return [*plots, Plot("figure_5_19", "Fig. 5.19: track of a 15-15 zigzag", [track])]
