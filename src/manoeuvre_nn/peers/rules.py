"""From terms to names: which rows and groups of a sparse regression point to which effect, as a naval architect reads them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import atan2, hypot

import numpy as np

from manoeuvre_nn.peers.sparse import GROUPS, MIRROR, ROWS, Sparse

Cell = tuple[str, str]
Test = Callable[[Sparse], float]


@dataclass(frozen=True)
class Rule:
    """How an effect shows.

    Attributes:
        must: Cells that have to be there, each with at least ``SHARE`` of all that the rule's cells explain.
        may: Cells that also count.
        free: Cells that neither count nor speak against it.
        test: How far signs and ratios of coefficients fit, 0 to 1.
    """

    must: tuple[Cell, ...]
    may: tuple[Cell, ...] = ()
    free: tuple[Cell, ...] = ()
    test: Test = lambda s: 1.0


SHARE = 0.03
"""Share of a rule's evidence that each of its necessary cells has to carry."""
AGAINST = 0.5
"""Weight of what a rule does not explain."""
TAME = 0.15
"""Weight of terms that a symmetric ship has: errors of coefficients make them too, whatever is allowed for that."""
UNKNOWN, LEFT = 0.08, 0.015
"""Share of all that terms explain, and of what they leave, that is taken for something unknown."""
SHORTEST = 4
"""Averages that an event lasts at least."""


def surge(constant: float, slope: float) -> Test:
    """How well the constant and the slope with u' of surge point in a direction.

    Args:
        constant: Expected sign and size of the constant.
        slope: Of the slope.

    Returns:
        Test of the angle between found and expected, 1 if equal, 0 from 45 degrees on.
    """

    def test(s: Sparse) -> float:
        x = s.coefficients["X"]
        off = atan2(x["1"] * slope - x["u"] * constant, x["1"] * constant + x["u"] * slope)
        return max(0.0, 1 - abs(off) / np.radians(45)) if hypot(x["1"], x["u"]) > 0 else 0.0

    return test


def gear(term: str, sign: int) -> Test:
    """Whether a term of the steering gear leads in yaw, with its sign.

    Args:
        term: ``rate`` or ``play``.
        sign: Expected sign.

    Returns:
        Share of the term in what both explain, 0 with the wrong sign.
    """

    def test(s: Sparse) -> float:
        right = sign * s.coefficients["N"][term] > 0
        both = s.energy("N", "rate") + s.energy("N", "play")
        return s.energy("N", term) / both if right and both else 0.0

    return test


def term(row: str, *names: str, sign: int = 0) -> Test:
    """Whether terms lead in their group, with their sign.

    Args:
        row: The row.
        names: The terms.
        sign: Expected sign of the first; 0 takes any.

    Returns:
        Share of the terms in what all terms of the first one's group explain.
    """
    group = next(terms for terms in GROUPS.values() if names[0] in terms)

    def test(s: Sparse) -> float:
        total = sum(s.energy(row, t) for t in group)
        right = sign * s.coefficients[row][names[0]] >= 0
        return sum(s.energy(row, t) for t in names) / total if total and right else 0.0

    return test


def turned(s: Sparse) -> float:
    """How far the harmonics of drift are those of the log a quarter turn on, as a stream's are."""
    log, drift = ([s.coefficients[row][t] for t in ("cos", "sin")] for row in ("log", "drift"))
    expected = np.array([log[1], -log[0]])
    size = np.linalg.norm(expected) * np.linalg.norm(drift)
    return max(0.0, float(expected @ drift) / size) if size else 0.0


