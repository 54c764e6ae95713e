"""How often intervals hold the truth: ships with known coefficients, sailed with noise, from scattered priors."""

import numpy as np
import torch

from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.ship import Ship
from manoeuvre_nn.estimation.closed_loop import first, solve
from manoeuvre_nn.estimation.problem import CHANNELS, EstimationProblem

NOISE = np.array([0.005, 0.005, 0.01, 0.01, 0.01, 0.005])
"""Standard deviation of u, v, r, x, y, psi in U0, U0/L, L, rad: good sensors."""
FORCE, FORCE_TIME = np.array([3e-4, 5e-4, 1e-3]), 1.0
PACE, PARTS = 0.05, 2


def zigzags(ship: Ship, angle: float, length: float, count: int, seed: int, lacking: float = 1.0, shift=1.0):
    """Zigzags of one ship side by side, with coloured accelerations that its equations lack: tracks without noise."""
    random, p = np.random.default_rng(seed), ship.particulars
    scale = torch.tensor([p.speed, p.speed, p.speed / p.length], dtype=torch.float64)
    second, h = p.length / p.speed, PACE / PARTS
    units = (scale / second).numpy()
    decay = np.exp(-h / FORCE_TIME)
    state = np.zeros((count, 6))
    state[:, 0] = 1.0
    colour = lacking * FORCE * random.standard_normal((count, 3))
    delta, order = np.zeros(count), np.full(count, angle)
    rows, rudder = [state], [delta]

    def rate(s, d):
        nu = torch.as_tensor(s[:, :3].copy()) * scale
        with torch.no_grad():
            push = ship.acceleration(nu, torch.as_tensor(d.copy())).numpy() / units + colour
        cos, sin = np.cos(s[:, 5]), np.sin(s[:, 5])
        place = s[:, 0] * cos - s[:, 1] * sin, s[:, 0] * sin + s[:, 1] * cos, s[:, 2]
        return np.concatenate([push, np.stack(place, axis=1)], axis=1)

    for step in range(round(length / h)):
        order = np.where(order * state[:, 5] > angle**2 * shift, -order, order)
        turned = delta + np.clip(order - delta, -p.rudder_rate * second * h, p.rudder_rate * second * h)
        one = rate(state, delta)
        state = state + h / 2 * (one + rate(state + h * one, turned))
        delta = turned
        fresh = np.sqrt(1 - decay**2) * lacking * FORCE * random.standard_normal((count, 3))
        colour = decay * colour + fresh
        if (step + 1) % PARTS == 0:
            rows, rudder = [*rows, state], [*rudder, delta]
    time = PACE * np.arange(len(rows))
    still = np.zeros(len(rows))
    return [
        run_of(
            f"zz{k}",
            time,
            np.array(rows)[:, k],
            {"delta": np.array(rudder)[:, k], "n": still + 1.0} | {"wind_north": still, "wind_east": still},
        )  # fmt: skip
        for k in range(count)
    ]


def run_of(name, time, states, inputs):
    """A recording of states and inputs."""
    return Recording(name, time, dict(zip(CHANNELS, states.T, strict=True)) | inputs)


def with_noise(run, noise, draw):
    """The recording with noise on what is measured."""
    measured = run.stacked(*CHANNELS)
    return run.with_channels(**dict(zip(CHANNELS, (measured + noise * draw(measured.shape)).T, strict=True)))


def errors(force, truth, spread, runs, seed: int, noise=NOISE, draw=None):
    """Errors over standard errors: of all coefficients, a row a set of runs; and of the combinations that are measured.

    Coefficients of which little is learnt err as the prior was drawn; the combinations in which the recordings outweigh
    the prior ten to one in variance show whether errors are right that come from noise.
    """
    random, rows, sharp = np.random.default_rng(seed), [], []
    draw = draw or (lambda shape: random.standard_normal(shape))
    for tracks in runs:
        noisy = [with_noise(t, noise, draw) for t in tracks]
        mean = truth + spread * random.standard_normal(len(truth))
        problem = EstimationProblem(noisy, force, mean, spread, process_time=FORCE_TIME)
        found = solve(problem, first(problem, process_sd=tuple(FORCE)))
        scaled = found.covariance / spread[:, None] / spread
        sizes, axes = np.linalg.eigh(scaled)
        rows.append((found.values - truth) / spread / np.sqrt(np.diag(scaled)))
        known = axes[:, sizes < 0.1]
        sharp.append((known.T @ ((found.values - truth) / spread)) / np.sqrt(sizes[sizes < 0.1]))
    return np.array(rows), np.concatenate(sharp)
