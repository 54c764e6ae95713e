"""Rajesh & Bhattacharyya 2009, section 5.2.1: how many nodes the hidden layer needs (Fig. 3), over many starts."""

from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.manoeuvre.zigzag import zigzag
from studies.rajesh2009.networks import (
    Judged,
    Row,
    Setting,
    TankerNetworks,
    judged,
    networks,
    spread,
    starts,
    tracks,
)
from studies.reproduction.claims import read_claims
from studies.reproduction.section import ChapterResult, ComputingEffort, Line, Panel, Plot, Say

SIZES = (11, 15, 16, 26)
"""Nodes of the hidden layer with the bias, section 5.2.1."""
Values = Float[np.ndarray, " starts"]


OTHERWISE = {
    "m = 15, Nielsen's damping": Setting(rule="nielsen"),
    "m = 15, output layer solved exactly": Setting(rule="nielsen", exact=True),
    "m = 15, scaled, tanh, Nielsen": Setting(rule="nielsen", scaled=True, activation="tanh"),
}
"""Other ways to train, from the same manoeuvre."""


def chapter(effort: ComputingEffort, say: Say) -> ChapterResult:
    """Section 5.2.1, m = 11, 15, 16 and 26, networks by eqs 16-18, first rudder to starboard.

    Args:
        effort: How much computing is allowed.
        say: Told what is being done.

    Returns:
        Tolerances, epochs and Fig. 3 as distributions over the starts; other ways to train beside them.
    """
    return size_section("logistic nodes", Setting(), "starboard", OTHERWISE, effort, say)


def size_section(
    make: str, setting: Setting, first: str, others: dict[str, Setting], effort: ComputingEffort, say: Say
) -> ChapterResult:
    """Section 5.2.1 with networks of one make."""
    claims, trained = read_claims("rajesh2009", "5.2.1"), dict[int, TankerNetworks]()
    printed = {m: claims.limits[f"tolerance_{m}"] for m in SIZES}
    for m in SIZES:
        say(f"{starts(effort)} starts of m = {m}, {make}")
        trained[m] = networks(replace(setting, m=m), effort)
    also: dict[str, TankerNetworks] = {}
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
            _training(found, m=m, paper=printed[m], paper_epochs=int(claims.limits[f"epochs_{m}"]))
            for m, found in trained.items()
        ],
        "Training otherwise": [_training(found, network=name) for name, found in also.items()],
        "zz15, trained on zz20, dev [L]": [
            dict[str, Any](network=name) | spread(run.dev[0], run.left[0]) for name, run in beside.items()
        ],
    }
    best, worst, both = _ranks(dev)
    return ChapterResult(
        f"Section 5.2.1: nodes of the hidden layer (Fig. 3), {make}",
        f"Over draws of one start of each m, m = 15 is the best on zz15 with probability {best:.2f} and m = 26 the "
        f"worst with {worst:.2f}, both with {both:.2f} (chance 1/12): one training of each cannot tell.",
        claims.beside(_training_values(make, trained) | _size_values(dev, both, worst)),
        {heading: rows for heading, rows in tables.items() if rows},
        [_figure_3(make, runs), _starts_plot(make, trained, dev, printed)],
    )


def _training(found: TankerNetworks, **head: Any) -> Row:
    """Tolerance and pace of a setting, as cells."""
    reasons = found.solutions.reasons
    tries = found.solutions.tries.double().numpy() / np.maximum(found.epochs, 1.0)
    cells = spread(found.mse)
    pace = {"epochs": float(np.median(found.epochs)), "tries an epoch": float(np.median(tries))}
    return head | cells | pace | {"stopped by": ", ".join(sorted({reason.value for reason in reasons}))}


def _training_values(make: str, trained: dict[int, TankerNetworks]) -> dict[str, Any]:
    """Tolerances of all starts, and the epochs of the longest training."""
    found: dict[str, Any] = {f"mse_{m}": nets.mse for m, nets in trained.items()}
    return found | {"make": make} | {f"longest_{m}": nets.epochs.max() for m, nets in trained.items()}


def _ranks(dev: dict[int, Values]) -> tuple[float, float, float]:
    """Probability that m = 15 is best, that m = 26 is worst, and of both, over all draws of one start of each m."""
    draws = np.array(list(product(*(dev[m] for m in SIZES))))
    order = list(SIZES)
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


def _size_values(dev: dict[int, Values], both: float, worst: float) -> dict[str, float]:
    """Shares for the conclusions that are drawn from Fig. 3."""
    shares = {f"m_15_beats_{m}": beats(dev[15], dev[m]) for m in (11, 16)}
    return shares | {"m_26_is_worst": worst, "both": both}


def _figure_3(make: str, runs: dict[int, Judged]) -> Plot:
    panels = [tracks(run, 0, f"m = {m}") for m, run in runs.items()]
    return Plot("figure_3", f"Fig. 3: zz15 of networks trained on zz20, {make}", panels)


def _starts_plot(
    make: str, trained: dict[int, TankerNetworks], dev: dict[int, Values], printed: dict[int, float]
) -> Plot:
    """Every start as a point."""

    def points(values: dict[int, Values], label: str) -> Line:
        m = np.concatenate([np.full(len(v), float(k)) for k, v in values.items()])
        return Line(label, m, np.concatenate(list(values.values())), points=True)

    sizes, paper = np.array(SIZES, float), np.array([printed[m] for m in SIZES])
    errors = [points({m: f.mse for m, f in trained.items()}, "starts"), Line("paper", sizes, paper, "paper", True)]
    return Plot("sizes_over_starts", f"Section 5.2.1 over many starts, {make}: tolerance and dev on zz15", [
        Panel("m", "tolerance", errors, "training", log_y=True),
        Panel("m", "dev [L]", [points(dev, "starts")], "zz15", log_y=True),
    ])  # fmt: skip
