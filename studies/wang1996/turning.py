"""Sway velocity of one turn as a function of its yaw rate: where that has two values, and networks that give it."""

from dataclasses import dataclass
from math import inf
from typing import Literal

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from manoeuvre_nn.core.errors import InputError, check_choice
from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.numerics.damping import Stops
from manoeuvre_nn.numerics.least_squares import Carry, LeastSquares
from manoeuvre_nn.numerics.restarts import minimise
from manoeuvre_nn.numerics.steepest_descent import RateSchedule, SteepestDescent
from studies.wang1996.sway_curve import SwayCurve, gate, unpack

Method = Literal["levenberg_marquardt", "steepest_descent"]
NEGLIGIBLE = 0.01
"""Share of the largest v that the two branches of v(r) may lie apart for it to count as single-valued."""
WINDOW = 0.5
"""Share of that fall around the largest r within which the branches are joined."""
HIDDEN = 5
"""Hidden nodes of v(r)."""
SCHEDULE = RateSchedule((1e-1, 1e-2, 1e-3), (13_000, 1_000, 1_000), shake_rate=0.0)
"""Wang 1996, section 6.2: rates between 1e-3 and 1e-1, 15 000 iterations; when which is not stated."""
MOMENTUM = 0.9
"""Of eq 2.20, not stated: it stands in for updates after every single sample, many in each of those iterations."""


@dataclass(frozen=True)
class Fold:
    """Where the yaw rate of a turn passes a largest value and comes back, so that v(r) has two values.

    Attributes:
        time: When r is largest [s].
        r: r' there, its sign that of the turn [-].
        settled: r' at the end of the turn [-].
        apart: Largest distance of the two branches of v' at one r' [-].
        apart_at: r' at which they are that far apart [-].
        largest_v: Largest size of v' [-].
        window: When r first and last passes the level between which the branches are joined [s].
    """

    time: float
    r: float
    settled: float
    apart: float
    apart_at: float
    largest_v: float
    window: tuple[float, float]

    @property
    def falls_by(self) -> float:
        """How far r falls after its largest value, over that value [-]."""
        return 1 - self.settled / self.r

    @property
    def double_valued(self) -> bool:
        """Whether the branches lie further apart than is negligible."""
        return self.apart > NEGLIGIBLE * self.largest_v


@dataclass(frozen=True)
class TurnData:
    """A turn in the ship's units and to starboard: a turn to port is mirrored.

    Attributes:
        time: t U0 / L since the rudder order [-].
        r: r' [-].
        v: v' [-].
        side: +1 for a turn to starboard, -1 for one to port.
    """

    time: Float[np.ndarray, " n"]
    r: Float[np.ndarray, " n"]
    v: Float[np.ndarray, " n"]
    side: int


def turn_data(turn: Recording, ship: Particulars) -> TurnData:
    """Read v and r of a turn.

    Args:
        turn: Recording with v and r, from the rudder order on.
        ship: The ship, for L and the approach speed U0.

    Returns:
        v', r' and t'.

    Raises:
        InputError: If the ship does not turn to one side.
    """
    r, v = turn["r"] * ship.time_unit, turn["v"] / ship.speed
    side = int(np.sign(r[np.abs(r).argmax()]))
    if side == 0 or side * r[-1] < 0.1 * np.abs(r).max():
        raise InputError(f"recording {turn.name}: v(r) needs a turn to one side; at its end the ship does not turn so")
    return TurnData((turn.time - turn.time[0]) / ship.time_unit, side * r, side * v, side)


