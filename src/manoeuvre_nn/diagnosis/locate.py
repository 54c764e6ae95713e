"""Where the mismatch sits: the force that is missing over time, its windows, frame, parity and region."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from manoeuvre_nn.core.effect import SITES
from manoeuvre_nn.core.units import three_digits
from manoeuvre_nn.diagnosis.result import Interval, Residual
from manoeuvre_nn.diagnosis.search import SearchResult
from manoeuvre_nn.estimation.data_set import WhitenedDataSet
from manoeuvre_nn.estimation.hypothesis import Hypothesis
from manoeuvre_nn.estimation.hypothesis_columns import hypothesis_columns
from manoeuvre_nn.estimation.linear_run import Columns, IntegratedRun
from manoeuvre_nn.estimation.linearised_run import LinearisedRun, integrated
from manoeuvre_nn.estimation.prepared_run import PreparedRun, process_time, start_spread
from manoeuvre_nn.numerics.finite_algebra import lstsq
from manoeuvre_nn.recording.outliers import robust_sd

BIN = 10.0
"""Length of the means in which windows are looked for [s]."""
MIN_SCATTER = 0.1
"""Least scatter of these means over a force's standard error: less is not that of noise, but of exact recordings, in
which a force of a hundredth of its standard error would stand out."""
LARGE = 0.15
"""Process noise that stands for something missing in an equation, over the resistance and 20 deg of rudder."""
MAX_PROCESS_NOISE = 0.5
"""Process noise that leaves the missing force to the data alone, over the resistance and 20 deg of rudder."""
POSITION = slice(3, 5)
"""Of u, v, r, x, y, psi what a stream moves."""
EQUATIONS = ("surge force X", "sway force Y", "yaw moment N")
PUSHES = {"X": ("ahead", "astern"), "Y": ("to starboard", "to port"), "N": ("bow to starboard", "bow to port")}
"""Which way a positive force or moment pushes, and a negative one."""
OF_SHIPS, OF_MODELS = {"kN": 1e3, "MN m": 1e6}, {"N": 1.0, "N m": 1.0}
"""Units of forces and of the moment -> their size in SI."""
TURNING = 0.3
"""Share of the largest yaw rate from which the ship turns."""
FRAME = 0.5
"""Share of the variance that a constant in body or earth axes must explain for the frame to be told."""


def residuals(data_set: WhitenedDataSet, hypothesis: Hypothesis, size: float = MAX_PROCESS_NOISE) -> list[Residual]:
    """Force that calm water lacks over every run, with and without what was found.

    Process noise of any size is allowed, so that the data alone shape it; its standard deviation is the smoother's.

    Args:
        data_set: The fitted runs.
        hypothesis: What was found; may be empty.
        size: S.d. of the process noise that is allowed, over the resistance and the force of 20 deg of rudder.

    Returns:
        One a run.
    """
    columns = hypothesis_columns(data_set, hypothesis).columns
    made, scale = [], in_units(data_set)
    for prepared, c in zip(data_set.runs, columns, strict=True):
        run, white = prepared.linearised.run, _loose(data_set, prepared, size)
        # What the sensors and the stream do is no force: it is taken out of both.
        stream = _moved_by_stream(prepared.linearised, c[:1].moved)
        before, after = prepared.data - Columns(c[:1].measured, stream), prepared.data - c[:1]
        process = prepared.linearised.states.forces
        force, left = (scale(white.states(white.embed(x))[:, process, 0]) for x in (before, after))
        error, windows = np.abs(scale(_spread(white, process))), _windows(data_set, prepared, before)
        made.append(Residual(run.name, run.time, force, error, left, windows, units(data_set)))
    return made


def _moved_by_stream(
    linearised: LinearisedRun, moved: Float[np.ndarray, "steps k p"]
) -> Float[np.ndarray, "steps k p"]:
    """What of the moves ``C p`` within a step a stream makes, and no force by the velocity that it adds."""
    carried = linearised.carried.numpy()
    pushes = np.linalg.pinv(carried) @ moved  # in breaks C has no inverse
    by_stream = np.zeros_like(pushes)
    by_stream[:, POSITION] = pushes[:, POSITION]
    return carried @ by_stream


def _windows(data_set: WhitenedDataSet, prepared: PreparedRun, data: Columns) -> list[Interval]:
    """Times in which something is missing; looked for where the data alone shape the force."""
    white, scale = _loose(data_set, prepared, MAX_PROCESS_NOISE), in_units(data_set)
    process = prepared.linearised.states.forces
    force, error = white.states(white.embed(data))[:, process, 0], _spread(white, process)
    return changes(prepared.linearised.run.time, scale(force), np.abs(scale(error)))


def missing_accelerations(data_set: WhitenedDataSet) -> list[Float[np.ndarray, "n 3"]]:
    """Accelerations that calm water lacks over every run, shaped by the data alone [m/s^2, m/s^2, rad/s^2]."""
    made = []
    for prepared in data_set.runs:
        white = _loose(data_set, prepared, MAX_PROCESS_NOISE)
        made.append(white.states(white.embed(prepared.data))[:, prepared.linearised.states.forces, 0])
    return made


def _loose(data_set: WhitenedDataSet, prepared: PreparedRun, size: float) -> IntegratedRun:
    """The run with process noise allowed."""
    time, start = 0.5 * process_time(data_set.dynamics), start_spread(data_set.dynamics)
    return integrated(prepared.linearised, prepared.noise, size * data_set.unit, time, start)


def units(data_set: WhitenedDataSet) -> tuple[str, str, str]:
    """Units that missing X, Y and N are shown in: kN and MN m for ships, N and N m for models."""
    force, moment = OF_MODELS if data_set.dynamics.particulars.is_model else OF_SHIPS
    return force, force, moment


def in_units(data_set: WhitenedDataSet) -> Callable[[Float[np.ndarray, "n 3"]], Float[np.ndarray, "n 3"]]:
    """Accelerations -> forces and moment in their units."""
    hull, sizes = data_set.dynamics.hull, OF_SHIPS | OF_MODELS
    prime = np.array([hull.prime.force, hull.prime.force, hull.prime.moment])
    per = prime / [sizes[unit] for unit in units(data_set)]

    def scale(a: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        return hull.force_from_acceleration(hull.inertia.new_tensor(a)).numpy() * per

    return scale


def unit_forces(data_set: WhitenedDataSet) -> Float[np.ndarray, " 3"]:
    """Resistance, and force and moment of 20 deg of rudder, in the units that forces are told in."""
    return np.abs(np.diag(in_units(data_set)(np.diag(data_set.unit[:3]))))


def _spread(white: IntegratedRun, process: slice) -> Float[np.ndarray, "n 3"]:
    """Posterior standard deviation of the process noise."""
    return np.sqrt(np.diagonal(white.covariances[0], axis1=1, axis2=2)[:, process])


def changes(
    time: Float[np.ndarray, " n"], force: Float[np.ndarray, "n 3"], error: Float[np.ndarray, "n 3"]
) -> list[Interval]:
    """Times in which something is missing, when there are times in which nothing is.

    Args:
        time: Sample times [s].
        force: Missing force.
        error: Its standard deviation.

    Returns:
        Windows [s]; none if the force is missing throughout or nowhere.
    """
    width = max(1, round(BIN / (time[1] - time[0])))
    count = len(time) // width
    if count < 12:
        return []
    z = (force / np.maximum(error, 1e-12))[: count * width].reshape(count, width, 3).mean(axis=1)
    z = z - np.median(z, axis=0)
    z = z / np.maximum(np.apply_along_axis(robust_sd, 0, np.diff(z, axis=0)) / np.sqrt(2), MIN_SCATTER)
    edges = _level_pieces(z, 3, 12 * np.log(count))
    means = [np.abs(z[a:b].mean(axis=0)).max() for a, b in zip(edges, edges[1:], strict=False)]
    if len(means) == 1 or min(means) > 2.0:
        return []
    return [
        (float(time[a * width]), float(time[min(b * width, len(time) - 1)]))
        for a, b, m in zip(edges, edges[1:], means, strict=False)
        if m > 4.0
    ]


def _level_pieces(z: Float[np.ndarray, "n k"], least: int, penalty: float) -> list[int]:
    """Edges of the pieces of at least so many rows, each about its mean, that cost least together.

    A piece costs the squares about its mean and a penalty. Optimal partitioning: the best pieces up to a row are the
    best ones up to where the last of them begins, and that one.

    Args:
        z: A sample a row.
        least: Fewest rows of a piece.
        penalty: Cost of a piece beside its squares.

    Returns:
        The first row of every piece, and the number of rows.

    Source:
        Jackson et al. 2005, IEEE Signal Process. Lett. 12, 105-108.
    """
    count = len(z)
    sums, squares = (np.concatenate([[np.zeros_like(a[0])], np.cumsum(a, axis=0)]) for a in (z, (z**2).sum(axis=1)))
    cost, begins = np.full(count + 1, np.inf), np.zeros(count + 1, dtype=int)
    cost[0] = 0.0
    for end in range(least, count + 1):
        start = np.arange(end - least + 1)
        about = squares[end] - squares[start] - ((sums[end] - sums[start]) ** 2).sum(axis=1) / (end - start)
        total = cost[start] + about + penalty
        begins[end] = int(total.argmin())
        cost[end] = total[begins[end]]
    edges = [count]
    while edges[0]:
        edges.insert(0, int(begins[edges[0]]))
    return edges


def sites(tried: SearchResult) -> dict[str, float]:
    """Site -> log Bayes factor over calm water of process noise in some equations, or of the best effect there."""
    grid = tried.likelihood.data_set.levels
    large = grid.largest(LARGE)
    points = {"surge": grid.point(large, 0), "sway and yaw": grid.point(0, large)}
    at = {site: tried.likelihood.evidence_at(Hypothesis((), ()), point) for site, point in points.items()}
    found = {site: evidence - tried.none.evidence for site, evidence in at.items()}
    for site in SITES:
        of_site = [j for j in tried.fitted if len(j.names) == 1 and j.hypothesis.effects[0].site == site]
        if of_site:
            found[site] = max(j.evidence for j in of_site) - tried.none.evidence
    return {k: float(v) for k, v in found.items()}


@dataclass(frozen=True)
class Shape:
    """What the missing force of the clearest equation looks like.

    Attributes:
        strongest: Number of the equation.
        ratio: Root mean square of X, Y and N over their errors.
        explained: Share of its variance that a constant in body axes, the heading, and rudder and yaw rate explain;
            empty if no run turns through 90 deg.
        sides: Its mean in port and in starboard turns; empty if one side was left out.
        hard: Share of its square, and of the time, with more than half the helm; empty where the helm was always alike.
    """

    strongest: int
    ratio: Float[np.ndarray, " 3"]
    explained: tuple[float, ...] = ()
    sides: tuple[float, ...] = ()
    hard: tuple[float, ...] = ()

    @property
    def frame(self) -> str:
        """``body``, ``earth`` or empty."""
        if not self.explained or max(self.explained[:2]) < FRAME:
            return ""
        return "body" if self.explained[0] > self.explained[1] else "earth"

    @property
    def parity(self) -> str:
        """``even``, ``odd``, ``mixed`` or empty."""
        if not self.sides:
            return ""
        even, odd = abs(sum(self.sides)) / 2, abs(self.sides[1] - self.sides[0]) / 2
        return "even" if even > 2 * odd else "odd" if odd > 2 * even else "mixed"


def shape_of(data_set: WhitenedDataSet, found: Sequence[Residual]) -> Shape:
    """Equation, frame, parity and region of the missing force."""
    force, error = (np.concatenate([getattr(r, k) for r in found]) for k in ("force", "error"))
    ratio = np.sqrt(np.mean((force / np.maximum(error, 1e-12)) ** 2, axis=0))
    y = force[:, int(ratio.argmax())]
    r, psi = np.concatenate([p.linearised.track[:, [2, 5]] for p in data_set.runs]).T
    delta = np.concatenate([p.linearised.run["delta"] for p in data_set.runs])
    explained: tuple[float, ...] = ()
    if max(np.ptp(p.linearised.track[:, 5]) for p in data_set.runs) >= np.pi / 2:
        bases = ([np.ones_like(y)], [np.cos(psi), np.sin(psi)], [r, delta])
        explained = tuple(_explained(y, basis) for basis in bases)
    turns = TURNING * np.abs(r).max()
    port, starboard = y[r < -turns], y[r > turns]
    sides = () if min(len(port), len(starboard)) < 10 else (float(port.mean()), float(starboard.mean()))
    over = np.abs(delta) > 0.5 * np.abs(delta).max()
    hard = () if over.all() or not over.any() else (float(np.sum(y[over] ** 2) / np.sum(y**2)), float(over.mean()))
    return Shape(int(ratio.argmax()), ratio, explained, sides, hard)


def statements(data_set: WhitenedDataSet, found: Sequence[Residual]) -> list[str]:
    """Equation, frame, parity, region and times of the missing force in sentences."""
    shape, used = shape_of(data_set, found), units(data_set)
    rms = np.sqrt(np.mean(np.concatenate([r.force for r in found]) ** 2, axis=0))
    sizes = [
        f"{name} {three_digits(size)} {unit} ({ratio:.1f} times its standard deviation)"
        for name, size, unit, ratio in zip(EQUATIONS, rms, used, shape.ratio, strict=True)
    ]
    said = [f"Missing, root mean square: {', '.join(sizes)}."]
    name, unit = EQUATIONS[shape.strongest], used[shape.strongest]
    if shape.ratio[shape.strongest] < 1.5:
        return [*said, "In no equation does the missing force stand out of its standard deviation."]
    if shape.explained:
        body, earth, turning = shape.explained
        said.append(
            f"Of the {name}'s variance a constant in body axes explains {body:.0%}, the heading {earth:.0%}, rudder "
            f"and yaw rate {turning:.0%}."
        )
    else:
        said.append("Body or earth axes cannot be told: no run turns through 90 deg.")
    if shape.sides:
        left, right = shape.sides
        alike = {"even": "of the same sign", "odd": "of opposite sign", "mixed": "on one side more"}[shape.parity]
        way = PUSHES["XYN"[shape.strongest]]
        means = " and ".join(
            f"{three_digits(abs(mean))} {unit} {way[mean < 0]} in {side} turns"
            for mean, side in ((left, "port"), (right, "starboard"))
        )
        said.append(f"Mean {name}: {means}: {alike}.")
    if shape.hard:
        share, time = shape.hard
        said.append(f"{share:.0%} of its square falls into the {time:.0%} of the time with more than half the helm.")
    return [*said, when_missing(found)] if any(r.windows for r in found) else said


def when_missing(found: Sequence[Residual]) -> str:
    """Times of the missing force in a sentence; windows that touch are one."""
    times, inside = [], 0.0
    for r in found:
        joined: list[Interval] = []
        for start, end in sorted((max(a, r.time[0]), min(b, r.time[-1])) for a, b in r.windows):
            touches = bool(joined) and start <= joined[-1][1]
            joined[-1:] = [(joined[-1][0], max(end, joined[-1][1]))] if touches else [*joined[-1:], (start, end)]
        inside += sum(end - start for start, end in joined)
        times += [f"{r.run} {start:.0f} to {end:.0f} s" for start, end in joined]
    share = inside / sum(r.time[-1] - r.time[0] for r in found)
    return f"It was located in {share:.0%} of the time: {', '.join(times)}."


def _explained(y: Float[np.ndarray, " n"], basis: list[Float[np.ndarray, " n"]]) -> float:
    """Share of the second moment that a basis explains."""
    a = np.stack(basis, axis=-1)
    fit = a @ lstsq(a, y)
    return float(1 - np.sum((y - fit) ** 2) / max(np.sum(y**2), 1e-30))
