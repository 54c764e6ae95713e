"""Wang 1996, chapter 7: its formulas, and whether autocorrelation and random decrement take the waves out."""

from itertools import product
from typing import Any

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.seakeeping.froude_krylov import encounter_frequency, sway_and_yaw
from manoeuvre_nn.ship.taylor import TaylorShip
from studies.wang1996.free_decay import Modes, autocorrelation, free_modes, random_decrement
from studies.wang1996.sway_yaw import (
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

COMPARED = 30.0
"""Lags at which autocorrelations are laid beside their formulas [s]."""
ALIKE = 50.0
"""Lags at which autocorrelations with and without waves are laid side by side [s]."""


def coupled_values(ship: TaylorShip, system: System) -> dict[str, Any]:
    """Section 7.3: roots, and the constants of the free motion.

    Args:
        ship: The Mariner.
        system: The linear system.

    Returns:
        Roots of the equations as printed and with Y_r - m u0, accelerations at the start, and amplitudes.
    """
    printed = linear(ship, bare=True).matrix
    assert system.matrix is not None and printed is not None
    modes, roots = free_modes(system.matrix, START), np.linalg.eigvals(printed)
    (fast, slow), (vdot, rdot) = modes.rates.tolist(), (system.matrix @ START).tolist()
    real = not roots.imag.any()
    return {
        "printed_roots": "real" if real else f"{roots[0].real:.4f} +- {abs(roots[0].imag):.4f} i 1/s",
        "printed_roots_are_real": real,
        "fast": fast,
        "slow": slow,
        "roots_decay": fast < slow < 0,
        "vdot": vdot,
        "rdot": rdot,
        "amplitudes": _amplitudes(modes),
    }


def _amplitudes(modes: Modes) -> list[dict[str, Any]]:
    """Eqs 7.41-7.44, which take the accelerations at the start as 0, beside the amplitudes that meet the equations."""
    fast, slow = modes.rates.tolist()
    return [
        {
            "equation": f"7.{41 + 2 * i + k}",
            "letter": f"{letter}{k + 1}",
            "assumed": float(START[i]) * share / (slow - fast),
            "amplitude": float(modes.amplitudes[i, k]),
            "unit": unit,
        }
        for i, (letter, unit) in enumerate((("c", "m/s"), ("d", "rad/s")))
        for k, share in enumerate((slow, -fast))
    ]


def formula_errors(system: System, voyages: Voyages) -> dict[str, float]:
    """The free motion and its autocorrelation beside the formulas.

    Args:
        system: The simplest or the linear system.
        voyages: Its motions.

    Returns:
        Largest error of the motion over its start, and of the autocorrelation over that at lag 0 [-].
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
    return {"motion_error": error, "correlation_error": differs}


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


def likeness_values(name: str, voyages: Voyages) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Whether autocorrelation takes the waves out.

    Args:
        name: The system.
        voyages: Its motions.

    Returns:
        Median differences for each angle [-], and rows with the spread over the seas for both observation times.
    """
    medians, rows = [], []
    for angle, duration in product(ANGLES_DEG, (DURATION, LONG)):
        low, median, high = np.percentile(likeness(voyages, angle, duration), [5, 50, 95], axis=0).tolist()
        for i, channel in enumerate(("v", "r")):
            key = {"system": name, "angle [deg]": angle, "T* [s]": duration, "of": channel}
            rows.append(key | {"median": median[i], "5 %": low[i], "95 %": high[i]})
        if duration == DURATION:
            v, r = median
            medians.append({"system": name, "angle": angle, "v": v, "r": r, "larger": max(median)})
    return medians, rows


def share_folded(voyages: Voyages) -> float:
    """Section 7.2.2: why the points of Fig 7.11 leave the line.

    Args:
        voyages: Motions of the simplest system.

    Returns:
        Share of the seas from 45 deg whose autocorrelations are negative somewhere at lags up to 100 s [-].
    """
    record = np.moveaxis(voyages.waves[ANGLES_DEG[0]], -1, 1)
    return float((autocorrelation(record, voyages.until(DURATION) - 1) < 0).any((-2, -1)).mean())


def stationary_values(ship: TaylorShip, system: System, seed: int) -> dict[str, float]:
    """Chapter 8: the random decrement of a long record in waves, in which no start is left.

    Args:
        ship: The Mariner.
        system: The simplest system.
        seed: Seed of the sea.

    Returns:
        Number of pieces, and root mean square differences of the signature from the autocorrelation and from the free
        decay, over the level [-].
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
    return {"pieces": count, "off_correlation": first, "off_decay": second}
