"""Plain networks that predict the change of u, v, r over a second: LSTM and NARX, several seeds at once."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import torch
from esso_osaka_data import as_recording, smooth
from jaxtyping import Float
from torch import Tensor, nn

from manoeuvre_nn.core.particulars import Particulars
from manoeuvre_nn.core.recording import Recording

STEP = 1.0
"""Time between samples [s]."""
LAGS = 3
"""Seconds that the NARX network looks back."""
LIMIT = 8.0
"""Scaled states are kept within this, so that a network that runs away gives finite gradients."""
TURN = 0.5
"""Heading error that counts as much as one standard deviation of a velocity [rad]."""

LONG = ((True, 30, 100), (False, 20, 250), (False, 90, 250))
LONGER = ((True, 30, 50), (False, 20, 300), (False, 60, 700))
SHORT = ((True, 20, 20), (False, 20, 50))
"""(Forced, window [s], iterations) of each stage of a training: LSTM, NARX (which learns more slowly), quick."""

Memory = tuple[Tensor, ...]


class LSTM(nn.Module):
    """One layer of long short-term memory and a linear output; all members (seeds) side by side."""

    def __init__(self, members: int, inputs: int, hidden: int) -> None:
        """Draw the weights as torch.nn.LSTM does."""
        super().__init__()
        bound = hidden**-0.5
        self.gates = nn.Parameter(torch.empty(members, inputs + hidden, 4 * hidden).uniform_(-bound, bound))
        self.bias = nn.Parameter(torch.empty(members, 1, 4 * hidden).uniform_(-bound, bound))
        self.out = nn.Parameter(torch.empty(members, hidden, 3).uniform_(-bound, bound) * 0.1)
        self.hidden = hidden

    def start(self, x: Float[Tensor, "members rows k"]) -> Memory:
        """Empty memory."""
        empty = x.new_zeros(*x.shape[:2], self.hidden)
        return empty, empty

    def forward(self, x: Float[Tensor, "members rows k"], memory: Memory) -> tuple[Tensor, Memory]:
        """Change of the scaled state, and the memory after it."""
        short, long = memory
        gates = torch.baddbmm(self.bias, torch.cat([x, short], -1), self.gates)
        keep, take, give, new = gates.chunk(4, -1)
        long = torch.sigmoid(keep + 1.0) * long + torch.sigmoid(take) * torch.tanh(new)
        short = torch.sigmoid(give) * torch.tanh(long)
        return torch.bmm(short, self.out), (short, long)


class NARX(nn.Module):
    """Two hidden layers that see states and inputs of the last seconds; all members (seeds) side by side."""

    def __init__(self, members: int, inputs: int, hidden: int) -> None:
        """Draw the weights."""
        super().__init__()
        sizes = [inputs * LAGS, hidden, hidden, 3]
        pairs = list(pairwise(sizes))
        bounds = [a**-0.5 for a, _ in pairs[:-1]] + [0.1 * hidden**-0.5]
        draws = [torch.empty(members, a, b).uniform_(-w, w) for (a, b), w in zip(pairs, bounds, strict=True)]
        self.weights = nn.ParameterList(draws)
        self.biases = nn.ParameterList([torch.zeros(members, 1, b) for _, b in pairs])

    def start(self, x: Float[Tensor, "members rows k"]) -> Memory:
        """Before the first sample all was as it is in it."""
        return (x,) * (LAGS - 1)

    def forward(self, x: Float[Tensor, "members rows k"], memory: Memory) -> tuple[Tensor, Memory]:
        """Change of the scaled state, and the inputs to remember."""
        layer = torch.cat([x, *memory], -1)
        for i, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            layer = torch.baddbmm(bias, layer, weight)
            layer = torch.tanh(layer) if i < 2 else layer
        return layer, (x, *memory)[: LAGS - 1]


@dataclass
class Scaled:
    """What states and inputs are divided by.

    Attributes:
        state: Standard deviations of u, v, r.
        change: Of their changes in a step, robust.
        helm: Of rudder and shaft, and a wind speed.
    """

    state: Tensor
    change: Tensor
    helm: Tensor


def rows_of(run: Recording) -> Float[np.ndarray, "n 8"]:
    """u, v, r, psi, and rudder, shaft and wind halfway to the next sample."""
    helm = run.stacked("delta", "n", "wind_north", "wind_east")
    helm[:-1] = 0.5 * (helm[:-1] + helm[1:])
    return np.concatenate([run.stacked("u", "v", "r", "psi"), helm], axis=1)


def roll(
    net: nn.Module, scaled: Scaled, data: Tensor, wind: bool, forced: bool, noise: float = 0.0
) -> tuple[Tensor, Tensor]:
    """Run on from the first sample with the recorded inputs.

    Args:
        net: LSTM or NARX.
        scaled: Scales.
        data: :func:`rows_of` windows, shape (members, windows, times, 8).
        wind: Whether the wind is an input.
        forced: Whether every step starts from the recorded state (teacher forcing).
        noise: Standard deviation of noise on the scaled states that the network sees.

    Returns:
        Scaled u, v, r (members, windows, times, 3) and headings [rad] (members, windows, times).
    """
    state, psi, memory = data[..., 0, :3] / scaled.state, data[..., 0, 3], None
    states, headings = [state], [psi]
    for k in range(data.shape[2] - 1):
        if forced:
            state, psi = data[..., k, :3] / scaled.state, data[..., k, 3]
        seen = state + noise * torch.randn_like(state) if noise else state
        x = [seen, data[..., k, 4:6] / scaled.helm[:2]]
        if wind:
            x.append(_air(state * scaled.state, psi, data[..., k, 6:]) / scaled.helm[2])
        x = torch.cat(x, -1)
        memory = net.start(x) if memory is None else memory
        change, memory = net(x, memory)
        after = (state + change * scaled.change).clamp(-LIMIT, LIMIT)
        psi = psi + 0.5 * STEP * (state[..., 2] + after[..., 2]) * scaled.state[2]
        state = after
        states.append(state)
        headings.append(psi)
    return torch.stack(states, 2), torch.stack(headings, 2)


def _air(nu: Tensor, psi: Tensor, wind: Tensor) -> Tensor:
    """Relative wind times its speed, from ahead and from starboard: what wind loads go by."""
    cos, sin = psi.cos(), psi.sin()
    ahead = wind[..., 0] * cos + wind[..., 1] * sin + nu[..., 0]
    across = wind[..., 1] * cos - wind[..., 0] * sin + nu[..., 1]
    speed = (ahead.square() + across.square() + 1e-9).sqrt()
    return torch.stack([speed * ahead, speed * across], -1)


@dataclass(frozen=True)
class Trained:
    """Networks that predict together: the median of the members' velocities, the track integrated from it."""

    net: nn.Module
    scaled: Scaled
    wind: bool

    def predict(self, recording: Recording) -> Recording:
        """Run from the recording's first state.

        Args:
            recording: What was recorded.

        Returns:
            The prediction.
        """
        run = smooth(recording, STEP)
        members = next(self.net.parameters()).shape[0]
        data = torch.tensor(rows_of(run), dtype=torch.float32)[None, None].expand(members, 1, -1, -1)
        with torch.no_grad():
            nu = (roll(self.net, self.scaled, data, self.wind, False)[0] * self.scaled.state).median(dim=0).values[0]
        u, v, r = nu.double().numpy().T
        psi = run["psi"][0] + _summed(r)
        x = run["x"][0] + _summed(u * np.cos(psi) - v * np.sin(psi))
        y = run["y"][0] + _summed(u * np.sin(psi) + v * np.cos(psi))
        return as_recording(recording, run.time, np.stack([u, v, r, x, y, psi], 1))


