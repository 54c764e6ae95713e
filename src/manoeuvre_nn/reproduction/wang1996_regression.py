"""Wang 1996, section 5.3: coefficients out of the lumped functions by regression, and a zigzag sailed with them."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.identification.derivatives import coefficient_name, si_unit
from manoeuvre_nn.identification.regression import Estimate
from manoeuvre_nn.recording.score import score
from manoeuvre_nn.recording.tuples import to_tuples
from manoeuvre_nn.reproduction.section import Claim, Effort, Line, Panel, Plot, Say, Section, compared
from manoeuvre_nn.reproduction.wang1996_regression_study import Found, Study, sailed, study, thesis_prime
from manoeuvre_nn.reproduction.wang1996_regression_tables import (
    INERTIA,
    ORIGINAL_SLIPS,
    ROWS,
    SLIPS,
    SURGE_RR,
    Row,
)
from manoeuvre_nn.ship.mariner import COEFFICIENTS

NOTHING = Estimate(0.0, 0.0, 0.0, 0.0, 1.0)
"""A coefficient whose term was dropped."""
ORIGINAL, PRINTED, CORRECTED = "original coefficients", "thesis, as printed", "thesis, slips corrected"
OURS, DIRECT = "ours, networks' g", "our networks"
UNLIKE = "the thesis' networks miss g by 1 %, enough to change terms that one zigzag hardly tells apart"


def regression(effort: Effort, say: Say) -> Section:
    """Section 5.3: Tables 5.1 to 5.3, eqs 5.1 to 5.3, Figs 5.13 to 5.19.

    Args:
        effort: How much computing it may take.
        say: Tells what is being done.

    Returns:
        The section.
    """
    done = study(effort, say)
    say("15-15 zigzags with the coefficients")
    runs = sailed(done)
    (reference,), length = runs[ORIGINAL], done.ship.particulars.length
    devs = {name: [score(r, reference, length).dev_L for r in some] for name, some in runs.items()}
    claims = [c for row in ROWS for c in _row_claims(done, row)]
    claims += [*_inertia_claims(done), *_equation_claims(done), *_text_claims(done, devs)]
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
    return Section(
        "Section 5.3: regression", summary, claims, tables, [*_lumped_plots(done), *_zigzag_plots(runs, devs)]
    )


def _estimate(of: Found, row: Row, *, own: bool = False) -> Estimate:
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


def _row_claims(done: Study, row: Row) -> list[Claim]:
    """The columns of a row: nondimensional, Clarke, estimated and original."""
    name = coefficient_name(row.equation, row.term)
    key, claims = (row.equation, row.term), []
    if row.regression:
        unit = si_unit(thesis_prime(), *key)
        why = SLIPS.get(key, "")
        claims.append(
            compared(row.table, f"{name}, nondimensional", row.prime, row.regression / unit, relative=0.005, why=why)
        )
    if row.clarke is not None:
        ours = done.known.coefficients[row.equation][row.term]
        claims.append(compared(row.table, f"{name}, Clarke", row.clarke, ours, within=2e-5))
    middle, low, high = _middle(done, row)
    like = _estimate(done.exact, row).value
    why = f"{low:.4g} to {high:.4g} over {len(done.trained)} networks, {like:.4g} from exact g: {UNLIKE}"
    if key in SLIPS:
        why += f"; {SLIPS[key]}"
    claims.append(
        compared(
            row.table, f"{name}, estimated", row.estimated, middle, within=1e-4, relative=0.1, direction=True, why=why
        )
    )
    exact, why = _estimate(done.exact, row, own=True).value, ORIGINAL_SLIPS.get(key, "")
    claims.append(
        compared(row.table, f"{name}, original; ours from exact g", row.original, exact, within=1e-4, why=why)
    )
    return claims


def _inertia_claims(done: Study) -> list[Claim]:
    """What is not regressed: Clarke's inertia beside the original's, and what the difference does."""
    clarke = dict(zip(("mx", "my", "mz"), done.known.inertia.diagonal().tolist(), strict=True))
    clarke |= {"Yrdot": -float(done.known.inertia[1, 2]), "Nvdot": -float(done.known.inertia[2, 1])}
    claims = [compared(t, f"{n}, Clarke", paper, clarke[k], within=2e-5) for n, (t, k, paper, _) in INERTIA.items()]
    row = next(r for r in ROWS if (r.equation, r.term) == ("N", "v"))
    own, other = _estimate(done.exact, row, own=True).value, _estimate(done.exact, row).value
    why = (
        f"even exact g gives N_v = {other:.5g} with Clarke's inertia and {own:.5g} with the ship's: they must be "
        "brought to one inertia, M_true M_Clarke^-1, before they are compared"
    )
    return [
        *claims,
        Claim(
            "Section 5.3",
            "estimated and original columns compare",
            "directly",
            "after M M_Clarke^-1",
            "does not hold",
            why,
        ),
    ]


def _equation_claims(done: Study) -> list[Claim]:
    """Eqs 5.1 to 5.3 beside a regression of the published networks' g on the same terms."""
    claims, prime = [], thesis_prime()
    for row in (*ROWS, SURGE_RR):
        if not row.regression:
            continue
        where = f"Eq 5.{'XYN'.index(row.equation) + 1}"
        found = done.published.equations[row.equation].estimates[row.term]
        unit = si_unit(prime, row.equation, row.term)
        why = f"95 % interval {found.low * unit:.4g} to {found.high * unit:.4g}; the thesis' outliers are not known"
        if row is SURGE_RR:
            why += f"; printed is .0012 in the prime system, ours {found.value:.4f}, original .01272: a digit lost?"
        what = f"{coefficient_name(row.equation, row.term)}, published networks' g, the thesis' terms"
        claims.append(
            compared(where, what, row.regression, found.value * unit, relative=0.15, direction=True, why=why, unit="SI")
        )
    return claims


