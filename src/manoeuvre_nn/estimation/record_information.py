"""Which coefficients a record can identify at all: Fisher information of its own motion and its own noise."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from statsmodels.stats.sandwich_covariance import S_hac_simple

from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.estimation.accelerations import accelerations
from manoeuvre_nn.estimation.derivatives import ABKOWITZ, coefficient_name, taylor_columns
from manoeuvre_nn.recording.check.finding import Finding
from manoeuvre_nn.recording.local_cubics import WINDOW, smoothed
from manoeuvre_nn.recording.tuples import to_tuples

LINEAR_TERMS = {
    "X": ("0", "u", "vr", "dd"),
    "Y": ("0", "v", "r", "d"),
    "N": ("0", "v", "r", "d"),
}
"""Linear derivatives, and what slows a ship down in a turn."""
MAX_RELATIVE_ERROR = 0.2
"""Relative standard error up to which a coefficient counts as identified."""
MIN_CORRELATION = 0.95
"""Correlation of two estimates from which on they cannot be told apart."""
MIN_EIGENVALUE_RATIO = 1e-10
"""Smallest eigenvalue over the largest: less is rounding [-]."""

Columns = Float[np.ndarray, "n k"]


@dataclass(frozen=True)
class _Identifiable:
    """What one record tells about one list of coefficients.

    Attributes:
        names: Coefficients, such as ``Y_v``.
        values: What a weighted regression makes of them, in the prime system of the known part.
        errors: Their standard errors.
        pairs: Two coefficients that cannot be told apart, and the correlation of their estimates.
        condition: Equation -> ratio of the largest to the smallest singular value of its scaled columns.
    """

    names: tuple[str, ...]
    values: Float[np.ndarray, " k"]
    errors: Float[np.ndarray, " k"]
    pairs: tuple[tuple[str, str, float], ...]
    condition: Mapping[str, float]

    @property
    def relative(self) -> Float[np.ndarray, " k"]:
        """Standard errors over the values."""
        return self.errors / np.maximum(np.abs(self.values), 1e-12)

    @property
    def identified(self) -> tuple[str, ...]:
        """Coefficients with a relative standard error up to :data:`MAX_RELATIVE_ERROR`."""
        return tuple(n for n, e in zip(self.names, self.relative, strict=True) if e <= MAX_RELATIVE_ERROR)


def identifiable(recordings: Sequence[Recording], known: Ship, terms: Mapping[str, Sequence[str]]) -> _Identifiable:
    """Information of some records together on the coefficients of a list, in equation-error form.

    ``M' nudot' = sum theta_k phi_k(u, v, r, delta)``. Noise of u, v, r is what the smoother takes away; the error of
    the accelerations is that noise through the smoother, correlated over its window. Where the equation leaves more
    than that, which is what the list of terms lacks, errors grow by as much.

    Args:
        recordings: u, v, r, delta over time, without outliers.
        known: A ship with inertia; its prime system is that of the coefficients.
        terms: Equation -> terms.

    Returns:
        Values, standard errors, pairs and condition.
    """
    smooth = [accelerations(r, "smoother") for r in recordings]
    noise = np.sqrt(
        np.mean([_velocity_noise(raw, s, known) ** 2 for raw, s in zip(recordings, smooth, strict=True)], axis=0)
    )
    slope = max((_slope_weights(r) for r in recordings), key=len)
    # At the ends the smoother has samples on one side only, and errors several times as large.
    inner = [_inner(s, len(_slope_weights(s)) // 2) for s in smooth]
    tuples = to_tuples(inner, known)
    forces = known.force(tuples.inputs[:, :3] * known.velocity_units, tuples.inputs[:, 3])
    whole = (tuples.targets + forces).double().numpy()
    lengths = [len(r) for r in inner]
    names, values, errors, pairs, condition = [], [], [], [], {}
    for k, (equation, columns) in enumerate(taylor_columns(tuples, known, terms).items()):
        value, covariance, condition[equation] = _solved(columns, whole[:, k], noise[k], slope, lengths)
        label = [coefficient_name(equation, t) for t in terms[equation]]
        error = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        pairs += _alike(label, covariance, error, terms[equation])
        names += label
        values.append(value)
        errors.append(error)
    return _Identifiable(tuple(names), np.concatenate(values), np.concatenate(errors), tuple(pairs), condition)


def _velocity_noise(raw: Recording, smooth: Recording, known: Ship) -> Float[np.ndarray, " 3"]:
    """What white noise on u, v and r would be if it were a force: inertia times noise."""
    sizes = np.array([float((raw[k] - smooth[k]).std()) for k in ("u", "v", "r")])
    one_by_one = torch.as_tensor(np.diag(sizes)).to(known.inertia)
    return np.sqrt((known.force_from_acceleration(one_by_one).double().numpy() ** 2).sum(axis=0))


def _inner(recording: Recording, margin: int) -> Recording:
    """A record without its ends, where it is long enough."""
    if len(recording) < 4 * margin:
        return recording
    return recording.between(recording.time[margin], recording.time[-1 - margin])


def _slope_weights(recording: Recording) -> Float[np.ndarray, " k"]:
    """Weights of the smoother's slope: its answer to a single sample, over its window [1/s]."""
    step = float(np.median(np.diff(recording.time)))
    window = max(2 * round(WINDOW * recording.meta.get("time_unit", 10 * step) / step / 2) + 1, 5)
    impulse = np.zeros(2 * window + 1)
    impulse[window] = 1.0
    answer = smoothed(step * np.arange(len(impulse)), impulse, window * step)[1]
    return answer[window // 2 + 1 : -(window // 2) - 1]


def _solved(
    columns: Columns,
    target: Float[np.ndarray, " n"],
    noise: float,
    slope: Float[np.ndarray, " w"],
    lengths: Sequence[int],
) -> tuple[np.ndarray, np.ndarray, float]:
    """Least squares; covariance for errors that the smoother correlates, and for what the terms leave; condition."""
    size = np.sqrt((columns**2).mean(axis=0))
    dead = size < 1e-9  # what never moves says nothing
    size = np.where(dead, 1.0, size)
    scaled = columns / size
    values, vectors = np.linalg.eigh(scaled.T @ scaled)
    condition = float(np.sqrt(values[-1] / max(values[0], MIN_EIGENVALUE_RATIO * values[-1])))
    inverse = (vectors / np.maximum(values, MIN_EIGENVALUE_RATIO * values[-1])) @ vectors.T
    solution = inverse @ (scaled.T @ target)
    rest = target - scaled @ solution
    pieces = np.split(scaled, np.cumsum(lengths)[:-1])
    # An error of one sample enters the slopes of a whole window, with weights that add up to nothing.
    felt = [noise * np.stack([np.convolve(c, slope) for c in piece.T], axis=1) for piece in pieces]
    meat = sum(f.T @ f for f in felt)
    unexplained = max(1 - noise**2 * float((slope**2).sum()) / max(float(rest @ rest) / len(rest), 1e-300), 0.0)
    # What the terms leave lasts (Newey & West 1987).
    meat = meat + unexplained * S_hac_simple(scaled * rest[:, None], min(len(slope), len(rest) // 3))
    covariance = inverse @ meat @ inverse
    covariance[np.ix_(dead, dead)] += np.diag(np.full(int(dead.sum()), 1e300))
    return solution / size, covariance / np.outer(size, size), condition


def _alike(
    names: Sequence[str], covariance: Columns, error: Float[np.ndarray, " k"], terms: Sequence[str]
) -> list[tuple[str, str, float]]:
    """Pairs whose estimates are nearly the same number twice."""
    correlation = covariance / np.maximum(np.outer(error, error), 1e-300)
    return [
        (names[i], names[j], float(correlation[i, j]))
        for i in range(len(names))
        for j in range(i + 1, len(names))
        if abs(correlation[i, j]) > MIN_CORRELATION and "0" not in {terms[i], terms[j]}
    ]


def excitation_findings(recordings: Sequence[Recording], known: Ship) -> list[Finding]:
    """Which coefficients some records can identify together, and what to sail for the others.

    Args:
        recordings: u, v, r, delta over time, without outliers.
        known: A ship with inertia, such as Clarke's part of it.

    Returns:
        One finding on the linear derivatives, one on Abkowitz' third-order series.
    """
    told = identifiable(recordings, known, LINEAR_TERMS)
    wanted, good = _wanted(told)
    lacking = [n for n in wanted if n not in good]
    text = f"{len(good)} of {len(wanted)} linear derivatives can be identified"
    text += f"; not {', '.join(lacking)}" if lacking else ""
    remedy = _remedy(recordings, lacking) if lacking else ""
    linear = _finding("excitation", told, text + _pairs(told, 3), remedy)
    told = identifiable(recordings, known, ABKOWITZ)
    wanted, good = _wanted(told)
    text = f"{len(good)} of {len(wanted)} coefficients of a third-order series can be identified"
    text += f": {', '.join(good[:12])}{' ...' if len(good) > 12 else ''}" if good else ""
    return [linear, _finding("excitation, third order", told, text + _pairs(told, 2))]


def _wanted(told: _Identifiable) -> tuple[list[str], list[str]]:
    """Coefficients without the constants, and which of them can be identified."""
    wanted = [n for n in told.names if not n.endswith("_0")]
    return wanted, [n for n in told.identified if n in wanted]


def _pairs(told: _Identifiable, most: int) -> str:
    """The pairs that are least told apart."""
    worst = sorted(told.pairs, key=lambda p: -abs(p[2]))[:most]
    return "; not apart: " + ", ".join(f"{a} and {b} ({c:+.3f})" for a, b, c in worst) if worst else ""


def _finding(check: str, told: _Identifiable, text: str, remedy: str = "") -> Finding:
    """A finding, with the share that is identified and the condition."""
    wanted, good = _wanted(told)
    expected = f"errors below {100 * MAX_RELATIVE_ERROR:.0f} %; condition is {max(told.condition.values()):.2g}"
    share = 100 * len(good) / len(wanted)
    verdict = "ok" if len(good) == len(wanted) else "note"
    return Finding(check, verdict, text, measured=share, unit="%", expected=expected, remedy=remedy)


def _remedy(recordings: Sequence[Recording], lacking: Sequence[str]) -> str:
    """Which manoeuvre shows what these do not."""
    if max(float(np.ptp(r["delta"])) for r in recordings) < 0.02:
        return "add a zigzag: the rudder does not move"
    steady = [abs(float(np.mean(np.sign(r["r"])))) > 0.7 for r in recordings]
    changing = max(float(np.ptp(np.quantile(r["u"], [0.05, 0.95])) / np.median(r["u"])) for r in recordings)
    advice = []
    if any(n[0] in "YN" for n in lacking):
        if not any(steady):
            advice.append("a turning circle or a spiral, which hold drift beside a steady turn")
        elif all(steady):
            advice.append("a zigzag, which reverses rudder and turn")
        else:
            advice.append("more of the same, or record u and v with less noise")
    if any(n[0] == "X" for n in lacking):
        hard = changing < 0.25
        advice.append("a hard turn (tc35), which slows the ship down" if hard else "a straight run at another speed")
    return f"add {'; and '.join(advice)}"
