"""Wang 1996, chapter 7: its formulas, and whether autocorrelation and random decrement take the waves out."""

from itertools import product
from typing import Any

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.identification.random_decrement import Modes, autocorrelation, free_modes, random_decrement
from manoeuvre_nn.reproduction.section import Claim, Verdict, compared
from manoeuvre_nn.reproduction.wang1996_sway_yaw import (
    ANGLES_DEG,
    DURATION,
    LONG,
    START,
    System,
    Voyages,
    hull,
    linear,
    sea,
    to_heading,
)
from manoeuvre_nn.seakeeping.froude_krylov import encounter_frequency, sway_and_yaw
from manoeuvre_nn.ship.taylor import TaylorShip

COMPARED = 30.0
"""Lags at which autocorrelations are laid beside their formulas [s]."""
ALIKE = 50.0
"""Lags at which autocorrelations with and without waves are laid side by side [s]."""


def coupled_constants(ship: TaylorShip, system: System) -> list[Claim]:
    """Section 7.3: roots, and the constants of the free motion.

    Args:
        ship: The Mariner.
        system: The linear system.

    Returns:
        The claims.
    """
    printed = linear(ship, bare=True).matrix
    assert system.matrix is not None and printed is not None
    modes, roots = free_modes(system.matrix, START), np.linalg.eigvals(printed)
    (fast, slow), (vdot, rdot) = modes.rates.tolist(), (system.matrix @ START).tolist()
    real = np.isrealobj(roots)
    claims = [
        Claim("Eqs 7.35-7.38", "roots of the equations as printed", "lambda1 < lambda2 < 0, real",
              "real" if real else f"{roots[0].real:.4f} +- {abs(roots[0].imag):.4f} i 1/s",
              "holds" if real else "does not hold",
              f"Y_r stands for Y_r - m u0, which gives {fast:.5f} and {slow:.5f} 1/s"),
        Claim("Eqs 7.33-7.38", "roots with Y_r - m u0", "lambda1 < lambda2 < 0, real", f"{fast:.5f} and {slow:.5f} 1/s",
              "holds" if fast < slow < 0 else "does not hold"),
        compared("Section 7.3", "sway acceleration at the start", 0.0, vdot, within=1e-4, unit="m/s^2",
                 why="a first-order system has no free choice of it: a11 v0 + a12 r0"),
        compared("Section 7.3", "yaw acceleration at the start", 0.0, rdot, within=1e-6, unit="rad/s^2",
                 why="a first-order system has no free choice of it: a21 v0 + a22 r0"),
    ]  # fmt: skip
    return claims + _amplitudes(modes)


def _amplitudes(modes: Modes) -> list[Claim]:
    """Eqs 7.41-7.44 beside the amplitudes that meet the equations of motion at the start."""
    fast, slow = modes.rates.tolist()
    why = "the equation takes the acceleration at the start as 0"
    claims = []
    for i, (letter, unit) in enumerate((("c", "m/s"), ("d", "rad/s"))):
        for k, share in enumerate((slow, -fast)):
            assumed, ours = float(START[i]) * share / (slow - fast), float(modes.amplitudes[i, k])
            where = f"Eq 7.{41 + 2 * i + k}"
            claims.append(
                compared(where, f"{letter}{k + 1}", assumed, ours, relative=0.01, direction=True, why=why, unit=unit)
            )
    return claims


def closed_forms(system: System, voyages: Voyages, where: str) -> list[Claim]:
    """The free motion and its autocorrelation beside the formulas.

    Args:
        system: The simplest or the linear system.
        voyages: Its motions.
        where: Equations of the formulas.

    Returns:
        The claims.
    """
    assert system.matrix is not None
    modes = free_modes(system.matrix, START)
    motion = modes.motion(voyages.time).T
    error = float((np.abs(voyages.free - motion).max(0) / np.abs(START)).max())
    lags = voyages.until(COMPARED) - 1
    ours = autocorrelation(voyages.free.T, lags)
    formula = modes.autocorrelation(voyages.time[: lags + 1], LONG)
    # The sum over samples counts the first one whole: for the faster decay that is STEP / 9.3 s, 2.7 %.
    differs = float((np.abs(ours - formula).max(-1) / formula[:, 0]).max())
    return [
        compared(where, f"free motion of the {system.name} system beside the formula", 0.0, error, within=1e-5),
        compared(where, f"its autocorrelation beside the formula, T* {LONG:g} s", 0.0, differs, within=0.03),
    ]


