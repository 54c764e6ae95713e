"""Rajesh & Bhattacharyya 2009, section 5.3: what networks trained on zz20 at 16 kn predict (Figs 5 and 6)."""

from copy import deepcopy
from typing import Any

import numpy as np
import torch
from jaxtyping import Float

from manoeuvre_nn.core.manoeuvre import Manoeuvre
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import KNOT
from manoeuvre_nn.dynamics.limits import OK
from manoeuvre_nn.dynamics.model import CalmWater
from manoeuvre_nn.dynamics.rollout import roll_out
from manoeuvre_nn.dynamics.simulate import simulate
from manoeuvre_nn.manoeuvre.turning import turning_circle
from manoeuvre_nn.manoeuvre.zigzag import zigzag
from manoeuvre_nn.scoring.score import score
from manoeuvre_nn.ship.esso_190k import esso_190k
from manoeuvre_nn.ship.tanker import TankerShip
from studies.rajesh2009.networks import (
    BEAM,
    LENGTH,
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
from studies.reproduction.section import ChapterResult, ComputingEffort, Plot, Say

SERVICE = [zigzag(a, duration=2000.0 if a == 20.0 else 1500.0) for a in (20.0, 25.0, 15.0, 10.0)]
SERVICE += [turning_circle(a) for a in (15.0, 20.0, 25.0)]
"""At 16 kn; the first is the training manoeuvre, longer."""
SLOW_KN = (10.0, 5.0)
Dev = dict[str, Float[np.ndarray, " starts"]]


def slow_trials(speed_kn: float, shaft: str) -> list[Manoeuvre]:
    """zz20 and tc20 from a low speed: as long as at 16 kn with 80 rpm, in proportion with similarity rpm.

    Args:
        speed_kn: Approach speed [kn].
        shaft: ``hold`` or ``similarity``.

    Returns:
        The manoeuvres.
    """
    length = 1500.0 * (16.0 / speed_kn if shaft == "similarity" else 1.0)
    return [zigzag(20.0, duration=length), turning_circle(20.0, duration=length)]


def chapter(effort: ComputingEffort, say: Say) -> ChapterResult:
    """Section 5.3.

    Args:
        effort: How much computing is allowed.
        say: Told what is being done.

    Returns:
        Figs 5 and 6 as distributions over the starts.
    """
    claims = read_claims("rajesh2009", "5.3")
    say(f"{starts(effort)} starts of m = 15")
    found = networks(Setting(), effort)
    say("manoeuvres at 16 kn")
    fast = judged(found.models, SERVICE)
    slow: dict[tuple[float, str], Judged] = {}
    for shaft in ("hold", "similarity"):
        for speed in SLOW_KN:
            say(f"{speed:g} kn, rpm: {shaft}")
            slow[speed, shaft] = judged(found.models, slow_trials(speed, shaft), speed_kn=speed, shaft=shaft)  # type: ignore[arg-type]
    say("true terms by linear least squares")
    dev: Dev = {trial.name: fast.dev[k] for k, trial in enumerate(SERVICE)}
    for speed in SLOW_KN:
        dev |= {f"{t}20 {speed:g} kn": slow[speed, "hold"].dev[k] for k, t in enumerate(("zz", "tc"))}
    far = np.concatenate([slow[speed, "similarity"].dev for speed in SLOW_KN]).mean(1)
    return ChapterResult(
        "Section 5.3: other manoeuvres and lower speeds (Figs 5 and 6)",
        f"Medians at 16 kn: {_medians(dev)}. The slow runs rest on the shaft's constant 80 rpm: with rpm in proportion "
        f"to the speed the same networks are {far.min():.2g} to {far.max():.2g} L off.",
        claims.beside(_values(dev, _half_turn(slow[10.0, "hold"]), far, claims.limits["acceptable"])),
        _tables(found, fast, slow),
        [
            Plot(
                "figure_5",
                "Fig. 5: manoeuvres at 16 kn, trained on zz20",
                [tracks(fast, k, trial.name) for k, trial in enumerate(SERVICE) if k],
            ),
            _figure_6("figure_6", "Fig. 6: zz20 and tc20 from 10 and 5 kn at 80 rpm", slow, "hold"),
            _figure_6("figure_6_similarity", "The same with rpm in proportion to the speed", slow, "similarity"),
        ],
    )


def _figure_6(name: str, caption: str, slow: dict[tuple[float, str], Judged], shaft: str) -> Plot:
    panels = [
        tracks(slow[speed, shaft], k, f"{trial}20, {speed:g} kn")
        for k, trial in enumerate(("zz", "tc"))
        for speed in SLOW_KN
    ]
    return Plot(name, caption, panels)


def _medians(dev: Dev) -> str:
    return ", ".join(f"{trial.name} {np.median(dev[trial.name]):.2g} L" for trial in SERVICE)


def _share(values: Float[np.ndarray, " starts"], limit: float) -> float:
    return float((values <= limit).mean())


def _values(
    dev: Dev, half: Float[np.ndarray, " starts"], far: Float[np.ndarray, " runs"], acceptable: float
) -> dict[str, Any]:
    """Shares of the starts for what is said of Figs 5 and 6, and median deviations [L]."""
    pairs = np.stack([dev[name] for name in ("zz25", "zz15", "zz10", "tc15", "tc20", "tc25")])
    zz, tc = (np.stack([dev[f"{t}20 {kn:g} kn"] for kn in SLOW_KN]) for t in ("zz", "tc"))
    return {
        "beam": BEAM,
        "within_beam": {name: _share(values, BEAM) for name, values in dev.items()},
        "within": {name: _share(values, acceptable) for name, values in dev.items()},
        "median": {name: float(np.median(values)) for name, values in dev.items()},
        "zz10_is_worse": float((pairs[2] > np.maximum(pairs[0], pairs[1])).mean()),
        "tc25_is_the_poorest_turn": float((pairs[3:].argmax(0) == 2).mean()),
        "tc25_is_the_poorest": float((pairs.argmax(0) == 5).mean()),
        "zz10_is_the_poorest": float((pairs.argmax(0) == 2).mean()),
        "zz_kept": float((zz.max(0) <= 2 * dev["zz20"]).mean()),
        "turns_rise_more": float((tc.max(0) - dev["tc20"] > zz.max(0) - dev["zz20"]).mean()),
        "half_turn_within": _share(half, acceptable),
        "half_turn": float(np.median(half)),
        "tc20_5_kn_beyond": float((dev["tc20 5 kn"] > acceptable).mean()),
        "least_far": float(far.min()),
        "largest_far": float(far.max()),
    }


def _half_turn(judgement: Judged) -> Float[np.ndarray, " starts"]:
    """Largest distance of the turning circles up to 180 deg of heading [L]."""
    reference = judgement.references[1]
    end = float(np.interp(np.pi, reference["psi"], reference.time))
    part = reference.between(0.0, end)
    return np.array([score(run, part, LENGTH).dev_L for run in judgement.runs[1]])


def _tables(found: TankerNetworks, fast: Judged, slow: dict[tuple[float, str], Judged]) -> dict[str, list[dict]]:
    """Distributions, and what a linear fit of the true terms does beside them."""
    table = true_terms()
    fitted = _with_terms(esso_190k(), table)
    beside = roll_out(CalmWater(fitted), SERVICE)
    rows = []
    for k, (trial, run) in enumerate(zip(SERVICE, beside, strict=True)):
        rows.append({"manoeuvre": trial.name} | spread(fast.dev[k], fast.left[k]) | _linear(run, fast.references[k]))
    below = []
    for (speed, shaft), judgement in slow.items():
        ship = esso_190k(shaft=shaft).on_approach(speed * KNOT)  # type: ignore[arg-type]
        trials = [trial.at_speed(speed * KNOT) for trial in slow_trials(speed, shaft)]
        runs = roll_out(CalmWater(_with_terms(ship, table)), trials)
        for k, run in enumerate(runs):
            cells: Row = {"manoeuvre": run.name, "speed [kn]": speed, "rpm": ship.rpm}
            below.append(cells | spread(judgement.dev[k], judgement.left[k]) | _linear(run, judgement.references[k]))
    training = [{"m": 15} | spread(found.mse) | {"epochs": float(np.median(found.epochs))}]
    return {"Tolerance": training, "16 kn, dev [L]": rows, "10 and 5 kn, dev [L]": below}


def _linear(run: Recording, reference: Recording) -> dict[str, float]:
    assert run.status == OK
    return {"true terms, linear fit": score(run, reference, LENGTH).dev_L}


def true_terms() -> Float[torch.Tensor, "terms 3"]:
    """Coefficients of the 12 true products, n known, by linear least squares from the training manoeuvre.

    Returns:
        One column an equation.
    """
    ship = esso_190k()
    record = simulate(CalmWater(ship), zigzag(20.0, duration=1500.0))
    nu = torch.tensor(record.stacked("u", "v", "r"))
    products = ship.products(nu, torch.tensor(record["delta"]))
    size = products.square().mean(0).sqrt()
    forces = ship.force_from_acceleration(torch.tensor(record.stacked("udot", "vdot", "rdot")))
    return torch.linalg.lstsq(products / size, forces, driver="gelsd").solution / size[:, None]


def _with_terms(ship: TankerShip, table: Float[torch.Tensor, "terms 3"]) -> TankerShip:
    """A ship with other coefficients."""
    made = deepcopy(ship)
    made.coefficient_table = table
    return made
