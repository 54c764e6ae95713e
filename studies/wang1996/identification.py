"""Wang 1996, sections 7.2, 7.3 and 7.5: what can be identified from autocorrelations."""

from collections.abc import Mapping
from itertools import product
from typing import Any

import numpy as np
from jaxtyping import Float

from studies.wang1996.free_decay import autocorrelation, correlations, decay_rate, motion_matrix
from studies.wang1996.sway_yaw import ANGLES_DEG, DURATION, LONG, STEP, System, Voyages

SPANS = (30.0, 15.0)
"""Lags over which the logarithms of R_vv and R_rr are fitted [s], about one decay and a half."""
GROUP = 20
"""Records in an average."""
LAGS, STRIDE = 60.0, 10.0
"""Lags of the coupled identification [s], and its step between lags [s]."""
NEAR = 0.10
"""Error within which a rate counts as identified [-]."""


def averaged(values: Float[np.ndarray, "seas ..."]) -> Float[np.ndarray, "groups ..."]:
    """Means over groups of records.

    Args:
        values: A row for each record.

    Returns:
        A row for each group.
    """
    return np.asarray(values.reshape(-1, GROUP, *values.shape[1:]).mean(1))


def simple_rates(voyages: Voyages, angle: float, channel: int, duration: float) -> dict[str, tuple[Any, Any]]:
    """Rates of the simplest system from one record, from averages of autocorrelations and of the records themselves.

    Args:
        voyages: Motions of the simplest system.
        angle: Angle of the waves [deg].
        channel: 0 for v, 1 for r.
        duration: Observation time [s].

    Returns:
        Way -> rates [1/s], and whether the curve keeps its sign, so that nothing is folded.
    """
    lags = voyages.until(SPANS[channel]) - 1
    record = voyages.waves[angle][:, : voyages.until(duration), channel]
    one = autocorrelation(record, lags)
    ways = {"one record": one, "20 autocorrelations": averaged(one), "20 records": averaged(record[:, : lags + 1])}
    return {name: (decay_rate(c, STEP), (c * c[:, :1] > 0).all(-1)) for name, c in ways.items()}


def coupled_rates(voyages: Voyages, angle: float, duration: float) -> dict[str, Float[np.ndarray, "some 4"]]:
    """a11, a22, lambda1 and lambda2 of the linear system in the same three ways.

    Args:
        voyages: Motions of the linear system.
        angle: Angle of the waves [deg].
        duration: Observation time [s].

    Returns:
        Way -> a row for each identification [1/s]; not a number where there is no such system.
    """
    motion = voyages.waves[angle][:, : voyages.until(duration)]
    one = coupled_correlations(voyages, motion)
    ways = {
        "one record": one,
        "20 autocorrelations": averaged(one),
        "20 records": coupled_correlations(voyages, averaged(motion)),
    }
    return {name: coupled_values(motion_matrix(c, STEP, int(STRIDE / STEP))) for name, c in ways.items()}


def coupled_correlations(
    voyages: Voyages, motion: Float[np.ndarray, "some times 2"]
) -> Float[np.ndarray, "some lags 2 2"]:
    """Correlation functions that the coupled system is identified from.

    Args:
        voyages: Motions of the linear system.
        motion: Records.

    Returns:
        Correlations.
    """
    return correlations(motion, voyages.until(LAGS) - 1, "common")


def coupled_values(matrices: Float[np.ndarray, "some 2 2"]) -> Float[np.ndarray, "some 4"]:
    """a11, a22 and the roots of each matrix.

    Args:
        matrices: A [1/s].

    Returns:
        Rows a11, a22, lambda1, lambda2 [1/s]; roots that are not real are not a number.
    """
    values = np.full((len(matrices), 4), np.nan)
    sound = np.isfinite(matrices).all((-2, -1))
    roots = np.sort_complex(np.linalg.eigvals(matrices[sound]))
    real = np.where(np.abs(roots.imag) < 1e-9, roots.real, np.nan)
    values[sound] = np.column_stack([matrices[sound, 0, 0], matrices[sound, 1, 1], real])
    return values