def likeness(voyages: Voyages, angle: float, duration: float) -> Float[np.ndarray, "seas 2"]:
    """How far autocorrelations in waves are from those without.

    Args:
        voyages: Motions.
        angle: Angle of the waves [deg].
        duration: Observation time [s].

    Returns:
        Root mean square of the difference over that of the free one [-], for v and r, at lags up to 50 s.
    """
    count, lags = voyages.until(duration), voyages.until(ALIKE) - 1
    free = autocorrelation(voyages.free[:count].T, lags)
    waves = autocorrelation(np.moveaxis(voyages.waves[angle][:, :count], -1, 1), lags)
    return np.sqrt(((waves - free) ** 2).mean(-1) / (free**2).mean(-1))


def likeness_claims(name: str, where: str, voyages: Voyages) -> tuple[list[Claim], list[dict[str, Any]]]:
    """Whether autocorrelation takes the waves out.

    Args:
        name: The system.
        where: Figures.
        voyages: Its motions.

    Returns:
        A claim for each angle, and the spread over the seas: a difference below .1 holds, below .3 in direction.
    """
    claims, rows = [], []
    for angle, duration in product(ANGLES_DEG, (DURATION, LONG)):
        low, median, high = np.percentile(likeness(voyages, angle, duration), [5, 50, 95], axis=0).tolist()
        for i, channel in enumerate(("v", "r")):
            key = {"system": name, "angle [deg]": angle, "T* [s]": duration, "of": channel}
            rows.append(key | {"median": median[i], "5 %": low[i], "95 %": high[i]})
        if duration == DURATION:
            worst, what = max(median), f"autocorrelations of the {name} system, {angle:g} deg"
            verdict: Verdict = "holds" if worst < 0.1 else "holds in direction" if worst < 0.3 else "does not hold"
            ours = f"they differ by {median[0]:.0%} (v) and {median[1]:.0%} (r), median over the seas"
            why = "" if verdict == "holds" else "the waves' own autocorrelation stays, the more the longer the record"
            claims.append(Claim(where, what, "fit those without waves well", ours, verdict, why))
    return claims, rows


def folded(voyages: Voyages) -> Claim:
    """Section 7.2.2: why the points of Fig 7.11 leave the line.

    Args:
        voyages: Motions of the simplest system.

    Returns:
        The claim.
    """
    record = np.moveaxis(voyages.waves[ANGLES_DEG[0]], -1, 1)
    share = float((autocorrelation(record, voyages.until(DURATION) - 1) < 0).any((-2, -1)).mean())
    paper = "autocorrelations swing about 0 and the logarithm folds them up"
    ours = f"negative somewhere at lags up to 100 s in {share:.0%} of the seas at 45 deg"
    return Claim("Fig 7.11", "points that leave the line", paper, ours, "holds" if share > 0.5 else "does not hold")


def offset(voyages: Voyages) -> Claim:
    """Section 7.4: where the free nonlinear motion ends.

    Args:
        voyages: Motions of the nonlinear system.

    Returns:
        The claim.
    """
    v, r = voyages.free[-1]
    ours = f"after {LONG:g} s v = {v:.3f} m/s and r = {r:.5f} rad/s, not 0"
    why = "the constants Y0 and N0 turn the ship, and its autocorrelation keeps their square"
    return Claim("Figs 7.16, 7.17", "end of the free motion", "not discussed", ours, "not comparable", why)


def stationary(ship: TaylorShip, system: System, seed: int) -> list[Claim]:
    """Chapter 8: the random decrement of a long record in waves, in which no start is left.

    Args:
        ship: The Mariner.
        system: The simplest system.
        seed: Seed of the sea.

    Returns:
        The claims.
    """
    assert system.matrix is not None
    heading, rate, p = to_heading(ANGLES_DEG[0]), float(system.matrix[0, 0]), ship.particulars
    waves, time = sea(1, seed, 200), np.arange(0, 7200, 0.5)  # so many waves do not repeat themselves
    met = encounter_frequency(waves.frequency, heading, p.speed)
    force = sway_and_yaw(hull(ship), waves.frequency, heading, p.rho)[0] / ship.prime.force
    record = waves.record(time, force * system.share[0, 0] / (1j * met - rate), met)[0]
    level, lags = float(record.std()), 60
    signature, count = random_decrement(record, level, lags)
    relation, decay = autocorrelation(record, lags), level * np.exp(rate * time[: lags + 1])
    first, second = (
        float(np.sqrt(np.mean((signature - x) ** 2)) / level) for x in (level * relation / relation[0], decay)
    )
    where = "Chapter 8"
    return [
        compared(where, f"signature of v over 2 h ({count} pieces), beside x0 R/R(0)", 0.0, first, within=0.1),
        Claim(where, "signature of v over 2 h, beside the free decay", "random decrement gives the free motion",
              f"differs by {second:.2f} of its start", "holds" if second < 0.1 else "does not hold",
              "it is the autocorrelation of the response, and waves are no white noise: it swings with them"),
    ]  # fmt: skip