def _summed(rate: np.ndarray) -> np.ndarray:
    """Integral by the trapezium rule."""
    return np.concatenate([[0.0], np.cumsum(0.5 * STEP * (rate[1:] + rate[:-1]))])


@dataclass(frozen=True)
class PlainNetwork:
    """An LSTM or NARX network trained first with teacher forcing, then over whole windows in closed loop.

    Every member starts from weights of its own and leaves out one zigzag (where there is one) and one random run of its
    own for early stopping. Windows are turned to the other side at random. The loss is the smooth L1 norm of the scaled
    velocities and heading: velocities jump where the positions do.

    Attributes:
        kind: ``lstm`` or ``narx``.
        members: How many seeds.
        hidden: Nodes a layer.
        stages: (forced, window [s], iterations) of each stage.
        batch: Windows a member and iteration.
        mirror: Whether windows are turned to the other side at random.
        decay: Weight decay.
        noise: Noise on the scaled states that the network sees in training.
    """

    kind: str
    members: int = 5
    hidden: int = 32
    stages: tuple[tuple[bool, int, int], ...] = LONG
    batch: int = 48
    mirror: bool = True
    decay: float = 1e-3
    noise: float = 0.1

    def fit(self, recordings: list[Recording], ship: Particulars, wind: bool) -> Trained:
        """Train.

        Args:
            recordings: Training runs.
            ship: Not used.
            wind: Whether the wind is an input.

        Returns:
            The networks.
        """
        del ship
        torch.manual_seed(0)
        runs = [torch.tensor(rows_of(smooth(r, STEP)), dtype=torch.float32) for r in recordings]
        kinds = [str(r.meta["group"]) for r in recordings]
        groups = [[i for i, kind in enumerate(kinds) if kind == g] for g in ("zigzag", "random")]
        left_out = [[g[(3 * k + 1) % len(g)] for g in groups if g] for k in range(self.members)]
        scaled = _scales(runs)
        net = {"lstm": LSTM, "narx": NARX}[self.kind](self.members, 7 if wind else 5, self.hidden)
        draw = np.random.default_rng(0)
        best = _Best(net)
        for forced, window, count in self.stages:
            optimizer = torch.optim.AdamW(net.parameters(), lr=4e-3, weight_decay=self.decay)
            schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, count, 2e-4)
            for k in range(count):
                data = self._windows(runs, kinds, left_out, window + 1, draw)
                losses = _loss(*roll(net, scaled, data, wind, forced, self.noise), data, scaled)
                optimizer.zero_grad()
                losses.sum().backward()
                nn.utils.clip_grad_norm_(net.parameters(), 5.0 * self.members)
                optimizer.step()
                schedule.step()
                if not forced and k % 25 == 24:
                    best.look(self._checked(net, scaled, runs, left_out, wind))
        best.restore()
        return Trained(net, scaled, wind)

    def _windows(
        self,
        runs: list[Tensor],
        kinds: list[str],
        left_out: list[list[int]],
        size: int,
        draw: np.random.Generator,
    ) -> Tensor:
        """Windows at random; half of them from the zigzags, which are short but go fastest."""
        spans = np.array([len(r) - size for r in runs], float)
        totals = {g: sum(n for n, h in zip(spans, kinds, strict=True) if h == g) for g in set(kinds)}
        shares = [n / totals[g] for n, g in zip(spans, kinds, strict=True)]
        chosen = []
        for out in left_out:
            kept = [r for i, r in enumerate(runs) if i not in out]
            share = np.array([s for i, s in enumerate(shares) if i not in out])
            picks = draw.choice(len(kept), self.batch, p=share / share.sum())
            starts = [int(draw.integers(len(kept[p]) - size)) for p in picks]
            chosen.append(torch.stack([kept[p][s : s + size] for p, s in zip(picks, starts, strict=True)]))
        data = torch.stack(chosen)
        if not self.mirror:
            return data
        odd = torch.tensor([1.0, -1, -1, -1, -1, 1, 1, -1])
        other = torch.tensor(draw.random(data.shape[:2]) < 0.5)[..., None, None]
        return torch.where(other, data * odd, data)

    def _checked(
        self, net: nn.Module, scaled: Scaled, runs: list[Tensor], left_out: list[list[int]], wind: bool
    ) -> Tensor:
        """Loss of every member over the first 120 s, and each 120 s after, of the runs it left out."""
        pieces = []
        for out in left_out:
            cut = [runs[i][s : s + 121] for i in out for s in range(0, len(runs[i]) - 120, 120)]
            pieces.append([cut[j % len(cut)] for j in range(9)])
        data = torch.stack([torch.stack(p) for p in pieces])
        with torch.no_grad():
            return _loss(*roll(net, scaled, data, wind, False), data, scaled)