def find_fold(turn: Recording, ship: Particulars, *, window: float = WINDOW) -> Fold:
    """Look for a largest yaw rate within a turn.

    Args:
        turn: Recording of the turn.
        ship: The ship.
        window: Share of the later fall of r within which branches would be joined [-].

    Returns:
        Where r is largest and what the branches of v(r) do; see ``double_valued``.

    Raises:
        InputError: If the window is no share.
    """
    if not 0 < window < 1:
        raise InputError(f"window={window}: expected a share of the fall of r between 0 and 1")
    data = turn_data(turn, ship)
    r, v, top = data.r, data.v, int(data.r.argmax())
    rise = np.maximum.accumulate(r[: top + 1]) + 1e-12 * np.arange(top + 1)
    other = np.interp(r[top:], rise, v[: top + 1])
    apart = np.where(r[top:] >= r[0], np.abs(v[top:] - other), 0.0)
    widest = top + int(apart.argmax())
    level = r[top] - window * (r[top] - r[-1])
    inside = np.flatnonzero(r >= level)
    times = turn.time[inside[0]] - turn.time[0], turn.time[inside[-1]] - turn.time[0]
    settled, largest, at = (float(data.side * x) for x in (r[-1], r[top], r[widest]))
    widest_apart, largest_v = float(apart.max()), float(np.abs(v).max())
    window_times = float(times[0]), float(times[1])
    return Fold(float(turn.time[top]), largest, settled, widest_apart, at, largest_v, window_times)


@dataclass(frozen=True)
class TurnFit:
    """Networks trained on one turn, one a start.

    Attributes:
        curve: Their curves as rows.
        fold: What the turn's v(r) does.
        sse: Sum over the samples of the squared error of v' of every start [-].
        last: Squared error of v' at the last sample of every start [-].
    """

    curve: SwayCurve
    fold: Fold
    sse: Float[Tensor, " starts"]
    last: Float[Tensor, " starts"]

    @property
    def best(self) -> SwayCurve:
        """The curve with the least error."""
        return self.curve.row(int(self.sse.nan_to_num(nan=inf).argmin()))


class _Joined(LeastSquares):
    """Networks of the branches, added with given shares: the least-squares problem of every start."""

    def __init__(self, x: Float[Tensor, " n"], y: Float[Tensor, " n"], shares: Float[Tensor, "n branches"]) -> None:
        self.x, self.y, self.shares, self.residuals = x, y, shares, len(x)

    def _nodes(self, weights: Float[Tensor, "k p"]) -> tuple[Tensor, Tensor, Tensor]:
        first, inner, last, constant = unpack(weights.unflatten(1, (self.shares.shape[1], -1)))
        nodes = torch.sigmoid(first[:, None] * self.x[:, None, None] + inner[:, None])  # (K, N, branches, H)
        return nodes, last, (nodes * last[:, None]).sum(-1) + constant[:, None]

    def evaluate(self, weights: Float[Tensor, "k p"]) -> tuple[Float[Tensor, " k"], Carry]:
        """Mean square errors, and nodes and errors for the derivatives."""
        nodes, last, values = self._nodes(weights)
        errors = (values * self.shares).sum(-1) - self.y
        return errors.square().mean(1), (nodes, last, errors)

    def jacobian(self, carry: Carry) -> Float[Tensor, "k n p"]:
        """Derivatives of the errors by the weights."""
        nodes, last, _ = carry
        share = self.shares[:, :, None]
        slope = nodes * (1 - nodes) * last[:, None] * share
        by_node = torch.stack([slope * self.x[:, None, None], slope], dim=-1).flatten(-2)
        return torch.cat([by_node, nodes * share, share.expand(len(nodes), -1, -1, 1)], dim=-1).flatten(2)

    def gradient(self, weights: Float[Tensor, "k p"]) -> Float[Tensor, "k p"]:
        """Gradient of the mean square errors."""
        nodes, last, errors = self.evaluate(weights)[1]
        pull = (2 / self.residuals * errors)[..., None] * self.shares
        by_last = pull[..., None] * nodes
        slope = by_last * (1 - nodes)
        by_node = torch.stack([(slope * self.x[:, None, None]).sum(1), slope.sum(1)], dim=-1) * last[..., None]
        return torch.cat([by_node.flatten(-2), by_last.sum(1), pull.sum(1)[..., None]], dim=-1).flatten(1)

    def linearise(self, weights: Float[Tensor, "k p"], carry: Carry) -> tuple[Tensor, Tensor]:
        """J^T J and J^T e."""
        del weights
        jacobian = self.jacobian(carry)
        return jacobian.mT @ jacobian, (jacobian.mT @ carry[2][..., None])[..., 0]


