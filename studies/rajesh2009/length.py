"""Rajesh & Bhattacharyya 2009, section 5.2.2: how long a training record must be (Fig. 4), over many starts."""

from itertools import product

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from studies.rajesh2009.networks import (
    BEAM,
    LENGTH,
    Judged,
    Setting,
    judged,
    networks,
    spread,
    starts,
    track,
)
from studies.reproduction.claims import read_claims
from studies.reproduction.section import ChapterResult, ComputingEffort, Line, Panel, Plot, Say

LENGTHS = (1000.0, 1200.0, 1500.0)
"""Lengths of the training record [s], section 5.2.2."""
Values = Float[np.ndarray, " starts"]


def chapter(effort: ComputingEffort, say: Say) -> ChapterResult:
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
    departures = []
    for length, since in ((1000.0, 1200.0), (1200.0, 1400.0)):
        times = _departures(runs[length])
        share = float(((times >= since) & np.isfinite(times)).mean())
        departures.append({"length": length, "since": since, "share": share, "never": int(np.isinf(times).sum())})
    shares = {"ordered": ordered, "within_a_beam": float((dev[1500.0] < BEAM).mean())}
    claims = read_claims("rajesh2009", "5.2.2").beside(shares | {"departures": departures, "beam": BEAM})
    return ChapterResult(
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
