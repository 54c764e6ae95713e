"""Error measures of whole manoeuvres as Hess & Faller tabulate them: absolute, percent, average angle, correlation.

Source:
    Hess & Faller 2000, "Simulation of ship maneuvers using recursive neural networks", 23rd Symp. Naval Hydrodynamics,
    Tables 4-6 and the text beside them. The equation of the average angle measure is lost there; it is taken from later
    papers of the same authors.
"""

from collections.abc import Collection, Mapping, Sequence
from math import nan, pi
from types import MappingProxyType

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.frames import earth_to_body
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE
from manoeuvre_nn.manoeuvre.criteria import reversal_times, trace
from manoeuvre_nn.scoring.score import at_recorded_times

VARIABLES = {"u": "m/s", "x": "m", "y": "m", "phi": "deg", "psi": "deg"}
"""Variables that a manoeuvre is judged by, and the unit of their absolute error."""
MEASURES = ("absolute", "percent", "average_angle", "correlation")
"""Columns of the tables."""
MEAN = "mean"
"""Row of a table that holds the mean over the variables."""

Series = Float[np.ndarray, " n"]


def average_angle_measure(
    recorded: Float[np.ndarray, "*batch n"], predicted: Float[np.ndarray, "*batch n"]
) -> Float[np.ndarray, "*batch"]:
    """How closely pairs (s, p) of recorded and predicted samples lie to the line s = p.

    ``AAM = 1 - (4/pi) sum(D |a|) / sum(D)`` with ``D = sqrt(s^2 + p^2)`` and ``a = acos(|s + p| / (sqrt(2) D))``, the
    angle between a pair and the line: 1 where p = s, 0 where p = 0, -1 where p = -s. It keeps its value where s and p
    change places or are multiplied by the same number, and not where the same number is added to both: positions and
    headings are to be counted from where the run begins.

    Args:
        recorded: s, over time.
        predicted: p at the same times.

    Returns:
        The measure [-]; 1 where both are 0 throughout.

    Source:
        Hess & Faller 2000, from the Maneuvering Certification Board, NSWC.
    """
    size = np.hypot(recorded, predicted)
    # (s + p)^2 + (s - p)^2 = 2 D^2: the same angle without the rounding of acos near 1.
    angle = np.arctan2(np.abs(recorded - predicted), np.abs(recorded + predicted))
    total = size.sum(axis=-1)
    weighed = (size * angle).sum(axis=-1)
    return np.asarray(1 - 4 / pi * np.divide(weighed, total, out=np.zeros_like(total), where=total > 0))


def correlation(
    recorded: Float[np.ndarray, "*batch n"], predicted: Float[np.ndarray, "*batch n"]
) -> Float[np.ndarray, "*batch"]:
    """Pearson's correlation coefficient over time; NaN where one of the two does not vary."""
    s, p = (values - values.mean(axis=-1, keepdims=True) for values in (recorded, predicted))
    size = np.sqrt((s**2).sum(axis=-1) * (p**2).sum(axis=-1))
    return np.asarray(np.divide((s * p).sum(axis=-1), size, out=np.full_like(size, nan), where=size > 0))


def run_measures(prediction: Recording, reference: Recording) -> pd.DataFrame:
    """Error measures of one run.

    x and y are counted from the first recorded position, x along the first recorded heading; psi from that heading. A
    prediction that was ended early is taken to rest where it ended. Gaps are left out.

    Args:
        prediction: Predicted manoeuvre.
        reference: Recorded manoeuvre; its times are the ones compared at.

    Returns:
        A line a variable that both have: absolute (mean absolute error [m/s, m, deg]), average_angle [-], correlation
        [-].
    """
    names = [k for k in VARIABLES if k in reference.channels and k in prediction.channels]
    cut, ahead = at_recorded_times(prediction, reference, names)
    recorded, predicted = (_from_start(c, reference) for c in ({k: cut[k] for k in names}, ahead))
    rows = {}
    for name, s in recorded.items():
        there = np.isfinite(s)
        s, p = s[there], predicted[name][there]
        rows[name] = (np.abs(s - p).mean(), average_angle_measure(s, p), correlation(s, p)) if len(s) else (nan,) * 3
    return pd.DataFrame.from_dict(rows, orient="index", columns=["absolute", "average_angle", "correlation"]).astype(
        float
    )


def normalisations(references: Sequence[Recording]) -> pd.DataFrame:
    """What percent errors are percent of, averaged over the recorded runs of a kind.

    Turning circles: speed u and diameter of the turn (x and y) over the last half turn, peak-to-peak roll, total change
    of heading. Zigzags (horizontal overshoots): u over the last third of the run, spatial period (distance along the
    approach from one reversal of the rudder to the next but one) for x, peak-to-peak y, roll and heading.

    Args:
        references: Recorded runs with their kind in ``meta``.

    Returns:
        A line a kind: u [m/s], x, y [m], phi, psi [deg]; NaN where no run of it says.

    Source:
        Hess & Faller 2000, text at Tables 4-6: there 5.2 m/s, 651 m, 2.8 deg, 529 deg for the circles of ship 1; 4.2
        m/s, 1424 m, 153 m, 1.2 deg, 41 deg for the overshoots of ship 2.
    """
    kinds: dict[str, list[dict[str, float]]] = {}
    for run in references:
        kind = str(run.meta.get("kind", ""))
        kinds.setdefault(kind, []).append(_scales(run, kind))
    means = {kind: pd.DataFrame(rows, columns=list(VARIABLES)).mean() for kind, rows in kinds.items()}
    return pd.DataFrame(means).T.astype(float)