def fit_turn(
    turn: Recording,
    ship: Particulars,
    *,
    branches: int = 1,
    method: Method = "levenberg_marquardt",
    iterations: int | None = None,
    starts: int = 8,
    seed: int = 0,
) -> TurnFit:
    """Train 1-5-1 networks for the v(r) of one turn.

    Levenberg-Marquardt works on standardised r' and v' from N(0, 1) weights. Steepest descent works as in the thesis:
    r' and v' as they are, W from U[0, 1), B from -U[0, 1); a step takes the mean of the gradients over all samples.

    Args:
        turn: Recording of the turn, from the rudder order on.
        ship: The ship.
        branches: 1 as in the thesis; 2 has a network before and one after the largest r, where v(r) has two values.
        method: ``levenberg_marquardt`` or ``steepest_descent``.
        iterations: Steps; by default 1000, or the 15 000 of the thesis.
        starts: Number of first weights.
        seed: Seed of the first weights.

    Returns:
        The networks. A second branch is left out where v(r) has one value.

    Raises:
        InputError: If a setting makes no sense.

    Source:
        Wang 1996, section 6.2.
    """
    check_choice("method", method, ["levenberg_marquardt", "steepest_descent"])
    if branches not in {1, 2} or starts < 1:
        raise InputError(f"v(r) with branches={branches}, starts={starts}: expected 1 or 2 branches, at least 1 start")
    data, fold = turn_data(turn, ship), find_fold(turn, ship)
    double = branches == 2 and fold.double_valued
    join = torch.tensor(fold.window if double else (0.0, 1.0), dtype=torch.float64) / ship.time_unit
    time, x, y = (torch.tensor(a, dtype=torch.float64) for a in (data.time, data.r, data.v))
    late = gate(time, join)[0]
    shares = torch.stack([1 - late, late], dim=1) if double else torch.ones_like(x)[:, None]
    ours = method == "levenberg_marquardt"
    units = torch.stack([x.mean(), x.std(), y.mean(), y.std()]) if ours else x.new_tensor([0.0, 1.0, 0.0, 1.0])
    problem = _Joined((x - units[0]) / units[1], (y - units[2]) / units[3], shares)
    weights = (_marquardt if ours else _descend)(problem, iterations, starts, seed)
    errors = problem.evaluate(weights)[1][2] * units[3]
    curve = SwayCurve(weights.unflatten(1, (shares.shape[1], -1)), units, join, x.new_tensor(float(data.side)))
    return TurnFit(curve, fold, errors.square().sum(1), errors[:, -1].square())


def _marquardt(problem: _Joined, iterations: int | None, starts: int, seed: int) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    size = starts, problem.shares.shape[1] * (3 * HIDDEN + 1)
    start = torch.randn(size, generator=generator, dtype=torch.float64)
    return minimise(problem, start, stops=Stops(epochs=iterations or 1000, min_fall=1e-9)).weights


def _descend(problem: _Joined, iterations: int | None, starts: int, seed: int) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    size = starts, problem.shares.shape[1], 3 * HIDDEN + 1
    start = torch.rand(size, generator=generator, dtype=torch.float64)
    start[..., 2 * HIDDEN :] *= -1  # v is negative where r is positive
    weights = nn.Parameter(start.flatten(1))
    descent = SteepestDescent([weights], momentum=MOMENTUM, schedule=SCHEDULE)
    with torch.no_grad():
        for _ in range(iterations or sum(SCHEDULE.iterations)):
            weights.grad = problem.gradient(weights)
            descent.step()
    return weights.detach()