WIND_FREE = (("X", "bias"), ("N", "bias"), ("drift", "bias"), ("drift", "head2"))
LATERAL = (("drift", "hull"), ("drift", "rudder"), ("drift", "gear"))
DRIFT = (*LATERAL, ("drift", "head1"), ("drift", "head2"))
STREAM = (("log", "head1"), ("drift", "head1"))
RULES: Mapping[str, Rule] = {
    "rate_bias": Rule((("gyro", "bias"),)),
    "log_scale": Rule((("log", "bias"),), test=term("log", "1")),
    "current": Rule(STREAM, test=turned),
    "heading_bias": Rule((("drift", "bias"),), (), DRIFT, term("drift", "1")),
    "gps_lever_arm": Rule((("drift", "hull"),), (("log", "hull"),), test=term("drift", "r")),
    "wind_steady": Rule((("drift", "head1"), ("N", "head1")), (("X", "head1"), ("N", "head2")), WIND_FREE),
    "wave_drift": Rule((("drift", "head1"), ("N", "head2")), (("X", "head1"),), WIND_FREE),
    "rudder_offset": Rule((("N", "bias"),), (("drift", "bias"),), test=term("N", "1")),
    "rudder_area_loss": Rule((("N", "rudder"),), (("drift", "rudder"),), LATERAL, term("N", "d", "ddd", sign=-1)),
    "rudder_delay": Rule((("N", "gear"),), (), (*LATERAL, ("N", "hull"), ("N", "rudder")), gear("rate", 1)),
    "rudder_slow": Rule((("N", "gear"),), (), (*LATERAL, ("N", "hull"), ("N", "rudder")), gear("rate", -1)),
    "rudder_backlash": Rule((("N", "gear"),), (), (*LATERAL, ("N", "hull"), ("N", "rudder")), gear("play", -1)),
    "power_limit": Rule((("shaft", "bias"),), (("X", "bias"), ("X", "even"))),
    "hull_fouling": Rule((("X", "bias"),), (), (("X", "even"),), surge(-1, -2)),
    "ice_resistance": Rule((("X", "bias"),), (), (("X", "even"),), surge(-1, 0)),
    "propeller_pitch_error": Rule(
        (("X", "bias"),), (), (("X", "even"),), lambda s: max(surge(1, -1)(s), surge(-1, 1)(s))
    ),
    "shallow_water": Rule(
        (("N", "hull"), ("drift", "hull")), (("X", "bias"), ("X", "even"), ("N", "rudder")), LATERAL
    ),
    "trim_change": Rule((("N", "hull"), ("drift", "hull")), (), LATERAL),
    "displacement_change": Rule((("X", "even"), ("drift", "hull")), (("N", "hull"),), (("N", "rudder"), *LATERAL)),
    "roll_coupling": Rule((("N", "hull"),)),
}  # fmt: skip
"""Effects that a library of terms can express."""


def scores(s: Sparse) -> dict[str, float]:
    """Evidence for every effect, most first.

    Args:
        s: What sparse regression found.

    Returns:
        Name and sum of squares in units of the noise; ``side_force`` by an event that the terms leave; ``unknown`` by
        all that there is.
    """
    weight = {group: TAME if group in MIRROR else 1.0 for group in GROUPS}
    cells = {(row, group): weight[group] * s.explained[row][group] for row in ROWS for group in GROUPS}
    total = sum(cells.values())
    found = {}
    for name, rule in RULES.items():
        counted = sum(cells[c] for c in (*rule.must, *rule.may))
        against = total - counted - sum(cells[c] for c in rule.free)
        there = counted > 0 and all(cells[c] >= SHARE * counted for c in rule.must)
        found[name] = rule.test(s) * counted - AGAINST * against if there else -AGAINST * total
    found["side_force"] = event(s)[0] - AGAINST * total
    found["unknown"] = UNKNOWN * total + LEFT * max(float((s.left**2).sum()) - s.left.size, 0.0)
    return dict(sorted(found.items(), key=lambda item: -item[1]))


def event(s: Sparse) -> tuple[float, dict[int, tuple[float, float]]]:
    """A lateral push for a while in every run, in what the terms leave of yaw and drift.

    Args:
        s: What sparse regression found.

    Returns:
        What it explains, and when it acts in each run [s].
    """
    rows = [ROWS.index("N"), ROWS.index("drift")]
    total, when, direction = 0.0, {}, None
    order = sorted(range(len(s.parts)), key=lambda k: -_longest(s.left[s.parts[k]][:, rows], None)[0])
    for k in order:
        gain, start, end, mean = _longest(s.left[s.parts[k]][:, rows], direction)
        if gain > 0:
            direction = mean / np.linalg.norm(mean) if direction is None else direction
            total += gain
            times = s.times[s.parts[k]]
            when[k] = (float(times[start]), float(times[end - 1]))
    return total, when


def _longest(left: np.ndarray, direction: np.ndarray | None) -> tuple[float, int, int, np.ndarray]:
    """Interval whose mean explains most, against the mean of the rest: gain, start, end, mean."""
    n = len(left)
    sums = np.concatenate([np.zeros((1, 2)), np.cumsum(left - left.mean(axis=0), axis=0)])
    best = (0.0, 0, 0, np.zeros(2))
    for start in range(n - SHORTEST):
        ends = np.arange(start + SHORTEST, n + 1)
        length = (ends - start)[:, None]
        mean = (sums[ends] - sums[start]) / length
        along = mean if direction is None else np.maximum(mean @ direction, 0.0)[:, None]
        gain = (along**2).sum(axis=1) * length[:, 0] / (1 - length[:, 0] / (n + 1))
        k = int(gain.argmax())
        if gain[k] > best[0]:
            best = (float(gain[k]), start, int(ends[k]), mean[k])
    return best