def spread(values: Float[np.ndarray, " some"], truth: float) -> dict[str, float | None]:
    """Distribution of an identified rate.

    Args:
        values: Rates [1/s], not a number where there is none.
        truth: What they should be [1/s].

    Returns:
        Columns of a table; percentiles are None where no identification gave a rate.
    """
    finite = values[np.isfinite(values)]
    low, median, high = np.percentile(finite, [5, 50, 95]).tolist() if len(finite) else (None,) * 3
    near = float(np.mean(np.isfinite(values) & (np.abs(values - truth) <= NEAR * abs(truth))))
    numbers = {"true": truth, "median": median, "5 %": low, "95 %": high, "within 10 %": near}
    return numbers | {"none": 1 - len(finite) / len(values)}


def _item(key: Mapping[str, Any], row: Mapping[str, Any], count: int) -> dict[str, Any]:
    """An identified rate for a claim: its distribution in words, and the share that is within 10 %."""
    none = row["none"]
    found = "no rate" if row["median"] is None else f"{row['median']:.4f} ({row['5 %']:.4f} to {row['95 %']:.4f})"
    without = f"; {none:.0%} give no real rate" if none else ""
    named = {"rate": key["rate"], "angle": key["angle [deg]"], "way": key["from"]}
    return named | {"found": found, "near": row["within 10 %"], "count": count, "without": without}


def simple_identification(system: System, voyages: Voyages) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Section 7.2: a11 and a22 of the simplest system, with and without waves.

    Args:
        system: The simplest system.
        voyages: Its motions.

    Returns:
        Slopes without waves and rates from waves, and rows with the spread over the seas for both observation times.
    """
    assert system.matrix is not None
    slopes: list[dict[str, Any]] = []
    one: list[dict[str, Any]] = []
    averages: list[dict[str, Any]] = []
    rows: list[dict[str, Any]] = []
    for channel, truth in enumerate(np.diag(system.matrix).tolist()):
        name = f"a{channel + 1}{channel + 1}"
        slopes.append({"rate": name, "truth": truth} | _free_slopes(voyages, channel))
        for angle, duration in product(ANGLES_DEG, (DURATION, LONG)):
            for way, (rates, unfolded) in simple_rates(voyages, angle, channel, duration).items():
                row = spread(rates, truth)
                key = {"rate": name, "angle [deg]": angle, "T* [s]": duration, "from": way}
                rows.append(key | row | {"folded": 1 - float(unfolded.mean())})
                if duration == DURATION and way != "20 records":
                    (one if way == "one record" else averages).append(_item(key, row, len(rates)))
    return {"slopes": slopes, "simple_by_one_record": one, "simple_by_averages": averages}, rows


def _free_slopes(voyages: Voyages, channel: int) -> dict[str, float]:
    """Slopes of the logarithms without waves [1/s], with both windows."""
    lags, free = voyages.until(SPANS[channel]) - 1, voyages.free[: voyages.until(DURATION), channel]
    return {
        "common": float(decay_rate(autocorrelation(free, lags, "common"), STEP)),
        "whole": float(decay_rate(autocorrelation(free, lags, "whole"), STEP)),
    }


def coupled_identification(system: System, voyages: Voyages) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Section 7.3: a11, a22 and the roots of the linear system, with and without waves.

    Args:
        system: The linear system.
        voyages: Its motions.

    Returns:
        Rates without waves and from waves, and rows with the spread over the seas for both observation times.
    """
    assert system.matrix is not None
    truth, names = coupled_values(system.matrix[None])[0].tolist(), ("a11", "a22", "lambda1", "lambda2")
    free = coupled_correlations(voyages, voyages.free[None, : voyages.until(DURATION)])
    found = coupled_values(motion_matrix(free, STEP, int(STRIDE / STEP)))[0].tolist()
    without = [{"rate": n, "truth": t, "found": f} for n, t, f in zip(names, truth, found, strict=True)]
    one, rows = [], []
    for angle, duration in product(ANGLES_DEG, (DURATION, LONG)):
        for way, values in coupled_rates(voyages, angle, duration).items():
            for name, column, true in zip(names, values.T, truth, strict=True):
                row = spread(column, true)
                key = {"rate": name, "angle [deg]": angle, "T* [s]": duration, "from": way}
                rows.append(key | row)
                if duration == DURATION and way == "one record":
                    one.append(_item(key, row, len(values)))
    return {"coupled_without_waves": without, "coupled_by_one_record": one}, rows
