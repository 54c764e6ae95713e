"""Wang 1996, sections 7.2, 7.3 and 7.5: what can be identified from autocorrelations."""

from collections.abc import Mapping
from itertools import product
from typing import Any

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.identification.random_decrement import autocorrelation, correlations, decay_rate, motion_matrix
from manoeuvre_nn.reproduction.section import Claim, Verdict, compared
from manoeuvre_nn.reproduction.wang1996_sway_yaw import ANGLES_DEG, DURATION, LONG, STEP, System, Voyages

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


def share_claim(where: str, what: str, paper: str, row: Mapping[str, Any], count: int) -> Claim:
    """A claim that one identification suffices, judged by how many of ours come near.

    Args:
        where: Section.
        what: Coefficient and way.
        paper: The statement.
        row: From :func:`spread`.
        count: Number of identifications.

    Returns:
        It holds if 95 % are within 10 %, in direction if half of them are.
    """
    near, none = row["within 10 %"], row["none"]
    verdict: Verdict = "holds" if near >= 0.95 else "holds in direction" if near >= 0.5 else "does not hold"
    found = "no rate" if row["median"] is None else f"{row['median']:.4f} ({row['5 %']:.4f} to {row['95 %']:.4f})"
    ours = f"{found}; {near:.0%} of {count} within 10 %"
    why = "waves stay in the autocorrelation" + (f"; {none:.0%} give no real rate" if none else "")
    return Claim(where, what, paper, ours, verdict, "" if verdict == "holds" else why, "1/s")


def simple_identification(system: System, voyages: Voyages) -> tuple[list[Claim], list[dict[str, Any]]]:
    """Section 7.2: a11 and a22 of the simplest system, with and without waves.

    Args:
        system: The simplest system.
        voyages: Its motions.

    Returns:
        Claims, and rows with the spread over the seas for both observation times.
    """
    assert system.matrix is not None
    claims, rows = [], []
    for channel, truth in enumerate(np.diag(system.matrix).tolist()):
        name = f"a{channel + 1}{channel + 1}"
        claims += _free_slopes(voyages, channel, name, truth)
        for angle, duration in product(ANGLES_DEG, (DURATION, LONG)):
            for way, (rates, unfolded) in simple_rates(voyages, angle, channel, duration).items():
                row = spread(rates, truth)
                key = {"rate": name, "angle [deg]": angle, "T* [s]": duration, "from": way}
                rows.append(key | row | {"folded": 1 - float(unfolded.mean())})
                if duration == DURATION and way != "20 records":
                    paper = "slopes are exactly the values" if way == "one record" else "not done"
                    claims.append(share_claim("Section 7.5", f"{name}, {way}, {angle:g} deg", paper, row, len(rates)))
    return claims, rows


def _free_slopes(voyages: Voyages, channel: int, name: str, truth: float) -> list[Claim]:
    """Slopes of the logarithms without waves, with both windows."""
    lags, free = voyages.until(SPANS[channel]) - 1, voyages.free[: voyages.until(DURATION), channel]
    common, whole = (float(decay_rate(autocorrelation(free, lags, w), STEP)) for w in ("common", "whole"))
    bent = "eq 7.28 has fewer products at larger lags, which bends ln R of a short record"
    where = "Eqs 7.31, 7.32"
    return [
        compared(where, f"{name}, slope of ln R without waves", truth, common, within=1e-4, unit="1/s"),
        compared(
            where, f"{name}, by eq 7.28 over 100 s", truth, whole, within=1e-4, direction=True, why=bent, unit="1/s"
        ),
    ]


def coupled_identification(system: System, voyages: Voyages) -> tuple[list[Claim], list[dict[str, Any]]]:
    """Section 7.3: a11, a22 and the roots of the linear system, with and without waves.

    Args:
        system: The linear system.
        voyages: Its motions.

    Returns:
        Claims, and rows with the spread over the seas for both observation times.
    """
    assert system.matrix is not None
    truth, names = coupled_values(system.matrix[None])[0].tolist(), ("a11", "a22", "lambda1", "lambda2")
    free = coupled_correlations(voyages, voyages.free[None, : voyages.until(DURATION)])
    found = coupled_values(motion_matrix(free, STEP, int(STRIDE / STEP)))[0].tolist()
    claims = [
        compared("Eqs 7.45, 7.46", f"{n}, from autocorrelations without waves", t, f, within=1e-4, unit="1/s")
        for n, t, f in zip(names, truth, found, strict=True)
    ]
    rows, paper = [], "autocorrelation eliminates the waves"
    for angle, duration in product(ANGLES_DEG, (DURATION, LONG)):
        for way, values in coupled_rates(voyages, angle, duration).items():
            for name, column, true in zip(names, values.T, truth, strict=True):
                row = spread(column, true)
                rows.append({"rate": name, "angle [deg]": angle, "T* [s]": duration, "from": way} | row)
                if duration == DURATION and way == "one record":
                    what = f"{name}, one record, {angle:g} deg"
                    claims.append(share_claim("Section 7.3", what, paper, row, len(values)))
    return claims, rows
