"""Rajesh & Bhattacharyya 2009, section 5.2: how many nodes (Fig. 3), how long a record (Fig. 4), over many starts."""

from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.reproduction.rajesh2009_networks import (
    BEAM,
    LENGTH,
    Judged,
    Networks,
    Row,
    Setting,
    judged,
    networks,
    often,
    spread,
    starts,
    track,
    tracks,
    within_starts,
)
from manoeuvre_nn.reproduction.section import Claim, Effort, Line, Panel, Plot, Say, Section

PRINTED = {11: (3.77e-10, 17077), 15: (7.5276e-10, 30000), 16: (3.613e-11, 30000), 26: (1e-11, 1789)}
"""m -> tolerance and epochs of the paper, section 5.2.1."""
LENGTHS = (1000.0, 1200.0, 1500.0)
"""Lengths of the training record [s], section 5.2.2."""
Values = Float[np.ndarray, " starts"]


OTHERWISE = {
    "m = 15, Nielsen's damping": Setting(rule="nielsen"),
    "m = 15, output layer solved exactly": Setting(rule="nielsen", exact=True),
    "m = 15, scaled, tanh, Nielsen": Setting(rule="nielsen", scaled=True, activation="tanh"),
}
"""Other ways to train, from the same manoeuvre."""


def size_chapter(effort: Effort, say: Say) -> Section:
    """Section 5.2.1, m = 11, 15, 16 and 26, networks by eqs 16-18, first rudder to starboard.

    Args:
        effort: How much computing is allowed.
        say: Told what is being done.

    Returns:
        Tolerances, epochs and Fig. 3 as distributions over the starts; other ways to train beside them.
    """
    return _sizes("logistic nodes", Setting(), "starboard", OTHERWISE, effort, say)


def tanh_size_chapter(effort: Effort, say: Say) -> Section:
    """The same with networks as Table 2 shows them: tanh nodes, first rudder to port.

    Args:
        effort: How much computing is allowed.
        say: Told what is being done.

    Returns:
        Tolerances, epochs and Fig. 3 as distributions over the starts.
    """
    trained_on = zigzag(20.0, first="port", duration=1500.0)
    return _sizes("tanh nodes", Setting(manoeuvre=trained_on, activation="tanh"), "port", {}, effort, say)


def _sizes(make: str, setting: Setting, first: str, others: dict[str, Setting], effort: Effort, say: Say) -> Section:
    """Section 5.2.1 with networks of one make."""
    trained: dict[int, Networks] = {}
    for m in PRINTED:
        say(f"{starts(effort)} starts of m = {m}, {make}")
        trained[m] = networks(replace(setting, m=m), effort)
    also: dict[str, Networks] = {}
    for name, other in others.items():
        say(f"{starts(effort)} starts of {name}")
        also[name] = networks(other, effort)
    say("zz15 of all of them in closed loop")
    test = [zigzag(15.0, first=first, duration=1500.0)]
    runs = {m: judged(found.models, test) for m, found in trained.items()}
    beside = {f"m = {m}": run for m, run in runs.items()}
    beside |= {name: judged(found.models, test) for name, found in also.items()}
    dev = {m: run.dev[0] for m, run in runs.items()}
    tables = {
        f"Training, TRAINLM's damping, {make}, data in BIS units": [
            _training(found, m=m, paper=PRINTED[m][0], paper_epochs=PRINTED[m][1]) for m, found in trained.items()
        ],
        "Training otherwise": [_training(found, network=name) for name, found in also.items()],
        "zz15, trained on zz20, dev [L]": [
            dict[str, Any](network=name) | spread(run.dev[0], run.left[0]) for name, run in beside.items()
        ],
    }
    best, worst, both = _ranks(dev)
    return Section(
        f"Section 5.2.1: nodes of the hidden layer (Fig. 3), {make}",
        f"Over draws of one start of each m, m = 15 is the best on zz15 with probability {best:.2f} and m = 26 the "
        f"worst with {worst:.2f}, both with {both:.2f} (chance 1/12): one training of each cannot tell.",
        _training_claims(make, trained) + _size_claims(dev, both, worst),
        {heading: rows for heading, rows in tables.items() if rows},
        [_figure_3(make, runs), _starts_plot(make, trained, dev)],
    )


def _training(found: Networks, **head: Any) -> Row:
    """Tolerance and pace of a setting, as cells."""
    reasons = found.solutions.reasons
    tries = found.solutions.tries.double().numpy() / np.maximum(found.epochs, 1.0)
    cells = spread(found.mse)
    pace = {"epochs": float(np.median(found.epochs)), "tries an epoch": float(np.median(tries))}
    return head | cells | pace | {"stopped by": ", ".join(sorted({reason.value for reason in reasons}))}


def _training_claims(make: str, trained: dict[int, Networks]) -> list[Claim]:
    """Printed tolerances beside ours."""
    claims = []
    for m, found in trained.items():
        tolerance, epochs = PRINTED[m]
        why = f"{make}, at most {found.epochs.max():.0f} epochs; the paper has one start, of {epochs}"
        claims.append(within_starts("Section 5.2.1", f"tolerance, m = {m}", tolerance, found.mse, why))
    return claims


def _ranks(dev: dict[int, Values]) -> tuple[float, float, float]:
    """Probability that m = 15 is best, that m = 26 is worst, and of both, over all draws of one start of each m."""
    draws = np.array(list(product(*(dev[m] for m in PRINTED))))
    order = list(PRINTED)
    best, worst = draws.argmin(1) == order.index(15), draws.argmax(1) == order.index(26)
    return float(best.mean()), float(worst.mean()), float((best & worst).mean())