def error_measures(
    predictions: Sequence[Recording],
    references: Sequence[Recording],
    sets: Mapping[str, Collection[str]] = MappingProxyType({}),
) -> pd.DataFrame:
    """Error measures averaged over sets of runs, as in Tables 4-6 of Hess & Faller.

    Each measure is taken over the samples of a run, then averaged over the runs of a set. The normalisations of percent
    errors are those of all runs, so that the same absolute error is the same percentage in every set.

    Args:
        predictions: Predicted runs.
        references: Recorded runs, in the same order.
        sets: Name of a set -> names of its runs: ``{"validation": [...]}``. All runs are always a set, ``all``.

    Returns:
        Lines (set, variable) and (set, ``mean``), the mean over the variables; columns absolute [m/s, m, deg], percent,
        average_angle [-], correlation [-]. The mean has no absolute error: its terms have different units.

    Raises:
        InputError: If a set names a run that is not there.
    """
    scale = normalisations(references)
    by_run = []
    for prediction, reference in zip(predictions, references, strict=True):
        found = run_measures(prediction, reference)
        own = scale.loc[str(reference.meta.get("kind", ""))]
        found["percent"] = 100 * found["absolute"] / own[found.index].replace(0.0, nan)
        by_run.append(found[list(MEASURES)])
    names = [r.name for r in references]
    tables = {"all": _averaged(by_run)}
    for label, wanted in sets.items():
        if unknown := sorted(set(wanted) - set(names)):
            raise InputError(f"set {label} names {', '.join(unknown)}; the runs are: {', '.join(names)}")
        tables[label] = _averaged([one for one, name in zip(by_run, names, strict=True) if name in wanted])
    return pd.concat(tables, names=["set", "variable"])


def _averaged(by_run: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """Mean over runs, then a line with the mean over variables."""
    if not by_run:
        return pd.DataFrame(columns=list(MEASURES), dtype=float)
    means = pd.concat(by_run).groupby(level=0).mean()
    means = means.loc[[k for k in VARIABLES if k in means.index]]
    means.loc[MEAN] = means.mean()
    means.loc[MEAN, "absolute"] = nan
    return means


def _from_start(channels: Mapping[str, Series], reference: Recording) -> dict[str, Series]:
    """Channels with positions and heading counted from a recording's first; angles in degrees."""
    found = dict(channels)
    course = float(reference["psi"][np.isfinite(reference["psi"])][0])
    if "x" in found and "y" in found:
        start = [reference[k][np.isfinite(reference[k])][0] for k in ("x", "y")]
        away = found["x"] - start[0], found["y"] - start[1]
        found["x"], found["y"] = earth_to_body(*away, np.full(len(away[0]), course))
    if "psi" in found:
        found["psi"] = (found["psi"] - course) / DEGREE
    if "phi" in found:
        found["phi"] = found["phi"] / DEGREE
    return found


def _scales(run: Recording, kind: str) -> dict[str, float]:
    """Normalisations of one run; none for a kind other than circles and zigzags."""
    own = _from_start({k: run[k] for k in VARIABLES if k in run.channels}, run)
    spans = {str(k): float(np.ptp(c[np.isfinite(c)])) for k, c in own.items() if k in {"y", "phi", "psi"}}
    if kind == "turning_circle":
        turned = np.abs(own["psi"] - own["psi"][np.isfinite(own["psi"])][-1])
        last = turned <= min(180.0, 0.5 * float(np.nanmax(turned)))
        diameter = _diameter(run, last)
        return {**spans, "u": float(np.nanmean(run["u"][last])), "x": diameter, "y": diameter}
    if kind == "zigzag":
        late = run.time >= run.time[-1] - run.duration / 3
        return {**spans, "u": float(np.nanmean(run["u"][late])), "x": _spatial_period(run)}
    return {}


def _diameter(run: Recording, last: Bool[np.ndarray, " n"]) -> float:
    """Diameter of a turn over its last part [m]: twice the distance sailed over the change of heading."""
    speed = np.hypot(run["u"], run["v"])[last]
    return float(2 * np.nanmean(speed) / np.abs(np.nanmean(run["r"][last])))


def _spatial_period(run: Recording) -> float:
    """Mean distance along the approach from one reversal of the rudder to the next to the same side [m]."""
    seen = trace(run)
    if seen is None or seen.ahead is None:
        return nan
    reversals, _ = reversal_times(seen)
    ahead = seen.ahead(np.array(reversals))
    return float(np.mean(ahead[2:] - ahead[:-2])) if len(ahead) > 2 else nan