def _text_claims(done: Study, devs: Mapping[str, Sequence[float]]) -> list[Claim]:
    """What the section says."""
    networks = [done.eliminated, *(f.regression for f in done.trained)]
    squared = min(q.r_squared for r in networks for q in r.equations.values())
    kept = sum(len(q.estimates) for q in done.eliminated.equations.values())
    thesis = sum(bool(r.regression) for r in (*ROWS, SURGE_RR))
    ours, good = _agreeing(done)
    held = _coverage(done)
    printed, corrected, own = devs[PRINTED][0], devs[CORRECTED][0], float(np.median(devs[OURS]))
    direct = float(np.median(devs[DIRECT]))
    spread = f"{min(devs[OURS]):.2g} to {max(devs[OURS]):.2g} L"
    return [
        *_exact_claims(done),
        Claim("Section 5.3", "least R^2", "> .95", squared, "holds" if squared > 0.95 else "does not hold"),
        Claim(
            "Section 5.3",
            "terms that p < .05 leaves of the published networks' g",
            float(thesis),
            float(kept),
            "does not hold",
            "residuals are small and smooth, so nearly every term is significant: the thesis took terms out by hand",
        ),
        Claim(
            "Section 5.3",
            "most estimated coefficients agree with the originals",
            "most",
            f"within 20 %: {sum(good)} of {len(good)} of the thesis, {sum(ours)} of {len(ours)} of ours",
            "holds" if sum(good) > len(good) / 2 else "does not hold",
            "linear and large ones do; Clarke's inertia changes the others, and " + UNLIKE,
        ),
        Claim(
            "Section 5.3",
            "p values tell which terms are right",
            "p < .05",
            f"{held:.0%} of the 95 % intervals hold the original",
            "holds" if held > 0.9 else "does not hold",
            "a network's errors follow one another smoothly; intervals take them for independent",
        ),
        Claim(
            "Figs 5.15-5.19",
            "zz15 fits well, coefficients as printed",
            "fits well",
            f"{printed:.3g} L off",
            _fits(printed),
        ),
        Claim(
            "Figs 5.15-5.19", "zz15 fits well, slips corrected", "fits well", f"{corrected:.3g} L off", _fits(corrected)
        ),
        Claim("Figs 5.15-5.19", "zz15 fits well, ours", "fits well", f"{own:.3g} L off ({spread})", _fits(own)),
        Claim(
            "Section 5.3",
            "zz15 by regression is less perfect than by the networks",
            "less perfect",
            f"{own:.3g} L, networks {direct:.3g} L",
            "holds" if own > direct else "does not hold",
            ""
            if own > direct
            else "this ship is a third-order polynomial: fitting one takes off what networks miss in between",
        ),
    ]


def _fits(dev: float) -> Any:
    return "holds" if dev < 0.2 else "holds in direction" if dev < 0.5 else "does not hold"


def _exact_claims(done: Study) -> list[Claim]:
    """What the method itself can do, with nothing but rounding in g."""
    own = {e: {"".join(sorted(t, key="0uvrd".index)): c for t, c in q.items()} for e, q in COEFFICIENTS.items()}
    kept = {e: set(q.estimates) for e, q in done.exact.regression.equations.items()}
    wrong = (kept["X"] ^ set(own["X"])) | (kept["Y"] ^ set(own["Y"])) | (kept["N"] ^ set(own["N"]))
    off = max(abs(x.value - own[e].get(t, 0.0)) for e, terms in done.exact.own.items() for t, x in terms.items())
    told = f"wrong: {', '.join(sorted(wrong))}" if wrong else "exactly the true terms"
    return [
        Claim("Section 5.3", "terms kept of exact g", "the right ones", told, "does not hold" if wrong else "holds"),
        compared("Section 5.3", "coefficients of exact g, largest error", 0.0, off, within=1e-4),
    ]


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