def beats(better: Values, worse: Values) -> float:
    """How often a start of one kind is nearer to the track than a start of another.

    Args:
        better: Deviations of the one.
        worse: Of the other.

    Returns:
        Share of all pairs [-].
    """
    return float((better[:, None] < worse).mean())


def _size_claims(dev: dict[int, Values], both: float, worst: float) -> list[Claim]:
    """The conclusions that are drawn from Fig. 3."""
    where, why = "Fig. 3", "judged by the largest distance of the tracks on zz15, over all draws of one start of each m"
    shares = beats(dev[15], dev[16]), beats(dev[15], dev[11])
    return [
        often(where, "m = 15 and 16", "15 is more accurate", shares[0], 0.5, why),
        often(where, "m = 15 and 11", "11 performs badly", shares[1], 0.5, why),
        often(where, "m = 26", "performs worst of the four", worst, 0.25, why),
        often(where, "m = 15 and 26", "15 is the best and 26 the worst of the four", both, 1 / 12, why),
    ]


def _figure_3(make: str, runs: dict[int, Judged]) -> Plot:
    panels = [tracks(run, 0, f"m = {m}") for m, run in runs.items()]
    return Plot("figure_3", f"Fig. 3: zz15 of networks trained on zz20, {make}", panels)


def _starts_plot(make: str, trained: dict[int, Networks], dev: dict[int, Values]) -> Plot:
    """Every start as a point."""

    def points(values: dict[int, Values], label: str) -> Line:
        m = np.concatenate([np.full(len(v), float(k)) for k, v in values.items()])
        return Line(label, m, np.concatenate(list(values.values())), points=True)

    sizes, paper = np.array(list(PRINTED), float), np.array([p[0] for p in PRINTED.values()])
    errors = [points({m: f.mse for m, f in trained.items()}, "starts"), Line("paper", sizes, paper, "paper", True)]
    return Plot("sizes_over_starts", f"Section 5.2.1 over many starts, {make}: tolerance and dev on zz15", [
        Panel("m", "tolerance", errors, "training", log_y=True),
        Panel("m", "dev [L]", [points(dev, "starts")], "zz15", log_y=True),
    ])  # fmt: skip


def length_chapter(effort: Effort, say: Say) -> Section:
    """Section 5.2.2, records of 1000, 1200 and 1500 s.

    Args:
        effort: How much computing is allowed.
        say: Told what is being done.

    Returns:
        Fig. 4 as distributions over the starts.
    """
    runs: dict[float, Judged] = {}
    for length in LENGTHS:
        say(f"{starts(effort)} starts on {length:g} s, then zz20 of 2000 s")
        found = networks(Setting(manoeuvre=zigzag(20.0, duration=length)), effort)
        runs[length] = judged(found.models, [zigzag(20.0, duration=2000.0)])
    dev = {length: run.dev[0] for length, run in runs.items()}
    draws = np.array(list(product(*(dev[length] for length in LENGTHS))))
    ordered = float((np.diff(draws, axis=1) < 0).all(1).mean())
    where, why = "Fig. 4", "judged by the largest distance of the tracks in 2000 s"
    claims = [
        often(where, "1000, 1200 and 1500 s", "each longer record is better", ordered, 1 / 6, why),
        often(where, "1500 s", "good up to 2000 s", float((dev[1500.0] < BEAM).mean()), None, f"within {BEAM:.2g} L"),
    ]
    for length, since in ((1000.0, 1200.0), (1200.0, 1400.0)):
        times = _departures(runs[length])
        share = float(((times >= since) & np.isfinite(times)).mean())
        typical = f"first more than a beam, {BEAM:.2g} L, away; {np.isinf(times).sum()} starts never are"
        claims.append(often(where, f"{length:g} s", f"departs after {since:g} s", share, None, typical))
    return Section(
        "Section 5.2.2: length of the training record (Fig. 4)",
        "Median deviation of zz20 in 2000 s: "
        + ", ".join(f"{np.median(values):.3g} L from {length:g} s" for length, values in dev.items())
        + ".",
        claims,
        {"zz20 of 2000 s, dev [L]": [{"record [s]": k} | spread(r.dev[0], r.left[0]) for k, r in runs.items()]},
        [_figure_4(runs)],
    )


def _departures(judgement: Judged) -> Values:
    """When each track first is more than a beam from the reference [s]; infinite if it never is."""
    reference, times = judgement.references[0], []
    for run in judgement.runs[0]:
        x, y = (np.interp(reference.time, run.time, run[name]) for name in ("x", "y"))
        far = np.hypot(x - reference["x"], y - reference["y"]) > BEAM * LENGTH
        times.append(float(reference.time[far.argmax()]) if far.any() else np.inf)
    return np.array(times)


def _figure_4(runs: dict[float, Judged]) -> Plot:
    """Tracks, and surge over time."""
    reference = runs[LENGTHS[0]].references[0]
    path, surge = [track(reference, "reference", "reference")], [Line("", reference.time, reference["u"], "reference")]
    heading = [Line("", reference.time, reference["psi"] / DEGREE, "reference")]
    for length, run in runs.items():
        typical = run.typical(0)
        path.append(track(typical, f"{length:g} s"))
        surge.append(Line(f"{length:g} s", typical.time, typical["u"]))
        heading.append(Line(f"{length:g} s", typical.time, typical["psi"] / DEGREE))
    return Plot("figure_4", "Fig. 4: zz20 of 2000 s, networks trained on 1000, 1200 and 1500 s of it (median starts)", [
        Panel("y [L]", "x [L]", path, "track", equal=True),
        Panel("time [s]", "u [m/s]", surge, "surge"),
        Panel("time [s]", "heading [deg]", heading, "heading"),
    ])  # fmt: skip