class _Best:
    """Weights of every member at its least loss."""

    def __init__(self, net: nn.Module) -> None:
        """Nothing seen yet."""
        self.net, self.kept = net, [p.detach().clone() for p in net.parameters()]
        self.loss = torch.full((self.kept[0].shape[0],), torch.inf)

    def look(self, loss: Tensor) -> None:
        """Keep what is better than before."""
        better = loss < self.loss
        self.loss = torch.where(better, loss, self.loss)
        for mine, p in zip(self.kept, self.net.parameters(), strict=True):
            mine[better] = p.detach()[better]

    def restore(self) -> None:
        """Put the best weights back; members that never gave a finite loss keep their last."""
        with torch.no_grad():
            seen = torch.isfinite(self.loss)
            for mine, p in zip(self.kept, self.net.parameters(), strict=True):
                p[seen] = mine[seen]


def _scales(runs: list[Tensor]) -> Scaled:
    """Scales out of the training runs."""
    all_rows = torch.cat(runs)
    state = all_rows[:, :3].std(0)
    changes = torch.cat([r[1:, :3] - r[:-1, :3] for r in runs]) / state
    change = 1.4826 * changes.abs().median(0).values
    return Scaled(state, change, torch.cat([all_rows[:, 4:6].std(0), all_rows.new_tensor([4.0])]))


def _loss(states: Tensor, headings: Tensor, data: Tensor, scaled: Scaled) -> Tensor:
    """Smooth L1 of scaled velocities and heading, a member each."""
    error = torch.cat([states - data[..., :3] / scaled.state, ((headings - data[..., 3]) / TURN)[..., None]], -1)
    size = error.abs()
    return torch.where(size < 0.5, size.square(), size - 0.25).mean((1, 2, 3))
